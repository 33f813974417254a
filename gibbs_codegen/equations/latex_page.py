"""Pages in LaTeX: for documents with amsmath, and as Markdown with MathJax."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable

from gibbs_codegen.equations.chain_equation import ChainEquation
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.forms import FORMS
from gibbs_codegen.equations.page import (
    WIDEST_MATRIX,
    LegendEntry,
    Page,
    filled_form,
    held_indices,
)
from gibbs_codegen.equations.typeset import LATEX


class LatexPage(Page):
    """A page in LaTeX."""

    dialect = LATEX
    width = 66

    def _opening(self, head: str) -> list[str]:
        return [
            f"% {head}. Needs \\usepackage{{amsmath}}; long displays want \\allowdisplaybreaks.",
            *self._introduction(),
        ]

    def _table(self, rows: list[list[str]]) -> list[str]:
        heads = [rf"\text{{{head}}}" for head in rows[0]]
        body = " \\\\\n".join(" & ".join(row) for row in (heads, *rows[1:]))
        return self._display([f"\\begin{{array}}{{{'c' * len(heads)}}}\n{body}\n\\end{{array}}"])

    def _heading(self, title: str) -> list[str]:
        return [f"\\paragraph{{{title}.}}"]

    def _display(self, rows: Iterable[str]) -> list[str]:
        """An aligned display."""
        return [r"\begin{align*}", " \\\\\n".join(rows), r"\end{align*}"]

    def _form(self, equation: ChainEquation) -> list[str]:
        if equation.number == 15:
            return self._display(self._motion(equation))
        return self._display([filled_form(FORMS[equation.number].latex, equation)])

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

    def _definitions(self, definitions: Iterable[Definition]) -> list[str]:
        rows = []
        for symbol, value in definitions:
            left, ((_, first), *rest) = self._broken(symbol, value)
            rows.append(f"{left} &= {first}")
            rows += [f"&\\q{'q' * depth}uad {{}}{line}" for depth, line in rest]
        return self._display(rows)

    def _coupling(self, equation: ChainEquation) -> list[str]:
        rows = [r"\text{item} & \text{in the chain} & \text{in the hybrid system} & \text{row}"]
        rows += [
            f"{p.item} & {p.unknown.latex} & {p.hybrid.latex} & {p.row}" for p in equation.places
        ]
        rows += [f" & {own.latex} & {hybrid.latex} & " for own, hybrid in equation.inputs]
        body = " \\\\\n".join(rows)
        return self._display([f"\\begin{{array}}{{cccc}}\n{body}\n\\end{{array}}"])

    def _legend(self, entries: Iterable[LegendEntry]) -> list[str]:
        return [r"\paragraph{Symbols.}", ";\n".join(_explanations(entries)) + "."]


class MarkdownPage(LatexPage):
    """A page in Markdown with MathJax."""

    def _opening(self, head: str) -> list[str]:
        return []

    def _heading(self, title: str) -> list[str]:
        return [f"**{title}**", ""]

    def _display(self, rows: Iterable[str]) -> list[str]:
        body = " \\\\\n".join(rows)
        return ["$$", r"\begin{aligned}", body, r"\end{aligned}", "$$", ""]

    def _remark(self, text: str) -> list[str]:
        return [text, ""]

    def _legend(self, entries: Iterable[LegendEntry]) -> list[str]:
        return ["**Symbols**", "", *(f"- {text}" for text in _explanations(entries))]


def _escaped(meaning: str) -> str:
    """Plain words with a few symbols as LaTeX text; formulas stand between dollars already."""
    parts = meaning.split("$")
    for i in range(0, len(parts), 2):
        text = re.sub(r"\b([A-Z]_\d)(?: \+ ([A-Z]_\d))?", lambda m: f"${m[0]}$", parts[i])
        parts[i] = text.replace("²", "$^2$").replace("°", r"$^{\circ}$").replace("−", "$-$")
    return "".join(p if i % 2 == 0 else f"${p}$" for i, p in enumerate(parts))


def _explanations(entries: Iterable[LegendEntry]) -> list[str]:
    """Entries of the legend as running text."""
    texts = []
    for symbols, meaning in entries:
        written = ", ".join(f"${symbol}$" if symbol != "…" else r"\dots" for symbol in symbols)
        texts.append(f"{written}: {_escaped(meaning)}")
    return texts
