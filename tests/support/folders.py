"""What a folder holds."""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

Tree = dict[str, str]


def tree(folder: Path) -> Tree:
    """What every path below a folder is, links, pipes and contents of files told apart."""
    found = {}
    for path in folder.rglob("*"):
        mode = path.lstat().st_mode
        kind = stat.filemode(mode)[0]
        if stat.S_ISLNK(mode):
            kind += os.readlink(path)
        elif stat.S_ISREG(mode):
            kind += hashlib.sha256(path.read_bytes()).hexdigest()
        found[str(path.relative_to(folder))] = kind
    return found
