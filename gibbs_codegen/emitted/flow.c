/*
 * What is told of a flight of one state from leg to leg, through each of which the same acts on the
 * robot, in steps of one kind: `adaptive.c` or `fixed.c` flies a leg, `flight.c` all.
 * `runtime/program_flow.py` has the same structures.
 */
/* Why a call returns. */
enum { GOES_ON, REFUSED, ENDED, TOO_SHORT, TOO_SLOW };

typedef struct {
    double begin, end; /* s */
    double step;       /* equal steps, s: */
    int count, every;  /* so many, of which each `every`-th is a sample, */
    int number;        /* where so many came before */
    int samples;       /* of the law at its begin */
    int command;       /* the number of the one that acts, of those of the law that are held */
} Leg;

typedef struct {
    double time;        /* where the state is, s */
    double step;        /* the size of the next step, s */
    double taken;       /* that of the last one */
    double budget;      /* evaluations that may still be spent, */
    double income;      /* for each second flown, */
    double extra;       /* for each leg, which begins with a step of its own, */
    double most;        /* and how many can be saved up */
    double begin;       /* of the desired motion, s, */
    double piece;       /* and its pieces, s; 0 if none is followed */
    double relative[2]; /* tolerances where all is smooth, and where it is not */
    double absolute[2];
    const double *scale; /* that of absolute ones [STATE] */
    int patience; /* knots at which steps are to end, after one across a knot failed */
    int stops;    /* how many of them are to come */
    int smooth;   /* whether rates have no kinks: 0 never, 1 always, 2 while inputs are inside */
    int steps;    /* how many a call takes at most */
    int wanted;   /* how many states there are to keep, */
    int samples;  /* and afterwards how many were */
    int leg;      /* the number of the leg on which the state is, */
    int legs;     /* of so many, */
    int done;     /* with so many steps */
    int begun;    /* whether its begin is over */
    int sampled;  /* samples of the law that were taken */
    int reason;
    int halvings; /* of an equal step that is its last, down to where it ends */
} Flow;

/* Where a call leaves what it finds, with room for as much as comes. */
typedef struct {
    const double *times; /* of the samples to come, s */
    double *samples;     /* of the state [samples][STATE] */
    double *ranges;      /* of the inputs from sample to sample [samples + 1][2][RANGED] */
    double *begins;      /* states at the begin of legs [legs][STATE], NULL if nobody asks */
} Kept;

/* The time derivative of a state, no numbers where it has none. Returns whether it is refused. */
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
