"""Contact of frames with surfaces, as array programs: a yielding normal and a bristle across it.

A ball about the origin of a frame is d deep behind a surface, which pushes it out with the force

    N = k d (1 + c ḋ) + b ḋ,   at least 0, and 0 where d is not above 0,

of the stiffness k, N/m, the dissipation c, s/m (Hunt and Crossley, 1975), and the damping b, N s/m.

Along the surface a bristle, a spring s and a damper g side by side, joins the ball to a point of
the surface. With the displacement z of the bristle (3) and the velocity v at which the ball moves
along the surface, p = -(s z + g v) is the force on the ball while the point sticks. It sticks while
|p| is not above μ N; otherwise it slides at the velocity that leaves |p| = μ N:

    ż = v - w,   w = (1 - μ N / |p|) (s z + g v) / g where it slides, and 0 where it sticks.

So nothing creeps, the force never leaves Coulomb's cone, and what slides slides against its force:
the energy of bristles is ½ s z², of which a point that slides or lets go only loses. Without a
load z decays with the time constant g / s. No rate is faster than s / g besides those of mass,
spring and damper, so that equal steps can follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from gibbs_codegen.arrays.nodes import (
    Node,
    choose,
    constant,
    cross,
    dot,
    join,
    maximum,
    minimum,
    square_root,
    zeros,
)
from gibbs_codegen.machine.surroundings import origin_of

# Of figures of a shape and a place (3), how deep that is behind its surface, m, and the unit normal
# (3) out of it there.
Surface = Callable[[Node, Node], tuple[Node, Node]]
# Figures of a wall before those of its shape: the ball's radius, stiffness, damping, dissipation,
# friction, and stiffness and damping of bristles.
FIGURES = 7
# The square of a force, N², that is none.
_NOTHING = 1e-18


def plane(figures: Node, place: Node) -> tuple[Node, Node]:
    """The surface of a plane, whose figures are a point (3), m, and the unit normal (3)."""
    normal = figures[3:6]
    return dot(normal, figures[:3] - place), normal


@dataclass(frozen=True)
class Contact:
    """A frame that may touch a wall, by their numbers; it `sticks` where there is friction.

    The shape of the wall has a `surface` and so many `figures`.
    """

    frame: int
    wall: int
    surface: Surface
    figures: int
    sticks: bool = False


class Touch(NamedTuple):
    """The effect of a contact, in world axes.

    The force `normal` along the unit `direction` (3), N, the `friction` (3), N, at which velocity
    the point of the surface slides, `slip` (3), m/s, 0 where nothing presses, and how deep the ball
    is, `depth`, m; the `wrench` (6) on the frame, and the `rate` (3) of the bristle. `eased` is the
    part of the normal force by damping, N, `stored` the energy of spring and bristle, J.
    """

    normal: Node
    direction: Node
    friction: Node
    slip: Node
    depth: Node
    wrench: Node
    rate: Node
    eased: Node
    stored: Node

    @property
    def series(self) -> Node:
        """Series that flights record (8): normal force, friction, slip and depth."""
        return join(self.normal, self.friction, self.slip, self.depth)


def touch(contact: Contact, wall: Node, moving: tuple[Node, Node], bristle: Node) -> Touch:
    """A contact of a wall with figures, and of a frame with a pose (4, 4) and a velocity (6).

    `bristle` (3), m, is the displacement of one that sticks.
    """
    pose, velocity = moving
    ball, stiffness, damping, dissipation, friction, holds, eases = (
        wall[i] for i in range(FIGURES)
    )
    behind, normal = contact.surface(wall[FIGURES:], origin_of(pose))
    depth = behind + ball
    inwards = -dot(normal, velocity[:3])
    pressed = stiffness * depth * (1.0 + dissipation * inwards) + damping * inwards
    pressed = choose(depth, 0.0, maximum(pressed, 0.0), 0.0)
    inside = maximum(depth, 0.0)
    eased, spring = maximum(pressed - stiffness * inside, 0.0), 0.5 * stiffness * inside * inside
    lever = -ball * normal
    along = velocity[:3] + cross(velocity[3:], lever) + inwards * normal
    if not contact.sticks:
        none, slip = zeros(3), choose(pressed, 0.0, along, 0.0)
        wrench = join(pressed * normal, none)
        return Touch(pressed, normal, none, slip, depth, wrench, none, eased, spring)
    across = bristle - dot(bristle, normal) * normal
    pull = holds * across + eases * along
    size = square_root(maximum(dot(pull, pull), _NOTHING))
    share = minimum(friction * pressed / size, 1.0)
    drag = -share * pull
    slip = (1.0 - share) / eases * pull
    # What a normal that turns leaves of the bristle beside the surface is lost as without a load.
    rate = along - slip - holds / eases * (bristle - across)
    wrench = join(pressed * normal + drag, cross(lever, drag))
    slip = choose(pressed, 0.0, slip, 0.0)
    stored = spring + 0.5 * holds * dot(bristle, bristle)
    return Touch(pressed, normal, drag, slip, depth, wrench, rate, eased, stored)


def bristles_of(contacts: tuple[Contact, ...]) -> int:
    """Number of entries of the bristles of contacts."""
    return 3 * sum(contact.sticks for contact in contacts)


def bristle_parts(contacts: tuple[Contact, ...], bristles: Node) -> list[Node]:
    """For each contact its bristle (3) of those of all, zero where there is none."""
    parts, place = [], 0
    for contact in contacts:
        parts.append(bristles[place : place + 3] if contact.sticks else constant([0.0] * 3))
        place += 3 * contact.sticks
    return parts
