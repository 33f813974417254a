"""Names: one refusal for each way to do harm with one."""

from __future__ import annotations

import pytest

from gibbs_codegen.interface import signatures
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.names import (
    coordinate_of,
    identifier,
    link_label,
    name_fault,
    name_from,
    parameter_prefix,
    rotor_label,
    rotor_prefix,
)

HOSTILE = [
    "",
    "_arm",
    "9arm",
    "Arm",
    "arm-1",
    "arm.1",
    "../evil",
    "/etc/passwd",
    "a/b",
    "..",
    "arm\n",
    "a\nimport os",
    "*/ int evil(); /*",
    '"; evil()',
    "{{7*7}}",
    "__import__('os')",
    "ﬁeld",
    "аrm",
    "arm\x00",
    "A" * 64,
    "a" * 65,
    "class",
    "lambda",
    "while",
    "numpy",
    "gibbs_runtime",
    "arm_hybrid",
    "arm_default",
    "arm_init",
    "arm_mass_matrix_and",
]


# Words of C, headers and modules of Python.
FAMILIAR = ["double", "main", "register", "math", "time", "imp", "match", "sympy", "gibbs_codegen"]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_are_refused(name: str) -> None:
    message = name_fault(name)
    assert message
    assert "\n" not in message
    assert message.isascii()
    assert message.startswith(ascii(name) if len(name) <= 64 else f"'{name[:61]}...' ")


@pytest.mark.parametrize("name", ["a", "a" * 64, "hexarotor_3link", "int_arm", "x9_", *FAMILIAR])
def test_plain_names_are_welcome(name: str) -> None:
    assert name_fault(name) is None


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("My-UAV", "my_uav"),
        ("my uav 2", "my_uav_2"),
        ("2quads", "robot_2quads"),
        ("class", "class_robot"),
        ("rö", "r"),
        ("", "robot"),
    ],
)
def test_a_name_is_made_of_any_text(text: str, name: str) -> None:
    assert name_from(text) == name


@pytest.mark.parametrize("text", HOSTILE)
def test_what_is_made_of_hostile_text_is_accepted(text: str) -> None:
    assert name_fault(name_from(text)) is None


def test_no_two_robots_can_share_a_name_in_c() -> None:
    """No symbol of a robot goes on as one of a robot whose name is the longer."""
    functions = [s.name for s in signatures(Description(paper_family(2, 0)).lists())]
    own = ["real", "constants", "pack", "unpack", "init_constants", "default_constants"]
    symbols = {*functions, *(f"{f}_batch" for f in functions), *own, "default_parameters"}
    for symbol in symbols:
        for other in symbols:
            if symbol.endswith(f"_{other}"):
                assert name_fault(f"arm_{symbol.removesuffix(f'_{other}')}") is not None, symbol


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("arm 1.2", "arm_1_2"),
        ("élbow", "_lbow"),
        ("1st", "_1st"),
        ("*/ f();", "___f___"),
        ("a", "a"),
    ],
)
def test_identifier_forms(text: str, form: str) -> None:
    assert identifier(text) == form


@pytest.mark.parametrize("text", [text for text in HOSTILE if text])
def test_identifier_forms_of_hostile_text_are_identifiers(text: str) -> None:
    assert identifier(text).isidentifier()
    assert identifier(text).isascii()


def test_what_links_rotors_and_coordinates_are_called() -> None:
    robot = parse_robot(
        "name = 'named'\n[base]\nmass = 1\n[[rotor]]\n[[rotor]]\nname = 'left 2'\n"
        "[[link]]\nmass = 1\n[[link]]\nmass = 1\nname = \"fore\\tarm\"\njoint = 'prismatic'\n"
        "[[link]]\nmass = 1\nname = 'hand'\ncoordinate = 'wrist-roll'\n"
        "[[link]]\nmass = 1\njoint = 'prismatic'\n"
    )
    links = range(1, 5)
    assert [coordinate_of(robot, i) for i in links] == ["theta_3", "fore_arm", "wrist_roll", "d_6"]
    assert [link_label(robot, i) for i in links] == ["link 1", "fore\\tarm", "hand", "link 4"]
    assert [parameter_prefix(robot, i) for i in links] == ["link1", "fore_arm", "hand", "link4"]
    assert [rotor_label(robot, k) for k in (1, 2)] == ["1", "left 2"]
    assert [rotor_prefix(robot, k) for k in (1, 2)] == ["rotor1", "left_2"]
