"""Many machines as one vector environment of Gymnasium, for learning how to fly them."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.rollouts.draws import episode_draws
from gibbs_codegen.rollouts.fleet import Fleet
from gibbs_codegen.rollouts.given import numpy_array, seconds, whole
from gibbs_codegen.rollouts.problem import RUNNING, Array, Method, Precision
from gibbs_codegen.rollouts.task import (
    Ending,
    Flags,
    Measure,
    Moment,
    away_and_rates,
    gone,
    nearness,
)
from gibbs_codegen.runtime.load import load, require
from gibbs_codegen.simulator.plant.vehicle import Vehicle

require("gymnasium", "VectorEnv")

import gymnasium  # noqa: E402
from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.spaces import Box  # noqa: E402
from gymnasium.utils import seeding  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402

Observations = NDArray[np.float32]
Infos = dict[str, Any]

# What an observation can say.
_FARTHEST = float(np.finfo(np.float32).max)


class VectorEnv(gymnasium.vector.VectorEnv[Observations, ArrayLike, Any]):
    """Machines of one robot that are to hover, or to do what rewards of your own ask for.

    Actions are the inputs of the robot, either as they are, in N and N m, or, `normalised`, between
    −1 for the least and 1 for the greatest. `parameters` (n), by name, are those of the episodes
    that are under way.

    Args:
        robot: A generated module with the back end "c" or "numpy", or the name or path of one,
            which is loaded with the C back end.
        num_envs: How many environments there are, n.
        hover: Coordinates (nq) that are wanted; None for those of zero.
        offsets, rates: Displacements from there, m and rad, and velocities, m/s and rad/s, with
            which an episode begins, by names of the module's `VELOCITIES`; zero if left out. They
            are numbers, or distributions that every episode draws from, such as
            `gibbs_codegen.uniform(-1, 1)` or those of `scipy.stats`.
        parameters: Numbers or distributions, by names of the module's `PARAMETERS`.
        limits: Least and greatest inputs, each a number or (nu), N and N m; None for those of the
            robot file.
        time_constants: Lag of the motors, s, a number or (rotors); None for that of the robot file.
        dt, steps, method: A decision is held through so many steps of `dt` s, by "euler" or "rk4".
        duration: An episode is truncated by the first decision at whose end so many seconds are
            over; or None.
        bounds: Least and greatest q and v, each a number or (nq + nv); beyond them an episode ends.
        reward, terminated, observe: Functions of a `Moment` that give rewards (n), whether episodes
            end (n), and observations (n, m).
        normalised: Whether actions are between −1 and 1.
        autoreset_mode: When an environment begins its next episode.
        precision, threads: "double" or "single", and how many threads share the environments.

    Raises:
        UsageError: If something does not fit the robot.
    """

    def __init__(
        self,
        robot: ModuleType | str | os.PathLike[str],
        num_envs: int,
        *,
        hover: ArrayLike | None = None,
        offsets: Mapping[str, Any] | None = None,
        rates: Mapping[str, Any] | None = None,
        parameters: Mapping[str, Any] | None = None,
        limits: tuple[ArrayLike, ArrayLike] | None = None,
        time_constants: ArrayLike | None = None,
        dt: float = 0.002,
        steps: int = 10,
        method: Method = "rk4",
        duration: float | None = 10.0,
        bounds: ArrayLike | None = None,
        reward: Measure = nearness,
        terminated: Ending = gone,
        observe: Measure = away_and_rates,
        normalised: bool = True,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        precision: Precision = "double",
        threads: int = 1,
    ) -> None:
        module = robot if isinstance(robot, ModuleType) else load(robot, "c")
        self.num_envs = whole("num_envs", num_envs)
        given: dict[str, Any] = {"limits": limits, "time_constants": time_constants, "dt": dt}
        given |= {"steps": steps, "method": method, "precision": precision, "threads": threads}
        self._fleet = Fleet(Vehicle(module), self.num_envs, hover=hover, bounds=bounds, **given)
        self._draws = episode_draws(module, offsets or {}, rates or {}, parameters or {})
        self._reward, self._terminated, self._observe = reward, terminated, observe
        self._most = _decisions(duration, self._fleet.duration)
        self._mode = _mode(autoreset_mode)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._over = np.zeros(self.num_envs, dtype=np.bool_)
        self._set_spaces(normalised)

    def _set_spaces(self, normalised: bool) -> None:
        """Tell what actions and observations are; raises `UsageError`."""
        self._normalised = normalised
        for name in ("reward", "terminated", "observe"):
            if not callable(getattr(self, f"_{name}")):
                raise UsageError(f"{name}: must be a function of a Moment")
        self.metadata = {"autoreset_mode": self._mode, "render_modes": []}
        motors = self._fleet.motors
        unlimited = ~(np.isfinite(motors.least) & np.isfinite(motors.most))
        if normalised and unlimited.any():
            names = ", ".join(np.array(self._fleet.vehicle.inputs)[unlimited])
            raise UsageError(
                f"limits: {names}: without limits, so that actions between -1 and 1 mean nothing; "
                "give limits=(least, most), or normalised=False"
            )
        least, most = (-1.0, 1.0) if normalised else (motors.least, motors.most)
        ones = np.ones(len(motors.least))
        observed = np.shape(self._observe(self._fleet.moment()))
        if len(observed) != 2 or observed[0] != self.num_envs:
            raise UsageError(f"observe: an array ({self.num_envs}, m), not of shape {observed}")
        self.single_action_space = Box(np.float32(least * ones), np.float32(most * ones))
        self.single_observation_space = Box(-np.inf, np.inf, observed[1:], np.float32)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    @property
    def parameters(self) -> dict[str, Array]:
        """Parameters (n) of the episodes that are under way, by name."""
        return {name: values.copy() for name, values in self._fleet.parameters.items()}

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment, from which it can be had again."""
        return tuple(self._seeds)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The random numbers of each environment."""
        return tuple(self._generators)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, Infos]:
        """Begin episodes in all environments, or in some.

        Args:
            seed: Of the first environment, the others having the next ones; or one for each, None
                where an environment goes on with its own random numbers.
            options: "reset_mask" (n) says in which environments, but the first time, when it must
                be all; the others are left as they are.

        Returns:
            Observations (n, m), and no further information.

        Raises:
            UsageError: If there are not n seeds, the mask is not n flags, or parameters are not
                those of a machine.
        """
        rows = np.ones(self.num_envs, dtype=np.bool_)
        if options and "reset_mask" in options:
            rows = np.asarray(options["reset_mask"])
            if rows.shape != (self.num_envs,) or rows.dtype != np.bool_ or not rows.any():
                raise UsageError(f"reset_mask: {self.num_envs} flags, of which some are True")
        if not (self._generators or rows.all()):
            raise UsageError("reset_mask: the first reset must begin episodes everywhere")
        self._seed(seed, rows)
        self._begin(rows)
        return self._observed(self._fleet.moment()), {}

    def step(self, actions: ArrayLike) -> tuple[Observations, Array, Flags, Flags, Infos]:
        """Take a decision in every environment.

        Args:
            actions: Actions (n, nu); those beyond their range count as at its end.

        Returns:
            Observations (n, m), rewards (n), whether episodes have terminated (n), whether they
            are truncated (n), and information: `ended` (n) says why a flight could not go on, as of
            `Rollout`. With `AutoresetMode.SAME_STEP`, `final_obs` are the last observations of
            episodes, and `final_info` is their information.

        Raises:
            UsageError: If actions are not finite numbers (n, nu), or what a function of the user's
                returns has the wrong shape.
            gymnasium.error.ResetNeeded: Before the first `reset`, and with
                `AutoresetMode.DISABLED` after an episode.
        """
        waiting = self._over
        if not self._generators or (self._mode == AutoresetMode.DISABLED and waiting.any()):
            raise ResetNeeded(
                f"call reset() first; environments whose episode is over: {np.flatnonzero(waiting)}"
            )
        ended = self._fleet.advance(self._inputs(actions))
        now = self._fleet.moment()
        rewards = self._told("reward", self._reward, now).astype(np.float64)
        terminations = self._told("terminated", self._terminated, now).astype(np.bool_)
        terminations |= ended != RUNNING
        truncations = self._fleet.decisions >= self._most
        if waiting.any():  # These begin in this step; what they were told does not count.
            self._begin(waiting)
            rewards[waiting] = 0.0
            terminations[waiting] = truncations[waiting] = False
            now = self._fleet.moment()
        infos = _information(ended, ~waiting)
        observations = self._observed(now)
        self._over = over = terminations | truncations
        if self._mode == AutoresetMode.SAME_STEP and over.any():
            infos = _information(ended, ~over)
            infos |= {"final_info": _information(ended, over), "_final_info": over.copy()}
            infos |= {"final_obs": _rows(observations, over), "_final_obs": over.copy()}
            self._begin(over)
            observations = self._observed(self._fleet.moment())
        return observations, rewards, terminations, truncations, infos

    def _seed(self, seed: int | Sequence[int | None] | None, rows: Flags) -> None:
        """Give environments `rows` (n) their random numbers, and all before the first episodes.

        Raises `UsageError` if there are not n seeds.
        """
        if seed is None or isinstance(seed, SupportsIndex):
            first = None if seed is None else operator.index(seed)
            seeds = [None if first is None else first + i for i in range(self.num_envs)]
        else:
            seeds = list(seed) if np.iterable(seed) else []
        if len(seeds) != self.num_envs:
            words = f"a whole number, or {self.num_envs} of them"
            raise UsageError(f"seed: {words}, not {printable(seed)}")
        if not self._generators:
            made = [seeding.np_random(each) for each in seeds]
            self._generators, self._seeds = [g for g, _ in made], [s for _, s in made]
            return
        for i in np.flatnonzero(rows):
            if seeds[i] is not None:
                self._generators[i], self._seeds[i] = seeding.np_random(seeds[i])

    def _begin(self, rows: Flags) -> None:
        """Begin episodes in some of the environments (n)."""
        chosen = [self._generators[i] for i in np.flatnonzero(rows)]
        counts = [len(draws.drawn) for draws in self._draws]
        shares = np.array([each.random(sum(counts)) for each in chosen])
        columns = np.split(shares, np.cumsum(counts)[:-1], axis=1)
        offsets, rates, parameters = (
            draws(own) for draws, own in zip(self._draws, columns, strict=True)
        )
        away, v = (self._by_place(each, len(chosen)) for each in (offsets, rates))
        self._fleet.restart(rows, away, v, parameters)
        self._over = self._over & ~rows

    def _by_place(self, values: dict[str, Array], count: int) -> Array:
        """Values (count) by name of a velocity, as an array (count, nv)."""
        zero, names = np.zeros(count), self._fleet.vehicle.module.VELOCITIES
        return np.stack([values.get(name, zero) for name in names], axis=1)

    def _inputs(self, actions: ArrayLike) -> Array:
        """Inputs (n, nu) that actions (n, nu) stand for; raises `UsageError`."""
        given = numpy_array("actions", actions)
        if given.shape != self.action_space.shape or not np.isfinite(given).all():
            wanted = self.action_space.shape
            raise UsageError(f"actions: finite numbers of shape {wanted}, not {printable(given)}")
        if not self._normalised:
            return given
        least, most = self._fleet.motors.least, self._fleet.motors.most
        inputs: Array = least + 0.5 * (np.clip(given, -1.0, 1.0) + 1.0) * (most - least)
        return inputs

    def _told(self, name: str, function: Measure | Ending, now: Moment) -> NDArray[Any]:
        """What a function of the user's, given as argument `name`, says of each environment (n).

        Raises `UsageError` if that is not one value for each.
        """
        with np.errstate(all="ignore"):  # A machine that has gone has gone far.
            told = np.array(function(now))
        if told.shape != (self.num_envs,):
            raise UsageError(f"{name}: an array ({self.num_envs},), not of shape {told.shape}")
        return told

    def _observed(self, now: Moment) -> Observations:
        """Observations (n, m) of where the environments are."""
        with np.errstate(all="ignore"):
            observed = self._observe(now)
        return np.clip(observed, -_FARTHEST, _FARTHEST).astype(np.float32)


def _information(ended: NDArray[np.int8], told: Flags) -> Infos:
    """Information on the environments that are told of (n): why flights could not go on."""
    infos = {"ended": np.where(told, ended, np.int8(RUNNING)), "_ended": told}
    return infos if told.any() else {}


def _rows(values: NDArray[Any], rows: Flags) -> NDArray[np.object_]:
    """Some rows, each an object, with None for the others, as Gymnasium hands out the last ones."""
    found = np.full(len(rows), None, dtype=object)
    for i in np.flatnonzero(rows):
        found[i] = values[i].copy()
    return found


def _decisions(duration: float | None, decision: float) -> float:
    """After how many decisions of so many seconds an episode is truncated.

    The number, less what rounding may have added. Raises `UsageError` if `duration` is no time.
    """
    return math.inf if duration is None else seconds("duration", duration) / decision - 1e-6


def _mode(given: AutoresetMode | str) -> AutoresetMode:
    """When an environment begins its next episode; raises `UsageError` for an unknown word."""
    try:
        return AutoresetMode(given)
    except ValueError:
        known = ", ".join(mode.value for mode in AutoresetMode)
        raise UsageError(f"autoreset_mode: one of {known}, not {printable(given)}") from None
