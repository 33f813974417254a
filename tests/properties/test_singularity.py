"""Near θ₀ = ±90°, where the attitude sequence is singular, every function stays accurate.

No floating-point number is an odd multiple of 90°: the cosine of the double nearest to 90° is
6e-17, and that of no double is less than 4.6e-19 in size. So every state has exact results. Those
of θ̈₋₁ and θ̈₁ grow as 1/cos θ₀, all others do not grow, and none may lose digits: the equations are
solved for the angular acceleration of the base, which knows nothing of angles, and that is divided
by cos θ₀ once. A solution for the angles themselves would lose as many digits as 1/cos² θ₀ has.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import mpmath
import numpy as np
import pytest
from support.compiled import Array, Emitted, Library, emit
from support.high_precision import DIGITS, accelerations, evaluated, prepared
from support.random_robots import SEQUENCES, random_robot

from gibbs_codegen.interface import Signature
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load

RIGHT = math.pi / 2
# The double, of all that there are, that comes nearest to an odd multiple of 90°, in proportion.
NEAREST = 6381956970095103 * 2.0**797
NEAR = (RIGHT - 1e-5, RIGHT, -RIGHT, 3 * RIGHT)
NEARER = (
    *(sign * (RIGHT - 10.0**-k) for sign in (1, -1) for k in range(1, 17, 5)),
    *(math.nextafter(RIGHT, 2), math.nextafter(-RIGHT, 0)),
    *(odd * RIGHT for odd in (-3, 101, -63661, 63663)),
    *(1e22, -1e300, NEAREST, -NEAREST),
)
# How much of a result rounding may take at the most, in roundings of the largest of its kind. The
# mass matrices of these robots have condition numbers up to 1e5 when the base turns freely; one in
# angles would lose 1e32 roundings at 90°.
ROUNDINGS = 1e6

Outputs = list[Array]
State = dict[str, Array]
Call = Callable[[Signature, list[Array]], list[Array]]


@pytest.fixture(scope="module", autouse=True)
def _digits() -> Iterator[None]:
    with mpmath.workdps(DIGITS):
        yield


def robot_of(attitude: str, rotors: int = 2, links: int = 1) -> Robot:
    """A random robot, with `rotors` and more and up to `links`; each origin has three attitudes."""
    place = SEQUENCES.index(attitude)
    robot = random_robot(40 + place, rotors + place % 3, place % (links + 1))
    origin = ("motor1", "centre")[place % 2]
    return replace(robot, base=replace(robot.base, attitude=attitude, origin=origin))


def states(emitted: Emitted, angles: Sequence[float], real: type[np.floating]) -> State:
    """A random state for each θ₀, of numbers that `real` can represent."""
    rng = np.random.default_rng(3)
    n, inputs = len(emitted.module.COORDINATES), len(emitted.module.INPUTS)
    q = rng.uniform(-3, 3, (len(angles), n))
    q[:, 1] = angles
    v, a = rng.uniform(-3, 3, (2, len(angles), n))
    u = rng.uniform(-20, 20, (len(angles), inputs))
    wrenches = rng.uniform(-20, 20, (len(angles), len(emitted.module.FRAMES), 6))
    named = {"q": q, "v": v, "a": a, "u": u, "W": wrenches, "q0": q, "q1": q[::-1]}
    named |= {"v_r": v[::-1], "a_r": a[::-1]}
    return {name: values.astype(real).astype(np.float64) for name, values in named.items()}


def kinds(signature: Signature, entries: int) -> list[list[int]]:
    """Places of an output whose entries are of one size: those of accelerations by what moves."""
    if not signature.name.startswith("forward_dynamics"):
        return [list(range(entries))]
    parts = [[0, 2], [1], list(range(3, entries - 3)), list(range(entries - 3, entries))]
    return [part for part in parts if part]


def check(emitted: Emitted, at: State, calls: Mapping[str, Call], real: type[np.floating]) -> None:
    """Each entry of each function is as near to the exact one as its roundings can leave it."""
    program = emitted.model.program
    rounding = float(np.finfo(real).eps) / 2
    constants = prepared(program, emitted.model.defaults, rounded=real is np.float32)
    found = {
        (name, s.name): call(s, [at[argument] for argument in s.arguments])
        for name, call in calls.items()
        for s in emitted.signatures()
    }
    for i, signature in np.ndindex(len(at["q"]), len(emitted.signatures())):
        signature = emitted.signatures()[signature]
        state = {name: rows[i].ravel() for name, rows in at.items()}
        function = program.function(signature.name)
        for k, bounded in enumerate(evaluated(program, function, constants, state)):
            right = [entry.value for entry in bounded]
            if signature.name.startswith("forward_dynamics"):
                right = accelerations(program, constants, state, "W" in signature.arguments)
            lost = [entry.error for entry in bounded]
            for places in kinds(signature, len(right)):
                size = max(abs(right[j]) for j in places)
                where = f"{signature.name} at theta_0 = {state['q'][1]!r}"
                assert max(lost[j] for j in places) <= ROUNDINGS * size, where
                for name in calls:
                    ours = np.ravel(found[name, signature.name][k][i])
                    for j in places:
                        error = abs(mpmath.mpf(float(ours[j])) - right[j])
                        assert error <= rounding * lost[j], f"{where}, {name}, entry {j}"


def module_calls(name: str, module: ModuleType) -> dict[str, Call]:
    """The functions of a back end, state by state and all states at once."""

    def batch(signature: Signature, rows: list[Array]) -> Outputs:
        values = getattr(module, signature.name)(*rows)
        return list(values) if isinstance(values, tuple) else [values]

    def one(signature: Signature, rows: list[Array]) -> Outputs:
        each = [batch(signature, [array[i] for array in rows]) for i in range(len(rows[0]))]
        return [np.array(outputs) for outputs in zip(*each, strict=True)]

    return {f"{name}, one state": one, f"{name}, batch": batch}


@pytest.mark.slow
def test_numpy_is_accurate_next_to_the_singularity(tmp_path: Path) -> None:
    emitted = emit(robot_of("xyz"), tmp_path / "robot")
    calls = module_calls("NumPy", emitted.module)
    check(emitted, states(emitted, NEAR, np.float64), calls, np.float64)


@pytest.mark.slow
def test_single_precision_is_accurate_next_to_the_singularity(tmp_path: Path) -> None:
    check_single(emit(robot_of("xyz"), tmp_path / "robot"), NEAR)


def check_single(emitted: Emitted, angles: Sequence[float]) -> None:
    """The C functions in single precision, whose angles are to be of few turns."""
    path = emitted.folder / "single.so"
    single = Library(emitted, path, "gcc", ["-O0", emitted.single], np.float32)
    unused = np.array(np.nan, np.float32)
    calls = {
        "single precision, one state": single.one,
        "single precision, batch": lambda s, rows: single.batch(s, rows, unused),
    }
    few = [angle for angle in angles if abs(angle) < 20.0]
    check(emitted, states(emitted, few, np.float32), calls, np.float32)


@pytest.mark.slow
def test_constraint_torques_of_accelerations_lose_as_many_digits_as_the_cosine_has(
    tmp_path: Path,
) -> None:
    """As documented: rounding of θ̈₋₁ and θ̈₁, each of which is large, remains in their sum."""
    emitted = emit(robot_of("xyz", rotors=4), tmp_path / "robot")
    module, program = emitted.module, emitted.model.program
    constants = prepared(program, emitted.model.defaults)
    function = program.function("constraint_torques")
    at = states(emitted, (0.5, RIGHT - 1e-3, -RIGHT + 1e-7), np.float64)
    for i in range(3):
        state = {name: rows[i] for name, rows in at.items()}
        a = module.forward_dynamics(state["q"], state["v"], state["u"])
        ours = module.constraint_torques(state["q"], state["v"], a, state["u"])
        exactly = state | {"a": accelerations(program, constants, state)}
        right = [entry.value for entry in evaluated(program, function, constants, exactly)[0]]
        lost = ROUNDINGS * float(np.finfo(float).eps) / abs(math.cos(state["q"][1]))
        error = max(abs(x - y) for x, y in zip(ours.tolist(), right, strict=True))
        assert error <= lost * max(map(abs, right))


@pytest.mark.slow
def test_all_back_ends_are_accurate_ever_nearer_to_the_singularity(tmp_path: Path) -> None:
    """And at many turns: at the double that comes nearest of all to an odd multiple of 90°."""
    attitude = "xyz"
    emitted = emit(robot_of(attitude, 3 + SEQUENCES.index(attitude), 3), tmp_path / "robot")
    compiled = load(emitted.folder, backend="c")
    calls = module_calls("NumPy", emitted.module) | module_calls("C", compiled)
    check(emitted, states(emitted, NEARER, np.float64), calls, np.float64)
