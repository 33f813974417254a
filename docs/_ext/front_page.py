"""Flights on the first page and in the gallery: robots that visitors fly by their emitted C.

Where there is no compiler for WebAssembly, the first page replays a flight instead.
"""

from __future__ import annotations

import re
from pathlib import Path
from shutil import copyfile

from sphinx.application import Sphinx
from sphinx.util.logging import getLogger

from gibbs_codegen import fly_html, read_scenario, simulate, view_html
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.shipped import shipped_names

# The robot of the first page.
FIRST = "quadrotor_arm_2link"


def write_flights(app: Sphinx) -> None:
    """Write a page for every robot that something leads; made again after changes of the code."""
    if app.builder.format != "html":
        return
    kept, shown = Path(app.config.nb_execution_cache_path, "fly"), Path(app.outdir, "fly")
    kept.mkdir(parents=True, exist_ok=True)
    for name in shipped_names("robots"):
        path = kept / f"{name}.html"
        try:
            if not path.exists():
                fly_html(name).save(path)
        except UsageError as error:
            getLogger(__name__).info("no page on which %s flies: %s", name, error)
            if name == FIRST:
                view_html(simulate(name, read_scenario("circle"))).save(path)
    shown.mkdir(parents=True, exist_ok=True)
    for page in kept.iterdir():
        copyfile(page, shown / page.name)


def lead_to_flights(app: Sphinx, docname: str, source: list[str]) -> None:
    """Give robots of the gallery that have such a page a link to it."""
    first = Path(app.outdir, "fly", f"{FIRST}.html")
    if docname == "index" and first.exists() and "WebAssembly" not in first.read_text("utf-8"):
        sentence = r"Drag a ring, .*? in your browser\. "  # Here it is a flight that is replayed.
        source[0] = re.sub(sentence, "", source[0], flags=re.DOTALL)
    if docname == "gallery":
        for page in sorted(Path(app.outdir, "fly").glob("*.html")):
            link = f'<a href="fly/{page.name}">Fly it in this browser</a>'
            source[0] = source[0].replace(f"/{page.stem}.png)\n", f"/{page.stem}.png)\n{link}\n")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write_flights)
    app.connect("source-read", lead_to_flights)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
