"""A generated module at rest in some posture: its parts, what acts in it, and its scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.figures.appearance import COLOURS, VIEW, disc_radius, seen_from
from gibbs_codegen.flight.attitude import quaternion_of, rotation_matrix
from gibbs_codegen.flight.desired.demands import needed_inputs
from gibbs_codegen.flight.plant.actuators import module_actuators
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.series import Array, Flight, point_parents
from gibbs_codegen.flight.vectors import Indices

# The largest disc, as a share of the reach of a robot's points.
_LARGEST_DISC = 0.4
# Accelerations, m/s² and rad/s², and shares of the largest entry, below which there is none.
_STILL, _ZERO = 1e-6, 1e-12
# Postures that show which entries of the hybrid system are filled.
_POSTURES = 4
# How far angles without limits go, rad.
_TURN = float(np.pi)
# Colours of rotors, thrusts and other forces; of rods without an effort, and with the largest.
ROTOR, THRUST, FORCE = COLOURS[4], COLOURS[7], COLOURS[2]
RELAXED, LOADED = "#8d99a6", "#d00000"
_JOINT_COLOUR = "#262626"
# Shares of the size of a robot: radii of rods, joints and arrows, lengths of arrows and of axes;
# share of the radius of a rotor: its thickness.
_ROD, _JOINT, _ARROW, _LENGTH, _AXES, _DISC = 0.008, 0.014, 0.012, 0.3, 0.08, 0.06
# Rounding and control leave less than this share of the weight, or for torques of weight × size.
_NOISE = 1e-6
# How much longer than others an arrow may be.
_LONGEST = 1.5
# About the share of a robot's size to which places in a file are rounded.
_GRAIN = 2.0**-12
_UP = np.array([[0.0, 0.0, 1.0]])
# Angle of view of the camera, rad; and how near it is, in distances from which all would be seen.
_FIELD_OF_VIEW, _CLOSE = 0.8, 0.8
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]
_SIDES, _RINGS = 16, 9
# The start of the head of an arrow of unit length and width, and the thickness of its shaft.
_NECK, _SHAFT = 0.7, 0.4
# What is smaller nobody sees, and without it a file is half as long: steps of components of
# quaternions, and of lengths in units of the scene's grain.
_TURN_GRAIN = 2.0**-12


@dataclass(frozen=True)
class Rest:
    """A robot at rest, with all that is computed of it.

    - `q` (nq), `u` (nu): coordinates and inputs, `a` (nv): accelerations
    - `points` (k, 3), `directions` (N, 3), `frames` (f, 4, 4): in the world, as in `MachineScene`
    - `constraint_torques` (c), N m
    - `system` (m, m + 1 + nu): I_H, R_H and B_H of the hybrid system
    - `conditions`: those of M and of I_H, infinite where they are singular
    """

    q: Array
    u: Array
    a: Array
    points: Array
    directions: Array
    frames: Array
    constraint_torques: Array
    system: Array
    conditions: tuple[float, float]

    @property
    def is_still(self) -> bool:
        """True if the inputs hold the robot where it is."""
        return bool(np.all(np.abs(self.a) < _STILL))


class DrawnMachine:
    """A generated module, with the back end "numpy" or "c", whose parameters can be changed."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module
        self._parameters: dict[str, float] = {}
        self.vehicle = Vehicle(module)
        actuators = module_actuators(self.vehicle)
        self.input_limits, self.joint_limits = actuators.inputs, actuators.joints
        self.parents = point_parents(self.vehicle).tolist()
        layout, joints = self.vehicle.layout, self.vehicle.joints
        # Controls by what they are: angles of the attitude, joints, and the position.
        turns = 3 if layout.is_quaternion else len(layout.angle_axes)
        self._joints = slice(turns, turns + joints)
        self.swinging = turns + joints if layout.moves_freely else layout.displaced.size

    def set_parameters(self, parameters: dict[str, float]) -> None:
        """Take other parameters of `prepare`; those not given get their defaults.

        Raises `UsageError` if `prepare` rejects them; the ones before stay.
        """
        if parameters != self._parameters:
            self.vehicle = Vehicle(self.module, parameters)
            self._parameters = dict(parameters)

    @property
    def arms(self) -> int:
        """Number of base arms that constraints hold."""
        return max(len(self.vehicle.arm_angles()) - 1, 0)

    def start(self) -> Array:
        """The start of controls: level, with joints bent so that the arms can be seen."""
        controls = np.zeros(self.vehicle.layout.displaced.size)
        controls[self._joints] = self.vehicle.description("POSTURE")[self.vehicle.arm]
        return controls

    def controls(self, room: float) -> tuple[list[str], Array]:
        """Names with units of the robot's coordinates, and their least and greatest values (2, n).

        They are angles of the attitude, which are roll, pitch and yaw instead of a quaternion,
        joints and position. `room` is how far those go that are lengths without limits, m.
        """
        vehicle = self.vehicle
        names, units = vehicle.layout.q.names, vehicle.layout.q.units
        entries = [*zip(names, units, strict=True)]
        attitude = entries[vehicle.layout.q.attitude]
        if vehicle.layout.is_quaternion:
            attitude = [("roll", "rad"), ("pitch", "rad"), ("yaw", "rad")]
        chosen = [*attitude, *entries[vehicle.arm], *entries[vehicle.layout.q.position]]
        rooms = np.array([_TURN if unit == "rad" else room for _, unit in chosen])
        low, high = -rooms, rooms
        for ends, limits in zip((low, high), self.joint_limits, strict=True):
            ends[self._joints] = np.where(np.isfinite(limits), limits, ends[self._joints])
        return [f"{name}, {unit}" for name, unit in chosen], np.stack([low, high])

    def input_controls(self, u: Array, room: float) -> tuple[list[str], Array]:
        """Names with units of the robot's inputs, and their least and greatest values (2, nu).

        Inputs without limits go as far as `room` in the largest usual one, of `u`, of their unit.
        """
        vehicle = self.vehicle
        units = np.array(vehicle.input_units)
        usual = [room * float(np.abs(u[units == unit]).max()) or 1.0 for unit in units]
        ends = np.outer([-1.0, 1.0], usual)
        ends = np.where(np.isfinite(self.input_limits), self.input_limits, ends)
        return [f"{n}, {unit}" for n, unit in zip(vehicle.inputs, units, strict=True)], ends

    def beyond(self, u: Array) -> list[str]:
        """A sentence for each input that exceeds the limits of the robot file."""
        sides = zip(self.vehicle.inputs, u, *self.input_limits, strict=True)
        return [
            f"{name} = {value:.4g} is beyond its limits, {low:.4g} to {high:.4g}."
            for name, value, low, high in sides
            if value < low - _STILL or value > high + _STILL
        ]

    def coordinates(self, controls: Array) -> Array:
        """Coordinates (nq) of angles of the attitude, joints and position."""
        layout, (first, last) = self.vehicle.layout, (self._joints.start, self._joints.stop)
        q = self.vehicle.neutral
        turns, q[layout.q.joints], q[layout.q.position] = np.split(controls, [first, last])
        if layout.is_quaternion:
            turns = quaternion_of(rotation_matrix("zyx", turns[::-1]))
        q[layout.q.attitude] = turns
        return q

    def hover(self, q: Array) -> Array:
        """The inputs (nu) of least thrust that hold the robot, or do so as nearly as they can.

        They know no limits.
        """
        still = np.zeros(self.vehicle.layout.v.size)
        return needed_inputs(self.vehicle, q, still, still)

    def state(self, q: Array, u: Array) -> Rest:
        """The robot at rest; what is undetermined is no number."""
        vehicle = self.vehicle
        still = np.zeros(vehicle.layout.v.size)
        with np.errstate(all="ignore"):
            a = vehicle.forward_dynamics(q, still, u)
            matrix = vehicle.mass_matrix(q)
            system = self.hybrid_system(q)
            hybrid = system[:, : len(system)]
            return Rest(
                q,
                u,
                a,
                vehicle.positions(q),
                self.directions(q),
                vehicle.frame_poses(q),
                vehicle.constraint_torques(q, still, a, u),
                system,
                (float(np.linalg.cond(matrix)), float(np.linalg.cond(hybrid))),
            )

    def hybrid_system(self, q: Array) -> Array:
        """I_H, R_H and B_H of the robot at rest beside each other, (m, m + 1 + nu)."""
        function = self.vehicle.function
        residual = function("hybrid_residual")(q, np.zeros(self.vehicle.layout.v.size))
        matrix, inputs = function("hybrid_mass_matrix")(q), function("hybrid_input_matrix")(q)
        return np.hstack([matrix, residual[:, np.newaxis], inputs])

    def pattern(self) -> NDArray[np.bool_]:
        """True for entries of the hybrid system at rest that are not zero in every posture."""
        generator = np.random.default_rng(1)
        filled = np.zeros((1, 1), dtype=bool)
        for _ in range(_POSTURES):
            q = self.coordinates(generator.uniform(0.2, 1.2, self.vehicle.layout.displaced.size))
            filled = filled | changed(self.hybrid_system(q), np.zeros((1, 1)))
        return filled

    def directions(self, q: Array) -> Array:
        """Unit vectors (N, 3) of the thrusts in the world; up where the base moves along none."""
        forces = (self.vehicle.base_rotation(q) @ self.vehicle.thrust_wrenches(q)[:3]).T
        sizes = np.linalg.norm(forces, axis=1, keepdims=True)
        return np.where(sizes > 0.0, forces, _UP) / np.where(sizes > 0.0, sizes, 1.0)


def changed(new: Array, old: Array) -> NDArray[np.bool_]:
    """True for entries of an array that differ from another's by more than rounding."""
    size = np.nanmax(np.abs(new), initial=1.0)
    return np.abs(new - old) > _ZERO * size


def joint_points(robot: Flight | Vehicle, first: int) -> list[int]:
    """Numbers of the points of joints and wheels with coordinates; `first` follows the rotors."""
    q, points, places = robot.layout.q, robot.points, []
    for k, name in enumerate((*q.names[q.joints], *q.names[q.angles]), start=first):
        # Joints that gears move may be between, and coordinates have names of their own.
        named = f"joint_{name}", f"joint{name.rpartition('_')[2]}"
        places.append(next((points.index(x) for x in named if x in points), k))
    return places


def rotor_radius(
    places: Array, rotors: Indices, directions: Array, parents: Sequence[int], reach: float
) -> float:
    """Radius of discs about some of a robot's points, `places` (k, 3), which reach so far, m."""
    spokes = places[rotors] - places[np.asarray(parents)[rotors]]
    radius = disc_radius(places[rotors], directions, np.linalg.norm(spokes, axis=1))
    return min(radius, _LARGEST_DISC * reach)


class MachineScene:
    """Nodes of a robot, under a root node, which are put wherever its points are.

    Points follow each other: base centre, N rotors, n joints, others. Each is joined to one of
    `parents` by a rod, −1 for none; `arms` is the number of base arms that constraints hold, which
    lead to the last rotors. Sizes are in proportion to how far the robot reaches from its base
    centre, by its `positions` (…, k, 3) in some postures, m, and unit vectors of the thrusts in the
    first of them, `directions` (N, 3), in the same axes. `pushed` are numbers of the points at
    which other forces act than thrusts; so many frames are drawn.

    - `size`, m; `radius`, m, of a rotor's disc
    - `units` (t): those of the efforts of joints, then of base arms
    - `thrust`, `force`, N, and `efforts`, by unit: what is drawn at full length or colour, which
      users set; 0 where there is none
    - `least`: forces (N) and torques (N m), by unit, that nothing but noise is below
    """

    def __init__(
        self,
        scene: Any,
        root: str,
        robot: Flight | Vehicle,
        weight: float,
        parents: Sequence[int],
        arms: int,
        positions: Array,
        directions: Array,
        pushed: list[int],
        frames: int,
    ) -> None:
        centre, joints = robot.points.index(robot.centre), len(robot.layout.effort_units)
        first = centre + 1 + len(directions)
        self._rotors, moving = np.arange(centre + 1, first), joint_points(robot, first)
        self._joints, self._pushed = [centre, *moving], pushed
        rods = [(parent, point) for point, parent in enumerate(parents) if parent >= 0]
        self._rods = np.array(rods, dtype=np.int_).reshape(-1, 2)
        # A link goes on from its joint; base arm k leads to rotor k, and the first one is not held.
        loads = {joint: number for number, joint in enumerate(moving)}
        held = {first - arms + k: joints + k for k in range(arms)}
        self._loads = np.array([held.get(end, loads.get(start, -1)) for start, end in rods], int)
        around = positions - positions[..., [centre], :]
        reach = float(np.nanmax(np.linalg.norm(around, axis=-1))) or 1.0
        places = positions.reshape(-1, *positions.shape[-2:])[0]
        self.radius = rotor_radius(places, self._rotors, directions, parents, reach)
        self.size = reach + self.radius
        self.units = [*robot.layout.effort_units, *["N m"] * arms]
        self.thrust, self.force, self.efforts = 0.0, 0.0, dict.fromkeys(self.units, 0.0)
        noise = _NOISE * float(np.nan_to_num(weight))
        self.least = {"N": noise, "N m": noise * self.size}
        grain = _GRAIN * 2.0 ** np.floor(np.log2(self.size))

        def batch(name: str, shape: str, count: int, colour: str, **look: Any) -> Batch:
            return Batch(scene, f"{root}/{name}", shape, count, colour, grain, **look)

        rotors = len(self._rotors)
        self.rods = batch("rods", "rod", len(rods), RELAXED)
        self._balls = batch("joints", "ball", len(self._joints), _JOINT_COLOUR)
        wheels, self._wheels = robot.layout.q.wheels, [*map(robot.points.index, robot.wheel_points)]
        self._tyres = batch("wheels", "rod", wheels, RELAXED, opacity=0.6, cast_shadow=False)
        self._marks = batch("marks", "rod", wheels, RELAXED)
        self._discs = batch("rotors", "rod", rotors, ROTOR, opacity=0.6, cast_shadow=False)
        self.thrusts = batch("thrusts", "arrow", rotors, THRUST, cast_shadow=False)
        self.forces = batch("forces", "arrow", len(pushed), FORCE, cast_shadow=False)
        self.frames = scene.add_batched_axes(
            f"{root}/frames",
            np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
            np.zeros((frames, 3)),
            axes_length=_AXES * self.size,
            axes_radius=0.05 * _AXES * self.size,
            visible=False,
        )

    def show(
        self,
        points: Array,
        directions: Array,
        thrusts: Array,
        efforts: Array,
        forces: Array,
        frames: Array,
        wheels: Array,
    ) -> None:
        """Put everything where the robot is.

        - `points` (k, 3): positions in the world, m
        - `directions` (N, 3): unit vectors of the thrusts in the world
        - `thrusts` (N), N, and `efforts` (t), N m or N, of joints and base arms
        - `forces` (f, 3): other forces in the world, N
        - `frames` (p, 4, 4): poses in the world of frames that are drawn
        - `wheels` (w, 2, 3): axles and marks of wheels, as of `wheel_marks`
        """
        size, starts, ends = self.size, *self._rods.T
        self.rods.span(points[starts], points[ends], _ROD * size)
        most = np.array([self.efforts[unit] or np.inf for unit in self.units])
        shares = np.append(np.nan_to_num(efforts / most), 0.0)[self._loads]
        self.rods.node.batched_colors = mixed(np.where(self._loads < 0, 0.0, shares))
        joints = points[self._joints]
        upright = turned_to(np.repeat(_UP, len(joints), axis=0))
        self._balls.put(joints, upright, np.full_like(joints, _JOINT * size))
        seats, along = points[self._rotors], directions
        flat = self.radius * np.array([1.0, 1.0, _DISC])
        lower = seats - 0.5 * flat[2] * along
        self._discs.put(lower, turned_to(along), np.tile(flat, (len(seats), 1)))
        hubs, (axles, marks) = points[self._wheels], np.swapaxes(wheels, 0, 1)
        flat = np.linalg.norm(marks, axis=1, keepdims=True) * [1.0, 1.0, 2.0 * _DISC]
        self._tyres.put(hubs - 0.5 * flat[:, 2:] * axles, turned_to(axles), flat)
        self._marks.span(hubs - marks, hubs + marks, _ROD * size)
        shares = np.clip(np.nan_to_num(thrusts / (self.thrust or 1.0)), -_LONGEST, _LONGEST)
        tips = seats + _LENGTH * size * shares[:, np.newaxis] * along
        self.thrusts.span(seats, tips, _ARROW * size)
        struck = points[self._pushed]
        tips = struck + _LENGTH * size * forces / (self.force or 1.0)
        self.forces.span(struck, tips, _ARROW * size)
        if len(frames):
            turns = quaternion_of(frames[:, :3, :3])
            self.frames.batched_wxyzs = np.roll(turns, 1, axis=1).astype(np.float32)
            self.frames.batched_positions = frames[:, :3, 3].astype(np.float32)

    def key(self) -> list[tuple[str, str]]:
        """Colours of a robot, as CSS has them, and in words what they mean."""
        long = f"N is {_LENGTH * self.size:.2g} m long"
        entries = [(THRUST, f"thrust, {self.thrust:.3g} {long}")] if self.thrust else []
        shades = f"linear-gradient(90deg, {RELAXED}, {LOADED})"
        words = {"N m": "torque", "N": "force"}
        entries += [
            (shades, f"{words[unit]} at a joint, 0 to {most:.3g} {unit}")
            for unit, most in self.efforts.items()
            if most
        ]
        if self._pushed:
            entries.append((FORCE, f"other forces on the robot, {self.force:.3g} {long}"))
        return entries


def set_stage(server: Any, root: str, floor: float, reach: float) -> None:
    """Draw a floor at a height, m, and look at the origin.

    `reach`, m, is how far from the origin there is something to be seen.
    """
    # One, two or five times a power of ten: several cells, and not too many, are in sight.
    power = 10.0 ** np.floor(np.log10(reach))
    cell = 0.1 * power * max(step for step in (1.0, 2.0, 5.0) if step * power <= reach)
    server.scene.add_grid(
        f"{root}/floor",
        infinite_grid=True,
        cell_size=cell,
        cell_color=(225, 225, 225),
        section_size=5.0 * cell,
        section_color=(200, 200, 200),
        fade_distance=12.0 * reach,
        position=(0.0, 0.0, floor),
    )
    camera = server.initial_camera
    camera.fov = _FIELD_OF_VIEW
    camera.look_at = (0.0, 0.0, 0.0)
    camera.position = seen_from(VIEW)[2] * _CLOSE * reach / np.tan(0.5 * _FIELD_OF_VIEW)


def mixed(shares: Array) -> Bytes:
    """Red, green and blue (n, 3), 0 to 255, of rods by shares (n) of the largest effort.

    More than 1 counts as 1.
    """
    ends = np.array([rgb(RELAXED), rgb(LOADED)], dtype=np.float64)
    share = np.clip(shares, 0.0, 1.0)[:, np.newaxis]
    return np.round(ends[0] + share * (ends[1] - ends[0])).astype(np.uint8)


class Batch:
    """Copies of a shape, as a node of viser's scene.

    `shape` is "rod" or "arrow", which start at the origin and end at 1 on z, or "ball"; with radius
    1. Lengths are rounded to multiples of `grain`, m; `look` has further options of the node.
    """

    def __init__(
        self, scene: Any, name: str, shape: str, count: int, colour: str, grain: float, **look: Any
    ) -> None:
        self._grain = grain
        self.node = scene.add_batched_meshes_simple(
            name,
            *_mesh(shape),
            np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            np.zeros((count, 3)),
            batched_scales=np.zeros((count, 3)),
            batched_colors=np.tile(rgb(colour), (count, 1)),
            lod="off",
            **look,
        )

    def span(self, starts: Array, ends: Array, width: float) -> None:
        """Make each copy, of radius `width`, reach from one place (n, 3) to another, in m.

        No longer than wide, it is thinner too.
        """
        along = ends - starts
        length = np.linalg.norm(along, axis=1)
        thick = np.minimum(width, length)
        scales = np.stack([thick, thick, length], axis=1)
        directions = along / np.maximum(length, 1e-12)[:, np.newaxis]
        self.put(starts, turned_to(directions), scales)

    def put(self, places: Array, turns: Floats, scales: Array) -> None:
        """Put the copies' origins at places (n, 3), m, turned and scaled.

        `scales` (n, 3) are factors along the shape's axes, and `turns` quaternions (n, 4), real
        part first.
        """
        self.node.batched_positions = self._rounded(places)
        self.node.batched_wxyzs = turns
        self.node.batched_scales = self._rounded(scales)

    def _rounded(self, lengths: Array) -> Floats:
        return (np.round(lengths / self._grain) * self._grain).astype(np.float32)


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour #rrggbb."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def _mesh(shape: str) -> tuple[Array, Indices]:
    """Corners (c, 3) and triangles (t, 3) of the shape of that name: a profile, turned about z."""
    profiles = {
        "rod": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        "arrow": [[0.0, 0.0], [_SHAFT, 0.0], [_SHAFT, _NECK], [1.0, _NECK], [0.0, 1.0]],
        "ball": [[math.sin(angle), -math.cos(angle)] for angle in np.linspace(0.0, np.pi, _RINGS)],
    }
    away, height = np.array(profiles[shape])[:, np.newaxis].T
    turns = 2.0 * np.pi / _SIDES * np.arange(_SIDES)[:, np.newaxis]
    level = np.broadcast_to(height, (_SIDES, height.shape[1]))
    corners = np.stack([away * np.cos(turns), away * np.sin(turns), level], axis=-1)
    number = np.arange(level.size).reshape(level.shape)
    beside = np.roll(number, -1, axis=0)
    here, there = (np.stack([x[:, :-1], x[:, 1:]]) for x in (number, beside))
    faces = [here[0], there[0], there[1]], [here[0], there[1], here[1]]
    triangles = np.concatenate([np.stack(face, axis=-1).reshape(-1, 3) for face in faces])
    return corners.reshape(-1, 3), triangles


def turned_to(directions: Array) -> Floats:
    """Quaternions (n, 4), real part first, that turn z to unit vectors (n, 3)."""
    x, y, z = directions.T
    turns = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=1)
    # Half a turn, about any axis across.
    turns[z < -1.0 + 1e-9] = [0.0, 1.0, 0.0, 0.0]
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return (np.round(turns / _TURN_GRAIN) * _TURN_GRAIN).astype(np.float32)
