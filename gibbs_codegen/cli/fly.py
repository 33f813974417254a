"""`fly`: write a page on which a robot flies by its own emitted C and law."""

from __future__ import annotations

import argparse
from pathlib import Path

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.viewer.page import beside


def run(options: argparse.Namespace) -> int:
    """Write the page; what takes long is announced in the log."""
    place = Path(options.html or f"{Path(options.robot).stem}.html")
    if place.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--html: {printable(place)}: give a name that ends in .html")
    # Before long work: told if nothing can be written there.
    with beside(place):
        pass
    from gibbs_codegen.flight.viewer.fly import fly_html

    page = fly_html(options.robot)
    page.save(place)
    print(f"{printable(place)}: {page.title} flies there, {page.size / 1e3:.0f} kB")
    return 0
