"""What derives each array of the table of emitted functions, under the name that it has there."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Sequence

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import whole_inertia
from gibbs_codegen.derivation.forces import (
    armature_energy,
    passive_gibbs_function,
    spring_energy,
)
from gibbs_codegen.derivation.forward_dynamics import thrusts_and_wrenches
from gibbs_codegen.derivation.forward_kinematics import (
    MountedFrame,
    frame_bias_acceleration,
    frame_bias_accelerations,
    frame_jacobians,
    frame_poses,
    frame_velocities,
    mounted_frames,
    positions,
)
from gibbs_codegen.derivation.hybrid import constraint_torques
from gibbs_codegen.derivation.inverse_dynamics_derivatives import coriolis_matrix
from gibbs_codegen.derivation.momentum import (
    centre_of_mass,
    centre_of_mass_jacobian,
    centroidal_momentum,
    gravity_forces,
)
from gibbs_codegen.derivation.parameter_derivatives import (
    base_parameters,
    parameter_gradient,
    parameter_jacobian,
    regressor,
)
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.systems import Array, Systems
from gibbs_codegen.derivation.tree_dynamics import State, gibbs_function
from gibbs_codegen.derivation.wrenches import joint_wrenches, wrench_forces
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.graph.differentiate import Matrix
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.program.model import Derivatives
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.symbolic import vectors


def _block(systems: Systems, rows: str, columns: str) -> Matrix:
    """Second derivatives of inverse dynamics by "q" or "v" (rows) and by "q" or "v" (columns)."""
    size = len(systems.symbolic.v)
    place = {"q": slice(0, size), "v": slice(size, 2 * size)}
    return [row[place[columns]] for row in systems.inverse_hessian[place[rows]]]


def _by_q(systems: Systems) -> Matrix:
    """Rows by q of the second derivatives of the inputs' forces."""
    return systems.input_hessian[: len(systems.symbolic.v)]


def _frame_poses_dq(systems: Systems) -> Array:
    poses = frame_poses(systems.symbolic, mounted_frames(systems.symbolic))
    entries = [entry for pose in poses for row in pose for entry in row]
    return systems.generic.jacobian(entries, "q")


def _frame_velocities_dq(systems: Systems) -> Array:
    velocities = frame_velocities(systems.symbolic)
    return systems.generic.jacobian([entry for row in velocities for entry in row], "q")


def _frame_velocities_dv(systems: Systems) -> Array:
    return frame_jacobians(systems.symbolic, mounted_frames(systems.symbolic))


def _integrated_dq(systems: Systems) -> Array:
    step, _ = layout_of(systems.symbolic.robot).v.split(systems.symbolic.v)
    return _with_joints(systems, systems.symbolic.root.integrated_by_place(systems.tape, step))


def _integrated_dv(systems: Systems) -> Array:
    step, _ = layout_of(systems.symbolic.robot).v.split(systems.symbolic.v)
    return _with_joints(systems, systems.symbolic.root.integrated_by_step(systems.tape, step))


def _with_joints(systems: Systems, block: vectors.Matrix) -> vectors.Matrix:
    """The base's block of a derivative, beside the identity of the joints."""
    places = layout_of(systems.symbolic.robot).v
    matrix = vectors.identity(places.size)
    for i, row in zip(places.base, block, strict=True):
        for j, entry in zip(places.base, row, strict=True):
            matrix[i][j] = entry
    return matrix


DERIVATIVES: dict[str, Callable[[Systems], Array]] = {
    "inverse_dynamics_dq": lambda s: s.inverse_derivatives.force_dq,
    "inverse_dynamics_dv": lambda s: s.inverse_derivatives.force_dv,
    # By the recursion whose derivatives these are, which need not be the shorter one.
    "differentiated_dynamics": lambda s: s.forward_derivatives.acceleration,
    "forward_dynamics_dq": lambda s: s.forward_derivatives.acceleration_dq,
    "forward_dynamics_dv": lambda s: s.forward_derivatives.acceleration_dv,
    "forward_dynamics_du": lambda s: s.forward_derivatives.acceleration_du,
    "inverse_dynamics_jvp": lambda s: s.generic.jvp(s.inverse_dynamics, "qva"),
    "forward_dynamics_jvp": lambda s: s.generic.jvp(s.dynamics[1], "qvu"),
    "inverse_dynamics_q_bar": lambda s: s.inverse_gradient[0],
    "inverse_dynamics_v_bar": lambda s: s.inverse_gradient[1],
    "inverse_dynamics_a_bar": lambda s: s.inverse_gradient[2],
    "forward_dynamics_q_bar": lambda s: s.forward_gradient[0],
    "forward_dynamics_v_bar": lambda s: s.forward_gradient[1],
    "forward_dynamics_u_bar": lambda s: s.forward_gradient[2],
    "inverse_dynamics_qq": lambda s: _block(s, "q", "q"),
    "inverse_dynamics_qv": lambda s: _block(s, "q", "v"),
    "inverse_dynamics_vv": lambda s: _block(s, "v", "v"),
    "inverse_dynamics_qa": lambda s: s.generic.jacobian(s.inverse_gradient[0], "a"),
    "forward_dynamics_hessian": lambda s: s.generic.hessian(s.dynamics[1], "qvu"),
    "input_forces": lambda s: s.input_forces,
    "input_forces_dq": lambda s: s.generic.jacobian(s.input_forces, "q"),
    "input_forces_qq": lambda s: [row[: len(s.symbolic.v)] for row in _by_q(s)],
    "input_forces_qu": lambda s: [row[len(s.symbolic.v) :] for row in _by_q(s)],
    "coriolis_matrix": lambda s: coriolis_matrix(s.symbolic),
    "regressor": regressor,
    "base_parameters": base_parameters,
    "inverse_dynamics_dp": parameter_jacobian,
    "forward_dynamics_p_bar": parameter_gradient,
    "frame_poses_dq": _frame_poses_dq,
    "frame_velocities_dq": _frame_velocities_dq,
    "frame_velocities_dv": _frame_velocities_dv,
    "integrated_dq": _integrated_dq,
    "integrated_dv": _integrated_dv,
}


# Of more unknown names nobody reads what each could be.
_MOST_SUGGESTIONS = 5


def _gibbs(systems: Systems) -> sp.Expr:
    symbolic, tape = systems.symbolic, systems.tape
    links = gibbs_function(tape, symbolic.root, symbolic.reduced_tree, symbolic.state)
    with tape.group("Gibbs function with armature, dampers and springs"):
        return tape.let(sp.Add(links, *passive_gibbs_function(symbolic)))


def _kinetic_energy(systems: Systems) -> sp.Expr:
    """The Gibbs function of a robot at rest, weightless, whose accelerations are the rates."""
    symbolic, zero = systems.symbolic, sp.S.Zero
    state = State([zero] * len(symbolic.v), symbolic.v, zero)
    links = gibbs_function(symbolic.tape, symbolic.root, symbolic.reduced_tree, state)
    with symbolic.tape.group("kinetic energy with that of the armature"):
        return symbolic.tape.let(sp.Add(links, *armature_energy(symbolic)))


def _potential_energy(systems: Systems) -> sp.Expr:
    """Gravity times the first moment of mass above the world's Z = 0."""
    tape, symbolic = systems.tape, systems.symbolic
    composite = whole_inertia(tape, symbolic.reduced_tree)
    with tape.group("first moment of mass above Z = 0, and its weight"):
        height = symbolic.root.world(tape, composite.moment)[2]
        moment = tape.let(composite.mass * symbolic.origin[2] + height)
        weight = tape.let(symbolic.parameters.gravity * moment)
    with tape.group("potential energy with that of the springs"):
        return tape.let(sp.Add(weight, *spring_energy(symbolic)))


def _integrated(systems: Systems) -> list[sp.Expr]:
    """Coordinates after the displacement v: q ⊕ v."""
    tape, symbolic = systems.tape, systems.symbolic
    places = layout_of(symbolic.robot)
    base, joints = places.q.split(symbolic.q)
    step, turns = places.v.split(symbolic.v)
    with tape.group("attitude and position after the displacement"):
        moved = symbolic.root.integrated(tape, base, step)
    with tape.group("joints after the displacement"):
        turned = [tape.let(q + v) for q, v in zip(joints, turns, strict=True)]
    return places.q.joined(moved, turned)


def _difference(systems: Systems) -> list[sp.Expr]:
    """The displacement v with q₀ ⊕ v = q₁."""
    tape, symbolic = systems.tape, systems.symbolic
    places = layout_of(symbolic.robot)
    start, from_joints = places.q.split(symbolic.q0)
    end, to_joints = places.q.split(symbolic.q1)
    with tape.group("displacement of attitude and position"):
        step = symbolic.root.difference(tape, start, end)
    with tape.group("displacements of the joints"):
        turns = [tape.let(q - p) for p, q in zip(from_joints, to_joints, strict=True)]
    return places.v.joined(step, turns)


def _tip(systems: Systems) -> MountedFrame:
    return next(frame for frame in mounted_frames(systems.symbolic) if frame.name == "tip")


def _with_frames(systems: Systems) -> tuple[SymbolicRobot, list[MountedFrame]]:
    return systems.symbolic, mounted_frames(systems.symbolic)


DERIVATIONS: dict[str, Callable[[Systems], Array]] = {
    "mass_matrix": lambda systems: systems.reduced.matrix,
    "residual": lambda systems: systems.reduced.residual,
    "input_matrix": lambda systems: systems.reduced.inputs,
    "forward_dynamics": lambda systems: systems.dynamics[1],
    "inverse_dynamics": lambda systems: systems.inverse_dynamics,
    "hybrid_mass_matrix": lambda systems: systems.hybrid.matrix,
    "hybrid_residual": lambda systems: systems.hybrid.residual,
    "hybrid_input_matrix": lambda systems: systems.hybrid.inputs,
    "constraint_torques": lambda systems: constraint_torques(systems.symbolic),
    "gibbs": _gibbs,
    "kinetic_energy": _kinetic_energy,
    "potential_energy": _potential_energy,
    "positions": lambda systems: positions(systems.symbolic),
    "tip_pose": lambda systems: frame_poses(systems.symbolic, [_tip(systems)])[0],
    "tip_jacobian": lambda systems: frame_jacobians(systems.symbolic, [_tip(systems)])[0],
    "tip_bias_acceleration": (
        lambda systems: frame_bias_acceleration(systems.symbolic, _tip(systems))
    ),
    "frame_poses": lambda systems: frame_poses(*_with_frames(systems)),
    "frame_jacobians": lambda systems: frame_jacobians(*_with_frames(systems)),
    "frame_velocities": lambda systems: frame_velocities(systems.symbolic),
    "frame_bias_accelerations": lambda systems: frame_bias_accelerations(systems.symbolic),
    "centre_of_mass": lambda systems: centre_of_mass(systems.symbolic),
    "centre_of_mass_jacobian": lambda systems: centre_of_mass_jacobian(systems.symbolic),
    "centroidal_momentum": lambda systems: centroidal_momentum(systems.symbolic),
    "gravity_forces": lambda systems: gravity_forces(systems.symbolic),
    "wrench_forces": lambda systems: wrench_forces(systems.symbolic),
    "forward_dynamics_with_wrenches": (
        lambda systems: systems.dynamics[0](systems.symbolic, thrusts_and_wrenches)
    ),
    "joint_wrenches": lambda systems: joint_wrenches(systems.symbolic),
    "coordinate_rates": lambda systems: systems.symbolic.coordinate_rates(systems.symbolic.v),
    "integrated": _integrated,
    "difference": _difference,
    **DERIVATIVES,
}


def chosen_derivatives(derivatives: Derivatives) -> tuple[str, ...]:
    """The functions generated on request that a choice stands for, in the order of the table.

    True stands for all that are not long, "all" for those too; with a name come those that it is
    composed of. Raises `UsageError` where a name is unknown, or it is no choice.
    """
    rows = [row for row in FUNCTIONS.values() if row.on_request]
    offered = [row.name for row in rows]
    if isinstance(derivatives, bool):
        return tuple(row.name for row in rows if derivatives and not row.is_long)
    listed = [derivatives] if isinstance(derivatives, str) else derivatives
    if not isinstance(listed, Collection) or not all(isinstance(name, str) for name in listed):
        raise UsageError(
            "derivatives: must be True, False, a name or a list of names, not "
            f"{printable(repr(derivatives), 60)}"
        )
    names = {*listed}
    if unknown := sorted(names.difference(offered, ["all"])):
        raise UsageError(f"--derivatives: unknown: {_with_suggestions(unknown, [*offered, 'all'])}")
    parts = {part for name in names.difference(["all"]) for part in FUNCTIONS[name].composed}
    return tuple(name for name in offered if name in names | parts or "all" in names)


def _with_suggestions(unknown: Sequence[str], known: Sequence[str]) -> str:
    """Words for unknown names, each with the known one that it is like.

    The known ones are listed if one of the first unknown ones is like none of them.
    """
    few = unknown[:_MOST_SUGGESTIONS]
    near = [difflib.get_close_matches(name[:80], known, n=1) for name in few]
    told = [
        printable(repr(name)) + "".join(f" (did you mean {best}?)" for best in found)
        for name, found in zip(few, near, strict=True)
    ]
    rest = [f"and {len(unknown) - len(few)} more"] if len(few) < len(unknown) else []
    listed = "" if all(near) else f"; known: {', '.join(known)}"
    return ", ".join([*told, *rest]) + listed
