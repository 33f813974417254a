"""What every emitted function of one robot is derived from, and what several of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import sympy as sp

from gibbs_codegen.derivation.forward_dynamics import Dynamics, shorter_dynamics
from gibbs_codegen.derivation.generic_derivatives import GenericDerivatives
from gibbs_codegen.derivation.hybrid import LinearSystem
from gibbs_codegen.derivation.passive import armatures, passive_forces
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import generalised_inertia_forces
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import Ref
from gibbs_codegen.symbolic.tape import Tape

# A scalar on the tape or its graph, a vector, a matrix by rows, or several matrices.
Array: TypeAlias = sp.Expr | Ref | Sequence["Array"]


@dataclass(frozen=True)
class Systems:
    """A robot on its tape, with M a = R + B u and the hybrid system, which others build on."""

    tape: Tape
    imported: ImportedTape
    symbolic: SymbolicRobot
    reduced: LinearSystem
    hybrid: LinearSystem

    @cached_property
    def dynamics(self) -> tuple[Dynamics, list[sp.Expr]]:
        """The shorter way to the accelerations, and those of M a = R + B u."""
        return shorter_dynamics(self.imported, self.symbolic)

    @cached_property
    def inverse_dynamics(self) -> list[sp.Expr]:
        """M a − R = ∂S/∂θ̈ at the given accelerations."""
        symbolic, tape = self.symbolic, self.tape
        forces = generalised_inertia_forces(
            tape, symbolic.root, symbolic.reduced_tree, symbolic.state
        )
        base, joints = symbolic.places.split(forces)
        _, accelerations = symbolic.places.split(symbolic.a)
        passive = passive_forces(symbolic)
        given = zip(joints, armatures(symbolic), accelerations, passive, strict=True)
        with tape.group("forces of the joints with their armature, dampers and springs"):
            own = [tape.let(force + m * a - passive) for force, m, a, passive in given]
        return symbolic.places.joined(base, own)

    @cached_property
    def generic(self) -> GenericDerivatives:
        """Derivatives by passes over the graph."""
        return GenericDerivatives(self.imported, self.symbolic)

    @cached_property
    def inverse_gradient(self) -> list[list[Ref]]:
        """Gradient of w·(M a − R) by q, v and a."""
        return self.generic.gradient(self.inverse_dynamics, "qva")

    @cached_property
    def forward_gradient(self) -> list[list[Ref]]:
        """Gradient of w·a of M a = R + B u by q, v and u."""
        return self.generic.gradient(self.dynamics[1], "qvu")

    @cached_property
    def inverse_hessian(self) -> list[list[Ref]]:
        """Second derivatives of w·(M a − R) by q and v."""
        return self.generic.hessian(self.inverse_dynamics, "qv")
