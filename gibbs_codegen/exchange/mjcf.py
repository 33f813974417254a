"""MJCF, read through MuJoCo's own compiler: defaults, classes and inertia from shapes are its work.

A body with several joints becomes several links, those before the last without mass. A ball joint
becomes three hinges about x, y and z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.errors import Fault, UsageError, printable
from gibbs_codegen.exchange.mjcf_export import reduced_mjcf
from gibbs_codegen.exchange.placement import Array, Placement, of_quaternion, vector
from gibbs_codegen.exchange.robot_source import Names
from gibbs_codegen.exchange.source import (
    Inertial,
    Source,
    SourceFileError,
    SourceFrame,
    SourceJoint,
    SourceLink,
    SourceRotor,
    Told,
    endless,
)
from gibbs_codegen.robot.model import AXES, JointLimits, Passive

_JOINT, _SITE = 0, 4
_FILTERS = (2, 3)
_NO_BIAS = 0


def mjcf_rotors(
    model: Any, names: Sequence[str], bodies: Sequence[int]
) -> tuple[tuple[SourceRotor, ...], list[Told]]:
    """The rotors on such bodies of a compiled model, by actuators, and what was left out."""
    rotors, told = [], []
    for k in range(model.nu):
        if model.actuator_trntype[k] != _SITE:
            continue
        site, gear = model.actuator_trnid[k, 0], np.array(model.actuator_gear[k])
        body, size = model.site_bodyid[site], float(np.linalg.norm(gear[:3]))
        size = 1.0 if abs(size - 1.0) < 4e-16 else size
        name = _name(model, k) or f"rotor_{k + 1}"
        if body not in bodies:
            continue
        if size == 0.0:
            told.append(Told("left out", name, "an actuator of torque without a force, no rotor"))
            continue
        w, x, y, z = model.site_quat[site]
        turn = of_quaternion(x, y, z, w)
        direction = gear[:3] / size
        drag = float(direction @ gear[3:]) / size
        if np.abs(gear[3:] - drag * gear[:3]).max() > 1e-9 * np.abs(gear).max():
            told.append(Told("left out", name, "torque across the thrust"))
        limits = _range(model, k, size)
        if limits is not None and limits[1] <= 0.0:  # It pulls: turned, it pushes.
            direction, limits = -direction, (-limits[1], -limits[0])
        rotors.append(
            SourceRotor(
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
    return tuple(rotors), told


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


def _name(model: Any, k: int) -> str:
    address = model.name_actuatoradr[k]
    return bytes(model.names[address : model.names.index(b"\0", address)]).decode()


_FREE, _BALL, _SLIDE, _HINGE = range(4)
WORLD = 0
# What MuJoCo calls a model without a name.
_UNNAMED = "MuJoCo Model"


def read_mjcf(path: Path, data: bytes, base: str | None) -> Source:
    """Read a robot in MJCF, `data`; meshes and included files are found in the folder of `path`.

    `base`, a link that is to be the base, tells which of several robots is meant.
    """
    text, told = reduced_mjcf(path, data)
    model = _compiled(text, path)
    return _Reader(model, str(path), told).source(base)


def _compiled(text: str, path: Path) -> Any:
    """The model that MuJoCo compiles from reduced MJCF.

    Raises `UsageError` if MuJoCo is not installed, and `SourceFileError` if it refuses the model.
    """
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
        return mujoco.MjModel.from_xml_string(text)
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        words = printable(" ".join(str(error).split()), 300)
        raise SourceFileError(str(path), [Fault("", f"MuJoCo refuses it: {words}")]) from None
    finally:
        mujoco.set_mju_user_warning(former)


class _Reader:
    """Takes a compiled model apart."""

    def __init__(self, model: Any, file: str, told: list[Told]) -> None:
        self.model, self.file, self.told = model, file, told
        self.names = _names(model, model.name_bodyadr, "body")
        self.joint_names = _names(model, model.name_jntadr, "joint")
        self._links = Names(self.names)
        self.efforts = efforts(model)

    def source(self, base: str | None) -> Source:
        """What the file says of the robot with link `base` (None: the only one), by the tree."""
        model = self.model
        root = self._root(base)
        bodies = [b for b in range(1, model.nbody) if model.body_rootid[b] == root]
        links: dict[str, SourceLink] = {}
        joints: list[SourceJoint] = []
        anchors = self._anchors(root)
        for body in bodies:
            if model.body_gravcomp[body]:
                self._leave_out(self.names[body], "compensation of its weight")
            for link, joint in self._joints(body) if body != root else ():
                links[link] = SourceLink(link)
                joints.append(joint)
            links[self.names[body]] = SourceLink(self.names[body], self._inertial(body))
        rotors, told = mjcf_rotors(model, self.names, bodies)
        return Source(
            self.file,
            _text(model, 0).removeprefix(_UNNAMED),
            links,
            tuple(joints),
            rotors,
            anchors=anchors,
            frames=tuple(self._frames(bodies)),
            gravity=self._gravity(),
            told=(*self.told, *told),
        )

    def _root(self, base: str | None) -> int:
        model = self.model
        roots = [b for b in range(1, model.nbody) if model.body_parentid[b] == WORLD]
        if base in self.names[1:]:
            return int(model.body_rootid[self.names.index(str(base), 1)])
        flying = [b for b in roots if model.body_jntnum[b] and self._type(b) == _FREE]
        found = flying or roots
        if len(found) != 1:
            names = ", ".join(printable(self.names[b], 60) for b in found[:5]) or "none"
            message = f"holds {len(found)} robots ({names}); --base LINK tells which is meant"
            raise SourceFileError(self.file, [Fault("", message)])
        return found[0]

    def _type(self, body: int) -> int:
        return int(self.model.jnt_type[self.model.body_jntadr[body]])

    def _leave_out(self, what: str, why: str) -> None:
        self.told.append(Told("left out", what, why))

    def _anchors(self, body: int) -> frozenset[str]:
        """Joints of the root, which are left out."""
        first, count = self.model.body_jntadr[body], self.model.body_jntnum[body]
        for j in range(first, first + count):
            if self.model.jnt_type[j] != _FREE:
                why = "a joint between the world and the root: the robot flies"
                self._leave_out(self.joint_names[j], why)
        return frozenset(self.joint_names[first : first + count])

    def _inertial(self, body: int) -> Inertial:
        model = self.model
        w, x, y, z = model.body_iquat[body]
        axes = of_quaternion(x, y, z, w)
        inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
        place = Placement(vector(model.body_ipos[body]))
        return Inertial(float(model.body_mass[body]), place, (inertia + inertia.T) / 2)

    def _joints(self, body: int) -> Iterator[tuple[str, SourceJoint]]:
        """Joints of a body, each with the name of the link that it moves."""
        model = self.model
        parent = self.names[model.body_parentid[body]]
        w, x, y, z = model.body_quat[body]
        pose = Placement.of_matrix(model.body_pos[body], of_quaternion(x, y, z, w))
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        parts = [part for j in range(first, first + count) for part in self._parts(j)]
        if not parts:
            yield (
                self.names[body],
                SourceJoint(f"{self.names[body]}_mount", "fixed", parent, self.names[body], pose),
            )
        for number, (name, j, axis) in enumerate(parts, start=1):
            link = self.names[body]
            if number < len(parts):
                link = self._links.free(f"{link}_{name}")
            anchor = np.array(model.jnt_pos[j])
            passive, limits = self._properties(j)
            joint = SourceJoint(
                name,
                "prismatic" if model.jnt_type[j] == _SLIDE else "revolute",
                parent,
                link,
                pose @ Placement(vector(anchor)),
                axis,
                Placement(vector(-anchor)),
                passive,
                limits,
                continuous=model.jnt_type[j] == _HINGE and endless(limits),
            )
            yield link, joint
            parent, pose = link, Placement()

    def _parts(self, j: int) -> list[tuple[str, int, Any]]:
        """Name, number and axis of each joint of one degree of freedom that a joint consists of."""
        name = self.joint_names[j]
        if lost := self._lost(j):
            self._leave_out(name, ", ".join(lost))
        if self.model.jnt_type[j] != _BALL:
            return [(name, j, vector(self.model.jnt_axis[j]))]
        self.told.append(Told("note", name, "a ball joint, as three hinges about x, y and z"))
        return [(f"{name}_{letter}", j, axis) for letter, axis in AXES.items()]

    def _lost(self, j: int) -> list[str]:
        """What a joint has that is not imported, in words."""
        model, dof = self.model, self.model.jnt_dofadr[j]
        friction = model.dof_frictionloss[dof]
        found = {
            f"dry friction {friction:g}": friction,
            "stiffness of higher order": _higher(model, "jnt_stiffness", j),
            "damping of higher order": _higher(model, "dof_damping", dof),
        }
        if model.jnt_type[j] == _BALL:
            found |= {
                "damping": model.dof_damping[dof],
                "armature": model.dof_armature[dof],
                "stiffness": model.jnt_stiffness[j],
                "limits": model.jnt_limited[j],
            }
        return [words for words, value in found.items() if np.any(value)]

    def _properties(self, j: int) -> tuple[Passive, JointLimits]:
        model = self.model
        if model.jnt_type[j] == _BALL:
            return Passive(), JointLimits()
        dof, place = model.jnt_dofadr[j], model.jnt_qposadr[j]
        zero = float(model.qpos0[place])
        if zero:
            self.told.append(Told("note", self.joint_names[j], f"counts from its ref, {zero:g}"))
        stiffness = float(np.ravel(model.jnt_stiffness[j])[0])
        rest = float(model.qpos_spring[place]) - zero if stiffness else 0.0
        passive = Passive(
            float(np.ravel(model.dof_damping[dof])[0]),
            float(model.dof_armature[dof]),
            stiffness,
            rest,
        )
        low = high = None
        if model.jnt_limited[j]:
            low, high = (float(bound) - zero for bound in model.jnt_range[j])
        return passive, JointLimits(low, high, self.efforts.get(j))

    def _frames(self, bodies: list[int]) -> Iterator[SourceFrame]:
        model = self.model
        rotors = {
            int(s)
            for s, t in zip(model.actuator_trnid[:, 0], model.actuator_trntype, strict=True)
            if t == 4
        }
        for s in range(model.nsite):
            name = _text(model, model.name_siteadr[s])
            if name and model.site_bodyid[s] in bodies and s not in rotors:
                w, x, y, z = model.site_quat[s]
                pose = Placement.of_matrix(model.site_pos[s], of_quaternion(x, y, z, w))
                yield SourceFrame(name, self.names[model.site_bodyid[s]], pose)

    def _gravity(self) -> float:
        x, y, z = (float(value) for value in self.model.opt.gravity)
        if x or y or z > 0.0:
            self.told.append(Told("note", "gravity", f"{x:g} {y:g} {z:g} is not downwards along z"))
        return abs(z)


def _names(model: Any, addresses: Any, what: str) -> list[str]:
    """Names of bodies or joints by number; of those without one what they are, with the number.

    `addresses` tell where the names of their kind begin, and `what` is what they are, in a word.
    """
    given = [_text(model, address) for address in addresses]
    names = Names(given)
    return [name or names.free(f"{what}_{number}") for number, name in enumerate(given)]


def _higher(model: Any, key: str, place: int) -> Any:
    """Coefficients after the first of a stiffness or damping, or 0.

    New versions of MuJoCo know them. `key` is the name of the array of first coefficients, and
    `place` the number of the joint or degree of freedom.
    """
    found = getattr(model, f"{key}poly", None)
    return 0.0 if found is None else found[place]


def _text(model: Any, address: int) -> str:
    """The name that begins at an address."""
    end = model.names.index(b"\0", address)
    return bytes(model.names[address:end]).decode("utf-8", "replace")
