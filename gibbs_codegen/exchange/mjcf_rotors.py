"""Rotors in MJCF: a motor at a site, whose gear is a force and the torque that goes with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gibbs_codegen.exchange.placement import Array, of_quaternion, vector
from gibbs_codegen.exchange.source import SourceRotor, Told

_JOINT, _SITE = 0, 4
_FILTERS = (2, 3)
_NO_BIAS = 0


def mjcf_rotors(
    model: Any, names: Sequence[str], bodies: Sequence[int]
) -> tuple[tuple[SourceRotor, ...], list[Told]]:
    """The rotors on such bodies of a compiled model, by actuators, and what was left out."""
    rotors, told = [], []
    for k in range(model.nu):
        if model.actuator_trntype[k] != _SITE:
            continue
        site, gear = model.actuator_trnid[k, 0], np.array(model.actuator_gear[k])
        body, size = model.site_bodyid[site], float(np.linalg.norm(gear[:3]))
        size = 1.0 if abs(size - 1.0) < 4e-16 else size
        name = _name(model, k) or f"rotor_{k + 1}"
        if body not in bodies:
            continue
        if size == 0.0:
            told.append(Told("left out", name, "an actuator of torque without a force, no rotor"))
            continue
        w, x, y, z = model.site_quat[site]
        turn = of_quaternion(x, y, z, w)
        direction = gear[:3] / size
        drag = float(direction @ gear[3:]) / size
        if np.abs(gear[3:] - drag * gear[:3]).max() > 1e-9 * np.abs(gear).max():
            told.append(Told("left out", name, "torque across the thrust"))
        limits = _range(model, k, size)
        if limits is not None and limits[1] <= 0.0:  # It pulls: turned, it pushes.
            direction, limits = -direction, (-limits[1], -limits[0])
        rotors.append(
            SourceRotor(
                name,
                names[body],
                vector(model.site_pos[site]),
                vector(turn @ direction),
                drag,
                limits,
                float(model.actuator_dynprm[k, 0]) or None
                if model.actuator_dyntype[k] in _FILTERS
                else None,
                found_by="motor at a site",
            )
        )
    return tuple(rotors), told


def efforts(model: Any) -> dict[int, float]:
    """The largest torque or force, N m or N, of motors at joints, by the number of the joint."""
    found = {
        j: float(np.abs(model.jnt_actfrcrange[j]).max())
        for j in range(model.njnt)
        if model.jnt_actfrclimited[j]
    }
    for k in range(model.nu):
        if model.actuator_trntype[k] != _JOINT:
            continue
        limits = _range(model, k, abs(float(model.actuator_gear[k, 0])))
        if limits is not None and (most := max(map(abs, limits))) > 0.0:
            j = int(model.actuator_trnid[k, 0])
            found[j] = min(most, found.get(j, most))
    return found


def _range(model: Any, k: int, gear: float) -> tuple[float, float] | None:
    """Least and largest force of an actuator, or None where there is no bound.

    With a bias, a servo's control is no force. `gear` is the force per unit of actuation.
    """
    bounds: list[Array] = []
    if model.actuator_ctrllimited[k] and model.actuator_biastype[k] == _NO_BIAS:
        bounds.append(float(model.actuator_gainprm[k, 0]) * np.array(model.actuator_ctrlrange[k]))
    if model.actuator_forcelimited[k]:
        bounds.append(np.array(model.actuator_forcerange[k]))
    if not bounds:
        return None
    low = gear * max(float(min(pair)) for pair in bounds)
    high = gear * min(float(max(pair)) for pair in bounds)
    return (low + 0.0, high + 0.0) if low < high else None


def _name(model: Any, k: int) -> str:
    address = model.name_actuatoradr[k]
    return bytes(model.names[address : model.names.index(b"\0", address)]).decode()
