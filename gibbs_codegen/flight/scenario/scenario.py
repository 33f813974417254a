"""A scenario: what is to be flown, from where, under which control, and how it is integrated."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.control import Control, Motors
from gibbs_codegen.flight.scenario.environment import Payload, Wall, Wind
from gibbs_codegen.flight.scenario.numbers import require
from gibbs_codegen.flight.scenario.orientation import Level, Tangent, Turn
from gibbs_codegen.flight.scenario.paths import Path, Vector
from gibbs_codegen.flight.scenario.sensors import Sensors
from gibbs_codegen.flight.scenario.timing import Timing

Method = Literal["adaptive", "rk4"]

MAX_DURATION = 3600.0  # s


@dataclass(frozen=True)
class Move:
    """A move of a joint to a value, rad or m, from rest to rest with minimum jerk; times in s."""

    to: float
    begin: float
    duration: float

    def __post_init__(self) -> None:
        require(math.isfinite(self.to), "arm: a move is to a finite value")
        require(0.0 <= self.begin < math.inf, "arm: a move begins at 0 s or later")
        require(0.0 < self.duration < math.inf, "arm: a move takes more than 0 s")


@dataclass(frozen=True)
class ArmTask:
    """What the arm is to do: bring the tip along a path, or keep a posture, or move from it.

    With a `tip` path the joints follow from it, from `guess` on (many postures are tried where
    there is none). Without one, `posture` is held; None is the posture in which the arm hangs at
    rest. `posture`, `guess` and `limits` map names of joint coordinates to rad or m, `effort` to
    the greatest torque or force (N m or N), `velocity` to the greatest rate (rad/s or m/s). A joint
    left out of `posture` is at 0; one left out of a limit has that of the robot file, if any.
    `moves` lists moves of joints from the posture on, one after the other for each joint.
    `named` has joints with the tables of the scenario file that name them, such as
    "posture_deg", so that faults of a robot's joints can be told as the file has them.
    """

    tip: Path | None = None
    posture: Mapping[str, float] | None = None
    guess: Mapping[str, float] | None = None
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    effort: Mapping[str, float] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)
    named: frozenset[tuple[str, str]] = frozenset()
    moves: Mapping[str, Sequence[Move]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.tip is not None and self.posture is not None:
            raise UsageError("arm: a tip path and a posture: give one of them")
        if self.tip is None and self.guess is not None:
            raise UsageError("arm: a guess is where the search for a tip path begins; give a tip")
        require(self.tip is None or not self.moves, "arm: a tip path and moves: give one of them")
        for joint, moves in self.moves.items():
            for before, after in itertools.pairwise(moves):
                require(
                    after.begin >= before.begin + before.duration,
                    f"arm: moves of {joint}: one begins before the one before it ends",
                )
        for joint, (low, high) in self.limits.items():
            require(low < high, f"arm: limits of {joint}: the lower must be below the upper")
        for key in ("effort", "velocity"):
            for joint, most in getattr(self, key).items():
                require(most > 0.0, f"arm: {key} of {joint}: must be above 0")


@dataclass(frozen=True)
class StartOffset:
    """What is off at the start: base centre, m; attitude, a rotation vector, rad; world axes."""

    position: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Settings:
    """How to integrate: method, tolerances of "adaptive", greatest step of "rk4" (s).

    `rate` samples a second are kept, at whole multiples of 1 / rate, and the last instant.
    Tolerances are 1e-6 and 1e-7 at least while thrusts are at their limits. A coordinate that is
    `divergence` (rad or m) off its desired value, or has a rate that would carry it as far off even
    under control, ends the flight, unless nothing is controlled.
    """

    method: Method = "adaptive"
    step: float = 1e-3
    relative_tolerance: float = 1e-10
    absolute_tolerance: float = 1e-11
    rate: float = 100.0
    divergence: float = 20.0


@dataclass(frozen=True)
class Push:
    """A force, N, and a torque, N m, at the origin of a frame, from time `begin` to `end`, s.

    Both are in world axes. `frame` is one of the FRAMES of the robot's module.
    """

    force: Vector = (0.0, 0.0, 0.0)
    begin: float = 0.0
    end: float = MAX_DURATION
    torque: Vector = (0.0, 0.0, 0.0)
    frame: str = "tip"


@dataclass(frozen=True)
class Scenario:
    """A flight of `duration` s with the base centre on a path; SI units, rad, world axes.

    Like its parts it raises `UsageError` for values that mean nothing.

    `parameters` are given to the module's `prepare`: the robot as the controller knows it. `plant`
    holds those that are others in the robot that flies.
    """

    name: str
    duration: float
    base: Path
    attitude: Level | Turn | Tangent = field(default_factory=Level)
    arm: ArmTask = ArmTask()
    start: StartOffset = StartOffset()
    control: Control = field(default_factory=Control)
    motors: Motors = field(default_factory=Motors)
    sensors: Sensors | None = None
    push: Push | None = None
    payloads: tuple[Payload, ...] = ()
    wind: Wind | None = None
    walls: tuple[Wall, ...] = ()
    integration: Settings = field(default_factory=Settings)
    parameters: Mapping[str, float] = field(default_factory=dict)
    plant: Mapping[str, float] = field(default_factory=dict)
    timing: Timing = field(default_factory=Timing)
    description: str = ""

    def __post_init__(self) -> None:
        require(0.0 < self.duration < math.inf, f"duration: above 0 s, not {self.duration}")
