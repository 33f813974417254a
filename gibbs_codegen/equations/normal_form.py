"""Expanded, collected forms of nested expressions: polynomials with sines and cosines.

The recursions leave sums of products of sums. Multiplied out over the rationals, with
sin² + cos² = 1 and like terms added, the same expressions are many times shorter than what
`expand` and `simplify` make of them, and take a second instead of hours. Multiplication stops as
soon as there are more terms than are wanted.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import sympy as sp
from sympy.polys.rings import PolyRing

Monomial = tuple[int, ...]
Terms = dict[Monomial, Any]


class TooLongError(Exception):
    """An expression that has more terms than are wanted."""


def collected(expression: sp.Expr, keys: Sequence[sp.Symbol], most: int) -> sp.Expr:
    """The expression multiplied out and collected by products of `keys`.

    It is made of rational numbers and their square roots, symbols, sines and cosines, sums,
    products and positive powers. In each coefficient common factors stand before the sum. Raises
    `TooLongError` if a step has more than `most` terms.
    """
    functions_used = _leaves(expression)
    if not functions_used:
        return expression
    # And sines and cosines of the angles that occur, and of single ones by which two differ.
    angles = {leaf.args[0] for leaf in functions_used if isinstance(leaf, (sp.sin, sp.cos))}
    angles |= {a - b for a in angles for b in angles if (a - b).is_Symbol}
    related = {function(angle) for angle in angles for function in (sp.sin, sp.cos)}
    leaves = sorted(functions_used | related, key=sp.default_sort_key)
    expansion = _Expansion(leaves, most)
    places = [leaves.index(key) for key in keys if key in leaves]
    groups: dict[Monomial, Terms] = defaultdict(dict)
    for monomial, number in expansion.polynomial(expression).items():
        powers = [0] * len(leaves)
        for place in places:
            powers[place] = monomial[place]
        rest = tuple(m - p for m, p in zip(monomial, powers, strict=True))
        groups[tuple(powers)][rest] = number
    return sp.Add(
        *(
            sp.Mul(expansion.product(powers), *expansion.factored(expansion.shortest(terms)))
            for powers, terms in groups.items()
        )
    )


def count_terms(expression: sp.Expr) -> int:
    """The number of terms added anywhere in an expression, at least one."""
    if expression.is_Add or expression.is_Mul:
        counts = [count_terms(argument) for argument in expression.args]
        return sum(counts) if expression.is_Add else max(counts)
    return 1


def _leaves(expression: sp.Expr) -> set[sp.Expr]:
    """Symbols, sines and cosines, and square roots of primes."""
    leaves: set[sp.Expr] = set()
    seen: set[sp.Expr] = set()
    waiting = [expression]
    while waiting:
        node = waiting.pop()
        if node in seen:
            continue
        seen.add(node)
        if node.is_Symbol or isinstance(node, (sp.sin, sp.cos)):
            leaves.add(node)
        elif node.is_Pow and node.base.is_Integer:
            leaves.update(sp.sqrt(prime) for prime in sp.factorint(node.base))
        else:
            waiting.extend(node.args)
    return leaves


class _Expansion:
    """Polynomials in fixed leaves, in which no sine and no square root has a power above one."""

    def __init__(self, leaves: Sequence[sp.Expr], most: int) -> None:
        self._leaves = leaves
        self._most = most
        self._ring = PolyRing([sp.Dummy() for _ in leaves], sp.QQ, sp.lex)
        self._gens = dict(zip(leaves, self._ring.gens, strict=True))
        place = {leaf: i for i, leaf in enumerate(leaves)}
        # Places of the cosine and the sine of each angle.
        self._angles = [
            (place[leaf], place[sp.sin(leaf.args[0])])
            for leaf in leaves
            if isinstance(leaf, sp.cos)
        ]
        # The same of two angles and of the one by which they differ.
        by_angle = {leaves[cosine].args[0]: (cosine, sine) for cosine, sine in self._angles}
        self._differences = [
            (*by_angle[a], *by_angle[b], *by_angle[a - b])
            for a in by_angle
            for b in by_angle
            if a - b in by_angle
        ]
        self._roots = [(place[leaf], int(leaf.base)) for leaf in leaves if leaf.is_Pow]
        self._polynomials: dict[sp.Expr, Any] = {}

    def polynomial(self, expression: sp.Expr) -> Any:
        """Numbers by monomials."""
        if expression in self._polynomials:
            return self._polynomials[expression]
        polynomial, factors = self._ring.one, []
        if expression in self._gens:
            polynomial = self._gens[expression]
        elif expression.is_Rational:
            polynomial = self._ring(sp.QQ(expression.p, expression.q))
        elif expression.is_Add:
            polynomial = sum(map(self.polynomial, expression.args), self._ring.zero)
        elif expression.is_Mul:
            factors = [self.polynomial(argument) for argument in expression.args]
        elif expression.is_Pow and expression.exp == sp.Rational(1, 2):
            factors = [self._gens[sp.sqrt(p)] for p in sp.factorint(expression.base)]
        elif expression.is_Pow and expression.exp.is_Integer and expression.exp > 0:
            factors = [self.polynomial(expression.base)] * int(expression.exp)
        else:
            raise TypeError(f"no polynomial: {type(expression).__name__}: {expression}")
        for factor in sorted(factors, key=len):
            if len(polynomial) * len(factor) > 50 * self._most:
                raise TooLongError
            terms = dict(polynomial * factor)
            for place, base in self._roots:
                terms = _square_replaced(terms, place, [(None, base)])
            for cosine, sine in self._angles:
                terms = _square_replaced(terms, sine, [(None, 1), (cosine, -1)])
            polynomial = self._ring.from_dict(terms)
        if len(polynomial) > self._most:
            raise TooLongError
        self._polynomials[expression] = polynomial
        return polynomial

    def shortest(self, terms: Terms) -> Terms:
        """The same polynomial in fewer terms.

        Differences of angles are made out first, then, angle by angle, the squares of which
        function leave fewer terms.
        """
        for places in self._differences:
            terms = _merged(terms, *places)
        for cosine, sine in self._angles:
            other = _square_replaced(terms, cosine, [(None, 1), (sine, -1)])
            terms = min(_folded(terms, cosine, sine), _folded(other, sine, cosine), key=len)
        return terms

    def factored(self, terms: Terms) -> list[sp.Expr]:
        """The polynomial as factors: the common part of its terms, and the sum of the rest."""
        shared = tuple(map(min, zip(*terms, strict=True)))
        content = sp.S.Zero
        for number in terms.values():
            content = sp.gcd(content, sp.Rational(number.numerator, number.denominator))
        if sum(number < 0 for number in terms.values()) * 2 > len(terms):
            content = -content
        rest = [
            sp.Mul(
                sp.Rational(number.numerator, number.denominator) / content,
                self.product(tuple(m - s for m, s in zip(monomial, shared, strict=True))),
            )
            for monomial, number in terms.items()
        ]
        return [content, self.product(shared), sp.Add(*rest)]

    def product(self, powers: Monomial) -> sp.Expr:
        """A monomial as an expression."""
        return sp.Mul(*(leaf**p for leaf, p in zip(self._leaves, powers, strict=True) if p))


def _square_replaced(terms: Terms, place: int, value: list[tuple[int | None, int]]) -> Terms:
    """Replace the square of the leaf at a place, which then has no power above one.

    `value` is a sum of numbers (None) and numbers times squares of leaves.
    """
    while any(monomial[place] > 1 for monomial in terms):
        replaced: Terms = defaultdict(lambda: sp.QQ(0))
        for monomial, number in terms.items():
            if monomial[place] < 2:
                replaced[monomial] += number
                continue
            for square, factor in value:
                powers = list(monomial)
                powers[place] -= 2
                if square is not None:
                    powers[square] += 2
                replaced[tuple(powers)] += number * factor
        terms = {monomial: number for monomial, number in replaced.items() if number}
    return terms


def _folded(terms: Terms, kept: int, folded: int) -> Terms:
    """Write p·(1 − x²) as p·y², where x and y are cosine and sine or the other way round.

    `kept` is the place of x, `folded` that of y.
    """
    result = dict(terms)
    for monomial in sorted(terms, reverse=True):
        if monomial[kept] < 2 or monomial not in result:
            continue
        powers = list(monomial)
        powers[kept] -= 2
        lower = tuple(powers)
        if lower in result and result[lower] == -result[monomial]:
            powers[folded] += 2
            number = result.pop(lower)
            del result[monomial]
            result[tuple(powers)] = result.get(tuple(powers), sp.QQ(0)) + number
    return {monomial: number for monomial, number in result.items() if number}


def _merged(terms: Terms, cos_a: int, sin_a: int, cos_b: int, sin_b: int, c: int, s: int) -> Terms:
    """Write cos a·cos b + sin a·sin b as cos(a − b), sin a·cos b − cos a·sin b as sin(a − b).

    The arguments are places of these functions; `c` and `s` those of a − b.
    """
    result = dict(terms)
    for (first, second), (third, fourth), sign, merged in (
        ((cos_a, cos_b), (sin_a, sin_b), 1, c),
        ((sin_a, cos_b), (cos_a, sin_b), -1, s),
    ):
        for monomial in sorted(result, reverse=True):
            if monomial not in result or not (monomial[first] and monomial[second]):
                continue
            powers = list(monomial)
            powers[first] -= 1
            powers[second] -= 1
            partner, product = list(powers), list(powers)
            partner[third] += 1
            partner[fourth] += 1
            product[merged] += 1
            if result.get(tuple(partner)) == sign * result[monomial]:
                del result[tuple(partner)]
                number = result.pop(monomial)
                result[tuple(product)] = result.get(tuple(product), sp.QQ(0)) + number
    return {monomial: number for monomial, number in result.items() if number}
