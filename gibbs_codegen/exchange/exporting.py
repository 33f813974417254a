"""From a robot to the text of a file in another format."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, get_args

from gibbs_codegen.exchange.mjcf_export import mjcf_text
from gibbs_codegen.exchange.robot_source import ROOT, source_of, with_free_names
from gibbs_codegen.exchange.source import Source, SourceJoint
from gibbs_codegen.exchange.urdf_export import urdf_text
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import link_label

Format = Literal["urdf", "mjcf"]
FORMATS: tuple[Format, ...] = get_args(Format)
ENDINGS: dict[Format, str] = {"urdf": ".urdf", "mjcf": ".xml"}


def export_robot(robot: Robot, form: Format) -> tuple[str, list[str]]:
    """Text of a robot in another format, and lines on what this has no place for or cannot name."""
    is_urdf = form == "urdf"
    source = source_of(robot)
    lines = [f"left out: {line}" for line in _left_out(robot, source, is_urdf)]
    source, renamed = with_free_names(source, is_urdf)
    text = urdf_text(source) if is_urdf else mjcf_text(source, ROOT)
    return text, [*lines, *renamed]


def _left_out(robot: Robot, source: Source, is_urdf: bool) -> Iterator[str]:
    """Lines on what a format, URDF or else MJCF, has no place for."""
    for joint in source.joints:
        if joint.kind != "fixed" and (lost := _lost(joint, is_urdf)):
            yield f"joint {joint.name}: {' and '.join(lost)}"
    for i in robot.constrained:
        yield f"{link_label(robot, i)}: that a constraint torque holds it; it is welded"
    if any(rotor.spin_inertia for rotor in robot.thrusters):
        yield "spin inertias of rotors"
    if is_urdf:
        if slow := [rotor.name for rotor in source.rotors if rotor.time_constant]:
            yield f"time constants of {', '.join(slow)}"
        if source.gravity != 9.81:
            yield f"gravity of {source.gravity:g} m/s²"


def _lost(joint: SourceJoint, is_urdf: bool) -> list[str]:
    passive, limits = joint.passive, joint.limits
    if is_urdf:
        return [key for key in ("armature", "stiffness") if getattr(passive, key)]
    lost = [] if limits.velocity is None else ["velocity"]
    if (limits.low is None) != (limits.high is None):
        lost.append("limits, since it has one only")
    return lost
