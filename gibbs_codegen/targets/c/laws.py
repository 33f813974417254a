"""Laws beside the functions of a module in C: which suit a robot, and their files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from gibbs_codegen.arrays.c_file import CFunction, c_files
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.machine import filters, observers
from gibbs_codegen.machine.law_functions import law_functions
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.balance import (
    carried_rotors,
    tried_postures,
    wheel_wrenches,
    wrench_matrix,
)
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.wrenches import DIRECTIONS, directions, leans, rank
from gibbs_codegen.targets.c.calls import check_calls, model_functions
from gibbs_codegen.targets.printers import Lines

# What tells states instead of commanding inputs: functions on request that it calls, and its own.
TELLING: dict[str, tuple[tuple[str, ...], Callable[[Functions], list[CFunction]]]] = {
    "momentum_observer": (observers.CALLED, observers.observer_functions),
    "state_filter": (filters.CALLED, filters.filter_functions),
    "imu_filter": (filters.CALLED, partial(filters.filter_functions, leads="imu")),
}


def calls() -> dict[str, tuple[str, ...]]:
    """What --laws may name, and the functions on request that each calls."""
    of_laws = {law: row.calls for law, row in LAWS.items()}
    return of_laws | {name: called for name, (called, _) in TELLING.items()}


def law_files(model: Model, header: Lines) -> dict[str, str]:
    """Header and source of a model's laws, by name; none if it has no laws.

    Raises `UsageError` where the rotors do not command what a law needs, where a law moves the tip
    and nothing is called so or moves it, or the model lacks functions that a law calls.
    """
    if not model.laws:
        return {}
    robot, points, frames = model.robot, model.description.points, model.description.frames
    laws = [law for law in model.laws if law not in TELLING]
    for law in laws:
        _check(robot, law, frames)
    if "state_filter" in model.laws and robot.acts_on_wheels:
        raise UsageError(
            f"--laws state_filter: a spring or a rotor of {robot.name} turns with a wheel, and "
            "there are no derivatives by angles of wheels; move it to the base or a link in the "
            "robot file"
        )
    functions, made = model_functions(model), []
    if laws:
        centre = points.index("O2" if "O2" in points else "base")
        # Without a tip no law moves it.
        tip = frames.index("tip") if "tip" in frames else 0
        moves = bool(carried_rotors(robot)) or not functions.layout.carries_wrenches
        made += law_functions(functions, laws, centre, tip, moves)
    for name in (name for name in model.laws if name in TELLING):
        made += TELLING[name][1](functions)
    programs = (function.program for function in made)
    check_calls(model, programs, f"--laws: {' and '.join(model.laws)} needs")
    title = "Laws of control" if laws else "What tells states"
    words = f"{title} of {robot.name}, which call its functions; compile them together."
    return c_files(functions, f"{robot.name}_laws", words, made, header)


def check_laws(laws: str | Sequence[str], targets: Sequence[str]) -> tuple[str, ...]:
    """Names of laws, each once, of one or several. Raises `UsageError` for one that is unknown, or
    without C.
    """
    laws = (laws,) if isinstance(laws, str) else laws
    for law in laws:
        if law not in calls():
            choices = ", ".join(calls())
            raise UsageError(f"--laws {printable(law)}: unknown; known laws: {choices}")
    if laws and not {"c", "web"}.intersection(targets):
        raise UsageError("--laws: laws need the target c; add --target c")
    return tuple(law for law in calls() if law in laws)


def tracking_law(robot: Robot) -> str | None:
    """The law that leads a robot along a motion; None where its rotors and joints serve none."""
    if (0.0, 0.0) in Description(robot).constants["INPUT_LIMITS"].values():
        return None
    for law in (name for name, row in LAWS.items() if row.task == "tracking" and not row.calls):
        try:
            _check(robot, law, ())
        except UsageError:
            continue
        return law
    return None


def _check(robot: Robot, law: str, frames: Sequence[str]) -> None:
    """Raise `UsageError` if rotors do not command what a law needs, or there is no tip to move."""
    along, about = layout_of(robot).driven_axes
    rows = [*along, *(3 + axis for axis in about)]
    if rows and not robot.rotors and not robot.wheels:
        raise UsageError(
            f"--laws: laws command rotors, and {robot.name} has none; add rotors to the robot file"
        )
    rolls = robot.wheels or robot.base.drive
    if LAWS[law].calls and rolls:
        raise UsageError(
            f"--laws {law}: does not support wheels, which {robot.name} has; choose another"
        )
    # Where joints move rotors, they command most in some posture.
    postures = tried_postures(robot) if carried_rotors(robot) else [None]
    turn = np.kron(np.eye(2), robot.base.pose.matrix)[rows]
    matrices = [turn @ wrench_matrix(robot, x) for x in postures] if rows else [np.zeros((0, 0))]
    if robot.wheels:
        matrices = [np.hstack([matrix, turn @ wheel_wrenches(robot)]) for matrix in matrices]
    matrix = max(matrices, key=rank)
    forces, reached = matrix[: len(along)], rank(matrix)
    full, one_axis = reached == len(rows), (reached, rank(forces)) == (1 + len(about), 1)
    if one_axis:
        axis = np.zeros(3)
        axis[along] = forces[:, np.argmax(np.linalg.norm(forces, axis=0))]
        one_axis = not full and leans(axis / np.linalg.norm(axis), along, about)
    laws = {name: row for name, row in LAWS.items() if not (row.calls and rolls)}
    of_rotors = [name for name, row in laws.items() if (one_axis if row.leans else full)]
    hindrances = {name: LAWS[name].hindrance(len(robot.moving), "the tip") for name in of_rotors}
    unnamed = [name for name in of_rotors if LAWS[name].moves_frame and "tip" not in frames]
    suiting = [name for name in of_rotors if hindrances[name] is None and name not in unnamed]
    if law in suiting:
        return
    choice = f"choose {' or '.join(suiting)}"
    if law in of_rotors:
        lacks, remedy = hindrances[law], choice
        if lacks is None:
            lacks = f"the law moves the frame tip, and the frames are {', '.join(frames)}"
            remedy = 'add a [[frame]] named "tip" to the robot file'
        raise UsageError(f"--laws {law}: {robot.name}: {lacks}; {remedy}")
    lacks = f"those of {robot.name} command all directions" if robot.rotors else "there are none"
    if not full:
        left, names = np.linalg.svd(matrix)[0], [DIRECTIONS[row] for row in rows]
        missing = ", ".join(directions(left[:, reached:], names))
        lacks = (
            f"the rotors of {robot.name} cannot command {missing} (in the base's frame, about the "
            "base centre)"
        )
    needed = "the base must be fully actuated"
    if LAWS[law].leans:
        needed = "the rotors must push along one axis and command three moments"
    remedy = choice if suiting else "tilt some thrusts in the robot file"
    raise UsageError(f"--laws {law}: {needed}, but {lacks}; {remedy}")
