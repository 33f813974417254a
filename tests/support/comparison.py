"""Every function of a module against Pinocchio, which shares no code with the derivation."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from support.pinocchio_oracle import Oracle

TOLERANCE = 1e-10


def assert_close(
    name: str, ours: np.ndarray, theirs: np.ndarray, tolerance: float = TOLERANCE
) -> None:
    """Agreement relative to the norm of the oracle's array; what is zero is zero to rounding."""
    assert np.shape(ours) == np.shape(theirs), f"{name}: {np.shape(ours)}, not {np.shape(theirs)}"
    size = float(np.linalg.norm(theirs))
    error = float(np.linalg.norm(np.asarray(ours) - theirs))
    assert error <= tolerance * size or error < 1e-14, f"{name}: {error / max(size, 1e-300):.2e}"


def states(robot: Robot, module: ModuleType, count: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Random q, v, a, u, `count` of each, away from the singularity of the attitude."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, len(module.COORDINATES)))
    layout = layout_of(robot)
    attitude = layout.q.attitude
    if layout.is_quaternion:
        q[:, attitude] /= np.linalg.norm(q[:, attitude], axis=1, keepdims=True)
    else:
        q[:, layout.middle_angle] = rng.uniform(-1.2, 1.2, count)
    v, a = rng.normal(size=(2, count, len(module.VELOCITIES)))
    return q, v, a, rng.normal(size=(count, len(module.INPUTS)))


def compare(robot: Robot, module: ModuleType, count: int = 2, oracle: Oracle | None = None) -> None:
    """All functions of the module, evaluated as a batch, against the oracle state by state.

    Another `oracle` than that of the robot file may be given.
    """
    oracle = oracle or Oracle(robot)
    q, v, a, u = states(robot, module, count)
    batch = {
        "M": module.mass_matrix(q),
        "R": module.residual(q, v),
        "B": module.input_matrix(q),
        "I_H": module.hybrid_mass_matrix(q),
        "R_H": module.hybrid_residual(q, v),
        "B_H": module.hybrid_input_matrix(q),
        "forward": module.forward_dynamics(q, v, u),
        "inverse": module.inverse_dynamics(q, v, a),
        "torques": module.constraint_torques(q, v, a, u),
        "positions": module.positions(q),
        "gibbs": module.gibbs(q, v, a) - module.gibbs(q, v, np.zeros_like(a)),
        "kinetic": module.kinetic_energy(q, v),
        "potential": module.potential_energy(q),
        "coordinate rates": module.coordinate_rates(q, v),
        "integrated": module.integrate(q, v),
        "difference": module.difference(q, q[::-1]),
    }
    if "tip" in oracle.frames:
        batch |= {
            "pose": module.tip_pose(q),
            "jacobian": module.tip_jacobian(q),
            "tip bias": module.tip_bias_acceleration(q, v),
        }
    wrenches = np.random.default_rng(1).normal(size=(count, len(module.FRAMES), 6))
    batch |= {
        "frame poses": module.frame_poses(q),
        "frame Jacobians": module.frame_jacobians(q),
        "frame velocities": module.frame_velocities(q, v),
        "frame bias": module.frame_bias_accelerations(q, v),
        "wrench forces": module.wrench_forces(q, wrenches),
        "pushed": module.forward_dynamics_with_wrenches(q, v, u, wrenches),
        "unpushed": module.forward_dynamics_with_wrenches(q, v, u, 0.0 * wrenches),
        "centre": module.centre_of_mass(q),
        "centre Jacobian": module.centre_of_mass_jacobian(q),
        "momentum": module.centroidal_momentum(q, v),
        "gravity": module.gravity_forces(q),
        "joint wrenches": module.joint_wrenches(q, v, a, u),
    }
    both = module.mass_matrix_and_residual(q, v)
    for i in range(count):
        ours = {name: values[i] for name, values in batch.items()}
        assert_close("M of both", both[0][i], ours["M"])
        assert_close("R of both", both[1][i], ours["R"])
        _compare_state(oracle, ours, q[i], v[i], a[i], u[i])
        _compare_frames(oracle, ours, q[i], v[i], wrenches[i])
        _compare_pushed(oracle, ours, q[i], v[i], u[i])
        _compare_mass(oracle, ours, q[i], v[i])
        assert_close(
            "joint wrenches", ours["joint wrenches"], oracle.joint_wrenches(q[i], v[i], a[i], u[i])
        )
        assert_close("rates", ours["coordinate rates"], oracle.coordinate_rates(q[i], v[i]))
        assert_close("integrated", ours["integrated"], oracle.integrated(q[i], v[i]))
        assert_close("difference", ours["difference"], oracle.difference(q[i], q[count - 1 - i]))


def _compare_state(
    oracle: Oracle,
    ours: dict[str, np.ndarray],
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    u: np.ndarray,
) -> None:
    free, held = oracle.free, oracle.held
    matrix, inputs = oracle.mass_matrix(q), oracle.input_matrix(q)
    residual = -oracle.inverse_dynamics(q, v, np.zeros_like(a))
    inverse = oracle.inverse_dynamics(q, v, a)
    size = len(oracle.order)
    assert_close("M", ours["M"], matrix[np.ix_(free, free)])
    assert_close("R", ours["R"], residual[free])
    assert_close("B", ours["B"], inputs[free])
    assert_close("I_H", ours["I_H"][:size, :size], matrix)
    assert_close("R_H", ours["R_H"][:size], residual)
    assert_close("B_H", ours["B_H"][:size], inputs)
    assert_close("inverse dynamics", ours["inverse"], inverse[free])
    mass, right = matrix[np.ix_(free, free)], residual[free] + inputs[free] @ u
    assert_close("M a = R + B u", mass @ ours["forward"], right)
    if np.linalg.cond(mass) < 1e5:  # Else either solution may be off by more than the tolerance.
        assert_close("forward dynamics", ours["forward"], np.linalg.solve(mass, right))
    assert_close("constraint torques", ours["torques"], (inverse - inputs @ u)[held])
    accelerating = a @ (0.5 * mass @ a - residual[free])
    assert_close("Gibbs function", ours["gibbs"], np.array(accelerating))
    assert_close("positions", ours["positions"], oracle.positions(q))
    if tip := oracle.frames.get("tip"):
        jacobian, placement = oracle.point_jacobian(q, tip)
        assert_close("tip pose", ours["pose"], placement.homogeneous)
        assert_close("tip Jacobian", ours["jacobian"], jacobian[:, free])
        bias = oracle.bias_acceleration(q, v, tip)
        assert_close("tip bias acceleration", ours["tip bias"], bias)
    kinetic, potential = oracle.energies(q, v)
    assert_close("kinetic energy", ours["kinetic"], np.array(kinetic))
    assert_close("potential energy", ours["potential"], np.array(potential))


def _compare_frames(
    oracle: Oracle,
    ours: dict[str, np.ndarray],
    q: np.ndarray,
    v: np.ndarray,
    wrenches: np.ndarray,
) -> None:
    forces = np.zeros(len(v))
    for k, frame in enumerate(oracle.frames.values()):
        jacobian, placement = oracle.point_jacobian(q, frame)
        jacobian = jacobian[:, oracle.free]
        assert_close("frame pose", ours["frame poses"][k], placement.homogeneous)
        assert_close("frame Jacobian", ours["frame Jacobians"][k], jacobian)
        assert_close("frame velocity", ours["frame velocities"][k], jacobian @ v)
        bias = oracle.bias_acceleration(q, v, frame)
        assert_close("frame bias acceleration", ours["frame bias"][k], bias)
        forces += jacobian.T @ wrenches[k]
    assert_close("wrench forces", ours["wrench forces"], forces)


def _compare_pushed(
    oracle: Oracle, ours: dict[str, np.ndarray], q: np.ndarray, v: np.ndarray, u: np.ndarray
) -> None:
    free = oracle.free
    mass = oracle.mass_matrix(q)[np.ix_(free, free)]
    assert_close("unpushed", mass @ ours["unpushed"], mass @ ours["forward"])
    residual = -oracle.inverse_dynamics(q, v, np.zeros_like(v))[free]
    right = residual + oracle.input_matrix(q)[free] @ u + ours["wrench forces"]
    assert_close("M a = R + B u + J^T W", mass @ ours["pushed"], right)


def _compare_mass(
    oracle: Oracle, ours: dict[str, np.ndarray], q: np.ndarray, v: np.ndarray
) -> None:
    centre, jacobian, momentum, gravity = oracle.centroidal(q, v)
    assert_close("centre of mass", ours["centre"], centre)
    assert_close("Jacobian of the centre of mass", ours["centre Jacobian"], jacobian)
    assert_close("centroidal momentum", ours["momentum"], momentum)
    assert_close("gravity forces", ours["gravity"], gravity)
