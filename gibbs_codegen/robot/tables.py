"""The top table of a robot file, and the robot that it makes.

Its parts are in `robot/parts`; what names refer to is in `references`.
`docs/reference/robot-file.md` explains all keys at length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self

from pydantic import model_validator

from gibbs_codegen.files.table import Flag, InSchema, Place, Tables, refusal, rule
from gibbs_codegen.robot import model
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.names import NAME_PATTERN, name_fault
from gibbs_codegen.robot.parts.base import FIXED, PLANAR, ROD_KEYS, BaseTable
from gibbs_codegen.robot.parts.battery import Battery
from gibbs_codegen.robot.parts.frame import MAX_FRAMES, Frame, FrameTable
from gibbs_codegen.robot.parts.link import MAX_LINKS, LinkTable
from gibbs_codegen.robot.parts.numbers import BASE, NotNegative
from gibbs_codegen.robot.parts.part import Part, again, entry
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS, Rotor
from gibbs_codegen.robot.parts.ties import Ties
from gibbs_codegen.robot.parts.wheel import MAX_WHEELS, WheelTable
from gibbs_codegen.robot.references import body_numbers, reference_faults, tie_faults

# Heights that differ by less, m, are one.
_SAME_HEIGHT = 1e-6

Name = Annotated[str, rule(name_fault), InSchema({"type": "string", "pattern": NAME_PATTERN})]


@dataclass(frozen=True, kw_only=True)
class _Bodies(Part):
    """The keys of a robot file but for ties, which come last."""

    name: Name = entry("the robot's name, also the name of the module and the prefix in C", ...)
    gravity: NotNegative = again(model.Robot, "gravity")
    allow_impossible_inertia: Flag = entry(
        "whether to accept physically impossible inertias, which some published models have; a "
        "warning names the body",
        False,
    )
    base: BaseTable = entry("the flying base, [base]", ...)
    battery: Battery | None = entry("the battery, [battery]; default: none")
    rotor: Annotated[tuple[Rotor, ...], Tables("rotor", MAX_ROTORS, "rotors")] = entry(
        "rotors on the base or on links, instead of base.rotors", ()
    )
    link: Annotated[tuple[LinkTable, ...], Tables("link", MAX_LINKS, "links")] = entry(
        "the links, each after the one that carries it", ()
    )
    wheel: Annotated[tuple[WheelTable, ...], Tables("wheel", MAX_WHEELS, "wheels")] = entry(
        "the wheels of a planar base", ()
    )
    frame: Annotated[tuple[FrameTable, ...], Tables("frame", MAX_FRAMES, "frames")] = entry(
        "named frames on the base or on links", ()
    )


@dataclass(frozen=True, kw_only=True)
class RobotTable(Ties, _Bodies):
    """An aerial robot: a base, rotors, links that branch from the base as a tree, and frames.

    SI units: kg, m, s. Angles are in degrees, in keys that end in `_deg`.
    """

    title: ClassVar[str] = "Robot file of gibbs_codegen"
    mistaken: ClassVar[tuple[str, frozenset[str]]] = (
        "a scenario",
        frozenset({"duration", "control", "motors", "integration"}),
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
        """Faults of names and references, and of two forms of rotors at once."""
        base = values.get("base")
        rods = [key for key in ROD_KEYS if isinstance(base, dict) and key in base]
        if rods and values.get("rotor"):
            yield (
                ("rotor",),
                f"belongs to a base without arms, but base.{rods[0]} gives it arms with motors; "
                "give [[rotor]] tables, or base.rotors and base.arm",
            )
        rotors = values.get("rotor")
        if values.get("battery") is not None and isinstance(rotors, list):
            for i, rotor in enumerate(rotors):
                if isinstance(rotor, dict) and rotor.get("command") == "throttle":
                    for name in ("full_speed", "time_constant"):
                        if name not in rotor and f"{name}s" not in rotor:
                            words = f"missing: a throttle needs its {name} where there is a battery"
                            yield ("rotor", i, name), words
        yield from reference_faults(values)

    @model_validator(mode="after")
    def _has_mass(self) -> Self:
        if self.robot().total_mass <= 0:
            place = ("base", "arm") if self.base.arm else ("base",)
            raise refusal([(place, "the robot has no mass; give its base or links some")])
        return self

    @model_validator(mode="after")
    def _rolls(self) -> Self:
        base, faults = self.base, list[tuple[Place, str]]()
        if self.wheel and base.motion != PLANAR:
            faults.append((("base", "motion"), f'must be "{PLANAR}" for a robot with wheels'))
        if (self.wheel or base.drive) and any(base.rpy_deg or ()):
            words = "must be left out, because the base rolls on level ground"
            faults.append((("base", "rpy_deg"), words))
        for i, wheel in enumerate(self.wheel if base.drive else ()):
            if wheel.joint and (wheel.axis[0] or wheel.xyz[0]):
                words = "must be on the axle, the y axis of a base with a drive: y or -y, and x = 0"
                faults.append((("wheel", i, "axis" if wheel.axis[0] else "xyz"), words))
        lowest = [wheel.xyz[2] - wheel.radius for wheel in self.wheel]
        for i, height in enumerate(lowest):
            if abs(height - lowest[0]) > _SAME_HEIGHT:
                words = f"wheels touch level ground at z - radius, {height:g} m here and "
                words += f"{lowest[0]:g} m of wheel 1; give all the same"
                faults.append((("wheel", i, "xyz"), words))
        sides = {i: wheel.xyz[1] for i, wheel in enumerate(self.wheel) if wheel.joint}
        if base.drive and len(sides) > 1 and min(sides.values()) * max(sides.values()) > 0.0:
            words = "all wheels that turn are on one side: give one a y of the other sign"
            faults.append((("wheel", max(sides), "xyz"), words))
        if faults:
            raise refusal(faults)
        return self

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if self.base.motion == FIXED and not self.robot().moving:
            words = "the robot does not move; give it links with joints, or another motion"
            raise refusal([(("base", "motion"), words)])
        return self

    @model_validator(mode="after")
    def _ties_refer_to_frames(self) -> Self:
        if self.ties:
            robot = self.robot()
            bodies = {frame.name: robot.rigid[frame.on] for frame in frames_of(robot)}
            if faults := list(tie_faults(self.ties, bodies)):
                raise refusal(faults)
        return self

    def robot(self) -> model.Robot:
        """The robot that the file describes, as far as its names can be resolved."""
        numbers = body_numbers([x.name for x in self.link] + [x.name for x in self.wheel])

        def number(name: object) -> int:
            return numbers.get(str(name), BASE)

        parents = [numbers.get(str(link.parent), before) for before, link in enumerate(self.link)]
        return model.Robot(
            self.name,
            self.base.built(),
            tuple(
                replace(
                    link.link(),
                    parent=None if parent == before else parent,
                    gear=link.gear and link.gear.renumbered(number),
                )
                for before, (link, parent) in enumerate(zip(self.link, parents, strict=True))
            )
            + tuple(wheel.link() for wheel in self.wheel),
            self.gravity,
            tuple(replace(rotor, on=number(rotor.on)) for rotor in self.rotor),
            tuple(Frame(frame.name, number(frame.on), frame.whole_pose) for frame in self.frame),
            self.allow_impossible_inertia,
            self.battery,
            **self.by_kind,
        )
