"""Derivatives by CasADi's algorithmic differentiation of its peers, in SX, compiled."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import casadi as ca
from peers.build import function
from peers.casadi_articulated import forward_dynamics
from peers.casadi_peer import libraries, tip_first
from peers.casadi_recursions import Machine, inverse_dynamics, mass_matrix
from peers.contender import Contender, Ordered
from peers.derivatives import FORWARD, INVERSE, DerivativeContender, by_oracle
from peers.tree import Tree, tree_of

from gibbs_codegen.robot.model import Robot

# C of the derivatives of forward dynamics, and eight states at once, takes gcc too long from here.
MOST_JOINTS = 10


def derivative_functions(tree: Tree) -> dict[str, ca.Function]:
    """A function per task of (q, v, a or τ), with all arrays row by row in one vector.

    Those of inverse dynamics are in the order in which composite bodies give the mass matrix.
    """
    machine, rows = Machine(tree), list(tip_first(tree).order)
    forces = inverse_dynamics(machine, machine.force)
    names = {INVERSE: "inverse_dynamics_derivatives"}
    arrays = {INVERSE: [*_derivatives(machine, forces), mass_matrix(machine)]}
    if tree.joints < MOST_JOINTS:
        names[FORWARD] = "forward_dynamics_derivatives"
        accelerations = forward_dynamics(machine)
        last = ca.jacobian(accelerations, machine.tau)
        arrays[FORWARD] = [*_derivatives(machine, accelerations), last]
    arrays[INVERSE] = [m[rows, rows] if m.is_square() else m[rows] for m in arrays[INVERSE]]
    return {
        task: ca.Function(
            names[task],
            [machine.q, machine.v, machine.tau],
            ca.cse([ca.densify(ca.vertcat(*(ca.vec(matrix.T) for matrix in found)))]),
        )
        for task, found in arrays.items()
    }


def _derivatives(machine: Machine, value: ca.SX) -> list[ca.SX]:
    """A vector, and its derivatives by the coordinates, in the tangent space, and velocities."""
    by_coordinates = (
        ca.jtimes(value, machine.q, _tangents(machine))
        if machine.tree.root == "quaternion"
        else ca.jacobian(value, machine.q)
    )
    return [value, by_coordinates, ca.jacobian(value, machine.v)]


def _tangents(machine: Machine) -> ca.SX:
    """Rates of position, quaternion and joints by velocities; those of the position are left out.

    Nothing that is differentiated depends on the position.
    """
    size = machine.tree.velocities
    rates = ca.SX.zeros(size + 1, size)
    x, y, z, w = machine.q.elements()[3:7]
    rates[3:7, 3:6] = 0.5 * ca.blockcat([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]])
    rates[7:, 6:] = ca.SX.eye(size - 6)
    return rates


def casadi_derivatives(robot: Robot, folder: Path) -> list[Contender]:
    """CasADi one state and eight states at a time."""
    tree, size = tree_of(robot), tree_of(robot).velocities
    made, tip = derivative_functions(tree), tip_first(tree)
    own = Ordered(tuple(range(size)), tuple(range(len(tip.coordinates))))
    outputs = {INVERSE: tip.derivatives, FORWARD: own.derivatives}
    several = tree.joints < MOST_JOINTS
    return [
        DerivativeContender(
            name,
            task,
            width,
            function(library, f"casadi_{one.name()}"),
            own.inputs,
            outputs[task],
            room=size + 3 * size**2,
            right=partial(by_oracle, robot, task),
        )
        for name, width, library in libraries(made.values(), folder, several)
        for task, one in made.items()
    ]
