"""The C functions of a module as a C program calls them, in either precision.

The back end of `load` calls the same library in whole blocks of doubles. What only a C program uses
is put to work here: last blocks that are not full, `pack` and `unpack`, and single precision.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, get_args

import numpy as np

from gibbs_codegen.errors import MissingFunctionError
from gibbs_codegen.interface import LANES
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime import rollouts
from gibbs_codegen.runtime.rollout_source import rollout_programs
from gibbs_codegen.verification.comparison import Comparison, Results, compared, failed, merged
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import determined, parameter_values, variation
from gibbs_codegen.verification.states import FAR_SINGLE, Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array
from gibbs_codegen.verification.verify import most_states

_HEADER = "the header"
PARTIAL = f"{NewtonEuler.name}, last block not full"
SINGLE_PRECISION = f"{NewtonEuler.name}, single precision"
# States in a block in single precision, in which registers hold twice as many numbers.
_SINGLE_LANES = 2 * LANES
# Every number of states in a last block, and one of them after a block that is full.
_BATCHES = (3, LANES + 3, 1, 2, 4, 5, 6, 7)
_SINGLE_BATCHES = (3, _SINGLE_LANES + 3, 1, _SINGLE_LANES - 1)
# Least eigenvalue of a mass matrix of unit diagonal that single precision leaves positive.
_DETERMINED = 1e-6
_HIDDEN = "in single precision, rounding hides the inertia of a degree of freedom"
# As many sets of other parameters are looked at for one that single precision can compute with.
_VARIATIONS = 16
# A number that no function computes.
_GUARD = -1.2345e30


class CResults(Results):
    """The functions of a library in one precision, called as the module's header says."""

    def __init__(
        self, path: str, module: ModuleType, batches: Sequence[int], single: bool = False
    ) -> None:
        """Load a library, for batches of so many states, one after the other.

        `module`, the C back end, tells the names and numbers of things; `single` is whether the
        library was compiled for single precision.
        """
        super().__init__(module)
        self._library = ctypes.CDLL(path)
        self._batches = batches
        self._real: type[np.floating[Any]] = np.float32 if single else np.float64
        self._mark = "_float" if single else ""
        self._lanes = _SINGLE_LANES if single else LANES
        count = len(module.prepare({})) // ctypes.sizeof(ctypes.c_double)
        number = ctypes.c_float if single else ctypes.c_double
        symbol = f"{module.NAME}_default_constants{self._mark}"
        self._constants = np.array((number * count).in_dll(self._library, symbol))

    def use(self, parameters: Sequence[float]) -> None:
        """Compute with other parameters, in the order of PARAMETERS, from now on.

        Raises `ValueError` if `init_constants` rejects them.
        """
        made = np.full(len(self._constants), np.nan, self._real)
        name = f"init_constants{self._mark}"
        if self._call(name, np.array(parameters, self._real), made):
            raise ValueError(f"{name} rejects these parameters")
        self._constants = made

    def pack(self, rows: Array) -> Array:
        """Blocks (blocks, width, lanes) that `pack` makes of states (s, width)."""
        count, width = rows.shape
        shape = (-(-count // self._lanes), width, self._lanes)
        return self._filled("pack", [count, width, rows.astype(self._real)], [shape])[0]

    def unpack(self, blocks: Array, count: int) -> Array:
        """States (count, width) that `unpack` makes of blocks (blocks, width, lanes)."""
        shape = (count, blocks.shape[1])
        return self._filled("unpack", [*shape, blocks.astype(self._real)], [shape])[0]

    def _computed(self, name: str, arguments: Sequence[Array]) -> list[Array]:
        shapes = self.signatures[name].shapes
        if not arguments or arguments[0].ndim == 1:
            inputs = [np.array(x, self._real) for x in arguments]
            return self._filled(name, [self._constants, *inputs], shapes)
        parts, first = [], 0
        for count in self._batches:
            some = [x[first : first + count].reshape(count, -1) for x in arguments]
            # Unused lanes hold what would be seen if it were read.
            lanes = self._lanes
            inputs = [
                in_blocks(x, np.full(x.shape[1], np.nan), lanes).astype(self._real) for x in some
            ]
            blocks = [(len(inputs[0]), math.prod(shape), lanes) for shape in shapes]
            outputs = self._filled(f"{name}_batch", [self._constants, count, *inputs], blocks)
            # One state after the other, without those that fill up the last block.
            flat = [x.swapaxes(1, 2).reshape(-1, x.shape[1])[:count] for x in outputs]
            parts.append([x.reshape(count, *shape) for x, shape in zip(flat, shapes, strict=True)])
            first += count
        return [np.concatenate(part) for part in zip(*parts, strict=True)]

    def _filled(
        self, name: str, arguments: Sequence[Array | int], shapes: Sequence[tuple[int, ...]]
    ) -> list[Array]:
        """Outputs of such shapes that a function of the library writes.

        `name` is without the robot's name, and `arguments` are those before the outputs. Raises
        `ValueError` if the function writes beyond the outputs or to its inputs.
        """
        before = [np.array(x) for x in arguments]
        guard = self._real(_GUARD)
        sizes = [math.prod(shape) for shape in shapes]
        # Beyond an output there is room for another block.
        rooms = [
            np.full(size + self._lanes * max(shape, default=1), guard)
            for size, shape in zip(sizes, shapes, strict=True)
        ]
        self._call(name, *arguments, *rooms)
        altered = any(
            x.tobytes() != np.array(y).tobytes() for x, y in zip(before, arguments, strict=True)
        )
        if altered or any((x[n:] != guard).any() for x, n in zip(rooms, sizes, strict=True)):
            raise ValueError("writes beyond its outputs or to its inputs")
        return [x[:n].reshape(shape) for x, n, shape in zip(rooms, sizes, shapes, strict=True)]

    def _call(self, name: str, *arguments: Array | int) -> int:
        pointers = [
            ctypes.c_size_t(x) if isinstance(x, int) else ctypes.c_void_p(x.ctypes.data)
            for x in arguments
        ]
        return int(self._library[f"{self.module.NAME}_{name}"](*pointers))


def in_blocks(rows: Array, unused: Array, lanes: int = LANES) -> Array:
    """States (s, width) as blocks (blocks, width, lanes), the last one filled up with `unused`."""
    count, width = rows.shape
    whole = -(-count // lanes)
    padded = np.broadcast_to(unused, (whole * lanes, width)).copy()
    padded[:count] = rows
    return padded.reshape(whole, lanes, width).swapaxes(1, 2).copy()


def compare_c_program(path: str, module: ModuleType, robot: Robot, seed: int) -> list[Comparison]:
    """Compare batches whose last block is not full, and `pack` and `unpack`."""
    tree = Tree(robot)
    program = CResults(path, module, _batches_within(tree))
    states = States.extreme(tree, sum(_batches_within(tree)), (seed, 3))
    rows = Expected(formulated(NewtonEuler(tree)), states).compare_functions(
        program, states, PARTIAL
    )
    try:  # States into blocks and back, bit for bit.
        for count in range(1, min(len(states), 2 * LANES) + 1):
            some = states.q[:count]
            blocks = in_blocks(some, some[-1])
            packed = compared("pack", _HEADER, program.pack(some), blocks, 1.0, 0.0)
            unpacked = compared("unpack", _HEADER, program.unpack(blocks, count), some, 1.0, 0.0)
            rows += [replace(packed, states=count), unpacked]
    except ValueError as error:
        rows.append(failed("pack", _HEADER, error))
    return merged(rows)


def _batches_within(tree: Tree, sizes: Sequence[int] = _BATCHES) -> list[int]:
    """Sizes of batches whose states are not too many at once."""
    most = most_states(tree)
    sums = np.cumsum(sizes)
    return [count for count, total in zip(sizes, sums, strict=True) if total <= most] or [1]


def compare_single_precision(
    path: str, module: ModuleType, robot: Robot, seed: int
) -> tuple[list[Comparison], dict[str, str]]:
    """Compare all functions in single precision; what is not compared, and why.

    In batches, with default constants; and state by state, with those of other parameters.
    """
    tree = Tree(robot)
    sizes = Sizes(tree, States.random(tree, 1, seed))
    natural = (sizes.matrix, sizes.inertial_effort, sizes.kinetic, sizes.potential, sizes.gibbs)
    numbers = np.concatenate([np.abs(size).ravel() for size in natural])
    # Products of two of them must be numbers of all digits.
    real = np.finfo(np.float32)
    least = numbers[numbers > 0.0].min() ** 2 * float(real.eps)
    if least <= float(real.tiny) or numbers.max() ** 2 >= float(real.max):
        return [], {SINGLE_PRECISION: "products of the robot's numbers are out of the range"}
    if not determined(robot, _DETERMINED):
        return [], {SINGLE_PRECISION: _HIDDEN}
    batches = _batches_within(tree, _SINGLE_BATCHES)
    program = CResults(path, module, batches, single=True)
    others = (variation(robot, module.PARAMETERS, seed, number) for number in range(_VARIATIONS))
    other = next((other for other in others if determined(other, _DETERMINED)), robot)
    not_done = {f"{SINGLE_PRECISION}, other parameters": _HIDDEN} if other is robot else {}
    comparisons: list[Comparison] = []
    for varied, singly in ((robot, False), (other, True)):
        tree, values = Tree(varied), parameter_values(varied)
        try:
            if singly:
                program.use([values[name] for name in module.PARAMETERS])
        except ValueError as error:
            return [failed("init_constants", SINGLE_PRECISION, error)], {}
        states = States.extreme(tree, sum(batches), (seed, 4), FAR_SINGLE).rounded()
        expected = Expected(formulated(NewtonEuler(tree)), states, single=True)
        comparisons += expected.compare_functions(program, states, SINGLE_PRECISION, singly)
    return merged(comparisons), not_done


ROLLOUTS = "rollouts"
# Blocks that are full in either precision, and one that is not. For each state so many are drawn,
# of which the best conditioned are taken.
_STATES, _DRAWN = 2 * LANES + 4, 10
# Steps are longer by so much than those that are short beside the time in which velocities change.
_STEPS, _LONG = 6, 5.0
_ROUNDINGS = 20.0
# The largest limit: a greater one would let faults pass.
_LARGEST = 1e-2


def compare_rollouts(
    numpy: ModuleType, tree: Tree, seed: int, precision: rollouts.Precision, flags: tuple[str, ...]
) -> tuple[list[Comparison], dict[str, str]]:
    """Compare short rollouts in C with the same in NumPy: the worst of all, or a failure.

    The other result says what is not compared, and why. The C is what was generated with the
    module, or else would be. `flags` are the compiler's, after its own. Raises
    `MissingFunctionError` if the module has too few functions for rollouts.
    """
    against = f"NumPy, in {precision} precision"
    rows = []
    try:
        states = States.random(tree, _DRAWN * _STATES, (seed, 7))
        sizes = Sizes(tree, states)
        conditions = np.linalg.cond(numpy.mass_matrix(states.q) / sizes.free_matrix)
        fittest = np.argsort(conditions)[:_STATES]
        # Digits that accelerations lose, by the mass matrix or beside a large robot.
        lost = max(float(conditions[fittest[-1]]), sizes.disparity)
        limit = _ROUNDINGS * float(np.finfo(rollouts.REALS[precision]).eps) * lost
        if limit > _LARGEST:
            return [], {f"{ROLLOUTS} in {precision} precision": "rounding leaves too few digits"}
        states, dt = _suited(numpy, States(*(x[fittest] for x in vars(states).values())))
        compiled = rollouts_in_c(numpy, precision, flags)
        for problem in _problems(numpy, tree, states, dt):
            ours = compiled(replace(problem, precision=precision))
            for name, theirs in vars(rollouts.numpy_rollout(problem)).items():
                if theirs is not None:
                    size = np.abs(theirs).max(axis=tuple(range(theirs.ndim))[:2])
                    values = getattr(ours, name)
                    rows.append(compared(ROLLOUTS, against, values, theirs, size, limit))
    except MissingFunctionError:
        raise
    except Exception as error:  # Whatever was done to the module.
        rows = [failed(ROLLOUTS, against, error)]
    return [replace(row, states=_STATES) for row in merged(rows)], {}


def rollouts_in_c(
    numpy: ModuleType, precision: rollouts.Precision, flags: tuple[str, ...]
) -> Callable[[rollouts.Problem], rollouts.Rollout]:
    """Rollouts of a precision by the C that was generated with a module, or else would be."""
    generated = (Path(numpy.__path__[0]) / f"{numpy.NAME}_rollout.c").is_file()
    programs = () if generated else tuple(rollout_programs(rollouts.functions_of(numpy)))
    function = rollouts.rollout_function(numpy, precision, programs, flags)
    return partial(rollouts.compiled_rollout, function=function)


def _suited(numpy: ModuleType, states: States) -> tuple[States, float]:
    """States whose inputs and wrenches are each too small for more than natural accelerations.

    And the length of a step.
    """
    q, v, natural = states.q, states.v, np.abs(states.a).max(axis=0)
    efforts = states.u.copy(), states.W.copy()
    falling = numpy.forward_dynamics(q, v, 0.0 * states.u)
    for kind, of_kind in enumerate(efforts):
        for k in range(of_kind.shape[1]):
            alone = [np.zeros_like(x) for x in efforts]
            alone[kind][:, k] = of_kind[:, k]
            driven = numpy.forward_dynamics_with_wrenches(q, v, *alone) - falling
            of_kind[:, k] /= (np.abs(driven).max(axis=0) / natural).max(initial=1.0)
    states = replace(states, a=falling, u=efforts[0], W=efforts[1])
    return states, min(_LONG * float(states.h.min()), _paced(numpy, states))


def _sent(numpy: ModuleType, states: States) -> tuple[Array, Array | None]:
    """Commands for the inputs of states, and states of actuators; the inputs where none are."""
    if not getattr(numpy, "COMMANDS", ()):
        return states.u, None
    sent = numpy.command_of(states.q, states.v, states.u)
    return sent, numpy.actuator_state_of(sent) if numpy.ACTUATOR_STATES else None


def _paced(numpy: ModuleType, states: States) -> float:
    """The longest step, s, in which no damping of servos makes a velocity grow."""
    sent, x = _sent(numpy, states)
    if sent is states.u:
        return math.inf
    x = np.zeros((len(sent), 0)) if x is None else x
    still = numpy.inputs_of(states.q, states.v, x, sent)
    fastest = 0.0
    for k, most in enumerate(np.abs(states.v).max(axis=0)):
        aside = states.v.copy()
        aside[:, k] += 1e-3 * most
        moved = numpy.inputs_of(states.q, aside, x, sent) - still
        change = numpy.forward_dynamics(states.q, states.v, states.u + moved)
        change -= numpy.forward_dynamics(states.q, states.v, states.u)
        fastest = max(fastest, float(np.abs(change[:, k]).max()) / (1e-3 * most))
    return 1.0 / max(fastest, 1e-9)


def _problems(
    numpy: ModuleType, tree: Tree, states: States, dt: float
) -> Iterator[rollouts.Problem]:
    """By each method nothing but inputs, some of what a rollout may have, and all of it.

    Inputs of a robot whose file describes actuators are the commands for them.
    """
    rng, rotors = np.random.default_rng(0), len(tree.motors)
    by_step = rng.uniform(0.5, 1.5, (_STATES, _STEPS, 1))
    sent, x = _sent(numpy, states)
    driven = sent is not states.u
    inputs, wrenches = sent[:, None] * by_step, states.W[:, None] * by_step[..., None]
    inputs_alone = rollouts.Problem(numpy, None, states.q, states.v, inputs.copy(), _STEPS, dt, x=x)
    inputs_alone.inputs[1, 2] = np.inf  # A state is lost, unless the robot has no inputs.
    # Efforts of about those of the inputs for errors of about the states' size.
    most = np.abs(sent).max(axis=0)
    places = tree.scales[tree.free]
    beside = places[: tree.layout.displaced.size - tree.layout.v.size]  # As ahead.
    sizes = np.concatenate([beside, places, np.abs(states.v).max(axis=0)])
    gain = rng.uniform(-0.5, 0.5, (len(most), len(sizes))) * most[:, None] / sizes
    q, v = states.q[::-1, None], states.v[::-1, None]
    # The motor of each rotor lags in every second state.
    lags = np.add.outer(np.arange(_STATES), np.arange(rotors)) % 2 * (0.0 if driven else dt)
    lags = lags * rng.uniform(0.5, 5.0, lags.shape)
    motors = rollouts.MotorModel(-0.4 * most, 0.6 * most, 0.0 * lags, states.u[::-1, :rotors])
    some = replace(inputs_alone, inputs=inputs[:, :1], motors=motors, wrenches=wrenches[:, :1])
    # It ends between two samples.
    some = replace(some, feedback=rollouts.Feedback(gain, q, v[:1]), every=4)
    varied = {n: x * rng.uniform(0.99, 1.01, _STATES) for n, x in numpy.PARAMETERS.items()}
    lagging = replace(motors, time_constants=lags)
    whole = replace(some, inputs=inputs, wrenches=wrenches, motors=lagging, every=2)
    desired = rollouts.Feedback(gain, np.repeat(q, _STEPS, axis=1), v * by_step)
    whole = replace(whole, constants=numpy.prepare(varied), feedback=desired)
    calm = replace(whole, wrenches=None)
    bounded = []
    for problem in calm, whole:  # One or two states exceed some entries, none by rounding alone.
        free = rollouts.numpy_rollout(replace(problem, every=1))
        entries = np.concatenate([free.q, free.v], axis=-1)
        largest = np.sort([-entries.min(axis=1), entries.max(axis=1)], axis=1)[:, -3:]
        widest = np.diff(largest, axis=1).argmax(axis=1)[:, None]
        between = np.take_along_axis(0.5 * (largest[:, 1:] + largest[:, :-1]), widest, axis=1)
        bounds = np.where(np.arange(between.shape[2]) % 4 == [[0], [2]], between[:, 0], np.inf)
        bounded.append(replace(problem, bounds=np.array([-bounds[0], bounds[1]])))
    for problem in inputs_alone, some, *bounded:
        for method in get_args(rollouts.Method):
            yield replace(problem, method=method)
