"""The base of a robot in array programs: errors, wrenches and rates, whatever of it moves.

Everything else of a law or a flight works on coordinates q (nq) and velocities v (nv) by the places
of the layout. Tracking errors have an entry per velocity: of the attitude and the position of the
base, in the places of its angular and linear velocity, and of the joints.

Of a base that does not move freely what does not move is 0. Its frame is here the one that turns
with it and lies along the axes of the world before anything has moved, whatever its pose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gibbs_codegen.arrays.nodes import (
    Node,
    Space,
    arctan2,
    constant,
    coordinates_of,
    cosine,
    cross,
    dot,
    entries_of,
    join,
    sine,
    square_root,
    zeros,
)
from gibbs_codegen.robot.layout import Layout

# At which rate, 1/s, a base that drives comes back to its path from the side, and at which speed,
# m/s, by half of that: if nothing else is said.
RETURN = 1.0, 0.1


@dataclass(frozen=True)
class Motion:
    """Coordinates q (nq), velocities v (nv) and accelerations a (nv).

    `back` (2) are the rate and the speed of `RETURN` of a base that drives.
    """

    q: Node
    v: Node
    a: Node
    back: Node | None = None


class Placed(Protocol):
    """A robot with coordinates and velocities in the places of a layout."""

    @property
    def layout(self) -> Layout:
        """Places of attitude, position and joints."""

    @property
    def space(self) -> Space:
        """The numbers of entries of coordinates and displacements."""

    @property
    def difference(self) -> Callable[[Node, Node], Node]:
        """The displacement (nv) from coordinates to others."""

    def wheel_rates(self, q: Node, v: Node) -> Node:
        """Rates of the angles of wheels, rad/s, at coordinates q (nq) and velocities v (nv)."""


def _own_linear(base: QuaternionBase | LevelBase, v: Node, a: Node) -> tuple[Node, Node]:
    """Velocity and acceleration (3) of the point at x, y, z, in world axes, by a base's own."""
    velocity, (spin, _) = base.travels(v), base.angular(v, a)
    return base.to_world(velocity), base.to_world(base.travels(a) + cross(spin, velocity))


class QuaternionBase:
    """A base with a unit quaternion at coordinates q (nq).

    Errors of the position are in world axes, those of the attitude the rotation vector from the
    actual to the desired attitude in the base's frame.
    """

    def __init__(self, robot: Placed, q: Node) -> None:
        self.robot, self.q = robot, q
        self.quaternion = entries_of(q)[robot.layout.q.attitude]

    def travels(self, x: Node) -> Node:
        """Entries (3) along three axes, of entries (nv)."""
        return x[self.robot.layout.v.position]

    def turns(self, x: Node) -> Node:
        """Entries (3) about three axes, of entries (nv)."""
        return x[self.robot.layout.v.attitude]

    def to_world(self, x: Node) -> Node:
        """A vector (3) of the base's frame, in world axes."""
        return _turned(self.quaternion, self.quaternion[3], x)

    def to_base(self, x: Node) -> Node:
        """A vector (3) of world axes, in the base's frame."""
        return _turned(self.quaternion, -self.quaternion[3], x)

    def angular(self, v: Node, a: Node) -> tuple[Node, Node]:
        """Angular velocity and acceleration (3) in the base's frame."""
        place = self.robot.layout.v.attitude
        return v[place], a[place]

    linear = _own_linear

    def attitude_entries(self, v: Node, turning: Node) -> Node:
        """Entries (3) of the attitude in a: the angular acceleration (3), base's frame, itself."""
        return turning

    def twist(self, centre: Node, v: Node) -> Node:
        """Velocity (6) of a point `centre` (3) and angular velocity, all in the base's frame."""
        place = self.robot.layout.v
        spin = v[place.attitude]
        return join(v[place.position] + cross(spin, centre), spin)

    def wrench(self, centre: Node, force: Node) -> Node:
        """Force and torque (6) about a point `centre` (3), base's frame, of a force (nv)."""
        place = self.robot.layout.v
        pull = force[place.position]
        return join(pull, force[place.attitude] - cross(centre, pull))

    def rates(self, v: Node, entries: Node) -> Node:
        """Rates (nq) of entries with a quaternion of any length, which keeps its length."""
        place = self.robot.layout.v
        quaternion, spin = entries[self.robot.layout.q.attitude], 0.5 * v[place.attitude]
        vector, scalar = quaternion[:3], quaternion[3]
        moved = self.to_world(v[place.position])
        turned = cross(vector, spin) + scalar * spin
        return join(moved, turned, -dot(vector, spin), v[place.joints])

    def errors(self, v: Node, desired: Motion) -> tuple[Node, Node]:
        """Errors and their rates (nv), those of the position in world axes."""
        robot = self.robot
        places, places_q = robot.layout.v, robot.layout.q
        wanted = QuaternionBase(robot, desired.q)
        between = entries_of(desired.q)
        here = entries_of(self.q)
        spin = self._carried(wanted, desired.v[places.attitude]) - v[places.attitude]
        drift = wanted.to_world(desired.v[places.position]) - self.to_world(v[places.position])
        # `difference` has a derivative where there is no error, as an arc tangent has not.
        turn = robot.difference(self.q, desired.q)[places.attitude]
        position = between[places_q.position] - here[places_q.position]
        joints = between[places_q.joints] - here[places_q.joints]
        rates = desired.v[places.joints] - v[places.joints]
        return join(position, turn, joints), join(drift, spin, rates)

    def corrected(self, v: Node, desired: Motion, pull: Node) -> Node:
        """Accelerations (nv) of the desired motion and, as `pull` (nv), of what its errors ask."""
        places = self.robot.layout.v
        wanted = QuaternionBase(self.robot, desired.q)
        spin, spin_desired = v[places.attitude], desired.v[places.attitude]
        world = wanted.linear(desired.v, desired.a)[1]
        linear = self.to_base(world + pull[places.position]) - cross(spin, v[places.position])
        turning = self._carried(wanted, desired.a[places.attitude])
        turning = turning - cross(spin, self._carried(wanted, spin_desired))
        joints = desired.a[places.joints] + pull[places.joints]
        return join(linear, turning + pull[places.attitude], joints)

    def _carried(self, wanted: QuaternionBase, x: Node) -> Node:
        """A vector (3) of the desired base's frame in that of the base."""
        return self.to_base(wanted.to_world(x))


class AngleBase:
    """A base with Tait-Bryan angles at coordinates q (nq): errors are differences of coordinates.

    Each angle turns about one axis of the frame that the angles before it have turned. Where there
    are fewer than three, the others are 0.
    """

    def __init__(self, robot: Placed, q: Node) -> None:
        self.robot, self.q = robot, q
        self.along, turns = robot.layout.own_axes
        self.still = 3 - len(turns)
        self.axes = [*turns, *(k for k in range(3) if k not in turns)]
        angles = entries_of(q)[robot.layout.q.attitude]
        self.sines = [*sine(angles), *[constant(0.0)] * self.still]
        self.cosines = [*cosine(angles), *[constant(1.0)] * self.still]

    def _turning(self, x: Node) -> Node:
        """Entries (3) of three angles, of entries (nv)."""
        return join(x[self.robot.layout.v.attitude], zeros(self.still))

    def travels(self, x: Node) -> Node:
        """Entries (3) along three axes, of entries (nv)."""
        moving = x[self.robot.layout.v.position]
        return moving if self.along == [0, 1, 2] else spread(self.along, moving)

    def turns(self, x: Node) -> Node:
        """Entries (3) of three angles, or of fewer about the axes that they turn about."""
        moving = x[self.robot.layout.v.attitude]
        return spread(self.axes, moving) if self.still else moving

    def _in_base(self, x: Node) -> Node:
        """A linear velocity or a force (3) in the base's frame, of entries (nv)."""
        return self.to_base(self.travels(x))

    def to_world(self, x: Node) -> Node:
        """A vector (3) of the base's frame, in world axes."""
        vector = [x[i] for i in range(3)]
        for i in (2, 1, 0):
            vector = self._turned(i, vector, self.sines[i])
        return join(*vector)

    def to_base(self, x: Node) -> Node:
        """A vector (3) of world axes, in the base's frame."""
        vector = [x[i] for i in range(3)]
        for i in range(3):
            vector = self._turned(i, vector, -self.sines[i])
        return join(*vector)

    def _turned(self, i: int, x: Sequence[Node], sine_of: Node) -> list[Node]:
        """Entries of a vector, turned about the axis of the angle i."""
        one, two = (self.axes[i] + 1) % 3, (self.axes[i] + 2) % 3
        turned = list(x)
        turned[one] = self.cosines[i] * x[one] - sine_of * x[two]
        turned[two] = self.cosines[i] * x[two] + sine_of * x[one]
        return turned

    def angular(self, v: Node, a: Node) -> tuple[Node, Node]:
        """Angular velocity and acceleration (3) in the base's frame."""
        rates = self._turning(v)
        return self._of_rates(rates), self._of_rates(self._turning(a)) + self._bias(rates)

    def linear(self, v: Node, a: Node) -> tuple[Node, Node]:
        """Velocity and acceleration (3) of the point at x, y, z, in world axes."""
        return self.travels(v), self.travels(a)

    def _of_rates(self, rates: Node) -> Node:
        """Angular velocity (3), base's frame, of rates (3) of the angles."""
        spin = [constant(0.0)] * 3
        for i in range(3):
            spin = self._turned(i, spin, -self.sines[i])
            spin[self.axes[i]] = spin[self.axes[i]] + rates[i]
        return join(*spin)

    def _bias(self, rates: Node) -> Node:
        """Angular acceleration (3), base's frame, without accelerations of the angles."""
        spin = [constant(0.0)] * 3
        bias = [constant(0.0)] * 3
        for i in range(3):
            spin = self._turned(i, spin, -self.sines[i])
            bias = self._turned(i, bias, -self.sines[i])
            axis = [constant(float(k == self.axes[i])) for k in range(3)]
            # The axis is carried by the rates before: it turns in the frame after this rotation.
            turning = cross(join(*spin), join(*axis))
            bias = [bias[k] + rates[i] * turning[k] for k in range(3)]
            spin[self.axes[i]] = spin[self.axes[i]] + rates[i]
        return join(*bias)

    def attitude_entries(self, v: Node, turning: Node) -> Node:
        """Accelerations of the angles by the angular acceleration (3), base's frame.

        Away from the singularity of the angles.
        """
        rest = turning - self._bias(self._turning(v))
        # Undo the last rotation, then the others: each axis gives one rate.
        x = [rest[i] for i in range(3)]
        x = self._turned(2, x, self.sines[2])
        last, middle, first = self.axes[2], self.axes[1], self.axes[0]
        outer = x[first] / self.cosines[1]
        return join(outer, x[middle], x[last] + self._lean * outer)[: 3 - self.still]

    @property
    def _lean(self) -> Node:
        """Sine of the middle angle, with the sign of the sequence of the axes."""
        cyclic = (self.axes[0] + 1) % 3 == self.axes[1]
        return -self.sines[1] if cyclic else self.sines[1]

    def twist(self, centre: Node, v: Node) -> Node:
        """Velocity (6) of a point `centre` (3) and angular velocity, all in the base's frame."""
        spin = self._of_rates(self._turning(v))
        return join(self._in_base(v) + cross(spin, centre), spin)

    def wrench(self, centre: Node, force: Node) -> Node:
        """Force and torque (6) about a point `centre` (3), base's frame, of a force (nv)."""
        about = self._turning(force)
        torque = [about[0]] * 3
        torque[self.axes[0]] = (about[0] + self._lean * about[2]) / self.cosines[1]
        torque[self.axes[1]], torque[self.axes[2]] = about[1], about[2]
        pull = self._in_base(force)
        moment = join(*self._turned(2, torque, -self.sines[2])) - cross(centre, pull)
        if self.still > 1:  # Moments about other axes than the one that turns do nothing.
            moment = moment * np.isin(range(3), self.axes[: 3 - self.still]).astype(float)
        return join(pull, moment)

    def rates(self, v: Node, entries: Node) -> Node:
        """Rates (nq) of the coordinates' entries, which v holds."""
        return v

    def errors(self, v: Node, desired: Motion) -> tuple[Node, Node]:
        """Errors and their rates (nv)."""
        return entries_of(desired.q) - entries_of(self.q), desired.v - v

    def corrected(self, v: Node, desired: Motion, pull: Node) -> Node:
        """Accelerations (nv) of the desired motion and, as `pull` (nv), of what its errors ask."""
        return desired.a + pull


class LevelBase(AngleBase):
    """A base with a yaw that moves along its own axes: errors are differences of coordinates."""

    def _in_base(self, x: Node) -> Node:
        return self.travels(x)

    linear = _own_linear

    def rates(self, v: Node, entries: Node) -> Node:
        """Rates (nq) of the coordinates' entries."""
        rates = self._displaced(v)
        if not self.robot.layout.q.wheels:
            return rates
        return join(rates, self.robot.wheel_rates(self.q, v))

    def _displaced(self, v: Node) -> Node:
        """Rates of the coordinates' entries but for wheels."""
        places, (position, _) = self.robot.layout.v, self.linear(v, v)
        moving = (position[axis] for axis in self.along)
        return join(*moving, v[places.attitude], v[places.joints])

    def errors(self, v: Node, desired: Motion) -> tuple[Node, Node]:
        """Errors and their rates (nv), those of the position in world axes."""
        wanted, error = LevelBase(self.robot, desired.q), self._away(desired)
        return error, wanted._displaced(desired.v) - self._displaced(v)

    def _away(self, desired: Motion) -> Node:
        """Differences of the coordinates' entries but for wheels."""
        moving = slice(self.robot.layout.displaced.size)
        return entries_of(desired.q)[moving] - entries_of(self.q)[moving]

    def corrected(self, v: Node, desired: Motion, pull: Node) -> Node:
        """Accelerations (nv) of the desired motion and, as `pull` (nv), of what its errors ask."""
        places, a = self.robot.layout.v, desired.a + pull
        _, world = LevelBase(self.robot, desired.q).linear(desired.v, desired.a)
        spin, _ = self.angular(v, v)
        linear = self.to_base(world + self.travels(pull)) - cross(spin, self.travels(v))
        return placed(self.robot, a[places.attitude], linear, a[places.joints])

    def velocities(self, rates: Node) -> Node:
        """Velocities (nv) by rates (nq) of the coordinates."""
        places = self.robot.layout.q
        linear = self.to_base(self._moved(rates))
        return placed(self.robot, rates[places.attitude], linear, rates[places.joints])

    def accelerations(self, v: Node, growth: Node) -> Node:
        """Accelerations (nv) by second derivatives (nq) of the coordinates."""
        places, (spin, _) = self.robot.layout.q, self.angular(v, v)
        linear = self.to_base(self._moved(growth)) - cross(spin, self.travels(v))
        return placed(self.robot, growth[places.attitude], linear, growth[places.joints])

    def _moved(self, x: Node) -> Node:
        """Entries (3) along three axes, of entries (nq)."""
        return spread(self.along, x[self.robot.layout.q.position])


class DrivenBase(LevelBase):
    """A level base that rolls ahead and turns, and that its heading leads to its path.

    In its own axes the desired base is f ahead, g to the left and turned by ε. While that drives at
    a speed s, the heading is to be ψ = atan(c g) off its own, with c = μ s / (s² + σ²), by which g
    decays at the rate μ s² / (s² + σ²) near the path. Errors are f and ε + ψ. With c = k s, and ψ
    its tangent, that is the law of Kanayama, Kimura, Miyazaki and Noguchi (1990). At rest g stays.
    """

    def errors(self, v: Node, desired: Motion) -> tuple[Node, Node]:
        """Errors and their rates (nv): ahead, and of what the heading is to be."""
        error, rate, *_ = self._tracked(v, desired)
        return error, rate

    def corrected(self, v: Node, desired: Motion, pull: Node) -> Node:
        """Accelerations (nv) of the desired motion and, as `pull` (nv), of what its errors ask."""
        _, _, kept, side = self._tracked(v, desired)
        a, places = kept + pull, self.robot.layout.v
        ahead = self.travels(a) + join(a[places.attitude] * side, zeros(2))
        return placed(self.robot, a[places.attitude], ahead, a[places.joints])

    def _tracked(self, v: Node, desired: Motion) -> tuple[Node, Node, Node, Node]:
        """Errors and their rates (nv), accelerations (nv) by which these stay, and g.

        The last are but for what turning adds ahead, and without the jerk of the desired motion.
        """
        places, away = self.robot.layout.v, self._away(desired)
        ahead, side, _ = self.to_base(self._moved(away))
        (turn,) = away[self.robot.layout.q.attitude]
        speed, growth, moving = (self.travels(x)[0] for x in (desired.v, desired.a, v))
        (spin,), (spin_desired,), (turning,) = (
            x[places.attitude] for x in (v, desired.v, desired.a)
        )
        along, across, rate = cosine(turn), sine(turn), spin_desired - spin
        ahead_rate = spin * side + speed * along - moving
        side_rate = speed * across - spin * ahead
        ahead_kept = growth * along - speed * across * rate + spin * side_rate
        side_growth = growth * across + speed * along * rate - turning * ahead - spin * ahead_rate
        # The tangent of the heading that leads back, and its derivatives.
        fast, slow = desired.back or constant(np.array(RETURN))
        square = speed * speed + slow * slow
        steep = fast * speed / square
        steeper = fast * growth * (slow * slow - speed * speed) / (square * square)
        lead, lead_rate = steep * side, steep * side_rate + steeper * side
        lead_growth = steep * side_growth + 2.0 * steeper * side_rate
        share = 1.0 / (1.0 + lead * lead)
        bend = share * (lead_growth - 2.0 * share * lead * lead_rate * lead_rate)

        def entries(attitude: Node, position: Node, joints: Node) -> Node:
            return placed(self.robot, join(attitude), join(position, zeros(2)), joints)

        joints = away[self.robot.layout.q.joints], (desired.v - v)[places.joints]
        return (
            entries(turn + arctan2(lead, constant(1.0)), ahead, joints[0]),
            entries(rate + share * lead_rate, ahead_rate, joints[1]),
            entries(turning + bend, ahead_kept, desired.a[places.joints]),
            side,
        )


Base = AngleBase | QuaternionBase


def base_of(robot: Placed, q: Node) -> Base:
    """The base of a robot at coordinates q (nq)."""
    if robot.space.has_quaternion:
        return QuaternionBase(robot, q)
    if robot.space.has_drive:
        return DrivenBase(robot, q)
    return (AngleBase if robot.space.is_flat else LevelBase)(robot, q)


def spread(axes: Sequence[int], moving: Node) -> Node:
    """Entries (3) along or about three axes, of those along or about the first of these."""
    entries = dict(zip(axes, moving, strict=False))
    return join(*(entries.get(axis, constant(0.0)) for axis in range(3)))


def length(x: Node) -> Node:
    """Length of a vector."""
    return square_root(dot(x, x))


def _turned(quaternion: Node, scalar: Node, x: Node) -> Node:
    """A vector (3), turned by the quaternion that has this scalar part."""
    once = cross(quaternion[:3], x)
    return x + 2.0 * (scalar * once + cross(quaternion[:3], once))


def unit_entries(robot: Placed, entries: Node) -> Node:
    """Entries (nq) of coordinates, with a quaternion of unit length, if they have one."""
    if not robot.space.has_quaternion:
        return entries
    place = robot.layout.q.attitude
    unit = entries[place] / length(entries[place])
    return join(entries[: place.start], unit, entries[place.stop :])


def placed(robot: Placed, attitude: Node, position: Node, joints: Node) -> Node:
    """Entries (nv) of the attitude, the position (3) and the joints in their places.

    Those of the attitude begin with the angles that there are.
    """
    places, (along, about) = robot.layout.v, robot.layout.driven_axes
    if len(along) != position.size or along != sorted(along):
        position = join(zeros(0), *(position[axis] for axis in along))
    attitude = attitude[: len(about)]
    parts = (places.attitude, attitude), (places.position, position), (places.joints, joints)
    return join(*(x for _, x in sorted(parts, key=lambda part: part[0].start)))


def pose_motion(robot: Placed, c: Node, rates: Node, growth: Node) -> tuple[Node, ...]:
    """Unit coordinates, v and a of entries (nq), a quaternion of any length among them.

    `rates` and `growth` are the first and second derivatives of the entries. With c = r p, where p
    is of unit length, the conjugate of c times its derivative is r times that of r, and r² ω / 2.
    """
    layout = robot.layout.q
    if not robot.space.has_quaternion:
        base = LevelBase(robot, coordinates_of(c, robot.space))
        v = base.velocities(rates)
        return c, v, base.accelerations(v, growth)
    turned = c[layout.attitude]
    square = dot(turned, turned)
    stretching = dot(turned, rates[layout.attitude]) / square
    entries = unit_entries(robot, c)
    quaternion = entries[layout.attitude]
    spin = 2.0 / square * _between(turned, rates[layout.attitude])
    bend = 2.0 / square * _between(turned, growth[layout.attitude])
    linear = _turned(quaternion, -quaternion[3], rates[layout.position])
    v = placed(robot, spin, linear, rates[layout.joints])
    carried = _turned(quaternion, -quaternion[3], growth[layout.position]) - cross(spin, linear)
    return entries, v, placed(robot, bend - 2.0 * stretching * spin, carried, growth[layout.joints])


def _between(p: Node, r: Node) -> Node:
    """The vector (3) of the product of the conjugate of p and of r."""
    return p[3] * r[:3] - r[3] * p[:3] - cross(p[:3], r[:3])
