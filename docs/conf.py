"""The site: `python -m sphinx -q -W --keep-going docs site`.

With `GIBBS_CODEGEN_PAGES="notebooks/01_gibbs_function howto/import"` only these pages are built,
and links to others are not followed: what one looks at while one writes a page.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "_ext")]
# Notebooks are run by processes of their own, and import from the same places.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(ROOT), str(ROOT / "docs" / "_ext"), os.environ.get("PYTHONPATH")])
)

from gibbs_codegen import __version__  # noqa: E402 - the package of this checkout

# How long work takes depends on the machine, and pages must not: notebooks do not log it.
STARTUP = ROOT / "site" / ".cache" / "ipython" / "profile_default" / "startup"
STARTUP.mkdir(parents=True, exist_ok=True)
(STARTUP / "quiet.py").write_text(
    "import logging\n"
    "TIMES = {'log_once', '_log_controller_time'}\n"
    "logging.getLogger('gibbs_codegen').addFilter(lambda record: record.funcName not in TIMES)\n",
    encoding="utf-8",
)
os.environ["IPYTHONDIR"] = str(STARTUP.parents[1])
# Matplotlib warns of legends that took it a second to place, as on a busy machine.
os.environ["PYTHONWARNINGS"] = "ignore:Creating legend with loc"


def execution_cache() -> Path:
    """Where the outputs of notebooks are kept, which are those of one state of the package.

    Returns:
        A folder in `site/.cache`, with another name after every change of the code.
    """
    digest = hashlib.sha256()
    for folder in ("gibbs_codegen", "generated", "templates", "docs/_ext"):
        for path in sorted((ROOT / folder).rglob("*.*")):
            if path.suffix not in (".pyc", ".so") and path.is_file():
                digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0")
                digest.update(path.read_bytes())
    return ROOT / "site" / ".cache" / digest.hexdigest()[:16]


project = "gibbs_codegen"
author = "The gibbs_codegen authors"
version = release = __version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "api_links",
    "front_page",
    "generated",
    "llms",
    "paper_page",
    "repository",
    "signatures",
]
exclude_patterns = ["_*"]
suppress_warnings = ["mystnb.unknown_mime_type"]

if pages := os.environ.get("GIBBS_CODEGEN_PAGES", "").split():
    include_patterns = ["index.md", *(f"{page}.*" for page in pages)]
    suppress_warnings += ["toc", "myst.xref_missing", "ref"]

# Docstrings are Google's, with names in single backticks.
default_role = "code"
# Entries of classes that need these packages come without them.
autodoc_mock_imports = ["gymnasium", "torch"]
autodoc_preserve_defaults = True
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "Array"}
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True
maximum_signature_line_length = 80
add_module_names = False

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_cache_path = str(execution_cache())
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_output_stderr = "error"
nb_merge_streams = True
# Outputs of notebooks have formulas and tables, as their cells of text do.
nb_render_markdown_format = "myst"

html_theme = "furo"
html_title = f"gibbs_codegen {release}"
# The address of the site, once it has one, is set there and nowhere else in code.
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
html_baseurl = PROJECT.get("urls", {}).get("Documentation", "")
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
mathjax_path = "mathjax/tex-svg-full.js"
