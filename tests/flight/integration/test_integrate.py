"""Integration: order, conservation, energy balance, early ends, both ways against each other."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from scipy.signal import impulse, lti
from support.angle_rates import rate_matrix
from support.emitted import emitted_module

from gibbs_codegen.flight.control.laws import Controller, Gains
from gibbs_codegen.flight.desired.trajectory import desired_motion
from gibbs_codegen.flight.integration import compiled_loop
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoop
from gibbs_codegen.flight.integration.envelope import Envelope, Mode
from gibbs_codegen.flight.integration.integrators import integrate
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.recording import flight_of
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import Tangent
from gibbs_codegen.flight.scenario.parts import Control, Motors, Push, Settings
from gibbs_codegen.flight.scenario.paths import Circle, Harmonic, Term
from gibbs_codegen.flight.scenario.scenario import ArmTask, Scenario
from gibbs_codegen.flight.simulation import flight_start, simulate
from gibbs_codegen.robot.file import read_robot

Load = Callable[[str], ModuleType]

TIGHT = Settings(relative_tolerance=1e-12, absolute_tolerance=1e-13)
# Thrown, spinning, with the arm bent: nothing is symmetric and everything moves.
TUMBLE = Scenario(
    "tumble",
    1.0,
    Circle((0.0, 0.0, 2.0), 1.5, 3.0, normal=(0.3, 0.2, 1.0)),
    arm=ArmTask(tip=Circle((0.5, 0.0, -1.0), 1.5, 2.5, normal=(0.2, 1.0, 0.4))),
    control=Control(law="off"),
    integration=TIGHT,
)


def momenta(module: ModuleType, constants: object, flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """Linear momentum, and angular momentum about the world's origin, of every sample."""
    mass = module.mass_matrix(flight.q, constants=constants)
    generalised = np.einsum("sij,sj->si", mass, flight.v)
    linear = generalised[:, -3:]
    turn = np.swapaxes(rate_matrix(module.ATTITUDE, flight.q[:, :3]), -1, -2)
    about_origin_point = np.linalg.solve(turn, generalised[:, :3, np.newaxis])[..., 0]
    return linear, about_origin_point + np.cross(flight.q[:, -3:], linear)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_without_gravity_and_inputs_energy_and_momentum_stay(name: str, fast: Load) -> None:
    module = fast(name)
    scale = 1.0 if name == "hexarotor_3link" else 0.2
    scenario = replace(
        TUMBLE,
        duration=10.0,
        base=Circle((0.0, 0.0, 2.0), scale, 9.0, normal=(0.3, 0.2, 1.0)),
        arm=ArmTask(posture={module.COORDINATES[4]: 0.7, module.COORDINATES[5]: -0.6}),
        attitude=replace(read_scenario("circle").attitude),
        parameters={"gravity": 0.0},
    )
    flight = simulate(module, scenario)
    assert not flight.stopped
    assert flight.time[-1] == 10.0
    # Nothing of it is at rest, so that conservation says something.
    assert np.ptp(flight.q[:, 3:6], axis=0).max() > 0.1
    assert flight.kinetic_energy == pytest.approx(flight.kinetic_energy[0], rel=1e-10)
    constants = module.prepare({"gravity": 0.0})
    for momentum in momenta(module, constants, flight):
        size = np.linalg.norm(momentum[0])
        assert size > 1e-3
        assert momentum == pytest.approx(np.tile(momentum[0], (len(momentum), 1)), abs=1e-10 * size)


def test_the_centre_of_mass_falls_freely(fast: Load) -> None:
    module = fast("hexarotor_3link")
    flight = simulate(module, TUMBLE)
    linear, _ = momenta(module, None, flight)
    mass = module.mass_matrix(flight.q[0])[-1, -1]
    fallen = -mass * 9.81 * flight.time
    assert linear[:, 2] - linear[0, 2] == pytest.approx(fallen, abs=1e-9 * mass)
    assert linear[:, :2] == pytest.approx(np.tile(linear[0, :2], (len(linear), 1)), abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["off"])
@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_fixed_steps_are_of_fourth_order_with_gravity_on(name: str, law: str, fast: Load) -> None:
    module = fast(name)
    joints = module.COORDINATES[3:-3]
    posture = dict(zip(joints, (0.3, -0.8, 0.9, 0.5, -0.4, 0.6, 0.2), strict=False))
    scenario = read_scenario(
        "circle",
        {"start": {"offset": [0.2, 0.1, 0], "turn_deg": [5, 8, 0]}, "control": {"law": law}},
    )
    scenario = replace(scenario, duration=0.64, arm=ArmTask(posture=posture))
    exact = simulate(module, replace(scenario, integration=TIGHT))
    errors = []
    steps = (0.032, 0.016, 0.008) if law == "off" else (0.016, 0.008, 0.004)
    for step in steps:
        # Steps are no longer than the interval of samples.
        settings = Settings(method="rk4", step=step, rate=1.0 / steps[0])
        flight = simulate(module, replace(scenario, integration=settings))
        errors.append(np.linalg.norm(flight.q[-1] - exact.q[-1]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] > 1e-12
    assert orders == pytest.approx(4.0, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["paper"])
def test_energy_balances_to_1e_8(scenario: str, fast: Load) -> None:
    flight = simulate(fast("hexarotor_3link"), read_scenario(scenario))
    # In hover the energies vanish: then against the weight, by a metre.
    weight = 9.81 * fast("hexarotor_3link").mass_matrix(flight.q[0])[-1, -1]
    assert np.abs(flight.energy_error).max() <= 1e-8 * max(np.abs(flight.work).max(), weight)


@pytest.mark.slow
def test_both_methods_fly_the_same(fast: Load) -> None:
    scenario = read_scenario("paper", {"start": {"turn_deg": [10, 0, 0]}, "duration": 2.0})
    adaptive = simulate(fast("hexarotor_3link"), scenario)
    fixed = simulate(fast("hexarotor_3link"), replace(scenario, integration=Settings(method="rk4")))
    assert np.array_equal(adaptive.time.round(9), fixed.time.round(9))
    assert adaptive.q == pytest.approx(fixed.q, abs=1e-8)


@pytest.mark.slow
def test_steps_that_meet_a_limit_are_taken_in_python(fast: Load, shipped: Load) -> None:
    """C hands back steps whose thrusts meet a limit; with NumPy all steps are Python's."""
    scenario = replace(
        read_scenario("line", {"start": {"offset": [0.3, 0, 0]}, "duration": 1.0}),
        motors=Motors((-10.0, 15.5)),
        integration=Settings(method="rk4", step=0.004),
    )
    quick, slow = (simulate(load("octorotor_7link"), scenario) for load in (fast, shipped))
    limited = np.any(
        (quick.applied[:, :8] > 15.5 - 1e-9) | (quick.applied[:, :8] < -10 + 1e-9), axis=1
    )
    assert 0 < np.sum(limited) < len(limited)
    assert quick.q == pytest.approx(slow.q, abs=1e-9)
    assert np.all((quick.applied[:, :8] <= 15.5) & (quick.applied[:, :8] >= -10))


def stop_time(flight: Flight) -> float:
    """When a flight ended, as its reason tells."""
    found = re.search(r"at t = (\S+) s", flight.stopped)
    assert found
    return float(found[1])


ADAPTIVE = {"method": "adaptive", "relative_tolerance": 1e-7, "absolute_tolerance": 1e-8}

# Flights in which control is lost: a robot, a scenario, and what loses it.
LOST: list[tuple[str, str, dict[str, object]]] = [
    ("hexarotor_3link", "paper", {"motors": {"time_constant": 0.02, "compensation": False}}),
    ("decarotor_3link", "paper", {"motors": {"time_constant": 0.02, "compensation": False}}),
    (
        "octorotor_7link",
        "line",
        {
            "motors": {"time_constant": 0.2, "compensation": False},
            "control": {"frequency": 20},
            "start": {"offset": [0.3, 0, 0]},
        },
    ),
]


def test_control_of_what_nothing_drives_is_not_lost(fast: Load) -> None:
    """A joint without effort turns as far and as fast as it likes, as a wheel does."""
    scenario = read_scenario("hover")
    start = flight_start(fast("quadrotor_arm_2link"), scenario, lambda *_: None, custom_law=False)
    actuators = replace(start.loop.actuators, efforts=np.array([4.0, 0.0]))
    loop, layout = replace(start.loop, actuators=actuators), start.loop.vehicle.layout
    for place, reason in enumerate(("upper_arm is 20 rad off", "")):
        q, v = start.q.copy(), start.v.copy()
        q[layout.q.joints][place] += 20.0
        v[layout.v.joints][place] += 10.0
        found = Envelope(loop, 1.0, 10.0).reason(0.0, loop.start(q, v))
        assert reason in found
        assert bool(found) == bool(reason)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["adaptive"])
@pytest.mark.parametrize("backend", ["numpy"])
@pytest.mark.parametrize(("robot", "name", "changes"), LOST[:1])
def test_a_lost_flight_ends_with_its_reason(
    robot: str,
    name: str,
    changes: dict[str, object],
    method: str,
    backend: str,
    fast: Load,
    shipped: Load,
) -> None:
    """As a loss of control, before it runs away from what numbers and steps can follow."""
    integration = {**ADAPTIVE, "method": method}
    scenario = read_scenario(name, {**changes, "duration": 0.6, "integration": integration})
    module = (fast if backend == "c" else shipped)(robot)
    flight = simulate(module, scenario)
    assert re.match(
        r"at t = \S+ s control is lost: (the rate of )?\w+ is \S+ (rad|m)(/s)? off", flight.stopped
    )
    assert (
        "try motors.compensation, a shorter motors.time_constant, a lower control.frequency"
        in flight.stopped
    )
    assert abs(stop_time(flight) - flight.time[-1]) <= 1.0 / scenario.integration.rate
    assert len(flight.time) > 1
    assert flight.time[-1] < 0.6
    assert np.abs(flight.q - flight.q_desired).max() <= scenario.integration.divergence
    # Errors that are damped critically swing out to rate / (e frequency).
    rates = np.abs(flight.v - flight.v_desired).max()
    assert rates <= scenario.integration.divergence * np.e * scenario.control.frequency
    if method == "adaptive":
        energy = np.ptp(flight.kinetic_energy) + np.ptp(flight.potential_energy)
        assert np.abs(flight.energy_error).max() <= 1e-4 * energy
    for series in (flight.a, flight.constraint_torques, flight.work):
        assert np.all(np.isfinite(series))


@pytest.mark.parametrize(
    ("robot", "changes"),
    [
        *(
            (
                "hexarotor_3link",
                {
                    "start": {"offset": [0.2, 0, 0], "turn_deg": [0, 10, 0]},
                    "integration": integration,
                },
            )
            for integration in ({"method": "rk4"}, ADAPTIVE)
        ),
        ("hexarotor_3link", {"start": {"offset": [5, -5, 3], "turn_deg": [60, 20, 90]}}),
        *(
            pytest.param(
                "octorotor_7link", {"motors": motors, "start": start}, marks=pytest.mark.slow
            )
            for motors, start in (
                ({"time_constant": 0.05}, {"offset": [1, 0, 0]}),
                ({"limits": [-20, 25]}, {"offset": [0.5, 0, 0]}),
            )
        ),
        ("hexarotor_3link", {"tip_force": {"force": [60, -40, 50], "begin": 0.2, "end": 0.5}}),
        ("hexarotor", {"control": {"frequency": 40}, "start": {"offset": [9, 9, 9]}}),
        ("hexarotor", {"control": {"frequency": 0.01}, "start": {"offset": [9, 9, 9]}}),
        (
            "hexarotor",
            {"control": {"frequency": 20, "damping_ratio": 0}, "start": {"offset": [19, 0, 0]}},
        ),
    ],
)
def test_a_flight_that_recovers_is_not_lost(
    robot: str, changes: dict[str, object], fast: Load
) -> None:
    more = {"duration": 2.5, "integration": {"method": "rk4"}, **changes}
    flight = simulate(fast(robot), read_scenario("hover", more))
    assert not flight.stopped
    assert flight.time[-1] == 2.5
    error = np.linalg.norm(flight.q - flight.q_desired, axis=1)
    assert error.max() > 0.02
    if "control" not in changes:
        assert error[-1] < 0.1 * error.max()


@pytest.mark.slow
def test_the_bound_on_rates_is_where_an_error_would_swing_out_too_far(fast: Load) -> None:
    """An error with such a rate at the start, and no other, comes as far as may be and no farther.

    By SciPy's response to an impulse; for all damping, and in flights too short to swing out.
    """
    vehicle = Vehicle(fast("hexarotor"))
    reference = desired_motion(vehicle, read_scenario("hover"))
    allocation = Allocation(vehicle.thrust_wrenches())
    for frequency, ratio, duration in (
        (5.0, 1.0, 4.0),
        (5.0, 0.0, 4.0),
        (2.0, 0.3, 9.0),
        (3.0, 0.999999, 9.0),
        (3.0, 4.0, 9.0),
        (0.01, 1.0, 0.5),
    ):
        gains = Gains.of(frequency, ratio, 6)
        controller = Controller(vehicle, reference, allocation, gains)
        loop = ClosedLoop(vehicle, controller, Actuators.unlimited(vehicle))
        bounds = Envelope(loop, 20.0, duration).bounds
        assert np.array_equal(bounds[:6], np.full(6, 20.0))
        system = lti([1.0], [1.0, 2.0 * ratio * frequency, frequency**2])
        _, response = impulse(system, T=np.linspace(0.0, duration, 100_001))
        assert bounds[6:] * response.max() == pytest.approx(20.0, rel=0.005)
        for law, count in (("open_loop", 6), ("off", 0)):
            free = replace(loop, controller=replace(loop.controller, law=law))
            assert np.isfinite(Envelope(free, 20.0, duration).bounds).sum() == count


@pytest.mark.parametrize("law", ["off", "computed_torque"])
@pytest.mark.parametrize("method", ["adaptive", "rk4"])
def test_lagging_thrusts_start_within_their_limits(law: str, method: str, fast: Load) -> None:
    changes = {
        "motors": {"limits": [3, 5], "time_constant": 0.05},
        "control": {"law": law},
        "duration": 0.2,
        "integration": {"method": method},
    }
    flight = simulate(fast("hexarotor"), read_scenario("hover", changes))
    thrusts = flight.applied[:, :6]
    assert np.all((thrusts >= 3.0 - 1e-9) & (thrusts <= 5.0 + 1e-9))
    assert np.all(np.clip(flight.commanded[0, :6], 3.0, 5.0) == thrusts[0])


@pytest.mark.parametrize("method", ["adaptive", "rk4"])
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_flight_ends_at_the_singular_attitude(
    method: str, backend: str, fast: Load, shipped: Load
) -> None:
    """Left alone while it pitches, the base turns on to theta_0 = 90°, and stops there."""
    hill = Harmonic(x=(Term(10.0, growth=0.1),), z=(Term(0.3, frequency=2.0),))
    scenario = Scenario(
        "pitch",
        5.0,
        hill,
        Tangent(1),
        control=Control("off"),
        integration=Settings(method=method),
    )
    flight = simulate((fast if backend == "c" else shipped)("hexarotor"), scenario)
    assert "singularity of the sequence xyz" in flight.stopped
    assert f"t = {flight.time[-1]:.6g} s" in flight.stopped
    assert flight.q[-1, 1] == pytest.approx(np.pi / 2, abs=0.01)
    assert np.all(np.isfinite(flight.a))


@pytest.mark.slow
@pytest.mark.parametrize("attitude", ["yzx"])
def test_flights_end_at_the_singularity_of_every_sequence(attitude: str) -> None:
    """From either side, and where a step of rk4 goes all the way round: with numbers throughout."""
    robot = read_robot("hexarotor")[0]
    vehicle = Vehicle(emitted_module(replace(robot, base=replace(robot.base, attitude=attitude))))
    scenario = read_scenario("hover")
    gains = Gains.of(1.0, 1.0, len(vehicle.coordinates))
    reference = desired_motion(vehicle, scenario)
    allocation = Allocation(vehicle.thrust_wrenches())
    controller = Controller(vehicle, reference, allocation, gains, "off")
    loop = ClosedLoop(vehicle, controller, Actuators.unlimited(vehicle))
    q, v, _ = reference(0.0)
    one, round_and_round = Settings("rk4"), Settings("rk4", step=0.1, rate=10.0)
    for sign, rate, settings in (
        *((sign, 8.0, settings) for sign in (1.0, -1.0) for settings in (Settings(), one)),
        (1.0, 55.0, round_and_round),
    ):
        q[1], v[1] = sign * 1.2, sign * rate
        history = integrate(loop, loop.start(q, v), 2.0, settings)
        theta_0 = np.degrees(history.states[-1, 1])
        assert history.stopped == (
            f"at t = {history.time[-1]:.6g} s the attitude reaches the singularity of the sequence "
            f"{attitude} (theta_0 = {theta_0:.4g}°)"
        )
        if settings is round_and_round:
            assert np.cos(history.states[-1, 1]) > 0.5
        else:
            assert history.time[-1] < 0.1
            assert theta_0 == pytest.approx(90.0 * sign, abs=1.0)
        flight = flight_of(loop, scenario, history)
        for name, series in vars(flight).items():
            finite = not isinstance(series, np.ndarray) or np.all(np.isfinite(series))
            assert finite or name in {"input_limits", "motor_times"}, name


@pytest.mark.parametrize("rate", [7.0])
@pytest.mark.parametrize(("begin", "end"), [(0.1033, 0.2071), (0.0501, 0.0502), (1e-5, 9.0)])
def test_samples_are_at_the_rate_asked_for(
    rate: float, begin: float, end: float, fast: Load
) -> None:
    """On one grid, whatever the push breaks up, and at the last instant."""
    push = Push((0.1, 0.0, 0.2), begin, end)
    for duration in (0.3, 0.4004):
        count = int(duration * rate + 1e-9)
        wanted = np.arange(count + 1) / rate
        if duration - wanted[-1] > 1e-9:
            wanted = np.append(wanted, duration)
        for method in ("adaptive", "rk4"):
            scenario = read_scenario(
                "hover", {"duration": duration, "integration": {"method": method, "rate": rate}}
            )
            flight = simulate(fast("hexarotor_3link"), replace(scenario, push=push))
            assert flight.time.shape == wanted.shape
            assert flight.time == pytest.approx(wanted, rel=1e-15)
            assert flight.time[-1] == duration


@pytest.mark.parametrize("step", [0.003, 0.02])
def test_fixed_steps_are_no_longer_than_asked_for(
    step: float, fast: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def counted(
        loop: ClosedLoop, time: float, state: np.ndarray, ahead: float, loads: Loads
    ) -> np.ndarray:
        calls.append((time, ahead))
        return taken(loop, time, state, ahead, loads)

    taken = ClosedLoop.step
    monkeypatch.setattr(ClosedLoop, "step", counted)
    monkeypatch.setattr(compiled_loop, "is_compiled", lambda *_: False)
    settings = Settings(method="rk4", step=step, rate=60.0)
    push = Push((0.1, 0.0, 0.2), 0.0333, 0.0777)
    scenario = replace(read_scenario("hover", {"duration": 0.11}), push=push)
    simulate(fast("hexarotor"), replace(scenario, integration=settings))
    begins, sizes = np.array(calls).T
    assert np.all((sizes > 1e-9) & (sizes <= step * (1.0 + 1e-9)))
    assert begins[1:] == pytest.approx((begins + sizes)[:-1], abs=1e-12)
    assert begins[-1] + sizes[-1] == pytest.approx(0.11, abs=1e-15)
    # No more steps than the grid needs, and one for each instant off it: of push and end.
    assert len(sizes) <= int(np.ceil(0.11 * 60.0 * np.ceil(1.0 / (60.0 * step)))) + 2


def test_a_push_begins_and_ends_when_it_should(fast: Load) -> None:
    push = Push((0.0, 0.0, 1.0), 0.503, 0.707)
    off = Scenario(
        "push",
        1.0,
        Circle((0, 0, 0), 1e-9, 1.0),
        control=Control("off"),
        push=push,
        parameters={"gravity": 0.0},
    )
    for settings in (TIGHT, Settings(method="rk4")):
        module = fast("hexarotor")
        flight = simulate(module, replace(off, integration=settings))
        mass = module.mass_matrix(flight.q[0])[-1, -1]
        speed = np.clip(flight.time - 0.503, 0, 0.204) / mass
        assert flight.v[:, -1] == pytest.approx(speed, abs=1e-6)
        assert flight.work == pytest.approx(0.5 * mass * speed**2, abs=1e-6)


def counted_derivatives(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Times at which derivatives are evaluated, in Python or in C, as they are."""
    times: list[float] = []
    evaluate, compiled = ClosedLoop.derivative, CompiledLoop.slope

    def derivative(loop: ClosedLoop, time: float, state: np.ndarray, loads: Loads) -> np.ndarray:
        times.append(time)
        return evaluate(loop, time, state, loads)

    def rate(loop: CompiledLoop, time: float, state: np.ndarray) -> np.ndarray | None:
        times.append(time)
        return compiled(loop, time, state)

    monkeypatch.setattr(ClosedLoop, "derivative", derivative)
    monkeypatch.setattr(CompiledLoop, "slope", rate)
    return times


@pytest.mark.parametrize(
    ("changes", "advice"),
    [
        ({"motors": {"limits": [0, 5]}}, "together reach 30 N, less than the weight, 88.29 N; w"),
        (
            {"motors": {"limits": [-45, 45]}, "start": {"offset": [2, 0, 0]}},
            r"^at t = 0 s .*integration.divergence\); begin nearer .* \(start.offset, .* greater",
        ),
        (
            {"motors": {"limits": [-45, 45]}, "start": {"offset": [0.9, 0, 0]}},
            r"limits: F_1.*; try a start nearer .* \(start.offset, start.turn_deg\), wider motors",
        ),
        (  # So near it is on its path.
            {"motors": {"limits": [0, 15]}, "start": {"offset": [1e-9, 0, 0]}},
            "limits: F_1.*; try wider motors.limits, ",
        ),
        (
            {
                "motors": {"time_constant": 0.05, "compensation": False},
                "control": {"rate": 300, "frequency": 10, "attitude_frequency": 40},
                "start": {"offset": [0.3, 0, 0]},
            },
            "; try a lower control.attitude_frequency, a lower control.frequency, a shorter motors",
        ),
    ],
)
def test_advice_is_what_applies(
    changes: dict[str, object], advice: str, fast: Load, caplog: pytest.LogCaptureFixture
) -> None:
    """What is known before a flight is told then as well."""
    settings = {"method": "rk4", "divergence": 1}
    scenario = read_scenario("hover", {**changes, "duration": 2, "integration": settings})
    assert re.search(advice, simulate(fast("hexarotor_3link"), scenario).stopped)
    assert ("less than the weight" in caplog.text) == ("less than the weight" in advice)


# Flights that adaptive steps cannot take


@pytest.mark.parametrize(
    ("robot", "scenario", "changes"),
    [("hexarotor", "hover", {"motors": {"limits": [0, 20]}})],
)
def test_a_flight_at_limits_gets_to_its_end(
    robot: str,
    scenario: str,
    changes: dict[str, object],
    fast: Load,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Although slopes have kinks there, over which tight tolerances would creep."""
    times = counted_derivatives(monkeypatch)
    flight = simulate(fast(robot), read_scenario(scenario, changes))
    assert not flight.stopped
    assert len(times) <= 10_000
    fixed = {**changes, "integration": {"method": "rk4", "divergence": 1e12}, "duration": 0.5}
    other = simulate(fast(robot), read_scenario(scenario, fixed))
    assert flight.q[:50] == pytest.approx(other.q[:50], abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("last", [0.505, 0.0])
def test_limits_and_lag_are_named_where_no_step_is_small_enough(
    last: float, fast: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The state that the last step came to is the last sample, also where that is the first."""
    evaluate = ClosedLoop.derivative

    def derivative(loop: ClosedLoop, time: float, state: np.ndarray, loads: Loads) -> np.ndarray:
        return evaluate(loop, time, state, loads) * (np.nan if time > last or last == 0.0 else 1.0)

    monkeypatch.setattr(ClosedLoop, "derivative", derivative)
    monkeypatch.setattr(compiled_loop, "is_compiled", lambda *_: False)
    changes = {"motors": {"limits": [-20, 0], "time_constant": 0.5}}
    scenario = read_scenario("hover", {**changes, "integration": {"divergence": 1e3}})
    flight = simulate(fast("hexarotor"), scenario)
    assert "no step is small enough" in flight.stopped
    assert "saturated inputs: F_" in flight.stopped
    assert "the motors' time constant is 0.5 s" in flight.stopped
    assert flight.time[-1] == pytest.approx(last, abs=1e-6)


@pytest.mark.parametrize("method", ["rk4", "euler"])
def test_steps_that_are_proposed_are_taken(method: str) -> None:
    rng = np.random.default_rng(4)
    for rate, turn in rng.uniform((0.0, 1.7), (6.0, np.pi), (200, 2)):
        root = 10.0**rate * complex(np.cos(turn), np.sin(turn))
        for mode in (Mode(abs(root), "lag", "", root), Mode(abs(root), "lag", "", root.real + 0j)):
            words = mode.fault(100.0 / abs(root), method)
            step = float(words.split("steps of at most ")[1].split(" s")[0])
            assert mode.fault(step, method) == ""
