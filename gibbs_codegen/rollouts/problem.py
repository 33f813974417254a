"""What a rollout computes, as plain arrays, and what comes out: the same for every back end."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Method = Literal["euler", "rk4"]
Precision = Literal["double", "single"]
REALS: dict[Precision, np.dtype[Any]] = {
    "double": np.dtype(np.float64),
    "single": np.dtype(np.float32),
}

# Why a state has ended: it has not, its numbers are not finite any more, or it is out of bounds.
RUNNING, DIVERGED, OUT_OF_BOUNDS = 0, 1, 2


@dataclass(frozen=True)
class Feedback:
    """Linear feedback: what is added to the inputs at the start of every step.

    It is `gain` (nu, 2 nv) times the displacement of q and v from the state to the desired one:
    difference(q, q_desired), then v_desired - v. Desired states are (1 or n, 1 or steps, nq) and
    (1 or n, 1 or steps, nv). What it is added to, `u` (1 or n, 1 or steps, nu), is what `rollout`
    makes the inputs of the problem, a number being for all of them; where there is a problem, those
    are looked at alone.
    """

    gain: Array
    q: Array
    v: Array
    u: Array | float = 0.0


@dataclass(frozen=True)
class Motors:
    """What becomes of the inputs that are commanded.

    They are brought within `least` and `most` (nu). Thrusts then follow them with the
    `time_constants` (1 or n, rotors), s, of which 0 is no lag: over a step, in which commands are
    held, they are u + (F - u) exp(-t / T), from `thrusts` (1 or n, rotors), N, at the start.
    Semi-implicit Euler applies the thrust at the start of a step, Runge and Kutta's method those at
    its stages.
    """

    least: Array
    most: Array
    time_constants: Array
    thrusts: Array


@dataclass(frozen=True)
class Problem:
    """A rollout of n states through `steps` steps of `dt` s.

    `constants` are what the module's `prepare` returned: None, those of one robot, or n of them.
    `q` (n, nq) and `v` (n, nv) are where it begins. `inputs` (1 or n, 1 or steps, nu) are held
    through each step, and `wrenches` (1 or n, 1 or steps, frames, 6) too. A state ends after the
    step that takes an entry of q and v beyond `bounds` (2, nq + nv), or makes it not finite; from
    then on it stays as it is, and changes no other. A sample is kept after every `every`-th step.
    The step is the module's step_euler or step_rk4.
    """

    module: ModuleType
    constants: Any
    q: Array
    v: Array
    inputs: Array
    steps: int
    dt: float
    method: Method = "rk4"
    every: int = 1
    feedback: Feedback | None = None
    motors: Motors | None = None
    wrenches: Array | None = None
    bounds: Array | None = None
    precision: Precision = "double"


@dataclass(frozen=True)
class Rollout:
    """States after every `every`-th step, and at the start, which is sample 0.

    `q` (n, samples, nq) and `v` (n, samples, nv) at `time` (samples), s; `thrusts` (n, samples,
    rotors), N, where motors lag, else None. Samples after the end of a state repeat its last one.
    `steps` (n) were taken before a state `ended` (n): RUNNING, DIVERGED or OUT_OF_BOUNDS. The
    state that a step made not finite is not kept: the last sample is the one before. Numbers are
    of the precision of the problem.
    """

    time: Array
    q: Array
    v: Array
    thrusts: Array | None
    steps: NDArray[np.int64]
    ended: NDArray[np.int8]
