"""Predictive control against others in one run: `python benchmarks/nmpc_times.py`.

The tip of a flying arm goes around a circle, and each of these flies it by itself, with the same
costs, horizon of 20 steps of 20 ms, and limits:

- `Predictive`, one real-time iteration an instant,
- fatrop and IPOPT through CasADi, with C that CasADi generates of the emitted functions and of
  their exact derivatives,
- the same with C of articulated bodies, the best public recursion, which CasADi differentiates,
- box-FDDP of Crocoddyl, which calls the module's C through Python and knows limits of inputs only,
- acados with HPIPM, one real-time iteration an instant, with `acados_model` and with C that CasADi
  generates of the step, where `--acados` is an interpreter that has it.

Peers have no dampers and no lag, so these are left out. The steps of all must agree to 1e-9, and
their derivatives to 1e-7. At each instant one contender after the other plans, so that a busy
machine slows all of them. The closed-loop cost is that of the problem, of what was flown.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from c_times import machine  # noqa: E402
from family import named_robot  # noqa: E402
from peers.acados_peer import Acados  # noqa: E402
from peers.casadi_articulated import forward_dynamics  # noqa: E402
from peers.casadi_bases import MovingBase  # noqa: E402
from peers.casadi_recursions import Machine  # noqa: E402
from peers.casadi_spatial import Scalar, Vector  # noqa: E402
from peers.tracking import (  # noqa: E402
    BoxFDDP,
    Prediction,
    Problem,
    Solver,
    exact,
    traced,
)
from peers.tree import tree_of  # noqa: E402

from gibbs_codegen import Predictive, load, trim  # noqa: E402
from gibbs_codegen.flight.plant.actuators import module_actuators  # noqa: E402
from gibbs_codegen.flight.plant.vehicle import Vehicle  # noqa: E402
from gibbs_codegen.pipeline import generate_robot  # noqa: E402
from gibbs_codegen.robot.model import Robot  # noqa: E402
from gibbs_codegen.robot.text import robot_text  # noqa: E402
from gibbs_codegen.runtime import acados, predictive  # noqa: E402

Array = np.ndarray
# Postures, radii (m) and rates (rad/s) of circles.
ROBOTS = {
    "quadrotor_arm_2link": ({"upper_arm": 1.2, "forearm": 0.7}, 0.3, 0.3 * np.pi),
    "hextilt_flying_arm_5": (None, 0.1, 0.5 * np.pi),
}
OURS, TOP = "Predictive", 1.0
# Steps of the plant in one of the controllers; what is left out of the tracking, s.
SUBSTEPS, SETTLED = 20, 2.0


@dataclass(frozen=True)
class Thrusts:
    """A base whose wrench is that of thrusts, so that no generalised force is made of it first."""

    base: MovingBase
    wrenches: ca.DM
    thrusts: ca.SX

    def __getattr__(self, name: str) -> object:
        return getattr(self.base, name)

    def wrench(self, forces: Vector) -> tuple[Vector, Vector]:
        """Torque and force of the thrusts."""
        del forces
        entries: list[Scalar] = ca.mtimes(self.wrenches, self.thrusts).elements()
        return entries[:3], entries[3:]


def recursion(robot: Robot, module: ModuleType, q: Array) -> ca.Function:
    """CasADi's own tracing of articulated bodies: accelerations."""
    tree = tree_of(robot)
    made, rotors = Machine(tree), len(module.INPUTS) - tree.joints
    u = ca.SX.sym("u", len(module.INPUTS))
    # Torque and force in the axes of the base, which is level in hover.
    of_base = np.roll(module.input_matrix(q)[list(made.base.rows), :rotors], 3, axis=0)
    made.base = Thrusts(made.base, ca.DM(ca.sparsify(of_base)), u[:rotors])
    for k in range(tree.joints):
        made.force[tree.row(1 + k)] = u[rotors + k]
    return ca.Function("accelerate", [made.q, made.v, u], [forward_dynamics(made)])


@dataclass
class Contender:
    """One that flies: where it is, and how it went."""

    inputs: Callable[[float, Array], Array]
    x: Array
    seconds: list[float] = field(default_factory=list)
    missed: list[float] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    lost: str = ""
    clock: Callable[[], float] = time.process_time

    def fly(self, problem: Problem, now: float) -> None:
        """An instant and the step that follows."""
        module, nq, h = problem.module, problem.nq, problem.h / SUBSTEPS
        begin = self.clock()
        try:
            u = self.inputs(now, self.x)
        except ArithmeticError as error:
            self.lost = f"{error} at {now:.2f} s"
            return
        self.seconds.append(self.clock() - begin)
        q, v = self.x[:nq], self.x[nq:]
        for _ in range(SUBSTEPS):
            q, v = module.step_rk4(q, v, u, h)
        self.x = np.r_[q, v]
        off = problem.off(problem.references[1], self.x, u)
        self.missed.append(float(np.linalg.norm(off[:3])))
        self.costs.append(float(off @ problem.running @ off / 2))
        if not self.missed[-1] < TOP:
            self.lost = f"lost at {now:.2f} s"


def check(ours: Prediction, other: Prediction, problem: Problem) -> None:
    """See that both predict the same, and differentiate it alike."""
    rng = np.random.default_rng(3)
    x = np.r_[problem.hover.q, np.zeros(problem.nv)] + 0.1 * rng.standard_normal(
        problem.nq + problem.nv
    )
    u = problem.hover.u + rng.standard_normal(problem.nu)
    pairs = zip(ours.slopes(x, u), other.slopes(x, u), strict=True)
    for (one, its), most in zip(pairs, (1e-9, 1e-7, 1e-7), strict=True):
        assert np.abs(np.array(ca.densify(one - its))).max() < most


def contenders(name: str, folder: Path, interpreter: str) -> tuple[Problem, dict[str, Contender]]:
    """The problem of a robot, and those who solve it."""
    robot, (posture, radius, pace) = named_robot(name), ROBOTS[name]
    wanted = {*predictive.DERIVATIVES, *acados.DERIVATIVES, "step_rk4"}
    made = generate_robot(robot, robot_text(robot), folder, derivatives=sorted(wanted))[1]
    module, symbolic = load(made, backend="c"), load(made, backend="casadi")
    vehicle = Vehicle(module)
    actuators = module_actuators(vehicle)
    actuators = replace(actuators, lag=np.zeros_like(actuators.lag))
    hover = trim(module, posture, limits=actuators.thrusts)
    tip = "tip" if "tip" in module.FRAMES else module.FRAMES[-1]
    start = module.frame_poses(hover.q)[module.FRAMES.index(tip), :3, 3]

    def circle(times: Array) -> Array:
        s = np.clip(times, 0.0, 1.0)
        grown = radius * s**3 * (10 - 15 * s + 6 * s**2)
        turned = [np.cos(pace * times), np.sin(pace * times), 0.0 * times]
        return start + grown[..., None] * np.stack(turned, axis=-1)

    controller = Predictive(module, hover, {tip: circle}, actuators=actuators, method="trapezoidal")
    problem = Problem(controller)
    ours = exact(symbolic, problem)
    theirs = traced(symbolic, problem, recursion(robot, module, hover.q))
    check(ours, theirs, problem)
    nq = problem.nq
    found: dict[str, Callable[[float, Array], Array]] = {
        OURS: lambda now, x: controller.inputs(now, x[:nq], x[nq:])
    }
    for plugin in ("fatrop", "ipopt"):
        for functions, prediction in (("our functions", ours), ("articulated bodies", theirs)):
            solver = Solver(problem, prediction, plugin)
            found[f"{plugin}, {functions}"] = lambda _, x, solver=solver: solver(x)
    crocoddyls = BoxFDDP(problem)
    found["box-FDDP, our functions"] = lambda _, x: crocoddyls(x)
    x = np.r_[hover.q, hover.v]
    flying = {label: Contender(inputs, x) for label, inputs in found.items()}
    controller.inputs(0.0, hover.q, hover.v)  # So that there are references.
    for dynamics in ("our functions", "CasADi's derivatives"):
        try:
            solver = Acados(problem, interpreter, dynamics)
        except RuntimeError as error:
            print(f"acados, {dynamics}: left out, since {error}")
            continue
        flying[f"acados, {dynamics}"] = Contender(solver, x, clock=solver.clock)
    return problem, flying


def print_table(name: str, found: dict[str, Contender], console: Console) -> None:
    """Times, tracking and costs."""
    table = Table(title=f"{name}: ms per instant")
    for column in (
        "",
        "least",
        "median",
        "99 %",
        "worst",
        "times ours",
        "RMS after 2 s, mm",
        "cost",
    ):
        table.add_column(column, justify="right" if column else "left")
    # The first plan is made before the flight.
    ours = np.array(found[OURS].seconds[1:])
    for label, each in found.items():
        seconds = np.array(each.seconds[1:] or [np.nan])
        ratio = np.median(seconds / ours[: len(seconds)])
        settled = np.array(each.missed[round(SETTLED / 0.02) :])
        table.add_row(
            label,
            *(f"{1e3 * np.percentile(seconds, share):.2f}" for share in (0, 50, 99, 100)),
            f"{ratio:.1f}",
            each.lost or f"{1e3 * np.sqrt(np.mean(settled**2)):.3f}",
            f"{np.mean(each.costs):.4g}",
        )
    console.print(table)
    for label, each in found.items():
        if isinstance(each.inputs, Acados):
            own = 1e3 * np.median(each.inputs.own[1:])
            console.print(f"{label}: {own:.2f} by its own clock, without Python")


def draw(measured: dict[str, dict[str, Contender]], file: str) -> None:
    """Medians, and lines up to the 99 %, a panel a robot."""
    figure = Figure(figsize=(9.0, 2.8), layout="constrained")
    panels = figure.subplots(1, len(measured), sharey=True, squeeze=False)[0]
    for panel, (name, found) in zip(panels, measured.items(), strict=True):
        times = 1e3 * np.array([np.percentile(e.seconds[1:], (50, 99)) for e in found.values()])
        places = np.arange(len(times))
        colours = ["#0072b2" if label == OURS else "0.6" for label in found]
        panel.barh(places, times[:, 0], color=colours)
        panel.hlines(places, times[:, 0], times[:, 1], color="0.2", linewidth=1)
        for place, (median, worst) in zip(places, times, strict=True):
            panel.text(worst + 0.2, place, f"{median:.2g}", va="center", fontsize=9)
        panel.set_yticks(places, list(found))
        panel.set(title=name, xlabel="ms per instant: median, line to 99 %")
        panel.set_xlim(0.0, 1.15 * times.max())
        panel.invert_yaxis() if panel is panels[0] else None
    figure.savefig(file, dpi=150)


def main() -> None:
    """Build, check, fly, print; draw if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument("--duration", type=float, default=8.0, help="of a flight, s, above 2")
    parser.add_argument("--acados", default=sys.executable, metavar="PYTHON")
    parser.add_argument("--picture", metavar="FILE")
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    measured = {}
    for name in options.robots:
        with tempfile.TemporaryDirectory() as folder:
            problem, found = contenders(name, Path(folder), options.acados)
            for k in range(round(options.duration / problem.h)):
                for each in found.values():
                    if not each.lost:
                        each.fly(problem, k * problem.h)
        load_average = ", ".join(f"{each:.1f}" for each in os.getloadavg())
        console.print(f"{machine()}; load {load_average}; CasADi {ca.__version__}")
        print_table(name, found, console)
        measured[name] = found
    if options.picture:
        draw(measured, options.picture)


if __name__ == "__main__":
    main()
