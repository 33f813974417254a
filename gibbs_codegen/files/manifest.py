"""The manifest of a generated module: which of the files in its folder were generated.

A user may keep a copy there, or edit a file, and nothing in the text of a file tells. So `MANIFEST`
holds the digest of each, as `sha256sum --check` reads it; whatever else stands there is foreign.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Iterator, Mapping
from importlib.util import source_from_cache
from pathlib import Path

from gibbs_codegen.version import HEADER_START, __version__

MANIFEST = "MANIFEST"
_CACHE = "__pycache__"
_TEXT = re.compile(rf"# {HEADER_START} .*\n((?:[0-9a-f]{{64}}  .+\n)+)")


def with_manifest(files: Mapping[str, str]) -> dict[str, str]:
    """Files of a module, texts by name, with their manifest among them."""
    lines = [f"# {HEADER_START} {__version__}: SHA-256 of each file that was generated"]
    lines += [f"{_digest(text.encode())}  {name}" for name, text in sorted(files.items())]
    return {**files, MANIFEST: "\n".join(lines) + "\n"}


def generated_files(folder: Path) -> dict[str, str]:
    """Digests by name of files that a folder's manifest names; empty where there is none."""
    path = folder / MANIFEST
    if not _is_plain(path):
        return {}
    found = _TEXT.fullmatch(path.read_bytes().decode(errors="replace"))
    if found is None:
        return {}
    lines = found[1].removesuffix("\n").split("\n")
    return {line[66:]: line[:64] for line in lines} | {MANIFEST: _digest(path.read_bytes())}


def foreign(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Names of what in a folder is not as the manifest there says it was generated.

    Those of `files` with that text are not foreign even where no manifest names them. What cannot
    be read raises `OSError`.
    """
    digests = {name: _digest(text.encode()) for name, text in files.items()}
    known = {*generated_files(folder).items(), *digests.items()}
    names = {name for name, _ in known}

    def is_known(name: str) -> bool:
        path = folder / name
        return name in names and _is_plain(path) and (name, _digest(path.read_bytes())) in known

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
            if not (_is_plain(kept) and _source(kept) in names):
                yield f"{_CACHE}/{kept.name}"


def _source(kept: Path) -> str:
    """Name of the source that a file of Python's cache was compiled from; empty for other files."""
    try:
        return Path(source_from_cache(str(kept))).name if kept.suffix == ".pyc" else ""
    except ValueError:
        return ""


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
