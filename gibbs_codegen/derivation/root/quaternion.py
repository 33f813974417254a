"""The root with a quaternion: the base's velocities in its own frame are the quasi-velocities.

The group frame is the base's own frame, arm 1's axes, and v begins with the velocity of the origin
and the angular velocity there. So the generalised forces of the base are the wrench itself, and
its block of the mass matrix is the inertia itself: neither depends on the attitude, which enters
only through the direction of gravity. Nothing is divided by anything: no attitude is singular.

In derivatives a turn φ of the base changes the upward acceleration g in its frame by g×φ. The
linear velocity enters through ω×v. So what depends on either is what the force takes of an
acceleration of the origin, a column of the mass matrix. A unit of the angular velocity about an
axis e of the base makes the accelerations 2e×ẋ + (ω×e)×ρ, and e×v of the origin.

A pose is q = (x, y, z, w), the scalar last, with a position; it takes the base's frame to the
world. A displacement is an angular and a linear part in the base's frame, and is added to a pose
by the exponential map of SE(3). Everything is straight-line: 2^-120 is added to the squared angle,
so that sin θ/θ and the like are evaluated at θ ≥ 1e-18 instead of 0/0.

Derivatives of the exponential map are in the tangent spaces where it begins and ends. Of the turn φ
by the angle θ they are made of

    a = sin θ/θ,   b = (1 − cos θ)/θ²,   c = (θ − sin θ)/θ³

and of the rates b′ = (a − 2b)/θ² and c′ = (b − 3c)/θ² of b and c by θ, over θ; that of a is c − b.
Rounding of a and b over θ² does no harm, since b′ is multiplied by φ twice. That of 1 − a would:
c stands by one φ. So a series gives c up to θ = 1.

Those of the logarithm are their inverses, made of φ in the same way with

    h = θ/2 cot θ/2,   −1/2,   e = (1 − h)/θ²

in place of a, b and c; no angle is more than half a turn. h is a quotient that is there already,
and e has a series for the same reason as c. By s = θ² its rate e′ obeys 2 s e′ = 1/4 − 3 e + s e²,
so that no more functions of the angle are needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.inertia import ANGULAR, Inertia
from gibbs_codegen.derivation.motion import Acceleration, Motion, TreeState
from gibbs_codegen.derivation.unit_motions import STILL, Column, MovingBody, column
from gibbs_codegen.robot.layout import QUATERNION, Places, velocity_places
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Matrix,
    Rotation,
    Wrench,
    axis_vector,
    minus,
    zeros,
)

# The scalar last.
Quaternion = tuple[sp.Expr, ...]

# Added to squares of angles: far below the square of a rounding error, yet neither it nor its
# inverse is out of the range of single precision.
_TINY = sp.Rational(1, 2**120)
_TWO = sp.Integer(2)
# Terms of the series of c: up to θ = 1 the next is 3e-18 of the first.
_TERMS = 9
# Further terms of the series of e; each is smaller than the last by 1/(2π)².
_MORE_TERMS = 11


def rotation_columns(tape: Scalars, q: Quaternion, twice: sp.Expr = _TWO) -> tuple[Vector, ...]:
    """Columns of a quaternion's rotation matrix: the base's axes in the world.

    `twice` is 2 over the square of the quaternion's length.
    """
    let, (x, y, z, w) = tape.let, q
    dx, dy, dz = (let(twice * part) for part in (x, y, z))
    xx, yy, zz = let(x * dx), let(y * dy), let(z * dz)
    xy, xz, yz = let(y * dx), let(z * dx), let(z * dy)
    wx, wy, wz = let(w * dx), let(w * dy), let(w * dz)
    return (
        (let(1 - yy - zz), let(xy + wz), let(xz - wy)),
        (let(xy - wz), let(1 - xx - zz), let(yz + wx)),
        (let(xz + wy), let(yz - wx), let(1 - xx - yy)),
    )


def upward(tape: Scalars, q: Quaternion, length: sp.Expr) -> Vector:
    """A vector of a length along the world's Z in the base's frame."""
    let, (x, y, z, w) = tape.let, q
    a, b = let(2 * length * x), let(2 * length * y)
    return (let(a * z - b * w), let(b * z + a * w), let(length - a * x - b * y))


def turned(tape: Scalars, columns: tuple[Vector, ...], vector: Vector) -> Vector:
    """A vector of the base's frame in the world, by the base's axes there."""
    return tuple(tape.dot(row, vector) for row in zip(*columns, strict=True))


@dataclass(frozen=True)
class QuaternionDerivatives:
    """ω, the velocity of the origin and the upward acceleration of gravity in the base's frame."""

    omega: Vector
    velocity: Vector
    upward: Vector

    def coriolis(self, tape: Scalars) -> QuaternionDerivatives:
        """The same for the accelerations that make 2C in place of derivatives by velocities.

        They are 2e×ẋ + 2(ω×e)×ρ of a turn about an axis e of the base, and 2ω×e of a motion along
        it.
        """
        return replace(self, omega=tape.scale(sp.Integer(2), self.omega), velocity=ZERO)

    def row(self, tape: Scalars, joint: Column) -> tuple[Values, Values]:
        """Derivatives by turn and displacement of the base, and by ω and v, in its frame."""
        force, moment = joint.mass.force, joint.mass.moment
        with tape.group("derivatives by the attitude"):
            turning = tape.cross(force, self.upward)
        with tape.group("derivatives by the velocity of the base"):
            linear = tape.cross(force, self.omega)
            angular = tape.add(
                tape.cross(moment, self.omega), tape.cross(self.velocity, force), joint.couple
            )
        return (*turning, *(sp.S.Zero,) * 3), (*angular, *linear)

    def blocks(self, tape: Scalars, body: MovingBody, mass_block: Matrix) -> tuple[Matrix, Matrix]:
        """Rows of the moment and then of the force; the mass is that of `mass_block`."""
        by_place, by_rate = zeros(6, 6), zeros(6, 6)
        body = replace(body, inertia=replace(body.inertia, mass=mass_block[3][3]))
        with tape.group("derivatives of the forces on the base by its own motion"):
            for i in range(3):
                axis = axis_vector(i)
                moved = replace(
                    STILL,
                    linear_rate=tape.cross(self.omega, axis),
                    linear_acceleration=tape.cross(self.upward, axis),
                )
                turned = replace(
                    STILL,
                    axis=axis,
                    twice_rate=tape.cross(self.omega, axis),
                    linear_rate=tape.cross(axis, self.velocity),
                )
                shifting, turning = column(tape, moved, body), column(tape, turned, body)
                _put(by_place, i, shifting.angle)
                _put(by_rate, i, turning.rate)
                _put(by_rate, 3 + i, shifting.rate)
        return by_place, by_rate


def _put(matrix: Matrix, place: int, wrench: Wrench) -> None:
    """Set column `place` of a matrix of six rows to a moment and a force."""
    for row, entry in zip(matrix, (*wrench.moment, *wrench.force), strict=True):
        row[place] = entry


@dataclass(frozen=True)
class QuaternionRoot:
    """Attitude by a unit quaternion, velocities in the base's own frame."""

    attitude: Quaternion
    axes: tuple[Vector, ...]
    # No rotation is left to the root segment.
    spins_about_normal = False
    segment_angle = sp.S.Zero
    segment_rotation = NO_ROTATION

    @classmethod
    def make(cls, tape: Scalars, attitude: Quaternion) -> QuaternionRoot:
        """The root of a quaternion's x, y, z and w."""
        return cls(attitude, rotation_columns(tape, attitude))

    def places(self, joints: int) -> Places:
        """Linear velocity first, then angular velocity, then the joints."""
        return velocity_places(QUATERNION, joints)

    def frame_motion(self, tape: Scalars, base: TreeState) -> Motion:
        """Motion of the base in its own frame; rates are ω and the origin's velocity."""
        linear, omega = self.origin_acceleration(tape, base), tuple(base.rates[:3])
        angular, reference = tuple(base.accelerations[:3]), tuple(base.references[:3])
        if reference:
            angular = tape.add(angular, tape.cross(omega, reference))
        return Motion.of(tape, omega, angular, linear, reference)

    def origin_acceleration(self, tape: Scalars, base: TreeState) -> Vector:
        """v̇ + ω×v with gravity upwards, in the base's frame (m/s²)."""
        turning = tape.cross(tuple(base.rates[:3]), tuple(base.accelerated[3:]))
        up = upward(tape, self.attitude, base.gravity)
        return tape.add(tuple(base.accelerations[3:]), turning, up)

    def segment_spin(self, values: Values) -> sp.Expr:
        """Zero: the root segment does not turn against its group frame."""
        return sp.S.Zero

    def rows(self, tape: Scalars, wrench: Wrench) -> Values:
        """Moment and force of the wrench itself."""
        return (*wrench.moment, *wrench.force)

    def momentum_rates(self, tape: Scalars, base: TreeState, momentum: Wrench) -> Values:
        """Rates by the motion of the base's axes; its velocities are in place of accelerations."""
        omega, velocity = tuple(base.accelerations[:3]), tuple(base.accelerations[3:])
        return self.rows(tape, momentum.turned_with(tape, velocity, omega))

    def mass_block(self, tape: Scalars, composite: Inertia) -> Matrix:
        """The Hessian of the Gibbs function, 6×6, angular before linear."""
        block = zeros(6, 6)
        for i in range(3):
            block[3 + i][3 + i] = composite.mass
            wrench = composite.response(tape, ANGULAR + i)
            for j in range(3):
                block[i][j] = wrench.moment[j]
                block[i][3 + j] = block[3 + j][i] = wrench.force[j]
        return block

    def derivatives(self, tape: Scalars, base: TreeState) -> QuaternionDerivatives:
        """Derivatives of forces by the base's attitude and velocities, without accelerations."""
        up = upward(tape, self.attitude, base.gravity)
        return QuaternionDerivatives(tuple(base.rates[:3]), tuple(base.rates[3:]), up)

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector of the base's frame."""
        return turned(tape, self.axes, vector)

    def velocities_at(self, tape: Scalars, point: Vector) -> list[tuple[Vector, Vector]]:
        """Linear and angular velocity of a point per unit of ω, and then of v, in world axes."""
        turning = [(tape.cross(axis, point), axis) for axis in self.axes]
        return [*turning, *((axis, ZERO) for axis in self.axes)]

    def accelerations(
        self, tape: Scalars, linear: Vector, angular: Vector, base: TreeState
    ) -> list[sp.Expr]:
        """ω̇ and v̇."""
        with tape.group("rate of the base's velocity, in its own frame"):
            free = self.origin_acceleration(tape, base.unaccelerated)
            return [*angular, *tape.add(linear, minus(free))]

    def coordinate_rates(self, tape: Scalars, coordinates: Values, rates: Values) -> Values:
        """q̇ = ½ q ω, and the rate of the position, from ω and the origin's velocity."""
        half = tape.scale(sp.Rational(1, 2), tuple(rates[:3]))
        quaternion = _product(tape, self.attitude, (*half, sp.S.Zero))
        return [*quaternion, *self.world(tape, tuple(rates[3:]))]

    def integrated(self, tape: Scalars, coordinates: Values, step: Values) -> Values:
        """The pose after a screw motion, turn (rad) and step (m): the exponential map of SE(3).

        With θ = |turn|, the attitude is turned by the quaternion of half that angle, and the step
        is ν + (1 − cos θ)/θ²·turn×ν + (θ − sin θ)/θ³·turn×(turn×ν). A quaternion that is not of
        unit length is normalised; where the square of its length is zero or overflows, the pose is
        not finite. The result, q or −q, is the one on the side of the quaternion that it starts
        from.
        """
        let, q, position = tape.let, coordinates[:4], tuple(coordinates[4:])
        turn = tuple(step[:3])
        square, cosine, share = half_angle(tape, turn)
        with tape.group("angle of the displacement, and its functions"):
            first = let(2 * share * share)
            second = let(let(1 - 2 * share * cosine) * let(1 / square))
        with tape.group("the quaternion, of unit length, on the side of the new one"):
            squared = let(sp.Add(*(part * part for part in q)))
            # Not 1/√, which would make of a quaternion that is too long one that is zero.
            inverse = let(let(sp.sqrt(squared)) * let(1 / squared))
            side = let(inverse * let(sp.sign(cosine)))
            attitude = tuple([let(side * part) for part in q])
        with tape.group("position after the displacement"):
            way = _way(tape, turn, tuple(step[3:]), first, second)
            way = turned(tape, rotation_columns(tape, attitude), way)
            moved = tape.add(position, way)
        with tape.group("attitude after the displacement"):
            after = _product(tape, attitude, (*tape.scale(share, turn), cosine))
        return [*after, *moved]

    def difference(self, tape: Scalars, start: Values, end: Values) -> Values:
        """Turn (rad, half a turn at most) and step (m) between two poses: the logarithm of SE(3).

        They are in the frame of the first pose; quaternions are of unit length. With φ half the
        angle the turn is twice φ/sin φ times the vector part of the quaternion between them, and
        the step is p − ½turn×p + (1 − φ cot φ)/(4φ²)·turn×(turn×p).
        """
        let, (x, y, z, w, *origin) = tape.let, start
        back = (-x, -y, -z, w)
        part, side, cosine, square, _, ratio = _between(tape, back, tuple(end[:4]))
        with tape.group("displacement"):
            columns = rotation_columns(tape, back)
            way = turned(tape, columns, tape.add(tuple(end[4:]), minus(tuple(origin))))
            twice = let(2 * side * ratio)
            turn = tape.scale(twice, part)
            bend = let(let(1 - ratio * cosine) * let(1 / square))
            across = tape.cross(part, way)
            again = tape.scale(bend, tape.cross(part, across))
            return [*turn, *tape.add(way, minus(tape.scale(let(side * ratio), across)), again)]

    def integrated_by_place(self, tape: Scalars, step: Values) -> Matrix:
        """Derivative of `integrated` by the pose before: Ad of the inverse motion.

        These are 6×6 entries [[Rᵀ, 0], [−Rᵀp̃, Rᵀ]], angular before linear, in the frames of the
        poses.
        """
        turn = tuple(step[:3])
        square, cosine, share = half_angle(tape, turn)
        _, first, second = _coefficients(tape, square, cosine, share)
        with tape.group("motion as a rotation and a way"):
            axes = rotation_columns(tape, (*tape.scale(share, turn), cosine))
            way = _way(tape, turn, tuple(step[3:]), first, second)
        with tape.group("what the motion makes of a displacement before it"):
            block = zeros(6, 6)
            for i, axis in enumerate(axes):
                lever = tape.cross(way, axis)
                for j in range(3):
                    block[i][j] = block[3 + i][3 + j] = axis[j]
                    block[3 + i][j] = tape.let(lever[j])
        return block

    def integrated_by_step(self, tape: Scalars, step: Values) -> Matrix:
        """Derivative of `integrated` by the motion: the right Jacobian of SE(3).

        It is [[J, 0], [Q, J]], angular before linear, in the frame of the pose after the motion,
        with J = a·1 − b·φ̃ + c·φφᵀ, and with Q the rate of J as φ moves by the linear part.
        """
        let, turn, linear = tape.let, tuple(step[:3]), tuple(step[3:])
        square, cosine, share = half_angle(tape, turn)
        a, b, c = _coefficients(tape, square, cosine, share)
        with tape.group("rates of the functions of the angle"):
            along = tape.dot(turn, linear)
            inverse = let(1 / square)
            b_rate = let(along * let(let(a - 2 * b) * inverse))
            c_rate = let(along * let(let(b - 3 * c) * inverse))
            a_rate = let(along * let(c - b))
        with tape.group("what is made of a change of the motion"):
            return _of_changes(tape, turn, linear, (a, -b, c), (a_rate, -b_rate, c_rate))

    def difference_by_start(self, tape: Scalars, start: Values, end: Values) -> Matrix:
        """Derivative of `difference` by the first pose: minus the inverse left Jacobian of SE(3).

        Its blocks are those of the second pose transposed.
        """
        with tape.group("what a displacement of the first pose makes"):
            blocks = self.difference_by_end(tape, start, end)
            other = zeros(6, 6)
            for i in range(3):
                for j in range(3):
                    other[i][j] = other[3 + i][3 + j] = -blocks[j][i]
                    other[3 + i][j] = -blocks[3 + j][i]
            return other

    def difference_by_end(self, tape: Scalars, start: Values, end: Values) -> Matrix:
        """Derivative of `difference` by the second pose: the inverse right Jacobian of SE(3).

        It is [[K, 0], [P, K]], angular before linear, with K = h·1 + φ̃/2 + e·φφᵀ, and with P the
        rate of K as φ moves by the linear part.
        """
        let = tape.let
        displacement = self.difference(tape, start, end)
        turn, linear = tuple(displacement[:3]), tuple(displacement[3:])
        h, angle = self._bend(tape, start, end, turn)
        with tape.group("functions of the angle"):
            square = let(angle * angle + _TINY)
            series = sp.S.Zero
            bounded, small = _bounded(tape, square)
            for k in reversed(range(_MORE_TERMS)):
                n = 2 * k + 2
                series = let(abs(sp.bernoulli(n)) / math.factorial(n) + bounded * series)
            e = let(small * series + let(1 - small) * let(let(1 - h) * let(1 / square)))
        with tape.group("rates of the functions of the angle"):
            along = tape.dot(turn, linear)
            twice = let(square * let(e * e))
            h_rate = let(along * let(e - sp.Rational(1, 4) - twice))
            slope = let(sp.Rational(1, 4) - 3 * e + twice)
            e_rate = let(along * let(slope * let(1 / square)))
        with tape.group("what a displacement of the second pose makes"):
            rates = (h_rate, sp.S.Zero, e_rate)
            return _of_changes(tape, turn, linear, (h, sp.Rational(1, 2), e), rates)

    def _bend(
        self, tape: Scalars, start: Values, end: Values, turn: Vector
    ) -> tuple[sp.Expr, sp.Expr]:
        """H of the turn from one pose to another, and its angle."""
        x, y, z, w = start[:4]
        _, _, cosine, _, quarter, ratio = _between(tape, (-x, -y, -z, w), tuple(end[:4]))
        with tape.group("functions of the angle"):
            return tape.let(ratio * cosine), tape.let(4 * quarter)

    def acceleration_rows(
        self, tape: Scalars, turns: Sequence[Rotation]
    ) -> Callable[[Acceleration], Values]:
        """Rates of ω and v by an acceleration of the origin and angular, in the base's frame."""

        def converted(motion: Acceleration) -> Values:
            for turn in turns:
                motion = motion.rotated(tape, turn)
            return [*motion.angular, *motion.linear]

        return converted

    def state_columns(
        self, tape: Scalars, turning: Sequence[Values], linear: Vector, base: TreeState
    ) -> tuple[list[Values], list[Values]]:
        """Columns for a turn and a displacement of the base in its own frame, and for ω and v."""
        omega, velocity = tuple(base.rates[:3]), tuple(base.rates[3:])
        up = upward(tape, self.attitude, base.gravity)
        by_attitude, by_turning, by_velocity = [], [], []
        for k, about in enumerate(turning):
            unit = axis_vector(k)
            moved = tape.add(tuple(about[:3]), tape.cross(velocity, unit))
            by_turning.append([*about[3:6], *moved, *about[6:]])
            still = [sp.S.Zero] * len(about[6:])
            by_attitude.append([*ZERO, *tape.cross(unit, up), *still])
            by_velocity.append([*ZERO, *tape.cross(unit, omega), *still])
        nothing = [[sp.S.Zero] * len(by_turning[0])] * 3
        return [*by_attitude, *nothing], [*by_turning, *by_velocity]


def _of_changes(
    tape: Scalars,
    turn: Vector,
    linear: Vector,
    gains: tuple[sp.Expr, sp.Expr, sp.Expr],
    rates: tuple[sp.Expr, sp.Expr, sp.Expr],
) -> Matrix:
    """Matrix of a·1 + b·turn× + c·turn turnᵀ, with `gains` a, b and c, on twists (6×6).

    Beside its blocks stands its derivative along `linear`, with `rates` of the gains.
    """
    let, (a, b, c), (a_rate, b_rate, c_rate) = tape.let, gains, rates
    block = zeros(6, 6)
    for j in range(3):
        unit = axis_vector(j)
        across = tape.cross(turn, unit)
        image = tape.add(
            tape.scale(a, unit), tape.scale(b, across), tape.scale(let(c * turn[j]), turn)
        )
        rate = tape.add(
            tape.scale(a_rate, unit),
            tape.scale(b_rate, across),
            tape.scale(b, tape.cross(linear, unit)),
            tape.scale(let(c_rate * turn[j] + c * linear[j]), turn),
            tape.scale(let(c * turn[j]), linear),
        )
        for i in range(3):
            block[i][j] = block[3 + i][3 + j] = image[i]
            block[3 + i][j] = rate[i]
    return block


def half_angle(tape: Scalars, turn: Vector) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """θ², cos θ/2, and sin(θ/2)/θ of the angle θ of a turn, axis times angle (rad)."""
    let = tape.let
    with tape.group("angle of the displacement, and its functions"):
        square = let(tape.dot(turn, turn) + _TINY)
        angle = let(sp.sqrt(square))
        half = let(angle / 2)
        return square, let(sp.cos(half)), let(let(sp.sin(half)) * let(1 / angle))


def _between(
    tape: Scalars, back: Quaternion, end: Quaternion
) -> tuple[Vector, sp.Expr, sp.Expr, sp.Expr, sp.Expr, sp.Expr]:
    """The turn from an attitude, given by its conjugate `back`, to another, at most half a turn.

    With φ half its angle these are the vector part, the sign of the scalar part, cos φ, sin² φ, φ/2
    and φ/sin φ.
    """
    let = tape.let
    with tape.group("quaternion from the first attitude to the second"):
        *vector, scalar = _product(tape, back, end)
        part = tuple(vector)
    with tape.group("half the angle between them, over its sine"):
        side = let(sp.sign(scalar))
        cosine = let(side * scalar)
        square = let(tape.dot(part, part) + _TINY)
        sine = let(sp.sqrt(square))
        quarter = let(sp.atan(let(sine * let(1 / let(1 + cosine)))))
        ratio = let(2 * quarter * let(1 / sine))
    return part, side, cosine, square, quarter, ratio


def _product(tape: Scalars, p: Quaternion, q: Quaternion) -> Quaternion:
    (a, b, c, d), (x, y, z, w) = p, q
    return (
        tape.let(d * x + a * w + b * z - c * y),
        tape.let(d * y + b * w + c * x - a * z),
        tape.let(d * z + c * w + a * y - b * x),
        tape.let(d * w - a * x - b * y - c * z),
    )


def _way(tape: Scalars, turn: Vector, step: Vector, first: sp.Expr, second: sp.Expr) -> Vector:
    """ν + first·turn×ν + second·turn×(turn×ν) of a step ν."""
    once = tape.cross(turn, step)
    twice = tape.cross(turn, once)
    return tape.add(step, tape.scale(first, once), tape.scale(second, twice))


def _coefficients(
    tape: Scalars, square: sp.Expr, cosine: sp.Expr, share: sp.Expr
) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """Functions a, b, c of an angle from `half_angle`, as accurate as numbers are at any angle."""
    let = tape.let
    with tape.group("functions of the angle"):
        a, b = let(2 * share * cosine), let(2 * share * share)
        bounded, small = _bounded(tape, square)
        series = sp.S.Zero
        for k in reversed(range(_TERMS)):
            term = sp.Rational((-1) ** k, math.factorial(2 * k + 3))
            series = let(term + bounded * series)
        closed = let(let(1 - a) * let(1 / square))
        return a, b, let(small * series + let(1 - small) * closed)


def _bounded(tape: Scalars, square: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """θ² up to 1, beyond that zero; and 1 or zero likewise."""
    let = tape.let
    small = let(sp.Rational(1, 2) + sp.Rational(1, 2) * let(sp.sign(let(1 - square))))
    return let(small * square), small
