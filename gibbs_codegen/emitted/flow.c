/*
 * Structures of a flight of one state from leg to leg. During a leg the same things act on the
 * robot, and steps are of one kind. `adaptive.c` or `fixed.c` flies a leg, `flight.c` all legs.
 * `runtime/program_flow.py` has the same structures.
 */
/* Why a call returns. */
enum { GOES_ON, REFUSED, ENDED, TOO_SHORT, TOO_SLOW };

typedef struct {
    double begin, end; /* s */
    double step;       /* equal steps, s: */
    int count, every;  /* their number; each `every`-th is a sample, */
    int number;        /* counted from so many before */
    int samples;       /* of the law at its start */
    int command;       /* number of the held command that acts */
} Leg;

typedef struct {
    double time;        /* where the state is, s */
    double step;        /* the size of the next step, s */
    double taken;       /* that of the last one */
    double budget;      /* evaluations left, */
    double income;      /* added for each second flown, */
    double extra;       /* added for each leg, which begins with a new step, */
    double most;        /* and the most that can be saved up */
    double begin;       /* of the desired motion, s, */
    double piece;       /* and its pieces, s; 0 if none is followed */
    double relative[2]; /* tolerances where rates are smooth, and where they are not */
    double absolute[2];
    const double *scale; /* absolute tolerances [STATE] */
    int patience; /* knots at which steps end after a step across a knot failed */
    int stops;    /* how many of them are left */
    int smooth;   /* whether rates have no kinks: 0 never, 1 always, 2 while inputs are inside */
    int steps;    /* the most steps of a call */
    int wanted;   /* number of states to keep, */
    int samples;  /* and on return of those kept */
    int leg;      /* number of the current leg, */
    int legs;     /* of so many, */
    int done;     /* and its steps */
    int begun;    /* whether its start is over */
    int sampled;  /* number of samples taken of the law */
    int reason;
    int halvings; /* of the last equal step, to find where it ends */
} Flow;

/* Results of a call; the caller provides the room. */
typedef struct {
    const double *times; /* times of the samples, s */
    double *samples;     /* states [samples][STATE] */
    double *ranges;      /* ranges of inputs between samples [samples + 1][2][RANGED] */
    double *begins;      /* states at the starts of legs [legs][STATE], or NULL */
} Kept;

/* The time derivative of a state, NaN if it has none. Returns whether it is refused. */
static int slope_at(const void *const *given, const double time, const double *x, double *rate,
    double *inputs, double *inside)
{
    double refused = 0.0, sum = 0.0;
    for (int i = 0; i < STATE; ++i) {
        sum += x[i] - x[i];
    }
    if (!(sum <= 0.0)) {
        for (int i = 0; i < STATE; ++i) {
            rate[i] = sum;
        }
        return 0;
    }
    take_slope(given, time, x, rate, &refused, inputs, inside);
    return refused > 0.0;
}

void flow_slope(const void *const *given, const double time, const double *x, double *rate,
    int *refused);

void flow_slope(const void *const *given, const double time, const double *x, double *rate,
    int *refused)
{
    double inputs[RANGED + 1], inside;
    *refused = slope_at(given, time, x, rate, inputs, &inside);
}
