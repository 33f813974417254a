"""What every emitted function of one robot is derived from, and what several of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import sympy as sp

from gibbs_codegen.derivation.forward_dynamics import Dynamics, shorter_dynamics
from gibbs_codegen.derivation.forward_dynamics_derivatives import (
    ForwardDynamicsDerivatives,
    forward_dynamics_derivatives,
)
from gibbs_codegen.derivation.generic_derivatives import GenericDerivatives
from gibbs_codegen.derivation.hybrid import LinearSystem
from gibbs_codegen.derivation.inverse_dynamics import inverse_dynamics
from gibbs_codegen.derivation.inverse_dynamics_derivatives import (
    InverseDynamicsDerivatives,
    inverse_dynamics_derivatives,
)
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import Ref
from gibbs_codegen.program.lower import Slice
from gibbs_codegen.symbolic.tape import Tape

# A scalar on the tape or its graph, a vector, a matrix by rows, or several matrices.
Array: TypeAlias = sp.Expr | Ref | Sequence["Array"]


@dataclass(frozen=True)
class Systems:
    """A robot on its tape, with M a = R + B u and the hybrid system, which others build on.

    `functions` has those derived so far: first all that every module has, then those on request.
    """

    tape: Tape
    imported: ImportedTape
    symbolic: SymbolicRobot
    reduced: LinearSystem
    hybrid: LinearSystem
    functions: dict[str, Slice] = field(default_factory=dict)

    @cached_property
    def parameters(self) -> dict[str, Ref]:
        """Parameters that functions depend on, by name; derivatives depend on no others."""
        arrays = [array for piece in self.functions.values() for array in piece.outputs]
        refs = self.generic.refs([entry for _, entries in arrays for entry in entries])
        read = {*self.imported.graph.reached(refs)}
        every = {
            name: self.imported.ref(sp.Symbol(name)) for name in self.symbolic.parameters.defaults
        }
        return {name: ref for name, ref in every.items() if ref >> 1 in read}

    @cached_property
    def dynamics(self) -> tuple[Dynamics, list[sp.Expr]]:
        """The shorter way to the accelerations, and those of M a = R + B u."""
        return shorter_dynamics(self.imported, self.symbolic)

    @cached_property
    def inverse_dynamics(self) -> list[sp.Expr]:
        """M a − R = ∂S/∂θ̈ at the given accelerations."""
        return inverse_dynamics(self.symbolic)

    @cached_property
    def inverse_derivatives(self) -> InverseDynamicsDerivatives:
        """M a − R with its derivatives by q, v and a, in one pass."""
        return inverse_dynamics_derivatives(self.symbolic)

    @cached_property
    def forward_derivatives(self) -> ForwardDynamicsDerivatives:
        """Accelerations of M a = R + B u with their derivatives by q, v and u, in one pass."""
        return forward_dynamics_derivatives(self.symbolic)

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
    def input_forces(self) -> list[sp.Expr]:
        """B u."""
        with self.tape.group("generalised forces of the inputs"):
            return [
                self.tape.let(sp.Add(*(b * u for b, u in zip(row, self.symbolic.u, strict=True))))
                for row in self.reduced.inputs
            ]

    @cached_property
    def input_hessian(self) -> list[list[Ref]]:
        """Second derivatives of w·B u by q and u."""
        return self.generic.hessian(self.input_forces, "qu")

    @cached_property
    def inverse_hessian(self) -> list[list[Ref]]:
        """Second derivatives of w·(M a − R) by q and v."""
        return self.generic.hessian(self.inverse_dynamics, "qv")
