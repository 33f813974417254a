// What libsdformat reads in an SDF file: links and joints, placed in the model. Complaints go to
// stderr.
#include <cstdio>
#include <sdf/sdf.hh>

static void print(const ignition::math::Vector3d &v) {
    std::printf(" %.17g %.17g %.17g", v.X(), v.Y(), v.Z());
}

int main(int, char **argv) {
    sdf::Root root;
    const sdf::Errors errors = root.Load(argv[1]);
    for (const auto &error : errors) std::fprintf(stderr, "%s\n", error.Message().c_str());
    const sdf::Model *model = root.Model();
    const sdf::World *world = root.WorldCount() ? root.WorldByIndex(0) : nullptr;
    for (uint64_t i = 0; world && i < world->ModelCount(); ++i)
        if (!world->ModelByIndex(i)->Static()) model = world->ModelByIndex(i);
    if (!errors.empty() || !model) return 1;
    for (uint64_t i = 0; i < model->LinkCount(); ++i) {
        const sdf::Link *link = model->LinkByIndex(i);
        ignition::math::Pose3d pose;
        link->SemanticPose().Resolve(pose, "__model__");
        const auto &inertial = link->Inertial();
        const auto turn = ignition::math::Matrix3d(pose.Rot());
        const auto moments = turn * inertial.Moi() * turn.Transposed();
        std::printf("link %s %.17g", link->Name().c_str(), inertial.MassMatrix().Mass());
        print(pose.Pos() + pose.Rot().RotateVector(inertial.Pose().Pos()));
        for (int row = 0; row < 3; ++row)
            print({moments(row, 0), moments(row, 1), moments(row, 2)});
        print(pose.Pos());
        print(pose.Rot().RotateVector({0, 0, 1}));
        std::printf("\n");
    }
    for (uint64_t i = 0; i < model->JointCount(); ++i) {
        const sdf::Joint *joint = model->JointByIndex(i);
        if (!joint->Axis()) continue;
        ignition::math::Pose3d pose;
        ignition::math::Vector3d axis;
        joint->SemanticPose().Resolve(pose, "__model__");
        joint->Axis()->ResolveXyz(axis, "__model__");
        std::printf("joint %s %.17g %.17g %.17g", joint->Name().c_str(), joint->Axis()->Lower(),
            joint->Axis()->Upper(), joint->Axis()->Damping());
        print(pose.Pos());
        print(axis);
        std::printf("\n");
    }
    return 0;
}
