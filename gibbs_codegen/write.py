"""Writing a generated module: whole or not at all."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from gibbs_codegen.emit import HEADER_START
from gibbs_codegen.errors import OutputError, UsageError

_STAGING_PREFIX = ".gibbs_codegen_"
# No module has this name, since a robot's name begins with a letter.
_NEW = "_new"


def differing_files(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Names of files in `folder` that are missing, changed, or not of the module."""
    differing = []
    for name, text in files.items():
        path = folder / name
        if not path.is_file() or path.read_bytes() != text.encode():
            differing.append(name)
    if folder.is_dir():
        present = {path.name for path in folder.iterdir() if path.name != "__pycache__"}
        differing += sorted(present - set(files))
    return differing


def check_replaceable(folder: Path) -> None:
    """Refuse to write over anything that was not generated. Raises `UsageError`."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UsageError(f"{folder}: is in the way and is not a generated module; remove it first")
    if folder.is_dir() and any(folder.iterdir()):
        start = folder / "__init__.py"
        if not start.is_file() or HEADER_START not in start.read_text("utf-8", "replace")[:200]:
            raise UsageError(
                f"{folder}: holds files that were not generated; choose another --out or name"
            )


def write_module(folder: Path, files: Mapping[str, str]) -> None:
    """Put the files into `folder`, replacing a module that was generated there before.

    They are written and flushed in a hidden folder beside it, which then takes its place; a failure
    or a signal to end leaves what was there, and nothing else. Raises `OutputError`.
    """
    check_replaceable(folder)
    parent = folder.parent
    made = _missing_parents(parent)
    try:
        parent.mkdir(parents=True, exist_ok=True)
        _remove_stale(parent)
        with _staging(parent) as staging:
            new = staging / _NEW
            new.mkdir()
            for name, text in files.items():
                _write_flushed(new / name, text)
            if folder.exists():
                os.replace(folder, staging / folder.name)
            try:
                os.replace(new, folder)
            except BaseException:
                _restore(staging, parent)
                raise
    except OSError as error:
        for path in made:
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()
        reason = error.strerror or str(error)
        raise OutputError(f"{folder}: cannot be written: {reason}; nothing was changed") from None


def write_new_file(path: Path, text: str) -> None:
    """Write a file that must not exist yet. Raises `UsageError` or `OutputError`."""
    try:
        with path.open("x", encoding="utf-8", newline="\n") as file:
            try:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            except OSError:
                path.unlink()
                raise
    except FileExistsError:
        raise UsageError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def _missing_parents(folder: Path) -> list[Path]:
    """Folders that will have to be made, innermost first."""
    return [path for path in (folder, *folder.parents) if not path.exists()]


def _write_flushed(path: Path, text: str) -> None:
    with path.open("wb") as file:
        file.write(text.encode())
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def _staging(parent: Path) -> Iterator[Path]:
    """A private folder beside the module, removed whatever happens, signals to end included."""
    with _signals_as_exceptions():
        folder = Path(tempfile.mkdtemp(prefix=f"{_STAGING_PREFIX}{os.getpid()}_", dir=parent))
        folder.chmod(0o755)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _signals_as_exceptions() -> Iterator[None]:
    def stop(number: int, _: FrameType | None) -> None:
        raise SystemExit(128 + number)

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # Not in the main thread: the caller's handling stands.
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _remove_stale(parent: Path) -> None:
    """Remove what a process that was killed outright could not."""
    for path in parent.glob(f"{_STAGING_PREFIX}*"):
        owner = path.name.removeprefix(_STAGING_PREFIX).split("_")[0]
        if owner.isdigit() and not _is_running(int(owner)):
            _restore(path, parent)
            shutil.rmtree(path, ignore_errors=True)


def _restore(staging: Path, parent: Path) -> None:
    """Put back a module that had been taken away when its replacement did not come."""
    for path in staging.iterdir():
        if path.name != _NEW and not (parent / path.name).exists():
            os.replace(path, parent / path.name)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
