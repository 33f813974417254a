"""Record of every test how long it takes and which lines of the package it executes.

    python -m pip install coverage
    python tests/mutation/record.py [FILES]

runs the test files, those given or all, each in a process of its own, two at a time, those
marked `slow` too. What each test gives is kept in pytest's cache. By it
`survivors.py` has a fault found by tests that execute its line. Lines
that a process started by a test executes are not recorded. Run the tests once before: else what
they compile and keep for later is part of their time.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "gibbs_codegen"
# Imported once, for all the processes that are forked to run tests.
LIBRARIES = ("scipy.integrate", "sympy", "jinja2", "pinocchio", "matplotlib.pyplot", "rich.table")


@dataclass(frozen=True)
class Record:
    """One test: its time, and the lines that it executes by file, a bit each."""

    seconds: float  # Of processors, without those of fixtures that are shared.
    lines: dict[str, int] = field(repr=False)


def records(folder: Path) -> dict[str, Record]:
    """All that has been recorded, by the name of the test."""
    found = {}
    for path in sorted(folder.glob("*.json")):
        for test, (seconds, lines) in json.loads(path.read_text(encoding="utf-8")).items():
            found[test] = Record(seconds, {file: int(of, 16) for file, of in lines.items()})
    return found


def _used() -> float:
    """Seconds of processors that this process and those that it waited for have used.

    The clock would tell what else the machine does.
    """
    return sum(os.times()[:4])


class Recorder:
    """A plugin of pytest that tells coverage.py which test or fixture is at work."""

    def __init__(self) -> None:
        from coverage import Coverage

        self._coverage = Coverage(data_file=None, source=[str(PACKAGE)], config_file=False)
        self._coverage.start()
        self._context = ""
        self._seconds: dict[str, float] = {}
        self._fixtures: dict[str, set[str]] = {}
        self._passed: set[str] = set()
        self._in_fixtures = 0.0

    def _switch(self, context: str) -> str:
        before, self._context = self._context, context
        self._coverage.switch_context(context)
        return before

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Switch to a test."""
        self._switch(item.nodeid)
        self._in_fixtures, begun = 0.0, _used()
        yield
        self._seconds[item.nodeid] = _used() - begun - self._in_fixtures
        self._fixtures[item.nodeid] = {f"fixture {name}" for name in item.fixturenames}
        self._switch("")

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        """Switch to a fixture, whose lines all tests share that name it."""
        before, begun = self._switch(f"fixture {fixturedef.argname}"), _used()
        own = self._in_fixtures
        yield
        if fixturedef.scope != "function":
            self._in_fixtures = own + _used() - begun
        self._switch(before)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Only tests that pass are of use."""
        if report.when == "call" and report.passed:
            self._passed.add(report.nodeid)

    def recorded(self) -> dict[str, tuple[float, dict[str, str]]]:
        """Seconds and lines of each test that passed."""
        self._coverage.stop()
        data = self._coverage.get_data()
        executed: dict[str, Counter[str]] = {}
        for path in data.measured_files():
            file = Path(path).relative_to(ROOT).as_posix()
            for line, contexts in data.contexts_by_lineno(path).items():
                for context in contexts:
                    executed.setdefault(context, Counter())[file] += 1 << line
        told = {}
        for test in sorted(self._passed):
            lines: dict[str, int] = {}
            for context in (test, *self._fixtures[test]):
                for file, bits in executed.get(context, {}).items():
                    lines[file] = lines.get(file, 0) | bits
            kept = {file: f"{bits:x}" for file, bits in sorted(lines.items())}
            told[test] = (round(self._seconds[test], 3), kept)
        return told


def _import_libraries() -> None:
    for name in LIBRARIES:
        import_module(name)


def _run(file: str, marks: str, cache: str) -> tuple[str, int, float]:
    """Run one file of tests, and write what was recorded."""
    begun = time.monotonic()
    process = get_context("fork").Process(target=_record, args=(file, marks, cache))
    process.start()
    process.join()
    return file, process.exitcode or 0, time.monotonic() - begun


def _record(file: str, marks: str, cache: str) -> None:
    os.chdir(ROOT)
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    # Not before: a process that tries faults in a copy of the package has the copy's.
    from support import kept

    # Each test is to execute what it needs, whatever another has left.
    kept.kept_folder = lambda *_: Path(tempfile.mkdtemp(dir=cache)) / "new"
    recorder = Recorder()
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1)
        options = ("-q", "--no-header", "-o", f"cache_dir={cache}", "-m", marks)
        code = pytest.main([*options, file], plugins=[recorder])
    told = Path(cache, "d", "records", f"{file.replace('/', '.')}.json")
    told.parent.mkdir(parents=True, exist_ok=True)
    known = json.loads(told.read_text(encoding="utf-8")) if told.exists() else {}
    told.write_text(json.dumps(known | recorder.recorded()), encoding="utf-8")
    os._exit(0 if code == pytest.ExitCode.NO_TESTS_COLLECTED else int(code))


def main() -> None:
    """Record all files, and say how long each took."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="*", help="test files; all, if none is given")
    parser.add_argument("-m", dest="marks", default="", help="marks of pytest")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cache", default=str(ROOT / ".pytest_cache"))
    options = parser.parse_args()
    every = sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("tests/**/test_*.py"))
    context = get_context("spawn")
    with ProcessPoolExecutor(options.jobs, context, _import_libraries) as pool:
        tasks = [
            pool.submit(_run, file, options.marks, options.cache) for file in options.files or every
        ]
        for task in tasks:
            file, code, seconds = task.result()
            print(f"{seconds:6.1f} s  {file}{'  FAILED' if code else ''}", flush=True)


if __name__ == "__main__":
    main()
