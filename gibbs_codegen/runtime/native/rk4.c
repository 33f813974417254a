/*
 * A controlled flight in fixed steps of Runge and Kutta's classical method, many steps a call.
 *
 * The functions of an emitted C module are given by their addresses, so one compiled loop serves
 * every robot. The state is q, v, the work of the inputs and of the push on the tip, and the
 * thrusts where the motors lag. What takes more than arithmetic, thrusts that meet a limit, is left
 * to the caller, step by step.
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

typedef struct {
    Forward *forward_dynamics;
    Inverse *inverse_dynamics;
    Matrix *input_matrix;
    Matrix *mass_matrix;
    Matrix *tip_jacobian;        /* [6][coordinates], of which the upper half is linear */
    const void *constants;
    ptrdiff_t coordinates;
    ptrdiff_t rotors;
    ptrdiff_t attitude;          /* places in the coordinates: where the attitude begins, */
    ptrdiff_t joints;            /* where the joints begin, */
    ptrdiff_t position;          /* where the position begins, */
    ptrdiff_t middle_angle;      /* and the attitude angle that has a singularity */
    ptrdiff_t pieces;
    int law;
    int limited;
    int pushed;
    double least;
    double most;
    double lag;
    double push[3];              /* force on the tip, world axes */
    const double *bounds;        /* [2][coordinates]: errors beyond which control is lost */
    double largest_theta_0;      /* beyond it angles are singular */
    double begin;                /* of the first piece of the reference */
    double piece;                /* length of a piece */
    const double *coefficients;  /* [pieces][6][coordinates] */
    const double *stiffness;     /* [coordinates] */
    const double *damping;       /* [coordinates] */
    const double *distribution;  /* [rotors][6]: thrusts of a force and a torque on the base */
    double *scratch;             /* [gibbs_codegen_rk4_room] */
} Loop;

/* Length of the state. */
static ptrdiff_t size_of(const Loop *f)
{
    return 2 * f->coordinates + 1 + (f->lag > 0.0 ? f->rotors : 0);
}

/* Desired coordinates, rates and accelerations, one after the other. */
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
}

/* Desired accelerations, corrected by the errors of a state. */
static void corrected(const Loop *f, const double *restrict wanted, const double *restrict state,
                      double *restrict out)
{
    const ptrdiff_t n = f->coordinates;
    for (ptrdiff_t i = 0; i < n; ++i) {
        out[i] = wanted[2 * n + i] + f->damping[i] * (wanted[n + i] - state[n + i]) +
                 f->stiffness[i] * (wanted[i] - state[i]);
    }
}

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
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
    const ptrdiff_t joints = f->coordinates - BASE, width = f->rotors + joints;
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

/* Power of inputs: thrusts act on attitude and position, joint torques on their own joints. */
static double power(const Loop *f, const double *matrix, const double *inputs, const double *v)
{
    const ptrdiff_t joints = f->coordinates - BASE, width = f->rotors + joints;
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

static int within_limits(const Loop *f, const double *thrusts)
{
    for (ptrdiff_t k = 0; k < f->rotors; ++k) {
        if (!(thrusts[k] >= f->least && thrusts[k] <= f->most)) {
            return 0;
        }
    }
    return 1;
}

/* Solve A x = b in place of b, by A = L D Lᵀ; A is symmetric, positive definite, and used up. */
static void solve_symmetric(ptrdiff_t n, double *restrict a, double *restrict b)
{
    for (ptrdiff_t j = 0; j < n; ++j) {
        const double scale = 1.0 / a[j * n + j];
        for (ptrdiff_t i = j + 1; i < n; ++i) {
            const double share = a[i * n + j] * scale;
            /* Column j holds L D, since the rows below need it so. */
            for (ptrdiff_t k = j + 1; k <= i; ++k) {
                a[i * n + k] -= share * a[k * n + j];
            }
            b[i] -= share * b[j];
        }
    }
    for (ptrdiff_t j = n - 1; j >= 0; --j) {
        for (ptrdiff_t i = j + 1; i < n; ++i) {
            b[j] -= a[i * n + j] * b[i];
        }
        b[j] /= a[j * n + j];
    }
}

/*
 * Add what the push on the tip does to the rate of a state: to accelerations and to power. `room`
 * is for the Jacobian, the mass matrix and a generalised force.
 */
static void push(const Loop *f, const double *q, const double *v, double *rate, double *room)
{
    const ptrdiff_t n = f->coordinates;
    double *jacobian = room, *mass = jacobian + BASE * n, *force = mass + n * n;
    f->tip_jacobian(f->constants, q, jacobian);
    f->mass_matrix(f->constants, q, mass);
    for (ptrdiff_t i = 0; i < n; ++i) {
        force[i] = f->push[0] * jacobian[i] + f->push[1] * jacobian[n + i] +
                   f->push[2] * jacobian[2 * n + i];
        rate[2 * n] += force[i] * v[i];
    }
    solve_symmetric(n, mass, force);
    for (ptrdiff_t i = 0; i < n; ++i) {
        rate[n + i] += force[i];
    }
}

/*
 * Time derivative of a state. `wanted` is the reference at its time; `matrix` is room for the input
 * matrix, `work` for two vectors of coordinates, one of inputs, and what `push` takes where the tip
 * is pushed. Returns LIMIT, without a rate, where a thrust meets one.
 */
static int derivative(const Loop *f, const double *wanted, const double *state, double *rate,
                      double *matrix, double *work)
{
    const ptrdiff_t n = f->coordinates, inputs = f->rotors + n - BASE;
    const double *q = state, *v = state + n, *thrusts = state + 2 * n + 1;
    double *acceleration = work, *force = acceleration + n, *commanded = force + n;
    if (f->law == OPEN_LOOP) {
        f->inverse_dynamics(f->constants, wanted, wanted + n, wanted + 2 * n, force);
        f->input_matrix(f->constants, wanted, matrix);
        allocate(f, matrix, force, commanded);
    }
    f->input_matrix(f->constants, q, matrix);
    if (f->law == COMPUTED_TORQUE) {
        corrected(f, wanted, state, acceleration);
        f->inverse_dynamics(f->constants, q, v, acceleration, force);
        allocate(f, matrix, force, commanded);
    } else if (f->law == OFF) {
        memset(commanded, 0, (size_t)inputs * sizeof *commanded);
    }
    if (f->limited && !within_limits(f, commanded)) {
        return LIMIT;
    }
    if (f->lag > 0.0) {
        for (ptrdiff_t k = 0; k < f->rotors; ++k) {
            rate[2 * n + 1 + k] = (commanded[k] - thrusts[k]) / f->lag;
            commanded[k] = thrusts[k];
        }
    }
    memcpy(rate, v, (size_t)n * sizeof *rate);
    f->forward_dynamics(f->constants, q, v, commanded, rate + n);
    rate[2 * n] = power(f, matrix, commanded, v);
    if (f->pushed) {
        push(f, q, v, rate, commanded + inputs);
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

/* Whether a flight can go on: finite, near what is wanted, and away from the singularity. */
static int goes_on(const Loop *f, const double *wanted, const double *state, ptrdiff_t size)
{
    for (ptrdiff_t i = 0; i < size; ++i) {
        if (!isfinite(state[i])) {
            return 0;
        }
    }
    for (ptrdiff_t i = 0; i < 2 * f->coordinates; ++i) { /* coordinates, then rates */
        if (fabs(state[i] - wanted[i]) > f->bounds[i]) {
            return 0;
        }
    }
    return fabs(state[f->middle_angle]) <= f->largest_theta_0;
}

/* How many numbers `scratch` must hold; it is not looked at itself. */
ptrdiff_t gibbs_codegen_rk4_room(const Loop *loop);

ptrdiff_t gibbs_codegen_rk4_room(const Loop *loop)
{
    const ptrdiff_t n = loop->coordinates, inputs = loop->rotors + n - BASE;
    const ptrdiff_t pushing = loop->pushed ? BASE * n + n * n + n : 0;
    return 3 * size_of(loop) + 3 * (3 * n) + n * inputs + (2 * n + inputs) + pushing;
}

/*
 * Take up to `count` steps of `step` from `state` at `time`; every `every`-th step, counted from
 * `number`, is a sample. Returns the steps taken; `state` is the last one, and `samples` has room
 * for count / every + 1 states. Ends before a step in which a thrust meets a limit, and after one
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
    const ptrdiff_t n = f.coordinates, inputs = f.rotors + n - BASE, size = size_of(&f);
    double *rate = f.scratch, *stage = rate + size, *sum = stage + size;
    double *now = sum + size, *middle = now + 3 * n, *then = middle + 3 * n;
    double *matrix = then + 3 * n, *work = matrix + n * inputs;
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
        if (!goes_on(&f, now, state, size)) {
            return done + 1;
        }
    }
    return count;
}
