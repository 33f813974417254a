"""Figures of a robot's structure: the machine in 3-D and its open chains (the paper's Figs. 1–2).

They are drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch
from matplotlib.patheffects import withStroke

from gibbs_codegen.chains import Chain, decompose
from gibbs_codegen.coordinates import points
from gibbs_codegen.errors import UsageError
from gibbs_codegen.frames import Array, Frame, MachineFrames, machine_frames
from gibbs_codegen.robot import Robot
from gibbs_codegen.simulator.figure_style import DARK, FULL, GOLD, style
from gibbs_codegen.simulator.machine_drawing import VIEW, MachineDrawing, fit, project, set_scene

# Of the palette that DARK and GOLD are of.
THRUST, CONSTRAINT, TORQUE = "#cc79a7", "#d55e00", "#0072b2"
X_AXIS, Z_AXIS = "#0072b2", "#009e73"
_QUIET = "0.55"
_ARROWS = {
    THRUST: "thrust $F_k$",
    X_AXIS: "$x_i$, along the link",
    Z_AXIS: "$z_i$, axis of the joint",
}

# Chains that are drawn unless they are chosen, and links of an arm that are drawn one by one.
_MOST_CHAINS, _MOST_LINKS = 12, 4
_COLUMNS = 3
# Of the base arms' length: thrusts, frames' axes, and room around the base.
_ARROW, _AXIS = 0.75, 0.5
# Elevation from which thrusts along and across the base can be told apart, degrees.
_ELEVATION = 38.0
# Of names, in points: larger than the style's, since subscripts must be read on a screen.
_FONT_SIZE = 9
# Above all of a machine.
_LABELS = 100


@dataclass(frozen=True)
class _Still:
    """A machine that stands where its frames are, as a drawing wants it: one sample."""

    points: tuple[str, ...]
    positions: Array
    base_rotation: Array
    thrust_directions: Array
    rotors: int
    tangent_arm: int = 0

    def point(self, name: str) -> Array:
        return self.positions[:, self.points.index(name)]


def default_posture(robot: Robot) -> Array:
    """A configuration in which a machine shows its parts.

    The base is level, with the origin of the coordinates at the world's. Revolute joints are bent
    by 40°, each to the side that takes the tip down and away, prismatic ones stand at half of
    the longest link.
    """
    longest = max((link.body.length for link in robot.links), default=0.0)
    angles = np.deg2rad([-40.0, 40.0])
    q = np.zeros(6 + len(robot.links))
    for place, link in 2 * list(enumerate(robot.links, start=3)):
        values = angles if link.joint == "revolute" else [longest / 2.0]
        scores = []
        for q[place] in values:
            frames = machine_frames(robot, q)
            scores.append(frames.tip[2] - float(np.linalg.norm(frames.tip - frames.centre)))
        q[place] = values[int(np.argmin(np.round(scores, 9)))]
    return q


def machine_figure(robot: Robot, q: Sequence[float] | Array | None = None) -> Figure:
    """The machine at q (rad, m; `default_posture` if None) as in the paper's Fig. 1, in m.

    The whole of it stands on the left, the base enlarged on the right, with arm 2 in gold. Rotors
    are discs normal to their thrusts; x and z axes of the frames start at the joints. Raises
    `UsageError` where q has the wrong length.
    """
    frames = machine_frames(robot, default_posture(robot) if q is None else q)
    with style():
        figure = Figure(figsize=(FULL if robot.links else 0.6 * FULL, 3.9))
        figure.suptitle(robot.name, color="0.35", parse_math=False)
        if robot.links:
            _draw_whole(figure.add_subplot(1, 2, 1, projection="3d"), robot, frames)
        columns = 2 if robot.links else 1
        _draw_base(figure.add_subplot(1, columns, columns, projection="3d"), robot, frames)
        figure.legend(
            handles=[
                Line2D([], [], color=GOLD, lw=3, label="base arm 2"),
                *(_key(colour, label) for colour, label in _ARROWS.items()),
            ],
            loc="lower center",
            ncols=4,
        )
        # Makes the ticks while the style is ours.
        figure.draw_without_rendering()
        return figure


def _draw_whole(axes: Any, robot: Robot, frames: MachineFrames) -> None:
    """The whole machine, with the frames of the arm's links."""
    room = float(np.linalg.norm(frames.motors - frames.centre, axis=1).max())
    length = 0.13 * float(np.ptp(frames.points, axis=0).max())
    ends = [f.origin + length * axis for f in frames.links for axis in f.axes.T[::2]]
    set_scene(axes, _box(np.array([*frames.points, *ends]), 0.4 * room), ticks=5)
    MachineDrawing(axes, _still(robot, frames, points(robot)), colour="0.45", scale=1.3).show(0)
    fit(axes, 0.01, 0.07, 0.5, 0.86)
    for number, frame in enumerate(frames.links, start=robot.rotors + 1):
        _draw_frame(axes, frame, length, str(number))
    _name(axes, "$O_2$", frames.centre, (-7.0, 9.0))
    _name(axes, "tip", frames.tip, frames.tip - frames.links[-1].origin)
    for frame, after, number in zip(
        frames.links,
        [*(frame.origin for frame in frames.links[1:]), frames.tip],
        range(robot.rotors + 1, robot.rotors + len(robot.links) + 1),
        strict=True,
    ):
        if np.linalg.norm(after - frame.origin) > 0.5 * room:
            _number(axes, str(number), (frame.origin + after) / 2.0)


def _draw_base(axes: Any, robot: Robot, frames: MachineFrames) -> None:
    """The base, with numbers of its arms, their frames, and the thrusts."""
    arms = frames.motors - frames.centre
    reach = float(np.linalg.norm(arms, axis=1).max())
    ends = frames.motors + _ARROW * reach * frames.thrusts
    box = _box(np.concatenate([frames.motors, ends]), 0.25 * reach)
    set_scene(axes, box, (_ELEVATION, _azimuth_between(arms)), ticks=4)
    bare = tuple(name for name in points(robot) if not name.startswith("joint"))
    MachineDrawing(axes, _still(robot, frames, bare), scale=1.3).show(0)
    left, width = (0.53, 0.46) if robot.links else (0.02, 0.96)
    fit(axes, left, 0.07, width, 0.86)
    for k, (motor, end) in enumerate(zip(frames.motors, ends, strict=True), start=1):
        _arrow(axes, motor, end, THRUST, 1.6)
        _name(axes, f"$F_{{{k}}}$", end, end - motor, THRUST)
        _number(axes, str(k), 0.45 * frames.centre + 0.55 * motor)
    for frame in (frames.arm_1, *frames.base_arms):
        _arrow(axes, frame.origin, frame.point(_AXIS * reach), X_AXIS, 0.9)
    up = frames.centre + _AXIS * reach * frames.arm_1.axes[:, 2]
    _arrow(axes, frames.centre, up, Z_AXIS, 0.9)
    last = "" if robot.rotors == 2 else rf"\ldots z_{{{robot.rotors}}}"
    _name(axes, f"$z_2{last}$", up, up - frames.centre, Z_AXIS)
    _name(axes, "$O_1$", frames.motors[0], arms[0])
    _name(axes, "$O_2$", frames.centre, -frames.arm_1.axes[:, 2])


def _still(robot: Robot, frames: MachineFrames, names: tuple[str, ...]) -> _Still:
    """The machine with the points that are named; without joints its tip is the centre."""
    at = dict(zip(points(robot), frames.points, strict=True))
    if not any(name.startswith("joint") for name in names):
        at["tip"] = frames.centre
    return _Still(
        names,
        np.array([[at[name] for name in names]]),
        frames.arm_1.axes[np.newaxis],
        frames.thrusts @ frames.arm_1.axes,
        robot.rotors,
    )


def _box(places: Array, room: float) -> tuple[Array, Array]:
    """Lowest and highest coordinates of places with room around, never flat."""
    low, high = places.min(axis=0) - room, places.max(axis=0) + room
    half = np.maximum(high - low, 0.3 * float((high - low).max())) / 2.0
    return (low + high) / 2.0 - half, (low + high) / 2.0 + half


def _azimuth_between(arms: Array) -> float:
    """An azimuth, in degrees, from which no arm hides another: not along any, not half-way."""
    angles = np.degrees(np.arctan2(arms[:, 1], arms[:, 0])) + 0.6 * 360.0 / len(arms)
    off = (angles - VIEW[1] + 180.0) % 360.0 - 180.0
    return float(VIEW[1] + off[np.abs(off).argmin()])


def _draw_frame(axes: Any, frame: Frame, length: float, number: str) -> None:
    for place, (letter, colour) in {0: ("x", X_AXIS), 2: ("z", Z_AXIS)}.items():
        end = frame.origin + length * frame.axes[:, place]
        _arrow(axes, frame.origin, end, colour, 0.9)
        _name(axes, f"${letter}_{{{number}}}$", end, end - frame.origin, colour)


def _arrow(axes: Any, start: Array, end: Array, colour: str, width: float) -> None:
    """An arrow between two points of a scene."""
    axes.annotate(
        "",
        xy=project(axes, end),
        xytext=project(axes, start),
        arrowprops={
            "arrowstyle": "-|>,head_width=0.18,head_length=0.4",
            "color": colour,
            "lw": width,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=_LABELS,
    )


def _name(
    axes: Any, text: str, place: Array, away: Array | tuple[float, float], colour: str = DARK
) -> None:
    """A text beside a point of a scene: off in a direction of the scene, or by so many points."""
    step = np.array(away)
    if len(step) == 3:
        there = axes.transData.transform(project(axes, np.array([place, place + step])))
        step = there[1] - there[0]
        size = float(np.hypot(*step))
        step = 7.0 * (step / size if size > 1e-9 else np.array([0.0, 1.0]))
    axes.annotate(
        text,
        xy=project(axes, place),
        xytext=step,
        textcoords="offset points",
        color=colour,
        fontsize=_FONT_SIZE,
        horizontalalignment="center",
        verticalalignment="center",
        path_effects=[withStroke(linewidth=1.8, foreground="white")],
        zorder=_LABELS + 2,
    )


def _number(axes: Any, text: str, place: Array) -> None:
    """The number of an arm on it, in a circle."""
    axes.annotate(
        text,
        xy=project(axes, place),
        fontsize=7.5,
        horizontalalignment="center",
        verticalalignment="center",
        bbox={"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": DARK, "lw": 0.5},
        zorder=_LABELS + 1,
    )


def _key(colour: str, label: str) -> Line2D:
    return Line2D([], [], color=colour, lw=1.4, marker=">", markevery=[1], ms=3.5, label=label)


def chains_figure(robot: Robot, numbers: Iterable[int] | None = None) -> Figure:
    """The open chains of a robot side by side, as in the paper's Fig. 2 (eq. 1).

    A scheme in the plane of the base, seen from above: links of no length are drawn apart, base
    arms at their angles against arm 1, at most 150°, the manipulator laid flat. `numbers` chooses
    chains; up to twelve are drawn otherwise, of more rotors the first and last three. Raises
    `UsageError` where there is no such chain.
    """
    chains = decompose(robot)
    if numbers is None:
        ends = range(1, robot.rotors + 1)
        numbers = ends if robot.rotors <= _MOST_CHAINS else [*ends[:3], *ends[-3:]]
    chosen = list(numbers)
    if not chosen or not all(1 <= number <= robot.rotors for number in chosen):
        raise UsageError(f"{robot.name} has chains 1 to {robot.rotors}, not {chosen}")
    columns = 2 if len(chosen) == 4 else min(len(chosen), _COLUMNS)
    rows = -(-len(chosen) // columns)
    with style():
        figure = Figure(figsize=(FULL * columns / _COLUMNS, 1.85 * rows + 0.65))
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        figure.subplots_adjust(
            0.005, 0.55 / (1.85 * rows + 0.65), 0.995, 0.995, wspace=0.02, hspace=0.02
        )
        for axes, number in zip(panels, chosen, strict=False):
            _draw_chain(axes, robot, chains[number - 1])
        for axes in panels[len(chosen) :]:
            axes.set_axis_off()
        figure.legend(handles=_chain_keys(), loc="lower center", ncols=4 if columns > 1 else 2)
        return figure


def _draw_chain(axes: Axes, robot: Robot, chain: Chain) -> None:
    """One chain from its virtual links to its end."""
    j = chain.number
    axes.set_axis_off()
    axes.set(xlim=(-1.08, 2.42), ylim=(-1.3, 1.3), aspect="equal")
    axes.set_title(f"chain {j}", loc="left", x=0.03, y=0.88, pad=0)
    joints = np.array([[-0.9, 0.0], [-0.45, 0.0], [0.0, 0.0], [1.0, 0.0]])
    for start, number in zip(joints[:2], ("−1", "0"), strict=True):
        axes.plot(
            *np.array([start, start + _by(0.45, 0.0)]).T, color=_QUIET, lw=1.2, ls=(0, (2, 1.5))
        )
        _text(axes, number, start + _by(0.225, -0.13), _QUIET)
    _link(axes, joints[2], joints[3], "1", 1 in chain.massive and _has_mass(robot, 1))
    names = [f"$\\theta_{{{j},{item}}}$" for item in (1, 2, 3)]
    for place, text in zip(joints, names, strict=False):
        _joint(axes, place)
        _text(axes, text, place + _by(0.0, 0.17))
    _text(axes, "$O_1$", joints[2] + _by(0.0, -0.17), _QUIET)
    if 1 in chain.motors:
        _thrust(axes, joints[2], 0.0, robot.base.thrust[0], f"$F_{{{j},3}}$", _by(0.0, -0.36))
    if chain.is_constrained:
        _draw_base_arm(axes, robot, chain, joints[3])
    else:
        _draw_manipulator(axes, robot, chain, joints[3])


def _draw_base_arm(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """The base arm of a constrained chain, with its motor and the torque that holds it."""
    j, arm = chain.number, chain.links[-1]
    true = float(robot.base.arm_angle_deg(arm))
    angle = np.deg2rad(np.clip(true, -150.0, 150.0))
    along = np.array([np.cos(angle), np.sin(angle)])
    end = centre + along
    _link(axes, centre, end, str(arm), arm in chain.massive and _has_mass(robot, arm))
    _joint(axes, centre)
    _joint(axes, end)
    # Beside the joint, where neither arm is.
    aside = np.array([0.0, 1.0 if angle <= 0.0 else -1.0])
    degrees = f"{true:+.4g}".replace("-", "−").replace("+0", "0")
    _text(axes, f"$\\theta_{{{j},4}}$ = {degrees}°", centre + _by(0.42, 0.0) + 0.42 * aside)
    _turning(axes, centre, aside, CONSTRAINT)
    _text(axes, f"$\\tau'_{{{j},4}}$", centre + _by(-0.32, 0.0) + 0.34 * aside, CONSTRAINT)
    beside = _by(-0.12, 0.0) - 0.19 * aside if along[0] > -0.1 else _by(0.2, 0.0)
    _text(axes, "$O_2$", centre + beside, _QUIET)
    if arm in chain.motors:
        _thrust(axes, end, angle, robot.base.thrust[arm - 1], f"$F_{{{j},5}}$", 0.3 * along)


def _draw_manipulator(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """The links of the manipulator, laid flat in a zigzag, with the torques of its joints."""
    j, n = chain.number, len(robot.links)
    shown = list(range(n)) if n <= _MOST_LINKS else [*range(_MOST_LINKS - 1), n - 1]
    sizes = np.array([0.7 if robot.links[i].body.length else 0.5 for i in shown])
    slopes = np.deg2rad([(-70.0, 20.0)[step % 2] for step in range(len(shown))])
    steps = sizes[:, np.newaxis] * np.stack([np.cos(slopes), np.sin(slopes)], axis=1)
    gap = 0.25 if len(shown) < n else 0.0
    steps *= min(1.0, (1.1 - gap) / max(float(steps[:, 0].sum()), 1e-9))
    _text(axes, "$O_2$", centre + _by(-0.12, -0.18), _QUIET)
    place = centre
    for step, i in enumerate(shown):
        if i != step:
            _text(axes, "…", place + _by(gap / 2.0, 0.0))
            _joint(axes, place)
            place = place + _by(gap, 0.0)
        end = place + steps[step]
        number = chain.links[3 + i]
        _link(axes, place, end, str(number), _has_mass(robot, number))
        turns = robot.links[i].joint == "revolute"
        aside = np.array([0.0, 1.0 if step % 2 == 0 else -1.0])
        if turns:
            _turning(axes, place, aside, TORQUE)
        else:
            _pushing(axes, place + 0.2 * aside, 0.5 * steps[step], TORQUE)
        letter = "\\theta" if turns else "d"
        label = f"${letter}_{{{j},{4 + i}}}$, $\\tau_{{{j},{4 + i}}}$"
        _text(axes, label, place + _by(0.04 + 0.08 * step, 0.0) + 0.4 * aside)
        _joint(axes, place, "o" if turns else "s")
        place = end
    if n:
        _text(axes, "tip", place + _by(0.0, -0.18), _QUIET)
        _joint(axes, place)
    else:
        _joint(axes, centre)


def _has_mass(robot: Robot, arm: int) -> bool:
    """Whether an arm, by its number, has any mass at all."""
    if arm <= robot.rotors:
        return robot.base.arm(arm).total_mass > 0.0
    return robot.links[arm - robot.rotors - 1].body.total_mass > 0.0


def _link(axes: Axes, start: Array, end: Array, number: str, counts: bool) -> None:
    """A link as a bar, solid where its mass counts, with its number; arm 2 in gold."""
    ends = np.array([start, end]).T
    axes.plot(*ends, color=DARK, lw=5.0, solid_capstyle="round", zorder=3)
    inside = ("white" if not counts else GOLD) if not counts or number == "2" else DARK
    axes.plot(*ends, color=inside, lw=3.6, solid_capstyle="round", zorder=3)
    axes.annotate(
        number,
        xy=(float(ends[0].mean()), float(ends[1].mean())),
        fontsize=7.5,
        horizontalalignment="center",
        verticalalignment="center",
        bbox={"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": DARK, "lw": 0.5},
        zorder=4,
    )


def _joint(axes: Axes, place: Array, marker: str = "o") -> None:
    axes.plot(*place, marker, ms=4.5, mfc="white", mec=DARK, mew=0.8, zorder=5)


def _text(axes: Axes, text: str, place: Array, colour: str = DARK) -> None:
    axes.text(
        float(place[0]),
        float(place[1]),
        text,
        color=colour,
        fontsize=_FONT_SIZE,
        horizontalalignment="center",
        verticalalignment="center",
        path_effects=[withStroke(linewidth=1.5, foreground="white")],
        zorder=8,
    )


def _turning(axes: Axes, place: Array, aside: Array, colour: str) -> None:
    """A torque about a joint: an arc on its side `aside`, counter-clockwise."""
    side = 0.17 * np.array([aside[1], -aside[0]])
    start, end = place + side + 0.08 * aside, place - side + 0.08 * aside
    arrow = FancyArrowPatch(
        (float(start[0]), float(start[1])),
        (float(end[0]), float(end[1])),
        connectionstyle="arc3,rad=0.75",
        arrowstyle="-|>,head_width=1.6,head_length=2.8",
        color=colour,
        lw=1.2,
        shrinkA=0,
        shrinkB=0,
        zorder=6,
    )
    axes.add_patch(arrow)


def _pushing(axes: Axes, place: Array, step: Array, colour: str) -> None:
    """A force along a straight step."""
    axes.annotate(
        "",
        xy=(float(place[0] + step[0]), float(place[1] + step[1])),
        xytext=(float(place[0]), float(place[1])),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 2, "shrinkB": 0},
        zorder=6,
    )


def _thrust(
    axes: Axes, place: Array, angle: float, direction: Sequence[float], text: str, aside: Array
) -> None:
    """A thrust in the frame of an arm at an angle: towards the eye, in the plane, or both.

    Its name stands at the end of its arrow, or `aside` where it has none.
    """
    c, s = np.cos(angle), np.sin(angle)
    flat = np.array([[c, -s], [s, c]]) @ np.array(direction[:2])
    if abs(direction[2]) > 1e-9:
        # The tip of an arrow that comes, or the feathers of one that goes.
        axes.plot(*place, "o", ms=11, mfc="none", mec=THRUST, mew=1.3, zorder=6)
        axes.plot(*place, "." if direction[2] > 0 else "x", ms=5, color=THRUST, zorder=6)
    if np.hypot(*flat) > 1e-9:
        end = place + 0.42 * flat
        _pushing(axes, place, 0.42 * flat, THRUST)
        _text(axes, text, end + 0.14 * flat / np.hypot(*flat), THRUST)
    else:
        _text(axes, text, place + aside, THRUST)


def _by(x: float, y: float) -> Array:
    """A step in the plane of a chain."""
    return np.array([x, y])


def _chain_keys() -> list[Line2D]:
    """What the parts of a chain mean."""
    bar: dict[str, Any] = {
        "lw": 3.6,
        "path_effects": [withStroke(linewidth=5.0, foreground=DARK)],
    }
    circle: dict[str, Any] = {"ls": "", "mfc": "none", "mec": THRUST, "ms": 8, "mew": 1.3}
    return [
        Line2D([], [], color=_QUIET, lw=1.2, ls=(0, (2, 1.5)), label="virtual link"),
        Line2D([], [], color=DARK, label="mass counts here", **bar),
        Line2D([], [], color="white", label="no mass here", **bar),
        Line2D([], [], marker="o", label="thrust towards the eye", **circle),
        _key(THRUST, "thrust in the plane"),
        _key(CONSTRAINT, "constraint torque"),
        _key(TORQUE, "joint torque"),
    ]
