"""The fixed-step loop compiled from C: one call takes many steps of a controlled flight.

`native/rk4.c` is compiled once for all robots; it is given the addresses of the functions in the
compiled library of a module.
"""

from __future__ import annotations

import ctypes
import functools
import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.runtime.cache import CacheError, cached_library
from gibbs_codegen.runtime.compiler import Compiler, CompilerError, find_compiler
from gibbs_codegen.scenario.attitude import LARGEST_THETA_0
from gibbs_codegen.simulator.integration.acting import NOTHING, Acting
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.plant.vehicle import Array

_log = logging.getLogger("gibbs_codegen")
# Where the C of the simulator is.
NATIVE = Path(__file__).parent.parent / "native"
_POINTER = ctypes.c_void_p
_FUNCTIONS = (
    "forward_dynamics",
    "inverse_dynamics",
    "input_matrix",
    "forward_dynamics_with_wrenches",
    "wrench_forces",
)
# As numbered in `native/rk4.c`.
_LAWS = ("computed_torque", "open_loop", "off")


class _Loop(ctypes.Structure):
    """`Loop` of `native/rk4.c`, field by field."""

    _fields_ = (
        *((name, _POINTER) for name in _FUNCTIONS),
        ("constants", ctypes.c_char_p),
        ("coordinates", ctypes.c_ssize_t),
        ("velocities", ctypes.c_ssize_t),
        ("rotors", ctypes.c_ssize_t),
        ("attitude", ctypes.c_ssize_t),
        ("joints", ctypes.c_ssize_t),
        ("position", ctypes.c_ssize_t),
        ("middle_angle", ctypes.c_ssize_t),
        ("quaternion", ctypes.c_ssize_t),
        ("placed", ctypes.c_ssize_t),
        ("pieces", ctypes.c_ssize_t),
        ("law", ctypes.c_int),
        ("limited", ctypes.c_int),
        ("lags", ctypes.c_int),
        ("least", _POINTER),
        ("most", _POINTER),
        ("lag", _POINTER),
        ("wrenches", _POINTER),
        ("bounds", _POINTER),
        ("largest_theta_0", ctypes.c_double),
        ("begin", ctypes.c_double),
        ("piece", ctypes.c_double),
        ("coefficients", _POINTER),
        ("stiffness", _POINTER),
        ("damping", _POINTER),
        ("losses", _POINTER),
        ("distribution", _POINTER),
        ("scratch", _POINTER),
    )


@dataclass(frozen=True)
class CompiledLoop:
    """Steps of one closed loop, of one size, in compiled code.

    Steps in which an input is saturated are not among them: the nearest wrench within limits is a
    search, which Python does.
    """

    function: Any
    structure: _Loop
    step: float
    size: int
    # What the structure points to, so that it lives as long.
    owned: tuple[Any, ...]

    @classmethod
    def of(
        cls, closed: ClosedLoop, step: float, bounds: Array | float, acting: Acting = NOTHING
    ) -> CompiledLoop | None:
        """The compiled loop of a closed loop, if there is one.

        Args:
            closed: The closed loop.
            step: Size of the steps, s.
            bounds: Errors, then their rates (2 nv), beyond which control is lost; one number
                serves for all.
            acting: What acts on the robot.

        Returns:
            The loop; None where the module or the loop is not compiled, and under control by
            rotors that do not command all directions, since Python checks every wrench of those,
            or by rotors that joints move, for which Python finds another allocation every time.
        """
        vehicle, controller = closed.vehicle, closed.controller
        library_file = Path(vehicle.module.__file__ or "")
        if library_file.suffix != ".so":
            return None
        if controller.law != "off" and (controller.allocation.missing or vehicle.rotors_move):
            return None
        try:
            rk4 = _rk4(find_compiler(os.environ.get("CC") or None))
        except (CompilerError, CacheError) as error:
            _log.warning("steps are taken in Python instead of C: %s", error)
            return None
        library = ctypes.CDLL(str(library_file))
        constants = vehicle.constants or vehicle.module.prepare({})
        arrays = _arrays(closed, bounds, acting)
        structure = _Loop(
            **{
                name: ctypes.cast(library[f"{vehicle.name}_{name}"], _POINTER).value
                for name in _FUNCTIONS
            },
            **_settings(closed),
            **{name: array.ctypes.data for name, array in arrays.items()},
            constants=constants,
        )
        scratch = np.zeros(rk4.gibbs_codegen_rk4_room(ctypes.byref(structure)))
        structure.scratch = scratch.ctypes.data
        owned = (library, constants, arrays, scratch)
        return cls(rk4.gibbs_codegen_rk4, structure, step, closed.size, owned)

    def __call__(
        self, time: float, state: Array, count: int, every: int, number: int
    ) -> tuple[int, Array, Array]:
        """Take steps, fewer where an input would be saturated or the flight cannot go on.

        Args:
            time: Time before the first step, s.
            state: State (size) before the first step.
            count: Greatest number of steps.
            every: Each `every`-th step is a sample, counted from `number`.
            number: Number of steps before the first.

        Returns:
            The number of steps taken, the samples (s, size), and the last state (size).
        """
        last = np.array(state, dtype=np.float64)
        samples = np.empty((count // every + 1, self.size))
        taken = self.function(
            ctypes.byref(self.structure),
            time,
            self.step,
            count,
            every,
            number,
            last.ctypes.data,
            samples.ctypes.data,
        )
        kept = (number + taken) // every - number // every
        return taken, samples[:kept], last


def _arrays(closed: ClosedLoop, bounds: Array | float, acting: Acting) -> dict[str, Array]:
    """What fields of `_Loop` point to.

    Args:
        closed: The closed loop.
        bounds: Errors, then their rates (2 nv), beyond which control is lost, or one number.
        acting: What acts on the robot.

    Returns:
        The arrays, by the names of the fields.
    """
    vehicle, controller = closed.vehicle, closed.controller
    least, most = closed.actuators.inputs
    return {
        "least": least,
        "most": most,
        "lag": closed.actuators.lag,
        "bounds": np.full(2 * vehicle.layout.v.size, bounds, dtype=np.float64),
        "coefficients": np.ascontiguousarray(controller.reference.coefficients),
        "stiffness": np.array(controller.gains.stiffness),
        "damping": np.array(controller.gains.damping),
        "losses": vehicle.damping,
        "distribution": np.ascontiguousarray(controller.allocation.inverse),
        **({"wrenches": closed.environment.pushing} if acting.push and closed.environment else {}),
    }


def _settings(closed: ClosedLoop) -> dict[str, Any]:
    """Values of the fields of `_Loop` that are plain numbers."""
    controller, layout = closed.controller, closed.vehicle.layout
    reference = controller.reference
    return {
        "coordinates": layout.q.size,
        "velocities": layout.v.size,
        "rotors": closed.vehicle.rotors,
        "attitude": layout.v.attitude.start,
        "joints": layout.v.joints.start,
        "position": layout.v.position.start,
        "middle_angle": -1 if layout.is_quaternion else layout.middle_angle,
        "quaternion": layout.q.attitude.start,
        "placed": layout.q.position.start,
        "pieces": len(reference.coefficients),
        "law": _LAWS.index(controller.law),
        "limited": closed.limited,
        "lags": closed.lags,
        "largest_theta_0": LARGEST_THETA_0,
        "begin": reference.begin,
        "piece": reference.step,
    }


@functools.cache
def _rk4(compiler: Compiler) -> ctypes.CDLL:
    """`native/rk4.c`, compiled. Raises `CompilerError` or `CacheError`."""
    source = NATIVE / "rk4.c"

    def make(output: Path) -> None:
        compiler.library([source], output)

    key = "\n".join([compiler.identity, "rk4", source.read_text(encoding="utf-8")])
    library = ctypes.CDLL(str(cached_library(key, make)))
    real, size = ctypes.c_double, ctypes.c_ssize_t
    library.gibbs_codegen_rk4_room.argtypes = [_POINTER]
    library.gibbs_codegen_rk4_room.restype = size
    library.gibbs_codegen_rk4.argtypes = [
        *(_POINTER, real, real),
        *(size, size, size),
        *(_POINTER, _POINTER),
    ]
    library.gibbs_codegen_rk4.restype = size
    return library
