"""What `info` says of a robot: as plain data, and laid out for a terminal."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gibbs_codegen.cli.terminal import plain_table
from gibbs_codegen.derivation.filling import filled_matrix
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Number
from gibbs_codegen.program.operations import count_operations
from gibbs_codegen.robot.balance import balance, balance_lines, lopsided
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
from gibbs_codegen.robot.thrusters import arrangement, tilt_hint


def report(model: Model) -> dict[str, Any]:
    """Everything that `info` shows.

    Args:
        model: The derived robot.

    Returns:
        Values that JSON can hold.
    """
    return _facts(model) | {"hybrid_pattern": _pattern(model.robot)}


def _facts(model: Model) -> dict[str, Any]:
    """All but the pattern of the hybrid system, which takes long for very many rotors."""
    robot, motors, hint = model.robot, arrangement(model.robot), tilt_hint(model.robot)
    base = balance(robot)
    warning = lopsided(robot, base)
    return {
        "name": robot.name,
        "rotors": robot.rotors,
        "links": len(robot.links),
        "attitude": robot.base.attitude,
        "origin": robot.base.origin,
        "mass": robot.total_mass,
        "base": asdict(base),
        "warnings": [warning] if warning else [],
        "chains": [
            {**asdict(chain), "constrained": chain.is_constrained, "places": list(places)}
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
    """Print the report in a readable layout.

    Args:
        model: The derived robot.
        console: Where to print.
    """
    data = _facts(model)
    console.print(
        f"[bold]{data['name']}[/bold]: {data['rotors']} rotors, {data['links']} links, "
        f"{data['mass']:.6g} kg, attitude {data['attitude']}, origin {data['origin']}"
    )
    for line in balance_lines(balance(model.robot)):
        console.print(line)
    for warning in data["warnings"]:
        console.print(f"warning: {warning}", style="bold", markup=False)
    console.print(_chain_table(data))
    console.print(_coordinate_table("Coordinates q", reduced_coordinates(model.robot)))
    if model.robot.base.attitude == QUATERNION:
        console.print(_coordinate_table("Velocities v", velocities(model.robot)))
    console.print(_coordinate_table("Inputs u", inputs(model.robot)))
    console.print(_row_table(data))
    if _pattern_width(data) <= console.width:
        console.print(_pattern_text(data, _pattern(model.robot)))
    else:
        console.print(f"\nHybrid matrix: wider than {console.width} columns; --json shows it")
    _print_arrangement(data["arrangement"], console)
    console.print(_operation_table(data))


def _chain_table(data: dict[str, Any]) -> Table:
    table = plain_table(
        "\nOpen chains (eq. 1)", "chain", "arms", "mass of", "thrust of", "equations", "held by"
    )
    for chain in data["chains"]:
        table.add_row(
            str(chain["number"]),
            " → ".join(map(str, chain["links"])),
            f"arm {', '.join(map(str, chain['massive']))}" if chain["massive"] else "-",
            f"motor {', '.join(map(str, chain['motors']))}" if chain["motors"] else "-",
            str(len(chain["coordinates"])),
            chain["unknowns"][-1] if chain["constrained"] else "-",
        )
    return table


def _coordinate_table(title: str, coordinates: tuple[Coordinate, ...]) -> Table:
    table = plain_table(f"\n{title}", "", "name", "unit", "meaning")
    for i, coordinate in enumerate(coordinates):
        table.add_row(str(i), coordinate.name, coordinate.unit, coordinate.meaning)
    return table


def _row_table(data: dict[str, Any]) -> Table:
    title = "\nRows of the hybrid system (eq. 18)"
    table = plain_table(title, "row", "unknown", "chains that add there", "inputs that act there")
    for row in data["hybrid_rows"]:
        acting = ", ".join(row["inputs"]) or "-"
        table.add_row(str(row["row"]), row["unknown"], _ranges(row["chains"]), acting)
    return table


def _ranges(numbers: list[int]) -> str:
    """Chain numbers; those of a row are either one or all."""
    return f"{numbers[0]} … {numbers[-1]}" if len(numbers) > 1 else str(numbers[0])


def _pattern_width(data: dict[str, Any]) -> int:
    """Letters of a line of the pattern: row, unknown, and a mark for each column."""
    return 18 + len(data["hybrid_rows"]) * (len(str(data["rotors"])) + 1)


def _pattern_text(data: dict[str, Any], pattern: list[list[list[int]]]) -> Text:
    """I_H as a picture: the chain that fills an entry, Σ where several do, · where none does."""
    width = len(str(data["rotors"]))
    lines = ["\nHybrid matrix: which chain fills an entry (Σ: several, ·: none in any posture)"]
    for row, entries in zip(data["hybrid_rows"], pattern, strict=True):
        marks = []
        for chains in entries:
            mark = "·" if not chains else str(chains[0]) if len(chains) == 1 else "Σ"
            marks.append(f"{mark:>{width}}")
        lines.append(f"{row['row']:>4} {row['unknown']:<13} {' '.join(marks)}")
    return Text("\n".join(lines), no_wrap=True, overflow="ignore")


def _print_arrangement(motors: dict[str, Any], console: Console) -> None:
    if motors["rank"] == 6:
        console.print(
            f"\nMotor arrangement: rank 6 of 6, condition number {motors['condition']:.4g} "
            "(N and N m about the base centre)"
        )
    else:
        console.print(
            f"\nMotor arrangement: rank {motors['rank']} of 6, so the base is underactuated; the "
            "thrusts produce no wrench along"
        )
        for direction in motors["missing"]:
            console.print(f"  {direction}", highlight=False)
    if motors["tilt_hint"]:
        console.print(f"Hint: {motors['tilt_hint']['text']}")


def _operation_table(data: dict[str, Any]) -> Table:
    table = plain_table(
        "\nOperations per call", "function", "total", "+", "−", "×", "÷", "√", "sin–cos pairs"
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for name, counts in data["operations"].items():
        table.add_row(name, *map(str, counts.values()))
    return table
