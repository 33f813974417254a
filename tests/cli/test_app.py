"""The command line, run as a user runs it: exit codes, streams, files left behind."""

from __future__ import annotations

import fcntl
import io
import json
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from rich.console import Console
from support.command import ENVIRONMENT, run
from support.tools import HANGING

from gibbs_codegen.cli.terminal import plain_table, print_table
from gibbs_codegen.equations.typeset import text_width
from gibbs_codegen.robot.balance import implausible
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.parts.body import RigidBody, as_rigid_body
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")


def assert_refused(done: subprocess.CompletedProcess[str], folder: Path, message: str) -> None:
    """Exit 2, a message on stderr, no traceback, nothing written."""
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert not (folder / "generated").exists()


@pytest.mark.slow
def test_generate_writes_a_module_that_imports_by_itself(tmp_path: Path) -> None:
    done = run("generate", "quadrotor_2link", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    folder = tmp_path / "generated"
    assert sorted(p.name for p in folder.iterdir()) == ["quadrotor_2link"]
    code = (
        "import sys, quadrotor_2link as m; "
        "assert m.mass_matrix([0.0] * 8).shape == (8, 8); "
        "assert not {'sympy', 'jinja2', 'scipy', 'gibbs_codegen'} & set(sys.modules)"
    )
    alone = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert alone.returncode == 0, alone.stderr


def test_an_inertia_that_no_body_has_is_warned_of_where_the_file_lets_it_pass(
    tmp_path: Path,
) -> None:
    text = (
        "name = 'odd'\nallow_impossible_inertia = true\n[base]\nrotors = 2\n"
        "arm = { length = 1, mass = 1, inertia = [1, 1, 5, 0, 0, 0] }\n"
    )
    (tmp_path / "odd.toml").write_text(text)
    done = run("generate", "odd.toml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    warning = "gibbs-codegen: warning: base arm 1: its inertia violates the triangle inequality"
    assert done.stderr.startswith(warning)
    (tmp_path / "odd.toml").write_text(text.replace("true", "false"))
    refused = run("generate", "odd.toml", cwd=tmp_path)
    assert refused.returncode == 2
    assert "to allow it, give allow_impossible_inertia = true" in refused.stderr


@pytest.mark.slow
def test_check_tells_whether_the_module_is_up_to_date(tmp_path: Path) -> None:
    assert run("generate", "hexarotor", "--check", cwd=tmp_path).returncode == 1
    assert not (tmp_path / "generated").exists()
    assert run("generate", "hexarotor", cwd=tmp_path).returncode == 0
    assert run("generate", "hexarotor", "--check", cwd=tmp_path).returncode == 0
    module = tmp_path / "generated" / "hexarotor" / "numpy_module.py"
    module.write_text(module.read_text().replace("+", "-", 1))
    done = run("generate", "hexarotor", "--check", cwd=tmp_path)
    assert done.returncode == 1
    assert "numpy_module.py" in done.stderr
    (module.parent / "stray.py").write_text("")
    assert "stray.py" in run("generate", "hexarotor", "--check", cwd=tmp_path).stderr


@pytest.mark.slow
def test_generated_copy_of_the_robot_file_makes_the_same_module(tmp_path: Path) -> None:
    assert run("generate", "--rotors", "3", "--links", "1", cwd=tmp_path).returncode == 0
    folder = tmp_path / "generated" / "rotor3_1link"
    done = run("generate", "robot.toml", "--out", "..", "--check", cwd=folder)
    assert done.returncode == 0, done.stderr
    done = run("generate", "robot.toml", "--out", "..", "--target", "cuda", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "no longer has these files: __init__.py, gibbs_runtime.h, numpy_module.py" in done.stderr


@pytest.mark.slow
def test_all_parameters_keeps_zeros(tmp_path: Path) -> None:
    assert run("generate", "hexarotor", "--all-parameters", cwd=tmp_path).returncode == 0
    text = (tmp_path / "generated" / "hexarotor" / "numpy_module.py").read_text()
    assert '"base_drag_3": 0.0' in text
    assert "--out .\n#     --all-parameters\n" in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required"),
        (["flies"], "invalid choice"),
        (["generate"], "give ROBOT, or both --rotors and --links"),
        (["generate", "--rotors", "6"], "both --rotors and --links"),
        (["generate", "hexarotor", "--rotors", "6", "--links", "1"], "not both"),
        (["generate", "--rotors", "1", "--links", "1"], "rotors must be from 2"),
        (["generate", "--rotors", "4", "--links", "-1"], "links must be from 0"),
        (["generate", "--rotors", "four", "--links", "1"], "invalid int value"),
        (["generate", "nowhere.toml"], "no such robot file"),
        (["generate", "hexarotor", "--target", "cobol"], "known targets: numpy"),
        (["generate", "hexarotor", "--derivatives", "a,b"], "unknown"),
        (["info", "nowhere"], "no such robot file"),
        (["show", "rover_arm"], "chains cannot be shown with wheels that turn"),
        (["show", "--chain", "1"], "give ROBOT, or both --rotors and --links"),
        (["show", "hexarotor", "--chain", "7"], "chain 7: hexarotor has chains 1 to 6"),
        (["show", "hexarotor", "--chain", "0"], "chain 0: hexarotor has chains 1 to 6"),
        (["show", "hexarotor", "--chain", "1", "--equation", "3"], "known: 2, 5, 6, 15, 18"),
        (["show", "hexarotor", "--chain", "1", "--format", "word"], "invalid choice"),
        (["verify", "hexarotor", "--rows", "--json"], "not allowed with argument"),
        *(
            (
                ["identify", "hexarotor", "log", f"--prior={x}"],
                f"SHARE or NAME=SHARE, above 0, not {x}",
            )
            for x in ("base_mass", "base_mass=", "=0.1", "-1")
        ),
        (["info", "."], "is not a file"),
        (["info", "a" * 5000], "cannot be read"),
    ],
)
def test_wrong_use(arguments: list[str], message: str, tmp_path: Path) -> None:
    assert_refused(run(*arguments, cwd=tmp_path), tmp_path, message)


@pytest.mark.parametrize(
    "name", ["../evil", "/etc/x", "*/", "a\\nb", "class", "lambda", "NaN", "{{7*7}}", "x y"]
)
def test_hostile_names_in_a_file_are_refused(name: str, tmp_path: Path) -> None:
    text = f'name = "{name}"\n[base]\nrotors = 2\narm = {{ length = 1, mass_per_length = 1 }}\n'
    (tmp_path / "bad.toml").write_text(text)
    assert_refused(run("generate", "bad.toml", cwd=tmp_path), tmp_path, "bad.toml:1: name:")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "name: missing"),
        ("name = ", "not valid TOML"),
        ("name = 'a'\nname = 'b'", "not valid TOML"),
        ("gravity = nan\nname = 'a'\n[base]\nrotors = 2", "bad.toml:1: gravity: must be a finite"),
        ("#" * 10_000_001, "larger than"),
    ],
    ids=["empty", "syntax", "duplicate key", "NaN", "10 MB"],
)
def test_broken_files_are_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text(text)
    assert_refused(run("generate", "bad.toml", cwd=tmp_path), tmp_path, message)


def test_a_joint_that_nothing_resists_is_refused_by_name(tmp_path: Path) -> None:
    text = (
        'name = "limp"\n[base]\nrotors = 3\narm = { length = 1, mass_per_length = 1 }\n'
        "[[link]]\nlength = 1\n[[link]]\nlength = 1\n"
    )
    (tmp_path / "limp.toml").write_text(text)
    done = run("generate", "limp.toml", cwd=tmp_path)
    both = "theta_4 (the joint of link 1); theta_5 (the joint of link 2)"
    assert_refused(done, tmp_path, f"freedom, whose acceleration is not determined: {both};")


@pytest.mark.slow
def test_new_writes_a_file_that_generates(tmp_path: Path) -> None:
    done = run("new", "My UAV.toml", cwd=tmp_path)
    assert "a robot named my_uav" in done.stdout
    assert "gibbs-codegen generate 'My UAV.toml'" in done.stdout
    text = (tmp_path / "My UAV.toml").read_text()
    assert 'name    = "my_uav"' in text
    assert text.count("#") > 15
    assert run("generate", "My UAV.toml", cwd=tmp_path).returncode == 0
    assert (tmp_path / "generated" / "my_uav").is_dir()
    done = run("new", "My UAV.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "exists already" in done.stderr
    assert (tmp_path / "My UAV.toml").read_text() == text
    # The file was edited since: what derives takes it, what flies has the module of the old one.
    (tmp_path / "My UAV.toml").unlink()
    (tmp_path / "my_uav.toml").write_text(f"{text}\n# Edited.\n")
    assert run("info", "my_uav", cwd=tmp_path).stderr == ""
    done = run("export", "my_uav", "--format", "px4", cwd=tmp_path)
    assert "my_uav.toml differs from the file that generated/my_uav was made of" in done.stderr
    assert run("generate", "my_uav", cwd=tmp_path).returncode == 0
    assert (tmp_path / "generated" / "my_uav" / "robot.toml").read_text().endswith("# Edited.\n")


def test_new_shows_both_forms_of_a_body(tmp_path: Path) -> None:
    """What stands in comments is the same machine in the other form."""
    assert run("new", "my_uav.toml", cwd=tmp_path).returncode == 0
    text = (tmp_path / "my_uav.toml").read_text()
    rods = parse_robot(text)
    assert (rods.rotors, len(rods.links)) == (6, 3)
    head, _, last = text.rpartition("mass_per_length = 1.0\nsection_inertia")
    last = last.partition("\n")[2]
    kept = [line for line in head.splitlines() if not line.startswith("arm = ")]
    lines = [*kept, *last.splitlines()]
    for key in ("arm", "mass", "com", "inertia"):
        lines = [
            line.removeprefix("# ") if line.startswith(f"# {key} =") else line for line in lines
        ]
    rigid = parse_robot("\n".join(lines))
    pairs = [(rods.base.arm(1), rigid.base.arm(1)), (rods.links[-1].body, rigid.links[-1].body)]
    for rod, body in pairs:
        expected = as_rigid_body(rod)
        assert isinstance(body, RigidBody)
        assert (body.length, body.mass, body.com) == (expected.length, expected.mass, expected.com)
        assert body.inertia == pytest.approx(expected.inertia, rel=1e-5)


@pytest.mark.slow
def test_new_placed_writes_a_robot_that_flies_as_it_is(tmp_path: Path) -> None:
    written = run("new", "--placed", "my_uav.toml", cwd=tmp_path)
    assert (written.returncode, written.stderr) == (0, "")
    robot = parse_robot((tmp_path / "my_uav.toml").read_text())
    assert implausible(robot) == ()
    assert (robot.rotors, [link.pose is None for link in robot.links]) == (4, [False, False])
    assert run("generate", "my_uav.toml", cwd=tmp_path).returncode == 0
    hovering = ("--scenario", "hover", "--set", "duration=0.2", "--no-figures")
    flown = run("simulate", "my_uav", *hovering, "--backend", "numpy", cwd=tmp_path)
    assert flown.returncode == 0, flown.stderr


LEVEL = """
name = "level"
base = { motion = "fixed" }
[[link]]
name = "arm"
xyz = [0, 0, 0.2]
axis = "y"
mass = 1
com = [0.1, 0, 0.1]
[[link]]
name = "hand"
xyz = [0, 0, 0.2]
axis = "y"
mass = 1
com = [0.1, 0, 0]
gear = { of = "arm", ratio = -1, offset = 0.3 }
"""


@pytest.mark.slow
def test_info_folds_the_hybrid_matrix_by_gears(tmp_path: Path) -> None:
    """A base that does not fly has no row −1; the hand is level, and its angle a number in C."""
    (tmp_path / "level.toml").write_text(LEVEL)
    said = run("info", "level.toml", "--operations", cwd=tmp_path).stdout
    assert "\n   0 arm           1\n" in said
    assert "\n0    arm      1                      tau_arm" in said
    assert run("generate", "level.toml", cwd=tmp_path).returncode == 0


@pytest.mark.slow
def test_info_is_readable(tmp_path: Path) -> None:
    done = run("info", "hexarotor_3link", "--operations", cwd=tmp_path)
    assert done.returncode == 0
    assert "-1 → 0 → 1 → 7 → 8 → 9" in done.stdout
    assert "rank 6 of 6" in done.stdout
    assert "17   tau_prime_6  5" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 100
    assert "hover thrusts: 29.43, 0, 29.43, 0, 29.43, 0 N" in done.stdout
    assert "warning" not in done.stdout
    assert "Hint" not in done.stdout


def test_info_of_a_file_derives_nothing(tmp_path: Path) -> None:
    """Not even where rotors have limits, and as JSON."""
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['sympy'] = None\n")
    paths = {"PYTHONPATH": str(tmp_path)}
    for also in ([], ["--json"]):
        command = [sys.executable, "-m", "gibbs_codegen", "info", "quadrotor", *also]
        done = subprocess.run(
            command, env={**ENVIRONMENT, **paths}, cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        assert "mass_matrix_and_residual" not in done.stdout


def test_info_of_a_robot_without_rotors_tells_its_first_link_from_the_base(tmp_path: Path) -> None:
    body = "mass = 1.0\ninertia = [1, 1, 1, 0, 0, 0]\n"
    upper, fore = '[[link]]\nname = "upper"\n', '[[link]]\nname = "fore"\ncoordinate = "elbow"\n'
    grip = '[[constraint]]\nname = "grip"\ntype = "plane"\nframe = "tip"\nxyz = [0, 0, 2]\n'
    text = f'name = "two"\n[base]\n{body}{upper}{body}{fore}{body}{grip}'
    (tmp_path / "two.toml").write_text(text)
    done = run("info", "two.toml", cwd=tmp_path)
    lines = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert "1 base → upper → fore all its bodies - 8 -" in lines
    assert "fore revolute elbow 1 - -" in lines
    assert "fore upper 0 0 0 0" in lines
    assert "grip plane tip world 0, 0, 2 normal" in lines


def test_names_in_tables_stay_whole_where_no_terminal_folds_them() -> None:
    names = [letter * 60 for letter in "ab"]
    for is_terminal in (False, True):
        table = plain_table("A title that is told above the table", "one", "other")
        table.add_row(*names)
        console = Console(file=io.StringIO(), width=80, force_terminal=is_terminal)
        print_table(table, console)
        assert all((name in console.file.getvalue()) != is_terminal for name in names)
        assert console.width == 80


def test_tables_are_printed_as_they_are_with_a_title_where_they_have_one() -> None:
    console = Console(file=io.StringIO(), width=80)
    table = plain_table("title", "heading")
    print_table(table, console)
    print_table(table, console)
    print_table(plain_table("", "heading"), console)
    assert console.file.getvalue().split() == [*("title", "heading") * 2, "heading"]
    assert "\n\n" not in console.file.getvalue()


DRIVEN = """
name = "driven"
base = { mass = 1.8, inertia = [0.02, 0.02, 0.02, 0, 0, 0] }
battery = { voltage = [20, 20], resistance = 0, capacity = 3, auxiliary = 10 }
[[rotor]]
command = "throttle"
max_thrust = 30
full_speed = 600
time_constant = 0.02
[[rotor]]
command = "speed"
thrust_constant = 2e-5
command_limits = [0, 900]
[[link]]
xyz = [0, 0, -0.1]
mass = 0.2
inertia = [1e-3, 1e-3, 1e-3, 0, 0, 0]
servo = { stiffness = 30 }
friction = { coulomb = 0.1 }
"""


def test_info_of_actuators_has_commands_stiffnesses_and_how_long_the_battery_lasts(
    tmp_path: Path,
) -> None:
    (tmp_path / "driven.toml").write_text(DRIVEN, encoding="utf-8")
    said = run("info", "driven.toml", cwd=tmp_path).stdout
    lines = [" ".join(line.split()) for line in said.splitlines()]
    assert "link 1 revolute theta_3 0.2 - -" in lines
    told = " ".join(said[said.index("\nActuators") :].split())
    assert told.startswith(
        "Actuators, by the keys of the robot file (SI units); max_thrust and thrust_constant are "
        'shown as thrust_curve rotor 1: time_constant 0.02; command "throttle"; '
        "thrust_curve 0, 0, 30; "
        'command_limits 0, 1; full_speed 600 rotor 2: command "speed"; thrust_curve 0, 0, '
        "2e-05; command_limits 0, 900 servo of link 1: stiffness 30 friction of link 1: coulomb"
        " 0.1; static 0.1 battery: voltage 20, 20; resistance 0; capacity 3; nominal 20; "
        "auxiliary 10 Rotors: "
    )
    assert (
        "`trim` varies the attitude; its argument `free` may name any of attitude, theta_3" in lines
    )
    assert "1 base 0, 0, 0 z 0 0 … 30 N" in lines
    assert "2 base 0, 0, 0 z 0 0 … 16.2 N" in lines
    assert "hover throttle: 57.18 % (rotor 1), with a full battery; 42.82 % remain" in lines
    assert "battery in hover: 20 V and 0.5 A when full; 360 min until it is empty" in lines
    data = json.loads(run("info", "driven.toml", "--json", cwd=tmp_path).stdout)
    found = data["machine"]["hover_commands"]
    assert found["commands"] == pytest.approx([(9.81 / 30) ** 0.5, (9.81 / 2e-5) ** 0.5])
    assert found["left"] == pytest.approx(1 - (9.81 / 30) ** 0.5)
    assert (found["battery"]["time"], found["battery"]["charge"]) == (pytest.approx(21600), 0.0)
    assert data["rotor_list"][1]["command_limits"] == [0, 900]
    assert data["rotor_list"][1]["limits"] == pytest.approx([0, 16.2])
    drive = data["rotor_list"][0]["drive"]
    assert (drive["curve"], drive["up"], drive["down"]) == ([0, 0, 30], 0.02, 0.02)
    assert data["battery"]["capacity"] == 3
    assert data["link_list"][0]["servo"]["stiffness"] == 30
    assert data["link_list"][0]["friction"]["static"] == 0.1
    second = DRIVEN[DRIVEN.rindex("[[rotor]]") : DRIVEN.index("[[link]]")]
    named = f'{DRIVEN}{second}name = "Left"\nground_effect = true\ndisc_radius = 0.1\n'
    named += f'{second}name = "Right"\n'
    (tmp_path / "named.toml").write_text(named, encoding="utf-8")
    said = run("info", "named.toml", cwd=tmp_path).stdout
    assert "rotors 2, Right: command" in said
    assert "rotor Left: command" in said
    assert "ground_effect true" in " ".join(said.split())


def test_info_of_rotors_alone_has_no_tables_of_chains(tmp_path: Path) -> None:
    said = run("info", "quadrotor", "--operations", cwd=tmp_path).stdout
    assert not any(title in said for title in ("Open chains", "Rows of the hybrid", "Hybrid matr"))
    assert "\nMasses, in the base's axes (kg, m, kg m² about the centre of mass)\n" in said


def test_new_like_a_robot_begins_with_its_file(tmp_path: Path) -> None:
    """And `info` of it tells efforts of joints and radii of wheels."""
    assert run("new", "--like", "rover_arm", "my_rover.toml", cwd=tmp_path).returncode == 0
    text, (like, source) = (tmp_path / "my_rover.toml").read_text(), read_robot("rover_arm")
    assert text.replace('name = "my_rover"', "") == re.sub('name += "rover_arm"', "", source)
    assert parse_robot(text) == replace(like, name="my_rover")
    lines = run("info", "my_rover.toml", cwd=tmp_path).stdout.splitlines()
    rows = [line.split() for line in lines if line.startswith(("wrist_1 ", "left_wheel "))]
    assert rows[0][:5] == ["wrist_1", "revolute", "wrist_1_joint", "28", "-"]
    assert rows[1][:5] == ["left_wheel", "revolute", "left_wheel_joint", "100", "0.0625"]
    refused = run("new", "--like", "ur5e", "--placed", "other.toml", cwd=tmp_path)
    assert (refused.returncode, "leave out --placed" in refused.stderr) == (2, True)


@pytest.mark.slow
def test_info_says_where_every_joint_is(tmp_path: Path) -> None:
    said = run("info", "dual_arm", cwd=tmp_path).stdout
    lines = [" ".join(line.split()) for line in said.splitlines()]
    assert "right_shoulder base 0.06, -0.13, -0.1 0, 0, 0 -y" in lines
    assert max(map(len, said.splitlines())) <= 100
    said = run("info", "quadrotor_2link", cwd=tmp_path).stdout
    lines = [" ".join(line.split()) for line in said.splitlines()]
    assert (
        lines[lines.index("link parent alpha, ° a, m d, m theta, °") + 2]
        == "link 2 link 1 90 0 0 0"
    )


@pytest.mark.slow
def test_info_as_json(tmp_path: Path) -> None:
    done = run("info", "hexarotor_3link", "--json", "--operations", cwd=tmp_path)
    data = json.loads(done.stdout)
    assert [chain["links"] for chain in data["chains"]][4] == [-1, 0, 1, 6]
    assert data["chains"][4]["places"] == [0, 1, 2, 7, 11, 12, 13, 18]
    assert data["arrangement"]["rank"] == 6
    counts = data["operations"]["mass_matrix_and_residual"]
    kinds = ("additions", "subtractions", "multiplications")
    assert counts["total"] == sum(counts[kind] for kind in kinds)
    rows = {row["unknown"]: row for row in data["hybrid_rows"]}
    assert rows["theta_4"] == {
        "row": 4,
        "unknown": "theta_4",
        "chains": [3],
        "inputs": ["F_4"],
    }
    assert rows["theta_1"]["chains"] == [1, 2, 3, 4, 5, 6]
    pattern = data["hybrid_pattern"]
    assert pattern[0][0] == [1, 2, 3, 4, 5, 6]
    assert pattern[3][4] == []
    # Its blank entries, such as (theta_-1, x), are zero in every posture, and no others.
    module = load(ROOT / "generated" / "hexarotor_3link")
    states = np.random.default_rng(3).normal(size=(20, 9))
    emitted = (np.abs(module.hybrid_mass_matrix(states)) > 1e-12).any(axis=0)
    filled = np.array([[bool(chains) for chains in row] for row in pattern])
    np.testing.assert_array_equal(filled, emitted)
    assert not filled[0, 11]
    assert data["base"]["mass"] == 3.0
    assert data["base"]["com"] == [0.0, 0.0, 0.0]
    assert data["base"]["hover"] == pytest.approx([29.43, 0.0] * 3)
    assert data["warnings"] == []
    assert data["arrangement"]["tilt_hint"] is None


LOPSIDED = """name = "lop"
[base]
rotors = 6
thrust = [[0, 3, 9], [0, -3, 9], [0, 3, 9], [0, -3, 9], [0, 3, 9], [0, -3, 9]]
drag = [0.02, -0.02, 0.02, -0.02, 0.02, -0.02]
arm = { length = 0.3, mass = 0.4, com = [0.23, 0, 0], inertia = [1e-4, 1e-3, 1e-3, 0, 0, 0] }
"""


@pytest.mark.slow
def test_a_lopsided_base_and_wrong_tilts_are_spoken_of(tmp_path: Path) -> None:
    (tmp_path / "lop.toml").write_text(LOPSIDED)
    made = run("generate", "lop.toml", cwd=tmp_path)
    assert made.returncode == 0
    assert "warning: the base is lopsided: its centre of mass is 0.0267 m off" in made.stderr
    assert "base: 2.4 kg, centre of mass 0.02667, 0, 0 m from the base centre" in made.stdout
    shown = " ".join(run("info", "lop.toml", cwd=tmp_path).stdout.split())
    assert "warning: the base is lopsided" in shown
    assert "the first with com = [0.07, 0, 0]" in shown
    assert "Hint: if the thrust of motor 1 tilted to the other side" in shown
    data = json.loads(run("info", "lop.toml", "--json", cwd=tmp_path).stdout)
    assert data["base"]["offset"] == pytest.approx(0.16 / 6)
    assert data["warnings"][0].startswith("the base is lopsided")
    assert data["arrangement"]["tilt_hint"]["motors"] == [1]


@pytest.mark.slow
def test_every_command_takes_a_module_by_its_name(tmp_path: Path) -> None:
    word = "own"
    (tmp_path / "own.toml").write_text(LOPSIDED.replace("lop", "own").replace("0.23", "0.15"))
    assert run("generate", "own.toml", cwd=tmp_path).returncode == 0
    (tmp_path / "own.toml").unlink()
    for arguments in (
        ("info", word),
        ("show", word, "--chain", "2", "--equation", "18"),
        ("generate", word, "--check"),
        ("verify", word, "--states", "1", "--backend", "numpy"),
        (
            *("simulate", word, "--scenario", "hover", "--backend", "numpy", "--no-figures"),
            *("--set", "duration=0.05"),
        ),
    ):
        done = run(*arguments, cwd=tmp_path)
        assert done.returncode == 0, (arguments, done.stderr)
        assert "own" in done.stdout


@pytest.mark.slow
def test_of_a_name_that_is_both_the_help_says_which_is_taken(tmp_path: Path) -> None:
    """A module in generated/ that has the name of a robot that ships, but is another."""
    text = (ROOT / "gibbs_codegen" / "robots" / "hexarotor.toml").read_text()
    (tmp_path / "other.toml").write_text(text.replace("gravity = 9.81", "gravity = 3.71"))
    assert "gravity = 3.71" in (tmp_path / "other.toml").read_text()
    assert run("generate", "other.toml", cwd=tmp_path).returncode == 0
    file_first = "for a NAME, NAME.toml and a robot that ships go before a module"
    module_first = "for a NAME, a module goes before NAME.toml and a robot that ships"
    taken = {
        **dict.fromkeys(("info", "show", "generate"), file_first),
        **dict.fromkeys(("verify", "simulate", "export"), module_first),
    }
    for command, words in taken.items():
        assert words in " ".join(run(command, "--help", cwd=tmp_path).stdout.split())
    hover = json.loads(run("info", "hexarotor", "--json", cwd=tmp_path).stdout)["base"]["hover"]
    assert hover[0] == pytest.approx(9.81)
    done = run("verify", "hexarotor", "--states", "1", "--backend", "numpy", cwd=tmp_path)
    assert "\ngenerated/hexarotor: all" in done.stdout


@pytest.mark.parametrize(
    "command",
    ["", "generate", "info", "show", "verify", "simulate", "new", "import", "export", "schema"],
)
def test_help_fits_into_eighty_columns(command: str, tmp_path: Path) -> None:
    words = [command, "--help"] if command else ["--help"]
    done = subprocess.run(
        [sys.executable, "-m", "gibbs_codegen", *words],
        env={**ENVIRONMENT, "COLUMNS": "80"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0
    assert max(map(len, done.stdout.splitlines())) <= 80


@pytest.mark.slow
def test_a_terminal_is_filled_and_not_overrun(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 200, 0, 0))
    environment = {k: v for k, v in ENVIRONMENT.items() if k != "COLUMNS"}
    process = subprocess.Popen(
        [sys.executable, "-m", "gibbs_codegen", "show", "hexarotor_3link", "--chain", "2"],
        env={**environment, "PYTHONIOENCODING": "utf-8"},
        cwd=tmp_path,
        stdout=theirs,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs)
    seen = b""
    try:
        while part := os.read(ours, 65536):
            seen += part
    except OSError:  # The other end has closed.
        pass
    assert process.wait(timeout=HANGING) == 0
    os.close(ours)
    widest = max(map(text_width, seen.decode().replace("\r", "").splitlines()))
    assert 80 < widest <= 100


@pytest.mark.slow
def test_show_prints_the_equations_of_a_chain(tmp_path: Path) -> None:
    done = run("show", "hexarotor_3link", "--chain", "5", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr == ""
    assert "I_5·θ̈_5 - ζ_{5,4}·τ'_{5,4} = R_5 + F_5" in done.stdout
    assert "8     τ'_{5,4}        τ'_6                   17" in done.stdout
    done = run(
        *("show", "--rotors", "4", "--links", "2", "--chain", "4", "--format", "latex"),
        *("--equation", "6", "--equation", "5"),
        cwd=tmp_path,
    )
    assert done.returncode == 0
    assert done.stdout.index(r"\mathcal{S}_{x} &=") < done.stdout.index(r"\frac{\partial S_{4}}")
    assert done.stdout.isascii()
    assert list(tmp_path.iterdir()) == []


def test_help_does_not_import_what_it_does_not_need(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom gibbs_codegen.cli.app import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "late = {'sympy', 'numpy', 'jinja2', 'rich', 'scipy', 'dataclasses', 'inspect', 'json'}\n"
        "assert not late & set(sys.modules), late & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_refusal_does_not_import_sympy(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("name = 3")
    code = (
        "import sys\nfrom gibbs_codegen.cli.app import main\n"
        "assert main(['info', 'bad.toml']) == 2\nassert 'sympy' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_error_to_speak_of(tmp_path: Path) -> None:
    command = f"{sys.executable} -m gibbs_codegen info hexarotor --json | head -c 10"
    done = subprocess.run(
        ["bash", "-c", command], env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True
    )
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("flags", [[], ["--all-parameters"]])
@pytest.mark.parametrize("attitude", ["xyz", "zyx"])
@pytest.mark.parametrize(
    ("rotors", "origin", "arm", "links"),
    [
        (2, "motor1", "length = 1, mass_per_length = 1", ""),
        (4, "centre", "length = 0, mass = 1, com = [0, 0, 0]", ""),
        (
            3,
            "motor1",
            "length = 1, mass_per_length = 1",
            "[[link]]\n[[link]]\nmass = 1\ncom = [1, 0, 0]\n",
        ),
    ],
    ids=["thin rods in line", "all mass in one point", "two joints on one axis"],
)
def test_a_machine_whose_motion_is_not_determined_is_refused(
    rotors: int,
    origin: str,
    arm: str,
    links: str,
    attitude: str,
    flags: list[str],
    tmp_path: Path,
) -> None:
    text = f'name = "odd"\n[base]\nrotors = {rotors}\nattitude = "{attitude}"\n'
    text += f'origin = "{origin}"\narm = {{ {arm} }}\n{links}'
    (tmp_path / "odd.toml").write_text(text)
    done = run("generate", "odd.toml", *flags, cwd=tmp_path)
    assert_refused(done, tmp_path, "odd: massless degree")


def test_numbers_that_overflow_are_refused(tmp_path: Path) -> None:
    text = 'name = "vast"\n[base]\nrotors = 3\narm = { length = 1e200, mass_per_length = 1e200 }\n'
    (tmp_path / "vast.toml").write_text(text)
    assert_refused(run("generate", "vast.toml", cwd=tmp_path), tmp_path, "overflow")


@pytest.mark.slow
def test_a_stream_that_lacks_letters_is_no_traceback(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "gibbs_codegen", "info", "hexarotor"],
        cwd=tmp_path,
        env={**ENVIRONMENT, "PYTHONIOENCODING": "latin-1"},
        capture_output=True,
    )
    assert done.returncode == 0
    assert b"\\u2192" in done.stdout


def test_new_does_not_import_sympy(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom gibbs_codegen.cli.app import main\n"
        "assert main(['new', 'a.toml']) == 0\nassert 'sympy' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_closed_streams_are_no_traceback(tmp_path: Path) -> None:
    for redirection in (">&-", "2>&-"):
        command = f"{sys.executable} -m gibbs_codegen info hexarotor {redirection}"
        done = subprocess.run(
            ["bash", "-c", command], env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0
        assert "Traceback" not in done.stderr


def test_a_folder_name_too_long_is_wrong_use(tmp_path: Path) -> None:
    done = run("generate", "hexarotor", "--out", "a" * 300, cwd=tmp_path)
    assert_refused(done, tmp_path, "File name too long")


@pytest.mark.slow
def test_of_a_robot_without_limits_scipy_is_not_imported(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom gibbs_codegen.cli.app import main\n"
        "assert main(['generate', 'hexarotor']) == 0\n"
        "assert not {'scipy', 'gibbs_codegen.flight'} & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", ["generate", "info"])
def test_derivatives_without_names_may_stand_before_the_robot(command: str, tmp_path: Path) -> None:
    """The word after the option is looked for as a robot, not as a derivative."""
    done = run(command, "--derivatives", "nothing_like_it", cwd=tmp_path)
    assert done.returncode == 2
    assert "nothing_like_it: " in done.stderr
    assert "is there a module of that name" in done.stderr
