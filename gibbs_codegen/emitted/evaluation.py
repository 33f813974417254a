"""States of a generated NumPy module, and calls of its kernels.

The text of this file stands in every generated module, so it imports nothing but NumPy and the
standard library. The C back end imports it, and so refuses and reports in the same words.
"""

from __future__ import annotations

import functools
import inspect
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.emitted.preparation import MOST_AXES, common_shape, real_numbers

_FLOAT = np.dtype(np.float64)


def state_array(name: str, values: ArrayLike, *shape: int) -> NDArray[np.float64]:
    """An argument of a function as an array, once its axes have been checked.

    Args:
        name: What an error calls the argument.
        values: One state or a batch of states, as NumPy takes them.
        shape: Shape of one state, of no axis, one or two.

    Returns:
        Array (..., width), the entries of one state along the last axis, row by row.

    Raises:
        TypeError, ValueError: As of `real_numbers`.
        ValueError: The last axes have other lengths, or there are too many axes.
    """
    if type(values) is np.ndarray and values.dtype is _FLOAT:
        array = values
    else:
        array = real_numbers(name, values)
    leading = array.shape[: max(array.ndim - len(shape), 0)]
    if array.shape != (*leading, *shape):
        if len(shape) == 1:
            must = f"{shape[0]} entries along its last axis"
        else:
            must = f"{shape[0]} rows of {shape[1]} entries along its last two axes"
        raise ValueError(f"{name} must have {must}, not shape {array.shape}")
    if array.ndim > MOST_AXES:
        raise ValueError(f"{name} must have at most {MOST_AXES} axes, not {array.ndim}")
    return array if len(shape) == 1 else array.reshape(*leading, math.prod(shape))


def sqrt(x: Any) -> Any:
    """Square root of numbers.

    Args:
        x: A number, or an array of them.

    Returns:
        A float for a float of Python, else a number or array of NumPy, which can be divided by
        when it is zero.
    """
    return math.sqrt(x) if type(x) is float else np.sqrt(x)


def atan(x: Any) -> Any:
    """Arctangent of numbers.

    Args:
        x: A number, or an array of them.

    Returns:
        Angles in rad: a float for a float, else an array.
    """
    return math.atan(x) if isinstance(x, float) else np.arctan(x)


def sign(x: Any) -> Any:
    """Sign of numbers; zeros have signs, too.

    Args:
        x: A number, or an array of them.

    Returns:
        1 or -1: a float for a float, else an array.
    """
    return math.copysign(1.0, x) if isinstance(x, float) else np.copysign(1.0, x)


def batch_shape(
    arguments: Mapping[str, NDArray[np.float64]], constants: tuple[int, ...] = ()
) -> tuple[int, ...]:
    """Shape of the batch that the leading axes of arguments broadcast to.

    Args:
        arguments: Arrays (..., width) by their names, each with a width of its own.
        constants: Shape of the batch that the constants have.

    Returns:
        The common shape without the last axis.

    Raises:
        ValueError: The leading axes do not broadcast.
    """
    shapes = {name: array.shape[:-1] for name, array in arguments.items()}
    return common_shape("leading axes", {**shapes, "constants": constants})


class Evaluator:
    """Calls the kernels of a module, for one state on floats and for a batch on whole arrays.

    A kernel takes constants, sine, cosine and the entries of its arguments, and returns the entries
    of its outputs, one after the other.
    """

    def __init__(
        self,
        module: str,
        coordinates: Sequence[str],
        velocities: Sequence[str],
        inputs: Sequence[str],
        frames: Sequence[str],
        default_constants: tuple[Any, ...],
    ) -> None:
        """Take the names that reports use, and the constants of calls that give none."""
        self._report = NotFiniteReport(module, coordinates, velocities, inputs, frames)
        self._default = default_constants

    def __call__(
        self,
        kernel: Callable[..., Sequence[Any]],
        constants: tuple[Any, ...] | None,
        *arguments: NDArray[np.float64],
    ) -> tuple[Sequence[Any], tuple[int, ...]]:
        """Evaluate a kernel, and warn if finite arguments give results that are not finite.

        Args:
            kernel: What computes the entries.
            constants: What `prepare` returned, or None for the default.
            arguments: Arrays (..., width) in the order of the kernel.

        Returns:
            The entries of the outputs, numbers or arrays over the batch, and the batch's shape:
            that which arguments and constants broadcast to.

        Raises:
            TypeError: The constants are not this module's.
            ValueError: The leading axes do not broadcast.
        """
        k = self._default if constants is None else constants
        is_batch = per_state = k is not self._default and self._differ(k)
        for argument in arguments:
            is_batch = is_batch or argument.ndim > 1
        if not is_batch:
            try:
                entries = kernel(k, math.sin, math.cos, *[a.tolist() for a in arguments])
                if math.isfinite(sum(entries)):
                    return entries, ()
            except (ArithmeticError, ValueError):
                # Floats raise where arrays give inf or nan; one state answers as a batch does.
                pass
            return self._evaluate_and_report(kernel, k, arguments, arguments, ()), ()
        named = dict(zip(_argument_names(kernel), arguments, strict=True))
        batch = batch_shape(named, k[0].shape if per_state else ())
        columns = [np.ascontiguousarray(np.moveaxis(argument, -1, 0)) for argument in arguments]
        try:
            with np.errstate(all="raise", under="ignore"):
                return kernel(k, np.sin, np.cos, *columns), batch
        except FloatingPointError:
            return self._evaluate_and_report(kernel, k, columns, arguments, batch), batch

    def composed(
        self,
        function: str,
        compute: Callable[[], tuple[NDArray[np.float64], ...]],
        arguments: Mapping[str, NDArray[np.float64]],
    ) -> tuple[NDArray[np.float64], ...]:
        """Results of a function that calls others, which warns in their place.

        Args:
            function: Its name.
            compute: Calls the other functions, whose warnings are off.
            arguments: The arguments by name, for the warning.

        Returns:
            What `compute` returns, arrays (..., rows).
        """
        batch_shape(arguments)
        with np.errstate(all="ignore"):
            results = compute()
        first = results[0].ndim - 1
        finite = [np.isfinite(result).all(axis=(*range(first, result.ndim),)) for result in results]
        if not np.all(finite):
            self._report(function, arguments, np.logical_and.reduce(finite), 5)
        return results

    def _differ(self, k: tuple[Any, ...]) -> bool:
        """True if constants differ from state to state. Raises TypeError for another module's."""
        alike = isinstance(k, tuple) and len(k) == len(self._default)
        kinds = {*map(type, k)} if alike else {type(k)}
        if alike and kinds <= {float}:
            return False
        if alike and kinds <= {float, np.ndarray} and isinstance(k[0], np.ndarray):
            return True
        raise TypeError("constants must be what this module's prepare() returned")

    def _evaluate_and_report(
        self,
        kernel: Callable[..., Sequence[Any]],
        k: tuple[float, ...],
        columns: Sequence[NDArray[np.float64]],
        arguments: Sequence[NDArray[np.float64]],
        batch: tuple[int, ...],
    ) -> Sequence[Any]:
        """Entries of a kernel's output, after a report of those that are not finite.

        Args:
            kernel, k: What computes the entries, and its constants.
            columns: Arguments (width, ...), entry by entry.
            arguments: The same (..., width), as they were given.
            batch: The shape that leading axes broadcast to.

        Returns:
            The entries.
        """
        with np.errstate(all="ignore"):
            entries = kernel(k, np.sin, np.cos, *columns)
        finite = [np.broadcast_to(np.isfinite(entry), batch) for entry in entries]
        named = dict(zip(_argument_names(kernel), arguments, strict=True))
        self._report(kernel.__name__[1:], named, np.logical_and.reduce(finite), 5)
        return entries


@functools.cache
def _argument_names(kernel: Callable[..., Any]) -> list[str]:
    """Names of a kernel's arguments, without constants, sine and cosine."""
    return [*inspect.signature(kernel).parameters][3:]


class NotFiniteReport:
    """Reports results of a module's functions that are not finite for finite arguments."""

    def __init__(
        self,
        module: str,
        coordinates: Sequence[str],
        velocities: Sequence[str],
        inputs: Sequence[str],
        frames: Sequence[str],
    ) -> None:
        """Take the module's name, those of the entries of q, of v and a, and of u, and frames."""
        self._module = module
        self._labels = {"q": coordinates, "u": inputs, "u_dot": inputs, "h": ["the step"]}
        self._labels["W"] = [frame for frame in frames for _ in range(6)]
        self._velocities = velocities
        self._quaternion = [i for i, q in enumerate(coordinates) if q in ("qx", "qy", "qz", "qw")]

    def __call__(
        self,
        function: str,
        arguments: Mapping[str, NDArray[np.float64]],
        finite: NDArray[np.bool_],
        level: int,
    ) -> None:
        """Report, as np.errstate(invalid=...) has it, states that are lost.

        Args:
            function: Name of the function.
            arguments: Arrays (..., width) by their names.
            finite: Whether all results of a state are finite, of the shape of the batch.
            level: How far up the stack the caller is, for the warning's place.

        Raises:
            FloatingPointError: A state is lost, and np.errstate says "raise".
        """
        lost = ~finite
        for argument in arguments.values():
            lost = lost & np.isfinite(argument).all(axis=-1)
        mode = np.geterr()["invalid"]
        if mode == "ignore" or not lost.any():
            return
        state = np.unravel_index(np.argmax(lost), lost.shape)
        largest, place = 0.0, ""
        cause = "numbers overflow, or nothing resists an acceleration"
        for name, argument in arguments.items():
            values = np.broadcast_to(argument, (*lost.shape, argument.shape[-1]))[state]
            i = int(np.argmax(np.abs(values)))
            if abs(values[i]) >= abs(largest):
                labels = self._labels.get(name.rstrip("01"), self._velocities)
                largest, place = values[i], f"{name} of {labels[i]}"
            turns = self._quaternion if name.rstrip("01") == "q" else []
            if turns and sum(x * x for x in values[turns].tolist()) in (0.0, math.inf):
                cause = "a quaternion has no direction"
        first = ", ".join(map(str, state))
        where = f" in {lost.sum()} of {lost.size} states, first [{first}]," if state else ""
        message = (
            f"{self._module}.{function} is not finite{where} though its arguments are: "
            f"{cause} (largest there: {place}, {largest:g})"
        )
        if mode == "raise":
            raise FloatingPointError(message)
        warnings.warn(message, RuntimeWarning, stacklevel=level)


def shaped(
    entries: Sequence[Any], shape: tuple[int, ...], batch: tuple[int, ...]
) -> NDArray[np.float64]:
    """An output of a function, from its entries.

    Args:
        entries: Numbers, or arrays of the shape of the batch; a number is the same for all states.
        shape: Shape of the output for one state.
        batch: Shape of the batch, () for one state.

    Returns:
        Array (*batch, *shape).
    """
    if not batch:
        return np.array(entries, dtype=np.float64).reshape(shape)
    array = np.empty((*batch, len(entries)))
    for i, entry in enumerate(entries):
        array[..., i] = entry
    return array.reshape(*batch, *shape)
