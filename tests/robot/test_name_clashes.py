"""No two things of a robot share a name in generated code, least of all that of a parameter."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.emitted import emitted_module

from gibbs_codegen.derivation.parameters import Parameters
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.equations.chain_names import chain_names
from gibbs_codegen.errors import RobotFileError
from gibbs_codegen.exchange.welding import Namer
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.chains import decompose
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import default_prefix
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.references import NameRegistry, parameter_names
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.symbolic.tape import Tape

EVERYTHING = Path(__file__).parents[1] / "robots" / "everything.toml"
CARRIED = "name = 'carried'\n[base]\nmass = 2\n"
FIXED = "name = 'arm'\n[base]\nmotion = 'fixed'\n"
RODS = "name = 'rods'\n[base]\nrotors = 3\narm = { length = 0.5, mass_per_length = 1 }\n"


def link(name: str, rod: bool = False) -> str:
    body = "length = 1\nmass_per_length = 1" if rod else "mass = 1"
    return f"[[link]]\nname = '{name}'\nxyz = [0, 0, 1]\n{body}\n"


def servo(name: str) -> str:
    return link(name) + "servo = { stiffness = 9 }\n"


def rotor(name: str) -> str:
    return f"[[rotor]]\nname = '{name}'\n"


def frame(name: str) -> str:
    return f"[[frame]]\nname = '{name}'\n"


def rod(name: str) -> str:
    return link(name, True)


MAKERS: list[Callable[[str], str]] = [link, rotor, frame, rod, servo]


class Names(Parameters):
    """Parameters that must all have names of their own."""

    def _value(self, name: str, default: float, unit: str) -> object:  # type: ignore[override]
        assert name not in self.defaults, name
        return super()._value(name, default, unit)


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        (CARRIED + link("q") + link("q_"), "link 2", "link 1, such as q__x"),
        (CARRIED + link("W_") + rotor("W"), "rotor 1", "link 1, such as W__x"),
        (CARRIED + link("frame_cam") + frame("cam"), "frame 1", "link 1, such as frame_cam_x"),
        (CARRIED + rotor("frame_cam") + frame("cam"), "frame 1", "rotor 1, such as frame_cam_x"),
        (CARRIED + link("base_com"), "link 1", "the base, such as base_com_x"),
        (CARRIED + link("foo") + rotor("foo_com"), "rotor 1", "link 1, such as foo_com_x"),
        (CARRIED + link("foo_com") + link("foo"), "link 2", "link 1, such as foo_com_x"),
        (CARRIED + rod("foo") + link("foo_section"), "link 2", "foo_section_inertia_xx"),
        (CARRIED + rod("foo") + link("foo_mass_per"), "link 2", "foo_mass_per_length"),
        (CARRIED + servo("foo") + link("foo_servo"), "link 1", "link 2, such as foo_servo_stif"),
        (RODS + link("base_arm_section"), "link 1", "base_arm_section_inertia_xx"),
        (RODS + link("base_arm_com"), "link 1", "the base's arms, such as base_arm_com_x"),
    ],
)
def test_names_that_share_a_parameter_are_refused(text: str, place: str, words: str) -> None:
    with pytest.raises(RobotFileError) as refusal:
        parse_robot(text, "r.toml")
    (line,) = str(refusal.value).splitlines()
    assert f": {place}: name: " in line
    assert "gives parameters the names of those of" in line
    assert words in line


def test_constraints_are_told_apart_in_their_rows_and_what_they_hold_is_told_once() -> None:
    held = '[[constraint]]\nname = "{}"\nframe = "base"\ntype = "point"\n'
    with pytest.raises(RobotFileError, match=r"'g_turn' gives rows .* such as g_turn_x: give"):
        parse_robot(CARRIED + held.format("g") + held.format("g_turn"), "r.toml")
    wrong = {'to = "world"': "or be left out for the world", 'axis = "x"': 'of type "loop"$'}
    for key, words in wrong.items():
        with pytest.raises(RobotFileError, match=words) as refusal:
            parse_robot(CARRIED + held.format("g") + key, "r.toml")
        assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize(
    "text",
    [
        CARRIED + link("foo") + link("foo_section") + link("foo_mass_per"),
        CARRIED + rod("foo") + link("foo_com"),
        CARRIED + link("foo") + servo("foo_servo"),
        CARRIED + link("base_arm_section") + link("base_section"),
        CARRIED + link("cam") + frame("cam"),
    ],
)
def test_names_that_share_none_are_welcome(text: str) -> None:
    Names(parse_robot(text), Tape(), keep_zeros=True)


def test_joints_of_a_fixed_base_may_be_called_like_coordinates_of_others() -> None:
    words = ("x", "yaw", "qw", "theta_0")
    called, plain = (
        emitted_module(parse_robot(FIXED + "".join(map(rod, names))))
        for names in (words, ("a", "b", "c", "d"))
    )
    assert words == called.COORDINATES
    scenario = read_scenario("hold", {"duration": 0.1})
    found, expected = (simulate(module, scenario) for module in (called, plain))
    np.testing.assert_array_equal(found.q, expected.q)
    turned = FIXED.replace("'fixed'", "'planar'") + link("yaw")
    with pytest.raises(RobotFileError, match="'yaw' is the name of a coordinate of the base"):
        parse_robot(turned)


def test_whatever_is_accepted_gives_every_parameter_a_name_of_its_own() -> None:
    words = ("a", "a_", "foo", "foo_com", "frame_foo", "frame_a", "1", "_1", "rotor1", "link2")
    words += ("foo_section", "foo_mass_per", "base", "base_com", "foo.com", "A", "frame")
    words += ("foo_servo", "foo_servo_servo")
    chance, accepted = np.random.default_rng(14), 0
    for _ in range(150):
        text = CARRIED + "".join(
            make(str(chance.choice(words))) for make in chance.choice(MAKERS, 4)
        )
        try:
            found = parse_robot(text)
        except RobotFileError:
            continue
        accepted += 1
        Names(found, Tape(), keep_zeros=True)
    assert 30 < accepted < 120


def known_names(robot: Robot) -> set[str]:
    """Names that parameters of a robot may have, by what has them."""
    found = {"gravity", *(f"base_drag_{k}" for k in range(1, robot.base.rotors + 1))}
    found |= {*parameter_names("base", "base"), *parameter_names("arm", "base_arm")}
    for i, each in enumerate(robot.links, start=1):
        name = each.name or default_prefix("link", i)
        found |= {*parameter_names("rod" if isinstance(each.body, Rod) else "link", name)}
    for k, thruster in enumerate(robot.thrusters, start=1):
        found |= {*parameter_names("rotor", thruster.name or default_prefix("rotor", k))}
    return found.union(*(parameter_names("frame", placed.name) for placed in robot.frames))


@pytest.mark.parametrize("robot", [read_robot(str(EVERYTHING))[0], paper_family(3, 2)])
def test_all_parameters_are_known_by_name(robot: Robot) -> None:
    parameters = Parameters(robot, Tape(), keep_zeros=True)
    assert set(parameters.defaults) <= known_names(robot)


def test_what_an_import_calls_things_is_accepted() -> None:
    """Whatever a source calls them."""
    words = ["q", "q_", "cam", "frame_cam", "foo", "foo_com", "foo_section", "base", "base_com", ""]
    words += ["x", "theta_1", "tau_prime_2", "tau prime 2", "l" * 200, "l" * 201, "q", "1", "_1"]
    namer = Namer()
    body = RigidBody(0.0, 1.0)
    links = tuple(
        Link(body, pose=Pose(), name=namer.free(word, "link"), coordinate=namer.free(word, "joint"))
        for word in words
    )
    rotors = tuple(Rotor(name=namer.free(word, "rotor")) for word in words)
    frames = tuple(Frame(namer.free(word, "frame")) for word in words)
    base = parse_robot(CARRIED).base
    robot = Robot("imported", base, links, 9.81, rotors, frames)
    assert parse_robot(robot_text(robot)) == robot
    Names(robot, Tape(), keep_zeros=True)
    notes = {(finding.subject, finding.detail) for finding in namer.findings}
    assert {
        ("q_", "link called q__link"),
        ("tau_prime_2", "joint called joint_tau_prime_2"),
    } < notes


def test_thousands_of_one_name_are_told_apart_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = 0
    fault = NameRegistry.fault

    def counted(self: NameRegistry, kind: str, name: str) -> str | None:
        nonlocal asked
        asked += 1
        return fault(self, kind, name)  # type: ignore[arg-type]

    monkeypatch.setattr(NameRegistry, "fault", counted)
    namer = Namer()
    assert len({namer.free("plate", "frame") for _ in range(1000)}) == 1000
    assert asked < 1010


def test_points_have_names_of_their_own() -> None:
    """The first keeps its name, but for those of the base centre and the tip."""
    text = CARRIED + "".join(map(rotor, ("left", "joint_a1", "tip", "eye")))
    text += link("a1") + link("a2") + "".join(map(frame, ("left", "eye", "O2", "frame_eye")))
    found = parse_robot(text)
    rotors = ("left", "joint_a1", "rotor_tip", "eye")
    frames = ("tip", "frame_left", "frame_eye", "frame_O2", "frame_frame_eye")
    assert Description(found).points == ("base", *rotors, "joint_joint_a1", "joint_a2", *frames)
    assert Description(found).frames == ("base", "tip", "left", "eye", "O2", "frame_eye")


def test_rotors_and_frames_may_be_called_like_what_a_simulation_looks_for() -> None:
    text = "name = 'named'\n[base]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n"
    for name, x, y in (("tip", 1, 0), ("O2", 0, 1), ("motor1", -1, 0), ("base_", 0, -1)):
        text += rotor(name) + f"position = [{x}, {y}, 0]\ndrag = {0.1 * (x * x - y * y)}\n"
    text += frame("O1") + "xyz = [0, 0, 5]\n"
    vehicle = Vehicle(emitted_module(parse_robot(text)))
    assert (vehicle.centre, vehicle.has_tip) == ("base", False)
    assert not vehicle.centre_offset(vehicle.neutral).any()
    scenario = replace(read_scenario("hover", {"control": {"law": "off"}}), duration=0.02)
    flight = simulate(vehicle.module, scenario)
    assert (flight.centre, flight.has_tip) == ("base", False)
    assert flight.rotor_points == ("rotor_tip", "rotor_O2", "motor1", "base_")
    assert np.array_equal(flight.point("base"), flight.q[:, 3:])


def test_a_chain_tells_whose_parameters_are_whatever_bodies_are_called() -> None:
    """Where one name begins as another's parameters go on."""
    text = CARRIED + link("frame") + link("arm_inertia") + link("arm") + frame("cam")
    text = text.replace("mass = 1", "mass = 1\ninertia = [1, 1, 1, 0, 0, 0]")
    robot = parse_robot(text + "xyz = [0, 0, 1]\n")
    named = chain_names(SymbolicRobot.of(robot, Tape()), decompose(robot)[0])
    meanings = {symbol.name: called.meaning for symbol, called in named.items()}
    for parameter, owner in (("frame_z", "frame"), ("arm_inertia_xx", "arm"), ("arm_mass", "arm")):
        assert re.search(rf"\b{owner}\b", meanings[parameter]), meanings[parameter]
    assert "frame_cam_z" not in meanings
