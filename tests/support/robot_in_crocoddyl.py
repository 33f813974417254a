"""Crocoddyl's own model of a robot that ships, from the URDF that is exported of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import crocoddyl
import numpy as np
import pinocchio as pin

from gibbs_codegen.exchange.exporting import export_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.parts.rotor import Rotor


def crocoddyls_own(name: str, armature: bool = True) -> Callable[..., Any]:
    """What makes models of a robot, without dampers, for a state, costs and limits.

    Without armature, if only of zeros, Crocoddyl 3.2.1 calls Pinocchio's ABA, and the base
    accelerates as if nothing weighed.
    """
    robot, _ = read_robot(name)
    tree = pin.buildModelFromXML(export_robot(robot, "urdf")[0], pin.JointModelFreeFlyer())
    rotors = crocoddyl.StdVec_Thruster()
    rotors.extend([_rotor(rotor) for rotor in robot.thrusters])

    def model(_: crocoddyl.StateAbstract, costs: crocoddyl.CostModelSum, limits: Any) -> Any:
        state = crocoddyl.StateMultibody(tree)
        actuation = crocoddyl.ActuationModelFloatingBaseThrusters(state, rotors)
        made = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs)
        if armature:
            made.armature = np.zeros(tree.nv)
        made.u_lb, made.u_ub = limits
        return made

    return model


def _rotor(rotor: Rotor) -> crocoddyl.Thruster:
    along = np.array(rotor.direction)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along / np.linalg.norm(along))
    return crocoddyl.Thruster(pin.SE3(turn.matrix(), np.array(rotor.position)), rotor.drag)
