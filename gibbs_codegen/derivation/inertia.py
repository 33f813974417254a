"""Inertia of a link or of several as one: rotated, shifted and added.

Seen from its parent, a link is a Gibbs function in the parent's accelerations with other B's. That
one rule serves the composites of the mass matrix, the merging of the rigid base arms, and
regrouping.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.gibbs import MASS, MOMENT, SECOND, evaluated, link_mass_block
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, Vector, Wrench

# Where r̈ and ω̇ begin among the accelerations of a link.
LINEAR, ANGULAR = 0, 3

# Rows and columns of the entries of a symmetric matrix, in the order of robot files.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

SecondMoments = tuple[sp.Expr, sp.Expr, sp.Expr, sp.Expr, sp.Expr, sp.Expr]


@dataclass(frozen=True)
class Inertia:
    """Mass B₀, first moment C and second moments E (xx, yy, zz, xy, xz, yz) about a point."""

    mass: sp.Expr
    moment: Vector
    second: SecondMoments

    def entry(self, i: int, j: int) -> sp.Expr:
        """E_ij (kg m²), i and j from 0."""
        return self.second[_index(i, j)]

    @classmethod
    def of(cls, entries: Iterable[sp.Expr]) -> Inertia:
        """An inertia by its ten numbers: B₀, C and E, in the order of the fields."""
        mass, x, y, z, xx, yy, zz, xy, xz, yz = entries
        return cls(mass, (x, y, z), (xx, yy, zz, xy, xz, yz))

    @property
    def entries(self) -> list[sp.Expr]:
        """The ten numbers."""
        return [self.mass, *self.moment, *self.second]

    @property
    def values(self) -> dict[sp.Expr, sp.Expr]:
        """The inertia's numbers by the symbols that the Gibbs function of a link has for them."""
        return dict(zip((MASS, *MOMENT, *SECOND), self.entries, strict=True))

    def mapped(self, function: Callable[[sp.Expr], sp.Expr]) -> Inertia:
        """The inertia with a function applied to each of its ten numbers."""
        x, y, z = map(function, self.moment)
        xx, yy, zz, xy, xz, yz = map(function, self.second)
        return Inertia(function(self.mass), (x, y, z), (xx, yy, zz, xy, xz, yz))

    def plus(self, tape: Scalars, other: Inertia) -> Inertia:
        """Inertia of both bodies about their common point, in one frame."""
        return total(tape, [self, other])

    def rotated(self, tape: Scalars, rotation: Rotation) -> Inertia:
        """The same in another frame, to which `rotation` takes components: C' = RC, E' = RERᵀ."""
        if rotation.is_identity:
            return self
        return Inertia(
            self.mass, rotation.vector(tape, self.moment), self._second_rotated(tape, rotation)
        )

    def _second_rotated(self, tape: Scalars, rotation: Rotation) -> SecondMoments:
        r, (p, q) = rotation.axis, rotation.plane
        c, s = rotation.cos, rotation.sin
        pp, qq, pq = self.entry(p, p), self.entry(q, q), self.entry(p, q)
        pr, qr = rotation.turned(tape, self.entry(p, r), self.entry(q, r))
        turned = {_index(r, r): self.entry(r, r), _index(p, r): pr, _index(q, r): qr}
        if c == 0 or s == 0:  # A half or quarter turn only swaps and signs.
            turned[_index(p, p)] = pp if s == 0 else qq
            turned[_index(q, q)] = qq if s == 0 else pp
            turned[_index(p, q)] = pq if s == 0 else -pq
        else:
            # With w = s(E_pp − E_qq) + 2cE_pq the block takes four products instead of eight.
            w = tape.let(s * tape.let(pp - qq) + c * tape.let(2 * pq))
            turned[_index(p, p)] = tape.let(pp - s * w)
            turned[_index(q, q)] = tape.let(qq + s * w)
            turned[_index(p, q)] = tape.let(c * w - pq)
        xx, yy, zz, xy, xz, yz = (turned[i] for i in range(6))
        return (xx, yy, zz, xy, xz, yz)

    def shifted(self, tape: Scalars, arm: Vector) -> Inertia:
        """The inertia about another point: C' = C + B₀r and E' = E + rCᵀ + Crᵀ + B₀rrᵀ.

        `arm` is r, the old point from the new one (m).
        """
        if arm == ZERO:
            return self
        weight = tuple(tape.let(self.mass * r) for r in arm)
        moment = [tape.let(c + w) for c, w in zip(self.moment, weight, strict=True)]
        second = []
        for i, j in PAIRS:
            # On the diagonal r_i·(2C_i + w_i): doubled arms are parameters more often than not.
            if i == j:
                term = tape.let(2 * arm[i]) * self.moment[i] + arm[i] * weight[i]
            else:
                term = arm[i] * self.moment[j] + arm[j] * self.moment[i] + arm[i] * weight[j]
            second.append(tape.let(self.entry(i, j) + term))
        return Inertia.of([self.mass, *moment, *second])

    def response(self, tape: Scalars, direction: int) -> Wrench:
        """𝒮 and ℛ per unit of one acceleration: a column of the Hessian of the Gibbs function.

        `direction` is LINEAR or ANGULAR plus the axis.
        """
        column, values = link_mass_block().col(direction), self.values
        return Wrench.of(tape.let(evaluated(entry, values)) for entry in column)


NO_INERTIA = Inertia(sp.S.Zero, ZERO, (sp.S.Zero,) * 6)


def total(tape: Scalars, inertias: list[Inertia]) -> Inertia:
    """Inertia of several bodies about their common point, in one frame."""
    alike = zip(*(inertia.entries for inertia in inertias), strict=True)
    return Inertia.of(tape.let(sp.Add(*entries)) for entries in alike)


def _index(i: int, j: int) -> int:
    return PAIRS.index((min(i, j), max(i, j)))
