"""Functions in C that call others in loops over small matrices: time steps.

Their source is a template, for one state and for a block of states alike. What they keep on the way
is in one array, since local arrays cannot have a length that depends on the number of states.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gibbs_codegen.files.templating import render
from gibbs_codegen.interface import FUNCTIONS, LANES, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.stack import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.robot.coordinates import inputs
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.targets.c.arrays import array_size, local_arrays, read_arrays, written_arrays
from gibbs_codegen.targets.c.function_text import FunctionText, function_text
from gibbs_codegen.targets.c.sections import SCRATCH
from gibbs_codegen.targets.c.statements import call
from gibbs_codegen.targets.c.step_methods import (
    METHODS,
    PLACES,
    VECTORS,
    column_lines,
    state_lines,
)
from gibbs_codegen.targets.documentation import calls, doxygen

Lines = list[str]

_DOUBLE = 8
_BASE = 6


@dataclass(frozen=True)
class _StepText:
    """A time step as its template takes it.

    `vectors` are the arrays of columns of derivatives. `arrays` are those of states, with the entry
    of the scratch where each begins, of `entries` in all besides `slopes`, the derivatives of so
    many accelerations.
    """

    name: str
    derivatives: bool
    parameters: Lines
    state_lines: Lines
    column_lines: Lines
    vectors: Sequence[str]
    arrays: Mapping[str, int]
    entries: int
    slopes: int


@dataclass(frozen=True)
class _StepsText:
    """Everything in the template of time steps that depends on the robot."""

    name: str
    NAME: str
    is_quaternion: bool
    derivatives: bool
    runge_kutta: bool
    moves: str
    steps: Sequence[_StepText]


def composed_texts(model: Model) -> list[FunctionText]:
    """What the templates are given of the functions that are composed of others.

    The first has all definitions that they share.
    """
    steps = {signature.name: _step_text(model, signature) for signature in model.composed}
    if not steps:
        return []
    context = _StepsText(
        model.robot.name,
        model.robot.name.upper(),
        layout_of(model.robot).is_quaternion,
        any(step.derivatives for step in steps.values()),
        "step_rk4_derivatives" in steps,
        "moves, " if layout_of(model.robot).is_quaternion else "",
        list(steps.values()),
    )
    shared = [render("c_steps.c.jinja", context).splitlines()]
    texts = []
    for signature in model.composed:
        step = steps[signature.name]
        work = calls(model.robot, step.name)
        documentation = doxygen(model.robot, signature, work, _stack(model, step))
        bodies = [_body(signature, step, lanes) for lanes in (False, True)]
        texts.append(function_text(model.robot.name, signature, documentation, shared, *bodies))
        shared = []
    return texts


def _step_text(model: Model, signature: Signature) -> _StepText:
    """What the template is given of one step."""
    method = signature.name.removesuffix("_derivatives")
    derivatives, layout = method != signature.name, layout_of(model.robot)
    size = layout.v.size
    sizes = dict.fromkeys(VECTORS[method], size) | dict.fromkeys(PLACES[method], layout.q.size)
    called = FUNCTIONS[signature.name].composed
    if derivatives and layout.is_quaternion:
        sizes["moves"] = called["integrate_derivatives"] * 2 * _BASE**2
    if derivatives:
        width = len(inputs(model.robot))
        sizes |= {"by_q": size**2, "by_v": size**2, "by_u": size * width}
        # They are the last, since how long they are depends on the precision.
        sizes["slopes"] = 0
    ends = [*itertools.accumulate(sizes.values())]
    names = [output.name for output in FUNCTIONS[signature.name].outputs]
    return _StepText(
        signature.name,
        derivatives,
        read_arrays(signature.arguments) + written_arrays(names),
        state_lines(METHODS[method], derivatives, layout.is_quaternion),
        column_lines(METHODS[method], layout.is_quaternion),
        [*VECTORS[method], *PLACES[method]],
        dict(zip(sizes, [0, *ends[:-1]], strict=True)),
        ends[-1],
        called["forward_dynamics_derivatives"] if derivatives else 0,
    )


def _body(signature: Signature, step: _StepText, lanes: bool) -> Lines:
    """Body of a step, for a block of states (`lanes`), or for one state."""
    outputs = [output.name for output in FUNCTIONS[signature.name].outputs]
    arrays = ["constants", *signature.arguments, *outputs, SCRATCH]
    entries = f"({step.entries} + {step.slopes} * SLOPE)" if step.slopes else str(step.entries)
    return [
        local_arrays([SCRATCH], array_size(entries, lanes)),
        *call(f"{signature.name}_states", [*arrays, "LANES" if lanes else "1"]),
    ]


def _stack(model: Model, step: _StepText) -> int:
    """Stack that a step takes for one state of doubles (bytes): its own, and that of its parts."""
    size = layout_of(model.robot).v.size
    own = step.entries
    if step.derivatives:
        columns = [-(-width // LANES) * LANES for width in (2 * size, len(inputs(model.robot)))]
        own += step.slopes * size * sum(columns) + (len(step.vectors) + 4) * size * LANES
    functions = map(model.program.function, FUNCTIONS[step.name].composed)
    return _DOUBLE * own + 2 * max(stack_bytes(gather_angles(part)) for part in functions)
