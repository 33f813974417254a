"""A flight: the time series that a simulation leaves, what follows from them, and their files."""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.staging import writing
from gibbs_codegen.flight.plant.actuators import at_limits, followed
from gibbs_codegen.flight.plant.kinematics import kinematics_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.parts import PREDICTIVE
from gibbs_codegen.flight.vectors import Array as Array
from gibbs_codegen.flight.vectors import roll_pitch_yaw
from gibbs_codegen.machine.base import RETURN
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.robot.layout import Layout

# Names of the fields that are the ranges of the inputs, in the order of `InputRanges`.
RANGES = ("commanded_least", "commanded_greatest", "applied_least", "applied_greatest")
# Arrays without a row for each sample.
NO_SERIES = frozenset(
    {
        *(
            "back",
            "base_arm_angles_desired",
            "binding_times",
            "contact_walls",
            "disc_radii",
            "gusts",
        ),
        *("hold_times", "impacts", "impulses", "motor_times"),
        *("input_limits", "joint_limits", "sensor_delays", "sensor_rates", "walls", "wheels"),
    }
)
# Fields of a flight in which nothing estimates the state.
NO_ESTIMATES: dict[str, Any] = {
    **dict.fromkeys(("estimate_names", "estimate_units", "innovation_names"), ()),
    **dict.fromkeys(
        ("estimates", "estimate_deviations", "estimate_errors", "innovations"), np.zeros((0, 0))
    ),
}
# Rows of a CSV that are written at a time.
_ROWS = 4096
# A wall carries a robot that rests on it by no more than this share of the weight.
_RESTS = 1.01
# Endings of names of rows of constraints that hold places, not attitudes.
_LINEAR_ROWS = frozenset({"x", "y", "z", "distance", "normal"})
# Share of the range of a joint that is far from its posture.
_TURNED = 0.25
# Commands that jump by more than this share of the greatest, in more than this share of samples;
# greatest ones that are rounding.
_JUMP, _CHATTERS, _NOTHING = 0.5, 0.05, 1e-9
# Distance, m, and angle, degrees, beyond which the end of a base that follows a path is reported.
_ASTRAY, _OVERTURNED = 1.0, 90.0
Column = tuple[str, str, Array]
StrPath = str | os.PathLike[str]
# Endings of names of columns of inputs, and their series.
_INPUTS = {
    "": "applied",
    "_least": "applied_least",
    "_greatest": "applied_greatest",
    "_commanded": "commanded",
    "_commanded_least": "commanded_least",
    "_commanded_greatest": "commanded_greatest",
}


@dataclass(frozen=True, kw_only=True)
class Flight:
    """Time series of one flight, a row per sample; SI units, radians, world axes with Z up.

    With s samples, nq coordinates, nv velocities, nu inputs, N rotors, k points and c constrained
    joints:

    - `time` (s); `q`, `q_desired` (s, nq); `v`, `a`, `v_desired`, `a_desired` (s, nv)
    - `commanded` and `applied` (s, nu): inputs u that the controller asks for, and those that act
      after thrust limits and motor lag; `commanded_least`, `commanded_greatest`, `applied_least`
      and `applied_greatest` (s, nu): the least and the greatest of them since the sample before,
      at all steps of the integration
    - `commands` (s, nu): what motors and servos are sent, by `command_names` and `command_units`,
      and `actuators` (s, x): the state of these, by `actuator_names`; (s, 0) of robots without, and
      in files of before flights had them
    - `battery` (s, 2): voltage, V, and current, A, with the load; (s, 0) likewise
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
    `walls` (w, figures) have of each wall a point, m, and a direction: of a plane or floor the
    normal, of a cylinder the axis, and then the radius, m. Of a sphere they have centre and radius,
    of a box the centre, the rotation to world axes, row by row, and half of its edges.
    `wall_kinds` (w) say which it is, all are planes in files that have none. `wall_forces` (s, w)
    are what it pushes with out of its surface, N, NaN in files of before flights said so.
    Of each pair of a wall and a frame, `contact_walls` (c) from 1 and `contact_frames` (c), called
    by `contact_names`, `contact_forces` (s, c), N, are those along the normal, `contact_friction`
    (s, c, 3), N, those across it on the frame, world axes. `contact_slip` (s, c, 3), m/s, is the
    velocity at which it slides, 0 where it sticks or is away, `contact_depth` (s, c), m, how
    deep it is, negative outside.
    `hold_forces` (s, l), N and N m, are those of constraints by `hold_names`, the rows of these, in
    the axes of their anchors; 0 of constraints that do not hold. `hold_errors` (s, l), m and rad,
    are how far these are from being met, (s, 0) in flights without holds. The constraints `held`
    (h) are so from and to `hold_times` (h, 2), s. `impacts` (i, 3) are when constraints took hold,
    or frames came to stops, s, the kinetic energy, J, that was lost, and what was left; the `work`
    has the loss. A sample of that instant is of after the impact. `impulses` (i, l), N s and N m s,
    are those of the rows, 0 of constraints that took no part. Files of before flights had impulses
    have none, and (i, 2) of impacts.
    `hard_impacts` are sentences on impacts at walls for which the steps were too long.
    `sensors` (s, m) are the last readings of the robot's sensors at each sample, by `sensor_names`
    and `sensor_units`, as `SensorSuite` describes them; NaN before the first reading, and (s, 0)
    without sensors. `sensor_frames` (m) are the frames at which they are, "" of those at none, and
    `sensor_rates` and `sensor_delays` (m) how often they are read, Hz, and how late readings come,
    s; none in files of before flights had them.
    `estimates` (s, nq + nv + e) are those of a filter at each sample: q, v, and loads and biases
    by `estimate_names` and `estimate_units` (e). `estimate_errors` (s, nd + nv) are displacements
    from estimates to q, and differences to v; `estimate_deviations` (s, nd + nv + e) what it takes
    for standard deviations of these and of the others. `innovations` (s, d) are the last squared
    innovations of sensors by `innovation_names`, normalised so that 1 is their mean. Without a
    filter all are empty.
    `wheels` (w, 3) are the angles of wheels that turn by the way along the base's axes, rad/m, and
    `wheel_points` (w) the points where they turn. `back` (2) are `control.return_rate`, 1/s, and
    `control.return_speed`, m/s, by which the base comes back from the side.
    `disc_radii` (N), m, are those of the rotors, 0 where nobody says them.
    `gusts` (g, 2) are from when to when each gust of the wind
    blows, s, and motors run from and to `motor_times` (2), s.
    `weight` is that of the robot, N, `gravity` the acceleration of things that fall, m/s², NaN in
    files of before flights had it, and `input_limits` (2, nu) are the least and the greatest
    inputs that motors and joints give, infinite without limits. `joint_limits` (2, n) are those of
    the joints, rad or m, (2, 0) in files of before flights had them.
    `stopped` says why the flight ended before its time; it is empty where it did not.
    """

    robot: str
    scenario: str
    law: str = ""
    control_rate: float = 0.0
    attitude: str
    coordinates: tuple[str, ...]
    coordinate_units: tuple[str, ...]
    input_names: tuple[str, ...]
    points: tuple[str, ...]
    constraint_names: tuple[str, ...]
    frames: tuple[str, ...] = ()
    tangent_arm: int
    stopped: str
    weight: float = np.nan
    gravity: float = np.nan
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
    wall_kinds: tuple[str, ...] = field(default=(), repr=False)
    gusts: Array = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    motor_times: Array = field(default_factory=lambda: np.array([0.0, np.inf]), repr=False)
    wall_forces: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    contact_walls: NDArray[np.int_] = field(
        default_factory=lambda: np.zeros(0, dtype=np.int_), repr=False
    )
    contact_frames: tuple[str, ...] = ()
    contact_forces: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    contact_friction: Array = field(default_factory=lambda: np.zeros((0, 0, 3)), repr=False)
    contact_slip: Array = field(default_factory=lambda: np.zeros((0, 0, 3)), repr=False)
    contact_depth: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    hold_names: tuple[str, ...] = ()
    hold_forces: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    hold_errors: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    held: tuple[str, ...] = ()
    hold_times: Array = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    impacts: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    impulses: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    hard_impacts: tuple[str, ...] = field(default=(), repr=False)
    wheels: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    wheel_points: tuple[str, ...] = field(default=(), repr=False)
    back: Array = field(default_factory=lambda: np.array(RETURN), repr=False)
    disc_radii: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    joint_limits: Array = field(default_factory=lambda: np.zeros((2, 0)), repr=False)
    command_names: tuple[str, ...] = ()
    command_units: tuple[str, ...] = ()
    actuator_names: tuple[str, ...] = ()
    commands: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    actuators: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    battery: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    sensor_names: tuple[str, ...] = ()
    sensor_units: tuple[str, ...] = ()
    sensor_frames: tuple[str, ...] = ()
    sensor_rates: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    sensor_delays: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    sensors: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    estimate_names: tuple[str, ...] = field(default=(), repr=False)
    estimate_units: tuple[str, ...] = field(default=(), repr=False)
    estimates: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    estimate_deviations: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    estimate_errors: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)
    innovation_names: tuple[str, ...] = field(default=(), repr=False)
    innovations: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)

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

        With a quaternion the error of the attitude is the rotation vector to the desired one, rad.
        """
        kinematics = kinematics_of(self.layout)
        return kinematics.errors(self.q, self.v, self.q_desired, self.v_desired, self.back)[0]

    @property
    def roll_pitch_yaw(self) -> Array:
        """Attitude of the base (s, 3) about x, then y, then z of the world, rad."""
        return roll_pitch_yaw(self.base_rotation)

    @property
    def centre(self) -> str:
        """Name of the point that is the base centre."""
        return "O2" if "O2" in self.points else "base"

    @property
    def has_tip(self) -> bool:
        """True if the robot has a tip: one arm, or a frame of that name."""
        return "tip" in self.points

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the flight, in sentences.

        They are on frames that begin so deep in a wall that it pushes with more than the weight, on
        impacts for which steps are too long, on a battery that ran empty, on commands that chatter,
        on joints that a push turns far, and on a base that ends far from its path or overturned.
        """
        deep = np.flatnonzero(np.any(self.contact_forces[:1] > _RESTS * self.weight, axis=0))
        inside = tuple(
            f"{self.contact_frames[k]} begins {self.contact_depth[0, k]:.3g} m inside wall "
            f"{self.contact_walls[k]}, which pushes it with {self.contact_forces[0, k]:.3g} N, "
            f"more than the weight of {self.weight:.3g} N; move the wall, or the start."
            for k in deep
        )
        charge = dict(zip(self.actuator_names, self.actuators.T, strict=True)).get("charge")
        empty = () if charge is None else np.flatnonzero(charge <= 0.0)
        drained = tuple(
            f"The battery is empty at t = {self.time[k]:.4g} s; the flight continues with the "
            "voltage of an empty battery."
            for k in empty[:1]
        )
        return inside + self.hard_impacts + drained + self._chatter + self._turned + self._astray

    @property
    def _chatter(self) -> tuple[str, ...]:
        """That the commands of motors jump from sample to sample, if they do so often."""
        names, sent, count = self.command_names, self.commands, self.rotors
        units = np.array((self.command_units or self.input_units)[:count])
        if not names:
            names, sent = self.input_names, np.clip(self.commanded, *self.input_limits)
        most = np.fmax.reduce(np.abs(sent[:, :count]), axis=0)
        size = np.array([most[units == unit].max() for unit in units])
        jumps = np.abs(np.diff(sent[:, :count], axis=0)) > _JUMP * np.maximum(size, _NOTHING)
        shares = jumps.sum(axis=0) / len(sent)
        share = jumps.any(axis=1).sum() / len(sent)
        if not share > _CHATTERS:
            return ()
        return (
            f"Motor commands chatter: in {share:.0%} of the samples one jumps by more than half "
            f"of the greatest ({names[int(shares.argmax())]} most often); try lower gains "
            "(control.attitude_frequency, control.frequency), wider limits, less noise of "
            "sensors, or motors.compensation = false.",
        )

    @property
    def _turned(self) -> tuple[str, ...]:
        """Joints that left their posture by much while the machine pushed, in words."""
        joints, places = self.layout.q.joints, self.layout.v.joints
        pushes = self.law in LAWS and LAWS[self.law].pushes
        if not pushes or not self.joint_limits.size:
            return ()
        span = np.abs(np.diff(self.joint_limits, axis=0)[0])
        turns = np.array(self.coordinate_units[joints]) == "rad"
        # A joint without limits turns all the way round, or slides as far as it likes.
        span = np.where(turns, np.minimum(span, 2.0 * np.pi), span)
        off = np.fmax.reduce(np.abs(self.errors[:, places]), axis=0)
        return tuple(
            f"{self.coordinates[joints][k]} leaves its posture by {off[k]:.3g} "
            f"{self.coordinate_units[joints][k]} while the machine pushes (more than a quarter "
            f"of its range of {span[k]:.3g}); bend the arm more (arm.posture_deg), move the base "
            "nearer, push with less force, or hold the joint (control.joints)."
            for k in np.flatnonzero(off > _TURNED * span)
        )

    @property
    def _astray(self) -> tuple[str, ...]:
        """That the base ends far from its path, farther than it began, or overturned, in words.

        Motors that are off, and numbers that are not finite, leave nothing to tell.
        """
        follows = self.law == PREDICTIVE or (self.law in LAWS and not LAWS[self.law].moves_frame)
        runs = self.time[-1] == np.clip(self.time[-1], *self.motor_times)
        if not follows or not runs or self.stopped or self.hold_times.size:
            return ()
        begin, end = self.centre_error[[0, -1]]
        ends = np.stack([self.q[-1], self.q_desired[-1]])
        axis, wanted = kinematics_of(self.layout).rotation(ends)[..., 2]
        off = np.degrees(np.arccos(np.clip(axis @ wanted, -1.0, 1.0)))
        far, overturned = max(begin, _ASTRAY) < end < np.inf, off > _OVERTURNED
        limited = at_limits(self.commanded[-1], self.input_limits)
        limited &= np.ptp(self.input_limits, axis=0) > 0.0  # Else there is no choice between them.
        lost = "; control may be lost (a smaller integration.divergence ends such a flight)"
        limits = f", with inputs at their limits{lost * (not overturned)}" * bool(limited.any())
        notes = (
            f"The base ends {end:.3g} m from its desired position{limits}.",
            f"The base ends overturned, its z axis {off:.3g}° off its desired direction{lost}.",
        )
        return tuple(itertools.compress(notes, (far, overturned)))

    @property
    def impact_summaries(self) -> tuple[str, ...]:
        """For each impact its time, the impulses of constraints, and kinetic energies."""
        words = []
        # Old files have no impulses.
        for (time, lost, left), impulses in zip(self.impacts, self.impulses, strict=False):
            sizes = {x: np.linalg.norm(impulses[self._rows_of(x)]) for x in self.held}
            # What takes hold at rest strikes nothing.
            if felt := ", ".join(f"{name} {x:.3g} N s" for name, x in sizes.items() if x):
                energies = f"kinetic energy from {lost + left:.3g} J to {left:.3g} J"
                words.append(f"impact at t = {time:.4g} s: {felt}; {energies}")
        return tuple(words)

    def _rows_of(self, name: str) -> list[bool]:
        """For each of the rows of constraints whether it holds a place for that one."""
        return [row in {f"{name}_{x}" for x in _LINEAR_ROWS} for row in self.hold_names]

    @property
    def hold_summaries(self) -> tuple[str, ...]:
        """For each hold its times, the greatest force and the drift.

        The drift is the largest change of an error, m, while there is a force.
        """
        return tuple(itertools.starmap(self._hold_summary, enumerate(self.held)))

    def _hold_summary(self, k: int, name: str) -> str:
        begin, end = self.hold_times[k]
        during = np.flatnonzero((self.time >= begin) & (self.time < end))
        if not len(during):
            return f"hold {k + 1}, {name}: never took hold"
        rows = self._rows_of(name)
        forces = np.linalg.norm(self.hold_forces[during][:, rows], axis=1)
        most = int(np.argmax(forces))
        errors = self.hold_errors[during][forces > 0.0][:, rows]
        until = f"to {end:.4g} s" if end <= self.time[-1] else "on"
        return (
            f"hold {k + 1}, {name}: from t = {begin:.4g} s {until}; "
            f"at most {forces[most]:.3g} N, at t = {self.time[during[most]]:.4g} s; "
            f"drifts by {np.abs(errors - errors[:1]).max(initial=0.0):.2g} m"
        )

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
        return np.linalg.norm(self.point(self.centre) - self.centre_desired, axis=1)

    @property
    def tip_error(self) -> Array:
        """Distance (s) of the tip from where it should be, m."""
        return np.linalg.norm(self.point("tip") - self.tip_desired, axis=1)

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names (c) of the contacts, such as wall_1_tip."""
        pairs = zip(self.contact_walls.tolist(), self.contact_frames, strict=True)
        return tuple(f"wall_{wall}_{frame}" for wall, frame in pairs)

    @cached_property
    def rotor_distances(self) -> Array:
        """Distances (s, N), m, of the rotors' discs from links that do not carry them.

        Links are the lines between joints, and to the tip; where one goes through a disc the
        distance is less than 0, by how far inside the rim. NaN where a radius is not known.
        """
        from gibbs_codegen.flight.record.clearance import disc_distances  # Late: it reads walls.

        return disc_distances(self.positions, self.parents, *self._discs)

    @property
    def _discs(self) -> tuple[list[int], Array, Array]:
        """Numbers (N) of the points at which discs of rotors are, their axes (s, N, 3), radii."""
        discs = [self.points.index(name) for name in self.rotor_points]
        radii = self.disc_radii if len(self.disc_radii) else np.zeros(len(discs))
        return discs, self.thrust_directions @ np.swapaxes(self.base_rotation, -1, -2), radii

    @cached_property
    def wall_distances(self) -> Array:
        """Distances (s, w), m, of walls from the nearest link or rim of a rotor's disc.

        They are less than 0 where one is behind the wall. Ends of links that are there to touch a
        wall do not count there, nor discs whose radius is not known.
        """
        from gibbs_codegen.flight.record.clearance import rim_distances, wall_distances

        distances = np.empty((len(self.time), len(self.walls)))
        discs, axes, radii = self._discs
        kinds = self.wall_kinds or ("plane",) * len(self.walls)
        for k, (kind, figures) in enumerate(zip(kinds, self.walls, strict=True)):
            pairs = zip(self.contact_walls.tolist(), self.contact_frames, strict=True)
            frames = [frame for wall, frame in pairs if wall == k + 1]
            places = [self.points.index(name) for name in frames if name in self.points]
            links = wall_distances(self.positions, self.parents, kind, figures, places)
            rims = rim_distances(self.positions[:, discs], axes, radii, kind, figures)
            distances[:, k] = np.fmin(links, rims)
        return distances

    @property
    def energy_error(self) -> Array:
        """Change of energy since the start less the work done (s), J: 0 if energy balances."""
        energy = self.kinetic_energy + self.potential_energy
        return energy - energy[0] - self.work

    def columns(self) -> Iterator[Column]:
        """Name, unit and values (s) of every scalar series, time first."""
        yield "time", "s", self.time
        places, velocities = self.layout.q, self.layout.v
        # Components of velocities have names of their own, rates those of their coordinates.
        rates = [f"rate_{name}" if name in places.names else name for name in velocities.names]
        growth = [f"acceleration_{name}" for name in velocities.names]
        per_square = [f"{unit}^2" for unit in velocities.units]
        for names, units, suffix, series in (
            (places.names, places.units, "", self.q),
            (places.names, places.units, "_desired", self.q_desired),
            (rates, velocities.units, "", self.v),
            (rates, velocities.units, "_desired", self.v_desired),
            (growth, per_square, "", self.a),
            (growth, per_square, "_desired", self.a_desired),
        ):
            for name, unit, values in zip(names, units, series.T, strict=True):
                yield f"{name}{suffix}", unit, values
        for name, values in zip(("roll", "pitch", "yaw"), self.roll_pitch_yaw.T, strict=True):
            if name not in places.names:
                yield name, "rad", values
        names, units = self.input_names, self.input_units
        for suffix, field_name in _INPUTS.items():
            for name, unit, values in zip(names, units, getattr(self, field_name).T, strict=True):
                yield f"{name}{suffix}", unit, values
        sent = zip(self.command_names, self.command_units, self.commands.T, strict=True)
        of_commands = dict(zip(self.command_names, self.command_units, strict=True))
        for name, unit, values in sent:
            yield f"{name}_sent", unit, values
        for name, values in zip(self.actuator_names, self.actuators.T, strict=True):
            yield f"{name}_state", of_commands.get(followed(name, of_commands), "1"), values
        for name, unit, values in zip(("voltage", "current"), "VA", self.battery.T, strict=False):
            yield f"battery_{name}", unit, values
        for name, values in zip(self.constraint_names, self.constraint_torques.T, strict=True):
            yield name, "N m", values
        for k, values in enumerate(self.base_arm_angles.T, start=2):
            yield f"theta_{k}", "rad", values
        for j, point in enumerate(self.points):
            for i, axis in enumerate("xyz"):
                yield f"{point}_{axis}", "m", self.positions[:, j, i]
        # Wrenches on those frames on which one acts at some time.
        for frame, series in zip(self.frames, np.moveaxis(self.frame_wrenches, 1, 0), strict=True):
            for k, axis in enumerate("xyz" if np.any(series) else ""):
                yield f"{frame}_force_{axis}", "N", series[:, k]
                yield f"{frame}_torque_{axis}", "N m", series[:, k + 3]
        yield from zip(self.sensor_names, self.sensor_units, self.sensors.T, strict=True)
        labels = [*places.names, *rates, *self.estimate_names]
        moved, of_moved = zip(*self.layout.displacements, strict=True)
        off = [*(f"displacement_{name}" for name in moved), *labels[places.size :]]
        of_rest = [*velocities.units, *self.estimate_units]
        of_off = [*of_moved, *of_rest]
        for names, units, suffix, series in (
            (labels, (*places.units, *of_rest), "estimated", self.estimates),
            (off, of_off, "error", self.estimate_errors),
            (off, of_off, "deviation", self.estimate_deviations),
            (
                self.innovation_names,
                ("1",) * self.innovations.shape[1],
                "innovation",
                self.innovations,
            ),
        ):
            # Flights without estimates have none, and errors are not known of what nobody measures.
            for name, unit, values in zip(names, units, series.T, strict=False):
                yield f"{name}_{suffix}", unit, values
        for k, values in enumerate(self.wall_forces.T, start=1):
            yield f"wall_{k}_force", "N", values
        for k, name in enumerate(self.contact_names):
            yield f"{name}_normal", "N", self.contact_forces[:, k]
            for i, axis in enumerate("xyz"):
                yield f"{name}_friction_{axis}", "N", self.contact_friction[:, k, i]
                yield f"{name}_slip_{axis}", "m/s", self.contact_slip[:, k, i]
            yield f"{name}_depth", "m", self.contact_depth[:, k]
        for name, values in zip(self.hold_names, self.hold_forces.T, strict=True):
            yield f"{name}_held", "N m" if "_turn" in name else "N", values
        for k, values in enumerate(self.wall_distances.T, start=1):
            yield f"wall_{k}_distance", "m", values
        for name, values in zip(self.input_names, self.rotor_distances.T, strict=False):
            if not np.isnan(values).all():
                yield f"{name}_distance", "m", values
        for point, series in ((self.centre, self.centre_desired), ("tip", self.tip_desired)):
            for axis, values in zip("xyz", series.T, strict=False):
                yield f"{point}_{axis}_desired", "m", values
        yield "centre_error", "m", self.centre_error
        if self.has_tip:
            yield "tip_error", "m", self.tip_error
        yield "heading_error", "rad", self.heading_error
        yield "kinetic_energy", "J", self.kinetic_energy
        yield "potential_energy", "J", self.potential_energy
        yield "work", "J", self.work
        yield "energy_error", "J", self.energy_error

    def write_csv(self, path: StrPath) -> None:
        """Write every series as comma-separated values, `name [unit]` in the header.

        Args:
            path: The file. Its numbers are the shortest that read back exactly.

        Raises:
            OutputError: If it cannot be written.
        """
        with writing(path):
            write_table(path, {f"{name} [{unit}]": values for name, unit, values in self.columns()})

    def write_npz(self, path: StrPath) -> None:
        """Write all fields to one `.npz` file, which `read_flight` reads.

        What follows from them, such as `energy_error`, is not in it, but in the flight that is read
        and in `write_csv`.

        Args:
            path: The file.

        Raises:
            OutputError: If it cannot be written.
        """
        values = {series.name: getattr(self, series.name) for series in fields(self)}
        # Without names there is nothing to tell that they are text.
        texts = {k: np.array(v, dtype=str) for k, v in values.items() if isinstance(v, tuple)}
        with writing(path):
            np.savez_compressed(path, **(values | texts))


def point_parents(vehicle: Vehicle) -> NDArray[np.intp]:
    """Numbers (k) of the points that points are joined to, for drawings, −1 for none.

    For rotors and joints that is the joint that carries them or the base centre; for frames, the
    same where they are on the last link of an arm, or the base centre for a tip without an arm.
    """
    centre, parents = vehicle.points.index(vehicle.centre), vehicle.carriers.copy()
    joint = centre + 1 + vehicle.rotors
    frame = len(parents) + 1 - len(vehicle.frames)  # Joints that gears move are before it too.
    parents[: centre + 1] = -1
    on_the_way = np.isin(parents, parents[joint:frame])
    on_the_way[parents == centre] = True
    on_the_way[:frame] = False
    if vehicle.has_tip:
        tip = vehicle.points.index("tip")
        on_the_way[tip] &= parents[tip] != centre
    parents[on_the_way] = -1
    return parents


def wheel_marks(robot: Flight | Vehicle, q: Array) -> Array:
    """The axle and a mark (w, 2, 3) of each wheel that turns, at coordinates (nq), world axes.

    They are a unit vector, and from the centre to a place on the rim, m.
    """
    wheels, layout = robot.wheels, robot.layout
    rotation, angles = kinematics_of(layout).rotation(q), q[layout.q.angles]
    ahead = wheels / np.sum(wheels**2, axis=1, keepdims=True)
    up = np.linalg.norm(ahead, axis=1, keepdims=True) * [0.0, 0.0, 1.0]
    turned = angles[:, np.newaxis]
    axles = np.cross(up, wheels)  # The radius times its inverse.
    return np.stack([axles, np.sin(turned) * ahead + np.cos(turned) * up], axis=1) @ rotation.T


def write_table(path: StrPath, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns (s) as comma-separated values, with their names in the first line."""
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        # Python's numbers take several times the room of NumPy's: some rows at a time.
        for begin in range(0, max(map(len, columns.values()), default=0), _ROWS):
            rows = (values[begin : begin + _ROWS].tolist() for values in columns.values())
            writer.writerows(zip(*rows, strict=True))
