"""Array programs of one state that flights evaluate again and again, in C where there is a way."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.arrays.contents import owners_of
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.runtime.c_library import CompilerError
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.programs import CompiledProgram

_log = logging.getLogger("gibbs_codegen")
Externals = Mapping[str, Callable[..., Any]]


class EvaluatedProgram:
    """As `CompiledProgram`, in NumPy."""

    def __init__(
        self, vehicle: Vehicle, program: Program, constants: Mapping[str, Any], externals: Externals
    ) -> None:
        modules = dict.fromkeys(constants, vehicle.module)
        self._evaluate, self._fixed = Evaluator(program, modules), (constants, externals)
        shapes = zip(program.names, program.inputs, strict=True)
        self.inputs = {name: np.zeros(x.shape) for name, x in shapes}
        self.outputs: dict[str, Array] = {}

    def run(self) -> None:
        """Compute the outputs of the inputs."""
        with np.errstate(invalid="ignore"):  # C says nothing either.
            self.outputs.update(self._evaluate(self.inputs, *self._fixed))


# One whose `inputs` and `outputs` are arrays by name, which `run` reads and writes.
StateProgram = CompiledProgram | EvaluatedProgram


def state_program(
    vehicle: Vehicle,
    program: Program,
    values: Mapping[str, Any],
    tables: list[Array] | None = None,
    externals: Externals | None = None,
) -> StateProgram:
    """A program, of whose inputs some have values from the start.

    `tables` and `externals` are for what is written by hand, in C and in NumPy.
    """
    constants = dict.fromkeys(owners_of(program), vehicle.constants)
    compiled: StateProgram | None = None
    if Path(vehicle.module.__file__ or "").suffix == ".so":
        try:
            compiled = CompiledProgram(vehicle.module, program, constants, tables or [])
        except (CompilerError, CacheError) as error:
            _log.warning("program %s runs in Python instead of C: %s", program.name, error)
    compiled = compiled or EvaluatedProgram(vehicle, program, constants, externals or {})
    for name, value in values.items():
        if name in compiled.inputs:
            compiled.inputs[name][...] = value
    return compiled
