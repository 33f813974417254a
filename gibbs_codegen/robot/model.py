"""The robot as plain frozen data: what a robot file says, checked, with its defaults filled in.

SI units throughout: kg, m, s; angles in degrees where a name ends in `_deg`. Nothing here knows
SymPy. Lengths and masses are floats; angles are exact fractions of a degree, since they are
structural: they decide which terms exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, get_args

Vector3 = tuple[float, float, float]
JointKind = Literal["revolute", "prismatic"]
Origin = Literal["motor1", "centre"]
Attitude = Literal["xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "quaternion"]

ATTITUDES: tuple[Attitude, ...] = get_args(Attitude)
# The intrinsic sequences of Tait–Bryan angles.
SEQUENCES = ATTITUDES[:-1]
ORIGINS: tuple[Origin, ...] = get_args(Origin)
JOINT_KINDS: tuple[JointKind, ...] = get_args(JointKind)
MAX_ROTORS = 256
MAX_LINKS = 64
AXES: dict[str, Vector3] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Rod:
    """A straight rod along x from the link's joint, with the inertia of its cross-section (B₃).

    `length` in m, `mass_per_length` in kg/m, `section_inertia` the diagonal about the centre of
    mass in kg m².
    """

    length: float
    mass_per_length: float = 0.0
    section_inertia: Vector3 = (0.0, 0.0, 0.0)

    @property
    def total_mass(self) -> float:
        """Mass in kg."""
        return self.length * self.mass_per_length


@dataclass(frozen=True)
class RigidBody:
    """Any rigid body: `mass` in kg, `com` in m, `inertia` in kg m².

    `inertia` holds xx, yy, zz, xy, xz, yz of the inertia matrix about the centre of mass in link
    axes (xy = −∫ xy dm). `length` in m is the distance along x to what comes next: a motor, a
    joint or the tip.
    """

    length: float
    mass: float
    com: Vector3 = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def total_mass(self) -> float:
        """Mass in kg."""
        return self.mass


Body = Rod | RigidBody


def as_rigid_body(body: Body) -> RigidBody:
    """The same body by mass, centre of mass and inertia about it.

    Args:
        body: A rod or rigid body.

    Returns:
        The rigid body.
    """
    if isinstance(body, RigidBody):
        return body
    mass, (xx, yy, zz) = body.total_mass, body.section_inertia
    slender = mass * body.length**2 / 12
    inertia = (xx, yy + slender, zz + slender, 0.0, 0.0, 0.0)
    return RigidBody(body.length, mass, (body.length / 2, 0.0, 0.0), inertia)


@dataclass(frozen=True)
class Link:
    """A link of the arm with the joint that carries it (modified Denavit–Hartenberg, Craig).

    The link's frame relative to its parent's is Rot_x(α)·Trans_x(a)·Rot_z(θ)·Trans_z(d); a
    revolute joint adds its angle to θ, a prismatic one its travel to d. `a` is None where the
    file leaves it to the length of the link before.
    """

    body: Body
    alpha_deg: Fraction = Fraction(0)
    a: float | None = None
    d: float = 0.0
    theta_deg: Fraction = Fraction(0)
    joint: JointKind = "revolute"


@dataclass(frozen=True)
class Base:
    """The flying base: N arms, rigid to each other, with a motor at the end of each.

    `thrust` holds a unit direction per motor in its arm's frame, `drag` the reaction torque about
    that direction per unit of thrust, in m. `arms` has one entry when all arms share one table,
    else N.
    """

    rotors: int
    arms: tuple[Body, ...]
    thrust: tuple[Vector3, ...]
    drag: tuple[float, ...]
    attitude: Attitude = "xyz"
    origin: Origin = "motor1"

    @property
    def shares_one_arm(self) -> bool:
        """Whether one table serves all arms."""
        return len(self.arms) == 1

    def arm(self, k: int) -> Body:
        """Body of a base arm.

        Args:
            k: Number of the arm, from 1 to N.

        Returns:
            The body, in the arm's frame.
        """
        return self.arms[0] if self.shares_one_arm else self.arms[k - 1]

    def arm_angle_deg(self, k: int) -> Fraction:
        """Constrained angle θ_k of a base arm against arm 1: −180° + 360°(k−1)/N.

        Args:
            k: Number of the arm, from 2 to N.

        Returns:
            The angle in degrees.
        """
        return Fraction(-180) + Fraction(360 * (k - 1), self.rotors)


@dataclass(frozen=True)
class Robot:
    """An aerial manipulator: a base with N rotors and a serial arm of n links at its centre."""

    name: str
    base: Base
    links: tuple[Link, ...] = ()
    gravity: float = 9.81

    @property
    def rotors(self) -> int:
        """N, the number of rotors and of open chains."""
        return self.base.rotors

    @property
    def total_mass(self) -> float:
        """Mass of the whole robot in kg."""
        arms = sum(self.base.arm(k).total_mass for k in range(1, self.rotors + 1))
        return arms + sum(link.body.total_mass for link in self.links)


def alternating_thrust(rotors: int) -> tuple[Vector3, ...]:
    """Default directions: odd motors push along z, even motors along y of their arm's frame.

    Args:
        rotors: Number of rotors, N.

    Returns:
        A unit vector for each motor.
    """
    return tuple(AXES["y" if k % 2 else "z"] for k in range(rotors))
