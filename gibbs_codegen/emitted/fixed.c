/* Fly a leg in equal steps of `engine.c`, until `flow` holds a reason to stop. */
static void fly_leg(
    const void *const *given, Flow *flow, const Leg *leg, double *x, const Kept *kept)
{
    const int whole = leg->count - flow->done, before = leg->number + flow->done;
    const int left = flow->halvings && whole ? 1 : whole;
    const double time = flow->done ? before * leg->step : leg->begin;
    double first[STATE], after[STATE], good = 0.0;
    Progress progress = {{1}, {0}, {0}};
    memcpy(first, x, sizeof first);
    program_run(given, time, leg->step, left < flow->steps ? left : flow->steps, leg->every, before,
        x, kept->samples + flow->samples * STATE, kept->ranges + 2 * flow->samples * RANGED,
        &progress);
    flow->samples += (before + progress.taken[0]) / leg->every - before / leg->every;
    flow->steps -= progress.taken[0];
    flow->done += progress.taken[0];
    const double reached = (leg->number + flow->done) * leg->step;
    flow->time = flow->done == leg->count || reached > leg->end ? leg->end : reached;
    if (progress.refused[0]) {
        flow->time = flow->done ? reached : leg->begin;
        flow->reason = REFUSED;
    } else if (!progress.going[0]) {
        flow->reason = ENDED;
        flow->samples -= flow->halvings && (before + 1) % leg->every == 0;
    }
    double half = flow->reason == ENDED ? 0.5 * leg->step : 0.0;
    for (int halved = 0; halved < flow->halvings && half > 0.0; ++halved, half *= 0.5) {
        Progress part = {{1}, {0}, {0}};
        memcpy(after, first, sizeof after);
        program_run(given, time, good + half, 1, 2, 0, after, NULL, NULL, &part);
        if (part.going[0] || part.refused[0]) {
            good += half;
        } else {
            flow->time = time + (good + half);
            memcpy(x, after, sizeof after);
        }
    }
}
