"""The Jinja environment. Templates hold layout; what they are given is text, numbers and lists."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import jinja2


def render(template: str, context: Mapping[str, object]) -> str:
    """Text of a template; a name that the context lacks is an error of Jinja's."""
    return _environment(template_folder()).get_template(template).render(context)


@cache
def _environment(folder: Path) -> jinja2.Environment:
    """The environment of a folder, which keeps the templates that it has compiled."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701 - what is rendered is source code, not HTML
    )


def template_folder() -> Path:
    """The templates: inside the package in a wheel, beside it in a checkout."""
    here = Path(__file__).parent.parent
    inside = here / "templates"
    return inside if inside.is_dir() else here.parent / "templates"
