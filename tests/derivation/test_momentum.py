"""Momentum, its rate and passive inverse dynamics: by Pinocchio, Christoffel symbols and motion."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest
from properties.test_bases import TILTED, with_motion
from support.comparison import assert_close, states
from support.complex_step import along
from support.emitted import module_of
from support.pinocchio_oracle import Oracle
from support.random_robots import geared_robot, random_tree
from support.tree_cases import QUICK_TREES

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.nodes import count_operations
from gibbs_codegen.robot.model import Robot

Array = np.ndarray
FUNCTIONS = (
    *("momentum", "momentum_rate", "passive_inverse_dynamics", "reference_regressor"),
    *("base_parameters", "coordinate_rates", "mass_matrix", "residual", "input_matrix"),
    *("forward_dynamics", "inverse_dynamics"),
)
MOTIONS = ("fixed", "upright", ("y", "yaw", "roll"))
ROBOTS = [
    with_motion(21, "planar", TILTED)[0],
    *(
        pytest.param(robot, marks=pytest.mark.slow)
        for robot in (
            random_tree(*QUICK_TREES[0]),
            random_tree(*QUICK_TREES[1]),
            geared_robot(3),
            *(with_motion(21, motion, TILTED)[0] for motion in MOTIONS),
        )
    ),
]


def coriolis(module: ModuleType, q: Array, v: Array) -> Array:
    """C, column by column, of a robot without dampers."""
    none, units = np.zeros_like(v), np.eye(len(v))
    undamped = module.prepare({x: 0.0 for x in module.PARAMETERS if x.endswith("_damping")})
    still = module.passive_inverse_dynamics(q, v, none, none, undamped)
    return (module.passive_inverse_dynamics(q, v, units, none, undamped) - still).T


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda r: f"{r.name}-{r.base.attitude}")
def test_momentum_and_the_forces_of_passive_laws(robot: Robot) -> None:
    """M v gains what moves the robot; C is skew but for half of what M gains, and linear."""
    module, rng = module_of(derive(robot, functions=FUNCTIONS)), np.random.default_rng(1)
    for _ in range(3):
        q = rng.uniform(-1.0, 1.0, len(module.COORDINATES))
        if module.ATTITUDE == "quaternion":
            q[3:7] /= np.linalg.norm(q[3:7])
        v, v_r, a_r = rng.normal(size=(3, len(module.VELOCITIES)))
        u = rng.normal(size=len(module.INPUTS))
        matrix = module.mass_matrix(q)
        assert_close("p", module.momentum(q, v), matrix @ v)
        a = module.forward_dynamics(q, v, u)
        (gained,), *_ = along(module, "momentum", {"q": q, "v": v}, {"q": v[None], "v": a[None]})
        told = module.momentum_rate(q, v) + module.input_matrix(q) @ u
        assert_close("rate of p", told, gained)
        forces = module.passive_inverse_dynamics(q, v, v_r, a_r)
        assert_close(
            "of the motion itself",
            module.passive_inverse_dynamics(q, v, v, a_r),
            module.inverse_dynamics(q, v, a_r),
        )
        found, (rate,) = (
            coriolis(module, q, v),
            along(module, "mass_matrix", {"q": q}, {"q": v[None]})[0],
        )
        np.testing.assert_allclose(found + found.T, rate, rtol=0, atol=1e-12 * np.abs(rate).max())
        none = np.zeros_like(v)
        at_rest = module.passive_inverse_dynamics(q, none, v_r, a_r)
        assert_close("linear", forces, at_rest + found @ v_r)
        assert_close(
            "at rest", at_rest, module.inverse_dynamics(q, none, a_r) + _damped(module, q, v_r)
        )
        regressed = [
            module.reference_regressor(q, *motion) @ module.base_parameters()
            for motion in ((v, v_r, a_r), (v, none, none))
        ]
        bare = module.prepare({x: 0.0 for x in module.PARAMETERS if x.endswith("_armature")})
        inertial = module.mass_matrix(q, bare) @ a_r + found @ v_r
        assert_close("regressor", regressed[0] - regressed[1], inertial)


def _damped(module: ModuleType, q: Array, v: Array) -> Array:
    """Forces that dampers take at velocities."""
    undamped = module.prepare({x: 0.0 for x in module.PARAMETERS if x.endswith("_damping")})
    return module.residual(q, v, undamped) - module.residual(q, v)


@pytest.mark.slow
@pytest.mark.parametrize("attitude", ["tait_bryan", "quaternion"])
def test_passive_inverse_dynamics_has_the_matrix_of_pinocchio(attitude: str) -> None:
    """With attitude angles C is that of Christoffel's symbols, too."""
    robot = random_tree(6, attitude)
    model = derive(robot, functions=FUNCTIONS)
    module, oracle = module_of(model), Oracle(robot, rigid_base=True)
    for q, v, _, _ in zip(*states(robot, module, 3), strict=True):
        found = coriolis(module, q, v)
        theirs = pin.computeCoriolisMatrix(
            oracle.model, oracle.data, oracle.configuration(q), oracle.spread(v)
        )
        assert_close("C", found, theirs[np.ix_(oracle.order, oracle.order)])
        if attitude == "tait_bryan":
            by_q = along(module, "mass_matrix", {"q": q}, {"q": np.eye(len(v))})[0]
            symbols = by_q.transpose(1, 2, 0) + by_q.transpose(1, 0, 2) - by_q
            assert_close("Christoffel", found, 0.5 * symbols @ v)
    counts = (
        count_operations(model.program.function(name).nodes()).total for name in FUNCTIONS[:4]
    )
    reached = {"tait_bryan": (460, 590, 765, 1401), "quaternion": (406, 589, 717, 944)}[attitude]
    assert (*counts,) == reached
