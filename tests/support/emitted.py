"""Emitted modules as a user would import them, from robots made in a test."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load
from gibbs_codegen.targets.registry import TARGETS, render_module
from support.compiled import EVERY_GROUP
from support.kept import kept_folder, made_once

NUMPY = {"numpy": TARGETS["numpy"]}

_number = itertools.count()


def emitted_module(robot: Robot, *functions: str, keep_zeros: bool = False) -> ModuleType:
    """Derive, render for NumPy, and import; what an earlier run has made of it serves again.

    It has the functions of these names and groups, or all but derivatives.
    """
    return _kept(robot, functions=functions or EVERY_GROUP, keep_zeros=keep_zeros)


def module_with_derivatives(robot: Robot, *names: str) -> ModuleType:
    """The same with the derivatives of these names, or with all."""
    return _kept(robot, functions=EVERY_GROUP, derivatives=names or "all")


def compiled_module(robot: Robot) -> ModuleType:
    """What `generate` makes, in C: motions to tight tolerances take a tenth of the time."""
    folder = kept_folder(robot, "c") / robot.name

    def make() -> None:
        generate_robot(robot, robot_text(robot), folder.parent, verify=False)

    return load(made_once(folder, make), backend="c")


def _kept(robot: Robot, **options: Any) -> ModuleType:
    folder = kept_folder(robot, options) / robot.name
    return load(made_once(folder, lambda: _write(derive(robot, **options), folder)))


def module_of(model: Model) -> ModuleType:
    """Render a derived robot for NumPy, write it to a temporary folder, and import it."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / f"{model.robot.name}_{next(_number)}"
        _write(model, package)
        return load(package)


def _write(model: Model, folder: Path) -> None:
    folder.mkdir()
    for name, text in render_module(model, "", NUMPY).items():
        (folder / name).write_text(text, encoding="utf-8")
