"""Names of the Python API lead to their entries, in running text and where code imports them."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

# Words for a direction that walls have and for inputs of programs, besides distributions.
ORDINARY = ("normal", "uniform")
# What code imports, as Pygments writes it: the rest of a line, or what is in parentheses.
IMPORTED = re.compile(
    r"""(?<=<span class="nn">gibbs_codegen</span><span class="w"> </span>)"""
    r"""<span class="kn">import</span> (<span class="p">\(</span>.*?\)|.*?\n)""",
    re.DOTALL,
)


class ApiLinks(SphinxPostTransform):
    """Makes a link of each literal that is the name of a documented object, or a call of it."""

    default_priority = 9  # just before references are resolved

    def run(self, **_: Any) -> None:
        """Wrap the literals of a page."""
        documented = self.env.get_domain("py").objects  # type: ignore[attr-defined]
        names = {full.removeprefix("gibbs_codegen."): full for full in documented}
        names |= {
            full.rpartition(".")[2]: full
            for full in documented
            if full[-1:].isalpha() and full.rpartition(".")[2][:1].isupper()
        }
        for literal in list(self.document.findall(nodes.literal)):
            name = re.sub(r"\(.*\)$", "", literal.astext())
            parent: Any = literal.parent
            if (
                name not in names
                or name in ORDINARY
                or isinstance(parent, nodes.reference | pending_xref)
            ):
                continue
            link = pending_xref(
                "",
                refdomain="py",
                reftype="obj",
                reftarget=names[name],
                refdoc=self.env.docname,
                refwarn=False,
                refexplicit=True,
            )
            literal.replace_self(link)
            link += literal


def link_imports(
    app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: nodes.document | None
) -> None:
    """Make links of the names that blocks of code import; a handler of `html-page-context`."""
    documented = app.env.get_domain("py").objects  # type: ignore[attr-defined]

    def link(name: re.Match[str]) -> str:
        if entry := documented.get(full := f"gibbs_codegen.{name[1]}"):
            address = f"{app.builder.get_relative_uri(page, entry.docname)}#{full}"
            return f'<a class="reference internal" href="{address}">{name[0]}</a>'
        return name[0]

    def links(imported: re.Match[str]) -> str:
        return re.sub(r'<span class="n">(\w+)</span>', link, imported[0])

    context["body"] = IMPORTED.sub(links, context.get("body", ""))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_post_transform(ApiLinks)
    app.connect("html-page-context", link_imports)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
