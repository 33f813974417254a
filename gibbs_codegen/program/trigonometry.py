"""A function's sines and cosines, gathered: all angles first, then all pairs, then the rest.

Sine and cosine of many angles in one go are several times cheaper than one by one, if the target
has a way to do them so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gibbs_codegen.program.nodes import (
    Function,
    Name,
    Node,
    Output,
    Statement,
    calls_in,
    names_in,
    replaced,
)


@dataclass(frozen=True)
class GatheredFunction:
    """A function in which the sines and cosines of `angles` are names.

    `angle_statements` compute what the angles need; `statements` and `outputs` read the sine of the
    i-th angle as `sine_name(i)` and its cosine as `cosine_name(i)`.
    """

    angle_statements: tuple[Statement, ...]
    angles: tuple[Node, ...]
    statements: tuple[Statement, ...]
    outputs: tuple[Output, ...]


def sine_name(i: int) -> str:
    """Name of the sine of the i-th angle, counted from 0."""
    return f"s{i + 1}"


def cosine_name(i: int) -> str:
    """Name of the cosine of the i-th angle, counted from 0."""
    return f"c{i + 1}"


def gather_angles(function: Function) -> GatheredFunction:
    """Gather the sines and cosines of a function."""
    calls = [call for node in function.nodes() for call in calls_in(node)]
    angles = list(dict.fromkeys(call.argument for call in calls))
    names: dict[Node, Node] = {}
    for call in calls:
        place = angles.index(call.argument)
        text = sine_name(place) if call.function == "sin" else cosine_name(place)
        names[call] = Name(text)
    statements = []
    for statement in function.statements:
        value = replaced(statement.value, names)
        if isinstance(value, Name):
            names[Name(statement.name)] = value
        else:
            statements.append(replace(statement, value=value))
    outputs = tuple(
        Output(output.shape, tuple(replaced(entry, names) for entry in output.entries))
        for output in function.outputs
    )
    before = _needed(function.statements, angles)
    after = _needed(tuple(statements), [entry for o in outputs for entry in o.entries])
    return GatheredFunction(before, tuple(angles), after, outputs)


def _needed(statements: tuple[Statement, ...], roots: list[Node]) -> tuple[Statement, ...]:
    """Those of `statements`, in order, that `roots` need."""
    wanted = {name for root in roots for name in names_in(root)}
    kept = []
    for statement in reversed(statements):
        if statement.name in wanted:
            kept.append(statement)
            wanted.update(names_in(statement.value))
    return tuple(reversed(kept))
