/*
 * Optimal control over a horizon: a quadratic program with one node for each step, solved by a
 * primal-dual interior-point method with Riccati recursions.
 *
 * Node k has w = (u, x); x of node 0 is given, and x of the next one is slope w + gap. The cost of a
 * node is gradient w + w hessian w / 2. A row is an entry of w, or the difference of two, between
 * limits; limits with a penalty may be exceeded at that price. The text before defines INPUTS,
 * STATES, NODES (steps), LIMITS (rows), MOST (iterations), and `limited`, the entries of each row,
 * of which the second is -1 if there is none.
 */
enum { WIDTH = INPUTS + STATES, ENTRIES = REGISTER / sizeof(real), SIDES = 2 * LIMITS };
enum { ROW = (WIDTH + ENTRIES - 1) / ENTRIES };
/* C has no empty arrays. */
enum { ROWS = LIMITS > 0 ? LIMITS : 1 };

/* A row with one of its limits: y = value or -value is at most `limit`. */
typedef struct {
    real limit, price, slack, excess; /* price of the limit, and slack to it */
    real price_step, slack_step, excess_step;
    real weight, constant; /* the next price is weight y + constant */
} Side;

typedef struct {
    part slope[STATES][ROW], hessian[WIDTH][ROW], factor[INPUTS][ROW];
    part w[ROW], next[ROW], gradient[ROW], linear[ROW];
    real gap[STATES], gap_cost[STATES];
    Side sides[2 * ROWS];
} Node;

typedef struct {
    Node node[NODES + 1];
    real penalty[ROWS], scale[ROWS]; /* of rows: price of exceeding limits, magnitude of values */
    real cost[STATES][STATES];       /* cost of all nodes that follow */
    part carried[STATES][ROW], sum[WIDTH][ROW];
    real barrier, tolerance;         /* mean of price times slack, at the start and at the end */
    real magnitude;                  /* of the cost */
    real iterations;
} Plan;

/* A part with one value in all entries. */
static INLINE part in_all(const real value)
{
    const part zero = {R(0.0)};
    return value - zero;
}

/* A tile of sums: sum[i][j] += sign a[i][r] b[r][j] of some rows and parts. */
static INLINE void add_tile(
    const int rows,
    const int parts,
    const int terms,
    const int sign,
    const real *a,
    const int by_row,
    const int by_term,
    const part *b,
    part *sum)
{
    part found[4][3];
    for (int i = 0; i < rows; ++i) {
        for (int j = 0; j < parts; ++j) {
            found[i][j] = sum[i * ROW + j];
        }
    }
    for (int r = 0; r < terms; ++r) {
        for (int i = 0; i < rows; ++i) {
            const part factor = in_all(a[i * by_row + r * by_term]);
            for (int j = 0; j < parts; ++j) {
                const part product = factor * b[r * ROW + j];
                found[i][j] = sign > 0 ? found[i][j] + product : found[i][j] - product;
            }
        }
    }
    for (int i = 0; i < rows; ++i) {
        for (int j = 0; j < parts; ++j) {
            sum[i * ROW + j] = found[i][j];
        }
    }
}

/*
 * sum += sign a b, where a has so many rows and terms. Of a symmetric sum only the upper triangle
 * is computed; its first row is that of the whole.
 */
static INLINE void add_products(
    const int rows,
    const int terms,
    const int sign,
    const int first,
    const real *a,
    const int by_row,
    const int by_term,
    const part *b,
    part *sum)
{
    for (int i = 0, height; i < rows; i += height) {
        height = rows - i < 4 ? 1 : 4;
        for (int j = first < 0 ? 0 : (first + i) / ENTRIES, width; j < ROW; j += width) {
            width = ROW - j < 3 ? ROW - j : 3;
            const real *from = a + i * by_row;
            part *to = sum + i * ROW + j;
            /* Tiles of known sizes stay in registers. */
#define ADD_TILE(h, w) add_tile(h, w, terms, sign, from, by_row, by_term, b + j, to)
            if (height == 4) {
                width == 3 ? ADD_TILE(4, 3) : width == 2 ? ADD_TILE(4, 2) : ADD_TILE(4, 1);
            } else {
                width == 3 ? ADD_TILE(1, 3) : width == 2 ? ADD_TILE(1, 2) : ADD_TILE(1, 1);
            }
        }
    }
}

/* The sum of the entries of a part. */
static INLINE real sum_of(const part x)
{
#if LANES == 1
    return x;
#else
    real sum = R(0.0);
    for (int entry = 0; entry < ENTRIES; ++entry) {
        sum += x[entry];
    }
    return sum;
#endif
}

static INLINE real dot_rows(const part *a, const part *b)
{
    part sum = a[0] * b[0];
    for (int j = 1; j < ROW; ++j) {
        sum += a[j] * b[j];
    }
    return sum_of(sum);
}

static INLINE real *reals(void *x)
{
    return (real *)x;
}

/* The value of a row. */
static INLINE real value_of(const int row, const real *w)
{
    const int other = limited[row][1];
    return w[limited[row][0]] - (other < 0 ? R(0.0) : w[other]);
}

/* Whether a side of a row has a limit. */
static INLINE int is_limited(const Side *side)
{
    return side->limit < R(1e29);
}

/* Price of excess, less the price of the limit. */
static INLINE real excess_price(const Plan *plan, const int place, const Side *side)
{
    return plan->penalty[place / 2] - side->price;
}

static INLINE int may_exceed(const Plan *plan, const int place)
{
    return plan->penalty[place / 2] < R(1e29);
}

/* Factorise the costs of all nodes, from the last one to the first, with the weights of sides. */
static void factorise(Plan *plan)
{
    for (int k = NODES; k >= 0; --k) {
        Node *node = &plan->node[k];
        memcpy(plan->sum, node->hessian, sizeof plan->sum);
        if (k < NODES) {
            memset(plan->carried, 0, sizeof plan->carried);
            add_products(STATES, STATES, 1, -1, &plan->cost[0][0], STATES, 1, node->slope[0],
                plan->carried[0]);
            add_products(WIDTH, STATES, 1, 0, reals(node->slope[0]), 1, ROW * ENTRIES,
                plan->carried[0], plan->sum[0]);
            for (int i = 0; i < STATES; ++i) {
                real sum = R(0.0);
                for (int j = 0; j < STATES; ++j) {
                    sum += plan->cost[i][j] * node->gap[j];
                }
                node->gap_cost[i] = sum;
            }
        }
        for (int place = 0; place < SIDES; ++place) {
            const int i = limited[place / 2][0], j = limited[place / 2][1];
            const real weight = node->sides[place].weight;
            reals(plan->sum[i])[i] += weight;
            if (j >= 0) {
                reals(plan->sum[i])[j] -= weight;
                reals(plan->sum[j])[j] += weight;
            }
        }
        for (int i = 0; k < NODES && i < INPUTS; ++i) {
            part *row = plan->sum[i];
            const part scale = in_all(R(1.0) / LIBRARY(sqrt)(reals(row)[i]));
            for (int j = i / ENTRIES; j < ROW; ++j) {
                row[j] *= scale;
            }
            for (int below = i + 1; below < INPUTS; ++below) {
                const part share = in_all(reals(row)[below]);
                for (int j = below / ENTRIES; j < ROW; ++j) {
                    plan->sum[below][j] -= share * row[j];
                }
            }
            memcpy(node->factor[i], row, sizeof node->factor[i]);
            memset(node->factor[i], 0, sizeof(real) * (size_t)i);
        }
        if (k < NODES) {
            add_products(STATES, INPUTS, -1, INPUTS, reals(node->factor[0]) + INPUTS, 1,
                ROW * ENTRIES, node->factor[0], plan->sum[INPUTS]);
        }
        for (int i = 0; i < STATES; ++i) {
            const real *row = reals(plan->sum[INPUTS + i]) + INPUTS;
            for (int j = i; j < STATES; ++j) {
                plan->cost[i][j] = plan->cost[j][i] = row[j];
            }
        }
    }
}

/* Solve with the factors: `next` of all nodes minimises the cost with the constants of sides. */
static void solve_nodes(Plan *plan)
{
    real slope[STATES] = {R(0.0)};
    for (int k = NODES; k >= 0; --k) {
        Node *node = &plan->node[k];
        part *all = node->linear;
        real *linear = reals(all);
        memcpy(all, node->gradient, sizeof node->linear);
        for (int place = 0; place < SIDES; ++place) {
            const int i = limited[place / 2][0], j = limited[place / 2][1];
            const real constant = node->sides[place].constant;
            const real pull = place % 2 ? -constant : constant;
            linear[i] += pull;
            if (j >= 0) {
                linear[j] -= pull;
            }
        }
        if (k < NODES) {
            for (int r = 0; r < STATES; ++r) {
                slope[r] += node->gap_cost[r];
            }
            add_products(1, STATES, 1, -1, slope, 0, 1, node->slope[0], all);
            for (int i = 0; i < INPUTS; ++i) {
                const real *row = reals(node->factor[i]);
                const real share = linear[i] / row[i];
                for (int j = 0; j < ROW; ++j) {
                    all[j] -= in_all(share) * node->factor[i][j];
                }
                linear[i] = share;
            }
        }
        memcpy(slope, linear + INPUTS, sizeof slope);
    }
    for (int k = 0; k <= NODES; ++k) {
        Node *node = &plan->node[k];
        real *next = reals(node->next);
        memset(next, 0, sizeof(real) * INPUTS);
        for (int i = INPUTS; k < NODES && i-- > 0;) {
            const real *row = reals(node->factor[i]);
            next[i] = -(reals(node->linear)[i] + dot_rows(node->factor[i], node->next)) / row[i];
        }
        for (int i = 0; k < NODES && i < STATES; ++i) {
            reals(node[1].next)[INPUTS + i] = node->gap[i] + dot_rows(node->slope[i], node->next);
        }
    }
}

/* How the next price of a side depends on its row, if price times slack becomes `aim`. */
static INLINE void linearise_side(
    const Plan *plan, const int place, Side *side, const real aim, const real excess_aim)
{
    real room = side->slack, missing = aim - side->price * side->limit;
    if (may_exceed(plan, place)) {
        const real share = side->price / excess_price(plan, place, side);
        room += share * side->excess;
        missing -= share * excess_aim;
    }
    side->weight = side->price / room;
    side->constant = side->price + missing / room;
}

/* The step of a side to the solution, and its greatest share that keeps prices and slacks positive.
 * */
static INLINE real step_of(
    const Plan *plan, const int place, Side *side, const real *next, const real excess_aim)
{
    const real y = place % 2 ? -value_of(place / 2, next) : value_of(place / 2, next);
    real share = R(1.0), gap = side->limit - y - side->slack;
    side->price_step = side->weight * y + side->constant - side->price;
    if (may_exceed(plan, place)) {
        const real price = excess_price(plan, place, side);
        side->excess_step = (excess_aim + side->excess * side->price_step) / price - side->excess;
        gap += side->excess + side->excess_step;
        share = real_maximum(share, side->price_step / price);
        share = real_maximum(share, -side->excess_step / side->excess);
    }
    side->slack_step = gap;
    share = real_maximum(share, -side->price_step / side->price);
    return real_maximum(share, -side->slack_step / side->slack);
}

/* Mean of price times slack after a share of the steps; the number of products goes to `count`. */
static real mean_product(const Plan *plan, const real share, int *count)
{
    real sum = R(0.0);
    *count = 0;
    for (int k = 0; k <= NODES; ++k) {
        for (int place = 0; place < SIDES; ++place) {
            const Side *side = &plan->node[k].sides[place];
            if (!is_limited(side)) {
                continue;
            }
            const real price = side->price + share * side->price_step;
            sum += price * (side->slack + share * side->slack_step);
            *count += 1;
            if (may_exceed(plan, place)) {
                sum += (plan->penalty[place / 2] - price) *
                    (side->excess + share * side->excess_step);
                *count += 1;
            }
        }
    }
    return sum / (real)(*count > 0 ? *count : 1);
}

/* A side with so much slack, but at least a share of its scale. */
static INLINE void begin_side(
    const Plan *plan, const int place, Side *side, const real left, const real least)
{
    side->price_step = side->slack_step = side->excess_step = R(0.0);
    side->weight = side->constant = side->excess = side->price = R(0.0);
    side->slack = R(1.0);
    if (is_limited(side)) {
        side->slack = real_maximum(left, least * plan->scale[place / 2]);
        side->price = plan->barrier / side->slack;
        if (may_exceed(plan, place)) {
            side->price = real_minimum(side->price, R(0.5) * plan->penalty[place / 2]);
            side->excess = plan->barrier / excess_price(plan, place, side);
        }
    }
}

/* Initial slacks and prices about w. */
static void begin_sides(Plan *plan)
{
    for (int k = 0; k <= NODES; ++k) {
        Node *node = &plan->node[k];
        for (int place = 0; place < SIDES; ++place) {
            Side *side = &node->sides[place];
            const real value = value_of(place / 2, reals(node->w));
            const real left = side->limit - (place % 2 ? -value : value);
            begin_side(plan, place, side, left, R(0.02));
        }
    }
}

/*
 * Restart where the first step leads: w becomes the solution without limits, slacks get the
 * magnitudes that follow from it, and each product with a price becomes an equal share of the cost.
 */
static void begin_again(Plan *plan, const int count)
{
    plan->barrier = real_maximum(plan->barrier, plan->magnitude / (real)count);
    for (int k = 0; k <= NODES; ++k) {
        Node *node = &plan->node[k];
        memcpy(node->w, node->next, sizeof node->w);
        for (int place = 0; place < SIDES; ++place) {
            begin_side(plan, place, &node->sides[place],
                real_absolute(node->sides[place].slack + node->sides[place].slack_step), R(0.1));
        }
    }
}

/* Take a share of the way to `next`. */
static void take_share(Plan *plan, const real share)
{
    for (int k = 0; k <= NODES; ++k) {
        Node *node = &plan->node[k];
        for (int j = 0; j < ROW; ++j) {
            node->w[j] += in_all(share) * (node->next[j] - node->w[j]);
        }
        for (int place = 0; place < SIDES; ++place) {
            Side *side = &node->sides[place];
            side->price += share * side->price_step;
            side->slack += share * side->slack_step;
            side->excess += share * side->excess_step;
        }
    }
}

/* Steps of all sides to `next`. Returns the share that keeps prices and slacks positive. The aim of
 * a corrected step is the barrier less the products that the first step would add. */
static real steps_of(Plan *plan, const real barrier, const int is_corrected, const int linearise)
{
    real most = R(1.0);
    for (int k = 0; k <= NODES; ++k) {
        for (int place = 0; place < SIDES; ++place) {
            Side *side = &plan->node[k].sides[place];
            if (!is_limited(side)) {
                continue;
            }
            real aim = barrier, excess_aim = barrier;
            if (is_corrected) {
                aim -= side->price_step * side->slack_step;
                excess_aim += side->price_step * side->excess_step;
            }
            if (linearise) {
                linearise_side(plan, place, side, aim, excess_aim);
            } else {
                const real *next = reals(plan->node[k].next);
                most = real_maximum(most, step_of(plan, place, side, next, excess_aim));
            }
        }
    }
    return R(1.0) / most;
}

/*
 * Solve the program from x of node 0, which is in w. Returns whether it has converged. If so, w is
 * the solution, else the last iterate, which may not be finite.
 */
static int solve_plan(Plan *plan)
{
    real still = R(1.0);
    for (int k = 0; k <= NODES; ++k) {
        Node *node = &plan->node[k];
        memset(node->w, 0, sizeof(real) * INPUTS);
        if (k == 0) {
            memcpy(node->next, node->w, sizeof node->w);
        }
        for (int i = 0; k < NODES && i < STATES; ++i) {
            reals(node[1].w)[INPUTS + i] = node->gap[i] + dot_rows(node->slope[i], node->w);
        }
    }
    begin_sides(plan);
    for (int iteration = 0; iteration < MOST; ++iteration) {
        plan->iterations = (real)iteration;
        int count = 0;
        const real mean = mean_product(plan, R(0.0), &count);
        if (count > 0 && still < R(1e-3) && mean < plan->tolerance) {
            return 1;
        }
        if (!(mean < R(1e30))) {
            return 0;
        }
        steps_of(plan, R(0.0), 0, 1);
        factorise(plan);
        solve_nodes(plan);
        real share = steps_of(plan, R(0.0), 0, 0);
        if (count == 0) {
            take_share(plan, R(1.0));
            return 1;
        }
        if (iteration == 0 && share < R(0.5)) {
            begin_again(plan, count);
            still = R(1.0);
            continue;
        }
        const real left = mean_product(plan, share, &count) / mean;
        const real barrier = real_maximum(left * left * left * mean, R(0.1) * plan->tolerance);
        steps_of(plan, barrier, 1, 1);
        solve_nodes(plan);
        share = steps_of(plan, barrier, 1, 0);
        share *= share < R(1.0) ? R(0.995) : R(0.9999);
        take_share(plan, share);
        still *= R(1.0) - share;
    }
    return 0;
}

/* First and second derivatives of the cost along w. */
static void slope_of_cost(const Plan *plan, real *slope, real *bend)
{
    *slope = *bend = R(0.0);
    for (int k = 0; k <= NODES; ++k) {
        const Node *node = &plan->node[k];
        const real *w = (const real *)node->w;
        for (int i = 0; i < WIDTH; ++i) {
            const real *row = (const real *)node->hessian[i];
            real sum = R(0.5) * row[i] * w[i];
            for (int j = i + 1; j < WIDTH; ++j) {
                sum += row[j] * w[j];
            }
            *slope += ((const real *)node->gradient)[i] * w[i];
            *bend += R(2.0) * sum * w[i];
        }
    }
}
