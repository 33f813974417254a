/* Adds to the commands what linear feedback makes of the way to the desired state. */
static INLINE void add_feedback(
    const Settings *settings,
    const size_t step,
    const int first,
    Block *b)
{
    if (first || settings->desired_q.by_step != 0) {
        load_rows(settings->desired_q, b->first, b->filled, step, NQ, b->desired_q);
    }
    if (first || settings->desired_v.by_step != 0) {
        load_rows(settings->desired_v, b->first, b->filled, step, NV, b->desired_v);
    }
    difference(b->constants, b->q, b->desired_q, b->error);
    VECTORISE
    for (int e = 0; e < NV * LANES; ++e) {
        b->error[NV * LANES + e] = b->desired_v[e] - b->v[e];
    }
    for (int i = 0; i < NU; ++i) {
        const real *gain = settings->gain + i * 2 * NV;
        real *command = b->command + i * LANES;
        VECTORISE
        for (int lane = 0; lane < LANES; ++lane) {
            real sum = command[lane];
            for (int j = 0; j < 2 * NV; ++j) {
                sum += gain[j] * b->error[j * LANES + lane];
            }
            command[lane] = sum;
        }
    }
}

static INLINE void limit(const Settings *settings, Block *b)
{
    for (int i = 0; settings->least && i < NU; ++i) {
        const real least = settings->least[i];
        VECTORISE
        for (int lane = 0; lane < LANES; ++lane) {
            const real wanted = b->command[i * LANES + lane];
            b->command[i * LANES + lane] = wanted < least ? least : wanted;
        }
    }
    for (int i = 0; settings->most && i < NU; ++i) {
        const real most = settings->most[i];
        VECTORISE
        for (int lane = 0; lane < LANES; ++lane) {
            const real wanted = b->command[i * LANES + lane];
            b->command[i * LANES + lane] = wanted > most ? most : wanted;
        }
    }
}

/* What is left of the way of thrusts to commands: at the start, after half a step, a whole one. */
static INLINE void prepare_lag(const Settings *settings, Block *b)
{
    load_rows(settings->time_constants, b->first, b->filled, 0, ROTORS, b->left[0]);
    for (int e = 0; e < ROTORS * LANES; ++e) {
        const real time_constant = b->left[0][e];
        const int lags = time_constant > R(0.0);
        const real half = lags ? LIBRARY(exp)(R(-0.5) * settings->dt / time_constant) : R(0.0);
        b->left[0][e] = lags ? R(1.0) : R(0.0);
        b->left[1][e] = half;
        b->left[2][e] = half * half;
    }
}

/* Inputs at the start, in the middle and at the end of a step, through which commands are held. */
static INLINE void follow(Block *b)
{
    VECTORISE
    for (int e = 0; e < ROTORS * LANES; ++e) {
        const real way = b->thrusts[e] - b->command[e];
        b->lagged[0][e] = b->command[e] + way * b->left[0][e];
        b->lagged[1][e] = b->command[e] + way * b->left[1][e];
        b->lagged[2][e] = b->command[e] + way * b->left[2][e];
        b->next_thrusts[e] = b->lagged[2][e];
    }
    VECTORISE
    for (int e = ROTORS * LANES; e < NU * LANES; ++e) {
        b->lagged[0][e] = b->lagged[1][e] = b->lagged[2][e] = b->command[e];
    }
}

/* What acts in a step, the first of a call or a later one. */
static INLINE void act(
    const Settings *settings,
    const size_t step,
    const int first,
    Block *b)
{
    if (first || settings->inputs.by_step != 0 || settings->gain) {
        load_rows(settings->inputs, b->first, b->filled, step, NU, b->command);
        if (settings->gain) {
            add_feedback(settings, step, first, b);
        }
        limit(settings, b);
    }
    if (settings->wrenches.entries && (first || settings->wrenches.by_step != 0)) {
        load_rows(settings->wrenches, b->first, b->filled, step, FRAMES * 6, b->loads);
    }
    if (b->lags) {
        follow(b);
    }
}
