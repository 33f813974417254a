"""Sampled laws and controllers of users: held inputs, delay, sensors, and what may go wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.tools import missing

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight import simulation
from gibbs_codegen.flight.control import sampled_control
from gibbs_codegen.flight.control.sampled_control import (
    LawController,
    Observation,
    Sensing,
    ZeroOrderHold,
)
from gibbs_codegen.flight.integration import compiled_loop
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.record.flight import Flight, read_flight
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Sensors
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.runtime.program_flow import REFUSED, Flow, Flown, Leg, ProgramFlow, Samples

Load = Callable[[str], ModuleType]

OFF = {"offset": [0.05, -0.02, 0.03], "turn_deg": [2, 3, 0]}
TIGHT = {"relative_tolerance": 1e-12, "absolute_tolerance": 1e-13}
FIXED = {"method": "rk4", "step": 5e-4}


@pytest.mark.parametrize(
    ("wild", "words"),
    [
        ([4.5, 9.0, 3.0], "throttle_1 is commanded 4.5, a throttle from 0 to 1; is it in percent"),
        ([0.5, 9.0, 45.0], "elbow_position is commanded 45, a position in rad, far beyond its"),
    ],
)
def test_commands_in_another_unit_are_told_once(
    wild: list[float], words: str, caplog: pytest.LogCaptureFixture
) -> None:
    names = ("throttle_1", "F_2", "elbow_position")
    limits = {"throttle_1": (0.0, 1.0), "elbow_position": (-1.5, 1.6)}
    module = SimpleNamespace(
        NAME="mixed", COMMANDS=names, COMMAND_UNITS=("1", "N", "rad"), COMMAND_LIMITS=limits
    )
    vehicle = SimpleNamespace(
        name="mixed", module=module, is_driven=True, commands=names, inputs=names
    )
    gains = SimpleNamespace(back=None)
    law: Any = SimpleNamespace(vehicle=vehicle, reference=None, allocation=None, gains=gains)
    hold = ZeroOrderHold(law, "own")
    for inputs in ([0.5, 9.0, 3.0], wild, wild):
        hold.command(0.5, np.array(inputs))
    (told,) = caplog.messages
    assert f"mixed: at t = 0.5 s {words}" in told


def hover(duration: float, **changes: Any) -> Scenario:
    return read_scenario("hover", {"duration": duration, "start": OFF, **changes})


@dataclass
class Damper:
    """Hovers a quadrotor at a rate, and keeps what it is told and what it commands."""

    module: ModuleType
    rate: float = 50.0
    delay: float = 0.0
    seen: list[Observation] = field(default_factory=list)
    commands: list[Array] = field(default_factory=list)
    resets: int = 0

    def reset(self) -> None:
        """Count the flights."""
        self.resets += 1

    def __call__(self, seen: Observation) -> Array:
        """Inputs of an observation."""
        self.seen.append(seen)
        u = self.inputs(seen.q, seen.v, seen.q_desired)
        self.commands.append(u)
        return u

    def inputs(self, q: Array, v: Array, desired: Array) -> Array:
        """What hovering takes, and against rates and whatever is off."""
        module, zero = self.module, np.zeros(6)
        wanted = -6.0 * module.difference(desired, q) - 3.0 * v
        force = module.inverse_dynamics(desired, zero, wanted)
        u: Array = np.linalg.pinv(module.input_matrix(desired)) @ force
        return u


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "delay", "integration"),
    [(40.0, 0.0037, TIGHT)],
)
def test_inputs_are_held_exactly(
    rate: float, delay: float, integration: dict[str, Any], fast: Load
) -> None:
    """Against another integrator, that is begun anew whenever a command takes effect."""
    module = fast("quadrotor")
    own = Damper(module, rate, delay)
    motors = {"limits": [-100, 100], "time_constant": 0}
    flight = simulate(module, hover(0.3, integration=integration, motors=motors), own)
    assert not flight.stopped

    kinematics = Vehicle(module).kinematics

    def fly(state: Array, u: Array, duration: float) -> Array:
        def derivative(time: float, x: Array) -> Array:
            q = kinematics.normalised(x[:7])
            return np.r_[kinematics.rates(x[:7], x[7:]), module.forward_dynamics(q, x[7:], u)]

        found = solve_ivp(derivative, (0, duration), state, "DOP853", rtol=1e-12, atol=1e-13)
        end: Array = found.y[:, -1]
        return end

    same, desired = Damper(module), flight.q_desired[0]
    state, now = np.r_[flight.q[0], flight.v[0]], 0.0
    acting = same.inputs(state[:7], state[7:], desired)
    events = [(k / rate, 0, k) for k in range(int(0.3 * rate) + 1)]
    events += [(time + delay, 1, k) for time, _, k in events]
    commands = {}
    for time, takes_effect, k in sorted(events):
        if time > 0.3 - 1e-9:
            break
        state, now = (fly(state, acting, time - now) if time > now else state), time
        if takes_effect:
            acting = commands[k]
        else:
            commands[k] = same.inputs(state[:7], state[7:], desired)
    state = fly(state, acting, 0.3 - now)
    assert np.ptp(own.commands, axis=0).max() > 1e-3
    assert flight.q[-1] == pytest.approx(state[:7], abs=1e-9)
    assert flight.v[-1] == pytest.approx(state[7:], abs=1e-9)


@pytest.mark.slow
def test_what_was_flown_is_recorded(fast: Load) -> None:
    module = fast("quadrotor")
    own = Damper(module, rate=40.0, delay=0.01)
    flight = simulate(module, hover(0.5, integration={"rate": 200}), own)
    assert own.resets == 1
    assert (flight.law, flight.control_rate) == ("own", 40.0)
    assert [seen.time for seen in own.seen] == [k / 40 for k in range(20)]
    for time, commanded in zip(flight.time[:-1], flight.commanded[:-1], strict=True):
        k = max(int(np.floor((time - 0.01) * 40 + 1e-9)), 0)
        assert np.array_equal(commanded, own.commands[k])
    assert np.abs(flight.energy_error).max() < 1e-8


@pytest.mark.slow
def test_what_is_observed(fast: Load) -> None:
    module = fast("quadrotor")
    own = Damper(module, rate=25.0)
    flight = simulate(module, hover(0.5), own)
    assert len(own.seen) == 13  # The last is at 0.48 s.
    for k, seen in enumerate(own.seen):
        for observed, series in (
            (seen.q, flight.q),
            (seen.v, flight.v),
            (seen.q_desired, flight.q_desired),
            (seen.v_desired, flight.v_desired),
            (seen.a_desired, flight.a_desired),
        ):
            assert observed == pytest.approx(series[4 * k], abs=1e-12)
            with pytest.raises(ValueError, match="read-only"):
                observed[0] = 1.0


@pytest.mark.slow
def test_a_sampled_law_nears_the_continuous_one(fast: Load) -> None:
    """With twice the rate, it is off by half as much, since inputs are half a period late."""
    module = fast("hexarotor_3link")
    settings = {"method": "rk4", "step": 1e-3}
    exact = simulate(module, hover(0.2, integration=settings))
    off = []
    for rate in (500, 1000):
        flight = simulate(module, hover(0.2, integration=settings, control={"rate": rate}))
        assert (flight.law, flight.control_rate) == ("computed_torque", rate)
        off.append(np.linalg.norm(flight.q[-1] - exact.q[-1]))
    assert exact.control_rate == 0.0
    assert np.array(off[:-1]) / off[1:] == pytest.approx(2.0, abs=0.15)


@pytest.mark.slow
def test_rates_of_controller_and_scenario(fast: Load) -> None:
    module = fast("quadrotor")
    damper = Damper(module)

    def without_a_rate(seen: Observation) -> Array:
        return damper(seen)

    assert simulate(module, hover(0.02), without_a_rate).control_rate == 1000.0
    assert [seen.time for seen in damper.seen] == [k / 1000 for k in range(20)]
    scenario = hover(0.02, control={"rate": 200})
    assert simulate(module, scenario, without_a_rate).control_rate == 200.0
    assert simulate(module, scenario, damper).control_rate == 50.0


@pytest.mark.slow
def test_a_flight_keeps_the_rate_in_its_file(fast: Load, tmp_path: Any) -> None:
    flight = simulate(fast("quadrotor"), hover(0.2), Damper(fast("quadrotor")))
    flight.write_npz(tmp_path / "flight.npz")
    assert read_flight(tmp_path / "flight.npz").control_rate == 50.0


@pytest.mark.slow
def test_fixed_steps_longer_than_the_errors_allow(fast: Load) -> None:
    """A law of 8000 rad/s makes errors grow in steps of 0.5 ms, but inputs that are held do not."""
    changes: dict[str, Any] = {"integration": {"method": "rk4", "step": 1e-3, "rate": 2000}}
    changes["control"] = {"frequency": 8000}
    with pytest.raises(UsageError, match=r"step: cut to 0\.0005 s by .*rate, 2000 Hz; in"):
        simulate(fast("octorotor_7link"), hover(0.01, **changes))
    changes["control"]["rate"] = 100
    flight = simulate(fast("octorotor_7link"), hover(0.1, **changes))
    assert "control is lost" in flight.stopped
    assert "a higher rate of control" in flight.stopped


# --- what may go wrong


@pytest.mark.slow
def test_wrong_commands_end_the_flight_and_leave_its_data(fast: Load) -> None:
    module = fast("quadrotor")

    def breaks(answer: object, begin: float) -> Callable[[Observation], object]:
        own = Damper(module)
        return lambda seen: answer if seen.time >= begin - 1e-9 else own(seen)

    nan = [1.0, np.nan, 1.0, 1.0]
    scenario = hover(0.5, control={"rate": 50})
    for answer, words in (
        (nan, "the controller returned nan for F_rear_left"),
        ([1.0, 2.0], r"returned an array of shape \(2,\), and not 4 inputs: F_"),
        (None, "returned None, and not 4 inputs: F_"),
        ("full throttle", "returned 'full throttle', and not 4 inputs"),
    ):
        with pytest.raises(UsageError, match=words):
            simulate(module, scenario, breaks(answer, 0.0))
        flight = simulate(module, scenario, breaks(answer, 0.2))
        assert flight.stopped.startswith("at t = 0.2 s the controller returned")
        assert flight.time[-1] == pytest.approx(0.2)
        assert np.all(np.isfinite(flight.commanded))


def test_errors_of_a_controller_are_its_own(fast: Load) -> None:
    def fails(seen: Observation) -> Array:
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        simulate(fast("quadrotor"), hover(0.1), fails)


@pytest.mark.parametrize(("attribute", "value"), [("delay", -1)])
def test_wrong_attributes(attribute: str, value: object, fast: Load) -> None:
    own = Damper(fast("quadrotor"))
    setattr(own, attribute, value)
    with pytest.raises(UsageError, match=f"controller: its {attribute} must be a number of"):
        simulate(fast("quadrotor"), hover(0.1), own)
    with pytest.raises(UsageError, match="cannot be called"):
        simulate(fast("quadrotor"), hover(0.1), 3.0)  # type: ignore[arg-type]
    with pytest.raises(
        UsageError, match=r"Damper is a class: give an instance, such as Damper\(\)"
    ):
        simulate(fast("quadrotor"), hover(0.1), Damper)  # type: ignore[arg-type]


@pytest.mark.slow
def test_any_robot_is_flown_and_may_be_lost(fast: Load) -> None:
    """Its rotors command neither force along y nor torque about x, which no law of ours flies."""
    module = fast("quadrotor_2link")
    count = len(module.INPUTS)
    flight = simulate(
        module,
        read_scenario("hover", {"duration": 3.0, "integration": {"divergence": 1.0}}),
        lambda seen: np.zeros(count),
    )
    assert "control is lost: z is" in flight.stopped
    assert "another controller" in flight.stopped
    # It falls by g t² / 2.
    assert flight.time[-1] == pytest.approx(np.sqrt(2 / 9.81), abs=0.02)


# --- sensors

NOISE = Sensors(0.01, 0.02, 0.03, 0.04, 0.05, 0.06, seed=4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hextilt_flying_arm_5"])
def test_noise_has_its_standard_deviations(name: str, fast: Load) -> None:
    module = fast(name)
    vehicle = Vehicle(module)
    places, rng = vehicle.layout.v, np.random.default_rng(1)
    off = rng.uniform(-0.4, 0.4, vehicle.layout.q.size)
    q = vehicle.kinematics.normalised(vehicle.neutral + off)
    v = rng.uniform(-1, 1, places.size)
    still = Reference(Motion(np.arange(2.0), *np.zeros((3, 2, 1))))
    sensing = Sensing(vehicle, still, NOISE)
    count = 1500
    seen = [sensing(0.0, q, v) for _ in range(count)]
    qs, vs = np.array([each.q for each in seen]), np.array([each.v for each in seen])
    turns = vehicle.base_rotation(qs) @ vehicle.base_rotation(q).T
    vectors = 0.5 * np.stack([turns[:, i, j] - turns[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))])
    spins = (vs - v)[:, places.attitude].T
    if not vehicle.layout.is_quaternion:
        # Rates of angles make angular velocities: those that turn the base in a short time.
        ahead = q + 1e-6 * np.eye(len(q))[vehicle.layout.q.attitude]
        turned = (vehicle.base_rotation(ahead) - vehicle.base_rotation(q)) / 1e-6
        axes = turned @ vehicle.base_rotation(q).T
        spins = np.stack([axes[:, 2, 1], axes[:, 0, 2], axes[:, 1, 0]]) @ spins
    found = [
        (qs - q)[:, vehicle.layout.q.position].T,
        vectors,
        (qs - q)[:, vehicle.arm].T,
        (vs - v)[:, places.position].T,
        spins,
        (vs - v)[:, vehicle.arm_rates].T,
    ]
    wanted = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06]
    for values, deviation in zip(found, wanted, strict=True):
        # The standard error of a standard deviation is σ / √(2 n); means are off by σ / √n.
        assert values.std(axis=1) == pytest.approx(deviation, rel=5 / np.sqrt(2 * count))
        assert values.mean(axis=1) == pytest.approx(0.0, abs=5 * deviation / np.sqrt(count))
        off = np.corrcoef(values) - np.eye(len(values))
        assert np.abs(off).max() < 5 / np.sqrt(count)


@pytest.mark.slow
def test_noise_depends_on_the_seed_and_on_nothing_else(fast: Load) -> None:
    module = fast("quadrotor")

    def noise(seed: int, integration: dict[str, Any]) -> Array:
        own = Damper(module, rate=50.0)
        sensors = {"position": 0.01, "attitude_deg": 0.2, "velocity": 0.01, "seed": seed}
        flight = simulate(module, hover(0.2, sensors=sensors, integration=integration), own)
        return np.array([seen.q - flight.q[2 * k] for k, seen in enumerate(own.seen)])

    first = noise(3, TIGHT)
    assert np.abs(first).max() > 1e-3
    assert np.array_equal(first, noise(3, TIGHT))
    assert noise(3, FIXED) == pytest.approx(first, abs=1e-8)
    assert np.abs(noise(5, TIGHT) - first).max() > 1e-3


@pytest.mark.slow
def test_sensors_sample_our_laws_too(fast: Load) -> None:
    module = fast("hexarotor_3link")
    settings = {"method": "rk4", "step": 1e-3}
    flight = simulate(module, hover(0.1, sensors={"velocity": 0.01}, integration=settings))
    assert flight.control_rate == 1000.0
    still = simulate(module, hover(0.1, integration=settings, control={"rate": 1000}))
    assert np.abs(flight.commanded - still.commanded).max() > 1e-3


ERRORS = {"position": 0.01, "attitude_deg": 0.5, "velocity": 0.02, "angular_velocity": 0.01}
PUSHED = {"force": [1, 0, 2], "begin": 0.02, "end": 0.0404, "frame": "base"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "method", "control", "refuses"),
    [
        ("hexarotor_3link", "adaptive", {"rate": 250, "delay": 0.007, "integral": 2.0}, False),
        ("hexarotor_3link", "rk4", {"rate": 250, "delay": 0.007, "integral": 2.0}, True),
        ("hexarotor_3link", "rk4", {"rate": 250, "law": "adaptive", "adaptation": 0.1}, False),
        ("quadrotor_arm_2link", "rk4", {"rate": 333}, False),
        (
            "hextilt_flying_arm_5",
            "adaptive",
            {"rate": 250, "law": "impedance", "impedance": {"frame": "tip"}},
            False,
        ),
    ],
)
def test_samples_in_c_are_those_of_python(
    robot: str,
    method: str,
    control: dict[str, Any],
    refuses: bool,
    fast: Load,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With errors, delays, readings, memory, intervals that end between samples, and refusals.

    Steps of adaptive size are exact to 1e-9, those of SciPy and of C each in its own way.
    """
    sensors = {**ERRORS, "force": 0.1, "delay": 0.003, "imu": [{"rate": 150}]}
    changes = {"sensors": sensors, "push": PUSHED, "control": control}
    scenario = hover(0.06, integration={"method": method, "rate": 500}, **changes)
    module, fly, refusals = fast(robot), ProgramFlow.__call__, list[int]()

    def refused(self: ProgramFlow, flow: Flow, legs: Sequence[Leg], *others: Any) -> Flown:
        """Steps up to a sample that is not the first; it is then Python's."""
        sampled = [k for k, leg in enumerate(legs) if leg.samples and k > 2]
        flow.steps = sum(leg.count for leg in legs[: min(sampled, default=len(legs))])
        flown = fly(self, flow, legs, *others)  # type: ignore[arg-type]
        if flow.leg < len(legs):
            flow.reason = REFUSED
            refusals.append(flow.leg)
        return flown

    with monkeypatch.context() as patched:
        if refuses:
            patched.setattr(ProgramFlow, "__call__", refused)
        quick = simulate(module, scenario)
    assert bool(refusals) == (refuses and module.backend == "c")
    monkeypatch.setattr(compiled_loop, "is_compiled", lambda *_: False)
    assert_alike(quick, simulate(module, scenario))
    assert np.ptp(quick.commanded, axis=0).max() > 1e-2


def assert_alike(quick: Flight, slow: Flight) -> None:
    for name in ("q", "v", "commanded", "commanded_least", "applied_greatest", "sensors"):
        found, expected = getattr(quick, name), getattr(slow, name)
        size = np.nanmax(np.abs(expected), initial=1.0)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * size, err_msg=name)
    assert not quick.stopped


@pytest.mark.slow
def test_of_two_samples_c_takes_none_where_it_refuses_the_second(
    fast: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the law has learnt from the first is forgotten, and learnt again where it is due."""
    module, fly, refusals = fast("quadrotor"), ProgramFlow.__call__, list[int]()
    if module.backend != "c":
        missing("nothing compiles")
    # The law for six directions, of which four rotors lack two, refuses what these do not command.
    monkeypatch.setattr(simulation, "law_of", lambda *_: "computed_torque")
    monkeypatch.setattr(Allocation, "in_flight", lambda self: self)
    control = {"rate": 250, "delay": 0.007, "integral": 2.0}
    integration = {"method": "rk4", "rate": 500}
    climb = {"start": {"offset": [0, 0, 0.05]}, "sensors": {"delay": 0.003}}
    scenario = hover(0.06, control=control, integration=integration, **climb)

    def early(
        self: ProgramFlow, flow: Flow, legs: Any, state: Array, times: Array, *others: Any
    ) -> Flown:
        """The third sample is due with the second, and sees an error that no thrusts mend."""
        due = [leg for leg in legs if leg.samples][1:3]
        if len(due) < 2:
            return fly(self, flow, legs, state, times, *others)
        due[0].samples, due[1].samples = 2, 0
        law: Samples = others[0]
        law.errors[2, 0] = 0.01
        flown = fly(self, flow, legs, state, times, *others)
        assert flow.reason == REFUSED
        refusals.append(flow.sampled)
        return flown

    with monkeypatch.context() as patched:
        patched.setattr(ProgramFlow, "__call__", early)
        quick = simulate(module, scenario)
    assert set(refusals) == {2}
    monkeypatch.setattr(compiled_loop, "is_compiled", lambda *_: False)
    assert_alike(quick, simulate(module, scenario))


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.1])
def test_sensors_are_late(late: float, fast: Load) -> None:
    module = fast("quadrotor")
    own = Damper(module, rate=50.0, delay=0.006)
    scenario = hover(0.3, sensors={"delay": late}, integration={"rate": 1000})
    flight = simulate(module, scenario, own)
    assert len(own.seen) >= 15
    assert np.ptp(flight.v, axis=0).max() > 0.1
    for seen in own.seen:
        row = max(round((seen.time - late) * 1000), 0)
        assert seen.q == pytest.approx(flight.q[row], abs=1e-9)
        assert seen.v == pytest.approx(flight.v[row], abs=1e-9)
        assert seen.q_desired == pytest.approx(flight.q_desired[0])


def test_what_a_law_remembers_grows_from_sample_to_sample() -> None:
    class Remembers:
        memory, moved = 2, None

        def commanded(self, time: float, *seen: Any) -> tuple[Array, Array]:
            memory = seen[2]
            return memory, np.array([1.0, time]) - memory

    none, sides = np.zeros(0), np.array([[-np.inf] * 2, [np.inf] * 2])
    free = Actuators(sides, np.zeros(2), np.zeros((2, 0)), none, none, np.zeros(2))
    # Motors that run at 0.1 s alone let it learn of that sample alone.
    for span, expected in (
        ((-np.inf, np.inf), [[0, 0], [0.1, 0], [0.19, 0.01]]),
        ((0.05, 0.15), [[0, 0], [0, 0], [0.1, 0.01], [0.1, 0.01]]),
    ):
        idles = replace(free, span=span).idles
        own = LawController(Remembers(), free, idles, 10.0)  # type: ignore[arg-type]
        for _ in range(2):
            own.reset()
            times = 0.1 * np.arange(len(expected))
            told = [own(Observation(t, none, none, none, none, none)) for t in times.tolist()]
            assert np.allclose(told, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("seconds", "said"), [(0.3, True), (0.1, False)])
def test_a_controller_that_takes_most_of_the_time_is_told(
    seconds: float,
    said: bool,
    fast: Load,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """By a clock that only the controller moves, in eleven samples."""
    clock = [0.0]
    for module in (sampled_control, simulation):
        monkeypatch.setattr(module, "perf_counter", lambda: clock[0])

    def slow(observation: Observation) -> Array:
        clock[0] += seconds
        return np.full(4, 3.0)

    flight = simulate(fast("quadrotor"), hover(0.01), slow)
    assert not flight.stopped
    told = [line for line in caplog.messages if "the controller took" in line]
    words = "quadrotor: the controller took 3.0 s of the 3.0 s of computing (100 %)"
    assert told == ([words] if said else [])
