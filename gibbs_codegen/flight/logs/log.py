"""Flights as logs: a flight written as a log of other programs, and a flight of such a log."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np

from gibbs_codegen.errors import UsageError, cause_of, near, printable, written
from gibbs_codegen.files.staging import new_place
from gibbs_codegen.flight.arguments import numbers
from gibbs_codegen.flight.logs.crazyflie import is_crazyflie, read_crazyflie
from gibbs_codegen.flight.logs.px4 import is_px4, read_px4, write_tables
from gibbs_codegen.flight.logs.reading import Recorded, Samples, flight_of_log
from gibbs_codegen.flight.logs.ros import read_bag, write_bag
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import StrPath
from gibbs_codegen.flight.scenario.file import AnyScenario, read_scenario
from gibbs_codegen.runtime.load import load

# Keys of `names` besides coordinates and inputs.
_OF_BAGS = "odometry", "joints", "inputs", "imu", "actuators"
_OF_PX4 = "position", "attitude", "spin", "imu"
FORMATS: dict[str, Callable[[Flight, Path], None]] = {"mcap": write_bag, "csv": write_tables}


def write_log(flight: Flight, folder: StrPath, format: str = "mcap") -> None:
    """Write a flight as a log that other programs read.

    docs/howto/logs.md describes its contents.

    Args:
        flight: The flight.
        folder: Folder to write, which must not exist yet.
        format: "mcap" for a bag of ROS 2 in an MCAP file, "csv" for tables of the topics of PX4.

    Raises:
        UsageError: The folder exists, the format is unknown, or rosbags is not installed, which
            the extra `logs` brings.
        OutputError: It cannot be written; nothing is left.
    """
    if format not in FORMATS:
        raise UsageError(f"format {format!r}: unknown; known: {', '.join(FORMATS)}")
    with new_place(folder) as new:
        FORMATS[format](flight, new)


def read_log(
    robot: ModuleType | str | os.PathLike[str],
    log: StrPath,
    names: Mapping[str, str | float] | None = None,
    rate: float | None = None,
    cutoff: float | None = None,
    estimate: AnyScenario | None = None,
) -> Flight:
    """The flight in a log: for figures, the viewer, and arrays q, v, a on one time base.

    Velocities that the log lacks, and accelerations, are derivatives of splines. What a log does
    not tell is NaN: the desired motion, inputs that it has no series of, the work.

    Args:
        robot: The robot that flew: a generated module, or the name or path of one.
        log: A bag of ROS 1 or 2, an MCAP file, a ULog of PX4, a folder with tables of one, or a
            file of a Crazyflie's memory card.
        names: What the log calls things. Of a bag, topics "odometry" (default /odom), "joints"
            (/joint_states), "inputs" (/inputs), "imu" (/imu) and "actuators" (/actuators), and
            coordinates and inputs. Of a ULog, topics "position" (vehicle_local_position),
            "attitude" (vehicle_attitude), "spin" (vehicle_angular_velocity) and "imu"
            (sensor_combined), and coordinates, inputs and commands as topic.field. A number says
            where a joint stands.
        rate: Samples per second; by default they are at the times of the log.
        cutoff: Frequency, Hz, of a Butterworth filter of order four, applied forwards and
            backwards, so without delay; default: no filter.
        estimate: A scenario, or its name, path or tables, whose sensors and `control.filter` define
            a filter that estimates the state from readings of the log; default: no filter.

    Returns:
        The flight, from the first instant at which all is known. Samples that cannot be are left
        out, and of a clock that goes back one run is taken; a warning of the logger
        `gibbs_codegen` says so.

    Raises:
        UsageError: The log cannot be read or lacks data for the flight or the filter, or a package
            of the extra `logs` is missing.
    """
    module = robot if isinstance(robot, ModuleType) else load(robot, "c")
    for name, frequency in (("rate", rate), ("cutoff", cutoff)):
        if frequency is not None and numbers(name, frequency, "a number of Hz", ()) <= 0.0:
            raise UsageError(f"{name}: must be positive, not {frequency:g}")
    vehicle = Vehicle(module)
    recorded = recorded_of(vehicle, log, names or {})
    scenario = None if estimate is None else read_scenario(estimate)
    return flight_of_log(vehicle, recorded, printable(Path(log).name), rate, cutoff, scenario)


def recorded_of(vehicle: Vehicle, log: StrPath, names: Mapping[str, str | float]) -> Recorded:
    """Contents of a log for a robot, by `names` as of `read_log`, whose errors it raises."""
    path = Path(log)
    roles = _OF_PX4 if is_px4(path) else _OF_BAGS
    roles_known = {*roles, *vehicle.joint_names, *vehicle.inputs, *vehicle.commands}
    if unknown := sorted(names.keys() - roles_known):
        hint = near(unknown[0], roles_known)
        words = f"is none of {', '.join(sorted(roles_known))}{hint}"
        raise UsageError(f"names: {printable(unknown[0])}: {words}")
    for name, alias in names.items():
        if not isinstance(alias, str):
            called = "its name in the log"
            if name not in vehicle.joint_names:
                raise UsageError(f"names: {name}: must be {called}, not {written(alias)}")
            numbers(f"names: {name}", alias, f"{called}, or a number, where it stands", ())
    require_log(path)
    try:
        with np.errstate(all="ignore"):  # Impossible numbers are left out later.
            read = read_crazyflie if is_crazyflie(path) else read_px4 if is_px4(path) else read_bag
            recorded = read(path, vehicle, names)
    except UsageError:
        raise
    except Exception as error:  # Files can be broken in many ways.
        why = "it is damaged, or another kind of file"
        if isinstance(error, OSError) and error.filename:
            why = cause_of(error)
        raise UsageError(f"{printable(path)}: cannot be read as a log: {why}") from None
    driven = recorded.inputs.keys() | recorded.commands.keys()
    if absent := [
        n for n in (*vehicle.inputs, *vehicle.commands) if n in names and n not in driven
    ]:
        name = absent[0]
        raise UsageError(f"{printable(path)}: has no {printable(names[name])}, named for {name}")
    clocks = (s.time for s in (recorded.position, *recorded.commands.values()) if s is not None)
    clock = next(clocks, np.zeros(0, np.int64))
    still = {
        name: Samples(clock, np.full(len(clock), place))
        for name in vehicle.joint_names
        if isinstance(place := names.get(name), int | float)
    }
    recorded = recorded._replace(joints={**recorded.joints, **still})
    for name in vehicle.joint_names:
        if name not in recorded.joints:
            there = ", ".join(recorded.offered) or "none"
            raise UsageError(
                f"{printable(path)}: has no positions of the joint {name}; give its name in the "
                f"log, or a number, where it stands. The log has: {there}"
            )
    return recorded


def require_log(log: StrPath) -> None:
    """Raise `UsageError` for a path at which nothing is, or a flight."""
    path = Path(log)
    if not path.exists():
        raise UsageError(f"{printable(path)}: does not exist; give a log")
    if path.suffix == ".npz" or (path / "flight.npz").exists():
        raise UsageError(f"{printable(path)}: is a flight already; read it with read_flight")
