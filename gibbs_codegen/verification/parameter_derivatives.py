"""What the regressor, the base parameters and derivatives by parameters should be.

The equations of motion are sums of products of few parameters, so that differences by these lose
nothing but digits. A regressor is right if its columns, and they alone, make up the forces of
whatever bodies the robot may have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.robot.model import Body, RigidBody, Robot
from gibbs_codegen.verification.comparison import Evaluation
from gibbs_codegen.verification.derivative_row import EXACT, SLOPE, DerivativeRow, Point
from gibbs_codegen.verification.dynamics_derivatives import Dynamics
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import Dimension, mapped, parameter_values
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, times

# Steps to try, as shares of a parameter: some leave an acceleration undetermined.
_SHARES = (0.05, -0.05, 0.005, -0.005)
# Differences from a parameter to one side of it, exact up to fourth powers.
_WEIGHTS = (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4)
# A few units in the last place.
_ROUNDING = 1e-15
# Sets of bodies that a regressor has to do for, and rows of it for each of its columns.
_SETS, _ROWS = 3, 3


def parameter_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """Derivatives of generalised forces by the parameters."""
    states, sizes = point.states, point.sizes

    def forces(call: Evaluation) -> Array:
        return call("inverse_dynamics", states.q, states.v, states.a)

    for what, ours in values.items():
        theirs, size = _by_parameters(forces, point, sizes.free_inertial_effort)
        yield DerivativeRow(what, ours, theirs, size, EXACT)


def weighed_parameter_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """The gradient of weighed accelerations by the parameters."""
    states, forward = point.states, Dynamics(point, True)

    def lacking(call: Evaluation) -> Array:
        driven = times(call("input_matrix", states.q), states.u)
        return driven - call("inverse_dynamics", states.q, states.v, forward.value)

    for what, ours in values.items():
        by_parameters, sizes = _by_parameters(lacking, point, forward.effort)
        theirs = times(np.swapaxes(by_parameters, -1, -2), forward.multipliers)
        size = times(np.swapaxes(sizes, -1, -2), forward.weights)
        yield DerivativeRow(what, ours, theirs, size, SLOPE)


def _by_parameters(
    forces: Callable[[Evaluation], Array], point: Point, effort: Array
) -> tuple[Array, Array]:
    """Derivatives of forces (s, nv) by a module's parameters, and their sizes, (s, nv, np).

    `effort` (s, nv) has the sizes of the forces.
    """
    module, numbers = point.call.module, parameter_values(point.robot)
    units: dict[str, float] = {}
    reach, mass, period = point.tree.reach, point.robot.total_mass, 1.0 / point.tree.tempo

    def note(name: str, value: float, dimension: Dimension) -> float:
        units[name] = abs(value) or dimension.unit(reach, mass, period)
        return value

    mapped(point.robot, note)
    given = {name: numbers[name] for name in module.PARAMETERS}
    slopes, sizes = [], []
    for name in given:
        step, made = _steps(module, given, name, units[name])
        values = [w * forces(Evaluation(module, k)) for w, k in zip(_WEIGHTS, made, strict=True)]
        slopes.append(sum(values[1:], values[0]) / step)
        # With another parameter forces may be larger, and what rounding leaves of them as well.
        rounded = np.max(np.abs(values), axis=(0, 2))[:, None] * _ROUNDING / EXACT / abs(step)
        sizes.append(effort / units[name] + rounded)
    return np.stack(slopes, axis=-1), np.stack(sizes, axis=-1)


def _steps(
    module: ModuleType, given: Mapping[str, float], name: str, unit: float
) -> tuple[float, list[Any]]:
    """Step of one parameter, of natural size `unit`, and a module's constants after 0, 1, … steps.

    Raises `ValueError` if the module rejects them, however the parameter is changed.
    """
    for share in _SHARES:
        step = share * unit
        numbers = (given[name] + count * step for count in range(len(_WEIGHTS)))
        try:
            return step, [module.prepare({**given, name: number}) for number in numbers]
        except ValueError as error:
            rejected = error
    raise rejected


def regressor_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """The regressor's columns make up the forces of all bodies that the robot may have."""
    for what, ours in values.items():
        count = -(-_ROWS * ours.shape[-1] // ours.shape[-2])
        states = States.random(point.tree, count, 0)
        matrix = point.call.results(what, states)[what]
        rng = np.random.default_rng(0)
        forces, efforts = [], []
        for _ in range(_SETS):
            other = Tree(_with_bodies(point.robot, point.tree, rng))
            found = formulated(NewtonEuler(other)).at(states)
            forces.append(found.inverse_dynamics[:, other.free])
            efforts.append(Sizes(other, states).free_inertial_effort)
        theirs, size = np.stack(forces, axis=-1), np.stack(efforts, axis=-1)
        found_forces = _projected(matrix, theirs, size.max(axis=-1, keepdims=True))
        yield DerivativeRow(f"{what}.columns", found_forces, theirs, size, EXACT)


def base_parameter_rows(point: Point, values: Mapping[str, Array]) -> Iterator[DerivativeRow]:
    """The regressor times the base parameters is the inertial part of the forces.

    `values` has one copy of these for each state; no row where the module has no regressor.
    """
    states, sizes, tree, call = point.states, point.sizes, point.tree, point.call
    if "regressor" not in call.signatures:
        return
    regressor = call.results("regressor", states)["regressor"]
    q, v, a = tree.at_joints(states.q), tree.spread(states.v), tree.spread(states.a)
    passive = tree.passive.armature * a - tree.passive.forces(q, v)
    theirs = call("inverse_dynamics", states.q, states.v, states.a) - passive[:, tree.free]
    for what, parameters in values.items():
        ours = times(regressor, parameters)
        size = sizes.free_inertial_effort
        yield DerivativeRow(f"{what}.product", ours, theirs, size, EXACT)


def _with_bodies(robot: Robot, tree: Tree, rng: np.random.Generator) -> Robot:
    """The robot with other masses, centres and inertias of its size, which may be impossible."""

    def other(body: Body) -> Body:
        com, inertia = tree.reach * rng.normal(size=3), tree.reach**2 * rng.normal(size=6)
        mass = tree.mass * rng.uniform(0.5, 1.0)
        return RigidBody(body.length, mass, tuple(com), tuple(tree.mass * inertia))

    return mapped(robot, lambda _, value, __: value, other)


def _projected(matrix: Array, forces: Array, units: Array) -> Array:
    """What is nearest to forces (s, nv, sets) among combinations of a matrix's columns, (s, nv, ·).

    `units` (s, nv, 1) are the sizes of the rows.
    """
    columns, wanted = ((x / units).reshape(-1, x.shape[-1]) for x in (matrix, forces))
    if not np.isfinite(columns).all():
        return np.full_like(forces, np.nan)
    lengths = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(lengths > 0.0, lengths, 1.0)
    solution = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    nearest: Array = (columns @ solution).reshape(forces.shape) * units
    return nearest
