"""The Coriolis matrix: C with C v for velocity terms and Ṁ − 2C skew-symmetric.

    M_ij = ∫ξ_i·ξ_j dm,    C_ij = ∫ξ_i·ξ̇_j dm,    Ṁ_ij = C_ij + C_ji

with ξ_j the velocities that a unit of v_j makes. Twice that are the derivatives of the forces by v,
or nearly so where the base's velocities are in its own frame. So C is what these are for half of
the inertias.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from gibbs_codegen.derivation.inverse_dynamics_derivatives import (
    base_derivatives,
    inertial_derivatives,
)
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.symbolic.tape import Stage
from gibbs_codegen.symbolic.vectors import Matrix


def coriolis_matrix(symbolic: SymbolicRobot) -> Matrix:
    """The Coriolis matrix, without dampers; rows and columns in the order of v."""
    tape, segments = symbolic.tape, []
    for segment in symbolic.reduced_tree.segments:
        with tape.group(f"half of the inertia of {segment.name}", Stage.PARAMETER):
            half = segment.inertia.mapped(lambda number: tape.let(sp.S.Half * number))
        segments.append(replace(segment, inertia=half))
    with tape.group("motion of the base, for the Coriolis matrix"):
        of_base = base_derivatives(symbolic).coriolis(tape)
    _, matrix, _ = inertial_derivatives(symbolic, SegmentTree(tuple(segments)), of_base)
    return matrix
