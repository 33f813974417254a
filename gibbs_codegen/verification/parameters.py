"""A robot's numbers under the names of its module's parameters, other numbers, and other units.

Libraries have numbers of their own that are no part of mechanics: Pinocchio adds 2e-16 kg to the
mass it divides by, and MuJoCo takes a body below 1e-15 kg or kg m² for massless. So they are given
the robot with lengths and times of the order of 1 and no mass below that, and their results are
converted back. The units are powers of two, so that no number loses a digit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.robot.model import (
    Body,
    Link,
    Passive,
    Pose,
    RigidBody,
    Robot,
    Rod,
    Rotor,
    Vector3,
    as_rigid_body,
)
from gibbs_codegen.robot.names import frame_prefix, parameter_prefix, rotor_prefix
from gibbs_codegen.verification.formulation import Formulation, Quantities, formulated
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree


class Dimension(NamedTuple):
    """The powers of length, mass and time in a unit."""

    length: int = 0
    mass: int = 0
    time: int = 0

    def unit(self, length: float, mass: float, time: float) -> float:
        """The unit, in SI, that goes with units of length, mass and time in m, kg and s."""
        return float(length**self.length * mass**self.mass * time**self.time)


LENGTH, MASS, INERTIA = Dimension(1), Dimension(mass=1), Dimension(2, 1)
ACCELERATION, DENSITY = Dimension(1, time=-2), Dimension(-1, 1)
# Damping, armature, stiffness and rest of joints that turn; of those that slide with the next.
_PASSIVE = (Dimension(2, 1, -1), Dimension(2, 1), Dimension(2, 1, -2), Dimension())
_SLIDING = (Dimension(0, 1, -1), Dimension(0, 1), Dimension(0, 1, -2), Dimension(1))
# What becomes of a number of a robot, by its name, its value and its dimension; and of a body.
Change = Callable[[str, float, Dimension], float]
BodyChange = Callable[[Body], Body]


def mapped(robot: Robot, change: Change, of_body: BodyChange | None = None) -> Robot:
    """The robot with every number changed that can be a parameter, zeros included.

    `of_body` changes bodies as a whole; None changes their numbers as all others.
    """
    return _Mapping(change, of_body)(robot)


@dataclass(frozen=True)
class _Mapping:
    """What becomes of the numbers of a robot."""

    change: Change
    of_body: BodyChange | None

    def __call__(self, robot: Robot) -> Robot:
        """The robot with the changed numbers."""
        base, change = robot.base, self.change
        drags = enumerate(base.drag, start=1)
        return replace(
            robot,
            gravity=change("gravity", robot.gravity, ACCELERATION),
            base=replace(
                base,
                drag=tuple(change(f"base_drag_{k}", drag, LENGTH) for k, drag in drags),
                arms=tuple(self._body(prefix, arm) for prefix, arm in _arms(robot)),
                body=as_rigid_body(self._body("base", base.body)) if base.body else None,
            ),
            links=tuple(
                self._link(parameter_prefix(robot, i), link)
                for i, link in enumerate(robot.links, start=1)
            ),
            thrusters=tuple(
                self._rotor(rotor_prefix(robot, k), rotor)
                for k, rotor in enumerate(robot.thrusters, start=1)
            ),
            frames=tuple(
                replace(frame, pose=self._pose(frame_prefix(frame.name), frame.pose))
                for frame in robot.frames
            ),
        )

    def _vector(self, prefix: str, vector: Vector3) -> Vector3:
        pairs = zip("xyz", vector, strict=True)
        x, y, z = (self.change(f"{prefix}_{axis}", value, LENGTH) for axis, value in pairs)
        return x, y, z

    def _pose(self, prefix: str, pose: Pose) -> Pose:
        return replace(pose, xyz=self._vector(prefix, pose.xyz))

    def _rotor(self, prefix: str, rotor: Rotor) -> Rotor:
        drag = self.change(f"{prefix}_drag", rotor.drag, LENGTH)
        return replace(rotor, position=self._vector(prefix, rotor.position), drag=drag)

    def _link(self, prefix: str, link: Link) -> Link:
        link = replace(link, body=self._body(prefix, link.body))
        if link.pose is not None:
            link = replace(link, pose=self._pose(prefix, link.pose))
        else:
            a = None if link.a is None else self.change(f"{prefix}_a", link.a, LENGTH)
            link = replace(link, a=a, d=self.change(f"{prefix}_d", link.d, LENGTH))
        if not link.moves:
            return link
        dimensions = _PASSIVE if link.joint == "revolute" else _SLIDING
        names = ("damping", "armature", "stiffness", "rest")
        own = zip(names, astuple(link.passive), dimensions, strict=True)
        passive = [self.change(f"{prefix}_{name}", x, dimension) for name, x, dimension in own]
        return replace(link, passive=Passive(*passive))

    def _body(self, prefix: str, body: Body) -> Body:
        if self.of_body is not None:
            return self.of_body(body)
        return self._rod(prefix, body) if isinstance(body, Rod) else self._rigid_body(prefix, body)

    def _rod(self, prefix: str, rod: Rod) -> Rod:
        length = self.change(f"{prefix}_length", rod.length, LENGTH)
        density = self.change(f"{prefix}_mass_per_length", rod.mass_per_length, DENSITY)
        own = zip(("xx", "yy", "zz"), rod.section_inertia, strict=True)
        x, y, z = (self.change(f"{prefix}_section_inertia_{ij}", i, INERTIA) for ij, i in own)
        return Rod(length, density, (x, y, z))

    def _rigid_body(self, prefix: str, body: RigidBody) -> RigidBody:
        length = self.change(f"{prefix}_length", body.length, LENGTH)
        mass = self.change(f"{prefix}_mass", body.mass, MASS)
        com = self._vector(f"{prefix}_com", body.com)
        own = zip(("xx", "yy", "zz", "xy", "xz", "yz"), body.inertia, strict=True)
        xx, yy, zz, xy, xz, yz = (
            self.change(f"{prefix}_inertia_{ij}", i, INERTIA) for ij, i in own
        )
        return RigidBody(length, mass, com, (xx, yy, zz, xy, xz, yz))


def parameter_values(robot: Robot) -> dict[str, float]:
    """Every number of the robot that can be a parameter, zeros included, in SI units."""
    found: dict[str, float] = {}

    def note(name: str, value: float, _: Dimension) -> float:
        found[name] = value
        return value

    mapped(robot, note)
    return found


def prepared(module: ModuleType, robot: Robot) -> Any:
    """What a module's `prepare` returns for the numbers of a robot."""
    numbers = parameter_values(robot)
    return module.prepare({name: numbers[name] for name in module.PARAMETERS})


def with_values(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with other numbers, under names of `parameter_values`, where there are any."""
    return mapped(robot, lambda name, value, _: values.get(name, value))


def in_units(robot: Robot, length: float, mass: float, time: float) -> Robot:
    """The same robot, its numbers as multiples of units given in m, kg and s."""
    return mapped(robot, lambda _, value, dimension: value / dimension.unit(length, mass, time))


def bodies(robot: Robot) -> Iterator[tuple[str, Body]]:
    """Every body that has parameters of its own, after what the names of these begin with."""
    yield from _arms(robot)
    if robot.base.body:
        yield "base", robot.base.body
    for i, link in enumerate(robot.links, start=1):
        yield parameter_prefix(robot, i), link.body


def _arms(robot: Robot) -> Iterator[tuple[str, Body]]:
    for k, arm in enumerate(robot.base.arms, start=1):
        yield "base_arm" if robot.base.shares_one_arm else f"base_arm{k}", arm


class InOwnUnits:
    """A formulation (see `formulation`) of the robot in its own units."""

    def __init__(self, kind: Callable[[Tree], Formulation], robot: Robot) -> None:
        self.tree = Tree(robot)
        self._length = _power_of_two(self.tree.reach)
        self._mass = _power_of_two(_lightest(self.tree))
        self._time = _power_of_two(1.0 / self.tree.tempo)
        inner = formulated(kind(Tree(in_units(robot, self._length, self._mass, self._time))))
        self.name, self.limit, self.growth = inner.name, inner.limit, inner.growth
        self._inner = inner

    def at(self, states: States) -> Quantities:
        """What the formulation computes, from and to SI units."""
        units = np.where(self.tree.turns, 1.0, self._length)
        free, time = units[self.tree.free], self._time
        lengths = np.array([unit == "m" for unit in self.tree.layout.q.units])
        q = states.q / np.where(lengths, self._length, 1.0)
        v, a = states.v / free * time, states.a / free * time**2
        energy = self._mass * (self._length / time) ** 2
        twist, wrench = np.repeat([[self._length, 1.0], [1.0, self._length]], 3, axis=-1)
        wrench = energy / self._length * wrench
        efforts = energy / units[self.tree.arm]
        thrusts = np.full(len(self.tree.motors), energy / self._length)
        u = states.u / np.concatenate([thrusts, efforts])
        found = self._inner.at(States(q, v, a, u, states.W / wrench))
        found.poses[..., :3, 3] *= self._length
        scales = {
            "mass_matrix": energy * time**2 / np.outer(units, units),
            "residual": energy / units,
            "inverse_dynamics": energy / units,
            "jacobians": twist[:, None] / units,
            "kinetic_energy": energy,
            "potential_energy": energy,
            "positions": self._length,
            "bias_accelerations": twist / time**2,
            "centre_of_mass": self._length,
            "centre_jacobian": self._length / units,
            "momentum": wrench * time,
            "gravity_forces": energy / units,
            "joint_wrenches": wrench,
        }
        given = {name: getattr(found, name) for name in scales}
        return found._replace(**{n: x * scales[n] for n, x in given.items() if x is not None})


def _lightest(tree: Tree) -> float:
    """The smallest mass, or moment of inertia over the square of the reach, but zero."""
    masses = np.array([joint.mass for joint in tree.joints])
    moments = np.array([np.diagonal(joint.inertia) for joint in tree.joints]) / tree.reach**2
    every = np.concatenate([masses, moments.ravel()])
    return float(every[every > 0.0].min())


def _power_of_two(value: float) -> float:
    return float(2.0 ** np.round(np.log2(value)))
