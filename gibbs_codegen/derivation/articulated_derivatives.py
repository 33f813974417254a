"""Derivatives of the accelerations of a tree by articulated bodies, in O(n²), without M.

A change at a joint makes an additional acceleration and turning of all that it carries, which pass
outwards as accelerations do, from joint to joint; each gives way by its own equation. All else
feels a wrench on the parent. What that does there is known by reciprocity, from the accelerations
that a unit of each other joint's effort, or of a wrench on the root, makes at the parent:

    ∂θ̈_i/∂(change at j) = −(acceleration at j per unit of effort of i)·(wrench of the change at j)

So columns for wrenches on the root, for its angular velocity, for efforts, and for the changes of
coordinates and rates are carried outwards, a joint at a time, all of one kind one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import AccelerationColumn, sum_of_products
from gibbs_codegen.derivation.articulated import Articulation, SolvedJoint
from gibbs_codegen.derivation.articulated_inertia import ArticulatedInertia
from gibbs_codegen.derivation.convected_perturbations import JointPerturbations, Perturbation
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.derivation.operational_inertia import passed_out, response, with_joint
from gibbs_codegen.derivation.velocity_coupling import VelocityCoupling
from gibbs_codegen.symbolic.quick import times
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Rotation,
    Transform,
    Vector,
    axis_vector,
    dot,
)

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
