"""Names of links, rotors, joints and frames: as in the source, made different where they clash."""

from __future__ import annotations

import itertools

from gibbs_codegen.exchange.source import Told
from gibbs_codegen.robot.names import CONSTRAINT_TORQUES, LONGEST_LABEL, identifier
from gibbs_codegen.robot.references import NamedKind, TakenNames


class Namer:
    """Hands out names and remembers them; `told` says which had to be changed."""

    def __init__(self) -> None:
        self.told: list[Told] = []
        self._taken = TakenNames()
        # How many names each form has been made into, so that thousands of one form take no longer.
        self._made: dict[tuple[str, str], int] = {}

    def body(self, name: str, what: NamedKind) -> str:
        """A name for a link or rotor, by its name in the source."""
        return self._free(name, what)

    def coordinate(self, name: str) -> str:
        """A name for a joint's coordinate, by the joint's name in the source."""
        return self._free(name, "joint")

    def frame(self, name: str) -> str:
        """A name for a frame, by its name in the source."""
        return self._free(name, "frame")

    def _free(self, name: str, what: NamedKind) -> str:
        """The name, as long as robot files may have it, or the name and a word or number."""
        stem = name or what
        if what == "joint" and identifier(stem).startswith(CONSTRAINT_TORQUES):
            stem = f"joint_{stem}"
        stem = stem[:LONGEST_LABEL]
        form = (what, identifier(stem))
        for number in itertools.count(self._made.get(form, 0)):
            ending = f"_{number if number > 1 else what}" if number else ""
            free = stem[: LONGEST_LABEL - len(ending)] + ending
            if not self._taken.fault(what, free):
                break
        self._made[form] = number + 1
        self._taken.take(what, free, what)
        if free != name:
            self.told.append(Told("note", name or "without a name", f"{what} called {free}"))
        return free
