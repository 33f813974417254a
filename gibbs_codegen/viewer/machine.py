"""A generated module at rest in some posture: where its parts are, and what acts in it."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.analysis.input_choice import Balancing
from gibbs_codegen.simulator.plant.actuators import robot_file_actuators
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.record.connections import point_parents
from gibbs_codegen.viewer.skeleton import Points, Skeleton, skeleton

# Accelerations, m/s² and rad/s², and shares of the largest entry, below which there is none.
_STILL, _ZERO = 1e-6, 1e-12
# Postures from which it is told which entries of the hybrid system are filled.
_POSTURES = 4
# How far joints may be bent to begin with, and how far angles without limits go, rad.
_BENT, _TURN = (-0.7, 0.7, -2.4, 2.4), float(np.pi)


@dataclass(frozen=True)
class State:
    """A robot at rest, with all that is computed of it.

    - `q` (nq), `u` (nu): coordinates and inputs, `a` (nv): accelerations
    - `points` (k, 3), `directions` (N, 3), `frames` (f, 4, 4): in the world, as of `Posture`
    - `held` (c): torques of the constraints, N m
    - `system` (m, m + 1 + nu): I_H, R_H and B_H of the hybrid system
    - `conditions`: those of M and of I_H, infinite where they are singular
    """

    q: Array
    u: Array
    a: Array
    points: Array
    directions: Array
    frames: Array
    held: Array
    system: Array
    conditions: tuple[float, float]

    @property
    def is_still(self) -> bool:
        """Whether the inputs hold the robot where it is."""
        return bool(np.all(np.abs(self.a) < _STILL))


class Machine:
    """A generated module, with the back end "numpy" or "c", whose parameters can be changed."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module
        self._given: dict[str, float] = {}
        self.vehicle = Vehicle(module)
        actuators = robot_file_actuators(self.vehicle)
        self.input_limits, self.joint_limits = actuators.inputs, actuators.joints
        self.parents = point_parents(self.vehicle).tolist()

    def give(self, parameters: dict[str, float]) -> None:
        """Take other parameters of `prepare`; those not given get their defaults.

        Raises `UsageError` if `prepare` rejects them; the ones before stay.
        """
        if parameters != self._given:
            self.vehicle = Vehicle(self.module, parameters)
            self._given = dict(parameters)

    @property
    def arms(self) -> int:
        """Number of base arms that constraints hold."""
        return max(len(self.vehicle.arm_angles()) - 1, 0)

    def start(self) -> Array:
        """Where controls begin: level, with joints bent so that the arms hang down and away."""
        vehicle = self.vehicle
        centre = vehicle.points.index(vehicle.centre)
        controls = np.zeros(6 + vehicle.joints)
        controls[3:-3] = np.clip(0.0, *self.joint_limits)
        # What a joint does depends on those after it: twice.
        for joint in 2 * np.flatnonzero(vehicle.is_angle[vehicle.arm]).tolist():
            tried = np.repeat(controls[np.newaxis], len(_BENT), axis=0)
            tried[:, 3 + joint] = np.clip(_BENT, *self.joint_limits[:, joint])
            points = np.array([vehicle.positions(self.coordinates(each)) for each in tried])
            around = points - points[:, [centre]]
            score = np.sum(around[..., 2] - np.linalg.norm(around, axis=-1), axis=-1)
            controls = tried[int(np.argmin(np.round(score, 9)))]
        return controls

    def controls(self, room: float) -> tuple[list[str], Array]:
        """Names with units of the robot's coordinates, and their least and greatest values (2, n).

        They are angles of the attitude, which are roll, pitch and yaw instead of a quaternion,
        joints and position. `room` is how far those go that are lengths without limits, m.
        """
        vehicle = self.vehicle
        names, units = vehicle.layout.q.names, vehicle.layout.q.units
        entries = [*zip(names, units, strict=True)]
        attitude = entries[vehicle.layout.q.attitude]
        if vehicle.layout.is_quaternion:
            attitude = [("roll", "rad"), ("pitch", "rad"), ("yaw", "rad")]
        chosen = [*attitude, *entries[vehicle.arm], *entries[vehicle.layout.q.position]]
        rooms = np.array([_TURN if unit == "rad" else room for _, unit in chosen])
        low, high = -rooms, rooms
        joints = slice(3, 3 + vehicle.joints)
        for ends, limits in ((low, self.joint_limits[0]), (high, self.joint_limits[1])):
            ends[joints] = np.where(np.isfinite(limits), limits, ends[joints])
        return [f"{name}, {unit}" for name, unit in chosen], np.stack([low, high])

    def input_controls(self, u: Array, room: float) -> tuple[list[str], Array]:
        """Names with units of the robot's inputs, and their least and greatest values (2, nu).

        Inputs without limits go as far as `room` in the largest usual one, of `u`, of their unit.
        """
        vehicle = self.vehicle
        units = np.array(["N"] * vehicle.rotors + [*vehicle.layout.effort_units])
        usual = [room * float(np.abs(u[units == unit]).max()) or 1.0 for unit in units]
        ends = np.outer([-1.0, 1.0], usual)
        ends = np.where(np.isfinite(self.input_limits), self.input_limits, ends)
        return [f"{n}, {unit}" for n, unit in zip(vehicle.inputs, units, strict=True)], ends

    def beyond(self, u: Array) -> list[str]:
        """A sentence for each input that exceeds the limits of the robot file."""
        sides = zip(self.vehicle.inputs, u, *self.input_limits, strict=True)
        return [
            f"{name} = {value:.4g} is beyond its limits, {low:.4g} to {high:.4g}."
            for name, value, low, high in sides
            if value < low - _STILL or value > high + _STILL
        ]

    def coordinates(self, controls: Array) -> Array:
        """Coordinates (nq) of three angles of the attitude, joints and position."""
        layout = self.vehicle.layout
        q = self.vehicle.neutral
        turns, q[layout.q.joints], q[layout.q.position] = np.split(controls, [3, len(controls) - 3])
        if layout.is_quaternion:
            turns = Rotation.from_euler("xyz", turns).as_quat()
        q[layout.q.attitude] = turns
        return q

    def hover(self, q: Array) -> Array:
        """The inputs (nu) of least thrust that hold the robot, or do so as nearly as they can.

        They know no limits.
        """
        still = np.zeros(self.vehicle.layout.v.size)
        force = self.vehicle.inverse_dynamics(q, still, still)
        return Balancing.of(self.vehicle, q, force).least

    def state(self, q: Array, u: Array) -> State:
        """The robot at rest; what is undetermined is no number."""
        vehicle = self.vehicle
        still = np.zeros(vehicle.layout.v.size)
        with np.errstate(all="ignore"):
            a = vehicle.forward_dynamics(q, still, u)
            matrix = vehicle.mass_matrix(q)
            system = self.hybrid_system(q)
            hybrid = system[:, : len(system)]
            return State(
                q,
                u,
                a,
                vehicle.positions(q),
                self._directions(q),
                vehicle.frame_poses(q),
                vehicle.constraint_torques(q, still, a, u),
                system,
                (float(np.linalg.cond(matrix)), float(np.linalg.cond(hybrid))),
            )

    def hybrid_system(self, q: Array) -> Array:
        """I_H, R_H and B_H of the robot at rest beside each other, (m, m + 1 + nu)."""
        function = self.vehicle.function
        residual = function("hybrid_residual")(q, np.zeros(self.vehicle.layout.v.size))
        matrix, inputs = function("hybrid_mass_matrix")(q), function("hybrid_input_matrix")(q)
        whole: Array = np.hstack([matrix, residual[:, np.newaxis], inputs])
        return whole

    def pattern(self) -> NDArray[np.bool_]:
        """Whether each entry of the hybrid system at rest is not zero in every posture."""
        generator = np.random.default_rng(1)
        filled = np.zeros((1, 1), dtype=bool)
        for _ in range(_POSTURES):
            q = self.coordinates(generator.uniform(0.2, 1.2, 6 + self.vehicle.joints))
            filled = filled | changed(self.hybrid_system(q), np.zeros((1, 1)))
        return filled

    def skeleton(self, q: Array) -> Skeleton:
        """How the robot is drawn, in sizes taken at coordinates q."""
        vehicle = self.vehicle
        centre = vehicle.points.index(vehicle.centre)
        points = Points(self.parents, centre, vehicle.rotors, vehicle.joints, self.arms)
        return skeleton(points, vehicle.positions(q), self._directions(q))

    def _directions(self, q: Array) -> Array:
        """Unit vectors (N, 3) of the thrusts in the world."""
        forces = self.vehicle.base_rotation(q) @ self.vehicle.thrust_wrenches(q)[:3]
        directions: Array = (forces / np.linalg.norm(forces, axis=0)).T
        return directions


def changed(new: Array, old: Array) -> NDArray[np.bool_]:
    """Which entries of an array differ from those of another by more than rounding."""
    size = np.nanmax(np.abs(new), initial=1.0)
    differs: NDArray[np.bool_] = np.abs(new - old) > _ZERO * size
    return differs
