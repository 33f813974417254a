"""The tape: one name per value, stages, signs, and nothing multiplied by 0 or 1."""

from __future__ import annotations

import pytest
import sympy as sp

from gibbs_codegen.symbolic.tape import InlineTape, Stage, Tape


@pytest.fixture
def tape() -> Tape:
    return Tape()


def symbols(tape: Tape) -> tuple[sp.Symbol, ...]:
    """A parameter, two configuration symbols and a motion symbol."""
    return (
        tape.symbol("p", Stage.PARAMETER),
        tape.symbol("x", Stage.CONFIGURATION),
        tape.symbol("y", Stage.CONFIGURATION),
        tape.symbol("w", Stage.MOTION),
    )


def test_same_expression_gets_the_same_name(tape: Tape) -> None:
    _, x, y, _ = symbols(tape)
    assert tape.let(x * y) is tape.let(y * x)
    assert len(tape.statements) == 1


def test_atoms_zeros_and_signs_pass_through(tape: Tape) -> None:
    _, x, y, _ = symbols(tape)
    assert tape.let(sp.S.Zero * x) == 0
    assert tape.let(sp.S.One * x) is x
    assert tape.let(-x) == -x
    assert tape.let(-x * y) == -tape.let(x * y)
    assert tape.let(x - y) == -tape.let(y - x)
    assert len(tape.statements) == 2


def test_products_inside_sums_are_shared(tape: Tape) -> None:
    _, x, y, w = symbols(tape)
    tape.let(x * y + w)
    before = len(tape.statements)
    tape.let(x * y - w)
    assert len(tape.statements) == before + 1


def test_what_depends_on_parameters_alone_is_hoisted(tape: Tape) -> None:
    p, x, _, w = symbols(tape)
    name = tape.let(3 * p * p * x * w)
    hoisted = [s for s in tape.statements if tape.stage(s) is Stage.PARAMETER]
    assert [tape.statements[s] for s in hoisted] == [3 * p * p]
    assert tape.stage(name) is Stage.MOTION


def test_parameter_terms_of_a_sum_are_hoisted_together(tape: Tape) -> None:
    p, x, _, _ = symbols(tape)
    r = tape.symbol("r", Stage.PARAMETER)
    name = tape.let(p + r + x)
    constant = tape.let(p + r)
    assert tape.stage(constant) is Stage.PARAMETER
    assert tape.statements[name] == constant + x


def test_stage_is_that_of_the_latest_operand(tape: Tape) -> None:
    p, x, y, w = symbols(tape)
    assert tape.stage(tape.let(p * x)) is Stage.CONFIGURATION
    assert tape.stage(tape.let(sp.sin(tape.let(x + y)))) is Stage.CONFIGURATION
    assert tape.stage(tape.let(p * w + x)) is Stage.MOTION


def test_negative_angles_share_their_sine(tape: Tape) -> None:
    _, x, y, _ = symbols(tape)
    assert tape.let(sp.sin(tape.let(y - x))) == -tape.let(sp.sin(tape.let(x - y)))
    assert tape.let(sp.cos(tape.let(y - x))) == tape.let(sp.cos(tape.let(x - y)))


def test_reciprocals_are_one_division(tape: Tape) -> None:
    p, x, _, _ = symbols(tape)
    tape.let(p / x)
    assert 1 / x in tape.statements.values()


def test_a_name_keeps_the_group_in_which_it_was_first_made(tape: Tape) -> None:
    _, x, y, w = symbols(tape)
    with tape.group("outer"):
        with tape.group("inner"):
            first = tape.let(x * y)
        assert tape.let(x * y) is first
        second = tape.let(x + y)
    third = tape.let(x * w)
    assert tape.groups == {first: "inner", second: "outer", third: ""}


def test_a_function_says_its_own_words_of_what_others_have_named(tape: Tape) -> None:
    p, x, y, w = symbols(tape)
    with tape.group("thrusts"):
        value = tape.let(p * x * y + w)
    before = dict(tape.groups)
    with tape.function() as groups, tape.group("axes"):
        assert tape.let(p * x * y + w) is value
    # The steps on the way too, not only the result.
    assert groups == dict.fromkeys(before, "axes")
    assert tape.groups == before == dict.fromkeys(before, "thrusts")


def test_what_a_group_makes_of_parameters_alone_belongs_to_the_constants(tape: Tape) -> None:
    p, x, _, _ = symbols(tape)
    with tape.group("of the state"):
        name = tape.let(p * p * x)
    with tape.group("of the parameters", Stage.PARAMETER):
        own = tape.let(p + 1)
    assert tape.groups[name] == "of the state"
    assert tape.groups[tape.let(p * p)].startswith("constant")
    assert tape.groups[own] == "of the parameters"


def test_unknown_node_is_an_error_that_names_it(tape: Tape) -> None:
    _, x, _, _ = symbols(tape)
    with pytest.raises(TypeError, match="tan"):
        tape.let(sp.tan(x))


HALVES = [(-1, 2), (3, 2), (-3, 2), (1, 2), (-2, 1)]


@pytest.mark.parametrize(("over", "under"), HALVES)
def test_powers_of_roots_are_what_they_say(tape: Tape, over: int, under: int) -> None:
    _, x, y, _ = symbols(tape)
    power = x ** sp.Rational(over, under)
    for expression in (power, 2 * y * power, power - y):
        result = tape.let(expression)
        for name, statement in reversed(tape.statements.items()):
            result = result.subs(name, statement)
        assert sp.simplify(result - expression) == 0


def test_other_powers_are_errors_that_name_them(tape: Tape) -> None:
    _, x, y, _ = symbols(tape)
    for power in (sp.cbrt(x), x**y, y * x ** sp.Rational(-1, 4)):
        with pytest.raises(TypeError, match="twice its exponent must be whole"):
            tape.let(power)


def test_inline_tape_names_nothing() -> None:
    inline = InlineTape()
    x = inline.symbol("x", Stage.CONFIGURATION)
    assert inline.let(x * x + 1) == x**2 + 1
