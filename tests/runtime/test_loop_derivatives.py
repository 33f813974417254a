"""Derivatives of allocation and of closed loops, against differences of high order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.differences import rate
from support.kept import kept_folder, made_once

from gibbs_codegen.arrays import (
    Node,
    Program,
    constant,
    dot,
    evaluate,
    gradient,
    jacobian,
    variable,
)
from gibbs_codegen.flight.integration.closed_loop import loop_program, loop_values
from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.machine.allocation import nearest_thrusts, smallest_thrusts
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.programs import CompiledProgram
from gibbs_codegen.verification.complex_steps import ComplexSteps

Array = np.ndarray
NEEDED = (
    "forward_dynamics_vjp",
    "inverse_dynamics_vjp",
    "forward_dynamics_parameters_vjp",
    "difference_derivatives",
)
STEP = 1e-40
SIZE = 0.01


def nearest(thrusts: Array, wrench: Array, columns: Array, least: Array, most: Array) -> Array:
    """Thrusts within limits, by SciPy's bounded least squares."""
    return Allocation(columns.T, np.stack([least, most])).in_flight().thrusts(wrench)


@pytest.mark.parametrize("rotors", [4, 6, 7])
@pytest.mark.parametrize("share", [0.3, 2.0])
def test_thrusts_within_limits_have_derivatives(rotors: int, share: float) -> None:
    random = np.random.default_rng(rotors)
    columns = random.normal(size=(rotors, 6))
    least, most = -0.4 - random.random(rotors), 0.4 + random.random(rotors)
    wrench = share * columns.T @ random.normal(size=rotors)
    inputs = variable("columns", rotors, 6), variable("wrench", 6)
    limits = variable("least", rotors), variable("most", rotors)
    exact = smallest_thrusts(*inputs)
    program = Program(
        "shared",
        (*inputs, *limits),
        {"thrusts": nearest_thrusts(exact, inputs[1], inputs[0], *limits)},
    )
    by_hand = {
        "smallest_thrusts": lambda columns, wrench: np.linalg.pinv(columns.T) @ wrench,
        "nearest_thrusts": nearest,
    }
    given = {"columns": columns, "wrench": wrench, "least": least, "most": most}
    found = evaluate(jacobian(program, [*given]), given, {}, externals=by_hand)
    bound = (found["thrusts"] <= least) | (found["thrusts"] >= most)
    assert bound.any() == (share > 1.0)
    weights = random.normal(size=rotors)
    bars = evaluate(
        gradient(program, [*given]), given | {"thrusts_bar": weights}, {}, externals=by_hand
    )
    for name, value in given.items():
        along = random.normal(size=value.shape)

        def moved(steps: Array, name: str = name, along: Array = along) -> Array:
            values = (given | {name: given[name] + step * along} for step in steps)
            return np.array(
                [evaluate(program, each, {}, externals=by_hand)["thrusts"] for each in values]
            )

        wanted = rate(moved, np.zeros(1), 1e-4)[0]
        slope = found[f"thrusts_by_{name}"].reshape(rotors, -1) @ along.ravel()
        np.testing.assert_allclose(slope, wanted, rtol=0, atol=1e-7 * (1.0 + np.abs(wanted).max()))
        np.testing.assert_allclose(
            np.sum(bars[f"{name}_bar"] * along), weights @ slope, rtol=1e-9, atol=1e-9
        )


class Complex:
    """Functions of a module at complex arguments, with one parameter that is complex too."""

    def __init__(self, module: ModuleType, parameter: str = "") -> None:
        folder = Path(str(module.__file__)).parent
        self._at = ComplexSteps(module, read_robot(str(folder / "robot.toml"))[0])
        if parameter:
            self._at._values[parameter] += 1j * STEP

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self._at(name, *arguments)


class Cost:
    """A weighted sum of the state after a step of a closed loop, and where it is taken."""

    def __init__(self, name: str) -> None:
        robot, text = read_robot(name)
        folder = kept_folder(robot, *NEEDED)

        def make() -> None:
            generate_robot(robot, text, folder, verify=False, derivatives=NEEDED)

        self.folder = made_once(folder / robot.name, make)
        self.module = load(self.folder)
        start = flight_start(self.module, read_scenario("circle"), lambda *_: None, own=False)
        loop = start.loop
        loads = loop.loads(0.0)
        spec = replace(loop_program(loop, loads), shared=False, inputs={})
        owners = {"plant": self.module, "model": self.module}

        def desired(at: float) -> Array:
            return np.concatenate(Reference.__call__(loop.controller.reference, at))

        def slope(time: float, x: Node) -> Node:
            curves = evaluate(spec.curves, {"time": time}, owners, externals={"desired": desired})
            given = constant(time), constant(curves["curves"]), x, *spec.rate_program.inputs[3:]
            return spec.rate_program.results(*given)["rate"]

        random = np.random.default_rng(5)
        begin = loop.start(start.q, start.v)
        state = variable("x", begin.size)
        end = state + SIZE * slope(0.5 * SIZE, state + 0.5 * SIZE * slope(0.0, state))
        weights = random.normal(size=begin.size) / (1.0 + abs(begin))
        inputs = state, *spec.rate_program.inputs[3:]
        self.program = Program("cost", inputs, {"cost": dot(weights, end)})
        values = loop_values(loop, 1.0, loads) | {
            "x": begin + 1e-3 * random.normal(size=begin.shape)
        }
        self.values: dict[str, Any] = {key: values[key] for key in self.program.names}

    def complex_slope(self, along: dict[str, Array], parameter: str = "") -> float:
        """The derivative along a direction of inputs, and by a parameter of the plant."""
        owners = {"plant": Complex(self.module, parameter), "model": Complex(self.module)}
        moved = {key: self.values[key] + 1j * STEP * x for key, x in along.items()}
        found = evaluate(self.program, self.values | moved, owners)
        return float(np.imag(found["cost"])) / STEP


# The paper's rods, which hardly resist being turned about themselves, magnify rounding.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rounding"),
    [("hexarotor", 1e-8)],
)
def test_costs_of_closed_loops_have_the_gradients_of_complex_steps(
    name: str, rounding: float, jax_in_double_precision: ModuleType
) -> None:
    cost = Cost(name)
    owners = {"plant": cost.module, "model": cost.module}
    names = ("x", "stiffness", "plant_parameters")
    given = cost.values | {"cost_bar": 1.0}
    program = gradient(cost.program, names)
    found = evaluate(program, given, owners)
    printed = CompiledProgram(load(cost.folder, "c"), program)(*(given[x] for x in program.names))
    for key, wanted in found.items():
        size = np.max(np.abs(wanted))
        np.testing.assert_allclose(printed[key], wanted, rtol=0, atol=rounding * size)
    random = np.random.default_rng(6)
    for key in names[:2]:
        along = random.normal(size=np.shape(cost.values[key]))
        wanted = cost.complex_slope({key: along})
        np.testing.assert_allclose(np.sum(found[f"{key}_bar"] * along), wanted, rtol=1e-9)
    place, mass = next(
        (place, key) for place, key in enumerate(cost.module.PARAMETERS) if "mass" in key
    )
    by_mass = found["plant_parameters_bar"][place]
    np.testing.assert_allclose(by_mass, cost.complex_slope({}, mass), rtol=1e-9)
    jax = jax_in_double_precision
    module = load(cost.folder, "jax")

    def value(x: Any, stiffness: Any, number: Any) -> Any:
        constants = {"plant": module.prepare({mass: number})}
        modules = {"plant": module, "model": module}
        moved = cost.values | {"x": x, "stiffness": stiffness}
        return evaluate(cost.program, moved, modules, constants, xp=jax.numpy)["cost"]

    at = cost.values["x"], cost.values["stiffness"], cost.module.PARAMETERS[mass]
    slopes = jax.jit(jax.grad(value, (0, 1, 2)))(*at)
    for slope, wanted in zip(
        slopes, (found["x_bar"], found["stiffness_bar"], by_mass), strict=True
    ):
        size = np.max(np.abs(wanted))
        np.testing.assert_allclose(slope, wanted, rtol=0, atol=max(rounding, 1e-9) * size)
