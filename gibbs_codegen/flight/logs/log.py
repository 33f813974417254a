"""What users call: a flight written as a log of other programs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.staging import put_in_place, staging_folder, writing
from gibbs_codegen.flight.logs.px4 import write_tables
from gibbs_codegen.flight.logs.ros import write_bag
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import StrPath
from gibbs_codegen.runtime.load import require

FORMATS: dict[str, Callable[[Flight, Path], None]] = {"mcap": write_bag, "csv": write_tables}


def write_log(flight: Flight, folder: StrPath, format: str = "mcap") -> None:
    """Write a flight as a log that other programs read.

    See docs/howto/logs.md for what is in it.

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
    if format == "mcap":
        require("rosbags", "logs of ROS", "logs")
    place = Path(folder)
    if place.exists():
        raise UsageError(f"{printable(place)}: is there already; give a folder that is not")
    with writing(place), staging_folder(place.parent) as staging:
        FORMATS[format](flight, staging / place.name)
        put_in_place(staging / place.name, place)
