"""A base on a path whose thrust axis is to be found, and the lateral force that it then lacks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.attitude import Turning
from gibbs_codegen.scenario.orientation import turning_of, unit_derivatives
from gibbs_codegen.scenario.paths import plane
from gibbs_codegen.simulator.desired.base_trajectory import base_motion
from gibbs_codegen.simulator.desired.collocation import STENCIL, Grid
from gibbs_codegen.simulator.desired.joint_moves import with_joints
from gibbs_codegen.simulator.desired.knots import check_none
from gibbs_codegen.simulator.desired.swing import Derivatives, applied, product, skew, swing
from gibbs_codegen.simulator.plant.thrust_axis import LEANS_BY_THRUST
from gibbs_codegen.simulator.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.simulator.reference import Motion

Indices = NDArray[np.int64]
# Share of gravity that thrust must at least make, and cosine of the greatest angle between the
# thrust axis and that of the scenario's attitude.
_LEAST_THRUST, _OPPOSITE = 0.05, -0.985
# Speeds, rates and so on that count as rest.
_REST = 1e-9


class Leaning:
    """The base on a path, leaning by thrust axes that are to be found.

    - `joints`: their motion at knots, the base's coordinates at zero
    - `axis` (s, 3): thrust axes in the base's frame
    - `centre` (s, ≥ 3, 3): position, velocity and acceleration of the base centre, world axes
    - `wanted`: attitude that the scenario has
    """

    def __init__(
        self, vehicle: Vehicle, joints: Motion, axis: Array, centre: Array, wanted: Turning
    ) -> None:
        self.vehicle, self.joints, self.centre = vehicle, joints, centre
        self._axis, self._turning = axis, wanted
        self.grid = Grid(joints.time)
        spin, spin_rate = skew(wanted.velocity), skew(wanted.acceleration)
        turn = wanted.rotation
        self._wanted = turn, spin @ turn, (spin_rate + spin @ spin) @ turn
        own = axis, self.grid.rate @ axis, self.grid.growth @ axis
        # The thrust axis of the scenario's attitude, world axes.
        self.upright = product(applied, self._wanted, own)
        self._sides = np.stack([np.stack(plane(tuple(each))) for each in axis])
        self.weight = float(np.linalg.norm(self._force(vehicle.neutral, 0.0)))
        held, lifted = (float(self._force(vehicle.neutral, each)[2]) for each in (0.0, 1.0))
        self.gravity = held / (lifted - held)

    def _force(self, q: Array, upwards: float) -> Array:
        """Force (3) on the level base that accelerates upwards, m/s², N."""
        v, a = np.zeros((2, self.vehicle.layout.v.size))
        a[self.vehicle.layout.v.position.stop - 1] = upwards
        return self.vehicle.base_wrench(q, self.vehicle.inverse_dynamics(q, v, a))[:3]

    def motion(self, axes: Derivatives, shift: Derivatives) -> Motion:
        """The motion with thrust axes, and shifts of the base centre.

        Each is (s, 3) with its first two derivatives, world axes.
        """
        centre = self.centre[:, :3] + np.stack(shift, axis=1)
        tilt = swing(self.upright, unit_derivatives(*axes))
        turning = turning_of(*product(np.matmul, tilt, self._wanted))
        base = base_motion(self.vehicle, self.joints.time, centre, turning)
        return with_joints(self.vehicle, base, self.joints)

    def lateral(self, axis: Array, rate: Array, growth: Array, push: Array) -> Array:
        """Lateral force (s, 2) that the base would need, by weight, as `LateralForce` has it.

        Thrust axes and their first two derivatives (s, 3) are in world axes; `push` (s, 3), m/s²,
        is added to the acceleration of the base centre.
        """
        still = np.zeros_like(push)
        motion = self.motion((axis, rate, growth), (still, still, push))
        force = self.vehicle.inverse_dynamics(motion.q, motion.v, motion.a)
        wrench = self.vehicle.base_wrench(motion.q, force)[:, :3]
        share: Array = applied(self._sides, wrench) / self.weight
        return share

    def part(self, span: slice) -> Leaning:
        """The same at some of the knots."""
        if len(self.joints.time[span]) == self.grid.count:
            return self
        return self._at(span, self.joints.time[span])

    def with_room(self, count: int) -> tuple[Leaning, slice]:
        """The same with `count` more knots at ends where the machine rests, and the path's knots.

        A base swings before its path begins to move, and after it has ended.
        """
        held, last = self.at_rest(), self.grid.count - 1
        before, after = count * int(held[0]), count * int(held[-1])
        places = np.arange(-before, last + after + 1)
        time = self.joints.time[0] + self.grid.step * places
        longer = self._at(np.clip(places, 0, last), time)
        return longer, slice(before, before + last + 1)

    def _at(self, places: slice | Indices, time: Array) -> Leaning:
        """The same with what it has at some knots, at other times (s)."""
        joints, turning = self.joints, self._turning
        joints = Motion(time, joints.q[places], joints.v[places], joints.a[places])
        turning = Turning(
            turning.rotation[places], turning.velocity[places], turning.acceleration[places]
        )
        return Leaning(self.vehicle, joints, self._axis[places], self.centre[places], turning)

    def point_mass(self) -> Array:
        """Thrust axes (s, 3) of a point mass on the path, world axes.

        Raises `UsageError`, with the time, where thrust would have to vanish or to point against
        the scenario's attitude.
        """
        time = self.joints.time
        needed = self.centre[:, 2] + np.array([0.0, 0.0, self.gravity])
        size = np.linalg.norm(needed, axis=-1)
        if self.gravity == 0.0:
            raise UsageError(
                f"{self.vehicle.name}: at t = 0 s nothing holds the robot without "
                f"gravity, and {LEANS_BY_THRUST}; give parameters.gravity another value than 0"
            )
        against = np.sum(needed * self.upright[0], axis=-1) < _OPPOSITE * size
        check_none(
            time,
            against & (needed[:, 2] * self.gravity < 0.0),
            "the path of the base falls faster than freely, for which thrust has to push down",
        )
        check_none(
            time,
            size < _LEAST_THRUST * abs(self.gravity),
            "the path of the base is next to free fall, in which no thrust turns the base",
        )
        axis: Array = needed / size[:, np.newaxis]
        if np.any(against):
            raise UsageError(
                f"at t = {time[against][0]:.6g} s the path of the base needs thrust against that "
                "of the scenario's attitude; choose a gentler path, or an attitude that turns with "
                'it (base.attitude.kind = "turn")'
            )
        return axis

    def at_rest(self) -> Flags:
        """Which knots (s) are held: the first and the last ones, where the machine rests there."""
        rates = [self._wanted[1].reshape(self.grid.count, -1), self.centre[:, 1], self.centre[:, 2]]
        rates += [self.joints.v, self.joints.a]
        still = np.all(np.abs(np.concatenate(rates, axis=1)) < _REST, axis=1)
        held = np.zeros(self.grid.count, dtype=bool)
        held[:STENCIL], held[-STENCIL:] = still[0], still[-1]
        return held
