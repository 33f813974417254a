"""Constraints that hold for a time, with the robots and scenarios of their page."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.kept import kept_folder, made_once
from support.pages import files_of

from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.flight.control.observation import Observation
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoop
from gibbs_codegen.flight.integration.integrators import Integration, integrate
from gibbs_codegen.flight.many import simulate_many
from gibbs_codegen.flight.record.flight import Flight, read_flight
from gibbs_codegen.flight.record.recording import flight_of
from gibbs_codegen.flight.rollouts.rollout import rollout
from gibbs_codegen.flight.scenario.file import parse_scenario, read_scenario
from gibbs_codegen.flight.scenario.parts import Hold, Payload, Push, StartOffset, Wind
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.scenario.walls import Plane
from gibbs_codegen.flight.simulation import flight_start, simulate
from gibbs_codegen.flight.stepping import Simulation
from gibbs_codegen.flight.sweeps.sweep import sweep
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.runtime.load import load

Array = NDArray[np.float64]
FILES = files_of("docs/howto/constraints.md")
WEIGHT = 9.81 * 1.35
RK4: dict[str, Any] = {"method": "rk4", "step": 0.001}


def module_of(name: str, backend: str = "c") -> ModuleType:
    """The module of a robot of the page."""
    robot, text = parse_robot(FILES[f"{name}.toml"]), FILES[f"{name}.toml"]
    base = kept_folder(robot, "constraints in flight")

    def make() -> None:
        generate_robot(robot, text, base, verify=False, functions=["default", "constraints"])

    return load(made_once(base / robot.name, make), backend)


def perching(**changes: Any) -> Scenario:
    """The scenario of the page, with parts changed, in steps of 1 ms."""
    scene = parse_scenario(FILES["perch.toml"])
    return replace(scene, integration=replace(scene.integration, **RK4), **changes)


def hovering(**changes: Any) -> Scenario:
    """The same on the spot, which takes no time to plan."""
    spot = {"base": {"path": {"kind": "fixed", "position": [0, 0, 1]}}}
    return replace(perching(base=read_scenario("hover", spot).base), **changes)


@pytest.fixture(scope="module")
def percher() -> ModuleType:
    return module_of("percher")


@pytest.fixture(scope="module")
def perched(percher: ModuleType) -> Flight:
    return simulate(percher, perching())


@pytest.mark.slow
def test_a_machine_perches_where_it_is_and_takes_off(
    percher: ModuleType, perched: Flight, tmp_path: Any
) -> None:
    flight, held = perched, (perched.time > 1.9) & (perched.time < 4.0)
    assert not flight.stopped
    place = flight.q[held, :7]
    assert np.abs(np.ptp(place, axis=0)).max() < 1e-12
    assert np.abs(place[0, :3] - [0.5, 0.0, 1.6]).max() > 1e-5  # Not yet where the path ends.
    assert not flight.applied[held, :4].any()
    assert np.ptp(flight.q[held, 7]) > 0.5  # The arm goes on.
    assert not flight.hold_forces[~held & (flight.time != 1.9)].any()
    # By Newton: what holds the machine up is its weight and what speeds up its centre of mass.
    impulse = np.einsum("sij,sj->si", percher.mass_matrix(flight.q), flight.v)[:, :3]
    momentum = np.einsum("sij,sj->si", flight.base_rotation, impulse)
    pull = np.gradient(momentum, flight.time, axis=0)
    pull[:, 2] += WEIGHT
    inner = np.flatnonzero(held)[3:-3]
    np.testing.assert_allclose(flight.hold_forces[inner, :3], pull[inner], rtol=0, atol=0.02)
    ((time, lost, left),) = flight.impacts
    assert time == 1.9
    # The sample of that instant is of after the impact: held, as its forces say.
    (at,) = np.flatnonzero(flight.time == 1.9)
    assert np.abs(flight.v[at, :6]).max() < 1e-12
    assert lost > flight.kinetic_energy[at] > 0.0
    assert left == pytest.approx(flight.kinetic_energy[at], rel=1e-9)
    assert np.abs(flight.energy_error).max() < 1e-9
    (words,) = flight.hold_summaries
    assert words.startswith("hold 1, grip: from t = 1.9 s to 4 s; at most ")
    (felt,) = flight.impact_summaries
    assert f"{lost + left:.3g} J to {left:.3g} J" in felt
    # By Newton again: the impulse stops the centre of mass.
    stopped = momentum[at] - momentum[at - 1] - 0.01 * (flight.hold_forces[at - 1, :3])
    assert np.abs(flight.impulses[0, :3] - stopped).max() < 0.05
    forces = np.linalg.norm(flight.hold_forces[:, :3], axis=1)
    most = int(forces.argmax())
    assert f"at most {forces[most]:.3g} N, at t = {flight.time[most]:.4g} s; drifts by" in words
    assert float(words.split("drifts by ")[1].removesuffix(" m")) < 1e-12
    assert np.abs(flight.q[-1, :3] - [0, 0, 1]).max() < 5e-3
    flight.write_npz(tmp_path / "flight.npz")
    assert np.array_equal(read_flight(tmp_path / "flight.npz").impacts, flight.impacts)


@pytest.mark.slow
def test_forces_and_accelerations_are_those_of_the_bordered_matrix(percher: ModuleType) -> None:
    """With push and wind; in NumPy, and compiled."""
    push, wind = Push((1.0, -2.0, 3.0), torque=(0.1, 0.2, -0.1), frame="claw"), Wind({"base": 0.4})
    scene = perching(push=push, wind=replace(wind, velocity=(2.0, 1.0, 0.0)))
    loop = flight_start(percher, scene, lambda *_: None, custom_law=False).loop
    rng = np.random.default_rng(2)
    q, v, u = rng.normal(size=8), rng.normal(size=7), rng.normal(size=5)
    q[3:7] /= np.linalg.norm(q[3:7])
    loads = loop.loads(3.0)._replace(idle=False)
    parts = loop.parts(np.concatenate([q, v, np.zeros(loop.size - 15)]))
    found = loop.motion(3.0, parts, u, u, loads)
    mass, jacobian = percher.mass_matrix(q), percher.constraint_jacobian(q)
    driven = percher.residual(q, v) + percher.input_matrix(q) @ u
    driven = driven + percher.wrench_forces(q, found["wrenches"])
    bordered = np.block([[mass, jacobian.T], [jacobian, np.zeros((6, 6))]])
    right = np.concatenate([driven, -percher.constraint_bias(q, v)])
    expected = np.linalg.solve(bordered, right)
    assert np.abs(found["wrenches"]).max() > 2.0
    size = np.abs(expected).max()
    np.testing.assert_allclose(found["a"], expected[:7], rtol=0, atol=1e-11 * size)
    np.testing.assert_allclose(found["holding"], -expected[7:], rtol=0, atol=1e-11 * size)
    state = np.concatenate([q, v, np.zeros(loop.size - 15)])
    compiled = CompiledLoop(loop, np.inf, loads).slope(3.0, state)
    np.testing.assert_allclose(compiled, loop.derivative(3.0, state, loads), rtol=1e-10, atol=1e-9)


# The machine is pushed off, is held once by holds that overlap and follow each other, and goes on.
PUSH = Push((0.0, 200.0, 0.0), begin=0.0, end=0.01, frame="base")
HOLDS = tuple(Hold("grip", *span) for span in ((0.01, 0.03), (0.02, 0.04), (0.04, 0.05)))


@pytest.mark.slow
def test_other_ways_to_fly_give_the_same(percher: ModuleType) -> None:
    """Where there is an impact, and where the flight ends before it."""
    scene = hovering(duration=0.08, holds=HOLDS, push=PUSH)
    lost = replace(
        scene,
        push=replace(PUSH, force=(0.0, 10_000.0, 0.0)),
        integration=replace(scene.integration, divergence=2.0),
    )
    flown, ended = (simulate(percher, each) for each in (scene, lost))
    assert ended.stopped
    assert flown.impacts[:, 0].tolist() == [0.01]
    heavier = replace(scene, plant={"base_mass": 1.5})
    *alike, other = simulate_many(percher, [scene, lost, heavier], blocks=True)
    for found, alone in zip(alike, (flown, ended), strict=True):
        assert isinstance(found, Flight)
        assert found.stopped == alone.stopped
        for name in ("q", "v", "work", "impacts"):
            values, wanted = getattr(found, name), getattr(alone, name)
            np.testing.assert_allclose(values, wanted, rtol=1e-9, atol=1e-9, err_msg=name)
    assert isinstance(other, Flight)
    assert other.impacts[0, 1] != flown.impacts[0, 1]
    for each, alone in ((scene, flown), (lost, ended)):
        rolled = rollout(percher, None, None, each, 80, 0.001, every=10)
        np.testing.assert_allclose(rolled.v[0, -1], alone.v[-1], rtol=0, atol=1e-9)
    loop = flight_start(percher, scene, lambda *_: None, custom_law=False).loop
    python = Integration(loop, loop.start(flown.q[0], flown.v[0]), scene.integration, 0.08)
    python.advance(0.08)
    np.testing.assert_allclose(loop.parts(python.state).q, flown.q[-1], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_at_rest_there_is_an_impact_that_loses_nothing(percher: ModuleType) -> None:
    scene = hovering(duration=0.1, holds=(Hold("grip", 0.0, 0.02),), push=PUSH)
    start = flight_start(percher, scene, lambda *_: None, custom_law=False)
    rest = start.loop.start(start.q, np.zeros(7))
    integration = Integration(start.loop, rest, scene.integration, 0.1)
    integration.advance(0.01)
    assert [impact[:3] for impact in integration.history().impacts] == [(0.0, 0.0, 0.0)]


@pytest.mark.slow
def test_rollouts_tell_the_thrusts_of_motors_that_idle() -> None:
    """Of motors that lag, and of one that does not."""
    scene = hovering(holds=(Hold("grip", 0.01, 0.03, idle=True),))
    lag = np.array([0.0, 0.02, 0.02, 0.02])
    module = module_of("percher", "numpy")
    found = rollout(module, None, None, scene, 40, 0.001, time_constants=lag)
    idles = (found.time >= 0.01) & (found.time < 0.03)
    assert found.thrusts is not None
    assert not found.thrusts[0, idles, 0].any()
    assert found.thrusts[0, ~idles, 0].all()


@pytest.mark.slow
def test_controllers_are_told_forces(percher: ModuleType) -> None:
    scene = hovering(holds=(Hold("grip", 0.1, 0.4),))
    seen: list[Observation] = []
    simulation = Simulation(percher, scene)
    for _ in range(5):
        seen.append(simulation.step(np.zeros(5), 0.1))
    assert [bool(each.constraint_forces.any()) for each in seen] == [True, True, True, False, False]
    assert seen[2].constraint_forces[2] == pytest.approx(WEIGHT, rel=0.02)
    assert np.abs(seen[1].q[:7] - seen[2].q[:7]).max() < 1e-12
    # It has fallen for 0.1 s before, and again for 0.1 s.
    assert simulation.q[2] == pytest.approx(1.0 - 2 * 0.5 * 9.81 * 0.01, abs=2e-3)
    assert simulation.flight().impacts.shape == (1, 3)


@pytest.mark.slow
def test_a_door_is_pulled_open() -> None:
    opener = module_of("opener")
    flight = simulate(opener, parse_scenario(FILES["door.toml"]))
    assert not flight.stopped
    errors = opener.constraint_errors(flight.q)
    assert np.abs(errors - errors[0]).max() < 1e-11
    upper = opener.FRAMES.index("upper")
    turn = opener.frame_poses(flight.q)[:, upper, :2, 0]
    angle = np.rad2deg(np.unwrap(np.arctan2(turn[:, 1], turn[:, 0])))
    assert angle[-1] - angle[0] == pytest.approx(-60.0, abs=0.2)
    # The hinge bears the door but for what the law takes it for.
    upwards = [k for k, name in enumerate(flight.hold_names) if name.endswith("_z")]
    carried = flight.hold_forces[:, upwards].sum(axis=1)
    np.testing.assert_allclose(carried, 5.9 * 9.81, rtol=0, atol=0.2)
    assert np.abs(flight.energy_error).max() < 1e-9


@pytest.mark.slow
def test_a_distance_does_not_drift_while_a_rod_tumbles() -> None:
    """In steps of 1 ms."""
    text = FILES["percher.toml"].replace('type  = "frame"', 'type  = "distance"\ndistance = 0.5')
    robot = replace(parse_robot(text), name="tumbling")
    base = kept_folder(robot, "constraints in flight")
    options: dict[str, Any] = {"verify": False, "functions": ["default", "constraints"]}
    place = made_once(base / robot.name, lambda: generate_robot(robot, text, base, **options))
    given = {"control": {"law": "off"}, "duration": 1.0, "hold": [{"constraint": "grip"}]}
    given |= {"integration": RK4 | {"divergence": float("inf")}}
    start = flight_start(
        load(place, "c"), read_scenario("hover", given), lambda *_: None, custom_law=False
    )
    v = np.array([4.0, 2.0, 1.0, 20.0, -25.0, 30.0, 0.0])
    state = start.loop.start(start.q, v)
    history = integrate(start.loop, state, 1.0, start.scenario.integration)
    flight = flight_of(start.loop, start.scenario, history)
    radius = np.linalg.norm(flight.point("claw"), axis=1)
    assert np.ptp(radius) < 2e-5
    assert np.ptp(flight.hold_errors) < 2e-5


@pytest.mark.slow
def test_what_cannot_hold_is_refused(percher: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    other = (Hold("gripp"),)
    with pytest.raises(UsageError, match=r"holds\[0\].begin: must be before 7, when the"):
        hovering(holds=(Hold("grip", 7.0),))
    ground, start = Plane("claw", (0, 0, 0), (0, 0, 1), 1e3), StartOffset(settled=True)
    with pytest.raises(UsageError, match=r"start\.settled: a constraint already holds the robot"):
        simulate(percher, hovering(holds=(Hold("grip"),), walls=(ground,), start=start))
    with pytest.raises(
        UsageError, match="hold 1: constraint: percher has no gripp; did you mean grip\\? its"
    ):
        simulate(percher, hovering(holds=other))
    heavy = hovering(payloads=(Payload("claw", 0.1, 3.0, 5.0),))
    with pytest.raises(UsageError, match="hold 1: at t = 3 s grip holds, and payload 1 is there"):
        simulate(percher, heavy)
    lacking = module_of("percher", "numpy")
    monkeypatch.delattr(lacking, "impact")
    with pytest.raises(MissingFunctionError, match="constraints"):
        simulate(lacking, hovering())


@pytest.mark.slow
@pytest.mark.usefixtures("derived_once")
def test_robot_files_are_flown_with_functions_of_constraints(tmp_path: Path) -> None:
    """By the command, and in sweeps."""
    (tmp_path / "percher.toml").write_text(FILES["percher.toml"], encoding="utf-8")
    moves = re.compile(r"\[arm.moves_deg\].*?\n\n", re.DOTALL)  # They come later than 2 s.
    short = moves.sub("", FILES["perch.toml"]).replace("duration = 7", "duration = 2")
    (tmp_path / "perch.toml").write_text(short, encoding="utf-8")
    robot, scene = (str(tmp_path / name) for name in ("percher.toml", "perch.toml"))
    out = str(tmp_path / "flight")
    command = ["simulate", robot, "--scenario", scene, "--out", out, "--no-figures"]
    assert main(command) == 0
    held, masses = hovering(duration=0.05, holds=HOLDS), {"plant.base_mass": [1.1, 1.2]}
    with ThreadPoolExecutor(1) as here:
        study = sweep(robot, held, masses, executor=here, out=tmp_path / "sweep")
    assert not any(study.table["failed"])
