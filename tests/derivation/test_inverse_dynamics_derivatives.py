"""Derivatives of inverse dynamics by moments, against exact ones of the same equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
import pytest
import sympy as sp
from support.complex_tape import derivatives, inputs_at, stepped, tape_values
from support.random_robots import SEQUENCES, random_robot, random_tree

from benchmarks.family import benchmark_robot, two_arms
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.derivation.inverse_dynamics import inverse_dynamics, inverse_dynamics_derivatives
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.program.lower import Slice, lower, operations
from gibbs_codegen.program.nodes import Number, ScalarProgram
from gibbs_codegen.robot.layout import Places, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import ROD_ORIGINS, Attitude
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import Matrix

OUTPUTS = ("force", "force_dq", "force_dv", "mass_matrix")


@dataclass(frozen=True)
class Derived:
    """A robot's derivatives and its inverse dynamics as a program, with values to put in."""

    symbolic: SymbolicRobot
    equations: dict[str, tuple[sp.Expr, ...]]
    program: ScalarProgram
    parameters: dict[str, float]

    @classmethod
    def of(cls, robot: Robot) -> Derived:
        """Derive both on one tape."""
        tape = Tape()
        symbolic = SymbolicRobot.of(robot, tape)
        found = inverse_dynamics_derivatives(symbolic)
        size = symbolic.places.size
        matrices = map(flat, (found.force_dq, found.force_dv, found.mass_matrix))
        equations = dict(zip(OUTPUTS, (tuple(found.force), *matrices), strict=True))
        outputs = [
            ((size,) if name == "force" else (size, size), entries)
            for name, entries in equations.items()
        ]
        forces = ((size,), tuple(inverse_dynamics(symbolic)))
        arguments = ("q", "v", "a")
        inputs = {
            letter: tuple(symbol.name for symbol in getattr(symbolic, letter))
            for letter in arguments
        }
        defaults = symbolic.parameters.defaults
        program = lower(
            tape,
            inputs,
            tuple(defaults),
            [
                Slice("derivatives", arguments, tuple(outputs)),
                Slice("inverse_dynamics", arguments, (forces,)),
            ],
        )
        parameters = {name: defaults[name] for name in program.parameters}
        return cls(symbolic, {**equations, "force": forces[1]}, program, parameters)

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.symbolic.robot

    @property
    def places(self) -> Places:
        """Where velocities and accelerations stand."""
        return self.symbolic.places

    def state(self, seed: int) -> dict[str, np.ndarray]:
        """A random state, its quaternion of unit length."""
        rng = np.random.default_rng(seed)
        state = {name: rng.uniform(-1.0, 1.0, len(self.program.inputs[name])) for name in "qva"}
        layout = layout_of(self.robot)
        if layout.is_quaternion:
            attitude = state["q"][layout.q.attitude]
            state["q"][layout.q.attitude] = attitude / np.linalg.norm(attitude)
        return state

    def forces(self, state: dict[str, np.ndarray]) -> np.ndarray:
        """Inverse dynamics."""
        return np.array(self.program.evaluate("inverse_dynamics", self.parameters, state)[0])

    def found(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What the recursion gives."""
        outputs = self.program.evaluate("derivatives", self.parameters, state)
        size = self.places.size
        found = {name: np.array(output) for name, output in zip(OUTPUTS, outputs, strict=True)}
        return {
            name: array if name == "force" else array.reshape(size, size)
            for name, array in found.items()
        }

    def exact(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The same by complex steps of the inverse dynamics."""
        directions = {"q": self.displacements(state["q"]), "v": np.eye(self.places.size)}
        directions["a"] = directions["v"]
        exact = {name: self.rates("force", state, {name: d}) for name, d in directions.items()}
        entries = (self.forces(state), exact["q"], exact["v"], exact["a"])
        return dict(zip(OUTPUTS, entries, strict=True))

    def rates(
        self, name: str, state: dict[str, np.ndarray], directions: dict[str, np.ndarray]
    ) -> np.ndarray:
        """Derivatives of an output along directions of an argument, which are columns."""
        ((argument, along),) = directions.items()
        moved = {**state, argument: stepped(state[argument], along)}
        values = tape_values(self.symbolic.tape, inputs_at(self.symbolic, moved))
        return derivatives(values, self.equations[name], along.shape[1])

    def displacements(self, q: np.ndarray) -> np.ndarray:
        """Rates of the coordinates per unit of each velocity."""
        layout = layout_of(self.robot)
        if not layout.is_quaternion:
            return np.eye(self.places.size)
        rates = np.zeros((layout.q.size, self.places.size))
        rates[layout.q.joints, self.places.joints] = np.eye(len(self.robot.moving))
        x, y, z, w = q[layout.q.attitude]
        rates[layout.q.attitude, self.places.attitude] = 0.5 * np.array(
            [[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]
        )
        return rates


def slow(seed: int) -> object:
    return pytest.param(seed, marks=pytest.mark.slow)


def flat(matrix: Matrix) -> tuple[sp.Expr, ...]:
    return tuple(entry for row in matrix for entry in row)


def compare(robot: Robot) -> Derived:
    derived = Derived.of(robot)
    state = derived.state(len(robot.links))
    found, exact = derived.found(state), derived.exact(state)
    # In units in which M has ones on its diagonal, so that light joints are held as heavy ones are.
    unit = np.sqrt(np.diag(exact["mass_matrix"]))
    for name in OUTPUTS:
        units = unit if name == "force" else np.outer(unit, unit)
        scaled, expected = found[name] / units, exact[name] / units
        most = 1e-12 * (np.abs(expected).max() + 1.0)
        np.testing.assert_allclose(scaled, expected, rtol=0, atol=most, err_msg=name)
    np.testing.assert_array_equal(found["mass_matrix"], found["mass_matrix"].T)
    assert not found["force_dq"][:, derived.places.position].any()
    return derived


@pytest.mark.slow
def test_the_benchmark_family() -> None:
    compare(benchmark_robot(3, attitude="xyz"))


@pytest.mark.slow
def test_random_arms() -> None:
    """All origins of a base of rods, all orders of angles, both joints, twists and offsets."""
    seed = 0
    robot = random_robot(seed, 3, seed)
    base = replace(robot.base, attitude=SEQUENCES[seed], origin=ROD_ORIGINS[seed % 2])
    compare(replace(robot, base=base))


@pytest.mark.slow
def test_no_entry_between_two_arms_is_computed() -> None:
    derived = compare(two_arms(2))
    function, size = derived.program.function("derivatives"), derived.places.size
    for output in function.outputs[1:]:
        between = [(i, j) for i in (6, 7) for j in (8, 9)]
        entries = {output.entries[size * i + j] for p in between for i, j in (p, p[::-1])}
        assert entries == {Number(0.0)}


@pytest.mark.slow
def test_central_differences() -> None:
    """Displacements of the coordinates are those that the function `integrate` makes."""
    robot = random_robot(4, 3, 2)
    derived = Derived.of(replace(robot, base=replace(robot.base, attitude="quaternion")))
    program = derive(derived.robot).program
    state = derived.state(0)
    for name, found in (("q", "force_dq"), ("v", "force_dv")):
        for j, along in enumerate(np.eye(derived.places.size)):
            forces = []
            for step in (1e-5, -1e-5):
                moved = dict(state)
                if name == "q":
                    given = {"q": state["q"], "v": along * step}
                    (q,) = program.evaluate("integrate", derived.parameters, given)
                    moved["q"] = np.array(q)
                else:
                    moved["v"] = state["v"] + along * step
                forces.append(derived.forces(moved))
            slope = (forces[0] - forces[1]) / 2e-5
            np.testing.assert_allclose(derived.found(state)[found][:, j], slope, atol=1e-6)


@pytest.mark.slow
def test_helmholtz() -> None:
    """∂τ/∂v and its transpose make 2 dM/dt, where the velocities are rates of coordinates."""
    seed = 0
    robot = random_tree(10 + seed, "tait_bryan")
    undamped = tuple(
        replace(link, passive=replace(link.passive, damping=0.0)) for link in robot.links
    )
    derived = Derived.of(replace(robot, links=undamped))
    state, size = derived.state(seed), derived.places.size
    along = {"q": state["v"][:, np.newaxis]}
    rate = derived.rates("mass_matrix", state, along).reshape(size, size)
    by_rate = derived.found(state)["force_dv"]
    np.testing.assert_allclose(by_rate + by_rate.T, 2 * rate, atol=1e-11 * np.abs(rate).max())


def derivative_operations(links: int, attitude: Attitude) -> int:
    symbolic = SymbolicRobot.of(benchmark_robot(links, attitude=attitude), tape := Tape())
    found = inverse_dynamics_derivatives(symbolic)
    matrices = (found.force_dq, found.force_dv, found.mass_matrix)
    return operations(tape, [*found.force, *chain.from_iterable(map(flat, matrices))])


def test_operations() -> None:
    """Counted before the passes over the graph, after which 1100, 3400 and 33500 are allowed."""
    assert derivative_operations(7, "xyz") == 3314
