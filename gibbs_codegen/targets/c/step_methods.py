"""The numerical methods of time steps in C, in the same words for states and for derivatives.

A method accelerates, moves, and combines vectors entry by entry. What is done to states is linear
in positions, velocities and accelerations, so the same is done to columns of their derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gibbs_codegen.targets.c.statements import call, loop, vector_loop

Lines = list[str]


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
            lines += loop("i", "NV", vector_loop("lane", "lanes", [*start, *part.lines]))
        elif isinstance(part, Move):
            lines += _called("integrate", [part.q, "displacement", part.result])
            if derivatives and is_quaternion:
                given = [part.q, "displacement", "by_q", "by_v"]
                lines += _called("integrate_derivatives", given)
                kept = f"moves + {part.number - 1} * MOVE * lanes"
                lines += call("keep_move", ["lanes", "by_q", "by_v", kept])
        else:
            given = [part.q, part.v, "u", f"acceleration_{part.stage}"]
            if not derivatives:
                lines += _called("forward_dynamics", given)
                continue
            by = ["by_q", "by_v", "by_u"]
            lines += _called("forward_dynamics_derivatives", [*given, *by])
            lines += call("keep_slope", ["lanes", *by, _slope(part)])
    return lines


def column_lines(method: Method, is_quaternion: bool) -> Lines:
    """What a method does to columns of derivatives; with a quaternion moves are no sums."""
    lines = []
    for part in method:
        if isinstance(part, Each):
            start = ["const int e = i * LANES + x;", "const real step = h[lane_of(lanes, x)];"]
            lines += loop("i", "NV", vector_loop("x", "LANES", [*start, *part.lines]))
        elif isinstance(part, Accelerate):
            given, name = [_slope(part), f"acceleration_{part.stage}"], "first_slope"
            if part.stage > 1:
                given[1:1], name = [part.q, part.v], "slope"
            lines += call(name, ["lanes", "column", *given])
        elif is_quaternion:
            kept = f"moves + {part.number - 1} * MOVE * lanes"
            lines += call("move", ["lanes", kept, part.q, "displacement", part.result])
        else:
            lines += loop("e", "NV * LANES", [f"{part.result}[e] = {part.q}[e] + displacement[e];"])
    return lines


def length_lines(robot: str, method: Method) -> Lines:
    """What a method does to a state, with the derivatives by the length of the step."""
    lines = []
    for part in method:
        if isinstance(part, Each):
            lines += loop("e", "NV", [*part.lines, *part.by_length])
            continue
        if isinstance(part, Move):
            given = ["constants", part.q, "displacement"]
            lines += call(f"{robot}_integrate", [*given, part.result])
            lines += call(f"{robot}_integrate_derivatives", [*given, "by_q", "by_v"])
            moved = "displacement_dh", f"{part.result}_dh"
        else:
            given = ["constants", part.q, part.v, "u", f"acceleration_{part.stage}"]
            lines += call(f"{robot}_forward_dynamics_derivatives", [*given, "by_q", "by_v", "by_u"])
            moved = f"{part.v}_dh", f"acceleration_{part.stage}_dh"
        lines += call("apply", ["by_q", f"{part.q}_dh", "by_v", *moved])
    return lines


def _slope(part: Accelerate) -> str:
    return f"slopes + {part.stage - 1} * SLOPE * lanes"


def _called(function: str, arguments: Sequence[str]) -> Lines:
    """A call of a function for one state, or for a block; arguments follow the constants."""
    return call("CALL", [function, "constants", *arguments])
