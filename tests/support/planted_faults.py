"""Faults planted in emitted code: one sign or one index of one statement."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator

# Statements of the functions' bodies, in Python or in C, that compute one number; and all in C but
# those that say where an array is.
ANY_IN_C = re.compile(
    r"^ {4,}(?!for |return |\w+ \*const )[^\"]* [+*]?= [^\"]*;$|^ {4,}[a-z_]+\([^\"]*;$"
)
_STATEMENT = re.compile(r"^ {4}(?:const \w+ )?[tk]?\w+ = [^\"{]*$|^ {4}\w+\[\d+\] = [^\"{]*$")
_SIGN = re.compile(r" ([+-]) ")
_INDEX = re.compile(r"\[(\d+)\]")
_NUMBERED = re.compile(r"\b([tk])(\d+)\b")


def planted(
    text: str, count: int, seed: int, statement: re.Pattern[str] = _STATEMENT
) -> Iterator[tuple[str, str]]:
    """`count` copies of a text with one fault each, in such statements, and what the fault is."""
    lines = text.split("\n")
    sites = list(_sites(lines, statement))
    for number, start, end, replacement in random.Random(seed).sample(sites, count):  # noqa: S311
        line = lines[number]
        altered = line[:start] + replacement + line[end:]
        copy = [*lines[:number], altered, *lines[number + 1 :]]
        yield "\n".join(copy), f"line {number + 1}: {line.strip()} became {altered.strip()}"


def _sites(lines: list[str], statement: re.Pattern[str]) -> Iterator[tuple[int, int, int, str]]:
    """Places of a fault: line, columns from and to, and what is to stand there."""
    names: set[str] = set()
    for number, line in enumerate(lines):
        if line[:1] not in ("", " ", "{", "}"):  # Another function begins.
            names = set()
        if not statement.match(line):
            continue
        target, right = re.split(r" [+*]?= |\(", line, maxsplit=1)
        offset = len(line) - len(right)
        for match in _SIGN.finditer(right):
            start, end = (offset + place for place in match.span(1))
            yield number, start, end, "-" if match[1] == "+" else "+"
        for match in _INDEX.finditer(right):
            start, end = (offset + place for place in match.span(1))
            yield number, start, end, str(abs(int(match[1]) - 1))
        for match in _NUMBERED.finditer(right):
            neighbour = f"{match[1]}{int(match[2]) - 1}"
            if neighbour in names:
                start, end = (offset + place for place in match.span(2))
                yield number, start, end, neighbour[1:]
        names.update(target.split()[-1:])
