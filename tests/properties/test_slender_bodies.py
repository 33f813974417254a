"""Bodies of any shape keep their digits: needles, plates and what prepare turns one into."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from support.high_precision import DIGITS, evaluated, prepared

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.nodes import ScalarProgram
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.verification.tree import WORLD, Tree

Array = np.ndarray
LARGE = 0.006
SPHERE = RigidBody(0.3, 1.0, inertia=(LARGE, LARGE, LARGE, 0.0, 0.0, 0.0))


def carrying(body: RigidBody, alpha_deg: int, joint: str) -> Robot:
    """A robot whose arm weighs nothing but for `body` at its end."""
    links = (
        Link(Rod(length=0.0)),
        Link(Rod(length=0.2), alpha_deg=Fraction(90)),
        Link(body, alpha_deg=Fraction(alpha_deg), joint=joint),
    )
    return Robot("slender", paper_family(4, 0).base, links)


def shapes() -> list[tuple[float, float, float]]:
    """Principal moments of needles along each axis, and of plates, down to a billionth as thick."""
    found = []
    for axis in range(3):
        for thin in (1.02e-6, 1e-8, 1e-9, 1e-12):
            needle = [LARGE] * 3
            needle[axis], needle[axis - 1] = thin, LARGE + 0.3 * thin
            plate = [thin + LARGE / 7, LARGE / 3, LARGE / 7 + LARGE / 3]
            found += [tuple(needle), tuple(np.roll(plate, axis))]
    return found


def terms(robot: Robot, q: Array) -> Array:
    """Sizes of the terms that each entry of the mass matrix is a sum of.

    They are, body by body, mass times levers, and the entries of the inertia matrix about the
    centre of mass times angular velocities in the body's frame.
    """
    tree = Tree(robot)
    rotations, _, steps = tree.frames(tree.spread(q[None]))
    found = np.zeros((tree.size, tree.size))
    for number, body in enumerate(tree.joints):
        levers, spins = np.zeros(tree.size), np.zeros((3, tree.size))
        lever = rotations[number][0] @ body.com
        inboard = number
        while inboard != WORLD:
            joint = tree.joints[inboard]
            levers[joint.place] = np.linalg.norm(lever) if joint.revolute else 1.0
            if joint.revolute:
                axis = rotations[inboard][0][:, joint.axis]
                spins[:, joint.place] = np.abs(rotations[number][0].T @ axis)
            lever = lever + steps[inboard][0]
            inboard = joint.parent
        found += body.mass * np.outer(levers, levers)
        found += spins.T @ np.abs(body.inertia) @ spins
    return found[np.ix_(tree.free, tree.free)]


def exact_mass_matrix(program: ScalarProgram, parameters: dict[str, float], q: Array) -> Array:
    """The mass matrix in many digits."""
    with mpmath.workdps(DIGITS):
        function = program.function("mass_matrix")
        (entries,) = evaluated(program, function, prepared(program, parameters), {"q": q})
        return np.array([entry.value for entry in entries]).reshape(len(q), len(q))


def largest_error(found: Array, exact: Array, size: Array) -> float:
    """Error in units of the terms; what has no terms is to be zero."""
    with mpmath.workdps(DIGITS):
        error = np.abs(exact - found.astype(object)).astype(float)
    return float(np.divide(error, size, out=np.where(error > 0, np.inf, 0.0), where=size > 0).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("alpha_deg", "joint"),
    [(90, "revolute")],
)
def test_mass_matrix_keeps_its_digits(alpha_deg: int, joint: str) -> None:
    """Also where prepare makes a needle or a plate of a sphere."""
    model = derive(carrying(SPHERE, alpha_deg, joint))
    rng = np.random.default_rng(alpha_deg)
    for moments in shapes():
        robot = carrying(RigidBody(0.3, 1.0, inertia=(*moments, 0, 0, 0)), alpha_deg, joint)
        values = [f"link3_inertia_{axes}" for axes in ("xx", "yy", "zz")]
        parameters = model.defaults | dict(zip(values, moments, strict=True))
        for q in (np.zeros(9), rng.uniform(-1.2, 1.2, 9)):
            (entries,) = model.program.evaluate("mass_matrix", parameters, {"q": q.tolist()})
            exact = exact_mass_matrix(model.program, parameters, q)
            found = np.array(entries).reshape(9, 9)
            assert largest_error(found, exact, terms(robot, q)) <= 1e-14, (moments, q)
            if joint == "revolute":
                assert abs(found[5, 5] - moments[2]) <= 3e-16 * moments[2]
