"""How well machines push with a force while they slide along a wall with friction.

The wall yields by 1 mm for each newton, and its friction is 0.5. Each machine pushes, and slides up
by 0.3 m within 3 s; printed are the deviation of the force (RMS), and the greatest of the tip
across the wall, while it slides. Where masses are off, it is the worst of five ways. The quadrotor
pushes under the predictive law too, which makes up for lag by itself.

    python benchmarks/pushing.py
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np

from gibbs_codegen import generate, load, read_scenario, simulate
from gibbs_codegen.runtime.predictive import DERIVATIVES, UNDER_WRENCHES

JOINTS = ["base_link_link_1", *(f"link_{k}_link_{k + 1}" for k in range(1, 5))]
HEXTILT = [f"flying_arm_5__j_{joint}" for joint in JOINTS]
FAST = {joint: {"frequency": 40} for joint in HEXTILT}
GAINS: dict[str, dict[str, Any]] = {
    "hextilt_flying_arm_5": {
        "integral": 0.5,
        "frequency": 10,
        "attitude_frequency": 40,
        "joints": FAST,
        "impedance": {"damping": [120, 40, 40], "inertia": [1] * 3},
    },
    "quadrotor_arm_2link": {
        "integral": 0.5,
        "impedance": {"stiffness": [100] * 3, "damping": [60, 20, 20], "inertia": [1] * 3},
    },
}
# Angles of joints, °: bent so that joints can push, or stretched towards the wall.
POSTURES = {
    "hextilt_flying_arm_5": {HEXTILT[0]: 86.0},
    "quadrotor_arm_2link": {"upper_arm": 12.0, "forearm": 80.0},
}
# Of the base that does not lean by itself: how far it does for a force, °.
LEANS = {("hextilt_flying_arm_5", 5): 15.0, ("hextilt_flying_arm_5", 10): 30.0}
UP = np.array([0.0, 0.0, 0.3])
AT = np.array([0.0, 0.0, 2.0])


def tip_of(module: Any, posture: dict[str, float], lean: float) -> np.ndarray:
    """Where (3), m, the tip is, of a machine that leans by an angle, °, about y."""
    q = np.zeros(len(module.COORDINATES))
    q[4], q[6] = np.sin(np.radians(lean / 2)), np.cos(np.radians(lean / 2))
    for joint, angle in posture.items():
        q[module.COORDINATES.index(joint)] = np.radians(angle)
    return np.asarray(module.frame_poses(q)[module.FRAMES.index("tip"), :3, 3])


def shares(module: Any) -> Iterator[dict[str, float]]:
    """Masses that are 10 % off in some way: all, in turn, or those of the base and of the arm."""
    masses = [name for name in module.PARAMETERS if name.endswith("_mass")]
    arm = np.array([-1.0 if "base" in name else 1.0 for name in masses])
    turns = (-1.0) ** np.arange(len(masses))
    for signs in (np.ones(len(masses)), -np.ones(len(masses)), turns, arm, -arm):
        yield {x: (1 + 0.1 * s) * module.PARAMETERS[x] for x, s in zip(masses, signs, strict=True)}


def flown(
    module: Any, law: str, force: float, plant: dict[str, float], lag: float, compensated: bool
) -> tuple[float, float]:
    """Deviation of the force, N (RMS), and of the tip across the wall, m (greatest)."""
    name = module.NAME
    posture, lean = POSTURES[name], LEANS.get((name, int(force)), 0.0)
    level, leaning = tip_of(module, posture, 0.0), tip_of(module, posture, lean)
    # The tip stands 1 cm before the wall until the machine leans.
    before = AT + leaning - level - [0.01 if lean else 0.02, 0, 0]
    points = [before, AT if lean else before, AT if lean else before]
    points.append(points[-1] + UP)
    push = {"value": force, "direction": [1, 0, 0], "begin": 1, "rise": 2}
    wall = {"frame": "tip", "point": (AT + leaning).tolist(), "normal": [-1, 0, 0]}
    changes: dict[str, Any] = {
        "duration": 9,
        "base.path": {
            "kind": "waypoints",
            "times": [1, 3, 5, 8],
            "points": np.array(points).tolist(),
            "velocities": ["rest"] * 4,
        },
        "arm.posture_deg": posture,
        "control": {"law": law, "force": push} | ({} if law == "predictive" else GAINS[name]),
        "wall": [wall | {"stiffness": 1000, "damping": 20, "friction": 0.5}],
        "motors": {"time_constant": lag, "compensation": compensated},
        "plant": plant,
        "integration": {"method": "rk4", "step": 1e-3},
    }
    if lean:
        axis = {"kind": "turn", "axis": [0, 1, 0], "angle_deg": lean, "begin": 1, "duration": 2}
        changes |= {"base.attitude": axis, "arm.effort": dict.fromkeys(HEXTILT, 5.0)}
    flight = simulate(module, read_scenario("hover", changes))
    if flight.stopped:
        raise SystemExit(f"{name}, {law}, {force:g} N: {flight.stopped}")
    slides = (flight.time >= 5) & (flight.time <= 8)
    place = module.FRAMES.index("tip")
    here, there = (
        module.frame_poses(q)[slides, place, 1:3, 3] for q in (flight.q, flight.q_desired)
    )
    off = flight.wall_forces[slides, 0] - force
    return float(np.sqrt(np.mean(off**2))), float(np.linalg.norm(here - there, axis=1).max())


def main() -> None:
    """Print a table."""
    with tempfile.TemporaryDirectory() as folder:
        flights = [*((name, "force") for name in GAINS), ("quadrotor_arm_2link", "predictive")]
        for name, law in flights:
            derivatives = (*DERIVATIVES, *UNDER_WRENCHES)
            module = load(
                generate(name, folder, derivatives=derivatives, verify=False), backend="c"
            )
            for force in (5.0, 10.0):
                for words, plants, *how in (
                    ("as known, without lag", [{}], 0.0, True),
                    ("masses 10 % off, lag of 20 ms", [*shares(module)], 0.02, True),
                    ("the same, lag not compensated", [*shares(module)], 0.02, False),
                )[: 2 if law == "predictive" else 3]:
                    found = [flown(module, law, force, plant, *how) for plant in plants]
                    rms, off = np.max(found, axis=0)
                    print(
                        f"| `{name}`, {force:g} N, {law} | {words} | {rms:.3f} N "
                        f"| {1e3 * off:.1f} mm |",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
