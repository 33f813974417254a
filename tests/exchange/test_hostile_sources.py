"""Hostile URDF, MJCF and files of rotors: refused in words, exit code 2, nothing written."""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gibbs_codegen.cli.app import main

SOURCES = Path(__file__).parent / "sources"
LINK = (
    '<link name="{}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/></joint>'


def chain(count: int, kind: str) -> str:
    """A chain of links on joints of a kind."""
    links = "".join(LINK.format(f"l{i}") for i in range(count + 1))
    joints = "".join(JOINT.format(f"j{i}", kind, f"l{i}", f"l{i + 1}") for i in range(count))
    return f'<robot name="r">{links}{joints}</robot>'


LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
TWO = LINK.format("a") + LINK.format("b")
MJCF = "<mujoco><worldbody><body><freejoint/>{}</body></worldbody></mujoco>"
HOSTILE: dict[str, tuple[str | bytes, str]] = {
    "nothing": ("", "not well-formed XML"),
    "junk": (bytes(range(256)) * 64, "not well-formed XML"),
    "zeros": (bytes(100_000), "not well-formed XML"),
    "text": ("a robot", "not well-formed XML"),
    "encoding": ('<?xml version="1.0" encoding="ebcdic-zz"?><robot/>', "not well-formed XML"),
    "entities": (
        f'<!DOCTYPE r [<!ENTITY l0 "ha">{LAUGHS}]><robot name="&l9;"/>',
        "declares a document type",
    ),
    "external": ('<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot/>', "declares a document type"),
    "undeclared": ("<robot>&a;</robot>", "not well-formed XML"),
    "unclosed": ("<robot><link", "not well-formed XML"),
    "nested": ("<robot>" + "<a>" * 100_000, "nested more than 300 deep"),
    "flood": ("<robot>" + "<a/>" * 300_000 + "</robot>", "more than 200000 elements"),
    "fifty megabytes": (b"<robot>" + b" " * 50_000_000 + b"</robot>", "larger than 10000000 bytes"),
    "other": ("<svg/>", "MJCF has <mujoco>, SDF has <sdf>"),
    "sdf of nothing": ('<sdf version="1.6"/>', "holds 0 models that move (none)"),
    "sdf version": ('<sdf version="one"><model/></sdf>', "version must be like 1.9, not one"),
    "sdf empty": ('<sdf version="1.6"><model name="m"/></sdf>', "has no <link>"),
    "sdf itself": (
        '<sdf version="1.9"><model name="m"><include><uri>robot.xml</uri></include></model></sdf>',
        "includes itself",
    ),
    "sdf frames": (
        '<sdf version="1.7"><model name="m"><frame name="F"/></model></sdf>',
        "no <link>",
    ),
    "sdf rests": (
        '<sdf version="1.7"><model name="m"><static>1</static></model></sdf>',
        "m is <static>",
    ),
    "sdf circles": (
        '<sdf version="1.9"><model name="m">'
        + "".join(
            f'<link name="l{i}"><pose relative_to="l{(i + 1) % 200}"/></link>'
            + f'<joint name="j{i}" type="fixed"><parent>l{i}</parent>'
            + f"<child>l{i + 1}</child></joint>"
            for i in range(200)
        )
        + '<link name="l200"/></model></sdf>',
        "to itself through others",
    ),
    "sdf chain": (
        '<sdf version="1.9"><model name="m"><link name="f0"/>'
        + "".join(
            f'<frame name="f{i}"><pose relative_to="f{i - 1}">0 0 0 1 2 3</pose></frame>'
            for i in range(1, 420)
        )
        + "</model></sdf>",
        "relative to more than 400 others",
    ),
    "sdf flood": (
        '<sdf version="1.9"><model name="m">' + "<link/>" * 5000 + "</model></sdf>",
        "more than 1000 links, joints and frames",
    ),
    "sdf huge": (
        '<sdf version="1.9"><model name="m"><link name="a"><pose>1e99 0 0 0 0 0</pose></link>'
        "</model></sdf>",
        "finite number",
    ),
    "empty": ("<robot/>", "has no <link>"),
    "cycle": (
        f"<robot>{TWO}{JOINT.format('1', 'fixed', 'a', 'b')}{JOINT.format('2', 'fixed', 'b', 'a')}"
        "</robot>",
        "form a closed loop",
    ),
    "own parent": (f"<robot>{TWO}{JOINT.format('1', 'fixed', 'b', 'b')}</robot>", "closed loop"),
    "two roots": (f"<robot>{TWO}</robot>", "2 links are not the child of a joint: a, b"),
    "twice": (f"<robot>{LINK.format('a')}{LINK.format('a')}</robot>", "another link of that name"),
    "no mass": ('<robot><link name="a"/></robot>', "mass"),
    "huge": (f"<robot>{LINK.format('a').replace('1', '1e400')}</robot>", "finite number"),
    "digits": (f"<robot>{LINK.format('a').replace('1', '9' * 9000)}</robot>", "finite number"),
    "controls": ('<robot><link name="a&#10;&#9;b"/></robot>', "printable characters"),
    "long": (f'<robot><link name="{"a" * 9999}"/></robot>', "200 printable characters"),
    "many links": (chain(65, "continuous"), "65 moving links"),
    "floating": (chain(3, "floating"), "is floating, which only a joint at the root may be"),
    "mjcf of nothing": ("<mujoco/>", "holds 0 robots"),
    "mjcf nan": (MJCF.format('<geom size="nan"/>'), "size must be finite"),
    "mjcf shape": (MJCF.format('<geom type="dodo"/>'), "MuJoCo refuses it"),
    "mjcf inertia": (
        MJCF.format('<inertial mass="1" pos="0 0 0" diaginertia="1 1 9"/>'),
        "MuJoCo refuses it",
    ),
    "mjcf mesh": (
        '<mujoco><asset><mesh name="m" file="no.obj"/></asset><worldbody><body><freejoint/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
        "no.obj",
    ),
    "mjcf include": ('<mujoco><include file="no.xml"/></mujoco>', "no.xml: no such file"),
    "mjcf itself": ('<mujoco><include file="robot.xml"/></mujoco>', "is included already"),
    "mjcf copies": (
        MJCF.format(
            '<replicate count="0"/><replicate count="99"><replicate count="99"><geom size="1"/>'
            "</replicate></replicate>"
        ),
        "more than 1000 copies",
    ),
    "mjcf builtin mesh": (
        '<mujoco><asset><mesh name="m" builtin="supersphere" params="3000 1 1"/></asset>'
        '<worldbody><body><freejoint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
        "built-in meshes and meshes of plugins are not imported",
    ),
    "mjcf two": (
        "<mujoco><worldbody>"
        + '<body><freejoint/><geom size="1"/></body>' * 2
        + "</worldbody></mujoco>",
        "holds 2 robots (body_1, body_2); choose one with --base LINK",
    ),
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name == "flood" else name for name in HOSTILE],
)
def test_hostile_files_are_refused(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    data, message = HOSTILE[name]
    monkeypatch.chdir(tmp_path)
    source = tmp_path / "robot.xml"
    source.write_bytes(data if isinstance(data, bytes) else data.encode())
    begin = time.process_time()
    code = main(["import", "robot.xml", "--attitude", "xyz", "--out", "out.toml"])
    assert time.process_time() - begin < 20
    said = capfd.readouterr()
    assert code == 2
    assert message in said.err
    assert len(said.err) < 5000
    assert said.out == ""
    assert os.listdir() == ["robot.xml"]


@pytest.mark.slow
def test_long_chains_of_welds_are_no_trouble(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(chain(400, "fixed"))
    words = ["import", str(path), "--base", "l400", "--out", str(tmp_path / "o.toml")]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "and 350 more" in said
    assert len(said.splitlines()) < 120


@pytest.mark.slow
def test_names_of_one_form_take_no_longer(tmp_path: Path) -> None:
    path, names = tmp_path / "robot.urdf", [chr(0x4E00 + i) for i in range(1500)]
    links = "".join(f'<link name="{name}"/>' for name in names)
    joints = "".join(JOINT.format(f"j{name}", "fixed", "a", name) for name in names)
    path.write_text(f'<robot name="r">{LINK.format("a")}{links}{joints}</robot>', encoding="utf-8")
    begin = time.process_time()
    assert main(["import", str(path), "--out", str(tmp_path / "o.toml")]) == 0
    assert time.process_time() - begin < 20


def test_deep_bodies_of_mjcf_are_no_trouble(tmp_path: Path) -> None:
    path, body = tmp_path / "robot.xml", '<body><geom size="1"/>'
    path.write_text(MJCF.format('<geom size="1"/>' + body * 120 + "</body>" * 120))
    assert main(["import", str(path), "--out", str(tmp_path / "o.toml")]) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[rotor]]\non = 'hab'", "rotor 1: on: there is no link hab; did you mean hub?"),
        ("[[rotor]]\ndrag = nan", "rotors.toml:2: rotor 1: drag: must be a finite number"),
        ("[[rotor]]\npositon = [0, 0, 0]", "unknown key; did you mean position?"),
        ("rotor = 3", "must be an array of tables"),
        ("", "missing"),
    ],
)
def test_files_of_rotors(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rotors, out = tmp_path / "rotors.toml", tmp_path / "out.toml"
    rotors.write_text(text)
    words = ["import", str(SOURCES / "features.urdf"), "--attitude", "xyz"]
    assert main([*words, "--rotors", str(rotors), "--out", str(out)]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


PLATFORM = """platform: {cf: 1.0e-5, cm: 2.0e-7, max_thrust: 9.0, min_thrust: 0.1,
  $rotors: [{translation: [0, 0, 0], orientation: [0, 0, 0, 1], spin_direction: [-1]}]}"""


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("[-1]", "[]", "a value is missing or of another kind"),
        ("[-1]", "9" * 400, "a value is missing or of another kind"),
        ("[-1]", '!!timestamp "abc"', "it has none"),
        ("[-1]", '!!int ""', "it has none"),
        ("[0, 0, 0, 1]", "[0, 0, 0, 0]", "orientation must be a quaternion"),
        ("1.0e-5", "0", "a value is missing or of another kind"),
        ("[0, 0, 0]", "&a [*a, *a, *a]", "anchors are not read"),
        ("[0, 0, 0]", "[" * 500, "it has none"),
        ("[0, 0, 0]", "[" + "0, " * 100_000 + "]", "more than 100000 characters"),
        (PLATFORM, "", "it has none"),
        ("cf:", "cg:", "cf is missing"),
        ("}]}", "}", "line 2 is not YAML"),
    ],
)
def test_hostile_platforms(
    right: str, wrong: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rotors, out = tmp_path / "platform.yaml", tmp_path / "out.toml"
    assert right in PLATFORM
    rotors.write_text(PLATFORM.replace(right, wrong, 1))
    words = ["import", str(SOURCES / "features.urdf"), "--rotors", str(rotors), "--out", str(out)]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "platform.yaml: not a platform file of eagle_mpc" in said
    assert message in said
    assert not out.exists()


def test_faults_of_rotors_name_their_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rotors = tmp_path / "platform.yaml"
    rotors.write_text(PLATFORM.replace("max_thrust: 9.0", "max_thrust: -9.0"))
    words = ["import", str(SOURCES / "features.urdf"), "--rotors", str(rotors)]
    assert main([*words, "--out", str(tmp_path / "out.toml")]) == 2
    assert f"features.urdf: rotor rotor_1 of {rotors}: limits: " in capsys.readouterr().err


WORDS = (
    *("nan", "inf", "-1", "0", "1e400", "1e-320", "1e49", "", "x", "base", "world", "hub", "&lt;"),
    *("fixed", "floating", "prismatic", "continuous", "0 0 0", "1 0", "0 0 1", "9" * 400, "☃"),
)


def mutant(text: str, choose: random.Random) -> bytes:
    """The text with a few things broken: bytes, values, lines or elements."""
    data = bytearray(text.encode())
    for _ in range(choose.randint(1, 4)):
        kind, place = choose.randrange(6), choose.randrange(len(data))
        if kind == 0:
            data[place] = choose.randrange(256)
        elif kind == 1:
            del data[place : place + choose.randint(1, 60)]
        elif kind == 2:
            piece = data[place : place + choose.randint(1, 300)]
            other = choose.randrange(len(data))
            data[other:other] = piece
        else:  # Another value for an attribute: what most faults of people are.
            first = data.find(b'="', place)
            last = data.find(b'"', first + 2)
            if 0 <= first < last:
                data[first + 2 : last] = choose.choice(WORDS).encode()
    return bytes(data)


def check_mutants(name: str, seeds: range, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Import mutants of a file: each is imported, or refused with a message."""
    text = (SOURCES / name).read_text()
    source, out = folder / name, folder / "out.toml"
    for seed in seeds:
        source.write_bytes(mutant(text, random.Random(seed)))  # noqa: S311
        code = main(["import", str(source), "--attitude", "xyz", "--out", str(out)])
        said = capfd.readouterr()
        assert code in (0, 2), seed
        assert out.exists() == (code == 0), seed
        assert (said.err != "") == (code == 2), seed
        out.unlink(missing_ok=True)


FILES = (
    "features.urdf",
    "everything.urdf",
    "hydrus.urdf",
    "arm_with_ball_joint.xml",
    "features.sdf",
)


@pytest.mark.parametrize("name", FILES)
def test_mutants(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    check_mutants(name, range(15), tmp_path, capfd)


@pytest.fixture
def imported(tmp_path: Path) -> Callable[..., int]:
    """Import a file of features to out.toml."""
    words = ["import", str(SOURCES / "features.urdf"), "--attitude", "xyz"]
    return lambda *more: main([*words, "--out", str(tmp_path / "out.toml"), *more])


def test_a_file_is_replaced_by_force_only(
    imported: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.toml"
    out.write_text("mine")
    assert imported() == 2
    assert "exists already; choose another name, or replace it with --force" in (
        capsys.readouterr().err
    )
    assert out.read_text() == "mine"
    assert imported("--force") == 0
    assert out.read_text().startswith("# Imported from features.urdf by gibbs-codegen import.")
    assert [path.name for path in tmp_path.iterdir()] == ["out.toml"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--lock", "right=fast"], "give JOINT or JOINT=VALUE, VALUE in rad or m"),
        (["--lock", "right=nan"], "give JOINT or JOINT=VALUE, VALUE in rad or m"),
        (["--attitude", "zzz"], "--attitude must be one of xyz"),
        (["--rotors", "no.toml"], "no.toml: no such file"),
        (["--rotors", "."], "is not a file"),
    ],
)
def test_wrong_options(
    words: list[str],
    message: str,
    imported: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert imported(*words) == 2
    assert message in capsys.readouterr().err
