"""acados: what its templates are given, and what each function that it links takes and needs.

Names, order, shapes and transposes are those of acados' generator `casadi_function_generation.py`.
Shapes are written with the macros of the template. The text of a function is the file of its name
in `gibbs_codegen/emitted/acados`.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.layout import inputs, layout_of
from gibbs_codegen.targets.c.statements import WIDTH
from gibbs_codegen.targets.printers import InfixPrinter
from gibbs_codegen.targets.verbatim import c_joined, c_source

_X, _U, _P, _WITH_STEP = "NX, 1", "NU, 1", "NP, 1", "NP_AND_STEP, 1"
_BY_X, _BY_U, _BY_BOTH = "NX, NX", "NX, NU", "NXU, NXU"
# Algebraic states z and time t, which a robot does not have.
_NONE = "0, 0"
_BY_Z = "NX, 0"
_IMPLICIT = (_X, _X, _U, _NONE, _NONE, _P)
_SLOPES = ("inverse_dynamics_derivatives", "input_forces_derivatives")
_CURVATURE = ("forward_dynamics_vjp", "forward_dynamics_hessian")


@dataclass(frozen=True)
class Form:
    """A function that acados links, and the functions generated on request that it needs.

    Inputs and outputs are rows and columns of matrices.
    """

    name: str
    needs: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


FORMS = (
    Form("expl_ode_fun", (), (_X, _U, _P), (_X,)),
    Form(
        "expl_vde_forw",
        ("forward_dynamics_derivatives",),
        (_X, _BY_X, _BY_U, _U, _P),
        (_X, _BY_X, _BY_U),
    ),
    Form("expl_vde_adj", ("forward_dynamics_vjp",), (_X, _X, _U, _P), ("NXU, 1",)),
    Form(
        "expl_ode_hess",
        _CURVATURE,
        (_X, _BY_X, _BY_U, _X, _U, _P),
        ("NXU, 1", "NXU * (NXU + 1) / 2, 1"),
    ),
    Form("impl_dae_fun", (), _IMPLICIT, (_X,)),
    Form("impl_dae_fun_jac_x_xdot_z", _SLOPES, _IMPLICIT, (_X, _BY_X, _BY_X, _BY_Z)),
    Form("impl_dae_jac_x_xdot_u_z", _SLOPES, _IMPLICIT, (_BY_X, _BY_X, _BY_U, _BY_Z)),
    Form("impl_dae_fun_jac_x_xdot_u", _SLOPES, _IMPLICIT, (_X, _BY_X, _BY_X, _BY_U)),
    Form("impl_dae_fun_jac_x_xdot_u_z", _SLOPES, _IMPLICIT, (_X, _BY_X, _BY_X, _BY_U, _BY_Z)),
    Form(
        "impl_dae_hess",
        (
            "inverse_dynamics_vjp",
            "inverse_dynamics_hessian",
            "input_forces_derivatives",
            "input_forces_hessian",
        ),
        (_X, _X, _U, _NONE, _X, _NONE, _P),
        ("2 * NX + NU, 2 * NX + NU",),
    ),
    Form("dyn_disc_phi_fun", (), (_X, _U, _WITH_STEP), (_X,)),
    Form(
        "dyn_disc_phi_fun_jac",
        ("forward_dynamics_derivatives",),
        (_X, _U, _WITH_STEP),
        (_X, "NXU, NX"),
    ),
    Form(
        "dyn_disc_phi_fun_jac_hess",
        ("forward_dynamics_derivatives", *_CURVATURE),
        (_X, _U, _X, _WITH_STEP),
        (_X, "NXU, NX", _BY_BOTH),
    ),
)


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
