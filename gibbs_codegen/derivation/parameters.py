"""Parameters of a robot: symbols named after the keys of its file, and inertias made of them.

A value that is exactly zero in the file is structural: it is folded away and is no parameter,
unless all are kept. Inertias are plain polynomials in the parameters, which no tape has named yet,
so that sums over arms that vanish by symmetry can be seen to vanish.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import sympy as sp

from gibbs_codegen.arrays.nodes import Node, variable, zeros
from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia, total
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import frame_prefix, parameter_prefix, rotor_prefix, tie_prefix
from gibbs_codegen.robot.parts.body import Body, Rod
from gibbs_codegen.robot.parts.constraint import QUATERNION
from gibbs_codegen.robot.parts.numbers import BASE, XYZ
from gibbs_codegen.robot.parts.part import Part, RobotNumber, changed_numbers
from gibbs_codegen.robot.parts.ties import Tie
from gibbs_codegen.symbolic.tape import InlineTape, Scalars, Stage, Vector, plus, times
from gibbs_codegen.symbolic.vectors import ZERO, Rotation


@dataclass(frozen=True)
class BodySymbols:
    """Length of a body, and its inertia about its joint in its own frame."""

    length: sp.Expr
    inertia: Inertia


@dataclass(frozen=True)
class PassiveSymbols:
    """Passive forces of a joint, as in `robot.model.Passive`."""

    damping: sp.Expr
    armature: sp.Expr
    stiffness: sp.Expr
    rest: sp.Expr


@dataclass(frozen=True)
class LinkSymbols:
    """Place and body of a link, and the forces at its joint.

    By Denavit–Hartenberg `a` (by default the length of the link before) and `d` place it, otherwise
    `position`. With `geared`, gear ratio N times inertia J of a motor's rotor, what that does as it
    turns with N q̇ in what carries the joint, ½ J N² q̇² + J N q̇ ω·axis, is what J N does as inertia
    about the axis of the link, −J N of the carrier, and J N (N − 1) as armature. `radius` is that
    of a wheel.
    """

    a: sp.Expr
    d: sp.Expr
    position: Vector
    body: BodySymbols
    passive: PassiveSymbols
    geared: sp.Expr = sp.S.Zero
    radius: sp.Expr = sp.S.Zero


NOT_PASSIVE = PassiveSymbols(*(sp.S.Zero,) * 4)


class Parameters:
    """Symbols for the numbers of a robot file, with their defaults in `defaults`, units in `units`.

    `folded` names those that are zero in the file and therefore structural.
    `arms`, `links` and `rotors` are by number, from 1, `frames` by name: positions in the frame of
    the body that they are on (m). `base_place` is that of the base where nothing has moved. Virtual
    links are −1, −2 …. Symbols of `ties` are by their prefix, then by their fields.
    `central_body` is its inertia about the base centre, None where there is none.

    Symbols of a rotor are by the keys of its numbers, of a motor at the end of a rod by "drag".
    """

    def __init__(self, robot: Robot, tape: Scalars, keep_zeros: bool = False) -> None:
        self.defaults: dict[str, float] = {}
        self.units: dict[str, str] = {}
        self.folded: list[str] = []
        self.robot = robot
        self._tape = tape
        self._keep_zeros, self._kept = keep_zeros, set[str]()
        # All at once, in the order of the file, whatever the derivation asks for first.
        self.gravity = self._symbols(robot, "")["gravity"]
        arms, base = range(1, robot.base.rotors + 1), robot.base
        drags = self._symbols(base, "base")["drag"]
        self.rotors = {k: {"drag": drag} for k, drag in zip(arms, drags, strict=True)}
        shared = self._body("base_arm", base.arm(1)) if base.shares_one_arm else None
        self.arms = {k: shared or self._body(f"base_arm{k}", base.arm(k)) for k in arms}
        self.base_place: Vector = ZERO
        if not base.moves_freely:
            self.base_place = self._symbols(base.pose, "base")["xyz"]
        self.central_body = self._body("base", base.body).inertia if base.body else None
        self.links: dict[int, LinkSymbols] = {}
        for i in range(1, len(robot.links) + 1):
            self.links[i] = self._link(i)
        for k in range(1, len(base.virtual_joints) + 1):
            nowhere, massless = sp.S.Zero, BodySymbols(sp.S.Zero, NO_INERTIA)
            self.links[-k] = LinkSymbols(nowhere, nowhere, ZERO, massless, NOT_PASSIVE)
        for k, rotor in enumerate(robot.thrusters, start=1):
            self.rotors[k] = self._symbols(rotor, rotor_prefix(robot, k))
        self.frames = {
            frame.name: self._symbols(frame.pose, frame_prefix(frame.name))["xyz"]
            for frame in robot.frames
        }
        self.ties = {tie_prefix(tie): self._tie(tie) for tie in robot.ties}

    @cached_property
    def rods(self) -> Inertia:
        """Inertia of the base's rods from the second on, about the base centre, in its axes."""
        inline, base = InlineTape(), self.robot.base
        turns = {k: Rotation.degrees(2, base.arm_angle_deg(k)) for k in range(2, base.rotors + 1)}
        rods = [self.arms[k].inertia.rotated(inline, turn) for k, turn in turns.items()]
        return total(inline, rods) if rods else NO_INERTIA

    def node(self, number: RobotNumber) -> Node:
        """An input of array programs for a parameter, or zero where it is structural."""
        return zeros() if self._symbol(number) == 0 else variable(number.name, uniform=True)

    def _symbols(self, part: Part, prefix: str, slides: bool = False) -> dict[str, Any]:
        """Symbols of the numbers of a part, by its fields."""
        return changed_numbers(part, prefix, self._symbol, slides)

    def _symbol(self, number: RobotNumber) -> sp.Expr:
        """The symbol of a parameter, its default and unit noted, or zero where it is structural."""
        name = number.name
        if number.value == 0.0 and not (self._keep_zeros or name in self._kept):
            if name not in self.folded:
                self.folded.append(name)
            return sp.S.Zero
        self.defaults[name] = number.value
        self.units[name] = number.unit
        return self._tape.symbol(name, Stage.PARAMETER)

    def _link(self, i: int) -> LinkSymbols:
        link, prefix = self.robot.links[i - 1], parameter_prefix(self.robot, i)
        parent, position = self.robot.parents[i - 1], ZERO
        step: dict[str, sp.Expr] = {"a": sp.S.Zero, "d": sp.S.Zero}
        if link.pose is not None:
            position = self._symbols(link.pose, prefix)["xyz"]
        else:
            if parent != BASE:  # The length of the link that carries it.
                step["a"] = self.links[parent].body.length
            step |= self._symbols(link, prefix)
        body = self._body(prefix, link.body)
        if not link.moves:
            return LinkSymbols(**step, position=position, body=body, passive=NOT_PASSIVE)
        # Steps that take a damper's or servo's torque at their end need an armature that is larger.
        if link.passive.damping or link.servo:
            self._kept.add(f"{prefix}_armature")
        passive = PassiveSymbols(**self._symbols(link.passive, prefix, link.slides))
        geared = sp.S.Zero
        if link.motor:
            motor = self._symbols(link.motor, prefix)
            with self._tape.group("inertias of rotors behind gears", Stage.PARAMETER):
                geared = self._tape.let(motor["rotor_inertia"] * motor["gear_ratio"])
                reflected = self._tape.let(geared * self._tape.let(motor["gear_ratio"] - 1))
                armature = self._tape.let(passive.armature + reflected)
            passive = replace(passive, armature=armature)
        more = self._symbols(link.rolling, prefix) if link.rolling else {"geared": geared}
        return LinkSymbols(**step, **more, position=position, body=body, passive=passive)

    def _tie(self, tie: Tie) -> dict[str, Any]:
        """Symbols of a tie; an anchor in the world may be anywhere at any time."""
        prefix = tie_prefix(tie)
        if tie.to is None:
            self._kept |= {f"{prefix}_{end}" for end in (*XYZ, *QUATERNION.ends)}
        return self._symbols(tie, prefix)

    def _body(self, prefix: str, body: Body) -> BodySymbols:
        symbols = self._symbols(body, prefix)
        length, words = symbols["length"], f"second moments of {prefix}, corrected for rounding"
        with self._tape.group(words, Stage.PARAMETER):
            zero, excess = sp.S.Zero, self._half_excess
            if isinstance(body, Rod):
                # About its start: B₀ = μl, C = (μl²/2, 0, 0), B₂ = diag(0, μl³/3, μl³/3), and the
                # section's B₃.
                density, (x, y, z) = symbols["mass_per_length"], symbols["section_inertia"]
                along = self._tape.let(density * length**3 / 3 + excess(y, z, x))
                second = (along, excess(z, x, y), excess(x, y, z), zero, zero, zero)
                moment = (density * length**2 / 2, zero, zero)
                return BodySymbols(length, Inertia(density * length, moment, second))
            xx, yy, zz, xy, xz, yz = symbols["inertia"]
            second = (excess(yy, zz, xx), excess(zz, xx, yy), excess(xx, yy, zz), -xy, -xz, -yz)
            about_com = Inertia(symbols["mass"], (zero, zero, zero), second)
            return BodySymbols(length, about_com.shifted(InlineTape(), symbols["com"]))

    def _half_excess(self, first: sp.Expr, second: sp.Expr, whole: sp.Expr) -> sp.Expr:
        """½(first + second − whole), which is E_xx for the moments of inertia I_yy, I_zz, I_xx.

        The mass matrix adds second moments up to moments of inertia again, so E_xx must be exact to
        a rounding of the smaller of I_yy and I_zz, however slender or flat the body is. No moment
        of inertia is larger than the sum of the other two. So where the rounding of first − whole
        is too large for that, `first` is less than half of `whole`, and the rounding can be
        computed exactly and added (Dekker's sum of two numbers).
        """
        tape = self._tape
        if second == whole:  # Moments of a disc.
            return tape.let(times(sp.S.Half, first))
        difference = tape.less(first, whole)
        rounding = tape.less(first, tape.let(plus(difference, whole)))
        excess = tape.let(plus(tape.let(plus(difference, second)), rounding))
        return tape.let(times(sp.S.Half, excess))
