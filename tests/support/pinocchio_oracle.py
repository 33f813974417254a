"""The robot as a Pinocchio tree, built from its data alone: the oracle of the derivation.

The constrained joints are real joints of the tree, so the constraint torques have an oracle too:
inverse dynamics with those joints held.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gibbs_codegen.robot.description import Description, constrained_arms
from gibbs_codegen.robot.layout import frames_of, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.robot.parts.body import Body, Rod
from gibbs_codegen.robot.parts.link import Passive
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.verification.formulation import Quantities
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

Array = np.ndarray


def rotation(axis: str, degrees: float) -> Array:
    """Rotation matrix about a coordinate axis."""
    return pin.AngleAxis(np.deg2rad(degrees), np.eye(3)["xyz".index(axis)]).toRotationMatrix()


def by_rpy(angles: Sequence[Fraction]) -> Array:
    """Rotation matrix of roll, pitch and yaw in degrees, R_z·R_y·R_x."""
    x, y, z = (rotation(axis, float(angle)) for axis, angle in zip("xyz", angles, strict=True))
    return z @ y @ x


def placed(pose: Pose | None) -> pin.SE3:
    """A pose of a robot file."""
    assert pose is not None
    return pin.SE3(by_rpy(pose.rpy_deg), np.array(pose.xyz))


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


class Dynamics(NamedTuple):
    """M a + nle = B u in the order of v; a for given u."""

    mass_matrix: Array
    nonlinear: Array
    inputs: Array
    acceleration: Array


@dataclass
class Oracle:
    """A robot's tree; coordinates are those of the hybrid system without the constraint torques.

    With `rigid_base` what is held is welded instead, and the coordinates are those of v.
    """

    robot: Robot
    rigid_base: bool = False

    def __post_init__(self) -> None:
        robot, base = self.robot, self.robot.base
        self.model = model = pin.Model()
        model.gravity.linear = np.array([0.0, 0.0, -robot.gravity])
        self.layout = layout_of(robot)
        self.root = self._add_base()
        centre = self._centre()
        self.bodies = {0: (self.root, pin.SE3(np.eye(3), centre))}
        self.points: dict[str, tuple[int, Array]] = {}
        if base.body:
            model.appendBodyToJoint(self.root, spatial_inertia(base.body), self.bodies[0][1])
        rotors = {k: self._rod(k) for k in range(1, base.rotors + 1)}
        self._add_links()
        for k, rotor in enumerate(robot.thrusters, start=1):
            joint, at = self.bodies[rotor.on]
            rotors[k] = (joint, at * pin.SE3(np.eye(3), np.array(rotor.position)))
        thrusts = [(np.array(r.direction), r.drag) for r in robot.thrusters]
        self.thrusts = thrusts or list(zip(map(np.array, base.thrust), base.drag, strict=True))
        self.rotors = [rotors[k] for k in range(1, robot.rotors + 1)]
        self.frames = {}
        for frame in frames_of(robot):
            joint, at = self.bodies[frame.on]
            self.frames[frame.name] = (joint, at * placed(frame.pose))
        places = [(self.root, pin.SE3(np.eye(3), centre))]
        places = [self.rotors[0], *places] if base.rotors else places
        joints = [self.bodies[i] for i in robot.moving]
        named = [at for name, at in self.frames.items() if name != "base"]
        self.places = [*places, *self.rotors, *joints, *named]
        self.data = model.createData()
        reduced = self.layout.v.names
        every = [c.name for c in Description(robot).hybrid_coordinates][
            : len(reduced) + len(constrained_arms(robot))
        ]
        names = reduced if self.rigid_base else every
        own = {name: i for i, name in enumerate(reduced[:6]) if self.layout.is_quaternion}
        self.order = [
            own[name] if name in own else model.joints[model.getJointId(name)].idx_v
            for name in names
        ]
        self.free = [names.index(name) for name in reduced]
        self.held = [i for i, name in enumerate(names) if name not in reduced]

    def _centre(self) -> Array:
        """The base centre from the origin of the coordinates."""
        base = self.robot.base
        if base.origin != "motor1":
            return np.zeros(3)
        length = base.arm(1).length
        if base.azimuth_deg is None:
            return np.array([length, 0.0, 0.0])
        return rotation("z", float(base.azimuth_deg[0])) @ np.array([-length, 0.0, 0.0])

    def _rod(self, k: int) -> tuple[int, pin.SE3]:
        """Add a rod of the base; return where its motor is."""
        base, model = self.robot.base, self.model
        centre, reach = self._centre(), np.array([base.arm(k).length, 0.0, 0.0])
        tip = pin.SE3(np.eye(3), reach)
        if k == 1 and base.azimuth_deg is None:
            placement = pin.SE3(np.eye(3), centre - reach)
            model.appendBodyToJoint(self.root, spatial_inertia(base.arm(1)), placement)
            return self.root, placement
        placement = pin.SE3(rotation("z", float(base.arm_angle_deg(k))), centre)
        if k == 1 or self.rigid_base:
            model.appendBodyToJoint(self.root, spatial_inertia(base.arm(k)), placement)
            return self.root, placement * tip
        joint = model.addJoint(self.root, pin.JointModelRZ(), placement, f"theta_{k}")
        model.appendBodyToJoint(joint, spatial_inertia(base.arm(k)), pin.SE3.Identity())
        return joint, tip

    def _add_links(self) -> None:
        robot, model = self.robot, self.model
        parents = robot.parents
        for i in _depth_first(parents):
            link, (parent, at) = robot.links[i - 1], self.bodies[parents[i - 1]]
            if link.pose is None:
                default = robot.links[parents[i - 1] - 1].body.length if parents[i - 1] else 0.0
                twist = rotation("x", float(link.alpha_deg))
                a = default if link.a is None else link.a
                step = np.array([a, 0, 0]) + twist @ np.array([0, 0, link.d])
                placement = pin.SE3(twist @ rotation("z", float(link.theta_deg)), step)
            else:
                placement = placed(link.pose)
            placement = at * placement
            axis = np.array(link.axis) / np.linalg.norm(link.axis)
            if link.motor:
                self._add_rotor(i, parent, placement, link.motor.rotor_inertia, axis)
            if link.moves or (link.constrained and not self.rigid_base):
                slides = link.joint == "prismatic"
                kind = (
                    pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
                )
                joint = model.addJoint(parent, kind(axis), placement, coordinate_of(robot, i))
                placement, parent = pin.SE3.Identity(), joint
            model.appendBodyToJoint(parent, spatial_inertia(link.body), placement)
            self.bodies[i] = (parent, placement)

    def _add_rotor(self, i: int, parent: int, at: pin.SE3, inertia: float, axis: Array) -> None:
        """Add a joint for what of a rotor's inertia is the carrier's, as long as it is at rest."""
        model, spin = self.model, inertia * np.outer(axis, axis)
        if parent:
            whole, turn = model.inertias[parent], at.rotation
            rest = whole.inertia - turn @ spin @ turn.T
            model.inertias[parent] = pin.Inertia(whole.mass, whole.lever, rest)
        joint = model.addJoint(parent, pin.JointModelRevoluteUnaligned(axis), at, f"rotor of {i}")
        model.appendBodyToJoint(joint, pin.Inertia(0.0, np.zeros(3), spin), pin.SE3.Identity())

    def _add_base(self) -> int:
        """Put the joints of the base into the tree: the last of them."""
        model, parent = self.model, 0
        if self.layout.attitude == "fixed":
            return 0
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
        matrix = pin.crba(self.model, self.data, self.configuration(q))[
            np.ix_(self.order, self.order)
        ]
        for place, _, passive in self._passive:
            matrix[place, place] += passive.armature
        return matrix

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """M a − R in all coordinates, in the hybrid order."""
        tree = pin.rnea(
            self.model, self.data, self.configuration(q), self.spread(v), self.spread(a)
        )
        forces = tree[self.order]
        for (place, here, passive), angle in zip(
            self._passive, q[self.layout.q.joints], strict=True
        ):
            forces[place] += passive.armature * a[here] + passive.damping * v[here]
            forces[place] += passive.stiffness * (angle - passive.rest)
        return forces

    @property
    def _passive(self) -> list[tuple[int, int, Passive]]:
        """For each joint that moves its place in the hybrid order and in v, and what acts on it."""
        places = self.layout.v.joint_places
        given = [self.robot.links[i - 1].passive for i in self.robot.moving]
        return [(self.free[at], at, acts) for at, acts in zip(places, given, strict=True)]

    def dynamics(self, q: Array, v: Array, u: Array) -> Dynamics:
        """M a + nle = B u in the free coordinates."""
        free = self.free
        matrix = self.mass_matrix(q)[np.ix_(free, free)]
        nonlinear = self.inverse_dynamics(q, v, np.zeros_like(v))[free]
        inputs = self.input_matrix(q)[free]
        return Dynamics(matrix, nonlinear, inputs, np.linalg.solve(matrix, inputs @ u - nonlinear))

    def point_jacobian(self, q: Array, place: tuple[int, pin.SE3]) -> tuple[Array, pin.SE3]:
        """World-axes Jacobian of a place on a body, linear rows first, and its placement."""
        joint, local = place
        pin.computeJointJacobians(self.model, self.data, self.configuration(q))
        placement = self.data.oMi[joint] * local
        frame = pin.getJointJacobian(
            self.model, self.data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        lever = self.data.oMi[joint].rotation @ local.translation
        jacobian = frame.copy()
        jacobian[:3] += np.cross(frame[3:].T, lever).T
        return jacobian[:, self.order], placement

    def bias_acceleration(self, q: Array, v: Array, place: tuple[int, pin.SE3]) -> Array:
        """World-axes acceleration of a place at zero accelerations, linear entries first."""
        tree = self.configuration(q), self.spread(v), np.zeros(self.model.nv)
        pin.forwardKinematics(self.model, self.data, *tree)
        joint, local = place
        return pin.getFrameClassicalAcceleration(
            self.model,
            self.data,
            joint,
            pin.SE3(np.eye(3), local.translation),
            pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
        ).vector

    def input_matrix(self, q: Array) -> Array:
        """Generalised forces of unit inputs in all coordinates, in the hybrid order."""
        columns = []
        for place, (direction, drag) in zip(self.rotors, self.thrusts, strict=True):
            jacobian, placement = self.point_jacobian(q, place)
            thrust = placement.rotation @ direction / np.linalg.norm(direction)
            columns.append(jacobian.T @ np.concatenate([thrust, drag * thrust]))
        every = np.eye(len(self.order))
        joints = [self.free[place] for place in self.layout.v.joint_places]
        columns += [every[place] for place in joints]
        return np.array(columns).reshape(-1, len(self.order)).T

    def positions(self, q: Array) -> Array:
        """World positions of the points, in their order."""
        return np.array([self.point_jacobian(q, at)[1].translation for at in self.places])

    def energies(self, q: Array, v: Array) -> tuple[float, float]:
        """Kinetic and potential energy."""
        tree = self.configuration(q)
        kinetic = pin.computeKineticEnergy(self.model, self.data, tree, self.spread(v))
        potential = pin.computePotentialEnergy(self.model, self.data, tree)
        angles = q[self.layout.q.joints]
        for (_, here, passive), angle in zip(self._passive, angles, strict=True):
            kinetic += passive.armature * v[here] ** 2 / 2
            potential += passive.stiffness * (angle - passive.rest) ** 2 / 2
        return kinetic, potential

    def centroidal(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Centre of mass, its Jacobian, centroidal momentum, gravity's part of R, of all joints."""
        tree = self.configuration(q)
        jacobian = pin.jacobianCenterOfMass(self.model, self.data, tree)[:, self.order].copy()
        centre = pin.centerOfMass(self.model, self.data, tree).copy()
        momentum = pin.computeCentroidalMomentum(self.model, self.data, tree, self.spread(v))
        gravity = pin.computeGeneralizedGravity(self.model, self.data, tree)
        return centre, jacobian, momentum.vector, -gravity[self.order]

    def joint_wrenches(self, q: Array, v: Array, a: Array, u: Array, pushes: Array) -> Array:
        """What every joint passes on to its body, of rods and then of links.

        `pushes` (frames, 6) are wrenches on the frames, in world axes.
        In the tree that this needs, every link has a joint, held where it is fixed in the robot.
        """
        held = [i for i, link in enumerate(self.robot.links, start=1) if not link.moves]
        links = [
            replace(link, constrained=True) if i in held else link
            for i, link in enumerate(self.robot.links, start=1)
        ]
        whole = Oracle(replace(self.robot, links=tuple(links)))
        outside = pin.StdVec_Force()
        for _ in range(whole.model.njoints):
            outside.append(pin.Force.Zero())
        for place, (direction, drag), thrust in zip(whole.rotors, whole.thrusts, u, strict=False):
            joint, at = place
            along = direction / np.linalg.norm(direction) * thrust
            outside[joint] += at.act(pin.Force(along, drag * along))
        state = whole.configuration(q), whole.spread(v), whole.spread(a)
        pin.forwardKinematics(whole.model, whole.data, state[0])
        for (joint, at), push in zip(whole.frames.values(), pushes, strict=True):
            back = (whole.data.oMi[joint].rotation @ at.rotation).T
            outside[joint] += at.act(pin.Force(back @ push[:3], back @ push[3:]))
        pin.rnea(whole.model, whole.data, *state, outside)
        rods = [whole.model.getJointId(f"theta_{k}") for k in range(2, self.robot.base.rotors + 1)]
        joints = [*rods, *(whole.bodies[i][0] for i in range(1, len(links) + 1))]
        return np.array([whole.data.f[j].vector for j in joints]).reshape(-1, 6)

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


def free_flyer(robot: Robot) -> Oracle:
    """The robot with a quaternion, what is held welded, without dampers, springs and armature."""
    links = tuple(replace(link, passive=Passive()) for link in robot.links)
    base = replace(robot.base, attitude="quaternion")
    return Oracle(replace(robot, base=base, links=links), rigid_base=True)


class _Whole(Quantities):
    """What the oracle gives, which has the passive joints in it."""

    def with_passive(self, tree: Tree, states: States) -> Quantities:
        """The same."""
        return self


class InPinocchio:
    """The oracle as a formulation of `gibbs_codegen.verification`; the tree is its layout only."""

    name, limit, growth = "the oracle", 1e-12, 0

    def __init__(self, oracle: Oracle, tree: Tree) -> None:
        self.tree, self._oracle = tree, oracle

    def at(self, states: States) -> Quantities:
        """Everything, state by state."""
        motions = zip(states.q, states.v, states.a, states.u, states.W, strict=True)
        each = [self._at(*motion) for motion in motions]
        arrays = (None if x[0] is None else np.array(x) for x in zip(*each, strict=True))
        return _Whole._make(arrays)

    def _at(self, q: Array, v: Array, a: Array, u: Array, pushes: Array) -> Quantities:
        oracle = self._oracle
        frames = [*oracle.frames.values()]
        jacobians, places = zip(
            *(oracle.point_jacobian(q, seat) for seat in (*oracle.rotors, *frames)), strict=True
        )
        kinetic, potential = oracle.energies(q, v)
        return Quantities(
            oracle.mass_matrix(q),
            -oracle.inverse_dynamics(q, v, 0.0 * a),
            oracle.inverse_dynamics(q, v, a),
            np.array([place.homogeneous for place in places]),
            np.array(jacobians),
            kinetic,
            potential,
            oracle.positions(q),
            np.array([oracle.bias_acceleration(q, v, frame) for frame in frames]),
            *oracle.centroidal(q, v),
            oracle.joint_wrenches(q, v, a, u, 0.0 * pushes),
            oracle.joint_wrenches(q, v, a, u, pushes),
        )
