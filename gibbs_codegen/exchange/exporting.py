"""From a robot to the text of a file in another format."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange import sources
from gibbs_codegen.exchange.autopilots import ardupilot_text, px4_text
from gibbs_codegen.exchange.motors import motors_of, told_of_motors
from gibbs_codegen.exchange.placement import HERE, Placement, vector
from gibbs_codegen.exchange.sdf_text import sdf_text
from gibbs_codegen.exchange.urdf import is_rotor_by_name
from gibbs_codegen.exchange.xml_text import mjcf_text, urdf_text
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import default_prefix, joint_name, link_label
from gibbs_codegen.robot.parts.body import Body, as_rigid_body, inertia_matrix
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.parts.part import taken
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.placement import base_centre

Format = Literal["urdf", "mjcf", "sdf", "px4", "ardupilot"]
# Of a file by the robot's name. PX4 knows airframes by numbers, of which those from 22000 are free.
FILES: dict[Format, str] = {
    **{"urdf": "{}.urdf", "mjcf": "{}.xml", "sdf": "{}.sdf"},
    **{"px4": "22000_{}", "ardupilot": "{}.param"},
}
# Of what acts on a joint, what a format has no place for.
_NO_PLACE: dict[Format, tuple[str, ...]] = {
    "urdf": ("armature", "stiffness"),
    "mjcf": (),
    "sdf": ("armature",),
}


def export_robot(robot: Robot, form: Format) -> tuple[str, list[str]]:
    """Text of a robot in another format, and lines on what this has no place for or cannot name."""
    if form in ("px4", "ardupilot"):
        return px4_text(robot) if form == "px4" else ardupilot_text(robot)
    source = source_of(robot)
    missing, rods = [], [None] * robot.base.rotors
    for joint, link in zip(source.joints, (*rods, *robot.links), strict=True):
        limits, servo = joint.limits, getattr(link, "servo", None)
        lost = [key for key in _NO_PLACE[form] if getattr(joint.passive, key)]
        if form == "mjcf":
            lost += [] if limits.velocity is None else ["velocity"]
            if (limits.low is None) != (limits.high is None):
                lost.append("limits, since it has one only")
        if form == "sdf" and servo:
            own = servo.parameters()
            lost += [f"{k} of its servo" for k in _NONIDEALITIES if k in own and getattr(servo, k)]
        elif servo:
            lost.append("servo")
        if joint.friction and joint.friction.static != joint.friction.coulomb:
            lost.append("static friction")
        if joint.kind != "fixed" and lost:
            missing.append(f"joint {joint.name}: {' and '.join(lost)}")
    for i in robot.constrained:
        missing.append(f"{link_label(robot, i)}: that a constraint torque holds it; it is welded")
    # What makes thrusts and torques of commands: these are the inputs of what is written, but in
    # SDF, where motors are told for themselves.
    kinds = {"what rotors make of commands": "has_drive", "air on rotors": "feels_air"}
    for what, key in kinds.items():
        own = [rotor.name for rotor in source.rotors if getattr(rotor, key)]
        if own and form != "sdf":
            missing.append(f"{what}: {', '.join(own)}")
    written = [each.name for each in source.constraints if form == "mjcf"]
    if lost := [each.name for each in robot.constraints if each.name not in written]:
        missing.append(f"constraints: {', '.join(lost)}")
    if robot.battery:
        missing.append("the battery")
    if any(rotor.spin_inertia for rotor in robot.thrusters):
        missing.append("spin inertias of rotors")
    slow = [rotor.name for rotor in source.rotors if rotor.time_constant]
    if form == "urdf" and slow:
        missing.append(f"time constants of {', '.join(slow)}")
    if form != "mjcf" and source.gravity != 9.81:
        missing.append(f"gravity of {source.gravity:g} m/s²")
    servos = [getattr(link, "servo", None) for link in (*rods, *robot.links)]
    source, renamed = with_free_names(source, form)
    lines = [*(f"left out: {line}" for line in missing), *renamed]
    if form == "sdf":
        motors = motors_of(source, robot.gravity * robot.total_mass)
        driven = {j.name: s for j, s in zip(source.joints, servos, strict=True) if s}
        return sdf_text(source, motors, driven), [*lines, *told_of_motors(motors)]
    return (urdf_text(source) if form == "urdf" else mjcf_text(source, ROOT)), lines


# Of servos, those that controllers of Gazebo do not have.
_NONIDEALITIES = ("rate", "delay", "backlash")


def with_free_names(source: sources.Source, form: Format) -> tuple[sources.Source, list[str]]:
    """The same robot with names that a file can hold, and a line for each that is changed.

    In URDF frames are links and rotors are joints in the file. In SDF all names are of one space.
    """
    is_urdf, shared = form == "urdf", form == "sdf"
    # MuJoCo has a body of that name already, and for SDF it is the world.
    joints, links = sources.Names(), sources.Names(() if is_urdf else ("world",))
    if shared:
        joints = links
    rotors, frames = (joints, links)
    if form == "mjcf":
        rotors, frames = sources.Names(), sources.Names()
    lines: list[str] = []

    def free(names: sources.Names, what: str, name: str, wanted: str | None = None) -> str:
        plain = name
        if shared:  # There `::` goes between names of models, and `__…__` are reserved.
            plain = name.replace("::", "_").strip("_" if name.startswith("__") else "") or what
            plain = f"{plain}_{what}" if plain in names else plain
        found = names.free(wanted or plain)
        if found != name:
            lines.append(f"renamed: {what} {printable(name, 60)} is {found}")
        return found

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
        for is_rotor in [is_rotor_by_name(moved.get(link, ""), link)]
    }
    own = [f for f in source.frames if not (is_urdf and f.on == f.name and f.pose.is_identity)]
    seats = [replace(f, name=free(frames, "frame", f.name), on=named[f.on]) for f in own]
    if shared:
        moved |= {child: joints.free(name) for child, name in mounts.items()}

    def placed_in(frame: sources.Frame) -> sources.Frame:
        return replace(frame, name=frames.free(frame.name), on=named.get(frame.on, sources.WORLD))

    return (
        replace(
            source,
            links={named[n]: replace(link, name=named[n]) for n, link in source.links.items()},
            joints=tuple(
                replace(j, name=moved[j.child], parent=named[j.parent], child=named[j.child])
                for j in source.joints
            ),
            rotors=tuple(replace(rotor, link=named[rotor.link]) for rotor in placed),
            frames=tuple(seats),
            constraints=tuple(
                replace(each, frame=placed_in(each.frame), to=placed_in(each.to))
                for each in source.constraints
            ),
        ),
        lines,
    )


ROOT = "base"


def source_of(robot: Robot) -> sources.Source:
    """The links and joints of a robot, as of a file.

    The root is a link "base", whose frame is at the point whose position is x, y, z.
    """
    centre = Placement(vector(base_centre(robot.base)))
    names, body = [ROOT], robot.base.body
    names += [link.name or default_prefix("link", i) for i, link in enumerate(robot.links, start=1)]
    rods = sources.Names(names)
    links = {ROOT: sources.Link(ROOT, inertial_of(body, centre) if body else sources.Inertial())}
    joints: list[sources.Joint] = []
    rotors: list[sources.FoundRotor] = []
    for k in range(1, robot.base.rotors + 1):
        arm, rod = robot.base.arm(k), rods.free(f"arm{k}")
        if seen_from_motor := k == 1 and robot.base.azimuth_deg is None:
            mount = Placement((-arm.length, 0.0, 0.0))
        else:
            mount = Placement(rpy_deg=(*HERE.rpy_deg[:2], robot.base.arm_angle_deg(k)))
        seat = (0.0 if seen_from_motor else arm.length, 0.0, 0.0)
        thrust, drag = robot.base.thrust[k - 1], robot.base.drag[k - 1]
        rotors.append(
            sources.FoundRotor(
                name=f"rotor{k}", link=rod, position=seat, direction=thrust, drag=drag
            )
        )
        links[rod] = sources.Link(rod, inertial_of(arm, HERE))
        joints.append(sources.Joint(f"{rod}_mount", "fixed", ROOT, rod, centre @ mount))
    for i, link in enumerate(robot.links, start=1):
        links[names[i]] = sources.Link(names[i], inertial_of(link.body, HERE))
        joints.append(_joint(robot, i, names, centre))
    rotors += [
        sources.FoundRotor(
            **vars(taken(Rotor, rotor))
            | {
                "name": rotor.name or default_prefix("rotor", k),
                "position": vector(centre.point(rotor.position))
                if rotor.on == BASE
                else rotor.position,
                "limits": rotor.drive.thrust_limits,
                "time_constant": rotor.drive.up or None,
            },
            link=names[rotor.on],
        )
        for k, rotor in enumerate(robot.thrusters, start=1)
    ]
    frames = {}
    for frame in frames_of(robot):
        own = Placement(frame.pose.xyz, frame.pose.rpy_deg)
        pose = centre @ own if frame.on == BASE else own
        frames[frame.name] = sources.Frame(frame.name, names[frame.on], pose)
    constraints = []
    for each in robot.constraints:
        holds, anchor = each.holds, Placement(each.anchor.xyz, each.anchor.rpy_deg)
        if holds in ("point", "frame"):
            to = sources.Frame("", sources.WORLD, anchor)
            if each.to is not None:
                to = replace(frames[each.to], pose=frames[each.to].pose @ anchor)
            held = replace(frames[each.frame], name=f"{each.name}_held")
            to = replace(to, name=f"{each.name}_anchor")
            constraints.append(sources.Constraint(each.name, holds, held, to))
    return sources.Source(
        f"{robot.name}.toml",
        robot.name,
        links,
        tuple(joints),
        tuple(rotors),
        frames=tuple(frames.values())[1:],  # The first is the base's own.
        constraints=tuple(constraints),
        gravity=robot.gravity,
    )


def inertial_of(body: Body, frame: Placement) -> sources.Inertial:
    """Mass and inertia of a body, in the axes of its own frame, which is level in another."""
    rigid = as_rigid_body(body)
    place = Placement(vector(frame.point(rigid.com)))
    return sources.Inertial(rigid.mass, place, inertia_matrix(rigid.inertia))


def joint_placement(robot: Robot, i: int) -> Placement:
    """The pose of the joint of link `i`, from 1, at zero, in the frame of what carries it."""
    link, parent = robot.links[i - 1], robot.parents[i - 1]
    if link.pose is not None:
        return Placement(link.pose.xyz, link.pose.rpy_deg)
    before = robot.links[parent - 1].body.length if parent != BASE else 0.0
    start = (before if link.a is None else link.a, 0.0, 0.0)
    step = Placement(start, (link.alpha_deg, *HERE.rpy_deg[1:]))
    return step @ Placement((0.0, 0.0, link.d), (*HERE.rpy_deg[:2], link.theta_deg))


def _joint(robot: Robot, i: int, names: list[str], centre: Placement) -> sources.Joint:
    """The joint of link `i`, from 1, its pose in the frame of the carrying link.

    `names` are those of base and links; `centre` is the frame of the base in that of the root.
    """
    link, parent = robot.links[i - 1], robot.parents[i - 1]
    name = link.coordinate or link.name or joint_name(link.joint, robot.rotors + i)
    pose = joint_placement(robot, i)
    return sources.Joint(
        name,
        link.joint,
        names[parent],
        names[i],
        centre @ pose if parent == BASE else pose,
        link.axis,
        passive=link.passive,
        limits=link.limits,
        friction=link.friction,
        continuous=link.joint == "revolute" and sources.endless(link.limits),
    )
