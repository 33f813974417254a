"""Is every acceleration determined, and can it be computed? Asked before anything is emitted."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import SingularRobotError, UsageError
from gibbs_codegen.program.nodes import Program
from gibbs_codegen.robot.coordinates import coordinate_text
from gibbs_codegen.robot.magnitude import size_fault
from gibbs_codegen.robot.massless_motions import undetermined_motions
from gibbs_codegen.robot.model import Robot

# Smallest eigenvalue of the mass matrix with a unit diagonal: rounding leaves up to 3e-16 of a
# singular one, while a 3 m rod of 1 µm thickness still has 9e-15.
_SMALLEST = 2e-15
# A regular machine may be singular at one configuration by accident; three are not.
_CONFIGURATIONS = 3


def refuse_undetermined(robot: Robot, defaults: Mapping[str, float]) -> None:
    """Refuse a robot with a motion that nothing resists, from its data alone.

    Raises `SingularRobotError`, naming all such motions, or `UsageError` for a parameter of a size
    that cannot be computed with.
    """
    for name, value in defaults.items():
        if fault := size_fault(value):
            raise UsageError(f"{robot.name}: {name} {fault}")
    if motions := undetermined_motions(robot):
        raise SingularRobotError(robot.name, motions)


def refuse_drowned(robot: Robot, mass_matrix: Program, defaults: Mapping[str, float]) -> None:
    """Refuse a robot whose mass matrix cannot be told from a singular one in double precision.

    `mass_matrix` is the program of that function. Raises `SingularRobotError`, naming the
    coordinate that most of the hidden motion is made of.
    """
    found = []
    size = len(mass_matrix.inputs["q"])
    for number in range(_CONFIGURATIONS):
        values = mass_matrix.evaluate("mass_matrix", defaults, {"q": _configuration(size, number)})
        least, coordinate = _least_resisted(np.array(values[0]).reshape(size, size))
        if least >= _SMALLEST:
            return
        found.append((least, coordinate))
    hidden = coordinate_text(robot, max(found)[1])
    raise SingularRobotError(robot.name, [(hidden,)], drowned=True)


def refuse_uncomputable(robot: Robot, program: Program, defaults: Mapping[str, float]) -> None:
    """Refuse a robot whose emitted functions could not compute with their own parameters.

    Raises `UsageError`, naming the parameters that are the furthest from 1.
    """
    still = [0.0] * len(program.inputs["q"])
    arguments = {
        "q": _configuration(len(still), 0),
        "v": still,
        "u": [0.0] * len(program.inputs["u"]),
    }
    try:
        values = [
            *program.prepared(defaults).values(),
            *program.evaluate("forward_dynamics", defaults, arguments)[0],
        ]
        good = all(map(math.isfinite, values))
    except (ZeroDivisionError, OverflowError):
        good = False
    if good:
        return
    sizes = {name: abs(math.log10(abs(value))) for name, value in defaults.items() if value}
    furthest = sorted(sizes, key=sizes.__getitem__, reverse=True)[:2]
    shown = " and ".join(f"{name} = {defaults[name]:g}" for name in furthest)
    raise UsageError(
        f"{robot.name}: its accelerations overflow, or are lost in rounding, with {shown}; "
        "bring masses and lengths nearer to each other"
    )


def _configuration(size: int, number: int) -> list[float]:
    return [0.3 + 0.7 * math.sin(1.7 * i + 0.9 * number) for i in range(size)]


def _least_resisted(matrix: NDArray[np.float64]) -> tuple[float, int]:
    """Smallest eigenvalue of a mass matrix with a unit diagonal; the coordinate it is most of."""
    diagonal = np.diag(matrix)
    if (diagonal <= 0).any():
        return 0.0, int(np.argmin(diagonal))
    unit = np.sqrt(diagonal)
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
    return float(eigenvalues[0]), int(np.argmax(np.abs(vectors[:, 0])))
