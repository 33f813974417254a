"""What `info` says of a robot: as plain data, and laid out for a terminal."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gibbs_codegen.arrangement import arrangement
from gibbs_codegen.chains import coupling_map, decompose
from gibbs_codegen.coordinates import Coordinate, hybrid_coordinates, inputs, reduced_coordinates
from gibbs_codegen.filling import filled_matrix
from gibbs_codegen.model import Model
from gibbs_codegen.program import Number, count_operations

# A wider pattern does not fit a terminal; --json has it for any size.
_WIDEST_PATTERN = 40


def report(model: Model) -> dict[str, Any]:
    """Everything that `info` prints, as values that JSON can hold."""
    robot, motors = model.robot, arrangement(model.robot)
    return {
        "name": robot.name,
        "rotors": robot.rotors,
        "links": len(robot.links),
        "attitude": robot.base.attitude,
        "origin": robot.base.origin,
        "mass": robot.total_mass,
        "chains": [
            {**asdict(chain), "constrained": chain.is_constrained, "places": list(places)}
            for chain, places in zip(decompose(robot), coupling_map(robot), strict=True)
        ],
        "coordinates": [asdict(c) for c in reduced_coordinates(robot)],
        "inputs": [asdict(c) for c in inputs(robot)],
        "hybrid_rows": _hybrid_rows(model),
        "hybrid_pattern": [[list(chains) for chains in row] for row in filled_matrix(robot)],
        "arrangement": {
            "rank": motors.rank,
            "condition": motors.condition if motors.rank == 6 else None,
            "missing": motors.missing_texts(),
        },
        "operations": {
            function.name: {"total": counts.total, **asdict(counts)}
            for function in model.program.functions
            for counts in [count_operations(function.nodes())]
        },
    }


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
    """The report in a readable layout."""
    data = report(model)
    console.print(
        f"[bold]{data['name']}[/bold]: {data['rotors']} rotors, {data['links']} links, "
        f"{data['mass']:.6g} kg, attitude {data['attitude']}, origin {data['origin']}"
    )
    console.print(_chain_table(data))
    console.print(_coordinate_table("Coordinates q", reduced_coordinates(model.robot)))
    console.print(_coordinate_table("Inputs u", inputs(model.robot)))
    console.print(_row_table(data))
    if len(data["hybrid_rows"]) <= _WIDEST_PATTERN:
        console.print(_pattern_text(data))
    _print_arrangement(data["arrangement"], console)
    console.print(_operation_table(data))


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, header_style="dim", pad_edge=False)
    for column in columns:
        table.add_column(column)
    return table


def _chain_table(data: dict[str, Any]) -> Table:
    table = _table(
        "\nOpen chains (eq. 1)", "chain", "arms", "mass of", "thrust of", "equations", "constrained"
    )
    for chain in data["chains"]:
        table.add_row(
            str(chain["number"]),
            " → ".join(map(str, chain["links"])),
            ", ".join(f"arm {k}" for k in chain["massive"]) or "-",
            ", ".join(f"motor {k}" for k in chain["motors"]) or "-",
            str(len(chain["coordinates"])),
            f"by {chain['unknowns'][-1]}" if chain["constrained"] else "-",
        )
    return table


def _coordinate_table(title: str, coordinates: tuple[Coordinate, ...]) -> Table:
    table = _table(f"\n{title}", "", "name", "unit", "meaning")
    for i, coordinate in enumerate(coordinates):
        table.add_row(str(i), coordinate.name, coordinate.unit, coordinate.meaning)
    return table


def _row_table(data: dict[str, Any]) -> Table:
    title = "\nRows of the hybrid system (eq. 18)"
    table = _table(title, "row", "unknown", "chains that add there", "inputs that act there")
    for row in data["hybrid_rows"]:
        acting = ", ".join(row["inputs"]) or "-"
        table.add_row(str(row["row"]), row["unknown"], _ranges(row["chains"]), acting)
    return table


def _ranges(numbers: list[int]) -> str:
    """Chain numbers; those of a row are either one or all."""
    return f"{numbers[0]} … {numbers[-1]}" if len(numbers) > 1 else str(numbers[0])


def _pattern_text(data: dict[str, Any]) -> Text:
    """I_H as a picture: the chain that fills an entry, Σ where several do, · where none does."""
    width = len(str(data["rotors"]))
    lines = ["\nHybrid matrix: which chain fills an entry (Σ: several, ·: none in any posture)"]
    for row, entries in zip(data["hybrid_rows"], data["hybrid_pattern"], strict=True):
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
        return
    console.print(f"\nMotor arrangement: rank {motors['rank']} of 6; the thrusts cannot push along")
    for direction in motors["missing"]:
        console.print(f"  {direction}", highlight=False)


def _operation_table(data: dict[str, Any]) -> Table:
    table = _table(
        "\nOperations per call", "function", "total", "+", "−", "×", "÷", "√", "sin–cos pairs"
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for name, counts in data["operations"].items():
        table.add_row(
            name,
            str(counts["total"]),
            str(counts["additions"]),
            str(counts["subtractions"]),
            str(counts["multiplications"]),
            str(counts["divisions"]),
            str(counts["square_roots"]),
            str(counts["sine_cosine_pairs"]),
        )
    return table
