/*
 * What the functions of every robot need; the same file comes with each. It takes `real`, SINGLE
 * where that is float, and, for blocks of states, LANES, MODULE(name), which puts the robot's name
 * before a name, and, where every state has its own constants, EACH and CONSTANTS, which says how
 * many these are. No other source sees what is defined here.
 */
#ifndef GIBBS_RUNTIME_H
#define GIBBS_RUNTIME_H

#include "platform.c"

/* Entries, and lanes, are independent. gcc vectorises loops over them that it does not unroll. */
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 8
#define ENTRYWISE _Pragma("GCC ivdep") _Pragma("GCC unroll 1")
#else
#define ENTRYWISE VECTORISE
#endif

#include "exactness.c"

#include "sine_cosine.c"

#include "arctangent.c"

#ifdef LANES
#include "constants.c"

#include "blocks.c"
#endif

#endif
