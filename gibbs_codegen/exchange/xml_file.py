"""XML files read safely: no document types, no entities, size and depth bounded; xacro expanded.

The expat parser of the standard library reports a document type before it reads any entity, and
the file is refused there, so that nothing is ever expanded or fetched. What other readers of robots
let pass is mended before: `--` in comments, a declaration that is not at the very beginning, and
single bytes that are not in the encoding.
"""

from __future__ import annotations

import codecs
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast
from xml.parsers import expat

from gibbs_codegen.errors import RefusedFileError, UsageError, cause_of, near, printable, require
from gibbs_codegen.exchange.sources import refusal

MAX_BYTES = 10_000_000
# Published robots have fewer than 2000 elements within 10 levels; bodies of MJCF are nested.
MAX_ELEMENTS = 200_000
MAX_DEPTH = 300
# How files begin that are not in an encoding that keeps ASCII.
_BEGINNINGS = {
    codecs.BOM_UTF8: "utf-8-sig",
    **dict.fromkeys((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE), "utf-16"),
    **{b"<\0": "utf-16-le", b"\0<": "utf-16-be"},
}
_DECLARED = re.compile(rb"""\s*<\?xml\s[^>]*?encoding\s*=\s*["']([\w.:-]+)""")
_ASCII = bytes(range(32, 127))
# Each ends with the file at the latest, so that the search takes a time in proportion to it.
_MENDED = re.compile(r"(?s)<!\[CDATA\[.*?(?:\]\]>|\Z)|<!--.*?(-->|\Z)|<\?xml\s.*?(\?>|\Z)")
_FAULTS = {
    expat.errors.XML_ERROR_NO_ELEMENTS: "it ends before its root element does",
    expat.errors.XML_ERROR_UNCLOSED_TOKEN: "it ends within a tag or comment",
    expat.errors.XML_ERROR_TAG_MISMATCH: "the end tag here is not that of the open element, <{}>",
    expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE: "an attribute is there twice",
    expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT: "something follows the end of the root element",
    expat.errors.XML_ERROR_UNDEFINED_ENTITY: "an entity &…; that XML does not define",
}
_OTHER_FAULT = "a character that cannot be here; < and & are written &lt; and &amp;"


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


def child(element: Element | None, tag: str) -> Element | None:
    """The first child of a tag, which is read by that, or None; of no element there is none."""
    first = None if element is None else next(iter(children(element, tag)), None)
    if first is not None:
        first.read.add("")
    return first


def child_text(element: Element | None, tag: str) -> str:
    """The text of the first child of a tag, empty if there is none."""
    inner = child(element, tag)
    return "" if inner is None else (inner.text or "").strip()


def children(element: Element, *tags: str) -> list[Element]:
    """The children of an element, in order, all or those of some tags."""
    return [e for e in element if isinstance(e, Element) and (e.tag in tags or not tags)]


def within(element: Element, *tags: str) -> list[Element]:
    """An element and all within it, in order, all or those of some tags."""
    return [e for e in element.iter() if isinstance(e, Element) and (e.tag in tags or not tags)]


def place_elsewhere(root: Element, file: Path) -> None:
    """Note, in all elements of a file that another one brings in, where they are."""
    for element in within(root):
        element.elsewhere, element.line = f"{file}:{element.line}", None


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
            fault = "is not a file" if path.exists() else "no such file"
            raise UsageError(f"{printable(path)}: {fault}; give {wanted}")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{printable(path)}: cannot be read: {cause_of(error)}") from None
    except ValueError:  # A path with a null character.
        raise UsageError(f"{printable(path)}: no such file") from None
    if len(data) > MAX_BYTES:
        raise refusal(
            path, f"larger than {MAX_BYTES} bytes, the limit for a robot; give a smaller file"
        )
    return data


def _single_bytes(error: Any) -> tuple[str, int]:
    """Bytes that are not in an encoding, one by one."""
    return error.object[error.start : error.end].decode("latin-1"), error.end


codecs.register_error("single bytes", _single_bytes)


def xml_text(data: bytes, file: str | Path) -> str:
    """The text of a document with its lines, but without a declaration or words in comments.

    Raises `SourceFileError` if the encoding that it declares is not known.
    """
    name = next((name for mark, name in _BEGINNINGS.items() if data.startswith(mark)), "")
    if not name:
        declared = _DECLARED.match(data)
        name = declared[1].decode() if declared else "utf-8"
        # Some writers say UTF-16 of any text.
        name = "utf-8" if name.lower().startswith("utf-16") else name
    try:
        if data.startswith(tuple(_BEGINNINGS)) or _ASCII.decode(name) == _ASCII.decode():
            return _MENDED.sub(_mended, data.decode(name, "single bytes"))
    except (LookupError, ValueError):
        pass
    words = f"the encoding {printable(name, 40)} that it declares is not known; save it as UTF-8"
    raise refusal(file, f"not well-formed XML: {words}", 1)


def _mended(match: re.Match[str]) -> str:
    """The lines of a declaration or comment without its words; all else as it is."""
    lines = "\n" * match[0].count("\n")
    return f"<!--{lines}-->" if match[1] else lines if match[2] else match[0]


def parse_xml(data: bytes, file: str) -> Element:
    """The root element of a document; every element has its line.

    Raises `SourceFileError` if it is not well-formed XML, declares a document type, or is too
    large.
    """
    builder = ET.TreeBuilder(element_factory=Element)
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    text, count, opened = xml_text(data, file), 0, list[str]()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        opened.append(tag)
        count += 1
        if len(opened) > MAX_DEPTH:
            raise _Refused(f"elements are nested more than {MAX_DEPTH} deep")
        if count > MAX_ELEMENTS:
            raise _Refused(
                f"more than {MAX_ELEMENTS} elements, the limit for a robot; give a smaller file"
            )
        cast(Element, builder.start(tag, attributes)).line = parser.CurrentLineNumber

    def end(tag: str) -> None:
        opened.pop()
        builder.end(tag)

    def refuse(*_: Any) -> None:
        raise _Refused("declares a document type (DOCTYPE), which may load other files; remove it")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(text.encode(), True)
        return cast(Element, builder.close())
    except _Refused as error:
        raise refusal(file, str(error), parser.CurrentLineNumber) from None
    except expat.ExpatError as error:
        words = _FAULTS.get(expat.ErrorString(error.code), _OTHER_FAULT)
        words = words.format(printable(opened[-1] if opened else "none", 40))
        if "{%" in text or "{{" in text:
            words = "a Jinja template; build its project, and import the file that results"
        raise refusal(file, f"not well-formed XML: {words}", error.lineno) from None


def expanded(path: Path, arguments: Mapping[str, object]) -> bytes:
    """The URDF that a file expands to with values for its `<xacro:arg>`, by their names.

    xacro evaluates expressions and reads other files: what it is given is trusted as a program is.
    Raises `UsageError` if xacrodoc is not installed, or an argument is unknown or without a value,
    and `SourceFileError` if it cannot expand the file.
    """
    text = xml_text(read_bytes(path), path)
    parse_xml(text.encode(), str(path))
    require("xacrodoc", printable(path), "xacro")
    from xacrodoc import packages, xacrodoc

    declared, texts, xacro = list[str](), list[str](), xacrodoc.xacro
    parse = xacro.parse

    def document(text: str | None, file: str = "") -> Any:
        """A file or what it includes, whose arguments become known."""
        if text is None:
            if not Path(file).is_file():
                return parse(None, file)  # It is no fault where that is optional.
            data = read_bytes(Path(file))
            parse_xml(data, file)
            text = xml_text(data, file)
        made = parse(text)
        for element in made.getElementsByTagName("xacro:arg"):
            declared.append(element.getAttribute("name"))
            if not element.hasAttribute("default"):  # xacro insists on one.
                element.parentNode.removeChild(element)
        declared.extend(re.findall(r"\$\(\s*arg\s+([\w.-]+)", text))
        texts.append(text)
        return made

    words, values = "", {name: str(value) for name, value in arguments.items()}
    try:
        xacro.parse = document
        xacro.init_stacks(str(path))  # What others are included relative to.
        packages.walk_up_from(path)
        made: str = xacrodoc.XacroDoc.from_string(
            text, values, resolve_packages=False
        ).to_urdf_string()
    except (UsageError, RefusedFileError):
        raise
    except Exception as error:  # Whatever its expressions raise.
        cause = error
        while isinstance(inner := getattr(cause, "exc", None), Exception):
            cause = inner
        if isinstance(cause, xacro.substitution_args.ArgException):
            name = printable(cause, 60)
            words = f"its argument {name} has no value; give {name}:=VALUE after the file"
        elif isinstance(cause, OSError):
            words = f"it includes {printable(cause.filename)}, which is not there"
        else:
            words = f"xacro cannot evaluate it ({printable(error, 300)}); correct it"
            if isinstance(cause, packages.PackageNotFoundError):
                name = printable(str(cause).split()[-1], 60)
                words = f"it needs the ROS package {name}; name the folder above it in"
                words += " ROS_PACKAGE_PATH"
            there = f"xacro {printable(path.name, 60)} > robot.urdf"
            words += f", or run `{there}` where ROS is, and import robot.urdf"
        made = ""
    finally:
        xacro.parse = parse
    there_are = f"; there are {printable(', '.join(dict.fromkeys(declared)) or 'none', 200)}"
    for name in arguments:
        if name not in declared:
            words = f"it has no argument {printable(name, 60)}{near(name, declared)}{there_are}"
        elif not re.search(rf"\$[({{][^<]*\b{re.escape(name)}\b", "\n".join(texts)):
            words = words or f"its argument {printable(name, 60)} is not used; leave it out"
    if words:
        raise refusal(path, f"cannot be expanded: {words}")
    return made.encode()
