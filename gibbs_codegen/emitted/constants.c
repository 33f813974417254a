/*
 * The same text serves constants that all states share and, if EACH is defined, constants of each
 * state. These are in blocks, as inputs are, and only functions for batches take them.
 */
#ifdef EACH
typedef real Constants;
#define CONSTANT(name) constants[offsetof(MODULE(constants), name) / sizeof(real) * LANES]
#define OF_LANE(constants, lane) constants + lane
#define OF_BLOCK(constants, block) constants + block * (CONSTANTS * LANES)
#define OF_LAST_BLOCK(constants, block, filled) \
    real last_constants[CONSTANTS * LANES]; \
    fill_lanes(CONSTANTS, filled, OF_BLOCK(constants, block), last_constants)
#define BATCH(function) MODULE(function##_batch_each)
#else
typedef MODULE(constants) Constants;
#define CONSTANT(name) constants->name
#define OF_LANE(constants, lane) constants
#define OF_BLOCK(constants, block) constants
#define OF_LAST_BLOCK(constants, block, filled) const Constants *last_constants = constants
#define BATCH(function) MODULE(function##_batch)
#endif
