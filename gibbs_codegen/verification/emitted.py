"""Verification of a module that is still text, in a moment, before it is written."""

from __future__ import annotations

import importlib.abc
from types import ModuleType

from gibbs_codegen.errors import WrongModuleError
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import failed, failure_text
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import QUICK, Progress, compare_module

# All functions at a few states reveal a wrong one.
_FEW_STATES = 3


def refuse_wrong(robot: Robot, numpy_source: str, progress: Progress = lambda _: None) -> None:
    """Verify emitted NumPy functions quickly, before they are written.

    Raises `WrongModuleError` if a comparison fails.
    """
    progress("verifying")
    try:
        module = module_of(numpy_source)
        comparisons = compare_module(
            module, robot, [formulated(NewtonEuler(Tree(robot)))], _FEW_STATES, 0, extent=QUICK
        )
    except (Exception, SystemExit) as error:  # Whatever was emitted.
        comparisons = [failed("the module", "", error)]
    failures = [failure_text(c) for c in comparisons if not c.passed]
    if failures:
        raise WrongModuleError(robot.name, failures, len(comparisons))


class _Text(importlib.abc.InspectLoader):
    """A loader of a module whose source is at hand."""

    def __init__(self, source: str) -> None:
        self._source = source

    def get_source(self, fullname: str) -> str:
        """The source, whatever the name."""
        return self._source


def module_of(source: str) -> ModuleType:
    """The module of emitted NumPy source."""
    module = ModuleType("emitted")
    _Text(source).exec_module(module)
    return module
