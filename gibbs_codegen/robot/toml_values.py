"""Values of a robot as they stand in TOML, so that they read back bit for bit."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from gibbs_codegen.robot.model import AXES, Body, Rod, Vector3


def quoted(text: str) -> str:
    """A text in double quotes on one line, with escapes for what cannot be printed."""
    escapes = {'"': '\\"', "\\": "\\\\"}
    return '"' + "".join(escapes.get(letter) or _escaped(letter) for letter in text) + '"'


def _escaped(letter: str) -> str:
    if letter.isprintable():
        return letter
    return f"\\u{ord(letter):04x}" if ord(letter) < 0x10000 else f"\\U{ord(letter):08x}"


def numbers(values: Iterable[float]) -> str:
    """Numbers of a list with commas between them."""
    return ", ".join(repr(float(value)) for value in values)


def degrees(angle: Fraction) -> str:
    """An angle in degrees, which is that of a decimal number."""
    return str(angle.numerator) if angle.denominator == 1 else repr(float(angle))


def direction(vector: Vector3) -> str:
    """A unit vector as the letter of its axis, with a minus sign if against it, or a list."""
    for letter, unit in AXES.items():
        if vector == unit:
            return f'"{letter}"'
        if all(entry == -other for entry, other in zip(vector, unit, strict=True)):
            return f'"-{letter}"'
    return f"[{numbers(vector)}]"


def body_lines(body: Body) -> list[str]:
    """The keys of a rod or rigid body, a line each."""
    lines = [f"length = {body.length!r}"]
    if isinstance(body, Rod):
        return [
            *lines,
            f"mass_per_length = {body.mass_per_length!r}",
            f"section_inertia = [{numbers(body.section_inertia)}]",
        ]
    return [
        *lines,
        f"mass = {body.mass!r}",
        f"com = [{numbers(body.com)}]",
        f"inertia = [{numbers(body.inertia)}]",
    ]


def inline_table(body: Body) -> str:
    """A body as a table on one line."""
    return "{ " + ", ".join(body_lines(body)) + " }"
