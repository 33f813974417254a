/*
 * Rollouts: states in rows become blocks, each of which takes all its steps. Before it stand tables
 * of what is GIVEN to some of the PROGRAMS.
 */
#define NQ_NV (NQ + NV)

/* The number of the first program of the method that has all that is given. */
static INLINE int program_for(const Given *given, const Rows *rows)
{
    int program = given->method ? PROGRAMS / 2 : 0;
    for (; program < PROGRAMS - 1; ++program) {
        int has_all = 1;
        for (int k = 0; k < GIVEN; ++k) {
            has_all &= !rows[k].entries || (HAS[program] >> k & 1u);
        }
        if (has_all) {
            break;
        }
    }
    return program;
}

/*
 * Fill a block with what is given of its states in a step: all, or what changes from step to step.
 * Returns whether any of it does.
 */
static INLINE int lay_out(
    const Rows *rows,
    const size_t first,
    const int filled,
    const size_t step,
    const int begins,
    number *room,
    const void **addresses)
{
    int changes = 0;
    for (int k = 0; k < GIVEN; ++k) {
        const Input input = INPUTS[k];
        const int changing = rows[k].by_step != 0;
        addresses[k] = room;
        if (input.is_shared && rows[k].entries) {
            addresses[k] = rows[k].entries;
        } else if (begins || changing) {
            load_rows(rows[k], input.without, first, filled, step, input.width, room);
            changes |= changing;
        }
        room += input.width;
    }
    return changes;
}

static INLINE void keep_sample(
    const States *states,
    const size_t first,
    const int filled,
    const size_t sample,
    const number *x)
{
    const size_t row = first * states->samples + sample, apart = states->samples;
    real *q = states->q_samples, *v = states->v_samples, *a = states->ACTUATED_SAMPLES;
    store_rows(x, filled, NQ, NQ * apart, q ? q + row * NQ : q);
    store_rows(x + NQ, filled, NV, NV * apart, v ? v + row * NV : v);
    store_rows(x + NQ_NV, filled, ACTUATORS, ACTUATORS * apart, a ? a + row * ACTUATORS : a);
}

static WIDE void roll_block(
    const Given *given,
    const double h,
    const States *states,
    const size_t first,
    const int filled,
    const size_t begin,
    const size_t end)
{
    number room[ROOM], x[STATE];
    const void *addresses[GIVEN + 3];
    const Rows *rows = (const Rows *)(const void *)((const char *)given + offsetof(Given, FIRST_ROWS));
    Rows constants = rows_of((const real *)given->constants, CONSTANTS);
    const int program = program_for(given, rows);
    const int changes = lay_out(rows, first, filled, begin, 1, room + CONSTANTS, addresses + 2);
    const size_t every = states->every ? states->every : SIZE_MAX;
    unsigned char *ended = states->ended + first;
    Progress progress;
    constants.by_state *= given->constants_by_state;
    addresses[0] = room;
    addresses[1] = NULL;
    addresses[GIVEN + 2] = &program;
    load_rows(constants, R(0.0), first, filled, 0, CONSTANTS, room);
    load_rows(rows_of(states->q, NQ), R(0.0), first, filled, 0, NQ, x);
    load_rows(rows_of(states->v, NV), R(0.0), first, filled, 0, NV, x + NQ);
    load_rows(rows_of(states->ACTUATED, ACTUATORS), R(0.0), first, filled, 0, ACTUATORS, x + NQ_NV);
    for (int lane = 0; lane < LANES; ++lane) {
        progress.going[lane] = ended[lane < filled ? lane : filled - 1] == RUNNING;
        progress.refused[lane] = progress.taken[lane] = 0;
    }
    if (begin == 0) {
        keep_sample(states, first, filled, 0, x);
    }
    for (size_t step = begin; step < end;) {
        const size_t to_sample = every - step % every;
        const size_t left = to_sample < end - step ? to_sample : end - step;
        const size_t steps = changes ? 1 : left < INT32_MAX ? left : INT32_MAX;
        if (changes && step > begin) {
            lay_out(rows, first, filled, step, 0, room + CONSTANTS, addresses + 2);
        }
        program_run(addresses, 0.0, h, (int)steps, INT32_MAX, 0, x, NULL, NULL, &progress);
        step += steps;
        if (steps == to_sample) {
            keep_sample(states, first, filled, step / every, x);
        }
    }
    store_rows(x, filled, NQ, NQ, states->q + first * NQ);
    store_rows(x + NQ, filled, NV, NV, states->v + first * NV);
    if (states->ACTUATED) {
        store_rows(x + NQ_NV, filled, ACTUATORS, ACTUATORS, states->ACTUATED + first * ACTUATORS);
    }
    for (int lane = 0; lane < filled; ++lane) {
        states->steps[first + (size_t)lane] += (size_t)progress.taken[lane];
        if (ended[lane] == RUNNING && !progress.going[lane]) {
            ended[lane] = progress.refused[lane] ? DIVERGED : OUT_OF_BOUNDS;
        }
    }
}

void MODULE(rollout)(
    const Given *given,
    const double dt,
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
        roll_block(given, dt, states, first + block * LANES, filled, begin, end);
    }
}
