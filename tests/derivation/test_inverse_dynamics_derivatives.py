"""Derivatives of inverse dynamics by moments, against exact ones of the same equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from benchmarks.family import benchmark_robot
from support.complex_step import complex_step
from support.random_robots import random_robot, random_tree

from gibbs_codegen.derivation.inverse_dynamics import inverse_dynamics
from gibbs_codegen.derivation.inverse_dynamics_derivatives import inverse_dynamics_derivatives
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.program.nodes import Program
from gibbs_codegen.robot.layout import Places, layout_of
from gibbs_codegen.robot.model import SEQUENCES, Robot
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import Matrix

OUTPUTS = ("force", "force_dq", "force_dv", "mass_matrix")


@dataclass(frozen=True)
class Derived:
    """A robot's derivatives and its inverse dynamics as a program, with values to put in."""

    robot: Robot
    program: Program
    parameters: dict[str, float]
    places: Places

    @classmethod
    def of(cls, robot: Robot) -> Derived:
        """Derive both on one tape."""
        tape = Tape()
        symbolic = SymbolicRobot.of(robot, tape)
        found = inverse_dynamics_derivatives(symbolic)
        size = symbolic.places.size
        outputs = [
            ((size,), tuple(found.force)),
            *(
                ((size, size), flat(matrix))
                for matrix in (found.force_dq, found.force_dv, found.mass_matrix)
            ),
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
        return cls(robot, program, parameters, symbolic.places)

    def state(self, seed: int) -> dict[str, np.ndarray]:
        """A random state, its quaternion of unit length."""
        rng = np.random.default_rng(seed)
        state = {name: rng.uniform(-1.0, 1.0, len(self.program.inputs[name])) for name in "qva"}
        layout = layout_of(self.robot)
        if layout.is_quaternion:
            attitude = state["q"][layout.q.attitude]
            state["q"][layout.q.attitude] = attitude / np.linalg.norm(attitude)
        return state

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
        exact = {
            name: complex_step(
                self.program, "inverse_dynamics", self.parameters, state, {name: along}
            )
            for name, along in directions.items()
        }
        (force,) = self.program.evaluate("inverse_dynamics", self.parameters, state)
        return dict(
            zip(OUTPUTS, (np.array(force), exact["q"], exact["v"], exact["a"]), strict=True)
        )

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


def flat(matrix: Matrix) -> tuple:
    return tuple(entry for row in matrix for entry in row)


def compare(robot: Robot, states: int = 2) -> None:
    derived = Derived.of(robot)
    for seed in range(states):
        state = derived.state(seed)
        found, exact = derived.found(state), derived.exact(state)
        for name in OUTPUTS:
            scale = np.abs(exact[name]).max() + 1.0
            np.testing.assert_allclose(
                found[name] / scale, exact[name] / scale, atol=1e-12, err_msg=name
            )
        np.testing.assert_array_equal(found["mass_matrix"], found["mass_matrix"].T)
        assert not found["force_dq"][:, derived.places.position].any()


@pytest.mark.parametrize("attitude", ["xyz", "quaternion"])
@pytest.mark.parametrize("links", [2, 3, 5])
def test_the_benchmark_family(links: int, attitude: str) -> None:
    compare(benchmark_robot(links, attitude=attitude))


@pytest.mark.parametrize("seed", range(12))
def test_random_arms(seed: int) -> None:
    """All origins and orders of angles, both kinds of joints, twists and offsets."""
    robot = random_robot(seed, 3, seed % 6)
    compare(replace(robot, base=replace(robot.base, attitude=SEQUENCES[seed % len(SEQUENCES)])))


@pytest.mark.parametrize("seed", range(24))
def test_random_trees(seed: int) -> None:
    compare(random_tree(seed))
