"""What derivatives are compared with, and at what states: shared by the modules that compute it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import Evaluation
from gibbs_codegen.verification.slopes import Slopes, Units
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array

# Of what follows by algebra, of differences, and of differences of differences or of accelerations.
EXACT, SLOPE, CURVATURE = 1e-10, 1e-10, 1e-9
# How much less two differences of one thing may differ than the error that they may have.
AGREEMENT = 0.1 * CURVATURE


class DerivativeRow(NamedTuple):
    """An array to compare, with what it should be, natural sizes, and the largest error."""

    what: str
    ours: Array
    theirs: Array
    size: Array
    limit: float


@dataclass(frozen=True)
class Point:
    """A back end of a robot's module, and states to compare its derivatives at."""

    call: Evaluation
    robot: Robot
    tree: Tree
    states: States

    @cached_property
    def sizes(self) -> Sizes:
        """The natural sizes at the states."""
        return Sizes(self.tree, self.states)

    @cached_property
    def slopes(self) -> Slopes:
        """Derivatives by differences."""
        return Slopes(self.call, Units.of(self.tree))

    def first(self, count: int) -> Point:
        """The same at the first `count` states, or at all if there are fewer."""
        return Point(self.call, self.robot, self.tree, self.states.first(count))


def scaled_size(values: Array, rows: Array, columns: Array) -> Array:
    """One size for all entries of a matrix (s, m, n): that of the largest, in their units.

    These are the units (m,) of rows, and (n,) of what columns are derivatives by.
    """
    units = rows[:, None] / columns
    largest: Array = np.abs(values / units).max(axis=(1, 2), keepdims=True, initial=0.0)
    return largest * units
