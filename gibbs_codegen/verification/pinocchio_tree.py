"""The tree in Pinocchio, where that is installed: composite bodies, Newton–Euler, Jacobians."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from gibbs_codegen.verification.formulation import Quantities, state_by_state
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import WORLD, Point, Tree
from gibbs_codegen.verification.vectors import Array

_KINDS = {
    True: (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ),
    False: (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ),
}
_WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Pinocchio:
    """A formulation (see `formulation`) by the library of that name."""

    name = "Pinocchio"
    limit = 1e-10
    growth = 1

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self._model = pin.Model()
        self._model.gravity.linear = np.array([0.0, 0.0, -tree.gravity])
        self._ids = {WORLD: 0}
        self._add_carried(WORLD)
        self._data = self._model.createData()
        self._places = np.empty(tree.size, int)
        for number, joint in enumerate(tree.joints):
            self._places[self._model.joints[self._ids[number]].idx_v] = joint.place

    def _add_carried(self, carrier: int) -> None:
        """Add the bodies on a joint, all of one branch before the next, as Pinocchio wants it."""
        for number, joint in enumerate(self.tree.joints):
            if joint.parent != carrier:
                continue
            kind = _KINDS[joint.revolute][joint.axis]()
            placement = pin.SE3(joint.rotation, joint.offset)
            parent, name = self._ids[carrier], f"joint_{number}"
            self._ids[number] = self._model.addJoint(parent, kind, placement, name)
            # By its fields, since the rotor of a motor is taken from its carrier: what is left of
            # a light one is negative, which the constructor refuses.
            inertia = pin.Inertia.Zero()
            inertia.mass, inertia.lever, inertia.inertia = joint.mass, joint.com, joint.inertia
            self._model.appendBodyToJoint(self._ids[number], inertia, pin.SE3.Identity())
            self._add_carried(number)

    def at(self, states: States) -> Quantities:
        """Everything that the formulation computes."""
        return state_by_state(self._at, self.tree, states, self._places)

    def _at(self, q: Array, v: Array, a: Array, rotation: Array, position: Array) -> Quantities:
        """Quantities by Pinocchio for one state, in its order."""
        model, data = self._model, self._data
        model.jointPlacements[1] = pin.SE3(rotation, position)
        matrix = pin.crba(model, data, q).copy()
        inverse = pin.rnea(model, data, q, v, a).copy()
        residual = -pin.nonLinearEffects(model, data, q, v)
        kinetic = pin.computeKineticEnergy(model, data, q, v)
        potential = pin.computePotentialEnergy(model, data, q)
        centre = pin.jacobianCenterOfMass(model, data, q).copy()
        momentum = pin.computeCentroidalMomentum(model, data, q, v).vector.copy()
        gravity = -pin.computeGeneralizedGravity(model, data, q)
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, v, np.zeros_like(a))
        seats = [(self._ids[p.joint], _placed(p)) for p in self.tree.seats]
        jacobians = [pin.getFrameJacobian(model, data, *frame, _WORLD_AXES) for frame in seats]
        bias = [
            pin.getFrameClassicalAcceleration(model, data, *frame, _WORLD_AXES).vector
            for frame in seats[len(self.tree.motors) :]
        ]
        return Quantities(
            mass_matrix=matrix,
            residual=residual,
            inverse_dynamics=inverse,
            poses=np.array([self._pose(seat).homogeneous for seat in self.tree.seats]),
            jacobians=np.array(jacobians),
            kinetic_energy=kinetic,
            potential_energy=potential,
            positions=np.array([self._pose(point).translation for point in self.tree.points]),
            bias_accelerations=np.array(bias),
            centre_of_mass=pin.centerOfMass(model, data, q).copy(),
            centre_jacobian=centre,
            momentum=momentum,
            gravity_forces=gravity,
        )

    def _pose(self, point: Point) -> pin.SE3:
        return self._data.oMi[self._ids[point.joint]] * _placed(point)


def _placed(point: Point) -> pin.SE3:
    """Placement of a point on its joint."""
    return pin.SE3(point.rotation, point.local)
