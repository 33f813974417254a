"""Inverse kinematics of the arm: joints that bring the tip to a point, and lead it along a path.

At one instant: damped least squares (the method of Levenberg and Marquardt) on the Jacobian of the
tip, within joint limits. It serves arms of any number of joints, redundant or not.

Rates and accelerations: ẋ = J v and ẍ = J a + J̇ v, with the base's part of J on the other side.
Redundant arms take the minimum-norm rates v = J⁺ẋ, whose derivative also has a part in the null
space of J. A joint brakes before its limit, and the others take over its part of the motion. Rates
of least norm are v = Jᵀλ. A joint that should move by g = (Jᵀλ)ᵢ towards a limit that is the way d
off does so up to κ d, and beyond that moves by κ d + (g − κ d) d / (d + r). That is
v = c + s² Jᵀλ, with s² = d / (d + r) and c = κ r s², so that rates do not jump, nor where d comes
to 0. An arm without motion to choose moves as its path wants until it meets a limit.

Along a path each knot is solved from the one before: a predictor of second order takes the joints
from knot to knot, damped least squares put the tip on its path, and the null-space motion of
redundant arms is integrated from its rates. An arm without motion to choose has one solution at
each knot: there every eighth knot is solved so, and then all at once, by Newton's method from
quintics between these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.base_trajectory import (
    BATCH,
    CHECKS,
    Deviation,
    bounded_path,
    check_times,
    refine,
    refined,
    tolerance,
)
from gibbs_codegen.flight.plant.vehicle import Array, Flags, RobotData, Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.paths import Path
from gibbs_codegen.flight.vectors import halton, times

# Lower and upper limits of the joints (n), rad or m; infinite where there are none.
JointBounds = tuple[Array, Array]

# Distance from its target at which the tip counts as there, m.
REACHED = 1e-9
_ITERATIONS = 200
# Steps that no longer change anything, rad or m.
_SETTLED = 1e-13
# Postures that the search for the first one begins with.
_GUESSES = 32
# Share of the largest singular value below which the least counts as nearly singular.
_NEARLY_SINGULAR = 1e-4
# Singular values of the Jacobian below this share of the largest carry no motion.
_RANK = 1e-7
# Speed and acceleration that a singular arm may fail to give, m/s and m/s².
_TOLERANCE = 1e-6
# Rate towards a limit at which joints begin to brake, for each rad or m of the way, 1/s: κ.
_BRAKING = 4.0
# The way to a limit, rad or m, on which a joint that brakes moves half as far as it should: r.
_HALF = 3.0
# Changes of the set of joints that brake, for each joint.
_CHANGES = 4
# Step of the difference that gives the rate of the Jacobian, in s at rates of 1.
_DIFFERENCE = 1e-5
# Shares of the arm's length: what a singular arm may stay away from its path, and the way after
# which the path shows where it goes.
_NEAR = 1e-6
_FAR = 1e-3
# Knots that are tried, of all that there are, once the path is known to leave the arm's reach.
_TRIED_OUT_OF_REACH = 200
# Knots from one that is solved from the one before to the next, where all others are solved at
# once, and how far quintics between these may be from their solutions, rad or m.
_STRIDE, _CLOSE = 8, 1e-3
# What to do where a scenario asks too much of the arm.
OTHER_SCENARIO = "choose a scenario without a path of the tip, such as --scenario hold"


def reach(vehicle: Vehicle, q: Array, target: Array, limits: JointBounds) -> tuple[Array, float]:
    """Coordinates (nq) that bring the tip nearest to `target` (3), world axes, and how near, m.

    Only joints move; attitude and position are kept.
    """
    q = q.copy()
    arm = vehicle.arm
    q[arm] = np.clip(q[arm], *limits)
    fixed = limits[0] >= limits[1]
    arm_rates = vehicle.arm_rates
    error = target - vehicle.tip_pose(q)[:3, 3]
    damping = 1e-6
    for _ in range(_ITERATIONS):
        jacobian = np.where(fixed, 0.0, vehicle.tip_jacobian(q)[:3, arm_rates])
        step = _damped_step(jacobian, error, damping, (limits[0] - q[arm], limits[1] - q[arm]))
        if np.max(np.abs(step), initial=0.0) < _SETTLED:
            break
        trial = q.copy()
        trial[arm] += step
        trial_error = target - vehicle.tip_pose(trial)[:3, 3]
        if trial_error @ trial_error < error @ error:
            q, error, damping = trial, trial_error, max(damping / 10.0, 1e-12)
        elif damping > 1e12:
            break
        else:
            damping *= 10.0
    return q, float(np.linalg.norm(error))


def _damped_step(jacobian: Array, error: Array, damping: float, room: JointBounds) -> Array:
    """The step δ (n) of least |J δ − e|² + λ|δ|² within `room`, its distances from joint limits.

    J (3, n) is of the tip's position, e (3), m, leads from the tip to its target, and `damping` is
    λ as a share of the mean square of J's singular values.
    """
    square = jacobian @ jacobian.T
    weight = damping * (np.trace(square) / 3.0 + 1e-12)
    step: Array = jacobian.T @ np.linalg.solve(square + weight * np.eye(3), error)
    if np.all((step >= room[0]) & (step <= room[1])):
        return step
    # `lsq_linear` wants bounds that differ.
    slack = 1e-15
    bounds = (np.minimum(room[0], 0.0) - slack, np.maximum(room[1], 0.0) + slack)
    stacked = np.vstack([jacobian, np.sqrt(weight) * np.eye(len(step))])
    desired = np.concatenate([error, np.zeros(len(step))])
    step_within: Array = scipy.optimize.lsq_linear(stacked, desired, bounds=bounds, method="bvls").x
    return np.clip(step_within, *room)


def first_posture(
    vehicle: Vehicle, q: Array, target: Array, limits: JointBounds, guess: Array | None
) -> tuple[Array, float]:
    """Coordinates (nq) that bring the tip to a point, without any to go on from, and how near, m.

    It takes the posture whose Jacobian is farthest from singular, and among equals the one with the
    joints nearest to 0. `guess` (n) are joints to begin with; None tries many.
    """
    if guess is not None:
        q = q.copy()
        q[vehicle.arm] = guess
        return reach(vehicle, q, target, limits)
    low = np.where(np.isfinite(limits[0]), limits[0], -np.pi)
    high = np.where(np.isfinite(limits[1]), limits[1], np.pi)
    endless = np.isinf(limits[0]) & np.isinf(limits[1]) & vehicle.is_angle[vehicle.arm]
    postures = []
    for share in halton(_GUESSES, vehicle.joints):
        start = q.copy()
        start[vehicle.arm] = low + share * (high - low)
        there, distance = reach(vehicle, start, target, limits)
        joints = there[vehicle.arm]  # Those that turn without limits get angles within [−π, π).
        there[vehicle.arm] = np.where(endless, (joints + np.pi) % (2.0 * np.pi) - np.pi, joints)
        postures.append((there, distance))
    there, distance = min(postures, key=lambda posture: posture[1])
    if distance > REACHED:
        return there, distance
    reached = [posture for posture in postures if posture[1] <= REACHED]
    measures = [_least_singular_value(vehicle, there) for there, _ in reached]
    # Elbow up or down, say, are as good as each other: then the joints nearest to 0.
    best = [p for p, m in zip(reached, measures, strict=True) if m >= 0.999 * max(measures)]

    def distance_from_zero(posture: tuple[Array, float]) -> tuple[float, ...]:
        # The mirror image with positive joints comes first; rounding chooses nothing.
        joints = posture[0][vehicle.arm]
        return (round(float(np.linalg.norm(joints)), 6), *np.round(-joints, 6).tolist())

    return min(best, key=distance_from_zero)


def arm_length(vehicle: Vehicle, q: Array) -> float:
    """The largest singular value of the tip's Jacobian, m per rad: about the arm's length."""
    jacobian = vehicle.tip_jacobian(q)[:3, vehicle.arm_rates]
    return float(np.linalg.norm(jacobian, 2))


def is_singular(vehicle: Vehicle, q: Array) -> bool:
    """True if there is a direction in which the joints all but cannot move the tip."""
    return _least_singular_value(vehicle, q) < _NEARLY_SINGULAR * arm_length(vehicle, q)


def _least_singular_value(vehicle: Vehicle, q: Array) -> float:
    """The least singular value of the Jacobian of the tip with respect to the joints."""
    jacobian = vehicle.tip_jacobian(q)[:3, vehicle.arm_rates]
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


@dataclass(frozen=True)
class ArmRates:
    """Rates and accelerations (n) of the joints, and how the arm can move.

    - `at_limit` (n): the joints that have come to a limit
    - `redundant`: whether the others can move without the tip
    - `missing`: what the arm cannot give the tip, "" if nothing
    """

    rates: Array
    accelerations: Array
    at_limit: Flags
    redundant: bool
    missing: str


def arm_rates(
    vehicle: Vehicle, state: tuple[Array, Array, Array], target: Array, limits: JointBounds
) -> ArmRates:
    """Joint rates and accelerations of least norm that move the tip as desired, or nearest to it.

    `state` (nq, nv, nv) is of base and arm, whose own velocities and accelerations are not looked
    at. `target` (≥ 3, 3): position, velocity, acceleration of the tip, world axes.
    """
    arm = vehicle.arm_rates
    q, v, a = state[0], state[1].copy(), state[2].copy()
    v[arm] = a[arm] = 0.0
    jacobian = vehicle.tip_jacobian(q)[:3]
    matrix = jacobian[:, arm]
    braking = _braking(q[vehicle.arm], matrix, target[1] - jacobian @ v, limits)
    v[arm], free = braking.rates, braking.share > 0.0
    bias = vehicle.tip_bias_acceleration(q, v)[:3]
    a[arm] = braking.growth
    a[arm] += braking.share * (braking.inverse @ (target[2] - jacobian @ a - bias))
    missing = _missing(jacobian @ v - target[1], "speed, m/s") or _missing(
        jacobian @ a + bias - target[2], "acceleration, m/s²"
    )
    rank = np.linalg.matrix_rank(matrix * free, _RANK * np.linalg.norm(matrix))
    redundant = not missing and bool(rank < np.sum(free))
    if redundant:
        # The derivative of J⁺ẋ in the null space of J: (1 − J⁺J) J̇ᵀ J⁺ᵀ v.
        ahead, behind = (
            vehicle.tip_jacobian(vehicle.integrate(q, sign * _DIFFERENCE * v))[:3, arm]
            for sign in (1.0, -1.0)
        )
        jacobian_rate = braking.share * (ahead - behind) / (2.0 * _DIFFERENCE)
        jacobian_rate += matrix * braking.share_rate
        growth = jacobian_rate.T @ braking.multipliers
        a[arm] += braking.share * (growth - braking.inverse @ (matrix @ (braking.share * growth)))
    return ArmRates(v[arm], a[arm], ~free, redundant, missing)


@dataclass(frozen=True)
class _Braking:
    """Rates (n) c + s² Jᵀλ of joints, of which some brake.

    `share` (n) is s, 1 of those that do not brake and 0 of those that have come to a limit, and
    `share_rate` its derivative. `inverse` (n, 3) is the pseudoinverse of J s, `multipliers` (3) are
    λ. `growth` (n) is what the accelerations have besides s times the derivative of s Jᵀλ.
    """

    rates: Array
    share: Array
    share_rate: Array
    inverse: Array
    multipliers: Array
    growth: Array


def _braking(joints: Array, jacobian: Array, speed: Array, limits: JointBounds) -> _Braking:
    """Joint rates of least norm that add `speed` (3), m/s, to the tip's velocity, or nearly so.

    Joints brake before their limits. `jacobian` (3, n) is of the tip's position.
    """
    ways = [np.where(way > REACHED, way, 0.0) for way in (joints - limits[0], limits[1] - joints)]
    # −1 or 1 of joints that brake before the lower or upper limit, and the way to it.
    towards, way = np.zeros(len(joints)), np.ones(len(joints))
    for _ in range(_CHANGES * len(joints) + 1):
        brakes = towards != 0.0
        share = np.where(brakes, np.sqrt(way / (way + _HALF)), 1.0)
        centre = np.where(brakes, _BRAKING * _HALF * towards * share**2, 0.0)
        inverse = np.linalg.pinv(jacobian * share, rcond=_RANK)
        scaled = inverse @ (speed - jacobian @ centre)
        multipliers = inverse.T @ scaled
        wanted = jacobian.T @ multipliers
        beyond = np.maximum(-wanted - _BRAKING * ways[0], wanted - _BRAKING * ways[1])
        # Where they cannot move the tip as wanted, this is no reason to let go.
        rates = centre + share * scaled
        stuck = np.linalg.norm(jacobian @ rates - speed) > _TOLERANCE
        wrong = (beyond > 0.0) & ~brakes | (beyond <= 0.0) & brakes & ~stuck
        if not np.any(wrong):
            break
        worst = int(np.argmax(np.where(wrong, np.abs(beyond), -1.0)))
        towards[worst] = 0.0 if brakes[worst] else np.sign(wanted[worst])
        way[worst] = ways[int(towards[worst] > 0.0)][worst]
    # Derivatives of s² = d / (d + r) and of c = κ r s² with respect to time.
    square_rate = np.where(brakes, -towards * rates * _HALF / (way + _HALF) ** 2, 0.0)
    share_rate = np.divide(square_rate, 2.0 * share, out=np.zeros(len(joints)), where=share > 0.0)
    growth = _BRAKING * _HALF * towards * square_rate + share_rate * scaled
    return _Braking(rates, share, share_rate, np.asarray(inverse, np.float64), multipliers, growth)


def _missing(shortfall: Array, unit: str) -> str:
    size = float(np.linalg.norm(shortfall))
    return f"{size:.3g} of the {unit}, is missing" if size > _TOLERANCE else ""


class SingularArmError(UsageError):
    """An arm whose joints cannot give the tip the speed or acceleration of its path."""


class UnreachableError(UsageError):
    """Points of a path that the tip cannot reach.

    `times` (s) and `distances` (m) are of all such points that were tried.
    """

    def __init__(self, message: str, times: Array, distances: Array) -> None:
        self.times = times
        self.distances = distances
        super().__init__(message)


def arm_motion(
    vehicle: Vehicle,
    base: Motion,
    tip: Path,
    limits: JointBounds,
    guess: Array | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Motion:
    """Motion of base and arm at the knots of `base`, with the tip on its path.

    `guess` (n) are joints to begin with; None tries many postures. Raises `UnreachableError` for
    knots that the tip does not reach (after the first only some are tried, over the whole path),
    and `SingularArmError` where the arm cannot move as the path wants.
    """
    arm = _Continuation(vehicle, base, tip(base.time), limits)
    arm.start(guess)
    count = len(base.time)
    solved = arm.solved_at_once()
    progress(solved, count)
    stride = max(1, count // _TRIED_OUT_OF_REACH)
    for k in range(solved, count):
        if not arm.out_of_reach or k % stride == 0 or k == count - 1:
            arm.advance(k)
            progress(k + 1, count)
    tried = arm.tried
    _check_reached(vehicle, base.time[tried], arm.q[tried], arm.distances[tried], limits)
    if arm.singular:
        raise SingularArmError(arm.singular)
    return Motion(base.time, arm.q, arm.v, arm.a)


class _Continuation:
    """Motion of base and arm, of which the arm's part is solved knot by knot.

    `targets` (s, ≥ 3, 3) are position, velocity and acceleration of the tip. `distances` (s) are
    those of the tip from its path, m; `singular` tells the first knot at which the arm cannot move
    as the path wants. `tried` are the numbers of the knots that were solved; `at_limit` (n) are the
    joints that the last of them left at a limit.
    """

    def __init__(self, vehicle: Vehicle, base: Motion, targets: Array, limits: JointBounds) -> None:
        self.vehicle, self.limits, self.targets, self.time = vehicle, limits, targets, base.time
        self.q, self.v, self.a = base.q.copy(), base.v.copy(), base.a.copy()
        # Those of the joints (s, n).
        self.rates, self.accelerations = (x[:, vehicle.arm_rates] for x in (self.v, self.a))
        self.distances = np.zeros(len(base.time))
        self.at_limit: Flags = np.zeros(vehicle.joints, dtype=bool)
        self.singular = ""
        self.tried = [0]

    @property
    def out_of_reach(self) -> bool:
        """True if there is a knot that the tip does not reach."""
        return bool(np.any(self.distances > REACHED))

    def start(self, guess: Array | None) -> None:
        """Solve the first knot."""
        vehicle, limits, target = self.vehicle, self.limits, self.targets[0, 0]
        q, distance = first_posture(vehicle, self.q[0], target, limits, guess)
        if guess is None and distance <= REACHED and is_singular(vehicle, q):
            q = self._posture_for_path(q)
        self.q[0], self.distances[0] = q, distance
        if distance <= REACHED:
            self.at_limit = self._set_rates(0).at_limit

    def advance(self, k: int) -> None:
        """Solve knot k from the last one that was tried."""
        arm, q, last = self.vehicle.arm, self.q, self.tried[-1]
        step, v, a = self.time[k] - self.time[last], self.rates, self.accelerations
        q[k, arm] = q[last, arm] + step * (v[last] + 0.5 * step * a[last])
        self.at_limit = self.at_limit | self._beyond(q[k, arm])
        self._reach(k, self.at_limit)
        self.tried.append(k)
        if self.distances[k] > REACHED:
            return
        rates_of_arm = self._set_rates(k)
        if rates_of_arm.redundant and self.distances[last] <= REACHED:
            rates_of_arm = self._correct(k, last)
        if not rates_of_arm.missing:
            self.at_limit = rates_of_arm.at_limit

    def solved_at_once(self) -> int:
        """Solve as many knots as can be all at once, and return the number of the next; 1 for none.

        So none may be singular, out of reach or so near to a limit that a joint brakes, and the arm
        must have no motion to choose.
        """
        vehicle, arm, some = self.vehicle, self.vehicle.arm, slice(None, None, _STRIDE)
        knots = Motion(self.time[some], self.q[some], self.v[some], self.a[some])
        count = _STRIDE * (len(knots.time) - 1) + 1
        if vehicle.joints > 3 or count < 3 * _STRIDE or self.out_of_reach or self.singular:
            return 1
        path = _Continuation(vehicle, knots, self.targets[some], self.limits)
        for k in range(1, len(knots.time)):
            path.advance(k)
            if path.out_of_reach or path.singular:
                return 1
        quintics = Reference(Motion(knots.time, path.q[:, arm], path.rates, path.accelerations))
        q, v, a = (x[:count].copy() for x in (self.q, self.v, self.a))
        guess, target = quintics(self.time[:count])[0], self.targets[:count]
        q[:, arm], v[:, vehicle.arm_rates], a[:, vehicle.arm_rates] = guess, 0.0, 0.0
        for last in (False, False, True):
            jacobian = vehicle.tip_jacobian(q)[:, :3]
            matrix = jacobian[..., vehicle.arm_rates]
            inverse = np.asarray(np.linalg.pinv(matrix, rcond=_RANK), np.float64)
            off = target[:, 0] - vehicle.tip_pose(q)[:, :3, 3]
            q[:, arm] += 0.0 if last else times(inverse, off)
        rates = times(inverse, target[:, 1] - times(jacobian, v))
        v[:, vehicle.arm_rates] = rates
        growth = target[:, 2] - times(jacobian, a) - vehicle.tip_bias_acceleration(q, v)[:, :3]
        a[:, vehicle.arm_rates] = times(inverse, growth)
        missing = times(jacobian, v) - target[:, 1], times(matrix @ inverse, growth) - growth
        ways = _BRAKING * np.stack([q[:, arm] - self.limits[0], self.limits[1] - q[:, arm]])
        singular = np.linalg.svd(matrix, compute_uv=False)
        if not (
            np.linalg.norm(off, axis=-1).max() <= REACHED
            and np.linalg.norm(missing, axis=-1).max() <= _TOLERANCE
            and np.abs(q[:, arm] - guess).max() <= _CLOSE
            and np.all(np.stack([-rates, rates]) < ways)
            and np.all(singular[:, -1] > _NEARLY_SINGULAR * singular[:, 0])
        ):
            return 1
        self.q[:count], self.v[:count], self.a[:count] = q, v, a
        self.tried = [*range(count)]
        return count

    def _beyond(self, joints: Array) -> Flags:
        return (joints < self.limits[0]) | (joints > self.limits[1])

    def _reach(self, k: int, at_limit: Flags) -> None:
        """Bring the tip to its path at knot k, if it can be done without joints `at_limit` (n).

        Joints that come to a limit would else be moved off it by each step towards the target, only
        to be driven into it again.
        """
        vehicle, (low, high), target = self.vehicle, self.limits, self.targets[k, 0]
        posture, distance = self.q[k], np.inf
        if np.any(at_limit):
            joints = np.clip(posture[vehicle.arm], low, high)
            narrow = np.where(at_limit, joints, low), np.where(at_limit, joints, high)
            posture, distance = reach(vehicle, posture, target, narrow)
        if distance > REACHED:
            posture, distance = reach(vehicle, self.q[k], target, self.limits)
        self.q[k], self.distances[k] = posture, distance

    def _set_rates(self, k: int) -> ArmRates:
        """Find rates and accelerations of the arm at knot k."""
        vehicle = self.vehicle
        rates = arm_rates(vehicle, (self.q[k], self.v[k], self.a[k]), self.targets[k], self.limits)
        self.rates[k], self.accelerations[k] = rates.rates, rates.accelerations
        if rates.missing:
            self.singular = self.singular or (
                f"the arm is singular or at its limits at t = {self.time[k]:.6g} s: its joints "
                f"({', '.join(vehicle.joint_names)}) cannot move the tip along its path; "
                f"{rates.missing}"
            )
        return rates

    def _correct(self, k: int, last: int) -> ArmRates:
        """Make the joints of a redundant arm at knot k the integral of their rates since `last`.

        The path of the tip says nothing of null-space motion. That follows from the rates at both
        ends of the step, by the corrector of fourth order with two derivatives (Obreshkov's).
        """
        arm, q, v, a = self.vehicle.arm, self.q, self.rates, self.accelerations
        step, at_limit = self.time[k] - self.time[last], self.at_limit
        for _ in range(3):
            integral = (
                q[last, arm] + step / 2.0 * (v[last] + v[k]) + step**2 / 12.0 * (a[last] - a[k])
            )
            q[k, arm] = np.where(at_limit, q[k, arm], integral)
            at_limit = at_limit | self._beyond(integral)
            self._reach(k, at_limit)
            rates = self._set_rates(k)
            if rates.missing:
                break
        return rates

    def _posture_for_path(self, singular: Array) -> Array:
        """Coordinates (nq) at the first knot that suit the way the path goes on.

        A tip on the axis of a joint leaves that joint's angle open, but the path does not. So the
        search begins where the tip has gone some way from where the base alone would carry it, and
        the arm is led back from there. If it does not get back, the `singular` coordinates (nq) are
        kept.
        """
        vehicle, limits, places = self.vehicle, self.limits, self.targets[:, 0]
        carried = self.q.copy()
        carried[:, vehicle.arm] = singular[vehicle.arm]
        offset = places - vehicle.tip_pose(carried)[:, :3, 3]
        away = np.linalg.norm(offset, axis=-1) > _FAR * arm_length(vehicle, singular)
        if not np.any(away):
            return singular
        ahead = int(np.argmax(away))
        posture, distance = first_posture(vehicle, self.q[ahead], places[ahead], limits, None)
        for k in reversed(range(ahead)):
            joints = posture[vehicle.arm]
            posture = self.q[k].copy()
            posture[vehicle.arm] = joints
            posture, distance = reach(vehicle, posture, places[k], limits)
        return posture if distance <= REACHED else singular


def _check_reached(
    vehicle: Vehicle, time: Array, q: Array, distances: Array, limits: JointBounds
) -> None:
    """Raise `UnreachableError` if the tip is off its path, `SingularArmError` if only just.

    A path so near could be reached by the arm from another side. `distances` (s) are in m.
    """
    far = distances > REACHED
    if not np.any(far):
        return
    worst = int(np.argmax(distances))
    times = time[far]
    where = (
        f"at {len(times)} of {len(time)} instants tried, from t = {times[0]:.6g} s to "
        f"{times[-1]:.6g} s; at t = {time[worst]:.6g} s it stays {distances[worst]:.3g} m away"
    )
    # So near is not out of reach: the joints do not find the way there.
    if distances[worst] < _NEAR * arm_length(vehicle, q[worst]) and is_singular(vehicle, q[worst]):
        raise SingularArmError(
            f"the arm is singular: its joints ({', '.join(vehicle.joint_names)}) cannot bring "
            f"the tip onto its path {where}; keep the path away from joint axes and from the "
            "edge of the reach, or give a guess of the joints"
        )
    joints, (low, high) = q[worst, vehicle.arm], limits
    ends = np.nonzero((joints <= low + REACHED) | (joints >= high - REACHED))[0]
    if len(ends):
        names = " and ".join(vehicle.joint_names[place] for place in ends)
        where += f", with {names} at {'its limit' if len(ends) == 1 else 'their limits'}"
    raise UnreachableError(
        f"the tip cannot reach its path {where}; move the path within the arm's reach, or "
        f"{OTHER_SCENARIO}",
        times,
        distances[far],
    )


_TOO_FAST = (
    "the arm, or the path of its tip, moves too fast",
    "slow it down, or keep the path away from joint axes and from the edge of the reach",
)


def check_tip(vehicle: RobotData) -> None:
    """Raise `UsageError` for a robot without a tip, or without joints that move it."""
    if not vehicle.has_tip:
        raise UsageError(
            f"{vehicle.name}: has no tip: it needs one arm without branches, or a [[frame]] "
            f"named tip; {OTHER_SCENARIO}"
        )
    if vehicle.joints == 0:
        raise UsageError(
            f"{vehicle.name}: has no arm, so its tip cannot follow a path; {OTHER_SCENARIO}"
        )


def desired_with_tip(
    vehicle: Vehicle,
    time: Array,
    base_at: Callable[[Array], Motion],
    tip: Path,
    limits: JointBounds,
    guess: Array | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Motion:
    """Motion of base and arm, with the tip on a path.

    Where the tip leaves it between the evenly spaced knots, 2, 4 … times as many are taken.
    `base_at` gives the base's motion for knots, as `desired_base` does; `guess` (n) are joints to
    begin with, None tries many postures. Raises `UnreachableError` for points out of reach,
    `SingularArmError` where the arm cannot move as the path wants, `UsageError` without an arm, and
    where not even the most knots keep the tip on its path.
    """
    check_tip(vehicle)
    base = base_at(time)
    while True:
        bounded_path(base.time, tip, "path of the tip")
        motion = arm_motion(vehicle, base, tip, limits, guess, progress)
        deviation = _deviation(vehicle, motion, tip)
        if deviation is None:
            return motion
        # How many knots it takes is found on the worst piece alone, and then holds for all.
        piece = deviation.piece
        span, start = base.time[piece : piece + 2], motion.q[piece, vehicle.arm]
        already = refinement = (len(base.time) - 1) // (len(time) - 1)
        while deviation is not None:
            refinement = refine(refinement, time, deviation, *_TOO_FAST)
            near = base_at(refined(span, refinement // already))
            deviation = _deviation(vehicle, arm_motion(vehicle, near, tip, limits, start), tip)
        base = base_at(refined(time, refinement))


def _deviation(vehicle: Vehicle, motion: Motion, tip: Path) -> Deviation | None:
    """The largest distance of the tip from its path between knots, m; None within the tolerance."""
    reference = vehicle.kinematics.reference(motion)
    worst, worst_place = 1.0, None
    for begin in range(0, len(motion.time) - 1, BATCH):
        times = check_times(motion.time[begin : begin + BATCH + 1])
        places = bounded_path(times, tip, "path of the tip")[:, 0]
        reached = vehicle.tip_pose(reference(times)[0])[:, :3, 3]
        off = np.linalg.norm(reached - places, axis=-1)
        excess = off / tolerance(np.abs(places).max())
        instant = int(np.argmax(excess))
        if not excess[instant] <= worst:
            worst = excess[instant]
            worst_place = Deviation(begin + instant // CHECKS, times[instant], off[instant], "m")
    return worst_place
