"""Numbers that are free, recordings, and robot files with what was identified: no fit."""

from __future__ import annotations

import re
from argparse import Namespace
from types import SimpleNamespace

import numpy as np
import pytest
from support.actuated import TEXT

from gibbs_codegen.cli import identify, robot_argument
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.sweeps.sources import robot_data
from gibbs_codegen.identification.identify import doubted, unseen
from gibbs_codegen.identification.recorded import Recording, deviation
from gibbs_codegen.identification.robot_file import with_numbers
from gibbs_codegen.identification.smoothing import Estimate, Smoother
from gibbs_codegen.identification.unknowns import Unknowns
from gibbs_codegen.pipeline import generate
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import parse_robot, read_robot, shipped_robots
from gibbs_codegen.robot.parts.body import inertia_fault
from gibbs_codegen.runtime.load import load
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.verification.parameters import parameter_values

ROBOT = "hextilt_flying_arm_5"  # Its bodies have products of inertia.


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    return load(generate(ROBOT, tmp_path_factory.mktemp("modules"), verify=False))


def test_every_unknown_gives_bodies_that_can_be(module) -> None:
    unknowns = Unknowns(module, ["*_mass", "*_inertia_*", "*_com_*"], 0.3)
    assert any(name.endswith("_inertia_xy") for name in unknowns.names)
    bodies = {name.removesuffix("_mass") for name in unknowns.names if name.endswith("_mass")}
    rng = np.random.default_rng(0)
    for size in (0.3, 2.0):
        for _ in range(20):
            numbers = {**module.PARAMETERS}
            numbers |= unknowns.parameters(size * rng.standard_normal(len(unknowns.names)))
            for body in bodies:
                inertia = [
                    numbers.get(f"{body}_inertia_{axes}", 0.0)
                    for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
                ]
                assert numbers[f"{body}_mass"] > 0.0
                assert inertia_fault(numbers[f"{body}_mass"], inertia) is None, body


def test_no_change_is_the_robot_file(module) -> None:
    unknowns = Unknowns(module, [], 0.3)
    changed = unknowns.parameters(np.zeros(len(unknowns.names)))
    for name, value in changed.items():
        scale = max(abs(module.PARAMETERS[name]), 1e-5)
        assert value == pytest.approx(module.PARAMETERS[name], abs=1e-6 * scale + 1e-9), name


def test_places_of_frames_are_off_by_lengths(module) -> None:
    unknowns = Unknowns(module, ["frame_*"], 0.3)
    count = len(unknowns.names)
    np.testing.assert_allclose(unknowns.slopes(np.zeros(count)), 0.1 * np.eye(count), atol=1e-9)


def test_links_may_be_called_like_frames_and_rotors() -> None:
    numbers = {"frame_arm_mass": 0.3, "rotors_arm_mass": 0.3}
    like = SimpleNamespace(NAME="odd", PARAMETERS=numbers, INPUTS=(), FRAMES=(), ATTITUDE="xyz")
    unknowns = Unknowns(like, ["frame_arm_mass", "rotors_arm_mass"], 0.3)
    np.testing.assert_allclose(unknowns.values(np.full(2, -5.0)), 0.3 * np.exp(-5.0))


def test_numbers_of_all_rotors_keep_their_ratios(module) -> None:
    unknowns = Unknowns(module, ["rotors.drag"], 0.3)
    changed = unknowns.parameters(np.array([np.log(1.5)]))
    assert len(changed) == 6
    for name, value in changed.items():
        assert value == pytest.approx(1.5 * module.PARAMETERS[name], rel=1e-14)


@pytest.mark.parametrize(
    ("free", "words"),
    [
        (["bse_mass"], "did you mean base_mass"),
        (["rotors.drag", "rotor_0_drag"], "rotor_0_drag is free by itself"),
        (["*link_1_armature"], "is 0 in the robot file"),
    ],
)
def test_what_cannot_be_free_is_refused(module, free, words) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        Unknowns(module, free, 0.3)


@pytest.mark.parametrize(
    ("prior", "words"),
    [
        ({"bse_mass": 0.01}, "bse_mass: chooses none"),
        (0.0, "must be above 0"),
        (np.inf, "must be above 0 and finite, but is inf"),
    ],
)
def test_what_is_no_prior_is_refused(module, prior, words) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        Unknowns(module, ["base_*"], prior)


def test_one_moment_frees_all_of_its_body(module) -> None:
    names = Unknowns(module, ["base_inertia_yy"], 0.3).names
    assert names == ["base_inertia_xx", "base_inertia_yy", "base_inertia_zz"]


def test_thin_rods_and_plates_have_as_many_numbers_as_extents(tmp_path) -> None:
    """Of a rod one moment, of a plate two: they stay in the ratios, or sums, of such bodies."""
    numbers = {"rod_mass": 1.0, "rod_inertia_xx": 0.2, "rod_inertia_yy": 0.2, "base_mass": 1.0}
    numbers |= {"base_inertia_xx": 0.5, "base_inertia_yy": 0.3, "base_inertia_zz": 0.2}
    stand_in = SimpleNamespace(
        NAME="flat", PARAMETERS=numbers, INPUTS=(), FRAMES=(), ATTITUDE="xyz"
    )
    unknowns = Unknowns(stand_in, ["rod_inertia_yy", "base_inertia_xx"], 0.3)
    assert unknowns.names == ["rod_inertia_xx", "base_inertia_yy", "base_inertia_zz"]
    found = unknowns.parameters(np.array([np.log(1.5), 0.2, -0.3]))
    assert found["rod_inertia_xx"] == found["rod_inertia_yy"] == pytest.approx(0.3)
    assert found["base_inertia_yy"] == pytest.approx(0.3 * np.exp(0.2))
    assert found["base_inertia_zz"] == pytest.approx(0.2 * np.exp(-0.3))
    parts = found["base_inertia_yy"] + found["base_inertia_zz"]
    assert found["base_inertia_xx"] == pytest.approx(parts, rel=1e-14)


def test_one_product_of_inertia_is_a_number_of_its_own() -> None:
    """Any body with the planes of symmetry of the file's can be reached, such as this one."""
    numbers = {"base_mass": 1.8, "base_inertia_xx": 0.021, "base_inertia_yy": 0.026}
    numbers |= {"base_inertia_zz": 0.038, "base_inertia_yz": 0.001}
    like = SimpleNamespace(NAME="odd", PARAMETERS=numbers, INPUTS=(), FRAMES=(), ATTITUDE="xyz")
    unknowns = Unknowns(like, ["base_inertia_*"], 0.3)
    assert unknowns.names == [*numbers][1:]
    wanted = np.array([0.023, 0.022, 0.042, 0.0013])

    def second(xx: float, yy: float, zz: float, yz: float) -> tuple[np.ndarray, float]:
        moments = 0.5 * (xx + yy + zz) - np.array([xx, yy, zz])
        return moments, np.arctanh(-yz / np.sqrt(moments[1] * moments[2]))

    (new, turn), (old, before) = second(*wanted), second(*list(numbers.values())[1:])
    z = np.array([*np.log(new / old), turn - before])
    np.testing.assert_allclose(unknowns.values(z), wanted, rtol=1e-12)


def test_a_number_without_a_key_of_its_own_is_refused(tmp_path) -> None:
    """The place of a hold in the world, which changes as it is commanded."""
    (tmp_path / "robot.toml").write_text(
        f'{TEXT}[[constraint]]\nname = "hold"\ntype = "point"\nframe = "tip"\nxyz = [0, 0, 1]\n'
    )
    numbers = {"constraint_hold_z": 1.0, "upper_mass": 0.2}
    like = SimpleNamespace(NAME="held", PARAMETERS=numbers, INPUTS=(), FRAMES=(), ATTITUDE="xyz")
    like.__path__ = [tmp_path]
    with pytest.raises(UsageError, match=r"with a key in its file.*Free by default: upper_mass;"):
        Unknowns(like, ["constraint_hold_z"], 0.3)


def test_slopes_are_those_of_the_values(module) -> None:
    unknowns = Unknowns(module, ["base_*"], 0.3)
    z = 0.2 * np.random.default_rng(1).standard_normal(len(unknowns.names))
    step = 1e-3 * np.random.default_rng(2).standard_normal(len(z))
    change = unknowns.values(z + step) - unknowns.values(z - step)
    np.testing.assert_allclose(2.0 * unknowns.slopes(z) @ step, change, rtol=1e-4, atol=1e-12)


def test_comments_of_a_robot_file_stay() -> None:
    text = read_robot("quadrotor_arm_2link")[1]
    changes = {"forearm_mass": 0.2, "base_com_z": -0.0123456789, "rear_left_drag": -0.02}
    changes |= {"frame_tip_z": -0.21, "upper_arm_x": 0.03}
    new = with_numbers(text, changes, {"forearm_mass": "0.2 ± 0.001, identified from flight"})
    rows = new.splitlines()
    assert "mass = 0.2  # 0.2 ± 0.001, identified from flight" in rows
    assert "com = [-0.01, 0, -0.0123457]  # the battery stands back" in new
    pairs = zip(text.splitlines(), rows, strict=True)
    assert sum(old != new for old, new in pairs) == 5
    robot = parse_robot(new)
    assert (robot.frames[0].pose.xyz[2], robot.links[0].pose.xyz[0]) == (-0.21, 0.03)
    assert robot.links[1].body.mass == 0.2
    assert robot.thrusters[1].drag == -0.02


def test_numbers_in_lists_of_inline_tables_are_replaced() -> None:
    text = """name = "x"
rotor = [
    { position = [0.2, 0, 0], drag = 0.01, command = "throttle", max_thrust = 9 },  # front
    { position = [-0.2, 0, 0], drag = -0.01 },
]
link = [{ name = "rod", xyz = [0, 0, 0], axis = "y", length = 0.2, mass_per_length = 0.6 }]
base = { mass = 3.0, inertia = [0.06, 0.06, 0.1, 0, 0, 0] }
"""
    changes = {"rod_mass_per_length": 0.5, "rotor2_drag": -0.02, "base_mass": 2.0}
    changes |= {"rotor1_thrust_1": 1.0, "rotor1_thrust_2": 8.0}
    new = with_numbers(text, changes, {"rod_mass_per_length": "0.5 ± 0.1"})
    assert new.splitlines()[-2:] == [
        "]  # 0.5 ± 0.1",
        "base = { mass = 2.0, inertia = [0.06, 0.06, 0.1, 0, 0, 0] }",
    ]
    assert "]  # front\n" in new
    robot = parse_robot(new)
    assert [rotor.drag for rotor in robot.thrusters] == [0.01, -0.02]
    assert robot.thrusters[0].drive.curve == (0.0, 1.0, 8.0)


def test_a_thrust_curve_takes_the_place_of_the_greatest_thrust() -> None:
    text = read_robot("quadrotor_arm_2link")[1].replace(
        "limits        = [0, 14]",
        'command = "throttle"\nmax_thrust = 14\nthrust_model_factor = 0.8',
    )
    names = ("front_left", "rear_left", "rear_right", "front_right")
    changes = {f"{name}_thrust_{k}": float(k) for name in names for k in (1, 2)}
    robot = parse_robot(with_numbers(text, changes, {}))
    assert [rotor.drive.curve for rotor in robot.thrusters] == [(0.0, 1.0, 2.0)] * 4


def test_keys_that_a_file_leaves_out_are_added_where_they_belong() -> None:
    """Also those whose defaults follow other keys, and in place of keys that say the same."""
    text = TEXT.replace("position            = [0.2, 0.2, 0.02]", "radius = 0.3\nazimuth_deg = 40")
    text = text.replace("friction = { coulomb = 0.005, velocity = 0.2 }", "friction.coulomb = 0.01")
    changes = {"gravity": 9.8, "battery_voltage_4": 16.5, "wrist_inertia_xy": 1e-6}
    changes |= {"front_left_x": 0.25, "front_left_time_down": 0.06, "tip": 1.0}
    changes |= {"wrist_friction_static": 0.02, "wrist_friction_velocity": 0.3}
    new = with_numbers(text, changes, {"wrist_friction_static": "0.02 ± 0.001"})
    assert "friction.static = 0.02  # 0.02 ± 0.001" in new.splitlines()
    before, after = parameter_values(parse_robot(text)), parameter_values(parse_robot(new))
    changed = {name for name, value in after.items() if value != before[name]}
    assert changed == changes.keys() - {"tip"}
    assert all(after[name] == changes[name] for name in changed)


def _text(name: str) -> str:
    return TEXT if name == "actuated" else read_robot(name)[1]


@pytest.mark.parametrize("name", [*shipped_robots(), "actuated"])
@pytest.mark.parametrize("zeros", [False, True])
def test_numbers_free_by_default_make_a_robot_file(name: str, zeros: bool, tmp_path) -> None:
    """Of thin rods, sections, wheels and static frictions too, with zeros and without."""
    robot = parse_robot(_text(name))
    symbols = SymbolicRobot.of(robot, Tape(), zeros)
    stand_in = SimpleNamespace(NAME=name, PARAMETERS=symbols.parameters.defaults)
    vars(stand_in).update(__path__=[tmp_path], ATTITUDE=robot.kind, **Description(robot).lists())
    (tmp_path / "robot.toml").write_text(_text(name))
    unknowns = Unknowns(stand_in, [], 0.3)
    rng = np.random.default_rng(0)
    for _ in range(3):
        numbers = unknowns.parameters(0.02 * rng.standard_normal(len(unknowns.names)))
        after = parameter_values(parse_robot(with_numbers(_text(name), numbers, {})))
        before = parameter_values(robot)
        for number, value in after.items():
            wanted = numbers.get(number, before[number])
            assert value == pytest.approx(wanted, rel=1e-5, abs=1e-12), number


def test_noise_is_told_from_motion() -> None:
    time, rng = 0.005 * np.arange(4000), np.random.default_rng(0)
    motion = np.stack([np.sin(3 * time), 5 * np.cos(7 * time), np.sin(time)], axis=1)
    noisy = motion + [0.01, 0.1, 0.0] * rng.standard_normal(motion.shape)
    noisy[:, 2] = np.round(noisy[:, 2] / 1e-3) * 1e-3
    noisy[::7] = np.nan
    noisy[100, 0] = 50.0
    exact = [0.01, 0.1, 1e-3 / np.sqrt(12)]
    np.testing.assert_allclose(deviation(noisy, 1e-6)[:2], exact[:2], rtol=0.1)
    assert exact[2] <= deviation(noisy, 1e-6)[2] < 3 * exact[2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": np.arange(30.0)}, "30 samples"),
        ({"time": np.r_[0.01 * np.arange(200), 5 + 0.01 * np.arange(100)]}, "not evenly spaced"),
        ({"time": np.r_[0.01 * np.arange(200), 0.01 * np.arange(100)]}, "a clock that jumps back"),
        ({"commands": np.full((300, 6), np.nan)}, "has no command of"),
    ],
)
def test_recordings_that_tell_nothing_are_refused(change, words) -> None:
    arrays = {
        "time": 0.01 * np.arange(300),
        "commands": np.zeros((300, 6)),
        "q": np.zeros((300, 9)),
    }
    with pytest.raises(UsageError, match=words):
        Recording(**(arrays | change))


def test_doubt_of_readings_does_not_widen_the_prior() -> None:
    rng = np.random.default_rng(0)
    slopes, prior, doubt = rng.standard_normal((2, 4)), np.array([0.3, 0.3, 2.0, 1e-3]), 900.0
    told = slopes.T @ slopes
    covariance = np.linalg.inv(told + np.diag(prior**-2))
    exact = np.linalg.inv(told / doubt + np.diag(prior**-2))
    wider = doubted(covariance, prior, doubt)
    np.testing.assert_allclose(wider, exact, rtol=1e-9, atol=1e-14)
    assert np.all(np.diag(wider) <= prior**2)


def test_means_and_deviations_are_those_of_a_bent_law() -> None:
    """Of two numbers whose residuals and prior are known, against sums over a grid."""

    def residuals(x, y) -> np.ndarray:
        return np.array([(np.exp(2.0 * y) - 1.0) / 0.6, (x - 0.5 * y**2 - 0.2 * y) / 0.05, x, y])

    class Bent(Smoother):
        def __init__(self) -> None:
            self.prior, self.model = np.ones(2), SimpleNamespace(moved=lambda state, _: state)

        def _solved(self, estimate, free):
            slopes = np.array(
                [residuals(*(estimate.shared + 1e-30j * way)).imag / 1e-30 for way in np.eye(2)]
            )
            covariance = np.linalg.inv(slopes @ slopes.T)
            change = -covariance @ slopes @ residuals(*estimate.shared)
            return change[:free], covariance, lambda _: np.zeros(1)

    bent, mode = Bent(), Estimate(np.zeros(2), {}, np.zeros(0))
    mode.covariance = bent._solved(mode, 2)[1]
    mean, covariance = bent.spread(mode)
    grid = np.stack(np.meshgrid(np.linspace(-1, 4, 1001), np.linspace(-3, 1, 801)))
    chances = np.exp(-0.5 * np.sum(residuals(*grid) ** 2, axis=0)).ravel()
    points = grid.reshape(2, -1)
    exact = np.cov(points, aweights=chances)
    off = np.average(points, axis=1, weights=chances) - mean
    # At the mode the mean is 0.7 deviations off, and the deviations are a third too small.
    assert np.abs(off / np.sqrt(np.diag(exact))).max() < 0.15
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), np.sqrt(np.diag(exact)), rtol=0.1)


def test_what_is_unseen_is_said_of_values_not_of_factors_of_inertia(module) -> None:
    """The second moment along y is in the moments about x and z, and not in that about y."""
    body = next(n for n in module.PARAMETERS if n.endswith("_inertia_xx")).removesuffix("_xx")
    unknowns = Unknowns(module, [f"{body}_xx", f"{body}_yy", f"{body}_zz"], 0.3)
    covariance = 0.3**2 * np.diag([1e-6, 1.0, 1e-6])
    (words,) = unseen(unknowns, covariance, unknowns.slopes(np.zeros(3)))
    assert f"{body}_xx" in words
    assert f"{body}_zz" in words
    assert f"{body}_yy" not in words


def test_a_wrong_name_lists_what_can_be_free(module) -> None:
    with pytest.raises(UsageError, match=r"has no such number.*Free by default: rotors\.drag"):
        Unknowns(module, ["rotors.bogus"], 0.3)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("modules")
    return load(generate("quadrotor_arm_2link", folder, keep_zeros=True, verify=False))


def test_a_load_is_a_point_on_its_body(whole) -> None:
    """It adds m JᵀJ of its place, the tip here, to the mass matrix."""
    unknowns = Unknowns(whole, ["payload.forearm"], 0.3)
    assert unknowns.names == [f"payload.forearm_{end}" for end in ("mass", "x", "y", "z")]
    np.testing.assert_array_equal(unknowns.before(), 0.0)
    z = np.array([0.1, 0.0, 0.0, 0.3 * whole.PARAMETERS["frame_tip_z"] / 0.1])
    mass, *_, height = unknowns.values(z)
    assert height == pytest.approx(whole.PARAMETERS["frame_tip_z"])
    q = np.random.default_rng(0).standard_normal(len(whole.COORDINATES))
    q[3:7] /= np.linalg.norm(q[3:7])
    jacobian = whole.frame_jacobians(q)[whole.FRAMES.index("tip")][:3]
    carried = whole.mass_matrix(q, constants=whole.prepare(unknowns.parameters(z)))
    np.testing.assert_allclose(
        carried - whole.mass_matrix(q), mass * jacobian.T @ jacobian, atol=1e-14
    )


def test_the_place_of_a_load_frees_its_mass(whole) -> None:
    names = Unknowns(whole, ["payload.forearm_x"], 0.3).names
    assert names == ["payload.forearm_mass", "payload.forearm_x"]


def test_a_load_needs_all_numbers_of_its_body(tmp_path) -> None:
    module = load(generate("quadrotor_arm_2link", tmp_path, verify=False))
    with pytest.raises(UsageError, match="has no forearm_com_x, which a load changes"):
        Unknowns(module, ["payload.forearm"], 0.3)
    with pytest.raises(UsageError, match=r"has no such number other than 0.* payload\.forearm\?"):
        Unknowns(module, ["payload.arm"], 0.3)


@pytest.mark.parametrize(
    ("free", "zeros"), [("frame_tip_?", True), ("payload.wrist", True), ("*_servo_delay", False)]
)
def test_names_are_those_of_the_file_and_what_may_be_zero_keeps_zeros(
    tmp_path, monkeypatch, free, zeros
) -> None:
    def found(word, *_, check, keep_zeros: bool, **_settings):
        check(robot_data(word, robot_argument.find_robot))
        raise UsageError(f"zeros: {keep_zeros}")

    monkeypatch.setattr(robot_argument, "found_module", found)
    (tmp_path / "actuated.toml").write_text(TEXT)
    (tmp_path / "log.npz").touch()
    places = {"out": tmp_path / "out", "logs": [tmp_path / "log.npz"]}
    places |= {
        "name": [],
        "design": None,
        "free": [free],
        "prior": [],
        "hold_out": 0.0,
        "between": None,
        "room": None,
        "scenario": None,
    }
    options = Namespace(**places, robot=str(tmp_path / "actuated.toml"))
    with pytest.raises(UsageError, match=f"zeros: {zeros}"):
        identify.run(options)
