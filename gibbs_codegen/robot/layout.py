"""The layout of coordinates: where the entries of q, v and a stand, and what each of them is.

With Tait–Bryan angles q is θ₋₁, θ₀, θ₁, the arm's joints, x, y, z, and v and a have the same
places. Among the hybrid unknowns the constrained angles θ₂ … θ_N follow θ₁.

A generated module tells the kind of a joint by the name of its coordinate: θ is an angle, d a
travel. Only this module writes and reads names in that way.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.model import JointKind, Robot
from gibbs_codegen.robot.names import JOINT_LETTERS, coordinate_of

Entry = TypeVar("Entry")

ATTITUDE = ("theta_m1", "theta_0", "theta_1")
POSITION = ("x", "y", "z")


class JointTerms(NamedTuple):
    """The letter of a joint's coordinate, its unit, and the unit of the effort that drives it."""

    letter: str
    unit: str
    effort_unit: str


JOINT_TERMS: dict[JointKind, JointTerms] = {
    "revolute": JointTerms(JOINT_LETTERS["revolute"], "rad", "N m"),
    "prismatic": JointTerms(JOINT_LETTERS["prismatic"], "m", "N"),
}


def joint_pattern(kind: JointKind) -> str:
    """Names of the coordinates of a kind of joint.

    Args:
        kind: The kind.

    Returns:
        A regular expression that they match as a whole.
    """
    return rf"{JOINT_TERMS[kind].letter}_[0-9]{{1,4}}"


def joint_kind(name: str) -> JointKind | None:
    """Kind of the joint that a coordinate belongs to.

    Args:
        name: Name of the coordinate.

    Returns:
        The kind, or None for a name that no joint has.
    """
    for kind in JOINT_TERMS:
        if re.fullmatch(joint_pattern(kind), name):
            return kind
    return None


@dataclass(frozen=True)
class Places:
    """Where the base's attitude, the joints and the base's position stand in q, v and a.

    The base's own entries, taken by themselves, are those of attitude and then of position.
    """

    attitude: slice
    joints: slice
    position: slice

    @classmethod
    def of_joints(cls, joints: int) -> Places:
        """Places of the coordinates of a base with joints.

        Args:
            joints: Number of joints, n.

        Returns:
            The places in q.
        """
        first = len(ATTITUDE)
        end = first + joints
        return cls(slice(0, first), slice(first, end), slice(end, end + len(POSITION)))

    @property
    def size(self) -> int:
        """Number of all entries."""
        size: int = max(self.attitude.stop, self.joints.stop, self.position.stop)
        return size

    @property
    def base(self) -> list[int]:
        """Places of attitude and position: the coordinates that thrusts act on."""
        every = range(self.size)
        return [*every[self.attitude], *every[self.position]]

    @property
    def joint_places(self) -> list[int]:
        """Places of the joints, from the base outwards."""
        return [*range(self.size)[self.joints]]

    def split(self, values: Sequence[Entry]) -> tuple[list[Entry], list[Entry]]:
        """The values of the base and those of the joints.

        Args:
            values: A value for each coordinate.

        Returns:
            Six values of the base, attitude first, and n of the joints.
        """
        return [values[place] for place in self.base], [*values[self.joints]]

    def joined(self, base: Sequence[Entry], joints: Sequence[Entry]) -> list[Entry]:
        """Values of the base and of the joints in the order of the coordinates.

        Args:
            base: Six values, those of the attitude first.
            joints: A value for each joint.

        Returns:
            A value for each coordinate.
        """
        values = dict(zip(self.base, base, strict=True))
        values |= zip(self.joint_places, joints, strict=True)
        return [values[place] for place in range(self.size)]


@dataclass(frozen=True)
class Layout(Places):
    """Places, names and units of the coordinates of one robot.

    `names` and `units` (rad or m) are those of the entries of q; the rates have the same names.
    `constrained` are the places of the constrained angles θ₂ … θ_N among the hybrid unknowns, and
    its start is the place in q that they are put in at.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    constrained: slice

    @classmethod
    def of(cls, names: Sequence[str], constrained: int) -> Layout:
        """Layout of coordinates that are given by name, as a generated module lists them.

        Args:
            names: Names of the entries of q, in order.
            constrained: Number of constrained angles, N − 1.

        Returns:
            The layout.

        Raises:
            UsageError: If the names are not those of a base with joints.
        """
        own = (*ATTITUDE, *POSITION)
        places = Places.of_joints(len(names) - len(own))
        kinds = [joint_kind(name) or "revolute" for name in names[places.joints]]
        known = [kind for kind in kinds if kind is not None]
        if len(names) < len(own) or places.split(names)[0] != [*own] or known != kinds:
            raise UsageError(
                f"the coordinates {', '.join(names)} are not {', '.join(ATTITUDE)}, the joints "
                f"(theta_… or d_…) and {', '.join(POSITION)}"
            )
        base = ["rad"] * len(ATTITUDE) + ["m"] * len(POSITION)
        units = places.joined(base, [JOINT_TERMS[kind].unit for kind in known])
        first = places.attitude.stop
        return cls(
            places.attitude,
            places.joints,
            places.position,
            tuple(names),
            tuple(units),
            slice(first, first + constrained),
        )

    @property
    def middle_angle(self) -> int:
        """Place of θ₀, the attitude angle at whose ±90° the sequence is singular."""
        return range(self.size)[self.attitude][1]

    @property
    def effort_units(self) -> tuple[str, ...]:
        """Units of what drives the joints: N m of a torque, N of a force."""
        by_unit = {terms.unit: terms.effort_unit for terms in JOINT_TERMS.values()}
        return tuple(by_unit[unit] for unit in self.units[self.joints])

    @property
    def free(self) -> list[int]:
        """Places of the entries of q among the hybrid unknowns."""
        first, after = self.constrained.start, self.constrained.stop
        return [*range(first), *range(after, after + self.size - first)]


def layout_of(robot: Robot) -> Layout:
    """Layout of the coordinates of a robot.

    Args:
        robot: The robot.

    Returns:
        The layout.
    """
    joints = [coordinate_of(robot, i) for i in robot.moving]
    names = Places.of_joints(len(joints)).joined((*ATTITUDE, *POSITION), joints)
    held = max(robot.base.rotors - 1, 0) + len(robot.constrained)
    return Layout.of(names, held)
