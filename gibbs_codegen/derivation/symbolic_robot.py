"""The robot in symbols: its coordinates, its root, and its chains as trees of segments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia, total
from gibbs_codegen.derivation.parameters import Parameters
from gibbs_codegen.derivation.regrouping import regrouped
from gibbs_codegen.derivation.root.choice import root_of
from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.segment_tree import Segment, SegmentTree
from gibbs_codegen.derivation.tree_builder import JointedLink, tree_of_links
from gibbs_codegen.derivation.tree_dynamics import State
from gibbs_codegen.robot.chains import Chain, decompose
from gibbs_codegen.robot.coordinates import inputs
from gibbs_codegen.robot.layout import Places, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.exact_angles import gather
from gibbs_codegen.symbolic.inline_tape import InlineTape
from gibbs_codegen.symbolic.tape import Scalars, Stage
from gibbs_codegen.symbolic.vectors import Rotation, Vector, axis_vector


@dataclass(frozen=True)
class SymbolicRobot:
    """Symbols and parts of one robot on one tape.

    `q`, `v`, `a`, `u` are the symbols of the reduced coordinates, the velocities, their rates and
    the inputs, in the orders of `robot/coordinates`, `q0` and `q1` the coordinates of two
    configurations. `parents` holds, for each link of the arm, the index of the segment that it is
    on: 0 for the base, i for link i.
    """

    robot: Robot
    tape: Scalars
    parameters: Parameters
    root: Root
    parents: tuple[int, ...]
    q: tuple[sp.Symbol, ...]
    v: tuple[sp.Symbol, ...]
    a: tuple[sp.Symbol, ...]
    u: tuple[sp.Symbol, ...]
    q0: tuple[sp.Symbol, ...]
    q1: tuple[sp.Symbol, ...]

    @classmethod
    def of(cls, robot: Robot, tape: Scalars, keep_zeros: bool = False) -> SymbolicRobot:
        """Introduce a robot's symbols on `tape`.

        Args:
            robot: The robot.
            keep_zeros: Whether parameters that are zero keep their symbols.

        Returns:
            The robot in symbols.
        """
        layout = layout_of(robot)
        q = tuple(tape.symbol(name, Stage.CONFIGURATION) for name in layout.q.names)
        v, a = (
            tuple(tape.symbol(f"{letter}_{name}", Stage.MOTION) for name in layout.v.names)
            for letter in "va"
        )
        u = tuple(tape.symbol(entry.name, Stage.MOTION) for entry in inputs(robot))
        q1, q0 = (  # First what differences are taken of.
            tuple(tape.symbol(f"{place}_{name}", Stage.CONFIGURATION) for name in layout.q.names)
            for place in ("q1", "q0")
        )
        with tape.group("attitude"):
            root = root_of(robot, tape, q)
        parameters = Parameters(robot, tape, keep_zeros)
        parents = tuple(range(len(robot.links)))
        return cls(robot, tape, parameters, root, parents, q, v, a, u, q0, q1)

    @property
    def joints(self) -> int:
        """n, the number of the arm's joints."""
        return len(self.robot.links)

    @property
    def places(self) -> Places:
        """Places of the base and the joints in v and a."""
        return self.root.places(self.joints)

    @property
    def state(self) -> State:
        """Rates, accelerations and gravity, as the tree of the reduced system takes them."""
        return State(self.v, self.a, self.parameters.gravity)

    @property
    def origin(self) -> Vector:
        """World position of the origin of the coordinates."""
        x, y, z = self.q[layout_of(self.robot).q.position]
        return (x, y, z)

    @property
    def centre_offset(self) -> sp.Expr:
        """Distance from the origin of the coordinates to the base centre O₂, along x₁."""
        if self.robot.base.origin == "centre":
            return sp.S.Zero
        return self.parameters.arm(1).length

    @property
    def tip_segment(self) -> int:
        """Index of the segment that ends in the tip: the last link."""
        return self.joints

    @property
    def reach(self) -> sp.Expr:
        """Distance from the tip segment's joint to the tip, along the segment's x axis.

        Without an arm the tip is the base centre.
        """
        if self.joints == 0:
            return self.centre_offset
        return self.parameters.link(self.joints).body.length

    def arm_1_inertia(self) -> Inertia:
        """Inertia of arm 1 about the origin of the coordinates, in its own frame."""
        inertia = self.parameters.arm(1).inertia
        if self.robot.base.origin == "motor1":
            return inertia
        return inertia.shifted(InlineTape(), axis_vector(0, -self.parameters.arm(1).length))

    def base_inertia(self) -> Inertia:
        """Inertia of the rigid base about the origin in arm 1's frame: the chains' sum at the root.

        Arms of one table share their parameters; what vanishes by symmetry vanishes here.
        """
        inline, base = InlineTape(), self.robot.base
        arms = [
            self.parameters.arm(k).inertia.rotated(
                inline, Rotation.degrees(2, base.arm_angle_deg(k))
            )
            for k in range(2, base.rotors + 1)
        ]
        outer = total(inline, arms).shifted(inline, axis_vector(0, self.centre_offset))
        with self.tape.group("inertia of the base, about the origin", Stage.PARAMETER):
            return total(inline, [outer, self.arm_1_inertia()]).mapped(gather).mapped(self.tape.let)

    @cached_property
    def reduced_tree(self) -> SegmentTree:
        """The arm on the rigid base, regrouped: what the reduced system is derived from."""
        return regrouped(self.tape, self._arm_on(self._root_segment(self.base_inertia())))

    @cached_property
    def open_chains(self) -> tuple[tuple[Chain, SegmentTree], ...]:
        """The chains of the decomposition by themselves, each with the mass that it has there."""
        return tuple((chain, self._chain_tree(chain)) for chain in decompose(self.robot))

    def _chain_tree(self, chain: Chain) -> SegmentTree:
        with self.tape.group("inertia of base arm 1, about the origin", Stage.PARAMETER):
            inertia = self.arm_1_inertia() if 1 in chain.massive else NO_INERTIA
            root = self._root_segment(inertia.mapped(self.tape.let))
        if chain.is_constrained:
            return SegmentTree((root, self._base_arm_segment(chain.links[-1])))
        return self._arm_on(root)

    def _root_segment(self, inertia: Inertia) -> Segment:
        return Segment(inertia, self.root.segment_rotation, name="the base")

    def _base_arm_segment(self, k: int) -> Segment:
        angle, name = self.robot.base.arm_angle_deg(k), f"base arm {k}"
        with self.tape.group(f"inertia of {name}", Stage.PARAMETER):
            inertia = self.parameters.arm(k).inertia.mapped(self.tape.let)
        return Segment(
            inertia=inertia,
            rotation=Rotation.degrees(2, angle),
            parent=0,
            a=self.centre_offset,
            name=name,
            joint_name=f"joint {k}",
        )

    def _arm_on(self, root: Segment) -> SegmentTree:
        """The links of the arm on a root segment."""
        return tree_of_links(self.tape, root, self.root.segment_angle, self.arm_links)

    @property
    def arm_links(self) -> list[JointedLink]:
        """The links of the arm, each with its own inertia."""
        coordinates = self.q[layout_of(self.robot).q.joints]
        links = []
        for i, (link, parent) in enumerate(zip(self.robot.links, self.parents, strict=True), 1):
            symbols = self.parameters.link(i)
            links.append(
                JointedLink(
                    parent=parent,
                    inertia=symbols.body.inertia,
                    joint=link.joint,
                    coordinate=coordinates[i - 1],
                    a=symbols.a + (self.centre_offset if parent == 0 else 0),
                    d=symbols.d,
                    alpha_deg=link.alpha_deg,
                    theta_deg=link.theta_deg,
                    name=f"link {i}",
                    joint_name=f"joint {self.robot.rotors + i}",
                )
            )
        return links
