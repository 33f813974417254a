"""A formulation that computes in units of the robot's own size.

Libraries have numbers of their own that are no part of mechanics: Pinocchio adds 2e-16 kg to the
mass it divides by, and MuJoCo takes a body below 1e-15 kg or kg m² for massless. So they are given
the robot with lengths and times of the order of 1 and no mass below that, and their results are
converted back. The units are powers of two, so that no number loses a digit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.formulation import Formulation, Quantities
from gibbs_codegen.verification.free_base import formulated
from gibbs_codegen.verification.parameters import in_units
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree


class InOwnUnits:
    """A formulation (see `formulation`) of the robot in its own units."""

    def __init__(self, kind: Callable[[Tree], Formulation], robot: Robot) -> None:
        self.tree = Tree(robot)
        self._length = _power_of_two(self.tree.reach)
        self._mass = _power_of_two(_lightest(self.tree))
        self._time = _power_of_two(1.0 / self.tree.tempo)
        inner = formulated(kind(Tree(in_units(robot, self._length, self._mass, self._time))))
        self.name, self.limit, self.growth = inner.name, inner.limit, inner.growth
        self._inner = inner

    def at(self, states: States) -> Quantities:
        """What the formulation computes, from and to SI units."""
        units = np.where(self.tree.turns, 1.0, self._length)
        free, time = units[self.tree.free], self._time
        lengths = np.array([unit == "m" for unit in self.tree.layout.q.units])
        q = states.q / np.where(lengths, self._length, 1.0)
        v, a = states.v / free * time, states.a / free * time**2
        energy = self._mass * (self._length / time) ** 2
        twist, wrench = np.repeat([[self._length, 1.0], [1.0, self._length]], 3, axis=-1)
        wrench = energy / self._length * wrench
        efforts = energy / units[self.tree.arm]
        thrusts = np.full(len(self.tree.motors), energy / self._length)
        u = states.u / np.concatenate([thrusts, efforts])
        found = self._inner.at(States(q, v, a, u, states.W / wrench))
        found.poses[..., :3, 3] *= self._length
        scales = {
            "mass_matrix": energy * time**2 / np.outer(units, units),
            "residual": energy / units,
            "inverse_dynamics": energy / units,
            "jacobians": twist[:, None] / units,
            "kinetic_energy": energy,
            "potential_energy": energy,
            "positions": self._length,
            "bias_accelerations": twist / time**2,
            "centre_of_mass": self._length,
            "centre_jacobian": self._length / units,
            "momentum": wrench * time,
            "gravity_forces": energy / units,
            "joint_wrenches": wrench,
        }
        given = {name: getattr(found, name) for name in scales}
        return found._replace(**{n: x * scales[n] for n, x in given.items() if x is not None})


def _lightest(tree: Tree) -> float:
    """The smallest mass, or moment of inertia over the square of the reach, but zero."""
    masses = np.array([joint.mass for joint in tree.joints])
    moments = np.array([np.diagonal(joint.inertia) for joint in tree.joints]) / tree.reach**2
    every = np.concatenate([masses, moments.ravel()])
    return float(every[every > 0.0].min())


def _power_of_two(value: float) -> float:
    return float(2.0 ** np.round(np.log2(value)))
