"""Inertias and moments of velocity: all of them are rotated, shifted and added alike.

Seen from its parent, a link is a Gibbs function in the parent's accelerations with other B's. That
one rule serves the composites of the mass matrix, the merging of the rigid base arms, and
regrouping.

What a segment feels of its subtree while the joints there are free is an *articulated inertia*. It
is a Gibbs function too, ½aᵀÂa in a = (r̈, ω̇), and moves by the same rules; but a free joint takes
its direction out of it, so Â is any symmetric 6×6 matrix.

With ẋ the velocity of a point against the origin of the coordinates, in axes that do not turn, and
ρ its place about a joint, the moments P = ∫ẋ dm and D = ∫ρẋᵀdm are to velocities what the first and
second moments are to places. Derivatives need their doubles alone, which cost no more: what is
doubled is a parameter, or a rate that others have doubled too. A *velocity coupling* is the
Coriolis force of a body that turns at an additional rate ε: the force ε×2P and the moment
2(tr D·1 − Dᵀ)ε, two matrices from which a free joint takes its direction out as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.gibbs import MASS, MOMENT, SECOND, evaluated, link_mass_block, skew
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector, negated, plus, times
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, Wrench

# Places at which r̈ and ω̇ begin among the accelerations of a link.
LINEAR, ANGULAR = 0, 3

# Rows and columns of the entries of a symmetric matrix, in the order of robot files.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

SecondMoments = tuple[sp.Expr, ...]
Block = tuple[Vector, ...]


@dataclass(frozen=True)
class Inertia:
    """Mass B₀, first moment C and second moments E (xx, yy, zz, xy, xz, yz) about a point."""

    mass: sp.Expr
    moment: Vector
    second: SecondMoments

    def entry(self, i: int, j: int) -> sp.Expr:
        """E_ij (kg m²), i and j from 0."""
        return self.second[_index(i, j)]

    def row(self, i: int) -> Vector:
        """Row i of E (kg m²), from 0."""
        return tuple(self.entry(i, j) for j in range(3))

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
        moment = rotation.vector(tape, self.moment)
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
            along, across = tape.less(pp, qq), tape.let(times(sp.Integer(2), pq))
            w = tape.let(plus(times(s, along), times(c, across)))
            turned[_index(p, p)] = tape.less(pp, times(s, w))
            turned[_index(q, q)] = tape.let(plus(qq, times(s, w)))
            turned[_index(p, q)] = tape.less(times(c, w), pq)
        return Inertia(self.mass, moment, tuple(turned[i] for i in range(6)))

    def shifted(self, tape: Scalars, arm: Vector) -> Inertia:
        """The inertia about another point: C' = C + B₀r and E' = E + rCᵀ + Crᵀ + B₀rrᵀ.

        `arm` is r, the old point from the new one (m).
        """
        if arm == ZERO:
            return self
        weight = tuple(tape.let(times(self.mass, r)) for r in arm)
        moment = [tape.let(plus(c, w)) for c, w in zip(self.moment, weight, strict=True)]
        second = []
        for i, j in PAIRS:
            # On the diagonal r_i·(2C_i + w_i): doubled arms are parameters more often than not.
            if i == j:
                twice = tape.let(times(sp.Integer(2), arm[i]))
                terms = [times(twice, self.moment[i])]
            else:
                terms = [times(arm[i], self.moment[j]), times(arm[j], self.moment[i])]
            terms += [self.entry(i, j), times(arm[i], weight[j])]
            second.append(tape.let(plus(*terms)))
        return Inertia.of([self.mass, *moment, *second])

    def response(self, tape: Scalars, direction: int) -> Wrench:
        """𝒮 and ℛ per unit of one acceleration: a column of the Hessian of the Gibbs function.

        `direction` is LINEAR or ANGULAR plus the axis.
        """
        column, values = link_mass_block().col(direction), self.values
        return Wrench.of(tape.let(evaluated(entry, values)) for entry in column)


def about_z(moment: sp.Expr) -> Inertia:
    """A moment of inertia about z alone (kg m²), without mass."""
    half, zero = moment / 2, sp.S.Zero
    return Inertia(zero, ZERO, (half, half, -half, zero, zero, zero))


NO_INERTIA = Inertia(sp.S.Zero, ZERO, (sp.S.Zero,) * 6)


def total(tape: Scalars, inertias: list[Inertia]) -> Inertia:
    """Inertia of several bodies about their common point, in one frame."""
    alike = zip(*(inertia.entries for inertia in inertias), strict=True)
    return Inertia.of(tape.let(plus(*entries)) for entries in alike)


def _index(i: int, j: int) -> int:
    return PAIRS.index((min(i, j), max(i, j)))


def _block(entry: Callable[[int, int], sp.Expr]) -> Block:
    return tuple(tuple(entry(i, j) for j in range(3)) for i in range(3))


def _symmetric(entry: Callable[[int, int], sp.Expr]) -> Block:
    entries = {(i, j): entry(i, j) for i, j in PAIRS}
    return _block(lambda i, j: entries[min(i, j), max(i, j)])


def rotated_block(tape: Scalars, rotation: Rotation, block: Block) -> Block:
    """RMRᵀ: a 3×3 matrix, of any symmetry, where `rotation` takes components."""
    r, (p, q) = rotation.axis, rotation.plane
    c, s = rotation.cos, rotation.sin
    pp, pq, qp, qq = block[p][p], block[p][q], block[q][p], block[q][q]
    turned = {(r, r): block[r][r]}
    turned[r, p], turned[r, q] = rotation.turned(tape, block[r][p], block[r][q])
    turned[p, r], turned[q, r] = rotation.turned(tape, block[p][r], block[q][r])
    if c == 0:  # A quarter turn swaps and signs, a half turn leaves the rest as it is.
        turned |= {(p, p): qq, (q, q): pp, (p, q): -qp, (q, p): -pq}
    elif s == 0:
        turned |= {(p, p): pp, (q, q): qq, (p, q): pq, (q, p): qp}
    else:
        # With w = s(M_pp − M_qq) + c(M_pq + M_qp) it takes four products instead of sixteen.
        along, across = tape.less(pp, qq), tape.let(plus(pq, qp))
        w = tape.let(plus(times(s, along), times(c, across)))
        sine, cosine = tape.let(times(s, w)), tape.let(times(c, w))
        turned[p, p], turned[q, q] = tape.less(pp, sine), tape.let(plus(qq, sine))
        turned[p, q], turned[q, p] = tape.less(cosine, qp), tape.less(cosine, pq)
    return _block(lambda i, j: turned[i, j])


@dataclass(frozen=True)
class ArticulatedInertia:
    """The blocks of Â by rows: r̈ with r̈, r̈ with ω̇, ω̇ with ω̇."""

    linear: Block
    coupling: Block
    angular: Block

    @classmethod
    def rigid(cls, tape: Scalars, inertia: Inertia) -> ArticulatedInertia:
        """Â of a rigid body: the Hessian of its Gibbs function (eq. 2)."""
        hessian, values = link_mass_block(), inertia.values
        return cls.of_entries(lambda i, j: tape.let(evaluated(hessian[i, j], values)))

    @classmethod
    def of_entries(cls, entry: Callable[[int, int], sp.Expr]) -> ArticulatedInertia:
        """The symmetric Â by its entries (i, j ≥ i), 0 … 5; r̈ comes before ω̇."""
        return cls(
            _symmetric(lambda i, j: entry(LINEAR + i, LINEAR + j)),
            _block(lambda i, j: entry(LINEAR + i, ANGULAR + j)),
            _symmetric(lambda i, j: entry(ANGULAR + i, ANGULAR + j)),
        )

    @property
    def rows(self) -> list[list[sp.Expr]]:
        """The whole matrix."""
        upper = [[*self.linear[i], *self.coupling[i]] for i in range(3)]
        transposed = zip(*self.coupling, strict=True)
        return upper + [[*c, *a] for c, a in zip(transposed, self.angular, strict=True)]

    def plus(self, tape: Scalars, other: ArticulatedInertia) -> ArticulatedInertia:
        """The sum of two Â about one point, in one frame."""
        mine, theirs = self.rows, other.rows
        return self.of_entries(lambda i, j: tape.let(plus(mine[i][j], theirs[i][j])))

    def without(
        self,
        tape: Scalars,
        direction: int,
        ratios: tuple[sp.Expr, ...],
        armature: sp.Expr = sp.S.Zero,
    ) -> ArticulatedInertia:
        """Â − U·Uᵀ/D, with one direction, 0 … 5, eliminated: the Schur complement without armature.

        `ratios` are U/D, column U of the direction over its pivot D, which includes the armature.
        In row and column of the direction that is U − U(D − J)/D, which cancels where the armature
        J is little; UJ/D is the same to the last digit, and zero without armature.
        """
        rows = self.rows
        column = rows[direction]

        def entry(i: int, j: int) -> sp.Expr:
            if direction in (i, j):
                return tape.let(times(armature, ratios[j if i == direction else i]))
            return tape.less(rows[i][j], tape.let(times(ratios[i], column[j])))

        return self.of_entries(entry)

    def rotated(self, tape: Scalars, rotation: Rotation) -> ArticulatedInertia:
        """Â in another frame, to which `rotation` takes components: each block M is RMRᵀ there."""
        if rotation.is_identity:
            return self
        linear, coupling, angular = (
            rotated_block(tape, rotation, block)
            for block in (self.linear, self.coupling, self.angular)
        )
        return ArticulatedInertia(linear, coupling, angular)

    def shifted(self, tape: Scalars, arm: Vector) -> ArticulatedInertia:
        """Â about another point: with H the coupling, H' = H − Lr̃ and J' = J + r̃H' + (r̃H)ᵀ.

        `arm` is r, the old point from the new one (m).
        """
        if arm == ZERO:
            return self
        lever, old = skew(arm).tolist(), self.coupling

        def moved(i: int, j: int) -> sp.Expr:
            shares = [tape.let(times(self.linear[i][k], lever[k][j])) for k in range(3)]
            return tape.less(old[i][j], *shares)

        new = _block(moved)

        def entry(i: int, j: int) -> sp.Expr:
            if i == j:
                gain = [times(lever[i][k], plus(old[k][i], new[k][i])) for k in range(3)]
            else:  # The shorter of J'_ij and J'_ji, since joints eliminate the last direction, z.
                k = 3 - i - j
                gain = [times(lever[j][i], plus(new[i][i], negated(old[j][j])))]
                gain += [times(lever[j][k], new[k][i]), times(lever[i][k], old[k][j])]
            return tape.let(plus(self.angular[i][j], *gain))

        return ArticulatedInertia(self.linear, new, _symmetric(entry))


NO_ARTICULATED_INERTIA = ArticulatedInertia((ZERO,) * 3, (ZERO,) * 3, (ZERO,) * 3)


@dataclass(frozen=True)
class Moments:
    """2P, and the rows of 2D about a point."""

    momentum: Vector
    rows: Block

    def plus(self, tape: Scalars, other: Moments) -> Moments:
        """Moments of both bodies about their common point, in one frame."""
        rows = [tape.add(mine, its) for mine, its in zip(self.rows, other.rows, strict=True)]
        return Moments(tape.add(self.momentum, other.momentum), tuple(rows))

    def rotated(self, tape: Scalars, rotation: Rotation) -> Moments:
        """The same in another frame, to which `rotation` takes components: P' = RP, D' = RDRᵀ."""
        if rotation.is_identity:
            return self
        rows = rotated_block(tape, rotation, self.rows)
        return Moments(rotation.vector(tape, self.momentum), rows)

    def shifted(self, tape: Scalars, arm: Vector) -> Moments:
        """The moments about another point: D' = D + rPᵀ; r, `arm`, is the old from the new (m)."""
        first, second, third = (
            tape.add(row, tape.scale(r, self.momentum))
            for r, row in zip(arm, self.rows, strict=True)
        )
        return Moments(self.momentum, (first, second, third))


NO_MOMENTS = Moments(ZERO, (ZERO, ZERO, ZERO))


@dataclass(frozen=True)
class VelocityCoupling:
    """The matrices by rows: force and moment for a rate ε."""

    force: Block
    moment: Block

    @classmethod
    def rigid(
        cls, tape: Scalars, inertia: Inertia, omega: Vector, velocity: Vector
    ) -> VelocityCoupling:
        """A rigid body's about a point; `omega` and `velocity` are twice its ω and the point's."""
        first = inertia.moment
        x, y, z = tape.add(tape.cross(omega, first), tape.scale(inertia.mass, velocity))
        spins = [tape.cross(omega, inertia.row(i)) for i in range(3)]
        d = [tape.add(spins[i], tape.scale(first[i], velocity)) for i in range(3)]

        def entry(i: int, j: int) -> sp.Expr:
            if i != j:
                return -d[j][i]
            return tape.let(d[i - 2][i - 2] + d[i - 1][i - 1])

        zero = sp.S.Zero
        return cls(((zero, z, -y), (-z, zero, x), (y, -x, zero)), _block(entry))

    @classmethod
    def of(cls, rows: Sequence[Vector]) -> VelocityCoupling:
        """The coupling by its six rows."""
        return cls(tuple(rows[:3]), tuple(rows[3:]))

    @property
    def rows(self) -> list[Vector]:
        """All six rows."""
        return [*self.force, *self.moment]

    def plus(self, tape: Scalars, other: VelocityCoupling) -> VelocityCoupling:
        """The sum of both, about one point, in one frame."""
        return self.of([tape.add(a, b) for a, b in zip(self.rows, other.rows, strict=True)])

    def rotated(self, tape: Scalars, rotation: Rotation) -> VelocityCoupling:
        """The same in another frame, to which `rotation` takes components."""
        if rotation.is_identity:
            return self
        return VelocityCoupling(
            rotated_block(tape, rotation, self.force), rotated_block(tape, rotation, self.moment)
        )

    def shifted(self, tape: Scalars, arm: Vector) -> VelocityCoupling:
        """The same about another point; `arm` is the old point from the new one (m)."""
        if arm == ZERO:
            return self
        force, moment = self.force, self.moment

        def entry(i: int, j: int) -> sp.Expr:
            gain = times(arm[i - 2], force[i - 1][j]) - times(arm[i - 1], force[i - 2][j])
            return tape.let(moment[i][j] + gain)

        return VelocityCoupling(force, _block(entry))

    def without(
        self, tape: Scalars, direction: int, ratios: Values, left: Vector
    ) -> VelocityCoupling:
        """The inertia that the parent feels while a joint, of direction 0 … 5, is free.

        `ratios` are those of its solved equation, row by row. `left` is what is left of the joint's
        own row, zero without armature: written as a difference it would cancel.
        """
        joint_row = self.rows[direction]
        return self.of(
            [
                left if i == direction else tape.add(row, tape.scale(-ratio, joint_row))
                for i, (row, ratio) in enumerate(zip(self.rows, ratios, strict=True))
            ]
        )


NO_COUPLING = VelocityCoupling((ZERO,) * 3, (ZERO,) * 3)
