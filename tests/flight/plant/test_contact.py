"""Contact with friction: against laws of mechanics, SciPy, complex steps, and other languages."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from support.kept import kept_folder, made_once

from gibbs_codegen.arrays import evaluate, variable
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoop
from gibbs_codegen.flight.integration.integrators import integrate
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.many import simulate_many
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.rollouts.rollout import rollout
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.scenario.walls import Box, Cylinder, Sphere
from gibbs_codegen.flight.simulation import flight_start, simulate
from gibbs_codegen.flight.stepping import Simulation
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.runtime.load import load

Array = NDArray[np.float64]
GRAVITY, MASS = 9.81, 2.0
FEET = ["foot_1", "foot_2", "foot_3", "foot_4"]
HEIGHT = 0.1
PLACES = [(0.2, 0.15), (-0.2, 0.15), (0.2, -0.15), (-0.2, -0.15)]
# A machine on four feet, which is a block while its rotors are off.
BLOCK = (
    f"""
name = "block"
[base]
attitude = "quaternion"
mass = {MASS}
inertia = [0.02, 0.03, 0.04, 0, 0, 0]
"""
    + "".join(
        f'[[frame]]\nname = "{name}"\nxyz = [{x}, {y}, {-HEIGHT}]\n'
        for name, (x, y) in zip(FEET, PLACES, strict=True)
    )
    + "".join(
        f"[[rotor]]\nposition = [{x}, {y}, 0.02]\ndrag = {0.02 * np.sign(x * y)}\n"
        "limits = [0, 12]\ntime_constant = 0.03\n"
        for x, y in PLACES
    )
)
SOFT: dict[str, Any] = {"stiffness": 4000.0, "dissipation": 1.5}
RK4 = {"method": "rk4", "step": 0.001, "divergence": float("inf")}
DERIVATIVES = ("frame_poses_derivatives", "frame_velocities_derivatives")


@pytest.fixture(scope="module")
def folder() -> Path:
    """The folder of the block's module, with derivatives."""
    robot = parse_robot(BLOCK)
    needed = (*DERIVATIVES, "forward_dynamics_with_wrenches_derivatives")
    base = kept_folder(robot, needed)

    def make() -> None:
        generate_robot(robot, BLOCK, base, verify=False, derivatives=needed)

    return made_once(base / robot.name, make)


@pytest.fixture(scope="module")
def block(folder: Path) -> ModuleType:
    return load(folder, "c")


def thrown(module: ModuleType, walls: list[dict[str, Any]], **changes: Any) -> Flight:
    """The flight of a robot that nothing commands."""
    given = {"control": {"law": "off"}, "integration": RK4, "wall": walls}
    flight = simulate(module, read_scenario("hover", given | changes))
    assert not flight.stopped
    return flight


def fixed(*position: float) -> dict[str, Any]:
    return {"base": {"path": {"kind": "fixed", "position": list(position)}}}


def on_slope(degrees: float, friction: float, **changes: Any) -> Scenario:
    """The block on a slope that falls towards x, on which its feet just stand."""
    angle = np.radians(degrees)
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    wall = {"frame": FEET, "point": [0, 0, 0], "normal": normal.tolist(), "friction": friction}
    deep = MASS * GRAVITY * np.cos(angle) / (4.0 * SOFT["stiffness"])
    at = fixed(*((HEIGHT - deep) * normal))
    start = {"start": {"turn_deg": [0, degrees, 0]}}
    given = {"control": {"law": "off"}, "integration": RK4, "wall": [wall | SOFT]}
    return read_scenario("hover", given | at | start | changes)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [26.0, 27.2])
def test_a_block_sticks_below_the_angle_of_friction_and_slides_above(
    degrees: float, block: ModuleType
) -> None:
    """That is 26.6 degrees where the coefficient is 0.5."""
    angle, friction = np.radians(degrees), 0.5
    scenario = on_slope(degrees, friction, duration=4.0)
    flight = simulate(block, scenario)
    downhill = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    path = flight.point("base") @ downhill
    late = flight.time > 2.0
    slides = np.linalg.norm(flight.contact_slip, axis=-1) > 0.0
    if degrees < 26.5:
        assert np.ptp(path[late]) < 1e-9
        assert not slides[late].any()
        return
    assert slides[late].all()
    growth = GRAVITY * (np.sin(angle) - friction * np.cos(angle))
    speed = np.gradient(path, flight.time, edge_order=2)[late]
    found = np.polyfit(flight.time[late], speed, 1)[0]
    assert found == pytest.approx(growth, rel=1e-4)
    pressed = flight.contact_forces[late]
    drag = np.linalg.norm(flight.contact_friction[late], axis=-1)
    assert drag == pytest.approx(friction * pressed, rel=1e-12)
    # Bristles of what slides are strained as far as friction holds them.
    bristles = rollout(block, None, None, scenario, 4000, 1e-3, every=4000).bristles
    assert bristles is not None
    strained = np.linalg.norm(bristles[0, -1].reshape(-1, 3), axis=1)
    assert strained == pytest.approx(friction * pressed[-1] / SOFT["stiffness"], rel=1e-4)


@pytest.mark.slow
def test_nothing_slides_where_some_feet_are_at_the_limit(block: ModuleType) -> None:
    start = {"turn_deg": [0, 26.0, 0], "settled": True}
    flight = simulate(block, on_slope(26.0, 0.5, duration=0.1, start=start))
    pressed, across = flight.contact_forces[0], np.linalg.norm(flight.contact_friction[0], axis=-1)
    assert np.ptp(across / pressed) > 0.01
    assert across / pressed == pytest.approx(0.5, abs=0.03)
    assert not flight.contact_slip.any()
    assert np.ptp(flight.q, axis=0).max() < 1e-12


@pytest.mark.slow
def test_a_parked_machine_does_not_creep(block: ModuleType) -> None:
    """On a slope of 20 degrees with a friction of 0.5, over 10 s from where it rests."""
    start = {"turn_deg": [0, 20.0, 0], "settled": True}
    flight = simulate(block, on_slope(20.0, 0.5, duration=10.0, start=start))
    moved = flight.point("base") - flight.point("base")[0]
    assert np.linalg.norm(moved, axis=1).max() < 1e-9
    assert not flight.contact_slip.any()
    held = np.sum(flight.contact_friction, axis=1)
    assert np.linalg.norm(held, axis=1) == pytest.approx(
        MASS * GRAVITY * np.sin(np.radians(20.0)), rel=1e-6
    )


def stored(flight_loop: Any, states: Array, stiffness: float) -> Array:
    """Energy (s), J, of a robot and of the springs and bristles of contacts."""
    parts = flight_loop.parts(states)
    vehicle = flight_loop.vehicle
    still = np.zeros((len(states), len(vehicle.inputs)))
    depth = flight_loop.motion(0.0, parts, still, still, flight_loop.loads(0.0))["contacts"][..., 7]
    springs = 0.5 * stiffness * np.sum(np.maximum(depth, 0.0) ** 2, axis=-1)
    bristles = 0.5 * stiffness * np.sum(parts.bristles**2, axis=-1)
    energy = vehicle.kinetic_energy(parts.q, parts.v) + vehicle.potential_energy(parts.q)
    found: Array = energy + springs + bristles
    return found


@pytest.mark.slow
def test_energy_never_grows_by_contact(block: ModuleType) -> None:
    """Of a block that is thrown, tumbles on a floor with friction, and comes to rest."""
    floor = {"kind": "floor", "frame": FEET, "friction": 0.4, "ball_radius": 0.02} | SOFT
    given = {"control": {"law": "off"}, "wall": [floor], "duration": 3.0, **fixed(0, 0, 0.5)}
    given |= {"start": {"turn_deg": [10, -20, 5]}}
    settings = RK4 | {"step": 2e-4, "rate": 5000}
    start = flight_start(
        block,
        read_scenario("hover", given | {"integration": settings}),
        lambda *_: None,
        custom_law=False,
    )
    v = np.array([1.0, 0.5, 0.0, 0.5, -1.0, 2.0])
    history = integrate(start.loop, start.loop.start(start.q, v), 3.0, start.scenario.integration)
    energy = stored(start.loop, history.states, SOFT["stiffness"])
    assert np.diff(energy).max() < 1e-6 * energy[0]
    assert energy[-1] < 0.3 * energy[0]
    assert np.linalg.norm(start.loop.parts(history.states[-1]).v) < 1e-3


@pytest.mark.parametrize(
    ("stiffness", "dissipation", "speed"),
    [
        (1e6, 10.0, 15.0),
        pytest.param(2e5, 0.0, 5.0, marks=pytest.mark.slow),
    ],
)
def test_no_impact_adds_energy_at_the_default_step(
    stiffness: float, dissipation: float, speed: float, folder: Path
) -> None:
    """Into a corner, of a body that is free: against the energy with which it begins."""
    module, own = load(folder, "numpy"), {"frame": FEET[0], "stiffness": stiffness}
    own |= {"dissipation": dissipation}
    walls = [
        own | {"point": [0.2005, 0.0, 0.0], "normal": [-1, 0, 0]},
        own | {"point": [0.0, 0.1503, 0.0], "normal": [0, -1, 0]},
    ]
    given = {"control": {"law": "off"}, "wall": walls, "integration": {"method": "rk4"}}
    scenario = read_scenario("hover", given | fixed(0, 0, 0))
    start = flight_start(module, scenario, lambda *_: None, custom_law=False)
    thrown_at = speed * np.array([[1.0, 0.4, 0.0, 0.0, 0.0, 0.0], [0.5, 0.9, 0, 0, 0, 0.3]])
    q = np.tile(start.q, (2, 1))
    long = pytest.warns(RuntimeWarning, match=r"foot_1 meets wall . at .* use steps of at most")
    with long if dissipation else nullcontext():
        found = rollout(module, q, thrown_at, np.zeros(4), 25, 1e-3, walls=scenario.walls)
    ends = [(found.q[:, -1], found.v[:, -1])]
    states = [start.loop.start(*each) for each in zip(q, thrown_at, strict=True)]
    parts = [
        start.loop.parts(integrate(start.loop, x, 0.025, scenario.integration).states[-1])
        for x in states
    ]
    ends += [(each.q[np.newaxis], each.v[np.newaxis]) for each in parts]
    before = module.kinetic_energy(q, thrown_at) + module.potential_energy(q)
    for k, (place, moving) in enumerate(ends):
        energy = module.kinetic_energy(place, moving) + module.potential_energy(place)
        assert np.all(energy <= (before if k == 0 else before[k - 1]) * (1.0 + 1e-12))


@pytest.mark.slow
def test_steps_that_are_too_long_for_an_impact_are_named_with_those_that_serve(
    block: ModuleType,
) -> None:
    """Of a fall on a damper so hard that what leaves it has 1/dissipation as speed, or less."""
    height, dissipation = 12.0, 10.0
    floor = {"kind": "floor", "frame": "base", "stiffness": 1e5, "dissipation": dissipation}
    given = {"duration": 1.6, **fixed(0, 0, height)}
    (note,) = thrown(block, [floor], **given).notes
    assert note.startswith("At t = 1.56 s base meets wall 1 at 15.3 m/s, too fast for its steps")
    serves = float(note.split("at most ")[1].split()[0])
    flight = thrown(block, [floor], **given, integration=RK4 | {"step": serves})
    assert flight.notes == ()
    assert np.abs(flight.v[-1]).max() < 1.0 / dissipation + GRAVITY * 0.04
    walls = read_scenario("hover", {"wall": [floor]}).walls
    fall: Any = np.array([0, 0, 0.01, 0, 0, 0, 1.0]), [0, 0, -15.0, 0, 0, 0], np.zeros(4), 20
    with pytest.warns(RuntimeWarning, match="base meets wall 1 at 15 m/s") as heard:
        hard = rollout(block, *fall, 1e-3, walls=walls, method="euler")
    spring = [replace(walls[0], dissipation=0.0)]
    for met in (hard, rollout(block, *fall, 1e-3, walls=spring, method="euler")):
        assert np.abs(met.v).max() < 15.0 + GRAVITY * 1e-3  # It is 1 cm above at first.
    serves = float(str(heard[0].message).split("at most ")[1].split()[0])
    speeds = rollout(block, *fall, serves, walls=walls, method="euler").v[0, :, 2]
    assert speeds.max() < 1.0


@pytest.mark.slow
def test_jax_warns_of_hard_impacts_as_others_do(
    folder: Path, jax_in_double_precision: ModuleType
) -> None:
    wall = {"kind": "floor", "frame": "base", "stiffness": 1e5, "dissipation": 10.0}
    walls, state = read_scenario("hover", {"wall": [wall]}).walls, [0, 0, 0.01, 0, 0, 0, 1.0]
    heard = []
    for backend in ("numpy", "jax"):
        fall: Any = load(folder, backend), state, [0, 0, -15.0, 0, 0, 0], np.zeros(4), 3, 1e-3
        with pytest.warns(RuntimeWarning, match="base meets wall 1 at 15 m/s") as told:
            rollout(*fall, walls=walls)
        heard.append([str(each.message) for each in told])
    assert heard[0] == heard[1]


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_ball_bounces_as_hunt_and_crossley_say(speed: float, block: ModuleType) -> None:
    """Against the equation of one dimension by SciPy."""
    stiffness, dissipation, radius = 5000.0, 0.3, 0.05
    floor = {"kind": "floor", "frame": "base", "ball_radius": radius, "stiffness": stiffness}
    given = {"control": {"law": "off"}, "wall": [floor | {"dissipation": dissipation}]}
    given |= fixed(0, 0, radius) | {"duration": 0.1, "integration": RK4 | {"rate": 1000}}
    start = flight_start(block, read_scenario("hover", given), lambda *_: None, custom_law=False)
    v = np.array([0.0, 0.0, -speed, 0.0, 0.0, 0.0])
    history = integrate(start.loop, start.loop.start(start.q, v), 0.1, start.scenario.integration)

    def rate(_: float, y: Array) -> list[float]:
        height, rising = y
        pressed = -stiffness * height * (1.0 - dissipation * rising) if height < 0.0 else 0.0
        return [rising, max(pressed, 0.0) / MASS - GRAVITY]

    expected = solve_ivp(rate, (0.0, 0.1), [0.0, -speed], rtol=1e-10, atol=1e-12, max_step=1e-3)
    parts = start.loop.parts(history.states[-1])
    assert parts.q[2] - radius == pytest.approx(expected.y[0, -1], abs=2e-6)
    assert parts.v[2] == pytest.approx(expected.y[1, -1], abs=2e-4)
    assert 0.3 < parts.v[2] / speed < 0.95


@pytest.mark.slow
def test_steps_of_a_millisecond_agree_with_adaptive_ones(block: ModuleType) -> None:
    floor = {"kind": "floor", "frame": FEET, "friction": 0.5} | SOFT
    given = {"duration": 1.5, "start": {"turn_deg": [8, 5, 0]}, **fixed(0, 0, 0.2)}
    found = thrown(block, [floor], **given)
    adaptive = {"relative_tolerance": 1e-8, "absolute_tolerance": 1e-9}
    exact = thrown(block, [floor], **given, integration=adaptive)
    assert found.contact_forces.max() > 20.0
    assert np.abs(found.q - exact.q).max() < 1e-4


SHAPES = {
    "sphere": (Sphere("base", (0.1, -0.2, 0.3), 0.7, 1.0), 0.7),
    "cylinder": (Cylinder("base", (0.1, -0.2, 0.3), (1, 2, -1), 0.5, 1.0), 0.5),
    "box": (Box("base", (0.1, -0.2, 0.3), (0.6, 1.0, 0.4), 1.0, rpy=(0.3, -0.5, 1.1)), 0.0),
}


@pytest.mark.parametrize("name", SHAPES)
def test_depths_are_those_of_the_nearest_points(name: str) -> None:
    """The surface is a depth along the normal away, and no other point of it is nearer."""
    wall, _ = SHAPES[name]
    figures = variable("figures", len(wall.figures), uniform=True)
    place = variable("place", 3)
    depth, normal = wall.surface(figures, place)
    program = Program("surface", (figures, place), {"depth": depth, "normal": normal})
    places = np.random.default_rng(4).normal(size=(200, 3))

    def found(at: Array) -> tuple[Array, Array]:
        got = evaluate(program, {"figures": np.array(wall.figures), "place": at}, {})
        return got["depth"], got["normal"]

    depths, normals = found(places)
    assert (depths > 0.0).any()
    assert (depths < 0.0).any()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert found(places + depths[:, np.newaxis] * normals)[0] == pytest.approx(0.0, abs=1e-12)
    directions = np.random.default_rng(5).normal(size=(100, 1, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    nearer = found(places + 0.999 * np.abs(depths)[:, np.newaxis] * directions)[0]
    assert np.all(np.sign(nearer) == np.sign(depths))


# From the floor and back, with motors that run from 0.5 s to 9 s. The path begins below the floor,
# so that thrusts grow slowly.
FLOOR = {"kind": "floor", "frame": FEET, "friction": 0.6, "damping": 20.0} | SOFT
TRIP: dict[str, Any] = {
    "base": {
        "path": {
            "kind": "waypoints",
            "times": [1, 4, 5, 8],
            "points": [[0, 0, -0.1], [0.3, 0, 1], [0.3, 0, 1], [0.3, 0, HEIGHT]],
        }
    },
    "start": {"settled": True},
    "motors": {"begin": 0.5, "end": 9.0},
    "wall": [FLOOR],
    "integration": RK4,
}


# On the floor below where it is to hover, which takes no time to plan.
STANDING = TRIP | fixed(0, 0, HEIGHT)


@pytest.mark.slow
def test_a_machine_takes_off_and_lands_without_a_jump(block: ModuleType) -> None:
    flight = simulate(block, read_scenario("hover", TRIP | {"duration": 10.0}))
    assert not flight.stopped
    height, pressed = flight.point("base")[:, 2], flight.contact_forces.sum(axis=1)
    idle = flight.time < 0.5
    assert np.ptp(height[idle]) < 1e-12
    assert pressed[idle] == pytest.approx(MASS * GRAVITY, rel=1e-9)
    assert not flight.applied[idle].any()
    stands = np.flatnonzero(np.diff(pressed > 0.01))
    assert len(stands) == 2  # It leaves the floor once, and comes back once.
    assert 1.0 < flight.time[stands[0]] < 2.0
    assert 7.5 < flight.time[stands[1]] < 9.1
    rise = height[flight.time < 4.0]
    assert np.all(rise > np.maximum.accumulate(rise) - 5e-4)  # The feet give way by 1.2 mm.
    assert height[-1] == pytest.approx(height[0], abs=1e-6)
    assert pressed[-1] == pytest.approx(MASS * GRAVITY, rel=1e-3)
    assert np.abs(flight.applied[-1]).max() < 1e-10


@pytest.mark.slow
def test_a_start_at_rest_is_that_of_rollouts_many_flights_and_loops(block: ModuleType) -> None:
    scenario = read_scenario("hover", STANDING | {"duration": 0.4, "motors": {"begin": 0.2}})
    flight = simulate(block, scenario)
    found = rollout(block, None, None, scenario, 400, 0.001, every=10)
    np.testing.assert_allclose(found.q[0], flight.q, rtol=0.0, atol=1e-12)
    heavier = replace(scenario, plant={"base_mass": 3.0})
    alike, other = simulate_many(block, [scenario, heavier])
    assert isinstance(alike, Flight)
    assert isinstance(other, Flight)
    np.testing.assert_allclose(alike.q, flight.q, rtol=0.0, atol=1e-12)
    assert np.abs(other.a[0]).max() < 1e-6
    assert other.q[0, 2] < flight.q[0, 2] - 1e-4
    simulation = Simulation(block, scenario)
    simulation.step(np.full(4, 6.0), 0.19)
    np.testing.assert_allclose(simulation.q, flight.q[0], rtol=0.0, atol=1e-12)
    simulation.step(np.full(4, 6.0), 0.3)
    assert simulation.q[2] > flight.q[0, 2] + 0.01
    loop = flight_start(block, scenario, lambda *_: None, custom_law=False).loop
    state = loop.start(flight.q[0], flight.v[0] + 0.1)
    for idle in (True, False):
        loads = Loads(idle=idle)
        compiled = CompiledLoop(loop, np.inf, loads).slope(0.0, state)
        np.testing.assert_allclose(compiled, loop.derivative(0.0, state, loads), atol=1e-11)


@pytest.mark.slow
def test_the_first_sample_on_a_slope_is_of_a_machine_that_is_held(block: ModuleType) -> None:
    at_rest = on_slope(20.0, 0.5, duration=0.02, start={"turn_deg": [0, 20, 0], "settled": True})
    seen: list[Any] = [Simulation(block, at_rest).reset()]

    def own(observation: Any) -> NDArray[np.float64]:
        seen.append((observation.wrenches, observation.a))
        return np.zeros(4)

    simulate(block, at_rest, own)
    for wrenches, a in [(seen[0].wrenches, seen[0].a), seen[1]]:
        np.testing.assert_allclose(wrenches.sum(axis=0)[:3], [0, 0, MASS * GRAVITY], atol=1e-4)
        np.testing.assert_allclose(a, 0.0, atol=1e-4)


@pytest.mark.slow
def test_a_flight_does_not_depend_on_others_beside_it_or_before(block: ModuleType) -> None:
    at_rest = on_slope(20.0, 0.5, duration=0.1, start={"turn_deg": [0, 20, 0], "settled": True})
    moving = replace(at_rest, start=replace(at_rest.start, settled=False))
    heavier = replace(at_rest, plant={"base_mass": 3.0})
    scenarios = [at_rest, moving, heavier]
    alone = [simulate(block, each) for each in scenarios]
    # The second call knows what the first found.
    for order in ([1, 0, 2], [1, 0, 2], [0]):
        for place, flight in zip(
            order, simulate_many(block, [scenarios[i] for i in order]), strict=True
        ):
            assert isinstance(flight, Flight)
            np.testing.assert_allclose(flight.q, alone[place].q, rtol=0.0, atol=1e-9)
            friction, expected = flight.contact_friction[0], alone[place].contact_friction[0]
            np.testing.assert_allclose(friction, expected, rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_a_machine_that_leans_comes_to_stand_on_all_of_its_feet(block: ModuleType) -> None:
    leaning = {"start": {"settled": True, "turn_deg": [2, 3, 0]}, "duration": 0.2}
    flight = simulate(block, read_scenario("hover", STANDING | leaning))
    assert flight.contact_forces == pytest.approx(MASS * GRAVITY / 4.0, rel=1e-6)
    assert flight.q[:, 3:5] == pytest.approx(0.0, abs=1e-6)  # Its heading is free.


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wall": []}, r"start.settled: there is no \[\[wall\]\]"),
        ({"wall": [FLOOR | {"height": -1.0}]}, r"start.settled: no wall within 0.5 m .* carries"),
    ],
)
def test_a_start_where_nothing_rests_is_refused(
    changes: dict[str, Any], words: str, block: ModuleType
) -> None:
    with pytest.raises(UsageError, match=words):
        simulate(block, read_scenario("hover", STANDING | {"duration": 1.0} | changes))


def test_bristles_that_are_too_stiff_for_the_steps_are_refused(block: ModuleType) -> None:
    floor = {"kind": "floor", "frame": "base", "stiffness": 100, "friction": 0.3}
    for own, words in (
        ({"bristle_stiffness": 3e7}, r"the bristles of the wall at base, which feel a mass of 2"),
        ({"bristle_damping": 0.01}, r"the bristles of the wall at base; use .* more of their damp"),
    ):
        with pytest.raises(UsageError, match=words):
            thrown(block, [floor | own], duration=0.1)


@pytest.mark.slow
def test_nothing_pushes_a_frame_at_a_centre(block: ModuleType) -> None:
    wall: dict[str, Any] = {"kind": "cylinder", "point": [0, 0, 0], "axis": [0, 0, 1]}
    wall |= {"frame": "base", "radius": 0.1, "stiffness": 100}
    flight = thrown(block, [wall], duration=0.01, **fixed(0, 0, 1))
    assert flight.contact_depth[0] == pytest.approx([0.1])
    assert flight.q[-1, :2] == pytest.approx(0.0)


@pytest.mark.slow
def test_rollouts_of_inputs_touch_walls_in_numpy_and_c(folder: Path, block: ModuleType) -> None:
    """With motors that lag; controllers, which end at samples, carry bristles on."""
    plane = {"frame": "base", "point": [0.1, 0, 0], "normal": [-1, 0, 0.2], "ball_radius": 0.05}
    scenario = read_scenario("hover", {"wall": [FLOOR, plane | {"stiffness": 800}]})
    random = np.random.default_rng(7)
    q0 = np.tile([0.0, 0.0, 0.11, 0.03, 0.02, 0.0, 1.0], (5, 1))
    v0 = 0.3 * random.normal(size=(5, 6))
    u = random.uniform(2.0, 5.0, (5, 1, 4))
    options: dict[str, Any] = {"every": 20, "walls": scenario.walls, "time_constants": 0.03}
    found = {
        backend: rollout(load(folder, backend), q0, v0, u, 120, 1e-3, **options)
        for backend in ("numpy", "c")
    }
    exact = found["numpy"]
    assert exact.bristles is not None
    assert exact.bristles.shape == (5, 7, 12)
    assert np.abs(exact.bristles).max() > 1e-4
    for name in ("q", "v", "thrusts", "bristles"):
        expected = getattr(exact, name)
        np.testing.assert_allclose(getattr(found["c"], name), expected, rtol=0.0, atol=1e-10)
    led = rollout(block, q0, v0, lambda t, q, v: u[:, 0], 120, 1e-3, **options)
    np.testing.assert_allclose(led.q, exact.q, rtol=0.0, atol=1e-10)
    single = rollout(block, q0, v0, u, 120, 1e-3, precision="single", **options)
    np.testing.assert_allclose(single.q, exact.q, rtol=0.0, atol=1e-3)
    # A loop of one's own integrates thrusts and entries of quaternions instead.
    simulation = Simulation(block, replace(scenario, integration=Settings(method="rk4")))
    simulation.reset(q0[0], v0[0])
    simulation.step(u[0, 0], 0.12)
    np.testing.assert_allclose(simulation.q, exact.q[0, -1], rtol=0.0, atol=1e-6)
    with pytest.raises(UsageError, match=r"walls: wall 1: frame: block has no frame tip"):
        rollout(block, q0, v0, u, 2, 1e-3, walls=[replace(scenario.walls[0], frame="tip")])
    with pytest.raises(UsageError, match=r"dt: in steps of 0.2 s rk4 .* because of the "):
        rollout(block, q0, v0, u, 2, 0.2, walls=scenario.walls)


@pytest.mark.slow
def test_rollouts_refuse_steps_that_are_too_long_for_walls(block: ModuleType) -> None:
    """Of a mass m on a spring s and a damper c, in closed form; of the lightest state."""
    start: Any = [0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 1.0], np.zeros(6), np.zeros(4), 1
    floor = {"kind": "floor", "frame": "base", "stiffness": 4000.0}

    def fly(dt: float, own: dict[str, Any], **options: Any) -> None:
        walls = read_scenario("hover", {"wall": [floor | own]}).walls
        rollout(block, *start, dt, walls=walls, **options)

    # Explicit Euler bears c/s, semi-implicit Euler what det and trace of its matrix say.
    rough = {"friction": 0.5, "bristle_damping": 20.0}
    frequency, most = np.sqrt(4000.0 / MASS), 20.0 / 4000.0
    fly(1.01 * most, rough)
    for ratio in (0.3, 3.0):
        soft = {"damping": 2.0 * ratio * frequency * MASS}
        longest = 2.0 * (np.sqrt(ratio**2 + 1.0) - ratio) / frequency
        for limit, own in ((most, rough), (longest, soft)):
            fly(0.99 * limit, own, method="euler")
            with pytest.raises(UsageError, match=r"euler makes errors grow, because of the .*wall"):
                fly(1.01 * limit, own, method="euler")
    for masses in ([2.0, 3.0], 2.5):
        fly(2.7 / frequency, {}, parameters={"base_mass": masses})
    for masses in ([2.0, 0.5, 3.0], 0.5):
        with pytest.raises(UsageError, match=r"feels a mass of 0.5 kg"):
            fly(2.7 / frequency, {}, parameters={"base_mass": masses})


@pytest.mark.parametrize("walls", ["slope.toml", [{"frame": "base"}], [3], 1])
def test_rollouts_refuse_what_are_no_walls(walls: Any, block: ModuleType) -> None:
    start: Any = [0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 1.0], np.zeros(6), np.zeros(4), 1
    with pytest.raises(UsageError, match=r"walls: must be walls as read_scenario\(…\)\.walls has"):
        rollout(block, *start, 1e-3, walls=walls)


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"frame": []}, r"wall 1: frame: must have at least one name, each once"),
        ({"frame": ["a", "a"]}, r"wall 1: frame: must have at least one name, each once"),
        ({"frame": ["a", 3]}, r"wall 1: frame: must be a list of names, not of a number"),
        ({"frame": 3}, r"wall 1: frame: must be a name, or a list of names, not a number"),
        ({"frame": [str(k) for k in range(21)]}, r"wall 1: frame: 21 names; give at most 20"),
        ({"bristle_damping": 1}, r"wall 1: bristle_damping: needs a friction above 0 beside it"),
        ({"kind": "ball"}, r"must be one of 'plane', 'floor', 'cylinder', 'sphere', 'box', not 'b"),
        ({"ball_radius": -1}, r"wall 1: ball_radius: must be at least 0, not -1"),
    ],
)
def test_walls_that_mean_nothing_are_refused(own: dict[str, Any], words: str) -> None:
    floor = {"kind": "floor", "frame": "base", "stiffness": 1.0}
    with pytest.raises(ScenarioFileError, match=words):
        read_scenario("hover", {"wall": [floor | own]})
