"""What a worker is told of a chunk, and the digest that its results are kept by."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from gibbs_codegen.sweeps.chunks import Chunk
from gibbs_codegen.sweeps.fingerprint import fingerprint
from gibbs_codegen.sweeps.measures import Measure, packed
from gibbs_codegen.sweeps.work import Task
from gibbs_codegen.version import __version__


class Job:
    """Flights and measures."""

    def __init__(self, measures: Mapping[str, Measure]) -> None:
        self.measures = dict(measures)
        self._packed = packed(measures)
        self._digests: dict[tuple[int, int], str] = {}
        self._of_measures = fingerprint(list(self.measures.values()))

    def task(self, chunk: Chunk) -> Task:
        """What a worker is told: the flights of a chunk."""
        robot, scenario = chunk.block.robot, chunk.block.scenario
        return Task(str(robot.folder), robot.digest, scenario, _changes(chunk), self._packed)

    def digest(self, chunk: Chunk) -> str:
        """The SHA-256, in hexadecimal digits, of all that determines the results of a chunk."""
        place = (chunk.first + chunk.begin, len(chunk))
        if place not in self._digests:
            robot, scenario = chunk.block.robot, chunk.block.scenario
            changes = json.dumps(_changes(chunk), default=fingerprint)
            told = (robot.digest, scenario.text, scenario.given, self._of_measures, changes)
            self._digests[place] = fingerprint(__version__, *told)
        return self._digests[place]


def _changes(chunk: Chunk) -> list[dict[str, Any]]:
    """What each case of a chunk has of its own."""
    return [chunk.block.chosen(place)[1] for place in range(chunk.begin, chunk.end)]
