"""Scenario files: TOML text in, a checked `Scenario` out, or every fault of the file at once.

Lengths in m, times in s, angles in degrees where a key ends in `_deg`.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path as FilePath
from typing import Any, TypeVar, get_args

import numpy as np

from gibbs_codegen.errors import Fault, ScenarioFileError, UsageError, printable
from gibbs_codegen.files.toml import checked, file_text
from gibbs_codegen.files.toml_depth import MAX_DEPTH, TOO_DEEP
from gibbs_codegen.files.toml_table import Table, shown
from gibbs_codegen.robot.layout import JOINT_TERMS, joint_kind
from gibbs_codegen.robot.model import JointKind
from gibbs_codegen.scenario.orientation import Level, Tangent
from gibbs_codegen.scenario.path_file import read_path
from gibbs_codegen.scenario.paths import Path, Sum
from gibbs_codegen.scenario.scenario import (
    ArmTask,
    Control,
    Law,
    Method,
    Motors,
    Scenario,
    Settings,
    StartOffset,
    TipForce,
)

MIN_DURATION, MAX_DURATION = 1e-3, 3600.0
MAX_SAMPLES, MAX_STEPS = 1_000_000, 100_000_000
Made = TypeVar("Made")

TABLES = ("base", "arm", "start", "control", "motors", "tip_force", "integration", "parameters")
_LEAST = 1e-9  # of what has to be greater than zero
_MOST = 1e12  # of any number: no unit makes one so large of what flies
_MOST_FREQUENCY, _MOST_DAMPING, _MOST_TOLERANCE = 1e4, 1e4, 0.1
_LONGEST_NAME = 200


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
    try:
        return checked(text, source, _scenario, ScenarioFileError, _plain(changes or {}))
    except RecursionError:
        raise ScenarioFileError(source, [Fault("", TOO_DEEP)]) from None


def changes_of(entries: Sequence[str]) -> dict[str, Any]:
    """Changes for `read_scenario` out of entries such as `start.offset=[0.2,0,0]`, in TOML.

    A value that is not TOML is taken as a string, so that quotes may be left out; none at all
    takes the entry away. Raises `UsageError`.
    """
    changes: dict[str, Any] = {}
    for entry in entries:
        key, equals, value = entry.partition("=")
        if not equals:
            raise UsageError(f"{_printable(entry)}: must be KEY=VALUE, such as duration=5")
        one = _one_entry(key, value) or _one_entry(key, _quoted(value))
        if one and not value.strip():
            one = _taken_away(one)
        if not one:  # What begins with # is a comment of TOML, and no entry.
            raise UsageError(f"{_printable(entry)}: not a key, such as start.offset, before the =")
        _add(changes, one)
    return changes


def _add(changes: dict[str, Any], more: Mapping[str, Any]) -> None:
    for key, value in more.items():
        if isinstance(value, dict) and isinstance(changes.get(key), dict):
            _add(changes[key], value)
        else:
            changes[key] = value


def _taken_away(entry: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _taken_away(value) if isinstance(value, dict) else None for key, value in entry.items()
    }


def _plain(value: Any) -> Any:
    """Values as TOML has them: lists of tuples and of NumPy's arrays."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _one_entry(key: str, value: str) -> dict[str, Any] | None:
    if key.count(".") >= MAX_DEPTH or "\n" in key:
        return None
    try:
        return tomllib.loads(f"{key} = {value}")
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        return None


def _quoted(text: str) -> str:
    """Text as a string of TOML, whatever it holds."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _not_found(path: FilePath) -> str:
    return (
        f"{printable(path)}: no such scenario file, and no scenario of that name ships "
        f"({', '.join(shipped_scenarios())})"
    )


def _scenario(root: Table) -> Scenario | None:
    if not _is_plain(root):
        return None
    root.refuse_unknown(("name", "description", "duration", *TABLES))
    name = _text(root, "name", 1)
    description = _text(root, "description", 0) if "description" in root.values else ""
    duration = root.number("duration", 1.0)
    if "duration" not in root.values:
        root.fault("duration", "missing: the time to fly, in s")
    elif not MIN_DURATION <= duration <= MAX_DURATION:
        root.fault("duration", f"must be from {MIN_DURATION:g} to {MAX_DURATION:g} s")
    base = root.table("base")
    path, attitude = _base(base) if base is not None else (None, Level())
    arm = _arm(_optional(root, "arm"), path)
    start = _start(_optional(root, "start"))
    control = _control(_optional(root, "control"))
    motors = _motors(_optional(root, "motors"))
    tip_force = _tip_force(_optional(root, "tip_force"))
    integration = _integration(_optional(root, "integration"), duration)
    parameters = _parameters(_optional(root, "parameters"))
    if root.faults or name is None or path is None or description is None:
        return None
    rest = (start, control, motors, tip_force, integration, parameters, description)
    return _made(root, lambda: Scenario(name, duration, path, attitude, arm, *rest), None)


def _is_plain(root: Table) -> bool:
    """Whether a document is not nested too deeply to be read; notes the numbers too large in it."""
    waiting: list[tuple[str, Any, int]] = [("", root.values, 0)]
    while waiting:
        path, value, depth = waiting.pop()
        if depth > MAX_DEPTH:
            root.fault(re.split(r"[.[]", path)[0], TOO_DEEP)
            return False
        if isinstance(value, dict):
            before = f"{path}." if path else ""
            inside = [(f"{before}{_printable(key)}", entry) for key, entry in value.items()]
        elif isinstance(value, list):
            inside = [(f"{path}[{i}]", v) for i, v in enumerate(value)]
        else:
            inside = []
            # What is not finite is told where it is read.
            if isinstance(value, int | float) and _MOST < abs(value) < math.inf:
                root.fault(path, f"must be at most {_MOST:g} in size, not {shown(value)}")
        waiting.extend((at, entry, depth + 1) for at, entry in reversed(inside))
    return True


def _text(root: Table, key: str, least: int) -> str | None:
    """A line of text of `least` or more characters."""
    text = root.text(key)
    if text is None or (text.isprintable() and least <= len(text.strip()) <= _LONGEST_NAME):
        return text
    root.fault(key, f"must be {least} to {_LONGEST_NAME} characters on one line")
    return None


def _number(table: Table, key: str, default: float, least: float, most: float) -> float:
    """An optional number from `least` to `most`."""
    number = table.number(key, default, least=least)
    if number > most:
        table.fault(key, f"must be at most {most:g}, not {shown(number)}")
        return default
    return number


def _printable(name: str) -> str:
    """A name of the file's own, fit for a message."""
    return ascii(name[:40])[1:-1]


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
        arm = attitude.integer("arm", 1, 256) if "arm" in attitude.values else None
        return path, Tangent() if arm is None else Tangent(arm)
    attitude.refuse_unknown(("kind", "heading_deg", "rate_deg"))
    heading, rate = (attitude.number(key, 0.0) for key in ("heading_deg", "rate_deg"))
    return path, Level(math.radians(heading), math.radians(rate))


def _arm(table: Table, base: Path | None) -> ArmTask:
    keys = ("tip", "tip_beside_base")
    by_joint = ("posture", "posture_deg", "guess", "guess_deg", "limits", "limits_deg")
    table.refuse_unknown((*keys, *by_joint))
    given = [k for k in (*keys, "posture", "posture_deg") if k in table.values]
    if len(given) > 1 and not {*given} <= {"posture", "posture_deg"}:
        table.fault(given[1], f"{given[0]} already says what the arm does; give one of them")
    tip: Path | None = None
    for key in keys:
        path_table = table.table(key) if key in table.values else None
        if path_table is not None:
            tip = read_path(path_table)
            if key == "tip_beside_base" and tip is not None and base is not None:
                tip = Sum((base, tip))
    limits = {joint: (low, high) for joint, (low, high) in _by_joint(table, "limits", 2).items()}
    postures = {
        key: {joint: value for joint, (value,) in _by_joint(table, key, 1).items()}
        for key in ("posture", "guess")
        if key in table.values or f"{key}_deg" in table.values
    }
    posture, guess = postures.get("posture"), postures.get("guess")
    if guess is not None and not {*given} & {*keys}:
        table.fault(_form(table, "guess"), "is where the search for a tip path begins; give a tip")
    for joint, value in (posture or {}).items():
        low, high = limits.get(joint, (-math.inf, math.inf))
        if not low <= value <= high:
            table.fault(
                f"{_form(table, 'posture', joint_kind(joint))}.{joint}", "is outside its limits"
            )
    return _made(table, lambda: ArmTask(tip, posture, guess, limits), ArmTask())


def _by_joint(table: Table, key: str, length: int) -> dict[str, tuple[float, ...]]:
    """`length` numbers by joint: m under `key`, degrees under `key`_deg; made m and rad."""
    found: dict[str, tuple[float, ...]] = {}
    forms: tuple[tuple[str, JointKind, float], ...] = (
        (key, "prismatic", 1.0),
        (f"{key}_deg", "revolute", math.radians(1.0)),
    )
    for form, kind, unit in forms:
        entries = table.table(form) if form in table.values else None
        for name, entry in entries.values.items() if entries is not None else ():
            if entries is None or not _is_joint(entries, name, kind):
                continue
            if length == 1:
                found[name] = (entries.number(name, 0.0) * unit,)
                continue
            low, high = entries.check_numbers(name, entry, length, (0.0, 1.0))
            if low >= high:
                entries.fault(name, "the lower limit must be below the upper")
            found[name] = (low * unit, high * unit)
    return found


def _form(table: Table, key: str, kind: JointKind | None = "revolute") -> str:
    """Which of `key` and `key`_deg a table has, and has for a kind of joint if it has both."""
    degrees = f"{key}_deg"
    if key in table.values and degrees in table.values:
        return degrees if kind == "revolute" else key
    return degrees if degrees in table.values else key


def _is_joint(entries: Table, name: str, kind: JointKind) -> bool:
    if joint_kind(name) == kind:
        return True
    turns = kind == "revolute"
    letter = JOINT_TERMS[kind].letter
    other = "in the table without _deg" if turns else "in the table that ends in _deg"
    entries.fault(
        _printable(name),
        f"must be the name of a joint, {letter}_…, here; the other kind of joint belongs {other}",
    )
    return False


def _start(table: Table) -> StartOffset:
    table.refuse_unknown(("offset", "turn_deg"))
    x, y, z = table.numbers("offset", 3, (0.0,) * 3)
    a, b, c = (math.radians(angle) for angle in table.numbers("turn_deg", 3, (0.0,) * 3))
    return StartOffset((x, y, z), (a, b, c))


def _control(table: Table) -> Control:
    table.refuse_unknown(("law", "frequency", "damping_ratio"))
    return Control(
        table.choice("law", get_args(Law), "computed_torque"),
        _number(table, "frequency", Control.frequency, _LEAST, _MOST_FREQUENCY),
        _number(table, "damping_ratio", Control.damping_ratio, 0.0, _MOST_DAMPING),
    )


def _motors(table: Table) -> Motors:
    table.refuse_unknown(("limits", "time_constant"))
    limits = None
    if "limits" in table.values:
        least, most = table.numbers("limits", 2, (0.0, 1.0))
        if least >= most:
            table.fault("limits", "the least thrust must be below the greatest")
        limits = (least, most)
    time_constant = table.number("time_constant", 0.0, least=0.0)
    return _made(table, lambda: Motors(limits, time_constant), Motors())


def _made(table: Table, make: Callable[[], Made], default: Made) -> Made:
    """What `make` makes, or else `default`, with a fault noted if there is none yet."""
    try:
        return make()
    except UsageError as error:
        if not table.faults:
            table.faults.append(Fault(table.path, str(error)))
        return default


def _tip_force(table: Table) -> TipForce | None:
    if not table.values:
        return None
    table.refuse_unknown(("force", "begin", "end"))
    if "force" not in table.values:
        table.fault("force", "missing: [x, y, z] in N, world axes")
    x, y, z = table.numbers("force", 3, (0.0,) * 3)
    begin = table.number("begin", 0.0, least=0.0)
    end = table.number("end", MAX_DURATION)
    if end <= begin:
        table.fault("end", f"must be after begin, {begin:g} s")
    return TipForce((x, y, z), begin, end)


def _integration(table: Table, duration: float) -> Settings:
    default = Settings()
    keys = ("method", "step", "relative_tolerance", "absolute_tolerance", "rate", "divergence")
    table.refuse_unknown(keys)
    settings = Settings(
        table.choice("method", get_args(Method), default.method),
        table.number("step", default.step, least=1e-6),
        # SciPy raises smaller ones to about this.
        _number(table, "relative_tolerance", default.relative_tolerance, 3e-14, _MOST_TOLERANCE),
        _number(table, "absolute_tolerance", default.absolute_tolerance, 1e-16, _MOST_TOLERANCE),
        table.number("rate", default.rate, least=0.1),
        table.number("divergence", default.divergence, least=_LEAST),
    )
    if settings.rate * duration > MAX_SAMPLES:
        table.fault("rate", f"more than {MAX_SAMPLES} samples in {duration:g} s; lower it")
    if settings.method == "rk4" and duration / settings.step > MAX_STEPS:
        table.fault("step", f"more than {MAX_STEPS} steps in {duration:g} s; take longer ones")
    return settings


def _parameters(table: Table) -> dict[str, float]:
    plain = Table({_printable(n): v for n, v in table.values.items()}, table.path, table.faults)
    return {name: plain.number(name, 0.0) for name in plain.values}
