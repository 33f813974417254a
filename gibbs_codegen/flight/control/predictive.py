"""Predictive control: at every instant the best plan over a horizon, of which the begin is flown.

One real-time iteration an instant: the plan of the instant before, moved on, is linearised before
the state is known, and when it is, one quadratic program with all limits gives the next plan. All
of it is C (`runtime/predictive`), which allocates nothing.

The prediction takes velocities by Euler's steps, and coordinates by the mean of those before and
after. Dampers would make them unstable where links are light; so they take the dampers' torques at
their end, which is the step of a robot whose joints have an armature that is larger by step times
damping:

    M (v⁺ − v) / h = R − D v⁺ + B u    is    (M + h D) (v⁺ − v) / h = R − D v + B u

A machine that looks no further than its horizon may lean a little more at every step. So the end of
the plan costs what a linear-quadratic regulator would need from there, about a hover that moves
along with the path.
"""

from __future__ import annotations

import math
import os
import pathlib
import time as clock
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from numbers import Real
from types import ModuleType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gibbs_codegen.arrays.contents import externals_of, functions_of, owners_of
from gibbs_codegen.arrays.evaluation import evaluate
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program, constant, variable
from gibbs_codegen.errors import (
    GibbsCodegenError,
    MissingFunctionError,
    UsageError,
    printable,
)
from gibbs_codegen.flight.arguments import numbers, numpy_array, real
from gibbs_codegen.flight.control.laws import Controller
from gibbs_codegen.flight.control.observation import Observation
from gibbs_codegen.flight.plant.actuators import (
    Actuators,
    actuators_of,
    commands_for,
    followed,
    has_servo,
    holds,
    module_actuators,
)
from gibbs_codegen.flight.plant.environment import Environment, surrounding
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.scenario.file import AnyScenario
from gibbs_codegen.flight.scenario.parts import WORLD, Force, Impedance
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.scenario.walls import Wall, surface_at
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.interface.choice import options_with
from gibbs_codegen.machine.laws import push_shares
from gibbs_codegen.machine.machine import Surroundings
from gibbs_codegen.machine.predictive import Horizon
from gibbs_codegen.machine.transition import steadied
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.predictive import (
    DERIVATIVES,
    UNDER_WRENCHES,
    WITH_PAYLOADS,
    CompiledPredictive,
    LimitRow,
    Transcription,
)

# Positions (n, 3), m, or rotations (n, 3, 3), world axes, at times (n), s.
Path = Callable[[Array], Array]
# Steps that the regulator goes on for. Without an end, the cost of a motion that no input reaches
# might not be finite.
_STEPS = 500
# How far a point may be off its path before it is led there step by step, in tolerances.
_FARTHEST = 5.0
# Change of velocity, m/s, that within a step is a jump of the path, beside so many steps around it.
_JUMP, _AROUND = 4.0, 5
# Steps to a posture that has frames where they are led; how much less than turn bases lean there.
_FITS, _LEAN = 3, 0.1
# How far the product of a rotation with its transpose may be off 1.
_ROTATION = 1e-6
# Longest step, s, without a warning.
_LONG = 0.05
# A trace of an input, N or N m; limits that there are not; mean products of price and slack at the
# begin and the end.
_TRACE, _NONE, _BARRIER, _TOLERANCE = 1e-6, 1e30, 1e-2, 1e-6
# An input, N or N m, that costs as much as others do of usual size, where it should not be there.
_LITTLE = 1e-2
# Time constants, s, of what follows no command: of the charge of a battery.
_ENDLESS = (1e4, 1e4)
# Tolerances of which there may be one a joint.
_BY_JOINT = ("joints", "joint_rates", "effort")
# The cost per step of a state that is out of its limits by its tolerance.
_EXCESS = 100.0


class Hover(Protocol):
    """A state at rest and the inputs that hold it, as `trim` returns."""

    @property
    def q(self) -> Array:
        """Coordinates (nq)."""

    @property
    def u(self) -> Array:
        """Inputs (nu), N and N m."""


@dataclass(frozen=True)
class Tolerances:
    """Deviations that count alike: the cost is the sum of the squares of their shares.

    - `point`, m, and `orientation`, rad: of frames that are led
    - `position`, m, of the base, None if it is where points need it; `attitude`, rad; `joints`, rad
      or m, one or one a joint: off the posture
    - `velocity`, m/s, `angular_velocity`, rad/s, `joint_rates`, rad/s or m/s, one or one a joint
    - `thrust`, N, and `effort`, N m or N, one or one a joint and then a wheel: off those of hover
    - `change`: share of these by which inputs may change from step to step, None if free
    """

    point: float = 0.002
    orientation: float = 0.02
    position: float | None = None
    attitude: float = 0.3
    joints: float | Sequence[float] = 0.3
    velocity: float = 0.5
    angular_velocity: float = 1.0
    joint_rates: float | Sequence[float] = 1.0
    thrust: float | None = None
    effort: float | Sequence[float] | None = None
    change: float | None = None

    def __post_init__(self) -> None:
        for setting in fields(self):
            if (value := getattr(self, setting.name)) is None and setting.default is None:
                continue
            many = setting.name in _BY_JOINT
            tolerance = numpy_array(f"tolerances: {setting.name}", value)
            if tolerance.ndim > many or not np.all((tolerance > 0.0) & (tolerance < np.inf)):
                raise UsageError(
                    f"tolerances: {setting.name} must be a finite number above 0"
                    f"{', or one a joint' * many}, not {printable(str(value), 100)}"
                )


class Instant(NamedTuple):
    """One instant of the controller: its time, s, and seconds of preparation and of feedback.

    `solved` is true for a new plan, with `iterations` of the interior-point method and
    the `share` of the step that was taken; `cost` is that of the plan, `gaps` what it is not yet.
    """

    time: float
    preparation: float
    feedback: float
    solved: bool
    iterations: int
    share: float
    cost: float
    gaps: float


class NoPlanError(GibbsCodegenError):
    """No plan yet, or none for as long as the last one reaches: the machine is lost."""

    exit_code = 1


@dataclass
class Predictive:
    """A controller that leads frames of a machine along paths, within limits.

    It is a controller for `simulate` and `Simulation`: called with an `Observation`, it returns
    inputs. It ignores the motion of the scenario.

    Args:
        module: The robot's module, with the C back end and derivatives.
        hover: State and inputs at rest, about which it plans, such as a `Trim`.
        points: Positions (n, 3), m, at times (n), s, of frames by name.
        orientations: Rotations (n, 3, 3), frame to world, at times (n), s, of frames by name.
        posture: Coordinates (n, nq) at times (n), s; if None those of hover, moved with the first
            point, and turned and bent as the other frames need.
        feedforward: Reference inputs (n, nu) at times (n), s, whose deviations cost; those of hover
            if None.
        parameters: Parameters of the predicted robot, as `prepare` takes them.
        step: Length of the first step, s, and time between plans.
        nodes: Number of steps in the horizon.
        growth: Ratio of the lengths of a step and of the step before.
        tolerances: Deviations that cost the same.
        actuators: Limits and lag, from a `Scenario`; those of the robot file if None.
        rates: Greatest rates of inputs, N/s and N m/s, one or (nu); None: no limits.
        iterations: Number of linearisations and solutions at an instant.
        farthest: Beyond this distance from a path, m, the target is a point this far ahead, which
            moves to the path at the velocity tolerance; five times the tolerance of a point if
            None. With more, machines that lean may tumble. It does not act on `cost`.
        delay: Delay of the inputs, s, at most a step, which it compensates. If None it compensates
            no delay, not even a scenario's `control.delay`.
        deadline: If computing a plan takes longer, s, the plan acts from the next instant on, and
            until then the last one does. If None the flight waits.
        method: Method of the prediction: "rk4", or "trapezoidal", which stays stable with dampers;
            if None "rk4" if no joint has a damper, else "trapezoidal".
        walls: Walls that frames may touch, from a `Scenario`: a frame whose path leads into one
            presses.
        surroundings: A scenario, or its name or path, whose wind, payloads, push and walls are
            predicted, and spinning rotors: each as at the instant of planning.
        cost: A program whose one output is a vector; half its square is added to the cost of every
            node. Its inputs may be q, v and u of a node, as `Functions(module)` makes them, `time`,
            s, and `signals`. At the last node u is that of hover, or `feedforward`.
        signals: Further inputs of `cost` by name: values (n, …) at times (n), s.

    Raises:
        UsageError: If an argument is wrong.
        MissingFunctionError: If the module was generated without a derivative.
        CompilerError: If there is no working compiler.
    """

    module: ModuleType
    hover: Hover
    points: Mapping[str, Path] = field(default_factory=dict)
    orientations: Mapping[str, Path] = field(default_factory=dict)
    posture: Path | None = None
    feedforward: Path | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    step: float = 0.02
    nodes: int = 20
    growth: float = 1.0
    tolerances: Tolerances = field(default_factory=Tolerances)
    actuators: Actuators | Scenario | None = None
    rates: float | Array | None = None
    iterations: int = 1
    farthest: float | None = None
    delay: float | None = None
    deadline: float | None = None
    method: str | None = None
    walls: Sequence[Wall] = ()
    surroundings: AnyScenario | None = None
    cost: Program | None = None
    signals: Mapping[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_kinds()
        farthest = self.farthest
        self._farthest = _FARTHEST * self.tolerances.point if farthest is None else farthest
        vehicle = Vehicle(self.module, self.parameters or None)
        self.vehicle = vehicle
        vehicle.check_wheels()
        around, self._acting = self._around()
        self._check(around)
        served = _served(vehicle)
        pulled = bool(np.any(vehicle.damping)) or bool(served)
        self._method = self.method or ("trapezoidal" if pulled else "rk4")
        own_limits = self.actuators or module_actuators(vehicle)
        if isinstance(own_limits, Scenario):
            own_limits = actuators_of(vehicle, own_limits)
        self._limits = own_limits
        # Bounds of commands, where motors and servos are sent such.
        self._bounds = self._limits.sent
        if self._method == "trapezoidal" and self.growth != 1.0 and pulled:
            raise UsageError(
                "predictive: growth must be 1 for a machine with dampers or servos, not "
                f"{self.growth:g}; the model of their torques needs equal steps"
            )
        robot = Functions(self.module)
        lengths = self.step * self.growth ** np.arange(self.nodes)
        # Times of nodes after the state at which a plan begins, s, and of one more: speeds are from
        # node to node, since over less, a path that jumps would have any.
        self._ahead = np.concatenate([[0.0], np.cumsum(np.append(lengths, lengths[-1]))])
        self._lengths = np.diff(self._ahead)[:, np.newaxis]
        self._rates = _rates_of_steps(self._lengths[:, 0])
        self._lag = self._limits.lag
        self._inputs = self._sent(self.hover.q, self.hover.u)
        self.horizon = Horizon(
            robot,
            tuple(vehicle.smooth_place(name, "predictive") for name in self.points),
            tuple(vehicle.smooth_place(name, "predictive") for name in self.orientations),
            self._method,
            bool(np.any(self._lag)),
            self.rates is not None or self.tolerances.change is not None,
            self._carries,
            served,
            around,
            tuple((name, np.shape(x)) for name, x in self._figures(0.0).items()),
            self.cost,
        )
        rows, limits = self._rows()
        transcription = Transcription(self.horizon, self.nodes, tuple(rows))
        constants = self._constants(0.0 if self._method == "rk4" else float(lengths[-1]))
        self._compiled = CompiledPredictive(self.module, transcription, constants)
        arrays = self._compiled.arrays
        for name, values in limits.items():
            arrays[name][:] = values
        arrays["h"][:] = lengths
        self._surround(0.0)
        self._settled, times = self._motors()
        arrays["settled"][: self.horizon.motors] = self._settled
        arrays["lag_times"][: len(times)] = times
        weights = self._weights()
        arrays["weights"][:] = np.concatenate([weights[name] for name in self.horizon.weight_sizes])
        # Beside those of coordinates: of inputs, velocities, thrusts and inputs before.
        changes, pushing = weights["changes"], self.horizon.pushing
        across, nd, motion = arrays["across"], robot.space.displacements, self.horizon.motion
        across[:, :motion] = -weights["inputs"][:, np.newaxis] * pushing
        across[:, across.shape[1] - len(changes) :] = (
            -np.eye(*across[:, : len(changes)].shape) * changes
        )
        by_u = weights["inputs"] + (changes if len(changes) else 0.0)
        by_v = weights["velocities"] + weights["inputs"] @ pushing[:, nd:]
        nothing = np.zeros(nd), np.zeros(self.horizon.motors)
        arrays["diagonal"][:] = np.r_[by_u, nothing[0], by_v, nothing[1], changes]
        arrays["barrier"][()], arrays["tolerance"][()] = _BARRIER, _TOLERANCE
        arrays["rounds"][()], arrays["delay"][()] = self.iterations, self.delay or 0.0
        self._check_paths()
        arrays["hover"][:] = self._hovering()
        self._first_point = self._position(self.hover.q)
        self._pushes = bool(self.horizon.pushing.any())
        ends = robot.space.coordinates, robot.space.velocities, robot.inputs
        self._wishes = np.split(arrays["reference"], np.cumsum(ends[::-1])[::-1] * -1, axis=1)
        # Velocities of a base that moves along its coordinates, as it is in hover.
        moved = self.hover.q + np.eye(len(self.hover.q))[vehicle.layout.q.position]
        self._ways = vehicle.difference(self.hover.q, moved)
        arrays["ahead"][:] = self._ahead_costs(constants, weights)
        # Costs after the horizon, by displacements and velocities in the base's frame.
        to_base = np.linalg.inv(self._in_base(self.hover.q))
        costs = arrays["ahead"][: motion**2].reshape(motion, motion)
        self._costs_in_base = to_base.T @ costs @ to_base
        self.log: list[Instant] = []
        self.reset()

    @property
    def rate(self) -> float:
        """Rate of its plans, Hz."""
        return 1.0 / self.step

    @property
    def plan(self) -> tuple[Array, Array]:
        """What was planned from the next call on, copied: q (n, nq), and u (n − 1, nu) between.

        The first q is that of the next call plus `delay`, row k + 1 is `step` · `growth` ** k after
        row k, and u[k] acts between. n is `nodes`, less one for each call since that found no plan.
        Raises `NoPlanError` before a first plan, and once it has ended.
        """
        arrays = self._compiled.arrays
        left = self.nodes - int(arrays["failures"])
        if not 0 < left <= self.nodes:
            raise NoPlanError(f"{self.vehicle.name}: it has no plan yet, or none any more")
        return arrays["x"][:left, : self.hover.q.size].copy(), arrays["u"][: left - 1].copy()

    def __reduce__(self) -> tuple[Any, ...]:
        # The module finds the compiled library again, in other processes too.
        options = {setting.name: getattr(self, setting.name) for setting in fields(self)}
        return _again, (os.path.abspath(self.module.__path__[0]), options | {"module": None})

    def reset(self) -> None:
        """Forget the plan and the log, before a flight."""
        self.log.clear()
        self._compiled.reset()

    def __call__(self, seen: Observation) -> Array:
        """Inputs u (nu), N and N m, of the step that begins at an observation; see `inputs`."""
        if not isinstance(seen, Observation):
            raise UsageError(
                f"predictive: is called with an `Observation`, not {type(seen).__name__}"
            )
        return self.inputs(seen.time, seen.q, seen.v)

    def inputs(self, time: float, q: Array, v: Array) -> Array:
        """Inputs u (nu) of the step that begins at a time, s, and a state.

        Args:
            time: s.
            q: Coordinates (nq).
            v: Velocities (nv).

        Returns:
            The inputs, N and N m, within their limits.

        Raises:
            UsageError: If the time is not finite, or q or v have other shapes.
            NoPlanError: If no plan was found for a whole horizon.
        """
        time = float(numbers("predictive.inputs: time", time, "a finite time, s", ()))
        names, shapes = ("q", "v"), (self.vehicle.neutral.shape, (self.vehicle.layout.v.size,))
        q, v = (
            real(f"predictive.inputs: {name}", x, f"numbers of shape {shape}", shape)
            for name, x, shape in zip(names, (q, v), shapes, strict=True)
        )
        begin, compiled = clock.perf_counter(), self._compiled
        arrays = compiled.arrays
        is_first = arrays["failures"] < 0.0
        expected = q if is_first else arrays["x"][0, : len(q)]
        self._surround(time)
        self._refer(time + (self.delay or 0.0), expected)
        compiled.prepare()
        prepared = clock.perf_counter()
        planned = arrays["u"][0].copy()
        solved, u = compiled.feedback(np.concatenate([q, v]))
        seconds = clock.perf_counter() - prepared
        plan = {name: float(arrays[name]) for name in ("share", "cost", "gaps")}
        # Before a first plan they are counted downwards from -1.
        failures = arrays["failures"] if arrays["failures"] >= 0.0 else -1.0 - arrays["failures"]
        if failures >= self.nodes:
            raise NoPlanError(
                f"{self.vehicle.name}: at t = {time:.6g} s no plan was found for {self.nodes} "
                f"instants, {self.nodes * self.step:.3g} s; control is lost, or the task exceeds "
                f"the limits{'' if np.all(np.isfinite([*q, *v])) else '; its state is not finite'}"
            )
        following = clock.perf_counter()
        compiled.shift()
        preparation = prepared - begin + clock.perf_counter() - following
        self.log.append(
            Instant(time, preparation, seconds, solved, int(arrays["iterations"]), **plan)
        )
        if self.deadline is not None and preparation + seconds > self.deadline and not is_first:
            u = np.clip(planned, *self._bounds)
            if self.rates is not None:
                change = np.asarray(self.rates) * self.step
                u = np.clip(u, arrays["acting"] - change, arrays["acting"] + change)
        compiled.act(u)
        return u

    def write_c(self, folder: str | os.PathLike[str]) -> list[pathlib.Path]:
        """Write the controller as C for a companion computer, with all of its arguments.

        It is compiled with the module's `<robot>.c`, and needs no memory but a variable of the type
        `<robot>_predictive`. Paths are not in it: `<robot>_predictive_step` is given a state and
        what the nodes are to be.

        Args:
            folder: Folder for the two files, not a module's; created if missing. Give the folder of
                the module to the compiler with -I.

        Returns:
            Paths of `<robot>_predictive.h` and `.c`.

        Raises:
            OutputError: If the files cannot be written.
            UsageError: If the folder is not a path.
        """
        if not isinstance(folder, str | os.PathLike):
            raise UsageError(f"predictive.write_c: folder must be a path, not {folder!r}")
        self._turn_costs(self.hover.q)
        return self._compiled.write_c(pathlib.Path(folder))

    # The machine.

    def _check_kinds(self) -> None:
        """Raise `UsageError` for arguments of other kinds than they must be."""
        robot = self.module if hasattr(self.module, "COORDINATES") else None
        paths = 'functions of times by names of frames, such as {"tip": path}'
        kinds: dict[str, tuple[Any, str]] = {
            "module": (ModuleType, 'a module, as load(folder, backend="c") returns'),
            **dict.fromkeys(("points", "orientations"), (Mapping, paths)),
            "signals": (Mapping, 'functions of times by names of inputs, such as {"ball": path}'),
            "cost": (Program | None, "a `Program`, as gibbs_codegen.arrays has them"),
            **dict.fromkeys(("posture", "feedforward"), (Callable | None, "a function of times")),
            "parameters": (Mapping, 'numbers by names of parameters, such as {"gravity": 3.7}'),
            "tolerances": (Tolerances, "`Tolerances`"),
            "walls": (Sequence, "a list of walls"),
            "actuators": (Actuators | Scenario | None, "a `Scenario` that has them"),
            **dict.fromkeys(("step", "nodes", "growth", "iterations"), (Real, "a number")),
            **dict.fromkeys(("farthest", "delay", "deadline"), (Real | None, "a number")),
        }
        faults = [
            (x, words)
            for x, (kind, words) in kinds.items()
            if not isinstance(robot if x == "module" else getattr(self, x), kind)
        ]
        parts = (self.points, self.orientations, self.signals)
        led = [] if faults else [pair for part in parts for pair in part.items()]
        if any(not isinstance(x, str) or not callable(path) for x, path in led):
            faults = [("points, orientations and signals", paths)]
        if not faults and not all(isinstance(wall, Wall) for wall in self.walls):
            faults = [("walls", "walls, as `read_scenario(…).walls` has them")]
        for name, words in faults:
            raise UsageError(f"predictive: {name} must be {words}")
        for name, size in (("q", len(self.module.COORDINATES)), ("u", len(self.module.INPUTS))):
            words = f"{size} finite numbers; hover is a state at rest, as `trim` returns"
            numbers(f"predictive: hover.{name}", getattr(self.hover, name, np.nan), words, (size,))

    def _check_paths(self) -> None:
        """Raise `UsageError` if a path is not what it must be, now and a step later."""
        paths: list[tuple[str, Any, tuple[int, ...]]] = [
            *((f"points[{x!r}]", path, (3,)) for x, path in self.points.items()),
            *((f"orientations[{x!r}]", path, (3, 3)) for x, path in self.orientations.items()),
            ("posture", self.posture, (len(self.hover.q),)),
            ("feedforward", self.feedforward, (len(self.hover.u),)),
            *(
                (f"signals[{x!r}]", path, self.horizon.signals[x])
                for x, path in self.signals.items()
            ),
        ]
        for name, path, shape in paths:
            if path is None:
                continue
            words = ", ".join(map(str, ("n", *shape)))
            words = f"a function that returns finite numbers ({words}) at times (n)"
            values = numbers(f"predictive: {name}", path(self._ahead[:2]), words, (2, *shape))
            if shape == (3, 3):
                off = np.abs(values @ values.swapaxes(1, 2) - np.eye(3)).max()
                if not (off < _ROTATION and np.all(np.linalg.det(values) > 0.0)):
                    raise UsageError(
                        f"predictive: {name}: must be rotation matrices (n, 3, 3) at times (n); at "
                        f"two times they are {printable(str(values.tolist()), 100)}"
                    )

    def _around(self) -> tuple[Surroundings, dict[str, Array]]:
        """Surroundings, with the frames on which they may act, and the figures of all of it."""
        vehicle = self.vehicle
        around = surrounding(vehicle, self.surroundings, vehicle.smooth_place)
        around = around or Environment(vehicle)
        if around.hold:
            raise UsageError("surroundings: predictions do not support holds; leave them out")
        for wall in self.walls:
            for frame in wall.frames:
                vehicle.smooth_place(frame, "predictive")
        # A payload without a mass has no figure.
        carried = tuple(load for load in around.payload if load.mass > 0.0)
        self._environment = replace(around.with_walls(self.walls), payload=carried)
        return self._environment.under(around.push is not None, True, False)

    def _figures(self, time: float) -> dict[str, Array]:
        """Figures of what acts at a time, s."""
        figures, environment = dict(self._acting), self._environment
        if "push" in figures:
            figures["push"] = figures["push"] * environment.push_acts(time)
        if "payloads" in figures:
            figures["payloads"] = figures["payloads"] * environment.carries(time)
        return {"time": np.array(time), **figures} if figures else figures

    def _surround(self, time: float) -> None:
        """Let what acts be as it is at a time, s."""
        if figures := [np.ravel(figure) for figure in self._figures(time).values()]:
            self._compiled.arrays["around"][:] = np.concatenate(figures)

    def _check(self, around: Surroundings) -> None:
        """Raise `UsageError` for what is not what it must be."""
        if getattr(self.module, "backend", "numpy") != "c":
            raise UsageError(
                f"{self.module.NAME}: a predictive controller calls C; load the module with "
                'backend="c", where there is a C compiler'
            )
        if loops := ", ".join(getattr(self.module, "LOOPS", ())):
            raise UsageError(
                f"{self.module.NAME}: predictions do not support loops ({loops}); use another law"
            )
        robot = Functions(self.module)
        has, under = [*robot.signatures], UNDER_WRENCHES if around.acts or robot.air else ()
        needed = [
            name
            for name in (*DERIVATIVES, *(WITH_PAYLOADS if around.payloads else under))
            if all(getattr(self.module, need, ()) for need in FUNCTIONS[name].needs)
        ]
        if lacks := [name for name in needed if name not in has]:
            raise MissingFunctionError(self.module.NAME, lacks, options_with(lacks, has))
        self._check_cost(robot)
        for name in _BY_JOINT:
            count = self._count(name)
            joints, wheels = len(robot.layout.q.joint_places), robot.layout.q.wheels
            words = f"{joints} joints" + f" and {wheels} wheels" * bool(wheels and name == "effort")
            if np.shape(getattr(self.tolerances, name)) not in ((), (count,)):
                raise UsageError(
                    f"tolerances: {name} must be one number, or one for each of the {words} of "
                    f"{self.module.NAME}, not {np.size(getattr(self.tolerances, name))}"
                )
        wanted = {
            "step": (self.step, 0.0 < self.step < np.inf, "a finite time above 0, s"),
            "nodes": (self.nodes, self.nodes in range(1, 501), "1 to 500 steps"),
            "growth": (self.growth, 1.0 <= self.growth <= 2.0, "1 to 2"),
            "iterations": (self.iterations, self.iterations in range(1, 101), "1 to 100"),
            "farthest": (self._farthest, self._farthest > 0.0, "a distance above 0, m"),
            "delay": (self.delay, 0.0 <= (self.delay or 0.0) <= self.step, "0 to a step, s"),
            "deadline": (self.deadline, (self.deadline or 0.0) >= 0.0, "a time of 0 or more, s"),
        }
        for name, (value, is_right, words) in wanted.items():
            if not is_right:
                raise UsageError(f"predictive: {name} must be {words}, not {value}")
        if self.rates is not None:
            words, count = "above 0, one or as many as inputs", len(self.module.INPUTS)
            if not np.all(real("predictive: rates", self.rates, words, (), (count,)) > 0.0):
                raise UsageError(f"predictive: rates must be {words}, not {self.rates}")
        if self.step > _LONG:
            warnings.warn(
                f"predictive: a step of {self.step:g} s is long: motors and joints may deviate "
                f"from the plan between instants; give {_LONG:g} s or less",
                stacklevel=4,
            )
        if self.method not in (None, "trapezoidal", "rk4"):
            raise UsageError(
                'predictive: method must be "trapezoidal" or "rk4", not '
                f"{printable(str(self.method))}"
            )

    def _check_cost(self, robot: Functions) -> None:
        """Raise `UsageError` for a cost that is not one of the nodes of this machine."""
        unmatched, cost, name = {*self.signals}, self.cost, robot.name
        if cost is not None:
            nodes = (*robot.state(), variable("u", robot.inputs), variable("time"))
            variables = dict(zip(("q", "v", "u", "time"), nodes, strict=True))
            inputs = [*zip(cost.names, cost.inputs, strict=True)]
            pairs = [(x, variables[key]) for key, x in inputs if key in variables]
            modules = {*owners_of(cost), *(module for module, _ in functions_of(cost))}
            is_vector = [(len(x.shape), x.space) for x in cost.outputs.values()] == [(1, None)]
            for is_right, words in (
                (is_vector, "have one output, a vector"),
                (({*variables} - {"time"}) & {*cost.names}, "have q, v or u among its inputs"),
                (
                    all((x.shape, x.space) == (y.shape, y.space) for x, y in pairs),
                    f"have q, v and u as `Functions` of {name} makes them, and a number time",
                ),
                (not any(x.is_uniform for _, x in inputs), "have no uniform inputs"),
                (modules <= {robot.owner, name}, f"call functions of {name} alone"),
                (not externals_of(cost), "call nothing written by hand"),
            ):
                if not is_right:
                    raise UsageError(f"predictive: cost: {cost.name} must {words}")
            unmatched ^= {*cost.names} - {*variables}
        if unmatched:
            raise UsageError(
                "predictive: signals must have one function of times for each input of the cost "
                f"except q, v, u and time; it differs by {', '.join(sorted(unmatched))}"
            )

    @cached_property
    def _carries(self) -> bool:
        """True if the base is where the first point needs it."""
        free = self.posture is None and self.tolerances.position is None
        return bool(self.points) and free and self.vehicle.layout.moves_freely

    def _constants(self, h: float) -> Any:
        """Constants of the machine that is predicted: dampers act at ends of steps, if h > 0."""
        changed = dict[str, Any](self.parameters)
        values = {**self.module.PARAMETERS, **changed}
        for name, (factor, least, shares) in steadied(self.module, h).items():
            kept = np.maximum(factor * np.asarray(values[name]), least)
            changed[name] = kept + sum(share * np.asarray(values[x]) for x, share in shares.items())
        return self.module.prepare(changed)

    def _sent(self, q: Array, u: Array) -> Array:
        """Values to send for inputs (…, nu) that hold coordinates: themselves, or commands."""
        if not self.vehicle.is_driven:
            return u
        still = np.zeros((*np.shape(q)[:-1], self.vehicle.layout.v.size))
        return np.clip(self.vehicle.command_of(q, still, u), *self._bounds)

    def _motors(self) -> tuple[Array, Array]:
        """The state of motors in hover, and their time constants, s."""
        vehicle, count = self.vehicle, self.horizon.motors
        if not vehicle.actuator_states:
            return self._inputs[:count], self._lag[:count]
        times = vehicle.description("ACTUATOR_TIMES")
        pairs = [times.get(name, _ENDLESS) for name in self._commands_of_states]
        return vehicle.actuator_state_of(self._inputs), np.transpose(pairs).ravel()

    @property
    def _commands_of_states(self) -> list[str]:
        """The command that each state of the actuators follows; none for the charge."""
        return [followed(x, self.vehicle.commands) for x in self.vehicle.actuator_states]

    @property
    def _followed(self) -> Array:
        """A matrix with 1 where states of motors (rows) follow inputs (columns)."""
        if not self.vehicle.actuator_states:
            return np.eye(self.horizon.motors, len(self._inputs))
        commands = np.array(self.vehicle.commands)
        return np.array([commands == name for name in self._commands_of_states], np.float64)

    def _rows(self) -> tuple[list[LimitRow], dict[str, Array]]:
        """Limited quantities: inputs, joints and their rates, and how fast inputs change."""
        robot, limits = self.horizon.robot, self._limits
        nu, n, nv = robot.inputs, robot.space.coordinates, robot.space.velocities
        joint_places, rates = robot.layout.q.joints, robot.layout.v.joints
        nd, moved = robot.space.displacements, robot.layout.displaced.joints
        joints = rates.stop - rates.start
        # Inputs of one value, as of joints that nothing drives, keep a trace of room.
        traces = _TRACE * (np.ptp(self._bounds, axis=0) == 0.0)
        bounds = self._bounds + np.outer([-1.0, 1.0], traces)
        limit_rows = [(LimitRow(i, i), *bounds[:, i], _NONE, 0.0) for i in range(nu)]
        for k in range(joints):
            i, at = rates.start + k, joint_places.start + k
            excess = _EXCESS / self._by_joint("joints")[k]
            row = LimitRow(nu + moved.start + k, nu + at)
            limit_rows.append((row, *limits.joints[:, k], excess, 1.0))
            fastest, excess = limits.velocities[k], _EXCESS / self._by_joint("joint_rates")[k]
            row = LimitRow(nu + nd + i, nu + n + i)
            limit_rows.append((row, -fastest, fastest, excess, 1.0))
        if self.rates is not None:
            before = nu + n + nv + self.horizon.motors, nu + nd + nv + self.horizon.motors
            fastest = np.broadcast_to(np.asarray(self.rates, dtype=np.float64), (nu,))
            for i in range(nu):
                row = LimitRow(i, i, before[1] + i, before[0] + i)
                limit_rows.append((row, -fastest[i], fastest[i], _NONE, 0.0))
        limit_rows = [row for row in limit_rows if np.isfinite(row[1]) or np.isfinite(row[2])]
        rows, least, most, penalty, _ = zip(*limit_rows, strict=True) if limit_rows else ((),) * 5
        width = np.subtract(most, least) / 2.0
        values = {
            "least": np.clip(least, -_NONE, None),
            "most": np.clip(most, None, _NONE),
            "penalty": np.array(penalty),
            "scale": np.where(np.isfinite(width), width, 1.0),
        }
        return list(rows), (values if limit_rows else {})

    def _weights(self) -> dict[str, Array]:
        """Weights of the squares of what is off, by kind."""
        tolerances, layout = self.tolerances, self.horizon.robot.layout.v
        rotors = self.vehicle.rotors
        thrusts = np.abs(self.hover.u[:rotors])
        thrust = tolerances.thrust or 0.5 * float(thrusts.max(initial=0.0)) or 1.0
        turning = np.array([x == "N m" for x in self.module.INPUT_UNITS[rotors:]], dtype=bool)
        effort = np.where(turning, thrust * self._reach or 1.0, thrust)
        scale = np.r_[
            np.full(rotors, thrust),
            effort if tolerances.effort is None else self._by_joint("effort"),
        ]
        if self.vehicle.is_driven:  # Commands that make so much of a difference.
            still, u = np.zeros(layout.size), self.hover.u
            sent = [self.vehicle.command_of(self.hover.q, still, x) for x in (u + scale, u)]
            scale = np.abs(sent[0] - sent[1])
        # What has one value is no help beyond the horizon either.
        inputs = np.where(self._bounds[0] == self._bounds[1], _LITTLE, scale) ** -2.0
        displaced = self.horizon.robot.layout.displaced
        posture, rates = np.zeros(displaced.size), np.zeros(layout.size)
        posture[displaced.attitude] = tolerances.attitude**-2
        posture[displaced.joints] = self._by_joint("joints") ** -2.0
        if tolerances.position is not None:
            posture[displaced.position] = tolerances.position**-2
        elif not self.points:
            posture[displaced.position] = tolerances.point**-2
        rates[layout.attitude] = tolerances.angular_velocity**-2
        rates[layout.position] = tolerances.velocity**-2
        rates[layout.joints] = self._by_joint("joint_rates") ** -2.0
        has_changes = self.horizon.changes
        share = tolerances.change
        changes = np.zeros_like(inputs) if share is None else inputs / share**2
        return {
            "points": np.full(3 * len(self.points), tolerances.point**-2),
            "orientations": np.full(3 * len(self.orientations), tolerances.orientation**-2),
            "posture": posture,
            "velocities": rates,
            "inputs": inputs,
            "changes": changes if has_changes else np.zeros(0),
        }

    def _by_joint(self, name: str) -> Array:
        """A tolerance of each joint (n), of effort of each wheel too."""
        tolerance = np.asarray(getattr(self.tolerances, name), np.float64)
        return np.broadcast_to(tolerance, (self._count(name),))

    def _count(self, name: str) -> int:
        """How many a tolerance is for: joints, and with efforts wheels."""
        return self.vehicle.joints + (self.vehicle.layout.q.wheels if name == "effort" else 0)

    @property
    def _reach(self) -> float:
        """Distance, m, of the furthest frame from the base."""
        places = self.vehicle.frame_poses(self.hover.q)[:, :3, 3]
        return float(np.linalg.norm(places - places[0], axis=-1).max(initial=0.0))

    # The wishes.

    def _position(self, q: Array) -> Array:
        """The first point that is led (3), m, or the base if there is none."""
        frame = self.horizon.points[0] if self.horizon.points else 0
        return self.vehicle.frame_poses(q)[frame, :3, 3]

    def _refer(self, time: float, q_now: Array) -> None:
        """Let nodes be what they are to be from a time, s, on, of a machine that is at q_now."""
        times, place = time + self._ahead, self.vehicle.layout.q.position
        here = self.vehicle.frame_poses(q_now)[list(self.horizon.points), :3, 3]
        paths = [np.asarray(path(times)) for path in self.points.values()]
        points = [self._led(path, x, times) for path, x in zip(paths, here, strict=True)]
        rotations = [np.asarray(path(times)) for path in self.orientations.values()]
        led = [*points, *(x.reshape(len(times), 9) for x in rotations)]
        is_bent = self.posture is not None or len(led) > self._carries
        if self.posture is not None:
            q = np.array(self.posture(times))
        else:
            q = np.tile(self.hover.q, (len(times), 1))
            if self._carries:
                q[:, place] += points[0] - self._first_point
            if is_bent:
                q = self._fitting(q, points, led)
        if not self._carries:
            q[:, place] = self._led(q[:, place], q_now[place], times)
        if is_bent:
            self._turn_costs(q[-2])
            steps = self.vehicle.difference(q[:-1], q[1:])
        else:
            steps = (q[1:, place] - q[:-1, place]) @ self._ways
        v = self._rates @ steps
        if self.feedforward is not None:
            u = np.asarray(self.feedforward(times[:-1]))
        elif self._pushes:  # The same torques: what servos are sent goes along.
            moved = np.concatenate([self.vehicle.difference(self.hover.q, q[:-1]), v], 1)
            layout, pushing = self.vehicle.layout, self.horizon.pushing
            places = [*layout.paired, *range(layout.displaced.size, self.horizon.motion)]
            u = self._inputs + moved @ pushing[:, places].T
        else:
            u = self._inputs
        led = [*self._signals_at(times), *led]
        first, *parts = self._wishes
        for wish, part in zip(parts, (q[:-1], v, u), strict=True):
            wish[:] = part
        if led:
            np.concatenate([x[:-1] for x in led], axis=1, out=first)

    def _signals_at(self, times: Array) -> list[Array]:
        """Signals of the user's cost at times (n), s, in rows (n, …)."""
        paths = {"time": lambda at: at, **self.signals}
        return [np.reshape(paths[name](times), (len(times), -1)) for name in self.horizon.signals]

    def _led(self, path: Array, place: Array, times: Array) -> Array:
        """A path (n, 3), m, at times (n), s, that begins near a place and does not jump.

        What is missing of it, now or after a jump, fades as what is led so far ahead comes nearer.
        """
        lengths = self._lengths
        steps = path[1:] - path[:-1]
        speeds = steps / lengths
        # Most paths vary too little in speed for a jump, whatever is usual.
        range_of_steps = (speeds.max(axis=0) - speeds.min(axis=0)) * lengths[-1]
        is_smooth = math.hypot(*range_of_steps) <= self._farthest
        begins, missing = times[:1], place - path[0]
        if is_smooth and math.hypot(*missing) <= self._farthest:
            return path
        missing = missing[np.newaxis]
        if not is_smooth:
            around = np.pad(speeds, ((_AROUND, _AROUND), (0, 0)), "reflect")
            usual = np.median(sliding_window_view(around, 2 * _AROUND + 1, axis=0), axis=-1)
            jumps = usual * lengths - steps
            is_jump = np.linalg.norm(jumps, axis=1) > np.maximum(
                self._farthest, _JUMP * lengths[:, 0]
            )
            begins = np.append(begins, times[1:][is_jump])
            missing = np.concatenate([missing, jumps[is_jump]])
        since = times - begins[:, np.newaxis]
        ahead = np.where(since < 0.0, np.inf, self._farthest + self.tolerances.velocity * since)
        shares = 1.0 - ahead / np.maximum(np.linalg.norm(missing, axis=1), 1e-12)[:, np.newaxis]
        return np.asarray(path + np.maximum(0.0, shares).T @ missing)

    def _fitting(self, q: Array, points: list[Array], led: list[Array]) -> Array:
        """Coordinates (n, nq) near to q with frames where they are led, by damped least squares.

        Bases lean last, which do not hover so if their rotors push along one axis.
        """
        layout, tolerances, joints = self.vehicle.layout, self.tolerances, self.vehicle.arm
        scale = np.empty(layout.v.size)
        scale[layout.v.joints] = self._by_joint("joints")
        scale[layout.v.position] = tolerances.position or 1.0
        shares = np.array([_LEAN, _LEAN, 1.0])[layout.own_axes[1]]
        scale[layout.v.attitude] = tolerances.attitude * shares
        frames = [*self.horizon.points, *self.horizon.orientations]
        is_turn = np.arange(len(led)) >= len(points)
        tolerance = np.where(is_turn, tolerances.orientation, tolerances.point)[:, np.newaxis]
        for _ in range(_FITS):
            poses = self.vehicle.frame_poses(q)[:, frames]
            slope = self.vehicle.frame_jacobians(q)[:, frames]
            slope = np.where(
                is_turn[:, np.newaxis, np.newaxis], slope[..., 3:, :], slope[..., :3, :]
            )
            missed = [x[:, :3, 3] - at for x, at in zip(poses.swapaxes(0, 1), points, strict=False)]
            for x, at in zip(poses.swapaxes(0, 1)[is_turn], led[len(points) :], strict=True):
                turn = x[:, :3, :3] @ at.reshape(-1, 3, 3).swapaxes(1, 2)
                about = turn[:, [2, 0, 1], [1, 2, 0]] - turn[:, [1, 2, 0], [2, 0, 1]]
                trace = np.trace(turn, axis1=1, axis2=2)[:, np.newaxis]
                missed.append(about / np.sqrt(np.maximum(1.0 + trace, 1e-9)))
            errors = (np.stack(missed, axis=1) / tolerance).reshape(len(q), -1, 1)
            slope = (slope / tolerance[..., np.newaxis] * scale).reshape(len(q), -1, len(scale))
            square = slope @ slope.swapaxes(1, 2) + np.eye(slope.shape[1])
            step = slope.swapaxes(1, 2) @ np.linalg.solve(square, errors)
            q = self.vehicle.integrate(q, -scale * step[:, :, 0])
            q[:, joints] = np.clip(q[:, joints], *self._limits.joints)
        return q

    def _in_base(self, q: Array) -> Array:
        """From displacements and velocities to those in the base's frame (nd + nv, nd + nv)."""
        base, nv = self.vehicle.layout.v.base, self.vehicle.layout.v.size
        if not self.vehicle.layout.moves_freely:  # What moves of it does so along axes of its own.
            return np.eye(self.horizon.motion)
        jacobian = self.vehicle.frame_jacobians(q)[self.vehicle.frames.index("base")]
        rotation = self.vehicle.base_rotation(q)
        turned = np.eye(nv)
        turned[np.ix_(base, base)] = np.kron(np.eye(2), rotation.T) @ jacobian[:, base]
        return np.asarray(np.kron(np.eye(2), turned), np.float64)

    def _turn_costs(self, q: Array) -> None:
        """Let what follows the horizon cost as in hover, seen from a base that has turned."""
        turned = self._in_base(q)
        costs = turned.T @ self._costs_in_base @ turned
        self._compiled.arrays["ahead"][:] = np.concatenate([costs.ravel(), *self._carrying(q)])

    def _carrying(self, q: Array) -> list[Array]:
        """Arguments of `Horizon.end` beside costs, if the first point at q carries the base."""
        if not self._carries:
            return []
        is_turned = self.vehicle.layout.is_quaternion
        turn = self.vehicle.base_rotation(q).T if is_turned else np.eye(3)
        jacobian = self.vehicle.frame_jacobians(q)[self.horizon.points[0], :3]
        return [turn.ravel(), jacobian.ravel()]

    def _ahead_costs(self, constants: Any, weights: Mapping[str, Array]) -> Array:
        """Costs after the horizon, by the regulator about hover; see `Horizon.end`.

        At rest nothing leads a base with a drive sideways: it is the mean of both ways there.
        """
        layout, ways = self.vehicle.layout, [np.zeros(self.vehicle.layout.v.size)]
        if layout.has_drive:
            ways = [way * self.tolerances.velocity * np.eye(1, layout.v.size)[0] for way in (1, -1)]
        costs = [self._regulated(constants, weights, v) for v in ways]
        return np.concatenate([np.mean(costs, axis=0).ravel(), *self._carrying(self.hover.q)])

    def _regulated(self, constants: Any, weights: Mapping[str, Array], v: Array) -> Array:
        """The costs of a regulator about the coordinates of hover at velocities (nv)."""
        horizon, arrays = self.horizon, self._compiled.arrays
        nu, hover, motion = horizon.robot.inputs, self.hover, horizon.motion
        nd = horizon.robot.space.displacements
        before = self._inputs if horizon.changes else np.zeros(0)
        x = np.concatenate([hover.q, v, self._settled, before])
        # Costs of one's own may be least elsewhere.
        program, signals = replace(horizon, cost=None).node(), self._signals_at(np.zeros(1))
        arguments = {
            "u": self._inputs,
            "x": x,
            "x_next": x,
            "h": self.step,
            "reference": self._hovering()[sum(x.size for x in signals) :],
            "weights": arrays["weights"],
            "lag_times": arrays["lag_times"][: horizon.lag_times],
            "around": arrays["around"],
        }
        arguments = {name: arguments[name] for name in program.names}
        results = evaluate(program, arguments, {"robot": self.module}, {"robot": constants})
        slope = results["slope"]
        # Without lag and inputs before: these are forgotten soon.
        a, b = slope[:motion, nu : nu + motion], slope[:motion, :nu]
        if horizon.motors:
            by_motors = slope[:motion, nu + motion : nu + motion + horizon.motors]
            b = b + by_motors @ self._followed
        states, inputs = np.zeros((motion, motion)), np.diag(weights["inputs"])
        states[:nd, :nd] = results["hessian"]
        states[range(nd, motion), range(nd, motion)] = arrays["diagonal"][nu + nd : nu + motion]
        across = arrays["across"][:, :motion]
        after = np.zeros_like(states)
        for _ in range(_STEPS):
            cost = states + after
            gain = np.linalg.solve(inputs + b.T @ cost @ b, b.T @ cost @ a + across)
            closed = a - b @ gain
            after = gain.T @ (inputs @ gain - across) - across.T @ gain + closed.T @ cost @ closed
        after -= horizon.pushing.T @ across  # What servos push costs at the end, too.
        return np.asarray(after, np.float64)

    def _hovering(self) -> Array:
        """The reference of hover."""
        hover, poses = self.hover, self.vehicle.frame_poses(self.hover.q)
        parts = [poses[frame, :3, 3] for frame in self.horizon.points]
        parts += [poses[frame, :3, :3].ravel() for frame in self.horizon.orientations]
        still = np.zeros(self.horizon.robot.space.velocities)
        parts = [*(x[0] for x in self._signals_at(np.zeros(1))), *parts]
        return np.concatenate([*parts, hover.q, still, self._inputs])


def _again(folder: str, options: dict[str, Any]) -> Predictive:
    """A controller of a module in a folder, without plan and log."""
    return Predictive(**options | {"module": load(folder, "c")})


def _rates_of_steps(lengths: Array) -> Array:
    """A matrix (n, n) from steps of lengths (n), s, to rates at their begins; first that of it."""
    before, after = lengths[:-1], lengths[1:]
    shares = np.r_[1.0, before / (before + after)]
    rates = np.diag(shares / lengths)
    rates[range(1, len(lengths)), range(len(before))] = (1.0 - shares[1:]) / before
    return rates


class _Rest(NamedTuple):
    q: Array
    u: Array


# How often the law of a scenario plans without a rate, Hz; where it pushes, since walls are stiff.
_RATE, _PUSHING_RATE = 50.0, 100.0


# A posture that goes with the path is to be kept: with looser joints an elbow may turn over.
_OF_SCENARIOS = Tolerances(joints=0.05, attitude=0.1)
# A machine that pushes leans. Its force is depth in a wall, as exact as such a force, N, in
# a wall of so many N/m or more.
_FORCE, _SOFT = 0.2, 1000.0
# Least share of a push that a wall meets, and steps to where it pushes back as hard.
_FACING, _MEETING = 0.1, 4


def predictive_law(law: Controller, scenario: Scenario, actuators: Actuators) -> Predictive:
    """The predictive law of a scenario: it leads the tip, if that has a path, and else the base.

    Where `control.force` is to push, it leads the frame into the walls, which it knows, and all
    else goes along as it leans.
    `law` knows the robot, and commands the inputs of the desired motion, off which inputs cost as
    the posture does off its coordinates. Raises as `Predictive` does.
    """
    vehicle, reference, control = law.vehicle, law.reference, scenario.control
    force = control.force
    step = 1.0 / (control.rate or (_RATE if force is None else _PUSHING_RATE))
    # Between instants too, where commands are late.
    spacing = step / 8.0
    count = max(3, int((reference.end - reference.begin) / spacing))
    times = np.asarray(reference.begin + spacing * np.arange(count), np.float64)
    q, v, _ = reference(times)
    q, still = vehicle.kinematics.normalised(q), np.zeros_like(v)
    forward = law.commanded(times, q, still, still[:, :0], {})[0]
    forward = commands_for(vehicle, q, v, forward, actuators.inputs)
    load = vehicle.inverse_dynamics(q[0], still[0], still[0])
    rest = np.linalg.pinv(vehicle.input_matrix(q[0])) @ load

    def table(rows: Array, farthest: float = np.inf) -> Path:
        """Rows at any times; after the last they go on with its rate and bend, if they may."""

        def motion(at: Array) -> Array:
            place = np.maximum((at - times[0]) / spacing, 0.0)
            first = np.minimum(place.astype(int), len(times) - 2)
            share = np.minimum(place - first, farthest)[:, np.newaxis]
            between: Array = (1.0 - share) * rows[first] + share * rows[first + 1]
            beyond = np.maximum(share - 1.0, 0.0) * (first == len(times) - 2)[:, np.newaxis]
            bend = rows[-1] - 2.0 * rows[-2] + rows[-3]
            return between + 0.5 * beyond * (beyond + 1.0) * bend

        return motion

    if control.delay > step:
        raise UsageError(
            f"control.delay: the predictive law compensates at most a period, {step:g} s, not "
            f"{control.delay:g} s; set a lower control.rate"
        )
    coordinates, points, tolerances = table(q), {}, _OF_SCENARIOS
    if scenario.arm.tip is not None or force is not None:
        poses = vehicle.frame_poses(q)
        frame = "tip" if force is None else (control.impedance or Impedance()).frame
        places = poses[:, vehicle.smooth_place(frame, "control.impedance.frame"), :3, 3]
        if force is not None:
            direction = np.array(force.direction) / np.linalg.norm(force.direction)
            if force.axes != WORLD:
                axes = vehicle.frame_place(force.axes, "control.force.axes")
                direction = poses[:, axes, :3, :3] @ direction
            walls = [wall for wall in scenario.walls if frame in wall.frames]
            places = places + _into_walls(walls, force, places, direction, times)
            tolerances = Tolerances(point=_FORCE / max(_SOFT, *(x.stiffness for x in walls)))
        points[frame] = table(places)
    return Predictive(
        vehicle.module,
        _Rest(q[0], np.asarray(rest, np.float64)),
        points,
        posture=None if force else lambda at: vehicle.kinematics.normalised(coordinates(at)),
        feedforward=table(forward, 1.0),
        parameters=scenario.parameters,
        step=step,
        tolerances=tolerances,
        delay=control.delay,
        actuators=actuators,
        walls=() if force is None else scenario.walls,
    )


def _served(vehicle: Vehicle) -> tuple[tuple[int, int], ...]:
    """Inputs that servos are sent, with the entry of (q, v) off which they push."""
    displaced, rates = vehicle.layout.displaced, vehicle.layout.v.joints
    first = [displaced.size + rates.start, displaced.joints.start]
    return tuple(
        (vehicle.rotors + x, first[holds(vehicle, x)] + x)
        for x in range(vehicle.joints)
        if has_servo(vehicle, x)
    )


def _into_walls(
    walls: Sequence[Wall], force: Force, places: Array, direction: Array, times: Array
) -> Array:
    """Ways (n, 3), m, from places (n, 3) along a direction to where a wall pushes back as hard.

    As much of them as the force is to be there at times (n), s.
    """
    if not walls:
        raise UsageError(
            "control.force: the predictive law needs a [[wall]] for the frame that pushes "
            '(control.impedance.frame); add one, or set control.law to "force"'
        )
    ways = np.zeros((len(walls), len(times)))
    for way, wall in zip(ways, walls, strict=True):
        for _ in range(_MEETING):
            there = places + way[:, np.newaxis] * direction
            depth, normals = surface_at(wall.kind, np.array(wall.figures), there)
            against = -np.sum(normals * direction, axis=-1)
            facing = np.maximum(against, _FACING)
            lacking = force.value / (wall.stiffness * facing) - depth - wall.ball_radius
            way += lacking / facing
        way[against < _FACING] = np.inf  # What does not face the push takes no part in it.
    shortest = np.min(ways, axis=0)
    time, figures = variable("time"), map(constant, (force.begin, force.end, force.rise))
    program = Program("push", (time,), dict(zip("+-", push_shares(time, *figures), strict=True)))
    rising, falling = evaluate(program, {"time": times}, {}).values()
    alone = np.isinf(shortest)
    if len(late := times[alone & (rising > falling)]):
        raise UsageError(
            f"control.force: at {late[0]:.4g} s no [[wall]] faces the push; give the direction "
            "that leads into one"
        )
    shortest = np.where(alone, 0.0, shortest)
    return ((rising - falling) * shortest)[:, np.newaxis] * direction
