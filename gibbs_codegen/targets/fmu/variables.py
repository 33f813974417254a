"""The variables of an FMU: arrays of FMI 3.0, whose entries are the variables of FMI 2.0.

All values of an instance are in one array (`emitted/fmu.c`); a value reference is a place in it.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.machine.first_order import System
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.description import Coordinate
from gibbs_codegen.robot.names import coordinate_of

AXES = ("x", "y", "z")
# The greatest step of co-simulation, s, if none is chosen.
STEP = 0.001
_OUTPUTS = {
    "frames.position": ("m", "positions of the frames, world axes"),
    "frames.rotation": ("1", "axes of the frames in columns, world axes"),
    "frames.velocity": ("m/s", "velocities of the frames' origins, world axes"),
    "frames.angular_velocity": ("rad/s", "angular velocities of the frames, world axes"),
    "imu.specific_force": ("m/s^2", "specific forces at the frames (accelerometers), their axes"),
    "imu.angular_velocity": ("rad/s", "angular velocities of the frames (gyroscopes), their axes"),
    "loads.force": ("N", "forces through the joints of the bodies, at them, the bodies' axes"),
    "loads.torque": ("N m", "torques through the joints of the bodies, likewise"),
}
# What is given besides commands: inputs, then tunable parameters, with entries at the start.
_INPUTS = ("force", "torque", "wind")
_TUNABLE: dict[str, tuple[str, float | tuple[float, ...], str]] = {
    "force": ("N", 0.0, "forces on the frames at their origins, world axes"),
    "torque": ("N m", 0.0, "torques on the frames, world axes"),
    "wind": ("m/s", 0.0, "velocity of the air, world axes"),
    "drag": (
        "N s/m",
        0.0,
        "drag coefficients of the frames: force per velocity relative to the air",
    ),
    "rotational_drag": ("N m s/rad", 0.0, "rotational drag coefficients of the frames"),
    "wall.ball_radius": ("m", 0.0, "radii of balls about the frames, which meet their walls"),
    "wall.stiffness": ("N/m", 0.0, "stiffness of the wall of each frame; 0: no wall"),
    "wall.damping": ("N s/m", 0.0, "damping: force per speed into the wall"),
    "wall.dissipation": ("s/m", 0.0, "relative growth of the stiffness force with that speed"),
    "wall.friction": ("1", 0.0, "coefficients of friction"),
    "wall.bristle_stiffness": ("N/m", 1e4, "tangential stiffness of a sticking frame"),
    "wall.bristle_damping": ("N s/m", 1e2, "tangential damping of a sticking frame"),
    "wall.point": ("m", (0.0, 0.0, 0.0), "a point of the wall of each frame, world axes"),
    "wall.normal": ("1", (0.0, 0.0, 1.0), "directions in which walls push, world axes"),
    "payloads": ("kg", 0.0, "masses at the origins of the frames"),
    "active": ("1", 0.0, "1 if a constraint of the robot is active, else 0"),
}
# Exponents of SI units in what units are made of; an hour is greater than a second by a factor.
_SI: dict[str, dict[str, int]] = {
    **{name: {name: 1} for name in ("kg", "m", "s", "A", "rad")},
    "1": {},
    "N": {"kg": 1, "m": 1, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "h": {"s": 1, "factor": 3600},
}


@dataclass(frozen=True)
class Variable:
    """An array of the values, or a number: its place, and labels of the entries along each axis.

    `kind` is "state", "rate", "input", "figure" of what acts, "step", "parameter" or "output"; a
    rate has the place of its state in `of`. `start` are the values at the start, of what has such.
    """

    name: str
    kind: str
    place: int
    unit: str
    words: str
    axes: tuple[tuple[str, ...], ...] = ()
    start: tuple[float, ...] = ()
    of: int = 0

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(map(len, self.axes))

    @property
    def entries(self) -> Iterator[Variable]:
        """Variables of a number each."""
        for k, labels in enumerate(itertools.product(*self.axes)):
            inner = self.name.removeprefix("der(").removesuffix(")")
            name = ".".join([inner, *labels])
            yield replace(
                self,
                name=f"der({name})" if self.kind == "rate" else name,
                place=self.place + k,
                axes=(),
                start=self.start[k : k + 1],
                of=self.of + k,
            )


def variables_of(model: Model, system: System) -> list[Variable]:
    """All variables, in the order of their places, which begin at 1."""
    variables, place = [], 1
    states = [variable for variable in _states(model, system) if variable.size]
    for variable in itertools.chain(states, _rates(states), _inputs(model, system), _others(model)):
        if variable.size:
            variables.append(replace(variable, place=place, of=variable.of + 1))
            place += variable.size
    shapes = system.outputs.values()
    for (name, (unit, words)), shape in zip(_OUTPUTS.items(), shapes, strict=True):
        rows = model.description.bodies if name.startswith("loads") else model.description.frames
        axes = (rows[: shape[0]], *[AXES] * (len(shape) - 1))
        if shape[0]:
            variables.append(Variable(name, "output", place, unit, words, axes))
            place += variables[-1].size
    return variables


def _rates(states: Iterable[Variable]) -> Iterator[Variable]:
    """The rates of states, of which each has the place from 0 in `of`."""
    place = 0
    for state in states:
        unit = f"{state.unit}/s".replace("/s/s", "/s^2")
        words = f"rate of {state.name}"
        yield Variable(f"der({state.name})", "rate", 0, unit, words, state.axes, of=place)
        place += state.size


def _inputs(model: Model, system: System) -> Iterator[Variable]:
    """Commands, and what acts from outside."""
    description = model.description
    commands, rotors = description.commands or description.inputs, model.robot.rotors
    start = _actuators_at_rest(model)
    rolling = len(commands) - len(model.robot.wheels)
    parts = commands[:rotors], commands[rotors:rolling], commands[rolling:]
    for name, part in zip(("rotors", "joints", "wheels"), parts, strict=True):
        values = [start.get(coordinate.name, 0.0) for coordinate in part]
        yield from _parted(f"command.{name}", "input", part, values)
    rows = {"wind": AXES, "active": model.lists.get("CONSTRAINTS", ())}
    for name, shape in [*system.influences.items()][1:]:
        axes = (tuple(rows.get(name, description.frames)), AXES)[: len(shape)]
        kind = "input" if name in _INPUTS else "figure"
        unit, first, words = _TUNABLE[name]
        values = np.broadcast_to(first, shape).ravel().tolist()
        yield Variable(name, kind, 0, unit, words, axes, tuple(values))


def _others(model: Model) -> Iterator[Variable]:
    """The greatest step, and the parameters."""
    words = "greatest step of co-simulation inside a communication step"
    yield Variable("step_size", "step", 0, "s", words, start=(STEP,))
    for name, value in model.defaults.items():
        unit = model.units[name]
        yield Variable(f"parameters.{name}", "parameter", 0, unit, name, start=(value,))


def _states(model: Model, system: System) -> Iterator[Variable]:
    """The states: parts of q and v in the order of their places, and what actuators have."""
    description = model.description
    layout, start = description.layout, description.constants["POSTURE"]
    for letter, places, listed, values in (
        ("q", layout.q, description.coordinates, start),
        ("v", layout.v, description.velocities, (0.0,) * layout.v.size),
    ):
        names = ("attitude", "joints", "position", "angles")
        for name in sorted(names, key=lambda x: getattr(places, x).start):
            part, title = getattr(places, name), "wheels" if name == "angles" else name
            yield from _parted(f"{letter}.{title}", "state", listed[part], values[part])
    lagging = tuple(
        replace(entry, meaning=f"{entry.meaning} that acts")
        for entry in (description.inputs[rotor] for rotor in system.lags)
    )
    actuators = description.actuator_states or lagging
    rest = _actuators_at_rest(model)
    values = [rest.get(coordinate.name, 0.0) for coordinate in actuators]
    yield from _parted("actuators", "state", actuators, values)
    if "walls" in system.acting:
        words = "tangential stretch of frames that stick to their walls, world axes"
        start = (0.0,) * (3 * len(description.frames))
        yield Variable("bristles", "state", 0, "m", words, (description.frames, AXES), start)


def _actuators_at_rest(model: Model) -> dict[str, float]:
    """Values at the start that are not zero, by name: the charge, and where servos hold joints."""
    robot, layout = model.robot, model.description.layout
    values = {"charge": 1.0}
    for i, place in zip(
        robot.moving, model.description.constants["POSTURE"][layout.q.joints], strict=True
    ):
        servo, name = robot.links[i - 1].servo, coordinate_of(robot, i)
        if servo and servo.command == "position":
            values |= {f"{name}_position": place, f"{name}_reference": place}
    return values


def _parted(
    name: str, kind: str, listed: Sequence[Coordinate], start: Sequence[float]
) -> Iterator[Variable]:
    """One array, or where units differ a number for each entry."""
    if len({entry.unit for entry in listed}) < 2:
        words = "; ".join(f"{entry.name}: {entry.meaning}" for entry in listed)
        axes = (tuple(entry.name for entry in listed),)
        yield Variable(name, kind, 0, listed[0].unit if listed else "1", words, axes, tuple(start))
        return
    for entry, value in zip(listed, start, strict=True):
        yield Variable(f"{name}.{entry.name}", kind, 0, entry.unit, entry.meaning, (), (value,))


def base_units(units: Iterable[str]) -> dict[str, dict[str, int] | None]:
    """Exponents of SI units by the names of units; None where some are no integers."""
    return {unit: _exponents(unit) for unit in sorted({*units})}


def _exponents(unit: str) -> dict[str, int] | None:
    powers: dict[str, int] = {}
    factors = r"(/?) *(?:\(([^)]*)\)|([A-Za-z]+|1))(?:\^([\d.]+))?"
    for per, inner, name, power in re.findall(factors, unit):
        if "." in power:
            return None
        for base, exponent in ((_exponents(inner) or {}) if inner else _SI[name]).items():
            powers[base] = powers.get(base, 0) + exponent * int(power or 1) * (-1 if per else 1)
    return {name: exponent for name, exponent in powers.items() if exponent}
