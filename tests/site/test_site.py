"""The site: no broken link, no request to another machine, pictures with words, set formulas."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from conftest import ROOT, made_once
from support.browser import visit
from support.tools import missing

if find_spec("myst_nb") is None:
    missing("the extra docs is not installed")
from bs4 import BeautifulSoup  # It comes with the extra.

pytestmark = pytest.mark.slow
SITE = ROOT / "site"
NARROW = 390
# What a page says of itself once its formulas are set.
FORMULAS = """async () => {
    if (window.MathJax) await MathJax.startup.promise;
    const formulas = [...document.querySelectorAll('.math')];
    return {
        width: document.documentElement.scrollWidth,
        unset: formulas.filter(one => !one.querySelector('mjx-container')).length,
        faulty: document.querySelectorAll('mjx-merror, [data-mjx-error]').length,
        text: document.querySelector('article').innerText,
    };
}"""


@pytest.fixture(scope="session")
def pages(shared: Path) -> dict[str, BeautifulSoup]:
    """Every page by its path, of a site that is up to date."""

    def build() -> None:
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "docs", "site"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        (shared / "site").mkdir()

    made_once(shared / "site", build)
    paths = [path for path in sorted(SITE.rglob("*.html")) if path.name != "flight.html"]
    paths = [path for path in paths if "_static" not in path.parts]
    return {
        path.relative_to(SITE).as_posix(): BeautifulSoup(path.read_bytes(), "html.parser")
        for path in paths
    }


def test_links_lead_somewhere(pages: dict[str, BeautifulSoup]) -> None:
    """To a file of the site, and to a place that it has."""
    for page, soup in pages.items():
        for link in soup.select("[href]"):
            to = urlsplit(str(link["href"]))
            if to.scheme:
                assert to.scheme in ("https", "mailto"), (page, link)
                assert link.name == "a", (page, link)
                continue
            target = (SITE / page).parent / unquote(to.path) if to.path else SITE / page
            assert target.is_file(), (page, link)
            if to.fragment and target.suffix == ".html":
                there = pages[target.resolve().relative_to(SITE).as_posix()]
                assert there.find(id=unquote(to.fragment)), (page, link)


def test_pictures_and_scripts_are_there_and_pictures_have_words(
    pages: dict[str, BeautifulSoup],
) -> None:
    for page, soup in pages.items():
        for item in soup.select("[src]"):
            address = urlsplit(str(item["src"]))
            assert not address.netloc, (page, item)
            assert address.scheme == "data" or ((SITE / page).parent / address.path).is_file()
        for picture in soup.select("article img"):
            words = str(picture.get("alt", ""))
            # Without words Sphinx puts the name of the file.
            assert " " in words, (page, picture)
        for frame in soup.select("iframe"):
            assert " " in str(frame.get("title", "")), page


def test_notebooks_were_run_and_warned_of_nothing(pages: dict[str, BeautifulSoup]) -> None:
    notebooks = [page for page in pages if page.startswith("notebooks/")]
    assert len(notebooks) == len(list((ROOT / "notebooks").glob("*.ipynb")))
    for page in notebooks:
        assert pages[page].select(".cell_output"), page
        assert not pages[page].select(".stderr, .traceback"), page


def test_every_page_is_in_the_list_for_programs(pages: dict[str, BeautifulSoup]) -> None:
    listed = (SITE / "llms.txt").read_text(encoding="utf-8")
    for page in set(pages) - {"index.html", "genindex.html", "search.html"}:
        assert f"]({page})" in listed or page.endswith("/index.html"), page


def test_pages_on_a_telephone(pages: dict[str, BeautifulSoup]) -> None:
    """Nothing is asked of another machine, no page scrolls sideways, and formulas are set."""
    with visit((SITE / "index.html").as_uri(), NARROW) as seen:
        seen.page.frame_locator("iframe").locator("canvas").first.wait_for()
        for page in set(pages) - {"search.html"}:
            seen.page.goto((SITE / page).as_uri())
            found = seen.page.evaluate(FORMULAS)
            assert found["width"] <= NARROW, page
            assert (found["unset"], found["faulty"]) == (0, 0), page
            assert "$$" not in found["text"], page
            assert r"\frac" not in found["text"] or "latex" in found["text"].lower(), page
            assert (seen.foreign, seen.faults) == ([], []), page
