"""The most likely motion and numbers, by Gauss-Newton over all samples at once.

Unknown are the state at every sample, with the pull of the wind, and what all share: numbers of the
robot file, a drag, biases of IMUs. What is least is the sum of squares, each over its deviation, of
readings, of what steps from sample to sample leave, of changes of the wind, and of the prior. The
wind is a process from sample to sample, as turbulence is: were it a curve through nodes, what it
does between these would be in all accelerations of a node alike, and deviations too small.

The equations of the states are a band, and those of what is shared a border.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

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
# Share of the drag's deviation without a pose, by which velocities are unknown.
_BLIND = 1e-6
# What steps may leave of a pose that nothing reads, and of its velocity, SI units.
_ANYTHING = 1e3
# Samples at a time, which stay in the cache.
_CHUNK, _ALL = 1024, slice(None)
# Changes of shared numbers, of their deviations, and shares of strengths, that are none;
# iterations at most.
_SETTLED, _SAME, _MOST = 0.03, 0.1, 30
# Changes of unknowns at once beyond which equations are others.
_FAR = 2.0
_DAMPINGS = (0.0, 1e-3, 1e-1, 10.0, 1e3)


@dataclass
class Estimate:
    """Numbers and motion: what is shared (unknowns, drag, biases), states, and their fit.

    `covariance` is that of what is shared; `misses` (s, m) are readings over their deviations, NaN
    where there is none, and `left` (n) root mean squares of what steps leave;
    `wind` is the deviation of the pull, and `settled` whether steps have come to an end.
    """

    shared: Array
    state: dict[str, Array]
    wind: float = _WIND
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    misses: Array = field(default_factory=lambda: np.zeros((0, 0)))
    left: Array = field(default_factory=lambda: np.zeros(0))
    settled: bool = False


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
        # What no log tells the attitude of, it feels no gravity of, nor air as it goes.
        blind = all(log.blind for log in logs)
        fixed = {"gravity": 0.0} if blind else {}
        self._machine = lru_cache(64)(
            lambda z: model.machine(unknowns.parameters(np.frombuffer(z)) | fixed)
        )
        self._pool = ThreadPoolExecutor(os.cpu_count())
        self.has = np.concatenate([self.has, np.isfinite(self.felt)], axis=1).astype(float)
        self.felt = np.nan_to_num(self.felt)
        weights = [np.concatenate([log.deviations, log.felt_deviations]) for log in logs]
        self.weights = 1.0 / np.sqrt(np.mean(np.square(weights), axis=0))
        root, nv = np.sqrt(model.h), model.nv
        steps = np.array([*[_OF_Q * root] * nv, *[_OF_V * root] * nv, *[_OF_X * root] * model.nx])
        if blind:
            along = np.arange(nv)[model.layout.v.position]
            steps[[*model.layout.v.base, *(nv + along)]] = _ANYTHING
        self.step_weights = 1.0 / steps
        self.left = np.exp(-model.h / _WIND_TIME) if model.free else 0.0
        self.imus = self.felt.shape[1]
        prior = [unknowns.prior] * len(unknowns.names)
        if model.free:
            prior.append((_BLIND if blind else 1.0) * _DRAG * float(model.machine({}).scale[0]))
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
        wind = _WIND if self.model.free else 1.0
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
        """Weighted readings (s, m), what steps leave (s − 1, n), and prior."""
        state = estimate.state
        after, felt = self.stepped(estimate.shared, state)
        away = self.model.module.difference(self.q, state["q"])
        misses = np.concatenate([away, felt - self.felt], axis=1) * self.weights * self.has
        ahead = {name: values[1:] for name, values in state.items()}
        gaps = self.model.away(ahead, {name: values[:-1] for name, values in after.items()})
        pulls = self.left * state["pull"][:-1] - state["pull"][1:]
        gaps = np.concatenate([gaps * self.step_weights, pulls * self._calm(estimate)], axis=1)
        return misses, gaps * self.follows[:-1], estimate.shared / self.prior

    def _left(self, estimate: Estimate) -> Array:
        """Root mean squares of what steps leave, over its deviations."""
        left: Array = np.sqrt(np.mean(self._residuals(estimate)[1] ** 2, axis=0))
        return left

    def _calm(self, estimate: Estimate) -> float:
        return 1.0 / (estimate.wind * float(np.sqrt(1.0 - self.left**2)))

    def _cost(self, estimate: Estimate) -> float:
        misses, gaps, prior = self._residuals(estimate)
        size = np.abs(misses)
        robust = np.where(size < _OUTLIER, size**2, 2.0 * _OUTLIER * size - _OUTLIER**2)
        pull = np.sum((estimate.state["pull"][0] / estimate.wind) ** 2)
        return float(np.sum(robust) + np.sum(gaps**2) + np.sum(prior**2) + pull)

    def _slopes(
        self, estimate: Estimate, free: int, rows: slice
    ) -> tuple[Array, Array, Array, Array]:
        """Derivatives of readings and steps (s, ·, n) by the state, and by what is shared."""
        model, shared = self.model, estimate.shared
        state = {name: values[rows] for name, values in estimate.state.items()}
        m, (after, felt) = 2 * model.nv + model.nx, self.stepped(shared, state, rows)
        n = m + model.pulls

        def change(shared: Array, moved: dict[str, Array]) -> Array:
            other, feels = self.stepped(shared, moved, rows)
            return np.concatenate([model.away(after, other), feels - felt], axis=1) / _STEP

        columns = [change(shared, model.moved(state, _STEP * unit)) for unit in np.eye(n)]
        columns += [change(shared + _STEP * unit, state) for unit in np.eye(len(shared))[:free]]
        slopes = np.stack(columns, axis=-1)
        pose, pulls = (np.zeros((len(slopes), k, n + free)) for k in (model.nv, model.pulls))
        pose[:, range(model.nv), range(model.nv)] = 1.0
        pulls[:, range(model.pulls), range(m, n)] = self.left
        reads = np.concatenate([pose, slopes[:, m:]], axis=1)
        steps = np.concatenate([slopes[:, :m], pulls], axis=1)
        return reads[..., :n], steps[..., :n], reads[..., n:], steps[..., n:]

    def _part(
        self, estimate: Estimate, free: int, residuals: tuple[Array, Array], rows: slice
    ) -> tuple[Array, ...]:
        """Of the normal equations what some samples give, and their steps to the next."""
        reads, steps, reads_border, border = self._slopes(estimate, free, rows)
        misses, gaps = (values[rows] for values in residuals)
        robust = np.minimum(1.0, _OUTLIER / np.maximum(np.abs(misses), 1e-12))
        missed = misses * self.weights * robust
        whole = np.array([*self.step_weights, *[self._calm(estimate)] * self.model.pulls])
        q, left = whole**2 * self.follows[rows], gaps * whole
        turned = (
            reads.transpose(0, 2, 1) * (self.weights**2 * self.has[rows] * robust)[:, np.newaxis]
        )
        ahead = steps.transpose(0, 2, 1) * q[:, np.newaxis]
        weighed = q[:, :, np.newaxis] * border
        flat, flat_steps = (
            x.reshape(x.shape[0] * x.shape[1], free) for x in (reads_border, border)
        )
        heavy = (self.weights**2 * self.has[rows] * robust).reshape(-1, 1) * flat
        return (
            turned @ reads + ahead @ steps,
            turned @ reads_border + ahead @ border,
            np.einsum("kma,km->ka", reads, missed) + np.einsum("kma,km->ka", steps, left),
            ahead,
            weighed,
            q,
            left,
            flat.T @ heavy + flat_steps.T @ weighed.reshape(flat_steps.shape),
            flat.T @ missed.ravel() + flat_steps.T @ left.ravel(),
        )

    def _solved(self, estimate: Estimate, free: int) -> Callable[[float], tuple[Array, ...]]:
        """What solves the normal equations, with a damping: changes and covariance."""
        misses, gaps, prior = self._residuals(estimate)
        count, n = len(misses), gaps.shape[1]
        residuals = misses, np.concatenate([gaps, np.zeros((1, n))])
        chunks = [slice(k, min(k + _CHUNK, count)) for k in range(0, count, _CHUNK)]
        parts = list(
            zip(
                *self._pool.map(lambda rows: self._part(estimate, free, residuals, rows), chunks),
                strict=True,
            )
        )
        diagonal, border, gradient, ahead, weighed, q, left = map(np.concatenate, parts[:7])
        corner, shared_gradient = (np.sum(part, axis=0) for part in parts[7:])
        diagonal[1:, range(n), range(n)] += q[:-1]
        border[1:] -= weighed[:-1]
        gradient[1:] -= left[:-1]
        pulls = range(n - self.model.pulls, n)
        diagonal[0, pulls, pulls] += 1.0 / estimate.wind**2
        gradient[0, pulls] += estimate.state["pull"][0] / estimate.wind**2
        corner += np.diag(1.0 / self.prior[:free] ** 2)
        shared_gradient += prior[:free] / self.prior[:free]
        # Columns of the lower band, as LAPACK has them.
        band = np.zeros((count, n, 2 * n))
        for column in range(n):
            band[:, column, : n - column] = diagonal[:, column, column:]
            band[:-1, column, n - column : 2 * n - column] = -ahead[:-1, column]

        def solve(damping: float) -> tuple[Array, Array, Array]:
            damped = band.reshape(count * n, 2 * n).copy()
            damped[:, 0] *= 1.0 + damping
            factor = cholesky_banded(damped.T, overwrite_ab=True, lower=True, check_finite=False)
            right = np.concatenate([border, gradient[..., np.newaxis]], axis=2).reshape(
                count * n, free + 1
            )
            found = cho_solve_banded((factor, True), right, check_finite=False)
            lines = border.reshape(count * n, free)
            left_over = corner - lines.T @ found[:, :free] + damping * np.diag(np.diag(corner))
            covariance = np.linalg.inv(left_over)
            shared = -covariance @ (shared_gradient - lines.T @ found[:, free])
            local = -found[:, free] - found[:, :free] @ shared
            return local.reshape(count, n), shared, covariance

        return solve

    def covariance(self, estimate: Estimate, free: int | None = None) -> Array:
        """The covariance of what is shared, or of the first `free`, by slopes of readings."""
        return self._solved(estimate, len(self.prior) if free is None else free)(0.0)[2]

    def run(
        self, estimate: Estimate, tell: Callable[[str, float], None], numbers: bool = True
    ) -> Estimate:
        """The most likely estimate from another on, of the motion alone without `numbers`."""
        free = len(self.prior) if numbers else 0
        damping = 0
        for iteration in range(_MOST):
            solve, cost = self._solved(estimate, free), self._cost(estimate)
            for place in range(damping, len(_DAMPINGS)):
                local, change, covariance = solve(_DAMPINGS[place])
                shared = estimate.shared.copy()
                shared[:free] += change
                moved = Estimate(shared, self.model.moved(estimate.state, local), estimate.wind)
                sizes = np.abs(change[: len(self.unknowns.names)])
                with np.errstate(all="ignore"):
                    better = np.all(sizes < _FAR) and self._cost(moved) < cost * (1.0 + 1e-9)
                if better:
                    break
            damping = max(0, place - 1)
            if not better:
                break
            size = np.max(np.abs(change) / np.sqrt(np.diag(covariance)), initial=0.0)
            estimate = moved
            estimate.covariance = covariance
            wind = max(_CALM, float(np.sqrt(np.mean(estimate.state["pull"] ** 2))))
            same = not self.model.free or abs(np.log(wind / estimate.wind)) < _SAME
            estimate.wind = wind if self.model.free else estimate.wind
            tell(f"iteration {iteration + 1}, cost {cost:.4g}", 1.0 - 1.0 / (2.0 + iteration))
            if place == 0 and same and (size < _SETTLED if free else iteration > 2):
                estimate.settled = True
                break
        if place or not better:  # Damped, it would be too small.
            estimate.covariance = self.covariance(estimate, free)
        misses = self._residuals(estimate)[0]
        estimate.left = self._left(estimate)
        estimate.misses = np.where(self.has > 0.0, misses, np.nan)
        return estimate
