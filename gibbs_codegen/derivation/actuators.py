"""Actuators: thrusts by speed or throttle with lag, servos of joints, dry friction, one battery.

A rotor's level is a thrust, a speed or a throttle, and follows what it is commanded:

    dx/dt = (target − x)/T_up, or /T_down where target < x,    F = k₀ + k₁ x + k₂ x²

A throttle's target is the command times the battery's voltage over the nominal one. The battery
gives the power P of all rotors, drag·F·Ω by its efficiency, and of all else: with the voltage U₀ of
its charge and the resistance R its voltage is U = (U₀ + √(U₀² − 4 R P))/2 and its current P/U. An
empty battery keeps the charge 0, and goes on with the least U₀.

A servo pushes with stiffness·e − damping·rate, within its torque, where e is the way to its
reference, less the backlash. The reference r follows the command with dr/dt = (command − r)/delay,
within its rate. A servo of rates pushes with damping·(r − rate).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import sympy as sp

from gibbs_codegen.derivation.parameters import ServoSymbols
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.description import ActuatorKey
from gibbs_codegen.robot.parts.rotor import Drive
from gibbs_codegen.symbolic.choices import above, chosen
from gibbs_codegen.symbolic.tape import Scalars

_HALF = sp.Rational(1, 2)
_ZERO = sp.S.Zero
# Thrusts that are commanded.
_IDENTITY = (sp.S.Zero, sp.S.One, sp.S.Zero)
# A thrust, N, lost beside any other, under a root that would have no derivative at 0.
_NO_THRUST = sp.Rational(1, 10**30)
# Share of a friction's velocity in which it is smooth about rest.
_SMOOTH = sp.Rational(1, 10)


def _within(tape: Scalars, x: sp.Expr, least: sp.Expr, most: sp.Expr) -> sp.Expr:
    """X, or the limit that it is beyond."""
    low = chosen(tape, above(tape, x - least), x, least)
    return chosen(tape, above(tape, most - low), low, most)


def _root(tape: Scalars, radicand: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """1 where a radicand is above 0, else 0; its root, or 0 with derivatives of 0."""
    let, positive = tape.let, above(tape, radicand)
    size = let(let(sp.sign(radicand)) * radicand)  # Not 0, at which no root has a derivative.
    return positive, let(positive * let(sp.sqrt(size)))


@dataclass(frozen=True)
class Actuators:
    """The actuators of a robot on its tape."""

    symbolic: SymbolicRobot

    @property
    def _tape(self) -> Scalars:
        return self.symbolic.tape

    def _rotor(self, k: int) -> dict[str, Any]:
        """Symbols of the numbers of rotor k, by their keys."""
        return self.symbolic.parameters.rotors[k]

    @property
    def _rotors(self) -> range:
        return range(1, self.symbolic.robot.rotors + 1)

    def _drive(self, k: int) -> Drive:
        return self.symbolic.robot.drives[k - 1]

    @property
    def _states(self) -> dict[ActuatorKey, sp.Symbol]:
        """Levels, references and the charge, by what they belong to."""
        keys = self.symbolic.description.actuator_keys
        return dict(zip(keys, self.symbolic.x, strict=True))

    def _command(self, k: int) -> sp.Symbol:
        """The command of rotor k."""
        return self.symbolic.command[k - 1]

    def _level(self, k: int) -> sp.Expr:
        """The level of rotor k."""
        return self._states.get(("rotor", k), self._command(k))

    def _thrust(self, k: int, level: sp.Expr) -> sp.Expr:
        """The thrust of rotor k at a level, N."""
        let = self._tape.let
        constant, slope, square = self._rotor(k).get("thrust_curve", _IDENTITY)
        return let(constant + let(level * let(slope + let(square * level))))

    def _speed(self, k: int, level: sp.Expr) -> sp.Expr:
        """The speed of rotor k at a level, rad/s; 0 where it is not known."""
        command, let = self._drive(k).command, self._tape.let
        if command == "speed":
            return level
        own = self._rotor(k)
        known = own.get("full_speed", own.get("speed_per_sqrt_thrust", _ZERO))
        if command == "throttle" or known == 0:
            return let(known * level)
        sign = let(sp.sign(level))
        size = let(let(sign * level) + _NO_THRUST)
        return let(known * let(sign * let(sp.sqrt(size))))

    def thrusts_of_commands(self) -> list[sp.Expr]:
        """Thrusts, N, for commands that stay, at the nominal voltage."""
        with self._tape.group("thrusts by their curves"):
            return [self._thrust(k, self._command(k)) for k in self._rotors]

    def speeds(self) -> list[sp.Expr]:
        """Speeds of the rotors, rad/s."""
        with self._tape.group("speeds of the rotors"):
            return [self._speed(k, self._level(k)) for k in self._rotors]

    def inputs(self) -> list[sp.Expr]:
        """Thrusts and torques that act."""
        symbolic, found = self.symbolic, []
        with self._tape.group("thrusts by their curves"):
            found = [self._thrust(k, self._level(k)) for k in self._rotors]
        with self._tape.group("torques of servos, within their limits, and friction"):
            commands = symbolic.command[symbolic.robot.rotors :]
            rates = symbolic.joint_state.rates
            for i, command, rate in zip(symbolic.robot.moving, commands, rates, strict=True):
                found.append(self._tape.let(self._torque(i, command, rate) - self._drag(i, rate)))
        return found

    def _torque(self, i: int, command: sp.Expr, rate: sp.Expr) -> sp.Expr:
        """Torque or force of the joint of link i."""
        tape, servo = self._tape, self.symbolic.parameters.servos.get(i)
        if servo is None:
            return command
        reference = self._states.get(("link", i), command)
        if servo.stiffness == 0:
            torque = tape.let(servo.damping * tape.let(reference - rate))
            return self._within_torque(servo, torque)
        way = tape.let(reference - self.symbolic.coordinates[i])
        if servo.backlash != 0:
            half = tape.let(_HALF * servo.backlash)
            way = tape.let(way - _within(tape, way, -half, half))
        torque = tape.let(tape.let(servo.stiffness * way) - tape.let(servo.damping * rate))
        return self._within_torque(servo, torque)

    def _within_torque(self, servo: ServoSymbols, torque: sp.Expr) -> sp.Expr:
        """A torque or force within the limit of a servo."""
        most = servo.torque
        return torque if most is None else _within(self._tape, torque, -most, most)

    def _drag(self, i: int, rate: sp.Expr) -> sp.Expr:
        """Dry friction of the joint of link i, against its rate."""
        let, friction = self._tape.let, self.symbolic.parameters.frictions.get(i)
        if friction is None:
            return _ZERO
        coulomb, static, velocity = friction
        square = let(rate * rate)
        smooth = let(velocity * _SMOOTH)
        direction = let(rate * let(1 / let(sp.sqrt(let(square + let(smooth * smooth))))))
        fallen = let(1 / let(1 + let(square * let(1 / let(velocity * velocity)))))
        return let(direction * let(coulomb + let(let(static - coulomb) * fallen)))

    def commands(self) -> list[sp.Expr]:
        """Commands that give the inputs u at rest."""
        symbolic, rotors = self.symbolic, self.symbolic.robot.rotors
        with self._tape.group("levels of the thrusts"):
            found = [self._level_of(k, symbolic.u[k - 1]) for k in self._rotors]
        with self._tape.group("positions and rates at which servos push so much"):
            torques, rates = symbolic.u[rotors:], symbolic.joint_state.rates
            for i, torque, rate in zip(symbolic.robot.moving, torques, rates, strict=True):
                found.append(self._position(i, torque, rate))
        return found

    def _level_of(self, k: int, thrust: sp.Expr) -> sp.Expr:
        """The level of rotor k for a thrust, on the rising side of its curve."""
        let, drive = self._tape.let, self._drive(k)
        if drive.command == "thrust":
            return thrust
        constant, slope, square = self._rotor(k).get("thrust_curve", _IDENTITY)
        rest = let(thrust - constant)
        if square == 0:
            return let(rest * let(1 / slope))
        radicand = let(let(slope * slope) + let(4 * let(square * rest)))
        positive, root = _root(self._tape, radicand)
        if drive.curve[1] > 0.0:  # Of two forms of the root that which does not cancel.
            over = chosen(self._tape, positive, let(2 * rest), let(-slope))
            under = chosen(self._tape, positive, let(slope + root), let(2 * square))
            return let(over * let(1 / under))
        return let(let(root - slope) * let(1 / let(2 * square)))

    def _position(self, i: int, torque: sp.Expr, rate: sp.Expr) -> sp.Expr:
        """The command of the joint of link i for a torque."""
        let, servo = self._tape.let, self.symbolic.parameters.servos.get(i)
        if servo is None:
            return torque
        if servo.stiffness == 0:
            return let(rate + let(torque * let(1 / servo.damping)))
        pushed = let(torque + let(servo.damping * rate))
        return let(self.symbolic.coordinates[i] + let(pushed * let(1 / servo.stiffness)))

    def rates(self) -> list[sp.Expr]:
        """Rates of the states."""
        let, found = self._tape.let, []
        voltage, current = self._battery()
        for (kind, i), state in self._states.items():
            if kind == "charge":
                with self._tape.group("discharge of the battery"):
                    capacity = self.symbolic.parameters.battery["capacity"]
                    rate = let(current * let(1 / let(3600 * capacity)))
                    found.append(-let(above(self._tape, state) * rate))  # None is left below 0.
            elif kind == "rotor":
                with self._tape.group("lag of the rotors"):
                    found.append(self._level_rate(i, state, voltage))
            else:
                with self._tape.group("references of servos"):
                    found.append(self._reference_rate(i, state))
        return found

    def _level_rate(self, k: int, level: sp.Expr, voltage: sp.Expr) -> sp.Expr:
        let, own = self._tape.let, self._rotor(k)
        lag = own.get("time_constant")
        up, down = own.get("time_constants", (lag, lag))
        target = self._command(k)
        if self._drive(k).command == "throttle" and voltage != 0:
            nominal = self.symbolic.parameters.battery["nominal"]
            target = let(target * let(voltage * let(1 / nominal)))
        way, pace = let(target - level), let(1 / up)
        if up != down:
            pace = chosen(self._tape, above(self._tape, way), pace, let(1 / down))
        return let(pace * way)

    def _reference_rate(self, i: int, reference: sp.Expr) -> sp.Expr:
        let, symbolic = self._tape.let, self.symbolic
        servo = symbolic.parameters.servos[i]
        place = symbolic.robot.rotors + symbolic.robot.moving.index(i)
        rate = let(let(symbolic.command[place] - reference) * let(1 / servo.delay))
        if servo.rate is None:
            return rate
        return _within(self._tape, rate, -servo.rate, servo.rate)

    def _battery(self) -> tuple[sp.Expr, sp.Expr]:
        """Voltage, V, and current, A, of the battery; both 0 where there is none."""
        let, parameters = self._tape.let, self.symbolic.parameters
        if not parameters.battery:
            return _ZERO, _ZERO
        with self._tape.group("power of the rotors"):
            powers = []
            for k in self._rotors:
                level = self._level(k)
                torque = let(self._rotor(k)["drag"] * self._thrust(k, level))
                power = let(torque * self._speed(k, level))
                powers.append(let(power * let(sp.sign(power))) if power != 0 else power)
            rotors = let(let(sp.Add(*powers)) * let(1 / parameters.battery["efficiency"]))
            power = let(rotors + parameters.battery["auxiliary"])
        with self._tape.group("voltage and current of the battery"):
            open_circuit = self._open_circuit(self._states[("charge", 0)])
            if parameters.battery["resistance"] == 0:
                return open_circuit, let(power * let(1 / open_circuit))
            taken = let(let(4 * parameters.battery["resistance"]) * power)
            radicand = let(let(open_circuit * open_circuit) - taken)
            _, root = _root(self._tape, radicand)
            voltage = let(_HALF * let(open_circuit + root))
            return voltage, let(power * let(1 / voltage))

    def _open_circuit(self, charge: sp.Expr) -> sp.Expr:
        """The voltage without load, linear between those of the charges."""
        let, voltages = self._tape.let, self.symbolic.parameters.voltages
        steps = len(voltages) - 1
        found = voltages[0]
        for k, (low, high) in enumerate(pairwise(voltages)):
            share = _within(self._tape, let(steps * charge - k), _ZERO, sp.S.One)
            found = let(found + let(share * let(high - low)))
        return found

    def kept(self) -> list[sp.Expr]:
        """States that commands keep, with a full battery."""
        symbolic, found = self.symbolic, []
        for (kind, i), _ in self._states.items():
            if kind == "charge":
                found.append(sp.S.One)
            elif kind == "rotor":
                found.append(self._command(i))
            else:
                place = symbolic.robot.rotors + symbolic.robot.moving.index(i)
                found.append(symbolic.command[place])
        return found
