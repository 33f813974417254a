"""The description in a module: names, units, meanings, places, topology, limits.

Everything is computed once, when it is first read, and handed on with the robot's symbols and its
program. The constants of a generated module are `Description.constants`.

Base parameters are the fewest numbers of the bodies that determine the equations of motion. Of a
body's ten numbers, mass, first moment and second moments about its joint, a joint only feels some;
the others are added to those of the parent, as `derivation.segment_tree` does it. What is left
with each body is independent of all others, whatever the lengths: if the base flies freely, its ten
can all be told apart, and from the leaves inwards so can what each joint feels. The dynamics is
linear in these parameters. Of another base some may have no effect.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

from gibbs_codegen.interface import FUNCTIONS, LISTS
from gibbs_codegen.robot.layout import Layout, StateEntries, frames_of, joint_terms, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import (
    coordinate_of,
    default_prefix,
    identifier,
    joint_label,
    link_label,
    parameter_prefix,
    rotor_identifier,
)
from gibbs_codegen.robot.parts.base import TRAVELS, TURNS
from gibbs_codegen.robot.parts.constraint import ROWS
from gibbs_codegen.robot.parts.link import Link, LinkKind
from gibbs_codegen.robot.parts.numbers import AXIS_PAIRS, BASE
from gibbs_codegen.robot.parts.rotor import AIR_KEYS, Rotor
from gibbs_codegen.robot.posture import closed_loops, default_posture

# The numbers of a body, ∫dm, ∫r dm and ∫rrᵀ dm, in the order of `derivation.inertia.Inertia`.
NUMBERS = {
    "mass": "kg",
    **{f"moment_{axis}": "kg m" for axis in "xyz"},
    **{f"second_{axes}": "kg m^2" for axes in AXIS_PAIRS},
}
# Those that are its parent's, by the joint along z that carries the body.
PARENTS_NUMBERS: dict[LinkKind, tuple[str, ...]] = {
    "revolute": ("mass", "moment_z", "second_zz"),
    "prismatic": tuple(name for name in NUMBERS if name.startswith("second")),
}
# What a state of an actuator belongs to: "rotor" or "link" with its number, or ("charge", 0).
ActuatorKey = tuple[str, int]
# Components of a wrench.
WRENCH_PARTS = ("fx", "fy", "fz", "tx", "ty", "tz")
_ORIGINS = {"motor1": "motor 1 (O1)", "centre": "the base centre (O2)", "base": "the base's frame"}


@dataclass(frozen=True)
class Coordinate:
    """One entry of q, v, a, u or of the hybrid unknowns: its name, unit and meaning."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Description:
    """Entries of the arguments and results of a robot's functions, and what its module says.

    In emitted functions an entry that the robot file gives no name is called as in the lists of a
    module, such as theta_7 and v_theta_7. Names that people give may be anything: a word of C or
    Python, or what another variable is called. They get endings that nothing else has: forearm_q,
    forearm_v, forearm_F.
    """

    robot: Robot

    @cached_property
    def layout(self) -> Layout:
        """Places, names and units of the entries of q and v."""
        return layout_of(self.robot)

    @cached_property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The nq entries of q: attitude and position of the base, and the arm's joints."""
        layout = self.layout
        if layout.is_quaternion:
            parts = ("x", "y", "z", "scalar")
            attitude = [f"{part} part of the attitude quaternion" for part in parts]
        elif layout.moves_freely:
            places = zip(("first", "second", "third"), layout.attitude, strict=True)
            attitude = [f"{place} attitude angle, about {axis}" for place, axis in places]
        else:
            turns = TURNS if layout.turns_with_base else layout.q.names[layout.q.attitude]
            attitude = [f"{turn} of the base" for turn in turns]
        travels = tuple(TRAVELS) if layout.turns_with_base else layout.q.names[layout.q.position]
        position = [f"world {axis} of {_ORIGINS[self.robot.base.origin]}" for axis in travels]
        if not layout.moves_freely:  # Where it is with its pose differs.
            position = [f"travel of the base along the world's {axis}" for axis in travels]
        units = (*layout.q.units[layout.q.joints], *layout.q.units[layout.q.angles])
        quantities = ["travel" if unit == "m" else "angle" for unit in units]
        return self._entries(layout.q, [*attitude, *position], quantities)

    @cached_property
    def velocities(self) -> tuple[Coordinate, ...]:
        """The nv entries of v: rates of q, or of the base its velocities in its own frame."""
        layout, origin = self.layout, _ORIGINS[self.robot.base.origin]
        if layout.turns_with_base:
            base = [f"angular velocity of the base, about its {axis} axis" for axis in "xyz"]
            if not layout.moves_freely:  # Its own axes are those without its pose.
                origin = "the base"
            base += [f"velocity of {origin}, along the base's {axis} axis" for axis in "xyz"]
        else:
            base = [f"rate of {layout.q.names[place]}" for place in layout.q.base]
        return self._entries(layout.v, base, ["rate"] * len(self.robot.moving))

    def _entries(
        self, entries: StateEntries, base: list[str], joints: list[str]
    ) -> tuple[Coordinate, ...]:
        """Entries of q or of v with meanings: the base's own, attitude first, and of the joints.

        `joints` say what the entry of each is of it.
        """
        labels = (joint_label(self.robot, i) for i in self.robot.driven)
        of_joints = [
            f"{quantity} of {label}" for quantity, label in zip(joints, labels, strict=False)
        ]
        meanings = entries.joined(base, of_joints)
        return tuple(map(Coordinate, entries.names, entries.units, meanings))

    @property
    def free_unknowns(self) -> tuple[Coordinate, ...]:
        """Velocities of which the free unknowns of the hybrid system are the rates.

        The coordinates, or the velocities where they are along and about the base's own axes.
        """
        return self.velocities if self.layout.turns_with_base else self.coordinates

    @cached_property
    def hybrid_coordinates(self) -> tuple[Coordinate, ...]:
        """The 6 + n + 2c hybrid unknowns, of n joints that move and c constrained ones."""
        free, first = self.free_unknowns, self.layout.constrained.start
        held = (constrained_coordinate(self.robot, arm) for arm in constrained_arms(self.robot))
        return (*free[:first], *held, *free[first:], *self.constraint_torques)

    @cached_property
    def constraint_torques(self) -> tuple[Coordinate, ...]:
        """The torques that hold base rods 2 to N, then links."""
        return tuple(constraint_torque(self.robot, arm) for arm in constrained_arms(self.robot))

    @cached_property
    def inputs(self) -> tuple[Coordinate, ...]:
        """Entries of u: N thrusts, then n torques of joints that move (forces where prismatic).

        Torques of wheels come last.
        """
        robot, inputs = self.robot, []
        for k in range(1, robot.rotors + 1):
            label = rotor_identifier(robot, k)
            inputs.append(Coordinate(f"F_{label}", "N", f"thrust of motor {label}"))
        for i in robot.driven:
            link, name = robot.links[i - 1], coordinate_of(robot, i)
            unit = joint_terms(robot, i).effort_unit
            kind = "force" if unit == "N" else "torque"
            suffix = name if link.name or link.coordinate else name.partition("_")[2]
            inputs.append(Coordinate(f"tau_{suffix}", unit, f"{kind} of {joint_label(robot, i)}"))
        return tuple(inputs)

    @cached_property
    def commands(self) -> tuple[Coordinate, ...]:
        """Commands of motors and servos, in the order of u; none without actuators."""
        robot, commands = self.robot, []
        if not robot.has_actuators:
            return ()
        for entry, drive in zip(self.inputs, robot.drives, strict=False):
            label = entry.name.removeprefix("F_")
            unit, quantity = {"speed": ("rad/s", "speed"), "throttle": ("1", "throttle")}.get(
                drive.command, ("N", "thrust")
            )
            name = entry.name if unit == "N" else f"{quantity}_{label}"
            commands.append(Coordinate(name, unit, f"{quantity} of motor {label}"))
        for entry, i in zip(self.inputs[robot.rotors :], robot.driven, strict=True):
            if (servo := robot.links[i - 1].servo) is None:
                commands.append(entry)
                continue
            unit = joint_terms(robot, i).unit + "/s" * (servo.command == "rate")
            name = f"{coordinate_of(robot, i)}_{servo.command}"
            commands.append(Coordinate(name, unit, f"{servo.command} of {joint_label(robot, i)}"))
        return tuple(commands)

    @cached_property
    def actuator_keys(self) -> tuple[ActuatorKey, ...]:
        """Owners of the states of the actuators: rotors, from 1, links, the battery."""
        robot = self.robot
        if not self.commands:
            return ()
        rotors = [("rotor", k) for k, drive in enumerate(robot.drives, start=1) if drive.lags]
        servos = [(i, robot.links[i - 1].servo) for i in robot.moving]
        links = [("link", i) for i, servo in servos if servo and servo.delay > 0.0]
        return (*rotors, *links, *([("charge", 0)] if robot.battery else []))

    @cached_property
    def actuator_states(self) -> tuple[Coordinate, ...]:
        """The state of the actuators: levels of rotors, references of servos, charge."""
        states = []
        for kind, i in self.actuator_keys:
            if kind == "charge":
                states.append(Coordinate("charge", "1", "charge of the battery, 1 when full"))
            elif kind == "rotor":
                states.append(self.commands[i - 1])
            else:
                place = self.robot.rotors + self.robot.moving.index(i)
                command, label = self.commands[place], joint_label(self.robot, i)
                name = f"{coordinate_of(self.robot, i)}_reference"
                states.append(Coordinate(name, command.unit, f"reference of {label}"))
        return tuple(states)

    @cached_property
    def constraint_rows(self) -> tuple[Coordinate, ...]:
        """Rows of the constraints one after the other: their errors, m or rad."""
        rows = []
        for constraint in self.robot.constraints:
            label = identifier(constraint.name)
            for row in ROWS[constraint.holds]:
                turns = row.startswith("turn")
                meaning = f"{row.replace('_', ' about ') if turns else row} of {label}"
                rows.append(Coordinate(f"{label}_{row}", "rad" if turns else "m", meaning))
        return tuple(rows)

    def _of_constraints(self) -> dict[str, Any]:
        """The places of the rows of each constraint, and which are loops of a mechanism."""
        places, start = {}, 0
        for constraint in self.robot.constraints:
            places[identifier(constraint.name)] = slice(start, start + len(ROWS[constraint.holds]))
            start += len(ROWS[constraint.holds])
        joints = self.layout.q.names[self.layout.q.joints]
        names = dict(zip(self.robot.moving, joints, strict=True))
        loops = {
            identifier(loop.name): tuple(names[i] for i in free)
            for loop, free in closed_loops(self.robot).items()
        }
        return {"CONSTRAINT_PLACES": places, "LOOPS": loops}

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of points, in the order of `positions`.

        No two are of one name: the later of two says what it is as well.
        """
        robot = self.robot
        names = ["O1", "O2"] if robot.base.rotors else ["base"]
        names += [f"motor{k}" for k in range(1, robot.base.rotors + 1)]
        placed = [
            ("rotor", identifier(rotor.name) if rotor.name else default_prefix("rotor", k))
            for k, rotor in enumerate(robot.thrusters, start=1)
        ]
        for i in robot.gearing:
            link = robot.links[i - 1].name
            joint = f"joint_{identifier(link)}" if link else f"joint{robot.rotors + i}"
            placed.append(("joint", joint))
        placed += [("frame", name) for name in self.frames[1:]]
        # No rotor may pass for the tip, nor a frame for the base centre.
        taken = {"O1", "O2", "base"}
        for kind, name in placed:
            reserved = taken if kind == "frame" else taken | {"tip"}
            while name in reserved or name in names:
                name = f"{kind}_{name}"
            names.append(name)
        return tuple(names)

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Identifiers of the frames, in the order of `frames_of`."""
        return tuple(identifier(frame.name) for frame in frames_of(self.robot))

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """Identifiers of bodies that a joint, which may be held or welded, connects to another.

        They are the base's rods base_arm2 … base_armN, then the links.
        """
        rods = (f"base_arm{k}" for k in range(2, self.robot.base.rotors + 1))
        links = (
            identifier(link.name) if link.name else default_prefix("link", i)
            for i, link in enumerate(self.robot.links, start=1)
        )
        return (*rods, *links)

    @property
    def base_parameters(self) -> tuple[Coordinate, ...]:
        """The base parameters: of the base, then of each link whose joint moves."""
        robot = self.robot
        moved: list[tuple[str, tuple[str, ...]]] = []
        if self.layout.q.base and not robot.base.virtual_joints:
            moved.append(("base", ()))
        for part in robot.base.virtual_joints:
            kind: LinkKind = "prismatic" if part in TRAVELS else "revolute"
            moved.append((f"base_{part}", PARENTS_NUMBERS[kind]))
        for i in robot.gearing:
            parents = PARENTS_NUMBERS[robot.links[i - 1].joint]
            moved.append((parameter_prefix(robot, i), parents))
        parameters: list[Coordinate] = []
        for prefix, parents in moved:
            units = {name: unit for name, unit in NUMBERS.items() if name not in parents}
            parameters += [Coordinate(f"{prefix}_{name}", unit, "") for name, unit in units.items()]
        return tuple(parameters)

    @property
    def explained(self) -> dict[str, tuple[Coordinate, ...]]:
        """Entries that have units, by the module's constants that list their names."""
        return {
            "COORDINATES": self.coordinates,
            "VELOCITIES": self.velocities,
            "HYBRID_COORDINATES": self.hybrid_coordinates,
            "INPUTS": self.inputs,
            "BASE_PARAMETERS": self.base_parameters,
            "COMMANDS": self.commands,
            "ACTUATOR_STATES": self.actuator_states,
            "CONSTRAINT_ROWS": self.constraint_rows,
        }

    def lists(self, functions: Collection[str] = ()) -> dict[str, tuple[str, ...]]:
        """Names of what arguments and results have entries or rows for, by the module's constants.

        Base parameters are among them where one of `functions` has entries for them.
        """
        lists = {
            "COORDINATES": self.layout.q.names,
            "VELOCITIES": self.layout.v.names,
            "HYBRID_COORDINATES": tuple(c.name for c in self.hybrid_coordinates),
            "INPUTS": tuple(c.name for c in self.inputs),
            "POINTS": self.points,
            "FRAMES": self.frames,
            "BODIES": self.bodies,
        }
        if self.commands:
            lists["ROTORS"] = lists["INPUTS"][: self.robot.rotors]
            lists["COMMANDS"] = tuple(c.name for c in self.commands)
            lists["ACTUATOR_STATES"] = tuple(c.name for c in self.actuator_states)
        if self.robot.constraints:
            lists["CONSTRAINTS"] = tuple(identifier(c.name) for c in self.robot.constraints)
            lists["CONSTRAINT_ROWS"] = tuple(row.name for row in self.constraint_rows)
        outputs = [output for name in functions for output in FUNCTIONS[name].outputs]
        if any(LISTS.get(letter) == "BASE_PARAMETERS" for o in outputs for letter in o.shape):
            lists["BASE_PARAMETERS"] = tuple(entry.name for entry in self.base_parameters)
        return lists

    @cached_property
    def local_names(self) -> dict[str, tuple[str, ...]]:
        """Names of the entries of all arguments, by the names of `interface.ARGUMENTS`."""
        robot, layout = self.robot, self.layout
        links = {coordinate_of(robot, i): robot.links[i - 1] for i in robot.driven}
        labelled = {name for name, link in links.items() if link.coordinate or link.name}
        names = {}
        for argument in ("q", "q0", "q1", "v", "a", "w", "q_dot", "v_dot", "a_dot", "v_r", "a_r"):
            entries = layout.q if argument in ("q", "q0", "q1") else layout.v
            ending = {"a": "rate"}.get(argument, argument)
            beginning = "" if argument == "q" else f"{argument}_"
            names[argument] = tuple(
                f"{entry}_{ending}" if entry in labelled else f"{beginning}{entry}"
                for entry in entries.names
            )
        # F_1, or rotor_F where it has a name, and likewise of the joints.
        named = [rotor.name is not None for rotor in robot.thrusters] or [False] * robot.rotors
        named += [name in labelled for name in links]
        parts = [entry.name.partition("_")[::2] for entry in self.inputs]
        names["u"] = tuple(
            f"{rest}_{letter}" if has_name else f"{letter}_{rest}"
            for (letter, rest), has_name in zip(parts, named, strict=True)
        )
        names["u_dot"] = tuple(f"{name}_dot" for name in names["u"])
        names["h"] = ("time_step",)
        # Endings that no parameter has, and no coordinate.
        names["x"] = tuple(f"{entry.name}_state" for entry in self.actuator_states)
        names["command"] = tuple(f"{entry.name}_command" for entry in self.commands)
        for argument in ("active", "restitution"):
            names[argument] = tuple(f"{identifier(c.name)}_{argument}" for c in robot.constraints)
        names["W"] = tuple(f"W_{frame}_{part}" for frame in self.frames for part in WRENCH_PARTS)
        names["W_dot"] = tuple(f"{name}_dot" for name in names["W"])
        velocities, inputs = layout.v.names, [entry.name for entry in self.inputs]
        names["w_input_matrix"] = tuple(f"w_B_{i}_{j}" for i in velocities for j in inputs)
        names["w_jacobian"] = tuple(f"w_J_{i}_{j}" for i in "xyz" for j in velocities)
        return names

    @cached_property
    def constants(self) -> dict[str, Any]:
        """Constants of a module on its robot besides names of entries, by their names.

        Tuples have a value for each of what they follow; dicts have the entries that the robot
        file says something of, by their names, and None is no limit.
        """
        robot, layout = self.robot, self.layout
        driven = (*layout.q.names[layout.q.joints], *layout.q.names[layout.q.angles])
        joints = dict(zip(driven, robot.driven, strict=True))
        limits = {name: robot.links[i - 1].limits for name, i in joints.items()}
        inputs = [entry.name for entry in self.inputs]
        rotors = dict(zip(inputs, robot.thrusters, strict=False))
        drives = dict(zip(inputs, robot.drives, strict=False))
        most = zip(inputs[robot.rotors :], joints.values(), strict=True)
        bounds: dict[str, Bounds] = {
            name: drive.thrust_limits or (None, None) for name, drive in drives.items()
        }
        bounds |= {name: _either_way(robot.links[i - 1].drive_limits.effort) for name, i in most}
        rods = len(self.bodies) - len(robot.links)
        names = ("base", *self.bodies[rods:])
        return {
            "COORDINATE_UNITS": layout.q.units,
            "VELOCITY_UNITS": layout.v.units,
            "INPUT_UNITS": tuple(entry.unit for entry in self.inputs),
            "COORDINATE_PLACES": _places(layout.q),
            "VELOCITY_PLACES": _places(layout.v),
            "CARRIERS": self._carriers(),
            "PARENTS": ("base",) * rods + tuple(names[parent] for parent in robot.parents),
            "COORDINATE_LIMITS": _bounded(
                {n: (joint.low, joint.high) for n, joint in limits.items()}
            ),
            "VELOCITY_LIMITS": _bounded(
                {name: _either_way(joint.velocity) for name, joint in limits.items()}
            ),
            "INPUT_LIMITS": _bounded(bounds),
            "TIME_CONSTANTS": {n: r.time_constant for n, r in rotors.items() if r.time_constant},
            # A rotor spins against the torque that its drag does to the robot.
            "SPINS": {
                name: -math.copysign(rotor.spin_inertia * rotor.speed_per_sqrt_thrust, rotor.drag)
                for name, rotor in rotors.items()
                if rotor.spin_inertia and rotor.speed_per_sqrt_thrust
            },
            "POSTURE": tuple(default_posture(robot).tolist()),
            **(self._of_actuators() if self.commands else {}),
            **(self._of_constraints() if robot.constraints else {}),
        }

    def _of_actuators(self) -> dict[str, Any]:
        """Units and limits of commands, and times in which actuators follow them."""
        robot = self.robot
        names = [entry.name for entry in self.commands]
        joints = [robot.links[i - 1] for i in robot.driven]
        drives = dict(zip(names, robot.drives, strict=False))
        limits: dict[str, Bounds] = {n: d.limits for n, d in drives.items() if d.limits}
        times = {name: (drive.up, drive.down) for name, drive in drives.items() if drive.lags}
        for name, link in zip(names[robot.rotors :], joints, strict=True):
            if link.servo is None:
                limits[name] = _either_way(link.limits.effort)
                continue
            limits[name] = link.limits.low, link.limits.high
            if link.servo.command == "rate":
                limits[name] = _either_way(link.drive_limits.velocity)
            if link.servo.delay > 0.0:
                times[name] = link.servo.delay, link.servo.delay
        return {
            "COMMAND_UNITS": tuple(entry.unit for entry in self.commands),
            "COMMAND_LIMITS": _bounded(limits),
            "ACTUATOR_TIMES": times,
            "DRIVE_PARAMETERS": {
                coordinate_of(robot, i): {
                    ending: f"{parameter_prefix(robot, i)}_{ending}"
                    for ending in _numbers_of_drive(link)
                }
                for i, link in zip(robot.driven, joints, strict=True)
                if link.servo or link.friction
            },
            "ROTOR_AIR": {
                self.inputs[k - 1].name: (identifier(frame.name), *_air(robot.thrusters[k - 1]))
                for frame in frames_of(robot)
                if (k := frame.rotor)
            },
        }

    def _carriers(self) -> tuple[str, ...]:
        """Carriers of the points: the point of the joint that moves one, or the centre."""
        robot, rods = self.robot, self.robot.base.rotors
        centre = "O2" if rods else "base"
        joints = self.points[self.points.index(centre) + 1 + robot.rotors :]
        carriers = dict(zip((BASE, *robot.gearing), (centre, *joints), strict=False))
        bodies = [BASE] * (2 + rods if rods else 1)
        bodies += [rotor.on for rotor in robot.thrusters]
        bodies += [robot.parents[i - 1] for i in robot.gearing]
        bodies += [frame.on for frame in frames_of(robot)[1:]]
        return tuple(carriers[robot.rigid[body]] for body in bodies)

    def coordinate_text(self, place: int) -> str:
        """The entry of v at a place, from 0, in a message: "theta_8 (the joint of link 2)"."""
        v = self.layout.v
        name, joints = v.names[place], v.joint_places
        if place not in joints:
            return name
        link = self.robot.moving[joints.index(place)]
        return f"{name} (the joint of {link_label(self.robot, link)})"


def _places(entries: StateEntries) -> dict[str, slice]:
    """The places of attitude, joints and position."""
    return {"attitude": entries.attitude, "joints": entries.joints, "position": entries.position}


Bounds = tuple[float | None, float | None]


def _numbers_of_drive(link: Link) -> list[str]:
    """Ends of names of parameters of a servo and dry friction, beside the armature's."""
    numbers = [f"servo_{name}" for name in link.servo.parameters()] if link.servo else []
    numbers += [f"friction_{name}" for name in link.friction.parameters()] if link.friction else []
    return ["armature", *numbers]


def _air(rotor: Rotor) -> tuple[float, ...]:
    """Direction of a rotor, and what the air does to it: 1 for ground effect, pairs at the end."""
    *keys, by_advance = AIR_KEYS
    numbers = (float(getattr(rotor, key) or 0.0) for key in keys)
    return (*rotor.direction, *numbers, *chain(*(getattr(rotor, by_advance) or ())))


def _either_way(most: float | None) -> Bounds:
    return (None if most is None else -most, most)


def _bounded(limits: Mapping[str, Bounds]) -> dict[str, Bounds]:
    """Those of some limits that are any, None where there is none."""
    bounded: dict[str, Bounds] = {}
    for name, ends in limits.items():
        low, high = (None if end is None or math.isinf(end) else end for end in ends)
        if low is not None or high is not None:
            bounded[name] = (low, high)
    return bounded


def constrained_coordinate(robot: Robot, arm: int) -> Coordinate:
    """The angle of a joint that a constraint torque holds, such as θ_k of a base rod.

    `arm` is that of the rod, 2 to N, or N + i for link i.
    """
    if arm <= robot.base.rotors:
        return Coordinate(f"theta_{arm}", "rad", f"constrained angle of base arm {arm}")
    i = arm - robot.rotors
    return Coordinate(
        coordinate_of(robot, i), "rad", f"constrained angle of {joint_label(robot, i)}"
    )


def constraint_torque(robot: Robot, arm: int) -> Coordinate:
    """The torque that holds a joint, such as τ'_k of a base rod.

    `arm` is that of the rod, 2 to N, or N + i for link i.
    """
    if arm <= robot.base.rotors:
        return Coordinate(f"tau_prime_{arm}", "N m", f"constraint torque on base arm {arm}")
    i = arm - robot.rotors
    name = coordinate_of(robot, i)
    suffix = name.removeprefix("theta_") if robot.links[i - 1].name is None else name
    return Coordinate(f"tau_prime_{suffix}", "N m", f"constraint torque of {joint_label(robot, i)}")


def constrained_arms(robot: Robot) -> tuple[int, ...]:
    """Arms that constraint torques hold: base rods 2 to N, then N + i for links i."""
    rods = range(2, robot.base.rotors + 1)
    return (*rods, *(robot.rotors + i for i in robot.constrained))
