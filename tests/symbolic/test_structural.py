"""Rotations that the robot file fixes: exact where they can be, and back from their angles."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from gibbs_codegen.symbolic.structural import (
    NO_TURN,
    Turn,
    applied,
    back,
    elementary,
    euler_zxz,
    product,
    turn_about,
    turned_by_rpy,
    z_onto,
)
from gibbs_codegen.symbolic.tape import InlineTape
from gibbs_codegen.symbolic.vectors import X, Y, Z

ANGLES = [(0, 0, 0), (90, 0, -90), (180, 0, 0), (30, 45, 60), (0, 90, 37), (0, 0, -200)]


def angles(*degrees: float) -> list[Fraction]:
    return [Fraction(str(angle)) for angle in degrees]


def numbers(turn: Turn) -> np.ndarray:
    return np.array(turn, float)


def test_a_quarter_turn_takes_one_axis_to_the_next() -> None:
    """About z: x to y, and y to −x; likewise about the others. All entries are whole."""
    assert turn_about(Z, Fraction(90)) == ((0, -1, 0), (1, 0, 0), (0, 0, 1))
    assert turn_about(X, Fraction(90)) == ((1, 0, 0), (0, 0, -1), (0, 1, 0))
    assert turn_about(Y, Fraction(90)) == ((0, 0, 1), (0, 1, 0), (-1, 0, 0))
    a, b, c = sp.symbols("a b c")
    assert applied(turn_about(Z, Fraction(90)), (a, b, c)) == (-b, a, c)


def test_roll_comes_first_and_yaw_last() -> None:
    """R_z·R_y·R_x: roll 90° takes z to −y, which yaw 90° takes to x."""
    turn = turned_by_rpy(angles(90, 0, 90))
    assert applied(turn, (sp.S.Zero, sp.S.Zero, sp.S.One)) == (1, 0, 0)
    pitched = turned_by_rpy(angles(0, 90, 0))
    assert applied(pitched, (sp.S.One, sp.S.Zero, sp.S.Zero)) == (0, 0, -1)


def test_sums_of_turns_that_are_whole_are_exact() -> None:
    """Seven and a half degrees twelve times is a quarter turn, to the last digit."""
    turn, step = NO_TURN, turn_about(Z, Fraction("7.5"))
    for _ in range(12):
        turn = product(turn, step)
    assert turn == turn_about(Z, Fraction(90))


@pytest.mark.parametrize("rpy", ANGLES)
def test_a_turn_and_the_way_back_are_nothing(rpy: tuple[int, int, int]) -> None:
    turn = turned_by_rpy(angles(*rpy))
    assert product(turn, back(turn)) == NO_TURN


@pytest.mark.parametrize("rpy", ANGLES)
def test_euler_angles_make_the_turn_again(rpy: tuple[int, int, int]) -> None:
    """R_z(γ)·R_x(α)·R_z(β), also as rotations of vectors, the innermost first."""
    turn = turned_by_rpy(angles(*rpy))
    gamma, alpha, beta = euler_zxz(turn)
    again = product(turn_about(Z, gamma), product(turn_about(X, alpha), turn_about(Z, beta)))
    assert np.allclose(numbers(again), numbers(turn), rtol=0.0, atol=1e-15)
    vector = sp.symbols("a b c")
    for rotation in elementary(turn):
        vector = rotation.vector(InlineTape(), vector)
    difference = sp.Matrix(vector) - sp.Matrix(applied(turn, sp.symbols("a b c")))
    values = difference.subs(dict(zip("abc", (0.3, -0.7, 1.1), strict=True)))
    assert max(abs(float(entry)) for entry in values) < 1e-15


@pytest.mark.parametrize(
    ("rpy", "expected"),
    [
        ((0, 0, 30), (0, 0, 30)),  # Parallel axes: all of it turns about the link's own.
        ((90, 0, 0), (0, 90, 0)),
        ((180, 0, 0), (0, 180, 0)),
        ((0, 90, 0), (90, 90, 270)),  # About y: x turned onto y, a twist, and back.
    ],
)
def test_euler_angles_of_simple_turns(
    rpy: tuple[int, int, int], expected: tuple[int, int, int]
) -> None:
    assert euler_zxz(turned_by_rpy(angles(*rpy))) == expected


@pytest.mark.parametrize(
    "direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (0.6, 0, 0.8), (-0.36, 0.48, 0.8)]
)
def test_z_goes_onto_an_axis(direction: tuple[float, float, float]) -> None:
    turn = z_onto(direction)
    assert np.allclose(numbers(turn)[:, 2], direction, rtol=0.0, atol=1e-15)
    if direction == (0, 0, 1):
        assert turn == NO_TURN
