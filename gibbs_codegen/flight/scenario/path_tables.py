"""Tables that describe paths: `kind`, and what belongs to it."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
    model_validator,
)

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.table import (
    Table,
    Tables,
    at_most,
    by_kind,
    fault,
    needed,
    not_one_of,
    refusal,
)
from gibbs_codegen.flight.scenario.numbers import LEAST, NotNegative, Number, Positive, Vector
from gibbs_codegen.flight.scenario.paths import (
    WORDS,
    Circle,
    Fixed,
    Harmonic,
    Line,
    Path,
    Term,
    Waypoints,
    velocity_faults,
)

# A path that rests at both ends needs no more.
_FEWEST_POINTS = 2
_MOST_POINTS = 10_000
_MOST_TERMS = 100
_KIND = "the kind of path"
DIRECTION = needed(
    lambda vector: math.hypot(*vector) >= LEAST,
    "a direction of length zero; give at least one entry that is not 0",
)


def _not_endless(values: object) -> object:
    return at_most(values, _MOST_POINTS, "entries") if isinstance(values, list) else values


def _increasing(times: list[float]) -> list[float]:
    for place, (sooner, later) in enumerate(itertools.pairwise(times), start=1):
        if later <= sooner:
            raise refusal([((place,), f"must be after {sooner:g}, not {later:g}")])
    return times


class FixedTable(Table):
    """A point that stays where it is."""

    kind: Literal["fixed"] = Field(description=_KIND)
    position: Vector = Field(description="the point, [x, y, z] in m")

    def path(self) -> Path:
        """The path that the table describes."""
        return Fixed(self.position)


class TermTable(Table):
    """A term amplitude · e^(growth·t) · cos(frequency·t + phase)."""

    amplitude: Number = Field(description="the amplitude, in m")
    growth: Number = Field(default=0.0, description="rate of growth, 1/s; negative: a decay")
    frequency: Number = Field(default=0.0, description="angular frequency, rad/s")
    phase_deg: Number = Field(default=0.0, description="phase, degrees")

    def term(self) -> Term:
        """The term that the table describes."""
        return Term(self.amplitude, self.growth, self.frequency, math.radians(self.phase_deg))


class HarmonicTable(Table):
    """On each axis a sum of growing or decaying oscillations."""

    kind: Literal["harmonic"] = Field(description=_KIND)
    x: Annotated[list[TermTable], Tables("x", _MOST_TERMS, "terms")] = Field(
        default_factory=list, description="terms of the first coordinate"
    )
    y: Annotated[list[TermTable], Tables("y", _MOST_TERMS, "terms")] = Field(
        default_factory=list, description="terms of the second coordinate"
    )
    z: Annotated[list[TermTable], Tables("z", _MOST_TERMS, "terms")] = Field(
        default_factory=list, description="terms of the third coordinate"
    )

    def path(self) -> Path:
        """The path that the table describes."""
        return Harmonic(
            *(tuple(term.term() for term in terms) for terms in (self.x, self.y, self.z))
        )


class LineTable(Table):
    """A straight line with minimum jerk, at rest before and after."""

    kind: Literal["line"] = Field(description=_KIND)
    start: Vector = Field(description="where it begins, [x, y, z] in m")
    end: Vector = Field(description="where it ends, [x, y, z] in m")
    duration: Positive = Field(description="the time from start to end, in s")
    begin: Number = Field(default=0.0, description="when it begins, s")

    def path(self) -> Path:
        """The path that the table describes."""
        return Line(self.start, self.end, self.duration, self.begin)


class CircleTable(Table):
    """A circle at constant speed, anticlockwise about its normal."""

    kind: Literal["circle"] = Field(description=_KIND)
    centre: Vector = Field(description="the centre, [x, y, z] in m")
    radius: NotNegative = Field(description="the radius, in m")
    period: Annotated[Number, needed(lambda period: abs(period) >= LEAST, "must not be 0")] = Field(
        description="the time of a turn, in s; negative: the other way round"
    )
    normal: Annotated[Vector, DIRECTION] = Field(
        default=(0.0, 0.0, 1.0), description="direction of the axis, [x, y, z]"
    )
    phase_deg: Number = Field(default=0.0, description="angle at which it begins, degrees")

    def path(self) -> Path:
        """The path that the table describes."""
        phase = math.radians(self.phase_deg)
        return Circle(self.centre, self.radius, self.period, self.normal, phase)


def _velocity(value: object, vector: ValidatorFunctionWrapHandler) -> object:
    if isinstance(value, str):
        if value not in WORDS:
            raise fault(f"{not_one_of(value, WORDS)}; or a velocity [x, y, z] in m/s")
        return value
    return vector(value)


# A vector, or one of the words: each has its own faults told, which a union would mix.
_Velocity = Annotated[
    Vector,
    WrapValidator(_velocity),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(WORDS)},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]


class WaypointsTable(Table):
    """A smooth path through via points at given times, at rest or at a velocity where wanted."""

    kind: Literal["waypoints"] = Field(description=_KIND)
    times: Annotated[list[Number], BeforeValidator(_not_endless), AfterValidator(_increasing)] = (
        Field(description="a list of increasing times, s")
    )
    points: Annotated[list[Vector], BeforeValidator(_not_endless)] = Field(
        description="a list of points, [x, y, z] in m, one for each time"
    )
    velocities: Annotated[list[_Velocity], BeforeValidator(_not_endless)] | None = Field(
        default=None,
        description='for each point a velocity [x, y, z] in m/s, "rest" or "free"; default: at '
        "rest at both ends, and free between",
    )

    @model_validator(mode="before")
    @classmethod
    def _one_for_each(cls, values: Any) -> Any:
        times, points = values.get("times"), values.get("points")
        if isinstance(times, list) and isinstance(points, list):
            count = len(times)
            if len(points) != count or not _FEWEST_POINTS <= count <= _MOST_POINTS:
                words = (
                    f"{len(points)} points at {count} times; give as many of both, "
                    f"{_FEWEST_POINTS} to {_MOST_POINTS}"
                )
                raise refusal([(("points",), words)])
        return values

    @model_validator(mode="after")
    def _is_smooth(self) -> Self:
        faults = velocity_faults(self.points, self.velocities or [])
        if self.velocities is not None and (found := list(faults)):
            raise refusal([(("velocities", place), words) for place, words in found])
        try:
            self.path()
        except UsageError as error:
            raise refusal([(("times",), str(error))]) from None
        return self

    def path(self) -> Path:
        """The path that the table describes."""
        return Waypoints(self.times, self.points, self.velocities)


PathTable = Annotated[
    FixedTable | HarmonicTable | LineTable | CircleTable | WaypointsTable,
    by_kind(FixedTable, HarmonicTable, LineTable, CircleTable, WaypointsTable),
]
