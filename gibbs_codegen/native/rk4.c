/*
 * A controlled flight in fixed steps of Runge and Kutta's classical method, many steps a call.
 *
 * The functions of an emitted C module are given by their addresses, so one compiled loop serves
 * every robot. The state is q, v, the work of the inputs, and the thrusts where the motors lag.
 * What takes more than arithmetic, thrusts that meet a limit, is left to the caller, step by step.
 */

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { BASE = 6, POWERS = 6 };
enum { DONE = 0, LIMIT = 1 };

typedef void Forward(const void *, const double *, const double *, const double *, double *);
typedef void Inverse(const void *, const double *, const double *, const double *, double *);
typedef void Inputs(const void *, const double *, double *);

typedef struct {
    Forward *forward_dynamics;
    Inverse *inverse_dynamics;
    Inputs *input_matrix;
    const void *constants;
    ptrdiff_t coordinates;
    ptrdiff_t rotors;
    ptrdiff_t pieces;
    int open_loop;
    int limited;
    double least;
    double most;
    double lag;
    double divergence;
    double singular_cosine;
    double begin;                /* of the first piece of the reference */
    double piece;                /* length of a piece */
    const double *coefficients;  /* [pieces][6][coordinates] */
    const double *stiffness;     /* [coordinates] */
    const double *damping;       /* [coordinates] */
    const double *distribution;  /* [rotors][6]: thrusts of a wrench */
    double *scratch;             /* 16 × (2 × coordinates + 1 + rotors) + coordinates × inputs */
} Flight;

/* Desired coordinates, rates and accelerations, one after the other. */
static void reference(const Flight *f, double time, double *out)
{
    const ptrdiff_t n = f->coordinates;
    const double last = (double)f->pieces * f->piece;
    double since = time - f->begin;
    since = since < 0.0 ? 0.0 : since > last ? last : since;
    ptrdiff_t k = (ptrdiff_t)(since / f->piece);
    k = k < f->pieces ? k : f->pieces - 1;
    const double s = since - (double)k * f->piece;
    const double *c = f->coefficients + k * POWERS * n;
    for (ptrdiff_t i = 0; i < n; ++i) {
        const double c1 = c[n + i], c2 = c[2 * n + i], c3 = c[3 * n + i];
        const double c4 = c[4 * n + i], c5 = c[5 * n + i];
        out[i] = c[i] + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
        out[n + i] = c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5))));
        out[2 * n + i] = 2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * (20.0 * c5)));
    }
}

/* Solve A x = b by elimination with row pivots; A is overwritten, b becomes x. */
static void solve(double a[BASE][BASE], double b[BASE])
{
    for (int k = 0; k < BASE; ++k) {
        int pivot = k;
        for (int i = k + 1; i < BASE; ++i) {
            pivot = fabs(a[i][k]) > fabs(a[pivot][k]) ? i : pivot;
        }
        for (int j = 0; j < BASE; ++j) {
            const double t = a[k][j];
            a[k][j] = a[pivot][j];
            a[pivot][j] = t;
        }
        const double t = b[k];
        b[k] = b[pivot];
        b[pivot] = t;
        const double inverse = 1.0 / a[k][k];
        for (int i = k + 1; i < BASE; ++i) {
            const double factor = a[i][k] * inverse;
            for (int j = k + 1; j < BASE; ++j) {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for (int k = BASE - 1; k >= 0; --k) {
        for (int j = k + 1; j < BASE; ++j) {
            b[k] -= a[k][j] * b[j];
        }
        b[k] /= a[k][k];
    }
}

/* Row of attitude or position in the coordinates. */
static ptrdiff_t base_row(const Flight *f, int i)
{
    return i < 3 ? i : f->coordinates - BASE + i;
}

/*
 * Inputs of a generalised force: the joints' own entries, and thrusts for the rest. `distribution`
 * turns a wrench into thrusts; which wrench a generalised force is, G w = force, is told by the
 * generalised forces of those thrusts, G = W distribution with W the thrusts' part of B.
 */
static void allocate(const Flight *f, const double *matrix, const double *force, double *inputs)
{
    const ptrdiff_t joints = f->coordinates - BASE;
    const ptrdiff_t width = f->rotors + joints;
    double g[BASE][BASE], wrench[BASE];
    for (int i = 0; i < BASE; ++i) {
        const double *row = matrix + base_row(f, i) * width;
        wrench[i] = force[base_row(f, i)];
        for (int j = 0; j < BASE; ++j) {
            g[i][j] = 0.0;
        }
        for (ptrdiff_t k = 0; k < f->rotors; ++k) {
            for (int j = 0; j < BASE; ++j) {
                g[i][j] += row[k] * f->distribution[k * BASE + j];
            }
        }
    }
    solve(g, wrench);
    for (ptrdiff_t k = 0; k < f->rotors; ++k) {
        inputs[k] = 0.0;
        for (int j = 0; j < BASE; ++j) {
            inputs[k] += f->distribution[k * BASE + j] * wrench[j];
        }
    }
    for (ptrdiff_t k = 0; k < joints; ++k) {
        inputs[f->rotors + k] = force[3 + k];
    }
}

/*
 * Time derivative of a state. `wanted` is the reference at its time, `matrix` and `work` are room
 * for the input matrix and for three vectors. Returns LIMIT where a thrust meets one.
 */
static int derivative(const Flight *f, const double *wanted, const double *state, double *rate,
                      double *matrix, double *work)
{
    const ptrdiff_t n = f->coordinates, inputs = f->rotors + n - BASE;
    const double *q = state, *v = state + n, *thrusts = state + 2 * n + 1;
    double *force = work, *commanded = work + n, *acceleration = work + n + inputs;
    int status = DONE;
    for (ptrdiff_t i = 0; i < n; ++i) {
        acceleration[i] = wanted[2 * n + i];
        if (!f->open_loop) {
            acceleration[i] += f->damping[i] * (wanted[n + i] - v[i]) +
                               f->stiffness[i] * (wanted[i] - q[i]);
        }
    }
    if (f->open_loop) {
        f->inverse_dynamics(f->constants, wanted, wanted + n, acceleration, force);
        f->input_matrix(f->constants, wanted, matrix);
        allocate(f, matrix, force, commanded);
        f->input_matrix(f->constants, q, matrix);
    } else {
        f->inverse_dynamics(f->constants, q, v, acceleration, force);
        f->input_matrix(f->constants, q, matrix);
        allocate(f, matrix, force, commanded);
    }
    for (ptrdiff_t k = 0; k < f->rotors; ++k) {
        if (f->limited && !(commanded[k] >= f->least && commanded[k] <= f->most)) {
            status = LIMIT;
        }
        if (f->lag > 0.0) {
            rate[2 * n + 1 + k] = (commanded[k] - thrusts[k]) / f->lag;
            commanded[k] = thrusts[k];
        }
    }
    memcpy(rate, v, (size_t)n * sizeof *rate);
    f->forward_dynamics(f->constants, q, v, commanded, rate + n);
    double power = 0.0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        double effort = 0.0;
        for (ptrdiff_t k = 0; k < inputs; ++k) {
            effort += matrix[i * inputs + k] * commanded[k];
        }
        power += effort * v[i];
    }
    rate[2 * n] = power;
    return status;
}

/* Whether a flight can go on: finite, near what is wanted, and away from the singularity. */
static int goes_on(const Flight *f, const double *wanted, const double *state, ptrdiff_t size)
{
    double sum = 0.0;
    for (ptrdiff_t i = 0; i < size; ++i) {
        sum += fabs(state[i]);
    }
    if (!isfinite(sum)) {
        return 0;
    }
    for (ptrdiff_t i = 0; i < f->coordinates; ++i) {
        if (fabs(state[i] - wanted[i]) > f->divergence) {
            return 0;
        }
    }
    return fabs(cos(state[1])) >= f->singular_cosine;
}

/*
 * Take up to `count` steps of `step` from `state` at `time`; every `every`-th step, counted from
 * `number`, is a sample. Returns the steps taken; `state` is the last one, and `samples` has room
 * for count / every + 1 states. Ends before a step in which a thrust meets a limit, and after one
 * from which the flight cannot go on.
 */
ptrdiff_t gibbs_codegen_rk4(const Flight *flight, double time, double step, ptrdiff_t count,
                            ptrdiff_t every, ptrdiff_t number, double *state, double *samples);

ptrdiff_t gibbs_codegen_rk4(const Flight *flight, double time, double step, ptrdiff_t count,
                            ptrdiff_t every, ptrdiff_t number, double *state, double *samples)
{
    static const double ahead[4] = {0.0, 0.5, 0.5, 1.0};
    static const double weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    const Flight f = *flight;
    const ptrdiff_t n = f.coordinates, inputs = f.rotors + n - BASE;
    const ptrdiff_t size = 2 * n + 1 + (f.lag > 0.0 ? f.rotors : 0);
    double *rate = f.scratch, *stage = rate + size, *sum = stage + size;
    double *now = sum + size, *middle = now + 3 * n, *then = middle + 3 * n;
    double *matrix = then + 3 * n, *work = matrix + n * inputs;
    reference(&f, time, now);
    for (ptrdiff_t done = 0; done < count; ++done) {
        const double at = time + step * (double)done;
        double *const wanted[4] = {now, middle, middle, then};
        reference(&f, at + 0.5 * step, middle);
        reference(&f, time + step * (double)(done + 1), then);
        memcpy(sum, state, (size_t)size * sizeof *sum);
        memcpy(stage, state, (size_t)size * sizeof *stage);
        for (int k = 0; k < 4; ++k) {
            if (k > 0) {
                for (ptrdiff_t i = 0; i < size; ++i) {
                    stage[i] = state[i] + step * ahead[k] * rate[i];
                }
            }
            if (derivative(&f, wanted[k], stage, rate, matrix, work) == LIMIT) {
                return done;
            }
            for (ptrdiff_t i = 0; i < size; ++i) {
                sum[i] += step * weight[k] * rate[i];
            }
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
