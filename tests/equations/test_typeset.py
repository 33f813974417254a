"""Writing expressions: order, signs, powers, numbers, indices, lines."""

from __future__ import annotations

import pytest
import sympy as sp

from gibbs_codegen.equations.typeset import (
    LATEX,
    TEXT,
    Kind,
    Name,
    Writer,
    filled,
    hybrid_name,
    name,
    parameter_name,
)

Q, R, V, A, M = sp.symbols("q r v a m")
NAMES = {
    Q: name("theta", "2,3", Kind.COORDINATE, "angle"),
    R: name("theta", "2,4", Kind.COORDINATE, "angle"),
    V: name("theta", "2,3", Kind.RATE, "rate", "dot"),
    A: name("theta", "2,3", Kind.ACCELERATION, "acceleration", "ddot"),
    M: name("B_0", "2,4", Kind.INERTIA, "mass"),
}
S, C = sp.sin(Q), sp.cos(Q + R + sp.pi / 6)


@pytest.mark.parametrize(
    ("expression", "text", "latex"),
    [
        (V * M * S, "B0_{2,4}·s_{2,3}·θ̇_{2,3}", r"(B_0)_{2,4} s_{2,3} \dot{\theta}_{2,3}"),
        (-V / 2, "-1/2·θ̇_{2,3}", r"-\tfrac{1}{2} \dot{\theta}_{2,3}"),
        (
            V**2 + A * M,
            "B0_{2,4}·θ̈_{2,3} + θ̇_{2,3}²",
            r"(B_0)_{2,4} \ddot{\theta}_{2,3} + \dot{\theta}_{2,3}^{2}",
        ),
        (C**2, "c_{2,3+4+30°}²", r"c_{2,3+4+30^{\circ}}^{2}"),
        (M * (S - V) * A, "B0_{2,4}·(-θ̇_{2,3} + s_{2,3})·θ̈_{2,3}", None),
        (sp.sqrt(3) * M / 2, "1/2·√3·B0_{2,4}", r"\tfrac{1}{2} \sqrt{3} (B_0)_{2,4}"),
        (sp.Integer(0), "0", "0"),
    ],
)
def test_expressions(expression: sp.Expr, text: str, latex: str | None) -> None:
    assert Writer(NAMES, TEXT).line(expression) == text
    if latex:
        assert Writer(NAMES, LATEX).line(expression) == latex


def test_angles_are_written_for_the_legend() -> None:
    writer = Writer(NAMES, TEXT)
    writer.line(C)
    assert [writer.angle(angle) for angle in writer.angles.values()] == ["θ_{2,3} + θ_{2,4} + π/6"]


def test_floats_are_written_with_six_digits() -> None:
    """They stand for angles that robot files give in degrees, where they define other symbols."""
    number = sp.Float("0.363970234266202361", 40)
    shown = {d: Writer(NAMES, d).line(number * M - sp.Float("1.5e-7") * V) for d in (TEXT, LATEX)}
    assert shown[TEXT] == "-1.5e-7·θ̇_{2,3} + 0.36397·B0_{2,4}"
    assert shown[LATEX] == r"-1.5 \cdot 10^{-7} \dot{\theta}_{2,3} + 0.36397 (B_0)_{2,4}"


@pytest.mark.parametrize("unknown", [1 / M, sp.exp(V)])
def test_what_has_no_rule_is_an_error(unknown: sp.Expr) -> None:
    with pytest.raises(TypeError, match="no way to write"):
        Writer(NAMES, TEXT).line(unknown)


def test_what_has_no_name_is_an_error() -> None:
    with pytest.raises(KeyError):
        Writer(NAMES, TEXT).line(sp.Symbol("t12"))


def test_long_terms_begin_lines_of_their_own() -> None:
    terms = [["a"], ["+ b"], ["+ (cccc", "+ dddd", "+ eeee)"], ["- f"]]
    lines = filled(terms, 8, 16, len)
    assert lines == [(0, "a + b"), (0, "+ (cccc + dddd"), (1, "+ eeee)"), (0, "- f")]


@pytest.mark.parametrize(
    ("internal", "latex"),
    [
        ("gravity", "g"),
        ("base_arm_length", "l_{1}"),
        ("base_arm3_length", "l_{3}"),
        ("link2_mass_per_length", r"\mu_{8}"),
        ("link2_section_inertia_xx", "(B_3)_{8,xx}"),
        ("link1_com_z", r"\rho_{7,z}"),
        ("link1_inertia_xy", r"\bar{J}_{7,xy}"),
        ("link3_a", "a_{9}"),
        ("link3_d", r"\bar{d}_{9}"),
        ("base_drag_4", r"\kappa_{4}"),
    ],
)
def test_parameters(internal: str, latex: str) -> None:
    assert parameter_name(internal, 6, 1.0, "m").latex == latex


@pytest.mark.parametrize(
    ("internal", "latex"),
    [("theta_m1", r"\theta_{-1}"), ("d_7", "d_{7}"), ("x", "x"), ("tau_prime_3", r"\tau'_{3}")],
)
def test_hybrid_unknowns(internal: str, latex: str) -> None:
    found = hybrid_name(internal, "")
    assert isinstance(found, Name)
    assert found.latex == latex


def test_unknown_parameters_are_an_error() -> None:
    with pytest.raises(ValueError, match="no name for the parameter link1_colour"):
        parameter_name("link1_colour", 6, 1.0, "m")
