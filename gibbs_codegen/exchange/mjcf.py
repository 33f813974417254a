"""MJCF, read through MuJoCo's own compiler: defaults, classes and inertia from shapes are its work.

A body with several joints becomes several links, those before the last without mass. A ball joint
becomes three hinges about x, y and z.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.errors import Fault, UsageError, printable
from gibbs_codegen.exchange import sources, xml_file
from gibbs_codegen.exchange.placement import Placement, vector
from gibbs_codegen.robot.model import AXES, JointLimits, Passive
from gibbs_codegen.robot.placement import Array, turn_of_quaternion

_JOINT, _SITE = 0, 4
# Of equalities: the kind, and that they are between sites rather than bodies.
_WELD, _OF_SITES = 1, 6
_FILTERS = (2, 3)
_NO_BIAS = 0


def mjcf_rotors(
    model: Any, names: Sequence[str], bodies: Sequence[int]
) -> tuple[tuple[sources.Rotor, ...], list[sources.Finding]]:
    """The rotors on such bodies of a compiled model, by actuators, and what was left out."""
    rotors, findings = [], []
    for k in range(model.nu):
        if model.actuator_trntype[k] != _SITE:
            continue
        site, gear = model.actuator_trnid[k, 0], np.array(model.actuator_gear[k])
        body, size = model.site_bodyid[site], float(np.linalg.norm(gear[:3]))
        size = 1.0 if abs(size - 1.0) < 4e-16 else size
        name = model.actuator(k).name or f"rotor_{k + 1}"
        if body not in bodies:
            continue
        if size == 0.0:
            why = "an actuator of torque without a force, no rotor"
            findings.append(sources.Finding("left out", name, why))
            continue
        turn = _turn(model.site_quat[site])
        direction = gear[:3] / size
        drag = float(direction @ gear[3:]) / size
        if np.abs(gear[3:] - drag * gear[:3]).max() > 1e-9 * np.abs(gear).max():
            findings.append(sources.Finding("left out", name, "torque across the thrust"))
        limits = _range(model, k, size)
        if limits is not None and limits[1] <= 0.0:  # It pulls: turned, it pushes.
            direction, limits = -direction, (-limits[1], -limits[0])
        rotors.append(
            sources.Rotor(
                name,
                names[body],
                vector(model.site_pos[site]),
                vector(turn @ direction),
                drag,
                limits,
                float(model.actuator_dynprm[k, 0]) or None
                if model.actuator_dyntype[k] in _FILTERS
                else None,
                found_by="motor at a site",
            )
        )
    return tuple(rotors), findings


def efforts(model: Any) -> dict[int, float]:
    """The largest torque or force, N m or N, of motors at joints, by the number of the joint."""
    found = {
        j: float(np.abs(model.jnt_actfrcrange[j]).max())
        for j in range(model.njnt)
        if model.jnt_actfrclimited[j]
    }
    for k in range(model.nu):
        if model.actuator_trntype[k] != _JOINT:
            continue
        limits = _range(model, k, abs(float(model.actuator_gear[k, 0])))
        if limits is not None and (most := max(map(abs, limits))) > 0.0:
            j = int(model.actuator_trnid[k, 0])
            found[j] = min(most, found.get(j, most))
    return found


def _range(model: Any, k: int, gear: float) -> tuple[float, float] | None:
    """Least and largest force of an actuator, or None where there is no bound.

    With a bias, a servo's control is no force. `gear` is the force per unit of actuation.
    """
    bounds: list[Array] = []
    if model.actuator_ctrllimited[k] and model.actuator_biastype[k] == _NO_BIAS:
        bounds.append(float(model.actuator_gainprm[k, 0]) * np.array(model.actuator_ctrlrange[k]))
    if model.actuator_forcelimited[k]:
        bounds.append(np.array(model.actuator_forcerange[k]))
    if not bounds:
        return None
    low = gear * max(float(min(pair)) for pair in bounds)
    high = gear * min(float(max(pair)) for pair in bounds)
    return (low + 0.0, high + 0.0) if low < high else None


def _turn(quaternion: Array) -> Array:
    """The rotation matrix (3, 3) of MuJoCo's quaternion w, x, y, z."""
    w, x, y, z = quaternion
    return turn_of_quaternion(x, y, z, w)


_FREE, _BALL, _SLIDE, _HINGE = range(4)
WORLD = 0
# What MuJoCo calls a model without a name.
_UNNAMED = "MuJoCo Model"


def read_mjcf(path: Path, data: bytes, base: str | None, friction: bool = False) -> sources.Source:
    """Read a robot in MJCF, `data`; meshes and included files are found in the folder of `path`.

    `base`, a link that is to be the base, tells which of several robots is meant, `friction`
    whether the dry friction of joints is taken. Raises
    `UsageError` if MuJoCo is not installed, and `SourceFileError` if it refuses the model.
    """
    text, findings = reduced_mjcf(path, data)
    try:
        import mujoco
    except ImportError:
        raise UsageError(
            f"{printable(path)}: the package mujoco is not installed; install mujoco, or "
            "gibbs_codegen with its extra mujoco"
        ) from None
    # Else warnings are printed, and written to a file in the working directory.
    former = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        words = printable(" ".join(str(error).split()), 300)
        raise sources.refusal(path, f"MuJoCo refuses it: {words}") from None
    finally:
        mujoco.set_mju_user_warning(former)
    return _Reader(model, str(path), findings, friction).source(base)


class _Reader:
    """Takes a compiled model apart."""

    def __init__(
        self, model: Any, file: str, findings: list[sources.Finding], friction: bool
    ) -> None:
        self.model, self.file, self.findings, self._with_friction = model, file, findings, friction
        self.names = _names([model.body(b).name for b in range(model.nbody)], "body")
        self.joint_names = _names([model.joint(j).name for j in range(model.njnt)], "joint")
        self._links = sources.Names(self.names)
        self.efforts = efforts(model)

    def source(self, base: str | None) -> sources.Source:
        """What the file says of the robot with link `base` (None: the only one), by the tree."""
        model = self.model
        root = self._root(base)
        bodies = [b for b in range(1, model.nbody) if model.body_rootid[b] == root]
        links: dict[str, sources.Link] = {}
        joints: list[sources.Joint] = []
        first, count = model.body_jntadr[root], model.body_jntnum[root]
        for j in range(first, first + count):
            if model.jnt_type[j] != _FREE:
                why = "a joint between the world and the root: the robot flies"
                self._leave_out(self.joint_names[j], why)
        for body in bodies:
            if model.body_gravcomp[body]:
                self._leave_out(self.names[body], "compensation of its weight")
            for link, joint in self._joints(body) if body != root else ():
                links[link] = sources.Link(link)
                joints.append(joint)
            axes = _turn(model.body_iquat[body])
            inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
            place = Placement(vector(model.body_ipos[body]))
            inertial = sources.Inertial(
                float(model.body_mass[body]), place, (inertia + inertia.T) / 2
            )
            links[self.names[body]] = sources.Link(self.names[body], inertial)
        x, y, z = (float(value) for value in model.opt.gravity)
        if x or y or z > 0.0:
            what = f"{x:g} {y:g} {z:g} is not downwards along z"
            self.findings.append(sources.Finding("note", "gravity", what))
        rotors, findings = mjcf_rotors(model, self.names, bodies)
        seats, frames = model.actuator_trnid[model.actuator_trntype == _SITE, 0], []
        for s in range(model.nsite):
            name, body = model.site(s).name, model.site_bodyid[s]
            if name and body in bodies and s not in seats:
                frames.append(self._site(s))
        constraints = tuple(self._constraints(bodies))
        return sources.Source(
            self.file,
            bytes(model.names).partition(b"\0")[0].decode().removeprefix(_UNNAMED),
            links,
            tuple(joints),
            rotors,
            anchors=frozenset(self.joint_names[first : first + count]),
            frames=tuple(frames),
            constraints=constraints,
            gravity=abs(z),
            findings=(*self.findings, *findings),
        )

    def _root(self, base: str | None) -> int:
        model = self.model
        roots = [b for b in range(1, model.nbody) if model.body_parentid[b] == WORLD]
        if base in self.names[1:]:
            return int(model.body_rootid[self.names.index(str(base), 1)])
        moved = [b for b in roots if model.body_jntnum[b]]
        flying = [b for b in moved if model.jnt_type[model.body_jntadr[b]] == _FREE]
        found = flying or roots
        if len(found) != 1:
            names = ", ".join(printable(self.names[b], 60) for b in found[:5]) or "none"
            message = f"holds {len(found)} robots ({names}); --base LINK tells which is meant"
            raise sources.refusal(self.file, message)
        return found[0]

    def _leave_out(self, what: str, why: str) -> None:
        self.findings.append(sources.Finding("left out", what, why))

    def _constraints(self, bodies: Sequence[int]) -> Iterator[sources.Constraint]:
        """Constraints between such bodies, or of one of them and the world."""
        model, names = self.model, sources.Names()
        for k in range(model.neq):
            name = names.free(model.equality(k).name or f"equality_{k + 1}")
            welds, data = model.eq_type[k] == _WELD, model.eq_data[k]
            ends = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
            # Old versions of MuJoCo know bodies only.
            if hasattr(model, "eq_objtype") and model.eq_objtype[k] == _OF_SITES:
                frames = [self._site(s) for s in ends]
            else:
                # A weld has the place of its anchor in the second body first.
                places = (data[3:6], data[:3]) if welds else (data[:3], data[3:6])
                turns = (_turn(data[6:10]) if welds else np.eye(3), np.eye(3))
                poses = map(Placement.of_matrix, places, turns)
                frames = [
                    sources.Frame(f"{name}_{number}", self._carrier(body), pose)
                    for number, (body, pose) in enumerate(zip(ends, poses, strict=True), start=1)
                ]
            own = {sources.WORLD, *(self.names[b] for b in bodies)}
            if not {frame.on for frame in frames} <= own or frames[0].on == frames[1].on:
                self._leave_out(name, "a constraint of what is not the robot's")
                continue
            if not model.eq_active0[k]:
                self.findings.append(
                    sources.Finding("note", name, "a constraint that is off at first")
                )
            first, second = frames if frames[0].on != sources.WORLD else frames[::-1]
            yield sources.Constraint(name, "frame" if welds else "point", first, second)

    def _carrier(self, body: int) -> str:
        return sources.WORLD if body == WORLD else self.names[body]

    def _site(self, s: int) -> sources.Frame:
        model = self.model
        pose = Placement.of_matrix(model.site_pos[s], _turn(model.site_quat[s]))
        return sources.Frame(model.site(s).name, self._carrier(model.site_bodyid[s]), pose)

    def _joints(self, body: int) -> Iterator[tuple[str, sources.Joint]]:
        """Joints of a body, each with the name of the link that it moves."""
        model = self.model
        parent = self.names[model.body_parentid[body]]
        pose = Placement.of_matrix(model.body_pos[body], _turn(model.body_quat[body]))
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        parts = [part for j in range(first, first + count) for part in self._parts(j)]
        if not parts:
            yield (
                self.names[body],
                sources.Joint(f"{self.names[body]}_mount", "fixed", parent, self.names[body], pose),
            )
        for number, (name, j, axis) in enumerate(parts, start=1):
            link = self.names[body]
            if number < len(parts):
                link = self._links.free(f"{link}_{name}")
            anchor = np.array(model.jnt_pos[j])
            passive, limits = self._properties(j)
            joint = sources.Joint(
                name,
                "prismatic" if model.jnt_type[j] == _SLIDE else "revolute",
                parent,
                link,
                pose @ Placement(vector(anchor)),
                axis,
                Placement(vector(-anchor)),
                passive,
                limits,
                continuous=model.jnt_type[j] == _HINGE and sources.endless(limits),
                friction=sources.dry_friction(self._friction(j)),
            )
            yield link, joint
            parent, pose = link, Placement()

    def _parts(self, j: int) -> list[tuple[str, int, Any]]:
        """Name, number and axis of each joint of one degree of freedom that a joint consists of."""
        name, model = self.joint_names[j], self.model
        dof = model.jnt_dofadr[j]
        friction = model.dof_frictionloss[dof] if self._friction(j) == 0.0 else 0.0
        found = {f"dry friction {friction:g}": friction}
        if hasattr(model, "jnt_stiffnesspoly"):  # New versions of MuJoCo know more coefficients.
            found["stiffness of higher order"] = model.jnt_stiffnesspoly[j]
        if hasattr(model, "dof_dampingpoly"):
            found["damping of higher order"] = model.dof_dampingpoly[dof]
        if model.jnt_type[j] == _BALL:
            found |= {
                "damping": model.dof_damping[dof],
                "armature": model.dof_armature[dof],
                "stiffness": model.jnt_stiffness[j],
                "limits": model.jnt_limited[j],
            }
        if lost := [words for words, value in found.items() if np.any(value)]:
            self._leave_out(name, ", ".join(lost))
        if model.jnt_type[j] != _BALL:
            return [(name, j, vector(model.jnt_axis[j]))]
        self.findings.append(
            sources.Finding("note", name, "a ball joint, as three hinges about x, y and z")
        )
        return [(f"{name}_{letter}", j, axis) for letter, axis in AXES.items()]

    def _friction(self, j: int) -> float:
        """Dry friction of a joint of one degree of freedom, where it is taken, N m or N."""
        taken = self._with_friction and self.model.jnt_type[j] != _BALL
        return float(self.model.dof_frictionloss[self.model.jnt_dofadr[j]]) if taken else 0.0

    def _properties(self, j: int) -> tuple[Passive, JointLimits]:
        model = self.model
        if model.jnt_type[j] == _BALL:
            return Passive(), JointLimits()
        dof, place = model.jnt_dofadr[j], model.jnt_qposadr[j]
        zero = float(model.qpos0[place])
        if zero:
            self.findings.append(
                sources.Finding("note", self.joint_names[j], f"counts from its ref, {zero:g}")
            )
        stiffness = float(np.ravel(model.jnt_stiffness[j])[0])
        rest = float(model.qpos_spring[place]) - zero if stiffness else 0.0
        damping = float(np.ravel(model.dof_damping[dof])[0])
        passive = Passive(damping, float(model.dof_armature[dof]), stiffness, rest)
        low = high = None
        if model.jnt_limited[j]:
            low, high = (float(bound) - zero for bound in model.jnt_range[j])
        return passive, JointLimits(low, high, self.efforts.get(j))


def _names(own: list[str], what: str) -> list[str]:
    """Names of bodies or joints; of those without one what they are, a word, with the number."""
    names = sources.Names(own)
    return [name or names.free(f"{what}_{number}") for number, name in enumerate(own)]


_KEPT = ("compiler", "option", "default", "asset", "worldbody", "actuator", "equality")
_PICTURES = ("texture", "material", "skin", "light", "camera", "hfield", "plugin", "flexcomp")
_LEFT_OUT = {
    "tendon": "tendons and their springs",
    "contact": "contacts",
    "sensor": "sensors",
    "keyframe": "keyframes",
    "deformable": "deformable bodies",
    "extension": "plugins, and what they do to the motion",
}
_NO_MOTION = ("custom", "visual", "statistic", "size")
# What a compiler may be findings; versions differ in what else they know.
_SETTINGS = {
    *("angle", "eulerseq", "autolimits", "inertiafromgeom", "inertiagrouprange", "strippath"),
    *("meshdir", "assetdir", "exactmeshinertia", "alignfree"),
}
_CHANGING = {"balanceinertia", "boundmass", "boundinertia", "settotalmass"}
_MOST_INCLUDES = 50
_MOST_COPIES = 1000
_TEXTS = {"name", "class", "childclass", "file", "mesh", "meshdir", "assetdir", "model", "joint"}


def reduced_mjcf(path: Path, data: bytes) -> tuple[str, list[sources.Finding]]:
    """What a file and its includes have of mass, motion and drives, and what was left out."""
    root = xml_file.parse_xml(data, str(path))
    _include(root, path)
    _check(root, str(path))
    counts: Counter[str] = Counter()
    for section in xml_file.children(root):
        if section.tag not in _KEPT:
            if section.tag not in _NO_MOTION:
                words = _LEFT_OUT.get(section.tag, "a section that import does not know")
                counts[f"{words} (<{printable(section.tag, 40)}>)"] += len(section)
            root.remove(section)
    findings = [
        sources.Finding("left out", words, f"{count}") for words, count in counts.items() if count
    ]
    for element in [found for found in root.iter() if isinstance(found, xml_file.Element)]:
        element.attrib.pop("material", None)
        for picture in xml_file.children(element):
            if picture.tag in _PICTURES:
                element.remove(picture)
    shapes = _Shapes(root)
    for world in root.iter("worldbody"):
        if isinstance(world, xml_file.Element):
            shapes.strip(world, "", True)
    if shapes.count:
        findings.append(sources.Finding("left out", "shapes that give no mass", f"{shapes.count}"))
    for drives in root.iter("actuator"):  # Motors at sites or joints are what is imported.
        for actuator in [found for found in drives if isinstance(found, xml_file.Element)]:
            acts = "site" in actuator.attrib or "joint" in actuator.attrib
            if actuator.tag not in ("motor", "general") or not acts or "refsite" in actuator.attrib:
                drives.remove(actuator)
                name = printable(actuator.get("name", "without a name"), 60)
                what = f"<{printable(actuator.tag, 40)}>, which is no motor"
                findings.append(sources.Finding("left out", name, what))
    for held in root.iter("equality"):
        for element in [found for found in held if isinstance(found, xml_file.Element)]:
            if element.tag not in ("connect", "weld"):
                held.remove(element)
                name = printable(element.get("name", "without a name"), 60)
                what = f"<{printable(element.tag, 40)}> in <equality>, which holds no frame"
                findings.append(sources.Finding("left out", name, what))
    findings += _settle(root, path)
    return ET.tostring(root, encoding="unicode"), findings


def _include(root: xml_file.Element, path: Path) -> None:
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
        for number, fresh in enumerate(xml_file.parse_xml(xml_file.read_bytes(file), str(file))):
            parent.insert(place + number, fresh)
    message = f"more than {_MOST_INCLUDES} files are included"
    raise sources.refusal(path, message, where="<include>")


def _check(root: xml_file.Element, file: str) -> None:
    """Refuse what would keep the compiler busy without end, or is no number."""
    faults, copies = [], 1
    for element in root.iter():
        line = element.line if isinstance(element, xml_file.Element) else None
        where = xml_file.described(element) if isinstance(element, xml_file.Element) else ""
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
        raise sources.SourceFileError(file, faults)


class _Shapes:
    """Removes shapes that give no mass, and counts them."""

    def __init__(self, root: xml_file.Element) -> None:
        self.count = 0
        self._computed = any(c.get("inertiafromgeom") == "true" for c in root.iter("compiler"))
        self._masses: dict[str, str | None] = {}
        for default in xml_file.children(root):
            if default.tag == "default":
                self._read(default, None)

    def _read(self, default: xml_file.Element, mass: str | None) -> None:
        """Learn the mass of shapes of each class, which a class within a class inherits."""
        geom = xml_file.child(default, "geom")
        mass = mass if geom is None else geom.get("mass", mass)
        self._masses[default.get("class", "main")] = mass
        for inner in xml_file.children(default):
            if inner.tag == "default":
                self._read(inner, mass)

    def strip(self, element: xml_file.Element, kind: str, weighed: bool) -> None:
        """Remove the shapes of an element, a body or what holds some, and of the bodies in it.

        `kind` is the class of shapes that name no other; `weighed` whether the mass is given, so
        that no shape counts.
        """
        for found in xml_file.children(element):
            inner = found.get("childclass", kind)
            if found.tag == "body":
                has_inertial = xml_file.child(found, "inertial") is not None
                self.strip(found, inner, has_inertial and not self._computed)
            elif found.tag in ("frame", "replicate"):
                self.strip(found, inner, weighed)
            elif found.tag == "geom":
                given_class = found.get("class", kind) or "main"
                mass = found.get("mass", self._masses.get(given_class))
                with suppress(ValueError):  # MuJoCo refuses what is no number.
                    if weighed or (mass is not None and float(mass) == 0.0):
                        element.remove(found)
                        self.count += 1


def _settle(root: xml_file.Element, path: Path) -> Iterator[sources.Finding]:
    """Leave the compiler no choice: no welding, and folders by their full paths.

    Tells of settings with which MuJoCo changes masses or inertias.
    """
    meshes = any("mesh" in found.attrib for found in root.iter("geom"))
    for section in xml_file.children(root):
        if section.tag == "asset" and not meshes:
            root.remove(section)
        if section.tag == "option":
            section.attrib = {k: v for k, v in section.attrib.items() if k == "gravity"}
            section[:] = []
    if root.find("compiler") is None:
        root.insert(0, xml_file.Element("compiler"))
    for compiler in root.iter("compiler"):
        folder = compiler.get("meshdir", compiler.get("assetdir", ""))
        for key in sorted(_CHANGING & set(compiler.attrib)):
            setting = f"{compiler.get(key)}: with it MuJoCo changes masses or inertias"
            yield sources.Finding("note", key, printable(setting))
        kept = _SETTINGS | _CHANGING
        if compiler.get("coordinate") == "global":
            kept = kept | {"coordinate"}
        compiler.attrib = {key: text for key, text in compiler.attrib.items() if key in kept}
        compiler.attrib.pop("assetdir", None)
        compiler.set("meshdir", str(path.parent.absolute() / folder))
        compiler.set("fusestatic", "false")
