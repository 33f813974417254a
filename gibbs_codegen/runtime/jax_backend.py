"""The JAX back end: the functions of a generated module as pure functions of JAX's arrays.

A function is one of the module's compiled functions, where that pays and can be had, and else its
kernel, which JAX traces. Its derivative comes from the module's derivative functions where the
module has them, and else from the kernel. Matrices of derivatives are computed whole and multiplied
by the direction: under `jacfwd`, `jacrev` or `vmap` over directions they are computed once.

A module's derivatives by q are those by a displacement in the tangent space. With attitude angles
that is a change of the entries. With a quaternion it has the linear and the angular displacement of
the base, in the base's axes, in place of the changes of seven entries.
"""

from __future__ import annotations

import dis
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from gibbs_codegen.arrays.evaluation import Evaluator, shaped
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.arrays.rules import by_arguments, by_parameters, gradients_by_arguments
from gibbs_codegen.emitted.evaluation import state_array
from gibbs_codegen.emitted.preparation import common_shape, real_numbers
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Signature
from gibbs_codegen.machine.steps import emitted_step
from gibbs_codegen.runtime.jax_ffi import CompiledCalls, compiled_calls
from gibbs_codegen.runtime.kernels import Kernels
from gibbs_codegen.runtime.loaded_module import GeneralFunction, LoadedModule

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


class JaxFunctions:
    """The functions of one module, on arrays of JAX with any leading axes, which broadcast.

    They are attributes, as those of a module for array programs. Entries of arguments are of unit
    quaternions.
    """

    def __init__(self, module: ModuleType, folder: Path) -> None:
        """Take the NumPy module, whose files are in `folder`."""
        self.kernels = Kernels(module, ELEMENTARY)
        self.robot = Functions(module)
        self._module, self._folder = module, folder
        self._default: tuple[float, ...] = module.prepare({})
        self._made: dict[str, Callable[..., tuple[Any, ...]]] = {}

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in self.robot.signatures:
            raise AttributeError(name)

        def function(*arguments: Any, constants: Any = None) -> Any:
            results = self.results(name, constants, *arguments)
            return results[0] if len(results) == 1 else results

        return function

    def results(self, name: str, constants: Any, *arguments: Any) -> tuple[Any, ...]:
        """Results (..., *shape) of a function, which JAX can differentiate.

        Constants are (..., constants and parameters) as `prepare` makes them, or None; arguments
        are (..., *shape), all in the precision of the first.
        """
        if name not in self._made:
            if FUNCTIONS[name].composed:
                function = functools.partial(self._evaluated, emitted_step(self.robot, name))
                self._made[name] = lambda *operands: tuple(function(*operands).values())
            else:
                differentiable = jax.custom_jvp(functools.partial(self._evaluate, name))
                rule = functools.partial(self._differentiate, name)
                differentiable.defjvp(rule, symbolic_zeros=True)
                self._made[name] = jax.jit(differentiable)
        shapes = self.robot.signatures[name].argument_shapes
        arrays = [jnp.asarray(argument, arguments[0].dtype) for argument in arguments]
        leads = [x.ndim - len(shape) for x, shape in zip(arrays, shapes, strict=True)]
        if constants is not None:
            constants = jnp.asarray(constants, arrays[0].dtype if arrays else None)
            leads.append(constants.ndim - 1)
        axes = max(leads, default=0)
        constants = None if constants is None else _with_axes(constants, axes + 1)
        pairs = zip(arrays, shapes, strict=True)
        return self._made[name](constants, *(_with_axes(x, axes + len(s)) for x, s in pairs))

    def _evaluated(self, program: Program, constants: Any, *inputs: Any) -> dict[str, Any]:
        """The results of a program in the precision of its inputs."""
        by_name = dict(zip(program.names, inputs, strict=True))
        results = Evaluator(program, {"robot": self}, jnp)(by_name, {"robot": constants})
        return {name: jnp.asarray(x, inputs[0].dtype) for name, x in results.items()}

    @functools.cached_property
    def _compiled(self) -> CompiledCalls | str:
        """The compiled functions, or why there are none."""
        return compiled_calls(self._module, self._folder)

    def _evaluate(self, name: str, constants: Any, *arguments: Any) -> tuple[Any, ...]:
        """Results of a function as of `results`, of which JAX knows no derivative."""
        signature = self.robot.signatures[name]
        compute: Callable[..., Any] = self._by_kernel
        size = self._operations(name) + sum(map(math.prod, signature.shapes))
        if arguments and size > _MOST_TRACED:
            calls = self._compiled
            reason = calls if isinstance(calls, str) else calls.why_not(signature)
            if isinstance(calls, str) or reason:
                self._check_length(name, f"it cannot be compiled: {reason}")
            else:
                compute = calls
        return self._computed(compute, name, constants, *arguments)

    def _computed(
        self, compute: Callable[..., Any], name: str, constants: Any, *arguments: Any
    ) -> tuple[Any, ...]:
        """Results (..., *shape) by what takes and returns arrays (..., width)."""
        signature = self.robot.signatures[name]
        numbers = None if constants is None else constants[..., : len(self._default)]
        flat = map(_flat, arguments, signature.argument_shapes)
        results = compute(signature, numbers, [*flat])
        return tuple(
            shaped(x, x.shape[-1:], s) for x, s in zip(results, signature.shapes, strict=True)
        )

    def _by_kernel(
        self, signature: Signature, constants: Any, arguments: Sequence[Any]
    ) -> tuple[Any, ...]:
        """Results (..., width) of a function of arguments (..., width) by its kernel."""
        operands = [*arguments] if constants is None else [*arguments, constants]
        k = self._default if constants is None else _entries(constants)
        batch = jnp.broadcast_shapes(*(array.shape[:-1] for array in operands))
        dtype = jnp.result_type(*operands) if operands else jnp.result_type(float)
        return tuple(
            jnp.stack([jnp.broadcast_to(jnp.asarray(x, dtype), batch) for x in entries], -1)
            if entries
            else jnp.zeros((*batch, 0), dtype)
            for entries in self.kernels.outputs(signature, k, *map(_entries, arguments))
        )

    def _operations(self, name: str) -> int:
        """The number of operations of a function, but for signs, sines and cosines."""
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

        `tangents` are changes of these, zero for some.
        """
        names = ["constants", *self.robot.signatures[name].arguments]
        moved = {
            x: change
            for x, change in zip(names, tangents, strict=True)
            if change is not None and not isinstance(change, SymbolicZero)
        }
        by_constants = moved.pop("constants", None)
        results, changes = None, []
        if moved:
            try:
                results, change = self._by_arguments(name, primals, moved)
            except UsageError as error:
                self._check_length(name, str(error))
                places = [names.index(x) for x in moved]
                change = self._traced(name, primals, dict(zip(places, moved.values(), strict=True)))
            changes.append(change)
        if by_constants is not None:
            try:
                change = [self._by_parameters(name, primals, by_constants)]
            except UsageError as error:
                self._check_length(name, str(error))
                change = self._traced(name, primals, {0: by_constants})
            changes.append(change)
        results = results or self.results(name, *primals)
        terms = zip(results, *changes, strict=True)
        return tuple(results), tuple(sum(parts, jnp.zeros_like(x)) for x, *parts in terms)

    def _by_arguments(
        self, name: str, primals: Sequence[Any], moved: Mapping[str, Any]
    ) -> tuple[Sequence[Any], Sequence[Any]]:
        """Results of a function, and their changes with arguments, by functions of the module.

        Raises `UsageError` where it has none.
        """
        signature, outputs, by = self.robot.signatures[name], FUNCTIONS[name].outputs, tuple(moved)
        rule, second = by_arguments(self.robot, name, by), {}
        if any(output.by for output in outputs):
            program = gradients_by_arguments(self.robot, name, by)
            second = self._by_entry(program, name, primals)
        results = self._evaluated(rule, *primals)
        shapes = dict(zip(signature.arguments, signature.argument_shapes, strict=True))
        flat = {x: _flat(change, shapes[x]) for x, change in moved.items()}
        changes = []
        for output, shape in zip(outputs, signature.shapes, strict=True):
            slopes, row = (second, output.by) if output.by else (results, output.name)
            parts = [_product(slopes[f"{row}_by_{x}"], shape, flat[x]) for x in by]
            changes.append(sum(parts))
        return [results[output.name] for output in outputs], changes

    def _by_parameters(self, name: str, primals: Sequence[Any], change: Any) -> Any:
        """The change of a result with the parameters, which are the last constants.

        Raises `UsageError` where the module has no function for it.
        """
        (slope,) = self._by_entry(by_parameters(self.robot, name), name, primals).values()
        (shape,) = self.robot.signatures[name].shapes
        return _product(slope, shape, change[..., len(self._default) :])

    def _by_entry(self, program: Program, name: str, primals: Sequence[Any]) -> dict[str, Any]:
        """Results of a program of weights too, for unit weights of a function's first output.

        They have one more axis of the states, the last, in which its entries are.
        """
        constants, *arguments = primals
        signature = self.robot.signatures[name]
        numbers = None if constants is None else constants[..., None, :]
        places = [-1 - len(shape) for shape in signature.argument_shapes]
        moved = [jnp.expand_dims(x, place) for x, place in zip(arguments, places, strict=True)]
        size = math.prod(signature.shapes[0])
        weights = jnp.eye(size).reshape(size, *signature.shapes[0])
        results = self._evaluated(program, numbers, *moved, weights)
        # Results that are zero have no states.
        return {
            key: jnp.broadcast_to(x, jnp.broadcast_shapes(x.shape, (size, *x.shape[-axes:])))
            for key, x in results.items()
            for axes in [len(program.outputs[key].shape)]
        }

    def _traced(
        self, name: str, primals: Sequence[Any], moved: Mapping[int, Any]
    ) -> tuple[Any, ...]:
        """Changes of a function's results with some of constants and arguments, by its kernel."""

        def results(*values: Any) -> tuple[Any, ...]:
            values_by_place = {**dict(enumerate(primals)), **dict(zip(moved, values, strict=True))}
            return self._computed(self._by_kernel, name, *values_by_place.values())

        return jax.jvp(results, [primals[i] for i in moved], [*moved.values()])[1]


def _flat(array: Any, shape: tuple[int, ...]) -> Any:
    """Entries (..., width) of arrays (..., *shape), row by row."""
    return shaped(array, shape, (math.prod(shape),))


def _product(slope: Any, shape: tuple[int, ...], change: Any) -> Any:
    """A derivative (..., *shape, columns) times a change (..., columns): (..., *shape)."""
    columns = change.shape[-1]
    rows = shaped(slope, (*shape, columns), (math.prod(shape), columns))
    return shaped(rows @ change[..., None], (math.prod(shape), 1), shape)


def _entries(array: Any) -> list[Any]:
    """The entries (...) along the last axis of an array (..., width)."""
    return [array[..., i] for i in range(array.shape[-1])]


def jax_module(module: ModuleType, folder: Path) -> ModuleType:
    """The functions and constants of a module, computed by JAX; its files are in `folder`."""
    functions = JaxFunctions(module, folder)
    made = LoadedModule(module, "jax")
    made.prepare = _prepare(module, functions)  # type: ignore[attr-defined]
    for signature in functions.robot.signatures.values():
        setattr(made, signature.name, _function(module, functions, signature))
    return made


def _prepare(module: ModuleType, functions: JaxFunctions) -> Callable[[Mapping[str, Any]], Any]:
    """The function `prepare` of a module."""

    def prepare(parameters: Mapping[str, Any]) -> Any:
        defaults = module.PARAMETERS
        values = {**parameters}
        # Traced arguments have no values in which NumPy could find faults.
        concrete = not any(isinstance(value, jax.core.Tracer) for value in values.values())
        module.prepare(values if concrete else {name: defaults.get(name, 0.0) for name in values})
        numbers = _arrays(values, values.values())
        shapes = {name: value.shape for name, value in zip(values, numbers, strict=True)}
        shape = common_shape("values", shapes)
        completed = {**defaults, **dict(zip(values, numbers, strict=True))}
        dtype = numbers[0].dtype if numbers else jnp.result_type(float)
        entries = [*functions.kernels.constants(completed), *completed.values()]
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
    functions: JaxFunctions,
    signature: Signature,
) -> Callable[..., Any]:
    """A function of a module that takes what that of the NumPy module does, and refuses others."""
    like = getattr(module, signature.name)
    size = len(module.prepare({})) + len(module.PARAMETERS)

    def evaluate(by_argument: Mapping[str, Any]) -> Any:
        operands = {
            argument: _unit(functions.robot, argument, x)
            for argument, x in _states(signature, by_argument).items()
        }
        constants = by_argument.get("constants")
        if constants is not None:
            if getattr(constants, "shape", ())[-1:] != (size,):
                raise TypeError("constants must be what this module's prepare() returned")
            (constants,) = _arrays(["constants"], [constants])
        shapes = zip(operands.items(), signature.argument_shapes, strict=True)
        leads = {x: array.shape[: array.ndim - len(shape)] for (x, array), shape in shapes}
        leads["constants"] = () if constants is None else constants.shape[:-1]
        batch = common_shape("leading axes", leads)
        results = functions.results(signature.name, constants, *operands.values())
        shaped = [
            jnp.broadcast_to(result, (*batch, *shape))
            for result, shape in zip(results, signature.shapes, strict=True)
        ]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    return GeneralFunction(evaluate, like)


def _unit(robot: Functions, argument: str, entries: Any) -> Any:
    """An argument of a function, with a quaternion in it of unit length."""
    if not (ARGUMENTS[argument].is_coordinates and robot.space.has_quaternion):
        return entries
    place = robot.layout.q.attitude
    squared = jnp.sum(entries[..., place] ** 2, axis=-1, keepdims=True)
    scale = jnp.sqrt(squared) * (1 / squared)  # Not finite where that is not.
    return entries.at[..., place].multiply(scale)


def _with_axes(array: Any, axes: int) -> Any:
    """An array with so many axes, those that are new of length 1 and first."""
    return array.reshape((1,) * (axes - array.ndim) + array.shape)


def _states(signature: Signature, values: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of a function by name, of one precision. Raises what `state_array` does."""
    arrays = _arrays(signature.arguments, [values[name] for name in signature.arguments])
    states = dict(zip(signature.arguments, arrays, strict=True))
    for (name, array), shape in zip(states.items(), signature.argument_shapes, strict=True):
        if array.shape[max(array.ndim - len(shape), 0) :] != shape:
            state_array(name, np.broadcast_to(0.0, array.shape), *shape)
    return states


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
