"""Names of the Python API in running text lead to their entries, wherever these stand."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

# The word for a direction that walls have, besides a distribution.
ORDINARY = ("normal",)


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


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_post_transform(ApiLinks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
