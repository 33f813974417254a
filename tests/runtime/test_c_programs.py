"""Array programs in C, and laws and closed loops as programs, against flights in Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gibbs_codegen.arrays import Functions, evaluate
from gibbs_codegen.flight.integration.closed_loop import loop_program, loop_values
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.machine.steps import METHODS, step_program
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.programs import CompiledProgram

GENERATED = Path(__file__).parents[2] / "generated"


@pytest.mark.parametrize("method", METHODS)
def test_a_step_in_c_is_that_of_numpy(method: str) -> None:
    compiled, plain = (load(GENERATED / "hexarotor_3link", name) for name in ("c", "numpy"))
    program = step_program(Functions(compiled), method)
    random = np.random.default_rng(3)
    given = [*(random.normal(size=x.shape) for x in program.inputs[:3]), 1e-3]
    found = CompiledProgram(compiled, program)(*given)
    wanted = evaluate(program, dict(zip(program.names, given, strict=True)), {"robot": plain})
    for name, values in wanted.items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-12 * np.max(abs(values)))


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["paper"])
def test_rates_of_a_closed_loop_are_those_of_the_flight(scenario: str) -> None:
    module = load(GENERATED / "hexarotor_3link", "numpy")
    start = flight_start(module, read_scenario(scenario), lambda *_: None, own=False)
    loop = start.loop
    random = np.random.default_rng(4)
    state = loop.start(start.q, start.v)
    state = state + 0.03 * random.normal(size=state.shape)
    loads, time = loop.loads(0.3), 0.3
    spec = loop_program(loop, loads)
    owners = {"plant": module, "model": module}

    def desired(at: float) -> np.ndarray:
        return np.concatenate(Reference.__call__(loop.controller.reference, at))

    by_hand = {"desired": desired, "nearest_thrusts": lambda thrusts, *_: thrusts}
    curves = evaluate(spec.curves, {"time": time}, owners, externals=by_hand)["curves"]
    given = {"time": time, "curves": curves, "x": state, **loop_values(loop, 1.0, loads)}
    found = evaluate(spec.rate_program, given, owners, externals=by_hand)["rate"]
    wanted = loop.derivative(time, state, loads)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.max(abs(wanted)))
