"""xacro, expanded to URDF by the package xacrodoc."""

from __future__ import annotations

from pathlib import Path

from gibbs_codegen.errors import Fault, UsageError, printable
from gibbs_codegen.exchange.source import SourceFileError
from gibbs_codegen.exchange.xml_file import parse_xml, read_bytes


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
        raise SourceFileError(str(path), [Fault("", f"cannot be expanded: {words}")]) from None
    return text.encode()
