"""What the templates of acados are given."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.acados.forms import FORMS, Form
from gibbs_codegen.targets.c.statements import WIDTH
from gibbs_codegen.targets.printers import InfixPrinter
from gibbs_codegen.targets.verbatim import c_source

Lines = list[str]


@dataclass(frozen=True)
class AcadosText:
    """Everything in acados' functions that depends on the robot.

    `forms` are those that there are, and `has` says of every form whether it is among them;
    `form_lines` say the same in words, with what those that are missing need. `differentiated`,
    `slopes` and `curvatures` say whether any form has derivatives, matrices of first derivatives,
    and second derivatives.
    """

    header: Lines
    name: str
    NAME: str
    parameters: int
    is_quaternion: bool
    forms: list[Form]
    form_lines: Lines
    has: dict[str, bool]
    differentiated: bool
    slopes: bool
    curvatures: bool
    column_major: str


def module_text(model: Model, _: InfixPrinter, header: Lines) -> AcadosText:
    """Context of the templates of acados.

    Args:
        model: The derived robot.
        _: No expression is printed.
        header: Lines that open every file.

    Returns:
        The context.
    """
    has = {form.name: {*form.needs} <= {*model.derivatives} for form in FORMS}
    forms = [form for form in FORMS if has[form.name]]
    return AcadosText(
        header=header,
        name=model.robot.name,
        NAME=model.robot.name.upper(),
        parameters=len(model.defaults),
        is_quaternion=layout_of(model.robot).is_quaternion,
        forms=forms,
        form_lines=_form_lines(model.robot.name, has),
        has=has,
        differentiated=any(form.needs for form in forms),
        slopes=has["expl_vde_forw"] or has["impl_dae_fun_jac_x_xdot_z"],
        curvatures=has["expl_ode_hess"] or has["impl_dae_hess"],
        column_major=c_source("column_major.c"),
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
