"""Constants of a chain in symbols that read well, each defined in the parameters: where an item is,
its inertia, the wrench of a rotor, and fixed angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import sympy as sp

from gibbs_codegen.derivation.forces import MountedWrench
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.tree_builder import JointedLink
from gibbs_codegen.equations.chain_inertias import AXIS_PAIRS, second_moments
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.notation import Kind, Name, name
from gibbs_codegen.symbolic.quick import signed
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import Rotation, Wrench

# How the symbols of fixed angles begin, in the derivation.
FIXED = "fixed_"
# What rounding leaves of sines and cosines that cancel.
_ROUNDING = sp.Float("1e-25")


class Made:
    """Symbols of a chain on a tape; `definitions` says in order what they stand for."""

    def __init__(self, tape: Scalars, chain: int, names: dict[sp.Symbol, Name]) -> None:
        self.definitions: list[Definition] = []
        self._tape = tape
        self._chain = chain
        self._names = names

    def inertia(self, item: int, inertia: Inertia) -> Inertia:
        """Inertia of an item, from 1, about its joint, with entries named that are not zero."""
        of_item = f"of item {item}"
        mass = self._inertial("B_0", item, "", inertia.mass, f"mass {of_item} (kg)")
        words = f"first moment of mass {of_item}, whose skew matrix is B_1 (kg m)"
        moment = [
            self._inertial("b", item, axis, value, words)
            for axis, value in zip("xyz", inertia.moment, strict=True)
        ]
        e_xx, e_yy, e_zz, e_xy, e_xz, e_yz = inertia.second
        entries = (e_yy + e_zz, e_xx + e_zz, e_xx + e_yy, -e_xy, -e_xz, -e_yz)
        words = f"inertia matrix B_2 + B_3 {of_item} about its joint (kg m²)"
        known: dict[sp.Expr, sp.Symbol] = {}
        joint_inertia = [
            self._inertial("J", item, axes, value, words, known)
            for axes, value in zip(AXIS_PAIRS, entries, strict=True)
        ]
        second = map(self._tape.let, second_moments(*joint_inertia))
        return Inertia.of([mass, *moment, *second])

    def _inertial(
        self,
        letter: str,
        item: int,
        axes: str,
        value: sp.Expr,
        meaning: str,
        known: dict[sp.Expr, sp.Symbol] | None = None,
    ) -> sp.Expr:
        """Name an entry of an inertia, unless it is zero.

        A symbol in `known` that has the same value is read in place of this.
        """
        value = _settled(value)
        if value == 0:
            return value
        index = f"{self._chain},{item}" + (f",{axes}" if axes else "")
        symbol = self._symbol(f"{letter}_{item}{axes}", letter, index, Kind.INERTIA, meaning)
        same = symbol if known is None else known.setdefault(value, symbol)
        self.definitions.append((symbol, value if same is symbol else same))
        return same

    def placed(self, item: int, link: JointedLink) -> JointedLink:
        """A link with those places of its joint named that are more than a parameter."""
        words = f"place of the joint of item {item}, in the frame of item {item - 1}"
        if link.turn_deg % 360:
            words += f" turned by {_degrees(link.turn_deg)} about z"
        step = [
            self._constant("p", f"{item},{axis}", value, f"{words} (m)")
            for axis, value in zip("xyz", link.step, strict=True)
        ]
        meaning = f"offset of item {item} along its joint's axis (m)"
        d = self._constant("p", f"{item}", link.d, meaning)
        return replace(link, step=(step[0], step[1], step[2]), d=d)

    def wrench(self, k: int, mounted: MountedWrench) -> MountedWrench:
        """Wrench of rotor k ≥ 1 per unit of thrust, numbers of the file in it named."""
        item = 3 + mounted.segment
        parts = {
            "e": (mounted.wrench.force, f"direction of thrust {k} in the frame of item {item}"),
            "n": (
                mounted.wrench.moment,
                f"torque of a unit of thrust {k} about the joint of item {item}, in its frame (m)",
            ),
        }
        force, moment = (
            [
                self._constant(letter, f"{k},{axis}", value, words, numeric=True)
                for axis, value in zip("xyz", values, strict=True)
            ]
            for letter, (values, words) in parts.items()
        )
        return replace(mounted, wrench=Wrench.of([*force, *moment]))

    def _constant(
        self, letter: str, index: str, value: sp.Expr, meaning: str, numeric: bool = False
    ) -> sp.Expr:
        """Name a constant, unless it is a parameter or an exact number.

        `index` is without the chain. With `numeric` the value keeps its own form if there are no
        floating-point numbers in it.
        """
        value = _settled(value)
        if (signed(value)[1].is_Atom or numeric) and not value.has(sp.Float):
            return value
        index = f"{self._chain},{index}"
        symbol = self._symbol(f"{letter}({index})", letter, index, Kind.LENGTH, meaning)
        self.definitions.append((symbol, value))
        return symbol

    def _symbol(
        self, internal: str, letter: str, index: str, kind: Kind, meaning: str
    ) -> sp.Symbol:
        """A symbol on the tape, with a name as `notation.name` composes it."""
        symbol: sp.Symbol = self._tape.symbol(internal, Stage.PARAMETER)
        self._names[symbol] = name(letter, index, kind, meaning)
        return symbol


def _settled(value: sp.Expr) -> sp.Expr:
    """A polynomial multiplied out, without terms that are rounding."""
    value = sp.expand(value)
    if not value.has(sp.Float):
        return value
    terms: Sequence[sp.Expr] = sp.Add.make_args(value)
    return sp.Add(*(term for term in terms if abs(term.as_coeff_Mul()[0]) > _ROUNDING))


def fixed_rotation(
    tape: Scalars, names: dict[sp.Symbol, Name], axis: int, degrees: Fraction
) -> Rotation:
    """Rotation by an angle that the robot file fixes: exact, or with the angle as a symbol.

    `names` takes the name of the symbol; the angle is in degrees, about x (0) or z (2).
    """
    degrees %= 360
    if degrees % 30 == 0 or degrees % 45 == 0:
        return Rotation.degrees(axis, degrees)
    symbol = tape.symbol(f"{FIXED}{float(degrees):.17g}", Stage.PARAMETER)
    text = _degrees(degrees)
    latex = text.replace("°", r"^{\circ}")
    names[symbol] = Name(latex, text, Kind.COORDINATE, "fixed angle", text)
    return Rotation.angle(tape, axis, symbol)


def _degrees(angle: Fraction) -> str:
    return f"{float(angle):.10g}°"
