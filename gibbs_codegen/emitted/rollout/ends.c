/* What orders numbers by size, where what is not finite comes last, also under -ffast-math. */
static INLINE bits magnitude(const real value)
{
    bits value_bits;
    memcpy(&value_bits, &value, sizeof value_bits);
    return value_bits & MAGNITUDE;
}

/* Whether an entry of a lane is beyond its bounds. */
static INLINE void look_beyond(const Settings *settings, const Block *b, bits *RESTRICT beyond)
{
    VECTORISE
    for (int lane = 0; lane < LANES; ++lane) {
        bits found = 0;
        for (int i = 0; i < NQ; ++i) {
            const real entry = b->next_q[i * LANES + lane];
            found |= (bits)(entry < settings->bounds[i]);
            found |= (bits)(entry > settings->bounds[NQ + NV + i]);
        }
        for (int i = 0; i < NV; ++i) {
            const real entry = b->next_v[i * LANES + lane];
            found |= (bits)(entry < settings->bounds[NQ + i]);
            found |= (bits)(entry > settings->bounds[NQ + NV + NQ + i]);
        }
        beyond[lane] = found;
    }
}

/* Puts back what was before in lanes that have not taken the step. */
static INLINE void put_back(
    const int width,
    const bits *taken,
    const real *RESTRICT before,
    real *RESTRICT after)
{
    VECTORISE
    for (int lane = 0; lane < LANES; ++lane) {
        for (int i = 0; i < width; ++i) {
            const int e = i * LANES + lane;
            after[e] = taken[lane] ? after[e] : before[e];
        }
    }
}

/*
 * Takes over what a step has made of the lanes that still run, unless it is not finite. Returns
 * whether any goes on.
 */
static INLINE int take_over(const Settings *settings, Block *b)
{
    bits taken[LANES], beyond[LANES] = {0}, stops = 0, going = 0;
    real *q = b->q, *v = b->v, *thrusts = b->thrusts;
    if (settings->bounds) {
        look_beyond(settings, b, beyond);
    }
    VECTORISE
    for (int lane = 0; lane < LANES; ++lane) {
        bits largest = 0;
        for (int i = 0; i < NQ; ++i) {
            const bits size = magnitude(b->next_q[i * LANES + lane]);
            largest = size > largest ? size : largest;
        }
        for (int i = 0; i < NV; ++i) {
            const bits size = magnitude(b->next_v[i * LANES + lane]);
            largest = size > largest ? size : largest;
        }
        const bits ended = b->ended[lane];
        const bits end = largest >= NOT_FINITE ? (bits)DIVERGED : beyond[lane] * OUT_OF_BOUNDS;
        taken[lane] = (bits)(ended == RUNNING) & (bits)(largest < NOT_FINITE);
        b->ended[lane] = ended == RUNNING ? end : ended;
        b->taken[lane] += taken[lane];
    }
    for (int lane = 0; lane < LANES; ++lane) {
        stops |= b->ended[lane];
    }
    for (int lane = 0; stops && lane < LANES; ++lane) {
        going += b->ended[lane] == RUNNING;
    }
    if (stops) {
        put_back(NQ, taken, b->q, b->next_q);
        put_back(NV, taken, b->v, b->next_v);
        if (b->lags) {
            put_back(ROTORS, taken, b->thrusts, b->next_thrusts);
        }
    }
    b->q = b->next_q;
    b->next_q = q;
    b->v = b->next_v;
    b->next_v = v;
    b->thrusts = b->next_thrusts;
    b->next_thrusts = thrusts;
    return !stops || going;
}
