/* The C that CasADi wrote, behind the interface of the benchmark: one state a call. FUNCTIONS is
   GLUE(name) for each of its functions; what a function does not take or give is not looked at. */
#define CASADI_SYMBOL_EXPORT static /* the compiler then sees that no pointer is null */
#include GENERATED

#define GLUE(name)                                                                              \
    __attribute__((visibility("default")))                                                      \
    void casadi_##name(const double *restrict q, const double *restrict v,                      \
                       const double *restrict tau, double *restrict first,                      \
                       double *restrict second)                                                 \
    {                                                                                           \
        const double *arguments[] = {q, v, tau};                                                \
        double *results[] = {first, second};                                                    \
        name(arguments, results, 0, 0, 0);                                                      \
    }

FUNCTIONS
