"""Modules with the derivatives that linear models are made of."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from support.kept import made_once

from gibbs_codegen import generate, load


@pytest.fixture(scope="session")
def differentiated(kept: Path) -> Callable[[str], ModuleType]:
    """Load the module of a robot that ships, with `forward_dynamics_derivatives`."""
    modules = kept / "differentiated"

    @functools.cache
    def module(name: str) -> ModuleType:
        wanted = ["forward_dynamics_derivatives"]
        make = functools.partial(generate, name, modules, verify=False, derivatives=wanted)
        return load(made_once(modules / name, make))

    return module
