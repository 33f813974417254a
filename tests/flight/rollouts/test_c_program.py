"""Rollouts as C programs call them: the program of the page, and one under instruments."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.compiled import SANITIZERS, Emitted, build
from support.pages import blocks
from support.tools import compiled, run, tool

from gibbs_codegen import generate, load

SMALL = "quadrotor_2link"
# Everything at once, and as little as can be, in arrays of just their size; in one call, and cut
# into many, some of them empty. What is left out stands for what the header says.
PROGRAM = """\
#include "ROBOT_rollout.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    COUNT = 2 * ROBOT_LANES + 3, STEPS = 12, EVERY = 5, SAMPLES = 1 + STEPS / EVERY,
    NQ = ROBOT_COORDINATES, NV = ROBOT_VELOCITIES, NU = ROBOT_INPUTS
};
typedef ROBOT_real real;
static const double STEP = 0.01;

static void *room(const size_t count, const size_t size)
{
    void *array = calloc(count, size);
    if (!array) exit(2);
    return array;
}

/* Numbers of about `scale`, the same in every run. */
static real *filled(const size_t count, const real scale)
{
    real *array = (real *)room(count, sizeof(real));
    for (size_t i = 0; i < count; ++i) {
        array[i] = scale * (real)((int)(i * 7919u % 2003u) - 1001) / 1001;
    }
    return array;
}

static ROBOT_rollout_rows rows(real *entries, const size_t width, const int by_step)
{
    ROBOT_rollout_rows made;
    made.entries = entries;
    made.by_state = by_step ? STEPS * width : width;
    made.by_step = by_step ? width : 0;
    return made;
}

static ROBOT_rollout_states beginning(const size_t every)
{
    ROBOT_rollout_states states;
    states.q = filled(COUNT * NQ, (real)0.1);
    states.v = filled(COUNT * NV, (real)0.1);
    states.thrusts = filled(COUNT * ROTORS, 1);
    states.steps = (size_t *)room(COUNT, sizeof(size_t));
    states.ended = (unsigned char *)room(COUNT, 1);
    states.every = every;
    states.samples = SAMPLES;
    states.q_samples = filled(COUNT * SAMPLES * NQ, 0);
    states.v_samples = filled(COUNT * SAMPLES * NV, 0);
    states.thrust_samples = filled(COUNT * SAMPLES * ROTORS, 0);
    return states;
}

/* Whether anything differs that comes out. */
static int differ(const ROBOT_rollout_states *a, const ROBOT_rollout_states *b)
{
    return memcmp(a->q, b->q, COUNT * NQ * sizeof(real)) != 0 ||
        memcmp(a->v, b->v, COUNT * NV * sizeof(real)) != 0 ||
        memcmp(a->thrusts, b->thrusts, COUNT * ROTORS * sizeof(real)) != 0 ||
        memcmp(a->steps, b->steps, COUNT * sizeof(size_t)) != 0 ||
        memcmp(a->ended, b->ended, COUNT) != 0 ||
        memcmp(a->q_samples, b->q_samples, COUNT * SAMPLES * NQ * sizeof(real)) != 0 ||
        memcmp(a->v_samples, b->v_samples, COUNT * SAMPLES * NV * sizeof(real)) != 0 ||
        memcmp(a->thrust_samples, b->thrust_samples, COUNT * SAMPLES * ROTORS * sizeof(real)) != 0;
}

static void discard(const ROBOT_rollout_states *states)
{
    free(states->q);
    free(states->v);
    free(states->thrusts);
    free(states->steps);
    free(states->ended);
    free(states->q_samples);
    free(states->v_samples);
    free(states->thrust_samples);
}

/* Rolls out in one call, and again in many; returns how many states went out of bounds. */
static int roll(const ROBOT_rollout_given *s, const size_t every, ROBOT_rollout_states *whole)
{
    ROBOT_rollout_states cut = beginning(every);
    int ended = 0;
    *whole = beginning(every);
    ROBOT_rollout(s, STEP, whole, 0, COUNT, 0, STEPS);
    for (size_t first = 0; first < COUNT; first += 5) {
        const size_t count = COUNT - first < 5 ? COUNT - first : 5;
        ROBOT_rollout(s, STEP, &cut, first, count, 0, 3);
        ROBOT_rollout(s, STEP, &cut, first, count, 3, 3);
        ROBOT_rollout(s, STEP, &cut, first, 0, 3, STEPS);
        ROBOT_rollout(s, STEP, &cut, first, count, 3, STEPS);
    }
    if (differ(whole, &cut)) exit(3);
    discard(&cut);
    for (int i = 0; i < COUNT; ++i) ended += whole->ended[i] == ROBOT_ROLLOUT_OUT_OF_BOUNDS;
    return ended;
}

int main(void)
{
    ROBOT_rollout_given s, little;
    ROBOT_constants *constants = (ROBOT_constants *)room(COUNT, sizeof *constants);
    real *inputs = filled((size_t)COUNT * STEPS * NU, 9), *gain = filled(NU * 2 * NV, 1);
    real *desired_q = filled(COUNT * NQ, 1), *desired_v = filled(COUNT * NV, 1);
    real *least = filled(NU, 0), *most = filled(NU, 0), *huge = filled(NU, 0);
    real *lags = filled(COUNT * 3 * ROTORS, 0);
    real *wrenches = filled(COUNT * ROBOT_FRAMES * 6, 2), *lowest = filled(NQ + NV, 0);
    real *highest = filled(NQ + NV, 0);
    real *zeros = filled(COUNT * NQ, 0);
    ROBOT_rollout_states whole, same;
    int ended = 0;
    memset(&s, 0, sizeof s);
    for (int i = 0; i < COUNT; ++i) {
        real parameters[ROBOT_PARAMETERS];
        memcpy(parameters, ROBOT_default_parameters, sizeof parameters);
        parameters[ROBOT_GRAVITY] += (real)i;
        if (ROBOT_init_constants(parameters, &constants[i]) != 0) return 2;
        for (int k = 0; k < 3 * ROTORS; ++k) {
            /* What is left at the start, after half of the step, and at its end. */
            lags[i * 3 * ROTORS + k] = k % 3 ? (real)(4 >> k / ROTORS) / 4 : 0;
        }
    }
    for (int i = 0; i < NU; ++i) {
        most[i] = 7;
        huge[i] = (real)1e30;
    }
    for (int i = 0; i < NQ + NV; ++i) {
        lowest[i] = -2;
        highest[i] = 2;
    }
    s.constants = constants;
    s.constants_by_state = 1;
    s.u = rows(inputs, NU, 1);
    s.gain.entries = gain;
    s.desired_q = rows(desired_q, NQ, 0);
    s.desired_v = rows(desired_v, NV, 0);
    s.least.entries = least;
    s.most.entries = most;
    s.lag = rows(lags, 3 * ROTORS, 0);
    s.wrenches = rows(wrenches, ROBOT_FRAMES * 6, 0);
    s.lowest.entries = lowest;
    s.highest.entries = highest;
    for (s.method = ROBOT_ROLLOUT_EULER; s.method <= ROBOT_ROLLOUT_RK4; ++s.method) {
        ended += roll(&s, EVERY, &whole);
        discard(&whole);
        memset(&little, 0, sizeof little);
        little.constants = constants;
        little.method = s.method;
        little.gain.entries = gain;
        little.desired_q = s.desired_q;
        little.least.entries = least;
        roll(&little, 0, &whole);
        little.u = rows(zeros, 0, 0);
        little.desired_v = rows(zeros, 0, 0);
        little.most.entries = huge;
        roll(&little, STEPS + 1, &same);
        if (differ(&whole, &same)) return 5;
        discard(&whole);
        discard(&same);
        little.most.entries = least;
        little.least.entries = NULL;
        roll(&little, 0, &whole);
        for (int i = 0; i < NU; ++i) huge[i] = -huge[i];
        little.least.entries = huge;
        roll(&little, 0, &same);
        for (int i = 0; i < NU; ++i) huge[i] = -huge[i];
        if (differ(&whole, &same)) return 6;
        discard(&whole);
        discard(&same);
    }
    free(zeros);
    free(huge);
    free(constants);
    free(inputs);
    free(gain);
    free(desired_q);
    free(desired_v);
    free(least);
    free(most);
    free(lags);
    free(wrenches);
    free(lowest);
    free(highest);
    printf("%d\\n", ended);
    return 0;
}
"""


@pytest.fixture(scope="module")
def robot_objects(
    emitted: Callable[[str], Emitted], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], list[str]]:
    """The robot's own functions, compiled for a precision; they have tests of their own."""

    @functools.cache
    def made(real: str) -> list[str]:
        small, folder = emitted(SMALL), tmp_path_factory.mktemp(real)
        single = [small.single] if real == "float" else []
        parts = {".c": folder / "robot.o", "_each.c": folder / "each.o"}
        for ending, part in parts.items():
            compiled([tool("gcc"), "-O0", *single, "-c", small.file(ending)], part)
        return [str(part) for part in parts.values()]

    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("compiler", "real"),
    [("gcc", "float")],
)
def test_no_warning_and_no_byte_out_of_place(
    compiler: str,
    real: str,
    emitted: Callable[[str], Emitted],
    robot_objects: Callable[[str], list[str]],
    tmp_path: Path,
) -> None:
    small = emitted(SMALL)
    text = re.sub(r"ROBOT_(?=[A-Z])", f"{small.name.upper()}_", PROGRAM)
    (tmp_path / "program.c").write_text(text.replace("ROBOT", small.name), encoding="utf-8")
    rotors = sum(name.startswith("F_") for name in small.module.INPUTS)
    options = [f"-I{small.folder}", f"-DROTORS={rotors}", "-O0", *SANITIZERS]
    options += [small.single] if real == "float" else []
    options += [f"-D{small.name.upper()}_SINGLY"] if compiler.startswith("clang") else []
    sources = [str(tmp_path / "program.c"), str(small.file("_rollout.c"))]
    objects = ["-x", "none", *robot_objects(real)]
    program = build(compiler, options, [*sources, *objects], tmp_path / "program")
    states = 2 * (2 * (16 if real == "float" else 8) + 3)
    assert 0 < int(run([program])) < states


@pytest.mark.slow
@pytest.mark.parametrize(("real", "off"), [("double", 1e-9)])
def test_the_program_of_the_page(real: str, off: float, tmp_path: Path) -> None:
    """Level quadrotors rise and fall as 4 F / m - g says."""
    (text,) = blocks("docs/howto/rollouts.md", "c")
    (tmp_path / "program.c").write_text(text, encoding="utf-8")
    folder = generate("quadrotor", tmp_path, targets=("numpy", "c", "rollout"), verify=False)
    module = load(folder)
    sources = [folder / f"quadrotor{ending}" for ending in (".c", "_each.c", "_rollout.c")]
    options = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O0", f"-I{folder}"]
    options += ["-DQUADROTOR_FLOAT"] if real == "float" else []
    program = tmp_path / "program"
    compiled([tool("cc"), *options, tmp_path / "program.c", *sources, "-lm"], program)
    found = [float(number) for number in run([program]).split()]
    step, thrusts = 0.005, 4.0 * (2.0 - 0.01 * np.arange(200))
    expected = []
    for share, steps in ((0.0, 100), (0.999, 200)):
        mass = module.PARAMETERS["base_mass"] * (0.9 + 0.2 * share)
        rates = np.concatenate([[0.0], np.cumsum(step * (thrusts / mass - 9.81))])
        expected.append(float(np.sum(step * (rates[:-1] + rates[1:])[:steps] / 2.0)))
    np.testing.assert_allclose(found, expected, rtol=off)
