// Pinocchio's algorithms behind the interface of the benchmark, on one model held by the library.

// Pinocchio's variant of joints is longer than Boost's default lists.
#define BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS
#define BOOST_MPL_LIMIT_LIST_SIZE 30

#include <memory>
#include <string>
#include <vector>

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#define EXPORT extern "C" __attribute__((visibility("default")))

using Rows3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Input = Eigen::Map<const Eigen::VectorXd>;
using Output = Eigen::Map<Eigen::VectorXd>;

static std::unique_ptr<pinocchio::Model> model;
static std::unique_ptr<pinocchio::Data> data;

// Numbers of a body: parent, turn (9), step (3), mass, com (3), inertia about it (9); matrices by
// rows.
struct Body {
    double parent, turn[9], step[3], mass, com[3], inertia[9];
};

static pinocchio::SE3 placement(const Body &body)
{
    const Eigen::Matrix3d turn = Eigen::Map<const Rows3>(body.turn);
    return {turn, Eigen::Vector3d(body.step)};
}

static pinocchio::Inertia inertia(const Body &body)
{
    const Eigen::Matrix3d about_com = Eigen::Map<const Rows3>(body.inertia);
    return {body.mass, Eigen::Vector3d(body.com), about_com};
}

static pinocchio::JointIndex add_base(bool free_flyer)
{
    const auto here = pinocchio::SE3::Identity();
    if (free_flyer)
        return model->addJoint(0, pinocchio::JointModelFreeFlyer(), here, "base");
    auto joint = model->addJoint(0, pinocchio::JointModelTranslation(), here, "position");
    joint = model->addJoint(joint, pinocchio::JointModelRX(), here, "theta_m1");
    joint = model->addJoint(joint, pinocchio::JointModelRY(), here, "theta_0");
    return model->addJoint(joint, pinocchio::JointModelRZ(), here, "theta_1");
}

// Builds the model from its bodies, base first, on a free-flyer or on translation, RX, RY, RZ.
EXPORT void pinocchio_load(const Body *bodies, long count, double gravity, int free_flyer)
{
    model = std::make_unique<pinocchio::Model>();
    model->gravity.linear() = Eigen::Vector3d(0, 0, -gravity);
    std::vector<pinocchio::JointIndex> joints{add_base(free_flyer != 0)};
    model->appendBodyToJoint(joints[0], inertia(bodies[0]));
    for (long i = 1; i < count; ++i) {
        const auto parent = joints[(std::size_t)bodies[i].parent];
        const auto name = "arm_" + std::to_string(i);
        joints.push_back(
            model->addJoint(parent, pinocchio::JointModelRZ(), placement(bodies[i]), name));
        model->appendBodyToJoint(joints.back(), inertia(bodies[i]));
    }
    data = std::make_unique<pinocchio::Data>(*model);
}

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
