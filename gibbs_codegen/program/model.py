"""A robot and its program: what every target prints."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from types import SimpleNamespace

from gibbs_codegen.interface import FUNCTIONS, Signature, derivatives_among, signatures
from gibbs_codegen.program.nodes import Function, Node, ScalarProgram, names_in
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.model import Robot

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Model:
    """A derived robot: its program, and the defaults and units of its parameters.

    `folded` names the parameters that are zero in the file and therefore structural, unless
    `keeps_zeros`. `functions` names those of the table that it has; `total_mass` is what its
    constants have for the mass of the whole robot, kg. `laws` names those that are printed beside
    the functions.
    """

    description: Description
    program: ScalarProgram
    defaults: dict[str, float]
    units: dict[str, str]
    folded: tuple[str, ...]
    keeps_zeros: bool
    functions: tuple[str, ...]
    total_mass: Node
    laws: tuple[str, ...] = ()

    @property
    def robot(self) -> Robot:
        """The robot as plain data."""
        return self.description.robot

    @property
    def lists(self) -> dict[str, Collection[str]]:
        """Lists in its module, by the names of the constants."""
        lists = {
            "PARAMETERS": self.defaults,
            "FUNCTIONS": tuple(signature.name for signature in self.signatures),
            "DERIVATIVES": derivatives_among(signature.name for signature in self.signatures),
        }
        return {**self.description.lists(self.functions), **lists}

    @property
    def listing(self) -> SimpleNamespace:
        """The listing for array programs: what they read of a module's constants."""
        constants = self.description.constants
        return SimpleNamespace(
            **self.lists,
            NAME=self.robot.name,
            CARRIERS=constants["CARRIERS"],
            ATTITUDE=self.description.layout.attitude,
            COORDINATE_UNITS=self.description.layout.q.units,
            **{x: constants.get(x, {}) for x in ("ROTOR_AIR", "CONSTRAINT_PLACES", "LOOPS")},
        )

    @property
    def signatures(self) -> list[Signature]:
        """Signatures of its functions, in the order of the table."""
        lists = {**self.description.lists(self.functions), "PARAMETERS": self.defaults}
        return signatures(lists, self.functions)

    @property
    def derived(self) -> list[tuple[Function, Signature]]:
        """The program's functions with their signatures."""
        signatures = [s for s in self.signatures if not FUNCTIONS[s.name].composed]
        return list(zip(self.program.functions, signatures, strict=True))

    @property
    def composed(self) -> list[Signature]:
        """Signatures of the functions that are composed of the program's."""
        return [s for s in self.signatures if FUNCTIONS[s.name].composed]

    @property
    def parameters_read(self) -> list[str]:
        """Parameters that the constants depend on, in the order of the program's."""
        program = self.program
        read = {name for statement in program.prepare for name in names_in(statement.value)}
        read.update(program.constants)
        return [name for name in program.parameters if name in read]
