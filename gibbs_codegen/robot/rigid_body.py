"""Inertias of bodies: as a matrix, and which of them, and which sizes, a body can have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.model import Body, Robot, Rod
from gibbs_codegen.robot.names import link_label

# Rounding of decimal input: 21.2e-8 + 190.8e-8 may exceed 212e-8 by a unit in the last place.
_TOLERANCE = 1e-9


def inertia_matrix(inertia: Sequence[float]) -> NDArray[np.float64]:
    """The matrix (3, 3) of inertia xx, yy, zz, xy, xz, yz, with xy = −∫ xy dm."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def inertia_fault(mass: float, inertia: Sequence[float]) -> str | None:
    """Why no body has a certain inertia about its centre of mass, kg m²; None if one has.

    An inertia matrix J belongs to a mass distribution if and only if the matrix of its second
    moments E = ½ tr(J)·1 − J is positive semidefinite, which is the triangle inequality between
    principal moments, positive semidefiniteness of J included. `inertia` holds xx, yy, zz, xy, xz,
    yz.
    """
    scale = max(abs(entry) for entry in inertia)
    if scale == 0.0:
        return None
    if mass == 0.0:
        return "is not zero although the body has no mass (a rod needs length and mass_per_length)"
    matrix = inertia_matrix(inertia) / scale
    if np.linalg.eigvalsh(matrix)[0] < -_TOLERANCE:
        return "has a negative principal moment; an inertia matrix is positive semidefinite"
    second_moments = 0.5 * np.trace(matrix) * np.eye(3) - matrix
    if np.linalg.eigvalsh(second_moments)[0] < -_TOLERANCE:
        return (
            "violates the triangle inequality: no principal moment may exceed the sum of the "
            "other two"
        )
    return None


def body_fault(body: Body) -> str | None:
    """Why no body has the inertia that a rod or rigid body is given; None if one has."""
    if isinstance(body, Rod):
        return inertia_fault(body.total_mass, (*body.section_inertia, 0.0, 0.0, 0.0))
    found = inertia_fault(body.mass, body.inertia)
    xx, xy, xz, yy, yz, zz = body.inertia
    if found and not inertia_fault(body.mass, (xx, yy, zz, xy, xz, yz)):
        return (
            "must be in the order xx, yy, zz, xy, xz, yz, and seems to be in that of URDF, xx, xy, "
            f"xz, yy, yz, zz; as it stands it {found}"
        )
    return found


def named_bodies(robot: Robot) -> list[tuple[str, Body]]:
    """All bodies with what they are called in messages."""
    bodies: list[tuple[str, Body]] = [("the base", robot.base.body)] if robot.base.body else []
    bodies += [(f"base arm {k}", arm) for k, arm in enumerate(robot.base.arms, start=1)]
    return bodies + [
        (link_label(robot, i), link.body) for i, link in enumerate(robot.links, start=1)
    ]


def impossible_inertias(robot: Robot) -> tuple[str, ...]:
    """Warnings of inertias that no body has and that the robot file lets pass, with the body."""
    faults = [(label, body_fault(body)) for label, body in named_bodies(robot)]
    return tuple(f"{label}: its inertia {fault}" for label, fault in faults if fault)


# Squares, and products of a few, are far from overflow and underflow.
LEAST, MOST = 1e-50, 1e50


def size_fault(value: float) -> str | None:
    """Why a finite number of a robot, in its SI unit, cannot be computed with; None if it can."""
    if value == 0.0 or LEAST <= abs(value) <= MOST:
        return None
    what = "overflow" if abs(value) > MOST else "vanish"
    return f"must be 0 or from {LEAST:g} to {MOST:g} in size, not {value:g}, whose products {what}"
