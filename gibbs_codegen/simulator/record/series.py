"""The time series of one flight, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.simulator.plant.kinematics import kinematics_of

Array = NDArray[np.float64]

# Names of the fields that are the ranges of the inputs, in the order of `InputRanges`.
RANGES = ("commanded_least", "commanded_greatest", "applied_least", "applied_greatest")


@dataclass(frozen=True)
class Series:
    """Time series of one flight, a row per sample; SI units, radians, world axes with Z up.

    With s samples, nq coordinates, nv velocities, nu inputs, N rotors, k points and c constrained
    joints:

    - `time` (s); `q`, `q_desired` (s, nq); `v`, `a`, `v_desired`, `a_desired` (s, nv)
    - `commanded` and `applied` (s, nu): inputs that the controller asks for, and those that act
      after thrust limits and motor lag; `commanded_least`, `commanded_greatest`, `applied_least`
      and `applied_greatest` (s, nu): the least and the greatest of them since the sample before,
      at all steps of the integration
    - `constraint_torques` (s, c): that hold base arms 2 … N (eqs. 14–17) and constrained
      links, in the order of `constraint_names`
    - `base_arm_angles` (s, N − 1) and `base_arm_angles_desired` (N − 1): angles of base arms
      2 … N about z of the base, measured from where the motors are; none of a base without arms
    - `positions` (s, k, 3) of the `points`, and `parents` (k): numbers of the points that each is
      drawn as joined to, −1 for none; `base_rotation` (s, 3, 3), from the base's frame, which
      is arm 1's if there are arms, to the world
    - `thrust_directions` (N, 3): unit vectors of the thrusts in the base's frame; (s, N, 3) where
      rotors move with joints
    - `centre_desired`, `tip_desired` (s, 3): where base centre and tip should be; without a tip
      the latter is (s, 0)
    - `heading_error` (s): angle between base arm `tangent_arm` and the tangent of the base's path,
      0 where the attitude does not follow the path (`tangent_arm` is 0 then)
    - `frame_wrenches` (s, f, 6): force, N, and torque about the origin, N m, world axes, on each
      of the `frames`, by all that acts on the robot but its inputs: push, wind, walls, payloads and
      spinning rotors; (s, 0, 6) in files of before flights had them
    - `kinetic_energy`, `potential_energy`, `work` (s): energies, and the work that inputs and
      the wrenches on frames have done since the start

    `law` is the control law that was flown, "own" for a controller of the caller, "" in files of
    before flights said so. `control_rate` is how often it was sampled, Hz, 0 where it acts at all
    times, or where inputs came from step to step.
    `timing` says how the desired motion was timed, "" where the paths did; `binding` (b) names the
    limits that it reaches, from and to `binding_times` (b, 2), s.
    `walls` (w, 6) are a point, m, and the normal of each wall, and `wall_forces` (s, w) what it
    pushes with along that, N, NaN in files of before flights said so; `gusts` (g, 2) are from when
    to when each gust of the wind blows, s.
    `weight` is that of the robot, N, and `input_limits` (2, nu) are the least and the greatest
    inputs that motors and joints give, infinite without limits.
    `stopped` says why the flight ended before its time; it is empty where it did not.
    """

    robot: str
    scenario: str
    law: str
    control_rate: float
    attitude: str
    coordinates: tuple[str, ...]
    coordinate_units: tuple[str, ...]
    input_names: tuple[str, ...]
    points: tuple[str, ...]
    constraint_names: tuple[str, ...]
    frames: tuple[str, ...]
    tangent_arm: int
    stopped: str
    weight: float
    time: Array = field(repr=False)
    q: Array = field(repr=False)
    v: Array = field(repr=False)
    a: Array = field(repr=False)
    q_desired: Array = field(repr=False)
    v_desired: Array = field(repr=False)
    a_desired: Array = field(repr=False)
    commanded: Array = field(repr=False)
    applied: Array = field(repr=False)
    commanded_least: Array = field(repr=False)
    commanded_greatest: Array = field(repr=False)
    applied_least: Array = field(repr=False)
    applied_greatest: Array = field(repr=False)
    input_limits: Array = field(repr=False)
    constraint_torques: Array = field(repr=False)
    frame_wrenches: Array = field(repr=False)
    base_arm_angles: Array = field(repr=False)
    base_arm_angles_desired: Array = field(repr=False)
    positions: Array = field(repr=False)
    parents: NDArray[np.int_] = field(repr=False)
    base_rotation: Array = field(repr=False)
    thrust_directions: Array = field(repr=False)
    centre_desired: Array = field(repr=False)
    tip_desired: Array = field(repr=False)
    heading_error: Array = field(repr=False)
    kinetic_energy: Array = field(repr=False)
    potential_energy: Array = field(repr=False)
    work: Array = field(repr=False)
    timing: str = ""
    binding: tuple[str, ...] = field(default=(), repr=False)
    binding_times: Array = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    walls: Array = field(default_factory=lambda: np.zeros((0, 6)), repr=False)
    gusts: Array = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    wall_forces: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)

    @property
    def rotors(self) -> int:
        """Number of rotors N."""
        return int(self.thrust_directions.shape[-2])

    @cached_property
    def layout(self) -> Layout:
        """Places, names and units of the coordinates."""
        units = self.coordinate_units
        constrained = self.constraint_torques.shape[1]
        return Layout.listed(self.attitude, self.coordinates, units, constrained)

    @property
    def rotor_points(self) -> tuple[str, ...]:
        """Names (N) of the points where the rotors are, which come after the base centre."""
        first = self.points.index(self.centre) + 1
        return self.points[first : first + self.rotors]

    @property
    def errors(self) -> Array:
        """Tracking errors (s, nv), in the places of velocities: of attitude, position and joints.

        Of an attitude by a quaternion they are the rotation vector to the desired one, rad.
        """
        kinematics = kinematics_of(self.layout)
        return kinematics.errors(self.q, self.v, self.q_desired, self.v_desired)[0]

    @property
    def centre(self) -> str:
        """Name of the point that is the base centre."""
        return "O2" if "O2" in self.points else "base"

    @property
    def has_tip(self) -> bool:
        """Whether the robot has a tip: one arm, or a frame of that name."""
        return "tip" in self.points

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the inputs (nu): N of thrusts, then N m or N of the joints."""
        return ("N",) * self.rotors + self.layout.effort_units

    def point(self, name: str) -> Array:
        """Positions of a point.

        Args:
            name: Name of the point, one of `points`.

        Returns:
            Positions (s, 3), world axes, m.

        Raises:
            UsageError: If there is no such point.
        """
        if name not in self.points:
            raise UsageError(f"{name}: no such point; there are {', '.join(self.points)}")
        return self.positions[:, self.points.index(name)]

    def frame_wrench(self, name: str) -> Array:
        """Wrenches on a frame.

        Args:
            name: Name of the frame, one of `frames`.

        Returns:
            Force, N, and torque about its origin, N m, (s, 6), world axes.

        Raises:
            UsageError: If there is no such frame.
        """
        if name not in self.frames:
            raise UsageError(f"{name}: no such frame; there are {', '.join(self.frames)}")
        return self.frame_wrenches[:, self.frames.index(name)]

    @property
    def centre_error(self) -> Array:
        """Distance (s) of the base centre from where it should be, m."""
        distance: Array = np.linalg.norm(self.point(self.centre) - self.centre_desired, axis=1)
        return distance

    @property
    def tip_error(self) -> Array:
        """Distance (s) of the tip from where it should be, m."""
        distance: Array = np.linalg.norm(self.point("tip") - self.tip_desired, axis=1)
        return distance

    @property
    def energy_error(self) -> Array:
        """Change of energy since the start less the work done (s), J: 0 if energy balances."""
        energy = self.kinetic_energy + self.potential_energy
        change: Array = energy - energy[0] - self.work
        return change
