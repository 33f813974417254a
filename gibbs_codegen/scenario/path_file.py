"""Paths as tables of a scenario file: `kind` and what belongs to it."""

from __future__ import annotations

import itertools
import math
from typing import Any

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.toml_table import Table
from gibbs_codegen.scenario.paths import (
    Circle,
    Fixed,
    Harmonic,
    Line,
    Path,
    Term,
    Waypoints,
)

_LEAST = 1e-9
# A quintic spline at rest at both ends needs no more.
_FEWEST_POINTS = 2
_MOST_POINTS = 10_000
_MOST_TERMS = 100
_ZERO = (0.0, 0.0, 0.0)


def read_path(table: Table) -> Path | None:
    """The path that a table describes; None where its kind is missing or wrong."""
    readers = {
        "fixed": _fixed,
        "harmonic": _harmonic,
        "line": _line,
        "circle": _circle,
        "waypoints": _waypoints,
    }
    if "kind" not in table.values:
        table.fault("kind", f"missing; one of {', '.join(readers)}")
        return None
    before = len(table.faults)
    kind = table.choice("kind", tuple(readers), "fixed")
    return readers[kind](table) if len(table.faults) == before else None


def _fixed(table: Table) -> Path:
    table.refuse_unknown(("kind", "position"))
    x, y, z = _required(table, "position")
    return Fixed((x, y, z))


def _harmonic(table: Table) -> Path:
    table.refuse_unknown(("kind", "x", "y", "z"))
    terms = []
    for axis in "xyz":
        entries = table.tables(axis, _MOST_TERMS, "terms")
        terms.append(tuple(_term(entry) for entry in entries))
    return Harmonic(*terms)


def _term(table: Table) -> Term:
    table.refuse_unknown(("amplitude", "growth", "frequency", "phase_deg"))
    if "amplitude" not in table.values:
        table.fault("amplitude", "missing: in m")
    return Term(
        table.number("amplitude", 0.0),
        table.number("growth", 0.0),
        table.number("frequency", 0.0),
        math.radians(table.number("phase_deg", 0.0)),
    )


def _line(table: Table) -> Path:
    table.refuse_unknown(("kind", "start", "end", "duration", "begin"))
    a, b, c = _required(table, "start")
    d, e, f = _required(table, "end")
    if "duration" not in table.values:
        table.fault("duration", "missing: the time from start to end, in s")
    duration = table.number("duration", 1.0, least=_LEAST)
    return Line((a, b, c), (d, e, f), duration, table.number("begin", 0.0))


def _circle(table: Table) -> Path:
    table.refuse_unknown(("kind", "centre", "radius", "period", "normal", "phase_deg"))
    a, b, c = _required(table, "centre")
    x, y, z = table.numbers("normal", 3, (0.0, 0.0, 1.0))
    if math.hypot(x, y, z) < _LEAST:
        table.fault("normal", "a direction of length zero")
        x, y, z = 0.0, 0.0, 1.0
    for key, unit in (("radius", "m"), ("period", "s; negative: the other way round")):
        if key not in table.values:
            table.fault(key, f"missing: in {unit}")
    period = table.number("period", 1.0)
    if abs(period) < _LEAST:
        table.fault("period", "must not be 0")
        period = 1.0
    radius = table.number("radius", 1.0, least=0.0)
    phase = math.radians(table.number("phase_deg", 0.0))
    return Circle((a, b, c), radius, period, (x, y, z), phase)


def _waypoints(table: Table) -> Path | None:
    table.refuse_unknown(("kind", "times", "points"))
    times, points = _listed(table, "times"), _listed(table, "points")
    if times is None or points is None:
        return None
    if len(points) != len(times) or not _FEWEST_POINTS <= len(times) <= _MOST_POINTS:
        table.fault(
            "points",
            f"{len(points)} points at {len(times)} times; give as many of both, "
            f"{_FEWEST_POINTS} to {_MOST_POINTS}",
        )
        return None
    before = len(table.faults)
    instants = table.check_numbers("times", times, len(times), (0.0,) * len(times))
    places = [table.check_numbers(f"points[{i}]", p, 3, _ZERO) for i, p in enumerate(points)]
    if len(table.faults) > before:
        return None
    for i, (sooner, later) in enumerate(itertools.pairwise(instants)):
        if later <= sooner:
            table.fault(f"times[{i + 1}]", f"must be after {sooner:g}, not {later:g}")
            return None
    try:
        return Waypoints(instants, places)
    except UsageError as error:
        table.fault("times", str(error))
        return None


def _listed(table: Table, key: str) -> list[Any] | None:
    value = table.values.get(key)
    if isinstance(value, list):
        return value
    table.fault(key, "missing" if value is None else "must be a list")
    return None


def _required(table: Table, key: str) -> tuple[float, ...]:
    if key not in table.values:
        table.fault(key, "missing: [x, y, z] in m")
    return table.numbers(key, 3, _ZERO)
