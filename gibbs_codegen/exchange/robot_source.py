"""A robot of this package as links and joints, as other formats have them: rods become links."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.placement import HERE, Placement, vector
from gibbs_codegen.exchange.source import (
    Inertial,
    Source,
    SourceFrame,
    SourceJoint,
    SourceLink,
    SourceRotor,
    endless,
)
from gibbs_codegen.exchange.urdf import is_rotor_by_name
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.model import BASE, Body, Link, Robot, Rotor, as_rigid_body
from gibbs_codegen.robot.names import default_prefix, joint_name
from gibbs_codegen.robot.placement import base_centre
from gibbs_codegen.robot.rigid_body import inertia_matrix

# What a robot file takes, 128 characters, less the room for a number.
_LONGEST = 120


class Names:
    """Names of one kind of thing in a file."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def free(self, name: str) -> str:
        """A name as near as can be that no other thing of the kind has, which takes it.

        Its characters are printable, and XML can hold them.
        """
        plain = "".join(c if c.isprintable() else "_" for c in name).strip() or "_"
        free, number = plain, 2
        while free in self._taken:
            free, number = f"{plain[:_LONGEST]}_{number}", number + 1
        self._taken.add(free)
        return free


def with_free_names(source: Source, is_urdf: bool) -> tuple[Source, list[str]]:
    """The same robot with names that a file can hold, and a line for each that is changed.

    `is_urdf` is whether frames are links and rotors are joints in the file, as in URDF.
    """
    # MuJoCo has a body of that name already.
    joints, links = Names(), Names(() if is_urdf else ("world",))
    rotors, frames = (joints, links) if is_urdf else (Names(), Names())
    lines: list[str] = []

    def free(names: Names, what: str, name: str, wanted: str | None = None) -> str:
        found = names.free(wanted or name)
        if found != name:
            lines.append(f"renamed: {what} {printable(name, 60)} is {found}")
        return found

    # The mounts of fixed joints, which a robot does not name, take what names are left.
    order = sorted(source.joints, key=lambda joint: joint.kind == "fixed")
    moved = {j.child: free(joints, "joint", j.name) for j in order if j.kind != "fixed"}
    placed = [replace(r, name=free(rotors, "rotor", r.name)) for r in source.rotors]
    moved |= {j.child: joints.free(j.name) for j in order if j.kind == "fixed"}
    # What a reader would take for a rotor of JSK is called otherwise.
    named = {
        link: free(links, "link", link, f"{link}_" if is_urdf and is_rotor else None)
        for link in source.links
        for is_rotor in [is_rotor_by_name(moved.get(link, ""), link)]
    }
    own = [f for f in source.frames if not (is_urdf and f.on == f.name and f.pose.is_identity)]
    return (
        replace(
            source,
            links={named[n]: replace(link, name=named[n]) for n, link in source.links.items()},
            joints=tuple(
                replace(j, name=moved[j.child], parent=named[j.parent], child=named[j.child])
                for j in source.joints
            ),
            rotors=tuple(replace(rotor, on=named[rotor.on]) for rotor in placed),
            frames=tuple(
                replace(f, name=free(frames, "frame", f.name), on=named[f.on]) for f in own
            ),
        ),
        lines,
    )


ROOT = "base"


def source_of(robot: Robot) -> Source:
    """The links and joints of a robot, as of a file.

    The root is a link "base", whose frame is at the point whose position is x, y, z.
    """
    centre = Placement(vector(base_centre(robot.base)))
    names, body = [ROOT], robot.base.body
    names += [link.name or default_prefix("link", i) for i, link in enumerate(robot.links, start=1)]
    rods = Names(names)
    links = {ROOT: SourceLink(ROOT, _inertial(body, centre) if body else Inertial())}
    joints: list[SourceJoint] = []
    rotors: list[SourceRotor] = []
    for k in range(1, robot.base.rotors + 1):
        rotor, rod = _motor(robot, k, rods.free(f"arm{k}")), centre @ _rod_frame(robot, k)
        links[rotor.on] = SourceLink(rotor.on, _inertial(robot.base.arm(k), HERE))
        joints.append(SourceJoint(f"{rotor.on}_mount", "fixed", ROOT, rotor.on, rod))
        rotors.append(rotor)
    for i, link in enumerate(robot.links, start=1):
        links[names[i]] = SourceLink(names[i], _inertial(link.body, HERE))
        joints.append(_joint(robot, i, names, centre))
    rotors += [_placed(rotor, k, names, centre) for k, rotor in enumerate(robot.thrusters, start=1)]
    frames = []
    for frame in frames_of(robot)[1:]:  # The first is the base's own.
        own = Placement(frame.pose.xyz, frame.pose.rpy_deg)
        pose = centre @ own if frame.on == BASE else own
        frames.append(SourceFrame(frame.name, names[frame.on], pose))
    return Source(
        f"{robot.name}.toml",
        robot.name,
        links,
        tuple(joints),
        tuple(rotors),
        frames=tuple(frames),
        gravity=robot.gravity,
    )


def _motor(robot: Robot, k: int, rod: str) -> SourceRotor:
    """The motor of rod `k`, from 1, as a rotor on the link that is called `rod`."""
    base = robot.base
    seen_from_motor = k == 1 and base.azimuth_deg is None
    place = (0.0 if seen_from_motor else base.arm(k).length, 0.0, 0.0)
    return SourceRotor(f"rotor{k}", rod, place, base.thrust[k - 1], base.drag[k - 1])


def _placed(rotor: Rotor, k: int, names: list[str], centre: Placement) -> SourceRotor:
    """Rotor `k`, from 1, that is placed on a body.

    `names` are those of base and links; `centre` is the frame of the base in that of the root.
    """
    return SourceRotor(
        rotor.name or default_prefix("rotor", k),
        names[rotor.on],
        vector(centre.point(rotor.position)) if rotor.on == BASE else rotor.position,
        rotor.direction,
        rotor.drag,
        rotor.limits,
        rotor.time_constant,
    )


def _rod_frame(robot: Robot, k: int) -> Placement:
    """The frame of a rod in that of the base."""
    if k == 1 and robot.base.azimuth_deg is None:
        return Placement((-robot.base.arm(1).length, 0.0, 0.0))
    return Placement(rpy_deg=(HERE.rpy_deg[0], HERE.rpy_deg[1], robot.base.arm_angle_deg(k)))


def _inertial(body: Body, frame: Placement) -> Inertial:
    rigid = as_rigid_body(body)
    place = Placement(vector(frame.point(rigid.com)))
    return Inertial(rigid.mass, place, inertia_matrix(rigid.inertia))


def _joint(robot: Robot, i: int, names: list[str], centre: Placement) -> SourceJoint:
    """The joint of link `i`, from 1, its pose in the frame of the carrying link.

    `names` are those of base and links; `centre` is the frame of the base in that of the root.
    """
    link = robot.links[i - 1]
    name = link.coordinate or link.name or joint_name(link.joint, robot.rotors + i)
    limits, pose = link.limits, _pose(robot, i, link)
    return SourceJoint(
        name,
        link.joint,
        names[robot.parents[i - 1]],
        names[i],
        centre @ pose if robot.parents[i - 1] == BASE else pose,
        link.axis,
        passive=link.passive,
        limits=limits,
        continuous=link.joint == "revolute" and endless(limits),
    )


def _pose(robot: Robot, i: int, link: Link) -> Placement:
    """Pose, at coordinate zero, of the joint of link `i`, from 1, in the carrying body's frame."""
    if link.pose is not None:
        return Placement(link.pose.xyz, link.pose.rpy_deg)
    parent = robot.parents[i - 1]
    before = robot.links[parent - 1].body.length if parent != BASE else 0.0
    step = Placement(
        (before if link.a is None else link.a, 0.0, 0.0), (link.alpha_deg, *HERE.rpy_deg[1:])
    )
    return step @ Placement((0.0, 0.0, link.d), (*HERE.rpy_deg[:2], link.theta_deg))
