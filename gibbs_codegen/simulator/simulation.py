"""The map of a simulation: from a generated module and a scenario to a flight, stage by stage.

    Vehicle          module, parameters    → functions and layout of a robot   (vehicle)
    desired_motion   paths, attitude       → Reference: q, v, a in time        (reference)
      base_motion      position, attitude    → base coordinates, exact         (inverse_kinematics)
      arm_motion       tip                   → arm coordinates                 (inverse_kinematics)
    Controller       reference             → inputs of a state                 (control, allocation)
    ClosedLoop       controller, motors    → derivative of a state             (closed_loop)
    integrate        loop, start           → samples of the state              (integrate)
    flight_of        samples               → Flight: all that is of interest   (this module)

The simulator knows a generated module and nothing of how it was derived.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError
from gibbs_codegen.runtime.load import load
from gibbs_codegen.scenario.attitude import (
    SingularAttitudeError,
    Turning,
    attitude_angles,
)
from gibbs_codegen.scenario.file import read_scenario
from gibbs_codegen.scenario.orientation import Tangent, heading_error
from gibbs_codegen.scenario.paths import check_path
from gibbs_codegen.scenario.scenario import ArmTask, Scenario, StartOffset
from gibbs_codegen.simulator.allocation import Allocation, AllocationError
from gibbs_codegen.simulator.closed_loop import ClosedLoop
from gibbs_codegen.simulator.control import Controller, Gains
from gibbs_codegen.simulator.flight import Flight
from gibbs_codegen.simulator.hanging import hanging_posture
from gibbs_codegen.simulator.integrate import Course, integrate
from gibbs_codegen.simulator.inverse_kinematics import Limits, Motion
from gibbs_codegen.simulator.reference import (
    Reference,
    desired_base,
    desired_with_posture,
    desired_with_tip,
    knots,
)
from gibbs_codegen.simulator.vehicle import Vehicle

# Of the largest eigenvalue: what rounding may leave, on either side of it, of one that is zero.
_ROUNDING = 1e-13

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]


def simulate(
    robot: ModuleType | str | os.PathLike[str],
    scenario: Scenario | str,
    progress: Progress = lambda what, share: None,
) -> Flight:
    """Fly a scenario with the robot of a generated module, of either back end.

    A name or path of a module is loaded with the C back end; a name or path of a scenario is read.
    `progress` is told what is being done and the share of it that is done, 0 to 1. Raises
    `UsageError`, or one of its kinds, for a flight that cannot be begun: `UnreachableError`,
    `SingularAttitudeError`, `AllocationError`. One that cannot go on ends early, and `stopped` of
    the result says why.
    """
    if isinstance(scenario, str):
        scenario = read_scenario(scenario)
    module = robot if isinstance(robot, ModuleType) else load(robot, "c")
    check_path(scenario.base, scenario.duration, "the path of the base")
    if scenario.arm.tip is not None:
        check_path(scenario.arm.tip, scenario.duration, "the path of the tip")
    vehicle = Vehicle(module, scenario.parameters)
    allocation = Allocation(vehicle.thrust_wrenches(), scenario.motors.limits)
    control = scenario.control
    if control.law == "computed_torque":
        allocation.require_all_directions(
            f"{vehicle.name}: to fly {scenario.name!r} under computed torque the base must be "
            "fully actuated"
        )
    reference = desired_motion(vehicle, scenario, progress)
    if control.law == "open_loop":
        _refuse_impossible(vehicle, allocation, reference)
    count = len(vehicle.coordinates)
    gains = Gains.of(control.frequency, control.damping_ratio, count)
    controller = Controller(vehicle, reference, allocation, gains, control.law)
    loop = ClosedLoop(
        vehicle,
        controller,
        scenario.motors.limits,
        scenario.motors.time_constant,
        scenario.tip_force,
    )
    q, v = starting_state(vehicle, reference, scenario.start)
    _refuse_indefinite(vehicle, q)
    state = loop.start(q, v)
    course = integrate(
        loop,
        state,
        scenario.duration,
        scenario.integration,
        lambda time, duration: progress("flying", time / duration),
    )
    return flight_of(loop, scenario, course)


def desired_motion(
    vehicle: Vehicle, scenario: Scenario, progress: Progress = lambda what, share: None
) -> Reference:
    """Coordinates, rates and accelerations that a scenario asks of a robot, as functions of time.

    Raises `UsageError`, or one of its kinds, where there are none, and for a posture or guess
    outside the limits of its joints.
    """
    task = scenario.arm
    limits = _joint_limits(vehicle, task)
    time = knots(scenario.duration)

    def base_at(knots: Array) -> Motion:
        # Only the first and longest of them is worth a word: what follows is the arm's.
        told = partial(progress, "desired motion") if knots is time else lambda share: None
        return desired_base(vehicle, knots, scenario.base, scenario.attitude, told)

    if task.tip is None:
        if task.posture is None:
            posture = hanging_posture(vehicle, limits)
        else:
            posture = _joint_values(vehicle, task.posture)
            _refuse_outside(vehicle, "posture", posture, limits, vehicle.joint_names)
        return Reference(desired_with_posture(vehicle, base_at(time), posture))
    guess = None
    if task.guess is not None:
        guess = _joint_values(vehicle, task.guess)
        # Joints left out are not said to be anywhere: the search begins at the limit nearest to 0.
        _refuse_outside(vehicle, "guess", guess, limits, task.guess)
    motion = desired_with_tip(
        vehicle,
        time,
        base_at,
        task.tip,
        limits,
        guess,
        lambda done, total: progress("inverse kinematics", done / total),
    )
    return Reference(motion)


def starting_state(vehicle: Vehicle, reference: Reference, off: StartOffset) -> tuple[Array, Array]:
    """Coordinates and rates (nq) at time 0: the desired ones, but for what is off.

    Raises `SingularAttitudeError` for a rotation to where attitude angles are singular.
    """
    q, v, _ = reference(reference.begin)
    if not any(off.position) and not any(off.rotation):
        return q, v
    attitude, position = vehicle.layout.attitude, vehicle.layout.position
    centre = q[position] + vehicle.centre_offset(q)
    turned = Rotation.from_rotvec(off.rotation).as_matrix() @ vehicle.base_rotation(q)
    still = np.zeros(3)
    try:
        angles, _, _ = attitude_angles(vehicle.attitude, Turning(turned, still, still))
    except SingularAttitudeError as error:
        raise SingularAttitudeError(
            f"at t = {reference.begin:.6g} s, with the base turned by start.turn_deg (the start's "
            f"rotation), {error}, or turn it less or another way at the start",
            error.place,
        ) from None
    start = q.copy()
    # Of angles that differ by whole turns, those nearest to the desired ones.
    start[attitude] = angles + 2.0 * np.pi * np.round((q[attitude] - angles) / (2.0 * np.pi))
    start[position] = centre + off.position - vehicle.centre_offset(start)
    return start, v


def _refuse_indefinite(vehicle: Vehicle, q: Array) -> None:
    """Raise `UsageError` for a machine that no bodies make, or that is singular where it starts."""
    matrix = vehicle.mass_matrix(q)
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        eigenvalues = np.linalg.eigvalsh(matrix)
        if eigenvalues[0] > -_ROUNDING * eigenvalues[-1]:
            raise UsageError(
                f"{vehicle.name}: its mass matrix is singular where the flight begins: some motion "
                "of its joints moves no mass there; begin with another posture, or give its links "
                "mass and thickness"
            ) from None
        raise UsageError(
            f"{vehicle.name}: with these parameters its mass matrix is not positive definite; "
            "masses and inertias must be those of bodies"
        ) from None


def _refuse_impossible(vehicle: Vehicle, allocation: Allocation, reference: Reference) -> None:
    """Raise `AllocationError`, with the first time, for a motion that the rotors cannot make."""
    time = np.linspace(reference.begin, reference.end, len(reference.coefficients) + 1)
    q, v, a = reference(time)
    wrenches = vehicle.base_wrench(q, vehicle.inverse_dynamics(q, v, a))
    short = np.flatnonzero(allocation.shortfall(wrenches))
    if len(short):
        try:
            allocation.thrusts(wrenches[short])
        except AllocationError as error:
            first = f"from t = {time[short[0]]:.6g} s on "
            raise AllocationError(f"{vehicle.name}: {first}{error}", error.missing) from None


def flight_of(loop: ClosedLoop, scenario: Scenario, course: Course) -> Flight:
    """All series of a flight, from the samples of its state."""
    vehicle, time = loop.vehicle, course.time
    q, v, work, thrusts = loop.parts(course.states)
    wanted_q, wanted_v, wanted_a = loop.controller.reference(time)
    commanded = loop.commanded(time, q, v)
    applied = loop.applied(commanded, thrusts)
    acceleration = loop.acceleration(q, v, applied, loop.pushed(time))
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


def _refuse_outside(
    vehicle: Vehicle, what: str, values: Array, limits: Limits, joints: Iterable[str]
) -> None:
    """Raise `UsageError` for the first of some joints whose value is outside its limits."""
    for name in joints:
        joint = _joint(vehicle, name)
        value, low, high = values[joint], limits[0][joint], limits[1][joint]
        if not low <= value <= high:
            unit = vehicle.layout.units[vehicle.arm][joint]
            raise UsageError(
                f"arm: {what}: {name} = {value:.6g} {unit} is outside its limits, "
                f"{low:.6g} to {high:.6g} {unit}; a joint left out of a posture is at 0"
            )


def _joint(vehicle: Vehicle, name: str) -> int:
    if name not in vehicle.joint_names:
        known = ", ".join(vehicle.joint_names) or "none"
        raise UsageError(f"{vehicle.name}: has no joint {name}; its joints: {known}")
    return vehicle.joint_names.index(name)
