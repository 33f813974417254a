"""Array programs in C for any number of states, which go in blocks side by side."""

from __future__ import annotations

import ctypes
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.c_text import CProgram
from gibbs_codegen.arrays.contents import externals_of, functions_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.errors import UsageError, require
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.runtime.blocks import Blocks
from gibbs_codegen.runtime.c_backend import default_constants
from gibbs_codegen.runtime.programs import PREFIX, c_text, called, library

Array = NDArray[np.floating[Any]]
# Bytes that may stand on the stack: of blocks of rows, and of what is computed between them.
_ROWS_ON_STACK, _BETWEEN_ON_STACK = 100_000, 4_000_000


class BlockProgram:
    """A program, compiled with the functions of a module that it calls, for any number of states.

    What `compile_program` returns. Called with arrays by the names of the inputs, as
    `gibbs_codegen.arrays.evaluate` takes them, it returns arrays by the names of the outputs. With
    `per_state` constants are rows of numbers, those of a state or of each.
    """

    def __init__(
        self, program: Program, module: ModuleType, *, single: bool = False, per_state: bool = False
    ) -> None:
        self.program = program
        self._module = module
        self._blocks = Blocks.widest(single=single)
        self._text = CProgram(program, PREFIX)
        self.owners = self._text.owners
        # Outputs that all states share have one row.
        self.shared = [self._text.uniform(x) for x in program.outputs.values()]
        self._per_state = per_state
        # Numbers of the blocks that are not on the stack.
        self._apart = 0
        self._function = self._compiled()

    def __call__(
        self, inputs: Mapping[str, Any], constants: Mapping[str, Any] | None = None
    ) -> dict[str, Array]:
        """Arrays by the names of the outputs, with the leading axes of the inputs together.

        `inputs` by name have the states in leading axes, which broadcast; what all states share has
        none. `constants` by owner are what `prepare` of the module returned for all states, or
        those of the robot file. Raises `UsageError` for an input that is missing or unknown, or has
        not the program's shape, and for constants that are not the module's.
        """
        program = self.program
        if absent := [name for name in program.names if name not in inputs]:
            raise UsageError(f"{program.name}: no value for {', '.join(absent)}")
        if unknown := [name for name in inputs if name not in program.names]:
            raise UsageError(f"{program.name} has no inputs {', '.join(map(str, unknown))}")
        pairs = list(zip(program.names, program.inputs, strict=True))
        arrays = [self._checked(name, x, inputs[name]) for name, x in pairs]
        leads = [a.shape[: a.ndim - len(x.shape)] for a, (_, x) in zip(arrays, pairs, strict=True)]
        try:
            batch = np.broadcast_shapes(*leads)
        except ValueError:
            counts = " and ".join(map(str, dict.fromkeys(leads)))
            raise UsageError(f"{program.name}: {counts} states do not go together") from None
        rows = [
            np.ascontiguousarray(
                array
                if lead == batch or math.prod(lead) == 1
                else np.broadcast_to(array, (*batch, *x.shape))
            )
            for array, lead, (_, x) in zip(arrays, leads, pairs, strict=True)
        ]
        results = {
            name: np.empty(x.shape if shared else (*batch, *x.shape), self._blocks.real)
            for (name, x), shared in zip(program.outputs.items(), self.shared, strict=True)
        }
        blocks = [*rows, *self._owned(constants or {})]
        widths = [
            0 if array.size == x.size else x.size
            for array, x in zip(rows, program.inputs, strict=True)
        ]
        self.run(
            math.prod(batch),
            self.distances([*widths, *[0] * len(self.owners)]),
            [array.ctypes.data for array in (*blocks, *results.values())],
        )
        return results

    def distances(self, widths: Sequence[int]) -> Any:
        """How far apart rows of states are in all that is given, 0 for what they share."""
        return (ctypes.c_size_t * len(widths))(*widths)

    def run(self, count: int, distances: Any, addresses: Sequence[int]) -> None:
        """Compute `count` states.

        `addresses` are of rows, of inputs and then of constants of the owners, so far apart as
        `distances` has them, and of results.
        """
        if self._apart:
            memory = self._blocks.filled(self._apart, self._blocks.lanes)
            addresses = [*addresses, memory.ctypes.data]
        self._function(count, distances, self._pointers(*addresses))

    @cached_property
    def default(self) -> Array:
        """Constants of the robot file."""
        return default_constants(self._module).astype(self._blocks.real)

    def _owned(self, constants: Mapping[str, Any]) -> list[Array]:
        """Constants of each owner, those of the robot file where none are given."""
        if unknown := [owner for owner in constants if owner not in self.owners]:
            raise UsageError(
                f"{self.program.name}: constants are of {' and '.join(self.owners) or 'none'}"
                f", not of {', '.join(map(str, unknown))}"
            )
        for owner, values in constants.items():
            if not isinstance(values, bytes) or len(values) != 8 * self.default.size:
                raise UsageError(
                    f"{self.program.name}: constants of {owner} must be what prepare of "
                    f"{self._module.NAME}, loaded for C, returns for numbers, the same for all "
                    "states"
                )
        converted = {x: np.frombuffer(y).astype(self._blocks.real) for x, y in constants.items()}
        return [converted.get(owner, self.default) for owner in self.owners]

    def _checked(self, name: str, x: Node, value: Any) -> Array:
        array = np.asarray(value, dtype=self._blocks.real)
        axes = array.ndim - len(x.shape)
        if axes < 0 or array.shape[axes:] != x.shape or (x.is_uniform and axes):
            wanted = "it is shared by all states" if x.is_uniform else "leading axes are states"
            raise UsageError(f"{name} has the shape {array.shape}, not {x.shape}; {wanted}")
        return array

    def _compiled(self) -> Any:
        program, name = self.program, self._module.NAME
        if by_hand := sorted(externals_of(program)):
            raise UsageError(
                f"{program.name}: {', '.join(by_hand)} is written by hand and cannot be "
                "compiled; evaluate the program with NumPy"
            )
        if others := {robot for robot, _ in functions_of(program)} - {name}:
            raise UsageError(
                f"{program.name} calls functions of {', '.join(sorted(others))}, not of {name}"
            )
        texts = self._text, *(CProgram(x, PREFIX) for x in program.inner)
        between = self._blocks.real.itemsize * sum(x.stack(self._blocks.lanes) for x in texts)
        if between > _BETWEEN_ON_STACK:
            raise UsageError(
                f"{program.name}: values between its inputs and outputs take {between / 1e6:.3g} "
                f"MB, more than {_BETWEEN_ON_STACK / 1e6:.3g} MB of the stack; split it into "
                "several programs"
            )
        robot, has_rows = Functions(self._module), self._per_state
        arrays = len(program.inputs) + len(self.owners) + len(program.outputs)
        self._pointers = ctypes.c_void_p * (arrays + 1)
        source = c_text(
            [program], robot, self._blocks.lanes, per_state=has_rows, engine=self._through_rows()
        )
        made = library(
            self._module,
            called([program]),
            {f"_{program.name}.c": source},
            f"the program {program.name}",
            single=self._blocks.single,
            per_state=has_rows,
        ).run_rows
        made.argtypes = ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p
        made.restype = None
        return made

    def _through_rows(self) -> list[str]:
        """The function that takes the program through rows, in blocks of states."""
        inputs, results = self.program.inputs, self.program.outputs.values()
        rows = [(f"given_{k}", x.size, x.is_uniform, x.shape) for k, x in enumerate(inputs)]
        rows += [(owner, self.default.size, not self._per_state, (0,)) for owner in self.owners]
        sizes: dict[str, int] = {}
        before, after, passed = [], [], []
        for place, (name, size, is_shared, shape) in enumerate(rows):
            array = f"arrays[{place}]" if is_shared else name
            if not is_shared:
                sizes[name] = max(size, 1)
                before.append(f"take(arrays, distances, {place}, first, filled, {size}, {name});")
            passed.append(array if shape else f"*{array}")
        constants = passed[len(inputs) :]
        passed[len(inputs) :] = []
        for place, (x, is_shared) in enumerate(zip(results, self.shared, strict=True), len(rows)):
            array = f"arrays[{place}]" if is_shared else f"made_{place}"
            if not is_shared:
                sizes[array] = max(x.size, 1)
                after.append(
                    f"give({array}, filled, {x.size}, arrays[{place}] + first * {x.size});"
                )
            passed.append(array)
        passed[:0] = [f"(const Constants *){array}" for array in constants]
        arrays = [f"number {name}[{size}];" for name, size in sizes.items()]
        total = sum(sizes.values())
        if total * self._blocks.lanes * self._blocks.real.itemsize > _ROWS_ON_STACK:
            memory = f"(number *)arrays[{len(rows) + len(self.shared)}]"
            begins = itertools.accumulate(sizes.values(), initial=0)
            pairs = zip(sizes, begins, strict=False)
            arrays = [f"number *const {name} = {memory} + {begin};" for name, begin in pairs]
            self._apart = total
        return [
            "typedef struct {",
            "    const real *entries;",
            "    size_t by_state, by_step;",
            "} Rows;",
            c_source("rows.c"),
            *_ROWS,
            "void run_rows(",
            "    const size_t count, const size_t *distances, real *const *arrays)",
            "{",
            *(f"    {line}" for line in arrays),
            "    size_t first = 0;",
            "    do { /* Once without states, for what they share. */",
            "        const int filled = count - first < LANES ? (int)(count - first) : LANES;",
            *(f"        {line}" for line in before),
            f"        {self._text.name}({', '.join(passed)});",
            *(f"        {line}" for line in after),
            "        first += LANES;",
            "    } while (first < count);",
            "}",
        ]


# Whole blocks by themselves: how many lanes they have is then known where this is compiled.
_ROWS = """\
static void take(
    real *const *arrays,
    const size_t *distances,
    const int place,
    const size_t first,
    const int filled,
    const int width,
    number *block)
{
    const Rows rows = rows_of(arrays[place], distances[place]);
    if (filled == LANES) {
        load_rows(rows, R(0.0), first, LANES, 0, width, block);
    } else {
        load_rows(rows, R(0.0), first, filled, 0, width, block);
    }
}

static void give(const number *block, const int filled, const int width, real *rows)
{
    if (filled == LANES) {
        store_rows(block, LANES, width, (size_t)width, rows);
    } else {
        store_rows(block, filled, width, (size_t)width, rows);
    }
}
""".splitlines()


def compile_program(program: Program, module: ModuleType, *, single: bool = False) -> BlockProgram:
    """Compile an array program with the functions of a module that it calls.

    Args:
        program: The program, of calls of this module's functions.
        module: The module, loaded with `backend="c"`.
        single: Whether it computes in single precision.

    Returns:
        A function of a dict of arrays by the names of the inputs, with the states in leading axes,
        which returns a dict of the outputs. A second dict has other constants by owner, as
        `prepare` of this module returned them.

    Raises:
        UsageError: If the module was loaded for another back end, or the program has external
            functions.
        MissingFunctionError: If the module was generated without a function.
    """
    _require_c(module, "c")
    return BlockProgram(program, module, single=single)


def differentiable(program: Program, module: ModuleType) -> Callable[..., Any]:
    """A function of tensors that computes an array program in C, and that PyTorch differentiates.

    Backward is `gradient` of the program, compiled too, and forward its derivative
    along a direction.

    Args:
        program: The program, of calls of this module's functions.
        module: The module, loaded with `backend="torch"` or `backend="c"`, and generated with the
            derivatives of what the program calls.

    Returns:
        A function of the inputs, in their order or by name: tensors `(..., *shape)`, or numbers,
        with leading axes, which broadcast, also of those that are uniform in the program.
        `constants` by owner are tensors of a torch module's `prepare`. It returns a tensor
        `(..., *shape)`, or a tuple of one for each output. Coordinates are plain entries,
        of a quaternion of any length.

    Raises:
        UsageError: If the module was loaded for another back end, PyTorch is not installed, or the
            program has external functions.
        MissingFunctionError: If the module was generated without a function.
    """
    require("torch", "differentiable")
    from gibbs_codegen.runtime.torch_backend import TensorFunction, of_entries

    in_c = getattr(module, "in_c", module)
    _require_c(in_c, "torch")
    return TensorFunction(of_entries(program), in_c, f"program {program.name}")


def _require_c(module: ModuleType, backend: str) -> None:
    """Raise `UsageError` for a module without compiled functions; one for `backend` has them."""
    if getattr(module, "backend", "numpy") != "c":
        raise UsageError(
            f"{module.NAME}: programs are compiled with the module's C functions; load the "
            f'module with backend="{backend}"'
        )
