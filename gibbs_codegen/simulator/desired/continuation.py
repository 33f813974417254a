"""Inverse kinematics of the arm along a path of its tip: each knot is solved from the one before.

A predictor of second order takes the joints from knot to knot, damped least squares put the tip on
its path, and the null-space motion of redundant arms is integrated from its rates.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.paths import Path
from gibbs_codegen.simulator.desired.arm_rates import ArmRates, arm_rates
from gibbs_codegen.simulator.desired.inverse_kinematics import (
    REACHED,
    Limits,
    arm_length,
    first_posture,
    is_singular,
    reach,
)
from gibbs_codegen.simulator.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.simulator.reference import Motion

# Shares of the arm's length: what a singular arm may stay away from its path, and the way after
# which the path shows where it goes.
_NEAR = 1e-6
_FAR = 1e-3
# Knots that are tried, of all that there are, once the path is known to leave the arm's reach.
_TRIED_OUT_OF_REACH = 200
# What to do where a scenario asks too much of the arm.
OTHER_SCENARIO = "choose a scenario without a path of the tip, such as --scenario hover"


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
    limits: Limits,
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
    progress(1, count)
    stride = max(1, count // _TRIED_OUT_OF_REACH)
    for k in range(1, count):
        if not arm.out_of_reach or k % stride == 0 or k == count - 1:
            arm.advance(k)
            progress(k + 1, count)
    _check_reached(vehicle, base.time[arm.tried], arm.q[arm.tried], arm.distances[arm.tried])
    if arm.singular:
        raise SingularArmError(arm.singular)
    return Motion(base.time, arm.q, arm.v, arm.a)


class _Continuation:
    """Motion of base and arm, of which the arm's part is solved knot by knot.

    `targets` (s, ≥ 3, 3) are position, velocity and acceleration of the tip. `distances` (s) are
    those of the tip from its path, m; `singular` tells the first knot at which the arm cannot move
    as the path wants. `tried` are the numbers of the knots that were solved, `held` (n) the joints
    that the last of them left at a limit.
    """

    def __init__(self, vehicle: Vehicle, base: Motion, targets: Array, limits: Limits) -> None:
        self.vehicle, self.limits, self.targets, self.time = vehicle, limits, targets, base.time
        self.q, self.v, self.a = base.q.copy(), base.v.copy(), base.a.copy()
        # Of the joints (s, n).
        self.rates, self.accelerations = (each[:, vehicle.arm_rates] for each in (self.v, self.a))
        self.distances = np.zeros(len(base.time))
        self.held: Flags = np.zeros(vehicle.joints, dtype=bool)
        self.singular = ""
        self.tried = [0]

    @property
    def out_of_reach(self) -> bool:
        """Whether there is a knot that the tip does not reach."""
        return bool(np.any(self.distances > REACHED))

    def start(self, guess: Array | None) -> None:
        """Solve the first knot."""
        vehicle, limits, target = self.vehicle, self.limits, self.targets[0, 0]
        q, distance = first_posture(vehicle, self.q[0], target, limits, guess)
        if guess is None and distance <= REACHED and is_singular(vehicle, q):
            q = self._posture_for_path(q)
        self.q[0], self.distances[0] = q, distance
        if distance <= REACHED:
            self.held = self._set_rates(0).at_limit

    def advance(self, k: int) -> None:
        """Solve knot k from the last one that was tried."""
        arm, q, last = self.vehicle.arm, self.q, self.tried[-1]
        step, v, a = self.time[k] - self.time[last], self.rates, self.accelerations
        q[k, arm] = q[last, arm] + step * (v[last] + 0.5 * step * a[last])
        self.held = self.held | self._beyond(q[k, arm])
        self._reach(k, self.held)
        self.tried.append(k)
        if self.distances[k] > REACHED:
            return
        found = self._set_rates(k)
        if found.redundant and self.distances[last] <= REACHED:
            found = self._correct(k, last)
        if not found.missing:
            self.held = found.at_limit

    def _beyond(self, joints: Array) -> Flags:
        beyond: Flags = (joints < self.limits[0]) | (joints > self.limits[1])
        return beyond

    def _reach(self, k: int, held: Flags) -> None:
        self.q[k], self.distances[k] = _reach_holding(
            self.vehicle, self.q[k], self.targets[k, 0], self.limits, held
        )

    def _set_rates(self, k: int) -> ArmRates:
        """Find rates and accelerations of the arm at knot k."""
        vehicle = self.vehicle
        found = arm_rates(vehicle, (self.q[k], self.v[k], self.a[k]), self.targets[k], self.limits)
        self.rates[k], self.accelerations[k] = found.rates, found.accelerations
        if found.missing:
            self.singular = self.singular or (
                f"the arm is singular or at its limits at t = {self.time[k]:.6g} s: its joints "
                f"({', '.join(vehicle.joint_names)}) cannot move the tip as its path wants; "
                f"{found.missing}"
            )
        return found

    def _correct(self, k: int, last: int) -> ArmRates:
        """Make the joints of a redundant arm at knot k the integral of their rates since `last`.

        The path of the tip says nothing of null-space motion. That follows from the rates at both
        ends of the step, by the corrector of fourth order with two derivatives (Obreshkov's).
        """
        arm, q, v, a = self.vehicle.arm, self.q, self.rates, self.accelerations
        step, held = self.time[k] - self.time[last], self.held
        for _ in range(3):
            integral = (
                q[last, arm] + step / 2.0 * (v[last] + v[k]) + step**2 / 12.0 * (a[last] - a[k])
            )
            q[k, arm] = np.where(held, q[k, arm], integral)
            held = held | self._beyond(integral)
            self._reach(k, held)
            found = self._set_rates(k)
            if found.missing:
                break
        return found

    def _posture_for_path(self, singular: Array) -> Array:
        """Coordinates (nq) at the first knot that suit the way the path goes on.

        A tip on the axis of a joint leaves that joint's angle open, but the path does not. So the
        search begins where the tip has gone some way, and the arm is led back from there. If it
        does not get back, the `singular` coordinates (nq) are kept.
        """
        vehicle, limits, places = self.vehicle, self.limits, self.targets[:, 0]
        offset = places - self.q[:, vehicle.layout.q.position]
        away = np.linalg.norm(offset - offset[0], axis=-1) > _FAR * arm_length(vehicle, singular)
        if not np.any(away):
            return singular
        ahead = int(np.argmax(away))
        found, distance = first_posture(vehicle, self.q[ahead], places[ahead], limits, None)
        for k in reversed(range(ahead)):
            joints = found[vehicle.arm]
            found = self.q[k].copy()
            found[vehicle.arm] = joints
            found, distance = reach(vehicle, found, places[k], limits)
        return found if distance <= REACHED else singular


def _reach_holding(
    vehicle: Vehicle, q: Array, target: Array, limits: Limits, held: Flags
) -> tuple[Array, float]:
    """`reach`, with joints `held` (n) left where they are if it can be done without them.

    Joints that come to a limit would else be moved off it by each step towards the target, only to
    be driven into it again.
    """
    if np.any(held):
        joints = np.clip(q[vehicle.arm], *limits)
        narrow = np.where(held, joints, limits[0]), np.where(held, joints, limits[1])
        found, distance = reach(vehicle, q, target, narrow)
        if distance <= REACHED:
            return found, distance
    return reach(vehicle, q, target, limits)


def _check_reached(vehicle: Vehicle, time: Array, q: Array, distances: Array) -> None:
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
            f"the arm is singular: its joints ({', '.join(vehicle.joint_names)}) do not bring the "
            f"tip onto its path {where}; lead the path past the axes of joints and the edge of "
            "the arm's reach, or give a guess of the joints"
        )
    raise UnreachableError(
        f"the tip cannot reach its path {where}; lead the path within the arm's reach, or "
        f"{OTHER_SCENARIO}",
        times,
        distances[far],
    )
