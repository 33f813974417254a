"""A function's sines and cosines, gathered: all angles first, then all pairs, then the rest.

    t1 = x + y
    t2 = p*cos(t1)
    out = [t2, sin(x)]

becomes the angles `[t1, x]` with the statement `t1 = x + y`, then the sine and cosine of each (`s1`
and `c1`, `s2` and `c2`), then `t2 = p*c1` and `out = [t2, s2]`. Sine and cosine of many angles at
once are several times cheaper than one by one, if the target has a way to do them so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gibbs_codegen.program import nodes
from gibbs_codegen.program.nodes import Call, Product, Reciprocal, Sum


@dataclass(frozen=True)
class GatheredFunction:
    """A function in which the sines and cosines of `angles` are names.

    `angle_statements` compute what the angles need; `statements` and `outputs` read the sine of the
    i-th angle as `sine_name(i)` and its cosine as `cosine_name(i)`.
    """

    angle_statements: tuple[nodes.Statement, ...]
    angles: tuple[nodes.Node, ...]
    statements: tuple[nodes.Statement, ...]
    outputs: tuple[nodes.Output, ...]


def sine_name(i: int) -> str:
    """Name of the sine of angle i, counted from 0."""
    return f"s{i + 1}"


def cosine_name(i: int) -> str:
    """Name of the cosine of angle i, counted from 0."""
    return f"c{i + 1}"


def gather_angles(function: nodes.Function) -> GatheredFunction:
    """A function without calls, and its angles in the order of their first use."""
    calls = [
        call for node in function.nodes() for call in node.calls if call.function in ("sin", "cos")
    ]
    angles = list(dict.fromkeys(call.argument for call in calls))
    names: dict[nodes.Node, nodes.Node] = {}
    for call in calls:
        place = angles.index(call.argument)
        text = sine_name(place) if call.function == "sin" else cosine_name(place)
        names[call] = nodes.Name(text)
    renamed: set[str] = set()

    def gathered(node: nodes.Node) -> nodes.Node:
        if not node.calls and renamed.isdisjoint(node.names):
            return node
        match node:
            case Sum(terms):
                return Sum(tuple([(sign, gathered(term)) for sign, term in terms]))
            case Product(factors):
                return Product(tuple([gathered(factor) for factor in factors]))
            case Reciprocal(argument):
                return Reciprocal(gathered(argument))
            case Call(function, argument) if function not in ("sin", "cos"):
                return Call(function, gathered(argument))
            case _:
                return names[node]

    statements = []
    for statement in function.statements:
        value = gathered(statement.value)
        if isinstance(value, nodes.Name):
            names[nodes.Name(statement.name)] = value
            renamed.add(statement.name)
        else:
            same = value is statement.value
            statements.append(statement if same else replace(statement, value=value))
    outputs = tuple(
        nodes.Output(output.shape, tuple(map(gathered, output.entries)))
        for output in function.outputs
    )
    before = nodes.needed(function.statements, angles)
    after = nodes.needed(statements, [entry for o in outputs for entry in o.entries])
    return GatheredFunction(tuple(before), tuple(angles), tuple(after), outputs)
