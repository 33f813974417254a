"""Many machines as one vector environment of Gymnasium, for learning how to fly them."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from types import ModuleType
from typing import Any, SupportsIndex, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.flight.arguments import numbers, seconds, whole
from gibbs_codegen.flight.plant.actuators import kept_commands, module_actuators
from gibbs_codegen.flight.plant.vehicle import Flags, Vehicle
from gibbs_codegen.flight.rollouts.arguments import RolloutArguments
from gibbs_codegen.flight.rollouts.rollout import array_rollout, check_settings, warn_of_long_steps
from gibbs_codegen.flight.rollouts.surroundings import rollout_surroundings
from gibbs_codegen.flight.scenario.file import AnyScenario
from gibbs_codegen.flight.scenario.walls import Wall
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import RUNNING, Array, Method, MotorModel, Precision, Problem

require("gymnasium", "VectorEnv")

import gymnasium  # noqa: E402
from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.spaces import Box  # noqa: E402
from gymnasium.utils import seeding  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402

# How far from where it is to hover a machine may get, m, and its base may turn, rad.
_FARTHEST, _STEEPEST = 3.0, 1.4
# Weight of rates in the reward, s².
_RATES = 0.1
Observations = NDArray[np.float32]
Infos = dict[str, Any]
# The possible parts of an observation.
_GREATEST_SINGLE = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class Moment:
    """The state of n environments after a decision, or at the start of an episode.

    - `time` (n): since the start of the episode, s
    - `q` (n, nq), `v` (n, nv): coordinates and velocities
    - `away` (n, nv): displacement from the coordinates that are wanted, as the module's
      `difference` tells it: m and rad, of a quaternion the rotation vector
    - `inputs` (n, nu): what is commanded, N, then N m or N of the joints; or commands of motors and
      servos, where the robot file describes actuators
    - `thrusts` (n, rotors): what the motors give, N
    - `x` (n, nx): states of the actuators that the robot file describes, if they have any
    - `base_rotation`, `base_position`: where attitude and position of the base are in `away`
    """

    time: Array
    q: Array
    v: Array
    away: Array
    inputs: Array
    thrusts: Array
    base_rotation: slice
    base_position: slice
    x: Array | None = None


Measure = Callable[[Moment], Array]
Ending = Callable[[Moment], Flags]


def nearness(now: Moment) -> Array:
    """Reward (n) of hovering: 1 at rest where the machine is wanted, less elsewhere, above 0."""
    squares = (now.away**2).sum(axis=1) + _RATES * (now.v**2).sum(axis=1)
    return 1.0 / (1.0 + squares)


def is_lost(now: Moment) -> Flags:
    """True (n) for a base that is 3 m from its desired place, or has turned by 1.4 rad."""
    far = np.linalg.norm(now.away[:, now.base_position], axis=1) > _FARTHEST
    turned = np.linalg.norm(now.away[:, now.base_rotation], axis=1) > _STEEPEST
    return far | turned


def away_and_rates(now: Moment) -> Array:
    """Observation (n, 2 nv) of hovering: the displacement, and the velocities."""
    return np.concatenate([now.away, now.v], axis=1)


class EpisodeDistributions:
    """Values by name: numbers, or distributions that they are drawn from.

    A distribution is whatever has a method `ppf` as those of `scipy.stats` have: the value that a
    share between 0 and 1 of all values is below. If it is `relative`, as `scaled` makes it, values
    are factors of those `known`. Raises `UsageError`, which calls them `what`, for a name that is
    not known, and for what is no number and no distribution.
    """

    def __init__(self, values: Mapping[str, Any], usual: Mapping[str, float], what: str) -> None:
        if not isinstance(values, Mapping):
            raise UsageError(f"{what}: values by name, not {printable(values)}")
        self.what, self.values = what, dict(values)
        self.drawn = [name for name, value in values.items() if hasattr(value, "ppf")]
        self.factors = dict.fromkeys(values, 1.0)
        for name, value in values.items():
            if name not in usual:
                raise UsageError(f"{what}: {printable(name)}: unknown; known: {', '.join(usual)}")
            if name not in self.drawn and not (isinstance(value, Real) and math.isfinite(value)):
                raise UsageError(
                    f"{what}: {name}: a finite number or a distribution, such as "
                    f"uniform(0.8, 1.2), not {printable(value)}"
                )
            if getattr(value, "relative", False):
                self.factors[name] = usual[name]
                if not usual[name]:
                    raise UsageError(f"{what}: {name}: factors of 0 are 0; give values")

    def __call__(self, shares: Array) -> dict[str, Array]:
        """Values (m) by name, of shares (m, number of drawn values) between 0 and 1.

        Raises `UsageError` if a distribution gives what is not finite.
        """
        columns, values = dict(zip(self.drawn, shares.T, strict=True)), {}
        for name, value in self.values.items():
            one = value.ppf(columns[name]) if name in columns else np.full(len(shares), value)
            values[name] = self.factors[name] * np.asarray(one, dtype=np.float64)
            if not np.all(np.isfinite(values[name])):
                raise UsageError(f"{self.what}: {name}: its distribution gives no finite number")
        return values


class VectorEnv(gymnasium.vector.VectorEnv[Observations, ArrayLike, Any]):
    """Machines of one robot that are to hover, or to do what rewards of your own ask for.

    Actions are the inputs of the robot, either as they are, in N and N m, or, `normalised`, between
    −1 for the least and 1 for the greatest. Where the robot file describes actuators, they are
    commands, and limits and lag are theirs. `parameters` (n), by name, are those of the episodes
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
        walls: What frames touch, as of `rollout`; whether steps are short enough for them is judged
            by the parameters of the file.
        surroundings, wind, payloads: What acts, as of `rollout`, by the time of each episode.
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
        walls: Sequence[Wall] = (),
        surroundings: AnyScenario | None = None,
        wind: ArrayLike | None = None,
        payloads: ArrayLike | None = None,
        reward: Measure = nearness,
        terminated: Ending = is_lost,
        observe: Measure = away_and_rates,
        normalised: bool = True,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        precision: Precision = "double",
        threads: int = 1,
    ) -> None:
        module = robot if isinstance(robot, ModuleType) else load(robot, "c")
        self.num_envs = whole("num_envs", num_envs)
        self._vehicle = vehicle = Vehicle(module)
        self._threads = whole("threads", threads)
        nq, nv = vehicle.layout.q.size, vehicle.layout.v.size
        arguments, actuators = (
            RolloutArguments(module, whole("steps", steps)),
            module_actuators(vehicle),
        )
        check_settings(steps, steps, dt, method, precision)
        warn_of_long_steps(module, dt, method, {})
        hovers = arguments.states("hover", vehicle.neutral if hover is None else hover, nq)
        # Commands: to motors and servos of the robot file, or thrusts and torques.
        self._driven = actuators.commands is not None
        if self._driven:
            motors = arguments.motors(limits, time_constants, None)
        else:
            ends = actuators.inputs if limits is None else limits
            lag = actuators.lag if time_constants is None else time_constants
            motors = arguments.motors(ends, lag, None)
        self._motors = motors = cast(MotorModel, motors)
        self._limits = np.stack([motors.least, motors.most])
        if arguments.count() != 1:
            raise UsageError("hover, time_constants: they are the same for all environments")
        [self._hover] = arguments.normalised("hover", hovers)
        # Inputs that hold a machine at rest there, or come nearest to it: motors have settled.
        force = vehicle.inverse_dynamics(self._hover, *np.zeros((2, nv)))
        inputs = np.linalg.lstsq(vehicle.input_matrix(self._hover), force, rcond=None)[0]
        x = np.zeros(0)
        if self._driven:
            inputs = np.clip(inputs, *actuators.inputs)
            inputs, x = kept_commands(vehicle, self._hover, np.zeros(nv), inputs)
        self._holding, self._resting = np.clip(inputs, *self._limits), x
        thrusts = np.tile(self._holding[: vehicle.rotors], (self.num_envs, 1))
        self._motors = replace(motors, thrusts=thrusts)
        # The surroundings of the machines, and the problem of a decision.
        hovering, varied = self._hover[np.newaxis], (wind, payloads)
        self._surrounded = rollout_surroundings(
            *(arguments, walls, surroundings, varied, (hovering, {}), (float(dt), method))
        )
        if arguments.count() not in (1, self.num_envs):
            raise UsageError(f"wind, payloads: one for all, or {self.num_envs} of them")
        self._now = Problem(
            module,
            vehicle.constants,
            np.tile(self._hover, (self.num_envs, 1)),
            np.zeros((self.num_envs, nv)),
            np.tile(self._holding, (self.num_envs, 1, 1)),
            steps=arguments.steps,
            dt=dt,
            method=method,
            every=steps,
            bounds=None if bounds is None else arguments.range("bounds", bounds, nq + nv),
            precision=precision,
            x=np.tile(x, (self.num_envs, 1)) if len(x) else None,
            around=self._surrounded.around,
            figures=self._surrounded.figures,
        )
        if strains := self._now.strains:
            self._now = replace(self._now, bristles=np.zeros((self.num_envs, strains)))
        self._decisions = np.zeros(self.num_envs, dtype=np.int64)
        self._parameters: dict[str, Array] = {}
        zero = dict.fromkeys(module.VELOCITIES, 0.0)
        self._distributions = (
            EpisodeDistributions(offsets or {}, zero, "offsets"),
            EpisodeDistributions(rates or {}, zero, "rates"),
            EpisodeDistributions(parameters or {}, module.PARAMETERS, "parameters"),
        )
        self._reward, self._terminated, self._observe = reward, terminated, observe
        # Decisions after which an episode is truncated, less what rounding may have added.
        self._most = math.inf
        if duration is not None:
            self._most = seconds("duration", duration) / (steps * dt) - 1e-6
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
        unlimited = ~np.isfinite(self._limits).all(axis=0)
        if normalised and unlimited.any():
            names = ", ".join(np.array(self._vehicle.commands)[unlimited])
            raise UsageError(
                f"limits: {names}: without limits, so that actions between -1 and 1 mean nothing; "
                "give limits=(least, most), or normalised=False"
            )
        ends = np.ones_like(self._limits) * [[-1.0], [1.0]] if normalised else self._limits
        observed = np.shape(self._observe(self._moment()))
        if len(observed) != 2 or observed[0] != self.num_envs:
            raise UsageError(f"observe: an array ({self.num_envs}, m), not of shape {observed}")
        self.single_action_space = Box(*ends.astype(np.float32))
        self.single_observation_space = Box(-np.inf, np.inf, observed[1:], np.float32)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    @property
    def parameters(self) -> dict[str, Array]:
        """Parameters (n) of the episodes that are under way, by name."""
        return {name: values.copy() for name, values in self._parameters.items()}

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
        return self._observed(self._moment()), {}

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
        ended = self._advance(self._inputs(actions))
        now = self._moment()
        rewards = self._values_of("reward", self._reward, now).astype(np.float64)
        terminations = self._values_of("terminated", self._terminated, now).astype(np.bool_)
        terminations |= ended != RUNNING
        truncations = self._decisions >= self._most
        if waiting.any():  # These begin in this step; what they were told does not count.
            self._begin(waiting)
            rewards[waiting] = 0.0
            terminations[waiting] = truncations[waiting] = False
            now = self._moment()
        infos = _information(ended, ~waiting)
        observations = self._observed(now)
        self._over = over = terminations | truncations
        if self._mode == AutoresetMode.SAME_STEP and over.any():
            infos = _information(ended, ~over)
            infos |= {"final_info": _information(ended, over), "_final_info": over.copy()}
            infos |= {"final_obs": _rows(observations, over), "_final_obs": over.copy()}
            self._begin(over)
            observations = self._observed(self._moment())
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
            made = [seeding.np_random(entry) for entry in seeds]
            self._generators, self._seeds = [g for g, _ in made], [s for _, s in made]
            return
        for i in np.flatnonzero(rows):
            if seeds[i] is not None:
                self._generators[i], self._seeds[i] = seeding.np_random(seeds[i])

    def _begin(self, rows: Flags) -> None:
        """Begin episodes in some of the environments (n)."""
        chosen = [self._generators[i] for i in np.flatnonzero(rows)]
        ends = np.cumsum([len(distributions.drawn) for distributions in self._distributions])
        shares = np.array([generator.random(ends[-1]) for generator in chosen])
        columns = np.split(shares, ends[:-1], axis=1)
        offsets, rates, parameters = (
            draw(column) for draw, column in zip(self._distributions, columns, strict=True)
        )
        now, zero, names = self._now, np.zeros(len(chosen)), self._vehicle.module.VELOCITIES
        away, v = (
            np.stack([values.get(name, zero) for name in names], axis=1)
            for values in (offsets, rates)
        )
        now.q[rows] = self._vehicle.integrate(self._hover, away)
        now.v[rows], now.inputs[rows] = v, self._holding
        self._motors.thrusts[rows] = self._holding[: self._vehicle.rotors]
        if now.x is not None:
            now.x[rows] = self._resting
        if now.bristles is not None:
            now.bristles[rows] = 0.0
        self._decisions[rows], self._over = 0, self._over & ~rows
        for name, values in parameters.items():  # The first time they are for all.
            self._parameters.setdefault(name, np.empty(self.num_envs))[rows] = values
        prepare = self._vehicle.module.prepare
        try:
            if parameters and isinstance(now.constants, np.ndarray):  # C has a row for each.
                now.constants[rows] = prepare(parameters)
            elif parameters:
                self._now = replace(now, constants=prepare(self._parameters))
        except (TypeError, ValueError) as error:
            raise UsageError(f"{self._vehicle.name}: parameters: {error}") from None

    def _advance(self, inputs: Array) -> NDArray[np.int8]:
        """Fly all through a decision of inputs (n, nu): why each has ended (n), as of `Rollout`."""
        commanded = np.clip(inputs, *self._limits)
        now, begin = replace(self._now, inputs=commanded[:, np.newaxis]), self._time()
        loads = self._surrounded.at(begin, now.steps, now.dt)
        now = replace(now, wrenches=loads.pop("wrenches", None), loads=loads)
        flown = array_rollout(replace(now, motors=self._motors), self._threads)
        last = (
            commanded[:, : self._vehicle.rotors] if flown.thrusts is None else flown.thrusts[:, -1]
        )
        self._motors = replace(self._motors, thrusts=last.copy())
        x, bristles = (
            None if part is None else part[:, -1].copy() for part in (flown.x, flown.bristles)
        )
        q, v = flown.q[:, -1].copy(), flown.v[:, -1].copy()
        self._now = replace(now, q=q, v=v, x=x, bristles=bristles)
        self._decisions += 1
        return flown.ended

    def _time(self) -> Array:
        """Lengths of episodes (n), s."""
        return self._decisions * np.float64(self._now.steps * self._now.dt)

    def _moment(self) -> Moment:
        """The state of the machines, in arrays of its own."""
        now, places, thrusts = self._now, self._vehicle.layout.v, self._motors.thrusts
        if self._driven:
            x = np.zeros((self.num_envs, 0)) if now.x is None else now.x
            state = now.q, now.v, x, now.inputs[:, 0]
            acting = self._vehicle.module.inputs_of(*state, constants=now.constants)
            thrusts = acting[:, : self._vehicle.rotors]
        return Moment(
            self._time(),
            now.q.copy(),
            now.v.copy(),
            np.asarray(self._vehicle.module.difference(self._hover, now.q)),
            now.inputs[:, 0].copy(),
            thrusts.copy(),
            places.attitude,
            places.position,
            None if now.x is None else now.x.copy(),
        )

    def _inputs(self, actions: ArrayLike) -> Array:
        """Inputs (n, nu) that actions (n, nu) stand for; raises `UsageError`."""
        least, most = self._limits
        shape = (self.num_envs, len(least))
        actions = numbers("actions", actions, f"finite numbers of shape {shape}", shape)
        if not self._normalised:
            return actions
        return least + 0.5 * (np.clip(actions, -1.0, 1.0) + 1.0) * (most - least)

    def _values_of(self, name: str, function: Measure | Ending, now: Moment) -> NDArray[Any]:
        """Values (n) of a function of the user's, given as argument `name`, for each environment.

        Raises `UsageError` if that is not one value for each.
        """
        with np.errstate(all="ignore"):  # A machine that has gone has gone far.
            values = np.array(function(now))
        if values.shape != (self.num_envs,):
            raise UsageError(f"{name}: an array ({self.num_envs},), not of shape {values.shape}")
        return values

    def _observed(self, now: Moment) -> Observations:
        """Observations (n, m) of where the environments are."""
        with np.errstate(all="ignore"):
            observed = self._observe(now)
        return np.clip(observed, -_GREATEST_SINGLE, _GREATEST_SINGLE).astype(np.float32)


def _information(ended: NDArray[np.int8], rows: Flags) -> Infos:
    """Information on the environments `rows` (n): why flights could not go on."""
    infos = {"ended": np.where(rows, ended, np.int8(RUNNING)), "_ended": rows}
    return infos if rows.any() else {}


def _rows(values: NDArray[Any], rows: Flags) -> NDArray[np.object_]:
    """Some rows, each an object, with None for the others, as Gymnasium hands out the last ones."""
    objects = np.full(len(rows), None, dtype=object)
    for i in np.flatnonzero(rows):
        objects[i] = values[i].copy()
    return objects


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """When an environment begins its next episode; raises `UsageError` for an unknown word."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        modes = ", ".join(member.value for member in AutoresetMode)
        raise UsageError(f"autoreset_mode: one of {modes}, not {printable(mode)}") from None
