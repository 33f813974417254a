"""From a file in another format to a robot, stage by stage.

read_urdf, read_mjcf  file       → Source: links, joints, rotors, frames
with_root             Source     → checked: a tree, with its root
without_anchor        Source     → its root the robot's, and not the world
read_rotors           file       → rotors that replace those found
snapped_source        Source     → with exact angles
locked, rerooted      Source     → with fixed joints, its root the base
welded                Source     → Robot, and what was done
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.exchange.mjcf import read_mjcf
from gibbs_codegen.exchange.sources import Finding, Kind, snapped_source
from gibbs_codegen.exchange.tree import check_kinds, locked, rerooted, with_root, without_anchor
from gibbs_codegen.exchange.urdf import read_urdf
from gibbs_codegen.exchange.welding import welded
from gibbs_codegen.exchange.xml_file import expanded, parse_xml, read_bytes
from gibbs_codegen.robot.balance import LARGEST_DRAG
from gibbs_codegen.robot.model import Attitude, Robot
from gibbs_codegen.robot.names import name_from


@dataclass(frozen=True)
class ImportOptions:
    """What a user may ask for.

    `lock` has where joints are locked, rad or m, by their names; `base` is the link that is the
    base, None for the root; `rotors` a file of rotors that replace those found; `snap` whether
    angles are made exact and noise is set to zero.
    """

    attitude: Attitude
    rotors: Path | None = None
    lock: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None
    snap: bool = True


def import_robot(path: Path, options: ImportOptions) -> tuple[Robot, list[Finding]]:
    """Read a robot from a file (.urdf, .xacro, or .xml for MJCF or URDF), and tell what was done.

    Raises `SourceFileError` if the file is refused, and `UsageError` if there is no such file,
    joint or link.
    """
    data, file = read_bytes(path), str(path)
    if path.suffix.lower() == ".xacro":
        data = expanded(path)
    tag = parse_xml(data, file).tag
    if tag == "mujoco":
        source = read_mjcf(path, data, options.base)
    elif tag == "robot":
        source = read_urdf(data, file)
    else:
        raise UsageError(
            f"{printable(path)}: its root element is <{printable(tag, 40)}>; URDF has <robot>, "
            "MJCF has <mujoco>"
        )
    source = without_anchor(with_root(source))
    if options.rotors is not None:
        from gibbs_codegen.exchange.rotor_file import read_rotors  # Late: it imports pydantic.

        source = replace(source, rotors=read_rotors(options.rotors, source))
    if options.snap:
        source = snapped_source(source)
    source = locked(source, options.lock)
    check_kinds(source)
    if options.base is not None:
        source = rerooted(source, options.base)
    name = name_from(source.name or path.name.split(".")[0])
    robot, findings = welded(source, name, options.attitude, options.snap)
    for rotor in source.rotors:
        limits = "" if rotor.limits is None else f", {rotor.limits[0]:g} to {rotor.limits[1]:g} N"
        detail = f"on {rotor.on}, drag {rotor.drag:g} m{limits} ({rotor.found_by})"
        findings.append(Finding("rotor", rotor.name, detail))
        if abs(rotor.drag) > LARGEST_DRAG:
            detail = f"a drag of {rotor.drag:g} m is large; check its factor"
            findings.append(Finding("note", rotor.name, detail))
    if not source.rotors:
        endless = ", ".join(joint.name for joint in source.joints if joint.continuous)
        hint = f"; these joints turn without end: {endless}" if endless else ""
        findings.append(
            Finding("note", "rotors", f"none were found; --rotors FILE gives them{hint}")
        )
    return robot, [*source.findings, *findings]


# In the order of a report, with what they mean.
KINDS: dict[Kind, str] = {
    "base": "the flying base",
    "attached": "an arm that it carries",
    "welded": "part of what carries it",
    "locked": "a joint held fast",
    "snapped": "made exact",
    "rotor": "taken for a rotor",
    "left out": "not imported",
    "note": "worth a look",
}
_WIDTH = 99


def in_order(findings: Sequence[Finding]) -> list[Finding]:
    """Lines of a report, by what was done."""
    order = list(KINDS)
    return sorted(findings, key=lambda line: order.index(line.kind))


def opening_comment(source: str, findings: Sequence[Finding]) -> str:
    """The comment with which an imported robot file begins, with an empty line after it."""
    lines = [f"Imported from {printable(source, 80)} by gibbs-codegen import."]
    for kind in KINDS:
        found = [line for line in findings if line.kind == kind]
        if kind in ("welded", "locked", "snapped") and found:
            names = ", ".join(dict.fromkeys(printable(line.subject, 60) for line in found))
            lines.append(f"{kind.capitalize()}: {names}.")
        elif kind != "rotor" and found:
            each = [f"{printable(line.subject, 60)} ({printable(line.detail)})" for line in found]
            lines.append(f"{kind.capitalize()}: {', '.join(each)}.")
    wrapped = [
        part for line in lines for part in textwrap.wrap(line, _WIDTH - 2, subsequent_indent="  ")
    ]
    return "".join(f"# {line}\n" for line in wrapped) + "\n"
