"""Products and sums made quickly are those that SymPy makes: equal, in the same order."""

from __future__ import annotations

import itertools
import random

import sympy as sp

from gibbs_codegen.symbolic.tape import negated, plus, times

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


def test_opposites_are_those_of_sympy() -> None:
    for a in FACTORS:
        assert negated(a) == -a, a
        assert negated(a).args == (-a).args


def test_sums_are_those_of_sympy() -> None:
    rng = random.Random(0)  # noqa: S311 - nothing secret
    products = [a * b for a, b in itertools.combinations(SYMBOLS, 2)]
    atoms = (*SYMBOLS, *products, *FACTORS, *map(sp.sympify, ("2", "1/3", "sqrt(2)")))
    for _ in range(2000):
        terms = [rng.choice((-1, 1)) * atom for atom in rng.choices(atoms, k=rng.randint(0, 5))]
        assert plus(*terms) == sp.Add(*terms), terms
        assert plus(*terms).args == sp.Add(*terms).args
