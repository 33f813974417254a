"""Derivations of every array of the table of emitted functions, by the names in the table."""

from __future__ import annotations

from collections.abc import Callable

from gibbs_codegen.derivation import (
    forward_kinematics,
    hybrid,
    inverse_dynamics,
    momentum,
    passive,
    systems,
    wrenches,
)
from gibbs_codegen.derivation.constraint_derivatives import IMPLICIT, ConstrainedSystems
from gibbs_codegen.graph.differentiate import Matrix
from gibbs_codegen.interface.actuators import (
    ACTUATOR_DERIVATIVES,
    ACTUATOR_PARAMETERS,
    ACTUATORS,
)
from gibbs_codegen.interface.constraints import CONSTRAINT_DERIVATIVES


def _block(s: ConstrainedSystems, rows: str, columns: str) -> Matrix:
    """Second derivatives of inverse dynamics by "q" or "v" (rows) and by "q" or "v" (columns)."""
    size = len(s.symbolic.v)
    place = {"q": slice(0, size), "v": slice(size, 2 * size)}
    return [row[place[columns]] for row in s.inverse_hessian[place[rows]]]


def _by_q(s: ConstrainedSystems) -> Matrix:
    """Rows by q of the second derivatives of the inputs' forces."""
    return s.input_hessian[: len(s.symbolic.v)]


def _of_drives(name: str) -> Callable[[ConstrainedSystems], systems.Array]:
    """The derivation of a function of the drives."""
    return lambda s: s.of_drives(name)


def _by(name: str, argument: str) -> Callable[[ConstrainedSystems], systems.Array]:
    """The derivation of the derivative of what has a name by an argument."""
    value, implicit = DERIVATIONS[name], IMPLICIT.get(name)

    def passed_over(s: ConstrainedSystems) -> systems.Array:
        return s.jacobian(value(s), argument)

    if implicit is None:
        return passed_over
    return lambda s: implicit(s, argument) if s.symbolic.robot.is_recursive else passed_over(s)


def _by_parameters(name: str) -> Callable[[ConstrainedSystems], systems.Array]:
    """The derivation of the derivative of what has a name by the parameters."""
    return lambda s: systems.parameter_jacobian(s, DERIVATIONS[name](s))


DERIVATIONS: dict[str, Callable[[ConstrainedSystems], systems.Array]] = {
    "mass_matrix": lambda s: s.reduced.matrix,
    "residual": lambda s: s.reduced.residual,
    "input_matrix": lambda s: s.reduced.inputs,
    "forward_dynamics": lambda s: s.dynamics[1],
    "inverse_dynamics": lambda s: s.inverse_dynamics,
    "hybrid_mass_matrix": lambda s: s.hybrid.matrix,
    "hybrid_residual": lambda s: s.hybrid.residual,
    "hybrid_input_matrix": lambda s: s.hybrid.inputs,
    "constraint_torques": lambda s: hybrid.constraint_torques(s.tree),
    "gibbs": lambda s: passive.gibbs(s.tree),
    "kinetic_energy": lambda s: passive.kinetic_energy(s.tree),
    "potential_energy": lambda s: passive.potential_energy(s.tree),
    "positions": lambda s: forward_kinematics.positions(s.tree),
    "tip_pose": lambda s: forward_kinematics.frame_poses(s.tree, "tip"),
    "tip_jacobian": lambda s: s.symbolic.folded(forward_kinematics.frame_jacobians(s.tree, "tip")),
    "tip_bias_acceleration": lambda s: forward_kinematics.tip_bias_acceleration(s.tree),
    "frame_poses": lambda s: forward_kinematics.frame_poses(s.tree),
    "frame_jacobians": lambda s: s.frame_jacobians,
    "frame_velocities": lambda s: forward_kinematics.frame_velocities(s.tree),
    "frame_bias_accelerations": (lambda s: forward_kinematics.frame_bias_accelerations(s.tree)),
    "centre_of_mass": lambda s: forward_kinematics.centre_of_mass(s.tree),
    "centre_of_mass_jacobian": lambda s: s.centre_jacobian,
    "centroidal_momentum": lambda s: forward_kinematics.centroidal_momentum(s.tree),
    "gravity_forces": lambda s: s.symbolic.folded(forward_kinematics.gravity_forces(s.tree)),
    "wrench_forces": lambda s: s.symbolic.folded(wrenches.wrench_forces(s.tree)),
    "forward_dynamics_with_wrenches": lambda s: s.loaded_dynamics,
    "joint_wrenches": lambda s: wrenches.joint_wrenches(s.tree),
    "joint_wrenches_with_wrenches": (lambda s: wrenches.joint_wrenches(s.tree, with_frames=True)),
    "coordinate_rates": lambda s: s.symbolic.coordinate_rates(s.symbolic.v),
    "integrated": lambda s: s.symbolic.integrated(),
    "difference": lambda s: s.symbolic.difference(),
    # Derivatives.
    "inverse_dynamics_dq": lambda s: s.inverse_derivatives.force_dq,
    "inverse_dynamics_dv": lambda s: s.inverse_derivatives.force_dv,
    # By the recursion whose derivatives these are, which need not be the shorter one.
    "differentiated_dynamics": lambda s: s.forward_derivatives.acceleration,
    "forward_dynamics_dq": lambda s: s.forward_derivatives.acceleration_dq,
    "forward_dynamics_dv": lambda s: s.forward_derivatives.acceleration_dv,
    "forward_dynamics_du": lambda s: s.forward_derivatives.acceleration_du,
    "inverse_dynamics_jvp": lambda s: s.jvp(s.inverse_dynamics, "qva"),
    "forward_dynamics_jvp": lambda s: s.jvp(s.dynamics[1], "qvu"),
    "inverse_dynamics_q_bar": lambda s: s.inverse_gradient[0],
    "inverse_dynamics_v_bar": lambda s: s.inverse_gradient[1],
    "inverse_dynamics_a_bar": lambda s: s.inverse_gradient[2],
    "forward_dynamics_q_bar": lambda s: s.forward_gradient[0],
    "forward_dynamics_v_bar": lambda s: s.forward_gradient[1],
    "forward_dynamics_u_bar": lambda s: s.forward_gradient[2],
    "inverse_dynamics_qq": lambda s: _block(s, "q", "q"),
    "inverse_dynamics_qv": lambda s: _block(s, "q", "v"),
    "inverse_dynamics_vv": lambda s: _block(s, "v", "v"),
    "inverse_dynamics_qa": lambda s: s.jacobian(s.inverse_gradient[0], "a"),
    "forward_dynamics_hessian": lambda s: s.hessian(s.dynamics[1], "qvu"),
    "input_forces": lambda s: s.input_forces,
    "input_forces_dq": lambda s: s.jacobian(s.input_forces, "q"),
    "input_forces_qq": lambda s: [row[: len(s.symbolic.v)] for row in _by_q(s)],
    "input_forces_qu": lambda s: [row[len(s.symbolic.v) :] for row in _by_q(s)],
    "coriolis_matrix": lambda s: s.symbolic.folded_matrix(inverse_dynamics.coriolis_matrix(s.tree)),
    "momentum": lambda s: s.symbolic.folded(momentum.momentum(s.tree)),
    "momentum_rate": lambda s: s.symbolic.folded(momentum.momentum_rate(s.tree)),
    "passive_inverse_dynamics": (
        lambda s: s.symbolic.folded(momentum.passive_inverse_dynamics(s.tree))
    ),
    "regressor": lambda s: systems.regressor(s, s.tree.state),
    "reference_regressor": lambda s: systems.regressor(s, s.tree.reference_state),
    "base_parameters": systems.base_parameters,
    "inverse_dynamics_dp": lambda s: systems.parameter_jacobian(s, s.inverse_dynamics),
    "forward_dynamics_p_bar": lambda s: systems.parameter_gradient(s, s.dynamics[1]),
    "frame_poses_dq": lambda s: s.jacobian(forward_kinematics.frame_poses(s.tree), "q"),
    "frame_velocities_dq": (lambda s: s.jacobian(forward_kinematics.frame_velocities(s.tree), "q")),
    "frame_velocities_dv": lambda s: s.frame_jacobians,
    "integrated_dq": lambda s: s.symbolic.integrated_by(s.symbolic.root.integrated_by_place),
    "integrated_dv": lambda s: s.symbolic.integrated_by(s.symbolic.root.integrated_by_step),
    "difference_dq0": lambda s: s.symbolic.difference_by(s.symbolic.root.difference_by_start, -1),
    "difference_dq1": lambda s: s.symbolic.difference_by(s.symbolic.root.difference_by_end, 1),
    "input_matrix_jvp": lambda s: s.jvp(s.reduced.inputs, "q"),
    "input_matrix_q_bar": lambda s: s.gradient(s.reduced.inputs, "q", "w_input_matrix")[0],
    "centre_of_mass_jacobian_jvp": (lambda s: s.jvp(s.centre_jacobian, "q")),
    "centre_of_mass_jacobian_q_bar": (
        lambda s: s.gradient(s.centre_jacobian, "q", "w_jacobian")[0]
    ),
    "frame_bias_accelerations_dq": (
        lambda s: s.jacobian(forward_kinematics.frame_bias_accelerations(s.tree), "q")
    ),
    "frame_bias_accelerations_dv": (
        lambda s: s.jacobian(forward_kinematics.frame_bias_accelerations(s.tree), "v")
    ),
    "differentiated_loaded": lambda s: s.loaded_derivatives.acceleration,
    "forward_dynamics_with_wrenches_dq": lambda s: s.loaded_derivatives.acceleration_dq,
    "forward_dynamics_with_wrenches_dv": lambda s: s.loaded_derivatives.acceleration_dv,
    "forward_dynamics_with_wrenches_du": lambda s: s.loaded_derivatives.acceleration_du,
    "forward_dynamics_with_wrenches_dW": lambda s: s.loaded_derivatives.acceleration_dW,
    "forward_dynamics_with_wrenches_jvp": lambda s: s.jvp(s.loaded_dynamics, "qvuW"),
    "joint_wrenches_with_wrenches_jvp": (
        lambda s: s.jvp(wrenches.joint_wrenches(s.tree, with_frames=True), "qvauW")
    ),
    "forward_dynamics_with_wrenches_q_bar": lambda s: s.loaded_gradient[0],
    "forward_dynamics_with_wrenches_v_bar": lambda s: s.loaded_gradient[1],
    "forward_dynamics_with_wrenches_u_bar": lambda s: s.loaded_gradient[2],
    "forward_dynamics_with_wrenches_W_bar": lambda s: s.loaded_gradient[3],
    "forward_dynamics_with_wrenches_p_bar": (
        lambda s: systems.parameter_gradient(s, s.loaded_dynamics)
    ),
    "constraint_errors": lambda s: s.constraints.errors(),
    "constraint_jacobian": lambda s: s.constraints.jacobian(),
    "constraint_bias": lambda s: s.constraints.bias(),
    "constrained_acceleration": lambda s: s.constraints.acceleration(),
    "constraint_forces": lambda s: s.constraints.forces(),
    "impact_velocities": lambda s: s.constraints.velocities_after(),
    "impact_impulses": lambda s: s.constraints.impulses(),
    "operational_inertia": lambda s: s.constraints.inertia(),
    "constraint_projection": lambda s: s.constraints.projection(),
    **{row.name: _of_drives(row.name) for row in ACTUATORS},
}
for row in (*ACTUATOR_DERIVATIVES, *CONSTRAINT_DERIVATIVES):
    DERIVATIONS |= {
        output.derivation: _by(output.derivation.removesuffix(f"_d{output.by}"), output.by)
        for output in row.outputs
        if output.by
    }
DERIVATIONS |= {
    row.derivations[0]: _by_parameters(row.derivative_of) for row in ACTUATOR_PARAMETERS
}
