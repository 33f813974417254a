"""Formulas, which can be differentiated, of control allocation that is computed by hand.

Bounded least squares searches which thrusts are at a limit. Once that is known, as it is from what
was found, the others solve linear equations: the formula has the same value and its derivatives.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    choose,
    constant,
    external,
    join,
    maximum,
    reshaped,
    solve,
    square_root,
    total,
    variable,
)

# Weight of small thrusts against the wrench, as a share of the norm of all wrenches.
PREFERENCE = 1e-5


def smallest_thrusts(columns: Node, wrench: Node) -> Node:
    """Thrusts (N) of least norm that come nearest to a wrench (6); `columns` (N, 6) are those of
    unit thrusts.
    """
    return external("smallest_thrusts", (columns.shape[0],), columns, wrench, formula=_smallest)


def nearest_thrusts(thrusts: Node, wrench: Node, columns: Node, least: Node, most: Node) -> Node:
    """Thrusts (N) or, where these exceed limits, those within them that come nearest to a wrench.

    `columns` (N, 6) are the wrenches of unit thrusts. It returns no numbers where it finds none.
    """
    arguments = (thrusts, wrench, columns, least, most)
    return external("nearest_thrusts", thrusts.shape, *arguments, formula=_nearest)


@cache
def _smallest(count: int) -> Program:
    """The formula of `smallest_thrusts`, where rotors command all that they can.

    These are six directions or, with fewer rotors, as many directions as there are rotors.
    """
    columns, wrench, bound = variable("columns", count, 6), variable("wrench", 6), _bound(count)
    if count < 6:
        thrusts = solve(columns @ columns.transposed, columns @ wrench)
    else:
        thrusts = columns @ solve(columns.transposed @ columns, wrench)
    return Program("smallest", (columns, wrench, bound), {"thrusts": thrusts})


@cache
def _nearest(count: int) -> Program:
    """The formula of `nearest_thrusts`: least squares for thrusts that are at no limit."""
    thrusts, least, most = (variable(name, count) for name in ("thrusts", "least", "most"))
    columns, wrench, bound = variable("columns", count, 6), variable("wrench", 6), _bound(count)
    # Torque is divided by the mean lever arm, so that it compares with force.
    force, torque = (total(x * x) for x in (columns.transposed[:3], columns.transposed[3:]))
    both = choose(force * torque, 0.0, force, 0.0)
    weight = square_root(choose(both, 0.0, force, 1.0) / choose(both, 0.0, torque, 1.0))
    weights = join(np.ones(3), weight * np.ones(3))
    weighed = columns * reshaped(weights, (1, 6))
    preference = PREFERENCE**2 * total(weighed * weighed)
    above, below = choose(bound, least, 1.0, 0.0), choose(most, bound, 1.0, 0.0)
    free = above * below
    held = choose(above, 0.5, most, least) * (1.0 - free)
    left = weights * wrench - weighed.transposed @ held
    column, row = reshaped(free, (count, 1)), reshaped(free, (1, count))
    diagonal = constant(np.eye(count)) * (preference * column + (1.0 - column))
    matrix = column * row * (weighed @ weighed.transposed) + diagonal
    nearest = solve(matrix, free * (weighed @ left)) + held
    return Program(
        "nearest",
        (thrusts, wrench, columns, least, most, bound),
        {"thrusts": choose(_excess(thrusts, least, most), 0.0, nearest, thrusts)},
    )


def _bound(count: int) -> Node:
    """The thrusts that were computed by hand; they tell which are at a limit."""
    return variable("found", count)


def _excess(thrusts: Node, least: Node, most: Node) -> Node:
    """The excess of thrusts beyond their limits, all of them together, N; 0 if none is."""
    over = maximum(thrusts - most, 0.0) + maximum(least - thrusts, 0.0)
    return total(over)
