"""Writing a generated module: whole or not at all."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from gibbs_codegen.errors import OutputError, UsageError, printable
from gibbs_codegen.output_folder import check_output_folder
from gibbs_codegen.version import HEADER_START

_STAGING_PREFIX = ".gibbs_codegen_"
# No module has this name, since a robot's name begins with a letter.
_NEW = "_new"
_STALE_SECONDS = 60.0


def differing_files(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Names of files in `folder` that are missing, changed, or not of the module.

    Raises `OutputError` where they cannot be read.
    """
    differing = []
    try:
        with _alone_in(folder.parent):
            for name, text in files.items():
                path = folder / name
                if not path.is_file() or path.read_bytes() != text.encode():
                    differing.append(name)
            if folder.is_dir():
                present = {path.name for path in folder.iterdir() if path.name != "__pycache__"}
                differing += sorted(present - set(files))
        return differing
    except OSError as error:
        raise OutputError(f"{printable(folder)}: cannot be read: {error.strerror}") from None


def check_replaceable(folder: Path, robot_text: str) -> None:
    """Refuse to write over anything that was not generated. Raises `UsageError`.

    `robot_text` is what the folder's robot file is about to become.
    """
    with _alone_in(folder.parent):
        _check_replaceable(folder, robot_text)


def _check_replaceable(folder: Path, robot_text: str) -> None:
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise UsageError(
                f"{printable(folder)}: is in the way and is not a generated module; remove it first"
            )
        _check_contents(folder, robot_text)
    except OSError as error:
        raise UsageError(f"{printable(folder)}: cannot be used: {error.strerror}") from None


def _check_contents(folder: Path, robot_text: str) -> None:
    if not folder.is_dir():
        return
    heads = {path: _head(path) for path in folder.iterdir() if path.name != "__pycache__"}
    generated = [head for head in heads.values() if HEADER_START.encode() in head]
    foreign = []
    for path, head in heads.items():
        if path.name == "robot.toml" and path.is_file():
            digest = hashlib.sha256(path.read_bytes()).hexdigest().encode()
            if path.read_bytes() == robot_text.encode() or any(digest in g for g in generated):
                continue
            raise UsageError(
                f"{printable(path)}: differs from what the module was made from; "
                "generate from it, or move it"
            )
        if head not in generated:
            foreign.append(path.name)
    if foreign:
        names = printable(", ".join(sorted(foreign)[:5]))
        raise UsageError(
            f"{printable(folder)}: holds what was not generated: {names}; "
            "move it elsewhere, or choose another --out or name"
        )


def _head(path: Path) -> bytes:
    """Beginning of a plain file; nothing for anything else."""
    if path.is_symlink() or not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(400)


def write_module(folder: Path, files: Mapping[str, str]) -> None:
    """Put the files into `folder`, replacing a module that was generated there before.

    They are written and flushed in a hidden folder beside it, which then takes its place. A failure
    leaves what was there, and nothing else; signals to end are held back until a whole module is in
    place, the old or the new one, and the hidden folder is gone. Raises `UsageError` for what must
    not be replaced and `OutputError` for what cannot be written.
    """
    robot_text = files.get("robot.toml", "")
    check_output_folder(folder.parent)
    check_replaceable(folder, robot_text)
    # A path through the module itself, or relative to it, would lead astray while it is replaced.
    folder = Path(os.path.realpath(folder.parent)) / folder.name
    made = _missing_parents(folder.parent)
    with _signals_held() as held:
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with _alone_in(folder.parent, held):
                _check_replaceable(folder, robot_text)
                _remove_stale(folder.parent)
                written = _write_and_swap(folder, files, held)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                f"{printable(folder)}: cannot be written: {reason}; nothing was changed"
            ) from None
        finally:
            _remove_empty(made)
    if not written:  # The signal's handler, which is the program's own, has returned.
        raise OutputError(
            f"{printable(folder)}: writing was ended by a signal; nothing was changed"
        )


def _write_and_swap(folder: Path, files: Mapping[str, str], held: list[int]) -> bool:
    """Write and swap; whether that came to its end before a signal."""
    staging = Path(tempfile.mkdtemp(prefix=f"{_STAGING_PREFIX}{os.getpid()}_", dir=folder.parent))
    try:
        new = staging / _NEW
        new.mkdir()
        for name, text in files.items():
            _write_flushed(new / name, text)
            if held:
                return False
        if folder.exists():
            os.replace(folder, staging / folder.name)
        os.replace(new, folder)
        return True
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
        raise UsageError(f"{printable(path)}: exists already; choose another name") from None
    except OSError as error:
        raise OutputError(f"{printable(path)}: cannot be written: {error.strerror}") from None


def _missing_parents(folder: Path) -> list[Path]:
    """Folders that will have to be made, innermost first."""
    return [path for path in (folder, *folder.parents) if not path.exists()]


def _write_flushed(path: Path, text: str) -> None:
    with path.open("wb") as file:
        file.write(text.encode())
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def _alone_in(folder: Path, held: Sequence[int] = ()) -> Iterator[None]:
    """Keep other processes that write modules into a folder waiting, where it can be locked.

    Between two renames a module is not there, which is not for others to see. Waiting ends when
    `held` has a signal, or after a minute, which is longer than many that take turns need.
    """
    number = None
    try:
        # Neither Windows nor every file system has this; a module is written whole without.
        with suppress(ImportError, OSError):
            import fcntl

            number = os.open(folder, os.O_RDONLY)
            end = time.monotonic() + _STALE_SECONDS
            while not held and time.monotonic() < end:
                try:
                    fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    time.sleep(0.01)
        yield
    finally:
        if number is not None:
            # Closing is not enough where a child that was forked meanwhile has it open too.
            with suppress(OSError):
                fcntl.flock(number, fcntl.LOCK_UN)
            os.close(number)


@contextmanager
def _signals_held() -> Iterator[list[int]]:
    """Hold signals to end back, and deliver the first of them on leaving.

    Yields the list of those that have come. A signal that is ignored stays ignored.
    """
    held: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, lambda n, _: held.append(n))
    try:
        yield held
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if held:
            signal.raise_signal(held[0])


def _restore(staging: Path) -> None:
    """Put back a module that had been taken away when its replacement did not come."""
    for path in staging.iterdir():
        if path.name != _NEW and not (staging.parent / path.name).exists():
            os.replace(path, staging.parent / path.name)


def _remove_stale(parent: Path) -> None:
    """Remove what a process that was killed outright could not, as far as that can be done."""
    for path in parent.glob(f"{_STAGING_PREFIX}*"):
        owner = re.fullmatch(r"([0-9]{1,9})_.*", path.name.removeprefix(_STAGING_PREFIX))
        with suppress(OSError):
            # Writing takes moments; a younger folder may be another machine's on a shared disk.
            old = time.time() - path.stat().st_mtime > _STALE_SECONDS
            if owner and old and path.is_dir() and not _is_running(int(owner[1])):
                _restore(path)
                shutil.rmtree(path, ignore_errors=True)


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):  # Not empty: then it is wanted. Or it could not be made.
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
