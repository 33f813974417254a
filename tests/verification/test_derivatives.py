"""Derivatives are verified: what is right passes, and what is wrong in any of them does not."""

from __future__ import annotations

import functools
from dataclasses import replace

import pytest
from support.derived import derived
from support.emitted import NUMPY
from support.planted_faults import planted

from gibbs_codegen.errors import WrongModuleError
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.link import Passive
from gibbs_codegen.targets.registry import render_module
from gibbs_codegen.verification.verify import refuse_wrong

QUICKLY = ("inverse_dynamics_derivatives", "forward_dynamics_vjp", "coriolis_matrix")


def vehicle(attitude: str) -> Robot:
    """A robot with two links, and its base with angles or with a quaternion."""
    robot = read_robot("quadrotor_2link")[0]
    if attitude == "quaternion":
        robot = replace(robot, base=replace(robot.base, attitude=attitude))
    return robot


@functools.cache
def source(attitude: str, derivatives: tuple[str, ...] | str) -> str:
    """The NumPy text of the robot's module."""
    model = derived(vehicle(attitude), derivatives=derivatives)
    return render_module(model, "", NUMPY)["numpy_module.py"]


def refused(attitude: str, text: str) -> bool:
    """Whether the quick check finds that a module is wrong."""
    try:
        refuse_wrong(vehicle(attitude), text)
    except WrongModuleError:
        return True
    return False


@pytest.mark.slow
def test_what_is_right_passes() -> None:
    refuse_wrong(vehicle("xyz"), source("xyz", QUICKLY))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("attitude", "derivatives", "faults", "least"),
    [("xyz", QUICKLY, 4, 4)],
)
def test_faults_planted_in_derivatives_are_found(
    attitude: str, derivatives: tuple[str, ...] | str, faults: int, least: int
) -> None:
    """So many times one sign or one index altered, by the quick check of `generate` alone."""
    text = source(attitude, derivatives)
    # Derivatives come after all other functions.
    start = text.index("\ndef inverse_dynamics_derivatives(")
    missed = [
        what
        for altered, what in planted(text[start:], faults, seed=3)
        if not refused(attitude, text[:start] + altered)
    ]
    assert len(missed) <= faults - least, missed


@pytest.mark.slow
def test_other_faults_are_found() -> None:
    """A transposed matrix, and a pattern that lacks an entry."""
    text = source("xyz", QUICKLY)
    right = "shaped(entries[8:72], (8, 8), batch)"
    assert text.count(right) == 1
    assert refused("xyz", text.replace(right, f"np.swapaxes({right}, -1, -2)"))
    lacking = 'PATTERNS["force_dq"] = tuple(x[1:] for x in PATTERNS["force_dq"])'
    assert refused("xyz", f"{text}\n{lacking}\n")


@pytest.mark.slow
def test_steps_of_a_robot_with_stiff_dampers_pass() -> None:
    """Velocities of its links die out much faster than any change in random states."""
    robot = vehicle("xyz")
    links = tuple(replace(link, passive=Passive(damping=1e5)) for link in robot.links)
    stiff = replace(robot, links=links)
    model = derived(stiff, derivatives=["step_rk4", "step_rk4_derivatives"])
    refuse_wrong(stiff, render_module(model, "", NUMPY)["numpy_module.py"])
