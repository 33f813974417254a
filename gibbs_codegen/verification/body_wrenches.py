"""What carries a body does to it, all six components, from the balance of body by body."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.verification.joints import Point
from gibbs_codegen.verification.motions import Motion
from gibbs_codegen.verification.tree import Frames, Tree
from gibbs_codegen.verification.vectors import Array, cross, times


def joint_wrenches(tree: Tree, motions: list[Motion], frames: Frames, u: Array) -> Array:
    """Wrenches (s, bodies, 6), N and N m, through the joints, held and welded ones included.

    What carries each body does that to it: force and moment at the origin of its frame, in its
    axes.
    """
    balance = _Balance(tree, frames, len(u))
    balance.add_inertia(motions)
    balance.add_thrusts(u)
    balance.pass_inwards()
    rows = [balance.in_own_axes(body) for body in tree.carriers]
    return np.stack(rows, axis=1) if rows else np.zeros((len(u), 0, 6))


class _Balance:
    """Forces and moments on bodies at the origins of their frames, in world axes, (s, 3) each."""

    def __init__(self, tree: Tree, frames: Frames, states: int) -> None:
        self._tree, self._frames = tree, frames
        self._forces = {body: np.zeros((states, 3)) for body in tree.bodies}
        self._moments = {body: np.zeros((states, 3)) for body in tree.bodies}

    def add_inertia(self, motions: list[Motion]) -> None:
        """Add what inertia and gravity take."""
        upwards = np.array([0.0, 0.0, self._tree.gravity])
        for part in self._tree.parts:
            motion, rotation = motions[part.joint], self._frames.rotations[part.joint]
            _, acceleration = motion.at(rotation @ part.com)
            inertia = rotation @ part.inertia @ np.swapaxes(rotation, -1, -2)
            spin = motion.angular_velocity
            moment = times(inertia, motion.angular_acceleration)
            moment = moment + cross(spin, times(inertia, spin))
            at = Point(part.joint, part.com)
            self._add(part.body, at, part.mass * (acceleration + upwards), moment)

    def add_thrusts(self, u: Array) -> None:
        """Add what motors supply."""
        for k, (motor, seat) in enumerate(zip(self._tree.motors, self._tree.seats, strict=False)):
            axes = self._frames.rotations[seat.joint] @ seat.rotation
            thrust = u[:, k, None] * (axes @ motor.direction)
            self._add(motor.body, seat, -thrust, -motor.drag * thrust)

    def pass_inwards(self) -> None:
        """Add to every body what those that it carries take."""
        for body, carrier in reversed([*self._tree.carriers.items()]):
            at = self._tree.bodies[body]
            self._add(carrier, at, self._forces[body], self._moments[body])

    def in_own_axes(self, body: int) -> Array:
        """Force and moment on a body, (s, 6), in the axes of its frame."""
        at = self._tree.bodies[body]
        axes = self._frames.rotations[at.joint] @ at.rotation
        back = np.swapaxes(axes, -1, -2)
        own = times(back, self._forces[body]), times(back, self._moments[body])
        return np.concatenate(own, axis=-1)

    def _add(self, body: int, at: Point, force: Array, moment: Array) -> None:
        """Add a force and a moment in world axes, (s, 3) each, to those on a body.

        The force acts at a point of the joint that carries the body, or of one that this does.
        """
        rotations, frame = self._frames.rotations, self._tree.bodies[body]
        lever = rotations[at.joint] @ at.local - rotations[frame.joint] @ frame.local
        if at.joint != frame.joint:
            lever = lever + self._frames.steps[at.joint]
        self._forces[body] = self._forces[body] + force
        self._moments[body] = self._moments[body] + moment + cross(lever, force)


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
