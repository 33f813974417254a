"""`info`: a robot's base, chains, coordinates and motors, and what its functions cost."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import counted, plain_table, print_table
from gibbs_codegen.robot.balance import (
    HoverThrusts,
    arrangement,
    carried_rotors,
    hover,
    hover_commands,
    hover_lines,
    implausible,
    lopsided,
    number,
    ranks_in_motion,
    tilt_hint,
    wrench_matrix,
)
from gibbs_codegen.robot.chains import coupling_map, decompose, first_row
from gibbs_codegen.robot.description import Coordinate, Description
from gibbs_codegen.robot.layout import frames_of, joint_terms
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of, link_label, rotor_label
from gibbs_codegen.robot.parts.constraint import ROWS
from gibbs_codegen.robot.parts.gear import Gear, gear_terms
from gibbs_codegen.robot.parts.numbers import BASE, SIGNED_AXES
from gibbs_codegen.robot.parts.part import Part, changed_keys
from gibbs_codegen.robot.placement import joint_pose, mounted_rotors
from gibbs_codegen.robot.posture import base_properties, whole_properties
from gibbs_codegen.robot.wrenches import DIRECTIONS

if TYPE_CHECKING:
    from gibbs_codegen.derivation.hybrid import Filling
    from gibbs_codegen.program.model import Model
    from gibbs_codegen.robot.reach import ReachableWrenches

# Keys of rotors that their table has.
_IN_TABLE = ("name", "on", "position", "direction", "drag", "limits")
# The first rotors are listed where there are more; --json has them all.
_MOST_LISTED = 16


def run(options: argparse.Namespace) -> int:
    """Print what there is to say of the robot."""
    robot, _ = robot_argument.chosen_robot(options)
    description = Description(robot)
    data = _facts(description)
    if options.operations or options.functions or options.derivatives:
        data |= _derived_facts(robot, options)
    if options.json:
        print(json.dumps(data, indent=2))
    else:
        _print_report(
            description, data, Console(width=terminal.width(elsewhere=100), highlight=False)
        )
    return 0


def _machine_facts(robot: Robot) -> dict[str, Any]:
    """Masses, hover, warnings, links, rotors and frames, in values that JSON can hold."""
    base, whole, balance = base_properties(robot), whole_properties(robot), hover(robot)
    reach, thrusts = _reach(robot, balance), balance.thrusts or balance.lifting
    commands = hover_commands(robot, thrusts) if thrusts else None
    margins = None if reach is None or reach.margins is None else reach.margins.tolist()
    return {
        "mass": robot.total_mass,
        "base": asdict(base)
        | {"offset": float(np.hypot(base.com[0], base.com[1])), "hover": balance.thrusts},
        "machine": asdict(whole)
        | {"thrust_margin": balance.margin, "hover_commands": commands and asdict(commands)}
        | {"wrench_margins": margins and dict(zip(DIRECTIONS, margins, strict=True))},
        "warnings": [*filter(None, [lopsided(robot)]), *implausible(robot)],
        "link_list": [
            {
                "name": link_label(robot, i),
                "parent": _body(robot, robot.parents[i - 1]),
                "joint": "held" if link.constrained else link.joint,
                "coordinate": coordinate_of(robot, i) if link.moves or link.constrained else None,
                "axis": list(link.axis) if link.moves or link.constrained else None,
                "mass": link.body.total_mass,
                "limits": [link.limits.low, link.limits.high],
                "effort": link.limits.effort,
                "radius": link.rolling and link.rolling.radius,
                "unit": joint_terms(robot, i).unit,
            }
            | asdict(link.passive)
            | {"servo": link.servo and asdict(link.servo)}
            | {"friction": link.friction and asdict(link.friction)}
            | {"motor": link.motor and asdict(link.motor)}
            | {"gear": link.gear and _gear(robot, link.gear)}
            for i, link in enumerate(robot.links, start=1)
        ],
        "rotor_list": [
            {
                "name": rotor_label(robot, k),
                "on": _body(robot, rotor.on),
                "position": list(rotor.position),
                "direction": list(rotor.direction),
                "drag": rotor.drag,
                "limits": drive.thrust_limits,
                "command": drive.command,
                "command_limits": drive.limits,
                "drive": asdict(drive),
            }
            for k, (rotor, drive) in enumerate(
                zip(mounted_rotors(robot), robot.drives, strict=True), start=1
            )
        ],
        "battery": robot.battery and asdict(robot.battery),
        "frames": [
            {"name": frame.name, "on": _body(robot, frame.on), "xyz": list(frame.pose.xyz)}
            | {"rpy_deg": [float(angle) for angle in frame.pose.rpy_deg]}
            for frame in frames_of(robot)
        ],
        "constraints": [
            {"name": held.name, "type": held.kind, "frame": held.frame, "to": held.to}
            | {"xyz": list(held.anchor.xyz), "rows": list(ROWS[held.holds])}
            for held in robot.constraints
        ],
    }


def _gear(robot: Robot, gear: Gear) -> dict[str, Any]:
    """The ratios of a gear by the names of its movers, and its offset."""
    ratios = {link_label(robot, mover): ratio for mover, ratio in gear.ratios.items()}
    return {"ratios": ratios, "offset": gear.offset}


def _reach(robot: Robot, balance: HoverThrusts) -> ReachableWrenches | None:
    """Wrenches that rotors can add to hovering with joints at zero; None without thrusts or limits.

    Only rotors that stand in the file by themselves have limits, so the base is not the paper's.
    """
    limits = [bounds for drive in robot.drives if (bounds := drive.thrust_limits)]
    if not limits or len(limits) < robot.rotors or balance.thrusts is None:
        return None
    # Late, as robots without limits do without.
    from gibbs_codegen.robot.reach import CENTRE_OF_MASS, ReachableWrenches, about

    columns = about(wrench_matrix(robot), np.array(whole_properties(robot).com))
    thrusts = np.array(balance.thrusts)
    return ReachableWrenches(robot.name, CENTRE_OF_MASS, columns, np.transpose(limits), thrusts)


def _body(robot: Robot, number: int) -> str:
    return "base" if number == BASE else link_label(robot, number)


def _print_machine(robot: Robot, data: dict[str, Any], console: Console) -> None:
    """Print what `_machine_facts` says: masses, hover thrusts, warnings, and tables."""
    columns = {"base": base_properties(robot)}
    if robot.links:
        columns["whole, joints at zero"] = whole_properties(robot)
    by_rule = robot.base.rotors and robot.base.azimuth_deg is None
    where = "arm 1's axes" if by_rule else "the base's axes"
    properties = columns.values()
    rows = [
        ["mass", *(number(part.mass) for part in properties)],
        ["centre of mass", *(_listed(part.com) for part in properties)],
        ["xx, yy, zz", *(_listed(part.inertia[:3]) for part in properties)],
        ["xy, xz, yz", *(_listed(part.inertia[3:]) for part in properties)],
    ]
    title = f"\nMasses, in {where} (kg, m, kg m² about the centre of mass)"
    print_table(plain_table(title, "", *columns, rows=rows), console)
    balance = replace(hover(robot, margin=False), margin=data["machine"]["thrust_margin"])
    lines = hover_lines(robot, balance)
    if margins := data["machine"]["wrench_margins"]:
        from gibbs_codegen.robot.reach import CENTRE_OF_MASS, margin_lines

        lines += margin_lines([*margins.values()], CENTRE_OF_MASS)
    for line in lines:
        console.print(line)
    for warning in data["warnings"]:
        console.print(f"warning: {warning}", style="bold", markup=False)
    for table in _part_tables(robot, data):
        if table.row_count:
            print_table(table, console)


def _part_tables(robot: Robot, data: dict[str, Any]) -> Iterator[Table]:
    """Links, where their joints are in the form that the robot file has, and what is on them."""
    links, rotors = data["link_list"], data["rotor_list"]
    # Columns of their own only where they say something, as of coordinates not called like links.
    titles = {"coordinate": "coordinate", "effort": "effort, N m or N", "radius": "radius, m"}
    values = {key: {link[key] for link in links} - {None} for key in titles}
    values["coordinate"] -= {link["name"] for link in links}
    shown = [key for key in titles if values[key]]
    names = ("link", "joint", *map(titles.__getitem__, shown), "mass, kg", "limits", "damping")
    rows = [
        [
            *(link["name"], link["joint"], *(_cell(link[key]) for key in shown)),
            *(number(link["mass"]), _range(link["limits"], link["unit"])),
            _cell(link["damping"] or None),
        ]
        for link in links
    ]
    yield plain_table("\nLinks", *names, rows=rows)
    posed = ("link", "parent", "position, m", "roll, pitch, yaw, °", "axis")
    poses = plain_table("\nPlaces of the links' joints, at zero, and their axes", *posed)
    title = "\nDenavit–Hartenberg parameters of the links (modified; the axis is z)"
    parameters = plain_table(title, "link", "parent", "alpha, °", "a, m", "d, m", "theta, °")
    for i, link in enumerate(robot.links, start=1):
        carried = (links[i - 1]["name"], links[i - 1]["parent"])
        if link.pose:
            angles = _listed([float(angle) for angle in link.pose.rpy_deg])
            poses.add_row(*carried, _listed(link.pose.xyz), angles, _direction(link.axis))
        else:
            step = joint_pose(robot, i).xyz[0], link.d
            numbers = (float(link.alpha_deg), *step, float(link.theta_deg))
            parameters.add_row(*carried, *map(number, numbers))
    yield from (poses, parameters)
    names = ("rotor", "on", "position, m", "direction", "drag, m", "limits")
    rows = [
        [
            *(rotor["name"], rotor["on"], _short(rotor["position"])),
            *(_direction(rotor["direction"]), number(rotor["drag"])),
            _range(rotor["limits"] or (None, None), "N"),
        ]
        for rotor in rotors[:_MOST_LISTED]
    ]
    if len(rotors) > _MOST_LISTED:
        rows.append(["…", f"{len(rotors) - _MOST_LISTED} more; --json lists all"])
    yield plain_table("\nRotors", *names, rows=rows)
    rows = [
        [frame["name"], frame["on"], _short(frame["xyz"]), _short(frame["rpy_deg"])]
        for frame in data["frames"]
    ]
    yield plain_table("\nFrames", "frame", "on", "position, m", "roll, pitch, yaw, °", rows=rows)
    rows = [
        [
            *(row["name"], row["type"], row["frame"], row["to"] or "world"),
            *(_short(row["xyz"]), ", ".join(row["rows"])),
        ]
        for row in data["constraints"]
    ]
    names = ("constraint", "type", "frame", "anchor on", "at, m", "rows")
    yield plain_table("\nConstraints", *names, rows=rows)


def _print_actuators(robot: Robot, console: Console) -> None:
    """Print numbers of rotors, servos, friction and battery, a line for all that have the same."""
    parts: list[tuple[str, str, Part | None]] = []
    parts += [("rotor", rotor_label(robot, k), x) for k, x in enumerate(robot.thrusters, start=1)]
    for i in robot.gearing:
        link, name = robot.links[i - 1], link_label(robot, i)
        parts += [("servo of", name, link.servo), ("friction of", name, link.friction)]
        parts += [("motor of", name, link.motor)]
    alike: dict[tuple[str, str], list[str]] = {}
    for part_kind, name, part in (*parts, ("", "battery", robot.battery)):
        if part and (keys := changed_keys(part, *_IN_TABLE)):
            values = (_listed(x if isinstance(x, tuple) else (x,)) for x in keys.values())
            text = "; ".join(map(" ".join, zip(keys, values, strict=True)))
            alike.setdefault((part_kind, text), []).append(name)
    note = "; max_thrust and thrust_constant are shown as thrust_curve" * any(
        "_curve" in x for _, x in alike
    )
    if alike:
        console.print(f"\nActuators, by the keys of the robot file (SI units){note}")
    for (part_kind, text), names in alike.items():
        kind = "rotors" if part_kind == "rotor" and len(names) > 1 else part_kind
        console.print(f"{kind} {_numbered('', names, 0, '').strip()}: {text}".strip(), markup=False)


def _listed(values: Sequence[float | str]) -> str:
    return ", ".join(number(x) if isinstance(x, float) else json.dumps(x) for x in values)


def _cell(value: float | str | None) -> str:
    return "-" if value is None else value if isinstance(value, str) else number(value)


def _short(values: Sequence[float]) -> str:
    return ", ".join(f"{value + 0.0:.3g}" for value in values)


def _direction(vector: Sequence[float]) -> str:
    """A direction as robot files have it: x, -y, or components."""
    for name, axis in SIGNED_AXES.items():
        if np.allclose(vector, axis, rtol=0.0, atol=1e-12):
            return name
    return _short(vector)


def _range(bounds: Sequence[float | None], unit: str) -> str:
    """Limits in words, such as "0 … 15 N"."""
    low, high = bounds
    if low is None:
        return "-" if high is None else f"≤ {high:.3g} {unit}"
    if high is None:
        return f"≥ {low:.3g} {unit}"
    return f"±{high:.3g} {unit}" if low == -high else f"{low:.3g} … {high:.3g} {unit}"


def _facts(description: Description) -> dict[str, Any]:
    """All that needs no derivation."""
    robot = description.robot
    motors, hint = arrangement(robot), tilt_hint(robot)
    return {
        "name": robot.name,
        "rotors": robot.rotors,
        "links": len(robot.links),
        "attitude": robot.base.kind,
        "origin": robot.base.origin,
        **_machine_facts(robot),
        "chains": [
            asdict(chain)
            | {"massive": chain.massive, "constrained": chain.is_constrained}
            | {"places": list(places)}
            for chain, places in zip(decompose(robot), coupling_map(robot), strict=True)
        ],
        "coordinates": [asdict(c) for c in description.coordinates],
        "velocities": [asdict(c) for c in description.velocities],
        "inputs": [asdict(c) for c in description.inputs],
        "arrangement": {
            "rank": motors.rank,
            "condition": motors.condition if motors.rank == 6 else None,
            "missing": list(motors.missing),
            "moved_by_joints": [rotor_label(robot, k) for k in carried_rotors(robot)],
            "ranks_in_motion": ranks_in_motion(robot),
            "free": ["attitude", *(coordinate_of(robot, i) for i in robot.moving)],
            "tilt_hint": asdict(hint) | {"text": hint.text()} if hint else None,
        },
    }


def _derived_facts(robot: Robot, options: argparse.Namespace) -> dict[str, Any]:
    """Rows of the hybrid system, the chains that add to each entry of I_H, operations."""
    from gibbs_codegen.derivation.derive import derive  # It imports SymPy.
    from gibbs_codegen.derivation.hybrid import filled_entries

    functions = ["default", *(options.functions or robot_argument.functions_of(options.robot))]
    with terminal.progress() as progress:
        model = derive(
            robot, progress=progress, derivatives=options.derivatives or False, functions=functions
        )
    pattern = filled_entries(robot).matrix
    return {
        "hybrid_rows": _hybrid_rows(model, pattern),
        "operations": {
            function.name: {"total": function.operations.total, **asdict(function.operations)}
            for function in model.program.functions
        },
        "hybrid_pattern": [[list(chains) for chains in row] for row in pattern],
    }


def _hybrid_rows(model: Model, pattern: Filling) -> list[dict[str, Any]]:
    """For each row of the hybrid system: its unknown, the chains that add there, its inputs."""
    from gibbs_codegen.program.nodes import Number

    (output,) = model.program.function("hybrid_input_matrix").outputs
    width, first = output.shape[1], first_row(model.robot)
    names = [c.name for c in model.description.inputs]
    rows = []
    for place, unknown in enumerate(model.description.hybrid_coordinates):
        adding = sorted({number for entry in pattern[place] for number in entry})
        entries = output.entries[place * width : (place + 1) * width]
        acting = [n for n, e in zip(names, entries, strict=True) if e != Number(0.0)]
        row = {"row": first + place, "unknown": unknown.name}
        rows.append(row | {"chains": adding, "inputs": acting})
    return rows


def _print_report(description: Description, data: dict[str, Any], console: Console) -> None:
    """Print the report of a robot in a readable layout."""
    robot = description.robot
    kind = "attitude" if robot.base.moves_freely else "motion"
    console.print(
        f"[bold]{data['name']}[/bold]: {counted(data['rotors'], 'rotor')}, "
        f"{counted(data['links'], 'link')}, {data['mass']:.6g} kg, "
        f"{kind} {data['attitude']}, origin {data['origin']}"
    )
    if not robot.base.pose.is_identity:
        xyz, turn = _listed(robot.base.pose.xyz), ", ".join(map(str, robot.base.pose.rpy_deg))
        console.print(f"base at {xyz} m, turned by {turn}° (roll, pitch, yaw)")
    _print_machine(robot, data, console)
    _print_actuators(robot, console)
    for link in data["link_list"]:
        if gear := link["gear"]:
            terms = gear_terms(gear["ratios"], gear["offset"])
            console.print(f"gear of {link['name']}: {terms}", markup=False)
    if robot.base.moves_freely:
        _print_arrangement(data["arrangement"], console)
    # A rigid base by itself is one chain, of which there is nothing to tell.
    hybrid = bool(robot.links or robot.base.rotors)
    if hybrid:
        print_table(_chain_table(robot, data), console)
    print_table(_coordinate_table("Coordinates q", description.coordinates), console)
    if description.layout.turns_with_base:
        print_table(_coordinate_table("Velocities v", description.velocities), console)
    print_table(_coordinate_table("Inputs u", description.inputs), console)
    if "operations" not in data:
        return
    if hybrid:
        title = "\nRows of the hybrid system (eq. 18)"
        table = plain_table(
            title, "row", "unknown", "chains that add there", "inputs that act there"
        )
        rotors = data["rotors"]
        thrusts = [entry["name"] for entry in data["inputs"][:rotors]]
        for row in data["hybrid_rows"]:
            acting = row["inputs"]
            if rotors > 1 and acting[:rotors] == thrusts:
                acting = ["all thrusts", *acting[rotors:]]
            cells = (row["unknown"], _ranges(row["chains"]), ", ".join(acting) or "-")
            table.add_row(str(row["row"]), *cells)
        print_table(table, console)
        _print_pattern(data, console)
    names = ("function", "total", "+", "−", "×", "÷", "√", "sin–cos", "atan2")
    rows = [[name, *map(str, counts.values())] for name, counts in data["operations"].items()]
    table = plain_table("\nOperations per call", *names, rows=rows)
    for column in table.columns[1:]:
        column.justify = "right"
    print_table(table, console)


def _chain_table(robot: Robot, data: dict[str, Any]) -> Table:
    table = plain_table(
        "\nOpen chains (eq. 1)", "chain", "bodies", "mass of", "thrust of", "equations", "held by"
    )
    rotors = data["rotors"]
    # With virtual bodies where the base is made of arms.
    virtual, root = (["-1", "0"], "1") if robot.base.rotors else ([], "base")
    for chain in data["chains"]:
        rod = [str(chain["rod"])] if chain["rod"] else []
        bodies = [*virtual, root, *rod, *(_link(robot, i) for i in chain["path"])]
        carried = [*rod, *(_link(robot, i) for i in chain["own"])]
        massive = [root, *carried] if chain["has_core"] else carried
        table.add_row(
            str(chain["number"]),
            " → ".join(bodies),
            _numbered("arm", massive, len(bodies), "all its bodies"),
            _numbered(
                "motor", [rotor_label(robot, k) for k in chain["motors"]], rotors, "all rotors"
            ),
            str(len(chain["coordinates"])),
            ", ".join(chain["unknowns"][len(chain["coordinates"]) :]) or "-",
        )
    return table


def _link(robot: Robot, i: int) -> str:
    """The label of a link: its number as an arm, or its name."""
    named = robot.links[i - 1].name or not robot.base.rotors
    return link_label(robot, i) if named else str(robot.rotors + i)


def _numbered(kind: str, labels: Sequence[str], count: int, whole: str) -> str:
    """Bodies or rotors by their labels, numbers after `kind`; `whole` where these are all."""
    if labels and all(map(str.isdigit, labels)):
        return f"{kind} {_ranges([*map(int, labels)])}"
    return whole if len(labels) == count > 1 else ", ".join(labels) or "-"


def _coordinate_table(title: str, coordinates: tuple[Coordinate, ...]) -> Table:
    rows = ([str(i), c.name, c.unit, c.meaning] for i, c in enumerate(coordinates))
    return plain_table(f"\n{title}", "", "name", "unit", "meaning", rows=rows)


def _ranges(numbers: Sequence[int]) -> str:
    """Chain numbers; three or more that follow each other by the first and the last."""
    first, last = numbers[0], numbers[-1]
    if len(numbers) > 2 and last - first == len(numbers) - 1:
        return f"{first} … {last}"
    return ", ".join(map(str, numbers))


def _print_pattern(data: dict[str, Any], console: Console) -> None:
    """Print I_H as a picture: the chain that fills an entry, Σ for several, · for none."""
    unknowns, width = data["hybrid_rows"], len(str(len(data["chains"])))
    room = max(13, *(len(row["unknown"]) for row in unknowns))
    # Each line has row, unknown, and a mark for each column.
    if 5 + room + len(unknowns) * (width + 1) > console.width:
        console.print(f"\nHybrid matrix: wider than {console.width} columns; --json shows it")
        return
    lines = ["\nHybrid matrix: which chain fills each entry (Σ: several; ·: zero in every posture)"]
    for row, entries in zip(unknowns, data["hybrid_pattern"], strict=True):
        marks = []
        for chains in entries:
            mark = "·" if not chains else str(chains[0]) if len(chains) == 1 else "Σ"
            marks.append(f"{mark:>{width}}")
        lines.append(f"{row['row']:>4} {row['unknown']:<{room}} {' '.join(marks)}")
    console.print(Text("\n".join(lines), no_wrap=True, overflow="ignore"))


def _print_arrangement(motors: dict[str, Any], console: Console) -> None:
    if motors["rank"] == 6:
        console.print(
            f"\nRotors: rank 6 of 6, condition number {motors['condition']:.4g} "
            "(N and N m about the base centre)"
        )
    elif motors["rank"]:
        console.print(
            f"\nRotors: rank {motors['rank']} of 6, so the base is underactuated; the thrusts "
            "produce no force or torque along"
        )
        for direction in motors["missing"]:
            console.print(f"  {direction}", highlight=False)
    if moved := motors["moved_by_joints"]:
        least, most = motors["ranks_in_motion"]
        ranks = f"{least} to {most}" if most > least else str(most)
        console.print(
            f"These values hold with the joints at zero. Joints move rotors {', '.join(moved)}; "
            f"elsewhere the rank is {ranks}."
        )
    varied, names = "nothing" if motors["rank"] == 6 else "the attitude", ", ".join(motors["free"])
    console.print(
        f"`trim` varies {varied}; its argument `free` may name any of {names}", markup=False
    )
    if motors["tilt_hint"]:
        console.print(f"Hint: {motors['tilt_hint']['text']}")
