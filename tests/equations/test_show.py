"""What `show` prints, against the emitted module, brute force and its own text read back."""

from __future__ import annotations

import itertools
import math
import re
import shutil
import subprocess
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from support.emitted import emitted_module
from support.random_robots import random_robot, robots
from support.tools import HANGING

from gibbs_codegen.derivation.gibbs import skew
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.equations.chain_equations import ChainEquation
from gibbs_codegen.equations.chain_names import FIXED
from gibbs_codegen.equations.pages import as_latex, as_markdown, as_text
from gibbs_codegen.equations.readable_chain import chain_closed_form, item_frames, readable_chain
from gibbs_codegen.equations.show import EQUATIONS, MOST_TERMS, chain_equation
from gibbs_codegen.equations.typeset import text_width
from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.chains import decompose, first_row
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.posture import AT_ORIGIN, PlacedFrame, frames_on
from gibbs_codegen.robot.rotations import turn
from gibbs_codegen.symbolic.tape import InlineTape

PAPER = read_robot("hexarotor_3link")[0]

shown = cache(chain_equation)

# Closed forms, and definitions for the very same chains.
FORMS = (MOST_TERMS, 0)


def value(expression: sp.Expr, values: Mapping[sp.Symbol, float]) -> float:
    """An expression in floats."""
    if expression.is_Symbol:
        return values[expression]
    parts = [value(argument, values) for argument in expression.args]
    if expression.is_Add:
        return math.fsum(parts)
    if expression.is_Mul:
        return math.prod(parts)
    if expression.is_Pow:
        return parts[0] ** parts[1]
    if isinstance(expression, (sp.sin, sp.cos)):
        return getattr(math, expression.func.__name__)(parts[0])
    return float(expression)


def evaluated(equation: ChainEquation, values: dict[sp.Symbol, float]) -> dict[sp.Symbol, float]:
    """`values`, fixed angles, and what the lines of an equation define from them."""
    angles = {s: s.name.removeprefix(FIXED) for s in equation.names if s.name.startswith(FIXED)}
    values = values | {symbol: math.radians(float(angle)) for symbol, angle in angles.items()}
    for symbol, expression in equation.lines:
        assert symbol not in values
        values[symbol] = value(expression, values)
    return values


def given_values(robot: Robot, seed: int) -> dict[sp.Symbol, float]:
    """A random state, the parameters, and the numbers that a chain has symbols for."""
    rng = np.random.default_rng(seed)
    symbolic = SymbolicRobot.of(robot, InlineTape())
    values = {sp.Symbol(name): x for name, x in symbolic.parameters.defaults.items()}
    for symbol in (*symbolic.q, *symbolic.v, *symbolic.a, *symbolic.u):
        values[symbol] = float(rng.normal())
    if layout_of(robot).is_quaternion:
        parts = symbolic.q[layout_of(robot).q.attitude]
        size = math.hypot(*(values[part] for part in parts))
        values |= {part: values[part] / size for part in parts}
    for i in robot.constrained:
        values[sp.Symbol(coordinate_of(robot, i))] = 0.0
        values[sp.Symbol(f"a_{coordinate_of(robot, i)}")] = float(rng.normal())
    for k in range(2, robot.base.rotors + 1):
        values[sp.Symbol(f"theta_{k}")] = math.radians(robot.base.arm_angle_deg(k))
        values[sp.Symbol(f"a_theta_{k}")] = float(rng.normal())
    for k, direction in enumerate(robot.base.thrust, start=1):
        values |= {sp.Symbol(f"epsilon_{k}_{i}"): x for i, x in zip("xyz", direction, strict=True)}
    return values


def assert_close(ours: np.ndarray, theirs: np.ndarray, tolerance: float = 1e-11) -> None:
    assert np.linalg.norm(ours - theirs) <= tolerance * max(1.0, float(np.linalg.norm(theirs)))


def assert_chains_add_up(robot: Robot, most_terms: int, seed: int = 5) -> None:
    """Eqs. 15 and 18 of every chain, added by their places, give the emitted hybrid system."""
    names = (f"hybrid_{part}" for part in ("mass_matrix", "residual", "input_matrix"))
    module, symbolic = emitted_module(robot, *names), SymbolicRobot.of(robot, InlineTape())
    values = given_values(robot, seed)
    size, width = len(module.HYBRID_COORDINATES), len(module.INPUTS)
    matrix, residual, inputs = np.zeros((size, size)), np.zeros(size), np.zeros((size, width))
    for chain in decompose(robot):
        motion = chain_equation(robot, chain.number, 15, most_terms)
        places = chain_equation(robot, chain.number, 18).places
        rows = np.array([place.row - first_row(robot) for place in places])
        found = evaluated(motion, values)
        free = rows[: len(motion.residual)]
        matrix[np.ix_(free, free)] += [[value(e, found) for e in row] for row in motion.matrix]
        residual[free] += [value(e, found) for e in motion.residual]
        torques = rows[len(free) :]
        for torque, row, place in zip(motion.torques, torques, motion.held, strict=True):
            assert torque.name == module.HYBRID_COORDINATES[row]
            matrix[free[place], row], matrix[row, free[place]] = -1, 1
        for column, thrust in enumerate(symbolic.u):
            unit = values | {other: float(other == thrust) for other in symbolic.u}
            found = evaluated(motion, unit)
            inputs[free, column] += [value(e, found) for e in motion.forces]
    q, v = ([values[symbol] for symbol in symbols] for symbols in (symbolic.q, symbolic.v))
    assert_close(matrix, module.hybrid_mass_matrix(q))
    assert_close(residual, module.hybrid_residual(q, v))
    assert_close(inputs, module.hybrid_input_matrix(q))


@pytest.mark.slow
def test_chains_add_up_to_the_hybrid_system() -> None:
    assert_chains_add_up(PAPER, 600)


@pytest.mark.slow
def test_every_attitude_and_origin() -> None:
    arms = (Rod(length=0.5, mass_per_length=1.0, section_inertia=(0.1, 0.1, 0.1)),)
    base = Base(
        rotors=2,
        arms=arms,
        thrust=((0, 0, 1), (0, 0.6, 0.8)),
        drag=(0.1, 0.0),
        attitude="xyz",
        origin="motor1",
    )
    links = (
        Link(Rod(length=1, mass_per_length=1), theta_deg=Fraction(20), joint="prismatic"),
        Link(Rod(length=1, mass_per_length=2)),
    )
    assert_chains_add_up(Robot("odd", base, links), MOST_TERMS)


MOTIONS = ('"planar"', '["z", "x", "pitch"]')


BASED = """
name = "based"
[base]
motion = {}
xyz = [0.1, -0.2, 0.3]
rpy_deg = [20, -35, 60]
mass = 2
com = [0.1, 0, 0.2]
inertia = [0.02, 0.03, 0.04, 0, 0.01, 0]
[[rotor]]
position = [0.1, 0.2, 0]
direction = [0, 0.6, 0.8]
drag = 0.1
[[link]]
xyz = [0.1, 0, 0.2]
rpy_deg = [0, 90, 30]
axis = "y"
mass = 1
com = [0.1, 0, -0.2]
[[link]]
xyz = [0.3, 0, 0]
axis = "x"
mass = 1
inertia = [0.02, 0.03, 0.04, 0, 0, 0]
joint = "prismatic"
[[link]]
parent = "base"
xyz = [0, 0.3, 0]
mass = 0.5
com = [0.2, 0, 0]
joint = "fixed"
constrained = true
"""


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_every_base(motion: str) -> None:
    text, motor = BASED.format(motion), "motor = { rotor_inertia = 1e-3, gear_ratio = 9 }"
    robot, motored = map(parse_robot, (text, text.replace('axis = "y"', f'axis = "y"\n{motor}')))
    for most_terms in FORMS:
        assert_chains_add_up(motored, most_terms)
        assert_partials_hold(robot, 1, most_terms)


POLE = '[[link]]\nxyz = [0, 0, 0]\naxis = "y"\nmass = 1\ncom = [0, 0, 1]'


@pytest.mark.parametrize(
    ("base", "lines"),
    [
        (
            'motion = "fixed"',
            ["I_1(1,1) = m_1·ρ_{1,z}²", "R_1(1) = m_1·ρ_{1,z}·g·s_{1,1}", "F_1(1) = τ_{1,1}"],
        ),
        (
            'motion = ["x"]\nmass = 2',
            [
                "I_1(1,1) = m_b + m_1",
                "I_1(1,2) = m_1·ρ_{1,z}·c_{1,2}",
                "I_1(2,2) = m_1·ρ_{1,z}²",
                "R_1(1) = m_1·ρ_{1,z}·s_{1,2}·θ̇_{1,2}²",
                "R_1(2) = m_1·ρ_{1,z}·g·s_{1,2}",
                "F_1(2) = τ_{1,2}",
            ],
        ),
    ],
)
def test_a_pendulum_and_a_cart_read_as_in_textbooks(base: str, lines: list[str]) -> None:
    """Of a pole that stands up at zero, by Goldstein's Lagrangian with ρ = l."""
    robot = parse_robot(f'name = "pole"\n[base]\n{base}\n{POLE}')
    text = as_text(chain_equation(robot, 1, 15))
    assert re.findall(r"^\S+\(\S+ = .*$", text, flags=re.MULTILINE) == lines


def assert_partials_hold(robot: Robot, chain: int, most_terms: int) -> None:
    """Eqs. 2 and 5 as shown, against differences of the S shown and the recursion's partials."""
    values = given_values(robot, 7)
    gibbs = chain_equation(robot, chain, 2, most_terms)
    partials = chain_equation(robot, chain, 5, most_terms)
    found = evaluated(partials, values)
    form = chain_closed_form(robot, chain)
    rows = [found[symbol] for symbol, _ in partials.lines[-len(form.partials) :]]
    brute = []
    for acceleration in form.accelerations:
        ahead, behind = (
            evaluated(gibbs, values | {acceleration: values[acceleration] + step})[sp.Symbol("S")]
            for step in (0.5, -0.5)
        )
        brute.append(ahead - behind)  # Exact, since S is quadratic.
    recursion = [value(partial, values) for partial in form.partials]
    assert_close(np.array(rows), np.array(recursion))
    assert_close(np.array(brute), np.array(recursion))


@pytest.mark.parametrize("most_terms", FORMS)
@pytest.mark.parametrize("chain", [1, 2])
def test_gibbs_function_and_partials_of_the_papers_robot(chain: int, most_terms: int) -> None:
    assert_partials_hold(PAPER, chain, most_terms)


@pytest.mark.slow
@settings(max_examples=2)
@given(robot=robots(most_rotors=3, most_links=2), most_terms=st.sampled_from(FORMS))
def test_gibbs_function_and_partials_of_any_robot(robot: Robot, most_terms: int) -> None:
    assert_partials_hold(robot, robot.rotors, most_terms)


def test_vectors_of_a_link_are_eq_6() -> None:
    equation = chain_equation(PAPER, 1, 6)
    rng = np.random.default_rng(1)
    symbols = {s for _, e in equation.lines for s in e.free_symbols}
    values = {s: float(rng.normal()) for s in sorted(symbols, key=str)}

    def vector(prefix: str) -> np.ndarray:
        return np.array([values[sp.Symbol(f"{prefix}_{axis}")] for axis in "xyz"])

    r, w, w_dot, b = map(vector, ("r_ddot", "omega", "omega_dot", "C"))
    pairs = ("xx", "yy", "zz", "xy", "xz", "yz")
    xx, yy, zz, xy, xz, yz = (values[sp.Symbol(f"J_{pair}")] for pair in pairs)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    first, spin = (np.array(skew(tuple(x)), float) for x in (b, w))
    force = values[sp.Symbol("B_0")] * r - first @ w_dot - spin @ first @ w
    moment = first @ r + inertia @ w_dot + spin @ inertia @ w
    found = evaluated(equation, values)
    assert_close(np.array([found[s] for s, _ in equation.lines]), np.array([*force, *moment]))


def test_places_of_chain_five_are_the_papers() -> None:
    equation = chain_equation(PAPER, 5, 18)
    assert [place.row for place in equation.places] == [-1, 0, 1, 6, 10, 11, 12, 17]
    assert [place.hybrid.text for place in equation.places][2:5] == ["θ̈_1", "θ̈_6", "ẍ"]
    assert [(own.text, whole.text) for own, whole in equation.inputs] == [("F_{5,5}", "F_6")]


@pytest.mark.parametrize("make", [as_text, as_latex])
def test_the_legend_gives_rates_and_accelerations_their_own_units(
    make: Callable[..., str],
) -> None:
    robot = parse_robot(
        'name = "slide"\n[base]\nrotors = 2\narm = { length = 1, mass = 1 }\n'
        '[[link]]\njoint = "prismatic"\nmass = 1\n'
    )
    legend = make(shown(PAPER, 5, 15), shown(PAPER, 5, 18)).split("Symbols")[1]
    legend += make(shown(robot, 2, 15), shown(robot, 2, 18)).split("Symbols")[1]
    legend = " ".join(legend.replace("$^2$", "²").split())
    for meaning in (
        "first attitude angle, about x (rad)",
        "first attitude angle, about x: its rate (rad/s)",
        "first attitude angle, about x: its acceleration (rad/s²)",
        "world z of motor 1 (O1): its acceleration (m/s²)",
        "travel of joint 3: its acceleration (m/s²)",
        "constraint torque on base arm 6 (N m)",
    ):
        assert meaning in legend
    for entry in re.split(r"[;\n]", make(shown(PAPER, 5, 18)).split("Symbols")[1]):
        accelerates = r"\ddot" in entry or "\u0308" in unicodedata.normalize("NFD", entry)
        assert not (accelerates and re.search(r"\((m|rad)\)", entry)), entry


def read_back(text: str, equation: ChainEquation, values: dict[sp.Symbol, float]) -> dict:
    """The definitions of a text, computed from their letters alone."""
    known = {equation.names[s].text: x for s, x in values.items() if s in equation.names}
    names = sorted((n.text for n in equation.names.values()), key=len, reverse=True)
    angles = re.findall(r"^s_(\S+), c_\S+: sine and cosine of (.*)$", text, flags=re.MULTILINE)
    pattern = "|".join(map(re.escape, names))

    def number(formula: str) -> float:
        formula = re.sub(pattern, lambda m: f"({known[m[0]]!r})", formula).replace("·", "*")
        formula = re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda m: f"**{int(m[0].translate(UP))}", formula)
        formula = re.sub(r"√(\d+)", r"\1**0.5", formula)
        formula = re.sub(r"([\d.]+)°", r"math.radians(\1)", formula)
        return eval(formula.replace("π", "*math.pi"), {"math": math})  # noqa: S307

    for index, angle in angles:
        angle = re.sub(r"(^|[ -])π", r"\g<1>1π", angle)
        known[f"s_{index}"], known[f"c_{index}"] = (f(number(angle)) for f in (math.sin, math.cos))
    names += [f"{letter}_{index}" for letter in "sc" for index, _ in angles]
    pattern = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    found = {}
    body = text.split("\n\nSymbols\n")[0].replace("\n    ", " ")
    defined = {equation.names[s].text for s, _ in equation.lines}
    for line in body.splitlines():
        left, _, right = line.partition(" = ")
        if left in defined and "Σ" not in right:
            found[left] = known[left] = number(right)
    assert set(found) == defined
    return found


UP = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")
CASES = [
    (PAPER, 1, MOST_TERMS),
    (PAPER, 6, MOST_TERMS),
    (random_robot(3, 3, 2), 3, MOST_TERMS),
    (random_robot(4, 5, 3), 5, 3000),
    (random_robot(5, 4, 4), 4, MOST_TERMS),
    (random_robot(6, 4, 0), 1, 3000),
    (paper_family(20, 1), 12, MOST_TERMS),  # Products that are longer than a line.
]


@pytest.mark.parametrize(("robot", "chain", "most"), CASES[:1])
@pytest.mark.parametrize("number", [2, 5, 15])
def test_text_read_back_gives_the_same_numbers(
    robot: Robot, chain: int, most: int, number: int
) -> None:
    equation = shown(robot, chain, number, most)
    text = as_text(equation)
    assert max(map(text_width, text.splitlines())) <= 80
    values = given_values(robot, 11)
    expected = evaluated(equation, values)
    found = read_back(text, equation, values)
    for symbol, _ in equation.lines:
        ours = found[equation.names[symbol].text]
        assert ours == pytest.approx(expected[symbol], rel=1e-9, abs=1e-9)


COMMANDS = re.findall(
    r"\\[a-zA-Z]+",
    r"""\allowdisplaybreaks \alpha \bar \begin \bigl \bigr \Bigl \Bigr \cdot \circ \ddot \delta
    \dot \dots \end \epsilon \frac \ge \hline \kappa \left \mathcal \mu \omega \paragraph
    \partial \pi \qquad \quad \rho
    \right \sqrt \sum \tau \text \tfrac \theta \tilde \usepackage \zeta""",
)


def assert_is_latex(text: str) -> None:
    """ASCII, known commands, balance of braces and environments, one & and a finite width a row."""
    assert text.isascii()
    assert set(re.findall(r"\\[a-zA-Z]+", text)) <= set(COMMANDS)
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", text):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    assert text.count(r"\bigl") == text.count(r"\bigr")
    assert text.count(r"\left") == text.count(r"\right")
    open_environments: list[str] = []
    for which, environment in re.findall(r"\\(begin|end)\{(\w+\*?)\}", text):
        if which == "begin":
            open_environments.append(environment)
        else:
            assert open_environments.pop() == environment
    assert not open_environments
    for display in re.findall(r"\\begin\{align\*\}(.*?)\\end\{align\*\}", text, flags=re.DOTALL):
        outer = re.sub(r"\\begin\{(\w+)\}.*?\\end\{\1\}", "", display, flags=re.DOTALL)
        if r"\text{item}" not in display:
            assert all(row.count("&") == 1 for row in outer.split(r"\\"))
    assert not re.search(r"_\{[^}]*\}_|\^\{[^}]*\}\^", text)


INTERNAL = re.compile(
    r"theta_m1|_m1|base_arm|base_drag|link\d|length|gravity_|[va]_theta|[va]_[dxyz]_|tau_prime"
    r"|\b[kt]\d+\b|fixed_|epsilon_\d|Symbol|omega_dot|S_by|mass_per"
)


@pytest.mark.parametrize(
    ("robot", "chain", "most"), [CASES[0], pytest.param(*CASES[4], marks=pytest.mark.slow)]
)
def test_latex_is_well_formed_and_has_no_internal_names(
    robot: Robot, chain: int, most: int
) -> None:
    equations = [shown(robot, chain, number, most) for number in EQUATIONS]
    text = as_latex(*equations)
    assert_is_latex(text)
    set_in = " ".join(re.findall(r"\$(.*?)\$", text))
    displays = re.findall(r"\\begin\{align\*\}.*?\\end\{align\*\}", text, flags=re.DOTALL)
    mathematics = re.sub(r"\\text\{.*?\}", "", " ".join([set_in, *displays]))
    assert not INTERNAL.search(mathematics)
    assert "$$" in as_markdown(*equations)


@pytest.mark.parametrize(
    ("robot", "chain", "most"),
    [
        *(CASES[0], CASES[2], CASES[6]),
        *(pytest.param(*CASES[i], marks=pytest.mark.slow) for i in (1, 3, 4, 5)),
    ],
)
def test_every_symbol_is_defined_or_in_the_legend(robot: Robot, chain: int, most: int) -> None:
    for number, make in itertools.product(EQUATIONS, (as_text, as_latex)):
        equation = shown(robot, chain, number, most)
        text = make(equation)
        legend = text.split("Symbols", 1)[1]
        defined = {symbol for symbol, _ in equation.lines}
        written = [n.text for n in equation.names.values()]
        assert len(set(written)) == len(written)
        for symbol in {s for _, e in equation.lines for s in e.free_symbols} - defined:
            name = equation.names[symbol]
            assert name.meaning
            assert (name.text if make is as_text else name.latex) in legend
        for index in set(re.findall(r"\b[sc]_(\{[^}]*\})", text.split("Symbols", 1)[0])):
            assert f"s_{index}" in legend


@pytest.mark.slow
def test_long_chains_say_why_they_are_definitions() -> None:
    assert "grow two- to threefold with every link" in " ".join(
        as_text(chain_equation(PAPER, 6, 15)).split()
    )
    assert not chain_equation(PAPER, 6, 15).closed
    assert chain_equation(PAPER, 6, 15, most_terms=5000).closed
    assert chain_equation(PAPER, 2, 15).closed


@pytest.mark.slow
def test_definitions_grow_in_proportion_to_the_links() -> None:
    """Rows of eq. 5; the mass matrix has a square of them by itself."""
    lengths = [len(chain_equation(paper_family(4, n), 4, 5).lines) for n in (4, 7, 10)]
    assert lengths[2] - lengths[1] <= 1.2 * (lengths[1] - lengths[0])


def test_latex_compiles(tmp_path: Path) -> None:
    compiler = shutil.which("pdflatex")
    if compiler is None:
        pytest.skip("pdflatex is not installed")
    body = as_latex(*(shown(PAPER, 1, number) for number in EQUATIONS))
    text = "\\documentclass{article}\\usepackage{amsmath}\\allowdisplaybreaks\n"
    text += f"\\begin{{document}}\n{body}\\end{{document}}\n"
    (tmp_path / "shown.tex").write_text(text, encoding="ascii")
    command = [compiler, "-interaction=nonstopmode", "-halt-on-error", "shown.tex"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=HANGING)


@pytest.mark.parametrize("chain", [0, 7, -1])
@pytest.mark.parametrize("equation", EQUATIONS)
def test_unknown_chains_are_refused(chain: int, equation: int) -> None:
    with pytest.raises(UsageError, match="has chains 1 to 6"):
        chain_equation(PAPER, chain, equation)


def test_unknown_equations_are_refused() -> None:
    with pytest.raises(UsageError, match="equation 7: cannot be shown; known: 2, 5, 6, 15, 18"):
        chain_equation(PAPER, 1, 7)


def test_equations_of_two_chains_are_not_laid_out_together() -> None:
    with pytest.raises(UsageError, match="one chain"):
        as_text(shown(PAPER, 1, 18), shown(PAPER, 2, 18))


@pytest.mark.parametrize("robot", [PAPER, read_robot("dual_arm")[0]])
def test_the_table_of_frames_says_where_every_axis_is(robot: Robot) -> None:
    """The axis of each joint, as the robot file places it, is the z axis of its item."""
    drawn = frames_on(robot, AT_ORIGIN, np.zeros(len(robot.moving)))
    defaults = SymbolicRobot.of(robot, InlineTape()).parameters.defaults
    for chain in decompose(robot):
        if chain.rod is not None:
            continue
        readable = readable_chain(robot, chain.number)
        values = {symbol: defaults.get(symbol.name, 0.0) for symbol in readable.names}
        for symbol, meant in readable.definitions:
            values[symbol] = value(meant, values)
        frame = AT_ORIGIN
        if robot.base.rotors:
            frame = PlacedFrame(drawn.rods[0].origin, drawn.rods[0].axes)
        for i, row in zip(chain.path, item_frames(readable), strict=True):
            gamma, x, y, z, alpha, d, theta = (float(e.xreplace(values)) for e in row[2:])
            frame = frame.within(turn(2, np.deg2rad(gamma)), np.zeros(3))
            frame = frame.within(turn(0, np.deg2rad(alpha)), np.array([x, y, z]))
            frame = frame.within(turn(2, np.deg2rad(theta)), np.array([0.0, 0.0, d]))
            link = drawn.links[i - 1]
            axis = link.axes @ np.array(robot.links[i - 1].axis)
            assert frame.axes[:, 2] == pytest.approx(axis)
            aside = np.cross(frame.origin - link.origin, axis)
            assert aside == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.slow
def test_a_page_begins_with_the_columns_and_the_frames() -> None:
    equation = shown(paper_family(4, 2), 4, 15)
    head, _, table = as_text(equation).partition("Frames of the items\n")
    assert "R and F are columns" in " ".join(head.split())
    assert "\n5     θ_{4,5}  0      0    0  0  90     0  0\n" in table
    tilted = replace(paper_family(4, 2).links[1], alpha_deg=Fraction("33.3"))
    robot = replace(paper_family(4, 2), links=(tilted,))
    assert "0  33.3   0  0\n" in as_text(shown(robot, 4, 15))
    assert r"5 & \theta_{4,5} & 0 & 0 & 0 & 0 & 90 & 0 & 0" in as_latex(equation)
