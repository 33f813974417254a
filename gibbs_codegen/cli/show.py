"""`show`: the paper's equations of one chain."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli import robot_argument, terminal


def run(options: argparse.Namespace) -> int:
    """Print the equations."""
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
