"""The tree in MuJoCo, where that is installed: its mass matrix, inverse dynamics and energies."""

from __future__ import annotations

import re
from collections.abc import Iterable

import mujoco
import numpy as np

from gibbs_codegen.exchange.mjcf import without_log
from gibbs_codegen.verification.formulation import NotApplicableError, Quantities, state_by_state
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import WORLD, Joint, Tree
from gibbs_codegen.verification.vectors import Array

# Rounding of moments of inertia, relative to the largest.
_ROUNDING = 1e-12


class MuJoCo:
    """A formulation (see `formulation`) by the library of that name.

    It computes neither `positions`, since MuJoCo has no joint frames apart from bodies, nor
    `bias_accelerations`, since its accelerations include gravity.
    Creating it raises `NotApplicableError` for a robot that MuJoCo rejects, such as one with a
    rotor or frame on a link without mass.

    MuJoCo takes no thin rod, nor a point mass, since their moments of inertia are not all positive.
    It is given these with more inertia, and then with twice as much added. All that it computes is
    linear in inertias, so twice the first result less the second is that of the robot as it is.
    """

    name = "MuJoCo"
    limit = 1e-10
    # It refers all inertias to the centre of mass of the whole robot.
    growth = 2

    def __init__(self, tree: Tree, more: float = 0.0) -> None:
        self.tree = tree
        self._thicker: list[MuJoCo] = []
        if more == 0.0 and any(_missing(joint, tree.reach) for joint in tree.joints):
            self._thicker = [MuJoCo(tree, 1.0), MuJoCo(tree, 2.0)]
            return
        try:
            with without_log():
                children = {
                    number: [k for k, joint in enumerate(tree.joints) if joint.parent == number]
                    for number in range(WORLD, len(tree.joints))
                }
                bodies = [_body_text(tree, children, number, more) for number in children[WORLD]]
                self._model = mujoco.MjModel.from_xml_string(
                    '<mujoco><compiler angle="radian"/>'
                    f'<option gravity="0 0 {-tree.gravity!r}">'
                    '<flag contact="disable" constraint="disable"/></option>'
                    f"<worldbody>{''.join(bodies)}</worldbody></mujoco>"
                )
        except ValueError as error:
            words = " ".join(str(error).split())
            if lacking := re.search(r"mjMINVAL Element name 'body_(\d+)'", words):
                place = tree.joints[int(lacking[1])].place
                if label := tree.labels.get(place):
                    words = f"{label} moves, without a mass; give it mass and inertia"
            raise NotApplicableError(f"MuJoCo rejects it: {words}") from None
        made = {self._model.body(number).name for number in range(self._model.nbody)}
        if any(f"body_{seat.joint}" not in made for seat in tree.seats):
            raise NotApplicableError("MuJoCo has no frames for what is on a link without mass")
        self._data = mujoco.MjData(self._model)
        self._turn, self._step = self._model.body_quat[1].copy(), self._model.body_pos[1].copy()
        names = [self._model.joint(number).name for number in range(self._model.njnt)]
        numbers = [int(name.removeprefix("joint_")) for name in names]
        self._places = np.array([tree.joints[number].place for number in numbers])

    def at(self, states: States) -> Quantities:
        """Everything that the formulation computes."""
        if self._thicker:
            for thicker in self._thicker:
                thicker.tree = self.tree  # The base may have been placed since.
            both = zip(*(thicker.at(states) for thicker in self._thicker), strict=True)
            return Quantities._make(None if x is None else 2.0 * x - y for x, y in both)
        with without_log():
            return state_by_state(self._at, self.tree, states, self._places)

    def _at(self, q: Array, v: Array, a: Array, rotation: Array, position: Array) -> Quantities:
        """Quantities by MuJoCo for one state, in its order, without contacts."""
        model, data, tree = self._model, self._data, self.tree
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, rotation.ravel())
        mujoco.mju_mulQuat(model.body_quat[1], turn, self._turn)
        model.body_pos[1] = position + rotation @ self._step
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_inverse(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        # Row by row, since the storage of the matrix differs between versions.
        matrix = np.empty((tree.size, tree.size))
        for row, unit in zip(matrix, np.eye(tree.size), strict=True):
            mujoco.mj_mulM(model, data, row, unit)
        poses = np.tile(np.eye(4), (len(tree.seats), 1, 1))
        jacobians = np.empty((len(tree.seats), 6, tree.size))
        for seat, pose, jacobian in zip(tree.seats, poses, jacobians, strict=True):
            body = int(data.body(f"body_{seat.joint}").id)
            axes = data.xmat[body].reshape(3, 3)
            pose[:3, :3], pose[:3, 3] = axes @ seat.rotation, data.xpos[body] + axes @ seat.local
            mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], pose[:3, 3], body)
        return Quantities(
            mass_matrix=matrix,
            residual=-data.qfrc_bias,
            inverse_dynamics=data.qfrc_inverse.copy(),
            poses=poses,
            jacobians=jacobians,
            kinetic_energy=data.energy[1],
            potential_energy=data.energy[0],
        )


def _body_text(tree: Tree, children: dict[int, list[int]], number: int, more: float) -> str:
    """A body, on joint `number`, and all that hangs on it, in MJCF; `more` as of `_model_text`."""
    turn, step = np.eye(3), np.zeros(3)
    group = []
    while True:
        joint = tree.joints[number]
        # Rotors of motors have nothing but their inertia.
        mass = joint.mass or more * tree.mass * bool(joint.inertia.any())
        turn, step = turn @ joint.rotation, step + turn @ joint.offset
        group.append((number, turn, step))
        if mass > 0.0 or len(children[number]) != 1:
            break
        (number,) = children[number]
    lines = [
        f'<body name="body_{number}" pos="{_numbers(step)}" '
        f'xyaxes="{_numbers(turn.T[:2].ravel())}">'
    ]
    if mass > 0.0:
        moments, axes = _principal(joint)
        moments = moments + more * _missing(joint, tree.reach)
        lines.append(
            f'<inertial pos="{_numbers(joint.com)}" mass="{mass!r}" '
            f'xyaxes="{_numbers(axes.T[:2].ravel())}" diaginertia="{_numbers(moments)}"/>'
        )
    for member, its_turn, its_step in group:
        moved = tree.joints[member]
        lines.append(
            f'<joint name="joint_{member}" type="{"hinge" if moved.revolute else "slide"}" '
            f'axis="{_numbers(turn.T @ its_turn[:, moved.axis])}" '
            f'pos="{_numbers(turn.T @ (its_step - step))}"/>'
        )
    lines += [_body_text(tree, children, child, more) for child in children[number]]
    return "".join([*lines, "</body>"])


def _principal(joint: Joint) -> tuple[Array, Array]:
    """Principal moments, and the axes in columns; MuJoCo's own would have fewer digits.

    Raises `NotApplicableError` if a moment is negative.
    """
    moments, axes = np.linalg.eigh(joint.inertia)
    if moments[0] < -_ROUNDING * moments[2]:
        raise NotApplicableError("MuJoCo rejects it: a moment of inertia is negative")
    # Rounding may leave less than nothing about the axis of a thin rod.
    return np.maximum(moments, 0.0), axes * np.linalg.det(axes)


def _missing(joint: Joint, reach: float) -> float:
    """Inertia to add to a body that has none about some axis, such as a thin rod, in kg m².

    A point mass at the joint has it of the robot's `reach`, m.
    """
    moments, _ = _principal(joint)
    if moments[0] > _ROUNDING * moments[2] or not (joint.mass or moments[2]):
        return 0.0
    return float(moments[2] or joint.mass * (joint.com @ joint.com or reach**2))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
