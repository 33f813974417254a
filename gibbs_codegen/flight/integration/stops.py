"""Impacts of a flight: of frames with stops, and of constraints that take hold.

A stop is a constraint that acts from one side: forces and impulses only push. What comes to stops
at once, or rests on some, feels all of them together, and which push is found by complementarity:
those do whose forces or impulses are not negative, and all others part. After an impact velocities
u of the rows are -e u (Newton), or more where something else throws them apart (Moreau, 1988):
with one e for all no impact adds energy. What comes near again by that is hit once more.

Bounces would follow each other faster and faster. So a frame that comes slower than `REST` does
not rebound, and rests as long as it is pressed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.state_history import Impact
from gibbs_codegen.flight.plant.environment import BOTH_SIDES, Environment, Rests
from gibbs_codegen.flight.plant.vehicle import Array, Flags
from gibbs_codegen.machine.closed_loop import STILL

_log = logging.getLogger("gibbs_codegen")
# Speed, m/s, below which a frame that comes to a stop rests there.
REST = 1e-3
# Distance, m, from a stop at which a frame is there; what is less than 0; speed, m/s, above
# which an impact is reported.
_CLOSED, _LESS, _REPORTED = 1e-8, -0.5 * STILL, 1e-6
# Impacts at one instant, as of a frame that is thrown from one stop to another, and for each stop
# how often it is tried whether it pushes.
_MOST_IMPACTS, _MOST_TRIALS = 100, 8


def after_impacts(
    loop: ClosedLoop, around: Environment, time: float, state: Array
) -> tuple[ClosedLoop, Array, list[Impact]]:
    """The state (size) after the impacts at a time, s, and the loop with what then rests."""
    stops, impacts = _Stops(loop, around, time, state), list[Impact]()
    for k in range(_MOST_IMPACTS):
        hits = not k and around.takes_hold(time) and stops.bound.any()
        approach = float(np.max(-stops.rates(state), where=stops.there, initial=0.0))
        if not hits and approach <= -_LESS:
            break
        state, impact = stops.struck(state)
        if hits or approach > _REPORTED:
            impacts.append(impact)
            _log.debug("impact at t = %.6g s: %.4g J are lost, %.4g J left", *impact[:3])
    else:  # Thrown to and fro between stops: there it stays.
        state, impact = stops.struck(state, 0.0)
        impacts.append(impact)
    return loop.resting(stops.rests(state)), state, impacts


class _Stops:
    """Constraints of a closed loop at a time, s, and in a state (size).

    Those that hold from both sides are `bound` (c), and a frame is `there` (c) at others.
    """

    def __init__(self, loop: ClosedLoop, around: Environment, time: float, state: Array) -> None:
        self._loop, self._around, self._time = loop, around, time
        self._restitution, self._sides = around.restitution(time), around.sides
        self.bound, self.there = self._restitution == BOTH_SIDES, self._restitution >= 0.0
        vehicle, q = loop.vehicle, loop.parts(state).q
        # Stops have one row each.
        self._rows = [place.start for place in vehicle.module.CONSTRAINT_PLACES.values()]
        self._jacobian = vehicle.function("constraint_jacobian")(q)[self._rows]
        errors = vehicle.function("constraint_errors")(q)[self._rows]
        self._resting = self.there & around.holding(time)
        self.there &= self._resting | (self._sides * errors <= _CLOSED)

    def rates(self, state: Array) -> Array:
        """Velocities (c), m/s, at which frames leave stops."""
        return self._sides * (self._jacobian @ self._loop.parts(state).v)

    def struck(self, state: Array, most: float = 1.0) -> tuple[Array, Impact]:
        """The state (size) after an impact of at most some restitution, with what it did."""
        rates = self.rates(state)
        shares = np.where(self.there & np.any(self.there & (rates < -REST)), self._restitution, 0.0)
        shares = np.minimum(shares, most)

        def strike(pushing: Flags) -> tuple[Array, Array]:
            after, *_, impulses = self._loop.struck(state, self.bound | pushing, shares)
            return self._sides * impulses[self._rows], self.rates(after) + shares * rates

        hit = self.bound | _pushing(strike, self.there)
        after, lost, left, impulses = self._loop.struck(state, hit, shares)
        return after, (self._time, float(lost), float(left), impulses)

    def rests(self, state: Array) -> Rests:
        """The rests of frames on stops so far, after the impacts."""
        parts, before = self._loop.parts(state), self._around.rests
        bias = self._loop.vehicle.function("constraint_bias")(parts.q, parts.v)[self._rows]

        def press(pushing: Flags) -> tuple[Array, Array]:
            loop = self._loop.resting((*before, (self._time, (*pushing,))))
            loads = loop.loads(self._time)
            loads = loads._replace(inputs=loop.hold.inputs if loop.hold else None)
            _, aimed, acting = loop.commands(self._time, parts, loads)
            motion = loop.motion(self._time, parts, aimed, acting, loads)
            growth = self._jacobian @ motion["a"] + bias
            return self._sides * motion["holding"][self._rows], self._sides * growth

        pushing = _pushing(press, self.there & (np.abs(self.rates(state)) <= STILL))
        changes = np.any(pushing != self._resting)
        return (*before, (self._time, (*pushing,))) if changes else before


def _pushing(respond: Callable[[Flags], tuple[Array, Array]], there: Flags) -> Flags:
    """Which of some stops push, by `respond`, which gives forces and parting (c) if some do.

    As of least squares with no negative unknowns (Lawson and Hanson, 1974): one after the other
    begins to push where frames would come nearer, and stops where it would have to pull.
    """
    pushing, forces = np.zeros_like(there), np.zeros(len(there))
    for _ in range(_MOST_TRIALS * len(there)):
        wanted, parting = respond(pushing)
        pulled = pushing & (wanted < _LESS)
        if not pulled.any():
            missing = np.where(there & ~pushing, parting, 0.0)
            if missing.min() >= _LESS:
                break
            forces = wanted
            pushing[missing.argmin()] = True
            continue
        shares = np.divide(forces, forces - wanted, out=np.ones_like(forces), where=pulled)
        forces = forces + shares.min() * (wanted - forces)
        pushing &= ~(pulled & (shares == shares.min()))
    return pushing
