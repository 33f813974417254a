"""Derivatives of the effects of constraints, without those of the solution for their forces.

Rows c = J a + γ are zero under the forces λ, as (1 + e) J v + A λ is under impulses, or what
redundant rows ask for and cannot have. With dc, their derivatives where λ is fixed,

    dλ = −A⁺ (dc + A⁺ d(A c)) + (1 − A A⁺) d(A y)    with c and y = A⁺ λ fixed in d(A c), d(A y),

and everything else follows with dλ for the rates of λ. That is the derivative of a pseudo-inverse
of constant rank (Golub and Pereyra, 1973): λ is the least, which turns with the rows that are
independent, and c turns with what they leave. Where no row can be redundant, −A⁺ dc is all.

To the recursion for derivatives of forward dynamics forces μ = Dλ along the unit loads U of each
frame are like thrusts, which turn with what carries them; impulses are those of a robot at rest.
Its columns have da and, in axes that turn with each frame, the changes of the accelerations
t = Uᵀa, all where μ does not change. The rows are functions of q, v and t, and μ of q and λ:
passes over these graphs, which are short, give their changes dμ and, with J M⁻¹U dμ added, dc.
Then da has M⁻¹U (dμ + D dλ) besides.

A segment at the end of a group works in axes that its own joint does not turn. When that turns by
dφ, what does not change in its own axes, as t, changes there by e_z×t dφ; and what does not change
there, as μ, by −e_z×μ dφ in its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import sympy as sp

from gibbs_codegen.derivation.articulated import Articulation, root_turn
from gibbs_codegen.derivation.articulated_derivatives import SeenPoint, doubled_velocities
from gibbs_codegen.derivation.constraints import ConstraintEquations, Held
from gibbs_codegen.derivation.forward_dynamics import free_motions_of
from gibbs_codegen.derivation.forward_dynamics_derivatives import (
    BaseColumns,
    base_columns,
    in_order,
)
from gibbs_codegen.derivation.parameters import NOT_PASSIVE
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.systems import Systems
from gibbs_codegen.graph.differentiate import Direction, Matrix, jacobian
from gibbs_codegen.graph.graph import Graph, Ref
from gibbs_codegen.symbolic.tape import Values
from gibbs_codegen.symbolic.vectors import identity


@dataclass(frozen=True)
class ConstraintDerivatives:
    """Derivatives by arguments under forces, or under impulses `alone`, that make rows zero."""

    systems: Systems
    forces: list[sp.Expr]
    alone: bool

    def of_accelerations(self, argument: str) -> Matrix:
        """Derivatives of accelerations, or velocities after an impact, by an argument (columns)."""
        graph, (fixed, _) = self.systems.imported.graph, self._columns(argument)
        with self.systems.imported.group(f"derivatives by {argument}, with those of the forces"):
            rows = [self.systems.refs(row) for row in fixed]
            gains = [self.systems.refs(row) for row in self._unit_columns]
            pushed = self._jacobian(self._pushes, argument, self._of_forces(argument))
            derivatives = _sum(graph, rows, _product(graph, gains, self._turned(pushed, argument)))
            if self.alone and argument == "v":
                units = identity(len(derivatives))
                derivatives = _sum(graph, derivatives, [self.systems.refs(row) for row in units])
            return derivatives

    def of_forces(self, argument: str) -> Matrix:
        """Derivatives of forces or impulses by an argument (columns)."""
        with self.systems.imported.group(f"derivatives by {argument}, with those of the forces"):
            outputs = self._system.from_solver(self.forces)
            return self._jacobian(outputs, argument, self._of_forces(argument))

    @property
    def _system(self) -> ConstraintEquations:
        return self.systems.constraints

    @cached_property
    def _symbolic(self) -> SymbolicRobot:
        """The robot, or where impulses act alone the robot at rest that nothing pulls."""
        if not self.alone:
            return self.systems.symbolic
        parameters = copy(self.systems.symbolic.parameters)
        parameters.gravity, parameters.ties = sp.S.Zero, {}
        parameters.links = {i: replace(x, passive=NOT_PASSIVE) for i, x in parameters.links.items()}
        still = (sp.S.Zero,) * len(self.systems.symbolic.v)
        return replace(self.systems.symbolic, v=still, parameters=parameters)

    @cached_property
    def _articulation(self) -> Articulation:
        return self._system.under(self.forces, self.alone)

    @cached_property
    def _motions(self) -> list[Values]:
        """Accelerations t of each frame."""
        return self._system.unit_motions(self._articulation, self.alone)

    @cached_property
    def _rows(self) -> list[sp.Expr]:
        """J a + γ or, of an impact, (1 + e) J v + A λ."""
        rows = self._system
        return rows.stopped_at(self._motions) if self.alone else rows.rows_at(self._motions)

    @cached_property
    def _pushes(self) -> list[sp.Expr]:
        """Forces μ along the unit loads."""
        pushes, rest = list[sp.Expr](), self.forces
        for held in self._system.held:
            forces, rest = rest[: len(held.rows)], rest[len(held.rows) :]
            pushes += self._system.symbolic.tape.combination(forces, self._system.shares(held))
        return pushes

    @cached_property
    def _base(self) -> tuple[list[sp.Expr], BaseColumns]:
        """Accelerations, and columns of them and of motions of the frames."""
        symbolic, constraints, tape = self._symbolic, self._system, self._symbolic.tape
        motions = free_motions_of(symbolic.centred)
        rates = symbolic.joint_state.rates
        doubled, seen = doubled_velocities(tape, self._articulation, motions, rates), []
        for held in constraints.held:
            if held.carrier is None:
                k, (_, place) = held.frame.segment, constraints.working(held)
                omega, turn = motions[k].omega, root_turn(self._articulation.tree)
                if k == 0:
                    place, omega = (turn.inverse.vector(tape, x) for x in (place, omega))
                moving = doubled[k].passed_out(tape, [place]).linear
                seen.append(SeenPoint(k, place, moving, omega, *([turn] if k == 0 else [])))
        return base_columns(symbolic, self._articulation, seen=seen)

    @cached_property
    def _unit_columns(self) -> list[list[sp.Expr]]:
        """M⁻¹U."""
        _, base = self._base
        efforts = base.by_joints("effort")
        columns: list[Values] = []
        for held in self._system.held:
            for wrenches, joints in self._system.units(held):
                columns += [base.by_load(k, wrench) for k, wrench in wrenches.items()]
                columns += [efforts[k - 1] for k in joints]
        return in_order(self._symbolic.places, columns)

    def _columns(self, argument: str) -> tuple[list[list[sp.Expr]], list[Values]]:
        """Changes of accelerations and t (rows) with an argument while μ stays constant."""
        symbolic, constraints, tape = self._symbolic, self._system, self._symbolic.tape
        (acceleration, base), places = self._base, symbolic.places
        if argument == "u":
            columns = base.by_inputs()
        elif argument == "v" and self.alone:
            world = sum(held.carrier is None for held in constraints.held)
            columns = [[sp.S.Zero] * (6 + symbolic.joints + 6 * world)] * places.size
        else:
            by_place, by_velocity = base.by_base(places.split(acceleration)[0])
            if argument == "q":
                columns = places.joined(by_place, base.by_joints("coordinate"))
            else:
                columns = places.joined(by_velocity, base.by_joints("rate"))
        rows, motions, first, unit = (
            in_order(places, columns),
            list[Values](),
            6 + symbolic.joints,
            0,
        )
        for held, motion in zip(constraints.held, self._motions, strict=True):
            if held.carrier is not None:
                motions += [rows[places.joint_places[k - 1]] for k in constraints.between(held)]
                unit += len(constraints.between(held))
                continue
            count = len(constraints.units(held))
            if argument == "u":
                inputs = [*zip(*self.systems.reduced.inputs, strict=True)]
                for column in [*zip(*self._unit_columns, strict=True)][unit : unit + count]:
                    motions.append([tape.sum_of_products(column, load) for load in inputs])
            else:
                seen = [[column[first + i] for column in columns] for i in range(count)]
                for j, turn in enumerate(self._turns(held) if argument == "q" else []):
                    for i in range(0, count if turn else 0, 3):
                        seen[i][j] = tape.let(seen[i][j] - motion[i + 1])
                        seen[i + 1][j] = tape.let(seen[i + 1][j] + motion[i])
                motions += seen
                first += 6
            unit += count
        return rows, motions

    def _turns(self, held: Held) -> list[sp.Expr]:
        """Rates, about z, of a frame against the axes in which its segment works, by velocities."""
        symbolic, tree = self._symbolic, self._articulation.tree
        k, size = held.frame.segment, symbolic.places.size
        if held.carrier is not None or tree.works_in_own_frame(k):
            return [sp.S.Zero] * size
        group = [m for m in tree.path(k) if tree.lead(m) == tree.lead(k)]
        rates = []
        for unit in identity(size):
            base, joints = symbolic.places.split(unit)
            turning = [joints[m - 1] for m in group if m and tree.segments[m].joint == "revolute"]
            spin = symbolic.root.segment_spin(base) if 0 in group else sp.S.Zero
            rates.append(sp.Add(spin, *turning))
        return rates

    def _jacobian(self, outputs: Values, argument: str, of_forces: Matrix) -> Matrix:
        """Derivatives of results of the forces and q or v, by columns of dλ."""
        systems, graph = self.systems, self.systems.imported.graph
        moved = [_moved(graph, systems.refs(self.forces), column) for column in of_forces]
        pairs = zip(systems.directions(argument), moved, strict=True)
        return jacobian(graph, systems.refs(outputs), [{**x, **y} for x, y in pairs])

    def _turned(self, pushes: Matrix, argument: str) -> Matrix:
        """Changes of μ by an argument (columns) in axes that turn with the frames."""
        graph, first = self.systems.imported.graph, 0
        refs, turned = self.systems.refs(self._pushes), [list(row) for row in pushes]
        for held in self._system.held:
            count = len(self._system.units(held))
            for j, turn in enumerate(self._turns(held) if argument == "q" else []):
                for i in range(first, first + count if turn else first, 3):
                    turned[i][j] = graph.sum([turned[i][j], refs[i + 1]])
                    turned[i + 1][j] = graph.sum([turned[i + 1][j], graph.minus(refs[i])])
            first += count
        return turned

    def _of_forces(self, argument: str) -> Matrix:
        """dλ, by columns."""
        systems, graph, constraints = self.systems, self.systems.imported.graph, self._system
        nodes = systems.refs([x for motion in self._motions for x in motion])
        directions, (_, motions) = systems.directions(argument), self._columns(argument)
        with systems.imported.group(f"derivatives by {argument}, with the forces fixed"):
            still = [[graph.zero] * len(self.forces)] * len(directions)
            rates = [systems.refs(column) for column in zip(*motions, strict=True)]
            seen = [_moved(graph, nodes, column) for column in rates]
            held = [{**x, **y} for x, y in zip(directions, seen, strict=True)]
            changes = jacobian(graph, systems.refs(self._rows), held)
            pushes = self._turned(self._jacobian(self._pushes, argument, still), argument)
            pushed = [systems.refs(row) for row in constraints.pushed]
            changes = _sum(graph, changes, _product(graph, pushed, pushes))
        with systems.imported.group(f"derivatives of the forces by {argument}"):
            return self._solved(changes, directions if argument == "q" else [])

    def _solved(self, changes: Matrix, turning: Sequence[Direction]) -> Matrix:
        """dλ from dc, by columns; A changes in the directions `turning`, if in any."""
        systems, graph, constraints = self.systems, self.systems.imported.graph, self._system
        inverse = [systems.refs(row) for row in constraints.solver_inverse]
        if not turning or constraints.is_regular:
            return _columns_of(_minus(graph, _product(graph, inverse, changes)))
        tape = systems.symbolic.tape
        with tape.group("least forces, seen from the rows, and what rows cannot have"):
            dual = [tape.sum_of_products(row, self.forces) for row in constraints.solver_inverse]
            left = [tape.let(m * c) for m, c in zip(constraints.masks, self._rows, strict=True)]
            # Rows that can have all leave only rounding, which A⁺ would enlarge.
            left = [tape.let(c - x) for c, x in zip(left, constraints.projected(left), strict=True)]
            onto = [systems.refs(constraints.projected(unit)) for unit in identity(len(left))]
        by_dual, by_left = (self._under(forces, turning) for forces in (dual, left))
        changes = _sum(graph, changes, _product(graph, inverse, by_left))
        outside = _sum(graph, by_dual, _minus(graph, _product(graph, onto, by_dual)))
        return _columns_of(_sum(graph, outside, _minus(graph, _product(graph, inverse, changes))))

    def _under(self, forces: list[sp.Expr], directions: Sequence[Direction]) -> Matrix:
        """Derivatives of A f of the active rows, with the forces f fixed."""
        systems, graph, constraints = self.systems, self.systems.imported.graph, self._system
        fixed = _moved(graph, systems.refs(forces), [graph.zero] * len(forces))
        rows = zip(constraints.masks, constraints.rows_under(forces), strict=True)
        masked = [systems.symbolic.tape.let(mask * row) for mask, row in rows]
        held = [{**direction, **fixed} for direction in directions]
        return jacobian(graph, systems.refs(masked), held)


def _sum(graph: Graph, one: Matrix, other: Matrix) -> Matrix:
    pairs = zip(one, other, strict=True)
    return [[graph.sum(pair) for pair in zip(*rows, strict=True)] for rows in pairs]


def _minus(graph: Graph, matrix: Matrix) -> Matrix:
    return [[graph.minus(x) for x in row] for row in matrix]


def _product(graph: Graph, one: Matrix, other: Matrix) -> Matrix:
    columns = _columns_of(other)
    return [[graph.sum(map(graph.product, row, column)) for column in columns] for row in one]


def _columns_of(matrix: Matrix) -> Matrix:
    return [list(column) for column in zip(*matrix, strict=True)]


def _moved(graph: Graph, refs: Sequence[Ref], rates: Sequence[Ref]) -> Direction:
    """Rates of values, by their nodes."""
    pairs = zip(refs, rates, strict=True)
    return {
        ref >> 1: graph.minus(rate) if ref & 1 else rate
        for ref, rate in pairs
        if not graph.is_zero(ref)
    }


class ConstrainedSystems(Systems):
    """Systems with the derivatives of the effects of constraints, which outputs share."""

    @cached_property
    def held_derivatives(self) -> ConstraintDerivatives:
        """Derivatives of accelerations under the forces of constraints."""
        return ConstraintDerivatives(self, self.constraints.solver_forces, alone=False)

    @cached_property
    def impact_derivatives(self) -> ConstraintDerivatives:
        """Derivatives of velocities after an impact."""
        return ConstraintDerivatives(self, self.constraints.solver_impulses, alone=True)


# The parts of a derivative by an argument, by the derivation of the output.
IMPLICIT: dict[str, Callable[[ConstrainedSystems, str], Matrix]] = {
    "constrained_acceleration": lambda s, by: s.held_derivatives.of_accelerations(by),
    "constraint_forces": lambda s, by: s.held_derivatives.of_forces(by),
    "impact_velocities": lambda s, by: s.impact_derivatives.of_accelerations(by),
    "impact_impulses": lambda s, by: s.impact_derivatives.of_forces(by),
}
