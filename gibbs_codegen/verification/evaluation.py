"""Results of a generated module's functions at given states, whatever the functions do there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.interface import FUNCTIONS, module_signatures
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.vectors import Array


class Evaluation:
    """A module with the constants that it is to use, and the results of its functions by name.

    For a function that fails, or does not return an array of its shape, the results are NaN: no
    comparison passes then, and `faults` has the reason.
    """

    def __init__(
        self, module: ModuleType, constants: Any = None, batch: tuple[int, ...] = ()
    ) -> None:
        """Take a module with constants of its `prepare`, or its default ones, of such a batch."""
        self.module = module
        self._leading = batch
        self.faults: dict[str, str] = {}
        self._given = {} if constants is None else {"constants": constants}
        self.signatures = {s.name: s for s in module_signatures(module)}

    def all(self, states: States, singly: bool = False) -> dict[str, Array]:
        """Results of all functions by name, as of `results`, in a batch or state by state.

        `gibbs` is counted from its value at rest, since it is determined up to that.
        """
        values: dict[str, Array] = {}
        for name in self.signatures:
            values |= self.results(name, states, singly)
        resting = self.results("gibbs", replace(states, a=0.0 * states.a), singly)
        values["gibbs"] = values["gibbs"] - resting["gibbs"]
        return values

    def results(self, name: str, states: States, singly: bool = False) -> dict[str, Array]:
        """Results of one function: one under its name; several under that, a point, and theirs."""
        letters = self.signatures[name].arguments
        if "h" in letters:
            states = self.stepping(states)
        arguments = [getattr(states, letter) for letter in letters]
        if singly or not (arguments or self._leading):
            each = [self._arrays(name, [x[i] for x in arguments]) for i in range(len(states))]
            arrays = [np.array(array) for array in zip(*each, strict=True)]
        else:
            arrays = self._arrays(name, arguments)
        outputs = FUNCTIONS[name].outputs
        names = [name] if len(outputs) == 1 else [f"{name}.{output.name}" for output in outputs]
        return dict(zip(names, arrays, strict=True))

    def stepping(self, states: States) -> States:
        """States with the accelerations that fit their inputs, so that steps are short beside them.

        Light links with dampers may have accelerations far larger than random ones, and then longer
        steps would amplify rounding.
        """
        return replace(states, a=self("forward_dynamics", states.q, states.v, states.u))

    def __call__(self, name: str, *arguments: Array) -> Array:
        """The result of a function that has one, for any batch."""
        (array,) = self._arrays(name, arguments)
        return array

    def _arrays(self, name: str, arguments: Sequence[Array]) -> list[Array]:
        shapes = self.signatures[name].shapes
        taken = zip(arguments, self.signatures[name].argument_shapes, strict=True)
        leading = [a.shape[: a.ndim - len(shape)] for a, shape in taken]
        batch = np.broadcast_shapes(self._leading, *leading)
        try:
            with np.errstate(all="ignore"):
                results = self._computed(name, arguments)
        except (Exception, SystemExit) as error:  # Whatever was done to the module.
            self.faults[name] = f"{type(error).__name__}: {error}"
            results = ()
        arrays = []
        for place, shape in enumerate(shapes):
            expected = (*batch, *shape)
            try:
                array = np.asarray(results[place], dtype=float)
            except (IndexError, TypeError, ValueError):
                array = np.empty(0)
            if array.shape != expected:
                self.faults.setdefault(name, f"returns shape {array.shape}, not {expected}")
                array = np.full(expected, np.nan)
            arrays.append(array)
        return arrays

    def _computed(self, name: str, arguments: Sequence[Array]) -> Any:
        """What a function returns, as a sequence of its outputs."""
        results = getattr(self.module, name)(*arguments, **self._given)
        return (results,) if len(self.signatures[name].shapes) == 1 else results
