"""Forward dynamics with its derivatives by coordinates, velocities and inputs.

By articulated bodies, in O(n²): neither M nor its inverse is ever multiplied. What a joint's change
does to its own parent is found in one of two ways, picked by an estimate of which is shorter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.articulated import (
    accelerations_outward,
    root_in_group_frame,
    root_turn,
)
from gibbs_codegen.derivation.articulated_derivatives import (
    ArticulatedDerivatives,
    convected_perturbations,
)
from gibbs_codegen.derivation.base_columns import BaseColumns
from gibbs_codegen.derivation.forces import passive_symbols
from gibbs_codegen.derivation.forward_dynamics import (
    about_base_centre,
    articulation_of,
    free_motions_of,
    in_coordinates,
    refused_as_singular,
)
from gibbs_codegen.derivation.operational_inertia import inertia_is_shorter
from gibbs_codegen.derivation.root.protocol import Values
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.layout import Places
from gibbs_codegen.symbolic.vectors import Matrix


@dataclass(frozen=True)
class ForwardDynamicsDerivatives:
    """Accelerations, and their derivatives by rows, in the order of v; inputs in that of u.

    `acceleration_dq` is taken in the tangent space of the coordinates.
    """

    acceleration: list[sp.Expr]
    acceleration_dq: Matrix
    acceleration_dv: Matrix
    acceleration_du: Matrix


def forward_dynamics_derivatives(
    symbolic: SymbolicRobot, by_inertia: bool | None = None
) -> ForwardDynamicsDerivatives:
    """Accelerations a of M a = R + B u and their derivatives.

    `by_inertia` is as of `ArticulatedDerivatives`; None: as `inertia_is_shorter` estimates. Raises
    `SingularRobotError` where a joint moves nothing that has mass or inertia.
    """
    tape, places = symbolic.tape, symbolic.places
    centred = about_base_centre(symbolic)
    motions = free_motions_of(centred)
    with refused_as_singular(symbolic):
        articulation = articulation_of(centred)
        root, joints = accelerations_outward(tape, articulation)
    tree, relative = articulation.tree, [joint.relative for joint in joints]
    in_group_frame = root_in_group_frame(tape, articulation, root)
    acceleration = in_coordinates(symbolic, relative, in_group_frame)
    _, rates = places.split(symbolic.v)
    passive = passive_symbols(symbolic)
    coupling, changes = convected_perturbations(tape, articulation, motions, rates, joints, passive)
    if by_inertia is None:
        by_inertia = inertia_is_shorter(tree)
    columns = ArticulatedDerivatives(tape, articulation, coupling, changes, by_inertia)
    omega = root_turn(tree).inverse.vector(tape, motions[0].omega)
    base = BaseColumns(symbolic, centred, articulation, omega, in_group_frame, columns)
    by_place, by_velocity = base.by_base(places.split(acceleration)[0])
    return ForwardDynamicsDerivatives(
        acceleration,
        _matrix(places, places.joined(by_place, base.by_joints("coordinate"))),
        _matrix(places, places.joined(by_velocity, base.by_joints("rate"))),
        _matrix(places, [*base.by_rotors(), *base.by_joints("effort")]),
    )


def _matrix(places: Places, columns: Sequence[Values]) -> Matrix:
    """A matrix by rows, from columns in which the base comes first."""
    ordered = [places.joined(column[:6], column[6:]) for column in columns]
    return [[column[i] for column in ordered] for i in range(places.size)]
