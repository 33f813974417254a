"""A page of plain text."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

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
from gibbs_codegen.equations.typeset import TEXT, text_width


class TextPage(Page):
    """A page of plain text, at most `width` letters wide."""

    dialect = TEXT

    def __init__(self, equations: Sequence[ChainEquation], width: int) -> None:
        super().__init__(equations)
        self.width = width

    def _opening(self, head: str) -> list[str]:
        return [head, *self._introduction()]

    def _table(self, rows: list[list[str]]) -> list[str]:
        widths = [max(map(text_width, column)) + 2 for column in zip(*rows, strict=True)]
        return ["".join(map(_padded, row, widths)).rstrip() for row in rows]

    def _heading(self, title: str) -> list[str]:
        return ["", title, "-" * len(title)]

    def _form(self, equation: ChainEquation) -> list[str]:
        if equation.number == 15:
            return [*self._motion(equation), ""]
        form = filled_form(FORMS[equation.number].text, equation)
        return [*form.split("\n"), ""]

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
        return [*textwrap.wrap(text, self.width), ""]

    def _definitions(self, definitions: Iterable[Definition]) -> list[str]:
        lines = []
        for symbol, value in definitions:
            left, ((_, first), *rest) = self._broken(symbol, value)
            lines.append(f"{left} = {first}")
            lines += [f"{' ' * (4 + 4 * depth)}{line}" for depth, line in rest]
        return lines

    def _cut(self, term: list[str]) -> list[str]:
        # Products that are too long are cut before a multiplication sign.
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

    def _coupling(self, equation: ChainEquation) -> list[str]:
        rows = [("item", "in the chain", "in the hybrid system", "row")]
        rows += [(str(p.item), p.unknown.text, p.hybrid.text, str(p.row)) for p in equation.places]
        rows += [("", own.text, hybrid.text, "") for own, hybrid in equation.inputs]
        return [f"{a:<6}{_padded(b, 16)}{_padded(c, 22)}{d:>3}".rstrip() for a, b, c, d in rows]

    def _legend(self, entries: Iterable[LegendEntry]) -> list[str]:
        lines = ["", "Symbols", "-------"]
        for symbols, meaning in entries:
            text = re.sub(r"B_(\d)", r"B\1", f"{', '.join(symbols)}: {meaning}")
            lines += textwrap.wrap(
                text,
                self.width,
                subsequent_indent="    ",
                break_long_words=False,
                break_on_hyphens=False,
            )
        return lines


def _padded(text: str, width: int) -> str:
    """Text filled with spaces to a width; dots above letters take no room."""
    return text + " " * (width - text_width(text))
