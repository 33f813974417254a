"""Every function of a module against Pinocchio, or any other formulation, and arrays by norm.

The comparator is that of `gibbs-codegen verify`. It and the oracles share no code with the
derivation.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from gibbs_codegen.interface.table import DERIVATIVE_GROUPS, FUNCTIONS
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import Results
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import Formulation, formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from support.pinocchio_oracle import InPinocchio, Oracle

# Of the norm of an array, and of the terms that an entry is summed from; what rounding leaves.
TOLERANCE, OF_TERMS, ROUNDING = 1e-10, 1e-12, 1e-13
# Functions that no formulation may leave out where a module has them.
# The last group is compared with other functions, as derivatives are.
OTHERS = (*DERIVATIVE_GROUPS, "passivity")
EVERY = {name for name, row in FUNCTIONS.items() if row.group not in OTHERS}


def assert_close(
    name: str, ours: np.ndarray, theirs: np.ndarray, tolerance: float = TOLERANCE
) -> None:
    """Agreement relative to the norm of the oracle's array; what is zero is zero to rounding."""
    assert np.shape(ours) == np.shape(theirs), f"{name}: {np.shape(ours)}, not {np.shape(theirs)}"
    size = float(np.linalg.norm(theirs))
    error = float(np.linalg.norm(np.asarray(ours) - theirs))
    assert error <= tolerance * size or error < 1e-14, f"{name}: {error / max(size, 1e-300):.2e}"


def states(robot: Robot, module: ModuleType, count: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Random q, v, a, u, `count` of each, away from the singularity of the attitude."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, len(module.COORDINATES)))
    layout = layout_of(robot)
    attitude = layout.q.attitude
    if layout.is_quaternion:
        q[:, attitude] /= np.linalg.norm(q[:, attitude], axis=1, keepdims=True)
    else:
        q[:, layout.middle_angle] = rng.uniform(-1.2, 1.2, count)
    v, a = rng.normal(size=(2, count, len(module.VELOCITIES)))
    return q, v, a, rng.normal(size=(count, len(module.INPUTS)))


def errors(
    module: ModuleType, formulation: Formulation, count: int, seed: int = 0
) -> dict[str, float]:
    """Largest error of each function over random states, relative to the terms of its entries."""
    at = States.random(formulation.tree, count, seed)
    compared = Expected(formulation, at).compare(Results(module).all(at))
    found = {c.what.split(".")[0] for c in compared}
    assert found >= EVERY & {*module.FUNCTIONS}, "not all functions were compared"
    return {c.what: c.error for c in compared}


def of_rounding(robot: Robot, module: ModuleType, count: int, seed: int = 0) -> dict[str, float]:
    """Errors against Newton and Euler's equations in units of `ROUNDING`, of degenerate robots too.

    That of the momentum about the centre of mass is a share of much larger ones about the origin.
    """
    found = errors(module, formulated(NewtonEuler(Tree(robot))), count, seed)
    return {
        name: error / ROUNDING for name, error in found.items() if name != "centroidal_momentum"
    }


def compare(robot: Robot, module: ModuleType, count: int = 2) -> None:
    """All functions of the module, evaluated as a batch, against Pinocchio."""
    oracle = Oracle(robot)
    for name, error in errors(module, InPinocchio(oracle, Tree(robot)), count).items():
        assert error <= OF_TERMS, f"{name}: {error:.2e}"
    q, v, _, _ = states(robot, module, count)
    for here, rate, there in zip(q, v, q[::-1], strict=True):
        assert_close(
            "rates", module.coordinate_rates(here, rate), oracle.coordinate_rates(here, rate)
        )
        assert_close("integrated", module.integrate(here, rate), oracle.integrated(here, rate))
        assert_close("difference", module.difference(here, there), oracle.difference(here, there))
