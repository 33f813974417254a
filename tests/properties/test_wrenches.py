"""Wrenches: on frames as an argument of two axes, and through joints as a result.

That they are Pinocchio's, on every robot that is compared with it, is in `support.comparison`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.comparison import compare, states
from support.compiled import emit
from support.emitted import emitted_module
from support.random_robots import random_tree
from support.tools import tool
from support.tree_cases import QUICK_TREES

from gibbs_codegen.runtime.load import load


@pytest.mark.slow
def test_compiled_functions_of_trees_are_those_of_pinocchio(tmp_path: Path) -> None:
    robot = random_tree(*QUICK_TREES[1])
    compare(robot, load(emit(robot, tmp_path / "tree").folder, "c"))


@pytest.mark.slow
def test_what_a_joint_passes_on_along_its_axis_is_what_drives_it() -> None:
    """Input less damper, spring and armature; nothing of this is an argument of the equation."""
    robot = random_tree(9, "quaternion")
    module = emitted_module(robot, "forward_dynamics", "joint_wrenches")
    q, v, _, u = states(robot, module, 4)
    a = module.forward_dynamics(q, v, u)
    wrenches = module.joint_wrenches(q, v, a, u)
    places = [*range(len(module.VELOCITIES))][6:]
    rods = len(module.BODIES) - len(robot.links)
    for place, i in zip(places, robot.moving, strict=True):
        link = robot.links[i - 1]
        axis = np.array(link.axis) / np.linalg.norm(link.axis)
        part = slice(0, 3) if link.joint == "prismatic" else slice(3, 6)
        along = wrenches[:, rods + i - 1, part] @ axis
        acts = link.passive
        spring = acts.stiffness * (q[:, place + 1] - acts.rest)
        driven = u[:, robot.rotors + place - 6] - acts.damping * v[:, place] - spring
        np.testing.assert_allclose(along, driven - acts.armature * a[:, place], atol=1e-9)


def test_wrenches_on_frames_come_as_rows_and_in_any_batch(shipped, fast) -> None:
    tool("cc")
    rng = np.random.default_rng(2)
    for module in (shipped("quadrotor_2link"), fast("quadrotor_2link")):
        q, wrenches = rng.normal(size=(5, 1, 8)), rng.normal(size=(3, len(module.FRAMES), 6))
        forces = module.wrench_forces(q, wrenches)
        assert forces.shape == (5, 3, 8)
        jacobians = module.frame_jacobians(q)
        expected = np.einsum("sbfij,bfi->sbj", jacobians, wrenches)
        np.testing.assert_allclose(forces, expected, atol=1e-12)
        one = module.wrench_forces(q[0, 0], wrenches[0])
        np.testing.assert_allclose(one, expected[0, 0], atol=1e-12)
        from_list = module.wrench_forces(q[0, 0].tolist(), wrenches[0].tolist())
        np.testing.assert_array_equal(from_list, one)
        with pytest.raises(ValueError, match=r"W must have 2 rows of 6 entries along its last two"):
            module.wrench_forces(q[0, 0], wrenches[0].ravel())
        with pytest.raises(ValueError, match=r"not shape \(6,\)"):
            module.wrench_forces(q[0, 0], wrenches[0, 0])


def test_what_is_not_finite_is_told_by_the_frame(shipped) -> None:
    module = shipped("quadrotor_2link")
    wrenches = np.zeros((2, 6))
    wrenches[module.FRAMES.index("tip"), 1] = 1e308
    with pytest.warns(RuntimeWarning, match=r"largest there: W of tip, 1.7e\+308"):
        module.wrench_forces(np.full(8, 0.7), 1.7 * wrenches)
