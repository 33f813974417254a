/*
 * A predictive controller: real-time iterations on a plan of states and inputs.
 *
 * Before it stand the programs of `machine/predictive.py`, `horizon.c`, and what
 * `runtime/predictive.py` prints: lengths, the structure Controller, which users see, and
 * `placed`, the places of the entries of each row in inputs and state, one after the other.
 * MODULE(name) puts the robot's name before a name.
 */
typedef struct {
    Plan plan;
    real candidate[NODES + 1][SIZE], candidate_u[NODES][INPUTS], away[NODES + 1][STATES];
    real cost, gaps; /* of the plan that is linearised: what it misses */
} Room;

/* The controller ends with room for a Room, at an address that vectors may have. */
typedef char room_is_large_enough
    [sizeof(((Controller *)0)->room) >= sizeof(Room) + LANES * sizeof(real) ? 1 : -1];

static Room *room_of(Controller *own)
{
    const size_t width = LANES * sizeof(real), over = (uintptr_t)own->room % width;
    return (Room *)(void *)((char *)own->room + (over > 0 ? width - over : 0));
}

/* Rows of nodes, from one on, side by side; the last one fills up. */
static INLINE void gather(
    const real *rows,
    const int first,
    const int count,
    const int size,
    number *to)
{
    for (int lane = 0; lane < LANES; ++lane) {
        const int k = first + lane < count ? first + lane : count - 1;
        for (int i = 0; i < size; ++i) {
            reals(to)[i * LANES + lane] = rows[k * size + i];
        }
    }
}

static INLINE void scatter(
    const number *from,
    const int first,
    const int count,
    const int size,
    real *rows)
{
    for (int lane = 0; lane < LANES && first + lane < count; ++lane) {
        for (int i = 0; i < size; ++i) {
            rows[(first + lane) * size + i] = ((const real *)from)[i * LANES + lane];
        }
    }
}

/* The sum of the magnitudes of what is missing of some nodes. */
static real magnitude(const real *missing, const int count)
{
    real sum = R(0.0);
    for (int i = 0; i < count; ++i) {
        sum += real_absolute(missing[i]);
    }
    return sum;
}

/* Linearise all nodes of the plan about its states and inputs. */
WIDE static void linearise(const Constants *constants, Controller *own, Room *room)
{
    Plan *plan = &room->plan;
    room->cost = room->gaps = R(0.0);
    for (int first = 0; first < NODES; first += LANES) {
        number u[INPUTS], x[SIZE], x_next[SIZE], h, reference[REFERENCE];
        number gap[STATES], slope[STATES * WIDTH], hessian[BENT * BENT];
        number gradient[WIDTH], cost;
        gather(own->u[0], first, NODES, INPUTS, u);
        gather(own->x[0], first, NODES, SIZE, x);
        gather(own->x[1], first, NODES, SIZE, x_next);
        gather(own->h, first, NODES, 1, &h);
        gather(own->reference[0], first, NODES, REFERENCE, reference);
        NODE(u, x, x_next, h, reference, own->weights, own->lag_times, own->around, gap,
            slope, hessian, gradient, &cost);
        Node *nodes = &plan->node[first];
        const int count = NODES - first < LANES ? NODES - first : LANES;
        for (int i = 0; i < STATES; ++i) {
            for (int j = 0; j < WIDTH; ++j) {
                for (int lane = 0; lane < count; ++lane) {
                    reals(nodes[lane].slope[i])[j] = reals(slope)[(i * WIDTH + j) * LANES + lane];
                }
            }
        }
        for (int i = 0; i < BENT; ++i) {
            for (int j = i; j < BENT; ++j) {
                for (int lane = 0; lane < count; ++lane) {
                    reals(nodes[lane].hessian[BEND + i])[BEND + j] =
                        reals(hessian)[(i * BENT + j) * LANES + lane];
                }
            }
        }
        for (int lane = 0; lane < count; ++lane) {
            for (int i = 0; i < STATES; ++i) {
                nodes[lane].gap[i] = reals(gap)[i * LANES + lane];
            }
            for (int i = 0; i < WIDTH; ++i) {
                reals(nodes[lane].gradient)[i] = reals(gradient)[i * LANES + lane];
            }
            room->cost += reals(&cost)[lane];
            room->gaps += magnitude(nodes[lane].gap, STATES);
        }
    }
    number x[SIZE], reference[REFERENCE];
    number gradient[MOTION], hessian[MOTION * MOTION], cost;
    Node *last = &plan->node[NODES];
    gather(own->x[NODES], 0, 1, SIZE, x);
    gather(own->reference[NODES], 0, 1, REFERENCE, reference);
    END(x, reference, own->weights, own->ahead, hessian, gradient, &cost);
    room->cost += reals(&cost)[0];
    for (int i = 0; i < MOTION; ++i) {
        reals(last->gradient)[INPUTS + i] = reals(gradient)[i * LANES];
        for (int j = i; j < MOTION; ++j) {
            reals(last->hessian[INPUTS + i])[INPUTS + j] =
                reals(hessian)[(MOTION * i + j) * LANES];
        }
    }
    /* The rest, beside what programs give: of inputs and velocities with a cost of one's own. */
    for (int k = 0; k < NODES; ++k) {
        for (int i = 0; i < WIDTH; ++i) {
            real *row = reals(plan->node[k].hessian[i]);
            const int is_bent = i >= BEND && i < BEND + BENT;
            row[i] = own->diagonal[i] + (is_bent ? row[i] : R(0.0));
            for (int j = 0; i < INPUTS && j < STATES; ++j) {
                const int is_across = BEND == 0 && INPUTS + j < BENT;
                row[INPUTS + j] = own->across[i][j] + (is_across ? row[INPUTS + j] : R(0.0));
            }
        }
    }
}

/* Limits of the changes of all nodes. */
static void limit(const Controller *own, Plan *plan)
{
    for (int k = 0; k <= NODES; ++k) {
        for (int row = 0; row < LIMITS; ++row) {
            Side *sides = &plan->node[k].sides[2 * row];
            const int i = placed[row][0], j = placed[row][1];
            const int acts = limited[row][0] < INPUTS ? k < NODES : k > 0;
            const real *x = own->x[k], *u = own->u[k < NODES ? k : 0];
            real value = i < INPUTS ? u[i] : x[i - INPUTS];
            value -= j < 0 ? R(0.0) : x[j - INPUTS];
            /* Limits of differences are those of rates. */
            const real h = j < 0 ? R(1.0) : own->h[k < NODES ? k : 0];
            sides[0].limit = acts ? own->most[row] * h - value : R(1e30);
            sides[1].limit = acts ? value - own->least[row] * h : R(1e30);
        }
    }
}

/* Displacements from states to others, of all nodes. */
WIDE static void displacements(
    const Constants *constants,
    const real *from,
    const real *to,
    const int count,
    real *away)
{
    for (int first = 0; first < count; first += LANES) {
        number x[SIZE], x_next[SIZE], found[STATES];
        gather(from, first, count, SIZE, x);
        gather(to, first, count, SIZE, x_next);
        AWAY(x, x_next, found);
        scatter(found, first, count, STATES, away);
    }
}

/* States of all nodes after displacements. */
WIDE static void move(
    const Constants *constants,
    const real *from,
    const real *away,
    const int count,
    real *to)
{
    for (int first = 0; first < count; first += LANES) {
        number x[SIZE], step[STATES], found[SIZE];
        gather(from, first, count, SIZE, x);
        gather(away, first, count, STATES, step);
        MOVED(x, step, found);
        scatter(found, first, count, SIZE, to);
    }
}

/* Cost of the candidate, and the sum of its gaps, with the way to x, where it is to begin. */
WIDE static real value_of_candidate(
    const Constants *constants, const Controller *own, Room *room, const real *x, real *gaps)
{
    real sum = R(0.0);
    displacements(constants, room->candidate[0], x, 1, room->away[0]);
    *gaps = magnitude(room->away[0], STATES);
    for (int first = 0; first < NODES; first += LANES) {
        number u[INPUTS], x_first[SIZE], x_next[SIZE], h, reference[REFERENCE], gap[STATES], cost;
        gather(room->candidate_u[0], first, NODES, INPUTS, u);
        gather(room->candidate[0], first, NODES, SIZE, x_first);
        gather(room->candidate[1], first, NODES, SIZE, x_next);
        gather(own->h, first, NODES, 1, &h);
        gather(own->reference[0], first, NODES, REFERENCE, reference);
        VALUES(u, x_first, x_next, h, reference, own->weights, own->lag_times, own->around, gap,
            &cost);
        scatter(gap, first, NODES, STATES, room->away[0]);
        for (int lane = 0; lane < LANES && first + lane < NODES; ++lane) {
            sum += reals(&cost)[lane];
        }
    }
    *gaps += magnitude(room->away[0], NODES * STATES);
    number last[SIZE], reference[REFERENCE], cost;
    gather(room->candidate[NODES], 0, 1, SIZE, last);
    gather(own->reference[NODES], 0, 1, REFERENCE, reference);
    END_COST(last, reference, own->weights, own->ahead, &cost);
    return sum + reals(&cost)[0];
}

/* A candidate: the plan after a share of the steps. */
static void propose(const Constants *constants, const Controller *own, Room *room, const real share)
{
    for (int k = 0; k <= NODES; ++k) {
        const real *w = reals(room->plan.node[k].w);
        for (int i = 0; i < STATES; ++i) {
            room->away[k][i] = share * w[INPUTS + i];
        }
        for (int i = 0; k < NODES && i < INPUTS; ++i) {
            room->candidate_u[k][i] = own->u[k][i] + share * w[i];
        }
    }
    move(constants, own->x[0], room->away[0], NODES + 1, room->candidate[0]);
}

/*
 * Take a step of Gauss and Newton's method from the plan, where the machine is at x, or a share of it
 * where all of it would make the plan worse: its cost, and its gaps at a price of which the step
 * saves more than it costs (Nocedal and Wright, 2006, 18.36). Returns whether there was a step;
 * without one the plan stays as it was.
 */
static int iterate(const Constants *constants, Controller *own, Room *room, const real *x)
{
    Plan *plan = &room->plan;
    displacements(constants, own->x[0], x, 1, room->away[0]);
    memcpy(reals(plan->node[0].w) + INPUTS, room->away[0], sizeof room->away[0]);
    limit(own, plan);
    memcpy(plan->penalty, own->penalty, sizeof plan->penalty);
    memcpy(plan->scale, own->scale, sizeof plan->scale);
    plan->barrier = own->barrier;
    real slope, bend, gaps;
    const real before = room->cost, gaps_before = room->gaps + magnitude(room->away[0], STATES);
    plan->magnitude = before;
    plan->tolerance = own->tolerance * (R(1.0) + before);
    const int solved = solve_plan(plan);
    own->iterations += plan->iterations;
    if (!solved) {
        return 0;
    }
    slope_of_cost(plan, &slope, &bend);
    real price = R(0.0);
    if (gaps_before > R(1e-12)) {
        price = real_maximum((slope + R(0.5) * bend) / (R(0.7) * gaps_before), R(0.0));
    }
    const real merit = before + price * gaps_before;
    own->share = R(2.0);
    int is_better = 0;
    for (int tried = 0; tried < SHARES && !is_better; ++tried) {
        own->share *= R(0.5);
        propose(constants, own, room, own->share);
        own->cost = value_of_candidate(constants, own, room, x, &gaps);
        own->gaps = gaps;
        const real fall = own->share * (price * gaps_before - slope);
        const real rounding = R(1e-9) * (R(1.0) + real_absolute(merit));
        is_better = own->cost + price * gaps <= merit - R(1e-4) * fall + rounding;
    }
    if (!is_better) {
        return 0;
    }
    memcpy(own->x, room->candidate, sizeof own->x);
    memcpy(own->u, room->candidate_u, sizeof own->u);
    return 1;
}

/* The state after a time `h` with inputs u. */
static void predict(
    const Constants *constants, const Controller *own, Room *room, const real *u, const real h, real *x)
{
    number inputs[INPUTS], state[SIZE], reference[REFERENCE], gap[STATES], cost, step = same(h);
    gather(u, 0, 1, INPUTS, inputs);
    gather(x, 0, 1, SIZE, state);
    gather(own->reference[0], 0, 1, REFERENCE, reference);
    VALUES(
        inputs, state, state, step, reference, own->weights, own->lag_times, own->around, gap,
        &cost);
    scatter(gap, 0, 1, STATES, room->away[0]);
    move(constants, x, room->away[0], 1, x);
}

/* A state of the plan: q and v, the state of motors, and the inputs before. */
static void join_state(const Controller *own, const real *state, real *x)
{
    memcpy(x, state, sizeof(real) * SEEN);
    memcpy(x + SEEN, own->motors, sizeof(real) * MOTORS);
    memcpy(x + SEEN + MOTORS, own->acting, sizeof(real) * CHANGES);
}

/* Plan to stay, before anything is known. */
static void stay(Controller *own, const real *state)
{
    real still[SEEN] = {R(0.0)};
    memcpy(still, state, sizeof(real) * COORDINATES);
    for (int k = 0; k <= NODES; ++k) {
        join_state(own, still, own->x[k]);
    }
    for (int k = 0; k < NODES; ++k) {
        memcpy(own->u[k], own->hover + REFERENCE - INPUTS, sizeof own->u[k]);
    }
}

size_t MODULE(predictive_size)(void)
{
    return sizeof(Controller);
}

void MODULE(predictive_reset)(Controller *own)
{
    memcpy(own->acting, own->hover + REFERENCE - INPUTS, sizeof own->acting);
    memcpy(own->motors, own->settled, sizeof(real) * MOTORS);
    own->failures = R(-1.0);
}

void MODULE(predictive_prepare)(Controller *own)
{
    if (own->failures >= R(0.0)) {
        linearise(&own->constants, own, room_of(own));
    }
}

int MODULE(predictive_feedback)(Controller *own, const real *state, real *u)
{
    const Constants *constants = &own->constants;
    Room *room = room_of(own);
    const int is_first = own->failures < R(0.0), rounds = is_first ? FIRST : (int)own->rounds;
    real x[SIZE];
    if (is_first) {
        stay(own, state);
        linearise(constants, own, room);
    }
    join_state(own, state, x);
    if (own->delay > R(0.0)) {
        predict(constants, own, room, own->acting, own->delay, x);
        memcpy(own->motors, x + SEEN, sizeof(real) * MOTORS); /* when the next inputs act */
    }
    own->iterations = R(0.0);
    int solved = iterate(constants, own, room, x);
    for (int round = 1; solved && round < rounds; ++round) {
        linearise(constants, own, room);
        solved = iterate(constants, own, room, x);
    }
    own->failures += is_first ? R(-1.0) : R(1.0);
    own->failures = solved ? R(0.0) : own->failures;
    if (is_first && !solved) {
        stay(own, state);
    }
    memcpy(u, own->u[0], sizeof own->u[0]);
    /* Plans are within limits but for the solver's tolerance; those of rates are about what acts. */
    for (int row = 0; row < LIMITS; ++row) {
        const int i = placed[row][0], is_rate = placed[row][1] >= 0;
        if (i < INPUTS) {
            const real about = is_rate ? own->acting[i] : R(0.0), h = is_rate ? own->h[0] : R(1.0);
            u[i] = real_minimum(
                real_maximum(u[i], about + own->least[row] * h), about + own->most[row] * h);
        }
    }
    return solved;
}

void MODULE(predictive_shift)(Controller *own)
{
    const Constants *constants = &own->constants;
    Room *room = room_of(own);
    displacements(constants, own->x[0], own->x[1], NODES, room->away[0]);
    for (int k = 0; k < NODES; ++k) {
        const real share = own->h[0] / own->h[k];
        for (int i = 0; i < STATES; ++i) {
            room->away[k][i] *= share;
        }
        for (int i = 0; k + 1 < NODES && i < INPUTS; ++i) {
            own->u[k][i] += share * (own->u[k + 1][i] - own->u[k][i]);
        }
    }
    move(constants, own->x[0], room->away[0], NODES, room->candidate[0]);
    memcpy(own->x, room->candidate, sizeof(real) * NODES * SIZE);
}

void MODULE(predictive_act)(Controller *own, const real *u)
{
    const real time = own->h[0] - own->delay; /* from when they act to the next state */
    if (MOTORS > 0 && time > R(0.0)) {
        real x[SIZE];
        join_state(own, own->x[0], x);
        predict(&own->constants, own, room_of(own), u, time, x);
        memcpy(own->motors, x + SEEN, sizeof(real) * MOTORS);
    }
    memcpy(own->acting, u, sizeof own->acting);
}

int MODULE(predictive_step)(Controller *own, const real *state, const real *reference, real *u)
{
    memcpy(own->reference, reference, sizeof own->reference);
    MODULE(predictive_prepare)(own);
    const int solved = MODULE(predictive_feedback)(own, state, u);
    MODULE(predictive_shift)(own);
    MODULE(predictive_act)(own, u);
    return solved;
}
