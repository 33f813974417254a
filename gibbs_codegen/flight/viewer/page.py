"""A scene served to the browser, or as one page that needs nothing else."""

from __future__ import annotations

import html
import os
import socket
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rich

from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.files.staging import check_new, staging_folder, writing

# How large a page may be, bytes: less than the 2 MB that are promised.
_ROOM = 1_900_000
# The height of a page in a notebook or on a site, px.
_HEIGHT = 520
# viser tells at length, and until it is clicked away, that a browser draws without a graphics card.
_QUIET = '<style>.mantine-Notification-root[style*="orange"] { display: none; }</style>'
_STYLE = """<style>
#key { position: fixed; left: 12px; top: 10px; z-index: 2; pointer-events: none;
  font: 14px/1.5 system-ui, sans-serif; color: #222; background: rgba(255, 255, 255, 0.75);
  padding: 4px 10px; border-radius: 4px; max-width: 60%; }
@media (max-width: 500px) { #key { font-size: 12px; } }
</style>
"""
# The first port that is tried, and the address that no other machine reaches.
PORT, _HOST = 8080, "127.0.0.1"
_LAST = 65535


@dataclass(frozen=True)
class ViewPage:
    """A page of HTML that a browser shows without asking any machine for anything.

    In a notebook it shows itself. `title` is what it shows, in words, and `text` the page.
    """

    title: str
    text: str = field(repr=False)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page to a file, whole or not at all; it replaces an older one.

        Raises `OutputError` if it cannot be written.
        """
        place = Path(path)
        with beside(place) as new:
            (new / place.name).write_text(self.text, encoding="utf-8")
            os.replace(new / place.name, place)

    @property
    def size(self) -> int:
        """Bytes that the page takes."""
        return len(self.text.encode())

    def _repr_html_(self) -> str:
        return (
            f'<iframe title="{html.escape(self.title)}" srcdoc="{html.escape(self.text)}" '
            f'width="100%" height="{_HEIGHT}" loading="lazy" '
            'style="border: 1px solid #ddd; box-sizing: border-box"></iframe>'
        )


def new_page(word: str) -> Path:
    """The place of a page that --html names. Raises, before long work, where none can be written.

    Raises `UsageError` for another suffix or a file that exists, and `OutputError` as `beside`.
    """
    place = Path(word)
    if place.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--html: {printable(place)}: give a name that ends in .html")
    check_new(place)
    with beside(place):
        return place


@contextmanager
def beside(place: Path) -> Iterator[Path]:
    """A folder in which a page can be written before it is put in its place.

    Raises `OutputError` if nothing can be written there.
    """
    with writing(place), staging_folder(place.parent) as new:
        yield new


def that_fits(recorded: Callable[[int], ViewPage], frames: int) -> ViewPage:
    """The page of as many frames, at most `frames` and at least 2, as there is room for.

    `recorded` makes the page of so many.
    """
    while True:
        frames = max(frames, 2)
        page = recorded(frames)
        if page.size <= _ROOM or frames == 2:
            return page
        frames = 3 * frames // 4


def view_page(client: str, title: str, key: Sequence[tuple[str, str]]) -> ViewPage:
    """Put title and key, colours as of CSS and what they stand for, on a page as viser makes it."""
    box = f'<div id="key"><b>{html.escape(title)}</b>{key_list(key)}</div>\n'
    head, _, rest = client.partition("</head>")
    head = head.replace("<title>Viser</title>", f"<title>{html.escape(title)}</title>")
    body, end, tail = rest.rpartition("</body>")
    return ViewPage(title, f"{head}{_QUIET}{_STYLE}</head>{body}{box}{end}{tail}")


def key_list(key: Sequence[tuple[str, str]]) -> str:
    """A list in HTML that explains colours, as CSS has them."""
    swatch = "display: inline-block; width: 18px; height: 10px; margin-right: 8px; "
    entries = (
        f'<li><i style="{swatch}background: {colour}"></i>{html.escape(words)}</li>'
        for colour, words in key
    )
    return f'<ul style="list-style: none; margin: 0; padding: 0">{"".join(entries)}</ul>'


def number_table(rows: Iterable[tuple[str, str, str]]) -> str:
    """A table in HTML of names, numbers and units."""
    cells = "".join(
        f'<tr><td>{html.escape(name)}</td><td style="text-align: right; padding: 0 6px">{number}'
        f"</td><td>{unit}</td></tr>"
        for name, number, unit in rows
    )
    return f"<table>{cells}</table>"


def follow_choices(choices: Sequence[tuple[Any, Sequence[Any]]]) -> None:
    """Show the nodes of every check box that is ticked, and hide those of the others."""
    for choice, nodes in choices:
        for node in nodes:
            if node.visible != choice.value:
                node.visible = choice.value


def panel_text(text: str) -> str:
    """Text in HTML with a margin, as viser's panels have their own."""
    return f'{_QUIET}<div style="margin: 4px 10px; font-size: 13px">{text}</div>'


@contextmanager
def empty_server(port: int = PORT, announces: bool = False) -> Iterator[Any]:
    """A server with an empty scene, which listens on 127.0.0.1 only; it stops in the end.

    It gets the next free port if another program has `port`; `announces` is whether viser may say
    where it is to be seen. Raises `UsageError` if viser is not installed, or there is no such port,
    or none is free from it on.
    """
    require("viser", "the viewer", "viewer")
    import viser

    port = _free_port(port)

    # It says so however quiet it was set.
    with nullcontext() if announces else _silence():
        server = viser.ViserServer(host=_HOST, port=port, verbose=False)
    # A button that would ask another machine.
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    try:
        yield server
    finally:
        with _silence():
            server.stop()


def _free_port(port: int) -> int:
    """The first port that is free; viser, which also looks for one, does so without an end."""
    if not 1 <= port <= _LAST:
        raise UsageError(f"port {port}: a port is a number from 1 to {_LAST}")
    for tried in range(port, _LAST + 1):
        with socket.socket() as bound, suppress(OSError):
            # As the server does; on Windows it would take ports that others have.
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, int(os.name == "posix"))
            bound.bind((_HOST, tried))
            return tried
    raise UsageError(f"port {port}: this port and all after it are in use; give a smaller one")


@contextmanager
def _silence() -> Iterator[None]:
    """Let nothing be written to Rich's console, which in a notebook is no stream."""
    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = quiet


def address(server: Any) -> str:
    """The address of viser's server for a browser."""
    return f"http://{server.get_host()}:{server.get_port()}"
