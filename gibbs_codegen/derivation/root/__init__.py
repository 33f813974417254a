"""The root: how the base's velocities move the tree, and which forces act along them.

A root turns the velocities of the base and their rates into the motion of the frame that the tree
begins with, the *root's group frame* (`frame_motion`), wrenches about the origin in that frame back
into generalised forces (`rows`), and the inertia of the whole into the base's block of M
(`mass_block`). `momentum_rates` are those of momenta along directions that move. The root segment
(arm 1) may turn against the group frame about z, the base normal (`segment_rotation`). Velocities
are rates of coordinates, or quasi-velocities, for which the Gibbs–Appell equations are the same.

Values of the base are those of attitude and then of position, without the joints: what
`Places.split` gives and `Places.joined` takes: six, whatever moves. Gravity (m/s²) is an upward
acceleration in all motions. The acceleration of the origin counts along the directions in
which linear velocities do: the world's for Tait–Bryan angles, otherwise the base's.

Back from a motion of the group frame, relative to free fall, to rates of the base's velocities lead
`accelerations`, and `acceleration_rows` for changes of that motion in a frame from which `turns`
lead to the group frame. `state_columns` has derivatives of all accelerations by attitude and
position, and by the base's velocities; its `turning` are the columns for a change of each component
of the base's ω, with the acceleration of the origin and dω/dt, and `linear` is the acceleration of
the origin in the group frame. Derivatives by coordinates are in the tangent space, by the
displacements of `integrated`.

`derivatives` says how forces depend on the coordinates and velocities of the base in one state. Its
`row` has the derivatives of the force on a joint, by the joint's column about the origin. Its
`blocks` are those of the forces on the base; their `body` is the whole robot about the origin, its
mass and its inertia force without those of the root's own mass. `coriolis` has 2C, C the Coriolis
matrix, in place of the derivatives by velocities: the entries ∫ξ_i·2ξ̇_j dm, as between joints.
"""

from __future__ import annotations

from gibbs_codegen.derivation.root.level import LevelRoot
from gibbs_codegen.derivation.root.quaternion import QuaternionDerivatives, QuaternionRoot
from gibbs_codegen.derivation.root.tait_bryan import TaitBryanDerivatives, TaitBryanRoot
from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.robot.parts.base import FIXED
from gibbs_codegen.symbolic.tape import Scalars, Values

Root = TaitBryanRoot | QuaternionRoot | LevelRoot
BaseDerivatives = TaitBryanDerivatives | QuaternionDerivatives


def root_of(layout: Layout, tape: Scalars, q: Values) -> Root:
    """The root of a robot: a quaternion, Tait–Bryan angles in the robot's sequence, or level.

    Where virtual links move the base, these stand on a root that does not move.
    """
    attitude = tuple(q[layout.q.attitude])
    if not layout.moves_freely:
        if not layout.turns_with_base:
            return LevelRoot.of(tape, FIXED, ())
        return LevelRoot.of(tape, layout.attitude, attitude)
    if layout.is_quaternion:
        return QuaternionRoot.make(tape, attitude)
    return TaitBryanRoot.make(tape, layout.attitude, attitude)
