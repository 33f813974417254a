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
from numpy.typing import NDArray
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
from gibbs_codegen.flight.vectors import Array, Flags, skew, times

# Thrust axis and its first two derivatives, and the acceleration that is added to the path's, all
# (s, 3), to lateral force as a share of the weight (s, 2).
LateralForce = Callable[[Array, Array, Array, Array], Array]
# Knots that a finite difference takes: of fourth order inside, of the third at least at the ends.
STENCIL = 5
# Order of the derivative of the thrust axis that is to be small.
_ROUGHNESS = 3
# Frequency above which the path is left rather than the axis made to swing, at most, rad/s; else it
# is that with which the machine swings about its base centre, so that it does not swing for long.
_FASTEST = 60.0
# Steps of differences of the lateral force, for the four arguments.
_STEPS = (1e-6, 1e-4, 1e-2, 1e-2)
# Newton's method: most steps, and the change of the axis and the lateral force that end it.
_MOST_STEPS = 25
_CONVERGED = 1e-7
Indices = NDArray[np.int64]
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
    lateral: LateralForce, axis: Array, shift: Array, grid: Grid, gravity: float, fixed: Flags
) -> tuple[Array, Array]:
    """Unit thrust axes, and shifts of the base centre from its path, m, without lateral force.

    Both are (s, 3) in world axes, and `fixed` (s) tells the knots at which they stay as given.
    Raises `UsageError`, with the time where most force is missing, if none is found.
    """
    count = len(axis)
    found = np.concatenate([axis.ravel(), shift.ravel()])
    free = np.flatnonzero(~np.tile(np.repeat(fixed, 3), 2))
    # Where all of the knots that derivatives take are held, there is nothing to solve.
    settled = ~(abs(grid.growth) @ ~fixed > 0.0)
    bound = np.flatnonzero(~np.concatenate([np.repeat(settled, 2), fixed]))
    cost = None
    for _ in range(_MOST_STEPS):
        residual, slopes = _linear(lateral, found[: 3 * count], found[3 * count :], grid)
        if cost is None:
            cost = _cost(slopes, grid, gravity)[free]
        normal = found[: 3 * count].reshape(-1, 3)
        residual = np.concatenate([residual.ravel(), 0.5 * (np.sum(normal**2, axis=-1) - 1.0)])
        jacobian = _jacobian(slopes, normal, grid)[bound][:, free]
        system = sparse.block_array([[cost[:, free], jacobian.T], [jacobian, None]], format="csc")
        right = -np.concatenate([cost @ found, residual[bound]])
        step = spsolve(system, right)[: len(free)]
        found[free] += step
        if not np.all(np.isfinite(step)):
            break
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            normal, shift = found.reshape(2, count, 3)
            return normal / np.linalg.norm(normal, axis=-1, keepdims=True), shift
    worst = grid.time[np.argmax(np.abs(residual[: 2 * count]).reshape(-1, 2).max(axis=-1))]
    # Before a flight begins its path rests: what fails there is how it sets out.
    raise UsageError(
        f"at t = {max(worst, 0.0):.6g} s no tilt is found with which the base follows its path, "
        "since its rotors push along one axis only; choose a gentler motion"
    )


def _linear(
    lateral: LateralForce, axis: Array, shift: Array, grid: Grid
) -> tuple[Array, list[Array]]:
    """Lateral force (s, 2), and its derivatives (s, 2, 3) by its four arguments, by differences."""
    axis, shift = axis.reshape(-1, 3), shift.reshape(-1, 3)
    at = [axis, grid.rate @ axis, grid.growth @ axis, grid.growth @ shift]
    slopes = []
    for place, step in enumerate(_STEPS):
        columns = []
        for unit in step * np.eye(3):
            ahead, behind = [*at], [*at]
            ahead[place], behind[place] = at[place] + unit, at[place] - unit
            columns.append((lateral(*ahead) - lateral(*behind)) / (2.0 * step))
        slopes.append(np.stack(columns, axis=-1))
    return lateral(*at), slopes


def _jacobian(slopes: list[Array], axis: Array, grid: Grid) -> sparse.csr_array:
    """Derivatives (3 s, 6 s) of what is to be zero by axes, then shifts.

    Rows are lateral forces, then how far axes are from unit length.
    """
    rate, growth = (sparse.kron(each, sparse.eye_array(3)) for each in (grid.rate, grid.growth))
    by_axis, by_rate, by_growth, by_push = (_blocks(slope) for slope in slopes)
    turned = by_axis + by_rate @ rate + by_growth @ growth
    rows = [[turned, by_push @ growth], [_blocks(axis[:, np.newaxis]), None]]
    return sparse.block_array(rows, format="csr")


def _blocks(blocks: Array) -> sparse.csr_array:
    """The matrix with blocks (s, r, c) along its diagonal."""
    places = np.arange(len(blocks))
    return sparse.csr_array(sparse.bsr_array((blocks, places, np.arange(len(blocks) + 1))))


def _cost(slopes: list[Array], grid: Grid, gravity: float) -> sparse.csr_array:
    """The quadratic form (6 s, 6 s) of axes and shifts that is to be least.

    Both parts are without dimension: the roughness of the axis, and the shift against the
    acceleration of gravity, at the frequency where the one begins to outweigh the other.
    """
    # A pendulum of length l, whose lateral force is −n − l n̈ / g, swings with √(g / l).
    pendulum = np.abs(slopes[2]).max() ** -0.5 if np.any(slopes[2]) else np.inf
    frequency = min(pendulum, _FASTEST)
    rough = differences(_ROUGHNESS, grid.count, grid.step) / frequency**_ROUGHNESS
    near = (frequency**2 / gravity) ** 2 * sparse.eye_array(grid.count)
    parts = sparse.block_diag([rough.T @ rough, near])
    return sparse.csr_array(sparse.kron(parts, sparse.eye_array(3)))


class UnderactuatedBase:
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

    def motion(self, axes: Derivatives, shift: Derivatives) -> Motion:
        """The motion with thrust axes, and shifts of the base centre.

        Each is (s, 3) with its first two derivatives, world axes.
        """
        centre = self.centre[:, :3] + np.stack(shift, axis=1)
        tilt = shortest_rotation(self.upright, unit_derivatives(*axes))
        turning = turning_of(*product_derivatives(np.matmul, tilt, self._wanted))
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
        return times(self._sides, wrench) / self.weight

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
            self.vehicle, joints, self._axis[places], self.centre[places], turning
        )

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
        fixed = np.zeros(self.grid.count, dtype=bool)
        fixed[:STENCIL], fixed[-STENCIL:] = still[0], still[-1]
        return fixed


def underactuated_motion(
    vehicle: Vehicle,
    time: Array,
    joints_at: Callable[[Array], Motion],
    path: Path,
    orientation: Orientation,
    progress: Callable[[float], None] = lambda share: None,
) -> Motion:
    """The motion nearest to a path that a base can fly whose rotors push along one axis.

    Where pieces between the evenly spaced knots need lateral force, 2, 4 … times as many are taken.
    `joints_at` gives the motion of the joints for knots, the base's coordinates at zero;
    `orientation` is the attitude but for the base's tilt. Raises `UsageError`, with the time, where
    thrust would have to vanish or to point against the scenario's attitude, where the attitude is
    singular, where joints bring the rotors to where they do not command three moments, and where
    the base cannot stay near its path.
    """
    refinement = -(-_FEWEST // (len(time) - 1))
    while True:
        knots = refined(time, refinement)
        centre = bounded_path(knots, path, "path of the base")
        turning = orientation(path, knots, vehicle.arm_angles())
        joints = joints_at(knots)
        axis = _axes(vehicle, joints)
        base = UnderactuatedBase(vehicle, joints, axis, centre, turning)
        longer, own = base.with_room(_ROOM * refinement)
        motion = _solution(longer, progress)
        motion = Motion(knots, motion.q[own], motion.v[own], motion.a[own])
        deviation = _deviation(vehicle, motion, base.weight)
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
    axes, time = base.point_mass(), base.joints.time
    shift, fixed = np.zeros_like(axes), base.at_rest()
    for begin in range(0, len(time), _SPAN):
        span = slice(max(begin - STENCIL, 0), begin + _SPAN + _OVERLAP)
        part = base.at(span, time[span])
        try:
            axes[span], shift[span] = nearest_motion(
                part.lateral, axes[span], shift[span], part.grid, base.gravity, fixed[span]
            )
        except SingularAttitudeError as error:
            instant = time[span][error.place]
            raise SingularAttitudeError(f"at t = {instant:.6g} s {error}", error.place) from None
        # The next span goes on from here.
        fixed[max(begin + _SPAN - STENCIL, 0) : begin + _SPAN] = True
        progress(min(1.0, span.stop / len(time)))
        if span.stop >= len(time):
            break
    off = np.linalg.norm(shift, axis=-1)
    if off.max() > _FARTHEST:
        raise UsageError(
            f"at t = {time[np.argmax(off)]:.6g} s the base cannot follow its path: the nearest "
            f"motion that its thrust allows is {off.max():.3g} m off; choose a gentler motion"
        )
    rate, growth = base.grid.rate, base.grid.growth
    return base.motion((axes, rate @ axes, growth @ axes), (shift, rate @ shift, growth @ shift))


def _deviation(vehicle: Vehicle, motion: Motion, weight: float) -> Deviation | None:
    """Where pieces between knots need lateral force, or other thrusts than at the knots beside.

    The farthest from what is allowed; None if both are next to nothing. `weight` in N.
    """
    time = refined(motion.time, 2)
    q, v, a = vehicle.kinematics.reference(motion)(time)
    force = vehicle.base_wrench(q, vehicle.inverse_dynamics(q, v, a))[:, :3]
    axis = _axes(vehicle, Motion(time, q, v, a))
    lateral = np.linalg.norm(np.cross(axis, force), axis=-1)[1::2]
    thrusts = needed_inputs(vehicle, q, v, a)[:, : vehicle.rotors]
    between = thrusts[1::2] - 0.5 * (thrusts[:-1:2] + thrusts[2::2])
    shares = np.stack(
        [lateral / (_LATERAL * weight), np.abs(between).max(axis=-1) / (_UNEVEN * weight)]
    )
    kind, place = np.unravel_index(np.argmax(shares), shares.shape)
    if shares[kind, place] <= 1.0:
        return None
    off = (_LATERAL, _UNEVEN)[kind] * weight * shares[kind, place]
    return Deviation(int(place), time[1::2][place], off, "N")
