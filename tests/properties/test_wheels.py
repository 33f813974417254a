"""Bases that roll: by the free robot's functions, closed forms of textbooks, and energy.

The dense oracle knows how fast wheels turn, by a few lines of its own, and has everything else from
the module of the same robot with a free base and free wheels: with u = S σ of the velocities, where
S is constant, τ = Sᵀ τ_free.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from support.emitted import emitted_module, module_with_derivatives
from support.machines import base, constraint, frame, link, machine, wheel
from support.random_robots import rolling_robot

from gibbs_codegen import (
    RobotFileError,
    UsageError,
    linearise,
    lqr,
    parse_robot,
    rollout,
    simulate,
)
from gibbs_codegen.exchange.exporting import export_robot
from gibbs_codegen.flight.rollouts.vector_env import VectorEnv
from gibbs_codegen.interface import FUNCTIONS, module_signatures
from gibbs_codegen.interface.constraints import CONSTRAINT_DERIVATIVES
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.posture import robot_frames
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.verification.comparison import Results
from gibbs_codegen.verification.complex_steps import ComplexSteps
from gibbs_codegen.verification.derivatives import compare_derivatives
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import QUICK, compare_module, formulations

Array = np.ndarray
# Functions of coordinates, which are compared by themselves, and what is solved for.
APART = {"coordinate_rates", "integrate", "difference"}
SOLVED = {"forward_dynamics", "forward_dynamics_with_wrenches"}
ENERGIES = ("kinetic_energy", "potential_energy")


class Rolled:
    """A rolling robot's functions by those of a robot with free base and wheels."""

    def __init__(self, robot: Robot) -> None:
        base = robot.base
        free = Base(attitude="quaternion", origin="base", body=base.body)
        links = tuple(replace(link, rolling=None) for link in robot.links)
        name = f"{robot.name}_free"
        self.module = emitted_module(replace(robot, name=name, base=free, links=links))
        self.height = base.pose.xyz[2]
        self.own = module_with_derivatives(robot)
        ours = list(self.own.VELOCITIES)
        by_name = {v: np.eye(len(ours))[i] for i, v in enumerate(ours)}
        nothing = np.zeros(len(ours))
        for part in robot.links:
            if part.rolling and part.coordinate:
                ahead, (x, y, _) = part.pose.matrix[:, 0], part.pose.xyz
                speed = ahead[0] * (by_name["vx"] - y * by_name["wz"])
                speed = speed + ahead[1] * (by_name.get("vy", nothing) + x * by_name["wz"])
                by_name[part.coordinate.replace(" ", "_")] = speed / part.rolling.radius
        self.v = np.array([by_name.get(name, nothing) for name in self.module.VELOCITIES])
        self.u = np.eye(len(self.own.INPUTS))
        hybrid = [*self.own.HYBRID_COORDINATES]
        rows = []
        for name in self.module.HYBRID_COORDINATES:
            row = np.zeros(len(hybrid))
            if name in self.module.VELOCITIES:
                row[[hybrid.index(v) for v in ours]] = by_name.get(name, nothing)
            elif name in hybrid:
                row[hybrid.index(name)] = 1.0
            rows.append(row)
        self.h = np.array(rows)

    def q(self, q: Array) -> Array:
        """Coordinates of the free robot."""
        turned = Rotation.from_euler("z", q[2]).as_quat()
        return np.concatenate([q[:2], [self.height], turned, q[3:]])

    def __call__(self, name: str, shapes: list[str], states: dict[str, Array]) -> list[Array]:
        """Projected results of a function, whose shapes are in the letters of the table."""
        (signature,) = (s for s in module_signatures(self.module) if s.name == name)
        whole = states | {"v": self.v @ states["v"], "a": self.v @ states["a"]}
        whole["q"] = self.q(states["q"])
        values = getattr(self.module, name)(*(whole[x] for x in signature.arguments))
        values = values if isinstance(values, tuple) else (values,)
        return [self._fold(x, shape) for x, shape in zip(values, shapes, strict=True)]

    def _fold(self, array: Array, shape: str) -> Array:
        for axis, letter in enumerate(shape):
            if letter in "vhu":
                array = np.moveaxis(np.moveaxis(array, axis, -1) @ getattr(self, letter), -1, axis)
        return array


# With a drive, and on wheels that slide beside a link that is held; both have gears.
SEEDS = (60, 35)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_functions_are_those_of_the_free_robot_projected(seed: int) -> None:
    robot = rolling_robot(seed)
    assert parse_robot(robot_text(robot)) == robot
    rolled = Rolled(robot)
    module, rng, compared = rolled.own, np.random.default_rng(seed), 0
    sizes = {"q": "COORDINATES", "v": "VELOCITIES", "a": "VELOCITIES", "u": "INPUTS"}
    states = {x: rng.normal(size=len(getattr(module, name))) for x, name in sizes.items()}
    states["W"] = rng.normal(size=(len(module.FRAMES), 6))
    for signature in module_signatures(module):
        name, row = signature.name, FUNCTIONS[signature.name]
        if name in APART or row.composed or not {*row.arguments} <= {*"qvauW"}:
            continue
        if not hasattr(rolled.module, name):  # A derivative.
            continue
        ours = getattr(module, name)(*(states[x] for x in signature.arguments))
        shapes = [output.shape for output in row.outputs]
        if name in SOLVED:
            (matrix,), (right,) = (
                rolled("mass_matrix", ["vv"], states),
                rolled("residual", ["v"], states),
            )
            right = right + rolled("input_matrix", ["vu"], states)[0] @ states["u"]
            if "W" in row.arguments:
                right = right + rolled("wrench_forces", ["v"], states)[0]
            theirs = [np.linalg.solve(matrix, right)]
        else:
            theirs = rolled(name, shapes, states)
        for one, other in zip(ours if isinstance(ours, tuple) else (ours,), theirs, strict=True):
            size = max(1.0, np.abs(other).max(initial=0.0))
            np.testing.assert_allclose(one, other, atol=1e-12 * size, err_msg=name)
            compared += 1
    assert compared >= 20
    # A displacement is the motion at constant velocities for a unit of time.
    q, v = states["q"], states["v"]
    moved = rolled.module.integrate(rolled.q(q), rolled.v @ v)
    end = module.integrate(q, v)
    np.testing.assert_allclose(rolled.q(end)[[0, 1]], moved[[0, 1]], atol=1e-13)
    np.testing.assert_allclose(end[2], q[2] + v[list(module.VELOCITIES).index("wz")], atol=1e-13)
    np.testing.assert_allclose(end[3:], moved[7:], atol=1e-12)
    np.testing.assert_allclose(module.difference(q, end), v, atol=1e-12)
    frames = robot_frames(robot, q)
    np.testing.assert_allclose(frames.points, module.positions(q), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_rolling_robots_pass_with_derivatives_and_wheels_the_other_way_do_not(seed: int) -> None:
    robot = rolling_robot(seed)
    module = module_with_derivatives(robot)
    assert hasattr(module, "step_rk4_derivatives") == bool(seed % 2)
    against = formulations(robot)[0]
    assert len(against) >= 3
    failures = [c for c in compare_module(module, robot, against, 3, 0) if not c.passed]
    assert not failures
    states = States.random(Tree(robot), 3, seed)
    compared = compare_derivatives(Results(module), ComplexSteps(module, robot), robot, states)
    assert all(comparison.error < 1e-10 for comparison in compared)
    k, link = next((k, x) for k, x in enumerate(robot.links) if x.rolling and x.moves)
    roll, pitch, yaw = link.pose.rpy_deg
    wrong = replace(link, pose=replace(link.pose, rpy_deg=(roll, pitch, yaw + 180)))
    other = replace(robot, links=(*robot.links[:k], wrong, *robot.links[k + 1 :]))
    comparisons = compare_module(module, other, formulations(other)[0][:1], 3, 0, extent=QUICK)
    failed = {c.what for c in comparisons if not c.passed}
    assert failed >= {"coordinate_rates", "forward_dynamics", "input_matrix", "integrate"}


def module_of_text(text: str) -> ModuleType:
    """The module of a robot file."""
    return emitted_module(parse_robot(text, "test"))


SLEIGH = machine(
    "sleigh", base(2.0, [0.3, 0.4, 0.5], motion="planar", drive="differential", com=[0.3, 0, 0.1])
)


def test_chaplygin_sleigh() -> None:
    """Its speeds in closed form: ahead v = E tanh(λt), about z ω = E/κ sech(λt)."""
    module = module_of_text(SLEIGH)
    assert module.COORDINATES == ("x", "y", "yaw")
    assert module.VELOCITIES == ("vx", "wz")
    mass, ahead, inertia = 2.0, 0.3, 0.5
    square = inertia / mass + ahead**2
    v = np.array([0.7, -1.3])
    expected = [ahead * v[1] ** 2, -ahead * v[0] * v[1] / square]
    a = module.forward_dynamics(np.array([1.0, 2.0, 0.4]), v, np.zeros(0))
    np.testing.assert_allclose(a, expected, rtol=1e-12)
    speed, rate = 1.1, 1.1 * ahead / square

    def velocities(t: float) -> Array:
        return np.array([np.tanh(rate * t), 1.0 / np.cosh(rate * t) / np.sqrt(square)]) * speed

    def change(_: float, x: Array) -> Array:
        q, v = x[:3], x[3:]
        a = module.forward_dynamics(q, v, np.zeros(0))
        return np.concatenate([module.coordinate_rates(q, v), a])

    begin = np.concatenate([np.zeros(3), velocities(-2.0)])
    end = solve_ivp(change, (-2.0, 2.0), begin, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(end[3:], velocities(2.0), rtol=1e-10)
    # The yaw is the integral of a hyperbolic secant.
    turned = 4.0 * np.arctan(np.tanh(0.5 * rate * 2.0)) / rate * speed / np.sqrt(square)
    np.testing.assert_allclose(end[2], turned, rtol=1e-10)


CART = machine(
    "two_wheels",
    base(30.0, [10, 10, 15.625], motion="planar", drive="differential", com=[0.3, 0, 0]),
    wheel("left", [0, 0.75, 0.15], joint="phi_left", mass=1, inertia=0.005, inertia_across=0.0025),
    wheel("right", [0, -0.75, 0.15], joint="phi_right", mass=1, inertia=0.005),
    wheel("caster", [0.6, 0, 0.05], 0.05),
)


def test_differential_drive() -> None:
    """M, h and B of a cart with two driven wheels, as of Fierro and Lewis (1995)."""
    module = module_of_text(CART)
    assert module.COORDINATES == ("x", "y", "yaw", "phi_left", "phi_right")
    assert module.INPUTS == ("tau_phi_left", "tau_phi_right")
    mass, ahead, inertia, wheel, across, axial = 30.0, 0.3, 15.625, 1.0, 0.0025, 0.005
    half, radius = 0.75, 0.15
    along = mass + 2.0 * wheel + 2.0 * axial / radius**2
    about = inertia + mass * ahead**2
    about += 2.0 * (wheel * half**2 + across + axial * half**2 / radius**2)
    q, v, u = np.array([1.0, -2.0, 0.7, 3.0, 4.0]), np.array([0.6, -0.8]), np.array([0.3, 0.9])
    np.testing.assert_allclose(module.mass_matrix(q), np.diag([along, about]), rtol=1e-12)
    bias = mass * ahead * v[1] * np.array([v[1], -v[0]])
    np.testing.assert_allclose(module.residual(q, v), bias, rtol=1e-12)
    inputs = np.array([[1.0, 1.0], [-half, half]]) / radius
    np.testing.assert_allclose(module.input_matrix(q), inputs, rtol=1e-12)
    rates = [v[0] * np.cos(0.7), v[0] * np.sin(0.7), v[1], *(inputs.T @ v)]
    np.testing.assert_allclose(module.coordinate_rates(q, v), rates, rtol=1e-12, atol=1e-14)
    moved = np.linalg.solve(np.diag([along, about]), bias + inputs @ u)
    np.testing.assert_allclose(module.forward_dynamics(q, v, u), moved, rtol=1e-12)
    wider = module.prepare({"left_radius": 0.3})
    inputs[:, 0] *= 0.5
    np.testing.assert_allclose(module.input_matrix(q, constants=wider), inputs, rtol=1e-12)


HELD = (
    link("arm", "y", [0.1, 0, 0.4], 2.0, [0.1, 0, 0.3], [0.1, 0.1, 0.01])
    + frame("hand", "arm", [0, 0, 0.7])
    + constraint("grip", "point", "hand", xyz=[0.4, 0.2, 1])
)


@pytest.mark.slow
def test_carts_that_hold_something_pass_with_derivatives() -> None:
    robot = parse_robot(CART.replace("two_wheels", "held_cart") + HELD)
    names = (row.name for row in CONSTRAINT_DERIVATIVES)
    module = module_with_derivatives(robot, *names)
    comparisons = compare_module(module, robot, formulations(robot)[0], 3, 0)
    assert any(c.what.startswith("constrained_forward_dynamics.") for c in comparisons)
    assert not [c for c in comparisons if not c.passed]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_energy_of_free_rolling(seed: int) -> None:
    """Over 10 s, without dampers and inputs."""
    robot = rolling_robot(seed)
    links = (replace(x, passive=replace(x.passive, damping=0.0)) for x in robot.links)
    springs = tuple(replace(spring, damping=0.0) for spring in robot.springs)
    name = f"{robot.name}_ideal"
    ideal = replace(robot, name=name, links=tuple(links), springs=springs)
    module = emitted_module(ideal, "coordinate_rates", "forward_dynamics", *ENERGIES)
    states, n = States.random(Tree(robot), 1, seed), len(module.COORDINATES)
    u = np.zeros(len(module.INPUTS))

    def rate(_: float, x: Array) -> Array:
        q, v = x[:n], x[n:]
        return np.concatenate([module.coordinate_rates(q, v), module.forward_dynamics(q, v, u)])

    def energy(x: Array) -> float:
        return float(module.kinetic_energy(x[:n], x[n:]) + module.potential_energy(x[:n]))

    begin = np.concatenate([states.q[0], 0.3 * states.v[0]])
    end = solve_ivp(rate, (0.0, 10.0), begin, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    kinetic = float(module.kinetic_energy(end[:n], end[n:]))
    assert abs(energy(end) - energy(begin)) < 1e-8 * max(1.0, kinetic, abs(energy(begin)))


@cache
def differentiable_sleigh() -> ModuleType:
    """The sleigh with derivatives."""
    names = *CALLED, "forward_dynamics_derivatives"
    return module_with_derivatives(parse_robot(SLEIGH), *names)


def test_linear_models_have_the_way_sideways() -> None:
    module, square = differentiable_sleigh(), 0.5 / 2.0 + 0.3**2
    v, w = 0.7, -1.3
    a, b = linearise(module, np.array([1.0, 2.0, 0.4]), np.array([v, w]), np.zeros(0))
    expected = np.array(
        [
            [0.0, w, 0.0, 1.0, 0.0],  # Ahead, sideways, and about z; then the velocities.
            [-w, 0.0, v, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 0.0, 0.0, 2.0 * 0.3 * w],
            [0.0, 0.0, 0.0, -0.3 * w / square, -0.3 * v / square],
        ]
    )
    np.testing.assert_allclose(a, expected, atol=1e-14)
    assert b.shape == (5, 0)


def test_linear_models_have_the_pull_of_walls_sideways() -> None:
    """A wall that pushes its frame back by 200 N/m of depth, along the wall's normal."""
    yaw, depth, stiffness, mass = 0.4, 0.03, 200.0, 2.0
    normal = np.array([-0.8, 0.6, 0.0])
    wall = {"kind": "plane", "frame": "base", "ball_radius": 0, "damping": 0}
    wall |= {"point": (depth * normal).tolist(), "normal": normal.tolist(), "stiffness": stiffness}
    walled = {"name": "walled", "duration": 1.0, "wall": [wall]}
    at = np.array([0.0, 0.0, yaw]), np.zeros(2), np.zeros(0)
    a, _ = linearise(differentiable_sleigh(), *at, surroundings=walled)
    ahead = normal @ [np.cos(yaw), np.sin(yaw), 0.0]
    left = normal @ [-np.sin(yaw), np.cos(yaw), 0.0]
    pull = stiffness / mass * np.array([-ahead * ahead, -left * ahead, depth * left])
    np.testing.assert_allclose(a[3, :3], pull, atol=1e-12)
    np.testing.assert_allclose(a[4, :3], 0.0, atol=1e-12)


@pytest.mark.slow
def test_no_regulator_brings_a_cart_to_its_side() -> None:
    module = module_with_derivatives(parse_robot(CART), "forward_dynamics_derivatives")
    q, still = np.zeros(5), np.zeros(2)
    with pytest.raises(UsageError, match="no input changes place along the base's y"):
        lqr(module, q, still, still, np.ones(5), np.ones(2))
    regulator = lqr(module, q, np.array([1.0, 0.0]), still, np.ones(5), np.ones(2))
    assert regulator.eigenvalues.real.max() < 0.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('motion = "planar"', 'motion = "upright"', "base.drive: needs a base that rolls; give"),
        ('drive = "differential"\n', "", ""),
        ('"differential"', '"ackermann"', "wheels cannot steer, and wheels that slide"),
        ('= "phi_left"', '= "phi_right"', "'phi_right' is the name of the coordinate of wheel 1"),
        (
            "xyz = [0, 0.75",
            "xyz = [0.1, 0.75",
            "wheel 1: xyz: must be on the axle",
        ),
        (
            "radius = 0.15",
            'axis = "x"\nradius = 0.15',
            "wheel 1: axis: must be on the axle",
        ),
        (
            "radius = 0.15",
            'axis = "z"\nradius = 0.15',
            "wheel 1: axis: must be level",
        ),
        ("radius = 0.15", "radius = 0", "wheel 1: radius: must be above 0"),
        ("radius = 0.05", "radius = 0.06", "wheel 3: xyz: wheels touch level ground at"),
        ("xyz = [0, -0.75", "xyz = [0, 0.5", "wheel 2: xyz: all wheels that turn are"),
        (
            "radius = 0.05",
            "radius = 0.05\neffort = 1",
            "wheel 3: effort: applies to a wheel that",
        ),
        (
            "radius = 0.05",
            'radius = 0.05\non = "left"',
            "all wheels are on the base and do not",
        ),
        ("com =", "rpy_deg = [0, 9, 0]\ncom =", "base.rpy_deg: must be left out, because"),
        ("com =", "xyz = [1, 0, 0.1]\ncom =", ""),
    ],
)
def test_faults_of_wheels(old: str, new: str, message: str) -> None:
    assert old in CART
    text = CART.replace(old, new, 1)
    if not message:
        assert parse_robot(text).kind in ("planar 2", "differential 2")
        return
    with pytest.raises(RobotFileError) as refused:
        parse_robot(text)
    assert message in str(refused.value)


def test_surroundings_that_do_nothing_change_no_rollout_of_driven_wheels() -> None:
    """And environments know the efforts of wheels, which come after those of joints."""
    module = module_of_text(CART.replace("= 0.15\nxyz", "= 0.15\neffort = 4\nxyz"))
    start, torques = (np.arange(5.0), np.array([0.6, -0.8])), np.array([1.0, 3.0])
    alone, still = (
        rollout(module, *start, torques, 20, 0.01, surroundings=scene) for scene in (None, "hold")
    )
    np.testing.assert_array_equal(still.q, alone.q)
    environments = VectorEnv(module, 1, normalised=False)
    np.testing.assert_array_equal(environments.single_action_space.high, [4.0, 4.0])


def test_what_takes_no_wheels_says_so() -> None:
    _, lines = export_robot(parse_robot(CART), "urdf")
    assert "left out: the rolling of wheels and of a base with a drive, without side slip" in lines
    # Nothing drives a sleigh.
    with pytest.raises(UsageError, match="nothing produces the force along x and torque about z"):
        simulate(differentiable_sleigh(), "hold")
