"""The flight on the front page: the paper's scenario, flown when the site is built."""

from __future__ import annotations

from pathlib import Path
from shutil import copyfile

from sphinx.application import Sphinx

from gibbs_codegen import load, read_scenario, simulate, view_html

ROOT = Path(__file__).parent.parent.parent


def write_flight(app: Sphinx) -> None:
    """Write the page that `index.md` embeds; it is flown again after every change of the code."""
    if app.builder.format != "html":
        return
    kept = Path(app.config.nb_execution_cache_path, "flight.html")
    if not kept.exists():
        robot = load(ROOT / "generated" / "hexarotor_3link")
        view_html(simulate(robot, read_scenario("paper"))).save(kept)
    Path(app.outdir).mkdir(parents=True, exist_ok=True)
    copyfile(kept, Path(app.outdir, "flight.html"))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write_flight)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
