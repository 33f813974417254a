"""A flight: the time series that a simulation leaves, and how they are written and read."""

from __future__ import annotations

import csv
import dataclasses
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import OutputError, UsageError, printable
from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.simulator.plant.kinematics import kinematics_of

Array = NDArray[np.float64]
StrPath = str | os.PathLike[str]

# Rows of the CSV that are written at a time.
_ROWS = 4096


@dataclass(frozen=True)
class Flight:
    """Time series of one flight, a row per sample; SI units, radians, world axes with Z up.

    With s samples, nq coordinates, nv velocities, nu inputs, N rotors, k points and c constrained
    joints:

    - `time` (s); `q`, `q_desired` (s, nq); `v`, `a`, `v_desired`, `a_desired` (s, nv)
    - `commanded` and `applied` (s, nu): inputs that the controller asks for, and those that act
      after thrust limits and motor lag
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
    - `kinetic_energy`, `potential_energy`, `work` (s): energies, and the work that inputs and
      external force have done since the start

    `law` is the control law that was flown, "" in files of before flights said so.
    `stopped` says why the flight ended before its time; it is empty where it did not.
    """

    robot: str
    scenario: str
    law: str
    attitude: str
    coordinates: tuple[str, ...]
    coordinate_units: tuple[str, ...]
    input_names: tuple[str, ...]
    points: tuple[str, ...]
    constraint_names: tuple[str, ...]
    tangent_arm: int
    stopped: str
    time: Array = field(repr=False)
    q: Array = field(repr=False)
    v: Array = field(repr=False)
    a: Array = field(repr=False)
    q_desired: Array = field(repr=False)
    v_desired: Array = field(repr=False)
    a_desired: Array = field(repr=False)
    commanded: Array = field(repr=False)
    applied: Array = field(repr=False)
    constraint_torques: Array = field(repr=False)
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

    def columns(self) -> Iterator[tuple[str, str, Array]]:
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
        for suffix, series in (("", self.applied), ("_commanded", self.commanded)):
            for name, unit, values in zip(
                self.input_names, self.input_units, series.T, strict=True
            ):
                yield f"{name}{suffix}", unit, values
        for name, values in zip(self.constraint_names, self.constraint_torques.T, strict=True):
            yield name, "N m", values
        for k, values in enumerate(self.base_arm_angles.T, start=2):
            yield f"theta_{k}", "rad", values
        for j, point in enumerate(self.points):
            for i, axis in enumerate("xyz"):
                yield f"{point}_{axis}", "m", self.positions[:, j, i]
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
        columns = list(self.columns())
        try:
            with Path(path).open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(f"{name} [{unit}]" for name, unit, _ in columns)
                # Python's numbers take several times the room of NumPy's: some rows at a time.
                for begin in range(0, len(self.time), _ROWS):
                    rows = np.stack([v[begin : begin + _ROWS] for _, _, v in columns], axis=-1)
                    writer.writerows(rows.tolist())
        except OSError as error:
            raise OutputError(f"{printable(path)}: cannot be written: {error.strerror}") from None

    def write_npz(self, path: StrPath) -> None:
        """Write all fields to one `.npz` file, which `read_flight` reads.

        Args:
            path: The file.

        Raises:
            OutputError: If it cannot be written.
        """
        fields = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        try:
            np.savez_compressed(path, **fields)
        except OSError as error:
            raise OutputError(f"{printable(path)}: cannot be written: {error.strerror}") from None


def read_flight(path: StrPath) -> Flight:
    """The flight of an `.npz` file that `write_npz` wrote.

    Args:
        path: The file.

    Returns:
        The flight.

    Raises:
        UsageError: If the file is not such a one.
    """
    try:
        # Opened here: what `np.load` opens it leaves open where it is not an archive.
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as stored:
            values: dict[str, Any] = {} if "parents" in stored else _before_trees(stored)
            values |= {} if "law" in stored else {"law": np.array("")}
            names = [each.name for each in dataclasses.fields(Flight) if each.name not in values]
            values |= {name: stored[name] for name in names}
    except (OSError, TypeError, ValueError, KeyError, BadZipFile) as error:
        raise UsageError(
            f"{printable(path)}: is not a flight that was saved: {printable(error)}"
        ) from None
    for name, value in values.items():
        if value.dtype.kind == "U":
            values[name] = str(value) if value.ndim == 0 else tuple(map(str, value))
    values["tangent_arm"] = int(values["tangent_arm"])
    return Flight(**values)


def _before_trees(stored: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """What files lack that are from when all robots had base arms, angles and one serial arm.

    Args:
        stored: The arrays of a file.

    Returns:
        Attitude, units, parents and names. The sequence of the angles is not in such files; it
        makes no difference to what a flight has.
    """
    points, coordinates = stored["points"].tolist(), stored["coordinates"].tolist()
    rotors = len(stored["base_arm_angles_desired"]) + 1
    centre = points.index("O2") if "O2" in points else 0
    parents = np.full(len(points), -1)
    parents[centre + 1 : centre + rotors + 2] = centre
    parents[centre + rotors + 2 :] = np.arange(centre + rotors + 1, len(points) - 1)
    units = ["rad" if name.startswith("theta_") else "m" for name in coordinates]
    return {
        "attitude": np.array("xyz"),
        "coordinate_units": np.array(units),
        "parents": parents,
        "constraint_names": np.array([f"tau_prime_{k}" for k in range(2, rotors + 1)], dtype=str),
    }


def is_flight(path: StrPath) -> bool:
    """Whether a file is one that `write_npz` wrote, by the names of what it holds.

    Args:
        path: The file.

    Returns:
        Whether it is; False if it cannot be read.
    """
    try:
        with ZipFile(path) as archive:
            return {"robot.npy", "scenario.npy", "time.npy"} <= set(archive.namelist())
    except (OSError, BadZipFile):
        return False
