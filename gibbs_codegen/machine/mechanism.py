"""Loops over joints that nothing drives, of which laws lead the other joints, as array programs.

Their rows J a + b = 0 tell how the p free joints of a = d + F x move that nothing drives. By loop
forces λ these need no torque, and the other joints bear what they would need:

    x = (J F)⁺ (-J d - b),    τ = τ_tree - Jᵀ λ,    (J F)ᵀ λ = Fᵀ τ_tree
"""

from __future__ import annotations

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, constant, solve

# Added to squares of levers, m² or 1, so that rows that say nothing leave joints as they are.
_LEAST = 1e-12


def closed(robot: Functions, q: Node, v: Node, a: Node) -> Node:
    """Accelerations (nv) with which loops stay closed, changed in free joints alone."""
    if not robot.leads_loops:
        return a
    rows, free, square = _levers(robot, q)
    bias = constant(robot.loop_rows) @ robot.constraint_bias(q, v)
    moved = solve(square, free.transposed @ -(rows @ a + bias))
    return a + constant(robot.free_joints.T) @ moved


def carried(robot: Functions, q: Node, force: Node) -> Node:
    """A generalised force (nv) that does the same where loops hold, without any at free joints."""
    if not robot.leads_loops:
        return force
    rows, free, square = _levers(robot, q)
    return force - rows.transposed @ (free @ solve(square, constant(robot.free_joints) @ force))


def _levers(robot: Functions, q: Node) -> tuple[Node, Node, Node]:
    """Rows J (l, nv) of loops, those of free joints (l, p), and their square (p, p)."""
    rows = constant(robot.loop_rows) @ robot.constraint_jacobian(q)
    if robot.leading is not None:
        rows = robot.leading * rows
    free = rows @ constant(robot.free_joints.T)
    return rows, free, free.transposed @ free + constant(_LEAST * np.eye(len(robot.free_joints)))
