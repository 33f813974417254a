"""What acts by itself: dampers, springs and armature, and the energies of a robot that has them.

Armature adds to the diagonal of the mass matrix, the rest to the residual. A joint of its own has
τ − damping·v − stiffness·(q − rest); springs between frames act on all joints between these.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from gibbs_codegen.derivation.forces import frame_loads
from gibbs_codegen.derivation.forward_kinematics import mounted_frames, segment_frames
from gibbs_codegen.derivation.jointed_bodies import JointedBodies
from gibbs_codegen.derivation.motion import TreeState
from gibbs_codegen.derivation.parameters import PassiveSymbols
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import Entries, gibbs_function, whole_inertia
from gibbs_codegen.robot.names import identifier, tie_prefix
from gibbs_codegen.robot.parts.spring import SHORTEST, Spring
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector
from gibbs_codegen.symbolic.vectors import ZERO, Wrench, minus

# The square of the distance of a spring's frames, and half the rate of that.
_SQUARE, _GROWTH = sp.Dummy("square"), sp.Dummy("growth")


def passive_symbols(symbolic: SymbolicRobot) -> list[PassiveSymbols]:
    """Symbols of passive forces of each joint that moves."""
    return [symbolic.parameters.links[i].passive for i in symbolic.jointed]


def armatures(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Inertia of rotors that turn or slide with each moving joint alone (kg m² or kg)."""
    return [joint.armature for joint in passive_symbols(symbolic)]


class StretchedSpring:
    """A spring between frames in a state of its robot, with a damper beside it.

    With d from the frame `to` to the other, ℓ² = d² + ε², g = ½ ∂ℓ²/∂q and w = g·v, it pulls the
    frame with −ρ d and its other end with ρ d, ρ = 2 ∂E/∂ℓ² + c w/ℓ², where E is its energy. So
    joints between the two feel −ρ g. Nothing else moves one against the other: all is computed in
    the axes of the base. The length ε gives a direction to frames that meet, and is no more than
    the rounding of any other distance.
    """

    def __init__(self, symbolic: SymbolicRobot, spring: Spring) -> None:
        """Compute d, g and ρ; joints are counted as segments of the reduced tree."""
        tape, tree = self._tape, self._tree = symbolic.tape, symbolic.reduced_tree
        symbols = symbolic.parameters.ties[tie_prefix(spring)]
        stored = sp.expand(symbols["stiffness"] * (sp.sqrt(_SQUARE) - symbols["length"]) ** 2 / 2)
        self._law = sp.expand(2 * stored.diff(_SQUARE)) + symbols["damping"] * _GROWTH / _SQUARE
        self.ends = [mounted_frames(symbolic, identifier(x))[0] for x in (spring.frame, spring.to)]
        first, second = (tree.path(end.segment) for end in self.ends)
        self._moves: dict[int, Vector] = {}
        self._frames = segment_frames(symbolic, in_base=True)
        with tape.group(f"pull of spring {identifier(spring.name)}"):
            places = [end.from_origin(tape, self._frames) for end in self.ends]
            self.way = tape.add(places[0], minus(places[1]))
            for k in sorted({*first} ^ {*second}):
                move = self._frames[k].group[2]
                if tree.segments[k].joint == "revolute":
                    joint = minus(self._frames[k].position)
                    move = tape.cross(move, tape.add(places[k in second], joint))
                self._moves[k] = minus(move) if k in second else move
            gradient = {k: tape.dot(self.way, move) for k, move in self._moves.items()}
            square = tape.let(tape.dot(self.way, self.way) + sp.Rational(SHORTEST) ** 2)
            self._rates = [symbolic.joint_state.rates[k - 1] for k in gradient]
            growth = tape.sum_of_products([*gradient.values()], self._rates)
            self._state = {_SQUARE: square, _GROWTH: growth}
            self.energy, self._gradient = stored.subs(self._state), gradient
            self.ratio = tape.let(self._law.subs(self._state))
            self.forces = {k: -tape.let(self.ratio * g) for k, g in gradient.items()}

    def slopes(self, by: str) -> Entries:
        """Derivatives of the forces on joints (first) by a "coordinate" or "rate" (second)."""
        tape, entries, curved = self._tape, Entries(), dict.fromkeys(self._gradient, sp.S.Zero)
        changes = (self._law.diff(x).subs(self._state) for x in (_SQUARE, _GROWTH))
        by_square, by_growth = map(tape.let, changes)
        for j, g in self._gradient.items():
            change = tape.let(by_growth * g)
            if by == "coordinate":
                curved = {i: self._curvature(i, j) for i in self._gradient}
                growth = tape.sum_of_products([*curved.values()], self._rates)
                change = tape.let(2 * by_square * g + by_growth * growth)
            for i, h in self._gradient.items():
                entries[i, j] = -tape.sum_of_products([self.ratio, change], [curved[i], h])
        return entries

    def _curvature(self, i: int, j: int) -> sp.Expr:
        """∂²/∂q_i∂q_j of ½ ℓ²."""
        tape, tree, (inner, outer) = self._tape, self._tree, sorted((i, j))
        curved = tape.dot(self._moves[inner], self._moves[outer])
        if inner not in tree.path(outer) or tree.segments[inner].joint != "revolute":
            return curved
        turned = tape.cross(self._frames[inner].group[2], self._moves[outer])
        return tape.let(curved + tape.dot(self.way, turned))


def springs(symbolic: SymbolicRobot) -> list[StretchedSpring]:
    """The springs between frames that have symbols, in the state of these."""
    ties, every = symbolic.parameters.ties, symbolic.robot.springs
    return [StretchedSpring(symbolic, spring) for spring in every if tie_prefix(spring) in ties]


def spring_slopes(symbolic: SymbolicRobot, by: str) -> Entries:
    """Derivatives of forces of springs on joints, as of their `slopes`."""
    tape, entries = symbolic.tape, Entries()
    for spring in springs(symbolic):
        with tape.group("changes of the pulls of springs"):
            for place, slope in spring.slopes(by).items():
                entries[place] = tape.let(entries.get(place, sp.S.Zero) + slope)
    return entries


def spring_loads(symbolic: SymbolicRobot, bodies: JointedBodies) -> dict[int, Wrench]:
    """Wrenches of springs on segments of some bodies, as of `frame_loads`."""
    tape, acting = symbolic.tape, springs(symbolic)
    pulls = {mounted.name: ZERO for mounted in mounted_frames(symbolic)} if acting else {}
    for spring in acting:
        pull = tape.scale(spring.ratio, spring.way)
        for end, force in zip(spring.ends, (minus(pull), pull), strict=True):
            pulls[end.name] = tape.add(pulls[end.name], force)
    pulled = replace(symbolic, W=tuple(x for pull in pulls.values() for x in (*pull, *ZERO)))
    return frame_loads(pulled, bodies, in_base=True) if acting else {}


def passive_forces(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Forces (N m or N) of dampers and springs of joints, and of those between frames, on joints.

    The former are −damping·v − stiffness·(q − rest).
    """
    tape = symbolic.tape
    q = symbolic.coordinates.values()
    v = symbolic.joint_state.rates
    forces = []
    with tape.group("forces of dampers and springs"):
        for joint, angle, rate in zip(passive_symbols(symbolic), q, v, strict=True):
            spring = tape.let(joint.stiffness * _stretch(tape, joint, angle))
            forces.append(tape.let(-tape.let(joint.damping * rate) - spring))
    for stretched in springs(symbolic):
        for k, force in stretched.forces.items():
            forces[k - 1] = tape.let(forces[k - 1] + force)
    return forces


def gibbs(symbolic: SymbolicRobot) -> sp.Expr:
    """S of the robot (W/s): of the links (eqs. 2–3), and ½ armature·a² − force·a of the joints."""
    tape = symbolic.tape
    links = gibbs_function(tape, symbolic.root, symbolic.reduced_tree, symbolic.state)
    with tape.group("Gibbs function with armature, dampers and springs"):
        a = symbolic.joint_state.accelerations
        pairs = zip(a, passive_forces(symbolic), strict=True)
        terms = [*_squares(symbolic, a), *(tape.let(-force * rate) for rate, force in pairs)]
        return tape.let(sp.Add(links, *terms))


def kinetic_energy(symbolic: SymbolicRobot) -> sp.Expr:
    """The Gibbs function of a robot at rest, weightless, whose accelerations are the rates (J)."""
    tape, state = symbolic.tape, TreeState.resting(symbolic.v)
    links = gibbs_function(tape, symbolic.root, symbolic.reduced_tree, state)
    with tape.group("kinetic energy with that of the armature"):
        return tape.let(sp.Add(links, *_squares(symbolic, symbolic.joint_state.rates)))


def potential_energy(symbolic: SymbolicRobot) -> sp.Expr:
    """Gravity times the first moment of mass above the world's Z = 0, and ½ stiffness·stretch²."""
    tape = symbolic.tape
    composite = whole_inertia(tape, symbolic.reduced_tree)
    with tape.group("first moment of mass above Z = 0, and its weight"):
        height = symbolic.root.world(tape, composite.moment)[2]
        moment = tape.let(composite.mass * symbolic.origin[2] + height)
        weight = tape.let(symbolic.parameters.gravity * moment)
    with tape.group("potential energy with that of the springs"):
        stored = [tape.let(spring.energy) for spring in springs(symbolic)]
        joints = zip(passive_symbols(symbolic), symbolic.coordinates.values(), strict=True)
        for joint, angle in joints:
            stretch = _stretch(tape, joint, angle)
            stored.append(tape.let(joint.stiffness * tape.let(stretch * stretch) / 2))
        return tape.let(sp.Add(weight, *stored))


def _stretch(tape: Scalars, joint: PassiveSymbols, angle: sp.Expr) -> sp.Expr:
    """Displacement of a spring from rest; zero where there is none."""
    return tape.let(angle - joint.rest) if joint.stiffness != 0 else sp.S.Zero


def _squares(symbolic: SymbolicRobot, rates: Values) -> list[sp.Expr]:
    """½ armature times the square of a rate, for each joint."""
    tape = symbolic.tape
    return [
        tape.let(joint.armature * tape.let(rate * rate) / 2)
        for joint, rate in zip(passive_symbols(symbolic), rates, strict=True)
        if joint.armature != 0
    ]
