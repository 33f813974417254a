"""Vectors, rotations and inertias whose entries are floats or CasADi SX scalars.

Products are written out entry by entry, so that what is exactly 0 or ±1 costs nothing: CasADi
folds it away.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

Scalar = Any
Vector = list[Scalar]
Matrix = list[list[Scalar]]

ZERO: Vector = [0.0, 0.0, 0.0]


def plus(*vectors: Iterable[Scalar]) -> Vector:
    """Sum of vectors, the first two first."""
    total, *rest = (list(vector) for vector in vectors)
    for vector in rest:
        total = [a + b for a, b in zip(total, vector, strict=True)]
    return total


def minus(a: Vector, b: Vector) -> Vector:
    """Difference of vectors."""
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a: Vector, b: Vector) -> Scalar:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def times(matrix: Matrix, vector: Vector) -> Vector:
    """Matrix times vector."""
    return [dot(row, vector) for row in matrix]


def product(a: Matrix, b: Matrix) -> Matrix:
    """Matrix times matrix."""
    return [[dot(row, column) for column in transposed(b)] for row in a]


def transposed(matrix: Matrix) -> Matrix:
    """Transpose."""
    return [list(column) for column in zip(*matrix, strict=True)]


def matrix_plus(a: Matrix, b: Matrix) -> Matrix:
    """Sum of matrices."""
    return [plus(x, y) for x, y in zip(a, b, strict=True)]


def matrix_minus(a: Matrix, b: Matrix) -> Matrix:
    """Difference of matrices."""
    return [[x - y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def mirrored(matrix: Matrix) -> Matrix:
    """Symmetric matrix of an upper triangle."""
    return [[matrix[min(i, j)][max(i, j)] for j in range(3)] for i in range(3)]


def skew(vector: Vector) -> Matrix:
    """Matrix that takes the vector product from the left."""
    x, y, z = vector
    return [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]


@dataclass(frozen=True)
class Turn:
    """Rotation about a coordinate axis, 0 to 2, by an angle of given cosine and sine."""

    axis: int
    cosine: Scalar
    sine: Scalar

    def up(self, vector: Vector) -> Vector:
        """Vector in the axes turned from, given in the axes turned to."""
        return self._turned(vector, self.sine)

    def down(self, vector: Vector) -> Vector:
        """Vector in the axes turned to, given in the axes turned from."""
        return self._turned(vector, -self.sine)

    def _turned(self, vector: Vector, sine: Scalar) -> Vector:
        i, j = (self.axis + 1) % 3, (self.axis + 2) % 3
        turned = list(vector)
        turned[i] = self.cosine * vector[i] - sine * vector[j]
        turned[j] = sine * vector[i] + self.cosine * vector[j]
        return turned

    def up_tensor(self, tensor: Matrix) -> Matrix:
        """Any tensor in the axes turned from; in the plane of turning the half sum stays."""
        k, i, j = self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3
        c, s = self.cosine, self.sine
        turned = [list(row) for row in tensor]
        apart, shear = tensor[i][i] - tensor[j][j], tensor[i][j] + tensor[j][i]
        along, across = s * (s * apart + c * shear), s * (c * apart - s * shear)
        turned[i][i], turned[j][j] = tensor[i][i] - along, tensor[j][j] + along
        turned[i][j], turned[j][i] = tensor[i][j] + across, tensor[j][i] + across
        turned[k][i], turned[k][j] = _pair(c, s, tensor[k][i], tensor[k][j])
        turned[i][k], turned[j][k] = _pair(c, s, tensor[i][k], tensor[j][k])
        return turned

    def up_symmetric(self, tensor: Matrix) -> Matrix:
        """As `up_tensor`, for a symmetric tensor."""
        k, i, j = self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3
        c, s = self.cosine, self.sine
        turned = [list(row) for row in tensor]
        swing = s * (tensor[i][i] - tensor[j][j]) + c * (2 * tensor[i][j])
        turned[i][i], turned[j][j] = tensor[i][i] - s * swing, tensor[j][j] + s * swing
        turned[i][j] = turned[j][i] = c * swing - tensor[i][j]
        turned[i][k], turned[j][k] = turned[k][i], turned[k][j] = _pair(
            c, s, tensor[i][k], tensor[j][k]
        )
        return turned


def _pair(c: Scalar, s: Scalar, x: Scalar, y: Scalar) -> tuple[Scalar, Scalar]:
    return c * x - s * y, s * x + c * y


@dataclass(frozen=True)
class Joint:
    """What carries a body on its parent: a constant placement, then a turn about z."""

    placement: Matrix
    step: Vector
    turn: Turn

    def up(self, vector: Vector) -> Vector:
        """Vector in the parent's axes."""
        return times(self.placement, self.turn.up(vector))

    def down(self, vector: Vector) -> Vector:
        """Vector of the parent's axes in the body's."""
        return self.turn.down(times(transposed(self.placement), vector))

    def up_tensor(self, tensor: Matrix) -> Matrix:
        """Any tensor in the parent's axes."""
        return self._placed(self.turn.up_tensor(tensor))

    def up_symmetric(self, tensor: Matrix) -> Matrix:
        """Symmetric tensor in the parent's axes."""
        return mirrored(self._placed(self.turn.up_symmetric(tensor)))

    def _placed(self, tensor: Matrix) -> Matrix:
        return product(product(self.placement, tensor), transposed(self.placement))
