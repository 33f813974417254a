"""A robot or a flight in the browser, live or as a page."""

from __future__ import annotations

import os
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType

from gibbs_codegen.flight.record.flight import Flight, flight_file, read_flight
from gibbs_codegen.flight.viewer.flight_view import FlightPanel, flight_page
from gibbs_codegen.flight.viewer.machine import DrawnMachine
from gibbs_codegen.flight.viewer.page import PORT, ViewPage, address, empty_server
from gibbs_codegen.flight.viewer.robot_view import RobotPanel, robot_page
from gibbs_codegen.runtime.load import load

Viewed = Flight | ModuleType | str | os.PathLike[str]

# How often a scene follows its controls, s.
_STEP = 1.0 / 30.0


def view_html(what: Viewed) -> ViewPage:
    """Make a page that shows a flight or a robot in any browser, without a server or a request.

    A flight is played; a robot moves one coordinate after the other, held still by its inputs. In a
    notebook the page shows itself; `save` writes it to a file.

    Args:
        what: A flight; a folder that `gibbs-codegen simulate` wrote, or its flight.npz; or a
            generated module, or the name or path of one.

    Returns:
        The page, of less than 2 MB.

    Raises:
        UsageError: viser is not installed, or there is neither a flight nor a module.
    """
    viewed = _viewed(what)
    return flight_page(viewed) if isinstance(viewed, Flight) else robot_page(DrawnMachine(viewed))


def view(what: Viewed, port: int = PORT, browser: bool = True) -> None:
    """Show a flight or a robot live in the browser, until Ctrl-C.

    The server listens on 127.0.0.1 only: other machines cannot reach it, but every program of this
    one can, and so can a page of another site that is open in a browser here. viser prints the
    address.

    Args:
        what: As of `view_html`.
        port: Port of the server; the next free one if another program has it.
        browser: Whether to open the browser.

    Raises:
        UsageError: As of `view_html`; or there is no such port, or none is free from it on.
    """
    with suppress(KeyboardInterrupt), viewing(what, port) as (panel, place):
        if browser:
            webbrowser.open(place)
        while True:
            panel.step()
            time.sleep(_STEP)


@contextmanager
def viewing(what: Viewed, port: int = PORT) -> Iterator[tuple[FlightPanel | RobotPanel, str]]:
    """Serve a flight or a robot; yields its controls and the address.

    The caller lets the scene follow the controls by their `step`.
    """
    viewed = _viewed(what)
    with empty_server(port, announces=True) as server:
        if isinstance(viewed, Flight):
            yield FlightPanel(server, viewed), address(server)
        else:
            yield RobotPanel(server, DrawnMachine(viewed)), address(server)


def _viewed(what: Viewed) -> Flight | ModuleType:
    """The flight or the module that is meant."""
    if not isinstance(what, str | os.PathLike):
        return what
    file = flight_file(what)
    return load(what) if file is None else read_flight(file)
