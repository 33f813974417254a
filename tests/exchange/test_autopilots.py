"""Parameters of autopilots: what PX4 and ArduPilot make of them is what the rotors do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.actuated import actuated
from support.pinocchio_oracle import Oracle

from gibbs_codegen.errors import UsageError
from gibbs_codegen.exchange.autopilots import _FRAMES
from gibbs_codegen.exchange.exporting import export_robot
from gibbs_codegen.robot.balance import wrench_matrix
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot

Array = NDArray[np.float64]
FRD = np.diag([1.0, -1.0, -1.0])
ROBOTS = ("quadrotor", "quadrotor_arm_2link", "dual_arm", "hextilt_flying_arm_5", "hydrus")


def px4(robot: Robot) -> tuple[dict[str, float], list[str]]:
    """The parameters in an airframe file, and what was told."""
    text, told = export_robot(robot, "px4")
    lines = [line.split() for line in text.splitlines() if line.startswith("param ")]
    assert all(line[:2] == ["param", "set-default"] and len(line) == 4 for line in lines)
    assert all(len(line[2]) <= 16 for line in lines)
    assert max(map(len, text.splitlines())) <= 100
    return {name: float(value) for _, _, name, value in lines}, told


def by_letters(values: dict[str, float], name: str) -> Array:
    return np.array([values[f"{name}{letter}"] for letter in "XYZ"])


def px4_column(values: dict[str, float], k: int, axis: Array) -> Array:
    """Force, then moment (6), of rotor k at full output, by ActuatorEffectivenessRotors."""
    ct, km = values[f"CA_ROTOR{k}_CT"], values[f"CA_ROTOR{k}_KM"]
    position = by_letters(values, f"CA_ROTOR{k}_P")
    return np.array([*(ct * axis), *(ct * np.cross(position, axis) - ct * km * axis)])


@pytest.mark.parametrize("name", ROBOTS)
def test_px4_allocates_as_the_rotors_push(name: str) -> None:
    robot, _ = read_robot(name)
    values, _ = px4(robot)
    assert (values["CA_AIRFRAME"], values["CA_ROTOR_COUNT"]) == (0, robot.rotors)
    oracle = Oracle(robot, rigid_base=True)
    q = np.zeros(7 + len(robot.links))
    q[6] = 1.0
    inputs = oracle.input_matrix(q)[:6, : robot.rotors]
    matrix = oracle.mass_matrix(q)
    mass, product = matrix[0, 0], matrix[:3, 3:6]  # −m times the cross product with the centre.
    com = np.array([product[1, 2], product[2, 0], product[0, 1]]) / mass
    for k in range(robot.rotors):
        force, moment = inputs[:3, k], inputs[3:, k]
        about_com = moment - np.cross(com, force)
        most = robot.thrusters[k].limits
        assert most is not None
        expected = most[1] * np.array([*(FRD @ force), *(FRD @ about_com)])
        axis = by_letters(values, f"CA_ROTOR{k}_A")
        assert np.allclose(px4_column(values, k, axis), expected, rtol=0.0, atol=1e-6)
        assert values[f"PWM_MAIN_FUNC{k + 1}"] == 101 + k
    # In hovering, all rotors at this share of their greatest thrusts carry the weight.
    greatest = [rotor.limits[1] for rotor in robot.thrusters if rotor.limits]
    full = inputs[2] @ greatest
    assert values["MPC_THR_HOVER"] * full == pytest.approx(9.81 * mass, rel=1e-6)
    joints = range(robot.rotors + 1, robot.rotors + min(len(robot.links), 6) + 1)
    outputs = [values[f"PWM_MAIN_FUNC{channel}"] for channel in joints]
    assert outputs == [301 + n for n in range(len(outputs))]
    assert f"PWM_MAIN_FUNC{robot.rotors + len(outputs) + 1}" not in values


def test_what_px4_cannot_be_told_is_told() -> None:
    _, told = px4(read_robot("hextilt_flying_arm_5")[0])
    assert any("push along the base's normal only" in line for line in told)
    values, told = px4(read_robot("hydrus")[0])
    assert "mind: fixed here, with joints at zero: rotors rotor2, rotor3, rotor4" in told
    assert "THR_MDL_FAC" not in values
    values, told = px4(read_robot("hexarotor_3link")[0])
    assert "mind: no greatest thrust known: rotors 1, 2, 3, 4, 5, 6" in told
    assert values["CA_ROTOR0_CT"] == 6.5
    assert "MPC_THR_HOVER" not in values
    with pytest.raises(UsageError, match="autopilots take 1 to 12"):
        px4(parse_robot('name = "r"\n[base]\nmass = 1.0\ninertia = [1, 1, 1, 0, 0, 0]\n'))


THROTTLES = """
name = "throttled"
base = { mass = 1.0, inertia = [0.01, 0.01, 0.02, 0, 0, 0], attitude = "quaternion" }
battery = { voltage = [13.2, 16.8], resistance = 0.02, capacity = 5 }
"""
THROTTLE = 'command = "throttle"\nmax_thrust = 9\ntime_constant = 0.03\nfull_speed = 900'
AT = ((0.2, -0.2, -1), (-0.2, 0.2, -1), (0.2, 0.2, 1), (-0.2, -0.2, 1))


def throttled(keys: str) -> Robot:
    """A quadrotor as an X with such keys for every rotor, the front right one first."""
    rotors = [
        f"[[rotor]]\nposition = [{x}, {y}, 0.0]\ndrag = {0.02 * drag}\n{keys}\n"
        for x, y, drag in AT
    ]
    return parse_robot(THROTTLES + "".join(rotors))


@pytest.mark.parametrize(
    ("keys", "factor"),
    [
        (f"{THROTTLE}\nthrust_model_factor = 0.7", 0.7),
        ('command = "speed"\nthrust_constant = 1e-5\ncommand_limits = [0, 900]', 1.0),
        # From 100 to 900 rad/s the thrust is 1e-5·(100 + 800 s)².
        ('command = "speed"\nthrust_constant = 1e-5\ncommand_limits = [100, 900]', 0.8),
    ],
)
def test_how_thrusts_follow_the_output(keys: str, factor: float) -> None:
    robot = throttled(keys)
    values, told = px4(robot)
    assert values["THR_MDL_FAC"] == pytest.approx(factor)
    assert told == ["left out: the battery"]
    text, told = export_robot(robot, "ardupilot")
    found = dict(line.split(",") for line in text.splitlines() if not line.startswith("#"))
    assert float(found["MOT_THST_EXPO"]) == pytest.approx(factor)
    assert (found["MOT_BAT_VOLT_MIN"], found["MOT_BAT_VOLT_MAX"]) == ("13.2", "16.8")
    assert found["BATT_CAPACITY"] == "5000"
    assert [found[f"SERVO{k}_FUNCTION"] for k in range(1, 5)] == ["33", "34", "35", "36"]
    assert (found["FRAME_CLASS"], found["FRAME_TYPE"]) == ("1", "1")
    assert not any("no frame" in line for line in told)


def test_rotors_that_follow_differently_have_their_mean() -> None:
    text = "\n".join(
        (
            'name = "two"\n[base]\nmass = 1.0\ninertia = [0.01, 0.01, 0.01, 0, 0, 0]',
            '[[rotor]]\ncommand = "throttle"\nmax_thrust = 9\nthrust_model_factor = 0.4',
            '[[rotor]]\ncommand = "throttle"\nmax_thrust = 9\nthrust_model_factor = 0.6',
        )
    )
    values, told = px4(parse_robot(text))
    assert values["THR_MDL_FAC"] == pytest.approx(0.5)
    assert "mind: the thrust curves of the rotors differ; their mean is used" in told


TILTED = """
name = "tilted"
base = { mass = 1.0, inertia = [0.01, 0.01, 0.02, 0, 0, 0], attitude = "quaternion" }
[[rotor]]
position = [-0.3, 0.0, 0.0]
drag = 0.02
limits = [0, 9]
[[rotor]]
on = "left"
drag = -0.02
limits = [0, 9]
[[rotor]]
on = "right"
drag = 0.02
limits = [0, 9]
[[link]]
name = "left"
parent = "base"
xyz = [0.2, 0.2, 0.0]
axis = "y"
limits_deg = [-30, 60]
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
[[link]]
name = "right"
parent = "base"
xyz = [0.2, -0.2, 0.0]
rpy_deg = [0, 0, 60]
axis = "-x"
limits_deg = [-20, 45]
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
"""


def test_rotors_that_joints_tilt_are_tilted_by_px4() -> None:
    robot = parse_robot(TILTED)
    values, told = px4(robot)
    assert (values["CA_AIRFRAME"], values["CA_SV_TL_COUNT"]) == (8, 2)
    assert [values.get(f"CA_ROTOR{k}_TILT") for k in range(3)] == [None, 1, 2]
    assert not any("fixed here" in line for line in told)
    assert [values[f"PWM_MAIN_FUNC{channel}"] for channel in (4, 5)] == [201, 202]
    for n, bound in ((0, "MINA"), (0, "MAXA"), (1, "MINA"), (1, "MAXA")):
        tilt = math.radians(values[f"CA_SV_TL{n}_{bound}"])
        towards = math.radians(values[f"CA_SV_TL{n}_TD"])
        # As PX4 tilts an axis that points up: by the Euler angles 0, −tilt, towards.
        back = np.array([math.sin(tilt), 0.0, -math.cos(tilt)])
        c, s = math.cos(towards), math.sin(towards)
        axis = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ back
        joints = np.zeros(2)
        joints[n] = tilt
        assert np.allclose(axis, FRD @ wrench_matrix(robot, joints)[:3, n + 1], atol=1e-9)


def test_rotors_that_nothing_can_tilt_there_are_told() -> None:
    """PX4 tilts by four joints, ArduPilot by none."""
    one = TILTED[TILTED.index('[[link]]\nname = "left"') : TILTED.index('[[link]]\nname = "right"')]
    rotor = '[[rotor]]\non = "left"\ndrag = 0.02\nlimits = [0, 9]\n'
    text = TILTED + "".join(
        (rotor + one).replace('"left"', f'"tilt{k}"').replace("[0.2, 0.2", f"[-0.{k}, 0.2")
        for k in range(1, 5)
    )
    values, told = px4(parse_robot(text))
    assert values["CA_SV_TL_COUNT"] == 4
    assert "mind: fixed here, with joints at zero: rotors 6, 7" in told
    assert "mind: tilts by 4 joints at most; not by: tilt3, tilt4" in told
    assert any("needs 13 outputs" in line for line in told)
    _, told = export_robot(parse_robot(text), "ardupilot")
    assert any("needs 13 outputs" in line for line in told)
    _, told = export_robot(parse_robot(TILTED), "ardupilot")
    assert "mind: fixed here, with joints at zero: rotors 2, 3" in told


@pytest.mark.parametrize("frame", _FRAMES)
def test_frames_of_ardupilot_are_balanced(frame: tuple[int, int]) -> None:
    bearings, turning = _FRAMES[frame]
    angles, spins = np.radians(bearings), np.array([1.0 if s == "+" else -1.0 for s in turning])
    factors = np.array([np.cos(angles + np.pi / 2), np.cos(angles), spins])
    assert np.allclose(factors @ factors.T, np.diag((factors**2).sum(1)), atol=1e-12)
    assert np.allclose(factors.sum(1), 0.0, atol=1e-12)


# By ArduPilot's documentation: bearings of its motors 1, 2 …, and whether they turn clockwise.
KNOWN = {
    "quadrotor": (1, 1, (45, -135, -45, 135), (0, 0, 1, 1)),
    "dual_arm": (4, 1, (45, -45, -135, 135, -45, 45, 135, -135), (0, 1, 0, 1, 0, 1, 0, 1)),
}


@pytest.mark.parametrize("name", KNOWN)
def test_ardupilot_turns_robots_as_their_rotors_do(name: str) -> None:
    robot, _ = read_robot(name)
    kind, form, bearings, clockwise = KNOWN[name]
    text, _ = export_robot(robot, "ardupilot")
    found = dict(line.split(",") for line in text.splitlines() if not line.startswith("#"))
    assert (int(found["FRAME_CLASS"]), int(found["FRAME_TYPE"])) == (kind, form)
    motors = [int(found[f"SERVO{k}_FUNCTION"]) - 33 for k in range(1, robot.rotors + 1)]
    angles = np.radians([bearings[motor] for motor in motors])
    yaw = [-1.0 if clockwise[motor] else 1.0 for motor in motors]
    factors = np.array([np.cos(angles + np.pi / 2), np.cos(angles), yaw])
    moments = FRD @ wrench_matrix(robot)[3:]
    moments -= moments.mean(axis=1)[:, np.newaxis]
    for own, its in zip(moments, factors, strict=True):
        assert np.allclose(own / np.abs(own).max(), its / np.abs(its).max(), atol=1e-9)
    joints = [found[f"SERVO{robot.rotors + n}_FUNCTION"] for n in range(1, len(robot.links) + 1)]
    assert joints == ["0"] * len(robot.links)


def test_that_ardupilot_has_no_such_frame_is_told() -> None:
    for name in ("hextilt_flying_arm_5", "hydrus"):
        text, told = export_robot(read_robot(name)[0], "ardupilot")
        assert "FRAME_CLASS," not in text
        assert any("has no frame with these rotors" in line for line in told)
    _, told = export_robot(actuated(), "ardupilot")
    assert not any("has no frame" in line for line in told)
