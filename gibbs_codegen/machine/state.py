"""The state of what moves, laid out once: its parts by their names, and where they stand."""

from __future__ import annotations

import itertools
from dataclasses import astuple, dataclass
from functools import cached_property
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")


class State(NamedTuple, Generic[T]):
    """Parts of a state, in their order; what a state does not have is of no length.

    Coordinates (nq), velocities (nv), the work done since the start, J, the state of the actuators,
    which is that of the module's drives, and then thrusts of motors that lag, N, what a law
    remembers, and the displacements (3 b) of the bristles of b contacts with friction, m, world
    axes.
    """

    q: T
    v: T
    work: T
    actuators: T
    memory: T
    bristles: T


@dataclass(frozen=True)
class StateLayout:
    """The number of entries of each part of a state."""

    q: int
    v: int
    work: int = 0
    actuators: int = 0
    memory: int = 0
    bristles: int = 0

    @property
    def size(self) -> int:
        """The number of entries of a state."""
        return sum(astuple(self))

    @cached_property
    def places(self) -> State[slice]:
        """The places of the parts."""
        sizes = astuple(self)
        ends = itertools.accumulate(sizes)
        return State(*(slice(end - size, end) for end, size in zip(ends, sizes, strict=True)))
