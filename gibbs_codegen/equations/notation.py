"""The paper's symbols for every symbol of the derivation, in LaTeX and in plain text.

Within chain j quantities carry two indices, the chain and the item: θ_{j,1}, θ_{j,2}, θ_{j,3} are
θ₋₁, θ₀, θ₁, and θ_{j,4} is the constrained joint or the arm's first. Parameters carry the number of
their arm, hybrid unknowns the number of their row. Nothing here is parsed: names are looked up by
symbol, and what has no name is an error.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from enum import IntEnum


class Kind(IntEnum):
    """What a symbol stands for, in the order in which factors of a product are written."""

    INERTIA = 0
    LENGTH = 1
    GRAVITY = 2
    SINE_OR_COSINE = 3
    COORDINATE = 4
    SUM = 5
    STEP = 6
    MOTION = 7
    RATE = 8
    INPUT = 9
    ACCELERATION = 10
    RESULT = 11


@dataclass(frozen=True)
class Name:
    """A symbol as it is written, and what it means, with its unit.

    `index` is the subscript, by which sines and cosines of the symbol are written.
    """

    latex: str
    text: str
    kind: Kind
    meaning: str
    index: str = ""


_GREEK = {
    "theta": "θ",
    "tau": "τ",
    "omega": "ω",
    "mu": "μ",
    "rho": "ρ",
    "kappa": "κ",
    "delta": "δ",
    "alpha": "α",
    "epsilon": "ε",
    "zeta": "ζ",
}
_MARKS = {"dot": "\u0307", "ddot": "\u0308", "bar": "\u0304"}


def name(
    letter: str, index: str, kind: Kind, meaning: str, mark: str = "", prime: bool = False
) -> Name:
    """Compose a name of a letter with a dot, ddot or bar above, an index and a prime.

    A letter with a digit, such as B_0, stands in parentheses if it has an index, which would look
    like part of the digit. The meaning is for the legend, with the unit.
    """
    greek = _GREEK.get(letter, letter)
    text, latex = (
        greek.replace("_", "") + _MARKS.get(mark, ""),
        f"\\{letter}" if letter in _GREEK else letter,
    )
    if mark:
        latex = f"\\{mark}{{{latex}}}"
    if "_" in letter:
        latex = f"({latex})" if index else latex
    if prime:
        text, latex = f"{text}'", f"{latex}'"
    text = unicodedata.normalize("NFC", f"{text}{text_index(index)}")
    return Name(f"{latex}{latex_index(index)}", text, kind, meaning, index)


def latex_index(index: str) -> str:
    """A subscript in LaTeX, or ""."""
    degrees = r"^{\circ}"
    return f"_{{{index.replace('°', degrees)}}}" if index else ""


def text_index(index: str) -> str:
    """A subscript in plain text, or ""."""
    return "" if not index else f"_{index}" if len(index) == 1 else f"_{{{index}}}"


_LINEAR = ("x", "y", "z")
# Velocities of a base with a quaternion, by their first letters.
_TWIST = {"v": "v", "w": "omega"}
_PARAMETERS = (
    # Parameter's own name, letter, mark, further index, meaning.
    (r"length", "l", "", "", "length of {}"),
    (r"mass_per_length", "mu", "", "", "mass per length of {}"),
    (r"section_inertia_(xx|yy|zz)", "B_3", "", r"\1", "inertia of the cross-section of {}"),
    (r"mass", "m", "", "", "mass of {}"),
    (r"com_([xyz])", "rho", "", r"\1", "centre of mass of {}"),
    (r"inertia_([xyz]{2})", "J", "bar", r"\1", "inertia of {} about its centre of mass"),
    (r"a", "a", "", "", "distance along x from the joint before to that of {}"),
    (r"d", "d", "bar", "", "offset along the joint's axis of {}"),
    (r"([xyz])", "p", "", r"\1", "place of {} on what carries it"),
    (r"damping", "delta", "", "", "damping of the joint of {}"),
    (r"armature", "alpha", "", "", "inertia of what turns with the joint of {} alone"),
    (r"stiffness", "k", "", "", "stiffness of the joint of {}"),
    (r"rest", "theta", "bar", "", "rest of the spring at the joint of {}"),
    (r"drag", "kappa", "", "", "reaction torque of {} per unit of thrust"),
)


def parameter_name(internal: str, rotors: int, default: float, unit: str, whose: str = "") -> Name:
    """Name of a parameter: g, l_k, μ_k, m_k … by the number k of its arm.

    `internal` is its name in a robot whose links and rotors have none, `whose` the link's or
    rotor's; the arm's first link is arm N + 1. Value and unit, with ^2 for squares, go into the
    meaning. Raises `ValueError` if there is no such parameter.
    """
    value = f" ({default:.6g} {unit.replace('^2', '²')})"
    if internal == "gravity":
        return Name("g", "g", Kind.GRAVITY, f"gravity{value}")
    match = re.fullmatch(r"(base_arm|base|link|rotor)(\d*)_(.+)", internal)
    if drag := re.fullmatch(r"base_drag_(\d+)", internal):
        meaning = f"reaction torque of motor {drag[1]} per unit of thrust{value}"
        return name("kappa", drag[1], Kind.LENGTH, meaning)
    if match is None:
        raise ValueError(f"no name for the parameter {internal}")
    body, number, key = match.groups()
    arm = int(number or 1) + (rotors if body == "link" else 0)
    by_number = f"arm {arm}" if number else "every base arm"
    whose = whose or {"base": "the base", "rotor": f"rotor {arm}"}.get(body, by_number)
    # Of rotors and arms with one number, and of the base, which is none.
    own = {"base": "b", "rotor": f"F{arm}"}.get(body, str(arm))
    for pattern, letter, mark, further, meaning in _PARAMETERS:
        if found := re.fullmatch(pattern, key):
            index = ",".join(filter(None, [own, found.expand(further)]))
            kind = Kind.LENGTH if unit == "m" else Kind.INERTIA
            return name(letter, index, kind, meaning.format(whose) + value, mark)
    raise ValueError(f"no name for the parameter {internal}")


def hybrid_name(internal: str, meaning: str) -> Name:
    """Name of a hybrid unknown or an input, by its single index: θ_{-1}, d_7, x, τ'_k, F_k, τ_k."""
    if internal in _LINEAR:
        return name(internal, "", Kind.COORDINATE, meaning)
    if internal.startswith("tau_prime_"):
        return name("tau", internal.removeprefix("tau_prime_"), Kind.INPUT, meaning, prime=True)
    if internal[0] in _TWIST and internal[1:] in _LINEAR:
        return name(_TWIST[internal[0]], internal[1:], Kind.RATE, meaning)
    letter, number = internal.split("_")
    kind = Kind.INPUT if letter in ("F", "tau") else Kind.COORDINATE
    return name(letter, number.replace("m", "-"), kind, meaning)


def accelerated(unknown: Name) -> Name:
    """The unknown of a hybrid coordinate: two dots, one of a velocity, none of a torque."""
    if unknown.kind is Kind.INPUT:
        return unknown
    letter, separator, index = unknown.latex.partition("_")
    mark = "dot" if unknown.kind is Kind.RATE else "ddot"
    text = f"{unknown.text[0]}{_MARKS[mark]}{unknown.text[1:]}"
    return Name(
        f"\\{mark}{{{letter}}}{separator}{index}",
        unicodedata.normalize("NFC", text),
        Kind.ACCELERATION,
        unknown.meaning,
    )
