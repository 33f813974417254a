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
from gibbs_codegen.exchange.motors import Motor
from gibbs_codegen.exchange.placement import HERE, Placement, vector
from gibbs_codegen.exchange.sources import Inertial, Joint, Names, Source
from gibbs_codegen.exchange.welding import composite
from gibbs_codegen.exchange.xml_text import along_z, coulomb, numbers
from gibbs_codegen.robot.parts.body import inertia_fault, inertia_matrix
from gibbs_codegen.robot.parts.servo import Servo

_VERSION = "1.9"
# kg and kg m²: far below the rounding of what robots weigh.
_NOTHING = 1e-13
# Shares of the mass of what carries propellers that these get, of which the first is taken that
# leaves a body, and the radius, m, of their discs.
_SHARES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
_RADIUS = 0.1
_RATE = 250


def sdf_text(source: Source, motors: dict[str, Motor], servos: dict[str, Servo]) -> str:
    """The text of an SDF file of a robot with names that a file can hold, its root the first link.

    `motors` are those of rotors, by their names, and `servos` those of joints that have one.
    """
    used = [*source.links, *(joint.name for joint in source.joints)]
    used += [rotor.name for rotor in source.rotors]
    names = Names([*used, *(frame.name for frame in source.frames)])
    spins = {rotor.name: names.free(f"{rotor.name}_joint") for rotor in source.rotors}
    top = ET.Element("sdf", version=_VERSION)
    model = ET.SubElement(top, "model", name=source.name)
    left, discs = _with_propellers(source)
    for joint in (None, *source.joints):
        name = joint.child if joint else next(iter(source.links))
        link = _link(model, name, left[name], joint.name if joint else "")
        if joint is None:
            sensor = ET.SubElement(link, "sensor", name="imu_sensor", type="imu")
            _children(sensor, {"always_on": 1, "update_rate": _RATE})
            continue
        axis = _joint(model, joint.name, joint.kind, joint.parent, name, joint.pose)
        if joint.kind != "fixed":
            _properties(axis, joint)
    for rotor in source.rotors:
        pose, spin = Placement(rotor.position, along_z(rotor.direction)), spins[rotor.name]
        _link(model, rotor.name, discs[rotor.name], spin)
        axis = _joint(model, spin, "revolute", rotor.link, rotor.name, pose)
        ET.SubElement(axis, "xyz").text = "0 0 1"
    for frame in source.frames:
        element = ET.SubElement(model, "frame", name=frame.name, attached_to=frame.on)
        _pose(element, frame.pose)
    for number, rotor in enumerate(source.rotors):
        _motor(model, number, rotor.name, spins[rotor.name], motors[rotor.name])
    moving = [joint.name for joint in source.joints if joint.kind != "fixed"]
    for number, name in enumerate(moving):
        _drive(model, number, name, servos.get(name))
    _plugin(model, "joint-state-publisher", "JointStatePublisher", {})
    ET.indent(top)
    return f'<?xml version="1.0"?>\n{ET.tostring(top, encoding="unicode")}\n'


def _with_propellers(source: Source) -> tuple[dict[str, Inertial], dict[str, Inertial]]:
    """Inertias of links without their propellers, and of propellers, by their names.

    Raises `UsageError` if a link has an inertia that no body has.
    """
    links: dict[str, Inertial] = {}
    discs: dict[str, Inertial] = {}
    for name, link in source.links.items():
        own = link.inertial
        if fault := _fault(own):
            raise UsageError(
                f"the inertia of link {printable(name, 60)} {fault}, and Gazebo refuses it; "
                "export URDF"
            )
        carried = [rotor for rotor in source.rotors if rotor.link == name]
        places = [Placement(r.position, along_z(r.direction)) for r in carried]
        least = _least_moment(own)
        disc, rest = _disc(0.0), own
        for share in _SHARES if carried else ():
            disc = _disc(share * own.mass / len(carried))
            taken = replace(disc, mass=-disc.mass, inertia=-disc.inertia)
            parts = [(own, HERE), *((taken, place) for place in places)]
            body = composite(parts, False)
            place = Placement(vector(body.com))
            rest = Inertial(body.mass, place, inertia_matrix(body.inertia))
            if not _fault(rest) and _least_moment(rest) > 0.5 * least:
                break
            disc, rest = _disc(0.0), own
        links[name] = _with_some(rest)
        discs |= dict.fromkeys((rotor.name for rotor in carried), _with_some(disc))
    return links, discs


def _disc(mass: float) -> Inertial:
    """A thin disc across z."""
    return Inertial(mass, HERE, mass * _RADIUS**2 / 4.0 * np.diag([1.0, 1.0, 2.0]))


def _fault(inertial: Inertial) -> str | None:
    i = inertial.inertia
    entries = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    return inertia_fault(inertial.mass, entries)


def _least_moment(inertial: Inertial) -> float:
    return float(np.linalg.eigvalsh(inertial.inertia)[0])


def _with_some(inertial: Inertial) -> Inertial:
    """The inertial, or with so little more mass and inertia that a reader takes it."""
    mass, inertia = max(inertial.mass, _NOTHING), inertial.inertia
    if _least_moment(inertial) <= 0.0:
        inertia = inertia + _NOTHING * np.eye(3)
    return replace(inertial, mass=mass, inertia=inertia)


def _children(element: ET.Element, values: Mapping[str, object]) -> None:
    """Write what is not None as children with texts, numbers in full."""
    for tag, value in values.items():
        if value is not None:
            ET.SubElement(element, tag).text = (
                repr(value) if isinstance(value, float) else str(value)
            )


def _pose(element: ET.Element, pose: Placement, relative_to: str = "") -> None:
    place = {"relative_to": relative_to} if relative_to else {}
    angles: Iterable[float] = (math.radians(float(angle)) for angle in pose.rpy_deg)
    ET.SubElement(element, "pose", place).text = numbers([*pose.xyz, *angles])


def _link(model: ET.Element, name: str, inertial: Inertial, joint: str) -> ET.Element:
    """Write a link, whose frame is that of the joint that carries it where there is one."""
    element = ET.SubElement(model, "link", name=name)
    if joint:
        _pose(element, HERE, joint)
    found = ET.SubElement(element, "inertial")
    _pose(found, inertial.pose)
    _children(found, {"mass": float(inertial.mass)})
    i, entries = inertial.inertia, ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    values = (i[0, 0], i[0, 1], i[0, 2], i[1, 1], i[1, 2], i[2, 2])
    pairs = zip(entries, map(float, values), strict=True)
    _children(ET.SubElement(found, "inertia"), dict(pairs))
    return element


def _joint(
    model: ET.Element, name: str, kind: str, parent: str, child: str, pose: Placement
) -> ET.Element:
    """Write a joint with its place in its parent; return its axis or, fixed, itself."""
    element = ET.SubElement(model, "joint", name=name, type=kind)
    _pose(element, pose, parent)
    _children(element, {"parent": parent, "child": child})
    return element if kind == "fixed" else ET.SubElement(element, "axis")


def _properties(axis: ET.Element, joint: Joint) -> None:
    """Write the axis of a joint, its limits, and what acts on it by itself."""
    limits, passive = joint.limits, joint.passive
    bounds = {"lower": limits.low, "upper": limits.high}
    if joint.continuous:
        bounds = {}
    bounds |= {"effort": limits.effort, "velocity": limits.velocity}
    resisting = {"damping": passive.damping, "friction": coulomb(joint)}
    resisting |= {"spring_stiffness": passive.stiffness, "spring_reference": passive.rest}
    ET.SubElement(axis, "xyz").text = numbers(joint.axis)
    _children(ET.SubElement(axis, "limit"), bounds)
    _children(ET.SubElement(axis, "dynamics"), {k: v for k, v in resisting.items() if v})


def _plugin(model: ET.Element, file: str, name: str, values: dict[str, object]) -> None:
    """Write a plugin of Gazebo Sim."""
    names = {"filename": f"gz-sim-{file}-system", "name": f"gz::sim::systems::{name}"}
    _children(ET.SubElement(model, "plugin", names), values)


def _motor(model: ET.Element, number: int, link: str, joint: str, motor: Motor) -> None:
    """Write the motor of a propeller, by its link and joint."""
    values: dict[str, object] = {
        "jointName": joint,
        "linkName": link,
        "turningDirection": "cw" if motor.clockwise else "ccw",
        "motorNumber": number,
        "motorType": "velocity",
        "commandSubTopic": "command/motor_speed",
        "maxRotVelocity": motor.fastest,
        "motorConstant": motor.constant,
        "momentConstant": motor.moment,
        "timeConstantUp": motor.up,
        "timeConstantDown": motor.down,
        "rotorDragCoefficient": motor.hub_drag,
        "rollingMomentCoefficient": 0.0,
        "rotorVelocitySlowdownSim": 10,
    }
    _plugin(model, "multicopter-motor-model", "MulticopterMotorModel", values)


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
