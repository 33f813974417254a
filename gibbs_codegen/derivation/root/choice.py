"""Which root a robot has: the one place that knows all of them."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.root.quaternion import QuaternionRoot
from gibbs_codegen.derivation.root.tait_bryan import TaitBryanRoot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Scalars


def root_of(robot: Robot, tape: Scalars, q: Sequence[sp.Expr]) -> Root:
    """The root of a robot: a quaternion, or Tait–Bryan angles in the robot's sequence."""
    layout = layout_of(robot)
    attitude = q[layout.q.attitude]
    if layout.is_quaternion:
        return QuaternionRoot.make(tape, attitude)
    return TaitBryanRoot.make(tape, layout.attitude, attitude)
