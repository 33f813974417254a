"""Controllers that are array programs: what firmware computes, flown by `simulate`."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.observation import Observation
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.runtime.program_blocks import compile_program

_OBSERVED = {*dir(Observation), *Observation.__annotations__}


class ProgramController:
    """A controller for `simulate` that computes a program, compiled, of what it observes.

    Args:
        program: A program whose inputs have the names of what an `Observation` has, and of which
            the first output is inputs u (nu), or commands of motors and servos.
        module: The robot's module, loaded with `backend="c"`.
        rate: How often it is called, Hz; None for the rate of the scenario.
        single: Whether it computes in single precision.
        others: Values of all other inputs, such as gains, by name.

    Raises:
        UsageError: If an input is neither observed nor given, and as of `compile_program`.
    """

    def __init__(
        self,
        program: Program,
        module: ModuleType,
        rate: float | None = None,
        *,
        single: bool = False,
        **others: Any,
    ) -> None:
        self._seen, self._others = [x for x in program.names if x not in others], others
        if unknown := [name for name in self._seen if name not in _OBSERVED]:
            raise UsageError(
                f"{program.name}: {', '.join(unknown)}: no observation has this name; give its "
                "value by name"
            )
        self._computed = compile_program(program, module, single=single)
        if rate is not None:
            self.rate = rate

    def __call__(self, seen: Observation) -> Array:
        """Inputs u (nu), or commands, for an observation."""
        observed = {name: getattr(seen, name) for name in self._seen}
        u, *_ = self._computed(observed | self._others).values()
        return u.astype(np.float64)
