"""Time dynamics with a held frame beside Pinocchio's and MuJoCo's, and derivatives, in one run.

`python benchmarks/constraint_times.py` holds the tip of the family's machines, with a quaternion,
against the world, in place and attitude. The project's C computes 256 states, one and eight at a
time; Pinocchio's `constraintDynamics` and `computeConstraintDynamicsDerivatives`, in C++, one state
again and again on its free-flyer, which has the same coordinates. They are called from Python,
which takes as long as it does to call `neutral`, or a little longer, since it is told the arguments
too. Pinocchio's derivatives need its dynamics before them, so both are called, and are by
generalised forces in place of u. Accelerations must agree with dense formulas to 1e-9 before
anything is timed. Of many repeats the least counts.

MuJoCo's `mj_forward` has the exported model with its weld switched on and static bodies fused. Its
equality constraints give way by a share of the bodies' inertia, which is made next to nothing here:
how far its accelerations are from the right ones is printed.

`--links 3 7` limits the machines; `--no-derivatives` leaves those out.
"""

from __future__ import annotations

import argparse
import ctypes
import sys
import tempfile
import timeit
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from rich.console import Console

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
    str(Path(__file__).parents[1] / "tests"),
]

from family import benchmark_robot  # noqa: E402
from our_c import BATCH, ONE, built, generalised  # noqa: E402
from peers.build import function  # noqa: E402
from peers.contender import LANES, Array, Contender, Results, States, packed  # noqa: E402
from peers.peers import TOLERANCE, agreement, random_states  # noqa: E402
from peers.timing import Timer, timer  # noqa: E402
from support.constrained import Dense  # noqa: E402
from support.pinocchio_oracle import Oracle  # noqa: E402

from gibbs_codegen.derivation.derive import derive  # noqa: E402
from gibbs_codegen.exchange.exporting import export_robot  # noqa: E402
from gibbs_codegen.robot.model import Robot  # noqa: E402
from gibbs_codegen.robot.parts.constraint import Constraint  # noqa: E402

DYNAMICS, DERIVATIVES = "constrained dynamics", "constrained dynamics, derivatives"
_NAMES = {DYNAMICS: "constrained_forward_dynamics"}
_NAMES[DERIVATIVES] = f"{_NAMES[DYNAMICS]}_derivatives"
_ROWS = 6
# What is left of the share of the bodies' inertia by which MuJoCo's constraints give way.
_SOFTNESS = 1e-7
STATES, CHECKED, REPEATS = 256, 32, 200

_GLUE = """
#include "{name}.h"

static const double active[8] = {{1, 1, 1, 1, 1, 1, 1, 1}};

#define CALL(glue, f, count, ...) \\
    void glue(const double *q, const double *v, const double *u, double *first, double *second); \\
    __attribute__((visibility("default"))) \\
    void glue(const double *q, const double *v, const double *u, double *first, double *second) \\
    {{ (void)second; {name}_##f(&{name}_default_constants count, q, v, u, active, __VA_ARGS__); }}

#define EIGHT , 8
#define OUTPUTS(w) first, first + {size} * w
CALL(dynamics_one, constrained_forward_dynamics, , OUTPUTS(1))
CALL(dynamics_batch, constrained_forward_dynamics_batch, EIGHT, OUTPUTS(8))
"""
_MORE_GLUE = """
CALL(derivatives_one, constrained_forward_dynamics_derivatives, , {derivatives_one})
CALL(derivatives_batch, constrained_forward_dynamics_derivatives_batch, EIGHT, {derivatives_batch})
"""


def held(links: int) -> Robot:
    """The machine of so many links, with its tip held."""
    robot = benchmark_robot(links, attitude="quaternion")
    return replace(robot, constraints=(Constraint("grip", "frame", "tip"),))


def _places(size: int, inputs: int, width: int) -> str:
    """Where the arrays of the derivatives go, one after the other, as C."""
    sizes = [size, size * size, size * size, size * inputs]
    sizes += [_ROWS, _ROWS * size, _ROWS * size, _ROWS * inputs]
    starts = np.cumsum([0, *sizes[:-1]]) * width
    return ", ".join(f"first + {start}" for start in starts)


def ours(robot: Robot, folder: Path, tasks: Sequence[str]) -> list[Contender]:
    """The project's own C at some tasks, one state and eight at a time."""
    model = derive(robot, functions=("default", *(_NAMES[task] for task in tasks)))
    size, inputs = (len(model.program.inputs[letter]) for letter in "vu")
    glue = (_GLUE + (_MORE_GLUE if DERIVATIVES in tasks else "")).format(
        name=robot.name,
        size=size,
        derivatives_one=_places(size, inputs, 1),
        derivatives_batch=_places(size, inputs, LANES),
    )
    library, module = built(model, folder, glue)
    room = (size + _ROWS) * (1 + 2 * size + inputs)
    return [
        Contender(
            name,
            task,
            width,
            function(library, f"{task.split()[-1]}_{'one' if width == 1 else 'batch'}"),
            partial(generalised, module),
            lambda _, first, second: (first[:, :size],),
            room=room,
        )
        for task in tasks
        for name, width in ((ONE, 1), (BATCH, LANES))
    ]


def pinocchio(robot: Robot, states: States, derivatives: bool) -> dict[str, float]:
    """Nanoseconds that calls of Pinocchio take, by what is called."""
    oracle = Oracle(robot, rigid_base=True)
    model, data, (joint, tip) = oracle.model, oracle.data, oracle.frames["tip"]
    kind, axes = pin.ContactType.CONTACT_6D, pin.ReferenceFrame.LOCAL
    held, own = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    held.append(pin.RigidConstraintModel(kind, model, joint, tip, axes))
    own.append(held[0].createData())
    pin.initConstraintDynamics(model, data, held, own)
    settings = pin.ProximalSettings(1e-12, 0.0, 1)
    q, v, tau = (rows[0] for rows in states)
    state = oracle.configuration(q), oracle.spread(v), oracle.spread(tau)

    def dynamics() -> Array:
        return pin.constraintDynamics(model, data, *state, held, own, settings)

    def both() -> None:
        dynamics()
        pin.computeConstraintDynamicsDerivatives(model, data, held, own, settings)

    # At rest: of a frame that moves, Pinocchio holds the spatial acceleration.
    still = states[0][:1], 0.0 * states[1][:1], states[2][:1]
    (expected,), moving = right(robot, still), state[1]
    state = state[0], 0.0 * moving, state[2]
    error = np.abs(dynamics()[oracle.order] - expected[0]).max()
    assert error < TOLERANCE * np.abs(expected).max()
    state = state[0], moving, state[2]
    called = {"a call by itself": lambda: pin.neutral(model), DYNAMICS: dynamics}
    if derivatives:
        called[DERIVATIVES] = both
    return {
        name: 1e9 * min(timeit.repeat(f, number=200, repeat=60)) / 200 for name, f in called.items()
    }


def in_mujoco(robot: Robot, states: States) -> tuple[float, float]:
    """Nanoseconds that a call of MuJoCo takes, and how far its accelerations are from the right."""
    text = export_robot(robot, "mjcf")[0].replace('active="false"', "")
    model = mujoco.MjModel.from_xml_string(text.replace('fusestatic="false"', 'fusestatic="true"'))
    data = mujoco.MjData(model)
    model.body_invweight0[:] *= _SOFTNESS
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    q, v, tau = (rows[0].copy() for rows in states)
    turn = pin.Quaternion(q[3:7]).toRotationMatrix()  # Linear velocities are in world axes.
    data.qpos[:] = q[[0, 1, 2, 6, 3, 4, 5, *range(7, q.size)]]
    data.qfrc_applied[:] = [*turn @ tau[:3], *tau[3:]]
    mujoco.mj_kinematics(model, data)
    held, anchor = data.site("grip_held"), model.site("grip_anchor")
    anchor.sameframe[:], anchor.pos[:] = 0, held.xpos
    mujoco.mju_mat2Quat(anchor.quat, held.xmat)
    mujoco.mj_forward(model, data)  # At rest, where nothing brings errors back.
    (expected,) = right(robot, tuple(x[:1] * y for x, y in zip(states, (1, 0, 1), strict=True)))
    found = np.concatenate([turn.T @ data.qacc[:3], data.qacc[3:]])
    error = np.abs(found - expected[0]).max() / np.abs(expected[0]).max()
    data.qvel[:] = [*turn @ v[:3], *v[3:]]
    called = timeit.repeat(lambda: mujoco.mj_forward(model, data), number=200, repeat=60)
    return 1e9 * min(called) / 200, error


def right(robot: Robot, states: States) -> Results:
    """Accelerations by dense formulas."""
    found: list[Array] = []
    for q, v, tau in zip(*states, strict=True):
        dense = Dense(robot, q, v)
        oracle = dense.oracle
        places = np.ix_(oracle.free, oracle.free)
        effects = oracle.inverse_dynamics(q, v, np.zeros_like(v))[oracle.free]
        free = np.linalg.solve(oracle.mass_matrix(q)[places], tau - effects)
        found.append(free + dense.solved(dense.jacobian @ free + dense.bias, np.ones(1))[1])
    return (np.array(found),)


def least(contender: Contender, states: States, time_calls: Timer) -> float:
    """Nanoseconds per state of the project's C."""
    blocks = [packed(rows, contender.width) for rows in contender.inputs(states)]
    first, second = contender.memory(states[1].shape[1])
    given = [number for block in blocks for number in (block.ctypes.data, block[0].size)]
    pointer, around = ctypes.cast(contender.function, ctypes.c_void_p), len(blocks[0])
    rooms = first.ctypes.data, second.ctypes.data
    found = min(time_calls(pointer, 4 * around, around, *given, *rooms) for _ in range(REPEATS))
    return found / contender.width


def main() -> None:
    """Build, check, time, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, nargs="+", default=[3, 7])
    parser.add_argument("--no-derivatives", action="store_true")
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 180, highlight=False)
    tasks = (DYNAMICS,) if options.no_derivatives else (DYNAMICS, DERIVATIVES)
    for links in options.links:
        robot = held(links)
        states = random_states(robot, STATES)
        with tempfile.TemporaryDirectory() as temporary:
            time_calls = timer(Path(temporary))
            found = ours(robot, Path(temporary), tasks)
            few = tuple(rows[:CHECKED] for rows in states)
            worst = max(agreement(one, robot, few, right(robot, few)) for one in found)
            console.print(f"n = {links}: agree to {worst:.0e}")
            for one in found:
                console.print(f"  {one.task}, {one.name}: {least(one, states, time_calls):.1f} ns")
        for name, time in pinocchio(robot, states, len(tasks) > 1).items():
            console.print(f"  Pinocchio, {name}: {time:.0f} ns")
        time, error = in_mujoco(robot, states)
        console.print(f"  MuJoCo, {DYNAMICS}: {time:.0f} ns, agrees to {error:.0e}")


if __name__ == "__main__":
    main()
