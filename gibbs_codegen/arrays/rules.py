"""Derivatives of a module's functions by the entries of their arguments, one program for each.

Libraries that differentiate by themselves take them for rules. Entries of coordinates are those of
a unit quaternion, whose length changes leave as it is.
"""

from __future__ import annotations

from gibbs_codegen.arrays.backward import gradient
from gibbs_codegen.arrays.forward import jacobian
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Call,
    Node,
    Program,
    coordinates_of,
    entries_of,
    node,
    variable,
)
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, derivative


def by_arguments(robot: Functions, name: str, by: tuple[str, ...]) -> Program:
    """The results of a function, and `<output>_by_<argument>` for some arguments.

    Those of its outputs are there that are no derivatives themselves; the derivatives of these are
    of `gradients_by_arguments`.
    """
    inputs, arguments = _arguments(robot, name)
    if robot.layout.q.wheels and any(ARGUMENTS[x].is_coordinates for x in by):
        raise UsageError(f"no function of a module gives derivatives of {name} by angles of wheels")
    outputs = dict(zip(_names(name), map(entries_of, robot.outputs(name, *arguments)), strict=True))
    values = {y.name: outputs[y.name] for y in FUNCTIONS[name].outputs if not y.by}
    program = Program(name, inputs, values or outputs)
    derivatives = jacobian(program, by)
    return Program(derivatives.name, inputs, {**outputs, **derivatives.outputs})


def gradients_by_arguments(robot: Functions, name: str, by: tuple[str, ...]) -> Program:
    """Derivatives `<x>_by_<y>` of the gradient of w^T f by each argument x, for some y.

    `name` is that of the function that has the derivatives of f.
    """
    function = FUNCTIONS[name].derivative_of
    inputs, arguments = _arguments(robot, function)
    w = variable("w", robot.space.velocities)
    call = derivative(function, "vjp")
    if not call or robot.space.has_drive:
        raise UsageError(f"no function of a module gives derivatives of {name} by {by[0]}")
    bars = {
        x: node(Call(robot, call, place), (*arguments, w), arguments[place].tangent)
        for place, x in enumerate(FUNCTIONS[function].arguments)
    }
    derivatives = jacobian(Program(call, (*inputs, w), bars), by).outputs
    return Program(
        f"{call}_by_{'_'.join(by)}",
        (*inputs, w),
        {x: y for x, y in derivatives.items() if x not in bars},
    )


def by_parameters(robot: Functions, name: str) -> Program:
    """The gradient of the weighted result of a function by the parameters of its robot.

    Weights are the last input, and the gradient is the output.
    """
    inputs, arguments = _arguments(robot, name)
    outputs = dict(zip(_names(name), robot.outputs(name, *arguments), strict=True))
    return gradient(Program(name, inputs, outputs), f"{robot.owner}_parameters")


def _arguments(robot: Functions, name: str) -> tuple[tuple[Node, ...], list[Node]]:
    """Entries of the arguments of a function as inputs, and the arguments made of them."""
    signature = robot.signatures[name]
    inputs = [
        variable(argument, *shape)
        for argument, shape in zip(signature.arguments, signature.argument_shapes, strict=True)
    ]
    return tuple(inputs), [
        coordinates_of(x, robot.space) if ARGUMENTS[argument].is_coordinates else x
        for argument, x in zip(signature.arguments, inputs, strict=True)
    ]


def _names(name: str) -> list[str]:
    """Names of the outputs of a function."""
    return [output.name for output in FUNCTIONS[name].outputs]
