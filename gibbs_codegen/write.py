"""Writing a generated module: whole or not at all."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.version import HEADER_START

_STAGING_PREFIX = ".gibbs_codegen_"
# No module has this name, since a robot's name begins with a letter.
_NEW = "_new"
_STALE_SECONDS = 60.0


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
    for parent in folder.parents:
        if parent.exists() and not parent.is_dir():
            raise UsageError(f"{parent}: is a file; --out must be a folder")
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UsageError(f"{folder}: is in the way and is not a generated module; remove it first")
    if not folder.is_dir():
        return
    foreign = sorted(path.name for path in folder.iterdir() if not _is_ours(path))
    if foreign:
        raise UsageError(
            f"{folder}: holds what was not generated: {', '.join(foreign[:5])}; "
            "move it elsewhere, or choose another --out or name"
        )


def _is_ours(path: Path) -> bool:
    if path.name == "__pycache__":
        return path.is_dir()
    if not path.is_file() or path.is_symlink():
        return False
    if path.name == "robot.toml":
        return True
    with path.open("rb") as file:
        return HEADER_START.encode() in file.read(200)


def write_module(folder: Path, files: Mapping[str, str]) -> None:
    """Put the files into `folder`, replacing a module that was generated there before.

    They are written and flushed in a hidden folder beside it, which then takes its place; a failure
    or a signal to end leaves what was there, and nothing else. Raises `OutputError`.
    """
    check_replaceable(folder)
    # A path through the module itself, or relative to it, would lead astray while it is replaced.
    folder = Path(os.path.realpath(folder.parent)) / folder.name
    parent = folder.parent
    made = _missing_parents(parent)
    try:
        with _signals_as_exceptions():
            try:
                parent.mkdir(parents=True, exist_ok=True)
                _remove_stale(parent)
                _write_and_swap(folder, files)
            except BaseException:
                _remove_empty(made)
                raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{folder}: cannot be written: {reason}; nothing was changed") from None


def _write_and_swap(folder: Path, files: Mapping[str, str]) -> None:
    staging = Path(tempfile.mkdtemp(prefix=f"{_STAGING_PREFIX}{os.getpid()}_", dir=folder.parent))
    try:
        new = staging / _NEW
        new.mkdir()
        for name, text in files.items():
            _write_flushed(new / name, text)
        if folder.exists():
            os.replace(folder, staging / folder.name)
        os.replace(new, folder)
    finally:
        _restore(staging)
        shutil.rmtree(staging, ignore_errors=True)


def write_new_file(path: Path, text: str) -> None:
    """Write a file that must not exist yet. Raises `UsageError` or `OutputError`."""
    try:
        with path.open("x", encoding="utf-8", newline="\n") as file:
            try:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            except BaseException:
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
def _signals_as_exceptions() -> Iterator[None]:
    """Turn signals to end into `SystemExit`, so that what is unfinished is cleaned up."""

    def stop(number: int, _: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = {}
    try:
        for name in ("SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                number = getattr(signal, name)
                before[number] = signal.signal(number, stop)
    except ValueError:  # Not in the main thread: signals are not this thread's to handle.
        before = {}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _restore(staging: Path) -> None:
    """Put back a module that had been taken away when its replacement did not come."""
    for path in staging.iterdir():
        if path.name != _NEW and not (staging.parent / path.name).exists():
            os.replace(path, staging.parent / path.name)


def _remove_stale(parent: Path) -> None:
    """Remove what a process that was killed outright could not."""
    for path in parent.glob(f"{_STAGING_PREFIX}*"):
        owner = path.name.removeprefix(_STAGING_PREFIX).split("_")[0]
        # Writing takes moments; a younger folder may be another machine's on a shared disk.
        old = time.time() - path.stat().st_mtime > _STALE_SECONDS
        if old and owner.isdigit() and not _is_running(int(owner)):
            _restore(path)
            shutil.rmtree(path, ignore_errors=True)


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _is_running(process: int) -> bool:
    if os.name == "nt":  # Signal 0 is not a question there; age alone must do.
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
