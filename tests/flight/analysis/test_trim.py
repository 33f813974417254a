"""Trims are balanced, keep limits as was asked, and where there is none it is told why."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from gibbs_codegen import Trim, UsageError, generate, linearise, load, simulate, trim
from gibbs_codegen.flight.plant.vehicle import Vehicle

Load = Callable[[str], ModuleType]

BENT = {"joint1": 1.0, "joint2": 1.2, "joint3": 0.9}
HANGING = {"theta_5": 0.0, "theta_6": -np.pi / 2}
ROBOTS = {
    "hexarotor_3link": {"theta_8": -1.2, "theta_9": 0.5},
    "hextilt_flying_arm_5": {},
    "hydrus": BENT,
    "quadrotor_2link": HANGING,
    "dual_arm": {"left_shoulder": 0.7, "right_forearm": 1.1},
}
GRAVITY = 9.81


def is_balanced(module: ModuleType, found: Trim, wrenches: object = None) -> bool:
    acting = np.zeros((len(module.FRAMES), 6)) if wrenches is None else wrenches
    moves = module.forward_dynamics_with_wrenches(found.q, found.v, found.u, acting)
    return bool(np.abs(moves - found.a).max() <= 1e-9 * GRAVITY)


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_hover_as_they_are_asked_to(shipped: Load, name: str) -> None:
    module = shipped(name)
    found = trim(module, ROBOTS[name])
    assert is_balanced(module, found)
    assert not np.any(found.v)
    assert not np.any(found.a)
    for joint, value in ROBOTS[name].items():
        assert found.q[module.COORDINATES.index(joint)] == value
    assert found.turned == pytest.approx(0.0, abs=1e-9)
    assert found.residual < 1e-12 * GRAVITY * 10


def test_angles_in_degrees_are_those_of_scenario_files(shipped: Load) -> None:
    module = shipped("dual_arm")
    found = trim(module, {"left_forearm": 0.5}, posture_deg={"left_shoulder": 40})
    wanted = trim(module, {"left_forearm": 0.5, "left_shoulder": np.deg2rad(40)})
    assert np.array_equal(found.q, wanted.q)
    with pytest.raises(UsageError, match="posture_deg: left_shoulder is in posture too"):
        trim(module, {"left_shoulder": 0.7}, posture_deg={"left_shoulder": 40})


@pytest.mark.parametrize("name", ["quadrotor_2link", "dual_arm", "hextilt_flying_arm_5"])
def test_level_flight_takes_the_inputs_of_hovering(shipped: Load, name: str) -> None:
    """There is no drag."""
    module = shipped(name)
    hovering = trim(module, ROBOTS[name])
    turned = module.integrate(hovering.q, 0.7 * (np.array(module.VELOCITIES) == "wz"))
    flying = trim(module, ROBOTS[name], q=turned, velocity=(3.0, -2.0, 1.0))
    assert is_balanced(module, flying)
    assert flying.u == pytest.approx(hovering.u, abs=1e-9)
    rates = module.frame_velocities(flying.q, flying.v)[module.FRAMES.index("base")]
    assert rates == pytest.approx([3.0, -2.0, 1.0, 0, 0, 0], abs=1e-12)


def test_an_underactuated_base_tilts_against_what_pushes_it(shipped: Load) -> None:
    module = shipped("dual_arm")
    push = np.array([1.2, -0.9, 2.0, 0.02, 0.03, -0.05])
    found = trim(module, ROBOTS["dual_arm"], wrenches={"left_hand": push})
    acting = np.zeros((len(module.FRAMES), 6))
    acting[module.FRAMES.index("left_hand")] = push
    assert is_balanced(module, found, acting)
    up = module.frame_poses(found.q)[0, :3, 2]
    weight = 6.08 * GRAVITY
    wanted = np.array([-1.2, 0.9, weight - 2.0])
    assert up == pytest.approx(wanted / np.linalg.norm(wanted), abs=1e-9)
    assert found.turned == pytest.approx(np.arctan2(1.5, weight - 2.0), abs=1e-8)


def test_a_tilt_accelerates(shipped: Load) -> None:
    module = shipped("quadrotor")
    found = trim(module, acceleration=(0.0, 2.0, 1.0), velocity=(1.0, 0.0, 0.0))
    assert is_balanced(module, found)
    assert found.turned == pytest.approx(np.arctan2(2.0, GRAVITY + 1.0), abs=1e-9)
    up = module.frame_poses(found.q)[0, :3, 2]
    assert np.sum(found.u) * up == pytest.approx(1.5 * np.array([0, 2, GRAVITY + 1]), abs=1e-9)


@pytest.mark.parametrize("name", ["quadrotor", "dual_arm"])
def test_a_base_leans_into_a_circle(shipped: Load, name: str) -> None:
    """By tan φ = r ω²/g, r of the centre of mass; in steps of time it goes round."""
    robot, speed, turning = shipped(name), 3.0, 0.7
    found = trim(robot, ROBOTS.get(name), velocity=[speed, 0, 0], turning=turning)
    assert found.residual < 1e-9
    radius = speed / turning - robot.centre_of_mass(found.q)[1]
    up = robot.frame_poses(found.q)[0, :3, 2]
    assert up[1] / up[2] == pytest.approx(radius * turning**2 / GRAVITY, rel=1e-8)
    q, v, h = found.q, found.v, 1e-3
    for _ in range(500):
        middle = v + 0.5 * h * robot.forward_dynamics(q, v, found.u)
        q, v = (
            robot.integrate(q, h * middle),
            v + h * robot.forward_dynamics(robot.integrate(q, 0.5 * h * v), middle, found.u),
        )
    moved = robot.frame_poses(q)[0, :2, 3] - robot.frame_poses(found.q)[0, :2, 3]
    angle = turning * 500 * h
    round_about = speed / turning * np.array([np.sin(angle), 1.0 - np.cos(angle)])
    np.testing.assert_allclose(moved, round_about, atol=1e-4)


def test_a_fully_actuated_base_stays_level_under_a_push(shipped: Load) -> None:
    module = shipped("hextilt_flying_arm_5")
    push = [1.0, 0.5, 0.0, 0.05, 0.0, 0.0]
    acting = np.zeros((len(module.FRAMES), 6))
    acting[module.FRAMES.index("tip")] = push
    found = trim(module, wrenches={"tip": push}, limits=(-50.0, 50.0))
    assert is_balanced(module, found, acting)
    assert found.turned == 0.0
    assert found.missing == ()
    assert found.null_space.shape == (6, 0)


def test_joints_that_are_free_find_the_balance(shipped: Load) -> None:
    module = shipped("quadrotor_2link")
    aside = {"theta_5": 0.4, "theta_6": 0.3}
    with pytest.raises(UsageError, match=r"they leave torque about x .* N m \(in the base's axes"):
        trim(module, aside, free=())
    found = trim(module, aside, free=["theta_5"])
    assert is_balanced(module, found)
    assert found.q[module.COORDINATES.index("theta_6")] == 0.3
    assert found.q[module.COORDINATES.index("theta_5")] != 0.4
    assert str(found).startswith("quadrotor_2link: balanced; varied: theta_5\n")


@pytest.mark.parametrize("name", ["quadrotor_2link", "dual_arm", "hydrus"])
def test_the_null_space_is_what_no_thrusts_produce(shipped: Load, name: str) -> None:
    module = shipped(name)
    found = trim(module, ROBOTS[name])
    columns = Vehicle(module).thrust_wrenches(found.q)
    assert found.null_space.shape == (6, 6 - np.linalg.matrix_rank(columns))
    assert found.null_space.T @ columns == pytest.approx(0.0, abs=1e-12)
    named = {"quadrotor_2link": ("force along y", "torque about x")}
    assert found.missing == named.get(name, ("force along x", "force along y"))
    assert all(f"\n  {direction}" in str(found) for direction in found.missing)


def test_margins_are_distances_to_the_limits_of_the_robot_file(shipped: Load) -> None:
    found = trim(shipped("dual_arm"))
    thrusts = found.u[:8]
    assert np.array_equal(found.margins[:8], np.minimum(thrusts, 16.0 - thrusts))
    efforts = np.array([8.0, 8, 5, 8, 8, 5])
    assert np.array_equal(found.margins[8:], efforts - np.abs(found.u[8:]))
    assert "7.441 N   " in str(found)
    assert "8 N m from a limit" in str(found)
    unlimited = trim(shipped("quadrotor_2link"), HANGING)
    assert np.all(np.isposinf(unlimited.margins))
    assert "from a limit" not in str(unlimited)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_redundant_thrusts_are_the_least_or_the_safest(shipped: Load, seed: int) -> None:
    """Against general solvers, over limits that differ from rotor to rotor."""
    module = shipped("dual_arm")
    rng = np.random.default_rng(seed)
    low = rng.uniform(0.0, 5.0, 8)
    limits = np.array([low, low + rng.uniform(3.0, 12.0, 8)])
    columns = Vehicle(module).thrust_wrenches()
    needed = columns @ trim(module).u[:8]
    best = linprog(
        np.append(np.zeros(8), -1.0),
        A_ub=np.block([[-np.eye(8), np.ones((8, 1))], [np.eye(8), np.ones((8, 1))]]),
        b_ub=np.concatenate([-limits[0], limits[1]]),
        A_eq=np.column_stack([columns, np.zeros(6)]),
        b_eq=needed,
        bounds=(None, None),
    )
    if best.x[-1] < 0.0:
        with pytest.raises(UsageError, match=f"no inputs within .* {-best.x[-1]:.3g} N "):
            trim(module, limits=limits)
        return
    safest = trim(module, limits=limits, aim="widest_margin")
    assert safest.margins[:8].min() == pytest.approx(best.x[-1], abs=1e-7)
    least = trim(module, limits=limits)
    assert least.margins[:8].min() >= -1e-9
    assert is_balanced(module, least)
    assert is_balanced(module, safest)
    other = minimize(
        lambda f: f @ f,
        safest.u[:8],
        jac=lambda f: 2.0 * f,
        method="SLSQP",
        bounds=limits.T,
        constraints={"type": "eq", "fun": lambda f: (columns @ f - needed)[2:]},
        options={"ftol": 1e-12, "maxiter": 300},
    )
    assert least.u[:8] @ least.u[:8] <= other.fun * (1.0 + 1e-8)


def test_of_equally_safe_thrusts_the_least_are_taken(shipped: Load) -> None:
    module = shipped("dual_arm")
    limits = np.tile([[0.0], [16.0]], 8)
    limits[:, 0] = 7.0, 8.0
    found = trim(module, limits=limits, aim="widest_margin")
    assert found.margins[0] == pytest.approx(0.5, abs=1e-7)
    others = trim(module, limits=np.column_stack([(7.5, 7.5), limits[:, 1:]]))
    assert found.u == pytest.approx(others.u, abs=1e-6)


@pytest.mark.slow
def test_idle_thrusts_of_rotors_on_links_load_joints(tmp_path: Path) -> None:
    """Thrusts that produce no wrench together bend the boom that carries two of them."""
    body = "mass = 1\ninertia = [0.1, 0.1, 0.1, 0, 0, 0]\n"
    text = (
        f'name = "boom"\n[base]\n{body}[[link]]\nname = "boom"\naxis = "y"\nxyz = [0, 0, 0]\n{body}'
    )
    places = [(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, 0.2), (0.3, -0.2)]
    greatest = (7.0, 6.5, 9.0, 9.0, 3.0, 2.6)
    for k, ((x, y), most) in enumerate(zip(places, greatest, strict=True)):
        on = "base" if k < 4 else "boom"
        text += f'[[rotor]]\non = "{on}"\nposition = [{x}, {y}, 0]\nlimits = [0, {most}]\n'
    (tmp_path / "boom.toml").write_text(text)
    module = load(generate(tmp_path / "boom.toml", tmp_path, verify=False))
    least, safest = trim(module), trim(module, aim="widest_margin")
    assert is_balanced(module, safest)
    assert is_balanced(module, least)
    assert safest.margins[:6].min() > least.margins[:6].min() + 0.01
    assert safest.u[6] != pytest.approx(least.u[6], abs=1e-3)


def test_joints_beyond_their_limits_are_told(shipped: Load) -> None:
    module = shipped("dual_arm")
    found = trim(module, {"left_forearm": -1.0})
    (told,) = found.beyond_limits
    assert told.startswith("left_forearm is -1 rad (-57.3°), below its limit of ")
    assert f"\nwarning: {told}" in str(found)
    assert trim(module, ROBOTS["dual_arm"]).beyond_limits == ()


def test_attitude_and_posture_are_told_by_name(shipped: Load) -> None:
    arms = trim(shipped("dual_arm"), {"left_shoulder": 0.7})
    assert arms.posture["left_shoulder"] == 0.7
    assert re.search("\n  left_shoulder +0.7 rad +40.11°\n", str(arms))
    assert trim(shipped("dual_arm"), arms.posture).u == pytest.approx(arms.u)
    angles = trim(shipped("hexarotor_3link"), q=np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0, 0, 0]))
    assert angles.attitude == {"theta_m1": 0.1, "theta_0": 0.2, "theta_1": 0.3}
    assert angles.posture == {"theta_7": 0.4, "theta_8": 0.5, "theta_9": 0.6}
    assert angles.attitude_deg["theta_0"] == pytest.approx(0.2 * 180 / np.pi)
    again = trim(shipped("dual_arm"), posture_deg=arms.posture_deg)
    assert again.q == pytest.approx(arms.q)


def test_the_attitude_of_a_quaternion_is_told_by_angles(shipped: Load) -> None:
    """R = Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = 0.2, -0.3, 2.0
    turned = np.array([0.0, 0.0, 0.0, 1.0])
    for angle, axis in ((roll, 0), (pitch, 1), (yaw, 2)):
        x, y, z = np.sin(0.5 * angle) * np.eye(3)[axis]
        w, (a, b, c, d) = np.cos(0.5 * angle), turned
        turned = np.array(  # The later turn, about fixed axes, from the left.
            [
                w * a + x * d + y * c - z * b,
                w * b + y * d + z * a - x * c,
                w * c + z * d + x * b - y * a,
                w * d - x * a - y * b - z * c,
            ]
        )
    module = shipped("hextilt_flying_arm_5")
    found = trim(module, q=np.concatenate([np.zeros(3), turned, np.zeros(5)]))
    assert found.attitude == pytest.approx({"roll": roll, "pitch": pitch, "yaw": yaw})


def test_parameters_are_those_of_the_trim(shipped: Load) -> None:
    module = shipped("quadrotor")
    found = trim(module, parameters={"gravity": 1.62})
    assert np.sum(found.u) == pytest.approx(1.5 * 1.62)


@pytest.mark.slow
def test_a_length_is_not_given_in_degrees(tmp_path: Path) -> None:
    body = "mass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n"
    link = f'[[link]]\njoint = "prismatic"\ncoordinate = "reach"\n{body}'
    (tmp_path / "crane.toml").write_text(f'name = "crane"\ngravity = 0\n[base]\n{body}{link}')
    module = load(generate(tmp_path / "crane.toml", tmp_path, verify=False))
    found = trim(module, {"reach": 0.2})
    assert (found.posture, found.posture_deg) == ({"reach": 0.2}, {})
    with pytest.raises(UsageError, match="reach is prismatic; give it in posture, in m"):
        trim(module, posture_deg={"reach": 0.2})


@pytest.mark.slow
def test_a_body_without_weight_or_inputs_is_balanced(tmp_path: Path) -> None:
    file = tmp_path / "lone.toml"
    file.write_text('name = "lone"\ngravity = 0\n[base]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n')
    module = load(generate(file, tmp_path, verify=False))
    found = trim(module, velocity=(1.0, 2.0, 3.0))
    assert found.u.shape == (0,)
    assert len(found.missing) == 6
    lines = str(found).splitlines()
    assert lines[0] == "lone: balanced; varied: attitude"
    assert [line.split() for line in lines[1:6]] == [
        ["theta_m1", "0", "rad", "0°"],
        ["theta_0", "0", "rad", "0°"],
        ["theta_1", "0", "rad", "0°"],
        ["The", "rotors", "produce", "no", "wrench", "along"],
        ["force", "along", "x"],
    ]


@pytest.mark.parametrize("backend", ["casadi"])
def test_a_module_of_another_library_is_refused(small: Path, backend: str) -> None:
    pytest.importorskip(backend)
    module = load(small, backend=backend)
    assert module.backend == backend
    linearised = functools.partial(linearise, q=module.COORDINATES)
    for function in (trim, linearised, functools.partial(simulate, scenario="hover")):
        with pytest.raises(UsageError, match=rf'back end is {backend}; .*"numpy" or "c"'):
            function(module)


def test_a_module_may_be_given_by_its_path(shipped: Load) -> None:
    module = shipped("quadrotor")
    folder = Path(module.__file__ or "").parent
    by_path, by_module = trim(folder), trim(module)
    for field in fields(Trim):
        assert np.array_equal(getattr(by_path, field.name), getattr(by_module, field.name))


@pytest.mark.parametrize(
    ("name", "request_", "words"),
    [
        (
            "hydrus",
            {},
            r"hydrus: no trim: whatever the thrusts, they leave .*torque about x -?0\.0",
        ),
        (
            "quadrotor",
            {"limits": (0.0, 3.0)},
            r"F_front_left is 3\.679 N, 0\.679 N above its limit of 3 N; F_rear_left",
        ),
        (
            "quadrotor",
            {"limits": (5.0, 9.0)},
            r"F_front_left is 3\.679 N, 1\.32 N below its limit of 5 N",
        ),
        (
            "dual_arm",
            {"wrenches": {"left_hand": [0, 0, -25.0, 0, 0, 0]}, "posture": {"left_shoulder": 1.5}},
            r"tau_left_\w+ is .* N m, .* its limit of .* N m",
        ),
        ("quadrotor", {"aim": "most"}, "'most' is unknown; known: least_thrust, widest_margin"),
        (
            "dual_arm",
            {"wrenches": {"foot": [0.0] * 6}},
            "no frame foot; its frames: base, left_hand",
        ),
        ("dual_arm", {"posture": {"elbow": 1.0}}, "no joint elbow; its joints: left_shoulder"),
        ("dual_arm", {"posture": {"left_shoulder": 60}}, "more than a turn; for degrees give post"),
        ("dual_arm", {"free": ["elbow"]}, "no joint elbow"),
        (
            "dual_arm",
            {"free": ["left_forearm"], "posture": {"left_forearm": -1.0}},
            "left_forearm starts beyond its limits",
        ),
        ("quadrotor", {"q": np.zeros(6)}, r"q \(x, y, .*, qw\): must be 7 finite numbers"),
        ("quadrotor", {"velocity": 1.0}, "velocity: must be 3 finite numbers"),
        ("quadrotor", {"limits": (9.0, 0.0)}, "limits: must be the least and .*, or two rows of 4"),
        ("quadrotor", {"wrenches": {"base": [1.0, 2, 3]}}, "wrenches: base: must be 6 finite"),
        (
            "hexarotor_3link",
            {"aim": "widest_margin"},
            "some thrust has no limit on one side",
        ),
        ("quadrotor", {"parameters": {"mass": 1.0}}, "parameters: "),
        ("quadrotor", {"q": np.zeros(7)}, "quaternion .*qw must have the length 1, not 0"),
        ("quadrotor", {"q": np.zeros((2, 7))}, r"7 finite numbers, not an array of shape \(2, 7\)"),
        ("quadrotor", {"velocity": ["a", 1, 2]}, "velocity: must be 3 finite numbers, not "),
        ("quadrotor", {"velocity": [[1], [1, 2]]}, "velocity: must be 3 finite numbers, not "),
        ("quadrotor", {"velocity": [1j, 0, 0]}, "velocity: must be 3 finite numbers, not "),
        ("dual_arm", {"posture": {"left_shoulder": np.nan}}, "left_shoulder: must be a finite num"),
        ("dual_arm", {"posture": [0.3, 0.4]}, "posture: a dictionary of joints"),
        ("dual_arm", {"posture": {"left_shoulder": "up"}}, "left_shoulder: must be a finite num"),
        ("dual_arm", {"free": "elbow"}, 'no joint elbow; what may differ: "attitude", left_should'),
        (
            "quadrotor",
            {"acceleration": (1.0, 0, 0), "free": ()},
            r'force along x 1\.5 N .*let the search vary .* free=\(…\), out of "attitude"$',
        ),
    ],
)
def test_what_cannot_be_is_refused_in_words(
    shipped: Load, name: str, request_: dict[str, object], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        trim(shipped(name), **request_)  # type: ignore[arg-type]
