"""What comes out not finite where finite numbers went in is said, by every back end in one way."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support.compiled import emit
from support.tools import tool

from gibbs_codegen.interface import Signature, signatures
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.runtime.load import load

Load = Callable[[str], ModuleType]

NAME = "hexarotor_3link"
# Enough of them for two threads.
MANY = 2 * 16_384
LINEAR_IN_V = ("coordinate_rates", "integrate", "frame_velocities", "centroidal_momentum")
NUMPY_WAYS = ("NumPy, one state", "NumPy, batch")
STEPS = ("step_euler", "step_rk4")
C_WAYS = ("C, one state", "C, lists", "C, batch", "C, threads")


@pytest.fixture(scope="module")
def compiled(shipped: Load) -> ModuleType:
    """The C back end as it is for everyone, not that which is compiled for flights."""
    tool("cc")
    return load(Path(shipped(NAME).__file__ or "").parent, backend="c")


@pytest.fixture(scope="module")
def call(shipped: Load, compiled: ModuleType) -> Callable[..., object]:
    """Call a function of the robot in some way, with arguments for one state."""
    threaded = load(Path(shipped(NAME).__file__ or "").parent, backend="c", threads=2)

    def called(way: str, function: str, *state: np.ndarray) -> object:
        module = shipped(NAME) if way in NUMPY_WAYS else compiled
        match way:
            case "NumPy, batch" | "C, batch":
                return getattr(module, function)(*(batch_of(a, 7) for a in state))
            case "C, threads":
                return getattr(threaded, function)(*(batch_of(a, MANY) for a in state))
            case "C, lists":
                return getattr(module, function)(*(a.tolist() for a in state))
            case _:
                return getattr(module, function)(*state)

    return called


def batch_of(values: np.ndarray, count: int) -> np.ndarray:
    """States of ones, of which the third, and the last, is the one given."""
    batch = np.ones((count, *values.shape))
    batch[2], batch[-1] = values, values
    return batch


def arguments(signature: Signature) -> dict[str, np.ndarray]:
    shapes = zip(signature.arguments, signature.argument_shapes, strict=True)
    return {name: np.ones(shape) for name, shape in shapes}


def too_large(signature: Signature) -> tuple[dict[str, np.ndarray], str] | None:
    """Arguments of a function that it overflows with, and what is largest; None where none do."""
    state = arguments(signature)
    if "v" in state and signature.name not in LINEAR_IN_V:
        state["v"][1] = -1e200
        return state, "v of theta_0, -1e+200"
    if signature.name == "potential_energy":
        state["q"][-1] = 1e308
        return state, "q of z, 1e+308"
    return None


FORMS = {s.name: s for s in signatures(Description(read_robot("hexarotor_3link")[0]).lists())}
OVERFLOWING = [name for name, form in FORMS.items() if too_large(form)]


@pytest.mark.parametrize("way", [*NUMPY_WAYS, *C_WAYS])
def test_overflow_names_function_state_and_largest_argument(way: str, call) -> None:
    for name in OVERFLOWING:
        state, largest = too_large(FORMS[name])
        count = {"NumPy, batch": 7, "C, batch": 7, "C, threads": MANY}.get(way)
        where = f" in 2 of {count} states, first [2]," if count else ""
        with pytest.warns(RuntimeWarning) as said:
            call(way, name, *state.values())
        assert [str(w.message) for w in said] == [
            f"{NAME}.{name} is not finite{where} though its arguments are: numbers overflow, or "
            f"nothing resists an acceleration (largest there: {largest})"
        ]
        assert said[0].filename == __file__


def test_states_of_several_axes_are_told_by_all_of_them(shipped: Load) -> None:
    v = np.ones((2, 3, 9))
    v[1, 0, 4] = 1e200
    with pytest.warns(RuntimeWarning, match=r"in 1 of 6 states, first \[1, 0\].*v of theta_8"):
        shipped(NAME).residual(np.ones((3, 9)), v)


@pytest.mark.parametrize(
    "way", ["NumPy, one state", "NumPy, batch", "C, one state", "C, lists", "C, batch"]
)
@pytest.mark.parametrize("given", [np.nan, np.inf, -np.inf])
def test_what_is_given_not_finite_is_no_surprise(way: str, given: float, call) -> None:
    """Warnings are errors here."""
    for name, form in FORMS.items():
        state = arguments(form)
        for argument in state.values():
            argument[:] = given
        results = call(way, name, *state.values())
        results = list(results) if isinstance(results, tuple) else [results]
        for result, shape in zip(results, form.shapes, strict=True):
            # In a batch, the second state was as it should be.
            assert np.shape(result) == shape or np.all(np.isfinite(result[1]))
        if name == "residual":
            assert np.isnan(results[0]).any()


@pytest.mark.parametrize("way", [*NUMPY_WAYS, *C_WAYS])
def test_numpy_s_error_state_says_whether_to_warn_or_to_raise(way: str, call) -> None:
    state, _ = too_large(FORMS["residual"])
    with np.errstate(invalid="ignore"):
        silent = call(way, "residual", *state.values())
    assert not np.all(np.isfinite(silent))
    with (
        np.errstate(invalid="raise"),
        pytest.raises(FloatingPointError, match=f"{NAME}.residual is not finite"),
    ):
        call(way, "residual", *state.values())


@pytest.mark.slow
def test_an_acceleration_that_nothing_resists_is_said(tmp_path: Path) -> None:
    """A link as thin as a thread hangs from a joint on its axis: M is exactly singular there."""
    nothing, thread = (
        Rod(length=0.0, mass_per_length=0.0, section_inertia=(0.0, 0.0, 0.0)),
        Rod(length=1.0, mass_per_length=1.0, section_inertia=(0.0, 0.0, 0.0)),
    )
    turning = Link(
        nothing, alpha_deg=Fraction(0), a=None, d=0.0, theta_deg=Fraction(0), joint="revolute"
    )
    hanging = Link(
        thread, alpha_deg=Fraction(90), a=None, d=0.0, theta_deg=Fraction(90), joint="revolute"
    )
    robot = replace(read_robot("quadrotor_2link")[0], links=(turning, hanging))
    module = load(emit(robot, tmp_path / "robot").folder, backend="numpy")
    for q in (np.zeros(8), np.zeros((1, 8))):
        with pytest.warns(RuntimeWarning, match="nothing resists an acceleration"):
            module.forward_dynamics(q, np.zeros(8), np.ones(6))


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A base with a quaternion, and steps of it."""
    robot, _ = read_robot("quadrotor")
    assert robot.base.attitude == "quaternion"
    return emit(robot, tmp_path_factory.mktemp("turning") / "robot", derivatives=STEPS).folder


@pytest.mark.parametrize("length", [0.0, 1e-170, 1e200])
@pytest.mark.parametrize("backend", ["numpy", "c", "jax", "casadi", "torch"])
def test_a_quaternion_without_a_direction_gives_no_pose(
    backend: str, length: float, turning: Path
) -> None:
    """One that is zero has none, and the square of a length may be too small or too large."""
    if backend == "c":
        tool("cc")
    elif backend != "numpy":
        pytest.importorskip(backend)
    module = load(turning, backend=backend)
    if backend == "jax":  # In single precision.
        length = np.clip(length, length and 1e-30, 1e30)
    q, v, u = np.array([1, 2, 3, 0, length, 0, 0.0]), np.ones(6), np.ones(4)
    states = [q] if backend == "casadi" else [q, np.array([[1, 2, 3, 0, 0, 0, 1], q])]
    for state in states:
        for name, given in (("integrate", (v,)), *((step, (v, u, 0.01)) for step in STEPS)):
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                found = getattr(module, name)(state, *given)
            pose = np.asarray(found[0] if isinstance(found, tuple | list) else found)
            last = pose.reshape(-1, 7)[-1]
            assert not np.isfinite(last).any(), (name, last)
            assert bool(said) == (backend in ("numpy", "c"))
            assert all("not finite" in str(w.message) for w in said)
            assert all("are: a quaternion has no direction (" in str(w.message) for w in said)


def test_flags_of_others_are_not_taken_for_one_s_own(compiled: ModuleType) -> None:
    """What Python or NumPy did before in this thread may have raised the processor's flags."""
    large = float("1e200")
    assert large * large == np.inf
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        np.log(np.zeros(3))
        assert np.all(np.isfinite(compiled.mass_matrix(np.zeros(9))))
    assert large * large == np.inf
    assert np.all(np.isfinite(compiled.mass_matrix(np.zeros((9, 9)))))
