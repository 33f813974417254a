"""The emitted sine and cosine against the truth, in units in the last place of the true value.

Truth is long double arithmetic for dense sweeps (held to mpmath at selected angles) and double
arithmetic for single precision.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from support.alone import alone

Array = NDArray[np.floating]

# The two ends of what compilers make of an expression, and of a loop.
OPTIONS = {
    "plain": ["-O0"],
    "fused": ["-O3", "-march=native", "-ffp-contract=fast"],
    "unfused": ["-O3", "-march=native", "-ffp-contract=off"],
}
MOST_ULP = 2.0
LIMIT = {np.float64: 1e5, np.float32: 400.0}
# The worst of a search among 96 million doubles, and of every float up to the limit.
WORST = {
    np.float64: [30432.609988449418, 66212.202860799967, 68273.09545407079, 96768.899899696],
    np.float32: [295.247192, 350.538666, 163.488068, 295.372223],
}
# As many angles as a block of states has where a state has five of them.
MANY = 40
# Angles in a call of each form.
GROUPS = {"few": 4, "many": MANY}


class SineCosine:
    """The emitted sine and cosine in a shared library."""

    def __init__(self, path: Path, real: type[np.floating]) -> None:
        self.real = real
        self._library = ctypes.CDLL(str(path))

    def __call__(self, form: str, angles: Array, group: int | None = None) -> tuple[Array, Array]:
        """Sines and cosines, computed in groups; what lies behind them must be left as it is."""
        count = len(angles)
        sine, cosine = (np.full(count + MANY, 7.0, self.real) for _ in range(2))
        self._library[form](
            ctypes.c_size_t(count),
            ctypes.c_size_t(group or GROUPS[form]),
            *(ctypes.c_void_p(array.ctypes.data) for array in (angles, sine, cosine)),
        )
        assert (sine[count:] == 7.0).all()
        assert (cosine[count:] == 7.0).all()
        return sine[:count], cosine[:count]


@dataclass(frozen=True)
class Truth:
    """Angles with their true sines and cosines, each the sum of a double and a smaller one."""

    angles: Array
    sine: tuple[Array, Array]
    cosine: tuple[Array, Array]

    def worst_ulp(self, computed: tuple[Array, Array]) -> float:
        """The largest error in units in the last place of the true value."""
        true = (self.sine[0], self.cosine[0])
        errors = zip(self.errors(computed), map(self.ulp, true), strict=True)
        return float(np.max([error / ulp for error, ulp in errors]))

    def worst_error(self, computed: tuple[Array, Array]) -> float:
        """The largest absolute error."""
        return float(np.max(self.errors(computed)))

    def errors(self, computed: tuple[Array, Array]) -> list[Array]:
        """Absolute errors of sines and of cosines."""
        return [
            np.abs((ours.astype(np.float64) - high) - low)
            for ours, (high, low) in zip(computed, (self.sine, self.cosine), strict=True)
        ]

    def ulp(self, values: Array) -> Array:
        """A unit in the last place of each value, as a number of the angles' precision."""
        return np.spacing(np.abs(values).astype(self.angles.dtype)).astype(np.float64)


def long_double_truth(angles: Array) -> Truth:
    exact = angles.astype(np.longdouble)
    sine, cosine = (
        (values.astype(np.float64), (values - values.astype(np.float64)).astype(np.float64))
        for values in (np.sin(exact), np.cos(exact))
    )
    return Truth(angles, sine, cosine)


def mpmath_truth(angles: Array) -> Truth:
    """True to 60 digits, also where the sine or cosine is next to zero."""
    pairs = []
    with mpmath.workdps(60):
        for function in (mpmath.sin, mpmath.cos):
            values = [function(mpmath.mpf(float(angle))) for angle in angles]
            high = [float(value) for value in values]
            low = [float(value - h) for value, h in zip(values, high, strict=True)]
            pairs.append((np.array(high), np.array(low)))
    return Truth(angles, *pairs)


def double_truth(angles: Array) -> Truth:
    """Of floats: what a double lacks is nothing to them."""
    exact = angles.astype(np.float64)
    none = np.zeros_like(exact)
    return Truth(angles, (np.sin(exact), none), (np.cos(exact), none))


def next_to(values: Array, real: type[np.floating]) -> Array:
    """The numbers nearest to the values, two more on each side, signs in turn."""
    middle = values.astype(real)
    below, above = (np.nextafter(middle, real(end)) for end in (-np.inf, np.inf))
    farther = [np.nextafter(below, real(-np.inf)), np.nextafter(above, real(np.inf))]
    found = np.stack([middle, below, above, *farther], axis=1)
    found[1::2] *= -1
    return found.reshape(-1)


def quarter_turns(limit: float) -> tuple[Array, Array]:
    """Multiples of π/2 up to a limit, where results are small, and the middles between them, where
    the nearest multiple changes.
    """
    quarter = np.longdouble(np.pi) / 2 + np.longdouble(1.2246467991473532e-16) / 2
    multiples = np.arange(int(limit / (np.pi / 2)) + 1) * quarter
    middles = multiples + quarter / 2
    return multiples, middles[middles < limit]


@functools.cache
def sweep(real: type[np.floating]) -> Truth:
    """Over a million angles up to the limit, all that are hard among them."""
    limit = real(LIMIT[real])
    multiples, middles = (next_to(values, real) for values in quarter_turns(float(limit)))
    hard = np.concatenate([multiples, middles, up_to(limit), -up_to(limit)])
    if real is np.float32:
        # Each 641st float.
        sample = np.arange(0, limit.view(np.uint32), 641, dtype=np.uint32).view(np.float32)
        sample[1::2] *= -1
        return double_truth(np.concatenate([sample, hard]))
    rng = np.random.default_rng(1)
    tiny = 10.0 ** rng.uniform(-323.5, -1, 50_000) * rng.choice([-1.0, 1.0], 50_000)
    uniform = [rng.uniform(-limit, limit, 400_000), rng.uniform(-10, 10, 200_000)]
    return long_double_truth(np.concatenate([*uniform, tiny, hard]))


@functools.cache
def selected(real: type[np.floating]) -> Truth:
    """Angles where a reduction or a series is at its worst, few enough for mpmath."""
    limit = real(LIMIT[real])
    multiples, middles = (next_to(values, real) for values in quarter_turns(float(limit)))
    smallest = np.minimum(np.abs(np.sin(multiples)), np.abs(np.cos(multiples)))
    rng = np.random.default_rng(2)
    uniform = rng.uniform(-limit, limit, 200).astype(real)
    tiny = np.geomspace(np.finfo(real).smallest_subnormal, 1e-2, 60).astype(real)
    hardest = multiples[np.argsort(smallest)[:200]]
    return mpmath_truth(
        np.concatenate([hardest, rng.choice(middles, 200), uniform, tiny, up_to(limit)[:5]])
    )


@functools.cache
def below_powers_of_two(real: type[np.floating]) -> Truth:
    """Angles whose sine or cosine is just less than 1/2, 1/4 … 1/4096: its last place is worth only
    half as much as that of the angle's rest, whose rounding therefore counts twice.
    """
    rng = np.random.default_rng(3)
    count = 200_000
    results = 2.0 ** -rng.integers(1, 13, count) * (1 - 0.01 * rng.random(count))
    turns = rng.integers(0, int(LIMIT[real] / (np.pi / 2)), count)
    angles = turns * (np.longdouble(np.pi) / 2) + np.arcsin(results) * rng.choice([-1, 1], count)
    truth = double_truth if real is np.float32 else long_double_truth
    return truth(np.concatenate([angles.astype(real), np.array(WORST[real], real)]))


def up_to(limit: np.floating) -> Array:
    """The thousand largest angles that are not beyond."""
    return limit - np.arange(1000).astype(limit.dtype) * (limit - np.nextafter(limit, limit * 0))


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., SineCosine]:
    """Compile the sine and cosine."""
    folder = tmp_path_factory.mktemp("sine_cosine")
    places = (folder / str(number) for number in itertools.count())

    def library(compiler: str, options: list[str], real: type[np.floating]) -> SineCosine:
        return SineCosine(alone(compiler, options, real, next(places)), real)

    return library


@pytest.fixture(
    scope="module",
    params=[
        *itertools.product(("gcc",), OPTIONS, LIMIT),
        *(
            pytest.param(w, marks=pytest.mark.slow)
            for w in itertools.product(("clang",), OPTIONS, LIMIT)
        ),
    ],
    ids=lambda way: f"{way[0]}-{way[1]}-{way[2].__name__}",
)
def sine_cosine(request: pytest.FixtureRequest, build: Callable[..., SineCosine]) -> SineCosine:
    """The sine and cosine, compiled in one of many ways."""
    compiler, options, real = request.param
    return build(compiler, OPTIONS[options], real)


def needs_long_double(real: type[np.floating]) -> None:
    if real is np.float64 and np.finfo(np.longdouble).nmant < 63:
        pytest.skip("long double is no longer than double here")


def libm(angles: Array) -> tuple[Array, Array]:
    """What the C library gives for each angle."""
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    number, suffix = (ctypes.c_float, "f") if angles.dtype == np.float32 else (ctypes.c_double, "")
    results = []
    for name in ("sin", "cos"):
        function = library[name + suffix]
        function.argtypes, function.restype = [number], number
        results.append(np.array([function(float(angle)) for angle in angles], angles.dtype))
    return results[0], results[1]


def test_what_sweeps_take_for_true_is_so() -> None:
    """To a fiftieth of a unit in the last place, where mpmath is asked."""
    for real, truth in ((np.float64, long_double_truth), (np.float32, double_truth)):
        needs_long_double(real)
        true = selected(real)
        ours = truth(true.angles)
        for (high, low), (true_high, true_low) in (
            (ours.sine, true.sine),
            (ours.cosine, true.cosine),
        ):
            error = np.abs((high - true_high) + (low - true_low)) / true.ulp(true_high)
            assert error.max() < 0.02


def test_a_million_angles(sine_cosine: SineCosine) -> None:
    needs_long_double(sine_cosine.real)
    truth = sweep(sine_cosine.real)
    assert len(truth.angles) > 1_000_000
    assert np.abs(truth.angles).max() == LIMIT[sine_cosine.real]
    worst = truth.worst_ulp(sine_cosine("few", truth.angles))
    assert worst <= MOST_ULP, f"{worst} ulp"


@pytest.mark.parametrize("form", GROUPS)
def test_results_below_powers_of_two(form: str, sine_cosine: SineCosine) -> None:
    needs_long_double(sine_cosine.real)
    truth = below_powers_of_two(sine_cosine.real)
    worst = truth.worst_ulp(sine_cosine(form, truth.angles))
    assert worst <= MOST_ULP, f"{worst} ulp"


@pytest.mark.parametrize("form", GROUPS)
def test_selected_angles(form: str, sine_cosine: SineCosine) -> None:
    truth = selected(sine_cosine.real)
    worst = truth.worst_ulp(sine_cosine(form, truth.angles))
    assert worst <= MOST_ULP, f"{worst} ulp"


@pytest.mark.parametrize("form", GROUPS)
def test_a_zero_keeps_its_sign(form: str, sine_cosine: SineCosine) -> None:
    angles = np.array([0.0, -0.0], sine_cosine.real)
    sine, cosine = sine_cosine(form, angles)
    assert np.signbit(sine).tolist() == [False, True]
    assert (sine == 0.0).all()
    assert (cosine == 1.0).all()


@pytest.mark.parametrize("form", GROUPS)
def test_denormals_are_their_own_sines(form: str, sine_cosine: SineCosine) -> None:
    limits = np.finfo(sine_cosine.real)
    smallest, normal = limits.smallest_subnormal, limits.smallest_normal
    angles = np.array([smallest, normal / 3, normal, -smallest, -normal], sine_cosine.real)
    sine, cosine = sine_cosine(form, angles)
    assert sine.tobytes() == angles.tobytes()
    assert (cosine == 1.0).all()


@pytest.mark.parametrize("form", GROUPS)
def test_beyond_the_limit_the_library_answers(form: str, sine_cosine: SineCosine) -> None:
    """To the last bit, and for no other angle of the group."""
    real = sine_cosine.real
    limit = real(LIMIT[real])
    first = np.nextafter(limit, real(np.inf))
    largest = np.finfo(real).max
    beyond = np.array([first, -first, 2 * limit, -1e6, 1e15, 1e22, -1e38, largest], real)
    for ours, theirs in zip(sine_cosine(form, beyond), libm(beyond), strict=True):
        assert ours.tobytes() == theirs.tobytes()
    near = np.array([0.5, 2.0, 1.0, 3.0], real)
    mixed = np.where(near == 1.0, -first, near).astype(real)
    for ours, beside in zip(sine_cosine(form, near), sine_cosine(form, mixed), strict=True):
        assert ours[near != 1.0].tobytes() == beside[near != 1.0].tobytes()


@pytest.mark.parametrize("form", GROUPS)
def test_infinities_and_nan_give_nan(form: str, sine_cosine: SineCosine) -> None:
    """And the other angles of the group what they give without."""
    angles = np.array([math.inf, 1.0, -math.inf, math.nan, -math.nan, 2.0], sine_cosine.real)
    wild = ~np.isfinite(angles)
    tame = np.where(wild, 0.0, angles).astype(sine_cosine.real)
    beside, alone = (sine_cosine(form, some, group=3) for some in (angles, tame))
    for ours, theirs in zip(beside, alone, strict=True):
        assert np.isnan(ours[wild]).all()
        assert ours[~wild].tobytes() == theirs[~wild].tobytes()


@pytest.mark.parametrize(("form", "group"), [("few", g) for g in (1, 2, 3)] + [("many", 5)])
def test_groups_that_are_not_full(form: str, group: int, sine_cosine: SineCosine) -> None:
    """Each angle counts, and nothing else does: what follows the last group is beyond the limit."""
    truth = selected(sine_cosine.real)
    count = 20 * group + group // 2
    angles = np.concatenate([truth.angles[:count], np.full(MANY, 1e6)]).astype(sine_cosine.real)
    sine, cosine = sine_cosine(form, angles[:count], group)
    whole = sine_cosine(form, truth.angles)
    tolerance = 4 * np.finfo(sine_cosine.real).eps
    np.testing.assert_allclose(sine, whole[0][:count], rtol=tolerance)
    np.testing.assert_allclose(cosine, whole[1][:count], rtol=tolerance)


@pytest.mark.parametrize("freedom", ["-ffast-math", "-funsafe-math-optimizations"])
@pytest.mark.parametrize("compiler", ["gcc", pytest.param("clang", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("real", "most"), [(np.float64, 1e-15), (np.float32, 5e-7)])
def test_a_compiler_that_takes_freedoms_is_not_wrong(
    real: type[np.floating],
    most: float,
    compiler: str,
    freedom: str,
    build: Callable[..., SineCosine],
) -> None:
    """Arithmetic in another order would be wrong everywhere; the library's sine is not."""
    needs_long_double(real)
    truth = sweep(real)
    sine_cosine = build(compiler, ["-O1", freedom], real)
    for form in GROUPS:
        worst = truth.worst_error(sine_cosine(form, truth.angles))
        assert worst <= most, f"{form}: {worst}"
