"""A robot as the text of a robot file, with comments that explain the keys."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

from gibbs_codegen.files.templating import render
from gibbs_codegen.robot.model import (
    AXES,
    Body,
    Link,
    RigidBody,
    Robot,
    Rod,
    Vector3,
    as_rigid_body,
)


@dataclass(frozen=True)
class LinkText:
    """What the template is given of a link; `rigid` are comments, `a` may be one."""

    joint_number: int
    alpha_deg: str
    a: str
    d: str
    theta_deg: str
    joint: str
    body: list[str]
    rigid: list[str]


# How a file opens that is to be edited.
_SCHEMA_LINES = [
    "#:schema ./robot.schema.json",
    "# Editors complete and check keys by this schema, once it has been made beside this file:",
    "# gibbs-codegen schema robot > robot.schema.json",
    "",
]


@dataclass(frozen=True)
class RobotText:
    """What the template is given; `rigid_arm` are comments."""

    schema_lines: list[str]
    name: str
    gravity: str
    rotors: int
    attitude: str
    origin: str
    thrust: str
    drag: str
    arm: str
    rigid_arm: list[str]
    links: list[LinkText]


def robot_text(robot: Robot, name: str | None = None, to_start_from: bool = False) -> str:
    """Commented TOML that `parse_robot` reads back as the same robot.

    Args:
        robot: The robot.
        name: Name that the text gives the robot; its own where None.
        to_start_from: Whether to name the schema for editors in the first line, and to add, as
            comments, the arm and the last link in the other form of a body.

    Returns:
        The text of a robot file.
    """
    base = robot.base
    arms = [_inline_table(arm) for arm in base.arms]
    last = len(robot.links) if to_start_from else None
    context = RobotText(
        schema_lines=_SCHEMA_LINES if to_start_from else [],
        name=name or robot.name,
        gravity=repr(robot.gravity),
        rotors=base.rotors,
        attitude=base.attitude,
        origin=base.origin,
        thrust=_lines([_direction(direction) for direction in base.thrust]),
        drag=_lines([repr(float(value)) for value in base.drag]),
        arm=arms[0] if base.shares_one_arm else "[\n    " + ",\n    ".join(arms) + ",\n]",
        rigid_arm=_rigid_arm(base.arm(1)) if to_start_from else [],
        links=[_link(robot, i, i == last) for i in range(1, len(robot.links) + 1)],
    )
    return render("robot.toml.jinja", context)


def _link(robot: Robot, i: int, in_both_forms: bool) -> LinkText:
    """The text of a link.

    Args:
        robot: Whose link it is.
        i: Number of the link, from 1.
        in_both_forms: Whether comments give its body as a rigid one too.

    Returns:
        What the template is given.
    """
    link: Link = robot.links[i - 1]
    default = "# a: distance along x of the frame before; here"
    if link.a is not None:
        a = f"a         = {link.a!r}  # distance along x of the frame before"
    else:
        a = f"{default} {'0' if i == 1 else 'the length of the link before'}"
    return LinkText(
        joint_number=robot.rotors + i,
        alpha_deg=_degrees(link.alpha_deg),
        a=a,
        d=repr(link.d),
        theta_deg=_degrees(link.theta_deg),
        joint=link.joint,
        body=_lines_of(link.body),
        rigid=_rigid_link(link.body) if in_both_forms else [],
    )


def _rigid_arm(body: Body) -> list[str]:
    return [
        "The same arm as a rigid body. Arm 1 counts from the motor, with x towards the centre, the",
        "others from the centre: where the arm is not the same from both ends, give a list of N",
        "tables, the first with com = [length - x, -y, z] and with the signs of inertia xz and yz",
        "turned. The directions of tilted thrusts turn alike: x and y of motor 1 have other signs.",
        f"arm = {_inline_table(_rigid(body))}",
    ]


def _rigid_link(body: Body) -> list[str]:
    heading = "The same link as a rigid body, in place of mass_per_length and section_inertia:"
    return [heading, *_lines_of(_rigid(body))[1:]]


def _rigid(body: Body) -> RigidBody:
    """A body as a rigid one, in numbers that are short enough to be changed by hand."""
    rigid = as_rigid_body(body)
    xx, yy, zz, xy, xz, yz = (float(f"{value:.6g}") for value in rigid.inertia)
    return replace(rigid, inertia=(xx, yy, zz, xy, xz, yz))


def _lines_of(body: Body) -> list[str]:
    return [f"{key} = {value}" for key, value in _body(body).items()]


def _inline_table(body: Body) -> str:
    return "{ " + ", ".join(_lines_of(body)) + " }"


def _body(body: Body) -> dict[str, str]:
    if isinstance(body, Rod):
        return {
            "length": repr(body.length),
            "mass_per_length": repr(body.mass_per_length),
            "section_inertia": f"[{_numbers(body.section_inertia)}]",
        }
    return {
        "length": repr(body.length),
        "mass": repr(body.mass),
        "com": f"[{_numbers(body.com)}]",
        "inertia": f"[{_numbers(body.inertia)}]",
    }


def _direction(direction: Vector3) -> str:
    for letter, unit in AXES.items():
        if direction == unit:
            return f'"{letter}"'
    return f"[{_numbers(direction)}]"


def _lines(entries: list[str]) -> str:
    """Entries of a list, over several lines where one would be too long."""
    return ("," + "\n" + " " * 12).join(
        ", ".join(entries[i : i + 10]) for i in range(0, len(entries), 10)
    )


def _numbers(values: tuple[float, ...]) -> str:
    return ", ".join(repr(float(value)) for value in values)


def _degrees(angle: Fraction) -> str:
    return str(angle.numerator) if angle.denominator == 1 else repr(float(angle))
