"""From a robot to the text of a file in another format."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange import sources
from gibbs_codegen.exchange.autopilots import ardupilot_text, px4_text
from gibbs_codegen.exchange.motors import motors_of
from gibbs_codegen.exchange.sdf_text import sdf_text
from gibbs_codegen.exchange.urdf import is_rotor_by_name
from gibbs_codegen.exchange.xml_text import mjcf_text, urdf_text
from gibbs_codegen.robot.layout import check_free_base, frames_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import default_prefix, joint_name, link_label
from gibbs_codegen.robot.parts.base import LEVEL_MOTIONS, TRAVELS, TURNS
from gibbs_codegen.robot.parts.body import as_rigid_body
from gibbs_codegen.robot.parts.constraint import LoopJoint
from gibbs_codegen.robot.parts.numbers import AXES, BASE
from gibbs_codegen.robot.parts.part import taken
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.placement import arm_pose, base_centre, joint_pose, motor_seat

Format = Literal["urdf", "mjcf", "sdf", "px4", "ardupilot"]
# Names of files by the robot's. PX4 numbers airframes; users have those from 22000.
FILES: dict[Format, str] = {
    **{"urdf": "{}.urdf", "mjcf": "{}.xml", "sdf": "{}.sdf"},
    **{"px4": "22000_{}", "ardupilot": "{}.param"},
}
# Effects on joints for which formats have no place.
_NO_PLACE: dict[Format, tuple[str, ...]] = {
    "urdf": ("armature", "stiffness"),
    "mjcf": (),
    "sdf": ("armature",),
}


def export_robot(robot: Robot, form: Format) -> tuple[str, list[str]]:
    """Text of a robot in another format, and lines on what this has no place for or cannot name."""
    if form in ("px4", "ardupilot"):
        check_free_base(robot.name, robot.base.kind, "parameters of autopilots are")
        return px4_text(robot) if form == "px4" else ardupilot_text(robot)
    source = source_of(robot)
    missing, joints = [], []
    for joint in source.joints:
        link, limits, servo = joint.link, joint.link.limits, joint.link.servo
        lost = [key for key in _NO_PLACE[form] if getattr(link.passive, key)]
        if form == "mjcf":
            lost += [] if limits.velocity is None else ["velocity"]
            if (limits.low is None) != (limits.high is None):
                lost.append("limits, of which the format has only one")
        if form == "sdf" and servo:
            keys = [key for key in _NONIDEALITIES if key in servo.parameters()]
            lost += [f"{key} of its servo" for key in keys if getattr(servo, key)]
        elif servo:
            lost.append("servo, except its greatest torque" + " and rate" * (form == "urdf"))
        if link.friction and link.friction.static != link.friction.coulomb:
            lost.append("static friction")
        if link.motor and form == "mjcf":
            lost.append("the reaction of its motor's rotor on the parent link")
            reflected = link.motor.gear_ratio**2 * link.motor.rotor_inertia
            passive = replace(link.passive, armature=link.passive.armature + reflected)
            joint = replace(joint, link=replace(link, passive=passive))
        if form != "mjcf" and joint.gear and len(joint.gear.ratios) > 1:
            lost.append(f"that it follows {joint.gear.words}")
            joint = replace(joint, gear=None)
        joints.append(joint)
        if joint.kind != "fixed" and lost:
            missing.append(f"joint {joint.name}: {' and '.join(lost)}")
    for i in robot.constrained:
        missing.append(
            f"{link_label(robot, i)}: the constraint torque that holds it; the link is welded "
            "instead"
        )
    # What makes thrusts and torques of commands: these are the inputs of what is written, but in
    # SDF, which has elements for motors.
    kinds = {"thrust curves of the rotors": "has_drive", "air on rotors": "feels_air"}
    for role, key in kinds.items():
        rotors = [rotor.name for rotor in source.rotors if getattr(rotor, key)]
        if rotors and form != "sdf":
            missing.append(f"{role}: {', '.join(rotors)}")
    written = [loop.name for loop in source.constraints if form == "mjcf"]
    for kind, ties in robot.by_kind.items():
        if lost := [tie.name for tie in ties if tie.name not in written]:
            missing.append(f"{kind}: {', '.join(lost)}")
    slow = [rotor.name for rotor in source.rotors if rotor.time_constant and form == "urdf"]
    others = {
        "the battery": robot.battery,
        "the rolling of wheels and of a base with a drive, without side slip": robot.base.drive
        or robot.wheels,
        "spin inertias of rotors": any(rotor.spin_inertia for rotor in robot.thrusters),
        f"time constants of {', '.join(slow)}": slow,
        f"gravity of {source.gravity:g} m/s²": form != "mjcf" and source.gravity != 9.81,
    }
    missing += [part for part, there in others.items() if there]
    source, renamed = with_free_names(replace(source, joints=tuple(joints)), form)
    lines = [*(f"left out: {line}" for line in missing), *renamed]
    if (motion := robot.base.motion) in LEVEL_MOTIONS and (moved := robot.base.moved):
        words = f"as joints {', '.join(moved)}, with rates along axes of the world"
        lines.append(f"motion {motion}: {words}; import --base {motion} gives it back")
    if form == "sdf":
        motors, notes = motors_of(source, robot.gravity * robot.total_mass)
        return sdf_text(source, motors), [*lines, *notes]
    return (urdf_text(source) if form == "urdf" else mjcf_text(source)), lines


# Keys of servos that controllers of Gazebo do not have.
_NONIDEALITIES = ("rate", "delay", "backlash")


def with_free_names(source: sources.Source, form: Format) -> tuple[sources.Source, list[str]]:
    """The same robot with names that a file can hold, and a line for each that is changed.

    In URDF frames are links and rotors are joints in the file. In SDF all names are of one space.
    """
    is_urdf, shared = form == "urdf", form == "sdf"
    # MuJoCo has a body of that name already, for SDF it is the world, and in URDF a link is that.
    has_world = not is_urdf or sources.WORLD in source.links
    joints, links = sources.FreeNames(), sources.FreeNames(["world"] if has_world else ())
    if shared:
        joints = links
    rotors, frames = (joints, links)
    if form == "mjcf":
        rotors, frames = sources.FreeNames(), sources.FreeNames()
    lines: list[str] = []

    def free(names: sources.FreeNames, kind: str, name: str, wanted: str | None = None) -> str:
        plain = name
        if shared:  # There `::` goes between names of models, and `__…__` are reserved.
            plain = name.replace("::", "_").strip("_" if name.startswith("__") else "") or kind
            plain = f"{plain}_{kind}" if plain in names else plain
        label = names.free(wanted or plain)
        if label != name:
            lines.append(f"renamed: {kind} {printable(name, 60)} is {label}")
        return label

    moved = {j.child: free(joints, "joint", j.name) for j in source.joints if j.kind != "fixed"}
    placed = [replace(r, name=free(rotors, "rotor", r.name)) for r in source.rotors]
    # The mounts of fixed joints, which a robot does not name, take what names are left.
    mounts = {j.child: j.name for j in source.joints if j.kind == "fixed"}
    if not shared:
        moved |= {child: joints.free(name) for child, name in mounts.items()}
    # What a reader would take for a rotor of JSK is called otherwise.
    named = {
        link: free(links, "link", link, f"{link}_" if is_urdf and is_rotor else None)
        for link in source.links
        if link != sources.WORLD
        for is_rotor in [is_rotor_by_name(moved.get(link, ""), link)]
    }
    ends = {sources.WORLD: "world"} | named
    seats = [
        replace(f, name=free(frames, "frame", f.name), link=named[f.link])
        for f in source.frames
        if not (is_urdf and f.link == f.name and f.pose.is_identity)
    ]
    if shared:
        moved |= {child: joints.free(name) for child, name in mounts.items()}

    movers = {joint.name: moved[joint.child] for joint in source.joints}

    def placed_in(end: sources.SourceFrame) -> sources.SourceFrame:
        return replace(end, name=frames.free(end.name), link=named.get(end.link, sources.WORLD))

    return (
        replace(
            source,
            links={ends[n]: replace(link, name=ends[n]) for n, link in source.links.items()},
            root=ends[source.root],
            joints=tuple(
                replace(
                    j,
                    name=moved[j.child],
                    parent=ends[j.parent],
                    child=named[j.child],
                    gear=j.gear and j.gear.renamed(movers),
                )
                for j in source.joints
            ),
            rotors=tuple(replace(rotor, link=named[rotor.link]) for rotor in placed),
            frames=tuple(seats),
            constraints=tuple(
                replace(loop, ends=(placed_in(loop.ends[0]), placed_in(loop.ends[1])))
                for loop in source.constraints
            ),
        ),
        lines,
    )


_BASE = "base"


def source_of(robot: Robot) -> sources.Source:
    """The links and joints of a robot, as of a file.

    The root is a link "base", whose frame is at the point whose position is x, y, z; or, where the
    base does not move freely, the world, with a joint for each part of its motion.
    """
    centre = Pose(vector(base_centre(robot.base)))
    names, base = [_BASE], robot.base
    names += [link.name or default_prefix("link", i) for i, link in enumerate(robot.links, start=1)]
    rods = sources.FreeNames(names)
    links: dict[str, sources.SourceBody] = {}
    joints: list[sources.SourceJoint] = []
    if not base.moves_freely:
        carrier, place = sources.WORLD, Pose(base.pose.xyz)
        links[carrier] = sources.SourceBody(carrier)
        for part in base.moved:
            moved = replace(sources.IDLE_LINK, axis=AXES["xyz"[(TRAVELS | TURNS)[part]]])
            kind: sources.JointKind = "prismatic" if part in TRAVELS else "revolute"
            virtual = rods.free(f"{_BASE}_{part}")
            links[virtual] = sources.SourceBody(virtual)
            joints.append(sources.SourceJoint(part, kind, carrier, virtual, place, moved))
            carrier, place = virtual, HERE
        mount = place @ Pose(rpy_deg=base.pose.rpy_deg)
        joints.append(sources.SourceJoint(f"{_BASE}_mount", "fixed", carrier, _BASE, mount))
    links[_BASE] = sources.SourceBody(_BASE)
    if base.body:
        links[_BASE] = sources.SourceBody(_BASE, base.body, centre)
    rotors: list[sources.SourceRotor] = []
    for k in range(1, base.rotors + 1):
        rod, mount = rods.free(f"arm{k}"), centre @ arm_pose(base, k)
        rotors.append(
            sources.SourceRotor(
                name=f"rotor{k}",
                link=rod,
                position=motor_seat(base, k),
                direction=base.thrust[k - 1],
                drag=base.drag[k - 1],
            )
        )
        links[rod] = sources.SourceBody(rod, as_rigid_body(base.arm(k)))
        joints.append(sources.SourceJoint(f"{rod}_mount", "fixed", _BASE, rod, mount))
    labels = [_BASE] + [
        link.coordinate or link.name or joint_name(link.joint, robot.rotors + i)
        for i, link in enumerate(robot.links, start=1)
    ]
    for i, link in enumerate(robot.links, start=1):
        links[names[i]] = sources.SourceBody(names[i], as_rigid_body(link.body))
        pose, parent = joint_pose(robot, i), robot.parents[i - 1]
        gear = link.gear
        joints.append(
            sources.SourceJoint(
                labels[i],
                link.joint,
                names[parent],
                names[i],
                centre @ pose if parent == BASE else pose,
                replace(link, limits=link.drive_limits),
                gear=sources.SourceGear(gear.ratios, gear.offset).renamed(labels) if gear else None,
                driven=link.moves and not gear,
            )
        )
    for k, rotor in enumerate(robot.thrusters, start=1):
        on_base = rotor.on == BASE
        changes = {
            "name": rotor.name or default_prefix("rotor", k),
            "position": vector(centre.point(rotor.position)) if on_base else rotor.position,
            "limits": rotor.drive.thrust_limits,
            "time_constant": rotor.drive.up or None,
        }
        keys = vars(taken(Rotor, rotor)) | changes
        rotors.append(sources.SourceRotor(**keys, link=names[rotor.on]))
    frames = {
        frame.name: sources.SourceFrame(
            frame.name,
            pose=centre @ frame.pose if frame.on == BASE else frame.pose,
            link=names[frame.on],
        )
        for frame in frames_of(robot)
    }
    loops = []
    for constraint in robot.constraints:
        if constraint.holds in ("point", "frame"):
            anchor = sources.SourceFrame("", pose=constraint.anchor)
            if constraint.to is not None:
                to = frames[constraint.to]
                anchor = replace(to, pose=to.pose @ constraint.anchor)
            held = replace(frames[constraint.frame], name=f"{constraint.name}_held")
            ends = held, replace(anchor, name=f"{constraint.name}_anchor")
            joint: LoopJoint = "fixed" if constraint.holds == "frame" else "spherical"
            loops.append(sources.SourceConstraint.between(constraint.name, joint, ends))
    return sources.Source(
        f"{robot.name}.toml",
        robot.name,
        links,
        tuple(joints),
        tuple(rotors),
        frames=tuple(frames.values())[1:],  # The first is the base's own.
        constraints=tuple(loops),
        gravity=robot.gravity,
        root=next(iter(links)),
    )
