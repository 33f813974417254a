"""Many flights of one robot: side by side where that is possible, and else one by one."""

from __future__ import annotations

import os
from collections.abc import Sequence
from types import ModuleType

from gibbs_codegen.errors import GibbsCodegenError
from gibbs_codegen.runtime.load import load
from gibbs_codegen.scenario.scenario import Scenario
from gibbs_codegen.simulator.desired.trajectory import Progress
from gibbs_codegen.simulator.record.flight import Flight
from gibbs_codegen.simulator.simulation import simulate


def simulate_many(
    robot: ModuleType | str | os.PathLike[str],
    scenarios: Sequence[Scenario],
    threads: int = 1,
    progress: Progress = lambda what, share: None,
) -> list[Flight | GibbsCodegenError]:
    """Fly many scenarios with one robot.

    Args:
        robot: As of `simulate`.
        scenarios: What is flown.
        threads: How many threads share the flights that are integrated side by side.
        progress: Is told what is being done, and the share of it that is done, 0 to 1.

    Returns:
        For each scenario its flight, or the error with which `simulate` refuses it.
    """
    module = robot if isinstance(robot, ModuleType) else load(robot, "c")
    found: list[Flight | GibbsCodegenError] = []
    for number, scenario in enumerate(scenarios):
        try:
            found.append(simulate(module, scenario))
        except GibbsCodegenError as error:
            found.append(error)
        progress("flying", (number + 1) / len(scenarios))
    return found
