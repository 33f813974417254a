"""Links, rotors and frames as the template of robot files is given them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gibbs_codegen.robot.model import BASE, Body, Link, Pose, RigidBody, Robot, as_rigid_body
from gibbs_codegen.robot.names import default_prefix
from gibbs_codegen.robot.toml_values import body_lines, degrees, direction, numbers, quoted


@dataclass(frozen=True)
class LinkText:
    """What the template is given of a link.

    `pose` has the lines of a pose, empty where Denavit–Hartenberg parameters place the link; `a`
    may be a comment, and `rigid` are comments.
    """

    title: str
    names: list[str]
    alpha_deg: str
    a: str
    d: str
    theta_deg: str
    pose: list[str]
    joint: str
    acting: list[str]
    body: list[str]
    rigid: list[str]


def link_text(robot: Robot, i: int, in_both_forms: bool) -> LinkText:
    """The text of link i, from 1, with its body in comments as a rigid one too if so asked."""
    link, parent = robot.links[i - 1], robot.parents[i - 1]
    if link.a is not None:
        a = f"a         = {link.a!r}  # distance along x of the frame before"
    else:
        default = "0" if parent == BASE else "the length of the link before"
        a = f"# a: distance along x of the frame before; here {default}"
    names = [] if link.name is None else [f"name = {quoted(link.name)}"]
    if parent != i - 1:
        names.append(f"parent = {_reference(robot, parent)}")
    if link.coordinate is not None:
        names.append(f"coordinate = {quoted(link.coordinate)}")
    return LinkText(
        title=_title(robot, i),
        names=names,
        alpha_deg=degrees(link.alpha_deg),
        a=a,
        d=repr(link.d),
        theta_deg=degrees(link.theta_deg),
        pose=_axis_in(link, link.pose) if link.pose else [],
        joint=link.joint,
        acting=_acting(link),
        body=[line for line in body_lines(link.body) if not link.pose or line != "length = 0.0"],
        rigid=_rigid_link(link.body) if in_both_forms else [],
    )


def rotor_lines(robot: Robot, k: int) -> list[str]:
    """The keys of placed rotor k, from 1, a line each."""
    rotor = robot.thrusters[k - 1]
    lines = [] if rotor.name is None else [f"name = {quoted(rotor.name)}"]
    lines += [
        f"on = {_reference(robot, rotor.on)}",
        f"position = [{numbers(rotor.position)}]",
        f"direction = {direction(rotor.direction)}",
        f"drag = {rotor.drag!r}",
    ]
    if rotor.limits is not None:
        lines.append(f"limits = [{numbers(rotor.limits)}]")
    if rotor.time_constant is not None:
        lines.append(f"time_constant = {rotor.time_constant!r}")
    if rotor.spin_inertia is not None:
        lines.append(f"spin_inertia = {rotor.spin_inertia!r}  # kg m^2")
        lines.append(f"speed_per_sqrt_thrust = {rotor.speed_per_sqrt_thrust!r}  # (rad/s)/sqrt(N)")
    return lines


def frame_lines(robot: Robot, k: int) -> list[str]:
    """The keys of frame k in the file, from 1, a line each."""
    frame = robot.frames[k - 1]
    names = [f"name = {quoted(frame.name)}", f"on = {_reference(robot, frame.on)}"]
    return names + _pose(frame.pose)


def rigid_form(body: Body) -> RigidBody:
    """A body as a rigid one, in numbers that are short enough to be changed by hand."""
    rigid = as_rigid_body(body)
    xx, yy, zz, xy, xz, yz = (float(f"{value:.6g}") for value in rigid.inertia)
    return replace(rigid, inertia=(xx, yy, zz, xy, xz, yz))


def _reference(robot: Robot, number: int) -> str:
    if number == BASE:
        return '"base"'
    return quoted(robot.links[number - 1].name or default_prefix("link", number))


def _title(robot: Robot, i: int) -> str:
    link = robot.links[i - 1]
    if link.moves:
        how = f"{'turned' if link.joint == 'revolute' else 'moved'} by joint {robot.rotors + i}"
    else:
        how = "held by a constraint torque" if link.constrained else "welded to what carries it"
    return f"link {i}, {how}"


def _pose(pose: Pose) -> list[str]:
    angles = ", ".join(map(degrees, pose.rpy_deg))
    return [f"xyz = [{numbers(pose.xyz)}]", f"rpy_deg = [{angles}]"]


def _axis_in(link: Link, pose: Pose) -> list[str]:
    return [*_pose(pose), f"axis = {direction(link.axis)}"]


def _acting(link: Link) -> list[str]:
    """Lines of what acts on a joint, and of its limits, where they are not the defaults."""
    turns = link.joint == "revolute"
    rate, unit, effort = ("rad/s", "rad", "N m") if turns else ("m/s", "m", "N")
    passive, limits = link.passive, link.limits
    lines = ["constrained = true"] if link.constrained else []
    for key, value, dimension in (
        ("damping", passive.damping, f"{effort} s/{unit}"),
        ("armature", passive.armature, "kg m^2" if turns else "kg"),
        ("stiffness", passive.stiffness, f"{effort}/{unit}"),
        ("rest", passive.rest, unit),
    ):
        if value != 0.0:
            lines.append(f"{key} = {value!r}  # {dimension}")
    if (limits.low, limits.high) != (None, None):
        low = -math.inf if limits.low is None else limits.low
        high = math.inf if limits.high is None else limits.high
        lines.append(f"limits = [{numbers((low, high))}]  # {unit}")
    if limits.effort is not None:
        lines.append(f"effort = {limits.effort!r}  # {effort}")
    if limits.velocity is not None:
        lines.append(f"velocity = {limits.velocity!r}  # {rate}")
    return lines


def _rigid_link(body: Body) -> list[str]:
    heading = "The same link as a rigid body, in place of mass_per_length and section_inertia:"
    return [heading, *body_lines(rigid_form(body))[1:]]
