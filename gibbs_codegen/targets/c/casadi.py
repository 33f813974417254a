"""The adapter by which CasADi calls a module's functions, and their derivatives, as external ones.

Every function has two forms, the second with the parameters as a further input. What CasADi asks
for beside a function is in `casadi_derivatives`.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from gibbs_codegen.interface import Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.c.casadi_blocks import Block
from gibbs_codegen.targets.c.casadi_derivatives import derivative_forms
from gibbs_codegen.targets.c.casadi_form import PARAMETERS, Form, Port, at
from gibbs_codegen.targets.c.statements import WIDTH
from gibbs_codegen.targets.c.step_methods import METHODS, PLACES, VECTORS, length_lines
from gibbs_codegen.targets.verbatim import c_source

Lines = list[str]


@dataclass(frozen=True)
class TableText:
    """A constant array of integers: their type, its name, and what stands in braces."""

    kind: str
    name: str
    lines: Lines


@dataclass(frozen=True)
class FormText:
    """A function that CasADi calls.

    `kind` is the macro that makes its name of `name`. `inputs` and `outputs` are names with
    patterns. `parameters` is the place of the parameters among the inputs, empty without them.
    """

    kind: str
    name: str
    inputs: list[tuple[str, str]]
    outputs: list[tuple[str, str]]
    parameters: str
    body: Lines
    entries: int


@dataclass(frozen=True)
class LengthText:
    """A time step whose derivatives by its length are computed.

    `vectors` have entries for each of VELOCITIES, and `places` for each of COORDINATES. No array of
    C has as few as no `input_entries`.
    """

    name: str
    input_entries: str
    vectors: Lines
    places: Lines
    lines: Lines


@dataclass(frozen=True)
class CasadiText:
    """What the adapter's template is given.

    `kinds` has what the names of functions of each kind begin with. `differentiated` and `twice`
    say whether there are derivatives, and second ones. `widest` is the width of the widest input.
    """

    is_quaternion: bool
    kinds: dict[str, str]
    differentiated: bool
    twice: bool
    column_major: str
    widest: int
    tables: list[TableText]
    steps: list[LengthText]
    forms: list[FormText]


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

    def texts(self) -> list[TableText]:
        """All arrays."""
        return [
            TableText(kind, name, textwrap.wrap(", ".join(map(str, numbers)), WIDTH - 4))
            for (kind, numbers), name in self._names.items()
        ]

    def _name(self, kind: str, word: str, numbers: tuple[int, ...]) -> str:
        """Name of an array with these numbers, a new one if there is none.

        `kind` is the type of the numbers, and the name begins with `word`.
        """
        return self._names.setdefault((kind, numbers), f"{word}_{len(self._names) + 1}")


def casadi_text(model: Model) -> CasadiText:
    """Context of the adapter's template."""
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
    kinds = {text.kind for text in texts}
    return CasadiText(
        layout_of(model.robot).is_quaternion,
        {kind: beginning for kind, beginning in _BEGINNINGS.items() if kind in kinds},
        kinds != {"CASADI"},
        "JAC_ADJ" in kinds,
        c_source("column_major.c"),
        max(*widths, len(model.defaults)),
        tables.texts(),
        [
            _length_text(model, name)
            for name in METHODS
            if {name, f"{name}_derivatives"} <= {*model.derivatives}
        ],
        texts,
    )


def _length_text(model: Model, name: str) -> LengthText:
    """What the template is given of a time step."""
    lines = length_lines(model.robot.name, METHODS[name])
    entries = f"NV * {model.robot.name.upper()}_INPUTS" if model.lists["INPUTS"] else "1"
    return LengthText(name, entries, VECTORS[name], PLACES[name], lines)


def _function(model: Model, signature: Signature, of_parameters: bool) -> Form:
    """Form of a function of the module, with the parameters as an input or without."""
    form = Form(model, signature, "CASADI", of_parameters)
    found = form.call(signature.name)
    for (name, shape), matrix in zip(form.results, found.values(), strict=True):
        block = matrix.filled
        form.outputs.append((name, block if len(shape) > 1 else block.transposed))
    return form


def _form_text(form: Form, tables: _Tables) -> FormText:
    """What the template is given of a form."""
    outputs = [Port(name, block.pattern) for name, block in form.outputs]
    stored = [_stored(i, block, tables) for i, (_, block) in enumerate(form.outputs)]
    names = [port.name for port in form.inputs]
    return FormText(
        form.kind,
        form.name,
        [(port.name, tables.pattern(port.pattern)) for port in form.inputs],
        [(port.name, tables.pattern(port.pattern)) for port in outputs],
        str(names.index(PARAMETERS)) if form.of_parameters else "",
        [*form.body, *(line for line in stored if line)],
        form.size,
    )


def _stored(place: int, block: Block, tables: _Tables) -> str:
    """The line that writes an output; "" of a matrix of zeros."""
    if not block.places:
        return ""
    if (start := block.stored_at) is not None:
        return f"store({block.rows}, {block.columns}, {at(start)}, res[{place}]);"
    places = tables.places(block.gathered)
    return f"gather({len(block.places)}, {places}, scratch, res[{place}]);"
