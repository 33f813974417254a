"""Scenario files: TOML text in, a checked `Scenario` out, or every fault of the file at once.

Lengths in m, times in s, angles in degrees where a key ends in `_deg`.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path as FilePath
from typing import Any, get_args

from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.simulator.integrate import Method, Settings
from gibbs_codegen.simulator.orientation import Level, Tangent
from gibbs_codegen.simulator.path_file import read_path
from gibbs_codegen.simulator.paths import Path, Sum
from gibbs_codegen.simulator.plant import TipForce
from gibbs_codegen.simulator.scenario import (
    ArmTask,
    Control,
    Disturbance,
    Law,
    Motors,
    Scenario,
)
from gibbs_codegen.toml_document import checked, file_text, merged
from gibbs_codegen.toml_reader import Table, shown

MAX_DURATION = 3600.0
_TABLES = ("base", "arm", "start", "control", "motors", "tip_force", "integration", "parameters")
_LEAST = 1e-9  # of what has to be greater than zero


def shipped_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that ship with the package."""
    folder = resources.files("gibbs_codegen") / "scenarios"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml")))


def read_scenario(name_or_path: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario by file path, or by the name of one that ships.

    `changes` replace entries of the file, in its own form: `{"start": {"offset": [0.2, 0, 0]}}`.
    Raises `ScenarioFileError` for a refused file and `UsageError` where there is none.
    """
    if name_or_path in shipped_scenarios():
        resource = resources.files("gibbs_codegen") / "scenarios" / f"{name_or_path}.toml"
        return parse_scenario(resource.read_text(encoding="utf-8"), f"{name_or_path}.toml", changes)
    path = FilePath(name_or_path)
    text = file_text(path, ScenarioFileError, lambda: _not_found(path))
    return parse_scenario(text, name_or_path, changes)


def parse_scenario(
    text: str, source: str = "scenario", changes: Mapping[str, Any] | None = None
) -> Scenario:
    """Check TOML text and return the scenario.

    Raises `ScenarioFileError` with every fault found; `source` is the name used in its message.
    """
    return checked(text, source, _scenario, ScenarioFileError, changes)


def changes_of(entries: Sequence[str]) -> dict[str, Any]:
    """Changes for `read_scenario` out of entries such as `start.offset=[0.2,0,0]`, in TOML.

    A value that is not TOML is taken as a string, so that quotes may be left out. Raises
    `UsageError`.
    """
    changes: dict[str, Any] = {}
    for entry in entries:
        key, equals, value = entry.partition("=")
        if not equals:
            raise UsageError(f"--set {entry}: must be KEY=VALUE, such as duration=5")
        one = _one_entry(key, value)
        if one is None:
            one = _one_entry(key, json.dumps(value))
        if one is None:
            raise UsageError(f"--set {entry}: {key!r} is not a key, such as start.offset")
        changes = merged(changes, one)
    return changes


def _one_entry(key: str, value: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(f"{key} = {value}")
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        return None


def _not_found(path: FilePath) -> str:
    return (
        f"{str(path)[:80]}: no such scenario file, and no scenario of that name ships "
        f"({', '.join(shipped_scenarios())})"
    )


def _scenario(root: Table) -> Scenario | None:
    root.refuse_unknown(("name", "description", "duration", *_TABLES))
    name = root.text("name")
    description = root.text("description") if "description" in root.values else ""
    duration = root.number("duration", 0.0)
    if "duration" not in root.values:
        root.fault("duration", "missing: the time to fly, in s")
    elif not _LEAST <= duration <= MAX_DURATION:
        root.fault("duration", f"must be more than 0 and at most {MAX_DURATION:g} s")
    base = root.table("base")
    path, attitude = _base(base) if base is not None else (None, Level())
    arm = _arm(_optional(root, "arm"), path)
    start = _start(_optional(root, "start"))
    control = _control(_optional(root, "control"))
    motors = _motors(_optional(root, "motors"))
    tip_force = _tip_force(_optional(root, "tip_force"))
    integration = _integration(_optional(root, "integration"))
    parameters = _parameters(_optional(root, "parameters"))
    if root.faults or name is None or path is None or description is None:
        return None
    return Scenario(
        name,
        duration,
        path,
        attitude,
        arm,
        start,
        control,
        motors,
        tip_force,
        integration,
        parameters,
        description,
    )


def _optional(root: Table, key: str) -> Table:
    """A table that may be left out."""
    return (root.table(key) if key in root.values else None) or Table({}, key, root.faults)


def _base(table: Table) -> tuple[Path | None, Level | Tangent]:
    table.refuse_unknown(("path", "attitude"))
    path_table = table.table("path")
    path = read_path(path_table) if path_table is not None else None
    attitude = table.table("attitude") if "attitude" in table.values else None
    if attitude is None:
        return path, Level()
    kind = attitude.choice("kind", ("level", "tangent"), "level")
    if kind == "tangent":
        attitude.refuse_unknown(("kind", "arm"))
        arm = attitude.integer("arm", 1, 256) if "arm" in attitude.values else 2
        return path, Tangent(arm or 2)
    attitude.refuse_unknown(("kind", "heading_deg", "rate_deg"))
    heading, rate = (attitude.number(key, 0.0) for key in ("heading_deg", "rate_deg"))
    return path, Level(math.radians(heading), math.radians(rate))


def _arm(table: Table, base: Path | None) -> ArmTask:
    table.refuse_unknown(
        (
            "tip",
            "tip_beside_base",
            "posture",
            "posture_deg",
            "guess",
            "guess_deg",
            "limits",
            "limits_deg",
        )
    )
    given = [k for k in ("tip", "tip_beside_base", "posture", "posture_deg") if k in table.values]
    if len(given) > 1 and not {*given} <= {"posture", "posture_deg"}:
        table.fault(given[1], f"{given[0]} already says what the arm does; give one of them")
    tip: Path | None = None
    for key in ("tip", "tip_beside_base"):
        path_table = table.table(key) if key in table.values else None
        if path_table is not None:
            tip = read_path(path_table)
            if key == "tip_beside_base" and tip is not None and base is not None:
                tip = Sum((base, tip))
    limits = _limits(table)
    return ArmTask(tip, _by_joint(table, "posture"), _by_joint(table, "guess"), limits)


def _by_joint(table: Table, key: str) -> dict[str, float] | None:
    """Numbers by joint, m under `key` and degrees under `key`_deg; None where there are none."""
    if key not in table.values and f"{key}_deg" not in table.values:
        return None
    found: dict[str, float] = {}
    for form, prefix in ((key, "d_"), (f"{key}_deg", "theta_")):
        entries = table.table(form) if form in table.values else None
        for name in entries.values if entries is not None else ():
            if entries is not None and _is_joint(entries, name, prefix):
                value = entries.number(name, 0.0)
                found[name] = math.radians(value) if prefix == "theta_" else value
    return found


def _limits(table: Table) -> dict[str, tuple[float, float]]:
    found: dict[str, tuple[float, float]] = {}
    for form, prefix in (("limits", "d_"), ("limits_deg", "theta_")):
        entries = table.table(form) if form in table.values else None
        for name in entries.values if entries is not None else ():
            if entries is None or not _is_joint(entries, name, prefix):
                continue
            low, high = entries.numbers(name, 2, (0.0, 1.0))
            if low >= high:
                entries.fault(name, "the lower limit must be below the upper")
            factor = math.radians(1.0) if prefix == "theta_" else 1.0
            found[name] = (low * factor, high * factor)
    return found


def _is_joint(entries: Table, name: str, prefix: str) -> bool:
    if name.startswith(prefix):
        return True
    other = "in the table without _deg" if prefix == "theta_" else "in the table that ends in _deg"
    entries.fault(
        ascii(name[:40])[1:-1],
        f"must be the name of a joint, {prefix}…, here; the other kind of joint stands {other}",
    )
    return False


def _start(table: Table) -> Disturbance:
    table.refuse_unknown(("offset", "turn_deg"))
    x, y, z = table.numbers("offset", 3, (0.0,) * 3)
    a, b, c = (math.radians(angle) for angle in table.numbers("turn_deg", 3, (0.0,) * 3))
    return Disturbance((x, y, z), (a, b, c))


def _control(table: Table) -> Control:
    table.refuse_unknown(("law", "frequency", "damping_ratio"))
    return Control(
        table.choice("law", get_args(Law), "computed_torque"),
        table.number("frequency", Control.frequency, least=_LEAST),
        table.number("damping_ratio", Control.damping_ratio, least=0.0),
    )


def _motors(table: Table) -> Motors:
    table.refuse_unknown(("limits", "time_constant"))
    limits = None
    if "limits" in table.values:
        least, most = table.numbers("limits", 2, (0.0, 1.0))
        if least >= most:
            table.fault("limits", "the least thrust must be below the greatest")
        limits = (least, most)
    return Motors(limits, table.number("time_constant", 0.0, least=0.0))


def _tip_force(table: Table) -> TipForce | None:
    if not table.values:
        return None
    table.refuse_unknown(("force", "begin", "end"))
    x, y, z = table.numbers("force", 3, (0.0,) * 3)
    begin = table.number("begin", 0.0, least=0.0)
    end = table.number("end", MAX_DURATION)
    if end <= begin:
        table.fault("end", f"must be after begin, {begin:g} s")
    return TipForce((x, y, z), begin, end)


def _integration(table: Table) -> Settings:
    default = Settings()
    keys = ("method", "step", "relative_tolerance", "absolute_tolerance", "rate", "divergence")
    table.refuse_unknown(keys)
    return Settings(
        table.choice("method", get_args(Method), default.method),
        table.number("step", default.step, least=1e-6),
        # SciPy raises smaller ones to about this.
        table.number("relative_tolerance", default.relative_tolerance, least=3e-14),
        table.number("absolute_tolerance", default.absolute_tolerance, least=1e-16),
        table.number("rate", default.rate, least=0.1),
        table.number("divergence", default.divergence, least=_LEAST),
    )


def _parameters(table: Table) -> dict[str, float]:
    for name, value in table.values.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            table.fault(ascii(name[:40])[1:-1], f"must be a number, not {shown(value)}")
    return {name: table.number(name, 0.0) for name in table.values} if not table.faults else {}
