"""Names of everything that occurs in one chain: coordinates, inputs, parameters, fixed angles."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import sympy as sp

from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.equations.notation import Kind, Name, coordinate_names, name, parameter_name
from gibbs_codegen.robot.chains import Chain
from gibbs_codegen.robot.coordinates import (
    Coordinate,
    held_coordinate,
    hybrid_coordinates,
    inputs,
)
from gibbs_codegen.robot.model import Robot

# How the symbols of fixed angles begin, in the derivation.
FIXED = "fixed_"


def _explained_unknowns(robot: Robot) -> dict[str, Coordinate]:
    """The hybrid unknowns by name; those that are held have their value in their meaning."""
    unknowns = {c.name: c for c in hybrid_coordinates(robot)}
    for k in range(2, robot.base.rotors + 1):
        held = held_coordinate(robot, k)
        value = f"{float(robot.base.arm_angle_deg(k)):.6g}".replace("-", "−")
        unknowns[held.name] = replace(held, meaning=f"{held.meaning}, held at {value}°")
    return unknowns


def chain_names(symbolic: SymbolicRobot, chain: Chain) -> dict[sp.Symbol, Name]:
    """Names of everything that occurs in a chain.

    Args:
        symbolic: The robot in symbols.
        chain: One of its chains.

    Returns:
        Names of coordinates, inputs, parameters and fixed angles, by symbol.
    """
    robot, number = symbolic.robot, chain.number
    unknowns = _explained_unknowns(robot)
    explained = [(c, unknowns[c].meaning, unknowns[c].unit) for c in chain.coordinates]
    names = dict(coordinate_names(number, explained))
    names |= _fixed_angle_names(robot)
    if chain.is_constrained:
        torque = unknowns[chain.unknowns[-1]]
        meaning = f"{torque.meaning} ({torque.unit})"
        names[sp.Symbol(torque.name)] = name("tau", f"{number},4", Kind.INPUT, meaning, prime=True)
    acting = {k: ("F", 3 if k == 1 else 5) for k in chain.motors}
    if not chain.is_constrained:
        acting = {robot.rotors + i: ("tau", 3 + i) for i in range(1, symbolic.joints + 1)}
    for k, (letter, item) in acting.items():
        entry = inputs(robot)[k - 1]
        names[symbolic.u[k - 1]] = name(
            letter, f"{number},{item}", Kind.INPUT, f"{entry.meaning} ({entry.unit})"
        )
    for internal, default in symbolic.parameters.defaults.items():
        unit = symbolic.parameters.units[internal]
        names[sp.Symbol(internal)] = parameter_name(internal, robot.rotors, default, unit)
    for k in chain.motors:
        for axis, component in zip("xyz", robot.base.thrust[k - 1], strict=True):
            meaning = f"{axis} component of the direction of motor {k}'s thrust ({component:.6g})"
            names[sp.Symbol(f"epsilon_{k}_{axis}")] = name(
                "epsilon", f"{k},{axis}", Kind.LENGTH, meaning
            )
    return names


def _fixed_angle_names(robot: Robot) -> dict[sp.Symbol, Name]:
    """Fixed angles that are symbols are written as what they are, in degrees."""
    twists = [link.alpha_deg % 360 for link in robot.links]
    offsets = [link.theta_deg for link in robot.links]
    sums = [sum(offsets[i:k], Fraction(0)) % 360 for k in range(len(offsets) + 1) for i in range(k)]
    texts = [f"{float(degrees):.10g}" for degrees in sorted({*twists, *sums})]
    return {
        sp.Symbol(f"{FIXED}{text}"): Name(
            f"{text}^{{\\circ}}", f"{text}°", Kind.COORDINATE, "fixed angle", f"{text}°"
        )
        for text in texts
    }
