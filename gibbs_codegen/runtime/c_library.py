"""The shared library of a generated module: its C files, compiled once and kept in the cache."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import itertools
import logging
import math
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

from gibbs_codegen.errors import UsageError, cause_of, printable
from gibbs_codegen.files.verbatim import c_source
from gibbs_codegen.interface import FUNCTIONS, WHOLES, module_signatures
from gibbs_codegen.runtime.cache import GIVEN_UP, cached_library

# Numbers of the processes of compilers that run.
_RUNNING: set[int] = set()
# After so long, s, compilers are ended again that have started since.
_MOMENT = 0.02
# What is kept is there within so long, s.
_AT_ONCE = 0.1
# Sixty-four links take minutes.
_TIMEOUT_SECONDS = 300.0
# Nobody asks what square roots leave in errno; with it they are not taken side by side.
_FLAGS = ("-O3", "-ffp-contract=fast", "-fno-math-errno", "-fPIC", "-shared")
# A program that has a function of the same name must not get the calls within a library.
_LINKER_FLAGS = ("-Wl,-Bsymbolic",) if sys.platform.startswith("linux") else ()
_NATIVE = "-march=native"
# Numbers of blocks are wider than registers: gcc moves them in halves of these without.
_MOVES = ("-mmove-max=512", "-mstore-max=512")
# Not inlined, the parts of a long function compile in half the time, and run as fast once gcc knows
# that their stride is 1.
_PORTABLE = ("-Og", "-fipa-cp", "-Dalways_inline=", "-fvisibility=hidden")


class CompilerError(Exception):
    """No library can be made; the message says why in a line."""


class _EndedError(CompilerError):
    """A compiler was ended before it had done its work."""


@dataclass(frozen=True)
class Compiler:
    """A compiler's command, of which the user's own flags come last, and what it calls itself."""

    command: tuple[str, ...]
    version: str

    @property
    def identity(self) -> str:
        """Text that differs where compiler, flags, processor or C library differ."""
        system = (platform.system(), platform.machine(), *platform.libc_ver(), _processor())
        flags = [*_FLAGS, _NATIVE, *_MOVES, *_LINKER_FLAGS]
        return "\n".join([*self.command, self.version, *flags, *system])

    @functools.cached_property
    def _moves(self) -> tuple[str, ...]:
        """Flags by which numbers are moved whole, if the compiler knows them."""
        empty = ("-E", "-x", "c", os.devnull)
        code, _ = _run([*self.command, *_MOVES, *empty], 20.0, Path.cwd())
        return _MOVES if code == 0 else ()

    def library(self, sources: Sequence[Path], output: Path, extra: Sequence[str] = ()) -> None:
        """Make a shared library of C files; `extra` flags come after the compiler's.

        Raises `CompilerError` if it fails or hangs.
        """
        # Without knowing the processor a library in the cache might meet another one.
        if _processor():
            try:
                return self._make(sources, output, [*_FLAGS, _NATIVE, *self._moves, *extra])
            except _EndedError:
                raise
            except CompilerError:
                pass  # It may not know the processor.
        return self._make(sources, output, [*_FLAGS, *extra])

    def portable(self, sources: Sequence[Path], output: Path) -> None:
        """Make a shared library for any processor of the machine's kind, in a quarter of the time.

        Raises `CompilerError` if it fails or hangs.
        """
        self._make(sources, output, [*_FLAGS, *_PORTABLE])

    def _make(self, sources: Sequence[Path], output: Path, flags: Sequence[str]) -> None:
        """Make a shared library; `flags` are all but the user's own. Raises `CompilerError`."""
        # Words before the first flag may be a launcher and its compiler, such as `ccache gcc`.
        programs = list(itertools.takewhile(lambda word: not word.startswith("-"), self.command))
        options = self.command[len(programs) :]
        files = [*map(str, sources), "-o", str(output), *_LINKER_FLAGS, "-lm"]
        compile_file([*programs, *flags, *options, *files], output, " ".join(programs))


def compile_file(command: Sequence[str], output: Path, name: str) -> None:
    """Run the command of a compiler that makes a file; `name` is the compiler's in messages.

    Raises `CompilerError` if it fails or hangs.
    """
    code, report = _run(command, _TIMEOUT_SECONDS, output.parent)
    if code is None:
        raise _EndedError(f"{name} did not finish in {_TIMEOUT_SECONDS:.0f} s")
    if code < 0:
        raise _EndedError(f"{name} was ended by {signal.Signals(-code).name}")
    if code != 0 or not output.is_file():
        lines = [line.strip() for line in report.splitlines() if line.strip()]
        telling = [x for x in lines if "error" in x.lower() and not x.startswith("collect2")]
        reason = [*telling, *lines, f"exit code {code}"][0]
        raise CompilerError(f"{name} failed: {reason[:300]}")


@functools.cache
def find_compiler(chosen: str | None) -> Compiler:
    """The compiler that the user has chosen, or else cc, gcc or clang of the search path.

    `chosen` is the value of CC: maybe a launcher, a compiler, and flags after it, as `ccache gcc
    -O2`. Raises `CompilerError` if there is none.
    """
    if sys.platform == "win32":
        raise CompilerError("compiling is not supported on Windows")
    try:
        commands = [shlex.split(chosen)] if chosen else [["cc"], ["gcc"], ["clang"]]
    except ValueError as error:
        raise CompilerError(f"CC={chosen}: {error}") from None
    for command in commands:
        path = shutil.which(command[0]) if command else None
        if path:
            whole = (os.path.abspath(path), *command[1:])
            code, report = _run([*whole, "--version"], 20.0, Path.cwd())
            if code is None:
                raise CompilerError(f"{whole[0]} does not answer --version")
            return Compiler(whole, report)
    raise CompilerError(f"CC={chosen}: no such compiler" if chosen else "no C compiler found")


def chosen_compiler() -> Compiler:
    """The compiler by the environment's CC, as of `find_compiler`."""
    return find_compiler(os.environ.get("CC") or None)


def _run(command: Sequence[str], seconds: float, folder: Path) -> tuple[int | None, str]:
    """Exit code and output of a command, run to its end, or ended after so many seconds.

    The code is None if it hung. Raises `CompilerError` if it cannot be started.
    """
    # A folder of its own takes the leftovers of a compiler that is ended at once.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        try:
            process = subprocess.Popen(  # noqa: S603 - a compiler that the user has chosen
                command,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                cwd=folder,
                env={**os.environ, "LC_ALL": "C", "TMPDIR": scratch},
                text=True,
                errors="replace",
                start_new_session=True,
            )
        except OSError as error:
            raise CompilerError(f"{command[0]}: {cause_of(error)}") from None
        _RUNNING.add(process.pid)
        try:
            report, _ = process.communicate(timeout=seconds)
        except BaseException as error:
            _end([process.pid])
            process.communicate()
            if isinstance(error, subprocess.TimeoutExpired):
                return None, ""
            raise
        finally:
            _RUNNING.discard(process.pid)
        return process.returncode, report


def _end(running: Collection[int]) -> None:
    """End compilers, by the numbers of their processes, with all that they have started."""
    for process in running:
        if sys.platform != "win32":  # There `find_compiler` finds none.
            with suppress(OSError):
                os.killpg(process, signal.SIGKILL)


@functools.cache
def _processor() -> str:
    """A text that tells instructions of processors apart; empty where that is not known."""
    if not sys.platform.startswith("linux") or platform.machine() not in ("x86_64", "aarch64"):
        return ""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    keys = ("flags", "Features", "model", "cpu family", "CPU part", "CPU implementer")
    lines = {line for line in text.splitlines() if line.split(":")[0].strip() in keys}
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


_log = logging.getLogger("gibbs_codegen")
# What is compiled, where nothing else is said.
_FUNCTIONS, FLIGHT = "all its functions", "the loop of this scenario"
_FLIGHTS = "the functions that flights call"
# Time to compile a library, s, and each operation in it, on the machine of the waiting times.
_SECONDS_A_LIBRARY, _SECONDS_AN_OPERATION = 0.3, 4e-4
_OPERATIONS = re.compile(rb" [-+*/] ")
# Work that takes longer is announced, s.
_PATIENCE = 2.0
# Words that were logged; begin and end of the main thread's waits for announced work, s.
_LOGGED: set[str] = set()
_SPANS: list[tuple[float, float]] = []
NATIVE = Path(__file__).parent / "native"
# The header that is the same for every robot.
RUNTIME = "gibbs_runtime.h"
# As a source beside those of a robot, whose name begins with a letter.
_ROWS = "_rows.c"


def native_source(name: str) -> str:
    """A C file of `native`, with what it includes of that folder or of `emitted` in its place."""
    text = (NATIVE / name).read_text(encoding="utf-8")
    for file in re.findall(r'(?m)^#include "(\w+\.[ch])"\n', text):
        included = native_source(file) if file.endswith(".h") else c_source(file)
        text = text.replace(f'#include "{file}"\n', included)
    return text


# The end of the names in C of functions for blocks of states, and for such as have constants each.
BATCH, EACH = "_batch", "_batch_each"
# The name that a unit of compilation has, and the form of its functions: one of these ends, or "".
Unit = tuple[str, str]
# What most flights call, by the end of the name.
_FLOWN = {
    "": (
        *("mass_matrix", "input_matrix", "inverse_dynamics", "gravity_forces", "positions"),
        *("potential_energy", "centre_of_mass", "centre_of_mass_jacobian", "frame_jacobians"),
    ),
    BATCH: (
        *("input_matrix", "forward_dynamics", "inverse_dynamics", "constraint_torques"),
        *("positions", "frame_poses", "frame_jacobians", "centre_of_mass"),
        *("centre_of_mass_jacobian", "kinetic_energy", "potential_energy"),
    ),
}


class ModuleLibrary:
    """The compiled functions of a generated module, each compiled when it is first asked for.

    Those that most flights call are compiled together. With others are compiled the rest of their
    group; a function on request stands alone, and time steps are together. Functions for one state,
    for blocks, and with constants of each state are in libraries of their own. Where `whole` is
    asked for there are two libraries, of these and of all others.
    """

    def __init__(
        self,
        folder: Path,
        module: ModuleType,
        compiler: Compiler,
        flags: Sequence[str] = (),
        *,
        whole: bool = False,
    ) -> None:
        """Take what is compiled later; `flags` come after the compiler's."""
        self._folder, self._name, self._compiler = folder, module.NAME, compiler
        self._functions = [signature.name for signature in module_signatures(module)]
        self._flags = tuple(flags)
        self._locks: defaultdict[Unit, threading.Lock] = defaultdict(threading.Lock)
        self._units: dict[Unit, ctypes.CDLL] = {}
        self._is_whole = whole

    @functools.cached_property
    def core(self) -> Path:
        """The library with the constants and `rows.c`; where there is one for all, that.

        Raises `CompilerError`, `CacheError` and `UsageError` as `compiled_files` does.
        """
        where = self._folder, self._name, self._compiler, self._flags
        return compiled_library(*where, None if self._is_whole else ())

    @functools.cached_property
    def digest(self) -> str:
        """A digest that differs where the functions do."""
        text = b"".join((self._folder / file).read_bytes() for file in c_files(self._name))
        return hashlib.sha256(self._compiler.identity.encode() + text).hexdigest()[:32]

    def function(self, name: str, form: str = "") -> Any:
        """A function of the module by the name of its row, with the end of its name in C.

        Raises as `core` does, and `CompilerError` where the library lacks it.
        """
        library = self._library(self._unit(name, form))
        return _function(library, f"{self._name}_{name}{form}")

    @contextmanager
    def built(self, ahead: Callable[[], Callable[[], object]] | None = None) -> Iterator[None]:
        """Compile side by side what most flights call, which is then there.

        Where that takes a while, `ahead` is asked for a call, which compiles a flight beside it and
        what is done here. Raises as `function` does.
        """
        # Those for blocks take longest, and come first.
        flown = [self._unit(names[0], form) for form, names in reversed(_FLOWN.items())]
        units = [*dict.fromkeys([*flown, ("", "")])]
        tasks: list[Future[object]] = []
        count = os.cpu_count() or 1

        def seconds() -> float:
            """About how long all take, s."""
            times = [_seconds(self._texts(*unit)) for unit in units]
            return max(*times, sum(times) / count)

        pool = ThreadPoolExecutor(count)
        try:
            with announced(_compiling(self._name, _FLIGHTS), seconds):
                tasks.extend(pool.submit(self._library, unit) for unit in units)
                if ahead and wait(tasks, _AT_ONCE).not_done:
                    tasks.append(pool.submit(ahead()))
                for task in tasks[: len(units)]:
                    task.result()
            yield
            with announced(_compiling(self._name, FLIGHT)):
                wait(tasks)
        except (KeyboardInterrupt, SystemExit):
            GIVEN_UP.set()
            try:  # Some may be about to start.
                while wait(tasks, _MOMENT).not_done:
                    _end([*_RUNNING])
            finally:
                GIVEN_UP.clear()
            raise
        finally:
            # Nobody waits for what is compiled ahead of a flight that is refused.
            pool.shutdown(wait=False, cancel_futures=True)

    def _library(self, unit: Unit) -> ctypes.CDLL:
        with self._locks[unit]:
            library = self._units.get(unit)
            if library is None:
                library = self._units[unit] = opened(self._path(*unit))
            return library

    def _unit(self, name: str, form: str) -> Unit:
        row = FUNCTIONS[name]
        if self._is_whole:
            return "", form if form == EACH else ""
        if name in _FLOWN.get(form, ()):
            return "flights", form
        if row.composed:
            return "steps", form
        return name if row.on_request else row.group, form

    def _parts(self, unit: str, form: str) -> list[str]:
        """The functions of a unit, with those that they call."""
        functions = [name for name in self._functions if self._unit(name, form) == (unit, form)]
        return [*{part for name in functions for part in FUNCTIONS[name].composed}, *functions]

    def _files(self, form: str) -> list[str]:
        """Names of the files with functions of a form."""
        files = c_files(self._name, per_state=form == EACH, blocks=form != "")
        return [file for file in files if form != BATCH or file != f"{self._name}.c"]

    def _texts(self, unit: str, form: str) -> list[bytes]:
        """The sources of a unit."""
        files = (self._folder / file for file in self._files(form)[2:])
        return [some_functions(file.read_bytes(), self._parts(unit, form)) for file in files]

    def _path(self, unit: str, form: str) -> Path:
        if not unit and not form:
            return self.core
        where = self._folder, self._name, self._files(form), self._compiler
        group = f" of the group {unit}" if unit else " for parameters of each state"
        part = _FLIGHTS if unit == "flights" else f"its functions{group}"
        return compiled_files(*where, self._flags, functions=self._parts(unit, form), contents=part)


def compiled_library(
    folder: Path,
    name: str,
    compiler: Compiler,
    extra: Sequence[str] = (),
    functions: Collection[str] | None = None,
) -> Path:
    """Path of a shared library of what a generated module has in C, with `rows.c`.

    `extra` flags come after the compiler's. There are only some `functions`, unless they are None.
    """
    rows = {_ROWS: native_source("rows.c").encode()}
    return compiled_files(folder, name, c_files(name), compiler, extra, rows, functions)


def compiled_files(
    folder: Path,
    name: str,
    files: Sequence[str],
    compiler: Compiler,
    extra: Sequence[str] = (),
    others: Mapping[str, bytes] = MappingProxyType({}),
    functions: Collection[str] | None = None,
    contents: str = _FUNCTIONS,
) -> Path:
    """Path of a shared library of C files of a generated module, from the cache or compiled now.

    A message names the `contents`.

    `files` are those that it is made of, and what they include, as of `c_files`. `others` are texts
    of further sources, by names that no file of the module has. Of the module's C sources there are
    only some `functions`, unless they are None.
    Raises `UsageError` for a file that is missing, or was not generated with the module.
    """
    # Read once: what is compiled is what the key was made of, whatever happens to the files.
    texts = module_texts(folder, files)
    made = _make_of((folder / "numpy_module.py").read_bytes())
    for file, text in texts.items():
        # Sources that are the same for every robot name none.
        if _make_of(text) != made and not (file == RUNTIME and _make_of(text)[:1] == made[:1]):
            raise UsageError(
                f"{printable(folder / file)}: belongs to another generation than "
                "numpy_module.py; generate the module again"
            )
    if functions is not None:
        for file in texts.keys() & {f"{name}.c", f"{name}_batch.c"}:
            texts[file] = some_functions(texts[file], functions)
    # Without functions there is nothing in blocks.
    of_blocks = {f"{name}_batch.c"}
    passed_over = of_blocks if f"{name}_each.c" in texts or functions == () else set()
    texts |= others
    digests = [hashlib.sha256(text).hexdigest() for text in texts.values()]

    def make(output: Path) -> None:
        # Other flags take another time.
        seconds = None if extra else lambda: _seconds(texts.values())
        with written(texts, output) as files, announced(_compiling(name, contents), seconds):
            compiled = [file for file in files if file.name not in passed_over]
            compiler.library(compiled, output, extra)

    return cached_library("\n".join([compiler.identity, name, *extra, *digests]), make)


def module_texts(folder: Path, files: Sequence[str]) -> dict[str, bytes]:
    """Texts of files of a module; raises `UsageError` if one is missing."""
    missing = [file for file in files if not (folder / file).is_file()]
    if missing:
        raise UsageError(
            f"{printable(folder)}: has no {', '.join(missing)}; generate the module again, with "
            "the C target"
        )
    return {file: (folder / file).read_bytes() for file in files}


@contextmanager
def written(texts: Mapping[str, bytes], output: Path) -> Iterator[list[Path]]:
    """Paths of the C files among texts by their names, which are beside the output meanwhile."""
    folder = output.parent / "source"
    folder.mkdir()
    for file, text in texts.items():
        (folder / file).write_bytes(text)
    yield [folder / file for file in texts if file.endswith(".c")]
    shutil.rmtree(folder)


def _compiling(name: str, part: str) -> str:
    return f"{name}: compiling {part} in C; the cache keeps the result"


def _seconds(sources: Iterable[bytes]) -> float:
    """About how long C sources take to compile, s."""
    operations = sum(len(_OPERATIONS.findall(source)) for source in sources)
    return _SECONDS_A_LIBRARY + operations * _SECONDS_AN_OPERATION


def portable_library(name: str, sources: Mapping[str, str]) -> Path:
    """Path of a shared library of texts by file names, for any processor of the machine's kind.

    It is from the cache, or compiled now. Raises `CompilerError` and `CacheError`.
    """
    compiler = chosen_compiler()

    def make(output: Path) -> None:
        texts = {file: text.encode() for file, text in sources.items()}
        with written(texts, output) as files, announced(f"{name}: compiling its FMU"):
            compiler.portable(files, output)

    return cached_library("\n".join([*_PORTABLE, compiler.identity, *sources.values()]), make)


def some_functions(source: bytes, functions: Collection[str]) -> bytes:
    """The C source of a module with some of its functions, and without patterns.

    Those that are parts of one text come together.
    """
    begin, *parts = re.split(rb"(?m)^(?=/\* ---- )", source)
    texts = {WHOLES.get(name, name) for name in functions}
    names = [*texts, *(part for text in texts for part in FUNCTIONS[text].parts)]
    words = [f"/* ---- {name} ---- */".encode() for name in names]
    return begin + b"".join(part for part in parts if part.startswith(tuple(words)))


def opened(path: Path) -> ctypes.CDLL:
    """A shared library. Raises `CompilerError`."""
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise CompilerError(f"{path.name} cannot be loaded: {error}") from None


def opened_core(path: Path, prefix: str) -> ctypes.CDLL:
    """The library with the constants of a module; `prefix` is the robot's name.

    Raises `CompilerError` if it cannot be loaded, or lacks one of its functions.
    """
    library = opened(path)
    for name in (f"{prefix}_init_constants", "gibbs_codegen_rows", "gibbs_codegen_lost"):
        _function(library, name)
    return library


def _function(library: ctypes.CDLL, name: str) -> Any:
    """A function of a library. Raises `CompilerError` where this lacks it."""
    if not hasattr(library, name):
        raise CompilerError(f"the library has no {name}; do flags in CC hide or rename it?")
    return library[name]


@contextmanager
def announced(stage: str, seconds: Callable[[], float] | None = None) -> Iterator[None]:
    """Log, once, a warning of what takes longer than two seconds; keep when the main thread waits.

    `seconds` tells about how long it takes.
    """

    def log_once() -> None:
        if stage not in _LOGGED:
            _LOGGED.add(stage)
            whole = math.ceil(seconds()) if seconds else 0
            # An estimate that has passed already says nothing.
            about = f" (about {whole} s)" if whole > _PATIENCE else ""
            _log.warning("%s%s", stage, about)

    timer, begin = threading.Timer(_PATIENCE, log_once), time.perf_counter()
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        if threading.current_thread() is threading.main_thread():
            _SPANS.append((begin, time.perf_counter()))


def seconds_waited(since: float) -> float:
    """The time, s, that the main thread waited for announced work since one of `perf_counter`."""
    waited, end = 0.0, since
    for begin, after in sorted(_SPANS):
        waited += max(after - max(begin, end), 0.0)
        end = max(end, after)
    return waited


def _make_of(text: bytes) -> list[bytes]:
    """Version, robot and digest of the robot file that an emitted file names in its header."""
    return [line.strip(b"#/* \r") for line in text.split(b"\n", 4)[:4]]


def c_files(name: str, *, per_state: bool = False, blocks: bool = True) -> list[str]:
    """Names of the files that the functions of a module consist of in C.

    With `per_state` they are those that take constants of each state; they are for one state alone
    if not for `blocks`.
    """
    sources = ["batch", "each"] if per_state else ["batch"] if blocks else []
    core = [] if per_state else [f"{name}.c"]
    return [RUNTIME, f"{name}.h", *core, *(f"{name}_{source}.c" for source in sources)]
