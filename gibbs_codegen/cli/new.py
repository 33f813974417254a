"""`new`: a commented robot file to start from."""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path

from gibbs_codegen.cli.robot_argument import find_robot
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.module_writer import write_new_file
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.names import name_from
from gibbs_codegen.robot.text import placed_robot_text, robot_text


def run(options: argparse.Namespace) -> int:
    """Write the robot file, and print how to go on."""
    path = Path(options.file)
    name = name_from(path.stem)
    if options.like and (options.placed or options.rotors is not None):
        raise UsageError("--like copies a whole file; leave out --placed and --rotors")
    rotors = (4 if options.placed else 6) if options.rotors is None else options.rotors
    if options.like:
        _, text = find_robot(options.like)
        text = re.sub(r"^name\b.*", f'name = "{name}"', text, count=1, flags=re.MULTILINE)
    elif options.placed:
        text = placed_robot_text(name, rotors)
    else:
        text = robot_text(paper_family(rotors, 3), name, to_start_from=True)
    write_new_file(path, text)
    # An argument with a minus sign first would be taken for an option.
    words = ["gibbs-codegen", "generate", *(["--"] if str(path).startswith("-") else []), str(path)]
    command = printable(shlex.join(words), 4000)
    print(f"{printable(path)}: written, for a robot named {name}; edit it, then run: {command}")
    return 0
