"""Arguments and output shapes of the functions of every generated module.

Shapes are given by letters: q the coordinates, h the hybrid unknowns, u the inputs, k the points,
c the constrained joints; numbers stand for themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# States in a block of the C functions for batches: as many doubles as the widest registers hold.
LANES = 8

_FORMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "mass_matrix_and_residual": ("qv", ("qq", "q")),
    "mass_matrix": ("q", ("qq",)),
    "residual": ("qv", ("q",)),
    "input_matrix": ("q", ("qu",)),
    "forward_dynamics": ("qvu", ("q",)),
    "inverse_dynamics": ("qva", ("q",)),
    "hybrid_mass_matrix": ("q", ("hh",)),
    "hybrid_residual": ("qv", ("h",)),
    "hybrid_input_matrix": ("q", ("hu",)),
    "constraint_torques": ("qvau", ("c",)),
    "gibbs": ("qva", ("",)),
    "kinetic_energy": ("qv", ("",)),
    "potential_energy": ("q", ("",)),
    "positions": ("q", ("k3",)),
    "tip_pose": ("q", ("44",)),
    "tip_jacobian": ("q", ("6q",)),
    "tip_bias_acceleration": ("qv", ("6",)),
}


@dataclass(frozen=True)
class Signature:
    """A function's name, its arguments with their widths, and the shapes of its outputs."""

    name: str
    arguments: tuple[str, ...]
    widths: tuple[int, ...]
    shapes: tuple[tuple[int, ...], ...]


def signatures(coordinates: int, hybrid: int, inputs: int, points: int) -> list[Signature]:
    """Signatures of all functions of a module, given the lengths of what it lists."""
    lengths = {"q": coordinates, "h": hybrid, "u": inputs, "k": points}
    lengths["c"] = (hybrid - coordinates) // 2
    widths = dict.fromkeys("qva", coordinates) | {"u": inputs}
    return [
        Signature(
            name,
            tuple(arguments),
            tuple(widths[argument] for argument in arguments),
            tuple(_shape(form, lengths) for form in forms),
        )
        for name, (arguments, forms) in _FORMS.items()
    ]


def _shape(form: str, lengths: Mapping[str, int]) -> tuple[int, ...]:
    return tuple(int(letter) if letter.isdigit() else lengths[letter] for letter in form)
