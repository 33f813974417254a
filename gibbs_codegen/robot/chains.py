"""Decomposition into open chains (eq. 1, Fig. 2) and their numbering, as plain data.

A robot falls into open chains that start at the virtual links −1 and 0 and the base, arm 1. Each
rod k = 2 … N of the base is the end of a chain: arm −1 → arm 0 → arm 1 → arm k. So is each link
that carries no other, with all links on the way to it; link i is arm N + i. *Mass once*: what
several chains share has its mass in the first of them. *Thrust once*: a rotor acts in the first
chain that holds the body which it is on.

For the paper's robots these are chains j = 1 … N−1 of the rods, and chain N of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gibbs_codegen.robot.description import Description, constrained_coordinate, constraint_torque
from gibbs_codegen.robot.layout import Layout, joint_terms
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.robot.parts.numbers import BASE

_ROOT_ARMS = (-1, 0, 1)


@dataclass(frozen=True, kw_only=True)
class Chain:
    """One open chain: its arms by number, its unknowns in order, and what acts in it.

    `rod` is the number of the base rod at its end, or None; `path` are the numbers of its links,
    from the base outwards, and `own` those of links that have their mass in this chain;
    `has_core` says whether arm 1 has its own here too. `motors` are the rotors that push in it.
    `constrained` are numbers of the arms that constraint torques hold. `unknowns` are the
    accelerations of the chain's coordinates and those torques: the seven coordinates and eight
    unknowns of eq. 15.
    """

    number: int
    links: tuple[int, ...]
    rod: int | None = None
    path: tuple[int, ...] = ()
    own: tuple[int, ...] = ()
    has_core: bool
    motors: tuple[int, ...]
    constrained: tuple[int, ...]
    coordinates: tuple[str, ...]
    unknowns: tuple[str, ...]

    @property
    def massive(self) -> tuple[int, ...]:
        """Numbers of the arms that have their mass in this chain."""
        *_, last = self.links
        core = (1,) if self.has_core else ()
        if self.rod is not None:
            return (*core, self.rod)
        first = last - self.path[-1] if self.path else 0
        return (*core, *(first + i for i in self.own))

    @property
    def is_constrained(self) -> bool:
        """True if a torque holds a joint of the chain."""
        return bool(self.constrained)


def decompose(robot: Robot) -> tuple[Chain, ...]:
    """Open chains that a robot falls into (eq. 1), in order, with all joints that gears move."""
    robot = robot.ungeared
    chains: list[Chain] = []

    def add(joints: Sequence[tuple[str, str]], constrained: Sequence[int], **parts: Any) -> None:
        """Add a chain by names and units of its joints' coordinates, and the arms that are held."""
        names, units = zip(*joints, strict=True) if joints else ((), ())
        coordinates = Layout.of(robot.base.kind, names, units, 0).v.names
        unknowns = (*coordinates, *(constraint_torque(robot, arm).name for arm in constrained))
        parts |= {"coordinates": coordinates, "unknowns": unknowns}
        chains.append(Chain(number=len(chains) + 1, constrained=tuple(constrained), **parts))

    for k in range(2, robot.base.rotors + 1):
        held, motors = constrained_coordinate(robot, k), (1, k) if k == 2 else (k,)
        arms = (*_ROOT_ARMS, k)
        add([(held.name, held.unit)], [k], links=arms, rod=k, has_core=k == 2, motors=motors)
    # Numbers of the bodies whose mass is in a chain.
    counted: set[int] = {BASE} if chains else set()
    # The ways to links that carry no other, or one empty way.
    paths: list[tuple[int, ...]] = []
    for leaf in range(1, len(robot.links) + 1):
        if leaf not in robot.parents:
            way = [leaf]
            while (before := robot.parents[way[0] - 1]) != BASE:
                way.insert(0, before)
            paths.append(tuple(way))
    for path in paths or [()]:
        new = {BASE, *path} - counted
        counted |= new
        jointed = [i for i in path if i in robot.moving or i in robot.constrained]
        on_rods = [1] if robot.base.rotors and BASE in new else []
        add(
            [(coordinate_of(robot, i), joint_terms(robot, i).unit) for i in jointed],
            [robot.rotors + i for i in path if i in robot.constrained],
            links=(*_ROOT_ARMS, *(robot.rotors + i for i in path)),
            path=path,
            own=tuple(i for i in path if i in new),
            has_core=BASE in new,
            motors=(*on_rods, *(k for k, r in enumerate(robot.thrusters, 1) if r.on in new)),
        )
    return tuple(chains)


def coupling_map(robot: Robot) -> tuple[tuple[int, ...], ...]:
    """The places from 0 of the unknowns of each chain among the hybrid ones (eq. 18, Figs. 6–9)."""
    place = {
        unknown.name: i for i, unknown in enumerate(Description(robot.ungeared).hybrid_coordinates)
    }
    return tuple(tuple(place[name] for name in chain.unknowns) for chain in decompose(robot))


def first_row(robot: Robot) -> int:
    """Number of the first hybrid row: the method counts from −1, that of θ₋₁; others from 0."""
    return -1 if robot.base.moves_freely else 0
