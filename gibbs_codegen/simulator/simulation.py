"""The map of a simulation: from a generated module and a scenario to a flight, stage by stage.

    Vehicle          module, parameters    → functions and layout of a robot   (vehicle)
    desired_motion   paths, attitude       → Reference: q, v, a in time        (reference)
      base_motion      position, attitude    → base coordinates, exact         (inverse_kinematics)
      arm_motion       tip                   → arm coordinates                 (inverse_kinematics)
    Controller       reference             → inputs of a state                 (control, allocation)
    Plant            controller, motors    → derivative of a state             (plant)
    integrate        plant, start          → samples of the state              (integrate)
    flight_of        samples               → Flight: all that is of interest   (this module)

The simulator knows a generated module and nothing of how it was derived.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.allocation import Allocation
from gibbs_codegen.simulator.attitude import Turning, attitude_angles, rotation_matrix
from gibbs_codegen.simulator.control import Controller, Gains
from gibbs_codegen.simulator.flight import Flight
from gibbs_codegen.simulator.integrate import Course, integrate
from gibbs_codegen.simulator.inverse_kinematics import Limits
from gibbs_codegen.simulator.orientation import Tangent, heading_error
from gibbs_codegen.simulator.plant import Plant
from gibbs_codegen.simulator.reference import (
    Reference,
    desired_base,
    desired_with_posture,
    desired_with_tip,
    hanging_posture,
    knots,
)
from gibbs_codegen.simulator.scenario import ArmTask, Disturbance, Scenario
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]


def simulate(
    module: ModuleType, scenario: Scenario, progress: Progress = lambda what, share: None
) -> Flight:
    """Fly a scenario with the robot of a generated module, of either back end.

    `progress` is told what is being done and the share of it that is done, 0 to 1. Raises
    `UsageError`, or one of its kinds, for a flight that cannot be begun: `UnreachableError`,
    `SingularAttitudeError`, `AllocationError`. One that cannot go on ends early, and `stopped` of
    the result says why.
    """
    vehicle = Vehicle(module, scenario.parameters)
    allocation = Allocation(vehicle.thrust_wrenches(), scenario.motors.limits)
    control = scenario.control
    if control.law == "computed_torque":
        allocation.require_all_directions(
            f"{vehicle.name}: to fly {scenario.name!r} under computed torque the base must be "
            "free to move in any direction"
        )
    reference = desired_motion(vehicle, scenario, progress)
    count = len(vehicle.coordinates)
    gains = Gains.of(control.frequency, control.damping_ratio, count)
    controller = Controller(vehicle, reference, allocation, gains, control.law)
    plant = Plant(
        vehicle,
        controller,
        scenario.motors.limits,
        scenario.motors.time_constant,
        scenario.tip_force,
    )
    state = plant.start(*starting_state(vehicle, reference, scenario.start))
    course = integrate(
        plant,
        state,
        scenario.duration,
        scenario.integration,
        lambda time, duration: progress("flying", time / duration),
    )
    return flight_of(plant, scenario, course)


def desired_motion(
    vehicle: Vehicle, scenario: Scenario, progress: Progress = lambda what, share: None
) -> Reference:
    """Coordinates, rates and accelerations that a scenario asks of a robot, as functions of time.

    Raises `UsageError`, or one of its kinds, where there are none.
    """
    task = scenario.arm
    limits = _joint_limits(vehicle, task)
    time = knots(scenario.duration)
    base = desired_base(vehicle, time, scenario.base, scenario.attitude)
    if task.tip is None:
        posture = (
            hanging_posture(vehicle, limits)
            if task.posture is None
            else _joint_values(vehicle, task.posture)
        )
        return Reference(desired_with_posture(vehicle, base, posture))
    guess = None if task.guess is None else _joint_values(vehicle, task.guess)
    motion = desired_with_tip(
        vehicle,
        base,
        task.tip,
        limits,
        guess,
        lambda done, total: progress("inverse kinematics", done / total),
    )
    return Reference(motion)


def starting_state(vehicle: Vehicle, reference: Reference, off: Disturbance) -> tuple[Array, Array]:
    """Coordinates and rates (nq) at time 0: the desired ones, but for what is off."""
    q, v, _ = reference(reference.begin)
    if not any(off.position) and not any(off.rotation):
        return q, v
    centre = q[-3:] + vehicle.centre_offset(q)
    turned = Rotation.from_rotvec(off.rotation).as_matrix() @ rotation_matrix(
        vehicle.attitude, q[:3]
    )
    still = np.zeros(3)
    angles, _, _ = attitude_angles(vehicle.attitude, Turning(turned, still, still))
    start = q.copy()
    # Of angles that differ by whole turns, those nearest to the desired ones.
    start[:3] = angles + 2.0 * np.pi * np.round((q[:3] - angles) / (2.0 * np.pi))
    start[-3:] = centre + off.position - vehicle.centre_offset(start)
    return start, v


def flight_of(plant: Plant, scenario: Scenario, course: Course) -> Flight:
    """All series of a flight, from the samples of its state."""
    vehicle, time = plant.vehicle, course.time
    q, v, work, thrusts = plant.parts(course.states)
    wanted_q, wanted_v, wanted_a = plant.controller.reference(time)
    commanded = plant.commanded(time, q, v)
    applied = plant.applied(commanded, thrusts)
    acceleration = plant.acceleration(q, v, applied, plant.pushed(time))
    positions = vehicle.positions(q)
    tip = vehicle.points.index("tip")
    tip_wanted = (
        scenario.arm.tip(time)[:, 0] if scenario.arm.tip else vehicle.positions(wanted_q)[:, tip]
    )
    tangent = scenario.attitude.arm if isinstance(scenario.attitude, Tangent) else 0
    rotation = vehicle.base_rotation(q)
    error = np.zeros(len(time))
    if tangent:
        angle = vehicle.arm_angles()[tangent - 1]
        direction = rotation @ np.array([np.cos(angle), np.sin(angle), 0.0])
        error = heading_error(scenario.base, time, direction)
    forces = vehicle.thrust_wrenches()[:3].T
    return Flight(
        robot=vehicle.name,
        scenario=scenario.name,
        coordinates=vehicle.coordinates,
        input_names=vehicle.inputs,
        points=vehicle.points,
        tangent_arm=tangent,
        stopped=course.stopped,
        time=time,
        q=q,
        v=v,
        a=acceleration,
        q_desired=wanted_q,
        v_desired=wanted_v,
        a_desired=wanted_a,
        commanded=commanded,
        applied=applied,
        constraint_torques=vehicle.constraint_torques(q, v, acceleration, applied),
        base_arm_angles=_measured_arm_angles(vehicle, positions, rotation),
        base_arm_angles_desired=vehicle.arm_angles()[1:],
        positions=positions,
        base_rotation=rotation,
        thrust_directions=forces / np.linalg.norm(forces, axis=1, keepdims=True),
        centre_desired=scenario.base(time)[:, 0],
        tip_desired=tip_wanted,
        heading_error=error,
        kinetic_energy=vehicle.kinetic_energy(q, v),
        potential_energy=vehicle.potential_energy(q),
        work=work,
    )


def _measured_arm_angles(vehicle: Vehicle, positions: Array, rotation: Array) -> Array:
    """Angles (s, N − 1) of base arms 2 … N against arm 1, from where the motors are."""
    centre = positions[:, vehicle.points.index("O2")]
    angles = []
    for k in range(2, vehicle.rotors + 1):
        arm = positions[:, vehicle.points.index(f"motor{k}")] - centre
        x, y, _ = np.einsum("sji,sj->is", rotation, arm)
        angles.append(np.arctan2(y, x))
    return np.stack(angles, axis=-1)


def _joint_limits(vehicle: Vehicle, task: ArmTask) -> Limits:
    low, high = np.full(vehicle.joints, -np.inf), np.full(vehicle.joints, np.inf)
    for name, (least, most) in task.limits.items():
        low[_joint(vehicle, name)], high[_joint(vehicle, name)] = least, most
    return low, high


def _joint_values(vehicle: Vehicle, values: Mapping[str, float]) -> Array:
    found = np.zeros(vehicle.joints)
    for name, value in values.items():
        found[_joint(vehicle, name)] = value
    return found


def _joint(vehicle: Vehicle, name: str) -> int:
    if name not in vehicle.joint_names:
        known = ", ".join(vehicle.joint_names) or "none"
        raise UsageError(f"{vehicle.name}: has no joint {name}; its joints: {known}")
    return vehicle.joint_names.index(name)
