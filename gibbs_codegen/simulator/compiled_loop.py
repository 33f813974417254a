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
from numpy.typing import NDArray

from gibbs_codegen.runtime.c_library import NATIVE
from gibbs_codegen.runtime.cache import CacheError, cached_library
from gibbs_codegen.runtime.compiler import Compiler, CompilerError, find_compiler
from gibbs_codegen.scenario.attitude import LARGEST_THETA_0
from gibbs_codegen.simulator.closed_loop import ClosedLoop

Array = NDArray[np.float64]

_log = logging.getLogger("gibbs_codegen")
_POINTER = ctypes.c_void_p
# As numbered in `native/rk4.c`.
_LAWS = ("computed_torque", "open_loop", "off")


class _Loop(ctypes.Structure):
    """`Loop` of `native/rk4.c`, field by field."""

    _fields_ = (
        ("forward_dynamics", _POINTER),
        ("inverse_dynamics", _POINTER),
        ("input_matrix", _POINTER),
        ("mass_matrix", _POINTER),
        ("tip_jacobian", _POINTER),
        ("constants", ctypes.c_char_p),
        ("coordinates", ctypes.c_ssize_t),
        ("rotors", ctypes.c_ssize_t),
        ("attitude", ctypes.c_ssize_t),
        ("joints", ctypes.c_ssize_t),
        ("position", ctypes.c_ssize_t),
        ("middle_angle", ctypes.c_ssize_t),
        ("pieces", ctypes.c_ssize_t),
        ("law", ctypes.c_int),
        ("limited", ctypes.c_int),
        ("pushed", ctypes.c_int),
        ("least", ctypes.c_double),
        ("most", ctypes.c_double),
        ("lag", ctypes.c_double),
        ("push", ctypes.c_double * 3),
        ("bounds", _POINTER),
        ("largest_theta_0", ctypes.c_double),
        ("begin", ctypes.c_double),
        ("piece", ctypes.c_double),
        ("coefficients", _POINTER),
        ("stiffness", _POINTER),
        ("damping", _POINTER),
        ("distribution", _POINTER),
        ("scratch", _POINTER),
    )


@dataclass(frozen=True)
class CompiledLoop:
    """Steps of one closed loop, of one size, in compiled code.

    Steps whose thrusts meet a limit are not among them: the nearest wrench within limits is a
    search, which Python does.
    """

    function: Any
    structure: _Loop
    step: float
    size: int
    # What the structure points to, so that it lives as long.
    arrays: tuple[Any, ...]

    @classmethod
    def of(
        cls, closed: ClosedLoop, step: float, bounds: Array, pushed: bool = False
    ) -> CompiledLoop | None:
        """Steps of `step` s, or None where the module is not compiled or the loop cannot be.

        They end where coordinates and rates are farther off than `bounds` (2 nq); `pushed` tells
        whether the force on the tip acts. Nor is there one that controls by rotors that do not
        command all directions: Python checks every wrench of those.
        """
        vehicle, controller = closed.vehicle, closed.controller
        library_file = Path(vehicle.module.__file__ or "")
        if library_file.suffix != ".so":
            return None
        if controller.allocation.missing and controller.law != "off":
            return None
        try:
            rk4 = _rk4(find_compiler(os.environ.get("CC") or None))
        except (CompilerError, CacheError) as error:
            _log.warning("steps are taken in Python instead of C: %s", error)
            return None
        library = ctypes.CDLL(str(library_file))
        count = len(vehicle.coordinates)
        gains = controller.gains
        reference = controller.reference
        constants = vehicle.constants or vehicle.module.prepare({})
        coefficients = np.ascontiguousarray(reference.coefficients)
        distribution = np.ascontiguousarray(controller.allocation.inverse)
        stiffness = np.array(gains.stiffness)
        damping = np.array(gains.damping)
        bounds = np.array(bounds)

        def address(name: str) -> int | None:
            return ctypes.cast(library[f"{vehicle.name}_{name}"], _POINTER).value

        push = closed.tip_force.force if pushed and closed.tip_force else (0.0, 0.0, 0.0)
        structure = _Loop(
            forward_dynamics=address("forward_dynamics"),
            inverse_dynamics=address("inverse_dynamics"),
            input_matrix=address("input_matrix"),
            mass_matrix=address("mass_matrix"),
            tip_jacobian=address("tip_jacobian"),
            constants=constants,
            coordinates=count,
            rotors=vehicle.rotors,
            attitude=vehicle.layout.attitude.start,
            joints=vehicle.layout.joints.start,
            position=vehicle.layout.position.start,
            middle_angle=vehicle.layout.middle_angle,
            pieces=len(coefficients),
            law=_LAWS.index(controller.law),
            limited=closed.limits is not None,
            pushed=any(push),
            least=closed.limits[0] if closed.limits else 0.0,
            most=closed.limits[1] if closed.limits else 0.0,
            lag=closed.lag,
            push=push,
            bounds=bounds.ctypes.data,
            largest_theta_0=LARGEST_THETA_0,
            begin=reference.begin,
            piece=reference.step,
            coefficients=coefficients.ctypes.data,
            stiffness=stiffness.ctypes.data,
            damping=damping.ctypes.data,
            distribution=distribution.ctypes.data,
        )
        scratch = np.zeros(rk4.gibbs_codegen_rk4_room(ctypes.byref(structure)))
        structure.scratch = scratch.ctypes.data
        given = (library, constants, bounds, coefficients, stiffness, damping, distribution)
        return cls(rk4.gibbs_codegen_rk4, structure, step, closed.size, (*given, scratch))

    def __call__(
        self, time: float, state: Array, count: int, every: int, number: int
    ) -> tuple[int, Array, Array]:
        """Take up to `count` steps from a state; every `every`-th, counted from `number`, is kept.

        Returns the steps taken, the samples (s, size) and the last state. Fewer steps are taken
        where a thrust meets a limit in the next one, or where the flight cannot go on.
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
