"""The observer of generalised momentum: of an arm of seven joints that is pushed at its tip."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from support.compiled import build, compile_only
from support.embedded_laws import M4F, M7, Processor
from support.embedded_laws import observed as observed_by

from gibbs_codegen import load, momentum_observer, parse_robot
from gibbs_codegen.arrays import evaluate
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.errors import MissingFunctionError
from gibbs_codegen.machine.observers import CALLED
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import read_robot

Array = np.ndarray
# Height of each joint above the one before, m, its axis, and the mass of its link, kg.
LINKS = (
    (0.33, "z", 3.0), (0.0, "y", 3.0), (0.32, "z", 2.5), (0.0, "y", 2.5),
    (0.38, "z", 2.0), (0.0, "y", 1.5), (0.1, "z", 0.7),
)  # fmt: skip
WRENCH = np.array([3.0, -0.0, 4.0, 0.3, 0.4, 0.0])  # 5 N and 0.5 N m.
GAIN, STEP = 20.0, 1e-3
# Of encoders, rad, and of what rates are made of them, rad/s.
ANGLES, RATES = 2e-5, 1e-3


def arm_text() -> str:
    """The robot file of an arm on a table."""
    lines = ['name = "arm_7"', "[base]", 'motion = "fixed"', "mass = 1.0"]
    lines += ["inertia = [1, 1, 1, 0, 0, 0]"]
    for k, (height, axis, mass) in enumerate(LINKS, start=1):
        lines += ["[[link]]", f'name = "link_{k}"', f"xyz = [0, 0, {height}]", f'axis = "{axis}"']
        lines += [f"mass = {mass}", "com = [0.02, 0.01, 0.12]", "damping = 0.1"]
        lines += [f"inertia = [{mass / 100}, {mass / 100}, {mass / 200}, 0, 0, 0]"]
    return "\n".join([*lines, "[[frame]]", 'name = "tip"', 'on = "link_7"', "xyz = [0.08, 0, 0.1]"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A module with the observer in C."""
    text, out = arm_text(), tmp_path_factory.mktemp("arm")
    return generate_robot(parse_robot(text), text, out, laws=["momentum_observer"], verify=False)[1]


def wanted(t: float) -> Array:
    """Angles that the arm is led to, rad."""
    return np.array([0.3, 0.6, -0.2, -1.4, 0.4, 1.2, 0.1]) + 0.3 * np.sin(t + np.arange(7))


def moved(
    module: ModuleType, grown: Callable[[float], float], end: float
) -> tuple[Array, Array, Array, Array]:
    """Times, angles, rates and torques, held from sample to sample, under a share of the wrench."""
    q, v, found = wanted(0.0), 0.3 * np.cos(np.arange(7.0)), []
    pushes, tip = np.zeros((len(module.FRAMES), 6)), module.FRAMES.index("tip")
    for time in STEP * np.arange(round(end / STEP)):
        u = module.inverse_dynamics(q, v, 400 * (wanted(time) - q) - 40 * v)

        def rate(t: float, x: Array, u: Array = u) -> Array:
            pushes[tip] = grown(t) * WRENCH
            a = module.forward_dynamics_with_wrenches(x[:7], x[7:], u, pushes)
            return np.concatenate([x[7:], a])

        found.append((time, q, v, u))
        x = np.concatenate([q, v])
        k1 = rate(time, x)
        k2 = rate(time + STEP / 2, x + STEP / 2 * k1)
        k3 = rate(time + STEP / 2, x + STEP / 2 * k2)
        k4 = rate(time + STEP, x + STEP * k3)
        x = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        q, v = x[:7], x[7:]
    return tuple(map(np.array, zip(*found, strict=True)))


def observed(module: ModuleType, motion: tuple[Array, ...], noise: float, seeds: int) -> Array:
    """Wrenches (samples, seeds, 6) that are found from readings with noise."""
    programs = momentum_observer(module)
    begin, step, explain = (
        Evaluator(programs[name], {"robot": module})
        for name in ("init_momentum_observer", "momentum_observer_step", "wrench_of_residual")
    )
    rng, tip, found, memory = np.random.default_rng(0), module.FRAMES.index("tip"), [], {}
    late: dict[str, Array] = {}
    share = np.full(7, 1.0 - np.exp(-GAIN * STEP))
    # The momentum's noise is that of rates, as heavy as the joint.
    weight = 1.0 / np.diag(module.mass_matrix(wanted(0.5))) ** 2
    damping = 1e-6 * np.ones(6)
    for k, (_, q, v, _) in enumerate(zip(*motion, strict=True)):
        q = q + noise * ANGLES * rng.standard_normal((seeds, 7))
        v = v + noise * RATES * rng.standard_normal((seeds, 7))
        if not memory:
            results = begin({"q": q, "v": v}, {}, {})
        else:
            known = {"u": motion[3][k - 1], "share": share, "h": STEP}
            results = step({"q": q, "v": v, **known, **memory}, {}, {})
        memory = {name.removesuffix("_next"): x for name, x in results.items()}
        jacobian = module.frame_jacobians(q)[:, tip]
        given = {"jacobian": jacobian, "residual": memory["residual"] + 0.0 * v, "share": share}
        given |= {"late_jacobian": late.get("late_jacobian_next", jacobian)}
        late = explain({**given, "weight": weight, "damping": damping}, {}, {})
        found.append(late["wrench"])
    return np.array(found)


def off(found: Array, right: Array) -> tuple[float, float]:
    """How far the mean is off, as shares of 5 N and of 0.5 N m."""
    error = found.reshape(-1, 6).mean(axis=0) - right
    return float(np.linalg.norm(error[:3]) / 5.0), float(np.linalg.norm(error[3:]) / 0.5)


@pytest.mark.slow
def test_a_push_on_the_tip_is_found_under_noise(folder: Path) -> None:
    """A step as a filter of first order lets it through, and a rise of 0.3 s after three lags."""
    module, begin, seeds = load(folder, "c"), 0.3, 20
    found = observed(module, moved(module, lambda t: float(t >= begin), 0.6), 1.0, seeds)
    for lags in (1, 3, 4):
        share = 1.0 - np.exp(-lags)
        there = found[round((begin + lags / GAIN) / STEP)]
        assert max(off(there, share * WRENCH)) < 0.02

    def risen(t: float) -> float:
        s = np.clip((t - 0.1) / 0.3, 0.0, 1.0)
        return float(s * s * (3.0 - 2.0 * s))

    found = observed(module, moved(module, risen, 1.0), 1.0, seeds)
    late = found[round((0.4 + 3 / GAIN) / STEP) :]
    assert max(off(late[0], WRENCH)) < 0.02
    assert max(off(late, WRENCH)) < 0.002
    # Of single readings the root of the mean square.
    scatter = np.sqrt(np.mean(np.sum((late - WRENCH)[..., :3] ** 2, axis=-1)))
    assert scatter < 0.2


class InC:
    """The functions of the observer; structures have reals alone, one after the other."""

    def __init__(self, folder: Path, build_folder: Path) -> None:
        sources = [str(folder / f"arm_7{ending}.c") for ending in ("", "_laws")]
        options = ["-O0", "-shared", "-fPIC", "-Wno-unused-function"]
        self._library = ctypes.CDLL(str(build("gcc", options, sources, build_folder / "arm.so")))
        symbol = ctypes.c_char.in_dll(self._library, "arm_7_default_constants")
        self.constants = ctypes.c_void_p(ctypes.addressof(symbol))

    def call(self, name: str, *arguments: Array | float | ctypes.c_void_p) -> None:
        """Call a function; arrays are changed in their places."""
        given = (
            ctypes.c_double(x)
            if isinstance(x, float)
            else ctypes.c_void_p(x.ctypes.data)
            if isinstance(x, np.ndarray)
            else x
            for x in arguments
        )
        getattr(self._library, f"arm_7_{name}")(*given)


def test_c_has_the_numbers_of_numpy_and_keeps_its_memory(folder: Path, tmp_path: Path) -> None:
    module, code, rng = load(folder), InC(folder, tmp_path), np.random.default_rng(3)
    programs, memory, in_c = momentum_observer(module), {}, np.full(21, np.nan)
    share, weight, damping = rng.uniform(0.1, 0.9, 7), rng.uniform(1, 2, 7), rng.uniform(1, 2, 6)
    jacobian, of_frame, wrench = rng.normal(size=(6, 7)), rng.normal(size=42), np.zeros(6)
    late = of_frame.copy()
    for k in range(3):
        q, v, u = rng.normal(size=(3, 7))
        if k == 0:
            given, name = {"q": q, "v": v}, "init_momentum_observer"
            code.call(name, code.constants, in_c, q, v)
        else:
            given = {"q": q, "v": v, "u": u, "share": share, "h": 0.01, **memory}
            name = "momentum_observer_step"
            code.call(name, code.constants, in_c, q, v, u, share, 0.01)
        results = evaluate(programs[name], given, {"robot": module})
        memory = {name.removesuffix("_next"): x for name, x in results.items()}
        np.testing.assert_allclose(in_c, np.concatenate([*memory.values()]), rtol=0, atol=1e-11)
    residual = memory["residual"]
    given = {"jacobian": jacobian, "late_jacobian": late.reshape(6, 7), "residual": residual}
    given |= {"share": share, "weight": weight, "damping": damping}
    found = evaluate(programs["wrench_of_residual"], given, {"robot": module})
    code.call(*("wrench_of_residual", of_frame, jacobian, residual, share, weight, damping, wrench))
    np.testing.assert_allclose(wrench, found["wrench"], rtol=1e-10)
    np.testing.assert_allclose(of_frame.reshape(6, 7), found["late_jacobian_next"], rtol=1e-14)
    # Damped least squares, as NumPy solves it.
    mixed = late.reshape(6, 7) + share * (jacobian - late.reshape(6, 7))
    rows = np.vstack([np.sqrt(weight)[:, None] * mixed.T, np.diag(np.sqrt(damping))])
    right = np.concatenate([np.sqrt(weight) * residual, np.zeros(6)])
    np.testing.assert_allclose(wrench, np.linalg.lstsq(rows, right)[0], rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("processor", [M7, M4F], ids=lambda processor: processor.name)
def test_the_observer_runs_on_microcontrollers(folder: Path, processor: Processor) -> None:
    """A residual comes to rest at what is missing, and its wrench explains it as NumPy's does."""
    module, rng = load(folder), np.random.default_rng(4)
    q, v, u = rng.uniform(-1.0, 1.0, (3, 7))
    given = {"q": q, "v": 0.0 * v, "u": u, "share": np.full(7, 0.5), "weight": np.ones(7)}
    given["damping"] = np.full(6, 0.1)
    (residual, wrench), counts = observed_by("arm_7", folder, processor, len(module.FRAMES), given)
    known = module.momentum_rate(q, 0.0 * v) + module.input_matrix(q) @ u
    jacobian = module.frame_jacobians(q)[-1]
    explained = np.linalg.solve(jacobian @ jacobian.T + 0.1 * np.eye(6), jacobian @ -known)
    tolerance = 1e-4 if processor is M4F else 1e-11
    np.testing.assert_allclose(residual, -known, rtol=0, atol=tolerance * np.abs(known).max())
    np.testing.assert_allclose(wrench, explained, rtol=0, atol=tolerance * np.abs(known).max())
    assert 100 < min(counts) < max(counts) < 50_000


def test_observers_compile_silently_as_cpp_too(folder: Path, tmp_path: Path) -> None:
    source = folder / "arm_7_laws.c"
    assert max(map(len, source.read_text(encoding="utf-8").partition("SPDX")[2].split("\n"))) <= 100
    compile_only("g++", ["-O1", "-DARM_7_FLOAT"], [str(source)], tmp_path)


def test_what_is_touched_is_the_last_that_joints_feel() -> None:
    """On each of two arms by itself, on the base if no joint feels it; noise touches nothing."""
    description = Description(read_robot("dual_arm")[0])
    made = SimpleNamespace(
        **description.lists(()) | {"PARAMETERS": (), "FUNCTIONS": (*CALLED, "input_matrix")},
        NAME="dual_arm",
        ATTITUDE=description.layout.attitude,
        COORDINATE_UNITS=description.layout.q.units,
        CARRIERS=description.constants["CARRIERS"],
    )
    program = momentum_observer(made)["touched_by_residual"]
    bodies = ("base", *made.BODIES)
    threshold = np.full(12, 0.1)
    for pushed, expected in (
        ([], []),
        ([0], ["base"]),
        ([0, 6], ["left_shoulder"]),
        ([1, 6, 8, 9], ["left_forearm", "right_shoulder"]),
        ([10], ["right_upper_arm"]),
    ):
        residual = 0.05 * np.ones(12)
        residual[pushed] = -0.3
        given = {"residual": residual, "threshold": threshold}
        touched = evaluate(program, given, {})["touched"]
        assert [name for name, here in zip(bodies, touched, strict=True) if here] == expected


def test_modules_without_momentum_tell_which_functions_bring_it() -> None:
    with pytest.raises(MissingFunctionError, match="functions=default,momentum"):
        momentum_observer(load(ROOT / "generated" / "hexarotor_3link"))
