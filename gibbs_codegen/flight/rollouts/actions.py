"""What actions of learned policies are: inputs of the robot, or what an inner loop makes inputs of.

The inner loop is the array program `machine.inner_loop`; here it is chosen for a robot, and given
its numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gibbs_codegen.arrays import Functions
from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.flight.control.choice import gains_of, law_of
from gibbs_codegen.flight.control.geometric import leaning_figures
from gibbs_codegen.flight.plant.actuators import holds, module_actuators
from gibbs_codegen.flight.plant.allocation import allocation_of, thrust_axis
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.scenario.parts import Control
from gibbs_codegen.machine.inner_loop import ACTIONS, JOINTS, InnerLoop

# Greatest entries of an action, unless joints have limits: accelerations, m/s², with "rates" and
# "attitude", else velocities, m/s; rad/s, and rad with "attitude".
_WAYS = {"rates": 9.81, "attitude": 9.81, "velocity": 2.0, "tip": 1.0}
_TURNS = {"rates": 6.0, "attitude": 0.6, "velocity": 2.0, "tip": 0.0}


@dataclass(frozen=True)
class Actions:
    """Names (na) and ranges (2, na) of what actions are, and the inner loop that takes them.

    `loads` are the inputs of its program by name, as of a `Problem`, but for the target.
    """

    names: tuple[str, ...]
    ranges: Array
    loop: InnerLoop | None = None
    loads: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        vehicle: Vehicle,
        kinds: tuple[str, str | None],
        limits: Array,
        control: Control | None,
        ranges: Mapping[str, Any],
        hover: Array,
    ) -> Actions:
        """Those of kinds of `ACTIONS`, or "inputs", and of `JOINTS` or None.

        `limits` (2, nu) are those of inputs or commands, and `hover` (nq) is where the machine is.
        Raises `UsageError` for what the robot cannot do, or means nothing, and ranges that are
        none.
        """
        action, joints = kinds
        of_joints = "position" if joints is None else joints
        known = ("action", action, ("inputs", *ACTIONS)), ("joints", of_joints, JOINTS)
        for name, kind, words in known:
            if kind not in words:
                raise UsageError(f"{name}: one of {', '.join(words)}, not {printable(kind)}")
        if not isinstance(ranges, Mapping):
            raise UsageError(f"ranges: values by name, not {printable(ranges)}")
        if not isinstance(control, Control | None):
            raise UsageError(f"control: a Control, not {printable(control)}")
        idle = (joints, action in ("inputs", "tip")), (control, action == "inputs")
        for name, (value, means_nothing) in zip(("joints", "control"), idle, strict=True):
            if value is not None and means_nothing:
                raise UsageError(f'{name}: has no effect with action="{action}"; leave it out')
        if action == "inputs":
            made = cls(vehicle.commands, limits.copy())
        else:
            made = _with_loop(vehicle, action, of_joints, limits, control or Control(), hover)
        for name, value in ranges.items():
            if name not in made.names:
                raise UsageError(
                    f"ranges: {printable(name)}: not an entry of the action "
                    f"({', '.join(made.names)})"
                )
            try:
                low, high = value if np.ndim(value) else (-value, value)
                made.ranges[:, made.names.index(name)] = low, high
            except (TypeError, ValueError):
                low, high = 1.0, 0.0
            if not low <= high:
                raise UsageError(
                    f"ranges: {name}: the greatest value, or (least, greatest), not "
                    f"{printable(value)}"
                )
        if action == "inputs" and (made.ranges != np.clip(made.ranges, *limits)).any():
            raise UsageError('ranges: with action="inputs" must be within the limits of the motors')
        return made


def _with_loop(
    vehicle: Vehicle, action: str, joints: str, limits: Array, control: Control, hover: Array
) -> Actions:
    """Actions that an inner loop takes; raises `UsageError` as `Actions.of` does."""
    places = vehicle.layout.v
    if action in ("rates", "attitude") and not vehicle.rotors:
        raise UsageError(
            f'action: "{action}" needs rotors, which {vehicle.name} does not have; choose '
            '"velocity" or "inputs"'
        )
    if action == "tip" and not vehicle.has_tip:
        raise UsageError(f'action: {vehicle.name} has no tip; choose another, such as "inputs"')
    if vehicle.wrenches_vary:
        raise UsageError(
            f"action: the rotors of {vehicle.name} do not act alike everywhere, because of its "
            'joints or base, so there is no inner loop; choose "inputs"'
        )
    q = hover[np.newaxis]
    law_of("tracking", vehicle, q, f'action="{action}"')
    held = tuple(k for k in range(vehicle.joints) if holds(vehicle, k))
    tip = vehicle.frames.index("tip") if action == "tip" else 0
    loop = InnerLoop(action, joints, thrust_axis(vehicle, q) is not None, held, tip)
    robot = Functions(vehicle.module)
    parts = loop.parts(robot)
    gains = gains_of(control, vehicle, loop.leans, held)
    stiffness, damping = gains.stiffness.copy(), gains.damping.copy()
    if action in ("rates", "attitude"):
        damping[places.position] = 0.0
    if action == "velocity":
        stiffness[places.position] = 0.0
    if joints == "torque" and action != "tip":
        stiffness[places.joints] = damping[places.joints] = 0.0
    figures: dict[str, Any] = {
        "stiffness": stiffness,
        "damping": damping,
        "frame_damping": np.full(3, 2.0 * control.damping_ratio * control.frequency),
        "centre": vehicle.lever,
        "distribution": allocation_of(vehicle).inverse,
    }
    if loop.leans:
        figures |= leaning_figures(vehicle)
    loads = {x.operation.name: x for x in loop.inputs(robot)[2:]}  # type: ignore[union-attr]
    actuators = module_actuators(vehicle)
    of_joints = {
        "position": actuators.joints,
        "velocity": actuators.velocities * [[-1.0], [1.0]],
        "torque": actuators.inputs[:, vehicle.rotors : vehicle.rotors + vehicle.joints],
    }[joints]
    most = np.repeat([_WAYS[action], _TURNS[action]], [len(part) for part in parts[:2]])
    ranges = np.concatenate([[-most, most], of_joints[:, : len(parts[2])]], axis=1)
    names = tuple(name for part in parts for name in part)
    return Actions(names, ranges, loop, {name: np.asarray(figures[name]) for name in loads})
