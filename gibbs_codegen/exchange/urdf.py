"""URDF, read with the standard library's parser and nothing else.

What other readers drop is kept: thrust of rotors, for which URDF has no element, by Gazebo's motor
plugins and JSK's convention. Both push along z of a link. A drag is negative for a rotor that spins
counter-clockwise, seen from the tip of its thrust.

What else a file says, and has a part in the motion, is left out and reported with its lines.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import Fault, near, printable
from gibbs_codegen.exchange import sources
from gibbs_codegen.exchange.unread import WITHIN, pass_over, plain, unread, without_part
from gibbs_codegen.exchange.xml_file import (
    Element,
    child,
    child_text,
    children,
    described,
    parse_xml,
    within,
)
from gibbs_codegen.robot.parts.body import Inertia, RigidBody
from gibbs_codegen.robot.parts.constraint import LoopJoint
from gibbs_codegen.robot.parts.friction import Friction
from gibbs_codegen.robot.parts.link import JointLimits, Link, Passive
from gibbs_codegen.robot.parts.motor import Motor
from gibbs_codegen.robot.parts.numbers import AXES, AXIS_PAIRS, LEAST, MOST, ORIGIN, Vector3
from gibbs_codegen.robot.parts.pose import Pose, vector
from gibbs_codegen.robot.parts.rotor import Command
from gibbs_codegen.robot.rotations import degrees, turn_of_quaternion

# What some exporters write for no limit.
_ENDLESS = 1e15


class Values:
    """Reads values of elements and collects `faults`; a faulty value counts as its default.

    `findings` are lines of the report, `friction` is whether the dry friction of joints is taken,
    and `quaternions` whether an `<origin>` may have one.
    """

    # The bound of a joint whose limits have none, and whether an effort of 0 is a bound.
    unbounded: float | None = 0.0
    zero_bounds = False

    def __init__(self, friction: bool, quaternions: bool = False) -> None:
        self.faults: list[Fault] = []
        self.findings: list[sources.Finding] = []
        self._friction, self._quaternions = friction, quaternions

    def text(self, element: Element | None, key: str) -> str | None:
        """The text of a value by its key, None if there is none."""
        return None if element is None else element.get(key)

    def label(self, key: str) -> str:
        """A key as messages have it."""
        return key

    def report(self, kind: sources.Kind, subject: str, detail: str) -> None:
        """Add a line to the report."""
        self.findings.append(sources.Finding(kind, subject, detail))

    def weightless(self, name: str, gravity: str, off: str = "") -> None:
        """Note a link on which no gravity acts in Gazebo, by texts of its flags."""
        here = "; here it has its weight"
        if plain(gravity or "1") == "0" or plain(off) == "1":
            self.report("note", name, f"no gravity acts on it in Gazebo{here}")
        for text in (gravity, off):
            if plain(text or "1") not in ("0", "1"):
                words = f"its gravity flag is {printable(text, 40)}"
                self.report("note", name, f"{words}, not true or false{here}")

    def fault(self, element: Element, message: str) -> None:
        """Note a fault of an element: what is wrong, and what would be right."""
        message += element.elsewhere and f" ({printable(element.elsewhere)})"
        self.faults.append(Fault(described(element), message, element.line))

    def name(self, element: Element, attribute: str = "name") -> str:
        """A name, or an empty text if there is none, which is a fault."""
        text = element.get(attribute, "").strip()
        if not text:
            self.fault(element, f"has no {attribute}")
        elif not text.isprintable() or len(text) > 200:
            self.fault(element, f"{attribute} must be at most 200 printable characters")
        return text

    def number(self, element: Element | None, key: str, default: float | None = None) -> float:
        """A finite number, which must be there unless it has a default."""
        if element is not None and (text := self.text(element, key)) is not None:
            return self.of_text(element, self.label(key), text)
        if element is not None and default is None:
            self.fault(element, f"has no {self.label(key)}")
        return default or 0.0

    def of_text(self, element: Element, subject: str, text: str) -> float:
        """The number that a text holds, 0 if it is faulty; messages call it `subject`."""
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not abs(value) <= MOST:
            is_not = printable(text, 40) or "an empty text"
            words = f"{subject} must be a finite number up to {MOST:g} in size, not {is_not}"
            self.fault(element, words)
            return 0.0
        return value if abs(value) >= LEAST else 0.0

    def positive(self, element: Element | None, key: str, default: float = 0.0) -> float:
        """A number that is at least 0."""
        value = self.number(element, key, default)
        if value < 0.0 and element is not None:
            self.fault(element, f"{self.label(key)} must be at least 0, not {value:g}")
        return max(value, 0.0)

    def bound(
        self, element: Element | None, key: str, default: float | None = None
    ) -> float | None:
        """A limit; one that is endless is None."""
        if element is None or (text := self.text(element, key)) is None:
            return default
        with suppress(ValueError):  # Some write the greatest number that there is.
            if abs(float(text)) >= _ENDLESS:
                return None
        return self.of_text(element, self.label(key), text)

    def limits(self, element: Element | None, endless: bool) -> JointLimits:
        """Limits of a joint, of which one that turns without end has those of effort and rate."""
        if element is None:
            return JointLimits()
        low, high = (
            None if endless else self.bound(element, key, self.unbounded)
            for key in ("lower", "upper")
        )
        pass_over(element if endless else None)
        if low is not None and high is not None and low > high:
            words = f"{self.label('lower')} {low:g} is above {self.label('upper')} {high:g}"
            self.fault(element, words)
        effort, velocity = (
            bound
            if bound is not None and (bound > 0.0 or (bound == 0.0 and self.zero_bounds))
            else None
            for bound in (self.bound(element, key) for key in ("effort", "velocity"))
        )
        return JointLimits(low, high, effort, velocity)

    def friction(self, joint: str, dynamics: Element | None) -> Friction | None:
        """Dry friction of a joint, where it is taken; else nothing in it is a fault."""
        if self._friction:
            return sources.dry_friction(self.positive(dynamics, "friction"))
        if (text := plain(self.text(dynamics, "friction") or "0")) != "0":
            self.report("left out", joint, f"dry friction {printable(text, 20)}")
        return None

    def link(
        self,
        joint: str,
        dynamics: Element | None,
        axis: Vector3,
        limits: JointLimits,
        **spring: Any,
    ) -> Link:
        """What the link that a joint carries has of it."""
        passive = Passive(damping=self.positive(dynamics, "damping"), **spring)
        friction = self.friction(joint, dynamics)
        return Link(sources.NO_BODY, axis=axis, passive=passive, limits=limits, friction=friction)

    def gear(self, mimic: Element | None) -> sources.SourceGear | None:
        """The gear that makes a joint follow another, from where that is in SDF."""
        if mimic is None:
            return None
        ratio, offset = self.number(mimic, "multiplier", 1.0), self.number(mimic, "offset", 0.0)
        start = self.number(mimic, "reference", 0.0)
        return sources.SourceGear({self.name(mimic, "joint"): ratio}, offset - ratio * start)

    def inertia(self, element: Element | None, default: float | None) -> Inertia:
        """An inertia, of which only the moments may be required or have a default but 0."""
        xx, yy, zz, xy, xz, yz = (
            self.number(element, f"i{pair}", default if pair[0] == pair[1] else 0.0)
            for pair in AXIS_PAIRS
        )
        return xx, yy, zz, xy, xz, yz

    def kind(self, element: Element, kinds: Iterable[str]) -> str:
        """The type of an element, which must be one of some."""
        word: str = element.get("type", "")
        if word not in kinds:
            words = f"type must be one of {', '.join(kinds)}, not {printable(word or 'none', 40)}"
            self.fault(element, words)
        return word

    def unit(self, element: Element, axis: Vector3) -> Vector3:
        """A direction of length 1, kept digit by digit if, as far as numbers go, it has it."""
        size = math.hypot(*axis)
        if not size > 0.0:
            self.fault(element, "its axis has no length; give a direction such as 0 0 1")
            return AXES["x"]
        return axis if abs(size - 1.0) <= 4e-16 else vector(np.array(axis) / size)

    def numbers(self, element: Element, text: str, count: int, subject: str = "") -> list[float]:
        """So many numbers of a text; messages call them `subject`, if it is not empty."""
        words = text.split()
        if len(words) != count:
            self.fault(element, f"{subject} must have {count} numbers, not {len(words)}".strip())
            return [0.0] * (count - 1) + [-1.0]  # A direction, a turn or downwards, as it may be.
        return [self.of_text(element, subject or "each of its entries", word) for word in words]

    def vector(self, element: Element | None, attribute: str, default: Vector3) -> Vector3:
        """Three numbers."""
        text = None if element is None else element.get(attribute)
        if element is None or text is None:
            return default
        return vector(self.numbers(element, text, 3, attribute))

    def turned(self, element: Element, xyz: Vector3, turn: Sequence[float]) -> Pose:
        """The pose at a place whose quaternion x, y, z, w has any length but zero."""
        if not (size := math.hypot(*turn)) > 0.0:
            self.fault(element, "has a quaternion that is zero")
            return Pose(xyz)
        x, y, z, w = (entry / size for entry in turn)
        return Pose.of_matrix(xyz, turn_of_quaternion(x, y, z, w))

    def placement(self, element: Element | None) -> Pose:
        """The pose that an `<origin>` gives, or that of one left out."""
        xyz = self.vector(element, "xyz", (0.0, 0.0, 0.0))
        if element is not None and self._quaternions and "quat_xyzw" in element.attrib:
            if "rpy" in element.attrib:
                self.fault(element, "has both rpy and quat_xyzw; remove one of them")
            turn = self.numbers(element, element.get("quat_xyzw"), 4, "quat_xyzw")
            return self.turned(element, xyz, turn)
        roll, pitch, yaw = map(degrees, self.vector(element, "rpy", (0.0, 0.0, 0.0)))
        return Pose(xyz, (roll, pitch, yaw))


_THRUST = "thrust"
# What Gazebo, Gazebo Classic and RotorS take for the numbers that a motor does not give; the first
# are those that a thrust needs.
_MOTOR = {
    **{"momentConstant": 0.016, "motorConstant": 8.54858e-06, "maxRotVelocity": 838.0},
    **{"timeConstantUp": 0.0125, "timeConstantDown": 0.025, "rotorDragCoefficient": 1e-4},
    "rollingMomentCoefficient": 1e-6,
}
_FOR_THRUST = 4


def urdf_rotors(
    root: Element, values: Values, command: Command = "thrust"
) -> list[sources.SourceRotor]:
    """The rotors under `<robot>`: motors of Gazebo, then what else JSK's convention says."""
    gazebo = gazebo_rotors(root, values, command)
    claimed = {rotor.joint for rotor in gazebo} | {rotor.link for rotor in gazebo}
    jsk = _jsk(root, values)
    return gazebo + [r for r in jsk if r.joint not in claimed and r.link not in claimed]


def gazebo_rotors(root: Element, values: Values, command: Command) -> list[sources.SourceRotor]:
    """Motors of Gazebo under an element, in the order of their numbers or of the file.

    They are commanded a thrust or, as there, a speed.
    """
    numbered, missing, rolling, slowdowns = [], dict[str, float](), 0, set[str]()
    for plugin in filter(is_motor, within(root, "plugin")):
        texts = {inner.tag: (inner.text or "").strip() for inner in children(plugin)}
        plugin.read.add("")
        for tag in (*_MOTOR, "linkName", "jointName", "turningDirection"):
            child(plugin, tag)
        texts.setdefault("motorNumber", texts.get("actuator_number", ""))  # As new files have it.
        turning = texts.get("turningDirection", "")
        if turning not in ("cw", "ccw"):
            words = f"<turningDirection> must be cw or ccw, not {turning or 'left out'}"
            values.fault(plugin, words)
        needed = [*_MOTOR][: None if command == "speed" else _FOR_THRUST]
        in_file = {tag: text for tag in needed if (text := texts.get(tag))}
        moment, constant, fastest, up, down, hub_drag, _ = (
            values.of_text(plugin, f"<{tag}>", in_file[tag]) if tag in in_file else usual
            for tag, usual in _MOTOR.items()
        )
        missing |= {tag: usual for tag, usual in _MOTOR.items() if not texts.get(tag)}
        rolling += plain(texts.get("rollingMomentCoefficient", "")) != "0"
        slowdowns.add(plain(texts.get("rotorVelocitySlowdownSim") or "1"))
        number = values.of_text(plugin, "<motorNumber>", texts["motorNumber"] or "0")
        most = constant * fastest**2
        rotor = sources.SourceRotor(
            name=texts["linkName"],
            link=texts["linkName"],
            drag=-moment if turning == "ccw" else moment,
            limits=(0.0, most) if most > 0.0 else None,
            time_constant=up or None,
            joint=texts.get("jointName"),
            evidence="Gazebo",
            line=plugin.line,
        )
        if command == "speed":
            bounds = (0.0, fastest) if fastest > 0.0 else None
            rotor = replace(
                rotor,
                limits=None,
                time_constant=None,
                command=command,
                thrust_curve=(0.0, 0.0, constant),
                command_limits=bounds,
                time_constants=(up or down, down or up) if up or down else None,
                hub_drag=hub_drag,
            )
        numbered.append((number, rotor))
    if rolling:
        values.report("left out", "rolling moments of rotors", f"{rolling}")
    if missing:
        usual = ", ".join(f"{tag} {missing[tag]:g}" for tag in _MOTOR if tag in missing)
        values.report("note", "rotors", f"not in the file, as in Gazebo: {usual}")
    for factor in sorted(slowdowns - {"1"}):
        words = (
            f"scaled for rotorVelocitySlowdownSim {printable(factor, 20)}: the inertias of their "
            "links"
        )
        values.report("note", "rotors", f"{words} may be that many times too large")
    return [rotor for _, rotor in sorted(numbered, key=itemgetter(0))]


def is_rotor_by_name(joint: str, link: str, prefix: str = _THRUST) -> bool:
    """True if a joint is a rotor by the convention of JSK, in a file without a common rate.

    `link` is what it carries, and `prefix` how the links of rotors begin.
    """
    return bool(re.fullmatch(r"rotor\d+", joint) and re.fullmatch(rf"{re.escape(prefix)}\d+", link))


def is_motor(plugin: Element) -> bool:
    """True if a plugin is a motor with a propeller, and not a servo, which is a motor too."""
    kind = child(plugin, "motorType")
    if kind is not None and (kind.text or "").strip() != "velocity":
        return False
    name = plugin.attrib.get("filename", "") + plugin.attrib.get("name", "")  # Not read by that.
    models_motor = re.search("motor.?model", name.lower()) or child_text(plugin, "motorConstant")
    return bool(models_motor and child_text(plugin, "linkName"))


def _jsk(root: Element, values: Values) -> list[sources.SourceRotor]:
    """Rotors by the convention of JSK: joints rotor1, rotor2 …, whose limits are of the thrust.

    A joint may have an `<m_f_rate>` of its own, as `export` writes it: then it is a rotor by any
    name, and there need not be one rate for all.
    """
    common = child(root, "m_f_rate")
    thrust = child(root, "thrust_link")
    prefix = _THRUST if thrust is None else thrust.get("name", _THRUST)
    numbered = []
    for joint in children(root, "joint"):
        rate_of_joint, link = child(joint, "m_f_rate"), child(joint, "child")
        name, on = joint.get("name", ""), "" if link is None else link.get("link", "")
        by_name = is_rotor_by_name(name, on if common is None else f"{prefix}0", prefix)
        if rate_of_joint is None and not by_name:
            continue
        rate = values.number(rate_of_joint if rate_of_joint is not None else common, "value", 0.0)
        z = values.vector(child(joint, "axis"), "xyz", AXES["z"])[2]
        limit = child(joint, "limit")
        low, high = values.bound(limit, "lower"), values.bound(limit, "upper")
        drag = (z > 0.0) * rate - (z < 0.0) * rate
        limits = None if low is None or high is None or low >= high else (low, high)
        number = int(name.removeprefix("rotor")) if rate_of_joint is None else 0
        rotor = sources.SourceRotor(
            name=name, link=on, drag=drag, limits=limits, joint=name, evidence="JSK"
        )
        numbered.append((number, rotor))
    return [rotor for _, rotor in sorted(numbered, key=itemgetter(0))]


KINDS: dict[str, sources.JointKind] = {"revolute": "revolute", "continuous": "revolute"}
KINDS |= {"prismatic": "prismatic", "fixed": "fixed", "floating": "floating", "planar": "planar"}
# What is only counted in URDF and SDF, under these words, and what has no part in the motion.
COUNTED = {
    "visual": "visual shapes",
    "collision": "collision shapes",
    "plugin": "plugins other than motors",
}
OF_MOTORS = """
    @ name filename
    plugin/ robotNamespace commandSubTopic motorSpeedPubTopic rotorVelocitySlowdownSim motorNumber
        actuator_number rollingMomentCoefficient reversible=0
"""
_KNOWN = COUNTED | dict.fromkeys(("transmission", "ros2_control"), "transmissions")
_KNOWN |= {"controller:": COUNTED["plugin"], "robot/gazebo": WITHIN}
_KNOWN |= {"joint/safety_controller": "safety controllers, and their limits"}
_KNOWN |= without_part(f"""{OF_MOTORS}
    / sensor: material
    robot@ version
    robot/ sensor baselink drake:collision_filter_group
    link@ type
    link/ contact surface self_collision_checking collision_checking self_filter gravity=1
        kinematic=0
    joint/ calibration
    limit@ acceleration deceleration jerk drake:acceleration
    mimic@ multiplier offset gazebo@ reference
    gazebo/ sensor visual light canonicalBody static=0 kinematic=0
        dampingFactor=0 velocity_decay=0 enable_wind=0 mu mu1 mu2 fdir1 kp kd maxVel minDepth
        maxContacts laserRetro selfCollide self_collide stopCfm stopErp stopKp stopKd cfm erp
        fudgeFactor implicitSpringDamper provideFeedback initial_joint_position
        preserveFixedJoint disableFixedJointLumping
""")


def read_urdf(data: bytes, file: str, command: Command, friction: bool) -> sources.Source:
    """Read a robot in URDF, unchecked as a tree; raises `SourceFileError` with every fault.

    Motors of Gazebo are commanded a thrust or, as there, a speed. `friction` is whether the dry
    friction of joints is taken.
    """
    root = parse_xml(data, file)
    values = Values(friction, bool(re.match(r"1\.[1-9]|[2-9]", root.get("version", ""))))
    if root.tag != "robot":
        values.fault(root, "is not URDF: the root element of URDF is <robot>")
        raise sources.SourceFileError(file, values.faults)
    elements = within(root)
    spaces = {key for other in elements for key, uri in other.attrib.items() if "/xacro" in uri}
    xacro = {f"{key.removeprefix('xmlns:')}:" for key in spaces} | {"xacro:"}
    for element in [other for other in elements if other.tag.startswith((*xacro,))][:1]:
        values.fault(element, "is xacro, not URDF; name the file .xacro to have it expanded")
    readers: dict[str, Callable[[Element, Values], Any]]
    readers = {"link": _link, "joint": _joint, "constraint": _constraint}
    parts: dict[str, dict[str, Any]] = {tag: {} for tag in readers}
    for element in children(root, *readers):
        part, tag = readers[element.tag](element, values), element.tag
        if part.name in parts[tag]:
            values.fault(element, f"there is another {tag} of that name")
        parts[tag][part.name] = part
    placed = [*parts["link"], *parts["joint"]]
    for element in children(root, "gazebo"):
        flags = (child_text(element, tag) for tag in ("gravity", "turnGravityOff"))
        if (name := element.get("reference")) is None or name in placed:
            values.weightless(name or root.tag, *flags)
        else:
            words = f"<gazebo> refers to it in line {element.line}; there is no such link or joint"
            values.report("note", name, words + near(name, placed))
    rotors = urdf_rotors(root, values, command)
    joints = _with_motors(root, values, parts["joint"])
    if not parts["link"]:
        values.fault(root, "has no <link>")
    if values.faults:
        raise sources.SourceFileError(file, values.faults)
    return sources.Source(
        file,
        root.get("name", ""),
        parts["link"],
        joints,
        tuple(rotors),
        spinning=frozenset(rotor.joint for rotor in rotors if rotor.joint),
        constraints=tuple(parts["constraint"].values()),
        findings=(*unread([root], _KNOWN), *values.findings),
    )


def _with_motors(
    root: Element, values: Values, joints: Mapping[str, sources.SourceJoint]
) -> tuple[sources.SourceJoint, ...]:
    """The joints with motors behind gears of transmissions that have a rotor, as Drake's do.

    A reduction by itself is reported: it is nothing without the inertia of a rotor.
    """
    driven = dict(joints)
    for element in children(root, "transmission"):
        held, actuators = (children(element, x) for x in ("joint", "actuator"))
        joint = driven.get(held[0].get("name", "")) if len(held) == len(actuators) == 1 else None
        if joint is None or joint.kind != "revolute":
            continue
        (actuator,) = actuators
        reduction = child_text(actuator, "mechanicalReduction") or "1"
        if (rotor := child(actuator, "drake:rotor_inertia")) is not None:
            pass_over(element)
            # Files for ROS and Drake say the same ratio twice; Drake reads its own alone.
            ratio = values.of_text(actuator, "<mechanicalReduction>", reduction)
            ratio = values.number(child(actuator, "drake:gear_ratio"), "value", ratio)
            if (inertia := values.positive(rotor, "value")) and ratio:
                motor = Motor(rotor_inertia=inertia, gear_ratio=ratio)
                driven[joint.name] = replace(joint, link=replace(joint.link, motor=motor))
        elif plain(reduction) != "1":
            words = f"a reduction of {printable(reduction, 20)}: the file has no inertia of a rotor"
            values.report("left out", joint.name, f"{words}, which motor = {{ … }} gives")
    return (*driven.values(),)


def _link(element: Element, values: Values) -> sources.SourceBody:
    name, inertial = values.name(element), child(element, "inertial")
    if inertial is None:
        return sources.SourceBody(name, line=element.line)
    heavy, entries = child(inertial, "mass"), child(inertial, "inertia")
    parts = {"mass": heavy is not None and heavy.get("value"), "inertia": entries is not None}
    for part in [part for part, there in parts.items() if not there]:
        values.report("note", name, f"no {part} in the file, which is taken as 0")
    mass = values.positive(heavy, "value")
    inertia = values.inertia(entries, None)
    pose = values.placement(child(inertial, "origin"))
    return sources.SourceBody(name, RigidBody(mass=mass, inertia=inertia), pose, element.line)


def _joint(element: Element, values: Values) -> sources.SourceJoint:
    word = values.kind(element, KINDS)
    kind = KINDS.get(word, "fixed")
    ends = []
    for tag in ("parent", "child"):
        if (end := child(element, tag)) is None:
            values.fault(element, f"has no <{tag}>")
        ends.append("" if end is None else values.name(end, "link"))
    axis, moves, name = AXES["z"], kind in ("revolute", "prismatic"), values.name(element)
    limit, dynamics = child(element, "limit"), child(element, "dynamics")
    if moves:
        axis = values.unit(element, values.vector(child(element, "axis"), "xyz", AXES["x"]))
    else:
        if kind == "planar":  # Who gives no axis means the floor, though URDF has x.
            if child(element, "axis") is None:
                values.report("note", name, "no <axis>: z is taken, the normal of the floor")
            axis = values.unit(element, values.vector(child(element, "axis"), "xyz", AXES["z"]))
        for unused in (child(element, "axis"), limit, dynamics):
            pass_over(unused)
        limit = dynamics = None
    limits = values.limits(limit, word == "continuous")
    pose = values.placement(child(element, "origin"))
    gear = values.gear(child(element, "mimic"))
    link, (parent, moved) = values.link(name, dynamics, axis, limits), ends
    return sources.SourceJoint(name, kind, parent, moved, pose, link, line=element.line, gear=gear)


_LOOPS: dict[str, LoopJoint] = {"fixed": "fixed", "revolute": "revolute"}
_LOOPS |= {"continuous": "revolute", "spherical": "spherical"}
_IN_CONSTRAINTS = {
    tag: keys
    for end in ("parent", "child")
    for tag, keys in {
        end: {"link"},
        f"{end}_origin": {"xyz", "rpy", "quat_xyzw"},
        f"{end}_axis": {"xyz"},
    }.items()
}


def _constraint(element: Element, values: Values) -> sources.SourceConstraint:
    """A closed loop as urdfdom's pull request 264 proposes it: a joint between two frames."""
    name, word = values.name(element), values.kind(element, _LOOPS)
    for inner in children(element):
        keys = _IN_CONSTRAINTS.get(inner.tag)
        if keys is None or {*inner.attrib} - keys:
            values.fault(inner, f"is not known here; a constraint has {', '.join(_IN_CONSTRAINTS)}")
    frames, axes = [], []
    for end in ("parent", "child"):
        if (link := child(element, end)) is None:
            values.fault(element, f"has no <{end}>")
        on = "" if link is None else values.name(link, "link")
        pose = values.placement(child(element, f"{end}_origin"))
        frames.append(sources.SourceFrame(f"{name}_{end}", pose=pose, link=on))
        axis = values.vector(child(element, f"{end}_axis"), "xyz", AXES["x"])
        axes.append(values.unit(element, axis))
    anchor, held = frames
    joint = _LOOPS.get(word, "fixed")
    if joint == "revolute" and axes[0] != axes[1]:
        # The frame is turned, so that the axis has the same numbers in both.
        turn, _ = Rotation.align_vectors([axes[1]], [axes[0]])
        turned = held.pose @ Pose.of_matrix(ORIGIN, turn.as_matrix())
        held = replace(held, pose=turned)
    axis = axes[0] if joint == "revolute" else AXES["z"]
    return sources.SourceConstraint.between(name, joint, (held, anchor), axis)
