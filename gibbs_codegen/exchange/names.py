"""Names of links, rotors, joints and frames: as in the source, made different where they clash.

Generated code holds identifier forms, in which what is not a letter, digit or _ becomes _, so that
names must differ in that form.
"""

from __future__ import annotations

from gibbs_codegen.exchange.source import Told
from gibbs_codegen.robot.names import identifier

_COORDINATES = (
    *("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"),
    *("theta_m1", "theta_0", "theta_1"),
)


class Namer:
    """Hands out names and remembers them; `told` says which had to be changed."""

    def __init__(self) -> None:
        self.told: list[Told] = []
        self._bodies = {"base"}
        self._coordinates = set(_COORDINATES)
        self._frames = {"base"}

    def body(self, name: str, what: str) -> str:
        """A name for a link or rotor.

        Args:
            name: Its name in the source.
            what: What it is, in a word.

        Returns:
            The name.
        """
        return self._free(name, what, self._bodies)

    def coordinate(self, name: str) -> str:
        """A name for a joint's coordinate.

        Args:
            name: The joint's name in the source.

        Returns:
            The name.
        """
        return self._free(name, "joint", self._coordinates)

    def frame(self, name: str) -> str:
        """A name for a frame.

        Args:
            name: Its name in the source.

        Returns:
            The name.
        """
        return self._free(name, "frame", self._frames)

    def _free(self, name: str, what: str, taken: set[str]) -> str:
        """The name, or the name and a word or number.

        Args:
            name: The name in the source.
            what: The word.
            taken: Identifier forms that are taken; that of the name is added.

        Returns:
            The name.
        """
        free, number = name or what, 1
        while _clashes(identifier(free), taken):
            free = f"{name}_{what}" if number == 1 else f"{name}_{number}"
            number += 1
        taken.add(identifier(free))
        if free != name:
            self.told.append(Told("note", name or "without a name", f"{what} called {free}"))
        return free


def _clashes(form: str, taken: set[str]) -> bool:
    """Whether a form is taken, or parameters of it and of another body would have one name."""
    ends = ("_com", "_mass_per")
    longer = any(form + end in taken for end in ends)
    return form in taken or longer or any(form.removesuffix(end) in taken for end in ends)
