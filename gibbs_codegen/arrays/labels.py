"""Names and words of a program's nodes, which text in other languages shows."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from functools import wraps
from typing import ParamSpec

from gibbs_codegen.arrays.nodes import Coordinates, Label, Node, Program

P = ParamSpec("P")
_LABELS: ContextVar[dict[Node, Label] | None] = ContextVar("labels", default=None)


def labelled(build: Callable[P, Program]) -> Callable[P, Program]:
    """A function that makes a program, which has the labels that nodes are given on the way.

    Programs share nodes: the text of one does not depend on what another calls them.
    """

    @wraps(build)
    def built(*args: P.args, **kwargs: P.kwargs) -> Program:
        labels: dict[Node, Label] = {}
        before = _LABELS.set(labels)
        try:
            return replace(build(*args, **kwargs), labels=labels)
        finally:
            _LABELS.reset(before)

    return built


def named(x: Node, name: str, words: str = "") -> Node:
    """A node, with the name of its variable elsewhere and a sentence that stands before it."""
    labels = _LABELS.get()
    if labels is not None:
        label(labels, x, Label(name, words))
    return x


def label(labels: dict[Node, Label], x: Node, its: Label) -> None:
    """Give a node a label; the entries of coordinates are what is computed."""
    labels[x] = its
    if isinstance(x.operation, Coordinates):
        label(labels, x.arguments[0], its)
