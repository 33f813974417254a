"""Structural numbers: exact where they can be, and sums that vanish do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from fractions import Fraction

import pytest
import sympy as sp
from support.derived import derived

from gibbs_codegen.program.nodes import Node, Number, Product
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.symbolic.numbers import exact
from gibbs_codegen.symbolic.vectors import cos_sin_deg, gather, structural_number


@pytest.mark.parametrize(
    ("degrees", "cos", "sin"),
    [
        (0, 1, 0),
        (90, 0, 1),
        (-180, -1, 0),
        (60, sp.Rational(1, 2), sp.sqrt(3) / 2),
        (405, None, None),
    ],
)
def test_multiples_of_30_and_45_are_exact(degrees: int, cos: object, sin: object) -> None:
    c, s = cos_sin_deg(Fraction(degrees))
    if cos is None:
        cos = sin = sp.sqrt(2) / 2
    assert (c, s) == (cos, sin)


def test_other_angles_carry_forty_digits() -> None:
    c, s = cos_sin_deg(Fraction(360, 7))
    assert abs(c - sp.cos(2 * sp.pi / 7).evalf(60)) < sp.Float("1e-40")
    assert abs(s - sp.sin(2 * sp.pi / 7).evalf(60)) < sp.Float("1e-40")


@pytest.mark.parametrize("count", [3, 5, 6, 7, 8, 11, 24, 40, 250])
def test_sums_over_a_regular_polygon_vanish_exactly(count: int) -> None:
    x = sp.Symbol("x")
    turns = [cos_sin_deg(Fraction(360 * k, count)) for k in range(count)]
    assert gather(sp.Add(*(c * x for c, _ in turns))) == 0
    assert gather(sp.Add(*(s * x for _, s in turns))) == 0
    assert gather(sp.Add(*(c * s * x for c, s in turns))) == 0
    assert gather(sp.Add(*(c * c * x for c, _ in turns))) == sp.Rational(count, 2) * x


def test_what_does_not_vanish_stays() -> None:
    x, y = sp.symbols("x y")
    assert gather(sp.sqrt(3) * x / 2 + sp.sqrt(3) * x / 2 - y + y) == sp.sqrt(3) * x


@pytest.mark.parametrize(
    ("number", "expected"),
    [
        (math.cos(math.pi / 6), sp.sqrt(3) / 2),
        (-0.6250000000000001, sp.Rational(-5, 8)),
        (3 * math.sqrt(3) / 8, 3 * sp.sqrt(3) / 8),
        (1e-17, 0),
        (math.cos(0.3), sp.Float(math.cos(0.3), 40)),
    ],
)
def test_entries_of_directions_are_roots_of_fractions(number: float, expected: sp.Expr) -> None:
    assert exact(number) == expected


@pytest.mark.parametrize("number", [1.0, -1.0, 0.0])
def test_whole_numbers_are_integers(number: float) -> None:
    """Whether SymPy takes 1.0 for 1, and drops it as a factor, depends on its version."""
    assert structural_number(sp.Float(number)).is_Integer
    assert not structural_number(sp.Float(number + 0.5)).is_Integer


def test_an_angle_that_forty_digits_cannot_tell_from_none_has_a_cosine_of_one() -> None:
    cos, sin = cos_sin_deg(Fraction(1, 10**25))
    assert cos is sp.S.One
    assert 0 < sin < 2e-27


@pytest.mark.parametrize(
    "name", ["hexarotor", pytest.param("hexarotor_3link", marks=pytest.mark.slow)]
)
def test_numbers_of_a_program_are_exact_until_they_are_rounded(name: str) -> None:
    """Fractions among them are the nearest doubles, and no number is there a second time.

    cos² 30° is 0.75, not 0.74999999999999989, whatever it is made of.
    """
    program = derived(read_robot(name)[0]).program
    constants = [statement.value for statement in program.prepare]
    functions = [node for function in program.functions for node in function.nodes()]
    for node in (part for value in (*constants, *functions) for part in nodes_in(value)):
        if isinstance(node, Number):
            fraction = round(24 * node.value) / 24
            assert abs(node.value - fraction) > 1e-9 or node.value == fraction
    multiples: dict[tuple[Node, ...], list[float]] = {}
    for value in constants:
        match value:
            case Product((Number(number), *factors)):
                multiples.setdefault(tuple(factors), []).append(number)
    assert multiples
    for numbers in multiples.values():
        assert all(abs(x - 1.0) > 1e-9 for x in numbers)
        assert all(abs(x - y) > 1e-9 for x, y in itertools.combinations(numbers, 2))


def nodes_in(node: Node) -> Iterator[Node]:
    yield node
    for part in node.operands:
        yield from nodes_in(part)
