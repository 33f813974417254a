#include "platform.c"

#include "rollout/block.c"
