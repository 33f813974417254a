"""Robots with other parameters: scaled, negated, zero, or not zero where they were."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from gibbs_codegen.robot.model import Body, RigidBody, Robot, Rod
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import (
    Dimension,
    mapped,
    parameter_values,
    with_values,
)
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree

Inertia = tuple[float, float, float, float, float, float]

# Larger or smaller by 2.5 to 6.5 times, in powers of two.
_OCTAVES = (1.3, 2.7)
# What stands for zero beside other numbers, as a share of the smallest of them; and what is zero.
_SMALL, _FLAT = (0.05, 0.2), 1e-9
# Least eigenvalue of a mass matrix of unit diagonal that rounding surely leaves positive.
_DETERMINED = 1e-10


def variation(robot: Robot, names: Collection[str], seed: int, number: int) -> Robot:
    """The robot with other numbers for some parameters.

    Each is larger or smaller by 2.5 to 6.5 times, by turns from one number to the next, and
    negative for two numbers of four (`number` decides which); what is zero gets a size that is
    natural to the robot. Bodies stay possible: masses and moments of inertia are positive, a rod of
    negative length has a negative mass per length, since it lies the other way, and products of
    inertia change their signs as if axes of the body did.
    """
    draw, tree = _Draw(seed, number), Tree(robot)
    reach, period = tree.reach, 1.0 / tree.tempo

    def other(name: str, value: float, dimension: Dimension) -> float:
        # Masses that turn with a joint alone are positive as well.
        drawn = draw.sized if name.endswith("_armature") else draw.signed
        return drawn(value, dimension.unit(reach, robot.total_mass, period))

    def of_body(body: Body) -> Body:
        return _varied_body(body, draw, reach, robot.total_mass)

    values = parameter_values(mapped(robot, other, of_body))
    return with_values(robot, {name: values[name] for name in names})


def variations(
    robot: Robot, names: Collection[str], seed: int, count: int, zeros: bool
) -> Iterator[Robot]:
    """`count` variations; with `zeros`, as many again and more, each parameter zero once in them.

    What would leave an acceleration undetermined at zero, alone or with others, keeps its value.
    """
    yield from (variation(robot, names, seed, number) for number in range(count))
    groups = _groups(names, count) if zeros else []
    # The list grows where parameters are kept back by others, which have another turn then.
    for number, group in enumerate(groups, start=count):
        varied = variation(robot, names, seed, number)
        zero = _zero_together(varied, group)
        kept_back = [name for name in group if name not in zero]
        if zero and kept_back:
            groups.append(kept_back)
        yield _with_zeros(varied, zero)


def _groups(names: Collection[str], count: int) -> list[list[str]]:
    """Parameters to be zero together: masses by themselves, of which others are factors."""
    ordered = sorted(names)
    masses = [name for name in ordered if name.endswith(("_mass", "_mass_per_length"))]
    others = [name for name in ordered if name not in masses]
    groups = [*(others[i::count] for i in range(count)), masses[::2], masses[1::2]]
    return [group for group in groups if group]


def _zero_together(varied: Robot, names: Sequence[str]) -> list[str]:
    """As many of the parameters as can be zero together, by halving what cannot."""
    zero: list[str] = []
    waiting = [list(names)]
    while waiting:
        part = waiting.pop()
        if determined(_with_zeros(varied, [*zero, *part])):
            zero += part
        elif len(part) > 1:
            half = len(part) // 2
            waiting += [part[half:], part[:half]]
    return zero


def _with_zeros(robot: Robot, names: Sequence[str]) -> Robot:
    return with_values(robot, dict.fromkeys(names, 0.0))


def determined(robot: Robot, least: float = _DETERMINED) -> bool:
    """Whether something resists every acceleration by more than rounding would.

    `least` is the smallest eigenvalue that the mass matrix may have once its diagonal is 1.
    """
    tree = Tree(robot)
    states = States.random(tree, 2, 0)
    there, at_joints = states.placed(tree)
    matrix = NewtonEuler(there).mass_matrix(at_joints.q) + np.diag(tree.passive.armature)
    matrix = matrix[:, tree.free][:, :, tree.free]
    diagonal = np.diagonal(matrix, axis1=1, axis2=2)
    # Next to what the coordinate could move, what is left by rounding is nothing.
    if not (diagonal > _DETERMINED * Sizes(tree, states).free_units ** 2).all():
        return False
    roots = np.sqrt(diagonal)
    scaled = matrix / roots[:, :, None] / roots[:, None, :]
    return bool(np.linalg.eigvalsh(scaled).min() > least)


class _Draw:
    """Random factors, the same for the same seed and number."""

    def __init__(self, seed: int, number: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._turned, self._mirrored = number % 2, number // 2 % 2

    def sign(self) -> float:
        """1 or -1."""
        return 1.0 - 2.0 * (int(self._rng.integers(2)) ^ self._mirrored)

    def factor(self) -> float:
        """From 2.5 to 6.5, or the inverse of that."""
        return self.factors(1)[0]

    def factors(self, count: int) -> list[float]:
        """Several such factors, all larger or all smaller."""
        smaller = int(self._rng.integers(2)) ^ self._turned
        octaves = (1 - 2 * smaller) * self._rng.uniform(*_OCTAVES, count)
        return [2.0**octave for octave in octaves.tolist()]

    def share(self, least: float, most: float) -> float:
        """Between two bounds."""
        return float(self._rng.uniform(least, most))

    def sized(self, value: float, natural: float) -> float:
        """Another number of the same sign, for zero one of the natural size."""
        return self.factor() * value if value else self.share(0.5, 1.0) * natural

    def signed(self, value: float, natural: float) -> float:
        """Another number of either sign."""
        return self.sign() * self.sized(value, natural)


def _varied_body(body: Body, draw: _Draw, reach: float, mass: float) -> Body:
    """A body of the same kind with other numbers; `reach`, in m, and `mass`, in kg, are natural."""
    if isinstance(body, Rod):
        sign = draw.sign()
        length = sign * draw.sized(body.length, reach)
        density = sign * draw.sized(body.mass_per_length, mass / reach)
        natural = max(body.section_inertia) or (body.total_mass or mass) * reach**2
        x, y, z = (draw.sized(i, natural) for i in body.section_inertia)
        return Rod(length, density, (x, y, z))
    natural = max(body.inertia[:3]) or (body.mass or mass) * reach**2
    cx, cy, cz = (draw.signed(value, reach) for value in body.com)
    return RigidBody(
        draw.signed(body.length, reach),
        draw.sized(body.mass, mass),
        (cx, cy, cz),
        _stretched(body.inertia, draw, natural),
    )


def _stretched(inertia: Inertia, draw: _Draw, natural: float) -> Inertia:
    """Inertia of a body that is stretched, or squeezed, by another factor along each axis.

    So no moments stay equal, and none exceeds the sum of the others. Axes change their signs.
    """
    half = 0.5 * sum(inertia[:3])
    # Each moment is the sum of the second moments of mass along the other axes.
    along = [half - moment if half - moment > _FLAT * half else 0.0 for moment in inertia[:3]]
    factors = draw.factors(3)
    spread = [factor * moment for factor, moment in zip(factors, along, strict=True)]
    least = min(filter(None, spread), default=natural)
    x, y, z = (moment or draw.share(*_SMALL) * least for moment in spread)
    # What is diagonally dominant is positive definite.
    least, roots = min(x, y, z), [draw.sign() * factor**0.5 for factor in factors]
    xy, xz, yz = (
        roots[i] * roots[j] * product or draw.sign() * draw.share(*_SMALL) * least
        for (i, j), product in zip(((0, 1), (0, 2), (1, 2)), inertia[3:], strict=True)
    )
    return y + z, x + z, x + y, xy, xz, yz
