"""Fixtures shared by the tests: generated modules, made once per robot and session."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, settings

from gibbs_codegen.load import load
from gibbs_codegen.pipeline import generate

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


@pytest.fixture(scope="session", autouse=True)
def _compiled_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A cache of compiled libraries of the test run's own, which its processes share."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    os.environ["GIBBS_CODEGEN_CACHE"] = str(shared / "compiled")


@pytest.fixture(scope="session")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], ModuleType]:
    """Load the freshly generated module of a robot that ships."""
    folder = tmp_path_factory.mktemp("generated")
    made: dict[str, ModuleType] = {}

    def module(name: str) -> ModuleType:
        if name not in made:
            generate(name, folder)
            made[name] = load(folder / name)
        return made[name]

    return module
