"""What `info` says of a robot: as plain data, and laid out for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gibbs_codegen.cli.machine_report import machine_facts, print_machine
from gibbs_codegen.cli.terminal import plain_table, print_table
from gibbs_codegen.derivation.filling import filled_matrix
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Number
from gibbs_codegen.program.operations import count_operations
from gibbs_codegen.robot.chains import coupling_map, decompose
from gibbs_codegen.robot.coordinates import (
    Coordinate,
    hybrid_coordinates,
    inputs,
    reduced_coordinates,
    velocities,
)
from gibbs_codegen.robot.layout import QUATERNION
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import link_label, rotor_label
from gibbs_codegen.robot.thrusters import (
    arrangement,
    carried_rotors,
    ranks_in_motion,
    tilt_hint,
)


def report(model: Model) -> dict[str, Any]:
    """Everything that `info` shows of a derived robot, in values that JSON can hold."""
    return _facts(model) | {"hybrid_pattern": _pattern(model.robot)}


def _facts(model: Model) -> dict[str, Any]:
    """All but the pattern of the hybrid system, which takes long for very many rotors."""
    robot, motors, hint = model.robot, arrangement(model.robot), tilt_hint(model.robot)
    return {
        "name": robot.name,
        "rotors": robot.rotors,
        "links": len(robot.links),
        "attitude": robot.base.attitude,
        "origin": robot.base.origin,
        **machine_facts(robot),
        "chains": [
            asdict(chain)
            | {
                "massive": chain.massive,
                "constrained": chain.is_constrained,
                "places": list(places),
            }
            for chain, places in zip(decompose(robot), coupling_map(robot), strict=True)
        ],
        "coordinates": [asdict(c) for c in reduced_coordinates(robot)],
        "velocities": [asdict(c) for c in velocities(robot)],
        "inputs": [asdict(c) for c in inputs(robot)],
        "hybrid_rows": _hybrid_rows(model),
        "arrangement": {
            "rank": motors.rank,
            "condition": motors.condition if motors.rank == 6 else None,
            "missing": list(motors.missing),
            "moved_by_joints": [rotor_label(robot, k) for k in carried_rotors(robot)],
            "ranks_in_motion": ranks_in_motion(robot),
            "tilt_hint": asdict(hint) | {"text": hint.text()} if hint else None,
        },
        "operations": {
            function.name: {"total": counts.total, **asdict(counts)}
            for function in model.program.functions
            for counts in [count_operations(function.nodes())]
        },
    }


def _pattern(robot: Robot) -> list[list[list[int]]]:
    """For each entry of I_H, the chains that add to it (Figs. 6–9)."""
    return [[list(chains) for chains in row] for row in filled_matrix(robot)]


def _hybrid_rows(model: Model) -> list[dict[str, Any]]:
    """For each row of the hybrid system: its unknown, the chains that add there, its inputs."""
    robot = model.robot
    (output,) = model.program.function("hybrid_input_matrix").outputs
    width = output.shape[1]
    names = [c.name for c in inputs(robot)]
    chains = list(zip(decompose(robot), coupling_map(robot), strict=True))
    rows = []
    for place, unknown in enumerate(hybrid_coordinates(robot)):
        adding = [chain.number for chain, places in chains if place in places]
        entries = output.entries[place * width : (place + 1) * width]
        acting = [n for n, e in zip(names, entries, strict=True) if e != Number(0.0)]
        rows.append({"row": place - 1, "unknown": unknown.name, "chains": adding, "inputs": acting})
    return rows


def print_report(model: Model, console: Console) -> None:
    """Print the report of a derived robot in a readable layout."""
    data, robot = _facts(model), model.robot
    console.print(
        f"[bold]{data['name']}[/bold]: {data['rotors']} rotors, {data['links']} links, "
        f"{data['mass']:.6g} kg, attitude {data['attitude']}, origin {data['origin']}"
    )
    print_machine(robot, data, console)
    _print_arrangement(data["arrangement"], console)
    # A rigid base by itself is one chain, of which there is nothing to tell.
    hybrid = bool(robot.links or robot.base.rotors)
    if hybrid:
        print_table(_chain_table(robot, data), console)
    print_table(_coordinate_table("Coordinates q", reduced_coordinates(robot)), console)
    if robot.base.attitude == QUATERNION:
        print_table(_coordinate_table("Velocities v", velocities(robot)), console)
    print_table(_coordinate_table("Inputs u", inputs(robot)), console)
    if hybrid:
        print_table(_row_table(data), console)
    if hybrid and _pattern_width(data) <= console.width:
        console.print(_pattern_text(data, _pattern(robot)))
    elif hybrid:
        console.print(f"\nHybrid matrix: wider than {console.width} columns; --json shows it")
    print_table(_operation_table(data), console)


def _chain_table(robot: Robot, data: dict[str, Any]) -> Table:
    table = plain_table(
        "\nOpen chains (eq. 1)", "chain", "bodies", "mass of", "thrust of", "equations", "held by"
    )
    for chain in data["chains"]:
        table.add_row(
            str(chain["number"]),
            " → ".join(_way(robot, chain)),
            _each("arm", _massive(robot, chain), len(_way(robot, chain))),
            _each("motor", [rotor_label(robot, k) for k in chain["motors"]], data["rotors"]),
            str(len(chain["coordinates"])),
            ", ".join(chain["unknowns"][len(chain["coordinates"]) :]) or "-",
        )
    return table


def _way(robot: Robot, chain: dict[str, Any]) -> list[str]:
    """The bodies of a chain in order; the virtual ones where the base is made of arms."""
    before = ["-1", "0"] if robot.base.rotors else []
    rod = [str(chain["rod"])] if chain["rod"] else []
    return [*before, _root(robot), *rod, *(_link(robot, i) for i in chain["path"])]


def _massive(robot: Robot, chain: dict[str, Any]) -> list[str]:
    """The bodies that have their mass in a chain."""
    root = [_root(robot)] if chain["has_core"] else []
    rod = [str(chain["rod"])] if chain["rod"] else []
    return [*root, *rod, *(_link(robot, i) for i in chain["own"])]


def _root(robot: Robot) -> str:
    return "1" if robot.base.rotors else "base"


def _link(robot: Robot, i: int) -> str:
    """What a link is called: by its number as an arm, or by its name."""
    named = robot.links[i - 1].name or not robot.base.rotors
    return link_label(robot, i) if named else str(robot.rotors + i)


def _each(what: str, labels: Sequence[str], count: int) -> str:
    """Bodies or rotors of `count` by their labels, or "all"; what they are is said of numbers."""
    if labels and all(map(str.isdigit, labels)):
        return f"{what} {_ranges([*map(int, labels)])}"
    return "all" if len(labels) == count > 1 else ", ".join(labels) or "-"


def _coordinate_table(title: str, coordinates: tuple[Coordinate, ...]) -> Table:
    table = plain_table(f"\n{title}", "", "name", "unit", "meaning")
    for i, coordinate in enumerate(coordinates):
        table.add_row(str(i), coordinate.name, coordinate.unit, coordinate.meaning)
    return table


def _row_table(data: dict[str, Any]) -> Table:
    title = "\nRows of the hybrid system (eq. 18)"
    table = plain_table(title, "row", "unknown", "chains that add there", "inputs that act there")
    thrusts = ", ".join(entry["name"] for entry in data["inputs"][: data["rotors"]])
    for row in data["hybrid_rows"]:
        acting = ", ".join(row["inputs"]) or "-"
        if data["rotors"] > 1:
            acting = acting.replace(thrusts, "all thrusts")
        table.add_row(str(row["row"]), row["unknown"], _ranges(row["chains"]), acting)
    return table


def _ranges(numbers: Sequence[int]) -> str:
    """Chain numbers; three or more that follow each other by the first and the last."""
    first, last = numbers[0], numbers[-1]
    if len(numbers) > 2 and last - first == len(numbers) - 1:
        return f"{first} … {last}"
    return ", ".join(map(str, numbers))


def _label_width(data: dict[str, Any]) -> int:
    return max(13, *(len(row["unknown"]) for row in data["hybrid_rows"]))


def _pattern_width(data: dict[str, Any]) -> int:
    """Letters of a line of the pattern: row, unknown, and a mark for each column."""
    column = len(str(len(data["chains"]))) + 1
    return 5 + _label_width(data) + len(data["hybrid_rows"]) * column


def _pattern_text(data: dict[str, Any], pattern: list[list[list[int]]]) -> Text:
    """I_H as a picture: the chain that fills an entry, Σ where several do, · where none does."""
    width, room = len(str(len(data["chains"]))), _label_width(data)
    lines = ["\nHybrid matrix: which chain fills an entry (Σ: several, ·: none in any posture)"]
    for row, entries in zip(data["hybrid_rows"], pattern, strict=True):
        marks = []
        for chains in entries:
            mark = "·" if not chains else str(chains[0]) if len(chains) == 1 else "Σ"
            marks.append(f"{mark:>{width}}")
        lines.append(f"{row['row']:>4} {row['unknown']:<{room}} {' '.join(marks)}")
    return Text("\n".join(lines), no_wrap=True, overflow="ignore")


def _print_arrangement(motors: dict[str, Any], console: Console) -> None:
    if motors["rank"] == 6:
        console.print(
            f"\nRotors: rank 6 of 6, condition number {motors['condition']:.4g} "
            "(N and N m about the base centre)"
        )
    elif motors["rank"]:
        console.print(
            f"\nRotors: rank {motors['rank']} of 6, so the base is underactuated; the thrusts "
            "produce no wrench along"
        )
        for direction in motors["missing"]:
            console.print(f"  {direction}", highlight=False)
    if moved := motors["moved_by_joints"]:
        least, most = motors["ranks_in_motion"]
        ranks = f"{least} to {most}" if most > least else str(most)
        console.print(
            f"This is with the joints at zero. They move rotors {', '.join(moved)}; elsewhere the "
            f"rank is {ranks}."
        )
    if motors["tilt_hint"]:
        console.print(f"Hint: {motors['tilt_hint']['text']}")


def _operation_table(data: dict[str, Any]) -> Table:
    table = plain_table(
        "\nOperations per call", "function", "total", "+", "−", "×", "÷", "√", "sin–cos", "atan2"
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for name, counts in data["operations"].items():
        table.add_row(name, *map(str, counts.values()))
    return table
