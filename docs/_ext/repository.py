"""Files of the repository as pages of the site, with links that work in both places.

Notebooks stay in `notebooks/` and what a repository has at its root stays there; copies of them,
which git ignores, are pages. Links are written as they work in the repository.
"""

from __future__ import annotations

import re
from os.path import normpath, relpath
from pathlib import Path
from shutil import copy2

from sphinx.application import Sphinx
from sphinx.config import Config

ROOT = Path(__file__).parent.parent.parent
# Where a file of the repository stands on the site, by how its path begins.
PLACES = {
    "notebooks/": "docs/notebooks/",
    "CHANGELOG.md": "docs/project/changelog.md",
    "CONTRIBUTING.md": "docs/project/contributing.md",
    "GUARANTEES.md": "docs/project/guarantees.md",
    "README.md": "docs/index.md",
    "SECURITY.md": "docs/project/security.md",
}
COPIED = [*sorted((ROOT / "notebooks").glob("*.ipynb")), *ROOT.glob("[CGS]*.md")]
LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)\s#]+)")


def on_site(path: str) -> str:
    """The path of a file's page, from the root of the repository; of other files, their own."""
    start = next((start for start in PLACES if path.startswith(start)), "")
    return PLACES.get(start, "") + path.removeprefix(start)


PAGES = {on_site(p): p for p in (path.relative_to(ROOT).as_posix() for path in COPIED)}


def copy_pages(app: Sphinx, config: Config) -> None:
    """Copy what has changed, with its time, by which Sphinx tells what it has to read again."""
    for page, path in PAGES.items():
        (ROOT / page).parent.mkdir(exist_ok=True)
        copy2(ROOT / path, ROOT / page)
    # Nothing else is in these folders: the original was renamed or removed.
    for copy in (*ROOT.glob("docs/notebooks/*.ipynb"), *ROOT.glob("docs/project/*.md")):
        if copy.relative_to(ROOT).as_posix() not in PAGES:
            copy.unlink()


def turn_links(app: Sphinx, docname: str, source: list[str]) -> None:
    """Replace links that are right in the repository by those that are right on the site."""
    page = Path(app.env.doc2path(docname)).relative_to(ROOT).as_posix()
    original = PAGES.get(page, page)

    def turned(link: re.Match[str]) -> str:
        target = normpath(f"{original}/../{link[0]}")
        return relpath(on_site(target), f"{page}/..")

    source[0] = LINK.sub(turned, source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("config-inited", copy_pages)
    app.connect("source-read", turn_links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
