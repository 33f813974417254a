"""The page on the paper, as `gibbs-codegen paper` writes it, with links to the rest of the site."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree
from typing import TYPE_CHECKING

from gibbs_codegen.paper import write_paper

if TYPE_CHECKING:
    from sphinx.application import Sphinx

COMMENT = "<!-- gibbs-codegen paper -->"


def fill_in(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the text of the page in place of the comment; it is made anew after every change."""
    if COMMENT not in source[0]:
        return
    kept = Path(app.config.nb_execution_cache_path, "paper")
    if not kept.exists():
        write_paper(kept, linked=True)
    text = (kept / "index.md").read_text(encoding="utf-8")
    source[0] = source[0].replace(COMMENT, text.partition("\n\n")[2])


def show_figures(app: Sphinx) -> None:
    """Copy the figures of the page to the site."""
    kept = Path(app.config.nb_execution_cache_path, "paper")
    if app.builder.format == "html" and kept.exists():
        copytree(kept, Path(app.outdir, "paper"), dirs_exist_ok=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", fill_in)
    app.connect("build-finished", lambda app, exception: exception or show_figures(app))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
