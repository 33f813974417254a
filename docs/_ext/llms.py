"""`llms.txt`: the pages of the site with what each is about, for programs that read text."""

from __future__ import annotations

from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx


def write_list(app: Sphinx, exception: Exception | None) -> None:
    """Write the list beside the pages, in the order of the navigation."""
    if exception or app.builder.format != "html":
        return
    tree, titles = app.env.toctree_includes, app.env.titles

    def begins(page: str) -> str:
        """The whole sentences of a page's first paragraph without formulas, on one line."""
        for paragraph in app.env.get_doctree(page).findall(nodes.paragraph):
            text = " ".join(paragraph.astext().split())
            of_page = isinstance(paragraph.parent, nodes.section)
            if of_page and not any(map(list, map(paragraph.findall, (nodes.math, nodes.image)))):
                whole, _, _ = f"{text} ".rpartition(". ")
                return f"{whole}." if whole else f"{text.rstrip(':')} …"
        return ""

    def line(page: str) -> str:
        return f"- [{titles[page].astext()}]({page}.html): {begins(page)}"

    root = app.config.root_doc
    lines = [f"# {titles[root].astext()}", "", f"> {begins(root)}", "", "## Start and project", ""]
    lines += [line(page) for page in tree[root] if page not in tree]
    for room in (page for page in tree[root] if page in tree):
        pages = [below for page in tree[room] for below in (page, *tree.get(page, ()))]
        lines += ["", f"## {titles[room].astext()}", "", *map(line, pages)]
    Path(app.outdir, "llms.txt").write_text("\n".join([*lines, ""]), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("build-finished", write_list)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
