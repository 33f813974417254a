/* Times one contender: the same call over many states, its result always to the same place.
   The clock is that of the thread, so that time given to other processes does not count. */
#include <time.h>

typedef void (*contender)(const double *q, const double *v, const double *tau, double *first,
                          double *second);

static double now_in_nanoseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

/* Nanoseconds per call. State k of an input starts at k times its stride, in doubles. */
__attribute__((visibility("default")))
double time_calls(contender call, long calls, long states, const double *q, long q_stride,
                  const double *v, long v_stride, const double *tau, long tau_stride,
                  double *first, double *second)
{
    const double start = now_in_nanoseconds();
    long state = 0;
    for (long i = 0; i < calls; ++i) {
        call(q + state * q_stride, v + state * v_stride, tau + state * tau_stride, first, second);
        if (++state == states)
            state = 0;
    }
    return (now_in_nanoseconds() - start) / (double)calls;
}
