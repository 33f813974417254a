"""What `show --format latex` prints is LaTeX: MathJax with amsmath sets every formula of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import ROOT
from support.browser import visit

from gibbs_codegen import as_latex, chain_equation, read_robot

MATHJAX = ROOT / "docs" / "_static" / "mathjax" / "tex-svg-full.js"
FORMULA = re.compile(r"(\\begin\{align\*\}.*?\\end\{align\*\}|\$[^$]+\$)", flags=re.DOTALL)


def faults(formulas: list[str], folder: Path) -> list[str]:
    """What MathJax says of the formulas that it cannot set."""
    page = folder / "page.html"
    page.write_text(
        "<script>MathJax = {startup: {typeset: false}}</script>"
        f'<script src="{MATHJAX.as_uri()}"></script>',
        encoding="utf-8",
    )
    script = """async formulas => {
        await MathJax.startup.promise;
        const nodes = formulas.map(text => MathJax.tex2svg(text));
        const wrong = "[data-mjx-error], [fill=red]";  // red is a command that is not defined
        return nodes.flatMap(node => [...node.querySelectorAll(wrong)].map(x => x.outerHTML));
    }"""
    with visit(page.as_uri()) as seen:
        return list(seen.page.evaluate(script, formulas))


@pytest.mark.slow
def test_every_formula_can_be_set(tmp_path: Path) -> None:
    shown = [("hexarotor_3link", 2, (2, 15)), ("quadrotor", 1, (5, 6, 15, 18))]
    texts = [
        as_latex(chain_equation(read_robot(name)[0], chain=chain, equation=equation))
        for name, chain, equations in shown
        for equation in equations
    ]
    formulas = [found.strip("$") for text in texts for found in FORMULA.findall(text)]
    assert len(formulas) > 100
    assert faults([r"\begin{align*} a &= \fra{1}{2} \end{align*}"], tmp_path)
    assert not faults(formulas, tmp_path)
