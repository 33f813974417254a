"""Motions that a base can fly whose rotors push along one axis.

Such a base leans where it is to accelerate. Its thrust axis is turned from where the scenario's
attitude has it, by the shortest way, to where the motion needs it: so the heading is kept, and tilt
is what physics asks for. Without an arm, and with the centre of mass at the base centre, the axis
is that of acceleration and gravity (differential flatness).

In general collocation finds it. Such a base cannot choose its attitude: its lateral force is zero.
Where the centre of mass is off the base centre that is a differential equation of the thrust axis,
which as a rule swings for ever or grows without bounds when it is integrated from the start. So all
knots are solved for at once. Of the motions without lateral force that one is taken whose base
centre is nearest to its path and whose thrust axis is smoothest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.base_trajectory import (
    Deviation,
    base_motion,
    bounded_path,
    check_none,
    refine,
    refined,
)
from gibbs_codegen.flight.desired.led_frames import LedFrames
from gibbs_codegen.flight.desired.posture import with_joints
from gibbs_codegen.flight.desired.timing import needed_inputs
from gibbs_codegen.flight.plant.allocation import LEANS_BY_THRUST, force_axis, thrust_axis
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.orientation import (
    Derivatives,
    Orientation,
    SingularAttitudeError,
    Turning,
    product_derivatives,
    turning_of,
    unit_derivatives,
)
from gibbs_codegen.flight.scenario.paths import Path, plane
from gibbs_codegen.flight.vectors import Array, Flags, Indices, skew, times

# Unknowns and their first two derivatives, all (s, c), to what has to vanish (s, r): lateral force
# as a share of the weight (2), how far the axis is from unit length, how far frames are from their
# paths, m. Unknowns are the thrust axis (3), the shift of the base centre from its path (3), m, and
# free numbers of joints that lead frames.
Conditions = Callable[[Array, Array, Array], Array]
# Knots that a finite difference takes: of fourth order inside, of the third at least at the ends.
STENCIL = 5
# Order of the derivative of the thrust axis that is to be small.
_ROUGHNESS = 3
# Frequency above which the path is left rather than the axis made to swing, at most, rad/s; else it
# is that with which the machine swings about its base centre, so that it does not swing for long.
_FASTEST = 60.0
# Steps of differences of the conditions, for unknowns and their derivatives.
_STEPS = (1e-6, 1e-4, 1e-2)
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


def shortest_rotation(begin: Derivatives, end: Derivatives) -> Derivatives:
    """The shortest rotation (s, 3, 3) of a unit vector to another, with its first two derivatives.

    The vectors and their derivatives are (s, 3), nowhere opposite to each other.
    """
    about = product_derivatives(np.cross, begin, end)
    dot = product_derivatives(lambda a, b: np.sum(a * b, axis=-1), begin, end)
    below = 1.0 + dot[0]
    share = (1.0 / below, -dot[1] / below**2, 2.0 * dot[1] ** 2 / below**3 - dot[2] / below**2)
    outer = product_derivatives(
        lambda a, b: a[..., :, np.newaxis] * b[..., np.newaxis, :], about, about
    )
    along = product_derivatives(_product_with, share, outer)
    # Rodrigues' formula, with the axis times the sine as `about`.
    first, second, third = (
        _product_with(d, np.eye(3)) + skew(w) + p for d, w, p in zip(dot, about, along, strict=True)
    )
    return first, second, third


def _product_with(scalar: Array, matrix: Array) -> Array:
    return scalar[..., np.newaxis, np.newaxis] * matrix


@dataclass(frozen=True)
class Grid:
    """Knots (s) at equal steps of time, s, and the finite differences on them."""

    time: Array

    @property
    def count(self) -> int:
        """How many knots there are."""
        return len(self.time)

    @property
    def step(self) -> float:
        """Distance of knots, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @cached_property
    def rate(self) -> sparse.csr_array:
        """Matrix (count, count) of the first derivative."""
        return differences(1, self.count, self.step)

    @cached_property
    def growth(self) -> sparse.csr_array:
        """Matrix (count, count) of the second derivative."""
        return differences(2, self.count, self.step)


def differences(order: int, count: int, step: float) -> sparse.csr_array:
    """Matrix (count, count) of finite differences at knots `step` apart, of 4th order inside."""
    width = min(count, STENCIL + (order > 2))
    wanted = np.zeros(width)
    wanted[order] = np.prod(np.arange(1, order + 1)) / step**order
    # Of knots at each place of the stencil.
    powers = [
        np.vander(np.arange(width) - float(place), increasing=True).T for place in range(width)
    ]
    weights = np.array([np.linalg.solve(each, wanted) for each in powers])
    knots = np.arange(count)
    first = np.clip(knots - width // 2, 0, count - width)
    columns = first[:, np.newaxis] + np.arange(width)
    places = np.repeat(knots, width), columns.ravel()
    return sparse.csr_array((weights[knots - first].ravel(), places), shape=(count, count))


def nearest_motion(
    conditions: Conditions, found: Array, near: Array, grid: Grid, gravity: float, fixed: Flags
) -> Array:
    """Thrust axes, shifts of the base centre from its path, m, and free joints, as conditions want.

    `found` (s, c) has them to begin with, axes and shifts in world axes; `near` (s, c) is where
    shifts and joints are to stay near, and `fixed` (s) tells the knots at which they stay as given.
    Raises `UsageError`, with the time where most force is missing, if none is found.
    """
    count, columns = found.shape
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
        missing, slopes = _linear(conditions, found, grid.rate @ found, grid.growth @ found)
        if cost is None:
            rough, weights = _cost(slopes, columns, grid, gravity)
            cost = rough + sparse.kron(sparse.eye_array(count), sparse.diags_array(weights))
            cost = sparse.csr_array(cost)[free]
            kept = np.tile(~fixed[:, np.newaxis], missing.shape[1])
            kept[:, :2] = unsettled[:, np.newaxis]
            bound = np.flatnonzero(kept)
        jacobian = _jacobian(slopes, grid)[bound][:, free]
        system = sparse.block_array([[cost[:, free], jacobian.T], [jacobian, None]], format="csc")
        pull = (weights * near).ravel()[free] - cost @ found.ravel()
        step = np.zeros(found.size)
        step[free] = spsolve(system, np.concatenate([pull, -missing.ravel()[bound]]))[: len(free)]
        found = found + step.reshape(count, columns)
        if not np.all(np.isfinite(step)):
            break
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            found[:, :3] /= np.linalg.norm(found[:, :3], axis=-1, keepdims=True)
            return found
    worst = grid.time[np.argmax(np.abs(missing[:, :2]).max(axis=-1))]
    # Before a flight begins its path rests: what fails there is how it sets out.
    raise UsageError(
        f"at t = {max(worst, 0.0):.6g} s no tilt is found with which the base follows its path, "
        "since its rotors push along one axis only; choose a gentler motion"
    )


def _linear(conditions: Conditions, *at: Array, orders: int = 3) -> tuple[Array, list[Array]]:
    """Conditions (s, r), and derivatives (s, r, c) by unknowns, rates and second rates.

    By differences, of the first `orders` of these three.
    """
    count, columns = at[0].shape
    missing, slopes = conditions(*at), []
    for order, step in enumerate(_STEPS[:orders]):
        slopes.append(np.zeros((count, missing.shape[1], columns)))
        for column in range(columns):
            # What a base feels depends on neither place nor speed; where it is, frames are told.
            if 3 <= column < 6 and (order == 1 or (order == 0 and columns == 6)):
                continue
            ahead, behind = [*at], [*at]
            unit = step * np.eye(columns)[column]
            ahead[order], behind[order] = at[order] + unit, at[order] - unit
            slopes[order][..., column] = (conditions(*ahead) - conditions(*behind)) / (2.0 * step)
    return missing, slopes


def _jacobian(slopes: list[Array], grid: Grid) -> sparse.csr_array:
    """Derivatives (r s, c s) of conditions by the unknowns."""
    size = sparse.eye_array(slopes[0].shape[-1])
    rate, growth = (sparse.kron(each, size, format="csr") for each in (grid.rate, grid.growth))
    by_place, by_rate, by_growth = (_blocks(slope) for slope in slopes)
    return sparse.csr_array(by_place + by_rate @ rate + by_growth @ growth)


def _blocks(blocks: Array) -> sparse.csr_array:
    """The matrix with blocks (s, r, c) along its diagonal."""
    places = np.arange(len(blocks))
    return sparse.csr_array(sparse.bsr_array((blocks, places, np.arange(len(blocks) + 1))))


def _cost(
    slopes: list[Array], columns: int, grid: Grid, gravity: float
) -> tuple[sparse.csr_array, Array]:
    """What is to be least of the unknowns: a quadratic form (s c, s c), weights (c) of squares.

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
    return sparse.kron(rough.T @ rough, sparse.diags_array(shares)), weights


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
        own = axis, self.grid.rate @ axis, self.grid.growth @ axis
        # The thrust axis of the scenario's attitude, world axes.
        self.upright = product_derivatives(times, self._wanted, own)
        self._sides = np.stack([np.stack(plane(tuple(each))) for each in axis])
        self.weight = float(np.linalg.norm(self._force(vehicle.neutral, 0.0)))
        at_rest, lifted = (float(self._force(vehicle.neutral, each)[2]) for each in (0.0, 1.0))
        self.gravity = at_rest / (lifted - at_rest)

    def _force(self, q: Array, upwards: float) -> Array:
        """Force (3) on the level base that accelerates upwards, m/s², N."""
        v, a = np.zeros((2, self.vehicle.layout.v.size))
        a[self.vehicle.layout.v.position.stop - 1] = upwards
        return self.vehicle.base_wrench(q, self.vehicle.inverse_dynamics(q, v, a))[:3]

    def motion(self, *found: Array) -> Motion:
        """The motion with unknowns, as `Conditions` has them, and their first two derivatives."""
        axes, shift, numbers = (
            (found[0][:, part], found[1][:, part], found[2][:, part]) for part in _PARTS
        )
        centre = self.centre[:, :3] + np.stack(shift, axis=1)
        tilt = shortest_rotation(self.upright, unit_derivatives(*axes))
        turning = turning_of(*product_derivatives(np.matmul, tilt, self._wanted))
        base = base_motion(self.vehicle, self.joints.time, centre, turning)
        motion = with_joints(self.vehicle, base, self.joints)
        return self.led.with_joints(self.vehicle, motion, numbers)

    def conditions(self, *found: Array) -> Array:
        """What has to vanish (s, r), as `Conditions` has it."""
        motion = self.motion(*found)
        force = self.vehicle.inverse_dynamics(motion.q, motion.v, motion.a)
        lateral = times(self._sides, self.vehicle.base_wrench(motion.q, force)[:, :3]) / self.weight
        length = 0.5 * (np.sum(found[0][:, :3] ** 2, axis=-1, keepdims=True) - 1.0)
        led = self.led.misses(self.vehicle, motion.q, self.targets)
        return np.concatenate([lateral, length, led], axis=-1)

    def misses(self, found: Array) -> Array:
        """How far frames (s, 3 m) are from their paths, m."""
        return self._misses(found, *np.zeros((2, *found.shape)))

    def _misses(self, *found: Array) -> Array:
        return self.led.misses(self.vehicle, self.motion(*found).q, self.targets)

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
        off = np.linalg.norm(np.hstack([tried[:, 3:6], first.misses(tried)]), axis=-1)
        # Of the nearest postures that which moves the frames most evenly.
        weakest = np.linalg.svd(jacobian[:, :, 6:], compute_uv=False)[:, -1]
        best = tried[np.argmax(np.where(off < off.min() + _SAME, weakest, -1.0)), 6:]
        return self._reached(np.hstack([start, np.tile(best, (len(axis), 1))]))[0]

    def _reached(self, found: Array) -> tuple[Array, Array]:
        """Unknowns (s, c) near to others with frames on paths, and the frames' Jacobian (s, m, c).

        Thrust axes stay as they are. Rows that do not get there are off their paths.
        """
        ease = np.repeat([0.0, _SHIFT, 1.0], [3, 3, found.shape[1] - 6])
        still = np.zeros_like(found)
        for _ in range(_MOST_STEPS):
            missing, (jacobian,) = _linear(self._misses, found, still, still, orders=1)
            square = (jacobian * ease) @ np.swapaxes(jacobian, 1, 2)
            square += _TINY * np.eye(square.shape[-1])
            pull = np.linalg.solve(square, missing[..., np.newaxis])[..., 0]
            step = -ease * times(np.swapaxes(jacobian, 1, 2), pull)
            # Numbers of joints at their limits have a long way.
            size = (np.abs(step) / (1.0 + np.abs(found))).max(axis=-1, keepdims=True)
            found = found + step * np.minimum(1.0, _LONGEST / np.maximum(size, _LONGEST))
            if size.max() < _CONVERGED:
                break
        return found, jacobian

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
        longer, own = base.with_room(_ROOM * refinement)
        motion = _solution(longer, progress)
        motion = Motion(knots, motion.q[own], motion.v[own], motion.a[own])
        deviation = _deviation(vehicle, motion, base.weight, led)
        if deviation is None:
            return motion
        refinement = refine(refinement, time, deviation, *_TOO_FAST)


def _axes(vehicle: Vehicle, joints: Motion) -> Array:
    """Unit thrust axes (s, 3) in the base's frame.

    Raises `UsageError` with the first time without one.
    """
    if not vehicle.rotors_move:
        return np.broadcast_to(force_axis(vehicle.thrust_wrenches()), (len(joints.q), 3))
    axis = thrust_axis(vehicle, joints.q)
    if axis is not None:
        return axis
    fails = np.array([thrust_axis(vehicle, q[np.newaxis]) is None for q in joints.q])
    raise UsageError(
        f"at t = {joints.time[fails][0]:.6g} s the joints bring the rotors to where they do not "
        "command a force along one axis and three moments; choose another posture or other moves"
    )


def _solution(base: UnderactuatedBase, progress: Callable[[float], None]) -> Motion:
    """The motion of a leaning base, in spans of knots that overlap.

    What lies ahead matters for a few seconds only, so that the end of each span is found again.
    """
    time, fixed = base.joints.time, base.at_rest()
    found = base.quasistatic(base.point_mass())
    near = found.copy()
    _check_near(base, found)
    for begin in range(0, len(time), _SPAN):
        span = slice(max(begin - STENCIL, 0), begin + _SPAN + _OVERLAP)
        part = base.at(span, time[span])
        try:
            found[span] = nearest_motion(
                part.conditions, found[span], near[span], part.grid, base.gravity, fixed[span]
            )
        except SingularAttitudeError as error:
            instant = time[span][error.place]
            raise SingularAttitudeError(f"at t = {instant:.6g} s {error}", error.place) from None
        # The next span goes on from here.
        fixed[max(begin + _SPAN - STENCIL, 0) : begin + _SPAN] = True
        progress(min(1.0, span.stop / len(time)))
        if span.stop >= len(time):
            break
    _check_near(base, found)
    return base.motion(found, base.grid.rate @ found, base.grid.growth @ found)


def _check_near(base: UnderactuatedBase, found: Array) -> None:
    """Raise `UsageError` where the base is too far from its path, or frames are from theirs."""
    shift, led, remedy = found[:, 3:6], base.led, "choose a gentler motion"
    off, most = np.linalg.norm(shift, axis=-1), _FARTHEST
    fault = "the base cannot follow its path: the nearest motion that its thrust allows is {} m off"
    if names := list(led.paths):
        remedy = "lead the paths of base and arm nearer to each other, or choose a gentler motion"
        reach = base.targets[:, 0] - (base.centre[:, 0] + shift)[:, np.newaxis]
        most = max(most, _LEANING * float(np.linalg.norm(reach, axis=-1).max()))
        fault = f"the base would be {{}} m off its path for {', '.join(names)} to be on theirs"
        missed = np.linalg.norm(base.misses(found).reshape(len(off), -1, 3), axis=-1)
        if missed.max() > _MISSED:
            name = names[int(np.argmax(missed.max(axis=0)))]
            off, most, fault = missed.max(axis=1), _MISSED, f"{name} stays {{}} m off its path"
    worst = int(np.argmax(off))
    if off[worst] <= most:
        return
    if at_limits := led.at_limits(base.vehicle, found[worst, 6:]):
        fault += f", with joints at their limits ({at_limits})"
    instant = max(base.joints.time[worst], 0.0)
    raise UsageError(f"at t = {instant:.6g} s {fault.format(f'{off[worst]:.3g}')}; {remedy}")


def _deviation(vehicle: Vehicle, motion: Motion, weight: float, led: LedFrames) -> Deviation | None:
    """Where pieces between knots need lateral force, or other thrusts than at the knots beside.

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
    found = [(lateral, _LATERAL * weight, "N"), (between, _UNEVEN * weight, "N")]
    missed = np.linalg.norm(led.misses(vehicle, q, led.targets(time)), axis=-1)
    found.append((missed[1::2], _MISSED, "m"))
    off, allowed, unit = max(found, key=lambda each: each[0].max() / each[1])
    place = int(np.argmax(off))
    if off[place] <= allowed:
        return None
    return Deviation(place, time[1::2][place], off[place], unit)
