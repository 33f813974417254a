"""The work of motors, servos, friction and the battery on commands, from the robot's numbers.

It goes case by case, as the page of the robot file does, while the derivation makes its choices
of signs. Sizes are those of the terms that a number is made of: its error is a share of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.battery import Battery
from gibbs_codegen.robot.parts.rotor import Drive
from gibbs_codegen.verification.vectors import Array, Sized

_HOUR = 3600.0
# One of so many states takes more than the battery can give: levels grow until it does.
_OVERLOADED, _STEP, _STEPS = 4, 1.2, 60
# How far charges are beyond empty and full.
_BEYOND = 1e-3
# Share of a friction's velocity in which it is smooth about rest.
_SMOOTH = 0.1


class Motions(NamedTuple):
    """Arguments of the functions of actuators at s states.

    Coordinates and rates (s, joints) of the joints that move, thrusts and torques u (s, nu), the
    state x (s, nx) of the actuators, and their commands (s, nu).
    """

    angles: Array
    rates: Array
    u: Array
    x: Array
    command: Array


class _Discharge(NamedTuple):
    """Voltage of a battery, V, and the rate of its charge, 1/s.

    `margin` (s,), V², is above zero where it can give the power.
    """

    margin: Array
    voltage: Sized
    rate: Sized


class ActuatorOracle:
    """The actuators of a robot.

    Commands are those of the rotors and then of the joints. The state has the levels of the rotors
    that lag, the references of the servos with a delay, and the charge of the battery: `followed`
    are the commands that levels and references follow.
    """

    def __init__(self, robot: Robot) -> None:
        self._drives, self._battery = robot.drives, robot.battery
        self._joints = [robot.links[i - 1] for i in robot.driven]
        placed = robot.thrusters
        self._drags = (*robot.base.drag, *(rotor.drag for rotor in placed))
        self._factors = [rotor.speed_per_sqrt_thrust or 0.0 for rotor in placed]
        self._factors += [0.0] * robot.base.rotors
        rotors = [k for k, drive in enumerate(self._drives) if drive.up != 0.0]
        servos = [
            k
            for k, link in enumerate(self._joints, start=len(self._drives))
            if link.servo is not None and link.servo.delay != 0.0
        ]
        self.followed = [*rotors, *servos]

    def at(self, motions: Motions) -> dict[str, Sized]:
        """Results of every function of the module, by name."""
        levels = motions.command.copy()
        levels[:, self.followed] = motions.x[:, : len(self.followed)]
        rotors = range(len(self._drives))
        commanded = [self._thrust(k, motions.command[:, k]) for k in rotors]
        acting = [self._thrust(k, levels[:, k]) for k in rotors]
        speeds = [self._speed(k, levels[:, k]) for k in rotors]
        torques = [self._torque(j, levels, motions) for j in range(len(self._joints))]
        positions = [self._position(j, motions) for j in range(len(self._joints))]
        wanted = [self._level(k, motions.u[:, k]) for k in rotors]
        kept = [Sized(x, np.abs(x)) for x in motions.command[:, self.followed].T]
        if self._battery is not None:
            full = np.ones(len(levels))
            kept.append(Sized(full, full))
        columns_of = {
            "thrusts_of": commanded,
            "command_of": [*wanted, *positions],
            "inputs_of": [*acting, *torques],
            "actuator_rates": self._rates(levels, motions),
            "actuator_state_of": kept,
            "rotor_speeds": [Sized(speed, np.abs(speed)) for speed in speeds],
        }
        # Without rotors, or without states, there is no function.
        return {name: _beside(columns) for name, columns in columns_of.items() if columns}

    def _thrust(self, k: int, level: Array) -> Sized:
        """Thrust of a rotor at a level, N."""
        terms = [factor * level**power for power, factor in enumerate(self._drives[k].curve)]
        return Sized(np.sum(terms, axis=0), np.sum(np.abs(terms), axis=0))

    def _speed(self, k: int, level: Array) -> Array:
        """Speed of a rotor at a level, rad/s; 0 where it is not known."""
        drive = self._drives[k]
        if drive.command == "speed":
            return level
        if drive.command == "throttle":
            return (drive.full_speed or 0.0) * level
        return self._factors[k] * np.copysign(np.sqrt(np.abs(level)), level)

    def _level(self, k: int, thrust: Array) -> Sized:
        """The level of a thrust where the curve rises, or that at which it turns."""
        constant, slope, square = self._drives[k].curve
        rest, size = thrust - constant, np.abs(thrust) + abs(constant)
        if square == 0.0:
            return Sized(rest / slope, size / abs(slope))
        radicand, terms = slope**2 + 4.0 * square * rest, slope**2 + 4.0 * abs(square) * size
        with np.errstate(divide="ignore"):
            lost = terms / np.sqrt(np.abs(radicand))
        root = np.sqrt(np.maximum(radicand, 0.0))
        within = (abs(slope) + root + lost) / (2.0 * abs(square))
        return Sized((root - slope) / (2.0 * square), within)

    def _torque(self, j: int, levels: Array, motions: Motions) -> Sized:
        """Torque or force of a joint, with its friction."""
        link, rate = self._joints[j], motions.rates[:, j]
        reference = levels[:, len(self._drives) + j]
        value, size = reference, np.abs(reference)
        if servo := link.servo:
            way = reference - motions.angles[:, j]
            size = np.abs(reference) + np.abs(motions.angles[:, j]) + abs(servo.backlash)
            way = way - np.clip(way, -0.5 * servo.backlash, 0.5 * servo.backlash)
            value = servo.stiffness * way - servo.damping * rate
            size = servo.stiffness * size + np.abs(servo.damping * rate)
            if servo.command == "rate":
                value = servo.damping * (reference - rate)
                size = servo.damping * (np.abs(reference) + np.abs(rate))
            if servo.torque is not None:
                value = np.clip(value, -servo.torque, servo.torque)
        if dry := link.friction:
            falling = 1.0 / (1.0 + (rate / dry.velocity) ** 2)
            most = dry.coulomb * (1.0 - falling) + dry.static * falling
            value = value - most * rate / np.hypot(rate, _SMOOTH * dry.velocity)
            size = size + abs(dry.coulomb) + abs(dry.static)
        return Sized(value, size)

    def _position(self, j: int, motions: Motions) -> Sized:
        """The command of a joint that gives a torque or force at rest."""
        servo, torque = self._joints[j].servo, motions.u[:, len(self._drives) + j]
        if servo is None:
            return Sized(torque, np.abs(torque))
        if servo.command == "rate":
            terms = [motions.rates[:, j], torque / servo.damping]
        else:
            pushed = torque, servo.damping * motions.rates[:, j]
            terms = [motions.angles[:, j], *(x / servo.stiffness for x in pushed)]
        return Sized(np.sum(terms, axis=0), np.sum(np.abs(terms), axis=0))

    def _rates(self, levels: Array, motions: Motions) -> list[Sized]:
        """Rates of the state."""
        battery = self._battery and self._discharge(self._battery, levels, motions.x[:, -1])
        rates = []
        for k in self.followed:
            command, level = motions.command[:, k], levels[:, k]
            if k < len(self._drives):
                voltage = battery.voltage if battery else None
                rates.append(self._level_rate(self._drives[k], command, level, voltage))
            elif servo := self._joints[k - len(self._drives)].servo:
                rate = (command - level) / servo.delay
                size = (np.abs(command) + np.abs(level)) / servo.delay
                limit = (servo.command == "position" and servo.rate) or np.inf
                rates.append(Sized(np.clip(rate, -limit, limit), size))
        if battery:
            left = motions.x[:, -1] > 0.0
            rates.append(Sized(left * battery.rate.value, battery.rate.size))
        return rates

    def _level_rate(
        self, drive: Drive, command: Array, level: Array, voltage: Sized | None
    ) -> Sized:
        """Rate of a rotor's level."""
        target, size = command, np.abs(command)
        if drive.command == "throttle" and self._battery and voltage:
            target = command * voltage.value / self._battery.nominal
            size = size * voltage.size / self._battery.nominal
        time = np.where(target > level, drive.up, drive.down)
        return Sized((target - level) / time, (size + np.abs(level)) / time)

    def _power(self, battery: Battery, levels: Array) -> Sized:
        """Power drawn from the battery, W."""
        auxiliary = np.full(len(levels), battery.auxiliary)
        powers = [Sized(auxiliary, np.abs(auxiliary))]
        for k, drag in enumerate(self._drags):
            thrust, speed = self._thrust(k, levels[:, k]), self._speed(k, levels[:, k])
            by_torque = np.abs(drag * speed) / battery.efficiency
            powers.append(Sized(by_torque * np.abs(thrust.value), by_torque * thrust.size))
        values, sizes = zip(*powers, strict=True)
        return Sized(sum(values), sum(sizes))

    def _discharge(self, battery: Battery, levels: Array, charge: Array) -> _Discharge:
        """Current, voltage and rate of charge of the battery at levels of rotors and a charge."""
        from scipy.interpolate import interp1d  # Late, as SciPy takes long to import.

        power, resistance = self._power(battery, levels), battery.resistance
        places = np.linspace(0.0, 1.0, len(battery.voltages))
        unloaded = interp1d(places, battery.voltages, fill_value="extrapolate")(charge)
        largest = 2 * max(battery.voltages)
        margin = unloaded**2 - 4.0 * resistance * power.value
        voltage = 0.5 * (unloaded + np.sqrt(np.maximum(margin, 0.0)))
        with np.errstate(divide="ignore"):  # The root of nearly nothing has no digits.
            lost = (largest**2 + 4.0 * resistance * power.size) / np.sqrt(np.abs(margin))
        size, current = largest + lost, power.value / voltage
        share = 1.0 / (_HOUR * battery.capacity * voltage)
        taken = Sized(-share * power.value, share * (power.size + np.abs(current) * size))
        return _Discharge(margin, Sized(voltage, size), taken)

    def units(self, efforts: Array, scales: Array) -> tuple[Array, Array]:
        """Natural sizes of states x and commands, (nx,) and (nu,).

        `efforts` (nu,) are such thrusts and torques, `scales` (joints,) such coordinates.
        """
        rotors = [self._natural(drive, x) for drive, x in zip(self._drives, efforts, strict=False)]
        pairs = zip(self._joints, efforts[len(rotors) :], scales, strict=True)
        joints = [scale if link.servo else effort for link, effort, scale in pairs]
        commands = np.array([*rotors, *joints])
        states = np.append(commands[self.followed], [1.0] if self._battery else [])
        return states, commands

    def _natural(self, drive: Drive, thrust: float) -> float:
        """A command of natural size for a thrust, N."""
        _, slope, square = drive.curve
        if drive.command == "throttle":
            return 1.0
        return float(np.sqrt(abs(thrust / square))) if square else abs(thrust / slope)

    def random(
        self,
        angles: Array,
        rates: Array,
        efforts: Array,
        scales: Array,
        rng: np.random.Generator,
    ) -> tuple[Array, Array]:
        """Random states x (s, nx) and commands (s, nu) on both sides of every limit.

        `angles` and `rates` (s, joints) are those of the joints, `efforts` and `scales` as of
        `units`.
        """
        count, rotors = len(angles), len(self._drives)
        _, units = self.units(efforts, scales)
        levels = rng.uniform(-0.5, 1.5, (count, len(units))) * units
        commands = levels + rng.uniform(-1.0, 1.0, levels.shape) * units
        for j, link in enumerate(self._joints):
            if link.servo is None:
                continue
            place, servo = rotors + j, link.servo
            most = efforts[place] if servo.torque is None else servo.torque
            # By turns within the backlash, beyond either limit of the torque, and between them.
            kinds = (np.arange(count) + j) % 4
            torque = most * np.choose(kinds, [0.0, 1.5, -1.5, rng.uniform(-0.9, 0.9, count)])
            if servo.command == "rate":
                levels[:, place] = rates[:, j] + torque / servo.damping
            else:
                way = (torque + servo.damping * rates[:, j]) / servo.stiffness
                way += np.copysign(0.5 * servo.backlash, way)
                slack = 0.5 * servo.backlash * rng.uniform(-0.9, 0.9, count)
                levels[:, place] = angles[:, j] + np.where(kinds == 0, slack, way)
            reach = 0.5 * units[place]
            if rate := servo.command == "position" and servo.rate:
                reach = 2.0 * rate * servo.delay
            commands[:, place] = levels[:, place] + rng.uniform(-reach, reach, count)
        # A little beyond its ends, from where voltages go on straight, far away below 0.
        charge = np.clip(rng.uniform(-0.2, 1.2, count), -_BEYOND, 1.0 + _BEYOND)
        if battery := self._battery:
            overloaded = np.arange(count) % _OVERLOADED == 0
            for _ in range(_STEPS):
                margin = self._discharge(battery, levels, charge).margin
                levels[overloaded & (margin > 0.0), :rotors] *= _STEP
        at_once = [k for k in range(len(units)) if k not in self.followed]
        commands[:, at_once] = levels[:, at_once]
        states = levels[:, self.followed]
        if self._battery is not None:
            states = np.column_stack([states, charge])
        return states, commands


def _beside(columns: list[Sized]) -> Sized:
    """Numbers side by side, (s, columns)."""
    values, sizes = zip(*columns, strict=True)
    return Sized(np.stack(values, axis=-1), np.stack(sizes, axis=-1))
