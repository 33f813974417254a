"""Model predictive control that brings the tip of a flying arm around a circle, in simulation.

`python -m examples.nmpc ROBOT` generates the module of a robot, compiles it, flies it
in closed loop, and prints how near the point stayed to its path and how long the solver took. It
needs the extra `casadi`.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from examples.task import Circle, circle_task, module_of
from gibbs_codegen.errors import GibbsCodegenError, UsageError, printable
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.c_library import announced
from gibbs_codegen.runtime.load import load, require

if TYPE_CHECKING:
    from examples.controller import TrackedPath

# Length of a step, s: 50 steps a second.
STEP = 0.02


def track(
    robot_file: str,
    out: Path,
    circle: Circle,
    plugin: str | None = None,
    until: float | None = None,
) -> TrackedPath:
    """Generate the modules of a robot, and fly it around a circle.

    `robot_file` is a path, or the name of a robot that ships; modules go into the folder `out`.
    `plugin` is fatrop where CasADi has it, if None; the flight ends at `until`, s, or with the
    circle. Raises `UsageError` if CasADi is not installed, nothing compiles, or what is asked for
    is refused, and another `GibbsCodegenError` if the robot is.
    """
    require("casadi", "this example")
    from examples import tracking_problem as prediction
    from examples.controller import Controller, control_steps, fly, solver_plugin

    # What cannot be done is told before what takes long.
    plugin = solver_plugin(plugin)
    duration = circle.duration if until is None else until
    control_steps(duration, STEP)
    robot, _ = read_robot(robot_file)
    with announced("deriving the robot that flies"):
        folder = module_of(robot, out, ("step_rk4",))
    task = circle_task(load(folder), circle)
    plant = load(folder, backend="c")
    predicted = prediction.predicted_robot(robot, STEP)
    with announced("deriving the robot that the controller predicts with, and its derivatives"):
        folder = module_of(predicted, out, prediction.DERIVATIVES)
    model = load(folder, backend="casadi")
    expected = prediction.compiled(model, task.frame, STEP)
    controller = Controller(expected, task, STEP, plugin=plugin)
    with announced(f"flying {duration:g} s"):
        return fly(plant, controller, duration)


def report(flown: TrackedPath) -> str:
    """What the flight was like, in lines of words."""
    seconds = 1e3 * np.array([solution.seconds for solution in flown.solutions])
    within = 1e3 * np.array([solution.in_functions for solution in flown.solutions])
    iterations = [solution.iterations for solution in flown.solutions]
    failed = sum(not solution.succeeded for solution in flown.solutions)
    return "\n".join(
        [
            *([] if flown.ended is None else [f"the flight ended early: {flown.ended}"]),
            f"{len(flown.time)} control steps of {1e3 * STEP:.0f} ms",
            f"distance of the point from its path: greatest {1e3 * flown.error.max():.2f} mm, "
            f"root mean square {1e3 * np.sqrt(np.mean(flown.error**2)):.2f} mm",
            f"solving: median {np.median(seconds):.2f} ms, longest {seconds.max():.2f} ms, "
            f"of which in the robot's functions {np.median(within):.2f} ms (median)",
            f"iterations: median {np.median(iterations):.0f}, most {max(iterations)}; "
            f"{failed} solutions stopped before they converged",
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the example.

    Returns the exit code: 0, 1 if the flight ended early, or that of an error, which is printed.
    """
    options = argument_parser().parse_args(arguments)
    try:
        if options.figure is not None:
            _check_figure(Path(options.figure))
        circle = Circle(
            options.frame,
            None if options.posture is None else dict(options.posture),
            options.radius,
            options.duration,
            None if options.thrust is None else tuple(options.thrust),
            options.effort,
        )
        with tempfile.TemporaryDirectory() as folder:
            flown = track(options.robot, Path(folder), circle, options.solver, options.until)
    except GibbsCodegenError as error:
        print(f"nmpc: {error}", file=sys.stderr)
        return error.exit_code
    print(report(flown))
    if options.figure is not None:
        draw(flown, options.figure)
    return int(flown.ended is not None)


def draw(flown: TrackedPath, file: str) -> None:
    """Draw the flown path over the desired one, seen from above, and their distance over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    above, error = figure.subplots(1, 2)
    above.plot(*flown.wanted[:, :2].T, color="0.6", linewidth=4, label="desired")
    above.plot(*flown.point[:, :2].T, color="#0072b2", linewidth=1.2, label="flown")
    above.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    above.legend(loc="center", frameon=False)
    error.plot(flown.time, 1e3 * flown.error, color="#0072b2")
    error.set(xlabel="time (s)", ylabel="distance from the path (mm)", ylim=(0, None))
    figure.savefig(file, dpi=150)


def _check_figure(file: Path) -> None:
    """Refuse a figure that could not be written after the flight."""
    from matplotlib.backend_bases import FigureCanvasBase

    endings = FigureCanvasBase.get_supported_filetypes()
    if file.suffix[1:].lower() not in endings:
        known = ", ".join(f".{ending}" for ending in endings)
        raise UsageError(f"--figure {printable(file)}: must end with one of {known}")
    if file.is_dir() or not os.access(file.parent, os.W_OK):
        raise UsageError(
            f"--figure {printable(file)}: must be a file in a folder that exists and that you may "
            "write in"
        )


def argument_parser() -> argparse.ArgumentParser:
    """The parser of the command."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.nmpc", description=(__doc__ or "").splitlines()[0]
    )
    add = parser.add_argument
    add("robot", metavar="ROBOT", help="a robot file, or the name of a robot that ships")
    add("--frame", help="the frame whose origin follows the path (default: the last one)")
    add(
        "--posture",
        nargs="+",
        type=_joint,
        metavar="JOINT=VALUE",
        help="joints' coordinates in hover, rad or m (default: the arm hangs)",
    )
    add("--radius", type=float, metavar="M", help="of the circle (default: a quarter of the reach)")
    add("--duration", type=float, default=8.0, metavar="S", help="of the circle (default: 8)")
    add("--until", type=float, metavar="S", help="when the flight ends (default: with the circle)")
    add("--thrust", nargs=2, type=float, metavar=("LEAST", "MOST"), help="limits of thrusts, N")
    add("--effort", type=float, metavar="MOST", help="limit of joint torques and forces, N m and N")
    add("--solver", choices=("fatrop", "ipopt"), help="default: fatrop where CasADi has it")
    add("--figure", metavar="FILE", help="draw the flown path and its error")
    return parser


def _joint(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{printable(text)}: must be JOINT=VALUE, such as theta_8=-1.2 (rad or m)"
        ) from None


if __name__ == "__main__":
    raise SystemExit(main())
