"""Texts of robot files, a line for each part; and machines that several tests share."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

Numbers = Sequence[float]
# Of a cart, m: half of the distance of its wheels, and their radius.
WIDTH, RADIUS = 0.5, 0.15
PAIR = "[[rotor]]\nposition = [0.2, 0, 0]\n[[rotor]]\nposition = [-0.2, 0, 0]\n"


def table(kind: str, **keys: Any) -> str:
    """A table, in two brackets of an array."""
    return "\n".join([kind, *_lines(keys), ""])


def _lines(keys: dict[str, Any]) -> list[str]:
    return [
        f"{key} = {{ {', '.join(_lines(value))} }}"
        if isinstance(value, dict)
        else f"{key} = {json.dumps(value)}"
        for key, value in keys.items()
    ]


def machine(name: str, *parts: str, **keys: Any) -> str:
    """The text of a robot, with keys of its top table."""
    return table("", name=name, **keys) + "".join(parts)


def _inertia(moments: Numbers) -> list[float]:
    """Six numbers, of which products may be left out."""
    return [*moments, 0, 0, 0][:6]


def base(mass: float, moments: Numbers, **keys: Any) -> str:
    return table("[base]", mass=mass, inertia=_inertia(moments), **keys)


def link(
    name: str,
    axis: str | Numbers,
    xyz: Numbers,
    mass: float,
    com: Numbers,
    moments: Numbers,
    **keys: Any,
) -> str:
    of_body = {"mass": mass, "com": com, "inertia": _inertia(moments)}
    return table("[[link]]", name=name, axis=axis, xyz=xyz, **of_body, **keys)


def rod(name: str, axis: str, xyz: Numbers, length: float, density: float, **keys: Any) -> str:
    of_body = {"length": length, "mass_per_length": density}
    return table("[[link]]", name=name, axis=axis, xyz=xyz, **of_body, **keys)


def wheel(name: str, xyz: Numbers, radius: float = RADIUS, **keys: Any) -> str:
    return table("[[wheel]]", name=name, radius=radius, xyz=xyz, **keys)


def frame(name: str, on: str, xyz: Numbers, **keys: Any) -> str:
    return table("[[frame]]", name=name, on=on, xyz=xyz, **keys)


def spring(name: str, of: str, to: str, **keys: Any) -> str:
    return table("[[spring]]", name=name, frame=of, to=to, **keys)


def constraint(name: str, kind: str, of: str, **keys: Any) -> str:
    return table("[[constraint]]", name=name, type=kind, frame=of, **keys)


def cart(name: str, *others: str, com: Numbers, moments: Numbers, **of_wheels: Any) -> str:
    """A cart with two driven wheels, as Fierro and Lewis's (1995)."""
    rolling = {"motion": "planar", "drive": "differential", "com": com}
    sides = {"left": WIDTH, "right": -WIDTH}
    wheels = (wheel(x, [0, y, RADIUS], joint=x, **of_wheels) for x, y in sides.items())
    return machine(name, base(30, moments, **rolling), *wheels, *others)
