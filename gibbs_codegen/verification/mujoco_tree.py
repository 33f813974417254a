"""The tree in MuJoCo, where that is installed: its mass matrix, inverse dynamics and energies."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from gibbs_codegen.verification.formulation import NotApplicableError
from gibbs_codegen.verification.tree import WORLD, Array, Point, Tree


class MuJoCo:
    """A formulation (see `formulation`) by the library of that name.

    MuJoCo has no joint frames apart from bodies, nor accelerations without gravity. Raises
    `NotApplicableError` for a machine that it refuses, such as one with a point mass at its end.
    """

    name = "MuJoCo"
    limit = 1e-10
    # It refers all inertias to the centre of mass of the whole machine.
    growth = 2
    gives = frozenset(
        (
            "mass_matrix",
            "inverse_dynamics",
            "input_matrix",
            "tip_pose",
            "tip_jacobian",
            "kinetic_energy",
            "potential_energy",
        )
    )

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        try:
            self._model = mujoco.MjModel.from_xml_string(_model_text(tree))
        except ValueError as error:
            raise NotApplicableError(f"MuJoCo refuses it: {' '.join(str(error).split())}") from None
        self._data = mujoco.MjData(self._model)
        names = [self._model.joint(number).name for number in range(self._model.njnt)]
        numbers = [int(name.removeprefix("joint_")) for name in names]
        self._places = np.array([tree.joints[number].place for number in numbers])
        self._order = np.argsort(self._places)

    def mass_matrix(self, q: Array) -> Array:
        """By MuJoCo's composite rigid body algorithm."""
        size = self.tree.size
        matrices = []
        for x in self._spread(q):
            self._put(x)
            columns = []
            # Column by column, since the storage of the matrix differs between versions.
            for unit in np.eye(size):
                column = np.empty(size)
                mujoco.mj_mulM(self._model, self._data, column, unit)
                columns.append(column)
            matrices.append(np.transpose(columns))
        return np.array(matrices)[:, self._order][:, :, self._order]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By MuJoCo's function of that name, nothing touching anything."""
        efforts = []
        for state in zip(*map(self._spread, (q, v, a)), strict=True):
            self._put(*state)
            mujoco.mj_inverse(self._model, self._data)
            efforts.append(self._data.qfrc_inverse.copy())
        return np.array(efforts)[:, self._order]

    def input_matrix(self, q: Array) -> Array:
        """By the motors' Jacobians."""
        matrices = []
        for x in self._spread(q):
            self._put(x)
            columns = []
            for motor in self.tree.motors:
                thrust = self._rotation(motor.seat) @ motor.direction
                wrench = np.concatenate([thrust, motor.drag * thrust])
                columns.append(self._jacobian(motor.seat).T @ wrench)
            columns += [np.eye(self.tree.size)[place] for place in self.tree.arm]
            matrices.append(np.transpose(columns))
        return np.array(matrices)

    def tip_pose(self, q: Array) -> Array:
        """Where the tip's body is."""
        poses = np.zeros((len(q), 4, 4))
        for pose, x in zip(poses, self._spread(q), strict=True):
            self._put(x)
            pose[:3, :3] = self._rotation(self.tree.tip)
            pose[:3, 3] = self._position(self.tree.tip)
            pose[3, 3] = 1.0
        return poses

    def tip_jacobian(self, q: Array) -> Array:
        """By MuJoCo's function for a point of a body."""
        jacobians = []
        for x in self._spread(q):
            self._put(x)
            jacobians.append(self._jacobian(self.tree.tip))
        return np.array(jacobians)

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        """MuJoCo's second energy."""
        energies = []
        for state in zip(self._spread(q), self._spread(v), strict=True):
            self._put(*state)
            mujoco.mj_energyVel(self._model, self._data)
            energies.append(self._data.energy[1])
        return np.array(energies)

    def potential_energy(self, q: Array) -> Array:
        """MuJoCo's first energy."""
        energies = []
        for x in self._spread(q):
            self._put(x)
            mujoco.mj_energyPos(self._model, self._data)
            energies.append(self._data.energy[0])
        return np.array(energies)

    def _spread(self, values: Array) -> Array:
        every: Array = self.tree.spread(values)[:, self._places]
        return every

    def _put(self, q: Array, v: Array | float = 0.0, a: Array | float = 0.0) -> None:
        self._data.qpos[:], self._data.qvel[:], self._data.qacc[:] = q, v, a
        mujoco.mj_fwdPosition(self._model, self._data)
        mujoco.mj_fwdVelocity(self._model, self._data)

    def _body(self, joint: int) -> int:
        return int(self._data.body(f"body_{joint}").id)

    def _rotation(self, point: Point) -> Array:
        rotation: Array = self._data.xmat[self._body(point.joint)].reshape(3, 3)
        return rotation

    def _position(self, point: Point) -> Array:
        body = self._body(point.joint)
        position: Array = self._data.xpos[body] + self._rotation(point) @ point.local
        return position

    def _jacobian(self, point: Point) -> Array:
        linear, angular = np.empty((2, 3, self.tree.size))
        mujoco.mj_jac(
            self._model, self._data, linear, angular, self._position(point), self._body(point.joint)
        )
        return np.concatenate([linear, angular])[:, self._order]


def _model_text(tree: Tree) -> str:
    """The tree in MJCF.

    A joint whose body has no mass is given to the bodies that hang on it, since MuJoCo moves no
    body without mass; where several hang on it, it stays and MuJoCo says what it thinks of that.
    """
    children: dict[int, list[int]] = {number: [] for number in (WORLD, *range(len(tree.joints)))}
    for number, joint in enumerate(tree.joints):
        children[joint.parent].append(number)
    bodies = "".join(_body_text(tree, children, number) for number in children[WORLD])
    return (
        '<mujoco><compiler angle="radian"/>'
        f'<option gravity="0 0 {-tree.gravity!r}">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )


def _body_text(tree: Tree, children: dict[int, list[int]], number: int) -> str:
    turn, step = np.eye(3), np.zeros(3)
    group = []
    while True:
        joint = tree.joints[number]
        turn, step = turn @ joint.rotation, step + turn @ joint.offset
        group.append((number, turn, step))
        if joint.mass > 0.0 or len(children[number]) != 1:
            break
        (number,) = children[number]
    lines = [
        f'<body name="body_{number}" pos="{_numbers(step)}" '
        f'xyaxes="{_numbers(turn.T[:2].ravel())}">'
    ]
    if joint.mass > 0.0:
        moments, axes = _principal(joint.inertia)
        lines.append(
            f'<inertial pos="{_numbers(joint.com)}" mass="{joint.mass!r}" '
            f'xyaxes="{_numbers(axes.T[:2].ravel())}" diaginertia="{_numbers(moments)}"/>'
        )
    for member, its_turn, its_step in group:
        moved = tree.joints[member]
        lines.append(
            f'<joint name="joint_{member}" type="{"hinge" if moved.revolute else "slide"}" '
            f'axis="{_numbers(turn.T @ its_turn[:, moved.axis])}" '
            f'pos="{_numbers(turn.T @ (its_step - step))}"/>'
        )
    lines += [_body_text(tree, children, child) for child in children[number]]
    return "".join([*lines, "</body>"])


def _principal(inertia: Array) -> tuple[Array, Array]:
    """Principal moments, and the axes in columns, of which MuJoCo would get fewer digits."""
    moments, axes = np.linalg.eigh(inertia)
    # Rounding may leave less than nothing about the axis of a thin rod.
    return np.maximum(moments, 0.0), axes * np.linalg.det(axes)


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
