"""How the frames of joints move, from the world outwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.verification.joints import WORLD
from gibbs_codegen.verification.tree import Frames, Tree
from gibbs_codegen.verification.vectors import Array, cross


@dataclass(frozen=True)
class Motion:
    """Motion of a joint's frame in world axes, each (…, 3)."""

    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    def at(self, lever: Array) -> tuple[Array, Array]:
        """Velocity and acceleration of a point fixed in the frame, m/s and m/s², (…, 3).

        `lever` (…, 3) leads to it from the frame's origin, in m, in world axes.
        """
        turning = cross(self.angular_velocity, lever)
        return (
            self.velocity + turning,
            self.acceleration
            + cross(self.angular_acceleration, lever)
            + cross(self.angular_velocity, turning),
        )


def joint_motions(tree: Tree, v: Array, a: Array, frames: Frames) -> list[Motion]:
    """Motions of the joints' frames, from the world outwards.

    Rates `v` and accelerations `a` of all joints are (…, size), in rad and m; leading axes of the
    frames broadcast against theirs.
    """
    still = Motion(*(np.zeros((*v.shape[:-1], 3)) for _ in range(4)))
    motions: list[Motion] = []
    for number, joint in enumerate(tree.joints):
        parent = still if joint.parent == WORLD else motions[joint.parent]
        axis = frames.rotations[number][..., joint.axis]
        rate = axis * v[..., joint.place, None]
        gain = axis * a[..., joint.place, None]
        dragged = cross(parent.angular_velocity, rate)
        velocity, acceleration = parent.at(frames.steps[number])
        if joint.revolute:
            motion = Motion(
                velocity,
                parent.angular_velocity + rate,
                acceleration,
                parent.angular_acceleration + gain + dragged,
            )
        else:
            motion = Motion(
                velocity + rate,
                parent.angular_velocity,
                acceleration + gain + 2.0 * dragged,
                parent.angular_acceleration,
            )
        motions.append(motion)
    return motions
