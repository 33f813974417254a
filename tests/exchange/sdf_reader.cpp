// What libsdformat reads in an SDF file: links and joints, placed in the model, those of nested
// models by the names by which it refers to them; after another argument, such as -p, the file as
// it writes it. Models that are included are beside the file's folder. Complaints go to stderr.
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <sdf/sdf.hh>

static void print(const ignition::math::Vector3d &v) {
    std::printf(" %.17g %.17g %.17g", v.X(), v.Y(), v.Z());
}

static void print(const sdf::Model *model, const ignition::math::Pose3d &at, const std::string &scope) {
    for (uint64_t i = 0; i < model->LinkCount(); ++i) {
        const sdf::Link *link = model->LinkByIndex(i);
        ignition::math::Pose3d pose;
        link->SemanticPose().Resolve(pose, "__model__");
        pose = at * pose;
        const auto &inertial = link->Inertial();
        const auto turn = ignition::math::Matrix3d(pose.Rot());
        const auto moments = turn * inertial.Moi() * turn.Transposed();
        std::printf("link %s %.17g", (scope + link->Name()).c_str(), inertial.MassMatrix().Mass());
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
        std::printf("joint %s %.17g %.17g %.17g", (scope + joint->Name()).c_str(),
            joint->Axis()->Lower(), joint->Axis()->Upper(), joint->Axis()->Damping());
        print(at.Pos() + at.Rot().RotateVector(pose.Pos()));
        print(at.Rot().RotateVector(axis));
        std::printf("\n");
    }
    for (uint64_t i = 0; i < model->ModelCount(); ++i) {
        const sdf::Model *nested = model->ModelByIndex(i);
        ignition::math::Pose3d pose;
        nested->SemanticPose().Resolve(pose, "__model__");
        print(nested, at * pose, scope + nested->Name() + "::");
    }
}

int main(int argc, char **argv) {
    sdf::Root root;
    const auto folder = std::filesystem::absolute(argv[1]).parent_path();
    sdf::ParserConfig::GlobalConfig().AddURIPath("model://", folder.parent_path());
    const sdf::Errors errors = root.Load(argv[1]);
    for (const auto &error : errors) std::fprintf(stderr, "%s\n", error.Message().c_str());
    const sdf::Model *model = root.Model();
    const sdf::World *world = root.WorldCount() ? root.WorldByIndex(0) : nullptr;
    for (uint64_t i = 0; world && i < world->ModelCount(); ++i)
        if (!world->ModelByIndex(i)->Static()) model = world->ModelByIndex(i);
    if (!errors.empty() || !model) return 1;
    if (argc > 2) std::cout << root.Element()->ToString("");
    else print(model, {}, "");
    return 0;
}
