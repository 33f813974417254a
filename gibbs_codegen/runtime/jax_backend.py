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
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import (
    ARGUMENTS,
    FUNCTIONS,
    Signature,
    derivative,
    module_signatures,
)
from gibbs_codegen.runtime.jax_ffi import CompiledCalls, compiled_calls
from gibbs_codegen.runtime.kernels import Kernels
from gibbs_codegen.runtime.loaded_module import LoadedModule, missing_function

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
Arrays = Sequence[Any]
_POSITION, _VECTOR, _SCALAR = slice(0, 3), slice(3, 6), slice(6, 7)
_JOINTS, _JOINTS_OF_V = slice(7, None), slice(6, None)


class Tangents:
    """Displacements for the attitude that a module has."""

    def __init__(self, module: ModuleType) -> None:
        """Take a module, with any back end."""
        self._is_quaternion = module.ATTITUDE == "quaternion"

    def has(self, argument: str) -> bool:
        """Whether an argument, as the table of functions names it, has a quaternion in it.

        Then displacements differ from changes of the entries.
        """
        return self._is_quaternion and ARGUMENTS[argument].is_coordinates

    def normalised(self, argument: str, values: Any) -> Any:
        """An argument (..., width) with a quaternion of unit length."""
        if not self.has(argument):
            return values
        quaternion = values[..., 3:7]
        squared = jnp.sum(quaternion * quaternion, axis=-1, keepdims=True)
        unit = quaternion * (jnp.sqrt(squared) * (1 / squared))  # Not finite where that is not.
        return jnp.concatenate([values[..., _POSITION], unit, values[..., _JOINTS]], axis=-1)

    def displacement(self, argument: str, values: Any, change: Any) -> Any:
        """The displacement (..., nv) that changes coordinates as given; of others the changes.

        They leave the unit length of a quaternion as it is.
        """
        if not self.has(argument):
            return change
        vector, scalar = values[..., _VECTOR], values[..., _SCALAR]
        turned = change[..., _VECTOR] * scalar - vector * change[..., _SCALAR]
        turned = 2.0 * (turned - jnp.cross(vector, change[..., _VECTOR]))
        moved = _rotated(-vector, scalar, change[..., _POSITION])
        return jnp.concatenate([moved, turned, change[..., _JOINTS]], axis=-1)

    def changes(self, coordinates: Any, displacement: Any) -> Any:
        """Changes of coordinates (..., nq), of unit quaternion, by a displacement (..., nv)."""
        if not self._is_quaternion:
            return displacement
        vector, scalar = coordinates[..., _VECTOR], coordinates[..., _SCALAR]
        half = 0.5 * displacement[..., 3:6]
        moved = _rotated(vector, scalar, displacement[..., _POSITION])
        by_vector = scalar * half + jnp.cross(vector, half)
        by_scalar = -jnp.sum(vector * half, axis=-1, keepdims=True)
        joints = displacement[..., _JOINTS_OF_V]
        return jnp.concatenate([moved, by_vector, by_scalar, joints], axis=-1)

    def turned_columns(self, matrix: Any, displacement: Any) -> Any:
        """What a symmetric second derivative lacks of the change of a first derivative.

        Displacements one after the other differ from their sum by half their commutator, that of
        SE(3), along which the first derivative acts. `matrix` and the result are (..., rows, nv);
        zero without a quaternion.
        """
        if not self._is_quaternion:
            return 0.0
        linear, angular = matrix[..., :3], matrix[..., 3:6]
        moved = -0.5 * displacement[..., None, :3]
        turned = -0.5 * displacement[..., None, 3:6]
        # A row r of a matrix times (w x) is r x w, transposed.
        by_linear = jnp.cross(turned, linear)
        by_angular = jnp.cross(moved, linear) + jnp.cross(turned, angular)
        rest = jnp.zeros_like(matrix[..., _JOINTS_OF_V])
        return jnp.concatenate([by_linear, by_angular, rest], axis=-1)


def _rotated(vector: Any, scalar: Any, point: Any) -> Any:
    """A point (..., 3) turned by a unit quaternion of vector (..., 3) and scalar (..., 1)."""
    return point + 2.0 * jnp.cross(vector, jnp.cross(vector, point) + scalar * point)


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
            return self._kernel_results(signature, constants, arguments)
        calls = self._compiled
        reason = calls if isinstance(calls, str) else calls.why_not(signature)
        if isinstance(calls, str) or reason:
            self._check_length(name, f"its compiled form cannot be had: {reason}")
            return self._kernel_results(signature, constants, arguments)
        own = None if constants is None else constants[..., : len(self._default)]
        return calls(signature, own, arguments)

    def _kernel_results(
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
        results: Arrays = ()
        parts: list[Arrays] = []
        if _needed(name) in self and any(change is not None for change in changes[1:]):
            names = self._signatures[name].arguments
            moved = [
                None if change is None else self.tangents.displacement(argument, values, change)
                for argument, values, change in zip(names, arguments, changes[1:], strict=True)
            ]
            by_functions = self._by_hessian if _is_jacobian(name) else self._by_matrices
            results, part = by_functions(name, constants, arguments, moved)
            parts.append(part)
            changes[1:] = [None] * len(arguments)
        needed = derivative(name, "parameters")
        if changes[0] is not None and needed in self:
            change = changes[0][..., len(self._default) :]
            if FUNCTIONS[needed].arguments[-1] == "w":
                (matrix,) = self(needed, *_by_entry(arguments[1], constants, arguments))
                parts.append([(matrix @ change[..., None])[..., 0]])
            else:
                (matrix,) = self(needed, constants, *arguments)
                parts.append([_product(matrix, change)])
            changes[0] = None
        if any(change is not None for change in changes):
            parts.append(self._by_kernel(name, primals, changes))
        results = results or self(name, constants, *arguments)
        sums = [sum(column, jnp.zeros_like(r)) for r, *column in zip(results, *parts, strict=True)]
        return tuple(results), tuple(sums)

    def _by_matrices(
        self, name: str, constants: Any, arguments: Arrays, changes: Arrays
    ) -> tuple[Arrays, Arrays]:
        """Results, and their changes by a function that gives a matrix for each argument.

        `changes` are displacements or changes of the arguments, None for those that do not change.
        """
        found = self(_needed(name), constants, *arguments)
        if FUNCTIONS[name].outputs[0].shape != "q":
            value, *matrices = found
            return [value], [_sum_of_products(matrices, changes)]
        # The derivative of `integrate` is in the tangent space at the result.
        (value,) = self(name, constants, *arguments)
        return [value], [self.tangents.changes(value, _sum_of_products(found, changes))]

    def _by_hessian(
        self, name: str, constants: Any, arguments: Arrays, changes: Arrays
    ) -> tuple[Arrays, Arrays]:
        """First derivatives of forces or accelerations, and their changes, as `_by_matrices`."""
        results = self(name, constants, *arguments)
        value, *matrices = results
        sizes = [argument.shape[-1] for argument in arguments]
        sizes[0] = sizes[1]  # Displacements are as many as velocities.
        blocks = self(_needed(name), *_by_entry(value, constants, arguments))
        zero = jnp.zeros((), value.dtype)
        every = [
            jnp.broadcast_to(zero if change is None else change, (*value.shape[:-1], size))
            for size, change in zip(sizes, changes, strict=True)
        ]
        change = jnp.concatenate(every, axis=-1)[..., None, :, None]
        moved = (_whole(blocks, sizes) @ change)[..., 0]
        pieces = jnp.split(moved, [sizes[0], sizes[0] + sizes[1]], axis=-1)
        if changes[0] is not None:
            by_q = matrices[0].reshape(pieces[0].shape)
            pieces[0] = pieces[0] + self.tangents.turned_columns(by_q, changes[0])
        flat = [piece.reshape(matrix.shape) for piece, matrix in zip(pieces, matrices, strict=True)]
        return results, [_sum_of_products(matrices, changes), *flat]

    def _by_kernel(
        self, name: str, primals: Sequence[Any], changes: Sequence[Any]
    ) -> tuple[Any, ...]:
        """Changes of a function's results, by its kernel, with those of constants and arguments."""
        by_arguments = any(change is not None for change in changes[1:])
        needed = _needed(name) if by_arguments else derivative(name, "parameters")
        why = "no module has a function for this derivative"
        if needed and needed not in self:
            why = str(missing_function(self._module, needed))
        self._check_length(name, why)
        places = [i for i, change in enumerate(changes) if change is not None]

        def results(*values: Any) -> tuple[Any, ...]:
            constants, *arguments = (
                values[places.index(i)] if i in places else primal
                for i, primal in enumerate(primals)
            )
            return self._kernel_results(self._signatures[name], constants, arguments)

        chosen = [primals[i] for i in places]
        return jax.jvp(results, chosen, [changes[i] for i in places])[1]


def _is_jacobian(name: str) -> bool:
    """Whether a function gives first derivatives of one that has second ones."""
    row = FUNCTIONS[name]
    return row.kind == "jacobian" and bool(derivative(row.derivative_of, "hessian"))


def _needed(name: str) -> str:
    """The function that gives derivatives of another by its arguments.

    It is empty where the table has none that serve.
    """
    needed = derivative(name, "jacobian")
    if needed and FUNCTIONS[needed].outputs[-1].by:
        return needed
    return derivative(FUNCTIONS[name].derivative_of, "hessian") if _is_jacobian(name) else ""


def _product(matrix: Any, direction: Any) -> Any:
    """A matrix (..., rows times columns), given row by row, times a direction (..., columns)."""
    whole = matrix.reshape(*matrix.shape[:-1], -1, direction.shape[-1])
    return (whole @ direction[..., None])[..., 0]


def _sum_of_products(matrices: Arrays, changes: Arrays) -> Any:
    """The change (..., rows) of a result whose derivatives are matrices, one for each argument.

    They are (..., rows times columns), and changes (..., columns) or None; not all of them.
    """
    parts = [
        _product(matrix, change)
        for matrix, change in zip(matrices, changes, strict=True)
        if change is not None
    ]
    return sum(parts[1:], parts[0])


def _by_entry(like: Any, constants: Any, arguments: Arrays) -> list[Any]:
    """Constants, arguments and weights w of functions of wᵀ f that give a row for each entry of f.

    They get one more axis before the last, that of the rows; `like` is (..., entries of f).
    """
    size = like.shape[-1]
    weights = jnp.eye(size, dtype=like.dtype).reshape((1,) * (like.ndim - 1) + (size, size))
    own = None if constants is None else constants[..., None, :]
    return [own, *(argument[..., None, :] for argument in arguments), weights]


def _whole(blocks: Arrays, sizes: Sequence[int]) -> Any:
    """A Hessian (..., all entries, all entries) from what its function gives.

    `blocks`: the whole, or qq, qv, vv and qa, row by row; those left out are zero. `sizes` are of
    the arguments.
    """
    if len(blocks) == 1:
        return blocks[0].reshape(*blocks[0].shape[:-1], sum(sizes), sum(sizes))
    first, _, last = sizes
    qq, qv, vv, qa = (block.reshape(*block.shape[:-1], first, first) for block in blocks)
    nothing = jnp.zeros((*qa.shape[:-1], last), qa.dtype)
    rows = [[qq, qv, qa], [qv.mT, vv, nothing], [qa.mT, nothing, nothing]]
    return jnp.concatenate([jnp.concatenate(row, axis=-1) for row in rows], axis=-2)


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
        last = None
        if constants is not None:
            if getattr(constants, "shape", ())[-1:] != (size,):
                raise TypeError("constants must be what this module's prepare() returned")
            (last,) = _arrays(["constants"], [constants])
            last = jnp.asarray(last, operands[0].dtype) if operands else last
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
