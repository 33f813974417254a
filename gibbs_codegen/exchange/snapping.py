"""Angles that were meant to be multiples of 15°, and numbers that are rounding or CAD noise.

A robot file's angles are structural: 1.5708 for 90° makes terms of 1e-6 that the equations then
carry everywhere.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np

from gibbs_codegen.exchange.placement import Array, Placement, vector
from gibbs_codegen.exchange.source import Source, SourceJoint, Told
from gibbs_codegen.robot.model import Vector3

SNAP = 2e-5
_SNAP_DEG = Fraction(math.degrees(SNAP))
# Lengths in m, and products of inertia in parts of the trace, that nobody has measured.
_NOISE = 1e-12


def snapped_source(source: Source) -> Source:
    """A file with every angle and axis exact; it tells of each that changes."""
    told = list(source.told)

    def tell(name: str, before: Placement | Vector3, after: Placement | Vector3) -> None:
        if (old := _shown(before)) != (new := _shown(after)):
            told.append(Told("snapped", name, f"{old} to {new}"))

    joints = [_snapped_joint(joint) for joint in source.joints]
    for joint, exact in zip(source.joints, joints, strict=True):
        tell(joint.name, joint.pose, exact.pose)
        tell(joint.name, joint.axis, exact.axis)
    links = {
        name: replace(link, inertial=replace(link.inertial, pose=snapped(link.inertial.pose)))
        for name, link in source.links.items()
    }
    for name, link in source.links.items():
        tell(f"inertia of {name}", link.inertial.pose, links[name].inertial.pose)
    frames = [replace(frame, pose=snapped(frame.pose)) for frame in source.frames]
    for frame, made in zip(source.frames, frames, strict=True):
        tell(frame.name, frame.pose, made.pose)
    rotors = [replace(rotor, direction=_snapped_axis(rotor.direction)) for rotor in source.rotors]
    for rotor, turned in zip(source.rotors, rotors, strict=True):
        tell(rotor.name, rotor.direction, turned.direction)
    return replace(
        source,
        joints=tuple(joints),
        links=links,
        frames=tuple(frames),
        rotors=tuple(rotors),
        told=tuple(told),
    )


def _snapped_joint(joint: SourceJoint) -> SourceJoint:
    axis = joint.axis if joint.kind == "fixed" else _snapped_axis(joint.axis)
    return replace(joint, pose=snapped(joint.pose), offset=snapped(joint.offset), axis=axis)


def snapped(pose: Placement) -> Placement:
    """The pose, its angles that are all but multiples of 15° made exact; itself if none is."""
    roll, pitch, yaw = map(_snapped_angle, pose.rpy_deg)
    exact = (roll, pitch, yaw)
    if abs(pitch) == 90 and not all(angle % 15 == 0 for angle in exact):
        # Here roll and yaw turn about one axis: what counts is their sum or difference.
        roll = _snapped_angle(roll - yaw if pitch == 90 else roll + yaw)
        exact = (roll, pitch, Fraction(0))
    return pose if exact == pose.rpy_deg else Placement(pose.xyz, exact)


def _snapped_angle(angle: Fraction) -> Fraction:
    multiple = Fraction(15 * round(angle / 15))
    return multiple if abs(angle - multiple) <= _SNAP_DEG else angle


def _snapped_axis(axis: Vector3) -> Vector3:
    """The axis, or the coordinate axis that it all but is."""
    k = int(np.argmax(np.abs(axis)))
    if sum(abs(value) > SNAP for value in axis) > 1:
        return quiet(axis)
    exact = [0.0, 0.0, 0.0]
    exact[k] = math.copysign(1.0, axis[k])
    return vector(exact)


def quiet(values: Vector3) -> Vector3:
    """Lengths in m, or components of a unit vector, (3): what is below 1e-12 is set to 0."""
    return vector([0.0 if abs(value) < _NOISE else value for value in values])


def quiet_inertia(matrix: Array) -> Array:
    """An inertia (3, 3) whose products below 1e-12 of its trace are set to 0."""
    noise = np.abs(matrix) < _NOISE * abs(np.trace(matrix))
    found: Array = np.where(noise & ~np.eye(3, dtype=bool), 0.0, matrix)
    return found


def _shown(value: Placement | Vector3) -> str:
    """The angles of a pose in degrees, or an axis."""
    if isinstance(value, Placement):
        return "rpy_deg " + " ".join(f"{float(angle):.9g}" for angle in value.rpy_deg)
    return "axis " + " ".join(f"{number:.9g}" for number in value)
