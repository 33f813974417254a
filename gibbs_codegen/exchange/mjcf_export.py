"""MJCF of a robot: rotors are sites with motors whose gears are a force and the torque with it.

MuJoCo has no moving body without mass: such links give their joints to the link that follows.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.exchange.export_names import Names
from gibbs_codegen.exchange.placement import HERE, Placement
from gibbs_codegen.exchange.source import Inertial, Source, SourceJoint, SourceRotor
from gibbs_codegen.exchange.urdf_text import numbers
from gibbs_codegen.robot.rigid_body import inertia_fault


def mjcf_text(source: Source, root: str) -> str:
    """The text of an MJCF file of a robot with names that a file can hold."""
    writer = _Writer(source)
    top = ET.Element("mujoco", model=source.name)
    ET.SubElement(top, "compiler", angle="radian", autolimits="true", fusestatic="false")
    ET.SubElement(top, "option", gravity=f"0 0 {-source.gravity!r}")
    world = ET.SubElement(top, "worldbody")
    writer.body(world, root, [(None, HERE)])
    actuator = ET.SubElement(top, "actuator")
    for rotor in source.rotors:
        writer.rotor(actuator, rotor)
    for joint in source.joints:
        if joint.kind != "fixed":
            writer.motor(actuator, joint)
    for frame in source.frames:
        place = {"pos": numbers(frame.pose.xyz), "quat": _quaternion(frame.pose)}
        site = {"name": frame.name, **place}
        ET.SubElement(writer.place_of(frame.on, frame.name), "site", site)
    ET.indent(top)
    return ET.tostring(top, encoding="unicode") + "\n"


# A joint with the placement of its frame in that of the carrying body; None for the root's.
_Group = list[tuple[SourceJoint | None, Placement]]


class _Writer:
    """Writes bodies, and knows where they are in the document."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._below: dict[str, list[SourceJoint]] = {}
        for joint in source.joints:
            self._below.setdefault(joint.parent, []).append(joint)
        self._bodies: dict[str, ET.Element] = {}
        self._joints = Names(joint.name for joint in source.joints)
        self._sites = Names(frame.name for frame in source.frames)
        self._actuators = Names(rotor.name for rotor in source.rotors)

    def body(self, parent: ET.Element, name: str, group: _Group) -> None:
        """Write a body and what hangs on it.

        `group` are the joints that move it, its own last, each with its frame in the carrying
        body's. Raises `UsageError` if the body moves and has no mass, and not one link follows it.
        """
        inertial, below = self._source.links[name].inertial, self._below.get(name, [])
        (joint, frame) = group[-1]
        if joint is not None and joint.kind != "fixed" and not _weighs(inertial):
            if len(below) == 1:
                further = [*group, (below[0], frame @ below[0].pose)]
                self.body(parent, below[0].child, further)
                return
            raise UsageError(
                f"link {printable(name, 60)} moves and has no mass, and not one link follows it; "
                "MuJoCo has no such body: give it mass, or export URDF"
            )
        place = {"pos": numbers(frame.xyz), "quat": _quaternion(frame)}
        element = ET.SubElement(parent, "body", {"name": name, **place})
        self._bodies[name] = element
        if joint is None:
            ET.SubElement(element, "freejoint", name=self._joints.free("root"))
        _inertial(element, name, inertial)
        for moved, its_frame in group:
            if moved is not None and moved.kind != "fixed":
                _joint(element, moved, frame.inverse @ its_frame)
        for found in below:
            self.body(element, found.child, [(found, found.pose)])

    def rotor(self, actuator: ET.Element, rotor: SourceRotor) -> None:
        """Write a rotor as a site and a motor, this into the element that holds motors."""
        site = self._sites.free(rotor.name)
        element = self.place_of(rotor.on, rotor.name)
        ET.SubElement(element, "site", name=site, pos=numbers(rotor.position))
        push = np.array(rotor.direction)
        given = {
            "name": rotor.name,
            "site": site,
            "gear": numbers([*push, *(rotor.drag * push)]),
        }
        if rotor.limits is not None:
            given["ctrlrange"] = numbers(rotor.limits)
        if rotor.time_constant:
            given |= {"dyntype": "filterexact", "dynprm": repr(rotor.time_constant)}
        ET.SubElement(actuator, "general" if rotor.time_constant else "motor", given)

    def motor(self, actuator: ET.Element, joint: SourceJoint) -> None:
        """Write the motor of a joint into the element that holds motors."""
        given = {"name": self._actuators.free(f"tau_{joint.name}"), "joint": joint.name}
        if (effort := joint.limits.effort) is not None:
            given["ctrlrange"] = numbers((-effort, effort))
        ET.SubElement(actuator, "motor", given)

    def place_of(self, link: str, what: str) -> ET.Element:
        """The body of a link that `what` is to be placed on.

        Raises `UsageError` if the link has no body of its own.
        """
        if link not in self._bodies:
            raise UsageError(
                f"{printable(what, 60)} is on link {printable(link, 60)}, which has no mass and no "
                "body in MuJoCo; export URDF"
            )
        return self._bodies[link]


def _weighs(inertial: Inertial) -> bool:
    return inertial.mass > 0.0 or bool(inertial.inertia.any())


def _inertial(element: ET.Element, name: str, inertial: Inertial) -> None:
    """Write the inertia of a link into its body; raises `UsageError` if MuJoCo would refuse it."""
    if not _weighs(inertial):
        return
    i = inertial.inertia
    entries = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    if fault := inertia_fault(inertial.mass, entries):
        raise UsageError(
            f"the inertia of link {printable(name, 60)} {fault}, and MuJoCo refuses it; export URDF"
        )
    moments, axes = np.linalg.eigh(i)
    place = inertial.pose.matrix @ axes * np.linalg.det(axes)
    given = {
        "pos": numbers(inertial.pose.xyz),
        "mass": repr(inertial.mass),
        "diaginertia": numbers(np.maximum(moments, 0.0)),
        "xyaxes": numbers(place.T[:2].ravel()),
    }
    ET.SubElement(element, "inertial", given)


def _joint(element: ET.Element, joint: SourceJoint, frame: Placement) -> None:
    """Write a joint into the body that it moves.

    `frame` is its frame in the body's, its coordinate and those after it at zero.
    """
    passive, limits = joint.passive, joint.limits
    given = {
        "name": joint.name,
        "type": "slide" if joint.kind == "prismatic" else "hinge",
        "axis": numbers(frame.matrix @ np.array(joint.axis)),
        "pos": numbers(frame.xyz),
    }
    for key, value in (
        ("damping", passive.damping),
        ("armature", passive.armature),
        ("stiffness", passive.stiffness),
        ("springref", passive.rest),
    ):
        if value:
            given[key] = repr(value)
    if limits.low is not None and limits.high is not None:
        given["range"] = numbers((limits.low, limits.high))
    ET.SubElement(element, "joint", given)


def _quaternion(pose: Placement) -> str:
    """The rotation as w x y z."""
    half = [math.radians(float(angle)) / 2 for angle in pose.rpy_deg]
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, half), map(math.sin, half)
    return numbers(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )
