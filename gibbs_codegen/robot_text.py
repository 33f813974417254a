"""A robot as the text of a robot file, with comments that explain the keys."""

from __future__ import annotations

from fractions import Fraction

from gibbs_codegen.robot import AXES, Body, Link, Robot, Rod, Vector3
from gibbs_codegen.templating import render


def robot_text(robot: Robot, name: str | None = None) -> str:
    """Commented TOML that `parse_robot` reads back as the same robot, under `name` if given."""
    base = robot.base
    arms = [_inline_table(arm) for arm in base.arms]
    context = {
        "name": name or robot.name,
        "gravity": repr(robot.gravity),
        "rotors": base.rotors,
        "attitude": base.attitude,
        "origin": base.origin,
        "thrust": _lines([_direction(direction) for direction in base.thrust]),
        "drag": _lines([repr(float(value)) for value in base.drag]),
        "arm": arms[0] if base.shares_one_arm else "[\n    " + ",\n    ".join(arms) + ",\n]",
        "links": [_link(robot, i) for i in range(1, len(robot.links) + 1)],
    }
    return render("robot.toml.jinja", context)


def _link(robot: Robot, i: int) -> dict[str, object]:
    link: Link = robot.links[i - 1]
    default = "# a: distance along x of the frame before; here"
    if link.a is not None:
        a = f"a         = {link.a!r}  # distance along x of the frame before"
    else:
        a = f"{default} {'0' if i == 1 else 'the length of the link before'}"
    return {
        "joint_number": robot.rotors + i,
        "alpha_deg": _degrees(link.alpha_deg),
        "a": a,
        "d": repr(link.d),
        "theta_deg": _degrees(link.theta_deg),
        "joint": link.joint,
        "body": [f"{key} = {value}" for key, value in _body(link.body).items()],
    }


def _inline_table(body: Body) -> str:
    return "{ " + ", ".join(f"{key} = {value}" for key, value in _body(body).items()) + " }"


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
