"""Robots with gears against the same robots without, folded by a matrix of ratios in NumPy.

Motors behind gears are compared with rotors that are bodies, by Newton and Euler and by Pinocchio.

Coordinates of all joints are G times those that are left, and offsets: forces fold by Gᵀ, and what
is solved for is what the folded system gives. Nothing of the derivation's own folding is used.
"""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from support.emitted import emitted_module, module_with_derivatives
from support.machines import base, constraint, frame, link, machine, table
from support.pinocchio_oracle import Oracle
from support.random_robots import motored_robot, on_base

from gibbs_codegen.interface import FUNCTIONS, module_signatures
from gibbs_codegen.interface.constraints import CONSTRAINT_DERIVATIVES
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.gear import Gear
from gibbs_codegen.robot.parts.link import Passive
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.verification.verify import QUICK, compare_module, formulations

# Seeds of robots with motors, and how their bases move. The second has a gear of a gear, the third
# has derivatives.
MOTIONS: dict[int, Any] = {87: None, 95: ("x", "z", "pitch"), 116: "fixed"}
# Links on parallel axes that gears keep at one angle to the base: sums of their angles are numbers.
LEVEL = """
name = "level"
[base]
mass = 2
inertia = [0.01, 0.02, 0.03, 0, 0, 0]
"""
for _name, _axis, _gear in (
    ("a", "y", ""),
    ("b", "y", ""),
    ("c", "y", 'gear = {of = ["a", "b"], ratio = [-1, -1], offset = 0.3}'),
    ("d", "x", ""),
    ("e", "y", ""),
    ("f", "y", 'gear = {of = "e", ratio = -1, offset = 1.5707963267948966}'),
    ("g", "y", ""),
):
    LEVEL += f"""
[[link]]
name = "{_name}"
xyz = [0.05, 0.02, 0.2]
axis = "{_axis}"
mass = 1
com = [0.1, 0.05, 0.1]
inertia = [0.01, 0.02, 0.03, 0.001, 0, 0]
{_gear}
"""
# Functions of coordinates that gears leave alone, and what is solved for.
APART = {"coordinate_rates", "integrate", "difference"}
SOLVED = {"forward_dynamics", "forward_dynamics_with_wrenches"}


def based(seed: int) -> Robot:
    """The robot of a seed, on a base that flies or moves in another way; of 0 the level one."""
    if not seed:
        return parse_robot(LEVEL)
    robot, motion = motored_robot(seed), MOTIONS[seed]
    return on_base(robot, motion, seed) if motion else robot


def gears(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """G (all joints, coordinates) and the offsets, by steps along each chain of gears."""
    joints = [i for i, link in enumerate(robot.links, start=1) if link.joint != "fixed"]
    left = [i for i in joints if robot.links[i - 1].gear is None]
    ratios, offsets = np.zeros((len(joints), len(left))), np.zeros(len(joints))

    def by_steps(i: int) -> tuple[np.ndarray, float]:
        gear = robot.links[i - 1].gear
        if gear is None:
            return np.eye(len(left))[left.index(i)], 0.0
        moved = [(ratio, *by_steps(j)) for j, ratio in gear.ratios.items()]
        turns = sum((ratio * row for ratio, row, _ in moved), np.zeros(len(left)))
        return turns, gear.offset + sum(ratio * offset for ratio, _, offset in moved)

    for row, i in enumerate(joints):
        ratios[row], offsets[row] = by_steps(i)
    return ratios, offsets


class Folded:
    """A robot's module without gears, with its values folded."""

    def __init__(self, robot: Robot) -> None:
        links = tuple(replace(link, gear=None) for link in robot.links)
        free = replace(robot, name=f"{robot.name}_free", links=links)
        self.module, layout = emitted_module(free), layout_of(free)
        ratios, offsets = gears(robot)
        self.q = _block(layout.q.size, layout.q.joints.start, ratios)
        self.offsets = np.zeros(layout.q.size)
        self.offsets[layout.q.joints] = offsets
        self.v = _block(layout.v.size, layout.v.joints.start, ratios)
        size = len(self.module.HYBRID_COORDINATES)
        held = layout.constrained.stop if layout.v.joints.start == layout.constrained.start else 0
        self.h = _block(size, held or layout.v.joints.start, ratios)
        inputs = len(self.module.INPUTS)
        self.u = _block(inputs, robot.rotors, np.eye(len(ratios))[:, _own(robot)])

    def states(self, seed: int) -> dict[str, np.ndarray]:
        """Arguments of the robot with gears."""
        rng, module = np.random.default_rng(seed), self.module
        q = rng.normal(size=self.q.shape[1])
        if module.ATTITUDE == "quaternion":
            q[3:7] /= np.linalg.norm(q[3:7])
        v, a = rng.normal(size=(2, self.v.shape[1]))
        u = rng.normal(size=self.u.shape[1])
        return {"q": q, "v": v, "a": a, "u": u, "W": rng.normal(size=(len(module.FRAMES), 6))}

    def whole(self, states: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The same of the robot without."""
        whole = {x: getattr(self, "v" if x == "a" else x) @ states[x] for x in "qvau"}
        return whole | {"q": whole["q"] + self.offsets, "W": states["W"]}

    def __call__(
        self, name: str, shapes: list[str], states: dict[str, np.ndarray]
    ) -> list[np.ndarray]:
        """Folded results of a function, whose shapes are in the letters of the table."""
        (signature,) = (s for s in module_signatures(self.module) if s.name == name)
        whole = self.whole(states)
        values = getattr(self.module, name)(*(whole[x] for x in signature.arguments))
        values = values if isinstance(values, tuple) else (values,)
        return [self.fold(x, shape) for x, shape in zip(values, shapes, strict=True)]

    def fold(self, array: np.ndarray, shape: str) -> np.ndarray:
        """An array with columns of all joints as those of coordinates."""
        for axis, letter in enumerate(shape):
            if letter in "vhu":
                array = np.moveaxis(np.moveaxis(array, axis, -1) @ getattr(self, letter), -1, axis)
        return array


def _own(robot: Robot) -> list[bool]:
    """For each joint that moves whether it has a coordinate."""
    return [link.gear is None for link in robot.links if link.joint != "fixed"]


def _block(size: int, at: int, block: np.ndarray) -> np.ndarray:
    """An identity with a block in place of rows from `at`."""
    rows, columns = block.shape
    matrix = np.zeros((size, size - rows + columns))
    matrix[:at, :at] = np.eye(at)
    matrix[at : at + rows, at : at + columns] = block
    matrix[at + rows :, at + columns :] = np.eye(size - at - rows)
    return matrix


def module_of(seed: int) -> ModuleType:
    """The module of a seed."""
    return module_with_derivatives(based(116)) if seed == 116 else emitted_module(based(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*MOTIONS, 0])
def test_functions_are_those_of_the_robot_without_gears_folded(seed: int) -> None:
    robot = based(seed)
    assert parse_robot(robot_text(robot)) == robot
    folded, module = Folded(robot), module_of(seed)
    states, compared = folded.states(seed), 0
    for signature in module_signatures(module):
        name, row = signature.name, FUNCTIONS[signature.name]
        if name in APART or row.composed or not {*row.arguments} <= {*"qvauW"}:
            continue
        if not hasattr(folded.module, name):  # A derivative.
            continue
        ours = getattr(module, name)(*(states[x] for x in signature.arguments))
        shapes = [output.shape for output in row.outputs]
        if name in SOLVED:
            (matrix,), (right,) = (
                folded("mass_matrix", ["vv"], states),
                folded("residual", ["v"], states),
            )
            right = right + folded("input_matrix", ["vu"], states)[0] @ states["u"]
            if "W" in row.arguments:
                right = right + folded("wrench_forces", ["v"], states)[0]
            theirs = [np.linalg.solve(matrix, right)]
        else:
            theirs = folded(name, shapes, states)
        for one, other in zip(ours if isinstance(ours, tuple) else (ours,), theirs, strict=True):
            size = max(1.0, np.abs(other).max(initial=0.0))
            np.testing.assert_allclose(one, other, atol=1e-12 * size, err_msg=name)
            compared += 1
    assert compared >= 25


@pytest.mark.slow
def test_a_geared_robot_passes_with_derivatives_and_a_wrong_ratio_does_not() -> None:
    robot = based(116)
    module, against = module_of(116), formulations(robot)[0]
    failures = [c for c in compare_module(module, robot, against, 3, 0) if not c.passed]
    assert not failures
    k, link = next((k, x) for k, x in enumerate(robot.links) if x.gear)
    wrong = replace(link, gear=replace(link.gear, ratio=1.001 * link.gear.ratio))
    other = replace(robot, links=(*robot.links[:k], wrong, *robot.links[k + 1 :]))
    comparisons = compare_module(module, other, formulations(other)[0][:1], 3, 0, extent=QUICK)
    assert {c.what for c in comparisons if not c.passed} >= {"mass_matrix", "forward_dynamics"}


GRIPPER = """
name = "gripper"
gravity = 9.81
[base]
motion = "upright"
mass = 1.5
inertia = [0.02, 0.02, 0.04, 0, 0, 0]
[[link]]
name = "arm"
xyz = [0, 0, -0.1]
axis = "x"
mass = 0.3
com = [0, 0, -0.15]
inertia = [0.002, 0.002, 0.0005, 0, 0, 0]
[[link]]
name = "pinion"
xyz = [0.02, 0, -0.3]
axis = "y"
mass = 0.05
com = [0.01, 0, -0.04]
inertia = [5e-4, 5e-4, 1e-4, 0, 0, 0]
armature = 1e-3
stiffness = 0.1
[[link]]
name = "rack"
parent = "arm"
joint = "prismatic"
xyz = [0, 0.02, -0.3]
axis = "x"
mass = 0.1
com = [0.01, 0, 0]
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
gear = { of = "pinion", ratio = 0.05, offset = 0.01 }
[[link]]
name = "finger"
parent = "rack"
xyz = [0, 0, -0.05]
axis = "y"
mass = 0.02
com = [0, 0, -0.03]
inertia = [1e-5, 1e-5, 1e-5, 0, 0, 0]
gear = { of = "pinion", ratio = -1 }
"""


@pytest.mark.slow
def test_free_motion_keeps_its_energy_for_ten_seconds() -> None:
    needed = "coordinate_rates", "forward_dynamics", "positions"
    module = emitted_module(parse_robot(GRIPPER), *needed, "kinetic_energy", "potential_energy")
    n, start = len(module.COORDINATES), np.array([0, 0, 0, 0.3, 0.7, -0.5, *6 * [0.4]])
    idle = np.zeros(len(module.INPUTS))

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:n], x[n:]
        return np.concatenate([module.coordinate_rates(q, v), module.forward_dynamics(q, v, idle)])

    def energy(x: np.ndarray) -> float:
        return float(module.kinetic_energy(x[:n], x[n:]) + module.potential_energy(x[:n]))

    end = solve_ivp(rate, (0, 10), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert energy(end) == pytest.approx(energy(start), abs=1e-8 * abs(energy(start)))
    # Level, with the arm down, the rack is 0.05·0.8 + 0.01 along x from where its joint is.
    points = dict(zip(module.POINTS, module.positions([0, 0, 1, 0, 0, 0.8]), strict=True))
    np.testing.assert_allclose(points["joint_rack"], [0.05, 0.02, 0.6], atol=1e-15)


def mimicking(robot: Robot) -> tuple[pin.Model, dict[str, tuple[str, float, float]]]:
    """Pinocchio's model of a robot in which the first of all joints on a coordinate moves others.

    Rotors of motors are such joints. With it for each coordinate come the name of that joint, and
    the ratio and offset by which it follows the coordinate.
    """
    model = Oracle(robot.ungeared, rigid_base=True).model
    turns: dict[str, tuple[str, float, float]] = {}
    for i, gear in robot.gearing.items():
        ((mover, ratio),) = gear.ratios.items()
        of = coordinate_of(robot, mover)
        turns[coordinate_of(robot.ungeared, i)] = of, ratio, gear.offset
        if motor := robot.links[i - 1].motor:
            turns[f"rotor of {i}"] = of, ratio * motor.gear_ratio, 0.0
    leads = {name: (name, 1.0, 0.0) for name in layout_of(robot).v.names if name not in turns}
    for name in filter(turns.__contains__, [*model.names]):
        of, ratio, offset = turns[name]
        lead, first, start = leads.setdefault(of, (name, ratio, offset))
        if lead != name:
            share = ratio / first
            joints = model.getJointId(lead), model.getJointId(name)
            model = pin.transformJointIntoMimic(model, *joints, share, offset - share * start)
    return model, leads


@pytest.mark.slow
@pytest.mark.parametrize("seed", [95, 97])  # The second has a link that is held.
def test_masses_and_forces_are_those_of_mimic_joints_of_pinocchio(seed: int) -> None:
    robot = motored_robot(seed, "tait_bryan")
    links = tuple(replace(link, passive=Passive()) for link in robot.links)
    robot = replace(robot, name=f"{robot.name}_bare", links=links, springs=())
    module = emitted_module(robot, "mass_matrix", "inverse_dynamics")
    model, leads = mimicking(robot)
    names, scales, shifts = zip(*(leads[name] for name in module.VELOCITIES), strict=True)
    order = [model.joints[model.getJointId(name)].idx_v for name in names]
    data, rng = model.createData(), np.random.default_rng(seed)
    for q, v, a in rng.normal(size=(3, 3, model.nv)):
        theirs = np.zeros((3, model.nv))
        theirs[:, order] = np.stack([q, v, a]) * scales
        theirs[0, order] += shifts
        still = np.zeros(model.nv)
        force, rest = (pin.rnea(model, data, theirs[0], *x) for x in (theirs[1:], (still, still)))
        # Column by column: crba of Pinocchio 4.1 differs from its own rnea for some of these.
        units = (pin.rnea(model, data, theirs[0], still, unit) for unit in np.eye(model.nv))
        matrix = np.stack([column - rest for column in units], axis=-1)
        wanted = matrix[np.ix_(order, order)] * np.outer(scales, scales), force[order] * scales
        ours = module.mass_matrix(q), module.inverse_dynamics(q, v, a)
        for one, other in zip(ours, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


FLEXIBLE = machine(
    "flexible",
    base(1, [0.001, 0.001, 0.001], motion="fixed"),
    table(
        "[[link]]",
        name="shaft",
        axis="y",
        xyz=[0, 0, 0],
        mass=0,
        motor={"rotor_inertia": 2e-05, "gear_ratio": -100},
    ),
    link("arm", "y", [0, 0, 0], 0.8, [0, 0, -0.4], [0.02, 0.02, 0.001], stiffness=50),
    gravity=9.81,
)


@pytest.mark.slow
def test_an_arm_on_a_flexible_joint_has_two_frequencies() -> None:
    """(k − B ω²)(k + m g l − I ω²) = k², with the motor's B = N² J, about the arm that hangs."""
    module = module_with_derivatives(parse_robot(FLEXIBLE), "inverse_dynamics_derivatives")
    still = np.zeros(2)
    _, stiffness, *_ = module.inverse_dynamics_derivatives(still, still, still)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(module.mass_matrix(still), stiffness)))
    motor, arm, spring, weight = 0.2, 0.02 + 0.8 * 0.4**2, 50.0, 0.8 * 9.81 * 0.4
    middle = (motor * (spring + weight) + arm * spring) / (2 * motor * arm)
    spread = np.sqrt(middle**2 - spring * weight / (motor * arm))
    np.testing.assert_allclose(squares, [middle - spread, middle + spread], rtol=1e-12)


MOTORED = """
name = "motored"
gravity = 9.81
[base]
attitude = "quaternion"
mass = 1.5
inertia = [0.02, 0.03, 0.04, 0.001, 0, 0]
[[link]]
name = "shoulder"
xyz = [0.1, 0, -0.1]
axis = [0.6, 0, 0.8]
mass = 0.4
com = [0, 0.02, -0.1]
inertia = [0.003, 0.004, 0.002, 0, 0, 1e-4]
{shoulder}
[[link]]
name = "elbow"
xyz = [0, 0.05, -0.2]
rpy_deg = [20, 0, 70]
axis = "x"
mass = 0.3
com = [0, 0, -0.1]
inertia = [0.002, 0.002, 0.001, 0, 0, 0]
{elbow}
"""


def test_a_rotor_behind_a_gear_is_a_link_that_a_gear_moves() -> None:
    """By hand: a rotor of 50 g on the shoulder, whose inertia about its axis is the motor's."""
    keys = "motor = { rotor_inertia = 3e-5, gear_ratio = 40 }"
    motored = parse_robot(MOTORED.format(shoulder="", elbow=keys))
    rotor = RigidBody(0.0, 0.05, (0.0, 0.0, 0.0), (3e-5, 2e-5, 2e-5, 0.0, 0.0, 0.0))
    seat = motored.links[1]
    spinning = replace(
        seat, body=rotor, motor=None, parent=1, name="rotor", gear=Gear(of=2, ratio=40.0)
    )
    # What is left of the shoulder without the rotor, about its own centre of mass.
    whole = motored.links[0].body
    x, y, z = (np.array([a, b]) for a, b in zip(whole.com, seat.pose.xyz, strict=True))
    masses = np.array([0.4, -0.05])
    com = np.array([x, y, z]) @ masses / 0.35
    turn = Rotation.from_euler("xyz", [20, 0, 70], degrees=True).as_matrix()
    inertia = -turn @ np.diag(rotor.inertia[:3]) @ turn.T
    xx, yy, zz, xy, xz, yz = whole.inertia
    inertia += [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    for mass, place in zip(masses, np.array([x, y, z]).T, strict=True):
        arm = place - com
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    entries = (inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    rest = replace(motored.links[0], body=RigidBody(0.0, 0.35, (*com,), (*entries,)))
    links = rest, replace(seat, motor=None), spinning
    rng = np.random.default_rng(0)
    q, (v, a, u) = rng.normal(size=9), rng.normal(size=(3, 8))
    q[3:7] /= np.linalg.norm(q[3:7])
    given = {
        "mass_matrix": (q,),
        "inverse_dynamics": (q, v, a),
        "forward_dynamics": (q, v, u[:2]),
        "kinetic_energy": (q, v),
        "potential_energy": (q,),
        "centroidal_momentum": (q, v),
        "joint_wrenches": (q, v, a, u[:2]),
    }
    explicit = emitted_module(replace(motored, name="explicit", links=links), *given)
    module = emitted_module(motored, *given)
    for name, arguments in given.items():
        one, other = (getattr(x, name)(*arguments) for x in (module, explicit))
        if name == "joint_wrenches":
            other = other[:2]
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


HELD = (
    frame("tip", "finger", [0, 0, -0.06])
    + constraint("grip", "point", "tip", xyz=[0, 0, 1], frequency=5)
    + constraint("rail", "plane", "tip", to="base", xyz=[0, 0, -0.3])
)


@pytest.mark.slow
def test_constraints_stand_beside_gears() -> None:
    """By dense matrices of the formulations, with derivatives; of four rows one is redundant."""
    robot = parse_robot(GRIPPER + HELD)
    names = (row.name for row in CONSTRAINT_DERIVATIVES)
    module, against = module_with_derivatives(robot, *names), formulations(robot)[0]
    comparisons = [*compare_module(module, robot, against, 3, 0)]
    assert not [c for c in comparisons if not c.passed]
    assert {c.what for c in comparisons} >= {"constraint_projection", "operational_inertia"}
