"""What pages in every format have in common: the order of things, broken lines, the legend."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence

import sympy as sp

from gibbs_codegen.equations.chain_equation import ChainEquation
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.forms import AT_REST, COLUMNS, FORMS, FRAMES, WHY_DEFINITIONS
from gibbs_codegen.equations.notation import Kind, Name
from gibbs_codegen.equations.typeset import LATEX, Dialect, Writer, filled
from gibbs_codegen.errors import UsageError

# A wider matrix does not fit a page; its entries are listed in any case.
WIDEST_MATRIX = 12
# So many symbols of one meaning are all named in the legend; of more, the first and the last.
_MOST_NAMED = 12

# Symbols and their meaning.
LegendEntry = tuple[list[str], str]


class Page(ABC):
    """A page in a format, for equations of one chain; what is private makes the lines of a part.

    Lines of equations are at most `width` letters wide.
    """

    dialect: Dialect
    width: int

    def __init__(self, equations: Sequence[ChainEquation]) -> None:
        if len({(equation.robot, equation.chain) for equation in equations}) != 1:
            raise UsageError("equations of one chain of one robot can be laid out together")
        self._equations = equations
        self._names: dict[sp.Symbol, Name] = {}
        for equation in equations:
            self._names |= equation.names
        self._writer = Writer(self._names, self.dialect)

    def document(self) -> str:
        """The equations, one after the other, and the legend."""
        lines = self._opening(f"{self._equations[0].robot}, chain {self._equations[0].chain}")
        for equation in self._equations:
            lines += self._heading(f"Equation {equation.number}: {equation.title}")
            lines += self._form(equation)
            if not equation.closed:
                rest = f" {AT_REST}" if equation.number == 15 else ""
                lines += self._remark(f"{WHY_DEFINITIONS}{rest}")
            if equation.lines:
                lines += self._definitions(equation.lines)
            if equation.places:
                lines += self._coupling(equation)
        text = "\n".join([*lines, *self._legend(self._legend_entries())])
        return text.replace("\n\n\n", "\n\n") + "\n"

    def _introduction(self) -> list[str]:
        """What the columns of eq. 15 are, and the table of frames."""
        lines = []
        if any(equation.number == 15 for equation in self._equations):
            lines += ["", *self._remark(COLUMNS)]
        if frames := next((e.frames for e in self._equations if e.frames), ()):
            rows = [["item", "joint", "gamma", "x", "y", "z", "alpha", "d", "theta"]]
            for item, row in enumerate(frames, start=4):
                rows.append([str(item), *map(self._writer.line, row)])
            lines += [*self._heading("Frames of the items"), *self._remark(FRAMES)]
            lines += self._table(rows)
        return lines

    @abstractmethod
    def _table(self, rows: list[list[str]]) -> list[str]: ...

    @abstractmethod
    def _opening(self, head: str) -> list[str]: ...

    @abstractmethod
    def _heading(self, title: str) -> list[str]: ...

    @abstractmethod
    def _form(self, equation: ChainEquation) -> list[str]:
        """The equation in the paper's own form."""

    @abstractmethod
    def _remark(self, text: str) -> list[str]: ...

    @abstractmethod
    def _definitions(self, definitions: Iterable[Definition]) -> list[str]: ...

    @abstractmethod
    def _coupling(self, equation: ChainEquation) -> list[str]:
        """The table of eq. 18."""

    @abstractmethod
    def _legend(self, entries: Iterable[LegendEntry]) -> list[str]: ...

    def _entry(self, entry: sp.Expr) -> str:
        """An entry of a matrix or a vector: a symbol or a number."""
        return self.dialect.symbol(self._names[entry]) if entry.is_Symbol else str(entry)

    def _broken(self, symbol: sp.Symbol, value: sp.Expr) -> tuple[str, list[tuple[int, str]]]:
        """The left side of a definition, and the right side in lines with their depths."""
        left = self.dialect.symbol(self._names[symbol])
        room = self.width - self.dialect.visible(left) - 3
        terms = [self._cut(term) for term in self._writer.terms(value)]
        return left, filled(terms, room, self.width - 8, self.dialect.visible)

    def _cut(self, term: list[str]) -> list[str]:
        """A term in pieces that fit on a line, where its own may be too long for that."""
        return term

    def _legend_entries(self) -> list[LegendEntry]:
        """Quantities, then sines and cosines, then symbols of the forms.

        Symbols of one meaning share an entry.
        """
        is_latex = self.dialect is LATEX
        grouped: dict[str, list[str]] = {}
        for entry in _explained(self._equations):
            grouped.setdefault(entry.meaning, []).append(self.dialect.symbol(entry))
        entries = [(symbols, meaning) for meaning, symbols in grouped.items()]
        for index, angle in sorted(self._writer.angles.items()):
            symbols = [f"{letter}{self.dialect.index(index)}" for letter in "sc"]
            written = self._writer.angle(angle)
            entries.append(
                (symbols, f"sine and cosine of {f'${written}$' if is_latex else written}")
            )
        if any(name.kind is Kind.STEP for name in self._names.values()):
            steps = [self.dialect.index(k) for k in "12"]
            meaning = "intermediate results, numbered anew in each equation"
            entries.append(([f"h{k}" for k in steps], meaning))
        known = {symbol for symbols, _ in entries for symbol in symbols}
        for latex, text, meaning in dict.fromkeys(_form_legend(self._equations)):
            symbol = latex if is_latex else text
            if symbol not in known:
                entries.append(([symbol], meaning))
        return [(_abridged(symbols), meaning) for symbols, meaning in entries]


def _abridged(symbols: list[str]) -> list[str]:
    if len(symbols) <= _MOST_NAMED:
        return symbols
    return [*symbols[:3], "…", *symbols[-3:]]


def _form_legend(equations: Sequence[ChainEquation]) -> list[tuple[str, str, str]]:
    """Symbols of the paper's own forms: LaTeX, text and meaning."""
    entries = []
    for equation in equations:
        for latex, text, meaning in FORMS[equation.number].legend:
            latex, text = filled_form(latex, equation), filled_form(text, equation)
            entries.append((latex, text, meaning))
        for index, place in zip(held_indices(equation), equation.held, strict=True):
            if equation.matrix:
                meaning = f"unit column with a 1 in row {place + 1}, for a constrained joint"
                entries.append((rf"\zeta_{{{index}}}", f"ζ_{{{index}}}", meaning))
    return entries


def filled_form(form: str, equation: ChainEquation) -> str:
    """A form of the paper with the number of the chain, and the unknowns of the robot.

    With a quaternion these are rates of velocities.
    """
    form = form.replace("@", str(equation.chain))
    return form.replace(r"\ddot{\theta}", r"\dot{v}").replace("θ̈", "v̇") if equation.quasi else form


def held_indices(equation: ChainEquation) -> list[str]:
    """Indices, such as "2,4", of a chain's constraint torques, by the items that are held."""
    return [equation.names[torque].index for torque in equation.torques]


def _explained(equations: Sequence[ChainEquation]) -> list[Name]:
    """Names to be explained, in order, each once: those that occur and mean something."""
    found: dict[Name, None] = {}
    for equation in equations:
        occurring = {*equation.accelerations, *equation.torques}
        occurring |= {symbol for row in equation.frames for e in row for symbol in e.free_symbols}
        for symbol, value in equation.lines:
            occurring |= {symbol} | value.free_symbols
        found |= dict.fromkeys(n for s, n in equation.names.items() if s in occurring)
        for place in equation.places:
            found |= {place.unknown: None, place.hybrid: None}
        found |= dict.fromkeys(n for pair in equation.inputs for n in pair)
    return [n for n in found if n.meaning]
