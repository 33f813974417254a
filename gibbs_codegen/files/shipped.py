"""Files by path, or by the name of one that ships with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from gibbs_codegen.errors import Fault, RefusedFileError, UsageError, cause_of, near, printable

MAX_BYTES = 1_000_000


def shipped_names(folder: str) -> tuple[str, ...]:
    """Names, in order and without ending, of files that ship in a folder, such as "robots"."""
    files = (resources.files("gibbs_codegen") / folder).iterdir()
    return tuple(sorted(f.name[:-5] for f in files if f.name.endswith(".toml")))


def text_of(name_or_path: str, folder: str, refused: type[RefusedFileError]) -> tuple[str, str]:
    """Text of a file that ships, which comes first, or of a path, and its name in messages.

    `folder` holds those that ship. Raises `refused` for what is not a page of UTF-8 text, and
    `UsageError` if there is no such file, or it cannot be read.
    """
    shipped = shipped_names(folder)
    if name_or_path in shipped:
        source = f"{name_or_path}.toml"
        resource = resources.files("gibbs_codegen") / folder / source
        return resource.read_text(encoding="utf-8"), source
    path = Path(name_or_path)
    try:
        if not path.is_file():
            noun = folder.removesuffix("s")
            if path.exists():
                raise UsageError(f"{printable(path)}: is not a file; give a {noun} file in TOML")
            hint = near(str(path).removesuffix(".toml"), shipped) or f" ({', '.join(shipped)})"
            raise UsageError(
                f"{printable(path)}: no such {noun} file, and no {noun} of that name ships{hint}"
            )
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            reason = (
                f"larger than {MAX_BYTES} bytes, the limit for a {refused.kind}; give a smaller "
                "file"
            )
            raise refused(name_or_path, [Fault("", reason)])
        return data.decode("utf-8-sig"), name_or_path
    except UnicodeDecodeError as error:
        fault = Fault("", f"not UTF-8 text (byte {error.start}); save it as UTF-8")
        raise refused(name_or_path, [fault]) from None
    except OSError as error:
        raise UsageError(f"{printable(path)}: cannot be read: {cause_of(error)}") from None
