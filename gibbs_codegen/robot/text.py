"""A robot as the text of a robot file, with comments that explain the keys."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

from gibbs_codegen.files.templating import render
from gibbs_codegen.robot.link_text import (
    LinkText,
    frame_lines,
    link_text,
    rigid_form,
    rotor_lines,
)
from gibbs_codegen.robot.model import Base, Body, Robot
from gibbs_codegen.robot.toml_values import body_lines, degrees, direction, inline_table


@dataclass(frozen=True)
class ArmsText:
    """What the template is given of the base's arms; `rigid` are comments."""

    rotors: int
    thrust: str
    drag: str
    azimuth: str
    arm: str
    rigid: list[str]


# What is said beside an attitude: of a sequence of angles, and of a quaternion.
_ATTITUDE = (
    "intrinsic sequence of the attitude angles: any order of x, y and z",
    "or an intrinsic sequence of attitude angles: any order of x, y and z",
)


@dataclass(frozen=True)
class RobotText:
    """What the template is given; `arms` is None where the base has none."""

    to_start_from: bool
    name: str
    gravity: str
    allow_impossible_inertia: bool
    attitude: str
    attitude_words: str
    origin: str
    arms: ArmsText | None
    central_body: list[str]
    rotors: list[list[str]]
    links: list[LinkText]
    frames: list[list[str]]


def robot_text(robot: Robot, name: str | None = None, to_start_from: bool = False) -> str:
    """Commented TOML that `parse_robot` reads back as the same robot, under `name` if given.

    `to_start_from`: whether to name the schema for editors in the first line, and to add, as
    comments, the arm and the last link in the other form of a body, and further tables.
    """
    base = robot.base
    last = len(robot.links) if to_start_from else None
    context = RobotText(
        to_start_from=to_start_from,
        name=name or robot.name,
        gravity=repr(robot.gravity),
        allow_impossible_inertia=robot.allow_impossible_inertia,
        attitude=base.attitude,
        attitude_words=_ATTITUDE[base.attitude == "quaternion"],
        origin=base.origin,
        arms=_arms(base, to_start_from) if base.arms else None,
        central_body=body_lines(base.body)[1:] if base.body else [],
        rotors=[rotor_lines(robot, k) for k in range(1, len(robot.thrusters) + 1)],
        links=[link_text(robot, i, i == last) for i in range(1, len(robot.links) + 1)],
        frames=[frame_lines(robot, k) for k in range(1, len(robot.frames) + 1)],
    )
    return render("robot.toml.jinja", context)


def placed_robot_text(name: str) -> str:
    """A commented robot file to start from: a quadrotor with an arm, whose parts have positions."""
    return render("placed_robot.toml.jinja", SimpleNamespace(name=name))


def _arms(base: Base, in_both_forms: bool) -> ArmsText:
    tables = [inline_table(arm) for arm in base.arms]
    return ArmsText(
        rotors=base.rotors,
        thrust=_lines([direction(vector) for vector in base.thrust]),
        drag=_lines([repr(float(value)) for value in base.drag]),
        azimuth=_lines([degrees(angle) for angle in base.azimuth_deg or ()]),
        arm=tables[0] if base.shares_one_arm else "[\n    " + ",\n    ".join(tables) + ",\n]",
        rigid=_rigid_arm(base.arm(1)) if in_both_forms else [],
    )


def _rigid_arm(body: Body) -> list[str]:
    return [
        "The same arm as a rigid body. Arm 1 counts from the motor, with x towards the centre, the",
        "others from the centre: where the arm is not the same from both ends, give a list of N",
        "tables, the first with com = [length - x, -y, z] and with the signs of inertia xz and yz",
        "turned. The directions of tilted thrusts turn alike: x and y of motor 1 have other signs.",
        f"arm = {inline_table(rigid_form(body))}",
    ]


def _lines(entries: list[str]) -> str:
    """Entries of a list, over several lines where one would be too long."""
    return ("," + "\n" + " " * 12).join(
        ", ".join(entries[i : i + 10]) for i in range(0, len(entries), 10)
    )
