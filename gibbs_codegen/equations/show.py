"""The paper's equations of one chain, in its symbols: what `show` prints and notebooks display.

Equation 2 is the Gibbs function S_j, 5 its partials ∂S_j/∂θ̈_{j,i}, 6 the vectors 𝒮 and ℛ of any
link, 15 the chain's equations of motion, bordered where it is constrained, and 18 the places of its
rows and columns in the hybrid system.

Where expanded expressions have few enough terms they are given in closed form, collected by
products of accelerations and rates. They grow about threefold with every link, so that longer
chains are given as definitions in order, as the derivation makes them, each item in its own frame:
these grow in proportion to the links.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import sympy as sp

from gibbs_codegen.derivation.gibbs import (
    ACCELERATION,
    MASS,
    MOMENT,
    OMEGA,
    OMEGA_DOT,
    SECOND,
    link_gibbs_function,
    link_partials,
)
from gibbs_codegen.derivation.tree_dynamics import generalised_inertia_forces, mass_matrix
from gibbs_codegen.equations.chain_equation import ChainEquation, Place
from gibbs_codegen.equations.closed_form import closed_system
from gibbs_codegen.equations.definitions import Definition, Definitions
from gibbs_codegen.equations.item_motions import ItemMotions
from gibbs_codegen.equations.normal_form import TooLongError, collected
from gibbs_codegen.equations.notation import Kind, Name, accelerated, hybrid_name, name
from gibbs_codegen.equations.readable_chain import ReadableChain, generalised_forces, readable_chain
from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.chains import coupling_map
from gibbs_codegen.robot.coordinates import hybrid_coordinates, inputs
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Tape

EQUATIONS = (2, 5, 6, 15, 18)
# What says everything once: the same coefficients stand in 2 and 5, and 6 is the same for any link.
SHORT = (15, 18)

# Terms of a chain's mass matrix and residual together that are still read: four pages or so.
MOST_TERMS = 600


def chain_equation(
    robot: Robot, chain: int, equation: int, most_terms: int = MOST_TERMS
) -> ChainEquation:
    """Equation 2, 5, 6, 15 or 18 of chain 1 … N of a robot.

    Where the chain's mass matrix and residual together have more than `most_terms` terms,
    equations 2, 5 and 15 are definitions instead of closed forms. Raises `UsageError` where there
    is no such chain or equation.
    """
    makers = {2: _gibbs, 5: _partials, 15: _motion}
    general = {6: _link, 18: _coupling}
    if equation not in EQUATIONS:
        known = ", ".join(map(str, EQUATIONS))
        raise UsageError(f"equation {equation}: cannot be shown; known: {known}")
    if equation in general:
        return general[equation](robot, chain)
    return makers[equation](robot, chain, most_terms)


def _gibbs(robot: Robot, chain: int, most: int) -> ChainEquation:
    """S_j, up to terms free of accelerations where it is closed: ½θ̈ᵀI_jθ̈ − R_jᵀθ̈."""
    readable = readable_chain(robot, chain)
    title = f"Gibbs function of chain {chain}"
    total = sp.Symbol("S")
    names = {**readable.names, total: name("S", str(chain), Kind.RESULT, "Gibbs function (J/s²)")}
    accelerations = readable.state.accelerations
    try:
        matrix, residual = closed_system(robot, chain, most)
    except TooLongError:
        tape = Tape()
        return _gibbs_by_items(readable_chain(robot, chain, tape), tape, title, total)
    half = sp.Rational(1, 2)
    terms = [
        sp.Mul(half if i == j else 1, entry, accelerations[i], accelerations[j])
        for i, row in enumerate(matrix)
        for j, entry in enumerate(row)
        if i <= j
    ]
    for entry, acceleration in zip(residual, accelerations, strict=True):
        terms += [-term * acceleration for term in sp.Add.make_args(entry)]
    lines = (*readable.inertias, (total, sp.Add(*terms)))
    return ChainEquation(robot.name, chain, 2, title, names, lines)


def _gibbs_by_items(
    readable: ReadableChain, tape: Tape, title: str, total: sp.Symbol
) -> ChainEquation:
    """S_j as the sum of the items' own, in their motions, which are defined one by another."""
    number = readable.chain.number
    motions = ItemMotions(readable, tape, readable.state)
    definitions = Definitions(tape, motions.values)
    motions.define(definitions)
    shares = []
    for k, segment in enumerate(readable.serial.segments):
        inertia = {b: definitions.expression(value) for b, value in segment.inertia.values.items()}
        values = {**inertia, **motions.symbols(k, definitions)}
        share = sp.expand(link_gibbs_function().xreplace(values))
        if share != 0:
            symbol = sp.Symbol(f"S_{3 + k}")
            meaning = "Gibbs function of an item (J/s²)"
            motions.names[symbol] = name("S", f"{number},{3 + k}", Kind.RESULT, meaning)
            definitions.made.append((symbol, share))
            shares.append(symbol)
    lines = (*readable.inertias, *definitions.made, (total, sp.Add(*shares)))
    names = {**motions.names, total: name("S", str(number), Kind.RESULT, "")} | _step_names(lines)
    return ChainEquation(readable.robot.name, number, 2, title, names, lines, closed=False)


def _partials(robot: Robot, chain: int, most: int) -> ChainEquation:
    """∂S_j/∂θ̈_{j,i} = I_jθ̈_j − R_j, row by row."""
    readable = readable_chain(robot, chain)
    closed, accelerations = True, readable.state.accelerations
    steps: Sequence[Definition] = ()
    try:
        matrix, residual = closed_system(robot, chain, most)
        rows = [
            sp.Add(*(entry * a for entry, a in zip(row, accelerations, strict=True)), -rest)
            for row, rest in zip(matrix, residual, strict=True)
        ]
        names = readable.names
    except TooLongError:
        closed = False
        tape = Tape()
        readable = readable_chain(robot, chain, tape)
        motions = ItemMotions(readable, tape, readable.state)
        values = motions.without_last(
            generalised_inertia_forces(tape, readable.machine.root, motions.serial, motions.state)
        )
        rows, steps = motions.rows(values)
        names = motions.names
    lines = [*readable.inertias, *steps]
    shown = dict(names)
    for a, row in zip(accelerations, rows, strict=True):
        symbol, by = sp.Symbol(f"S_by_{a.name}"), names[a]
        latex = f"\\frac{{\\partial S_{{{chain}}}}}{{\\partial {by.latex}}}"
        shown[symbol] = Name(latex, f"∂S_{chain}/∂{by.text}", Kind.RESULT, "")
        lines.append((symbol, row))
    title = f"Partial derivatives of the Gibbs function of chain {chain}"
    shown |= _step_names(lines)
    return ChainEquation(robot.name, chain, 5, title, shown, tuple(lines), closed=closed)


def _motion(robot: Robot, chain: int, most: int) -> ChainEquation:
    """I_jθ̈_j − ζ_{j,4}τ'_j = R_j + F_j with ζᵀθ̈_j = 0, or without τ'_j in the last chain."""
    readable = readable_chain(robot, chain)
    forces = [collected(f, readable.machine.u, 1000) for f in generalised_forces(readable)]
    closed, names = True, readable.names
    steps: Sequence[Definition] = ()
    try:
        matrix, residual = closed_system(robot, chain, most)
    except TooLongError:
        closed = False
        tape = Tape()
        readable = readable_chain(robot, chain, tape)
        motions = ItemMotions(readable, tape, readable.unaccelerated)
        root = readable.machine.root
        size = len(readable.chain.coordinates)
        cut = motions.without_last
        rows = [cut(row) for row in cut(mass_matrix(tape, root, motions.serial))]
        left = cut(generalised_inertia_forces(tape, root, motions.serial, motions.state))
        above = [rows[i][j] for i in range(size) for j in range(i, size)]
        made, steps = motions.rows([*(-entry for entry in left), *above])
        residual, entries = made[:size], iter(made[size:])
        matrix = [[sp.S.Zero] * size for _ in range(size)]
        for i in range(size):
            for j in range(i, size):
                matrix[i][j] = matrix[j][i] = next(entries)
        names = motions.names
    named = _NamedEntries(chain, dict(names), [*readable.inertias, *steps])
    places = range(len(residual))
    symbols = {
        (i, j): named.entry("I", (i, j), matrix[i][j]) for i in places for j in places if i <= j
    }
    shown_residual = tuple(named.entry("R", (i,), residual[i]) for i in places)
    shown_forces = tuple(named.entry("F", (i,), forces[i]) for i in places)
    torque = sp.Symbol(readable.chain.unknowns[-1]) if readable.chain.is_constrained else None
    return ChainEquation(
        robot.name,
        chain,
        15,
        f"Equations of motion of chain {chain}",
        named.names | _step_names(named.lines),
        tuple(named.lines),
        tuple(readable.state.accelerations),
        torque,
        tuple(tuple(symbols[min(i, j), max(i, j)] for j in places) for i in places),
        shown_residual,
        shown_forces,
        closed=closed,
    )


def _link(robot: Robot, chain: int) -> ChainEquation:
    """𝒮 and ℛ of any link, in the components of r̈, ω̇ and ω and the link's inertia."""
    readable_chain(robot, chain)
    axes = ("xx", "yy", "zz", "xy", "xz", "yz")
    entries = sp.symbols([f"J_{pair}" for pair in axes])
    xx, yy, zz, xy, xz, yz = entries
    second = ((yy + zz - xx) / 2, (xx + zz - yy) / 2, (xx + yy - zz) / 2, -xy, -xz, -yz)
    inertia = dict(zip(SECOND, second, strict=True))
    names = {MASS: name("B_0", "", Kind.INERTIA, "mass of the link")}
    named = (
        (MOMENT, "b", Kind.INERTIA, "", "first moment of mass, whose skew matrix is B_1"),
        (OMEGA, "omega", Kind.RATE, "", "angular velocity"),
        (ACCELERATION, "r", Kind.ACCELERATION, "ddot", "acceleration of the link's joint"),
        (OMEGA_DOT, "omega", Kind.ACCELERATION, "dot", "angular acceleration"),
    )
    for symbols, letter, kind, mark, meaning in named:
        for symbol, axis in zip(symbols, "xyz", strict=True):
            names[symbol] = name(letter, axis, kind, f"{meaning}, in the link's frame", mark)
    for symbol, pair in zip(entries, axes, strict=True):
        meaning = "inertia matrix B_2 + B_3 of the link about its joint"
        names[symbol] = name("J", pair, Kind.INERTIA, meaning)
    lines = []
    for letter, script, vector in zip("SR", "𝒮ℛ", link_partials(), strict=True):
        for axis, partial in zip("xyz", vector, strict=True):
            symbol = sp.Symbol(f"{letter}_{axis}")
            names[symbol] = Name(
                f"\\mathcal{{{letter}}}_{{{axis}}}", f"{script}_{axis}", Kind.RESULT, ""
            )
            keys = (*ACCELERATION, *OMEGA_DOT, *OMEGA)
            lines.append((symbol, collected(partial.xreplace(inertia), keys, 1000)))
    title = "The two vectors of a link"
    return ChainEquation(robot.name, chain, 6, title, names, tuple(lines))


def _coupling(robot: Robot, chain: int) -> ChainEquation:
    """Where the chain's unknowns and inputs stand among those of the hybrid system."""
    readable = readable_chain(robot, chain)
    names, unknowns = readable.names, hybrid_coordinates(robot)
    places = []
    for item, place in enumerate(coupling_map(robot)[chain - 1], start=1):
        internal = unknowns[place].name
        own = names.get(sp.Symbol(f"a_{internal}")) or names[sp.Symbol(internal)]
        hybrid = accelerated(hybrid_name(internal, own.meaning))
        places.append(Place(item, own, hybrid, place - 1))
    acting = tuple(
        (names[sp.Symbol(entry.name)], hybrid_name(entry.name, f"{entry.meaning} ({entry.unit})"))
        for entry in inputs(robot)
        if sp.Symbol(entry.name) in names
    )
    title = f"Places of chain {chain} in the hybrid system"
    return ChainEquation(robot.name, chain, 18, title, names, places=tuple(places), inputs=acting)


class _NamedEntries:
    """Entries of I_j, R_j and F_j, defined line by line."""

    def __init__(self, chain: int, names: dict[sp.Symbol, Name], lines: list[Definition]) -> None:
        self._chain = chain
        self.names = names
        self.lines = lines

    def entry(self, letter: str, places: Iterable[int], value: sp.Expr) -> sp.Expr:
        """The symbol of an entry, or zero."""
        if value == 0:
            return value
        text = ",".join(str(place + 1) for place in places)
        symbol = sp.Symbol(f"{letter}({text})")
        latex = f"{letter}_{{{self._chain}}}^{{({text})}}"
        self.names[symbol] = Name(latex, f"{letter}_{self._chain}({text})", Kind.RESULT, "")
        self.lines.append((symbol, value))
        return symbol


def _step_names(lines: Iterable[Definition]) -> dict[sp.Symbol, Name]:
    """Names of the quantities that definitions number."""
    return {
        symbol: name("h", symbol.name.removeprefix("h_"), Kind.STEP, "")
        for symbol, _ in lines
        if symbol.name.startswith("h_")
    }
