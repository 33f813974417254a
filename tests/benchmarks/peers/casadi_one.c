/* The C that CasADi wrote, behind the interface of the benchmark: one state a call. */
#define CASADI_SYMBOL_EXPORT static /* the compiler then sees that no pointer is null */
#include GENERATED

#define EXPORT __attribute__((visibility("default")))

EXPORT void casadi_mass_matrix_and_effects(const double *restrict q, const double *restrict v,
                                           const double *restrict tau, double *restrict first,
                                           double *restrict second)
{
    (void)tau;
    const double *arguments[] = {q, v};
    double *results[] = {first, second};
    mass_matrix_and_effects(arguments, results, 0, 0, 0);
}

EXPORT void casadi_forward_dynamics(const double *restrict q, const double *restrict v,
                                    const double *restrict tau, double *restrict first,
                                    double *restrict second)
{
    (void)second;
    const double *arguments[] = {q, v, tau};
    double *results[] = {first};
    forward_dynamics(arguments, results, 0, 0, 0);
}
