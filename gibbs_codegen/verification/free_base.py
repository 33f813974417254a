"""A base with a quaternion, for formulations that know trees of joints only.

At every state the tree is placed where the base is. There the base's own joints are at zero, and
stand for a small motion from it: along and about the axes of the base. So their rates are the
velocities of the base in its own frame; their accelerations differ from the rates of these
velocities by terms of the velocities alone, since the axes turn with the base.
"""

from __future__ import annotations

import copy

from gibbs_codegen.verification.formulation import Formulation, Quantities
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.vectors import times


class FreeBase:
    """A formulation (see `formulation`) of a base with a quaternion, by one of its placed tree."""

    def __init__(self, inner: Formulation) -> None:
        self.tree = inner.tree
        self.name, self.limit, self.growth = inner.name, inner.limit, inner.growth
        self._inner = inner

    def at(self, states: States) -> Quantities:
        """What the tree gives at the placed states, for velocities of the base in its own frame."""
        inner = copy.copy(self._inner)
        inner.tree, moved = states.placed(self.tree)
        found = inner.at(moved)
        dragged = self.tree.spread(states.a - moved.a)
        bias = found.bias_accelerations
        if bias is not None:
            frames = found.jacobians[:, len(self.tree.motors) :]
            bias = bias - times(frames, dragged[:, None])
        residual = found.residual + times(found.mass_matrix, dragged)
        return found._replace(residual=residual, bias_accelerations=bias)


def formulated(inner: Formulation) -> Formulation:
    """A formulation of a robot's tree, which is placed where the base is if it has a quaternion."""
    return FreeBase(inner) if inner.tree.layout.is_quaternion else inner
