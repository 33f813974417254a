"""What was identified, as text and as one page of HTML that needs nothing else."""

from __future__ import annotations

import html
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gibbs_codegen.identification.identify import Identified

# Correlations that are told.
_CORRELATED, _MOST = 0.8, 12
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;"
    "color:#222}table{border-collapse:collapse}td,th{padding:.15rem .9rem .15rem 0;"
    "text-align:left;border-bottom:1px solid #ddd}td:not(:first-child){font-variant-numeric:"
    "tabular-nums}h2{margin-top:2rem;font-size:1.1rem}"
)
Section = tuple[str, Sequence[str], Sequence[tuple[str, ...]]]


def sections(result: Identified) -> Iterator[Section]:
    """Titles, headings and rows of tables."""
    if not result.robot_file:
        why = "a robot file must not have these numbers"
        if not result.settled:
            why = "the fit did not converge. The numbers below are no results, without deviations"
        title = f"{result.robot}: {why}, and no robot file is written"
        yield title, ("",), [(words,) for words in result.advice]
    numbers = zip(result.names, result.before, result.values, result.deviations, strict=True)
    rows = [number_row(*row) for row in numbers]
    heads: tuple[str, ...] = ("number", "robot file", "identified", "± deviation", "of it")
    if not result.settled:
        heads, rows = (*heads[:2], "where it ended"), [row[:3] for row in rows]
    yield f"{result.robot}, from {result.source}, in SI units", heads, rows
    if result.contradictions:
        rows = [(words,) for words in result.contradictions]
        yield "Contradictions with the robot file", ("",), rows
    if result.settled:
        listed = [(words,) for words in result.unseen] or [("Nothing.",)]
        yield "What the log cannot identify", ("",), listed
    size = np.sqrt(np.diag(result.covariance))
    correlation = result.covariance / np.outer(size, size)
    pairs = [
        (abs(correlation[i, j]), result.names[i], result.names[j], f"{correlation[i, j]:.3f}")
        for i in range(len(size))
        for j in range(i)
        if abs(correlation[i, j]) > _CORRELATED
    ]
    if pairs:
        title = f"Most correlated numbers, at most {_MOST}"
        rows = [pair[1:] for pair in sorted(pairs, reverse=True)[:_MOST]]
        yield title, ("number", "with", "correlation"), rows
    if result.prediction:
        rows = [(name, *(f"{x:.3g}" for x in pair)) for name, pair in result.prediction.items()]
        title = "Errors of predictions in the held-out part of the log"
        yield title, ("of", "by the robot file", "as identified"), rows
    rows = [
        (name, f"{x:.4g}", f"{s:.2g}" if np.isfinite(s) else "")
        for name, (x, s) in result.others.items()
    ]
    if rows:
        told = slice(2 + result.settled)
        yield "Besides", ("", "value", "± deviation")[told], [row[told] for row in rows]
    rows = [(name, f"{x:.2f}") for name, x in result.residuals.items()]
    title = (
        "Residuals: of readings divided by their deviations, about 1 if the model explains "
        "them; of accelerations the unexplained share"
    )
    yield title, ("reading", "root mean square"), rows


def number_row(name: str, *values: float) -> tuple[str, ...]:
    """The row of a number: values and a deviation, which is a share of the last of them."""
    *known, deviation = values
    share = f"{100 * deviation / abs(known[-1]):.2g} %" if known[-1] else ""
    return (name, *(f"{x:.5g}" for x in known), f"{deviation:.2g}", share)


def as_text(sections: Iterable[Section]) -> str:
    """Tables with titles as text."""
    lines = []
    for title, heads, rows in sections:
        table = [tuple(heads), *rows] if any(heads) else rows
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines += [title, ""]
        lines += ["  ".join(map(str.ljust, row, widths)).rstrip() for row in table]
        lines += [""]
    return "\n".join(lines)


def html_report(result: Identified) -> str:
    """The report as a page."""
    parts = [f"<!doctype html><meta charset=utf-8><title>{html.escape(result.robot)}</title>"]
    parts.append(f"<style>{_STYLE}</style>")
    for title, heads, rows in sections(result):
        parts.append(f"<h2>{html.escape(title)}</h2><table>")
        if any(heads):
            parts.append(_row(heads, "th"))
        parts += [*(_row(row, "td") for row in rows), "</table>"]
    return "\n".join(parts) + "\n"


def _row(cells: Sequence[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"
