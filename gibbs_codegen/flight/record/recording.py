"""The record of a flight: all its time series, from the samples of the state."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from gibbs_codegen.flight.desired.trajectory import TimedMotion, base_path
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.envelope import hard_impacts
from gibbs_codegen.flight.integration.integrators import StepGrid
from gibbs_codegen.flight.integration.state_history import InputRanges, StateHistory
from gibbs_codegen.flight.plant.actuators import has_battery
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import NO_ESTIMATES, RANGES, point_parents
from gibbs_codegen.flight.scenario.orientation import Tangent, heading_error
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.machine.state import State

_HOUR = 3600.0
# The last of a charge.
_LAST = 1e-12
_FIELDS = frozenset(field.name for field in fields(Flight))


def flight_of(loop: ClosedLoop, scenario: Scenario, history: StateHistory) -> Flight:
    """All time series of a flight, a row per sample."""
    series = Recording(loop, scenario, history).series
    return Flight(**{name: compute() for name, compute in series.items()})


@dataclass(frozen=True)
class Recording:
    """The samples of a flight, of which fields of `Flight` are computed when they are asked for.

    `like`, if there is one, is of a flight with the same times and the same desired motion.
    `ranges`, if given, finds the ranges of the inputs between samples, which the history lacks.
    """

    loop: ClosedLoop
    scenario: Scenario
    history: StateHistory
    like: Recording | None = None
    ranges: Callable[[], InputRanges] | None = None

    def __post_init__(self) -> None:
        """Take the loop with what rested on stops."""
        object.__setattr__(self, "loop", self.loop.resting(self.history.rests))

    @property
    def series(self) -> dict[str, Callable[[], Any]]:
        """Functions that compute the fields of a flight, by name."""
        loop, vehicle, scenario, time = self.loop, self.loop.vehicle, self.scenario, self._time
        gusts = scenario.wind.gusts if scenario.wind else ()
        contacts = [(k, x) for k, wall in enumerate(scenario.walls, 1) for x in wall.frames]
        rows, hits = tuple(getattr(vehicle.module, "CONSTRAINT_ROWS", ())), self.history.impacts
        blowing = [[gust.begin, gust.begin + gust.duration] for gust in gusts]
        return {
            **posture_series(vehicle, lambda: self._parts.q, lambda: self._parts.v),
            "scenario": lambda: scenario.name,
            "law": lambda: loop.controller.law,
            "back": lambda: np.array(loop.controller.gains.back),
            "control_rate": lambda: loop.hold.rate if loop.hold else 0.0,
            "tangent_arm": lambda: self._tangent_arm,
            "stopped": lambda: self.history.stopped,
            "time": lambda: time,
            "a": lambda: self._motion["a"],
            "q_desired": lambda: self._reference[0],
            "v_desired": lambda: self._reference[1],
            "a_desired": lambda: self._reference[2],
            "commanded": lambda: self._inputs[0],
            "applied": lambda: self._inputs[1],
            **{name: partial(self._range, place) for place, name in enumerate(RANGES)},
            "input_limits": lambda: np.array(loop.actuators.inputs),
            "constraint_torques": lambda: vehicle.constraint_torques(
                *self._parts[:2], self._motion["a"], self._inputs[1]
            ),
            "frame_wrenches": lambda: self._motion["wrenches"],
            "centre_desired": lambda: base_path(loop.controller.vehicle, scenario)(time)[:, 0],
            "tip_desired": lambda: self._tip_desired,
            "heading_error": self._heading_error,
            "work": lambda: self._parts.work,
            "walls": self._walls,
            "wall_kinds": lambda: tuple(wall.kind for wall in scenario.walls),
            "gusts": lambda: np.array(blowing, dtype=np.float64).reshape(-1, 2),
            "motor_times": lambda: np.array(loop.actuators.span),
            "wall_forces": self._wall_forces,
            "contact_walls": lambda: np.array([k for k, _ in contacts], dtype=np.int_),
            "contact_frames": lambda: tuple(frame for _, frame in contacts),
            "contact_forces": lambda: self._motion["contacts"][..., 0],
            "contact_friction": lambda: self._motion["contacts"][..., 1:4],
            "contact_slip": lambda: self._motion["contacts"][..., 4:7],
            "contact_depth": lambda: self._motion["contacts"][..., 7],
            "hold_names": lambda: rows,
            "hold_forces": lambda: self._motion["holding"],
            "hold_errors": lambda: (
                vehicle.function("constraint_errors")(self._parts.q)
                if scenario.holds
                else np.zeros((len(time), 0))
            ),
            "held": lambda: tuple(hold.constraint for hold in scenario.holds),
            "hold_times": lambda: np.reshape([(x.begin, x.end) for x in scenario.holds], (-1, 2)),
            "impacts": lambda: np.reshape([hit[:3] for hit in hits], (-1, 3)),
            "impulses": lambda: np.reshape([hit[3] for hit in hits], (len(hits), len(rows))),
            "hard_impacts": self._hard_impacts,
            "disc_radii": self._disc_radii,
            "joint_limits": lambda: loop.actuators.joints,
            "sensor_names": lambda: loop.sensors.names if loop.sensors else (),
            "sensor_units": lambda: loop.sensors.units if loop.sensors else (),
            "sensor_frames": lambda: loop.sensors.frames if loop.sensors else (),
            "sensor_rates": lambda: loop.sensors.timing[0] if loop.sensors else np.zeros(0),
            "sensor_delays": lambda: loop.sensors.timing[1] if loop.sensors else np.zeros(0),
            "sensors": self._sensors,
            **{name: partial(self._estimate, name) for name in NO_ESTIMATES},
            **self._of_drives,
        }

    @property
    def _of_drives(self) -> dict[str, Callable[[], Any]]:
        """Functions for the fields of motors and servos, which are empty for a robot without."""
        vehicle = self.loop.vehicle
        units: tuple[str, ...] = getattr(vehicle.module, "COMMAND_UNITS", ())
        return {
            "command_names": lambda: vehicle.commands[: len(units)],
            "command_units": lambda: units,
            "actuator_names": lambda: vehicle.actuator_states,
            "commands": lambda: self._sent[1][:, : len(units)],
            # The step in which a battery runs empty may leave it below that.
            "actuators": lambda: np.maximum(
                self._parts.actuators[:, : len(vehicle.actuator_states)],
                np.where(np.array(vehicle.actuator_states) == "charge", 0.0, -np.inf),
            ),
            "battery": self._battery,
        }

    def _battery(self) -> Array:
        """Voltage, V, and current, A, (s, 2) under the load; (s, 0) without a battery."""
        vehicle, scenario = self.loop.vehicle, self.scenario
        if not has_battery(vehicle):
            return np.zeros((len(self._time), 0))
        numbers = {**vehicle.module.PARAMETERS, **scenario.parameters, **scenario.plant}
        steps = [numbers[name] for name in numbers if name.startswith("battery_voltage_")]
        states = self._parts.actuators.copy()
        # An empty battery gives a current, by which the charge of 0 does not fall.
        states[:, -1] = charge = np.maximum(states[:, -1], _LAST)
        rates = vehicle.actuator_rates(states, self._sent[1])[:, -1]
        current = -_HOUR * numbers["battery_capacity"] * rates
        free = np.interp(charge, np.linspace(0.0, 1.0, len(steps)), steps)
        voltage = free - numbers.get("battery_resistance", 0.0) * current
        return np.stack([voltage, current], axis=1)

    @property
    def _time(self) -> Array:
        return self.history.time

    @cached_property
    def _parts(self) -> State[Array]:
        return self.loop.parts(self.history.states)

    @cached_property
    def _reference(self) -> tuple[Array, Array, Array]:
        if self.like:
            return self.like._reference
        vehicle, time = self.loop.controller.vehicle, self._time
        q, v, a = self.loop.controller.reference(time)
        if vehicle.layout.q.wheels:  # Curves have nothing of their angles.
            q[:, vehicle.layout.q.angles] = vehicle.rolled(time, q, v, a)
        return q, v, a

    @cached_property
    def _sent(self) -> tuple[Array, Array, Array]:
        """Inputs (s, nu) that are commanded, what is aimed for, and inputs that act."""
        return self.loop.commands(self._time, self._parts, self.loop.loads(self._time))

    @property
    def _inputs(self) -> tuple[Array, Array]:
        """Inputs (s, nu) that are commanded, and those that act."""
        commanded, _, acting = self._sent
        return commanded, acting

    @cached_property
    def _motion(self) -> dict[str, Array]:
        """Accelerations, wrenches on frames and contacts, as `ClosedLoop.motion` has."""
        _, aimed, acting = self._sent
        loads = self.loop.loads(self._time)
        return self.loop.motion(self._time, self._parts, aimed, acting, loads)

    @cached_property
    def _ranges(self) -> Array:
        """Ranges (2, 2, s, nu) of the inputs between samples, in the order of `RANGES`."""
        ranges = self.ranges() if self.ranges else self.history.inputs
        return ranges.up_to_samples(self._time, *self._inputs)

    def _range(self, place: int) -> Array:
        return self._ranges[divmod(place, 2)]

    @cached_property
    def _tip_desired(self) -> Array:
        """Desired tip (s, 3), m, world axes: on its path, or where a held posture puts it.

        (s, 0) for a robot that has none.
        """
        if self.like:
            return self.like._tip_desired
        model, tip = self.loop.controller.vehicle, self.scenario.arm.tip
        if not model.has_tip:
            return np.zeros((len(self._time), 0))
        if tip:
            return tip(self._time)[:, 0]
        return model.positions(self._reference[0])[:, model.points.index("tip")]

    def _walls(self) -> Array:
        """Figures (w, k) of the walls, zeros after those of shapes that have fewer."""
        figures = [wall.figures for wall in self.scenario.walls]
        walls = np.zeros((len(figures), max(map(len, figures), default=6)))
        for row, shape in zip(walls, figures, strict=True):
            row[: len(shape)] = shape
        return walls

    def _wall_forces(self) -> Array:
        """Forces (s, w), N, of walls out of their surfaces, on all of their frames."""
        counts = [len(wall.frames) for wall in self.scenario.walls]
        forces = self._motion["contacts"][..., 0]
        ends = np.cumsum([0, *counts])
        parts = [forces[:, a:b].sum(axis=1) for a, b in itertools.pairwise(ends)]
        return np.stack(parts, axis=1) if parts else np.zeros((len(self._time), 0))

    def _hard_impacts(self) -> tuple[str, ...]:
        """Sentences on impacts for which equal steps are too long."""
        settings = self.scenario.integration
        if settings.method != "rk4":
            return ()
        q, v = (x[:, np.newaxis] for x in self._parts[:2])
        vehicle, walls, step = self.loop.vehicle, self.scenario.walls, StepGrid(settings).size
        return tuple(hard_impacts(vehicle, walls, (q, v), self._time, step))

    def _sensors(self) -> Array:
        """Readings of the robot's sensors (s, m), as in flight or as they would have been."""
        loop, motion, time = self.loop, self._motion, self._time
        if loop.sensors is None:
            return np.zeros((len(time), 0))
        moved = (*self._parts[:2], motion["a"], motion["touching"])
        if loop.hold is None or loop.hold.readings is None:
            return loop.sensors.readings(time, *moved)
        # Sensors that are sampled in flight take nothing at its end.
        last = partial(loop.sensors.measurements, *(part[-1] for part in moved))
        loop.hold.readings.take(time[-1], last)
        return loop.hold.readings.series(time)

    @cached_property
    def _estimates(self) -> dict[str, Any]:
        """Estimates of a filter in flight, by fields of `Flight`."""
        hold, (q, v) = self.loop.hold, self._parts[:2]
        if hold is None or hold.estimator is None or hold.readings is None:
            return NO_ESTIMATES
        self._sensors()  # With those at the end.
        if (time := float(self._time[-1])) > hold.estimator.time:  # Ends are no instants.
            hold.estimator.follow(time, self._inputs[1][-1], hold.readings.come(time))
        return hold.estimator.series(self._time, q, v)

    def _estimate(self, name: str) -> Any:
        return self._estimates[name]

    def _disc_radii(self) -> Array:
        """Radii (N), m, of the discs of rotors, 0 where neither scenario nor robot says them."""
        vehicle, radius = self.loop.vehicle, self.scenario.motors.disc_radius
        air = getattr(vehicle.module, "ROTOR_AIR", {})
        radii = [air[name][7] if name in air else 0.0 for name in vehicle.inputs[: vehicle.rotors]]
        return np.array(radii if radius is None else [radius] * len(radii), dtype=np.float64)

    @property
    def _tangent_arm(self) -> int:
        """The base arm that points along the path, from 1, or 0 for none."""
        attitude, arms = self.scenario.attitude, self.loop.vehicle.arm_angles()
        return attitude.arm if isinstance(attitude, Tangent) and len(arms) else 0

    def _heading_error(self) -> Array:
        """Angles (s), rad, between the base arm that follows the path, and its tangent.

        Zero without such an arm.
        """
        vehicle, arm = self.loop.vehicle, self._tangent_arm
        if not arm or self.scenario.base is None:
            return np.zeros(len(self._time))
        angle = vehicle.arm_angles()[arm - 1]
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        direction = vehicle.base_rotation(self._parts.q) @ along
        return heading_error(self.scenario.base, self._time, direction)


def posture_series(
    vehicle: Vehicle, q: Callable[[], Array], v: Callable[[], Array]
) -> dict[str, Callable[[], Any]]:
    """Functions for the fields of a flight that describe its robot and the robot's place.

    By coordinates (s, nq) and velocities (s, nv), which are asked for when they are needed.
    """
    return {
        "robot": lambda: vehicle.name,
        "attitude": lambda: vehicle.attitude,
        "coordinates": lambda: vehicle.coordinates,
        "coordinate_units": lambda: vehicle.layout.q.units,
        "input_names": lambda: vehicle.inputs,
        "points": lambda: vehicle.points,
        "constraint_names": lambda: vehicle.constraint_names,
        "frames": lambda: vehicle.frames,
        "weight": lambda: vehicle.weight,
        "gravity": lambda: -float(vehicle.gravity),
        "q": q,
        "v": v,
        "base_arm_angles": lambda: _base_arm_angles(vehicle, q()),
        "base_arm_angles_desired": lambda: vehicle.arm_angles()[1:],
        "positions": lambda: vehicle.positions(q()),
        "parents": lambda: point_parents(vehicle),
        "base_rotation": lambda: vehicle.base_rotation(q()) @ vehicle.base_turn,
        "wheels": lambda: vehicle.wheels,
        "wheel_points": lambda: vehicle.wheel_points,
        "thrust_directions": lambda: _thrust_directions(vehicle, q()),
        "kinetic_energy": lambda: vehicle.kinetic_energy(q(), v()),
        "potential_energy": lambda: vehicle.potential_energy(q()),
    }


def _thrust_directions(vehicle: Vehicle, q: Array) -> Array:
    """Unit vectors of the thrusts in the base's frame, or 0 of those that move no base.

    (N, 3), or (s, N, 3) where joints move rotors.
    """
    wrenches = vehicle.thrust_wrenches(q if vehicle.wrenches_vary else None)
    forces = np.swapaxes(wrenches[..., :3, :], -1, -2) @ vehicle.base_turn
    sizes = np.linalg.norm(forces, axis=-1, keepdims=True)
    return np.divide(forces, sizes, out=np.zeros_like(forces), where=sizes > 0.0)


def _base_arm_angles(vehicle: Vehicle, q: Array) -> Array:
    """Angles (s, N − 1), rad, of base arms 2 … N against arm 1, from where the motors are."""
    positions, first = vehicle.positions(q), vehicle.points.index(vehicle.centre)
    arms = positions[:, first + 2 : first + 1 + max(len(vehicle.arm_angles()), 1)]
    away = (arms - positions[:, [first]]) @ vehicle.base_rotation(q)
    return np.arctan2(away[..., 1], away[..., 0])


def timing_note(flight: Flight, motion: TimedMotion) -> Flight:
    """The flight with what is to be said of its timing."""
    return replace(flight, **timing_fields(motion))


def timing_fields(motion: TimedMotion) -> dict[str, Any]:
    """The timing of a motion, by the names of the fields of a flight."""
    times = [(stretch.begin, stretch.end) for stretch in motion.binding]
    return {
        "timing": motion.explanation,
        "binding": tuple(stretch.limit for stretch in motion.binding),
        "binding_times": np.reshape(times, (-1, 2)),
    }


class DeferredFlight(Flight):
    """A flight that computes each of its fields when it is first asked for, but for `values`."""

    def __init__(self, recording: Callable[[], Recording], values: dict[str, Any]) -> None:
        # A flight is frozen; its fields stand where an ordinary one has them.
        self.__dict__.update(values, _recording=cache(recording))

    def __getattribute__(self, name: str) -> Any:
        """A field, which is computed where it is not known yet, whatever it is by default."""
        values = super().__getattribute__("__dict__")
        if name not in values and name in _FIELDS:
            values[name] = values["_recording"]().series[name]()
        return super().__getattribute__(name)

    def __reduce__(self) -> tuple[Any, ...]:
        # Copies and what is sent to other processes have all series.
        return partial(Flight, **{name: getattr(self, name) for name in _FIELDS}), ()
