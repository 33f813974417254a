"""`gibbs-codegen view` as a user runs it; what a browser shows is tested in tests/flight/viewer."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from support.command import ENVIRONMENT, run
from support.synthetic_flight import synthetic_flight
from support.tools import HANGING

Shipped = Callable[[str], ModuleType]


@pytest.fixture
def workplace(shipped: Shipped, tmp_path: Path) -> Path:
    """A folder with a module in generated/, and the folder of a flight."""
    module = shipped("hexarotor_3link")
    shutil.copytree(Path(module.__file__ or "").parent, tmp_path / "generated" / "hexarotor_3link")
    (tmp_path / "flight").mkdir()
    synthetic_flight(module, samples=5).write_npz(tmp_path / "flight" / "flight.npz")
    (tmp_path / "flight.html").touch()
    return tmp_path


@pytest.mark.slow
def test_a_file_is_written_of_a_flight_and_of_a_robot(workplace: Path) -> None:
    for what, title in (
        ("flight", "hexarotor_3link, synthetic"),
        ("hexarotor_3link", "hexarotor_3link, one coordinate at a time"),
    ):
        (workplace / "out" / "page.html").unlink(missing_ok=True)
        done = run("view", what, "--html", "out/page.html", cwd=workplace)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith(f"out/page.html: {title}, 0.")
        page = (workplace / "out" / "page.html").read_text(encoding="utf-8")
        assert f"<title>{title}</title>" in page
        assert len(page) < 2_000_000
    assert [path.name for path in (workplace / "out").iterdir()] == ["page.html"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("nothing",), "nothing: "),
        (("flihgt",), "to show a flight, give a folder with a flight.npz"),
        (("flight/none.npz",), "is not a saved flight"),
        (("flight", "--html", "flight"), "give a name that ends in .html"),
        (("flight", "--html", "flight.html"), "flight.html: exists already"),
        (("flight", "--port", "0"), "a port is a number from 1 to 65535"),
    ],
)
def test_wrong_use_is_told(arguments: tuple[str, ...], told: str, workplace: Path) -> None:
    done = run("view", *arguments, cwd=workplace)
    assert done.returncode == 2
    assert told in done.stderr
    assert "Traceback" not in done.stderr


def test_a_place_that_cannot_be_written_is_told_before_anything_is_computed(
    workplace: Path,
) -> None:
    done = run("view", "nothing", "--html", "flight/flight.npz/page.html", cwd=workplace)
    told = "gibbs-codegen: flight/flight.npz/page.html: cannot be written: File exists\n"
    assert (done.returncode, done.stderr) == (1, told)


@pytest.mark.slow
def test_the_server_ends_with_ctrl_c(workplace: Path) -> None:
    command = [sys.executable, "-m", "gibbs_codegen", "view", "flight", "--no-browser"]
    with subprocess.Popen(
        [*command, "--port", "8700"],
        cwd=workplace,
        env=os.environ | ENVIRONMENT,
        stdout=subprocess.PIPE,
        text=True,
        # What runs in the background of a shell ignores Ctrl-C, and so do its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as server:
        try:
            assert server.stdout is not None
            for line in server.stdout:
                if "http://127.0.0.1:" in line:
                    break
            server.send_signal(signal.SIGINT)
            assert server.wait(HANGING) == 0
        finally:
            server.kill()
