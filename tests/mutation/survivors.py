"""Put small faults into the package and see whether its tests find them.

    python tests/mutation/record.py
    python tests/mutation/survivors.py --seed 1 --count 200

draws faults evenly over the modules and templates. Each is put by itself into a copy of the
package, where the tests that concern its line are run until one fails: the quick ones for all
faults, then the others for what is left. Printed are the verdicts, and at the end how many were
found, and what survived. The same seed draws the same faults from the same source. `--only` takes
modules or groups of them (`--list` tells them), and single faults by the names that are printed,
such as `serial:17`.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import json
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))

from mutation.mutants import Mutant, python_mutants
from mutation.record import LIBRARIES, PACKAGE, ROOT, records
from mutation.suites import GROUPS, suite_of
from mutation.templates import template_mutants

COPIED = (
    *("gibbs_codegen", "templates", "tests", "generated", "benchmarks", "docs", "notebooks"),
    *("pyproject.toml", "setup.py", "README.md"),
)
_PROCESSES = get_context("fork")
_OURS = {str(Path(__file__).parent), str(Path(__file__).parent.parent)}
# What the quick tests and all the others may take, in seconds: several times what they do.
QUICK_LIMIT, LIMIT = 300.0, 1800.0


@dataclass(frozen=True)
class Fault:
    """A mutant by the module that it is of and its number among the module's."""

    module: str
    number: int
    mutant: Mutant

    @property
    def name(self) -> str:
        """What `--only` takes."""
        return f"{self.module}:{self.number}"

    def text(self) -> str:
        """Where it is, and what it changes."""
        before, after = excerpts(self.mutant.before, self.mutant.after)
        return f"{self.name}, line {self.mutant.line}, {self.mutant.kind}: {before}  ->  {after}"


class Copy:
    """A copy of the package and its tests in a folder of its own, in which faults are put."""

    def __init__(self, folder: Path, cache: Path) -> None:
        self._folder = folder
        self._recorded = records(cache / "d" / "records")
        # What tests keep between runs; what faults change is kept in the copy.
        modules = folder / "cache" / "d" / "modules"
        modules.mkdir(parents=True)
        for kept in (*cache.glob("d/compiled"), *cache.glob("d/modules/*")):
            (folder / "cache" / kept.relative_to(cache)).symlink_to(kept)
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                # The extension that is installed has no fault: each copy compiles its own.
                ignored = shutil.ignore_patterns("__pycache__", "*.so")
                shutil.copytree(source, folder / name, ignore=ignored)
            else:
                shutil.copy(source, folder / name)
        self.found: dict[str, str] = {}  # Tests by the names of the faults that they find.
        self._passing: set[str] = set()
        self._failing: list[str] = []

    @contextlib.contextmanager
    def with_fault(self, fault: Fault) -> Iterator[None]:
        """The copy with one fault in it."""
        path = self._folder / source_path(fault.module).relative_to(ROOT)
        original = path.read_text(encoding="utf-8")
        # Two faults may have the same size and second, by which Python knows what it has compiled.
        compiled = Path(importlib.util.cache_from_source(str(path)))
        path.write_text(fault.mutant.text, encoding="utf-8")
        compiled.unlink(missing_ok=True)
        try:
            yield
        finally:
            path.write_text(original, encoding="utf-8")
            compiled.unlink(missing_ok=True)

    def verdict(self, fault: Fault, is_quick: bool) -> str:
        """What finds a fault, in the quick tests or in the others: a failing test, or the clock.

        Empty if nothing does. A test that fails without the fault too finds nothing.
        """
        suite = suite_of(fault.module, fault.mutant.line, self._recorded)
        tests, limit, options = suite.quick, QUICK_LIMIT, [*self._failing]
        if not is_quick:
            tests, limit = suite.rest, LIMIT
            options += [f"--deselect={test}" for test in suite.quick]
        while True:
            with self.with_fault(fault):
                found = self._failure((*tests, *options), limit)
            test = found.partition(" - ")[0]
            if not test.startswith("tests/"):
                return found
            if test in self._passing or not self._failure((test,), limit):
                self._passing.add(test)
                self.found[fault.name] = test
                return found
            self._failing.append(f"--deselect={test}")
            options.append(f"--deselect={test}")

    def _failure(self, arguments: Sequence[str], limit: float) -> str:
        """The first test that fails, and why; empty if all pass."""
        said = self._folder / "said.txt"
        process = _PROCESSES.Process(target=_run_tests, args=(self._folder, arguments, said))
        process.start()
        process.join(limit)
        if process.is_alive():
            os.killpg(process.pid or 0, signal.SIGKILL)
            process.join()
            return f"no end within {limit:.0f} s"
        if process.exitcode == 0:
            return ""
        text = said.read_text(encoding="utf-8")
        told = re.search(r"^(?:FAILED|ERROR) (.*)$", text, re.MULTILINE)
        return told[1] if told else text.strip().rpartition("\n")[2][:160]


def _run_tests(folder: Path, arguments: Sequence[str], said: Path) -> None:
    """Run tests of a copy in a process that has the libraries, but nothing of ours, imported."""
    os.setsid()
    assert not {"gibbs_codegen", "support"} & sys.modules.keys()
    with said.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os.chdir(folder)
    os.environ |= {"PYTHONPATH": str(folder), "CI": "1"}
    sys.path[:] = [str(folder), *(path for path in sys.path if path not in _OURS)]
    cache = f"cache_dir={folder / 'cache'}"
    options = ("-x", "-q", "--tb=no", "-o", cache, f"--basetemp={folder / 'pytest'}")
    sys.exit(int(pytest.main([*options, "-m", "", *arguments])))


def source_path(module: str) -> Path:
    """File of a module, of a template, or of C or MATLAB that is emitted whole."""
    if module.endswith(".jinja"):
        return ROOT / "templates" / module
    if module.endswith(".m"):
        return PACKAGE / "emitted" / "matlab" / module
    if module.endswith(".c"):
        return PACKAGE / ("" if "/" in module else "emitted") / module
    return PACKAGE / f"{module.replace('.', '/')}.py"


def mutants(module: str) -> list[Callable[[], Mutant]]:
    """All mutants of a module, a template, or C or MATLAB that is emitted whole."""
    source = source_path(module).read_text(encoding="utf-8")
    is_template = module.endswith((".jinja", ".c", ".m"))
    return template_mutants(source) if is_template else python_mutants(source)


def excerpts(before: str, after: str, context: int = 40) -> tuple[str, str]:
    """Two lines from a little before they differ to a little after."""
    start = _alike(before, after)
    end = _alike(before[start:][::-1], after[start:][::-1])
    first, last = max(start - context, 0), max(end - context, 0)
    return before[first : len(before) - last], after[first : len(after) - last]


def _alike(first: str, second: str) -> int:
    """How many letters two texts begin with alike."""
    pairs = enumerate(zip(first, second, strict=False))
    return next((i for i, (a, b) in pairs if a != b), min(len(first), len(second)))


def drawn(modules: Sequence[str], seed: int, count: int) -> list[Fault]:
    """So many faults in all, as evenly over the modules as can be."""
    orders = {}
    for module in modules:

        def place(numbered: tuple[int, object], module: str = module) -> bytes:
            return hashlib.sha256(f"{seed} {module} {numbered[0]}".encode()).digest()

        orders[module] = sorted(enumerate(mutants(module)), key=place)
    faults: list[Fault] = []
    while len(faults) < count and any(orders.values()):
        for module in modules:
            if orders[module] and len(faults) < count:
                number, make = orders[module].pop(0)
                faults.append(Fault(module, number, make()))
    return faults


def chosen(only: Sequence[str], seed: int, count: int) -> list[Fault]:
    """The faults that the command line asks for."""
    named = [name for name in only if ":" in name]
    modules = [m for name in only if ":" not in name for m in GROUPS.get(name, (name,))]
    if not only:
        modules = [module for group in GROUPS.values() for module in group]
    faults = drawn(modules, seed, count) if modules else []
    for name in named:
        module, _, number = name.partition(":")
        faults.append(Fault(module, int(number), mutants(module)[int(number)]()))
    return faults


def main() -> None:
    """Print the verdict on each fault, and those that survived."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--only", nargs="*", default=[], help="groups, modules or single faults")
    parser.add_argument("--list", action="store_true", help="only list the faults")
    parser.add_argument("--quick", action="store_true", help="leave out the other tests")
    parser.add_argument("--cache", type=Path, default=ROOT / ".pytest_cache", help="pytest's")
    options = parser.parse_args()
    faults = chosen(options.only, options.seed, options.count)
    print(f"seed {options.seed}: {len(faults)} faults", flush=True)
    if options.list:
        for fault in faults:
            print(fault.text())
        return
    for name in LIBRARIES:
        import_module(name)
    begun = time.monotonic()
    survivors = faults
    with tempfile.TemporaryDirectory(prefix="mutation_") as folder:
        copy = Copy(Path(folder), options.cache.absolute())
        for is_quick in (True,) if options.quick else (True, False):
            survivors = [fault for fault in survivors if not _found(copy, fault, is_quick)]
    kept = options.cache / "d" / "found.json"
    known = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    kept.write_text(json.dumps(known | copy.found, indent=0), encoding="utf-8")
    for group, modules in GROUPS.items():
        total = sum(fault.module in modules for fault in faults)
        lived = sum(fault.module in modules for fault in survivors)
        if total:
            print(f"{group}: {total - lived} of {total} found")
    print(f"{len(faults) - len(survivors)} of {len(faults)} found", end=" ")
    print(f"in {(time.monotonic() - begun) / 60:.0f} minutes")
    for fault in survivors:
        print(f"survived: {fault.text()}")
    sys.exit(1 if survivors else 0)


def _found(copy: Copy, fault: Fault, is_quick: bool) -> bool:
    """Whether a fault is found, which is told."""
    started = time.monotonic()
    found = copy.verdict(fault, is_quick)
    told = "found" if found else "not found by the quick tests" if is_quick else "SURVIVED"
    print(f"{told} in {time.monotonic() - started:.0f} s  {fault.text()}")
    print(f"    {found[:160]}" if found else "", flush=True)
    return bool(found)


if __name__ == "__main__":
    main()
