"""Fixtures shared by the tests: generated modules, made once for each state of the generator."""

from __future__ import annotations

import functools
import gc
import os
import pickle
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from support.compiled import EVERY_GROUP, SMALL, Emitted, emit_labelled
from support.derived import derived
from support.kept import KEPT_MODULES, forget_unused, generator_digest, made_once
from support.tools import KEPT_OBJECTS, compiler_to_run

from gibbs_codegen.pipeline import generate, generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime import c_library
from gibbs_codegen.runtime.load import load

settings.register_profile(
    "project",
    deadline=None,
    database=None,
    print_blob=True,
    derandomize=True,  # So that what is derived of an example is there in the next run.
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("project")

# Hypothesis looks for constants in the source of every module that is loaded. It takes seconds, and
# examples would be others after each change, and where other modules were loaded before.
providers.is_local_module_file = lambda path: False

ROOT = Path(__file__).parent.parent

# What is derived is many small objects that live long. To look for cycles among them as often as
# Python does takes a seventh of the time.
gc.set_threshold(50_000, 20, 20)

# C is compiled in a third of the time: what the source says does not depend on how well it is
# optimised, nor on what is inlined. Where that is what is tested, `optimized` stands; where it runs
# for longer than it compiles, `compiled_to_run`.
_SOON = " -O0 -Dalways_inline="
if _compiler := shutil.which("cc"):
    os.environ.setdefault("CC", _compiler + _SOON)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Neighbours, which share fixtures, run in one worker; one without work takes from others."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.option.dist == "load" else None


def pytest_sessionstart(session: pytest.Session) -> None:
    """Before any worker begins, remove what earlier runs have kept and nobody used for long."""
    cache = getattr(session.config, "cache", None)
    if cache is not None and not hasattr(session.config, "workerinput"):
        forget_unused(cache.mkdir("modules"))
        for kind in ("libraries", "objects", "jax"):
            forget_unused(cache.mkdir("compiled") / kind)


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all processes of a test run share, for what takes long to make."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session")
def kept(pytestconfig: pytest.Config, shared: Path) -> Path:
    """A folder for modules that later runs use again, until the generator changes."""
    cache = getattr(pytestconfig, "cache", None)  # There is none where pytest is to keep nothing.
    folder = (cache.mkdir("modules") if cache else shared / "modules") / generator_digest()
    folder.mkdir(parents=True, exist_ok=True)
    folder.touch()
    return folder


@pytest.fixture(scope="session", autouse=True)
def _kept_folders(pytestconfig: pytest.Config, shared: Path, kept: Path) -> None:
    """Folders of modules and compiled libraries of the tests' own, which later runs use again."""
    os.environ[KEPT_MODULES] = str(kept)
    cache = getattr(pytestconfig, "cache", None)
    folder = (cache.mkdir("compiled") if cache else shared) / "libraries"
    os.environ["GIBBS_CODEGEN_CACHE"] = str(folder)
    objects = folder.with_name("objects")
    objects.mkdir(parents=True, exist_ok=True)
    os.environ[KEPT_OBJECTS] = str(objects)


@pytest.fixture(scope="session", autouse=True)
def _patient() -> None:
    """Nothing says that it takes long, which depends on the machine."""
    c_library._PATIENCE = 3600.0


@pytest.fixture(scope="module")
def jax_in_double_precision(_kept_folders: None) -> Iterator[ModuleType]:
    """JAX, which computes in double precision, and keeps what XLA compiles for later runs."""
    jax = pytest.importorskip("jax")
    compiled = Path(os.environ[KEPT_OBJECTS]).with_name("jax")
    jax.config.update("jax_compilation_cache_dir", str(compiled))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_enable_x64", True)
    yield jax
    jax.config.update("jax_enable_x64", False)


@pytest.fixture(scope="module")
def derived_once() -> Iterator[None]:
    """What the tests of a module generate in this process is derived once for all runs."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("gibbs_codegen.pipeline", "gibbs_codegen.derivation.derive"):
            patch.setattr(f"{module}.derive", derived)
        yield


@pytest.fixture(scope="module")
def optimized() -> Iterator[None]:
    """C is compiled as users have it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", os.environ.get("CC", "cc").removesuffix(_SOON))
        yield


@pytest.fixture(scope="module")
def compiled_to_run() -> Iterator[None]:
    """C is compiled by `compiler_to_run`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", compiler_to_run())
        yield


@pytest.fixture(scope="session")
def shipped(kept: Path) -> Callable[[str], ModuleType]:
    """Load the freshly generated module of a robot that ships."""
    modules = kept / "generated"

    @functools.cache
    def module(name: str) -> ModuleType:
        return load(
            made_once(
                modules / name, lambda: generate(name, modules, functions=EVERY_GROUP, verify=False)
            )
        )

    return module


@pytest.fixture(scope="session")
def small(kept: Path) -> Path:
    """The folder of a small robot's module, as `generate` writes it by default."""
    modules = kept / "small"
    return made_once(modules / SMALL, lambda: generate(SMALL, modules, verify=False))


@pytest.fixture(scope="session")
def fast(shipped: Callable[[str], ModuleType]) -> Callable[[str], ModuleType]:
    """Load the C back end of a robot that ships; NumPy's where nothing compiles."""

    @functools.cache
    def module(name: str) -> ModuleType:
        return load(Path(shipped(name).__file__ or "").parent, backend="c")

    return module


@pytest.fixture(scope="session")
def family(kept: Path) -> Callable[[int, int], ModuleType]:
    """Load the C back end of a member of the paper's family, by rotors and links."""
    modules = kept / "family"

    @functools.cache
    def module(rotors: int, links: int) -> ModuleType:
        robot = paper_family(rotors, links)
        text = robot_text(robot)
        made = made_once(
            modules / robot.name,
            lambda: generate_robot(robot, text, modules, functions=EVERY_GROUP, verify=False),
        )
        return load(made, backend="c")

    return module


@pytest.fixture(scope="session")
def emitted(kept: Path) -> Callable[[str], Emitted]:
    """Emit a robot that ships, or another of `support.compiled`, with what it was emitted from."""
    base = kept / "emitted"

    @functools.cache
    def made(label: str) -> Emitted:
        model = base / f"{label}.pickle"

        def make() -> None:
            model.write_bytes(pickle.dumps(emit_labelled(label, base / label).model))

        folder = made_once(base / label, make)
        return Emitted(pickle.loads(model.read_bytes()), folder, load(folder))  # noqa: S301

    return made
