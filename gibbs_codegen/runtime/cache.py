"""The per-user cache of compiled libraries and of modules of robots that ship.

It is private, keyed by content, verified and filled atomically. An entry is a folder that holds one
library and its digest, or one module and its manifest. It is made under another name and then
renamed, so that it is whole or not there; it is never changed. A lock keeps processes that start at
once from making the same thing side by side.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from gibbs_codegen.errors import cause_of
from gibbs_codegen.files.module_writer import generated_files
from gibbs_codegen.files.staging import put_in_place, staging_folder

_LIBRARY = "library.so"
_DIGEST = "sha256"
# Set while those on any thread are to give up who wait for another process.
GIVEN_UP = threading.Event()


class CacheError(Exception):
    """The cache cannot be used; the message says why in a line."""


def cached_library(key: str, make: Callable[[Path], None]) -> Path:
    """Path of the library of a key, which `make` writes where the cache has none.

    Keys differ where libraries do. Raises `CacheError` if the cache cannot be used, and what `make`
    raises.
    """

    def fill(new: Path) -> None:
        make(new / _LIBRARY)
        (new / _DIGEST).write_text(_digest(new / _LIBRARY), encoding="ascii")

    def is_whole(entry: Path) -> bool:
        return _digest(entry / _LIBRARY) == (entry / _DIGEST).read_text(encoding="ascii")

    return _cached(key, fill, is_whole, (_LIBRARY, _DIGEST)) / _LIBRARY


def cached_module(key: str, name: str, make: Callable[[Path], None]) -> Path:
    """Folder of the module of a key, which `make` writes into a folder where the cache has none.

    `name` is the module's. Raises as `cached_library` does.
    """

    def is_whole(entry: Path) -> bool:
        folder = entry / name
        digests = generated_files(folder)
        return bool(digests) and all(_digest(folder / f) == d for f, d in digests.items())

    return _cached(key, make, is_whole, (name,)) / name


def _cached(
    key: str,
    fill: Callable[[Path], None],
    is_whole: Callable[[Path], bool],
    parts: Sequence[str],
) -> Path:
    """The entry of a key, which `fill` fills where the cache has none that is whole.

    `parts` are in it, and have to be ours.
    """

    def is_there(entry: Path) -> bool:
        try:
            paths = [entry, *(entry / part for part in parts)]
            if any(p.is_symlink() or not _is_ours(os.lstat(p)) for p in paths):
                return False
            return is_whole(entry)
        except (OSError, UnicodeDecodeError):
            return False

    try:
        root = _private_folder()
        entry = root / hashlib.sha256(key.encode()).hexdigest()
        if not is_there(entry):
            from filelock import FileLock  # Late, as most calls find the entry there.

            lock = FileLock(root / f"{entry.name}.lock", mode=0o600)
            with lock.acquire(cancel_check=GIVEN_UP.is_set):
                if not is_there(entry):
                    # What was there is renamed: a library that another process has loaded must not
                    # change under it.
                    with staging_folder(root) as new:
                        fill(new)
                        put_in_place(new, entry)
    except OSError as error:
        where = error.filename or cache_folder()
        raise CacheError(f"{where}: {cause_of(error)}") from None
    return entry


def cache_folder() -> Path:
    """The folder of the cache: GIBBS_CODEGEN_CACHE, or one in the platform's user cache.

    Raises `RuntimeError` where there is no home.
    """
    from platformdirs import user_cache_path

    chosen = os.environ.get("GIBBS_CODEGEN_CACHE")
    if chosen:
        return Path(chosen).expanduser().absolute()
    folder = user_cache_path("gibbs_codegen", appauthor=False)
    if not folder.is_absolute():
        # Nobody has chosen the working directory, in which a library might have been planted.
        raise RuntimeError("the home folder is a relative path")
    return folder


def _private_folder() -> Path:
    """The cache folder, made if need be, once nobody else can write to it."""
    try:
        folder = cache_folder()
    except RuntimeError:
        raise CacheError("no home folder for a cache") from None
    for path in (*reversed(folder.parents), folder):
        path.mkdir(mode=0o700, exist_ok=True)
    for parent in folder.parents:
        mode = parent.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise CacheError(
                f"{parent}: every user can write to it and could replace {folder.name}"
            )
    status = os.lstat(folder)
    if not stat.S_ISDIR(status.st_mode):
        raise CacheError(f"{folder}: not a plain folder")
    if not _is_ours(status):
        raise CacheError(f"{folder}: belongs to another user")
    if status.st_mode & 0o077:
        raise CacheError(f"{folder}: other users can write to it; make it private with chmod 700")
    return folder


def _is_ours(status: os.stat_result) -> bool:
    """True if something is this user's. Raises `CacheError` where files have no such owner."""
    if sys.platform == "win32":
        raise CacheError("there is no cache on Windows")
    return status.st_uid == os.getuid()


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
