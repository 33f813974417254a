"""The functions of a generated module: what each returns, in terms of the derivation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import sympy as sp

from gibbs_codegen.derivation.chain_dynamics import (
    State,
    generalised_inertia_forces,
    gibbs_function,
)
from gibbs_codegen.derivation.forward_dynamics import articulated_dynamics, factorised_dynamics
from gibbs_codegen.derivation.forward_kinematics import (
    positions,
    tip_bias_acceleration,
    tip_jacobian,
    tip_pose,
)
from gibbs_codegen.derivation.hybrid import (
    LinearSystem,
    constraint_torques,
    hybrid_system,
    reduced_system,
)
from gibbs_codegen.derivation.machine import Machine
from gibbs_codegen.derivation.regularity import (
    refuse_drowned,
    refuse_uncomputable,
    refuse_undetermined,
)
from gibbs_codegen.derivation.serial_chain import composites
from gibbs_codegen.program.lower import Slice, lower, operations
from gibbs_codegen.program.model import Model, Progress
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Tape


def derive(robot: Robot, keep_zeros: bool = False, progress: Progress = lambda _: None) -> Model:
    """Derive everything that is emitted for a robot.

    `progress` is told the name of each step as it begins. Raises `SingularRobotError` for a robot
    with a motion that nothing resists, and `UsageError` for one whose numbers overflow.
    """
    tape = Tape()
    machine = Machine.of(robot, tape, keep_zeros)
    parameters = machine.parameters
    refuse_undetermined(robot, parameters.defaults)
    slices = _slices(tape, machine, progress)
    progress("lowering the program")
    inputs = {
        name: tuple(symbol.name for symbol in symbols)
        for name, symbols in zip("qvau", (machine.q, machine.v, machine.a, machine.u), strict=True)
    }
    names = tuple(parameters.defaults)
    # The mass matrix by itself: the whole program's `prepare` divides by pivots, hidden or not.
    mass_matrix = [piece for piece in slices if piece.name == "mass_matrix"]
    refuse_drowned(robot, lower(tape, inputs, names, mass_matrix), parameters.defaults)
    program = lower(tape, inputs, names, slices)
    refuse_uncomputable(robot, program, parameters.defaults)
    return Model(
        robot,
        program,
        {name: parameters.defaults[name] for name in program.parameters},
        {name: parameters.units[name] for name in program.parameters},
        tuple(parameters.folded),
        keep_zeros,
    )


def _slices(tape: Tape, machine: Machine, progress: Progress) -> list[Slice]:
    progress("reduced system")
    reduced = reduced_system(machine)
    progress("hybrid system")
    hybrid = hybrid_system(machine, reduced)
    progress("forward dynamics")
    forward = _forward_dynamics(tape, machine)
    progress("inverse dynamics, energies and kinematics")
    mass = _matrix(reduced.matrix)
    residual = _vector(reduced.residual)
    return [
        Slice("mass_matrix_and_residual", ("q", "v"), (mass, residual)),
        Slice("mass_matrix", ("q",), (mass,)),
        Slice("residual", ("q", "v"), (residual,)),
        Slice("input_matrix", ("q",), (_matrix(reduced.inputs),)),
        forward,
        Slice("inverse_dynamics", ("q", "v", "a"), (_vector(_inverse_dynamics(machine)),)),
        *_hybrid_slices(hybrid),
        Slice("constraint_torques", ("q", "v", "a", "u"), (_vector(constraint_torques(machine)),)),
        Slice("gibbs", ("q", "v", "a"), (_scalar(_gibbs(machine)),)),
        Slice("kinetic_energy", ("q", "v"), (_scalar(_kinetic_energy(machine)),)),
        Slice("potential_energy", ("q",), (_scalar(_potential_energy(machine)),)),
        Slice("positions", ("q",), (_matrix(positions(machine)),)),
        Slice("tip_pose", ("q",), (_matrix(tip_pose(machine)),)),
        Slice("tip_jacobian", ("q",), (_matrix(tip_jacobian(machine)),)),
        Slice("tip_bias_acceleration", ("q", "v"), (_vector(tip_bias_acceleration(machine)),)),
    ]


def _forward_dynamics(tape: Tape, machine: Machine) -> Slice:
    """Forward dynamics in the way that takes fewer operations: by articulated bodies, or by M."""

    def piece(accelerations: list[sp.Expr]) -> Slice:
        return Slice("forward_dynamics", ("q", "v", "u"), (_vector(accelerations),))

    articulated = piece(articulated_dynamics(machine))
    most = operations(tape, articulated)
    accelerations = factorised_dynamics(machine, most)
    if accelerations is None:
        return articulated
    factorised = piece(accelerations)
    return factorised if operations(tape, factorised) < most else articulated


def _hybrid_slices(hybrid: LinearSystem) -> list[Slice]:
    return [
        Slice("hybrid_mass_matrix", ("q",), (_matrix(hybrid.matrix),)),
        Slice("hybrid_residual", ("q", "v"), (_vector(hybrid.residual),)),
        Slice("hybrid_input_matrix", ("q",), (_matrix(hybrid.inputs),)),
    ]


def _inverse_dynamics(machine: Machine) -> list[sp.Expr]:
    """M a − R = ∂S/∂θ̈ at the given accelerations."""
    state = State(machine.v, machine.a, machine.parameters.gravity)
    return generalised_inertia_forces(machine.tape, machine.root, machine.reduced_chain, state)


def _gibbs(machine: Machine) -> sp.Expr:
    state = State(machine.v, machine.a, machine.parameters.gravity)
    return gibbs_function(machine.tape, machine.root, machine.reduced_chain, state)


def _kinetic_energy(machine: Machine) -> sp.Expr:
    """The Gibbs function of a machine at rest, weightless, whose accelerations are the rates."""
    zero = sp.S.Zero
    state = State([zero] * len(machine.q), machine.v, zero)
    return gibbs_function(machine.tape, machine.root, machine.reduced_chain, state)


def _potential_energy(machine: Machine) -> sp.Expr:
    """Gravity times the first moment of mass above the world's Z = 0."""
    tape = machine.tape
    composite = composites(tape, machine.reduced_chain)[0]
    height = machine.root.world(tape, composite.moment)[2]
    moment = tape.let(composite.mass * machine.origin[2] + height)
    return tape.let(machine.parameters.gravity * moment)


def _matrix(rows: Sequence[Sequence[sp.Expr]]) -> tuple[tuple[int, ...], tuple[sp.Expr, ...]]:
    return (len(rows), len(rows[0])), tuple(entry for row in rows for entry in row)


def _vector(entries: Iterable[sp.Expr]) -> tuple[tuple[int, ...], tuple[sp.Expr, ...]]:
    vector = tuple(entries)
    return (len(vector),), vector


def _scalar(entry: sp.Expr) -> tuple[tuple[int, ...], tuple[sp.Expr, ...]]:
    return (), (entry,)
