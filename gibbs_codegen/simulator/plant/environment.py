"""What acts on the robot besides its inputs, as wrenches on its frames.

A push, drag in the wind, walls, spinning rotors and payloads. The forces of payloads depend on the
acceleration under all the others, so they come last.
"""

from __future__ import annotations

import difflib
import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.scenario.environment import Payload, Wall, Wind
from gibbs_codegen.scenario.scenario import Push, Scenario
from gibbs_codegen.simulator.plant.payload import Payloads
from gibbs_codegen.simulator.plant.rotor_spin import RotorSpin
from gibbs_codegen.simulator.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.simulator.plant.wall import Walls
from gibbs_codegen.simulator.plant.wind import WindDrag


@dataclass(frozen=True)
class Environment:
    """What acts on the robot that flies; `spins` (N) are those of `Actuators`.

    Raises `UsageError` for frames that the robot does not have.
    """

    vehicle: Vehicle
    push: Push | None = None
    payload: tuple[Payload, ...] = ()
    wind: Wind | None = None
    wall: tuple[Wall, ...] = ()
    spins: Array | None = None

    def __post_init__(self) -> None:
        if self.push is not None:
            self._check(self.push.frame, "push.frame")
        for name in ("payload", "wall"):
            for place, each in enumerate(getattr(self, name)):
                self._check(each.frame, f"{name} {place + 1}: frame")
        if self.wind is not None:
            for key in ("drag", "rotational_drag"):
                for frame in getattr(self.wind, key):
                    self._check(frame, f"wind.{key}")

    def _check(self, frame: str, key: str) -> None:
        """Raise `UsageError` unless the robot has a frame, which stands at a key."""
        frames = self.vehicle.frames
        if frame not in frames:
            near = difflib.get_close_matches(frame, frames, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise UsageError(
                f"{key}: {self.vehicle.name} has no frame {printable(frame)}; "
                f"{hint}its frames: {', '.join(frames)}"
            )

    @classmethod
    def of(cls, vehicle: Vehicle, scenario: Scenario, spins: Array) -> Environment | None:
        """What acts in a flight; None if nothing does at any time.

        Raises `UsageError` also for a spinning rotor on a link without a frame.
        """
        spinning = spins if np.any(spins) else None
        found = cls(
            vehicle, scenario.push, scenario.payloads, scenario.wind, scenario.walls, spinning
        )
        acts = found.push or found.payload or found.wind or found.wall or found.spin
        return found if acts else None

    @cached_property
    def payloads(self) -> Payloads:
        """The payloads, p of them."""
        return Payloads(self.vehicle, self.payload)

    @cached_property
    def walls(self) -> Walls:
        """The walls."""
        return Walls(self.vehicle, self.wall)

    @cached_property
    def drag(self) -> WindDrag | None:
        """The drag in the wind, if any."""
        return WindDrag(self.vehicle, self.wind) if self.wind else None

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
        """Whether the push acts at times (…), s."""
        times = np.asarray(time)
        if self.push is None:
            return np.zeros(times.shape, dtype=bool)
        return (times >= self.push.begin) & (times < self.push.end)

    @property
    def jumps(self) -> set[float]:
        """Times, s, at which what acts, or how it changes, jumps."""
        lasting = [each for each in (self.push, *self.payload) if each is not None]
        gusts = self.wind.gusts if self.wind else ()
        ends = ((gust.begin, gust.begin + gust.duration) for gust in gusts)
        return {*itertools.chain(*ends, *((each.begin, each.end) for each in lasting))}

    @property
    def remedies(self) -> list[str]:
        """What may keep a flight under control."""
        return [
            *(["a weaker push"] if self.push else []),
            *(["a lighter payload"] if self.payload else []),
            *(["less wind"] if self.wind else []),
            *(["a wall further away"] if self.wall else []),
        ]

    def wrenches(
        self,
        time: float | Array,
        q: Array,
        v: Array,
        inputs: Array,
        pushed: Flags | bool,
        carried: ArrayLike,
    ) -> Array:
        """All wrenches (…, f, 6) on the frames: force, N, torque about the origin, N m, world axes.

        `pushed` (…) tells whether the push acts, `carried` (…, p) which payloads are there.
        """
        vehicle = self.vehicle
        found: Array = np.asarray(pushed)[..., np.newaxis, np.newaxis] * self.pushing
        found = np.array(np.broadcast_to(found, (*q.shape[:-1], *self.pushing.shape)))
        if self.drag is not None or self.wall or self.spin is not None:
            velocities = vehicle.function("frame_velocities")(q, v)
            if self.drag is not None:
                found += self.drag.wrenches(time, velocities)
            if self.wall or self.spin is not None:
                poses = vehicle.frame_poses(q)
                self.walls.add(found, poses, velocities)
                if self.spin is not None:
                    self.spin.add(found, poses, velocities, inputs)
        if np.any(carried):
            self.payloads.add(found, q, v, inputs, carried)
        return found
