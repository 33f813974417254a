"""Steps of a machine, and what its IMUs feel, as programs in C for many states.

They take so little time that their differences cost less than their derivatives would: 26 by the
state of a quadrotor with an arm take half as long, and nothing is derived or compiled for them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.arrays.evaluation import evaluate
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program, constant, join, reshaped, variable, zeros
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.machine.machine import Machine, Rates, Surroundings
from gibbs_codegen.machine.sensors import SensedMotion, SensorAt, imu
from gibbs_codegen.machine.state import State
from gibbs_codegen.machine.steps import runge_kutta_4
from gibbs_codegen.runtime.loaded_module import gravity_of
from gibbs_codegen.runtime.program_blocks import BlockProgram, compile_program

# The longest substep, s; how many times the shortest time constant it may be, but need not be below
# `_SHORTEST`, s, for that; and how many times at most, since Runge-Kutta steps diverge from 2.8 on.
_LONGEST, _COVERED, _SHORTEST, _STABLE = 2.5e-3, 0.6, 1.7e-3, 2.0
# Changes of q, v and actuators, SI units, by which rates are known: friction is steep about rest.
_CHANGES = 1e-3, 1.0, 1e-3
# Deviations from which on what is off weighs less (Huber).
OUTLIER = 3.0
_NEXT = "q_next", "v_next", "x_next"


class MachineNumbers(NamedTuple):
    """Constants of a module, and what steps are given besides, such as the `scale` of a pull."""

    constants: Any
    given: dict[str, Any]


class Model:
    """Steps of `h`, s, of a module's machine, with `imus` at some of its frames, by their numbers.

    A state has coordinates q (nq), velocities v (nv), states x (nx) of actuators, and a pull. Of a
    base that moves freely it is that of the wind (3), m/s², world axes: times the whole mass it is
    a force at the base. As a force it would draw masses down, since it is in what accelerometers
    tell. `drag`, N s/m, brakes such a base. Of others it is what inputs (nu) err by, over `noise`.
    Steps are made of substeps, as short as its `fastest` rate, 1/s, wants.
    """

    def __init__(self, module: ModuleType, h: float, imus: Sequence[str], noise: Array) -> None:
        robot, self.vehicle, self.imus = Functions(module), Vehicle(module), (*imus,)
        self.module, self.h, self.layout, self.noise = module, h, robot.layout, noise
        self.free = robot.layout.moves_freely
        self.nd, self.nv = robot.space.displacements, robot.space.velocities
        constants = {} if robot.driven else module.TIME_CONSTANTS
        self._lagging = [k for k, name in enumerate(module.INPUTS) if name in constants]
        self._times = [constants[module.INPUTS[k]] for k in self._lagging]
        self.nx = robot.actuator_states + len(self._lagging)
        self._felt = 6 * len(imus)
        self.pulls = 3 if self.free else robot.inputs
        (q, v), x = robot.state(), variable("x", self.nx)
        command, pull = variable("command", robot.inputs), variable("pull", self.pulls)
        drag, length = (variable(name, uniform=True) for name in ("drag", "h"))
        scale = variable("scale", self.pulls, uniform=True)
        base = module.FRAMES.index("base")
        one = np.zeros((robot.frames, 1))
        one[base] = 1.0

        def rates(q: Node, v: Node, x: Node) -> Rates:
            figures = {"time_constants": constant(self._times)}
            if self.free:
                force = scale * pull - drag * robot.frame_velocities(q, v)[base][:3]
                figures["push"] = constant(one) @ reshaped(join(force, zeros(3)), (1, 6))
            pushed = Surroundings(pushes=self.free)
            lagging = tuple(self._lagging)
            machine = Machine(robot, lambda name, *_: figures[name], pushed, lagging=lagging)
            state = State(q, v, zeros(0), x, zeros(0), zeros(0))
            inputs = machine.inputs(state, command)
            if not self.free:
                inputs = inputs + scale * pull
            return machine.rates(constant(0.0), state, inputs, command)

        def accelerate(q: Node, moved: Node, _: int) -> Node:
            change = rates(q, moved[: self.nv], moved[self.nv :])
            return join(change.a, change.actuators)

        def move(q: Node, displacement: Node) -> Node:
            return robot.integrate(q, displacement[: self.nv])

        inputs = (q, v, x, command, pull, drag, scale, length)
        after, moved = runge_kutta_4(move, accelerate, q, join(v, x), length)
        results = after, moved[: self.nv], moved[self.nv :]
        # The first stage of a substep is the motion that IMUs feel.
        change = rates(q, v, x)
        outputs = dict(zip((*_NEXT, "a"), (*results, change.a), strict=True))
        part = Program("substep", inputs, outputs)
        derivatives = {"a": change.a, "actuators": change.actuators}
        self.fastest = self._fastest(Program("rates", inputs[:-1], derivatives))
        time = 1.0 / max(self.fastest, 1.0)
        substep = min(max(_COVERED * time, _SHORTEST), _STABLE * time, _LONGEST)
        parts = self._parts = math.ceil(h / substep - 1e-3)
        substeps = [dict(zip(_NEXT, (q, v, x), strict=True))]
        for _ in range(parts):
            before = (substeps[-1][name] for name in _NEXT)
            substeps.append(part.results(*before, *inputs[3:-1], length / parts))
        outputs = {name: substeps[-1][name] for name in _NEXT}
        gravity = variable("gravity", 3, uniform=True)
        motion = SensedMotion(robot, q, v, substeps[1]["a"], zeros(robot.frames, 6), gravity)
        felt = (imu(motion, SensorAt("imu", module.FRAMES.index(at), ())) for at in imus)
        outputs["felt"] = join(zeros(0), *felt)
        self._step = Program("identification", (*inputs, gravity), outputs)
        self._robot, self._program = robot, compile_program(self._step, module)

    def _fastest(self, rates: Program) -> float:
        """The fastest rate, 1/s, of small motions about rest, by eigenvalues of their equations."""
        module, nv = self.module, self.nv
        sizes = np.repeat(_CHANGES, [nv, nv, self.nx])
        steps = np.concatenate([np.diag(sizes), -np.diag(sizes)])
        v, command = steps[:, nv : 2 * nv], np.zeros(len(module.INPUTS))
        led = self.nx and not self._times
        rest = module.actuator_state_of(command) if led else np.zeros(self.nx)
        state = {
            "q": module.integrate(np.tile(self.layout.neutral, (len(steps), 1)), steps[:, :nv]),
            "v": v,
            "x": rest + steps[:, 2 * nv :],
        }
        calm = {"command": command, "pull": np.zeros(self.pulls), "drag": 0.0}
        scale = {"scale": np.zeros(self.pulls)}
        with np.errstate(all="ignore"):
            out = evaluate(rates, {**state, **calm, **scale}, {"robot": module})
        # What depends on no state has no axis of states.
        parts = (
            np.broadcast_to(out[name], (len(v), out[name].shape[-1])) for name in rates.outputs
        )
        changes = np.concatenate([v, *parts], axis=1)
        slopes = (changes[: len(sizes)] - changes[len(sizes) :]) / (2.0 * sizes[:, np.newaxis])
        # A curve may have no slope where a motor stands still.
        return float(np.abs(np.linalg.eigvals(np.nan_to_num(slopes, posinf=0.0, neginf=0.0))).max())

    def machine(self, parameters: Mapping[str, float]) -> MachineNumbers:
        """What steps are given of a machine, by parameters that differ from the robot file."""
        constants, scale = self.module.prepare(dict(parameters)), self.noise
        if self.free:
            upwards, neutral = self.layout.v.position.start + 2, np.array(self.layout.neutral)
            masses = self.module.mass_matrix(neutral, constants=constants)
            scale = np.full(3, masses[upwards, upwards])
        gravity = gravity_of(self.module, self.layout, constants)
        given = {"scale": scale, "h": self.h, "gravity": [0.0, 0.0, float(gravity)]}
        return MachineNumbers(constants, given)

    def __call__(
        self, state: Mapping[str, Array], machine: MachineNumbers, **others: Any
    ) -> tuple[dict[str, Array], Array]:
        """States after a step, and what the IMUs (6 each) feel before it.

        `others` are the command (…, nu) and the drag.
        """
        given = {**state, **others, **machine.given}
        out = self._program(given, {"robot": machine.constants})
        after = {name.removesuffix("_next"): np.asarray(out[name], float) for name in _NEXT}
        felt = np.asarray(out["felt"], float)
        return after, felt.reshape(*after["v"].shape[:-1], self._felt)

    def window(self, samples: int, kept: float) -> BlockProgram:
        """A program of `samples` steps from a state and a `change` of it: what readings are `off`.

        Each step leaves `kept` of the pull. By samples `off` has displacements (nd) of q from what
        is read, `read_0` and so on, and what IMUs feel beyond `felt` (samples, 6 i); at its end it
        has the way (nd + nv + nx) from the next state, `next_q`, `next_v` and `next_x`. Coordinates
        at samples are `seen_0` and so on.
        """
        robot, (q, v, x, command, pull, *shared) = self._robot, self._step.inputs
        ends = np.cumsum([0, self.nd, self.nv, self.nx, self.pulls]).tolist()
        change = variable("change", ends[-1])
        of_q, *others = (change[begin:end] for begin, end in pairwise(ends))
        series = [
            variable("commands", samples, command.size),
            variable("felt", samples, self._felt),
        ]
        read = [robot.coordinates(f"read_{k}") for k in range(samples)]
        ahead = [robot.coordinates("next_q")]
        ahead += [variable(f"next_{name}", y.size) for name, y in (("v", v), ("x", x))]
        given = q, v, x, pull, change, *series, *read, *ahead, *shared
        v, x, pull = (y + z for y, z in zip((v, x, pull), others, strict=True))
        q, off, outputs = robot.displaced(q, of_q), [], {}
        for k, (command, felt, place) in enumerate(zip(*series, read, strict=True)):
            feels = self._step.results(q, v, x, command, pull, *shared)
            off += [robot.displacement(place, q), feels["felt"] - felt]
            outputs[f"seen_{k}"] = q
            (q, v, x), pull = (feels[name] for name in _NEXT), kept * pull
        off += [robot.displacement(ahead[0], q), v - ahead[1], x - ahead[2]]
        outputs["off"] = join(*off)
        return compile_program(Program("window", given, outputs), self.module)

    def levels(self, commands: Array, constants: Any = None) -> Array:
        """States of actuators (s, nx) by commands (s, nu) alone, by Euler's method."""
        module, share = self.module, -np.expm1(-self.h / np.array(self._times))
        parts = self._parts
        if not self.nx:
            return np.zeros((len(commands), 0))
        lags, followed = bool(self._times), commands[:, self._lagging]
        x = followed[0] if lags else module.actuator_state_of(commands[0])
        levels = np.empty((len(commands), self.nx))
        for k, command in enumerate(commands):
            levels[k] = x
            if lags:
                x = x + share * (followed[k] - x)
                continue
            for _ in range(parts):
                x = x + self.h / parts * np.asarray(module.actuator_rates(x, command, constants))
        return levels

    def pace(self, commands: Array, constants: Any) -> bytes:
        """Rates of actuators at some states, which tell whether constants change levels."""
        if not self.nx or self._times:
            return b""
        states = 0.9 * self.module.actuator_state_of(commands[::-1])
        return np.asarray(self.module.actuator_rates(states, commands, constants)).tobytes()

    def moved(self, state: Mapping[str, Array], change: Array) -> dict[str, Array]:
        """States after changes (…, nd + nv + nx + pulls) of q, in the tangent space, v, x, pull."""
        q, v, x, pull = np.split(change, np.cumsum([self.nd, self.nv, self.nx]), axis=-1)
        after = {"q": self.vehicle.displaced(state["q"], q), "v": state["v"] + v}
        return after | {"x": state["x"] + x, "pull": state["pull"] + pull}
