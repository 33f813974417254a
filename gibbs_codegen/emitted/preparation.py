"""Numbers that a generated NumPy module takes, and its constants from parameters.

The text of this file stands in every generated module, so it imports nothing but NumPy and the
standard library. The back ends import it, and so refuse in the same words.
"""

from __future__ import annotations

import contextlib
import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

# NumPy had at most 32 before version 2, and results have one more than arguments.
MOST_AXES = 31


def prepared(
    compute: Callable[[dict[str, Any]], tuple[Any, tuple[Any, ...]]],
    defaults: Mapping[str, float],
    folded: Sequence[str],
    parameters: Mapping[str, ArrayLike],
) -> tuple[Any, ...]:
    """Constants of a module for given parameters.

    Args:
        compute: Total mass and constants, from all parameters.
        defaults: All parameters with their defaults.
        folded: Names that are no parameters, since they are zero in the robot file.
        parameters: Values that differ from the defaults, by name: numbers, or arrays (...) with a
            value for each state, which broadcast.

    Returns:
        The constants, all of them finite: floats, and arrays (...) where they differ from state to
            state; the first array has the shape of the whole batch.

    Raises:
        TypeError: What is given is no mapping, or no number.
        ValueError: A name is unknown, a value is not finite, arrays do not broadcast, or the
            constants are not finite.
    """
    if not isinstance(parameters, Mapping):
        words = 'must map names to numbers, such as {"gravity": 3.71}'
        raise TypeError(f"parameters {words}, not {type(parameters).__name__}")
    numbers = {**defaults, **parameters}
    unknown = [name for name in numbers if name not in defaults]
    if unknown:
        raise ValueError("; ".join(_unknown(name, defaults, folded) for name in unknown[:5]))
    values = {name: _finite(name, value) for name, value in numbers.items()}
    shapes = {name: value.shape for name, value in values.items() if value.ndim}
    if not shapes:
        return _constants_of_one(compute, {name: float(value) for name, value in values.items()})
    batch = common_shape("values", shapes)
    with np.errstate(all="ignore"):
        mass, constants = compute(values)
    useful = np.broadcast_to(mass > 0.0, batch)
    for constant in constants:
        useful = useful & np.isfinite(constant)
    if not useful.all():
        # One state by itself says what is wrong with it.
        state, words = first_of("state", ~useful)
        one = {name: float(np.broadcast_to(v, batch)[state]) for name, v in values.items()}
        try:
            _constants_of_one(compute, one)
        except ValueError as error:
            raise ValueError(f"{words}: {error}") from None
    rest = [constant if np.ndim(constant) else float(constant) for constant in constants[1:]]
    return np.array(np.broadcast_to(constants[0], batch)), *rest


def _finite(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """A copy of the values of a parameter as an array, () or (...).

    Raises TypeError and ValueError as `prepared` does.
    """
    numbers = np.array(real_numbers(name, value))
    if numbers.ndim > MOST_AXES:
        raise ValueError(f"{name} must have at most {MOST_AXES} axes, not {numbers.ndim}")
    wrong, right = ~np.isfinite(numbers), "a finite number"
    if name.startswith("constraint_") and name.endswith("_distance"):
        wrong, right = wrong | ~(numbers > 0.0), "a finite number above 0, m"
    if wrong.any():
        place, words = first_of("value", wrong)
        which = f": {words}" if numbers.ndim else ""
        raise ValueError(f"{name}{which} must be {right}, not {numbers[place]}")
    return numbers


def _constants_of_one(
    compute: Callable[[dict[str, Any]], tuple[Any, tuple[Any, ...]]], values: dict[str, float]
) -> tuple[float, ...]:
    """Constants for one value of each parameter. Raises ValueError as `prepared` does."""
    mass, constants = 0.0, tuple[float, ...]()
    with contextlib.suppress(ZeroDivisionError):
        mass, constants = compute(values)
    if not mass > 0.0:
        raise ValueError(
            "these parameters leave an acceleration undetermined: "
            "look for masses and inertias that are zero or negative"
        )
    if not all(map(math.isfinite, constants)):
        raise ValueError("these parameters are too large or too small to compute with")
    return constants


def first_of(kind: str, wrong: NDArray[np.bool_]) -> tuple[tuple[Any, ...], str]:
    """The first of many that is wrong, which an error names without the others.

    Args:
        kind: What they are, in the singular.
        wrong: Array (...), which of them are wrong; at least one is.

    Returns:
        Its index, and words such as "value 17 of 1000".
    """
    index = np.unravel_index(np.argmax(wrong), wrong.shape)
    place = ", ".join(map(str, index))
    return index, f"{kind} {place if len(index) == 1 else f'[{place}]'} of {wrong.size}"


def _unknown(name: str, defaults: Mapping[str, float], folded: Sequence[str]) -> str:
    """The error's words for a name that is no parameter.

    Args:
        name, defaults, folded: As of `prepared`.

    Returns:
        A sentence.
    """
    if name in folded:
        return (
            f"{name} is not a parameter of this module, because it is zero in the robot file; "
            "generate the module with --all-parameters to keep it"
        )
    close = difflib.get_close_matches(str(name), defaults, cutoff=0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else "PARAMETERS has all names"
    return f"unknown parameter {name!r:.80}: {hint}"


def real_numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Real numbers as an array of float64; what only looks like numbers is refused by name.

    Args:
        name: What an error calls the values.
        values: Numbers, or nested sequences of them.

    Returns:
        An array of the shape that NumPy gives the values, copied only if necessary.

    Raises:
        TypeError: An entry is not a real number.
        ValueError: An entry does not fit into a float or is masked, or rows differ in length.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biufO":
            raise TypeError(f"not {array.dtype.type.__name__.rstrip('_0123456789')}")
        if array.dtype.kind == "O":
            # None would become NaN, and text would be read.
            for entry in array.flat:
                if not hasattr(entry, "__float__"):
                    raise TypeError(f"not {type(entry).__name__}")
        if np.ma.is_masked(values):
            raise ValueError("not masked")
        return array.astype(np.float64, copy=False)
    except TypeError as error:
        words = f"{name} must be real numbers: {error}{_place_of_no_number(values)}"
        raise TypeError(words) from None
    except (ValueError, OverflowError) as error:
        words = f"{name} must be real numbers: {error}{_place_of_no_number(values)}"
        raise ValueError(words) from None


def _place_of_no_number(values: ArrayLike) -> str:
    """The place of the first of many values that is no real number; "" for one, or if all are."""
    with contextlib.suppress(ValueError):
        array = np.asarray(values, dtype=object)
        wrong = np.zeros(array.shape, dtype=bool)
        for index, entry in np.ndenumerate(array):
            try:
                math.isnan(entry)
            except (TypeError, OverflowError):
                wrong[index] = True
                return f" ({first_of('value', wrong)[1]})" if array.ndim else ""
    return ""


def common_shape(what: str, shapes: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The shape that arrays broadcast to.

    Args:
        what: What has these shapes, in the plural.
        shapes: By the names of the arrays.

    Returns:
        The common shape.

    Raises:
        ValueError: They do not broadcast.
    """
    try:
        return np.broadcast_shapes(*{*shapes.values()})
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items() if shape)
        raise ValueError(f"{what} do not broadcast: {listed}") from None
