/*
 * From here to MODULE(unpack) the source is the same for every robot. It needs `real`, LANES,
 * MODULE(name), which puts the robot's name before a name, SINGLE where `real` is float, and, where
 * every state has its own constants, EACH and CONSTANTS, which says how many these are.
 */
#include "platform.c"

#include "exactness.c"

#include "constants.c"

#include "sine_cosine.c"

#include "blocks.c"
