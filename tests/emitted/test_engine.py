"""The C of flights: silent under the project's warnings, and clean under instruments."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from support.compiled import SANITIZERS, build, compile_only
from support.tools import run

from gibbs_codegen.arrays.contents import externals_of, owners_of
from gibbs_codegen.flight.integration.closed_loop import loop_program
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.machine.closed_loop import LoopStructure
from gibbs_codegen.runtime.program_flow import flow_source
from gibbs_codegen.runtime.program_steps import steps_source

# What a program has no use for.
UNUSED = ["-Wno-unused-macros", "-Wno-unused-function"]
# All that is written by hand, and all that acts.
CHANGES: dict[str, Any] = {
    "motors": {"limits": [-100, 600], "time_constant": 0.02},
    "control": {"integral": 0.5},
    "wind": {"velocity": [4, 1, 0], "drag": {"base": 0.5, "tip": 0.3}},
    "payload": [{"frame": "tip", "mass": 0.2}],
    "wall": [{"frame": "tip", "point": [0, 0, 2], "normal": [0, 0, 1], "stiffness": 300}],
}
_DRIVER = """\
#include "{source}"

#include <stdlib.h>

static unsigned long long seed = 88172645463325252u;

static real value(void)
{{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return seed % 5000 ? (real)(seed % 2000) * R(1e-3) - R(0.9) : seed % 2 ? (real)NAN : R(1e30);
}}

static void *filled(const size_t count)
{{
    real *const array = aligned_alloc(64, (count * sizeof(real) + 63) / 64 * 64);
    for (size_t i = 0; i < count; ++i) {{
        array[i] = value();
    }}
    return array;
}}

int main(void)
{{
    static const size_t sizes[] = {{{sizes}}}, wide[] = {{{wide}}};
    const void *given[sizeof sizes / sizeof *sizes];
    long taken = 0;
    for (int round = 0; round < 400; ++round) {{
        for (size_t k = 0; k < sizeof sizes / sizeof *sizes; ++k) {{
            given[k] = filled(sizes[k]);
        }}
        for (size_t k = 0; k < sizeof wide / sizeof *wide; ++k) {{
            for (size_t i = 0; i < sizes[wide[k]]; ++i) {{
                ((real *)(uintptr_t)given[wide[k]])[i] = R(1e9);
            }}
        }}
        real table[3 + 4 * 6 * COORDINATES] = {{R(0.0), R(0.1), R(4.0)}};
        for (size_t i = 3; i < sizeof table / sizeof *table; ++i) {{
            table[i] = value();
        }}
        real *const guesses = filled(ROTORS * LANES);
        memset(guesses, 0, ROTORS * LANES * sizeof *guesses);
        const void *const context[] = {{table, table, round % 2 ? guesses : NULL}};
        given[{context}] = context;
        {name}_constants constants[2];
        for (int owner = 0; owner < {owners}; ++owner) {{
            {name}_init_constants({name}_default_parameters, &constants[owner]);
            given[owner] = &constants[owner];
        }}
        const int count = round % 30, every = 1 + round % 7, before = round % 50;
        number *const x = filled(STATE * LANES);
        number *const samples = filled((size_t)(count / every + 1) * STATE * LANES);
        real *const ranges = filled((size_t)(count / every + 2) * 2 * RANGED);
        Progress progress = {{{{1}}, {{0}}, {{0}}}};
        program_run(
            given, 0.0, 1e-3, count, every, before, x, samples, round % 3 ? ranges : NULL,
            &progress);
        taken += progress.taken[0];
    }}
    return taken > 1000 ? 0 : 5;
}}
"""


def loop_of(fast: Callable[[str], ModuleType]) -> tuple[LoopStructure, Path]:
    """A closed loop, and the folder of the module."""
    module = fast("hexarotor_3link")
    loop = flight_start(
        module, read_scenario("paper", CHANGES), lambda *_: None, custom_law=False
    ).loop
    return loop_program(loop, Loads(False, True)), Path(module.__path__[0])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fixed", "adaptive"])
def test_the_source_compiles_silently(
    method: str, fast: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    """And neither allocates, nor has data that can be written."""
    loop, folder = loop_of(fast)
    if method == "fixed":
        text = steps_source(loop.step(), loop.plant, 8)
    else:
        text = flow_source({"slope": loop.slope(), "end": loop.end()}, loop.plant)
    source = tmp_path / "step.c"
    source.write_text(text, encoding="utf-8")
    options = ["-O1", "-fno-math-errno", *UNUSED, f"-I{folder}"]
    (compiled,) = compile_only("gcc", options, [str(source)], tmp_path)
    symbols = [line.split() for line in run(["nm", compiled]).splitlines()]
    called = {words[-1] for words in symbols if words[-2] == "U"}
    of_module = {name for name in called if name.startswith(loop.plant.name)}
    assert called - of_module <= {
        *("atan2", "cos", "sin", "sincos", "sqrt", "floor", "memcpy", "memmove", "memset"),
        *("pow", "nextafter", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"),
    }
    assert not [words for words in symbols if words[-2] in "bBdDC"]


@pytest.mark.slow
def test_sanitizers_find_nothing_in_random_flights(
    fast: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    loop, folder = loop_of(fast)
    plant, step = loop.plant, loop.step()
    assert externals_of(step) >= {"desired"}
    (tmp_path / "step.c").write_text(steps_source(step, plant), encoding="utf-8")
    owners = len(owners_of(step))
    sizes = [*[1] * (owners + 1), *(x.size for x in step.inputs[3:])]
    # Bounds that few states reach.
    wide = [owners + 1 + k for k, x in enumerate(step.names[3:]) if x in ("bounds", "largest_lean")]
    driver = tmp_path / "driver.c"
    driver.write_text(
        _DRIVER.format(
            source="step.c",
            sizes=", ".join(map(str, sizes)),
            wide=", ".join(map(str, wide)),
            context=owners,
            owners=owners,
            name=plant.name,
        ),
        encoding="utf-8",
    )
    program = tmp_path / "driver"
    # The module's own source is tried in `targets/test_c_source.py`.
    module = compile_only("gcc", ["-O1"], [str(folder / f"{plant.name}.c")], tmp_path)
    options = ["-std=c11", "-O1", "-fno-math-errno", *UNUSED, *SANITIZERS, f"-I{folder}"]
    build("gcc", [*map(str, module), *options], [str(driver)], program)
    run([program], ASAN_OPTIONS="detect_leaks=0")
