"""Modules with the derivatives that linear models are made of."""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import ModuleType

import pytest
from support.kept import kept_folder, made_once

from gibbs_codegen import generate, load


@pytest.fixture(scope="session")
def differentiated() -> Callable[[str], ModuleType]:
    """Load the module of a robot that ships, with `forward_dynamics_derivatives`."""

    @functools.cache
    def module(name: str) -> ModuleType:
        wanted = ["forward_dynamics_derivatives"]
        modules = kept_folder(name, wanted)
        make = functools.partial(generate, name, modules, verify=False, derivatives=wanted)
        return load(made_once(modules / name, make))

    return module
