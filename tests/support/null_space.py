"""What nothing resists: the null space of the mass matrix that Newton and Euler's equations give.

It does not depend on how heavy bodies are, so each is given the mass of 1 kg first: the mass matrix
of very unequal ones would be singular but for rounding whether or not there is such a motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import Body
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from support.degenerate_robots import sized

# Of the mass matrix by the sizes of its terms: rounding leaves 1e-15 where nothing resists, while
# the least of a thousand regular machines was 8e-10.
SMALLEST = 1e-13
CONFIGURATIONS = 5


def equally_heavy(robot: Robot) -> Robot:
    """The robot with every body that has a mass scaled to 1 kg."""
    base = replace(robot.base, arms=tuple(_unit(body) for body in robot.base.arms))
    links = tuple(replace(link, body=_unit(link.body)) for link in robot.links)
    return replace(robot, base=base, links=links)


def _unit(body: Body) -> Body:
    return sized(body, 1.0 / body.total_mass, 1.0) if body.total_mass > 0.0 else body


def smallest_eigenvalue(robot: Robot) -> tuple[float, np.ndarray]:
    """The largest over some configurations, with how much each coordinate moves with nothing."""
    tree = Tree(equally_heavy(robot))
    states = States.random(tree, CONFIGURATIONS, 0)
    matrices = NewtonEuler(tree).mass_matrix(states.q)[:, tree.free][:, :, tree.free]
    found = []
    # Not by the diagonal, which may be rounding alone.
    for matrix, unit in zip(matrices, Sizes(tree, states).free_units, strict=True):
        eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(unit, unit))
        null = vectors[:, eigenvalues < SMALLEST]
        found.append((float(eigenvalues[0]), np.linalg.norm(null, axis=1)))
    return max(found, key=lambda pair: pair[0])


def unresisted(robot: Robot) -> set[str]:
    """Names of the coordinates that take part in motions that nothing resists.

    The attitude is named as one. The position is only named where the attitude is not, since the
    origin follows where the machine turns about another point.
    """
    _, shares = smallest_eigenvalue(robot)
    taking_part = [
        c.name for c, s in zip(Description(robot).coordinates, shares, strict=True) if s > 1e-5
    ]
    return short_names(taking_part)


def short_names(names: Iterable[str]) -> set[str]:
    """Coordinates named by a message or by q, with the attitude and the position as one."""
    short = set()
    for name in names:
        if name in ("theta_m1", "theta_0", "theta_1") or name.startswith("the attitude"):
            short.add("attitude")
        elif name in ("x", "y", "z") or name.startswith("the position"):
            short.add("position")
        else:
            short.add(name.split()[0])
    return short - {"position"} if "attitude" in short else short
