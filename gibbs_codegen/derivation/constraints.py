"""Constraints of frames: M a = R + B u + Jᵀλ with J a + γ = 0 (eqs. 14 and 15, for any frame).

A row holds the origin of a frame along a direction, or its turning about one, against the world or
against what carries the anchor, where directions are fixed. Its Jacobian has the generalised forces
of a unit force or torque at the frame and of its opposite at the same place on the carrier: within
a robot these move no base.

By articulated bodies a load is passed inwards once; each joint takes its share z of it, the root
the rest. With L D Lᵀ of the root's system, what two loads do to each other is

    J_r M⁻¹ J_sᵀ = Σ z_r z_s/D + (L⁻¹ root_r)·D⁻¹(L⁻¹ root_s)

and what thrusts and velocities do to a row is the same with their shares. So neither M nor its
inverse is needed, nor the accelerations of the robot without constraints: once λ is known, their
loads are added to the shares, and one pass outwards gives a.

Forces on a frame that is held against the world count in the axes in which its segment works,
where unit loads have zeros. At the end they are turned to the axes of the anchor.

The rank of A = J M⁻¹ Jᵀ is what the robot leaves of it: with z and L⁻¹ root of each row as vectors,
those of which nothing is left beside the rows before are absent, with their columns of L. With L₁
and D₁ of what is left, λ is the least that does, −L₁ (L₁ᵀL₁)⁻¹ D₁⁻¹ (L₁ᵀL₁)⁻¹ L₁ᵀ b, where b are
the accelerations without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import sympy as sp

from gibbs_codegen.derivation import forward_dynamics
from gibbs_codegen.derivation.articulated import (
    ArticulatedBody,
    Articulation,
    accelerations_outward,
    root_in_group_frame,
    root_turn,
)
from gibbs_codegen.derivation.forces import structural
from gibbs_codegen.derivation.forward_kinematics import (
    Frame,
    MountedFrame,
    SegmentFrame,
    combined,
    frame_motions,
    mounted_frames,
    segment_frames,
)
from gibbs_codegen.derivation.hybrid import LinearSystem
from gibbs_codegen.derivation.motion import Acceleration, TreeState
from gibbs_codegen.derivation.root.quaternion import rotation_columns
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.names import identifier, tie_prefix
from gibbs_codegen.robot.parts.constraint import Constraint
from gibbs_codegen.symbolic.ldlt import Factors, PseudoInverse, minimum_degree
from gibbs_codegen.symbolic.structural import turned_by_rpy, z_onto
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector, times
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    NO_WRENCH,
    ZERO,
    Matrix,
    Wrench,
    Z,
    axis_vector,
    identity,
    minus,
    moved,
)

_HALF = sp.Rational(1, 2)
# Where that of √2 should come out as none.
_LEAST_ERROR = sp.Rational(1, 10**16)


class Direction(NamedTuple):
    """Direction that a row holds: the origin of a frame along a vector, or turning about it."""

    turns: bool
    vector: Vector


class UnitLoad(NamedTuple):
    """A load by the index of segments: wrenches on them, or efforts of their joints.

    The wrenches are about the joints in the frames in which the segments work, or of the root where
    its system is solved.
    """

    wrenches: Mapping[int, Wrench]
    efforts: Mapping[int, sp.Expr]


class Load(NamedTuple):
    """Shares z that joints take of a load, by the index of their segments; the root's part (6).

    `eliminated` is L⁻¹ of the latter, in the order of elimination; `felt` is what the parents feel.
    """

    shares: Mapping[int, sp.Expr]
    felt: Mapping[int, Wrench]
    root: list[sp.Expr]
    eliminated: list[sp.Expr]


@dataclass(frozen=True)
class Held:
    """A frame that a constraint holds; vectors are in world axes, from the origin of coordinates.

    `carrier` carries the anchor, None for the world, and `arm` leads from its origin to that of the
    frame; `way` does so from the anchor, of which `along` are the axes. `axes` are the frame's.
    """

    constraint: Constraint
    symbols: Mapping[str, Any]
    frame: MountedFrame
    carrier: MountedFrame | None
    arm: Vector
    way: Vector
    axes: Frame
    along: Frame
    rows: Sequence[Direction]

    @property
    def is_whole(self) -> bool:
        """True if the world holds it in all directions, and maybe about all."""
        return self.carrier is None and self.constraint.holds in ("point", "frame")


@dataclass(frozen=True)
class ConstraintEquations:
    """The constraints of a robot on its tape."""

    symbolic: SymbolicRobot

    @property
    def _tape(self) -> Scalars:
        return self.symbolic.tape

    @cached_property
    def _frames(self) -> list[SegmentFrame]:
        return segment_frames(self.symbolic)

    @cached_property
    def held(self) -> list[Held]:
        """The frames that constraints hold, in the order of CONSTRAINTS."""
        mounted = {mounting.name: mounting for mounting in mounted_frames(self.symbolic)}
        return [
            self._held(
                constraint,
                mounted[identifier(constraint.frame)],
                mounted[identifier(constraint.to)] if constraint.to is not None else None,
            )
            for constraint in self.symbolic.robot.constraints
        ]

    def _held(self, tie: Constraint, frame: MountedFrame, carrier: MountedFrame | None) -> Held:
        tape, symbols = self._tape, self.symbolic.parameters.ties[tie_prefix(tie)]
        point, axes = self._pose(frame)
        with tape.group(f"anchor of {identifier(tie.name)}"):
            if carrier is None:
                arm, along = (
                    tape.add(self.symbolic.origin, point),
                    _axes_of(tape, symbols.get("quaternion", ())),
                )
                way = tape.add(arm, minus(symbols["xyz"]))
            else:
                origin, carried = self._pose(carrier)
                turn = zip(*turned_by_rpy(tie.anchor.rpy_deg), strict=True)
                along = tuple([combined(tape, carried, column) for column in turn])
                arm = tape.add(point, minus(origin))
                way = tape.add(arm, minus(combined(tape, carried, symbols["xyz"])))
        with tape.group(f"directions that {identifier(tie.name)} holds"):
            rows = _directions(tape, tie, along, way, symbols.get("distance", sp.S.Zero))
        return Held(tie, symbols, frame, carrier, arm, way, axes, along, rows)

    def _pose(self, frame: MountedFrame) -> tuple[Vector, Frame]:
        """Origin of a frame from that of the coordinates, and its axes, in world axes."""
        tape, point = self._tape, frame.from_origin(self._tape, self._frames)
        with tape.group(f"axes of {frame.name}"):
            segment_axes, columns = self._frames[frame.segment].axes, zip(*frame.turn, strict=True)
            return point, tuple([combined(tape, segment_axes, column) for column in columns])

    def errors(self) -> list[sp.Expr]:
        """Errors of all rows, m or rad."""
        return [error for held in self.held for error in self._errors(held)]

    def _errors(self, held: Held) -> list[sp.Expr]:
        tape, let = self._tape, self._tape.let
        (a, b, c), (x, y, z) = held.along, held.axes
        with tape.group(f"errors of {identifier(held.constraint.name)}"):
            if held.constraint.holds == "distance":
                squares = let(tape.dot(held.way, held.way) * let(1 / held.symbols["distance"]))
                return [let(_HALF * let(squares - held.symbols["distance"]))]
            errors = [tape.dot(row.vector, held.way) for row in held.rows if not row.turns]
            if held.constraint.holds == "frame":
                pairs = ((c, y, b, z), (a, z, c, x), (b, x, a, y))
                for p, q, r, s in pairs:
                    errors.append(let(_HALF * let(tape.dot(p, q) - tape.dot(r, s))))
            if held.constraint.holds == "hinge":
                axis = structural(held.constraint.axis)
                sine = tape.cross(combined(tape, (a, b, c), axis), combined(tape, (x, y, z), axis))
                errors += [tape.dot(row.vector, sine) for row in held.rows if row.turns]
            return errors

    def jacobian(self) -> Matrix:
        """J by rows, in the order of v."""
        return [row for held in self.held for row in self._jacobian(held)]

    def _jacobian(self, held: Held) -> Matrix:
        tape, tree = self._tape, self.symbolic.reduced_tree
        nothing = [(ZERO, ZERO)]
        base, joints = nothing * 6, nothing * tree.joints
        point = held.frame.from_origin(tape, self._frames)
        if held.carrier is None:
            with tape.group("columns of the base"):
                base = self.symbolic.root.velocities_at(tape, point)
        for k in self.between(held):
            axis = self._frames[k].group[2]
            if k not in tree.path(held.frame.segment):
                axis = minus(axis)
            joints[k - 1] = (axis, ZERO)
            if tree.segments[k].joint == "revolute":
                with tape.group(f"column of {tree.segments[k].joint_name}"):
                    arm = tape.add(point, minus(self._frames[k].position))
                    joints[k - 1] = (tape.cross(axis, arm), axis)
        columns = self.symbolic.places.joined(base, joints)
        with tape.group(f"rows of {identifier(held.constraint.name)}"):
            return [
                [tape.dot(row.vector, column[row.turns]) for column in columns] for row in held.rows
            ]

    def between(self, held: Held) -> list[int]:
        """Segments whose joints move a frame against the anchor's carrier."""
        tree = self.symbolic.reduced_tree
        carrier = tree.path(held.carrier.segment) if held.carrier else []
        between = {*tree.path(held.frame.segment)} ^ {*carrier}
        return sorted(between - {0})

    def _velocity(self, held: Held) -> Acceleration:
        """Velocity and angular velocity of a frame against the anchor's carrier."""
        motion, carrier = self._motion(held, TreeState.resting)
        with self._tape.group(f"velocity of {identifier(held.constraint.name)}"):
            return self._against(motion, carrier, held.arm)

    def _motion(self, held: Held, of: Callable[[Values], TreeState]) -> tuple[Acceleration, ...]:
        """Motions of a frame and of the anchor's carrier by the joints between them."""
        symbolic = self.symbolic
        rates: Values = symbolic.v
        names = [mounting.name for mounting in mounted_frames(symbolic)]
        if held.carrier is not None:
            between = self.between(held)
            _, joints = symbolic.places.split(rates)
            joints = [rate if k in between else sp.S.Zero for k, rate in enumerate(joints, start=1)]
            rates = symbolic.places.joined([sp.S.Zero] * 6, joints)
        rows = frame_motions(symbolic, of(rates))
        motion = Acceleration.of(rows[names.index(held.frame.name)])
        if held.carrier is None:
            return motion, Acceleration(ZERO, ZERO)
        return motion, Acceleration.of(rows[names.index(held.carrier.name)])

    def _against(self, motion: Acceleration, carrier: Acceleration, arm: Vector) -> Acceleration:
        """One motion less that of the same place on the carrier."""
        tape = self._tape
        there = carrier.passed_out(tape, [arm])
        linear = tape.add(motion.linear, minus(there.linear))
        return Acceleration(linear, tape.add(motion.angular, minus(there.angular)))

    def bias(self) -> list[sp.Expr]:
        """Accelerations of all rows where a is zero, in the axes of the anchor's carrier."""
        return [entry for held in self.held for entry in self._bias(held)]

    def _bias(self, held: Held) -> list[sp.Expr]:
        tape = self._tape
        motion, carrier = self._motion(held, TreeState.coasting)
        relative = self._against(motion, carrier, held.arm)
        if held.carrier is not None:
            before, turning = self._motion(held, TreeState.resting)
            spin, moving = turning.angular, self._velocity(held)
            with tape.group(
                f"acceleration of {identifier(held.constraint.name)} against its carrier"
            ):
                inner = tape.cross(spin, tape.cross(spin, held.arm))
                twice = tape.cross(tape.scale(sp.Integer(2), spin), moving.linear)
                relative = Acceleration(
                    tape.add(relative.linear, minus(inner), minus(twice)),
                    tape.add(relative.angular, minus(tape.cross(spin, before.angular))),
                )
        return self._along(held, relative, centripetal=True)

    def _along(self, held: Held, motion: Acceleration, centripetal: bool = False) -> list[sp.Expr]:
        """Components of a motion along the rows; for a distance with the part of its turning."""
        tape, parts = self._tape, (motion.linear, motion.angular)
        with tape.group(f"rows of {identifier(held.constraint.name)}"):
            entries = [tape.dot(row.vector, parts[row.turns]) for row in held.rows]
            if centripetal:
                entries = [tape.let(x + self._centripetal(held)) for x in entries]
            return entries

    def _centripetal(self, held: Held) -> sp.Expr:
        """Acceleration of a distance as its direction turns, else zero."""
        if held.constraint.holds != "distance":
            return sp.S.Zero
        tape, moving = self._tape, self._velocity(held).linear
        return tape.let(tape.dot(moving, moving) * tape.let(1 / held.symbols["distance"]))

    def _returning(self, held: Held) -> list[sp.Expr]:
        """2ζω ė + ω² e of the rows, with J v for ė; zeros where there is no frequency."""
        tape, let = self._tape, self._tape.let
        if held.symbols.get("frequency", 0) == 0:
            return [sp.S.Zero] * len(held.rows)
        frequency, ratio = held.symbols["frequency"], held.symbols["damping_ratio"]
        errors, rates = self._errors(held), self._along(held, self._velocity(held))
        with tape.group(f"errors of {identifier(held.constraint.name)}, back to zero"):
            stiffness, damping = let(frequency * frequency), let(let(2 * ratio) * frequency)
            return [
                let(let(damping * rate) + let(stiffness * error))
                for rate, error in zip(rates, errors, strict=True)
            ]

    # What follows solves for the forces, in the axes in which segments work.

    @cached_property
    def articulation(self) -> Articulation:
        """The solved joints under thrusts."""
        with forward_dynamics.refused_as_singular(self.symbolic):
            return forward_dynamics.articulation_of(self.symbolic.centred, forward_dynamics.thrusts)

    @cached_property
    def _root(self) -> tuple[list[int], Factors]:
        """L D Lᵀ of the root's system, in some order."""
        rows, free = self.articulation.free_rows, self.articulation.free
        order = minimum_degree(rows)
        with self._tape.group("inertia of the base, by LDL^T"):
            factors = Factors(self._tape, [[rows[i][j] for j in order] for i in order])
            return [free[i] for i in order], factors

    def working(self, held: Held) -> tuple[Frame, Vector]:
        """World axes of the frame in which a segment works, and where there the held frame is."""
        tree, k = self.articulation.tree, held.frame.segment
        (centred,) = mounted_frames(self.symbolic.centred, held.frame.name)
        by_segment = tree.works_in_own_frame(k)
        rotation = NO_ROTATION if by_segment else tree.segments[k].rotation
        axes = self._frames[k].axes if by_segment else self._frames[k].group
        with self._tape.group(f"place of {held.frame.name}"):
            return axes, rotation.vector(self._tape, centred.position)

    def _solver_directions(self, held: Held) -> list[Direction]:
        """Rows of a frame that the world holds, in the axes in which its segment works."""
        axes, _ = self.working(held)
        if held.is_whole:
            return _units(held)
        with self._tape.group(f"directions that {identifier(held.constraint.name)} holds"):
            return [
                Direction(turns, tuple(self._tape.dot(axis, vector) for axis in axes))
                for turns, vector in held.rows
            ]

    def _push(self, held: Held, direction: Direction) -> UnitLoad:
        """A unit force or torque on a frame, in the axes in which its segment works."""
        tape, k = self._tape, held.frame.segment
        turns, vector = direction
        _, place = self.working(held)
        with tape.group(f"unit load of {identifier(held.constraint.name)}"):
            wrench = Wrench(ZERO, vector) if turns else Wrench(vector, ZERO)
            wrench = wrench.shifted(tape, place)
            if k == 0:
                wrench = wrench.rotated(tape, root_turn(self.articulation.tree).inverse)
        return UnitLoad({k: wrench}, {})

    def units(self, held: Held) -> list[UnitLoad]:
        """Unit loads that those of the rows are made of, with the `shares` of these.

        On what the world holds they are forces, and torques, along the axes in which the segment
        works; else efforts of the joints between the frame and its carrier.
        """
        if held.carrier is not None:
            return [UnitLoad({}, {k: sp.S.One}) for k in self.between(held)]
        return [self._push(held, unit) for unit in _units(held)]

    def shares(self, held: Held) -> Matrix:
        """Shares of rows (rows) in the unit loads."""
        if held.carrier is not None:
            joints = [self.symbolic.places.split(row)[1] for row in self._jacobian(held)]
            return [[row[k - 1] for k in self.between(held)] for row in joints]
        halves = len(_units(held)) // 3
        return [
            [x for half in range(halves) for x in (vector if half == turns else ZERO)]
            for turns, vector in self._solver_directions(held)
        ]

    @cached_property
    def _loads(self) -> list[Load]:
        """Unit loads of all rows, passed inwards."""
        loads = []
        for held in self.held:
            if held.carrier is None:
                pushes = [self._push(held, row) for row in self._solver_directions(held)]
            else:
                between = self.between(held)
                rows = self.shares(held)
                pushes = [UnitLoad({}, dict(zip(between, row, strict=True))) for row in rows]
            loads += [self._passed_in(push) for push in pushes]
        return loads

    def _passed_in(self, push: UnitLoad) -> Load:
        """Parts of a load that joints and root take."""
        tape, articulation = self._tape, self.articulation
        shares, felt, loads = {}, {}, dict(push.wrenches)
        for k in range(articulation.tree.joints, 0, -1):
            if k not in loads and k not in push.efforts:
                continue
            joint, segment = articulation.joints[k - 1], articulation.tree.segments[k]
            with tape.group(f"load passed over {segment.joint_name}"):
                load, effort = loads.get(k, NO_WRENCH).entries, push.efforts.get(k, sp.S.Zero)
                share = shares[k] = tape.let(effort + load[joint.direction])
                left = [
                    tape.let(entry - tape.let(times(ratio, share)))
                    for entry, ratio in zip(load, joint.ratios, strict=True)
                ]
                carried = times(tape.let(times(joint.armature, joint.lightness)), share)
                left[joint.direction] = tape.let(carried - effort)
                felt[k] = Wrench.of(left)
                passed = moved(tape, felt[k], articulation.transforms[k - 1])
                loads[segment.parent] = loads.get(segment.parent, NO_WRENCH).plus(tape, passed)
        root, (order, factors) = loads.get(0, NO_WRENCH).entries, self._root
        with tape.group("load on the base, eliminated"):
            return Load(shares, felt, root, factors.eliminated([root[i] for i in order]))

    def _product(self, one: Load, shares: Mapping[int, sp.Expr], scaled: Values) -> sp.Expr:
        """Σ of a load's shares and its root's, times others that are scaled by D⁻¹."""
        both = [k for k in one.shares if k in shares]  # None on different limbs of a fixed base.
        ours = [*(one.shares[k] for k in both), *one.eliminated]
        return self._tape.sum_of_products(ours, [*(shares[k] for k in both), *scaled])

    def _scaled(self, load: Load) -> tuple[dict[int, sp.Expr], list[sp.Expr]]:
        """D⁻¹ times shares, and times those of the root."""
        shares = {
            k: self._tape.let(times(self.articulation.joints[k - 1].lightness, z))
            for k, z in load.shares.items()
        }
        return shares, self._root[1].scaled(load.eliminated)

    @cached_property
    def _matrix(self) -> Matrix:
        """A = J M⁻¹ Jᵀ of all rows."""
        entries = [[sp.S.Zero] * len(self._loads) for _ in self._loads]
        for i, load in enumerate(self._loads):
            for j, entry in enumerate(self._pushed(load, self._loads[: i + 1])):
                entries[i][j] = entries[j][i] = entry
        return entries

    def _pushed(self, load: Load, rows: Sequence[Load]) -> list[sp.Expr]:
        """Accelerations of rows by a load."""
        with self._tape.group("what constraints do to each other"):
            scaled = self._scaled(load)
            return [self._product(row, *scaled) for row in rows]

    @cached_property
    def pushed(self) -> Matrix:
        """Accelerations of all rows (rows) by the unit loads of all frames (columns)."""
        columns, rows = list[list[sp.Expr]](), iter(self._matrix)
        for held in self.held:
            accelerations = [next(rows) for _ in held.rows]
            if not held.is_whole:
                loads = map(self._passed_in, self.units(held))
                accelerations = [self._pushed(load, self._loads) for load in loads]
            columns += accelerations
        return [*map(list, zip(*columns, strict=True))]

    @cached_property
    def masks(self) -> list[sp.Expr]:
        """For each row whether its constraint is active."""
        pairs = zip(self.symbolic.active, self.held, strict=True)
        return [active for active, held in pairs for _ in held.rows]

    @cached_property
    def masked_matrix(self) -> Matrix:
        """A of the active constraints, with zeros for others."""
        tape, masks = self._tape, self.masks
        masked = [list(row) for row in self._matrix]
        for i, row in enumerate(self._matrix):
            for j in range(i + 1):
                both = masks[i] if masks[i] == masks[j] else tape.let(masks[i] * masks[j])
                masked[i][j] = masked[j][i] = tape.let(times(both, row[j]))
        return masked

    @cached_property
    def _inverse(self) -> Factors | PseudoInverse:
        """Solver for forces of the active constraints; a single one counts as active.

        A frame that the world holds can always be moved, since the base flies: no row is redundant.
        """
        tape = self._tape
        with tape.group("forces of the constraints, by LDL^T"):
            if self.is_regular:
                return Factors(tape, self._matrix)
            moving = sorted({k for load in self._loads for k in load.shares})
            weights = [self.articulation.joints[k - 1].lightness for k in moving]
            weights += self._root[1].inverse
            vectors = []
            for mask, load in zip(self.masks, self._loads, strict=True):
                entries = [*(load.shares.get(k, sp.S.Zero) for k in moving), *load.eliminated]
                vectors.append([tape.let(times(mask, entry)) for entry in entries])
            sizes = [row[k] for k, row in enumerate(self.masked_matrix)]
            return PseudoInverse(tape, vectors, weights, sizes, self._rounding)

    @property
    def _rounding(self) -> sp.Expr:
        """About the rounding error of the numbers that a function computes with: (√2)² − 2.

        Constants are numbers of double precision, so it is none of them.
        """
        tape, some = self._tape, self.symbolic.active[0]
        with tape.group("rounding error of the numbers"):
            two = tape.let(2 * tape.let(sp.sign(tape.let(1 + tape.let(some * some)))))
            root = tape.let(sp.sqrt(two))
            error = tape.let(tape.let(root * root) - two)
            return tape.let(tape.let(error * tape.let(sp.sign(error))) + _LEAST_ERROR)

    @property
    def is_regular(self) -> bool:
        """True if no row can be redundant."""
        (first, *others) = self.held
        moves = first.carrier is None and first.constraint.holds != "distance"
        return not others and moves and self.symbolic.robot.base.moves_freely

    def _solved(self, right: Values) -> list[sp.Expr]:
        """Minus the least λ with A λ = b, of the active constraints."""
        tape = self._tape
        with tape.group("forces of the constraints, by LDL^T"):
            forces = self._inverse.solved(right)
            if self.is_regular:
                forces = [
                    tape.let(times(mask, x)) for mask, x in zip(self.masks, forces, strict=True)
                ]
            return [-x for x in forces]

    def _to_solver(self, rows: Values) -> list[sp.Expr]:
        """Values of rows, in the axes of the solver."""
        return self._turned(rows, lambda held: (held.along, self.working(held)[0]))

    def from_solver(self, rows: Values) -> list[sp.Expr]:
        """Values of rows, from the axes of the solver."""
        return self._turned(rows, lambda held: (self.working(held)[0], held.along))

    def _turned(self, rows: Values, axes: Callable[[Held], tuple[Frame, Frame]]) -> list[sp.Expr]:
        """Rows of frames that the world holds whole, from some axes to others."""
        tape, rest, turned = self._tape, list(rows), []
        for held in self.held:
            part, rest = rest[: len(held.rows)], rest[len(held.rows) :]
            if held.is_whole:
                before, after = axes(held)
                with tape.group(f"rows of {identifier(held.constraint.name)} in other axes"):
                    halves = [
                        combined(tape, before, tuple(part[i : i + 3]))
                        for i in range(0, len(part), 3)
                    ]
                    part = [tape.dot(axis, half) for half in halves for axis in after]
            turned += part
        return turned

    @cached_property
    def _unheld(self) -> list[sp.Expr]:
        """J a + γ of the rows if no constraint held, in the axes of the solver."""
        return self._accelerations(self.articulation, self._unloaded)

    def _accelerations(self, articulation: Articulation, unloaded: Values) -> list[sp.Expr]:
        """Accelerations of the rows of the solver under some loads, with `unloaded` of them."""
        tape, (order, factors) = self._tape, self._root
        load, lift = articulation.driving_load(tape), articulation.lift
        with tape.group("accelerations of the constraints"):
            scaled = factors.scaled(factors.eliminated([load[i] for i in order]))
            shares = {k: joint.share for k, joint in enumerate(articulation.joints, start=1)}
            return [
                tape.let(x + self._product(row, shares, scaled) + times(row.root[Z], lift))
                for x, row in zip(unloaded, self._loads, strict=True)
            ]

    @cached_property
    def _unloaded(self) -> list[sp.Expr]:
        """Parts of the rows by velocities and gravity, and by errors that go back to zero."""
        return self.rows_at(self.unit_motions(None, alone=False))

    def unit_motions(self, articulation: Articulation | None, alone: bool) -> list[Values]:
        """Accelerations along the unit loads of each frame, relative to free fall.

        They are what velocities make, unless loads act `alone`, and what solved joints add.
        """
        tape, motions = self._tape, list[Values]()
        free = forward_dynamics.free_motions_of(self.symbolic.centred)
        if articulation is not None:
            root, joints = accelerations_outward(tape, articulation)
        for held in self.held:
            k, (_, place) = held.frame.segment, self.working(held)
            with tape.group(f"motion of {held.frame.name} by velocities and gravity"):
                motion = free[k].displaced(tape, place)
                moving = Acceleration(motion.acceleration, motion.omega_dot)
                if articulation is not None:
                    turn = root_turn(articulation.tree)
                    gain = joints[k - 1].acceleration if k else root.rotated(tape, turn)
                    gain = gain.passed_out(tape, [place])
                    moving = gain if alone else moving.plus(tape, gain)
            if held.carrier is None:
                motions.append(moving.entries[: len(_units(held))])
            else:
                between = self.between(held)
                still = articulation is None
                motions.append([sp.S.Zero if still else joints[k - 1].relative for k in between])
        return motions

    def _of_units(self, motions: Sequence[Values]) -> list[sp.Expr]:
        """Accelerations of rows from those along the unit loads."""
        return [
            self._tape.dot(tuple(row), tuple(motion))
            for held, motion in zip(self.held, motions, strict=True)
            for row in self.shares(held)
        ]

    def rows_at(self, motions: Sequence[Values]) -> list[sp.Expr]:
        """J a + γ of all rows, from rates along the unit loads of each frame."""
        tape, against, added = self._tape, list[Values](), list[sp.Expr]()
        for held, motion in zip(self.held, motions, strict=True):
            if held.carrier is not None:
                added += self._bias(held)
            else:
                gravity, (axes, _) = self.symbolic.parameters.gravity, self.working(held)
                with tape.group(f"motion of {held.frame.name} by velocities and gravity"):
                    fall = tuple([tape.let(gravity * axis[2]) for axis in axes])
                    motion = [*tape.add(tuple(motion[:3]), minus(fall)), *motion[3:]]
                added += [self._centripetal(held)] * len(held.rows)
            against.append(motion)
        with tape.group("motions of the constraints by velocities and gravity"):
            rates = [tape.let(x + y) for x, y in zip(self._of_units(against), added, strict=True)]
        back = self._to_solver([x for held in self.held for x in self._returning(held)])
        with tape.group("errors back to zero"):
            return [tape.let(x + y) for x, y in zip(rates, back, strict=True)]

    def under(self, forces: Values, alone: bool) -> Articulation:
        """The solved joints under forces of the constraints, alone or with all else."""
        tape, articulation = self._tape, self.articulation
        with tape.group("loads of the constraints"):
            joints, felt = [], []
            bodies = [*articulation.felt, articulation.root]
            before = [NO_WRENCH if alone else body.load for body in bodies]
            for k, joint in enumerate(articulation.joints, start=1):
                pairs = [
                    (row, force)
                    for row, force in zip(self._loads, forces, strict=True)
                    if k in row.shares
                ]
                pushing = [force for _, force in pairs]
                total = tape.sum_of_products([row.shares[k] for row, _ in pairs], pushing)
                pushed = times(joint.lightness, total)
                share = sp.S.Zero if alone else joint.share
                joints.append(replace(joint, share=tape.let(share + pushed)))
                left = [row.felt[k].entries for row, _ in pairs] or [NO_WRENCH.entries]
                load = Wrench.of(tape.combination(pushing or [sp.S.Zero], left))
                load = before[k - 1].plus(tape, load)
                felt.append(ArticulatedBody(bodies[k - 1].inertia, load))
            load = Wrench.of(tape.combination(forces, [row.root for row in self._loads]))
            root = ArticulatedBody(bodies[-1].inertia, before[-1].plus(tape, load))
            upward = sp.S.Zero if alone else articulation.upward
            return replace(articulation, joints=joints, felt=felt, root=root, upward=upward)

    def _moved(self, forces: Values) -> list[sp.Expr]:
        """M⁻¹Jᵀ times forces of the rows, in the axes of the solver."""
        tape, symbolic = self._tape, self.symbolic
        articulation = self.under(forces, alone=True)
        root, joints = accelerations_outward(tape, articulation)
        root = root_in_group_frame(tape, articulation, root)
        with tape.group("rates of attitude and position"):
            centre = symbolic.root.segment_rotation.vector(tape, minus(symbolic.centre))
            rows = symbolic.root.acceleration_rows(tape, [])(root.passed_out(tape, [centre]))
        return symbolic.places.joined(rows, [joint.relative for joint in joints])

    @cached_property
    def solver_forces(self) -> list[sp.Expr]:
        """λ of all rows in the axes of the solver."""
        return self._solved(self._unheld)

    def forces(self) -> list[sp.Expr]:
        """λ of all rows, N or N m."""
        return self.from_solver(self.solver_forces)

    def acceleration(self) -> list[sp.Expr]:
        """Accelerations a under the forces of the constraints."""
        articulation = self.under(self.solver_forces, alone=False)
        root, joints = accelerations_outward(self._tape, articulation)
        root = root_in_group_frame(self._tape, articulation, root)
        relative = [joint.relative for joint in joints]
        return forward_dynamics.in_coordinates(self.symbolic, relative, root)

    @cached_property
    def _taken(self) -> list[sp.Expr]:
        """Velocities that an impact takes from all rows, (1 + e) J v, in the axes of the solver."""
        tape, taken = self._tape, list[sp.Expr]()
        for held, restitution in zip(self.held, self.symbolic.restitution, strict=True):
            rates = self._along(held, self._velocity(held))
            with tape.group(f"velocities that {identifier(held.constraint.name)} takes"):
                share = tape.let(1 + restitution)
                taken += [tape.let(share * rate) for rate in rates]
        return self._to_solver(taken)

    @cached_property
    def solver_impulses(self) -> list[sp.Expr]:
        """Impulses of all rows in the axes of the solver."""
        return self._solved(self._taken)

    def impulses(self) -> list[sp.Expr]:
        """Impulses of an impact on all active rows, N s or N m s."""
        return self.from_solver(self.solver_impulses)

    def velocities_after(self) -> list[sp.Expr]:
        """Velocities v after these."""
        gains = self._moved(self.solver_impulses)
        with self._tape.group("velocities after the impact"):
            return [self._tape.let(v + gain) for v, gain in zip(self._rates, gains, strict=True)]

    @property
    def _rates(self) -> Values:
        return self.symbolic.v

    def projection(self) -> list[sp.Expr]:
        """The least displacement, by M, that takes the errors of all active rows away."""
        return self._moved(self._solved(self._to_solver(self.errors())))

    def inertia(self) -> Matrix:
        """(J M⁻¹ Jᵀ)⁺ of the active constraints."""
        units = identity(len(self.masks))
        return [
            [-entry for entry in self.from_solver(self._solved(self._to_solver(unit)))]
            for unit in units
        ]

    @cached_property
    def solver_inverse(self) -> Matrix:
        """A⁺ of the active constraints, symmetric, in the axes of the solver."""
        columns = [self._solved(unit) for unit in identity(len(self.masks))]
        size = range(len(columns))
        return [[-columns[min(i, j)][max(i, j)] for j in size] for i in size]

    def projected(self, rows: Values) -> list[sp.Expr]:
        """A A⁺ times rows, in the axes of the solver: the part of them that forces can have."""
        inverse = self._inverse
        return inverse.projected(rows) if isinstance(inverse, PseudoInverse) else [*rows]

    def rows_under(self, forces: Values) -> list[sp.Expr]:
        """A times forces of all rows, in the axes of the solver."""
        nothing = [sp.S.Zero] * len(self.masks)
        return self._accelerations(self.under(forces, alone=True), nothing)

    def stopped_at(self, motions: Sequence[Values]) -> list[sp.Expr]:
        """(1 + e) J v of all rows and what impulses make of it, by velocities along unit loads."""
        with self._tape.group("velocities of the constraints after the impact"):
            pairs = zip(self._taken, self._of_units(motions), strict=True)
            return [self._tape.let(x + y) for x, y in pairs]


@dataclass(frozen=True)
class GearedConstraintEquations(ConstraintEquations):
    """The constraints of a robot with gears, by L D Lᵀ of its whole mass matrix.

    Rows are those of all joints, `symbolic`, folded to the coordinates of `geared`: gears lead from
    one branch to another, so that no joint can be solved for on the way inwards. `reduced` is the
    system M a = R + B u.
    """

    geared: SymbolicRobot
    reduced: LinearSystem

    def jacobian(self) -> Matrix:
        """J by rows, in the order of v."""
        return self.geared.folded(super().jacobian())

    @property
    def _rates(self) -> Values:
        return self.geared.v

    @cached_property
    def _root(self) -> tuple[list[int], Factors]:
        order = minimum_degree(matrix := self.reduced.matrix)
        with self._tape.group("mass matrix, by LDL^T"):
            return order, Factors(self._tape, [[matrix[i][j] for j in order] for i in order])

    def _dense(self, forces: Values) -> Load:
        """A load by its generalised forces."""
        order, factors = self._root
        return Load({}, {}, [*forces], factors.eliminated([forces[i] for i in order]))

    @cached_property
    def _loads(self) -> list[Load]:
        return [*map(self._dense, self.jacobian())]

    @cached_property
    def _driving(self) -> list[sp.Expr]:
        """R + B u."""
        rows, inputs = zip(self.reduced.residual, self.reduced.inputs, strict=True), self.geared.u
        return [self._tape.sum_of_products(row, inputs, r) for r, row in rows]

    @cached_property
    def _unheld(self) -> list[sp.Expr]:
        tape, ((_, factors), load) = self._tape, (self._root, self._dense(self._driving))
        scaled, bias = factors.scaled(load.eliminated), self.bias()
        back = [x for held in self.held for x in self._returning(held)]
        return [
            tape.let(self._product(row, {}, scaled) + tape.let(x + y))
            for row, x, y in zip(self._loads, bias, back, strict=True)
        ]

    def _turned(self, rows: Values, _: object) -> list[sp.Expr]:
        """Rows are solved for in the axes of their anchors."""
        return [*rows]

    def _moved(self, forces: Values, driving: Sequence[Values] = ()) -> list[sp.Expr]:
        loads = [*driving, *(load.root for load in self._loads)]
        pushed = self._tape.combination([*(sp.S.One for _ in driving), *forces], loads)
        order, factors = self._root
        solved = factors.solved([pushed[i] for i in order])
        return [solved[order.index(i)] for i in range(len(order))]

    def acceleration(self) -> list[sp.Expr]:
        """Accelerations a under the forces of the constraints."""
        return self._moved(self.solver_forces, [self._driving])


def _units(held: Held) -> list[Direction]:
    """Unit forces, and torques where rows hold turns."""
    count = 6 if any(row.turns for row in held.rows) else 3
    return [Direction(c >= 3, axis_vector(c % 3)) for c in range(count)]


def _axes_of(tape: Scalars, quaternion: Vector) -> Frame:
    """World axes of an anchor by a quaternion of any length, or the world's own."""
    if not quaternion:
        return tuple([axis_vector(axis) for axis in range(3)])
    square = tape.let(sp.Add(*(tape.let(part * part) for part in quaternion)))
    return rotation_columns(tape, quaternion, tape.let(2 * tape.let(1 / square)))


def _directions(
    tape: Scalars, constraint: Constraint, along: Frame, way: Vector, distance: sp.Expr
) -> list[Direction]:
    """Rows of a constraint in world axes, by those of the anchor."""
    if constraint.holds == "distance":
        return [Direction(False, tape.scale(tape.let(1 / distance), way))]
    if constraint.holds == "plane":
        return [Direction(False, combined(tape, along, structural(constraint.normal)))]
    rows = [Direction(False, axis) for axis in along]
    if constraint.holds == "frame":
        rows += [Direction(True, axis) for axis in along]
    if constraint.holds == "hinge":
        first, second, _ = zip(*z_onto(constraint.axis), strict=True)
        rows += [Direction(True, combined(tape, along, across)) for across in (first, second)]
    return rows
