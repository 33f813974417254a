"""The equations of the paper for one chain, as plain values, for notebooks and `show`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import sympy as sp

from gibbs_codegen.derivation import tree_dynamics
from gibbs_codegen.derivation.gibbs import ACCELERATION, OMEGA, OMEGA_DOT, link_gibbs_function
from gibbs_codegen.equations.definitions import Definition, Definitions, step_names
from gibbs_codegen.equations.normal_form import collected
from gibbs_codegen.equations.readable_chain import (
    ReadableChain,
    closed_system,
    generalised_forces,
    own_frames,
    readable_chain,
)
from gibbs_codegen.equations.typeset import Kind, Name, name
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import Matrix, zeros


@dataclass(frozen=True)
class Place:
    """A row of the hybrid system that one of the chain's unknowns stands for, counted from −1."""

    item: int
    unknown: Name
    hybrid: Name
    row: int


@dataclass(frozen=True)
class ChainEquation:
    """One equation of the paper for one chain.

    `lines` define symbols in order, each by earlier ones: with them it is complete. `names` has the
    symbols as they are written. `accelerations` are those of the coordinates, `quasi` tells whether
    the base's are rates of quasi-velocities. `torques` are the constraint torques and `held` the
    places, from 0, of what they hold among the accelerations; `matrix`, `residual` and `forces`
    (eq. 15) hold the symbols that `lines` define, or zero. `places` and `inputs` (eq. 18) pair the
    chain's symbols with the hybrid system's. `closed` tells whether the lines are closed forms.
    `frames` are rows of the items' numbers, coordinates, γ, x, y, z, α, d and θ (m, °).
    """

    robot: str
    chain: int
    number: int
    title: str
    names: dict[sp.Symbol, Name]
    lines: tuple[Definition, ...] = ()
    accelerations: tuple[sp.Symbol, ...] = ()
    torques: tuple[sp.Symbol, ...] = ()
    held: tuple[int, ...] = ()
    matrix: tuple[tuple[sp.Expr, ...], ...] = ()
    residual: tuple[sp.Expr, ...] = ()
    forces: tuple[sp.Expr, ...] = ()
    places: tuple[Place, ...] = ()
    inputs: tuple[tuple[Name, Name], ...] = ()
    closed: bool = True
    quasi: bool = False
    frames: tuple[tuple[sp.Expr, ...], ...] = ()

    @property
    def bordered(self) -> list[list[list[sp.Expr]]]:
        """Matrix, unknowns, R and F of eq. 15, bordered where the chain is constrained."""
        zero, one = sp.S.Zero, sp.S.One
        matrix = [list(row) for row in self.matrix]
        vectors = [list(self.accelerations), list(self.residual), list(self.forces)]
        border = [[one if i == place else zero for place in self.held] for i in range(len(matrix))]
        matrix = [[*row, *(-z for z in zeta)] for row, zeta in zip(matrix, border, strict=True)]
        for column, torque in zip(zip(*border, strict=True), self.torques, strict=True):
            matrix.append([*column, *[zero] * len(self.torques)])
            for vector, last in zip(vectors, (torque, zero, zero), strict=True):
                vector.append(last)
        return [matrix, *vectors]


Entry = TypeVar("Entry")

_VECTORS = (
    (OMEGA, "omega", "", "angular velocity of the item, in its own frame (rad/s)"),
    (OMEGA_DOT, "omega", "dot", "angular acceleration of the item, in its own frame (rad/s²)"),
    (
        ACCELERATION,
        "r",
        "ddot",
        "acceleration of the item's joint, gravity included, in its own frame (m/s²)",
    ),
)


class ItemMotions:
    """Motions of a chain's items in their own frames, by name, on a tape of their own.

    From them eqs. 2, 5 and 15 are made as definitions, each by those before it; `names` are those
    of the chain `readable` and of the motions.
    """

    def __init__(self, robot: Robot, number: int, accelerated: bool = True) -> None:
        self._tape = Tape()
        self.readable = readable_chain(robot, number, self._tape)
        self._serial = own_frames(self.readable)
        self.names = dict(self.readable.names)
        root = self.readable.symbolic.root
        before = root.places(self.readable.serial.joints)
        after = root.places(self._serial.joints)

        def longer(values: Sequence[sp.Expr]) -> list[sp.Expr]:
            base, joints = before.split(values)
            return after.joined(base, [*joints, sp.S.Zero])

        state = self.readable.state if accelerated else self.readable.state.unaccelerated
        self._state = replace(
            state, rates=longer(state.rates), accelerations=longer(state.accelerations)
        )
        self._named: list[tuple[sp.Symbol, sp.Symbol, int, sp.Expr]] = []
        motions = tree_dynamics.tree_motions(self._tape, root, self._serial, self._state)[:-1]
        for k, motion in enumerate(motions):
            vectors = (motion.omega, motion.omega_dot, motion.acceleration)
            for (generic, letter, mark, meaning), vector in zip(_VECTORS, vectors, strict=True):
                for old, axis, value in zip(generic, "xyz", vector, strict=True):
                    item = self.readable.symbolic.root_item + k
                    symbol = sp.Symbol(f"{old.name}_{item}")
                    index = f"{number},{item},{axis}"
                    self.names[symbol] = name(letter, index, Kind.MOTION, meaning, mark)
                    self._named.append((symbol, old, k, value))

    def gibbs_functions(self) -> tuple[dict[int, sp.Expr], list[Definition]]:
        """Gibbs functions of the items that have one, by number, and definitions (eq. 2)."""
        definitions = self._definitions([])
        shares = {}
        for k, segment in enumerate(self.readable.serial.segments):
            values = {
                symbol: definitions.expression(value)
                for symbol, value in segment.inertia.values.items()
            }
            for _, old, item, value in self._named:
                if item == k:
                    values[old] = definitions.expression(value)
            share = sp.expand(link_gibbs_function().xreplace(values))
            if share != 0:
                shares[self.readable.symbolic.root_item + k] = share
        return shares, definitions.made

    def partials(self) -> tuple[list[sp.Expr], list[Definition]]:
        """∂S_j/∂θ̈_{j,i} in the order of the coordinates, and definitions (eq. 5)."""
        return self._rows(self._inertia_forces())

    def linear_system(self) -> tuple[Matrix, list[sp.Expr], list[Definition]]:
        """I_j, R_j and definitions (eq. 15), of motions without accelerations."""
        root = self.readable.symbolic.root
        matrix = self._without_last(tree_dynamics.mass_matrix(self._tape, root, self._serial))
        rows = [self._without_last(row) for row in matrix]
        residual = [-entry for entry in self._inertia_forces()]
        size = len(residual)
        upper = [(i, j) for i in range(size) for j in range(i, size)]
        made, steps = self._rows([*residual, *(rows[i][j] for i, j in upper)])
        matrix = zeros(size, size)
        for (i, j), entry in zip(upper, made[size:], strict=True):
            matrix[i][j] = matrix[j][i] = entry
        return matrix, made[:size], steps

    def _inertia_forces(self) -> list[sp.Expr]:
        root = self.readable.symbolic.root
        forces = tree_dynamics.generalised_inertia_forces(
            self._tape, root, self._serial, self._state
        )
        return self._without_last(forces)

    def _definitions(self, values: Sequence[sp.Expr]) -> Definitions:
        """Definitions of the components that are not zero, for the values that will be read."""
        outputs = [value for *_, value in self._named]
        definitions = Definitions(self._tape, [*outputs, *values])
        for symbol, _, _, value in self._named:
            if value != 0:
                definitions.name(symbol, value)
        return definitions

    def _rows(self, values: Sequence[sp.Expr]) -> tuple[list[sp.Expr], list[Definition]]:
        """Values in terms of definitions, and these."""
        definitions = self._definitions(values)
        return [definitions.expression(value) for value in values], definitions.made

    def _without_last(self, rows: Sequence[Entry]) -> list[Entry]:
        """Rows of all coordinates without that of the last segment, which has no inertia."""
        root = self.readable.symbolic.root
        base, joints = root.places(self._serial.joints).split(rows)
        return root.places(self.readable.serial.joints).joined(base, joints[:-1])


def gibbs_function(readable: ReadableChain, most: int) -> ChainEquation:
    """S_j (eq. 2), up to terms free of accelerations where it is closed: ½θ̈ᵀI_jθ̈ − R_jᵀθ̈.

    If I_j and R_j have more than `most` terms together, it is definitions: S_j is then the sum of
    the items' own.
    """
    robot, chain = readable.robot, readable.chain.number
    total, accelerations = sp.Symbol("S"), readable.state.accelerations
    steps: list[Definition] = []
    half = sp.Rational(1, 2)
    if system := closed_system(robot, chain, most):
        (matrix, residual), names, meaning = system, readable.names, "Gibbs function (J/s²)"
        terms = [
            sp.Mul(half if i == j else 1, entry, accelerations[i], accelerations[j])
            for i, row in enumerate(matrix)
            for j, entry in enumerate(row)
            if i <= j
        ]
        for entry, acceleration in zip(residual, accelerations, strict=True):
            terms += [-term * acceleration for term in sp.Add.make_args(entry)]
    else:
        motions = ItemMotions(robot, chain)
        names, meaning = motions.names, ""
        shares, steps = motions.gibbs_functions()
        terms = []
        for item, share in shares.items():
            symbol = sp.Symbol(f"S_{item}")
            words = "Gibbs function of an item (J/s²)"
            names[symbol] = name("S", f"{chain},{item}", Kind.RESULT, words)
            steps.append((symbol, share))
            terms.append(symbol)
        for (armature, force), a in zip(readable.passive, accelerations, strict=True):
            terms += [half * armature * a**2, -force * a]
    lines = (*readable.definitions, *steps, (total, sp.Add(*terms)))
    names = {**names, total: name("S", str(chain), Kind.RESULT, meaning)}
    return _equation(readable, 2, "Gibbs function", names, lines, closed=system is not None)


def _equation(
    readable: ReadableChain,
    number: int,
    title: str,
    names: dict[sp.Symbol, Name],
    lines: Sequence[Definition],
    **parts: Any,
) -> ChainEquation:
    """An equation of a chain, with names for what its lines number."""
    chain = readable.chain.number
    return ChainEquation(
        *(readable.robot.name, chain, number, f"{title} of chain {chain}"),
        *(names | step_names(lines), tuple(lines)),
        quasi=readable.quasi,
        **parts,
    )


def gibbs_partials(readable: ReadableChain, most: int) -> ChainEquation:
    """∂S_j/∂θ̈_{j,i} = I_jθ̈_j − R_j (eq. 5), row by row.

    If I_j and R_j have more than `most` terms together, it is definitions.
    """
    robot, chain = readable.robot, readable.chain.number
    names, accelerations = readable.names, readable.state.accelerations
    steps: Sequence[Definition] = ()
    if system := closed_system(robot, chain, most):
        matrix, residual = system
        rows = [
            sp.Add(*(entry * a for entry, a in zip(row, accelerations, strict=True)), -rest)
            for row, rest in zip(matrix, residual, strict=True)
        ]
    else:
        motions = ItemMotions(robot, chain)
        names = motions.names
        rows, steps = motions.partials()
        parts = zip(rows, readable.passive, accelerations, strict=True)
        rows = [row + armature * a - force for row, (armature, force), a in parts]
    lines = [*readable.definitions, *steps]
    shown = dict(names)
    for a, row in zip(accelerations, rows, strict=True):
        symbol, by = sp.Symbol(f"S_by_{a.name}"), names[a]
        latex = f"\\frac{{\\partial S_{{{chain}}}}}{{\\partial {by.latex}}}"
        shown[symbol] = Name(latex, f"∂S_{chain}/∂{by.text}", Kind.RESULT, "")
        lines.append((symbol, row))
    title = "Partial derivatives of the Gibbs function"
    return _equation(readable, 5, title, shown, lines, closed=system is not None)


def equations_of_motion(readable: ReadableChain, most: int) -> ChainEquation:
    """I_jθ̈_j − ζ_{j,4}τ'_j = R_j + F_j with ζᵀθ̈_j = 0, or without τ'_j in the last chain.

    This is eq. 15, with I_j and R_j as definitions if they have more than `most` terms together.
    """
    robot, chain = readable.robot, readable.chain.number
    forces = [collected(f, readable.symbolic.u, 1000) for f in generalised_forces(readable)]
    names = dict(readable.names)
    steps: Sequence[Definition] = ()
    if system := closed_system(robot, chain, most):
        matrix, residual = system
    else:
        motions = ItemMotions(robot, chain, accelerated=False)
        names = motions.names
        matrix, residual, steps = motions.linear_system()
        for i, (armature, force) in enumerate(readable.passive):
            matrix[i][i] += armature
            residual[i] += force
    lines = [*readable.definitions, *steps]

    def entry(letter: str, places: tuple[int, ...], value: sp.Expr) -> sp.Expr:
        """Symbol of an entry of I, R or F at its places from 0, which it defines, or zero."""
        if value == 0:
            return value
        text = ",".join(str(place + 1) for place in places)
        symbol = sp.Symbol(f"{letter}({text})")
        latex = f"{letter}_{{{chain}}}^{{({text})}}"
        names[symbol] = Name(latex, f"{letter}_{chain}({text})", Kind.RESULT, "")
        lines.append((symbol, value))
        return symbol

    places = range(len(residual))
    upper = {(i, j): entry("I", (i, j), matrix[i][j]) for i in places for j in places if i <= j}
    return _equation(
        *(readable, 15, "Equations of motion", names, lines),
        accelerations=tuple(readable.state.accelerations),
        torques=readable.torques,
        held=readable.held,
        matrix=tuple(tuple(upper[min(i, j), max(i, j)] for j in places) for i in places),
        residual=tuple(entry("R", (i,), residual[i]) for i in places),
        forces=tuple(entry("F", (i,), forces[i]) for i in places),
        closed=system is not None,
    )
