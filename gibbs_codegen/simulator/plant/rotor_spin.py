"""Angular momentum of spinning rotors: the gyroscopic torques by which they resist turning.

A rotor of inertia J that spins at Ω about its thrust's direction d has the angular momentum
h = J Ω d, and does the torque −ω × h to the body that holds it, ω being the angular velocity of
that body. Ω follows from the thrust, Ω = k √T. The torque −J dΩ/dt along d, by which a rotor
resists a change of its speed, is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle


class RotorSpin:
    """The g rotors that have a spin inertia, and the frames that take their torques.

    `places` (g) are numbers of the frames, `axes` (g, 3) the directions of the thrusts in their
    axes. `spins` (N) are as of `Actuators`, negative for a rotor that spins clockwise seen from the
    tip of its thrust, 0 for one without inertia. Raises `UsageError` for a rotor on a link that has
    no frame, and for a module that does not say what carries its rotors.
    """

    def __init__(self, vehicle: Vehicle, spins: Array) -> None:
        self.rotors: NDArray[np.intp] = np.flatnonzero(spins)
        self.spins = spins[self.rotors]
        centre, carriers = vehicle.points.index(vehicle.centre), vehicle.carriers
        # The first frame is the base's, and the others are the last points.
        others = carriers[len(vehicle.points) - len(vehicle.frames) + 1 :]
        moves_with = carriers[centre + 1 + self.rotors, np.newaxis] == [centre, *others]
        for rotor, frames in zip(self.rotors, moves_with, strict=True):
            if carriers[centre + 1 + rotor] < 0:
                raise UsageError(
                    f"{vehicle.name}: rotor {rotor + 1} has a spin_inertia, and the module, which "
                    "an earlier version generated, does not say what carries it; generate it again"
                )
            if not np.any(frames):
                raise UsageError(
                    f"{vehicle.name}: rotor {rotor + 1} has a spin_inertia, but no frame moves "
                    "with it: add a [[frame]] on the link that carries it, and generate the "
                    "module again"
                )
        self.places: NDArray[np.intp] = np.argmax(moves_with, axis=1)
        # Where parameters differ along an axis, one robot tells the directions of all.
        q = vehicle.neutral[np.newaxis]
        world = vehicle.base_rotation(q[0]) @ vehicle.thrust_wrenches(q)[0, :3, self.rotors].T
        axes = np.einsum("gij,ig->gj", vehicle.frame_poses(q)[0, self.places, :3, :3], world)
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
