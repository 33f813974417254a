"""Exact derivatives of a module's functions: its NumPy kernels, a complex step away.

f(x + iε) = f(x) + iε f′(x), and nothing is subtracted, so that no digit is lost and no step is to
be chosen (Squire and Trapp, 1998). To first order a displacement δ of q in the tangent space leads
to q + `coordinate_rates`(q, δ). Second derivatives come from complex steps of dual numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.interface import ARGUMENTS, module_signatures
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.kernels import Kernels
from gibbs_codegen.verification.parameters import parameter_values
from gibbs_codegen.verification.vectors import Array

_STEP = 1e-40


class Dual:
    """Arrays that change along a line: `value` + `slope` d, where d² = 0."""

    __array_ufunc__ = None  # NumPy's arrays leave sums and products with this to it.

    def __init__(self, value: Any, slope: Any) -> None:
        self.value, self.slope = value, slope

    def __getitem__(self, place: Any) -> Dual:
        value, slope = np.broadcast_arrays(self.value, self.slope)
        return Dual(value[place], slope[place])

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __add__(self, other: Any) -> Dual:
        other = _dual(other)
        return Dual(self.value + other.value, self.slope + other.slope)

    def __sub__(self, other: Any) -> Dual:
        return self + _dual(other) * -1.0

    def __mul__(self, other: Any) -> Dual:
        other = _dual(other)
        slope = self.slope * other.value + self.value * other.slope
        return Dual(self.value * other.value, slope)

    def __truediv__(self, other: Any) -> Dual:
        other = _dual(other)
        quotient = self.value / other.value
        return Dual(quotient, (self.slope - quotient * other.slope) / other.value)

    def __rsub__(self, other: Any) -> Dual:
        return Dual.__sub__(_dual(other), self)

    def __rtruediv__(self, other: Any) -> Dual:
        return Dual.__truediv__(_dual(other), self)

    __radd__, __rmul__ = __add__, __mul__

    def sum(self, axis: int) -> Dual:
        """The sum along an axis."""
        return Dual(self.value.sum(axis), self.slope.sum(axis))


def _dual(number: Any) -> Dual:
    return number if isinstance(number, Dual) else Dual(number, 0.0)


def _of_duals(function: Callable[[Any], Any], slope: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function of complex numbers as one of dual numbers as well, given its derivative."""

    def of_any(x: Any) -> Any:
        if isinstance(x, Dual):
            return Dual(function(x.value), slope(x.value) * x.slope)
        return function(x)

    return of_any


_ELEMENTARY = {
    "sin": _of_duals(np.sin, np.cos),
    "cos": _of_duals(np.cos, lambda x: -np.sin(x)),
    "sqrt": _of_duals(np.sqrt, lambda x: 0.5 / np.sqrt(x)),
    "atan": _of_duals(np.arctan, lambda x: 1.0 / (1.0 + x * x)),
    "sign": _of_duals(lambda x: np.copysign(1.0, np.real(x)), lambda _: 0.0),
}

# A function of arguments (…, width), which may be complex or dual, with a result (…, rows).
Function = Callable[..., Any]
# Arguments (s, width) by their names.
Arguments = Mapping[str, Array]


class ComplexSteps:
    """The kernels of a module with a robot's parameters, and derivatives of their results.

    What a kernel that fails would give is not a number: no comparison passes then.
    """

    def __init__(self, module: ModuleType, robot: Robot) -> None:
        values = parameter_values(robot)
        self._values: dict[str, Any] = {name: values[name] for name in module.PARAMETERS}
        self._kernels = Kernels(module, _ELEMENTARY)
        self._width = len(module.VELOCITIES)
        self._free = len(module.COORDINATES) - len(robot.wheels)  # Angles of these follow.
        self._signatures = {s.name: s for s in module_signatures(module)}

    def __call__(self, name: str, *arguments: Any) -> Any:
        """The result (…, *shape) of a function for any batch; of several, (…, rows) in a row."""
        shapes = [_dual(x).value.shape for x in arguments]
        batch = np.broadcast_shapes(*(shape[:-1] for shape in shapes))
        pairs = zip(arguments, shapes, strict=True)
        columns = [[x[..., i] for i in range(size[-1])] for x, size in pairs]
        signature = self._signatures[name]
        one, *others = signature.shapes
        shape = (*batch, *(one if not others else (sum(map(math.prod, signature.shapes)),)))

        def stacked(parts: Sequence[Any]) -> Array:
            whole = [np.broadcast_to(part, batch) for part in parts]
            return np.stack(whole, axis=-1).reshape(shape)

        try:
            with np.errstate(all="ignore"):
                constants = self._kernels.constants(self._values)
                entries = [*chain(*self._kernels.outputs(signature, constants, *columns))]
                if not any(isinstance(entry, Dual) for entry in entries):
                    return stacked(entries)
                duals = [_dual(entry) for entry in entries]
                return Dual(stacked([x.value for x in duals]), stacked([x.slope for x in duals]))
        except Exception:  # Whatever was done to the module.
            return np.full(shape, np.nan)

    def jacobian(self, function: Function, at: Arguments) -> Array:
        """Derivatives (s, rows …, columns) by all arguments, one after the other.

        Those by coordinates are along `VELOCITIES`, in the tangent space.
        """
        moved = self._moved({name: x[:, None] for name, x in at.items()}, 1j * _STEP)
        return np.moveaxis(function(**moved).imag, 1, -1) / _STEP

    def hessian(self, function: Function, at: Arguments, w: Array) -> Array:
        """Second derivatives (s, columns, columns) of a result (…, rows) weighed by w (s, rows).

        Displacements of q follow one another; half the sum of both orders belongs to the two at
        once.
        """
        there = {name: x[:, None, None] for name, x in at.items()}
        along = self._moved({name: x[:, 0] for name, x in there.items()}, Dual(0.0, 1.0))
        along = {name: x[:, :, None] for name, x in along.items()}
        slopes = function(**self._moved(along, 1j * _STEP)).slope.imag / _STEP
        second = np.einsum("sijk,sk->sij", slopes, w)
        return 0.5 * (second + np.swapaxes(second, 1, 2))

    def by_parameters(self, function: Function, at: Arguments) -> Array:
        """Derivatives (s, rows …, np) by the module's parameters."""
        values, count = self._values, len(self._values)
        moved = zip(values.items(), 1j * _STEP * np.eye(count), strict=True)
        self._values = {name: value + step for (name, value), step in moved}
        derivatives = function(**{x: np.repeat(y[:, None], count, axis=1) for x, y in at.items()})
        self._values = values
        return np.moveaxis(derivatives.imag, 1, -1) / _STEP

    def displacements(self, q: Array, rates: Array) -> Array:
        """Displacements (s, nv, columns) in the tangent space that change q (s, nq) at `rates`."""
        slopes = self("coordinate_rates", q[:, None], np.eye(self._width)[None])
        rows = slice(self._free)
        return np.linalg.pinv(np.swapaxes(slopes, 1, 2)[:, rows]) @ rates[:, rows]

    def _moved(self, at: Mapping[str, Any], unit: Any) -> dict[str, Any]:
        """Arguments (…, 1, width) moved by `unit` along each column, (…, columns, width)."""
        widths = [
            self._width if ARGUMENTS[name].is_coordinates else _dual(x).value.shape[-1]
            for name, x in at.items()
        ]
        steps = np.split(np.eye(sum(widths)), np.cumsum(widths)[:-1], axis=-1)
        moved = {}
        for (name, x), step in zip(at.items(), steps, strict=True):
            if ARGUMENTS[name].is_coordinates:
                step = self("coordinate_rates", x, step)
            moved[name] = x + step * unit
        return moved
