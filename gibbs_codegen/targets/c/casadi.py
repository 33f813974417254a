"""The adapter by which CasADi calls a module's functions, and their derivatives, as external ones.

Every function has two forms, the second with the parameters as a further input. What its body
computes on the way is in the scratch that CasADi gives it.

Beside a function F CasADi looks up derivatives, which are made of those that the module has:
`jac_F`, with a matrix for each output and input, `adj1_F`, the gradient of the outputs times seeds,
and `jac_adj1_F`, the derivatives of that. Without `adj1_F` it makes gradients of `jac_F`; with it,
it may compute a Jacobian row by row, so that `adj1_F` is there only where second derivatives or
parameters need it. With `fwd1_F` it would compute a Jacobian column by column, so that there is
none.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Signature, derivative
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.patterns import nonzeros
from gibbs_codegen.targets.c.statements import WIDTH, call, loop
from gibbs_codegen.targets.c.steps import METHODS, PLACES, VECTORS, length_lines, step_patterns
from gibbs_codegen.targets.printers import Context, Lines


@dataclass(frozen=True)
class Block:
    """A matrix: the place in scratch of each entry, by row and column, that can be other than zero.

    It is what CasADi calls sparse: entries without a place are no part of it.
    """

    rows: int
    columns: int
    places: Mapping[tuple[int, int], int]

    @property
    def transposed(self) -> Block:
        """The same with rows for columns."""
        places = {(column, row): place for (row, column), place in self.places.items()}
        return Block(self.columns, self.rows, places)

    @property
    def gathered(self) -> list[int]:
        """Places of the entries, column by column."""
        return [self.places[at] for at in self._ordered]

    @property
    def pattern(self) -> tuple[int, ...]:
        """The pattern as CasADi has it: sizes, where each column begins, and the rows."""
        if len(self.places) == self.rows * self.columns:
            return dense_pattern(self.rows, self.columns)
        ordered = self._ordered
        begins = [sum(column < j for _, column in ordered) for j in range(self.columns + 1)]
        return (self.rows, self.columns, *begins, *(row for row, _ in ordered))

    @property
    def stored_at(self) -> int | None:
        """Where it begins if it is all there and stands row by row in scratch; otherwise None."""
        start = self.places.get((0, 0))
        if start is None or len(self.places) < self.rows * self.columns:
            return None
        row_by_row = all(
            place == start + i * self.columns + j for (i, j), place in self.places.items()
        )
        return start if row_by_row else None

    @property
    def _ordered(self) -> list[tuple[int, int]]:
        return sorted(self.places, key=lambda at: (at[1], at[0]))


@dataclass(frozen=True)
class Matrix:
    """An array in scratch, row by row from `start`, and which of its entries can be nonzero."""

    start: int
    rows: int
    columns: int
    nonzeros: frozenset[tuple[int, int]]

    def part(self, row: int, rows: int, column: int, columns: int) -> Block:
        """A block by its first row and column, and how many there are of each."""
        places = {
            (i - row, j - column): self.start + i * self.columns + j
            for i, j in self.nonzeros
            if row <= i < row + rows and column <= j < column + columns
        }
        return Block(rows, columns, places)

    @property
    def whole(self) -> Block:
        """All of it."""
        return self.part(0, self.rows, 0, self.columns)

    def with_rows(self, rows: int) -> Matrix:
        """The same array as a matrix of fewer rows, each of several of these."""
        together = self.rows // rows
        places = {(i // together, i % together * self.columns + j) for i, j in self.nonzeros}
        return Matrix(self.start, rows, together * self.columns, frozenset(places))

    @property
    def filled(self) -> Block:
        """All of it, also what is zero at every state."""
        every = entries(self.rows, self.columns)
        return Matrix(self.start, self.rows, self.columns, every).whole


def entries(rows: int, columns: int) -> frozenset[tuple[int, int]]:
    """Pairs of every row with every column."""
    return frozenset((i, j) for i in range(rows) for j in range(columns))


def dense_pattern(rows: int, columns: int) -> tuple[int, ...]:
    """The pattern of a matrix without zeros, as CasADi has it: three integers."""
    return (rows, columns, 1)


def empty(rows: int, columns: int) -> Block:
    """A matrix of zeros: a block without places."""
    return Block(rows, columns, {})


def column_by_column(block: Block, columns: int) -> Block:
    """Derivatives of a matrix's entries in the order that CasADi stacks these in, by columns.

    `block` has a row for each entry of the matrix, row by row; `columns` is 1 of a vector.
    """
    rows = block.rows // columns
    places = {
        (row % columns * rows + row // columns, column): place
        for (row, column), place in block.places.items()
    }
    return Block(block.rows, block.columns, places)


def by_coordinates(nonzeros: Iterable[tuple[int, int]]) -> frozenset[tuple[int, int]]:
    """Pattern of derivatives by the entries of q from that of those by the base's velocities.

    In place of the base's six columns come seven, of position and quaternion.
    """
    found: set[tuple[int, int]] = set()
    for i, j in nonzeros:
        targets = range(3) if j < 3 else range(3, 7) if j < 6 else (j + 1,)
        found.update((i, target) for target in targets)
    return frozenset(found)


Shape = tuple[int, ...]

PARAMETERS = "parameters"
# Entries of the maps between a change of the base's coordinates and its displacement.
_MAPS = 21
_BASE = 6


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
        # By their names, patterns as CasADi has them.
        self.inputs: dict[str, tuple[int, ...]] = {}
        self.outputs: list[tuple[str, Block]] = []
        self.body: Lines = []
        self.size = 0
        self._signatures = {s.name: s for s in model.signatures}
        self._is_quaternion = model.description.layout.is_quaternion
        self._arrays: dict[str, str] = {}
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
        given = {**self._arrays, **arrays}
        inputs = [given[argument] for argument in self._signatures[name].arguments]
        return call(f"{self.model.robot.name}_{name}", ["constants", *inputs, *outputs])

    def seeds(self) -> list[str]:
        """Take seeds of the outputs as further inputs, after inputs that hold the outputs.

        The arrays of the seeds are returned.
        """
        self.unused("out_", self.results)
        first = len(self.inputs)
        for name, shape in self.results:
            self.inputs[f"adj_{name}"] = dense_pattern(*as_matrix(shape))
        return [_input(first + i) for i in range(len(self.results))]

    def unused(self, prefix: str, arrays: Sequence[tuple[str, Shape]]) -> None:
        """Take inputs, by name and shape, that CasADi passes and no derivative reads."""
        for name, shape in arrays:
            self.inputs[prefix + name] = empty(*as_matrix(shape)).pattern

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
        size = self.model.description.layout.v.size
        taken = self.take(2 * size, 1)
        given = [self._arrays[name] for name in self.signature.arguments]
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
        arrays = [self._raw("q"), self._arrays["q"], at(self._maps), at(by_base.start)]
        self.body += call("add_curvature", [*arrays, str(hessian.columns), at(hessian.start)])
        columns = {column for _, column in by_base.nonzeros}
        found = set(hessian.nonzeros)
        if columns & {3, 4, 5}:
            found |= {(i, j) for i in range(3, 7) for j in range(3, 7)}
        if columns & {0, 1, 2}:
            crossing = {(i, j) for i in range(3) for j in range(3, 7)}
            found |= crossing | {(j, i) for i, j in crossing}
        return Matrix(hessian.start, hessian.rows, hessian.columns, frozenset(found))

    def differentiated_by_q(self, name: str = "q") -> None:
        """Compute what takes a change of the entries of q to the displacement of the base.

        Of other coordinates, the argument `name`, the entries are meant from here on.
        """
        if self._is_quaternion:
            maps = self.take(1, _MAPS)
            self._maps = maps.start
            factor = f"twice_over_length({self._raw(name)}, {self._arrays[name]})"
            self.body += call("base_maps", [self._arrays[name], factor, at(maps.start)])

    def _raw(self, argument: str) -> str:
        """Coordinates as they come, whose quaternion can be of any length."""
        return _input([name for name, _ in self.arguments].index(argument))

    def _take_argument(self, name: str, shape: Shape) -> None:
        """Take an input of the function, and bring it into the form that the function takes."""
        rows, columns = as_matrix(shape)
        given = _input(len(self.inputs))
        self.inputs[name] = dense_pattern(rows, columns)
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
        self._arrays[name] = given


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


# By output and input.
Blocks = dict[tuple[str, str], Block]


@dataclass(frozen=True)
class Derived:
    """Functions of the table that give the derivatives of one, empty where there is none."""

    jacobian: str
    gradient: str
    hessian: str
    by_parameters: str

    @classmethod
    def of(cls, name: str) -> Derived:
        """Those of a function; a tip's pose is one of those of the frames."""
        name = "frame_poses" if name == "tip_pose" else name
        return cls(*(derivative(name, k) for k in ("jacobian", "vjp", "hessian", "parameters")))


def derivative_forms(model: Model, signature: Signature, of_parameters: bool) -> list[Form]:
    """Those of `jac_F`, `adj1_F` and `jac_adj1_F` that the module has what it takes for.

    With `of_parameters` the parameters are an input.
    """
    row = Derived.of(signature.name)
    has = set(model.functions)
    if row.jacobian not in has or (of_parameters and row.by_parameters not in has):
        return []
    forms = [_jacobian(Form(model, signature, "JAC", of_parameters), row)]
    if of_parameters:
        # Matrices by the parameters that the module has make a gradient too.
        if row.gradient in has and _is_gradient(row.by_parameters):
            forms.append(_gradient(Form(model, signature, "ADJ", of_parameters), row))
    elif {row.gradient, row.hessian} <= has:
        forms.append(_gradient(Form(model, signature, "ADJ", of_parameters), row))
        forms.append(_hessian(Form(model, signature, "JAC_ADJ", of_parameters), row))
    return forms


def _jacobian(form: Form, row: Derived) -> Form:
    """Complete `jac_F`."""
    blocks = _blocks(form, row)
    form.unused("out_", form.results)
    if form.model.description.layout.is_quaternion:
        for (output, name), block in blocks.items():
            blocks[output, name] = _without_shifts(block, output) if name == "q" else block
    for output, shape in form.results:
        for name, of_input in form.arguments:
            none = empty(math.prod(shape), math.prod(of_input))
            block = column_by_column(blocks.get((output, name), none), as_matrix(shape)[1])
            form.outputs.append((f"jac_{output}_{name}", block))
    return form


def _gradient(form: Form, row: Derived) -> Form:
    """Complete `adj1_F`."""
    (seed,) = form.seeds()
    form.differentiated_by_q()
    found = list(form.call(row.gradient, w=seed).values())
    found[0] = form.by_entries_of_q(found[0])
    if form.of_parameters:
        found += form.call(row.by_parameters, w=seed).values()
    for (name, shape), gradient in zip(form.arguments, found, strict=True):
        block = gradient.filled if len(shape) > 1 else gradient.filled.transposed
        form.outputs.append((f"adj_{name}", block))
    return form


def _hessian(form: Form, row: Derived) -> Form:
    """Complete `jac_adj1_F`."""
    jacobian = _blocks(form, row)
    (seed,) = form.seeds()
    blocks = _second(form, row, seed)
    form.unused("out_adj_", form.arguments)
    ((output, shape),) = form.results
    sizes = {name: math.prod(of_input) for name, of_input in form.arguments}
    size = math.prod(shape)
    for name, rows in sizes.items():
        for other, columns in sizes.items():
            block = blocks.get((name, other), empty(rows, columns))
            form.outputs.append((f"jac_adj_{name}_{other}", block))
        form.outputs.append((f"jac_adj_{name}_out_{output}", empty(rows, size)))
        by_seed = jacobian[output, name].transposed
        form.outputs.append((f"jac_adj_{name}_adj_{output}", by_seed))
    return form


def _blocks(form: Form, row: Derived) -> Blocks:
    """First derivatives of a function, each output row by row: the blocks that are not zero."""
    by = {output.by: output.name for output in FUNCTIONS[row.jacobian].outputs if output.by}
    coordinates = [name for name in by or "q" if ARGUMENTS[name].is_coordinates]
    if len(coordinates) == 1:
        form.differentiated_by_q()
    found = form.call(row.jacobian)
    if not by:
        return _of_step(form, found)
    ((output, shape),) = form.results
    maps = None
    if form.signature.name == "integrate":
        maps = form.maps_at_result(form.call("integrate")[output])
    first, rows = 0, math.prod(shape)
    if form.signature.name == "tip_pose":
        first = rows * list(form.model.lists["FRAMES"]).index("tip")
    blocks = {}
    for name, matrix_name in by.items():
        matrix = found[matrix_name]
        if name in coordinates:
            if len(coordinates) > 1:
                form.differentiated_by_q(name)
            matrix = form.by_entries_of_q(matrix)
        if maps is not None:
            matrix = form.rows_by_entries_of_q(matrix, maps)
        *_, columns = of_input = dict(form.arguments)[name]
        if len(of_input) > 1:
            block = matrix.with_rows(rows).whole
            blocks[output, name] = column_by_column(block.transposed, columns).transposed
            continue
        blocks[output, name] = matrix.part(first, rows, 0, matrix.columns)
    if form.of_parameters:
        blocks[output, PARAMETERS] = _by_parameters(form, row).whole
    return blocks


def _without_shifts(block: Block, output: str) -> Block:
    """Derivatives by q without the zeros that those by the position have.

    Of derivatives by the position only those of positions by the same axis are not zero; they are
    one. `block` is by position, quaternion and joints, row by row.
    """

    def axis(row: int) -> int | None:
        if output in ("coordinates", "q_next"):
            return row if row < 3 else None
        is_position = output in ("pose", "poses") and row % 4 == 3 and row % 16 < 12
        return row % 16 // 4 if is_position else None

    places = {
        (row, column): place
        for (row, column), place in block.places.items()
        if column >= 3 or axis(row) == column
    }
    return Block(block.rows, block.columns, places)


def _of_step(form: Form, found: Mapping[str, Matrix]) -> Blocks:
    """First derivatives of a time step. Those by its length are computed if they are asked for.

    `found` are the outputs of the function with the derivatives.
    """
    maps = form.maps_at_result(found["q_next"])
    known = step_patterns(form.model, form.signature.name)
    by_state, by_input = (replace(found[name], nonzeros=known[name]) for name in "AB")
    by_state = form.rows_by_entries_of_q(form.by_entries_of_q(by_state), maps)
    by_input = form.rows_by_entries_of_q(by_input, maps)
    written = len(form.body)
    by_length = form.rows_by_entries_of_q(form.by_length(), maps)
    places = [i for i in range(2 * len(form.arguments)) if i % len(form.arguments) == 3]
    condition = " || ".join(f"res[{place}]" for place in places)
    computed = [f"    {line}" for line in form.body[written:]]
    form.body[written:] = [f"if ({condition}) {{", *computed, "}"]
    blocks: Blocks = {}
    sizes = {name: math.prod(shape) for name, shape in form.arguments}
    for (output, shape), above in zip(form.results, (0, sizes["q"]), strict=True):
        rows = math.prod(shape)
        blocks[output, "q"] = by_state.part(above, rows, 0, sizes["q"])
        blocks[output, "v"] = by_state.part(above, rows, sizes["q"], sizes["v"])
        blocks[output, "u"] = by_input.part(above, rows, 0, sizes["u"])
        blocks[output, "h"] = by_length.part(above, rows, 0, 1)
    return blocks


def _by_parameters(form: Form, row: Derived) -> Matrix:
    """Derivatives by the parameters, row by row where the module has but gradients."""
    if not _is_gradient(row.by_parameters):
        (matrix,) = form.call(row.by_parameters).values()
        return matrix
    rows = math.prod(form.results[0][1])
    seed, made = form.take(1, rows), form.take(rows, len(form.model.defaults))
    line = f"&scratch[{made.start} + i * {made.columns}]"
    calling = form.calling(row.by_parameters, [line], w=at(seed.start))
    one = f"scratch[{seed.start} + i]"
    form.body += loop("i", rows, [f"{one} = 0;"])
    form.body += loop("i", rows, [f"{one} = 1;", *calling, f"{one} = 0;"])
    return made


def _second(form: Form, row: Derived, seed: str) -> Blocks:
    """Blocks of second derivatives of the outputs times seeds, by both inputs; none of zeros.

    `seed` is the array of the seeds.
    """
    found = form.call(row.hessian, w=seed)
    names = [name for name, _ in form.arguments]
    blocks: Blocks = {}
    if len(found) == 1:
        (matrix,) = found.values()
        matrix = form.rows_by_entries_of_q(form.by_entries_of_q(matrix))
        matrix = form.with_curvature(matrix, row.gradient, seed)
        sizes = [math.prod(shape) for _, shape in form.arguments]
        begins = [sum(sizes[:i]) for i in range(len(sizes))]
        for name, row_begin, rows in zip(names, begins, sizes, strict=True):
            for other, begin, columns in zip(names, begins, sizes, strict=True):
                blocks[name, other] = matrix.part(row_begin, rows, begin, columns)
        return blocks
    # Outputs are named for the two arguments by which they are derivatives.
    for both, matrix in found.items():
        name, other = both[0], both[1]
        if other == "q":
            matrix = form.by_entries_of_q(matrix)
        if name == "q":
            matrix = form.rows_by_entries_of_q(matrix)
        if name == other == "q":
            matrix = form.with_curvature(matrix, row.gradient, seed)
        blocks[name, other] = matrix.whole
        blocks[other, name] = matrix.whole.transposed if name != other else matrix.whole
    return blocks


def _is_gradient(name: str) -> bool:
    """Whether a function takes seeds."""
    return "w" in FUNCTIONS[name].arguments


_BEGINNINGS = {"CASADI": "", "JAC": "jac_", "ADJ": "adj1_", "JAC_ADJ": "jac_adj1_"}


class _Tables:
    """Constant arrays, each of which stands in the source once."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, tuple[int, ...]], str] = {}

    def pattern(self, pattern: tuple[int, ...]) -> str:
        """Name of the array that holds a pattern, as CasADi has it."""
        return self._name("casadi_int", "pattern", pattern)

    def places(self, places: Sequence[int]) -> str:
        """Name of the array that holds places in scratch, at least one."""
        return self._name("int", "places", tuple(places))

    def texts(self) -> list[Context]:
        """All arrays: the type of their integers, their names, and what stands in braces."""
        return [
            {
                "kind": kind,
                "name": name,
                "lines": textwrap.wrap(", ".join(map(str, numbers)), WIDTH - 4),
            }
            for (kind, numbers), name in self._names.items()
        ]

    def _name(self, kind: str, word: str, numbers: tuple[int, ...]) -> str:
        """Name of an array with these numbers, a new one if there is none.

        `kind` is the type of the numbers, and the name begins with `word`.
        """
        return self._names.setdefault((kind, numbers), f"{word}_{len(self._names) + 1}")


def casadi_text(model: Model) -> Context:
    """Context of the adapter's template.

    `kinds` has what the names of functions of each kind begin with. `differentiated` and `twice`
    say whether there are derivatives, and second ones. `widest` is the width of the widest input.
    `steps` have derivatives by their lengths: `vectors` with entries for each of VELOCITIES, and
    `places` for each of COORDINATES. No array of C has as few as no `input_entries`.
    """
    tables = _Tables()
    texts = [
        _form_text(form, tables)
        for signature in model.signatures
        if signature.arguments
        for of_parameters in (False, True)
        for form in (
            _function(model, signature, of_parameters),
            *derivative_forms(model, signature, of_parameters),
        )
    ]
    widths = [width for signature in model.signatures for width in signature.widths]
    kinds = {text["kind"] for text in texts}
    return {
        "is_quaternion": model.description.layout.is_quaternion,
        "kinds": {kind: beginning for kind, beginning in _BEGINNINGS.items() if kind in kinds},
        "differentiated": kinds != {"CASADI"},
        "twice": "JAC_ADJ" in kinds,
        "column_major": c_source("column_major.c"),
        "widest": max(*widths, len(model.defaults)),
        "tables": tables.texts(),
        "input_entries": f"NV * {model.robot.name.upper()}_INPUTS"
        if model.lists["INPUTS"]
        else "1",
        "steps": [
            {
                "name": name,
                "vectors": VECTORS[name],
                "places": PLACES[name],
                "lines": length_lines(model.robot.name, method),
            }
            for name, method in METHODS.items()
            if {name, f"{name}_derivatives"} <= {*model.functions}
        ],
        "forms": texts,
    }


def _function(model: Model, signature: Signature, of_parameters: bool) -> Form:
    """Form of a function of the module, with the parameters as an input or without."""
    form = Form(model, signature, "CASADI", of_parameters)
    found = form.call(signature.name)
    for (name, shape), matrix in zip(form.results, found.values(), strict=True):
        block = matrix.filled
        form.outputs.append((name, block if len(shape) > 1 else block.transposed))
    return form


def _form_text(form: Form, tables: _Tables) -> Context:
    """A form for the template: names of inputs and outputs with patterns, and its body.

    `parameters` is the place of the parameters among the inputs, empty without them.
    """
    stored = [_stored(i, block, tables) for i, (_, block) in enumerate(form.outputs)]
    return {
        "kind": form.kind,
        "name": form.name,
        "inputs": [(name, tables.pattern(pattern)) for name, pattern in form.inputs.items()],
        "outputs": [(name, tables.pattern(block.pattern)) for name, block in form.outputs],
        "parameters": str([*form.inputs].index(PARAMETERS)) if form.of_parameters else "",
        "body": [*form.body, *filter(None, stored)],
        "entries": form.size,
    }


def _stored(place: int, block: Block, tables: _Tables) -> str:
    """The line that writes an output; "" of a matrix of zeros."""
    if not block.places:
        return ""
    if (start := block.stored_at) is not None:
        return f"store({block.rows}, {block.columns}, {at(start)}, res[{place}]);"
    places = tables.places(block.gathered)
    return f"gather({len(block.places)}, {places}, scratch, res[{place}]);"
