"""Recursive Newton–Euler equations of the tree, in world axes (Luh, Walker and Paul, 1980).

The constrained joints are joints here, so that what holds them comes out as their effort, and the
wrench through every joint with it.
"""

from __future__ import annotations

import numpy as np

from gibbs_codegen.verification.actuators import Motions
from gibbs_codegen.verification.formulation import Quantities
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import (
    WORLD,
    BodyMotion,
    Frames,
    Joint,
    JointPart,
    Point,
    Tree,
    joint_motions,
)
from gibbs_codegen.verification.vectors import Array, Sized, cross, times


def joint_wrenches(
    tree: Tree, motions: list[BodyMotion], frames: Frames, u: Array, pushes: Array
) -> Array:
    """Wrenches (s, bodies, 6), N and N m, through the joints, held and welded ones included.

    What carries each body does that to it: force and moment at the origin of its frame, in its
    axes. `pushes` (s, frames, 6) are wrenches on the frames.
    """
    rotations, upwards = frames.rotations, np.array([0.0, 0.0, tree.gravity])
    # On bodies at the origins of their frames, in world axes, (s, 3) each.
    forces = {body: np.zeros((len(u), 3)) for body in tree.bodies}
    moments = {body: np.zeros((len(u), 3)) for body in tree.bodies}

    def add(body: int, at: Point, force: Array, moment: Array) -> None:
        """Add a force at a point of the body's joint, or of one that this carries, and a moment."""
        frame = tree.bodies[body]
        lever = rotations[at.joint] @ at.local - rotations[frame.joint] @ frame.local
        if at.joint != frame.joint:
            lever = lever + frames.steps[at.joint]
        forces[body] = forces[body] + force
        moments[body] = moments[body] + moment + cross(lever, force)

    for part in tree.parts:  # What inertia and gravity take.
        taken = _inertial(part, motions[part.joint], rotations[part.joint], upwards)
        add(part.body, Point(part.joint, part.com), *taken)
    for k, (motor, seat) in enumerate(zip(tree.motors, tree.seats, strict=False)):
        thrust = u[:, k, None] * (rotations[seat.joint] @ seat.rotation @ motor.direction)
        add(motor.body, seat, -thrust, -motor.drag * thrust)
    for place, (body, point) in enumerate(zip(tree.mounts, tree.named, strict=True)):
        add(body, point, -pushes[:, place, :3], -pushes[:, place, 3:])
    for body, carrier in reversed([*tree.carriers.items()]):
        add(carrier, tree.bodies[body], forces[body], moments[body])
    rows = []
    for body in tree.carriers:
        at = tree.bodies[body]
        back = np.swapaxes(rotations[at.joint] @ at.rotation, -1, -2)
        own_wrench = times(back, forces[body]), times(back, moments[body])
        rows.append(np.concatenate(own_wrench, axis=-1))
    return np.stack(rows, axis=1) if rows else np.zeros((len(u), 0, 6))


def _inertial(
    body: Joint | JointPart, motion: BodyMotion, rotation: Array, upwards: Array
) -> tuple[Array, Array]:
    """Force and moment (…, 3) about its centre of mass that a body's inertia and weight take."""
    _, acceleration = motion.at(rotation @ body.com)
    inertia, spin = _in_world(body, rotation), motion.angular_velocity
    moment = times(inertia, motion.angular_acceleration) + cross(spin, times(inertia, spin))
    return body.mass * (acceleration + upwards), moment


def _in_world(body: Joint | JointPart, rotation: Array) -> Array:
    """Inertia (…, 3, 3) of a body in world axes."""
    return rotation @ body.inertia @ np.swapaxes(rotation, -1, -2)


def _of_actuators(tree: Tree, states: States) -> dict[str, Sized] | None:
    """Results of the functions of the actuators, None where u is commanded."""
    if tree.actuators is None:
        return None
    angles, rates, _ = (x[:, tree.driven] for x in tree.motion(states))
    return tree.actuators.at(Motions(angles, rates, states.u, states.x, states.command))


def wrench_sizes(tree: Tree, acceleration: Array, spin: Array, u: Array) -> Array:
    """Natural sizes (s, bodies, 6), N and N m, of the wrenches through the joints.

    `acceleration` (s,), m/s², is at most that of the robot's points, gravity included; `spin` (s,),
    1/s², the squares of angular velocities and angular accelerations.
    """
    mass = dict.fromkeys(tree.bodies, 0.0)
    inertia = dict.fromkeys(tree.bodies, 0.0)
    thrust = {body: np.zeros(len(u)) for body in tree.bodies}
    for part in tree.parts:
        mass[part.body] += part.mass
        inertia[part.body] += float(np.trace(part.inertia))
    for k, motor in enumerate(tree.motors):
        thrust[motor.body] = thrust[motor.body] + np.abs(u[:, k])
    for body, carrier in reversed([*tree.carriers.items()]):
        mass[carrier] += mass[body]
        inertia[carrier] += inertia[body]
        thrust[carrier] = thrust[carrier] + thrust[body]
    drag = max((abs(motor.drag) for motor in tree.motors), default=0.0)
    sizes = np.zeros((len(u), len(tree.carriers), 6))
    for row, body in enumerate(tree.carriers):
        force = mass[body] * acceleration + thrust[body]
        sizes[:, row, :3] = force[:, None]
        moment = tree.reach * force + inertia[body] * spin + drag * thrust[body]
        sizes[:, row, 3:] = moment[:, None]
    return sizes


class NewtonEuler:
    """A formulation (see `formulation`): balance of forces and moments, body by body."""

    name = "Newton–Euler"
    limit = 1e-10
    growth = 0

    def __init__(self, tree: Tree) -> None:
        self.tree = tree

    def at(self, states: States) -> Quantities:
        """Everything that the formulation computes."""
        tree = self.tree
        q, v, a = tree.motion(states)
        frames = tree.frames(q)
        steady = joint_motions(tree, v, np.zeros_like(a), frames)
        still = joint_motions(tree, np.zeros_like(v), np.zeros_like(a), frames)
        moved = joint_motions(tree, v, a, frames)
        pulls = tree.passive.pulls(q, v, frames)
        bias = []
        for point in tree.named:
            _, linear = steady[point.joint].at(frames.rotations[point.joint] @ point.local)
            angular = steady[point.joint].angular_acceleration
            bias.append(np.concatenate([linear, angular], axis=-1))
        return Quantities(
            mass_matrix=self.mass_matrix(states.q),
            residual=-self._efforts(steady, frames, tree.gravity),
            inverse_dynamics=self._efforts(moved, frames, tree.gravity),
            poses=tree.poses(frames),
            jacobians=np.stack([self._jacobian(frames, seat) for seat in tree.seats], axis=1),
            positions=tree.positions(frames, tree.points),
            bias_accelerations=np.stack(bias, axis=1),
            gravity_forces=-self._efforts(still, frames, tree.gravity),
            joint_wrenches=joint_wrenches(tree, moved, frames, states.u, pulls),
            loaded_joint_wrenches=joint_wrenches(tree, moved, frames, states.u, pulls + states.W),
            actuators=_of_actuators(tree, states),
            **self._masses(steady, frames),
        )

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix (s, size, size) of all joints, for q (s, nv) of the free ones.

        Its columns are efforts of unit accelerations, one by one, at rest and without gravity.
        """
        tree = self.tree
        frames = tree.frames((tree.spread(q) + tree.offsets)[:, None])
        units = np.eye(tree.size)[None]
        motions = joint_motions(tree, np.zeros_like(units), units, frames)
        efforts = self._efforts(motions, frames, 0.0)
        return np.swapaxes(efforts, -1, -2)

    def _masses(self, motions: list[BodyMotion], frames: Frames) -> dict[str, Array]:
        """Sums over the bodies: energies, centre of mass, Jacobian and momentum.

        Momentum is linear, then angular about the centre of mass, kg m/s and kg m²/s.
        """
        tree, (rotations, positions, _) = self.tree, frames
        kinetic: Array = np.zeros(())
        potential: Array = np.zeros(())
        first: Array = np.zeros(3)
        jacobian: Array = np.zeros((3, tree.size))
        linear: Array = np.zeros(3)
        angular: Array = np.zeros(3)
        for number, (joint, motion) in enumerate(zip(tree.joints, motions, strict=True)):
            lever, spin = rotations[number] @ joint.com, motion.angular_velocity
            place, (velocity, _) = positions[number] + lever, motion.at(lever)
            spun, push = (times(_in_world(joint, rotations[number]), spin), joint.mass * velocity)
            kinetic = kinetic + 0.5 * np.sum(velocity * push + spin * spun, axis=-1)
            potential = potential + joint.mass * tree.gravity * place[:, 2]
            first = first + joint.mass * place
            moved = self._jacobian(frames, Point(number, joint.com))
            jacobian = jacobian + joint.mass * moved[:, :3]
            linear, angular = linear + push, angular + spun + cross(place, push)
        centre = first / tree.mass
        angular = angular - cross(centre, linear)
        return {
            "kinetic_energy": kinetic,
            "potential_energy": potential,
            "centre_of_mass": centre,
            "centre_jacobian": jacobian / tree.mass,
            "momentum": np.concatenate([linear, angular], axis=-1),
        }

    def _efforts(self, motions: list[BodyMotion], frames: Frames, gravity: float) -> Array:
        """Efforts (…, size), N m and N, of the joints against inertia and `gravity`, in m/s²."""
        joints, rotations = self.tree.joints, frames.rotations
        upwards = np.array([0.0, 0.0, gravity])
        forces = []
        moments = []
        for joint, motion, rotation in zip(joints, motions, rotations, strict=True):
            force, moment = _inertial(joint, motion, rotation, upwards)
            forces.append(force)
            moments.append(moment + cross(rotation @ joint.com, force))
        efforts = np.empty((*forces[-1].shape[:-1], len(joints)))
        for number in range(len(joints) - 1, -1, -1):
            joint = joints[number]
            transmitted = moments[number] if joint.revolute else forces[number]
            axis = rotations[number][..., joint.axis]
            efforts[..., joint.place] = np.sum(axis * transmitted, axis=-1)
            if joint.parent != WORLD:
                lever = cross(frames.steps[number], forces[number])
                forces[joint.parent] = forces[joint.parent] + forces[number]
                moments[joint.parent] = moments[joint.parent] + moments[number] + lever
        return efforts

    def _jacobian(self, frames: Frames, point: Point) -> Array:
        """World-axes Jacobian of a point (states, 6, size), linear rows first."""
        tree = self.tree
        number = point.joint
        lever = frames.rotations[number] @ point.local
        jacobian = np.zeros((len(lever), 6, tree.size))
        while number != WORLD:
            joint = tree.joints[number]
            axis = frames.rotations[number][..., joint.axis]
            if joint.revolute:
                jacobian[:, :3, joint.place] = cross(axis, lever)
                jacobian[:, 3:, joint.place] = axis
            else:
                jacobian[:, :3, joint.place] = axis
            lever = lever + frames.steps[number]
            number = joint.parent
        return jacobian
