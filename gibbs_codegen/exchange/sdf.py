"""SDF of Gazebo, read with the standard library's parser and nothing else.

A model's links, joints and frames are placed relative to each other by name. What else a file says,
and has a part in the motion, is left out and reported with its lines.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from gibbs_codegen.errors import near, printable
from gibbs_codegen.exchange import sources
from gibbs_codegen.exchange.sdf_models import MERGED, MODEL, PLACED, WORLD, is_true, whole_model
from gibbs_codegen.exchange.unread import WITHIN, pass_over, unread, without_part
from gibbs_codegen.exchange.urdf import COUNTED, KINDS, OF_MOTORS, Values, gazebo_rotors
from gibbs_codegen.exchange.xml_file import Element, child, children, parse_xml, within
from gibbs_codegen.exchange.xml_file import child_text as _text
from gibbs_codegen.robot.parts.base import FIXED
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.motor import Motor
from gibbs_codegen.robot.parts.numbers import AXES, AXIS_PAIRS, LEVEL
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.parts.rotor import Command
from gibbs_codegen.robot.rotations import degrees

_KINDS = ("revolute", "continuous", "prismatic", "fixed")
# What is only counted, under these words, and what has no part in the motion.
_KNOWN = COUNTED | {"sensor": "sensors", "fluid_added_mass": "added masses of fluids"}
_KNOWN |= dict.fromkeys(("sdf/world", "world/wind", "link/velocity_decay"), WITHIN)
_KNOWN |= without_part(f"""{OF_MOTORS}
    sdf/ model include actor light
    world/ model include actor light physics scene gui audio road population state atmosphere
        magnetic_field spherical_coordinates
    model@ placement_frame
    model/ self_collide allow_auto_disable enable_wind=0
    link/ light self_collide must_be_base_link kinematic=0 enable_wind=0 audio_sink
        audio_source battery projector particle_emitter
    velocity_decay/ linear=0 angular=0
    wind/ linear_velocity=0
    joint/ physics
    limit/ stiffness dissipation
""")
_MOST_PLACED = 1000
# Cosine of the angle between axes that are one.
_ALONG = 1.0 - 1e-9
_DEEPEST = 400


def read_sdf(data: bytes, file: str, command: Command, friction: bool) -> sources.Source:
    """Read the robot in an SDF file, unchecked as a tree; raises `SourceFileError` with its faults.

    Motors of Gazebo are commanded a thrust or, as there, a speed. `friction` is whether the dry
    friction of joints is taken.
    """
    root, values = parse_xml(data, file), _Values(friction)
    model, elsewhere = whole_model(root, Path(file), values)
    if len(children(model, *PLACED)) > _MOST_PLACED:
        values.fault(model, f"has more than {_MOST_PLACED} links, joints and frames")
    if values.faults:
        raise sources.SourceFileError(file, values.faults)
    reader = _ModelReader(model, values)
    links, joints = reader.links(), reader.joints()
    carried = {joint.child for joint in joints}
    pose = reader.place(next((name for name in links if name not in carried), WORLD))
    rests = is_true(_text(model, "static"))
    frames = reader.frames()
    gravity = 9.81
    holders = [root, *children(root, "world")]
    for element in (element for holder in holders for element in children(holder, "gravity")):
        x, y, z = _numbers(values, element, 3)
        if x or y or z > 0.0:
            values.fault(element, "must point along -z, as 0 0 -9.81 does")
        gravity = -z
    rotors = gazebo_rotors(model, values, command)
    if child(model, "link") is None:
        values.fault(model, "has no <link>")
    if values.faults:
        raise sources.SourceFileError(file, values.faults)
    return sources.Source(
        file,
        model.get("name", ""),
        links,
        joints,
        tuple(rotors),
        spinning=frozenset(rotor.joint for rotor in rotors if rotor.joint),
        frames=frames,
        gravity=gravity,
        motion=FIXED if rests else None,
        reason="the model is static",
        pose=pose,
        findings=(
            *(sources.Finding("left out", _text(e, "uri"), "another model") for e in elsewhere),
            *values.findings,
            *unread([root] if model in within(root) else [root, model], _KNOWN),
        ),
    )


class _Values(Values):
    """Values that are texts of an element's children, as SDF has them."""

    unbounded, zero_bounds = None, True

    def text(self, element: Element | None, key: str) -> str | None:
        """The text of a child, None if there is none."""
        return _text(element, key) or None

    def label(self, key: str) -> str:
        """A key as messages have it."""
        return f"<{key}>"


def _numbers(values: Values, element: Element, count: int) -> list[float]:
    """The numbers in the text of an element, which is read by that."""
    element.read.add("")
    return values.numbers(element, element.text or "", count)


class _ModelReader:
    """Takes a model apart; names of links, joints and frames share one space."""

    def __init__(self, model: Element, values: Values) -> None:
        self._values, self._canonical = values, model.get("canonical_link", "")
        self._model = model
        self.elements: dict[str, Element] = {}
        self._poses: dict[str, tuple[str, Pose]] = {}
        for element in children(model, *PLACED):
            other = self.elements.setdefault(values.name(element), element)
            if other is not element:
                values.fault(element, f"there is another {other.tag} of that name")
        for name, element in self.elements.items():
            self._poses[name] = self._pose(element, self._stands_in(element))
        for name, element in self.elements.items():
            placed = element.get("placement_frame")
            if placed and self._is_placed(placed, element):
                place, pose = self._poses[name]
                self._poses[name] = place, pose @ self._between(name, placed).inverse

    def links(self) -> dict[str, sources.SourceBody]:
        """The links, with the world where a joint hangs on it."""
        links = {name: self._body(name, element) for name, element in self._of_kind("link")}
        for name, element in self._of_kind("link"):
            self._values.weightless(name, _text(element, "gravity"))
        parents = {_text(joint, "parent") for _, joint in self._of_kind("joint")}
        return ({WORLD: sources.SourceBody(WORLD)} if WORLD in parents else {}) | links

    def joints(self) -> tuple[sources.SourceJoint, ...]:
        """The joints, each of a parent before its pose and a child after its offset."""
        gearboxes = {n: e for n, e in self._of_kind("joint") if e.get("type") == "gearbox"}
        others = (pair for pair in self._of_kind("joint") if pair[0] not in gearboxes)
        joints = {name: self._joint(name, element) for name, element in others}
        for name, element in gearboxes.items():
            pass_over(element)
            if gear := self._gearbox(name, element, joints):
                joints |= gear
            else:
                words = "a gearbox of links that do not turn about its axes on its reference body"
                self._values.report("left out", name, words)
        return tuple(joints.values())

    def _gearbox(
        self, name: str, element: Element, joints: Mapping[str, sources.SourceJoint]
    ) -> dict[str, sources.SourceJoint]:
        """The joint of the child with the gear by which that of the parent moves it, by its name.

        It is empty where the reference body carries not both on such joints.
        """
        carrier, ends, ratio = self._carrier(_text(element, "gearbox_reference_body")), [], -1.0
        for tag, axis in (("parent", "axis"), ("child", "axis2")):
            link = self._carrier(_text(element, tag))
            for joint in joints.values():
                if (joint.parent, joint.child, joint.kind) == (carrier, link, "revolute"):
                    turn = self._between(joint.name, name).matrix
                    way = float(joint.link.axis @ turn @ self._axis(name, child(element, axis)))
                    if abs(way) > _ALONG:
                        ratio *= math.copysign(1.0, way)
                        ends.append(joint)
        if len(ends) != 2:
            return {}
        ratio *= self._values.number(element, "gearbox_ratio", 1.0)
        gear = sources.SourceGear({ends[0].name: ratio}, 0.0)
        return {ends[1].name: replace(ends[1], gear=gear)}

    def frames(self) -> tuple[sources.SourceFrame, ...]:
        """Frames on links."""
        frames = []
        for name, _ in self._of_kind("frame"):
            link = self._carrier(name)
            if link == WORLD:
                words = "on the world: a robot has frames of its own"
                self._values.report("left out", name, words)
            elif link and not name.rpartition("::")[2].startswith(MERGED):
                pose = self._between(link, name)
                frames.append(sources.SourceFrame(name, pose=pose, link=link))
        return tuple(frames)

    def place(self, link: str) -> Pose:
        """The pose of a link in the world."""
        place = self._placement(child(self._model, "pose"))
        if placed := self._model.get("placement_frame"):
            place @= self._between(MODEL, placed).inverse
        return place @ self._between(MODEL, link)

    def _of_kind(self, tag: str) -> Iterator[tuple[str, Element]]:
        return ((name, e) for name, e in self.elements.items() if e.tag == tag)

    def _stands_in(self, element: Element) -> str:
        """The frame that an element is placed in, where its pose does not say."""
        if element.tag == "joint":
            return _text(element, "child") or MODEL
        return element.get("attached_to") or MODEL

    def _pose(self, element: Element, default: str) -> tuple[str, Pose]:
        """The frame that an element is placed in, and its pose there."""
        pose = child(element, "pose")
        outer = None if pose is None else pose.get("relative_to") or pose.get("frame")
        names = {default: element}
        if pose is not None and outer:
            names[outer] = pose
        for name, by in names.items():
            if name not in (MODEL, WORLD) and not self._is_placed(name, by):
                return MODEL, HERE
        return outer or default, self._placement(pose)

    def _is_placed(self, name: str, by: Element) -> bool:
        """True if a link, joint or frame that an element names is there; else it is a fault."""
        if name not in self.elements:
            words = f"there is no link, joint or frame {printable(name, 60)}"
            self._values.fault(by, words + near(name, self.elements))
        return name in self.elements

    def _placement(self, element: Element | None) -> Pose:
        """The numbers of a pose: a place, then roll, pitch and yaw or a quaternion."""
        if element is None or not (element.text or "").strip():
            return HERE
        if element.get("rotation_format") == "quat_xyzw":
            x, y, z, *turn = _numbers(self._values, element, 7)
            return self._values.turned(element, (x, y, z), turn)
        x, y, z, *angles = _numbers(self._values, element, 6)
        if element.get("degrees") in ("true", "1"):
            angles = [math.radians(angle) for angle in angles]
        roll, pitch, yaw = map(degrees, angles)
        return Pose((x + 0.0, y + 0.0, z + 0.0), (roll, pitch, yaw))

    def _way(self, name: str) -> list[str]:
        """The frames that an element is placed in, from itself to the model."""
        way, passed = [name], {name}
        while way[-1] in self._poses:
            stands_in = self._poses[way[-1]][0]
            if stands_in in passed or len(way) > _DEEPEST:
                words = "is placed relative to itself through others"
                if stands_in not in passed:
                    words = f"is placed relative to more than {_DEEPEST} others, one in the other"
                self._values.fault(self.elements[name], words)
                self._poses[name] = (MODEL, HERE)
                return [name, MODEL]
            way.append(stands_in)
            passed.add(stands_in)
        return [*way[:-1], MODEL]  # The world's frame is where the model's is.

    def _between(self, outer: str, inner: str) -> Pose:
        """The pose of an element in another."""
        back, there = self._way(outer), self._way(inner)
        while len(back) > 1 and len(there) > 1 and back[-2] == there[-2]:
            back.pop()
            there.pop()
        return self._along(back).inverse @ self._along(there)

    def _along(self, way: list[str]) -> Pose:
        """The pose of the first of a way in the last."""
        poses = [self._poses[name][1] for name in way[:-1]]
        turned = [pose for pose in poses if pose.rpy_deg != LEVEL]
        place, turn = np.zeros(3), np.eye(3)
        for pose in poses:
            place = pose.point(place)
            turn = pose.matrix @ turn
        # The angles of one that is turned stay digit by digit.
        if len(turned) > 1:
            return Pose.of_matrix(place, turn)
        return Pose(vector(place), turned[0].rpy_deg if turned else LEVEL)

    def _carrier(self, name: str) -> str:
        """The link that an element is on, by what frames are attached to; else an empty text."""
        on = name
        for _ in range(len(self.elements) + 1):
            element = self.elements.get(on)
            if element is None:
                return self._canonical if on == MODEL else on
            if element.tag == "link":
                return on
            on = _text(element, "child") if element.tag == "joint" else self._stands_in(element)
        self._values.fault(self.elements[name], "is attached to itself through others")
        return ""

    def _body(self, name: str, element: Element) -> sources.SourceBody:
        """A link, by default of 1 kg, and 1 kg m² about each axis, as SDF says."""
        values, inertial = self._values, child(element, "inertial")
        if inertial is not None and inertial.get("auto") in ("true", "1"):
            values.fault(
                inertial,
                "takes its inertia from shapes, which import does not read; write <inertial> "
                "values",
            )
        entries = child(inertial, "inertia")
        mass = values.positive(inertial, "mass", 1.0)
        inertia = values.inertia(entries, 1.0)
        lacking = [] if _text(inertial, "mass") else ["mass"]
        alone = [f"i{pair}" for pair in AXIS_PAIRS[:3] if not _text(entries, f"i{pair}")]
        lacking += alone if entries is not None else ["inertia"]
        if lacking:
            words = (
                f"no {', '.join(lacking)} in the file, so SDF's defaults of 1 kg and 1 kg m² apply"
            )
            values.report("note", name, words)
        place = self._placement(child(inertial, "pose"))
        return sources.SourceBody(name, RigidBody(mass=mass, inertia=inertia), place, element.line)

    def _joint(self, name: str, element: Element) -> sources.SourceJoint:
        values, word = self._values, self._values.kind(element, _KINDS)
        kind = KINDS[word] if word in _KINDS else "fixed"
        ends = [_text(element, tag) for tag in ("parent", "child")]
        for tag, end in zip(("parent", "child"), ends, strict=True):
            if not end:
                values.fault(element, f"has no <{tag}>")
        parent, moved = (self._carrier(end) for end in ends)
        axis = child(element, "axis")
        if kind == "fixed":
            pass_over(axis)
            axis = None
        dynamics = child(axis, "dynamics")
        limits = values.limits(child(axis, "limit"), word == "continuous")
        stiffness = values.number(dynamics, "spring_stiffness", 0.0)
        rest = values.number(dynamics, "spring_reference", 0.0)
        gear = values.gear(child(axis, "mimic"))
        pose = self._between(parent if parent in self.elements else MODEL, name)
        axis_of_joint, offset = self._axis(name, axis), self._between(name, moved)
        spring = {"stiffness": stiffness, "rest": rest if stiffness else 0.0}
        link = values.link(name, dynamics, axis_of_joint, limits, **spring)
        if kind == "revolute":
            inertia = values.positive(element, "drake:rotor_inertia")
            ratio = values.number(element, "drake:gear_ratio", 1.0)
            if inertia and ratio:
                link = replace(link, motor=Motor(rotor_inertia=inertia, gear_ratio=ratio))
        return sources.SourceJoint(
            name, kind, parent, moved, pose, link, offset, element.line, gear
        )

    def _axis(self, name: str, axis: Element | None) -> tuple[float, float, float]:
        """The unit vector of a joint's axis in the joint's frame."""
        if (components := child(axis, "xyz")) is None:
            return AXES["z"]
        direction = np.array(_numbers(self._values, components, 3))
        if seen_from := components.get("expressed_in"):
            direction = self._between(name, seen_from).matrix @ direction
        return self._values.unit(components, vector(direction))
