"""Scenario files: TOML text in, a checked `Scenario` out, or every fault of the file at once.

The tables of a file are the parts of a scenario themselves, in `parts`, `paths` and `orientation`,
with a field for each key. Here are those tables that a file has in another form: that of the base,
which has the path and the attitude, that of the arm, which gives travels and angles apart, and the
top table. Lengths are in m, times in s, angles in degrees where a key ends in `_deg`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator

from gibbs_codegen.errors import Fault, ScenarioFileError, UsageError, written
from gibbs_codegen.files.shipped import shipped_names, text_of
from gibbs_codegen.files.table import (
    Bounds,
    Place,
    Table,
    Tables,
    fault,
    file_table,
    key,
    needed,
    optional,
    refusal,
)
from gibbs_codegen.files.toml import TOO_DEEP, checked
from gibbs_codegen.flight.scenario import parts
from gibbs_codegen.flight.scenario.numbers import JointName, Number, Positive
from gibbs_codegen.flight.scenario.orientation import AnyAttitude, Carried, Level, Orientation
from gibbs_codegen.flight.scenario.paths import AnyPath, Path, Sum
from gibbs_codegen.flight.scenario.scenario import ArmKeys, ArmTask, Limits, Scenario, order_faults
from gibbs_codegen.flight.scenario.walls import AnyWall

_FOLDER = "scenarios"
_MIN_DURATION = 1e-3
_MAX_SAMPLES, _MAX_STEPS, _MAX_READINGS = 1_000_000, 100_000_000, 5_000_000
_LONGEST_NAME = 200
_FILE = "default: as the robot file has them"


def shipped_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that ship with the package."""
    return shipped_names(_FOLDER)


AnyScenario = Scenario | str | os.PathLike[str] | Mapping[str, Any]


def read_scenario(name_or_path: AnyScenario, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario by file path, or by the name of one that ships.

    Raises `ScenarioFileError` for a faulty file, and `UsageError` if there is none.

    Args:
        name_or_path: The path or name; or the tables of such a file as a dictionary. A
            `Scenario` is returned as it is.
        changes: What replaces entries of the file, in its own form:
            `{"start": {"offset": [0.2, 0, 0]}}`, or `{"start.offset": [0.2, 0, 0]}`; None removes
            an entry.

    Returns:
        The scenario.
    """
    if isinstance(name_or_path, Scenario) and not changes:
        return name_or_path
    if isinstance(name_or_path, Mapping):
        return parse_scenario("", changes=changes, tables=name_or_path)
    if not isinstance(name_or_path, str | os.PathLike):
        raise UsageError(
            "scenario: must be a scenario without changes, the name or path of a file, or its "
            f"tables in a dictionary, not {written(name_or_path)}"
        )
    text, source = text_of(os.fspath(name_or_path), _FOLDER, ScenarioFileError)
    return parse_scenario(text, source, changes)


def parse_scenario(
    text: str,
    source: str = "scenario",
    changes: Mapping[str, Any] | None = None,
    tables: Mapping[str, Any] | None = None,
) -> Scenario:
    """Check a scenario file's text, or its `tables`, with changes as of `read_scenario`.

    Raises `ScenarioFileError` with every fault found; `source` is the file's name in messages.
    """
    try:
        table = checked(text, source, ScenarioTable, ScenarioFileError, changes, tables)
        return table.scenario()
    except RecursionError:
        raise ScenarioFileError(source, [Fault("", TOO_DEEP)]) from None


def _one_after_the_other(moves: list[parts.Move]) -> list[parts.Move]:
    if not moves:
        raise fault("empty list of moves; give one, or leave the joint out")
    if faults := list(order_faults(moves)):
        raise refusal(faults)
    return moves


_Values = dict[JointName, Number] | None
_Moves = Annotated[
    list[parts.Move],
    Tables("arm.moves", 1000, "moves", "a list of moves, [{ to = …, duration = … }]"),
    AfterValidator(_one_after_the_other),
]


@file_table
class ArmTable(ArmKeys, Table):
    """The task of the arm: bring the tip along a path, or keep a posture, or move from it.

    Names of joints are those of their coordinates, such as theta_7 and d_8.
    """

    tip: AnyPath | None = optional("desired path of the tip in the world")
    frames: dict[str, AnyPath] = optional(
        "desired paths of other frames in the world, by name, where the base leans", dict
    )
    tip_beside_base: AnyPath | None = optional(
        "desired path of the tip from the base centre, world axes"
    )
    tip_in_base: AnyPath | None = optional(
        "desired path of the tip from the base centre, in axes that turn with a base on the ground"
    )
    posture: _Values = optional(
        "travel that prismatic joints hold without a tip path, m; default 0"
    )
    posture_deg: _Values = optional(
        "angle that revolute joints hold without a tip path, degrees; default 0"
    )
    guess: _Values = optional(
        "travel of prismatic joints where the search for a tip path begins, m"
    )
    guess_deg: _Values = optional(
        "angle of revolute joints where the search for a tip path begins, degrees"
    )
    limits: dict[JointName, Limits] = optional(
        f"least and greatest travel of prismatic joints, m; {_FILE}", dict
    )
    limits_deg: dict[JointName, Limits] = optional(
        f"least and greatest angle of revolute joints, degrees; {_FILE}", dict
    )
    effort: dict[JointName, Positive] = optional(
        f"greatest torque or force of joints, N m or N; {_FILE}", dict
    )
    velocity: dict[JointName, Positive] = optional(
        f"greatest desired rate of joints, rad/s or m/s; {_FILE}", dict
    )
    moves: dict[JointName, _Moves] = optional(
        "moves of prismatic joints from the posture on, in m", dict
    )
    moves_deg: dict[JointName, _Moves] = optional(
        "moves of revolute joints from the posture on, in degrees", dict
    )

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Faults of a tip with two paths, and of postures and moves beyond the limits."""
        if "tip" in self.frames and (self.tip or self.tip_beside_base or self.tip_in_base):
            yield ("frames", "tip"), "tip already has its path; give one of them"
        for end, limits in (("", self.limits), ("_deg", self.limits_deg)):
            postures, moves = (getattr(self, f"{entry}{end}") for entry in ("posture", "moves"))
            wanted: list[tuple[Place, float]] = [
                ((f"posture{end}", joint), value) for joint, value in (postures or {}).items()
            ]
            wanted += [
                ((f"moves{end}", joint, number, "to"), move.to)
                for joint, moves_of_joint in moves.items()
                for number, move in enumerate(moves_of_joint)
            ]
            for place, value in wanted:
                low, high = limits.get(str(place[1]), (-math.inf, math.inf))
                if not low <= value <= high:
                    yield place, f"must be within its limits, {low:g} to {high:g}, not {value:g}"

    def task(self, base: Path | None, attitude: Orientation) -> ArmTask:
        """The task that the table describes, its angles in rad; the base has a path, if any."""
        tip = self.tip
        if base and self.tip_beside_base:
            tip = Sum((base, self.tip_beside_base))
        if base and self.tip_in_base:
            tip = Carried(base, attitude, self.tip_in_base)
        tables = [f"{key}{end}" for key in _BOTH_UNITS for end in ("", "_deg")]
        named = [(joint, table) for table in tables for joint in getattr(self, table) or {}]
        values: dict[str, Any] = {}
        for entry in _BOTH_UNITS:
            travels, angles = getattr(self, entry), getattr(self, f"{entry}_deg")
            if travels is not None or angles is not None:
                values[entry] = {**(travels or {}), **_in_radians(angles or {})}
        return ArmTask(
            tip=tip,
            frames=self.frames,
            effort=self.effort,
            velocity=self.velocity,
            named=frozenset(named),
            **values,
        )


# Tables of travels in m, which with _deg have angles in degrees.
_BOTH_UNITS = ("posture", "guess", "limits", "moves")


def _in_radians(angles: Any) -> Any:
    """Angles, tables and tuples of them, and moves by them, with rad for degrees."""
    if isinstance(angles, Mapping):
        return {joint: _in_radians(angle) for joint, angle in angles.items()}
    if isinstance(angles, list | tuple):
        return type(angles)(map(_in_radians, angles))
    if isinstance(angles, parts.Move):
        return replace(angles, to=math.radians(angles.to))
    return math.radians(angles)


@file_table
class BaseTable(Table):
    """The task of the base."""

    path: AnyPath | None = optional(
        "desired path of the base centre in the world; default: it stays where coordinates are 0"
    )
    attitude: AnyAttitude = optional(
        "desired attitude, relative to its pose for a base that does not move freely; default: "
        "level",
        Level(),
    )


def _line_of_text(least: int) -> AfterValidator:
    return needed(
        lambda text: text.isprintable() and least <= len(text.strip()) <= _LONGEST_NAME,
        f"must be {least} to {_LONGEST_NAME} characters on one line",
    )


@file_table
class ScenarioTable(Table):
    """A flight: desired paths, state at the start, control law and integration.

    Lengths in m, times in s, world axes. Angles are in degrees, in keys that end in `_deg`.
    """

    title: ClassVar[str] = "Scenario file of gibbs_codegen"

    name: Annotated[str, _line_of_text(1), key("name of the flight, on one line")]
    description: Annotated[str, _line_of_text(0)] = optional("description, on one line", "")
    duration: Annotated[
        Number, Bounds(_MIN_DURATION, parts.MAX_DURATION, " s"), key("the time to fly, in s")
    ]
    base: BaseTable = optional("the base's desired path and attitude, [base]", BaseTable())
    arm: ArmTable = optional("motion of the arm; default: it hangs at rest", ArmTable())
    start: parts.StartOffset = optional(
        "deviation from the desired motion at the start", parts.StartOffset()
    )
    control: parts.Control = optional("the control law", parts.Control())
    motors: parts.Motors = optional("limits and lag of motors", parts.Motors())
    sensors: parts.Sensors | None = optional(
        "noise and delay of the observations of a sampled law; default: the exact state"
    )
    push: parts.Push | None = optional("a force and a torque at a frame; default: none")
    tip_force: parts.TipForce | None = optional(
        "a force on the tip, as a push of the frame tip; default: none"
    )
    payload: Annotated[tuple[parts.Payload, ...], Tables("payload", 20, "payloads")] = optional(
        "point masses at frames, for a time; default: none", ()
    )
    wind: parts.Wind | None = optional("wind, and the drag of frames; default: none")
    wall: Annotated[tuple[AnyWall, ...], Tables("wall", 20, "walls")] = optional(
        "walls that frames may lean on; default: none", ()
    )
    hold: Annotated[tuple[parts.Hold, ...], Tables("hold", 20, "constraints that hold")] = optional(
        "constraints of the robot that hold for a time; default: none", ()
    )
    timing: parts.Timing = optional("how fast the paths are flown", parts.Timing())
    integration: parts.Settings = optional("method, tolerances and samples", parts.Settings())
    parameters: dict[str, Number] = optional(
        "parameters of the module that are changed, SI units", dict
    )
    plant: dict[str, Number] = optional(
        "parameters of the real robot that differ from [parameters], which the controller "
        "knows, SI units",
        dict,
    )

    elsewhere: ClassVar[str] = "; parameters of the robot are keys of parameters, or of plant"
    mistaken: ClassVar[tuple[str, frozenset[str]]] = (
        "a robot file",
        frozenset({"gravity", "link", "rotor", "frame"}),
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of a push that pushes nothing, and of two pushes."""
        push = values.get("push")
        if isinstance(push, dict) and not push.keys() & {"force", "torque"}:
            yield ("push", "force"), "missing: give a force, a torque, or both"
        if "push" in values and "tip_force" in values:
            yield "tip_force", "must be left out, because push already pushes the robot"

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Faults of what begins after the end, and of more samples or steps than may be."""
        duration, settings = self.duration, self.integration
        for tip in ("tip_beside_base", "tip_in_base"):
            if getattr(self.arm, tip) and not self.base.path:
                words = "give base.path, or a path in the world, arm.tip"
                yield ("arm", tip), f"is relative to the path of the base; {words}"
        yield from parts.estimation_faults(self.control, self.sensors)
        beginning: list[tuple[Place, Sequence[parts.Move | parts.Hold]]] = [(("hold",), self.hold)]
        for name in ("moves", "moves_deg"):
            moves = getattr(self.arm, name).items()
            beginning += [(("arm", name, joint), joint_moves) for joint, joint_moves in moves]
        for place, timed_parts in beginning:
            for number, part in enumerate(timed_parts):
                for words in parts.late(part, duration):
                    yield (*place, number, "begin"), words
        for kind in parts.DEVICES if self.sensors else ():
            for number, name in enumerate(getattr(self.sensors, kind)):
                if name.rate * duration > _MAX_READINGS:
                    words = f"more than {_MAX_READINGS} readings in {duration:g} s; lower it"
                    yield ("sensors", kind, number, "rate"), words
        if settings.rate * duration > _MAX_SAMPLES:
            words = f"more than {_MAX_SAMPLES} samples in {duration:g} s; lower it"
            yield ("integration", "rate"), words
        if settings.method == "rk4" and duration / settings.step > _MAX_STEPS:
            words = f"more than {_MAX_STEPS} steps in {duration:g} s; take longer ones"
            yield ("integration", "step"), words

    def scenario(self) -> Scenario:
        """The scenario that the file describes: keys are fields but for those that are named."""
        values = dict(vars(self))
        base, arm, push, tip_force, payloads, walls, holds = map(
            values.pop, ("base", "arm", "push", "tip_force", "payload", "wall", "hold")
        )
        return Scenario(
            base=base.path,
            attitude=base.attitude,
            arm=arm.task(base.path, base.attitude),
            push=push or (parts.Push(**vars(tip_force)) if tip_force else None),
            payloads=payloads,
            walls=walls,
            holds=holds,
            **values,
        )
