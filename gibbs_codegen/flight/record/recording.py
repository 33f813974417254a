"""The record of a flight: all its time series, from the samples of the state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from gibbs_codegen.flight.desired.trajectory import TimedMotion
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop, Parts
from gibbs_codegen.flight.integration.state_history import InputRanges, StateHistory
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import RANGES, point_parents
from gibbs_codegen.flight.scenario.orientation import Tangent, heading_error
from gibbs_codegen.flight.scenario.scenario import Scenario

_NAMES = (
    *("robot", "scenario", "law", "control_rate", "attitude", "coordinates", "coordinate_units"),
    *("input_names", "points", "constraint_names", "frames", "tangent_arm", "stopped"),
)
_FIELDS = frozenset(each.name for each in fields(Flight))
_BASE = ("base_arm_angles", "base_arm_angles_desired", "base_rotation", "heading_error")


def flight_of(loop: ClosedLoop, scenario: Scenario, history: StateHistory) -> Flight:
    """All time series of a flight, a row per sample."""
    recording = Recording(loop, scenario, history)
    made: dict[str, Any] = {}
    for _, group in recording.groups:
        made |= group()
    return Flight(**made)


@dataclass(frozen=True)
class Recording:
    """The samples of a flight, of which fields of `Flight` are computed in groups.

    `like`, if there is one, is of a flight with the same times and the same desired motion.
    `ranges`, if given, finds the ranges of the inputs between samples, which the history lacks.
    """

    loop: ClosedLoop
    scenario: Scenario
    history: StateHistory
    like: Recording | None = None
    ranges: Callable[[], InputRanges] | None = None

    @property
    def groups(self) -> tuple[tuple[tuple[str, ...], Callable[[], dict[str, Any]]], ...]:
        """Names of fields that are computed together, and what computes them."""
        return (
            (_NAMES, self._names),
            (("time", "q", "v", "work"), self._states),
            (("q_desired", "v_desired", "a_desired"), self._desired),
            (("commanded", "applied", "input_limits"), self._inputs),
            (RANGES, self._ranges),
            (("a", "frame_wrenches", "constraint_torques"), self._forces),
            (_BASE, self._base),
            (("positions",), self._positions),
            (("parents", "thrust_directions"), self._connections),
            (("centre_desired", "tip_desired"), self._paths),
            (("weight", "walls", "wall_kinds", "gusts", "joint_limits"), self._surroundings),
            (("wall_forces",), self._wall_forces),
            (("kinetic_energy", "potential_energy"), self._energies),
        )

    @property
    def _time(self) -> Array:
        return self.history.time

    @cached_property
    def _parts(self) -> Parts:
        return self.loop.parts(self.history.states)

    @cached_property
    def _reference(self) -> tuple[Array, Array, Array]:
        return self.like._reference if self.like else self.loop.controller.reference(self._time)

    @cached_property
    def _acting_inputs(self) -> tuple[Array, Array]:
        """Inputs (s, nu) that are commanded, and those that act."""
        return self.loop.inputs(self._time, self._parts)

    @cached_property
    def _motion(self) -> dict[str, Array]:
        """Accelerations, wrenches on frames and forces of walls, as `ClosedLoop.motion` has."""
        loop, time, (q, v, *_) = self.loop, self._time, self._parts
        return loop.motion(time, q, v, self._acting_inputs[1], loop.loads(time))

    def _names(self) -> dict[str, Any]:
        """What has no numbers."""
        loop, vehicle = self.loop, self.loop.vehicle
        return {
            "robot": vehicle.name,
            "scenario": self.scenario.name,
            "law": loop.controller.law,
            "control_rate": loop.hold.rate if loop.hold else 0.0,
            "attitude": vehicle.attitude,
            "coordinates": vehicle.coordinates,
            "coordinate_units": vehicle.layout.q.units,
            "input_names": vehicle.inputs,
            "points": vehicle.points,
            "constraint_names": vehicle.constraint_names,
            "frames": vehicle.frames,
            "tangent_arm": _tangent_arm(vehicle, self.scenario),
            "stopped": self.history.stopped,
        }

    def _states(self) -> dict[str, Any]:
        q, v, work, *_ = self._parts
        return {"time": self._time, "q": q, "v": v, "work": work}

    def _desired(self) -> dict[str, Any]:
        return dict(zip(("q_desired", "v_desired", "a_desired"), self._reference, strict=True))

    def _inputs(self) -> dict[str, Any]:
        """Inputs (s, nu), with their limits (2, nu)."""
        commanded, applied = self._acting_inputs
        limits = np.array(self.loop.actuators.inputs)
        return {"commanded": commanded, "applied": applied, "input_limits": limits}

    def _ranges(self) -> dict[str, Any]:
        """Ranges (s, nu) of the inputs between samples."""
        commanded, applied = self._acting_inputs
        known = self.ranges() if self.ranges else self.history.inputs
        ranges = known.up_to_samples(self._time, commanded, applied)
        return dict(zip(RANGES, ranges.reshape(4, *applied.shape), strict=True))

    def _forces(self) -> dict[str, Any]:
        """Accelerations (s, nv), wrenches on frames (s, f, 6), constraint torques (s, c)."""
        (q, v, *_), motion = self._parts, self._motion
        torques = self.loop.vehicle.constraint_torques(q, v, motion["a"], self._acting_inputs[1])
        wrenches = motion["wrenches"]
        return {"a": motion["a"], "frame_wrenches": wrenches, "constraint_torques": torques}

    def _base(self) -> dict[str, Any]:
        """Rotation of the base (s, 3, 3), angles of its arms and of the path's tangent, rad."""
        vehicle, q = self.loop.vehicle, self._parts.q
        return {
            "base_arm_angles": _measured_arm_angles(vehicle, q),
            "base_arm_angles_desired": vehicle.arm_angles()[1:],
            "base_rotation": vehicle.base_rotation(q),
            "heading_error": _heading_errors(vehicle, self.scenario, self._time, q),
        }

    def _positions(self) -> dict[str, Any]:
        return {"positions": self.loop.vehicle.positions(self._parts.q)}

    def _connections(self) -> dict[str, Any]:
        vehicle, q = self.loop.vehicle, self._parts.q
        directions = _thrust_directions(vehicle, q)
        return {"parents": point_parents(vehicle), "thrust_directions": directions}

    def _paths(self) -> dict[str, Any]:
        return self._desired_places

    @cached_property
    def _desired_places(self) -> dict[str, Array]:
        """Where base centre and tip should be (s, 3), m."""
        if self.like:
            return self.like._desired_places
        model, time = self.loop.controller.vehicle, self._time
        tip = _desired_tip(model, self.scenario, time, self._reference[0])
        return {"centre_desired": self.scenario.base(time)[:, 0], "tip_desired": tip}

    def _surroundings(self) -> dict[str, Any]:
        found = _surroundings(self.loop.vehicle, self.scenario)
        return {**found, "joint_limits": self.loop.actuators.joints}

    def _wall_forces(self) -> dict[str, Any]:
        """Force (s, w) of each wall, N."""
        return {"wall_forces": self._motion["pressed"]}

    def _energies(self) -> dict[str, Any]:
        """Energies (s), J."""
        vehicle, (q, v, *_) = self.loop.vehicle, self._parts
        kinetic, potential = vehicle.kinetic_energy(q, v), vehicle.potential_energy(q)
        return {"kinetic_energy": kinetic, "potential_energy": potential}


def _surroundings(vehicle: Vehicle, scenario: Scenario) -> dict[str, Any]:
    """Weight, walls, and times of gusts, by the names of the fields."""
    gusts = scenario.wind.gusts if scenario.wind else ()
    figures = [wall.figures for wall in scenario.walls]
    walls = np.zeros((len(figures), max(map(len, figures), default=6)))
    for row, found in zip(walls, figures, strict=True):
        row[: len(found)] = found
    blowing = [[gust.begin, gust.begin + gust.duration] for gust in gusts]
    return {
        "weight": weight_of(vehicle),
        "walls": walls,
        "wall_kinds": tuple(wall.kind for wall in scenario.walls),
        "gusts": np.array(blowing, dtype=np.float64).reshape(-1, 2),
    }


def weight_of(vehicle: Vehicle) -> float:
    """Weight of a robot, N: what its potential energy grows by for each metre of height."""
    lifted = vehicle.neutral
    lifted[vehicle.layout.q.position][2] += 1.0
    return float(vehicle.potential_energy(lifted) - vehicle.potential_energy(vehicle.neutral))


def timing_note(flight: Flight, motion: TimedMotion) -> Flight:
    """The flight with what is to be said of its timing."""
    return replace(flight, **timing_fields(motion))


def timing_fields(motion: TimedMotion) -> dict[str, Any]:
    """What is to be said of the timing of a motion, by the names of the fields of a flight."""
    times = [(each.begin, each.end) for each in motion.binding]
    return {
        "timing": motion.said,
        "binding": tuple(each.what for each in motion.binding),
        "binding_times": np.reshape(times, (-1, 2)),
    }


def _thrust_directions(vehicle: Vehicle, q: Array) -> Array:
    """Unit vectors of the thrusts in the base's frame, at coordinates (s, nq).

    They are (N, 3) where they are the same in all samples, and (s, N, 3) where rotors move.
    """
    wrenches = vehicle.thrust_wrenches(q if vehicle.rotors_move else None)
    forces = np.swapaxes(wrenches[..., :3, :], -1, -2)
    return forces / np.linalg.norm(forces, axis=-1, keepdims=True)


def _tangent_arm(vehicle: Vehicle, scenario: Scenario) -> int:
    """The base arm that points along the path, from 1, or 0 for none."""
    attitude = scenario.attitude
    return attitude.arm if isinstance(attitude, Tangent) and len(vehicle.arm_angles()) else 0


def _desired_tip(vehicle: Vehicle, scenario: Scenario, time: Array, q_desired: Array) -> Array:
    """Desired tip (s, 3), m, world axes: on its path, or where a held posture puts it.

    It is (s, 0) without a tip. `vehicle` is the robot as the controller knows it.
    """
    if not vehicle.has_tip:
        return np.zeros((len(time), 0))
    if scenario.arm.tip:
        return scenario.arm.tip(time)[:, 0]
    return vehicle.positions(q_desired)[:, vehicle.points.index("tip")]


def _heading_errors(vehicle: Vehicle, scenario: Scenario, time: Array, q: Array) -> Array:
    """Angles (s), rad, between the base arm that follows the path, and its tangent.

    They are 0 where no arm does.
    """
    if not (arm := _tangent_arm(vehicle, scenario)):
        return np.zeros(len(time))
    angles = vehicle.arm_angles()
    angle = angles[arm - 1] if len(angles) else 0.0  # A base without arms follows with its x axis.
    direction = vehicle.base_rotation(q) @ np.array([np.cos(angle), np.sin(angle), 0.0])
    return heading_error(scenario.base, time, direction)


def _measured_arm_angles(vehicle: Vehicle, q: Array) -> Array:
    """Angles (s, N − 1), rad, of base arms 2 … N against arm 1, from where the motors are.

    They are (s, 0) of a base without arms.
    """
    positions, rotation = vehicle.positions(q), vehicle.base_rotation(q)
    centre = positions[:, vehicle.points.index(vehicle.centre)]
    angles = [np.zeros((0, len(positions)))]
    for k in range(2, len(vehicle.arm_angles()) + 1):
        arm = positions[:, vehicle.points.index(f"motor{k}")] - centre
        x, y, _ = np.einsum("sji,sj->is", rotation, arm)
        angles.append(np.arctan2(y, x)[np.newaxis])
    return np.concatenate(angles).T


class DeferredFlight(Flight):
    """A flight that computes each group of its fields when one of them is first asked for.

    Those `known` are known already.
    """

    def __init__(self, recording: Recording, known: dict[str, Any]) -> None:
        # A flight is frozen; its fields stand where an ordinary one has them.
        self.__dict__.update(known, _recording=recording)

    def __getattribute__(self, name: str) -> Any:
        """A field, which is computed where it is not known yet, whatever it is by default."""
        known = super().__getattribute__("__dict__")
        if name not in known and name in _FIELDS:
            for names, compute in known["_recording"].groups:
                if name in names:
                    # What is known already stays as it is.
                    known.update({**compute(), **known})
        return super().__getattribute__(name)

    def __reduce__(self) -> tuple[Any, ...]:
        # Copies and what is sent to other processes have all series.
        return partial(Flight, **{name: getattr(self, name) for name in _FIELDS}), ()
