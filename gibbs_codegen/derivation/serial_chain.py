"""Recursions along one open chain: motions outward, forces and composite inertias inward (eq. 5).

A chain is a row of segments. Segment 0 is the root link (arm 1); each further segment is a link
with the joint that carries it. Segments whose joints have parallel axes form a group and share one
*carrier* frame: the frame of the group before any of its joints turns it. A segment of the group is
turned against the carrier by the sum of the group's angles about z, so vectors along the group are
never rotated from link to link, and one sine–cosine pair a joint is enough.

What a segment computes, it computes in its *working frame*: the carrier, or its own frame if
another group hangs on it, since all that passes through has to be turned once anyway.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import sympy as sp

from gibbs_codegen.derivation.gibbs import (
    ACCELERATION,
    GRADIENT,
    MASS,
    OMEGA,
    OMEGA_DOT,
    link_gibbs_function,
    link_partials_by_gradient,
)
from gibbs_codegen.derivation.inertia import (
    ANGULAR,
    LINEAR,
    NO_INERTIA,
    Inertia,
    split_prismatic,
    split_revolute,
)
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.robot.model import JointKind
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    NO_WRENCH,
    Rotation,
    Vector,
    Wrench,
    Z,
    axis_vector,
    scale,
)

Carried = TypeVar("Carried", Wrench, Inertia)

# Joints that a column of the mass matrix is carried past before the next column.
_JOINTS_AT_ONCE = 8


@dataclass(frozen=True)
class Segment:
    """A link and its joint, as modified Denavit–Hartenberg places it.

    From the parent's frame: `a` along x, `twist` about x, `d` along z (a prismatic joint's travel
    included), then `rotation` about z, counted from the carrier. `leads` marks the first segment of
    a carrier's group. `inertia` is about the joint, in the link's own frame. Comments call the link
    `name` and its joint `joint_name`.
    """

    inertia: Inertia
    rotation: Rotation
    joint: JointKind = "revolute"
    a: sp.Expr = sp.S.Zero
    d: sp.Expr = sp.S.Zero
    twist: Rotation = NO_ROTATION
    leads: bool = True
    name: str = ""
    joint_name: str = ""

    def row(self, wrench: Wrench) -> sp.Expr:
        """Share of a wrench, about the joint in its carrier, that acts along the joint."""
        return wrench.moment[2] if self.joint == "revolute" else wrench.force[2]


@dataclass(frozen=True)
class SerialChain:
    """A row of segments from the root link outwards."""

    segments: tuple[Segment, ...]

    @property
    def joints(self) -> int:
        """Number of joints after the root."""
        return len(self.segments) - 1

    def carried(self, k: int) -> str:
        """Segment k and all that it carries, in words."""
        own, rest = self.segments[k].name, self.segments[k + 1 :]
        if not rest:
            return own
        if k == 0:
            return f"{own} and {self.carried(1)}"
        return f"links {k} {'and' if len(rest) == 1 else 'to'} {k + len(rest)}"

    def carried_about(self, k: int) -> str:
        """Segment k and all that it carries, about its joint, in words."""
        joint = self.segments[k].joint_name
        return f"{self.carried(k)}, about {joint}" if joint else self.carried(k)

    def works_in_own_frame(self, k: int) -> bool:
        """Whether segment k works in its own frame: another group hangs on it."""
        return k + 1 < len(self.segments) and self.segments[k + 1].leads

    def passed_in(self, tape: Scalars, k: int, item: Carried) -> Carried:
        """Take what is about joint k, in its carrier, to joint k − 1, in its working frame.

        Within a group parent and child share the carrier, and the parent's x axis is turned in it
        by the parent's rotation. Where a group begins the parent works in its own frame.
        """
        segment, parent = self.segments[k], self.segments[k - 1]
        item = item.shifted(tape, axis_vector(2, segment.d))
        step = axis_vector(0, segment.a)
        if segment.leads:
            return item.rotated(tape, segment.twist).shifted(tape, step)
        with tape.group(f"step from {parent.name} to {segment.name}"):
            arm = parent.rotation.vector(tape, step)
        return item.shifted(tape, arm)

    def to_carrier(self, tape: Scalars, k: int, item: Carried) -> Carried:
        """Take what is in the working frame of segment k to its carrier."""
        if self.works_in_own_frame(k):
            return item.rotated(tape, self.segments[k].rotation)
        return item

    def working_inertia(self, tape: Scalars, k: int) -> Inertia:
        """Inertia of segment k in its working frame."""
        segment = self.segments[k]
        if self.works_in_own_frame(k):
            return segment.inertia
        with tape.group(f"inertia of {segment.name}, turned by the joints"):
            return segment.inertia.rotated(tape, segment.rotation)


def regrouped(tape: Scalars, chain: SerialChain, offsets: Sequence[Rotation]) -> SerialChain:
    """Give each parent the inertia that moves with it whatever the joint does, tip first.

    Inertia passes between the links' own frames. What a revolute joint gives is symmetric about its
    axis and need not be turned; what a prismatic joint gives is turned by its structural angle
    about z, which `offsets` holds for each segment, since a segment's rotation is its whole
    group's.
    """
    segments = list(chain.segments)
    for k in range(len(segments) - 1, 0, -1):
        segment, parent = segments[k], segments[k - 1]
        given_part = f"that of {segment.name} which {segment.joint_name} does not move"
        with tape.group(f"inertia of {parent.name}, with {given_part}", Stage.PARAMETER):
            if segment.joint == "revolute":
                own, given = split_revolute(segment.inertia)
                given = given.shifted(tape, axis_vector(2, segment.d))
            else:
                own, given = split_prismatic(segment.inertia)
                given = given.rotated(tape, offsets[k])
            given = given.rotated(tape, segment.twist).shifted(tape, axis_vector(0, segment.a))
            segments[k] = replace(segment, inertia=own)
            segments[k - 1] = replace(parent, inertia=parent.inertia.plus(tape, given))
    return SerialChain(tuple(segments))


def outward(
    tape: Scalars,
    chain: SerialChain,
    carrier_motion: Motion,
    rates: Sequence[sp.Expr],
    accelerations: Sequence[sp.Expr],
) -> list[Motion]:
    """Motion of every segment in its working frame, root first.

    `carrier_motion` is that of the root's carrier; `rates` and `accelerations` are the segments'
    joint rates and accelerations.
    """
    motions: list[Motion] = []
    motion = carrier_motion
    for k, segment in enumerate(chain.segments):
        with tape.group(f"motion of {segment.name}"):
            if k > 0:
                motion = _passed_out(tape, chain, k, motion)
            move = motion.spun if segment.joint == "revolute" else motion.slid
            motion = move(tape, rates[k], accelerations[k])
            if chain.works_in_own_frame(k):
                motion = motion.rotated(tape, segment.rotation.inverse)
        motions.append(motion)
    return motions


def _passed_out(tape: Scalars, chain: SerialChain, k: int, motion: Motion) -> Motion:
    segment, parent = chain.segments[k], chain.segments[k - 1]
    if segment.leads:
        motion = motion.displaced_along(tape, NO_ROTATION, segment.a)
        motion = motion.rotated(tape, segment.twist.inverse)
    else:
        motion = motion.displaced_along(tape, parent.rotation, segment.a)
    return motion.displaced(tape, axis_vector(2, segment.d))


def link_wrench(tape: Scalars, chain: SerialChain, k: int, motion: Motion) -> Wrench:
    """𝒮 and ℛ of segment k (eq. 6) in its working frame.

    The root's B₀r̈ is left out: regrouping brings most of the mass there, and it is cheapest in
    world axes.
    """
    segment = chain.segments[k]
    inertia = chain.working_inertia(tape, k)
    values = inertia.values
    if k == 0:
        values[MASS] = sp.S.Zero
    values.update(zip(ACCELERATION, motion.acceleration, strict=True))
    for j, column in enumerate(motion.gradient):
        values.update((GRADIENT[i][j], entry) for i, entry in enumerate(column))
    partials = link_partials_by_gradient()
    fx, fy, fz = (tape.let(partial.xreplace(values)) for partial in partials.force)
    nx, ny, nz = (tape.let(partial.xreplace(values)) for partial in partials.moment)
    force: Vector = (fx, fy, fz)
    c_x, c_y, c_z = segment.inertia.moment
    if c_y == c_z == 0 and values[MASS] == 0 and not chain.works_in_own_frame(k):
        # A rod: its 𝒮 is parallel to the step to the next joint, which the kinematics has.
        force = scale(tape, c_x, motion.along_x(tape, segment.rotation))
    return Wrench(force, (nx, ny, nz))


def inward(
    tape: Scalars, chain: SerialChain, motions: Sequence[Motion]
) -> tuple[Wrench, list[sp.Expr]]:
    """∂S/∂θ̈ of the chain (eq. 5) at given motions.

    Returns the sum of 𝒮 and ℛ over the chain about the root, in the root's carrier, without the
    root's B₀r̈, which the caller adds, and the row of each joint after the root.
    """
    rows: list[sp.Expr] = []
    wrench = NO_WRENCH
    for k in range(len(chain.segments) - 1, -1, -1):
        with tape.group(f"inertia forces of {chain.carried_about(k)}"):
            wrench = link_wrench(tape, chain, k, motions[k]).plus(tape, wrench)
            wrench = chain.to_carrier(tape, k, wrench)
        if k > 0:
            rows.append(chain.segments[k].row(wrench))
            with tape.group(f"inertia forces of {chain.carried_about(k - 1)}"):
                wrench = chain.passed_in(tape, k, wrench)
    return wrench, rows[::-1]


def composites(tape: Scalars, chain: SerialChain) -> list[Inertia]:
    """Inertia of each segment with all that it carries, about its joint, in its carrier."""
    return list(_composites_inward(tape, chain))[::-1]


def _composites_inward(tape: Scalars, chain: SerialChain) -> Iterator[Inertia]:
    composite = NO_INERTIA
    for k in range(len(chain.segments) - 1, -1, -1):
        with tape.group(f"composite inertia of {chain.carried_about(k)}"):
            own = chain.working_inertia(tape, k)
            if k + 1 < len(chain.segments):
                own = own.plus(tape, chain.passed_in(tape, k + 1, composite))
            composite = chain.to_carrier(tape, k, own)
        yield composite


def joint_columns(
    tape: Scalars, chain: SerialChain
) -> tuple[Inertia, list[Wrench], dict[tuple[int, int], sp.Expr]]:
    """Columns of the mass matrix for the joints after the root.

    Returns the composite of all segments, the wrench of each column about the root, in the root's
    carrier, and the entries (j, k) of the rows j ≤ k. From the tip inwards, a few joints at a time,
    every column is carried past them before the next few, so that the same statements follow one
    another once a column.
    """
    last = len(chain.segments) - 1
    inertias: dict[int, Inertia] = {}
    columns: dict[int, Wrench] = {}
    entries: dict[tuple[int, int], sp.Expr] = {}
    inward = _composites_inward(tape, chain)
    for end in range(last, -1, -_JOINTS_AT_ONCE):
        start = max(end - _JOINTS_AT_ONCE + 1, 0)
        inertias.update(zip(range(end, start - 1, -1), inward, strict=False))
        for k in range(max(start, 1), last + 1):
            nearest = chain.segments[max(start, 1)].joint_name
            with tape.group(f"mass matrix, columns of the joints carried in to {nearest}"):
                for j in range(min(k, end), start - 1, -1):
                    columns[k] = _carried_column(tape, chain, j, k, inertias, columns)
                    entries[j, k] = chain.segments[j].row(columns[k])
    return inertias[0], [columns[k] for k in range(1, last + 1)], entries


def _carried_column(
    tape: Scalars,
    chain: SerialChain,
    j: int,
    k: int,
    inertias: Mapping[int, Inertia],
    columns: Mapping[int, Wrench],
) -> Wrench:
    """Column k about joint j, from where it began if j is k, or from about joint j + 1."""
    if j == k:
        turns = chain.segments[k].joint == "revolute"
        return inertias[k].response(tape, ANGULAR + Z if turns else LINEAR + Z)
    return chain.to_carrier(tape, j, chain.passed_in(tape, j + 1, columns[k]))


def chain_gibbs_function(tape: Scalars, chain: SerialChain, motions: Sequence[Motion]) -> sp.Expr:
    """Σ of eq. 2 over the chain's links, at given motions."""
    terms = []
    for k, motion in enumerate(motions):
        with tape.group(f"Gibbs function of {chain.segments[k].name}"):
            values = chain.working_inertia(tape, k).values
            values.update(zip(ACCELERATION, motion.acceleration, strict=True))
            values.update(zip(OMEGA, motion.omega, strict=True))
            values.update(zip(OMEGA_DOT, motion.omega_dot, strict=True))
            terms.append(tape.let(link_gibbs_function().xreplace(values)))
    with tape.group("sum over the links"):
        return tape.let(sp.Add(*terms))
