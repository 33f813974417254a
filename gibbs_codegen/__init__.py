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
    from gibbs_codegen.analysis.linear_model import linearise as linearise
    from gibbs_codegen.analysis.reach import ReachableWrenches as ReachableWrenches
    from gibbs_codegen.analysis.reach import reachable_wrenches as reachable_wrenches
    from gibbs_codegen.analysis.regulator import Regulator as Regulator
    from gibbs_codegen.analysis.regulator import lqr as lqr
    from gibbs_codegen.analysis.trim import Trim as Trim
    from gibbs_codegen.analysis.trim import trim as trim
    from gibbs_codegen.derivation.derive import derive as derive
    from gibbs_codegen.equations.chain_equation import ChainEquation as ChainEquation
    from gibbs_codegen.equations.closed_form import chain_closed_form as chain_closed_form
    from gibbs_codegen.equations.layout import as_latex as as_latex
    from gibbs_codegen.equations.layout import as_markdown as as_markdown
    from gibbs_codegen.equations.layout import as_text as as_text
    from gibbs_codegen.equations.show import chain_equation as chain_equation
    from gibbs_codegen.figures.chains import chains_figure as chains_figure
    from gibbs_codegen.figures.coupling import coupling_figure as coupling_figure
    from gibbs_codegen.figures.coupling import hybrid_pattern_figure as hybrid_pattern_figure
    from gibbs_codegen.figures.machine import machine_figure as machine_figure
    from gibbs_codegen.figures.reach import reachable_wrenches_figure as reachable_wrenches_figure
    from gibbs_codegen.figures.results import write_results as write_results
    from gibbs_codegen.pipeline import generate as generate
    from gibbs_codegen.robot.family import paper_family as paper_family
    from gibbs_codegen.robot.file import parse_robot as parse_robot
    from gibbs_codegen.robot.file import read_robot as read_robot
    from gibbs_codegen.rollouts.problem import Feedback as Feedback
    from gibbs_codegen.rollouts.problem import Rollout as Rollout
    from gibbs_codegen.rollouts.rollout import rollout as rollout
    from gibbs_codegen.runtime.load import load as load
    from gibbs_codegen.scenario.file import read_scenario as read_scenario
    from gibbs_codegen.scenario.scenario import Scenario as Scenario
    from gibbs_codegen.simulator.control.sensing import Observation as Observation
    from gibbs_codegen.simulator.many import simulate_many as simulate_many
    from gibbs_codegen.simulator.record.flight import Flight as Flight
    from gibbs_codegen.simulator.record.flight import read_flight as read_flight
    from gibbs_codegen.simulator.simulation import simulate as simulate
    from gibbs_codegen.simulator.stepping import Simulation as Simulation
    from gibbs_codegen.sweeps.sampling import log_uniform as log_uniform
    from gibbs_codegen.sweeps.sampling import normal as normal
    from gibbs_codegen.sweeps.sampling import scaled as scaled
    from gibbs_codegen.sweeps.sampling import together as together
    from gibbs_codegen.sweeps.sampling import uniform as uniform
    from gibbs_codegen.sweeps.study import Study as Study
    from gibbs_codegen.sweeps.study import read_study as read_study
    from gibbs_codegen.sweeps.sweep import sweep as sweep
    from gibbs_codegen.verification.modules import verify as verify
    from gibbs_codegen.verification.verify import Verification as Verification
    from gibbs_codegen.viewer.view import view as view
    from gibbs_codegen.viewer.view import view_html as view_html

_LAZY = {
    "ChainEquation": "equations.chain_equation",
    "Feedback": "rollouts.problem",
    "Flight": "simulator.record.flight",
    "Observation": "simulator.control.sensing",
    "ReachableWrenches": "analysis.reach",
    "Regulator": "analysis.regulator",
    "Rollout": "rollouts.problem",
    "Scenario": "scenario.scenario",
    "Simulation": "simulator.stepping",
    "Study": "sweeps.study",
    "Trim": "analysis.trim",
    "Verification": "verification.verify",
    "as_latex": "equations.layout",
    "as_markdown": "equations.layout",
    "as_text": "equations.layout",
    "chain_closed_form": "equations.closed_form",
    "chain_equation": "equations.show",
    "chains_figure": "figures.chains",
    "coupling_figure": "figures.coupling",
    "derive": "derivation.derive",
    "generate": "pipeline",
    "hybrid_pattern_figure": "figures.coupling",
    "linearise": "analysis.linear_model",
    "load": "runtime.load",
    "log_uniform": "sweeps.sampling",
    "lqr": "analysis.regulator",
    "machine_figure": "figures.machine",
    "normal": "sweeps.sampling",
    "paper_family": "robot.family",
    "parse_robot": "robot.file",
    "reachable_wrenches": "analysis.reach",
    "reachable_wrenches_figure": "figures.reach",
    "read_flight": "simulator.record.flight",
    "read_robot": "robot.file",
    "read_scenario": "scenario.file",
    "read_study": "sweeps.study",
    "rollout": "rollouts.rollout",
    "scaled": "sweeps.sampling",
    "simulate": "simulator.simulation",
    "simulate_many": "simulator.many",
    "sweep": "sweeps.sweep",
    "together": "sweeps.sampling",
    "trim": "analysis.trim",
    "uniform": "sweeps.sampling",
    "verify": "verification.modules",
    "view": "viewer.view",
    "view_html": "viewer.view",
    "write_results": "figures.results",
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
