"""Gears, by which one coordinate moves several joints, or several move one, and wheels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import pydantic
from pydantic_core import CoreSchema, core_schema

from gibbs_codegen.files.table import Place, fault, to_python
from gibbs_codegen.robot.parts.numbers import Label, Positive, Size
from gibbs_codegen.robot.parts.part import Part, entry, sized


@dataclass(frozen=True)
class _OrSeveral:
    """Metadata of a tuple of any length, in place of which a file may have one entry of it."""

    kind: Any

    def __get_pydantic_core_schema__(
        self, _: Any, handler: pydantic.GetCoreSchemaHandler
    ) -> CoreSchema:
        several = handler.generate_schema(self.kind)
        return core_schema.no_info_wrap_validator_function(self._checked, several)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: pydantic.GetJsonSchemaHandler
    ) -> Any:
        several = handler(schema)
        return {"anyOf": [several["items"], several | {"minItems": 1}]}

    @staticmethod
    def _checked(value: Any, handler: Callable[[Any], Any]) -> Any:
        if isinstance(to_python(value), list):
            return handler(value)
        try:
            return handler([value])[0]
        except pydantic.ValidationError as error:
            raise fault(Part._words(error.errors(include_url=False)[0])) from None


@dataclass(frozen=True, kw_only=True)
class Gear(Part):
    """The gear of a joint, whose coordinate is Σ ratio·(that of another joint) + offset.

    Its numbers are structural, as twists are: teeth are counted, and a ratio of −1 is a sign.
    """

    # A file names links; once the robot is whole, they are numbers.
    of: Annotated[int | tuple[int, ...], _OrSeveral(tuple[Label, ...])] = entry(
        "name of the link whose joint moves this one, or several names, of a differential", ...
    )
    ratio: Annotated[float | tuple[float, ...], _OrSeveral(tuple[Size, ...])] = entry(
        "motion of this joint for each rad or m of the other, rad or m; negative: the other "
        "way; one ratio for each name",
        ...,
    )
    offset: Size = entry("coordinate of this joint where the others' are 0, rad or m", 0.0)

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of a joint that would not move, or of numbers that do not fit."""
        movers, ratios = map(_several, (self.of, self.ratio))
        if 0.0 in ratios:
            yield (
                ("ratio",),
                'must not be 0, or the joint would not move; give joint = "fixed" for that',
            )
        if not movers:
            yield ("of",), "must have the name of a link whose joint moves this one"
        elif len(movers) != len(ratios):
            yield ("ratio",), f"must have a ratio for each name in of, {len(movers)}"
        if len({*movers}) < len(movers):
            yield ("of",), "has a name twice; give it once, with the sum of the ratios"

    @classmethod
    def by(cls, ratios: Mapping[int, float], offset: float = 0.0) -> Gear:
        """A gear by the ratios of each of what moves it."""
        if len(ratios) == 1:
            ((mover, ratio),) = ratios.items()
            return cls(of=mover, ratio=ratio, offset=offset)
        return cls(of=(*ratios,), ratio=(*ratios.values(),), offset=offset)

    @property
    def ratios(self) -> dict[int, float]:
        """The ratios by the movers."""
        return dict(zip(_several(self.of), _several(self.ratio), strict=False))

    def renumbered(self, number: Callable[[Any], int]) -> Gear:
        """The gear with other names of what moves it."""
        return Gear.by({number(x): ratio for x, ratio in self.ratios.items()}, self.offset)

    def after(self, gears: Mapping[int, Gear]) -> Gear:
        """The gears as one, of which `gears` move the joints, by numbers, that this one is of."""
        offset, ratios = self.offset, dict[int, float]()
        for mover, ratio in self.ratios.items():
            offset += ratio * gears[mover].offset
            for first, share in gears[mover].ratios.items():
                ratios[first] = ratios.get(first, 0.0) + ratio * share
        return Gear.by(ratios, offset)


def gear_terms(ratios: Mapping[str, float], offset: float) -> str:
    """The coordinate of a gear's joint in words, by the names of its movers."""
    terms = [f"{ratio:.6g} × {mover}" for mover, ratio in ratios.items()]
    return " + ".join([*terms, f"{offset:.6g}"] if offset else terms).replace("+ -", "- ")


def _several(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


@dataclass(frozen=True, kw_only=True)
class Rolling(Part):
    """The ground as the gear of a wheel on the base: its rate is the base's speed ahead/radius."""

    radius: Positive = sized("radius of the wheel, {m}", ...)
