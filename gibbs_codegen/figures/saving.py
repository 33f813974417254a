"""Figures as files: whole, and with the same bytes whenever they are written."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from gibbs_codegen.errors import OutputError, cause_of, printable
from gibbs_codegen.figures.style import style

# A date would make every file another.
_METADATA: dict[str, dict[str, None]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


def save_figures(
    figures: Iterable[tuple[str, Figure]], folder: Path, formats: Sequence[str] = ("png", "pdf")
) -> list[Path]:
    """Write figures, given with their names, in every format, and return the files in order.

    Raises `OutputError` if the folder, which is made if need be, cannot hold them.
    """
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures:
            for suffix in formats:
                path = folder / f"{name}.{suffix}"
                # A writer of PDF loses what the disk said; memory takes it whole.
                drawn = io.BytesIO()
                with style():
                    figure.savefig(drawn, format=suffix, metadata=_METADATA.get(suffix))
                path.write_bytes(drawn.getbuffer())
                paths.append(path)
    except OSError as error:
        raise OutputError(
            f"{printable(folder)}: cannot hold the figures: {cause_of(error)}"
        ) from None
    return paths
