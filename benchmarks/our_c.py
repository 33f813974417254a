"""The project's own C as contenders, beside its peers."""

from __future__ import annotations

import ctypes
import subprocess
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
from peers.build import FLAGS, function
from peers.contender import (
    FORWARD_DYNAMICS,
    LANES,
    MASS_MATRIX_AND_RESIDUAL,
    Array,
    Contender,
    Results,
    States,
)

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.targets.registry import find_targets, render_module

ONE, BATCH = "gibbs_codegen", "gibbs_codegen, batch"

_GLUE = """
#include "{name}.h"

#define CALL(glue, f, count, ...) \\
    void glue(const double *q, const double *v, const double *u, double *first, double *second); \\
    __attribute__((visibility("default"))) \\
    void glue(const double *q, const double *v, const double *u, double *first, double *second) \\
    {{ (void)u; (void)second; {name}_##f(&{name}_default_constants count, __VA_ARGS__); }}

#define EIGHT , 8
CALL(matrix_one, mass_matrix_and_residual, , q, v, first, second)
CALL(matrix_batch, mass_matrix_and_residual_batch, EIGHT, q, v, first, second)
CALL(forward_one, forward_dynamics, , q, v, u, first)
CALL(forward_batch, forward_dynamics_batch, EIGHT, q, v, u, first)
"""


def our_contenders(robot: Robot, folder: Path) -> list[Contender]:
    """Both tasks, one state and eight at a time, emitted and compiled in `folder`."""
    return _contenders(*built(derive(robot), folder, _GLUE.format(name=robot.name)))


def written(model: Model, package: Path) -> list[Path]:
    """Write a robot's module to a folder: its C sources, for one state and for batches."""
    package.mkdir(parents=True, exist_ok=True)
    for file, text in render_module(model, "", find_targets()).items():
        (package / file).write_text(text, encoding="utf-8")
    return [package / f"{model.robot.name}{ending}.c" for ending in ("", "_batch")]


def built(model: Model, folder: Path, glue: str) -> tuple[ctypes.CDLL, ModuleType]:
    """Emit a robot's module in `folder`: its C, compiled with `glue`, and its Python."""
    package = folder / f"{model.robot.name}_module"
    sources = written(model, package)
    calls, library = package / "glue.c", package / "ours.so"
    calls.write_text(glue, encoding="utf-8")
    subprocess.run(["gcc", *FLAGS, *sources, calls, "-o", library, "-lm"], check=True)
    return ctypes.CDLL(str(library)), load(package)


def generalised(module: ModuleType, states: States) -> States:
    """Inputs whose generalised forces are the given ones."""
    q, v, tau = states
    return q, v, (np.linalg.pinv(module.input_matrix(q)) @ tau[..., None])[..., 0]


def _contenders(library: ctypes.CDLL, module: ModuleType) -> list[Contender]:
    size = len(module.VELOCITIES)

    def matrix_and_residual(_: States, first: Array, second: Array) -> Results:
        return first.reshape(-1, size, size), second

    def accelerations(_: States, first: Array, second: Array) -> Results:
        return (first[:, :size],)

    return [
        Contender(
            name,
            task,
            width,
            function(library, f"{prefix}_{'one' if width == 1 else 'batch'}"),
            partial(generalised, module) if prefix == "forward" else lambda states: states,
            accelerations if prefix == "forward" else matrix_and_residual,
        )
        for task, prefix in (
            (MASS_MATRIX_AND_RESIDUAL, "matrix"),
            (FORWARD_DYNAMICS, "forward"),
        )
        for name, width in ((ONE, 1), (BATCH, LANES))
    ]
