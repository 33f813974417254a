"""Pinocchio's derivatives in a robot's own velocities, what acts in joints and thrusts included."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from gibbs_codegen.robot.model import Robot
from support.pinocchio_oracle import Array, Oracle


class Derivatives(NamedTuple):
    """Forces or accelerations, and their derivatives by q (in the tangent space), v, and a or u."""

    value: Array
    dq: Array
    dv: Array
    last: Array


class PassiveTerms(NamedTuple):
    """Damping, stiffness and armature at the places of v, and the torques of springs at q."""

    damping: Array
    stiffness: Array
    armature: Array
    springs: Array


class DerivativeOracle(Oracle):
    """A robot's tree without held joints, and the derivatives that Pinocchio gives for it.

    Thrusts are external forces in the frames of their joints, with which they turn. Damping,
    springs and armature, which Pinocchio's derivatives do not have, are added by hand.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, rigid_base=True)

    def inverse_dynamics_derivatives(self, q: Array, v: Array, a: Array) -> Derivatives:
        """Generalised forces M a − R, and their derivatives by q, v and a."""
        state = self.configuration(q), self.spread(v), self.spread(a)
        pin.computeRNEADerivatives(self.model, self.data, *state)
        by_q, by_v = self._rows(self.data.dtau_dq), self._rows(self.data.dtau_dv)
        passive = self.passive_terms(q)
        return Derivatives(
            self.inverse_dynamics(q, v, a),
            by_q + np.diag(passive.stiffness),
            by_v + np.diag(passive.damping),
            self.mass_matrix(q),
        )

    def forward_dynamics_derivatives(self, q: Array, v: Array, u: Array) -> Derivatives:
        """Accelerations, and their derivatives by q, v and u.

        Armature J makes Pinocchio's accelerations those under forces less J a, which depend on all
        that a depends on: derivatives are multiplied by (1 + M⁻¹ J)⁻¹.
        """
        passive, inputs = self.passive_terms(q), self.input_matrix(q)
        residual = -self.inverse_dynamics(q, v, np.zeros_like(v))
        acceleration = np.linalg.solve(self.mass_matrix(q), residual + inputs @ u)
        torques = np.zeros_like(v)
        torques[self.layout.v.joint_places] = u[len(self.rotors) :]
        torques -= passive.springs + passive.damping * v + passive.armature * acceleration
        state = self.configuration(q), self.spread(v), self.spread(torques)
        pin.computeABADerivatives(self.model, self.data, *state, self._thrusts(u))
        by_q, by_v = self._rows(self.data.ddq_dq), self._rows(self.data.ddq_dv)
        inverse = self._rows(self.data.Minv)
        back = np.linalg.inv(np.eye(len(v)) + inverse * passive.armature)
        return Derivatives(
            self.data.ddq[self.order],
            back @ (by_q - inverse * passive.stiffness),
            back @ (by_v - inverse * passive.damping),
            back @ inverse @ inputs,
        )

    def derivatives_by_forces(self, q: Array, v: Array, forces: Array) -> Derivatives:
        """The same under generalised forces, which stay as they are while q changes.

        The last derivative is by the forces. What acts in joints is left out.
        """
        state = self.configuration(q), self.spread(v), self.spread(forces)
        pin.computeABADerivatives(self.model, self.data, *state)
        found = (self._rows(x) for x in (self.data.ddq_dq, self.data.ddq_dv, self.data.Minv))
        return Derivatives(self.data.ddq[self.order], *found)

    def coriolis_matrix(self, q: Array, v: Array) -> tuple[Array]:
        """C with C v the centrifugal and Coriolis forces, and Ṁ − 2C skew."""
        state = self.configuration(q), self.spread(v)
        return (self._rows(pin.computeCoriolisMatrix(self.model, self.data, *state)),)

    def integrate_derivatives(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Derivatives of q (+) v by q and by v, in the tangent space at the result."""
        by_q, by_v = pin.dIntegrate(self.model, self.configuration(q), self.spread(v))
        return self._rows(by_q), self._rows(by_v)

    def _rows(self, matrix: Array) -> Array:
        """A matrix of the tree in the order of v."""
        return matrix[np.ix_(self.order, self.order)].copy()

    def _thrusts(self, u: Array) -> pin.StdVec_Force:
        """Wrench of the thrusts on each joint, in its frame."""
        outside = pin.StdVec_Force()
        outside.extend([pin.Force.Zero() for _ in range(self.model.njoints)])
        for (joint, at), (direction, drag), thrust in zip(
            self.rotors, self.thrusts, u, strict=False
        ):
            along = direction / np.linalg.norm(direction) * thrust
            outside[joint] += at.act(pin.Force(along, drag * along))
        return outside

    def passive_terms(self, q: Array) -> PassiveTerms:
        """What acts in the joints by itself."""
        found = np.zeros((4, len(self.order)))
        angles = q[self.layout.q.joints]
        for (_, place, acts), angle in zip(self._passive, angles, strict=True):
            springs = acts.stiffness * (angle - acts.rest)
            found[:, place] = acts.damping, acts.stiffness, acts.armature, springs
        return PassiveTerms(*found)
