"""Names and words of nodes, which text in other languages shows."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

from gibbs_codegen.arrays.nodes import Coordinates, Node


class Label(NamedTuple):
    """The name of a variable, and a sentence on what it is."""

    name: str
    words: str = ""


LABELS: WeakKeyDictionary[Node, Label] = WeakKeyDictionary()


def named(x: Node, name: str, words: str = "") -> Node:
    """A node, with the name of its variable elsewhere and a sentence that stands before it.

    Programs share nodes: the last name counts, so that text does not depend on older programs.
    """
    LABELS[x] = Label(name, words)
    if isinstance(x.operation, Coordinates):  # Their entries are what is computed.
        named(x.arguments[0], name, words)
    return x
