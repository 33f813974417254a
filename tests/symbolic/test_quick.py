"""Products and sums made quickly are those that SymPy makes: equal, in the same order."""

from __future__ import annotations

import itertools
import random

import sympy as sp

from gibbs_codegen.symbolic.tape import sum_of_signed, times

SYMBOLS = sp.symbols("t2 t10 k1 k20 theta_m1 a Z")
FACTORS = (
    *SYMBOLS,
    *(-symbol for symbol in SYMBOLS),
    *map(sp.sympify, (0, 1, -1, "1/2", "-0.25")),
    sp.sqrt(3) / 2,
    SYMBOLS[0] ** 2,
    SYMBOLS[0] * SYMBOLS[1],
    SYMBOLS[0] + SYMBOLS[1],
)


def test_products_are_those_of_sympy() -> None:
    for a, b in itertools.product(FACTORS, repeat=2):
        assert times(a, b) == a * b, (a, b)
        assert times(a, b).args == (a * b).args


def test_sums_are_those_of_sympy() -> None:
    rng = random.Random(0)  # noqa: S311 - nothing secret
    numbers = (sp.Integer(2), sp.Rational(1, 3), sp.Float("0.5", 40), sp.sqrt(2))
    for _ in range(200):
        atoms = rng.sample(SYMBOLS, rng.randint(2, 5)) + rng.sample(numbers, rng.randint(0, 2))
        terms = [(rng.choice((-1, 1)), atom) for atom in rng.sample(atoms, len(atoms))]
        expected = sp.Add(*(sign * atom for sign, atom in terms))
        assert sum_of_signed(terms) == expected, terms
        assert sum_of_signed(terms).args == expected.args
