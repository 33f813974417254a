"""Observers as array programs: what acts on a robot besides its inputs, where, and how hard.

The momentum p = M v gains momentum_rate + B u + τ, where τ are generalised forces that nobody
measures. The residual r follows them entry by entry, ṙ = gain (τ − r), as is known without an
acceleration and without an inverse of M (De Luca and Mattone, 2003):

    r⁺ = r + (1 − e^(−gain h)) ((p⁺ − p)/h − momentum_rate − B u − r)

That is exact for forces that stay as they are over the step h. Momentum rates are the mean of those
where the step begins and where it ends; u are the inputs that acted in between.

A wrench W on a frame makes τ = Jᵀ W. That which explains r best is (J w Jᵀ + d)⁻¹ J w r, with
weights w and a damping d that leaves small what r does not show. J is as late as r is, entry by
entry, so that a wrench that stays as it is is found while the robot moves. Joints feel what touches
all that they carry, so the last joints along each chain that feel something carry what is touched.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np

from gibbs_codegen.arrays.c_file import CFunction, Structure
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    absolute,
    choose,
    constant,
    join,
    maximum,
    reshaped,
    solve,
    variable,
    zeros,
)

# What programs here call that modules have on request only.
CALLED = ("momentum", "momentum_rate")
_MEMORY = Structure.kept(
    "observer",
    "State of the observer of generalised momentum.",
    momentum="M v at the last step",
    momentum_rate="rate of the momentum there, without the inputs",
    residual="generalised forces besides gravity, dampers, springs and inputs",
)
_OF_FRAME = Structure.kept(
    "frame_observer",
    "State of the estimate of a wrench on a frame.",
    late_jacobian="Jacobian of the frame, delayed as the residual is; initially that of the state",
)
_WORDS = {
    "init_momentum_observer": "Initialise the observer, at rest or in motion, with residual 0.",
    "momentum_observer_step": "Update the residual, which follows forces besides the inputs.",
    "wrench_of_residual": "Estimate the wrench on one frame that explains a residual.",
    "touched_by_residual": "1 for the base and each joint with a contact on what it carries, "
    "but not beyond a later joint; else 0.",
}
_EXPLAINED = {
    "u": "inputs since the last step, N and N m",
    "share": "weight of the new value, for each velocity: 1 - exp(-gain h)",
    "h": "time since the last step, s",
    "jacobian": "Jacobian of the frame, six rows, linear ones first",
    "weight": "for each velocity: one over the variance of the residual's entry",
    "damping": "for each entry of the wrench: one over its expected variance, above 0",
    "threshold": "for each velocity: bound of the residual's noise",
    "wrench": "force, N, and torque about the frame's origin, N m, world axes",
}


def momentum_observer(module: Any) -> dict[str, Program]:
    """Programs of an observer of generalised momentum, by name.

    Args:
        module: A loaded module with `momentum` and `momentum_rate`, or its `Functions`.

    Returns:
        `init_momentum_observer`: of q (nq) and v (nv) the memory of the observer, `momentum` and
        `momentum_rate` (nv), and a `residual` (nv) of 0.
        `momentum_observer_step`: of q, v, `u` (nu), the inputs since the last step, the memory, the
        `share` (nv) of what is new that counts, 1 − e^(−gain h), and the time `h`, s, since the
        last step, the same with the ending `_next`. The residual, N m or N, follows the forces that
        act besides gravity, dampers, springs and inputs, with a lag of 1/gain.
        `wrench_of_residual`: of the `jacobian` (6, nv) of a frame, `late_jacobian`, the memory,
        which begins as the same, the `residual` after the step, `share`, the `weight` (nv) of its
        entries and `damping` (6), above 0, the `wrench` (6), force, N, and torque, N m, about the
        frame's origin in world axes, that alone makes such a residual; and `late_jacobian_next`.
        `touched_by_residual`: of the `residual` and a `threshold` (nv) above which its entries are
        no noise, `touched` (1 + joints): 1 for the base, and for each joint, if something touches
        what it carries and no joint after it does; else 0. Not for robots with gears.

    Raises:
        MissingFunctionError: If the module was generated without these functions.
    """
    robot = module if isinstance(module, Functions) else Functions(module)
    n, (q, v), h = robot.space.velocities, robot.state(), variable("h", uniform=True)
    u, share = variable("u", robot.inputs), variable("share", n, uniform=True)
    momentum, rate, residual = (
        variable(name, n) for name in ("momentum", "momentum_rate", "residual")
    )
    momentum_next, rate_next = robot.momentum(q, v), robot.momentum_rate(q, v)
    known = 0.5 * (rate + rate_next) + robot.input_matrix(q) @ u
    felt = (momentum_next - momentum) / h - known
    begun = {"momentum_next": momentum_next, "momentum_rate_next": rate_next}
    moved = begun | {"residual_next": residual + share * (felt - residual)}
    inputs = q, v, u, momentum, rate, residual, share, h
    programs = [
        Program("init_momentum_observer", (q, v), begun | {"residual_next": zeros(n)}),
        Program("momentum_observer_step", inputs, moved),
        _wrench(residual, share),
    ]
    if robot.joint_carriers is not None:
        programs.append(_touched(robot, robot.joint_carriers, residual))
    return {program.name: program for program in programs}


def observer_functions(robot: Functions) -> list[CFunction]:
    """The programs as functions of C."""
    functions = []
    for name, program in momentum_observer(robot).items():
        values = (*program.names, *program.outputs)
        explained = {x: words for x, words in _EXPLAINED.items() if x in values}
        kept = [x for x in (_MEMORY, _OF_FRAME) if x.members[0].after in values]
        functions.append(CFunction(program, _WORDS[name], tuple(kept), explained))
    return functions


def _wrench(residual: Node, share: Node) -> Program:
    """The wrench on a frame that explains a residual (nv)."""
    n = residual.size
    now, late = variable("jacobian", 6, n), variable("late_jacobian", 6, n)
    jacobian = late + reshaped(share, (1, n)) * (now - late)
    weight, damping = (variable(*x, uniform=True) for x in (("weight", n), ("damping", 6)))
    weighed = jacobian * reshaped(weight, (1, n))
    square = weighed @ jacobian.transposed + constant(np.eye(6)) * reshaped(damping, (6, 1))
    inputs = now, late, residual, share, weight, damping
    outputs = {"wrench": solve(square, weighed @ residual), "late_jacobian_next": jacobian}
    return Program("wrench_of_residual", inputs, outputs)


def _touched(robot: Functions, carriers: list[int], residual: Node) -> Program:
    """Which bodies something touches, by a residual (nv) and by the joint that carries each."""
    threshold = variable("threshold", residual.size, uniform=True)
    beyond = choose(absolute(residual), threshold, 1.0, 0.0)
    entries = robot.layout.v
    # Of the base, then of the joints; and what those after each feel.
    of_base = reduce(maximum, (beyond[k] for k in entries.base), constant(0.0))
    felt = [of_base, *(beyond[k] for k in entries.joint_places)]
    after = [constant(0.0)] * len(felt)
    for k in range(len(carriers), 0, -1):
        carrier = carriers[k - 1]
        after[carrier] = maximum(after[carrier], maximum(felt[k], after[k]))
    touched = [reshaped(x * (1.0 - y), (1,)) for x, y in zip(felt, after, strict=True)]
    return Program("touched_by_residual", (residual, threshold), {"touched": join(*touched)})
