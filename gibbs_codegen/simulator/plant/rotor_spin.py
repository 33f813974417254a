"""Angular momentum of spinning rotors: the gyroscopic torques by which they resist turning.

A rotor of inertia J that spins at Ω about its thrust's direction d has the angular momentum
h = J Ω d, and does the torque −ω × h to the body that holds it, ω being the angular velocity of
that body. Ω follows from the thrust, Ω = k √T. The torque −J dΩ/dt along d, by which a rotor
resists a change of its speed, is left out.

What such a torque does to the coordinates depends on d alone: any body in which d stays where it is
may take it, and gives the same generalised forces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle

# Angles and travels of joints, rad and m, by which it is told which frames move with a rotor.
_FIRST_JOINT, _NEXT_JOINT = 0.3, 0.37
# How far a direction may seem to turn in a frame that moves with it.
_SAME_DIRECTION = 1e-9


class RotorSpin:
    """The g rotors that have a spin inertia, and the frames that take their torques.

    `places` (g) are numbers of the frames, `axes` (g, 3) the directions of the thrusts in their
    axes. `spins` (N) are as of `Actuators`, negative for a rotor that spins clockwise seen from the
    tip of its thrust, 0 for one without inertia. Raises `UsageError` for a rotor on a link that has
    no frame.
    """

    def __init__(self, vehicle: Vehicle, spins: Array) -> None:
        self.rotors: NDArray[np.intp] = np.flatnonzero(spins)
        self.spins = spins[self.rotors]
        joints = _FIRST_JOINT + _NEXT_JOINT * np.arange(vehicle.joints)
        # Where parameters differ along an axis, one robot tells the directions of all.
        q = np.tile(vehicle.neutral, (3, 1, 1))
        q[1:, 0, vehicle.arm] = joints, -joints[::-1]
        thrusts = np.swapaxes(vehicle.thrust_wrenches(q)[:, 0, :3][..., self.rotors], -1, -2)
        world = thrusts @ np.swapaxes(vehicle.base_rotation(q[:, 0]), -1, -2)
        seen = np.einsum("sfij,sgi->sgfj", vehicle.frame_poses(q)[:, 0, :, :3, :3], world)
        stays = np.all(np.abs(seen - seen[:1]) < _SAME_DIRECTION, axis=(0, 3))
        for rotor, frames in zip(self.rotors, stays, strict=True):
            if not np.any(frames):
                raise UsageError(
                    f"{vehicle.name}: rotor {rotor + 1} has a spin_inertia, but no frame moves "
                    "with it: add a [[frame]] on the link that carries it, and generate the "
                    "module again"
                )
        self.places: NDArray[np.intp] = np.argmax(stays, axis=1)
        axes = seen[0, np.arange(len(self.rotors)), self.places]
        self.axes: Array = axes / np.linalg.norm(axes, axis=-1, keepdims=True)

    def add(self, wrenches: Array, poses: Array, velocities: Array, inputs: Array) -> None:
        """Add the gyroscopic torques to other wrenches (…, f, 6) on the frames.

        `poses` (…, f, 4, 4) and `velocities` (…, f, 6), linear, then angular, world axes, are
        theirs.
        """
        thrusts = inputs[..., self.rotors]
        # A thrust the other way is that of a rotor that turns the other way.
        momentum = self.spins * np.sign(thrusts) * np.sqrt(np.abs(thrusts))
        rotations = poses[..., self.places, :3, :3]
        held = np.einsum("...gij,gj->...gi", rotations, self.axes) * momentum[..., np.newaxis]
        torques = -np.cross(velocities[..., self.places, 3:], held)
        for k, place in enumerate(self.places):
            wrenches[..., place, 3:] += torques[..., k, :]
