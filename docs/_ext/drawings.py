"""Write the drawings of pages to docs/_static: `python docs/_ext/drawings.py`."""

from __future__ import annotations

import re
from pathlib import Path

from gibbs_codegen.figures.architecture_sketch import architecture_sketch
from gibbs_codegen.figures.convention_sketch import conventions_sketch
from gibbs_codegen.figures.style import style

STATIC = Path(__file__).parent.parent / "_static"
DRAWINGS = {"architecture.svg": architecture_sketch, "conventions.svg": conventions_sketch}


def write_drawings(folder: Path) -> None:
    """Write every drawing.

    Args:
        folder: Where they go.
    """
    for name, draw in DRAWINGS.items():
        path = folder / name
        with style():
            draw().savefig(path, metadata={"Date": None})
        text = path.read_text(encoding="utf-8")
        path.write_text(re.sub(r'(?<= d=")[^"]*', _rounded, text), encoding="utf-8")


def _rounded(curve: re.Match[str]) -> str:
    """A curve, most of them letters, with one decimal place: the file is half as large."""
    return re.sub(r"(\.\d)\d+", r"\1", curve[0])


if __name__ == "__main__":
    write_drawings(STATIC)
