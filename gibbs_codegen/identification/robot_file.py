"""Numbers that were identified, in the text of a robot file, whose comments stay."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from gibbs_codegen.files.toml import key_lines
from gibbs_codegen.flight.sweeps.sources import entry
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.part import Part, file_key
from gibbs_codegen.robot.parts.rotor import POLAR_KEYS
from gibbs_codegen.robot.parts.wheel import Disc
from gibbs_codegen.robot.text import toml_value
from gibbs_codegen.verification.parameters import robot_numbers, with_values

# Keys of rotors that say the same as others.
_FORMS = {"position": POLAR_KEYS}
_FORMS["thrust_curve"] = ("max_thrust", "thrust_model_factor", "thrust_constant")
# How many times at most a file is compared with what it must say.
_ROUNDS = 3
# Parts whose keys are in the table of what has them.
_FLAT = ("body", "pose", "passive", "rolling")


def names_by_keys(text: str) -> dict[str, list[str]]:
    """Names of the numbers that a robot file can say, by the paths of their keys."""
    robot = parse_robot(text)
    marks = {1e9 + k: name for k, name in enumerate(robot_numbers(robot))}
    marked = _keys(with_values(robot, {name: mark for mark, name in marks.items()}))
    return {
        path: [marks[x] for x in np.ravel(value).tolist() if x in marks]
        for path, value in marked.items()
    }


def with_numbers(text: str, changes: Mapping[str, float], words: Mapping[str, str]) -> str:
    """The text of a robot file with parameters by their names changed, and words in comments.

    Raises `RobotFileError` if a robot file must not have such numbers.
    """
    names, source = names_by_keys(text), "the robot file with identified numbers"
    # Fewer digits would make inertias of thin bodies impossible.
    rounded = {n: float(f"{x:.{10 if 'inertia' in n else 6}g}") for n, x in changes.items()}
    robot = with_values(parse_robot(text), rounded)
    wanted = {path: value for path, value in _keys(robot).items() if names[path]}
    # Again, since defaults of keys may follow others; not for ever, where units of keys round.
    for _ in range(_ROUNDS):
        for path, value in sorted(wanted.items() - _keys(parse_robot(text, source)).items()):
            notes = [words[name] for name in dict.fromkeys(names[path]) if name in words]
            text = _edited(text, path, value, notes)
    parse_robot(text, source)
    return text


def _keys(robot: Robot) -> dict[str, Any]:
    """Numbers, and lists of these, of a robot by the paths of keys of its file."""
    base, links = robot.base, [link for link in robot.links if not link.rolling]
    rows = dict[str, Sequence[Any]](link=links, wheel=robot.links[len(links) :])
    rows |= {"rotor": robot.thrusters, "frame": robot.frames, "spring": robot.springs}
    rows["base.arm"] = base.arms[base.shares_one_arm :]
    parts = {f"{key}[{k}]": part for key, row in rows.items() for k, part in enumerate(row)}
    arm = base.arms[0] if base.shares_one_arm else None
    parts |= {"base": base, "base.arm": arm, "battery": robot.battery}
    whole = {f"{path}.{key}": x for path, part in parts.items() if part for key, x in _flat(part)}
    return {"gravity": robot.gravity} | whole


def _flat(part: Part) -> Iterator[tuple[str, Any]]:
    """Keys of a part, and of the parts in it, with their numbers."""
    for field in fields(part):
        value, key = getattr(part, field.name), file_key(part, field.name)
        if isinstance(part, Disc) and key != "mass":  # All that a wheel's table has.
            yield from zip(("inertia_across", "inertia"), part.inertia, strict=False)
        elif isinstance(value, Part):
            prefix = "" if key in _FLAT else f"{key}."
            yield from ((f"{prefix}{inner}", x) for inner, x in _flat(value))
        elif all(isinstance(x, float) for x in (value if isinstance(value, tuple) else [value])):
            yield key, value


def _edited(text: str, path: str, value: Any, notes: list[str]) -> str:
    """A robot file with another value of a key, with notes in its comment."""
    document, lines, rows = tomllib.loads(text), key_lines(text), text.splitlines()
    outer, _, key = path.rpartition(".")
    table = entry(document, outer) if outer else document
    if isinstance(before := table.get(key), list):  # What stays is written as it was.
        value = [a if a == b else b for a, b in zip(before, value, strict=True)]
    table[key] = value
    others = [other for other in _FORMS.get(key, ()) if table.pop(other, None) is not None]

    def has_line(path: str) -> bool:
        """Whether a line begins with a key, and not with that of a table around it."""
        written = rows[lines[path] - 1].partition("=")[0] if path in lines else "["
        return written.strip().rpartition(".")[2] == path.rpartition(".")[2]

    at, own = path, [*filter(has_line, (path, *(f"{outer}.{other}" for other in others)))]
    while at and not own and not (at in lines and rows[lines[at] - 1].lstrip().startswith("[")):
        at = at.rpartition("[" if at.endswith("]") else ".")[0]  # An inline table, or its list.
        own = [at] if at and has_line(at) else []
    begin, name = lines.get(at, 0), path.removeprefix(f"{at}.")
    if own:
        begin = min(lines[one] for one in own) - 1
        written = rows[lines[own[0]] - 1].partition("=")[0].strip().rpartition(".")
        value, name = entry(document, at), "".join([*written[:2], at.rpartition(".")[2]])
    for row in sorted((lines[one] - 1 for one in own), reverse=True):
        end = min([number for number in lines.values() if number > row + 1] or [len(rows) + 1]) - 1
        while not rows[end - 1].partition("#")[0].strip():
            end -= 1
        notes = [*notes, *(old.partition("#")[2].strip() for old in rows[row:end])]
        rows[row:end] = []
    shown = toml_value(value)
    if "." not in at and isinstance(value, list):  # Of tables.
        shown = "".join(["[\n", *(f"    {toml_value(x)},\n" for x in value), "]"])
    note = "; ".join(filter(None, notes))
    rows.insert(begin, f"{name} = {shown}" + (f"  # {note}" if note else ""))
    return "\n".join([*rows, ""])
