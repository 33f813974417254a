"""Whether a path can become a folder that output goes to."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from gibbs_codegen.errors import UsageError, cause_of, printable


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
                _check_names(place, path.relative_to(place).parts)
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


def _check_names(folder: Path, names: tuple[str, ...]) -> None:
    """Raise `OSError` for a name that no entry of a folder can have, as it is too long."""
    for name in names:
        with suppress(FileNotFoundError):
            os.lstat(folder / name)
