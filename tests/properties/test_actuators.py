"""Actuators against published models of multirotors, and against closed forms.

`tests/oracles` has what RotorPy 3.0.0 gives for the Hummingbird, and drone-models 0.1.0 for a
Crazyflie, with the script that wrote it down. Of the latter the curve of the thrust, the rigid body
and the lag of rotors that speed up are those of robot files. Three things are others there:

- the torque of a rotor is a curve of its own, not a multiple of the thrust;
- rotors slow down at a rate that goes with the square of their speed;
- the gyroscopic torques about x and y have the same sign, while −ω × h has opposite ones.
"""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from support.actuated import actuated
from support.emitted import emitted_module, module_with_derivatives

from gibbs_codegen.arrays import Functions, Program, evaluate, variable
from gibbs_codegen.machine.surroundings import air_on_rotors, on_frames
from gibbs_codegen.robot.file import parse_robot

ORACLES = Path(__file__).parents[1] / "oracles"
Array = np.ndarray
TIGHT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-11}


def multirotor(
    name: str, mass: float, inertia: Array, places: Array, drags: Array, rotor: str
) -> ModuleType:
    """The module of a rigid body with rotors along z, which all have the keys `rotor`."""
    xx, yy, zz = np.diag(inertia)
    text = f'name = "{name}"\n[base]\nattitude = "quaternion"\nmass = {mass}\n'
    text += f"inertia = [{xx}, {yy}, {zz}, 0, 0, 0]\n"
    for place, drag in zip(places, drags, strict=True):
        position = [float(x) for x in place]
        text += f"[[rotor]]\nposition = {position}\ndrag = {drag}\n{rotor}\n"
    return emitted_module(parse_robot(text))


class Oracle:
    """RotorPy's Hummingbird and the module of its numbers."""

    def __init__(self) -> None:
        self.told = json.loads((ORACLES / "rotorpy.json").read_text(encoding="utf-8"))
        own = self.told["parameters"]
        inertia = np.diag([own["Ixx"], own["Iyy"], own["Izz"]])
        places = np.array([*own["rotor_pos"].values()])
        drags = np.array(own["rotor_directions"]) * own["k_m"] / own["k_eta"]
        rotor = f'command = "speed"\nthrust_constant = {own["k_eta"]}\n'
        rotor += f"time_constant = {own['tau_m']}\ncommand_limits = [0, 1500]\n"
        rotor += f"hub_drag = {own['k_d']}\ninflow = {own['k_z']}\n"
        rotor += f"translational_lift = {own['k_h']}\n"
        self.module = multirotor("hummingbird", own["mass"], inertia, places, drags, rotor)
        robot = Functions(self.module)
        given = (
            *(variable("poses", robot.frames, 4, 4), variable("velocities", robot.frames, 6)),
            *(variable("speeds", 4), variable("u", 4), variable("wind", 3)),
        )
        poses, velocities, speeds, u, wind = given
        parts = air_on_rotors(robot, (poses, velocities), speeds, u, wind)
        self._air = Program("air", given, {"wrenches": on_frames(parts, robot.frames)})

    def state(self, told: dict[str, Any]) -> tuple[Array, Array, Array]:
        """Coordinates, velocities in the axes of the base, and speeds of a state of RotorPy."""
        turn = Rotation.from_quat(told["q"])
        velocity = np.concatenate([turn.inv().apply(told["v"]), told["w"]])
        return np.concatenate([told["x"], told["q"]]), velocity, np.array(told["rotor_speeds"])

    def accelerations(
        self, q: Array, v: Array, x: Array, command: Array, wind: Array | None
    ) -> Array:
        """The rates of v; without wind the air does nothing to the rotors."""
        module = self.module
        u = module.inputs_of(q, v, x, command)
        if wind is None:
            return module.forward_dynamics(q, v, u)
        inputs = {"poses": module.frame_poses(q), "velocities": module.frame_velocities(q, v)}
        inputs |= {"speeds": x, "u": u, "wind": wind}
        wrenches = evaluate(self._air, inputs, {})["wrenches"]
        return module.forward_dynamics_with_wrenches(q, v, u, wrenches)


@pytest.fixture(scope="module")
def hummingbird() -> Oracle:
    return Oracle()


def beside_rotorpy(air: str, hummingbird: Oracle) -> tuple[Array, Array]:
    """Accelerations of the body and rates of the rotors' speeds of all states: here and there."""
    told, both = hummingbird.told, []
    pairs = zip(told["states"], told["commands"], told[air]["rates"], strict=True)
    for state, command, rates in pairs:
        q, v, x = hummingbird.state(state)
        wind = np.array(state["wind"]) if air == "air" else None
        a = hummingbird.accelerations(q, v, x, np.array(command), wind)
        turn = Rotation.from_quat(state["q"])
        linear = turn.apply(a[:3] + np.cross(v[3:], v[:3]))
        lag = hummingbird.module.actuator_rates(x, np.array(command))
        both.append(([*linear, *a[3:], *lag], [*rates[3:6], *rates[10:13], *rates[16:]]))
    found, expected = np.moveaxis(np.array(both), 1, 0)
    return found, expected


@pytest.mark.parametrize("air", ["still", "air"])
def test_accelerations_are_those_of_rotorpy(air: str, hummingbird: Oracle) -> None:
    np.testing.assert_allclose(*beside_rotorpy(air, hummingbird), rtol=1e-9, atol=1e-9)


def flown_beside_rotorpy(air: str, hummingbird: Oracle) -> tuple[Array, Array]:
    """States at the ends of the pieces of a flight: here and there."""
    both = []
    told, module = hummingbird.told, hummingbird.module
    wind = np.zeros(3) if air == "air" else None
    now = np.concatenate(hummingbird.state(told["start"]))
    for piece, after in zip(told["pieces"], told[air]["flown"], strict=True):
        command = np.array(piece)

        def rates(_: float, state: Array, command: Array = command) -> Array:
            q, v, x = np.split(state, [7, 13])
            a = hummingbird.accelerations(q, v, x, command, wind)
            moved = module.coordinate_rates(q, v), a, module.actuator_rates(x, command)
            return np.concatenate(moved)

        now = solve_ivp(rates, (0.0, told["length"]), now, **TIGHT).y[:, -1]
        both.append((now, np.concatenate(hummingbird.state(after))))
    found, expected = np.moveaxis(np.array(both), 1, 0)
    return found, expected


@pytest.mark.parametrize("air", ["still", pytest.param("air", marks=pytest.mark.slow)])
def test_a_flight_is_that_of_rotorpy(air: str, hummingbird: Oracle) -> None:
    np.testing.assert_allclose(*flown_beside_rotorpy(air, hummingbird), rtol=1e-6, atol=1e-6)


def beside_drone_models() -> tuple[tuple[Array, Array], tuple[Array, Array], int]:
    """Accelerations with the torque that goes with the thrust, and with its curve: here and there.

    And how many rotors sped up, whose lags are compared.
    """
    told = json.loads((ORACLES / "drone_models.json").read_text(encoding="utf-8"))
    own = {name: np.array(value) for name, value in told["parameters"].items()}
    per = 60.0 / (2.0 * np.pi)  # Turns a minute of a radian a second.
    roll, pitch, yaw = own["mixing_matrix"]
    places = own["L"] * np.stack([-pitch, roll, 0.0 * roll], axis=-1)
    drags, curve = yaw * own["thrust2torque"], own["rpm2thrust"] * per ** np.arange(3)
    (faster, *_) = own["rotor_dyn_coef"]
    rotor = f'command = "speed"\nthrust_curve = {curve.tolist()}\ntime_constant = {1.0 / faster}\n'
    module = multirotor("crazyflie", float(own["mass"]), own["J"], places, drags, rotor)
    every = zip(
        *(told[name] for name in ("states", "speeds", "commands", "proportional", "published")),
        strict=True,
    )
    sped_up, proportional, curved = 0, [], []
    for (position, attitude, velocity, spin), *others in every:
        speeds, commands = (np.array(x) / per for x in others[:2])
        turn = Rotation.from_quat(attitude)
        q, v = np.array([*position, *attitude]), np.array([*turn.inv().apply(velocity), *spin])
        a = module.forward_dynamics(q, v, module.inputs_of(q, v, speeds, commands))
        linear = turn.apply(a[:3] + np.cross(v[3:], v[:3]))
        turning, published = (np.array(x[1]) for x in others[2:])
        proportional.append(([*linear, *a[3:]], [*others[2][0], *turning]))
        rpm = np.array(others[0])
        torques = np.polynomial.polynomial.polyval(rpm, own["rpm2torque"])
        thrusts = np.polynomial.polynomial.polyval(rpm, own["rpm2thrust"])
        more = np.zeros(3)
        more[2] = yaw @ (torques - own["thrust2torque"] * thrusts) / own["J"][2, 2]
        curved.append((a[3:] + more, published))
        up = commands > speeds
        sped_up += int(up.sum())
        lag = module.actuator_rates(speeds, commands)[up]
        np.testing.assert_allclose(lag, np.array(others[2][2])[up] / per, rtol=1e-9)
    pairs = (np.moveaxis(np.array(both), 1, 0) for both in (proportional, curved))
    first, second = ((found, there) for found, there in pairs)
    return first, second, sped_up


def test_accelerations_are_those_of_drone_models() -> None:
    """With the torque that goes with the thrust; else but for what its curve adds about z."""
    *pairs, sped_up = beside_drone_models()
    for found, there in pairs:
        np.testing.assert_allclose(found, there, rtol=1e-9, atol=1e-9)
    assert sped_up > 10


@pytest.fixture(scope="module")
def every() -> ModuleType:
    """The robot with every kind of actuator."""
    return emitted_module(actuated())


def test_commands_of_thrusts_give_these_thrusts(every: ModuleType) -> None:
    """Throttles, and speeds on the rising side of their curve."""
    share = np.linspace(0.05, 1.0, 20)[:, None]
    commands = np.concatenate([share, 900 * share, 950 * share, 9 * share], axis=1)
    commands = np.concatenate([commands, np.zeros((20, 3))], axis=1)
    u = np.concatenate([every.thrusts_of(commands), np.zeros((20, 3))], axis=1)
    q = np.array([0.0, 0, 0, 0, 0, 0, 1, 0, 0, 0])
    back = every.command_of(q, np.zeros(9), u)
    np.testing.assert_allclose(back, commands, rtol=1e-12, atol=1e-14)
    # 0.7 · 9 N by the square of the throttle, the rest by itself.
    expected = 9 * (0.7 * share[:, 0] ** 2 + 0.3 * share[:, 0])
    np.testing.assert_allclose(u[:, 0], expected, rtol=1e-12)


def test_two_time_constants_are_two_exponentials() -> None:
    module = emitted_module(
        parse_robot(
            'name = "lag"\n[base]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n[[rotor]]\n'
            'command = "throttle"\nmax_thrust = 9\ntime_constants = [0.03, 0.05]\n'
        )
    )
    times = np.linspace(0.0, 0.1, 11)
    for start, command, constant in ((0.2, 0.8, 0.03), (0.8, 0.2, 0.05)):
        found = solve_ivp(
            lambda _, x, c=command: module.actuator_rates(x, np.array([c])),
            (0.0, 0.1),
            [start],
            t_eval=times,
            **TIGHT,
        ).y[0]
        expected = command + (start - command) * np.exp(-times / constant)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_servo_swings_as_a_damped_oscillator_does() -> None:
    """Of two bodies about one axis: J φ'' = k (c − φ) − d φ' with J₁ J₂/(J₁ + J₂) for J."""
    text = 'name = "swing"\ngravity = 0\n[base]\nmass = 2\ninertia = [0.3, 0.3, 0.5, 0, 0, 0]\n'
    text += '[[link]]\nname = "arm"\nxyz = [0, 0, 0]\naxis = "z"\n'
    text += "mass = 1\ninertia = [0.1, 0.1, 0.2, 0, 0, 0]\n"
    module = emitted_module(parse_robot(text + "servo = { stiffness = 8, damping = 0.4 }\n"))
    inertia, place = 0.5 * 0.2 / (0.5 + 0.2), module.COORDINATE_PLACES["joints"].start
    nq = len(module.COORDINATES)
    command, no_state = np.array([0.3]), np.zeros(0)

    def rates(_: float, state: Array) -> Array:
        q, v = np.split(state, [nq])
        u = module.inputs_of(q, v, no_state, command)
        return np.concatenate([module.coordinate_rates(q, v), module.forward_dynamics(q, v, u)])

    start = np.zeros(nq + len(module.VELOCITIES))
    times = np.linspace(0.0, 1.0, 11)
    found = solve_ivp(rates, (0.0, 1.0), start, t_eval=times, **TIGHT).y[place]
    decay, frequency = 0.4 / (2.0 * inertia), np.sqrt(8.0 / inertia)
    damped = np.sqrt(frequency**2 - decay**2)
    swing = np.cos(damped * times) + decay / damped * np.sin(damped * times)
    np.testing.assert_allclose(found, 0.3 * (1.0 - np.exp(-decay * times) * swing), atol=1e-9)


def test_the_energy_of_a_discharge_is_delivered_or_heats_the_battery(every: ModuleType) -> None:
    """The integral of U₀ I is that of U I and R I²; both powers from the module's speeds."""
    command = np.array([0.7, 600.0, 500.0, 5.0, 0.0, 0.0, 0.0])
    battery = actuated().battery
    assert battery is not None
    places = np.linspace(0.0, 1.0, 4)

    def power(x: Array) -> float:
        """What the battery gives, W, of drags of 0.016 m."""
        thrusts = every.inputs_of(
            np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0.0]), np.zeros(9), x, command
        )
        taken = 0.016 * np.abs(thrusts[:4] * every.rotor_speeds(x, command)).sum()
        return float(taken / battery.efficiency + battery.auxiliary)

    def rates(_: float, state: Array) -> Array:
        x = state[:6]
        found = every.actuator_rates(x, command)
        current = -3600.0 * battery.capacity * found[-1]
        given = np.interp(x[-1], places, battery.voltages) * current
        return np.array([*found, given, power(x), battery.resistance * current**2])

    start = np.concatenate([every.actuator_state_of(command), np.zeros(3)])
    start[0] = 0.2
    end = solve_ivp(rates, (0.0, 200.0), start, **TIGHT).y[:, -1]
    assert end[5] < 0.95
    given, delivered, heat = end[6:]
    assert heat > 1e-3 * given
    assert given == pytest.approx(delivered + heat, rel=1e-9)


def test_a_rotor_by_thrust_that_stands_still_has_derivatives() -> None:
    """Its speed is the root of its thrust, but its power, F^(3/2), rises from 0 without a slope."""
    robot = parse_robot(
        'name = "still"\n[base]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n'
        "[battery]\nvoltage = [13, 16]\nresistance = 0.01\ncapacity = 5\nauxiliary = 4\n"
        "[[rotor]]\ndrag = 0.016\nspin_inertia = 2e-5\nspeed_per_sqrt_thrust = 280\n"
        "time_constant = 0.02\n"
    )
    names = ("actuator_rates_derivatives", "rotor_speeds_derivatives")
    module = module_with_derivatives(robot, *names)
    rates, by_x, _ = module.actuator_rates_derivatives([0.0, 0.5], [0.0])
    np.testing.assert_allclose(by_x[:, 0], [-1.0 / 0.02, 0.0], rtol=1e-15, atol=1e-15)
    np.testing.assert_array_equal(rates, module.actuator_rates([0.0, 0.5], [0.0]))
    assert np.isfinite(module.rotor_speeds_derivatives([0.0, 0.5], [0.0])[1]).all()
