/* Sizes of arrays, none of which may be empty. */
#define INPUT_ROOM ((NU > 0 ? NU : 1) * LANES)
#define Q_ROOM (NQ * LANES)
#define V_ROOM (NV * LANES)

#ifdef __GNUC__
#define ALIGNED __attribute__((aligned(64)))
#else
#define ALIGNED
#endif

/*
 * A block of states: entry e of a lane is at [e * LANES + lane]. The inputs at the begin, in the
 * middle and at the end of a step are `command` unless thrusts lag. `wrenches` are NULL without.
 */
typedef struct Block {
    real q[Q_ROOM], next_q[Q_ROOM], half[Q_ROOM], later[Q_ROOM], desired_q[Q_ROOM];
    real v[V_ROOM], next_v[V_ROOM], rate[V_ROOM], displacement[V_ROOM], desired_v[V_ROOM];
    real acceleration[4][V_ROOM], error[2 * V_ROOM];
    real command[INPUT_ROOM], thrusts[INPUT_ROOM], lagged[3][INPUT_ROOM], left[3][INPUT_ROOM];
    real loads[FRAMES * 6 * LANES];
    bits ended[LANES], taken[LANES];
    size_t states[LANES];
    const real *begin, *middle, *end, *wrenches;
} Block;
