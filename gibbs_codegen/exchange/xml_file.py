"""XML files read safely: no document types, no entities, size and depth bounded; xacro expanded.

The expat parser of the standard library tells of a document type before it reads any entity, and
the file is refused there, so that nothing is ever expanded or fetched.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, cast
from xml.parsers import expat

from gibbs_codegen.errors import UsageError, cause_of, printable
from gibbs_codegen.exchange.sources import refusal

MAX_BYTES = 10_000_000
# Published robots have fewer than 2000 elements within 10 levels; bodies of MJCF are nested.
MAX_ELEMENTS = 200_000
MAX_DEPTH = 300


class Element(ET.Element):
    """An element that knows its line, or where it is if that is not in the file that is read.

    `read` has the attributes that were asked for, and "" once the element was.
    """

    line: int | None = None
    elsewhere: str = ""

    def __init__(self, *named: Any, **attributes: Any) -> None:
        super().__init__(*named, **attributes)
        self.read: set[str] = set()

    def get(self, key: str, default: Any = None) -> Any:
        """An attribute, which is read by that."""
        self.read.add(key)
        return super().get(key, default)


class _Refused(Exception):  # noqa: N818 - it never leaves this module
    """Why the parser was stopped."""


def child(element: Element, tag: str) -> Element | None:
    """The first child of a tag, which is read by that, or None."""
    first = next((found for found in children(element) if found.tag == tag), None)
    if first is not None:
        first.read.add("")
    return first


def children(element: Element) -> list[Element]:
    """The children of an element, in order."""
    return [found for found in element if isinstance(found, Element)]


def within(element: Element) -> list[Element]:
    """An element and all within it, in order."""
    return [found for found in element.iter() if isinstance(found, Element)]


def described(element: Element) -> str:
    """An element in words for messages, such as `<joint "rotor1">`."""
    name = element.attrib.get("name")
    tag = printable(element.tag, 40)
    return f"<{tag}>" if name is None else f'<{tag} "{printable(name, 60)}">'


def read_bytes(path: Path, wanted: str = "a URDF, xacro, MJCF or SDF file") -> bytes:
    """The bytes of a file; `wanted` is what it is to be.

    Raises `UsageError` if there is no such file, or it cannot be read, and `SourceFileError` if it
    is too large.
    """
    try:
        if not path.is_file():
            what = "is not a file" if path.exists() else "no such file"
            raise UsageError(f"{printable(path)}: {what}; give {wanted}")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{printable(path)}: cannot be read: {cause_of(error)}") from None
    except ValueError:  # A path with a null character.
        raise UsageError(f"{printable(path)}: no such file") from None
    if len(data) > MAX_BYTES:
        raise refusal(path, f"larger than {MAX_BYTES} bytes; robots have far less text")
    return data


def parse_xml(data: bytes, file: str) -> Element:
    """The root element of a document; every element has its line.

    Raises `SourceFileError` if it is not well-formed XML, declares a document type, or is too
    large.
    """
    builder = ET.TreeBuilder(element_factory=Element)
    parser = expat.ParserCreate()
    parser.buffer_text = True
    depth = count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MAX_DEPTH:
            raise _Refused(f"elements are nested more than {MAX_DEPTH} deep")
        if count > MAX_ELEMENTS:
            raise _Refused(f"more than {MAX_ELEMENTS} elements; robots have far fewer")
        cast(Element, builder.start(tag, attributes)).line = parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: Any) -> None:
        raise _Refused("declares a document type (DOCTYPE), which could expand or fetch entities")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return cast(Element, builder.close())
    except (_Refused, expat.ExpatError, LookupError, ValueError) as error:
        text = str(error) if isinstance(error, _Refused) else f"not well-formed XML: {error}"
        line = parser.ErrorLineNumber if isinstance(error, expat.ExpatError) else None
        line = line or parser.CurrentLineNumber
        raise refusal(file, printable(text), line) from None


def expanded(path: Path) -> bytes:
    """The URDF that a file expands to.

    xacro evaluates expressions and reads other files: what it is given is trusted as a program is.
    Raises `UsageError` if xacrodoc is not installed, and `SourceFileError` if it cannot expand the
    file.
    """
    parse_xml(read_bytes(path), str(path))
    try:
        from xacrodoc import XacroDoc
    except ImportError:
        raise UsageError(
            f"{printable(path)}: the package xacrodoc is not installed; install "
            "xacrodoc, or gibbs_codegen with its extra xacro, or expand the file to URDF"
        ) from None
    try:
        text: str = XacroDoc.from_file(str(path), resolve_packages=False).to_urdf_string()
    except Exception as error:  # Whatever its expressions raise.
        words = printable(f"{type(error).__name__}: {error}", 300)
        raise refusal(path, f"cannot be expanded: {words}") from None
    return text.encode()
