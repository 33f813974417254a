"""The robot in symbols: its coordinates, its root, and its chains as rows of segments."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia, total
from gibbs_codegen.derivation.parameters import Parameters
from gibbs_codegen.derivation.root.choice import root_of
from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.serial_chain import Segment, SerialChain, regrouped
from gibbs_codegen.robot.chains import Chain, decompose
from gibbs_codegen.robot.coordinates import inputs
from gibbs_codegen.robot.layout import Places, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.exact_angles import gather, radians
from gibbs_codegen.symbolic.tape import InlineTape, Scalars, Stage
from gibbs_codegen.symbolic.vectors import NO_ROTATION, Rotation, Vector, axis_vector


@dataclass(frozen=True)
class Machine:
    """Symbols and parts of one robot on one tape.

    `q`, `v`, `a`, `u` are the symbols of the reduced coordinates, their rates, their accelerations
    and the inputs, in the order of `coordinates`.
    """

    robot: Robot
    tape: Scalars
    parameters: Parameters
    root: Root
    q: tuple[sp.Symbol, ...]
    v: tuple[sp.Symbol, ...]
    a: tuple[sp.Symbol, ...]
    u: tuple[sp.Symbol, ...]

    @classmethod
    def of(cls, robot: Robot, tape: Scalars, keep_zeros: bool = False) -> Machine:
        """Introduce the robot's symbols on `tape`; `keep_zeros` keeps parameters that are zero."""
        names = layout_of(robot).names
        q = tuple(tape.symbol(name, Stage.CONFIGURATION) for name in names)
        v, a = (
            tuple(tape.symbol(f"{letter}_{name}", Stage.MOTION) for name in names)
            for letter in "va"
        )
        u = tuple(tape.symbol(entry.name, Stage.MOTION) for entry in inputs(robot))
        with tape.group("attitude"):
            root = root_of(robot, tape, q)
        return cls(robot, tape, Parameters(robot, tape, keep_zeros), root, q, v, a, u)

    @property
    def joints(self) -> int:
        """n, the number of the arm's joints."""
        return len(self.robot.links)

    @property
    def places(self) -> Places:
        """Places of the base and the joints in q, v and a."""
        return self.root.places(self.joints)

    @property
    def origin(self) -> Vector:
        """World position of the origin of the coordinates."""
        base, _ = self.places.split(self.q)
        return self.root.origin(base)

    @property
    def centre_offset(self) -> sp.Expr:
        """Distance from the origin of the coordinates to the base centre O₂, along x₁."""
        if self.robot.base.origin == "centre":
            return sp.S.Zero
        return self.parameters.arm_length(1)

    @property
    def reach(self) -> sp.Expr:
        """Distance from the last segment's joint to the tip, along the segment's x axis.

        Without an arm the tip is the base centre.
        """
        if self.joints == 0:
            return self.centre_offset
        return self.parameters.link(self.joints).body.length

    def arm_1_inertia(self) -> Inertia:
        """Inertia of arm 1 about the origin of the coordinates, in its own frame."""
        inertia = self.parameters.arm_inertia(1)
        if self.robot.base.origin == "motor1":
            return inertia
        return inertia.shifted(InlineTape(), axis_vector(0, -self.parameters.arm_length(1)))

    def base_inertia(self) -> Inertia:
        """Inertia of the rigid base about the origin in arm 1's frame: the chains' sum at the root.

        Arms of one table share their parameters; what vanishes by symmetry vanishes here.
        """
        inline, base = InlineTape(), self.robot.base
        arms = [
            self.parameters.arm_inertia(k).rotated(
                inline, Rotation.degrees(2, base.arm_angle_deg(k))
            )
            for k in range(2, base.rotors + 1)
        ]
        outer = total(inline, arms).shifted(inline, axis_vector(0, self.centre_offset))
        with self.tape.group("inertia of the base, about the origin", Stage.PARAMETER):
            return total(inline, [outer, self.arm_1_inertia()]).mapped(gather).mapped(self.tape.let)

    @cached_property
    def reduced_chain(self) -> SerialChain:
        """The arm on the rigid base, regrouped: what the reduced system is derived from."""
        chain = SerialChain((self._root_segment(self.base_inertia()), *self._arm_segments()))
        offsets = [NO_ROTATION] + [Rotation.degrees(2, link.theta_deg) for link in self.robot.links]
        return regrouped(self.tape, chain, offsets)

    @cached_property
    def open_chains(self) -> tuple[tuple[Chain, SerialChain], ...]:
        """The chains of the decomposition by themselves, each with the mass that it has there."""
        return tuple((chain, self._serial_chain(chain)) for chain in decompose(self.robot))

    def _serial_chain(self, chain: Chain) -> SerialChain:
        with self.tape.group("inertia of base arm 1, about the origin", Stage.PARAMETER):
            inertia = self.arm_1_inertia() if 1 in chain.massive else NO_INERTIA
            root = self._root_segment(inertia.mapped(self.tape.let))
        if chain.is_constrained:
            return SerialChain((root, self._base_arm_segment(chain.links[-1])))
        return SerialChain((root, *self._arm_segments()))

    def _root_segment(self, inertia: Inertia) -> Segment:
        return Segment(inertia, self.root.segment_rotation, name="the base")

    def _base_arm_segment(self, k: int) -> Segment:
        angle, name = self.robot.base.arm_angle_deg(k), f"base arm {k}"
        with self.tape.group(f"inertia of {name}", Stage.PARAMETER):
            inertia = self.parameters.arm_inertia(k).mapped(self.tape.let)
        return Segment(
            inertia=inertia,
            rotation=Rotation.degrees(2, angle),
            a=self.centre_offset,
            name=name,
            joint_name=f"joint {k}",
        )

    def _arm_segments(self) -> list[Segment]:
        segments = []
        # Sum of the joint angles since the carrier, θ₁ included where the base normal starts the
        # first group, and of the angles that the file fixes.
        angle, structural = self.root.segment_angle, Fraction(0)
        _, joints = self.places.split(self.q)
        for i, (link, joint) in enumerate(zip(self.robot.links, joints, strict=True), start=1):
            leads = link.alpha_deg % 360 != 0
            if leads:
                angle, structural = sp.S.Zero, Fraction(0)
            structural += link.theta_deg
            symbols = self.parameters.link(i)
            d = symbols.d
            if link.joint == "revolute":
                angle += joint
            else:
                d += joint
            with self.tape.group("inertias of the links", Stage.PARAMETER):
                inertia = symbols.body.inertia.mapped(self.tape.let)
            with self.tape.group("angles and places of the joints", Stage.PARAMETER):
                segments.append(
                    Segment(
                        inertia=inertia,
                        rotation=self._carrier_rotation(angle, structural),
                        joint=link.joint,
                        a=self.tape.let(symbols.a + (self.centre_offset if i == 1 else 0)),
                        d=self.tape.let(d),
                        twist=Rotation.degrees(0, link.alpha_deg),
                        leads=leads,
                        name=f"link {i}",
                        joint_name=f"joint {self.robot.rotors + i}",
                    )
                )
        return segments

    def _carrier_rotation(self, angle: sp.Expr, structural: Fraction) -> Rotation:
        if angle == 0:
            return Rotation.degrees(2, structural)
        return Rotation.angle(self.tape, 2, angle + radians(structural % 360))
