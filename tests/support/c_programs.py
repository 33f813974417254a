"""Programs in C that call every function of an emitted module, at random and from many threads."""

from __future__ import annotations

import itertools
import math

from gibbs_codegen.interface import Signature
from support.compiled import Emitted

_START = """\
#include "ROBOT.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* How much too short outputs are, by arguments: to see that the instruments would tell. */
static size_t lacking = 0;

#ifndef CALLS
#define CALLS 20000
#endif
#define COUNT_OF(array) (sizeof(array) / sizeof(array)[0])

typedef ROBOT_constants Constants;

static uint64_t state = 88172645463325252u;

static size_t draw(const size_t below)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (size_t)((state >> 33) % below);
}

static double value(void)
{
    static const double special[] = {
        0.0, -0.0, 3.141592653589793, -3.141592653589793, 1e4, -1e4, 1e5, -1e5, 1e6, -1e6,
        (double)INFINITY, -(double)INFINITY, (double)NAN, 5e-324, -1e-310,
    };
    const size_t choice = draw(512);
    return choice < COUNT_OF(special) ? special[choice] : (double)draw(2000000) * 4e-6 - 4.0;
}

static double *room(const size_t size)
{
    double *array = malloc((size - lacking) * sizeof(double));
    if (!array) {
        exit(2);
    }
    return array;
}

static double *filled(const size_t size)
{
    double *array = room(size + lacking);
    for (size_t i = 0; i < size; ++i) {
        array[i] = value();
    }
    return array;
}

static size_t whole_blocks(const size_t count)
{
    return (count + ROBOT_LANES - 1) / ROBOT_LANES * ROBOT_LANES;
}

#ifdef SOUND
/* Gives every state of blocks the same entries. */
static void repeat(const double *entries, size_t width, size_t states, double *blocks)
{
    for (size_t k = 0; k < states; ++k) {
        const size_t lane = k % ROBOT_LANES;
        for (size_t i = 0; i < width; ++i) {
            blocks[(k - lane) * width + i * ROBOT_LANES + lane] = entries[i];
        }
    }
}
#endif

static void try_init_constants(const Constants *constants)
{
    double *parameters = filled(ROBOT_PARAMETERS);
    Constants *made = malloc(sizeof(Constants));
    (void)constants;
#ifdef SOUND
    memcpy(parameters, ROBOT_default_parameters, ROBOT_PARAMETERS * sizeof(double));
#endif
    if (!made || ROBOT_init_constants(parameters, made) > 1) {
        exit(2);
    }
    free(parameters);
    free(made);
}

static void try_init_constants_batch(const Constants *constants)
{
    const size_t count = draw(21), room_for = whole_blocks(count);
    double *parameters = filled(ROBOT_PARAMETERS * room_for);
    double *made = room(ROBOT_CONSTANTS * room_for);
    (void)constants;
#ifdef SOUND
    repeat(ROBOT_default_parameters, ROBOT_PARAMETERS, room_for, parameters);
#endif
    if (ROBOT_init_constants_batch(count, parameters, made) > count) {
        exit(2);
    }
    free(parameters);
    free(made);
}

static void try_pack_and_unpack(const Constants *constants)
{
    const size_t count = draw(21), width = 1 + draw(9);
    double *rows = filled(count * width);
    double *blocks = room(whole_blocks(count) * width + lacking);
    double *back = room(count * width + lacking);
    (void)constants;
    ROBOT_pack(count, width, rows, blocks);
    ROBOT_unpack(count, width, blocks, back);
    if (memcmp(rows, back, count * width * sizeof(double)) != 0) {
        exit(3);
    }
    free(rows);
    free(blocks);
    free(back);
}
"""

_END = """\

int main(int count, char **words)
{
    static void (*const tries[])(const Constants *) = {
        try_init_constants,
        try_init_constants_batch,
        try_pack_and_unpack,
        TRIES
    };
    Constants *constants = malloc(sizeof(Constants));
    lacking = (size_t)(count - 1);
    (void)words;
    if (!constants || ROBOT_init_constants(ROBOT_default_parameters, constants) != 0) {
        return 2;
    }
    for (int i = 0; i < CALLS; ++i) {
        tries[draw(COUNT_OF(tries))](constants);
    }
    free(constants);
    return 0;
}
"""


def random_calls(emitted: Emitted) -> str:
    """A program of CALLS random calls, each array in a piece of the heap of just its size.

    Outputs are too short by as many numbers as it has arguments.

    With SOUND defined, parameters are those of the robot file; else they are random, too.
    """
    parts, tries = [_START], []
    for signature in emitted.signatures():
        for form in ("", "_batch", "_batch_each"):
            tries.append(f"try_{signature.name}{form}")
            parts.append(_try(signature, form))
    end = _END.replace("TRIES", ",\n        ".join(tries))
    text = "".join([*parts, end])
    for macro in ("LANES", "PARAMETERS", "CONSTANTS"):
        text = text.replace(f"ROBOT_{macro}", f"{emitted.name.upper()}_{macro}")
    return text.replace("ROBOT", emitted.name)


def _try(signature: Signature, form: str) -> str:
    times = " * whole_blocks(count)" if form else ""
    names = [*signature.arguments, *(f"output_{i}" for i in range(len(signature.shapes)))]
    made = [f"filled({width}{times})" for width in signature.widths]
    made += [f"room({math.prod(shape)}{times})" for shape in signature.shapes]
    first, lines = "constants", ["    const size_t count = draw(21);"] if form else []
    if form == "_batch_each":
        first, names, made = "own", ["own", *names], [f"filled(ROBOT_CONSTANTS{times})", *made]
        lines += ["    (void)constants;"]
    lines += [f"    double *{name} = {array};" for name, array in zip(names, made, strict=True)]
    if form == "_batch_each":
        same = "(const double *)constants, ROBOT_CONSTANTS, whole_blocks(count), own"
        lines += ["#ifdef SOUND", f"    repeat({same});", "#endif"]
    given = [name for name in names if name != "own"]
    call = ", ".join([first, *(["count"] if form else []), *given])
    lines += [f"    ROBOT_{signature.name}{form}({call});"]
    lines += [f"    free({name});" for name in names]
    head = f"\nstatic void try_{signature.name}{form}(const Constants *constants)\n"
    return "\n".join([head + "{", *lines, "}", ""])


_THREADS_START = """\
#include "ROBOT.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef CALLS
#define CALLS 100000
#endif
#define THREADS 8
/* Two whole blocks and a part of one. */
#define COUNT 19
#define ROOM ((COUNT + ROBOT_LANES - 1) / ROBOT_LANES * ROBOT_LANES)

static const ROBOT_constants *const constants = &ROBOT_default_constants;

typedef struct {
    int number;
    long wrong;
} Work;
"""

_THREADS_END = """\

static void fill(ROBOT_real *numbers, const size_t size, const int seed)
{
    for (size_t i = 0; i < size; ++i) {
        numbers[i] = (ROBOT_real)((i * 7919u + (size_t)seed * 104729u) % 2003u) / 500 - 2;
    }
}

static void *work(void *given)
{
    Work *const mine = (Work *)given;
    for (int i = 0; i < CALLS; ++i) {
        mine->wrong += checks[(i + mine->number) % NUMBER]((i / NUMBER) % COUNT);
    }
    return NULL;
}

int main(void)
{
    pthread_t threads[THREADS];
    Work works[THREADS];
    INPUTS
    REFERENCES
    for (int i = 0; i < THREADS; ++i) {
        works[i].number = i;
        works[i].wrong = 0;
        if (pthread_create(&threads[i], NULL, work, &works[i]) != 0) {
            return 2;
        }
    }
    long wrong = 0;
    for (int i = 0; i < THREADS; ++i) {
        if (pthread_join(threads[i], NULL) != 0) {
            return 2;
        }
        wrong += works[i].wrong;
    }
    printf("%ld\\n", wrong);
    return 0;
}
"""


def threads_beside_each_other(emitted: Emitted) -> str:
    """A program that prints how many of CALLS calls in each of eight threads are not as alone.

    Calls for one state and in blocks take turns; bytes are compared with those that one thread made
    before. With SPOILED defined, one of these bytes is another.
    """
    pairs = [zip(s.arguments, s.widths, strict=True) for s in emitted.signatures()]
    widths = dict(itertools.chain(*pairs))
    parts, inputs, references, checks = [_THREADS_START], [], [], []
    for seed, (name, width) in enumerate(widths.items()):
        parts.append(f"static ROBOT_real {name}[COUNT * {width}], {name}_blocks[ROOM * {width}];\n")
        inputs.append(f"fill({name}, COUNT * {width}, {seed});")
        inputs.append(f"ROBOT_pack(COUNT, {width}, {name}, {name}_blocks);")
    for signature in emitted.signatures():
        for form in ("", "_batch"):
            checks.append(f"check_{signature.name}{form}")
            parts.append(_check(signature, form))
            references.append(f"make_{signature.name}{form}();")
    last = emitted.signatures()[-1]
    spoiled = f"#ifdef SPOILED\n    right_{last.name}_batch_0[0] += 1;\n#endif"
    parts.append(f"\n#define NUMBER {len(checks)}\n")
    parts.append(f"static long (*const checks[NUMBER])(int) = {{\n    {', '.join(checks)}\n}};\n")
    end = _THREADS_END.replace("INPUTS", "\n    ".join(inputs))
    parts.append(end.replace("REFERENCES", "\n    ".join([*references, spoiled])))
    text = "".join(parts).replace("ROBOT_LANES", f"{emitted.name.upper()}_LANES")
    return text.replace("ROBOT", emitted.name)


def _check(signature: Signature, form: str) -> str:
    """What makes and what compares the results of a function, for a state or for all in blocks."""
    name = f"{signature.name}{form}"
    batch = form == "_batch"
    sizes = [math.prod(shape) for shape in signature.shapes]
    rights = [f"right_{name}_{i}" for i in range(len(sizes))]
    lines = [f"static ROBOT_real {r}[ROOM * {s}];" for r, s in zip(rights, sizes, strict=True)]
    if batch:
        given = ", ".join(f"{n}_blocks" for n in signature.arguments)
        call = f"ROBOT_{name}(constants, COUNT, {given}"
    else:
        pairs = zip(signature.arguments, signature.widths, strict=True)
        given = ", ".join(f"{n} + state * {w}" for n, w in pairs)
        call = f"ROBOT_{name}(constants, {given}"
    lines += [f"static void make_{name}(void)", "{"]
    if batch:
        lines.append(f"    {call}, {', '.join(rights)});")
    else:
        places = ", ".join(f"{r} + state * {s}" for r, s in zip(rights, sizes, strict=True))
        lines += ["    for (int state = 0; state < COUNT; ++state) {"]
        lines += [f"        {call}, {places});", "    }"]
    lines += ["}", f"static long check_{name}(int state)", "{"]
    room = "ROOM * " if batch else ""
    lines += [f"    ROBOT_real found_{i}[{room}{s}];" for i, s in enumerate(sizes)]
    lines += [f"    {call}, {', '.join(f'found_{i}' for i in range(len(sizes)))});"]
    if batch:
        lines.append("    (void)state;")
    # Lanes beyond the states hold the last one again, as `pack` makes them: they count as well.
    differ = [
        f"memcmp(found_{i}, {r}{'' if batch else f' + state * {s}'}, sizeof(found_{i})) != 0"
        for i, (r, s) in enumerate(zip(rights, sizes, strict=True))
    ]
    lines += [f"    return {' || '.join(differ)};", "}", ""]
    return "\n" + "\n".join(lines)
