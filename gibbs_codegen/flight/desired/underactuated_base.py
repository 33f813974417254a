"""Motions that a base can fly whose rotors push along one axis.

Such a base leans where it is to accelerate. Its thrust axis is turned from where the scenario's
attitude has it, by the shortest way, to where the motion needs it: so the heading is kept, and tilt
is what physics asks for. Without an arm, and with the centre of mass at the base centre, the axis
is that of acceleration and gravity (differential flatness).

In general collocation finds it. Such a base cannot choose its attitude: its lateral force is zero.
Where the centre of mass is off the base centre that is a differential equation of the thrust axis,
which as a rule swings for ever or grows without bounds when it is integrated from the start. So all
knots are solved for at once. The solution is the motion without lateral force
whose base centre is nearest to its path and whose thrust axis is smoothest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import (
    SingularAttitudeError,
    Turning,
    product_derivatives,
    turning_of,
)
from gibbs_codegen.flight.desired.base_trajectory import (
    Deviation,
    base_motion,
    bounded_path,
    check_none,
    refine,
    refined,
)
from gibbs_codegen.flight.desired.demands import needed_inputs
from gibbs_codegen.flight.desired.led_frames import LedFrames
from gibbs_codegen.flight.desired.posture import with_joints
from gibbs_codegen.flight.plant.allocation import LEANS_BY_THRUST, force_axis, thrust_axis
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.orientation import Orientation
from gibbs_codegen.flight.scenario.paths import Path, plane
from gibbs_codegen.flight.vectors import Array, Flags, Indices, skew, times, transposed

# Unknowns and their first two derivatives, all (s, c), to what has to vanish (s, r), and its
# derivatives (3, s, r, c) by these three. What has to vanish is lateral force as a share of the
# weight (2), how far the axis is from unit length, how far frames are from their paths, m. Unknowns
# are the thrust axis (3), the shift of the base centre from its path (3), m, and free numbers of
# joints that lead frames.
Linear = Callable[[Array, Array, Array], tuple[Array, Array]]
# Knots that a finite difference takes: of fourth order inside, of the third at least at the ends.
STENCIL = 5
# Order of the derivative of the thrust axis that is to be small.
_ROUGHNESS = 3
# Frequency above which the path is left rather than the axis made to swing, at most, rad/s; else it
# is that with which the machine swings about its base centre, so that it does not swing for long.
_FASTEST = 60.0
# What roughness of joints costs against that of the axis, and posture.
_JOINTS, _POSTURE = 0.1, 1e-4
# Newton's method: most steps, and the change of the axis and the lateral force that end it.
_MOST_STEPS = 25
_CONVERGED = 1e-7
# Share of gravity that thrust must at least make, and cosine of the greatest angle between the
# thrust axis and that of the scenario's attitude.
_LEAST_THRUST, _OPPOSITE = 0.05, -0.985
# Speeds, rates and so on that count as rest.
_REST = 1e-9
# Knots that are solved for at once, and those beyond that are found again.
_SPAN, _OVERLAP = 4096, 1024
# Fewest pieces, so that there are differences of third order.
_FEWEST = 8
# Knots of rest before and after a motion between rests, before they are refined: the base swings
# there, ahead of its path and after it.
_ROOM = 300
# Greatest lateral force between knots, as a share of the weight, and greatest distance from the
# path, m.
_LATERAL, _FARTHEST = 1e-3, 0.1
# Greatest distance between knots of a led frame from its path, m.
_MISSED = 1e-6
# Parts of the unknowns: thrust axis, shift of the base, free numbers of the joints.
_PARTS = slice(0, 3), slice(3, 6), slice(6, None)
# What a joint may move more easily than the base may shift, rad²/m², the greatest step towards a
# path, rad or m, and distances of the base from its path that count as the same, m.
_SHIFT, _LONGEST, _SAME = 1e-6, 0.3, 1e-4
# What the base may be off its path to lead frames, of how far these are from it.
_LEANING = 0.8
# Keeps a matrix from being singular.
_TINY = 1e-14
# Greatest distance of a thrust between knots from the mean of those at the knots, as a share of the
# weight.
_UNEVEN = 5e-3
_TOO_FAST = ("the base turns too fast", "choose a gentler motion, or a shorter one")


class Tilt:
    """The shortest rotation of a unit vector to the direction of an axis, nowhere opposite to it.

    Vectors are (3, s, 3): they, and their first two derivatives in time; likewise matrices.
    """

    def __init__(self, begin: Array, axis: Array) -> None:
        length = _power(_product(_dot, axis, axis), -0.5)
        self.begin, self.end = begin, _product(np.multiply, length, axis)
        # Derivatives of the unit vector by the axis.
        self._by_axis = -_product(_outer, self.end, self.end)
        self._by_axis[0] += np.eye(3)
        self._by_axis = _product(np.multiply, length[..., np.newaxis], self._by_axis)
        self._both = begin + self.end
        below = _product(_dot, begin, self.end)
        below[0] += 1.0
        self._middle = _product(np.multiply, _power(below, -1.0), self._both)

    @cached_property
    def rotation(self) -> Array:
        """The rotation (3, s, 3, 3)."""
        # A half turn about the first vector, then one about what is in the middle between both.
        turned = 2.0 * _product(_outer, self.end, self.begin)
        turned -= _product(_outer, self._middle, self._both)
        turned[0] += np.eye(3)
        return turned

    def turned(self, vector: Array) -> tuple[Array, Array]:
        """A vector (3, s, 3), turned, and its derivatives (3, s, 3, 3) by the axis."""
        along = 2.0 * _product(_dot, self.begin, vector)
        across = _product(_dot, self._middle, vector)
        turned = vector - _product(np.multiply, across, self._both)
        turned += _product(np.multiply, along, self.end)
        rest = _product(np.multiply, across, self.begin) - vector
        slope = (along - across)[..., np.newaxis] * np.eye(3) + _product(_outer, self._middle, rest)
        return turned, _product(np.matmul, slope, self._by_axis)

    def back_slope(self, vector: Array) -> Array:
        """Derivatives (s, 3, 3) by the axis of a vector (s, 3) that is turned back."""
        begin, middle = self.begin[0], self._middle[0]
        across = _dot(middle, vector)
        slope = _outer(middle, across * begin - vector) + 2.0 * _outer(begin, vector)
        return (slope - across[..., np.newaxis] * np.eye(3)) @ self._by_axis[0]


def _product(product: Callable[[Array, Array], Array], a: Array, b: Array) -> Array:
    return np.stack(product_derivatives(product, a, b))


def _dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1, keepdims=True)


def _outer(a: Array, b: Array) -> Array:
    return a[..., :, np.newaxis] * b[..., np.newaxis, :]


def _power(x: Array, exponent: float) -> Array:
    """A power of numbers (3, s, 1) with their first two derivatives."""
    slope = exponent * x[0] ** (exponent - 1.0)
    bend = (exponent - 1.0) * slope / x[0]
    return np.stack([x[0] ** exponent, slope * x[1], bend * x[1] ** 2 + slope * x[2]])


@dataclass(frozen=True)
class Grid:
    """Knots (s) at equal steps of time, s, and the finite differences on them."""

    time: Array

    @property
    def count(self) -> int:
        """The number of knots."""
        return len(self.time)

    @property
    def step(self) -> float:
        """Distance of knots, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @cached_property
    def rate(self) -> scipy.sparse.csr_array:
        """Matrix (count, count) of the first derivative."""
        return differences(1, self.count, self.step)

    @cached_property
    def growth(self) -> scipy.sparse.csr_array:
        """Matrix (count, count) of the second derivative."""
        return differences(2, self.count, self.step)


def differences(order: int, count: int, step: float) -> scipy.sparse.csr_array:
    """Matrix (count, count) of finite differences at knots `step` apart, of 4th order inside."""
    width = min(count, STENCIL + (order > 2))
    wanted = np.zeros(width)
    wanted[order] = np.prod(np.arange(1, order + 1)) / step**order
    # Powers of the distances of knots from each place of the stencil.
    powers = [
        np.vander(np.arange(width) - float(place), increasing=True).T for place in range(width)
    ]
    weights = np.array([np.linalg.solve(power, wanted) for power in powers])
    knots = np.arange(count)
    first = np.clip(knots - width // 2, 0, count - width)
    columns = first[:, np.newaxis] + np.arange(width)
    places = np.repeat(knots, width), columns.ravel()
    return scipy.sparse.csr_array((weights[knots - first].ravel(), places), shape=(count, count))


def nearest_motion(
    linear: Linear, unknowns: Array, near: Array, grid: Grid, gravity: float, fixed: Flags
) -> Array:
    """Thrust axes, shifts of the base centre from its path, m, and free joints, as conditions want.

    `unknowns` (s, c) has them to begin with, axes and shifts in world axes; `near` (s, c) is where
    shifts and joints are to stay near, and `fixed` (s) tells the knots at which they stay as given.
    Raises `UsageError`, with the time where most force is missing, if none is found.
    """
    count, columns = unknowns.shape
    free = np.flatnonzero(np.repeat(~fixed, columns))
    # Where all of the knots that derivatives take are held, there is nothing to solve.
    unsettled = abs(grid.growth) @ ~fixed > 0.0
    if columns > 6:
        # Where joints are found as well, forces at the very ends would determine motions that grow
        # from there, or fade.
        unsettled = ~fixed
        unsettled[: STENCIL // 2] = unsettled[-(STENCIL // 2) :] = False
    cost = None
    for _ in range(_MOST_STEPS):
        missing, slopes = linear(unknowns, grid.rate @ unknowns, grid.growth @ unknowns)
        if cost is None:
            rough, weights = _cost(slopes, columns, grid, gravity)
            cost = rough + scipy.sparse.kron(
                scipy.sparse.eye_array(count), scipy.sparse.diags_array(weights)
            )
            cost = scipy.sparse.csr_array(cost)[free]
            kept = np.tile(~fixed[:, np.newaxis], missing.shape[1])
            kept[:, :2] = unsettled[:, np.newaxis]
            bound = np.flatnonzero(kept)
        jacobian = _jacobian(slopes, grid)[bound][:, free]
        system = scipy.sparse.block_array(
            [[cost[:, free], jacobian.T], [jacobian, None]], format="csc"
        )
        pull = (weights * near).ravel()[free] - cost @ unknowns.ravel()
        step = np.zeros(unknowns.size)
        step[free] = scipy.sparse.linalg.spsolve(
            system, np.concatenate([pull, -missing.ravel()[bound]])
        )[: len(free)]
        unknowns = unknowns + step.reshape(count, columns)
        if not np.all(np.isfinite(step)):
            break
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            unknowns[:, :3] /= np.linalg.norm(unknowns[:, :3], axis=-1, keepdims=True)
            return unknowns
    worst = grid.time[np.argmax(np.abs(missing[:, :2]).max(axis=-1))]
    # Before a flight begins its path rests: what fails there is how it sets out.
    raise UsageError(
        f"at t = {max(worst, 0.0):.6g} s no tilt lets the base follow its path, because its "
        "rotors push along one axis; choose a gentler motion"
    )


def _jacobian(slopes: Array, grid: Grid) -> scipy.sparse.csr_array:
    """Derivatives (r s, c s) of conditions by the unknowns."""
    size = scipy.sparse.eye_array(slopes[0].shape[-1])
    rate, growth = (
        scipy.sparse.kron(matrix, size, format="csr") for matrix in (grid.rate, grid.growth)
    )
    by_place, by_rate, by_growth = (_blocks(slope) for slope in slopes)
    return scipy.sparse.csr_array(by_place + by_rate @ rate + by_growth @ growth)


def _blocks(blocks: Array) -> scipy.sparse.csr_array:
    """The matrix with blocks (s, r, c) along its diagonal."""
    places = np.arange(len(blocks))
    return scipy.sparse.csr_array(
        scipy.sparse.bsr_array((blocks, places, np.arange(len(blocks) + 1)))
    )


def _cost(
    slopes: Array, columns: int, grid: Grid, gravity: float
) -> tuple[scipy.sparse.csr_array, Array]:
    """The cost of the unknowns: a quadratic form (s c, s c), weights (c) of squares.

    All is without dimension: the roughness of axes and joints, and the shift against the
    acceleration of gravity, at the frequency where the one begins to outweigh the other.
    """
    # A pendulum of length l, whose lateral force is −n − l n̈ / g, swings with √(g / l).
    by_growth = slopes[2][:, :2, :3]
    pendulum = np.abs(by_growth).max() ** -0.5 if np.any(by_growth) else np.inf
    frequency = min(pendulum, _FASTEST)
    rough = differences(_ROUGHNESS, grid.count, grid.step) / frequency**_ROUGHNESS
    shares = np.repeat([1.0, 0.0, _JOINTS], [3, 3, columns - 6])
    weights = np.repeat([0.0, (frequency**2 / gravity) ** 2, _POSTURE], [3, 3, columns - 6])
    return scipy.sparse.kron(rough.T @ rough, scipy.sparse.diags_array(shares)), weights


def _parts(unknowns: Sequence[Array]) -> Sequence[Array]:
    """Thrust axis, shift of the base and free numbers of the joints (3, s, …), of unknowns."""
    return [np.stack([order[:, part] for order in unknowns]) for part in _PARTS]


class UnderactuatedBase:
    """The base on a path, leaning by thrust axes that are to be found.

    - `joints`: their motion at knots, the base's coordinates at zero
    - `axis` (s, 3): thrust axes in the base's frame
    - `centre` (s, ≥ 3, 3): position, velocity and acceleration of the base centre, world axes
    - `wanted`: attitude that the scenario has
    - `led`: frames that joints lead along paths, with their `targets` (s, ≥ 3, m, 3)
    """

    def __init__(
        self,
        vehicle: Vehicle,
        joints: Motion,
        axis: Array,
        centre: Array,
        wanted: Turning,
        led: LedFrames,
        targets: Array,
    ) -> None:
        self.vehicle, self.joints, self.centre = vehicle, joints, centre
        self.led, self.targets = led, targets
        self._axis, self._turning = axis, wanted
        self.grid = Grid(joints.time)
        spin, spin_rate = skew(wanted.velocity), skew(wanted.acceleration)
        turn = wanted.rotation
        self._wanted = turn, spin @ turn, (spin_rate + spin @ spin) @ turn
        normal = axis, self.grid.rate @ axis, self.grid.growth @ axis
        # The thrust axis of the scenario's attitude, world axes.
        self.upright = np.stack(product_derivatives(times, self._wanted, normal))
        # Across the thrust axis of the scenario's attitude, world axes.
        self._sides = np.stack(plane(axis), axis=-2) @ transposed(turn)
        self.mass = float(vehicle.mass)
        self.gravity = -float(vehicle.gravity)

    def motion(self, *unknowns: Array) -> Motion:
        """The motion with unknowns, as `Linear` has them, and their first two derivatives."""
        axes, shift, numbers = _parts(unknowns)
        centre = self.centre[:, :3] + np.moveaxis(shift, 0, 1)
        tilt = Tilt(self.upright, axes).rotation
        turning = turning_of(*product_derivatives(np.matmul, tilt, self._wanted))
        base = base_motion(self.vehicle, self.joints.time, centre, turning)
        motion = with_joints(self.vehicle, base, self.joints)
        return self.led.with_joints(self.vehicle, motion, numbers)

    def linear(self, *unknowns: Array) -> tuple[Array, Array]:
        """Residuals (s, r), and their derivatives (3, s, r, c), as `Linear` has them.

        By Newton's law the force on the robot is its mass times what its centre of mass
        accelerates, and weight. Where y depends on x and time, and Y is dy/dx, the derivatives of
        d²y/dt² by x, dx/dt and d²x/dt² are d²Y/dt², 2 dY/dt and Y.
        """
        axes, shift, numbers = _parts(unknowns)
        tilt = Tilt(self.upright, axes)
        joints = self.led.with_joints(self.vehicle, self.joints, numbers)
        lever, by_joints = self._lever(joints, numbers[0]) if self.led.paths else self._unled_lever
        swung, by_axis = tilt.turned(lever)
        force = self.centre[:, 2] + shift[2] + swung[2] + np.array([0.0, 0.0, self.gravity])
        sides = self._sides @ transposed(tilt.rotation[0]) / abs(self.gravity)
        missed, led_slopes = self.misses(unknowns[0])
        length = 0.5 * (np.sum(axes[0] ** 2, axis=-1, keepdims=True) - 1.0)
        missing = np.concatenate([times(sides, force), length, missed], axis=-1)
        slopes = np.zeros((3, *missing.shape, unknowns[0].shape[1]))
        by_joints = _product(np.matmul, tilt.rotation, by_joints)
        for part, slope in ((_PARTS[0], by_axis), (_PARTS[2], by_joints)):
            for order, factor in enumerate((1.0, 2.0, 1.0)):
                slopes[order, :, :2, part] = factor * (sides @ slope[2 - order])
        slopes[0, :, :2, :3] += self._sides @ tilt.back_slope(force) / abs(self.gravity)
        slopes[2, :, :2, 3:6] = sides
        slopes[0, :, 2, :3] = axes[0]
        slopes[0, :, 3:] = led_slopes
        return missing, slopes

    @cached_property
    def _unled_lever(self) -> tuple[Array, Array]:
        return self._lever(self.joints, np.zeros((self.grid.count, 0)))

    def _lever(self, joints: Motion, numbers: Array) -> tuple[Array, Array]:
        """From the base centre to the centre of mass (3, s, 3), m, with the scenario's attitude.

        And its derivatives (3, s, 3, n) by free numbers (s, n) of the joints.
        """
        robot, q = self.vehicle, joints.q
        place = robot.centre_of_mass(q) - robot.centre_offset(robot.neutral)
        jacobian = robot.centre_of_mass_jacobian(q)
        force = robot.inverse_dynamics(q, joints.v, joints.a)[:, robot.layout.v.position]
        growth = robot.kinematics.spread(force) / self.mass - [0.0, 0.0, self.gravity]
        lever = product_derivatives(times, self._wanted, (place, times(jacobian, joints.v), growth))
        slope = self._wanted[0] @ self.led.by_numbers(self.vehicle, jacobian, numbers)
        rows = slope.reshape(len(q), -1)
        rates = self.grid.rate @ rows, self.grid.growth @ rows
        return np.stack(lever), np.stack([slope, *(rate.reshape(slope.shape) for rate in rates)])

    def misses(self, unknowns: Array) -> tuple[Array, Array]:
        """Distances of frames (s, 3 m) from their paths, m, and derivatives (s, 3 m, c)."""
        robot, count = self.vehicle, len(unknowns)
        axes, shift, numbers = _parts((unknowns, *np.zeros((2, *unknowns.shape))))
        tilt = Tilt(self.upright, axes)
        q = self.led.with_joints(robot, self.joints, numbers).q
        reach = self.led.positions(robot, q) - robot.centre_offset(robot.neutral)
        reach = reach @ transposed(self._wanted[0])
        jacobian = self.led.by_numbers(robot, self.led.jacobians(robot, q), numbers[0])
        jacobian = (tilt.rotation[0] @ self._wanted[0])[:, np.newaxis] @ jacobian
        off = (self.centre[:, 0] + shift[0])[:, np.newaxis] - self.targets[:, 0]
        slopes = np.zeros((*off.shape, unknowns.shape[1]))
        slopes[..., 3:6], slopes[..., 6:] = np.eye(3), jacobian
        for frame in range(off.shape[1]):
            arm = np.stack([reach[:, frame], *np.zeros((2, count, 3))])
            turned, by_axis = tilt.turned(arm)
            off[:, frame] += turned[0]
            slopes[:, frame, :, :3] = by_axis[0]
        return off.reshape(count, -1), slopes.reshape(count, -1, unknowns.shape[1])

    def with_room(self, count: int) -> tuple[UnderactuatedBase, slice]:
        """The same with `count` more knots at ends where the machine rests, and the path's knots.

        A base swings before its path begins to move, and after it has ended.
        """
        fixed, last = self.at_rest(), self.grid.count - 1
        before, after = count * int(fixed[0]), count * int(fixed[-1])
        places = np.arange(-before, last + after + 1)
        time = self.joints.time[0] + self.grid.step * places
        longer = self.at(np.clip(places, 0, last), time)
        return longer, slice(before, before + last + 1)

    def at(self, places: slice | Indices, time: Array) -> UnderactuatedBase:
        """The same with what it has at some knots, at other times (s)."""
        joints, turning = self.joints, self._turning
        joints = Motion(time, joints.q[places], joints.v[places], joints.a[places])
        turning = Turning(
            turning.rotation[places], turning.velocity[places], turning.acceleration[places]
        )
        return UnderactuatedBase(
            self.vehicle,
            joints,
            self._axis[places],
            self.centre[places],
            turning,
            self.led,
            self.targets[places],
        )

    def quasistatic(self, axis: Array) -> Array:
        """Unknowns (s, c) with frames on their paths, each knot by itself, at thrust axes (s, 3).

        The base is off its path where the joints do not get there.
        """
        start = np.concatenate([axis, np.zeros_like(axis)], axis=-1)
        if not self.led.paths:
            return start
        # As many as derivatives take.
        count = max(len(self.led.starts), STENCIL)
        numbers = np.resize(self.led.starts, (count, len(self.led.joints)))
        first = self.at(np.zeros(count, dtype=int), np.arange(count, dtype=float))
        tried, jacobian = first._reached(np.hstack([np.tile(start[0], (count, 1)), numbers]))
        off = np.linalg.norm(np.hstack([tried[:, 3:6], first.misses(tried)[0]]), axis=-1)
        # The one of the nearest postures that moves the frames most evenly.
        weakest = np.linalg.svd(jacobian[:, :, 6:], compute_uv=False)[:, -1]
        best = tried[np.argmax(np.where(off < off.min() + _SAME, weakest, -1.0)), 6:]
        return self._reached(np.hstack([start, np.tile(best, (len(axis), 1))]))[0]

    def _reached(self, unknowns: Array) -> tuple[Array, Array]:
        """Unknowns (s, c) near to others with frames on paths, and the frames' Jacobian (s, m, c).

        Thrust axes stay as they are. Rows that do not get there are off their paths.
        """
        ease = np.repeat([0.0, _SHIFT, 1.0], [3, 3, unknowns.shape[1] - 6])
        for _ in range(_MOST_STEPS):
            missing, jacobian = self.misses(unknowns)
            square = (jacobian * ease) @ np.swapaxes(jacobian, 1, 2)
            square += _TINY * np.eye(square.shape[-1])
            pull = np.linalg.solve(square, missing[..., np.newaxis])[..., 0]
            step = -ease * times(np.swapaxes(jacobian, 1, 2), pull)
            # Numbers of joints at their limits have a long way.
            size = (np.abs(step) / (1.0 + np.abs(unknowns))).max(axis=-1, keepdims=True)
            unknowns = unknowns + step * np.minimum(1.0, _LONGEST / np.maximum(size, _LONGEST))
            if size.max() < _CONVERGED:
                break
        return unknowns, jacobian

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
                f"{self.vehicle.name}: at t = 0 s there is no gravity, and {LEANS_BY_THRUST}; "
                "set parameters.gravity to a value other than 0"
            )
        against = np.sum(needed * self.upright[0], axis=-1) < _OPPOSITE * size
        check_none(
            time,
            against & (needed[:, 2] * self.gravity < 0.0),
            "the path of the base falls faster than free fall, which needs a downward thrust",
        )
        check_none(
            time,
            size < _LEAST_THRUST * abs(self.gravity),
            "the path of the base is close to free fall, where no thrust turns the base",
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
        """True for knots (s) that are held: the first and last ones, if the machine rests there."""
        rates = [self._wanted[1].reshape(self.grid.count, -1), self.centre[:, 1], self.centre[:, 2]]
        rates += [self.joints.v, self.joints.a]
        rates.append(self.targets[:, 1:3].reshape(self.grid.count, -1))
        still = np.all(np.abs(np.concatenate(rates, axis=1)) < _REST, axis=1)
        fixed = np.zeros(self.grid.count, dtype=bool)
        fixed[:STENCIL], fixed[-STENCIL:] = still[0], still[-1]
        return fixed


def underactuated_motion(
    vehicle: Vehicle,
    time: Array,
    joints_at: Callable[[Array], Motion],
    path: Path,
    orientation: Orientation,
    led: LedFrames,
    progress: Callable[[float], None] = lambda share: None,
) -> Motion:
    """The motion nearest to a path that a base can fly whose rotors push along one axis.

    Where pieces between the evenly spaced knots need lateral force, 2, 4 … times as many are taken.
    `joints_at` gives the motion of the joints for knots, the base's coordinates at zero, but for
    those that lead frames. `orientation` is the attitude but for the base's tilt.
    Raises `UsageError`, with the time, where thrust would have to vanish or to point against the
    scenario's attitude, where the attitude is singular, where joints bring the rotors to where they
    do not command three moments, and where the base cannot stay near its path.
    """
    refinement = -(-_FEWEST // (len(time) - 1))
    while True:
        knots = refined(time, refinement)
        centre = bounded_path(knots, path, "path of the base")
        turning = orientation(path, knots, vehicle.arm_angles())
        joints = joints_at(knots)
        axis = _axes(vehicle, joints)
        targets = led.targets(knots)
        base = UnderactuatedBase(vehicle, joints, axis, centre, turning, led, targets)
        longer, inner = base.with_room(_ROOM * refinement)
        motion = _solution(longer, progress)
        motion = Motion(knots, motion.q[inner], motion.v[inner], motion.a[inner])
        deviation = _deviation(vehicle, motion, base.mass * abs(base.gravity), led)
        if deviation is None:
            return motion
        refinement = refine(refinement, time, deviation, *_TOO_FAST)


def _axes(vehicle: Vehicle, joints: Motion) -> Array:
    """Unit thrust axes (s, 3) in the base's frame.

    Raises `UsageError` with the first time without one.
    """
    if not vehicle.wrenches_vary:
        return np.broadcast_to(force_axis(vehicle.thrust_wrenches()), (len(joints.q), 3))
    axis = thrust_axis(vehicle, joints.q)
    if axis is not None:
        return axis
    fails = np.array([thrust_axis(vehicle, q[np.newaxis]) is None for q in joints.q])
    raise UsageError(
        f"at t = {joints.time[fails][0]:.6g} s the joints hold the rotors so that they cannot "
        "command a force along one axis and three moments; choose another posture or other moves"
    )


def _solution(base: UnderactuatedBase, progress: Callable[[float], None]) -> Motion:
    """The motion of a leaning base, in spans of knots that overlap.

    What lies ahead matters for a few seconds only, so that the end of each span is found again.
    """
    time, fixed = base.joints.time, base.at_rest()
    unknowns = base.quasistatic(base.point_mass())
    near = unknowns.copy()
    _check_near(base, unknowns)
    for begin in range(0, len(time), _SPAN):
        span = slice(max(begin - STENCIL, 0), begin + _SPAN + _OVERLAP)
        part = base.at(span, time[span])
        unknowns[span] = nearest_motion(
            part.linear, unknowns[span], near[span], part.grid, base.gravity, fixed[span]
        )
        # The next span goes on from here.
        fixed[max(begin + _SPAN - STENCIL, 0) : begin + _SPAN] = True
        progress(min(1.0, span.stop / len(time)))
        if span.stop >= len(time):
            break
    _check_near(base, unknowns)
    try:
        return base.motion(unknowns, base.grid.rate @ unknowns, base.grid.growth @ unknowns)
    except SingularAttitudeError as error:
        instant = time[error.place]
        raise SingularAttitudeError(f"at t = {instant:.6g} s {error}", error.place) from None


def _check_near(base: UnderactuatedBase, unknowns: Array) -> None:
    """Raise `UsageError` where the base is too far from its path, or frames are from theirs."""
    shift, led, remedy = unknowns[:, 3:6], base.led, "choose a gentler motion"
    off, most = np.linalg.norm(shift, axis=-1), _FARTHEST
    fault = "the base cannot follow its path: the nearest possible motion is {} m off"
    if names := list(led.paths):
        remedy = "bring the paths of base and arm closer together, or choose a gentler motion"
        reach = base.targets[:, 0] - (base.centre[:, 0] + shift)[:, np.newaxis]
        most = max(most, _LEANING * float(np.linalg.norm(reach, axis=-1).max()))
        fault = f"the base would be {{}} m off its path to keep {', '.join(names)} on theirs"
        missed = np.linalg.norm(base.misses(unknowns)[0].reshape(len(off), -1, 3), axis=-1)
        if missed.max() > _MISSED:
            name = names[int(np.argmax(missed.max(axis=0)))]
            off, most, fault = missed.max(axis=1), _MISSED, f"{name} stays {{}} m off its path"
    worst = int(np.argmax(off))
    if off[worst] <= most:
        return
    if at_limits := led.at_limits(base.vehicle, unknowns[worst, 6:]):
        fault += f", with joints at their limits ({at_limits})"
    instant = max(base.joints.time[worst], 0.0)
    raise UsageError(f"at t = {instant:.6g} s {fault.format(f'{off[worst]:.3g}')}; {remedy}")


def _deviation(vehicle: Vehicle, motion: Motion, weight: float, led: LedFrames) -> Deviation | None:
    """Pieces between knots that need lateral force, or other thrusts than at the knots beside.

    Or where frames leave their paths. The farthest from what is allowed; None if all are next to
    nothing. `weight` in N.
    """
    time = refined(motion.time, 2)
    q, v, a = vehicle.kinematics.reference(motion)(time)
    force = vehicle.base_wrench(q, vehicle.inverse_dynamics(q, v, a))[:, :3]
    axis = _axes(vehicle, Motion(time, q, v, a))
    lateral = np.linalg.norm(np.cross(axis, force), axis=-1)[1::2]
    thrusts = needed_inputs(vehicle, q, v, a)[:, : vehicle.rotors]
    between = np.abs(thrusts[1::2] - 0.5 * (thrusts[:-1:2] + thrusts[2::2])).max(axis=-1)
    excesses = [(lateral, _LATERAL * weight, "N"), (between, _UNEVEN * weight, "N")]
    missed = np.linalg.norm(led.misses(vehicle, q, led.targets(time)), axis=-1)
    excesses.append((missed[1::2], _MISSED, "m"))
    off, allowed, unit = max(excesses, key=lambda excess: excess[0].max() / excess[1])
    place = int(np.argmax(off))
    if off[place] <= allowed:
        return None
    return Deviation(place, time[1::2][place], off[place], unit)
