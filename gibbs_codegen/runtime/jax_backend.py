"""The JAX back end: the functions of a generated module as pure functions of JAX's arrays."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gibbs_codegen.emitted.evaluation import batch_shape, state_array
from gibbs_codegen.emitted.preparation import common_shape, real_numbers
from gibbs_codegen.interface import FUNCTIONS, Signature, module_signatures
from gibbs_codegen.runtime.jax_functions import Functions
from gibbs_codegen.runtime.loaded_module import LoadedModule


def jax_module(module: ModuleType, folder: Path) -> ModuleType:
    """The functions and constants of a module, computed by JAX; its files are in `folder`."""
    functions = Functions(module, folder)
    made = LoadedModule(module, "jax")
    made.prepare = _prepare(module, functions)  # type: ignore[attr-defined]
    # Functions that are composed of others are those of the source, which see JAX's others.
    source = functions.kernels.source()
    source["np"] = jnp
    for signature in module_signatures(module):
        name = signature.name
        composed = FUNCTIONS[name].composed
        body = source[f"_{name}"] if composed else functools.partial(functions, name)
        source[name] = _function(module, functions, signature, body)
        setattr(made, name, source[name])
    return made


def _prepare(module: ModuleType, functions: Functions) -> Callable[[Mapping[str, Any]], Any]:
    """The function `prepare` of a module."""

    def prepare(parameters: Mapping[str, Any]) -> Any:
        defaults = module.PARAMETERS
        values = {**parameters}
        # What is traced has no values, of which NumPy would say what is wrong with them.
        known = not any(isinstance(value, jax.core.Tracer) for value in values.values())
        module.prepare(values if known else {name: defaults.get(name, 0.0) for name in values})
        given = _arrays(values, values.values())
        shapes = {name: value.shape for name, value in zip(values, given, strict=True)}
        shape = common_shape("values", shapes)
        every = {**defaults, **dict(zip(values, given, strict=True))}
        dtype = given[0].dtype if given else jnp.result_type(float)
        entries = [*functions.kernels.constants(every), *every.values()]
        return jnp.stack([jnp.broadcast_to(jnp.asarray(e, dtype), shape) for e in entries], -1)

    prepare.__doc__ = """Constants of the other functions for given parameters.

    `parameters` maps names of PARAMETERS to numbers or to arrays, which broadcast; a name that is
    left out keeps its default. The constants are an array (..., size), to be passed on as it is,
    which JAX differentiates by the parameters. Values that are traced are not checked. Raises
    TypeError and ValueError as the NumPy module does.
    """
    prepare.__module__ = module.__name__
    return prepare


def _function(
    module: ModuleType,
    functions: Functions,
    signature: Signature,
    body: Callable[..., Sequence[Any]],
) -> Callable[..., Any]:
    """A function of a module that takes what that of the NumPy module does, and refuses others.

    `body` takes constants and arguments (..., width), and returns the outputs.
    """
    like = getattr(module, signature.name)
    size = len(module.prepare({})) + len(module.PARAMETERS)

    @functools.wraps(like)
    def function(*arguments: Any, **named: Any) -> Any:
        try:
            given = inspect.signature(like).bind(*arguments, **named).arguments
        except TypeError as error:
            raise TypeError(f"{signature.name}() {error}") from None
        operands = [
            functions.tangents.normalised(name, array)
            for name, array in zip(signature.arguments, _states(signature, given), strict=True)
        ]
        constants = given.get("constants")
        last = None if constants is None else _constants(constants, size, operands)
        by_name = dict(zip(signature.arguments, operands, strict=True))
        batch = batch_shape(by_name, () if last is None else last.shape[:-1])
        operands = [_with_axes(array, len(batch)) for array in operands]
        last = None if last is None else _with_axes(last, len(batch))
        shaped = [
            output.reshape(*batch, *shape)
            for output, shape in zip(body(last, *operands), signature.shapes, strict=True)
        ]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    return function


def _with_axes(array: Any, axes: int) -> Any:
    """An array (…, width) with so many axes before the last, those that are new of length 1."""
    return array.reshape((1,) * (axes + 1 - array.ndim) + array.shape)


def _constants(constants: Any, size: int, arguments: Sequence[Any]) -> Any:
    """Constants (..., size) of a call, of the precision of its arguments.

    Raises `TypeError` if they are not this module's, or as `_arrays` does.
    """
    if getattr(constants, "shape", ())[-1:] != (size,):
        raise TypeError("constants must be what this module's prepare() returned")
    (array,) = _arrays(["constants"], [constants])
    return jnp.asarray(array, arguments[0].dtype) if arguments else array


def _states(signature: Signature, given: Mapping[str, Any]) -> list[Any]:
    """Arguments of a function as arrays (..., width) of one precision, entries row by row.

    Raises what `state_array` does.
    """
    arrays = _arrays(signature.arguments, [given[name] for name in signature.arguments])
    found = []
    for name, array, shape in zip(
        signature.arguments, arrays, signature.argument_shapes, strict=True
    ):
        leading = array.shape[: max(array.ndim - len(shape), 0)]
        if array.shape != (*leading, *shape):
            state_array(name, np.broadcast_to(0.0, array.shape), *shape)
        found.append(array.reshape(*leading, math.prod(shape)))
    return found


def _arrays(names: Sequence[str] | Mapping[str, Any], values: Any) -> list[Any]:
    """Real numbers as arrays of one precision, which is that of the arrays among them.

    It is float64 where JAX has that enabled and an array is of it, or none is of another. Raises
    what `real_numbers` does, with `names`, and `TypeError` if an array has another precision.
    """
    arrays = [
        value if isinstance(value, jax.Array) else real_numbers(name, value)
        for name, value in zip(names, values, strict=True)
    ]
    typed = [value for value in values if hasattr(value, "dtype")]
    dtype = jnp.result_type(*typed) if typed else jnp.result_type(float)
    if not jnp.issubdtype(dtype, jnp.inexact):
        dtype = jnp.result_type(float)
    if dtype not in (jnp.float32, jnp.float64):
        raise TypeError(f"{', '.join(names)} must be float64 or float32, not {dtype}")
    return [jnp.asarray(array, dtype) for array in arrays]
