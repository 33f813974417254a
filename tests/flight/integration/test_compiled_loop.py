"""The compiled loop: the same steps as in Python, samples, early ends, and C under instruments."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import compiled_soon
from numpy.typing import NDArray
from support.compiled import build, compile_only
from support.random_robots import random_robot
from support.tools import missing, run

from gibbs_codegen.flight.control.laws import Controller, Gains
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import NATIVE, CompiledLoop
from gibbs_codegen.flight.integration.integrators import rk4_step
from gibbs_codegen.flight.integration.state_history import NOTHING, Loads
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.orientation import LARGEST_THETA_0
from gibbs_codegen.flight.scenario.parts import Law, Push
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.text import robot_text

pytestmark = pytest.mark.usefixtures("derived_once")

Array = NDArray[np.float64]
Load = Callable[[str], ModuleType]

LAWS: tuple[Law, ...] = ("computed_torque", "open_loop", "off")
# A power of two, so that times are exact and calls can be told apart by nothing but mistakes; and
# long, so that slopes at the wrong times would show.
STEP = 2.0**-8
# Seven rotors that pull in all directions, a slide between two hinges, drag, attitude y-x-z, and
# position at motor 1.
RANDOM = "random"
# Along no axis, so that every row of the Jacobian counts.
PUSH = Push((0.7, -0.4, 0.5), 0.0, 1.0, (0.2, 0.3, -0.1))


@pytest.fixture(scope="module")
def modules(fast: Load, tmp_path_factory: pytest.TempPathFactory) -> Load:
    """Load the C back end of a robot that ships, or of RANDOM."""
    robot = random_robot(2, 7, 3)
    folder = tmp_path_factory.mktemp("random")

    def module(name: str) -> ModuleType:
        if name != RANDOM:
            found = fast(name)
        else:
            if not (folder / robot.name).is_dir():
                generate_robot(robot, robot_text(robot), folder)
            found = compiled_soon(folder / robot.name)
        if (found.__file__ or "").endswith(".py"):
            missing("nothing compiles")
        return found

    return module


def smooth(count: int) -> Reference:
    """A motion of `count` coordinates that keeps away from the singularity."""
    time = np.linspace(0.0, 0.5, 8)
    rates = 1.0 + 0.3 * np.arange(count)
    phases = rates * time[:, np.newaxis] + np.arange(count)
    return Reference(
        Motion(time, np.sin(phases), rates * np.cos(phases), -(rates**2) * np.sin(phases))
    )


def closed_loop_of(module: ModuleType, law: Law = "computed_torque") -> ClosedLoop:
    vehicle = Vehicle(module)
    count = len(vehicle.coordinates)
    gains = Gains.of(np.linspace(4.0, 9.0, count), np.linspace(0.5, 1.1, count), count)
    allocation = Allocation(vehicle.thrust_wrenches())
    controller = Controller(vehicle, smooth(count), allocation, gains, law)
    return ClosedLoop(vehicle, controller, Actuators.unlimited(vehicle))


def restricted(
    closed: ClosedLoop, limits: tuple[float, float] | None = None, lag: float = 0.0
) -> ClosedLoop:
    """The loop with limits of all thrusts, and motors that lag by `lag` and up to twice as much."""
    actuators = Actuators.unlimited(closed.vehicle)
    if limits:
        actuators.thrusts[:] = np.transpose([limits])
    actuators.lag[:] = lag * np.linspace(1.0, 2.0, closed.vehicle.rotors)
    return replace(closed, actuators=actuators)


def start_of(closed: ClosedLoop) -> Array:
    """A state beside the reference at time 0, with every coordinate off by its own amount."""
    q, v, _ = closed.controller.reference(0.0)
    off = 0.1 * np.cos(np.arange(len(q)))
    return closed.start(q + off, v - 2.0 * off)


def unbounded(closed: ClosedLoop) -> Array:
    return np.full(2 * len(closed.vehicle.coordinates), np.inf)


def loop_of(
    closed: ClosedLoop, bounds: Array | None = None, loads: Loads = NOTHING
) -> CompiledLoop:
    bounds = unbounded(closed) if bounds is None else bounds
    loop = CompiledLoop.of(closed, bounds, loads)
    assert loop is not None
    return loop


# Steps


# Compensation differences thrusts over so short a time that rounding shows.
@pytest.mark.parametrize(("compensated", "rounding"), [(False, 1e-12), (True, 1e-8)])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("name", "lag", "push"),
    [
        ("hexarotor_3link", 0.0, None),
        *((name, lag, None) for name in ("hexarotor", RANDOM) for lag in (0, 0.1)),
        ("hexarotor_3link", 0.0, PUSH),
        (RANDOM, 0.1, replace(PUSH, frame="base")),
    ],
)
def test_every_step_is_that_of_python(
    name: str,
    law: Law,
    lag: float,
    push: Push | None,
    compensated: bool,
    rounding: float,
    modules: Load,
) -> None:
    """From each state that the loop comes to, Python takes the next step to the same state."""
    limits = None if law == "off" else (-1e6, 1e6)
    closed = restricted(closed_loop_of(modules(name), law), limits, lag)
    environment = Environment(closed.vehicle, push) if push else None
    closed = replace(closed, environment=environment, compensated=compensated)
    state = start_of(closed)
    after_work = 2 * len(closed.vehicle.coordinates) + 1
    state[after_work:] += np.cos(np.arange(len(state) - after_work))
    loads = Loads(push=push is not None)
    taken, samples, last = loop_of(closed, loads=loads)(0.0, state, STEP, 25, 1)
    assert taken == len(samples) == 25
    assert np.array_equal(samples[-1], last)
    q, _, work, thrusts, _ = closed.parts(np.ptp(samples, axis=0))
    assert min([*q, *thrusts]) > 1e-3
    assert work > 1e-3 or (law == "off" and not lag and not push)
    for done, after in enumerate(samples):
        expected = rk4_step(closed, done * STEP, state, STEP, loads)
        moved = np.linalg.norm(expected - state)
        assert np.linalg.norm(after - expected) <= rounding * (np.linalg.norm(state) + moved)
        state = after


def test_a_push_that_does_not_act_changes_nothing(modules: Load) -> None:
    closed = closed_loop_of(modules("hexarotor_3link"))
    state = start_of(closed)
    _, free, _ = loop_of(closed)(0.0, state, STEP, 10, 1)
    pushed = replace(closed, environment=Environment(closed.vehicle, PUSH))
    _, waiting, _ = loop_of(pushed)(0.0, state, STEP, 10, 1)
    assert np.array_equal(waiting, free)
    loop = loop_of(pushed, loads=Loads(push=True))
    assert np.abs(loop(0.0, state, STEP, 10, 1)[1] - free).max() > 1e-4


# Samples


@pytest.mark.parametrize("every", [1, 3, 5, 7, 100])
def test_samples_do_not_depend_on_how_steps_are_shared_among_calls(
    every: int, modules: Load
) -> None:
    closed = closed_loop_of(modules("hexarotor_3link"))
    loop, state = loop_of(closed), start_of(closed)
    _, all_states, end = loop(0.0, state, STEP, 40, 1)
    done, found = 0, []
    for count in (7, 1, 0, 12, 3, 4, 13):
        taken, samples, state = loop(done * STEP, state, STEP, count, every, done)
        assert taken == count
        found.append(samples)
        done += taken
    assert np.array_equal(state, end)
    assert np.array_equal(np.concatenate(found), all_states[every - 1 :: every])


def test_a_call_leaves_the_state_that_it_is_given(modules: Load) -> None:
    closed = closed_loop_of(modules("hexarotor"))
    state = start_of(closed)
    before = state.copy()
    loop_of(closed)(0.0, state, STEP, 5, 1)
    assert np.array_equal(state, before)


# Early ends


@pytest.mark.parametrize("place", [0, 4, 8, 9, 13, 17])
def test_a_flight_ends_after_the_step_that_diverges(place: int, modules: Load) -> None:
    """Each coordinate and each rate is held to a bound of its own."""
    closed = closed_loop_of(modules("hexarotor_3link"), "off")
    state = start_of(closed)
    _, states, _ = loop_of(closed)(0.0, state, STEP, 40, 1)
    wanted = np.concatenate(closed.controller.reference(STEP * np.arange(1, 41))[:2], axis=1)
    error = np.abs(states[:, : wanted.shape[1]] - wanted)[:, place]
    bound = (error[20] + error[21]) / 2.0
    first = int(np.argmax(error > bound))
    bounds = unbounded(closed)
    bounds[place] = bound
    taken, samples, last = loop_of(closed, bounds)(0.0, state, STEP, 40, 4)
    assert 0 < taken == first + 1 < 40
    assert np.array_equal(samples, states[3:taken:4])
    assert np.array_equal(last, states[first])


@pytest.mark.parametrize("rate", [-3.0, 3.0, 40.0, -1000.0, 1400.0])
def test_a_flight_ends_after_the_step_that_reaches_the_singularity(
    rate: float, modules: Load
) -> None:
    """Also where the step goes across it, once or twice or all the way round."""
    closed = closed_loop_of(modules("hexarotor"), "off")
    state = np.zeros(closed.size)
    state[1], state[len(closed.vehicle.coordinates) + 1] = math.copysign(1.2, rate), rate
    taken, samples, last = loop_of(closed)(0.0, state, STEP, 100, 1)
    assert 0 < taken == len(samples) < 100
    assert np.array_equal(samples[-1], last)
    assert abs(last[1]) > LARGEST_THETA_0
    assert np.all(np.abs(samples[:-1, 1]) <= LARGEST_THETA_0)
    if abs(rate) > 30.0:
        turned = abs(1.2 + abs(rate) * taken * STEP)
        assert abs(last[1]) == pytest.approx(turned, rel=0.05)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e200])
def test_a_flight_ends_where_it_is_not_finite(wrong: float, modules: Load) -> None:
    free = closed_loop_of(modules(RANDOM))
    for closed in (free, restricted(free, (-1e6, 1e6))):
        state = start_of(closed)
        state[len(closed.vehicle.coordinates)] = wrong
        taken, samples, last = loop_of(closed)(0.0, state, STEP, 10, 1)
        assert taken == len(samples) == 1
        assert not np.all(np.isfinite(last))


# Who has a loop


def test_python_takes_the_steps_of_numpy(shipped: Load) -> None:
    plain = closed_loop_of(shipped("hexarotor"))
    assert CompiledLoop.of(plain, unbounded(plain)) is None


def test_without_a_compiler_python_takes_the_steps(
    modules: Load, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    closed = closed_loop_of(modules("hexarotor"))
    monkeypatch.setenv("CC", "no_such_compiler")
    assert CompiledLoop.of(closed, unbounded(closed)) is None
    assert "steps are taken in Python instead of C" in caplog.text


# The source

_DRIVER = """\
#include "rk4.c"

#include <stdint.h>
#include <stdlib.h>

/* How much too short the scratch is: to see that the instruments would tell. */
#ifndef SHORT
#define SHORT 0
#endif

#define UNTOUCHED 1234567.5
#define FRAMES 2

static ptrdiff_t n, rotors;
static uint64_t seed = 88172645463325252u;

static ptrdiff_t draw(ptrdiff_t below)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return (ptrdiff_t)((seed >> 33) % (uint64_t)below);
}

static double value(void)
{
    return draw(20000) ? (double)draw(2000) * 1e-3 - 1.0 : draw(2) ? (double)NAN : 1e300;
}

static double *room(ptrdiff_t size)
{
    double *array = malloc((size_t)size * sizeof *array);
    if (!array) {
        exit(2);
    }
    return array;
}

static double *filled(ptrdiff_t size)
{
    double *array = room(size);
    for (ptrdiff_t i = 0; i < size; ++i) {
        array[i] = value();
    }
    return array;
}

static void forward(const void *k, const double *q, const double *v, const double *u, double *out)
{
    (void)k;
    for (ptrdiff_t i = 0; i < n; ++i) {
        out[i] = q[i] - v[i] + 1e-3 * u[i % (rotors + n - BASE)] + 1e-3 * u[rotors + n - BASE - 1];
    }
}

static void inverse(const void *k, const double *q, const double *v, const double *a, double *out)
{
    (void)k;
    for (ptrdiff_t i = 0; i < n; ++i) {
        out[i] = q[i] + v[i] + a[i];
    }
}

static void inputs(const void *k, const double *q, double *out)
{
    (void)k;
    for (ptrdiff_t i = 0; i < n * (rotors + n - BASE); ++i) {
        out[i] = q[i % n] + value();
    }
}

static void forces(const void *k, const double *q, const double *wrenches, double *out)
{
    (void)k;
    for (ptrdiff_t i = 0; i < n; ++i) {
        out[i] = q[i] * wrenches[i % (FRAMES * BASE)];
    }
}

static void pushed(const void *k, const double *q, const double *v, const double *u,
                   const double *wrenches, double *out)
{
    forward(k, q, v, u, out);
    out[n - 1] += wrenches[FRAMES * BASE - 1];
}

static void filled_with(double *out, ptrdiff_t size, const double *q)
{
    for (ptrdiff_t i = 0; i < size; ++i) {
        out[i] = q[i % n] + 0.01 * (double)i;
    }
}

static void poses(const void *k, const double *q, double *out)
{
    (void)k;
    filled_with(out, 16 * FRAMES, q);
}

static void jacobians(const void *k, const double *q, double *out)
{
    (void)k;
    filled_with(out, 6 * n * FRAMES, q);
}

static void of_frames(const void *k, const double *q, const double *v, double *out)
{
    (void)k;
    (void)v;
    filled_with(out, 6 * FRAMES, q);
}

/* Of each kind up to three, which begin with the numbers of frames and rotors. */
static void surroundings(Environment *e, double *push, double *rows)
{
    e->frames = draw(3) == 0 ? FRAMES : 0;
    e->push = push;
    e->coefficients = draw(2) ? push : NULL;
    e->wind = push;
    e->gusts = draw(4);
    e->walls = draw(4);
    e->spins = draw(4);
    e->payloads = draw(4);
    e->gravity = push;
    e->gust = rows;
    double *const wall = rows + 15, *const spin = wall + 27, *const payload = spin + 18;
    for (int i = 0; i < 3; ++i) {
        wall[9 * i] = (double)draw(FRAMES);
        spin[6 * i] = (double)draw(rotors);
        spin[6 * i + 1] = (double)draw(FRAMES);
        payload[2 * i] = (double)draw(FRAMES);
    }
    e->wall = wall;
    e->spin = spin;
    e->payload = payload;
}

static void centre_of_mass(const void *k, const double *q, double *out)
{
    (void)k;
    memcpy(out, q + n - 3, 3 * sizeof *out);
}

static void jacobian(const void *k, const double *q, double *out)
{
    (void)k;
    for (ptrdiff_t i = 0; i < 3 * n; ++i) {
        out[i] = q[i % n];
    }
}

int main(void)
{
    ptrdiff_t steps = 0, whole = 0;
    for (int i = 0; i < 3000; ++i) {
        const int large = draw(50) == 0;
        n = large ? 70 : BASE + draw(5);
        rotors = large ? 256 : BASE + draw(5);
        const int turning = draw(2) == 0; /* attitude by a quaternion */
        const ptrdiff_t coordinates = n + turning;
        Loop f = {{forward, inverse, inputs, pushed, forces, poses, jacobians, of_frames, of_frames,
                   centre_of_mass, jacobian}};
        f.layout.coordinates = coordinates;
        f.layout.velocities = n;
        f.layout.rotors = rotors;
        for (int j = 0; j < 3; ++j) {
            f.layout.axes[j] = 2 - j;
        }
        f.layout.middle_angle = -turning;
        f.layout.attitude = turning ? 3 : 0;
        f.layout.joints = turning ? 6 : 3;
        f.layout.position = turning ? 0 : n - 3;
        f.layout.quaternion = f.layout.attitude;
        f.layout.placed = f.layout.position;
        f.desired.pieces = 1 + draw(4);
        f.law = (int)draw(turning ? 5 : 4);
        f.layout.memory = draw(2) ? n : 0; /* with integral action, one for each velocity */
        const double integral = 0.5, mass = 1.5;
        f.gains.integral = &integral;
        double *wrenches = filled(FRAMES * BASE), *rows = filled(15 + 27 + 18 + 6);
        surroundings(&f.environment, wrenches, rows);
        const ptrdiff_t acting = rotors + n - BASE;
        double *least = room(acting), *most = room(acting), *lag = room(rotors);
        double *pace = room(rotors);
        for (ptrdiff_t j = 0; j < acting; ++j) {
            least[j] = -1e4;
            most[j] = 1e4;
        }
        for (ptrdiff_t j = 0; j < rotors; ++j) {
            lag[j] = draw(3) ? 0.1 : 0.0;
            pace[j] = lag[j] > 0.0 ? 10.0 : 0.0;
        }
        f.actuators.limited = draw(4) == 0;
        f.actuators.least = least;
        f.actuators.most = most;
        f.actuators.lags = draw(2) == 0;
        f.actuators.compensates = f.actuators.lags && draw(2) == 0;
        f.actuators.lag = lag;
        f.actuators.pace = pace;
        double *held = filled(acting);
        f.held = held;
        double *bounds = filled(2 * n);
        for (ptrdiff_t j = 0; j < 2 * n; ++j) {
            bounds[j] = 20.0 + fabs(bounds[j]);
        }
        f.envelope.bounds = bounds;
        f.envelope.largest_theta_0 = 1.56;
        f.desired.begin = 0.1 * (double)draw(10) - 0.5;
        f.desired.piece = 0.05;
        double *coefficients = filled(f.desired.pieces * POWERS * coordinates);
        double *distribution = filled(rotors * BASE), *columns = filled(rotors * BASE);
        double *centre = filled(3), *lowest = room(rotors), *highest = room(rotors);
        for (ptrdiff_t j = 0; j < rotors; ++j) {
            lowest[j] = value() - 1.0;
            highest[j] = lowest[j] + 1.0 + fabs(value());
        }
        f.plant_rotors.move = draw(2) == 0;
        f.plant_rotors.centre = f.model_rotors.centre = centre;
        f.plant_rotors.wrenches = f.model_rotors.wrenches = columns;
        f.model_rotors.move = draw(2) == 0;
        f.sharing.limited = draw(2) == 0;
        f.sharing.refuses = draw(8) == 0;
        f.sharing.least = lowest;
        f.sharing.most = highest;
        double *stiffness = filled(n), *damping = filled(n), *losses = filled(n);
        double *weight = filled(3), *path = filled(f.desired.pieces * POWERS * 3);
        f.centre.mass = &mass;
        f.centre.weight = weight;
        f.centre.coefficients = path;
        f.desired.coefficients = coefficients;
        f.sharing.distribution = distribution;
        f.gains.stiffness = stiffness;
        f.gains.damping = damping;
        f.losses = losses;
        f.scratch = room(gibbs_codegen_loop_room(&f) - SHORT);
        f.guesses = room(rotors);
        memset(f.guesses, 0, (size_t)rotors * sizeof *f.guesses);
        const ptrdiff_t size = coordinates + n + 1 + (f.actuators.lags ? rotors : 0) +
                               f.layout.memory;
        const ptrdiff_t count = draw(30), every = 1 + draw(40), before = draw(1000);
        double *state = filled(size), *samples = room((count / every + 1) * size);
        for (ptrdiff_t j = 0; j < (count / every + 1) * size; ++j) {
            samples[j] = UNTOUCHED;
        }
        double *ranges = room((count / every + 2) * 4 * acting);
        for (ptrdiff_t j = 0; j < (count / every + 2) * 4 * acting; ++j) {
            ranges[j] = j / acting % 2 == 0 ? INFINITY : -INFINITY;
        }
        const double time = draw(2) ? 0.0 : 100.0;
        Progress progress = {1, 0, {0}};
        gibbs_codegen_rk4(&f, time, 1e-2, count, every, before, state, samples,
                          draw(2) ? ranges : NULL, &progress);
        const ptrdiff_t taken = progress.taken[0];
        if (taken < 0 || taken > count) {
            return 3;
        }
        const ptrdiff_t kept = (before + taken) / every - before / every;
        for (ptrdiff_t j = 0; j < (count / every + 1) * size; ++j) {
            if ((samples[j] == UNTOUCHED) != (j >= kept * size)) {
                return 4;
            }
        }
        steps += taken;
        whole += taken == count;
        free(wrenches);
        free(rows);
        free(least);
        free(most);
        free(lag);
        free(pace);
        free(held);
        free(bounds);
        free(coefficients);
        free(weight);
        free(path);
        free(distribution);
        free(columns);
        free(centre);
        free(lowest);
        free(highest);
        free(stiffness);
        free(damping);
        free(losses);
        free(f.guesses);
        free(f.scratch);
        free(state);
        free(samples);
        free(ranges);
    }
    return steps > 10000 && whole > 500 ? 0 : 5;
}
"""
_SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("level", ["-O0", "-O3"])
def test_the_source_compiles_silently(compiler: str, level: str, tmp_path: Path) -> None:
    compile_only(compiler, [level], [str(NATIVE / "rk4.c")], tmp_path)


def test_sanitizers_find_nothing_in_random_flights(tmp_path: Path) -> None:
    """Nor would they be silent about a scratch that is one number too short."""
    driver = tmp_path / "driver.c"
    driver.write_text(_DRIVER, encoding="utf-8")
    options = ["-O1", "-Wno-missing-field-initializers", *_SANITIZERS, f"-I{NATIVE}"]
    environment = {"ASAN_OPTIONS": "detect_leaks=0"}
    for short in (0, 1):
        program = tmp_path / f"driver_{short}"
        # The driver compares numbers that must be the same to the last bit.
        own = [f"-DSHORT={short}", "-Wno-float-equal"]
        build("gcc", [*options, *own], [str(driver)], program)
        if not short:
            run([program], **environment)
            continue
        with pytest.raises(pytest.fail.Exception, match="heap-buffer-overflow"):
            run([program], **environment)


def test_the_loop_neither_allocates_nor_keeps_anything(tmp_path: Path) -> None:
    """All it calls is told by its symbols, and it has no data that can be written."""
    (compiled,) = compile_only("gcc", ["-O2"], [str(NATIVE / "rk4.c")], tmp_path)
    symbols = [line.split() for line in run(["nm", compiled]).splitlines()]
    called = {words[-1] for words in symbols if words[-2] == "U"}
    assert called <= {
        *("atan2", "cos", "sin", "sincos", "sqrt", "fmin", "fmax", "memcpy", "memmove", "memset"),
        *("_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"),
    }
    assert not [words for words in symbols if words[-2] in "bBdDC"]
