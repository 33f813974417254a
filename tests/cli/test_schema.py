"""`schema`: what the reader accepts is valid, and what an editor can know to be wrong is not."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator  # nbformat needs it, too
from support.mutations import mutant
from support.random_robots import random_robot, random_tree

from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import RefusedFileError
from gibbs_codegen.flight.scenario.file import parse_scenario, shipped_scenarios
from gibbs_codegen.robot.file import parse_robot, shipped_robots
from gibbs_codegen.robot.text import placed_robot_text, robot_text

READERS = {"robot": parse_robot, "scenario": parse_scenario}

PATHS = {
    "fixed": "position = [1, 2, 3]",
    "harmonic": "x = [{ amplitude = 2, growth = -0.05, frequency = 1, phase_deg = 90 }]",
    "line": "start = [0, 0, 1]\nend = [1, 2, 3]\nduration = 4\nbegin = 0.5",
    "circle": "centre = [1, 2, 3]\nradius = 2\nperiod = 8\nnormal = [1, 0, 1]\nphase_deg = 30",
    "waypoints": "times = [0, 1, 3]\npoints = [[0, 0, 0], [1, 2, 3], [4, 4, 4]]",
}


def shipped(kind: str, name: str) -> str:
    folder = resources.files("gibbs_codegen") / f"{kind}s"
    return (folder / f"{name}.toml").read_text(encoding="utf-8")


TEXTS = {
    "robot": [
        *(shipped("robot", name) for name in shipped_robots()),
        (Path(__file__).parents[1] / "robots" / "everything.toml").read_text(encoding="utf-8"),
        *(robot_text(random_robot(seed, 2 + seed % 4, seed % 4)) for seed in range(10)),
        *(robot_text(random_tree(seed)) for seed in range(10)),
        placed_robot_text("placed", 5),
    ],
    "scenario": [
        *(shipped("scenario", name) for name in shipped_scenarios()),
        *(
            f'name = "path"\nduration = 3\n[base.path]\nkind = "{kind}"\n{text}\n'
            "[arm]\nposture = { d_8 = 1 }\nlimits_deg = { theta_7 = [-30, 30] }\n"
            "[motors]\nlimits = [0, 1]\n[push]\nframe = 'base'\ntorque = [0, 0, 1]\n"
            "[control]\nfrequency = 1\n"
            "[integration]\nstep = 0.01\n[start]\noffset = [0, 0, 1]\n[parameters]\ngravity = 1\n"
            for kind, text in PATHS.items()
        ),
    ],
}
CASES = [(kind, text) for kind, texts in TEXTS.items() for text in texts]


@pytest.fixture(scope="module")
def schemas() -> dict[str, Draft202012Validator]:
    """Validators of what the command prints."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        for kind in READERS:
            printed: list[str] = []
            patch.setattr("builtins.print", printed.append)
            assert main(["schema", kind]) == 0
            schema = json.loads(printed[0])
            Draft202012Validator.check_schema(schema)
            found[kind] = Draft202012Validator(schema)
    return found


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every container of a document with each of its keys or places."""
    inside: Any = value.items() if isinstance(value, dict) else ()
    for key, entry in enumerate(value) if isinstance(value, list) else inside:
        yield value, key
        yield from places(entry)


def faulty(document: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The document with one entry of another type, with one unknown, and without its keys."""
    changed = copy.deepcopy(dict(document))
    for container, key in [*places(changed)]:
        was = container[key]
        container[key] = "no" if isinstance(was, bool) else True
        yield f"{key} is of another type", changed
        container[key] = was
        if isinstance(was, dict) and key != "parameters":
            was["the colour"] = 1
            yield f"colour in {key}", changed
            del was["the colour"]
    yield "the colour", {**changed, "colour": 1}
    yield "nothing", {}


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        CASES[i]
        for i in (
            0,
            2,
            3,
            6,
            7,
            8,
            9,
            11,
            12,
            13,
            14,
            15,
            16,
            17,
            19,
            20,
            31,
            32,
            33,
            34,
            35,
            36,
            37,
            38,
            39,
            40,
            41,
            42,
            43,
        )
    ],
)
def test_what_is_right_is_valid_and_what_is_wrong_is_not(
    kind: str, text: str, schemas: dict[str, Draft202012Validator]
) -> None:
    document = tomllib.loads(text)
    READERS[kind](text)
    schemas[kind].validate(document)
    for what, wrong in faulty(document):
        assert not schemas[kind].is_valid(wrong), what


@pytest.mark.slow
def test_the_schema_refuses_nothing_that_is_read(
    schemas: dict[str, Draft202012Validator], tmp_path: Path
) -> None:
    accepted = 0
    for number in range(300):
        try:
            text = mutant(TEXTS["robot"], number).decode()
            READERS["robot"](text)
        except (RefusedFileError, UnicodeDecodeError):
            continue
        accepted += 1
        schemas["robot"].validate(tomllib.loads(text))
    assert accepted > 15


@pytest.mark.parametrize(
    ("kind", "was", "now"),
    [
        ("robot", "rotors   = 6", "rotors   = 1"),
        ("robot", 'attitude = "xyz"', 'attitude = "yaw"'),
        ("robot", 'name    = "hexarotor_3link"', 'name    = "Hexarotor"'),
        ("robot", 'thrust   = ["z"', 'thrust   = ["w"'),
        ("robot", "arm = { length = 0.5,", "arm = {"),
        ("robot", "arm = { length = 0.5,", "arm = { length = 0.5, mass = 1,"),
        ("robot", "arm = { length = 0.5,", "arm = { length = -0.5,"),
        ("robot", "[2.12e-06, 2.12e-07, 1.908e-06] }", "[2.12e-06, 2.12e-07] }"),
        ("robot", "alpha_deg = 90", "alpha_deg = 361"),
        ("robot", "alpha_deg = 90", "alpha_deg = 90\nxyz = [0, 0, 1]"),
        ("robot", "alpha_deg = 90", 'axis = "x"'),
        ("robot", "alpha_deg = 90", "limits = [0, 1]\nlimits_deg = [0, 1]"),
        ("robot", "alpha_deg = 90", 'name = ""'),
        ("robot", "alpha_deg = 90", 'constrained = "yes"'),
        ("robot", "rotors   = 6", "com = [0, 0, 1]"),
        ("scenario", 'kind = "tangent"', 'kind = "level"'),
        ("scenario", 'kind = "harmonic"', 'kind = "circle"'),
        ("scenario", "amplitude = 2, growth", "growth"),
        ("scenario", "duration    = 12.", "duration    = 99999."),
        ("scenario", "[arm.tip]", "[arm.posture_deg]\nd-8 = 1\n[arm.tip]"),
        ("scenario", "[arm.tip]", "[control]\nfrequency = 0\n[arm.tip]"),
    ],
)
def test_what_an_editor_can_know_to_be_wrong(
    kind: str, was: str, now: str, schemas: dict[str, Draft202012Validator]
) -> None:
    text = shipped(kind, {"robot": "hexarotor_3link", "scenario": "paper"}[kind])
    assert was in text
    wrong = text.replace(was, now, 1)
    assert not schemas[kind].is_valid(tomllib.loads(wrong))
    with pytest.raises(RefusedFileError):
        READERS[kind](wrong)


def test_every_key_has_a_description(schemas: dict[str, Draft202012Validator]) -> None:
    for validator in schemas.values():
        schema = validator.schema
        for table in (schema, *schema["$defs"].values()):
            assert table["description"]
            for key, described in table["properties"].items():
                assert described["description"], key


def test_a_new_robot_names_its_schema_first(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert main(["new", str(path)]) == 0
    assert path.read_text(encoding="utf-8").startswith("#:schema ./robot.schema.json\n")


def test_an_unknown_kind_of_file_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["schema", "path"])
    assert end.value.code == 2
    assert "invalid choice: 'path' (choose from" in capsys.readouterr().err
