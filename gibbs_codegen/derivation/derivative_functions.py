"""What derives each array of the functions that are generated on request, under its name there."""

from __future__ import annotations

from collections.abc import Callable

from gibbs_codegen.derivation.coriolis import coriolis_matrix
from gibbs_codegen.derivation.forward_kinematics import (
    frame_jacobians,
    frame_poses,
    frame_velocities,
)
from gibbs_codegen.derivation.frames import mounted_frames
from gibbs_codegen.derivation.parameter_derivatives import parameter_gradient, parameter_jacobian
from gibbs_codegen.derivation.regressor import base_parameters, regressor
from gibbs_codegen.derivation.systems import Array, Systems
from gibbs_codegen.graph.differentiate import Matrix
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
