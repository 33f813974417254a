"""The soak command: quiet where all agree, and where not the command that repeats it."""

from __future__ import annotations

import argparse
import functools
import io

import pytest
import soak
from rich.console import Console


def run(robots: int, bases: bool = False, seed: int = 5) -> tuple[bool, str]:
    """Whether all is well, and what is printed to a pipe."""
    console = Console(file=io.StringIO())
    arguments = argparse.Namespace(
        seed=seed, robots=robots, only=None, minutes=5.0, compile_every=1000, bases=bases
    )
    good = soak.soak(arguments, console)
    return good, console.file.getvalue()


@pytest.mark.slow
@pytest.mark.parametrize(("bases", "seed"), [(False, 5), (True, 2)])
def test_robots_that_agree_are_counted(bases: bool, seed: int) -> None:
    """Of those on bases of all kinds the first is compared with all functions and derivatives.

    Its base is upright, and three links have a constraint and springs.
    """
    good, said = run(1, bases, seed)
    assert good
    assert said.startswith("1 compared, 0 failed\n")
    assert "forward_dynamics" in said


@pytest.mark.slow
@pytest.mark.parametrize("number", [495, 575])
def test_rows_that_are_short_or_nothing_but_rounding_agree(number: int) -> None:
    """The first of six redundant rows holds little; a base cannot leave a plane of its arm."""
    assert soak.check(soak.soak_robot(7, number), number, compiled=False)[0] == "compared"


def test_a_failure_says_how_to_repeat_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def check(robot, number, compiled):
        if number == 1:
            raise soak.DisagreementError("M: 7")
        return "compared", {"M": 0.1 * number}

    monkeypatch.setattr(soak, "check", check)
    good, said = run(robots=3)
    assert not good
    assert "robot 1: DisagreementError: M: 7\n    python tests/soak.py --seed 5 --only 1\n" in said
    assert "2 compared, 1 failed" in said
    assert "robot 2" in said.splitlines()[-1]


@pytest.mark.slow
def test_a_wrong_module_is_a_disagreement(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error beyond what is allowed, and one that is not a number."""
    robot = soak.soak_robot(5, 0)
    monkeypatch.setattr(soak, "derive", functools.cache(soak.derive))
    for error in (1.5, float("nan")):
        monkeypatch.setattr(soak, "compare", lambda *_, e=error: {"M": 0.5, "R": e})
        with pytest.raises(soak.DisagreementError, match=r"^R: "):
            soak.check(robot, 0, compiled=False)
