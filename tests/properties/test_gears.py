"""Robots with gears against the same robots without, folded by a matrix of ratios in NumPy.

Coordinates of all joints are G times those that are left, and offsets: forces fold by Gᵀ, and what
is solved for is what the folded system gives. Nothing of the derivation's own folding is used.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.emitted import emitted_module, module_with_derivatives
from support.random_robots import geared_robot, on_base

from gibbs_codegen.interface import FUNCTIONS, module_signatures
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.verification.verify import QUICK, compare_module, formulations

MOTIONS = (None, None, "fixed", "planar", "upright", ("x", "z", "pitch"))
# Functions of coordinates that gears leave alone, and what is solved for.
APART = {"coordinate_rates", "integrate", "difference"}
SOLVED = {"forward_dynamics", "forward_dynamics_with_wrenches"}


def based(seed: int) -> Robot:
    """The geared robot of a seed on a base that flies or moves in one of the other ways."""
    robot, motion = geared_robot(seed), MOTIONS[seed % len(MOTIONS)]
    return on_base(robot, motion, seed) if motion else robot


def gears(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """G (all joints, coordinates) and the offsets, by steps along each chain of gears."""
    joints = [i for i, link in enumerate(robot.links, start=1) if link.joint != "fixed"]
    left = [i for i in joints if robot.links[i - 1].gear is None]
    ratios, offsets = np.zeros((len(joints), len(left))), np.zeros(len(joints))
    for row, i in enumerate(joints):
        ratio, offset = 1.0, 0.0
        while (gear := robot.links[i - 1].gear) is not None:
            offset += ratio * gear.offset
            ratio *= gear.ratio
            i = gear.of
        ratios[row, left.index(i)], offsets[row] = ratio, offset
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6, 12))
def test_functions_are_those_of_the_robot_without_gears_folded(seed: int) -> None:
    robot = based(seed)
    assert parse_robot(robot_text(robot)) == robot
    folded, module = Folded(robot), emitted_module(robot)
    states, compared = folded.states(seed), 0
    for signature in module_signatures(module):
        name, row = signature.name, FUNCTIONS[signature.name]
        if name in APART or row.composed or not {*row.arguments} <= {*"qvauW"}:
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
@pytest.mark.parametrize("seed", [1, 8])
def test_geared_robots_pass_with_derivatives_and_wrong_ratios_do_not(seed: int) -> None:
    robot = based(seed)
    module, against = module_with_derivatives(robot), formulations(robot)[0]
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
    module = emitted_module(parse_robot(GRIPPER))
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
