"""Forward dynamics with its derivatives by coordinates, velocities and inputs.

By articulated bodies, in O(n²): neither M nor its inverse is ever multiplied. What a joint's change
does to its own parent is found in one of two ways, picked by an estimate of which is shorter.

The recursion knows the base by its angular velocity and the acceleration of its centre, relative to
free fall, in the frame in which the root's system is solved. Its columns, of r̈ and ω̇ of the root
and of θ̈, are taken to the origin of the coordinates, and the root makes rows and columns of its own
of them.

To the recursion wrenches on the frames are like thrusts: they turn with what carries them. Those
that stay as they are in world axes turn back by ω×W against that, where ω is how fast a
displacement turns the frame. So what they add to the columns by q follows from those by W.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import sympy as sp

from gibbs_codegen.derivation import forward_dynamics
from gibbs_codegen.derivation.articulated import (
    Articulation,
    accelerations_outward,
    root_in_group_frame,
    root_turn,
)
from gibbs_codegen.derivation.articulated_derivatives import (
    ArticulatedDerivatives,
    SeenPoint,
    convected_perturbations,
    inertia_is_shorter,
)
from gibbs_codegen.derivation.forces import rotor_wrench
from gibbs_codegen.derivation.forward_kinematics import (
    frame_jacobians,
    mounted_frames,
    segment_frames,
)
from gibbs_codegen.derivation.inertia import ArticulatedInertia, rotated_block
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.passive import passive_symbols, spring_slopes
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.layout import Places
from gibbs_codegen.robot.names import rotor_identifier
from gibbs_codegen.symbolic.tape import Values, Vector
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Matrix,
    Rotation,
    Wrench,
    axis_vector,
    minus,
    turned_axes,
)

# A column with the rows of the base's own velocities in place of those of r̈ and ω̇.
Conversion = Callable[[Values], Values]


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

    def by_joints(self, kind: Literal["effort", "coordinate", "rate"]) -> list[Values]:
        """Columns by the joints' efforts, coordinates or rates."""
        joints, tape = range(1, len(self.articulation.tree.segments)), self.symbolic.tape
        slopes = {} if kind == "effort" else spring_slopes(self.centred, kind)

        columns: dict[int, Values] = {k: self.columns.column(kind, k) for k in joints}
        for (i, j), slope in slopes.items():
            pushed = self.columns.column("effort", i)
            columns[j] = tape.combination([sp.S.One, slope], [columns[j], pushed])
        with tape.group("rows of attitude and position"):
            _, converted = self._solved
            return [converted(columns[k]) for k in joints]

    def by_base(self, accelerations: Values) -> tuple[list[Values], list[Values]]:
        """Columns in the tangent space of the base's coordinates, and those by its velocities."""
        symbolic, tape = self.symbolic, self.symbolic.tape
        state = replace(symbolic.base_state, accelerations=accelerations)
        with tape.group("columns of attitude and position and of their velocities"):
            # Changes of r̈ of the origin, dω/dt and the joints with each component of ω, in the
            # root's group frame.
            origin, _ = self._solved
            columns = []
            for k in range(3):
                unit, column = axis_vector(k), self.columns.column("turning", k)
                angular = tape.add(tuple(column[3:6]), tape.cross(unit, self.omega))
                root = Acceleration(tuple(column[:3]), angular).passed_out(tape, [origin])
                swung = tape.add(
                    tape.cross(unit, tape.cross(self.omega, origin)),
                    tape.cross(self.omega, tape.cross(unit, origin)),
                )
                columns.append([*tape.add(root.linear, swung), *angular, *column[6:]])
            rows = tuple(zip(*columns, strict=True))
            linear_rows, angular_rows, joints = rows[:3], rows[3:6], rows[6:]
            for turn in self.articulation.root_turns:
                linear_rows = rotated_block(tape, turn, linear_rows)
                angular_rows = rotated_block(tape, turn, angular_rows)
                joints = tuple(turn.vector(tape, row) for row in joints)
            turning = list(zip(*linear_rows, *angular_rows, *joints, strict=True))
            linear = forward_dynamics.at_origin(symbolic, self.acceleration)
            return symbolic.root.state_columns(tape, turning, linear, state)

    def by_rotors(self) -> list[Values]:
        """A column for the thrust of each rotor."""
        symbolic, tape = self.symbolic, self.symbolic.tape
        columns: list[Values] = []
        for k in range(1, symbolic.robot.rotors + 1):
            segment, wrench = rotor_wrench(self.centred, self.centred.bodies, k)
            label = rotor_identifier(symbolic.robot, k)
            with tape.group(f"column of the thrust of motor {label}"):
                columns.append(self._by_wrench(segment, wrench))
        return columns

    def by_inputs(self) -> list[Values]:
        """A column for each input: thrusts, and efforts of the joints that have one."""
        driven = len(self.symbolic.u) - self.symbolic.robot.rotors
        efforts = self.by_joints("effort")
        return [*self.by_rotors(), *efforts[len(efforts) - driven :]]

    def _by_wrench(self, segment: int, wrench: Wrench) -> Values:
        """A column of a wrench on a segment about its joint, or the base's centre, in its frame."""
        tape = self.symbolic.tape
        if segment == 0:
            return tape.combination(wrench.entries, self._by_wrenches)
        wrench = self.articulation.tree.to_working_frame(tape, segment, wrench)
        return self.by_load(segment, wrench)

    def by_load(self, segment: int, wrench: Wrench) -> Values:
        """A column of a wrench on a segment about its joint in its working frame.

        On the base it is where the root's system is solved.
        """
        tape, (_, converted) = self.symbolic.tape, self._solved
        if segment == 0:
            units = [self.columns.column("wrench", c) for c in range(6)]
            return converted(tape.combination(wrench.entries, units))
        return converted(self.columns.by_wrench(segment, wrench.entries))

    @cached_property
    def _by_wrenches(self) -> list[Values]:
        """Columns of a unit of each component of a wrench on the base, in its own frame."""
        tape = self.symbolic.tape
        units = [self.columns.column("wrench", c) for c in range(6)]
        if not self.articulation.tree.segments[0].rotation.is_identity:
            axes, (_, converted) = turned_axes(tape, self._to_solved), self._solved
            halves = units[:3], units[3:]
            columns = [tape.combination(axis, half) for half in halves for axis in axes]
            return list(map(converted, columns))
        # Rows and columns turn together, which takes fewer operations.
        inverse = ArticulatedInertia.of_entries(lambda i, j: units[j][i])
        joints = [Wrench.of(row) for row in zip(*(unit[6:] for unit in units), strict=True)]
        for turn in self.articulation.root_turns:
            inverse = inverse.rotated(tape, turn)
            joints = [row.rotated(tape, turn) for row in joints]
        converted = self._conversion([], minus(self.symbolic.centre))
        return [
            converted([*row, *(joint.entries[c] for joint in joints)])
            for c, row in enumerate(inverse.rows)
        ]

    def by_frames(self) -> list[Values]:
        """Six columns for each frame, by the components of a wrench there in world axes."""
        tape = self.symbolic.tape
        frames = segment_frames(self.symbolic)
        columns: list[Values] = []
        for mounted in mounted_frames(self.centred):
            k = mounted.segment
            with tape.group(f"columns of the wrench on {mounted.name}"):
                for c in range(6):
                    along = [axis[c % 3] for axis in frames[k].axes]
                    unit = [*along, *ZERO] if c < 3 else [*ZERO, *along]
                    wrench = Wrench.of(unit).shifted(tape, mounted.position)
                    columns.append(self._by_wrench(k, wrench))
        return columns

    @cached_property
    def _solved(self) -> tuple[Vector, Conversion]:
        """The origin of the coordinates from the base centre where the root's system is solved.

        Then comes how columns are converted from that frame.
        """
        origin = minus(self.symbolic.centre)
        for rotation in self._to_solved:
            origin = rotation.vector(self.symbolic.tape, origin)
        return origin, self._conversion(self.articulation.root_turns, origin)

    def _conversion(self, turns: Sequence[Rotation], origin: Vector) -> Conversion:
        """From accelerations about the base centre to those of the base's velocities.

        `turns` lead from the frame of the former to the root's group frame; `origin` is that of the
        coordinates from the base centre.
        """
        tape = self.symbolic.tape
        rows = self.symbolic.root.acceleration_rows(tape, turns)

        def converted(column: Values) -> Values:
            root = Acceleration.of(column[:6]).passed_out(tape, [origin])
            return [*rows(root), *column[6:]]

        return converted

    @cached_property
    def _to_solved(self) -> list[Rotation]:
        """Rotations from the base's own frame to that in which the root's system is solved."""
        tree, tape = self.articulation.tree, self.symbolic.tape
        if tree.works_in_own_frame(0):
            return []
        rotation, solved = tree.segments[0].rotation, root_turn(tree).inverse
        if rotation.is_identity or solved.is_identity:
            return [rotation, solved]
        cos, sin = rotation.turned(tape, solved.cos, solved.sin)
        return [Rotation(rotation.axis, cos, sin)]


@dataclass(frozen=True)
class ForwardDynamicsDerivatives:
    """Accelerations, and their derivatives by rows, in the order of v; inputs in that of u.

    `acceleration_dq` is taken in the tangent space of the coordinates.
    """

    acceleration: list[sp.Expr]
    acceleration_dq: Matrix
    acceleration_dv: Matrix
    acceleration_du: Matrix


@dataclass(frozen=True)
class LoadedDynamicsDerivatives(ForwardDynamicsDerivatives):
    """The same under wrenches on the frames; `acceleration_dW` has six columns for each of them."""

    acceleration_dW: Matrix  # noqa: N815


def forward_dynamics_derivatives(
    symbolic: SymbolicRobot, by_inertia: bool | None = None
) -> ForwardDynamicsDerivatives:
    """Accelerations a of M a = R + B u and their derivatives.

    `by_inertia` is as of `ArticulatedDerivatives`; None: as `inertia_is_shorter` estimates. Raises
    `SingularRobotError` where a joint moves nothing that has mass or inertia.
    """
    derivatives, _ = _differentiated(symbolic, forward_dynamics.thrusts, by_inertia)
    return derivatives


def loaded_dynamics_derivatives(symbolic: SymbolicRobot) -> LoadedDynamicsDerivatives:
    """Accelerations a of M a = R + B u + ΣJᵀW and their bare, with W in world axes.

    Raises what `forward_dynamics_derivatives` does.
    """
    tape, places = symbolic.tape, symbolic.places
    bare, base = _differentiated(symbolic, forward_dynamics.thrusts_and_wrenches, None)
    by_wrenches = in_order(places, base.by_frames())
    turned: list[list[sp.Expr]] = []
    for j in range(places.size):
        back: list[sp.Expr] = []
        for place, jacobian in enumerate(frame_jacobians(symbolic)):
            turning = tuple(row[j] for row in jacobian[3:])
            with tape.group("wrenches that do not turn with the frames"):
                for first in (6 * place, 6 * place + 3):
                    half = tuple(symbolic.W[first : first + 3])
                    back += tape.cross(half, turning)
        turned.append(back)
    with tape.group("columns by q, with wrenches that do not turn"):
        by_place = [
            [
                tape.sum_of_products(row, back, entry)
                for entry, back in zip(entries, turned, strict=True)
            ]
            for row, entries in zip(by_wrenches, bare.acceleration_dq, strict=True)
        ]
    return LoadedDynamicsDerivatives(
        bare.acceleration, by_place, bare.acceleration_dv, bare.acceleration_du, by_wrenches
    )


def base_columns(
    symbolic: SymbolicRobot,
    articulation: Articulation,
    by_inertia: bool | None = None,
    seen: Sequence[SeenPoint] = (),
) -> tuple[list[sp.Expr], BaseColumns]:
    """Accelerations of a robot under loads that turn with the bodies, and columns of them.

    The columns go on with what the points `seen` feel, for which no base has to be converted: like
    joints they do not notice how the whole robot is turned.
    """
    tape, tree = symbolic.tape, articulation.tree
    centred = symbolic.centred
    motions = forward_dynamics.free_motions_of(centred)
    root, joints = accelerations_outward(tape, articulation)
    in_group_frame = root_in_group_frame(tape, articulation, root)
    relative = [joint.relative for joint in joints]
    acceleration = forward_dynamics.in_coordinates(symbolic, relative, in_group_frame)
    rates, passive = symbolic.joint_state.rates, passive_symbols(symbolic)
    coupling, changes = convected_perturbations(tape, articulation, motions, rates, joints, passive)
    if by_inertia is None:
        by_inertia = inertia_is_shorter(tree)
    columns = ArticulatedDerivatives(tape, articulation, coupling, changes, by_inertia, seen)
    omega = root_turn(tree).inverse.vector(tape, motions[0].omega)
    base = BaseColumns(symbolic, centred, articulation, omega, in_group_frame, columns)
    return acceleration, base


def _differentiated(
    symbolic: SymbolicRobot, acting: forward_dynamics.Acting, by_inertia: bool | None
) -> tuple[ForwardDynamicsDerivatives, BaseColumns]:
    """Derivatives under what acts besides gravity and turns with the bodies; and more columns."""
    places = symbolic.places
    centred = symbolic.centred
    with forward_dynamics.refused_as_singular(symbolic):
        articulation = forward_dynamics.articulation_of(centred, acting)
        acceleration, base = base_columns(symbolic, articulation, by_inertia)
    by_place, by_velocity = base.by_base(places.split(acceleration)[0])
    derivatives = ForwardDynamicsDerivatives(
        acceleration,
        in_order(places, places.joined(by_place, base.by_joints("coordinate"))),
        in_order(places, places.joined(by_velocity, base.by_joints("rate"))),
        in_order(places, base.by_inputs()),
    )
    return derivatives, base


def in_order(places: Places, columns: Sequence[Values]) -> Matrix:
    """A matrix by rows in the order of v, from columns in which the base comes first."""
    size = 6 + len(places.joint_places)
    ordered = [places.joined(column[:6], column[6:size]) for column in columns]
    return [[column[i] for column in ordered] for i in range(places.size)]
