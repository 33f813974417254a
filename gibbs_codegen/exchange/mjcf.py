"""MJCF, read through MuJoCo's own compiler: defaults, classes and inertia from shapes are its work.

A body with several joints becomes several links, those before the last without mass. A ball joint
becomes three hinges about x, y and z.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.errors import printable, require
from gibbs_codegen.exchange import sources
from gibbs_codegen.exchange.mjcf_text import MjcfTexts
from gibbs_codegen.robot.parts.body import RigidBody, entries_of
from gibbs_codegen.robot.parts.constraint import LoopJoint
from gibbs_codegen.robot.parts.link import JointLimits, Link, Passive
from gibbs_codegen.robot.parts.numbers import AXES
from gibbs_codegen.robot.parts.pose import Pose, vector
from gibbs_codegen.robot.parts.servo import Servo
from gibbs_codegen.robot.rotations import Array, turn_of_quaternion

_SITE = 4
# Kinds of equalities, and the mark of those between sites rather than bodies.
_WELD, _JOINT, _TENDON, _OF_SITES = 1, 2, 3, 6
# Kinds of what a tendon goes along.
_ALONG_JOINT = 1
_FILTERS = (2, 3)
_NO_BIAS = 0


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
_KINDS: dict[int, sources.JointKind] = {_FREE: "floating", _SLIDE: "prismatic"}
WORLD = 0
# What MuJoCo calls a model without a name.
_UNNAMED = "MuJoCo Model"


def read_mjcf(path: Path, data: bytes, base: str | None, friction: bool = False) -> sources.Source:
    """Read a robot in MJCF, `data`; meshes and included files are found in the folder of `path`.

    `base`, a link that is to be the base, tells which of several robots is meant, `friction`
    whether the dry friction of joints is taken. Raises
    `UsageError` if MuJoCo is not installed, and `SourceFileError` if it refuses the model.
    """
    texts = MjcfTexts(path, data)
    require("mujoco", printable(path))
    import mujoco

    try:
        with without_log():
            model = mujoco.MjModel.from_xml_string(texts.text, texts.models)
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise texts.refused_by_mujoco(error) from None
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        model.opt.gravity[:] = 0.0
    x, y, z = model.opt.gravity
    if math.hypot(x, y) > -1e-9 * z:
        words = f"gravity {x:g} {y:g} {z:g} must point along -z, as 0 0 -9.81 does; turn the model"
        options = [e for e in texts.elements if "gravity" in e.attrib]
        raise texts.refused(options[-1], words)
    return _CompiledModel(model, str(path), texts.findings, friction).source(base)


@contextmanager
def without_log() -> Iterator[None]:
    """Suppress MuJoCo's warnings, such as of a matrix close to singular.

    Where nothing takes them, they are printed, and written to a file in the working folder.
    """
    import mujoco

    former = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(former)


class _CompiledModel:
    """Takes a compiled model apart."""

    def __init__(
        self, model: Any, file: str, findings: list[sources.Finding], friction: bool
    ) -> None:
        self.model, self.file, self.findings, self._with_friction = model, file, findings, friction
        self._gears: dict[str, sources.SourceGear] = {}
        self.names = _names([model.body(b).name for b in range(model.nbody)], "body")
        self.joint_names = _names([model.joint(j).name for j in range(model.njnt)], "joint")
        self._links = sources.FreeNames(self.names)
        self._servos: dict[int, Servo] = {}
        self._driven = set[int]()
        self.efforts = {
            j: float(np.abs(model.jnt_actfrcrange[j]).max())
            for j in range(model.njnt)
            if model.jnt_actfrclimited[j]
        }

    def source(self, base: str | None) -> sources.Source:
        """The robot with link `base` (None: the only one), by the tree."""
        model = self.model
        roots = self._roots(base)
        bodies = [b for b in range(1, model.nbody) if model.body_rootid[b] in roots]
        links = {self.names[WORLD]: sources.SourceBody(self.names[WORLD])}
        joints: list[sources.SourceJoint] = []
        rotors = tuple(self._rotors(bodies))
        for body in bodies:
            if model.body_gravcomp[body]:
                self._report(self.names[body], "compensation of its weight")
            for link, joint in self._joints(body):
                links[link] = sources.SourceBody(link)
                joints.append(joint)
            axes = _turn(model.body_iquat[body])
            inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
            place = vector(model.body_ipos[body])
            entries = entries_of((inertia + inertia.T) / 2)
            whole = RigidBody(0.0, float(model.body_mass[body]), place, entries)
            links[self.names[body]] = sources.SourceBody(self.names[body], whole)
        seats, frames = model.actuator_trnid[model.actuator_trntype == _SITE, 0], []
        for s in range(model.nsite):
            name, body = model.site(s).name, model.site_bodyid[s]
            if name and body in bodies and s not in seats:
                frames.append(self._site(s))
        constraints = tuple(self._constraints(bodies))
        of_gears = model.eq_obj1id[model.eq_type == _TENDON]
        for k in sorted({*range(model.ntendon)} - {*of_gears.tolist()}):
            self._report(model.tendon(k).name or f"tendon_{k + 1}", "a tendon, and its springs")
        joints = [replace(joint, gear=self._gears.get(joint.name)) for joint in joints]
        return sources.Source(
            self.file,
            bytes(model.names).partition(b"\0")[0].decode().removeprefix(_UNNAMED),
            links,
            tuple(joints),
            rotors,
            frames=tuple(frames),
            constraints=constraints,
            gravity=-float(model.opt.gravity[2]) + 0.0,
            findings=tuple(self.findings),
        )

    def _roots(self, base: str | None) -> list[int]:
        """The body of the robot on the world, or all there, where the world is to be the base."""
        model = self.model
        roots = [b for b in range(1, model.nbody) if model.body_parentid[b] == WORLD]
        if base == self.names[WORLD]:
            return roots
        if base in self.names:
            return [int(model.body_rootid[self.names.index(str(base))])]
        moved = [int(b) for b in dict.fromkeys(model.body_rootid[model.jnt_bodyid])]
        driven = [int(b) for b in dict.fromkeys(model.body_rootid[self._seats()])]
        flying = [int(b) for b in model.jnt_bodyid[model.jnt_type == _FREE]]
        robots = driven or flying or moved or roots
        if len(robots) != 1:
            names = ", ".join(printable(self.names[b], 60) for b in robots[:5]) or "none"
            message = f"holds {len(robots)} robots ({names}); choose one with --base LINK"
            message += "" if flying else ", --base world takes all of them"
            raise sources.refusal(self.file, message)
        return robots

    def _seats(self) -> list[int]:
        """For each actuator the body of its site or joint."""
        model, places = self.model, enumerate(self.model.actuator_trnid[:, 0])
        at_site = model.actuator_trntype == _SITE
        return [int((model.site_bodyid if at_site[k] else model.jnt_bodyid)[p]) for k, p in places]

    def _rotors(self, bodies: Sequence[int]) -> Iterator[sources.SourceRotor]:
        """Rotors by actuators at sites of such bodies; those at joints say the largest efforts."""
        model = self.model
        for k, body in enumerate(self._seats()):
            target, at_site = int(model.actuator_trnid[k, 0]), model.actuator_trntype[k] == _SITE
            if body not in bodies:
                continue
            name = model.actuator(k).name or f"{'rotor' if at_site else 'actuator'}_{k + 1}"
            gear, lag = np.array(model.actuator_gear[k]), model.actuator_dyntype[k]
            size = float(np.linalg.norm(gear[: 3 if at_site else 1]))
            size = 1.0 if abs(size - 1.0) < 4e-16 else size
            servo = None if at_site else self._servo(k, name, float(gear[0]))
            more = {
                "variable gain": model.actuator_gaintype[k],
                "bias": model.actuator_biastype[k] and not servo,
                "dynamics": lag and not ((at_site or servo) and lag in _FILTERS),
            }
            if lost := [words for words, there in more.items() if there]:
                self._report(name, f"{', '.join(lost)} of an actuator")
            limits = _range(model, k, size)
            if not at_site:
                joint, first = self.joint_names[target], target not in self._driven
                if model.jnt_type[target] in (_FREE, _BALL):
                    self._report(name, f"an actuator on joint {joint}, which has no input")
                elif not first:
                    self._report(name, f"one more actuator on joint {joint}")
                self._driven.add(target)
                if limits is not None and (most := max(map(abs, limits))) > 0.0:
                    self.efforts[target] = min(most, self.efforts.get(target, most))
                    if sum(limits):
                        words = "limits of its force, {:g} to {:g}: the larger holds both ways"
                        self._report(name, words.format(*limits))
                if servo and first:
                    self._servos[target] = servo
                continue
            if size == 0.0:
                self._report(name, "an actuator with a torque and no force, which is not a rotor")
                continue
            direction = gear[:3] / size
            drag = float(direction @ gear[3:]) / size
            if np.abs(gear[3:] - drag * gear[:3]).max() > 1e-9 * np.abs(gear).max():
                self._report(name, "torque across the thrust")
            if limits is not None and limits[1] <= 0.0:  # It pulls: turned, it pushes.
                direction, limits = -direction, (0.0 - limits[1], 0.0 - limits[0])
            yield sources.SourceRotor(
                name=name,
                link=self.names[body],
                position=vector(model.site_pos[target]),
                direction=vector(_turn(model.site_quat[target]) @ direction),
                drag=drag,
                limits=limits,
                time_constant=float(model.actuator_dynprm[k, 0]) or None
                if lag in _FILTERS
                else None,
                evidence="motor at a site",
            )

    def _servo(self, k: int, name: str, gear: float) -> Servo | None:
        """The servo that an actuator at a joint is, by its bias; None if it is none."""
        model, joint = self.model, int(self.model.actuator_trnid[k, 0])
        gain, (offset, length, rate) = model.actuator_gainprm[k, 0], model.actuator_biasprm[k, :3]
        holds = length < 0.0 >= rate
        if model.actuator_gaintype[k] or not gear or not (holds or length == 0.0 > rate):
            return None
        unit, more = (-float(x / (length if holds else rate)) / gear + 0.0 for x in (gain, offset))
        zero = float(model.qpos0[model.jnt_qposadr[joint]]) if holds else 0.0
        more -= zero
        if abs(unit - 1.0) > 1e-9 or more:
            words = f"its command is {unit:.6g} times its control"
            self._report(name, words + f", and {more:g} more" * bool(more), "note")
        low, high = sorted(unit * float(bound) + more for bound in model.actuator_ctrlrange[k])
        limited, damping = bool(model.actuator_ctrllimited[k]), -float(rate) * gear**2
        lag = float(model.actuator_dynprm[k, 0]) if model.actuator_dyntype[k] in _FILTERS else 0.0
        if not holds:
            most = max(-low, high) if limited else None
            return Servo(command="rate", damping=damping, rate=most, delay=lag)
        bounds = model.jnt_range[joint] - zero
        same = model.jnt_limited[joint] and np.allclose((low, high), bounds, 1e-3)
        if limited and not same:
            self._report(name, f"limits of its commands, {low:.6g} to {high:.6g}")
        return Servo(stiffness=-float(length) * gear**2, damping=damping, delay=lag)

    def _report(self, subject: str, reason: str, kind: sources.Kind = "left out") -> None:
        self.findings.append(sources.Finding(kind, subject, reason))

    def _constraints(self, bodies: Sequence[int]) -> Iterator[sources.SourceConstraint]:
        """Constraints between such bodies, or of one of them and the world."""
        model, names = self.model, sources.FreeNames()
        for k in range(model.neq):
            name = names.free(model.equality(k).name or f"equality_{k + 1}")
            if model.eq_type[k] in (_JOINT, _TENDON):
                self._add_gear(k, name)
                continue
            welds, data = model.eq_type[k] == _WELD, model.eq_data[k]
            ends = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
            # Old versions of MuJoCo know bodies only.
            if hasattr(model, "eq_objtype") and model.eq_objtype[k] == _OF_SITES:
                frames = [self._site(s) for s in ends]
            else:
                # A weld has the place of its anchor in the second body first.
                places = (data[3:6], data[:3]) if welds else (data[:3], data[3:6])
                turns = (_turn(data[6:10]) if welds else np.eye(3), np.eye(3))
                poses = map(Pose.of_matrix, places, turns)
                frames = [
                    sources.SourceFrame(f"{name}_{number}", pose=pose, link=self._carrier(body))
                    for number, (body, pose) in enumerate(zip(ends, poses, strict=True), start=1)
                ]
            carriers = {sources.WORLD, *(self.names[b] for b in bodies)}
            first, second = frames
            if not {first.link, second.link} <= carriers or first.link == second.link:
                self._report(name, "a constraint of something outside the robot")
                continue
            if not model.eq_active0[k]:
                self._report(name, "a constraint that is off at the start", "note")
            held, anchor = (second, first) if first.link == sources.WORLD else (first, second)
            joint: LoopJoint = "fixed" if welds else "spherical"
            yield sources.SourceConstraint.between(name, joint, (held, anchor))

    def _add_gear(self, k: int, name: str) -> None:
        """Note the gear of an equality of joints, or of a fixed tendon, whose first others move."""
        model, data, elements = self.model, self.model.eq_data[k], "joints"
        first, second = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        joints, shares = np.array([first, second]), np.array([1.0, -data[1]])
        is_gear = bool(model.eq_active0[k]) and second >= 0 and not data[2:5].any()
        if model.eq_type[k] == _TENDON:
            begin, count = model.tendon_adr[first], model.tendon_num[first]
            wraps = slice(begin, begin + count)
            joints, shares, elements = model.wrap_objid[wraps], model.wrap_prm[wraps], "tendons"
            along = count > 1 and (model.wrap_type[wraps] == _ALONG_JOINT).all()
            is_gear = bool(model.eq_active0[k] and second < 0 and along and shares[0])
        if not is_gear:
            self._report(name, f"an equality of {elements} that is not a gear")
            return
        moved, *movers = (self.joint_names[j] for j in joints)
        if moved in self._gears:
            self._report(name, f"one more equality that moves joint {moved}")
            return
        ratios = {x: -float(share / shares[0]) for x, share in zip(movers, shares[1:], strict=True)}
        self._gears[moved] = sources.SourceGear(ratios, float(data[0] / shares[0]))

    def _carrier(self, body: int) -> str:
        return sources.WORLD if body == WORLD else self.names[body]

    def _site(self, s: int) -> sources.SourceFrame:
        model = self.model
        pose = Pose.of_matrix(model.site_pos[s], _turn(model.site_quat[s]))
        link = self._carrier(model.site_bodyid[s])
        return sources.SourceFrame(model.site(s).name, pose=pose, link=link)

    def _joints(self, body: int) -> Iterator[tuple[str, sources.SourceJoint]]:
        """Joints of a body, each with the name of the link that it moves."""
        model = self.model
        parent = self.names[model.body_parentid[body]]
        pose = Pose.of_matrix(model.body_pos[body], _turn(model.body_quat[body]))
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        parts = [part for j in range(first, first + count) for part in self._parts(j)]
        if not parts:
            yield (
                self.names[body],
                sources.SourceJoint(
                    f"{self.names[body]}_mount", "fixed", parent, self.names[body], pose
                ),
            )
        for number, (name, j, axis) in enumerate(parts, start=1):
            link = self.names[body]
            if number < len(parts):
                link = self._links.free(f"{link}_{name}")
            anchor = np.array(model.jnt_pos[j])
            part = replace(self._part(j), axis=axis)
            joint = sources.SourceJoint(
                name,
                _KINDS.get(model.jnt_type[j], "revolute"),
                parent,
                link,
                pose @ Pose(vector(anchor)),
                part,
                Pose(vector(-anchor)),
                driven=j in self._driven,
            )
            yield link, joint
            parent, pose = link, Pose()

    def _parts(self, j: int) -> list[tuple[str, int, Any]]:
        """Name, number and axis of each joint of one degree of freedom that a joint consists of."""
        name, model = self.joint_names[j], self.model
        if lost := self._lost(j):
            self._report(
                name, lost + " of the joint of the base" * bool(model.jnt_type[j] == _FREE)
            )
        if model.jnt_type[j] != _BALL:
            return [(name, j, vector(model.jnt_axis[j]))]
        self._report(name, "a ball joint, as three hinges about x, y and z", "note")
        return [(f"{name}_{letter}", j, axis) for letter, axis in AXES.items()]

    def _lost(self, j: int) -> str:
        """Forces on a joint that are not taken, in words; empty if there are none."""
        model, kind, dof = self.model, self.model.jnt_type[j], self.model.jnt_dofadr[j]
        dofs = slice(dof, dof + {_FREE: 6, _BALL: 3}.get(kind, 1))
        friction = model.dof_frictionloss[dof] if self._friction(j) == 0.0 else 0.0
        acting = {f"dry friction {friction:g}": friction}
        if hasattr(model, "jnt_stiffnesspoly"):  # New versions of MuJoCo know more coefficients.
            acting["stiffness of higher order"] = model.jnt_stiffnesspoly[j]
        if hasattr(model, "dof_dampingpoly"):
            acting["damping of higher order"] = model.dof_dampingpoly[dof]
        if kind in (_FREE, _BALL):
            acting |= {
                "damping": model.dof_damping[dofs],
                "armature": model.dof_armature[dofs],
                "stiffness": model.jnt_stiffness[j],
                "limits": model.jnt_limited[j],
            }
        return ", ".join(words for words, value in acting.items() if np.any(value))

    def _friction(self, j: int) -> float:
        """Dry friction of a joint of one degree of freedom, where it is taken, N m or N."""
        taken = self._with_friction and self.model.jnt_type[j] in (_SLIDE, _HINGE)
        return float(self.model.dof_frictionloss[self.model.jnt_dofadr[j]]) if taken else 0.0

    def _part(self, j: int) -> Link:
        """The part of a joint, without its axis and the body that it moves."""
        model = self.model
        if model.jnt_type[j] in (_FREE, _BALL):
            return sources.NO_LINK
        dof, place = model.jnt_dofadr[j], model.jnt_qposadr[j]
        zero = float(model.qpos0[place])
        if zero:
            self._report(self.joint_names[j], f"counts from its ref, {zero:g}", "note")
        stiffness = float(np.ravel(model.jnt_stiffness[j])[0])
        rest = float(model.qpos_spring[place]) - zero if stiffness else 0.0
        damping = float(np.ravel(model.dof_damping[dof])[0])
        passive = Passive(
            damping=damping, armature=float(model.dof_armature[dof]), stiffness=stiffness, rest=rest
        )
        low = high = None
        if model.jnt_limited[j]:
            low, high = (float(bound) - zero for bound in model.jnt_range[j])
        limits, servo = JointLimits(low, high, self.efforts.get(j)), self._servos.get(j)
        friction = sources.dry_friction(self._friction(j))
        servo = servo and replace(servo, torque=limits.effort)
        return Link(sources.NO_BODY, passive=passive, limits=limits, servo=servo, friction=friction)


def _names(labels: list[str], kind: str) -> list[str]:
    """Names of bodies or joints; of those without one what they are, a word, with the number."""
    names = sources.FreeNames(labels)
    return [name or names.free(f"{kind}_{number}") for number, name in enumerate(labels)]
