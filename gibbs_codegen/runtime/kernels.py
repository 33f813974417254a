"""The kernels of a NumPy module, computed by another library.

A kernel is the body of an emitted function: it takes constants, sine, cosine and the entries of its
arguments, and uses nothing but arithmetic and the functions `sqrt`, `atan` and `sign` of its
module. So it also runs on symbols and traced arrays of libraries that have functions of these
names.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType, ModuleType
from typing import Any

from gibbs_codegen.interface import Signature

# Functions that replace those of the module, besides sine and cosine.
ELEMENTARY = ("sqrt", "atan", "sign")


class Kernels:
    """The kernels of a module with the elementary functions of another library."""

    def __init__(self, module: ModuleType, elementary: Mapping[str, Callable[..., Any]]) -> None:
        """Take the kernels of a generated module with the NumPy back end, or of its source alone.

        `elementary`: the library's functions by "sin", "cos" and the names of `ELEMENTARY`.
        """
        self._source = getattr(module, "numpy_module", module)
        self._sine_cosine = elementary["sin"], elementary["cos"]
        self._names = {**vars(self._source), **{name: elementary[name] for name in ELEMENTARY}}

    def outputs(
        self, signature: Signature, constants: Sequence[Any], *arguments: Sequence[Any]
    ) -> list[Sequence[Any]]:
        """Entries of each output of a function, row by row, which is not composed of others.

        Constants are what `constants` or `prepare` gives, and arguments are entries, row by row.
        Python's floats where an entry is a number at every state.
        """
        kernel = self._rebound(f"_{signature.name}")
        entries = iter(kernel(constants, *self._sine_cosine, *arguments))
        return [[*itertools.islice(entries, math.prod(shape))] for shape in signature.shapes]

    def constants(self, parameters: Mapping[str, Any]) -> tuple[Any, ...]:
        """Constants for all of PARAMETERS, which need not be numbers, and are not checked.

        `entries` takes them.
        """
        return self._rebound("_constants")(parameters)[1]

    def _rebound(self, name: str) -> Callable[..., Any]:
        """A function of the module's source that sees the other library's functions."""
        return FunctionType(getattr(self._source, name).__code__, self._names, name)
