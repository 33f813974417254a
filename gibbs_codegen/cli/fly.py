"""`fly`: write a page on which a robot flies by its own emitted C and law."""

from __future__ import annotations

import argparse
from pathlib import Path

from gibbs_codegen.errors import printable
from gibbs_codegen.flight.viewer.page import new_page


def run(options: argparse.Namespace) -> int:
    """Write the page; what takes long is announced in the log."""
    place = new_page(options.html or f"{Path(options.robot).stem}.html")
    from gibbs_codegen.flight.viewer.fly import fly_html

    page = fly_html(options.robot)
    page.save(place)
    print(f"{printable(place)}: {page.title} flies there, {page.size / 1e3:.0f} kB")
    return 0
