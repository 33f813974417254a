"""Motion of a link and how it passes from one link to the next.

A motion is the angular velocity ω, the acceleration r̈ of the joint, and the acceleration gradient
A = dω/dt~ + ω̃ω̃, all in one frame: a point at ρ from the joint has the acceleration r̈ + Aρ.
Spinning about z leaves Az alone, since points on the axis do not notice the spin; that is why links
on parallel axes, whose motions are kept in one frame, share most of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.robot.layout import Places
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector, negated, plus, times
from gibbs_codegen.symbolic.vectors import Rotation, Transform

Gradient = tuple[Vector, ...]


@dataclass(frozen=True)
class TreeState:
    """Velocities and their rates in the order of the tree's coordinates, and gravity."""

    rates: Values
    accelerations: Values
    gravity: sp.Expr

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
        pairs = zip(places.split(self.rates), places.split(self.accelerations), strict=True)
        base, joints = (TreeState(*pair, self.gravity) for pair in pairs)
        return base, joints


@dataclass(frozen=True)
class Motion:
    """ω, dω/dt, the acceleration r̈ of the joint, and A by columns, in one frame."""

    omega: Vector
    omega_dot: Vector
    acceleration: Vector
    gradient: Gradient

    @classmethod
    def of(cls, tape: Scalars, omega: Vector, omega_dot: Vector, acceleration: Vector) -> Motion:
        """Motion with the gradient A that belongs to ω and dω/dt, and r̈ (m/s²) of the joint."""
        products = [[tape.let(times(p, q)) for q in omega] for p in omega]

        def entry(i: int, j: int) -> sp.Expr:
            if i == j:
                k, m = (j + 1) % 3, (j + 2) % 3
                return tape.less(negated(products[k][k]), products[m][m])
            turning = omega_dot[3 - i - j]
            along = turning if (i - j) % 3 == 1 else negated(turning)
            return tape.let(plus(products[i][j], along))

        columns = [tuple([entry(i, j) for i in range(3)]) for j in range(3)]
        return cls(omega, omega_dot, acceleration, tuple(columns))

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
        return Motion(self.omega, self.omega_dot, (x, y, z), self.gradient)

    def displaced_along(self, tape: Scalars, rotation: Rotation, length: sp.Expr) -> Motion:
        """Motion of another point, `length` (m) along the x axis of a frame turned about z."""
        if length == 0:
            return self
        step = tape.scale(length, self.along_x(tape, rotation))
        return Motion(self.omega, self.omega_dot, tape.add(self.acceleration, step), self.gradient)

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

    def spun(self, tape: Scalars, rate: sp.Expr, acceleration: sp.Expr) -> Motion:
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

    def slid(self, tape: Scalars, rate: sp.Expr, acceleration: sp.Expr) -> Motion:
        """Motion of a link that moves along z on this one: r̈ gains 2ω×żz + z̈z."""
        x, y, _ = self.omega
        twice = tape.let(2 * rate)
        gain = (tape.let(twice * y), -tape.let(twice * x), acceleration)
        return Motion(self.omega, self.omega_dot, tape.add(self.acceleration, gain), self.gradient)


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
