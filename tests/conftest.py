"""Fixtures shared by the tests: generated modules, made once per robot and session."""

from __future__ import annotations

import functools
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings
from support.compiled import Emitted, emit_labelled

from gibbs_codegen.pipeline import generate, generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

settings.register_profile(
    "project",
    deadline=None,
    database=None,
    print_blob=True,
    derandomize=bool(os.environ.get("CI")),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("project")

ROOT = Path(__file__).parent.parent

# Tests that repeat themselves with other numbers, and how many of their cases the default run has,
# so that it stays within minutes. The rest is for `pytest -m exhaustive`.
CASES_BY_DEFAULT = {
    "test_a_lost_flight_ends_with_its_reason": 4,
    "test_a_million_angles": 8,
    "test_an_emulated_processor_computes_the_desktops_bits_and_numpys_numbers": 1,
    "test_constants_that_c_computes_keep_their_digits": 2,
    "test_energy_balances_to_1e_8": 1,
    "test_every_attitude_and_origin": 4,
    "test_every_step_is_that_of_python": 8,
    "test_fixed_steps_are_of_fourth_order_with_gravity_on": 2,
    "test_machine_stands_where_its_frames_are": 2,
    "test_motion_inputs_and_constraint_torques_solve_the_hybrid_system": 1,
    "test_names_and_values_are_those_of_the_derivation": 2,
    "test_stack_is_what_the_header_promises": 3,
    "test_text_read_back_gives_the_same_numbers": 7,
    "test_what_is_right_passes_every_formulation": 4,
}
# Slow tests that repeat themselves with other numbers, and how many of their cases CI runs, so that
# it stays within its time on slow machines. The rest is for `pytest -m exhaustive`.
CASES_IN_CI = {
    "test_a_flood_is_refused_soon": 6,
    "test_a_stiff_flight_ends_with_the_reason": 1,
    "test_all_back_ends_are_accurate_ever_nearer_to_the_singularity": 2,
    "test_constants_that_c_computes_keep_their_digits": 2,
    "test_degenerate_robots": 1,
    "test_mass_matrix_keeps_its_digits": 1,
    "test_random_robots": 2,
    "test_shipped_robots_compile_silently": 10,
    "test_single_precision_is_near_double": 2,
    "test_ten_thousand_broken_robot_files": 2,
    "test_the_watch_sees": 5,
    "test_unstable_fixed_steps_are_refused_with_ones_that_serve": 1,
    "test_what_only_a_c_program_uses": 3,
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases that the default run and CI leave out, evenly spread over all of a test."""
    for kept, were_slow in ((CASES_BY_DEFAULT, False), (CASES_IN_CI, True)):
        for name, count in kept.items():
            cases = [item for item in items if item.name.startswith(f"{name}[")]
            cases = [i for i in cases if bool(i.get_closest_marker("slow")) == were_slow]
            chosen = {round(k * len(cases) / count) for k in range(count)}
            for place, item in enumerate(cases):
                if place not in chosen:
                    item.add_marker(pytest.mark.slow)
                    item.add_marker(pytest.mark.exhaustive)


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all processes of a test run share, for what takes long to make."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session", autouse=True)
def _compiled_cache(shared: Path) -> None:
    """A cache of compiled libraries of the test run's own, which its processes share."""
    os.environ["GIBBS_CODEGEN_CACHE"] = str(shared / "compiled")


def made_once(folder: Path, make: Callable[[], object]) -> Path:
    """A folder that the first process that wants it makes, while the others wait."""
    folder.parent.mkdir(exist_ok=True)
    with FileLock(f"{folder}.lock"):
        if not folder.is_dir():
            make()
    return folder


def compiled_soon(folder: Path) -> ModuleType:
    """The C back end of a module, compiled in half the time; flights do not wait for speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", f"{os.environ.get('CC') or 'cc'} -O1")
        return load(folder, backend="c")


@pytest.fixture(scope="session")
def shipped(shared: Path) -> Callable[[str], ModuleType]:
    """Load the freshly generated module of a robot that ships."""
    modules = shared / "generated"

    @functools.cache
    def module(name: str) -> ModuleType:
        return load(made_once(modules / name, lambda: generate(name, modules)))

    return module


@pytest.fixture(scope="session")
def fast(shipped: Callable[[str], ModuleType]) -> Callable[[str], ModuleType]:
    """Load the C back end of a robot that ships; NumPy's where nothing compiles."""

    @functools.cache
    def module(name: str) -> ModuleType:
        return compiled_soon(Path(shipped(name).__file__ or "").parent)

    return module


@pytest.fixture(scope="session")
def family(shared: Path) -> Callable[[int, int], ModuleType]:
    """Load the C back end of a member of the paper's family, by rotors and links."""
    modules = shared / "family"

    @functools.cache
    def module(rotors: int, links: int) -> ModuleType:
        robot = paper_family(rotors, links)
        text = robot_text(robot)
        made = made_once(modules / robot.name, lambda: generate_robot(robot, text, modules))
        return compiled_soon(made)

    return module


@pytest.fixture(scope="session")
def emitted(shared: Path) -> Callable[[str], Emitted]:
    """Emit a robot that ships, or another of `support.compiled`, with what it was emitted from."""
    base = shared / "emitted"

    @functools.cache
    def made(label: str) -> Emitted:
        model = base / f"{label}.pickle"

        def make() -> None:
            model.write_bytes(pickle.dumps(emit_labelled(label, base / label).model))

        folder = made_once(base / label, make)
        return Emitted(pickle.loads(model.read_bytes()), folder, load(folder))  # noqa: S301

    return made
