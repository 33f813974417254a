"""The functions that acados links of a model: what they take and return, and what each needs.

Names, order, shapes and transposes are those of acados' generator `casadi_function_generation.py`.
Shapes are written with the macros of the template. The text of a function is the file of its name
in `gibbs_codegen/emitted/acados`.
"""

from __future__ import annotations

from dataclasses import dataclass

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
