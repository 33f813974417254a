"""The pattern of the hybrid system as a picture, in which entries can be lit."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]

_FILLED, _LIT, _LINE = "#9fb3c8", "#e69f00", "#cccccc"
_GRID = 'stroke="white" stroke-width="0.08"'
# In cells: what labels of rows take, the gap between arrays, and what heads take above.
_LABEL, _GAP, _HEAD = 6.0, 1.0, 1.6
# Letters of a name that are shown.
_LONGEST = 9
_SUBSCRIPTS = str.maketrans("m0123456789", "₋₀₁₂₃₄₅₆₇₈₉")


def pattern_svg(names: Sequence[str], filled: Flags, lit: Flags) -> str:
    """I_H, R_H and B_H beside each other, a cell for each entry, as SVG as wide as there is room.

    `names` are of the m unknowns, which label the rows; `filled` tells of entries (m, m + 1 + nu)
    whether they are not zero in every posture; `lit` which are lit.
    """
    rows, columns = filled.shape
    lefts = _LABEL + np.arange(columns) + _GAP * (np.arange(columns) >= rows)
    lefts += _GAP * (np.arange(columns) > rows)
    parts = [
        f'<path d="{_cells(filled & ~lit, lefts)}" fill="{_FILLED}" {_GRID}/>',
        f'<path class="lit" d="{_cells(lit, lefts)}" fill="{_LIT}" {_GRID}/>',
    ]
    for title, first, after in (("I", 0, rows), ("R", rows, rows + 1), ("B", rows + 1, columns)):
        if first == after:
            continue
        left, width = lefts[first], after - first
        parts.append(
            f'<rect x="{left}" y="{_HEAD}" width="{width}" height="{rows}" fill="none" '
            f'stroke="{_LINE}" stroke-width="0.1"/>'
            f'<text x="{left + width / 2}" y="{_HEAD - 0.5}" text-anchor="middle" '
            f'font-size="1.2" font-style="italic">{title}'
            f'<tspan dy="0.25" font-size="0.9">H</tspan></text>'
        )
    parts += [
        f'<text x="{_LABEL - 0.4}" y="{_HEAD + row + 0.8}" text-anchor="end" '
        f'font-size="1.05">{html.escape(_short(symbol(name)))}</text>'
        for row, name in enumerate(names)
    ]
    size = f"0 0 {lefts[-1] + 1.2} {_HEAD + rows + 0.2}"
    return (
        f'<svg viewBox="{size}" width="100%" role="img" aria-label="Pattern of the hybrid system" '
        f'font-family="sans-serif" fill="#222">{"".join(parts)}</svg>'
    )


def symbol(name: str) -> str:
    """A name of a coordinate or torque with letters as the paper has them.

    Such as θ₋₁ for theta_m1, τ′₂ for tau_prime_2; other names are as they are.
    """
    found = re.fullmatch(r"(theta|tau|tau_prime|F)_(m?\d+)", name)
    if not found:
        return name
    letters = {"theta": "θ", "tau": "τ", "tau_prime": "τ′", "F": "F"}
    return letters[found[1]] + found[2].translate(_SUBSCRIPTS)


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"


def _cells(chosen: Flags, lefts: NDArray[np.float64]) -> str:
    """Squares at entries, as a path."""
    places = zip(*np.nonzero(chosen), strict=True)
    return "".join(f"M{lefts[column]:g} {_HEAD + row:g}h1v1h-1z" for row, column in places)
