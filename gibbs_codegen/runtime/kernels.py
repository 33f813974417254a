"""The kernels of a NumPy module, computed by another library.

A kernel is the body of an emitted function: it takes constants, sine, cosine and the entries of its
arguments, and uses nothing but arithmetic and the functions `sqrt`, `atan` and `sign` of its
module. So it also runs on symbols and traced arrays of libraries that have functions of these
names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Objects = NDArray[np.object_]
# What replaces the functions of the module, besides sine and cosine.
ELEMENTARY = ("sqrt", "atan", "sign")


def objects(values: Sequence[Any]) -> Objects:
    """An array of one axis of values that NumPy would take for arrays, if it were left to it."""
    array = np.empty(len(values), dtype=object)
    for i, value in enumerate(values):
        array[i] = value
    return array


class Kernels:
    """The kernels of a module with the elementary functions of another library."""

    def __init__(self, module: ModuleType, elementary: Mapping[str, Callable[..., Any]]) -> None:
        """Take the kernels of a generated module with the NumPy back end, or of its source alone.

        `elementary`: the library's functions by "sin", "cos" and the names of `ELEMENTARY`.
        """
        self._source = getattr(module, "numpy_module", module)
        self._sine_cosine = elementary["sin"], elementary["cos"]
        self._names = {**vars(self._source), **{name: elementary[name] for name in ELEMENTARY}}

    def entries(
        self, function: str, constants: Sequence[Any], *arguments: Sequence[Any]
    ) -> Sequence[Any]:
        """Entries of all outputs of a function, one output after the other, row by row.

        The function is not composed of others, constants are what `constants` or `prepare` gives,
        and arguments are entries, row by row. Python's floats where an entry is a number at every
        state.
        """
        kernel = self._rebound(f"_{function}")
        return kernel(constants, *self._sine_cosine, *arguments)

    def outputs(
        self,
        function: str,
        constants: Sequence[Any],
        *arguments: Objects,
        array: Callable[[Sequence[Any]], Objects] = objects,
    ) -> list[Objects]:
        """Outputs of any function for one state, also of one that is composed of others.

        Arguments are arrays of the library's values; `array` makes arrays of one axis of the
        entries of the functions in between. Python's floats where an entry is a number at every
        state.
        """
        names = self.source()
        # What takes and returns floats. Everything between them stands in the module.
        names["state_array"] = lambda _, values, *shape: values.reshape(-1)
        names["_evaluate"] = lambda kernel, k, *entries: (
            kernel(k, *self._sine_cosine, *entries),
            (),
        )
        names["shaped"] = lambda entries, shape, _: array(entries).reshape(shape)
        outputs = names[function](*arguments, constants=constants)
        return list(outputs) if isinstance(outputs, tuple) else [outputs]

    def source(self) -> dict[str, Any]:
        """What stands in the module's source, by names.

        Its functions see what is put in place of others.
        """
        names = self._names.copy()
        for name, value in vars(self._source).items():
            if isinstance(value, FunctionType) and value.__module__ == self._source.__name__:
                names[name] = FunctionType(value.__code__, names, name, value.__defaults__)
        names |= {name: self._names[name] for name in ELEMENTARY}
        names["_composed"] = lambda _, compute, __: compute()  # Only numbers can be not finite.
        return names

    def constants(self, parameters: Mapping[str, Any]) -> tuple[Any, ...]:
        """Constants for all of PARAMETERS, which need not be numbers, and are not checked.

        `entries` takes them.
        """
        return self._rebound("_constants")(parameters)[1]

    def _rebound(self, name: str) -> Callable[..., Any]:
        """A function of the module's source that sees the other library's functions."""
        return FunctionType(getattr(self._source, name).__code__, self._names, name)
