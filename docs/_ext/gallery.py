"""The pictures of the gallery: `python docs/_ext/gallery.py` draws them in docs/_static/gallery."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

from gibbs_codegen.figures.machine import whole_shapes
from gibbs_codegen.figures.robot_artists import RobotArtists
from gibbs_codegen.figures.scene import project, set_scene
from gibbs_codegen.figures.style import style
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.posture import default_posture, robot_frames

FOLDER = Path(__file__).parent.parent / "_static" / "gallery"
# Angles of joints, rad, that show an arm better than the usual posture.
_UR5E = (0.6, -1.9, 1.9, -1.57, -1.57, 0.0)
POSTURES = {
    "cart_pole": (0.0, 0.35),
    "decarotor_3link": (-0.4, -0.9, 1.3),
    "hexarotor_3link": (-0.4, -0.9, 1.3),
    "hydrus": (1.3, 1.3, 1.3),
    "panda": (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785),
    "quadrotor_2link": (-0.4, -0.9),
    "rover_arm": _UR5E,
    "ur5e": _UR5E,
}
# Half lengths of the ground below what stands on it, as shares of the robot's size.
GROUND, RAIL = (0.3, 0.3), (0.6, 0.06)
_CORNERS = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
_ROOM = 0.05


def picture(robot: Robot) -> Figure:
    """Draw a robot as large as the picture allows; one with constraints at zero."""
    layout = layout_of(robot)
    q = np.array(layout.neutral) if robot.constraints else default_posture(robot)
    if robot.name in POSTURES:
        q[list(layout.q.joint_places)] = POSTURES[robot.name]
    shapes = whole_shapes(robot, robot_frames(robot, q))
    places = shapes.outline()
    middle, size = (places.min(axis=0) + places.max(axis=0)) / 2.0, np.ptp(places, axis=0).max()
    with style():
        figure = Figure(figsize=(3.2, 2.4))
        axes = figure.add_subplot(projection="3d")
        set_scene(axes, (middle - size / 2.0, middle + size / 2.0))
        axes.set_axis_off()
        if not (robot.base.moves_freely or robot.rotors):
            ground = size * _CORNERS * (*(RAIL if robot.name == "cart_pole" else GROUND), 0.0)
            plate = Poly3DCollection([ground], facecolor="0.9", edgecolor="0.7", zorder=1)
            axes.add_collection3d(plate, autolim=False)
            places = np.concatenate([places, ground])
        RobotArtists(axes, shapes, scale=1.8)
        axes.set_position((0, 0, 1, 1))
        axes.apply_aspect()
        figure.draw_without_rendering()
        pixels = axes.transData.transform(project(axes, places))
        drawn = figure.transFigure.inverted().transform(pixels)
        low, high = drawn.min(axis=0), drawn.max(axis=0)
        scale = (1.0 - 2.0 * _ROOM) / (high - low).max()
        axes.set_position((*(0.5 - scale * (low + high) / 2.0), scale, scale))
        return figure


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in shipped_names("robots"):
        drawn = BytesIO()
        picture(read_robot(name)[0]).savefig(drawn, dpi=150)
        # With 32 colours a picture takes a quarter of the room.
        few = Image.open(drawn).convert("RGB").quantize(32)
        few.save(FOLDER / f"{name}.png", optimize=True)
