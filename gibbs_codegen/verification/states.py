"""Random states, and the sizes of the terms that results there are summed from."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gibbs_codegen.verification.tree import WORLD, Frames, Joint, Tree
from gibbs_codegen.verification.vectors import Array, cross, times

# Far enough from ±90°, where the attitude angles are singular, to leave the accelerations digits.
_STEEPEST = 1.2
# Angles of a few turns; and the least of far ones, as a share of the largest.
_TURNS, _FAR = 50.0, 0.8
# Distances from the singular attitude, one for every three states by turns.
_NEAR = np.repeat((1e-2, 1e-5, 1e-8), 3)
# A step, as a share of a velocity over an acceleration.
_SHORT = 0.01
# Largest angles: beyond those that C computes by itself, 1e5 rad, and 400 in single precision.
FAR, FAR_SINGLE = 2.0**17, 2.0**9


def _varied(name: str, seed: int) -> property:
    """An argument of states, each entry of a row times another factor."""
    return property(lambda states: (x := getattr(states, name)) * _factors(x, seed))


@dataclass(frozen=True)
class States:
    """States, accelerations and inputs, which need not fit each other.

    Angles are all around, but for the middle one of the attitude; lengths are of the order of the
    robot's reach, rates of its `tempo`, inputs of its weight, so that no error hides beside another
    number. `q` is (s, nq), `v` and its rates `a` (s, nv), `u` (s, nu), and `W`, wrenches on the
    frames, (s, frames, 6). The state `x` (s, nx) of the actuators and the `command` (s, nu) are on
    either side of every limit; neither has entries where u is commanded. `active` (s,
    constraints) has a 1 for each constraint that holds. Other arguments follow from these.
    """

    q: Array
    v: Array
    a: Array
    u: Array
    W: Array
    x: Array = field(default_factory=lambda: np.zeros((0, 0)))
    command: Array = field(default_factory=lambda: np.zeros((0, 0)))
    active: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def q0(self) -> Array:
        """Coordinates to begin with, (s, nv)."""
        return self.q

    @property
    def q1(self) -> Array:
        """Coordinates to end with: those of the first state, (s, nv)."""
        return np.broadcast_to(self.q[:1], self.q.shape)

    # Weights of the entries of a result, (s, nv), and directions of arguments, as large as these.
    w = _varied("v", 0)
    q_dot = _varied("v", 1)
    v_dot = _varied("a", 2)
    a_dot = _varied("a", 3)
    u_dot = _varied("u", 4)
    W_dot = _varied("W", 5)
    # Velocities that are referred to, and their rates.
    v_r = _varied("v", 8)
    a_r = _varied("a", 9)

    @property
    def w_input_matrix(self) -> Array:
        """Weights of the entries of the input matrix, (s, nv, nu)."""
        return self.w[:, :, None] * self.u_dot[:, None, :]

    @property
    def w_jacobian(self) -> Array:
        """Weights of the entries of the Jacobian of the centre of mass, (s, 3, nv)."""
        rows = np.ones((len(self), 3))
        return (rows * _factors(rows, 6))[:, :, None] * self.q_dot[:, None, :]

    @property
    def h(self) -> Array:
        """Lengths of steps, (s,): short beside the time in which velocities change."""
        fastest = np.abs(self.v).max(axis=-1), np.abs(self.a).max(axis=-1)
        return _SHORT * fastest[0] / fastest[1]

    @property
    def restitution(self) -> Array:
        """Restitution of each constraint, (s, constraints): a third to 1."""
        return np.abs(np.ones_like(self.active) * _factors(self.active, 7)) / 1.5

    def placed(self, tree: Tree) -> tuple[Tree, States]:
        """The tree of a base with velocities in its own frame, placed there, and the states.

        The base's joints are at zero then; for other bases, what is given.
        """
        if not tree.layout.turns_with_base:
            return tree, self
        from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

        q, v = tree.layout.q, tree.layout.v
        there = copy.copy(tree)
        parts, place = self.q[:, q.attitude], np.tile(tree.placement[1], (len(self), 1))
        if tree.layout.is_quaternion:
            rotation = Rotation.from_quat(parts)
        else:
            rotation = Rotation.from_euler("Z", parts)
        travels, axes = tree.layout.own_axes
        place[:, travels] += self.q[:, q.position]
        there.placement = rotation.as_matrix(), place
        there.offsets = tree.offsets + tree.rolled(self.q)
        joints = np.zeros_like(self.v)
        joints[:, v.joints] = self.q[:, q.joints]
        # The joints of the position keep their axes while the base turns, and each rotation turns
        # the axes of those after it: so rates of velocities are not the joints' accelerations.
        spin, drift = np.zeros((2, len(self), 3))
        spin[:, axes] = self.v[:, v.attitude]
        drift[:, travels[: v.position.stop]] = self.v[:, v.position]
        x, y, z = spin.T
        there.dragged = np.zeros((len(self), tree.size))
        along = [joint.place for joint in tree.joints[: len(travels)]]
        there.dragged[:, along] = cross(spin, drift)[:, travels]
        if tree.layout.is_quaternion:
            about = [tree.free[place] for place in range(v.size)[v.attitude]]
            there.dragged[:, about] = -np.stack([y * z, -x * z, x * y], axis=-1)
        return there, replace(self, q=joints)

    @classmethod
    def random(cls, tree: Tree, count: int, seed: int | Sequence[int]) -> States:
        """Random states, the same for the same seed."""
        rng = np.random.default_rng(seed)
        scales = tree.scales[tree.free]
        q = _random_angles(tree, count, rng)
        v, a = rng.normal(size=(2, count, len(scales))) * scales
        force, v = tree.mass * tree.reach * tree.tempo**2, v * tree.tempo
        u = rng.normal(size=(count, len(tree.efforts))) * tree.efforts
        wrenches = rng.normal(size=(count, len(tree.named), 6))
        wrenches *= force * np.repeat([1.0, tree.reach], 3)
        driven = _driven(tree, q, v, rng)
        # Active constraints: all, then all but the first, and so on, as binary numbers.
        bits = np.arange(count)[:, None] >> np.arange(len(tree.constraints)) & 1
        active = 1.0 - bits
        return cls(tree.coordinates(q), v, a * tree.tempo**2, u, wrenches, *driven, active)

    @classmethod
    def extreme(cls, tree: Tree, count: int, seed: int | Sequence[int], far: float = FAR) -> States:
        """States with angles of many turns, far angles, and next to the singular attitude.

        The kinds take turns; `far`, in rad, is the largest of the far angles; the others are nearly
        as large.
        """
        usual = cls.random(tree, count, seed)
        rng = np.random.default_rng(seed)
        q = _random_angles(tree, count, np.random.default_rng(seed))
        # No rack goes as far as angles do.
        turning = ~(tree.gains[~tree.turns][:, tree.free] != 0.0).any(axis=0)
        shape = (count, int(turning.sum()))
        signs = rng.choice([-1.0, 1.0], shape)
        beyond = signs * rng.uniform(_FAR * far, far, shape)
        several = rng.uniform(-_TURNS, _TURNS, shape)
        # Those of one side are half a turn from those of the other, either way: none is the first,
        # to which `q1` leads.
        kinds = np.arange(count) % 3
        chosen = np.where(kinds[:, None] == 0, several, beyond)
        q[:, turning] = np.where(kinds[:, None] == 2, q[:, turning], chosen)
        near = 0.5 * np.pi + rng.choice([-1.0, 1.0], count) * np.resize(_NEAR, count)
        if (middle := tree.middle_angle) is not None:
            q[:, middle] = np.where(kinds == 2, signs[:, 0] * near, q[:, middle])
        x, command = _driven(tree, q, usual.v, rng)
        return replace(usual, q=tree.coordinates(q), x=x, command=command)

    def rounded(self) -> States:
        """The states in numbers that single precision has."""
        return States(*(x.astype(np.float32).astype(np.float64) for x in vars(self).values()))

    def first(self, count: int) -> States:
        """The first `count` states, or all if there are fewer."""
        return States(*(x[:count] for x in vars(self).values()))

    def __len__(self) -> int:
        return len(self.q)


def _factors(array: Array, seed: int) -> Array:
    """Factors of either sign, one for each entry of a row of an array; none is near zero."""
    rng = np.random.default_rng(seed)
    width = array.shape[-1]
    return rng.uniform(0.5, 1.5, width) * rng.choice([-1.0, 1.0], width)


def _driven(tree: Tree, q: Array, v: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """States x and commands of the actuators at angles as of `_random_angles`, and rates."""
    if tree.actuators is None:
        return np.zeros((len(q), 0)), np.zeros((len(q), 0))
    joints = tree.layout.v.joints
    return tree.actuators.random(
        q[:, joints], v[:, joints], tree.efforts, tree.scales[tree.driven], rng
    )


def _random_angles(tree: Tree, count: int, rng: np.random.Generator) -> Array:
    """Random coordinates (s, nv), as `Tree.coordinates` takes them, with the attitude as angles."""
    turning = tree.turns[tree.free]
    spread = np.where(turning, np.pi, 1.0)
    q = rng.uniform(-spread, spread, (count, len(spread))) * tree.scales[tree.free]
    if (middle := tree.middle_angle) is not None:
        q[:, middle] = rng.uniform(-_STEEPEST, _STEEPEST, count)
    return q


class Sizes:
    """Sizes of the terms that entries are summed from; errors are shares of them.

    The unit of a coordinate is the root of its largest inertia: that of all it moves, if it turned
    about the least favourable axis. No entry of the mass matrix exceeds 1 then, whatever the units
    and however light a link is; forces have units of the same kind.
    """

    def __init__(self, tree: Tree, states: States) -> None:
        passive = tree.passive.sizes(tree.at_joints(states.q), tree.spread(states.v))
        tree, states = states.placed(tree)
        q, v, _ = tree.motion(states)
        frames, gains = tree.frames(q), np.abs(tree.gains)
        inertias, masses, levers, turned = _stretched(tree, frames)
        levers, turned = np.einsum("ij,sik->sjk", gains, levers), gains.T @ turned
        units = np.sqrt(inertias + tree.passive.armature)
        # How much larger the robot is than the smallest of what a joint turns.
        resisting = (units > 0.0) & (masses > 0.0) & tree.turns
        radii = units[resisting] / np.sqrt(masses[resisting])
        self.disparity = tree.reach / min(radii.min(initial=np.inf), tree.reach)
        # Entries without any inertia are zeros, which need no size.
        self.units = np.where(units > 0.0, units, 1.0) @ gains
        self.free_units = self.units[:, tree.free]
        self.matrix = self.units[:, :, None] * self.units[:, None, :]
        self.free_matrix = self.free_units[:, :, None] * self.free_units[:, None, :]
        # No frame turns, or moves by the robot's size, faster than all rates together.
        self.scales = tree.scales[tree.free]
        rates = np.abs(v / tree.scales).sum(axis=-1, keepdims=True)
        momentum = (self.free_units * np.abs(states.v)).max(axis=-1, keepdims=True)
        weight = abs(tree.gravity) * np.sqrt(tree.mass)
        self.effort = self.units * (momentum * rates + weight) + passive[0] @ gains
        self.inertial_effort = self.effort + self.units * self.largest(states.a)
        positions = tree.positions(frames, tree.points)
        span = np.abs(positions - positions[:, :1]).max(axis=(1, 2))
        self.reach = span + np.abs(positions).max(axis=(1, 2))
        self.rate = rates[:, 0]
        self.length = tree.reach
        self.kinetic = np.sum((self.free_units * states.v) ** 2, axis=-1)
        # Masses may be where no point is.
        height = np.maximum(self.reach, tree.reach)
        self.potential = abs(tree.gravity) * tree.mass * height + passive[1]
        self.free_effort = self.effort[:, tree.free]
        self.free_inertial_effort = self.inertial_effort[:, tree.free]
        power = np.abs(states.a) * self.free_inertial_effort
        # Modules take sines of sums of angles, which rounding leaves uncertain by a share of these.
        self.angles = np.abs(q[:, tree.turns]).sum(axis=-1)
        # The function has a term in the square of gravity, which its difference loses.
        self.gibbs = tree.mass * tree.gravity**2 + np.sum(power, axis=-1)
        # Forces of inputs and of wrenches may cancel, so all their terms count.
        rotors, shape = len(tree.motors), (len(states), tree.size, len(tree.driven))
        drags = np.abs([motor.drag for motor in tree.motors])
        thrusts = levers[..., :rotors] + turned[:, :rotors] * drags
        arm = np.broadcast_to(gains[tree.driven].T, shape)
        inputs = np.concatenate([thrusts, arm], axis=-1) / self.units[..., None]
        self.inputs = self.units[..., None] * inputs.max(axis=1, keepdims=True)
        self.driven = times(self.inputs, np.abs(states.u))
        self.free_driven = self.driven[:, tree.free]
        forces, moments = np.split(np.abs(states.W), 2, axis=-1)
        pushed = times(levers[..., rotors:], forces.sum(axis=-1))
        pushed += moments.sum(axis=-1) @ turned[:, rotors:].T
        largest = (pushed / self.units).max(axis=-1, keepdims=True)
        self.free_pushed = self.free_units * largest

    def balance(self, accelerations: Array) -> Array:
        """Size (s, nv) of M a = R + B u, that of its largest terms, for a at the first states."""
        count = len(accelerations)
        inertial = self.free_units[:count] * self.largest(accelerations)
        return self.free_effort[:count] + inertial + self.free_driven[:count]

    def largest(self, accelerations: Array) -> Array:
        """The largest (s, 1) of accelerations at the first states, in the coordinates' units."""
        units = self.free_units[: len(accelerations)]
        return (units * np.abs(accelerations)).max(axis=-1, keepdims=True)


def _stretched(tree: Tree, frames: Frames) -> tuple[Array, Array, Array, Array]:
    """Inertias, masses and levers that each coordinate would move if the arm were stretched out.

    Largest inertias (masses if along) and masses, (s, size), and the levers (s, size, seats) of the
    tree's seats (1 if along): a folded arm has less inertia, and shorter levers, than their terms.
    Which seats each coordinate turns, (size, seats).
    """
    steps = np.linalg.norm(frames.steps, axis=-1)
    inertias, masses = np.zeros((2, steps.shape[-1], tree.size))
    turned = np.zeros((tree.size, len(tree.seats)), bool)
    levers = np.zeros((steps.shape[-1], *turned.shape))

    def moving(number: int, local: Array) -> Iterator[tuple[Joint, Array]]:
        length = np.asarray(np.linalg.norm(local))
        while number != WORLD:
            yield tree.joints[number], length
            length = length + steps[number]
            number = tree.joints[number].parent

    for number, body in enumerate(tree.joints):
        # No principal moment exceeds half the trace.
        central_inertia = 0.5 * np.trace(body.inertia)
        for joint, length in moving(number, body.com):
            turning = body.mass * length**2 + central_inertia
            inertias[:, joint.place] += turning if joint.revolute else body.mass
            masses[:, joint.place] += body.mass
    for k, seat in enumerate(tree.seats):
        for joint, length in moving(seat.joint, seat.local):
            levers[:, joint.place, k] = length if joint.revolute else 1.0
            turned[joint.place, k] = joint.revolute
    return inertias, masses, levers, turned
