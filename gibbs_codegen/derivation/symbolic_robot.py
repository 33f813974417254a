"""The robot in symbols: its coordinates, its root, and its chains as trees of segments."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_INERTIA, Inertia, total
from gibbs_codegen.derivation.jointed_bodies import JointedBodies, jointed_bodies
from gibbs_codegen.derivation.motion import TreeState
from gibbs_codegen.derivation.parameters import Parameters
from gibbs_codegen.derivation.root import Root, root_of
from gibbs_codegen.derivation.segment_tree import Segment, SegmentTree, regrouped, tree_of_links
from gibbs_codegen.machine.drives import Drives
from gibbs_codegen.robot.chains import Chain, decompose
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.layout import Places, coordinate_places
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import FIXED
from gibbs_codegen.robot.parts.gear import Gear
from gibbs_codegen.robot.parts.numbers import BASE, NO_ANGLE
from gibbs_codegen.symbolic.numbers import DIGITS
from gibbs_codegen.symbolic.tape import InlineTape, Scalars, Stage, Values, Vector, times
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Matrix,
    Rotation,
    axis_vector,
    cos_sin_deg,
    gather,
    identity,
    minus,
    structural_number,
)


@dataclass(frozen=True)
class SymbolicRobot:
    """Symbols and parts of one robot on one tape.

    `q`, `v`, `a`, `u` are the symbols of the reduced coordinates, the velocities, their rates and
    the inputs, in the orders of `robot/layout`, `W` those of the wrenches on the frames, row
    by row, `q0` and `q1` the coordinates of two configurations, `w` weights of a vector,
    `w_input_matrix` and `w_jacobian` of a matrix, row by row, `q_dot` to `W_dot` directions of q,
    v, a, u and W, `h` the length of a step, `x` the state of the actuators, `command` what they
    are commanded, `active` 1 for each constraint that holds, else 0, `restitution` the share of
    its velocity with which each rebounds, and `v_r` and `a_r` velocities that are referred to, and
    their rates. `drives` are there if commands are.
    """

    description: Description
    tape: Scalars
    parameters: Parameters
    root: Root
    q: tuple[sp.Symbol, ...]
    v: tuple[sp.Symbol, ...]
    a: tuple[sp.Symbol, ...]
    u: tuple[sp.Symbol, ...]
    W: tuple[sp.Symbol, ...]
    q0: tuple[sp.Symbol, ...]
    q1: tuple[sp.Symbol, ...]
    w: tuple[sp.Symbol, ...]
    q_dot: tuple[sp.Symbol, ...]
    v_dot: tuple[sp.Symbol, ...]
    a_dot: tuple[sp.Symbol, ...]
    u_dot: tuple[sp.Symbol, ...]
    h: tuple[sp.Symbol, ...]
    W_dot: tuple[sp.Symbol, ...]
    w_input_matrix: tuple[sp.Symbol, ...]
    w_jacobian: tuple[sp.Symbol, ...]
    x: tuple[sp.Symbol, ...]
    command: tuple[sp.Symbol, ...]
    active: tuple[sp.Symbol, ...]
    restitution: tuple[sp.Symbol, ...]
    v_r: tuple[sp.Symbol, ...]
    a_r: tuple[sp.Symbol, ...]
    drives: Drives | None

    @classmethod
    def of(cls, robot: Robot, tape: Scalars, keep_zeros: bool = False) -> SymbolicRobot:
        """Introduce a robot's symbols on `tape`; `keep_zeros`: also of parameters that are zero."""
        description = Description(robot)

        def symbols(*arguments: str) -> dict[str, tuple[sp.Symbol, ...]]:
            arrays = {}
            for argument in arguments:
                stage = Stage.CONFIGURATION if argument in ("q", "q0", "q1") else Stage.MOTION
                names = description.local_names[argument]
                arrays[argument] = tuple(tape.symbol(name, stage) for name in names)
            return arrays

        # q₁ comes before q₀: the first has the other subtracted.
        entries = symbols("q", "v", "a", "u", "W", "q1", "q0")
        with tape.group("attitude"):
            root = root_of(description.layout, tape, entries["q"])
        parameters = Parameters(robot, tape, keep_zeros)
        drives = Drives(description, parameters.node) if description.commands else None
        entries |= symbols("w", "q_dot", "v_dot", "a_dot", "u_dot", "h", "W_dot")
        entries |= symbols("w_input_matrix", "w_jacobian", "x", "command", "active", "restitution")
        entries |= symbols("v_r", "a_r")
        return cls(description, tape, parameters, root, **entries, drives=drives)

    @property
    def robot(self) -> Robot:
        """The robot as plain data."""
        return self.description.robot

    @cached_property
    def jointed(self) -> tuple[int, ...]:
        """Numbers of the links whose joints move, before them −1, −2 … of virtual ones."""
        virtual = range(1, len(self.robot.base.virtual_joints) + 1)
        return (*(-k for k in virtual), *self.robot.moving)

    @property
    def root_item(self) -> int:
        """Number of the item that chains begin with: the base, or what virtual links are on."""
        return self.description.layout.base_item - len(self.robot.base.virtual_joints)

    @property
    def joints(self) -> int:
        """n, the number of joints that move."""
        return len(self.jointed)

    @property
    def places(self) -> Places:
        """Places of the base and the joints in v and a."""
        return self.root.places(self.joints)

    @property
    def coordinate_places(self) -> Places:
        """Places of the base, the joints and the wheels in q."""
        kind = FIXED if self.robot.base.virtual_joints else self.description.layout.attitude
        return replace(coordinate_places(kind, self.joints), nothing=sp.S.Zero)

    @cached_property
    def _gearing(self) -> tuple[Matrix, Matrix, list[sp.Expr]]:
        """G, S and offsets: all joints are G times those that have coordinates, and offsets.

        Rates of wheels, which come last, are S times the velocities of the base, attitude first.
        """
        gears = {i: Gear(of=i, ratio=1.0) for i in self.jointed if i < BASE}
        gears |= self.robot.gearing
        values = gears.values()
        ratios = [[_number(gear.ratios.get(i, 0.0)) for i in self.jointed] for gear in values]
        shares = [self._rolled(i) for i in gears]
        return ratios, shares, [_number(gear.offset) for gear in values]

    def _rolled(self, i: int) -> list[sp.Expr]:
        """The rate of link i by the velocities of the base, attitude first: of a wheel.

        Where it touches the ground it does not slip along its x axis, which is ahead.
        """
        link, tape = self.parameters.links[i], self.tape
        if i not in self.robot.wheels:
            return [sp.S.Zero] * 6
        pose = self.robot.links[i - 1].pose
        cos, sin = cos_sin_deg(pose.rpy_deg[2] if pose else NO_ANGLE)
        with tape.group("rates of wheels by the velocities of the base", Stage.PARAMETER):
            x, y, _ = link.position
            lightness = tape.let(1 / link.radius)
            turning = tape.let(sin * x - cos * y)
            shares = [tape.let(times(lightness, share)) for share in (turning, cos, sin)]
        return [*ZERO[:2], *shares, sp.S.Zero]

    @cached_property
    def ungeared(self) -> SymbolicRobot:
        """The robot with an entry of q, v, a and u for every joint that moves, as gears move it.

        Inputs of geared joints are zero. All derivations take this one, and `folded` takes their
        results back.
        """
        robot, (ratios, _, offsets) = self.robot, self._gearing
        if not robot.is_geared:
            return self
        tree = replace(self, description=Description(robot.ungeared))

        def spread(values: Values, old: Places, new: Places, shifts: Values) -> tuple[sp.Expr, ...]:
            base, joints = old.split(values)
            with self.tape.group("joints that gears move"):
                moved = [
                    self.tape.sum_of_products(row, joints, shift)
                    for row, shift in zip(ratios, shifts, strict=True)
                ]
            return tuple(new.joined(base, moved))

        angles = self.q[self.coordinate_places.angles]
        begun = [*offsets[: len(offsets) - len(angles)], *angles]
        efforts = dict(zip(robot.driven, self.u[robot.rotors :], strict=True))
        driven = (efforts.get(i, sp.S.Zero) for i in robot.gearing)
        return replace(
            tree,
            q=spread(self.q, self.coordinate_places, tree.coordinate_places, begun),
            v=spread(self.v, self.places, tree.places, self._turned(self.v)[0]),
            a=spread(self.a, self.places, tree.places, self._turned(self.a)[0]),
            u=(*self.u[: robot.rotors], *driven),
            v_r=spread(self.v_r, self.places, tree.places, self._turned(self.v_r)[0]),
            a_r=spread(self.a_r, self.places, tree.places, self._turned(self.a_r)[0]),
        )

    def folded(self, values: Sequence[Any]) -> list[Any]:
        """Forces on, or columns of, all joints, the last axis, as those of coordinates and base."""
        if not self.robot.is_geared:
            return [*values]
        if isinstance(values[0], list | tuple):
            return [self.folded(row) for row in values]
        base, joints = self.ungeared.places.split(values)
        columns = zip(*self._gearing[1], base, strict=False)
        with self.tape.group("forces on wheels, on the base that turns them"):
            base = [self.tape.sum_of_products(x[:-1], joints, x[-1]) for x in columns]
        return self.places.joined(base, self.folded_joints(joints))

    def folded_matrix(self, matrix: Matrix) -> Matrix:
        """A matrix of all joints as one of the coordinates, in rows and columns."""
        columns = zip(*self.folded(matrix), strict=True)
        return [*map(list, zip(*self.folded([*columns]), strict=True))]

    def folded_joints(self, joints: Values) -> list[sp.Expr]:
        """Forces on all joints as those on their coordinates."""
        columns = zip(*self._gearing[0], strict=True)
        with self.tape.group("forces on joints that gears move, on those that move them"):
            return [self.tape.sum_of_products(column, joints) for column in columns]

    @property
    def efforts(self) -> list[sp.Expr]:
        """Inputs of all joints (N m or N), zero of virtual ones."""
        driven = self.u[self.robot.rotors :]
        return [*[sp.S.Zero] * (self.joints - len(driven)), *driven]

    @property
    def state(self) -> TreeState:
        """Rates, accelerations and gravity, as the tree of the reduced system takes them."""
        return TreeState(self.v, self.a, self.parameters.gravity)

    @property
    def reference_state(self) -> TreeState:
        """The state with accelerations of reference velocities."""
        return TreeState(self.v, self.a_r, self.parameters.gravity, self.v_r)

    @property
    def base_state(self) -> TreeState:
        """The base's share of the state, attitude first."""
        return self.state.split(self.places)[0]

    @property
    def joint_state(self) -> TreeState:
        """The share of the state that the joints have which move."""
        return self.state.split(self.places)[1]

    def state_with(self, state: TreeState, links: Sequence[int]) -> TreeState:
        """A state as a tree takes it that has the joints of these links, which need not move."""

        def spread(values: Values) -> list[sp.Expr]:
            base, joints = self.places.split(values)
            moving = dict(zip(self.jointed, joints, strict=True))
            rates = [moving.get(i, sp.S.Zero) for i in links]
            return self.root.places(len(rates)).joined(base, rates)

        return TreeState(spread(state.rates), spread(state.accelerations), state.gravity)

    def coordinate_rates(self, velocities: Values) -> list[sp.Expr]:
        """Rates in the order of q, from velocities in that of v."""
        places = self.coordinate_places
        base, _ = places.split(self.q)
        rates, joints = self.places.split(velocities)
        with self.tape.group("rates of attitude and position"):
            moved = self.root.coordinate_rates(self.tape, base, rates)
        return places.joined(moved, [*joints, *self._turned(velocities)[-1]])

    def _turned(self, velocities: Values) -> tuple[list[sp.Expr], list[sp.Expr]]:
        """Rates of all joints and of the wheels among them at some velocities, by the ground."""
        base, _ = self.places.split(velocities)
        with self.tape.group("rates of the wheels"):
            rates = [self.tape.sum_of_products(share, base) for share in self._gearing[1]]
        return rates, rates[len(rates) - len(self.robot.wheels) :]

    def integrated(self) -> list[sp.Expr]:
        """Coordinates after the displacement v: q ⊕ v."""
        places = self.coordinate_places
        base, joints = places.split(self.q)
        step, turns = self.places.split(self.v)
        with self.tape.group("attitude and position after the displacement"):
            moved = self.root.integrated(self.tape, base, step)
        with self.tape.group("joints after the displacement"):
            turns, joints = [*turns, *self._turned(self.v)[-1]], [*joints, *self.q[places.angles]]
            turned = [self.tape.let(q + v) for q, v in zip(joints, turns, strict=True)]
        return places.joined(moved, turned)

    def integrated_by(self, block: Callable[[Scalars, Values], Matrix]) -> Matrix:
        """A derivative of q ⊕ v: the base's block for its displacement, beside an identity."""
        places = self.places
        step, _ = places.split(self.v)
        return _with_block(identity(places.size), places, block(self.tape, step))

    def difference_by(
        self, block: Callable[[Scalars, Values, Values], Matrix], joints: int
    ) -> Matrix:
        """A derivative of `difference`: the base's block, beside ±1 for `joints`."""
        start, _ = self.coordinate_places.split(self.q0)
        end, _ = self.coordinate_places.split(self.q1)
        matrix = [[joints * entry for entry in row] for row in identity(self.places.size)]
        return _with_block(matrix, self.places, block(self.tape, start, end))

    def difference(self) -> list[sp.Expr]:
        """The displacement v with q₀ ⊕ v = q₁."""
        start, from_joints = self.coordinate_places.split(self.q0)
        end, to_joints = self.coordinate_places.split(self.q1)
        with self.tape.group("displacement of attitude and position"):
            step = self.root.difference(self.tape, start, end)
        with self.tape.group("displacements of the joints"):
            turns = [self.tape.let(q - p) for p, q in zip(from_joints, to_joints, strict=True)]
        return self.places.joined(step, turns)

    @property
    def origin(self) -> Vector:
        """World position of the origin of the coordinates."""
        base, _ = self.coordinate_places.split(self.q)
        with self.tape.group("position of the base"):
            return self.tape.add(tuple(base[-3:]), self.parameters.base_place)

    def origin_acceleration(self, state: TreeState) -> Vector:
        """Acceleration of the origin of the coordinates in world axes (m/s²)."""
        base, _ = state.split(self.places)
        coordinates, _ = self.coordinate_places.split(self.q)
        with self.tape.group("motion of the origin in world axes"):
            linear = self.root.origin_acceleration(self.tape, base)
            # Linear velocities may count along the base's axes; then its components do as well.
            along = [*base.accelerations[:3], *linear]
            return tuple(self.root.coordinate_rates(self.tape, coordinates, along)[-3:])

    @cached_property
    def centred(self) -> SymbolicRobot:
        """The robot with the origin of its coordinates at the base centre.

        Unless a motor is the origin, it is the same object.
        """
        base = self.robot.base
        if base.origin != "motor1":
            return self
        robot = replace(self.robot, base=replace(base, origin="centre"))
        return replace(self, description=Description(robot))

    @cached_property
    def centre(self) -> Vector:
        """The base centre from the origin of the coordinates, in the base's axes."""
        base = self.robot.base
        if base.origin != "motor1":
            return ZERO
        return minus(self.rod_frame(1).vector(InlineTape(), axis_vector(0, self.rod_reach(1))))

    def rod_frame(self, k: int) -> Rotation:
        """Axes of base rod k = 1 … N against those of the base, turned about its normal.

        By the paper's rule rod 1, which is seen from its motor, has the base's own.
        """
        base = self.robot.base
        if k == 1 and base.azimuth_deg is None:
            return NO_ROTATION
        return Rotation.degrees(2, base.arm_angle_deg(k))

    def rod_reach(self, k: int) -> sp.Expr:
        """Distance along x of rod k's frame of its motor from the base centre (m).

        It is the rod's length; for rod 1 by the paper's rule its opposite.
        """
        length = self.parameters.arms[k].length
        return -length if k == 1 and self.robot.base.azimuth_deg is None else length

    def core_inertia(self) -> Inertia:
        """Inertia of what nothing holds against the base, about the origin, in the base's axes.

        That is rod 1 and the central body.
        """
        inline, base, parts = InlineTape(), self.robot.base, []
        if base.rotors:
            rod = self.parameters.arms[1].inertia
            if base.azimuth_deg is not None:
                rod = rod.rotated(inline, self.rod_frame(1)).shifted(inline, self.centre)
            elif base.origin != "motor1":
                rod = rod.shifted(inline, axis_vector(0, self.rod_reach(1)))
            parts.append(rod)
        if (central := self.parameters.central_body) is not None:
            parts.append(central.shifted(inline, self.centre))
        return total(inline, parts) if parts else NO_INERTIA

    def base_inertia(self) -> Inertia:
        """Inertia of the rigid base about the origin in its axes: the chains' sum at the root.

        Rods of one table share their parameters; what vanishes by symmetry vanishes here.
        """
        inline = InlineTape()
        rods = self.parameters.rods.shifted(inline, self.centre)
        parts = [rods, self.core_inertia()]
        with self.tape.group("inertia of the base, about the origin", Stage.PARAMETER):
            return total(inline, parts).mapped(gather).mapped(self.tape.let)

    @property
    def _root_inertia(self) -> Inertia:
        """Inertia of the base, if it is the root itself; in a pose it is welded to another."""
        return self.base_inertia() if self.robot.base.moves_freely else NO_INERTIA

    @property
    def coordinates(self) -> dict[int, sp.Symbol]:
        """Coordinate of each link whose joint moves, by the link's number."""
        _, joints = self.coordinate_places.split(self.q)
        return dict(zip(self.jointed, joints, strict=True))

    @property
    def hybrid_coordinates(self) -> dict[int, sp.Expr]:
        """Coordinates as before, and zeros for the links that constraint torques hold."""
        return {**dict.fromkeys(self.robot.constrained, sp.S.Zero), **self.coordinates}

    def _bodies(
        self, coordinates: Mapping[int, sp.Expr], chain: Chain | None = None
    ) -> JointedBodies:
        numbers: Collection[int] = range(1, len(self.robot.links) + 1)
        links, massive = (chain.path, chain.own) if chain else (numbers, numbers)
        has_core = chain is None or chain.has_core
        welded = has_core and not self.robot.base.moves_freely
        core = self.core_inertia() if welded else NO_INERTIA
        return jointed_bodies(
            self.tape, self.parameters, self.centre, coordinates, links, massive, core
        )

    @cached_property
    def bodies(self) -> JointedBodies:
        """The links with the joints that move, the others welded to them."""
        return self._bodies(self.coordinates)

    @cached_property
    def hybrid_bodies(self) -> JointedBodies:
        """The links with the joints that move and those that constraint torques hold."""
        return self._bodies(self.hybrid_coordinates)

    @cached_property
    def all_bodies(self) -> JointedBodies:
        """Every link with a joint of its own, held where the link is welded or constrained."""
        angles: dict[int, sp.Expr] = dict.fromkeys(range(1, len(self.robot.links) + 1), sp.S.Zero)
        return self._bodies(angles | self.coordinates)

    @cached_property
    def reduced_tree(self) -> SegmentTree:
        """The links on the rigid base, regrouped: what the reduced system is derived from."""
        return regrouped(self.tape, self._tree(self._root_inertia, self.bodies))

    @cached_property
    def hybrid_tree(self) -> SegmentTree:
        """The links on the rigid base, with the joints that constraint torques hold."""
        return self._tree(self._root_inertia, self.hybrid_bodies)

    @cached_property
    def whole_tree(self) -> SegmentTree:
        """Every link on the rigid base by itself, with all of its inertia."""
        return self._tree(self._root_inertia, self.all_bodies)

    @cached_property
    def open_chains(self) -> tuple[tuple[Chain, SegmentTree], ...]:
        """The chains of the decomposition by themselves, each with the mass that it has there."""
        chains = []
        for chain in decompose(self.robot):
            with self.tape.group("inertia of the base, about the origin", Stage.PARAMETER):
                core = self.chain_core(chain).mapped(self.tape.let)
            if chain.rod is None:
                chains.append((chain, self._tree(core, self.chain_bodies(chain))))
                continue
            name, rod = f"base arm {chain.rod}", self.parameters.arms[chain.rod].inertia
            with self.tape.group(f"inertia of {name}", Stage.PARAMETER):
                inertia = rod.mapped(self.tape.let)
            segment = Segment(
                inertia=inertia,
                rotation=self.rod_frame(chain.rod),
                parent=0,
                step=self.centre,
                name=name,
                joint_name=f"joint {chain.rod}",
            )
            chains.append((chain, SegmentTree((self._root_segment(core), segment))))
        return tuple(chains)

    def chain_core(self, chain: Chain) -> Inertia:
        """Inertia of the root of an open chain by itself, about the origin, in the base's axes."""
        is_root = chain.has_core and self.robot.base.moves_freely
        return self.core_inertia() if is_root else NO_INERTIA

    def chain_bodies(self, chain: Chain) -> JointedBodies:
        """The links of an open chain with all its joints, each with the mass that it has there."""
        coordinates = self.hybrid_coordinates.items()
        there = {i: c for i, c in coordinates if i < BASE or i in chain.path}
        return self._bodies(there, chain)

    def _tree(self, root: Inertia, bodies: JointedBodies) -> SegmentTree:
        """The tree of the base and the links that joints carry, every link with its own inertia.

        `root` is of the base without what is welded to it, about the origin, in its axes.
        """
        if bodies.on_base is not NO_INERTIA:
            with self.tape.group("inertia of the base, with what is welded to it", Stage.PARAMETER):
                root = root.plus(self.tape, bodies.on_base)
        segment = self._root_segment(root)
        return tree_of_links(self.tape, segment, self.root.segment_angle, bodies.links)

    def _root_segment(self, inertia: Inertia) -> Segment:
        return Segment(inertia, self.root.segment_rotation, name="the base")


def _number(value: float) -> sp.Expr:
    """A number that the robot file fixes."""
    return structural_number(sp.Float(value, DIGITS))


def _with_block(matrix: Matrix, places: Places, block: Matrix) -> Matrix:
    """A matrix in the order of v, with the base's block set."""
    for i, row in zip(places.base, places.kept(block), strict=True):
        for j, entry in zip(places.base, places.kept(row), strict=True):
            matrix[i][j] = entry
    return matrix
