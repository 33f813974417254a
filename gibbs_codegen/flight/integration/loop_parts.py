"""What C knows of a closed loop: `Loop` of `native/loop.h`, part by part, and what fills it.

Each part is a structure, and a function that tells its values by the names of its fields: numbers,
and arrays for fields that are pointers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.control.geometric import GeometricLaw
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.state_history import NOTHING, Acting
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.scenario.orientation import LARGEST_THETA_0

_POINTER, _COUNT = ctypes.c_void_p, ctypes.c_ssize_t
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
# Numbers that differ from state to state in a block, by their part ("" for `Loop` itself), and the
# axes that they have for one state.
NUMBERS: Mapping[tuple[str, str], int] = {
    **{("centre", name): axes for name, axes in (("mass", 0), ("weight", 1), ("coefficients", 3))},
    **{("gains", name): axes for name, axes in (("stiffness", 1), ("damping", 1), ("integral", 0))},
    **{(part, "centre"): 1 for part in ("flown", "known")},
    **{(part, "wrenches"): 2 for part in ("flown", "known")},
    **{("sharing", name): axes for name, axes in (("distribution", 2), ("least", 1), ("most", 1))},
    **{("actuators", name): 1 for name in ("least", "most", "lag", "pace")},
    **{("environment", "gravity"): 0, ("envelope", "bounds"): 1},
    **{("", "losses"): 1, ("", "held"): 1},
}


class EnvironmentPart(ctypes.Structure):
    """`Environment` of `native/loop.h`."""

    _fields_ = (
        *(("frames", _COUNT), ("push", _POINTER), ("coefficients", _POINTER), ("wind", _POINTER)),
        *(("gusts", _COUNT), ("gust", _POINTER), ("walls", _COUNT), ("wall", _POINTER)),
        *(("spins", _COUNT), ("spin", _POINTER), ("payloads", _COUNT), ("payload", _POINTER)),
        ("gravity", _POINTER),
    )


def environment_values(closed: ClosedLoop, acting: Acting) -> dict[str, Any]:
    """Values of the part by names of its fields, while something acts; none where nothing does."""
    environment = closed.environment
    if environment is None:
        return {}
    walls, payloads = environment.walls, environment.payloads
    there = np.flatnonzero(np.logical_and(acting.payloads, payloads.masses > 0.0))
    if not (acting.push or environment.drag or len(walls.places) or environment.spin or len(there)):
        return {}
    values: dict[str, Any] = {
        "frames": len(closed.vehicle.frames),
        "push": np.where(acting.push, environment.pushing, 0.0),
        "walls": len(walls.places),
        "wall": _rows(walls.places, walls.points, walls.normals, walls.stiffness, walls.damping),
        "payloads": len(there),
        "payload": _rows(payloads.places[there], payloads.masses[there]),
        "gravity": payloads.gravity[..., 2],
    }
    if (drag := environment.drag) is not None:
        values |= {"coefficients": drag.coefficients, "wind": drag.velocity}
        values |= {"gusts": len(drag.gusts), "gust": drag.gusts}
    if (spin := environment.spin) is not None:
        values |= {"spins": len(spin.rotors)}
        values |= {"spin": _rows(spin.rotors, spin.places, spin.axes, spin.spins)}
    return values


def _rows(*columns: NDArray[Any]) -> Array:
    """A row of numbers for each of k things, of which every column has a number (k) or three."""
    return np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])


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


def layout_text(closed: ClosedLoop) -> str:
    """The layout of a closed loop as C initialises it."""
    values = [*_layout(closed, NOTHING).values()]
    texts = (str(x) if isinstance(x, int) else "{" + ",".join(map(str, x)) + "}" for x in values)
    return "{" + ",".join(texts) + "}"


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
    _fields_ = (("mass", POINTER), ("weight", POINTER), ("coefficients", POINTER))


def _centre(closed: ClosedLoop, acting: Acting) -> Values:
    law = closed.controller
    if not isinstance(law, GeometricLaw):
        return {}
    return {"mass": law.mass, "weight": law.weight, "coefficients": law.centre.coefficients}


class _Gains(ctypes.Structure):
    _fields_ = (("stiffness", POINTER), ("damping", POINTER), ("integral", POINTER))


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
        "wrenches": np.swapaxes(vehicle.thrust_wrenches(), -1, -2),
    }


class _Sharing(ctypes.Structure):
    _fields_ = (
        *(("limited", _FLAG), ("refuses", _FLAG), ("distribution", POINTER)),
        *(("least", POINTER), ("most", POINTER)),
    )


def _sharing(closed: ClosedLoop, acting: Acting) -> Values:
    allocation, count = closed.controller.allocation, closed.vehicle.rotors
    limits = np.array((-np.inf, np.inf) if allocation.limits is None else allocation.limits)
    limits = limits[:, np.newaxis] if limits.ndim == 1 else limits
    limits = np.broadcast_to(limits, (*limits.shape[:-1], count))
    return {
        "limited": allocation.limits is not None,
        "refuses": allocation.refuses and (bool(allocation.missing) or closed.vehicle.rotors_move),
        "distribution": allocation.inverse,
        "least": limits[..., 0, :],
        "most": limits[..., 1, :],
    }


class _Actuators(ctypes.Structure):
    _fields_ = (
        *(("limited", _FLAG), ("lags", _FLAG), ("compensates", _FLAG)),
        *(("least", POINTER), ("most", POINTER), ("lag", POINTER), ("pace", POINTER)),
    )


def _actuators(closed: ClosedLoop, acting: Acting) -> Values:
    limits, lag = closed.actuators.inputs, closed.actuators.lag
    return {
        "limited": closed.limited,
        "lags": closed.lags,
        "compensates": closed.compensates,
        "least": limits[..., 0, :],
        "most": limits[..., 1, :],
        "lag": lag,
        "pace": np.divide(1.0, lag, out=np.zeros(lag.shape), where=lag > 0.0),
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
        *(("envelope", _Envelope), ("law", _FLAG)),
        *((name, POINTER) for name in ("held", "guesses", "scratch")),
    )


def values_of(
    closed: ClosedLoop, bounds: Array | float, acting: Acting
) -> Iterator[tuple[str, str, Any]]:
    """What C knows of a closed loop, but for functions, constants, and room to compute in.

    Part ("" for `Loop` itself) and name of each field, and its value. `bounds` of errors, then
    their rates, are (2 nv) or one number.
    """
    limits = np.broadcast_to(bounds, (*np.shape(bounds)[:-1], 2 * closed.vehicle.layout.v.size))
    law = closed.controller.law if acting.held is None else "held"
    held = np.zeros(len(closed.vehicle.inputs)) if acting.held is None else np.array(acting.held)
    whole = {
        **{name: values(closed, acting) for name, _, values in _PARTS},
        "envelope": {"bounds": limits, "largest_theta_0": LARGEST_THETA_0},
        "": {"losses": closed.vehicle.damping, "law": LAWS.index(law), "held": held},
    }
    for part, values in whole.items():
        for name, value in values.items():
            yield part, name, value


def addresses(library: ctypes.CDLL, name: str, ending: str = "") -> list[int]:
    """Addresses of a compiled module's functions, in the order of `Functions`.

    `name` is the robot's; those of the functions end with `ending`.
    """
    found = (library[f"{name}_{function}{ending}"] for function in FUNCTIONS)
    return [ctypes.cast(function, POINTER).value or 0 for function in found]


def filled(
    closed: ClosedLoop, bounds: Array | float, acting: Acting, library: ctypes.CDLL
) -> tuple[Loop, dict[tuple[str, str], Array]]:
    """The structure of a closed loop, but for its room to compute in, and what it points to.

    These arrays, by part and name, and the library must live as long.
    """
    vehicle, model = closed.vehicle, closed.controller.vehicle
    loop, arrays = Loop(), {}
    loop.functions = _Functions(*addresses(library, vehicle.name))
    defaults = vehicle.module.prepare({})
    loop.plant, loop.model = (each.constants or defaults for each in (vehicle, model))
    for part, name, value in values_of(closed, bounds, acting):
        if isinstance(value, np.ndarray) or (part, name) in NUMBERS:
            array = np.ascontiguousarray(value, dtype=np.float64)
            arrays[part, name] = array
            value = array.ctypes.data
        setattr(getattr(loop, part) if part else loop, name, value)
    return loop, arrays
