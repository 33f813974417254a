"""Chunks of a sweep: cases that are flown and kept together, 1 to 10 s of work.

How a sweep is cut depends on its cases alone, so that the same call finds the same chunks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gibbs_codegen.errors import GibbsCodegenError
from gibbs_codegen.scenario.scenario import Scenario
from gibbs_codegen.sweeps.plan import Block, Cases

# What a chunk is to take at most, s; how many flights, and samples of them, may be in memory.
_SECONDS, _MOST_FLIGHTS, _MOST_SAMPLES = 4.0, 256, 256_000
# Entries in which flights may differ that `simulate_many` computes side by side.
_SIDE_BY_SIDE = ("plant.", "start.", "motors.time_constant")
# Entries that decide how long a flight takes.
_OF_LENGTH = ("duration", "integration", "control.rate")


@dataclass(frozen=True, eq=False)
class Chunk:
    """Cases `begin` to before `end` of one block, whose first case is number `first` of all."""

    block: Block
    first: int
    begin: int
    end: int

    def __len__(self) -> int:
        """How many cases there are."""
        return self.end - self.begin

    @property
    def rows(self) -> slice:
        """Numbers of the cases."""
        return slice(self.first + self.begin, self.first + self.end)

    def after(self, count: int) -> Chunk:
        """What is left after the first cases."""
        return replace(self, begin=self.begin + count)

    def halves(self) -> tuple[Chunk, Chunk]:
        """The first and the second half."""
        middle = (self.begin + self.end) // 2
        return replace(self, end=middle), replace(self, begin=middle)


def chunks_of(cases: Cases) -> list[Chunk]:
    """The chunks of a sweep, in the order of the cases, none with cases of two blocks."""
    found = []
    for block, first in zip(cases.blocks, cases.begins, strict=False):
        size, samples = _flights(block), block.samples
        # Samples of a combination are cut where they would be if there were more of them.
        stride = samples if samples >= size else size // samples * samples
        for outer in range(0, len(block), stride):
            end = min(outer + stride, len(block))
            for begin in range(outer, end, size):
                found.append(Chunk(block, first, begin, min(begin + size, end)))
    return found


def only_adaptive(cases: Cases) -> bool:
    """Whether nothing but the adaptive integration keeps all cases from being side by side."""
    return all(map(_only_adaptive, cases.blocks))


def _only_adaptive(block: Block) -> bool:
    try:
        scenario = block.scenario.changed(block.chosen(0)[1])
    except GibbsCodegenError:
        return False
    adaptive = scenario.integration.method == "adaptive"
    return adaptive and scenario.control.rate is None and _together(block)


def _together(block: Block) -> bool:
    """Whether flights of a block differ in nothing that keeps them from being side by side."""
    differ = [axis for axis in block.axes if len(axis.varied.levels) != 1]
    return all(key.startswith(_SIDE_BY_SIDE) for axis in differ for key in axis.targets)


def _flights(block: Block) -> int:
    """How many flights of a block make a chunk."""
    together, entries = _together(block), dict[str, Any]()
    fit = _fit(block, entries, together)
    for axis in block.axes:  # One after the other is set to what takes longest.
        if any(key.startswith(_OF_LENGTH) for key in axis.targets):
            drawn = block.drawn.get(axis.column, np.zeros(1))
            values = axis.varied.levels or (float(drawn.min()), float(drawn.max()))
            tried = [{**entries, **axis.entries(value)} for value in values]
            fits = [_fit(block, each, together) for each in tried]
            if min(fits) <= _MOST_FLIGHTS:
                fit = min(fits)
                entries = tried[fits.index(fit)]
    return min(fit, _MOST_FLIGHTS)


def _fit(block: Block, entries: Mapping[str, Any], together: bool) -> int:
    """How many flights of a block with some entries fit; if refused, more than may be."""
    try:
        scenario = block.scenario.changed(entries)
    except GibbsCodegenError:
        return _MOST_FLIGHTS + 1
    samples = scenario.duration * scenario.integration.rate
    most = min(_SECONDS / _seconds(scenario, together), _MOST_SAMPLES / samples, _MOST_FLIGHTS)
    return max(int(most), 1)


def _seconds(scenario: Scenario, together: bool) -> float:
    """What a flight will take on one core, s, roughly.

    `together` is whether flights differ in nothing that keeps them from being side by side.
    """
    settings, samples = scenario.integration, scenario.duration * scenario.integration.rate
    steps = scenario.duration / settings.step if settings.method == "rk4" else 0.0
    if together and settings.method == "rk4" and scenario.control.rate is None:
        return 2e-3 + 3e-7 * steps + 3e-6 * samples
    return 0.05 + 0.03 * scenario.duration + 1e-5 * steps + 2e-5 * samples
