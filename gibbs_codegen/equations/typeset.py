"""Expressions in the symbols of the paper, in LaTeX or plain text, in pieces that fit on lines.

Products are written parameters first and accelerations last, sums by their accelerations, then
rates. Sines and cosines are written s and c with the index of their angle: c_{2,3+4} is
cos(θ_{2,3} + θ_{2,4}).

Within chain j quantities carry two indices, the chain and the item: θ_{j,1}, θ_{j,2}, θ_{j,3} are
θ₋₁, θ₀, θ₁, and θ_{j,4} is the constrained joint or the arm's first. Parameters carry the number of
their arm, hybrid unknowns the number of their row. Nothing here is parsed: names are looked up by
symbol, and a symbol that has no name, or a node that has no rule, is an error.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import sympy as sp


class Kind(IntEnum):
    """The kind of a symbol, in the order in which factors of a product are written."""

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
    """A symbol as it is written, and its meaning with the unit.

    `index` is the subscript, by which sines and cosines of the symbol are written.
    """

    latex: str
    text: str
    kind: Kind
    meaning: str
    index: str = ""


_SMALL = "GREEK SMALL LETTER "
_GREEK = {unicodedata.name(x).removeprefix(_SMALL).lower(): x for x in map(chr, range(945, 970))}
_MARKS = {"dot": "\u0307", "ddot": "\u0308", "bar": "\u0304"}


def name(
    letter: str, index: str, kind: Kind, meaning: str, mark: str = "", prime: bool = False
) -> Name:
    """Compose a name of a letter with a dot, ddot or bar above, an index and a prime.

    A letter with a digit, such as B_0, stands in parentheses if it has an index, which would look
    like part of the digit. The meaning is for the legend, with the unit.
    """
    greek = _GREEK.get(letter, letter)
    text = greek.replace("_", "") + _MARKS.get(mark, "")
    latex = f"\\{letter}" if letter in _GREEK else letter
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
# Letters of the angles of a base that does not move freely.
_TURNS = {"roll": "phi", "pitch": "theta", "yaw": "psi"}
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
    (r"rotor_inertia", "J", "", "r", "inertia of the rotor of the motor of {}"),
    (r"gear_ratio", "n", "", "", "gear ratio of the motor of {}"),
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
    # Rotors and arms share numbers; the base has none.
    body_index = {"base": "b", "rotor": f"F{arm}"}.get(body, str(arm))
    for pattern, letter, mark, further, meaning in _PARAMETERS:
        if parsed := re.fullmatch(pattern, key):
            index = ",".join(filter(None, [body_index, parsed.expand(further)]))
            kind = Kind.LENGTH if unit == "m" else Kind.INERTIA
            return name(letter, index, kind, meaning.format(whose) + value, mark)
    raise ValueError(f"no name for the parameter {internal}")


def hybrid_name(internal: str, meaning: str) -> Name:
    """Name of a hybrid unknown or an input, by its single index: θ_{-1}, d_7, x, τ'_k, F_k, τ_k."""
    if internal in (*_LINEAR, *_TURNS):
        return name(_TURNS.get(internal, internal), "", Kind.COORDINATE, meaning)
    if internal.startswith("tau_prime_"):
        return name("tau", internal.removeprefix("tau_prime_"), Kind.INPUT, meaning, prime=True)
    if internal[0] in _TWIST and internal[1:] in _LINEAR:
        return name(_TWIST[internal[0]], internal[1:], Kind.RATE, meaning)
    letter, number = internal.split("_")
    kind = Kind.INPUT if letter in ("F", "tau") else Kind.COORDINATE
    return name(letter, number.replace("m", "-"), kind, meaning)


def base_name(internal: str, chain: int, item: int) -> tuple[str, str]:
    """Letter and index in a chain of a coordinate by which a virtual link moves the base."""
    if internal in _LINEAR:
        return internal, str(chain)
    return _TURNS.get(internal, "theta"), f"{chain},{item}"


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


Names = Mapping[sp.Symbol, Name]

# Parts of π that are written as such, down to a hundredth of a degree.
_FINEST = 18000
_GROUPED = (Kind.ACCELERATION, Kind.RATE, Kind.INPUT)
_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Dialect:
    """The notation of symbols, numbers and powers."""

    symbol: Callable[[Name], str]
    index: Callable[[str], str]
    fraction: Callable[[int, int], str]
    root: Callable[[str], str]
    power: Callable[[str, int], str]
    times: str
    opening: str
    closing: str
    pi: str
    visible: Callable[[str], int]
    ten: Callable[[int], str]
    degree: str


def _latex_width(text: str) -> int:
    """About as many letters as are seen; subscripts are small."""
    text = re.sub(r"_\{((?:[^{}]|\{[^{}]*\})*)\}", lambda m: m[1][: (len(m[1]) + 1) // 2], text)
    return len(re.sub(r"\\[a-zA-Z]+ ?|[{}^_\\ ]", "", text)) + text.count(r"\tfrac")


def text_width(text: str) -> int:
    """Width of plain text: as many letters as are seen, since dots above take no room."""
    return sum(not unicodedata.combining(letter) for letter in text)


LATEX = Dialect(
    symbol=lambda name: name.latex,
    index=latex_index,
    fraction=lambda p, q: f"\\tfrac{{{p}}}{{{q}}}",
    root=lambda radicand: f"\\sqrt{{{radicand}}}",
    power=lambda base, exponent: f"{base}^{{{exponent}}}",
    times=" ",
    opening=r"\bigl(",
    closing=r"\bigr)",
    pi=r"\pi",
    visible=_latex_width,
    ten=lambda exponent: rf" \cdot 10^{{{exponent}}}",
    degree=r"^{\circ}",
)
TEXT = Dialect(
    symbol=lambda name: name.text,
    index=text_index,
    fraction=lambda p, q: f"{p}/{q}",
    root=lambda radicand: f"√{radicand}",
    power=lambda base, exponent: base + str(exponent).translate(_SUPERSCRIPTS),
    times="·",
    opening="(",
    closing=")",
    pi="π",
    visible=text_width,
    ten=lambda exponent: f"e{exponent}",
    degree="°",
)


class Writer:
    """Writes expressions in the names of their symbols; `angles` are those it wrote s and c of."""

    def __init__(self, names: Names, dialect: Dialect) -> None:
        self._names = names
        self._dialect = dialect
        self._places = {symbol: place for place, symbol in enumerate(names)}
        self.angles: dict[str, sp.Expr] = {}

    def line(self, expression: sp.Expr) -> str:
        """An expression on one line."""
        return " ".join(self.pieces(expression))

    def pieces(self, expression: sp.Expr) -> list[str]:
        """An expression cut where a line may end; pieces after the first begin with a sign."""
        return [piece for term in self.terms(expression) for piece in term]

    def terms(self, expression: sp.Expr) -> list[list[str]]:
        """Terms of an expression in order, each cut where a line may end within it."""
        terms: list[list[str]] = []
        for term in sorted(sp.Add.make_args(expression), key=self._term_key):
            number, factors = _number_and_factors(term)
            if number.is_negative:
                number, sign = -number, "- " if terms else "-"
            else:
                sign = "+ " if terms else ""
            first, *rest = self._product(number, factors)
            terms.append([sign + first, *rest])
        return terms

    def _product(self, number: sp.Expr, factors: Sequence[sp.Expr]) -> list[str]:
        """A positive number times factors, cut within sums."""
        dialect = self._dialect
        pieces = [] if number == 1 and factors else [self._number(number)]
        for factor in sorted(factors, key=self._factor_key):
            base, exponent = factor.as_base_exp()
            if base.is_Add:
                inner = self.pieces(base)
                inner[0] = dialect.opening + inner[0]
                inner[-1] = self._raised(inner[-1] + dialect.closing, exponent)
            elif base.is_Integer:
                inner = [dialect.root(str(base))]
                exponent = 2 * exponent
            elif base.is_Symbol:
                inner = [self._raised(dialect.symbol(self._names[base]), exponent)]
            else:
                letter = "s" if isinstance(base, sp.sin) else "c"
                index = self.angle_index(base.args[0])
                self.angles[index] = base.args[0]
                inner = [self._raised(letter + dialect.index(index), exponent)]
            if pieces:
                pieces[-1] = f"{pieces[-1]}{dialect.times}{inner[0]}"
                pieces += inner[1:]
            else:
                pieces = inner
        return pieces

    def _raised(self, base: str, exponent: sp.Expr) -> str:
        if exponent == 1:
            return base
        if not exponent.is_Integer or exponent < 0:
            raise TypeError(f"no way to write the power {exponent} of {base}")
        return self._dialect.power(base, int(exponent))

    def _number(self, number: sp.Expr) -> str:
        if number.is_Integer:
            return str(number)
        if number.is_Rational:
            return self._dialect.fraction(number.p, number.q)
        if number.is_Float:  # A power of ten follows where it is very large or small.
            digits, _, exponent = f"{float(number):.6g}".partition("e")
            return f"{digits}{self._dialect.ten(int(exponent))}" if exponent else digits
        raise TypeError(f"no way to write the number {number}")

    def angle_index(self, angle: sp.Expr) -> str:
        """The index of s and c; that of a sum of angles as j,3+4, a fixed part in degrees."""
        fixed, moving = angle.as_independent(*angle.free_symbols, as_Add=True)
        symbols = sp.Add.make_args(moving) if moving != 0 else ()
        indices = [self._names[s].index for s in sorted(symbols, key=self._places.__getitem__)]
        first, *others = indices or [""]
        text = "+".join([first, *(index.split(",")[-1] for index in others)])
        if fixed != 0:
            degrees = f"{float(sp.N(fixed * 180 / sp.pi)):.6g}°"
            plus = "" if not text or degrees.startswith("-") else "+"
            text += plus + degrees
        return text

    def angle(self, angle: sp.Expr) -> str:
        """An angle itself, for a legend: a sum, with the fixed part as a multiple of π."""
        fixed, symbols = angle.as_independent(*angle.free_symbols, as_Add=True)
        ordered = sorted(sp.Add.make_args(symbols), key=lambda s: self._places.get(s, 0))
        parts = [self._dialect.symbol(self._names[s]) for s in ordered if s.is_Symbol]
        if fixed != 0:
            turn = sp.Rational(fixed / sp.pi)
            if turn.q > _FINEST:
                degrees = f"{float(turn * 180):.10g}"
                return " + ".join([*parts, degrees + self._dialect.degree]).replace("+ -", "- ")
            sign = "-" if turn < 0 else ""
            over = f"/{turn.q}" if turn.q != 1 else ""
            times = "" if abs(turn.p) == 1 else str(abs(turn.p))
            parts.append(f"{sign}{times}{self._dialect.pi}{over}")
        return " + ".join(parts).replace("+ -", "- ")

    def _factor_key(self, factor: sp.Expr) -> tuple[int, int, str]:
        base = factor.as_base_exp()[0]
        if base.is_Symbol:
            return (self._names[base].kind, self._places[base], "")
        if base.is_Add:
            return (Kind.SUM, 0, str(sp.default_sort_key(base)))
        if base.is_Integer:
            return (-1, int(base), "")
        if not isinstance(base, (sp.sin, sp.cos)):
            raise TypeError(f"no way to write {type(base).__name__}: {base}")
        index = self.angle_index(base.args[0])
        return (Kind.SINE_OR_COSINE, len(index), f"{index} {base.func.__name__}")

    def _term_key(self, term: sp.Expr) -> tuple[object, ...]:
        """Quadratic terms before linear ones, each by their accelerations, then rates, inputs."""
        _, factors = _number_and_factors(term)
        key: list[object] = []
        grouped: set[sp.Expr] = set()
        for kind in _GROUPED:
            places: list[int] = []
            for factor in factors:
                base, exponent = factor.as_base_exp()
                if base.is_Symbol and self._names[base].kind is kind:
                    places += [self._places[base]] * int(exponent)
                    grouped.add(factor)
            key += [-len(places), sorted(places)]
        rest = sorted(self._factor_key(f) for f in factors if f not in grouped)
        return (*key, len(rest), rest)


def _number_and_factors(term: sp.Expr) -> tuple[sp.Expr, tuple[sp.Expr, ...]]:
    """The number of a term, exact or not, and its other factors."""
    number, rest = term.as_coeff_Mul()
    return number, () if rest == 1 else sp.Mul.make_args(rest)


def filled(
    terms: Sequence[Sequence[str]], first: int, width: int, visible: Callable[[str], int]
) -> list[tuple[int, str]]:
    """Put terms, each in pieces, on lines of a width, of which the first has room for `first`.

    Terms that are longer than a line, and what follows them, begin lines of their own; within a
    piece no line ends. `visible` tells how many letters of a text are seen. A line comes with its
    depth: 0 if it begins a term, 1 if it goes on within one.
    """
    lines: list[tuple[int, str]] = []
    room, broken = first, False
    for term in terms:
        whole = " ".join(term)
        length = visible(whole)
        if not lines or broken or length + 1 > room:
            lines.append((0, ""))
            room = width if len(lines) > 1 else first
        broken = length > room
        for piece in term if broken else [whole]:
            size = visible(piece) + 1
            depth, text = lines[-1]
            if text and size > room:
                lines.append((1, piece))
                room = width - size
            else:
                lines[-1] = (depth, f"{text} {piece}".strip())
                room -= size
    return lines
