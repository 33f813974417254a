"""The record of a flight: all its time series, from the samples of the state."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gibbs_codegen.scenario.orientation import Tangent, heading_error
from gibbs_codegen.scenario.scenario import Scenario
from gibbs_codegen.simulator.desired.timed_motion import TimedMotion
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.integration.state_history import StateHistory
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.record.connections import point_parents
from gibbs_codegen.simulator.record.flight import Flight
from gibbs_codegen.simulator.record.series import RANGES


def flight_of(loop: ClosedLoop, scenario: Scenario, history: StateHistory) -> Flight:
    """All time series of a flight.

    Args:
        loop: The closed loop that was integrated.
        scenario: What was flown.
        history: Samples of the state.

    Returns:
        The flight, with a row per sample.
    """
    vehicle, time = loop.vehicle, history.time
    parts = loop.parts(history.states)
    q, v = parts.q, parts.v
    reference = loop.controller.reference(time)
    applied = loop.applied(commanded := loop.commanded(time, parts), parts.thrusts)
    loads = loop.wrenches(time, q, v, applied, loop.acting(time))
    a = loop.acceleration(q, v, applied, loads)
    return Flight(
        robot=vehicle.name,
        scenario=scenario.name,
        law=loop.controller.law,
        control_rate=loop.held.rate if loop.held else 0.0,
        attitude=vehicle.attitude,
        coordinates=vehicle.coordinates,
        coordinate_units=vehicle.layout.q.units,
        input_names=vehicle.inputs,
        points=vehicle.points,
        constraint_names=vehicle.constraint_names,
        tangent_arm=_tangent_arm(vehicle, scenario),
        stopped=history.stopped,
        time=time,
        q=q,
        v=v,
        a=a,
        **_desired(reference),
        **_inputs(loop, history, commanded, applied),
        constraint_torques=vehicle.constraint_torques(q, v, a, applied),
        frames=vehicle.frames,
        frame_wrenches=loads,
        **_base(vehicle, q),
        positions=vehicle.positions(q),
        parents=point_parents(vehicle),
        thrust_directions=_thrust_directions(vehicle, q),
        centre_desired=scenario.base(time)[:, 0],
        tip_desired=_desired_tip(loop.controller.vehicle, scenario, time, reference[0]),
        heading_error=_heading_errors(vehicle, scenario, time, q),
        **_surroundings(vehicle, scenario),
        **_energies(vehicle, q, v, parts.work),
    )


def _base(vehicle: Vehicle, q: Array) -> dict[str, Any]:
    """Rotation of the base, and angles of its arms, rad, by the names of the fields."""
    measured, desired = _measured_arm_angles(vehicle, q), vehicle.arm_angles()[1:]
    arms = {"base_arm_angles": measured, "base_arm_angles_desired": desired}
    return {**arms, "base_rotation": vehicle.base_rotation(q)}


def _surroundings(vehicle: Vehicle, scenario: Scenario) -> dict[str, Any]:
    """Weight, walls, and times of gusts, by the names of the fields."""
    gusts = scenario.wind.gusts if scenario.wind else ()
    walls = [[*wall.point, *wall.normal] for wall in scenario.walls]
    blowing = [[gust.begin, gust.begin + gust.duration] for gust in gusts]
    return {
        "weight": _weight(vehicle),
        "walls": np.array(walls, dtype=np.float64).reshape(-1, 6),
        "gusts": np.array(blowing, dtype=np.float64).reshape(-1, 2),
    }


def _weight(vehicle: Vehicle) -> float:
    """Weight of a robot, N: what its potential energy grows by for each metre of height."""
    lifted = vehicle.neutral
    lifted[vehicle.layout.q.position][2] += 1.0
    return float(vehicle.potential_energy(lifted) - vehicle.potential_energy(vehicle.neutral))


def _energies(vehicle: Vehicle, q: Array, v: Array, work: Array) -> dict[str, Any]:
    """Energies and work, by the names of the fields.

    Args:
        vehicle: The robot.
        q, v: Coordinates (s, nq) and velocities (s, nv).
        work: Work (s), J.

    Returns:
        The series (s), J.
    """
    kinetic, potential = vehicle.kinetic_energy(q, v), vehicle.potential_energy(q)
    return {"kinetic_energy": kinetic, "potential_energy": potential, "work": work}


def _inputs(
    loop: ClosedLoop, history: StateHistory, commanded: Array, applied: Array
) -> dict[str, Any]:
    """Inputs, with their limits and their ranges between samples.

    Args:
        loop: The closed loop that was integrated.
        history: Samples of the state.
        commanded, applied: Inputs (s, nu) at the samples.

    Returns:
        Series (s, nu) and limits (2, nu) by the names of their fields.
    """
    ranges = history.inputs.up_to_samples(history.time, commanded, applied)
    limits = np.array(loop.actuators.inputs)
    known = {"commanded": commanded, "applied": applied, "input_limits": limits}
    return {**known, **dict(zip(RANGES, ranges.reshape(4, *applied.shape), strict=True))}


def _desired(reference: tuple[Array, Array, Array]) -> dict[str, Any]:
    """Desired coordinates (s, nq), velocities and accelerations (s, nv) by names of fields."""
    return dict(zip(("q_desired", "v_desired", "a_desired"), reference, strict=True))


def told_timing(flight: Flight, motion: TimedMotion) -> Flight:
    """The flight with what is to be said of its timing.

    Args:
        flight: The flight.
        motion: What was flown.

    Returns:
        The flight.
    """
    times = [(each.begin, each.end) for each in motion.binding]
    return replace(
        flight,
        timing=motion.said,
        binding=tuple(each.what for each in motion.binding),
        binding_times=np.reshape(times, (-1, 2)),
    )


def _thrust_directions(vehicle: Vehicle, q: Array) -> Array:
    """Unit vectors of the thrusts in the base's frame, at coordinates (s, nq).

    They are (N, 3) where they are the same in all samples, and (s, N, 3) where rotors move.
    """
    wrenches = vehicle.thrust_wrenches(q if vehicle.rotors_move else None)
    forces = np.swapaxes(wrenches[..., :3, :], -1, -2)
    directions: Array = forces / np.linalg.norm(forces, axis=-1, keepdims=True)
    return directions


def _tangent_arm(vehicle: Vehicle, scenario: Scenario) -> int:
    """The base arm that points along the path, from 1, or 0 for none."""
    attitude = scenario.attitude
    return attitude.arm if isinstance(attitude, Tangent) and len(vehicle.arm_angles()) else 0


def _desired_tip(vehicle: Vehicle, scenario: Scenario, time: Array, q_desired: Array) -> Array:
    """Desired position of the tip.

    Args:
        vehicle: The robot as the controller knows it.
        scenario: What was flown.
        time: Times (s), s.
        q_desired: Desired coordinates (s, nq).

    Returns:
        Positions (s, 3), world axes, m: on the tip's path, or where a held posture puts the tip;
        (s, 0) without a tip.
    """
    if not vehicle.has_tip:
        return np.zeros((len(time), 0))
    if scenario.arm.tip:
        return scenario.arm.tip(time)[:, 0]
    return vehicle.positions(q_desired)[:, vehicle.points.index("tip")]


def _heading_errors(vehicle: Vehicle, scenario: Scenario, time: Array, q: Array) -> Array:
    """Angle between the base arm that follows the path, and the tangent of the path.

    Args:
        vehicle: The robot.
        scenario: What was flown.
        time: Times (s), s.
        q: Coordinates (s, nq).

    Returns:
        Angles (s), rad; 0 where no arm follows the path.
    """
    if not (arm := _tangent_arm(vehicle, scenario)):
        return np.zeros(len(time))
    angles = vehicle.arm_angles()
    angle = angles[arm - 1] if len(angles) else 0.0  # A base without arms follows with its x axis.
    direction = vehicle.base_rotation(q) @ np.array([np.cos(angle), np.sin(angle), 0.0])
    return heading_error(scenario.base, time, direction)


def _measured_arm_angles(vehicle: Vehicle, q: Array) -> Array:
    """Angles of base arms 2 … N against arm 1, from where the motors are.

    Args:
        vehicle: The robot.
        q: Coordinates (s, nq).

    Returns:
        Angles (s, N − 1), rad; (s, 0) of a base without arms.
    """
    positions, rotation = vehicle.positions(q), vehicle.base_rotation(q)
    centre = positions[:, vehicle.points.index(vehicle.centre)]
    angles = [np.zeros((0, len(positions)))]
    for k in range(2, len(vehicle.arm_angles()) + 1):
        arm = positions[:, vehicle.points.index(f"motor{k}")] - centre
        x, y, _ = np.einsum("sji,sj->is", rotation, arm)
        angles.append(np.arctan2(y, x)[np.newaxis])
    return np.concatenate(angles).T
