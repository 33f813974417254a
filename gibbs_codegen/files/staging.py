"""Writing aside and swapping: others see what was there or what is new, each of them whole.

What is new grows in a hidden folder beside the place it is for, and is then renamed. What it takes
the place of goes into that folder too, under its own name: so whoever comes after a process that
was killed between the two renames can put it back.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PREFIX = ".gibbs_codegen_new_"
# No robot, result or entry of the cache has this name.
_NEW = "_new"
# Longer than anything takes to write, be it an animation; a younger folder may be in use.
_STALE_SECONDS = 3600.0


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
        _remove_stale(parent)
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


def _remove_stale(parent: Path) -> None:
    """Remove what a process that was killed outright could not, and put back what it had taken."""
    for hidden in parent.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if hidden.is_dir() and time.time() - hidden.stat().st_mtime > _STALE_SECONDS:
                for path in hidden.iterdir():
                    if path.name != _NEW and not (parent / path.name).exists():
                        os.replace(path, parent / path.name)
                shutil.rmtree(hidden, ignore_errors=True)
