"""A flight whose series are computed when they are asked for: of many flights, few are."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from gibbs_codegen.simulator.record.flight import Flight
from gibbs_codegen.simulator.record.recording import Recording


class LateFlight(Flight):
    """A flight that computes each group of its fields when one of them is first asked for.

    Those `known` are known already.
    """

    def __init__(self, recording: Recording, known: dict[str, Any]) -> None:
        # A flight is frozen; its fields stand where an ordinary one has them.
        self.__dict__.update(known, _recording=recording)

    def __getattr__(self, name: str) -> Any:
        """A field that has not been computed yet."""
        if name.startswith("_"):
            raise AttributeError(name)
        for names, compute in self.__dict__["_recording"].groups:
            if name in names:
                # What is known already stays as it is.
                self.__dict__.update({**compute(), **self.__dict__})
                return self.__dict__[name]
        raise AttributeError(f"a flight has no {name}")

    def __reduce__(self) -> tuple[Any, ...]:
        # Copies and what is sent to other processes have all series.
        return Flight, tuple(getattr(self, each.name) for each in fields(Flight))
