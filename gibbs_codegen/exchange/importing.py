"""From a file in another format to a robot, stage by stage.

read_urdf, read_mjcf, read_sdf
                      file       → Source: links, joints, rotors, frames
with_root             Source     → checked: a tree, with its root
anchored              Source     → its root the robot's, and how it moves in the world
read_rotors           file       → rotors that replace those found
snapped_source        Source     → with exact angles
locked, rerooted      Source     → with fixed joints, its root the base
welded                Source     → Robot, and what was done
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.exchange.mjcf import read_mjcf
from gibbs_codegen.exchange.sdf import read_sdf
from gibbs_codegen.exchange.sources import Finding, Kind, snapped_source
from gibbs_codegen.exchange.tree import anchored, check_kinds, locked, rerooted, with_root
from gibbs_codegen.exchange.urdf import read_urdf
from gibbs_codegen.exchange.welding import welded
from gibbs_codegen.exchange.xml_file import expanded, parse_xml, read_bytes
from gibbs_codegen.robot.balance import LARGEST_DRAG
from gibbs_codegen.robot.layout import joint_terms
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import link_label, name_from
from gibbs_codegen.robot.parts.base import PLANAR, Attitude, Motion
from gibbs_codegen.robot.parts.rotor import Command
from gibbs_codegen.robot.posture import carried_inertia


@dataclass(frozen=True)
class ImportOptions:
    """The wishes of a user.

    `lock` has where joints are locked, rad or m, by their names; `base` is the link that is the
    base, None for the root, and `motion` what of it moves, None for what the file says; `rotors` is
    a file of rotors that replace those found; `snap` whether angles are made exact and noise is set
    to zero; `command` what motors of Gazebo are commanded; `friction` whether dry friction of
    joints is taken; `arguments` values of those of xacro, by their names.
    """

    attitude: Attitude
    rotors: Path | None = None
    lock: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None
    snap: bool = True
    command: Command = "thrust"
    friction: bool = False
    arguments: Mapping[str, object] = field(default_factory=dict)
    motion: Motion | None = None


def import_robot(path: Path, options: ImportOptions) -> tuple[Robot, list[Finding]]:
    """Read a robot from a file in URDF, xacro, MJCF or SDF, and tell what was done.

    Raises `SourceFileError` if the file is refused, and `UsageError` if there is no such file,
    joint or link.
    """
    data, file = read_bytes(path), str(path)
    if path.suffix.lower() == ".xacro":
        data, file = expanded(path, options.arguments), f"{file} (expanded)"
    elif options.arguments:
        words = (
            "NAME:=VALUE is an argument of xacro, and this file does not end in .xacro; leave "
            "it out"
        )
        raise UsageError(f"{printable(path)}: {words}")
    tag = parse_xml(data, file).tag
    if tag == "mujoco":
        source = read_mjcf(path, data, options.base, options.friction)
    elif tag in ("robot", "sdf"):
        read = read_urdf if tag == "robot" else read_sdf
        source = read(data, file, options.command, options.friction)
    else:
        raise UsageError(
            f"{printable(path)}: its root element is <{printable(tag, 40)}>; URDF has <robot>, "
            "MJCF has <mujoco>, SDF has <sdf>"
        )
    source = anchored(with_root(source), options.motion, options.base)
    if options.rotors is not None:
        from gibbs_codegen.exchange.rotor_file import read_rotors  # Late: it imports pydantic.

        source = replace(source, rotors=read_rotors(options.rotors, source))
    if options.snap:
        source = snapped_source(source)
    source = locked(source, options.lock)
    check_kinds(source)
    if options.base is not None:
        source = rerooted(source, options.base, options.motion is not None)
    name = name_from(source.name or path.name.split(".")[0])
    robot, findings = welded(source, name, options.attitude, options.snap)
    for rotor in source.rotors:
        command, limits, unit = "", rotor.limits, "N"
        if rotor.drive.command != "thrust":
            command, limits = rotor.drive.command, rotor.drive.limits
            unit = "rad/s" if command == "speed" else ""
        bounds = "" if limits is None else f"{limits[0]:g} to {limits[1]:g} {unit}"
        properties = [f"on {rotor.link}", f"drag {rotor.drag:g} m", f"{command} {bounds}".strip()]
        detail = f"{', '.join(filter(None, properties))} ({rotor.evidence})"
        findings.append(Finding("rotor", rotor.name, detail))
        if abs(rotor.drag) > LARGEST_DRAG:
            detail = f"a drag of {rotor.drag:g} m is large; check its factor"
            findings.append(Finding("note", rotor.name, detail))
    if options.command == "speed" and not any(rotor.has_drive for rotor in source.rotors):
        words = "--command speed needs motors of Gazebo, and FILE has none; leave it out"
        findings.append(Finding("note", "rotors", words))
    findings += _rubbing_joints(robot)
    findings += _light_joints(robot)
    # A wheel, or a rotor, carries nothing that moves.
    carriers = {joint.parent for joint in source.joints if joint.kind != "fixed"}
    ends = [joint for joint in source.joints if joint.child not in carriers]
    endless = ", ".join(joint.name for joint in ends if joint.continuous)
    if endless and robot.base.motion == PLANAR:
        words = "not imported; write [[wheel]] tables by hand for joints of rolling wheels, with "
        words += 'drive = "differential" in [base] if it does not slip sideways; '
        words += f"these joints turn without end: {endless}"
        findings.append(Finding("note", "wheels", words))
    if not source.rotors and robot.base.moves_freely:
        hint = f"; these joints turn without end: {endless}" if endless else ""
        words = f"not found; give them with --rotors FILE{hint}"
        findings.append(Finding("note", "rotors", words))
    return robot, [*source.findings, *findings]


def _rubbing_joints(robot: Robot) -> Iterator[Finding]:
    """Notes of joints whose dry friction was taken."""
    for i in robot.moving:
        if friction := robot.links[i - 1].friction:
            terms = joint_terms(robot, i)
            words = f"dry friction {friction.coulomb:g} {terms.effort_unit}; its velocity, here "
            words += f"{friction.velocity:g} {terms.unit}/s, is a guess, which affects step sizes"
            yield Finding("note", link_label(robot, i), words)


# Inertia of a joint, kg m², below which gears of a servo add more.
_LIGHT = 1e-3


def _light_joints(robot: Robot) -> list[Finding]:
    """A note of joints that turn little, as if no gears turned with them and torques moved them."""
    light = {}
    for i in robot.moving:
        link = robot.links[i - 1]
        if link.joint == "revolute" and not (link.passive.armature or link.servo or link.motor):
            light[i] = carried_inertia(robot, i)
    light = {i: inertia for i, inertia in light.items() if inertia < _LIGHT}
    if not light:
        return []
    least = min(light, key=lambda i: light[i])
    servo = "stiffness = …, damping = …"
    if effort := robot.links[least - 1].limits.effort:
        stiffness = effort / math.radians(5.0)
        damping = 2.0 * math.sqrt(stiffness * max(light[least], 0.0))
        servo = f"stiffness = {stiffness:.3g}, damping = {damping:.2g}"
    names = [link_label(robot, i) for i in light]
    many = len(names) > 1
    turned = f"{min(light.values()):.2g}" + f" to {max(light.values()):.2g}" * many
    words = (
        f"turn{'s' * (not many)} {turned} kg m² and would be moved by torques alone: if "
        f"{'servos drive them' if many else 'a servo drives it'}, give servo = {{ {servo} }} "
        f"(N m/rad, N m s/rad{'; for the least' * many}), and armature for the inertia of gears"
    )
    return [Finding("note", ", ".join(names), words)]


# In the order of a report, with what they mean.
KINDS: dict[Kind, str] = {
    "base": "what all links hang on, and how it moves",
    "attached": "an arm that it carries",
    "welded": "part of what carries it",
    "locked": "a joint held fast",
    "snapped": "made exact",
    "rotor": "taken for a rotor",
    "gear": "a joint that another moves",
    "motor": "what drives a joint by gears",
    "constraint": "what may hold a frame",
    "left out": "not imported",
    "note": "worth a look",
}
_WIDTH = 99
# Most characters of a finding.
MOST_TOLD = 240


def in_order(findings: Sequence[Finding]) -> list[Finding]:
    """Lines of a report, by what was done."""
    order = list(KINDS)
    return sorted(findings, key=lambda line: order.index(line.kind))


def opening_comment(source: str, findings: Sequence[Finding]) -> str:
    """The comment with which an imported robot file begins, with an empty line after it."""
    lines = [f"Imported from {printable(source, 80)} by gibbs-codegen import."]
    for kind in KINDS:
        lines_of_kind = [line for line in findings if line.kind == kind]
        if kind in ("welded", "locked", "snapped") and lines_of_kind:
            names = ", ".join(dict.fromkeys(printable(line.subject, 60) for line in lines_of_kind))
            lines.append(f"{kind.capitalize()}: {names}.")
        elif kind not in ("rotor", "gear", "motor", "constraint") and lines_of_kind:
            subjects = [
                f"{printable(line.subject, 60)} ({printable(line.detail, MOST_TOLD)})"
                for line in lines_of_kind
            ]
            lines.append(f"{kind.capitalize()}: {', '.join(subjects)}.")
    wrapped = [
        part for line in lines for part in textwrap.wrap(line, _WIDTH - 2, subsequent_indent="  ")
    ]
    return "".join(f"# {line}\n" for line in wrapped) + "\n"
