"""acados: what its templates are given, and what each function that it links takes.

Names, order, shapes and transposes are those of acados' generator `casadi_function_generation.py`.
Shapes are written with the macros of the template. The text of a function is the file of its name
in `gibbs_codegen/emitted/acados`, and it needs the functions of the table that it calls there.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.verbatim import c_joined, c_source
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.program.model import Model
from gibbs_codegen.targets.c.statements import WIDTH
from gibbs_codegen.targets.documentation import parameter_texts
from gibbs_codegen.targets.printers import Context, InfixPrinter, Lines

_X, _U, _P, _WITH_STEP = "NX, 1", "NU, 1", "NP, 1", "NP_AND_STEP, 1"
_BY_X, _BY_U, _BY_BOTH = "NX, NX", "NX, NU", "NXU, NXU"
# Algebraic states z and time t, which a robot does not have.
_NONE = "0, 0"
_BY_Z = "NX, 0"
_IMPLICIT = (_X, _X, _U, _NONE, _NONE, _P)


@dataclass(frozen=True)
class Form:
    """A function that acados links. Inputs and outputs are rows and columns of matrices."""

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


FORMS = (
    Form("expl_ode_fun", (_X, _U, _P), (_X,)),
    Form("expl_vde_forw", (_X, _BY_X, _BY_U, _U, _P), (_X, _BY_X, _BY_U)),
    Form("expl_vde_adj", (_X, _X, _U, _P), ("NXU, 1",)),
    Form(
        "expl_ode_hess",
        (_X, _BY_X, _BY_U, _X, _U, _P),
        ("NXU, 1", "NXU * (NXU + 1) / 2, 1"),
    ),
    Form("impl_dae_fun", _IMPLICIT, (_X,)),
    Form("impl_dae_fun_jac_x_xdot_z", _IMPLICIT, (_X, _BY_X, _BY_X, _BY_Z)),
    Form("impl_dae_jac_x_xdot_u_z", _IMPLICIT, (_BY_X, _BY_X, _BY_U, _BY_Z)),
    Form("impl_dae_fun_jac_x_xdot_u", _IMPLICIT, (_X, _BY_X, _BY_X, _BY_U)),
    Form("impl_dae_fun_jac_x_xdot_u_z", _IMPLICIT, (_X, _BY_X, _BY_X, _BY_U, _BY_Z)),
    Form(
        "impl_dae_hess",
        (_X, _X, _U, _NONE, _X, _NONE, _P),
        ("2 * NX + NU, 2 * NX + NU",),
    ),
    Form("dyn_disc_phi_fun", (_X, _U, _WITH_STEP), (_X,)),
    Form("dyn_disc_phi_fun_jac", (_X, _U, _WITH_STEP), (_X, "NXU, NX")),
    Form("dyn_disc_phi_fun_jac_hess", (_X, _U, _X, _WITH_STEP), (_X, "NXU, NX", _BY_BOTH)),
)


def module_text(model: Model, printer: InfixPrinter, header: Lines) -> Context:
    """Context of the templates of acados; the printer is that of Python, for numbers.

    `states` are the names of the entries of x. `forms` are the functions that there are;
    `form_lines` say the same in words, with what those that are missing need. `functions` is their
    text, with all that they call.

    Raises `UsageError` where the model has the functions for none of those that acados links.
    """
    layout = model.description.layout
    q = layout.q.names
    rooms = {"base": "quaternion" if layout.is_quaternion else "angles"}
    lacking = {}
    for form in FORMS:
        calls = re.findall(r"\bMODULE\((\w+)\)", c_joined("acados", [f"{form.name}.c"], rooms))
        needed = {*calls} & {*FUNCTIONS} - {*model.functions}
        lacking[form.name] = tuple(name for name in FUNCTIONS if name in needed)
    forms = [form for form in FORMS if not lacking[form.name]]
    if not forms:
        least = min(lacking.values(), key=len)
        raise UsageError(
            "--target acados: it links none of these functions; add "
            f"{' and '.join(least)} to --functions"
        )
    files = ["constants.c", *(f"{form.name}.c" for form in forms)]
    own = [c_source("column_major.c").strip(), c_joined("acados", files, rooms)]
    return {
        "header": header,
        "name": model.robot.name,
        "NAME": model.robot.name.upper(),
        # A rate that has the name of its coordinate gets another one.
        "states": [*q, *(f"v_{name}" if name in q else name for name in layout.v.names)],
        "inputs": [entry.name for entry in model.description.inputs],
        "parameters": parameter_texts(model, printer),
        "is_quaternion": layout.is_quaternion,
        "forms": forms,
        "form_lines": _form_lines(model.robot.name, lacking),
        "functions": "\n\n".join(own),
    }


def _form_lines(name: str, lacking: dict[str, tuple[str, ...]]) -> Lines:
    """The functions that there are, and those that are missing, with what brings them."""
    there = ", ".join(f"{name}_{form}" for form, needed in lacking.items() if not needed)
    lines = textwrap.wrap(f"There are {there}.", WIDTH - 4)
    missing: dict[tuple[str, ...], Lines] = {}
    for form, needed in lacking.items():
        if needed:
            missing.setdefault(needed, []).append(f"{name}_{form}")
    if missing:
        lines += ["", "Missing are, with the functions that --functions would have to name too:"]
    for needed, names in missing.items():
        lines += ["", *textwrap.wrap(f"{', '.join(names)}: {', '.join(needed)}", WIDTH - 4)]
    return lines
