"""Columns of the recursion in the coordinates of the base.

The recursion knows the base by its angular velocity and the acceleration of its centre, relative to
free fall, in the frame in which the root's system is solved. Here its columns are taken to the
origin of the coordinates, and the root makes rows and columns of its own of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import AccelerationColumn, combination
from gibbs_codegen.derivation.articulated import Articulation, root_turn
from gibbs_codegen.derivation.articulated_derivatives import ArticulatedDerivatives
from gibbs_codegen.derivation.articulated_inertia import (
    ArticulatedInertia,
    Block,
    rotated_block,
)
from gibbs_codegen.derivation.forces import rotor_wrench
from gibbs_codegen.derivation.forward_dynamics import at_origin
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.root.protocol import Values
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.names import rotor_identifier
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    Rotation,
    Vector,
    Wrench,
    add,
    axis_vector,
    cross,
    minus,
    turned_axes,
)

Entries = list[sp.Expr]


@dataclass(frozen=True)
class _Conversion:
    """From accelerations about the base centre, in some frame, to those of the base's velocities.

    `origin` is the origin of the coordinates from the base centre, in that frame.
    """

    tape: Scalars
    rows: Callable[[Acceleration], Values]
    origin: Vector

    def entries(self, column: AccelerationColumn) -> Entries:
        """A column with the rows of the base's own velocities, and then those of the joints."""
        root = column.root.passed_out(self.tape, [self.origin])
        return [*self.rows(root), *column.joints]


@dataclass(frozen=True)
class BaseColumns:
    """Columns of a robot, of which `centred` is about its base centre.

    `omega` is the base's angular velocity, where the root's system is solved, and `acceleration`
    that of the base centre in the root's group frame. In all results the rows of the base come
    first, in the order of its velocities, and then those of the joints.
    """

    symbolic: SymbolicRobot
    centred: SymbolicRobot
    articulation: Articulation
    omega: Vector
    acceleration: Acceleration
    columns: ArticulatedDerivatives

    def by_joints(self, kind: Literal["effort", "coordinate", "rate"]) -> list[Entries]:
        """Columns by the joints' efforts, coordinates or rates."""
        joints = range(1, len(self.articulation.tree.segments))
        with self.symbolic.tape.group("rows of attitude and position"):
            return [self._solved.entries(self.columns.column(kind, k)) for k in joints]

    def by_base(self, accelerations: Values) -> tuple[list[Values], list[Values]]:
        """Columns in the tangent space of the base's coordinates, and those by its velocities."""
        symbolic, tape = self.symbolic, self.symbolic.tape
        rates, _ = symbolic.places.split(symbolic.v)
        with tape.group("columns of attitude and position and of their velocities"):
            return symbolic.root.state_columns(
                tape,
                self._turning(),
                at_origin(symbolic, self.acceleration),
                rates,
                accelerations,
                symbolic.parameters.gravity,
            )

    def by_rotors(self) -> list[Entries]:
        """A column for the thrust of each rotor."""
        symbolic, tape = self.symbolic, self.symbolic.tape
        columns = []
        for k in range(1, symbolic.robot.rotors + 1):
            unit = rotor_wrench(self.centred, self.centred.bodies, k)
            label = rotor_identifier(symbolic.robot, k)
            with tape.group(f"column of the thrust of motor {label}"):
                columns.append(self._by_wrench(unit.segment, unit.wrench))
        return columns

    def _by_wrench(self, k: int, wrench: Wrench) -> Entries:
        """The column of a wrench on a segment, about its joint in its own frame."""
        tape = self.symbolic.tape
        if k == 0:
            return combination(tape, wrench.entries, self._by_wrenches)
        wrench = self.articulation.tree.to_working_frame(tape, k, wrench)
        return self._solved.entries(self.columns.by_wrench(k, wrench.entries))

    @cached_property
    def _by_wrenches(self) -> list[Entries]:
        """Columns of a unit of each component of a wrench on the base, in its own frame."""
        tape = self.symbolic.tape
        units = [self.columns.column("wrench", c) for c in range(6)]
        if not self.articulation.tree.segments[0].rotation.is_identity:
            axes = turned_axes(tape, self._to_solved)
            halves = units[:3], units[3:]
            columns = [
                AccelerationColumn.combined(tape, axis, half) for half in halves for axis in axes
            ]
            return [self._solved.entries(column) for column in columns]
        # Rows and columns turn together, which takes fewer operations.
        inverse = ArticulatedInertia.of_entries(lambda i, j: units[j].root.entries[i])
        joints = [Wrench.of(row) for row in zip(*(unit.joints for unit in units), strict=True)]
        for turn in self.articulation.root_turns:
            inverse = inverse.rotated(tape, turn)
            joints = [row.rotated(tape, turn) for row in joints]
        rows = self.symbolic.root.acceleration_rows(tape, [])
        conversion = _Conversion(tape, rows, minus(self.symbolic.centre))
        return [
            conversion.entries(
                AccelerationColumn(Acceleration.of(row), [j.entries[c] for j in joints])
            )
            for c, row in enumerate(inverse.rows)
        ]

    def _turning(self) -> list[AccelerationColumn]:
        """Columns of r̈ of the origin, dω/dt and the joints for a change of each component of ω.

        They are in the root's group frame.
        """
        tape, columns = self.symbolic.tape, [self._turning_about(k) for k in range(3)]
        linear = _block([column.root.linear for column in columns])
        angular = _block([column.root.angular for column in columns])
        joints = [_vector(row) for row in zip(*(column.joints for column in columns), strict=True)]
        for turn in self.articulation.root_turns:
            linear = rotated_block(tape, turn, linear)
            angular = rotated_block(tape, turn, angular)
            joints = [turn.vector(tape, row) for row in joints]
        return [
            AccelerationColumn(Acceleration.of(column[:6]), list(column[6:]))
            for column in zip(*linear, *angular, *joints, strict=True)
        ]

    def _turning_about(self, k: int) -> AccelerationColumn:
        """The column for one component of ω, where the root's system is solved."""
        tape, unit, origin = self.symbolic.tape, axis_vector(k), self._solved.origin
        column = self.columns.column("turning", k)
        angular = add(tape, column.root.angular, cross(tape, unit, self.omega))
        root = Acceleration(column.root.linear, angular).passed_out(tape, [origin])
        swung = add(
            tape,
            cross(tape, unit, cross(tape, self.omega, origin)),
            cross(tape, self.omega, cross(tape, unit, origin)),
        )
        return AccelerationColumn(
            Acceleration(add(tape, root.linear, swung), angular), column.joints
        )

    @cached_property
    def _solved(self) -> _Conversion:
        """From the frame in which the root's system is solved."""
        tape, origin = self.symbolic.tape, minus(self.symbolic.centre)
        for rotation in self._to_solved:
            origin = rotation.vector(tape, origin)
        turns = self.articulation.root_turns
        return _Conversion(tape, self.symbolic.root.acceleration_rows(tape, turns), origin)

    @cached_property
    def _to_solved(self) -> list[Rotation]:
        """Rotations from the base's own frame to that in which the root's system is solved."""
        tree, tape = self.articulation.tree, self.symbolic.tape
        if tree.works_in_own_frame(0):
            return []
        own, solved = tree.segments[0].rotation, root_turn(tree).inverse
        if own.is_identity or solved.is_identity:
            return [own, solved]
        cos, sin = own.turned(tape, solved.cos, solved.sin)
        return [Rotation(own.axis, cos, sin)]


def _vector(entries: Sequence[sp.Expr]) -> Vector:
    x, y, z = entries
    return (x, y, z)


def _block(columns: Sequence[Vector]) -> Block:
    x, y, z = zip(*columns, strict=True)
    return (x, y, z)
