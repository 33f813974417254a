"""The text of URDF and MJCF files of a robot, in forms that `import` finds again.

In URDF rotors are frames that push along z. In MJCF they are sites with motors whose gears are a
force and the torque with it. MuJoCo has no moving body without mass: such links give their joints
to the link that follows.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import asdict

import numpy as np
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.exchange import sources
from gibbs_codegen.robot.parts.body import RigidBody, inertia_fault, inertia_matrix
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.numbers import AXIS_PAIRS, Angles3, Vector3
from gibbs_codegen.robot.parts.pose import HERE, Pose
from gibbs_codegen.robot.rotations import degrees

# Readers demand limits; what has none gets some that nothing reaches.
_ENDLESS = 1e16


def urdf_text(source: sources.Source) -> str:
    """The text of a URDF file of a robot with names that a file can hold.

    A rotor is a massless link on a fixed joint that has an `<m_f_rate>`, its drag, and whose limits
    are those of the thrust. A frame is a massless link on a fixed joint.
    """
    root = ET.Element("robot", name=source.name)
    links = sources.FreeNames([*source.links, *(frame.name for frame in source.frames)])
    joints = sources.FreeNames([*(j.name for j in source.joints), *(r.name for r in source.rotors)])
    for link in source.links.values():
        _urdf_link(root, link.name, link)
    for joint in source.joints:
        limits, ends = joint.link.limits, (joint.parent, joint.child)
        kind = "continuous" if joint.continuous else joint.kind
        element = _urdf_mount(root, joint.name, kind, joint.pose, ends)
        if joint.kind == "fixed":
            continue
        ET.SubElement(element, "axis", xyz=numbers(joint.link.axis))
        bounds = {} if joint.continuous else {"lower": limits.low, "upper": limits.high}
        bounds |= {"effort": limits.effort, "velocity": limits.velocity}
        endless = dict.fromkeys(bounds, _ENDLESS) | {"lower": -_ENDLESS}
        texts = {key: repr(endless[key] if b is None else b) for key, b in bounds.items()}
        ET.SubElement(element, "limit", texts)
        if joint.gear:
            ((mover, ratio),), offset = joint.gear.ratios.items(), joint.gear.offset
            gear = {"joint": mover, "multiplier": repr(ratio), "offset": repr(offset)}
            ET.SubElement(element, "mimic", gear)
        resisting = {"damping": joint.link.passive.damping, "friction": coulomb(joint.link)}
        if any(resisting.values()):
            texts = {key: repr(value) for key, value in resisting.items() if value}
            ET.SubElement(element, "dynamics", texts)
        if tags := motor_tags(root, joint):
            transmission = ET.SubElement(root, "transmission", name=f"{joint.name}_transmission")
            ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
            ET.SubElement(transmission, "joint", name=joint.name)
            actuator = ET.SubElement(transmission, "actuator", name=f"{joint.name}_motor")
            for tag, value in tags.items():
                ET.SubElement(actuator, tag, value=repr(value))
    for number, rotor in enumerate(source.rotors, start=1):
        thrust = links.free(f"thrust{number}")
        _urdf_link(root, thrust)
        pose = Pose(rotor.position, along_z(rotor.direction))
        element = _urdf_mount(root, rotor.name, "fixed", pose, (rotor.link, thrust))
        ET.SubElement(element, "axis", xyz="0 0 1")
        ET.SubElement(element, "m_f_rate", value=repr(rotor.drag))
        if rotor.limits is not None:
            low, high = map(repr, rotor.limits)
            ET.SubElement(element, "limit", lower=low, upper=high, effort="0", velocity="0")
    for frame in source.frames:
        _urdf_link(root, frame.name)
        mount = joints.free(f"{frame.name}_mount")
        _urdf_mount(root, mount, "fixed", frame.pose, (frame.link, frame.name))
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def motor_tags(root: ET.Element, joint: sources.SourceJoint) -> dict[str, float]:
    """Tags of Drake, of which the root then says the namespace, of a motor; none without one."""
    motor = joint.link.motor
    if motor is None or joint.kind != "revolute":
        return {}
    root.set("xmlns:drake", "http://drake.mit.edu")
    return {"drake:rotor_inertia": motor.rotor_inertia, "drake:gear_ratio": motor.gear_ratio}


def along_z(direction: Vector3) -> Angles3:
    """Roll, pitch and yaw, degrees, of a frame whose z axis is a unit vector."""
    x, y, z = direction
    return degrees(math.atan2(-y, math.hypot(x, z))), degrees(math.atan2(x, z)), degrees(0.0)


def coulomb(link: Link) -> float:
    """Dry friction of the joint of a link at speed, N m or N."""
    return link.friction.coulomb if link.friction else 0.0


def inertia_entries(body: RigidBody) -> dict[str, float]:
    """Inertia of a body by the names of its entries, row by row."""
    entries = zip(AXIS_PAIRS, body.inertia, strict=True)
    return {f"i{pair}": float(value) for pair, value in sorted(entries)}


def _urdf_link(root: ET.Element, name: str, link: sources.SourceBody | None = None) -> None:
    element = ET.SubElement(root, "link", name=name)
    if link is None or not link.body.weighs:
        return
    inertial = ET.SubElement(element, "inertial")
    _origin(inertial, link.seat)
    ET.SubElement(inertial, "mass", value=repr(link.body.mass))
    entries = {key: repr(value) for key, value in inertia_entries(link.body).items()}
    ET.SubElement(inertial, "inertia", entries)


def _origin(element: ET.Element, pose: Pose) -> None:
    angles = [math.radians(float(angle)) for angle in pose.rpy_deg]
    ET.SubElement(element, "origin", xyz=numbers(pose.xyz), rpy=numbers(angles))


def _urdf_mount(
    root: ET.Element, name: str, kind: str, pose: Pose, ends: tuple[str, str]
) -> ET.Element:
    """Write a joint between two links, parent and child, with its place."""
    element = ET.SubElement(root, "joint", name=name, type=kind)
    _origin(element, pose)
    ET.SubElement(element, "parent", link=ends[0])
    ET.SubElement(element, "child", link=ends[1])
    return element


def numbers(values: Iterable[float]) -> str:
    """Numbers in full, with spaces between them."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def mjcf_text(source: sources.Source) -> str:
    """The text of an MJCF file of a robot with names that a file can hold."""
    writer = _Writer(source)
    top = ET.Element("mujoco", model=source.name)
    ET.SubElement(top, "compiler", angle="radian", autolimits="true", fusestatic="false")
    ET.SubElement(top, "option", gravity=f"0 0 {-source.gravity!r}")
    world = ET.SubElement(top, "worldbody")
    is_free = source.links[source.root].name != "world"
    for joint in [None] if is_free else source.below[source.root]:
        child, pose = (joint.child, joint.pose) if joint else (source.root, HERE)
        writer.body(world, child, [(joint, pose)])
    actuator = ET.SubElement(top, "actuator")
    for rotor in source.rotors:
        writer.rotor(actuator, rotor)
    for joint in source.joints:
        if joint.driven:
            writer.motor(actuator, joint)
    for frame in (*source.frames, *(end for loop in source.constraints for end in loop.ends)):
        place = {"pos": numbers(frame.pose.xyz), "quat": _quaternion(frame.pose)}
        site = {"name": frame.name, **place}
        is_on_world = frame.link == sources.WORLD
        body = world if is_on_world else writer.place_of(frame.link, frame.name)
        ET.SubElement(body, "site", site)
    equality = ET.Element("equality")
    for loop in source.constraints:
        kind = "weld" if loop.holds == "frame" else "connect"
        sites = {f"site{number}": end.name for number, end in enumerate(loop.ends, start=1)}
        # It may be held: who simulates switches it on.
        ET.SubElement(equality, kind, {"name": loop.name, "active": "false", **sites})
    tendons = ET.Element("tendon")
    for joint in source.joints:
        if not joint.gear:
            continue
        (mover, *others), offset = joint.gear.ratios, joint.gear.offset
        if not others:
            ratio, joints = joint.gear.ratios[mover], {"joint1": joint.name, "joint2": mover}
            ET.SubElement(equality, "joint", joints, polycoef=numbers((offset, ratio, 0, 0, 0)))
            continue
        tendon = ET.SubElement(tendons, "fixed", name=f"gear_{joint.name}")
        for name, ratio in {joint.name: -1.0, **joint.gear.ratios}.items():
            ET.SubElement(tendon, "joint", joint=name, coef=repr(-ratio))
        ends = {"tendon1": tendon.get("name", ""), "polycoef": numbers((offset, 0, 0, 0, 0))}
        ET.SubElement(equality, "tendon", ends)
    top.extend(element for element in (tendons, equality) if len(element))
    ET.indent(top)
    return ET.tostring(top, encoding="unicode") + "\n"


# A joint with the placement of its frame in that of the carrying body; None for the root's.
_Group = list[tuple[sources.SourceJoint | None, Pose]]


class _Writer:
    """Writes bodies, and knows where they are in the document."""

    def __init__(self, source: sources.Source) -> None:
        self._source = source
        self._bodies: dict[str, ET.Element] = {}
        self._joints = sources.FreeNames(joint.name for joint in source.joints)
        self._sites = sources.FreeNames(frame.name for frame in source.frames)
        self._actuators = sources.FreeNames(rotor.name for rotor in source.rotors)

    def body(self, parent: ET.Element, name: str, group: _Group) -> None:
        """Write a body and what hangs on it.

        `group` are the joints that move it, its own last, each with its frame in the carrying
        body's. Raises `UsageError` if the body moves and has no mass, and not one link follows it.
        """
        link, below = self._source.links[name], self._source.below[name]
        (joint, frame) = group[-1]
        if joint is not None and joint.kind != "fixed" and not link.body.weighs:
            if len(below) == 1:
                further = [*group, (below[0], frame @ below[0].pose)]
                self.body(parent, below[0].child, further)
                return
            raise UsageError(
                f"link {printable(name, 60)} moves, has no mass and does not carry exactly one "
                "link, which MuJoCo does not allow; give it mass, or export URDF"
            )
        place = {"pos": numbers(frame.xyz), "quat": _quaternion(frame)}
        element = ET.SubElement(parent, "body", {"name": name, **place})
        self._bodies[name] = element
        if joint is None:
            ET.SubElement(element, "freejoint", name=self._joints.free("root"))
        _mjcf_inertial(element, name, link)
        for moved, its_frame in group:
            if moved is None or moved.kind == "fixed":
                continue
            # Its frame in the body's, its coordinate and those after it at zero.
            seat = frame.inverse @ its_frame
            limits = moved.link.limits
            attributes = {
                "name": moved.name,
                "type": "slide" if moved.kind == "prismatic" else "hinge",
                "axis": numbers(seat.matrix @ np.array(moved.link.axis)),
                "pos": numbers(seat.xyz),
            }
            acting = asdict(moved.link.passive)
            acting["springref"] = acting.pop("rest")
            acting["frictionloss"] = coulomb(moved.link)
            attributes |= {key: repr(value) for key, value in acting.items() if value}
            if limits.low is not None and limits.high is not None:
                attributes["range"] = numbers((limits.low, limits.high))
            ET.SubElement(element, "joint", attributes)
        for carried in below:
            self.body(element, carried.child, [(carried, carried.pose)])

    def rotor(self, actuator: ET.Element, rotor: sources.SourceRotor) -> None:
        """Write a rotor as a site and a motor, this into the element that holds motors."""
        site = self._sites.free(rotor.name)
        element = self.place_of(rotor.link, rotor.name)
        ET.SubElement(element, "site", name=site, pos=numbers(rotor.position))
        push = np.array(rotor.direction)
        attributes = {
            "name": rotor.name,
            "site": site,
            "gear": numbers([*push, *(rotor.drag * push)]),
        }
        if rotor.limits is not None:
            attributes["ctrlrange"] = numbers(rotor.limits)
        if rotor.time_constant:
            attributes |= {"dyntype": "filterexact", "dynprm": repr(rotor.time_constant)}
        ET.SubElement(actuator, "general" if rotor.time_constant else "motor", attributes)

    def motor(self, actuator: ET.Element, joint: sources.SourceJoint) -> None:
        """Write the motor of a joint into the element that holds motors."""
        attributes = {"name": self._actuators.free(f"tau_{joint.name}"), "joint": joint.name}
        if (effort := joint.link.limits.effort) is not None:
            attributes["ctrlrange"] = numbers((-effort, effort))
        ET.SubElement(actuator, "motor", attributes)

    def place_of(self, link: str, subject: str) -> ET.Element:
        """The body of a link that `subject` is to be placed on.

        Raises `UsageError` if the link has no body of its own.
        """
        if link not in self._bodies:
            raise UsageError(
                f"{printable(subject, 60)} is on link {printable(link, 60)}, which has no mass and "
                "no body in MuJoCo; export URDF"
            )
        return self._bodies[link]


def _mjcf_inertial(element: ET.Element, name: str, link: sources.SourceBody) -> None:
    """Write the inertia of a link into its body; raises `UsageError` if MuJoCo would refuse it."""
    body, seat = link.body, link.seat
    if not body.weighs:
        return
    if fault := inertia_fault(body.mass, body.inertia):
        raise UsageError(
            f"the inertia of link {printable(name, 60)} {fault}, and MuJoCo refuses it; export URDF"
        )
    moments, axes = np.linalg.eigh(inertia_matrix(body.inertia))
    place = seat.matrix @ axes * np.linalg.det(axes)
    attributes = {
        "pos": numbers(seat.xyz),
        "mass": repr(max(body.mass, sources.NOTHING)),
        "diaginertia": numbers(np.maximum(moments, sources.NOTHING)),
        "xyaxes": numbers(place.T[:2].ravel()),
    }
    ET.SubElement(element, "inertial", attributes)


def _quaternion(pose: Pose) -> str:
    """The rotation as w x y z."""
    angles = [float(angle) for angle in pose.rpy_deg]
    x, y, z, w = Rotation.from_euler("xyz", angles, degrees=True).as_quat()
    return numbers((w, x, y, z))
