"""Is every acceleration determined? A numeric look at the mass matrix before it is emitted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gibbs_codegen.coordinates import coordinate_text
from gibbs_codegen.errors import SingularRobotError, UsageError
from gibbs_codegen.program import Program
from gibbs_codegen.robot import Robot

# Smallest eigenvalue of the mass matrix with a unit diagonal: rounding leaves up to 3e-16 of a
# singular one, while a 3 m rod of 1 µm thickness still has 9e-15.
_SMALLEST = 2e-15


def refuse_singular(robot: Robot, program: Program, defaults: Mapping[str, float]) -> None:
    """Evaluate the mass matrix at an arbitrary configuration and refuse a singular one.

    Raises `SingularRobotError`, naming the coordinate that most of the undetermined motion is made
    of, or `UsageError` where the numbers overflow.
    """
    names = program.inputs["q"]
    configuration = [0.3 + 0.7 * np.sin(1.7 * i) for i in range(len(names))]
    try:
        values = program.evaluate("mass_matrix", defaults, {"q": configuration})[0]
    except ZeroDivisionError:
        raise SingularRobotError(robot.name, "the machine") from None
    matrix = np.array(values).reshape(len(names), len(names))
    if not np.isfinite(matrix).all():
        raise UsageError(
            f"{robot.name}: masses or lengths are too large: the mass matrix overflows"
        )
    diagonal = np.diag(matrix)
    if (diagonal <= 0).any():
        raise SingularRobotError(robot.name, coordinate_text(robot, int(np.argmin(diagonal))))
    unit = np.sqrt(diagonal)
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
    if eigenvalues[0] < _SMALLEST:
        undetermined = int(np.argmax(np.abs(vectors[:, 0])))
        raise SingularRobotError(robot.name, coordinate_text(robot, undetermined))
