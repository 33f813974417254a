"""Functions in C that call others in loops over small matrices: time steps.

Their source is a template, for one state and for a block of states alike. What they keep on the way
is in one array, since local arrays cannot have a length that depends on the number of states.

A numerical method accelerates, moves, and combines vectors entry by entry. What is done to states
is linear in positions, velocities and accelerations, so the same is done to columns of their
derivatives, in the same words. Which entries of those can differ from zero follows from the
patterns of the functions that a step calls; those of what is done one after the other are products
of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gibbs_codegen.files.templating import render
from gibbs_codegen.interface import FUNCTIONS, LANES, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.scratch import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.targets.c import statements as c
from gibbs_codegen.targets.c.function import SCRATCH, function_text
from gibbs_codegen.targets.documentation import calls, doxygen
from gibbs_codegen.targets.printers import Context, Lines


@dataclass(frozen=True)
class Accelerate:
    """The acceleration of a stage, at some coordinates and velocities."""

    stage: int
    q: str
    v: str


@dataclass(frozen=True)
class Move:
    """Coordinates after the displacement; moves are counted from 1."""

    number: int
    q: str
    result: str


@dataclass(frozen=True)
class Each:
    """Statements for the entries `e` of vectors; `step` is the length of the step.

    `by_length` has the derivatives by that length, of which that of the first acceleration is zero.
    """

    lines: tuple[str, ...]
    by_length: tuple[str, ...]


Method = Sequence[Accelerate | Move | Each]

# Vectors with an entry for each of VELOCITIES that each method needs, and places of the robot.
VECTORS = {
    "step_euler": ["acceleration_1", "displacement"],
    "step_rk4": [*(f"acceleration_{i}" for i in range(1, 5)), "displacement", "rate"],
}
PLACES: dict[str, Lines] = {"step_euler": [], "step_rk4": ["half", "later"]}

_DISPLACEMENT_DH = (
    "displacement_dh[e] = R(0.5) * v[e] + step / R(6.0) * (sum + R(0.5) * step * sum_dh);"
)
METHODS: dict[str, Method] = {
    "step_euler": (
        Accelerate(1, "q", "v"),
        Each(
            (
                "v_next[e] = v[e] + step * acceleration_1[e];",
                "displacement[e] = step * v_next[e];",
            ),
            (
                "v_next_dh[e] = acceleration_1[e];",
                "displacement_dh[e] = v[e] + R(2.0) * step * acceleration_1[e];",
            ),
        ),
        Move(1, "q", "q_next"),
    ),
    "step_rk4": (
        Accelerate(1, "q", "v"),
        Each(
            (
                "displacement[e] = R(0.5) * step * v[e];",
                "rate[e] = v[e] + R(0.5) * step * acceleration_1[e];",
            ),
            (
                "displacement_dh[e] = R(0.5) * v[e];",
                "rate_dh[e] = R(0.5) * acceleration_1[e];",
            ),
        ),
        Move(1, "q", "half"),
        Accelerate(2, "half", "rate"),
        Each(
            (
                "displacement[e] = R(0.5) * step * rate[e];",
                "rate[e] = v[e] + R(0.5) * step * acceleration_2[e];",
            ),
            (
                "displacement_dh[e] = R(0.5) * (v[e] + step * acceleration_1[e]);",
                "rate_dh[e] = R(0.5) * (acceleration_2[e] + step * acceleration_2_dh[e]);",
            ),
        ),
        Move(2, "q", "later"),
        Accelerate(3, "later", "rate"),
        Each(
            (
                "displacement[e] = step * (rate[e] - R(0.5) * v[e]);",
                "rate[e] = v[e] + step * acceleration_3[e];",
            ),
            (
                "const real slope = acceleration_2[e] + R(0.5) * step * acceleration_2_dh[e];",
                "displacement_dh[e] = R(0.5) * v[e] + step * slope;",
                "rate_dh[e] = acceleration_3[e] + step * acceleration_3_dh[e];",
            ),
        ),
        Move(3, "half", "later"),
        Accelerate(4, "later", "rate"),
        Each(
            (
                "const real sum = acceleration_1[e] + acceleration_2[e] - acceleration_3[e];",
                "displacement[e] = R(0.5) * step * (v[e] + step / R(6.0) * sum);",
            ),
            (
                "const real sum_dh = acceleration_2_dh[e] - acceleration_3_dh[e];",
                _DISPLACEMENT_DH,
            ),
        ),
        Move(4, "q", "half"),
        Each(
            (
                "const real first = acceleration_1[e] + acceleration_2[e];",
                "const real sum = first + R(3.0) * acceleration_3[e];",
                "const real later_two = R(2.0) * acceleration_3[e] + acceleration_4[e];",
                "const real all = first + acceleration_2[e] + later_two;",
                "displacement[e] = R(0.5) * step * (v[e] + step / R(6.0) * sum);",
                "v_next[e] = v[e] + step / R(6.0) * all;",
            ),
            (
                "const real sum_dh = acceleration_2_dh[e] + R(3.0) * acceleration_3_dh[e];",
                "const real two_dh = acceleration_2_dh[e] + acceleration_3_dh[e];",
                "const real all_dh = R(2.0) * two_dh + acceleration_4_dh[e];",
                _DISPLACEMENT_DH,
                "v_next_dh[e] = (all + step * all_dh) / R(6.0);",
            ),
        ),
        Move(5, "half", "q_next"),
    ),
}


def state_lines(method: Method, derivatives: bool, is_quaternion: bool) -> Lines:
    """What a method, one of `METHODS`, does to states.

    `derivatives`: whether derivatives of accelerations and moves are kept, for `column_lines`; with
    a quaternion moves are no sums.
    """
    lines = []
    for part in method:
        if isinstance(part, Each):
            start = ["const int e = i * lanes + lane;", "const real step = h[lane];"]
            lines += c.loop("i", "NV", c.vector_loop("lane", "lanes", [*start, *part.lines]))
        elif isinstance(part, Move):
            lines += _called("integrate", [part.q, "displacement", part.result])
            if derivatives and is_quaternion:
                arguments = [part.q, "displacement", "by_q", "by_v"]
                lines += _called("integrate_derivatives", arguments)
                kept = f"moves + {part.number - 1} * MOVE * lanes"
                lines += c.call("keep_move", ["lanes", "by_q", "by_v", kept])
        else:
            arguments = [part.q, part.v, "u", f"acceleration_{part.stage}"]
            if not derivatives:
                lines += _called("forward_dynamics", arguments)
                continue
            by = ["by_q", "by_v", "by_u"]
            lines += _called("forward_dynamics_derivatives", [*arguments, *by])
            lines += c.call("keep_slope", ["lanes", *by, _slope(part)])
    return lines


def column_lines(method: Method, is_quaternion: bool) -> Lines:
    """What a method does to columns of derivatives; with a quaternion moves are no sums."""
    lines = []
    for part in method:
        if isinstance(part, Each):
            start = ["const int e = i * LANES + x;", "const real step = h[lane_of(lanes, x)];"]
            lines += c.loop("i", "NV", c.vector_loop("x", "LANES", [*start, *part.lines]))
        elif isinstance(part, Accelerate):
            arguments, name = [_slope(part), f"acceleration_{part.stage}"], "first_slope"
            if part.stage > 1:
                arguments[1:1], name = [part.q, part.v], "slope"
            lines += c.call(name, ["lanes", "column", *arguments])
        elif is_quaternion:
            kept = f"moves + {part.number - 1} * MOVE * lanes"
            lines += c.call("move", ["lanes", kept, part.q, "displacement", part.result])
        else:
            lines += c.loop(
                "e", "NV * LANES", [f"{part.result}[e] = {part.q}[e] + displacement[e];"]
            )
    return lines


def _slope(part: Accelerate) -> str:
    return f"slopes + {part.stage - 1} * SLOPE * lanes"


def _called(function: str, arguments: Sequence[str]) -> Lines:
    """A call of a function for one state, or for a block; arguments follow the constants."""
    return c.call("CALL", [function, "constants", *arguments])


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


def composed_texts(model: Model) -> list[Context]:
    """What the templates are given of the functions that are composed of others.

    The first has all definitions that they share.
    """
    steps = {signature.name: _step_text(model, signature) for signature in model.composed}
    if not steps:
        return []
    context = {
        "name": model.robot.name,
        "NAME": model.robot.name.upper(),
        "is_quaternion": model.description.layout.is_quaternion,
        "derivatives": any(step.derivatives for step in steps.values()),
        "runge_kutta": "step_rk4_derivatives" in steps,
        "moves": "moves, " if model.description.layout.is_quaternion else "",
        "steps": list(steps.values()),
    }
    shared = [render("c_steps.c.jinja", context).splitlines()]
    texts = []
    for signature in model.composed:
        step = steps[signature.name]
        work = calls(model.description, step.name)
        documentation = doxygen(model.description, signature, work, _stack(model, step))
        bodies = [_body(signature, step, lanes) for lanes in (False, True)]
        texts.append(function_text(model.robot.name, signature, documentation, shared, *bodies))
        shared = []
    return texts


def _step_text(model: Model, signature: Signature) -> _StepText:
    """What the template is given of one step."""
    method = signature.name.removesuffix("_derivatives")
    derivatives, layout = method != signature.name, model.description.layout
    size = layout.v.size
    sizes = dict.fromkeys(VECTORS[method], size) | dict.fromkeys(PLACES[method], layout.q.size)
    called = FUNCTIONS[signature.name].composed
    if derivatives and layout.is_quaternion:
        sizes["moves"] = called["integrate_derivatives"] * 2 * _BASE**2
    if derivatives:
        width = len(model.description.inputs)
        sizes |= {"by_q": size**2, "by_v": size**2, "by_u": size * width}
        # They are the last, since how long they are depends on the precision.
        sizes["slopes"] = 0
    ends = [*itertools.accumulate(sizes.values())]
    names = [output.name for output in FUNCTIONS[signature.name].outputs]
    return _StepText(
        signature.name,
        derivatives,
        c.read_arrays(signature.arguments) + c.written_arrays(names),
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
        c.local_arrays([SCRATCH], c.array_size(entries, lanes)),
        *c.call(f"{signature.name}_states", [*arrays, "LANES" if lanes else "1"]),
    ]


def _stack(model: Model, step: _StepText) -> int:
    """Stack that a step takes for one state of doubles (bytes): its own, and that of its parts."""
    size = model.description.layout.v.size
    own = step.entries
    if step.derivatives:
        columns = [
            -(-width // LANES) * LANES for width in (2 * size, len(model.description.inputs))
        ]
        own += step.slopes * size * sum(columns) + (len(step.vectors) + 4) * size * LANES
    functions = map(model.program.function, FUNCTIONS[step.name].composed)
    return _DOUBLE * own + 2 * max(stack_bytes(gather_angles(part)) for part in functions)
