"""Parameters of a robot: symbols named after the keys of its file, and inertias made of them.

A value that is exactly zero in the file is structural: it is folded away and is no parameter,
unless all are kept. Inertias are plain polynomials in the parameters, which no tape has named yet,
so that sums over arms that vanish by symmetry can be seen to vanish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.robot.model import (
    AXES,
    AXIS_PAIRS,
    BASE,
    PASSIVE_UNITS,
    Body,
    Constraint,
    Robot,
    Rod,
    Servo,
    Vector3,
)
from gibbs_codegen.robot.names import (
    constraint_prefix,
    frame_prefix,
    parameter_prefix,
    rotor_prefix,
)
from gibbs_codegen.symbolic.tape import InlineTape, Scalars, Stage, Vector
from gibbs_codegen.symbolic.vectors import ZERO


@dataclass(frozen=True)
class BodySymbols:
    """Length of a body, and its inertia about its joint in its own frame."""

    length: sp.Expr
    inertia: Inertia


@dataclass(frozen=True)
class PassiveSymbols:
    """What acts on a joint by itself, as `robot.model.Passive` has it."""

    damping: sp.Expr
    armature: sp.Expr
    stiffness: sp.Expr
    rest: sp.Expr


@dataclass(frozen=True)
class LinkSymbols:
    """Where a link is, its body, and what acts on its joint.

    By Denavit–Hartenberg `a` (by default the length of the link before) and `d` place it, otherwise
    `position`.
    """

    a: sp.Expr
    d: sp.Expr
    position: Vector
    body: BodySymbols
    passive: PassiveSymbols


@dataclass(frozen=True)
class ServoSymbols:
    """A servo, as `robot.model.Servo` has it; None is no limit. Of rates it has no stiffness."""

    damping: sp.Expr
    torque: sp.Expr | None
    delay: sp.Expr
    rate: sp.Expr | None = None
    stiffness: sp.Expr = sp.S.Zero
    backlash: sp.Expr = sp.S.Zero


@dataclass(frozen=True)
class ConstraintSymbols:
    """A constraint's anchor (m), distance (m) and gains.

    `attitude` is the quaternion of a whole frame's anchor in the world; others are structural.
    """

    anchor: Vector
    attitude: Vector
    distance: sp.Expr
    frequency: sp.Expr
    damping_ratio: sp.Expr


NOT_PASSIVE = PassiveSymbols(*(sp.S.Zero,) * 4)


class Parameters:
    """Symbols for the numbers of a robot file, with their defaults in `defaults`, units in `units`.

    `folded` names those that are zero in the file and therefore structural.
    `arms`, with the `drags` of their motors (m), `links` and placed `rotors`, with position (m) and
    drag (m), are by number, from 1, `frames` by name: positions in the frame of the body that they
    are on (m), and `constraints`. `central_body` is its inertia about the base centre, None where
    there is none.

    Where a robot has actuators, `curves`, `times` and, where they are known, `speeds` of its rotors
    are by number, `servos` and `frictions` by link; `battery` by the names of its keys, and its
    `voltages` from empty to full.
    """

    def __init__(self, robot: Robot, tape: Scalars, keep_zeros: bool = False) -> None:
        self.defaults: dict[str, float] = {}
        self.units: dict[str, str] = {}
        self.folded: list[str] = []
        self.robot = robot
        self._tape = tape
        self._keep_zeros, self._kept = keep_zeros, set[str]()
        # All at once, in the order of the file, whatever the derivation asks for first.
        self.gravity = self._value("gravity", robot.gravity, "m/s^2")
        arms = range(1, robot.base.rotors + 1)
        self.drags = {k: self._value(f"base_drag_{k}", robot.base.drag[k - 1], "m") for k in arms}
        number = "" if robot.base.shares_one_arm else "{}"
        self.arms = {k: self._body(f"base_arm{number.format(k)}", robot.base.arm(k)) for k in arms}
        central = self._body("base", robot.base.body) if robot.base.body else None
        self.central_body = central.inertia if central else None
        self.links = {i: self._link(i) for i in range(1, len(robot.links) + 1)}
        self.rotors: dict[int, tuple[Vector, sp.Expr]] = {}
        for k, rotor in enumerate(robot.thrusters, start=1):
            prefix = rotor_prefix(robot, k)
            position = self._vector(prefix, rotor.position)
            self.rotors[k] = position, self._value(f"{prefix}_drag", rotor.drag, "m")
        self.frames = {
            frame.name: self._vector(frame_prefix(frame.name), frame.pose.xyz)
            for frame in robot.frames
        }
        self.constraints = {each.name: self._constraint(each) for each in robot.constraints}
        self.curves: dict[int, Vector] = {}
        self.times: dict[int, tuple[sp.Expr, sp.Expr]] = {}
        self.speeds: dict[int, sp.Expr] = {}
        self.servos: dict[int, ServoSymbols] = {}
        self.frictions: dict[int, Vector] = {}
        self.battery: dict[str, sp.Expr] = {}
        self.voltages: list[sp.Expr] = []
        if robot.has_actuators:
            self._actuators()

    def _actuators(self) -> None:
        """Symbols of the numbers of rotors' drives, servos, friction and the battery."""
        robot = self.robot
        for k, drive in enumerate(robot.drives, start=1):
            prefix = rotor_prefix(robot, k) if robot.thrusters else f"motor{k}"
            self.curves[k] = (sp.S.Zero, sp.S.One, sp.S.Zero)
            if drive.command != "thrust":
                per = "N/(rad/s)" if drive.command == "speed" else "N"
                of_curve = "N", per, f"{per}^2" if drive.command == "speed" else per
                self.curves[k] = tuple(
                    self._value(f"{prefix}_thrust_{n}", value, unit)
                    for n, (value, unit) in enumerate(zip(drive.curve, of_curve, strict=True))
                )
            if drive.full_speed is not None:
                self.speeds[k] = self._value(f"{prefix}_full_speed", drive.full_speed, "rad/s")
            elif drive.command == "thrust" and robot.thrusters:
                known = robot.thrusters[k - 1].speed_per_sqrt_thrust or 0.0
                name = f"{prefix}_speed_per_sqrt_thrust"
                self.speeds[k] = self._value(name, known, "rad/s/N^0.5")
            if drive.lags:
                ends = ("up", "down") if drive.up != drive.down else ("constant",) * 2
                up, down = (
                    self._value(f"{prefix}_time_{end}", value, "s")
                    for end, value in zip(ends, (drive.up, drive.down), strict=True)
                )
                self.times[k] = up, down
        for i in robot.moving:
            self._drive_of_joint(i)
        if robot.battery is not None:
            own = robot.battery
            units = {
                "nominal": "V",
                "resistance": "ohm",
                "capacity": "A h",
                "efficiency": "1",
                "auxiliary": "W",
            }
            self.battery = {
                name: self._value(f"battery_{name}", getattr(own, name), unit)
                for name, unit in units.items()
            }
            numbered = [str(n) for n in range(1, len(own.voltages) + 1)]
            self.voltages = [*self._values("battery_voltage", numbered, own.voltages, "V")]

    def _drive_of_joint(self, i: int) -> None:
        """Symbols of the servo and of the friction of link i's joint."""
        link, prefix = self.robot.links[i - 1], parameter_prefix(self.robot, i)
        slides = link.joint == "prismatic"
        length, force = ("m", "N") if slides else ("rad", "N m")
        if link.servo is not None:
            units = (f"{force}/{length}", f"{force} s/{length}", force, f"{length}/s", "s", length)
            unit = dict(zip(Servo().numbers, units, strict=True))
            self.servos[i] = ServoSymbols(
                **{
                    name: None
                    if x is None
                    else self._value(f"{prefix}_servo_{name}", x, unit[name])
                    for name, x in link.servo.numbers.items()
                }
            )
        if link.friction is not None:
            dry, names = link.friction, ("coulomb", "static")
            forces = self._values(f"{prefix}_friction", names, (dry.coulomb, dry.static), force)
            velocity = self._value(f"{prefix}_friction_velocity", dry.velocity, f"{length}/s")
            self.frictions[i] = (*forces, velocity)

    def _value(self, name: str, default: float, unit: str) -> sp.Expr:
        """The symbol of a parameter, its default and unit noted, or zero where it is structural."""
        if default == 0.0 and not (self._keep_zeros or name in self._kept):
            if name not in self.folded:
                self.folded.append(name)
            return sp.S.Zero
        self.defaults[name] = default
        self.units[name] = unit
        return self._tape.symbol(name, Stage.PARAMETER)

    def _link(self, i: int) -> LinkSymbols:
        link, prefix = self.robot.links[i - 1], parameter_prefix(self.robot, i)
        parent = self.robot.parents[i - 1]
        a = d = sp.S.Zero
        position = ZERO
        if link.pose is not None:
            position = self._vector(prefix, link.pose.xyz)
        else:
            if link.a is not None:
                a = self._value(f"{prefix}_a", link.a, "m")
            elif parent != BASE:  # The length of the link that carries it.
                before = self.robot.links[parent - 1].body.length
                a = self._value(f"{parameter_prefix(self.robot, parent)}_length", before, "m")
            d = self._value(f"{prefix}_d", link.d, "m")
        body = self._body(prefix, link.body)
        if not link.moves:
            return LinkSymbols(a, d, position, body, NOT_PASSIVE)
        units = PASSIVE_UNITS["revolute" if link.joint == "revolute" else "prismatic"]
        own = zip(asdict(link.passive).items(), units, strict=True)
        # Steps that take a damper's or servo's torque at their end need an armature that is larger.
        if link.passive.damping or link.servo:
            self._kept.add(f"{prefix}_armature")
        passive = (self._value(f"{prefix}_{name}", x, unit) for (name, x), unit in own)
        return LinkSymbols(a, d, position, body, PassiveSymbols(*passive))

    def _constraint(self, own: Constraint) -> ConstraintSymbols:
        """Symbols of a constraint; an anchor in the world may be anywhere at any time."""
        prefix, parts = constraint_prefix(own.name), ("qx", "qy", "qz", "qw")
        if own.to is None:
            self._kept |= {f"{prefix}_{end}" for end in (*AXES, *parts)}
        anchor = self._vector(prefix, own.anchor.xyz)
        attitude: Vector = ()
        if own.to is None and own.kind == "frame":
            attitude = self._values(prefix, parts, own.anchor.quaternion, "1")
        distance = frequency = damping_ratio = sp.S.Zero
        if own.kind == "distance":
            distance = self._value(f"{prefix}_distance", own.distance, "m")
        if own.frequency:
            frequency = self._value(f"{prefix}_frequency", own.frequency, "rad/s")
            damping_ratio = self._value(f"{prefix}_damping_ratio", own.damping_ratio, "1")
        return ConstraintSymbols(anchor, attitude, distance, frequency, damping_ratio)

    def _vector(self, prefix: str, values: Vector3) -> Vector:
        return self._values(prefix, ("x", "y", "z"), values, "m")

    def _values(
        self, prefix: str, names: Sequence[str], values: Sequence[float], unit: str
    ) -> tuple[sp.Expr, ...]:
        """Symbols of several numbers of one unit, by the ends of their names."""
        pairs = zip(names, values, strict=True)
        return tuple(self._value(f"{prefix}_{name}", value, unit) for name, value in pairs)

    def _body(self, prefix: str, body: Body) -> BodySymbols:
        length = self._value(f"{prefix}_length", body.length, "m")
        words = f"second moments of {prefix}, corrected for rounding"
        with self._tape.group(words, Stage.PARAMETER):
            zero, excess = sp.S.Zero, self._half_excess
            if isinstance(body, Rod):
                # About its start: B₀ = μl, C = (μl²/2, 0, 0), B₂ = diag(0, μl³/3, μl³/3), and the
                # section's B₃.
                density = self._value(f"{prefix}_mass_per_length", body.mass_per_length, "kg/m")
                own, names = body.section_inertia, AXIS_PAIRS[:3]
                x, y, z = self._values(f"{prefix}_section_inertia", names, own, "kg m^2")
                along = self._tape.let(density * length**3 / 3 + excess(y, z, x))
                second = (along, excess(z, x, y), excess(x, y, z), zero, zero, zero)
                moment = (density * length**2 / 2, zero, zero)
                return BodySymbols(length, Inertia(density * length, moment, second))
            mass = self._value(f"{prefix}_mass", body.mass, "kg")
            com = self._vector(f"{prefix}_com", body.com)
            entries = self._values(f"{prefix}_inertia", AXIS_PAIRS, body.inertia, "kg m^2")
            xx, yy, zz, xy, xz, yz = entries
            second = (excess(yy, zz, xx), excess(zz, xx, yy), excess(xx, yy, zz), -xy, -xz, -yz)
            about_com = Inertia(mass, (zero, zero, zero), second)
            return BodySymbols(length, about_com.shifted(InlineTape(), com))

    def _half_excess(self, first: sp.Expr, second: sp.Expr, whole: sp.Expr) -> sp.Expr:
        """½(first + second − whole), which is E_xx for the moments of inertia I_yy, I_zz, I_xx.

        The mass matrix adds second moments up to moments of inertia again, so E_xx must be exact to
        a rounding of the smaller of I_yy and I_zz, however slender or flat the body is. No moment
        of inertia is larger than the sum of the other two. So where the rounding of first − whole
        is too large for that, `first` is less than half of `whole`, and the rounding can be
        computed exactly and added (Dekker's sum of two numbers).
        """
        let = self._tape.let
        difference = let(first - whole)
        rounding = let(first - let(difference + whole))
        return let(let(let(difference + second) + rounding) / 2)
