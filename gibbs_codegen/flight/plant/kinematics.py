"""Coordinates, errors and rates of a base with a quaternion, or with some angles or none.

Everything else of a flight works on coordinates q (nq) and velocities v, a (nv) by the places
of the layout. Tracking errors have an entry per velocity: of the attitude and the position of the
base, in the places of its angular and linear velocity, and of the joints.

With a quaternion no attitude is singular, and v holds the linear and the angular velocity of the
base in its own frame. Quaternions are qx, qy, qz, qw; where none of unit length is asked for, any
length means the same attitude.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.arrays import Node, Program, external, variable
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import Space, coordinates_of, entries_of, zeros
from gibbs_codegen.flight.attitude import (
    Turning,
    attitude_angles,
    quaternion_of,
    rotation_matrix,
    rotation_of,
    rotation_vector,
)
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.vectors import Array, times, transposed
from gibbs_codegen.machine.base import RETURN, Base, base_of, placed, pose_motion, unit_entries
from gibbs_codegen.machine.base import Motion as DesiredNodes
from gibbs_codegen.robot.layout import Layout

# What coordinates must be for `unit_quaternions`.
UNIT = "with a quaternion of length 1 (any from 1e-154 to 1e154 is scaled to it), not of zeros"


def unit_quaternions(module: ModuleType, layout: Layout, q: Any, xp: Any = np) -> tuple[Any, Any]:
    """Coordinates (…, nq) with unit quaternions as a module makes them, and which (…) these are."""
    if not layout.is_quaternion:
        return q, xp.ones(q.shape[:-1], bool)
    with np.errstate(invalid="ignore"):
        unit = module.integrate(q, xp.zeros((*q.shape[:-1], layout.v.size)))
    # Where squares are too small, rounding leaves lengths other than 1.
    lengths = (unit[..., layout.q.attitude] ** 2).sum(axis=-1)
    return unit, abs(lengths - 1.0) < 1e-6


def quaternions_of(rotation: Array) -> Array:
    """Unit quaternions (s, 4), x y z w, of rotations (s, 3, 3): each the nearer one to the last."""
    quaternion = quaternion_of(rotation)
    turns_back = np.einsum("si,si->s", quaternion[1:], quaternion[:-1]) < 0.0
    quaternion[1:][np.cumsum(turns_back) % 2 == 1] *= -1.0
    return quaternion


class Kinematics:
    """A base with Tait–Bryan angles, some or none of them, or a quaternion.

    `error_names` has a name for each entry of v. Errors are differences of coordinates but with a
    quaternion: then those of the position are in world axes, and those of the attitude are the
    rotation vector from the actual to the desired attitude in the base's frame, and the difference
    of angular velocities there. The frame of a base that does not move freely is here the one that
    turns with it and lies along the axes of the world before anything has moved.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout, (self._along, self._about) = layout, layout.own_axes
        # Angles that there are not are 0, after those that there are.
        turns = layout.angle_axes
        self._sequence = turns + "".join(axis for axis in "xyz" if axis not in turns)
        names = [*layout.v.names]
        if not layout.is_quaternion:
            names = [layout.q.names[place] for place in layout.paired]
        if layout.is_quaternion:
            names[layout.v.position] = layout.q.names[layout.q.position]
            names[layout.v.attitude] = [f"attitude about the base's {axis}" for axis in "xyz"]
        self.error_names = tuple(names)
        self._evaluators: dict[str, Evaluator] = {}

    @property
    def space(self) -> Space:
        """The numbers of entries of coordinates and displacements."""
        return Space.of(self.layout)

    def wheel_rates(self, q: Node, v: Node) -> Node:
        """Rates of the angles of wheels, which nothing but a module knows: 0."""
        return zeros(self.layout.q.wheels)

    def difference(self, q: Node, other: Node) -> Node:
        """The displacement (nv) between coordinates, of which the attitude alone is looked at."""
        return external("difference", (self.layout.v.size,), entries_of(q), entries_of(other))

    def _evaluated(
        self, name: str, outputs: Callable[..., Sequence[Node]], c: Array, **arguments: Array
    ) -> Any:
        """Results of a program of entries c (…, nq) and of others, by their names.

        `outputs` makes them, of the base at unit coordinates c and of all inputs, the first time.
        """
        if name not in self._evaluators:
            inputs = [variable("c", self.layout.q.size)]
            inputs += [variable(argument, x.shape[-1]) for argument, x in arguments.items()]
            base = base_of(self, coordinates_of(inputs[0], self.space))
            results = {str(k): node for k, node in enumerate(outputs(base, *inputs))}
            self._evaluators[name] = Evaluator(Program(name, tuple(inputs), results), {})
        externals = {"difference": self._difference}
        series = self._evaluators[name]({"c": c, **arguments}, None, externals).values()
        # What does not move is the same for all.
        return tuple(x if x.ndim >= c.ndim else np.tile(x, (*c.shape[:-1], 1)) for x in series)

    def _difference(self, q: Array, other: Array) -> Array:
        """Displacements (…, nv), rotation vectors in the places of the attitude, else 0."""
        displacements = np.zeros((*q.shape[:-1], self.layout.v.size))
        here, there = self.rotation(q), self.rotation(other)
        displacements[..., self.layout.v.attitude] = rotation_vector(transposed(here) @ there)
        return displacements

    def rotation(self, q: Array) -> Array:
        """R (…, 3, 3), from the base's frame to the world, at q (…, nq) of unit length."""
        attitude = q[..., self.layout.q.attitude]
        if not self.layout.is_quaternion:
            still = [(0, 0)] * (attitude.ndim - 1) + [(0, 3 - attitude.shape[-1])]
            return rotation_matrix(self._sequence, np.pad(attitude, still))
        return rotation_of(attitude)

    def spread(self, position: Array) -> Array:
        """Entries (…, 3) along three axes, of those (…, p) along which the base moves."""
        entries = np.zeros((*position.shape[:-1], 3))
        entries[..., self._along] = position
        return entries

    def normalised(self, q: Array) -> Array:
        """Coordinates (…, nq) of which modules may be asked: with quaternions of unit length."""
        if not self.space.has_quaternion:
            return q
        return self._evaluated("normalised", lambda _, c: [unit_entries(self, c)], c=q)[0]

    def rates(self, q: Array, v: Array) -> Array:
        """Rates (…, nq) of coordinates by v (…, nv), which keep the length of a quaternion."""
        return self._evaluated("rates", lambda base, c, v: [base.rates(v, c)], c=q, v=v)[0]

    def errors(
        self, q: Array, v: Array, q_desired: Array, v_desired: Array, back: ArrayLike = RETURN
    ) -> tuple[Array, Array]:
        """Errors and their rates (…, nv), those of the position in world axes.

        `back` (2) is as of `RETURN`.
        """

        def outputs(
            base: Base, c: Node, v: Node, wanted: Node, v_wanted: Node, back: Node
        ) -> Sequence[Node]:
            desired = DesiredNodes(coordinates_of(wanted, self.space), v_wanted, v_wanted, back)
            return base.errors(v, desired)

        arguments = {"c": q, "v": v, "c_desired": q_desired, "v_desired": v_desired}
        arguments["back"] = np.broadcast_to(back, (*q.shape[:-1], 2))
        return self._evaluated("errors", outputs, **arguments)

    def turned(self, turning: Turning) -> tuple[Array, Array, Array]:
        """Entries (s, …) of the attitude in q, v and a of a rotation with s instants.

        They have no jumps in time. Raises `SingularAttitudeError` where there are none.
        """
        attitude = self._entries(turning.rotation)
        c = np.zeros((*attitude.shape[:-1], self.layout.q.size))
        c[..., self.layout.q.attitude] = attitude
        return attitude, *self.attitude_rates(c, turning.velocity, turning.acceleration)

    def attitude_rates(self, q: Array, spin: Array, growth: Array) -> tuple[Array, Array]:
        """Entries of the attitude in v and a, by the angular velocity and acceleration.

        These (…, 3) are in world axes.
        """

        def outputs(base: Base, c: Node, spin: Node, growth: Node) -> Sequence[Node]:
            rest = zeros(3), zeros(len(self.layout.v.joint_places))
            rates = base.attitude_entries(zeros(self.layout.v.size), base.to_base(spin))
            turning = base.to_base(growth)
            return rates, base.attitude_entries(placed(self, rates, *rest), turning)

        return self._evaluated("turned", outputs, q, spin=spin, growth=growth)

    def _entries(self, rotation: Array) -> Array:
        """Entries (s, …) of the attitude in q, without jumps, of rotations (s, 3, 3)."""
        if not self.layout.is_quaternion:
            angles = attitude_angles(self._sequence, rotation)[..., : len(self._about)]
            return np.unwrap(angles, axis=0)
        return quaternions_of(rotation)

    def continued(self, last: Array, attitude: Array) -> Array:
        """Entries (s, …) of the attitude in q that go on from the last ones: the same attitudes.

        Angles with as many whole turns more, or quaternions or their opposites.
        """
        if self.layout.is_quaternion:
            return np.copysign(1.0, attitude[0] @ last) * attitude
        return attitude + 2.0 * np.pi * np.round((last - attitude[0]) / (2.0 * np.pi))

    def moved(self, turning: Turning, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Entries of the position in v and a, by its rates (…, 3) in world axes."""
        if self.layout.turns_with_base:
            inverse = transposed(turning.rotation)
            velocity = times(inverse, velocity)
            carried = np.cross(times(inverse, turning.velocity), velocity)
            acceleration = times(inverse, acceleration) - carried
        along, _ = self.layout.driven_axes
        return velocity[..., along], acceleration[..., along]

    def base_motion(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Array]:
        """The motion of the base by q (…, nq), v and a (…, nv).

        Velocity and acceleration (…, 3) of the point at x, y, z, in world axes, then the angular
        ones, in the base's.
        """

        def outputs(base: Base, c: Node, v: Node, a: Node) -> Sequence[Node]:
            return *base.linear(v, a), *base.angular(v, a)

        return self._evaluated("moving", outputs, q, v=v, a=a)

    def kept(self, v: Array, turn: Array) -> Array:
        """Velocities (nv) of a base that is turned but moves on, or whose angles go on.

        `turn` (3, 3) leads from its frame before to that after.
        """
        after, places = v.copy(), self.layout.v
        if self.layout.turns_with_base:
            axes_of = zip((places.position, places.attitude), self.layout.driven_axes, strict=True)
            for part, axes in axes_of:
                after[part] = turn[np.ix_(axes, axes)] @ v[part]
        return after

    def motion(self, c: Array, rates: Array, growth: Array) -> tuple[Array, Array, Array]:
        """q, v and a of entries c (…, nq), a quaternion of any length, and their rates."""

        def outputs(base: Base, *nodes: Node) -> Sequence[Node]:
            return pose_motion(self, *nodes)

        return self._evaluated("motion", outputs, c, rates=rates, growth=growth)

    def reference(self, motion: Motion) -> Reference:
        """Quintics of all coordinates, whose rates are v, or as `PoseReference` has them."""
        return Reference(motion) if self.space.is_flat else PoseReference(motion, self)


class PoseReference(Reference):
    """A desired motion whose quintics are those of coordinates of which v does not hold the rates.

    Between knots the quaternion is as good as of unit length, and is made so; velocities and
    accelerations are the exact rates of what that gives.
    """

    def __init__(self, motion: Motion, kinematics: Kinematics) -> None:
        self.kinematics, layout = kinematics, kinematics.layout
        rates = kinematics.rates(motion.q, motion.v)
        # Rates of the rates: velocities of the position and those of a quaternion turn.
        growth = kinematics.rates(motion.q, motion.a)
        acceleration = kinematics.base_motion(motion.q, motion.v, motion.a)[1]
        growth[:, layout.q.position] = acceleration[:, layout.own_axes[0]]
        if kinematics.space.has_quaternion:
            spun, attitude = motion.q.copy(), layout.q.attitude
            spun[:, attitude] = rates[:, attitude]
            growth[:, attitude] += kinematics.rates(spun, motion.v)[:, attitude]
        super().__init__(Motion(motion.time, motion.q, rates, growth))

    def __call__(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Evaluate q (…, nq), v and a (…, nv) at times (…), as those of `Reference` are."""
        return self.kinematics.motion(*super().__call__(time))


def kinematics_of(layout: Layout) -> Kinematics:
    """The kinematics of a base with angles, or with a quaternion; equal layouts share theirs."""
    return _of_layout(layout.attitude, layout.q.names, layout.q.units)


@lru_cache(maxsize=64)
def _of_layout(attitude: str, names: tuple[str, ...], units: tuple[str, ...]) -> Kinematics:
    return Kinematics(Layout.listed(attitude, names, units, 0))
