"""Signatures: the functions of the table with their sizes in one module."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gibbs_codegen.interface.choice import default_functions
from gibbs_codegen.interface.rows import sizes
from gibbs_codegen.interface.table import ARGUMENTS, FUNCTIONS, LISTS, OWN_LISTS


@dataclass(frozen=True)
class Signature:
    """A function of one module: its arguments with their shapes, and the shapes of its outputs."""

    name: str
    arguments: tuple[str, ...]
    argument_shapes: tuple[tuple[int, ...], ...]
    shapes: tuple[tuple[int, ...], ...]

    @property
    def widths(self) -> tuple[int, ...]:
        """Entries of one state in each argument."""
        return tuple(map(math.prod, self.argument_shapes))


def module_signatures(module: Any) -> list[Signature]:
    """Signatures of a module, or of what lists the same constants, in the order of the table."""
    lists = {name: getattr(module, name, ()) for name in LISTS.values()}
    # A module of version 0.2.0 or earlier has what was then there by default.
    made = getattr(module, "FUNCTIONS", None)
    if made is None:
        made = [name for name in FUNCTIONS if hasattr(module, name)]
    return signatures(lists, made)


def entry_labels(lists: Mapping[str, Sequence[str]], signature: Signature) -> dict[str, list[str]]:
    """Labels, for reports, of the entries of arguments with shapes that reports do not know.

    `lists` is as of `signatures`. Of two axes the names are those that the first has, or else the
    second.
    """
    labels = {}
    for argument, sizes_of in zip(signature.arguments, signature.argument_shapes, strict=True):
        shape = ARGUMENTS[argument].shape
        if len(shape) == 2 and shape[0] in LISTS:
            labels[argument] = [name for name in lists[LISTS[shape[0]]] for _ in range(sizes_of[1])]
        elif len(shape) == 2:
            labels[argument] = [*lists[LISTS[shape[1]]]] * sizes_of[0]
        elif shape in OWN_LISTS:
            labels[argument] = [*lists[LISTS[shape]]]
    return labels


def signatures(
    lists: Mapping[str, Collection[str]], functions: Collection[str] | None = None
) -> list[Signature]:
    """Signatures of those of some functions that a robot has, in the order of the table.

    `lists` is what its module lists, by the names of `table.LISTS`; those left out are empty.
    Without a choice of functions these are the defaults.
    """
    lengths = {letter: len(lists.get(name, ())) for letter, name in LISTS.items()}
    lengths["c"] = (lengths["h"] - lengths["v"]) // 2
    lengths["s"] = 2 * lengths["v"]
    lengths["x"] = lengths["s"] + lengths["u"]
    chosen = default_functions() if functions is None else functions
    return [
        Signature(
            row.name,
            tuple(row.arguments),
            tuple(sizes(ARGUMENTS[argument].shape, lengths) for argument in row.arguments),
            tuple(output.sizes(lengths) for output in row.outputs),
        )
        for row in FUNCTIONS.values()
        if row.name in chosen
        and all(need in lists["FRAMES"] or lists.get(need) for need in row.needs)
    ]
