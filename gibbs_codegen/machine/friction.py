"""Dry friction of joints, which falls from static to coulomb, smooth about rest."""

from __future__ import annotations

from collections.abc import Mapping

from gibbs_codegen.arrays.nodes import Node, square_root

# Share of a friction's velocity in which it is smooth about rest.
_SMOOTH = 0.1


def friction(numbers: Mapping[str, Node], v: Node) -> Node:
    """The friction against a rate, N m or N, from numbers by the keys of the robot file."""
    coulomb, velocity = numbers["coulomb"], numbers["velocity"]
    square, smooth = v * v, _SMOOTH * velocity
    direction = v / square_root(square + smooth * smooth)
    fallen = 1.0 / (1.0 + square / (velocity * velocity))
    return direction * (coulomb + (numbers["static"] - coulomb) * fallen)
