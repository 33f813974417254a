"""Figures of what acts on the robot besides its inputs; `machine.surroundings` has the wrenches.

A push, drag in the wind, walls, spinning rotors and payloads.

A rotor of inertia J that spins at Ω about its thrust's direction d has the angular momentum
h = J Ω d, and does the torque −ω × h to the body that holds it, ω being the angular velocity of
that body. Ω follows from the thrust, Ω = k √T. The torque −J dΩ/dt along d, by which a rotor
resists a change of its speed, is left out.

A payload of mass m, fixed to a frame, does to it f = m (g − p̈), where p̈ = J a + c is the
acceleration of the frame. The acceleration a of the robot depends on f: a = a₀ + M⁻¹ Jᵀ f, where a₀
is that under all other forces, so payloads come last. The forces of all payloads solve
(1 + m J M⁻¹ Jᵀ) f = m (g − c − J a₀), which is exact.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError, check_all, near, printable
from gibbs_codegen.flight.plant.actuators import module_actuators
from gibbs_codegen.flight.plant.vehicle import Array, Flags, RobotData, Vehicle
from gibbs_codegen.flight.scenario.file import AnyScenario, read_scenario
from gibbs_codegen.flight.scenario.parts import Hold, Payload, Push, Wind
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.scenario.walls import Wall, contacts_of, yielding
from gibbs_codegen.machine.machine import Surroundings

# What `Environment.restitution` has of constraints that hold from both sides.
BOTH_SIDES = -1.0
# Times, s, from which on frames rest on stops, and on which of the constraints.
Rests = tuple[tuple[float, tuple[bool, ...]], ...]


class RotorSpin:
    """The g rotors that have a spin inertia, and the frames that take their torques.

    `places` (g) are numbers of the frames, `axes` (g, 3) the directions of the thrusts in their
    axes. `spins` (N) are as of `Actuators`, negative for a rotor that spins clockwise seen from the
    tip of its thrust, 0 for one without inertia. Raises `UsageError` for a rotor on a link that has
    no frame.
    """

    def __init__(self, vehicle: Vehicle, spins: Array) -> None:
        self.rotors: NDArray[np.intp] = np.flatnonzero(spins)
        self.spins = spins[self.rotors]
        centre, carriers = vehicle.points.index(vehicle.centre), vehicle.carriers
        # The first frame is the base's, and the others are the last points.
        others = carriers[len(vehicle.points) - len(vehicle.frames) + 1 :]
        moves_with = carriers[centre + 1 + self.rotors, np.newaxis] == [centre, *others]
        for rotor, frames in zip(self.rotors, moves_with, strict=True):
            if not np.any(frames):
                raise UsageError(
                    f"{vehicle.name}: rotor {rotor + 1} has a spin_inertia, but no frame moves "
                    "with it: add a [[frame]] on the link that carries it, and generate the "
                    "module again"
                )
        self.places: NDArray[np.intp] = np.argmax(moves_with, axis=1)
        # Where parameters differ along an axis, one robot tells the directions of all.
        q = vehicle.neutral[np.newaxis]
        world = vehicle.base_rotation(q[0]) @ vehicle.thrust_wrenches(q)[0, :3, self.rotors].T
        axes = np.einsum("gij,ig->gj", vehicle.frame_poses(q)[0, self.places, :3, :3], world)
        self.axes: Array = axes / np.linalg.norm(axes, axis=-1, keepdims=True)


def open_loops(module: Any, holds: Sequence[Hold], end: float) -> str:
    """Which loops of a mechanism no hold closes from 0 to `end`, s, and a remedy; "" if all do."""
    closed = {x.constraint for x in holds if x.begin == 0.0 and x.end >= end}
    loops = ", ".join(name for name in getattr(module, "LOOPS", ()) if name not in closed)
    words = f"its loops open: {loops}; give the scenario a [[hold]] for each, from beginning to end"
    return words if loops else ""


def surrounding(
    vehicle: Vehicle, scenario: AnyScenario | None, place: Callable[[str, str], int] | None = None
) -> Environment | None:
    """The surroundings of a robot in a scenario; None if nothing acts in it at any time.

    Raises `UsageError` for what does not fit the robot. `place` is as of `check_surroundings`.
    """
    if scenario is None:
        return None
    try:
        scene = read_scenario(scenario)
    except UsageError as error:
        raise UsageError(f"surroundings: {error}") from None
    for name in ("parameters", "plant"):
        if getattr(scene, name):
            raise UsageError(
                f"surroundings: {name}: numbers of the robot are not surroundings; leave it out"
            )
    check_surroundings(vehicle, scene, place)
    return Environment.of(vehicle, scene, module_actuators(vehicle).spins)


def check_surroundings(
    vehicle: RobotData, scenario: Scenario, place: Callable[[str, str], int] | None = None
) -> None:
    """Raise `UsageError` for frames and constraints that the robot does not have.

    `place` checks a frame and its key, `frame_place` if None.
    """
    on = [("push.frame", scenario.push.frame)] if scenario.push else []
    on += [(f"payload {k}: frame", load.frame) for k, load in enumerate(scenario.payloads, start=1)]
    on += [(f"wall {k}: frame", x) for k, wall in enumerate(scenario.walls, 1) for x in wall.frames]
    for key in ("drag", "rotational_drag") if scenario.wind else ():
        on += [(f"wind.{key}", frame) for frame in getattr(scenario.wind, key)]
    holds = enumerate(scenario.holds, start=1)
    check_all(
        [
            *(partial(place or vehicle.frame_place, frame, key) for key, frame in on),
            *(partial(_check_hold, vehicle, scenario, f"hold {k}", hold) for k, hold in holds),
        ]
    )


def _check_hold(vehicle: RobotData, scenario: Scenario, where: str, hold: Hold) -> None:
    constraints = getattr(vehicle.module, "CONSTRAINTS", ())
    if hold.constraint not in constraints:
        names = (
            f"its constraints: {', '.join(constraints)}"
            if constraints
            else "it has no [[constraint]]"
        )
        hint = near(hold.constraint, constraints) or ";"
        words = f"{vehicle.name} has no {printable(hold.constraint)}{hint} {names}"
        raise UsageError(f"{where}: constraint: {words}")
    if hold.restitution is not None and not _side(vehicle, hold.constraint):
        words = "applies to a plane or a distance, which stop a frame from one side; leave it out"
        raise UsageError(f"{where}: restitution: {words}, as {hold.constraint} holds from all")
    for number, load in enumerate(scenario.payloads, start=1):
        if (first := max(load.begin, hold.begin)) < min(load.end, hold.end):
            raise UsageError(
                f"{where}: at t = {first:g} s {hold.constraint} holds, and payload {number} is "
                "there too, and a flight cannot have both; end one before the other begins, or "
                "add the mass of the payload to a link in [plant]"
            )


def _side(vehicle: RobotData, constraint: str) -> float:
    """Sign of the errors that a constraint allows as a stop: 1 of a plane, -1 of a distance, or 0.

    It is on the side of the plane to which the normal points.
    """
    module = vehicle.module
    row = module.CONSTRAINT_ROWS[module.CONSTRAINT_PLACES[constraint]][0]
    return row.endswith("_normal") * 1.0 - row.endswith("_distance")


@dataclass(frozen=True)
class Environment:
    """Forces on the robot that flies; `spins` (N) are those of `Actuators`.

    Holds with a restitution are stops, which hold a frame only while it rests there: `rests` have
    times, s, from which on it does, or does no longer, on each of the constraints.
    """

    vehicle: Vehicle
    push: Push | None = None
    payload: tuple[Payload, ...] = ()
    wind: Wind | None = None
    wall: tuple[Wall, ...] = ()
    spins: Array | None = None
    hold: tuple[Hold, ...] = ()
    rests: Rests = ()

    @property
    def _constraints(self) -> tuple[str, ...]:
        return tuple(getattr(self.vehicle.module, "CONSTRAINTS", ()))

    @cached_property
    def sides(self) -> Array:
        """Sides (c) of the constraints, as `_side` has them."""
        return np.array([_side(self.vehicle, name) for name in self._constraints])

    @classmethod
    def of(cls, vehicle: Vehicle, scenario: Scenario, spins: Array) -> Environment | None:
        """The environment of a flight; None if nothing acts at any time.

        Raises `UsageError` for a spinning rotor on a link without a frame.
        """
        spinning = spins if np.any(spins) else None
        world = cls(
            *(vehicle, scenario.push, scenario.payloads, scenario.wind, scenario.walls, spinning),
            scenario.holds,
        )
        acts = world.push or world.payload or world.wind or world.wall or world.spin or world.hold
        return world if acts else None

    def with_walls(self, walls: Sequence[Wall]) -> Environment:
        """The same with further walls. Raises `UsageError` for one that it has."""
        if any(wall in self.wall for wall in walls):
            raise UsageError(
                "walls: `surroundings` has this wall already; leave it out in one of them"
            )
        return replace(self, wall=(*walls, *self.wall))

    @cached_property
    def around(self) -> Surroundings:
        """The surroundings that act at all times, and their frames."""
        gusts, spin = self.wind.gusts if self.wind else (), self.spin
        spins = zip(spin.rotors.tolist(), spin.places.tolist(), strict=True) if spin else ()
        return Surroundings(
            wind=self.wind is not None,
            drag=self.wind is not None,
            gusts=len(gusts),
            contacts=contacts_of(self.wall, self.vehicle.frames),
            spins=tuple(spins),
        )

    @cached_property
    def figures(self) -> dict[str, Array]:
        """Figures of what acts at all times, as array programs of a closed loop take them."""
        figures: dict[str, Array] = {}
        if (wind := self.wind) is not None:
            # Drag by force, N s/m, and torque, N m s/rad; gusts with half of the amplitude, m/s.
            drag = np.zeros((len(self.vehicle.frames), 6))
            for table, entries in ((wind.drag, slice(3)), (wind.rotational_drag, slice(3, 6))):
                for name, coefficient in table.items():
                    drag[self.vehicle.frames.index(name), entries] = coefficient
            gusts = [[g.begin, g.duration, *np.multiply(0.5, g.amplitude)] for g in wind.gusts]
            figures = {"drag": drag, "wind": np.array(wind.velocity, dtype=np.float64)}
            figures["gusts"] = np.array(gusts, dtype=np.float64).reshape(-1, 5)
        for k, wall in enumerate(self.wall):
            figures[f"wall_{k}"] = np.array([*yielding(wall), *wall.figures])
        if self.spin is not None:
            figures["spins"] = np.column_stack((self.spin.axes, self.spin.spins))
        return figures

    @cached_property
    def gravity(self) -> Array:
        """The acceleration of gravity (…, 3), m/s², world axes; plants that differ have theirs."""
        return np.multiply.outer(self.vehicle.gravity, [0.0, 0.0, 1.0])

    def under(
        self, push: bool | Flags, payloads: Any, holds: Any, stops: Any = False
    ) -> tuple[Surroundings, dict[str, Any]]:
        """The surroundings and their figures, while the push acts (…) if it does.

        `payloads` (…, p) and constraints, `holds` and `stops` (…, c), tell which do; one flag is
        for all.
        """
        around, values = self.around, {**self.figures}
        if np.any(holds) or np.any(stops):
            around = replace(around, holds=True, stops=bool(np.any(stops)))
            active, sides = np.asarray(holds, dtype=np.float64), np.multiply(stops, self.sides)
            sided = np.stack([sides * (1.0 - active), sides * active], axis=-2)
            rows = [
                place.stop - place.start for place in self.vehicle.module.CONSTRAINT_PLACES.values()
            ]
            values |= {"active": active, "stops": np.repeat(sided, rows, axis=-1)}
        masses = np.where(payloads, [payload.mass for payload in self.payload], 0.0)
        there = np.flatnonzero(np.any(masses > 0.0, axis=tuple(range(masses.ndim - 1))))
        if np.any(push):
            around = replace(around, pushes=True)
            values["push"] = np.multiply.outer(push, self.pushing)
        if len(there):
            places = tuple(self.vehicle.frames.index(self.payload[k].frame) for k in there)
            around = replace(around, payloads=places)
            values |= {"payloads": masses[..., there], "gravity": self.gravity}
        return around, values

    def carries(self, time: float | Array) -> Flags:
        """True (…, p) for payloads that are there at times (…), s."""
        times = np.asarray(time)
        carried = np.zeros((*times.shape, len(self.payload)), dtype=bool)
        for place, payload in enumerate(self.payload):
            carried[..., place] = payload.acts_at(times)
        return carried

    def holding(self, time: float | Array) -> Flags:
        """True (…, c) for constraints that hold at times (…), s, and for stops with a rest."""
        restitution, rests = self.restitution(time), dict(self.rests)
        last = np.searchsorted([*rests], time, side="right")
        resting = np.array([(False,) * len(self._constraints), *rests.values()], bool)[last]
        # A rest ends with its hold.
        begins = np.zeros_like(restitution)
        for hold in self.hold:
            begins[hold.acts_at(np.asarray(time)), self._constraints.index(hold.constraint)] = (
                hold.begin
            )
        resting &= np.array([-np.inf, *rests])[last, np.newaxis] >= begins
        return (restitution == BOTH_SIDES) | (restitution >= 0.0) & resting

    def restitution(self, time: float | Array) -> Array:
        """Restitution (…, c) of stops at times (…), s; `BOTH_SIDES` of what holds, or NaN."""
        times = np.asarray(time)
        shares = np.full((*times.shape, len(self._constraints)), np.nan)
        for hold in sorted(self.hold, key=lambda hold: hold.restitution is None):
            share = BOTH_SIDES if hold.restitution is None else hold.restitution
            shares[hold.acts_at(times), self._constraints.index(hold.constraint)] = share
        return shares

    def takes_hold(self, time: float) -> bool:
        """True if a constraint that did not hold just before begins to at a time, s, or a stop."""
        before = {hold.constraint for hold in self.hold if hold.begin < time <= hold.end}
        return any(hold.begin == time and hold.constraint not in before for hold in self.hold)

    def idles(self, time: float | Array) -> Flags:
        """True (…) for times, s, at which motors idle since a constraint holds the robot."""
        times = np.asarray(time)
        idle = np.zeros(times.shape, dtype=bool)
        for hold in (hold for hold in self.hold if hold.idle):
            holding = self.holding(times)[..., self._constraints.index(hold.constraint)]
            idle |= hold.acts_at(times) & holding
        return idle

    @cached_property
    def spin(self) -> RotorSpin | None:
        """The spinning rotors, if any."""
        return RotorSpin(self.vehicle, self.spins) if self.spins is not None else None

    @cached_property
    def pushing(self) -> Array:
        """Wrenches (f, 6) of the push on the frames while it acts: force and torque, world axes."""
        wrenches = np.zeros((len(self.vehicle.frames), 6))
        if self.push is not None:
            place = self.vehicle.frames.index(self.push.frame)
            wrenches[place] = [*self.push.force, *self.push.torque]
        return wrenches

    def push_acts(self, time: float | Array) -> Flags:
        """True (…) for times, s, at which the push acts."""
        times = np.asarray(time)
        if self.push is None:
            return np.zeros(times.shape, dtype=bool)
        return self.push.acts_at(times)

    @property
    def jumps(self) -> set[float]:
        """Times, s, at which what acts, or how it changes, jumps."""
        lasting = filter(None, (self.push, *self.payload, *self.hold))
        gusts = self.wind.gusts if self.wind else ()
        ends = ((gust.begin, gust.begin + gust.duration) for gust in gusts)
        return {*itertools.chain(*ends, *((x.begin, x.end) for x in lasting), dict(self.rests))}

    @property
    def remedies(self) -> list[str]:
        """Advice that may keep a flight under control."""
        return [
            *(["a weaker push"] if self.push else []),
            *(["a lighter payload"] if self.payload else []),
            *(["less wind"] if self.wind else []),
            *(["a wall further away"] if self.wall else []),
            *(["a shorter hold"] if self.hold else []),
        ]
