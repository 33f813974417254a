"""What acts on joints by itself: damping, springs, and the inertia of what turns with them alone.

Armature adds to the diagonal of the mass matrix, the rest to the residual: τ − damping·v −
stiffness·(q − rest) drives a joint.
"""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.parameters import PassiveSymbols
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.symbolic.tape import Scalars


def passive_symbols(symbolic: SymbolicRobot) -> list[PassiveSymbols]:
    """Symbols of what acts by itself on each joint that moves."""
    return [symbolic.parameters.link(i).passive for i in symbolic.robot.moving]


def armatures(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Inertia of what turns or slides with each joint alone, of those that move (kg m² or kg)."""
    return [joint.armature for joint in passive_symbols(symbolic)]


def passive_forces(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Forces (N m or N) of the joints' dampers and springs: −damping·v − stiffness·(q − rest)."""
    tape = symbolic.tape
    q = symbolic.coordinates.values()
    _, v = symbolic.places.split(symbolic.v)
    forces = []
    with tape.group("forces of dampers and springs"):
        for joint, angle, rate in zip(passive_symbols(symbolic), q, v, strict=True):
            spring = tape.let(joint.stiffness * _stretch(tape, joint, angle))
            forces.append(tape.let(-tape.let(joint.damping * rate) - spring))
    return forces


def passive_gibbs_function(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Terms (W/s) of armature, dampers and springs in S: ½ armature·a² − force·a."""
    tape = symbolic.tape
    _, a = symbolic.places.split(symbolic.a)
    pairs = zip(a, passive_forces(symbolic), strict=True)
    return [*_squares(symbolic, a), *(tape.let(-force * rate) for rate, force in pairs)]


def armature_energy(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Terms (J) of the kinetic energy of what turns with the joints alone."""
    return _squares(symbolic, symbolic.places.split(symbolic.v)[1])


def spring_energy(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Terms (J) of the potential energy of the springs, ½ stiffness·(q − rest)²."""
    tape = symbolic.tape
    q = symbolic.coordinates.values()
    terms = []
    for joint, angle in zip(passive_symbols(symbolic), q, strict=True):
        stretch = _stretch(tape, joint, angle)
        terms.append(tape.let(joint.stiffness * tape.let(stretch * stretch) / 2))
    return terms


def _stretch(tape: Scalars, joint: PassiveSymbols, angle: sp.Expr) -> sp.Expr:
    """How far a spring is from rest; zero where there is none."""
    return tape.let(angle - joint.rest) if joint.stiffness != 0 else sp.S.Zero


def _squares(symbolic: SymbolicRobot, rates: list[sp.Expr]) -> list[sp.Expr]:
    """½ armature times the square of a rate, for each joint."""
    tape = symbolic.tape
    return [
        tape.let(joint.armature * tape.let(rate * rate) / 2)
        for joint, rate in zip(passive_symbols(symbolic), rates, strict=True)
        if joint.armature != 0
    ]
