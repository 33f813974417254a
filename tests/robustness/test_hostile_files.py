"""Broken and hostile files: each is read, or refused in words that help."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.mutations import mutant
from support.random_robots import random_robot, random_tree

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.errors import (
    GibbsCodegenError,
    RefusedFileError,
    RobotFileError,
    ScenarioFileError,
)
from gibbs_codegen.flight.scenario.file import parse_scenario, read_scenario, shipped_scenarios
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.robot.file import parse_robot, read_robot, shipped_robots
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.targets.registry import TARGETS, render_module

EVERYTHING = Path(__file__).parents[1] / "robots" / "everything.toml"
ROBOTS = [read_robot(name)[1] for name in shipped_robots()]
ROBOTS += [robot_text(random_robot(seed, 2 + seed % 4, seed % 4)) for seed in range(20)]
TREES = [EVERYTHING.read_text(encoding="utf-8")]
TREES += [robot_text(random_tree(seed)) for seed in range(12)]
SCENARIOS = [
    (resources.files("gibbs_codegen") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")
    for name in shipped_scenarios()
]

# What the message of a fault may be: each says what would be right, or what cannot be.
HELPFUL = re.compile(
    r"missing|must |unknown key; (did you mean|known keys)|not valid TOML: |nested too deeply: at"
    r" most|not UTF-8 text \(byte \d+\); save it as UTF-8|larger than \d+ bytes|give (at most|one"
    r"|as many)|use a lower-case letter|add a word|a direction of length zero; give|(belongs to|n"
    r"eeds) .*[:;] give|give a scenario here|is not zero although the body has no mass|an inertia"
    r" matrix is positive semidefinite|no principal moment may exceed|lower it|take longer ones|t"
    r"he robot has no mass; give|give the link a name|already; give another|: give it another nam"
    r"e|leave it out[;:] give it"
)


def assert_helpful(refusal: RefusedFileError, source: str) -> None:
    """Every fault names the file, key or line unless it is no text, and what would be right."""
    assert refusal.faults
    for line in str(refusal).split("\n"):
        assert line.startswith(source), line
        assert line.isprintable(), line
        assert len(line) < 500, line
    for fault in refusal.faults:
        whole_file = fault.message.startswith(("not UTF-8", "larger than"))
        assert fault.path or fault.line or whole_file, fault
        assert HELPFUL.search(fault.message), fault


def check_robot_file(number: int, file: Path) -> Robot | None:
    """The robot of a mutant, if it is one."""
    return read_mutant(mutant(ROBOTS, number), file)


def check_tree_file(number: int, file: Path) -> Robot | None:
    """The robot of a mutant of a tree, if it is one."""
    return read_mutant(mutant(TREES, number), file)


def read_mutant(text: bytes, file: Path) -> Robot | None:
    """The robot of a text, if it is one, whose own text must give it again."""
    file.write_bytes(text)
    try:
        robot = read_robot(str(file))[0]
    except RobotFileError as refusal:
        assert_helpful(refusal, file.name)
        return None
    assert parse_robot(robot_text(robot)) == robot
    return robot


def check_scenario(number: int, file: Path) -> Scenario | None:
    """The scenario of a mutant, if it is one; its paths give what is asked of them."""
    file.write_bytes(mutant(SCENARIOS, number))
    try:
        scenario = read_scenario(str(file))
    except ScenarioFileError as refusal:
        assert_helpful(refusal, file.name)
        return None
    for path in (scenario.base, scenario.arm.tip):
        if path is not None:
            assert path(np.linspace(0.0, scenario.duration, 3)).shape == (3, 4, 3)
    return scenario


def check_all(
    numbers: range, check: Callable[[int, Path], Any], monkeypatch: pytest.MonkeyPatch, folder: Path
) -> list[Any]:
    """What `check` returns for each mutant; a failure tells the number that makes it again."""
    monkeypatch.chdir(folder)
    found = []
    for number in numbers:
        try:
            found.append(check(number, Path("hostile.toml")))
        except Exception as error:
            raise AssertionError(f"mutant {number}: {type(error).__name__}: {error}") from error
    return found


def assert_both(found: list[Any]) -> None:
    """A generator of files that are all read, or all refused, would show little."""
    accepted = sum(each is not None for each in found)
    assert 0.05 * len(found) < accepted < 0.5 * len(found)


@pytest.mark.slow
@pytest.mark.parametrize("check", [check_robot_file, check_tree_file])
def test_hundreds_of_broken_robot_files(
    check: Callable[[int, Path], Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert_both(check_all(range(400), check, monkeypatch, tmp_path))


def test_broken_scenario_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert_both(check_all(range(200), check_scenario, monkeypatch, tmp_path))


def check_derived(number: int, file: Path) -> bool | None:
    """Whether a mutant that is a small robot makes a module; None where it is no small robot."""
    robot = check_robot_file(number, file)
    if robot is None or robot.rotors > 3 or len(robot.links) > 2:
        return None
    try:
        files = render_module(derive(robot), robot_text(robot), TARGETS)
    except GibbsCodegenError as error:
        refusal = str(error)
    else:
        refusal = ""
    if refusal:
        assert re.fullmatch(r"\w+: .*(give what it moves mass.*|too large: .*)", refusal), refusal
        return False
    module: dict[str, Any] = {"__name__": robot.name}
    exec(compile(files["numpy_module.py"], "numpy_module.py", "exec"), module)  # noqa: S102
    q = np.linspace(0.1, 0.9, len(module["COORDINATES"]))
    assert np.all(np.isfinite(module["mass_matrix"](q)))
    return True


@pytest.mark.slow
def test_what_is_accepted_makes_a_module(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A robot file is accepted for good: what comes after it has nothing but physics to refuse."""
    assert True in check_all(range(40), check_derived, monkeypatch, tmp_path)


# Of one thing over and over, by its number: time must grow with the size, and no faster.
FLOODS: dict[str, Callable[[int], str]] = {
    "parts of a key": lambda n: "x" + ".x" * (n // 2) + " = 1",
    "parts of a table's name": lambda n: "[" + "x." * (n // 2) + "x]",
    "parts in an inline table": lambda n: "x = { x" + '."x"' * (n // 4) + " = 1 }",
    "parts with blanks": lambda n: "x" + "  .\t'x'" * (n // 7) + " = 1",
    "escaped quotes": lambda n: 'x = """\\""" ' + '\\"' * (n // 2) + '\n"""',
    "quotes without an end": lambda n: '"""\n' + '\\"""\n' * (n // 5),
    "arms": lambda n: "arm = [" + "{}," * (n // 3) + "]",
    "placed rotors": lambda n: "[[rotor]]\n" * (n // 10),
    "names": lambda n: "".join(f"[[link]]\nname = 'n{i}'\n" for i in range(n // 24)),
    "unknown parents": lambda n: f"[[link]]\nparent = '{'x' * (n // 80)}'\n" * 60,
    "letters of a name": lambda n: f"[[link]]\nname = '{'x' * n}'\n",
    "links": lambda n: "[[link]]\n" * (n // 9),
    "thrusts": lambda n: "thrust = [" + "1," * (n // 2) + "]",
    "unknown keys": lambda n: "".join(f"length{i} = 1\n" for i in range(n // 20)),
    "unknown tables": lambda n: "".join(f"[base{i}]\n" for i in range(n // 20)),
    "digits": lambda n: "rotors = " + "9" * n,
    "hexadecimal digits": lambda n: "attitude = [0x" + "f" * n + "]",
    "letters of a string": lambda n: 'attitude = "' + "x" * n + '"',
    "letters of a key": lambda n: "x" * n + " = 1",
    "brackets": lambda n: "x = " + "[" * n,
    "braces": lambda n: "x = " + "{ x = " * (n // 6),
    "blanks": lambda n: " " * n + "x",
    "lines": lambda n: "\n" * n + "x",
    "zero bytes": lambda n: "\0" * n,
}


@pytest.mark.slow
def test_a_flood_is_refused_soon() -> None:
    """Some took hours; the alarm is there for a hang alone, not to measure."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.alarm(60)
    try:
        for flood in FLOODS.values():
            text = f'name = "flood"\n[base]\n{flood(5_000)}\n'
            for parse, refused in (
                (parse_robot, RobotFileError),
                (parse_scenario, ScenarioFileError),
            ):
                with pytest.raises(refused) as refusal:
                    parse(text, "flood.toml")
                assert_helpful(refusal.value, "flood.toml")
                assert len(str(refusal.value)) < 20_000
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
