"""The text of an SDF file of a robot, for Gazebo, in a form that `import` finds again.

A rotor is a propeller that spins on a joint of its own, with a motor plugin. Its mass is taken from
the link that carries it, so that the whole is the same. Gazebo takes no link without inertia: what
has none gets so little that nothing shows.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.exchange.sources import (
    NO_BODY,
    NOTHING,
    FreeNames,
    Source,
    SourceBody,
    SourceJoint,
)
from gibbs_codegen.exchange.welding import composite
from gibbs_codegen.exchange.xml_text import along_z, coulomb, inertia_entries, motor_tags, numbers
from gibbs_codegen.robot.parts.body import RigidBody, entries_of, inertia_fault, inertia_matrix
from gibbs_codegen.robot.parts.pose import HERE, Pose
from gibbs_codegen.robot.parts.servo import Servo

_VERSION, _VERSION_OF_GEARS = "1.9", "1.11"
# Shares of the mass of what carries propellers that these get, of which the first is taken that
# leaves a body, and the radius, m, of their discs.
_SHARES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
_RADIUS = 0.1
_RATE = 250


def sdf_text(source: Source, motors: Mapping[str, Mapping[str, object]]) -> str:
    """The text of an SDF file of a robot with names that a file can hold.

    `motors` are the tags of those of rotors, by their names.
    """
    used = [*source.links, *(joint.name for joint in source.joints)]
    used += [rotor.name for rotor in source.rotors]
    names = FreeNames([*used, *(frame.name for frame in source.frames)])
    spins = {rotor.name: names.free(f"{rotor.name}_joint") for rotor in source.rotors}
    geared = any(joint.gear for joint in source.joints)
    top = ET.Element("sdf", version=_VERSION_OF_GEARS if geared else _VERSION)
    model = ET.SubElement(top, "model", name=source.name)
    left, discs = _with_propellers(source)
    carried = {joint.child: joint for joint in source.joints}
    for name in [name for name in source.links if name != "world"]:
        joint = carried.get(name)
        link = _link(model, name, left[name], joint.name if joint else "")
        if joint is None:
            sensor = ET.SubElement(link, "sensor", name="imu_sensor", type="imu")
            _children(sensor, {"always_on": 1, "update_rate": _RATE})
            continue
        axis = _joint(model, joint.name, joint.kind, joint.parent, name, joint.pose)
        if joint.kind != "fixed":
            _properties(axis, joint)
            _children(model[-1], motor_tags(top, joint))
    for rotor in source.rotors:
        pose, spin = Pose(rotor.position, along_z(rotor.direction)), spins[rotor.name]
        _link(model, rotor.name, discs[rotor.name], spin)
        axis = _joint(model, spin, "revolute", rotor.link, rotor.name, pose)
        ET.SubElement(axis, "xyz").text = "0 0 1"
    for frame in source.frames:
        element = ET.SubElement(model, "frame", name=frame.name, attached_to=frame.link)
        _pose(element, frame.pose)
    for rotor in source.rotors:
        tags = {"jointName": spins[rotor.name], **motors[rotor.name]}
        _plugin(model, "multicopter-motor-model", "MulticopterMotorModel", tags)
    for number, joint in enumerate(joint for joint in source.joints if joint.driven):
        _drive(model, number, joint.name, joint.link.servo)
    _plugin(model, "joint-state-publisher", "JointStatePublisher", {})
    ET.indent(top)
    return f'<?xml version="1.0"?>\n{ET.tostring(top, encoding="unicode")}\n'


def _with_propellers(source: Source) -> tuple[dict[str, SourceBody], dict[str, SourceBody]]:
    """Links without the mass of their propellers, and propellers, by their names.

    Raises `UsageError` if a link has an inertia that no body has.
    """
    links: dict[str, SourceBody] = {}
    discs: dict[str, SourceBody] = {}
    for name, link in source.links.items():
        if fault := inertia_fault(link.body.mass, link.body.inertia):
            raise UsageError(
                f"the inertia of link {printable(name, 60)} {fault}, and Gazebo refuses it; "
                "export URDF"
            )
        carried = [rotor for rotor in source.rotors if rotor.link == name]
        places = [Pose(r.position, along_z(r.direction)) for r in carried]
        least = _least_moment(link.body)
        disc, rest = NO_BODY, link
        for share in _SHARES if carried else ():
            disc = _disc(share * link.body.mass / len(carried))
            lost = _disc(-disc.mass)
            parts = [(link.body, link.pose), *((lost, place) for place in places)]
            rest = SourceBody(name, composite(parts, False))
            left = rest.body
            if not inertia_fault(left.mass, left.inertia) and _least_moment(left) > 0.5 * least:
                break
            disc, rest = NO_BODY, link
        links[name] = replace(rest, body=_with_some(rest.body))
        discs |= {rotor.name: SourceBody(rotor.name, _with_some(disc)) for rotor in carried}
    return links, discs


def _disc(mass: float) -> RigidBody:
    """A thin disc across z."""
    moment = mass * _RADIUS**2 / 4.0
    return RigidBody(mass=mass, inertia=(moment, moment, 2.0 * moment, 0.0, 0.0, 0.0))


def _least_moment(body: RigidBody) -> float:
    return float(np.linalg.eigvalsh(inertia_matrix(body.inertia))[0])


def _with_some(body: RigidBody) -> RigidBody:
    """The body, or with so little more mass and inertia that a reader takes it."""
    mass, inertia = max(body.mass, NOTHING), body.inertia
    if _least_moment(body) <= 0.0:
        inertia = entries_of(inertia_matrix(inertia) + NOTHING * np.eye(3))
    return replace(body, mass=mass, inertia=inertia)


def _children(element: ET.Element, values: Mapping[str, object]) -> None:
    """Write what is not None as children with texts, numbers in full."""
    for tag, value in values.items():
        if value is not None:
            ET.SubElement(element, tag).text = (
                repr(value) if isinstance(value, float) else str(value)
            )


def _pose(element: ET.Element, pose: Pose, relative_to: str = "") -> None:
    place = {"relative_to": relative_to} if relative_to else {}
    angles: Iterable[float] = (math.radians(float(angle)) for angle in pose.rpy_deg)
    ET.SubElement(element, "pose", place).text = numbers([*pose.xyz, *angles])


def _link(model: ET.Element, name: str, link: SourceBody, joint: str) -> ET.Element:
    """Write a link, whose frame is that of the joint that carries it where there is one."""
    element = ET.SubElement(model, "link", name=name)
    if joint:
        _pose(element, HERE, joint)
    inertial = ET.SubElement(element, "inertial")
    _pose(inertial, link.seat)
    _children(inertial, {"mass": float(link.body.mass)})
    _children(ET.SubElement(inertial, "inertia"), inertia_entries(link.body))
    return element


def _joint(
    model: ET.Element, name: str, kind: str, parent: str, child: str, pose: Pose
) -> ET.Element:
    """Write a joint with its place in its parent; return its axis or, fixed, itself."""
    element = ET.SubElement(model, "joint", name=name, type=kind)
    _pose(element, pose, "__model__" if parent == "world" else parent)
    _children(element, {"parent": parent, "child": child})
    return element if kind == "fixed" else ET.SubElement(element, "axis")


def _properties(axis: ET.Element, joint: SourceJoint) -> None:
    """Write the axis of a joint, its limits, and what acts on it by itself."""
    link, limits, passive = joint.link, joint.link.limits, joint.link.passive
    bounds = {"lower": limits.low, "upper": limits.high}
    if joint.continuous:
        bounds = {}
    bounds |= {"effort": limits.effort, "velocity": limits.velocity}
    resisting = {"damping": passive.damping, "friction": coulomb(link)}
    resisting |= {"spring_stiffness": passive.stiffness, "spring_reference": passive.rest}
    ET.SubElement(axis, "xyz").text = numbers(link.axis)
    if joint.gear:
        ((mover, ratio),), offset = joint.gear.ratios.items(), joint.gear.offset
        mimic = ET.SubElement(axis, "mimic", joint=mover)
        _children(mimic, {"multiplier": ratio, "offset": offset, "reference": 0.0})
    _children(ET.SubElement(axis, "limit"), bounds)
    _children(ET.SubElement(axis, "dynamics"), {k: v for k, v in resisting.items() if v})


def _plugin(model: ET.Element, file: str, name: str, values: dict[str, object]) -> None:
    """Write a plugin of Gazebo Sim."""
    names = {"filename": f"gz-sim-{file}-system", "name": f"gz::sim::systems::{name}"}
    _children(ET.SubElement(model, "plugin", names), values)


def _drive(model: ET.Element, number: int, joint: str, servo: Servo | None) -> None:
    """Write what drives a joint: a servo by its position or rate, else a torque or force."""
    if servo is None:
        _plugin(model, "apply-joint-force", "ApplyJointForce", {"joint_name": joint})
        return
    by_rate = servo.command == "rate"
    values: dict[str, object] = {
        "joint_name": joint,
        "sub_topic": f"servo_{number}",
        "use_force_commands": "true" if by_rate else None,
        "p_gain": servo.damping if by_rate else servo.stiffness,
        "i_gain": 0.0,
        "d_gain": 0.0 if by_rate else servo.damping,
        "cmd_max": servo.torque,
        "cmd_min": None if servo.torque is None else -servo.torque,
    }
    if by_rate:
        _plugin(model, "joint-controller", "JointController", values)
    else:
        _plugin(model, "joint-position-controller", "JointPositionController", values)
