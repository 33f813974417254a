"""The frames that links are derived in: z along the joint, and as short a step to it as can be.

A robot file places a link's joint anywhere on its parent, and its axis anywhere in the link. How
one joint axis lies against the one before is a turn γ about the parent's axis, a step, and a twist
α about x; what is left, a turn β about the link's own axis, adds to the joint's angle. A link's
frame may be turned about its axis, which makes γ of its first child zero, and slid along it, which
makes one component of the step zero: so an arm that a file gives by poses costs what it costs by
Denavit–Hartenberg parameters.

    R = R_z(γ)·R_x(α)·R_z(β)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.tree_builder import JointedLink
from gibbs_codegen.robot.model import JointKind, Vector3
from gibbs_codegen.symbolic.exact_angles import cos_sin_deg
from gibbs_codegen.symbolic.structural import (
    NO_TURN,
    Turn,
    applied,
    back,
    elementary,
    euler_zxz,
    product,
    turn_about,
    z_onto,
)
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import ZERO, Vector, X, Z, axis_vector

# Sliding along an axis that is nearly parallel to the one before would go very far.
_LEAST_SINE = 0.1


@dataclass(frozen=True)
class DenavitHartenberg:
    """The four parameters of a link: α and θ in degrees, a and d in symbols."""

    alpha_deg: Fraction
    a: sp.Expr
    d: sp.Expr
    theta_deg: Fraction

    @property
    def turn(self) -> Turn:
        """Rotation from the parent's frame to the link's, the joint at zero."""
        return product(turn_about(X, self.alpha_deg), turn_about(Z, self.theta_deg))

    @property
    def step(self) -> Vector:
        """From the parent's joint to the link's, in the parent's frame."""
        cos, sin = cos_sin_deg(self.alpha_deg)
        return (self.a, -sin * self.d, cos * self.d)


_AT_PARENT = DenavitHartenberg(Fraction(0), sp.S.Zero, sp.S.Zero, Fraction(0))


@dataclass(frozen=True)
class PlacedLink:
    """A link in symbols, where the robot file places it.

    `parent` is the index of the parent segment: 0 for the base, i for the i-th placed link. `turn`
    and `step` are the pose of the joint in the parent's frame, `axis` that of the joint in the
    link's. `inertia` is about the joint, in the link's own frame. A link that `parameters` place on
    a parent whose frame is the file's keeps the file's frame.
    """

    parent: int
    inertia: Inertia
    joint: JointKind
    coordinate: sp.Expr
    turn: Turn
    step: Vector
    axis: Vector3
    parameters: DenavitHartenberg | None
    name: str
    joint_name: str


@dataclass(frozen=True)
class BodyFrame:
    """Where the frame that the robot file gives a body is in a segment's own frame."""

    segment: int
    turn: Turn = NO_TURN
    origin: Vector = ZERO

    def direction(self, vector: Vector) -> Vector:
        """A direction of the body, in the segment's own frame."""
        return vector if self.turn == NO_TURN else applied(self.turn, vector)

    def point(self, tape: Scalars, vector: Vector) -> Vector:
        """A point of the body, from the segment's joint in its own frame (m), named on the tape."""
        x, y, z = self.direction(vector)
        a, b, c = self.origin
        return (tape.let(a + x), tape.let(b + y), tape.let(c + z))

    def inertia(self, tape: Scalars, inertia: Inertia) -> Inertia:
        """An inertia about the origin of the body's frame, about the joint in the segment's own."""
        for rotation in elementary(self.turn):
            inertia = inertia.rotated(tape, rotation)
        return inertia.shifted(tape, self.origin)

    def within(self, tape: Scalars, outer: BodyFrame) -> BodyFrame:
        """The frame, given in `outer`, as seen in what `outer` lies in."""
        turn = product(outer.turn, self.turn)
        return BodyFrame(outer.segment, turn, outer.point(tape, self.origin))


def framed(
    tape: Scalars, links: Sequence[PlacedLink], base: BodyFrame
) -> tuple[list[JointedLink], list[BodyFrame]]:
    """Choose the frames that links are derived in; every parent stands before its children.

    `base` says where the robot file's frame of the base is in that of the root segment. The second
    list says for the base and each link where the robot file's frame is.
    """
    turns = _turns(links)
    frames = [base]
    jointed = []
    for k, (link, turn) in enumerate(zip(links, turns, strict=True), start=1):
        with tape.group("angles and places of the joints", Stage.PARAMETER):
            made, frame = _framed(tape, link, turn, frames[link.parent], k)
        jointed.append(made)
        frames.append(frame)
    return jointed, frames


def _turns(links: Sequence[PlacedLink]) -> list[Turn | None]:
    """For each link its own axes in the robot file's, or None where it keeps the file's frame."""
    kept = [True]
    for link in links:
        kept.append(link.parameters is not None and kept[link.parent])
    turns: list[Turn | None] = []
    for k, link in enumerate(links, start=1):
        if kept[k]:
            turns.append(None)
            continue
        turn = z_onto(link.axis)
        first = next((child for child in links[k:] if child.parent == k), None)
        if first is not None:
            gamma, alpha, _ = euler_zxz(
                product(back(turn), product(first.turn, z_onto(first.axis)))
            )
            if alpha % 180 == 0:
                x, y, _ = applied(back(turn), first.step)
                gamma = Fraction(90 if x == 0 and y != 0 else 0)
            turn = product(turn, turn_about(Z, gamma))
        turns.append(turn)
    return turns


def _framed(
    tape: Scalars, link: PlacedLink, turn: Turn | None, parent: BodyFrame, segment: int
) -> tuple[JointedLink, BodyFrame]:
    """A link in its own frame, and where the file's frame is in that.

    `turn` are its own axes in the file's, or None where it keeps the file's frame; `parent` says
    where the file's frame of its parent is in the parent's own.
    """
    if turn is None:
        return _by_parameters(link, parent), BodyFrame(segment)
    gamma, alpha, beta = euler_zxz(product(parent.turn, product(link.turn, turn)))
    x, y, z = applied(turn_about(Z, -gamma), parent.point(tape, link.step))
    cos, sin = cos_sin_deg(alpha)
    slide = sp.S.Zero
    if sin == 0:
        slide, z = -cos * z, sp.S.Zero
    elif y != 0 and abs(sin) > _LEAST_SINE:
        slide, y, z = y / sin, sp.S.Zero, z + y * cos / sin
    frame = BodyFrame(segment, back(turn), axis_vector(Z, -tape.let(slide)))
    made = replace(
        _by_parameters(link, BodyFrame(parent.segment)),
        inertia=frame.inertia(tape, link.inertia),
        turn_deg=gamma,
        step=(x, y, z),
        d=sp.S.Zero,
        alpha_deg=alpha,
        theta_deg=beta,
    )
    return made, frame


def _by_parameters(link: PlacedLink, parent: BodyFrame) -> JointedLink:
    """A link where Denavit–Hartenberg parameters place it, if it has any, in the file's frame.

    The frame of its parent is not turned.
    """
    given = link.parameters or _AT_PARENT
    x, y, z = parent.origin
    return JointedLink(
        parent=link.parent,
        inertia=link.inertia,
        joint=link.joint,
        coordinate=link.coordinate,
        turn_deg=Fraction(0),
        step=(given.a + x, y, z),
        alpha_deg=given.alpha_deg,
        d=given.d,
        theta_deg=given.theta_deg,
        name=link.name,
        joint_name=link.joint_name,
    )
