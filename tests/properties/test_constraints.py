"""Constraints against Pinocchio: dense formulas with its Jacobians, and its `constraintDynamics`.

Robots, constraints and states are random; constraints are redundant too, and active by turns.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest
from support.compiled import build, emit
from support.complex_step import derivative
from support.constrained import (
    FOUR_BAR,
    LIGHT_FINGER,
    Dense,
    constrained_robot,
    random_state,
)
from support.emitted import emitted_module, module_of
from support.pinocchio_oracle import Oracle, placed
from support.random_robots import random_tree
from support.tools import run

from gibbs_codegen import generate, load, rollout
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.interface.constraints import CONSTRAINT_DERIVATIVES
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.constraint import Constraint, ConstraintKind
from gibbs_codegen.robot.parts.pose import Pose

Array = np.ndarray
TOLERANCE = 1e-10
DERIVATIVES = tuple(row.name for row in CONSTRAINT_DERIVATIVES)
# Of constraints, and what tests of them need besides.
FEW = (
    *("constraints", "integrate", "residual", "input_matrix"),
    *("kinetic_energy", "potential_energy", "centroidal_momentum", "mass_matrix"),
)


def assert_alike(ours: Array, theirs: Array, size: float = 0.0) -> None:
    """Equal to a share of the largest entry, or of a size."""
    size = max(size, float(np.abs(theirs).max(initial=0.0)))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=TOLERANCE * (size or 1.0))


@pytest.mark.slow
# They have every kind, and errors that are brought back.
@pytest.mark.parametrize(("seed", "redundant"), [(9, True), (23, False), (35, False), (37, True)])
def test_all_functions_are_those_of_dense_formulas(seed: int, redundant: bool) -> None:
    robot = constrained_robot(seed, redundant)
    module, rng = emitted_module(robot, *FEW), np.random.default_rng(seed)
    count = len(robot.constraints)
    states = [random_state(robot, rng) for _ in range(3)]
    choices = np.array([np.ones(count), rng.integers(0, 2, count), np.zeros(count)], float)
    q, v, u = map(np.array, zip(*states, strict=True))
    rebounds = rng.uniform(0.0, 1.0, (3, count))
    # All states at once, each with its own choice.
    found = {
        "dynamics": module.constrained_forward_dynamics(q, v, u, choices),
        "impact": module.impact(q, v, choices, rebounds),
        "inertia": module.operational_inertia(q, choices),
        "projection": module.constraint_projection(q, choices),
    }
    for k, active in enumerate(choices):
        dense = Dense(robot, q[k], v[k])
        assert_alike(module.constraint_errors(q[k]), dense.errors)
        assert_alike(module.constraint_jacobian(q[k]), dense.jacobian)
        assert_alike(module.constraint_bias(q[k], v[k]), dense.bias, float(v[k] @ v[k]))
        for ours, theirs in zip(found["dynamics"], dense.dynamics(u[k], active), strict=True):
            assert_alike(ours[k], theirs)
        taken = (1.0 + rebounds[k, dense.owner]) * (dense.jacobian @ v[k])
        impulses, gain = dense.solved(taken, active)
        assert_alike(found["impact"][0][k], v[k] + gain, float(np.abs(v[k]).max()))
        assert_alike(found["impact"][1][k], impulses)
        rows = dense.active_rows(active)
        assert_alike(found["inertia"][k][np.ix_(rows, rows)], dense.inverse(active)[0])
        assert not np.delete(found["inertia"][k], rows, axis=0).any()
        assert_alike(found["projection"][k], dense.solved(dense.errors, active)[1])


@pytest.mark.slow
def test_derivatives_are_those_of_complex_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where constraints are redundant, and ask for what cannot be."""
    robot = constrained_robot(37, redundant=True)  # A plane and a loop, which are brought back.
    needed = "constraints", "mass_matrix", "coordinate_rates"
    model = derive(robot, functions=needed, derivatives=DERIVATIVES)
    module, rng = module_of(model), np.random.default_rng(1)
    source = sys.modules[module.mass_matrix.__module__]
    monkeypatch.setattr(source, "sign", lambda x: np.copysign(1.0, np.real(x)))
    q, v, u = random_state(robot, rng)
    active = np.ones(len(robot.constraints))
    # What unit forces do: where these hold a robot still, motions are small sums of great terms.
    pushed = np.abs(np.linalg.solve(module.mass_matrix(q), module.constraint_jacobian(q).T))
    for _ in range(2):
        arguments = {"q": q, "v": v, "u": u, "active": active}
        arguments["restitution"] = rng.uniform(0.0, 1.0, len(active))
        for name in DERIVATIVES:
            of, found = name.removesuffix("_derivatives"), []
            own = {x: arguments[x] for x in FUNCTIONS[of].arguments}
            for k in range(len(FUNCTIONS[of].outputs)):
                values = getattr(module, of)(*own.values())
                found.append(values[k] if isinstance(values, tuple) else values)
                found += [derivative(module, of, own, x)[k] for x in own if x in "quv"]
            ours = getattr(module, name)(*own.values())
            half = len(found) // len(FUNCTIONS[of].outputs)
            for k, (mine, theirs) in enumerate(zip(ours, found, strict=True)):
                size = max(1.0, np.abs(theirs).max(initial=0.0))
                if k + half < len(found):
                    size = max(size, (pushed @ np.abs(found[k + half])).max(initial=0.0))
                np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * size)
        active[0] = 0.0


@pytest.mark.slow
def test_derivatives_keep_their_digits_next_to_redundancy(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hinge whose axis is 0.2° off resists turning by little more than rounding does."""
    robot = parse_robot(FOUR_BAR.replace("joint =", "rpy_deg = [0, 0, 0.2]\njoint ="))
    model = derive(robot, functions=("default", "constraints"), derivatives=("impact_derivatives",))
    module = module_of(model)
    source = sys.modules[module.mass_matrix.__module__]
    monkeypatch.setattr(source, "sign", lambda x: np.copysign(1.0, np.real(x)))
    q = np.array([0, 0, 0, 0, 0, 0, 1, 0.3, 1.3, 2.9])
    state = {"q": q, "v": np.array([0.1, 0, 0.2, 0.3, 1.0, -0.2, 3.0, 1.0, -2.0])}
    state |= {"active": np.ones(1), "restitution": np.array([0.3])}
    found = module.impact_derivatives(*state.values())
    velocities, impulses = derivative(module, "impact", state, "q")
    for ours, theirs, limit in ((found[1], velocities, 1e-8), (found[4], impulses, 1e-11)):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=limit * np.abs(theirs).max())


def met_robot(seed: int) -> tuple[Robot, Array]:
    """A robot with points and frames that are held, none redundantly, and a state of it there.

    Pinocchio needs damping where some are redundant, and converges to fewer digits.
    """
    rng, robot = np.random.default_rng([seed, 11]), random_tree(seed)
    q, v, _ = random_state(robot, rng)
    oracle = Oracle(robot, rigid_base=True)
    found: list[Constraint] = []
    for k in range(6):
        name, other = (str(each) for each in rng.permutation([*oracle.frames] * 2)[:2])
        other = other if found else name
        place = oracle.point_jacobian(q, oracle.frames[name])[1]
        if name != other:
            place = oracle.point_jacobian(q, oracle.frames[other])[1].actInv(place)
        x, y, z = map(float, place.translation)
        roll, pitch, yaw = (
            Fraction(float(a)) for a in np.rad2deg(pin.rpy.matrixToRpy(place.rotation))
        )
        kind: ConstraintKind = "frame" if rng.random() < 0.5 else "point"
        anchor = Pose((x, y, z), (roll, pitch, yaw)) if kind == "frame" else Pose((x, y, z))
        found.append(
            Constraint(f"c{k}", kind, name, None if name == other else other, **vars(anchor))
        )
        dense = Dense(replace(robot, constraints=tuple(found)), q, np.zeros(v.size))
        sizes = np.linalg.eigvalsh(dense.jacobian @ dense.inverse(np.ones(len(found)))[1])
        if sizes[0] < 1e-4 * sizes[-1]:
            found.pop()
    return replace(robot, name=f"met_{seed}", constraints=tuple(found)), q


@pytest.mark.slow
def test_accelerations_and_forces_are_those_of_constraint_dynamics() -> None:
    """Where constraints are met and velocities agree with them, as Pinocchio takes them."""
    seed = 1
    robot, q = met_robot(seed)
    module, oracle = emitted_module(robot, *FEW), Oracle(robot, rigid_base=True)
    assert np.abs(module.constraint_errors(q)).max() < 1e-13
    every = np.ones(len(robot.constraints))
    _, v, u = random_state(robot, np.random.default_rng(seed))
    v, _ = module.impact(q, v, every, 0.0 * every)
    models = pin.StdVec_RigidConstraintModel()
    for own in robot.constraints:
        joint, at = oracle.frames[own.frame]
        to, place = oracle.frames[own.to] if own.to is not None else (0, pin.SE3.Identity())
        kind = pin.ContactType.CONTACT_6D if own.kind == "frame" else pin.ContactType.CONTACT_3D
        anchor = place * placed(own.anchor)
        if own.kind == "point":  # In the axes that the anchor has.
            there = oracle.point_jacobian(q, (to, anchor))[1] if to else anchor
            turn = oracle.point_jacobian(q, (joint, pin.SE3.Identity()))[1].rotation.T
            at = pin.SE3(turn @ there.rotation, at.translation)
        models.append(
            pin.RigidConstraintModel(
                kind, oracle.model, joint, at, to, anchor, pin.ReferenceFrame.LOCAL
            )
        )
    datas = pin.StdVec_RigidConstraintData()
    for model in models:
        datas.append(model.createData())
    tree = oracle.model, oracle.data
    armature = np.diag(oracle.mass_matrix(q)) - np.diag(
        pin.crba(*tree, oracle.configuration(q))[np.ix_(oracle.order, oracle.order)]
    )
    oracle.model.armature = oracle.spread(armature[oracle.free])
    driven = module.residual(q, v) + module.input_matrix(q) @ u
    state = oracle.configuration(q), oracle.spread(v)
    torque = oracle.spread(driven) + pin.nonLinearEffects(*tree, *state)
    pin.initConstraintDynamics(*tree, models, datas)
    settings = pin.ProximalSettings(1e-14, 0.0, 1)
    theirs = pin.constraintDynamics(*tree, *state, torque, models, datas, settings)
    ours, forces = module.constrained_forward_dynamics(q, v, u, every)
    assert_alike(ours, theirs[oracle.order][oracle.free])
    sizes = [6 if model.type == pin.ContactType.CONTACT_6D else 3 for model in models]
    pushed = [data.contact_force.vector[:n] for data, n in zip(datas, sizes, strict=True)]
    assert_alike(forces, np.concatenate(pushed))


@pytest.mark.slow
def test_impacts_take_energy_away_and_keep_momentum_within_the_robot() -> None:
    for seed, redundant in ((35, False), (37, True)):
        robot = constrained_robot(seed, redundant)
        module, rng = emitted_module(robot, *FEW), np.random.default_rng(seed)
        q, v, _ = random_state(robot, rng)
        active = np.ones(len(robot.constraints))
        moving, energy = module.constraint_jacobian(q) @ v, module.kinetic_energy(q, v)
        caught = module.impact(q, v, active, 0.0 * active)[0]
        all_of_it = 0.5 * moving @ module.operational_inertia(q, active) @ moving
        # What redundant rows cannot have is not in J v.
        moving = moving - module.constraint_jacobian(q) @ caught
        for e in (0.0, 0.3, 1.0):
            after, impulses = module.impact(q, v, active, e * active)
            left = module.constraint_jacobian(q) @ after
            assert_alike(left, -e * moving, float(np.abs(v).max()))
            lost = energy - module.kinetic_energy(q, after)
            # Carnot: (1 - e²)/2 of J v by the inertia that it meets.
            assert lost == pytest.approx((1.0 - e**2) * all_of_it, rel=1e-9, abs=1e-12 * energy)
            assert_alike(
                module.mass_matrix(q) @ (after - v), module.constraint_jacobian(q).T @ impulses
            )
        within = np.array([each.to is not None for each in robot.constraints], float)
        kept, _ = module.impact(q, v, within, 0.5 * within)
        before = module.centroidal_momentum(q, v)
        assert_alike(module.centroidal_momentum(q, kept), before)


@pytest.mark.slow
def test_light_constraints_hide_no_heavy_ones_in_single_precision(tmp_path: Path) -> None:
    """Under a force a finger moves by far more than the base, whether it is held or not."""
    emitted = emit(parse_robot(LIGHT_FINGER), tmp_path / "light")
    source = tmp_path / "program.c"
    source.write_text("""
#include "light.h"
#include <stdio.h>
int main(void)
{
    const float q[8] = {0, 0, 0, 0, 0, 0, 1, 0.3f}, v[7] = {0.3f, -0.2f, 0.1f};
    const float on[2][2] = {{1, 0}, {1, 1}}, rebounds[2] = {0, 0.5f};
    float after[7], impulses[9];
    for (int i = 0; i < 2; i++) {
        light_impact(&light_default_constants, q, v, on[i], rebounds, after, impulses);
        for (int k = 0; k < 9; k++) { printf("%.9g ", (double)impulses[k]); }
    }
    return 0;
}
""")
    options = [emitted.single, f"-I{emitted.folder}", str(source), *emitted.sources]
    program = build("gcc", ["-O0"], options, tmp_path / "program")
    found = np.array(run([program]).split(), float).reshape(2, 9)
    q, v = np.array([0, 0, 0, 0, 0, 0, 1, 0.3]), np.array([0.3, -0.2, 0.1, 0, 0, 0, 0])
    dense = Dense(emitted.model.robot, q, v)
    for impulses, active in zip(found, np.array([[1.0, 0.0], [1.0, 1.0]]), strict=True):
        taken = np.array([1.0, 1.5])[dense.owner] * (dense.jacobian @ v)
        right = dense.solved(taken, active)[0]
        limit = 1e-5 if active[1] == 0.0 else 1e-4
        np.testing.assert_allclose(impulses, right, rtol=0, atol=limit * np.abs(right).max())


def closed_four_bar() -> tuple[ModuleType, Array, Array, Array]:
    """The module of a four-bar on a base, which closes with five rows for two; a moving state."""
    module = emitted_module(parse_robot(FOUR_BAR), *FEW)
    q, active = np.zeros(10), np.ones(1)
    q[6], q[7:] = 1.0, (-1.2, 0.9, -1.0)
    for _ in range(8):
        q = module.integrate(q, module.constraint_projection(q, active))
    assert np.abs(module.constraint_errors(q)).max() < 1e-15
    moving = np.array([0.1, 0, 0.2, 0.3, 1.0, -0.2, 3.0, 1.0, -2.0])
    v, _ = module.impact(q, moving, active, np.zeros(1))
    return module, q, v, active


@pytest.mark.slow
@pytest.mark.usefixtures("derived_once")
@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
def test_a_four_bar_keeps_its_energy_and_with_projection_its_loop(
    backend: str, tmp_path: Path, jax_in_double_precision: ModuleType
) -> None:
    """For 10 s in C, and for 0.2 s by the others."""
    _, q, v, _ = closed_four_bar()
    (tmp_path / "robot.toml").write_text(FOUR_BAR)
    functions = ["default", "constraints"]
    path = generate(tmp_path / "robot.toml", tmp_path, functions=functions, verify=False)
    module = load(path, backend=backend)
    steps = 10_000 if backend == "c" else 200
    found = rollout(module, q, v, np.zeros(3), steps, 1e-3, every=100, constraints=["closing"])
    assert found.steps.tolist() == [steps]
    moving, still = (np.array(x)[0] for x in (found.v, found.q))
    assert np.abs(module.constraint_errors(still)).max() < 1e-8
    energy = module.kinetic_energy(still, moving) + module.potential_energy(still)
    assert np.array(energy) == pytest.approx(
        float(energy[0]), rel=1e-8
    )  # While it falls, with 8 kJ at the end.
    with pytest.raises(UsageError, match=r"^constraints: .* known: closing"):
        rollout(module, q, v, np.zeros(3), 1, 1e-3, constraints=["opening"])
