"""Inertias of a chain's items: mass B₀, first moment b (of B₁), matrix B₂ + B₃."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.chains import Chain
from gibbs_codegen.symbolic.inline_tape import InlineTape

# Entries of a symmetric matrix, in order.
AXIS_PAIRS = ("xx", "yy", "zz", "xy", "xz", "yz")


def second_moments(
    xx: sp.Expr, yy: sp.Expr, zz: sp.Expr, xy: sp.Expr, xz: sp.Expr, yz: sp.Expr
) -> tuple[sp.Expr, ...]:
    """∫x², ∫y², ∫z², ∫xy, ∫xz, ∫yz over the mass, by the entries of the inertia matrix (kg m²)."""
    return ((yy + zz - xx) / 2, (xx + zz - yy) / 2, (xx + yy - zz) / 2, -xy, -xz, -yz)


def defined_inertias(symbolic: SymbolicRobot, chain: Chain) -> list[Inertia]:
    """Inertias of the base and of what follows it in a chain, each about its joint.

    They are in the parameters; zero for those that have their mass in another chain.
    """
    core = symbolic.core_inertia() if chain.has_core else NO_INERTIA
    if chain.rod is not None:
        return [core, symbolic.parameters.arm(chain.rod).inertia]
    bodies = symbolic.chain_bodies(chain)
    core = core.plus(InlineTape(), bodies.on_base)
    return [core, *(link.inertia for link in bodies.links)]
