"""A robot at rest as a scene, and the words and colours that go with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gibbs_codegen.simulator.record.recording import weight_of
from gibbs_codegen.simulator.record.series import Array
from gibbs_codegen.viewer.machine import Machine, State
from gibbs_codegen.viewer.machine_scene import MachineScene, Posture, least_loads, set_stage

# In the size of a robot: how far below it the floor is; in half its extent: what is in sight, and
# by how much more between panels.
_FLOOR, _AROUND, _BETWEEN_PANELS = 0.2, 1.25, 1.4
# Share of postures whose largest thrusts and efforts are not too large to be shown whole.
_USUAL = 0.8


class RobotScene:
    """Nodes of a robot, whose sizes are taken at coordinates q.

    Thrusts and efforts are drawn in proportion to the largest that were noted. `live` is whether
    frames are drawn when they are asked for, between panels that take room.
    """

    def __init__(self, server: Any, machine: Machine, q: Array, live: bool) -> None:
        vehicle = machine.vehicle
        self._rotors = vehicle.rotors
        self._units = np.array([*vehicle.layout.effort_units, *["N m"] * machine.arms])
        self._arms, self._largest = machine.arms, dict.fromkeys(self._units.tolist(), 0.0)
        self._thrust = 0.0
        drawn = machine.skeleton(q)
        self.size = drawn.size
        self._least = least_loads(weight_of(vehicle), drawn.size)
        self._frames = len(vehicle.frames) if live else 0
        points = vehicle.positions(q)
        low, high = points.min(axis=0), points.max(axis=0)
        world = server.scene.add_frame("/robot", show_axes=False)
        world.position = -0.5 * (low + high)
        self.machine = MachineScene(server.scene, "/robot/parts", drawn, [], self._frames)
        reach = _AROUND * (_BETWEEN_PANELS if live else 1.0)
        reach *= 0.5 * float(np.linalg.norm(high - low)) + drawn.radius
        set_stage(server, "/robot", float(low[2]) - _FLOOR * drawn.size, reach)

    def note(self, states: Sequence[State]) -> None:
        """Draw thrusts and efforts in proportion to those of states, if these are larger.

        The most extreme of the states do not count.
        """
        acting = [self._acting(state) for state in states]
        found = _usual([thrusts for thrusts, _ in acting], self._least["N"])
        self._thrust = max(self._thrust, found)
        for unit, most in self._largest.items():
            of_unit = [efforts[self._units == unit] for _, efforts in acting]
            self._largest[unit] = max(most, _usual(of_unit, self._least[unit]))

    def _acting(self, state: State) -> tuple[Array, Array]:
        """Thrusts (N), and sizes of the efforts of joints and of what holds base arms."""
        thrusts, joints = np.split(state.u, [self._rotors])
        return thrusts, np.abs(np.concatenate([joints, state.held[: self._arms]]))

    def show(self, state: State) -> None:
        """Put the robot where it is."""
        thrusts, efforts = self._acting(state)
        whole = np.array([self._largest[unit] or 1.0 for unit in self._units.tolist()])
        self.machine.show(
            Posture(
                state.points,
                state.directions,
                thrusts / (self._thrust or 1.0),
                efforts / whole,
                np.zeros((0, 3)),
                state.frames[: self._frames],
            )
        )

    def key(self) -> list[tuple[str, str]]:
        """Colours, as CSS has them, and in words what they mean."""
        return self.machine.key(self._thrust, self._largest)


def _usual(values: Sequence[Array], least: float) -> float:
    """The largest size in each state, but for the most extreme states; 0 for `least` and below."""
    largest = [float(np.max(np.abs(v), initial=0.0, where=np.isfinite(v))) for v in values]
    most = float(np.quantile(largest, _USUAL))
    return most if most > least else 0.0
