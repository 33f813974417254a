"""Times of model predictive control, in one run: `python benchmarks/nmpc_times.py`.

The controller of `examples.nmpc` flies the same circle with the same solver and
tolerances, and gets the time step, the tip's position and their derivatives from

- C that CasADi generates of the emitted functions and of their exact derivatives,
- CasADi's SX of the emitted code, as `load(…, backend="casadi")` gives it,
- CasADi's SX of articulated bodies, the best public recursion, which CasADi differentiates: run by
  its virtual machine, as `nlpsol` does by default, and as generated C, compiled like ours,
- the same C of the emitted functions, differentiated by central differences.

Peers have no dampers, so those of the joints are left out; the position is that of the base's
centre. The steps and points of all must agree to 1e-9, and their Jacobians to 1e-6. At each step of
the control all of them solve the same problem from the same guess, one after the other, so that a
busy machine slows all of them; the robot then moves by one step of the prediction.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import casadi as ca
import numpy as np
from rich.console import Console
from rich.table import Table

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from c_times import machine  # noqa: E402
from family import benchmark_robot, named_robot  # noqa: E402
from peers.casadi_articulated import forward_dynamics  # noqa: E402
from peers.casadi_bases import MovingBase  # noqa: E402
from peers.casadi_recursions import Machine  # noqa: E402
from peers.casadi_spatial import Scalar, Vector  # noqa: E402
from peers.tree import tree_of  # noqa: E402

from examples.controller import Controller  # noqa: E402
from examples.nmpc import STEP  # noqa: E402
from examples.task import Circle, Task, circle_task, module_of  # noqa: E402
from examples.tracking_problem import (  # noqa: E402
    DERIVATIVES,
    Prediction,
    compiled,
    in_c,
    traced,
)
from gibbs_codegen.robot.model import Robot  # noqa: E402
from gibbs_codegen.runtime.load import load  # noqa: E402

ROBOTS = {
    "n = 3": (
        benchmark_robot(3),
        Circle(posture={"theta_8": -1.871, "theta_9": 1.39}, radius=0.5, thrust=(-38.0, 38.0)),
    ),
    "hextilt_flying_arm_5": (named_robot("hextilt_flying_arm_5"), Circle()),
}
EXACT, OURS_TRACED = "exact derivatives as generated C", "SX of the emitted code"
RECURSION, GENERATED = "SX of articulated bodies", "the same as generated C"
DIFFERENCES = "the same C, finite differences"


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


def recursion(robot: Robot, plant: ModuleType, symbolic: ModuleType, task: Task) -> Prediction:
    """CasADi's own tracing of articulated bodies; integration and kinematics are the module's."""
    tree = tree_of(robot)
    made, rotors = Machine(tree), len(plant.INPUTS) - tree.joints
    u = ca.SX.sym("u", len(plant.INPUTS))
    # Torque and force in the base's axes, as the rows of the input matrix have them where it is
    # level.
    rows = list(made.base.rows)
    of_base = plant.input_matrix(task.q)[rows, :rotors]
    if tree.quaternion:
        of_base = np.roll(of_base, 3, axis=0)
    made.base = Thrusts(made.base, ca.DM(ca.sparsify(of_base)), u[:rotors])
    for k in range(tree.joints):
        made.force[tree.row(1 + k)] = u[rotors + k]
    accelerate = ca.Function("accelerate", [made.q, made.v, u], [forward_dynamics(made)])
    q, v = ca.SX.sym("q", made.q.shape[0]), made.v
    unit = ca.vertcat(q[:3], q[3:7] / ca.norm_2(q[3:7]), q[7:]) if tree.quaternion else q
    v_next = v + STEP * accelerate(unit, v, u)
    q_next = symbolic.integrate(unit, STEP * v_next)
    first = 4 * plant.FRAMES.index(task.frame)
    point = symbolic.frame_poses(unit)[first : first + 3, 3]
    return Prediction(_traced("step", [q, v, u], [q_next, v_next]), _traced("point", [q], [point]))


def _traced(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    """A function with its Jacobian, each without what is computed twice."""
    plain = ca.Function(name, inputs, ca.cse(outputs))
    unused = [ca.SX.sym(f"out{k}", ca.Sparsity(*o.shape)) for k, o in enumerate(outputs)]
    blocks = plain.jacobian().call([*inputs, *unused])
    jacobian = ca.Function(f"jac_{name}", [*inputs, *unused], ca.cse(blocks))
    return ca.Function(name, inputs, ca.cse(outputs), {"custom_jacobian": jacobian})


def differentiated(prediction: Prediction) -> Prediction:
    """The same functions with central differences in place of derivatives."""
    return Prediction(_with_differences(prediction.step), _with_differences(prediction.point))


def _with_differences(function: ca.Function, change: float = 1e-5) -> ca.Function:
    """A function whose Jacobian evaluates it twice for each entry of its inputs."""
    sizes = [function.size1_in(k) for k in range(function.n_in())]
    count, ends = sum(sizes), np.cumsum([0, *sizes])
    inputs = [ca.MX.sym(function.name_in(k), size) for k, size in enumerate(sizes)]
    changes = change * np.hstack([np.eye(count), -np.eye(count)])
    around = ca.vertsplit(ca.repmat(ca.vertcat(*inputs), 1, 2 * count) + changes, ends.tolist())
    blocks, unused = [], []
    for k, values in enumerate(function.map(2 * count).call(around)):
        slopes = (values[:, :count] - values[:, count:]) / (2 * change)
        blocks += ca.horzsplit(slopes, ends.tolist())
        unused.append(ca.MX.sym(f"out{k}", ca.Sparsity(*function.size_out(k))))
    jacobian = ca.Function(f"jac_{function.name()}", [*inputs, *unused], blocks)
    options = {"custom_jacobian": jacobian}
    return ca.Function(function.name(), inputs, function.call(inputs), options)


def dense(values: ca.DM) -> np.ndarray:
    """Values with their zeros."""
    return np.array(ca.densify(values))


def check(predictions: dict[str, Prediction], task: Task) -> None:
    """See that all of them predict the same, and differentiate it alike."""
    rng = np.random.default_rng(3)
    q, v = (x + 0.1 * rng.standard_normal(len(x)) for x in (task.q, task.v))
    u = task.weights.wanted[: task.limits.shape[1] - len(q) - len(v)] + rng.standard_normal()
    exact = predictions[EXACT]
    for name, other in predictions.items():
        for one, its, arguments in (
            (exact.step, other.step, [q, v, u]),
            (exact.point, other.point, [q]),
        ):
            for a, b in zip(one.call(arguments), its.call(arguments), strict=True):
                assert np.allclose(dense(a), dense(b), rtol=0, atol=1e-9), name
            nothing = [ca.DM(*one.size_out(k)) for k in range(one.n_out())]
            pairs = zip(
                one.jacobian().call([*arguments, *nothing]),
                its.jacobian().call([*arguments, *nothing]),
                strict=True,
            )
            for a, b in pairs:
                assert np.allclose(dense(a), dense(b), rtol=0, atol=1e-6), name


def controllers(
    robot: Robot, circle: Circle, folder: Path, plugin: str
) -> tuple[Task, dict[str, Controller]]:
    """A controller for each way to predict."""
    made = module_of(robot, folder, DERIVATIVES)
    fast, symbolic = load(made, backend="c"), load(made, backend="casadi")
    task = circle_task(fast, circle)
    predictions = {
        EXACT: compiled(symbolic, task.frame, STEP),
        OURS_TRACED: traced(symbolic, task.frame, STEP),
        RECURSION: recursion(robot, fast, symbolic, task),
        DIFFERENCES: differentiated(compiled(symbolic, task.frame, STEP)),
    }
    predictions[GENERATED] = in_c(predictions[RECURSION], fast)
    check(predictions, task)
    return task, {name: Controller(p, task, STEP, plugin=plugin) for name, p in predictions.items()}


def fly(task: Task, found: dict[str, Controller], steps: int) -> None:
    """Let all controllers choose inputs, and take those of the first."""
    q, v, exact = task.q, task.v, found[EXACT]
    for k in range(steps):
        u, *_ = [controller.inputs(k * STEP, q, v) for controller in found.values()]
        q, v = (np.array(x).ravel() for x in exact.prediction.step(q, v, u))


def print_table(name: str, found: dict[str, Controller], console: Console) -> None:
    """Times of each controller."""
    table = Table(title=f"{name}: ms per control step")
    for column in (
        "step and point from",
        "solve, median",
        "worst",
        "iterations",
        "in functions, median",
        "times ours [10-90 %]",
    ):
        table.add_column(column, justify="left" if column.startswith("step") else "right")
    ours = np.array([s.in_functions for s in found[EXACT].solutions])
    for called, controller in found.items():
        whole, within, iterations = np.array(
            [(s.seconds, s.in_functions, s.iterations) for s in controller.solutions]
        ).T
        low, middle, high = np.percentile(within / ours, (10, 50, 90))
        table.add_row(
            called,
            f"{1e3 * np.median(whole):.2f}",
            f"{1e3 * whole.max():.2f}",
            f"{np.median(iterations):.0f}, at most {iterations.max():.0f}",
            f"{1e3 * np.median(within):.3f}",
            f"{middle:.1f} [{low:.1f}-{high:.1f}]",
        )
    console.print(table)


def main() -> None:
    """Build, check, fly, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument("--solver", choices=("fatrop", "ipopt"), default="fatrop")
    parser.add_argument("--steps", type=int, default=200)
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    console.print(f"{machine()}; CasADi {ca.__version__}, {options.solver}")
    for name in options.robots:
        with tempfile.TemporaryDirectory() as folder:
            with console.status(f"{name}: building and checking"):
                task, found = controllers(*ROBOTS[name], Path(folder), options.solver)
            with console.status(f"{name}: flying"):
                fly(task, found, options.steps)
            print_table(name, found, console)


if __name__ == "__main__":
    main()
