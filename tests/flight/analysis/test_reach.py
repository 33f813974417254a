"""Reachable wrenches are all that thrusts within their limits produce, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import product
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.optimize import linprog
from support.command import run
from support.emitted import emitted_module

from gibbs_codegen import ReachableWrenches, UsageError, parse_robot, reachable_wrenches, trim

Load = Callable[[str], ModuleType]

POSTURES = {
    "quadrotor": {},
    "hextilt_flying_arm_5": {},
    "hydrus": {"joint1": 1.0, "joint2": 1.2, "joint3": 0.9},
    "dual_arm": {"left_shoulder": 0.7, "left_upper_arm": 0.5},
}


@pytest.fixture(scope="module")
def reach(shipped: Load) -> Callable[[str], ReachableWrenches]:
    return lambda name: reachable_wrenches(shipped(name), POSTURES[name])


@pytest.mark.parametrize("name", ["quadrotor"])
def test_thrusts_within_the_limits_stay_inside(reach, name: str) -> None:
    found = reach(name)
    rng = np.random.default_rng(0)
    for _ in range(100):
        wrench = found.columns @ rng.uniform(*found.limits)
        assert found.wrenches.contains(wrench)
        assert not found.wrenches.contains(found.hover + 50.0 * (wrench - found.hover))


@pytest.mark.parametrize("name", ["quadrotor"])
def test_vertices_are_attained_by_thrusts_at_their_limits(reach, name: str) -> None:
    found = reach(name)
    corners = np.array([found.columns @ corner for corner in product(*found.limits.T)])
    for vertex in found.wrenches.vertices:
        assert np.abs(corners - vertex).max(axis=1).min() < 1e-9
    reached = corners @ found.wrenches.normals.T
    assert reached.max(axis=0) == pytest.approx(found.wrenches.offsets, abs=1e-7)


@pytest.mark.parametrize("name", ["quadrotor"])
def test_margins_are_how_far_one_component_reaches(reach, name: str) -> None:
    """Against linear programs over the thrusts themselves."""
    found = reach(name)
    for place, sign in product(range(6), (0, 1)):
        direction = (2.0 * sign - 1.0) * np.eye(6)[place]
        best = linprog(
            np.append(np.zeros(len(found.thrusts)), -1.0),
            A_eq=np.column_stack([found.columns, -direction]),
            b_eq=found.hover,
            bounds=[*found.limits.T, (0.0, None)],
        )
        assert found.margins[place, sign] == pytest.approx(best.x[-1], abs=1e-6)


@pytest.mark.parametrize(
    "name",
    [
        "quadrotor",
        pytest.param("hextilt_flying_arm_5", marks=pytest.mark.slow),
        pytest.param("hydrus", marks=pytest.mark.slow),
        pytest.param("dual_arm", marks=pytest.mark.slow),
    ],
)
def test_slices_hold_the_rest_as_it_is_at_hover(reach, name: str) -> None:
    found = reach(name)
    for shape, part in ((found.forces, slice(0, 3)), (found.torques, slice(3, 6))):
        assert shape.contains(found.hover[part])
        for vertex in shape.vertices:
            wrench = found.hover.copy()
            wrench[part] = vertex
            assert found.wrenches.contains(wrench, 1e-6)
        for axis, (down, up) in zip(np.eye(3), found.margins[part], strict=True):
            for step in (-down * axis, up * axis):
                assert shape.contains(found.hover[part] + step, 1e-6)
                if np.any(step):
                    assert not shape.contains(found.hover[part] + 1.01 * step)


@pytest.mark.parametrize(
    "name",
    [name if name == "hydrus" else pytest.param(name, marks=pytest.mark.slow) for name in POSTURES],
)
def test_hovering_needs_no_torque_about_the_centre_of_mass(reach, shipped: Load, name: str) -> None:
    found = reach(name)
    assert found.hover[3:] == pytest.approx(0.0, abs=1e-9)
    assert found.about == "the centre of mass"
    assert np.array_equal(
        found.thrusts, trim(shipped(name), POSTURES[name]).u[: len(found.thrusts)]
    )


@pytest.mark.slow
def test_wrenches_about_a_frame_are_those_on_it(shipped: Load) -> None:
    """What thrusts exert about a frame holds what the frame's weightless load would exert."""
    module, posture = shipped("dual_arm"), POSTURES["dual_arm"]
    degrees = {name: np.rad2deg(angle) for name, angle in posture.items()}
    found = reachable_wrenches(module, posture_deg=degrees, frame="left_hand")
    hover = trim(module, posture)
    frame = module.frame_poses(hover.q)[module.FRAMES.index("left_hand")]
    away = module.centre_of_mass(hover.q) - frame[:3, 3]
    force = np.array([0.0, 0.0, found.hover[2]])
    assert found.hover[3:] == pytest.approx(np.cross(away, force), abs=1e-9)


def test_limits_can_be_given_and_are_needed(shipped: Load) -> None:
    module = shipped("hexarotor_3link")
    with pytest.raises(UsageError, match="some rotor has no limits of thrust"):
        reachable_wrenches(module)
    found = reachable_wrenches(module, limits=(-300.0, 300.0))
    assert np.all(found.margins > 0.0)
    with pytest.raises(UsageError, match="no frame hand; its frames: base, tip"):
        reachable_wrenches(module, limits=(-300.0, 300.0), frame="hand")
    weak = ReachableWrenches("weak", "it", found.columns, found.limits / 20.0, found.thrusts)
    assert weak.margins is None
    assert str(weak) == "weak: no thrusts within the limits hover"
    with pytest.raises(UsageError, match="weak: no thrusts within the limits hover"):
        _ = weak.torques
    slider = "name = 'slider'\nbase = { motion = 'fixed' }\n[[link]]\njoint = 'prismatic'\n"
    slider += "axis = 'x'\nxyz = [0, 0, 0]\nmass = 1\n"
    with pytest.raises(UsageError, match="slider has no rotors, so it reaches no wrenches; add"):
        reachable_wrenches(emitted_module(parse_robot(slider)))


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_margins_grow_with_the_limits(reach, size: float) -> None:
    found = reach("dual_arm")
    scaled = size * found.limits, size * found.thrusts
    other = ReachableWrenches(found.robot, found.about, found.columns, *scaled)
    assert other.margins / size == pytest.approx(found.margins, rel=1e-6, abs=1e-6)


@pytest.mark.slow
def test_info_tells_the_same_margins(reach, tmp_path: Path) -> None:
    found = reach("quadrotor")
    told = json.loads(run("info", "quadrotor", "--json", cwd=tmp_path).stdout)
    margins = told["machine"]["wrench_margins"]
    assert [*margins][:3] == ["force along x", "force along y", "force along z"]
    assert np.array([*margins.values()]) == pytest.approx(found.margins, abs=1e-9)
    lines = run("info", "quadrotor", cwd=tmp_path).stdout
    assert str(found).splitlines()[1:] == [
        "wrench margins at hover, each by itself, about the centre of mass, in the base's axes:",
        "  force: x 0 … 0, y 0 … 0, z -14.7 … 19.3 N",
        "  torque: x -2.34 … 2.34, y -2.34 … 2.34, z -0.235 … 0.235 N m",
    ]
    assert " ".join(" ".join(str(found).splitlines()[1:]).split()) in " ".join(lines.split())
    assert "wrench margins" not in run("info", "hexarotor", cwd=tmp_path).stdout
