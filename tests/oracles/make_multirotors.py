"""Writes what published models of multirotors give, `rotorpy.json` and `drone_models.json`.

They are too heavy to be installed for tests, and needed once:

    python -m pip install rotorpy==3.0.0 drone-models==0.1.0
    python tests/oracles/make_multirotors.py

Quaternions have their scalar last; positions and velocities are in world axes, angular velocities
in those of the body. Everything is in SI units but the speeds of drone-models, in 1/min.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

# Before SciPy, which it tells to take arrays of any library.
from drone_models.core import load_params, parametrize  # isort: skip
from drone_models.first_principles import dynamics
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

HERE = Path(__file__).parent
STATES, SPEEDS = 12, (200.0, 1200.0)
# A flight in pieces of constant commands, and how exactly it is integrated.
PIECES, LENGTH = 4, 0.5
EXACT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}


def random_state(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A state of RotorPy, with wind."""
    attitude = rng.normal(size=4)
    return {
        "x": rng.normal(size=3),
        "v": 3.0 * rng.normal(size=3),
        "q": attitude / np.linalg.norm(attitude),
        "w": 2.0 * rng.normal(size=3),
        "wind": rng.normal(size=3),
        "rotor_speeds": rng.uniform(*SPEEDS, 4),
    }


def hummingbird() -> dict[str, Any]:
    """RotorPy's Hummingbird without the drag of its body, without and with the air of rotors."""
    parameters = {**quad_params, "c_Dx": 0.0, "c_Dy": 0.0, "c_Dz": 0.0}
    rng = np.random.default_rng(0)
    states = [random_state(rng) for _ in range(STATES)]
    commands = rng.uniform(*SPEEDS, (STATES, 4))
    start = random_state(rng) | {"rotor_speeds": np.full(4, 400.0), "wind": np.zeros(3)}
    pieces = rng.uniform(380.0, 520.0, (PIECES, 4))
    found: dict[str, Any] = {"states": states, "commands": commands}
    found |= {"start": start, "pieces": pieces, "length": LENGTH}
    for name, aero in (("still", False), ("air", True)):
        robot = Multirotor(parameters, aero=aero, integrator_kwargs=EXACT)
        rates = [
            robot._s_dot_fn(0.0, Multirotor._pack_state(state), command)
            for state, command in zip(states, commands, strict=True)
        ]
        flown, state = [], start
        for command in pieces:
            state = robot.step(state, {"cmd_motor_speeds": command}, LENGTH)
            flown.append(state)
        found[name] = {"rates": rates, "flown": flown}
    found["parameters"] = parameters
    return found


def crazyflie() -> dict[str, Any]:
    """The first principles of drone-models for a Crazyflie, without drag and inertia of rotors."""
    model = parametrize(dynamics, drone_model="cf2x_L250")
    numbers = {**model.keywords, "drag_matrix": np.zeros((3, 3)), "prop_inertia": np.array(0.0)}
    rng = np.random.default_rng(1)
    names = "x", "q", "v", "w"
    states = [[random_state(rng)[name] for name in names] for _ in range(STATES)]
    speeds, commands = rng.uniform(8e3, 22e3, (2, STATES, 4))
    ratio = load_params("first_principles", "cf2x_L250")["thrust2torque"]
    proportional = {**numbers, "rpm2torque": ratio * numbers["rpm2thrust"]}
    found: dict[str, Any] = {"states": states, "speeds": speeds, "commands": commands}
    for name, chosen in (("published", numbers), ("proportional", proportional)):
        rates = [
            dynamics(*state, command, speed, **chosen)
            for state, command, speed in zip(states, commands, speeds, strict=True)
        ]
        found[name] = [[rate[2], rate[3], rate[4]] for rate in rates]
    found["parameters"] = {**numbers, "thrust2torque": ratio}
    return found


def plain(value: Any) -> Any:
    """Lists and numbers in place of arrays."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


if __name__ == "__main__":
    for file, made in (("rotorpy", hummingbird()), ("drone_models", crazyflie())):
        text = json.dumps(plain(made))
        (HERE / f"{file}.json").write_text(text + "\n", encoding="utf-8")
