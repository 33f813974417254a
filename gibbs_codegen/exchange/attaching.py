"""An arm joined to a drone, each a robot of its own before, whatever its file was.

What the arm has as its base becomes part of the body that carries it. The reader of the new file
rejects a name that both have; a prefix to the arm's names tells them apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError, near, printable
from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.exchange.sources import Finding, quiet_pose
from gibbs_codegen.exchange.welding import composite
from gibbs_codegen.robot.file import read_robot, shipped_robots
from gibbs_codegen.robot.layout import frames_of, has_default_tip
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import default_prefix, name_from
from gibbs_codegen.robot.parts.body import Body, RigidBody, as_rigid_body
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.parts.ties import Tie
from gibbs_codegen.robot.placement import joint_pose
from gibbs_codegen.robot.references import body_numbers


@dataclass(frozen=True)
class Attachment:
    """The file of an arm, and where it goes: `pose` of its root in the frame of a link or frame.

    `prefix` comes before the names of all that it brings.
    """

    file: Path
    on: str = "base"
    pose: Pose = HERE
    prefix: str = ""


def is_robot_file(path: Path) -> bool:
    """True if a path is that of a robot file, or the name of a robot that ships."""
    return path.suffix.lower() == ".toml" or (not path.exists() and str(path) in shipped_robots())


def joined(
    path: Path, options: ImportOptions, attachments: Sequence[Attachment]
) -> tuple[Robot, list[Finding]]:
    """A drone with arms, each of a robot file or of what `import_robot` reads, and what was done.

    `options` are of the drone where it is imported, those that say nothing of names hold for arms.
    Raises `RobotFileError`, `SourceFileError` or `UsageError` as readers do, and the last for what
    carries an arm and is not there.
    """
    robot, findings = _read(path, options)
    if attachments and robot.links:  # With another arm the end of its own may be no tip any more.
        robot = replace(robot, frames=frames_of(robot)[1:])
    for new in attachments:
        arm, lines = _read(new.file, ImportOptions(options.attitude, snap=options.snap))
        root = next(line.subject for line in lines if line.kind == "base")
        base = next(line.subject for line in findings if line.kind == "base")
        carrier, seat = _seat(robot, base, new.on)
        robot = _with_arm(robot, arm, carrier, seat @ new.pose, new.prefix, root, options.snap)
        words = f"root {root} of {new.file.name} on {new.on}"
        if not arm.base.moves_freely:
            words += ", instead of the motion and the pose of its base"
        findings.append(Finding("attached", arm.name, words))
        # The arm does not fly, and needs no rotors.
        of_drones = ("base", root), ("note", "rotors")
        findings += [line for line in lines if (line.kind, line.subject) not in of_drones]
    return robot, findings


def _read(path: Path, options: ImportOptions) -> tuple[Robot, list[Finding]]:
    if not is_robot_file(path):
        return import_robot(path, options)
    robot, _ = read_robot(str(path))
    return robot, [Finding("base", robot.name, "the base of a robot file")]


def _seat(drone: Robot, root: str, on: str) -> tuple[int, Pose]:
    """The number of the body, and the frame in its own, that a name of a link or frame stands for.

    A frame goes before a link of the same name: imported robots keep frames of links that are not
    at their joints as such. `root` is another name of the base.
    """
    for frame in drone.frames:
        if frame.name == on:
            return frame.on, frame.pose
    numbers = {root: BASE} | body_numbers([link.name for link in drone.links])
    if on not in numbers:
        names = [*numbers, *(frame.name for frame in drone.frames)]
        raise UsageError(f"--on {printable(on, 60)}: no such link or frame{near(on, names)}")
    return numbers[on], HERE


def _with_arm(
    drone: Robot, arm: Robot, carrier: int, pose: Pose, prefix: str, root: str, snap: bool
) -> Robot:
    """The drone with an arm whose base is at a pose in the frame of body `carrier`."""
    if arm.base.rotors:
        raise UsageError(
            f"--attach: {arm.name} has a base of rods with motors, which an arm cannot have; "
            "give [base] mass, com and inertia instead"
        )
    count = len(drone.links)

    def on(body: int) -> int:
        return carrier if body == BASE else count + body

    def seated(inner: Pose, body: int) -> Pose:
        """In the frame of what carries it now, where it was in that of a body of the arm."""
        return quiet_pose(pose @ inner if body == BASE else inner, snap)

    def link(i: int) -> Link:
        link, parent = arm.links[i - 1], arm.parents[i - 1]
        label = link.name or (default_prefix("link", i) if prefix else "")
        return replace(
            link,
            parent=on(parent),
            gear=link.gear and link.gear.renumbered(on),
            name=prefix + label or None,
            coordinate=link.coordinate and prefix + link.coordinate,
            pose=link.pose if parent != BASE else seated(joint_pose(arm, i), BASE),
        )

    frames = [*drone.frames, Frame(prefix + root, carrier, seated(HERE, BASE))]
    brought = _frames(arm)
    frames += [Frame(prefix + f.name, on(f.on), seated(f.pose, f.on)) for f in brought]
    # The base's own frame is that of the root.
    named = {"base": prefix + root} | {f.name: prefix + f.name for f in brought}

    def tied(tie: Tie) -> Tie:
        ends: dict[str, Any] = {"frame": named[tie.frame], "to": tie.to and named[tie.to]}
        return replace(tie, name=prefix + tie.name, **ends)

    rotors = [
        replace(
            rotor,
            on=on(rotor.on),
            name=rotor.name and prefix + rotor.name,
            position=seated(Pose(rotor.position), rotor.on).xyz,
            direction=vector(pose.matrix @ np.array(rotor.direction))
            if rotor.on == BASE
            else rotor.direction,
        )
        for rotor in arm.thrusters
    ]
    links = [*drone.links, *(link(i) for i in range(1, len(arm.links) + 1))]
    base = drone.base
    if (root_body := arm.base.body) is not None:
        if carrier == BASE:
            base = replace(base, body=_welded(base.body, root_body, pose, snap))
        else:
            body = _welded(links[carrier - 1].body, root_body, pose, snap)
            links[carrier - 1] = replace(links[carrier - 1], body=body)
    return replace(
        drone,
        name=name_from(f"{drone.name}_{arm.name}"),
        base=base,
        links=tuple(links),
        thrusters=(*drone.thrusters, *rotors),
        frames=tuple(frames),
        **{kind: drone.by_kind[kind] + ties for kind, ties in arm.mapped(tied).items()},
        allow_impossible_inertia=drone.allow_impossible_inertia or arm.allow_impossible_inertia,
    )


def _frames(arm: Robot) -> list[Frame]:
    """Frames of an arm but its base's, with the tip at what is farthest behind the last joint."""
    _, *frames = frames_of(arm)
    last = len(arm.links)
    behind = [f for f in arm.frames if f.on == last]
    if last and has_default_tip(arm) and behind and not arm.links[-1].body.length:
        frames[0] = replace(max(behind, key=lambda f: math.hypot(*f.pose.xyz)), name="tip")
    return frames


def _welded(body: Body | None, added: RigidBody, pose: Pose, snap: bool) -> RigidBody:
    """A body with another welded to it at a pose in its frame."""
    carrier = [] if body is None else [(as_rigid_body(body), HERE)]
    whole = composite([*carrier, (added, pose)], snap)
    return whole if body is None else replace(whole, length=body.length)
