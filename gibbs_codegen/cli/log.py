"""`log`: a flight as a log of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from gibbs_codegen.cli import terminal
from gibbs_codegen.errors import printable
from gibbs_codegen.flight.logs.log import write_log
from gibbs_codegen.flight.record.flight import read_flight


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Write the log, and print where it is."""
    flight = read_flight(options.flight)
    write_log(flight, options.out, options.format)
    size = sum(path.stat().st_size for path in Path(options.out).iterdir())
    samples = f"{len(flight.time)} samples of {flight.time[-1]:.4g} s"
    print(f"{printable(options.out)}: {samples}, {size / 1e6:.2f} MB")
    return 0
