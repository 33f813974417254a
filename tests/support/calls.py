"""Arguments and results of the functions of modules, of which two back ends are compared."""

from __future__ import annotations

from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.interface import ARGUMENTS, Signature, module_signatures


class Pair(NamedTuple):
    """A module with NumPy's back end, and with another."""

    numpy: ModuleType
    ours: ModuleType


def state(module: ModuleType, name: str, *batch: int, seed: int = 0) -> list[NDArray[np.float64]]:
    """Arguments of the function of this name; quaternions have unit length."""
    (signature,) = (one for one in module_signatures(module) if one.name == name)
    return random_arguments(module, signature, *batch, seed=seed)


def random_arguments(
    module: ModuleType, signature: Signature, *batch: int, seed: int = 0
) -> list[NDArray[np.float64]]:
    """Arguments of a function; quaternions have unit length."""
    rng = np.random.default_rng(seed)
    arguments = []
    for name, shape in zip(signature.arguments, signature.argument_shapes, strict=True):
        values = rng.uniform(-0.9, 0.9, (*batch, *shape))
        if ARGUMENTS[name].is_coordinates:
            values = module.integrate(values, np.zeros(len(module.VELOCITIES)))
        arguments.append(np.abs(values) * 0.05 if name == "h" else values)
    return arguments


def as_tuple(outputs: Any) -> tuple[Any, ...]:
    """The outputs of a function, also where there is one."""
    return outputs if isinstance(outputs, tuple) else (outputs,)
