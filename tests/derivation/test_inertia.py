"""Transport of inertia: a link seen from its parent is a Gibbs function with other B's."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.gibbs import (
    ACCELERATION,
    MASS,
    MOMENT,
    OMEGA,
    OMEGA_DOT,
    SECOND,
    link_gibbs_function,
    skew,
)
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.segment_tree import split_prismatic, split_revolute
from gibbs_codegen.symbolic.tape import InlineTape
from gibbs_codegen.symbolic.vectors import Rotation

TAPE = InlineTape()
BODY = Inertia(MASS, MOMENT, SECOND)


def gibbs(inertia: Inertia, motion: dict[sp.Expr, sp.Expr]) -> sp.Expr:
    return link_gibbs_function().xreplace({**inertia.values, **motion})


def accelerating_terms(expression: sp.Expr) -> sp.Expr:
    """The expression less its value at zero accelerations."""
    zeros = dict.fromkeys(ACCELERATION + OMEGA_DOT, sp.S.Zero)
    return sp.expand(expression - sp.expand(expression).xreplace(zeros))


def test_shift_is_the_gibbs_function_in_the_parents_acceleration() -> None:
    arm = sp.symbols("r_x:z")
    point = sp.Matrix(ACCELERATION) + (skew(OMEGA_DOT) + skew(OMEGA) ** 2) * sp.Matrix(arm)
    there = gibbs(BODY, dict(zip(ACCELERATION, point, strict=True)))
    here = gibbs(BODY.shifted(TAPE, arm), {})
    assert accelerating_terms(there) == accelerating_terms(here)


def test_rotation_leaves_the_gibbs_function_alone() -> None:
    """Checked with a rational rotation (3-4-5) about each axis, exactly."""
    for axis in range(3):
        turn = Rotation(axis, sp.Rational(3, 5), sp.Rational(4, 5))
        motion = {
            symbol: entry
            for symbols in (ACCELERATION, OMEGA, OMEGA_DOT)
            for symbol, entry in zip(symbols, turn.vector(TAPE, symbols), strict=True)
        }
        turned = gibbs(BODY.rotated(TAPE, turn), motion)
        assert sp.expand(turned - gibbs(BODY, {})) == 0


def test_quarter_turns_agree_with_the_general_rotation() -> None:
    for axis in range(3):
        for cos, sin in [(0, 1), (0, -1), (-1, 0)]:
            quarter = BODY.rotated(TAPE, Rotation(axis, sp.Integer(cos), sp.Integer(sin)))
            c, s = sp.symbols("c s")
            general = BODY.rotated(TAPE, Rotation(axis, c, s)).mapped(
                lambda e, c=c, s=s, cos=cos, sin=sin: sp.expand(
                    e.xreplace({c: sp.Integer(cos), s: sp.Integer(sin)})
                )
            )
            assert quarter == general


def test_a_revolute_joint_does_not_move_what_is_regrouped() -> None:
    kept, moved = split_revolute(BODY)
    assert kept.plus(TAPE, moved) == BODY
    c, s = sp.symbols("c s")
    assert moved.rotated(TAPE, Rotation(2, c, s)) == moved


def test_a_revolute_joint_does_not_feel_what_is_regrouped() -> None:
    """The part given to the parent has no row and no column for a turn about z."""
    _, moved = split_revolute(BODY)
    wrench = moved.response(TAPE, 5)
    assert (*wrench.force, *wrench.moment) == (0,) * 6


def test_prismatic_split_adds_up() -> None:
    kept, moved = split_prismatic(BODY)
    assert kept.plus(TAPE, moved) == BODY
    wrench = moved.response(TAPE, 2)
    assert (*wrench.force, *wrench.moment) == (0,) * 6
