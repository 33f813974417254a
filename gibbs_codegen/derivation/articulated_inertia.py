"""What a segment feels of its subtree while the joints there are free: inertia, and Coriolis force.

Like the ten numbers of a rigid body the articulated inertia is a Gibbs function, ½aᵀÂa in
a = (r̈, ω̇), and moves by the same rules; but a free joint takes its direction out of it, so Â is
any symmetric 6×6 matrix.

With ẋ the velocity of a point against the origin of the coordinates, in axes that do not turn, and
ρ its place about a joint, the moments P = ∫ẋ dm and D = ∫ρẋᵀdm are to velocities what the first and
second moments are to places. Derivatives need their doubles alone, which cost no more: what is
doubled is a parameter, or a rate that others have doubled too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import sympy as sp

from gibbs_codegen.derivation.gibbs import evaluated, link_mass_block, skew
from gibbs_codegen.derivation.inertia import ANGULAR, LINEAR, PAIRS, Inertia
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars, times
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Rotation,
    Vector,
    Z,
    add,
    axis_vector,
    cross,
    scale,
)

Block = tuple[Vector, Vector, Vector]


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
        return self.of_entries(lambda i, j: tape.let(mine[i][j] + theirs[i][j]))

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
            return tape.let(rows[i][j] - tape.let(ratios[i] * column[j]))

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
        lever = skew(arm)
        old = self.coupling
        new = _block(
            lambda i, j: tape.let(
                old[i][j] - sp.Add(*(tape.let(self.linear[i][k] * lever[k, j]) for k in range(3)))
            )
        )

        def entry(i: int, j: int) -> sp.Expr:
            if i == j:
                gain = sp.Add(*(lever[i, k] * (old[k][i] + new[k][i]) for k in range(3)))
            else:  # Of J'_ij and J'_ji the shorter, since joints eliminate the last direction, z.
                k = 3 - i - j
                gain = lever[j, i] * (new[i][i] - old[j][j])
                gain += lever[j, k] * new[k][i] + lever[i, k] * old[k][j]
            return tape.let(self.angular[i][j] + gain)

        return ArticulatedInertia(self.linear, new, _symmetric(entry))


NO_ARTICULATED_INERTIA = ArticulatedInertia((ZERO,) * 3, (ZERO,) * 3, (ZERO,) * 3)


def _block(entry: Callable[[int, int], sp.Expr]) -> Block:
    x, y, z = ((entry(i, 0), entry(i, 1), entry(i, 2)) for i in range(3))
    return (x, y, z)


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
        w = tape.let(s * tape.let(pp - qq) + c * tape.let(pq + qp))
        sine, cosine = tape.let(s * w), tape.let(c * w)
        turned[p, p], turned[q, q] = tape.let(pp - sine), tape.let(qq + sine)
        turned[p, q], turned[q, p] = tape.let(cosine - qp), tape.let(cosine - pq)
    return _block(lambda i, j: turned[i, j])


@dataclass(frozen=True)
class Moments:
    """2P, and the rows of 2D about a point."""

    momentum: Vector
    rows: Block

    def plus(self, tape: Scalars, other: Moments) -> Moments:
        """Moments of both bodies about their common point, in one frame."""
        first, second, third = (
            add(tape, mine, its) for mine, its in zip(self.rows, other.rows, strict=True)
        )
        return Moments(add(tape, self.momentum, other.momentum), (first, second, third))

    def rotated(self, tape: Scalars, rotation: Rotation) -> Moments:
        """The same in another frame, to which `rotation` takes components: P' = RP, D' = RDRᵀ."""
        if rotation.is_identity:
            return self
        rows = rotated_block(tape, rotation, self.rows)
        return Moments(rotation.vector(tape, self.momentum), rows)

    def shifted(self, tape: Scalars, arm: Vector) -> Moments:
        """The moments about another point: D' = D + rPᵀ; r, `arm`, is the old from the new (m)."""
        first, second, third = (
            add(tape, row, scale(tape, r, self.momentum))
            for r, row in zip(arm, self.rows, strict=True)
        )
        return Moments(self.momentum, (first, second, third))


NO_MOMENTS = Moments(ZERO, (ZERO, ZERO, ZERO))


def link_moments(
    tape: Scalars, inertia: Inertia, omega: Vector, velocity: Vector, fixed: bool
) -> Moments:
    """Moments of one link about its joint: 2P = ω×2C + B₀2V, and row i of 2D is ω×2E_i + C_i2V.

    `velocity` is 2V, twice the velocity of the joint; `fixed` says that the inertia is of
    parameters alone, which are doubled for nothing.
    """
    rows = [tuple(inertia.entry(i, j) for j in range(3)) for i in range(3)]
    moment = inertia.moment
    if fixed:
        moment = scale(tape, sp.Integer(2), moment)
        rows = [scale(tape, sp.Integer(2), (x, y, z)) for x, y, z in rows]
    else:
        omega = scale(tape, sp.Integer(2), omega)
    momentum = add(tape, cross(tape, omega, moment), scale(tape, inertia.mass, velocity))
    first, second, third = (
        add(tape, cross(tape, omega, (x, y, z)), scale(tape, c, velocity))
        for (x, y, z), c in zip(rows, inertia.moment, strict=True)
    )
    return Moments(momentum, (first, second, third))


class JointVelocity(NamedTuple):
    """2V, twice the velocity of a joint against the origin (m/s).

    `before` is that of the point on the axis before the joint moves, in the segment's group frame,
    and `after` that of the segment's own point, in its working frame.
    """

    before: Vector
    after: Vector


def joint_velocities(
    tape: Scalars,
    tree: SegmentTree,
    before: Sequence[Motion],
    motions: Sequence[Motion],
    rates: Sequence[sp.Expr],
) -> list[JointVelocity]:
    """2V of all joints; `before` and `motions` are the segments' before and after joints move."""
    velocities = [JointVelocity(ZERO, ZERO)]
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"velocity of {segment.joint_name}"):
            parent = velocities[segment.parent].after
            velocity = after = _passed_out(
                tape, tree, k, (motions[segment.parent].omega, before[k].omega), parent
            )
            if segment.joint == "prismatic":
                after = add(tape, velocity, axis_vector(Z, tape.let(2 * rates[k])))
            if tree.works_in_own_frame(k):
                after = segment.rotation.inverse.vector(tape, after)
        velocities.append(JointVelocity(velocity, after))
    return velocities


def _passed_out(
    tape: Scalars, tree: SegmentTree, k: int, turning: tuple[Vector, Vector], velocity: Vector
) -> Vector:
    """2V of joint k ≥ 1 before it moves, in the group frame of segment k, from its parent's (m/s).

    `turning` is ω of the parent in its working frame and in that group frame (rad/s); `velocity` is
    2V of the parent in its working frame.
    """
    segment, two = tree.segments[k], sp.Integer(2)
    omega, omega_in_group = turning
    if not segment.starts_group:
        arm = tree.step_in_group(tape, k)
        return add(tape, velocity, cross(tape, scale(tape, two, omega), arm))
    omega = segment.turn.inverse.vector(tape, omega)
    velocity = segment.turn.inverse.vector(tape, velocity)
    velocity = add(tape, velocity, cross(tape, omega, scale(tape, two, segment.step)))
    velocity = segment.twist.inverse.vector(tape, velocity)
    along = axis_vector(Z, tape.let(2 * segment.d))
    return add(tape, velocity, cross(tape, omega_in_group, along))


def subtree_moments(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    velocities: Sequence[JointVelocity],
) -> list[Moments]:
    """Moments of each segment and all that it supports, about its joint in its group frame."""
    moments = [NO_MOMENTS for _ in tree.segments]
    for k in range(tree.joints, -1, -1):
        with tape.group(f"moments of velocity of {tree.subtree_about_joint(k)}"):
            fixed = tree.works_in_own_frame(k)
            inertia = tree.working_inertia(tape, k)
            own = link_moments(tape, inertia, motions[k].omega, velocities[k].after, fixed)
            for child in tree.children[k]:
                own = own.plus(tape, tree.passed_in(tape, child, moments[child]))
            moments[k] = tree.to_group_frame(tape, k, own)
    return moments
