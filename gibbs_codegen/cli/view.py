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
    if options.html is not None and Path(options.html).suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--html: {printable(options.html)}: give a name that ends in .html")
    from gibbs_codegen.flight.record.flight import flight_file
    from gibbs_codegen.flight.viewer.page import beside
    from gibbs_codegen.flight.viewer.view import view, view_html

    if options.html is not None:
        # Before long work: told if nothing can be written there.
        with beside(Path(options.html)):
            pass
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
        if options.html is None:
            print("Press Ctrl-C to stop.", flush=True)
            view(what, options.port, browser=not options.no_browser)
            return 0
        page = view_html(what)
    page.save(options.html)
    print(f"{printable(options.html)}: {page.title}, {page.size / 1e6:.2f} MB")
    return 0
