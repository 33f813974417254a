"""From array programs to the graph: each entry of a value becomes a reference.

What is chosen is a sum of products with 0 and 1, which are made of signs: it is exact, and has the
derivatives of what is chosen. Where numbers that are compared are equal it is either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import sympy as sp

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import Graph, Ref


def program_refs(
    imported: ImportedTape, program: Program, inputs: Mapping[str, Sequence[Ref]]
) -> list[Ref]:
    """References to all entries that a program gives for those of its inputs, row by row.

    The words of a label are said of all that is made for its node.
    """
    values: dict[Node, Any] = {
        x: inputs[n] for x, n in zip(program.inputs, program.names, strict=True)
    }
    words: dict[Node, str] = {}
    for x in reversed(program.nodes):
        label = program.labels[x].words if x in program.labels else ""
        words[x] = label or next((words[reader] for reader in program.readers[x]), "")
    for x in program.nodes:
        with imported.group(words[x]):
            value = (
                values[x]
                if x in values
                else _value(imported.graph, x, [values[y] for y in x.arguments])
            )
        values[x] = np.array(value, dtype=object).reshape(x.shape)
    return [ref for x in program.outputs.values() for ref in values[x].ravel()]


def _value(graph: Graph, x: Node, operands: list[Any]) -> Any:
    """References to the entries of a node, of those of its arguments."""
    match x.operation:
        case nodes.Constant(data):
            return [graph.number(sp.Rational(str(number))) for number in np.frombuffer(data)]
        case nodes.Elementary(name) if name in _ELEMENTARY:
            return np.frompyfunc(partial(_ELEMENTARY[name], graph), len(operands), 1)(*operands)
        case nodes.RowRange(begin, end):
            return operands[0][begin:end]
        case nodes.Joining():
            return np.concatenate(operands)
        case nodes.Total(axes) if len(axes) == operands[0].ndim:
            return graph.sum(operands[0].ravel())
        case nodes.Reshaping() | nodes.Entries():
            return operands[0]
    raise ValueError(f"the graph has no {x}")


def _above(graph: Graph, a: Ref, b: Ref) -> Ref:
    """1 where a is above b, 0 below, either where they are equal."""
    half = graph.number(sp.S.Half)
    sign = graph.call("sign", graph.sum([a, graph.minus(b)]))
    return graph.sum([half, graph.product(half, sign)])


def _choice(graph: Graph, a: Ref, b: Ref, above: Ref, other: Ref) -> Ref:
    """The third value where the first is above the second, else the fourth; both are finite."""
    not_above = _above(graph, b, a)
    rest = graph.sum([graph.one, graph.minus(not_above)])
    return graph.sum([graph.product(not_above, other), graph.product(rest, above)])


def _magnitude(graph: Graph, a: Ref) -> Ref:
    return graph.product(a, graph.call("sign", a)) if graph.value(a) is None else a & ~1


_ELEMENTARY: dict[str, Callable[..., Ref]] = {
    "add": lambda graph, a, b: graph.sum([a, b]),
    "subtract": lambda graph, a, b: graph.sum([a, graph.minus(b)]),
    "multiply": Graph.product,
    "divide": lambda graph, a, b: graph.product(a, graph.reciprocal(b)),
    "minimum": lambda graph, a, b: _choice(graph, a, b, b, a),
    "maximum": lambda graph, a, b: _choice(graph, b, a, b, a),
    "absolute": _magnitude,
    "copysign": lambda graph, a, b: graph.product(_magnitude(graph, a), graph.call("sign", b)),
    "sqrt": lambda graph, a: graph.call("sqrt", a),
    "choose": _choice,
}
