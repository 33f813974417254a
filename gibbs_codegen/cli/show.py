"""`show`: the paper's equations of one chain."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.cli.terminal import Parser


def add(commands: argparse._SubParsersAction[Parser]) -> None:
    """Add the command to the parser."""
    show = commands.add_parser(
        "show",
        help="print the paper's equations of one chain as text or LaTeX",
    )
    robot_argument.add_robot(show)
    show.add_argument(
        "--chain",
        type=int,
        required=True,
        metavar="J",
        help="number of the chain, as `info` lists them",
    )
    show.add_argument(
        "--equation",
        action="append",
        type=int,
        metavar="E",
        help="number of an equation: 2 (Gibbs function), 5 (its partial derivatives), 6 (the two "
        "vectors of a link), 15 (equations of motion) or 18 (places in the hybrid system); may be "
        "repeated (default: 15 and 18)",
    )
    show.add_argument(
        "--format",
        choices=("text", "latex"),
        default="text",
        help="how to print the equations (default: text)",
    )
    show.set_defaults(command=_show)


def _show(options: argparse.Namespace) -> int:
    robot, _ = robot_argument.chosen_robot(options)
    from gibbs_codegen.equations.pages import LEAST_WIDTH, MOST_WIDTH, as_latex, as_text
    from gibbs_codegen.equations.show import SHORT, chain_equation

    with terminal.progress() as progress:
        equations = []
        for number in options.equation or SHORT:
            progress(f"equation {number}")
            equations.append(chain_equation(robot, options.chain, number))
        progress("setting the equations")
        if options.format == "latex":
            laid_out = as_latex(*equations)
        else:
            laid_out = as_text(
                *equations, width=min(max(terminal.width(), LEAST_WIDTH), MOST_WIDTH)
            )
    print(laid_out, end="")
    return 0
