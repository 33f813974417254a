"""The most likely motion and numbers, by Gauss-Newton over all samples at once.

Unknown are the state at every sample, with the pull of the wind, and what all share: numbers of the
robot file, a drag, biases of IMUs. What is least is the sum of squares, each over its deviation, of
readings, of what steps from sample to sample leave, of changes of the wind, and of the prior. The
wind is a process from sample to sample, as turbulence is: were it a curve through nodes, what it
does between these would be in all accelerations of a node alike, and deviations too small.

States are eliminated one after the other, which leaves equations of what is shared. Numbers for
which states are less certain explain readings by more motions than the most likely one. So half the
logarithm of the determinant of the states' equations counts too, which makes the likelihood that
of numbers alone (Laplace's approximation): without it a scale of all forces came out too great by
1.5 deviations.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.identification.model import Model
from gibbs_codegen.identification.recorded import Readings
from gibbs_codegen.identification.unknowns import Unknowns

# Deviations of what a step leaves, by the root of its time, s: of q, v and actuators, SI units.
_OF_Q, _OF_V, _OF_X = 3e-5, 5e-4, 3e-4
# Of biases of IMUs, m/s² and rad/s, and of the drag, by the mass, 1/s.
_BIASES, _DRAG = (0.3, 0.05), 1.0
# Time, s, in which the wind's pull decays, its deviation at first, m/s², and the least.
_WIND_TIME, _WIND, _CALM = 1.0, 0.3, 0.01
# Readings that are off by more of their deviations weigh less (Huber).
_OUTLIER = 3.0
_STEP = 1e-6
# Samples at a time, which stay in the cache; every how many of these tell how certain states are.
_CHUNK, _ALL, _EVERY = 1024, slice(None), 4
# Changes of shared numbers, of their deviations, where a fit ends, or what it begins at, and shares
# of strengths that are none; iterations at most, and changes of unknowns at once.
_SETTLED, _ROUGHLY, _SAME, _MOST, _FAR = 0.05, 1.0, 0.1, 30, 0.5
# The least share of a change that is taken.
_LEAST = 0.1


@dataclass
class Estimate:
    """Numbers and motion: what is shared (unknowns, drag, biases), states, and their fit.

    `covariance` is that of what is shared; `misses` (s, m) are readings over their deviations, NaN
    where there is none, and `left` (n) root mean squares of what steps leave; `wind` (pulls) are
    deviations of the pull, and `settled` whether steps have come to an end. `tilt` is the slope of
    how certain states are, along what is shared.
    """

    shared: Array
    state: dict[str, Array]
    wind: Array
    slack: float = 1.0
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    misses: Array = field(default_factory=lambda: np.zeros((0, 0)))
    left: Array = field(default_factory=lambda: np.zeros(0))
    settled: bool = False
    tilt: Array | None = None


class Smoother:
    """Readings of logs, one after the other, and what explains them."""

    def __init__(self, model: Model, unknowns: Unknowns, logs: Sequence[Readings]) -> None:
        self.model, self.unknowns = model, unknowns
        self.command = np.concatenate([log.commands for log in logs])
        self.q, self.has, self.felt = (
            np.concatenate([getattr(log, name) for log in logs]) for name in ("q", "has", "felt")
        )
        ends = np.cumsum([len(log.q) for log in logs]) - 1
        # Whether a sample is followed by the next, of the same log.
        self.follows = np.ones((len(self.q), 1))
        self.follows[ends] = 0.0
        self._machine = lru_cache(64)(
            lambda z: model.machine(unknowns.parameters(np.frombuffer(z)))
        )
        self._pool = ThreadPoolExecutor(os.cpu_count())
        self.has = np.concatenate([self.has, np.isfinite(self.felt)], axis=1).astype(float)
        self.felt = np.nan_to_num(self.felt)
        weights = [np.concatenate([log.deviations, log.felt_deviations]) for log in logs]
        self.weights = 1.0 / np.sqrt(np.mean(np.square(weights), axis=0))
        sizes = np.repeat([_OF_Q, _OF_V, _OF_X], [model.nd, model.nv, model.nx])
        self.step_weights = 1.0 / (sizes * np.sqrt(model.h))
        self.left = np.exp(-model.h / _WIND_TIME) if model.free else 0.0
        self.imus = self.felt.shape[1]
        prior = [unknowns.prior] * len(unknowns.names)
        if model.free:
            prior.append(_DRAG * float(model.machine({}).scale[0]))
        prior += ([_BIASES[0]] * 3 + [_BIASES[1]] * 3) * (self.imus // 6)
        self.prior = np.array(prior)
        self.first = {
            "q": np.concatenate([log.guess for log in logs]),
            "v": np.concatenate([log.rates for log in logs]),
            "x": np.concatenate([model.levels(log.commands) for log in logs]),
            "pull": np.zeros((len(self.q), model.pulls)),
        }

    def start(self) -> Estimate:
        """The numbers of the robot file, and the motion by filtered readings."""
        wind = np.full(self.model.pulls, _WIND if self.model.free else 1.0)
        return Estimate(np.zeros(len(self.prior)), self.first, wind)

    def stepped(
        self, shared: Array, state: dict[str, Array], rows: Any = _ALL
    ) -> tuple[dict[str, Array], Array]:
        """States after a step from samples by their rows, and what IMUs feel before it."""
        machine = self._machine(shared[: len(self.unknowns.names)].tobytes())
        drag = shared[len(self.unknowns.names)] if self.model.free else 0.0
        after, felt = self.model(state, machine, command=self.command[rows], drag=drag)
        return after, felt + shared[len(shared) - self.imus :]

    def _residuals(self, estimate: Estimate) -> tuple[Array, Array, Array]:
        """Weighted readings (s, m), what steps leave (s, n), and prior."""
        state = estimate.state
        after, felt = self.stepped(estimate.shared, state)
        away = self.model.vehicle.displacement(self.q, state["q"])
        misses = np.concatenate([away, felt - self.felt], axis=1) * self.weights * self.has
        ahead = {name: np.roll(values, -1, axis=0) for name, values in state.items()}
        pulls = self.left * state["pull"] - ahead["pull"]
        gaps = np.concatenate([self.model.away(ahead, after), pulls], axis=1)
        gaps *= self._step_weights(estimate) * self.follows
        return misses, gaps, estimate.shared / self.prior

    def _step_weights(self, estimate: Estimate) -> Array:
        calm = 1.0 / (estimate.wind * np.sqrt(1.0 - self.left**2))
        return np.concatenate([self.step_weights / estimate.slack, calm])

    def _part(self, estimate: Estimate, free: int, residuals: Array, rows: slice) -> list[Array]:
        """Of the normal equations what some samples give.

        Squares of the own state (s, n, n), its products with the next, what is shared and
        residuals (s, n, n + free + 1), those of the next (s, free + 1, n), and squares of what is
        shared.
        """
        model, shared, weights = self.model, estimate.shared, self._step_weights(estimate)
        state = {name: values[rows] for name, values in estimate.state.items()}
        (after, felt), nd, n = self.stepped(shared, state, rows), model.nd, len(weights)
        reads, whole = nd + self.imus, nd + self.imus + n
        # Slopes of readings and steps along the state and what is shared, and residuals.
        slopes = np.zeros((len(felt), n + free + 1, whole))
        slopes[:, range(nd), range(nd)] = 1.0
        pulls = np.arange(-model.pulls, 0)
        slopes[:, n + pulls, whole + pulls] = self.left
        changed = slice(nd, whole - model.pulls)
        for place, way in enumerate(_STEP * np.eye(n + free, n + len(shared))):
            moved = model.moved(state, way[:n]) if place < n else state
            other, feels = self.stepped(shared + way[n:], moved, rows)
            change = np.concatenate([feels - felt, model.away(after, other)], axis=1)
            slopes[:, place, changed] = change / _STEP
        heavy = np.concatenate(
            [self.weights * self.has[rows], weights * self.follows[rows]], axis=1
        )
        slopes *= heavy[:, np.newaxis]
        slopes[:, -1] = residuals[rows]
        misses = np.abs(residuals[rows, np.newaxis, :reads])
        slopes[..., :reads] *= np.sqrt(_OUTLIER / np.maximum(misses, _OUTLIER))
        squares = slopes[:, :n] @ slopes.transpose(0, 2, 1)
        steps = slopes[..., reads:] * weights
        lines = np.concatenate([-steps[:, :n], squares[..., n:]], axis=2)
        flat = slopes[:, n:].transpose(1, 0, 2).reshape(free + 1, -1)
        return [squares[..., :n], lines, steps[:, n:], flat @ flat.T]

    def _eliminated(self, estimate: Estimate, free: int) -> tuple[Array, Array, Array, float]:
        """Normal equations without the states, and what gives these back.

        Inverses of factors of the states' squares (s, n, n), by them products with the next state,
        what is shared and residuals (s, n, n + free + 1), what is left for what is shared, and the
        logarithm of the determinant of the states' part.
        """
        misses, gaps, prior = self._residuals(estimate)
        chunks = [slice(k, k + _CHUNK) for k in range(0, len(self.q), _CHUNK)]
        residuals = np.concatenate([misses, gaps], axis=1)
        parts = self._pool.map(lambda rows: self._part(estimate, free, residuals, rows), chunks)
        *arrays, corners = zip(*parts, strict=True)
        diagonal, lines, after = map(np.concatenate, arrays)
        corner, weights = np.sum(corners, axis=0), self._step_weights(estimate)
        n, pulls = len(weights), range(len(weights) - self.model.pulls, len(weights))
        diagonal[1:, range(n), range(n)] += weights**2 * self.follows[:-1]
        lines[1:, :, n:] -= after[:-1].transpose(0, 2, 1)
        diagonal[0, pulls, pulls] += 1.0 / estimate.wind**2
        lines[0, pulls, -1] += estimate.state["pull"][0] / estimate.wind**2
        corner[range(free), range(free)] += 1.0 / self.prior[:free] ** 2
        corner[:free, -1] += prior[:free] / self.prior[:free]
        if free and estimate.tilt is not None:
            corner[:free, -1] += estimate.tilt[:free]
        for k, (square, line) in enumerate(zip(diagonal, lines, strict=True)):
            if k:
                carried = lines[k - 1, :, :n].T @ lines[k - 1]
                square -= carried[:, :n]
                line[:, n:] -= carried[:, n:]
            # The inverse of the factor: BLAS would share small triangular systems among cores.
            square[:] = dtrtri(dpotrf(square, lower=True)[0], lower=True)[0]
            line[:] = square @ line
        volume = -2.0 * float(np.sum(np.log(np.diagonal(diagonal, axis1=1, axis2=2))))
        return diagonal, lines, corner, volume

    def _tilt(self, estimate: Estimate) -> Array:
        """Half the slope of the logarithm of the states' determinant, by every fourth chunk."""
        starts = range(0, len(self.q), _EVERY * _CHUNK)
        spans = [np.arange(k, min(k + _CHUNK, len(self.q))) for k in starts]
        rows, part = np.concatenate(spans), copy(self)
        for name in ("command", "q", "has", "felt", "follows"):
            setattr(part, name, getattr(self, name)[rows])
        part.follows[np.cumsum([len(span) for span in spans]) - 1] = 0.0
        state = {name: values[rows] for name, values in estimate.state.items()}
        estimate = replace(estimate, state=state)
        steps = 0.1 * np.sqrt(np.diag(estimate.covariance))
        # Biases of IMUs leave what states are sure of as it is.
        ways = np.diag(steps)[: len(steps) - self.imus]
        moved = [replace(estimate, shared=estimate.shared + way) for way in (0.0 * steps, *ways)]
        at, *volumes = [part._eliminated(there, 0)[-1] for there in moved]
        tilt = np.zeros(len(steps))
        tilt[: len(ways)] = 0.5 * len(self.q) / len(rows) * (np.array(volumes) - at)
        return tilt / steps

    def _solved(
        self, estimate: Estimate, free: int
    ) -> tuple[Array, Array, Callable[[Array], Array]]:
        """Changes of what is shared, its covariance, and what changes of states (s, n) fit some."""
        diagonal, lines, corner, _ = self._eliminated(estimate, free)
        n = diagonal.shape[-1]
        flat = lines[..., n:].reshape(-1, free + 1)
        corner = corner - flat.T @ flat
        if not np.isfinite(corner).all():
            unknown = np.full(lines.shape[:2], np.nan)
            return np.zeros(free), np.diag(self.prior[:free] ** 2), lambda _: unknown

        # Readings add to what the prior tells; rounding, of equations that are so sure, may not.
        scale = self.prior[:free, np.newaxis]
        told, ways = np.linalg.eigh(corner[:free, :free] * scale * scale.T)
        covariance = (scale * ways / np.maximum(told, 1.0)) @ (scale * ways).T

        def states(shared: Array) -> Array:
            local, later = -lines[..., n:] @ np.append(shared, 1.0), np.zeros(n)
            for k in range(len(local) - 1, -1, -1):
                local[k] = later = diagonal[k].T @ (local[k] - lines[k, :, :n] @ later)
            return local

        return -covariance @ corner[:free, -1], covariance, states

    def covariance(self, estimate: Estimate) -> Array:
        """The covariance of what is shared, by slopes of readings."""
        return self._solved(estimate, len(self.prior))[1]

    def run(
        self,
        estimate: Estimate,
        tell: Callable[[str, float], None],
        numbers: bool = True,
        slacks: Sequence[float] = (),
        roughly: bool = False,
    ) -> Estimate:
        """The most likely estimate from another on, of the motion alone without `numbers`.

        What another fit begins at is found `roughly`: within a deviation, and without the tilt.
        Steps may leave `slacks` times as much in the first iterations. Costs are no guide on the
        way: a step that changes numbers leaves what equations that are so sure punish at once, and
        the next one takes back. So numbers take a share of their changes, by the last one (Aitken).
        """
        free, last, share = len(self.prior) if numbers else 0, np.zeros(0), 1.0
        for iteration in range(_MOST):
            early = iteration < len(slacks)
            estimate = replace(estimate, slack=slacks[iteration] if early else 1.0)
            with np.errstate(all="ignore"):
                change, covariance, states = self._solved(estimate, free)
                off = change / np.sqrt(np.diag(covariance))
                if last.size:
                    turn = off - last
                    share = float(np.clip(-share * (last @ turn) / (turn @ turn), _LEAST, 1.0))
                unknowns = change[: len(self.unknowns.names)]
                change *= share * min(1.0, _FAR / np.max(np.abs(unknowns), initial=_FAR))
                local = states(change)
            estimate = replace(estimate, covariance=covariance)
            if not np.isfinite(local).all():
                break
            shared = estimate.shared.copy()
            shared[:free] += change
            state = self.model.moved(estimate.state, local)
            estimate = replace(estimate, shared=shared, state=state)
            before = estimate.wind
            if self.model.free and not early:
                estimate.wind = np.maximum(_CALM, np.sqrt(np.mean(state["pull"] ** 2, axis=0)))
            size, was = (float(np.max(np.abs(x), initial=0.0)) for x in (off, last))
            detail = f"iteration {iteration + 1}" + f", change {size:.2g}" * numbers
            tell(detail, 1.0 - 1.0 / (2.0 + iteration))
            if early:
                continue
            # What further iterations would change, if each changes less by the same factor.
            rest = size**2 / max(was - size, 0.1 * size, 1e-9)
            same, last = np.max(np.abs(np.log(before / estimate.wind))) < _SAME, off
            if same and (rest < (_ROUGHLY if roughly else _SETTLED) if free else iteration > 2):
                if free and estimate.tilt is None and not roughly:
                    estimate.tilt, last = self._tilt(estimate), np.zeros(0)
                    continue
                estimate.settled = True
                break
        misses, gaps, _ = self._residuals(estimate)
        estimate.left = np.sqrt(np.mean(gaps**2, axis=0))
        estimate.misses = np.where(self.has > 0.0, misses, np.nan)
        return estimate
