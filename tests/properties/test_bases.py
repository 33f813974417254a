"""Bases that do not move freely: by the free robot's functions and closed forms.

The dense oracle knows how a carriage moves, by a few lines of its own, and has everything else from
the module of the same robot with a free base: with u = S v of the velocities, τ = Sᵀ τ_free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.comparison import assert_close, errors
from support.derived import derived
from support.emitted import emitted_module, module_with_derivatives
from support.random_robots import random_tree

from gibbs_codegen import UsageError, parse_robot
from gibbs_codegen.exchange.exporting import export_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.posture import robot_frames
from gibbs_codegen.verification.comparison import Results
from gibbs_codegen.verification.complex_steps import ComplexSteps
from gibbs_codegen.verification.derivatives import compare_derivatives
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.pinocchio_tree import Pinocchio
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

Array = np.ndarray

TILTED = Pose((0.1, -0.2, 0.3), (Fraction(20), Fraction(-35), Fraction(60)))
TURNED_OVER = Pose((0.0, 0.0, 1.0), (Fraction(180), Fraction(0), Fraction(0)))
# Motions with seeds of trees that have a central body, and with poses. The first have derivatives.
CASES = (
    ("fixed", 27, TILTED),
    ("planar", 21, TILTED),
    ("upright", 27, TURNED_OVER),
    (("z", "x", "pitch"), 21, TILTED),
    (("x",), 21, Pose()),
    (("y", "yaw", "roll"), 9, TURNED_OVER),
    (("x", "y", "z", "roll", "yaw", "pitch"), 27, TILTED),
)
DIFFERENTIABLE = CASES[:4]
AXES = np.eye(3)


def with_motion(seed: int, motion: Any, pose: Pose) -> tuple[Robot, Robot]:
    """A random tree with such a base, and the same with a free one."""
    robot = random_tree(seed, "quaternion")
    assert robot.base.body is not None
    assert robot.base.rotors == 0
    name = f"based_{seed}_{'_'.join(motion) if isinstance(motion, tuple) else motion}"
    base = replace(robot.base, attitude="xyz", motion=motion, pose=pose)
    return replace(robot, name=name, base=base), robot


def about(axis: int, angle: complex) -> Array:
    """The rotation about a coordinate axis, for complex angles too."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3, dtype=complex)
    matrix[one, one] = matrix[two, two] = np.cos(angle)
    matrix[two, one] = np.sin(angle)
    matrix[one, two] = -matrix[two, one]
    return matrix


class Carriage:
    """How the base of a robot moves, by its robot file."""

    def __init__(self, robot: Robot) -> None:
        self.pose, motion = robot.base.pose, robot.base.motion
        self.own_axes = motion in ("planar", "upright")
        names = {"fixed": (), "planar": ("x", "y", "yaw"), "upright": ("x", "y", "z", "yaw")}
        self.parts = names[motion] if isinstance(motion, str) else motion

    def place(self, q: Array) -> tuple[Array, Array]:
        """Position and axes of the base's frame in the world."""
        point, axes = np.array(self.pose.xyz, complex), np.eye(3, dtype=complex)
        for part, value in zip(self.parts, q, strict=False):
            if part in "xyz":
                point += value * AXES["xyz".index(part)]
            else:
                axes = axes @ about(("roll", "pitch", "yaw").index(part), value)
        return point, axes @ self.pose.matrix

    def rates(self, q: Array, v: Array) -> Array:
        """Rates of coordinates."""
        rates = np.array(v, complex)
        if self.own_axes:
            yaw = q[len(self.parts) - 1]
            rates[:2] = about(2, yaw)[:2, :2] @ v[:2]
        return rates

    def free_velocities(self, q: Array, v: Array) -> Array:
        """Velocities of the free robot: those of the base in its own frame, then the joints'."""
        spin, drift = np.zeros(3, complex), np.zeros(3, complex)
        axes = np.eye(3, dtype=complex)
        for part, rate, value in zip(self.parts, v, q, strict=False):
            if part in "xyz":
                drift += rate * AXES["xyz".index(part)]
            else:
                axis = ("roll", "pitch", "yaw").index(part)
                spin += rate * (axes @ AXES[axis])
                axes = axes @ about(axis, value)
        if not self.own_axes:
            spin, drift = axes.T @ spin, axes.T @ drift
        back = self.pose.matrix.T
        return np.concatenate([back @ drift, back @ spin, v[len(self.parts) :]])


class Dense:
    """Functions of a robot by those of the same one with a free base, at one state."""

    def __init__(self, robot: Robot, free: ModuleType, state: Sequence[Array]) -> None:
        self.free, self.carriage = free, Carriage(robot)
        self.q, self.v, self.a, self.u, self.W = state
        point, axes = (x.real for x in self.carriage.place(self.q))
        turned = Rotation.from_matrix(axes).as_quat()
        self.q_free = np.concatenate([point, turned, self.q[len(self.carriage.parts) :]])
        units = np.eye(len(self.v))
        columns = [self.carriage.free_velocities(self.q, unit).real for unit in units]
        self.motion = np.array(columns).T
        self.v_free = self.motion @ self.v

    def a_free(self, a: Array) -> Array:
        """Accelerations of the free robot, by a complex step along the motion."""
        q = self.q + 1e-30j * self.carriage.rates(self.q, self.v)
        return self.carriage.free_velocities(q, self.v + 1e-30j * a).imag / 1e-30

    def value(self, name: str) -> Any:
        """What a function should return."""
        free, q, v = self.free, self.q_free, self.v_free
        still = self.a_free(0.0 * self.a)
        mass = self.motion.T @ free.mass_matrix(q) @ self.motion
        residual = -self.motion.T @ free.inverse_dynamics(q, v, still)
        driven = self.motion.T @ free.input_matrix(q)
        return {
            "mass_matrix": lambda: mass,
            "residual": lambda: residual,
            "input_matrix": lambda: driven,
            "inverse_dynamics": lambda: (
                self.motion.T @ free.inverse_dynamics(q, v, self.a_free(self.a))
            ),
            "forward_dynamics": lambda: np.linalg.solve(mass, residual + driven @ self.u),
            "forward_dynamics_with_wrenches": lambda: np.linalg.solve(
                mass, residual + driven @ self.u + self.motion.T @ free.wrench_forces(q, self.W)
            ),
            "kinetic_energy": lambda: free.kinetic_energy(q, v),
            "potential_energy": lambda: free.potential_energy(q),
            "positions": lambda: free.positions(q),
            "frame_poses": lambda: free.frame_poses(q),
            "frame_jacobians": lambda: free.frame_jacobians(q) @ self.motion,
            "frame_velocities": lambda: free.frame_velocities(q, v),
            "centre_of_mass": lambda: free.centre_of_mass(q),
            "centre_of_mass_jacobian": lambda: free.centre_of_mass_jacobian(q) @ self.motion,
            "centroidal_momentum": lambda: free.centroidal_momentum(q, v),
            "gravity_forces": lambda: self.motion.T @ free.gravity_forces(q),
            "joint_wrenches": lambda: free.joint_wrenches(q, v, self.a_free(self.a), self.u),
            "constraint_torques": lambda: free.constraint_torques(
                q, v, self.a_free(self.a), self.u
            ),
        }[name]()


FUNCTIONS = {
    "mass_matrix": "q",
    "residual": "qv",
    "input_matrix": "q",
    "inverse_dynamics": "qva",
    "forward_dynamics": "qvu",
    "forward_dynamics_with_wrenches": "qvuW",
    "kinetic_energy": "qv",
    "potential_energy": "q",
    "positions": "q",
    "frame_poses": "q",
    "frame_jacobians": "q",
    "frame_velocities": "qv",
    "centre_of_mass": "q",
    "centre_of_mass_jacobian": "q",
    "centroidal_momentum": "qv",
    "gravity_forces": "q",
    "joint_wrenches": "qvau",
    "constraint_torques": "qvau",
}


def module_of(motion: Any, seed: int, pose: Pose) -> ModuleType:
    """The module of a case."""
    robot, _ = with_motion(seed, motion, pose)
    differentiable = (motion, seed, pose) in DIFFERENTIABLE
    return module_with_derivatives(robot) if differentiable else emitted_module(robot)


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "seed", "pose"), CASES)
def test_every_function_is_that_of_the_free_robot(motion: Any, seed: int, pose: Pose) -> None:
    robot, free = with_motion(seed, motion, pose)
    module, of_free = module_of(motion, seed, pose), emitted_module(free)
    for k in range(3):
        states = States.random(Tree(robot), 1, [seed, k])
        state = [getattr(states, letter)[0] for letter in "qvauW"]
        dense, given = Dense(robot, of_free, state), dict(zip("qvauW", state, strict=True))
        for name, letters in FUNCTIONS.items():
            if hasattr(of_free, name):
                ours = getattr(module, name)(*(given[letter] for letter in letters))
                assert_close(name, ours, dense.value(name), 1e-11)
        drawn = robot_frames(robot, states.q[0]).points
        np.testing.assert_allclose(drawn, module.positions(states.q[0]), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "seed", "pose"), CASES)
def test_random_trees(motion: Any, seed: int, pose: Pose) -> None:
    """Every function, against Newton and Euler's equations and Pinocchio."""
    robot, _ = with_motion(seed, motion, pose)
    module, tree = module_of(motion, seed, pose), Tree(robot)
    found = errors(module, formulated(NewtonEuler(tree)), 3)
    states = States.random(tree, 3, seed)
    by_pinocchio = Expected(formulated(Pinocchio(tree)), states)
    found |= {c.what: c.error for c in by_pinocchio.compare(Results(module).all(states))}
    for name, error in found.items():
        assert error < 1e-12, f"{name}: {error:.2e}"


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "seed", "pose"), DIFFERENTIABLE)
def test_derivatives(motion: Any, seed: int, pose: Pose) -> None:
    """All derivatives, against complex steps."""
    robot, _ = with_motion(seed, motion, pose)
    module = module_of(motion, seed, pose)
    steps = ComplexSteps(module, robot)
    states = States.random(Tree(robot), 3, seed)
    compared = compare_derivatives(Results(module), steps, robot, states)
    assert compared
    for comparison in compared:
        assert comparison.error < 1e-10, comparison.what


def module_of_text(text: str) -> ModuleType:
    """The module of a robot file."""
    return emitted_module(parse_robot(text, "test"))


BODY = "mass = 2.0\ncom = [0.0, 0.0, 0.7]\ninertia = [0.1, 0.1, 0.01, 0.0, 0.0, 0.0]\n"


@cache
def cart_and_pole() -> ModuleType:
    """A cart that moves along x, with a pole about y."""
    return module_of_text(
        'name = "cart"\n[base]\nmotion = ["x"]\nmass = 3.0\n[[link]]\nname = "pole"\naxis = "y"\n'
        "xyz = [0.0, 0.0, 0.0]\n" + BODY
    )


def test_cart_and_pole() -> None:
    module = cart_and_pole()
    assert module.COORDINATES == module.VELOCITIES == ("x", "pole")
    assert module.INPUTS == ("tau_pole",)
    assert module.ATTITUDE == "x"
    cart, mass, com, inertia, g = 3.0, 2.0, 0.7, 0.1, 9.81
    angle, rate, torque = 0.4, 1.3, 0.7
    across = mass * com * np.cos(angle)
    matrix = np.array([[cart + mass, across], [across, inertia + mass * com**2]])
    right = [mass * com * rate**2 * np.sin(angle), mass * g * com * np.sin(angle) + torque]
    a = module.forward_dynamics(np.array([9.0, angle]), np.array([0.6, rate]), np.array([torque]))
    np.testing.assert_allclose(a, np.linalg.solve(matrix, right), rtol=1e-12)


def test_pendulum_takes_one_product() -> None:
    """Of all that a pendulum's M and R could take; what is fixed has no coordinates."""
    robot = parse_robot(
        'name = "pendulum"\n[base]\nmotion = "fixed"\nmass = 1.0\nxyz = [0.0, 0.0, 2.0]\n'
        'rpy_deg = [180, 0, 0]\n[[link]]\nname = "rod"\naxis = "y"\nxyz = [0.0, 0.0, 0.0]\n' + BODY,
        "test",
    )
    module = emitted_module(robot)
    assert module.COORDINATES == ("rod",)
    matrix, residual = module.mass_matrix_and_residual(np.array([0.3]), np.array([5.0]))
    np.testing.assert_allclose(matrix, [[0.1 + 2.0 * 0.49]], rtol=1e-12)
    np.testing.assert_allclose(residual, [-2.0 * 9.81 * 0.7 * np.sin(0.3)], rtol=1e-12)
    np.testing.assert_allclose(module.positions([0.3])[0], [0.0, 0.0, 2.0], atol=1e-15)
    (program,) = [f for f in derived(robot).program.functions if f.name == "residual"]
    assert len([*program.nodes()]) == 3  # A sine, its product, and the result.


def test_planar_quadrotor() -> None:
    module = module_of_text(
        'name = "planar_quadrotor"\n[base]\nmotion = ["x", "z", "pitch"]\nmass = 0.5\n'
        "inertia = [0.01, 0.02, 0.03, 0, 0, 0]\n[[rotor]]\nposition = [0.2, 0, 0]\n"
        "[[rotor]]\nposition = [-0.2, 0, 0]\n"
    )
    assert module.COORDINATES == ("x", "z", "pitch")
    pitch, u = 0.3, np.array([2.0, 3.5])
    a = module.forward_dynamics(np.array([1.0, 2.0, pitch]), np.array([0.5, -0.3, 1.1]), u)
    lift = u.sum() / 0.5
    expected = [lift * np.sin(pitch), lift * np.cos(pitch) - 9.81, 0.2 * (u[1] - u[0]) / 0.02]
    np.testing.assert_allclose(a, expected, rtol=1e-12)


def test_two_link_satellite() -> None:
    """Newton and Euler's equations of both bodies in the base's own axes."""
    module = module_of_text(
        'name = "satellite"\n[base]\nmotion = "planar"\nmass = 3.0\n'
        'inertia = [0.1, 0.2, 0.3, 0, 0, 0]\n[[link]]\nname = "arm"\nxyz = [0.4, 0, 0]\n'
        "mass = 2.0\ncom = [0.5, 0, 0]\ninertia = [0.1, 0.1, 0.11, 0, 0, 0]\n"
    )
    assert module.COORDINATES == ("x", "y", "yaw", "arm")
    assert module.VELOCITIES == ("vx", "vy", "wz", "arm")
    v, torque, turn = np.array([0.3, -0.8, 1.2, 0.7]), 0.9, 0.6
    a = module.forward_dynamics(np.array([5.0, 6.0, 2.1, turn]), v, np.array([torque]))
    # As complex numbers; j times one of them is its turn by a quarter.
    of_base = a[0] + 1j * a[1] + 1j * v[2] * (v[0] + 1j * v[1])
    spin, gain, reach = v[2] + v[3], a[2] + a[3], 0.5 * np.exp(1j * turn)
    of_arm = of_base + (1j * a[2] - v[2] ** 2) * 0.4 + (1j * gain - spin**2) * reach
    np.testing.assert_allclose(3.0 * of_base + 2.0 * of_arm, 0.0, atol=1e-12)
    held = 0.11 * gain + 2.0 * (np.conj(reach) * of_arm).imag
    np.testing.assert_allclose(held, torque, rtol=1e-12)
    np.testing.assert_allclose(0.3 * a[2] + 0.4 * 2.0 * of_arm.imag, -torque, rtol=1e-12)


def test_what_takes_free_bases_only_says_so() -> None:
    robot, _ = with_motion(9, "planar", TILTED)
    with pytest.raises(UsageError, match=rf"{robot.name}: base.motion is 'planar'.*free"):
        export_robot(robot, "px4")
    robot, _ = with_motion(9, ("x", "pitch"), TILTED)
    with pytest.raises(UsageError, match=r"base.motion is \['x', 'pitch'\]; param"):
        export_robot(robot, "ardupilot")
