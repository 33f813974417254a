"""Which parts of a machine act in which way to fly it: a table that is made of the programs.

A part acts where the program of a way takes or calls something more with it than without it. Where
it does not, there must be a reason here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

from gibbs_codegen.arrays import Functions, Node, constant, jacobian
from gibbs_codegen.arrays.nodes import (
    Call,
    Input,
    Invocation,
    join,
    ordered,
    reshaped,
    variable,
    zeros,
)
from gibbs_codegen.flight.analysis.linear_model import motion_program
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.machine.closed_loop import LoopStructure
from gibbs_codegen.machine.contact import FIGURES, Contact
from gibbs_codegen.machine.first_order import System
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Surroundings
from gibbs_codegen.machine.predictive import Horizon
from gibbs_codegen.machine.rollout_steps import Parts, rollout_step
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import parse_robot

_BODY = """
name = "flown"
[base]
attitude = "quaternion"
mass     = 1
inertia  = [0.01, 0.01, 0.02, 0, 0, 0]
"""
_ROTOR = "[[rotor]]\nposition = [0, 0, 0.1]\ndrag = 0.01\n"
_DRIVEN = f'{_ROTOR}command = "speed"\nthrust_constant = 1e-5\ncommand_limits = [0, 900]\n'
_AIR = "hub_drag = 1e-4\ndisc_radius = 0.1\n"
_CONSTRAINT = '[[constraint]]\nname = "stand"\ntype = "plane"\nframe = "base"\n'


@dataclass(frozen=True)
class Flown:
    """A robot's text, what is around it, and whether its motor lags."""

    text: str = _BODY + _ROTOR
    around: Surroundings = NO_SURROUNDINGS
    lags: bool = False

    @property
    def listing(self) -> SimpleNamespace:
        """What array programs read of its module, which has all functions."""
        description = Description(parse_robot(self.text))
        return SimpleNamespace(
            **description.lists([*FUNCTIONS]),
            NAME="flown",
            PARAMETERS=(),
            ATTITUDE=description.layout.attitude,
            COORDINATE_UNITS=description.layout.q.units,
            ROTOR_AIR=description.constants.get("ROTOR_AIR", {}),
            FUNCTIONS=[*FUNCTIONS],
        )


def _surface(figures: Node, place: Node) -> tuple[Node, Node]:
    return -place[2], constant([0.0, 0.0, 1.0])


_CONTACT = Contact(0, 0, _surface, 0, sticks=True)
_PLAIN, _BY_SPEED = Flown(), Flown(_BODY + _DRIVEN)
_HELD = Flown(_BODY + _ROTOR + _CONSTRAINT, Surroundings(holds=True))
# What acts, with it and without it.
FEATURES = {
    "motors by speed": (_BY_SPEED, _PLAIN),
    "lag of thrusts": (Flown(lags=True), _PLAIN),
    "air on rotors": (Flown(_BODY + _DRIVEN + _AIR), _BY_SPEED),
    "wind, with drag": (Flown(around=Surroundings(wind=True, drag=True)), _PLAIN),
    "pushes": (Flown(around=Surroundings(pushes=True)), _PLAIN),
    "spinning rotors": (Flown(around=Surroundings(spins=((0, 0),))), _PLAIN),
    "payloads": (Flown(around=Surroundings(payloads=(0,))), _PLAIN),
    "walls": (Flown(around=Surroundings(contacts=(_CONTACT,))), _PLAIN),
    "constraints": (_HELD, Flown(_BODY + _ROTOR + _CONSTRAINT)),
    "stops, with rebounds": (replace(_HELD, around=Surroundings(holds=True, stops=True)), _HELD),
}


def _closed_loop(flown: Flown) -> list[Node]:
    loop = LoopStructure(flown.listing, "held", 1, lags=flown.lags, around=flown.around)
    # Where a flight ends, or meets a stop, another program tells.
    return [*loop.slope().outputs.values(), *loop.end().outputs.values()]


def _rollout(flown: Flown) -> list[Node]:
    robot, around = Functions(flown.listing), flown.around
    figures = {"wall_0": FIGURES, "spins": 4, "active": robot.constraints}
    known = tuple((name, (1.0,) * size) for name, size in figures.items())
    parts = Parts(lag=flown.lags, around=around, figures=known)
    return [rollout_step(robot, "rk4", parts).outputs["x_next"]]


def _fmu(flown: Flown) -> list[Node]:
    robot, around = Functions(flown.listing), flown.around
    spins = around.spins, ((0.0, 0.0, 1.0, 1.0),) * len(around.spins)
    chosen = {"drag": around.drag, "walls": around.contacts, "payloads": around.payloads}
    acting = [name for name, acts in (chosen | {"constraints": around.holds}).items() if acts]
    system = System(robot, {0: 0.1} if flown.lags else {}, *spins, tuple(acting))
    still = {"torque", *(() if around.pushes else ("force",))}
    given = [
        zeros(*shape) if name in still else variable(name, *shape)
        for name, shape in system.influences.items()
    ]
    flat = join(*(reshaped(x, (math.prod(x.shape),)) for x in given))
    return [system.rate(variable("x", system.size), flat)["slope"]]


def _linear(flown: Flown) -> list[Node]:
    lagging = (0,) if flown.lags else ()
    program = motion_program(Functions(flown.listing), flown.around, lagging)
    by = [name for name in ("q", "v", "x", "u") if name in program.names]
    return [*jacobian(program, by).outputs.values()]


def _prediction(flown: Flown) -> list[Node]:
    around, robot = replace(flown.around, holds=False), Functions(flown.listing)
    figures = {"push": (robot.frames, 6), "wind": (3,), "drag": (robot.frames, 6)}
    figures |= {"wall_0": (FIGURES,), "spins": (1, 4), "payloads": (1,), "gravity": (3,)}
    known = tuple(figures.items()) if around.acts else ()
    horizon = Horizon(robot, lags=flown.lags, around=around, figures=known)
    return [*horizon.values().outputs.values()]


WAYS: dict[str, Callable[[Flown], list[Node]]] = {
    "`simulate`, `Simulation`, many flights, SITL": _closed_loop,
    "`rollout`, `VectorEnv`, JAX": _rollout,
    "FMU": _fmu,
    "`linearise`, `lqr`": _linear,
    "predictive control": _prediction,
}
# Why a part does not act.
REASONS = {
    ("predictive control", "constraints"): "what takes hold within a plan is an impact, and steps "
    "of plans have none; hold still by `control.law`, or plan to where the hold begins",
    (
        "`rollout`, `VectorEnv`, JAX",
        "stops, with rebounds",
    ): "a rebound is between two of their equal "
    "steps; a rollout under a scenario has them, as `simulate` has",
    ("FMU", "stops, with rebounds"): "the importer says by `active` what holds, and when",
    (
        "`linearise`, `lqr`",
        "stops, with rebounds",
    ): "a rebound has no linear model; take what a frame rests on for a constraint that holds",
    ("predictive control", "stops, with rebounds"): "steps of plans have no impacts, as for "
    "constraints",
}


def names(outputs: list[Node]) -> set[object]:
    """What is taken and called on the way to outputs, and how long these are."""
    found = set[object]()
    for x in ordered(outputs):
        match x.operation:
            case Input(name):
                found.add(name)
            case Call(_, name, _):
                found.add(name)
            case Invocation(program, _):
                found |= names([*program.outputs.values()])
    return found | {(place, x.size) for place, x in enumerate(outputs)}


def acts(way: str, feature: str) -> bool:
    """Whether a part acts in a way to fly."""
    with_it, without = FEATURES[feature]
    return names(WAYS[way](with_it)) != names(WAYS[way](without))


def ways_to_fly() -> str:
    """The table in Markdown, and why what does not act does not.

    Raises `ValueError` where there is no reason, or one for what acts.
    """
    lines = [f"| | {' | '.join(WAYS)} |", "|---" * (1 + len(WAYS)) + "|"]
    reasons = []
    for feature in FEATURES:
        cells = []
        for way in WAYS:
            why = REASONS.get((way, feature))
            if acts(way, feature) == (why is not None):
                raise ValueError(f"{feature} in {way}: {why or 'there is no reason'}")
            cells.append("yes" if why is None else "no")
            if why:
                reasons.append(f"- {way}: no {feature}: {why}.")
        lines.append(f"| {feature} | {' | '.join(cells)} |")
    return "\n".join([*lines, "", *sorted(reasons)])
