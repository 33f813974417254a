"""The paper's equations of one chain, in its symbols, for `show` and notebooks.

Equation 2 is the Gibbs function S_j, 5 its partials ∂S_j/∂θ̈_{j,i}, 6 the vectors 𝒮 and ℛ of any
link, 15 the chain's equations of motion, bordered where it is constrained, and 18 the places of its
rows and columns in the hybrid system.

With a quaternion, and of a base that stays level, the base's unknowns are the rates of
quasi-velocities: of its linear and angular velocity in its own frame.

Where expanded expressions have few enough terms they are given in closed form, collected by
products of accelerations and rates. They grow about threefold with every link, so that longer
chains are given as definitions in order, as the derivation makes them, each item in its own frame:
these grow in proportion to the links.

In the paper's own forms of equations an @ stands for the number of the chain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation import gibbs
from gibbs_codegen.equations import chain_equations
from gibbs_codegen.equations.chain_names import hybrid_names, second_moments
from gibbs_codegen.equations.normal_form import collected
from gibbs_codegen.equations.readable_chain import check_chain, item_frames, readable_chain
from gibbs_codegen.equations.typeset import Kind, Name, accelerated, name
from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.chains import coupling_map, first_row
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.numbers import AXIS_PAIRS

EQUATIONS = (2, 5, 6, 15, 18)
# Equations that say everything once: 2 and 5 have the same coefficients, 6 is alike for any link.
SHORT = (15, 18)

# Terms of a chain's mass matrix and residual together that are still read: four pages or so.
MOST_TERMS = 600


def chain_equation(
    robot: Robot, chain: int, equation: int, most_terms: int = MOST_TERMS
) -> chain_equations.ChainEquation:
    """One of the paper's equations for one chain of a robot.

    Args:
        robot: The robot.
        chain: Number of the chain, 1 to N.
        equation: Its number in the paper: 2, 5, 6, 15 or 18.
        most_terms: Of the chain's mass matrix and residual together; where they have more,
            equations 2, 5 and 15 are definitions instead of closed forms.

    Returns:
        The equation.

    Raises:
        UsageError: If there is no such chain or equation.
    """
    if equation not in EQUATIONS:
        choices = ", ".join(map(str, EQUATIONS))
        raise UsageError(f"equation {equation}: cannot be shown; known: {choices}")
    check_chain(robot, chain)
    if equation in _OF_EVERY_CHAIN:
        return _OF_EVERY_CHAIN[equation](robot, chain)
    readable = readable_chain(robot, chain)
    made = _MAKERS[equation](readable, most_terms)
    frames = item_frames(readable)
    needed = {symbol for row in frames for entry in row for symbol in entry.free_symbols}
    lines, defined = [], {symbol for symbol, _ in readable.definitions}
    for symbol, value in reversed(made.lines):
        if symbol in needed or symbol not in defined:
            needed |= value.free_symbols
            lines.append((symbol, value))
    names = made.names | readable.names
    return replace(made, names=names, lines=tuple(reversed(lines)), frames=frames)


def _link(robot: Robot, chain: int) -> chain_equations.ChainEquation:
    """𝒮 and ℛ of any link, in the components of r̈, ω̇ and ω and the link's inertia."""
    entries = sp.symbols([f"J_{pair}" for pair in AXIS_PAIRS])
    inertia = dict(zip(gibbs.SECOND, second_moments(*entries), strict=True))
    names = {gibbs.MASS: name("B_0", "", Kind.INERTIA, "mass of the link")}
    named = (
        (gibbs.MOMENT, "b", Kind.INERTIA, "", "first moment of mass, whose skew matrix is B_1"),
        (gibbs.OMEGA, "omega", Kind.RATE, "", "angular velocity"),
        (gibbs.ACCELERATION, "r", Kind.ACCELERATION, "ddot", "acceleration of the link's joint"),
        (gibbs.OMEGA_DOT, "omega", Kind.ACCELERATION, "dot", "angular acceleration"),
    )
    for symbols, letter, kind, mark, meaning in named:
        for symbol, axis in zip(symbols, "xyz", strict=True):
            names[symbol] = name(letter, axis, kind, f"{meaning}, in the link's frame", mark)
    for symbol, pair in zip(entries, AXIS_PAIRS, strict=True):
        meaning = "inertia matrix B_2 + B_3 of the link about its joint"
        names[symbol] = name("J", pair, Kind.INERTIA, meaning)
    lines = []
    for letter, script, vector in zip("SR", "𝒮ℛ", gibbs.link_partials(), strict=True):
        for axis, partial in zip("xyz", vector, strict=True):
            symbol = sp.Symbol(f"{letter}_{axis}")
            names[symbol] = Name(
                f"\\mathcal{{{letter}}}_{{{axis}}}", f"{script}_{axis}", Kind.RESULT, ""
            )
            keys = (*gibbs.ACCELERATION, *gibbs.OMEGA_DOT, *gibbs.OMEGA)
            lines.append((symbol, collected(partial.xreplace(inertia), keys, 1000)))
    title = "The two vectors of a link"
    return chain_equations.ChainEquation(robot.name, chain, 6, title, names, tuple(lines))


def _coupling(robot: Robot, chain: int) -> chain_equations.ChainEquation:
    """Places of the chain's unknowns and inputs among those of the hybrid system."""
    readable = readable_chain(robot, chain)
    names, hybrid = readable.names, hybrid_names(robot)
    description = readable.symbolic.description
    unknowns = description.hybrid_coordinates
    symbols = [*readable.state.accelerations, *readable.torques]
    places = []
    for item, (place, symbol) in enumerate(
        zip(coupling_map(robot)[chain - 1], symbols, strict=True), start=1
    ):
        meaning = names[symbol].meaning
        whole = accelerated(replace(hybrid[unknowns[place].name], meaning=meaning))
        places.append(chain_equations.Place(item, names[symbol], whole, first_row(robot) + place))
    acting = tuple(
        (names[symbol], replace(hybrid[entry.name], meaning=f"{entry.meaning} ({entry.unit})"))
        for entry, symbol in zip(description.inputs, readable.symbolic.u, strict=True)
        if symbol in names
    )
    title = f"Places of chain {chain} in the hybrid system"
    return chain_equations.ChainEquation(
        robot.name,
        chain,
        18,
        title,
        names,
        places=tuple(places),
        inputs=acting,
        quasi=readable.quasi,
    )


_MAKERS = {
    2: chain_equations.gibbs_function,
    5: chain_equations.gibbs_partials,
    15: chain_equations.equations_of_motion,
}
_OF_EVERY_CHAIN = {6: _link, 18: _coupling}


WHY_DEFINITIONS = (
    "Written out, these expressions would be too long to be read: they grow two- to threefold with "
    "every link. They are given as definitions instead, each by those before it, and vectors in "
    "the frames of their own items. Components that are not listed are zero."
)
AT_REST = (
    "Angular accelerations, and accelerations of joints, are those without accelerations of the "
    "coordinates."
)
COLUMNS = (
    "In equation 15, R and F are columns with an entry for each coordinate: R is what is left "
    "without accelerations, and F are the generalised forces of thrusts and joint torques."
)
FRAMES = (
    "Each item lies in the frame of the one before: turned by gamma about z, moved by x, y and z, "
    "turned by alpha about x, moved by d along z and turned by theta about z. Angles are in "
    "degrees; the coordinate adds to theta or, of a joint that slides, to d."
)


@dataclass(frozen=True)
class Form:
    """An equation as the paper has it, and its symbols: LaTeX, text and meaning."""

    latex: str = ""
    text: str = ""
    legend: tuple[tuple[str, str, str], ...] = ()


_LINK_LEGEND = (
    (r"\ddot{r}", "r̈", "acceleration of a link's joint, gravity included"),
    (r"\omega", "ω", "angular velocity of a link"),
    (r"\dot{\omega}", "ω̇", "angular acceleration of a link"),
    ("B_0", "B0", "mass of a link"),
    ("B_1", "B1", "skew matrix of a link's first moment of mass about its joint"),
    ("B_2 + B_3", "B2 + B3", "inertia matrix of a link about its joint"),
)
_SKEW = ((r"\tilde{\omega}", "ω̃", "skew matrix of the angular velocity"),)
_VECTORS = (
    (r"\mathcal{S}", "𝒮", "partial derivatives of a link's Gibbs function by its acceleration"),
    (
        r"\mathcal{R}",
        "ℛ",
        "partial derivatives of a link's Gibbs function by its angular acceleration",
    ),
)

FORMS = {
    2: Form(
        r"""S_{@} &= \sum_i \bigl[\tfrac{1}{2} B_0 \ddot{r}^T \ddot{r} - \ddot{r}^T B_1 \dot{\omega}
- \ddot{r}^T \tilde{\omega} B_1 \omega \\
&\quad {}+ \tfrac{1}{2} \dot{\omega}^T (B_2 + B_3) \dot{\omega}
+ \dot{\omega}^T \tilde{\omega} (B_2 + B_3) \omega\bigr]_i
\quad\text{up to terms free of accelerations}""",
        "S_@ = Σ_i [1/2·B0·r̈ᵀr̈ - r̈ᵀB1ω̇ - r̈ᵀω̃B1ω + 1/2·ω̇ᵀ(B2 + B3)ω̇ + ω̇ᵀω̃(B2 + B3)ω]_i\n"
        "    up to terms free of accelerations",
        (*_LINK_LEGEND, *_SKEW),
    ),
    5: Form(
        r"""\frac{\partial S_{@}}{\partial \ddot{\theta}_{@,i}} &=
\sum_{k>i} \Bigl(\frac{\partial \ddot{r}_k}{\partial \ddot{\theta}_{@,i}}\Bigr)^T \mathcal{S}_k
+ \sum_{k\ge i} \Bigl(\frac{\partial \dot{\omega}_k}{\partial \ddot{\theta}_{@,i}}\Bigr)^T
\mathcal{R}_k""",
        "∂S_@/∂θ̈_{@,i} = Σ_{k>i} (∂r̈_k/∂θ̈_{@,i})ᵀ𝒮_k + Σ_{k≥i} (∂ω̇_k/∂θ̈_{@,i})ᵀℛ_k",
        (*_LINK_LEGEND[:3], *_VECTORS),
    ),
    6: Form(
        r"""\mathcal{S} &= B_0 \ddot{r} - B_1 \dot{\omega} - \tilde{\omega} B_1 \omega \\
\mathcal{R} &= B_1 \ddot{r} + (B_2 + B_3) \dot{\omega} + \tilde{\omega} (B_2 + B_3) \omega""",
        "𝒮 = B0·r̈ - B1ω̇ - ω̃B1ω\nℛ = B1r̈ + (B2 + B3)ω̇ + ω̃(B2 + B3)ω",
        (*_LINK_LEGEND, *_SKEW, *_VECTORS),
    ),
    15: Form(
        legend=(
            ("I_{@}", "I_@", "mass matrix of the chain; entries (a,b) and (b,a) are equal"),
            (
                "R_{@}",
                "R_@",
                "what is left without accelerations: velocity terms, gravity, springs, dampers",
            ),
            ("F_{@}", "F_@", "generalised forces of thrusts and joint torques"),
        )
    ),
    18: Form(
        r"I_H \ddot{\theta}_H &= R_H + F_H",
        "I_H·θ̈_H = R_H + F_H",
        (
            (
                "I_H",
                "I_H",
                "sum of the chains' bordered mass matrices, in the rows and columns of the table",
            ),
            (
                "R_H",
                "R_H",
                "sum of what they have without accelerations, in the table's rows, counted from −1",
            ),
            ("F_H", "F_H", "sum of their generalised forces, in the same rows"),
            (r"\ddot{\theta}_H", "θ̈_H", "unknowns of the hybrid system"),
        ),
    ),
}
