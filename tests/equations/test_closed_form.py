"""The recursion (eq. 5) against brute force: the expanded S_j, differentiated by SymPy's diff."""

from __future__ import annotations

import pytest
import sympy as sp

from gibbs_codegen.equations.readable_chain import chain_closed_form
from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot


def assert_partials_are_derivatives(robot: Robot, number: int) -> None:
    """∂S_j/∂θ̈ by `diff` equals the recursion's, to thirty digits at an arbitrary point."""
    form = chain_closed_form(robot, number)
    symbols = sorted(form.gibbs.free_symbols, key=str)
    values = {
        symbol: sp.Float(sp.Rational(3 * i + 2, 7 * i + 5), 60) * (-1) ** i
        for i, symbol in enumerate(symbols)
    }
    size = abs(form.gibbs.xreplace(values)) + 1
    for acceleration, partial in zip(form.accelerations, form.partials, strict=True):
        brute = sp.diff(form.gibbs, acceleration)
        difference = brute.xreplace(values) - partial.xreplace(values)
        assert abs(difference) < sp.Float("1e-30") * size, acceleration


@pytest.mark.slow
def test_every_chain_of_the_papers_robot() -> None:
    assert_partials_are_derivatives(read_robot("hexarotor_3link")[0], 6)


def test_gibbs_function_of_a_rod_that_is_pulled_straight() -> None:
    """By hand: chain 2 has one massive rod; without rotation S is ½ m ẍ²."""
    robot = paper_family(4, 0)
    form = chain_closed_form(robot, 2)
    length, density = sp.symbols("base_arm_length base_arm_mass_per_length")
    values = {
        s: sp.S.Zero for s in form.gibbs.free_symbols if s.name not in (str(length), str(density))
    }
    values[sp.Symbol("a_x")] = sp.Integer(3)
    mass = density * length
    assert sp.simplify(form.gibbs.xreplace(values) - mass * sp.Rational(9, 2)) == 0


def test_unknown_chain_is_refused() -> None:
    with pytest.raises(UsageError, match="chains 1 to 4"):
        chain_closed_form(paper_family(4, 2), 5)
