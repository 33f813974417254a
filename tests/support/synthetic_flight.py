"""To test what shows flights: smooth motion that nobody flew, and the names that axes show."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from matplotlib.text import Annotation
from scipy.spatial.transform import Rotation

from gibbs_codegen.flight.record.flight import Array, Flight


def synthetic_flight(
    module: ModuleType,
    samples: int = 121,
    duration: float = 4.0 * np.pi,
    error: float = 1e-5,
    **changes: object,
) -> Flight:
    """A flight of `module` (attitude x-y-z) along the paper's helix, off by about `error`.

    Joints swing and rotors push as no controller would have them; `changes` replace fields.
    """
    rotors = sum(name.startswith("F_") for name in module.INPUTS)
    time = np.linspace(0.0, duration, samples) if samples > 1 else np.zeros(1)
    desired = _desired(module, time)
    q = desired + error * np.sin(3.0 * time[:, np.newaxis] + np.arange(desired.shape[1]))
    wanted, actual = (np.asarray(module.positions(each)) for each in (desired, q))
    column = {name: i for i, name in enumerate(module.POINTS)}
    angles = -np.pi + 2.0 * np.pi * np.arange(1, rotors) / rotors
    wave = np.sin(time[:, np.newaxis] + np.arange(len(module.INPUTS)))
    commanded = 15.0 + 6.0 * wave
    kinetic, potential = 40.0 + 20.0 * np.sin(time), 90.0 * (np.exp(0.1 * time) - 0.5)
    fields: dict[str, object] = {
        "robot": module.NAME,
        "scenario": "synthetic",
        "law": "computed_torque",
        "control_rate": 0.0,
        "attitude": module.ATTITUDE,
        "coordinates": module.COORDINATES,
        "coordinate_units": module.COORDINATE_UNITS,
        "input_names": module.INPUTS,
        "points": module.POINTS,
        "constraint_names": tuple(f"tau_prime_{k}" for k in range(2, rotors + 1)),
        "tangent_arm": 2,
        "stopped": "",
        "weight": 90.0,
        "time": time,
        "q": q,
        "v": _rate(q, time),
        "a": _rate(_rate(q, time), time),
        "q_desired": desired,
        "v_desired": _rate(desired, time),
        "a_desired": _rate(_rate(desired, time), time),
        "commanded": commanded,
        "applied": np.minimum(commanded, 20.0),
        "commanded_least": commanded - 0.5,
        "commanded_greatest": commanded + 2.0,
        "applied_least": np.minimum(commanded, 20.0) - 0.5,
        "applied_greatest": np.minimum(commanded, 20.0) + 0.5,
        "input_limits": np.array([[-np.inf], [np.inf]]) * np.ones(len(module.INPUTS)),
        "constraint_torques": 0.1 * wave[:, : rotors - 1] * np.arange(1, rotors),
        "base_arm_angles": angles + 1e-9 * wave[:, : rotors - 1],
        "base_arm_angles_desired": angles,
        "positions": actual,
        "parents": _parents(module, column["O2"], rotors),
        "base_rotation": Rotation.from_euler("XYZ", q[:, :3]).as_matrix(),
        "thrust_directions": _thrust_directions(rotors),
        "frames": (),
        "frame_wrenches": np.zeros((len(time), 0, 6)),
        "centre_desired": wanted[:, column["O2"]],
        "tip_desired": wanted[:, column["tip"]],
        "heading_error": error * np.abs(np.cos(time)),
        "kinetic_energy": kinetic,
        "potential_energy": potential,
        "work": kinetic + potential - kinetic[0] - potential[0] + 1e-9 * np.sin(7.0 * time),
    }
    return Flight(**{**fields, **changes})


def names(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.texts if isinstance(text, Annotation)]


def _desired(module: ModuleType, time: Array) -> Array:
    """Level on the paper's path of the base (eq. 20), turning with it, while the joints swing."""
    q = np.zeros((len(time), len(module.COORDINATES)))
    q[:, 0], q[:, 1], q[:, 2] = 0.2 * np.sin(time), 0.15 * np.cos(time), time
    for j, name in enumerate(module.COORDINATES[3:-3]):
        swing = 0.5 * np.sin(0.7 * time + j)
        q[:, 3 + j] = 0.6 + swing if name.startswith("d_") else 0.8 * swing - 1.2 * (j == 1)
    radius = 2.0 * np.exp(-0.05 * time)
    q[:, -3:] = np.stack([radius * np.cos(time), radius * np.sin(time), np.exp(0.1 * time)], axis=1)
    return q


def _parents(module: ModuleType, centre: int, rotors: int) -> Array:
    """Spokes from the base centre, and one arm to the tip."""
    parents = np.arange(-1, len(module.POINTS) - 1)
    parents[: centre + 1] = -1
    parents[centre + 1 : centre + rotors + 2] = centre
    return parents


def _rate(series: Array, time: Array) -> Array:
    rate: Array = np.gradient(series, time, axis=0) if len(time) > 1 else np.zeros_like(series)
    return rate


def _thrust_directions(rotors: int) -> Array:
    """Odd motors along the base normal, even ones across their arm, as the family has it."""
    angles = -np.pi + 2.0 * np.pi * np.arange(rotors) / rotors
    across = np.stack([-np.sin(angles), np.cos(angles), np.zeros(rotors)], axis=1)
    across[::2] = (0.0, 0.0, 1.0)
    return across
