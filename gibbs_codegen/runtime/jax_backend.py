"""The JAX back end: the functions of a generated module as pure functions of JAX's arrays.

A function is one of the module's compiled functions, where that pays and can be had, and else its
kernel, which JAX traces. Its derivative comes from the module's derivative functions where the
module has them, and else from the kernel.
"""

from __future__ import annotations

import dis
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
from jax.custom_derivatives import SymbolicZero

from gibbs_codegen.emitted.evaluation import batch_shape, state_array
from gibbs_codegen.emitted.preparation import common_shape, real_numbers
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.interface import FUNCTIONS, Signature, derivative, module_signatures
from gibbs_codegen.runtime.jax_ffi import CompiledCalls, compiled_calls
from gibbs_codegen.runtime.jax_rules import Tangents, by_parameters, rule_of
from gibbs_codegen.runtime.kernels import Kernels
from gibbs_codegen.runtime.loaded_module import LoadedModule

ELEMENTARY = {
    "sin": jnp.sin,
    "cos": jnp.cos,
    "sqrt": jnp.sqrt,
    "atan": jnp.arctan,
    "sign": lambda x: jnp.copysign(1.0, x),  # JAX's sign of zero is zero.
}
# Where a function has more operations and entries of results, a call of its compiled form costs
# less than what XLA makes of its kernel on a CPU.
_MOST_TRACED = 40
# XLA takes many minutes to compile more operations than these.
_MOST_OPERATIONS = 4000


class Functions:
    """The functions of one module, on arrays whose entries are along the last axis.

    All arrays of a call have one precision and equally many axes, which broadcast.
    """

    def __init__(self, module: ModuleType, folder: Path) -> None:
        """Take the NumPy module, whose files are in `folder`."""
        self.kernels = Kernels(module, ELEMENTARY)
        self.tangents = Tangents(module)
        self._module, self._folder = module, folder
        self._default: tuple[float, ...] = module.prepare({})
        self._signatures = {signature.name: signature for signature in module_signatures(module)}
        self._made: dict[str, Callable[..., tuple[Any, ...]]] = {}

    def __contains__(self, name: str | None) -> bool:
        return name in self._signatures

    def __call__(self, name: str, constants: Any, *arguments: Any) -> tuple[Any, ...]:
        """Results (..., width) of a function not composed of others, which JAX can differentiate.

        Constants are (..., constants and parameters) as `prepare` makes them, or None; arguments
        are (..., width), a quaternion in them of unit length.
        """
        if name not in self._made:
            function = jax.custom_jvp(functools.partial(self._evaluate, name))
            function.defjvp(functools.partial(self._differentiate, name), symbolic_zeros=True)
            self._made[name] = jax.jit(function)
        return self._made[name](constants, *arguments)

    @functools.cached_property
    def _compiled(self) -> CompiledCalls | str:
        """The compiled functions, or why there are none."""
        return compiled_calls(self._module, self._folder)

    def _evaluate(self, name: str, constants: Any, *arguments: Any) -> tuple[Any, ...]:
        """Results of a function as of `__call__`, of which JAX knows no derivative."""
        signature = self._signatures[name]
        size = self._operations(name) + sum(map(math.prod, signature.shapes))
        if not arguments or size <= _MOST_TRACED:
            return self._traced(signature, constants, arguments)
        if isinstance(self._compiled, str):
            self._check_length(name, f"its compiled form cannot be had: {self._compiled}")
            return self._traced(signature, constants, arguments)
        own = None if constants is None else constants[..., : len(self._default)]
        return self._compiled(signature, own, arguments)

    def _traced(
        self, signature: Signature, constants: Any, arguments: Sequence[Any]
    ) -> tuple[Any, ...]:
        """Results of a function by its kernel, as of `__call__`."""
        operands = [*arguments] if constants is None else [*arguments, constants]
        k = self._default if constants is None else _entries(constants)
        batch = jnp.broadcast_shapes(*(array.shape[:-1] for array in operands))
        dtype = jnp.result_type(*operands) if operands else jnp.result_type(float)
        entries = [
            jnp.broadcast_to(jnp.asarray(entry, dtype), batch)
            for entry in self.kernels.entries(signature.name, k, *map(_entries, arguments))
        ]
        found, start = [], 0
        for shape in signature.shapes:
            end = start + math.prod(shape)
            stacked = jnp.stack(entries[start:end], -1) if end > start else None
            found.append(jnp.zeros((*batch, 0), dtype) if stacked is None else stacked)
            start = end
        return tuple(found)

    def _operations(self, name: str) -> int:
        """How many operations a function takes, but for signs, sines and cosines."""
        code = getattr(self._module.numpy_module, f"_{name}").__code__
        steps = dis.get_instructions(code)
        # From Python 3.14, what takes an entry of an array counts as a binary operation too.
        return sum(step.opname == "BINARY_OP" and step.argrepr != "[]" for step in steps)

    def _check_length(self, name: str, otherwise: str) -> None:
        """Raise `UsageError` if a function has too many operations for XLA to compile.

        `otherwise` says why it is to.
        """
        if (count := self._operations(name)) > _MOST_OPERATIONS:
            raise UsageError(
                f"{self._module.NAME}.{name}: {count} operations are too many for XLA; {otherwise}"
            )

    def _differentiate(
        self, name: str, primals: Sequence[Any], tangents: Sequence[Any]
    ) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Results of a function, and how they change with constants and arguments.

        `tangents` are changes of these, None or zero for some.
        """
        constants, *arguments = primals
        changes = [None if isinstance(t, SymbolicZero) else t for t in tangents]
        results: Sequence[Any] = ()
        parts: list[Sequence[Any]] = []
        rule = rule_of(name)
        if rule and rule.needs in self and any(change is not None for change in changes[1:]):
            moved = self._displacements(name, arguments, changes[1:])
            results, part = rule.apply(self, name, constants, arguments, moved)
            parts.append(part)
            changes[1:] = [None] * len(arguments)
        if changes[0] is not None and derivative(name, "parameters") in self:
            by_parameters_alone = changes[0][..., len(self._default) :]
            parts.append(by_parameters(self, name, constants, arguments, by_parameters_alone))
            changes[0] = None
        if any(change is not None for change in changes):
            parts.append(self._by_kernel(name, primals, changes))
        results = results or self(name, constants, *arguments)
        sums = [sum(column, jnp.zeros_like(r)) for r, *column in zip(results, *parts, strict=True)]
        return tuple(results), tuple(sums)

    def _displacements(
        self, name: str, arguments: Sequence[Any], changes: Sequence[Any]
    ) -> list[Any]:
        """Displacements in place of changes of coordinates; None stays None."""
        names = self._signatures[name].arguments
        return [
            None if change is None else self.tangents.displacement(argument, values, change)
            for argument, values, change in zip(names, arguments, changes, strict=True)
        ]

    def _by_kernel(
        self, name: str, primals: Sequence[Any], changes: Sequence[Any]
    ) -> tuple[Any, ...]:
        """Changes of a function's results, by its kernel, with those of constants and arguments."""
        self._check_length(name, self._why_by_kernel(name, changes))
        places = [i for i, change in enumerate(changes) if change is not None]

        def results(*values: Any) -> tuple[Any, ...]:
            constants, *arguments = (
                values[places.index(i)] if i in places else primal
                for i, primal in enumerate(primals)
            )
            return self._traced(self._signatures[name], constants, arguments)

        chosen = [primals[i] for i in places]
        moved: tuple[Any, ...] = jax.jvp(results, chosen, [changes[i] for i in places])[1]
        return moved

    def _why_by_kernel(self, name: str, changes: Sequence[Any]) -> str:
        """Why the module's own derivatives do not serve, as a clause."""
        rule = rule_of(name)
        by_arguments = any(change is not None for change in changes[1:])
        needed = (rule and rule.needs) if by_arguments else derivative(name, "parameters")
        if not needed or needed in self:
            return "no module has a function for this derivative"
        return str(MissingFunctionError(self._module.NAME, needed, self._module.DERIVATIVES))


def _entries(array: Any) -> list[Any]:
    """The entries (...) along the last axis of an array (..., width)."""
    return [array[..., i] for i in range(array.shape[-1])]


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
