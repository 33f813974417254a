"""Signatures: the functions of the table with their sizes in one module."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from gibbs_codegen.interface.rows import sizes
from gibbs_codegen.interface.table import ARGUMENTS, FUNCTIONS, LISTS


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
    return signatures(lists, module.DERIVATIVES)


def signatures(
    lists: Mapping[str, Collection[str]], derivatives: Collection[str] = ()
) -> list[Signature]:
    """Signatures of the functions that a robot has, in the order of the table.

    `lists` is what its module lists, by the names of `table.LISTS`; those left out are empty.
    `derivatives` names the functions that were asked for.
    """
    lengths = {letter: len(lists.get(name, ())) for letter, name in LISTS.items()}
    lengths["c"] = (lengths["h"] - lengths["v"]) // 2
    lengths["s"] = 2 * lengths["v"]
    lengths["x"] = lengths["s"] + lengths["u"]
    return [
        Signature(
            row.name,
            tuple(row.arguments),
            tuple(sizes(ARGUMENTS[argument].shape, lengths) for argument in row.arguments),
            tuple(output.sizes(lengths) for output in row.outputs),
        )
        for row in FUNCTIONS.values()
        if (not row.frame or row.frame in lists["FRAMES"])
        and (not row.on_request or row.name in derivatives)
    ]
