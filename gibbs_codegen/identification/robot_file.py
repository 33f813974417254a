"""Numbers that were identified, in the text of a robot file, whose comments stay."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.toml import key_lines
from gibbs_codegen.flight.sweeps.sources import entry
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.names import identifier, parameter_prefix, rotor_prefix
from gibbs_codegen.robot.parts.numbers import AXIS_PAIRS, XYZ
from gibbs_codegen.robot.text import toml_value

# Keys of rotors that say the same as a thrust curve.
_CURVES = ("max_thrust", "thrust_model_factor", "thrust_constant")
_DIGITS = 6


def with_numbers(text: str, changes: Mapping[str, float], words: Mapping[str, str]) -> str:
    """The text of a robot file with parameters by their names changed, and words in comments.

    Raises `UsageError` for a number that does not stand in the file by itself.
    """
    robot, document = parse_robot(text), tomllib.loads(text)
    tables = {"base": "base", "base_arm": "base.arm"}
    for k in range(1, len(robot.thrusters) + 1):
        tables[rotor_prefix(robot, k)] = f"rotor[{k - 1}]"
    for i in range(1, len(robot.links) + 1):
        prefix, path = parameter_prefix(robot, i), f"link[{i - 1}]"
        tables |= {prefix: path, f"{prefix}_servo": f"{path}.servo"}
        tables |= {f"{prefix}_friction": f"{path}.friction"}
    for k, frame in enumerate(robot.frames):
        tables[f"frame_{identifier(frame.name)}"] = f"frame[{k}]"
    edits = dict[str, list[str]]()  # By path of a key that has a line, the comments on it.
    lines = key_lines(text)
    for name, value in changes.items():
        prefixes = sorted((p for p in tables if name.startswith(f"{p}_")), key=len, reverse=True)
        keys = (
            _changed(entry(document, tables[p]) or {}, name[len(p) + 1 :], value) for p in prefixes
        )
        key, prefix = next(((k, p) for k, p in zip(keys, prefixes, strict=True) if k), ("", ""))
        if not key:
            raise UsageError(
                f"{name}: has no value of its own in the robot file to replace; leave it out "
                "(--free)"
            )
        path = f"{tables[prefix]}.{key}"
        curves = {f"{tables[prefix]}.{k}" for k in _CURVES if key == "thrust_curve"}
        while path not in lines and not curves & lines.keys():  # It is in an inline table.
            path = path.rpartition(".")[0] or path.partition("[")[0]
        edits.setdefault(path, [])
        if name in words:
            edits[path].append(words[name])
    rows: list[str | None] = [*text.splitlines()]
    for path, comments in edits.items():
        key, shown = path.rpartition(".")[2], toml_value(entry(document, path))
        if path == key and isinstance(tables_of_key := document[key], list):
            shown = "".join(["[\n", *(f"    {toml_value(x)},\n" for x in tables_of_key), "]"])
        old = [path.removesuffix(key) + k for k in (key, *_CURVES * (key == "thrust_curve"))]
        for number, row in enumerate([lines[p] - 1 for p in old if p in lines]):
            end = _end(rows, row)
            old_comments = [(r or "").partition("#")[2].strip() for r in rows[row:end]]
            note = "; ".join(filter(None, [*comments, *old_comments]))
            rows[row:end] = [None] * (end - row)
            if number == 0:
                rows[row] = f"{key} = {shown}" + (f"  # {note}" if note else "")
    changed = "\n".join(row for row in rows if row is not None) + "\n"
    parse_robot(changed, "the robot file with identified numbers")
    return changed


def _end(rows: list[str | None], begin: int) -> int:
    """The row behind a key and its value, which may take several."""
    for end in range(begin + 1, len(rows) + 1):
        try:
            tomllib.loads("\n".join(row or "" for row in rows[begin:end]))
        except tomllib.TOMLDecodeError:
            continue
        return end
    raise AssertionError("a file that was read has ends of values")


def _changed(table: dict[str, Any], end: str, value: float) -> str:
    """Change an entry of a table by the end of its name; its key, "" where it has none."""
    value = float(f"{value:.{_DIGITS}g}")
    if end.startswith("thrust_") and end[7:].isdigit() and "command" in table:
        table.setdefault("thrust_curve", [0.0, 0.0, 0.0])[int(end[7:])] = value
        for other in _CURVES:
            table.pop(other, None)
        return "thrust_curve"
    if isinstance(table.get(end), int | float):
        table[end] = value
        return end
    key, _, place = (f"xyz_{end}" if end in XYZ else end).rpartition("_")
    places = {
        **dict(zip(XYZ, range(3), strict=True)),
        **dict(zip(AXIS_PAIRS, range(6), strict=True)),
    }
    if isinstance(table.get(key), list) and (place in places or place.isdigit()):
        table[key][places[place] if place in places else int(place) - 1] = value
        return key
    return ""
