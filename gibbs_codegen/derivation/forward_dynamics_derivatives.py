"""Forward dynamics with its derivatives by coordinates, velocities and inputs, by articulated bodies.

The recursion knows the base only by its angular velocity and acceleration about the base centre, in
the frame in which the root's system is solved, relative to free fall. Here its columns are taken to
the origin of the coordinates, and the root makes columns of its own coordinates of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import Column, combination
from gibbs_codegen.derivation.articulated import (
    Articulation,
    JointAcceleration,
    accelerations_outward,
    root_in_group_frame,
    root_turn,
)
from gibbs_codegen.derivation.articulated_derivatives import ArticulatedDerivatives
from gibbs_codegen.derivation.convected_perturbations import (
    couplings_inward,
    doubled_velocities,
    joint_perturbations,
)
from gibbs_codegen.derivation.forces import rotor_wrench
from gibbs_codegen.derivation.forward_dynamics import (
    about_base_centre,
    articulation_of,
    at_origin,
    free_motions_of,
    in_coordinates,
    refused_as_singular,
)
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.passive import passive_symbols
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.names import rotor_identifier
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Matrix,
    Rotation,
    Vector,
    Wrench,
    add,
    axis_vector,
    cross,
    minus,
    scale,
    turned_axes,
)

Entries = list[sp.Expr]


@dataclass(frozen=True)
class ForwardDynamicsDerivatives:
    """Accelerations, and their derivatives by rows, in the order of v; inputs in that of u.

    `acceleration_dq` is taken in the tangent space of the coordinates.
    """

    acceleration: Entries
    acceleration_dq: Matrix
    acceleration_dv: Matrix
    acceleration_du: Matrix


def forward_dynamics_derivatives(
    symbolic: SymbolicRobot, by_inertia: bool = True
) -> ForwardDynamicsDerivatives:
    """Accelerations a of M a = R + B u and their derivatives.

    Args:
        symbolic: The robot in symbols.
        by_inertia: As of `ArticulatedDerivatives`.

    Returns:
        All of them.

    Raises:
        SingularRobotError: Where a joint moves nothing that has mass or inertia.
    """
    tape, places = symbolic.tape, symbolic.places
    centred = about_base_centre(symbolic)
    with refused_as_singular(symbolic):
        articulation = articulation_of(centred)
        root, joints = accelerations_outward(tape, articulation)
    relative = [joint.relative for joint in joints]
    in_group = root_in_group_frame(tape, articulation, root)
    acceleration = in_coordinates(symbolic, relative, in_group)
    columns = _columns(centred, articulation, joints, by_inertia)
    base = _Base(symbolic, centred, articulation, root, columns)
    numbers = range(1, len(relative) + 1)
    accelerations, _ = places.split(acceleration)
    by_place, by_velocity = base.state_columns(accelerations)

    def matrix(of_base: Sequence[Entries], of_joints: Sequence[Entries]) -> Matrix:
        return _by_rows(
            [places.joined(column[:6], column[6:]) for column in places.joined(of_base, of_joints)]
        )

    of_joints = {
        kind: [base.converted(columns.column(kind, k)) for k in numbers]
        for kind in ("coordinate", "rate", "effort")
    }
    inputs = [*base.rotor_columns(), *of_joints["effort"]]
    return ForwardDynamicsDerivatives(
        acceleration,
        matrix(by_place, of_joints["coordinate"]),
        matrix(by_velocity, of_joints["rate"]),
        _by_rows([places.joined(column[:6], column[6:]) for column in inputs])
        if inputs
        else [[] for _ in acceleration],
    )


def _columns(
    centred: SymbolicRobot,
    articulation: Articulation,
    joints: Sequence[JointAcceleration],
    by_inertia: bool,
) -> ArticulatedDerivatives:
    """Columns of the tree.

    Args:
        centred: The robot in symbols, about its base centre.
        articulation, joints: The solved equations, and the accelerations of the joints.
        by_inertia: As of `ArticulatedDerivatives`.

    Returns:
        The columns.
    """
    tape, motions = centred.tape, free_motions_of(centred)
    _, rates = centred.places.split(centred.v)
    doubled = doubled_velocities(tape, articulation, motions, rates)
    coupling, couplings = couplings_inward(tape, articulation, doubled)
    changes = joint_perturbations(
        tape, articulation, motions, doubled, couplings, joints, passive_symbols(centred)
    )
    return ArticulatedDerivatives(tape, articulation, coupling, changes, by_inertia)


@dataclass(frozen=True)
class _Base:
    """The base between the recursion's frame and its own coordinates."""

    symbolic: SymbolicRobot
    centred: SymbolicRobot
    articulation: Articulation
    acceleration: Acceleration
    columns: ArticulatedDerivatives

    def converted(self, column: Column) -> Entries:
        """A column with rows of the base's own velocities, those of the joints after them.

        Args:
            column: About the base centre, where the root's system is solved.

        Returns:
            The entries.
        """
        with self.symbolic.tape.group("rows of attitude and position"):
            return [*self._rows(self._at_origin(column.root)), *column.joints]

    def state_columns(self, accelerations: Entries) -> tuple[list[Entries], list[Entries]]:
        """Columns of the base's own coordinates and velocities.

        Args:
            accelerations: Those of the base.

        Returns:
            Columns in the tangent space of its coordinates, and for its velocities.
        """
        symbolic, tape = self.symbolic, self.symbolic.tape
        rates, _ = symbolic.places.split(symbolic.v)
        with tape.group("columns of attitude and position and of their velocities"):
            omega, turning = self._omega, []
            for k in range(3):
                unit = axis_vector(k)
                column = self.columns.column("turning", k)
                angular = add(tape, column.root.angular, cross(tape, unit, omega))
                root = self._at_origin(Acceleration(column.root.linear, angular))
                swung = add(
                    tape,
                    cross(tape, unit, cross(tape, omega, self._origin)),
                    cross(tape, omega, cross(tape, unit, self._origin)),
                )
                root = Acceleration(add(tape, root.linear, swung), root.angular)
                turning.append(Column(root, column.joints))
            centre = root_in_group_frame(tape, self.articulation, self.acceleration)
            linear = at_origin(symbolic, centre)
            return symbolic.root.state_columns(
                tape,
                self.articulation.root_turns,
                turning,
                linear,
                rates,
                accelerations,
                symbolic.parameters.gravity,
            )

    def rotor_columns(self) -> list[Entries]:
        """A column for the thrust of each rotor."""
        symbolic, tape = self.symbolic, self.symbolic.tape
        units: list[Entries] = []
        columns = []
        for k in range(1, symbolic.robot.rotors + 1):
            unit = rotor_wrench(self.centred, self.centred.bodies, k)
            label = rotor_identifier(symbolic.robot, k)
            with tape.group(f"column of the thrust of motor {label}"):
                if unit.segment:
                    wrench = self.articulation.tree.to_working_frame(
                        tape, unit.segment, unit.wrench
                    )
                    column = self.columns.responses_to(unit.segment, wrench.entries)
                    columns.append(self.converted(column))
                else:
                    units = units or self._wrench_columns()
                    columns.append(combination(tape, unit.wrench.entries, units))
        return columns

    def _wrench_columns(self) -> list[Entries]:
        """Columns of a unit of each component of a wrench on the base, in its own frame."""
        tape, found = self.symbolic.tape, []
        axes = turned_axes(tape, self._to_solved)
        for first in (0, 3):
            units = [self.columns.column("wrench", first + k) for k in range(3)]
            for axis in axes:
                found.append(self.converted(Column.combined(tape, axis, units)))
        return found

    @cached_property
    def _rows(self) -> Callable[[Acceleration], Sequence[sp.Expr]]:
        return self.symbolic.root.acceleration_rows(
            self.symbolic.tape, self.articulation.root_turns
        )

    @cached_property
    def _to_solved(self) -> list[Rotation]:
        """Rotations from the base's own frame to that in which the root's system is solved."""
        tree = self.articulation.tree
        if tree.works_in_own_frame(0):
            return []
        own, solved = tree.segments[0].rotation, root_turn(tree).inverse
        if own.is_identity or solved.is_identity:
            return [own, solved]
        tape = self.symbolic.tape
        cos, sin = own.turned(tape, solved.cos, solved.sin)
        return [Rotation(own.axis, cos, sin)]

    @cached_property
    def _omega(self) -> Vector:
        """Angular velocity of the base."""
        motion = free_motions_of(self.centred)[0]
        return root_turn(self.articulation.tree).inverse.vector(self.symbolic.tape, motion.omega)

    @cached_property
    def _origin(self) -> Vector:
        """The origin of the coordinates from the base centre."""
        origin = minus(self.symbolic.centre)
        for rotation in self._to_solved:
            origin = rotation.vector(self.symbolic.tape, origin)
        return origin

    def _at_origin(self, centre: Acceleration) -> Acceleration:
        """A change of acceleration of the base centre, at the origin of the coordinates."""
        return centre.passed_out(self.symbolic.tape, [self._origin])


def _by_rows(columns: Sequence[Entries]) -> Matrix:
    return [list(row) for row in zip(*columns, strict=True)]
