"""Many machines as one vector environment of Gymnasium, for learning how to fly them."""

from __future__ import annotations

import itertools
import math
import operator
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any, SupportsIndex, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.flight.arguments import numbers, seconds, whole
from gibbs_codegen.flight.distributions import Draw, Varied, uniform
from gibbs_codegen.flight.plant.actuators import kept_commands, module_actuators
from gibbs_codegen.flight.plant.vehicle import Flags, Vehicle
from gibbs_codegen.flight.rollouts.actions import Actions
from gibbs_codegen.flight.rollouts.arguments import RolloutArguments
from gibbs_codegen.flight.rollouts.episodes import Episodes
from gibbs_codegen.flight.rollouts.rollout import array_rollout, check_settings, warn_of_long_steps
from gibbs_codegen.flight.rollouts.sensing import SENSED, Sensors
from gibbs_codegen.flight.rollouts.surroundings import rollout_surroundings
from gibbs_codegen.flight.rollouts.tasks import TASKS, Ending, Moment, Task, Values, is_lost
from gibbs_codegen.flight.scenario.file import AnyScenario
from gibbs_codegen.flight.scenario.parts import Control
from gibbs_codegen.flight.scenario.walls import Wall
from gibbs_codegen.machine.policies import commanded
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import (
    RUNNING,
    Array,
    Method,
    MotorModel,
    Precision,
    Problem,
    Steps,
    touching,
)

require("gymnasium", "VectorEnv")

import gymnasium  # noqa: E402
from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.spaces import Box  # noqa: E402
from gymnasium.utils import seeding  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402
from gymnasium.vector.utils import batch_space  # noqa: E402

Observations = NDArray[np.float32]
Infos = dict[str, Any]
_GREATEST_SINGLE = float(np.finfo(np.float32).max)
# Greatest rates of targets that swing, rad/s, and the force of a push, N, if nothing is said.
_SWINGING, _FORCE = uniform(0.3, 1.5), 5.0
# Least values of what episodes draw, by name.
_LEAST = dict.fromkeys((*SENSED, "time_constant", "strength"), 0.0) | {"force": 1e-3}
# Between targets whose differences tell rates, s: these err by its square, and by rounding.
_APART = 1e-4


class VectorEnv(gymnasium.vector.VectorEnv[Observations, ArrayLike, Any]):
    """Environments with one robot and a task, or with your own rewards.

    Actions are the inputs of the robot, in N and N m, or, if `normalised`, from −1 (least) to 1
    (greatest). Where the robot file describes actuators, they are commands, and limits and lag are
    theirs. Other actions go to an inner loop, which is evaluated at every step, and knows the robot
    as the robot file does. `parameters` (n), by name, are those of the episodes that are under way;
    `actions` are the names of an action's entries, `data` is for users.

    Args:
        robot: A generated module with the back end "c" or "numpy", or the name or path of one,
            which is loaded with the C back end.
        num_envs: How many environments there are, n.
        hover: Desired coordinates (nq); None: zero.
        offsets, rates: Displacements from there, m and rad, and velocities, m/s and rad/s, with
            which an episode begins, by names of the module's `VELOCITIES`, and of a base that
            drives "vy", a displacement to its left; zero if left out. They are numbers, or
            distributions that every episode draws from, such as `gibbs_codegen.uniform(-1, 1)` or
            those of `scipy.stats`.
        action, joints: What actions ask of the base or the tip, "inputs", "rates", "attitude",
            "velocity" or "tip", and of the joints, "position", "velocity" or "torque"; None for
            "position".
        ranges: The greatest values of entries of actions by their names, or the least and the
            greatest ones; others are those of the documentation, and of limits of joints.
        control: Frequencies of the inner loop, as a scenario has them; None for its defaults.
        task: "hover", "reach", "track" or "push".
        targets: Displacements of the target from `hover`, as `offsets`; and "force", N, of a push.
            None for those of the task.
        swings, swing_rates: Amplitudes of targets that move, as `offsets`, None for those of the
            task, and rad/s of each; they begin anywhere in their period.
        disturbances: As `offsets`, of each episode: "time_constant" of all motors, s, in the place
            of `time_constants`; "strength", a factor of the greatest thrusts; "wind_x" and the
            others, m/s, in the place of those of the surroundings; "base_x" and others of frames,
            forces on them, N, world axes.
        sensors: As `offsets`, standard deviations of observations: "position", m, "attitude",
            rad, "joints", "velocity", "angular_velocity", "joint_rates"; and "delay", s, which is
            rounded up to whole decisions.
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
            end (n), and observations (n, m); None for those of the task.
        normalised: Whether actions are between −1 and 1.
        autoreset_mode: When an environment begins its next episode.
        precision, threads: "double" or "single", and how many threads share the environments.
        tensors: Whether observations, rewards and flags are tensors of PyTorch; `infos` have none.

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
        action: str = "inputs",
        joints: str | None = None,
        ranges: Mapping[str, Any] | None = None,
        control: Control | None = None,
        task: str = "hover",
        targets: Mapping[str, Any] | None = None,
        swings: Mapping[str, Any] | None = None,
        swing_rates: Any = _SWINGING,
        disturbances: Mapping[str, Any] | None = None,
        sensors: Mapping[str, Any] | None = None,
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
        reward: Values | None = None,
        terminated: Ending = is_lost,
        observe: Values | None = None,
        normalised: bool = True,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        precision: Precision = "double",
        threads: int = 1,
        tensors: bool = False,
    ) -> None:
        module = robot if isinstance(robot, ModuleType) else load(robot, "c")
        self.num_envs = whole("num_envs", num_envs)
        self._vehicle = vehicle = Vehicle(module)
        self._threads = whole("threads", threads)
        nq, nv = vehicle.layout.q.size, vehicle.layout.v.size
        self._directions = [name for name, _ in vehicle.layout.displacements]
        self._forces = [f"{frame}_{axis}" for frame in vehicle.frames for axis in "xyz"]
        arguments = RolloutArguments(module, whole("steps", steps))
        actuators = module_actuators(vehicle)
        check_settings(steps, steps, dt, method, precision)
        warn_of_long_steps(module, dt, method, {})
        hovers = arguments.states("hover", vehicle.neutral if hover is None else hover, nq)
        # Commands: to motors and servos of the robot file, or thrusts and torques.
        self._driven = actuators.commands is not None
        if not self._driven:
            limits = tuple(actuators.inputs) if limits is None else limits
            time_constants = actuators.lag if time_constants is None else time_constants
        self._motors = motors = cast(MotorModel, arguments.motors(limits, time_constants, None))
        # Limits of all episodes, and of those that are under way.
        self._limits = self._ends = np.stack([motors.least, motors.most])
        if arguments.count() != 1:
            raise UsageError("hover, time_constants: they are the same for all environments")
        [self._hover] = arguments.normalised("hover", hovers)
        # Inputs that hold a machine at rest there, or come nearest to it: motors have settled.
        force = vehicle.needed_force(self._hover, *np.zeros((2, nv)))
        inputs = np.linalg.lstsq(vehicle.input_matrix(self._hover), force, rcond=None)[0]
        x = np.zeros(0)
        if self._driven:
            inputs = np.clip(inputs, *actuators.inputs)
            inputs, x = kept_commands(vehicle, self._hover, np.zeros(nv), inputs)
        self._holding, self._resting = np.clip(inputs, *self._limits), x
        thrusts = np.tile(self._holding[: vehicle.rotors], (self.num_envs, 1))
        self._motors = replace(motors, thrusts=thrusts)
        asked = (action, joints), self._limits, control, {} if ranges is None else ranges
        self._actions = Actions.of(vehicle, *asked, self._hover)
        self.actions = self._actions.names
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
            np.zeros((self.num_envs, 1, len(self.actions))),  # Episodes begin with others.
            steps=arguments.steps,
            dt=dt,
            method=method,
            every=steps,
            bounds=None if bounds is None else arguments.range("bounds", bounds, nq + nv),
            precision=precision,
            x=np.tile(x, (self.num_envs, 1)) if len(x) else None,
            around=self._surrounded.around,
            figures=self._surrounded.figures,
            inner=self._actions.loop,
        )
        if strains := self._now.strains:
            self._now = replace(self._now, bristles=np.zeros((self.num_envs, strains)))
        self._decisions = np.zeros(self.num_envs, dtype=np.int64)
        self._parameters: dict[str, Array] = {}
        self._target = self._now.q.copy(), self._now.v.copy(), self._now.v.copy()
        chosen_task = self._task(task)
        self._reward, self._observe = reward or chosen_task.reward, observe or chosen_task.observe
        self._terminated = terminated
        zero = dict.fromkeys(module.VELOCITIES, 0.0)
        away = dict.fromkeys(self._directions, 0.0)
        moving = self._spread(chosen_task.swing, swings=True) if swings is None else swings
        wanted = self._spread(chosen_task.spread) if targets is None else targets
        swinging = tuple(moving) if isinstance(moving, Mapping) else ()
        self._episodes = Episodes(
            self.num_envs,
            {
                "offsets": (offsets or {}, away),
                "rates": (rates or {}, zero),
                "parameters": (parameters or {}, module.PARAMETERS),
                "targets": (wanted, away | {"force": _FORCE}),
                "swings": (moving, zero),
                "swing_rates": (dict.fromkeys(swinging, swing_rates), zero),
                "phases": (dict.fromkeys(swinging, uniform(0.0, 2.0 * math.pi)), zero),
                "disturbances": (disturbances or {}, self._usual()),
                "sensors": (sensors or {}, dict.fromkeys(SENSED, 0.0)),
            },
            _LEAST,
        )
        if vehicle.layout.has_drive and swinging and {"vx", "wz"} <= {*swinging, *wanted}:
            words = "a turned target that moves ahead would slip sideways, which it cannot"
            raise UsageError(f"swings: {vehicle.name}: {words}; leave vx or wz out of them")
        sensed = self._episodes.values["sensors"]
        self._sensors = Sensors(vehicle, sensed, self.num_envs, steps * dt) if sensed else None
        self.data: dict[str, Any] = {}
        self._tensors = tensors
        if tensors:
            require("torch", "tensors=True")
        # Decisions after which an episode is truncated, less what rounding may have added.
        self._most = math.inf
        if duration is not None:
            self._most = seconds("duration", duration) / (steps * dt) - 1e-6
        self._mode, self._pushes = _mode(autoreset_mode), cast(Array | None, None)
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
        ranges = self._actions.ranges
        unlimited = ~np.isfinite(ranges).all(axis=0)
        if normalised and unlimited.any():
            names, inner = ", ".join(np.array(self.actions)[unlimited]), self._actions.loop
            raise UsageError(
                f"limits: {names}: no limits, so actions from -1 to 1 cannot be scaled; give "
                f"{'ranges by name' if inner else 'limits=(least, most)'}, or normalised=False"
            )
        ends = np.ones_like(ranges) * [[-1.0], [1.0]] if normalised else ranges
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
    def episodes(self) -> dict[str, dict[str, Array]]:
        """Values (n) that the episodes that are under way have drawn: by arguments, and by names.

        `phases`, rad, are of the swings.
        """
        return {
            part: {name: x.copy() for name, x in values.items()}
            for part, values in self._episodes.values.items()
        }

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment, which reproduces it."""
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
            UsageError: If there are not n seeds, the mask is not n flags, or parameters are wrong.
        """
        rows = np.ones(self.num_envs, dtype=np.bool_)
        if options and "reset_mask" in options:
            rows = np.asarray(options["reset_mask"])
            if rows.shape != (self.num_envs,) or rows.dtype != np.bool_ or not rows.any():
                raise UsageError(
                    f"reset_mask: must be {self.num_envs} flags, at least one of them True"
                )
        if not (self._generators or rows.all()):
            raise UsageError("reset_mask: the first reset must begin all episodes; leave it out")
        self._seed(seed, rows)
        self._begin(rows)
        [observations] = self._handed(self._observed(self._moment()))
        return observations, {}

    def step(self, actions: ArrayLike) -> tuple[Observations, Array, Flags, Flags, Infos]:
        """Take a decision in every environment.

        Args:
            actions: Actions (n, nu); those beyond their range count as at its end.

        Returns:
            Observations (n, m), rewards (n), whether episodes have terminated (n), whether they
            are truncated (n), and information: `ended` (n) says why a flight ended, as in
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
        rewards = self.rewards(now)
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
        results = self._handed(observations, rewards, terminations, truncations)
        return *results, infos

    def _handed(self, *arrays: NDArray[Any]) -> tuple[Any, ...]:
        """What callers get: arrays, or tensors in their memory."""
        if not self._tensors:
            return arrays
        import torch

        return tuple(map(torch.from_numpy, arrays))

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
        drawn = self._episodes.draw(rows, self._generators)
        now, parameters = self._now, drawn["parameters"]
        away = self._episodes.table("offsets", self._directions)[rows]
        now.q[rows] = self._vehicle.displaced(self._hover, away)
        now.v[rows] = self._episodes.table("rates", self._vehicle.module.VELOCITIES)[rows]
        now.inputs[rows] = 0.0 if self._actions.loop else self._holding
        self._motors.thrusts[rows] = self._holding[: self._vehicle.rotors]
        if now.x is not None:
            now.x[rows] = self._resting
        if now.bristles is not None:
            now.bristles[rows] = 0.0
        self._decisions[rows], self._over = 0, self._over & ~rows
        self._target = self._wanted_at(self._time())
        self._disturb()
        if self._sensors:
            self._sensors.begin(now.q, now.v, rows, self._generators)
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
        asked = inputs
        if self._actions.loop is None:
            asked = np.clip(inputs, *self._ends)
        flown = array_rollout(self._decided(asked), self._threads)
        last = asked[:, : self._vehicle.rotors] if flown.thrusts is None else flown.thrusts[:, -1]
        self._motors = replace(self._motors, thrusts=last.copy())
        series = {name: getattr(flown, name) for name in ("q", "v", "x", "bristles")}
        after = {name: part[:, -1].copy() for name, part in series.items() if part is not None}
        self._now = replace(self._now, **after, inputs=asked[:, np.newaxis])
        self._decisions += 1
        if self._episodes.values["swings"]:
            self._target = self._wanted_at(self._time())
        if self._sensors:
            self._sensors.after(self._now.q, self._now.v, ~self._over, self._generators)
        return flown.ended

    def _decided(self, asked: Array) -> Problem:
        """The problem of the next decision, of inputs or actions (n, na)."""
        now = self._now
        loads = self._surrounded.at(self._time(), now.steps, now.dt)
        wrenches = loads.pop("wrenches", None)
        if self._pushes is not None:
            wrenches = self._pushes if wrenches is None else wrenches + self._pushes
        if now.inner:
            loads |= {**self._actions.loads, "target": self._target[0][:, np.newaxis]}
        commanded = replace(now, inputs=asked[:, np.newaxis], motors=self._motors)
        return replace(commanded, wrenches=wrenches, loads=loads)

    def _task(self, name: str) -> Task:
        """The task of a name; raises `UsageError` for another, and for what it lacks."""
        if name not in [*TASKS]:
            raise UsageError(f"task: one of {', '.join(TASKS)}, not {printable(name)}")
        there = {"tip": self._vehicle.has_tip, "walls": bool(self._now.around.contacts)}
        for need in TASKS[name].needs:
            if not there[need]:
                raise UsageError(f"task: {name} needs {need}: {self._vehicle.name} has none here")
        return TASKS[name]

    def _spread(self, size: float, *, swings: bool = False) -> dict[str, Any]:
        """Distributions of displacements of position and joints by so much, m and rad.

        Joints stay within their limits. Raises `UsageError` if `hover` is beyond them.
        """
        if not size:
            return {}
        vehicle, layout = self._vehicle, self._vehicle.layout
        room = module_actuators(vehicle).joints - self._hover[vehicle.arm]
        if beyond := [*itertools.compress(vehicle.joint_names, (room * [[1], [-1]] > 0).any(0))]:
            raise UsageError(
                f"hover: {', '.join(beyond)}: outside COORDINATE_LIMITS, which the targets of a "
                "task keep; give another hover, or targets and swings"
            )
        ends = np.tile([[-size], [size]], layout.displaced.size)
        ends[:, layout.displaced.joints] = np.clip(room, -size, size)
        if swings:
            ends = np.abs(ends).min(axis=0) * [[-1.0], [1.0]]
        turns = range(layout.displaced.size)[layout.displaced.attitude]
        chosen = layout.paired if swings else range(layout.displaced.size)
        draws = {k: Draw("uniform", *ends[:, k]) for k in chosen if k not in turns}
        return {self._directions[k]: Varied(draw=draw) for k, draw in draws.items()}

    def _usual(self) -> dict[str, float]:
        """Values of disturbances if nothing is said."""
        usual = dict.fromkeys(self._forces, 0.0)
        if rotors := self._vehicle.rotors:
            if np.isfinite(self._limits[1, :rotors]).all():
                usual["strength"] = 1.0
            if not self._driven:
                usual["time_constant"] = float(np.mean(self._motors.time_constants))
        if self._surrounded.wind is not None:
            steady = np.mean(self._surrounded.wind, axis=0)
            usual |= {f"wind_{axis}": float(x) for axis, x in zip("xyz", steady, strict=True)}
        return usual

    def _disturb(self) -> None:
        """Give the machines the disturbances of their episodes."""
        values, rotors = self._episodes.values["disturbances"], self._vehicle.rotors
        if "time_constant" in values:
            lag = np.repeat(values["time_constant"][:, np.newaxis], rotors, axis=1)
            self._motors = replace(self._motors, time_constants=lag)
        if "strength" in values:
            most = np.tile(self._limits[1], (self.num_envs, 1))
            most[:, :rotors] *= values["strength"][:, np.newaxis]
            self._ends = np.stack([np.minimum(self._limits[0], most), most])
            if self._actions.loop:
                self._motors = replace(self._motors, least=self._ends[0], most=self._ends[1])
        winds = ["wind_x", "wind_y", "wind_z"]
        if values.keys() & {*winds}:
            steady = np.broadcast_to(self._surrounded.wind, (self.num_envs, 3))
            wind = np.column_stack([values.get(x, steady[:, k]) for k, x in enumerate(winds)])
            self._surrounded = replace(self._surrounded, wind=wind)
        if values.keys() & {*self._forces}:
            pushes = np.zeros((self.num_envs, 1, len(self._vehicle.frames), 6))
            table = self._episodes.table("disturbances", self._forces)
            pushes[:, 0, :, :3] = table.reshape(self.num_envs, -1, 3)
            self._pushes = pushes

    def _wanted_at(self, time: Array) -> tuple[Array, Array, Array]:
        """Coordinates that are wanted at times (…, n), velocities and accelerations with them."""
        middle, size, rate, phase = (
            self._episodes.table(part, self._directions)
            for part in ("targets", "swings", "swing_rates", "phases")
        )

        def at(h: float) -> Array:
            angle = rate * (time + h)[..., np.newaxis] + phase
            return self._vehicle.displaced(self._hover, middle + size * np.sin(angle))

        q, v, a = at(0.0), *np.zeros((2, *time.shape, self._now.v.shape[1]))
        if self._episodes.values["swings"]:
            back, on = (self._vehicle.module.difference(q, at(h)) for h in (-_APART, _APART))
            v, a = (on - back) / (2.0 * _APART), (on + back) / _APART**2
        return q, v, a

    def _time(self) -> Array:
        """Lengths of episodes (n), s."""
        return self._decisions * np.float64(self._now.steps * self._now.dt)

    @property
    def now(self) -> Moment:
        """The moment: where the machines are, in arrays of its own, without noise and delay."""
        return self._moment()

    def rewards(self, now: Moment) -> Array:
        """Rewards of a moment.

        Args:
            now: The moment, such as `now` of the environments.

        Returns:
            Rewards (n).

        Raises:
            UsageError: If the function for them does not give one for each environment.
        """
        return self._values_of("reward", self._reward, now).astype(np.float64)

    def _moment(self) -> Moment:
        now, places, thrusts = self._now, self._vehicle.layout.displaced, self._motors.thrusts
        (target, target_v, _), module = self._target, self._vehicle.module
        if self._driven:
            x = np.zeros((self.num_envs, 0)) if now.x is None else now.x
            command = now.inputs[:, 0]
            if now.inner:
                command = Steps(self._decided(command), np).commanded()
            acting = module.inputs_of(now.q, now.v, x, command, constants=now.constants)
            thrusts = acting[:, : self._vehicle.rotors]
        touch = np.zeros((self.num_envs, 3))
        if now.around.contacts and self._vehicle.has_tip:
            touch = touching(now)[:, self._vehicle.frames.index("tip"), :3]
        return Moment(
            self._time(),
            now.q.copy(),
            now.v.copy(),
            self._vehicle.displacement(target, now.q),
            now.inputs[:, 0].copy(),
            thrusts.copy(),
            places.attitude,
            places.position,
            None if now.x is None else now.x.copy(),
            target,
            target_v,
            touch,
            self._episodes.values["targets"].get("force", np.full(self.num_envs, _FORCE)).copy(),
            self.data,
            self._vehicle.tip_pose if self._vehicle.has_tip else None,
        )

    def _inputs(self, actions: ArrayLike) -> Array:
        """Inputs (n, nu) that actions (n, nu) stand for; raises `UsageError`."""
        shape = (self.num_envs, len(self.actions))
        if self._tensors:
            actions = np.asarray(getattr(actions, "detach", lambda: actions)())
        actions = numbers("actions", actions, f"finite numbers of shape {shape}", shape)
        return commanded(actions, self._actions.ranges, np.clip, normalised=self._normalised)

    def _values_of(self, name: str, function: Values | Ending, now: Moment) -> NDArray[Any]:
        """Values (n) of a function of the user's, given as argument `name`, for each environment.

        Raises `UsageError` if that is not one value for each.
        """
        with np.errstate(all="ignore"):  # A machine that has gone has gone far.
            values = np.array(function(now))
        if values.shape != (self.num_envs,):
            raise UsageError(f"{name}: an array ({self.num_envs},), not of shape {values.shape}")
        return values

    def _observed(self, now: Moment) -> Observations:
        """Observations (n, m) of where the environments are, as sensors tell it."""
        with np.errstate(all="ignore"):
            if self._sensors:
                q, v = self._sensors.read()
                now = replace(now, q=q, v=v, away=self._vehicle.displacement(now.target, q))
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
