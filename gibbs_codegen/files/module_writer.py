"""Writing a generated module, whole or not at all, with a manifest of what was generated.

A user may keep a copy in the folder, or edit a file, and nothing in the text of a file tells. So
`MANIFEST` holds the digest of each generated file, as `sha256sum --check` reads it; whatever else
stands there is foreign.
"""

from __future__ import annotations

import hashlib
import itertools
import logging
import os
import re
import signal
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.util import source_from_cache
from pathlib import Path

from gibbs_codegen.errors import OutputError, UsageError, cause_of, printable
from gibbs_codegen.files import staging
from gibbs_codegen.version import HEADER_START, __version__

# By name: texts, or what is no text.
Files = Mapping[str, str | bytes]
MANIFEST = "MANIFEST"
_CACHE = "__pycache__"
_OPTIONS = "# Options of gibbs-codegen generate: "
_TEXT = re.compile(rf"# {HEADER_START} .*\n(?:{_OPTIONS}(.+)\n)?((?:[0-9a-f]{{64}}  .+\n)+)")


def with_manifest(files: Files, options: str = "") -> dict[str, str | bytes]:
    """Files of a module, texts and other contents by name, with their manifest among them.

    It has the options that chose what was generated, so that they can be repeated.
    """
    lines = [f"# {HEADER_START} {__version__}: SHA-256 of each file that was generated"]
    lines += [_OPTIONS + options] if options else []
    lines += [f"{_digest(_encoded(text))}  {name}" for name, text in sorted(files.items())]
    return {**files, MANIFEST: "\n".join(lines) + "\n"}


def generated_files(folder: Path) -> dict[str, str]:
    """Digests by name of files that a folder's manifest names; empty where there is none."""
    manifest = _manifest(folder)
    if manifest is None:
        return {}
    lines = manifest[2].removesuffix("\n").split("\n")
    own_digest = _digest((folder / MANIFEST).read_bytes())
    return {line[66:]: line[:64] for line in lines} | {MANIFEST: own_digest}


def kept_options(folder: Path) -> str:
    """The options with which a folder's module was generated; empty where there were none."""
    try:
        manifest = _manifest(folder)
    except OSError:  # Writing the module reports what is wrong with the folder.
        return ""
    return manifest[1] or "" if manifest else ""


def _manifest(folder: Path) -> re.Match[str] | None:
    path = folder / MANIFEST
    if not _is_plain(path):
        return None
    return _TEXT.fullmatch(path.read_bytes().decode(errors="replace"))


def foreign(folder: Path, files: Files) -> list[str]:
    """Names of what in a folder is not as the manifest there says it was generated.

    Those of `files` with that text are not foreign even where no manifest names them. What cannot
    be read raises `OSError`.
    """
    digests = {name: _digest(_encoded(text)) for name, text in files.items()}
    digest_of = {*generated_files(folder).items(), *digests.items()}
    names = {name for name, _ in digest_of}

    def is_known(name: str) -> bool:
        path = folder / name
        return name in names and _is_plain(path) and (name, _digest(path.read_bytes())) in digest_of

    return [name for name in entries(folder, names) if not is_known(name)]


def entries(folder: Path, names: Collection[str]) -> Iterator[str]:
    """Paths, with /, of what is in a folder, but for what Python keeps there of some sources.

    A folder that some of them are in is entered.
    """
    if not folder.is_dir():
        return
    for path in sorted(folder.iterdir()):
        if path.is_symlink() or not path.is_dir():
            yield path.name
            continue
        start = f"{path.name}/"
        inside = {name.removeprefix(start) for name in names if name.startswith(start)}
        if inside:
            yield from (start + name for name in entries(path, inside))
            continue
        if path.name != _CACHE:
            yield path.name
            continue
        for kept in sorted(path.iterdir()):
            source = ""  # What Python compiled it from.
            with suppress(ValueError):
                source = Path(source_from_cache(str(kept))).name if kept.suffix == ".pyc" else ""
            if not (_is_plain(kept) and source in names):
                yield f"{_CACHE}/{kept.name}"


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _encoded(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


_log = logging.getLogger("gibbs_codegen")


def differing_files(folder: Path, files: Files, options: str = "") -> list[str]:
    """Names of files in a folder that are missing, changed, or not of a module of such texts.

    Raises `OutputError` if they cannot be read.
    """
    expected = with_manifest(files, options)
    try:
        with staging.alone_in(folder.parent):
            changed = [
                name
                for name, text in expected.items()
                if not (path := folder / name).is_file() or path.read_bytes() != _encoded(text)
            ]
            return changed + [name for name in entries(folder, expected) if name not in expected]
    except OSError as error:
        raise OutputError(f"{printable(folder)}: cannot be read: {cause_of(error)}") from None


def check_replaceable(folder: Path, robot_text: str, force: bool = False) -> None:
    """Refuse early what `write_module` will refuse, as far as is known before there are files.

    What has no manifest may yet turn out to be what would be written. `robot_text` is what its
    robot file is about to become. Raises `UsageError`.
    """
    with staging.alone_in(folder.parent):
        names = _foreign(folder, {"robot.toml": robot_text})
        if names and not force and generated_files(folder):
            raise _refusal(folder, names)


def _foreign(folder: Path, files: Files) -> list[str]:
    """Names of what in `folder` was not generated. Raises `UsageError` where it is no folder."""
    try:
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise UsageError(
                f"{printable(folder)}: exists and is not a generated module; remove it first"
            )
        return foreign(folder, files)
    except OSError as error:
        raise UsageError(f"{printable(folder)}: cannot be used: {cause_of(error)}") from None


def _refusal(folder: Path, names: Sequence[str]) -> UsageError:
    """The refusal of a folder that holds a user's files, with what to do."""
    why = "were not generated, or were changed since"
    if not generated_files(folder):
        why = f"are not in {MANIFEST}"
    return UsageError(
        f"{printable(folder)}: holds files that {why}: {_listed(names)}; move them, choose "
        "another --out or name, or rename the whole folder with --force"
    )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return printable(", ".join(names[:5])) + more


def write_module(folder: Path, files: Files, force: bool = False, options: str = "") -> None:
    """Put files and their manifest into a folder, replacing the module that is there.

    They are written and flushed in a hidden folder beside it, which then takes its place. A failure
    leaves what was there, and nothing else; signals to end are held back until a whole module is in
    place, the old or the new one, and the hidden folder is gone. What must not be replaced raises
    `UsageError`; with `force` a folder with files that were not generated, or were changed since,
    is kept under another name. The log names that, or else the files of the module that
    nothing replaces. Raises `OutputError` if the files cannot be written, or a signal came.
    """
    staging.check_output_folder(folder.parent)
    files = with_manifest(files, options)
    # A path through the module itself, or relative to it, would lead astray while it is replaced.
    place = Path(os.path.realpath(folder.parent)) / folder.name
    written = False
    with _signals_held() as signals:
        try:
            with staging.made(place.parent), staging.alone_in(folder.parent, signals):
                _check_beside(folder, files)
                names, lost = _foreign(place, files), generated_files(place).keys() - files.keys()
                if names and not force:
                    raise _refusal(folder, names)
                aside = None
                if names:
                    olds = (place.with_name(f"{place.name}.old{i}") for i in itertools.count(1))
                    aside = next(path for path in olds if not os.path.lexists(path))
                with staging.staging_folder(place.parent) as new:
                    for name, text in files.items():
                        _write_flushed(new / name, text)
                        if signals:
                            break
                    else:
                        staging.put_in_place(new, place, aside)
                        written = True
        except OSError as error:
            raise OutputError(
                f"{printable(folder)}: cannot be written: {cause_of(error)}; nothing was changed"
            ) from None
    if not written:  # The signal's handler, which is the program's own, has returned.
        raise OutputError(f"{printable(folder)}: a signal ended the writing; nothing was changed")
    if aside:
        kept = printable(folder.with_name(aside.name))
        words = "%s: held %s; the folder is kept as %s"
        _log.warning(words, printable(folder), _listed(names), kept)
    elif lost:
        _log.warning("%s no longer has these files: %s", printable(folder), _listed(sorted(lost)))


def _check_beside(folder: Path, files: Files) -> None:
    """Refuse a robot's files that have the names of another's beside it, as C files of both may.

    Whoever puts the sources of both into one folder would lose some. Raises `UsageError`.
    """
    for other in {*folder.parent.glob(f"{folder.name[0]}*/")} - {folder}:
        names = generated_files(other).keys() & files.keys()
        starts = [(f"{name}.", f"{name}_") for name in (folder.name, other.name)]
        both = [x for x in sorted(names) if all(x.startswith(start) for start in starts)]
        if both:
            raise UsageError(
                f"{printable(folder)}: {_listed(both)} would have the names of files in "
                f"{printable(other)}, and builds of both modules would mix them; rename the robot"
            )


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
        replaced = "" if force is None else ", or replace it with --force"
        message = f"{printable(path)}: exists already; choose another name{replaced}"
        raise UsageError(message) from None
    except OSError as error:
        raise OutputError(f"{printable(path)}: cannot be written: {cause_of(error)}") from None


def _write_flushed(path: Path, text: str | bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(_encoded(text))
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def _signals_held() -> Iterator[list[int]]:
    """Hold signals to end back, and deliver the first of them on leaving.

    Yields the list of those that have come. A signal that is ignored stays ignored.
    """
    signals: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, lambda n, _: signals.append(n))
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if signals:
            signal.raise_signal(signals[0])
