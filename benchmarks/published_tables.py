"""Print how far numbers that others published are off here, as a table of the docs.

`python benchmarks/published_tables.py` takes 13 s of processor time. What is computed stands in
tests, which say how much of it must agree.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from properties import test_actuators, test_operation_counts, test_published  # noqa: E402
from support.derived import derived  # noqa: E402
from support.kept import KEPT_MODULES  # noqa: E402

from gibbs_codegen import read_robot  # noqa: E402
from gibbs_codegen.program.nodes import count_operations  # noqa: E402

FUNCTIONS = {"puma560": "PUMA 560", "ur5": "UR5"}


def digits(found: Any, published: Any) -> str:
    """Digits that agree, of the largest number, at most those of a double."""
    off = np.abs(np.subtract(found, published)).max() / np.abs(published).max()
    return f"{-np.log10(max(off, np.finfo(float).eps)):.1f}"


def compared() -> list[tuple[str, str]]:
    """What was published, and the digits that agree."""
    begun, doubles = test_published.squeezer_at_the_start()
    off = max(map(test_published.share_off, begun, test_published.ACCELERATIONS))
    rounded = np.array(test_published.ACCELERATIONS, float)
    q, v = test_published.squeezed()
    late = ((test_published.END - q) @ v) / (v @ v)
    arms = test_published.arms_that_ship()
    hummingbird = test_actuators.Oracle()
    proportional, curved, _ = test_actuators.beside_drone_models()
    rotorpy = {
        f"Hummingbird by RotorPy, {what}{words}": digits(*beside(air, hummingbird))
        for what, beside in (
            ("accelerations", test_actuators.beside_rotorpy),
            ("a flight", test_actuators.flown_beside_rotorpy),
        )
        for air, words in (("still", ""), ("air", ", with the air of its rotors"))
    }
    return [
        ("Andrews' squeezer, accelerations at the start, with 30 digits", f"{-np.log10(off):.1f}"),
        ("Accelerations of the squeezer in doubles", digits(doubles[:2], rounded)),
        ("Angles of the squeezer after 0.03 s", digits(q, test_published.END)),
        (
            f"Angles of the squeezer, {1e12 * late:.1f} ps later",
            digits(q + late * v, test_published.END),
        ),
        ("PUMA 560, torques of gravity", digits(*test_published.puma_gravity())),
        ("UR5e, pose of the tip", digits(*arms["ur5e"])),
        ("UR5e, potential energy", digits(*arms["energy"])),
        ("Panda, pose of the tip", digits(*arms["panda"])),
        *rotorpy.items(),
        ("Crazyflie by drone-models, accelerations", digits(*proportional)),
        ("Crazyflie by drone-models, accelerations, with its curve of torques", digits(*curved)),
    ]


def counted() -> list[tuple[str, int, int]]:
    """Functions of arms, with operations here and published ones."""
    rows = []
    for name, functions in test_operation_counts.OF_OTHERS.items():
        program = derived(read_robot(str(ROOT / "tests" / "robots" / f"{name}.toml"))[0]).program
        for function, (_, published) in functions.items():
            found = count_operations(program.function(function).nodes()).total
            rows.append((f"{FUNCTIONS[name]}, {function.replace('_', ' ')}", found, published))
    return rows


def main() -> None:
    """Print both tables in Markdown."""
    with tempfile.TemporaryDirectory() as kept:
        os.environ[KEPT_MODULES] = kept
        print("| published numbers | digits that agree |\n|:--|--:|")
        for what, agreed in compared():
            print(f"| {what} | {agreed} |")
        print("\n| operations | here | published | share |\n|:--|--:|--:|--:|")
        for what, found, published in counted():
            print(f"| {what} | {found} | {published} | {found / published:.2f} |")


if __name__ == "__main__":
    main()
