"""A study that no sweep has flown, whose measures depend on its keys in a known way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.flight.sweeps.cases import Case
from gibbs_codegen.flight.sweeps.chunks import REASONS
from gibbs_codegen.flight.sweeps.study import Study

MASS, LAG, TIP, EFFORT = "plant.link1_mass_per_length", "motors.time_constant", "tip", "effort"


def synthetic_study(folder: Path, count: int = 600, robots: int = 1, broken: bool = True) -> Study:
    """A study.

    Args:
        folder: Where it would be kept.
        count: How many cases.
        robots: How many robots.
        broken: Whether some flights stop early, and some fail.

    Returns:
        The study. The tip is as far off as the mass is, in either direction; the effort grows
        with the mass and depends on the law; the lag does nothing.
    """
    random = np.random.default_rng(5)
    types: list[Any] = [("case", "i8"), ("robot", "U16"), ("scenario", "U8")]
    types += [(MASS, "f8"), (LAG, "f8"), ("control.law", "U16"), (TIP, "f8"), (EFFORT, "f8")]
    table = np.zeros(count, [*types, *[(n, "U80") for n in REASONS]])
    table["case"] = np.arange(count)
    table["robot"] = [f"robot{case % robots}" for case in range(count)]
    table["scenario"] = "hover"
    table[MASS] = random.uniform(0.8, 1.2, count)
    table[LAG] = random.choice([0.0, 0.01, 0.02], count)
    table["control.law"] = random.choice(["tracking", "open_loop"], count)
    noise = np.exp(0.3 * random.standard_normal(count))
    table[TIP] = (0.002 + abs(table[MASS] - 1.0)) * noise
    table[EFFORT] = 100.0 * table[MASS] + 3.0 * (table["control.law"] == "open_loop")
    if broken:
        late = random.choice(count, count // 20, replace=False)
        table["stopped"][late] = "at t = 0.31 s: control was lost: x is 20 m off"
        table[TIP][late] *= 40.0
        table["failed"][late[: count // 60]] = "hover.toml: arm: no posture"
        table["stopped"][late[: count // 60]] = ""
        for measure in (TIP, EFFORT):
            table[measure][late[: count // 60]] = np.nan
    keys = (MASS, LAG, "control.law")
    cases = [
        Case(n, str(row["robot"]), "hover", dict(zip(keys, row[list(keys)].item(), strict=True)))
        for n, row in enumerate(table)
    ]
    return Study(folder, cases, table)
