"""The command line: its exit codes, errors and output.

A command is a module with a function `run`, imported when its words have been understood.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import re
import sys
from argparse import Namespace
from collections.abc import Sequence
from importlib import import_module

from gibbs_codegen.cli.arguments import argument_parser
from gibbs_codegen.errors import GibbsCodegenError, RefusedFileError, cause_of


def console() -> int:
    """Entry point of the `gibbs-codegen` command: `main`, with care for its output.

    The process then ends with its exit code.
    """
    # A stream that was closed before the start is None: what is written there goes nowhere.
    # It lives as long as the process.
    nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stdout, sys.stderr = sys.stdout or nowhere, sys.stderr or nowhere
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # A terminal that lacks a letter shows its code.
            stream.reconfigure(errors="backslashreplace")
    # A derivation makes millions of small objects and hardly any cycles, and the process ends soon.
    gc.disable()
    codes: list[int] = []
    # Last of all: to take the interpreter down as well takes half a second and more.
    atexit.register(lambda: os._exit(codes[0]) if codes else None)
    try:
        code = main()
        sys.stdout.flush()
        codes.append(code)
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(f"gibbs-codegen: output: {cause_of(error)}", file=sys.stderr)
        # The reader has gone or its disk is full: keep Python from trying to flush to it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return code


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command, given by the words after `gibbs-codegen`, or those of the process.

    Returns the exit code: 0 if the command succeeded, 1 if it failed, 2 for wrong usage or a
    rejected file.
    """
    options = options_of(sys.argv[1:] if arguments is None else arguments)
    try:
        code: int = import_module(f"gibbs_codegen.cli.{options.module}").run(options)
    except RefusedFileError as error:
        count = f"{len(error.faults)} faults" if len(error.faults) > 1 else "1 fault"
        print(f"gibbs-codegen: {error.kind} rejected, {count}:\n{error}", file=sys.stderr)
        return error.exit_code
    except GibbsCodegenError as error:
        print(f"gibbs-codegen: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("gibbs-codegen: interrupted", file=sys.stderr)
        return 130
    return code


def options_of(words: Sequence[str]) -> Namespace:
    """Options of a command; wrong usage ends the process."""
    parser = argument_parser()
    for word in words:  # Before Python 3.13 argparse makes an empty list of such a value.
        if re.fullmatch(r"--[a-z-]+=--", word):
            parser.error(f"{word}: -- is not a value; write ./-- for a path of that name")
    # Names are joined to the option, so that a word after it that is none is the robot.
    joined = list[str]()
    for word in words:
        named = word in ("all", "none") or "," in word or word.endswith("_derivatives")
        if named and joined[-1:] == ["--derivatives="]:
            joined[-1] += word
        else:
            joined.append("--derivatives=" if word == "--derivatives" else word)
    return parser.parse_args(joined)
