"""Inertias of a chain's items in symbols: mass B₀, first moment b (of B₁), matrix B₂ + B₃."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.notation import Kind, Name, name
from gibbs_codegen.robot.chains import Chain
from gibbs_codegen.symbolic.tape import Scalars, Stage

# Entries of a symmetric matrix, in order.
AXIS_PAIRS = ("xx", "yy", "zz", "xy", "xz", "yz")


def second_moments(
    xx: sp.Expr, yy: sp.Expr, zz: sp.Expr, xy: sp.Expr, xz: sp.Expr, yz: sp.Expr
) -> tuple[sp.Expr, ...]:
    """Second moments of mass, as the derivation has them, of an inertia matrix.

    Args:
        xx, yy, zz, xy, xz, yz: Entries of the inertia matrix (kg m²).

    Returns:
        ∫x², ∫y², ∫z², ∫xy, ∫xz, ∫yz over the mass (kg m²).
    """
    return ((yy + zz - xx) / 2, (xx + zz - yy) / 2, (xx + yy - zz) / 2, -xy, -xz, -yz)


def defined_inertias(symbolic: SymbolicRobot, chain: Chain) -> list[Inertia]:
    """Inertias of the base and of what follows it in a chain, each about its joint.

    Args:
        symbolic: The robot in symbols.
        chain: One of its chains.

    Returns:
        The inertias, in the parameters; zero for those that have their mass in another chain.
    """
    core = symbolic.core_inertia() if chain.has_core else NO_INERTIA
    if chain.rod is not None:
        return [core, symbolic.parameters.arm(chain.rod).inertia]
    return [core, *(link.inertia for link in symbolic.chain_bodies(chain).links)]


def named_inertia(
    tape: Scalars, chain: int, item: int, inertia: Inertia, names: dict[sp.Symbol, Name]
) -> tuple[Inertia, list[Definition]]:
    """Name the entries of an inertia.

    Args:
        tape: The tape.
        chain: Number of the chain.
        item: Number of the item in it, counted from 1.
        inertia: The item's inertia about its joint, in the parameters.
        names: Takes the names of the symbols.

    Returns:
        The inertia in symbols, those that are zero left out, and what the symbols stand for.
    """
    definitions: list[Definition] = []
    known: dict[sp.Expr, sp.Symbol] = {}

    def named(letter: str, axes: str, value: sp.Expr, meaning: str) -> sp.Expr:
        value = sp.expand(value)
        if value == 0:
            return value
        index = f"{chain},{item}" + (f",{axes}" if axes else "")
        symbol = tape.symbol(f"{letter}_{item}{axes}", Stage.PARAMETER)
        names[symbol] = name(letter, index, Kind.INERTIA, meaning.format(item))
        same = known.setdefault(value, symbol) if letter == "J" else symbol
        definitions.append((symbol, value if same is symbol else same))
        return same

    mass = named("B_0", "", inertia.mass, "mass of item {} (kg)")
    moment = [
        named("b", axis, value, "first moment of mass of item {}, whose skew matrix is B_1 (kg m)")
        for axis, value in zip("xyz", inertia.moment, strict=True)
    ]
    e_xx, e_yy, e_zz, e_xy, e_xz, e_yz = inertia.second
    entries = (e_yy + e_zz, e_xx + e_zz, e_xx + e_yy, -e_xy, -e_xz, -e_yz)
    joint_inertia = (
        named("J", axes, value, "inertia matrix B_2 + B_3 of item {} about its joint (kg m²)")
        for axes, value in zip(AXIS_PAIRS, entries, strict=True)
    )
    second = map(tape.let, second_moments(*joint_inertia))
    return Inertia.of([mass, *moment, *second]), definitions
