"""What a flight leaves on disk: time series, figures, an animation; whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.simulator.flight import Flight

ANIMATIONS = ("gif", "mp4")
_STAGING_PREFIX = ".gibbs_codegen_flight_"


def write_results(
    flight: Flight,
    folder: str | os.PathLike[str],
    figures: bool = True,
    animation: str = "",
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> list[Path]:
    """Write `flight.npz`, `flight.csv`, figures as PNG and PDF, and `flight.gif` or `flight.mp4`.

    `animation` is "gif", "mp4" or empty for none. Files of these names that are in `folder` are
    replaced once all new ones are complete; others are left alone. Returns the paths written.
    Raises `UsageError` or `OutputError`, and then has changed nothing.
    """
    check_folder(folder)
    if animation and animation not in ANIMATIONS:
        raise UsageError(f"animation {animation!r}: unknown; known: {', '.join(ANIMATIONS)}")
    folder = Path(folder)
    with _staged(folder) as staging:
        progress("time series", 0.0)
        flight.write_npz(staging / "flight.npz")
        flight.write_csv(staging / "flight.csv")
        if figures:
            # Matplotlib takes a second to import, which a flight without figures need not.
            from gibbs_codegen.simulator.figures import write_figures

            progress("figures", 0.0)
            write_figures(flight, staging)
        if animation:
            from gibbs_codegen.simulator.animation import write_animation

            write_animation(
                flight,
                staging / f"flight.{animation}",
                progress=lambda done, total: progress("animation", done / total),
            )
        names = sorted(path.name for path in staging.iterdir())
    return [folder / name for name in names]


def check_folder(folder: str | os.PathLike[str]) -> None:
    """Refuse a path that cannot become a folder of results. Raises `UsageError`."""
    for path in (Path(folder), *Path(folder).parents):
        if path.exists() and not path.is_dir():
            raise UsageError(f"{path}: is a file; --out must be a folder")


@contextmanager
def _staged(folder: Path) -> Iterator[Path]:
    """A hidden folder whose files go to `folder` if all goes well, and nowhere if not."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=_STAGING_PREFIX, dir=folder))
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from None
    try:
        yield staging
        for path in sorted(staging.iterdir()):
            os.replace(path, folder / path.name)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)
