"""Programs as text, as in the docstrings of `gibbs_codegen.program`: `t2 = x - 2*sin(t1)`."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from types import ModuleType

from gibbs_codegen.program.nodes import (
    Call,
    Name,
    Node,
    Number,
    Product,
    Reciprocal,
    Statement,
    Sum,
)
from gibbs_codegen.program.steps import Step, Store


def examples(module: ModuleType) -> list[list[str]]:
    """The indented blocks of lines in the docstring of a module."""
    paragraphs = [paragraph.splitlines() for paragraph in (module.__doc__ or "").split("\n\n")]
    return [
        [line.strip() for line in lines]
        for lines in paragraphs
        if all(line.startswith("    ") for line in lines)
    ]


def node(text: str) -> Node:
    """The node of an expression."""
    return _node(ast.parse(text, mode="eval").body)


def steps(lines: Iterable[str]) -> list[Step]:
    """Statements `t1 = x + y` and stores `out[2] = t1`."""
    found: list[Step] = []
    for line in lines:
        target, _, value = line.partition(" = ")
        if target.startswith("out["):
            found.append(Store(0, int(target[4:-1]), node(value)))
        else:
            found.append(Statement(target, node(value)))
    return found


def statements(lines: Iterable[str]) -> tuple[Statement, ...]:
    """Statements `t1 = x + y`, but for lines `out = [t1, t2]`."""
    kept = steps(line for line in lines if not line.startswith("out = "))
    return tuple(step for step in kept if isinstance(step, Statement))


def entries(lines: Iterable[str]) -> tuple[Node, ...]:
    """What a line `out = [t1, 2*t2]` says."""
    (text,) = (line.removeprefix("out = ") for line in lines if line.startswith("out = "))
    row = ast.parse(text, mode="eval").body
    assert isinstance(row, ast.List)
    return tuple(map(_node, row.elts))


def _node(tree: ast.expr) -> Node:
    match tree:
        case ast.Name(id=name):
            return Name(name)
        case ast.Constant(value=int(value)):
            return Number(float(value))
        case ast.BinOp(op=ast.Add() | ast.Sub()):
            return Sum(tuple(_terms(tree)))
        case ast.BinOp(op=ast.Mult()):
            return Product(tuple(_factors(tree)))
        case ast.BinOp(left=ast.Constant(value=1), op=ast.Div(), right=argument):
            return Reciprocal(_node(argument))
        case ast.Call(func=ast.Name(id="sin" | "cos" as function), args=[argument]):
            return Call("sin" if function == "sin" else "cos", _node(argument))
    raise ValueError(ast.unparse(tree))


def _terms(tree: ast.expr) -> list[tuple[int, Node]]:
    match tree:
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return [*_terms(left), (1, _node(right))]
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return [*_terms(left), (-1, _node(right))]
    return [(1, _node(tree))]


def _factors(tree: ast.expr) -> list[Node]:
    match tree:
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return [*_factors(left), _node(right)]
    return [_node(tree)]
