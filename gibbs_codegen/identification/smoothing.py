"""The most likely motion and numbers, by Gauss-Newton over all samples at once.

Unknown are states, with the pull of the wind, and what all share: numbers of the robot file, a
drag, biases of IMUs. What is least is the sum of squares, each over its deviation, of readings, of
what steps from state to state leave, of changes of the wind, and of the prior. The wind is a
process from state to state, as turbulence is: were it a curve through nodes, what it does between
these would be in all accelerations of a node alike, and deviations too small. A base that flies has
a state every 20 ms, in which the wind hardly changes, and samples on the way; other robots, whose
inputs err from sample to sample, have one at each.

States are eliminated one after the other, which leaves equations of what is shared. Numbers for
which states are less certain explain readings by more motions than the most likely one. So half the
logarithm of the determinant of the states' equations counts too, which makes the likelihood that
of numbers alone (Laplace's approximation): without it a scale of all forces came out too great by
1.5 deviations.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri
from threadpoolctl import threadpool_limits

from gibbs_codegen.flight.plant.actuators import has_battery
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.identification.model import OUTLIER, MachineNumbers, Model
from gibbs_codegen.identification.recorded import DELAY, Readings, delayed
from gibbs_codegen.identification.unknowns import Unknowns

# Deviations of what a step leaves, by the root of its time, s: of q, v and actuators, SI units.
_OF_Q, _OF_V, _OF_X = 3e-5, 5e-4, 3e-4
# Of biases of IMUs, m/s² and rad/s, and of the drag, by the mass, 1/s.
_BIASES, _DRAG = (0.3, 0.05), 1.0
# The least deviation of actuators at first, in their units, else that of where commands hold them;
# and that of the charge of a battery, a share.
_RESTING, _CHARGE = 1e-2, 0.5
# Time, s, in which the wind's pull decays, its deviation at first, m/s², and the least.
_WIND_TIME, _WIND, _CALM = 1.0, 0.3, 0.01
_STEP = 1e-6
# Time from state to state of what flies, s; states at a time, which stay in the cache; every how
# many tell how certain they are.
_SPACING, _CHUNK, _ALL, _EVERY = 0.02, 256, slice(None), 8
# Changes of shared numbers, of their deviations, where a fit ends, or what it begins at, and shares
# of strengths that are none; iterations at most, and changes of unknowns at once.
_SETTLED, _ROUGHLY, _SAME, _MOST, _FAR = 0.05, 1.0, 0.1, 30, 0.5
# Middles of bins where the likelihood bends: deviations from one to the next, with which a normal
# law keeps its deviation, cost from which on none follows, and how many at most to a side.
_APART, _UNLIKELY, _POINTS = 1.4, 0.9, 5
# How much more than its deviations steps may leave to begin with; for how many iterations each at
# most, and changes, in deviations, at which the next follows.
_SLACKS, _WAIT, _NEAR = (30.0, 10.0, 3.0), 8, 10.0
# Iterations in a row, after which a fit ends that comes no nearer.
_STUCK = 6
# The least share of a change that is taken, and final iterations of the motion with a battery.
_LEAST, _MOTIONS = 0.1, 4


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


def _shares(log: Readings, model: Model) -> Array:
    """Shares (s, nd) of weights, by which a joint's equal readings in a row tell as much as one.

    An encoder's rounding is the same error in all of them.
    """
    shares, joints = np.ones(log.has.shape), model.layout.displaced.joints
    columns = shares[:, joints].T, log.has[:, joints].T, log.q[:, model.layout.q.joints].T
    for column, known, angles in zip(*columns, strict=True):
        runs = np.cumsum(np.diff(angles[known], prepend=np.nan) != 0.0) - 1
        column[known] = 1.0 / np.sqrt(np.bincount(runs)[runs])
    return shares


class Smoother:
    """Readings of logs, one after the other, and what explains them."""

    def __init__(self, model: Model, unknowns: Unknowns, logs: Sequence[Readings]) -> None:
        self.model, self.unknowns = model, unknowns
        # Samples from state to state.
        self.samples = max(1, round(_SPACING / model.h)) if model.free else 1

        def grouped(arrays: Sequence[Array], **fill: Any) -> Array:
            """Series of logs (s, samples, ·), each filled up at its end."""
            ends = [[(0, -len(log.q) % self.samples), (0, 0)] for log in logs]
            pairs = zip(arrays, ends, strict=True)
            whole = np.concatenate([np.pad(series, end, **fill) for series, end in pairs])
            return whole.reshape(len(whole) // self.samples, self.samples, whole.shape[1])

        self.q = grouped([log.q for log in logs], mode="edge")
        self.felt = grouped([log.felt for log in logs], constant_values=np.nan)
        # Whether a state is followed by the next, of the same log.
        self.follows = np.ones((len(self.q), 1))
        self.follows[np.cumsum([-(-len(log.q) // self.samples) for log in logs]) - 1] = 0.0
        self._machine = lru_cache(64)(
            lambda z: model.machine(unknowns.parameters(np.frombuffer(z)))
        )
        # Commands, by how much later readings are, which only poses tell from lags.
        self.late = int(any(log.blind for log in logs))
        self.commands = lru_cache(64)(
            lambda delay: grouped([delayed(x.commands, delay / model.h) for x in logs], mode="edge")
        )
        self._pool = ThreadPoolExecutor(os.cpu_count())
        has = grouped([log.has * _shares(log, model) for log in logs])
        self.has = np.concatenate([has, np.isfinite(self.felt)], axis=2)
        self.felt = np.nan_to_num(self.felt)
        weights = [np.concatenate([log.deviations, log.felt_deviations]) for log in logs]
        # Of the readings of all samples of a state (s, m).
        self._weights = self.has / np.sqrt(np.mean(np.square(weights), axis=0))
        self._weights = self._weights.reshape(len(self.q), -1)
        sizes = np.repeat([_OF_Q, _OF_V, _OF_X], [model.nd, model.nv, model.nx])
        self.step_weights = 1.0 / (sizes * np.sqrt(self.samples * model.h))
        # What is left of a pull after a sample, and until the next state.
        kept = float(np.exp(-model.h / _WIND_TIME)) if model.free else 0.0
        self.left, self._window = kept**self.samples, model.window(self.samples, kept)
        self.imus = self.felt.shape[2]
        drag = [_DRAG * float(model.machine({}).given["scale"][0])] * model.free
        biases = ([_BIASES[0]] * 3 + [_BIASES[1]] * 3) * (self.imus // 6)
        self.prior = np.array([*unknowns.prior, *drag, *[DELAY] * self.late, *biases])
        firsts = zip(
            *([log.guess, log.rates, model.levels(log.commands)] for log in logs), strict=True
        )
        self.first = {
            name: np.concatenate([x[:: self.samples] for x in series])
            for name, series in zip("qvx", firsts, strict=True)
        }
        self.first["pull"] = np.zeros((len(self.q), model.pulls))
        self._at_first = 1.0 / np.maximum(np.std(self.first["x"], axis=0), _RESTING)
        self._battery = has_battery(model.vehicle)
        if self._battery:  # Nobody knows how far it is charged.
            self._at_first[-1] = 1.0 / _CHARGE

    def start(self) -> Estimate:
        """The numbers of the robot file, and the motion by filtered readings."""
        wind = np.full(self.model.pulls, _WIND if self.model.free else 1.0)
        return Estimate(np.zeros(len(self.prior)), self.first, wind)

    def machine(self, shared: Array) -> tuple[MachineNumbers, float]:
        """A machine and its drag by what is shared."""
        f = len(self.unknowns.names)
        drag = float(shared[f]) if self.model.free else 0.0
        return self._machine(shared[:f].tobytes()), drag

    def _given(self, state: Mapping[str, Array], rows: Any = _ALL) -> dict[str, Array]:
        """Some states, each with the next one and what was read from it to that."""
        ahead = {f"next_{name}": np.roll(state[name], -1, axis=0) for name in "qvx"}
        series = {"felt": self.felt} | {f"read_{k}": self.q[:, k] for k in range(self.samples)}
        return {name: x[rows] for name, x in {**state, **ahead, **series}.items()}

    def _told(
        self, shared: Array, given: Mapping[str, Array], change: Array, rows: Any = _ALL
    ) -> dict[str, Any]:
        """What readings and next states are `off` (s, ·), without biases, after a change."""
        machine, drag = self.machine(shared)
        delay = float(shared[len(shared) - self.imus - 1]) if self.late else 0.0
        numbers = {**given, **machine.given, "change": change, "drag": drag}
        numbers["commands"] = self.commands(delay)[rows]
        return self._window(numbers, {"robot": machine.constants})

    def _residuals(self, estimate: Estimate) -> tuple[Array, Array, Array]:
        """Weighted readings (s, m), what steps leave (s, n), and prior."""
        state, shared, weights = estimate.state, estimate.shared, self._step_weights(estimate)
        told, pull = self._told(shared, self._given(state), np.zeros(len(weights))), state["pull"]
        misses, gaps = np.split(told["off"], [self._weights.shape[1]], axis=1)
        biases = np.append(np.zeros(self.model.nd), shared[len(shared) - self.imus :])
        misses = (misses + np.tile(biases, self.samples)) * self._weights
        gaps = np.concatenate([gaps, self.left * pull - np.roll(pull, -1, axis=0)], axis=1)
        return misses, gaps * weights * self.follows, shared / self.prior

    def _step_weights(self, estimate: Estimate) -> Array:
        calm = 1.0 / (estimate.wind * np.sqrt(1.0 - self.left**2))
        return np.concatenate([self.step_weights / estimate.slack, calm])

    def _slopes(self, estimate: Estimate, free: int, residuals: Array, rows: Any) -> Array:
        """Slopes of readings and gaps along states and what is shared, and these (·, s, m + n)."""
        model, shared, weights = self.model, estimate.shared, self._step_weights(estimate)
        given, n, reads = self._given(estimate.state, rows), len(weights), self._weights.shape[1]
        slopes = np.zeros((n + free + 1, len(given["q"]), reads + n))
        pulls = np.arange(-model.pulls, 0)
        slopes[n + pulls, :, reads + n + pulls] = _STEP * self.left
        biases = np.arange(self.imus * bool(free))
        for k in range(self.samples):
            felt = k * (model.nd + self.imus) + model.nd + biases
            slopes[n + free - len(biases) + biases, :, felt] = _STEP
        # Away from what is seen, not read: an outlier of the place would turn the base.
        seen = self._told(shared, given, np.zeros(n), rows)
        given |= {f"read_{k}": seen[f"seen_{k}"] for k in range(self.samples)}
        here = self._told(shared, given, np.zeros(n), rows)["off"]
        off = slopes[..., : reads + n - model.pulls]
        ways = _STEP * np.eye(n + free - len(biases), n + len(shared))
        if free and self._battery:  # Slopes of its charge bend: at one place they say too much.
            ways[n - model.pulls - 1] *= _CHARGE / _STEP
        for place, way in enumerate(ways):
            moved = self._told(shared + way[n:], given, way[:n], rows)["off"]
            off[place] = (moved - here) * (_STEP / way.max())
        heavy = np.concatenate([self._weights[rows], weights * self.follows[rows]], axis=1)
        slopes *= heavy / _STEP
        slopes[-1] = residuals[rows]
        misses = np.abs(residuals[rows, :reads])
        slopes[..., :reads] *= np.sqrt(OUTLIER / np.maximum(misses, OUTLIER))
        return slopes

    def _part(self, estimate: Estimate, free: int, residuals: Array, rows: slice) -> list[Array]:
        """Of the normal equations what some states give.

        Squares of the own state (s, n, n), its products with the next, what is shared and
        residuals (s, n, n + free + 1), those of the next (s, free + 1, n), and squares of what is
        shared.
        """
        slopes = self._slopes(estimate, free, residuals, rows)
        weights = self._step_weights(estimate)
        n = len(weights)
        flat, slopes = slopes[n:].reshape(free + 1, -1), slopes.transpose(1, 0, 2)
        squares = slopes[:, :n] @ slopes.transpose(0, 2, 1)
        steps = slopes[..., -n:] * weights
        lines = np.concatenate([-steps[:, :n], squares[..., n:]], axis=2)
        return [squares[..., :n], lines, steps[:, n:], flat @ flat.T]

    def _eliminated(self, estimate: Estimate, free: int) -> tuple[Array, Array, Array]:
        """Normal equations without the states, and what gives these back.

        Inverses of factors of the states' squares (s, n, n), by them products with the next state,
        what is shared and residuals (s, n, n + free + 1), and what is left for what is shared.
        """
        misses, gaps, prior = self._residuals(estimate)
        chunks = [slice(k, k + _CHUNK) for k in range(0, len(self.q), _CHUNK)]
        residuals, weights = np.concatenate([misses, gaps], axis=1), self._step_weights(estimate)
        count, n = len(self.q), len(weights)
        diagonal, lines = np.empty((count, n, n)), np.empty((count, n, n + free + 1))
        corner, last = np.zeros((free + 1, free + 1)), np.zeros((1, free + 1, n))
        reached = np.append(np.zeros((1, 1)), self.follows[:-1], axis=0)
        # Where a log begins, actuators are near where its first commands hold them.
        begins = np.append(self._at_first, 1.0 / estimate.wind)
        off = np.append(estimate.state["x"] - self.first["x"], estimate.state["pull"], axis=1)
        off, unsure = begins**2 * (1.0 - reached) * off, range(n - len(begins), n)
        with threadpool_limits(1, "blas"):  # Its idle threads would keep cores from this pool.
            # While this thread eliminates the states of a chunk, others compute the next ones.
            parts = self._pool.map(lambda rows: self._part(estimate, free, residuals, rows), chunks)
            for rows, (squares, products, after, square_sums) in zip(chunks, parts, strict=True):
                corner += square_sums
                squares[:, range(n), range(n)] += weights**2 * reached[rows]
                products[..., n:] -= np.concatenate([last, after[:-1]]).transpose(0, 2, 1)
                last = after[-1:]
                squares[:, unsure, unsure] += begins**2 * (1.0 - reached[rows])
                products[:, unsure, -1] += off[rows]
                for k, (square, line) in enumerate(zip(squares, products, strict=True), rows.start):
                    if k:
                        carried = lines[k - 1, :, :n].T @ lines[k - 1]
                        square -= carried[:, :n]
                        line[:, n:] -= carried[:, n:]
                    diagonal[k] = dtrtri(dpotrf(square, lower=True)[0], lower=True)[0]
                    lines[k] = diagonal[k] @ line
                flat = lines[rows, :, n:].reshape(-1, free + 1)
                corner -= flat.T @ flat
        corner[range(free), range(free)] += 1.0 / self.prior[:free] ** 2
        corner[:free, -1] += prior[:free] / self.prior[:free]
        if free and estimate.tilt is not None:
            corner[:free, -1] += estimate.tilt[:free]
        return diagonal, lines, corner

    def _tilt(self, estimate: Estimate) -> Array:
        """Half the slope of the logarithm of the states' determinant, by every eighth state.

        Of J'J it is the trace of its inverse, which is the covariance of states, and J' dJ.
        """
        diagonal, lines, _ = self._eliminated(estimate, 0)
        weights, turned = self._step_weights(estimate), diagonal.transpose(0, 2, 1)
        n = len(weights)
        gains, covariance = turned @ lines[..., :n], turned @ diagonal
        for k in range(len(gains) - 2, -1, -1):
            covariance[k] += gains[k] @ covariance[k + 1] @ gains[k].T
        rows = np.arange(_EVERY // 2, len(gains), _EVERY)
        ahead = gains[rows] @ covariance[np.minimum(rows + 1, len(gains) - 1)]
        residuals = np.concatenate(self._residuals(estimate)[:2], axis=1)

        def slopes(way: Array) -> Array:
            there = replace(estimate, shared=estimate.shared + way)
            return self._slopes(there, 0, residuals, rows)[:n].transpose(1, 0, 2)

        steps = 0.1 * np.sqrt(np.diag(estimate.covariance))
        at = slopes(0.0 * steps)
        telling = covariance[rows] @ at
        telling[..., -n:] += ahead * (weights * self.follows[rows])[:, np.newaxis]
        # Biases of IMUs leave what states are sure of as it is.
        ways = np.diag(steps)[: len(steps) - self.imus]
        tilt, share = np.zeros(len(steps)), len(gains) / len(rows)
        changes = self._pool.map(lambda way: np.sum(telling * (slopes(way) - at)), ways)
        tilt[: len(ways)] = share * np.array([*changes])
        if self.model.free:
            # Of calm air the least wind is too much, which a greater drag would make up for.
            tilt[len(self.unknowns.names)] *= np.mean(estimate.wind > _CALM)
        return tilt / steps

    def _solved(
        self, estimate: Estimate, free: int
    ) -> tuple[Array, Array, Callable[[Array], Array]]:
        """Changes of what is shared, its covariance, and what changes of states (s, n) fit some."""
        diagonal, lines, corner = self._eliminated(estimate, free)
        n = diagonal.shape[-1]
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

    def spread(self, estimate: Estimate) -> tuple[Array, Array]:
        """Means and covariance of what is shared, which bends along one direction most.

        They are those of bins along it, by how likely all else makes the middle of each (Laplace).
        What a log tells well changes too little to bend; what the prior alone tells is straight.
        """
        scale, points = np.outer(self.prior, self.prior), dict[float, tuple[Any, ...]]()
        shares, ways = np.linalg.eigh(estimate.covariance / scale)
        across = ways[:, np.argmax(np.sqrt(shares) * (1.0 - shares))] / self.prior
        first = self._solved(estimate, len(self.prior))
        for sign in (-1.0, 1.0):
            point, solved, place = estimate, first, float(across @ estimate.shared)
            cost = slope = 0.0
            for _ in range(_POINTS):
                change, covariance, states = solved
                toward = covariance @ across
                size = across @ toward
                step, before, slope = across @ point.shared - place, slope, -across @ change / size
                place, cost = place + step, cost + 0.5 * step * (before + slope)
                change = change + slope * toward
                likely = 0.5 * (np.linalg.slogdet(covariance / scale)[1] - np.log(size)) - cost
                points[place] = likely, point.shared + change, covariance, toward / size, size
                if cost > _UNLIKELY:
                    break
                change = change + sign * _APART / np.sqrt(size) * toward
                state = self.model.moved(point.state, states(change))
                point = replace(point, shared=point.shared + change, state=state)
                local = self._solved(point, 0)[2](change[:0])
                if not np.isfinite(local).all():
                    return estimate.shared, estimate.covariance
                point.state = self.model.moved(state, local)
                solved = self._solved(point, len(self.prior))
        widths, rows = np.gradient(sorted(points)), [points[place] for place in sorted(points)]
        chances, means, covariances, along, sizes = map(np.array, zip(*rows, strict=True))
        weights = widths * np.exp(chances - chances.max())
        weights /= np.sum(weights)
        mean = weights @ means
        off, within = means - mean, weights * (widths**2 / 12.0 - sizes)
        whole = np.tensordot(weights, covariances, 1) + (weights * off.T) @ off
        return mean, whole + (within * along.T) @ along

    def run(
        self,
        estimate: Estimate,
        tell: Callable[[str, float], None],
        numbers: bool = True,
        roughly: bool = False,
        held: int = 0,
    ) -> Estimate:
        """The most likely estimate from another on, of the motion alone without `numbers`.

        What another fit begins at is found `roughly`: within a deviation, and without the tilt.
        At first steps may leave more: from afar, equations that are sure at once lead astray. The
        first iterations hold numbers, `held` of them, until the motion is theirs. Costs are no
        guide on the way: a step that changes numbers leaves what equations that are so sure punish
        at once, and the next one takes back. So numbers take a share of their changes, by the last
        one (Aitken).
        """
        last, share, stuck, level = np.zeros(0), 1.0, 0, 0
        for iteration in range(_MOST):
            free = len(self.prior) if numbers and iteration >= held else 0
            early = level < len(_SLACKS)
            estimate = replace(estimate, slack=_SLACKS[level] if early else 1.0)
            with np.errstate(all="ignore"):
                change, covariance, states = self._solved(estimate, free)
                deviations = np.sqrt(np.diag(covariance))
                off = change / deviations
                if last.size:
                    # By the same deviations: they fall with those of the wind.
                    last /= deviations
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
            detail = f"iteration {iteration + 1}" + f", change {size:.2g} deviations" * numbers
            tell(detail, 1.0 - 1.0 / (2.0 + iteration))
            if early:
                level += size < _NEAR or iteration >= _WAIT * (level + 1)
                continue
            # What further iterations would change, if each changes less by the same factor. It is
            # infinite where fits go far astray; a power of a float would raise there.
            rest = size * size / max(was - size, 0.1 * size, 1e-9)
            same = np.max(np.abs(np.log(before / estimate.wind))) < _SAME
            stuck = stuck + 1 if 0.0 < was <= size else 0
            if stuck == _STUCK:
                break
            last = off * deviations
            untold = free and estimate.tilt is None
            if same and (rest < (_ROUGHLY if untold else _SETTLED) if free else iteration > 2):
                if untold and not roughly:
                    estimate.tilt, last = self._tilt(estimate), np.zeros(0)
                    continue
                estimate.settled = True
                break
        for _ in range(_MOTIONS * self._battery):
            local = self._solved(estimate, 0)[2](np.zeros(0))
            estimate.state = self.model.moved(estimate.state, local)
        misses, gaps, _ = self._residuals(estimate)
        estimate.left = np.sqrt(np.mean(gaps**2, axis=0))
        misses = np.where(self._weights > 0.0, misses, np.nan)
        estimate.misses = misses.reshape(-1, self.has.shape[2])
        return estimate
