"""Broken and hostile TOML files, each made from a whole one by the number it is asked for.

A mutant is bytes, not text: what an editor, a disk or an enemy makes of a file need not be text.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

NUMBERS = (
    *("nan", "-nan", "inf", "-inf", "0", "-0.0", "-1", "-9.81", "1e-320", "5e-324", "1e-160"),
    *("1e16", "1e154", "1e160", "1e308", "-1e308", "1e999", "9" * 25, "9" * 400, "9" * 5000),
    *("0x" + "f" * 5000, "0b101", "0o777", "1_000", "+3", "01", "1.", ".5", "1e", "0.1e-400"),
    *("3600", "1e-9", "1e13"),
    *(
        "3",
        "6.0",
        "1.5",
        "90",
        "360.0000001",
        "-37.25",
        "1e22",
        "0." + "3" * 400,
        "2",
        "256",
        "257",
    ),
)
VALUES = (
    *NUMBERS,
    *('""', "''", '"x"', '"y"', '"zyx"', '"prismatic"', '"centre"', '"XYZ"', "'Motor1'", "true"),
    *("false", "True", "None", "null", "[]", "{}", "[[]]", "[{}]", "[0, 0, 1]", "[1, 0]", "[nan]"),
    *("[0, 0, 0, 0, 0, 0]", '["z", "y"]', '[1, "z", true]', "[[0, 0, 0], [0, 0, 1]]", "[1, 1, 5]"),
    *(
        "[1, 1, 1, 9, 0, 0]",
        "[-1, 1, 1, 0, 0, 0]",
        "[1e308, 1e308, 1e308]",
        "[0x" + "f" * 5000 + "]",
    ),
    *("1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", "1979-13-45", "{ length = 1, mass = 1 }"),
    *(
        "{ length = 0.5, mass_per_length = 1.0 }",
        "{ a = { b = [{ c = 1 }] } }",
        "[" * 40 + "]" * 40,
    ),
    *("[" * 9000, "{ a = " * 40 + "1" + " }" * 40, '"""two\nlines"""', "'''two\nlines'''", '"'),
    *(
        '"""',
        "[",
        "{",
        "]",
        "1 2",
        "",
        "#",
        "=",
        '"\\u0000"',
        '"\\u001b[31m"',
        '"\\ud800"',
        '"\\q"',
    ),
    *(
        '"' + "x" * 5000 + '"',
        '"' + "\\u001b" * 500 + '"',
        '"' + "é" * 70 + '"',
        '"../evil"',
        '"class"',
    ),
    *('"base"', '"fixed"', '"-y"', '"a1"', '"link1"', '"rotor1"', '"theta_1"', '"x"', '"1"'),
    *("[0, -90, 0]", "[1, 0, 0]", "[-inf, 1]", "[2, 1]", '"\\u0000"', '"arm 1.1"', '"arm 1_1"'),
    *('"tangent"', '"circle"', '"rk4"', '{ kind = "fixed", position = [1, 2, 3] }'),
    *('"ﬁeld"', '"а"', '"con"', '"{{7*7}}"', '"a\\nb"', '"*/"', "\"__import__('os')\"", '"%s{0}"'),
)
KEYS = (
    *("name", "gravity", "base", "link", "rotors", "thrust", "drag", "arm", "attitude", "origin"),
    *("length", "mass", "com", "inertia", "mass_per_length", "section_inertia", "alpha_deg", "a"),
    *("rotor", "frame", "on", "parent", "xyz", "rpy_deg", "axis", "constrained", "coordinate"),
    *("damping", "armature", "stiffness", "rest", "limits_deg", "effort", "velocity"),
    *("direction", "time_constant", "azimuth_deg", "allow_impossible_inertia"),
    *("kind", "path", "duration", "position", "points", "times", "x", "tip", "posture", "limits"),
    *("theta_deg", "d", "joint", "Mass", "mas", "lenght", "__class__", '""', "''", '"a b"', "a b"),
    *("a.b", "base.arm", "link.mass", "base.arm.com", "x" + ".x" * 15, "x" + ".x" * 16, "é", "1"),
    *("x" + ".x" * 3000, "k" * 5000, '"' + "\\u001b" * 50 + '"', '"[red]"', "'{{7*7}}'", "-", ""),
)
HEADERS = (
    *("[[rotor]]", "[rotor]", "[[frame]]", "[frame]", "[rotor.on]", "[[link.xyz]]"),
    *("[base]", "[[base]]", "[link]", "[[link]]", "[base.arm]", "[[base.arm]]", "[link.arm]"),
    *("[[link.mass]]", "[[thrust]]", "[]", "[[]]", "[name]", "[a.b.c]", "[[a]]", "[ base ]"),
    *("[base.path]", "[arm]", "[start]", "[parameters]", "[arm.limits]", "[[base.path.x]]"),
    *("[base", "base]", "[[link]", "[" + "a." * 3000 + "a]", "[base.rotors]", "[base.arm.com]"),
)
BYTES = (
    b"\0",
    b"\x1b[31m",
    b"\xff",
    b"\xc3",
    b"\r",
    b"\x7f",
    b"\xe2\x80\xae",
    b"\xef\xbb\xbf",
    b"\x85",
)

_VALUE = re.compile(r"(?<== )[^#\n]+")
_NUMBER = re.compile(r"(?<![\w.\"])-?\d[\d.]*(?:e-?\d+)?(?![\w.\"])")
_KEY = re.compile(r"(?m)^[a-z_]+(?= *=)|(?<=[{,] )[a-z_]+(?= =)")


def mutant(texts: Sequence[str], number: int) -> bytes:
    """One of `texts` with one to three things done to it; the same for the same number."""
    rng = random.Random(number)  # noqa: S311 - nothing is kept secret
    text = rng.choice(texts)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        text = rng.choice(_TEXT_MUTATIONS)(text, rng)
    data = text.encode("utf-8", "surrogatepass")
    return rng.choice(_BYTE_MUTATIONS)(data, rng) if rng.random() < 0.25 else data


def _replaced(pattern: re.Pattern[str], by: Sequence[str]) -> Callable[[str, random.Random], str]:
    """Put one of `by` in place of one match of a pattern."""

    def replace(text: str, rng: random.Random) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        begin, end = rng.choice(found).span()
        return text[:begin] + rng.choice(by) + text[end:]

    return replace


def _delete_line(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    del lines[rng.randrange(len(lines))]
    return "\n".join(lines)


def _duplicate_line(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    return "\n".join(lines)


def _swap_lines(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return "\n".join(lines)


def _insert_entry(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    lines.insert(rng.randrange(len(lines)), f"{rng.choice(KEYS)} = {rng.choice(VALUES)}")
    return "\n".join(lines)


def _insert_header(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    lines.insert(rng.randrange(len(lines)), rng.choice(HEADERS))
    return "\n".join(lines)


def _drop_from_list(text: str, rng: random.Random) -> str:
    commas = [match.start() for match in re.finditer(r",[^,\n\]]*", text)]
    if not commas:
        return text
    begin = rng.choice(commas)
    rest = re.sub(r"^,[^,\n\]]*", rng.choice(("", ", 1.0, 1.0", ", ,", ", nan")), text[begin:])
    return text[:begin] + rest


def _repeat(text: str, rng: random.Random) -> str:
    """A part many times over, which makes long lists, many tables and many faults."""
    lines = text.split("\n")
    begin = rng.randrange(len(lines))
    part = lines[begin : begin + rng.randrange(1, 9)]
    return "\n".join([*lines[:begin], *part * rng.choice((2, 70, 300)), *lines[begin:]])


def _truncate(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _flip(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 20)) if data else 0):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _insert_bytes(data: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(data) + 1)
    return data[:place] + rng.choice(BYTES) * rng.choice((1, 1, 500)) + data[place:]


def _encode(data: bytes, rng: random.Random) -> bytes:
    text = data.decode("utf-8", "replace")
    encoding = rng.choice(("utf-16", "utf-16-le", "utf-32", "latin-1", "utf-8-sig", "utf-7"))
    return text.encode(encoding, "replace")


def _line_ends(data: bytes, rng: random.Random) -> bytes:
    return data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\r", b"\x0b", b"\xe2\x80\xa8")))


_TEXT_MUTATIONS = (
    _replaced(_NUMBER, NUMBERS),
    _replaced(_NUMBER, NUMBERS),
    _replaced(_VALUE, VALUES),
    _replaced(_VALUE, VALUES),
    _replaced(_KEY, KEYS),
    _delete_line,
    _duplicate_line,
    _swap_lines,
    _insert_entry,
    _insert_header,
    _drop_from_list,
    _repeat,
)
_BYTE_MUTATIONS = (_truncate, _flip, _flip, _insert_bytes, _encode, _line_ends)
