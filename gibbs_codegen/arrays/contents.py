"""Calls and invocations of a program, with those in the programs that it invokes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from gibbs_codegen.arrays.nodes import (
    Call,
    Elementary,
    External,
    Node,
    Program,
    Solution,
)
from gibbs_codegen.errors import UsageError

Operation = TypeVar("Operation")


def nodes_of(program: Program, kind: type[Operation]) -> Iterator[tuple[Node, Operation]]:
    """Nodes with operations of a kind, and these."""
    for part in (*program.inner, program):
        for x in part.nodes:
            if isinstance(x.operation, kind):
                yield x, x.operation


def owners_of(program: Program) -> list[str]:
    """Whose constants a program needs."""
    return sorted({call.functions.owner for _, call in nodes_of(program, Call)})


def externals_of(program: Program) -> set[str]:
    """Names of functions written by hand that a program calls."""
    return {external.name for _, external in nodes_of(program, External)}


def solve_room(program: Program) -> int:
    """Entries of the largest matrix that a program solves with, 1 at least."""
    return max((x.arguments[0].size for x, _ in nodes_of(program, Solution)), default=1)


def elementaries_of(program: Program) -> set[str]:
    """Names of the elementary functions that a program has."""
    return {elementary.name for _, elementary in nodes_of(program, Elementary)}


def functions_of(program: Program) -> list[tuple[str, str]]:
    """Names of module and function of all that a program calls."""
    calls = nodes_of(program, Call)
    return list(dict.fromkeys((call.functions.name, call.name) for _, call in calls))


def check_distinct(programs: Iterable[Program]) -> None:
    """Raise `UsageError` for different programs of one name: text has one function per name."""
    names = [program.name for program in dict.fromkeys(programs)]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UsageError(f"two programs are called {' and '.join(twice)}; rename one of them")
