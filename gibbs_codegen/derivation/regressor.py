"""The regressor: derivatives of inverse dynamics by the base parameters, in which it is linear.

The inertias of the regrouped tree take the place of symbols, which are no parameters, so that the
derivatives are computed anew at every state. They hold no such symbol themselves.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.segment_tree import Segment, SegmentTree
from gibbs_codegen.derivation.systems import Systems
from gibbs_codegen.derivation.tree_dynamics import generalised_inertia_forces
from gibbs_codegen.graph.differentiate import Matrix, jacobian
from gibbs_codegen.robot.base_parameters import GIVEN, NUMBERS
from gibbs_codegen.symbolic.tape import Stage


def base_parameters(systems: Systems) -> list[sp.Expr]:
    """Numbers of the bodies that their joints feel, in the order of the base parameters."""
    return [
        segment.inertia.entries[place]
        for k, segment in enumerate(systems.symbolic.reduced_tree.segments)
        for place in _places(segment, k)
    ]


def regressor(systems: Systems) -> Matrix:
    """The matrix whose product with the base parameters is ∂S/∂θ̈; rows in the order of v."""
    symbolic, tape, imported = systems.symbolic, systems.tape, systems.imported
    symbols: list[sp.Expr] = []
    segments = []
    for k, segment in enumerate(symbolic.reduced_tree.segments):
        entries: list[sp.Expr] = [sp.S.Zero] * len(NUMBERS)
        for place in _places(segment, k):
            # No name that a robot can give is like that.
            entries[place] = tape.symbol(f"number {place} of segment {k}", Stage.MOTION)
            symbols.append(entries[place])
        segments.append(replace(segment, inertia=Inertia.of(entries)))
    tree = SegmentTree(tuple(segments))
    forces = generalised_inertia_forces(tape, symbolic.root, tree, symbolic.state)
    directions = [{ref >> 1: imported.graph.one} for ref in systems.generic.refs(symbols)]
    with imported.group("columns of the regressor"):
        return jacobian(imported.graph, systems.generic.refs(forces), directions)


def _places(segment: Segment, k: int) -> list[int]:
    """Which numbers of the inertia of segment k are base parameters; of the base all are."""
    given = GIVEN[segment.joint] if k else ()
    return [place for place, name in enumerate(NUMBERS) if name not in given]
