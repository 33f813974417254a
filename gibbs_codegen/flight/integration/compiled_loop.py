"""The closed loop compiled from C: its derivative, and calls that take many steps of a flight.

`native/rk4.c` is compiled once for all robots; it is given the addresses of the functions in the
compiled library of a module, and `Loop` of `native/loop.h`. Each part of that is a structure, and a
function that tells its values by the names of its fields: numbers, and arrays for fields that are
pointers.
"""

from __future__ import annotations

import ctypes
import functools
import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen import emitted
from gibbs_codegen.flight.control.geometric import GeometricLaw
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.state_history import NOTHING, InputRanges, Loads
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.scenario.orientation import LARGEST_THETA_0
from gibbs_codegen.runtime import c_library
from gibbs_codegen.runtime.cache import CacheError, cached_library

_log = logging.getLogger("gibbs_codegen")
# Where the C of the closed loop is.
NATIVE = Path(__file__).parent.parent / "native"


POINTER, _SIZE = ctypes.c_void_p, ctypes.c_ssize_t
_NUMBER, _FLAG = ctypes.c_double, ctypes.c_int
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
    **{(part, "centre"): 1 for part in ("plant_rotors", "model_rotors")},
    **{(part, "wrenches"): 2 for part in ("plant_rotors", "model_rotors")},
    **{("sharing", name): axes for name, axes in (("distribution", 2), ("least", 1), ("most", 1))},
    **{("actuators", name): 1 for name in ("least", "most", "lag", "pace")},
    **{("environment", "gravity"): 0, ("envelope", "bounds"): 1},
    **{("", "losses"): 1, ("", "held"): 1},
}


class EnvironmentPart(ctypes.Structure):
    """`Environment` of `native/loop.h`."""

    _fields_ = (
        *(("frames", _SIZE), ("push", POINTER), ("coefficients", POINTER), ("wind", POINTER)),
        *(("gusts", _SIZE), ("gust", POINTER), ("walls", _SIZE), ("wall", POINTER)),
        *(("spins", _SIZE), ("spin", POINTER), ("payloads", _SIZE), ("payload", POINTER)),
        ("gravity", POINTER),
    )


def environment_values(closed: ClosedLoop, loads: Loads) -> dict[str, Any]:
    """Values of the part by names of its fields, while something acts; none where nothing does."""
    environment = closed.environment
    if environment is None:
        return {}
    walls, payloads = environment.walls, environment.payloads
    there = np.flatnonzero(np.logical_and(loads.payloads, payloads.masses > 0.0))
    if not (loads.push or environment.drag or len(walls.places) or environment.spin or len(there)):
        return {}
    values: dict[str, Any] = {
        "frames": len(closed.vehicle.frames),
        "push": np.where(loads.push, environment.pushing, 0.0),
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


def _layout(closed: ClosedLoop, loads: Loads) -> Values:
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


def _desired(closed: ClosedLoop, loads: Loads) -> Values:
    reference = closed.controller.reference
    return {
        "pieces": len(reference.coefficients),
        "begin": reference.begin,
        "piece": reference.step,
        "coefficients": reference.coefficients,
    }


class _Centre(ctypes.Structure):
    _fields_ = (("mass", POINTER), ("weight", POINTER), ("coefficients", POINTER))


def _centre(closed: ClosedLoop, loads: Loads) -> Values:
    law = closed.controller
    if not isinstance(law, GeometricLaw):
        return {}
    return {"mass": law.mass, "weight": law.weight, "coefficients": law.centre.coefficients}


class _Gains(ctypes.Structure):
    _fields_ = (("stiffness", POINTER), ("damping", POINTER), ("integral", POINTER))


def _gains(closed: ClosedLoop, loads: Loads) -> Values:
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


def _sharing(closed: ClosedLoop, loads: Loads) -> Values:
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


def _actuators(closed: ClosedLoop, loads: Loads) -> Values:
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
_PARTS: tuple[tuple[str, Any, Callable[[ClosedLoop, Loads], Values]], ...] = (
    ("layout", _Layout, _layout),
    ("desired", _Desired, _desired),
    ("centre", _Centre, _centre),
    ("gains", _Gains, _gains),
    ("plant_rotors", _Rotors, lambda closed, loads: _rotors(closed.vehicle)),
    ("model_rotors", _Rotors, lambda closed, loads: _rotors(closed.controller.vehicle)),
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


def compiled_law(closed: ClosedLoop, loads: Loads) -> int | None:
    """The number of the law in `native/loop.h`; None where module or law is not compiled.

    The geometric law is, for a base with a quaternion.
    """
    vehicle, law = closed.vehicle, closed.controller.law if loads.inputs is None else "held"
    if law == "geometric" and not vehicle.layout.is_quaternion:
        return None
    compiled = Path(vehicle.module.__file__ or "").suffix == ".so" and law in LAWS
    return LAWS.index(law) if compiled else None


def values_of(
    closed: ClosedLoop, bounds: Array | float, loads: Loads
) -> Iterator[tuple[str, str, Any]]:
    """What C knows of a closed loop, but for functions, constants, and room to compute in.

    Part ("" for `Loop` itself) and name of each field, and its value. `bounds` of errors, then
    their rates, are (2 nv) or one number.
    """
    limits = np.broadcast_to(bounds, (*np.shape(bounds)[:-1], 2 * closed.vehicle.layout.v.size))
    inputs = np.zeros(len(closed.vehicle.inputs))
    if loads.inputs is not None:
        inputs[:] = loads.inputs
    whole = {
        **{name: values(closed, loads) for name, _, values in _PARTS},
        "envelope": {"bounds": limits, "largest_theta_0": LARGEST_THETA_0},
        "": {"losses": closed.vehicle.damping, "law": compiled_law(closed, loads), "held": inputs},
    }
    for part, values in whole.items():
        for name, value in values.items():
            yield part, name, value


def addresses(library: c_library.ModuleLibrary, ending: str = "") -> list[int]:
    """Addresses of a compiled module's functions, in the order of `FUNCTIONS`.

    Their names in C end with `ending`. Raises as `ModuleLibrary.function` does.
    """
    library.build(FUNCTIONS)
    found = (library.function(name, ending) for name in FUNCTIONS)
    return [ctypes.cast(function, POINTER).value or 0 for function in found]


@dataclass(frozen=True)
class CompiledLoop:
    """One closed loop in compiled code, while the same acts on the robot.

    Where a wrench is asked for that the rotors cannot produce, Python says so.
    """

    library: ctypes.CDLL
    structure: Loop
    size: int
    # Inputs (nu) that are commanded all through, where they are held.
    inputs: Array
    # What the structure points to, so that it lives as long.
    owned: list[Any]

    @classmethod
    def of(
        cls, closed: ClosedLoop, bounds: Array | float, loads: Loads = NOTHING
    ) -> CompiledLoop | None:
        """The compiled loop of a closed loop; None where module, law or loop is not compiled.

        `bounds` of errors, then their rates, are (2 nv) or one number.
        """
        vehicle, model = closed.vehicle, closed.controller.vehicle
        if compiled_law(closed, loads) is None:
            return None
        try:
            rk4 = compiled_steps(c_library.chosen_compiler())
            functions = addresses(vehicle.module.compiled)
        except (c_library.CompilerError, CacheError) as error:
            _log.warning("steps are taken in Python instead of C: %s", error)
            return None
        structure, arrays = Loop(), dict[tuple[str, str], Array]()
        structure.functions = _Functions(*functions)
        defaults = vehicle.module.prepare({})
        structure.plant, structure.model = (each.constants or defaults for each in (vehicle, model))
        for part, name, value in values_of(closed, bounds, loads):
            if isinstance(value, np.ndarray) or (part, name) in NUMBERS:
                arrays[part, name] = np.ascontiguousarray(value, dtype=np.float64)
                value = arrays[part, name].ctypes.data
            setattr(getattr(structure, part) if part else structure, name, value)
        guesses = np.zeros(vehicle.rotors)
        structure.guesses = guesses.ctypes.data
        scratch = np.empty(rk4.gibbs_codegen_loop_room(ctypes.byref(structure)))
        structure.scratch = scratch.ctypes.data
        owned = [vehicle.module.compiled, arrays, guesses, scratch]
        return cls(rk4, structure, closed.size, arrays["", "held"], owned)

    def __call__(
        self,
        time: float,
        state: Array,
        step: float,
        count: int,
        every: int = 1,
        number: int = 0,
        seen: Callable[[InputRanges], None] | None = None,
    ) -> tuple[int, Array, Array]:
        """Take steps, fewer where rotors cannot produce a wrench or the flight cannot go on.

        Returns how many were taken, samples (s, size), the last state. Each `every`-th step is a
        sample, where `number` steps came before; `seen` is given ranges of the inputs from sample
        to sample.
        """
        last = np.array(state, dtype=np.float64)
        samples = np.empty((count // every + 1, self.size))
        ranges = np.empty((len(samples) + 1, 2, 2, len(self.inputs)))
        ranges[:, :, 0], ranges[:, :, 1] = np.inf, -np.inf
        progress = _Progress(going=1)
        self.library.gibbs_codegen_rk4(
            ctypes.byref(self.structure),
            time,
            step,
            count,
            every,
            number,
            last.ctypes.data,
            samples.ctypes.data,
            ranges.ctypes.data if seen else None,
            ctypes.byref(progress),
        )
        taken = progress.taken
        first = number // every
        if seen:
            # The first stretch may begin after its sample, and the last one end before it.
            stretches = -(-(number + taken) // every) - first
            middle = time + ((first + 0.5 + np.arange(stretches)) * every - number) * step
            inside = np.clip(middle, time + 0.25 * step, time + (taken - 0.25) * step)
            seen(InputRanges(inside, ranges[:stretches]))
        return taken, samples[: (number + taken) // every - first], last

    def rate(self, time: float, state: Array) -> Array | None:
        """Time derivative of a state (size); None where the rotors cannot produce a wrench.

        `ClosedLoop.derivative` says more of that.
        """
        rate, state = np.empty(self.size), np.ascontiguousarray(state, dtype=np.float64)
        going = ctypes.c_int(1)
        self.library.gibbs_codegen_rate(
            ctypes.byref(self.structure),
            time,
            ctypes.byref(going),
            state.ctypes.data,
            rate.ctypes.data,
        )
        return rate if going else None


class CompiledLoops:
    """The compiled loops of a closed loop: one for each of what may act, made when it does."""

    def __init__(self, closed: ClosedLoop, bounds: Array | float) -> None:
        self.closed, self.bounds = closed, bounds
        self._made: dict[tuple[Loads, bool], CompiledLoop | None] = {}

    def at(self, loads: Loads) -> CompiledLoop | None:
        """The compiled loop while something acts; None where there is none (`CompiledLoop.of`).

        For all inputs that are held it is the same loop, which holds those that were given last.
        """
        key = replace(loads, inputs=None), loads.inputs is None
        if key not in self._made:
            self._made[key] = CompiledLoop.of(self.closed, self.bounds, loads)
        loop = self._made[key]
        if loop is not None and loads.inputs is not None:
            loop.inputs[:] = loads.inputs
        return loop

    def derivative(self, loads: Loads) -> Callable[[float, Array], Array]:
        """The time derivative of states while something acts: compiled, where there is a loop."""
        loop = self.at(loads)

        def derivative(time: float, state: Array) -> Array:
            rate = None if loop is None else loop.rate(time, state)
            return self.closed.derivative(time, state, loads) if rate is None else rate

        return derivative


class _Progress(ctypes.Structure):
    """`Progress` of `native/rk4.c`, of one state."""

    _fields_ = (
        *(("going", ctypes.c_int), ("refused", ctypes.c_int)),
        ("taken", ctypes.c_ssize_t),
    )


@functools.cache
def compiled_steps(compiler: c_library.Compiler, *flags: str) -> ctypes.CDLL:
    """`native/rk4.c`, compiled with flags such as LANES and LAYOUT.

    LANES is how many states a number has, LAYOUT that of all robots, if it is the same. Raises
    `CompilerError`, or `CacheError` where the cache of libraries cannot be used.
    """
    source = NATIVE / "rk4.c"
    read = [source, *sorted(NATIVE.glob("*.h")), *sorted(Path(emitted.__path__[0]).glob("*.c"))]
    # Nobody asks what square roots leave in errno; with it they are not taken side by side.
    options = (*flags, "-fno-math-errno")

    def make(output: Path) -> None:
        with c_library.announced(
            "compiling the closed loop; the library is kept for the next time"
        ):
            compiler.library([source], output, options)

    texts = [path.read_text(encoding="utf-8") for path in read]
    library = ctypes.CDLL(
        str(cached_library("\n".join([compiler.identity, *options, *texts]), make))
    )
    real, size = ctypes.c_double, ctypes.c_ssize_t
    library.gibbs_codegen_loop_room.argtypes = [POINTER]
    library.gibbs_codegen_loop_room.restype = size
    library.gibbs_codegen_rk4.argtypes = [
        *(POINTER, real, real),
        *(size, size, size),
        *(POINTER, POINTER, POINTER, POINTER),
    ]
    library.gibbs_codegen_rk4.restype = None
    library.gibbs_codegen_rate.argtypes = [POINTER, real, POINTER, POINTER, POINTER]
    library.gibbs_codegen_rate.restype = None
    return library
