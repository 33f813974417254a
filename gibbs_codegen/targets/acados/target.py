"""What the templates of acados are given."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.coordinates import inputs
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.acados.forms import FORMS, Form
from gibbs_codegen.targets.c.statements import WIDTH
from gibbs_codegen.targets.printers import InfixPrinter
from gibbs_codegen.targets.verbatim import c_joined, c_source

Lines = list[str]


@dataclass(frozen=True)
class AcadosText:
    """Everything in acados' functions and script that depends on the robot.

    `states` are the names of the entries of x. `forms` are the functions that there are;
    `form_lines` say the same in words, with what those that are missing need. `functions` is their
    text, with all that they call.
    """

    header: Lines
    name: str
    NAME: str
    states: Lines
    inputs: Lines
    parameters: dict[str, str]
    is_quaternion: bool
    forms: list[Form]
    form_lines: Lines
    functions: str


def module_text(model: Model, printer: InfixPrinter, header: Lines) -> AcadosText:
    """Context of the templates of acados; the printer is that of Python, for numbers."""
    layout = layout_of(model.robot)
    q = layout.q.names
    has = {form.name: {*form.needs} <= {*model.derivatives} for form in FORMS}
    forms = [form for form in FORMS if has[form.name]]
    base = "quaternion" if layout.is_quaternion else "angles"
    files = ["constants.c", *(f"{form.name}.c" for form in forms)]
    return AcadosText(
        header=header,
        name=model.robot.name,
        NAME=model.robot.name.upper(),
        # A rate that has the name of its coordinate gets another one.
        states=[*q, *(f"v_{name}" if name in q else name for name in layout.v.names)],
        inputs=[entry.name for entry in inputs(model.robot)],
        parameters={name: printer.number(value) for name, value in model.defaults.items()},
        is_quaternion=layout.is_quaternion,
        forms=forms,
        form_lines=_form_lines(model.robot.name, has),
        functions="\n\n".join(
            [c_source("column_major.c").strip(), c_joined("acados", files, {"base": base})]
        ),
    )


def _form_lines(name: str, has: dict[str, bool]) -> Lines:
    """The functions that there are, and those that are missing, with what brings them."""
    there = ", ".join(f"{name}_{form}" for form in has if has[form])
    lines = textwrap.wrap(f"There are {there}.", WIDTH - 4)
    missing: dict[tuple[str, ...], Lines] = {}
    for form in FORMS:
        if not has[form.name]:
            missing.setdefault(form.needs, []).append(f"{name}_{form.name}")
    if missing:
        lines += ["", "Missing are, with the functions that --derivatives would have to name too:"]
    for needed, forms in missing.items():
        lines += ["", *textwrap.wrap(f"{', '.join(forms)}: {', '.join(needed)}", WIDTH - 4)]
    return lines
