"""The tables of a scenario file that say what the arm is to do and how fast paths are flown."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, WithJsonSchema, model_validator

from gibbs_codegen.files.table import IN_NAME, Place, Table, Tables, fault, listed, needed, refusal
from gibbs_codegen.flight.scenario.control import Thrusts
from gibbs_codegen.flight.scenario.numbers import NotNegative, Number, Positive
from gibbs_codegen.flight.scenario.path_tables import PathTable
from gibbs_codegen.flight.scenario.paths import Path, Sum
from gibbs_codegen.flight.scenario.scenario import ArmTask, Move
from gibbs_codegen.flight.scenario.timing import Timing, TimingLaw

# Names that entries of COORDINATES can have.
_JOINT_NAME = "[A-Za-z0-9_]{1,200}"
Limits = Annotated[
    tuple[Number, Number],
    listed(2),
    # In radians, too: what is next to nothing may become nothing there.
    needed(
        lambda limits: math.radians(limits[0]) < math.radians(limits[1]),
        "the lower limit must be below the upper",
    ),
]
_MOST_MOVES = 1000
# Tables of travels in m, which with _deg have angles in degrees.
_BOTH_UNITS = ("posture", "guess", "limits", "moves")
_FILE = "default: as the robot file has them"


def _joint_name(name: str) -> str:
    if re.fullmatch(_JOINT_NAME, name):
        return name
    raise fault("must be the name of a joint: of its coordinate, such as theta_7", IN_NAME)


JointName = Annotated[
    str,
    AfterValidator(_joint_name),
    WithJsonSchema({"type": "string", "pattern": f"^{_JOINT_NAME}$"}),
]


class MoveTable(Table):
    """A move of a joint from rest to rest, with minimum jerk."""

    to: Number = Field(description="where the joint moves, m or degrees")
    begin: NotNegative = Field(default=0.0, description="when the move begins, s")
    duration: Positive = Field(description="how long the move takes, s")


def _one_after_the_other(moves: list[MoveTable]) -> list[MoveTable]:
    if not moves:
        raise fault("has no moves; give one, or leave the joint out")
    for place, (before, after) in enumerate(itertools.pairwise(moves), start=1):
        if after.begin < (end := before.begin + before.duration):
            words = f"must not be before {end:g}, when the move before it ends, not {after.begin:g}"
            raise refusal([((place, "begin"), words)])
    return moves


Moves = Annotated[
    list[MoveTable],
    Tables("arm.moves", _MOST_MOVES, "moves", "a list of moves, [{ to = …, duration = … }]"),
    AfterValidator(_one_after_the_other),
]


class ArmTable(Table):
    """What the arm is to do: bring the tip along a path, or keep a posture, or move from it.

    Names of joints are those of their coordinates, such as theta_7 and d_8.
    """

    tip: PathTable | None = Field(default=None, description="desired path of the tip in the world")
    tip_beside_base: PathTable | None = Field(
        default=None, description="desired path of the tip from the base centre, world axes"
    )
    posture: dict[JointName, Number] | None = Field(
        default=None,
        description="travel that prismatic joints hold without a tip path, m; default 0",
    )
    posture_deg: dict[JointName, Number] | None = Field(
        default=None,
        description="angle that revolute joints hold without a tip path, degrees; default 0",
    )
    guess: dict[JointName, Number] | None = Field(
        default=None,
        description="travel of prismatic joints where the search for a tip path begins, m",
    )
    guess_deg: dict[JointName, Number] | None = Field(
        default=None,
        description="angle of revolute joints where the search for a tip path begins, degrees",
    )
    limits: dict[JointName, Limits] = Field(
        default_factory=dict,
        description=f"least and greatest travel of prismatic joints, m; {_FILE}",
    )
    limits_deg: dict[JointName, Limits] = Field(
        default_factory=dict,
        description=f"least and greatest angle of revolute joints, degrees; {_FILE}",
    )
    effort: dict[JointName, Positive] = Field(
        default_factory=dict, description=f"greatest torque or force of joints, N m or N; {_FILE}"
    )
    velocity: dict[JointName, Positive] = Field(
        default_factory=dict, description=f"greatest desired rate of joints, rad/s or m/s; {_FILE}"
    )

    moves: dict[JointName, Moves] = Field(
        default_factory=dict, description="moves of prismatic joints from the posture on, in m"
    )
    moves_deg: dict[JointName, Moves] = Field(
        default_factory=dict,
        description="moves of revolute joints from the posture on, in degrees",
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that say twice what the arm does, and of a guess without a tip path."""
        tips = [key for key in ("tip", "tip_beside_base") if key in values]
        postures = [
            key for key in ("posture", "posture_deg", "moves", "moves_deg") if key in values
        ]
        if tips and (others := [*tips[1:], *postures]):
            yield others[0], f"{tips[0]} already says what the arm does; give one of them"
        for key in ("guess", "guess_deg"):
            if key in values and not tips:
                yield key, "is where the search for a tip path begins; give a tip"

    @model_validator(mode="after")
    def _is_within_limits(self) -> Self:
        faults: list[tuple[Place, str]] = []
        for key in ("posture", "posture_deg"):
            limits = self.limits if key == "posture" else self.limits_deg
            for joint, value in (getattr(self, key) or {}).items():
                low, high = limits.get(joint, (-math.inf, math.inf))
                if not low <= value <= high:
                    words = f"must be within its limits, {low:g} to {high:g}, not {value:g}"
                    faults.append(((key, joint), words))
        for key in ("moves", "moves_deg"):
            limits = self.limits if key == "moves" else self.limits_deg
            for joint, moves in getattr(self, key).items():
                low, high = limits.get(joint, (-math.inf, math.inf))
                for place, move in enumerate(moves):
                    if not low <= move.to <= high:
                        words = f"must be within its limits, {low:g} to {high:g}, not {move.to:g}"
                        faults.append(((key, joint, place, "to"), words))
        if faults:
            raise refusal(faults)
        return self

    def late_moves(self, duration: float) -> list[tuple[Place, str]]:
        """Faults of moves that begin when the flight has ended."""
        words = f"must be before {duration:g}, when the flight ends, not "
        return [
            ((key, joint, place, "begin"), f"{words}{move.begin:g}")
            for key in ("moves", "moves_deg")
            for joint, moves in getattr(self, key).items()
            for place, move in enumerate(moves)
            if move.begin >= duration
        ]

    def task(self, base: Path) -> ArmTask:
        """The task that the table describes, its angles in rad; `base` is the base's path."""
        tip = self.tip.path() if self.tip else None
        if self.tip_beside_base:
            tip = Sum((base, self.tip_beside_base.path()))
        limits = {
            joint: (math.radians(low), math.radians(high))
            for joint, (low, high) in self.limits_deg.items()
        }
        tables = [f"{key}{end}" for key in _BOTH_UNITS for end in ("", "_deg")]
        named = [(joint, table) for table in tables for joint in getattr(self, table) or {}]
        return ArmTask(
            tip,
            _joint_values(self.posture, self.posture_deg),
            _joint_values(self.guess, self.guess_deg),
            self.limits | limits,
            self.effort,
            self.velocity,
            frozenset(named),
            {joint: [Move(**dict(move)) for move in moves] for joint, moves in self.moves.items()}
            | {
                joint: [Move(math.radians(move.to), move.begin, move.duration) for move in moves]
                for joint, moves in self.moves_deg.items()
            },
        )


def _joint_values(
    travels: Mapping[str, float] | None, angles_deg: Mapping[str, float] | None
) -> dict[str, float] | None:
    """Values of joints in m and rad; None where there is neither table."""
    if travels is None and angles_deg is None:
        return None
    angles = {joint: math.radians(angle) for joint, angle in (angles_deg or {}).items()}
    return {**(travels or {}), **angles}


class TimingTable(Table):
    """When the paths are flown: as they say, or as fast as limits allow."""

    law: TimingLaw = Field(
        default=Timing.law,
        description="uniform: the paths at their times; fastest: as fast as limits allow",
    )
    limits: Thrusts | None = Field(
        default=None,
        description="least and greatest thrust of the desired motion, N; default: of the motors",
    )
    thrust_rate: Positive | None = Field(
        default=None, description="greatest rate of every thrust, N/s; default: no limit"
    )
    effort: dict[JointName, Positive] = Field(
        default_factory=dict,
        description="greatest torque or force of joints, N m or N; default: of the arm",
    )
    velocity: dict[JointName, Positive] = Field(
        default_factory=dict,
        description="greatest desired rate of joints, rad/s or m/s; default: of the arm",
    )

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Shorter names."""
        return {"rate": "thrust_rate", "thrust": "limits", "torque": "effort"}

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of limits that nothing would keep."""
        if values.get("law", Timing.law) == "uniform":
            for key in ("limits", "thrust_rate", "effort", "velocity"):
                if key in values:
                    yield key, 'is a limit of the law "fastest"; with "uniform" leave it out'

    def timing(self) -> Timing:
        """The timing that the table describes."""
        return Timing(**dict(self))
