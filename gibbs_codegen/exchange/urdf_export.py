"""URDF of a robot. Rotors are frames that push along z, in a form that `import` finds again."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from gibbs_codegen.exchange.placement import Placement, degrees
from gibbs_codegen.exchange.robot_source import Names
from gibbs_codegen.exchange.source import (
    Inertial,
    Source,
    SourceFrame,
    SourceJoint,
    SourceRotor,
)
from gibbs_codegen.robot.model import Angles3, Vector3

# Readers demand limits; what has none gets some that nothing reaches.
_ENDLESS = 1e16


def urdf_text(source: Source) -> str:
    """The text of a URDF file of a robot with names that a file can hold.

    A rotor is a massless link on a fixed joint that has an `<m_f_rate>`, its drag, and whose limits
    are those of the thrust. A frame is a massless link on a fixed joint.
    """
    root = ET.Element("robot", name=source.name)
    links = Names([*source.links, *(frame.name for frame in source.frames)])
    joints = Names(
        [found.name for found in source.joints] + [found.name for found in source.rotors]
    )
    for link in source.links.values():
        _inertial(ET.SubElement(root, "link", name=link.name), link.inertial)
    for joint in source.joints:
        _joint(root, joint)
    for number, rotor in enumerate(source.rotors, start=1):
        _rotor(root, rotor, links.free(f"thrust{number}"))
    for frame in source.frames:
        _frame(root, frame, joints.free(f"{frame.name}_mount"))
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _inertial(element: ET.Element, inertial: Inertial) -> None:
    if inertial.mass == 0.0 and not inertial.inertia.any():
        return
    found = ET.SubElement(element, "inertial")
    _origin(found, inertial.pose)
    ET.SubElement(found, "mass", value=repr(inertial.mass))
    i = inertial.inertia
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    values = (i[0, 0], i[0, 1], i[0, 2], i[1, 1], i[1, 2], i[2, 2])
    pairs = {name: repr(float(value)) for name, value in zip(names, values, strict=True)}
    ET.SubElement(found, "inertia", pairs)


def _origin(element: ET.Element, pose: Placement) -> None:
    angles = [math.radians(float(angle)) for angle in pose.rpy_deg]
    ET.SubElement(element, "origin", xyz=numbers(pose.xyz), rpy=numbers(angles))


def _joint(root: ET.Element, joint: SourceJoint) -> None:
    limits = joint.limits
    kind = "continuous" if joint.continuous else joint.kind
    element = ET.SubElement(root, "joint", name=joint.name, type=kind)
    _origin(element, joint.pose)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    if joint.kind == "fixed":
        return
    ET.SubElement(element, "axis", xyz=numbers(joint.axis))
    bounds = {} if joint.continuous else {"lower": limits.low, "upper": limits.high}
    given = {**bounds, "effort": limits.effort, "velocity": limits.velocity}
    signs = {"lower": -_ENDLESS}
    texts = {
        key: repr(signs.get(key, _ENDLESS) if value is None else value)
        for key, value in given.items()
    }
    ET.SubElement(element, "limit", texts)
    if joint.passive.damping:
        ET.SubElement(element, "dynamics", damping=repr(joint.passive.damping))


def _rotor(root: ET.Element, rotor: SourceRotor, link: str) -> None:
    """Write a rotor under `<robot>` as a link of such a name and a fixed joint."""
    ET.SubElement(root, "link", name=link)
    element = ET.SubElement(root, "joint", name=rotor.name, type="fixed")
    _origin(element, Placement(rotor.position, _along(rotor.direction)))
    ET.SubElement(element, "parent", link=rotor.on)
    ET.SubElement(element, "child", link=link)
    ET.SubElement(element, "axis", xyz="0 0 1")
    ET.SubElement(element, "m_f_rate", value=repr(rotor.drag))
    if rotor.limits is not None:
        low, high = map(repr, rotor.limits)
        ET.SubElement(element, "limit", lower=low, upper=high, effort="0", velocity="0")


def _along(direction: Vector3) -> Angles3:
    """Angles of a frame whose z points in a direction."""
    x, y, z = direction
    return degrees(math.atan2(-y, math.hypot(x, z))), degrees(math.atan2(x, z)), degrees(0.0)


def _frame(root: ET.Element, frame: SourceFrame, mount: str) -> None:
    """Write a frame under `<robot>` as a link and a fixed joint, `mount`."""
    ET.SubElement(root, "link", name=frame.name)
    element = ET.SubElement(root, "joint", name=mount, type="fixed")
    _origin(element, frame.pose)
    ET.SubElement(element, "parent", link=frame.on)
    ET.SubElement(element, "child", link=frame.name)


def numbers(values: Iterable[float]) -> str:
    """Numbers in full, with spaces between them."""
    return " ".join(repr(float(value) + 0.0) for value in values)
