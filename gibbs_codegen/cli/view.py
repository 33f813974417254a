"""`view`: show a robot or a flight in the browser, live or as one file."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from gibbs_codegen.cli import robot_argument, terminal
from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.runtime.load import load


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Show the robot or the flight, or write the page."""
    # Before a module is generated.
    require("viser", "the viewer", "viewer")
    from gibbs_codegen.flight.record.flight import flight_file
    from gibbs_codegen.flight.viewer.page import new_page
    from gibbs_codegen.flight.viewer.view import view, view_html

    place = None if options.html is None else new_page(options.html)
    with ExitStack() as until_shown:
        what: Any = flight_file(options.what)
        if not what:
            module = robot_argument.found_module(options.what, terminal.progress())
            try:
                folder, _ = until_shown.enter_context(module)
            except UsageError as error:
                if Path(options.what).is_file():
                    raise
                hint = "to show a flight, give a folder with a flight.npz"
                raise UsageError(f"{error}; {hint}") from None
            what = load(folder)
        if place is None:
            print("Press Ctrl-C to stop.", flush=True)
            view(what, options.port, browser=not options.no_browser)
            return 0
        page = view_html(what)
    page.save(place)
    print(f"{printable(place)}: {page.title}, {page.size / 1e6:.2f} MB")
    return 0
