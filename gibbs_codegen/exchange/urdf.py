"""URDF, read with the standard library's parser and nothing else.

What other readers drop is kept: thrust of rotors and Gazebo's motor plugins. What has no part in
the equations of motion, such as meshes and transmissions, is left out and told.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.placement import vector
from gibbs_codegen.exchange.source import (
    Inertial,
    Source,
    SourceFileError,
    SourceJoint,
    SourceKind,
    SourceLink,
    Told,
    endless,
)
from gibbs_codegen.exchange.urdf_rotors import is_motor, urdf_rotors
from gibbs_codegen.exchange.urdf_values import Values, child, children
from gibbs_codegen.exchange.xml_file import Element, parse_xml
from gibbs_codegen.robot.model import JointLimits, Passive, Vector3
from gibbs_codegen.robot.rigid_body import inertia_matrix

_KINDS: dict[str, SourceKind] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "floating",
    "planar": "planar",
}
_ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
# What is not imported, and by which name it is told.
_LEFT_OUT = {
    "visual": "visual shapes",
    "collision": "collision shapes",
    "transmission": "transmissions",
    "material": "materials",
    "gazebo": "<gazebo> elements other than motors",
}


def read_urdf(data: bytes, file: str) -> Source:
    """Read a robot in URDF, unchecked as a tree; raises `SourceFileError` with every fault."""
    root, values = parse_xml(data, file), Values()
    if root.tag != "robot":
        values.fault(root, "is no URDF: its root element is <robot>")
        raise SourceFileError(file, values.faults)
    if any(":" in found.tag for found in children(root)):
        unexpanded = next(found for found in children(root) if ":" in found.tag)
        values.fault(unexpanded, "is xacro, not URDF; name the file .xacro to have it expanded")
    links: dict[str, SourceLink] = {}
    joints: dict[str, SourceJoint] = {}
    for element in children(root):
        if element.tag == "link":
            link = _link(element, values)
            if link.name in links:
                values.fault(element, "there is another link of that name")
            links[link.name] = link
        elif element.tag == "joint":
            joint = _joint(element, values)
            if joint.name in joints:
                values.fault(element, "there is another joint of that name")
            joints[joint.name] = joint
    rotors, told = urdf_rotors(root, values), _left_out(root, values)
    if not links:
        values.fault(root, "has no <link>")
    if values.faults:
        raise SourceFileError(file, values.faults)
    name = root.get("name", "")
    spinning = frozenset(rotor.joint for rotor in rotors if rotor.joint)
    return Source(
        file,
        name,
        links,
        tuple(joints.values()),
        tuple(rotors),
        spinning=spinning,
        told=tuple(told),
    )


def _link(element: Element, values: Values) -> SourceLink:
    name, inertial = values.name(element), child(element, "inertial")
    if inertial is None:
        return SourceLink(name, line=element.line)
    mass = values.positive(child(inertial, "mass"), "value")
    entries = child(inertial, "inertia")
    moments = [
        values.number(entries, entry, None if entry[1] == entry[2] else 0.0) for entry in _ENTRIES
    ]
    pose = values.placement(child(inertial, "origin"))
    return SourceLink(name, Inertial(mass, pose, inertia_matrix(moments)), element.line)


def _joint(element: Element, values: Values) -> SourceJoint:
    given = element.get("type", "")
    if given not in _KINDS:
        kinds = ", ".join(_KINDS)
        values.fault(element, f"type must be one of {kinds}, not {printable(given or 'none', 40)}")
    kind = _KINDS.get(given, "fixed")
    ends = []
    for tag in ("parent", "child"):
        if (end := child(element, tag)) is None:
            values.fault(element, f"has no <{tag}>")
        ends.append("" if end is None else values.name(end, "link"))
    axis = (0.0, 0.0, 1.0)
    if kind in ("revolute", "prismatic"):
        axis = _axis(element, values)
    limits = _limits(element, given, values)
    return SourceJoint(
        values.name(element),
        kind,
        ends[0],
        ends[1],
        pose=values.placement(child(element, "origin")),
        axis=axis,
        passive=Passive(damping=values.positive(child(element, "dynamics"), "damping")),
        limits=limits,
        continuous=kind == "revolute" and endless(limits),
        line=element.line,
    )


def _axis(element: Element, values: Values) -> Vector3:
    given = values.vector(child(element, "axis"), "xyz", (1.0, 0.0, 0.0))
    size = math.hypot(*given)
    if not size > 0.0:
        values.fault(element, "its axis has no length; give a direction such as 0 0 1")
        return given
    # What is of unit length as far as numbers go is kept digit by digit.
    return given if abs(size - 1.0) <= 4e-16 else vector(np.array(given) / size)


def _limits(element: Element, kind: str, values: Values) -> JointLimits:
    """Limits of a joint, of effort and rate only if it is continuous.

    In URDF a bound that `<limit>` leaves out is 0.
    """
    limit = child(element, "limit")
    if limit is None or kind not in ("revolute", "prismatic", "continuous"):
        return JointLimits()
    effort, velocity = values.bound(limit, "effort"), values.bound(limit, "velocity")
    low, high = values.bound(limit, "lower"), values.bound(limit, "upper")
    low = 0.0 if limit.get("lower") is None else low
    high = 0.0 if limit.get("upper") is None else high
    if kind == "continuous":
        low = high = None
    if low is not None and high is not None and low > high:
        values.fault(limit, f"lower {low:g} is above upper {high:g}")
    return JointLimits(low, high, _if_any(effort), _if_any(velocity))


def _if_any(bound: float | None) -> float | None:
    """A bound; files that know none say 0."""
    return bound if bound is not None and bound > 0.0 else None


def _left_out(root: Element, values: Values) -> list[Told]:
    """What the file says that is not imported."""
    told = []
    counts: Counter[str] = Counter()
    for element in root.iter():
        counts[element.tag] += 1
    gazebo = [found for found in children(root) if found.tag == "gazebo"]
    counts["gazebo"] = sum(not all(map(is_motor, children(found))) for found in gazebo)
    for tag, words in _LEFT_OUT.items():
        if counts[tag] > 0:
            told.append(Told("left out", words, f"{counts[tag]}"))
    slowdowns = {(found.text or "").strip() for found in root.iter("rotorVelocitySlowdownSim")}
    for factor in sorted(slowdowns - {"", "1"}):
        many = f"made for rotorVelocitySlowdownSim {printable(factor, 20)}: their links' inertia "
        told.append(Told("note", "rotors", f"{many}may be that many times too large"))
    for joint in children(root):
        if joint.tag != "joint":
            continue
        name = joint.get("name", "")
        if (mimic := child(joint, "mimic")) is not None:
            other = mimic.get("joint", "?")
            told.append(Told("left out", name, f"that it follows joint {other}"))
        if friction := values.positive(child(joint, "dynamics"), "friction"):
            told.append(Told("left out", name, f"dry friction {friction:g}"))
    return told
