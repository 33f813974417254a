"""Choose which tests the default run and CI leave out, and write `tests/left_out.txt`.

    python tests/mutation/record.py
    python tests/mutation/survivors.py --count 600
    python tests/mutation/selection.py

The default run has every case that is quick, the quick tests of `suites.py`, and of the others as
few as execute the lines of the package that any case executes, and find the faults that any case
found, the most for their time first; but none that is marked `slow` by hand. What adds next to
nothing for its time is left to CI, which has besides what alone executes a line or finds a fault,
and of every test at least the quickest case. The rest is exhaustive, as are tests that say so
themselves. New tests, which are not recorded, run by default.
"""

from __future__ import annotations

import argparse
import heapq
import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))

from support.left_out import LEFT_OUT, left_out

from mutation.record import ROOT, Record, records
from mutation.suites import QUICK_TESTS

# A case that takes less runs always; a longer one by default if it adds as many lines a second. A
# fault that a case finds is worth so many lines.
QUICK_SECONDS = 0.25
LINES_PER_SECOND = 3.0
LINES_OF_A_FAULT = 20


class Cases:
    """A plugin of pytest: names of all cases, and what is marked by hand."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.exhaustive: set[str] = set()
        self.slow: set[str] = set()

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Take the cases before `conftest.py` marks what the file tells."""
        self.names = [item.nodeid for item in items]
        self.exhaustive = {i.nodeid for i in items if i.get_closest_marker("exhaustive")}
        self.slow = {i.nodeid for i in items if i.get_closest_marker("slow")} - self.exhaustive


class Covered:
    """Lines and faults that the tests chosen so far execute and find."""

    def __init__(self, recorded: Mapping[str, Record], found: Mapping[str, str]) -> None:
        self._recorded = recorded
        self._found: dict[str, set[str]] = {}
        for fault, test in found.items():
            self._found.setdefault(test, set()).add(fault)
        self._lines: dict[str, int] = {}
        self._faults: set[str] = set()

    def gain(self, test: str) -> int:
        """How many lines and faults a test would add."""
        lines = sum(
            (bits & ~self._lines.get(file, 0)).bit_count()
            for file, bits in self._recorded[test].lines.items()
        )
        return lines + LINES_OF_A_FAULT * len(self._found.get(test, set()) - self._faults)

    def add(self, test: str) -> None:
        """Choose a test."""
        for file, bits in self._recorded[test].lines.items():
            self._lines[file] = self._lines.get(file, 0) | bits
        self._faults |= self._found.get(test, set())

    def chosen(self, candidates: Iterable[str], least: float = 0.0) -> list[str]:
        """As few candidates as add what all of them do, those that add most for their time first.

        Left out are those that add no more than `least` lines a second. What a test adds never
        grows, so that the first whose gain is still what it was is the best.
        """
        queue = [(-self.gain(t) / self._recorded[t].seconds, t) for t in candidates]
        heapq.heapify(queue)
        chosen = []
        while queue:
            _, test = heapq.heappop(queue)
            rate = -self.gain(test) / self._recorded[test].seconds
            if -rate <= least:
                continue
            if queue and rate > queue[0][0]:
                heapq.heappush(queue, (rate, test))
                continue
            self.add(test)
            chosen.append(test)
        return chosen


def selection(
    cases: Cases, recorded: Mapping[str, Record], found: Mapping[str, str], old: Mapping[str, str]
) -> dict[str, str]:
    """The mark of each case that is left out, where it is not marked so by hand."""
    names = [name for name in cases.names if name not in cases.exhaustive]
    known = {test: recorded[test] for test in names if test in recorded}
    covered = Covered(recorded, found)
    candidates = known.keys() - cases.slow
    chosen = {t for t in candidates if known[t].seconds < QUICK_SECONDS or _is_named(t)}
    for test in chosen:
        covered.add(test)
    chosen.update(covered.chosen(candidates - chosen, LINES_PER_SECOND))
    left_out = {name: old.get(name) or old.get(name.partition("[")[0], "") for name in names}
    chosen.update(n for n in names if n not in known and n not in cases.slow and not left_out[n])
    in_ci = chosen | set(covered.chosen(known.keys() - chosen))
    tests = {name.partition("[")[0] for name in in_ci}
    for name in sorted(names, key=lambda name: known[name].seconds if name in known else 1e3):
        is_of_ci = name in known or name in cases.slow or left_out[name] == "slow"
        if is_of_ci and name.partition("[")[0] not in tests:
            in_ci.add(name)
            tests.add(name.partition("[")[0])
    marks = {name: "slow" if name in in_ci else "exhaustive" for name in names}
    return {name: mark for name, mark in marks.items() if name not in chosen}


def _is_named(test: str) -> bool:
    """Whether a case, all cases of its test, or all tests of its file are named in `suites.py`."""
    return not QUICK_TESTS.isdisjoint({test, test.partition("[")[0], test.partition("::")[0]})


def text(names: Iterable[str], marks: Mapping[str, str]) -> str:
    """The file: a line for each case, or for a test all of whose cases have the same mark."""
    cases: dict[str, list[str]] = {}
    for name in names:
        cases.setdefault(name.partition("[")[0], []).append(name)
    lines = []
    for test, of_test in cases.items():
        found = {marks.get(name) for name in of_test}
        if len(found) == 1:
            lines += [f"{mark} {test}" for mark in found if mark]
        else:
            lines += [f"{marks[name]} {name}" for name in of_test if name in marks]
    return "".join(f"{line}\n" for line in sorted(lines, key=lambda line: line.split(" ", 1)[1]))


def main() -> None:
    """Write the file, and say what each run takes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cache", type=Path, default=ROOT / ".pytest_cache", help="pytest's")
    options = parser.parse_args()
    cases = Cases()
    pytest.main(["--collect-only", "-qqqq", "-m", "", str(ROOT / "tests")], plugins=[cases])
    kept = options.cache / "d"
    recorded = records(kept / "records")
    faults = kept / "found.json"
    found = json.loads(faults.read_text(encoding="utf-8")) if faults.exists() else {}
    marks = selection(cases, recorded, found, left_out())
    LEFT_OUT.write_text(text(cases.names, marks), encoding="utf-8")
    for run, mark in (("default run", None), ("slow", "slow"), ("exhaustive", "exhaustive")):
        of_run = [t for t in cases.names if marks.get(t) == mark and t not in cases.exhaustive]
        seconds = sum(recorded[test].seconds for test in of_run if test in recorded)
        unknown = sum(test not in recorded for test in of_run)
        print(f"{run}: {len(of_run)} cases, {seconds:.0f} s and {unknown} that are not recorded")


if __name__ == "__main__":
    main()
