/*
 * From here to MODULE(unpack) the source is the same for every robot. It needs `real`, LANES,
 * MODULE(name), which puts the robot's name before a name, and SINGLE where `real` is float.
 */
#include "platform.c"

#include "sine_cosine.c"

#include "blocks.c"
