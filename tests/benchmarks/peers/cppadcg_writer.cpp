// Writes C of Pinocchio's derivatives, traced by CppADCodeGen, for the model that the library holds.

// Pinocchio's variant of joints is longer than Boost's default lists.
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_MPL_LIMIT_LIST_SIZE 30
// Steps of the derivatives take more arguments than Boost's default.
#define BOOST_FUSION_INVOKE_MAX_ARITY 10

#include <fstream>

#include <pinocchio/codegen/cppadcg.hpp>

#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>

#include "pinocchio_model.hpp"

using Traced = CppAD::cg::CG<double>;
using Scalar = CppAD::AD<Traced>;
using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
using Rows = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A vector and three matrices, one after the other, the last known by its upper triangle.
static Vector joined(const Vector &value, const Matrix &by_configuration, const Matrix &by_velocity,
                     const Matrix &last)
{
    const auto size = value.size();
    Vector found(size + 3 * size * size);
    found.head(size) = value;
    Scalar *place = found.data() + size;
    Eigen::Map<Rows>(place, size, size) = by_configuration;
    Eigen::Map<Rows>(place + size * size, size, size) = by_velocity;
    Eigen::Map<Rows>(place + 2 * size * size, size, size) =
        last.selfadjointView<Eigen::Upper>();
    return found;
}

template <typename Compute>
static void write(std::ofstream &file, const char *name, const Compute &compute)
{
    const auto traced_model = model->cast<Scalar>();
    pinocchio::DataTpl<Scalar> traced_data(traced_model);
    const auto nq = model->nq, nv = model->nv;
    Vector x = Vector::Zero(nq + 2 * nv);
    x.head(nq) = pinocchio::neutral(*model).cast<Scalar>();
    CppAD::Independent(x);
    const Vector q = x.head(nq), v = x.segment(nq, nv), last = x.tail(nv);
    Vector y = compute(traced_model, traced_data, q, v, last);
    CppAD::ADFun<Traced> function(x, y);
    function.optimize("no_compare_op");

    CppAD::cg::CodeHandler<double> handler;
    std::vector<Traced> inputs((std::size_t)x.size());
    handler.makeVariables(inputs);
    auto outputs = function.Forward(0, inputs);
    CppAD::cg::LanguageC<double> language("double");
    CppAD::cg::LangCDefaultVariableNameGenerator<double> names;
    std::ostringstream body;
    handler.generateCode(body, language, outputs, names);
    file << "static void " << name << "(const double *restrict x, double *restrict y)\n{\n"
         << "double v[" << handler.getTemporaryVariableCount() + 1 << "];\n"
         << body.str() << "}\n";
}

EXPORT void cppadcg_write(const char *path)
{
    std::ofstream file(path);
    write(file, "inverse_dynamics_derivatives",
          [](const auto &model, auto &data, const Vector &q, const Vector &v, const Vector &a) {
              pinocchio::computeRNEADerivatives(model, data, q, v, a);
              return joined(data.tau, data.dtau_dq, data.dtau_dv, data.M);
          });
    write(file, "forward_dynamics_derivatives",
          [](const auto &model, auto &data, const Vector &q, const Vector &v, const Vector &tau) {
              pinocchio::computeABADerivatives(model, data, q, v, tau);
              return joined(data.ddq, data.ddq_dq, data.ddq_dv, data.Minv);
          });
}
