"""The Jinja environment. Templates hold layout; what they are given is text, numbers and lists."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import jinja2
from jinja2 import nodes
from jinja2.ext import Extension
from jinja2.parser import Parser


def render(template: str, context: Mapping[str, object]) -> str:
    """Text of a template; a name that the context lacks is an error of Jinja's."""
    return _environment(template_folder()).get_template(template).render(context)


@cache
def _environment(folder: Path) -> jinja2.Environment:
    """The environment of a folder, which keeps the templates that it has compiled."""
    return jinja2.Environment(
        extensions=[_Lines],
        loader=jinja2.FileSystemLoader(folder),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701 - what is rendered is source code, not HTML
    )


class _Lines(Extension):
    """The tag {% lines LIST, BEFORE, AFTER %}: each on a line, between two texts or none."""

    tags = {"lines"}  # noqa: RUF012 - as Jinja declares it

    def parse(self, parser: Parser) -> nodes.Node:
        """What stands for the tag: the text of the lines, if any."""
        number = next(parser.stream).lineno
        values = parser.parse_tuple()
        arguments = values.items if isinstance(values, nodes.Tuple) else [values]
        return nodes.Output([self.call_method("_text", arguments)]).set_lineno(number)

    def _text(self, lines: Iterable[str], before: str = "", after: str = "") -> str:
        return "".join(f"{before}{line}{after}".rstrip(" ") + "\n" for line in lines)


def template_folder() -> Path:
    """The templates: inside the package in a wheel, beside it in a checkout."""
    here = Path(__file__).parent.parent
    inside = here / "templates"
    return inside if inside.is_dir() else here.parent / "templates"
