"""The results of a flight in a folder: time series, figures and an animation."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack, contextmanager, suppress
from copy import copy
from importlib import import_module
from pathlib import Path
from typing import Any

from gibbs_codegen.errors import OutputError, UsageError, printable
from gibbs_codegen.figures import FORMATS
from gibbs_codegen.files.staging import check_output_folder, staging_folder, writing
from gibbs_codegen.flight.record.flight import Flight, is_flight
from gibbs_codegen.flight.sweeps.workers import Workers, own_count

ANIMATIONS = ("gif", "mp4")
# Names of figures, which are functions of `flight.figures.flight`.
FIGURES = (
    *("coordinates", "snapshots", "snapshots_panels", "inputs", "actuators", "battery"),
    *("outside", "constraint_torques", "tracking_error", "energy", "contacts", "estimates"),
)
# Names of all files of results.
_NAMES = {f"flight.{suffix}" for suffix in ("npz", "csv", *ANIMATIONS)}
_NAMES |= {f"{name}.{suffix}" for name in FIGURES for suffix in FORMATS}
# Processes that draw: with more, each would have its own longest figure only.
_MOST_WORKERS = 2
# Longer flights are not copied.
_MOST_SAMPLES = 100_000


def write_results(
    flight: Flight,
    folder: str | os.PathLike[str],
    figures: bool = True,
    animation: str = "",
    progress: Callable[[str, float], None] = lambda stage, share: None,
    formats: Sequence[str] = FORMATS[:1],
    workers: Workers | None = None,
) -> list[Path]:
    """Write `flight.npz`, `flight.csv`, figures, and `flight.gif` or `flight.mp4`.

    Results of an earlier flight in the folder are replaced once all new ones are complete; other
    files are left alone.

    Args:
        flight: The flight.
        folder: Where the files go; made if need be.
        figures: Whether to draw figures.
        animation: "gif", "mp4", or empty for none.
        progress: Called with the name of the file and the share done, 0 to 1.
        formats: Those of the figures: "png", "pdf" or "svg".
        workers: Processes that draw figures, as of `drawing_beside`, and are ended then; by default
            this one does.

    Returns:
        Paths of the files written.

    Raises:
        UsageError: The folder cannot be used, or a format is unknown; nothing has changed.
        OutputError: The results cannot be written; nothing has changed.
    """
    check_results(folder, animation)
    formats = [formats] if isinstance(formats, str) else formats
    if unknown := set(formats) - set(FORMATS):
        raise UsageError(f"format {min(unknown)!r}: unknown; known: {', '.join(FORMATS)}")
    folder = Path(folder)
    # Workers end before what is staged goes: they would write on.
    with _staged(folder) as staging, ExitStack() as drawing:
        # A copy, since it is sent while properties of the flight are still cached here.
        tasks, drawn = [], (copy(flight), staging, formats)
        if workers and figures and len(flight.time) <= _MOST_SAMPLES:
            of = workers.count
            drawing.callback(workers.end)
            with suppress(BrokenExecutor):
                tasks = [workers.submit(_drawn, *drawn, share, of) for share in range(of)]
        progress("time series", 0.0)
        flight.write_npz(staging / "flight.npz")
        flight.write_csv(staging / "flight.csv")
        if figures and formats:
            progress("figures", 0.0)
            try:
                for task in tasks:
                    task.result()
            except BrokenExecutor:
                tasks = []
            drawing.close()
            if not tasks:
                _drawn(*drawn)
        if animation:
            from gibbs_codegen.flight.figures.animation import write_animation

            write_animation(
                flight,
                staging / f"flight.{animation}",
                progress=lambda done, total: progress("animation", done / total),
            )
        names = sorted(path.name for path in staging.iterdir())
    for name in _NAMES - set(names):
        (folder / name).unlink(missing_ok=True)
    return [folder / name for name in names]


def _drawn(flight: Flight, *arguments: Any) -> None:
    """Draw figures, as of `write_figures`."""
    # Late, as Matplotlib takes long to import.
    from gibbs_codegen.flight.figures.flight import write_figures

    write_figures(flight, *arguments)


@contextmanager
def drawing_beside(formats: Sequence[str]) -> Iterator[Workers | None]:
    """Processes that draw figures, and import what that takes from now on; None if they cannot.

    They are copies of this one, in which no other thread of Python may run yet.
    """
    forks = sys.platform == "linux" and hasattr(os, "fork")
    if not (formats and forks and own_count() >= _MOST_WORKERS):
        yield None
        return
    workers = Workers(_MOST_WORKERS, "fork")
    try:
        for _ in range(workers.count):
            workers.submit(import_module, "gibbs_codegen.flight.figures.flight")
        yield workers
    finally:
        workers.end()


def check_results(folder: str | os.PathLike[str], animation: str = "") -> None:
    """Check that results can be written, before the work of a flight.

    `animation` is "gif", "mp4", or empty for none. Raises `UsageError` if the path cannot become a
    folder of results, or the animation is unknown, and `OutputError` if nothing can be written
    there, or the animation's program is missing.
    """
    check_output_folder(folder)
    if animation and animation not in ANIMATIONS:
        raise UsageError(f"animation {animation!r}: unknown; known: {', '.join(ANIMATIONS)}")
    if animation == "mp4" and shutil.which("ffmpeg") is None:
        raise OutputError(
            ".mp4 needs ffmpeg, which is not on the PATH; install it, or write a .gif"
        )
    place = Path(folder)
    present = [place / name for name in sorted(_NAMES) if os.path.lexists(place / name)]
    odd = [path for path in present if path.is_symlink() or not path.is_file()]
    if odd or (present and not is_flight(place / "flight.npz")):
        names = ", ".join(path.name for path in (odd or present)[:5])
        raise UsageError(
            f"{printable(place)}: holds files that no simulation wrote: {names}; move them, or "
            "choose another --out"
        )
    with _staged(place):
        pass


@contextmanager
def _staged(folder: Path) -> Iterator[Path]:
    """A hidden folder whose files go to `folder` if all goes well, and nowhere if not."""
    with writing(folder), staging_folder(folder) as new:
        try:
            yield new
        except OutputError as error:
            raise OutputError(str(error).replace(printable(new), printable(folder))) from None
        # The series first: by them the folder is known for one of results from then on.
        for path in sorted(new.iterdir(), key=lambda path: (path.name != "flight.npz", path)):
            os.replace(path, folder / path.name)
