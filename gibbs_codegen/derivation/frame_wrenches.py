"""Wrenches on the frames: as loads on segments, and as generalised forces Σ JᵀW."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.forces import generalised_forces
from gibbs_codegen.derivation.frames import Frame, mounted_frames, segment_frames
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import NO_WRENCH, Vector, Wrench, dot

# Components of a wrench.
_SIZE = 6


def frame_loads(symbolic: SymbolicRobot) -> dict[int, Wrench]:
    """The wrenches W on the frames, taken to the joints of the segments that they are on.

    They are by index of the segment, about its joint or about the origin, in its own frame (N, N
    m).
    """
    tape = symbolic.tape
    frames = segment_frames(tape, symbolic.root, symbolic.reduced_tree)
    loads: dict[int, Wrench] = {}
    for place, mounted in enumerate(mounted_frames(symbolic)):
        k, given = mounted.segment, symbolic.W[place * _SIZE : (place + 1) * _SIZE]
        with tape.group(f"wrench on {mounted.name}, in the frame of its link"):
            world = Wrench.of(given)
            force, moment = (_seen(tape, frames[k].own, v) for v in (world.force, world.moment))
            load = Wrench(force, moment).shifted(tape, mounted.position)
            loads[k] = loads.get(k, NO_WRENCH).plus(tape, load)
    return loads


def wrench_forces(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Generalised forces of the wrenches W on the frames (N m or N), without a Jacobian."""
    loads = frame_loads(symbolic)
    with symbolic.tape.group("wrenches carried in to the base"):
        return generalised_forces(symbolic, loads)


def _seen(tape: Scalars, axes: Frame, vector: Vector) -> Vector:
    """Components of a vector along axes, both given in world axes."""
    x, y, z = (dot(tape, axis, vector) for axis in axes)
    return (x, y, z)
