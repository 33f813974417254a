"""Parameters of a robot: symbols named after the keys of its file, and inertias made of them.

A value that is exactly zero in the file is structural: it is folded away and is no parameter,
unless all are kept. Inertias are plain polynomials in the parameters, which no tape has named yet,
so that sums over arms that vanish by symmetry can be seen to vanish.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.robot.model import Body, RigidBody, Robot, Rod
from gibbs_codegen.symbolic.inline_tape import InlineTape
from gibbs_codegen.symbolic.tape import Scalars, Stage


@dataclass(frozen=True)
class BodySymbols:
    """Length of a body, and its inertia about its joint in its own frame."""

    length: sp.Expr
    inertia: Inertia


@dataclass(frozen=True)
class LinkSymbols:
    """Denavit–Hartenberg a (by default the length of the link before) and d of a link; its body."""

    a: sp.Expr
    d: sp.Expr
    body: BodySymbols


class Parameters:
    """Symbols for the numbers of a robot file, with their defaults in `defaults`, units in `units`.

    `folded` names those that are zero in the file and therefore structural.
    """

    def __init__(self, robot: Robot, tape: Scalars, keep_zeros: bool = False) -> None:
        self.defaults: dict[str, float] = {}
        self.units: dict[str, str] = {}
        self.folded: list[str] = []
        self._robot = robot
        self._tape = tape
        self._keep_zeros = keep_zeros
        # All at once, in the order of the file, whatever the derivation asks for first.
        self.gravity = self._value("gravity", robot.gravity, "m/s^2")
        arms = range(1, robot.rotors + 1)
        self._drags = [self._value(f"base_drag_{k}", robot.base.drag[k - 1], "m") for k in arms]
        self._arms = [self._body(self._arm_prefix(k), robot.base.arm(k)) for k in arms]
        self._links = [self._link(i) for i in range(1, len(robot.links) + 1)]

    def arm(self, k: int) -> BodySymbols:
        """Symbols of a base arm.

        Args:
            k: Its number, 1 … N.

        Returns:
            Its length, and its inertia about its start, in its own frame.
        """
        return self._arms[k - 1]

    def drag(self, k: int) -> sp.Expr:
        """Reaction torque of a motor per unit of thrust.

        Args:
            k: Its number, 1 … N.

        Returns:
            The ratio (m).
        """
        return self._drags[k - 1]

    def link(self, i: int) -> LinkSymbols:
        """Symbols of a link of the arm.

        Args:
            i: Its number, 1 … n.

        Returns:
            Its lengths and its body.
        """
        return self._links[i - 1]

    def _arm_prefix(self, k: int) -> str:
        return "base_arm" if self._robot.base.shares_one_arm else f"base_arm{k}"

    def _value(self, name: str, default: float, unit: str) -> sp.Expr:
        """The symbol of a parameter, or zero where it is structural.

        Args:
            name, unit: As the generated module gives them.
            default: Its value in the robot file.

        Returns:
            The symbol, whose default and unit are noted, or zero.
        """
        if default == 0.0 and not self._keep_zeros:
            if name not in self.folded:
                self.folded.append(name)
            return sp.S.Zero
        self.defaults[name] = default
        self.units[name] = unit
        return self._tape.symbol(name, Stage.PARAMETER)

    def _link(self, i: int) -> LinkSymbols:
        link = self._robot.links[i - 1]
        if link.a is not None:
            a = self._value(f"link{i}_a", link.a, "m")
        elif i > 1:
            a = self._value(f"link{i - 1}_length", self._robot.links[i - 2].body.length, "m")
        else:
            a = sp.S.Zero
        d = self._value(f"link{i}_d", link.d, "m")
        return LinkSymbols(a, d, self._body(f"link{i}", link.body))

    def _body(self, prefix: str, body: Body) -> BodySymbols:
        length = self._value(f"{prefix}_length", body.length, "m")
        with self._tape.group(f"second moments of {prefix}", Stage.PARAMETER):
            if isinstance(body, Rod):
                return BodySymbols(length, self._rod(prefix, body, length))
            return BodySymbols(length, self._rigid_body(prefix, body))

    def _rod(self, prefix: str, rod: Rod, length: sp.Expr) -> Inertia:
        """B₀ = μl, C = (μl²/2, 0, 0), B₂ = diag(0, μl³/3, μl³/3), and the section's B₃.

        Args:
            prefix: Of its parameters' names.
            rod, length: The rod, and the symbol of its length.

        Returns:
            Inertia about its start, in its own frame.
        """
        density = self._value(f"{prefix}_mass_per_length", rod.mass_per_length, "kg/m")
        x, y, z = (
            self._value(f"{prefix}_section_inertia_{axis}", value, "kg m^2")
            for axis, value in zip(("xx", "yy", "zz"), rod.section_inertia, strict=True)
        )
        zero = sp.S.Zero
        excess = self._half_excess
        along = self._tape.let(density * length**3 / 3 + excess(y, z, x))
        second = (along, excess(z, x, y), excess(x, y, z))
        moment = density * length**2 / 2
        return Inertia(density * length, (moment, zero, zero), (*second, zero, zero, zero))

    def _rigid_body(self, prefix: str, body: RigidBody) -> Inertia:
        """The parallel-axis rule on a body given about its centre of mass."""
        mass = self._value(f"{prefix}_mass", body.mass, "kg")
        com = [
            self._value(f"{prefix}_com_{axis}", value, "m")
            for axis, value in zip("xyz", body.com, strict=True)
        ]
        xx, yy, zz, xy, xz, yz = (
            self._value(f"{prefix}_inertia_{name}", value, "kg m^2")
            for name, value in zip(("xx", "yy", "zz", "xy", "xz", "yz"), body.inertia, strict=True)
        )
        zero = sp.S.Zero
        excess = self._half_excess
        second = (excess(yy, zz, xx), excess(zz, xx, yy), excess(xx, yy, zz), -xy, -xz, -yz)
        about_com = Inertia(mass, (zero, zero, zero), second)
        return about_com.shifted(InlineTape(), (com[0], com[1], com[2]))

    def _half_excess(self, first: sp.Expr, second: sp.Expr, whole: sp.Expr) -> sp.Expr:
        """½(first + second − whole), which is E_xx for the moments of inertia I_yy, I_zz, I_xx.

        The mass matrix adds second moments up to moments of inertia again, so E_xx must be exact to
        a rounding of the smaller of I_yy and I_zz, however slender or flat the body is. No moment
        of inertia is larger than the sum of the other two. So where the rounding of first − whole
        is too large for that, `first` is less than half of `whole`, and the rounding can be
        computed exactly and added (Dekker's sum of two numbers).

        Args:
            first, second, whole: Moments of inertia about the three axes (kg m²).

        Returns:
            The second moment along the axis of `whole` (kg m²).
        """
        let = self._tape.let
        difference = let(first - whole)
        rounding = let(first - let(difference + whole))
        return let(let(let(difference + second) + rounding) / 2)
