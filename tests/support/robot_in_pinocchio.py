"""Any tree of `robot.model` in Pinocchio, joint by joint: M, nonlinear effects, B."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from gibbs_codegen.robot.model import Pose, RigidBody, Robot

Array = NDArray[np.float64]


class Dynamics(NamedTuple):
    """M a + nle = B u in the order of the free-flyer's v, without damping; a for given u."""

    mass_matrix: Array
    nonlinear: Array
    inputs: Array
    acceleration: Array


def placed(pose: Pose | None) -> pin.SE3:
    """A pose of a robot file, R = Rz Ry Rx."""
    assert pose is not None
    roll, pitch, yaw = (np.deg2rad(float(angle)) for angle in pose.rpy_deg)
    turn = pin.utils.rotate("z", yaw) @ pin.utils.rotate("y", pitch) @ pin.utils.rotate("x", roll)
    return pin.SE3(turn, np.array(pose.xyz))


def _inertia(body: RigidBody) -> pin.Inertia:
    xx, yy, zz, xy, xz, yz = body.inertia
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return pin.Inertia(body.mass, np.array(body.com), matrix)


class PinocchioRobot:
    """The robot's model; `names` are those of coordinates in Pinocchio's order."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model = pin.Model()
        self.model.gravity.linear = np.array([0.0, 0.0, -robot.gravity])
        identity = pin.SE3.Identity()
        root = self.model.addJoint(0, pin.JointModelFreeFlyer(), identity, "flying base")
        self.joints = [root]
        assert robot.base.body is not None
        self.model.appendBodyToJoint(root, _inertia(robot.base.body), identity)
        for link, parent in zip(robot.links, robot.parents, strict=True):
            axis = np.array(link.axis)
            kind = (
                pin.JointModelRevoluteUnaligned(axis)
                if link.joint == "revolute"
                else pin.JointModelPrismaticUnaligned(axis)
            )
            carrier = self.joints[parent]
            joint = self.model.addJoint(carrier, kind, placed(link.pose), str(link.name))
            assert isinstance(link.body, RigidBody)
            self.model.appendBodyToJoint(joint, _inertia(link.body), identity)
            self.joints.append(joint)
        self.data = self.model.createData()

    def order(self) -> list[int]:
        """Places in v of the base's six and of each link, in the robot's order."""
        places = [self.model.joints[joint].idx_v for joint in self.joints[1:]]
        return [*range(6), *places]

    def at(self, q: Array, v: Array, u: Array) -> Dynamics:
        """Everything at one state, in the robot's own order of joints."""
        order = self.order()
        own_q, own_v = np.array(q), np.zeros(len(v))
        own_q[np.array(order[6:], int) + 1] = q[7:]
        own_v[order] = v
        matrix = pin.crba(self.model, self.data, own_q).copy()
        matrix = np.triu(matrix) + np.triu(matrix, 1).T
        nonlinear = pin.nonLinearEffects(self.model, self.data, own_q, own_v).copy()
        inputs = np.zeros((len(v), len(self.robot.thrusters) + len(self.robot.links)))
        pin.computeJointJacobians(self.model, self.data, own_q)
        for k, rotor in enumerate(self.robot.thrusters):
            seat = pin.SE3(np.eye(3), np.array(rotor.position))
            joint = self.joints[rotor.on]
            jacobian = pin.getFrameJacobian(
                self.model, self.data, joint, seat, pin.ReferenceFrame.LOCAL
            )
            push = np.array(rotor.direction)
            inputs[:, k] = jacobian.T @ np.concatenate([push, rotor.drag * push])
        for i in range(len(self.robot.links)):
            inputs[order[6 + i], len(self.robot.thrusters) + i] = 1.0
        matrix, nonlinear, inputs = (
            matrix[np.ix_(order, order)],
            nonlinear[order],
            inputs[order],
        )
        a = np.linalg.solve(matrix, inputs @ u - nonlinear)
        return Dynamics(matrix, nonlinear, inputs, a)
