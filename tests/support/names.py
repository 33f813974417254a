"""Whether the names in a figure can be read: large enough, inside it, and apart from each other."""

from __future__ import annotations

from itertools import combinations

from matplotlib.figure import Figure
from matplotlib.text import Text

# Points by which the boxes of two names may overlap: letters do not fill their boxes.
_SLACK = 2.0


def assert_names_are_apart(figure: Figure, smallest: float) -> None:
    """Fail if a name is cut off, is too small, or lies on another.

    Args:
        figure: The figure, whose ticks and legends are not looked at.
        smallest: The least size of a name, points.
    """
    figure.draw_without_rendering()
    slack = _SLACK * figure.dpi / 72.0
    boxes = {}
    for axes in figure.axes:
        titles = [axes.title, axes._left_title]  # type: ignore[attr-defined]
        for text in [*axes.texts, *titles]:
            if text.get_text() and text.get_visible():
                assert text.get_fontsize() >= smallest, text.get_text()
                boxes[text] = Text.get_window_extent(text)
    assert boxes
    page = figure.bbox
    for text, box in boxes.items():
        assert page.x0 - slack <= box.x0 < box.x1 <= page.x1 + slack, text
        assert page.y0 - slack <= box.y0 < box.y1 <= page.y1 + slack, text
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        across = min(a.x1, b.x1) - max(a.x0, b.x0)
        up = min(a.y1, b.y1) - max(a.y0, b.y0)
        assert across <= slack or up <= slack, (one.get_text(), other.get_text())
