"""Numbers of others: Andrews' squeezing mechanism, windows of four bars, the PUMA 560.

The squeezer is that of Hairer and Wanner, Solving Ordinary Differential Equations II, and of the
Test Set for Initial Value Problem Solvers (Mazzia and Magherini), whose initial and reference
solutions stand here. Windows are problem A02 of IFToMM's library of benchmarks.
"""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from support.derived import derived
from support.emitted import emitted_module
from support.high_precision import DIGITS, evaluated, prepared

from gibbs_codegen import generate, load, read_robot, rollout

Array = np.ndarray
ROBOTS = Path(__file__).parents[1] / "robots"
ANDREWS = ROBOTS / "andrews.toml"
# The published order of angles, where they begin, and their accelerations, by which only two move.
ANGLES = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
START = (
    *("-0.0617138900142764496358948458001", "0", "0.455279819163070380255912382449"),
    *("0.222668390165885884674473185609", "0.487364979543842550225598953530"),
    *("-0.222668390165885884674473185609", "1.23054744454982119249735015568"),
)
ACCELERATIONS = ("14222.4439199541138705911625887", "-10666.8329399655854029433719415")
# Angles and their rates after 0.03 s.
END = np.array([
    *(15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948),
    *(0.5244099658805304, 0.5347301163226948, 1.048080741042263),
])  # fmt: skip
END_RATES = np.array([
    *(1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385),
    *(0.5735699284790808, -19.29337464421385, 0.3231791658026955),
])  # fmt: skip
MOMENT = 0.033  # N m, on β all the time.


def squeezer_at_the_start() -> tuple[list[mpmath.mpf], Array]:
    """Accelerations in the published order, of what is emitted: with 30 digits, and in doubles."""
    model = derived(read_robot(str(ANDREWS))[0], functions=("default", "constraints"))
    program, zeros = model.program, [0.0] * len(ANGLES)
    names = program.inputs["q"]
    order = [names.index(f"{angle}_q") for angle in ANGLES]
    with mpmath.workdps(DIGITS):
        q = [mpmath.mpf(START[order.index(k)]) for k in range(len(ANGLES))]
        state, constants = {"q": q, "v": zeros}, prepared(program, model.defaults)

        def matrix(name: str, rows: int) -> mpmath.matrix:
            (entries,) = evaluated(program, program.function(name), constants, state)
            table = np.reshape([entry.value for entry in entries], (rows, -1))
            return mpmath.matrix(table.tolist())

        mass, right = matrix("mass_matrix", 7), matrix("residual", 7)
        right[order[0]] += mpmath.mpf(str(MOMENT))
        rows = matrix("constraint_jacobian", 9)
        # Of three rows a loop has, the third is across the plane, in which nothing moves.
        plane = [k for k in range(9) if k % 3 != 2]
        whole = mpmath.zeros(13)
        whole[:7, :7] = mass
        for k, row in enumerate(plane):
            for j in range(7):
                whole[7 + k, j] = whole[j, 7 + k] = rows[row, j]
        found = mpmath.lu_solve(whole, mpmath.matrix([*right, *[0] * 6]))
    module, inputs = emitted_module(model.robot, "default", "constraints"), np.zeros(7)
    inputs[order[0]] = MOMENT
    a, _ = module.constrained_forward_dynamics(np.array(q, float), zeros, inputs, np.ones(3))
    return [found[angle] for angle in order], a[order]


def share_off(found: mpmath.mpf, published: str) -> float:
    """The share by which a number is off a published one, to all its digits."""
    with mpmath.workdps(DIGITS):
        return float(abs(found / mpmath.mpf(published) - 1))


@pytest.mark.slow
def test_the_squeezer_begins_with_the_published_accelerations() -> None:
    """To 1e-14, where what is emitted takes the 30 digits in which the angles are published.

    In double precision a rounding of γ alone changes the acceleration of θ by 2e-14 of it.
    """
    found, a = squeezer_at_the_start()
    assert all(map((1e-14).__gt__, map(share_off, found, ACCELERATIONS)))
    assert all(abs(acceleration) < 1e-10 for acceleration in found[2:])
    np.testing.assert_allclose(a[:2], np.array(ACCELERATIONS, float), rtol=4e-14)


def squeezed() -> tuple[Array, Array]:
    """Angles and rates after 0.03 s, by an explicit method that is brought back to the loops."""
    module = emitted_module(read_robot(str(ANDREWS))[0], "default", "constraints")
    order = [module.COORDINATES.index(angle) for angle in ANGLES]
    every, inputs = np.ones(3), np.zeros(7)
    inputs[order[0]] = MOMENT

    def rate(_: float, x: Array) -> Array:
        a, _ = module.constrained_forward_dynamics(x[:7], x[7:], inputs, every)
        return np.concatenate([x[7:], a])

    q, v = np.zeros(7), np.zeros(7)
    q[order] = np.array(START, float)
    for k in range(30):
        span, begin = (1e-3 * k, 1e-3 * (k + 1)), np.concatenate([q, v])
        end = solve_ivp(rate, span, begin, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        q = module.integrate(end[:7], module.constraint_projection(end[:7], every))
        v, _ = module.impact(q, end[7:], every, np.zeros(3))
    return q[order], v[order]


@pytest.mark.slow
def test_the_squeezer_is_where_it_was_published_to_be() -> None:
    """After 0.03 s, in which one of its bodies turns two and a half times.

    The published solution is that of an instant 1e-12 s later: all angles are off by that time's
    share of their rates. Without it they agree to 13 digits.
    """
    q, v = squeezed()
    np.testing.assert_allclose(q, END, rtol=1e-9, atol=0)
    np.testing.assert_allclose(v, END_RATES, rtol=6e-8, atol=0)
    late = ((END - q) @ v) / (v @ v)
    assert abs(late) < 1.1e-12
    np.testing.assert_allclose(q + late * v, END, rtol=1e-12, atol=1e-13)


def windows(count: int) -> str:
    """A robot file of so many windows in a row: cranks on the ground, joined by couplers."""
    rod = f"mass = 1\ncom = [0.5, 0, 0]\ninertia = [0, {1 / 12}, {1 / 12}, 0, 0, 0]\n"
    text = 'name = "windows"\n[base]\nmotion = "fixed"\nrpy_deg = [90, 0, 0]\n'
    for k in range(count + 1):
        text += f'[[link]]\nname = "crank{k}"\nparent = "base"\nxyz = [{k}, 0, 0]\n{rod}'
        text += f'[[frame]]\nname = "top{k}"\non = "crank{k}"\nxyz = [1, 0, 0]\n'
        if k:
            text += (
                f'[[link]]\nname = "coupler{k}"\nparent = "crank{k - 1}"\nxyz = [1, 0, 0]\n{rod}'
            )
            text += f'[[frame]]\nname = "end{k}"\non = "coupler{k}"\nxyz = [1, 0, 0]\n'
            text += f'[[constraint]]\nname = "loop{k}"\ntype = "loop"\nframe = "end{k}"\n'
            text += f'to = "top{k}"\njoint = "spherical"\n'
    return text


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_windows_of_four_bars_go_through_where_their_bars_are_in_line(
    count: int, tmp_path: Path
) -> None:
    """They swing on as the pendulum that they are, and keep their energy.

    For 10 s, from upright cranks, at 1 m/s. Bars are 1 m long and of 1 kg.
    """
    (tmp_path / "windows.toml").write_text(windows(count))
    functions = ["default", "constraints"]
    path = generate(tmp_path / "windows.toml", tmp_path, functions=functions, verify=False)
    module = load(path, backend="c")
    signs = np.array([1.0 if name.startswith("crank") else -1.0 for name in module.COORDINATES])
    loops = [f"loop{k}" for k in range(1, count + 1)]
    # In line, of two rows in the plane each loop has one: from 1 degree of freedom to count + 1.
    assert np.linalg.matrix_rank(module.constraint_jacobian(0.0 * signs)) == count
    start, still = 0.5 * np.pi * signs, np.zeros(len(signs))
    assert np.linalg.matrix_rank(module.constraint_jacobian(start)) == 2 * count
    found = rollout(module, start, -signs, still, 10_000, 1e-3, constraints=loops)
    q, v = found.q[0], found.v[0]
    energy = module.kinetic_energy(q, v) + module.potential_energy(q)
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-6)
    assert np.count_nonzero(np.diff(np.sign(np.sin(q[:, 0])))) >= 9
    # The angle of cranks, with the inertia of all bars and the moment of their weights.
    inertia, moment = (count + 1) / 3 + count, 9.81 * ((count + 1) / 2 + count)

    def swing(_: float, x: Array) -> Array:
        return np.array([x[1], -moment / inertia * np.cos(x[0])])

    angle = solve_ivp(swing, (0.0, 10.0), [0.5 * np.pi, -1.0], "DOP853", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(q[-1], signs * angle.y[0, -1], rtol=1e-8)


def puma_gravity() -> tuple[Array, Array]:
    """Torques of gravity, N m: here, and by the five coefficients that the paper gives."""
    robot, _ = read_robot(str(ROBOTS / "puma560.toml"))
    module = emitted_module(robot, "gravity_forces")
    q = np.array([0.3, 0.7, -0.4, 0.5, -0.8, 0.2])
    (s2, c2), (s23, c23) = ((np.sin(x), np.cos(x)) for x in (q[1], q[1] + q[2]))
    (s4, c4), (s5, c5) = ((np.sin(x), np.cos(x)) for x in q[3:5])
    g1, g2, g3, g4, g5 = -37.2, -8.44, 1.02, 0.249, -0.0282
    lifted = g2 * s23 + g4 * c23 + g5 * (s23 * c5 + c23 * c4 * s5)
    held = [0, g1 * c2 + g3 * s2 + lifted, lifted, -g5 * s23 * s4 * s5]
    held += [g5 * (c23 * s5 + s23 * c4 * c5), 0]
    return -module.gravity_forces(q), np.array(held)


@pytest.mark.slow
def test_the_puma_weighs_what_was_published() -> None:
    """With the digits that the paper gives."""
    found, published = puma_gravity()
    np.testing.assert_allclose(found, published, atol=0.08)
    np.testing.assert_allclose(found[3:], published[3:], atol=3e-5)


# Standard Denavit–Hartenberg parameters a, d and α (°) as Universal Robots publishes them, with
# masses and centres of mass in the frames of the links, and modified ones of the Panda.
UR5E = [
    (0, 0.1625, 90, 3.761, (0, -0.02561, 0.00193)),
    (-0.425, 0, 0, 8.058, (0.2125, 0, 0.11336)),
    (-0.3922, 0, 0, 2.846, (0.15, 0, 0.0265)),
    (0, 0.1333, 90, 1.37, (0, -0.0018, 0.01634)),
    (0, 0.0997, -90, 1.3, (0, 0.0018, 0.01634)),
    (0, 0.0996, 0, 0.365, (0, 0, -0.001159)),
]
PANDA = [
    *((0, 0.333, 0), (0, 0, -90), (0, 0.316, 90), (0.0825, 0, 90)),
    *((-0.0825, 0.384, -90), (0, 0, 90), (0.088, 0, 90), (0, 0.107, 0)),
]


def moved(axis: str, angle: float, *along: float) -> Array:
    """A turn about an axis and then a shift along the axes before it, as a matrix."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = Rotation.from_euler(axis, angle).as_matrix(), along
    return found


def arms_that_ship() -> dict[str, tuple[Array, Array]]:
    """Poses of tips and an energy, m and J, here and by published parameters."""
    q = np.array([0.3, -0.7, 0.4, -1.5, 0.8, 0.2, -0.5])
    module = emitted_module(read_robot("ur5e")[0], "tip_pose", "potential_energy")
    pose = moved("z", np.pi, 0, 0, 0)
    energies = []
    for (a, d, alpha, mass, com), angle in zip(UR5E, q, strict=False):
        pose = pose @ moved("z", angle, 0, 0, d) @ moved("x", np.deg2rad(alpha), a, 0, 0)
        energies.append(9.81 * mass * (pose @ [*com, 1.0])[2])
    found = {
        "ur5e": (module.tip_pose(q[:6]), pose),
        "energy": (module.potential_energy(q[:6]), np.array(sum(energies))),
    }
    module, pose = emitted_module(read_robot("panda")[0], "tip_pose"), np.eye(4)
    for (a, d, alpha), angle in zip(PANDA, [*q, 0.0], strict=True):
        pose = pose @ moved("x", np.deg2rad(alpha), a, 0, 0) @ moved("z", angle, 0, 0, d)
    return found | {"panda": (module.tip_pose(q), pose)}


@pytest.mark.slow
def test_arms_that_ship_reach_and_weigh_what_was_published() -> None:
    compared = arms_that_ship()
    np.testing.assert_allclose(*compared.pop("energy"), rtol=1e-14)
    for found, published in compared.values():
        np.testing.assert_allclose(found, published, atol=1e-15)


@pytest.mark.slow
def test_loops_of_the_delta_arm_close_where_its_platform_is() -> None:
    """Where the tutorial's forward kinematics says: three spheres about the elbows meet there."""
    robot = read_robot("delta_hexarotor")[0]
    needed = "constraint_errors", "constraint_jacobian", "integrate", "frame_poses"
    module = emitted_module(robot, *needed)
    side, small, upper, lower = 0.4573, 0.115, 0.112, 0.232
    names = list(module.COORDINATES)
    q = np.zeros(len(names))
    q[names.index("qw")] = 1.0
    np.testing.assert_allclose(module.constraint_errors(q), 0.0, atol=1e-15)
    np.testing.assert_allclose(module.constraint_errors(np.array(module.POSTURE)), 0.0, atol=2e-7)
    assert np.linalg.matrix_rank(module.constraint_jacobian(q)) == 9
    angles = np.array([0.3, 0.6, 0.45])
    for k, angle in enumerate(angles, start=1):  # Forearms stay as they were.
        q[names.index(f"upper_arm_{k}")], q[names.index(f"fork_{k}")] = angle, -angle
    driven = [list(module.VELOCITIES).index(f"upper_arm_{k}") for k in (1, 2, 3)]
    free = [k for k in range(6, len(module.VELOCITIES)) if k not in driven]
    for _ in range(8):  # Newton's steps of what nothing drives.
        step = np.zeros(len(module.VELOCITIES))
        jacobian = module.constraint_jacobian(q)[:, free]
        step[free] = -np.linalg.lstsq(jacobian, module.constraint_errors(q), rcond=None)[0]
        q = module.integrate(q, step)
    assert np.abs(module.constraint_errors(q)).max() < 1e-15
    reach = (side - small) / np.sqrt(12) + upper * np.cos(angles)
    turns = np.deg2rad([0, 120, 240])
    elbows = np.array([reach * np.cos(turns), reach * np.sin(turns), -upper * np.sin(angles)]).T
    # Of |p − e|² = l² the differences are linear: a line, and on it the lower of two points.
    planes = elbows[1:] - elbows[0]
    squares = np.sum(elbows**2, axis=1)
    along = np.cross(*planes)
    point = np.linalg.lstsq(planes, 0.5 * (squares[1:] - squares[0]), rcond=None)[0]
    apart = point - elbows[0]
    roots = np.roots([along @ along, 2.0 * along @ apart, apart @ apart - lower**2])
    lowest = min((point + root * along for root in roots), key=lambda p: float(p[2]))
    tip = module.frame_poses(q)[module.FRAMES.index("tip"), :3, 3]
    np.testing.assert_allclose(tip, lowest - [0, 0, 0.06 + 0.03], atol=1e-14)
