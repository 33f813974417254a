"""MJCF of a robot: rotors are sites with motors whose gears are a force and the torque with it.

MuJoCo has no moving body without mass: such links give their joints to the link that follows.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gibbs_codegen.errors import Fault, UsageError, printable
from gibbs_codegen.exchange.placement import HERE, Placement
from gibbs_codegen.exchange.robot_source import Names
from gibbs_codegen.exchange.source import (
    Inertial,
    Source,
    SourceFileError,
    SourceJoint,
    SourceRotor,
    Told,
)
from gibbs_codegen.exchange.urdf import child, children, described
from gibbs_codegen.exchange.urdf_export import numbers
from gibbs_codegen.exchange.xml_file import Element, parse_xml, read_bytes
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


_KEPT = ("compiler", "option", "default", "asset", "worldbody", "actuator")
_PICTURES = ("texture", "material", "skin", "light", "camera", "hfield", "plugin", "flexcomp")
_LEFT_OUT = {
    "equality": "equality constraints, such as closed loops",
    "tendon": "tendons and their springs",
    "contact": "contacts",
    "sensor": "sensors",
    "keyframe": "keyframes",
    "deformable": "deformable bodies",
    "extension": "plugins, and what they do to the motion",
}
_NO_MOTION = ("custom", "visual", "statistic", "size")
# What a compiler may be told; versions differ in what else they know.
_SETTINGS = {
    *("angle", "eulerseq", "autolimits", "inertiafromgeom", "inertiagrouprange", "strippath"),
    *("meshdir", "assetdir", "exactmeshinertia", "alignfree"),
}
_CHANGING = {"balanceinertia", "boundmass", "boundinertia", "settotalmass"}
_MOST_INCLUDES = 50
_MOST_COPIES = 1000
_TEXTS = {"name", "class", "childclass", "file", "mesh", "meshdir", "assetdir", "model", "joint"}


def reduced_mjcf(path: Path, data: bytes) -> tuple[str, list[Told]]:
    """What a file and its includes have of mass, motion and drives, and what was left out."""
    root = parse_xml(data, str(path))
    _include(root, path)
    _check(root, str(path))
    counts: Counter[str] = Counter()
    for section in children(root):
        if section.tag not in _KEPT:
            if section.tag not in _NO_MOTION:
                words = _LEFT_OUT.get(section.tag, "a section that import does not know")
                counts[f"{words} (<{printable(section.tag, 40)}>)"] += len(section)
            root.remove(section)
    told = [Told("left out", words, f"{count}") for words, count in counts.items() if count]
    for element in [found for found in root.iter() if isinstance(found, Element)]:
        element.attrib.pop("material", None)
        for picture in children(element):
            if picture.tag in _PICTURES:
                element.remove(picture)
    shapes = _Shapes(root)
    for world in root.iter("worldbody"):
        if isinstance(world, Element):
            shapes.strip(world, "", True)
    if shapes.count:
        told.append(Told("left out", "shapes that give no mass", f"{shapes.count}"))
    told += _only_motors(root)
    told += _settle(root, path)
    return ET.tostring(root, encoding="unicode"), told


def _include(root: Element, path: Path) -> None:
    """Put the contents of included files in place of `<include>`.

    Raises `SourceFileError` if files include too many others.
    """
    for _ in range(_MOST_INCLUDES):
        found = next(((p, e) for p in root.iter() for e in p if e.tag == "include"), (None, None))
        if found[0] is None or found[1] is None:
            return
        parent, element = found
        place = [*parent].index(element)
        parent.remove(element)
        file = path.parent / element.get("file", "")
        for number, fresh in enumerate(parse_xml(read_bytes(file), str(file))):
            parent.insert(place + number, fresh)
    fault = Fault("<include>", f"more than {_MOST_INCLUDES} files are included")
    raise SourceFileError(str(path), [fault])


def _check(root: Element, file: str) -> None:
    """Refuse what would keep the compiler busy without end, or is no number."""
    faults, copies = [], 1
    for element in root.iter():
        line = element.line if isinstance(element, Element) else None
        where = described(element) if isinstance(element, Element) else ""
        if element.tag == "replicate":
            count = element.get("count", "1")
            copies *= int(count) if count.isdigit() and len(count) < 6 else _MOST_COPIES + 1
            if copies > _MOST_COPIES:
                faults.append(Fault(where, f"more than {_MOST_COPIES} copies", line))
        if element.tag == "composite":
            faults.append(Fault(where, "composite bodies are not imported", line))
        if element.tag == "mesh" and "builtin" in element.attrib:
            faults.append(Fault(where, "builtin meshes are not imported; give a file", line))
        for key, text in element.attrib.items():
            words = text.lower().replace("+", "").replace("-", "").split()
            if key not in _TEXTS and {"nan", "inf", "infinity"} & {*words}:
                faults.append(Fault(where, f"{key} must be finite, not {printable(text)}", line))
    if faults:
        raise SourceFileError(file, faults)


class _Shapes:
    """Removes shapes that give no mass, and counts them."""

    def __init__(self, root: Element) -> None:
        self.count = 0
        self._computed = any(c.get("inertiafromgeom") == "true" for c in root.iter("compiler"))
        self._masses: dict[str, str | None] = {}
        for default in children(root):
            if default.tag == "default":
                self._read(default, None)

    def _read(self, default: Element, mass: str | None) -> None:
        """Learn the mass of shapes of each class, which a class within a class inherits."""
        geom = child(default, "geom")
        mass = mass if geom is None else geom.get("mass", mass)
        self._masses[default.get("class", "main")] = mass
        for inner in children(default):
            if inner.tag == "default":
                self._read(inner, mass)

    def strip(self, element: Element, kind: str, weighed: bool) -> None:
        """Remove the shapes of an element, a body or what holds some, and of the bodies in it.

        `kind` is the class of shapes that name no other; `weighed` whether the mass is given, so
        that no shape counts.
        """
        for found in children(element):
            inner = found.get("childclass", kind)
            if found.tag == "body":
                given = child(found, "inertial") is not None
                self.strip(found, inner, given and not self._computed)
            elif found.tag in ("frame", "replicate"):
                self.strip(found, inner, weighed)
            elif found.tag == "geom":
                given_class = found.get("class", kind) or "main"
                mass = found.get("mass", self._masses.get(given_class))
                if weighed or _is_zero(mass):
                    element.remove(found)
                    self.count += 1


def _is_zero(text: str | None) -> bool:
    try:
        return text is not None and float(text) == 0.0
    except ValueError:
        return False


def _only_motors(root: Element) -> Iterator[Told]:
    """Remove actuators that are no motors at a site or joint, and tell of them."""
    for section in root.iter("actuator"):
        for actuator in [found for found in section if isinstance(found, Element)]:
            acts = "site" in actuator.attrib or "joint" in actuator.attrib
            if actuator.tag not in ("motor", "general") or not acts or "refsite" in actuator.attrib:
                section.remove(actuator)
                name = printable(actuator.get("name", "without a name"), 60)
                yield Told("left out", name, f"<{printable(actuator.tag, 40)}>, which is no motor")


def _settle(root: Element, path: Path) -> Iterator[Told]:
    """Leave the compiler no choice: no welding, and folders by their full paths.

    Tells of settings with which MuJoCo changes masses or inertias.
    """
    meshes = any("mesh" in found.attrib for found in root.iter("geom"))
    for section in children(root):
        if section.tag == "asset" and not meshes:
            root.remove(section)
        if section.tag == "option":
            section.attrib = {k: v for k, v in section.attrib.items() if k == "gravity"}
            section[:] = []
    if root.find("compiler") is None:
        root.insert(0, Element("compiler"))
    for compiler in root.iter("compiler"):
        folder = compiler.get("meshdir", compiler.get("assetdir", ""))
        for key in sorted(_CHANGING & set(compiler.attrib)):
            setting = f"{compiler.get(key)}: with it MuJoCo changes masses or inertias"
            yield Told("note", key, printable(setting))
        kept = (
            _SETTINGS
            | _CHANGING
            | ({"coordinate"} if compiler.get("coordinate") == "global" else set())
        )
        compiler.attrib = {key: text for key, text in compiler.attrib.items() if key in kept}
        compiler.attrib.pop("assetdir", None)
        compiler.set("meshdir", str(path.parent.absolute() / folder))
        compiler.set("fusestatic", "false")
