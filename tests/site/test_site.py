"""The site: no broken link, no request to another machine, pictures with words, set formulas."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from conftest import ROOT
from support.browser import visit
from support.kept import made_once
from support.tools import missing

if find_spec("myst_nb") is None:
    missing("the extra docs is not installed")
from bs4 import BeautifulSoup  # It comes with the extra.

pytestmark = pytest.mark.slow
SITE = ROOT / "site"
NARROW = 390
# What a page says of itself once its formulas are set. TeX in its text, outside code, is not set.
FORMULAS = r"""async () => {
    if (window.MathJax) await MathJax.startup.promise;
    const formulas = [...document.querySelectorAll('.math')];
    const copy = document.querySelector('article').cloneNode(true);
    copy.querySelectorAll('pre, code, mjx-container').forEach(part => part.remove());
    const raw = copy.textContent.match(/.{0,40}(\$\$|\\[a-z]{3,}).{0,40}/);
    return {
        width: document.documentElement.scrollWidth,
        unset: formulas.filter(one => !one.querySelector('mjx-container')).length,
        wrong: document.querySelectorAll('mjx-merror, [data-mjx-error]').length,
        raw: raw && raw[0],
    };
}"""


@pytest.fixture(scope="session")
def pages(shared: Path) -> dict[str, BeautifulSoup]:
    """Every page by its path, of a site that is built first, or brought up to date."""

    def build() -> None:
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "docs", "site"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        (shared / "site").mkdir()

    made_once(shared / "site", build)
    paths = [path for path in sorted(SITE.rglob("*.html")) if path.parent != SITE / "fly"]
    paths = [path for path in paths if not {"_static", ".cache"} & set(path.parts)]
    return {
        path.relative_to(SITE).as_posix(): BeautifulSoup(path.read_bytes(), "lxml")
        for path in paths
    }


def without_source(pages: dict[str, BeautifulSoup]) -> list[str]:
    """Pages but for those that show the package's source."""
    return [page for page in pages if not page.startswith("_modules/")]


def test_links_lead_somewhere(pages: dict[str, BeautifulSoup]) -> None:
    """To a file of the site, and to a place that it has."""
    broken = []
    for page, soup in pages.items():
        for link in soup.select("[href]"):
            to = urlsplit(str(link["href"]))
            target = (SITE / page).parent / unquote(to.path) if to.path else SITE / page
            if to.scheme or to.netloc:  # A page may link to other machines, but load nothing.
                named = link.name == "a" or link.get("rel") == ["canonical"]
                right = named and to.scheme in ("https", "mailto")
            elif to.fragment and target.suffix == ".html":
                there = pages.get(target.resolve().relative_to(SITE).as_posix())
                right = there is not None and there.find(id=unquote(to.fragment)) is not None
            else:
                right = target.is_file()
            broken += [] if right else [(page, str(link))]
    assert not broken


def test_what_pages_load_is_on_the_site(pages: dict[str, BeautifulSoup]) -> None:
    broken = []
    for page, soup in pages.items():
        for item in soup.select("[src]"):
            address = urlsplit(str(item["src"]))
            there = ((SITE / page).parent / address.path).is_file() and not address.netloc
            broken += [] if there or address.scheme == "data" else [(page, str(item)[:200])]
    assert not broken


def test_pictures_say_in_words_what_they_show(pages: dict[str, BeautifulSoup]) -> None:
    """Where there are none, Sphinx puts the name of the file."""
    silent = []
    for page, soup in pages.items():
        pictures = [(str(one.get("alt", "")), one) for one in soup.select("article img")]
        pictures += [(str(one.get("title", "")), one) for one in soup.select("iframe")]
        silent += [(page, str(one)[:200]) for words, one in pictures if " " not in words]
    assert not silent


def test_notebooks_were_run_and_warned_of_nothing(pages: dict[str, BeautifulSoup]) -> None:
    notebooks = [page for page in pages if page.startswith("notebooks/")]
    assert len(notebooks) == len(list((ROOT / "notebooks").glob("*.ipynb")))
    for page in notebooks:
        assert pages[page].select(".cell_output"), page
        assert not pages[page].select(".stderr, .traceback"), page


def test_every_page_is_in_the_list_for_programs(pages: dict[str, BeautifulSoup]) -> None:
    listed = (SITE / "llms.txt").read_text(encoding="utf-8")
    for page in set(without_source(pages)) - {"index.html", "genindex.html", "search.html"}:
        assert f"]({page})" in listed or page.endswith("/index.html"), page


def test_pages_on_a_telephone(pages: dict[str, BeautifulSoup]) -> None:
    """Nothing is asked of another machine, no page scrolls sideways, and formulas are set."""
    faulty = []
    with visit((SITE / "index.html").as_uri(), NARROW) as seen:
        seen.page.frame_locator("iframe").locator("canvas").first.wait_for()
        for page in sorted(set(without_source(pages)) - {"search.html"}):
            seen.page.goto((SITE / page).as_uri())
            found = seen.page.evaluate(FORMULAS)
            if found != {"width": NARROW, "unset": 0, "wrong": 0, "raw": None}:
                faulty.append((page, found))
        assert (faulty, seen.foreign, seen.faults) == ([], [], [])
