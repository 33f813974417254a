"""The rows of the table of time steps, which are composed of other functions, and on request."""

from __future__ import annotations

from gibbs_codegen.interface.rows import Output, Row

_ENTRIES = "[{unit}]; rows belong to q_next and then to v_next"
_SLOPES = (
    Output(
        "A",
        "ss",
        "1, s, 1/s, rad/m or m/rad",
        entries=f"{_ENTRIES}, columns to q and then to v",
    ),
    Output("B", "su", "rad or m, or their rates, by N or N m", entries=f"{_ENTRIES}, columns to u"),
)


def _step(name: str, method: str, composed: dict[str, int], details: str) -> tuple[Row, Row]:
    """Rows of a time step by itself, and with its derivatives.

    `method` is the numerical method in words; `composed` says how often it calls forward_dynamics
    and integrate, `details` what is to be said of the method.
    """
    after = (
        Output("q_next", "q", "rad or m", entries="{coordinates}"),
        Output("v_next", "v", "rad/s or m/s", entries="{velocities}"),
    )
    moves = composed["integrate"]
    with_derivatives = {
        "forward_dynamics_derivatives": composed["forward_dynamics"],
        "integrate": moves,
        "integrate_derivatives": moves,
    }
    source = "eq. 19, integrated over a step of time"
    return (
        Row(
            name,
            "qvuh",
            after,
            f"Coordinates and velocities after a step of time, by {method}.",
            source,
            details,
            on_request=True,
            composed=composed,
        ),
        Row(
            f"{name}_derivatives",
            "qvuh",
            (*after, *_SLOPES),
            f"What {name} gives, and its derivatives by q, v and u.",
            source,
            "A displacement d of q and v together and one e of u move the result by A d + B e, "
            "with displacements of q and q_next in the tangent space, as integrate applies them.",
            on_request=True,
            composed=with_derivatives,
            derivative_of=name,
            kind="jacobian",
        ),
    )


STEPS = (
    *_step(
        "step_euler",
        "the semi-implicit Euler method",
        {"forward_dynamics": 1, "integrate": 1},
        "Inputs are constant in the step. v_next = v + h a, and q_next = integrate(q, h v_next). "
        "The method is of first order.",
    ),
    *_step(
        "step_rk4",
        "a Runge-Kutta method of fourth order",
        {"forward_dynamics": 4, "integrate": 5},
        "Inputs are constant in the step. With attitude angles it is the classical method. A "
        "quaternion moves by exponentials alone, without commutators (Celledoni, Marthinsen and "
        "Owren, 2003), which keeps the order, and the unit length.",
    ),
)
