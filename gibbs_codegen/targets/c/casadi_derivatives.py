"""The derivatives that CasADi looks up beside a function, from those that the module has.

Of a function F it asks for `jac_F`, with a matrix for each output and input, for `adj1_F`, the
gradient of the outputs times seeds, and for `jac_adj1_F`, the derivatives of that. Without
`adj1_F` it makes gradients of `jac_F`; with it, it may compute a Jacobian row by row, so that
`adj1_F` is there only where second derivatives or parameters need it. With `fwd1_F` it would
compute a Jacobian column by column, so that there is none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from gibbs_codegen.interface import FUNCTIONS, Signature, derivative
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.c.casadi_blocks import Block, Matrix, column_by_column, empty
from gibbs_codegen.targets.c.casadi_form import PARAMETERS, Form, as_matrix, at
from gibbs_codegen.targets.c.statements import loop
from gibbs_codegen.targets.c.step_patterns import step_patterns

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
    has = set(model.derivatives)
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
    if layout_of(form.model.robot).is_quaternion:
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
    for (name, _), gradient in zip(form.arguments, found, strict=True):
        form.outputs.append((f"adj_{name}", gradient.filled.transposed))
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
    form.differentiated_by_q()
    found = form.call(row.jacobian)
    by = {output.by: output.name for output in FUNCTIONS[row.jacobian].outputs if output.by}
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
        if name == "q":
            matrix = form.by_entries_of_q(matrix)
        if maps is not None:
            matrix = form.rows_by_entries_of_q(matrix, maps)
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
    asked = " || ".join(f"res[{place}]" for place in places)
    computed = [f"    {line}" for line in form.body[written:]]
    form.body[written:] = [f"if ({asked}) {{", *computed, "}"]
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
