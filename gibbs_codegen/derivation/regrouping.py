"""Regrouping: each parent is given the inertia of its children that their joints do not move.

A joint only feels part of the inertia of its link. The rest moves with the parent whatever the
joint does, so it is added to the parent once, in parameters alone, and what is left has zeros that
shorten every recursion.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import axis_vector, moved


def regrouped(tape: Scalars, tree: SegmentTree) -> SegmentTree:
    """The tree with regrouped inertias, from the leaves to the root; it moves as before.

    Inertia passes between the links' own frames. What a revolute joint does not move is symmetric
    about its axis and need not be turned; what a prismatic joint does not move is turned by the
    fixed angle of the link.
    """
    segments = list(tree.segments)
    for k in range(len(segments) - 1, 0, -1):
        segment = segments[k]
        parent = segments[segment.parent]
        unmoved = f"that of {segment.name} which {segment.joint_name} does not move"
        with tape.group(f"inertia of {parent.name}, with {unmoved}", Stage.PARAMETER):
            if segment.joint == "revolute":
                own, given = split_revolute(segment.inertia)
                given = given.shifted(tape, axis_vector(2, segment.d))
            else:
                own, given = split_prismatic(segment.inertia)
                given = given.rotated(tape, segment.offset)
            given = moved(tape, given, [segment.twist, segment.step, segment.turn])
            segments[k] = replace(segment, inertia=own)
            segments[segment.parent] = replace(parent, inertia=parent.inertia.plus(tape, given))
    return SegmentTree(tuple(segments))


def split_revolute(inertia: Inertia) -> tuple[Inertia, Inertia]:
    """What a revolute joint about z moves of a link, and what goes to its parent.

    The inertia is about the joint, in the link's own frame. Mass on the joint's axis does not
    notice the joint: the mass itself, the first moment along z and the second moment along z are
    the parent's.
    """
    (x, y, z), (xx, yy, zz, xy, xz, yz) = inertia.moment, inertia.second
    zero = sp.S.Zero
    own = Inertia(zero, (x, y, zero), (xx, yy, zero, xy, xz, yz))
    given = Inertia(inertia.mass, (zero, zero, z), (zero, zero, zz, zero, zero, zero))
    return own, given


def split_prismatic(inertia: Inertia) -> tuple[Inertia, Inertia]:
    """What a prismatic joint moves of a link, and what goes to its parent.

    The link turns with its parent, so its second moments about the joint are the parent's.
    """
    own = replace(inertia, second=NO_INERTIA.second)
    return own, replace(NO_INERTIA, second=inertia.second)
