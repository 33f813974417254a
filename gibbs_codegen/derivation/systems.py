"""Sources of all emitted functions of one robot, and the parts that several of them share.

Any function has derivatives by passes over its graph, in the tangent space of the coordinates, by
the parameters and by the base parameters. They are exact whatever the robot. They serve where no
shorter recursion is known, and as the oracle of those that are. A displacement of q is along the
velocities: the derivative by it is that of δ ↦ f(q ⊕ δ) at δ = 0. So the coordinates' rates at unit
velocities are the directions.

By the parameters a function f(k(p)) is differentiated by the constants k that it reads, as if
nothing else were known of them. What `prepare` makes the constants of is constant itself, so their
derivatives by the parameters are computed once per set of parameters, and a call only forms sums of
products with these.

The regressor has the derivatives of inverse dynamics by the base parameters, in which it is linear.
The inertias of the regrouped tree take the place of symbols, which are no parameters, so that the
derivatives are computed anew at every state. They hold no such symbol themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import TypeAlias

import sympy as sp

from gibbs_codegen.derivation.constraints import ConstraintEquations, GearedConstraintEquations
from gibbs_codegen.derivation.forward_dynamics import (
    Dynamics,
    shorter_dynamics,
    thrusts_and_wrenches,
)
from gibbs_codegen.derivation.forward_dynamics_derivatives import (
    ForwardDynamicsDerivatives,
    LoadedDynamicsDerivatives,
    forward_dynamics_derivatives,
    loaded_dynamics_derivatives,
)
from gibbs_codegen.derivation.forward_kinematics import centre_of_mass_jacobian, frame_jacobians
from gibbs_codegen.derivation.hybrid import LinearSystem
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.inverse_dynamics import (
    InverseDynamicsDerivatives,
    inverse_dynamics,
    inverse_dynamics_derivatives,
)
from gibbs_codegen.derivation.motion import TreeState
from gibbs_codegen.derivation.segment_tree import Segment, SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import generalised_inertia_forces, whole_inertia
from gibbs_codegen.graph.differentiate import Direction, Matrix, hessian, jacobian, jvp, vjp
from gibbs_codegen.graph.from_program import program_refs
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import NUMBER, Graph, Ref
from gibbs_codegen.graph.shortening import operations
from gibbs_codegen.program.lower import Slice
from gibbs_codegen.robot.description import NUMBERS, PARENTS_NUMBERS
from gibbs_codegen.symbolic.tape import Stage, Values

# A scalar on the tape or its graph, a vector, a matrix by rows, or several matrices.
Array: TypeAlias = sp.Expr | Ref | Sequence["Array"]


def entries(array: Array) -> tuple[sp.Expr | Ref, ...]:
    """Entries of a scalar, a vector or a matrix, row by row."""
    if isinstance(array, list | tuple):
        return tuple(entry for part in array for entry in entries(part))
    return (array,)


@dataclass(frozen=True)
class Systems:
    """A robot on its tape, with M a = R + B u and the hybrid system, which others build on.

    `functions` has those derived so far: first all that every module has, then those on request.
    """

    imported: ImportedTape
    symbolic: SymbolicRobot
    reduced: LinearSystem
    hybrid: LinearSystem
    functions: dict[str, Slice] = field(default_factory=dict)

    def refs(self, array: Array) -> list[Ref]:
        """References to entries: expressions of the tape, or references already."""
        return [e if isinstance(e, int) else self.imported.ref(e) for e in entries(array)]

    def directions(self, argument: str) -> list[Direction]:
        """Directions in which an argument moves: rates of its entries, by their nodes.

        There is one for each column of a derivative by it; "q" moves along the velocities.
        """
        one = self.imported.graph.one
        if argument != "q":
            return [{ref >> 1: one} for ref in self.refs(getattr(self.symbolic, argument))]
        size = len(self.symbolic.v)
        units = [[sp.Integer(i == j) for i in range(size)] for j in range(size)]
        return [self._moved_along(velocities) for velocities in units]

    def _moved_along(self, velocities: Values) -> Direction:
        """Rates of the coordinates at some velocities, by their nodes."""
        symbolic = self.symbolic
        rates = self.refs(symbolic.coordinate_rates(velocities))
        return {ref >> 1: rate for ref, rate in zip(self.refs(symbolic.q), rates, strict=True)}

    def jacobian(self, outputs: Array, argument: str) -> Matrix:
        """Derivatives of outputs (rows) by the directions of "q", "v", "a" or "u" (columns)."""
        with self.imported.group(f"derivatives by {argument}, column by column"):
            return jacobian(self.imported.graph, self.refs(outputs), self.directions(argument))

    def jvp(self, outputs: Array, arguments: str) -> list[Ref]:
        """Derivatives of outputs as `arguments`, by letters, move by q_dot, v_dot, …."""
        direction: dict[int, Ref] = {}
        for argument in arguments:
            rates = getattr(self.symbolic, f"{argument}_dot")
            if argument == "q":
                direction |= self._moved_along(rates)
            else:
                nodes = [ref >> 1 for ref in self.refs(getattr(self.symbolic, argument))]
                direction |= zip(nodes, self.refs(rates), strict=True)
        with self.imported.group("derivative in the given direction"):
            return jvp(self.imported.graph, self.refs(outputs), direction)

    def gradient(self, outputs: Array, arguments: str, weights: str = "w") -> list[list[Ref]]:
        """Derivatives of the outputs' sum with some weights, by each argument's directions."""
        graph = self.imported.graph
        inputs = {letter: self.refs(getattr(self.symbolic, letter)) for letter in arguments}
        sources = [ref for refs in inputs.values() for ref in refs]
        with self.imported.group("gradient, backward from the result"):
            weighed = self.refs(getattr(self.symbolic, weights))
            by_input = vjp(graph, self.refs(outputs), weighed, sources)
            by_node = {ref >> 1: entry for ref, entry in zip(sources, by_input, strict=True)}
            return [
                [
                    graph.sum(graph.product(rate, by_node[node]) for node, rate in way.items())
                    for way in self.directions(letter)
                ]
                for letter in arguments
            ]

    def hessian(self, outputs: Values, arguments: str) -> Matrix:
        """Second derivatives of the outputs' sum with the weights w, symmetric.

        The directions of the arguments, which are letters, follow one another. Displacements of the
        attitude do not commute; the second derivative of δ ↦ f(q ⊕ δ) is the mean of both orders.
        """
        graph = self.imported.graph
        gradient = [ref for part in self.gradient(outputs, arguments) for ref in part]
        directions: list[Direction] = []
        starts: dict[str, int] = {}
        for letter in arguments:
            starts[letter] = len(directions)
            directions.extend(self.directions(letter))
        with self.imported.group("second derivatives, the lower triangle column by column"):
            matrix = hessian(graph, gradient, directions)
            layout = self.symbolic.description.layout
            if not layout.turns_with_base or "q" not in arguments:
                return matrix
            half = graph.number(sp.S.Half)
            base = [starts["q"] + place for place in layout.v.base]
            for j in base:
                others = [i for i in base if i < j]
                columns = jvp(graph, [gradient[i] for i in others], directions[j])
                for i, entry in zip(others, columns, strict=True):
                    mean = graph.product(half, graph.sum([entry, matrix[i][j]]))
                    matrix[i][j] = matrix[j][i] = mean
        return matrix

    def of_drives(self, name: str) -> list[Ref]:
        """A function of the drives, by its name in the table."""
        if self.symbolic.drives is None:
            raise ValueError(f"{name}: the robot has no drives")
        program = self.symbolic.drives.program(name)
        arguments = {x: getattr(self.symbolic, x, (sp.Symbol(x),)) for x in program.names}
        refs = {x: self.refs(symbols) for x, symbols in arguments.items()}
        return program_refs(self.imported, program, refs)

    @cached_property
    def total_mass(self) -> sp.Expr:
        """The mass of the whole robot (kg)."""
        return whole_inertia(self.symbolic.tape, self.tree.reduced_tree).mass

    @cached_property
    def parameters(self) -> dict[str, Ref]:
        """Parameters that functions depend on, by name; derivatives depend on no others."""
        outputs = [output for piece in self.functions.values() for _, output in piece.outputs]
        read = {
            *self.imported.graph.reached(
                self.refs([*outputs, self.total_mass, *base_parameters(self)])
            )
        }
        refs = {
            name: self.imported.ref(sp.Symbol(name)) for name in self.symbolic.parameters.defaults
        }
        return {name: ref for name, ref in refs.items() if ref >> 1 in read}

    @property
    def tree(self) -> SymbolicRobot:
        """The robot with entries for every joint that moves."""
        return self.symbolic.ungeared

    @cached_property
    def frame_jacobians(self) -> list[Matrix]:
        """Jacobians of the frames."""
        return self.symbolic.folded(frame_jacobians(self.tree))

    @cached_property
    def centre_jacobian(self) -> Matrix:
        """The Jacobian of the centre of mass."""
        return self.symbolic.folded(centre_of_mass_jacobian(self.tree))

    @cached_property
    def constraints(self) -> ConstraintEquations:
        """The constraints of frames."""
        if not self.symbolic.robot.is_recursive:
            return GearedConstraintEquations(self.tree, self.symbolic, self.reduced)
        return ConstraintEquations(self.symbolic)

    @cached_property
    def dynamics(self) -> tuple[Dynamics, list[sp.Expr]]:
        """The shorter way to the accelerations, and those of M a = R + B u."""
        return shorter_dynamics(self.imported, self.symbolic)

    @cached_property
    def loaded_dynamics(self) -> list[sp.Expr]:
        """Accelerations of M a = R + B u + ΣJᵀW, in the same way."""
        return self.dynamics[0](self.symbolic, thrusts_and_wrenches)

    @cached_property
    def inverse_dynamics(self) -> list[sp.Expr]:
        """M a − R = ∂S/∂θ̈ at the given accelerations."""
        return self.symbolic.folded(inverse_dynamics(self.tree))

    @cached_property
    def inverse_derivatives(self) -> InverseDynamicsDerivatives:
        """M a − R with its derivatives by q, v and a, in one pass."""
        derivatives = inverse_dynamics_derivatives(self.tree)
        matrices = derivatives.force_dq, derivatives.force_dv, derivatives.mass_matrix
        force = self.symbolic.folded(derivatives.force)
        return InverseDynamicsDerivatives(force, *map(self.symbolic.folded_matrix, matrices))

    @cached_property
    def forward_derivatives(self) -> ForwardDynamicsDerivatives:
        """Accelerations of M a = R + B u with their derivatives by q, v and u, in one pass."""
        if not self.symbolic.robot.is_recursive:
            return self._differentiated(self.dynamics[1])
        return forward_dynamics_derivatives(self.symbolic)

    @cached_property
    def loaded_derivatives(self) -> LoadedDynamicsDerivatives:
        """Accelerations under wrenches on the frames, with their derivatives by q, v, u and W."""
        if not self.symbolic.robot.is_recursive:
            return self._differentiated(self.loaded_dynamics)
        return loaded_dynamics_derivatives(self.symbolic)

    def _differentiated(self, accelerations: list[sp.Expr]) -> LoadedDynamicsDerivatives:
        """Accelerations that no recursion for derivatives is known of, and passes over them."""
        passes = (self.jacobian(accelerations, argument) for argument in "qvuW")
        return LoadedDynamicsDerivatives(accelerations, *passes)

    @cached_property
    def loaded_gradient(self) -> list[list[Ref]]:
        """Gradient of w·a under wrenches on the frames, by q, v, u and W."""
        return self.gradient(self.loaded_dynamics, "qvuW")

    @cached_property
    def inverse_gradient(self) -> list[list[Ref]]:
        """Gradient of w·(M a − R) by q, v and a."""
        return self.gradient(self.inverse_dynamics, "qva")

    @cached_property
    def forward_gradient(self) -> list[list[Ref]]:
        """Gradient of w·a of M a = R + B u by q, v and u."""
        return self.gradient(self.dynamics[1], "qvu")

    @cached_property
    def input_forces(self) -> list[sp.Expr]:
        """B u."""
        tape = self.symbolic.tape
        with tape.group("generalised forces of the inputs"):
            return [
                tape.let(sp.Add(*(b * u for b, u in zip(row, self.symbolic.u, strict=True))))
                for row in self.reduced.inputs
            ]

    @cached_property
    def input_hessian(self) -> list[list[Ref]]:
        """Second derivatives of w·B u by q and u."""
        return self.hessian(self.input_forces, "qu")

    @cached_property
    def inverse_hessian(self) -> list[list[Ref]]:
        """Second derivatives of w·(M a − R) by q and v."""
        return self.hessian(self.inverse_dynamics, "qv")


def parameter_jacobian(systems: Systems, outputs: Array) -> Matrix:
    """Derivatives of outputs by the parameters: a row for each."""
    imported = systems.imported
    graph, refs = imported.graph, systems.refs(outputs)
    constants = _constants(graph, refs)
    with imported.group("derivatives by the constants, column by column"):
        rows = jacobian(graph, refs, [{ref >> 1: graph.one} for ref in constants])
    return _by_parameters(systems, constants, rows)


def parameter_gradient(systems: Systems, outputs: Values) -> list[Ref]:
    """Derivatives by the parameters of the sum of some accelerations with the weights w."""
    imported = systems.imported
    graph, accelerations = imported.graph, systems.refs(outputs)
    constants = _constants(graph, accelerations)
    with imported.group("gradient by the constants, backward from the result"):
        row = vjp(graph, accelerations, systems.refs(systems.symbolic.w), constants)
    return _by_parameters(systems, constants, [row])[0]


def _constants(graph: Graph, outputs: Sequence[Ref]) -> list[Ref]:
    """Constants that a function reads, oldest first."""
    read = [ref for node in graph.reached_varying(outputs) for ref in graph.operands[node]]
    nodes = {ref >> 1 for ref in [*read, *outputs]}
    return [
        2 * node
        for node in sorted(nodes)
        if graph.constant[node] and graph.kinds[node] is not NUMBER
    ]


def _by_parameters(systems: Systems, constants: Sequence[Ref], rows: Matrix) -> Matrix:
    """Derivatives of outputs (rows) by the parameters, from `rows`, those by the constants.

    Either the derivatives of the constants by the parameters are there as numbers, or the sums go
    back from constant to constant, and those of many parameters have parts in common: which is
    shorter differs from robot to robot.
    """
    graph, parameters = systems.imported.graph, [*systems.parameters.values()]
    with systems.imported.group("derivatives by the parameters"):
        columns = jacobian(graph, constants, [{ref >> 1: graph.one} for ref in parameters])
        products = [
            [
                graph.sum(map(graph.product, by_parameter, row))
                for by_parameter in zip(*columns, strict=True)
            ]
            for row in rows
        ]
        backward = [vjp(graph, constants, row, parameters) for row in rows]
    return min(products, backward, key=lambda matrix: operations(graph, [*chain(*matrix)]))


def base_parameters(systems: Systems) -> list[sp.Expr]:
    """Numbers of the bodies that their joints feel, in the order of the base parameters."""
    return [
        segment.inertia.entries[place]
        for k, segment in enumerate(systems.tree.reduced_tree.segments)
        if k or systems.symbolic.places.base
        for place in _places(segment, k)
    ]


def regressor(systems: Systems, state: TreeState) -> Matrix:
    """The matrix whose product with the base parameters is ∂S/∂θ̈; rows in the order of v."""
    symbolic, imported = systems.tree, systems.imported
    symbols: list[sp.Expr] = []
    segments = []
    for k, segment in enumerate(symbolic.reduced_tree.segments):
        entries: list[sp.Expr] = [sp.S.Zero] * len(NUMBERS)
        for place in _places(segment, k) if k or symbolic.places.base else ():
            # No name that a robot can give is like that.
            entries[place] = symbolic.tape.symbol(f"number {place} of segment {k}", Stage.MOTION)
            symbols.append(entries[place])
        segments.append(replace(segment, inertia=Inertia.of(entries)))
    tree = SegmentTree(tuple(segments))
    forces = generalised_inertia_forces(symbolic.tape, symbolic.root, tree, state)
    forces = systems.symbolic.folded(forces)
    directions = [{ref >> 1: imported.graph.one} for ref in systems.refs(symbols)]
    with imported.group("columns of the regressor"):
        return jacobian(imported.graph, systems.refs(forces), directions)


def _places(segment: Segment, k: int) -> list[int]:
    """Places of base parameters among the numbers of the inertia of segment k; all for the base."""
    parents = PARENTS_NUMBERS[segment.joint] if k else ()
    return [place for place, name in enumerate(NUMBERS) if name not in parents]
