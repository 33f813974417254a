"""Emitted modules as a user would import them, from robots made in a test."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path
from types import ModuleType

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.targets.registry import TARGETS, render_module

NUMPY = {"numpy": TARGETS["numpy"]}

_number = itertools.count()


def emitted_module(robot: Robot, keep_zeros: bool = False) -> ModuleType:
    """Derive, render for NumPy, write to a temporary folder, and import."""
    return module_of(derive(robot, keep_zeros))


def module_with_derivatives(robot: Robot, *names: str) -> ModuleType:
    """The same with the derivatives of these names, or with all."""
    return module_of(derive(robot, derivatives=names or "all"))


def module_of(model: Model) -> ModuleType:
    """Render a derived robot for NumPy, write it to a temporary folder, and import it."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / f"{model.robot.name}_{next(_number)}"
        package.mkdir()
        for name, text in render_module(model, "", NUMPY).items():
            (package / name).write_text(text, encoding="utf-8")
        return load(package)
