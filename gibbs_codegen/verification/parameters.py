"""A robot's numbers under the names of its module's parameters, other numbers, and other units.

Libraries have numbers of their own that are no part of mechanics: Pinocchio adds 2e-16 kg to the
mass it divides by, and MuJoCo takes a body below 1e-15 kg or kg m² for massless. So they are given
the robot with lengths and times of the order of 1 and no mass below that, and their results are
converted back. The units are powers of two, so that no number loses a digit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import frame_prefix, parameter_prefix, rotor_prefix, tie_prefix
from gibbs_codegen.robot.parts.body import Body, RigidBody, Rod, as_rigid_body
from gibbs_codegen.robot.parts.constraint import Constraint
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.part import AnyPart, Part, RobotNumber, changed_numbers
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.parts.ties import Tie
from gibbs_codegen.robot.parts.wheel import Disc
from gibbs_codegen.verification.formulation import Formulation, Quantities, formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree


class Dimension(NamedTuple):
    """The powers of length, mass and time in a unit; volts count as numbers.

    What keeps its sign has that of the robot's number in others as well. What is no zero is not put
    to zero: others are divided by it, or have no derivative there.
    """

    length: float = 0
    mass: float = 0
    time: float = 0
    keeps_sign: bool = False
    no_zero: bool = False

    def unit(self, length: float, mass: float, time: float) -> float:
        """The unit, in SI, that goes with units of length, mass and time in m, kg and s."""
        return float(length**self.length * mass**self.mass * time**self.time)


# Powers of length, mass and time in units.
_POWERS = {
    **dict.fromkeys(("1", "rad", "V"), (0, 0, 0)),
    **{"m": (1, 0, 0), "kg": (0, 1, 0), "s": (0, 0, 1), "h": (0, 0, 1), "(rad/s)": (0, 0, -1)},
    **{"N": (1, 1, -2), "W": (2, 1, -3), "A": (2, 1, -3), "ohm": (-2, -1, 3)},
}


@cache
def _powers(unit: str) -> tuple[float, float, float]:
    """Powers of length, mass and time in a unit such as "N m s/rad" or "N/(rad/s)^2"."""
    powers = np.zeros(3)
    for divided, word, power in re.findall(r"(/?) ?(\([^)]+\)|[a-zA-Z1]+)\^?([\d.]*)", unit):
        powers += (-1 if divided else 1) * float(power or 1) * np.array(_POWERS[word])
    length, mass, time = powers.tolist()
    return length, mass, time


# Maps of a number of a robot, by its name, its value and its dimension; and of a body.
Change = Callable[[str, float, Dimension], float]
BodyChange = Callable[[Body], Body]


def mapped(robot: Robot, change: Change, of_body: BodyChange | None = None) -> Robot:
    """The robot with every number changed that can be a parameter, zeros included.

    `of_body` changes bodies as a whole; None changes their numbers as all others.
    """
    return _Mapping(change, of_body, robot.battery is not None)(robot)


@dataclass(frozen=True)
class _Mapping:
    """A copy of a robot with a function applied to its numbers."""

    change: Change
    of_body: BodyChange | None
    has_battery: bool

    def __call__(self, robot: Robot) -> Robot:
        """The robot with the changed numbers."""
        base = robot.base
        arms = [f"base_arm{'' if base.shares_one_arm else k}" for k in range(1, len(base.arms) + 1)]
        return replace(
            robot,
            **self._numbers(robot, ""),
            base=replace(
                base,
                **self._numbers(base, "base"),
                pose=base.pose if base.moves_freely else self._part("base", base.pose),
                arms=tuple(map(self._body, arms, base.arms)),
                body=as_rigid_body(self._body("base", base.body)) if base.body else None,
            ),
            links=tuple(
                self._link(parameter_prefix(robot, i), link)
                for i, link in enumerate(robot.links, start=1)
            ),
            thrusters=tuple(
                self._rotor(rotor_prefix(robot, k), rotor, robot)
                for k, rotor in enumerate(robot.thrusters, start=1)
            ),
            frames=tuple(
                replace(frame, pose=self._part(frame_prefix(frame.name), frame.pose))
                for frame in robot.frames
            ),
            battery=self._part("battery", robot.battery) if robot.battery else None,
            **robot.mapped(self._tie),
        )

    def _numbers(self, part: Part, prefix: str, **more: Any) -> dict[str, Any]:
        """The changed numbers of a part, by its fields."""

        def change(number: RobotNumber) -> float:
            if number.key == "delay" and number.value == 0.0:  # There is nothing to follow.
                return 0.0
            # Batteries give power either way.
            no_zero = number.no_zero or (self.has_battery and number.key == "drag")
            dimension = Dimension(*_powers(number.unit), number.keeps_sign, no_zero)
            return self.change(number.name, number.value, dimension)

        return changed_numbers(part, prefix, change, **more)

    def _part(self, prefix: str, part: AnyPart, slides: bool = False) -> AnyPart:
        """A part with the changed numbers."""
        return replace(part, **self._numbers(part, prefix, slides=slides))

    def _tie(self, tie: Tie) -> Tie:
        numbers = self._numbers(tie, tie_prefix(tie))
        quaternion = numbers.pop("quaternion", None)
        if isinstance(tie, Constraint) and quaternion not in (None, tie.quaternion):
            from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

            x, y, z = Rotation.from_quat(quaternion).as_euler("xyz", degrees=True)
            numbers["rpy_deg"] = Fraction(x), Fraction(y), Fraction(z)
        return replace(tie, **numbers)

    def _rotor(self, prefix: str, rotor: Rotor, robot: Robot) -> Rotor:
        """A placed rotor; only robots that have actuators have the numbers of its drive."""
        numbers = self._numbers(rotor, prefix)
        if robot.has_actuators:
            numbers |= self._numbers(rotor, prefix, marks=rotor.drive_parameters())
        if numbers.get("speed_per_sqrt_thrust") == 0.0:
            del numbers["speed_per_sqrt_thrust"]
        return replace(rotor, **numbers)

    def _link(self, prefix: str, link: Link) -> Link:
        link = replace(link, body=self._body(prefix, link.body))
        if link.pose is not None:
            link = replace(link, pose=self._part(prefix, link.pose))
        else:
            link = self._part(prefix, link)
        if not link.moves:
            return link
        slides, servo, friction = link.slides, link.servo, link.friction
        return replace(
            link,
            rolling=link.rolling and self._part(prefix, link.rolling),
            passive=self._part(prefix, link.passive, slides),
            motor=link.motor and self._part(prefix, link.motor),
            servo=servo and self._part(f"{prefix}_servo", servo, slides),
            friction=friction and self._part(f"{prefix}_friction", friction, slides),
        )

    def _body(self, prefix: str, body: Body) -> Body:
        return self._part(prefix, body) if self.of_body is None else self.of_body(body)


def robot_numbers(robot: Robot) -> dict[str, tuple[float, Dimension]]:
    """Every number of the robot that can be a parameter, zeros included, in SI units."""
    numbers: dict[str, tuple[float, Dimension]] = {}

    def note(name: str, value: float, dimension: Dimension) -> float:
        numbers[name] = value, dimension
        return value

    mapped(robot, note)
    return numbers


def parameter_values(robot: Robot) -> dict[str, float]:
    """The values of these numbers."""
    return {name: value for name, (value, _) in robot_numbers(robot).items()}


def prepared(module: ModuleType, robot: Robot) -> Any:
    """Constants that a module's `prepare` returns for the numbers of a robot."""
    numbers = parameter_values(robot)
    return module.prepare({name: numbers[name] for name in module.PARAMETERS})


def with_values(robot: Robot, values: Mapping[str, float]) -> Robot:
    """The robot with other numbers, under names of `parameter_values`, where there are any."""
    return mapped(robot, lambda name, value, _: values.get(name, value))


class InOwnUnits:
    """A formulation (see `formulation`) of the robot in its own units."""

    def __init__(self, kind: Callable[[Tree], Formulation], robot: Robot) -> None:
        self.tree = Tree(robot)
        self._length = _power_of_two(self.tree.reach)
        # The smallest mass, or moment of inertia over the square of the reach, but zero.
        joints = self.tree.joints
        moments = [np.diagonal(joint.inertia) / self.tree.reach**2 for joint in joints]
        numbers = np.append([joint.mass for joint in joints], moments)
        self._mass = _power_of_two(float(numbers[numbers > 0.0].min()))
        self._time = _power_of_two(1.0 / self.tree.tempo)
        units = self._length, self._mass, self._time
        scaled = Tree(mapped(robot, lambda _, value, dimension: value / dimension.unit(*units)))
        lengths = np.where(self.tree.turns, 1.0, self._length)
        scaled.gains = self.tree.gains / lengths[:, None] * lengths
        scaled.offsets = self.tree.offsets / lengths
        inner = formulated(kind(scaled))
        self.name, self.limit, self.growth = inner.name, inner.limit, inner.growth
        self._inner = inner

    def at(self, states: States) -> Quantities:
        """Quantities by the formulation, from and to SI units."""
        units = np.where(self.tree.turns, 1.0, self._length)
        free, time = units[self.tree.free], self._time
        lengths = np.array([unit == "m" for unit in self.tree.layout.q.units])
        q = states.q / np.where(lengths, self._length, 1.0)
        v, a = states.v / free * time, states.a / free * time**2
        energy = self._mass * (self._length / time) ** 2
        twist, wrench = np.repeat([[self._length, 1.0], [1.0, self._length]], 3, axis=-1)
        wrench = energy / self._length * wrench
        efforts = energy / units[self.tree.driven]
        thrusts = np.full(len(self.tree.motors), energy / self._length)
        u = states.u / np.concatenate([thrusts, efforts])
        # Libraries know nothing of actuators.
        quantities = self._inner.at(States(q, v, a, u, states.W / wrench))._replace(actuators=None)
        pose = np.ones((4, 4))
        pose[:3, 3] = self._length
        scales = {
            "mass_matrix": energy * time**2 / np.outer(units, units),
            "residual": energy / units,
            "inverse_dynamics": energy / units,
            "poses": pose,
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
            "loaded_joint_wrenches": wrench,
        }
        values = {name: x for name, x in quantities._asdict().items() if x is not None}
        return quantities._replace(**{name: x * scales[name] for name, x in values.items()})


def _power_of_two(value: float) -> float:
    return float(2.0 ** np.round(np.log2(value)))


Inertia = tuple[float, float, float, float, float, float]

# Larger or smaller by 2.5 to 6.5 times, in powers of two.
_OCTAVES = (1.3, 2.7)
# Shares of the smallest number that stand for zero beside others; the share that is zero.
_SMALL, _FLAT = (0.05, 0.2), 1e-9
# Least eigenvalue of a mass matrix of unit diagonal that rounding surely leaves positive.
_DETERMINED = 1e-10


def variation(robot: Robot, names: Collection[str], seed: int, number: int) -> Robot:
    """The robot with other numbers for some parameters.

    Each is larger or smaller by 2.5 to 6.5 times, by turns from one number to the next, and
    negative for two numbers of four (`number` decides which); what is zero gets a size that is
    natural to the robot. Bodies stay possible: masses and moments of inertia are positive, a rod of
    negative length has a negative mass per length, since it lies the other way, and products of
    inertia change their signs as if axes of the body did.
    """
    draw, tree = _Draw(seed, number), Tree(robot)
    reach, mass, period = tree.reach, robot.total_mass, 1.0 / tree.tempo

    def other(_: str, value: float, dimension: Dimension) -> float:
        drawn = draw.sized if dimension.keeps_sign else draw.signed
        return drawn(value, dimension.unit(reach, mass, period))

    def of_body(body: Body) -> Body:
        if isinstance(body, Rod):
            sign = draw.sign()
            length = sign * draw.sized(body.length, reach)
            density = sign * draw.sized(body.mass_per_length, mass / reach)
            natural = max(body.section_inertia) or (body.total_mass or mass) * reach**2
            x, y, z = (draw.sized(i, natural) for i in body.section_inertia)
            return Rod(length=length, mass_per_length=density, section_inertia=(x, y, z))
        natural = max(body.inertia[:3]) or (body.mass or mass) * reach**2
        if isinstance(body, Disc):  # Alike all around its axis, and possible.
            axial = draw.sized(body.inertia[1], natural)
            inertia = (axial, axial, axial, 0.0, 0.0, 0.0)
            return replace(body, mass=draw.sized(body.mass, mass), inertia=inertia)
        cx, cy, cz = (draw.signed(value, reach) for value in body.com)
        return RigidBody(
            draw.signed(body.length, reach),
            draw.sized(body.mass, mass),
            (cx, cy, cz),
            _stretched(body.inertia, draw, natural),
        )

    values = parameter_values(mapped(robot, other, of_body))
    return with_values(robot, {name: values[name] for name in names})


def variations(
    robot: Robot, names: Collection[str], seed: int, count: int, zeros: bool
) -> Iterator[Robot]:
    """`count` variations; with `zeros`, as many again and more, each parameter zero once in them.

    What would leave an acceleration undetermined at zero, alone or with others, keeps its value.
    """
    yield from (variation(robot, names, seed, number) for number in range(count))
    # Masses are zero by themselves, since others are their factors.
    no_zeros = {name for name, (_, dimension) in robot_numbers(robot).items() if dimension.no_zero}
    ordered = sorted({*names} - no_zeros)
    masses = [name for name in ordered if name.endswith(("_mass", "_mass_per_length"))]
    others = [name for name in ordered if name not in masses]
    groups = [*(others[i::count] for i in range(count)), masses[::2], masses[1::2]]
    groups = [group for group in groups if group and zeros]
    # The list grows where parameters are kept back by others, which have another turn then.
    for number, group in enumerate(groups, start=count):
        varied = variation(robot, names, seed, number)
        zero: list[str] = []  # As many as can be together, by halving what cannot.
        waiting = [list(group)]
        while waiting:
            part = waiting.pop()
            other = with_values(varied, dict.fromkeys([*zero, *part], 0.0))
            # Modules want a mass too, even where moments of inertia alone would determine all.
            if other.total_mass > 0.0 and determined(other):
                zero += part
            elif len(part) > 1:
                half = len(part) // 2
                waiting += [part[half:], part[:half]]
        kept_back = [name for name in group if name not in zero]
        if zero and kept_back:
            groups.append(kept_back)
        yield with_values(varied, dict.fromkeys(zero, 0.0))


def determined(robot: Robot, least: float = _DETERMINED) -> bool:
    """True if inertia resists every acceleration by more than rounding would.

    `least` is the smallest eigenvalue that the mass matrix may have once its diagonal is 1.
    """
    tree = Tree(robot)
    states = States.random(tree, 2, 0)
    there, at_joints = states.placed(tree)
    matrix = NewtonEuler(there).mass_matrix(at_joints.q) + np.diag(tree.passive.armature)
    gains = tree.gains[:, tree.free]
    matrix = gains.T @ matrix @ gains
    diagonal = np.diagonal(matrix, axis1=1, axis2=2)
    # Next to what the coordinate could move, what is left by rounding is nothing.
    if not (diagonal > _DETERMINED * Sizes(tree, states).free_units ** 2).all():
        return False
    roots = np.sqrt(diagonal)
    scaled = matrix / roots[:, :, None] / roots[:, None, :]
    return bool(np.linalg.eigvalsh(scaled).min() > least)


class _Draw:
    """Random factors, the same for the same seed and number."""

    def __init__(self, seed: int, number: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._turned, self._mirrored = number % 2, number // 2 % 2

    def sign(self) -> float:
        """1 or -1."""
        return 1.0 - 2.0 * (int(self._rng.integers(2)) ^ self._mirrored)

    def factor(self) -> float:
        """From 2.5 to 6.5, or the inverse of that."""
        return self.factors(1)[0]

    def factors(self, count: int) -> list[float]:
        """Several such factors, all larger or all smaller."""
        smaller = int(self._rng.integers(2)) ^ self._turned
        octaves = (1 - 2 * smaller) * self._rng.uniform(*_OCTAVES, count)
        return [2.0**octave for octave in octaves.tolist()]

    def share(self, least: float, most: float) -> float:
        """Between two bounds."""
        return float(self._rng.uniform(least, most))

    def sized(self, value: float, natural: float) -> float:
        """Another number of the same sign, for zero one of the natural size."""
        return self.factor() * value if value else self.share(0.5, 1.0) * natural

    def signed(self, value: float, natural: float) -> float:
        """Another number of either sign."""
        return self.sign() * self.sized(value, natural)


def _stretched(inertia: Inertia, draw: _Draw, natural: float) -> Inertia:
    """Inertia of a body that is stretched, or squeezed, by another factor along each axis.

    So no moments stay equal, and none exceeds the sum of the others. Axes change their signs.
    """
    half = 0.5 * sum(inertia[:3])
    # Each moment is the sum of the second moments of mass along the other axes.
    along = [half - moment if half - moment > _FLAT * half else 0.0 for moment in inertia[:3]]
    factors = draw.factors(3)
    spread = [factor * moment for factor, moment in zip(factors, along, strict=True)]
    least = min(filter(None, spread), default=natural)
    x, y, z = (moment or draw.share(*_SMALL) * least for moment in spread)
    # Matrices that are diagonally dominant are positive definite.
    least, roots = min(x, y, z), [draw.sign() * factor**0.5 for factor in factors]
    xy, xz, yz = (
        roots[i] * roots[j] * product or draw.sign() * draw.share(*_SMALL) * least
        for (i, j), product in zip(((0, 1), (0, 2), (1, 2)), inertia[3:], strict=True)
    )
    return y + z, x + z, x + y, xy, xz, yz
