"""Equations of a chain laid out: as text, as LaTeX for amsmath, as Markdown for notebooks.

All have the same order of things. Sums are broken before their signs, so that nothing is wider than
a page, and each symbol is explained once, in the legend at the end.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

import sympy as sp

from gibbs_codegen.equations import typeset
from gibbs_codegen.equations.chain_equations import ChainEquation
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.show import AT_REST, COLUMNS, FORMS, FRAMES, WHY_DEFINITIONS
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.line_breaks import broken

# A wider matrix does not fit a page; its entries are listed in any case.
WIDEST_MATRIX = 12
# So many symbols of one meaning are all named in the legend; of more, the first and the last.
_MOST_NAMED = 12

# Symbols and their meaning.
LegendEntry = tuple[list[str], str]


class Page:
    """A page of plain text for equations of one chain, at most `width` letters wide.

    What is private makes the lines of a part; other formats have their own.
    """

    dialect = typeset.TEXT
    between = "\n\n"  # What parts of the page are joined by.
    opening = "{}"  # What comes first, with the robot and the chain; without it no introduction.

    def __init__(self, equations: Sequence[ChainEquation], width: int) -> None:
        if len({(equation.robot, equation.chain) for equation in equations}) != 1:
            raise UsageError("equations of one chain of one robot can be laid out together")
        self._equations, self.width = equations, width
        self._names: dict[sp.Symbol, typeset.Name] = {}
        for equation in equations:
            self._names |= equation.names
        self._writer = typeset.Writer(self._names, self.dialect)
        self.is_latex = self.dialect is typeset.LATEX

    def document(self) -> str:
        """The equations, one after the other, and the legend."""
        blocks = []
        if self.opening:
            head = f"{self._equations[0].robot}, chain {self._equations[0].chain}"
            blocks.append([self.opening.format(head)])
            if any(equation.number == 15 for equation in self._equations):
                blocks.append(self._remark(COLUMNS))
            if frames := next((e.frames for e in self._equations if e.frames), ()):
                rows = [["item", "joint", "gamma", "x", "y", "z", "alpha", "d", "theta"]]
                rows += [[*map(self._writer.line, row)] for row in frames]
                blocks.append([*self._heading("Frames of the items"), *self._remark(FRAMES)])
                blocks.append(self._table(rows))
        for equation in self._equations:
            title = f"Equation {equation.number}: {equation.title}"
            if equation.number == 15:
                form = self._motion(equation)
            else:  # The paper's own.
                shape = FORMS[equation.number]
                form = [filled_form(shape.latex if self.is_latex else shape.text, equation)]
            blocks.append([*self._heading(title), *self._display(form)])
            if not equation.closed:
                rest = f" {AT_REST}" if equation.number == 15 else ""
                blocks.append(self._remark(f"{WHY_DEFINITIONS}{rest}"))
            if equation.lines:
                blocks.append(self._definitions(equation.lines))
            if equation.places:
                rows = [["item", "in the chain", "in the hybrid system", "row"]]
                for place in equation.places:
                    pair = map(self.dialect.symbol, (place.unknown, place.hybrid))
                    rows.append([str(place.item), *pair, str(place.row)])
                rows += [["", *map(self.dialect.symbol, pair), ""] for pair in equation.inputs]
                blocks.append(self._coupling(rows))
        blocks.append([*self._heading("Symbols"), *self._legend(self._legend_entries())])
        return self.between.join("\n".join(block) for block in blocks) + "\n"

    def _table(self, rows: list[list[str]]) -> list[str]:
        widths = [max(map(typeset.text_width, column)) + 2 for column in zip(*rows, strict=True)]
        return ["".join(map(_padded, row, widths)).rstrip() for row in rows]

    def _heading(self, title: str) -> list[str]:
        return [title, "-" * len(title)]

    def _display(self, rows: Iterable[str]) -> list[str]:
        return [*rows]

    def _motion(self, equation: ChainEquation) -> list[str]:
        """Eq. 15 in blocks and, where that fits a page, entry by entry."""
        zetas = [f"ζ_{{{index}}}" for index in held_indices(equation)]
        pairs = zip(zetas, equation.torques, strict=True)
        torques = [f" - {zeta}·{self._entry(torque)}" for zeta, torque in pairs]
        lines = [f"I_@·θ̈_@{''.join(torques)} = R_@ + F_@", *(f"{z}ᵀ·θ̈_@ = 0" for z in zetas)]
        lines = [filled_form(line, equation) for line in lines]
        matrix, *vectors = equation.bordered
        if len(matrix) > WIDEST_MATRIX:
            return lines
        columns = [[self._entry(entry) for entry in vector] for vector in vectors]
        for row, unknown, residual, force in zip(matrix, *columns, strict=True):
            cells = " ".join(f"{str(e) if e.is_Number else 'I':>2}" for e in row)
            lines.append(
                f"[{cells} ] {{ {_padded(unknown, 10)} }} = {{ {residual:<8} }} + {{ {force:<8} }}"
            )
        return lines

    def _remark(self, text: str) -> list[str]:
        return textwrap.wrap(text, self.width)

    def _definitions(self, definitions: Iterable[Definition]) -> list[str]:
        lines = []
        for symbol, value in definitions:
            left = self.dialect.symbol(self._names[symbol])
            room = self.width - self.dialect.visible(left) - 3
            terms = self._writer.terms(value)
            if not self.is_latex:
                terms = [self._cut(term) for term in terms]
            (_, first), *rest = typeset.filled(terms, room, self.width - 8, self.dialect.visible)
            lines.append(f"{left} {'&=' if self.is_latex else '='} {first}")
            for depth, line in rest:
                indent = f"&\\q{'q' * depth}uad {{}}" if self.is_latex else " " * (4 + 4 * depth)
                lines.append(f"{indent}{line}")
        return self._display(lines)

    def _coupling(self, rows: list[list[str]]) -> list[str]:
        return [f"{a:<6}{_padded(b, 16)}{_padded(c, 22)}{d:>3}".rstrip() for a, b, c, d in rows]

    def _legend(self, entries: Iterable[LegendEntry]) -> list[str]:
        lines = []
        for symbols, meaning in entries:
            text = re.sub(r"B_(\d)", r"B\1", f"{', '.join(symbols)}: {meaning}")
            lines += broken(text, self.width)
        return lines

    def _entry(self, entry: sp.Expr) -> str:
        """An entry of a matrix or a vector: a symbol or a number."""
        return self.dialect.symbol(self._names[entry]) if entry.is_Symbol else str(entry)

    def _cut(self, term: list[str]) -> list[str]:
        """A term in pieces that fit on a line: long products are cut before a sign of these."""
        pieces = []
        for piece in term:
            first, *factors = piece.split(typeset.TEXT.times)
            pieces.append(first)
            for factor in (typeset.TEXT.times + factor for factor in factors):
                if typeset.text_width(pieces[-1] + factor) <= self.width - 9:
                    pieces[-1] += factor
                else:
                    pieces.append(factor)
        return pieces

    def _legend_entries(self) -> list[LegendEntry]:
        """Quantities, then sines and cosines, then symbols of the forms.

        Symbols of one meaning share an entry.
        """
        grouped: dict[str, list[str]] = {}
        for entry in _explained(self._equations):
            grouped.setdefault(entry.meaning, []).append(self.dialect.symbol(entry))
        entries = [(symbols, meaning) for meaning, symbols in grouped.items()]
        for index, angle in sorted(self._writer.angles.items()):
            symbols = [f"{letter}{self.dialect.index(index)}" for letter in "sc"]
            written = self._writer.angle(angle)
            written = f"${written}$" if self.is_latex else written
            entries.append((symbols, f"sine and cosine of {written}"))
        if any(name.kind is typeset.Kind.STEP for name in self._names.values()):
            steps = [self.dialect.index(k) for k in "12"]
            meaning = "intermediate results, numbered anew in each equation"
            entries.append(([f"h{k}" for k in steps], meaning))
        listed = {symbol for symbols, _ in entries for symbol in symbols}
        forms = []
        for equation in self._equations:
            forms += [
                (filled_form(latex, equation), filled_form(text, equation), meaning)
                for latex, text, meaning in FORMS[equation.number].legend
            ]
            for index, place in zip(held_indices(equation), equation.held, strict=True):
                if equation.matrix:
                    meaning = f"unit column with a 1 in row {place + 1}, for a constrained joint"
                    forms.append((rf"\zeta_{{{index}}}", f"ζ_{{{index}}}", meaning))
        for latex, text, meaning in dict.fromkeys(forms):
            symbol = latex if self.is_latex else text
            if symbol not in listed:
                entries.append(([symbol], meaning))
        return [
            (
                symbols if len(symbols) <= _MOST_NAMED else [*symbols[:3], "…", *symbols[-3:]],
                meaning,
            )
            for symbols, meaning in entries
        ]


def filled_form(form: str, equation: ChainEquation) -> str:
    """A form of the paper with the number of the chain, and the unknowns of the robot.

    With a quaternion these are rates of velocities.
    """
    form = form.replace("@", str(equation.chain))
    return form.replace(r"\ddot{\theta}", r"\dot{v}").replace("θ̈", "v̇") if equation.quasi else form


def held_indices(equation: ChainEquation) -> list[str]:
    """Indices, such as "2,4", of a chain's constraint torques, by the items that are held."""
    return [equation.names[torque].index for torque in equation.torques]


def _explained(equations: Sequence[ChainEquation]) -> list[typeset.Name]:
    """Names to be explained, in order, each once: those that occur and mean something."""
    names: dict[typeset.Name, None] = {}
    for equation in equations:
        occurring = {*equation.accelerations, *equation.torques}
        occurring |= {symbol for row in equation.frames for e in row for symbol in e.free_symbols}
        for symbol, value in equation.lines:
            occurring |= {symbol} | value.free_symbols
        names |= dict.fromkeys(n for s, n in equation.names.items() if s in occurring)
        for place in equation.places:
            names |= {place.unknown: None, place.hybrid: None}
        names |= dict.fromkeys(n for pair in equation.inputs for n in pair)
    return [n for n in names if n.meaning]


class LatexPage(Page):
    """A page in LaTeX."""

    dialect = typeset.LATEX
    between = "\n"  # A display after a blank line would begin a paragraph.
    opening = "% {}. Needs \\usepackage{{amsmath}}; long displays want \\allowdisplaybreaks."

    def _coupling(self, rows: list[list[str]]) -> list[str]:
        return self._table(rows)

    def _table(self, rows: list[list[str]]) -> list[str]:
        heads = [rf"\text{{{head}}}" for head in rows[0]]
        body = " \\\\\n".join(" & ".join(row) for row in (heads, *rows[1:]))
        return self._display([f"\\begin{{array}}{{{'c' * len(heads)}}}\n{body}\n\\end{{array}}"])

    def _heading(self, title: str) -> list[str]:
        return [f"\\paragraph{{{title}.}}"]

    def _display(self, rows: Iterable[str]) -> list[str]:
        """An aligned display."""
        return [r"\begin{align*}", " \\\\\n".join(rows), r"\end{align*}"]

    def _motion(self, equation: ChainEquation) -> list[str]:
        """Eq. 15 in blocks and, where that fits a page, entry by entry."""
        rows = [r"I_{@} \ddot{\theta}_{@} &= R_{@} + F_{@}"]
        if equation.torques:
            zetas = [rf"\zeta_{{{index}}}" for index in held_indices(equation)]
            columns = "".join(f" & -{zeta}" for zeta in zetas)
            below = "".join(rf" \\ {zeta}^T" + " & 0" * len(zetas) for zeta in zetas)
            torques = "".join(rf" \\ {self._entry(torque)}" for torque in equation.torques)
            zero = r" \\ 0" * len(zetas)
            rows = [
                rf"\begin{{bmatrix}} I_{{@}}{columns}{below} \end{{bmatrix}}" + "\n"
                rf"\begin{{Bmatrix}} \ddot{{\theta}}_{{@}}{torques} \end{{Bmatrix}} &=" + "\n"
                rf"\begin{{Bmatrix}} R_{{@}}{zero} \end{{Bmatrix}} +" + "\n"
                rf"\begin{{Bmatrix}} F_{{@}}{zero} \end{{Bmatrix}}"
            ]
        rows = [filled_form(row, equation) for row in rows]
        matrix, *vectors = equation.bordered
        if len(matrix) > WIDEST_MATRIX:
            return rows
        lines = [" & ".join(map(self._entry, row)) for row in matrix]
        border = "c" * len(equation.torques)
        columns = "c" * len(equation.residual) + (f"|{border}" if border else "")
        if border:
            lines[len(equation.residual)] = f"\\hline {lines[len(equation.residual)]}"
        body = " \\\\\n".join(lines)
        unknowns, residual, forces = (
            "\\begin{Bmatrix} " + " \\\\ ".join(map(self._entry, vector)) + " \\end{Bmatrix}"
            for vector in vectors
        )
        array = f"\\left[\\begin{{array}}{{{columns}}}\n{body}\n\\end{{array}}\\right]"
        return [*rows, f"&{array}\n{unknowns}", f"&\\quad = {residual} + {forces}"]

    def _remark(self, text: str) -> list[str]:
        return textwrap.wrap(text, 100)

    def _legend(self, entries: Iterable[LegendEntry]) -> list[str]:
        return [";\n".join(_explanations(entries)) + "."]


class MarkdownPage(LatexPage):
    """A page in Markdown with MathJax."""

    between = Page.between
    opening = ""

    def _heading(self, title: str) -> list[str]:
        return [f"**{title}**", ""]

    def _display(self, rows: Iterable[str]) -> list[str]:
        body = " \\\\\n".join(rows)
        return ["$$", r"\begin{aligned}", body, r"\end{aligned}", "$$"]

    def _remark(self, text: str) -> list[str]:
        return [text]

    def _legend(self, entries: Iterable[LegendEntry]) -> list[str]:
        return [f"- {text}" for text in _explanations(entries)]


def _explanations(entries: Iterable[LegendEntry]) -> list[str]:
    """Entries of the legend as running text."""
    texts = []
    for symbols, meaning in entries:
        written = ", ".join(f"${symbol}$" if symbol != "…" else r"\dots" for symbol in symbols)
        # Plain words with a few symbols; formulas stand between dollars already.
        parts = meaning.split("$")
        for i in range(0, len(parts), 2):
            text = re.sub(r"\b([A-Z]_\d)(?: \+ ([A-Z]_\d))?", lambda m: f"${m[0]}$", parts[i])
            parts[i] = text.replace("²", "$^2$").replace("°", r"$^{\circ}$").replace("−", "$-$")
        escaped = "".join(p if i % 2 == 0 else f"${p}$" for i, p in enumerate(parts))
        texts.append(f"{written}: {escaped}")
    return texts


def _padded(text: str, width: int) -> str:
    """Text filled with spaces to a width; dots above letters take no room."""
    return text + " " * (width - typeset.text_width(text))


# The matrices of eq. 15 need the one; wider than the other lines are hard to read.
LEAST_WIDTH, MOST_WIDTH = 80, 100
_LATEX_WIDTH = 66


def as_text(*equations: ChainEquation, width: int = LEAST_WIDTH) -> str:
    """Equations of one chain as plain text, with a legend.

    Args:
        equations: One or more, all of one chain of one robot.
        width: Letters in a line, at most.

    Returns:
        The text.

    Raises:
        UsageError: If there is no equation, or there are several chains.
    """
    return Page(equations, width).document()


def as_latex(*equations: ChainEquation) -> str:
    """Equations of one chain as LaTeX to paste into a document with amsmath, with a legend.

    Args:
        equations: One or more, all of one chain of one robot.

    Returns:
        The LaTeX source.

    Raises:
        UsageError: As `as_text`.
    """
    return LatexPage(equations, _LATEX_WIDTH).document()


def as_markdown(*equations: ChainEquation) -> str:
    """Equations of one chain as Markdown with MathJax, for notebooks, with a legend.

    Args:
        equations: One or more, all of one chain of one robot.

    Returns:
        The Markdown source.

    Raises:
        UsageError: As `as_text`.
    """
    return MarkdownPage(equations, _LATEX_WIDTH).document()
