"""Derivatives of the accelerations of a tree by articulated bodies, in O(n²), without M.

A change at a joint makes an additional acceleration and turning of all that it carries, which pass
outwards as accelerations do, from joint to joint; each gives way by its own equation. All else
feels a wrench on the parent. What that does there is known by reciprocity, from the accelerations
that a unit of each other joint's effort, or of a wrench on the root, makes at the parent:

    ∂θ̈_i/∂(change at j) = −(acceleration at j per unit of effort of i)·(wrench of the change at j)

So columns for wrenches on the root, for its angular velocity, for efforts, and for the changes of
coordinates and rates are carried outwards, a joint at a time, all of one kind one after the other.

*Turned at an additional rate ε*, a subtree feels a Coriolis force. Every point that moves with ẋ is
accelerated by 2ε×ẋ more. With P = ∫ẋdm and D = ∫ρẋᵀdm about a joint, that takes the force ε×2P and
the moment 2(tr D·1 − Dᵀ)ε: two 3×3 matrices, the velocity coupling, which move like a wrench with
three columns. Velocities are against that of the root's origin, the same for all links, so nothing
changes when the sum passes a joint; a free joint takes its direction out, as it does with the
articulated inertia.

*When a joint's coordinate changes*, nothing has moved for what it carries; but all of it turns at
an additional rate ε, and what would be at rest against the parent has an additional acceleration
ψ = (r̈, ω̇). In e, the joint's axis, which moves with ω, A and r̈ of the parent:

    revolute:   ε = ė = ω×e, ψ = (r̈×e + 2V×ė, ë) for the angle;  ε = e, ψ = (2V×e, 2ė) for its rate
    prismatic:  ε = 0, ψ = (ë, 0) for the travel;                 ε = 0, ψ = (2ė, 0) for its rate

with ë = Ae, and V the velocity of the joint against that of the root's origin, which the velocity
couplings count from. The parent feels a wrench: of ψ by the articulated inertia, of ε by the
coupling, of a spring or a damper by the joint's equation; and the wrench on what is carried is
turned or moved with it.

*Operational-space inertias* say how each segment gives way to a wrench on itself. The inverse Y of
the inertia that is felt there, all joints free, passes outwards from the root's. In a frame fixed
to the parent it only moves; a joint along s, with the ratios u of its equation and an inertia D,
gives the segment (1 − suᵀ)·Y·(1 − usᵀ) + ssᵀ/D.

*What a point sees* of a column, in axes that turn with its segment, follows from the same pair: at
a velocity V of the point against the root's origin its acceleration changes by 2ε×V more than that
of the column, and dω/dt by ω×ε less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import sympy as sp

from gibbs_codegen.derivation.articulated import (
    ArticulatedBody,
    Articulation,
    JointAcceleration,
    SolvedJoint,
    root_turn,
)
from gibbs_codegen.derivation.inertia import NO_COUPLING, ArticulatedInertia, VelocityCoupling
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.parameters import PassiveSymbols
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector, times
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Rotation,
    Transform,
    Z,
    axis_vector,
    minus,
    moved,
)

Rows = Sequence[Values]
# Joints inboard of a joint, on average, beyond which its parent's inertia is taken to be shorter.
# The operations are not counted: near the limit both ways take about as many.
_FEW = 6


def inertia_is_shorter(tree: SegmentTree) -> bool:
    """True if operational-space inertias are likely to take fewer operations.

    That is estimated from how many joints are inboard of a joint; neither way is counted.
    """
    return sum(len(tree.path(k)) - 2 for k in range(1, len(tree.segments))) > _FEW * tree.joints


def passed_out(tape: Scalars, inverse: ArticulatedInertia, transform: Transform) -> Rows:
    """Y of a segment at a child's joint: rows in the child's working frame, r̈ first.

    An acceleration (ω̇, r̈) moves outwards as a wrench (force, moment) moves inwards; so does Y,
    with ω̇ before r̈. `transform` takes what is in the child's working frame to the segment's.
    """
    steps = [
        step.inverse if isinstance(step, Rotation) else minus(step) for step in reversed(transform)
    ]
    return _other_half_first(moved(tape, inverse, steps).rows).rows


def response(tape: Scalars, rows: Rows, wrench: Values) -> Acceleration:
    """A parent's acceleration at a joint that takes a wrench from it; rows as of `passed_out`."""
    return Acceleration.of([-tape.sum_of_products(row, wrench) for row in rows])


def with_joint(tape: Scalars, joint: SolvedJoint, rows: Rows) -> ArticulatedInertia:
    """Accelerations of a segment per unit of wrench, ω̇ first, from the parent's at the joint."""
    direction, ratios = joint.direction, joint.ratios
    rest = [sp.S.Zero if i == direction else ratio for i, ratio in enumerate(ratios)]
    left = tape.let(times(joint.armature, joint.lightness))  # 1 − u_d, which would cancel.
    along = [
        tape.let(times(left, row[direction]) - tape.sum_of_products(row, rest)) for row in rows
    ]
    other = [sp.S.Zero if i == direction else entry for i, entry in enumerate(along)]
    squares = times(left, along[direction]) - tape.sum_of_products(rest, other)
    diagonal = tape.let(squares + joint.lightness)

    def entry(i: int, j: int) -> sp.Expr:
        if i == j == direction:
            return diagonal
        if direction in (i, j):
            return along[j if i == direction else i]
        return rows[i][j]

    return _other_half_first(ArticulatedInertia.of_entries(entry).rows)


def _other_half_first(rows: Rows) -> ArticulatedInertia:
    """A symmetric matrix with ω̇ before r̈, or back."""
    return ArticulatedInertia.of_entries(lambda i, j: rows[(i + 3) % 6][(j + 3) % 6])


def doubled_velocities(
    tape: Scalars, articulation: Articulation, motions: Sequence[Motion], rates: Values
) -> list[Acceleration]:
    """2V and 2ω of every segment's joint against the root's origin, in its working frame.

    Those of the root are where its system is solved. `motions` are in the working frames too.
    """
    tree = articulation.tree
    turn = root_turn(tree).inverse
    twice = [Acceleration(ZERO, tape.scale(sp.Integer(2), turn.vector(tape, motions[0].omega)))]
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"velocity of {segment.joint_name}"):
            there = twice[segment.parent].passed_out(tape, articulation.transforms[k - 1])
            linear = there.linear
            if segment.joint == "prismatic":
                linear = tape.add(linear, axis_vector(Z, tape.let(2 * rates[k - 1])))
            twice.append(Acceleration(linear, tape.scale(sp.Integer(2), motions[k].omega)))
    return twice


def couplings_inward(
    tape: Scalars, articulation: Articulation, doubled: Sequence[Acceleration]
) -> tuple[VelocityCoupling, list[tuple[VelocityCoupling, Vector]]]:
    """Velocity couplings of all subtrees, from the leaves inwards.

    The first is that of the whole tree where the root's system is solved; then comes for each joint
    after the root, in the segment's working frame, what the parent feels, with the ratios of the
    joint's acceleration to −ε. `doubled` is as of `doubled_velocities`.
    """
    tree = articulation.tree
    received = [NO_COUPLING for _ in tree.segments]
    felt: list[tuple[VelocityCoupling, Vector]] = []
    for k in range(tree.joints, -1, -1):
        with tape.group(f"velocity coupling of {tree.subtree_about_joint(k)}"):
            inertia = tree.working_inertia(tape, k)
            if k == 0:
                inertia = inertia.rotated(tape, root_turn(tree).inverse)
            twice = doubled[k]
            rigid = VelocityCoupling.rigid(tape, inertia, twice.angular, twice.linear)
            whole = rigid.plus(tape, received[k])
            if k == 0:
                break
            joint, parent = articulation.joints[k - 1], tree.segments[k].parent
            ratios = tape.scale(joint.lightness, whole.rows[joint.direction])
            left = tape.scale(joint.armature, ratios)
            freed = whole.without(tape, joint.direction, joint.ratios, left)
            felt.insert(0, (freed, ratios))
            passed = moved(tape, freed, articulation.transforms[k - 1])
            received[parent] = received[parent].plus(tape, passed)
    return whole, felt


_E = axis_vector(Z)
_NO_WRENCH = [sp.S.Zero] * 6


Kind = Literal["wrench", "turning", "effort", "coordinate", "rate"]
# The variable of a column: a component 0 … 5 of a wrench on the root, or 0 … 2 of its angular
# velocity; or a joint, by the index of its segment.
Key = tuple[Kind, int]
_KINDS = get_args(Kind)


@dataclass(frozen=True)
class Perturbation:
    """A change at a joint, per unit, in the working frame of the joint's segment.

    `acceleration` is ψ and `turning` is ε; `effort` is what a spring or a damper adds to the joint,
    and `wrench` what the parent feels of it all, about the joint.
    """

    acceleration: Acceleration
    turning: Vector
    effort: sp.Expr
    wrench: list[sp.Expr]


@dataclass(frozen=True)
class JointPerturbations:
    """The changes of a joint's "coordinate" and of its "rate"; and ratios of its equation to ε."""

    changes: dict[Kind, Perturbation]
    turning_ratios: Vector


def convected_perturbations(
    tape: Scalars,
    articulation: Articulation,
    motions: Sequence[Motion],
    rates: Values,
    accelerations: Sequence[JointAcceleration],
    passive: Sequence[PassiveSymbols],
) -> tuple[VelocityCoupling, list[JointPerturbations]]:
    """Velocity coupling of the whole tree, and the changes of the joints after the root.

    The coupling is where the root's system is solved. `motions` are what the rates alone make of
    the segments, in their working frames; `accelerations` are as of `accelerations_outward`.
    """
    doubled = doubled_velocities(tape, articulation, motions, rates)
    whole, couplings = couplings_inward(tape, articulation, doubled)
    perturbations = []
    for k, segment in enumerate(articulation.tree.segments[1:], start=1):
        coupling, ratios = couplings[k - 1]
        joint, felt = articulation.joints[k - 1], articulation.felt[k - 1]
        carried, forces = accelerations[k - 1].carried, passive[k - 1]
        is_revolute = segment.joint == "revolute"
        with tape.group(f"changes of {segment.joint_name} and of its rate"):
            angle, rate = _changes(tape, is_revolute, motions[k], doubled[k], carried)
            # What moves with the coordinate of the wrench on all that the joint carries: a revolute
            # joint turns the wrench; otherwise its point moves.
            wrench = []
            for row, p in zip(felt.inertia.rows, felt.load.entries, strict=True):
                pairs = zip(row, carried.entries, strict=True)
                wrench.append(tape.let(sp.Add(*(tape.let(times(e, a)) for e, a in pairs)) - p))
            (f_x, f_y, _, n_x, n_y, _), zero = wrench, sp.S.Zero
            moving = [-f_y, f_x, zero, -n_y, n_x, zero]
            if not is_revolute:
                moving = [zero, zero, zero, -f_y, f_x, zero]
            parts = (joint, felt, coupling)
            changes: dict[Kind, Perturbation] = {
                "coordinate": _perturbation(tape, *parts, *angle, -forces.stiffness, moving),
                "rate": _perturbation(tape, *parts, *rate, -forces.damping, _NO_WRENCH),
            }
            perturbations.append(JointPerturbations(changes, ratios))
    return whole, perturbations


def _changes(
    tape: Scalars, is_revolute: bool, motion: Motion, doubled: Acceleration, carried: Acceleration
) -> list[tuple[Acceleration, Vector]]:
    """ψ and ε for the coordinate of a joint, and for its rate.

    `motion` is what the rates alone make of the segment, `doubled` 2V and 2ω of the joint, and
    `carried` what the accelerations add, the joint's own left out; all in one frame.
    """

    def axis_acceleration() -> Vector:  # ë = Ae, with what the accelerations add to A.
        return tape.add(motion.gradient[Z], tape.cross(carried.angular, _E))

    (x, y, _), (twice_x, twice_y, _) = motion.omega, doubled.angular
    turning, twice_turning = (y, -x, sp.S.Zero), (twice_y, -twice_x, sp.S.Zero)
    if not is_revolute:
        travel = Acceleration(axis_acceleration(), ZERO)
        return [(travel, ZERO), (Acceleration(twice_turning, ZERO), ZERO)]
    acceleration = tape.add(motion.acceleration, carried.linear)
    linear = tape.add(tape.cross(acceleration, _E), tape.cross(doubled.linear, turning))
    angle = Acceleration(linear, axis_acceleration())
    rate = Acceleration(tape.cross(doubled.linear, _E), twice_turning)
    return [(angle, turning), (rate, _E)]


def _perturbation(
    tape: Scalars,
    joint: SolvedJoint,
    felt: ArticulatedBody,
    coupling: VelocityCoupling,
    acceleration: Acceleration,
    turning: Vector,
    effort: sp.Expr,
    moving: Values,
) -> Perturbation:
    """A change with the wrench that the parent feels of it; `acceleration` is ψ, `turning` is ε.

    `effort` is what a spring or a damper adds to the joint, `moving` what moves with it of the
    wrench.
    """
    change = [*acceleration.entries, *turning, effort]
    six = zip(felt.inertia.rows, coupling.rows, joint.ratios, moving, strict=True)
    wrench = []
    for inertia, row, ratio, part in six:
        pairs = zip([*inertia, *row, ratio], change, strict=True)
        wrench.append(tape.let(sp.Add(*(tape.let(times(e, c)) for e, c in pairs), part)))
    return Perturbation(acceleration, turning, effort, wrench)


@dataclass(frozen=True)
class SeenPoint:
    """A place on a segment, in its working frame, or of the root where its system is solved.

    `doubled` is twice its velocity against the root's origin, `omega` that of the segment, both in
    that frame; `turn` maps components there to the axes of the point's components.
    """

    segment: int
    place: Vector
    doubled: Vector
    omega: Vector
    turn: Rotation = NO_ROTATION


@dataclass(frozen=True)
class _Carried:
    """Effect of a column on a segment, in its working frame: an acceleration and a turning ε."""

    acceleration: Acceleration
    turning: Vector = ZERO


class ArticulatedDerivatives:
    """Columns of a tree: the effect of each wrench, effort or change on all accelerations.

    Where the root's angular velocity ω changes by ε, the column has what that adds to the
    acceleration of a root which turns at the rate ε besides: dω/dt changes by ω×ε less.
    """

    def __init__(
        self,
        tape: Scalars,
        articulation: Articulation,
        coupling: VelocityCoupling,
        changes: Sequence[JointPerturbations],
        by_inertia: bool,
        seen: Sequence[SeenPoint] = (),
    ) -> None:
        """Derive all columns, with `coupling` of the whole tree and the `changes` of the joints.

        Columns go on with the accelerations of the points `seen`, in axes that turn with them.

        `by_inertia`: whether what a change does to the parent itself is found by the parent's
        operational-space inertia; otherwise outwards from the root.
        """
        self._tape, self._articulation, self._tree = tape, articulation, articulation.tree
        self._changes, self._by_inertia, self._seen = changes, by_inertia, seen
        self._root: dict[Key, list[sp.Expr]] = {}
        self._joints: dict[tuple[Key, int], sp.Expr] = {}
        self._at: list[dict[Key, _Carried]] = [{}]
        with tape.group("responses of the base to wrenches and to its angular velocity"):
            units = [[sp.Integer(i == c) for i in range(6)] for c in range(6)]
            solved = self._articulation.root_responses(tape, units)
            inverse = [[solved[max(i, j)][min(i, j)] for j in range(6)] for i in range(6)]
            for c, column in enumerate(inverse):
                self._root["wrench", c] = column
                self._at[0]["wrench", c] = _Carried(Acceleration.of(column))
            for c in range(3):
                load = [row[c] for row in coupling.rows]
                column = [-tape.sum_of_products(row, load) for row in inverse]
                self._root["turning", c] = column
                self._at[0]["turning", c] = _Carried(Acceleration.of(column), axis_vector(c))
            self._inertias = [_other_half_first(inverse)]
        for k in range(1, len(self._tree.segments)):
            self._pass_joint(k)
        for k in range(1, len(self._tree.segments)):
            segment = self._tree.segments[k]
            related = {*self._tree.path(k), *self._tree.subtree(k)}
            for i in range(1, len(self._tree.segments)):
                if i not in related:
                    with tape.group(f"response of {segment.joint_name} to other branches"):
                        there = self._reached(segment.parent, ("effort", i))
                        arriving = there.passed_out(tape, self._transform(k))
                        self._receive(k, ("effort", i), arriving)
                        self._push(k, ("effort", i), arriving, ZERO)

    def column(self, kind: Kind, number: int) -> Values:
        """Accelerations by a component of a root's wrench or turning, or by something of a joint.

        The component is where the root's system is solved; effort, coordinate and rate are by the
        index of the joint's segment.
        """
        key, zero = (kind, number), sp.S.Zero
        joints = range(1, len(self._tree.segments))
        column = [*self._root[key], *(self._joints.get((key, i), zero) for i in joints)]
        return column + [entry for point in self._seen for entry in self._at_point(point, key)]

    def _at_point(self, point: SeenPoint, key: Key) -> Values:
        """Effect of a column on a point, in axes that turn with it."""
        tape, k = self._tape, point.segment
        with tape.group("accelerations of points, column by column"):
            reached = self._reached(k, key).passed_out(tape, [point.place])
            turning = self._at[k][key].turning if key in self._at[k] else ZERO
            linear = tape.add(reached.linear, tape.cross(turning, point.doubled))
            angular = tape.add(reached.angular, tape.cross(turning, point.omega))
            return Acceleration(linear, angular).rotated(tape, point.turn).entries

    def by_wrench(self, k: int, wrench: Values) -> Values:
        """Accelerations by a wrench (6) on segment k ≥ 1, about its joint in its working frame."""
        tape = self._tape
        keys: list[Key] = [("wrench", c) for c in range(6)]
        keys += [("effort", i) for i in range(1, len(self._tree.segments))]
        return [tape.sum_of_products(self._reached(k, key).entries, wrench) for key in keys]

    def _pass_joint(self, k: int) -> None:
        """Carry all columns of the parent over a joint, and begin those of the joint."""
        tape, segment, transform = self._tape, self._tree.segments[k], self._transform(k)
        name, at_parent = segment.joint_name, self._at[segment.parent]
        before = dict(sorted(at_parent.items(), key=lambda item: _KINDS.index(item[0][0])))
        self._at.append({})
        with tape.group(f"turning of what {name} carries"):
            turning = {key: column.turning for key, column in before.items()}
            for key in turning:
                for step in reversed(transform):
                    if isinstance(step, Rotation):
                        turning[key] = step.inverse.vector(tape, turning[key])
            for vector in turning.values():
                self._share(k, vector)
        for key, column in before.items():
            with tape.group(f"response of {name} to what is before it"):
                arriving = column.acceleration.passed_out(tape, transform)
                if key[0] in ("wrench", "effort"):
                    self._receive(k, key, arriving)
                self._push(k, key, arriving, turning[key])
        # Effects of an effort at the joint and of its changes on the parent, with ψ of the changes.
        with tape.group(f"responses to {name}, at its parent"):
            joint, changes = self._articulation.joints[k - 1], self._changes[k - 1].changes
            wrenches: dict[Kind, Values] = {"effort": joint.ratios}
            wrenches |= {kind: change.wrench for kind, change in changes.items()}
            if self._by_inertia:
                rows = passed_out(tape, self._inertias[segment.parent], transform)
                begun = {kind: response(tape, rows, wrench) for kind, wrench in wrenches.items()}
                self._inertias.append(with_joint(tape, joint, rows))
            else:
                begun = {
                    kind: self._reached(segment.parent, (kind, k)).passed_out(tape, transform)
                    for kind in wrenches
                }
            for kind, change in changes.items():
                begun[kind] = begun[kind].plus(tape, change.acceleration)
        with tape.group(f"responses of {name} to itself"):
            self._push(k, ("effort", k), begun["effort"], ZERO, sp.S.One)
            for kind, change in changes.items():
                self._push(k, (kind, k), begun[kind], change.turning, change.effort)

    def _push(
        self, k: int, key: Key, arriving: Acceleration, turning: Vector, effort: sp.Expr = sp.S.Zero
    ) -> None:
        """Let joint k give way to a column.

        `arriving` is what it does to the parent, at the joint in the segment's working frame,
        `turning` ε of what is carried, there too, and `effort` what it adds to the joint's.
        """
        tape, joint = self._tape, self._articulation.joints[k - 1]
        share = tape.let(times(effort, joint.lightness) + self._share(k, turning))
        # The results of `SolvedJoint.accelerated`, in lines that are the same for all columns.
        direction, entries = joint.direction, arriving.entries
        factors = [-ratio for ratio in joint.ratios]
        if joint.armature == 0:
            factors[direction] = sp.S.Zero
        relative = total = tape.sum_of_products(factors, entries, share)
        if joint.armature != 0:
            entries[direction] = tape.let(entries[direction] + relative)
        else:
            relative = tape.let(total - entries[direction])
            entries[direction] = total
        self._at[k][key] = _Carried(Acceleration.of(entries), turning)
        self._joints.setdefault((key, k), relative)
        if key[0] == "effort":
            self._joints.setdefault((("effort", k), key[1]), relative)
        if key[0] == "wrench":
            self._root.setdefault(("effort", k), []).append(relative)

    def _share(self, k: int, turning: Vector) -> sp.Expr:
        """Acceleration by which a joint gives way to a turning of its subtree."""
        return -self._tape.dot(self._changes[k - 1].turning_ratios, turning)

    def _receive(self, k: int, key: Key, arriving: Acceleration) -> None:
        """Effect of changes at joint k on the cause of a column, by reciprocity.

        `arriving` is what the column does to the parent, at the joint in the segment's working
        frame.
        """
        for kind, change in self._changes[k - 1].changes.items():
            entry = -self._tape.sum_of_products(arriving.entries, change.wrench)
            if key[0] == "wrench":
                self._root.setdefault((kind, k), []).append(entry)
            else:
                self._joints[(kind, k), key[1]] = entry

    def _reached(self, k: int, key: Key) -> Acceleration:
        """Effect of a column on a segment that it is not carried to, by that on the joints.

        It is in the segment's working frame, or where the root's system is solved.
        """
        if key in self._at[k]:
            return self._at[k][key].acceleration
        if k == 0:
            return Acceleration.of(self._root[key])
        segment, tape = self._tree.segments[k], self._tape
        entries = self._reached(segment.parent, key).passed_out(tape, self._transform(k)).entries
        entries[segment.direction] = tape.let(entries[segment.direction] + self._joints[key, k])
        return Acceleration.of(entries)

    def _transform(self, k: int) -> Transform:
        return self._articulation.transforms[k - 1]
