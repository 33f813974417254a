"""Whether numbers are as sure as identify says: identify_repeats RUNS SECONDS [ROBOT].

`python -m benchmarks.` of it: `quadrotor_arm_2link` or `hextilt_flying_arm_5`, with throttles and
an arm on servos, whose numbers are not those of its file, flies in gusts of 5 % of its weight. Its
IMU, motion capture and encoders err. Prints of each number the root-mean-square error, the
deviation that `identify` tells, and how often its band of 95 % holds. All cores work, a flight
each. Ctrl-C ends it with the flights so far.
"""

from __future__ import annotations

import sys
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gibbs_codegen import Identified, Recording, generate, identify, load
from gibbs_codegen.identification.model import Model
from gibbs_codegen.identification.unknowns import Unknowns
from gibbs_codegen.robot.file import read_robot

Array = np.ndarray
FLOWN: dict[str, Any] = {}
"""What processes share: the module, names of free numbers, and flights."""
RATE, GRAVITY, WIND, DRAG = 200, 9.81, 0.05, 0.25
SERVO = (
    "armature = 1e-3\nservo = {{ stiffness = 30, damping = {}, delay = 0.02, rate = 6 }}\neffort"
)
THROTTLE = 'command = "throttle"\nmax_thrust = {}\nthrust_model_factor = 0.8'
LAG = "\ntime_constant = 0.04"
FILES = {
    "quadrotor_arm_2link": {
        "limits        = [0, 14]": THROTTLE.format(14),
        "effort     = 4": SERVO.format(0.6) + " = 4",
        "effort     = 3": SERVO.format(0.4) + " = 3",
    },
    "hextilt_flying_arm_5": {
        "limits = [0.0854858, 10.3437818]": THROTTLE.format(10.3437818) + LAG,
        "effort = 1.0": SERVO.format(0.6) + " = 1.0",
        "effort = 0.3": SERVO.format(0.4) + " = 0.3",
    },
}
# What the numbers truly are, times those of the file.
FACTORS = {
    "rotors.thrust_1": 1.25,
    "rotors.thrust_2": 0.9,
    "rotors.time_constant": 1.3,
    "rotors.drag": 0.85,
    "base_com_x": 0.5,
    "base_com_z": 1.6,
    "base_inertia_xx": 1.15,
    "base_inertia_yy": 0.88,
    "base_inertia_zz": 1.1,
}
QUADROTOR = FACTORS | {
    "upper_arm_com_z": 1.08,
    "forearm_mass": 1.2,
    "forearm_com_z": 1.15,
    "forearm_inertia_xx": 1.2,
    "forearm_inertia_yy": 1.2,
    "forearm_inertia_zz": 1.2,
    "upper_arm_servo_stiffness": 0.8,
    "forearm_servo_stiffness": 1.2,
    "upper_arm_servo_damping": 0.8,
    "forearm_servo_damping": 1.25,
    "upper_arm_servo_delay": 1.4,
    "forearm_servo_delay": 1.4,
}
# Joints of the other: factors of stiffness, damping and delay of each; then numbers of links.
HEXTILT = FACTORS | {
    f"flying_arm_5__link_{link}_{end}": factor
    for link, factors in enumerate([(0.8, 0.8), (1.2, 1.25), (0.9, 1.2), (1.1, 0.8), (1.2, 0.9)], 1)
    for end, factor in zip(
        ["servo_stiffness", "servo_damping", "servo_delay"], [*factors, 1.4], strict=True
    )
}
HEXTILT |= {
    "flying_arm_5__link_1_mass": 1.1,
    "flying_arm_5__link_1_com_x": 1.08,
    "flying_arm_5__link_2_mass": 0.85,
    "flying_arm_5__link_2_com_x": 1.15,
    "flying_arm_5__link_3_com_y": 1.2,
    "flying_arm_5__link_4_mass": 1.15,
    "flying_arm_5__link_4_com_x": 0.9,
    "flying_arm_5__link_5_mass": 1.3,
}
NUMBERS = {"quadrotor_arm_2link": QUADROTOR, "hextilt_flying_arm_5": HEXTILT}
# Sums of waves, by amplitude (m or rad), rad/s and phase: of x, y, z, heading and joints.
WAVES = np.array(
    [
        [(0.6, 1.3, 0), (0.08, 3.7, 1), (0, 0, 0)],
        [(0.6, 1.7, 2), (0.06, 4.1, 0), (0, 0, 0)],
        [(0.25, 2.3, 0), (0.06, 5.3, 1), (0, 0, 0)],
        [(0.5, 0.9, 0), (0.2, 3.1, 1), (0, 0, 0)],
        [(0.5, 1.1, 0), (0.25, 4.3, 1), (0.08, 11, 0)],
        [(0.6, 1.9, 1), (0.3, 5.1, 0), (0.08, 13, 2)],
        [(0.5, 1.4, 2), (0.25, 4.7, 0), (0.08, 12, 1)],
        [(0.6, 1.6, 0), (0.3, 5.7, 2), (0.08, 14, 0)],
        [(0.5, 2.1, 1), (0.25, 3.9, 2), (0.08, 10, 1)],
    ]
)
REST = np.array([0.0, 0.0, 2.0, 0.0, 0.2, 0.3, 0.2, 0.3, 0.2])


def wanted(t: float, order: int) -> Array:
    """A derivative (9) of place, heading and five joints, faded in."""
    a, w, phase = np.moveaxis(WAVES, 2, 0)
    waves = np.sum(a * w**order * np.sin(w * t + phase + 0.5 * np.pi * order), axis=1)
    return min(t / 2.0, 1.0) * waves + (REST if order == 0 else 0.0)


def commands(module: ModuleType, t: float, q: Array, v: Array) -> Array:
    """Throttles and positions of servos (runs, nu), by errors and the numbers of the file."""
    joints = q.shape[1] - 7
    rotors = len(module.INPUTS) - joints
    turn, (place, rate, pull) = Rotation.from_quat(q[:, 3:7]), (wanted(t, k) for k in range(3))
    up = pull[:3] + 2.0 * (place[:3] - q[:, :3]) + 2.5 * (rate[:3] - turn.apply(v[:, :3]))
    up[:, 2] += GRAVITY
    normal = up / np.linalg.norm(up, axis=1, keepdims=True)
    side = np.cross(normal, [np.cos(place[3]), np.sin(place[3]), 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    aim = Rotation.from_matrix(np.stack([np.cross(side, normal), side, normal], axis=-1))
    a = np.zeros_like(v)
    a[:, :3] = turn.inv().apply(up - [0.0, 0.0, GRAVITY]) - np.cross(v[:, 3:6], v[:, :3])
    slow = v[:, 3:6] - turn.inv().apply([0.0, 0.0, rate[3]])
    a[:, 3:6] = [70.0, 70.0, 12.0] * (turn.inv() * aim).as_rotvec() - [14.0, 14.0, 6.0] * slow
    force, matrix = module.inverse_dynamics(q, v, a), module.input_matrix(q)
    rows = slice(6 - rotors, 6)  # Four push along z and turn, six in all directions.
    thrusts = np.linalg.pinv(matrix[:, rows, :rotors]) @ force[:, rows, np.newaxis]
    inputs = np.pad(np.clip(thrusts[..., 0], 0.3, None), [(0, 0), (0, joints)])
    throttles = np.clip(module.command_of(q, v, inputs)[:, :rotors], 0.0, 1.0)
    return np.concatenate([throttles, np.tile(place[4 : 4 + joints], (len(q), 1))], axis=1)


def flown(
    module: ModuleType, plant: dict[str, float], runs: int, seconds: float
) -> tuple[Array, Array, Array]:
    """Coordinates, commands and what the IMU feels (runs, samples, ·), without noise."""
    parts, rng = 2, np.random.default_rng(1)
    h = 1.0 / (RATE * parts)
    model = Model(module, h, ["base"], np.zeros(0))
    machine, left = model.machine(plant), np.exp(-h)
    gust = WIND * GRAVITY / np.sqrt(2.5) * np.array([1.0, 1.0, np.sqrt(0.5)])
    pull = gust * rng.standard_normal((runs, 3))
    joints = REST[4 : model.nv - 2]
    q, v = np.tile([*REST[:3], 0, 0, 0, 1, *joints], (runs, 1)), np.zeros((runs, model.nv))
    x = np.tile(module.actuator_state_of(commands(module, 0.0, q, v)[0]), (runs, 1))
    rows = []
    for k in range(round(seconds * RATE)):
        command = commands(module, k / RATE, q, v)
        for part in range(parts):
            state = {"q": q, "v": v, "x": x, "pull": pull}
            after, felt = model(state, machine, command=command, drag=DRAG)
            if part == 0:
                rows.append((q, command, felt))
            q, v, x = after["q"], after["v"], after["x"]
            pull = left * pull + np.sqrt(1.0 - left**2) * gust * rng.standard_normal(pull.shape)
    return tuple(np.stack(series, axis=1) for series in zip(*rows, strict=True))


def recorded(q: Array, command: Array, felt: Array, seed: int) -> Recording:
    """What sensors tell of a flight: 200 times a second, motion capture and encoders 100 times."""
    rng, q = np.random.default_rng([2, seed]), q.copy()
    felt = felt + np.repeat([0.1, 0.01], 3) * rng.standard_normal(felt.shape)
    q[:, :3] += 0.002 * rng.standard_normal((len(q), 3))
    off = Rotation.from_rotvec(0.003 * rng.standard_normal((len(q), 3)))
    seen = (Rotation.from_quat(q[:, 3:7]) * off).as_quat()
    q[:, 3:7] = seen * np.sign(np.sum(seen * q[:, 3:7], axis=1, keepdims=True))
    q[:, 7:] = np.round(q[:, 7:] / 1.5e-3) * 1.5e-3
    q[1::2] = np.nan
    return Recording(np.arange(len(q)) / RATE, command, q, {"base": felt})


def identified(run: int) -> tuple[Identified, float]:
    """What `identify` finds in a flight, and its seconds of processor time."""
    begin = time.process_time()
    recording = recorded(*FLOWN["flights"][run], run + 1)
    return identify(FLOWN["module"], recording, FLOWN["free"]), time.process_time() - begin


def main(count: int, seconds: float, robot: str = "quadrotor_arm_2link") -> None:
    """Fly, identify and print a row for each number."""
    factors = NUMBERS[robot]
    with tempfile.TemporaryDirectory() as folder:
        text = read_robot(robot)[1]
        for old, new in FILES[robot].items():
            text = text.replace(old, new)
        (Path(folder) / "robot.toml").write_text(text, "utf-8")
        module = load(generate(Path(folder) / "robot.toml", folder, verify=False), "c")
        members = Unknowns(module, [*factors], 0.3).members
        plant = {n: module.PARAMETERS[n] * x for k, x in factors.items() for n in members[k]}
        flights = flown(module, plant, count, seconds)
        # Processes are forked, so that they have the module and the flights.
        FLOWN.update(module=module, free=[*factors], flights=[*zip(*flights, strict=True)])
        fits: list[tuple[Identified, float]] = []
        with get_context("fork").Pool(initializer=signal, initargs=(SIGINT, SIG_IGN)) as pool:
            try:
                for fit in pool.imap(identified, range(count)):
                    fits.append(fit)
                    print(f"{len(fits)}: {fit[1]:.1f} s", file=sys.stderr, flush=True)
            except KeyboardInterrupt:
                print("stopped", file=sys.stderr)
    found, times = zip(*fits, strict=True)
    names = found[0].names
    exact = np.array([plant[members[name][0]] for name in names])
    values, deviations = (
        np.array([getattr(f, k) for f in found]) for k in ("values", "deviations")
    )
    errors, inside = values - exact, np.abs(values - exact) < 1.96 * deviations
    print(f"{len(found)} flights of {seconds:g} s, {np.median(times):.1f} s of processor time each")
    print(f"settled: {sum(f.settled for f in found)}; bands that hold: {inside.mean():.3f}")
    print("| number | error, % | deviation, % | in the band |\n|---|---:|---:|---:|")
    for k, name in enumerate(names):
        error, told = (np.sqrt(np.mean(x[:, k] ** 2)) / abs(exact[k]) for x in (errors, deviations))
        print(f"| `{name}` | {100 * error:.2f} | {100 * told:.2f} | {inside[:, k].mean():.2f} |")


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), *sys.argv[3:])
