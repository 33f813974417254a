"""`paper`: the paper's table, equations, figures and flight, with residuals, in a new folder."""

from __future__ import annotations

import argparse

from gibbs_codegen.cli import terminal
from gibbs_codegen.errors import printable
from gibbs_codegen.files.staging import check_new, check_output_folder


@terminal.ended_by_signals()
def run(options: argparse.Namespace) -> int:
    """Write the page, and print the residuals."""
    check_output_folder(options.out)
    check_new(options.out)
    from gibbs_codegen.paper import SETS_FORMULAS, write_paper  # SymPy and Matplotlib.

    if not SETS_FORMULAS:
        words = "formulas will stand as LaTeX; to set them, install gibbs_codegen with its extra"
        print(f"{words} paper, and run this again with another --out", flush=True)
    with terminal.progress("flying the paper's scenario and drawing its figures") as progress:
        residuals = write_paper(options.out, progress)
    width = max(len(residual.what) for residual in residuals)
    print(f"{'':{width}}  largest error    digits")
    for residual in residuals:
        print(f"{residual.what:{width}}  {residual.text:15}  {residual.digits:4.1f}")
    place = printable(options.out)
    print(f"written to {place}: the page, index.html, index.md; these numbers, residuals.csv")
    return 0
