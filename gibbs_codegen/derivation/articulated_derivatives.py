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
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import AccelerationColumn, sum_of_products
from gibbs_codegen.derivation.articulated import (
    ArticulatedBody,
    Articulation,
    JointAcceleration,
    SolvedJoint,
    root_turn,
)
from gibbs_codegen.derivation.articulated_inertia import ArticulatedInertia, Block, rotated_block
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.operational_inertia import passed_out, response, with_joint
from gibbs_codegen.derivation.parameters import PassiveSymbols
from gibbs_codegen.symbolic.tape import Scalars, times
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Rotation,
    Transform,
    Vector,
    Z,
    add,
    axis_vector,
    cross,
    dot,
    moved,
    scale,
)


@dataclass(frozen=True)
class VelocityCoupling:
    """The matrices by rows: force and moment for a rate ε."""

    force: Block
    moment: Block

    @classmethod
    def rigid(
        cls, tape: Scalars, inertia: Inertia, omega: Vector, velocity: Vector
    ) -> VelocityCoupling:
        """Of a rigid body about a point; `omega` and `velocity` are twice its ω and the point's."""
        first = inertia.moment
        x, y, z = add(tape, cross(tape, omega, first), scale(tape, inertia.mass, velocity))
        spins = [cross(tape, omega, _row(inertia, i)) for i in range(3)]
        d = [add(tape, spins[i], scale(tape, first[i], velocity)) for i in range(3)]

        def entry(i: int, j: int) -> sp.Expr:
            if i != j:
                return -d[j][i]
            return tape.let(d[i - 2][i - 2] + d[i - 1][i - 1])

        zero = sp.S.Zero
        return cls(
            ((zero, z, -y), (-z, zero, x), (y, -x, zero)),
            _block([[entry(i, j) for j in range(3)] for i in range(3)]),
        )

    @property
    def rows(self) -> list[Vector]:
        """All six rows."""
        return [*self.force, *self.moment]

    def plus(self, tape: Scalars, other: VelocityCoupling) -> VelocityCoupling:
        """Of both subtrees about one point, in one frame."""
        return _of_rows([add(tape, a, b) for a, b in zip(self.rows, other.rows, strict=True)])

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
        rows = [
            [
                tape.let(
                    moment[i][j]
                    + times(arm[i - 2], force[i - 1][j])
                    - times(arm[i - 1], force[i - 2][j])
                )
                for j in range(3)
            ]
            for i in range(3)
        ]
        return VelocityCoupling(force, _block(rows))

    def without(
        self, tape: Scalars, direction: int, ratios: Sequence[sp.Expr], left: Vector
    ) -> VelocityCoupling:
        """What the parent feels while a joint, of direction 0 … 5, is free.

        `ratios` are those of its solved equation, row by row. `left` is what is left of the joint's
        own row, zero without armature: written as a difference it would cancel.
        """
        own = self.rows[direction]
        return _of_rows(
            [
                left if i == direction else add(tape, row, scale(tape, -ratio, own))
                for i, (row, ratio) in enumerate(zip(self.rows, ratios, strict=True))
            ]
        )


NO_COUPLING = VelocityCoupling((ZERO,) * 3, (ZERO,) * 3)


def _row(inertia: Inertia, i: int) -> Vector:
    return (inertia.entry(i, 0), inertia.entry(i, 1), inertia.entry(i, 2))


def _of_rows(rows: Sequence[Vector]) -> VelocityCoupling:
    return VelocityCoupling((rows[0], rows[1], rows[2]), (rows[3], rows[4], rows[5]))


def _block(rows: Sequence[Sequence[sp.Expr]]) -> Block:
    x, y, z = ((a, b, c) for a, b, c in rows)
    return (x, y, z)


_TWO = sp.Integer(2)


def doubled_velocities(
    tape: Scalars,
    articulation: Articulation,
    motions: Sequence[Motion],
    rates: Sequence[sp.Expr],
) -> list[Acceleration]:
    """2V and 2ω of every segment's joint against the root's origin, in its working frame.

    Those of the root are where its system is solved. `motions` are in the working frames too.
    """
    tree = articulation.tree
    turn = root_turn(tree).inverse
    found = [Acceleration(ZERO, scale(tape, _TWO, turn.vector(tape, motions[0].omega)))]
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"velocity of {segment.joint_name}"):
            there = found[segment.parent].passed_out(tape, articulation.transforms[k - 1])
            linear = there.linear
            if segment.joint == "prismatic":
                linear = add(tape, linear, axis_vector(Z, tape.let(2 * rates[k - 1])))
            found.append(Acceleration(linear, scale(tape, _TWO, motions[k].omega)))
    return found


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
            own = VelocityCoupling.rigid(tape, inertia, twice.angular, twice.linear)
            whole = own.plus(tape, received[k])
            if k == 0:
                break
            joint, parent = articulation.joints[k - 1], tree.segments[k].parent
            ratios = scale(tape, joint.lightness, whole.rows[joint.direction])
            left = scale(tape, joint.armature, ratios)
            freed = whole.without(tape, joint.direction, joint.ratios, left)
            felt.insert(0, (freed, ratios))
            passed = moved(tape, freed, articulation.transforms[k - 1])
            received[parent] = received[parent].plus(tape, passed)
    return whole, felt


_E = axis_vector(Z)
_NO_WRENCH = [sp.S.Zero] * 6


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
    """The changes of a joint's coordinate and of its rate; and ratios of its equation to ε."""

    coordinate: Perturbation
    rate: Perturbation
    turning_ratios: Vector


def convected_perturbations(
    tape: Scalars,
    articulation: Articulation,
    motions: Sequence[Motion],
    rates: Sequence[sp.Expr],
    accelerations: Sequence[JointAcceleration],
    passive: Sequence[PassiveSymbols],
) -> tuple[VelocityCoupling, list[JointPerturbations]]:
    """Velocity coupling of the whole tree, and the changes of the joints after the root.

    The coupling is where the root's system is solved. `motions` are what the rates alone make of
    the segments, in their working frames; `accelerations` are as of `accelerations_outward`.
    """
    doubled = doubled_velocities(tape, articulation, motions, rates)
    whole, couplings = couplings_inward(tape, articulation, doubled)
    found = []
    for k, segment in enumerate(articulation.tree.segments[1:], start=1):
        coupling, ratios = couplings[k - 1]
        joint, felt = articulation.joints[k - 1], articulation.felt[k - 1]
        carried, own = accelerations[k - 1].carried, passive[k - 1]
        is_revolute = segment.joint == "revolute"
        with tape.group(f"changes of {segment.joint_name} and of its rate"):
            if is_revolute:
                angle = _angle_change(tape, motions[k], doubled[k].linear, carried)
                rate = Acceleration(cross(tape, doubled[k].linear, _E), _axis_rate(doubled[k])), _E
            else:
                angle = Acceleration(_axis_acceleration(tape, motions[k], carried), ZERO), ZERO
                rate = Acceleration(_axis_rate(doubled[k]), ZERO), ZERO
            moving = _moving_along(tape, is_revolute, felt, carried)
            parts = (joint, felt, coupling)
            found.append(
                JointPerturbations(
                    _perturbation(tape, *parts, *angle, -own.stiffness, moving),
                    _perturbation(tape, *parts, *rate, -own.damping, _NO_WRENCH),
                    ratios,
                )
            )
    return whole, found


def _axis_rate(twice: Acceleration) -> Vector:
    """ω×e, or twice that."""
    x, y, _ = twice.angular
    return (y, -x, sp.S.Zero)


def _axis_acceleration(tape: Scalars, motion: Motion, carried: Acceleration) -> Vector:
    """ë = Ae, with what the accelerations add to A."""
    return add(tape, motion.gradient[Z], cross(tape, carried.angular, _E))


def _angle_change(
    tape: Scalars, motion: Motion, doubled: Vector, carried: Acceleration
) -> tuple[Acceleration, Vector]:
    """ψ and ε for the angle of a revolute joint.

    `motion` is what the rates alone make of the segment, `doubled` twice the velocity of the joint,
    and `carried` what the accelerations add, the joint's own left out; all in one frame.
    """
    x, y, _ = motion.omega
    turning = (y, -x, sp.S.Zero)
    acceleration = add(tape, motion.acceleration, carried.linear)
    linear = add(tape, cross(tape, acceleration, _E), cross(tape, doubled, turning))
    return Acceleration(linear, _axis_acceleration(tape, motion, carried)), turning


def _moving_along(
    tape: Scalars, is_revolute: bool, felt: ArticulatedBody, carried: Acceleration
) -> list[sp.Expr]:
    """What moves with the joint (6) of the wrench on all that it carries.

    A revolute joint turns the wrench; otherwise its point moves. `carried` is the joint's
    acceleration without its own.
    """
    rows, load, given = felt.inertia.rows, felt.load.entries, carried.entries
    wrench = [
        tape.let(sp.Add(*(tape.let(times(e, a)) for e, a in zip(row, given, strict=True))) - p)
        for row, p in zip(rows, load, strict=True)
    ]
    (f_x, f_y, _, n_x, n_y, _), zero = wrench, sp.S.Zero
    if is_revolute:
        return [-f_y, f_x, zero, -n_y, n_x, zero]
    return [zero, zero, zero, -f_y, f_x, zero]


def _perturbation(
    tape: Scalars,
    joint: SolvedJoint,
    felt: ArticulatedBody,
    coupling: VelocityCoupling,
    acceleration: Acceleration,
    turning: Vector,
    effort: sp.Expr,
    moving: Sequence[sp.Expr],
) -> Perturbation:
    """A change with the wrench that the parent feels of it; `acceleration` is ψ, `turning` is ε.

    `effort` is what a spring or a damper adds to the joint, `moving` what moves with it of the
    wrench.
    """
    six = zip(felt.inertia.rows, coupling.rows, joint.ratios, moving, strict=True)
    wrench = [
        tape.let(
            sp.Add(
                *(
                    tape.let(times(e, a))
                    for e, a in zip(inertia, acceleration.entries, strict=True)
                ),
                *(tape.let(times(b, e)) for b, e in zip(row, turning, strict=True)),
                tape.let(times(ratio, effort)),
                part,
            )
        )
        for inertia, row, ratio, part in six
    ]
    return Perturbation(acceleration, turning, effort, wrench)


Kind = Literal["wrench", "turning", "effort", "coordinate", "rate"]
# What a column is by: a component 0 … 5 of a wrench on the root, or 0 … 2 of its angular velocity;
# or a joint, by the index of its segment.
Key = tuple[Kind, int]
_KINDS = get_args(Kind)


@dataclass(frozen=True)
class _Carried:
    """What a column does to a segment, in its working frame: an acceleration and a turning ε."""

    acceleration: Acceleration
    turning: Vector = ZERO


class ArticulatedDerivatives:
    """Columns of a tree: what each wrench, effort or change does to all accelerations.

    Of a change of the root's angular velocity ω by ε, the column has what it adds to the
    acceleration of a root which turns at the rate ε besides: dω/dt changes by ω×ε less.
    """

    def __init__(
        self,
        tape: Scalars,
        articulation: Articulation,
        coupling: VelocityCoupling,
        changes: Sequence[JointPerturbations],
        by_inertia: bool,
    ) -> None:
        """Derive all columns, with `coupling` of the whole tree and the `changes` of the joints.

        `by_inertia`: whether what a change does to the parent itself is found by the parent's
        operational-space inertia; otherwise outwards from the root.
        """
        self._tape, self._articulation, self._tree = tape, articulation, articulation.tree
        self._changes, self._by_inertia = changes, by_inertia
        self._root: dict[Key, list[sp.Expr]] = {}
        self._joints: dict[tuple[Key, int], sp.Expr] = {}
        self._at: list[dict[Key, _Carried]] = [{}]
        with tape.group("responses of the base to wrenches and to its angular velocity"):
            inverse = self._start(coupling)
        self._inertias = [inverse]
        for k in range(1, len(self._tree.segments)):
            self._pass_joint(k)
        for k in range(1, len(self._tree.segments)):
            self._pass_from_other_branches(k)

    def column(self, kind: Kind, number: int) -> AccelerationColumn:
        """Accelerations by a component of a root's wrench or turning, or by something of a joint.

        The component is where the root's system is solved; effort, coordinate and rate are by the
        index of the joint's segment.
        """
        key, zero = (kind, number), sp.S.Zero
        joints = range(1, len(self._tree.segments))
        return AccelerationColumn(
            Acceleration.of(self._root[key]), [self._joints.get((key, i), zero) for i in joints]
        )

    def by_wrench(self, k: int, wrench: Sequence[sp.Expr]) -> AccelerationColumn:
        """Accelerations by a wrench (6) on segment k ≥ 1, about its joint in its working frame."""
        tape = self._tape
        keys: list[Key] = [("wrench", c) for c in range(6)]
        keys += [("effort", i) for i in range(1, len(self._tree.segments))]
        powers = [sum_of_products(tape, self._reached(k, key).entries, wrench) for key in keys]
        return AccelerationColumn(Acceleration.of(powers[:6]), powers[6:])

    def _start(self, coupling: VelocityCoupling) -> ArticulatedInertia:
        """Columns of wrenches on the root and of its turning; its inverse inertia, ω̇ first."""
        tape = self._tape
        units = [[sp.Integer(i == c) for i in range(6)] for c in range(6)]
        solved = self._articulation.root_responses(tape, units)
        inverse = [[solved[max(i, j)][min(i, j)] for j in range(6)] for i in range(6)]
        for c, column in enumerate(inverse):
            self._root["wrench", c] = column
            self._at[0]["wrench", c] = _Carried(Acceleration.of(column))
        for c in range(3):
            load = [row[c] for row in coupling.rows]
            column = [-sum_of_products(tape, row, load) for row in inverse]
            self._root["turning", c] = column
            self._at[0]["turning", c] = _Carried(Acceleration.of(column), axis_vector(c))
        return ArticulatedInertia.of_entries(lambda i, j: inverse[(i + 3) % 6][(j + 3) % 6])

    def _pass_joint(self, k: int) -> None:
        """Carry all columns of the parent over a joint, and begin those of the joint."""
        tape, segment = self._tape, self._tree.segments[k]
        name, at_parent = segment.joint_name, self._at[segment.parent]
        before = dict(sorted(at_parent.items(), key=lambda item: _KINDS.index(item[0][0])))
        self._at.append({})
        with tape.group(f"turning of what {name} carries"):
            turning = {key: self._turned(k, column.turning) for key, column in before.items()}
            for vector in turning.values():
                self._share(k, vector)
        for key, column in before.items():
            with tape.group(f"response of {name} to what is before it"):
                arriving = column.acceleration.passed_out(tape, self._transform(k))
                if key[0] in ("wrench", "effort"):
                    self._receive(k, key, arriving)
                self._push(k, key, arriving, turning[key])
        with tape.group(f"responses to {name}, at its parent"):
            begun = self._begun(k)
        with tape.group(f"responses of {name} to itself"):
            self._push(k, ("effort", k), begun["effort"], ZERO, sp.S.One)
            for kind, change in self._changes_of(k):
                self._push(k, (kind, k), begun[kind], change.turning, change.effort)

    def _push(
        self,
        k: int,
        key: Key,
        arriving: Acceleration,
        turning: Vector,
        effort: sp.Expr = sp.S.Zero,
    ) -> None:
        """Let joint k give way to a column.

        `arriving` is what it does to the parent, at the joint in the segment's working frame,
        `turning` ε of what is carried, there too, and `effort` what it adds to the joint's.
        """
        tape, joint = self._tape, self._articulation.joints[k - 1]
        share = tape.let(times(effort, joint.lightness) + self._share(k, turning))
        relative, own = _passed(tape, joint, arriving, share)
        self._at[k][key] = _Carried(own, turning)
        self._joints.setdefault((key, k), relative)
        if key[0] == "effort":
            self._joints.setdefault((("effort", k), key[1]), relative)
        if key[0] == "wrench":
            self._root.setdefault(("effort", k), []).append(relative)

    def _share(self, k: int, turning: Vector) -> sp.Expr:
        """What a joint gives way to a turning of what it carries."""
        return -dot(self._tape, self._changes[k - 1].turning_ratios, turning)

    def _receive(self, k: int, key: Key, arriving: Acceleration) -> None:
        """What the changes at joint k do to what a column is by, by reciprocity.

        `arriving` is what the column does to the parent, at the joint in the segment's working
        frame.
        """
        for kind, change in self._changes_of(k):
            entry = -sum_of_products(self._tape, arriving.entries, change.wrench)
            if key[0] == "wrench":
                self._root.setdefault((kind, k), []).append(entry)
            else:
                self._joints[(kind, k), key[1]] = entry

    def _begun(self, k: int) -> dict[Kind, Acceleration]:
        """What an effort at joint k and its changes do to the parent, with ψ of the changes.

        They are at the joint, in the segment's working frame.
        """
        tape, joint = self._tape, self._articulation.joints[k - 1]
        parent, transform = self._tree.segments[k].parent, self._transform(k)
        wrenches: dict[Kind, Sequence[sp.Expr]] = {"effort": joint.ratios}
        wrenches |= {kind: change.wrench for kind, change in self._changes_of(k)}
        if self._by_inertia:
            rows = passed_out(tape, self._inertias[parent], transform)
            found = {kind: response(tape, rows, wrench) for kind, wrench in wrenches.items()}
            self._inertias.append(with_joint(tape, joint, rows))
        else:
            found = {
                kind: self._reached(parent, (kind, k)).passed_out(tape, transform)
                for kind in wrenches
            }
        for kind, change in self._changes_of(k):
            found[kind] = found[kind].plus(tape, change.acceleration)
        return found

    def _reached(self, k: int, key: Key) -> Acceleration:
        """What a column does to a segment that it is not carried to, by what it does to the joints.

        It is in the segment's working frame, or where the root's system is solved.
        """
        if key in self._at[k]:
            return self._at[k][key].acceleration
        if k == 0:
            return Acceleration.of(self._root[key])
        segment, tape = self._tree.segments[k], self._tape
        there = self._reached(segment.parent, key).passed_out(tape, self._transform(k))
        entries = there.entries
        entries[segment.direction] = tape.let(entries[segment.direction] + self._joints[key, k])
        return Acceleration.of(entries)

    def _pass_from_other_branches(self, k: int) -> None:
        """Carry the columns of the efforts of all other branches over a joint."""
        tape, segment = self._tape, self._tree.segments[k]
        related = {*self._tree.path(k), *self._tree.subtree(k)}
        for i in range(1, len(self._tree.segments)):
            if i not in related:
                with tape.group(f"response of {segment.joint_name} to other branches"):
                    there = self._reached(segment.parent, ("effort", i))
                    arriving = there.passed_out(tape, self._transform(k))
                    self._receive(k, ("effort", i), arriving)
                    self._push(k, ("effort", i), arriving, ZERO)

    def _turned(self, k: int, turning: Vector) -> Vector:
        """A vector of the parent's frame in the working frame of a segment."""
        for step in reversed(self._transform(k)):
            if isinstance(step, Rotation):
                turning = step.inverse.vector(self._tape, turning)
        return turning

    def _transform(self, k: int) -> Transform:
        return self._articulation.transforms[k - 1]

    def _changes_of(self, k: int) -> list[tuple[Kind, Perturbation]]:
        changes = self._changes[k - 1]
        return [("coordinate", changes.coordinate), ("rate", changes.rate)]


def _passed(
    tape: Scalars, joint: SolvedJoint, arriving: Acceleration, share: sp.Expr
) -> tuple[sp.Expr, Acceleration]:
    """What `SolvedJoint.accelerated` gives, in lines that are the same for all columns."""
    direction, entries = joint.direction, arriving.entries
    given = [-ratio for ratio in joint.ratios]
    if joint.armature == 0:
        given[direction] = sp.S.Zero
    total = sum_of_products(tape, given, entries, share)
    if joint.armature != 0:
        relative = total
        entries[direction] = tape.let(entries[direction] + relative)
    else:
        relative = tape.let(total - entries[direction])
        entries[direction] = total
    return relative, Acceleration.of(entries)
