"""Equations of motion of one row of segments: mass matrix, residual, Gibbs function (eqs. 5, 11).

The same code derives a single open chain of the decomposition and the reduced system, which is the
arm's chain on a root that carries the sum of all chains' inertia: *sum before projecting*.
Coordinates are those of the root and of the joints of the segments, where the root places them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.serial_chain import (
    SerialChain,
    chain_gibbs_function,
    inward,
    joint_columns,
    outward,
)
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import Wrench

Matrix = list[list[sp.Expr]]


@dataclass(frozen=True)
class State:
    """Rates and accelerations in the order of the chain's coordinates, and gravity.

    Zeros are as good as symbols: θ̈ = 0 gives the residual, θ̇ = 0 with the rates for accelerations
    and no gravity gives velocities.
    """

    rates: Sequence[sp.Expr]
    accelerations: Sequence[sp.Expr]
    gravity: sp.Expr


def chain_motions(tape: Scalars, root: Root, chain: SerialChain, state: State) -> list[Motion]:
    """Motion of every segment in its working frame."""
    places = root.places(chain.joints)
    rates, joint_rates = places.split(state.rates)
    accelerations, joint_accelerations = places.split(state.accelerations)
    with tape.group(f"motion of {chain.segments[0].name}"):
        carrier = root.carrier_motion(tape, rates, accelerations, state.gravity)
    return outward(
        tape,
        chain,
        carrier,
        [root.segment_spin(rates), *joint_rates],
        [root.segment_spin(accelerations), *joint_accelerations],
    )


def free_motions(
    tape: Scalars, root: Root, chain: SerialChain, rates: Sequence[sp.Expr]
) -> list[Motion]:
    """Motions that the rates alone make: every θ̈ is zero, and the origin does not accelerate."""
    state = State(rates, [sp.S.Zero] * len(rates), sp.S.Zero)
    return chain_motions(tape, root, chain, state)


def generalised_inertia_forces(
    tape: Scalars, root: Root, chain: SerialChain, state: State
) -> list[sp.Expr]:
    """∂S/∂θ̈, row by row (eq. 5): M a − R, or −R where the accelerations are zero."""
    motions = chain_motions(tape, root, chain, state)
    wrench, joints = inward(tape, chain, motions)
    places, mass = root.places(chain.joints), chain.segments[0].inertia.mass
    accelerations, _ = places.split(state.accelerations)
    with tape.group("inertia forces on attitude and position"):
        rows = root.inertia_rows(tape, wrench, mass, accelerations, state.gravity)
    return places.joined(rows, joints)


def gibbs_function(tape: Scalars, root: Root, chain: SerialChain, state: State) -> sp.Expr:
    """S of the chain up to terms free of accelerations (eqs. 2–3)."""
    return chain_gibbs_function(tape, chain, chain_motions(tape, root, chain, state))


def mass_matrix(tape: Scalars, root: Root, chain: SerialChain) -> Matrix:
    """Mass matrix of the chain, both triangles."""
    composite, wrenches, block = unprojected_mass_matrix(tape, chain)
    places = root.places(chain.joints)
    base, joints = places.base, places.joint_places
    matrix: Matrix = [[sp.S.Zero] * places.size for _ in range(places.size)]
    with tape.group("mass matrix of attitude and position"):
        root_block = root.mass_block(tape, composite)
    for i, row in zip(base, root_block, strict=True):
        for j, entry in zip(base, row, strict=True):
            matrix[i][j] = entry
    for k, wrench in zip(joints, wrenches, strict=True):
        with tape.group("mass matrix between the joints and attitude and position"):
            entries = root.rows(tape, wrench)
        for i, entry in zip(base, entries, strict=True):
            matrix[i][k] = matrix[k][i] = entry
    for (j, k), entry in block.items():
        matrix[joints[j]][joints[k]] = entry
    return matrix


def unprojected_mass_matrix(
    tape: Scalars, chain: SerialChain
) -> tuple[Inertia, list[Wrench], dict[tuple[int, int], sp.Expr]]:
    """The mass matrix before projection: composite at the root, joint wrenches, joint block."""
    composite, wrenches, entries = joint_columns(tape, chain)
    block = {}
    for (j, k), entry in entries.items():
        if j > 0:
            block[j - 1, k - 1] = block[k - 1, j - 1] = entry
    return composite, wrenches, block
