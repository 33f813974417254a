/* What orders numbers by size, where what is not finite comes last, also under -ffast-math. */
static INLINE bits magnitude(const real value)
{
    bits value_bits;
    memcpy(&value_bits, &value, sizeof value_bits);
    return value_bits & MAGNITUDE;
}

/*
 * Takes over what a step has made of the lanes that still run, unless it is not finite. Returns
 * whether any goes on.
 */
static INLINE int take_over(const Settings *settings, Block *b)
{
    bits largest[LANES] = {0}, outside[LANES] = {0}, taken[LANES], goes_on = 0;
    const int lags = settings->time_constants.entries != NULL;
    for (int i = 0; i < NQ + NV; ++i) {
        const real *entry = i < NQ ? b->next_q + i * LANES : b->next_v + (i - NQ) * LANES;
        for (int lane = 0; lane < LANES; ++lane) {
            const bits size = magnitude(entry[lane]);
            largest[lane] = size > largest[lane] ? size : largest[lane];
        }
    }
    if (settings->bounds) {
        for (int i = 0; i < NQ + NV; ++i) {
            const real *entry = i < NQ ? b->next_q + i * LANES : b->next_v + (i - NQ) * LANES;
            const real least = settings->bounds[i];
            const real most = settings->bounds[NQ + NV + i];
            for (int lane = 0; lane < LANES; ++lane) {
                outside[lane] |= (bits)(entry[lane] < least) | (bits)(entry[lane] > most);
            }
        }
    }
    for (int lane = 0; lane < LANES; ++lane) {
        const bits ran = b->ended[lane] == RUNNING;
        const bits diverged = largest[lane] >= NOT_FINITE;
        const bits end = diverged ? DIVERGED : outside[lane] ? OUT_OF_BOUNDS : RUNNING;
        taken[lane] = ran && !diverged;
        b->ended[lane] = ran ? end : b->ended[lane];
        b->taken[lane] += taken[lane];
        goes_on |= (bits)(b->ended[lane] == RUNNING);
    }
    for (int i = 0; i < NQ; ++i) {
        for (int lane = 0; lane < LANES; ++lane) {
            const int e = i * LANES + lane;
            b->q[e] = taken[lane] ? b->next_q[e] : b->q[e];
        }
    }
    for (int i = 0; i < NV; ++i) {
        for (int lane = 0; lane < LANES; ++lane) {
            const int e = i * LANES + lane;
            b->v[e] = taken[lane] ? b->next_v[e] : b->v[e];
        }
    }
    for (int i = 0; lags && i < ROTORS; ++i) {
        for (int lane = 0; lane < LANES; ++lane) {
            const int e = i * LANES + lane;
            b->thrusts[e] = taken[lane] ? b->lagged[2][e] : b->thrusts[e];
        }
    }
    return goes_on != 0;
}
