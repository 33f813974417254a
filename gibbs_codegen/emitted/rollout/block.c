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
 * A block of states: entry e of a lane is at [e * LANES + lane]. A step reads `q`, `v` and
 * `thrusts` and fills `next_q`, `next_v` and `next_thrusts`. Unless thrusts lag, these have no
 * values, and inputs at its begin, middle and end are `command`. `wrenches` is NULL without. Its
 * `filled` lanes have the states from `first` on.
 */
typedef struct Block {
    real constants[CONSTANTS * LANES];
    real room_q[2][Q_ROOM], half[Q_ROOM], later[Q_ROOM], desired_q[Q_ROOM];
    real room_v[2][V_ROOM], rate[V_ROOM], displacement[V_ROOM], desired_v[V_ROOM];
    real acceleration[4][V_ROOM], error[2 * V_ROOM];
    real room_thrusts[2][INPUT_ROOM], left[3][INPUT_ROOM];
    real command[INPUT_ROOM], lagged[3][INPUT_ROOM];
    real loads[FRAMES * 6 * LANES];
    bits ended[LANES], taken[LANES];
    size_t first;
    int filled, lags;
    real *q, *next_q, *v, *next_v, *thrusts, *next_thrusts;
    const real *begin, *middle, *end, *wrenches;
} Block;
