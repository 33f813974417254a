"""What `info` says of a robot as a machine: masses, links, rotors and frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

from gibbs_codegen.cli.terminal import plain_table, print_table
from gibbs_codegen.robot.balance import hover_lines, lopsided, number
from gibbs_codegen.robot.coordinates import frames_of
from gibbs_codegen.robot.hover import Hover, hover
from gibbs_codegen.robot.layout import joint_terms
from gibbs_codegen.robot.mass_properties import MassProperties, base_properties, whole_properties
from gibbs_codegen.robot.model import AXES, BASE, Robot, Vector3
from gibbs_codegen.robot.names import coordinate_of, link_label, rotor_label
from gibbs_codegen.robot.placement import joint_frame, mounted_rotors
from gibbs_codegen.robot.plausibility import implausible
from gibbs_codegen.robot.thrusters import wrench_matrix
from gibbs_codegen.robot.wrenches import DIRECTIONS

if TYPE_CHECKING:
    from gibbs_codegen.analysis.reach import ReachableWrenches

# Of more rotors the first are listed; --json has them all.
_MOST_LISTED = 16


def machine_facts(robot: Robot) -> dict[str, Any]:
    """Masses, hover, warnings, links, rotors and frames, in values that JSON can hold."""
    base, whole, found = base_properties(robot), whole_properties(robot), hover(robot)
    offset = float(np.hypot(base.com[0], base.com[1]))
    warnings = [*filter(None, [lopsided(robot)]), *implausible(robot)]
    reach = _reach(robot, found)
    margins = None if reach is None or reach.margins is None else reach.margins.tolist()
    return {
        "mass": robot.total_mass,
        "base": asdict(base) | {"offset": offset, "hover": found.thrusts},
        "machine": asdict(whole)
        | {"thrust_margin": found.margin}
        | {"wrench_margins": margins and dict(zip(DIRECTIONS, margins, strict=True))},
        "warnings": warnings,
        "link_list": _links(robot),
        "rotor_list": _rotors(robot),
        "frames": [
            {"name": frame.name, "on": _body(robot, frame.on), "xyz": list(frame.pose.xyz)}
            | {"rpy_deg": [float(angle) for angle in frame.pose.rpy_deg]}
            for frame in frames_of(robot)
        ],
    }


def _reach(robot: Robot, found: Hover) -> ReachableWrenches | None:
    """What the rotors can add to hovering with joints at zero; None without thrusts or limits.

    Only rotors that stand in the file by themselves have limits, so the base is not the paper's.
    """
    limits = [rotor.limits for rotor in robot.thrusters if rotor.limits]
    if not limits or len(limits) < robot.rotors or found.thrusts is None:
        return None
    # With the simulator and SciPy, which robots without limits do without.
    from gibbs_codegen.analysis.reach import CENTRE_OF_MASS, ReachableWrenches, about

    columns = about(wrench_matrix(robot), np.array(whole_properties(robot).com))
    thrusts = np.array(found.thrusts)
    return ReachableWrenches(robot.name, CENTRE_OF_MASS, columns, np.transpose(limits), thrusts)


def _body(robot: Robot, number: int) -> str:
    return "base" if number == BASE else link_label(robot, number)


def _links(robot: Robot) -> list[dict[str, Any]]:
    return [
        {
            "name": link_label(robot, i),
            "parent": _body(robot, robot.parents[i - 1]),
            "joint": "held" if link.constrained else link.joint,
            "coordinate": coordinate_of(robot, i) if link.moves or link.constrained else None,
            "axis": list(link.axis) if link.moves or link.constrained else None,
            "mass": link.body.total_mass,
            "limits": [link.limits.low, link.limits.high],
            "unit": joint_terms(robot, i).unit,
        }
        | asdict(link.passive)
        for i, link in enumerate(robot.links, start=1)
    ]


def _rotors(robot: Robot) -> list[dict[str, Any]]:
    return [
        {
            "name": rotor_label(robot, k),
            "on": _body(robot, rotor.on),
            "position": list(rotor.position),
            "direction": list(rotor.direction),
            "drag": rotor.drag,
            "limits": rotor.limits,
        }
        for k, rotor in enumerate(mounted_rotors(robot), start=1)
    ]


def print_machine(robot: Robot, data: dict[str, Any], console: Console) -> None:
    """Print what `machine_facts` says: masses, hover thrusts, warnings, and tables.

    The tables are of links, rotors and frames.
    """
    base, whole = base_properties(robot), whole_properties(robot)
    columns = {"base": base} | ({"whole, joints at zero": whole} if robot.links else {})
    print_table(_mass_table(robot, columns), console)
    found = replace(hover(robot, margin=False), margin=data["machine"]["thrust_margin"])
    lines = hover_lines(robot, found)
    if margins := data["machine"]["wrench_margins"]:
        from gibbs_codegen.analysis.reach import CENTRE_OF_MASS, margin_lines

        lines += margin_lines([*margins.values()], CENTRE_OF_MASS)
    for line in lines:
        console.print(line)
    for warning in data["warnings"]:
        console.print(f"warning: {warning}", style="bold", markup=False)
    for table in (_link_table(data), *_place_tables(robot), _rotor_table(data), _frame_table(data)):
        if table.row_count:
            print_table(table, console)


def _mass_table(robot: Robot, columns: dict[str, MassProperties]) -> Table:
    where = "arm 1's axes" if _by_rule(robot) else "the base's axes"
    title = f"\nMasses, in {where} (kg, m, kg m² about the centre of mass)"
    table = plain_table(title, "", *columns)
    properties = columns.values()
    table.add_row("mass", *(number(found.mass) for found in properties))
    table.add_row("centre of mass", *(_listed(found.com) for found in properties))
    for entries, half in (("xx, yy, zz", slice(3)), ("xy, xz, yz", slice(3, 6))):
        cells = (_listed(found.inertia[half]) for found in properties)
        table.add_row(entries, *cells)
    return table


def _by_rule(robot: Robot) -> bool:
    return bool(robot.base.rotors) and robot.base.azimuth_deg is None


def _listed(values: Sequence[float]) -> str:
    return ", ".join(map(number, values))


def _link_table(data: dict[str, Any]) -> Table:
    # A column of its own for coordinates only where they are not called like their links.
    own_names = any(link["coordinate"] not in (None, link["name"]) for link in data["link_list"])
    coordinate = ("coordinate",) if own_names else ()
    names = ("link", "joint", *coordinate, "mass, kg", "limits", "damping")
    table = plain_table("\nLinks", *names)
    for link in data["link_list"]:
        table.add_row(
            link["name"],
            link["joint"],
            *(link[key] or "-" for key in coordinate),
            number(link["mass"]),
            _range(link["limits"], link["unit"]),
            number(link["damping"]) if link["damping"] else "-",
        )
    return table


def _place_tables(robot: Robot) -> list[Table]:
    """Where the joints of links are on their parents, in the form that the robot file has."""
    posed = ("link", "parent", "position, m", "roll, pitch, yaw, °", "axis")
    poses = plain_table("\nPlaces of the links' joints, at zero, and their axes", *posed)
    title = "\nDenavit–Hartenberg parameters of the links (modified; the axis is z)"
    parameters = plain_table(title, "link", "parent", "alpha, °", "a, m", "d, m", "theta, °")
    for i, link in enumerate(robot.links, start=1):
        carried = (link_label(robot, i), _body(robot, robot.parents[i - 1]))
        if link.pose:
            angles = _listed([float(angle) for angle in link.pose.rpy_deg])
            poses.add_row(*carried, _listed(link.pose.xyz), angles, _direction(link.axis))
        else:
            step = joint_frame(robot, i)[1][0], link.d
            numbers = (float(link.alpha_deg), *step, float(link.theta_deg))
            parameters.add_row(*carried, *map(number, numbers))
    return [poses, parameters]


def _rotor_table(data: dict[str, Any]) -> Table:
    names = ("rotor", "on", "position, m", "direction", "drag, m", "limits")
    table = plain_table("\nRotors", *names)
    rotors = data["rotor_list"]
    for rotor in rotors[:_MOST_LISTED]:
        table.add_row(
            rotor["name"],
            rotor["on"],
            _short(rotor["position"]),
            _direction(rotor["direction"]),
            number(rotor["drag"]),
            _range(rotor["limits"] or (None, None), "N"),
        )
    if len(rotors) > _MOST_LISTED:
        table.add_row("…", f"{len(rotors) - _MOST_LISTED} more; --json lists all")
    return table


def _frame_table(data: dict[str, Any]) -> Table:
    table = plain_table("\nFrames", "frame", "on", "position, m", "roll, pitch, yaw, °")
    for frame in data["frames"]:
        table.add_row(frame["name"], frame["on"], _short(frame["xyz"]), _short(frame["rpy_deg"]))
    return table


def _short(values: Sequence[float]) -> str:
    return ", ".join(f"{value + 0.0:.3g}" for value in values)


def _direction(vector: Sequence[float]) -> str:
    """A direction as robot files have it: x, -y, or components."""
    x, y, z = vector
    given: Vector3 = (x, y, z)
    for name, axis in AXES.items():
        for sign, text in ((1.0, name), (-1.0, f"-{name}")):
            if np.allclose(given, sign * np.array(axis), rtol=0.0, atol=1e-12):
                return text
    return _short(given)


def _range(bounds: Sequence[float | None], unit: str) -> str:
    """Limits in words, such as "0 … 15 N"."""
    low, high = bounds
    if low is None:
        return "-" if high is None else f"≤ {_digits(high)} {unit}"
    if high is None:
        return f"≥ {_digits(low)} {unit}"
    return (
        f"±{_digits(high)} {unit}" if low == -high else f"{_digits(low)} … {_digits(high)} {unit}"
    )


def _digits(value: float) -> str:
    return f"{value:.3g}"
