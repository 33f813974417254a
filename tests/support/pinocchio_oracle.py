"""The robot as a Pinocchio tree, built from its data alone: the oracle of the derivation.

The constrained joints are real joints of the tree, so the constraint torques have an oracle too:
inverse dynamics with those joints held.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from gibbs_codegen.robot.coordinates import hybrid_coordinates
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Body, Robot, Rod

Array = np.ndarray


def rotation(axis: str, degrees: float) -> Array:
    """Rotation matrix about a coordinate axis."""
    return pin.AngleAxis(np.deg2rad(degrees), np.eye(3)["xyz".index(axis)]).toRotationMatrix()


def spatial_inertia(body: Body) -> pin.Inertia:
    """Pinocchio's inertia of a rod or rigid body."""
    if isinstance(body, Rod):
        mass, length = body.total_mass, body.length
        thin = mass * length**2 / 12
        about_com = np.diag([0.0, thin, thin]) + np.diag(body.section_inertia)
        return pin.Inertia(mass, np.array([length / 2, 0, 0]), about_com)
    xx, yy, zz, xy, xz, yz = body.inertia
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return pin.Inertia(body.mass, np.array(body.com), about_com)


def _depth_first(parents: Sequence[int], number: int = 0) -> Iterator[int]:
    """Links in the order that Pinocchio wants: all of a subtree before the next one."""
    for i, parent in enumerate(parents, start=1):
        if parent == number:
            yield i
            yield from _depth_first(parents, i)


@dataclass
class Oracle:
    """A robot's tree; coordinates are those of the hybrid system without the constraint torques.

    With `rigid_base` the base arms are welded to arm 1 instead, and the coordinates are those of q.
    `parents` tells, for each link, what it is on: 0 for the base, i for link i; a row if not given.
    """

    robot: Robot
    rigid_base: bool = False
    parents: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        robot, base = self.robot, self.robot.base
        self.model = model = pin.Model()
        model.gravity.linear = np.array([0.0, 0.0, -robot.gravity])
        self.layout = layout_of(robot)
        parent = self._add_base()
        length = base.arm(1).length
        start, centre = (
            (np.zeros(3), np.array([length, 0, 0]))
            if base.origin == "motor1"
            else (np.array([-length, 0, 0]), np.zeros(3))
        )
        at = pin.SE3(np.eye(3), start)
        root = parent
        model.appendBodyToJoint(root, spatial_inertia(base.arm(1)), at)
        self.points = {"O1": (root, start), "O2": (root, centre), "motor1": (root, start)}
        for k in range(2, robot.rotors + 1):
            turn = rotation("z", float(base.arm_angle_deg(k)))
            placement = pin.SE3(turn, centre)
            if self.rigid_base:
                model.appendBodyToJoint(root, spatial_inertia(base.arm(k)), placement)
                continue
            joint = model.addJoint(root, pin.JointModelRZ(), placement, f"theta_{k}")
            model.appendBodyToJoint(joint, spatial_inertia(base.arm(k)), pin.SE3.Identity())
            self.points[f"motor{k}"] = (joint, np.array([base.arm(k).length, 0, 0]))
        self._add_arm(root, centre)
        self.data = model.createData()
        reduced = self.layout.v.names
        every = [c.name for c in hybrid_coordinates(robot)][: len(reduced) + robot.rotors - 1]
        names = reduced if self.rigid_base else every
        own = {name: i for i, name in enumerate(reduced[:6]) if self.layout.is_quaternion}
        self.order = [
            own[name] if name in own else model.joints[model.getJointId(name)].idx_v
            for name in names
        ]
        self.free = [names.index(name) for name in reduced]
        self.held = [i for i, name in enumerate(names) if name not in reduced]

    def _add_arm(self, base: int, centre: Array) -> None:
        robot, model = self.robot, self.model
        tip = (base, centre)
        joints = {0: base}
        parents = self.parents or tuple(range(len(robot.links)))
        for i in _depth_first(parents):
            link, number = robot.links[i - 1], parents[i - 1]
            default = robot.links[i - 2].body.length if i > 1 else 0.0
            twist = rotation("x", float(link.alpha_deg))
            a = default if link.a is None else link.a
            step = np.array([a, 0, 0]) + twist @ np.array([0, 0, link.d])
            placement = pin.SE3(
                twist @ rotation("z", float(link.theta_deg)), step if number else centre + step
            )
            revolute = link.joint == "revolute"
            kind = pin.JointModelRZ() if revolute else pin.JointModelPZ()
            name = f"{'theta' if revolute else 'd'}_{robot.rotors + i}"
            joints[i] = model.addJoint(joints[number], kind, placement, name)
            model.appendBodyToJoint(joints[i], spatial_inertia(link.body), pin.SE3.Identity())
        for i in range(1, len(robot.links) + 1):
            self.points[f"joint{robot.rotors + i}"] = (joints[i], np.zeros(3))
        if robot.links:
            tip = (joints[len(robot.links)], np.array([robot.links[-1].body.length, 0, 0]))
        self.points["tip"] = self.tip = tip

    def _add_base(self) -> int:
        """Put the joints of the base into the tree: the last of them."""
        model, parent = self.model, 0
        if self.layout.is_quaternion:
            return model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        for joint, name in zip(
            (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ()), "xyz", strict=True
        ):
            parent = model.addJoint(parent, joint, pin.SE3.Identity(), name)
        kinds = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}
        names = ("theta_m1", "theta_0", "theta_1")
        for letter, name in zip(self.layout.attitude, names, strict=True):
            parent = model.addJoint(parent, kinds[letter](), pin.SE3.Identity(), name)
        return parent

    def configuration(self, q: Array) -> Array:
        """Coordinates as the tree's, zero at the held joints."""
        if not self.layout.is_quaternion:
            return self.spread(q)
        velocities = self.spread(np.concatenate([np.zeros(6), q[7:]]))
        return np.concatenate([q[:7], velocities[6:]])

    def reduced_configuration(self, tree: Array) -> Array:
        """Coordinates from the tree's."""
        if not self.layout.is_quaternion:
            return tree[[self.order[i] for i in self.free]]
        joints = [self.order[i] for i in self.free[6:]]
        return np.concatenate([tree[:7], tree[1:][joints]])

    def spread(self, values: Array) -> Array:
        """Values for the velocities as the tree's, zero at the held joints."""
        tree = np.zeros(self.model.nv)
        tree[[self.order[i] for i in self.free]] = values
        return tree

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix in all coordinates, free and held, in the hybrid order."""
        return pin.crba(self.model, self.data, self.configuration(q))[
            np.ix_(self.order, self.order)
        ]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """M a − R in all coordinates, in the hybrid order."""
        motion = self.configuration(q), self.spread(v), self.spread(a)
        return pin.rnea(self.model, self.data, *motion)[self.order]

    def point_jacobian(self, q: Array, point: str) -> tuple[Array, pin.SE3]:
        """World-axes Jacobian of a named point, linear rows first, and its link's placement."""
        joint, local = self.points[point]
        pin.computeJointJacobians(self.model, self.data, self.configuration(q))
        placement = self.data.oMi[joint] * pin.SE3(np.eye(3), local)
        frame = pin.getJointJacobian(
            self.model, self.data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        lever = self.data.oMi[joint].rotation @ local
        jacobian = frame.copy()
        jacobian[:3] += np.cross(frame[3:].T, lever).T
        return jacobian[:, self.order], placement

    def tip_bias_acceleration(self, q: Array, v: Array) -> Array:
        """World-axes acceleration of the tip at zero accelerations, linear entries first."""
        tree = self.configuration(q), self.spread(v), np.zeros(self.model.nv)
        pin.forwardKinematics(self.model, self.data, *tree)
        joint, local = self.tip
        return pin.getFrameClassicalAcceleration(
            self.model,
            self.data,
            joint,
            pin.SE3(np.eye(3), local),
            pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
        ).vector

    def input_matrix(self, q: Array) -> Array:
        """Generalised forces of unit inputs in all coordinates, in the hybrid order."""
        robot = self.robot
        columns = []
        for k in range(1, robot.rotors + 1):
            jacobian, placement = self.point_jacobian(q, f"motor{k}")
            thrust = placement.rotation @ np.array(robot.base.thrust[k - 1])
            columns.append(jacobian.T @ np.concatenate([thrust, robot.base.drag[k - 1] * thrust]))
        joints = np.array(self.free)[self.layout.v.joints]
        columns += [*np.eye(len(self.order))[joints]]
        return np.array(columns).T

    def positions(self, q: Array) -> Array:
        """World positions of the named points, in their order."""
        return np.array([self.point_jacobian(q, name)[1].translation for name in self.points])

    def energies(self, q: Array, v: Array) -> tuple[float, float]:
        """Kinetic and potential energy."""
        tree = self.configuration(q)
        kinetic = pin.computeKineticEnergy(self.model, self.data, tree, self.spread(v))
        return kinetic, pin.computePotentialEnergy(self.model, self.data, tree)

    def integrated(self, q: Array, v: Array) -> Array:
        """Coordinates after a displacement."""
        tree = pin.integrate(self.model, self.configuration(q), self.spread(v))
        return self.reduced_configuration(tree)

    def difference(self, q0: Array, q1: Array) -> Array:
        """Displacement between two configurations."""
        tree = pin.difference(self.model, self.configuration(q0), self.configuration(q1))
        return tree[[self.order[i] for i in self.free]]

    def coordinate_rates(self, q: Array, v: Array) -> Array:
        """Rates of the coordinates."""
        if not self.layout.is_quaternion:
            return v
        attitude = pin.Quaternion(*q[[6, 3, 4, 5]])
        turning = attitude * pin.Quaternion(0.0, *v[3:6])
        return np.concatenate([attitude.matrix() @ v[:3], turning.coeffs() / 2.0, v[6:]])
