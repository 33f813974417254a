"""Derivatives of emitted functions, exact to rounding: the kernels evaluated a complex step away.

With q (+) δ = integrate(q, δ), derivatives by q are those of δ ↦ f(q (+) δ) at 0, which to first
order is f at q plus `coordinate_rates(q, δ)`.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.interface import module_signatures

Array = np.ndarray

_STEP = 1e-40


def _numpy_module(module: Any) -> ModuleType:
    """The module that holds the kernels."""
    return sys.modules[module.mass_matrix.__module__]


def complex_values(
    module: Any, name: str, arguments: Mapping[str, Array], constants: Any = None
) -> list[Array]:
    """Outputs of a function at complex arguments (…, width), which share their leading axes."""
    source = _numpy_module(module)
    kernel = getattr(source, f"_{name}")
    k = source.prepare(source.PARAMETERS) if constants is None else constants
    columns = [
        np.moveaxis(np.asarray(arguments[argument], complex), -1, 0)
        for argument in [*inspect.signature(kernel).parameters][3:]
    ]
    entries = kernel(k, np.sin, np.cos, *columns)
    batch = np.broadcast_shapes(*(column.shape[1:] for column in columns))
    table = np.stack([np.broadcast_to(np.asarray(e, complex), batch) for e in entries], axis=-1)
    (found,) = (one for one in module_signatures(module) if one.name == name)
    parts = np.split(table, np.cumsum([int(np.prod(s)) for s in found.shapes])[:-1], axis=-1)
    return [part.reshape(*batch, *shape) for part, shape in zip(parts, found.shapes, strict=True)]


def along(
    module: Any, name: str, arguments: Mapping[str, Array], directions: Mapping[str, Array]
) -> list[Array]:
    """Derivatives of a function's outputs (m, …) along m directions at once.

    `directions` are rows (m, width) for some of the arguments; those of q are velocities.
    """
    moved = {key: np.asarray(value) for key, value in arguments.items()}
    for key, rows in directions.items():
        rates = module.coordinate_rates(arguments["q"], rows) if key == "q" else rows
        moved[key] = arguments[key] + 1j * _STEP * rates
    count = len(next(iter(directions.values())))
    moved = {key: np.broadcast_to(m, (count, m.shape[-1])) for key, m in moved.items()}
    return [output.imag / _STEP for output in complex_values(module, name, moved)]


def derivative(module: Any, name: str, arguments: Mapping[str, Array], by: str) -> list[Array]:
    """Derivatives (…, width) of a function's outputs by an argument, by q in the tangent space."""
    width = len(module.VELOCITIES) if by == "q" else len(arguments[by])
    found = along(module, name, arguments, {by: np.eye(width)})
    return [np.moveaxis(output, 0, -1) for output in found]


def parameter_derivative(module: Any, name: str, arguments: Mapping[str, Array]) -> list[Array]:
    """Derivatives (…, parameters) of a function's outputs by PARAMETERS."""
    source = _numpy_module(module)
    columns = []
    for parameter in module.PARAMETERS:
        values = dict(source.PARAMETERS)
        values[parameter] = np.complex128(values[parameter] + 1j * _STEP)
        outputs = complex_values(module, name, arguments, source._constants(values)[1])
        columns.append([output.imag / _STEP for output in outputs])
    return [np.stack(each, axis=-1) for each in zip(*columns, strict=True)]
