"""Symbolic dynamics of robots with arms, emitted as fast, dependency-free functions.

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
from gibbs_codegen.errors import no_attribute as _no_attribute
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
    from gibbs_codegen.flight.analysis.linear_model import Regulator as Regulator
    from gibbs_codegen.flight.analysis.linear_model import displacement as displacement
    from gibbs_codegen.flight.analysis.linear_model import linearise as linearise
    from gibbs_codegen.flight.analysis.linear_model import lqr as lqr
    from gibbs_codegen.flight.analysis.reachable_wrenches import (
        reachable_wrenches as reachable_wrenches,
    )
    from gibbs_codegen.flight.analysis.trim import Trim as Trim
    from gibbs_codegen.flight.analysis.trim import trim as trim
    from gibbs_codegen.flight.control.observation import Observation as Observation
    from gibbs_codegen.flight.control.predictive import Instant as Instant
    from gibbs_codegen.flight.control.predictive import NoPlanError as NoPlanError
    from gibbs_codegen.flight.control.predictive import Predictive as Predictive
    from gibbs_codegen.flight.control.predictive import Tolerances as Tolerances
    from gibbs_codegen.flight.distributions import log_uniform as log_uniform
    from gibbs_codegen.flight.distributions import normal as normal
    from gibbs_codegen.flight.distributions import scaled as scaled
    from gibbs_codegen.flight.distributions import together as together
    from gibbs_codegen.flight.distributions import uniform as uniform
    from gibbs_codegen.flight.figures.curves import (
        reachable_wrenches_figure as reachable_wrenches_figure,
    )
    from gibbs_codegen.flight.figures.results import write_results as write_results
    from gibbs_codegen.flight.logs.log import read_log as read_log
    from gibbs_codegen.flight.logs.log import write_log as write_log
    from gibbs_codegen.flight.many import simulate_many as simulate_many
    from gibbs_codegen.flight.plant.estimator import Estimate as Estimate
    from gibbs_codegen.flight.plant.estimator import Estimator as Estimator
    from gibbs_codegen.flight.plant.sensors import SensorSuite as SensorSuite
    from gibbs_codegen.flight.record.flight import Flight as Flight
    from gibbs_codegen.flight.record.flight import read_flight as read_flight
    from gibbs_codegen.flight.rollouts.rollout import rollout as rollout
    from gibbs_codegen.flight.scenario.file import read_scenario as read_scenario
    from gibbs_codegen.flight.scenario.scenario import Scenario as Scenario
    from gibbs_codegen.flight.simulation import simulate as simulate
    from gibbs_codegen.flight.stepping import Simulation as Simulation
    from gibbs_codegen.flight.sweeps.study import Study as Study
    from gibbs_codegen.flight.sweeps.study import read_study as read_study
    from gibbs_codegen.flight.sweeps.sweep import sweep as sweep
    from gibbs_codegen.flight.viewer.fly import fly_html as fly_html
    from gibbs_codegen.flight.viewer.view import view as view
    from gibbs_codegen.flight.viewer.view import view_html as view_html
    from gibbs_codegen.identification.design import Design as Design
    from gibbs_codegen.identification.design import design as design
    from gibbs_codegen.identification.identify import Identified as Identified
    from gibbs_codegen.identification.identify import identify as identify
    from gibbs_codegen.identification.recorded import Recording as Recording
    from gibbs_codegen.machine.observers import momentum_observer as momentum_observer
    from gibbs_codegen.pipeline import generate as generate
    from gibbs_codegen.robot.builder import RobotFile as RobotFile
    from gibbs_codegen.robot.family import paper_family as paper_family
    from gibbs_codegen.robot.file import parse_robot as parse_robot
    from gibbs_codegen.robot.file import read_robot as read_robot
    from gibbs_codegen.robot.reach import ReachableWrenches as ReachableWrenches
    from gibbs_codegen.runtime.acados import acados_model as acados_model
    from gibbs_codegen.runtime.load import load as load
    from gibbs_codegen.runtime.program_blocks import compile_program as compile_program
    from gibbs_codegen.runtime.program_blocks import differentiable as differentiable
    from gibbs_codegen.runtime.rollouts import Feedback as Feedback
    from gibbs_codegen.runtime.rollouts import Rollout as Rollout
    from gibbs_codegen.verification.modules import verify as verify
    from gibbs_codegen.verification.verify import Verification as Verification

# The modules that they are imported from.
_MODULES = {
    "derivation.derive": ("derive",),
    "equations.chain_equations": ("ChainEquation",),
    "equations.pages": ("as_latex", "as_markdown", "as_text"),
    "equations.readable_chain": ("chain_closed_form",),
    "equations.show": ("chain_equation",),
    "figures.chains": ("chains_figure",),
    "figures.coupling": ("coupling_figure", "hybrid_pattern_figure"),
    "figures.machine": ("machine_figure",),
    "flight.analysis.linear_model": ("Regulator", "displacement", "linearise", "lqr"),
    "flight.analysis.reachable_wrenches": ("reachable_wrenches",),
    "flight.analysis.trim": ("Trim", "trim"),
    "flight.control.observation": ("Observation",),
    "flight.control.own_program": ("ProgramController",),
    "flight.control.predictive": ("Instant", "NoPlanError", "Predictive", "Tolerances"),
    "flight.figures.curves": ("reachable_wrenches_figure",),
    "flight.figures.results": ("write_results",),
    "flight.logs.log": ("read_log", "write_log"),
    "flight.many": ("simulate_many",),
    "flight.plant.estimator": ("Estimate", "Estimator"),
    "flight.plant.sensors": ("SensorSuite",),
    "flight.record.flight": ("Flight", "read_flight"),
    "flight.rollouts.rollout": ("rollout",),
    "flight.scenario.file": ("read_scenario",),
    "flight.scenario.scenario": ("Scenario",),
    "flight.simulation": ("simulate",),
    "flight.stepping": ("Simulation",),
    "flight.distributions": ("log_uniform", "normal", "scaled", "together", "uniform"),
    "flight.sweeps.study": ("Study", "read_study"),
    "flight.sweeps.sweep": ("sweep",),
    "flight.viewer.fly": ("fly_html",),
    "flight.viewer.view": ("view", "view_html"),
    "machine.observers": ("momentum_observer",),
    "identification.design": ("Design", "design"),
    "identification.identify": ("Identified", "identify"),
    "identification.recorded": ("Recording",),
    "pipeline": ("generate",),
    "robot.builder": ("RobotFile",),
    "robot.family": ("paper_family",),
    "robot.file": ("parse_robot", "read_robot"),
    "robot.reach": ("ReachableWrenches",),
    "runtime.acados": ("acados_model",),
    "runtime.load": ("load",),
    "runtime.program_blocks": ("compile_program", "differentiable"),
    "runtime.rollouts": ("Feedback", "Rollout"),
    "verification.modules": ("verify",),
    "verification.verify": ("Verification",),
}
_LAZY = {name: module for module, names in _MODULES.items() for name in names}

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
    *sorted(_LAZY),
]


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(_no_attribute(__name__, name, __all__))
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
