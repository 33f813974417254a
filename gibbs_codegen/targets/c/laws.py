"""Laws beside the functions of a module in C: which suit a robot, and their files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibbs_codegen.arrays.c_file import c_files
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.machine.law_functions import law_functions
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.balance import carried_rotors, tried_postures, wrench_matrix
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.rotations import Array
from gibbs_codegen.robot.wrenches import directions
from gibbs_codegen.targets.c.calls import check_calls, model_functions
from gibbs_codegen.targets.printers import Lines

# Singular values below this share of the largest belong to directions that rotors cannot command.
_RANK = 1e-9
# Of the wrenches that rotors along one axis command: the force along it, and three moments.
_ALONG_ONE_AXIS = (4, 1)


def law_files(model: Model, header: Lines) -> dict[str, str]:
    """Header and source of a model's laws, by name; none if it has no laws.

    Raises `UsageError` where the rotors do not command what a law needs, where a law moves the tip
    and nothing is called so or moves it, or the model lacks functions that a law calls.
    """
    if not model.laws:
        return {}
    robot, points, frames = model.robot, model.description.points, model.description.frames
    for law in model.laws:
        _check(robot, law, frames)
    functions = model_functions(model)
    centre = points.index("O2" if "O2" in points else "base")
    # Without a tip no law moves it.
    tip = frames.index("tip") if "tip" in frames else 0
    made = law_functions(functions, model.laws, centre, tip, bool(carried_rotors(robot)))
    programs = (function.program for function in made)
    check_calls(model, programs, f"--laws: {' and '.join(model.laws)} needs")
    words = f"Laws of control of {robot.name}, which call its functions; compile them together."
    return c_files(functions, f"{robot.name}_laws", words, made, header)


def check_laws(laws: str | Sequence[str], targets: Sequence[str]) -> tuple[str, ...]:
    """Names of laws, each once, of one or several. Raises `UsageError` for one that is unknown, or
    without C.
    """
    laws = (laws,) if isinstance(laws, str) else laws
    for law in laws:
        if law not in LAWS:
            choices = ", ".join(LAWS)
            raise UsageError(f"--laws {printable(law)}: unknown; known laws: {choices}")
    if laws and "c" not in targets:
        raise UsageError("--laws: laws are written in C, beside the target c; add --target c")
    return tuple(law for law in LAWS if law in laws)


def _rank(matrix: Array) -> int:
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > _RANK * np.max(values)))


def _check(robot: Robot, law: str, frames: Sequence[str]) -> None:
    """Raise `UsageError` if rotors do not command what a law needs, or there is no tip to move."""
    if not robot.rotors:
        raise UsageError(
            f"--laws: {robot.name} has no rotors, which laws command; add rotors to the robot file"
        )
    # Where joints move rotors, they command most in some posture.
    postures = tried_postures(robot) if carried_rotors(robot) else [None]
    matrix = max((wrench_matrix(robot, joints) for joints in postures), key=_rank)
    rank, axes = _rank(matrix), _rank(matrix[:3])
    left = np.linalg.svd(matrix)[0]
    full, one_axis = rank == len(left), (rank, axes) == _ALONG_ONE_AXIS
    of_rotors = {name: row for name, row in LAWS.items() if (one_axis if row.leans else full)}
    joints = len(robot.moving)
    suiting = [
        name
        for name, row in of_rotors.items()
        if row.hindrance(joints, "the tip") is None and ("tip" in frames or not row.moves_frame)
    ]
    if law in suiting:
        return
    if law in of_rotors:
        lacks, remedy = LAWS[law].hindrance(joints, "the tip"), f"choose {' or '.join(suiting)}"
        if lacks is None:
            lacks = f"the law moves the frame tip, and the frames are {', '.join(frames)}"
            remedy = 'name the frame that it is to move "tip", as a [[frame]] in the robot file'
        raise UsageError(f"--laws {law}: {robot.name}: {lacks}; {remedy}")
    lacks = f"those of {robot.name} command all directions"
    if not full:
        lacks = (
            f"the rotors of {robot.name} cannot command {', '.join(directions(left[:, rank:]))} "
            "(in the base's frame, about the base centre)"
        )
    needed = "the base must be fully actuated"
    if LAWS[law].leans:
        needed = "the rotors must push along one axis and command three moments"
    remedy = f"choose {' or '.join(suiting)}" if suiting else "tilt some thrusts in the robot file"
    raise UsageError(f"--laws {law}: {needed}, but {lacks}; {remedy}")
