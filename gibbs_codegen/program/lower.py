"""Lowering: from the tape to the program, one slice of the tape per function, in plain nodes.

    h1 = 2*p              (stage of the parameters)
    h2 = sin(x)           (stage of the configuration)
    h3 = y/p              (stage of the configuration, and no output needs it)
    h4 = h2*h2            (stage of the configuration)
    out = [h1*h4, h4]

becomes `k1 = 2*p` in `prepare`, which all functions share and which runs once per set of
parameters, and `t1 = sin(x)`, `t2 = t1*t1`, `t3 = k1*t2`, `out = [t3, t2]` in the function. A
function takes from the graph of the tape the nodes that its outputs need, in the graph's order.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice

import sympy as sp

from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import INPUT, NUMBER, PRODUCT, RECIPROCAL, SUM, Graph, Ref, in_order
from gibbs_codegen.graph.shortening import operations as graph_operations
from gibbs_codegen.graph.shortening import optimised
from gibbs_codegen.program import nodes
from gibbs_codegen.program.inlining import inline_single_uses, substituted
from gibbs_codegen.symbolic.numbers import rounded
from gibbs_codegen.symbolic.tape import WORDS_OF_CONSTANTS, Tape


@dataclass(frozen=True)
class Slice:
    """A function before it is lowered: its name, its arguments, and its output arrays.

    Entries are expressions on the tape, or references to nodes of its graph. `groups` has the words
    of the groups as this function's derivation says them; other statements have those of the tape.
    `parts` are functions that return one of the outputs each: they take their statements of it.
    """

    name: str
    arguments: tuple[str, ...]
    outputs: tuple[tuple[tuple[int, ...], tuple[sp.Expr | Ref, ...]], ...]
    groups: Mapping[sp.Symbol, str] = field(default_factory=dict)
    parts: tuple[str, ...] = ()

    @property
    def repeats(self) -> bool:
        """True if lines are the same from link to link, as those of recursions on the tape are."""
        return not any(isinstance(e, int) for _, entries in self.outputs for e in entries)


def lower(
    tape: Tape | ImportedTape,
    inputs: Mapping[str, tuple[str, ...]],
    parameters: Sequence[str],
    slices: Sequence[Slice],
) -> nodes.ScalarProgram:
    """Lower every slice of the tape, or of its graph, into one program.

    `inputs` names the scalars in each argument. Of `parameters` the program has those that a
    function depends on, in their order.
    """
    lowering = _Lowering(_graph_of(tape))
    graph = lowering.graph
    wholes = {part: piece.name for piece in slices for part in piece.parts}
    drafted = {piece.name: lowering.draft(piece) for piece in slices if piece.name not in wholes}
    drafts = [
        drafted.get(piece.name) or lowering.part(drafted[wholes[piece.name]], piece)
        for piece in slices
    ]
    needed = set().union(*(draft.constants for draft in drafts))
    reached = graph.reached(2 * node for node in needed)
    prepare = lowering.prepare([node for node in reached if graph.operands[node]], needed)
    # Numbered from 1 in the order of `prepare`, so that the emitted names have no gaps.
    numbered = {statement.name: f"k{i}" for i, statement in enumerate(prepare, start=1)}
    constants: dict[str, nodes.Node] = {old: nodes.Name(new) for old, new in numbered.items()}
    read = {lowering.name(node) for node in reached}

    def names(numbers: set[int]) -> tuple[str, ...]:
        sorted_names = map(lowering.name, sorted(numbers))
        return tuple(numbered.get(name, name) for name in sorted_names)

    functions = []
    for draft in drafts:  # Temporaries are numbered from 1, so that each reads by itself.
        values = constants | {
            s.name: nodes.Name(f"t{i}") for i, s in enumerate(draft.statements, start=1)
        }
        statements = tuple(
            nodes.Statement(f"t{i}", substituted(statement.value, values), statement.group)
            for i, statement in enumerate(draft.statements, start=1)
        )
        outputs = tuple(
            nodes.Output(output.shape, tuple(substituted(e, values) for e in output.entries))
            for output in draft.outputs
        )
        signature = draft.piece.name, draft.piece.arguments, names(draft.constants)
        functions.append(nodes.Function(*signature, statements, outputs))
    return nodes.ScalarProgram(
        inputs=dict(inputs),
        parameters=tuple(name for name in parameters if name in read),
        constants=names(needed),
        prepare=tuple(
            nodes.Statement(numbered[s.name], substituted(s.value, constants), s.group)
            for s in prepare
        ),
        functions=tuple(functions),
    )


def operations(tape: Tape | ImportedTape, entries: Sequence[sp.Expr]) -> int:
    """Operations of a function with certain entries before it is shortened.

    Sine–cosine pairs and arctangents are not among them.
    """
    imported = _graph_of(tape)
    return graph_operations(imported.graph, [imported.ref(entry) for entry in entries])


def _graph_of(tape: Tape | ImportedTape) -> ImportedTape:
    return tape if isinstance(tape, ImportedTape) else ImportedTape(tape)


@dataclass(frozen=True)
class _Draft:
    """A function with the graph's own names, and the constant nodes that it reads."""

    piece: Slice
    constants: set[int]
    statements: list[nodes.Statement]
    outputs: list[nodes.Output]


class _Lowering:
    """Lowers nodes of a graph, each with the sign with which it is computed."""

    def __init__(self, imported: ImportedTape) -> None:
        self._imported = imported
        self.graph: Graph = imported.graph
        self.words = imported.words(imported.tape.groups)
        # By node: one object for all functions, which keeps what passes ask of it.
        self._names: dict[int, nodes.Name] = {}

    def draft(self, piece: Slice) -> _Draft:
        """Lower one slice, with what is used once written where it is used."""
        graph = self.graph
        origins: dict[int, int] = {}
        arrays = [
            [e if isinstance(e, int) else self._imported.ref(e) for e in entries]
            for _, entries in piece.outputs
        ]
        if piece.parts:  # Each output by itself first, so that what it takes alone is short too.
            arrays = [optimised(graph, x, origins, piece.repeats).outputs for x in arrays]
        shortened = optimised(graph, [*chain(*arrays)], origins, piece.repeats)
        refs, negated = shortened.outputs, shortened.polarity.negated
        computed = [node for node in in_order(graph, refs, origins) if graph.operands[node]]
        words = self._words_of(computed, piece.groups, origins)
        statements = [
            nodes.Statement(self.name(node), self.value(node, negated), words[node])
            for node in computed
        ]
        terms = iter([_with_sign(*self._signed(ref, negated)) for ref in refs])
        outputs = [
            nodes.Output(shape, tuple(islice(terms, len(entries))))
            for shape, entries in piece.outputs
        ]
        read = [ref >> 1 for node in computed for ref in graph.operands[node]]
        read.extend(ref >> 1 for ref in refs)
        constants = {n for n in read if graph.constant[n] and graph.kinds[n] is not NUMBER}
        return _Draft(piece, constants, inline_single_uses(statements, outputs), outputs)

    def part(self, whole: _Draft, piece: Slice) -> _Draft:
        """A function that returns some outputs of another, with those of its statements."""
        outputs = [whole.outputs[whole.piece.outputs.index(output)] for output in piece.outputs]
        entries = [entry for output in outputs for entry in output.entries]
        statements = nodes.needed(whole.statements, entries)
        read = {name for s in statements for name in nodes.names_in(s.value)}
        read.update(name for entry in entries for name in nodes.names_in(entry))
        constants = {number for number in whole.constants if self.name(number) in read}
        return _Draft(piece, constants, statements, outputs)

    def prepare(self, numbers: Sequence[int], needed: set[int]) -> list[nodes.Statement]:
        """Lower what parameters determine; what is used once is written where it is used.

        `numbers` are those of constant nodes, in order; `needed` are those that functions read.
        """
        words = self._words_of(numbers, {}, {})
        statements = [
            nodes.Statement(
                self.name(n), self.value(n, frozenset()), words[n] or WORDS_OF_CONSTANTS
            )
            for n in numbers
        ]
        kept = nodes.Output(
            (len(needed),), tuple(nodes.Name(self.name(node)) for node in sorted(needed))
        )
        return inline_single_uses(statements, [kept], products_only=True)

    def name(self, node: int) -> str:
        """Name of a node before statements are numbered: that of an input is its own."""
        is_input = self.graph.kinds[node] is INPUT
        return str(self.graph.labels[node]) if is_input else f"n{node}"

    def _words_of(
        self, numbers: Sequence[int], groups: Mapping[sp.Symbol, str], origins: Mapping[int, int]
    ) -> dict[int, str]:
        """Words of the groups that nodes belong to; what has none belongs to its first user's.

        `groups` are by symbol of the tape, as the function's derivation says them; `origins` are,
        of nodes that passes have made, those in whose place they stand.
        """
        texts = {**self.words, **self._imported.words(groups)}
        inherited: dict[int, str] = {}
        for node in reversed(numbers):
            origin = origins.get(node, node)
            group_words = (
                texts.get(origin) or self._imported.words_of(origin) or inherited.get(node, "")
            )
            inherited[node] = group_words
            for ref in self.graph.operands[node]:
                inherited[ref >> 1] = group_words
        return {node: inherited[node] for node in numbers}

    def value(self, node: int, negated: Collection[int]) -> nodes.Node:
        """The right-hand side of a node."""
        graph, kind = self.graph, self.graph.kinds[node]
        signed = [self._signed(ref, negated) for ref in graph.operands[node]]
        flip = -1 if (node in negated) else 1
        if kind is SUM:
            terms = [
                (flip * sign, ref >> 1, term)
                for (sign, term), ref in zip(signed, graph.operands[node], strict=True)
            ]
            # Positive terms first, numbers and oldest names first: few lines begin with a minus.
            terms.sort(key=lambda t: (-t[0], not isinstance(t[2], nodes.Number), t[1]))
            return nodes.Sum(tuple((sign, term) for sign, _, term in terms))
        if kind is PRODUCT:
            (first, x), (second, y) = signed
            return _with_sign(flip * first * second, nodes.Product((x, y)))
        ((sign, argument),) = signed
        if kind is RECIPROCAL:
            return _with_sign(flip * sign, nodes.Reciprocal(argument))
        match graph.labels[node]:
            case "cos":
                return _with_sign(flip, nodes.Call("cos", argument))
            case "sqrt":
                return _with_sign(flip, nodes.Call("sqrt", _with_sign(sign, argument)))
            case "sin" | "atan" | "sign" as odd:
                return _with_sign(flip * sign, nodes.Call(odd, argument))
            case unknown:
                raise ValueError(f"no program has a function {unknown!r}")

    def _signed(self, ref: Ref, negated: Collection[int]) -> tuple[int, nodes.Node]:
        """The sign of a value against what is computed for its node, and that."""
        node, graph = ref >> 1, self.graph
        value = graph.value(ref)
        if value is not None:
            number = rounded(value)
            return (-1, nodes.Number(-number)) if number < 0 else (1, nodes.Number(number))
        flipped = (ref & 1) ^ (node in negated)
        if node not in self._names:
            self._names[node] = nodes.Name(self.name(node))
        return (-1 if flipped else 1), self._names[node]


def _with_sign(sign: int, node: nodes.Node) -> nodes.Node:
    if sign > 0:
        return node
    return nodes.Number(-node.value) if isinstance(node, nodes.Number) else nodes.Sum(((-1, node),))
