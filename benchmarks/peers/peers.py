"""All peers of the C target, built, checked and timed: `python benchmarks/peers/peers.py`.

Absolute times do not carry to other machines; ratios within one run do.
"""

from __future__ import annotations

import ctypes
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

BENCHMARKS = Path(__file__).parent.parent
sys.path[:0] = [str(BENCHMARKS), str(BENCHMARKS.parent), str(BENCHMARKS.parent / "tests")]

from family import benchmark_robot  # noqa: E402
from peers.casadi_peer import casadi_contenders, functions, operations  # noqa: E402
from peers.contender import (  # noqa: E402
    MASS_MATRIX_AND_RESIDUAL,
    TASKS,
    Array,
    Contender,
    Results,
    States,
    packed,
    results,
)
from peers.mujoco_peer import mujoco_contenders  # noqa: E402
from peers.pinocchio_peer import pinocchio_contenders  # noqa: E402
from peers.timing import Timer, timer  # noqa: E402
from peers.tree import tree_of  # noqa: E402
from support.pinocchio_oracle import Oracle  # noqa: E402

from gibbs_codegen.robot.model import Robot  # noqa: E402

LINKS = (3, 7, 30)
STATES = 1024
CHECKED_STATES = 32
TOLERANCE = 1e-9
REPEATS = 50
NANOSECONDS_PER_REPEAT = 2e6


def contenders(robot: Robot, folder: Path) -> list[Contender]:
    """Every peer for one robot, built in `folder`; libraries there that serve every robot stay."""
    own = folder / robot.name
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir()
    tree = tree_of(robot)
    mujoco = [] if tree.root == "quaternion" else mujoco_contenders(tree, own)
    return [*pinocchio_contenders(tree, own), *mujoco, *casadi_contenders(tree, own)]


def random_states(robot: Robot, count: int, seed: int = 0) -> States:
    """Random (q, v, τ), angles all round but for the middle one of the attitude, within ±1.2.

    The forces τ are those of random inputs, so that every robot can have them.
    """
    rng, oracle = np.random.default_rng(seed), Oracle(robot, rigid_base=True)
    q = rng.uniform(-3, 3, (count, len(oracle.layout.q.names)))
    v = rng.uniform(-3, 3, (count, len(oracle.layout.v.names)))
    u = rng.uniform(-3, 3, (count, robot.rotors + len(robot.moving)))
    if oracle.layout.is_quaternion:
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    elif oracle.layout.moves_freely:
        q[:, 1] *= 0.4
    matrices = np.array([oracle.input_matrix(state) for state in q])
    return q, v, (matrices @ u[..., None])[..., 0]


def reference(robot: Robot, task: str, states: States) -> Results:
    """What Pinocchio's Python module gives for a task."""
    oracle = Oracle(robot, rigid_base=True)
    still = np.zeros(states[1].shape[1])
    matrices = np.array([oracle.mass_matrix(q) for q in states[0]])
    effects = [oracle.inverse_dynamics(q, v, still) for q, v, _ in zip(*states, strict=True)]
    residuals = -np.array(effects)
    if task == MASS_MATRIX_AND_RESIDUAL:
        return matrices, residuals
    return (np.linalg.solve(matrices, (states[2] + residuals)[..., None])[..., 0],)


def check(contender: Contender, robot: Robot) -> float:
    """Largest error against the oracle, over each state's largest entry; raises above 1e-9."""
    states = random_states(robot, CHECKED_STATES, seed=1)
    return agreement(contender, robot, states, reference(robot, contender.task, states))


def agreement(contender: Contender, robot: Robot, states: States, right: Results) -> float:
    """Largest error against what is right, over each state's largest entry; raises above 1e-9."""
    pairs = zip(results(contender, states), right, strict=True)
    worst = float(np.max([_error(found, expected) for found, expected in pairs]))
    if not worst < TOLERANCE:
        raise AssertionError(f"{contender.name}, {contender.task}, {robot.name}: off by {worst}")
    return worst


def _error(found: Array, right: Array) -> Array:
    within = tuple(range(1, right.ndim))
    return np.max(np.abs(found - right).max(axis=within) / np.abs(right).max(axis=within))


def nanoseconds(time_calls: Timer, contender: Contender, states: States) -> float:
    """Least time per state of many repeats, each at least once round the states."""
    blocks = [packed(rows, contender.width) for rows in contender.inputs(states)]
    first, second = contender.memory(states[1].shape[1])
    given = [number for block in blocks for number in (block.ctypes.data, block[0].size)]
    pointer = ctypes.cast(contender.function, ctypes.c_void_p)

    def mean(calls: int) -> float:
        return time_calls(
            pointer, calls, len(blocks[0]), *given, first.ctypes.data, second.ctypes.data
        )

    around = len(blocks[0])
    calls = max(around, round(NANOSECONDS_PER_REPEAT / mean(around)))
    return min(mean(calls) for _ in range(REPEATS)) / contender.width


def main() -> None:
    """Print nanoseconds per state of every peer, after checking it, and CasADi's operations."""
    cells: dict[tuple[str, str], list[str]] = {}
    with tempfile.TemporaryDirectory() as name:
        time_calls = timer(Path(name))
        for links in LINKS:
            robot = benchmark_robot(links)
            states = random_states(robot, STATES)
            for contender in contenders(robot, Path(name)):
                check(contender, robot)
                time = nanoseconds(time_calls, contender, states)
                cells.setdefault((contender.task, contender.name), []).append(f"{time:.1f}")
            for task, function in functions(tree_of(robot)).items():
                count = str(operations(function))
                cells.setdefault((task, "operations of the CasADi C"), []).append(count)
    for task in TASKS:
        table = Table(title=f"{task.capitalize()}, ns per state")
        table.add_column("who")
        for links in LINKS:
            table.add_column(f"n = {links}", justify="right")
        for (found, who), row in cells.items():
            if found == task:
                table.add_row(who, *row)
        Console(width=100).print(table)


if __name__ == "__main__":
    main()
