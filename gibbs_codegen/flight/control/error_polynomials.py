"""Decay of tracking errors under a law: the characteristic polynomials of their equations.

Under computed torque the error e of a coordinate obeys ë + d ė + k e = 0. With motors of time
constant T, errors of the base obey T e⃛ + ë + d ė + k e = 0. Under the geometric law that holds for
joints, heading and height; sideways, what the position's error asks for is what the thrust axis
follows by the gains of the attitude. Integral action of rate i adds i k ∫ e to each k e, but for
the attitude of the geometric law. A frame that a law moves obeys m ë + d ė + k e = 0, too.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.laws import Controller, Gains
from gibbs_codegen.flight.control.sampled_control import ControlLaw
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.machine.laws import LAWS

# Real parts count as 0 below this share of the greatest root.
_ROUNDING = 1e-9
# Bisections by which the greatest rate of integral action is found.
_BISECTIONS = 40


def error_polynomials(controller: ControlLaw, lags: Sequence[float]) -> list[Array]:
    """Characteristic polynomials of the errors under a law, highest power first.

    None if the law does not correct errors. `lags` are time constants of motors, s.
    """
    if controller.law not in LAWS:
        return []
    gains, places = controller.gains, controller.vehicle.layout.v
    coefficients, law = np.stack([gains.damping, gains.stiffness], axis=-1), LAWS[controller.law]
    of_frame = []
    if law.moves_frame:
        terms = [controller.values[f"frame_{x}"] for x in ("damping", "stiffness", "inertia")]
        pairs = np.stack(terms[:2], axis=-1) / terms[2][:, np.newaxis]
        # Where the base leans joints move the frame, which do not lag.
        felt = () if law.leans else lags
        of_frame = _decoupled(pairs, gains.integral if law.pushes else 0.0, felt)
    if not law.leans:
        return of_frame + _decoupled(coefficients, gains.integral, lags)
    rest = np.delete(coefficients, places.attitude, axis=0)
    polynomials = of_frame + _decoupled(rest, gains.integral, lags)
    if gains.integral:  # The heading has the gains of the position, and no integral.
        polynomials += _decoupled(coefficients[places.position], 0.0, lags)
    pair = coefficients[places.position][:1], coefficients[places.attitude][:1]
    return polynomials + _sideways(gains, *pair, lags)


def _decoupled(pairs: Array, integral: float, lags: Sequence[float]) -> list[Array]:
    """Polynomials, highest power first, of errors that nothing else acts on.

    `pairs` (k, 2) are their damping and stiffness. Torques of joints do not lag: without comes
    first.
    """
    polynomials = []
    # Without stiffness a servo corrects the error.
    for pair in np.unique(pairs[pairs[:, 1] > 0.0], axis=0):
        rest = [*pair, integral * pair[1]] if integral else pair
        polynomials.append(np.array([1.0, *rest]))
        polynomials += [np.array([lag, 1.0, *rest]) / lag for lag in lags]
    return polynomials


def _sideways(gains: Gains, position: Array, attitude: Array, lags: Sequence[float]) -> list[Array]:
    """Polynomials of a position that the thrust axis makes, under the geometric law.

    Damping and stiffness of `position` and `attitude` are (1, 2); highest power first.
    """
    polynomials = []
    pairs = np.concatenate([position, attitude], axis=-1)
    for d, k, damping, stiffness in np.unique(pairs, axis=0):
        wish = [d, k, gains.integral * k] if gains.integral else [d, k]
        desired = np.polymul([damping, stiffness], wish)
        moved = [1.0] + [0.0] * len(wish)
        for lag in (0.0, *lags):
            lean = np.trim_zeros(np.array([lag, 1.0, damping, stiffness]), "f")
            whole = np.polyadd(np.polymul(lean, moved), desired)
            polynomials.append(whole / whole[0])
    return polynomials


def check_integral(law: Controller) -> None:
    """Raise `UsageError`, with the bound, where integral action is so fast that errors grow."""
    least, most = 0.0, law.gains.integral
    if not most or _decays(law, most):
        return
    for _ in range(_BISECTIONS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if _decays(law, middle) else (least, middle)
    raise UsageError(
        f"control.integral: {law.gains.integral:g} 1/s makes errors grow; give less than "
        f"{most:.3g} 1/s, or higher frequencies of control"
    )


def _decays(law: Controller, integral: float) -> bool:
    """True if errors decay under a law with integral action of a rate, 1/s."""
    polynomials = error_polynomials(replace(law, gains=replace(law.gains, integral=integral)), ())
    roots = np.array(list(itertools.chain.from_iterable(map(np.roots, polynomials))))
    return bool(np.all(roots.real < -_ROUNDING * np.max(np.abs(roots), initial=0.0)))
