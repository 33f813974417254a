/*
 * Steps of adaptive size of one state: the explicit method of order 8 of Dormand and Prince, whose
 * errors are estimated by orders 5 and 3, with dense output of order 7 (DOP853: Hairer, Norsett and
 * Wanner, Solving Ordinary Differential Equations I, section II.5 and table II.5.2).
 *
 * The text before defines `take_end` and includes `ranges.c` and `flow.c`.
 */
enum { STAGES = 12, ALL_STAGES = 16, POWERS_OF_PATH = 7 };
/* Number of knots that steps end at before a step across a knot is tried again. */
enum { MOST_STOPS = 64 };
/* Times of stages as shares of a step, which ends at the thirteenth; the others are for dense
 * output. */
static const double NODES[ALL_STAGES] = {
    0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726,
    0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0,
    1.0, 0.1, 0.2, 0.7777777777777778};

/* Weights of the earlier stages: one for the second stage, two for the third, and so on. */
static const double WEIGHTS[ALL_STAGES * (ALL_STAGES - 1) / 2] = {
    0.05260015195876773, 0.0197250569845379, 0.0591751709536137, 0.02958758547680685, 0,
    0.08876275643042054, 0.2413651341592667, 0, -0.8845494793282861, 0.924834003261792,
    0.037037037037037035, 0, 0, 0.17082860872947386, 0.12546768756682242, 0.037109375, 0, 0,
    0.17025221101954405, 0.06021653898045596, -0.017578125, 0.03709200011850479, 0, 0,
    0.17038392571223998, 0.10726203044637328, -0.015319437748624402, 0.008273789163814023,
    0.6241109587160757, 0, 0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
    20.154067550477894, -43.48988418106996, 0.47766253643826434, 0, 0, -2.4881146199716677,
    -0.590290826836843, 21.230051448181193, 15.279233632882423, -33.28821096898486,
    -0.020331201708508627, -0.9371424300859873, 0, 0, 5.186372428844064, 1.0914373489967295,
    -8.149787010746927, -18.52006565999696, 22.739487099350505, 2.4936055526796523,
    -3.0467644718982196, 2.273310147516538, 0, 0, -10.53449546673725, -2.0008720582248625,
    -17.9589318631188, 27.94888452941996, -2.8589982771350235, -8.87285693353063,
    12.360567175794303, 0.6433927460157636, 0.054293734116568765, 0, 0, 0, 0, 4.450312892752409,
    1.8915178993145003, -5.801203960010585, 0.3111643669578199, -0.1521609496625161,
    0.20136540080403034, 0.04471061572777259, 0.056167502283047954, 0, 0, 0, 0, 0,
    0.25350021021662483, -0.2462390374708025, -0.12419142326381637, 0.15329179827876568,
    0.00820105229563469, 0.007567897660545699, -0.008298, 0.03183464816350214, 0, 0, 0, 0,
    0.028300909672366776, 0.053541988307438566, -0.05492374857139099, 0, 0, -0.00010834732869724932,
    0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325, -0.42889630158379194, 0, 0,
    0, 0, -4.697621415361164, 7.683421196062599, 4.06898981839711, 0.3567271874552811, 0, 0, 0,
    -0.0013990241651590145, 2.9475147891527724, -9.15095847217987};

/* Weights of the error estimates of order 5 and of order 3. */
static const double ERRORS[2][STAGES] = {
    {0.01312004499419488, 0, 0, 0, 0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
    -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294},
    {-0.18980075407240762, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
    -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082}};

/* Weights of the last four coefficients of dense output. */
static const double PATHS[4][ALL_STAGES] = {
    {-8.428938276109013, 0, 0, 0, 0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207,
    2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688,
    -0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894},
    {10.427508642579134, 0, 0, 0, 0, 242.28349177525817, 165.20045171727028, -374.5467547226902,
    -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229,
    15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408},
    {19.985053242002433, 0, 0, 0, 0, -387.0373087493518, -189.17813819516758, 527.8081592054236,
    -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443,
    -2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279},
    {-25.69393346270375, 0, 0, 0, 0, -154.18974869023643, -231.5293791760455, 357.6391179106141,
    93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605, -43.53345659001114,
    96.32455395918828, -39.17726167561544, -149.72683625798564}};

typedef struct {
    const void *const *given;
    Flow *flow;
    const Leg *leg;
    const double *scale; /* absolute tolerances [STATE] */
    double before[STATE], after[STATE], stages[ALL_STAGES][STATE], path[POWERS_OF_PATH][STATE];
    double inside; /* above 0 if no input was at a limit in the last evaluation */
} Solver;

/* A stage of a step of `h` s. Returns whether it is refused. */
static int take_stage(Solver *s, const int stage, const double time, const double h)
{
    const double *const weights = WEIGHTS + stage * (stage - 1) / 2;
    double inputs[RANGED + 1];
    for (int i = 0; i < STATE; ++i) {
        double sum = 0.0;
        for (int j = 0; j < stage; ++j) {
            sum += weights[j] * s->stages[j][i];
        }
        s->after[i] = s->before[i] + h * sum;
    }
    s->flow->budget -= 1.0;
    return slope_at(s->given, time + NODES[stage] * h, s->after, s->stages[stage], inputs,
        &s->inside);
}

/* The estimated error of a step, divided by its tolerance. */
static double error_of(const Solver *s, const int rough, const double h)
{
    double squares[2] = {0.0, 0.0};
    for (int i = 0; i < STATE; ++i) {
        const double most = real_maximum(real_absolute(s->before[i]), real_absolute(s->after[i]));
        const double tolerance =
            s->flow->absolute[rough] * s->scale[i] + s->flow->relative[rough] * most;
        for (int order = 0; order < 2; ++order) {
            double error = 0.0;
            for (int j = 0; j < STAGES; ++j) {
                error += ERRORS[order][j] * s->stages[j][i];
            }
            squares[order] += (error / tolerance) * (error / tolerance);
        }
    }
    const double both = squares[0] + 0.01 * squares[1];
    return both <= 0.0 ? 0.0 : h * squares[0] / sqrt(both * STATE);
}

/* The first knot after a time: there the third derivatives of the desired motion jump. */
static double next_knot(const Flow *flow, const double time)
{
    if (flow->piece <= 0.0) {
        return INFINITY;
    }
    /* A time that differs from a knot only by rounding is at the knot. */
    const double pieces = floor((time - flow->begin) / flow->piece + 1e-6) + 1.0;
    return flow->begin + pieces * flow->piece;
}

/* Find a step within tolerance, and its size. Returns 0, or why there is none. */
static int find_step(Solver *s, const int rough, double *h)
{
    Flow *const flow = s->flow;
    const double least = 10.0 * (nextafter(flow->time, INFINITY) - flow->time);
    const double knot = next_knot(flow, flow->time);
    double most = 10.0;
    flow->step = flow->step > least ? flow->step : least;
    for (;; most = 1.0) {
        if (flow->step < least) {
            return TOO_SHORT;
        }
        double after = flow->time + flow->step;
        after = after < s->leg->end ? after : s->leg->end;
        after = flow->stops > 0 && after > knot ? knot : after;
        *h = after - flow->time;
        for (int stage = 1; stage <= STAGES; ++stage) {
            if (take_stage(s, stage, flow->time, *h)) {
                return REFUSED;
            }
        }
        const double error = error_of(s, rough, *h);
        /* If the error is NaN, the step shrinks as far as one attempt allows. */
        double factor = error > 0.0 ? 0.9 * pow(error, -0.125) : most;
        factor = factor < most ? factor : most;
        if (error < 1.0) {
            flow->step = *h * factor;
            flow->patience = after > knot ? 1 : flow->patience;
            flow->stops -= flow->stops > 0 && after >= knot;
            return 0;
        }
        if (after > knot) {
            flow->patience = flow->patience < MOST_STOPS ? 2 * flow->patience : MOST_STOPS;
            flow->stops = flow->patience;
            flow->step = knot - flow->time;
            continue;
        }
        flow->step = *h * (error > 0.0 && factor > 0.2 ? factor : 0.2);
    }
}

/* Compute dense output for a step of `h` s. Returns whether a stage is refused. */
static int find_path(Solver *s, const double h)
{
    double after[STATE];
    memcpy(after, s->after, sizeof after);
    for (int stage = STAGES + 1; stage < ALL_STAGES; ++stage) {
        if (take_stage(s, stage, s->flow->time, h)) {
            return 1;
        }
    }
    memcpy(s->after, after, sizeof after);
    for (int i = 0; i < STATE; ++i) {
        const double moved = after[i] - s->before[i];
        const double first = s->stages[0][i], last = s->stages[STAGES][i];
        s->path[0][i] = moved;
        s->path[1][i] = h * first - moved;
        s->path[2][i] = 2.0 * moved - h * (last + first);
        for (int k = 0; k < 4; ++k) {
            double sum = 0.0;
            for (int j = 0; j < ALL_STAGES; ++j) {
                sum += PATHS[k][j] * s->stages[j][i];
            }
            s->path[3 + k][i] = h * sum;
        }
    }
    return 0;
}

/* The state at a share of a step. */
static void state_on_path(const Solver *s, const double share, double *x)
{
    const double factors[2] = {share, (1.0 - share)};
    for (int i = 0; i < STATE; ++i) {
        double sum = 0.0;
        for (int k = POWERS_OF_PATH - 1; k >= 0; --k) {
            sum = (sum + s->path[k][i]) * factors[k % 2];
        }
        x[i] = s->before[i] + sum;
    }
}

/* Whether a flight cannot continue from a state; NaN counts as positive. */
static int ends_at(const Solver *s, const double time, const double *x)
{
    double ended;
    take_end(s->given, time, x, &ended);
    return !(ended <= 0.0);
}

/* The first share of a step, up to rounding, at which a flight cannot continue. */
static double first_end(const Solver *s, const double h)
{
    double x[STATE];
    double good = 0.0, bad = 1.0;
    for (int halved = 0; halved < 40; ++halved) {
        const double middle = 0.5 * (good + bad);
        state_on_path(s, middle, x);
        if (ends_at(s, s->flow->time + middle * h, x)) {
            bad = middle;
        } else {
            good = middle;
        }
    }
    return bad;
}

/* Keep samples of a step of `h` s up to a share of it, and inputs at each quarter of that part. */
static int keep(Solver *s, const double h, const double until, const double time, const int wanted,
    const Kept *kept)
{
    Flow *const flow = s->flow;
    double inputs[4][RANGED + 1], instants[4], point[STATE], unread;
    for (int k = 0; k < 4; ++k) {
        const double share = 0.25 * (k + 1) * until;
        state_on_path(s, share, point);
        instants[k] = flow->time + share * h;
        if (slope_at(s->given, instants[k], point, s->stages[1], inputs[k], &unread)) {
            return 1;
        }
        if (!(s->stages[1][0] - s->stages[1][0] <= 0.0)) {
            instants[k] = INFINITY;
        }
    }
    for (int k = 0; k < 4; ++k) {
        int next = flow->samples;
        while (next < wanted && kept->times[next] < instants[k]) {
            ++next;
        }
        if (instants[k] < (double)INFINITY) {
            widen(inputs[k], kept->ranges + 2 * next * RANGED);
        }
    }
    for (; flow->samples < wanted && kept->times[flow->samples] <= time; ++flow->samples) {
        const double share = (kept->times[flow->samples] - flow->time) / h;
        state_on_path(s, share, kept->samples + flow->samples * STATE);
    }
    return 0;
}

/* Fly a leg in steps of adaptive size, until `flow` holds a reason to stop. */
static void fly_leg(
    const void *const *given, Flow *flow, const Leg *leg, double *x, const Kept *kept)
{
    Solver solver, *const s = &solver;
    double unread[RANGED + 1];
    s->given = given;
    s->flow = flow;
    s->leg = leg;
    s->scale = flow->scale;
    s->inside = 1.0;
    if (flow->done == 0) {
        flow->patience = 1;
        flow->stops = 0;
        flow->budget += flow->extra;
        flow->budget = flow->budget < flow->most ? flow->budget : flow->most;
    }
    memcpy(s->before, x, sizeof s->before);
    flow->reason = slope_at(given, flow->time, x, s->stages[0], unread, &s->inside);
    flow->budget -= 1.0;
    for (; flow->steps > 0 && flow->time < leg->end && !flow->reason; --flow->steps) {
        const int rough = flow->smooth == 0 || (flow->smooth == 2 && !(s->inside > 0.0));
        double h;
        if ((flow->reason = find_step(s, rough, &h)) != 0) {
            break;
        }
        const double inside = s->inside, after = flow->time + h;
        double until = 1.0;
        if (find_path(s, h)) {
            flow->reason = REFUSED;
            break;
        }
        const int ended = ends_at(s, after, s->after);
        if (ended) {
            until = first_end(s, h);
        }
        const double time = until < 1.0 ? flow->time + until * h : after;
        if (keep(s, h, until, time, flow->wanted, kept)) {
            flow->reason = REFUSED;
            break;
        }
        if (until < 1.0) {
            state_on_path(s, until, s->after);
        }
        flow->taken = time - flow->time;
        flow->time = time;
        ++flow->done;
        flow->budget += flow->taken * flow->income;
        flow->budget = flow->budget < flow->most ? flow->budget : flow->most;
        flow->reason = ended ? ENDED : flow->budget < 0.0 ? TOO_SLOW : GOES_ON;
        memcpy(s->before, s->after, sizeof s->before);
        memcpy(s->stages[0], s->stages[STAGES], sizeof s->stages[0]);
        s->inside = inside;
    }
    memcpy(x, s->before, sizeof s->before);
}
