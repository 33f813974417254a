"""A scenario: what is to be flown, from where, under which control, and how it is integrated."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.files.table import Place, Table, listed, needed, table
from gibbs_codegen.flight.scenario import parts
from gibbs_codegen.flight.scenario.numbers import JointName, Number, Positive
from gibbs_codegen.flight.scenario.orientation import AnyAttitude, Level, Turn
from gibbs_codegen.flight.scenario.paths import ORDERS, AnyPath, Array, Path
from gibbs_codegen.flight.scenario.walls import AnyWall

Limits = Annotated[
    tuple[Number, Number],
    listed(2),
    # In radians, too: what is next to nothing may become nothing there.
    needed(
        lambda limits: math.radians(limits[0]) < math.radians(limits[1]),
        "the lower limit must be below the upper",
    ),
]


def order_faults(moves: Sequence[parts.Move]) -> Iterator[tuple[Place, str]]:
    """The fault of moves of a joint of which one begins before the one before it has ended."""
    for place, (before, after) in enumerate(itertools.pairwise(moves), start=1):
        if after.begin < (end := before.begin + before.duration):
            words = f"must not be before {end:g}, when the move before it ends, not {after.begin:g}"
            yield (place, "begin"), words
            return


class ArmKeys:
    """Keys for the motion of an arm: in a scenario file some end in `_deg`."""

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of keys that say twice what the arm does, and of a guess without a tip path."""
        tips = [entry for entry in ("tip", "tip_beside_base", "tip_in_base") if entry in values]
        led = [*tips, *(["frames"] if "frames" in values else [])]
        postures = ("posture", "posture_deg", "moves", "moves_deg")
        others = [*tips[1:], *(entry for entry in postures if entry in values)]
        if led and others:
            yield others[0], f"{led[0]} already gives the motion of the arm; give one of them"
        for entry in ("guess", "guess_deg"):
            if entry in values and not led:
                yield entry, "starts the search for a tip path; give a tip"


@table
class ArmTask(ArmKeys, Table):
    """The task of the arm: bring the tip along a path, or keep a posture, or move from it.

    With a `tip` path the joints follow from it, from `guess` on (many postures are tried where
    there is none). Without one, `posture` is held; None is the posture in which the arm hangs at
    rest. `posture`, `guess` and `limits` map names of joint coordinates to rad or m, `effort` to
    the greatest torque or force (N m or N), `velocity` to the greatest rate (rad/s or m/s). A joint
    left out of `posture` is at 0; one left out of a limit has that of the robot file, if any.
    `frames` maps names of other frames to paths, which bases that lean lead with that of the tip.
    `moves` lists moves of joints from the posture on, one after the other for each joint.
    `named` has joints with the tables of the scenario file that name them, such as
    "posture_deg", so that faults of a robot's joints can be told as the file has them.
    """

    tip: AnyPath | None = None
    frames: Mapping[str, AnyPath] = field(default_factory=dict)
    posture: Mapping[JointName, Number] | None = None
    guess: Mapping[JointName, Number] | None = None
    limits: Mapping[JointName, Limits] = field(default_factory=dict)
    effort: Mapping[JointName, Positive] = field(default_factory=dict)
    velocity: Mapping[JointName, Positive] = field(default_factory=dict)
    named: frozenset[tuple[str, str]] = frozenset()
    moves: Mapping[JointName, Sequence[parts.Move]] = field(default_factory=dict)

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Faults of moves that overlap, and of a tip with two paths."""
        if self.tip and "tip" in self.frames:
            yield ("frames", "tip"), "tip already has its path; give one of them"
        for joint, moves in self.moves.items():
            for place, words in order_faults(moves):
                yield ("moves", joint, *place), words

    @property
    def paths(self) -> dict[str, Path]:
        """Paths of frames, by name, the tip's first."""
        return {**({"tip": self.tip} if self.tip else {}), **self.frames}


@table
class Scenario(Table):
    """A flight of `duration` s with the base centre on a path; SI units, rad, world axes.

    Without a path the base stays where coordinates are 0.

    Like its parts it raises `UsageError` for values that mean nothing.

    `parameters` are given to the module's `prepare`: the robot as the controller knows it. `plant`
    holds those that are others in the robot that flies.
    """

    name: str
    duration: Positive
    base: AnyPath | None = None
    attitude: AnyAttitude = Level()
    arm: ArmTask = ArmTask()
    start: parts.StartOffset = parts.StartOffset()
    control: parts.Control = parts.Control()
    motors: parts.Motors = parts.Motors()
    sensors: parts.Sensors | None = None
    push: parts.Push | None = None
    payloads: tuple[parts.Payload, ...] = ()
    wind: parts.Wind | None = None
    walls: tuple[AnyWall, ...] = ()
    holds: tuple[parts.Hold, ...] = ()
    integration: parts.Settings = parts.Settings()
    parameters: Mapping[str, Number] = field(default_factory=dict)
    plant: Mapping[str, Number] = field(default_factory=dict)
    timing: parts.Timing = parts.Timing()
    description: str = ""

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Faults of constraints that would hold after the end."""
        yield from parts.estimation_faults(self.control, self.sensors)
        for number, hold in enumerate(self.holds):
            for words in parts.late(hold, self.duration):
                yield ("holds", number, "begin"), words

    @property
    def is_sampled(self) -> bool:
        """True if its law acts at instants, and holds its inputs in between."""
        control = self.control
        is_slow = control.rate is not None or control.law == parts.PREDICTIVE
        return is_slow or control.estimate or (self.sensors is not None and self.sensors.observes)


# The time of a scenario and its first three derivatives (…, 4) at times (…) of the flight, s.
TimeScaling = Callable[[Array], Array]


@dataclass(frozen=True)
class ScaledPath:
    """A path that is followed by another clock."""

    path: Path
    scaling: TimeScaling

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        now, rate, growth, jerk = np.moveaxis(self.scaling(np.asarray(time, float)), -1, 0)
        place = self.path(now)
        rate, growth, jerk = (factor[..., np.newaxis] for factor in (rate, growth, jerk))
        first, second, third = (place[..., order, :] for order in range(1, ORDERS))
        out = np.empty_like(place)
        out[..., 0, :] = place[..., 0, :]
        out[..., 1, :] = first * rate
        out[..., 2, :] = second * rate**2 + first * growth
        out[..., 3, :] = third * rate**3 + 3.0 * second * rate * growth + first * jerk
        return out


@dataclass(frozen=True)
class ConstantScaling:
    """A clock that goes slower by a factor."""

    factor: float

    def __call__(self, time: Array) -> Array:
        """Time of the scenario and derivatives (…, 4) at times (…), s."""
        out = np.zeros((*np.shape(time), ORDERS))
        out[..., 0] = np.asarray(time) / self.factor
        out[..., 1] = 1.0 / self.factor
        return out


def on_clock(scenario: Scenario, duration: float, scaling: TimeScaling) -> Scenario:
    """A scenario whose paths are followed by another clock.

    Its new paths are not those that its attitude goes by.
    """
    tip = scenario.arm.tip and ScaledPath(scenario.arm.tip, scaling)
    frames = {name: ScaledPath(path, scaling) for name, path in scenario.arm.frames.items()}
    base = scenario.base and ScaledPath(scenario.base, scaling)
    arm = replace(scenario.arm, tip=tip, frames=frames)
    return replace(scenario, duration=duration, base=base, arm=arm)


def slow_motion(scenario: Scenario, factor: float) -> Scenario:
    """A scenario all motion of which takes longer by a factor; below 1 it is faster."""
    attitude = scenario.attitude
    if isinstance(attitude, Level):
        attitude = replace(attitude, rate=attitude.rate / factor)
    elif isinstance(attitude, Turn):
        attitude = replace(
            attitude, duration=factor * attitude.duration, begin=factor * attitude.begin
        )
    slower = on_clock(scenario, factor * scenario.duration, ConstantScaling(factor))
    moves = {
        joint: [
            replace(move, begin=factor * move.begin, duration=factor * move.duration)
            for move in joint_moves
        ]
        for joint, joint_moves in scenario.arm.moves.items()
    }
    return replace(slower, attitude=attitude, arm=replace(slower.arm, moves=moves))
