"""Array programs in C for any number of states, which go in blocks side by side."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.c_text import CProgram
from gibbs_codegen.arrays.contents import externals_of, functions_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.errors import UsageError
from gibbs_codegen.runtime.blocks import Blocks
from gibbs_codegen.runtime.programs import c_text, called, library

Array = NDArray[np.floating[Any]]


class BlockProgram:
    """A program, compiled with the functions of a module that it calls, for any number of states.

    What `compile_program` returns. Called with arrays by the names of the inputs, as
    `gibbs_codegen.arrays.evaluate` takes them, it returns arrays by the names of the outputs.
    """

    def __init__(self, program: Program, module: ModuleType, *, single: bool = False) -> None:
        self.program = program
        self._module = module
        self._blocks = Blocks.widest(single=single)
        self._text = CProgram(program)
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
        arrays = {name: self._checked(name, x, inputs[name]) for name, x in pairs}
        leads = [arrays[n].shape[: arrays[n].ndim - len(x.shape)] for n, x in pairs]
        try:
            batch = np.broadcast_shapes(*leads)
        except ValueError:
            counts = " and ".join(map(str, dict.fromkeys(leads)))
            raise UsageError(f"{program.name}: {counts} states do not go together") from None
        count = math.prod(batch)
        # One block at least, for what all states share.
        lanes, blocks = self._blocks.lanes, max(self._blocks.count(count), 1)
        laid = [self._laid(arrays[name], x, batch) for name, x in pairs]
        shapes = {
            name: (x.size,) if self._text.uniform(x) else (blocks, x.size, lanes)
            for name, x in program.outputs.items()
        }
        cells = {name: self._blocks.filled(*shape) for name, shape in shapes.items()}
        owned = self._owned(constants or {})
        arrays_laid = (*laid, *cells.values())
        pointers = (ctypes.c_void_p * len(arrays_laid))(*(x.ctypes.data for x in arrays_laid))
        pointers_of_owners = (ctypes.c_void_p(x.ctypes.data) for x in owned)
        self._function(ctypes.c_size_t(blocks), pointers, *pointers_of_owners)
        results = {}
        for name, x in program.outputs.items():
            if self._text.uniform(x):
                results[name] = cells[name].reshape(x.shape)
            else:
                results[name] = self._blocks.to_rows(cells[name], count).reshape((*batch, *x.shape))
        return results

    @cached_property
    def _default(self) -> bytes:
        """Constants of the robot file; to prepare them takes as long as a thousand states."""
        constants: bytes = self._module.prepare({})
        return constants

    def _owned(self, constants: Mapping[str, Any]) -> list[Array]:
        """Constants of each owner, those of the robot file where none are given."""
        default = self._default
        if unknown := [owner for owner in constants if owner not in self._text.owners]:
            raise UsageError(
                f"{self.program.name}: constants are of {' and '.join(self._text.owners) or 'none'}"
                f", not of {', '.join(map(str, unknown))}"
            )
        for owner, values in constants.items():
            if not isinstance(values, bytes) or len(values) != len(default):
                raise UsageError(
                    f"{self.program.name}: constants of {owner} must be what prepare of "
                    f"{self._module.NAME}, loaded for C, returns for numbers, the same for all "
                    "states"
                )
        owned = (constants.get(owner, default) for owner in self._text.owners)
        return [np.frombuffer(values).astype(self._blocks.real) for values in owned]

    def _checked(self, name: str, x: Node, value: Any) -> Array:
        array = np.asarray(value, dtype=self._blocks.real)
        axes = array.ndim - len(x.shape)
        if axes < 0 or array.shape[axes:] != x.shape or (x.is_uniform and axes):
            wanted = "it is shared by all states" if x.is_uniform else "leading axes are states"
            raise UsageError(f"{name} has the shape {array.shape}, not {x.shape}; {wanted}")
        return array

    def _laid(self, array: Array, x: Node, batch: tuple[int, ...]) -> Array:
        """An input as C takes it: in blocks, the last cells up with its last state."""
        if x.is_uniform:
            return np.ascontiguousarray(array.ravel())
        rows = np.broadcast_to(array, (*batch, *x.shape)).reshape(math.prod(batch), x.size)
        return self._blocks.of_rows(rows if len(rows) else np.zeros((1, x.size)))

    def _compiled(self) -> Any:
        program, name = self.program, self._module.NAME
        if by_hand := sorted(externals_of(program)):
            raise UsageError(
                f"{program.name}: {', '.join(by_hand)} is external, which is not compiled here; "
                "evaluate the program with NumPy"
            )
        if others := {robot for robot, _ in functions_of(program)} - {name}:
            raise UsageError(
                f"{program.name} calls functions of {', '.join(sorted(others))}, not of {name}"
            )
        source = (
            c_text([program], Functions(self._module), self._blocks.lanes) + self._through_blocks()
        )
        sources = {f"_{program.name}.c": source}
        single = self._blocks.single
        functions, what = called([program]), f"the program {program.name}"
        blocks = library(self._module, functions, sources, what, single=single).program_blocks
        blocks.restype = None
        return blocks

    def _through_blocks(self) -> str:
        """The function that takes the program through blocks of states, one after the other."""
        text, operands = self._text, []
        for place, x in enumerate(self.program.inputs):
            kind = "real" if x.is_uniform else "number"
            at = f"(const {kind} *)arrays[{place}]"
            at = at if x.is_uniform else f"({at} + block * {x.size})"
            operands.append(f"*{at}" if x.shape == () else at)
        first = len(operands)
        for place, x in enumerate(self.program.outputs.values()):
            is_uniform = text.uniform(x)
            at = f"({'real' if is_uniform else 'number'} *)arrays[{first + place}]"
            operands.append(at if is_uniform else f"{at} + block * {x.size}")
        constants = "".join(f", const Constants *{owner}" for owner in text.owners)
        arguments = ", ".join([*text.owners, *operands])
        return (
            f"\nvoid program_blocks(const size_t blocks, void *const *arrays{constants})\n"
            "{\n"
            "    for (size_t block = 0; block < blocks; ++block) {\n"
            f"        program_{text.name}({arguments});\n"
            "    }\n"
            "}\n"
        )


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
    if getattr(module, "backend", "numpy") != "c":
        raise UsageError(
            f"{module.NAME}: a program is compiled with a module's C functions; load it with "
            'backend="c", where there is a C compiler'
        )
    return BlockProgram(program, module, single=single)
