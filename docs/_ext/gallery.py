"""The gallery of robots that ship: a picture of each, what it is, and a command to begin with."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from gibbs_codegen.figures.machine import whole_shapes
from gibbs_codegen.figures.robot_artists import RobotArtists
from gibbs_codegen.figures.scene import fit, hide_numbers, set_scene
from gibbs_codegen.figures.style import style
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import LEVEL_MOTIONS
from gibbs_codegen.robot.posture import default_posture, robot_frames
from gibbs_codegen.robot.rotations import Array

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = Path(__file__).parent.parent / "reference" / "robot-file.md"
# A command that shows what is special about a robot; others are viewed.
COMMANDS = {
    "cart_pole": "show cart_pole",
    "decarotor_3link": "info decarotor_3link",
    "delta_hexarotor": "simulate delta_hexarotor --scenario delta",
    "dual_arm": "simulate dual_arm --scenario hover",
    "hexarotor": "simulate hexarotor --scenario hover",
    "hexarotor_3link": "simulate hexarotor_3link --scenario paper --animate gif",
    "hextilt_flying_arm_5": "simulate hextilt_flying_arm_5 --scenario circle",
    "octorotor_7link": "generate octorotor_7link --derivatives",
    "panda": "simulate panda --scenario hold",
    "planar_quadrotor_arm": "simulate planar_quadrotor_arm --scenario hover",
    "quadrotor": "simulate quadrotor --scenario flip",
    "quadrotor_2link": "show quadrotor_2link --chain 4",
    "quadrotor_arm_2link": "simulate quadrotor_arm_2link --scenario circle",
    "rover_arm": "simulate rover_arm --scenario drive",
}
# The size of a picture, in, its dots per inch, and the width at which pages show it, pixels.
_SIZE, _DPI, _WIDTH = (3.6, 2.7), 150, 360
# The least extent of a scene along an axis, and the room around a robot, as shares of the largest.
_THINNEST, _ROOM = 0.3, 0.04


def gallery() -> str:
    """The gallery in Markdown: for each robot its picture, its words in the table, its command."""
    words = descriptions()
    parts = []
    for name in shipped_names("robots"):
        robot = read_robot(name)[0]
        parts += [
            f"## {name}",
            "",
            f'<img src="../gallery/{name}.png" width="{_WIDTH}" '
            f'alt="{name}, drawn as lines with its rotors as discs">',
            "",
            f"{words[name][0].upper()}{words[name][1:]}.",
            "",
            facts(robot),
            "",
            "```sh",
            f"gibbs-codegen {COMMANDS.get(name, f'view {name}')}",
            "```",
            "",
        ]
    return "\n".join(parts)


def descriptions() -> dict[str, str]:
    """What the page of robot files says of each robot that ships."""
    rows = re.findall(r"^\| (`.*`) \| (.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: words for names, words in rows for name in re.findall(r"`(\w+)`", names)}


def facts(robot: Robot) -> str:
    """Mass, base, rotors, joints and constraints of a robot, in a sentence."""
    base, joints = robot.base, len(robot.moving)
    moving = LEVEL_MOTIONS.get(base.motion, base.motion) if not base.moves_freely else ()
    where = "The base flies freely" if base.moves_freely else "The base is fixed"
    if moving:
        where = f"Of the base {', '.join(moving)} move{'s' * (len(moving) == 1)}"
    counts = {"rotor": robot.rotors, "joint": joints, "constraint": len(robot.constraints)}
    parts = [f"{count} {what}{'s' * (count > 1)}" for what, count in counts.items() if count]
    return f"{where}. {robot.total_mass:.3g} kg, {', '.join(parts)}."


def picture(robot: Robot) -> Figure:
    """Draw a robot in its usual posture; one with constraints at zero, where they are met."""
    q = np.array(layout_of(robot).neutral) if robot.constraints else default_posture(robot)
    frames = robot_frames(robot, q)
    shapes = whole_shapes(robot, frames)
    with style():
        figure = Figure(figsize=_SIZE)
        axes = figure.add_subplot(projection="3d")
        set_scene(axes, box(shapes.outline()), ticks=5)
        hide_numbers(axes)
        RobotArtists(axes, shapes, scale=1.6)
        fit(axes, 0.02, 0.02, 0.96, 0.96)
        return figure


def box(places: Array) -> tuple[Array, Array]:
    """Lowest and highest coordinates of places, with room around, never flat."""
    low, high = places.min(axis=0), places.max(axis=0)
    most = (high - low).max()
    half = np.maximum(high - low, _THINNEST * most) / 2.0 + _ROOM * most
    return (low + high) / 2.0 - half, (low + high) / 2.0 + half


def write_pictures(app: Sphinx) -> None:
    """Write the pictures that the page embeds; they are drawn again after changes of the code."""
    if app.builder.format != "html":
        return
    kept, shown = Path(app.config.nb_execution_cache_path), Path(app.outdir, "gallery")
    shown.mkdir(parents=True, exist_ok=True)
    for name in shipped_names("robots"):
        path = kept / f"{name}.png"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            picture(read_robot(name)[0]).savefig(path, dpi=_DPI, metadata={"Software": None})
        (shown / path.name).write_bytes(path.read_bytes())


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write_pictures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
