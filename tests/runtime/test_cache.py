"""The cache of compiled libraries: private, verified, atomic."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gibbs_codegen.runtime.cache import GIVEN_UP, CacheError, cache_folder, cached_library


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Maker:
    """Writes a library and counts how often."""

    def __init__(self, content: bytes = b"library") -> None:
        self.content = content
        self.calls = 0

    def __call__(self, output: Path) -> None:
        """Write it."""
        self.calls += 1
        output.write_bytes(self.content)


def test_made_once_and_kept(folder: Path) -> None:
    make = Maker()
    path = cached_library("key", make)
    assert cached_library("key", make) == path
    assert make.calls == 1
    assert path.read_bytes() == b"library"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert cached_library("other key", make) != path
    assert make.calls == 2


@pytest.mark.parametrize("change", ["edit", "truncate", "remove", "digest", "link", "empty"])
def test_what_was_changed_is_made_anew(change: str, folder: Path, tmp_path: Path) -> None:
    path = cached_library("key", Maker())
    if change == "edit":
        path.write_bytes(b"Library")
    elif change == "truncate":
        path.write_bytes(b"")
    elif change == "remove":
        path.unlink()
    elif change == "digest":
        (path.parent / "sha256").write_text("0" * 64)
    elif change == "link":
        (tmp_path / "planted").write_bytes(b"library")
        path.unlink()
        path.symlink_to(tmp_path / "planted")
    else:
        for file in path.parent.iterdir():
            file.unlink()
    make = Maker()
    assert cached_library("key", make) == path
    assert make.calls == 1
    assert path.read_bytes() == b"library"
    assert not path.is_symlink()


def test_a_loaded_library_does_not_change(folder: Path) -> None:
    """A bad entry is moved aside: whoever has it open keeps what it has."""
    path = cached_library("key", Maker())
    path.write_bytes(b"edited")
    with path.open("rb") as opened:
        cached_library("key", Maker())
        assert opened.read() == b"edited"
    assert path.read_bytes() == b"library"


def test_a_failure_leaves_nothing(folder: Path) -> None:
    def fail(output: Path) -> None:
        output.write_bytes(b"half")
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        cached_library("key", fail)
    assert [path.name for path in folder.iterdir() if path.is_dir()] == []
    make = Maker()
    cached_library("key", make)
    assert make.calls == 1


def test_who_waits_for_another_can_give_up() -> None:
    begun, go_on = threading.Event(), threading.Event()

    def make(output: Path) -> None:
        output.write_bytes(b"library")
        begun.set()
        go_on.wait()

    with ThreadPoolExecutor(2) as pool:
        try:
            makes = pool.submit(cached_library, "key", make)
            begun.wait()
            waits = pool.submit(cached_library, "key", Maker())
            GIVEN_UP.set()
            with pytest.raises(CacheError, match="lock"):
                waits.result()
        finally:
            GIVEN_UP.clear()
            go_on.set()
        path = makes.result()
    assert path.read_bytes() == b"library"


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda f: f.chmod(0o755), "chmod 700"),
        (lambda f: (f.rename(f.with_name("real")), f.symlink_to(f.with_name("real"))), "folder"),
        (lambda f: (f.rmdir(), f.write_text("")), "File exists"),
    ],
)
def test_a_folder_that_is_not_private_is_not_used(spoil, reason: str, folder: Path) -> None:
    folder.mkdir(mode=0o700)
    spoil(folder)
    make = Maker()
    with pytest.raises(CacheError, match=reason):
        cached_library("key", make)
    assert make.calls == 0


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_the_folder_of_another_user_is_not_used(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    os.chown(folder, 12345, 12345)
    with pytest.raises(CacheError, match="another user"):
        cached_library("key", Maker())


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a file away")
@pytest.mark.parametrize("name", [".", "library.so", "sha256"])
def test_what_belongs_to_another_user_is_made_anew(name: str) -> None:
    path = cached_library("key", Maker())
    os.chown(path.parent / name, 12345, 12345)
    make = Maker()
    assert cached_library("key", make) == path
    assert make.calls == 1
    assert path.stat().st_uid == path.parent.stat().st_uid == 0


def test_a_parent_that_is_open_to_everybody_is_refused(folder: Path) -> None:
    folder.parent.chmod(0o777)
    with pytest.raises(CacheError, match="every user can write"):
        cached_library("key", Maker())


def test_a_full_cache_may_be_read_only(folder: Path) -> None:
    """What is there serves; only making it needs to write."""
    path = cached_library("key", Maker())
    folder.chmod(0o500)
    try:
        assert cached_library("key", Maker()) == path
    finally:
        folder.chmod(0o700)


def test_what_a_killed_process_left_is_removed(folder: Path) -> None:
    cached_library("key", Maker())
    stale, young = (folder / f".gibbs_codegen_new_{age}" for age in ("stale", "young"))
    for left in (stale, young):
        left.mkdir()
    os.utime(stale, (0, 0))
    cached_library("other", Maker())
    assert not stale.exists()
    assert young.exists()


def test_a_relative_path_is_made_absolute(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", "here")
    assert cache_folder() == tmp_path / "here"
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", "~/there")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "there"


def test_where_the_cache_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("GIBBS_CODEGEN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "gibbs_codegen"


@pytest.mark.parametrize("home", ["here", "absolute"])
def test_a_relative_home_is_not_followed(
    home: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Nothing is kept in the working directory, in which a library might have been planted."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GIBBS_CODEGEN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    monkeypatch.setenv("HOME", home if home == "here" else str(tmp_path / home))
    try:
        folder = cache_folder()
    except RuntimeError:  # Not every version of platformdirs asks the system for the home then.
        return
    assert folder.is_absolute()
    assert folder.is_relative_to(tmp_path) == (home == "absolute")


@pytest.mark.parametrize("answer", [Path("relative"), RuntimeError("no home")], ids=str)
def test_without_a_home_nothing_is_kept(
    answer: Path | Exception, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def user_cache_path(*_: str, **__: bool) -> Path:
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GIBBS_CODEGEN_CACHE")
    monkeypatch.setattr("platformdirs.user_cache_path", user_cache_path)
    with pytest.raises(CacheError, match="no home folder"):
        cached_library("key", Maker())
    assert os.listdir(tmp_path) == []


def slow(output: Path) -> None:
    with (output.parents[2] / "calls").open("a") as calls:
        calls.write("x")
    output.write_bytes(b"half")
    time.sleep(0.3)
    output.write_bytes(b"whole")


def read(_: int) -> bytes:
    return cached_library("key", slow).read_bytes()


@pytest.mark.slow
def test_many_processes_at_once(folder: Path) -> None:
    """One makes it; all of them get the whole of it."""
    with multiprocessing.get_context("spawn").Pool(4) as pool:
        assert pool.map(read, range(4), chunksize=1) == [b"whole"] * 4
    assert (folder / "calls").read_text() == "x"
