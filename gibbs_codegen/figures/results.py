"""What a flight leaves on disk: time series, figures, an animation; whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from gibbs_codegen.errors import OutputError, UsageError, cause_of, printable
from gibbs_codegen.files.output_folder import check_output_folder
from gibbs_codegen.files.staging import staging_folder
from gibbs_codegen.simulator.record.flight import Flight, is_flight

ANIMATIONS = ("gif", "mp4")
# Of `figures.FIGURES`, without importing Matplotlib; a test holds them to each other.
FIGURE_NAMES = (
    "coordinates",
    "snapshots",
    "snapshots_panels",
    "inputs",
    "constraint_torques",
    "tracking_error",
    "energy",
)
_NAMES = {f"flight.{suffix}" for suffix in ("npz", "csv", *ANIMATIONS)}
_NAMES |= {f"{name}.{suffix}" for name in FIGURE_NAMES for suffix in ("png", "pdf")}


def write_results(
    flight: Flight,
    folder: str | os.PathLike[str],
    figures: bool = True,
    animation: str = "",
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> list[Path]:
    """Write `flight.npz`, `flight.csv`, figures as PNG and PDF, and `flight.gif` or `flight.mp4`.

    Results of an earlier flight in the folder are replaced once all new ones are complete; other
    files are left alone.

    Args:
        flight: The flight.
        folder: Where the files go; made if need be.
        figures: Whether to draw figures.
        animation: "gif", "mp4", or empty for none.
        progress: Is called with what is being written and the share (0 to 1) that is done.

    Returns:
        Paths of the files written.

    Raises:
        UsageError: The folder cannot be used, or the animation is unknown; nothing has changed.
        OutputError: The results cannot be written; nothing has changed.
    """
    check_results(folder, animation)
    folder = Path(folder)
    with _staged(folder) as staging:
        progress("time series", 0.0)
        flight.write_npz(staging / "flight.npz")
        flight.write_csv(staging / "flight.csv")
        if figures:
            # Matplotlib takes a second to import, which a flight without figures need not.
            from gibbs_codegen.figures.flight import write_figures

            progress("figures", 0.0)
            write_figures(flight, staging)
        if animation:
            from gibbs_codegen.figures.animation import write_animation

            write_animation(
                flight,
                staging / f"flight.{animation}",
                progress=lambda done, total: progress("animation", done / total),
            )
        names = sorted(path.name for path in staging.iterdir())
    for name in _NAMES - set(names):
        (folder / name).unlink(missing_ok=True)
    return [folder / name for name in names]


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
        raise OutputError(".mp4 needs ffmpeg, which is not on the path; .gif needs nothing more")
    _refuse_foreign(Path(folder))
    with _staged(Path(folder)):
        pass


def _refuse_foreign(folder: Path) -> None:
    """Raise `UsageError` for files of the names of results that no earlier flight has left."""
    present = [folder / name for name in sorted(_NAMES) if os.path.lexists(folder / name)]
    odd = [path for path in present if path.is_symlink() or not path.is_file()]
    if odd or (present and not is_flight(folder / "flight.npz")):
        names = ", ".join(path.name for path in (odd or present)[:5])
        raise UsageError(
            f"{printable(folder)}: holds files that no simulation has written: {names}; "
            "move them elsewhere, or choose another --out"
        )


@contextmanager
def _staged(folder: Path) -> Iterator[Path]:
    """A hidden folder whose files go to `folder` if all goes well, and nowhere if not."""
    try:
        with staging_folder(folder) as new:
            yield new
            # The series first: by them the folder is known for one of results from then on.
            for path in sorted(new.iterdir(), key=lambda path: (path.name != "flight.npz", path)):
                os.replace(path, folder / path.name)
    except OSError as error:
        raise OutputError(f"{printable(folder)}: cannot be written: {cause_of(error)}") from None
    except OutputError as error:
        raise OutputError(str(error).replace(printable(new), printable(folder))) from None
