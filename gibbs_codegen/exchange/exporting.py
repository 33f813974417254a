"""From a robot to the text of a file in another format."""

from __future__ import annotations

from typing import Literal, get_args

from gibbs_codegen.exchange.mjcf_export import mjcf_text
from gibbs_codegen.exchange.robot_source import ROOT, source_of
from gibbs_codegen.exchange.urdf_text import left_out_of_urdf, urdf_text
from gibbs_codegen.robot.model import Robot

Format = Literal["urdf", "mjcf"]
FORMATS: tuple[Format, ...] = get_args(Format)
ENDINGS: dict[Format, str] = {"urdf": ".urdf", "mjcf": ".xml"}


def export_robot(robot: Robot, form: Format) -> tuple[str, list[str]]:
    """Write a robot in another format.

    Args:
        robot: The robot.
        form: The format.

    Returns:
        The text of the file, and what the format has no place for, a line each.
    """
    source = source_of(robot)
    if form == "urdf":
        return urdf_text(source), left_out_of_urdf(source)
    return mjcf_text(source, ROOT), []
