"""Thousands of robots against the oracle: `python tests/soak.py --robots 2000 --seed 7`.

Robots are drawn by number. Odd ones are trees: arms that branch, rotors and frames anywhere, held
and welded links, passive joints, half of them with a quaternion. Every other tree stands on a base
that moves in any way, and has springs and gears, or constraints, or all of them, or rolls on
wheels; `--bases` draws these alone, every fiftieth with all functions and derivatives. The others
have one arm and N = 2 … 12, n = 0 … 8, every other one degenerate. Each is derived, emitted for
NumPy (some for C too), and evaluated on a few states, all functions against Pinocchio; or it is
refused, and then the oracle's null space must be the motions that the message names. No tree is
degenerate.
A failure is printed with the command that repeats it. Exits 1 where there was one.
"""

from __future__ import annotations

import argparse
import itertools
import os
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from support.comparison import OF_TERMS, errors, of_rounding
from support.comparison import compare as compare_with_oracle
from support.constrained import constrained_robot, random_constraint
from support.degenerate_robots import degenerate_robot
from support.null_space import SMALLEST, short_names, smallest_eigenvalue, unresisted
from support.random_robots import (
    motored_robot,
    on_base,
    random_motion,
    random_robot,
    random_tree,
    rolling_robot,
)

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.errors import RobotFileError, SingularRobotError
from gibbs_codegen.interface.table import GROUPS
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import FREE
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load
from gibbs_codegen.targets.registry import find_targets, render_module
from gibbs_codegen.verification.comparison import Results, failure_text
from gibbs_codegen.verification.derivatives import OTHER_FUNCTIONS
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.pinocchio_tree import Pinocchio
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import compare_module

STATES = 3
# What derivatives may be off complex steps by.
STEPS = 1e-10
# Compiling the whole of a module takes longer than all the rest.
COMPILER = "cc -O0"


class DisagreementError(Exception):
    """A robot whose functions, or whose refusal, the oracle does not agree with."""


@dataclass
class Tally:
    """What became of the robots so far; the worst error of each function, and whose it was."""

    outcomes: Counter[str] = field(default_factory=Counter)
    worst: dict[str, tuple[float, int]] = field(default_factory=dict)

    def note(self, number: int, outcome: str, found: dict[str, float]) -> None:
        """Count a robot."""
        self.outcomes[outcome] += 1
        for name, error in found.items():
            self.worst[name] = max(self.worst.get(name, (0.0, number)), (error, number))


def soak_robot(seed: int, number: int) -> Robot:
    """The robot of a number: odd ones are trees, and every other one of the rest is degenerate."""
    rng = np.random.default_rng((seed, number))
    own, rotors = int(rng.integers(2**32)), int(rng.integers(2, 13))
    # Of few links more often, since they take less time and have as many ways to be degenerate.
    links = int(rng.integers(9, size=2).min())
    if is_based(number):
        return next(robot for robot in _based(rng, own) if _is_read(robot))
    if number % 2:
        return random_tree(own)
    make = degenerate_robot if number % 4 else random_robot
    return make(own, rotors, links)


def _based(rng: np.random.Generator, own: int) -> Iterator[Robot]:
    """Robots on bases of all kinds, whose first has the seed `own`."""
    for seed in itertools.count(own):
        if rng.random() < 0.2:
            yield rolling_robot(seed)
            continue
        robot = motored_robot(seed) if rng.random() < 0.5 else constrained_robot(seed)
        motion = random_motion(rng)
        robot = robot if motion == FREE else on_base(robot, motion, seed)
        if not robot.constraints and rng.random() >= 0.5:
            robot = replace(robot, constraints=(random_constraint(rng, robot, "hold"),))
        yield robot


def _is_read(robot: Robot) -> bool:
    """Whether a file may say a robot: something of it moves, and no constraint holds one body."""
    try:
        parse_robot(robot_text(robot))
    except RobotFileError:
        return False
    return True


def is_based(number: int) -> bool:
    """Whether the robot of a number is one of those with bases of all kinds."""
    return number % 4 == 3


def is_whole(number: int) -> bool:
    """Whether such a robot has all functions and derivatives, and is verified as all others are."""
    return number // 4 % 50 == 0


def compare(
    robot: Robot, module: ModuleType, number: int, numpy: ModuleType | None = None
) -> dict[str, float]:
    """Errors of a module's functions in units of what is allowed: what the soak compares with.

    Against the oracle, and as `gibbs-codegen generate` verifies a module before it is written;
    `numpy` is its NumPy back end, if it is another.
    """
    tree = Tree(robot)
    newton_euler, found = formulated(NewtonEuler(tree)), {}
    if is_based(number):
        at = States.random(tree, STATES, number)
        by_pinocchio = Expected(formulated(Pinocchio(tree)), at).compare(Results(module).all(at))
        every = [*errors(module, newton_euler, STATES, number).items()]
        for name, error in [*every, *((c.what, c.error) for c in by_pinocchio)]:
            found[name] = max(found.get(name, 0.0), error / OF_TERMS)
        if not is_whole(number):
            return found
    elif number % 2:
        compare_with_oracle(robot, module, STATES)
    else:
        found = of_rounding(robot, module, STATES, number)
    verified = compare_module(module, robot, [newton_euler], STATES, number, numpy=numpy)
    if not all(c.passed for c in verified):
        wrong = [failure_text(c) for c in verified if not c.passed]
        raise DisagreementError(f"is not verified: {'; '.join(wrong)}")
    shares = [c.error / c.limit for c in verified if c.limit]
    steps = [c.error / STEPS for c in verified if c.against.startswith(OTHER_FUNCTIONS)]
    return found | {"verification": max(shares), "derivatives": max(steps, default=0.0)}


def check(robot: Robot, number: int, compiled: bool) -> tuple[str, dict[str, float]]:
    """Derive, emit, load and compare one robot: what became of it, and its errors.

    Raises `DisagreementError`, or whatever goes wrong.
    """
    try:
        whole = is_based(number) and is_whole(number)
        if is_based(number) and parse_robot(robot_text(robot)) != robot:
            raise DisagreementError("is another robot when it is written and read")
        groups = ("default", *(GROUPS if whole else ["constraints"] if robot.constraints else []))
        model = derive(robot, functions=groups, derivatives=whole)
    except SingularRobotError as error:
        if number % 2:
            raise DisagreementError(f"is refused, and no tree is singular: {error}") from None
        return _refused(robot, error), {}
    if number % 2 == 0 and smallest_eigenvalue(robot)[0] < SMALLEST:
        raise DisagreementError(f"is singular and was not refused: {unresisted(robot)}")
    targets = find_targets() if compiled else find_targets(["numpy"])
    with _emitted(render_module(model, "", targets), number) as folder:
        numpy = load(folder)
        found = compare(robot, numpy, number)
        if compiled:
            module = load(folder, backend="c")
            if not str(module.__file__).endswith(".so"):
                raise DisagreementError("did not compile")
            found |= {f"{k} (C)": e for k, e in compare(robot, module, number, numpy).items()}
    if wrong := {name: error for name, error in found.items() if not error <= 1.0}:
        raise DisagreementError(", ".join(f"{name}: {error:.3g}" for name, error in wrong.items()))
    return "compiled" if compiled else "compared", found


def _refused(robot: Robot, error: SingularRobotError) -> str:
    """Check that a refusal is right, and names what it should."""
    if error.ill_conditioned:
        if smallest_eigenvalue(robot)[0] < SMALLEST:
            raise DisagreementError(f"is singular, not but for rounding: {error}")
        return "refused for rounding"
    theirs, named = unresisted(robot), short_names(error.joints)
    if theirs != named:
        raise DisagreementError(f"refused for {named}, where the oracle has {theirs}")
    return "refused as singular"


@contextmanager
def _emitted(files: dict[str, str], number: int) -> Iterator[Path]:
    """The module in a folder of its own, which is forgotten afterwards."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / f"robot_{number}"
        folder.mkdir()
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        before = set(sys.modules)
        try:
            yield folder
        finally:
            for name in set(sys.modules) - before:
                if name.startswith("_gibbs_codegen_"):
                    del sys.modules[name]


def soak(arguments: argparse.Namespace, console: Console) -> bool:
    """Run the robots until time is up or Ctrl-C; whether all were as they should be."""
    end = time.monotonic() + 60 * arguments.minutes
    numbers = range(arguments.robots) if arguments.only is None else [arguments.only]
    if arguments.bases:
        numbers = range(3, 4 * arguments.robots, 4)
    tally, failures = Tally(), 0
    columns = (TextColumn("{task.fields[state]}"), BarColumn(), MofNCompleteColumn())
    with (
        suppress(KeyboardInterrupt),
        Progress(
            *columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal
        ) as progress,
    ):
        task = progress.add_task("", total=len(numbers), state="robots")
        for number in numbers:
            if time.monotonic() > end:
                break
            compiled = arguments.only is not None or (number + 1) % arguments.compile_every == 0
            robot = soak_robot(arguments.seed, number)
            if arguments.only is not None:
                console.print(robot)
            try:
                tally.note(number, *check(robot, number, compiled))
            except Exception as error:
                failures += 1
                _complain(arguments, number, error, console)
            state = f"{failures} failed" if failures else "robots"
            progress.update(task, advance=1, state=state)
    _report(tally, failures, console)
    return failures == 0


def _complain(
    arguments: argparse.Namespace, number: int, error: Exception, console: Console
) -> None:
    """Say what failed and how to repeat it; then where, unless it is only numbers."""
    text = (
        f"robot {number}: {type(error).__name__}: {error}\n"
        f"    python tests/soak.py --seed {arguments.seed} --only {number}"
    )
    console.print(text, soft_wrap=True, markup=False, highlight=False)
    if arguments.only is not None and not isinstance(error, DisagreementError):
        traceback.print_exception(error)


def _report(tally: Tally, failures: int, console: Console) -> None:
    counts = [f"{count} {outcome}" for outcome, count in sorted(tally.outcomes.items())]
    console.print(", ".join([*counts, f"{failures} failed"]), soft_wrap=True, highlight=False)
    if tally.worst:
        console.print("worst errors, in units of what is allowed:", highlight=False)
    for name, (error, number) in sorted(tally.worst.items()):
        console.print(f"    {name:<20} {error:8.2g}   robot {number}", highlight=False)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Random and degenerate robots against Pinocchio.")
    parser.add_argument("--robots", type=int, default=2000, help="how many; default 2000")
    parser.add_argument("--seed", type=int, help="of all robots; default: a new one")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--bases", action="store_true", help="bases of all kinds alone")
    parser.add_argument("--only", type=int, metavar="NUMBER", help="one robot, shown, and in C too")
    parser.add_argument(
        "--compile-every", type=int, default=25, metavar="K", help="C too for each k-th; default 25"
    )
    arguments = parser.parse_args()
    if arguments.seed is None:
        arguments.seed = int(np.random.default_rng().integers(10**6))
    return arguments


def main() -> int:
    """Run the command; 1 where a robot failed."""
    arguments = _arguments()
    console = Console()
    console.print(f"seed {arguments.seed}", highlight=False)
    warnings.simplefilter("error")
    if shutil.which("cc") is None:
        console.print("no C compiler: NumPy only")
        arguments.compile_every = sys.maxsize
    with tempfile.TemporaryDirectory() as cache:
        os.environ["GIBBS_CODEGEN_CACHE"] = str(Path(cache) / "compiled")
        os.environ["CC"] = COMPILER
        return 0 if soak(arguments, console) else 1


if __name__ == "__main__":
    sys.exit(main())
