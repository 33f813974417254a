"""Signatures: the functions of the table with their sizes in one module."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gibbs_codegen.interface.table import ARGUMENTS, FUNCTIONS


@dataclass(frozen=True)
class Signature:
    """A function of one module: its arguments with their widths, and the shapes of its outputs."""

    name: str
    arguments: tuple[str, ...]
    widths: tuple[int, ...]
    shapes: tuple[tuple[int, ...], ...]


def module_signatures(module: Any) -> list[Signature]:
    """Signatures of the functions of a module.

    Args:
        module: A generated module, or what lists the same constants.

    Returns:
        The signatures, in the order of the table.
    """
    lists = (module.COORDINATES, module.VELOCITIES, module.HYBRID_COORDINATES)
    found = signatures(*map(len, (*lists, module.INPUTS, module.POINTS)))
    return [s for s in found if "tip" in module.POINTS or not s.name.startswith("tip_")]


def signatures(
    coordinates: int, velocities: int, hybrid: int, inputs: int, points: int
) -> list[Signature]:
    """Signatures of all functions, given the lengths of what a module lists.

    Args:
        coordinates: Number of COORDINATES.
        velocities: Number of VELOCITIES.
        hybrid: Number of HYBRID_COORDINATES.
        inputs: Number of INPUTS.
        points: Number of POINTS.

    Returns:
        The signatures, in the order of the table.
    """
    lengths = {"q": coordinates, "v": velocities, "h": hybrid, "u": inputs, "k": points}
    lengths["c"] = (hybrid - velocities) // 2
    found = []
    for row in FUNCTIONS.values():
        widths = tuple(lengths[ARGUMENTS[argument].width] for argument in row.arguments)
        shapes = tuple(output.sizes(lengths) for output in row.outputs)
        found.append(Signature(row.name, tuple(row.arguments), widths, shapes))
    return found
