"""The top table of a robot file: what each key may hold, and the robot that they make.

A key is one field with its description. The other tables are in `base_table`, `link_table`,
`placed_tables` and `body_tables`, the names in `references`. `docs/reference/robot-file.md`
explains them at length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, model_validator

from gibbs_codegen.files.faults import Place, refusal
from gibbs_codegen.files.fields import Tables
from gibbs_codegen.files.table import Table
from gibbs_codegen.robot.base_table import ROD_KEYS, BaseTable
from gibbs_codegen.robot.link_table import LinkTable
from gibbs_codegen.robot.model import BASE, MAX_FRAMES, MAX_LINKS, MAX_ROTORS, Robot
from gibbs_codegen.robot.placed_tables import FrameTable, RotorTable
from gibbs_codegen.robot.quantities import Name, NotNegative
from gibbs_codegen.robot.references import body_numbers, reference_faults


class RobotTable(Table):
    """An aerial robot: a base, rotors, links that branch from the base as a tree, and frames.

    SI units: kg, m, s. Angles are in degrees, in keys that end in `_deg`.
    """

    model_config = ConfigDict(title="Robot file of gibbs_codegen")

    name: Name = Field(
        description="the robot's name, which becomes that of the module and the prefix in C"
    )
    gravity: NotNegative = Field(default=9.81, description="acceleration of gravity, m/s²")
    allow_impossible_inertia: bool = Field(
        default=False,
        description="whether inertias pass that no body has, as some published models have them; "
        "a warning names the body",
    )
    base: BaseTable = Field(description="the flying base, [base]")
    rotor: Annotated[list[RotorTable], Tables("rotor", MAX_ROTORS, "rotors")] = Field(
        default_factory=list, description="rotors on the base or on links, instead of base.rotors"
    )
    link: Annotated[list[LinkTable], Tables("link", MAX_LINKS, "links")] = Field(
        default_factory=list, description="the links, each after the one that carries it"
    )
    frame: Annotated[list[FrameTable], Tables("frame", MAX_FRAMES, "frames")] = Field(
        default_factory=list, description="named frames on the base or on links"
    )

    @classmethod
    def mistaken(cls) -> tuple[str, frozenset[str]]:
        """Scenarios, by keys of theirs."""
        return "a scenario", frozenset({"duration", "control", "motors", "integration"})

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
        """Faults of names and references, and of two forms of rotors at once."""
        base = values.get("base")
        given = [key for key in ROD_KEYS if isinstance(base, dict) and key in base]
        if given and values.get("rotor"):
            yield (
                ("rotor",),
                f"belongs to a base without arms, but base.{given[0]} gives them motors: give "
                "[[rotor]] tables, or base.rotors and base.arm",
            )
        yield from reference_faults(values)

    @model_validator(mode="after")
    def _has_mass(self) -> Self:
        if self.robot().total_mass <= 0:
            place = ("base", "arm") if self.base.arm else ("base",)
            raise refusal([(place, "the robot has no mass; give its base or links some")])
        return self

    def robot(self) -> Robot:
        """The robot that the file describes, as far as its names can be resolved."""
        numbers = body_numbers([link.name for link in self.link])
        parents = [numbers.get(link.parent or "", before) for before, link in enumerate(self.link)]
        return Robot(
            self.name,
            self.base.built(),
            tuple(
                link.link(None if parent == before else parent)
                for before, (link, parent) in enumerate(zip(self.link, parents, strict=True))
            ),
            self.gravity,
            tuple(rotor.rotor(numbers.get(rotor.on, BASE)) for rotor in self.rotor),
            tuple(frame.frame(numbers.get(frame.on, BASE)) for frame in self.frame),
            self.allow_impossible_inertia,
        )
