"""Motions by hand: a turntable and a slide on it, and steps and turns of nothing."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.symbolic.tape import Stage, Tape
from gibbs_codegen.symbolic.vectors import NO_ROTATION


def symbols(tape: Tape, names: str) -> list[sp.Symbol]:
    return [tape.symbol(name, Stage.MOTION) for name in names.split()]


def value(tape: Tape, expression: sp.Expr) -> sp.Expr:
    """An entry without names for its parts."""
    while found := expression.free_symbols & set(tape.statements):
        expression = expression.xreplace({name: tape.statements[name] for name in found})
    return sp.expand(expression)


def test_a_point_on_a_turntable() -> None:
    """It is drawn to the axis by rω², and along its path by r·dω/dt."""
    tape = Tape()
    rate, rise, r = symbols(tape, "rate rise r")
    still = Motion.of(tape, *[(sp.S.Zero,) * 3] * 3)
    turning = still.spun(tape, rate, rise)
    for moved in (
        turning.displaced(tape, (r, sp.S.Zero, sp.S.Zero)),
        turning.displaced_along(tape, NO_ROTATION, r),
    ):
        found = [value(tape, entry) for entry in moved.acceleration]
        assert found == [-r * rate**2, r * rise, 0]


def test_a_slide_on_what_turns_feels_coriolis() -> None:
    """r̈ gains 2ω×żz + z̈z, so 2ω_y·ż along x and −2ω_x·ż along y."""
    tape = Tape()
    x, y, z, rate, gain = symbols(tape, "x y z rate gain")
    turning = Motion.of(tape, (x, y, z), (sp.S.Zero,) * 3, (sp.S.Zero,) * 3)
    found = [value(tape, entry) for entry in turning.slid(tape, rate, gain).acceleration]
    assert found == [2 * y * rate, -2 * x * rate, gain]


def test_what_adds_nothing_is_not_written() -> None:
    tape = Tape()
    x, y, z, *rest = symbols(tape, "x y z a b c")
    motion = Motion.of(tape, (x, y, z), (sp.S.Zero,) * 3, tuple(rest))
    written = dict(tape.statements)
    assert motion.displaced_along(tape, NO_ROTATION, sp.S.Zero) is motion
    assert motion.spun(tape, sp.S.Zero, sp.S.Zero) is motion
    assert motion.rotated(tape, NO_ROTATION) is motion
    assert tape.statements == written
