"""Linear modes of a closed loop: how fast tracking errors and lagging thrusts decay.

Under computed torque the error e of a coordinate obeys ë + d ė + k e = 0. With motors of time
constant T, errors of the base obey T e⃛ + ë + d ė + k e = 0. Under the geometric law that holds for
joints, heading and height; sideways, what the position's error asks for is what the thrust axis
follows by the gains of the attitude. These eigenvalues tell the steps that an integrator can take.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gibbs_codegen.simulator.control.laws import CORRECTING, ControlLaw
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop

# Instants of the desired motion at which masses that walls feel are looked at.
_INSTANTS = 33


@dataclass(frozen=True, order=True)
class Mode:
    """A mode that decays at a `rate`, 1/s: its cause, how to slow it, and its eigenvalue, 1/s."""

    rate: float
    cause: str
    remedy: str
    eigenvalue: complex = field(compare=False)

    @property
    def longest_step(self) -> float:
        """Steps of rk4, s, in which the mode decays."""
        return 2.0 / self.rate


def stable_modes(loop: ClosedLoop) -> list[Mode]:
    """Modes that decay: of lagging thrusts, of errors that a law corrects at all times, of walls.

    Args:
        loop: The closed loop.

    Returns:
        The modes, fastest first.
    """
    found = []
    # A lag that is nothing, next to any step, is not nothing to divide by.
    lags = [max(lag, 1e-30) for lag in np.unique(loop.actuators.lag).tolist() if lag]
    for lag in lags:
        remedy = f"a longer time constant of the motors than {lag:g} s, or none"
        found.append(Mode(1.0 / lag, "the motors' lag", remedy, complex(-1.0 / lag)))
    # Held inputs do not follow the errors within a step.
    felt = [] if loop.compensates else lags
    polynomials = [] if loop.held is not None else error_polynomials(loop.controller, felt)
    found += [
        Mode(abs(root), "the gains of control", "lower gains", complex(root))
        for root in itertools.chain.from_iterable(map(np.roots, polynomials))
        if root.real < 0.0
    ]
    return sorted([*found, *_wall_modes(loop)], reverse=True)


def _wall_modes(loop: ClosedLoop) -> list[Mode]:
    """Modes of frames that lean on walls, with the least mass that each wall feels.

    That is the least along the desired motion. A frame that moves by x along the normal obeys
    ẍ + (c/m) ẋ + (s/m) x = 0 with the damping c and the stiffness s of the wall, next to which
    those of control are small where a wall decides about steps.
    """
    if loop.environment is None or not loop.environment.wall:
        return []
    walls, reference = loop.environment.walls, loop.controller.reference
    q = reference(np.linspace(reference.begin, reference.end, _INSTANTS))[0]
    masses = np.min(walls.effective_masses(loop.vehicle, q), axis=0)
    found = []
    for wall, mass in zip(walls.walls, masses.tolist(), strict=True):
        cause = f"the wall at {wall.frame}, which feels a mass of {mass:.3g} kg"
        found += [
            Mode(abs(root), cause, "a softer wall, or less of its damping", complex(root))
            for root in np.roots([1.0, wall.damping / mass, wall.stiffness / mass])
        ]
    return found


def error_polynomials(controller: ControlLaw, lags: Sequence[float]) -> list[np.ndarray]:
    """Characteristic polynomials of the errors under a law.

    Args:
        controller: The law.
        lags: Time constants of motors, s.

    Returns:
        Coefficients of each, highest power first; none if the law does not correct errors.
    """
    if controller.law not in CORRECTING:
        return []
    gains, places = controller.gains, controller.vehicle.layout.v
    every = np.stack([gains.damping, gains.stiffness], axis=-1)
    attitude = every[places.attitude]
    if controller.law == "geometric":
        every = np.delete(every, places.attitude, axis=0)
    found = []
    for pair in np.unique(every, axis=0):
        # Joint torques do not lag, so errors of joints are as without.
        rest = [*pair, gains.integral * pair[1]] if gains.integral else pair
        found.append(np.array([1.0, *rest]))
        found += [np.array([lag, 1.0, *rest]) / lag for lag in lags]
    if controller.law == "geometric":
        pairs = np.concatenate([every[places.position], attitude], axis=-1)
        for *position, damping, stiffness in np.unique(pairs, axis=0):
            asked = np.polymul([damping, stiffness], position)
            for lag in (0.0, *lags):
                lean = np.trim_zeros(np.array([lag, 1.0, damping, stiffness]), "f")
                whole = np.polyadd(np.polymul(lean, np.array([1.0, 0.0, 0.0])), asked)
                found.append(whole / whole[0])
    return found


def integration_burdens(loop: ClosedLoop, time: float, state: np.ndarray, lag: bool = True) -> str:
    """What makes integration hard besides the vehicle itself.

    Args:
        loop: The closed loop.
        time: Time, s.
        state: State (size).
        lag: Whether to mention the lag of the motors.

    Returns:
        Clauses that begin with "; ", on saturated inputs and on lag; "" if there are none.
    """
    found = ""
    if inputs := loop.saturated(time, state):
        found += f"; saturated inputs: {', '.join(inputs)} (rk4 does not shorten its steps there)"
    if lag and loop.lags:
        shortest = np.min(loop.actuators.lag[loop.actuators.lag > 0.0])
        found += f"; the motors' time constant is {shortest:g} s"
    return found
