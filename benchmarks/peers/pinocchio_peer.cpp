// Pinocchio's algorithms behind the interface of the benchmark.

// Pinocchio's variant of joints is longer than Boost's default lists.
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_MPL_LIMIT_LIST_SIZE 30

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include "pinocchio_model.hpp"

// Leaves the mass matrix's upper triangle and the nonlinear effects in Pinocchio's own memory.
// The convention is each algorithm's faster one on this family.
EXPORT void pinocchio_mass_matrix_and_effects(const double *q, const double *v, const double *,
                                              double *, double *)
{
    const Input configuration(q, model->nq), velocity(v, model->nv);
    pinocchio::crba(*model, *data, configuration, pinocchio::Convention::LOCAL);
    pinocchio::nonLinearEffects(*model, *data, configuration, velocity);
}

EXPORT void pinocchio_fetch_mass_matrix_and_effects(double *first, double *second)
{
    Eigen::Map<Eigen::MatrixXd> matrix(first, model->nv, model->nv);
    matrix = data->M.selfadjointView<Eigen::Upper>();
    Output(second, model->nv) = data->nle;
}

// Leaves the accelerations in Pinocchio's own memory.
EXPORT void pinocchio_forward_dynamics(const double *q, const double *v, const double *tau,
                                       double *, double *)
{
    pinocchio::aba(*model, *data, Input(q, model->nq), Input(v, model->nv),
                   Input(tau, model->nv), pinocchio::Convention::WORLD);
}

EXPORT void pinocchio_fetch_accelerations(double *first, double *)
{
    Output(first, model->nv) = data->ddq;
}
