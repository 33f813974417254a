"""Symbolic dynamics of aerial manipulators, emitted as fast, dependency-free functions.

`gibbs_codegen.pipeline` is the map of the package. What takes time to import is imported
when it is first used.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from gibbs_codegen.errors import GibbsCodegenError as GibbsCodegenError
from gibbs_codegen.errors import MissingFunctionError as MissingFunctionError
from gibbs_codegen.errors import OutputError as OutputError
from gibbs_codegen.errors import RefusedFileError as RefusedFileError
from gibbs_codegen.errors import RobotFileError as RobotFileError
from gibbs_codegen.errors import ScenarioFileError as ScenarioFileError
from gibbs_codegen.errors import SingularRobotError as SingularRobotError
from gibbs_codegen.errors import UsageError as UsageError
from gibbs_codegen.errors import WrongModuleError as WrongModuleError
from gibbs_codegen.version import __version__ as __version__

# Functions of a robot share much of what they are derived from. When SymPy is imported it reads how
# many results to remember: with a thousand, its default, `derive` takes half as long again.
os.environ.setdefault("SYMPY_CACHE_SIZE", "100000")

if TYPE_CHECKING:
    from gibbs_codegen.derivation.derive import derive as derive
    from gibbs_codegen.equations.chain_equations import ChainEquation as ChainEquation
    from gibbs_codegen.equations.pages import as_latex as as_latex
    from gibbs_codegen.equations.pages import as_markdown as as_markdown
    from gibbs_codegen.equations.pages import as_text as as_text
    from gibbs_codegen.equations.readable_chain import chain_closed_form as chain_closed_form
    from gibbs_codegen.equations.show import chain_equation as chain_equation
    from gibbs_codegen.figures.chains import chains_figure as chains_figure
    from gibbs_codegen.figures.coupling import coupling_figure as coupling_figure
    from gibbs_codegen.figures.coupling import hybrid_pattern_figure as hybrid_pattern_figure
    from gibbs_codegen.figures.machine import machine_figure as machine_figure
    from gibbs_codegen.flight.analysis.linear_model import linearise as linearise
    from gibbs_codegen.flight.analysis.reachable_wrenches import (
        ReachableWrenches as ReachableWrenches,
    )
    from gibbs_codegen.flight.analysis.reachable_wrenches import (
        reachable_wrenches as reachable_wrenches,
    )
    from gibbs_codegen.flight.analysis.regulator import Regulator as Regulator
    from gibbs_codegen.flight.analysis.regulator import lqr as lqr
    from gibbs_codegen.flight.analysis.trim import Trim as Trim
    from gibbs_codegen.flight.analysis.trim import trim as trim
    from gibbs_codegen.flight.control.sampled import Observation as Observation
    from gibbs_codegen.flight.figures.curves import (
        reachable_wrenches_figure as reachable_wrenches_figure,
    )
    from gibbs_codegen.flight.figures.flight import write_results as write_results
    from gibbs_codegen.flight.many import simulate_many as simulate_many
    from gibbs_codegen.flight.record.flight import Flight as Flight
    from gibbs_codegen.flight.record.flight import read_flight as read_flight
    from gibbs_codegen.flight.rollouts.rollout import rollout as rollout
    from gibbs_codegen.flight.scenario.file import read_scenario as read_scenario
    from gibbs_codegen.flight.scenario.scenario import Scenario as Scenario
    from gibbs_codegen.flight.simulation import simulate as simulate
    from gibbs_codegen.flight.stepping import Simulation as Simulation
    from gibbs_codegen.flight.sweeps.sampling import log_uniform as log_uniform
    from gibbs_codegen.flight.sweeps.sampling import normal as normal
    from gibbs_codegen.flight.sweeps.sampling import scaled as scaled
    from gibbs_codegen.flight.sweeps.sampling import together as together
    from gibbs_codegen.flight.sweeps.sampling import uniform as uniform
    from gibbs_codegen.flight.sweeps.study import Study as Study
    from gibbs_codegen.flight.sweeps.study import read_study as read_study
    from gibbs_codegen.flight.sweeps.sweep import sweep as sweep
    from gibbs_codegen.flight.viewer.view import view as view
    from gibbs_codegen.flight.viewer.view import view_html as view_html
    from gibbs_codegen.pipeline import generate as generate
    from gibbs_codegen.robot.family import paper_family as paper_family
    from gibbs_codegen.robot.file import parse_robot as parse_robot
    from gibbs_codegen.robot.file import read_robot as read_robot
    from gibbs_codegen.runtime.load import load as load
    from gibbs_codegen.runtime.rollouts import Feedback as Feedback
    from gibbs_codegen.runtime.rollouts import Rollout as Rollout
    from gibbs_codegen.verification.modules import verify as verify
    from gibbs_codegen.verification.verify import Verification as Verification

_LAZY = {
    "ChainEquation": "equations.chain_equations",
    "Feedback": "runtime.rollouts",
    "Flight": "flight.record.flight",
    "Observation": "flight.control.sampled",
    "ReachableWrenches": "flight.analysis.reachable_wrenches",
    "Regulator": "flight.analysis.regulator",
    "Rollout": "runtime.rollouts",
    "Scenario": "flight.scenario.scenario",
    "Simulation": "flight.stepping",
    "Study": "flight.sweeps.study",
    "Trim": "flight.analysis.trim",
    "Verification": "verification.verify",
    "as_latex": "equations.pages",
    "as_markdown": "equations.pages",
    "as_text": "equations.pages",
    "chain_closed_form": "equations.readable_chain",
    "chain_equation": "equations.show",
    "chains_figure": "figures.chains",
    "coupling_figure": "figures.coupling",
    "derive": "derivation.derive",
    "generate": "pipeline",
    "hybrid_pattern_figure": "figures.coupling",
    "linearise": "flight.analysis.linear_model",
    "load": "runtime.load",
    "log_uniform": "flight.sweeps.sampling",
    "lqr": "flight.analysis.regulator",
    "machine_figure": "figures.machine",
    "normal": "flight.sweeps.sampling",
    "paper_family": "robot.family",
    "parse_robot": "robot.file",
    "reachable_wrenches": "flight.analysis.reachable_wrenches",
    "reachable_wrenches_figure": "flight.figures.curves",
    "read_flight": "flight.record.flight",
    "read_robot": "robot.file",
    "read_scenario": "flight.scenario.file",
    "read_study": "flight.sweeps.study",
    "rollout": "flight.rollouts.rollout",
    "scaled": "flight.sweeps.sampling",
    "simulate": "flight.simulation",
    "simulate_many": "flight.many",
    "sweep": "flight.sweeps.sweep",
    "together": "flight.sweeps.sampling",
    "trim": "flight.analysis.trim",
    "uniform": "flight.sweeps.sampling",
    "verify": "verification.modules",
    "view": "flight.viewer.view",
    "view_html": "flight.viewer.view",
    "write_results": "flight.figures.flight",
}

__all__ = [
    "GibbsCodegenError",
    "MissingFunctionError",
    "OutputError",
    "RefusedFileError",
    "RobotFileError",
    "ScenarioFileError",
    "SingularRobotError",
    "UsageError",
    "WrongModuleError",
    "__version__",
    *_LAZY,
]


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
