"""The robot as plain frozen data: what a robot file says, checked, with its defaults filled in.

SI units throughout: kg, m, s; angles in degrees where a name ends in `_deg`. Nothing here knows
SymPy. Lengths and masses are floats; angles are exact fractions of a degree, since they are
structural: they decide which terms exist.

Bodies are counted with the base as number 0 and link i as number i: `parent` and `on` are such
numbers.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.battery import Battery
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.gear import Gear
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.parts.part import number
from gibbs_codegen.robot.parts.rotor import Drive, Rotor
from gibbs_codegen.robot.parts.ties import Ties


@dataclass(frozen=True)
class Robot(Ties):
    """An aerial robot: a flying base, and links that branch from it as a tree.

    Its rotors are those at the ends of the base's rods, or the placed ones, `thrusters`.
    """

    name: str
    base: Base
    links: tuple[Link, ...] = ()
    gravity: float = number("acceleration of gravity, {m/s^2}", 9.81)
    thrusters: tuple[Rotor, ...] = ()
    frames: tuple[Frame, ...] = ()
    allow_impossible_inertia: bool = False
    battery: Battery | None = None

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """The drive of each rotor, by default one that is commanded its thrust."""
        plain = [Drive() for _ in range(self.base.rotors)]
        return (*plain, *(rotor.drive for rotor in self.thrusters))

    @property
    def has_actuators(self) -> bool:
        """True if any command is not the thrust, torque or force itself, with one lag or none."""
        moved = [self.links[i - 1] for i in self.moving]
        return (
            self.battery is not None
            or any(rotor.has_drive or rotor.feels_air for rotor in self.thrusters)
            or any(link.servo or link.friction for link in moved)
        )

    @property
    def rotors(self) -> int:
        """N, the number of rotors."""
        return self.base.rotors + len(self.thrusters)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """For each link the number of the body that carries it."""
        return tuple(
            before if link.parent is None else link.parent for before, link in enumerate(self.links)
        )

    @cached_property
    def gearing(self) -> dict[int, Gear]:
        """For each link whose joint moves, in order, the gear from the coordinates that move it.

        Gears of gears are one; of a joint with a coordinate it is of the link itself, and of a
        wheel of the base, from its speed ahead.
        """

        def whole(i: int) -> Gear:
            gear, rolling = self.links[i - 1].gear, self.links[i - 1].rolling
            if rolling:
                return Gear(of=BASE, ratio=1.0 / rolling.radius)
            return gear.after({j: whole(j) for j in gear.ratios}) if gear else Gear(of=i, ratio=1.0)

        return {i: whole(i) for i, link in enumerate(self.links, start=1) if link.moves}

    @cached_property
    def wheels(self) -> tuple[int, ...]:
        """Numbers of the wheels with a joint: coordinates that have no velocities of their own."""
        return tuple(i for i in self.gearing if self.links[i - 1].rolling)

    @property
    def acts_on_wheels(self) -> bool:
        """True if a rotor or a spring turns with a wheel, so that its angle counts."""
        turning = {frame.name for frame in self.frames if frame.on in self.wheels}
        springs = any(not turning.isdisjoint((x.frame, x.to)) for x in self.springs)
        return springs or any(rotor.on in self.wheels for rotor in self.thrusters)

    @property
    def driven(self) -> tuple[int, ...]:
        """Numbers of the links whose joints have inputs, in their order."""
        return (*self.moving, *self.wheels)

    @property
    def kind(self) -> str:
        """What a module says of its coordinates: of the base, and the number of wheels, if any."""
        return f"{self.base.kind} {len(self.wheels)}" if self.wheels else self.base.kind

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the links whose joints have coordinates, in order."""
        links = {i: self.links[i - 1] for i in self.gearing}
        return tuple(i for i, link in links.items() if not (link.gear or link.rolling))

    @property
    def is_geared(self) -> bool:
        """True if a gear or the ground moves any joint."""
        return len(self.moving) < len(self.gearing)

    @property
    def is_recursive(self) -> bool:
        """True if accelerations pass from body to body, over which no gear and no drive leads."""
        return not (self.is_geared or self.base.drive)

    @cached_property
    def ungeared(self) -> Robot:
        """The robot with a coordinate for every joint that moves."""
        links = (replace(link, gear=None, rolling=None) for link in self.links)
        return replace(self, links=tuple(links)) if self.is_geared else self

    def positions(self, joints: Iterable[float]) -> dict[int, float]:
        """Positions, rad or m, of all joints that move, by links, from the coordinates in order.

        Wheels are at 0 where their angles are left out.
        """
        values = dict(zip(self.driven, joints, strict=False))
        return {
            i: values.get(i, 0.0)
            if i in self.wheels
            else gear.offset + sum(ratio * values[j] for j, ratio in gear.ratios.items())
            for i, gear in self.gearing.items()
        }

    @cached_property
    def rigid(self) -> tuple[int, ...]:
        """For each body the number of the base or moving link that it is, or is welded to."""
        bodies = [BASE]
        for i, (link, parent) in enumerate(zip(self.links, self.parents, strict=True), start=1):
            bodies.append(i if link.moves else bodies[parent])
        return tuple(bodies)

    @cached_property
    def constrained(self) -> tuple[int, ...]:
        """Numbers of the links that a constraint torque holds, in order."""
        return tuple(i for i, link in enumerate(self.links, start=1) if link.constrained)

    @property
    def is_serial(self) -> bool:
        """True if its links are one arm, each on the link before."""
        return self.parents == tuple(range(len(self.links)))

    @property
    def total_mass(self) -> float:
        """Mass of the whole robot in kg."""
        arms = sum(self.base.arm(k).total_mass for k in range(1, self.base.rotors + 1))
        body = self.base.body.total_mass if self.base.body else 0.0
        return arms + body + sum(link.body.total_mass for link in self.links)
