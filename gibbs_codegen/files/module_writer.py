"""Writing a generated module: whole or not at all."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from gibbs_codegen.errors import OutputError, UsageError, cause_of, printable
from gibbs_codegen.files.folder_lock import alone_in
from gibbs_codegen.files.manifest import MANIFEST, entries, foreign, generated_files, with_manifest
from gibbs_codegen.files.output_folder import check_output_folder
from gibbs_codegen.files.staging import made, put_in_place, staging_folder

_log = logging.getLogger("gibbs_codegen")


def differing_files(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Names of files in a folder that are missing, changed, or not of a module of such texts.

    Raises `OutputError` if they cannot be read.
    """
    expected = with_manifest(files)
    try:
        with alone_in(folder.parent):
            return [
                *(name for name, text in expected.items() if not _holds(folder / name, text)),
                *(name for name in entries(folder, expected) if name not in expected),
            ]
    except OSError as error:
        raise OutputError(f"{printable(folder)}: cannot be read: {cause_of(error)}") from None


def _holds(path: Path, text: str) -> bool:
    return path.is_file() and path.read_bytes() == text.encode()


def check_replaceable(folder: Path, robot_text: str, force: bool = False) -> None:
    """Refuse what `write_module` will refuse, as far as that can be told before there are files.

    What has no manifest may yet turn out to be what would be written. `robot_text` is what its
    robot file is about to become. Raises `UsageError`.
    """
    with alone_in(folder.parent):
        names = _foreign(folder, {"robot.toml": robot_text})
        if names and not force and generated_files(folder):
            raise _refusal(folder, names)


def _foreign(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Names of what in `folder` was not generated. Raises `UsageError` where it is no folder."""
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise UsageError(
                f"{printable(folder)}: is in the way and is not a generated module; remove it first"
            )
        return foreign(folder, files)
    except OSError as error:
        raise UsageError(f"{printable(folder)}: cannot be used: {cause_of(error)}") from None


def _refusal(folder: Path, names: Sequence[str]) -> UsageError:
    """What says that a folder holds a user's files, and what to do."""
    why = "was not generated, or was changed since"
    if not generated_files(folder):
        why = f"is in no {MANIFEST} of generated files"
    return UsageError(
        f"{printable(folder)}: holds what {why}: {_listed(names)}; move it elsewhere, choose "
        "another --out or name, or have the whole folder put aside with --force"
    )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return printable(", ".join(names[:5])) + more


def write_module(folder: Path, files: Mapping[str, str], force: bool = False) -> None:
    """Put files and their manifest into a folder, replacing the module that is there.

    They are written and flushed in a hidden folder beside it, which then takes its place. A failure
    leaves what was there, and nothing else; signals to end are held back until a whole module is in
    place, the old or the new one, and the hidden folder is gone. What must not be replaced raises
    `UsageError`; with `force` a folder with files that were not generated, or were changed since,
    is kept under another name, which the log tells. Raises `OutputError` if the files cannot be
    written, or a signal came.
    """
    check_output_folder(folder.parent)
    files = with_manifest(files)
    # A path through the module itself, or relative to it, would lead astray while it is replaced.
    place = Path(os.path.realpath(folder.parent)) / folder.name
    with _signals_held() as held:
        try:
            with made(place.parent), alone_in(folder.parent, held):
                names = _foreign(place, files)
                if names and not force:
                    raise _refusal(folder, names)
                aside = _unused_name(place) if names else None
                written = _write_and_swap(place, files, aside, held)
        except OSError as error:
            raise OutputError(
                f"{printable(folder)}: cannot be written: {cause_of(error)}; nothing was changed"
            ) from None
    if not written:  # The signal's handler, which is the program's own, has returned.
        raise OutputError(
            f"{printable(folder)}: writing was ended by a signal; nothing was changed"
        )
    if aside:
        kept = printable(folder.with_name(aside.name))
        _log.warning(
            "%s: held %s; the folder is kept as %s", printable(folder), _listed(names), kept
        )


def _unused_name(folder: Path) -> Path:
    """Path beside a folder for what was there before."""
    number = 1
    while os.path.lexists(path := folder.with_name(f"{folder.name}.old{number}")):
        number += 1
    return path


def _write_and_swap(
    folder: Path, files: Mapping[str, str], aside: Path | None, held: Sequence[int]
) -> bool:
    """Write a module, swap it for what is there, and return whether no signal came before the end.

    What is there goes to `aside`, or is removed. The first of the signals `held`, which have come,
    ends the writing.
    """
    with staging_folder(folder.parent) as new:
        for name, text in files.items():
            _write_flushed(new / name, text)
            if held:
                return False
        put_in_place(new, folder, aside)
        return True


def write_new_file(path: Path, text: str, force: bool | None = None) -> None:
    """Write a file that must not exist yet, or with force in place of another: whole, or not.

    `force` is None where users cannot ask for that. Raises `UsageError` if it exists, `OutputError`
    if it cannot be written.
    """
    fresh = path.with_name(f"{path.name}.{os.getpid()}.new") if force else path
    try:
        file = fresh.open("x", encoding="utf-8", newline="\n")
        try:
            with file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            if force:  # Windows renames and removes no file that is open.
                os.replace(fresh, path)
        except BaseException:
            fresh.unlink()
            raise
    except FileExistsError:
        replaced = "" if force is None else ", or have it replaced with --force"
        message = f"{printable(path)}: exists already; choose another name{replaced}"
        raise UsageError(message) from None
    except OSError as error:
        raise OutputError(f"{printable(path)}: cannot be written: {cause_of(error)}") from None


def _write_flushed(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(text.encode())
        file.flush()
        os.fsync(file.fileno())


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
