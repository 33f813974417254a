"""Equations of a chain laid out: as text, as LaTeX for amsmath, as Markdown for notebooks.

Sums are broken before their signs, so that nothing is wider than a page, and each symbol is
explained once, in the legend at the end.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable, Sequence

import sympy as sp

from gibbs_codegen.equations.chain_equation import ChainEquation
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.forms import (
    AT_REST,
    FORMS,
    WHY_DEFINITIONS,
    motion_latex,
    motion_text,
    padded,
)
from gibbs_codegen.equations.notation import Kind, Name
from gibbs_codegen.equations.typeset import LATEX, TEXT, Dialect, Writer, filled, text_width
from gibbs_codegen.errors import UsageError

# So many symbols of one meaning are all named in the legend; of more, the first and the last.
_MOST_NAMED = 12
# The matrices of eq. 15 need the one; wider than the other lines are hard to read.
LEAST_WIDTH, MOST_WIDTH = 80, 100


def as_text(*equations: ChainEquation, width: int = LEAST_WIDTH) -> str:
    """Equations of one chain as plain text, at most `width` letters wide, with a legend."""
    return _document(equations, lambda names: _TextPage(names, width))


def as_latex(*equations: ChainEquation) -> str:
    """Equations of one chain as LaTeX to paste into a document with amsmath, with a legend."""
    return _document(equations, _LatexPage)


def as_markdown(*equations: ChainEquation) -> str:
    """Equations of one chain as Markdown with MathJax, for notebooks, with a legend."""
    return _document(equations, _MarkdownPage)


def _document(
    equations: Sequence[ChainEquation], page_of: Callable[[dict[sp.Symbol, Name]], _Page]
) -> str:
    if len({(equation.robot, equation.chain) for equation in equations}) != 1:
        raise UsageError("equations of one chain of one robot can be laid out together")
    names: dict[sp.Symbol, Name] = {}
    for equation in equations:
        names |= equation.names
    page = page_of(names)
    for equation in equations:
        page.heading(f"Equation {equation.number}: {equation.title}")
        page.form(equation)
        if not equation.closed:
            rest = f" {AT_REST}" if equation.number == 15 else ""
            page.remark(f"{WHY_DEFINITIONS}{rest}")
        if equation.lines:
            page.lines(equation.lines)
        if equation.places:
            page.coupling(equation)
    page.legend(_explained(equations), _form_legend(equations))
    head = f"{equations[0].robot}, chain {equations[0].chain}"
    return "\n".join([*page.opening(head), *page.written]) + "\n"


def _form_legend(equations: Sequence[ChainEquation]) -> list[tuple[str, str, str]]:
    """Symbols of the paper's own forms: LaTeX, text and meaning."""
    entries = []
    for equation in equations:
        chain = str(equation.chain)
        for latex, text, meaning in FORMS[equation.number].legend:
            if equation.torque is None and "zeta" in latex:
                continue
            entries.append((latex.replace("@", chain), text.replace("@", chain), meaning))
    return entries


def _explained(equations: Sequence[ChainEquation]) -> list[Name]:
    """Names to be explained, in order, each once: those that occur and mean something."""
    found: dict[Name, None] = {}
    for equation in equations:
        occurring = set(equation.accelerations) | {equation.torque}
        for symbol, value in equation.lines:
            occurring |= {symbol} | value.free_symbols
        found |= dict.fromkeys(n for s, n in equation.names.items() if s in occurring)
        for place in equation.places:
            found |= {place.unknown: None, place.hybrid: None}
        found |= dict.fromkeys(n for pair in equation.inputs for n in pair)
    return [n for n in found if n.meaning]


class _Page:
    """What is written so far, line by line, in a dialect."""

    dialect: Dialect
    width: int

    def __init__(self, names: dict[sp.Symbol, Name]) -> None:
        self.names = names
        self.writer = Writer(names, self.dialect)
        self.written: list[str] = []

    def opening(self, head: str) -> list[str]:
        raise NotImplementedError

    def heading(self, title: str) -> None:
        raise NotImplementedError

    def form(self, equation: ChainEquation) -> None:
        """The equation in the paper's own form."""
        raise NotImplementedError

    def remark(self, text: str) -> None:
        raise NotImplementedError

    def lines(self, lines: Iterable[Definition]) -> None:
        raise NotImplementedError

    def coupling(self, equation: ChainEquation) -> None:
        """The table of eq. 18."""
        raise NotImplementedError

    def legend(self, names: Sequence[Name], more: Sequence[tuple[str, str, str]]) -> None:
        raise NotImplementedError

    def filled(self, symbol: sp.Symbol, value: sp.Expr) -> tuple[str, list[tuple[int, str]]]:
        """Left side of a definition, and its right side in lines with their depths."""
        left = self.dialect.symbol(self.names[symbol])
        room = self.width - self.dialect.visible(left) - 3
        terms = [self.cut(term) for term in self.writer.terms(value)]
        return left, filled(terms, room, self.width - 8, self.dialect.visible)

    def cut(self, term: list[str]) -> list[str]:
        """A term in pieces that fit on a line, where its own may be too long for that."""
        return term

    def entries(
        self, names: Sequence[Name], more: Sequence[tuple[str, str, str]]
    ) -> list[tuple[list[str], str]]:
        """Symbols and their meaning: quantities, then sines and cosines, then those of the forms.

        Symbols of one meaning share an entry.
        """
        is_latex = self.dialect is LATEX
        grouped: dict[str, list[str]] = {}
        for entry in names:
            grouped.setdefault(entry.meaning, []).append(self.dialect.symbol(entry))
        entries = [(symbols, meaning) for meaning, symbols in grouped.items()]
        for index, angle in sorted(self.writer.angles.items()):
            symbols = [f"{letter}{self.dialect.index(index)}" for letter in "sc"]
            written = self.writer.angle(angle)
            entries.append(
                (symbols, f"sine and cosine of {f'${written}$' if is_latex else written}")
            )
        if any(name.kind is Kind.STEP for name in self.names.values()):
            steps = [self.dialect.index(k) for k in "12"]
            meaning = "intermediate results, numbered anew in each equation"
            entries.append(([f"h{k}" for k in steps], meaning))
        known = {symbol for symbols, _ in entries for symbol in symbols}
        for latex, text, meaning in dict.fromkeys(more):
            symbol = latex if is_latex else text
            if symbol not in known:
                entries.append(([symbol], meaning))
        return [(_abridged(symbols), meaning) for symbols, meaning in entries]


class _TextPage(_Page):
    dialect = TEXT

    def __init__(self, names: dict[sp.Symbol, Name], width: int) -> None:
        super().__init__(names)
        self.width = width

    def cut(self, term: list[str]) -> list[str]:
        """Products that are too long are cut before a multiplication sign."""
        pieces = []
        for piece in term:
            first, *factors = piece.split(TEXT.times)
            pieces.append(first)
            for factor in (TEXT.times + factor for factor in factors):
                if text_width(pieces[-1] + factor) <= self.width - 9:
                    pieces[-1] += factor
                else:
                    pieces.append(factor)
        return pieces

    def opening(self, head: str) -> list[str]:
        return [head]

    def heading(self, title: str) -> None:
        self.written += ["", title, "-" * len(title)]

    def form(self, equation: ChainEquation) -> None:
        if equation.number == 15:
            self.written += motion_text(equation)
        else:
            self.written += (
                FORMS[equation.number].text.replace("@", str(equation.chain)).split("\n")
            )
        self.written.append("")

    def remark(self, text: str) -> None:
        self.written += [*textwrap.wrap(text, self.width), ""]

    def lines(self, lines: Iterable[Definition]) -> None:
        for symbol, value in lines:
            left, ((_, first), *rest) = self.filled(symbol, value)
            self.written.append(f"{left} = {first}")
            self.written += [f"{' ' * (4 + 4 * depth)}{line}" for depth, line in rest]

    def coupling(self, equation: ChainEquation) -> None:
        rows = [("item", "in the chain", "in the hybrid system", "row")]
        rows += [(str(p.item), p.unknown.text, p.hybrid.text, str(p.row)) for p in equation.places]
        rows += [("", own.text, hybrid.text, "") for own, hybrid in equation.inputs]
        self.written += [
            f"{a:<6}{padded(b, 16)}{padded(c, 22)}{d:>3}".rstrip() for a, b, c, d in rows
        ]

    def legend(self, names: Sequence[Name], more: Sequence[tuple[str, str, str]]) -> None:
        self.written += ["", "Symbols", "-------"]
        for symbols, meaning in self.entries(names, more):
            text = re.sub(r"B_(\d)", r"B\1", f"{', '.join(symbols)}: {meaning}")
            self.written += textwrap.wrap(
                text,
                self.width,
                subsequent_indent="    ",
                break_long_words=False,
                break_on_hyphens=False,
            )


class _LatexPage(_Page):
    dialect = LATEX
    width = 66

    def opening(self, head: str) -> list[str]:
        return [
            f"% {head}. Needs \\usepackage{{amsmath}}; long displays want \\allowdisplaybreaks."
        ]

    def heading(self, title: str) -> None:
        self.written.append(f"\\paragraph{{{title}.}}")

    def display(self, rows: Iterable[str]) -> None:
        """Rows of an aligned display."""
        self.written += [r"\begin{align*}", " \\\\\n".join(rows), r"\end{align*}"]

    def form(self, equation: ChainEquation) -> None:
        if equation.number == 15:
            self.display(motion_latex(equation))
        else:
            self.display([FORMS[equation.number].latex.replace("@", str(equation.chain))])

    def remark(self, text: str) -> None:
        self.written += textwrap.wrap(text, 100)

    def lines(self, lines: Iterable[Definition]) -> None:
        rows = []
        for symbol, value in lines:
            left, ((_, first), *rest) = self.filled(symbol, value)
            rows.append(f"{left} &= {first}")
            rows += [f"&\\q{'q' * depth}uad {{}}{line}" for depth, line in rest]
        self.display(rows)

    def coupling(self, equation: ChainEquation) -> None:
        rows = [r"\text{item} & \text{in the chain} & \text{in the hybrid system} & \text{row}"]
        rows += [
            f"{p.item} & {p.unknown.latex} & {p.hybrid.latex} & {p.row}" for p in equation.places
        ]
        rows += [f" & {own.latex} & {hybrid.latex} & " for own, hybrid in equation.inputs]
        body = " \\\\\n".join(rows)
        self.display([f"\\begin{{array}}{{cccc}}\n{body}\n\\end{{array}}"])

    def legend(self, names: Sequence[Name], more: Sequence[tuple[str, str, str]]) -> None:
        self.written.append(r"\paragraph{Symbols.}")
        entries = [self.entry(*entry) for entry in self.entries(names, more)]
        self.written.append(";\n".join(entries) + ".")

    def entry(self, symbols: Sequence[str], meaning: str) -> str:
        """Symbols and their meaning as running text."""
        set_in = ", ".join(f"${symbol}$" if symbol != "…" else r"\dots" for symbol in symbols)
        return f"{set_in}: {_escaped(meaning)}"


class _MarkdownPage(_LatexPage):
    def opening(self, head: str) -> list[str]:
        return []

    def heading(self, title: str) -> None:
        self.written += [f"**{title}**", ""]

    def display(self, rows: Iterable[str]) -> None:
        body = " \\\\\n".join(rows)
        self.written += ["$$", r"\begin{aligned}", body, r"\end{aligned}", "$$", ""]

    def remark(self, text: str) -> None:
        self.written += [text, ""]

    def legend(self, names: Sequence[Name], more: Sequence[tuple[str, str, str]]) -> None:
        self.written += ["**Symbols**", ""]
        self.written += [f"- {self.entry(*entry)}" for entry in self.entries(names, more)]


def _abridged(symbols: list[str]) -> list[str]:
    if len(symbols) <= _MOST_NAMED:
        return symbols
    return [*symbols[:3], "…", *symbols[-3:]]


def _escaped(meaning: str) -> str:
    """Plain words with a few symbols as LaTeX text; formulas stand between dollars already."""
    parts = meaning.split("$")
    for i in range(0, len(parts), 2):
        text = re.sub(r"\b([A-Z]_\d)(?: \+ ([A-Z]_\d))?", lambda m: f"${m[0]}$", parts[i])
        parts[i] = text.replace("²", "$^2$").replace("°", r"$^{\circ}$").replace("−", "$-$")
    return "".join(p if i % 2 == 0 else f"${p}$" for i, p in enumerate(parts))
