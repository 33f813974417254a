"""A module's derivatives compared with those of its other functions, which are verified first.

What is whose derivative is in the table. References are complex steps of the NumPy kernels, but
where there is algebra. Derivatives of accelerations are compared as forces, multiplied by the mass
matrix, since that does not depend on how well-conditioned it is; where w multiplies them, they
cannot be. A regressor is right if its columns, and they alone, make up the forces of whatever
bodies the robot may have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import Body, RigidBody
from gibbs_codegen.verification.comparison import (
    UNKNOWN,
    Comparison,
    Results,
    compared,
    explained,
    failed,
)
from gibbs_codegen.verification.complex_steps import ComplexSteps
from gibbs_codegen.verification.constraints import Constraints
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import mapped, robot_numbers
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, cross, times

OTHER_FUNCTIONS, ZEROS = "other functions", "its PATTERNS"
# The limit of errors relative to natural sizes, here much more than rounding takes.
LIMIT = 1e-11
# Digits that accelerations lose for each of the condition of the mass matrix in its units.
_ROUNDING = 1e-13
# Rounding of the weighed sum, as a share of the error that its second derivatives may have.
_LOST = 0.01
# Sets of bodies that a regressor has to do for, and rows of it for each of its columns.
_SETS, _ROWS = 3, 3
# The generalised forces B u, of which no function gives the value alone.
_INPUT_FORCES = {"input_forces_derivatives": "jacobian", "input_forces_hessian": "hessian"}


class DerivativeRow(NamedTuple):
    """An array to compare, with its expected value and natural sizes."""

    label: str
    ours: Array
    theirs: Array
    size: Array


Values = Mapping[str, Array]
# What derivatives are made of, or measured by. A module that has not all of it was generated with
# few functions; its derivatives are those of one that has.
_NEEDED = (
    *("mass_matrix", "residual", "input_matrix", "forward_dynamics", "inverse_dynamics"),
    *("integrate", "coordinate_rates"),
)


def compare_derivatives(
    call: Results, steps: ComplexSteps, robot: Robot, states: States, circumstance: str = ""
) -> list[Comparison]:
    """Compare the arrays of the functions of a module that are generated on request.

    `steps` differentiates its NumPy back end with the robot's parameters. No state is next to a
    singular attitude; `circumstance` is added to the names of what is compared with.
    """
    if not call.has(*_NEEDED):
        return []
    point = _Point(call, steps, robot, states)
    comparisons: list[Comparison] = []
    for name, row in FUNCTIONS.items():
        comparable = row.derivative_of or name in _OTHERS or name in _INPUT_FORCES
        if name not in call.signatures or not comparable:
            continue
        values = call.results(name, states)
        against = OTHER_FUNCTIONS + circumstance
        try:
            with np.errstate(all="ignore"):
                if name in _OTHERS:
                    rows = list(_OTHERS[name](point, values))
                else:
                    function = point.function(row.derivative_of or "input_forces")
                    if isinstance(function, _OfConstraints):
                        rows = list(_constraint_rows(function, values))
                    else:
                        rows = list(_KINDS[row.kind or _INPUT_FORCES[name]](function, values))
        except Exception as error:  # Whatever was done to the module.
            rows = []
            comparisons += [failed(label, against, error) for label in values]
        comparisons += [
            compared(label, against, ours, theirs, size + np.abs(theirs), LIMIT)
            for label, ours, theirs, size in rows
        ]
        comparisons += _outside_patterns(call, name, values, ZEROS + circumstance)
    return explained(comparisons, call.faults)


def _outside_patterns(
    call: Results, name: str, values: Values, against: str
) -> Iterator[Comparison]:
    """Compare entries that are said to be zero at every state with zero."""
    patterns = getattr(call.module, "PATTERNS", {})
    for output, (label, array) in zip(FUNCTIONS[name].outputs, values.items(), strict=True):
        if output.name not in patterns:
            continue
        height = math.prod(array.shape[1:-1])  # Not −1: without columns that is not told.
        matrix = array.reshape(len(array), height, array.shape[-1]).copy()
        try:
            rows, columns = patterns[output.name]
            matrix[:, rows, columns] = 0.0
        except (IndexError, TypeError, ValueError) as error:
            yield failed(label, against, error)
            continue
        yield compared(label, against, matrix, np.zeros_like(matrix), 1.0, 0.0)


class _Point:
    """A back end of a robot's module, and states to compare its derivatives at.

    `units` are what one of each argument's entries is of the order of, as random states have them.
    """

    def __init__(self, call: Results, steps: ComplexSteps, robot: Robot, states: States) -> None:
        self.call, self.steps, self.robot, self.states = call, steps, robot, states
        self.tree = tree = Tree(robot)
        self.sizes = Sizes(tree, states)
        scales = tree.scales[tree.free]
        rates = scales * tree.tempo
        self.wrench = tree.mass * tree.reach * tree.tempo**2 * np.repeat([1.0, tree.reach], 3)
        wrenches = np.tile(self.wrench, states.W.shape[1])
        self.units = {"q": scales, "v": rates, "a": rates * tree.tempo, "u": tree.efforts}
        self.units |= {"q0": scales, "q1": scales, "W": wrenches}
        if tree.actuators is not None:
            levels, commands = tree.actuators.units(tree.efforts, tree.scales[tree.driven])
            self.units |= {"x": levels, "command": commands}

    @cached_property
    def actuators(self) -> Values:
        """Sizes (s, rows) of results of the functions of the actuators, by their names."""
        measured_of = formulated(NewtonEuler(self.tree)).at(self.states).actuators or {}
        return {name: measured.size for name, measured in measured_of.items()}

    def function(self, name: str) -> _Function:
        """A function that others are derivatives of."""
        if name in _ARRAYS:
            return _Array(self, name)
        if name in self.actuators:
            return _OfActuators(self, name)
        if name in FUNCTIONS and "CONSTRAINTS" in FUNCTIONS[name].needs:
            return _OfConstraints(self, name)
        return _Motion(self, name) if name in _MOTIONS else _Forces(self, name)


class _Function:
    """A function at the states of a point; `values` are its results, and sizes of their entries.

    `rows` are units of the results that the Jacobian is of, and `units` those of its columns.
    """

    values: list[tuple[Array, Array]]
    rows: Array

    def __init__(self, point: _Point, name: str) -> None:
        self.point, self.name = point, name
        letters = FUNCTIONS[name].arguments if name in FUNCTIONS else "qu"
        arguments = {x: getattr(point.states, x) for x in letters if x in point.units}
        self.at = {name: x.reshape(len(x), math.prod(x.shape[1:])) for name, x in arguments.items()}
        self.units = np.concatenate([point.units[letter] for letter in self.at])
        self.value = self(**self.at)

    def __call__(self, **arguments: Array) -> Array:
        """The result (…, rows) at arguments (…, width), which may be complex or dual."""
        return self.point.steps(self.name, *arguments.values())

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives (s, rows …, columns) by all arguments."""
        return self.point.steps.jacobian(self, self.at)

    @property
    def size(self) -> Array:
        """Sizes of the entries of the Jacobian: one, that of the largest, in their units."""
        units = self.rows[..., None] / self.units
        shares = np.abs(self.jacobian / units)
        axes = tuple(range(1, shares.ndim))
        largest: Array = shares.max(axis=axes, keepdims=True, initial=0.0)
        return largest * units

    def as_forces(self, array: Array) -> Array:
        """The compared part of results and of their derivatives, (s, rows, …)."""
        return array


class _Array(_Function):
    """A displacement or a matrix, whose derivatives are all measured by the largest of them.

    `rows` are the units of the entries (…, 1). `w` are the weights of a matrix.
    """

    def __init__(self, point: _Point, name: str) -> None:
        super().__init__(point, name)
        weights, rows = _ARRAYS[name]
        self.w = getattr(point.states, weights) if weights else np.zeros(0)
        self.rows = rows(point)
        size = np.abs(self.value / self.rows).reshape(len(self.value), -1).max(axis=-1, initial=0.0)
        if name == "difference":  # A short one is the difference of coordinates, and as exact.
            size = np.maximum(size, 1.0)
        axes = (1,) * (self.value.ndim - 1)
        self.values = [(self.value, size.reshape(-1, *axes) * self.rows)]


class _OfActuators(_Function):
    """A function of the actuators, whose derivatives are measured by the terms of each result."""

    def __init__(self, point: _Point, name: str) -> None:
        super().__init__(point, name)
        self.effort = point.actuators[name]
        self.values = [(self.value, self.effort)]

    @property
    def size(self) -> Array:
        """Sizes of the entries of the Jacobian."""
        return self.size_by(self.units)

    def size_by(self, units: Array) -> Array:
        """Sizes (s, rows, columns) of derivatives by what has such units."""
        return self.effort[:, :, None] / units


class _OfConstraints(_Function):
    """Functions of the constraints, whose derivatives are measured by the largest of each result.

    Results follow one another; errors grow with the condition of what is solved for the forces.
    What forces or impulses hold may be rounding alone: it is as large as what these do to it.
    """

    def __init__(self, point: _Point, name: str) -> None:
        super().__init__(point, name)
        self._measure = _Measure(point.tree, point.states, name)
        shapes = [shape for (shape,) in point.call.signatures[name].shapes]
        self.parts = np.split(np.arange(self.value.shape[-1]), np.cumsum(shapes)[:-1])
        self.values = [
            (self.value[:, part], self._largest(self.value, part)) for part in self.parts
        ]

    def __call__(self, **arguments: Array) -> Array:
        """The results (…, rows), one after the other."""
        first = next(iter(arguments.values()))
        fixed = [x for x in FUNCTIONS[self.name].arguments if x not in arguments]
        others = [getattr(self.point.states, name) for name in fixed]
        others = [x.reshape(len(x), *[1] * (first.ndim - 2), x.shape[-1]) for x in others]
        return self.point.steps(self.name, *arguments.values(), *others)

    def _largest(self, array: Array, part: Array) -> Array:
        """Sizes of some rows of an array (s, rows …): the largest, stretched."""
        first = len(self.parts) == 2 and part is self.parts[0]
        size = self._measure([array[:, part]], [array[:, self.parts[1]]] if first else [])
        return np.broadcast_to(size.reshape(-1, *[1] * (array.ndim - 1)), array[:, part].shape)


class _Measure:
    """Sizes (s) of results of a function of a robot's constraints at some states."""

    def __init__(self, tree: Tree, states: States, name: str) -> None:
        quantities = formulated(NewtonEuler(tree)).at(states).with_passive(tree, states)
        constraints, sizes = Constraints(tree, float(np.finfo(float).eps)), Sizes(tree, states)
        self._stretch, self._moved = constraints.conditions(quantities, states, sizes)
        if "active" not in FUNCTIONS[name].arguments:  # Nothing is solved.
            self._stretch = np.ones(len(states))

    def __call__(self, arrays: Sequence[Array], forces: Sequence[Array]) -> Array:
        """The largest entries of arrays (s, …) and of what forces (s, l, …) move, stretched."""
        count, _, rows = self._moved.shape
        moves = [np.abs(self._moved) @ np.abs(x).reshape(count, rows, -1) for x in forces]
        sizes = [np.abs(x).reshape(count, -1).max(axis=-1, initial=0.0) for x in [*arrays, *moves]]
        clear = np.isfinite(self._stretch)
        size: Array = np.max(sizes, axis=0) * np.where(clear, self._stretch, 1.0)
        return size + np.where(clear, 0.0, UNKNOWN)


def constraint_sizes(robots: Sequence[Robot], states: States, name: str, values: Values) -> Values:
    """Sizes (s, 1 …) of results of a derivative of the effects of constraints; else nothing.

    For one robot, or for one robot for each state.
    """
    row = FUNCTIONS[name]
    if not row.derivative_of or "CONSTRAINTS" not in row.needs:
        return {}
    measures = [_Measure(Tree(robot), states, name) for robot in robots]
    arrays, size_of = list(values.values()), dict[str, Array]()
    count = len(arrays) // len(FUNCTIONS[row.derivative_of].outputs)
    for label, array in values.items():
        # Rates of accelerations come before those of forces.
        some, forces = arrays[:count], arrays[count:]
        if len(size_of) >= count:
            some, forces = forces, []
        measured = np.array([measure(some, forces) for measure in measures])
        size = measured[0] if len(robots) == 1 else np.diagonal(measured)
        size_of[label] = size.reshape(-1, *[1] * (array.ndim - 1))
    return size_of


def _constraint_rows(function: _OfConstraints, values: Values) -> Iterator[DerivativeRow]:
    """Results and their Jacobians by each argument, one result after the other."""
    widths = [len(function.point.units[letter]) for letter in function.at]
    columns = np.split(np.arange(sum(widths)), np.cumsum(widths)[:-1])
    rows = iter(values.items())
    for part, (value, size) in zip(function.parts, function.values, strict=True):
        label, ours = next(rows)
        yield DerivativeRow(label, ours, value, size)
        for some in columns:
            label, ours = next(rows)
            theirs = function.jacobian[..., some]
            # In the units of the columns, and beside the values.
            units = function.units[some]
            scaled = function._largest(theirs * units, part) + size[:, :, None]
            yield DerivativeRow(label, ours, theirs[:, part], scaled / units)


# Weights of an array's entries, and their units.
_ARRAYS: dict[str, tuple[str, Callable[[_Point], Array]]] = {
    "difference": ("", lambda point: point.units["q"]),
    "input_matrix": (
        "w_input_matrix",
        lambda point: point.wrench[-1] / np.outer(point.units["q"], point.units["u"]),
    ),
    "centre_of_mass_jacobian": (
        "w_jacobian",
        lambda point: np.tile(point.tree.reach / point.units["q"], (3, 1)),
    ),
    "frame_poses": (
        "",
        lambda point: np.pad(
            np.full((3, 1), point.tree.reach), ((0, 1), (3, 0)), constant_values=1.0
        ),
    ),
    "frame_velocities": ("", lambda point: _twist(point, 1)),
    "frame_bias_accelerations": ("", lambda point: _twist(point, 2)),
    "joint_wrenches_with_wrenches": ("", lambda point: point.wrench),
}


def _twist(point: _Point, rates: int) -> Array:
    """Units of a velocity, or of an acceleration with two `rates`, linear and then angular."""
    return point.tree.tempo**rates * np.repeat([point.tree.reach, 1.0], 3)


class _Motion(_Function):
    """A change to other coordinates; its Jacobian is that of displacements there."""

    def __init__(self, point: _Point, name: str) -> None:
        self._method = _MOTIONS[name]
        self._h = point.call.stepping(point.states).h if name != "integrate" else np.zeros(0)
        super().__init__(point, name)
        q, v = np.split(self.value, [point.states.q.shape[-1]], axis=-1)
        ends = (q, v) if v.size else (q,)
        self.values = [(x, np.abs(x).max(-1, keepdims=True) * np.ones_like(x)) for x in ends]
        displaced = point.units["q"]
        self.rows = np.concatenate([displaced, point.units["v"]]) if v.size else displaced
        if name == "integrate":  # Here v is a displacement.
            self.units = np.tile(displaced, 2)

    def __call__(self, **arguments: Array) -> Array:
        """Coordinates, and velocities after a step, (…, rows)."""
        q, *others = arguments.values()
        if self.name != "integrate":
            others.append(self._h.reshape(-1, *[1] * (q.ndim - 1)))
        return np.concatenate(self._method(self.point.steps, q, *others), axis=-1)

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives (s, nv or 2 nv, columns) of displacements, and of velocities."""
        rates = self.point.steps.jacobian(self, self.at)
        (q, _), *_ = self.values
        of_q, of_v = np.split(rates, [q.shape[-1]], axis=1)
        return np.concatenate([self.point.steps.displacements(q, of_q), of_v], axis=1)


def _euler(steps: ComplexSteps, q: Array, v: Array, u: Array, h: Array) -> tuple[Array, ...]:
    """Coordinates and velocities after a semi-implicit Euler step of length h."""
    after = v + h * steps("forward_dynamics", q, v, u)
    return steps("integrate", q, h * after), after


def _rk4(steps: ComplexSteps, q: Array, k1: Array, u: Array, h: Array) -> tuple[Array, ...]:
    """Coordinates and velocities after a step of the classical Runge–Kutta method.

    It moves on the manifold by exponentials alone (Celledoni, Marthinsen and Owren, 2003).
    """

    def accelerations(q: Array, v: Array) -> Array:
        return steps("forward_dynamics", q, v, u)

    a1 = accelerations(q, k1)
    second, k2 = steps("integrate", q, 0.5 * h * k1), k1 + 0.5 * h * a1
    a2 = accelerations(second, k2)
    third, k3 = steps("integrate", q, 0.5 * h * k2), k1 + 0.5 * h * a2
    a3 = accelerations(third, k3)
    fourth, k4 = steps("integrate", second, h * (k3 - 0.5 * k1)), k1 + h * a3
    a4 = accelerations(fourth, k4)
    half = steps("integrate", q, h / 12 * (3 * k1 + 2 * k2 + 2 * k3 - k4))
    whole = steps("integrate", half, h / 12 * (-k1 + 2 * k2 + 2 * k3 + 3 * k4))
    return whole, k1 + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


_MOTIONS: dict[str, Callable[..., tuple[Array, ...]]] = {
    "integrate": lambda steps, q, v: (steps("integrate", q, v),),
    "step_euler": _euler,
    "step_rk4": _rk4,
}


class _Forces(_Function):
    """Inverse or forward dynamics, or the forces B u, and the sizes of forces in them.

    `effort` (s, nv) has these, `w` the weights of results, and `weights` the sizes of what these
    weights are of forces.
    """

    def __init__(self, point: _Point, name: str) -> None:
        super().__init__(point, name)
        states, sizes = point.states, point.sizes
        self.w, self.weights = states.w, np.abs(states.w)
        self.matrix, self.loss = None, np.zeros(len(states))
        if name == "inverse_dynamics":
            self.effort = sizes.free_inertial_effort
        elif name == "input_forces":
            # From the largest terms that they are summed from.
            terms = times(np.abs(point.call("input_matrix", states.q)), np.abs(states.u))
            units = point.units["q"]
            self.effort = (units * terms).max(axis=-1, keepdims=True) / units
        else:
            self.effort, units = sizes.balance(self.value), sizes.free_units
            if "W" in self.at:
                self.effort = self.effort + sizes.free_pushed
            self.matrix = matrix = point.call("mass_matrix", states.q)
            scaled = matrix / sizes.free_matrix
            finite = np.isfinite(scaled).all(axis=(1, 2))
            condition = np.linalg.cond(np.where(finite[:, None, None], scaled, 0.0))
            self.loss = condition * _ROUNDING / LIMIT
            try:
                forces = np.abs(np.linalg.solve(matrix, self.w[..., None])[..., 0])
            except np.linalg.LinAlgError:
                forces = np.full_like(self.w, np.nan)
            # In rounding the largest counts for all.
            largest = (units * forces).max(axis=-1, keepdims=True) / units
            self.weights = forces + self.loss[:, None] * largest
        self.values = [(self.as_forces(self.value), self.effort)]

    def __call__(self, **arguments: Array) -> Array:
        """The result (…, nv)."""
        if self.name != "input_forces":
            return super().__call__(**arguments)
        q, u = arguments.values()
        return (self.point.steps("input_matrix", q) * u[..., None, :]).sum(-1)

    def as_forces(self, array: Array) -> Array:
        """Accelerations, or derivatives of them, (s, nv, …) times the mass matrix."""
        return array if self.matrix is None else np.einsum("sij,sj...->si...", self.matrix, array)

    @property
    def size(self) -> Array:
        """Sizes of the entries as forces; those of accelerations stand for inertial forces."""
        return self.size_by(self.units) + self.inertial(self.jacobian)

    def size_by(self, units: Array) -> Array:
        """Sizes (s, nv, columns) of derivatives of the forces by what has such units."""
        return self.effort[:, :, None] / units * (1 + self.loss[:, None, None])

    def inertial(self, slopes: Array) -> Array:
        """Sizes of the inertial forces of derivatives (s, nv, …) of accelerations; 0 of forces."""
        if self.matrix is None:
            return np.zeros_like(slopes)
        units = self.point.sizes.free_units.reshape(*slopes.shape[:2], *[1] * (slopes.ndim - 2))
        largest = np.abs(units * slopes).max(axis=1, keepdims=True)
        return units * largest * (1 + self.loss.reshape(-1, *[1] * (slopes.ndim - 1)))


def _value_rows(function: _Function, values: Values) -> Iterator[DerivativeRow]:
    """The results of a function."""
    for (label, ours), (theirs, size) in zip(values.items(), function.values, strict=False):
        yield DerivativeRow(label, function.as_forces(ours), theirs, size)


def _jacobian_rows(function: _Function, values: Values) -> Iterator[DerivativeRow]:
    """The Jacobians, whose columns follow one another, and the results where they come first."""
    axes, shape = function.jacobian.ndim, function.jacobian.shape[:-1]
    yield from _value_rows(function, {n: x for n, x in values.items() if x.ndim < axes})
    # Those by wrenches have an axis more.
    matrices = {
        label: matrix.reshape(*shape, math.prod(matrix.shape[axes - 1 :]))
        if matrix.shape[: axes - 1] == shape
        else matrix
        for label, matrix in values.items()
        if matrix.ndim >= axes
    }
    ends = np.cumsum([matrix.shape[-1] for matrix in matrices.values()])
    for (label, ours), end in zip(matrices.items(), ends, strict=True):
        columns = (..., slice(end - ours.shape[-1], end))
        theirs, size = function.jacobian[columns], function.size[columns]
        yield DerivativeRow(label, function.as_forces(ours), function.as_forces(theirs), size)


def _jvp_rows(function: _Forces | _Array, values: Values) -> Iterator[DerivativeRow]:
    """The product of the Jacobians with a direction."""
    states, count = function.point.states, len(function.value)
    parts = [getattr(states, f"{x}_dot").reshape(count, -1) for x in function.at]
    direction = np.concatenate(parts, axis=-1)
    if isinstance(function, _Array):
        theirs, size = (
            np.einsum("s...j,sj->s...", x, y)
            for x, y in ((function.jacobian, direction), (function.size, np.abs(direction)))
        )
        for label, ours in values.items():
            yield DerivativeRow(label, ours, theirs, size)
        return
    theirs = times(function.jacobian, direction)
    size = times(function.size_by(function.units), np.abs(direction)) + function.inertial(theirs)
    for label, ours in values.items():
        yield DerivativeRow(label, function.as_forces(ours), function.as_forces(theirs), size)


def _vjp_rows(function: _Forces | _Array, values: Values) -> Iterator[DerivativeRow]:
    """The gradients: products of weights with the Jacobians."""
    if isinstance(function, _Array):
        theirs, size = (
            np.einsum("sikj,sik->sj", x, y)
            for x, y in ((function.jacobian, function.w), (function.size, np.abs(function.w)))
        )
    else:
        theirs = np.einsum("sij,si->sj", function.jacobian, function.w)
        size = np.einsum("sij,si->sj", function.size_by(function.units), function.weights)
    ends = np.cumsum([math.prod(gradient.shape[1:]) for gradient in values.values()])[:-1]
    parts = (np.split(x, ends, axis=-1) for x in (theirs, size))
    for (label, ours), expected, part in zip(values.items(), *parts, strict=True):
        flat = ours.reshape(expected.shape) if ours.size == expected.size else ours
        yield DerivativeRow(label, flat, expected, part)


def _hessian_rows(function: _Forces, values: Values) -> Iterator[DerivativeRow]:
    """Second derivatives of weighed results, by blocks that are named by two arguments."""
    theirs = function.point.steps.hessian(function, function.at, function.w)
    weighed = np.sum(function.weights * function.effort, axis=-1)[:, None, None]
    scale = function.units[:, None] * function.units
    # Entries are as large as those of their rows and columns, and what rounding leaves of forces.
    rows = np.abs(theirs * scale).max(axis=-1)
    size = (np.sqrt(rows[:, :, None] * rows[:, None, :]) + _LOST * weighed) / scale
    widths = [len(function.point.units[letter]) for letter in function.at]
    ends = np.cumsum(widths)
    places = {x: slice(e - w, e) for x, e, w in zip(function.at, ends, widths, strict=True)}
    for label, ours in values.items():
        block = tuple(places.get(letter, slice(None)) for letter in label[-2:])
        yield DerivativeRow(label, ours, theirs[:, *block], size[:, *block])


def _parameter_rows(function: _Forces | _OfActuators, values: Values) -> Iterator[DerivativeRow]:
    """Derivatives by the parameters, of the results or of their weighed sum."""
    point, numbers = function.point, robot_numbers(function.point.robot)
    natural = point.tree.reach, point.robot.total_mass, 1.0 / point.tree.tempo
    pairs = [numbers[name] for name in point.call.module.PARAMETERS]
    theirs = point.steps.by_parameters(function, function.at)
    size = function.size_by(np.array([abs(x) or of.unit(*natural) for x, of in pairs]))
    # Zeros of what is no zero have no derivative.
    smooth = [x != 0.0 or not of.no_zero for x, of in pairs]
    for label, ours in values.items():
        if isinstance(function, _Forces) and ours.ndim < theirs.ndim:
            theirs = np.einsum("sij,si->sj", theirs, function.w)
            size = np.einsum("sij,si->sj", size, function.weights)
        yield DerivativeRow(label, ours[..., smooth], theirs[..., smooth], size[..., smooth])


def _coriolis_rows(point: _Point, values: Values) -> Iterator[DerivativeRow]:
    """C v is the part of velocities in the forces, and Ṁ − 2 C is skew-symmetric."""
    states, sizes, call = point.states, point.sizes, point.call
    ((label, coriolis),) = values.items()
    tree = point.tree
    damped = tree.passive.damped(tree.at_joints(states.q), tree.spread(states.v))[:, tree.free]
    still = call("residual", states.q, 0.0 * states.v)
    forces = still - call("residual", states.q, states.v) - damped
    yield DerivativeRow(f"{label}.product", times(coriolis, states.v), forces, sizes.free_effort)
    size = sizes.free_matrix * sizes.rate[:, None, None]
    both = coriolis + np.swapaxes(coriolis, -1, -2)
    yield DerivativeRow(f"{label}.symmetric_part", both, _matrix_rate(point), size)


def _matrix_rate(point: _Point) -> Array:
    """Ṁ."""
    by_q = point.steps.jacobian(lambda q: point.steps("mass_matrix", q), {"q": point.states.q})
    return times(by_q, point.states.v[:, None])


def _momentum_rows(point: _Point, values: Values) -> Iterator[DerivativeRow]:
    """The momentum is M v, and ṗ = R + Ṁ v where nothing is put in."""
    states, sizes, call = point.states, point.sizes, point.call
    ((label, ours),) = values.items()
    if label == "momentum":
        theirs = times(call("mass_matrix", states.q), states.v)
        yield DerivativeRow(label, ours, theirs, sizes.free_units * sizes.largest(states.v))
        return
    theirs = call("residual", states.q, states.v) + times(_matrix_rate(point), states.v)
    yield DerivativeRow(label, ours, theirs, sizes.free_effort)


def _reference_rows(point: _Point, values: Values) -> Iterator[DerivativeRow]:
    """Forces, or their regressor, of reference velocities, by those of velocities themselves.

    The terms of velocities are quadratic forms, and with a base's own axes there are accelerations
    for half of what two velocities do to each other: polarised.
    """
    states, sizes, tree = point.states, point.sizes, point.tree
    ((label, ours),) = values.items()
    passive = label == "passive_inverse_dynamics"

    def at(v: Array, a: Array) -> Array:
        if passive:
            return point.call("inverse_dynamics", states.q, v, a)
        return point.call(label, states.q, v, v, a)

    bracket, none = np.zeros_like(states.v), np.zeros_like(states.v)
    if tree.layout.turns_with_base:
        places, (along, about) = tree.layout.v, tree.layout.own_axes
        twists = np.zeros((2, 2, len(states), 3))
        for twist, x in zip(twists, (states.v, states.v_r), strict=True):
            twist[0][:, along], twist[1][:, about] = x[:, places.position], x[:, places.attitude]
        (drift, spin), (drift_r, spin_r) = twists
        linear = cross(spin, drift_r) - cross(spin_r, drift)
        bracket[:, places.position] = linear[:, along]
        bracket[:, places.attitude] = cross(spin, spin_r)[:, about]
    mean, half = (0.5 * (states.v + sign * states.v_r) for sign in (1.0, -1.0))
    theirs = at(mean, states.a_r + 0.5 * bracket) - at(half, none) + at(none, none)
    size = sizes.free_inertial_effort
    if not passive:
        size = np.abs(theirs).max(axis=(1, 2), keepdims=True)
        yield from _regressor_rows(point, values)
    yield DerivativeRow(label, ours, theirs, size)


def _regressor_rows(point: _Point, values: Values) -> Iterator[DerivativeRow]:
    """The regressor's columns make up the forces of all bodies that the robot may have.

    Rotors behind gears are none of these: with the carrier and the link they count for columns.
    """
    ((label, ours),) = values.items()
    count = -(-_ROWS * ours.shape[-1] // ours.shape[-2])
    states = States.random(point.tree, count, 0)
    matrix = _regressor(point, label, states)
    rng = np.random.default_rng(0)
    forces, efforts = [], []
    reach, mass = point.tree.reach, point.tree.mass

    def other_body(body: Body) -> Body:  # As large as the robot's; it may be impossible.
        com, inertia = reach * rng.normal(size=3), mass * reach**2 * rng.normal(size=6)
        return RigidBody(body.length, mass * rng.uniform(0.5, 1.0), (*com,), (*inertia,))

    bodies = replace(point.robot, links=tuple(replace(x, motor=None) for x in point.robot.links))
    for _ in range(_SETS):
        other = Tree(mapped(bodies, lambda _, value, __: value, other_body))
        quantities = formulated(NewtonEuler(other)).at(states)
        forces.append(other.folded(quantities.inverse_dynamics)[:, other.free])
        efforts.append(Sizes(other, states).free_inertial_effort)
    theirs, size = np.stack(forces, axis=-1), np.stack(efforts, axis=-1)
    # The combination of the columns that is nearest to the forces.
    units = size.max(axis=-1, keepdims=True)
    columns, wanted = ((x / units).reshape(-1, x.shape[-1]) for x in (matrix, theirs))
    found_forces = np.full_like(theirs, np.nan)
    if np.isfinite(columns).all():
        lengths = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(lengths > 0.0, lengths, 1.0)
        solution = np.linalg.lstsq(columns, wanted, rcond=None)[0]
        found_forces = (columns @ solution).reshape(theirs.shape) * units
    yield DerivativeRow(f"{label}.columns", found_forces, theirs, size)


def _regressor(point: _Point, label: str, states: States) -> Array:
    """A regressor; that of a reference for one that is the motion itself."""
    letters = (letter.removesuffix("_r") for letter in FUNCTIONS[label].arguments)
    return point.call(label, *(getattr(states, letter) for letter in letters))


def _base_parameter_rows(point: _Point, values: Values) -> Iterator[DerivativeRow]:
    """The regressor times the base parameters is the inertial part of the forces.

    `values` has one copy of these for each state; no row where the module has no regressor.
    """
    states, sizes, tree, call = point.states, point.sizes, point.tree, point.call
    names = [x for x in ("regressor", "reference_regressor") if x in call.signatures]
    if not names:
        return
    regressor = _regressor(point, names[0], states)
    q, v, a = tree.at_joints(states.q), tree.spread(states.v), tree.spread(states.a)
    passive = (tree.passive.armature + tree.passive.reflected) * a - tree.passive.forces(q, v)
    theirs = call("inverse_dynamics", states.q, states.v, states.a)
    theirs -= tree.folded(passive)[:, tree.free]
    for label, parameters in values.items():
        ours = times(regressor, parameters)
        size = sizes.free_inertial_effort
        yield DerivativeRow(f"{label}.product", ours, theirs, size)


_KINDS: dict[str, Callable[..., Iterator[DerivativeRow]]] = {
    "jacobian": _jacobian_rows,
    "jvp": _jvp_rows,
    "vjp": _vjp_rows,
    "hessian": _hessian_rows,
    "parameters": _parameter_rows,
}
_OTHERS: dict[str, Callable[[_Point, Values], Iterator[DerivativeRow]]] = {
    "step_euler": lambda point, values: _value_rows(point.function("step_euler"), values),
    "step_rk4": lambda point, values: _value_rows(point.function("step_rk4"), values),
    "momentum": _momentum_rows,
    "momentum_rate": _momentum_rows,
    "passive_inverse_dynamics": _reference_rows,
    "reference_regressor": _reference_rows,
    "coriolis_matrix": _coriolis_rows,
    "regressor": _regressor_rows,
    "base_parameters": _base_parameter_rows,
}
