"""Mutants of Python modules: the same source with one small fault, of a kind that people make.

Left alone is what no test could miss, such as imports, and what cannot change the results:
annotations, docstrings, error messages, and the `strict` of `zip`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass

_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
_PAIRS = (
    ("Zero", "One"),
    ("zero", "one"),
    ("cos", "sin"),
    ("cosine", "sine"),
    ("force", "moment"),
    ("linear", "angular"),
    ("LINEAR", "ANGULAR"),
    ("rates", "accelerations"),
    ("own", "given"),
    ("X", "Z"),
    ("min", "max"),
    ("any", "all"),
)
_OTHER_NAME = {a: b for pair in _PAIRS for a, b in (pair, pair[::-1])}
# Methods whose result is of the same kind as what they are called on.
_STEPS = {"rotated", "shifted", "plus", "displaced", "displaced_along", "spun", "slid"}
_SEQUENCES = (ast.List, ast.Tuple, ast.ListComp, ast.JoinedStr, ast.Dict, ast.DictComp)
_TYPE_NAME = re.compile(r"[A-Z][a-z]\w*")
# Arguments that no other argument could be taken for.
_CONTEXT = {"tape", "machine", "cls", "self", "inline", "robot"}

Fault = tuple[str, ast.AST]


@dataclass(frozen=True)
class Mutant:
    """One fault: its kind, its line, that line's statement before and after, and the whole text."""

    kind: str
    line: int
    before: str
    after: str
    text: str


def python_mutants(source: str) -> list[Callable[[], Mutant]]:
    """Every mutant of a module, in the order of its tree, each made when it is called."""
    tree = ast.parse(source)
    return [site.mutant for site in _sites(tree, tree, tree.body[0])]


@dataclass(frozen=True)
class _Site:
    """A node of a tree, and what could stand there instead."""

    tree: ast.Module
    statement: ast.stmt
    put: Callable[[ast.AST], None]
    old: ast.AST
    kind: str
    new: ast.AST

    def mutant(self) -> Mutant:
        before = _one_line(self.statement)
        self.put(self.new)
        text = ast.unparse(ast.fix_missing_locations(self.tree)) + "\n"
        after = _one_line(self.new if self.old is self.statement else self.statement)
        self.put(self.old)
        return Mutant(self.kind, self.statement.lineno, before, after, text)


def _one_line(statement: ast.AST) -> str:
    """A statement in one line, without what stands in its body."""
    shown = copy(statement)
    for field in ("body", "orelse"):
        if isinstance(getattr(shown, field, None), list):
            setattr(shown, field, [])
    return " ".join(ast.unparse(shown).split())


def _sites(tree: ast.Module, node: ast.AST, statement: ast.stmt) -> Iterator[_Site]:
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "format_spec", "cases"):
            continue
        for place, child in enumerate(value if isinstance(value, list) else [value]):
            if not isinstance(child, ast.AST) or _is_left_alone(child):
                continue
            inside = child if isinstance(child, ast.stmt) else statement

            def put(
                new: ast.AST, value: object = value, field: str = field, place: int = place
            ) -> None:
                if isinstance(value, list):
                    value[place] = new
                else:
                    setattr(node, field, new)

            for kind, new in _faults(child, node):
                yield _Site(tree, inside, put, child, kind, new)
            if not isinstance(child, ast.Raise):
                yield from _sites(tree, child, inside)
    # The patterns of a match are no expressions; their bodies are.
    for case in getattr(node, "cases", []):
        yield from _sites(tree, case, statement)


def _is_left_alone(node: ast.AST) -> bool:
    match node:
        case ast.Import() | ast.ImportFrom() | ast.pattern() | ast.Assert():
            return True
        case ast.Expr(ast.Constant()):
            return True
        case ast.keyword("strict"):
            return True
        case ast.Assign([ast.Name(name)]):
            return bool(_TYPE_NAME.fullmatch(name))
    return False


def _faults(node: ast.AST, parent: ast.AST) -> Iterator[Fault]:
    """What could stand for a node."""
    match node:
        case ast.BinOp():
            yield from _of_operation(node)
        case ast.AugAssign(target, operator, value):
            if type(operator) in _OPERATORS and not isinstance(value, _SEQUENCES):
                other = _OPERATORS[type(operator)]()
                yield "operator", ast.AugAssign(target, other, value)
            yield "statement", ast.Pass()
        case ast.UnaryOp(ast.USub() | ast.Not() as operator, operand):
            yield "sign" if isinstance(operator, ast.USub) else "not", operand
        case ast.Compare(left, operators, comparators):
            for i, operator in enumerate(operators):
                others = [*operators[:i], _COMPARISONS[type(operator)](), *operators[i + 1 :]]
                yield "comparison", ast.Compare(left, others, comparators)
        case ast.BoolOp(operator, values):
            other = ast.Or() if isinstance(operator, ast.And) else ast.And()
            yield "boolean", ast.BoolOp(other, values)
            yield from (("term", _without(node, values, i)) for i in range(len(values)))
        case ast.If(test, body, orelse):
            yield "condition", ast.If(ast.UnaryOp(ast.Not(), test), body, orelse)
        case ast.IfExp(test, body, orelse):
            yield "condition", ast.IfExp(test, orelse, body)
        case ast.comprehension(target, iterable, [_, *_], is_async):
            yield "condition", ast.comprehension(target, iterable, [], is_async)
        case ast.Slice():
            yield from _of_slice(node)
        case ast.Subscript(value, index, context) if _is_place(index):
            for step in (ast.Add(), ast.Sub()):
                yield "index", ast.Subscript(value, _stepped(index, step), context)
        case ast.Constant(bool() as value):
            yield "constant", ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            if not isinstance(parent, ast.Subscript | ast.Slice):
                yield "constant", ast.Constant(value + 1)
        case ast.Name(name, ast.Load()) if name in _OTHER_NAME:
            yield "name", ast.Name(_OTHER_NAME[name], ast.Load())
        case ast.Attribute(value, name, ast.Load()) if name in _OTHER_NAME:
            yield "name", ast.Attribute(value, _OTHER_NAME[name], ast.Load())
        case ast.Attribute(value, "inverse"):
            yield "term", value
        case ast.Call():
            yield from _of_call(node)
        case ast.Tuple(elements, ast.Load()):
            yield from (("arguments", ast.Tuple(s, ast.Load())) for s in _swapped(elements))
        case ast.Expr() | ast.Assign([ast.Subscript() | ast.Attribute()]):
            yield "statement", ast.Pass()
        case ast.Continue() | ast.Break() | ast.Raise():
            yield "statement", ast.Pass()


def _of_operation(node: ast.BinOp) -> Iterator[Fault]:
    is_text = isinstance(node.left, ast.Constant) and isinstance(node.left.value, str)
    joins = isinstance(node.left, _SEQUENCES) or isinstance(node.right, _SEQUENCES) or is_text
    is_type = isinstance(node.op, ast.BitOr) and isinstance(node.right, ast.Name | ast.Attribute)
    if is_type and isinstance(node.left, ast.Name) and _TYPE_NAME.fullmatch(node.left.id):
        return
    if type(node.op) in _OPERATORS and not joins:
        yield "operator", ast.BinOp(node.left, _OPERATORS[type(node.op)](), node.right)
    if isinstance(node.op, ast.Add | ast.Sub | ast.Mult):
        yield "term", node.left
        is_minus = isinstance(node.op, ast.Sub)
        yield "term", ast.UnaryOp(ast.USub(), node.right) if is_minus else node.right


def _of_slice(node: ast.Slice) -> Iterator[Fault]:
    if node.step is not None and node.lower is None and node.upper is None:
        yield "index", ast.Slice()
    for end in ("lower", "upper"):
        bound = getattr(node, end)
        if bound is not None:
            for step in (ast.Add(), ast.Sub()):
                moved = copy(node)
                setattr(moved, end, _stepped(bound, step))
                yield "index", moved


def _of_call(node: ast.Call) -> Iterator[Fault]:
    if isinstance(node.func, ast.Name) and node.func.id == "isinstance":
        return
    if isinstance(node.func, ast.Attribute):
        if node.func.attr in _STEPS:
            yield "term", node.func.value
        elif node.func.attr == "vector":
            yield "term", node.args[-1]
    fixed = [a for a in node.args if isinstance(a, ast.Name) and a.id in _CONTEXT]
    free = node.args[len(fixed) :]
    if not any(isinstance(argument, ast.Starred) for argument in node.args):
        for arguments in _swapped(free):
            yield "arguments", ast.Call(node.func, [*fixed, *arguments], node.keywords)


def _swapped(nodes: list[ast.expr]) -> Iterator[list[ast.expr]]:
    """The nodes with two neighbours swapped that are not the same."""
    for i in range(len(nodes) - 1):
        if ast.dump(nodes[i]) != ast.dump(nodes[i + 1]):
            yield [*nodes[:i], nodes[i + 1], nodes[i], *nodes[i + 2 :]]


def _without(node: ast.BoolOp, values: list[ast.expr], i: int) -> ast.expr:
    rest = [*values[:i], *values[i + 1 :]]
    return ast.BoolOp(node.op, rest) if len(rest) > 1 else rest[0]


def _is_place(index: ast.expr) -> bool:
    """Whether an index counts: a number, a letter, or a sum or difference of such."""
    match index:
        case ast.Constant(value):
            return isinstance(value, int)
        case ast.Name(name):
            return len(name) == 1 and name in "ijkmnpqr"
        case ast.UnaryOp(ast.USub(), operand):
            return _is_place(operand)
        case ast.BinOp(left, ast.Add() | ast.Sub(), right):
            return _is_place(left) and _is_place(right)
    return False


def _stepped(index: ast.expr, step: ast.operator) -> ast.expr:
    moved = ast.BinOp(index, step, ast.Constant(1))
    try:
        return ast.Constant(ast.literal_eval(index) + (1 if isinstance(step, ast.Add) else -1))
    except ValueError:
        return moved
