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
    """Statements for the entries `e` of vectors; `step` is the length of the step."""

    lines: tuple[str, ...]


Method = Sequence[Accelerate | Move | Each]

METHODS: dict[str, Method] = {
    "step_euler": (
        Accelerate(1, "q", "v"),
        Each(
            (
                "v_next[e] = v[e] + step * acceleration_1[e];",
                "displacement[e] = step * v_next[e];",
            )
        ),
        Move(1, "q", "q_next"),
    ),
    "step_rk4": (
        Accelerate(1, "q", "v"),
        Each(
            (
                "displacement[e] = R(0.5) * step * v[e];",
                "rate[e] = v[e] + R(0.5) * step * acceleration_1[e];",
            )
        ),
        Move(1, "q", "half"),
        Accelerate(2, "half", "rate"),
        Each(
            (
                "displacement[e] = R(0.5) * step * rate[e];",
                "rate[e] = v[e] + R(0.5) * step * acceleration_2[e];",
            )
        ),
        Move(2, "q", "later"),
        Accelerate(3, "later", "rate"),
        Each(
            (
                "displacement[e] = step * (rate[e] - R(0.5) * v[e]);",
                "rate[e] = v[e] + step * acceleration_3[e];",
            )
        ),
        Move(3, "half", "later"),
        Accelerate(4, "later", "rate"),
        Each(
            (
                "const real sum = acceleration_1[e] + acceleration_2[e] - acceleration_3[e];",
                "displacement[e] = R(0.5) * step * (v[e] + step / R(6.0) * sum);",
            )
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
            )
        ),
        Move(5, "half", "q_next"),
    ),
}


def state_lines(robot: str, method: Method, derivatives: bool, is_quaternion: bool) -> Lines:
    """What a method does to states.

    Args:
        robot: Name of the robot.
        method: One of `METHODS`.
        derivatives: Whether derivatives of accelerations and moves are kept, for `column_lines`.
        is_quaternion: Whether moves are no sums.

    Returns:
        Lines.
    """
    lines = []
    for part in method:
        if isinstance(part, Each):
            start = ["const int e = i * lanes + lane;", "const real step = h[lane];"]
            lines += loop("i", "NV", vector_loop("lane", "lanes", [*start, *part.lines]))
        elif isinstance(part, Move):
            lines += _called(robot, "integrate", [part.q, "displacement", part.result])
            if derivatives and is_quaternion:
                given = [part.q, "displacement", "by_q", "by_v"]
                lines += _called(robot, "integrate_derivatives", given)
                kept = f"moves + {part.number - 1} * MOVE * lanes"
                lines += call("keep_move", ["lanes", "by_q", "by_v", kept])
        else:
            given = [part.q, part.v, "u", f"acceleration_{part.stage}"]
            if not derivatives:
                lines += _called(robot, "forward_dynamics", given)
                continue
            by = ["by_q", "by_v", "by_u"]
            lines += _called(robot, "forward_dynamics_derivatives", [*given, *by])
            lines += call("keep_slope", ["lanes", *by, _slope(part)])
    return lines


def column_lines(method: Method, is_quaternion: bool) -> Lines:
    """What a method does to columns of derivatives.

    Args:
        method: One of `METHODS`.
        is_quaternion: Whether moves are no sums.

    Returns:
        Lines.
    """
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


def _slope(part: Accelerate) -> str:
    return f"slopes + {part.stage - 1} * SLOPE * lanes"


def _called(robot: str, function: str, arguments: Sequence[str]) -> Lines:
    """A call of a function for one state, or for a block of them.

    Args:
        robot: Name of the robot.
        function: Name of the function.
        arguments: Those after the constants.

    Returns:
        Lines.
    """
    given = ["constants", *arguments]
    one, block = call(f"{robot}_{function}", given), call(f"{function}_block", given)
    indented = [[f"    {line}" for line in lines] for lines in (one, block)]
    return ["if (lanes == 1) {", *indented[0], "} else {", *indented[1], "}"]
