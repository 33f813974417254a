"""What C knows of a closed loop: `Loop` of `native/loop.h`, part by part, and what fills it.

Each part is a structure, and a function that tells its values by the names of its fields: numbers,
and arrays for fields that are pointers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gibbs_codegen.scenario.attitude import LARGEST_THETA_0
from gibbs_codegen.simulator.control.geometric import GeometricLaw
from gibbs_codegen.simulator.integration.acting import Acting
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.integration.environment_part import (
    EnvironmentPart,
    environment_values,
)
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle

POINTER = ctypes.c_void_p
_SIZE, _NUMBER, _FLAG = ctypes.c_ssize_t, ctypes.c_double, ctypes.c_int
# Functions of a module, in the order of `Functions`.
FUNCTIONS = (
    "forward_dynamics",
    "inverse_dynamics",
    "input_matrix",
    "forward_dynamics_with_wrenches",
    "wrench_forces",
    "frame_poses",
    "frame_jacobians",
    "frame_velocities",
    "frame_bias_accelerations",
    "centre_of_mass",
    "centre_of_mass_jacobian",
)
# As numbered in `native/loop.h`; "held" is for inputs that are held through an interval.
LAWS = ("computed_torque", "open_loop", "off", "held", "geometric")

Values = Mapping[str, Any]


class _Functions(ctypes.Structure):
    _fields_ = tuple((name, POINTER) for name in FUNCTIONS)


class _Layout(ctypes.Structure):
    _fields_ = (
        *((name, _SIZE) for name in ("coordinates", "velocities", "rotors", "memory")),
        *((name, _SIZE) for name in ("attitude", "joints", "position")),
        ("axes", _SIZE * 3),
        *((name, _SIZE) for name in ("middle_angle", "quaternion", "placed")),
    )


def _layout(closed: ClosedLoop, acting: Acting) -> Values:
    layout = closed.vehicle.layout
    turned = () if layout.is_quaternion else map("xyz".index, closed.vehicle.attitude)
    return {
        "coordinates": layout.q.size,
        "velocities": layout.v.size,
        "rotors": closed.vehicle.rotors,
        "memory": closed.controller.memory,
        "attitude": layout.v.attitude.start,
        "joints": layout.v.joints.start,
        "position": layout.v.position.start,
        "axes": (_SIZE * 3)(*turned),
        "middle_angle": -1 if layout.is_quaternion else layout.middle_angle,
        "quaternion": layout.q.attitude.start,
        "placed": layout.q.position.start,
    }


class _Desired(ctypes.Structure):
    _fields_ = (
        *(("pieces", _SIZE), ("begin", _NUMBER), ("piece", _NUMBER)),
        ("coefficients", POINTER),
    )


def _desired(closed: ClosedLoop, acting: Acting) -> Values:
    reference = closed.controller.reference
    return {
        "pieces": len(reference.coefficients),
        "begin": reference.begin,
        "piece": reference.step,
        "coefficients": reference.coefficients,
    }


class _Centre(ctypes.Structure):
    _fields_ = (("mass", _NUMBER), ("weight", POINTER), ("coefficients", POINTER))


def _centre(closed: ClosedLoop, acting: Acting) -> Values:
    law = closed.controller
    if not isinstance(law, GeometricLaw):
        return {}
    return {"mass": law.mass, "weight": law.weight, "coefficients": law.centre.coefficients}


class _Gains(ctypes.Structure):
    _fields_ = (("stiffness", POINTER), ("damping", POINTER), ("integral", _NUMBER))


def _gains(closed: ClosedLoop, acting: Acting) -> Values:
    gains = closed.controller.gains
    names = ("stiffness", "damping", "integral")
    return {name: getattr(gains, name) for name in names}


class _Rotors(ctypes.Structure):
    _fields_ = (("move", _FLAG), ("centre", POINTER), ("wrenches", POINTER))


def _rotors(vehicle: Vehicle) -> Values:
    return {
        "move": vehicle.rotors_move,
        "centre": vehicle.centre_offset(vehicle.neutral),
        "wrenches": vehicle.thrust_wrenches().T,
    }


class _Sharing(ctypes.Structure):
    _fields_ = (
        *(("limited", _FLAG), ("refuses", _FLAG), ("distribution", POINTER)),
        *(("least", POINTER), ("most", POINTER)),
    )


def _sharing(closed: ClosedLoop, acting: Acting) -> Values:
    allocation, count = closed.controller.allocation, closed.vehicle.rotors
    limits = (-np.inf, np.inf) if allocation.limits is None else allocation.limits
    least, most = (np.broadcast_to(each, count) for each in limits)
    return {
        "limited": allocation.limits is not None,
        "refuses": allocation.refuses and (bool(allocation.missing) or closed.vehicle.rotors_move),
        "distribution": allocation.inverse,
        "least": least,
        "most": most,
    }


class _Actuators(ctypes.Structure):
    _fields_ = (
        *(("limited", _FLAG), ("lags", _FLAG), ("compensates", _FLAG)),
        *(("least", POINTER), ("most", POINTER), ("lag", POINTER)),
    )


def _actuators(closed: ClosedLoop, acting: Acting) -> Values:
    least, most = closed.actuators.inputs
    return {
        "limited": closed.limited,
        "lags": closed.lags,
        "compensates": closed.compensates,
        "least": least,
        "most": most,
        "lag": closed.actuators.lag,
    }


class _Envelope(ctypes.Structure):
    _fields_ = (("bounds", POINTER), ("largest_theta_0", _NUMBER))


# Parts of `Loop` in its order, and what fills them.
_PARTS: tuple[tuple[str, Any, Callable[[ClosedLoop, Acting], Values]], ...] = (
    ("layout", _Layout, _layout),
    ("desired", _Desired, _desired),
    ("centre", _Centre, _centre),
    ("gains", _Gains, _gains),
    ("flown", _Rotors, lambda closed, acting: _rotors(closed.vehicle)),
    ("known", _Rotors, lambda closed, acting: _rotors(closed.controller.vehicle)),
    ("sharing", _Sharing, _sharing),
    ("actuators", _Actuators, _actuators),
    ("environment", EnvironmentPart, environment_values),
)


class Loop(ctypes.Structure):
    """`Loop` of `native/loop.h`."""

    _fields_ = (
        *(("functions", _Functions), ("plant", ctypes.c_char_p), ("model", ctypes.c_char_p)),
        ("losses", POINTER),
        *((name, kind) for name, kind, _ in _PARTS),
        *(("envelope", _Envelope), ("law", _FLAG), ("held", POINTER), ("scratch", POINTER)),
    )


def filled(
    closed: ClosedLoop, bounds: Array | float, acting: Acting, library: ctypes.CDLL
) -> tuple[Loop, list[Any]]:
    """The structure of a closed loop, but for its law, the inputs that are held, and its scratch.

    Args:
        closed: The closed loop.
        bounds: Errors, then their rates (2 nv), beyond which control is lost, or one number.
        acting: What acts on the robot.
        library: The compiled module of the robot.

    Returns:
        The structure, and what it points to, which must live as long.
    """
    vehicle, model = closed.vehicle, closed.controller.vehicle
    loop = Loop()
    owned: list[Any] = [library]
    for name in FUNCTIONS:
        address = ctypes.cast(library[f"{vehicle.name}_{name}"], POINTER).value
        setattr(loop.functions, name, address)
    defaults = vehicle.module.prepare({})
    loop.plant, loop.model = (each.constants or defaults for each in (vehicle, model))
    for name, _, values in _PARTS:
        owned += _put(getattr(loop, name), values(closed, acting))
    owned += _put(loop, {"losses": vehicle.damping})
    limits = np.full(2 * vehicle.layout.v.size, bounds, dtype=np.float64)
    owned += _put(loop.envelope, {"bounds": limits, "largest_theta_0": LARGEST_THETA_0})
    return loop, owned


def _put(part: ctypes.Structure, values: Values) -> list[Array]:
    """Put values into a part of the structure; returns the arrays that it points to."""
    owned = []
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            owned.append(np.ascontiguousarray(value, dtype=np.float64))
            value = owned[-1].ctypes.data
        setattr(part, name, value)
    return owned
