"""The functions of a module as nodes of array programs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from gibbs_codegen.arrays.nodes import (
    Call,
    Node,
    Space,
    coordinates_of,
    entries_of,
    join,
    node,
    variable,
)
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, module_signatures
from gibbs_codegen.interface.actuators import trivial
from gibbs_codegen.interface.choice import options_with
from gibbs_codegen.robot.layout import Layout

# By which driven joints lead loops of a mechanism.
LEADING = {"constraint_jacobian", "constraint_bias"}


class Functions:
    """Calls of a module's functions, each under its name: `robot.forward_dynamics(q, v, u)`.

    A function of one output gives a node, one of several a tuple of them.

    Args:
        module: A loaded module, or what lists the same constants.
        owner: Whose parameters they are called with, as those of a plant and of its model in a law.
    """

    def __init__(self, module: Any, owner: str = "robot") -> None:
        self.name: str = module.NAME
        self.owner = owner
        # 1 if driven joints lead loops of mechanisms, else 0; None: they do.
        self.leading: Node | None = None
        self.signatures = {signature.name: signature for signature in module_signatures(module)}
        self.inputs, self.parameters = len(module.INPUTS), len(module.PARAMETERS)
        self.frames = len(module.FRAMES)
        self.actuator_states = len(getattr(module, "ACTUATOR_STATES", ()))
        self._trivial = trivial(module)
        self.constraints = len(getattr(module, "CONSTRAINTS", ()))
        # 1 for each constraint, but 0 where its errors go back to zero.
        self.rigid = [
            float(f"constraint_{name}_frequency" not in module.PARAMETERS)
            for name in getattr(module, "CONSTRAINTS", ())
        ]
        # Rows of loops of mechanisms (l, nl), and joints in these that nothing drives (p, nv).
        loops, rows = getattr(module, "LOOPS", {}), len(getattr(module, "CONSTRAINT_ROWS", ()))
        held = [np.eye(rows)[module.CONSTRAINT_PLACES[name]] for name in loops]
        self.loop_rows = np.concatenate([np.zeros((0, rows)), *held])
        names, self.undriven = list(module.VELOCITIES), [*dict.fromkeys(chain(*loops.values()))]
        self.free_joints = np.eye(len(names))[[names.index(name) for name in self.undriven]]
        # Rotors on which the air acts: their numbers, hubs' frames, and figures of the air.
        inputs, frames = list(module.INPUTS), list(module.FRAMES)
        self.air = [
            (inputs.index(name), frames.index(hub), tuple(numbers))
            for name, (hub, *numbers) in getattr(module, "ROTOR_AIR", {}).items()
        ]
        # Whether commands are not the inputs themselves, but of motors and servos.
        self.driven = bool(getattr(module, "COMMANDS", ()))
        self.layout = Layout.of_module(module)
        self.space = Space.of(self.layout)
        # Whether dampers may lie between frames, or at wheels or joints that gears move.
        turning = len(module.POINTS) - len(module.FRAMES) - ("O2" in module.POINTS) - self.rotors
        self.couples_dampers = turning > len(self.layout.v.joint_places) or any(
            name.startswith("spring_") for name in module.PARAMETERS
        )
        self.joint_carriers = self._joint_carriers(module)
        # Rotors whose thrusts may lag by themselves: none where drives say how.
        self.lagging = 0 if self.driven else self.rotors

    @property
    def leads_loops(self) -> bool:
        """True if there are loops of mechanisms, and functions by which driven joints lead them."""
        return bool(self.free_joints.size) and self.signatures.keys() >= LEADING

    @property
    def rotors(self) -> int:
        """Number of rotors: inputs that no joint and no wheel has."""
        joints = self.layout.v.joints
        return self.inputs - (joints.stop - joints.start) - self.layout.q.wheels

    @property
    def base_inputs(self) -> list[int]:
        """Places of inputs that move the base: thrusts of rotors, and then torques of wheels."""
        return [*range(self.rotors), *range(self.inputs - self.layout.q.wheels, self.inputs)]

    def _joint_carriers(self, module: Any) -> list[int] | None:
        """For each joint the number, from 1, of that which carries it, 0 for the base.

        None if unknown: joints that gears move have no entries in v.
        """
        points, frames = list(getattr(module, "POINTS", ())), self.frames - 1
        count = len(self.layout.v.joint_places)
        first = 1 + (points.index("O2") if "O2" in points else 0) + self.rotors
        if len(points) != first + count + frames or not hasattr(module, "CARRIERS"):
            return None
        joints = slice(first, first + count)
        places = {point: k for k, point in enumerate(points[joints], start=1)}
        return [places.get(carrier, 0) for carrier in module.CARRIERS[joints]]

    def coordinates(self, name: str = "q", uniform: bool = False) -> Node:
        """Coordinates (nq) as an input of a program.

        Args:
            name: Name by which they are given.
            uniform: Whether all states share them.

        Returns:
            The node.
        """
        return variable(name, self.space.coordinates, uniform=uniform, space=self.space)

    def velocities(self, name: str = "v", uniform: bool = False) -> Node:
        """Velocities (nv), or accelerations or displacements, as an input of a program.

        Args:
            name: Name by which they are given.
            uniform: Whether all states share them.

        Returns:
            The node.
        """
        return variable(name, self.space.velocities, uniform=uniform)

    def state(self) -> tuple[Node, Node]:
        """The inputs q and v."""
        return self.coordinates(), self.velocities()

    def wheel_rates(self, q: Node, v: Node) -> Node:
        """Rates of the angles of wheels.

        Args:
            q: Coordinates (nq).
            v: Velocities (nv).

        Returns:
            The node, rad/s.
        """
        return self.outputs("coordinate_rates", q, v)[0][self.layout.q.angles]

    def integrate(self, q: Node, displacement: Node) -> Node:
        """Coordinates after a displacement: a sum, unless it is along a base's own axes.

        Args:
            q: Coordinates (nq).
            displacement: Displacement along each velocity (nv), rad or m.

        Returns:
            The node.
        """
        if not self.space.is_flat:
            return self.outputs("integrate", q, displacement)[0]
        return coordinates_of(entries_of(q) + displacement, self.space)

    def displaced(self, q: Node, displacement: Node) -> Node:
        """As `integrate`, of a displacement in all directions (nd): `displacement` leads back.

        Args:
            q: Coordinates (nq).
            displacement: In rad or m; with a drive ahead, sideways, about z and of joints.

        Returns:
            The node.
        """
        if not self.space.has_drive:
            return self.integrate(q, displacement)
        ahead, side, rest = displacement[:1], displacement[1:2], displacement[2:]
        moved, turned = entries_of(self.integrate(q, join(ahead, rest))), self._turned(q)
        across = entries_of(self.integrate(turned, join(side, rest))) - entries_of(turned)
        place = moved[: self.space.travels] + across[: self.space.travels]
        return coordinates_of(join(place, moved[self.space.travels :]), self.space)

    def away(self, q: Node, other: Node) -> Node:
        """The displacement (nv) from coordinates to others: as of `integrate`, their difference.

        Args:
            q: Coordinates (nq).
            other: Coordinates (nq).

        Returns:
            The node.
        """
        if not self.space.is_flat:
            return self.outputs("difference", q, other)[0]
        return entries_of(other) - entries_of(q)

    def displacement(self, q: Node, other: Node) -> Node:
        """As `away`, in all directions (nd): with a drive sideways too, between ahead and about z.

        Args:
            q: Coordinates (nq).
            other: Coordinates (nq).

        Returns:
            The node.
        """
        moved = self.away(q, other)
        if not self.space.has_drive:
            return moved
        sideways = self.away(self._turned(q), self._turned(other))[:1]
        return join(moved[:1], sideways, moved[1:])

    def _turned(self, q: Node) -> Node:
        """Coordinates with the base a quarter turn on, ahead of which lies what was sideways."""
        turn = 0.5 * np.pi * (np.arange(self.space.coordinates) == self.space.travels)
        return coordinates_of(entries_of(q) + turn, self.space)

    def outputs(self, name: str, *arguments: Node) -> tuple[Node, ...]:
        """The outputs of a function, as many as it has.

        Args:
            name: Name of the function.
            arguments: Nodes for its arguments, in their order.

        Returns:
            A node for each output.

        Raises:
            MissingFunctionError: If the module was generated without the function.
            UsageError: If the arguments do not match the function.
        """
        if name not in self.signatures:
            options = options_with([name], [*self.signatures])
            raise MissingFunctionError(self.name, [name], options)
        signature = self.signatures[name]
        expected = list(zip(signature.arguments, signature.argument_shapes, strict=True))
        if len(arguments) != len(expected):
            raise UsageError(f"{name} takes {', '.join(signature.arguments)}")
        for x, (argument, shape) in zip(arguments, expected, strict=True):
            space = self.space if ARGUMENTS[argument].is_coordinates else None
            if (x.shape, x.space) != (shape, space):
                kind = "coordinates" if space else "a vector"
                raise UsageError(f"{name}: {argument} is {kind} of shape {shape}, not {x}")
        return tuple(
            node(
                Call(self, name, place),
                arguments,
                shape,
                self.space if output.is_coordinates else None,
            )
            for place, (output, shape) in enumerate(
                zip(FUNCTIONS[name].outputs, signature.shapes, strict=True)
            )
        )

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """A call of a function of the table."""
        if name not in FUNCTIONS:
            raise AttributeError(name)
        return partial(self._call, name)

    def _call(self, name: str, *arguments: Node) -> Node | tuple[Node, ...]:
        if name in self._trivial:
            return arguments[-1][self._trivial[name]]
        outputs = self.outputs(name, *arguments)
        return outputs[0] if len(outputs) == 1 else outputs
