"""Time fixed-step flights beside MuJoCo's in one run: `python benchmarks/flight_times.py`.

Steps of 1 ms by Runge and Kutta's classical method, on one core: the simulator's compiled loop, and
MuJoCo's `mj_step` called in a loop in C, with contacts and constraints disabled, on the same model
and coordinates. Without control both do the same work, but for the power of the inputs and the
watch over the flight, which only the simulator has; both must agree to 1e-9 over 200 steps before
any is timed. Computed torque adds, in each of the four stages of a step, the reference, the inverse
dynamics and the allocation of thrusts, which `mj_step` does nothing like. The machine of 3 links
flies the paper's scenario, the longer one its base motion, with the arm held hanging. At limits the
machine that ships hovers, and its rotors may give a little less than that takes: every allocation
is a search for the nearest wrench.

Rounds go through all flights in turn, so that a slow moment of the machine hits all alike; what is
reported is the median over the rounds, of times and of ratios, with 10th and 90th percentiles.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from c_times import machine, ratio_text  # noqa: E402
from family import benchmark_robot  # noqa: E402
from peers.mujoco_peer import model_text  # noqa: E402
from peers.timing import Timer, timer  # noqa: E402
from peers.tree import tree_of  # noqa: E402

from gibbs_codegen.derivation.derive import derive  # noqa: E402
from gibbs_codegen.flight.control.laws import Controller, Gains  # noqa: E402
from gibbs_codegen.flight.desired.trajectory import desired_motion  # noqa: E402
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop  # noqa: E402
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoop  # noqa: E402
from gibbs_codegen.flight.plant.actuators import Actuators  # noqa: E402
from gibbs_codegen.flight.plant.allocation import Allocation  # noqa: E402
from gibbs_codegen.flight.plant.vehicle import Vehicle  # noqa: E402
from gibbs_codegen.flight.reference import Reference  # noqa: E402
from gibbs_codegen.flight.scenario.file import read_scenario  # noqa: E402
from gibbs_codegen.flight.scenario.scenario import ArmTask, Scenario  # noqa: E402
from gibbs_codegen.robot.model import Robot  # noqa: E402
from gibbs_codegen.runtime.load import load  # noqa: E402
from gibbs_codegen.targets.registry import find_targets, render_module  # noqa: E402

SHIPPED = Path(__file__).parents[1] / "generated" / "hexarotor_3link"
STEP = 1e-3
SAMPLE_EVERY = 10
ROUNDS = 100
# Short of where the tumbling machines come to the singularity of their attitude angles.
FREE_STEPS = 2000
CHECKED_STEPS = 200
TOLERANCE = 1e-9

Array = np.ndarray
Measure = Callable[[], float]

FREE, CONTROLLED, PEER = "no control", "computed torque", "MuJoCo's mj_step, no control"
WITHIN, SATURATED = "computed torque, hovering", "computed torque, sinking at limits"
# Share of the thrusts of a hover that is missing at limits, and thrusts that matter to nobody, N.
_MISSING, _FAR = 0.02, 1e3


class Flight:
    """A flight of a module in the compiled loop, under one law, from the start of a reference."""

    def __init__(
        self,
        module: ModuleType,
        reference: Reference,
        law: str,
        steps: int,
        limits: Array | None = None,
    ) -> None:
        vehicle = Vehicle(module)
        gains = Gains.of(5.0, 1.0, len(vehicle.coordinates))
        allocation = Allocation(vehicle.thrust_wrenches(), limits)
        controller = Controller(vehicle, reference, allocation, gains, law)
        closed = ClosedLoop(vehicle, controller, Actuators.unlimited(vehicle))
        self.loop, self.steps = CompiledLoop(closed, np.inf), steps
        self.q, self.v, _ = reference(0.0)
        self.state = closed.start(self.q, self.v)

    def nanoseconds(self) -> float:
        """Time of a step, in one call that takes all."""
        begin = time.perf_counter_ns()
        taken, _, _ = self.loop(0.0, self.state, STEP, self.steps, SAMPLE_EVERY)
        passed = time.perf_counter_ns() - begin
        if taken != self.steps:
            raise RuntimeError(f"the flight ends after {taken} of {self.steps} steps")
        return passed / taken

    def states(self, steps: int) -> Array:
        """Coordinates and rates after each step, (steps, 2 nq)."""
        return self.loop(0.0, self.state, STEP, steps)[1][:, : 2 * len(self.q)]


class MuJoCoFlight:
    """The same machine in MuJoCo, from the same state, with nothing but gravity acting."""

    def __init__(self, robot: Robot, flight: Flight, time_calls: Timer) -> None:
        tree = tree_of(robot)
        self.model = mujoco.MjModel.from_xml_string(model_text(tree))
        self.model.opt.timestep = STEP
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        # Whatever a free fall does not need; some of it saves MuJoCo a little.
        self.model.opt.disableflags = ~mujoco.mjtDisableBit.mjDSBL_GRAVITY.value & (
            (1 << mujoco.mjtDisableBit.mjNDISABLE.value) - 1
        )
        self.data = mujoco.MjData(self.model)
        self.order = tree.layout.order
        self.start = flight.q[list(self.order)], flight.v[list(self.order)]
        self.time_calls = time_calls
        (binary,) = Path(mujoco.__file__).parent.glob("libmujoco.so*")
        self.mj_step = ctypes.cast(ctypes.CDLL(str(binary)).mj_step, ctypes.c_void_p)

    def reset(self) -> None:
        """Go back to the start."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = self.start

    def nanoseconds(self) -> float:
        """Time of a step, in a loop in C."""
        self.reset()
        # The timing loop passes five pointers on, of which `mj_step` takes the first two.
        model, data = self.model._address, self.data._address
        return self.time_calls(self.mj_step, FREE_STEPS, 1, model, 0, data, 0, 0, 0, 0, 0)

    def states(self, steps: int) -> Array:
        """Coordinates and rates after each step, (steps, 2 nq), in the project's order."""
        self.reset()
        back = np.argsort(self.order)
        states = []
        for _ in range(steps):
            mujoco.mj_step(self.model, self.data)
            states.append(np.concatenate([self.data.qpos[back], self.data.qvel[back]]))
        return np.array(states)


def emitted(robot: Robot, folder: Path) -> ModuleType:
    """The compiled module of a robot, emitted in `folder`."""
    package = folder / f"{robot.name}_module"
    package.mkdir()
    for file, text in render_module(derive(robot), "", find_targets()).items():
        (package / file).write_text(text, encoding="utf-8")
    return load(package, backend="c")


def check(flight: Flight, peer: MuJoCoFlight) -> float:
    """Largest deviation of the trajectories, over their largest entry; raises above 1e-9."""
    ours, theirs = flight.states(CHECKED_STEPS), peer.states(CHECKED_STEPS)
    worst = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
    moved = float(np.abs(theirs[-1] - theirs[0]).max())
    if not (worst < TOLERANCE and moved > 0.1):
        raise AssertionError(f"MuJoCo's trajectory is {worst} off, having moved by {moved}")
    return worst


def paper_scenario(links: int) -> Scenario:
    """The paper's scenario, without the path of the tip for arms of another length than its own."""
    scenario = read_scenario("paper")
    return scenario if links == 3 else replace(scenario, arm=ArmTask())


def flights(links: int, folder: Path, time_calls: Timer, console: Console) -> dict[str, Measure]:
    """What measures the flights of the benchmark's machine of `links` links."""
    robot = benchmark_robot(links)
    module, scenario = emitted(robot, folder), paper_scenario(links)
    reference = desired_motion(Vehicle(module), scenario)
    free = Flight(module, reference, "off", FREE_STEPS)
    peer = MuJoCoFlight(robot, free, time_calls)
    worst = check(free, peer)
    console.print(f"n = {links}: {CHECKED_STEPS} steps agree with MuJoCo's to {worst:.0e}")
    steps = int(scenario.duration / STEP)
    controlled = Flight(module, reference, "computed_torque", steps)
    return {
        CONTROLLED: controlled.nanoseconds,
        FREE: free.nanoseconds,
        PEER: peer.nanoseconds,
    }


def shipped_flight() -> Measure:
    """What measures the paper's flight of the machine that ships."""
    module, scenario = load(SHIPPED, backend="c"), paper_scenario(3)
    reference = desired_motion(Vehicle(module), scenario)
    steps = int(scenario.duration / STEP)
    return Flight(module, reference, "computed_torque", steps).nanoseconds


def flights_at_limits() -> dict[str, Measure]:
    """What measures the machine that ships, hovering with thrusts to spare and without."""
    module = load(SHIPPED, backend="c")
    vehicle = Vehicle(module)
    reference = desired_motion(vehicle, read_scenario("hover"))
    thrusts = Allocation(vehicle.thrust_wrenches()).thrusts(
        vehicle.base_wrench(reference(0.0)[0], vehicle.inverse_dynamics(*reference(0.0)))
    )
    most = {WITHIN: _FAR + 0.0 * thrusts, SATURATED: thrusts - _MISSING * np.abs(thrusts)}
    return {
        what: Flight(
            module, reference, "computed_torque", FREE_STEPS, np.array([0.0 * up - _FAR, up])
        ).nanoseconds
        for what, up in most.items()
    }


def print_table(found: dict[tuple[str, str], Array], console: Console) -> None:
    """Times of a step, how much faster than real time that is, and than MuJoCo."""
    table = Table(title=f"Steps of {STEP * 1e3:g} ms: median (10–90 %) of {ROUNDS} rounds")
    table.add_column("machine")
    table.add_column("flight")
    for column in ("ns per step", "× real time", "mj_step ÷ it"):
        table.add_column(column, justify="right")
    for (who, what), times in found.items():
        low, middle, high = np.percentile(STEP * 1e9 / times, (10, 50, 90))
        peer = found.get((who, PEER), times)
        compared = "" if peer is times else ratio_text(peer, times)
        real_time = f"{middle:.0f} ({low:.0f}–{high:.0f})"
        table.add_row(who, what, f"{np.median(times):.0f}", real_time, compared)
    console.print(table)


def main() -> None:
    """Build, check, time, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, nargs="+", default=[3, 7])
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as name:
        os.environ["GIBBS_CODEGEN_CACHE"] = str(Path(name) / "compiled")
        time_calls = timer(Path(name))
        measures = {("hexarotor_3link", CONTROLLED): shipped_flight()}
        for what, measure in flights_at_limits().items():
            measures["hexarotor_3link", what] = measure
        for links in options.links:
            for what, measure in flights(links, Path(name), time_calls, console).items():
                measures[f"n = {links}", what] = measure
        rounds = [{key: measure() for key, measure in measures.items()} for _ in range(ROUNDS)]
    console.print(f"{machine()}; MuJoCo {mujoco.__version__} as its wheel has it")
    found = {key: np.array([r[key] for r in rounds]) for key in measures}
    print_table(found, console)
    share = found["hexarotor_3link", SATURATED] / found["hexarotor_3link", WITHIN]
    console.print(f"At limits a step takes {np.median(share):.2f} times as long")


if __name__ == "__main__":
    main()
