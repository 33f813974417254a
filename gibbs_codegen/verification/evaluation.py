"""A generated module put to work: all its functions at given states, whatever it does there."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.interface import FUNCTIONS, Signature, module_signatures
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Array


class Evaluation:
    """A module with the constants it is to use; what its functions give, by name.

    A function that fails, or gives what is no array of its shape, gives NaN: no comparison passes
    then, and `faults` has the reason.
    """

    def __init__(self, module: ModuleType, constants: Any = None) -> None:
        self.module = module
        self.faults: dict[str, str] = {}
        self._given = {} if constants is None else {"constants": constants}
        self.signatures = {s.name: s for s in module_signatures(module)}

    def all(self, states: States, singly: bool = False) -> dict[str, Array]:
        """Results of all functions for a batch of states, or for each state by itself.

        `gibbs` is counted from the value at rest, since it is determined up to that.
        """
        values: dict[str, Array] = {}
        for name in self.signatures:
            values |= self.results(name, states, singly)
        call = self._singly if singly else self
        values["gibbs"] = values["gibbs"] - call("gibbs", states.q, states.v, 0.0 * states.a)
        return values

    def results(self, name: str, states: States, singly: bool = False) -> dict[str, Array]:
        """Results of one function for a batch of states, or for each state by itself.

        One array is under the function's name, several are under that name, a point, and their own.
        """
        call = self._singly if singly else self
        results = call(name, *states.arguments("".join(self.signatures[name].arguments)))
        outputs = FUNCTIONS[name].outputs
        if len(outputs) == 1:
            return {name: results}
        return {f"{name}.{o.name}": array for o, array in zip(outputs, results, strict=True)}

    def __call__(self, name: str, *arguments: Array) -> Any:
        """Results of one function."""
        signature = self.signatures[name]
        try:
            with np.errstate(all="ignore"):
                results = getattr(self.module, name)(*arguments, **self._given)
        except (Exception, SystemExit) as error:  # Whatever was done to the module.
            self.faults[name] = f"{type(error).__name__}: {error}"
            results = ()
        batch = np.broadcast_shapes(*(argument.shape[:-1] for argument in arguments))
        return self._shaped(signature, results, batch)

    def _singly(self, name: str, *arguments: Array) -> Any:
        results = [self(name, *state) for state in zip(*arguments, strict=True)]
        if len(self.signatures[name].shapes) == 1:
            return np.array(results)
        return tuple(map(np.array, zip(*results, strict=True)))

    def _shaped(self, signature: Signature, results: Any, batch: tuple[int, ...]) -> Any:
        if len(signature.shapes) == 1:
            results = (results,)
        arrays = []
        for place, shape in enumerate(signature.shapes):
            expected = (*batch, *shape)
            try:
                array = np.asarray(results[place], dtype=float)
            except (IndexError, TypeError, ValueError):
                array = np.empty(0)
            if array.shape != expected:
                if signature.name not in self.faults:
                    self.faults[signature.name] = f"gives shape {array.shape}, not {expected}"
                array = np.full(expected, np.nan)
            arrays.append(array)
        return arrays[0] if len(arrays) == 1 else tuple(arrays)
