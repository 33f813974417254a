"""Files that say where the rotors are: `[[rotor]]` in TOML, or a platform of eagle_mpc in YAML.

They replace the rotors found in the robot's own file. `on` is a link of that file, also one that
is welded to another; without it, the root.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from gibbs_codegen.errors import Fault, UsageError, near, printable
from gibbs_codegen.exchange.sources import Source, SourceFileError, SourceRotor, refusal
from gibbs_codegen.exchange.xml_file import read_bytes
from gibbs_codegen.files.table import Table, Tables, file_table, key
from gibbs_codegen.files.toml import checked
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.parts.part import taken
from gibbs_codegen.robot.parts.pose import vector
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS, Rotor
from gibbs_codegen.robot.rotations import turn_of_quaternion

_MOST_YAML = 100_000


@file_table
class RotorFileTable(Table):
    """A file of rotors."""

    rotor: Annotated[
        list[Rotor],
        Tables("rotor", MAX_ROTORS, "rotors"),
        key("the rotors, in the order of their thrusts"),
    ]


def read_rotors(path: Path, source: Source) -> tuple[SourceRotor, ...]:
    """Read a file of rotors on the links of a tree: in TOML, or in YAML if its name ends so.

    Raises `SourceFileError` if the file is refused, or a link is unknown.
    """
    try:
        text = read_bytes(path, "a file of rotors").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"not UTF-8 text (byte {error.start}); save it as UTF-8"
        raise refusal(path, message) from None
    is_yaml = path.suffix.lower() in (".yaml", ".yml")
    if is_yaml:
        rotors = _of_yaml(text, path, source)
    else:
        table = checked(text, str(path), RotorFileTable, SourceFileError)
        rotors = tuple(
            SourceRotor(
                **vars(taken(Rotor, rotor)) | {"name": rotor.name or f"rotor_{number}"},
                # "base" is the root, unless there is a link of that name.
                link=source.root if link == "base" and link not in source.links else link,
                evidence=path.name,
            )
            for number, rotor in enumerate(table.rotor, start=1)
            for link in ["base" if rotor.on == BASE else str(rotor.on)]
        )
    there_are = f"; there are {printable(', '.join(source.links), 200)}"
    faults = [
        Fault(
            f"rotor[{i}].on",
            f"there is no link {printable(r.link, 60)}{near(r.link, source.links) or there_are}",
        )
        for i, r in enumerate(rotors)
        if r.link not in source.links
    ]
    if faults:
        raise SourceFileError(str(path), faults)
    return rotors


def _of_yaml(text: str, path: Path, source: Source) -> tuple[SourceRotor, ...]:
    """Rotors of a platform of eagle_mpc; thrust is along z of their frames.

    Raises `UsageError` if PyYAML is not installed, and `SourceFileError` if the file is refused.
    """
    try:
        import yaml
    except ImportError:
        raise UsageError(
            f"{printable(path)}: the package PyYAML is not installed; install it, or write the "
            "rotors as [[rotor]] tables in TOML"
        ) from None
    number = 0
    try:
        if "&" in text:  # Aliases of anchors can expand without end; platforms have none.
            raise UsageError("anchors are not read")
        if len(text) > _MOST_YAML:  # Its parser is slow.
            raise UsageError(f"more than {_MOST_YAML} characters")
        platform = yaml.safe_load(text)["platform"]
        rotors = []
        for number, entry in enumerate(platform["$rotors"], start=1):
            spin = entry["spin_direction"]
            turn = [float(value) for value in entry["orientation"]]
            size = math.hypot(*turn)
            if not 0.0 < size < math.inf:
                raise UsageError("orientation must be a quaternion x, y, z, w, which is not zero")
            x, y, z, w = (value / size for value in turn)
            rotor = SourceRotor(
                name=f"rotor_{number}",
                link=str(platform.get("base_link_name") or source.root),
                position=vector(entry["translation"]),
                direction=vector(turn_of_quaternion(x, y, z, w)[:, 2]),
                drag=float(spin[0] if isinstance(spin, list) else spin)
                * (float(platform["cm"]) / float(platform["cf"])),
                limits=(float(platform["min_thrust"]), float(platform["max_thrust"])),
                evidence=path.name,
            )
            numbers = (*rotor.position, *rotor.direction, rotor.drag, *(rotor.limits or ()))
            if not all(map(math.isfinite, numbers)):
                raise UsageError("a number is not finite")
            rotors.append(rotor)
        return tuple(rotors)
    except Exception as e:  # Whatever its parser, and values of other kinds, raise.
        cause = (
            f"rotor {number}: a value is missing or of another kind" if number else "it has none"
        )
        if isinstance(e, KeyError):
            cause = f"{printable(e.args[0], 40)} is missing"
        elif isinstance(e, yaml.MarkedYAMLError) and e.problem_mark:
            cause = f"line {e.problem_mark.line + 1} is not YAML"
        elif isinstance(e, UsageError):
            cause = str(e)
        raise refusal(
            path,
            f"not a platform file of eagle_mpc ({cause}); it needs a platform with cf, cm, "
            "max_thrust, min_thrust and $rotors, each with translation, orientation and "
            "spin_direction",
        ) from None
