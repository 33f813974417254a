"""A robot's numbers under the names of its module's parameters, other numbers, and other units.

Libraries have numbers of their own that are no part of mechanics: Pinocchio adds 2e-16 kg to the
mass it divides by, and MuJoCo takes a body below 1e-15 kg or kg m² for massless. So they are given
the robot with lengths and times of the order of 1 and no mass below that, and their results are
converted back. The units are powers of two, so that no number loses a digit.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.robot import model
from gibbs_codegen.robot.names import (
    constraint_prefix,
    frame_prefix,
    parameter_prefix,
    rotor_prefix,
)
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

    @property
    def kept(self) -> Dimension:
        """The same of what keeps its sign."""
        return self._replace(keeps_sign=True)

    @property
    def sized(self) -> Dimension:
        """The same of what keeps its sign and is no zero."""
        return self._replace(keeps_sign=True, no_zero=True)

    def unit(self, length: float, mass: float, time: float) -> float:
        """The unit, in SI, that goes with units of length, mass and time in m, kg and s."""
        return float(length**self.length * mass**self.mass * time**self.time)


LENGTH, MASS, INERTIA = Dimension(1), Dimension(mass=1), Dimension(2, 1)
ACCELERATION, DENSITY = Dimension(1, time=-2), Dimension(-1, 1)
# Damping, armature, stiffness and rest of joints that turn; of those that slide with the next.
_PASSIVE = (Dimension(2, 1, -1), Dimension(2, 1).kept, Dimension(2, 1, -2), Dimension())
_SLIDING = (Dimension(0, 1, -1), Dimension(0, 1).kept, Dimension(0, 1, -2), Dimension(1))
NUMBER, TIME, PER_TIME = Dimension(), Dimension(time=1), Dimension(time=-1)
FORCE, POWER = Dimension(1, 1, -2), Dimension(2, 1, -3)
# Of thrusts by speed, by powers of the speed.
_BY_SPEED = (FORCE, Dimension(1, 1, -1), Dimension(1, 1))
_BY_ROOT_OF_THRUST = Dimension(-0.5, -0.5).sized
_BATTERY = {
    "nominal": NUMBER.sized,
    "resistance": Dimension(-2, -1, 3).kept,
    "capacity": Dimension(2, 1, -2).sized,
    "efficiency": NUMBER.sized,
    "auxiliary": POWER.kept,
}
# What becomes of a number of a robot, by its name, its value and its dimension; and of a body.
Change = Callable[[str, float, Dimension], float]
BodyChange = Callable[[model.Body], model.Body]


def mapped(robot: model.Robot, change: Change, of_body: BodyChange | None = None) -> model.Robot:
    """The robot with every number changed that can be a parameter, zeros included.

    `of_body` changes bodies as a whole; None changes their numbers as all others.
    """
    return _Mapping(change, of_body)(robot)


@dataclass(frozen=True)
class _Mapping:
    """What becomes of the numbers of a robot."""

    change: Change
    of_body: BodyChange | None

    def __call__(self, robot: model.Robot) -> model.Robot:
        """The robot with the changed numbers."""
        base, change = robot.base, self.change
        # Batteries give power either way.
        of_drag = LENGTH._replace(no_zero=robot.battery is not None)
        drags = enumerate(base.drag, start=1)
        arms = [f"base_arm{'' if base.shares_one_arm else k}" for k in range(1, len(base.arms) + 1)]
        return replace(
            robot,
            gravity=change("gravity", robot.gravity, ACCELERATION),
            base=replace(
                base,
                drag=tuple(change(f"base_drag_{k}", drag, of_drag) for k, drag in drags),
                arms=tuple(map(self._body, arms, base.arms)),
                body=model.as_rigid_body(self._body("base", base.body)) if base.body else None,
            ),
            links=tuple(
                self._link(parameter_prefix(robot, i), link)
                for i, link in enumerate(robot.links, start=1)
            ),
            thrusters=tuple(
                self._rotor(rotor_prefix(robot, k), rotor, of_drag, robot.has_actuators)
                for k, rotor in enumerate(robot.thrusters, start=1)
            ),
            frames=tuple(
                replace(frame, pose=self._pose(frame_prefix(frame.name), frame.pose))
                for frame in robot.frames
            ),
            battery=self._battery(robot.battery) if robot.battery else None,
            constraints=tuple(map(self._constraint, robot.constraints)),
        )

    def _constraint(self, own: model.Constraint) -> model.Constraint:
        prefix, change = constraint_prefix(own.name), self.change
        anchor = self._pose(prefix, own.anchor)
        if own.to is None and own.kind == "frame":
            pairs = zip(("qx", "qy", "qz", "qw"), own.anchor.quaternion, strict=True)
            parts = [
                change(f"{prefix}_{part}", x, NUMBER._replace(no_zero=True)) for part, x in pairs
            ]
            if parts != [*own.anchor.quaternion]:
                from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

                x, y, z = Rotation.from_quat(parts).as_euler("xyz", degrees=True)
                rpy = Fraction(x), Fraction(y), Fraction(z)
                anchor = replace(anchor, rpy_deg=rpy)
        own = replace(own, anchor=anchor)
        if own.kind == "distance":
            distance = change(f"{prefix}_distance", own.distance, LENGTH.sized)
            own = replace(own, distance=distance)
        if own.frequency == 0.0:
            return own
        frequency = change(f"{prefix}_frequency", own.frequency, PER_TIME.sized)
        ratio = change(f"{prefix}_damping_ratio", own.damping_ratio, NUMBER.kept)
        return replace(own, frequency=frequency, damping_ratio=ratio)

    def _vector(self, prefix: str, vector: model.Vector3) -> model.Vector3:
        pairs = zip("xyz", vector, strict=True)
        x, y, z = (self.change(f"{prefix}_{axis}", value, LENGTH) for axis, value in pairs)
        return x, y, z

    def _pose(self, prefix: str, pose: model.Pose) -> model.Pose:
        return replace(pose, xyz=self._vector(prefix, pose.xyz))

    def _rotor(
        self, prefix: str, rotor: model.Rotor, of_drag: Dimension, has_drive: bool
    ) -> model.Rotor:
        """A placed rotor; only robots that have actuators have the numbers of its drive."""
        position = self._vector(prefix, rotor.position)
        drag = self.change(f"{prefix}_drag", rotor.drag, of_drag)
        rotor = replace(rotor, position=position, drag=drag)
        if not has_drive:
            return rotor
        drive = self._drive(prefix, model.drive_of(rotor))
        if drive.command == "thrust":
            name, known = f"{prefix}_speed_per_sqrt_thrust", rotor.speed_per_sqrt_thrust
            other = self.change(name, known or 0.0, _BY_ROOT_OF_THRUST)
            rotor = replace(rotor, speed_per_sqrt_thrust=other or known)
        if rotor.drive is not None:
            return replace(rotor, drive=drive)
        return replace(rotor, time_constant=drive.up) if drive.lags else rotor

    def _drive(self, prefix: str, drive: model.Drive) -> model.Drive:
        change = self.change
        if drive.command != "thrust":
            first, second, third = _BY_SPEED if drive.command == "speed" else (FORCE,) * 3
            constant, slope, square = drive.curve
            # Commands are found of thrusts on the rising side, and divided by one of the two.
            second = second.sized if square == 0.0 else second.kept
            third = third.sized if slope <= 0.0 else third.kept
            curve = (
                change(f"{prefix}_thrust_0", constant, first),
                change(f"{prefix}_thrust_1", slope, second),
                change(f"{prefix}_thrust_2", square, third),
            )
            drive = replace(drive, curve=curve)
        if drive.full_speed is not None:
            speed = change(f"{prefix}_full_speed", drive.full_speed, PER_TIME.sized)
            drive = replace(drive, full_speed=speed)
        if not drive.lags:
            return drive
        if drive.up == drive.down:
            time = change(f"{prefix}_time_constant", drive.up, TIME.sized)
            return replace(drive, up=time, down=time)
        up, down = (
            change(f"{prefix}_time_{end}", getattr(drive, end), TIME.sized)
            for end in ("up", "down")
        )
        return replace(drive, up=up, down=down)

    def _battery(self, battery: model.Battery) -> model.Battery:
        voltages = tuple(
            self.change(f"battery_voltage_{n}", voltage, NUMBER.sized)
            for n, voltage in enumerate(battery.voltages, start=1)
        )
        own = ((name, getattr(battery, name), dimension) for name, dimension in _BATTERY.items())
        others = {name: self.change(f"battery_{name}", x, dimension) for name, x, dimension in own}
        return replace(battery, voltages=voltages, **others)

    def _servo(self, prefix: str, servo: model.Servo, length: Dimension) -> model.Servo:
        """A servo of a joint whose coordinate has such a dimension."""
        effort = Dimension(2.0 - length.length, 1, -2)
        viscous = effort._replace(length=effort.length - length.length, time=-1)
        dimensions = {
            "stiffness": viscous._replace(time=-2).sized,
            "damping": viscous.sized if servo.command == "rate" else viscous,
            "torque": effort.sized,
            "rate": length._replace(time=-1).sized,
            "delay": TIME.sized,
            "backlash": length.sized,
        }
        # Where there is no limit there is no number, and nothing to follow without a delay.
        own = {n: x for n, x in servo.numbers.items() if x is not None}
        own = {n: x for n, x in own.items() if n != "delay" or x != 0.0}
        others: dict[str, Any] = {
            n: self.change(f"{prefix}_servo_{n}", x, dimensions[n]) for n, x in own.items()
        }
        return replace(servo, **others)

    def _friction(self, prefix: str, dry: model.Friction, length: Dimension) -> model.Friction:
        """Dry friction of a joint whose coordinate has such a dimension."""
        effort, rate = Dimension(2.0 - length.length, 1, -2), length._replace(time=-1)
        pairs = ("coulomb", effort), ("static", effort), ("velocity", rate.sized)
        return model.Friction(
            *(self.change(f"{prefix}_friction_{n}", getattr(dry, n), x) for n, x in pairs)
        )

    def _link(self, prefix: str, link: model.Link) -> model.Link:
        link = replace(link, body=self._body(prefix, link.body))
        if link.pose is not None:
            link = replace(link, pose=self._pose(prefix, link.pose))
        else:
            a = None if link.a is None else self.change(f"{prefix}_a", link.a, LENGTH)
            link = replace(link, a=a, d=self.change(f"{prefix}_d", link.d, LENGTH))
        if not link.moves:
            return link
        dimensions = _PASSIVE if link.joint == "revolute" else _SLIDING
        own = zip(asdict(link.passive).items(), dimensions, strict=True)
        passive = [self.change(f"{prefix}_{name}", x, dimension) for (name, x), dimension in own]
        servo, friction = link.servo, link.friction
        length = NUMBER if link.joint == "revolute" else LENGTH
        return replace(
            link,
            passive=model.Passive(*passive),
            servo=self._servo(prefix, servo, length) if servo else None,
            friction=self._friction(prefix, friction, length) if friction else None,
        )

    def _body(self, prefix: str, body: model.Body) -> model.Body:
        if self.of_body is not None:
            return self.of_body(body)
        change, length = self.change, self.change(f"{prefix}_length", body.length, LENGTH)
        if isinstance(body, model.Rod):
            density = change(f"{prefix}_mass_per_length", body.mass_per_length, DENSITY)
            own = zip(model.AXIS_PAIRS[:3], body.section_inertia, strict=True)
            x, y, z = (change(f"{prefix}_section_inertia_{ij}", i, INERTIA) for ij, i in own)
            return model.Rod(length, density, (x, y, z))
        mass = change(f"{prefix}_mass", body.mass, MASS)
        com = self._vector(f"{prefix}_com", body.com)
        own = zip(model.AXIS_PAIRS, body.inertia, strict=True)
        xx, yy, zz, xy, xz, yz = (change(f"{prefix}_inertia_{ij}", i, INERTIA) for ij, i in own)
        return model.RigidBody(length, mass, com, (xx, yy, zz, xy, xz, yz))


def parameter_values(robot: model.Robot) -> dict[str, float]:
    """Every number of the robot that can be a parameter, zeros included, in SI units."""
    found: dict[str, float] = {}

    def note(name: str, value: float, _: Dimension) -> float:
        found[name] = value
        return value

    mapped(robot, note)
    return found


def prepared(module: ModuleType, robot: model.Robot) -> Any:
    """What a module's `prepare` returns for the numbers of a robot."""
    numbers = parameter_values(robot)
    return module.prepare({name: numbers[name] for name in module.PARAMETERS})


def with_values(robot: model.Robot, values: Mapping[str, float]) -> model.Robot:
    """The robot with other numbers, under names of `parameter_values`, where there are any."""
    return mapped(robot, lambda name, value, _: values.get(name, value))


class InOwnUnits:
    """A formulation (see `formulation`) of the robot in its own units."""

    def __init__(self, kind: Callable[[Tree], Formulation], robot: model.Robot) -> None:
        self.tree = Tree(robot)
        self._length = _power_of_two(self.tree.reach)
        # The smallest mass, or moment of inertia over the square of the reach, but zero.
        joints = self.tree.joints
        moments = [np.diagonal(joint.inertia) / self.tree.reach**2 for joint in joints]
        every = np.append([joint.mass for joint in joints], moments)
        self._mass = _power_of_two(float(every[every > 0.0].min()))
        self._time = _power_of_two(1.0 / self.tree.tempo)
        units = self._length, self._mass, self._time
        own = mapped(robot, lambda _, value, dimension: value / dimension.unit(*units))
        inner = formulated(kind(Tree(own)))
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
        # Libraries know nothing of actuators.
        found = self._inner.at(States(q, v, a, u, states.W / wrench))._replace(actuators=None)
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
        values = {name: x for name, x in found._asdict().items() if x is not None}
        return found._replace(**{name: x * scales[name] for name, x in values.items()})


def _power_of_two(value: float) -> float:
    return float(2.0 ** np.round(np.log2(value)))


Inertia = tuple[float, float, float, float, float, float]

# Larger or smaller by 2.5 to 6.5 times, in powers of two.
_OCTAVES = (1.3, 2.7)
# What stands for zero beside other numbers, as a share of the smallest of them; and what is zero.
_SMALL, _FLAT = (0.05, 0.2), 1e-9
# Least eigenvalue of a mass matrix of unit diagonal that rounding surely leaves positive.
_DETERMINED = 1e-10


def variation(robot: model.Robot, names: Collection[str], seed: int, number: int) -> model.Robot:
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

    def of_body(body: model.Body) -> model.Body:
        if isinstance(body, model.Rod):
            sign = draw.sign()
            length = sign * draw.sized(body.length, reach)
            density = sign * draw.sized(body.mass_per_length, mass / reach)
            natural = max(body.section_inertia) or (body.total_mass or mass) * reach**2
            x, y, z = (draw.sized(i, natural) for i in body.section_inertia)
            return model.Rod(length, density, (x, y, z))
        natural = max(body.inertia[:3]) or (body.mass or mass) * reach**2
        cx, cy, cz = (draw.signed(value, reach) for value in body.com)
        return model.RigidBody(
            draw.signed(body.length, reach),
            draw.sized(body.mass, mass),
            (cx, cy, cz),
            _stretched(body.inertia, draw, natural),
        )

    values = parameter_values(mapped(robot, other, of_body))
    return with_values(robot, {name: values[name] for name in names})


def variations(
    robot: model.Robot, names: Collection[str], seed: int, count: int, zeros: bool
) -> Iterator[model.Robot]:
    """`count` variations; with `zeros`, as many again and more, each parameter zero once in them.

    What would leave an acceleration undetermined at zero, alone or with others, keeps its value.
    """
    yield from (variation(robot, names, seed, number) for number in range(count))
    # Masses are zero by themselves, since others are their factors.
    ordered = sorted(set(names) - _no_zeros(robot))
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
            if determined(_with_zeros(varied, [*zero, *part])):
                zero += part
            elif len(part) > 1:
                half = len(part) // 2
                waiting += [part[half:], part[:half]]
        kept_back = [name for name in group if name not in zero]
        if zero and kept_back:
            groups.append(kept_back)
        yield _with_zeros(varied, zero)


def _no_zeros(robot: model.Robot) -> set[str]:
    """Names of the numbers that are no zeros."""
    found = set()

    def note(name: str, value: float, dimension: Dimension) -> float:
        if dimension.no_zero:
            found.add(name)
        return value

    mapped(robot, note)
    return found


def _with_zeros(robot: model.Robot, names: Sequence[str]) -> model.Robot:
    return with_values(robot, dict.fromkeys(names, 0.0))


def determined(robot: model.Robot, least: float = _DETERMINED) -> bool:
    """Whether something resists every acceleration by more than rounding would.

    `least` is the smallest eigenvalue that the mass matrix may have once its diagonal is 1.
    """
    tree = Tree(robot)
    states = States.random(tree, 2, 0)
    there, at_joints = states.placed(tree)
    matrix = NewtonEuler(there).mass_matrix(at_joints.q) + np.diag(tree.passive.armature)
    matrix = matrix[:, tree.free][:, :, tree.free]
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
    # What is diagonally dominant is positive definite.
    least, roots = min(x, y, z), [draw.sign() * factor**0.5 for factor in factors]
    xy, xz, yz = (
        roots[i] * roots[j] * product or draw.sign() * draw.share(*_SMALL) * least
        for (i, j), product in zip(((0, 1), (0, 2), (1, 2)), inertia[3:], strict=True)
    )
    return y + z, x + z, x + y, xy, xz, yz
