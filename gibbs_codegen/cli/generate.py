"""`generate`: derive a robot's equations and write its module."""

from __future__ import annotations

import argparse
import os
import re
import sys
import textwrap
import time
from pathlib import Path

from gibbs_codegen.cli import arguments, robot_argument, terminal
from gibbs_codegen.errors import printable
from gibbs_codegen.files.module_writer import kept_options
from gibbs_codegen.robot.balance import balance_lines, lopsided
from gibbs_codegen.targets.registry import DEFAULT_TARGETS, TARGETS


def run(options: argparse.Namespace) -> int:
    """Write the module or compare it with what is there, and print which."""
    robot, text = robot_argument.chosen_robot(options)
    from gibbs_codegen import pipeline  # It imports SymPy, which a robot that is refused needs not.

    kept = kept_options(Path(options.out) / robot.name)
    if not kept and options.robot and os.path.exists(options.robot):
        place = Path(options.robot)
        kept = kept_options(place.parent if place.is_file() else place)
    _repeat(options, kept)
    request = (
        *(robot, text, options.out),
        *(options.target or DEFAULT_TARGETS, bool(options.all_parameters)),
    )
    chosen = options.derivatives or False, options.functions, options.laws or ()
    if options.check:
        with terminal.progress() as progress:
            folder, differing = pipeline.check_robot(*request, progress, *chosen)
        if not differing:
            print(f"{printable(folder)}: up to date")
            return 0
        why = "differs from what would be written" if folder.is_dir() else "is not there yet"
        made = f"; it was generated with {kept or 'no options'}" if folder.is_dir() else ""
        listed = printable(", ".join(differing))
        print(f"{printable(folder)}: {why}: {listed}{made}", file=sys.stderr)
        return 1
    start = time.perf_counter()
    with terminal.progress() as progress:
        model, folder = pipeline.generate_robot(
            *request, progress, not options.no_verify, options.force, *chosen
        )
    words = (
        f"{printable(folder)}: {len(model.signatures)} functions of "
        f"{len(model.program.inputs['q'])} coordinates and {len(model.program.inputs['u'])} inputs "
        f"in {time.perf_counter() - start:.1f} s"
    )
    if "mass_matrix_and_residual" in model.functions:
        counts = model.program.function("mass_matrix_and_residual").operations
        words += (
            f"; mass matrix and residual take {counts.total} operations and "
            f"{counts.sine_cosine_pairs} sine-cosine pairs"
        )
    print(words)
    if options.repeats:
        print(f"with the module's earlier options: {options.repeats}")
    for line in balance_lines(robot):
        print(textwrap.fill(line, terminal.width(), subsequent_indent="  "))
    if warning := lopsided(robot):
        print(f"gibbs-codegen: warning: {warning}", file=sys.stderr)
    return _compile(folder) if options.compile else 0


def _compile(folder: Path) -> int:
    """Compile what flights need of a module, and print how long it took."""
    from gibbs_codegen.runtime.c_library import CompilerError
    from gibbs_codegen.runtime.cache import CacheError
    from gibbs_codegen.runtime.load import load

    start = time.perf_counter()
    try:
        if compiled := getattr(load(folder, "c"), "compiled", None):
            with compiled.built():
                pass
            print(
                f"compiled for flights in {time.perf_counter() - start:.1f} s; the cache keeps it"
            )
        return int(not compiled)
    except (CompilerError, CacheError) as error:
        print(f"gibbs-codegen: nothing is compiled: {printable(error, 400)}", file=sys.stderr)
        return 1


def _repeat(options: argparse.Namespace, kept: str) -> None:
    """Take what is not given from the options that a module keeps; `repeats` has what is taken.

    A line that this version does not read is passed over.
    """
    parser = arguments.Parser(exit_on_error=False, add_help=False)
    arguments.add_kept(parser)
    options.repeats = ""
    try:
        taken, unknown = parser.parse_known_args(kept.split())
    except argparse.ArgumentError:
        return
    if gone := [name for name in taken.target or () if not _is_known(name)]:
        print(
            f"The module was generated with --target {' --target '.join(map(printable, gone))}, "
            "which this version does not have; the module is written without it.",
            file=sys.stderr,
        )
        taken.target = [name for name in taken.target if _is_known(name)]
        kept = re.sub(rf"--target[= ](?:{'|'.join(map(re.escape, gone))})(?!\S)", "", kept)
    for name, value in vars(taken).items():
        if not unknown and value is not None and getattr(options, name) is None:
            setattr(options, name, value)
            written = rf"--{name.replace('_', '-')}(?:[= ][^-]\S*)?(?!\S)"
            options.repeats = " ".join([options.repeats, *re.findall(written, kept)]).lstrip()


def _is_known(target: str) -> bool:
    """True if this version has a target, whatever acts in it."""
    return target.partition(":")[0] in TARGETS
