/*
 * A controlled flight in fixed steps of Runge and Kutta's classical method, many steps a call.
 *
 * The functions of an emitted C module are given by their addresses, so one compiled loop serves
 * every robot. The state is q, v, the work of the inputs and of the push less what damping takes,
 * and the thrusts where the motors lag. A quaternion may have any length. What takes more than
 * arithmetic, inputs that meet a limit, is left to the caller, step by step.
 */

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { BASE = 6, POWERS = 6 };
enum { DONE = 0, LIMIT = 1 };
enum { COMPUTED_TORQUE = 0, OPEN_LOOP = 1, OFF = 2 };

typedef void Forward(const void *, const double *, const double *, const double *, double *);
typedef void Inverse(const void *, const double *, const double *, const double *, double *);
typedef void Matrix(const void *, const double *, double *);
typedef void Pushed(const void *, const double *, const double *, const double *, const double *,
                    double *);
typedef void Forces(const void *, const double *, const double *, double *);

typedef struct {
    Forward *forward_dynamics;
    Inverse *inverse_dynamics;
    Matrix *input_matrix;
    Pushed *forward_dynamics_with_wrenches;
    Forces *wrench_forces;
    const void *constants;
    ptrdiff_t coordinates;
    ptrdiff_t velocities;
    ptrdiff_t rotors;
    ptrdiff_t attitude;          /* places in the velocities: where the attitude's begin, */
    ptrdiff_t joints;            /* where the joints' begin, */
    ptrdiff_t position;          /* and where the position's begin */
    ptrdiff_t middle_angle;      /* place of the angle that has a singularity; -1: quaternion, */
    ptrdiff_t quaternion;        /* place in the coordinates where that begins, */
    ptrdiff_t placed;            /* and where the position begins */
    ptrdiff_t pieces;
    int law;
    int limited;
    int lags;
    const double *least;         /* [rotors + joints]: limits of the inputs */
    const double *most;
    const double *lag;           /* [rotors]: time constants of the motors, 0 for none */
    const double *wrenches;      /* [frames][6] of the push; NULL where it does not act */
    const double *bounds;        /* [2][velocities]: errors beyond which control is lost */
    double largest_theta_0;      /* beyond it angles are singular */
    double begin;                /* of the first piece of the reference */
    double piece;                /* length of a piece */
    const double *coefficients;  /* [pieces][6][coordinates] */
    const double *stiffness;     /* [velocities] */
    const double *damping;       /* [velocities] */
    const double *losses;        /* [velocities]: damping of the robot itself */
    const double *distribution;  /* [rotors][6]: thrusts of a force and a torque on the base */
    double *scratch;             /* [gibbs_codegen_rk4_room] */
} Loop;

/* Length of the state. */
static ptrdiff_t size_of(const Loop *f)
{
    return f->coordinates + f->velocities + 1 + (f->lags ? f->rotors : 0);
}

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(ptrdiff_t n, const double *a, const double *b)
{
    double sum = 0.0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* The vector x in the world, of a base with the unit quaternion p; back into the base by -1. */
static void turn(const double *p, double sign, const double *x, double *out)
{
    double once[3], twice[3];
    cross(p, x, once);
    cross(p, once, twice);
    for (int i = 0; i < 3; ++i) {
        out[i] = x[i] + 2.0 * (sign * p[3] * once[i] + twice[i]);
    }
}

/* The product of the conjugate of p and of r. */
static void between(const double *p, const double *r, double *out)
{
    double carried[3];
    cross(p, r, carried);
    for (int i = 0; i < 3; ++i) {
        out[i] = p[3] * r[i] - r[3] * p[i] - carried[i];
    }
    out[3] = dot(4, p, r);
}

/* Make the quaternion of coordinates one of unit length. */
static void normalise(const Loop *f, double *q)
{
    double *p = q + f->quaternion;
    const double length = sqrt(dot(4, p, p));
    for (int i = 0; i < 4; ++i) {
        p[i] /= length;
    }
}

/* Rates of coordinates, of which `unit` has the quaternion of length 1; it keeps its length. */
static void rates_of(const Loop *f, const double *q, const double *unit, const double *v,
                     double *rate)
{
    const double *p = q + f->quaternion, *spin = v + f->attitude;
    double *growth = rate + f->quaternion;
    turn(unit + f->quaternion, 1.0, v + f->position, rate + f->placed);
    cross(p, spin, growth);
    for (int i = 0; i < 3; ++i) {
        growth[i] = 0.5 * (growth[i] + p[3] * spin[i]);
    }
    growth[3] = -0.5 * dot(3, p, spin);
    memcpy(rate + f->joints + 1, v + f->joints,
           (size_t)(f->velocities - BASE) * sizeof *rate);
}

/*
 * In place of coordinates and their first two derivatives, the coordinates with a quaternion of
 * unit length, velocities and accelerations. With c = r p, where p is of unit length,
 * conj(c) c' = r r' + r^2 spin / 2.
 */
static void quasi_velocities(const Loop *f, double *out)
{
    const ptrdiff_t n = f->coordinates, m = f->velocities;
    const size_t joints = (size_t)(m - BASE) * sizeof *out;
    const double *c = out + f->quaternion;
    const double square = dot(4, c, c), stretching = dot(4, c, c + n) / square;
    double spin[4], growth[4], linear[3], rate[3], carried[3];
    between(c, c + n, spin);
    between(c, c + 2 * n, growth);
    for (int i = 0; i < 3; ++i) {
        spin[i] *= 2.0 / square;
        growth[i] = growth[i] * (2.0 / square) - 2.0 * stretching * spin[i];
    }
    normalise(f, out);
    turn(c, -1.0, out + n + f->placed, linear);
    turn(c, -1.0, out + 2 * n + f->placed, rate);
    cross(spin, linear, carried);
    memmove(out + n + f->joints, out + n + f->joints + 1, joints);
    memmove(out + n + m + f->joints, out + 2 * n + f->joints + 1, joints);
    for (int i = 0; i < 3; ++i) {
        out[n + f->attitude + i] = spin[i];
        out[n + f->position + i] = linear[i];
        out[n + m + f->attitude + i] = growth[i];
        out[n + m + f->position + i] = rate[i] - carried[i];
    }
}

/* Desired coordinates, velocities and accelerations, one after the other. */
static void reference(const Loop *f, double time, double *restrict out)
{
    const ptrdiff_t n = f->coordinates;
    const double last = (double)f->pieces * f->piece;
    double since = time - f->begin;
    since = since < 0.0 ? 0.0 : since > last ? last : since;
    ptrdiff_t k = (ptrdiff_t)(since / f->piece);
    k = k < f->pieces ? k : f->pieces - 1;
    const double s = since - (double)k * f->piece;
    const double *restrict c = f->coefficients + k * POWERS * n;
    for (ptrdiff_t i = 0; i < n; ++i) {
        const double c1 = c[n + i], c2 = c[2 * n + i], c3 = c[3 * n + i];
        const double c4 = c[4 * n + i], c5 = c[5 * n + i];
        out[i] = c[i] + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
        out[n + i] = c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5))));
        out[2 * n + i] = 2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * (20.0 * c5)));
    }
    if (f->middle_angle < 0) {
        quasi_velocities(f, out);
    }
}

/*
 * Errors of a state, then their rates: with angles, differences. With a quaternion those of the
 * position are in world axes; that of the attitude is the rotation vector in the base's frame.
 */
static void errors_of(const Loop *f, const double *wanted, const double *q, const double *v,
                      double *off)
{
    const ptrdiff_t n = f->coordinates, m = f->velocities;
    const ptrdiff_t shift = n - m; /* of the joints, past a quaternion */
    double *rate = off + m;
    for (ptrdiff_t i = 0; i < m; ++i) {
        off[i] = wanted[i + shift] - q[i + shift];
        rate[i] = wanted[n + i] - v[i];
    }
    if (f->middle_angle >= 0) {
        return;
    }
    const double *p = q + f->quaternion, *r = wanted + f->quaternion;
    double turned[4], spin[3], here[3], there[3];
    between(p, r, turned);
    const double sine = sqrt(dot(3, turned, turned)), cosine = fabs(turned[3]);
    const double half = sine > 0.0 ? atan2(sine, cosine) / sine : 1.0 / cosine;
    turn(r, 1.0, wanted + n + f->attitude, there);
    turn(p, -1.0, there, spin);
    turn(p, 1.0, v + f->position, here);
    turn(r, 1.0, wanted + n + f->position, there);
    for (int i = 0; i < 3; ++i) {
        off[f->attitude + i] = copysign(2.0 * half, turned[3]) * turned[i];
        off[f->position + i] = wanted[f->placed + i] - q[f->placed + i];
        rate[f->attitude + i] = spin[i] - v[f->attitude + i];
        rate[f->position + i] = there[i] - here[i];
    }
}

/* Of a base with a quaternion, accelerations in which the base would move in the world as wanted
 * but for `pull`, which is what control makes of the errors. */
static void carried_over(const Loop *f, const double *wanted, const double *q, const double *v,
                         const double *pull, double *out)
{
    const ptrdiff_t n = f->coordinates, m = f->velocities;
    const double *p = q + f->quaternion, *r = wanted + f->quaternion;
    const double *turning = wanted + n + f->attitude, *spin = v + f->attitude;
    double swept[3], world[3], rate[3], there[3], here[3];
    cross(turning, wanted + n + f->position, swept);
    for (int i = 0; i < 3; ++i) {
        swept[i] += wanted[n + m + f->position + i];
    }
    turn(r, 1.0, swept, world);
    for (int i = 0; i < 3; ++i) {
        world[i] += pull[f->position + i];
    }
    turn(p, -1.0, world, out + f->position);
    cross(spin, v + f->position, swept);
    turn(r, 1.0, wanted + n + m + f->attitude, world);
    turn(p, -1.0, world, rate);
    turn(r, 1.0, turning, there);
    turn(p, -1.0, there, here);
    cross(spin, here, there);
    for (int i = 0; i < 3; ++i) {
        out[f->position + i] -= swept[i];
        out[f->attitude + i] = rate[i] - there[i] + pull[f->attitude + i];
    }
}

/* Desired accelerations, corrected by the errors of a state; `off` is room for those. */
static void corrected(const Loop *f, const double *wanted, const double *q, const double *v,
                      double *off, double *restrict out)
{
    const ptrdiff_t n = f->coordinates, m = f->velocities;
    errors_of(f, wanted, q, v, off);
    for (ptrdiff_t i = 0; i < m; ++i) {
        out[i] = wanted[n + m + i] + f->damping[i] * off[m + i] + f->stiffness[i] * off[i];
    }
    if (f->middle_angle < 0) {
        for (ptrdiff_t i = 0; i < m; ++i) {
            off[i] = f->stiffness[i] * off[i] + f->damping[i] * off[m + i];
        }
        carried_over(f, wanted, q, v, off, out);
    }
}

/* Solve A x = b for three unknowns by Cramer's rule, A row by row. */
static void solve(const double *a, const double *b, double *x)
{
    double first[3], second[3], third[3];
    cross(a + 3, a + 6, first);
    cross(a + 6, a, second);
    cross(a, a + 3, third);
    const double scale = 1.0 / (a[0] * first[0] + a[1] * first[1] + a[2] * first[2]);
    for (int j = 0; j < 3; ++j) {
        x[j] = scale * (first[j] * b[0] + second[j] * b[1] + third[j] * b[2]);
    }
}

/*
 * Inputs of a generalised force: the joints' own entries, and thrusts for the rest. `distribution`
 * tells the thrusts of a force and a torque on the base; which force and torque it takes is told by
 * what such thrusts do to position and attitude. Position is moved by the force alone, so that is
 * found first, and the torque then makes what the force leaves of the attitude's entries.
 */
static void allocate(const Loop *f, const double *matrix, const double *wanted, double *inputs)
{
    const ptrdiff_t joints = f->velocities - BASE, width = f->rotors + joints;
    const double *attitude = matrix + f->attitude * width;
    const double *position = matrix + f->position * width;
    double pushed[9] = {0.0}, turned[9] = {0.0}, force[3], torque[3];
    double left[3];
    memcpy(left, wanted + f->attitude, sizeof left);
    for (ptrdiff_t k = 0; k < f->rotors; ++k) {
        const double *share = f->distribution + k * BASE;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                pushed[3 * i + j] += position[i * width + k] * share[j];
                turned[3 * i + j] += attitude[i * width + k] * share[3 + j];
            }
        }
    }
    solve(pushed, wanted + f->position, force);
    for (ptrdiff_t k = 0; k < f->rotors; ++k) {
        const double *share = f->distribution + k * BASE;
        inputs[k] = share[0] * force[0] + share[1] * force[1] + share[2] * force[2];
        for (int i = 0; i < 3; ++i) {
            left[i] -= attitude[i * width + k] * inputs[k];
        }
    }
    solve(turned, left, torque);
    for (ptrdiff_t k = 0; k < f->rotors; ++k) {
        const double *share = f->distribution + k * BASE + 3;
        inputs[k] += share[0] * torque[0] + share[1] * torque[1] + share[2] * torque[2];
    }
    memcpy(inputs + f->rotors, wanted + f->joints, (size_t)joints * sizeof *inputs);
}

/* Power of inputs: thrusts act on attitude and position (the thrusts of rotors that joints move are
 * 0 here), joint torques on their own joints. */
static double power(const Loop *f, const double *matrix, const double *inputs, const double *v)
{
    const ptrdiff_t joints = f->velocities - BASE, width = f->rotors + joints;
    const double *attitude = matrix + f->attitude * width;
    const double *position = matrix + f->position * width;
    double sum = 0.0;
    for (ptrdiff_t k = 0; k < f->rotors; ++k) {
        double speed = 0.0;
        for (int i = 0; i < 3; ++i) {
            speed += attitude[i * width + k] * v[f->attitude + i] +
                     position[i * width + k] * v[f->position + i];
        }
        sum += speed * inputs[k];
    }
    for (ptrdiff_t k = 0; k < joints; ++k) {
        sum += v[f->joints + k] * inputs[f->rotors + k];
    }
    return sum;
}

/* Power that the damping of the robot itself takes. */
static double losses(const Loop *f, const double *v)
{
    double sum = 0.0;
    for (ptrdiff_t i = 0; i < f->velocities; ++i) {
        sum += f->losses[i] * v[i] * v[i];
    }
    return sum;
}

static int within_limits(const Loop *f, ptrdiff_t count, const double *inputs)
{
    for (ptrdiff_t k = 0; k < count; ++k) {
        if (!(inputs[k] >= f->least[k] && inputs[k] <= f->most[k])) {
            return 0;
        }
    }
    return 1;
}

/*
 * Time derivative of a state. `wanted` is the reference at its time; `matrix` is room for the input
 * matrix, `work` for four vectors of velocities, one of coordinates and one of inputs. Returns
 * LIMIT, without a rate, where an input meets one.
 */
static int derivative(const Loop *f, const double *wanted, const double *state, double *rate,
                      double *matrix, double *work)
{
    const ptrdiff_t n = f->coordinates, m = f->velocities, inputs = f->rotors + m - BASE;
    const double *v = state + n, *thrusts = state + n + m + 1;
    double *q = work, *off = q + n, *acceleration = off + 2 * m, *force = acceleration + m;
    double *commanded = force + m;
    memcpy(q, state, (size_t)n * sizeof *q);
    if (f->middle_angle < 0) {
        normalise(f, q);
    }
    if (f->law == OPEN_LOOP) {
        f->inverse_dynamics(f->constants, wanted, wanted + n, wanted + n + m, force);
        f->input_matrix(f->constants, wanted, matrix);
        allocate(f, matrix, force, commanded);
    }
    f->input_matrix(f->constants, q, matrix);
    if (f->law == COMPUTED_TORQUE) {
        corrected(f, wanted, q, v, off, acceleration);
        f->inverse_dynamics(f->constants, q, v, acceleration, force);
        allocate(f, matrix, force, commanded);
    } else if (f->law == OFF) {
        memset(commanded, 0, (size_t)inputs * sizeof *commanded);
    }
    if (f->limited && !within_limits(f, inputs, commanded)) {
        return LIMIT;
    }
    for (ptrdiff_t k = 0; f->lags && k < f->rotors; ++k) {
        rate[n + m + 1 + k] = 0.0;
        if (f->lag[k] > 0.0) {
            rate[n + m + 1 + k] = (commanded[k] - thrusts[k]) / f->lag[k];
            commanded[k] = thrusts[k];
        }
    }
    if (f->middle_angle < 0) {
        rates_of(f, state, q, v, rate);
    } else {
        memcpy(rate, v, (size_t)n * sizeof *rate);
    }
    rate[n + m] = power(f, matrix, commanded, v) - losses(f, v);
    if (f->wrenches) {
        f->forward_dynamics_with_wrenches(f->constants, q, v, commanded, f->wrenches, rate + n);
        f->wrench_forces(f->constants, q, f->wrenches, force);
        rate[n + m] += dot(m, force, v);
    } else {
        f->forward_dynamics(f->constants, q, v, commanded, rate + n);
    }
    return DONE;
}

/* Add a share of the slopes to `sum`, and go `ahead` along them from a state. */
static void advance(ptrdiff_t size, const double *restrict rate, double share, double *restrict sum,
                    const double *restrict state, double ahead, double *restrict stage)
{
    for (ptrdiff_t i = 0; i < size; ++i) {
        sum[i] += share * rate[i];
        stage[i] = state[i] + ahead * rate[i];
    }
}

/* Whether a flight can go on: finite, near what is wanted, and away from the singularity. `room` is
 * for coordinates and errors. */
static int goes_on(const Loop *f, const double *wanted, const double *state, ptrdiff_t size,
                   double *room)
{
    const ptrdiff_t n = f->coordinates;
    double *off = room + n;
    for (ptrdiff_t i = 0; i < size; ++i) {
        if (!isfinite(state[i])) {
            return 0;
        }
    }
    memcpy(room, state, (size_t)n * sizeof *room);
    if (f->middle_angle < 0) {
        normalise(f, room);
    }
    errors_of(f, wanted, room, state + n, off);
    for (ptrdiff_t i = 0; i < 2 * f->velocities; ++i) { /* errors, then their rates */
        if (fabs(off[i]) > f->bounds[i]) {
            return 0;
        }
    }
    return f->middle_angle < 0 || fabs(state[f->middle_angle]) <= f->largest_theta_0;
}

/* How many numbers `scratch` must hold; it is not looked at itself. */
ptrdiff_t gibbs_codegen_rk4_room(const Loop *loop);

ptrdiff_t gibbs_codegen_rk4_room(const Loop *loop)
{
    const ptrdiff_t n = loop->coordinates, m = loop->velocities;
    const ptrdiff_t inputs = loop->rotors + m - BASE;
    return 3 * size_of(loop) + 3 * (3 * n) + m * inputs + (n + 4 * m + inputs);
}

/*
 * Take up to `count` steps of `step` from `state` at `time`; every `every`-th step, counted from
 * `number`, is a sample. Returns the steps taken; `state` is the last one, and `samples` has room
 * for count / every + 1 states. Ends before a step in which an input meets a limit, and after one
 * from which the flight cannot go on.
 */
ptrdiff_t gibbs_codegen_rk4(const Loop *loop, double time, double step, ptrdiff_t count,
                            ptrdiff_t every, ptrdiff_t number, double *state, double *samples);

ptrdiff_t gibbs_codegen_rk4(const Loop *loop, double time, double step, ptrdiff_t count,
                            ptrdiff_t every, ptrdiff_t number, double *state, double *samples)
{
    static const double weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    static const double ahead[4] = {0.5, 0.5, 1.0, 0.0}; /* to where the next slopes are taken */
    const Loop f = *loop;
    const ptrdiff_t n = f.coordinates, m = f.velocities, inputs = f.rotors + m - BASE;
    const ptrdiff_t size = size_of(&f);
    double *rate = f.scratch, *stage = rate + size, *sum = stage + size;
    double *now = sum + size, *middle = now + 3 * n, *then = middle + 3 * n;
    double *matrix = then + 3 * n, *work = matrix + m * inputs;
    reference(&f, time, now);
    for (ptrdiff_t done = 0; done < count; ++done) {
        const double *const wanted[4] = {now, middle, middle, then};
        reference(&f, time + step * ((double)done + 0.5), middle);
        reference(&f, time + step * (double)(done + 1), then);
        memcpy(sum, state, (size_t)size * sizeof *sum);
        for (int k = 0; k < 4; ++k) {
            if (derivative(&f, wanted[k], k > 0 ? stage : state, rate, matrix, work) == LIMIT) {
                return done;
            }
            advance(size, rate, step * weight[k], sum, state, step * ahead[k], stage);
        }
        memcpy(state, sum, (size_t)size * sizeof *state);
        if ((number + done + 1) % every == 0) {
            memcpy(samples, state, (size_t)size * sizeof *samples);
            samples += size;
        }
        double *const swap = now;
        now = then;
        then = swap;
        if (!goes_on(&f, now, state, size, work)) {
            return done + 1;
        }
    }
    return count;
}
