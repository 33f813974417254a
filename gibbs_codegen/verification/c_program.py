"""The C functions of a module as a C program calls them, in either precision.

The back end of `load` calls the same library in whole blocks of doubles. What only a C program uses
is put to work here: last blocks that are not full, `pack` and `unpack`, and single precision.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from gibbs_codegen.interface import DATA, LANES, Signature, module_signatures
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import Comparison, compared, explained, worst
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.evaluation import Evaluation
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import parameter_values
from gibbs_codegen.verification.states import FAR_SINGLE, Sizes, States
from gibbs_codegen.verification.tree import Array, Tree
from gibbs_codegen.verification.variation import determined, variation
from gibbs_codegen.verification.verify import most_states

_HEADER = "the header"
PARTIAL, SINGLE_PRECISION = "last block not full", "single precision"
# Every number of states in a last block, and one of them after a block that is full.
_BATCHES = (3, LANES + 3, 1, 2, 4, 5, 6, 7)
# Least eigenvalue of a mass matrix of unit diagonal that single precision leaves positive.
_DETERMINED = 1e-6
# What no function computes.
_GUARD = -1.2345e30


class CProgram:
    """The functions of a library in one precision, by the conventions of the module's header."""

    def __init__(self, path: str, module: ModuleType, single: bool = False) -> None:
        """`module` is the C back end, for the names and numbers of things."""
        self._library = ctypes.CDLL(path)
        self._module = module
        self._real: type[np.floating[Any]] = np.float32 if single else np.float64
        self._mark = "_float" if single else ""
        self._count = len(module.prepare({})) // ctypes.sizeof(ctypes.c_double)
        number = ctypes.c_float if single else ctypes.c_double
        symbol = f"{module.NAME}_default_constants{self._mark}"
        self.default = np.array((number * self._count).in_dll(self._library, symbol))

    def constants(self, parameters: Sequence[float]) -> Array:
        """What init_constants makes of all parameters. Raises `ValueError` where it refuses."""
        made = np.full(self._count, np.nan, self._real)
        name = f"init_constants{self._mark}"
        if self._call(name, np.array(parameters, self._real), made):
            raise ValueError(f"{name} refuses these parameters")
        return made

    def singly(self, constants: Array) -> Any:
        """The functions for one state, as those of a module."""
        return self._functions(functools.partial(self._one, constants))

    def in_batches(self, constants: Array, batches: Sequence[int]) -> Any:
        """The functions for states in batches of those sizes, as those of a module."""
        return self._functions(functools.partial(self._batches, constants, batches))

    def pack(self, rows: Array) -> Array:
        """What `pack` makes of states (s, width): (blocks, width, LANES)."""
        count, width = rows.shape
        return self._guarded(
            lambda blocks: self._call("pack", count, width, rows.astype(self._real), blocks),
            (-(-count // LANES), width, LANES),
        )

    def unpack(self, blocks: Array, count: int) -> Array:
        """What `unpack` makes of `count` states in blocks."""
        width = blocks.shape[1]
        return self._guarded(
            lambda rows: self._call("unpack", count, width, blocks.astype(self._real), rows),
            (count, width),
        )

    def _functions(self, call: Callable[..., Any]) -> Any:
        data = {name: getattr(self._module, name) for name in DATA}
        functions = {
            signature.name: functools.partial(call, signature)
            for signature in module_signatures(self._module)
        }
        return SimpleNamespace(**data, **functions)

    def _one(self, constants: Array, signature: Signature, *state: Array) -> Any:
        inputs = [np.array(x, self._real) for x in state]
        outputs = [np.full(shape, np.nan, self._real) for shape in signature.shapes]
        self._call(signature.name, constants, *inputs, *outputs)
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _batches(
        self, constants: Array, batches: Sequence[int], signature: Signature, *rows: Array
    ) -> Any:
        parts = []
        first = 0
        for count in batches:
            some = [x[first : first + count] for x in rows]
            parts.append(self._batch(constants, signature, count, some))
            first += count
        outputs = [np.concatenate(part) for part in zip(*parts, strict=True)]
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _batch(
        self, constants: Array, signature: Signature, count: int, rows: Sequence[Array]
    ) -> list[Array]:
        # Unused lanes hold what would be seen if it were read.
        inputs = [in_blocks(x, np.full(x.shape[1], np.nan)).astype(self._real) for x in rows]
        before = [x.tobytes() for x in inputs]
        sizes = [int(np.prod(shape, dtype=int)) for shape in signature.shapes]
        blocks = -(-count // LANES)
        guard = self._real(_GUARD)
        outputs = [np.full((blocks + 1, size, LANES), guard) for size in sizes]
        self._call(f"{signature.name}_batch", constants, count, *inputs, *outputs)
        if any((x[-1] != guard).any() for x in outputs) or before != [x.tobytes() for x in inputs]:
            raise ValueError("writes where it should not")
        return [
            from_blocks(x, count).reshape(count, *shape)
            for x, shape in zip(outputs, signature.shapes, strict=True)
        ]

    def _guarded(self, call: Callable[[Array], object], shape: tuple[int, ...]) -> Array:
        """What a call writes to an array of a shape; NaN everywhere where it writes beyond."""
        guard = self._real(_GUARD)
        room = np.full((shape[0] + LANES, *shape[1:]), guard)
        call(room)
        beyond = (room[shape[0] :] != guard).any()
        return np.full(shape, np.nan) if beyond else room[: shape[0]]

    def _call(self, name: str, *arguments: Array | int) -> int:
        given = [
            ctypes.c_size_t(x) if isinstance(x, int) else ctypes.c_void_p(x.ctypes.data)
            for x in arguments
        ]
        return int(self._library[f"{self._module.NAME}_{name}"](*given))


def in_blocks(rows: Array, unused: Array) -> Array:
    """States (s, width) as blocks (blocks, width, LANES), with `unused` (width,) in other lanes."""
    count, width = rows.shape
    whole = -(-count // LANES)
    padded = np.broadcast_to(unused, (whole * LANES, width)).copy()
    padded[:count] = rows
    blocks: Array = padded.reshape(whole, LANES, width).swapaxes(1, 2).copy()
    return blocks


def from_blocks(blocks: Array, count: int) -> Array:
    """The first states of blocks, one after the other."""
    rows: Array = blocks.swapaxes(1, 2).reshape(-1, blocks.shape[1])[:count]
    return rows


def compare_c_program(path: str, module: ModuleType, robot: Robot, seed: int) -> list[Comparison]:
    """Batches whose last block is not full, and `pack` and `unpack`."""
    program = CProgram(path, module)
    tree = Tree(robot)
    batches = _batches_within(tree)
    states = States.extreme(tree, sum(batches), (seed, 3))
    expected = Expected(NewtonEuler(tree), states)
    evaluation = Evaluation(program.in_batches(program.default, batches))
    rows = explained(expected.compare(evaluation.all(states), PARTIAL), evaluation.faults)
    return [*rows, *_packing(program, states.q)]


def _batches_within(tree: Tree) -> list[int]:
    """Sizes of batches whose states are not too many at once."""
    most = most_states(tree)
    sums = np.cumsum(_BATCHES)
    return [count for count, total in zip(_BATCHES, sums, strict=True) if total <= most] or [1]


def _packing(program: CProgram, states: Array) -> Iterator[Comparison]:
    """States into blocks and back, bit for bit."""
    parts = []
    for count in range(1, min(len(states), 2 * LANES) + 1):
        rows = states[:count]
        blocks = in_blocks(rows, rows[-1])
        packed = compared("pack", _HEADER, program.pack(rows), blocks, 1.0, 0.0)
        back = compared("unpack", _HEADER, program.unpack(blocks, count), rows, 1.0, 0.0)
        parts.append([replace(packed, states=count), back])
    yield from worst(parts)


def compare_single_precision(
    path: str, module: ModuleType, robot: Robot, seed: int
) -> list[Comparison] | str:
    """All functions in single precision; or why the machine cannot be computed in it.

    In batches, with default constants; and state by state, with those of other parameters.
    """
    tree = Tree(robot)
    if not _in_range(Sizes(tree, States.random(tree, 1, seed))):
        return "products of the machine's numbers leave the range of single precision"
    if not determined(robot, _DETERMINED):
        return "rounding to single precision hides what resists an acceleration of the machine"
    program = CProgram(path, module, single=True)
    parts = []
    other = variation(robot, module.PARAMETERS, seed, 0)
    numbers = parameter_values(other)
    try:
        constants = program.constants([numbers[name] for name in module.PARAMETERS])
    except ValueError as error:
        return [Comparison("init_constants", SINGLE_PRECISION, 0, np.inf, 0.0, str(error))]
    batches = _batches_within(tree)
    for machine, functions, singly in (
        (robot, program.in_batches(program.default, batches), False),
        (other, program.singly(constants), True),
    ):
        tree = Tree(machine)
        states = States.extreme(tree, sum(batches), (seed, 4), FAR_SINGLE).rounded()
        evaluation = Evaluation(functions)
        expected = Expected(NewtonEuler(tree), states)
        rows = expected.compare(evaluation.all(states, singly), SINGLE_PRECISION, single=True)
        parts.append(explained(rows, evaluation.faults))
    return worst(parts)


def _in_range(sizes: Sizes) -> bool:
    """Whether products of two sizes are numbers of all digits in single precision."""
    natural = (sizes.matrix, sizes.inertial_effort, sizes.kinetic, sizes.potential, sizes.gibbs)
    numbers = np.concatenate([np.abs(size).ravel() for size in natural])
    single = np.finfo(np.float32)
    least = numbers[numbers > 0.0].min() ** 2 * float(single.eps)
    return bool(least > float(single.tiny) and numbers.max() ** 2 < float(single.max))
