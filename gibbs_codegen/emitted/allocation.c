/*
 * Thrusts within limits whose wrench is nearest to a desired one: bounded least squares.
 *
 * States are solved one at a time. Torques are divided by a lever arm, so that they compare with
 * forces; a small weight on thrusts makes the solution unique. The solver guesses which thrusts are
 * at a limit, starting from the last solution, and changes all wrong guesses at once. If that does
 * not reduce their number, it changes only the last one, which always terminates (Judice and Pires
 * 1994).
 */
enum { BASE = 6 };
/* Rounds without fewer wrong guesses before only one guess is changed. */
enum { PATIENCE = 3 };

typedef struct {
    real columns[ROTORS][BASE]; /* wrenches of unit thrusts */
    real target[BASE];
    real preference; /* weight of small thrusts */
    real least[ROTORS];
    real most[ROTORS];
} Nearest;

/* Whether a thrust is strictly between its limits. */
static INLINE int is_free(const real side)
{
    return !(side < R(0.0)) && !(side > R(0.0));
}

static INLINE real product_of(const int n, const real *a, const real *b)
{
    real sum = R(0.0);
    for (int i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* Scale torques to forces, and set the weight of small thrusts. */
static void weigh_torques(Nearest *p)
{
    real force = R(0.0), torque = R(0.0);
    for (int k = 0; k < ROTORS; ++k) {
        force += product_of(3, p->columns[k], p->columns[k]);
        torque += product_of(3, p->columns[k] + 3, p->columns[k] + 3);
    }
    /* Torque is divided by the mean lever arm, so that it compares with force. */
    const int both = force > R(0.0) && torque > R(0.0);
    const real weight = both ? LIBRARY(sqrt)(force / torque) : R(1.0);
    for (int i = 3; i < BASE; ++i) {
        p->target[i] *= weight;
        for (int k = 0; k < ROTORS; ++k) {
            p->columns[k][i] *= weight;
        }
    }
    p->preference = R(1e-5) * LIBRARY(sqrt)(force + weight * weight * torque);
}

/* Least squares for the free thrusts, with the others fixed, by Householder reflections. */
static void solve_free(const Nearest *p, const real *sides, real *x)
{
    real columns[ROTORS][BASE], upper[ROTORS][ROTORS], left[BASE];
    memcpy(columns, p->columns, sizeof columns);
    memcpy(left, p->target, sizeof left);
    for (int k = 0; k < ROTORS; ++k) {
        for (int i = 0; i < BASE && !is_free(sides[k]); ++i) {
            left[i] -= columns[k][i] * x[k];
        }
    }
    for (int k = 0; k < ROTORS; ++k) {
        if (!is_free(sides[k])) {
            continue;
        }
        const real *const own = columns[k];
        const real norm = LIBRARY(sqrt)(p->preference * p->preference + product_of(BASE, own, own));
        const real share = R(1.0) / norm, scale = share / (norm + p->preference);
        upper[k][k] = norm;
        x[k] = share * product_of(BASE, own, left);
        const real kept = scale * product_of(BASE, own, left);
        for (int i = 0; i < BASE; ++i) {
            left[i] -= kept * own[i];
        }
        for (int l = k + 1; l < ROTORS; ++l) {
            if (is_free(sides[l])) {
                const real along = product_of(BASE, own, columns[l]);
                upper[k][l] = share * along;
                for (int i = 0; i < BASE; ++i) {
                    columns[l][i] -= scale * along * own[i];
                }
            }
        }
    }
    for (int k = ROTORS; k-- > 0;) {
        if (is_free(sides[k])) {
            for (int l = k + 1; l < ROTORS; ++l) {
                x[k] -= is_free(sides[l]) ? upper[k][l] * x[l] : R(0.0);
            }
            x[k] /= upper[k][k];
        }
    }
}

/* Improve the guesses `sides`, which led to x. Returns the number of changes; `last` is the last
 * one. */
static int guess_again(const Nearest *p, const real *sides, const real *x, real *better, int *last)
{
    real off[BASE];
    int changed = 0;
    for (int i = 0; i < BASE; ++i) {
        off[i] = -p->target[i];
        for (int k = 0; k < ROTORS; ++k) {
            off[i] += p->columns[k][i] * x[k];
        }
    }
    for (int k = 0; k < ROTORS; ++k) {
        const real slope =
            product_of(BASE, p->columns[k], off) + p->preference * p->preference * x[k];
        if (is_free(sides[k])) {
            better[k] = (real)(x[k] > p->most[k]) - (real)(x[k] < p->least[k]);
        } else {
            better[k] = slope * sides[k] > R(0.0) ? R(0.0) : sides[k];
        }
        if (better[k] < sides[k] || better[k] > sides[k]) {
            *last = k;
            ++changed;
        }
    }
    return changed;
}

/* Find thrusts x. An entry of `sides` is -1 at the lower limit, 1 at the upper one and 0 between:
 * first guesses on entry, the solution on return. Returns whether one was found. */
static int find_nearest(const Nearest *p, real *sides, real *x)
{
    real better[ROTORS];
    int fewest = ROTORS + 1, last = 0, patience = PATIENCE;
    for (int round = 0; round < 10 * (ROTORS + 3); ++round) {
        for (int k = 0; k < ROTORS; ++k) {
            if (!is_free(sides[k])) {
                x[k] = sides[k] < R(0.0) ? p->least[k] : p->most[k];
            }
        }
        solve_free(p, sides, x);
        const int changed = guess_again(p, sides, x, better, &last);
        if (changed == 0) {
            return 1;
        }
        patience = changed < fewest ? PATIENCE : patience - 1;
        fewest = changed < fewest ? changed : fewest;
        if (patience >= 0) {
            memcpy(sides, better, sizeof better);
        } else {
            sides[last] = better[last];
        }
    }
    return 0;
}

/* Thrusts `found`, from those there, and `sides` as of `find_nearest`; no numbers where none are
 * found. */
static void find_thrusts(
    const real *wrench,
    const real *columns,
    const real *least,
    const real *most,
    real *sides,
    real *found)
{
    Nearest problem;
    memcpy(problem.columns, columns, sizeof problem.columns);
    memcpy(problem.target, wrench, sizeof problem.target);
    memcpy(problem.least, least, sizeof problem.least);
    memcpy(problem.most, most, sizeof problem.most);
    weigh_torques(&problem);
    if (!find_nearest(&problem, sides, found)) {
        for (int k = 0; k < ROTORS; ++k) {
            found[k] = (real)NAN;
        }
    }
}

/* Whether a thrust is beyond its limits. */
static INLINE int are_beyond(const real *thrusts, const real *least, const real *most)
{
    int beyond = 0;
    for (int k = 0; k < ROTORS; ++k) {
        beyond |= thrusts[k] < least[k] || thrusts[k] > most[k];
    }
    return beyond;
}

/* Thrusts of a wrench, or the nearest ones within limits; NaN if none are found. Rows of `columns`
 * are wrenches of unit thrusts. */
static void nearest_thrusts_of_state(
    const real *thrusts,
    const real *wrench,
    const real *columns,
    const real *least,
    const real *most,
    real *found)
{
    memcpy(found, thrusts, ROTORS * sizeof *found);
    if (are_beyond(thrusts, least, most)) {
        real sides[ROTORS] = {R(0.0)};
        find_thrusts(wrench, columns, least, most, sides, found);
    }
}

/* Lanes with thrusts beyond limits get the nearest ones within; guesses are kept between calls. */
static APART void search_nearest(
    const void *const *context,
    const Given wrench,
    const Given columns,
    const Given least,
    const Given most,
    number *found)
{
    real *const guesses = (real *)(uintptr_t)context[GUESSES];
    const Given thrusts = of_each(found);
    for (int lane = 0; lane < LANES; ++lane) {
        real target[BASE], own[ROTORS * BASE], lowest[ROTORS], highest[ROTORS], x[ROTORS];
        real sides[ROTORS] = {R(0.0)};
        take_lane(thrusts, ROTORS, lane, x);
        take_lane(least, ROTORS, lane, lowest);
        take_lane(most, ROTORS, lane, highest);
        if (!are_beyond(x, lowest, highest)) {
            continue;
        }
        take_lane(wrench, BASE, lane, target);
        take_lane(columns, ROTORS * BASE, lane, own);
        for (int k = 0; k < ROTORS && guesses; ++k) {
            sides[k] = guesses[k * LANES + lane];
        }
        find_thrusts(target, own, lowest, highest, sides, x);
        put_lane(ROTORS, lane, x, found);
        for (int k = 0; k < ROTORS && guesses; ++k) {
            guesses[k * LANES + lane] = sides[k];
        }
    }
}

static INLINE void nearest_thrusts(
    const void *const *context,
    const Given thrusts,
    const Given wrench,
    const Given columns,
    const Given least,
    const Given most,
    number *found)
{
    flags beyond = {0};
    for (int k = 0; k < ROTORS; ++k) {
        found[k] = of_all(thrusts, k);
        beyond |= greater(of_all(least, k), found[k]) | greater(found[k], of_all(most, k));
    }
    if (any(beyond)) {
        search_nearest(context, wrench, columns, least, most, found);
    }
}
