"""Derivatives of functions by other functions of their module: what JAX is told of them.

Matrices are computed whole and multiplied by the direction: under `jacfwd`, `jacrev` or `vmap` over
directions they are computed once.

A module's derivatives by q are those by a displacement in the tangent space. With attitude angles
that is a change of the entries. With a quaternion it has the linear and the angular displacement of
the base, in the base's axes, in place of the changes of seven entries.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Protocol

import jax.numpy as jnp

from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, derivative

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


Arrays = Sequence[Any]


class Differentiable(Protocol):
    """The functions of a module, which a rule calls."""

    tangents: Tangents

    def __call__(self, name: str, constants: Any, *arguments: Any) -> tuple[Any, ...]:
        """Results of a function, as of `jax_functions.Functions`."""


@dataclass(frozen=True)
class Rule:
    """A rule, and the function without which it does not hold.

    `apply` takes the functions, the name of the one that is differentiated, constants, arguments,
    and the displacements or changes of these, None for those that do not change. It returns the
    results and their changes.
    """

    needs: str
    apply: Callable[[Differentiable, str, Any, Arrays, Arrays], tuple[Arrays, Arrays]]


def product(matrix: Any, direction: Any) -> Any:
    """A matrix (..., rows times columns), given row by row, times a direction (..., columns)."""
    whole = matrix.reshape(*matrix.shape[:-1], -1, direction.shape[-1])
    return (whole @ direction[..., None])[..., 0]


def _sum_of_products(matrices: Arrays, changes: Arrays) -> Any:
    """The change (..., rows) of a result whose derivatives are matrices, one for each argument.

    They are (..., rows times columns), and changes (..., columns) or None; not all of them.
    """
    parts = [
        product(matrix, change)
        for matrix, change in zip(matrices, changes, strict=True)
        if change is not None
    ]
    return sum(parts[1:], parts[0])


def _by_matrices(
    functions: Differentiable, name: str, constants: Any, arguments: Arrays, changes: Arrays
) -> tuple[Arrays, Arrays]:
    """The rule of a function whose derivatives are matrices, one for each argument."""
    value, *matrices = functions(derivative(name, "jacobian"), constants, *arguments)
    return [value], [_sum_of_products(matrices, changes)]


def _integrate(
    functions: Differentiable, name: str, constants: Any, arguments: Arrays, changes: Arrays
) -> tuple[Arrays, Arrays]:
    """The rule of `integrate`, whose derivative is in the tangent space at the result."""
    matrices = functions(derivative(name, "jacobian"), constants, *arguments)
    (value,) = functions(name, constants, *arguments)
    return [value], [functions.tangents.changes(value, _sum_of_products(matrices, changes))]


def _by_hessian(
    functions: Differentiable, name: str, constants: Any, arguments: Arrays, changes: Arrays
) -> tuple[Arrays, Arrays]:
    """The rule of first derivatives of forces or accelerations."""
    results = functions(name, constants, *arguments)
    value, *matrices = results
    sizes = [argument.shape[-1] for argument in arguments]
    sizes[0] = sizes[1]  # Displacements are as many as velocities.
    blocks = functions(
        derivative(FUNCTIONS[name].derivative_of, "hessian"),
        *_by_entry(value, constants, arguments),
    )
    change = jnp.concatenate(_filled(value, sizes, changes), axis=-1)[..., None, :, None]
    moved = (_whole(blocks, sizes) @ change)[..., 0]
    pieces = jnp.split(moved, [sizes[0], sizes[0] + sizes[1]], axis=-1)
    if changes[0] is not None:
        by_q = matrices[0].reshape(pieces[0].shape)
        pieces[0] = pieces[0] + functions.tangents.turned_columns(by_q, changes[0])
    flat = [piece.reshape(matrix.shape) for piece, matrix in zip(pieces, matrices, strict=True)]
    return results, [_sum_of_products(matrices, changes), *flat]


def _by_entry(like: Any, constants: Any, arguments: Arrays) -> list[Any]:
    """Constants, arguments and weights w of functions of wᵀ f that give a row for each entry of f.

    They get one more axis before the last, that of the rows; `like` is (..., entries of f).
    """
    size = like.shape[-1]
    weights = jnp.eye(size, dtype=like.dtype).reshape((1,) * (like.ndim - 1) + (size, size))
    own = None if constants is None else constants[..., None, :]
    return [own, *(argument[..., None, :] for argument in arguments), weights]


def _filled(like: Any, sizes: Sequence[int], changes: Arrays) -> list[Any]:
    """Changes (..., size) of all arguments, those that do not change, None, included.

    `like` (..., any width) has the batch's shape.
    """
    batch = like.shape[:-1]
    return [
        jnp.zeros((*batch, size), like.dtype)
        if change is None
        else jnp.broadcast_to(change, (*batch, size))
        for size, change in zip(sizes, changes, strict=True)
    ]


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


def by_parameters(
    functions: Differentiable, name: str, constants: Any, arguments: Arrays, change: Any
) -> Arrays:
    """Change of the one result of a function with parameters (..., np)."""
    needed = derivative(name, "parameters")
    if FUNCTIONS[needed].arguments[-1] != "w":
        (matrix,) = functions(needed, constants, *arguments)
        return [product(matrix, change)]
    (matrix,) = functions(needed, *_by_entry(arguments[1], constants, arguments))
    return [(matrix @ change[..., None])[..., 0]]


def rule_of(name: str) -> Rule | None:
    """The rule of a function, None where the table has no derivatives that serve."""
    row = FUNCTIONS[name]
    needed = derivative(name, "jacobian")
    if needed and FUNCTIONS[needed].outputs[-1].by:
        return Rule(needed, _integrate if row.outputs[0].shape == "q" else _by_matrices)
    if row.kind == "jacobian" and (needed := derivative(row.derivative_of, "hessian")):
        return Rule(needed, _by_hessian)
    return None
