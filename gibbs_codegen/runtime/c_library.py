"""The shared library of a generated module: its C files, compiled once and kept in the cache."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import shutil
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.interface import Signature
from gibbs_codegen.runtime.cache import cached_library
from gibbs_codegen.runtime.compiler import Compiler, CompilerError

_log = logging.getLogger("gibbs_codegen")
# What takes longer is told, s.
_PATIENCE = 2.0
NATIVE = Path(__file__).parent / "native"
# As a source beside those of a robot, whose name begins with a letter.
_ROWS = "_rows.c"


def compiled_library(
    folder: Path, name: str, compiler: Compiler, extra: Sequence[str] = ()
) -> Path:
    """Path of the shared library of a generated module, from the cache or compiled now.

    It exports the module's C functions, those of its CasADi adapter but in single precision, which
    CasADi does not have, and those of `rows.c`. `extra` flags come after the compiler's.
    """
    files = c_files(name)
    if f"-D{name.upper()}_FLOAT" in extra:
        files.remove(f"{name}_casadi.c")
    rows = {_ROWS: (NATIVE / "rows.c").read_bytes()}
    return compiled_files(folder, name, files, compiler, extra, rows)


def compiled_files(
    folder: Path,
    name: str,
    files: Sequence[str],
    compiler: Compiler,
    extra: Sequence[str] = (),
    others: Mapping[str, bytes] = MappingProxyType({}),
    included: Sequence[str] = (),
) -> Path:
    """Path of a shared library of C files of a generated module, from the cache or compiled now.

    `files` are those that it is made of, and what they include; of these, those `included` are not
    compiled by themselves. `others` are texts of further sources, by names that no file of the
    module has. Raises `UsageError` for a file that is missing, or was not generated with the
    module.
    """
    # Read once: what is compiled is what the key was made of, whatever happens to the files.
    missing = [file for file in files if not (folder / file).is_file()]
    if missing:
        raise UsageError(
            f"{printable(folder)}: has no {', '.join(missing)}; generate the module again"
        )
    texts = {file: (folder / file).read_bytes() for file in files}
    _check_of_one_make(folder, texts)
    texts |= others
    digests = [hashlib.sha256(text).hexdigest() for text in texts.values()]

    def make(output: Path) -> None:
        sources = output.parent / "source"
        sources.mkdir()
        for file, text in texts.items():
            (sources / file).write_bytes(text)
        own = [file for file in texts if file.endswith(".c") and file not in included]
        told = f"{name}: compiling {', '.join(own)}; the library is kept for the next time"
        with announced(told):
            compiler.library([sources / file for file in own], output, extra)
        shutil.rmtree(sources)

    return cached_library("\n".join([compiler.identity, name, *extra, *digests]), make)


def loaded_library(path: Path, prefix: str, functions: Sequence[Signature]) -> ctypes.CDLL:
    """The shared library of a generated module, once it is known to have all functions.

    Raises `CompilerError` if it cannot be loaded, or lacks one. `prefix` is the robot's name.
    """
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise CompilerError(f"{path.name} cannot be loaded: {error}") from None
    names = [f"{prefix}_{f.name}{form}" for f in functions for form in ("", "_batch")]
    for name in (f"{prefix}_init_constants", "gibbs_codegen_rows", "gibbs_codegen_lost", *names):
        if not hasattr(library, name):
            raise CompilerError(f"the library has no {name}; do flags in CC hide or rename it?")
    return library


@contextmanager
def announced(what: str) -> Iterator[None]:
    """Log what takes longer than two seconds: as a warning on a terminal, else as information."""
    stream = getattr(sys.stderr, "rich_proxied_file", sys.stderr)  # While a command draws a bar.
    level = logging.WARNING if stream and stream.isatty() else logging.INFO
    timer = threading.Timer(_PATIENCE, _log.log, (level, "%s", what))
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _check_of_one_make(folder: Path, texts: Mapping[str, bytes]) -> None:
    """Refuse C that was not generated together with the module's Python. Raises `UsageError`."""
    made = _make_of((folder / "numpy_module.py").read_bytes())
    for file, text in texts.items():
        if _make_of(text) != made:
            raise UsageError(
                f"{printable(folder / file)}: was not generated together with numpy_module.py; "
                f"generate the module again"
            )


def _make_of(text: bytes) -> list[bytes]:
    """Version, robot and digest of the robot file that an emitted file names in its header."""
    return [line.strip(b"#/* \r") for line in text.split(b"\n", 4)[:4]]


def c_files(name: str) -> list[str]:
    """Names of the files that the C target of a module consists of."""
    return [f"{name}.h", f"{name}.c", f"{name}_casadi.c"]
