"""What derives each array of the table of emitted functions, under the name that it has there."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Sequence

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import whole_inertia
from gibbs_codegen.derivation.derivative_functions import DERIVATIVES
from gibbs_codegen.derivation.forward_dynamics import thrusts_and_wrenches
from gibbs_codegen.derivation.forward_kinematics import (
    frame_bias_acceleration,
    frame_bias_accelerations,
    frame_jacobians,
    frame_poses,
    frame_velocities,
    positions,
)
from gibbs_codegen.derivation.frame_wrenches import wrench_forces
from gibbs_codegen.derivation.frames import MountedFrame, mounted_frames
from gibbs_codegen.derivation.hybrid import constraint_torques
from gibbs_codegen.derivation.joint_wrenches import joint_wrenches
from gibbs_codegen.derivation.momentum import (
    centre_of_mass,
    centre_of_mass_jacobian,
    centroidal_momentum,
    gravity_forces,
)
from gibbs_codegen.derivation.passive import (
    armature_energy,
    passive_gibbs_function,
    spring_energy,
)
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.systems import Array, Systems
from gibbs_codegen.derivation.tree_dynamics import State, gibbs_function
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.program.model import Derivatives
from gibbs_codegen.robot.layout import layout_of

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
