"""`new`: a commented robot file to start from."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from gibbs_codegen.errors import printable
from gibbs_codegen.files.module_writer import write_new_file
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.names import name_from
from gibbs_codegen.robot.text import placed_robot_text, robot_text


def run(options: argparse.Namespace) -> int:
    """Write the robot file, and print how to go on."""
    path = Path(options.file)
    name = name_from(path.stem)
    rotors = (4 if options.placed else 6) if options.rotors is None else options.rotors
    if options.placed:
        text = placed_robot_text(name, rotors)
    else:
        text = robot_text(paper_family(rotors, 3), name, to_start_from=True)
    write_new_file(path, text)
    # An argument with a minus sign first would be taken for an option.
    words = ["gibbs-codegen", "generate", *(["--"] if str(path).startswith("-") else []), str(path)]
    command = printable(shlex.join(words), 4000)
    print(f"{printable(path)}: written, for a robot named {name}; edit it, then run: {command}")
    return 0
