// The model that Pinocchio's algorithms compute, held by the library, and how it is loaded.

#include <memory>
#include <string>
#include <vector>

#include <pinocchio/multibody.hpp>

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

// Roots, in the order of their numbers.
enum Root { FIXED, FREE_FLYER, ANGLES };

static pinocchio::JointIndex add_base(int root)
{
    const auto here = pinocchio::SE3::Identity();
    if (root == FIXED)
        return 0;
    if (root == FREE_FLYER)
        return model->addJoint(0, pinocchio::JointModelFreeFlyer(), here, "base");
    auto joint = model->addJoint(0, pinocchio::JointModelTranslation(), here, "position");
    joint = model->addJoint(joint, pinocchio::JointModelRX(), here, "theta_m1");
    joint = model->addJoint(joint, pinocchio::JointModelRY(), here, "theta_0");
    return model->addJoint(joint, pinocchio::JointModelRZ(), here, "theta_1");
}

// Builds the model from its bodies, base first, on the ground, a free-flyer, or on translation, RX,
// RY, RZ.
EXPORT void pinocchio_load(const Body *bodies, long count, double gravity, int root)
{
    model = std::make_unique<pinocchio::Model>();
    model->gravity.linear() = Eigen::Vector3d(0, 0, -gravity);
    std::vector<pinocchio::JointIndex> joints{add_base(root)};
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
