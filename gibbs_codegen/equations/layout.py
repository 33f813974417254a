"""Equations of a chain laid out: as text, as LaTeX for amsmath, as Markdown for notebooks.

Sums are broken before their signs, so that nothing is wider than a page, and each symbol is
explained once, in the legend at the end.
"""

from __future__ import annotations

from gibbs_codegen.equations.chain_equation import ChainEquation
from gibbs_codegen.equations.latex_page import LatexPage, MarkdownPage
from gibbs_codegen.equations.text_page import TextPage

# The matrices of eq. 15 need the one; wider than the other lines are hard to read.
LEAST_WIDTH, MOST_WIDTH = 80, 100


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
    return TextPage(equations, width).document()


def as_latex(*equations: ChainEquation) -> str:
    """Equations of one chain as LaTeX to paste into a document with amsmath, with a legend.

    Args:
        equations: One or more, all of one chain of one robot.

    Returns:
        The LaTeX source.

    Raises:
        UsageError: As `as_text`.
    """
    return LatexPage(equations).document()


def as_markdown(*equations: ChainEquation) -> str:
    """Equations of one chain as Markdown with MathJax, for notebooks, with a legend.

    Args:
        equations: One or more, all of one chain of one robot.

    Returns:
        The Markdown source.

    Raises:
        UsageError: As `as_text`.
    """
    return MarkdownPage(equations).document()
