"""Verification: what is right passes, and what is wrong anywhere does not."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from support.emitted import emitted_module
from support.kept import kept_folder, made_once
from support.planted_faults import ANY_IN_C, planted
from support.random_robots import robots
from support.tools import tool

from gibbs_codegen.errors import UsageError
from gibbs_codegen.pipeline import generate, generate_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load
from gibbs_codegen.verification.comparison import UNKNOWN, compared
from gibbs_codegen.verification.contents import compare_c_defaults, compare_contents
from gibbs_codegen.verification.equations import frame_rows
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.modules import verify
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array
from gibbs_codegen.verification.verify import QUICK, compare_module, formulations

pytestmark = pytest.mark.usefixtures("derived_once")


def failing(comparisons: list) -> list[str]:
    """Names of what failed."""
    return [c.what for c in comparisons if not c.passed]


@pytest.fixture
def copied(whole_module: Path, tmp_path: Path) -> Path:
    """A copy of a module, with rollouts in C."""
    folder = tmp_path / "quadrotor_2link"
    shutil.copytree(whole_module, folder, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture(scope="session")
def whole_module() -> Path:
    """A module of all targets in C."""
    targets = ["numpy", "c", "rollout"]
    made = kept_folder("quadrotor_2link", targets)
    made_once(made, lambda: generate("quadrotor_2link", made, targets, verify=False))
    return made / "quadrotor_2link"


HELD = """
[[constraint]]
name  = "held"
type  = "frame"
frame = "base"
xyz   = [0.1, 0.2, 0.3]
"""


def compared_at_one_state(module: ModuleType, robot: Robot) -> set[str]:
    """What a module was compared with, at one state: a wrong formula is wrong at any."""
    found, not_done = formulations(robot)
    comparisons = compare_module(module, robot, found, 1, 0, extent=QUICK)
    assert failing(comparisons) == []
    assert set(not_done) <= {"Pinocchio", "MuJoCo"}
    return {c.against for c in comparisons}


@pytest.mark.slow
# Rods, arms on a quaternion, rotors on links, a base that moves in a plane, and wheels.
@pytest.mark.parametrize(
    "name",
    [
        "hexarotor_3link",
        "dual_arm",
        "hydrus",
        "planar_quadrotor_arm",
        "rover_arm",
    ],
)
def test_shipped_robots_pass(name: str, shipped: Callable[[str], ModuleType]) -> None:
    against = compared_at_one_state(shipped(name), read_robot(name)[0])
    assert {
        "Newton–Euler",
        "Lagrange",
        "Newton–Euler, other parameters",
        "power balance, Ė = vᵀB u",
    } <= against


@pytest.mark.slow
def test_a_robot_that_is_held_passes_with_derivatives(tmp_path: Path) -> None:
    """With attitude angles; those with a quaternion are in `properties/test_constraints.py`."""
    name = "quadrotor_2link"
    path = tmp_path / f"{name}.toml"
    path.write_text(robot_text(read_robot(name)[0]) + HELD)
    groups = ("default", "constraints", "parameters", "steps")
    options = {"derivatives": True, "functions": groups, "verify": False}
    module = load(generate(path, tmp_path, ["numpy"], **options))
    compared_at_one_state(module, read_robot(str(path))[0])


@pytest.mark.slow
def test_a_base_that_is_carried_passes_with_derivatives(tmp_path: Path) -> None:
    """It has no rotors and no joints that move, hence no inputs."""
    body = RigidBody(0.0, 2.0, inertia=(0.03, 0.03, 0.05, 0.0, 0.0, 0.0))
    mast = RigidBody(0.0, 0.2, inertia=(1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0))
    links = (
        Link(mast, pose=Pose((0.0, 0.0, 0.1)), joint="fixed"),
        Link(mast, pose=Pose((0.1, 0.0, 0.1)), joint="fixed", constrained=True),
    )
    robot = Robot("carried", Base(attitude="quaternion", origin="base", body=body), links)
    steps = ("step_euler", "step_euler_derivatives", "step_rk4_derivatives")
    names = ("integrate_derivatives", "input_forces_hessian", *steps)
    options = {"derivatives": names, "verify": False}
    _, folder = generate_robot(robot, robot_text(robot), tmp_path, **options)
    found = verify(folder, backends=["numpy"])
    assert found.passed, found.failures
    pytest.importorskip("casadi")
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    given = state, 0.1 * np.ones(6), np.zeros(0), 0.01
    there, here = (load(folder, x).step_rk4_derivatives(*given) for x in ("casadi", "numpy"))
    for theirs, ours in zip(there, here, strict=True):
        assert theirs.full().reshape(ours.shape) == pytest.approx(ours, abs=1e-12)


@pytest.mark.slow
@settings(max_examples=2)
@given(robot=robots(most_rotors=7, most_links=6))
def test_random_robots_pass(robot: Robot) -> None:
    module = emitted_module(robot)
    found, _ = formulations(robot)
    assert failing(compare_module(module, robot, found, 2, 0)) == []


@pytest.mark.slow
def test_both_back_ends_are_verified(copied: Path) -> None:
    tool("cc")
    found = verify(copied, states=1)
    assert found.passed, found.failures
    assert list(found.comparisons) == ["numpy", "c"]
    # C has default parameters, constants, batches, pack, unpack and single precision of its own.
    against = {
        backend: {c.against for c in comparisons}
        for backend, comparisons in found.comparisons.items()
    }
    own = {"Newton–Euler, last block not full", "Newton–Euler, single precision", "the header"}
    own |= {"NumPy, in double precision", "NumPy, in single precision"}
    assert against["numpy"] == against["c"] - own
    assert own < against["c"]
    assert 100 < len(found.comparisons["numpy"]) < len(found.comparisons["c"])


@pytest.mark.slow
def test_planted_faults_are_found(copied: Path) -> None:
    """Four times one sign or one index of the NumPy module altered."""
    path = copied / "numpy_module.py"
    missed = []
    for text, what in planted(path.read_text(encoding="utf-8"), 4, seed=11):
        path.write_text(text, encoding="utf-8")
        if verify(copied, states=3, backends=["numpy"]).passed:
            missed.append(what)
    assert not missed, "\n".join(missed)


@pytest.mark.slow
def test_planted_faults_in_c_are_found(copied: Path) -> None:
    tool("cc")
    path = copied / "quadrotor_2link.c"
    missed = []
    for text, what in planted(path.read_text(encoding="utf-8"), 1, seed=5):
        path.write_text(text, encoding="utf-8")
        found = verify(copied, states=9, backends=["c"])
        assert list(found.comparisons) == ["c"], found.not_done
        if found.passed:
            missed.append(what)
    assert not missed, "\n".join(missed)


# Compares rollouts alone, in a process that a fault may end.
ROLLOUTS = """
import sys
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.verification.c_program import compare_rollouts
from gibbs_codegen.verification.tree import Tree
tree, numpy = Tree(read_robot(sys.argv[1] + "/robot.toml")[0]), load(sys.argv[1])
for precision in ("double", "single"):
    (found,), _ = compare_rollouts(numpy, tree, 0, precision, ("-O0",))
    compiles = " failed: " not in found.fault
    print("passed" if found.passed else "failed" if compiles else "uncompiled", flush=True)
"""


@pytest.mark.slow
def test_planted_faults_in_rollouts_are_found(copied: Path) -> None:
    tool("cc")
    path = copied / "quadrotor_2link_rollout.c"
    text = path.read_text(encoding="utf-8")
    command = [sys.executable, "-c", ROLLOUTS, str(copied)]
    missed, apart = [], []  # Apart are those that no compiler takes, or that end the process.
    # Before the programs stand functions of numbers, of which no program calls all.
    begin, programs, rest = text.partition("static void program_")
    for altered, what in planted(programs + rest, 2, seed=1, statement=ANY_IN_C):
        path.write_text(begin + altered, encoding="utf-8")
        found = subprocess.run(command, check=False, capture_output=True, text=True)
        said = found.stdout.split()  # In double precision, and in single.
        if "uncompiled" in said or found.returncode < 0:
            apart.append(what)
        elif "failed" not in said:
            missed.append(what)
    assert len(apart) <= 1, apart
    path.write_text(text, encoding="utf-8")
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    assert found.stdout.split() == ["passed", "passed"]
    assert not missed, "\n".join(missed)


class OffByLittle(NewtonEuler):
    """Newton and Euler, wrong by a billionth in one place."""

    def mass_matrix(self, q: Array) -> Array:
        """The mass matrix with one entry off."""
        matrix = super().mass_matrix(q)
        place = self.tree.free[1]
        matrix[:, place, place] *= 1 + 1e-9
        return matrix


def test_an_oracle_that_is_off_by_a_billionth_fails(shipped) -> None:
    """The check itself is checked: it sees 1e-9, and names what was altered."""
    robot, module = read_robot("quadrotor_2link")[0], shipped("quadrotor_2link")
    tree = Tree(robot)
    comparisons = compare_module(module, robot, [NewtonEuler(tree), OffByLittle(tree)], 3, 0)
    assert "mass_matrix" in failing(comparisons)
    assert "tip_jacobian" not in failing(comparisons)


@pytest.mark.parametrize(
    ("old", "new", "failed"),
    [
        ('"theta_0",', '"theta_zero",', {"COORDINATES", "HYBRID_COORDINATES"}),
        ('"gravity": 9.81', '"gravity": 9.8', {"PARAMETERS"}),
        ('ATTITUDE = "xyz"', 'ATTITUDE = "zyx"', {"ATTITUDE"}),
        ('"motor2", "motor3"', '"motor3", "motor2"', {"POINTS"}),
        ("\ndef _kinetic_energy(", "\ndef _kinetic_enemy(", {"kinetic_energy"}),
        ("shaped(entries[0:64], (8, 8), batch), ", "", {"mass_matrix_and_residual.mass_matrix"}),
        ("import math\n", "import maths\n", {"the module"}),
        ("import math\n", "import (math\n", {"the module"}),
        ("import math\n", "import math\nraise SystemError('no')\n", {"the module"}),
        ("import math\n", "import math\nraise SystemExit(0)\n", {"the module"}),
        (
            '    """An output of a function, from its',
            '    raise SystemExit(0)\n    """An output of a function, from its',
            {"forward_dynamics"},
        ),
        ('"gravity": 9.81', '"gravity": np.ones(2)', {"PARAMETERS"}),
        ("np.ndim(constant) else float(constant)", "False else np.mean(constant)", {"mass_matrix"}),
    ],
)
def test_whatever_was_done_to_a_module_is_a_failure_with_a_reason(
    old: str, new: str, failed: set[str], copied: Path
) -> None:
    path = copied / "numpy_module.py"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    found = verify(copied, states=2, backends=["numpy"])
    assert failed <= {c.what for _, c in found.failures}
    assert all(c.fault or not math.isfinite(c.error) or c.error > 0 for _, c in found.failures)


@pytest.mark.slow
def test_a_module_without_carriers_fails() -> None:
    robot = read_robot("quadrotor_2link")[0]
    module = emitted_module(robot)
    del module.CARRIERS
    assert failing(compare_contents(module, robot)) == ["CARRIERS"]


@pytest.mark.slow
def test_a_function_that_gives_what_is_not_a_number_fails(copied: Path) -> None:
    path = copied / "numpy_module.py"
    text = path.read_text(encoding="utf-8")
    assert "t8 = cos(t7)" in text
    path.write_text(text.replace("t8 = cos(t7)", "t8 = math.nan"), encoding="utf-8")
    found = verify(copied, states=2, backends=["numpy"])
    assert {"residual", "forward_dynamics"} <= {c.what for _, c in found.failures}


def test_default_constants_of_c_are_right_to_rounding(fast) -> None:
    """They are written with 17 digits by Python, and computed by C, which rounds otherwise."""
    tool("cc")
    rows = compare_c_defaults(fast("hexarotor_3link"), read_robot("hexarotor_3link")[0])
    assert len(rows) == 2
    assert failing(rows) == []


def test_a_robot_file_that_was_edited_afterwards_fails(copied: Path) -> None:
    with (copied / "robot.toml").open("a", encoding="utf-8") as file:
        file.write("# one more comment\n")
    found = verify(copied, states=2, backends=["numpy"])
    assert [c.what for _, c in found.failures] == ["robot.toml"]


def test_another_robot_s_numbers_fail(shipped) -> None:
    robot = read_robot("quadrotor_2link")[0]
    module = shipped("quadrotor_2link")
    other = replace(robot, gravity=3.71)
    assert failing(compare_module(module, other, [NewtonEuler(Tree(other))], 2, 0)) == [
        "PARAMETERS"
    ]


def test_what_cannot_be_verified_is_told(copied: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no generated module there"):
        verify(tmp_path / "none")
    with pytest.raises(UsageError, match="states: from 1 to 10000, not 0"):
        verify(copied, states=0)
    with pytest.raises(UsageError, match="back end 'fortran': unknown; known: numpy, c"):
        verify(copied, backends=["fortran"])
    (copied / "robot.toml").unlink()
    with pytest.raises(UsageError, match=r"has no robot\.toml"):
        verify(copied)


@pytest.mark.slow
def test_a_module_without_c_says_so(tmp_path: Path) -> None:
    found = verify(generate("hexarotor", tmp_path, ["numpy"], verify=False), states=1)
    assert found.passed
    assert found.not_done["back end c"] == "the module was generated without the C target"


def test_states_are_away_from_the_singular_attitude() -> None:
    from gibbs_codegen.verification.states import States

    states = States.random(Tree(read_robot("quadrotor_2link")[0]), 200, 0)
    assert np.abs(states.q[:, 1]).max() < 1.3
    assert np.abs(states.q[:, 0]).max() > 3.0


def test_an_arm_that_is_folded_has_the_sizes_of_its_terms() -> None:
    """Rounding takes a share of l², r² and 2 l r cos φ each, of which little is left at φ = π."""
    tree = Tree(read_robot("quadrotor_arm_2link")[0])
    states = States.random(tree, 50, 0)
    matrices = formulated(NewtonEuler(tree)).at(states).mass_matrix[:, tree.free][:, :, tree.free]
    largest = np.abs(matrices).max(axis=0)
    assert largest[6, 6] > 2.0 * np.abs(matrices[:, 6, 6]).min()
    assert np.all(Sizes(tree, states).free_matrix > 0.999 * largest)


@pytest.mark.slow
def test_a_sign_that_tells_moments_of_inertia_apart(
    shipped: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    """The moments about x and y are equal in the robot file, and cannot be zero."""
    folder = tmp_path / "quadrotor"
    shutil.copytree(Path(shipped("quadrotor").__file__ or "").parent, folder)
    path = folder / "numpy_module.py"
    text = path.read_text(encoding="utf-8")
    (zero,) = re.findall(r"(k\d+) = base_inertia_xx - base_inertia_yy\b", text)
    faults = [*re.finditer(rf" - {zero}\b", text)]
    assert len(faults) == 2
    for fault in faults:
        path.write_text(f"{text[: fault.start()]} + {zero}{text[fault.end() :]}", encoding="utf-8")
        found = verify(folder, states=1, backends=["numpy"])
        assert "Newton–Euler, other parameters" in {c.against for _, c in found.failures}


def test_wrenches_whose_forces_cancel_have_a_size() -> None:
    """The error of a sum is a share of its terms, however little is left of them."""
    tree = Tree(read_robot("hexarotor_3link")[0])
    states = States.random(tree, 1, 0)
    found = NewtonEuler(tree).at(states)
    jacobians = found.jacobians[0, len(tree.motors) :][..., tree.free]
    cancelling = np.linalg.svd(jacobians.reshape(-1, jacobians.shape[-1]).T)[2][-1]
    states = replace(states, W=cancelling.reshape(states.W.shape))
    rows = frame_rows(tree, found, states, Sizes(tree, states))
    forces, size = next(row[1:] for row in rows if row[0] == "wrench_forces")
    assert np.all(np.abs(forces) < 1e-14)
    assert np.all(size > 1e-3)


def test_states_that_rounding_decides_are_counted_and_others_are_compared() -> None:
    theirs = np.array([[9.0, 0.0], [2.0, 1.0]])
    size = np.array([[UNKNOWN, 1.0], [1.0, 1.0]])
    right = compared("f", "g", np.array([[1.0, 0.0], [2.0, 1.0]]), theirs, size, 1e-12)
    assert (right.passed, right.states, right.unclear) == (True, 1, 1)
    assert not compared("f", "g", np.array([[1.0, 0.0], [2.0, 1.1]]), theirs, size, 1e-12).passed
