"""The terminal: its width, progress while something takes long, and signals that end the work."""

from __future__ import annotations

import shutil
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import Progress as Bars
from rich.table import Table

if TYPE_CHECKING:
    from gibbs_codegen.program.model import Progress


def width(elsewhere: int = 80) -> int:
    """Columns of the terminal, or `elsewhere`, where the output is not shown by one."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else elsewhere


def plain_table(
    title: str, *columns: str, rows: Iterable[Iterable[str]] = (), **style: Any
) -> Table:
    """A table without lines, its title on the left, with headings of its first columns."""
    table = Table(
        title=title, title_justify="left", box=None, header_style="dim", pad_edge=False, **style
    )
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def print_table(table: Table, console: Console) -> None:
    """Print a table; where the output goes elsewhere than to a terminal, words stay whole."""
    table = deepcopy(table)
    if table.title:  # Above a table, it may be longer than its lines.
        console.print(table.title, style="table.title", highlight=False)
    table.title = None
    if not console.is_terminal:
        for column in table.columns:
            words = [word for cell in column.cells for word in str(cell).split()]
            column.min_width = max(map(len, words), default=0)
    console.print(table, crop=console.is_terminal)


@contextmanager
def progress(stage: str = "deriving the equations of the robot") -> Iterator[Progress]:
    """A spinner that names the step at work, on a terminal; in a pipe a line if it takes long."""
    if not sys.stderr.isatty():
        from gibbs_codegen.runtime.c_library import announced  # Late: it takes time to import.

        with announced(stage):
            yield lambda _: None
        return
    with Console(stderr=True).status("starting") as status:
        yield lambda step: status.update(step)


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar for each thing that is being done; in a pipe a line for each detail behind a colon."""
    if not sys.stderr.isatty():
        yield lambda stage, share: print(stage, file=sys.stderr) if ": " in stage else None
        return
    with Bars(console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def show(stage: str, share: float) -> None:
            task = stage.partition(": ")[0]
            if task not in tasks:
                tasks[task] = bars.add_task(task, total=1.0)
            bars.update(tasks[task], description=stage, completed=share)

        yield show


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let signals to end unwind the work, so that it leaves nothing half-written."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    before = {}
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            before[number] = signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def counted(number: int, noun: str) -> str:
    """A number of things."""
    return f"{number} {noun}{'s' * (number != 1)}"
