"""The README and the pages in `docs/`, and what their blocks do; without the copies in the site."""

from __future__ import annotations

import doctest
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent.parent
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for pages in (ROOT.glob("*.md"), (ROOT / "docs").rglob("*.md"))
    for path in sorted(pages)
    if path.parent != ROOT / "docs" / "project"
}


def blocks(page: str, language: str) -> list[str]:
    """Fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", PAGES[page], flags=re.DOTALL | re.MULTILINE)


def files_of(page: str) -> dict[str, str]:
    """Texts of the files of a page, by name, in the order of the page.

    They are blocks that name a file in a comment on their first line. Blocks that name the same
    file follow each other in it.
    """
    found: dict[str, str] = {}
    for block in re.findall(r"^```\w+\n(.*?)^```", PAGES[page], flags=re.DOTALL | re.MULTILINE):
        if name := re.match(r"(?:\{?#|//|/\*|<!--) ([\w/-]+(?:\.\w+)+)", block):
            found[name[1]] = found.get(name[1], "") + block
    return found


def write_files(page: str, folder: Path) -> list[str]:
    """Write the files of a page into a folder, and return their names."""
    for name, text in files_of(page).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return list(files_of(page))


def run_python(page: str, which: slice = slice(None)) -> dict[str, Any]:
    """The names that blocks of a page define; those with prompts give what is shown."""
    names: dict[str, Any] = {}
    for block in blocks(page, "python")[which]:
        if not block.startswith(">>>"):
            exec(block, names)  # noqa: S102
            continue
        session = doctest.DocTestParser().get_doctest(block, names, page, page, 0)
        # Long messages of errors are broken into lines that fit on a page.
        flags = doctest.NORMALIZE_WHITESPACE if "Traceback" in block else 0
        runner = doctest.DocTestRunner(optionflags=flags)
        runner.run(session, clear_globs=False)
        assert runner.summarize(verbose=False).failed == 0
        names = session.globs
    return names
