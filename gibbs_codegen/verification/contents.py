"""Comparison of a module with its robot file: names, defaults of parameters, and its header."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Collection, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import printable
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import Comparison, compared, failed
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import parameter_values, with_values
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

_FILE = "the robot file"
_CONSTANTS_LIMIT = 1e-9


def compare_contents(module: ModuleType, robot: Robot) -> list[Comparison]:
    """Compare names and parameters of a module with the robot that it was made from."""
    description = Description(robot)
    expected: dict[str, Any] = {
        "NAME": robot.name,
        "ATTITUDE": robot.kind,
        **description.lists(getattr(module, "DERIVATIVES", ())),
        **description.constants,
    }
    rows = []
    for name, value in expected.items():
        actual = getattr(module, name, None)
        alike = repr(actual) == repr(value)
        rows.append(
            _verdict(name, _FILE, "" if alike else f"is {_shown(actual)}, not {_shown(value)}")
        )
    parameters, faults = getattr(module, "PARAMETERS", None), []
    if not isinstance(parameters, dict):
        return [*rows, _verdict("PARAMETERS", _FILE, "is not a dict")]
    functions, values = getattr(module, "FUNCTIONS", None), parameter_values(robot)
    for name, value in parameters.items():
        if name not in values:
            faults.append(f"{_shown(name)} is no parameter of this robot")
        elif repr(value) != repr(values[name]):
            faults.append(f"{name} is {_shown(value)}, not {values[name]!r}")
    missing = [name for name, value in values.items() if name not in parameters and value != 0.0]
    if missing and has_effect(robot, missing, functions):  # Few have, so that all go at once.
        lost = [name for name in missing if has_effect(robot, [name], functions)]
        faults += [f"{name} is missing, and not zero" for name in lost]
    return [*rows, _verdict("PARAMETERS", _FILE, "; ".join(faults))]


def compare_robot_file(text: bytes, source: str) -> Comparison:
    """Compare the robot file beside a module with the digest in the header of its NumPy source."""
    digest = hashlib.sha256(text).hexdigest()
    fault = "" if digest in source[:1000] else "is not the robot file of the module"
    return _verdict("robot.toml", "the module's header", fault)


def compare_c_defaults(module: ModuleType, robot: Robot) -> list[Comparison]:
    """Compare a C program's default parameters, and the constants of those, with the robot file.

    `module` is the C back end: its `__file__` is the library, and its constants are bytes.
    """
    library = ctypes.CDLL(str(module.__file__))
    values = parameter_values(robot)
    parameters = np.array([values.get(name, np.nan) for name in module.PARAMETERS])
    expected = {
        "default_parameters": parameters,
        "default_constants": np.frombuffer(module.prepare(module.PARAMETERS)),
    }
    rows = []
    for name, numbers in expected.items():
        symbol = (ctypes.c_double * len(numbers)).in_dll(library, f"{robot.name}_{name}")
        # Rounding may leave fewer digits of differences of parameters than of the rest.
        size = np.maximum(np.abs(numbers), 1e-6 * np.abs(numbers).max())
        row = compared(name, _FILE, np.array(symbol)[None], numbers[None], size, _CONSTANTS_LIMIT)
        rows.append(replace(row, states=0))
    return rows


def _shown(value: object) -> str:
    return printable(repr(value), 80)


def has_effect(
    robot: Robot, names: Sequence[str], functions: Collection[str] | None = None
) -> bool:
    """True if a result depends on parameters; a module may leave out a parameter without effect.

    Where a module has some `functions` only, those of these.
    """
    states = States.random(Tree(robot), 1, 0)
    values = parameter_values(robot)
    # Changed by as many factors, so that no effects cancel out.
    other = {name: (2.0 + k) * values[name] or 1.0 + k for k, name in enumerate(names)}
    there, here = (
        Expected(formulated(NewtonEuler(Tree(model))), states).rows
        for model in (robot, with_values(robot, other))
    )
    seen = [label for label in there if functions is None or label.partition(".")[0] in functions]
    # Values that have become NaN have changed too. Accelerations have the size of their forces.
    rows = [(there[label][0], there[label][1], here[label][0]) for label in seen]
    return not all(
        np.all(np.abs(ours - theirs) <= _CONSTANTS_LIMIT * (np.abs(ours) + np.abs(size)))
        for ours, size, theirs in rows
    )


def _verdict(label: str, against: str, fault: str) -> Comparison:
    """A comparison that passes unless there is a fault in words."""
    return failed(label, against, fault) if fault else Comparison(label, against, 0, 0.0, 0.0)
