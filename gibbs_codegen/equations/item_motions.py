"""Equations of chains too long for closed forms: by the motions of their items, as definitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import sympy as sp

from gibbs_codegen.derivation.gibbs import ACCELERATION, OMEGA, OMEGA_DOT, link_gibbs_function
from gibbs_codegen.derivation.tree_dynamics import (
    generalised_inertia_forces,
    mass_matrix,
    tree_motions,
)
from gibbs_codegen.equations.definitions import Definition, Definitions
from gibbs_codegen.equations.notation import Kind, name
from gibbs_codegen.equations.readable_chain import own_frames, readable_chain
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import Matrix, zeros

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
        motions = tree_motions(self._tape, root, self._serial, self._state)[:-1]
        for k, motion in enumerate(motions):
            vectors = (motion.omega, motion.omega_dot, motion.acceleration)
            for (generic, letter, mark, meaning), vector in zip(_VECTORS, vectors, strict=True):
                for old, axis, value in zip(generic, "xyz", vector, strict=True):
                    symbol = sp.Symbol(f"{old.name}_{3 + k}")
                    index = f"{number},{3 + k},{axis}"
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
                shares[3 + k] = share
        return shares, definitions.made

    def partials(self) -> tuple[list[sp.Expr], list[Definition]]:
        """∂S_j/∂θ̈_{j,i} in the order of the coordinates, and definitions (eq. 5)."""
        return self._rows(self._inertia_forces())

    def linear_system(self) -> tuple[Matrix, list[sp.Expr], list[Definition]]:
        """I_j, R_j and definitions (eq. 15), of motions without accelerations."""
        root = self.readable.symbolic.root
        matrix = self._without_last(mass_matrix(self._tape, root, self._serial))
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
        forces = generalised_inertia_forces(self._tape, root, self._serial, self._state)
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
