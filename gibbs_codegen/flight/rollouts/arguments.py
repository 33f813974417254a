"""Arguments of rollouts, read as arrays, with errors that say what would be right."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.emitted.preparation import first_of
from gibbs_codegen.errors import UsageError, printable, written
from gibbs_codegen.flight.arguments import numpy_array
from gibbs_codegen.flight.plant.actuators import check_lag, command_limits
from gibbs_codegen.flight.plant.kinematics import UNIT, unit_quaternions
from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.runtime.rollouts import Array, Feedback, MotorModel

Controller = Callable[[float, Any, Any], Any]

# Every call asks for it, of one module after all.
_layout = functools.lru_cache(maxsize=64)(Layout.of_module)


class RolloutArguments:
    """Reads arguments of one call, and finds out how many states it is about.

    What an argument must not be raises `UsageError`.
    """

    def __init__(
        self, module: ModuleType, steps: int, xp: Any = np, read: Callable[..., Any] = numpy_array
    ) -> None:
        """Take what is rolled out for how many steps, and the library that arrays are of."""
        self.module, self.steps, self.xp, self._read = module, steps, xp, read
        self.layout = _layout(module)
        self.inputs = len(module.INPUTS)
        self.rotors = self.inputs - len(self.layout.v.joint_places) - self.layout.q.wheels
        # Whether inputs are commands of motors and servos.
        self.is_driven = bool(getattr(module, "COMMANDS", ()))
        self._counts: dict[str, int] = {}

    def count(self) -> int:
        """The number of states, by all that has been read.

        Raises `UsageError` if arguments differ.
        """
        many = {name: count for name, count in self._counts.items() if count != 1}
        if len({*many.values()}) > 1:
            counts = ", ".join(f"{count} in {name}" for name, count in many.items())
            raise UsageError(f"the number of states differs: {counts}; give equally many, or one")
        return next(iter(many.values()), 1)

    def states(self, name: str, value: Any, *shape: int) -> Any:
        """Finite numbers (1 or n, *shape), from (*shape) or (n, *shape)."""
        array = self._finite(name, value)
        if array.shape[-len(shape) or array.ndim :] != shape or array.ndim > len(shape) + 1:
            alone, many = _listed(shape), _listed(("states", *shape))
            raise UsageError(f"{name}: its shape must be {alone} or {many}, not {array.shape}")
        count = len(array) if array.ndim > len(shape) else 1
        return self._counted(name, array.reshape(count, *shape))

    def in_time(self, name: str, value: Any, *shape: int) -> Any:
        """Finite numbers (1 or n, 1 or steps, *shape), from such, (*shape) or (steps, *shape)."""
        array = self._finite(name, value)
        leading = array.shape[: array.ndim - len(shape)]
        fits = array.shape == (*leading, *shape) and len(leading) <= 2
        if not fits or leading[-1:] not in ((), (1,), (self.steps,)):
            shapes = [_listed(sizes) for sizes in (shape, ("steps", *shape))]
            whole = _listed(("states", "steps", *shape))
            raise UsageError(
                f"{name}: its shape must be {', '.join(shapes)} or {whole} with 1 or {self.steps} "
                f"steps, not {array.shape}"
            )
        return self._counted(name, array.reshape((1,) * (2 - len(leading)) + array.shape))

    def range(self, name: str, value: Any, width: int) -> Array:
        """Least and greatest values (2, width), which may be infinite.

        They are of numbers or arrays (width); no least value may be above the greatest.
        """
        wanted = f"the least and the greatest values, each a number or an array of shape ({width},)"
        ends = [*value] if isinstance(value, tuple | list | np.ndarray) else []
        arrays = [numpy_array(name, end) for end in ends]
        if len(arrays) != 2 or any(array.shape not in ((), (1,), (width,)) for array in arrays):
            raise UsageError(f"{name}: must be {wanted}")
        least, most = (np.broadcast_to(array, (width,)) for array in arrays)
        wrong = [i for i in range(width) if not least[i] <= most[i]]
        if wrong:
            i = wrong[0]
            raise UsageError(
                f"{name}: entry {i}: the least value {least[i]:g} must not be above the greatest, "
                f"{most[i]:g}"
            )
        return np.stack([least, most])

    def start(self, q0: Any, v0: Any) -> tuple[Any, Any]:
        """Coordinates (1 or n, nq), with quaternions of length 1, and velocities (1 or n, nv)."""
        for name, value in (("q0", q0), ("v0", v0)):
            if value is None:
                raise UsageError(f"{name}: missing; only scenarios have a start of their own")
        q = self.states("q0", q0, self.layout.q.size)
        return self.normalised("q0", q), self.states("v0", v0, self.layout.v.size)

    def control(self, control: Any) -> tuple[Any, Feedback | None]:
        """Inputs (1 or n, 1 or steps, nu), zeros for a callable, and feedback in such arrays."""
        if callable(control):
            return self.xp.zeros((1, 1, self.inputs)), None
        if not isinstance(control, Feedback):
            return self.in_time("control", control, self.inputs), None
        size, states, x = self.layout.v.size, self._states_of_actuators, control.x
        gain = self._finite("control.gain", control.gain)
        width = self.layout.displaced.size + size + (0 if x is None else len(states))
        if gain.shape != (self.inputs, width):
            wanted = _listed((self.inputs, width))
            more = f", or {_listed((self.inputs, width + len(states)))} with control.x"
            more = more if states and x is None else ""
            raise UsageError(f"control.gain: its shape must be {wanted}{more}, not {gain.shape}")
        if x is not None:
            x = self.in_time("control.x", x, len(states))
        q = self.in_time("control.q", control.q, self.layout.q.size)
        v = self.in_time("control.v", control.v, size)
        u = self._one_for_all("control.u", control.u, self.inputs)
        inputs = self.in_time("control.u", u, self.inputs)
        return inputs, Feedback(gain, self.normalised("control.q", q), v, x=x)

    def commands(self, inputs: Any) -> Any:
        """Commands of a controller, (nu) or (n, nu), as (1 or n, 1, nu)."""
        name = "what the controller returned"
        rows = self.states(name, inputs, self.inputs)
        del self._counts[name]  # How many states there are is known by now.
        if len(rows) not in (1, self.count()):
            raise UsageError(
                f"{name}: has {len(rows)} rows for {self.count()} states; give one for each state"
            )
        return rows[:, np.newaxis]

    def parameters(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Parameters by name in arrays (1 or n), of numbers or arrays (n)."""
        if not isinstance(parameters, Mapping):
            words = written(parameters)
            raise UsageError(f"parameters: must map names to numbers or arrays, not {words}")
        return {name: self.states(f"parameters: {name}", v) for name, v in parameters.items()}

    def constants(self, parameters: Mapping[str, Any]) -> Any:
        """Constants that the module's `prepare` makes of parameters; None if there are none.

        Raises `UsageError` for what it refuses.
        """
        values = self.parameters(parameters)
        # One number for all states costs less than one for each.
        numbers = {name: value if len(value) > 1 else value[0] for name, value in values.items()}
        try:
            return self.module.prepare(numbers) if numbers else None
        except (TypeError, ValueError) as error:
            raise UsageError(f"{self.module.NAME}: parameters: {error}") from None

    def motors(self, limits: Any, time_constants: Any, thrusts: Any) -> MotorModel | None:
        """Motors with thrusts (1 or n, rotors), zeros if none are given, as of `rollout`.

        None where inputs are what is commanded.
        """
        if self.is_driven:
            return self._of_commands(limits, {"time_constants": time_constants, "thrusts": thrusts})
        if thrusts is not None and time_constants is None:
            raise UsageError(
                "thrusts: without time_constants thrusts equal the commands; leave it out"
            )
        if limits is None and time_constants is None:
            return None
        unlimited = (-math.inf, math.inf)
        least, most = self.range("limits", unlimited if limits is None else limits, self.inputs)
        lag = self.lag(0.0 if time_constants is None else time_constants)
        begin = self._of_rotors("thrusts", 0.0 if thrusts is None else thrusts)
        return MotorModel(least, most, lag, begin)

    def _of_commands(self, limits: Any, refused: Mapping[str, Any]) -> MotorModel:
        """Limits of commands, else those of the robot file, whose motors have their own lag."""
        for name in [name for name, value in refused.items() if value is not None]:
            check_lag(self.module, name)
        ends = command_limits(self.module) if limits is None else limits
        least, most = self.range("limits", ends, self.inputs)
        return MotorModel(least, most, *np.zeros((2, 1, self.rotors)))

    def actuators(self, x0: Any) -> Any:
        """States of the actuators (1 or n, nx), zeros if none are given; None if there are none."""
        names = self._states_of_actuators
        if x0 is not None and not names:
            raise UsageError(
                f"x0: the actuators of {self.module.NAME} have no states (its robot file has no "
                "time constants, delays or battery); leave it out"
            )
        charges = self.xp.zeros(len(names)) if x0 is None else x0
        return self.states("x0", charges, len(names)) if names else None

    @property
    def _states_of_actuators(self) -> Sequence[str]:
        """Names of the states of actuators."""
        return getattr(self.module, "ACTUATOR_STATES", ())

    def lag(self, time_constants: Any) -> Any:
        """Time constants of motors (1 or n, rotors), s, as of `rollout`."""
        check_lag(self.module, "time_constants")
        lag = self._of_rotors("time_constants", time_constants)
        self._check(lag >= 0.0, "time_constants", "0 or more, in s")
        return lag

    def masses(self, name: str, value: Any, count: int) -> Any:
        """So many masses (1 or n, count), kg."""
        masses = self.states(name, value, count)
        self._check(masses >= 0.0, name, "0 or more, in kg")
        return masses

    def _of_rotors(self, name: str, value: Any) -> Any:
        """Finite numbers (1 or n, rotors) of which one may be given for all."""
        return self.states(name, self._one_for_all(name, value, self.rotors), self.rotors)

    def _one_for_all(self, name: str, value: Any, width: int) -> Any:
        """The argument as an array; one number is repeated `width` times."""
        array = self._read(name, value)
        return array if array.ndim else self.xp.broadcast_to(array, (width,))

    def normalised(self, name: str, q: Any) -> Any:
        """Coordinates (…, nq) with unit quaternions; `UsageError` if one cannot be normalised."""
        unit, right = unit_quaternions(self.module, self.layout, q, self.xp)
        self._check(right, name, UNIT)
        return unit

    def _counted(self, name: str, array: Any) -> Any:
        """The array (1 or n, ...), whose states are counted."""
        if not len(array):
            raise UsageError(f"{name}: has no states")
        self._counts[name] = len(array)
        return array

    def _finite(self, name: str, value: Any) -> Any:
        """The argument as an array, all entries of which are finite."""
        array = self._read(name, value)
        self._check(self.xp.isfinite(array), name, "finite", array)
        return array

    def _check(self, right: Any, name: str, wanted: str, values: Any = None) -> None:
        """Raise `UsageError` with the first entry that is not `right`, where that is known.

        `wanted` says what entries must be; the error shows one of `values`, if given.
        """
        try:
            wrong = ~np.asarray(right)
        except TypeError:  # What is traced by JAX has no values.
            return
        if not wrong.any():
            return
        place, words = first_of("value", wrong)
        where = f": {words}" if wrong.ndim else ""
        shown = "" if values is None else f", not {printable(values[place])}"
        raise UsageError(f"{name}{where} must be {wanted}{shown}")


def _listed(shape: Sequence[object]) -> str:
    """A shape in words."""
    return f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
