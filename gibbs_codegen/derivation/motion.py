"""Motion of a link and how it passes from one link to the next.

A motion is the angular velocity ω, the acceleration r̈ of the joint, and the acceleration gradient
A = dω/dt~ + ω̃ω̃, all in one frame: a point at ρ from the joint has the acceleration r̈ + Aρ.
Spinning about z leaves Az alone, since points on the axis do not notice the spin; that is why links
on parallel axes, whose motions are kept in one frame, share most of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.robot.layout import Places
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector, negated, plus, times
from gibbs_codegen.symbolic.vectors import Rotation, Transform, axis_vector

Gradient = tuple[Vector, ...]


@dataclass(frozen=True)
class TreeState:
    """Velocities and their rates in the order of the tree's coordinates, and gravity.

    With `references` the accelerations are rates of these: of velocities that the tree, which moves
    with `rates`, need not have.
    """

    rates: Values
    accelerations: Values
    gravity: sp.Expr
    references: Values = ()

    @classmethod
    def coasting(cls, rates: Values, gravity: sp.Expr = sp.S.Zero) -> TreeState:
        """The state with θ̈ = 0 at some rates, without gravity unless it is given."""
        return cls(rates, [sp.S.Zero] * len(rates), gravity)

    @classmethod
    def resting(cls, accelerations: Values) -> TreeState:
        """The state at rest, weightless: with velocities for θ̈, accelerations are velocities."""
        return cls([sp.S.Zero] * len(accelerations), accelerations, sp.S.Zero)

    @property
    def unaccelerated(self) -> TreeState:
        """The state with θ̈ = 0, whose generalised inertia forces are −R."""
        return TreeState.coasting(self.rates, self.gravity)

    def split(self, places: Places) -> tuple[TreeState, TreeState]:
        """The state of the base, attitude first, and that of the joints."""
        rates, accelerations = places.split(self.rates), places.split(self.accelerations)
        references = places.split(self.references) if self.references else ((), ())
        pairs = zip(rates, accelerations, references, strict=True)
        base, joints = (TreeState(v, a, self.gravity, v_r) for v, a, v_r in pairs)
        return base, joints

    @property
    def accelerated(self) -> Values:
        """The velocities of which the accelerations are the rates."""
        return self.references or self.rates


@dataclass(frozen=True)
class Motion:
    """ω, dω/dt, the acceleration r̈ of the joint, and A by columns, in one frame."""

    omega: Vector
    omega_dot: Vector
    acceleration: Vector
    gradient: Gradient

    @classmethod
    def of(
        cls,
        tape: Scalars,
        omega: Vector,
        omega_dot: Vector,
        acceleration: Vector,
        reference: Vector = (),
    ) -> Motion:
        """Motion with the gradient A that belongs to ω and dω/dt, and r̈ (m/s²) of the joint.

        With ω_r for `reference`, of which dω/dt is the rate, it is a `ReferenceMotion`.
        """
        gradient = _gradient(tape, omega, reference or omega, omega_dot)
        if reference:
            return ReferenceMotion(omega, omega_dot, acceleration, gradient, reference)
        return cls(omega, omega_dot, acceleration, gradient)

    def rotated(self, tape: Scalars, rotation: Rotation) -> Motion:
        """The same motion in another frame, to which `rotation` takes components."""
        if rotation.is_identity:
            return self
        return Motion.of(
            tape,
            rotation.vector(tape, self.omega),
            rotation.vector(tape, self.omega_dot),
            rotation.vector(tape, self.acceleration),
        )

    def displaced(self, tape: Scalars, step: Vector) -> Motion:
        """Motion of another point of the same link, by the step to it (m)."""
        columns = [
            tuple(times(length, entry) for entry in column)
            for length, column in zip(step, self.gradient, strict=True)
            if length != 0
        ]
        x, y, z = (
            tape.let(plus(r, *(tape.let(column[i]) for column in columns)))
            for i, r in enumerate(self.acceleration)
        )
        return replace(self, acceleration=(x, y, z))

    def displaced_along(self, tape: Scalars, rotation: Rotation, length: sp.Expr) -> Motion:
        """Motion of another point, `length` (m) along the x axis of a frame turned about z."""
        if length == 0:
            return self
        step = tape.scale(length, self.along_x(tape, rotation))
        return replace(self, acceleration=tape.add(self.acceleration, step))

    def stepped(self, tape: Scalars, rotation: Rotation, step: Vector) -> Motion:
        """Motion of another point of the same link, in this one's frame.

        The step (m) to it is in a frame that `rotation` turns about z.
        """
        x, y, z = step
        if y == z == 0:  # What the kinematics has along x, the inertia force of a rod has too.
            return self.displaced_along(tape, rotation, x)
        return self.displaced(tape, rotation.vector(tape, step))

    def along_x(self, tape: Scalars, rotation: Rotation) -> Vector:
        """A applied to an x axis that is turned about z: the gain of r̈ per length (1/s²)."""
        first, second, _ = self.gradient
        x, y, z = (
            tape.let(plus(times(rotation.cos, p), times(rotation.sin, q)))
            for p, q in zip(first, second, strict=True)
        )
        return (x, y, z)

    def spun(self, tape: Scalars, rate: sp.Expr, acceleration: sp.Expr, *_: sp.Expr) -> Motion:
        """Motion of a link that turns about z on this one, in this one's frame; by θ̇ and θ̈."""
        if rate == 0 and acceleration == 0:
            return self
        let = tape.let
        (x, y, z), (_, _, z_dot) = self.omega, self.omega_dot
        xz, yz, zz = self.gradient[2]
        spin, spin_dot, less = let(plus(z, rate)), let(plus(z_dot, acceleration)), tape.less
        omega_dot = (less(let(times(y, spin)), yz), less(xz, let(times(x, spin))), spin_dot)
        product, square = let(times(x, y)), let(spin * spin)
        x_turns = less(negated(let(y * y)), square), let(plus(product, spin_dot))
        first = (*x_turns, less(times(let(2 * x), spin), xz))
        y_turns = less(product, spin_dot), less(negated(let(x * x)), square)
        second = (*y_turns, less(times(let(2 * y), spin), yz))
        return Motion((x, y, spin), omega_dot, self.acceleration, (first, second, (xz, yz, zz)))

    def slid(self, tape: Scalars, rate: sp.Expr, acceleration: sp.Expr, *_: sp.Expr) -> Motion:
        """Motion of a link that moves along z on this one: r̈ gains 2ω×żz + z̈z."""
        x, y, _ = self.omega
        twice = tape.let(2 * rate)
        gain = (tape.let(twice * y), -tape.let(twice * x), acceleration)
        return replace(self, acceleration=tape.add(self.acceleration, gain))


@dataclass(frozen=True)
class ReferenceMotion(Motion):
    """How velocities change that links do not have, but reference rates would give them.

    They are V + ω_r×ρ, and move with the points of the link, which turns with ω. So their rates are
    r̈ + Aρ, with A = dω_r/dt~ + ω̃_rω̃: linear in the reference. Where that is the motion itself
    they are accelerations.
    """

    reference: Vector

    def rotated(self, tape: Scalars, rotation: Rotation) -> Motion:
        """The same motion in another frame, to which `rotation` takes components."""
        if rotation.is_identity:
            return self
        vectors = self.omega, self.omega_dot, self.acceleration, self.reference
        return self.of(tape, *(rotation.vector(tape, vector) for vector in vectors))

    def spun(
        self, tape: Scalars, rate: sp.Expr, acceleration: sp.Expr, *reference: sp.Expr
    ) -> Motion:
        """Motion of a link that turns about z on this one; by θ̇, θ̈_r and θ̇_r."""
        if not any((rate, acceleration, *reference)):
            return self
        let, less = tape.let, tape.less
        (x, y, z), (x_r, y_r, z_r), z_dot = self.omega, self.reference, self.omega_dot[2]
        xz, yz, zz = self.gradient[2]
        spin, spin_r = let(plus(z, rate)), let(plus(z_r, *reference))
        spin_dot, square = let(plus(z_dot, acceleration)), let(times(spin, spin_r))
        along_x, along_y = let(times(x, spin_r)), let(times(y, spin_r))
        omega_dot = (less(along_y, yz), less(xz, along_x), spin_dot)
        first = (
            less(negated(let(times(y, y_r))), square),
            let(plus(times(y, x_r), spin_dot)),
            less(plus(times(spin, x_r), along_x), xz),
        )
        second = (
            less(let(times(x, y_r)), spin_dot),
            less(negated(let(times(x, x_r))), square),
            less(plus(times(spin, y_r), along_y), yz),
        )
        gradient = (first, second, (xz, yz, zz))
        moved = replace(self, omega=(x, y, spin), omega_dot=omega_dot, gradient=gradient)
        return replace(moved, reference=(x_r, y_r, spin_r))

    def slid(
        self, tape: Scalars, rate: sp.Expr, acceleration: sp.Expr, *reference: sp.Expr
    ) -> Motion:
        """Motion of a link that moves along z on this one: r̈ gains ω_r×żz + ω×ż_r z + z̈_r z."""
        along, along_r = axis_vector(2, rate), axis_vector(2, *reference)
        gains = tape.cross(self.reference, along), tape.cross(self.omega, along_r)
        moved = tape.add(self.acceleration, *gains, axis_vector(2, acceleration))
        return replace(self, acceleration=moved)


def _gradient(tape: Scalars, omega: Vector, reference: Vector, omega_dot: Vector) -> Gradient:
    """The columns of dω_r/dt~ + ω̃_rω̃, by ω, ω_r and dω_r/dt."""
    products = [[tape.let(times(p, q)) for q in reference] for p in omega]

    def entry(i: int, j: int) -> sp.Expr:
        if i == j:
            k, m = (j + 1) % 3, (j + 2) % 3
            return tape.less(negated(products[k][k]), products[m][m])
        turning = omega_dot[3 - i - j]
        along = turning if (i - j) % 3 == 1 else negated(turning)
        return tape.let(plus(products[i][j], along))

    return tuple([tuple([entry(i, j) for i in range(3)]) for j in range(3)])


@dataclass(frozen=True)
class Acceleration:
    """r̈ and ω̇ of a frame."""

    linear: Vector
    angular: Vector

    @classmethod
    def of(cls, entries: Values) -> Acceleration:
        """An acceleration by its six components, r̈ and then ω̇."""
        x, y, z, p, q, r = entries
        return cls((x, y, z), (p, q, r))

    @property
    def entries(self) -> list[sp.Expr]:
        """The six components."""
        return [*self.linear, *self.angular]

    def plus(self, tape: Scalars, other: Acceleration) -> Acceleration:
        """Sum of two accelerations of one point, in one frame."""
        linear = tape.add(self.linear, other.linear)
        return Acceleration(linear, tape.add(self.angular, other.angular))

    def rotated(self, tape: Scalars, rotation: Rotation) -> Acceleration:
        """The same acceleration in another frame, to which `rotation` takes components."""
        return Acceleration(rotation.vector(tape, self.linear), rotation.vector(tape, self.angular))

    def passed_out(self, tape: Scalars, transform: Transform) -> Acceleration:
        """Acceleration of a frame fixed to this one; `transform` leads from there to here."""
        here = self
        for step in reversed(transform):
            if isinstance(step, Rotation):
                here = here.rotated(tape, step.inverse)
            else:
                gain = tape.cross(here.angular, step)
                here = Acceleration(tape.add(here.linear, gain), here.angular)
        return here
