"""The motions of a chain's items, each in its own frame, as named quantities of a tape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import sympy as sp

from gibbs_codegen.derivation.gibbs import ACCELERATION, OMEGA, OMEGA_DOT
from gibbs_codegen.derivation.tree_dynamics import State, tree_motions
from gibbs_codegen.equations.definitions import Definition, Definitions
from gibbs_codegen.equations.notation import Kind, name
from gibbs_codegen.equations.readable_chain import ReadableChain, own_frames
from gibbs_codegen.symbolic.tape import Tape

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
    """Motions of a chain's items in their own frames, by name; `tape` is the chain's."""

    def __init__(self, readable: ReadableChain, tape: Tape, state: State) -> None:
        self._tape, self._readable = tape, readable
        self.serial = own_frames(readable)
        self.names = dict(readable.names)
        root = readable.machine.root
        before, after = root.places(readable.serial.joints), root.places(self.serial.joints)

        def longer(values: Sequence[sp.Expr]) -> list[sp.Expr]:
            base, joints = before.split(values)
            return after.joined(base, [*joints, sp.S.Zero])

        self.state = replace(
            state, rates=longer(state.rates), accelerations=longer(state.accelerations)
        )
        self._named: list[tuple[sp.Symbol, sp.Symbol, int, sp.Expr]] = []
        motions = tree_motions(tape, root, self.serial, self.state)[:-1]
        for k, motion in enumerate(motions):
            vectors = (motion.omega, motion.omega_dot, motion.acceleration)
            for (generic, letter, mark, meaning), vector in zip(_VECTORS, vectors, strict=True):
                for old, axis, value in zip(generic, "xyz", vector, strict=True):
                    symbol = sp.Symbol(f"{old.name}_{3 + k}")
                    index = f"{readable.chain.number},{3 + k},{axis}"
                    self.names[symbol] = name(letter, index, Kind.MOTION, meaning, mark)
                    self._named.append((symbol, old, k, value))

    @property
    def values(self) -> list[sp.Expr]:
        """What the tape has for the components."""
        return [value for *_, value in self._named]

    def define(self, definitions: Definitions) -> None:
        """Define the components that are not zero."""
        for symbol, _, _, value in self._named:
            if value != 0:
                definitions.name(symbol, value)

    def symbols(self, k: int, definitions: Definitions) -> dict[sp.Symbol, sp.Expr]:
        """Components of segment k by the symbols that the Gibbs function of a link has for them."""
        return {
            old: definitions.expression(value)
            for _, old, segment, value in self._named
            if segment == k
        }

    def rows(self, values: Sequence[sp.Expr]) -> tuple[list[sp.Expr], list[Definition]]:
        """Values in terms of definitions, and these."""
        definitions = Definitions(self._tape, [*self.values, *values])
        self.define(definitions)
        rows = [definitions.expression(value) for value in values]
        return rows, definitions.made

    def without_last(self, rows: Sequence[Entry]) -> list[Entry]:
        """Rows of all coordinates without that of the last segment, which has no inertia."""
        root = self._readable.machine.root
        base, joints = root.places(self.serial.joints).split(rows)
        return root.places(self._readable.serial.joints).joined(base, joints[:-1])
