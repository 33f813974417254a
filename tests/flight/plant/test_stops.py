"""Holds with a restitution: frames that rebound from planes and at the ends of distances."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.kept import kept_folder, made_once
from support.pages import files_of

from gibbs_codegen import linearise
from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.flight.integration.integrators import Integration
from gibbs_codegen.flight.integration.stops import after_impacts
from gibbs_codegen.flight.many import simulate_many
from gibbs_codegen.flight.record.flight import Flight, read_flight
from gibbs_codegen.flight.scenario.file import parse_scenario, read_scenario
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import flight_start, simulate
from gibbs_codegen.flight.stepping import Simulation
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.runtime.load import load

Array = NDArray[np.float64]
FILES = files_of("docs/howto/constraints.md")
GRAVITY, MASS, HEIGHT, E = 9.81, 0.5, 1.0, 0.8
LANDER = FILES["ball.toml"].split("[[constraint]]")[0].replace("ball", "lander")
FEET = ((0.1, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.1, -0.1))
for number, (x, y) in enumerate(FEET):
    LANDER += f"[[rotor]]\nposition = [{x}, {y}, 0]\ndrag = {0.02 * (-1) ** number}\n"
    LANDER += f'[[frame]]\nname = "foot_{number}"\non = "base"\nxyz = [{x}, {y}, -0.1]\n'
    LANDER += f'[[constraint]]\nname = "ground_{number}"\ntype = "plane"\nframe = "foot_{number}"\n'


def module_of(text: str, backend: str = "c") -> ModuleType:
    """The module of a robot's text."""
    robot = parse_robot(text)
    base = kept_folder(robot, "constraints in flight")
    functions = ["default", "constraints"]

    def make() -> None:
        generate_robot(robot, text, base, verify=False, functions=functions)

    return load(made_once(base / robot.name, make), backend)


@pytest.fixture(scope="module")
def ball() -> ModuleType:
    return module_of(FILES["ball.toml"])


def bouncing(**changes: Any) -> Scenario:
    """The scenario of the page, with parts changed."""
    return parse_scenario(FILES["bounce.toml"], changes=changes)


def landing(e: float, **changes: Any) -> Scenario:
    """A machine on four feet comes down."""
    down = {"kind": "waypoints", "times": [0, 1.5], "points": [[0, 0, 0.4], [0, 0, 0]]}
    stops = [{"constraint": f"ground_{k}", "restitution": e} for k in range(4)]
    scene = {"duration": 2, "base": {"path": down}, "hold": stops}
    return read_scenario("hover", {**scene, "integration": {"method": "rk4"}, **changes})


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "adaptive"])
def test_a_ball_bounces_up_to_heights_that_fall_by_the_square_of_the_restitution(
    ball: ModuleType, method: str
) -> None:
    integration = {"method": method, "divergence": float("inf")}
    flight = simulate(ball, bouncing(integration=integration))
    assert not flight.stopped
    time, lost, left = flight.impacts[:-1].T
    count = np.arange(len(time))
    falls = np.sqrt(2.0 * HEIGHT / GRAVITY) * E**count
    np.testing.assert_allclose(time, 2.0 * np.cumsum(falls) - falls[0], rtol=1e-8)
    heights = left / (MASS * GRAVITY)
    np.testing.assert_allclose(heights, HEIGHT * E ** (2 * (count + 1)), rtol=1e-6)
    np.testing.assert_allclose(lost / (lost + left), 1.0 - E**2, rtol=1e-6)
    momentum = MASS * np.sqrt(2.0 * GRAVITY * HEIGHT) * E**count * (1.0 + E)
    np.testing.assert_allclose(flight.impulses[:-1, 0], momentum, rtol=1e-6)
    # In the end it is slower than 1 mm/s, and rests.
    assert flight.impacts[-1, 2] == 0.0
    assert flight.impacts[-1, 1] < 0.5 * MASS * 1e-3**2
    resting = flight.time > flight.impacts[-1, 0]
    assert np.abs(flight.hold_forces[resting] - MASS * GRAVITY).max() < 1e-9
    assert not flight.hold_forces[~resting].any()
    assert flight.hold_errors.min() > -1e-9
    assert np.abs(flight.q[-1, 2]) < 1e-9
    assert np.abs(flight.energy_error).max() < 1e-9


def test_samples_of_an_elastic_ball_keep_its_energy_and_are_those_of_free_flight(
    ball: ModuleType,
) -> None:
    """Also those at which a step ends that goes through the floor."""
    elastic = [{"constraint": "floor", "restitution": 1}]
    scene = bouncing(hold=elastic, integration={"rate": 1000.0}, duration=2)
    flight = simulate(ball, scene)
    assert np.ptp(flight.kinetic_energy + flight.potential_energy) < 1e-11
    period = np.sqrt(8.0 * HEIGHT / GRAVITY)
    phase = np.mod(flight.time + period / 2.0, period) - period / 2.0
    np.testing.assert_allclose(
        flight.q[:, 2], np.abs(HEIGHT - GRAVITY / 2.0 * phase**2), rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(np.diff(flight.time), 1e-3, rtol=1e-9)


@pytest.mark.slow
def test_other_ways_to_fly_a_ball_give_the_same(ball: ModuleType, tmp_path: Any) -> None:
    scene = bouncing(duration=1.3)
    flight = simulate(ball, scene)
    assert len(flight.impacts) == 2
    (one, other) = simulate_many(ball, [scene, replace(scene, duration=1.3)], blocks=True)
    loop = flight_start(
        module_of(FILES["ball.toml"], "numpy"), scene, lambda *_: None, custom_law=False
    ).loop
    python = Integration(loop, loop.start(flight.q[0], flight.v[0]), scene.integration, 1.3)
    python.advance(1.3)
    simulation = Simulation(ball, scene)
    while simulation.time < 1.3 - 1e-9:
        simulation.step(np.zeros(0), 0.1)
    for found in (one, other, simulation.flight()):
        assert isinstance(found, Flight)
        np.testing.assert_allclose(found.impacts, flight.impacts, rtol=1e-10)
        np.testing.assert_allclose(found.q[-1], flight.q[-1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(loop.parts(python.state).q, flight.q[-1], rtol=0, atol=1e-10)
    flight.write_npz(tmp_path / "flight.npz")
    assert np.array_equal(read_flight(tmp_path / "flight.npz").impulses, flight.impulses)


@pytest.mark.slow
def test_a_rope_stops_a_ball_at_its_end() -> None:
    rope = FILES["ball.toml"].replace('type  = "plane"', 'type = "distance"\ndistance = 1.5')
    text = rope.replace('"ball"', '"roped"') + "xyz = [0, 0, 3]\n"
    start = {"path": {"kind": "fixed", "position": [0.5, 0.0, 2.5]}}
    flight = simulate(module_of(text), bouncing(base=start, duration=3))
    radius = np.linalg.norm(flight.q[:, :3] - [0, 0, 3], axis=1)
    assert radius.max() < 1.5 + 1e-9
    # It falls to where the rope is taut; the rope then takes away of v what is along it.
    time, depth = flight.impacts[0, 0], np.sqrt(1.5**2 - 0.5**2)
    assert time == pytest.approx(np.sqrt(2.0 * (depth - 0.5) / GRAVITY), rel=1e-9)
    along = GRAVITY * time * depth / 1.5
    assert flight.impulses[0, 0] == pytest.approx(-MASS * (1.0 + E) * along, rel=1e-8)
    assert flight.impacts[0, 1] == pytest.approx(0.5 * MASS * (1.0 - E**2) * along**2, rel=1e-8)
    assert flight.hold_forces.max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"control": {"rate": 200.0}}, {"integration": {}}])
def test_a_machine_lands_on_its_feet_and_takes_off_again(changes: dict[str, Any]) -> None:
    lander = module_of(LANDER)
    up = {"kind": "waypoints", "times": [0, 1, 1.5, 2.5]}
    up["points"] = [[0, 0, 0.4], [0, 0, 0.05], [0, 0, 0.05], [0, 0, 0.4]]
    flight = simulate(lander, landing(0.3, base={"path": up}, duration=2.5, **changes))
    assert not flight.stopped
    assert np.abs(flight.energy_error).max() < 1e-8
    assert flight.hold_errors.min() > -1e-8
    # Where a command jumps, the stop lets go right after that instant.
    assert flight.hold_forces.min() > (-0.1 if flight.control_rate else -1e-8)
    # All feet come down at once: the impulse is of the whole machine.
    _, lost, left = flight.impacts[0]
    assert left == pytest.approx(0.3**2 * (lost + left), rel=1e-6)
    assert flight.impulses[0].sum() == pytest.approx(
        1.3 * np.sqrt(2.0 * MASS * (lost + left)), rel=1e-6
    )
    rests = np.flatnonzero(flight.hold_forces.any(axis=1))
    assert len(rests) > 10
    assert flight.time[rests[-1]] < 2.3
    assert flight.q[-1, 2] == pytest.approx(0.4, abs=0.02)


@pytest.mark.slow
def test_what_tumbles_on_its_feet_gains_no_energy_and_goes_through_no_floor() -> None:
    lander = module_of(LANDER)
    off = {"control": {"law": "off"}, "start": {"turn_deg": [10, 20, 0]}}
    off["integration"] = {"method": "rk4", "divergence": float("inf")}
    for e in (0.0, 0.5, 1.0):
        flight = simulate(lander, landing(e, **off))
        assert len(flight.impacts) > 3
        assert flight.impacts[:, 1].min() > -1e-12
        assert (e < 1.0) == (flight.impacts[:, 1].max() > 1e-3)
        assert flight.impulses.min() > -1e-9
        assert flight.hold_errors.min() > -1e-8
        assert np.abs(flight.energy_error).max() < 1e-6


@pytest.mark.slow
def test_feet_that_are_hit_together_push_as_of_all_choices_one_may() -> None:
    """By dense matrices: with each choice of feet that push, and Newton's law for them."""
    lander = module_of(LANDER)
    rng, choices = np.random.default_rng(4), np.array([*itertools.product([False, True], repeat=4)])
    loop = flight_start(lander, landing(0.6), lambda *_: None, custom_law=False).loop
    assert loop.environment is not None
    q = np.array([0.3, -0.2, 0.1, 0, 0, 0.6, 0.8])
    mass, jacobian = lander.mass_matrix(q), lander.constraint_jacobian(q)
    pushed = set[int]()
    for _ in range(12):
        v = rng.normal(size=6) * np.array([1, 1, 1, 20, 20, 20])
        rates, allowed = jacobian @ v, []
        for pushing in choices[1:]:
            rows = jacobian[pushing]
            inverse = rows @ np.linalg.solve(mass, rows.T)
            impulses = np.zeros(4)
            impulses[pushing] = -1.6 * np.linalg.lstsq(inverse, rates[pushing], rcond=1e-10)[0]
            after = v + np.linalg.solve(mass, jacobian.T @ impulses)
            parting = jacobian @ after + 0.6 * rates
            if impulses.min() > -1e-12 and parting.min() > -1e-12:
                allowed.append(after)
        _, state, impacts = after_impacts(loop, loop.environment, 0.0, loop.start(q, v))
        assert (jacobian @ loop.parts(state).v).min() > -1e-9
        if rates.min() > 0.0:
            assert not impacts
            continue
        impulses = impacts[0][3]
        found = v + np.linalg.solve(mass, jacobian.T @ impulses)
        assert allowed
        assert all(np.allclose(found, after, rtol=0, atol=1e-10) for after in allowed)
        assert impulses.min() > -1e-12
        assert min(impact[1] for impact in impacts) > -1e-12
        pushed.add(int(np.sum(impulses > 0.0)))
    assert {1, 2, 3} == pushed


@pytest.mark.slow
def test_motors_idle_while_a_frame_rests() -> None:
    lander = module_of(LANDER)
    stops = [{"constraint": f"ground_{k}", "restitution": 0, "idle": True} for k in range(4)]
    flight = simulate(lander, landing(0.0, hold=stops))
    (touch,) = flight.impacts[:, 0]
    rests = flight.time > touch
    assert not flight.applied[rests].any()
    assert flight.applied[~rests].all()
    carried = flight.hold_forces[rests].sum(axis=1)
    np.testing.assert_allclose(carried, MASS * GRAVITY, rtol=1e-9)


@pytest.mark.slow
def test_what_cannot_rebound_is_refused(ball: ModuleType) -> None:
    with pytest.raises(ScenarioFileError, match=r"restitution"):
        bouncing(hold=[{"constraint": "floor", "restitution": 1.2}])
    held = FILES["ball.toml"].replace('type  = "plane"', 'type = "point"').replace("ball", "pinned")
    with pytest.raises(UsageError, match="hold 1: restitution: applies to a plane or a distance"):
        simulate(module_of(held, "numpy"), bouncing())


def test_a_rest_ends_with_its_hold() -> None:
    """The ball rests, is let go and thrown up; the next hold finds it in the air."""
    hold = {"constraint": "floor", "restitution": 0.5}
    holds = [hold | {"end": 0.5}, hold | {"begin": 1.1}]
    push = {"frame": "base", "force": [0, 0, 20], "begin": 0.5, "end": 0.6}
    path = {"kind": "fixed", "position": [0, 0, 0]}
    scene = bouncing(hold=holds, push=push, duration=1.2, base={"path": path})
    for ball in (module_of(FILES["ball.toml"]), module_of(FILES["ball.toml"], "numpy")):
        flight = simulate(ball, scene)
        assert not flight.q[flight.time <= 0.5, 2].any()
        thrown = (20 / MASS - GRAVITY) * 0.1
        rates = thrown - GRAVITY * (flight.time - 0.6)
        later = flight.time > 0.6
        np.testing.assert_allclose(flight.v[later, 2], rates[later], rtol=0, atol=1e-9)


def test_simulations_in_numpy_come_to_stops() -> None:
    path = {"kind": "fixed", "position": [0, 0, 0.05]}
    simulation = Simulation(
        module_of(FILES["ball.toml"], "numpy"), bouncing(base={"path": path}, duration=0.2)
    )
    fall = np.sqrt(0.1 / GRAVITY)
    while simulation.time < 0.13:
        simulation.step(np.zeros(0), 0.01)
    since = simulation.time - fall
    height = E * GRAVITY * fall * since - GRAVITY / 2.0 * since**2
    assert simulation.q[2] == pytest.approx(height, abs=1e-9)


def test_a_frame_between_two_stops_is_caught() -> None:
    """Thrown to and fro without loss, which no flight goes on from."""
    roof = '[[constraint]]\nname = "roof"\ntype = "plane"\nframe = "base"\nnormal = "-z"\n'
    caught = module_of(FILES["ball.toml"].replace('"ball"', '"caught"') + roof)
    stops = [{"constraint": name, "restitution": 1} for name in ("floor", "roof")]
    path = {"kind": "fixed", "position": [0, 0, 0.01]}
    flight = simulate(caught, bouncing(hold=stops, base={"path": path}, duration=0.1))
    assert flight.time[-1] == pytest.approx(0.1)
    assert flight.v[-1] == pytest.approx(np.zeros(6), abs=1e-12)


def test_stops_have_no_linear_model(ball: ModuleType) -> None:
    with pytest.raises(UsageError, match="a hold with a restitution has no linear model"):
        linearise(ball, np.eye(7)[6], np.zeros(6), np.zeros(0), surroundings=bouncing())


@pytest.mark.slow
@pytest.mark.usefixtures("derived_once")
def test_the_command_tells_impacts(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("ball.toml", "bounce.toml"):
        (tmp_path / name).write_text(FILES[name], encoding="utf-8")
    robot, scene = (str(tmp_path / name) for name in ("ball.toml", "bounce.toml"))
    out = str(tmp_path / "flight")
    assert main(["simulate", robot, "--scenario", scene, "--out", out, "--no-figures"]) == 0
    printed = capsys.readouterr().out
    assert "impact at t = 0.4515 s: floor 3.99 N s; kinetic energy from 4.9 J to 3.14 J" in printed
    assert "and 36 more impacts: see `impacts` of the flight" in printed
