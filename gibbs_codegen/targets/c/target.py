"""What the C templates are given: text only, every decision already taken."""

from __future__ import annotations

import textwrap
from typing import Any

from gibbs_codegen.interface import LANES
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import (
    names_in,
    total_mass,
)
from gibbs_codegen.robot.coordinates import (
    Coordinate,
    hybrid_coordinates,
    inputs,
    points,
    reduced_coordinates,
)
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.targets.c.function import CFunction
from gibbs_codegen.targets.c.statements import WIDTH, StatementPrinter
from gibbs_codegen.targets.documentation import attitude_text, coordinate_table
from gibbs_codegen.targets.printers import InfixPrinter


def context(model: Model, printer: InfixPrinter) -> dict[str, Any]:
    """Context of the C templates."""
    robot, program = model.robot, model.program
    values = program.prepared(model.defaults)
    used = {name for s in program.prepare for name in names_in(s.value)} | set(program.constants)
    functions = [CFunction(model, function, printer) for function in program.functions]
    return {
        "name": robot.name,
        "NAME": robot.name.upper(),
        "lanes": LANES,
        "convention_lines": _convention_lines(robot),
        "coordinate_lines": coordinate_table(reduced_coordinates(robot)),
        "hybrid_coordinate_lines": coordinate_table(hybrid_coordinates(robot)),
        "input_lines": coordinate_table(inputs(robot)),
        "point_lines": textwrap.wrap(", ".join(points(robot)), WIDTH - 8),
        "sizes": {
            "COORDINATES": len(reduced_coordinates(robot)),
            "HYBRID_COORDINATES": len(hybrid_coordinates(robot)),
            "INPUTS": len(inputs(robot)),
            "POINTS": len(points(robot)),
            "PARAMETERS": len(model.defaults),
        },
        "folded_lines": _folded_lines(model),
        "parameters": [
            {
                "macro": f"{robot.name}_{name}".upper(),
                "name": name,
                "unit": model.units[name],
                "value": printer.number(value),
            }
            for name, value in model.defaults.items()
        ],
        "places": [
            {"of": of, "macros": _place_macros(robot, letter, coordinates)}
            for letter, of, coordinates in (
                ("q", "q", reduced_coordinates(robot)),
                ("v", "v, and in a", reduced_coordinates(robot)),
                ("u", "u", inputs(robot)),
            )
        ],
        "constants": list(program.constants),
        "default_constants": [printer.number(values[name]) for name in program.constants],
        "parameter_loads": [
            f"const real {name} = parameters[{place}];"
            for place, name in enumerate(program.parameters)
            if name in used
        ],
        "prepare": StatementPrinter(printer, kind="STEPWISE real").declare_all(program.prepare),
        "total_mass": printer.expression(total_mass(program)),
        "sine_kinds": [
            {
                "name": "sine_cosine_one",
                "real": "real",
                "bits": "bits",
                "before": "/* Sine and cosine of one angle. */",
                "after": "",
            },
            {
                "name": "sine_cosine_quad",
                "real": "quad",
                "bits": "quad_bits",
                "before": "#ifdef QUAD",
                "after": "#endif",
            },
        ],
        "widest": max(map(len, program.inputs.values())),
        "functions": [function.context() for function in functions],
    }


def _place_macros(robot: Robot, letter: str, coordinates: tuple[Coordinate, ...]) -> list[str]:
    """Enumerators of the places in an argument; no parameter's begins with a single letter."""
    return [f"{robot.name}_{letter}_{c.name}".upper() for c in coordinates]


def _convention_lines(robot: Robot) -> list[str]:
    return textwrap.wrap(
        f"The attitude, from base arm 1's frame to the world, is {attitude_text(robot)}. Rates are "
        "plain time derivatives of the coordinates, not body rates. A thrust acts at its motor, "
        "along the direction that the robot file gives in the frame of the motor's arm.",
        WIDTH - 4,
    )


def _folded_lines(model: Model) -> list[str]:
    text = ", ".join(model.folded) or "nothing"
    return textwrap.wrap(f"Zero in the robot file and therefore folded away: {text}.", WIDTH - 6)
