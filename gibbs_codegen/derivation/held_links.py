"""Links that constraint torques hold: their rows of the hybrid system, and the torques (eq. 14).

They come from the tree that has these joints, too, at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.forces import rotor_column
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import (
    generalised_inertia_forces,
    mass_matrix,
)
from gibbs_codegen.robot.coordinates import hybrid_coordinates
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.names import coordinate_of


@dataclass(frozen=True)
class HeldRow:
    """The row of a joint that holds a link: number `place` of the hybrid system.

    `entries` are those of the mass matrix by their column in the hybrid system, `inputs` those of
    the rotors' thrusts.
    """

    place: int
    entries: dict[int, sp.Expr]
    residual: sp.Expr
    inputs: list[sp.Expr]


def held_rows(symbolic: SymbolicRobot) -> list[HeldRow]:
    """The rows of the joints that hold links, in order."""
    places = _held_places(symbolic)
    if not places:
        return []
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.held_tree
    state = symbolic.state_of(symbolic.held_bodies)
    matrix = mass_matrix(tape, root, tree)
    minus_r = generalised_inertia_forces(tape, root, tree, state.unaccelerated)
    columns = _thrust_columns(symbolic)
    everywhere = _places_of_held_tree(symbolic)
    return [
        HeldRow(
            everywhere[i],
            dict(zip(everywhere, matrix[i], strict=True)),
            -minus_r[i],
            [column[i] for column in columns],
        )
        for i in places
    ]


def torques_on_held_links(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """τ' (N m) of the joints that hold links, in order, given the free accelerations and inputs."""
    places = _held_places(symbolic)
    if not places:
        return []
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.held_tree
    state = symbolic.state_of(symbolic.held_bodies)
    forces = generalised_inertia_forces(tape, root, tree, state)
    columns = _thrust_columns(symbolic)
    thrusts = symbolic.u[: len(columns)]
    torques = []
    for i in places:
        with tape.group("constraint torques of links"):
            pairs = zip(columns, thrusts, strict=True)
            active = [tape.let(column[i] * thrust) for column, thrust in pairs]
            torques.append(tape.let(forces[i] - sp.Add(*active)))
    return torques


def _thrust_columns(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """What each rotor's unit thrust does in the tree with held joints."""
    tree, bodies = symbolic.held_tree, symbolic.held_bodies
    return [rotor_column(symbolic, tree, bodies, k) for k in range(1, symbolic.robot.rotors + 1)]


def _held_places(symbolic: SymbolicRobot) -> list[int]:
    """Places of the held joints among the coordinates of the tree that has them."""
    robot, numbers = symbolic.robot, symbolic.held_bodies.numbers
    joints = symbolic.root.places(len(numbers)).joint_places
    return [place for place, i in zip(joints, numbers, strict=True) if i in robot.constrained]


def _places_of_held_tree(symbolic: SymbolicRobot) -> list[int]:
    """Where the coordinates of the tree with held joints stand among the hybrid unknowns."""
    robot, layout = symbolic.robot, layout_of(symbolic.robot)
    names = [coordinate.name for coordinate in hybrid_coordinates(robot)]
    joints = [names.index(coordinate_of(robot, i)) for i in symbolic.held_bodies.numbers]
    base, _ = symbolic.places.split(layout.free)
    return symbolic.root.places(len(joints)).joined(base, joints)
