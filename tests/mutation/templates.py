"""Mutants of templates: one operator, number or statement of the emitted language changed.

Comments and docstrings are left alone, and so are the lines of the preprocessor, most of which
choose between compilers of which a machine has but one or two.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from mutation.mutants import Mutant

_OPERATORS = {
    "+": "-",
    "-": "+",
    "*": "+",
    "/": "*",
    "<": "<=",
    ">": ">=",
    "==": "!=",
    "!=": "==",
    "<<": ">>",
    ">>": "<<",
    "&": "|",
    "|": "&",
    "^": "|",
    "&&": "||",
    "||": "&&",
    "+=": "-=",
    "or": "and",
    "and": "or",
}
_LEFT_ALONE = re.compile(
    r"/\*.*?\*/|\"\"\".*?\"\"\"|^\s*#(?:[^\n]*\\\n)*[^\n]*|(?<=\s)# [^\n]*|\"[^\"\n]*\""
    r"|\{%.*?%\}|\{\{.*?\}\}|^\s*%[^\n]*|'[^'\n]*'",
    re.DOTALL | re.MULTILINE,
)
_OPERATOR = re.compile(r"(?<= )(?:==|!=|<<|>>|&&|\|\||\+=|[-+*/<>&|^]|or|and)(?= (?!None))")
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.])")
_STATEMENT = re.compile(
    r"^ +(?:\w+\([^\n{}]*\)|[\w\[\]*]+ [-+|&^]?= [^\n{}]*|return [^\n{}]*);$", re.MULTILINE
)


def template_mutants(template: str) -> list[Callable[[], Mutant]]:
    """Every mutant of a template, in the order of its text, each made when it is called."""
    code = _LEFT_ALONE.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), template)
    return [
        lambda change=change: _mutant(template, *change)
        for change in sorted(_changes(code), key=lambda change: change[1])
    ]


def _changes(code: str) -> Iterator[tuple[str, int, int, str]]:
    """Kinds of faults, where they begin and end, and what stands there instead."""
    for match in _OPERATOR.finditer(code):
        yield "operator", match.start(), match.end(), _OPERATORS[match[0]]
    for match in _NUMBER.finditer(code):
        yield "constant", match.start(), match.end(), str(int(match[0][0]) + 1) + match[0][1:]
    for match in _STATEMENT.finditer(code):
        yield "statement", match.start(), match.end(), ""


def _mutant(template: str, kind: str, start: int, end: int, new: str) -> Mutant:
    first = template.rfind("\n", 0, start) + 1
    last = template.find("\n", end)
    before = template[first:last].strip()
    after = f"{template[first:start]}{new}{template[end:last]}".strip()
    line = template.count("\n", 0, start) + 1
    return Mutant(kind, line, before, after, template[:start] + new + template[end:])
