"""Derivatives of programs that call a robot's functions and other programs, by complex steps.

The functions are made up, with derivatives in closed form: what is tried is what programs make of
them, whatever a robot's equations are.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from support.made_up import STEP, Array, MadeUp, close

from gibbs_codegen.arrays import (
    Functions,
    Program,
    constant,
    evaluate,
    gradient,
    jacobian,
    nodes,
    sine,
    solve,
    variable,
)
from gibbs_codegen.arrays.forward import along
from gibbs_codegen.arrays.rules import by_arguments, by_parameters, gradients_by_arguments
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS

ROOTS = ("xyz", "zyx", "quaternion")
KINDS = {
    kind: [x.name for x in FUNCTIONS.values() if x.kind == kind]
    for kind in ("jacobian", "jvp", "vjp")
}
LACKS = {"": [], "jacobian": KINDS["jacobian"], "vjp": KINDS["vjp"] + KINDS["jvp"]}


def program_of(robot: Functions, is_whole: bool) -> Program:
    """A program that calls what has derivatives; not `is_whole`, what has products of them."""
    (q, v), u = robot.state(), variable("u", robot.inputs)
    s = variable("s", uniform=True)
    wrenches = variable("W", robot.frames, 6)
    moved = robot.integrate(q, 0.3 * v) if is_whole else q
    inner = Program(
        "inner", (q, v), {"a": robot.inverse_dynamics(q, v, sine(v)), "b": v * 2.0, "q": q}
    )
    a, b, same = inner(moved, v * s)
    outputs = {
        "force": a + b,
        "coordinates": same,
        "acceleration": robot.forward_dynamics(moved, v, u * s),
        "loaded": robot.forward_dynamics_with_wrenches(q, s * v, u, wrenches * s),
        "levers": robot.input_matrix(q) @ u if not is_whole else u,
        "twice": robot.forward_dynamics(moved, v, u * s) * a,
        "solved": solve(
            4.0 * constant(np.eye(v.size))
            + nodes.reshaped(v, (v.size, 1)) * nodes.reshaped(b, (1, v.size)),
            a,
        ),
        "entries": nodes.entries_of(moved) * 2.0,
        "none": constant([1.0, 2.0]),
    }
    if is_whole:
        again = nodes.coordinates_of(nodes.entries_of(moved), robot.space)
        outputs |= {
            "way": robot.difference(moved, robot.integrate(q, v)),
            "next": robot.integrate(again, v),
            "again": robot.difference(again, q),
            "poses": nodes.reshaped(robot.frame_poses(moved), (8 * robot.frames // 2, 4))[:3],
            "moving": robot.frame_velocities(moved, v) @ np.arange(6.0),
            "mass": robot.centre_of_mass(q) * s,
            "turned": nodes.coordinates_of(nodes.entries_of(q), robot.space),
            "rebuilt": nodes.coordinates_of(nodes.entries_of(moved) * 1.0, robot.space),
        }
    return Program("whole", (q, v, u, s, wrenches), outputs)


def values_of(module: MadeUp, program: Program) -> dict[str, Array]:
    random = np.random.default_rng(7)
    given = {
        n: random.normal(size=x.shape) * 0.4
        for n, x in zip(program.names, program.inputs, strict=True)
    }
    if "q" in given:
        given["q"], given["v"] = module.state(random)
    return given


def complex_slopes(
    module: MadeUp, program: Program, given: dict[str, Array], by: str
) -> dict[str, Array]:
    """Derivatives of all results by an input, in the tangent space of coordinates."""
    x = dict(zip(program.names, program.inputs, strict=True))[by]
    steps = module._moves(given[by]).T if x.space else np.eye(x.size)
    columns: dict[str, list[Array]] = {name: [] for name in program.outputs}
    for step in steps:
        moved = given | {by: given[by] + 1j * STEP * step.reshape(x.shape)}
        for name, found in evaluate(program, moved, {"robot": module}).items():
            rate = np.imag(found) / STEP
            if program.outputs[name].space:
                rate = np.linalg.lstsq(module._moves(np.real(found)), rate, rcond=None)[0]
            columns[name].append(rate)
    return {name: np.stack(found, -1) for name, found in columns.items()}


@pytest.mark.parametrize(
    ("attitude", "lacks"),
    [
        *(("zyx", lacks) for lacks in LACKS),
        *(("quaternion", lacks) for lacks in ("", "jacobian")),
        pytest.param("quaternion", "vjp", marks=pytest.mark.slow),
    ],
)
def test_derivatives_are_those_of_complex_steps(attitude: str, lacks: str) -> None:
    module = MadeUp(attitude, lacks=LACKS[lacks])
    owners, program = {"robot": module}, program_of(Functions(module), lacks != "jacobian")
    if lacks == "vjp":  # Products with weights are all that input matrices have.
        program = Program(
            "whole", program.inputs, {n: x for n, x in program.outputs.items() if n != "levers"}
        )
    given, by = values_of(module, program), tuple(program.names)
    slopes = {x: complex_slopes(module, program, given, x) for x in by}
    found = evaluate(jacobian(program, by), given, owners)
    random = np.random.default_rng(8)
    directions = {
        f"{x}_dot": random.normal(size=y.tangent) for x, y in zip(by, program.inputs, strict=True)
    }
    moved = evaluate(along(program, by, "along"), given | directions, owners)
    for name in program.outputs:
        for other in by:
            close(found[f"{name}_by_{other}"], slopes[other][name], 1e-11, f"{name} by {other}")
        wanted = sum(slopes[y][name] @ directions[f"{y}_dot"].ravel() for y in by)
        close(moved[f"{name}_dot"], wanted, 1e-11, name)
    weights = {f"{name}_bar": random.normal(size=x.tangent) for name, x in program.outputs.items()}
    bars = evaluate(gradient(program, by), given | weights, owners)
    for other, y in zip(by, program.inputs, strict=True):
        terms = [
            (weights[f"{n}_bar"].ravel() @ slopes[other][n].reshape(math.prod(x.tangent), -1))
            for n, x in program.outputs.items()
        ]
        close(bars[f"{other}_bar"], sum(terms).reshape(y.tangent), 1e-11, other)


def test_values_come_from_the_call_that_gives_derivatives() -> None:
    robot = Functions(MadeUp("zyx"))
    q, v = robot.state()
    derived = jacobian(Program("p", (q, v), {"a": robot.inverse_dynamics(q, v, v)}), ("q",))
    called = {x.operation.name for x in derived.nodes if isinstance(x.operation, nodes.Call)}
    assert called == {"inverse_dynamics_derivatives"}


@pytest.mark.parametrize("lacks", ["frame_poses_derivatives", ""])
def test_poses_move_along_a_direction_as_their_twists_say(lacks: str) -> None:
    module = MadeUp("quaternion", lacks=[lacks])
    robot = Functions(module)
    q, v = robot.state()
    program = Program("p", (q, v), {"poses": robot.frame_poses(q)})
    given = values_of(module, program)
    found = evaluate(along(program, "q", "along"), given | {"q_dot": given["v"]}, {"robot": module})
    close(
        found["poses_dot"], complex_slopes(module, program, given, "q")["poses"] @ given["v"], 1e-11
    )


@pytest.mark.parametrize("attitude", ROOTS[1:])
@pytest.mark.parametrize("name", ["forward_dynamics", "inverse_dynamics"])
def test_gradients_have_second_derivatives(name: str, attitude: str) -> None:
    module = MadeUp(attitude)
    robot = Functions(module)
    (q, v), w = robot.state(), robot.velocities("w")
    last = variable("u", robot.inputs) if name[0] == "f" else robot.velocities("a")
    bars = getattr(robot, f"{name}_vjp")(q, v, last, w)
    program = Program("pull", (q, v, last, w), dict(zip("qvu", bars, strict=True)))
    given = values_of(module, program)
    random = np.random.default_rng(9)
    weights = {f"{x}_bar": random.normal(size=y.tangent) for x, y in program.outputs.items()}
    found = evaluate(jacobian(program, program.names), given, {"robot": module})
    found |= evaluate(gradient(program, program.names), given | weights, {"robot": module})
    for by in program.names:
        slopes = complex_slopes(module, program, given, by)
        for output, slope in slopes.items():
            close(found[f"{output}_by_{by}"], slope, 1e-11, f"{output} by {by}")
        wanted = sum(weights[f"{output}_bar"] @ slope for output, slope in slopes.items())
        close(found[f"{by}_bar"], wanted, 1e-11, by)


def test_gradients_by_parameters_are_those_of_complex_steps() -> None:
    """Of calls with the parameters of two owners, and of those without any."""
    modules = {owner: MadeUp("quaternion") for owner in ("plant", "model")}
    plant, model = (Functions(module, owner) for owner, module in modules.items())
    (q, v), u = plant.state(), variable("u", plant.inputs)
    inner = Program("inner", (q, v), {"f": model.inverse_dynamics(q, v, v), "v": v})
    pushed = plant.forward_dynamics_with_wrenches(q, v, u, nodes.zeros(2, 6))
    outputs = {
        "a": plant.forward_dynamics(plant.integrate(q, v), v, u) + inner(q, v)[0],
        "b": plant.inverse_dynamics(q, v, pushed),
        "c": model.forward_dynamics(q, inner(q, v)[1], u),
    }
    program = Program("p", (q, v, u), outputs)
    given = values_of(modules["plant"], program)
    weights = {f"{x}_bar": np.random.default_rng(ord(x)).normal(size=v.size) for x in outputs}
    names = ("plant_parameters", "model_parameters", "u")
    found = evaluate(gradient(program, names), given | weights, modules)
    for owner, module in modules.items():
        before, wanted = module.parameters, []
        for step in 1j * STEP * np.eye(3):
            module.parameters = before + step
            moved = evaluate(program, given, modules)
            wanted.append(sum(weights[f"{x}_bar"] @ np.imag(moved[x]) for x in outputs) / STEP)
        module.parameters = before
        close(found[f"{owner}_parameters_bar"], np.array(wanted), 1e-11, owner)
    with pytest.raises(UsageError, match="derivatives of frame_poses by parameters"):
        gradient(Program("p", (q,), {"y": plant.frame_poses(q)}), "plant_parameters")


@pytest.mark.parametrize("attitude", ROOTS[1:])
def test_rules_are_derivatives_by_entries_of_arguments(attitude: str) -> None:
    module = MadeUp(attitude)
    robot, owners = Functions(module), {"robot": module}
    whole = by_arguments(robot, "forward_dynamics", ("q", "u"))
    plain = Program("p", whole.inputs, {"acceleration": whole.outputs["acceleration"]})
    random = np.random.default_rng(3)
    given = {**dict(zip("qv", module.state(random), strict=True)), "u": random.normal(size=6)}
    found = evaluate(whole, given, owners)
    close(found["acceleration"], module.forward_dynamics(*given.values()), 1e-11, "value")
    assert {*found} == {"acceleration", "acceleration_by_q", "acceleration_by_u"}

    def rates(name: str, function: Any) -> Array:
        units = np.eye(given[name].size)
        if name == "q" and attitude == "quaternion":  # Its length changes nothing.
            place, unit = slice(3, 7), given["q"][3:7]
            units = units.copy()
            units[place, place] -= np.outer(unit, unit)
        moved = [given | {name: given[name] + 1j * STEP * unit} for unit in units]
        return np.stack([np.imag(function(x)) / STEP for x in moved], -1)

    for by in "qu":
        slope = rates(by, lambda x: module.forward_dynamics(x["q"], x["v"], x["u"]))
        close(found[f"acceleration_by_{by}"], slope, 1e-11, by)
    assert plain.outputs["acceleration"] is whole.outputs["acceleration"]
    given["w"] = random.normal(size=8)
    second = evaluate(
        gradients_by_arguments(robot, "forward_dynamics_derivatives", ("v",)), given, owners
    )
    pulls = {
        name: rates(
            "v", lambda x, k=k: module.forward_dynamics_vjp(x["q"], x["v"], x["u"], given["w"])[k]
        )
        for k, name in enumerate("qvu")
    }
    assert {*second} == {f"{x}_by_v" for x in "qvu"}
    for name, slope in pulls.items():
        close(second[f"{name}_by_v"], slope, 1e-11, name)
    weight = by_parameters(robot, "inverse_dynamics")
    own = given | {"a": random.normal(size=8), "force_bar": given["w"]}
    bar = evaluate(weight, {name: own[name] for name in weight.names}, owners)[
        "robot_parameters_bar"
    ]
    close(
        bar,
        given["w"] @ module.inverse_dynamics_parameters(own["q"], own["v"], own["a"]),
        1e-11,
        "p",
    )
    with pytest.raises(
        UsageError, match="no function of a module gives derivatives of frame_poses"
    ):
        gradients_by_arguments(robot, "frame_poses_derivatives", ("q",))
