// Pinocchio's derivatives behind the interface of the benchmark.

// Pinocchio's variant of joints is longer than Boost's default lists.
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_MPL_LIMIT_LIST_SIZE 30
// Steps of the derivatives take more arguments than Boost's default.
#define BOOST_FUSION_INVOKE_MAX_ARITY 10

#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>

#include "pinocchio_model.hpp"

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A vector and three matrices, one after the other, of which the last is symmetric and known by its
// upper triangle.
template <typename Vector, typename Matrix, typename Symmetric>
static void put(double *first, const Vector &value, const Matrix &by_configuration,
                const Matrix &by_velocity, const Symmetric &last)
{
    const auto size = model->nv;
    Output(first, size) = value;
    Eigen::Map<Rows>(first += size, size, size) = by_configuration;
    Eigen::Map<Rows>(first += size * size, size, size) = by_velocity;
    Eigen::Map<Rows>(first += size * size, size, size) =
        last.template selfadjointView<Eigen::Upper>();
}

// Leaves forces, their derivatives and the mass matrix in Pinocchio's own memory.
EXPORT void pinocchio_inverse_dynamics_derivatives(const double *q, const double *v,
                                                   const double *a, double *, double *)
{
    pinocchio::computeRNEADerivatives(*model, *data, Input(q, model->nq), Input(v, model->nv),
                                      Input(a, model->nv));
}

EXPORT void pinocchio_fetch_inverse_dynamics_derivatives(double *first, double *)
{
    put(first, data->tau, data->dtau_dq, data->dtau_dv, data->M);
}

// Leaves accelerations, their derivatives and the inverse of the mass matrix there.
EXPORT void pinocchio_forward_dynamics_derivatives(const double *q, const double *v,
                                                   const double *tau, double *, double *)
{
    pinocchio::computeABADerivatives(*model, *data, Input(q, model->nq), Input(v, model->nv),
                                     Input(tau, model->nv));
}

EXPORT void pinocchio_fetch_forward_dynamics_derivatives(double *first, double *)
{
    put(first, data->ddq, data->ddq_dq, data->ddq_dv, data->Minv);
}
