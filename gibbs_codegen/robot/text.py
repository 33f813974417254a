"""A robot as the text of a robot file, with comments that explain the keys."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.templating import render
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import default_prefix
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import Body, RigidBody, as_rigid_body
from gibbs_codegen.robot.parts.constraint import Constraint
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.gear import Rolling
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.numbers import BASE, SIGNED_AXES, Vector3
from gibbs_codegen.robot.parts.part import all_keys, changed_keys, changed_numbers
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.parts.rotor import AIR_KEYS, MAX_ROTORS
from gibbs_codegen.robot.parts.ties import Tie

_NONE: Mapping[str, str] = {}


def quoted(text: str) -> str:
    """A text in double quotes on one line, with escapes for what cannot be printed."""
    letters = []
    for letter in text:
        escape = f"\\u{ord(letter):04x}" if ord(letter) < 0x10000 else f"\\U{ord(letter):08x}"
        printed = f"\\{letter}" if letter in '"\\' else letter
        letters.append(printed if letter.isprintable() else escape)
    return f'"{"".join(letters)}"'


def toml_value(value: object) -> str:
    """A word, number, angle in degrees, list or table as TOML, on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(toml_lines(value)) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, Fraction):
        return str(value.numerator) if value.denominator == 1 else repr(float(value))
    if isinstance(value, float):  # It may be one of NumPy's.
        return repr(float(value))
    return str(value).lower() if isinstance(value, bool) else repr(value)


def toml_lines(table: Mapping[str, object], comments: Mapping[str, str] = _NONE) -> list[str]:
    """The keys of a table, a line each with its comment; those that are None are left out."""
    ends = {key: f"  # {words}" for key, words in comments.items()}
    lines = {key: f"{key} = {toml_value(x)}" for key, x in table.items() if x is not None}
    return [line + ends.get(key, "") for key, line in lines.items()]


def direction(vector: Vector3) -> str | Vector3:
    """A unit vector as the letter of its axis, with a minus sign if against it, or itself."""
    return next((letter for letter, unit in SIGNED_AXES.items() if vector == unit), vector)


def link_lines(robot: Robot, i: int, in_both_forms: bool) -> list[str]:
    """The table of link i, from 1, with its body in comments as a rigid one too if so asked."""
    link, parent = robot.links[i - 1], robot.parents[i - 1]
    if link.rolling:
        return _wheel_lines(link, link.rolling)
    if link.gear:
        movers = [printable(_carrier(robot, mover)) for mover in link.gear.ratios]
        how = f"moved by a gear of {' and '.join(movers)}"
    elif link.moves:
        how = f"{'turned' if link.joint == 'revolute' else 'moved'} by joint {robot.rotors + i}"
    else:
        how = "held by a constraint torque" if link.constrained else "welded to what carries it"
    table: dict[str, object] = {
        "name": link.name,
        "parent": None if parent == i - 1 else _carrier(robot, parent),
        "coordinate": link.coordinate,
    }
    lines = [f"[[link]]  # link {i}, {how}", *toml_lines(table)]
    if link.pose:
        table = _pose(link.pose) | {"axis": direction(link.axis), "joint": link.joint}
        lines += [
            "# Pose of the joint in the frame of what carries the link (m, R = Rz Ry Rx), axis in "
            "the link's frame.",
            *toml_lines(table, {"joint": '"revolute", "prismatic" or "fixed"'}),
        ]
    else:
        default = "0" if parent == BASE else "the length of the link before"
        a = f"# a: distance along x of the frame before; here {default}"
        if link.a is not None:
            a = f"a         = {link.a!r}  # distance along x of the frame before"
        twist = "modified Denavit-Hartenberg: twist about x of the frame before"
        lines += [
            f"alpha_deg = {toml_value(link.alpha_deg)}  # {twist}",
            a,
            f"d         = {link.d!r}",
            f"theta_deg = {toml_value(link.theta_deg)}  # offset of the joint angle",
            f'joint     = "{link.joint}"  # or "prismatic", along z',
        ]
    lines += _joint_lines(link)
    if link.gear:
        movers = [_carrier(robot, mover) for mover in link.gear.ratios]
        of = movers if isinstance(link.gear.of, tuple) else movers[0]
        gear = {"of": of} | changed_keys(link.gear, "of")
        lines += toml_lines({"gear": gear})
    body = toml_lines(vars(link.body))
    lines += body[1:] if link.pose and not link.body.length else body
    if in_both_forms:
        rigid = toml_lines(vars(rigid_form(link.body)))[1:]
        heading = "The same link as a rigid body, in place of mass_per_length and section_inertia:"
        lines += [f"# {line}" for line in (heading, *rigid)]
    return lines


def _wheel_lines(link: Link, rolling: Rolling) -> list[str]:
    """The table of a wheel."""
    pose, body = link.pose or HERE, as_rigid_body(link.body)
    across, about = body.inertia[:2]
    table: dict[str, object] = {"name": link.name, "joint": link.coordinate}
    table |= {"radius": rolling.radius, "xyz": pose.xyz, "mass": body.mass, "inertia": about}
    if link.moves:
        table |= {"axis": direction(vector(pose.matrix[:, 1])), "inertia_across": across}
        table |= {"effort": link.limits.effort} | changed_keys(link.passive)
    return ["[[wheel]]", *toml_lines(table)]


def rotor_lines(robot: Robot, k: int) -> list[str]:
    """The table of placed rotor k, from 1."""
    rotor = robot.thrusters[k - 1]
    table = {
        "name": rotor.name,
        "on": _carrier(robot, rotor.on),
        "position": rotor.position,
        "direction": direction(rotor.direction),
        "drag": rotor.drag,
    }
    table |= changed_keys(rotor, *table, *AIR_KEYS)
    if rotor.feels_air:
        table |= {key: getattr(rotor, key) for key in AIR_KEYS}
    units = {"spin_inertia": "kg m^2", "speed_per_sqrt_thrust": "(rad/s)/sqrt(N)"}
    return [f"[[rotor]]  # rotor {k}", *toml_lines(table, units)]


def frame_lines(robot: Robot, frame: Frame) -> list[str]:
    """The table of a frame in the file."""
    names = {"name": frame.name, "on": _carrier(robot, frame.on)}
    return ["[[frame]]", *toml_lines(names | _pose(frame.pose))]


def tie_lines(tie: Tie) -> list[str]:
    """The table of a tie in the file, and where its anchor is."""
    table = changed_keys(tie, "xyz", "rpy_deg")
    if isinstance(tie, Constraint):
        pose = _pose(tie.anchor)
        table |= pose if tie.kind in ("frame", "loop") else {"xyz": pose["xyz"]}
    return [f"[[{tie.array}]]", *toml_lines(table)]


def rigid_form(body: Body) -> RigidBody:
    """A body as a rigid one, in numbers that are short enough to be changed by hand."""
    rigid = as_rigid_body(body)
    xx, yy, zz, xy, xz, yz = (float(f"{value:.6g}") for value in rigid.inertia)
    return replace(rigid, inertia=(xx, yy, zz, xy, xz, yz))


def _carrier(robot: Robot, number: int) -> str:
    """The name of a body in the file."""
    if number == BASE:
        return "base"
    return robot.links[number - 1].name or default_prefix("link", number)


def _pose(pose: Pose) -> dict[str, object]:
    return {"xyz": pose.xyz, "rpy_deg": pose.rpy_deg}


def _joint_lines(link: Link) -> list[str]:
    """Lines of what acts on a joint, and of its limits, where they are not the defaults."""
    slides, limits, servo = link.joint != "revolute", link.limits, link.servo
    rate, unit, effort = ("m/s", "m", "N") if slides else ("rad/s", "rad", "N m")
    acting = changed_numbers(link.passive, "", lambda number: number, slides)
    table: dict[str, object] = {"constrained": link.constrained or None}
    table |= {n.name: n.value for n in acting.values() if n.value != 0.0}
    if (limits.low, limits.high) != (None, None):
        low = -math.inf if limits.low is None else limits.low
        table["limits"] = low, math.inf if limits.high is None else limits.high
    table |= {"effort": limits.effort, "velocity": limits.velocity}
    table["friction"] = link.friction and all_keys(link.friction)
    table["motor"] = link.motor and all_keys(link.motor)
    if servo:
        table["servo"] = {"command": servo.command} | all_keys(servo) | {"rate": servo.rate}
    units = {"limits": unit, "effort": effort, "velocity": rate}
    return toml_lines(table, units | {n.name: n.unit for n in acting.values()})


def _motion_lines(base: Base) -> list[str]:
    """Lines of how a base moves that does not move freely, and of its pose."""
    motion = [*base.virtual_joints] or base.motion
    pose = {} if base.pose.is_identity else _pose(base.pose)
    return toml_lines({"motion": motion, "drive": base.drive} | pose)


def robot_text(robot: Robot, name: str | None = None, to_start_from: bool = False) -> str:
    """Commented TOML that `parse_robot` reads back as the same robot, under `name` if there is one.

    `to_start_from`: whether to name the schema for editors in the first line, and to add, as
    comments, the arm and the last link in the other form of a body, and further tables. What is of
    rods is empty where the base has none.
    """
    base, links = robot.base, len(robot.links)
    words = "intrinsic sequence of the attitude angles: any order of x, y and z"
    if base.attitude == "quaternion":
        words = "or an intrinsic sequence of attitude angles: any order of x, y and z"
    arms = [toml_value(vars(arm)) for arm in base.arms]
    arm = "".join(arms) if len(arms) < 2 else "[\n    " + ",\n    ".join(arms) + ",\n]"
    rigid_arm = [
        "The same arm as a rigid body. Arm 1 counts from the motor, with x towards the centre, the",
        "others from the centre: where the arm is not the same from both ends, give a list of N",
        "tables, the first with com = [length - x, -y, z] and with the signs of inertia xz and yz",
        "turned. The directions of tilted thrusts turn alike: x and y of motor 1 have other signs.",
    ]
    if base.arms:
        rigid_arm.append(f"arm = {toml_value(vars(rigid_form(base.arm(1))))}")
    battery = ["[battery]", *toml_lines(all_keys(robot.battery))] if robot.battery else []
    context = {
        "to_start_from": to_start_from,
        "name": name or robot.name,
        "gravity": repr(robot.gravity),
        "allow_impossible_inertia": robot.allow_impossible_inertia,
        "motion": [] if base.moves_freely else _motion_lines(base),
        "attitude": base.attitude,
        "attitude_words": words,
        "origin": base.origin,
        "rods": base.rotors,
        "thrust": _list_text([direction(vector) for vector in base.thrust]),
        "drag": _list_text(base.drag),
        "azimuth": _list_text(base.azimuth_deg or ()),
        "arm": arm,
        "rigid_arm": rigid_arm if to_start_from else [],
        "central_body": toml_lines(vars(base.body))[1:] if base.body else [],
        "battery": battery,
        "rotors": [rotor_lines(robot, k) for k in range(1, len(robot.thrusters) + 1)],
        "links": [link_lines(robot, i, to_start_from and i == links) for i in range(1, links + 1)],
        "frames": [frame_lines(robot, frame) for frame in robot.frames],
        "ties": [tie_lines(tie) for tie in robot.ties],
    }
    return render("robot.toml.jinja", context)


_CORNERS = ("front_left", "rear_left", "rear_right", "front_right")


def placed_robot_text(name: str, rotors: int = 4) -> str:
    """A commented robot file to start from: a drone with an arm, its rotors evenly around it.

    Raises `UsageError` if there are not as many rotors as hold a level drone and its heading.
    """
    if not len(_CORNERS) <= rotors <= MAX_ROTORS:
        raise UsageError(
            f"--rotors must be from {len(_CORNERS)} to {MAX_ROTORS} with --placed, not {rotors}, "
            "because fewer upright rotors cannot control tilt and heading"
        )
    around = [
        {
            "name": quoted(_CORNERS[k] if rotors == len(_CORNERS) else f"rotor_{k + 1}"),
            "azimuth": toml_value(Fraction(180 + 360 * k, rotors)),
            "drag": -0.016 if k % 2 else 0.016,
        }
        for k in range(rotors)
    ]
    return render("placed_robot.toml.jinja", {"name": name, "rotors": around})


def _list_text(values: Sequence[object]) -> str:
    """Entries of a list, over several lines where one would be too long."""
    entries = [*map(toml_value, values)]
    lines = (", ".join(entries[i : i + 10]) for i in range(0, len(entries), 10))
    return ("," + "\n" + " " * 12).join(lines)
