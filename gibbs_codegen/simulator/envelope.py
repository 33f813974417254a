"""The envelope of a flight: the errors beyond which control is lost, and why a flight ends there.

Coordinates may be `divergence` (rad or m) off. The bound on rates follows from that one: under
computed torque an error that begins at a rate ė swings out to g ė, where g is the peak of the
impulse response of ë + d ė + k e = 0. A rate beyond `divergence` / g is lost even if control worked
as it should from then on. Without the bound, a loop that feeds its own velocities back through
motors that lag escapes to infinity within a finite time, hardly off its path.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.scenario.attitude import LARGEST_THETA_0
from gibbs_codegen.simulator.closed_loop import ClosedLoop
from gibbs_codegen.simulator.control import Gains

Array = NDArray[np.float64]


class Envelope:
    """Where control counts as lost, for a flight of `duration` s.

    `bounds` (2 nq): how far coordinates (rad or m) and then rates (rad/s or m/s) may be from what
    is desired. They are infinite for all where nothing is controlled, and for rates in open loop,
    whose inputs do not grow with the error.
    """

    def __init__(self, loop: ClosedLoop, divergence: float, duration: float) -> None:
        self.loop = loop
        controller = loop.controller
        count = len(loop.vehicle.coordinates)
        self.bounds: Array = np.full(2 * count, np.inf)
        if controller.law != "off":
            self.bounds[:count] = divergence
        if controller.law == "computed_torque":
            self.bounds[count:] = divergence / np.minimum(_swing(controller.gains), duration)

    def holds(self, time: Array, states: Array) -> NDArray[np.bool_]:
        """Which states (s, size) at times (s) are finite and within the bounds."""
        within = np.all(self._errors(time, states) <= self.bounds, axis=-1)
        held: NDArray[np.bool_] = within & np.all(np.isfinite(states), axis=-1)
        return held

    def reason(self, time: float, state: Array) -> str:
        """Why a flight cannot go on from a state (size), or nothing."""
        lost = f"at t = {time:.6g} s control is lost: "
        if not np.all(np.isfinite(state)):
            return f"{lost}the state is no longer finite; {self._advice()}"
        excess = self._errors(time, state) / self.bounds
        worst = int(np.argmax(excess))
        if excess[worst] > 1.0:
            return f"{lost}{self._in_words(worst, excess[worst])}; {self._advice()}"
        # This also tells a step across, however far.
        vehicle = self.loop.vehicle
        theta_0 = state[vehicle.layout.middle_angle]
        if abs(theta_0) > LARGEST_THETA_0:
            return (
                f"at t = {time:.6g} s the attitude reaches the singularity of the sequence "
                f"{vehicle.attitude} (theta_0 = {np.degrees(theta_0):.4g}°)"
            )
        return ""

    def _errors(self, time: float | Array, states: Array) -> Array:
        """How far coordinates and rates (…, 2 nq) are from what is desired."""
        q, v, _, _ = self.loop.parts(states)
        wanted_q, wanted_v, _ = self.loop.controller.reference(time)
        errors: Array = np.abs(np.concatenate([q - wanted_q, v - wanted_v], axis=-1))
        return errors

    def _in_words(self, place: int, excess: float) -> str:
        vehicle = self.loop.vehicle
        is_rate, coordinate = divmod(place, len(vehicle.coordinates))
        name = vehicle.coordinates[coordinate]
        unit = vehicle.layout.units[coordinate]
        divergence = f"{self.bounds[coordinate]:.3g} {unit} (integration.divergence)"
        off = f"{excess * self.bounds[place]:.3g} {unit}"
        if is_rate:
            return (
                f"the rate of {name} is {off}/s off, which would carry it more than {divergence} "
                "away even under perfect control"
            )
        return f"{name} is {off} off, more than {divergence}"

    def _advice(self) -> str:
        loop = self.loop
        remedies = [
            *(["a shorter motors.time_constant"] if loop.lag else []),
            *(["wider motors.limits"] if loop.limits else []),
            *(["a weaker tip_force"] if loop.tip_force else []),
            "a closed loop (control.law)"
            if loop.controller.law == "open_loop"
            else "a lower control.frequency",
        ]
        return f"try {', '.join(remedies)} or a gentler motion"


def _swing(gains: Gains) -> Array:
    """How far (nq) an error swings out for each unit of the rate that it begins with, in s."""
    frequency = np.sqrt(gains.stiffness)
    ratio = gains.damping / (2.0 * frequency) + 0j
    root = np.sqrt(ratio**2 - 1.0)
    critical = root == 0.0
    # The time of the peak, times the frequency; its limit at critical damping is 1.
    peak = np.where(critical, 1.0, np.arccosh(ratio) / np.where(critical, 1.0, root))
    swing: Array = np.exp(-(ratio * peak).real) / frequency
    return swing
