"""Scenario files: TOML text in, a checked `Scenario` out, or every fault of the file at once.

A key is one field with its description. Those of pushes, the base, the start and the integration
are here, with the top table; those of the arm and of timing in `arm_table`, of control and motors
in `control`, of sensors in `sensors`, of payloads, wind and walls in `environment`, of paths in
`path_tables`. Lengths are in m, times in s, angles in degrees where a key ends in `_deg`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from gibbs_codegen.errors import Fault, ScenarioFileError
from gibbs_codegen.files.changes import nested
from gibbs_codegen.files.shipped import shipped_names, text_of
from gibbs_codegen.files.table import Bounds, Place, Table, Tables, by_kind, needed, refusal
from gibbs_codegen.files.toml import checked
from gibbs_codegen.files.toml_text import TOO_DEEP
from gibbs_codegen.flight.scenario.arm_table import ArmTable, TimingTable
from gibbs_codegen.flight.scenario.control import ControlTable, MotorsTable
from gibbs_codegen.flight.scenario.environment import (
    MOST_PAYLOADS,
    MOST_WALLS,
    PayloadTable,
    WallTable,
    WindTable,
)
from gibbs_codegen.flight.scenario.numbers import NotNegative, Number, Positive, Vector
from gibbs_codegen.flight.scenario.orientation import Level, Tangent, Turn
from gibbs_codegen.flight.scenario.path_tables import DIRECTION, PathTable
from gibbs_codegen.flight.scenario.scenario import (
    MAX_DURATION,
    Method,
    Push,
    Scenario,
    Settings,
    StartOffset,
)
from gibbs_codegen.flight.scenario.sensors import SensorsTable
from gibbs_codegen.robot.model import MAX_ROTORS

_FOLDER = "scenarios"
_MIN_DURATION = 1e-3
_MAX_SAMPLES, _MAX_STEPS = 1_000_000, 100_000_000
_LONGEST_NAME = 200
_KIND = "the kind of attitude"


def shipped_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that ship with the package."""
    return shipped_names(_FOLDER)


def read_scenario(name_or_path: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario by file path, or by the name of one that ships.

    Refused files raise `ScenarioFileError`, and where there is none `UsageError` is raised.

    Args:
        name_or_path: The path or name.
        changes: What replaces entries of the file, in its own form:
            `{"start": {"offset": [0.2, 0, 0]}}`, or `{"start.offset": [0.2, 0, 0]}`; None removes
            an entry.

    Returns:
        The scenario.
    """
    text, source = text_of(name_or_path, _FOLDER, ScenarioFileError)
    return parse_scenario(text, source, changes)


def parse_scenario(
    text: str, source: str = "scenario", changes: Mapping[str, Any] | None = None
) -> Scenario:
    """Check a scenario file's text, with changes as of `read_scenario`.

    Raises `ScenarioFileError` with every fault found; `source` is the file's name in messages.
    """
    try:
        changes = nested(changes or {})
        return checked(text, source, ScenarioTable, ScenarioFileError, changes).scenario()
    except RecursionError:
        raise ScenarioFileError(source, [Fault("", TOO_DEEP)]) from None


class TipForceTable(Table):
    """A force on the tip for a time: what `push` was before it had a frame and a torque."""

    force: Vector = Field(description="[x, y, z] in N, world axes")
    begin: NotNegative = Field(default=0.0, description="when it begins, s")
    end: Number = Field(default=Push.end, description="when it ends, s")

    @model_validator(mode="after")
    def _ends_after_begin(self) -> Self:
        if self.end <= self.begin:
            raise refusal([(("end",), f"must be after begin, {self.begin:g} s")])
        return self

    def push(self) -> Push:
        """The push that the table describes."""
        return Push(**dict(self))


class PushTable(TipForceTable):
    """A force and a torque at a frame for a time."""

    frame: str = Field(
        default=Push.frame,
        description="the frame at whose origin they act: a name in the module's FRAMES, such as "
        "base, tip, or that of a [[frame]] of the robot file",
    )
    force: Vector = Field(default=Push.force, description="[x, y, z] in N, world axes")
    torque: Vector = Field(default=Push.torque, description="[x, y, z] in N m, world axes")

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """The fault of a push that pushes nothing."""
        if "force" not in values and "torque" not in values:
            yield "force", "missing: give a force, a torque, or both"


def _line_of_text(least: int) -> AfterValidator:
    return needed(
        lambda text: text.isprintable() and least <= len(text.strip()) <= _LONGEST_NAME,
        f"must be {least} to {_LONGEST_NAME} characters on one line",
    )


class LevelTable(Table):
    """The base level, with a heading that turns at a constant rate."""

    kind: Literal["level"] = Field(default="level", description=_KIND)
    heading_deg: Number = Field(default=0.0, description="heading at the start, degrees")
    rate_deg: Number = Field(default=0.0, description="rate of the heading, degrees per second")

    def attitude(self) -> Level:
        """The attitude that the table describes."""
        return Level(math.radians(self.heading_deg), math.radians(self.rate_deg))


class TurnTable(Table):
    """The base level at first, then turned about an axis, from rest to rest with minimum jerk."""

    kind: Literal["turn"] = Field(description=_KIND)
    axis: Annotated[Vector, DIRECTION] = Field(
        description="the axis that the base is turned about, in world axes"
    )
    angle_deg: Number = Field(description="how far it is turned, degrees; more than 360 is allowed")
    begin: NotNegative = Field(default=0.0, description="when the turn begins, s")
    duration: Positive = Field(description="how long the turn takes, s")
    heading_deg: Number = Field(default=0.0, description="heading before the turn, degrees")

    def attitude(self) -> Turn:
        """The attitude that the table describes."""
        angle, heading = math.radians(self.angle_deg), math.radians(self.heading_deg)
        return Turn(self.axis, angle, self.duration, self.begin, heading)


class TangentTable(Table):
    """A base arm along the path."""

    kind: Literal["tangent"] = Field(description=_KIND)
    arm: Annotated[int, Bounds(1, MAX_ROTORS)] = Field(
        default=Tangent.arm, description="number of the base arm that is tangent to the path"
    )

    def attitude(self) -> Tangent:
        """The attitude that the table describes."""
        return Tangent(self.arm)


class BaseTable(Table):
    """What the base is to do."""

    path: PathTable = Field(description="desired path of the base centre")
    attitude: Annotated[
        LevelTable | TurnTable | TangentTable,
        by_kind(LevelTable, TurnTable, TangentTable, default="level"),
    ] = Field(default_factory=LevelTable, description="desired attitude; default: level")


class StartTable(Table):
    """What is off at the start: deviation from the desired motion."""

    offset: Vector = Field(
        default=(0.0, 0.0, 0.0), description="deviation of the base centre, world axes, m"
    )
    turn_deg: Vector = Field(
        default=(0.0, 0.0, 0.0),
        description="deviation of the attitude: rotation vector, world axes, degrees",
    )

    def start(self) -> StartOffset:
        """The deviation that the table describes."""
        x, y, z = map(math.radians, self.turn_deg)
        return StartOffset(self.offset, (x, y, z))


class IntegrationTable(Table):
    """How the motion is integrated, and how much of it is kept."""

    method: Method = Field(
        default=Settings.method, description="steps that adapt, or of one length"
    )
    step: Annotated[Number, Bounds(1e-6)] = Field(
        default=Settings.step, description="greatest step of rk4, s"
    )
    # SciPy raises smaller ones to about this.
    relative_tolerance: Annotated[Number, Bounds(3e-14), Bounds(most=0.1)] = Field(
        default=Settings.relative_tolerance, description="relative tolerance of adaptive steps"
    )
    absolute_tolerance: Annotated[Number, Bounds(1e-16), Bounds(most=0.1)] = Field(
        default=Settings.absolute_tolerance,
        description="absolute tolerance of adaptive steps; m, rad, m/s and rad/s",
    )
    rate: Annotated[Number, Bounds(0.1)] = Field(
        default=Settings.rate, description="samples that are kept per second"
    )
    divergence: Positive = Field(
        default=Settings.divergence,
        description="deviation from the desired motion at which control counts as lost, m or rad",
    )


class ScenarioTable(Table):
    """A flight: desired paths, state at the start, control law and integration.

    Lengths in m, times in s, world axes. Angles are in degrees, in keys that end in `_deg`.
    """

    model_config = ConfigDict(title="Scenario file of gibbs_codegen")

    name: Annotated[str, _line_of_text(1)] = Field(description="name of the flight, on one line")
    description: Annotated[str, _line_of_text(0)] = Field(
        default="", description="what it is, on one line"
    )
    duration: Annotated[Number, Bounds(_MIN_DURATION, MAX_DURATION, " s")] = Field(
        description="the time to fly, in s"
    )
    base: BaseTable = Field(description="the base's desired path and attitude, [base]")
    arm: ArmTable = Field(
        default_factory=ArmTable, description="what the arm does; default: it hangs at rest"
    )
    start: StartTable = Field(
        default_factory=StartTable, description="deviation from the desired motion at the start"
    )
    control: ControlTable = Field(default_factory=ControlTable, description="the control law")
    motors: MotorsTable = Field(default_factory=MotorsTable, description="limits and lag of motors")
    sensors: SensorsTable | None = Field(
        default=None,
        description="noise and delay of what a sampled law observes; default: the state as it is",
    )
    push: PushTable | None = Field(
        default=None, description="a force and a torque at a frame; default: none"
    )
    tip_force: TipForceTable | None = Field(
        default=None, description="a force on the tip, as a push of the frame tip; default: none"
    )
    payload: Annotated[list[PayloadTable], Tables("payload", MOST_PAYLOADS, "payloads")] = Field(
        default_factory=list, description="point masses at frames, for a time; default: none"
    )
    wind: WindTable | None = Field(
        default=None, description="wind, and the drag of frames; default: none"
    )
    wall: Annotated[list[WallTable], Tables("wall", MOST_WALLS, "walls")] = Field(
        default_factory=list, description="planes that frames may lean on; default: none"
    )
    timing: TimingTable = Field(
        default_factory=TimingTable, description="how fast the paths are flown"
    )
    integration: IntegrationTable = Field(
        default_factory=IntegrationTable, description="method, tolerances and samples"
    )
    parameters: dict[str, Number] = Field(
        default_factory=dict, description="parameters of the module that are changed, SI units"
    )
    plant: dict[str, Number] = Field(
        default_factory=dict,
        description="parameters of the robot that flies where they differ from those of "
        "[parameters], which the controller knows, SI units",
    )

    @classmethod
    def mistaken(cls) -> tuple[str, frozenset[str]]:
        """Robot files, by keys of theirs."""
        return "a robot file", frozenset({"gravity", "link", "rotor", "frame"})

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """The fault of two pushes."""
        if "push" in values and "tip_force" in values:
            yield "tip_force", "must be left out, since push says what pushes the robot"

    @field_validator("arm")
    @classmethod
    def _moves_in_time(cls, table: ArmTable, info: ValidationInfo) -> ArmTable:
        if faults := table.late_moves(info.data.get("duration", math.inf)):
            raise refusal(faults)
        return table

    @field_validator("integration")
    @classmethod
    def _is_not_endless(cls, table: IntegrationTable, info: ValidationInfo) -> IntegrationTable:
        duration = info.data.get("duration", 0.0)
        faults = []
        if table.rate * duration > _MAX_SAMPLES:
            words = f"more than {_MAX_SAMPLES} samples in {duration:g} s; lower it"
            faults.append((("rate",), words))
        if table.method == "rk4" and duration / table.step > _MAX_STEPS:
            words = f"more than {_MAX_STEPS} steps in {duration:g} s; take longer ones"
            faults.append((("step",), words))
        if faults:
            raise refusal(faults)
        return table

    def scenario(self) -> Scenario:
        """The scenario that the file describes."""
        base, push = self.base.path.path(), self.push or self.tip_force
        return Scenario(
            name=self.name,
            duration=self.duration,
            base=base,
            attitude=self.base.attitude.attitude(),
            arm=self.arm.task(base),
            start=self.start.start(),
            control=self.control.control(),
            motors=self.motors.motors(),
            sensors=self.sensors.sensors() if self.sensors else None,
            push=push.push() if push else None,
            payloads=tuple(table.payload() for table in self.payload),
            wind=self.wind.wind() if self.wind else None,
            walls=tuple(table.wall() for table in self.wall),
            timing=self.timing.timing(),
            integration=Settings(**dict(self.integration)),
            parameters=self.parameters,
            plant=self.plant,
            description=self.description,
        )
