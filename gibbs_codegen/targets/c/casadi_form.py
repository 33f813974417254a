"""A function as CasADi calls it, put together: its inputs and outputs, and the lines of its body.

What the body computes on the way is in the scratch that CasADi gives it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.patterns import nonzeros
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.c.casadi_blocks import (
    Block,
    Matrix,
    by_coordinates,
    dense_pattern,
    entries,
)
from gibbs_codegen.targets.c.statements import call

Lines = list[str]
Shape = tuple[int, ...]

PARAMETERS = "parameters"
# Entries of the maps between a change of the base's coordinates and its displacement.
_MAPS = 21
_BASE = 6


@dataclass(frozen=True)
class Port:
    """An input or an output: its name, and its pattern as CasADi has it."""

    name: str
    pattern: tuple[int, ...]


class Form:
    """A function that CasADi calls, and what its body computes.

    `kind` is the macro that makes its name of that of a function of the robot. With `of_parameters`
    the parameters are an input too, after those of the function. `outputs` are written from the
    scratch, of which `size` entries are taken.
    """

    def __init__(self, model: Model, signature: Signature, kind: str, of_parameters: bool) -> None:
        self.model = model
        self.signature = signature
        self.kind = kind
        self.of_parameters = of_parameters
        self.inputs: list[Port] = []
        self.outputs: list[tuple[str, Block]] = []
        self.body: Lines = []
        self.size = 0
        self._signatures = {s.name: s for s in model.signatures}
        self._is_quaternion = layout_of(model.robot).is_quaternion
        self._given: dict[str, str] = {}
        self._maps = 0
        for name, shape in self.arguments:
            self._take_argument(name, shape)

    @property
    def name(self) -> str:
        """What the macro is given."""
        return self.signature.name + ("_of_parameters" if self.of_parameters else "")

    @property
    def arguments(self) -> list[tuple[str, Shape]]:
        """Inputs of the function that is differentiated, with the parameters, by name and shape."""
        given = list(zip(self.signature.arguments, self.signature.argument_shapes, strict=True))
        return [*given, (PARAMETERS, (len(self.model.defaults),))] if self.of_parameters else given

    @property
    def results(self) -> list[tuple[str, Shape]]:
        """Outputs of that function, by name and shape."""
        return self.shapes(self.signature.name)

    def shapes(self, name: str) -> list[tuple[str, Shape]]:
        """Names and shapes of the outputs of a function of the robot."""
        outputs = [output.name for output in FUNCTIONS[name].outputs]
        return list(zip(outputs, self._signatures[name].shapes, strict=True))

    def take(self, rows: int, columns: int) -> Matrix:
        """A rows × columns array in scratch, none of whose entries is zero at every state."""
        start = self.size
        self.size += rows * columns
        return Matrix(start, rows, columns, entries(rows, columns))

    def call(self, name: str, **arrays: str) -> dict[str, Matrix]:
        """A call of a function of the robot; its outputs by name, a vector as one row.

        `arrays` are what it is given for those arguments that are no inputs of the form.
        """
        found = {}
        for place, (output, shape) in enumerate(self.shapes(name)):
            taken = self.take(math.prod(shape[:-1]), math.prod(shape[-1:]))
            if not FUNCTIONS[name].composed:
                known = nonzeros(self.model.program.function(name).outputs[place])
                taken = Matrix(taken.start, taken.rows, taken.columns, frozenset(known))
            found[output] = taken
        self.body += self.calling(name, [at(matrix.start) for matrix in found.values()], **arrays)
        return found

    def calling(self, name: str, outputs: Sequence[str], **arrays: str) -> Lines:
        """Lines of a call that writes the arrays `outputs`; others are as of `call`."""
        given = {**self._given, **arrays}
        inputs = [given[argument] for argument in self._signatures[name].arguments]
        return call(f"{self.model.robot.name}_{name}", ["constants", *inputs, *outputs])

    def seeds(self) -> list[str]:
        """Take seeds of the outputs as further inputs, after inputs that hold the outputs.

        The arrays of the seeds are returned.
        """
        self.unused("out_", self.results)
        first = len(self.inputs)
        for name, shape in self.results:
            self.inputs.append(Port(f"adj_{name}", dense_pattern(*as_matrix(shape))))
        return [_input(first + i) for i in range(len(self.results))]

    def unused(self, prefix: str, arrays: Sequence[tuple[str, Shape]]) -> None:
        """Take inputs, by name and shape, that CasADi passes and no derivative reads."""
        for name, shape in arrays:
            pattern = Block(*as_matrix(shape), {}).pattern
            self.inputs.append(Port(prefix + name, pattern))

    def by_entries_of_q(self, matrix: Matrix) -> Matrix:
        """Derivatives by q in the tangent space as those by its entries.

        The first columns are those of the base's velocities. A quaternion makes one column more.
        """
        if not self._is_quaternion:
            return matrix
        made = self.take(matrix.rows, matrix.columns + 1)
        lines = [str(matrix.rows), str(matrix.columns - _BASE), at(self._maps)]
        steps = f"{matrix.columns}", "1"
        turned = f"{made.columns}", "1"
        self.body += call(
            "to_coordinates", [*lines, at(matrix.start), *steps, at(made.start), *turned]
        )
        return Matrix(made.start, made.rows, made.columns, by_coordinates(matrix.nonzeros))

    def rows_by_entries_of_q(self, matrix: Matrix, maps: int | None = None) -> Matrix:
        """The same of rows instead of columns; `maps` is their place if they are not those at q."""
        if not self._is_quaternion:
            return matrix
        made = self.take(matrix.rows + 1, matrix.columns)
        maps = self._maps if maps is None else maps
        lines = [str(matrix.columns), str(matrix.rows - _BASE), at(maps)]
        steps = "1", f"{matrix.columns}"
        self.body += call(
            "to_coordinates", [*lines, at(matrix.start), *steps, at(made.start), *steps]
        )
        turned = by_coordinates([(j, i) for i, j in matrix.nonzeros])
        return Matrix(made.start, made.rows, made.columns, frozenset((i, j) for j, i in turned))

    def maps_at_result(self, coordinates: Matrix) -> int | None:
        """Compute what takes displacements of coordinates, which were computed, to their changes.

        The coordinates are of unit length. The place of the maps is returned; None without a
        quaternion.
        """
        if not self._is_quaternion:
            return None
        maps = self.take(1, _MAPS)
        self.body += call("base_maps", [at(coordinates.start), "(real)0.5", at(maps.start)])
        return maps.start

    def by_length(self) -> Matrix:
        """Compute the derivatives of a time step by its length: one column.

        Rows are those of coordinates in the tangent space and then of velocities.
        """
        size = layout_of(self.model.robot).v.size
        taken = self.take(2 * size, 1)
        given = [self._given[name] for name in self.signature.arguments]
        outputs = at(taken.start), at(taken.start + size)
        self.body += call(f"{self.signature.name}_by_length", ["constants", *given, *outputs])
        return taken

    def with_curvature(self, hessian: Matrix, gradient: str, seed: str) -> Matrix:
        """Add what the second derivatives of the displacement by the entries of q make.

        `hessian` has the entries of q in its first rows and columns, and keeps its array; the
        pattern has the entries of the sum. `gradient` names the function that has the gradient of
        what is differentiated, `seed` the array of its weights.
        """
        if not self._is_quaternion:
            return hessian
        by_base = next(iter(self.call(gradient, w=seed).values()))
        arrays = [self._raw_q, self._given["q"], at(self._maps), at(by_base.start)]
        self.body += call("add_curvature", [*arrays, str(hessian.columns), at(hessian.start)])
        columns = {column for _, column in by_base.nonzeros}
        found = set(hessian.nonzeros)
        if columns & {3, 4, 5}:
            found |= {(i, j) for i in range(3, 7) for j in range(3, 7)}
        if columns & {0, 1, 2}:
            crossing = {(i, j) for i in range(3) for j in range(3, 7)}
            found |= crossing | {(j, i) for i, j in crossing}
        return Matrix(hessian.start, hessian.rows, hessian.columns, frozenset(found))

    def differentiated_by_q(self) -> None:
        """Compute what takes a change of the entries of q to the displacement of the base."""
        if self._is_quaternion:
            maps = self.take(1, _MAPS)
            self._maps = maps.start
            factor = f"twice_over_length({self._raw_q}, {self._given['q']})"
            self.body += call("base_maps", [self._given["q"], factor, at(maps.start)])

    @property
    def _raw_q(self) -> str:
        """The coordinates as they come, whose quaternion can be of any length."""
        return _input([name for name, _ in self.arguments].index("q"))

    def _take_argument(self, name: str, shape: Shape) -> None:
        """Take an input of the function, and bring it into the form that the function takes."""
        rows, columns = as_matrix(shape)
        given = _input(len(self.inputs))
        self.inputs.append(Port(name, dense_pattern(rows, columns)))
        if columns > 1:
            turned = at(self.take(rows, columns).start)
            self.body += call("store", [str(columns), str(rows), given, turned])
            given = turned
        elif name != PARAMETERS and self._is_quaternion and ARGUMENTS[name].is_coordinates:
            unit = at(self.take(rows, 1).start)
            self.body += call(
                f"{self.model.robot.name}_integrate", ["constants", given, "zeros", unit]
            )
            given = unit
        self._given[name] = given


def as_matrix(shape: Shape) -> tuple[int, int]:
    """Rows and columns of an array as CasADi has it: blocks stacked, vectors as columns."""
    *rows, columns = shape if len(shape) > 1 else (*shape, 1)
    return math.prod(rows), columns


def at(place: int) -> str:
    """An array in scratch that begins at a place."""
    return f"&scratch[{place}]"


def _input(place: int) -> str:
    """What CasADi gives for an input, or zeros."""
    return f"given(arg[{place}])"
