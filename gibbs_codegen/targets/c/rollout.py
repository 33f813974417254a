"""What the templates of rollouts in C are given of a robot."""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.targets.verbatim import c_source


@dataclass(frozen=True)
class RolloutText:
    """What depends on the robot, and the source that does not.

    `block` comes before the functions that the template makes of the robot's, `run` after them.
    """

    rotors: int
    is_quaternion: bool
    block: str
    run: str


def rollout_text(robot: Robot) -> RolloutText:
    """Part of the context of the templates of rollouts."""
    return RolloutText(
        robot.rotors,
        layout_of(robot).is_quaternion,
        c_source("rollout/begin.c"),
        c_source("rollout/rollout.c").rstrip(),
    )
