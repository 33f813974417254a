"""Linear modes of a closed loop: how fast tracking errors and lagging thrusts decay.

Errors decay by the roots of `control.error_polynomials`, lagging thrusts by their time constants.
To them come frames that lean on walls, and drag. These eigenvalues tell the steps that an
integrator can take.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from gibbs_codegen.simulator.control.error_polynomials import error_polynomials
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.plant.vehicle import Array

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
    """Modes that decay, fastest first.

    They are of lagging thrusts, of errors that a law corrects at all times, of walls and drag.
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
    return sorted([*found, *_wall_modes(loop), *_drag_modes(loop)], reverse=True)


def _wall_modes(loop: ClosedLoop) -> list[Mode]:
    """Modes of frames that lean on walls, with the least mass that each wall feels.

    That is the least along the desired motion. A frame that moves by x along the normal obeys
    ẍ + (c/m) ẋ + (s/m) x = 0 with the damping c and the stiffness s of the wall, next to which
    those of control are small where a wall decides about steps.
    """
    if loop.environment is None or not loop.environment.wall:
        return []
    walls = loop.environment.walls
    masses = np.min(walls.effective_masses(loop.vehicle, _configurations(loop)), axis=0)
    found = []
    for wall, mass in zip(walls.walls, masses.tolist(), strict=True):
        cause = f"the wall at {wall.frame}, which feels a mass of {mass:.3g} kg"
        found += [
            Mode(abs(root), cause, "a softer wall, or less of its damping", complex(root))
            for root in np.roots([1.0, wall.damping / mass, wall.stiffness / mass])
        ]
    return found


def _drag_modes(loop: ClosedLoop) -> list[Mode]:
    """The fastest mode by which drag slows the machine, along the desired motion: M v̇ = −Jᵀ C J v.

    J is the Jacobian of the frames, C their coefficients.
    """
    drag = loop.environment.drag if loop.environment else None
    if drag is None:
        return []
    q = _configurations(loop)
    jacobians = loop.vehicle.function("frame_jacobians")(q)
    coefficients = drag.coefficients[..., np.newaxis]
    slowing = np.einsum("sfai,sfaj->sij", jacobians, coefficients * jacobians)
    values = np.linalg.eigvals(np.linalg.solve(loop.vehicle.mass_matrix(q), slowing))
    rate = float(np.max(values.real))
    remedy = "less drag (wind.drag, wind.rotational_drag)"
    return [Mode(rate, "the drag", remedy, complex(-rate))] if rate > 0.0 else []


def _configurations(loop: ClosedLoop) -> Array:
    """Coordinates (s, nq) at instants of the desired motion."""
    reference = loop.controller.reference
    return reference(np.linspace(reference.begin, reference.end, _INSTANTS))[0]


def integration_burdens(loop: ClosedLoop, time: float, state: np.ndarray, lag: bool = True) -> str:
    """What makes integration hard besides the vehicle itself: saturated inputs, and lag if asked.

    Clauses that begin with "; ", "" if there are none.
    """
    found = ""
    if inputs := loop.saturated(time, state):
        found += f"; saturated inputs: {', '.join(inputs)} (rk4 does not shorten its steps there)"
    if lag and loop.lags:
        shortest = np.min(loop.actuators.lag[loop.actuators.lag > 0.0])
        found += f"; the motors' time constant is {shortest:g} s"
    return found
