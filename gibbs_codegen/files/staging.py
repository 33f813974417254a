"""Writing aside and swapping: others see what was there or what is new, each of them whole.

What is new grows in a hidden folder beside the place it is for, and is then renamed. What it takes
the place of goes into that folder too, under its own name: so whoever comes after a process that
was killed between the two renames can put it back.
"""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from gibbs_codegen.errors import OutputError, UsageError, cause_of, printable

_PREFIX = ".gibbs_codegen_new_"
# No robot, result or entry of the cache has this name.
_NEW = "_new"
# Longer than anything takes to write, be it an animation; a younger folder may be in use.
_STALE_SECONDS = 3600.0


@contextmanager
def writing(place: str | os.PathLike[str]) -> Iterator[None]:
    """Raise `OutputError`, with the place, where the system refuses to write."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{printable(place)}: cannot be written: {cause_of(error)}") from None


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder where there is none; in the end remove what was made and holds nothing.

    What cannot be made raises `OSError`.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for path in missing:
            with suppress(OSError):  # Not empty: then it is wanted. Or it could not be made.
                path.rmdir()


@contextmanager
def staging_folder(parent: Path) -> Iterator[Path]:
    """A hidden folder to write in, which in the end is removed with what is still in it.

    It is on the disk of `parent`, which is made where need be. What cannot be made raises
    `OSError`.
    """
    with made(parent):
        # Leftovers of a process that was killed outright; files that it had taken are put back.
        for stale in parent.glob(f"{_PREFIX}*"):
            with suppress(OSError):
                if stale.is_dir() and time.time() - stale.stat().st_mtime > _STALE_SECONDS:
                    for path in stale.iterdir():
                        if path.name != _NEW and not (parent / path.name).exists():
                            os.replace(path, parent / path.name)
                    shutil.rmtree(stale, ignore_errors=True)
        hidden = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent))
        try:
            new = hidden / _NEW
            new.mkdir()
            yield new
        finally:
            shutil.rmtree(hidden, ignore_errors=True)


def put_in_place(new: Path, place: Path, aside: Path | None = None) -> None:
    """Rename a staging folder; a failure leaves what was there, and raises `OSError`.

    What was there is kept at `aside`, or removed with what else is staged where None.
    """
    old = aside or new.with_name(place.name)
    if os.path.lexists(place):
        os.replace(place, old)
    try:
        os.replace(new, place)
    except BaseException:
        if os.path.lexists(old):
            os.replace(old, place)
        raise


def check_new(place: str | os.PathLike[str]) -> None:
    """Raise `UsageError` if a file or folder is there already."""
    if os.path.lexists(place):
        raise UsageError(f"{printable(place)}: exists already; choose another name")


@contextmanager
def new_place(place: str | os.PathLike[str]) -> Iterator[Path]:
    """A path at which to write what then goes to a new place if all went well, or nowhere.

    Raises `UsageError` if something is there already, and `OutputError` where the system refuses.
    """
    check_new(place)
    path = Path(place)
    with writing(path), staging_folder(path.parent) as staging:
        yield staging / path.name
        put_in_place(staging / path.name, path)


# Writing a module takes moments.
_NOTICE_SECONDS = 2.0
_PATIENCE_SECONDS = 60.0

_log = logging.getLogger("gibbs_codegen")


@contextmanager
def alone_in(folder: Path, signals: Sequence[int] = ()) -> Iterator[None]:
    """Keep other processes that write modules into a folder waiting, where it can be locked.

    Between two renames a module is not there, which is not for others to see. A lock that is held
    for a minute, longer than many that take turns need, ends in an `OutputError`. The first of the
    `signals`, which have come, ends the waiting.
    """
    from filelock import unlock_descriptor  # Late, as a lock is needed by few commands.

    number = None
    with suppress(OSError):  # Windows opens no folders.
        number = os.open(folder, os.O_RDONLY)
    if number is None:
        yield
        return
    try:
        _wait_for_lock(number, folder, signals)
        yield
    finally:
        # Closing is not enough where a child that was forked meanwhile has it open too.
        with suppress(OSError):
            unlock_descriptor(number)
        os.close(number)


def _wait_for_lock(number: int, folder: Path, signals: Sequence[int]) -> None:
    """Wait for a lock of an open folder, by its descriptor, and say so if it takes long.

    The first of the `signals`, which have come, ends it. Raises `OutputError` after a minute.
    """
    from filelock import lock_descriptor

    begin, announced = time.monotonic(), False
    while not signals:
        try:
            if lock_descriptor(number, blocking=False):
                return
        except OSError:  # Not every file system has locks; a module is written whole without.
            return
        waited = time.monotonic() - begin
        if waited > _PATIENCE_SECONDS:
            raise OutputError(
                f"{printable(folder)}: {_holder(number)} has been writing a module there for "
                f"{_PATIENCE_SECONDS:.0f} s; wait until it ends, end it, or choose another "
                "--out. Nothing was changed"
            )
        if waited > _NOTICE_SECONDS and not announced:
            _log.warning("%s: waiting for %s to finish", printable(folder), _holder(number))
            announced = True
        time.sleep(0.01)


def _holder(number: int) -> str:
    """The holder of the lock of an open folder, as far as the system tells."""
    inode = os.fstat(number).st_ino
    with suppress(OSError, ValueError):
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            _, kind, _, _, process, place, *_ = line.split()
            if kind == "FLOCK" and place.endswith(f":{inode}") and int(process) > 0:
                return f"process {process}"
    return "another process"


def check_output_folder(folder: str | os.PathLike[str]) -> None:
    """Raise `UsageError` where something else than a folder stands at a path or above it.

    Symbolic links to folders are followed.
    """
    if not os.fspath(folder):
        raise UsageError("--out: a folder is needed, not an empty name")
    path = Path(folder)
    try:
        for place in (path, *path.parents):
            if place.is_dir():
                for name in path.relative_to(place).parts:
                    with suppress(FileNotFoundError):
                        os.lstat(place / name)  # An `OSError` where the name is too long.
                return
            if place.is_symlink() and not place.exists():
                raise UsageError(
                    f"{printable(place)}: is a symbolic link that leads nowhere; "
                    "--out must be a folder"
                )
            if place.exists():
                raise UsageError(f"{printable(place)}: is a file; --out must be a folder")
    except OSError as error:
        raise UsageError(f"{printable(path)}: cannot be used: {cause_of(error)}") from None
