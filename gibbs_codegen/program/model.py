"""A robot and its program: what every target prints."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from gibbs_codegen.interface import FUNCTIONS, Signature, signatures
from gibbs_codegen.program.nodes import Function, Node, Program, names_in
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.module_lists import module_lists

Progress = Callable[[str], None]
# Which functions there are of those generated on request: True for all that are not long, or none
# of them; one name, or several; "all" stands for the long ones too.
Derivatives: TypeAlias = bool | str | Sequence[str]


@dataclass(frozen=True)
class Model:
    """A derived robot: its program, and the defaults and units of its parameters.

    `folded` names the parameters that are zero in the file and therefore structural, unless
    `keeps_zeros`. `derivatives` names the functions generated on request that it has.
    """

    robot: Robot
    program: Program
    defaults: dict[str, float]
    units: dict[str, str]
    folded: tuple[str, ...]
    keeps_zeros: bool
    derivatives: tuple[str, ...]

    @property
    def lists(self) -> dict[str, Collection[str]]:
        """What its module lists, by the names of the constants."""
        own = {"PARAMETERS": self.defaults, "DERIVATIVES": self.derivatives}
        return {**module_lists(self.robot, self.derivatives), **own}

    @property
    def signatures(self) -> list[Signature]:
        """Signatures of its functions, in the order of the table."""
        return signatures(self.lists, self.derivatives)

    @property
    def derived(self) -> list[tuple[Function, Signature]]:
        """The program's functions with their signatures."""
        own = [s for s in self.signatures if not FUNCTIONS[s.name].composed]
        return list(zip(self.program.functions, own, strict=True))

    @property
    def composed(self) -> list[Signature]:
        """Signatures of the functions that are composed of the program's."""
        return [s for s in self.signatures if FUNCTIONS[s.name].composed]

    @property
    def total_mass(self) -> Node:
        """Mass of the whole robot: the mass matrix's entry of the position, whatever the attitude.

        Of the position's three entries it is the last.
        """
        v = layout_of(self.robot).v
        place: int = v.position.stop - 1
        return self.program.function("mass_matrix").outputs[0].entries[place * (v.size + 1)]

    @property
    def parameters_read(self) -> list[str]:
        """Parameters that the constants depend on, in the order of the program's."""
        program = self.program
        read = {name for statement in program.prepare for name in names_in(statement.value)}
        read.update(program.constants)
        return [name for name in program.parameters if name in read]
