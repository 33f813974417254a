/* Fills a block: lanes beyond the `filled` ones have the last state again. */
static INLINE void begin_block(
    const Settings *settings,
    const States *states,
    const size_t first,
    const int filled,
    Block *b)
{
    Rows constants = rows_of((const real *)settings->constants, CONSTANTS);
    constants.by_state *= settings->constants_by_state;
    b->first = first;
    b->filled = filled;
    b->lags = settings->time_constants.entries != NULL;
    for (int lane = 0; lane < LANES; ++lane) {
        b->ended[lane] = states->ended[first + (size_t)(lane < filled ? lane : filled - 1)];
        b->taken[lane] = 0;
    }
    b->q = b->room_q[0];
    b->next_q = b->room_q[1];
    b->v = b->room_v[0];
    b->next_v = b->room_v[1];
    b->thrusts = b->room_thrusts[0];
    b->next_thrusts = b->room_thrusts[1];
    load_rows(constants, first, filled, 0, CONSTANTS, b->constants);
    load_rows(rows_of(states->q, NQ), first, filled, 0, NQ, b->q);
    load_rows(rows_of(states->v, NV), first, filled, 0, NV, b->v);
    if (b->lags) {
        load_rows(rows_of(states->thrusts, ROTORS), first, filled, 0, ROTORS, b->thrusts);
        prepare_lag(settings, b);
    }
    b->begin = b->lags ? b->lagged[0] : b->command;
    b->middle = b->lags ? b->lagged[1] : b->command;
    b->end = b->lags ? b->lagged[2] : b->command;
    b->wrenches = settings->wrenches.entries ? b->loads : NULL;
}

static INLINE void keep_sample(const States *states, const size_t sample, const Block *b)
{
    const size_t row = b->first * states->samples + sample;
    if (states->q_samples) {
        store_rows(b->q, b->filled, NQ, NQ * states->samples, states->q_samples + row * NQ);
    }
    if (states->v_samples) {
        store_rows(b->v, b->filled, NV, NV * states->samples, states->v_samples + row * NV);
    }
    if (b->lags && states->thrust_samples) {
        real *rows = states->thrust_samples + row * ROTORS;
        store_rows(b->thrusts, b->filled, ROTORS, ROTORS * states->samples, rows);
    }
}

static INLINE void end_block(const States *states, const Block *b)
{
    const size_t first = b->first;
    store_rows(b->q, b->filled, NQ, NQ, states->q + first * NQ);
    store_rows(b->v, b->filled, NV, NV, states->v + first * NV);
    if (b->lags && states->thrusts) {
        store_rows(b->thrusts, b->filled, ROTORS, ROTORS, states->thrusts + first * ROTORS);
    }
    for (int lane = 0; lane < b->filled; ++lane) {
        states->ended[first + (size_t)lane] = (unsigned char)b->ended[lane];
        states->steps[first + (size_t)lane] += (size_t)b->taken[lane];
    }
}

static WIDE void roll_block(
    const Settings *settings,
    const States *states,
    const size_t first,
    const int filled,
    const size_t begin,
    const size_t end)
{
    Block block ALIGNED;
    const size_t every = settings->every ? settings->every : SIZE_MAX;
    size_t to_sample = every - begin % every;
    size_t sample = begin / every;
    int goes_on = 1;
    begin_block(settings, states, first, filled, &block);
    if (begin == 0) {
        keep_sample(states, 0, &block);
    }
    for (size_t step = begin; step < end; ++step) {
        if (goes_on) {
            act(settings, step, step == begin, &block);
            if (settings->method == EULER) {
                euler(settings->dt, &block);
            } else {
                rk4(settings->dt, &block);
            }
            goes_on = take_over(settings, &block);
        }
        if (--to_sample == 0) {
            to_sample = every;
            keep_sample(states, ++sample, &block);
        }
    }
    end_block(states, &block);
}

void MODULE(rollout)(
    const Settings *settings,
    const States *states,
    const size_t first,
    const size_t count,
    const size_t begin,
    const size_t end)
{
    const size_t blocks = count / LANES + (count % LANES != 0);
    PARALLEL
    for (size_t block = 0; block < blocks; ++block) {
        const size_t left = count - block * LANES;
        const int filled = left < LANES ? (int)left : LANES;
        roll_block(settings, states, first + block * LANES, filled, begin, end);
    }
}
