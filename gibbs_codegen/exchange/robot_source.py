"""A robot of this package as links and joints, as other formats have them: rods become links."""

from __future__ import annotations

from dataclasses import replace

from gibbs_codegen.exchange.placement import HERE, Placement, vector
from gibbs_codegen.exchange.source import (
    Inertial,
    Source,
    SourceFrame,
    SourceJoint,
    SourceLink,
    SourceRotor,
)
from gibbs_codegen.robot.model import BASE, Body, Link, Robot, as_rigid_body
from gibbs_codegen.robot.names import default_prefix, joint_name
from gibbs_codegen.robot.rigid_body import inertia_matrix

ROOT = "base"


def source_of(robot: Robot) -> Source:
    """The links and joints of a robot.

    The root is a link "base", whose frame is at the point whose position is x, y, z.

    Args:
        robot: The robot.

    Returns:
        Its links and joints, as of a file.
    """
    centre = _centre(robot)
    body = robot.base.body
    links = {ROOT: SourceLink(ROOT, _inertial(body, centre) if body else Inertial())}
    joints: list[SourceJoint] = []
    rotors: list[SourceRotor] = []
    for k in range(1, robot.base.rotors + 1):
        name, frame = f"arm{k}", centre @ _rod_frame(robot, k)
        links[name] = SourceLink(name, _inertial(robot.base.arm(k), HERE))
        joints.append(SourceJoint(f"{name}_mount", "fixed", ROOT, name, frame))
        seen_from_motor = k == 1 and robot.base.azimuth_deg is None
        place = (0.0 if seen_from_motor else robot.base.arm(k).length, 0.0, 0.0)
        thrust, drag = robot.base.thrust[k - 1], robot.base.drag[k - 1]
        rotors.append(SourceRotor(f"rotor{k}", name, place, thrust, drag))
    names = _names(robot)
    for i, link in enumerate(robot.links, start=1):
        links[names[i]] = SourceLink(names[i], _inertial(link.body, HERE))
        joint = _joint(robot, i, names)
        if robot.parents[i - 1] == BASE:
            joint = replace(joint, pose=centre @ joint.pose)
        joints.append(joint)
    for k, rotor in enumerate(robot.thrusters, start=1):
        place = vector(centre.point(rotor.position)) if rotor.on == BASE else rotor.position
        rotors.append(
            SourceRotor(
                rotor.name or default_prefix("rotor", k),
                names[rotor.on],
                place,
                rotor.direction,
                rotor.drag,
                rotor.limits,
                rotor.time_constant,
            )
        )
    frames = tuple(
        SourceFrame(
            frame.name,
            names[frame.on],
            (centre if frame.on == BASE else HERE) @ Placement(frame.pose.xyz, frame.pose.rpy_deg),
        )
        for frame in robot.frames
    )
    return Source(
        f"{robot.name}.toml",
        robot.name,
        links,
        tuple(joints),
        tuple(rotors),
        frames=frames,
        gravity=robot.gravity,
    )


def _centre(robot: Robot) -> Placement:
    """The frame of the base in that of the root."""
    base = robot.base
    if base.origin != "motor1":
        return HERE
    if base.azimuth_deg is None:
        return Placement((base.arm(1).length, 0.0, 0.0))
    motor = Placement(rpy_deg=_rod_frame(robot, 1).rpy_deg).point((base.arm(1).length, 0.0, 0.0))
    return Placement(vector(-motor))


def _rod_frame(robot: Robot, k: int) -> Placement:
    """The frame of a rod in that of the base."""
    if k == 1 and robot.base.azimuth_deg is None:
        return Placement((-robot.base.arm(1).length, 0.0, 0.0))
    return Placement(rpy_deg=(HERE.rpy_deg[0], HERE.rpy_deg[1], robot.base.arm_angle_deg(k)))


def _names(robot: Robot) -> list[str]:
    """Names of the base and the links, none of them twice."""
    names = [ROOT]
    taken = {ROOT, *(f"arm{k}" for k in range(1, robot.base.rotors + 1))}
    for i, link in enumerate(robot.links, start=1):
        name = link.name or default_prefix("link", i)
        while name in taken:
            name += "_"
        taken.add(name)
        names.append(name)
    return names


def _inertial(body: Body, frame: Placement) -> Inertial:
    rigid = as_rigid_body(body)
    place = Placement(vector(frame.point(rigid.com)))
    return Inertial(rigid.mass, place, inertia_matrix(rigid.inertia))


def _joint(robot: Robot, i: int, names: list[str]) -> SourceJoint:
    """The joint of a link.

    Args:
        robot: The robot.
        i: Number of the link, from 1.
        names: Names of base and links.

    Returns:
        The joint, its pose in the frame of the carrying body.
    """
    link = robot.links[i - 1]
    name = link.coordinate or link.name or joint_name(link.joint, robot.rotors + i)
    limits = link.limits
    return SourceJoint(
        name,
        link.joint,
        names[robot.parents[i - 1]],
        names[i],
        _pose(robot, i, link),
        link.axis,
        passive=link.passive,
        limits=limits,
        continuous=link.joint == "revolute" and limits.low is None and limits.high is None,
    )


def _pose(robot: Robot, i: int, link: Link) -> Placement:
    """Where a joint is, its coordinate at zero.

    Args:
        robot: The robot.
        i: Number of the link, from 1.
        link: The link.

    Returns:
        The pose in the frame of the carrying body.
    """
    if link.pose is not None:
        return Placement(link.pose.xyz, link.pose.rpy_deg)
    parent = robot.parents[i - 1]
    before = robot.links[parent - 1].body.length if parent != BASE else 0.0
    step = Placement(
        (before if link.a is None else link.a, 0.0, 0.0), (link.alpha_deg, *HERE.rpy_deg[1:])
    )
    return step @ Placement((0.0, 0.0, link.d), (*HERE.rpy_deg[:2], link.theta_deg))
