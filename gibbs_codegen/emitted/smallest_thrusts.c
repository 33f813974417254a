/*
 * The smallest thrusts of a wrench, by an orthogonal basis of what rows of the columns make: each
 * next direction of the basis is what the basis so far leaves of the row of which it leaves most.
 * Directions of less than a share of 1e-9 of the greatest are none; in single precision, of 1e-5.
 */
#ifdef SINGLE
#define SMALL R(1e-10)
#else
#define SMALL R(1e-18)
#endif

static void smallest_thrusts_of_state(const real *columns, const real *wrench, real *found)
{
    real rows[BASE][ROTORS], left[BASE], x[ROTORS] = {R(0.0)}, greatest = R(0.0);
    for (int i = 0; i < BASE; ++i) {
        left[i] = wrench[i];
        for (int k = 0; k < ROTORS; ++k) {
            rows[i][k] = columns[k * BASE + i];
        }
    }
    for (int rank = 0; rank < BASE; ++rank) {
        real most = R(0.0);
        int next = 0;
        for (int i = 0; i < BASE; ++i) {
            const real square = product_of(ROTORS, rows[i], rows[i]);
            next = square > most ? i : next;
            most = square > most ? square : most;
        }
        greatest = rank == 0 ? most : greatest;
        if (!(most > SMALL * greatest)) {
            break;
        }
        const real share = left[next] / most;
        for (int k = 0; k < ROTORS; ++k) {
            x[k] += share * rows[next][k];
        }
        for (int i = 0; i < BASE; ++i) {
            if (i == next) {
                continue;
            }
            const real along = product_of(ROTORS, rows[i], rows[next]) / most;
            for (int k = 0; k < ROTORS; ++k) {
                rows[i][k] -= along * rows[next][k];
            }
            left[i] -= along * left[next];
        }
        left[next] = R(0.0);
        memset(rows[next], 0, sizeof rows[next]);
    }
    for (int k = 0; k < ROTORS; ++k) {
        found[k] = x[k];
    }
}

static void smallest_thrusts(
    const void *const *context, const Given columns, const Given wrench, number *found)
{
    (void)context;
    for (int lane = 0; lane < LANES; ++lane) {
        real own[ROTORS * BASE], target[BASE], x[ROTORS];
        take_lane(columns, ROTORS * BASE, lane, own);
        take_lane(wrench, BASE, lane, target);
        smallest_thrusts_of_state(own, target, x);
        put_lane(ROTORS, lane, x, found);
    }
}

/* Unit vector along which rotors push, as equal thrusts of all do. */
static void force_axis_of_state(const real *columns, real *found)
{
    real force[3] = {R(0.0)}, largest = R(0.0), along = R(0.0);
    for (int k = 0; k < ROTORS; ++k) {
        real own[3];
        for (int i = 0; i < 3; ++i) {
            own[i] = columns[k * BASE + i];
        }
        const real square = product_of(3, own, own);
        if (square > largest) {
            largest = square;
            memcpy(force, own, sizeof force);
        }
    }
    for (int k = 0; k < ROTORS; ++k) {
        for (int i = 0; i < 3; ++i) {
            along += columns[k * BASE + i] * force[i];
        }
    }
    /* Rotors may push either way; where as many push up as down, the greatest one decides. */
    const real size = real_signed_as(real_square_root(largest), along);
    for (int i = 0; i < 3; ++i) {
        found[i] = force[i] / size;
    }
}

static void force_axis(const void *const *context, const Given columns, number *found)
{
    (void)context;
    for (int lane = 0; lane < LANES; ++lane) {
        real own[ROTORS * BASE], axis[3];
        take_lane(columns, ROTORS * BASE, lane, own);
        force_axis_of_state(own, axis);
        put_lane(3, lane, axis, found);
    }
}
