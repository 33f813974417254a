"""Live ranges of names, in sections: from the first definition to the last use.

    section 0:  t1 = x + y
    section 1:  t2 = t1*x
    section 2:  t3 = t2 + t1

Here `t1` is live from section 0 to 2 and `t2` from 1 to 2, so they need a slot each. A straight
section reloads all it needs before it spills, so `t3` may take the slot of either. In a loop, the
result of an iteration may take the slot of a name that no other iteration uses.
"""

from __future__ import annotations

from collections.abc import Sequence

from gibbs_codegen.program.steps import Item, Loop, defined_names, used_names

# Stands for every iteration of a loop.
_EVERY = -1


class LiveRanges:
    """The section that defines each name, and the last that uses it.

    `first_definition` and `last_use` have the names that a step or a loop defines, not the inputs;
    a name that nothing uses ends where it is defined.
    """

    def __init__(self, sections: Sequence[Sequence[Item]]) -> None:
        self.first_definition: dict[str, int] = {}
        self.last_use: dict[str, int] = {}
        # Of each loop, by section: the iterations that use a name, and the one that defines it.
        self._using: dict[int, dict[str, set[int]]] = {}
        self._defining: dict[int, dict[str, int]] = {}
        for i, section in enumerate(sections):
            for item in section:
                defined = dict.fromkeys(defined_names(item), i)
                self.first_definition.update(defined)
                self.last_use.update(defined)
                self.last_use.update(
                    (name, i) for name in used_names(item) if name in self.first_definition
                )
                if isinstance(item, Loop):
                    self._add_loop(i, item)

    def _add_loop(self, section: int, loop: Loop) -> None:
        using: dict[str, set[int]] = {name: {_EVERY} for name in loop.invariants}
        for row in loop.operands.values():
            for iteration, name in enumerate(row):
                using.setdefault(name, set()).add(iteration)
        self._using[section] = using
        self._defining[section] = {
            name: iteration for row in loop.results.values() for iteration, name in enumerate(row)
        }

    @property
    def slotted(self) -> list[str]:
        """Names that need a slot: a later section uses them, or they are results of a loop."""
        return [
            name
            for name, i in self.first_definition.items()
            if self.last_use[name] > i or self.is_loop(i)
        ]

    def is_loop(self, section: int) -> bool:
        """Whether a section is a loop, not straight-line steps."""
        return section in self._defining

    def can_share(self, first: str, second: str) -> bool:
        """Whether two names can have one slot: one is no longer used when the other is defined."""
        if self.first_definition[first] > self.first_definition[second]:
            first, second = second, first
        start, end = self.first_definition[second], self.last_use[first]
        if end != start or self.first_definition[first] == start:
            return end < start
        # A straight section reloads all before it spills; a loop, all of one iteration.
        return not self.is_loop(start) or (
            self._using[start][first] == {self._defining[start][second]}
        )
