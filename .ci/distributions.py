"""Write the sdist and two wheels of the last commit: the same bytes wherever and whenever.

    python3 .ci/distributions.py FOLDER

One wheel is for every platform. The other has the extension, and is for this platform: for Python
3.12 and all later ones, unless the Python that builds it is older, which makes one for itself.
Where the extension cannot be built, there is no such wheel, and that is said.

What is built is the commit's tree as git exports it, so that nothing else that lies in a checkout
gets in, and everything has the date of the commit. The sdist is packed again, since setuptools puts
the time and the user into it. A wheel of the tree must be that of the sdist. Other versions of
setuptools, which the wheels name, of zlib, and of the compiler and NumPy, may make other bytes.
"""

from __future__ import annotations

import gzip
import io
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parent.parent


def run(*command: str | Path, cwd: Path = ROOT) -> bytes:
    """What a command prints; where it fails, end with what it said."""
    done = subprocess.run(command, cwd=cwd, capture_output=True)
    if done.returncode != 0:
        said = (done.stdout + done.stderr).decode(errors="replace")
        sys.exit(f"{said}\n{' '.join(map(str, command))}: exits {done.returncode}")
    return done.stdout


def build_environment(folder: Path, requirements: Sequence[str]) -> Path:
    """A virtual environment with what the build needs; its interpreter."""
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-compile")
    run(*pip, *requirements)
    return python


def build(python: Path, backend: str, kind: str, tree: Path, folder: Path) -> Path:
    """The distribution that the hook `build_<kind>` of the build back end leaves in `folder`."""
    hook = f"import sys; from {backend} import build_{kind}; print(build_{kind}(sys.argv[1]))"
    return folder / run(python, "-c", hook, folder, cwd=tree).decode().splitlines()[-1]


def unpack(archive: io.BytesIO, folder: Path) -> None:
    """Unpack a tar, compressed or not."""
    with tarfile.open(fileobj=archive) as tree:
        tree.extractall(folder, filter="data")


def repack(archive: Path, packed: Path, date: int) -> None:
    """Pack an sdist again, with nothing in it of when, where and by whom it was packed."""
    with (
        tarfile.open(archive) as old,
        packed.open("wb") as file,
        gzip.GzipFile("", "wb", fileobj=file, mtime=date) as stream,
        tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as new,
    ):
        for member in sorted(old.getmembers(), key=lambda member: member.name):
            plain = tarfile.TarInfo(member.name)
            plain.type, plain.size, plain.mtime = member.type, member.size, date
            plain.mode = 0o755 if member.isdir() else 0o644
            new.addfile(plain, old.extractfile(member))


def main(out: Path) -> None:
    """Build in a folder that is gone afterwards; only whole distributions get to `out`."""
    os.umask(0o022)
    date = int(run("git", "log", "-1", "--format=%ct"))
    os.environ["SOURCE_DATE_EPOCH"] = str(date)
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        unpack(io.BytesIO(run("git", "archive", "HEAD")), work / "tree")
        settings = tomllib.loads((work / "tree" / "pyproject.toml").read_text(encoding="utf-8"))
        python = build_environment(work / "venv", settings["build-system"]["requires"])
        backend = settings["build-system"]["build-backend"]
        raw = build(python, backend, "sdist", work / "tree", work)
        sdist = out / raw.name
        repack(raw, sdist, date)
        os.environ["GIBBS_CODEGEN_PURE"] = "1"
        (work / "own").mkdir()
        of_tree = build(python, backend, "wheel", work / "tree", work / "own")
        for pure in ("1", "0"):
            os.environ["GIBBS_CODEGEN_PURE"] = pure
            unpack(io.BytesIO(sdist.read_bytes()), work / pure)
            (unpacked,) = (work / pure).iterdir()
            wheel = build(python, backend, "wheel", unpacked, work)
            with zipfile.ZipFile(wheel) as files:
                has_extension = any("/_caller." in name for name in files.namelist())
            if pure == "1" and wheel.read_bytes() != of_tree.read_bytes():
                sys.exit("the wheel of the tree is not that of the sdist")
            if pure == "1" or has_extension:
                shutil.copyfile(wheel, out / wheel.name)
            else:
                print("no wheel with the extension: it could not be built here", file=sys.stderr)


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute())
