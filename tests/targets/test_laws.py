"""Laws that are written in C beside a module's functions: numbers, text, and who gets them."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from support.actuated import NO_AIR, actuated
from support.compiled import build, compile_only
from support.embedded_laws import M4F, M7, called, flown

from gibbs_codegen import generate, load, simulate
from gibbs_codegen.arrays import Functions, Program, evaluate
from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.module_writer import kept_options
from gibbs_codegen.flight.control.geometric import LeaningController
from gibbs_codegen.flight.plant.allocation import Allocation, force_axis
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.machine.law_functions import law_functions
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.balance import carried_rotors
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.text import robot_text

pytestmark = pytest.mark.usefixtures("derived_once")

Array = NDArray[np.floating]
# What each law calls, in modules that have nothing else.
CALLED = {
    "computed_torque": ["input_matrix", "inverse_dynamics", "positions", "difference"],
    "geometric": [
        *("mass_matrix", "input_matrix", "inverse_dynamics", "positions"),
        *("centre_of_mass", "centre_of_mass_jacobian"),
    ],
}
_FRAME = ["frame_poses", "frame_jacobians", "frame_bias_accelerations"]
CALLED["force"] = CALLED["impedance"] = [*CALLED["computed_torque"], *_FRAME]
CALLED["geometric_force"] = [*CALLED["geometric"], *_FRAME]
# What it calls besides comes with it.
CALLED["adaptive"] = CALLED["computed_torque"]
# With angles, with a quaternion and on wheels, and less of these; of hydrus joints move the rotors,
# and of delta_hexarotor loops.
CASES = {
    "hexarotor_3link": ["force", "adaptive"],
    "quadrotor_arm_2link": ["geometric_force"],
    "hydrus": ["geometric"],
    "planar_quadrotor_arm": ["geometric_force"],
    "rover_arm": ["computed_torque"],
    "delta_hexarotor": ["geometric"],
}
# Of few functions not all that a module has for them is called.
OPTIONS = ["-O0", "-shared", "-fPIC", "-Wno-unused-function"]


@dataclass(frozen=True)
class Case:
    """A module with a law."""

    module: ModuleType
    law: str

    @property
    def name(self) -> str:
        """The robot's name."""
        return str(self.module.NAME)

    @property
    def sources(self) -> list[str]:
        """Those of the functions and of the law."""
        folder = Path(self.module.__path__[0])
        return [str(folder / f"{self.name}{ending}.c") for ending in ("", "_laws")]

    @cached_property
    def programs(self) -> list[Program]:
        """What is known of the rotors, and the law."""
        points = self.module.POINTS
        centre = points.index("O2" if "O2" in points else "base")
        moves = bool(carried_rotors(read_robot(self.name)[0]))
        tip = self.module.FRAMES.index("tip") if "tip" in self.module.FRAMES else 0
        found = law_functions(Functions(self.module), [self.law], centre, tip, moves)
        return [function.program for function in found]

    @property
    def undriven(self) -> list[str]:
        """Joints that loops move."""
        return Functions(self.module).undriven

    def inputs(self, seed: int) -> dict[str, Array]:
        """Random values of what a caller of the law gives."""
        rng, module = np.random.default_rng(seed), self.module
        program = self.programs[1]
        found = {
            name: rng.uniform(-0.4, 0.4, x.shape)
            for name, x in zip(program.names, program.inputs, strict=True)
        }
        for name in ("q", "desired_q"):
            if module.ATTITUDE == "quaternion":
                place = slice(3, 7)
                found[name][3:6] *= 0.5
                found[name][6] = 1.0
                found[name][place] /= np.linalg.norm(found[name][place])
        found["stiffness"] = rng.uniform(2.0, 6.0, found["stiffness"].shape)
        found["damping"] = rng.uniform(2.0, 5.0, found["damping"].shape)
        if "frame_inertia" in found:
            found["frame_inertia"] = rng.uniform(0.5, 2.0, 3)
        if "parameters" in found:  # Bounds hold for some of them.
            found["least_parameters"] = -0.2 + 0.0 * found["parameters"]
            found["most_parameters"] = 0.2 + 0.0 * found["parameters"]
            found["adaptation"] = np.abs(found["adaptation"])
        found["least"] = np.full(len(module.INPUTS), -np.inf)
        found["most"] = np.full(len(module.INPUTS), np.inf)
        return found

    def structures(self, given: dict[str, Array]) -> list[list[Array]]:
        """Members of gains, state and reference."""
        known = [*self.programs[0].outputs]
        own = [name for name in self.programs[1].names if name not in known]
        gains = ("stiffness", "damping", "least", "most", "adaptation")
        gains = (*gains, "least_parameters", "most_parameters", "back")
        state = ("q", "v", "wrench")
        of_gains = [name for name in own if name in gains or name.startswith("frame_")]
        parts = [of_gains, [name for name in own if name in state]]
        learnt = ("parameters", "h")
        parts.append([name for name in own if name not in (*of_gains, *state, *learnt)])
        parts += [["parameters"]] if "parameters" in own else []
        return [[given[name] for name in part] for part in parts]

    def numpy(self, given: dict[str, Array]) -> tuple[dict[str, Array], Array]:
        """What is known of the rotors, and the inputs, with what is learnt after them."""
        owners = {"robot": self.module}
        rotors = evaluate(self.programs[0], {}, owners, externals=EXTERNALS)
        found = evaluate(self.programs[1], {**given, **rotors}, owners, externals=EXTERNALS)
        return rotors, np.concatenate([*found.values()])


def smallest_thrusts(columns: Array, wrench: Array) -> Array:
    return np.linalg.pinv(columns.T, rcond=1e-9) @ wrench


def nearest_thrusts(
    thrusts: Array, wrench: Array, columns: Array, least: Array, most: Array
) -> Array:
    if np.all((thrusts >= least) & (thrusts <= most)):
        return thrusts
    return Allocation(columns.T, np.array([least, most])).thrusts(wrench)


EXTERNALS = {
    "smallest_thrusts": smallest_thrusts,
    "nearest_thrusts": nearest_thrusts,
    "force_axis": lambda columns: force_axis(columns.T),
}


SLOW = ("quadrotor_arm_2link", "planar_quadrotor_arm", "rover_arm")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param((name, law), marks=[pytest.mark.slow] if name in SLOW else [])
        for name, laws in CASES.items()
        for law in laws
    ],
    ids="-".join,
)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    name, law = request.param
    out = tmp_path_factory.mktemp("laws")
    folder = generate(name, out, functions=CALLED[law], laws=[law], verify=False)
    return Case(load(folder), law)


class InC:
    """A law of a shared library; structures have reals alone, one after the other."""

    def __init__(self, case: Case, compiler: str, real: type[np.floating], folder: Path) -> None:
        single = real is np.float32
        options = [f"-D{case.name.upper()}_FLOAT"] if single else []
        path = build(compiler, [*OPTIONS, *options], case.sources, folder / f"{compiler}.so")
        self._library, self._case, self._real = ctypes.CDLL(str(path)), case, real
        mark = "_float" if single else ""
        self._constants = ctypes.addressof(
            ctypes.c_char.in_dll(self._library, f"{case.name}_default_constants{mark}")
        )

    def _call(self, name: str, arrays: Sequence[Array]) -> None:
        number = ctypes.c_float if self._real is np.float32 else ctypes.c_double
        pointers = [ctypes.c_void_p(x.ctypes.data) if x.shape else number(float(x)) for x in arrays]
        function = self._library[f"{self._case.name}_{name}"]
        function.restype = None
        function(ctypes.c_void_p(self._constants), *pointers)

    def run(self, given: dict[str, Array]) -> tuple[dict[str, Array], Array]:
        """What is known of the rotors, and the inputs, with what is learnt after them."""
        known, law = self._case.programs
        sizes = [x.size for x in known.outputs.values()]
        rotors = np.full(sum(sizes), np.nan, self._real)
        self._call("init_rotors", [rotors])
        parts = np.split(rotors, np.cumsum(sizes)[:-1])
        found = {
            name: part.reshape(x.shape)
            for (name, x), part in zip(known.outputs.items(), parts, strict=True)
        }
        u = np.full(len(self._case.module.INPUTS), np.nan, self._real)
        structures = [
            np.concatenate([np.ravel(part) for part in parts]).astype(self._real)
            for parts in self._case.structures(given)
        ]
        time = [given["h"]] if "h" in given else []
        self._call(law.name, [rotors, *structures, *time, u])
        return found, np.concatenate([u, *(structures[3:])])


@pytest.mark.parametrize(
    ("compiler", "real", "tolerance"),
    [("gcc", np.float64, 1e-12), ("clang", np.float32, 1e-4)],
    ids=["double", "float"],
)
def test_laws_have_the_numbers_of_numpy(
    case: Case, compiler: str, real: type[np.floating], tolerance: float, tmp_path: Path
) -> None:
    law = InC(case, compiler, real, tmp_path)
    for seed in range(4):
        given = case.inputs(seed)
        rotors, wanted = case.numpy(given)
        count = len(case.module.INPUTS)
        loads = [wanted[case.module.INPUTS.index(f"tau_{name}")] for name in case.undriven]
        np.testing.assert_allclose(loads, 0.0, atol=1e-6)
        if seed > 1:  # Limits that bind.
            given["least"] = np.sort(wanted[:count])[count // 4] * np.ones(count)
            given["most"] = np.sort(wanted[:count])[(3 * count) // 4] * np.ones(count)
            _, wanted = case.numpy(given)
        found, u = law.run(given)
        for name, values in rotors.items():
            np.testing.assert_allclose(found[name], values, rtol=0, atol=tolerance * _size(values))
        # Thrusts beside limits are least squares, solved by another algorithm.
        share = 1.0 if seed < 2 else max(1.0, 1e-9 / tolerance)
        np.testing.assert_allclose(u, wanted, rtol=0, atol=share * tolerance * _size(wanted))


def _size(values: Array) -> float:
    return max(1.0, float(np.abs(values).max()))


def test_inputs_that_are_no_numbers_are_told(case: Case, tmp_path: Path) -> None:
    given = case.inputs(0)
    given["v"][0] = np.nan
    assert np.isnan(InC(case, "gcc", np.float64, tmp_path).run(given)[1]).any()


@pytest.mark.parametrize(("compiler", "level", "single"), [("g++", "-O1", True)])
def test_laws_compile_silently_as_cpp_too(
    compiler: str, level: str, single: bool, case: Case, tmp_path: Path
) -> None:
    options = [f"-D{case.name.upper()}_FLOAT"] if single else []
    compile_only(compiler, [level, *options], case.sources[1:], tmp_path)
    header = " ".join(Path(case.sources[1]).with_suffix(".h").read_text(encoding="utf-8").split())
    on_wheels = case.name == "rover_arm"
    assert f"Data of the {'wheels' if on_wheels else 'rotors'} for laws;" in header
    assert ("torques of the wheels" in header) == on_wheels


def test_text_is_narrow_calls_little_and_allocates_nothing(case: Case) -> None:
    for ending in (".h", ".c"):
        text = Path(case.sources[1]).with_suffix(ending).read_text(encoding="utf-8")
        assert max(map(len, text.partition("SPDX")[2].splitlines())) <= 100
        assert text.isascii()
        assert re.search(r"\b(malloc|calloc|realloc|free|printf)\(", text) is None
        assert text.startswith("/* Generated by gibbs_codegen")


def test_computed_torque_is_that_of_the_paper() -> None:
    """Without errors it is the inverse dynamics of the desired motion, and B u makes it up."""
    case = Case(load(ROOT / "generated" / "hexarotor_3link"), "computed_torque")
    given = case.inputs(5)
    given |= {"desired_q": given["q"], "desired_v": given["v"]}
    u = case.numpy(given)[1]
    q, v, a = (given[name] for name in ("q", "v", "desired_a"))
    needed = case.module.inverse_dynamics(q, v, a)
    assert case.module.input_matrix(q) @ u == pytest.approx(needed, abs=1e-9)


def test_bounded_least_squares_of_the_test_are_scipys() -> None:
    rng = np.random.default_rng(2)
    columns, wrench = rng.normal(size=(8, 6)), rng.normal(size=6)
    found = nearest_thrusts(np.full(8, 9.0), wrench, columns, np.zeros(8), np.full(8, 0.2))
    force, torque = (np.linalg.norm(columns[:, part]) for part in (slice(3), slice(3, 6)))
    weights = np.repeat([1.0, force / torque], 3)
    best = lsq_linear(weights[:, np.newaxis] * columns.T, weights * wrench, (0.0, 0.2))
    assert np.linalg.norm(weights * (columns.T @ found - wrench)) == pytest.approx(
        np.sqrt(2 * best.cost), rel=1e-6
    )


def test_laws_run_on_microcontrollers(case: Case) -> None:
    """In single and in double precision by turns."""
    processor = M7 if case.law.startswith("geometric") else M4F
    given = [case.inputs(seed) for seed in range(2)]
    for values in given:
        values["parameters"] = np.zeros_like(values.get("parameters", 0.0))
        values["h"] = np.zeros(())
    folder = Path(case.module.__path__[0])
    found = called(case.name, case.law, folder, processor, [case.structures(x)[:3] for x in given])
    tolerance = 1e-4 if processor.real is np.float32 else 1e-12
    for u, values in zip(found.u, given, strict=True):
        wanted = case.numpy(values)[1][: len(u)]
        np.testing.assert_allclose(u, wanted, rtol=0, atol=tolerance * _size(wanted))
    assert (found.instructions > 100).all()
    assert (found.instructions < 100_000).all()


# Who gets which law


@pytest.mark.parametrize(
    ("name", "laws", "targets", "message"),
    [
        (
            "quadrotor",
            ["pid"],
            ["c"],
            "--laws pid: unknown; known laws: computed_torque, geometric",
        ),
        ("quadrotor", ["geometric"], ["numpy"], "laws need the target c; add --target c"),
        (
            "quadrotor",
            ["computed_torque"],
            ["c"],
            "fully actuated.*force along x.*choose geometric",
        ),
        ("hexarotor_3link", ["geometric"], ["c"], "command all directions; choose computed_torque"),
        ("rover_arm", ["geometric"], ["c"], "but there are none; choose computed_torque"),
        (
            "quadrotor",
            ["geometric_force"],
            ["c"],
            "quadrotor: .* moves the tip by joints, and there are none; choose geometric$",
        ),
        pytest.param(
            "dual_arm",
            ["geometric_impedance"],
            ["c"],
            r'moves the frame tip, .* are .*left_hand.*; add a \[\[frame\]\] named "tip"',
            marks=pytest.mark.slow,
        ),
    ],
)
def test_laws_that_do_not_suit_are_refused(
    name: str, laws: list[str], targets: list[str], message: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=message):
        generate(name, tmp_path, targets, laws=laws, verify=False)
    assert not [*tmp_path.iterdir()]


def test_a_robot_without_rotors_gets_none(tmp_path: Path) -> None:
    robot, _ = read_robot("quadrotor")
    bare = replace(robot, name="bare", thrusters=(), base=replace(robot.base, rotors=0))
    with pytest.raises(UsageError, match="laws command rotors, and bare has none"):
        generate_robot(bare, robot_text(bare), tmp_path, laws=["geometric"], verify=False)


def test_an_arm_on_the_ground_has_laws_without_rotors(tmp_path: Path) -> None:
    text = 'name = "bolted"\n[base]\nmotion = "fixed"\n'
    text += '[[link]]\nname = "rod"\nxyz = [0, 0, 0]\naxis = "y"\nlength = 1\nmass_per_length = 2\n'
    robot = parse_robot(text)
    generate_robot(robot, text, tmp_path, laws=["computed_torque"], verify=False)
    folder = tmp_path / "bolted"
    path = build(
        "gcc", OPTIONS, [folder / f"bolted{x}.c" for x in ("", "_laws")], tmp_path / "x.so"
    )
    library = ctypes.CDLL(str(path))
    assert not hasattr(library, "bolted_init_rotors")
    constants = ctypes.addressof(ctypes.c_char.in_dll(library, "bolted_default_constants"))
    # Stiffness, damping and limits; q and v; desired q, v and a.
    parts = [[4.0, 3.0, -100.0, 100.0], [0.3, 0.2], [0.5, 0.1, 0.7]]
    structures, u = [np.array(part) for part in parts], np.zeros(1)
    pointers = [ctypes.c_void_p(x.ctypes.data) for x in (*structures, u)]
    library.bolted_computed_torque(ctypes.c_void_p(constants), *pointers)
    a = 0.7 + 4.0 * (0.5 - 0.3) + 3.0 * (0.1 - 0.2)
    np.testing.assert_allclose(u, 2.0 / 3.0 * a - 2.0 * 9.81 * 0.5 * np.cos(0.3), rtol=1e-12)


def test_functions_that_a_law_calls_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"geometric needs mass_matrix, .*: add them to --functions"
    ):
        generate(
            "quadrotor", tmp_path, functions=["forward_dynamics"], laws=["geometric"], verify=False
        )


@pytest.mark.slow
def test_a_module_keeps_its_laws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["generate", "quadrotor", "--out", str(tmp_path), "--no-verify"]
    assert main([*words, "--laws", "geometric"]) == 0
    folder = tmp_path / "quadrotor"
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {"quadrotor_laws.h", "quadrotor_laws.c"} < {*files}
    assert kept_options(folder) == "--laws=geometric"
    assert main(["generate", "quadrotor", "--out", str(tmp_path), "--check"]) == 0
    assert main(words) == 0
    assert "earlier options: --laws=geometric" in capsys.readouterr().out
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == files
    assert main([*words, "--laws", "none"]) == 0
    assert not (folder / "quadrotor_laws.c").exists()


@pytest.mark.slow
def test_a_target_that_this_version_lacks_is_no_more_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = "--target=numpy --target=old --functions=kinematics"
    monkeypatch.setattr("gibbs_codegen.cli.generate.kept_options", lambda _: kept)
    assert main(["generate", "quadrotor", "--out", str(tmp_path), "--no-verify"]) == 0
    said = capsys.readouterr()
    assert "generated with --target old, which this version does not have" in said.err
    assert "earlier options: --target=numpy --functions=kinematics\n" in said.out
    assert not (tmp_path / "quadrotor" / "quadrotor.c").exists()


@pytest.mark.slow
def test_a_flight_on_an_emulated_processor_is_that_of_the_simulator(tmp_path: Path) -> None:
    """By throttle, speeds, servos with backlash and friction, and a battery: all of it in C."""
    robot = actuated()
    robot = replace(robot, thrusters=tuple(replace(x, **NO_AIR) for x in robot.thrusters))
    text, step, steps = robot_text(robot), 2.5e-4, 20
    (tmp_path / "actuated.toml").write_text(text, encoding="utf-8")
    folder = generate(tmp_path / "actuated.toml", tmp_path, laws=["geometric"], verify=False)
    module, rate = load(folder, "c"), 1.0 / (step * steps)
    scenario = read_scenario(
        "hover",
        {
            "start": {"offset": [0.05, -0.02, 0.03]},
            "control": {"rate": rate},
            "duration": 0.25,
            "integration": {"method": "rk4", "step": step, "rate": rate},
        },
    )
    flight = simulate(module, scenario)
    loop = flight_start(module, scenario, lambda *_: None, custom_law=False).loop
    law, samples = loop.controller, len(flight.time) - 1
    assert isinstance(law, LeaningController)
    limits = loop.actuators.commands
    assert limits is not None
    found = flown(
        "actuated",
        law.law,
        folder,
        M7,
        {
            "COORDINATES": len(module.COORDINATES),
            "VELOCITIES": len(module.VELOCITIES),
            "INPUTS": len(module.INPUTS),
            "STATES": len(module.ACTUATOR_STATES),
            "QUATERNION": module.COORDINATES.index("qx"),
            "SAMPLES": samples,
            "STEPS": steps,
            "STEP": step,
        },
        {
            "gains": [law.gains.stiffness, law.gains.damping, *loop.actuators.inputs],
            "reference": [*law.reference(0.0), *law.centre(np.zeros(1))[0]],
        },
        {
            "begin": np.concatenate([flight.q[0], flight.v[0]]),
            "least": limits[0],
            "most": limits[1],
        },
    )
    wanted = np.concatenate([flight.q, flight.v, flight.actuators], axis=1)[1:]
    size = np.maximum(np.abs(wanted).max(axis=0), 1.0)
    assert np.abs(flight.commands - flight.commands[0]).max(axis=0).min() > 1e-4
    assert np.abs((found - wanted) / size).max() < 1e-9
