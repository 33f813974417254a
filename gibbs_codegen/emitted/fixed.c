/* Fly a leg in equal steps, which `engine.c` takes, until `flow` says why not. */
static void fly_leg(
    const void *const *given, Flow *flow, const Leg *leg, double *x, const Kept *kept)
{
    const int left = leg->count - flow->done, before = leg->number + flow->done;
    const double time = flow->done ? before * leg->step : leg->begin;
    Progress progress = {{1}, {0}, {0}};
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
    }
}
