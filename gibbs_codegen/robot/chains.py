"""Decomposition into open chains (eq. 1, Fig. 2) and their numbering, as plain data.

The robot with N rotors and n links falls into N open chains, each starting at the virtual links:
chain j = 1 … N−1 is arm −1 → arm 0 → arm 1 → arm j+1, chain N is arm −1 → arm 0 → arm 1 → arm N+1
→ … → arm N+n. *Mass once*: arm 1 has its mass in chain 1 only. *Thrust once*: motor 1 acts in
chain 1 only.
"""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.robot.coordinates import (
    constrained_coordinate,
    constraint_torque,
    hybrid_coordinates,
)
from gibbs_codegen.robot.layout import Layout, layout_of
from gibbs_codegen.robot.model import Robot


@dataclass(frozen=True)
class Chain:
    """One open chain: its links by arm number, its unknowns in order, and what acts in it.

    `massive` holds the links that have their mass in this chain, `motors` those that push in it.
    `coordinates` are those that velocities and accelerations have, by name. `unknowns` are their
    accelerations and, where it is constrained, its constraint torque: the seven coordinates and
    eight unknowns of eq. 15.
    """

    number: int
    links: tuple[int, ...]
    massive: tuple[int, ...]
    motors: tuple[int, ...]
    coordinates: tuple[str, ...]
    unknowns: tuple[str, ...]

    @property
    def is_constrained(self) -> bool:
        """Whether the chain ends in a base arm that is held against arm 1."""
        return len(self.unknowns) > len(self.coordinates)


def decompose(robot: Robot) -> tuple[Chain, ...]:
    """Open chains that a robot falls into (eq. 1).

    Args:
        robot: The robot, of N rotors.

    Returns:
        The N chains, in order.
    """
    base = tuple(_base_chain(robot, j) for j in range(1, robot.rotors))
    return (*base, _arm_chain(robot))


def _base_chain(robot: Robot, j: int) -> Chain:
    arm = j + 1
    own = constrained_coordinate(arm)
    coordinates = Layout.of(robot.base.attitude, [own.name], [own.unit], 0).v.names
    return Chain(
        number=j,
        links=(-1, 0, 1, arm),
        massive=(1, arm) if j == 1 else (arm,),
        motors=(1, arm) if j == 1 else (arm,),
        coordinates=coordinates,
        unknowns=(*coordinates, constraint_torque(arm).name),
    )


def _arm_chain(robot: Robot) -> Chain:
    arms = tuple(robot.rotors + i for i in range(1, len(robot.links) + 1))
    coordinates = layout_of(robot).v.names
    return Chain(robot.rotors, (-1, 0, 1, *arms), arms, (), coordinates, coordinates)


def coupling_map(robot: Robot) -> tuple[tuple[int, ...], ...]:
    """Where the unknowns of each chain stand among the hybrid ones (eq. 18, Figs. 6–9).

    Args:
        robot: The robot.

    Returns:
        For each chain the place of each of its unknowns. Places count from 0; the method counts its
        rows from −1.
    """
    place = {unknown.name: i for i, unknown in enumerate(hybrid_coordinates(robot))}
    return tuple(tuple(place[name] for name in chain.unknowns) for chain in decompose(robot))
