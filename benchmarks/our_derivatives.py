"""The project's own derivatives in C as contenders, and the time that gcc takes for them."""

from __future__ import annotations

import os
import subprocess
from functools import partial
from pathlib import Path

from our_c import BATCH, ONE, built, generalised, written
from peers.build import FLAGS, function
from peers.contender import LANES, Array, Contender, Results, States
from peers.derivatives import FORWARD, INVERSE, DerivativeContender, by_oracle

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.robot.model import Robot

NAMES = {INVERSE: "inverse_dynamics_derivatives", FORWARD: "forward_dynamics_derivatives"}

_GLUE = """
#include "{name}.h"

#define CALL(glue, f, count, lanes) \\
    void glue(const double *q, const double *v, const double *u, double *first, double *second); \\
    __attribute__((visibility("default"))) \\
    void glue(const double *q, const double *v, const double *u, double *first, double *second) \\
    {{ \\
        double *second_array = first + {size} * lanes; \\
        double *third_array = second_array + {size} * {size} * lanes; \\
        (void)second; \\
        {name}_##f(&{name}_default_constants count, q, v, u, first, second_array, third_array, \\
                   third_array + {size} * {size} * lanes); \\
    }}

#define EIGHT , 8
CALL(inverse_one, inverse_dynamics_derivatives, , 1)
CALL(inverse_batch, inverse_dynamics_derivatives_batch, EIGHT, 8)
CALL(forward_one, forward_dynamics_derivatives, , 1)
CALL(forward_batch, forward_dynamics_derivatives_batch, EIGHT, 8)
"""


def our_derivatives(robot: Robot, folder: Path) -> list[Contender]:
    """Both tasks, one state and eight at a time."""
    model = derive(robot, derivatives=tuple(NAMES.values()))
    size, inputs = (len(model.program.inputs[letter]) for letter in "vu")
    library, module = built(model, folder, _GLUE.format(name=robot.name, size=size))
    columns = {INVERSE: size, FORWARD: inputs}

    def outputs(task: str, _: States, first: Array, second: Array) -> Results:
        ends = size + size**2, size + 2 * size**2
        matrices = first[:, size : ends[0]], first[:, ends[0] : ends[1]]
        last = first[:, ends[1] :].reshape(-1, size, columns[task])
        return first[:, :size], *(rows.reshape(-1, size, size) for rows in matrices), last

    def given(task: str, states: States) -> States:
        return states if task == INVERSE else generalised(module, states)

    return [
        DerivativeContender(
            name,
            task,
            width,
            function(library, f"{task.split()[0]}_{'one' if width == 1 else 'batch'}"),
            partial(given, task),
            partial(outputs, task),
            room=size + 2 * size**2 + size * columns[task],
            right=lambda states, task=task: by_oracle(
                robot, task, given(task, states), inputs=True
            ),
        )
        for task in NAMES
        for name, width in ((ONE, 1), (BATCH, LANES))
    ]


def compile_seconds(robot: Robot, folder: Path) -> float:
    """Processor time of gcc -O3 for both functions, all forms: with them, less without."""
    taken = []
    for chosen in ((), tuple(NAMES.values())):
        package = folder / f"{robot.name}_compiled_{len(chosen)}"
        sources = written(derive(robot, derivatives=chosen), package)
        before = os.times()
        subprocess.run(["gcc", *FLAGS, "-c", *sources], cwd=package, check=True)
        now = os.times()
        taken.append(
            now.children_user + now.children_system - before.children_user - before.children_system
        )
    return taken[1] - taken[0]
