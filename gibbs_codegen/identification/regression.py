"""Numbers by regression of accelerations, in which no motion has to be computed.

What was measured and what the model gives for it are low-passed alike, which takes noise away and
no motion. What was commanded is known, and accelerations err: as factors, as they are in inverse
dynamics, their noise would draw inertias down. So a fit of the motion begins well however far off
the robot file is; and where no log tells a pose and no motion explains the readings, as of real
flights on which unknown torques act, this is the fit.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.identification.model import OUTLIER, Model
from gibbs_codegen.identification.recorded import DELAY, Readings, delayed, felt_names
from gibbs_codegen.identification.unknowns import Unknowns

_log = logging.getLogger("gibbs_codegen")
# What is faster is left out, Hz; so is what is slower of turns of the base, since no log tells how
# fast it goes, and the air turns it by that.
_FAST, _SLOW = 10.0, 2.0
# Samples of a period of what is left, and s at both ends that filters spoil.
_SAMPLES, _EDGE = 5, 0.4
# Every how many commands tell how actuators follow.
_SPARSE = 20
# Changes of unknowns, and of the delay over its deviation: for differences, and at most; the share
# of deviations that is none; iterations at most.
_DIFFERENCE, _MOST, _SETTLED, _ITERATIONS = 1e-4, 0.7, 0.03, 25


class Regression:
    """Accelerations of logs without a pose by y: unknowns, and a delay of readings, s.

    `measured` (s, m) are low-passed accelerations by their `names` (m). Logs that are too short
    are left out. Raises `UsageError` if all are, or slow.
    """

    def __init__(self, model: Model, unknowns: Unknowns, logs: Sequence[Readings]) -> None:
        self.model, self.unknowns = model, unknowns
        h, layout = model.h, model.layout
        edge = round(_EDGE / h)
        self.logs = [log for log in logs if len(log.q) - 1 > 2 * edge]
        fast = min(_FAST, 0.4 / h)
        if fast < 2 * _SLOW:
            raise UsageError(
                f"{logs[0].source}: has no pose and {1 / h:.3g} samples a second; such logs need "
                f"{_SLOW / 0.2:g}: record more often"
            )
        if not self.logs:
            raise UsageError(
                f"{logs[0].source}: has no pose, and it or its held-out part is too short; "
                f"filters use up {2 * _EDGE:g} s: record for longer"
            )
        for log in logs:
            if log not in self.logs:
                words = "%s: a part of %.3g s is left out, because filters use up %g s"
                _log.warning(words, log.source, h * len(log.q), 2 * _EDGE)
        self._low = butter(3, fast, fs=1 / h, output="sos")
        self._turns = butter(3, (_SLOW, fast), "bandpass", fs=1 / h, output="sos")
        self._rows = slice(edge, -edge or None, max(1, round(1 / h / _SAMPLES / fast)))
        self._second = max(1, round(1 / h / self._rows.step))
        self._places = [*range(layout.v.attitude.start, model.nv)]
        self._felt = [k for k in range(logs[0].felt.shape[1]) if k % 6 < 3]
        self.names = [f"acceleration along {model.module.VELOCITIES[k]}" for k in self._places]
        felt = felt_names(logs[0].frames)
        self.names += [felt[k] for k in self._felt]
        self.prior = np.append(unknowns.prior, DELAY)
        self._sizes = np.array([*[1.0] * len(unknowns.names), DELAY])
        self._states = [
            {
                "q": log.guess,
                "v": sosfiltfilt(self._low, log.rates, axis=0),
                "pull": np.zeros((len(log.q), model.pulls)),
            }
            for log in self.logs
        ]
        # Commands and states of actuators, of each log, by what decides these.
        self._known = [dict[tuple[float, bytes], tuple[Array, Array]]() for _ in self.logs]
        passed = (self._passed(np.diff(log.rates, axis=0), log.felt_filled) for log in self.logs)
        self.measured = np.concatenate([*passed])

    def _passed(self, changes: Array, felt: Array) -> Array:
        """Rows of what steps change of velocities, and of what IMUs feel, without what is fast."""
        series = np.concatenate(
            [changes[:, self._places] / self.model.h, felt[:-1, self._felt]], axis=1
        )
        passed: Array = sosfiltfilt(self._low, series, axis=0)
        passed[:, :3] = sosfiltfilt(self._turns, series[:, :3], axis=0)
        return passed[self._rows]

    def misses(self, y: Array) -> Array:
        """Errors (s, m) of accelerations."""
        rows = []
        machine = self.model.machine(self.unknowns.parameters(y[:-1]) | {"gravity": 0.0})
        for log, state, known in zip(self.logs, self._states, self._known, strict=True):
            # Most numbers change nothing of actuators.
            key = float(y[-1]), self.model.pace(log.commands[::_SPARSE], machine.constants)
            if key not in known:
                commands = delayed(log.commands, key[0] / self.model.h)
                known[key] = commands, self.model.levels(commands, machine.constants)
            commands, x = known[key]
            after, felt = self.model({**state, "x": x}, machine, command=commands, drag=0.0)
            rows.append(self._passed((after["v"] - state["v"])[:-1], felt))
        return np.concatenate(rows) - self.measured

    def run(self) -> tuple[Array, bool]:
        """The most likely y, and whether steps have come to an end."""
        y, settled = np.zeros(len(self.prior)), False
        for _ in range(_ITERATIONS):
            slopes, misses, normal = self._weighed(y)
            covariance = np.linalg.inv(normal)
            change = -covariance @ (slopes.T @ misses + y / self.prior**2)
            y = y + np.clip(change, -_MOST * self._sizes, _MOST * self._sizes)
            if settled := bool(np.all(np.abs(change) < _SETTLED * np.sqrt(np.diag(covariance)))):
                break
        return y, settled

    def _weighed(self, y: Array) -> tuple[Array, Array, Array]:
        """Slopes (m s, n) and errors (m s), robustly, over what is left, and normal equations."""
        for known in self._known:
            known.clear()
        misses = self.misses(y)
        steps = _DIFFERENCE * self._sizes
        moved = [self.misses(y + step) for step in np.diag(steps)]
        slopes = np.stack([(m - misses) / s for m, s in zip(moved, steps, strict=True)], axis=-1)
        size = np.maximum(np.sqrt(np.mean(misses**2, axis=0)), 1e-9)
        misses = misses / size
        robust = np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(misses), 1e-9)))
        flat = (slopes * (robust / size)[..., np.newaxis]).reshape(-1, len(y))
        flat_misses = (misses * robust).ravel()
        normal, sums = flat.T @ flat, self._sums(flat * flat_misses[:, np.newaxis])
        # Errors go together that follow each other: by their sums, as many tell as much as one
        # does, a second of them at most.
        alike = np.linalg.eigvals(np.linalg.lstsq(normal, sums.T @ sums)[0]).real.max()
        share = np.sqrt(np.clip(alike, 1.0, self._second))
        flat, flat_misses = flat / share, flat_misses / share
        return flat, flat_misses, flat.T @ flat + np.diag(self.prior**-2)

    def _sums(self, scores: Array) -> Array:
        """Sums (k, n) over a second each of scores (m s, n)."""
        return np.add.reduceat(
            scores, np.arange(0, len(scores), self._second * len(self.names)), axis=0
        )

    def covariance(self, y: Array) -> Array:
        """Covariance of y, if sums of errors over a second are independent, and no more is.

        Where numbers are far from the file, so may be those for which it speaks more than the log.
        """
        slopes, misses, normal = self._weighed(y)
        sums, inverse = self._sums(slopes * misses[:, np.newaxis]), np.linalg.inv(normal)
        far = np.append(np.full(len(y) - 1, max(1.0, np.mean((y / self.prior)[:-1] ** 2))), 1.0)
        return np.asarray(inverse @ (sums.T @ sums + np.diag(far / self.prior**2)) @ inverse)
