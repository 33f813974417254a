"""Pinocchio's derivatives in C++ as contenders, on a free-flyer and in our coordinates."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from peers.build import function
from peers.contender import Contender
from peers.derivatives import FORWARD, INVERSE, DerivativeContender, FreeFlyer, by_oracle
from peers.pinocchio_peer import loaded, ways
from peers.tree import tree_of

from gibbs_codegen.robot.model import Robot

NAMES = {INVERSE: "inverse_dynamics_derivatives", FORWARD: "forward_dynamics_derivatives"}


def pinocchio_derivatives(robot: Robot, folder: Path) -> list[Contender]:
    """`computeRNEADerivatives` and `computeABADerivatives` in each of Pinocchio's coordinates."""
    tree, size = tree_of(robot), tree_of(robot).velocities
    found: list[Contender] = []
    for name, root, layout in ways(tree):
        copy = loaded(tree, "pinocchio_derivatives.cpp", folder, root)
        other = FreeFlyer(robot) if (root, tree.root) == ("quaternion", "xyz") else None
        for task, called in NAMES.items():
            found.append(
                DerivativeContender(
                    name,
                    task,
                    1,
                    function(copy, f"pinocchio_{called}"),
                    partial(other.inputs, task) if other else layout.inputs,
                    other.outputs if other else layout.derivatives,
                    function(copy, f"pinocchio_fetch_{called}", 2),
                    room=size + 3 * size**2,
                    right=partial(other.right if other else partial(by_oracle, robot), task),
                )
            )
    return found
