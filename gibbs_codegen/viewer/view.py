"""What users call: a flight in the browser."""

from __future__ import annotations

import os
from pathlib import Path

from gibbs_codegen.simulator.record.flight import Flight, read_flight
from gibbs_codegen.viewer.flight_page import flight_page
from gibbs_codegen.viewer.page import ViewPage


def view_html(what: Flight | str | os.PathLike[str]) -> ViewPage:
    """Make a page that plays a flight in any browser, without a server or a request.

    In a notebook the page shows itself; `save` writes it to a file.

    Args:
        what: The flight; or a folder that `gibbs-codegen simulate` wrote, or its flight.npz.

    Returns:
        The page, of less than 2 MB.

    Raises:
        UsageError: viser is not installed, or there is no flight.
    """
    return flight_page(what if isinstance(what, Flight) else _read(Path(what)))


def _read(path: Path) -> Flight:
    return read_flight(path / "flight.npz" if path.is_dir() else path)
