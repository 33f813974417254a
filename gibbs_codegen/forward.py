"""Forward dynamics: the translation eliminated first, then LDLᵀ from the arm's tip to the root.

The unknowns are the joint accelerations, the root's angular acceleration Ω (the sum of θ̈ times
their axes) and the origin's acceleration A, in the root's carrier, where nothing has to be
projected. A flying machine falls freely, so gravity enters once, at the end: A is relative to free
fall. The attitude angles' accelerations follow from Ω.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gibbs_codegen.coordinates import coordinate_text
from gibbs_codegen.equations import Matrix, State, chain_motions, unprojected_mass_matrix
from gibbs_codegen.errors import SingularRobotError
from gibbs_codegen.forces import total_thrust_wrench
from gibbs_codegen.inertia import ANGULAR, PAIRS, Inertia
from gibbs_codegen.machine import Machine
from gibbs_codegen.serial import inward
from gibbs_codegen.tape import Scalars
from gibbs_codegen.vectors import ZERO, Vector, Wrench, cross, dot, scale


class ZeroPivotError(Exception):
    """A pivot is zero whatever the numbers: nothing determines `unknown`."""

    def __init__(self, unknown: int) -> None:
        self.unknown = unknown
        super().__init__(f"unknown {unknown}")


def forward_dynamics(machine: Machine) -> list[sp.Expr]:
    """Accelerations a of M a = R + B u, in the order of q.

    Raises `SingularRobotError` where a joint moves nothing that has mass or inertia.
    """
    tape, root, chain = machine.tape, machine.root, machine.reduced_chain
    composite, wrenches, block = unprojected_mass_matrix(tape, chain)
    drive, efforts = _driving_forces(machine)
    lightness = tape.let(1 / composite.mass)
    centre = scale(tape, lightness, composite.moment)
    n = machine.joints
    light = [scale(tape, lightness, wrench.force) for wrench in wrenches]
    matrix: Matrix = [[sp.S.Zero] * (n + 3) for _ in range(n + 3)]
    for (i, j), entry in block.items():
        if i >= j:
            coupled = _minus_dot(tape, entry, wrenches[i].force, light[j])
            matrix[i][j] = matrix[j][i] = coupled
    for i, wrench in enumerate(wrenches):
        for k, entry in enumerate(_about(tape, wrench, centre)):
            matrix[i][n + k] = matrix[n + k][i] = entry
    about_centre = _about_centre_of_mass(tape, composite, centre)
    for k in range(3):
        for m, entry in enumerate(about_centre.response(tape, ANGULAR + k).moment):
            matrix[n + k][n + m] = entry
    right = [_minus_dot(tape, effort, light[i], drive.force) for i, effort in enumerate(efforts)]
    right.extend(_about(tape, drive, centre))
    # Tip first: the last joint couples to all others, the root is left for the end.
    order = [*range(n - 1, -1, -1), n, n + 1, n + 2]
    try:
        solution = solve_symmetric(tape, matrix, right, order)
    except ZeroPivotError as error:
        place = 3 + error.unknown if error.unknown < n else error.unknown - n
        unresisted = coordinate_text(machine.robot, place)
        raise SingularRobotError(machine.robot.name, unresisted) from None
    angular: Vector = (solution[n], solution[n + 1], solution[n + 2])
    spin = cross(tape, angular, centre)
    linear = []
    for k in range(3):
        shares = [light[i][k] * solution[i] for i in range(n)]
        linear.append(tape.let(lightness * drive.force[k] - spin[k] - sp.Add(*shares)))
    x, y, z = root.world(tape, (linear[0], linear[1], linear[2]))
    return [
        *root.angle_accelerations(tape, angular),
        *solution[:n],
        x,
        y,
        tape.let(z - machine.parameters.gravity),
    ]


def solve_symmetric(
    tape: Scalars, matrix: Matrix, right: Sequence[sp.Expr], order: Sequence[int]
) -> list[sp.Expr]:
    """Solve a symmetric system by LDLᵀ, eliminating the unknowns in `order`.

    Zeros of the matrix cost nothing. Raises `ZeroPivotError` for a pivot that is zero whatever the
    numbers.
    """
    lower = [list(row) for row in matrix]
    rest = list(right)
    inverse: dict[int, sp.Expr] = {}
    factors: dict[tuple[int, int], sp.Expr] = {}
    for step, k in enumerate(order):
        if lower[k][k] == 0:
            raise ZeroPivotError(k)
        inverse[k] = tape.let(1 / lower[k][k])
        remaining = order[step + 1 :]
        for i in remaining:
            factors[i, k] = tape.let(lower[i][k] * inverse[k])
        for place, i in enumerate(remaining):
            if factors[i, k] == 0:
                continue
            for j in remaining[place:]:
                entry = tape.let(lower[i][j] - tape.let(factors[i, k] * lower[j][k]))
                lower[i][j] = lower[j][i] = entry
            rest[i] = tape.let(rest[i] - tape.let(factors[i, k] * rest[k]))
    solution: dict[int, sp.Expr] = {}
    for step in range(len(order) - 1, -1, -1):
        k = order[step]
        known = [tape.let(factors[i, k] * solution[i]) for i in order[step + 1 :]]
        solution[k] = tape.let(tape.let(rest[k] * inverse[k]) - sp.Add(*known))
    return [solution[k] for k in range(len(order))]


def _driving_forces(machine: Machine) -> tuple[Wrench, list[sp.Expr]]:
    """Thrusts less velocity terms, as a wrench about the origin, and likewise for each joint."""
    tape, chain = machine.tape, machine.reduced_chain
    falling = State(machine.v, [sp.S.Zero] * len(machine.q), sp.S.Zero)
    # The root's B₀r̈, which `inward` leaves out, is zero here: the origin does not accelerate.
    motions = chain_motions(tape, machine.root, chain, falling)
    bias, joints = inward(tape, chain, motions)
    thrust = total_thrust_wrench(machine)
    torques = machine.u[machine.robot.rotors :]
    efforts = [tape.let(u - row) for u, row in zip(torques, joints, strict=True)]
    return Wrench(
        _difference(tape, thrust.force, bias.force), _difference(tape, thrust.moment, bias.moment)
    ), efforts


def _about(tape: Scalars, wrench: Wrench, centre: Vector) -> Vector:
    """Moment of a wrench about `centre`."""
    return wrench.shifted(tape, (-centre[0], -centre[1], -centre[2])).moment


def _about_centre_of_mass(tape: Scalars, composite: Inertia, centre: Vector) -> Inertia:
    """Second moments about the centre of mass: E − B₀ccᵀ, without mass or first moment."""
    xx, yy, zz, xy, xz, yz = (
        tape.let(composite.entry(i, j) - centre[i] * composite.moment[j]) for i, j in PAIRS
    )
    return Inertia(sp.S.Zero, ZERO, (xx, yy, zz, xy, xz, yz))


def _difference(tape: Scalars, a: Vector, b: Vector) -> Vector:
    x, y, z = (tape.let(p - q) for p, q in zip(a, b, strict=True))
    return (x, y, z)


def _minus_dot(tape: Scalars, value: sp.Expr, a: Vector, b: Vector) -> sp.Expr:
    return tape.let(value - dot(tape, a, b))
