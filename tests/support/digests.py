"""What commands emit, as digests to compare between environments: `digests.py COMMAND …`.

A command is what follows `gibbs-codegen`, as one argument: "generate hexarotor --target c". All run
in one process, in the order given, and for each a line is printed: the SHA-256 of the files that it
writes, or of what `show` prints, and the command.
"""

from __future__ import annotations

import hashlib
import io
import locale
import os
import shlex
import sys
import tempfile
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path

from gibbs_codegen.cli.app import main


def commands(robot_files: Sequence[Path]) -> list[str]:
    """What is compared: robots of files and of the family, and equations."""
    return [
        *(f"generate {shlex.quote(str(path))}" for path in robot_files),
        "generate quadrotor_arm_2link",
        "generate --rotors 3 --links 1 --all-parameters",
        "show quadrotor_2link --chain 1 --equation 2 --equation 5 --equation 6 --equation 15",
        "show hexarotor_3link --chain 3 --format latex",
    ]


def digest(command: str) -> str:
    """SHA-256 of what a command emits."""
    words = shlex.split(command)
    found = hashlib.sha256()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()) as printed:
        # To verify takes as long as to emit, and changes no byte.
        options = ["--no-verify", "--out", folder] if words[0] == "generate" else []
        code = main([*words, *options])
        if code != 0:
            raise SystemExit(f"{command}: exits {code}")
        for path in sorted(Path(folder).rglob("*.*")):
            found.update(f"{path.name}\n".encode() + path.read_bytes())
    # What `generate` prints names the time it took.
    found.update(printed.getvalue().encode() if words[0] == "show" else b"")
    return found.hexdigest()


if __name__ == "__main__":
    # As in a program that has taken up its user's locale. Without LC_ALL there may be none to take.
    locale.setlocale(locale.LC_ALL, os.environ.get("LC_ALL", "C"))
    for argument in sys.argv[1:]:
        print(digest(argument), argument, flush=True)
