"""Trim: state and inputs with which a robot hovers or flies straight, loaded or not.

Joints balance themselves, since each has an input, or loops bear what those need that nothing
drives. The base is balanced where the wrench that it
needs has no part that thrusts cannot produce, which is a condition on the attitude, and on the
joints of robots whose rotors they move. The least or the safest inputs
that balance are chosen.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares, linprog, nnls

from gibbs_codegen.arrays.functions import LEADING
from gibbs_codegen.errors import UsageError, near, printable
from gibbs_codegen.flight.analysis.arguments import coordinates, vehicle_of
from gibbs_codegen.flight.arguments import numbers, real, vector
from gibbs_codegen.flight.desired.posture import joint_motion
from gibbs_codegen.flight.plant.actuators import (
    Actuators,
    beyond_limits,
    command_limits,
    joint_place,
    kept_commands,
    module_actuators,
)
from gibbs_codegen.flight.plant.allocation import asked_of, commands_all, least_inputs
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.vectors import roll_pitch_yaw
from gibbs_codegen.robot.wrenches import DIRECTIONS, RANK, directions, null_space
from gibbs_codegen.runtime.loaded_module import require_functions

# Share of the wrench that may be missing.
EXACT = 1e-9
# Share of the wrench below which coordinates are left as they are, and SciPy's tolerances.
_BALANCED, _CONVERGED = 1e-12, 1e-15
# Weights of displacements beside what is missing; their squares remain missing. The second still
# holds what makes no difference, where rounding would lead anywhere.
_PULLS = 1e-3, 1e-7
Aim = Literal["least_thrust", "widest_margin"]
AIMS: tuple[Aim, ...] = ("least_thrust", "widest_margin")
# Share of the largest input, or of 1 N, by which limits may seem to be exceeded.
_ROUNDING = 1e-9
ATTITUDE = "attitude"
_STILL = (0.0, 0.0, 0.0)
# No angle that is meant to be one is larger, rad, but within limits.
_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """A motion in which no joint moves, and what acts besides gravity.

    - `velocity`, `acceleration` (3): of the base, world axes, m/s and m/s²; turning adds to it
    - `turning`: rate at which the base and its velocity turn about the vertical, rad/s
    - `wrenches` (f, 6): on the frames, in the order of `FRAMES`, world axes, N and N m
    """

    vehicle: Vehicle
    velocity: Array
    acceleration: Array
    turning: float
    wrenches: Array

    def rates(self, q: Array) -> tuple[Array, Array]:
        """Velocities and accelerations (nv) at coordinates."""
        vehicle = self.vehicle
        base, frame = vehicle.layout.v.base, vehicle.frames.index("base")
        columns = vehicle.frame_jacobians(q)[frame][:, base]
        spin = np.array([0.0, 0.0, self.turning])
        v, a = np.zeros((2, vehicle.layout.v.size))
        twist = np.concatenate([self.velocity, spin])
        v[base] = np.linalg.lstsq(columns, twist, rcond=None)[0]
        growth = np.append(self.acceleration + np.cross(spin, self.velocity), np.zeros(3))
        if self.turning:  # Otherwise the acceleration of the base's frame is J a.
            growth = growth - vehicle.frame_bias_accelerations(q, v)[frame]
        a[base] = np.linalg.lstsq(columns, growth, rcond=None)[0]
        off = columns @ np.transpose([v[base], a[base]]) - np.transpose([twist, growth])
        if np.abs(off).max() > EXACT * max(1.0, np.abs([twist, growth]).max()):
            words = "velocity, acceleration" + ", turning" * bool(self.turning)
            raise UsageError(f"{vehicle.name}: {words}: its base does not move along these")
        return v, a

    def force(self, q: Array) -> Array:
        """Generalised force (nv) that the inputs must produce at coordinates, beside loops."""
        acting = self.vehicle.wrench_forces(q, self.wrenches)
        return self.vehicle.needed_force(q, *self.rates(q), acting)

    def missing(self, q: Array) -> Array:
        """The least part (6) that thrusts leave of the wrench that the base needs.

        Force, N, and torque about the base centre, N m, in the base's axes.
        """
        needed = self.vehicle.base_wrench(q, self.force(q))
        columns = self.vehicle.input_wrenches(q)
        return needed - columns @ (np.linalg.pinv(columns, rcond=RANK) @ needed)

    def size(self, q: Array) -> float:
        """The largest component of the wrenches on the base, needed and acting, N or N m; or 1."""
        parts = self.force(q), self.vehicle.wrench_forces(q, self.wrenches)
        return max(float(np.abs(self.vehicle.base_wrench(q, x)).max()) for x in parts) or 1.0


def equilibrium(motion: SteadyMotion, q: Array, free: list[int], bounds: Array) -> Array:
    """Coordinates (nq), near given ones, at which thrusts balance the base best.

    Something may be missing still. `free` are places in v of what may differ, by displacements
    within `bounds` (2, len(free)), rad or m.
    """
    size = motion.size(q)
    if not free or np.abs(motion.missing(q)).max() <= _BALANCED * size:
        return q

    def moved(displacement: Array) -> Array:
        whole = np.zeros(motion.vehicle.layout.v.size)
        whole[free] = displacement
        return motion.vehicle.integrate(q, whole)

    def residual(displacement: Array, pull: float) -> Array:
        return np.append(motion.missing(moved(displacement)) / size, pull * displacement)

    displacement = np.zeros(len(free))
    # The nearest state that balances, as every heading may: the pull leads there, and a weaker
    # one takes away its traces. Differences serve: derivatives of a module lack those of B u and of
    # the wrenches' forces, and what is missing is in the end computed exactly.
    for pull in _PULLS:
        displacement = least_squares(
            residual,
            displacement,
            jac="3-point",
            bounds=bounds,
            ftol=_CONVERGED,
            xtol=_CONVERGED,
            gtol=_CONVERGED,
            args=(pull,),
        ).x
    return moved(displacement)


@dataclass(frozen=True, eq=False)
class Balancing:
    """All inputs that balance: `least` (nu), of least thrust, + `idle` (nu, k) times anything.

    The thrusts of `idle` produce no wrench on the base; they are orthonormal, and orthogonal to
    those of `least`.
    """

    least: Array
    idle: Array

    @classmethod
    def of(cls, vehicle: Vehicle, q: Array, force: Array) -> Balancing:
        """The inputs that produce a generalised force (nv), as nearly as they can."""
        columns = vehicle.input_wrenches(q)
        least, idle = least_inputs(vehicle, q, force, columns), null_space(columns)
        thrusts, torques = idle[: vehicle.rotors], idle[vehicle.rotors :]
        loads = vehicle.input_matrix(q)[vehicle.arm_rates, : vehicle.rotors]
        return cls(least, np.concatenate([thrusts, -loads @ thrusts, torques]))


def chosen_inputs(vehicle: Vehicle, inputs: Balancing, limits: Array, aim: Aim) -> Array:
    """Inputs (nu) of least thrust, or whose thrust next to a limit is farthest from it.

    Least thrust decides between equal margins. `limits` (2, nu) may be infinite.
    Raises `UsageError` if no inputs within them balance, or no thrust has a limit on either side.
    """
    if (aim == "least_thrust" or not vehicle.rotors) and _within(inputs.least, limits):
        return inputs.least
    thrusts = np.arange(len(inputs.least)) < vehicle.rotors
    # Joint torques differ from thrusts in unit: their limits are kept, and no margin is sought.
    safest = _safest(inputs, limits, thrusts.astype(float))
    if safest is None or not _within(safest, limits):
        raise UsageError(_exceeded(vehicle, inputs, limits))
    margin = 0.0
    if aim == "widest_margin":
        margin = float(margins(safest, limits)[thrusts].min()) - _slack(safest)
    tightened = limits + np.outer([1.0, -1.0], margin * thrusts)
    return _least(inputs, tightened, safest)


def margins(inputs: Array, limits: Array) -> Array:
    """Distances (nu) of inputs from the nearer limit, negative beyond, infinite without limits."""
    return np.minimum(inputs - limits[0], limits[1] - inputs)


def _slack(inputs: Array) -> float:
    return _ROUNDING * max(1.0, float(np.abs(inputs).max(initial=0.0)))


def _within(inputs: Array, limits: Array) -> bool:
    return bool(np.all(margins(inputs, limits) >= -_slack(inputs)))


def _rows(inputs: Balancing, limits: Array) -> tuple[Array, Array, Array]:
    """The limits (2, nu) as rows · z ≥ bounds for inputs `least` + `idle` z.

    Rows (m, k), bounds (m), and the place of the input of each (m).
    """
    least, most = limits
    low, high = np.flatnonzero(np.isfinite(least)), np.flatnonzero(np.isfinite(most))
    rows = np.concatenate([inputs.idle[low], -inputs.idle[high]])
    bounds = np.concatenate([(least - inputs.least)[low], (inputs.least - most)[high]])
    return rows, bounds, np.concatenate([low, high])


def _safest(inputs: Balancing, limits: Array, counts: Array) -> Array | None:
    """The inputs (nu) whose least margin is the widest.

    None where none keep the limits of inputs that do not count. `counts` (nu): how much of the
    margin each must have; 0 to stay within limits only. Raises `UsageError` if the margin may grow
    without bound.
    """
    rows, bounds, places = _rows(inputs, limits)
    solution = linprog(
        np.append(np.zeros(rows.shape[1]), -1.0),
        A_ub=np.column_stack([-rows, counts[places]]),
        b_ub=-bounds,
        bounds=(None, None),
        method="highs",
    )
    if solution.status == 3:
        raise UsageError(
            "widest_margin: some thrust has no limit on one side; give limits=(least, most), N"
        )
    return inputs.least + inputs.idle @ solution.x[:-1] if solution.success else None


def _least(inputs: Balancing, limits: Array, safe: Array) -> Array:
    """Inputs (nu) of least thrust within limits, by Lawson and Hanson's least distance programming.

    `safe` (nu) are some within the limits.
    """
    rows, bounds, _ = _rows(inputs, limits)
    size = float(np.abs(bounds).max(initial=0.0)) or 1.0
    system = np.concatenate([rows.T, bounds[np.newaxis] / size])
    wanted = np.append(np.zeros(len(system) - 1), 1.0)
    left = wanted - system @ nnls(system, wanted)[0]
    least = inputs.least - inputs.idle @ (size * left[:-1] / left[-1])
    # Where the limits leave hardly any choice, rounding may spoil it.
    return least if _within(least, limits) else safe


def _exceeded(vehicle: Vehicle, inputs: Balancing, limits: Array) -> str:
    """The limits which even the best inputs exceed, in words."""
    nearest = _safest(inputs, limits, np.ones(len(inputs.least)))
    if nearest is None:
        nearest = inputs.least
    beyond = [
        f"{name} is {value:.4g} {unit}, {-margin:.3g} {unit} {'below' if low else 'above'} its "
        f"limit of {limit:.4g} {unit}"
        for name, value, unit, margin, low, limit in zip(
            vehicle.inputs,
            nearest,
            vehicle.input_units,
            margins(nearest, limits),
            nearest < limits[0],
            np.where(nearest < limits[0], *limits),
            strict=True,
        )
        if margin < -_slack(nearest)
    ]
    return (
        f"{vehicle.name}: no inputs within their limits balance it at this attitude; the nearest "
        f"that do: {'; '.join(beyond)}"
    )


@dataclass(frozen=True, eq=False)
class Trim:
    """A balanced state: with inputs u the robot at (q, v) accelerates by a, under given wrenches.

    - `robot`, `input_names`, `joint_units`, `input_units`: what it is of
    - `q` (nq), `v`, `a` (nv), `u` (nu): coordinates, velocities, accelerations, inputs
    - `attitude`: angles of the base by name, rad: its coordinates or, of a quaternion, roll, pitch
      and yaw, R = Rz Ry Rx
    - `posture`: the joints' coordinates by name, rad or m
    - `attitude_deg`, `posture_deg`: the angles among these in degrees; `trim` takes the latter
    - `wrenches` (f, 6): on the frames, in the order of `FRAMES`, world axes, N and N m
    - `residual`: largest entry of M a − R − Jᵀ W − B u, N and N m, without what loops bear
    - `limits` (2, nu), `margins` (nu): least and greatest inputs, and how far each input is from
      the nearer of them, infinite without limits
    - `null_space` (6, k): wrenches on the base that no thrusts produce here, orthonormal columns:
      force, N, and torque about the base centre, N m, in the base's axes
    - `missing`: these wrenches in words
    - `free`: what could differ from what was asked for: "attitude", joints by name, or nothing
    - `turned`: by how much the attitude was turned to find balance, rad
    - `beyond_limits`: the joints that were asked for beyond their limits, and commands beyond
      theirs, in words
    - `command` (nu), `x` (nx): commands of motors and servos that keep the inputs, and states of
      the actuators, with a full battery; None where the robot file describes no actuators
    - `command_units`: units of the commands by their names
    - `command_margins` (nu): how far each command is from the nearer of its limits, infinite
      without limits; None as `command`
    """

    robot: str
    input_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    input_units: tuple[str, ...]
    q: Array
    v: Array
    a: Array
    u: Array
    attitude: dict[str, float]
    posture: dict[str, float]
    wrenches: Array
    residual: float
    limits: Array
    margins: Array
    null_space: Array
    missing: tuple[str, ...]
    free: tuple[str, ...]
    turned: float
    beyond_limits: tuple[str, ...]
    command: Array | None = None
    x: Array | None = None
    command_units: Mapping[str, str] = field(default_factory=dict)
    command_margins: Array | None = None

    @property
    def attitude_deg(self) -> dict[str, float]:
        """Angles of the base by name, degrees."""
        return {name: math.degrees(angle) for name, angle in self.attitude.items()}

    @property
    def posture_deg(self) -> dict[str, float]:
        """Angles of revolute joints by name, degrees."""
        named = zip(self.posture.items(), self.joint_units, strict=True)
        return {name: math.degrees(angle) for (name, angle), unit in named if unit == "rad"}

    def __str__(self) -> str:
        lines = [f"{self.robot}: balanced"]
        if self.turned > EXACT:
            lines[0] += f", with its attitude turned by {np.degrees(self.turned):.4g}°"
        lines[0] += f"; varied: {', '.join(self.free) or 'nothing'}"
        names = [*self.attitude, *self.posture, *self.input_names]
        values = [*self.attitude.values(), *self.posture.values(), *self.u]
        units = ["rad"] * len(self.attitude) + [*self.joint_units, *self.input_units]
        rooms = [np.inf] * (len(names) - len(self.u)) + [*self.margins]
        noise = EXACT * np.abs(self.u).max(initial=1.0)
        width = max(map(len, names))
        for name, unit, value, margin in zip(names, units, values, rooms, strict=True):
            value, margin = (x if abs(x) > noise else 0.0 for x in (value, margin))
            line = f"  {name:<{width}} {value:10.4g} {unit:<3}"
            room = f" {margin:10.4g} {unit} from a limit" if np.isfinite(margin) else ""
            if unit == "rad":
                room = f" {math.degrees(value):10.4g}°"
            lines.append((line + room).rstrip())
        if self.command is not None and self.command_margins is not None:
            lines.append("The commands that keep it so")
            width = max(map(len, self.command_units), default=0)
            for value, margin, (name, unit) in zip(
                self.command, self.command_margins, self.command_units.items(), strict=True
            ):
                scale, unit = (100.0, "%") if unit == "1" else (1.0, unit)
                value, margin = (x if abs(x) > EXACT else 0.0 for x in (value, margin))
                line = f"  {name:<{width}} {scale * value:10.4g} {unit:<5}"
                room = f" {scale * margin:10.4g} {unit} from a limit" * bool(np.isfinite(margin))
                lines.append((line + room).rstrip())
        if self.missing:
            lines += ["The rotors produce no wrench along", *(f"  {m}" for m in self.missing)]
        lines += [f"warning: {joint}" for joint in self.beyond_limits]
        return "\n".join(lines)


def trim(
    robot: ModuleType | str | os.PathLike[str],
    posture: Mapping[str, float] | None = None,
    *,
    posture_deg: Mapping[str, float] | None = None,
    q: ArrayLike | None = None,
    velocity: ArrayLike = _STILL,
    acceleration: ArrayLike = _STILL,
    turning: float = 0.0,
    wrenches: Mapping[str, ArrayLike] | None = None,
    free: Iterable[str] | None = None,
    aim: Aim = "least_thrust",
    limits: ArrayLike | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Trim:
    """Find the inputs, and where need be the attitude, of hover, straight ways and circles.

    Args:
        robot: A generated module, or the name or path of one, which is loaded.
        posture: Joints' coordinates by name, rad or m; other joints keep `q`.
        posture_deg: Angles of revolute joints by name, in degrees as in scenario files; such joints
            are not in `posture`.
        q: Coordinates (nq) asked for. If None, the base is level at the origin, and joints are at
            zero or, of mechanisms, where loops close. Joints of loops that nothing drives follow
            the others.
        velocity, acceleration: Of the base (3): world axes, m/s and m/s².
        turning: Rate at which the base and its velocity turn about the vertical, rad/s: it goes
            round circles of the radius speed / turning. What that takes adds to `acceleration`.
        wrenches: What acts on frames besides gravity, by their names: force, N, and torque, N m,
            (6) each, world axes.
        free: What may differ from the coordinates asked for: "attitude", and joints by name, which
            keep their limits. If None it is the attitude, where the rotors cannot produce every
            wrench on the base, and else nothing.
        aim: What is chosen where many inputs balance: "least_thrust", the least sum of squares of
            the thrusts within the limits; or "widest_margin", where the thrust next to a limit is
            farthest from it.
        limits: Least and greatest thrusts, N, (2, N) or one pair for all rotors; default: those of
            the robot file.
        parameters: Parameters of the module's `prepare`.

    Returns:
        The trim.

    Raises:
        UsageError: There is no trim (the message names the missing force or the exceeded limit), or
            the robot lacks a name in the request.
    """
    vehicle = vehicle_of(robot, parameters)
    if aim not in AIMS:
        raise UsageError(f"aim: {aim!r} is unknown; known: {', '.join(AIMS)}")
    acting = np.zeros((len(vehicle.frames), 6))
    for name, wrench in (wrenches or {}).items():
        acting[vehicle.frame_place(name, "wrenches")] = vector(f"wrenches: {name}", wrench, 6)
    moved = vector("velocity", velocity, 3), vector("acceleration", acceleration, 3)
    rate = float(numbers("turning", turning, "a rate, rad/s", ()))
    motion = SteadyMotion(vehicle, *moved, rate, acting)
    actuators = module_actuators(vehicle)
    if limits is not None:
        wanted = f"the least and the greatest thrust, or two rows of {vehicle.rotors} of them"
        ends = real("limits", limits, wanted, (2,), (2, vehicle.rotors))
        if not np.all(ends[0] <= ends[1]):
            raise UsageError(
                f"limits: must be {wanted}; a least thrust is NaN or above the greatest"
            )
        actuators.thrusts[:] = ends.reshape(2, -1)
    start = _start(vehicle, q, posture=posture, posture_deg=posture_deg)
    if free is None:
        leans = not commands_all(vehicle, start) and vehicle.layout.own_axes[1]
        free = (ATTITUDE,) if leans else ()
    varied = (free,) if isinstance(free, str) else tuple(free)
    places, bounds = _freedom(vehicle, actuators, start, varied)
    balanced = equilibrium(motion, start, places, bounds)
    _require_balance(motion, balanced, varied)
    force = motion.force(balanced)
    inputs = Balancing.of(vehicle, balanced, force)
    u = chosen_inputs(vehicle, inputs, actuators.inputs, aim)
    v, a = motion.rates(balanced)
    rotation, layout = vehicle.base_rotation(balanced), vehicle.layout
    turn = vehicle.base_rotation(start).T @ rotation
    places_q = layout.q.attitude
    attitude = dict(zip(layout.q.names[places_q], balanced[places_q].tolist(), strict=True))
    if layout.is_quaternion:
        angles = roll_pitch_yaw(rotation).tolist()
        attitude = dict(zip(("roll", "pitch", "yaw"), angles, strict=True))
    asked = asked_of(vehicle, balanced)
    idle = asked @ null_space(vehicle.input_wrenches(balanced).T @ asked)
    joint_units, angles = layout.q.units[vehicle.arm], balanced[vehicle.arm]
    beyond = beyond_limits(vehicle.joint_names, joint_units, angles, actuators.joints)
    command, x, units, room = None, None, {}, None
    if names := getattr(vehicle.module, "COMMANDS", ()):
        command, x = kept_commands(vehicle, balanced, v, u)
        units = dict(zip(names, vehicle.module.COMMAND_UNITS, strict=True))
        ends = command_limits(vehicle.module)
        beyond += beyond_limits(names, units.values(), command, ends)
        room = margins(command, ends)
    return Trim(
        robot=vehicle.name,
        input_names=vehicle.inputs,
        joint_units=joint_units,
        input_units=vehicle.input_units,
        q=balanced,
        v=v,
        a=a,
        u=u,
        attitude=attitude,
        posture=dict(zip(vehicle.joint_names, angles.tolist(), strict=True)),
        wrenches=acting,
        residual=float(np.abs(force - vehicle.input_matrix(balanced) @ u).max()),
        limits=actuators.inputs,
        margins=margins(u, actuators.inputs),
        null_space=idle,
        missing=directions(idle),
        free=varied,
        # |R − 1| is 2√2 sin(φ/2), which keeps its digits near none.
        turned=float(2.0 * np.arcsin(min(1.0, np.linalg.norm(turn - np.eye(3)) / np.sqrt(8.0)))),
        beyond_limits=beyond,
        command=command,
        x=x,
        command_units=units,
        command_margins=room,
    )


def _start(vehicle: Vehicle, q: ArrayLike | None, **tables: Mapping[str, float] | None) -> Array:
    """The coordinates (nq) asked for, zero if None, with postures of joints by name.

    Raises `UsageError` for a wrong number of them, or for a joint that is unknown, in the wrong
    table or in two.
    """
    start, loops = vehicle.neutral, getattr(vehicle.module, "LOOPS", ())
    if q is not None:
        start = coordinates(vehicle, q)
    elif loops:
        start[vehicle.arm] = np.array(vehicle.module.POSTURE)[vehicle.arm]
    ends = np.abs(module_actuators(vehicle).joints).max(axis=0)
    ends = np.where(np.isfinite(ends), np.maximum(ends, _TURN), _TURN)
    for table, posture in tables.items():
        unit = "degrees" if table.endswith("_deg") else "rad or m"
        if not isinstance(posture, Mapping | None):
            raise UsageError(f"{table}: a dictionary of joints and their coordinates in {unit}")
        for name, angle in (posture or {}).items():
            value = numbers(f"{table}: {name}", angle, f"a finite number, {unit}", ())
            place = vehicle.layout.q.joint_places[joint_place(vehicle, name)]
            turns, most = vehicle.layout.q.units[place] == "rad", ends[joint_place(vehicle, name)]
            if unit != "degrees" and turns and abs(value) > most:
                raise UsageError(
                    f"{table}: {name}: {value:g} rad is more than a turn; for degrees give "
                    f"posture_deg={{{name!r}: {value:g}}}"
                )
            if unit == "degrees" and not turns:
                raise UsageError(f"{table}: {name} is prismatic; give it in posture, in m")
            if unit == "degrees" and name in (tables["posture"] or {}):
                raise UsageError(f"{table}: {name} is in posture too; give it once")
            start[place] = np.radians(value) if unit == "degrees" else value
    if loops:
        require_functions(vehicle.module, sorted(LEADING))
        closed = joint_motion(vehicle, start[vehicle.arm], {}, np.zeros(1))
        start[vehicle.arm] = closed.q[0, vehicle.arm]
    return start


def _freedom(
    vehicle: Vehicle, actuators: Actuators, start: Array, free: Iterable[str]
) -> tuple[list[int], Array]:
    """Places in v of what may differ from `start` (nq), and displacements (2, k), rad or m.

    These are the least and the greatest. Raises `UsageError` for an unknown joint, or one beyond
    its limits.
    """
    places, bounds = [], []
    layout = vehicle.layout
    for name in free:
        if name == ATTITUDE:
            places += [*range(layout.v.size)[layout.v.attitude]]
            bounds += [(-np.inf, np.inf)] * len(layout.own_axes[1])
            continue
        if name not in vehicle.joint_names:
            hint = near(name, [ATTITUDE, *vehicle.joint_names]) or ";"
            words = f"has no joint {printable(name, 60)}{hint} what may differ: {_choices(vehicle)}"
            raise UsageError(f"free: {vehicle.name} {words}")
        if loops := getattr(vehicle.module, "LOOPS", ()):
            raise UsageError(
                f"free: {name}: loops ({', '.join(loops)}) must stay closed, so trim cannot vary "
                "joints; give a posture"
            )
        joint = joint_place(vehicle, name)
        low, high = actuators.joints[:, joint] - start[layout.q.joint_places[joint]]
        if not low <= 0.0 <= high:
            raise UsageError(f"free: {name} starts beyond its limits; give a posture within them")
        if low < high:  # Equal limits leave nothing to vary.
            places.append(layout.v.joint_places[joint])
            bounds.append((low, high))
    return places, np.transpose(bounds)


def _choices(vehicle: Vehicle) -> str:
    """All that `free` may name."""
    return ", ".join([f'"{ATTITUDE}"', *vehicle.joint_names])


def _require_balance(motion: SteadyMotion, q: Array, free: Sequence[str]) -> None:
    """Raise `UsageError` that names what thrusts cannot balance, if anything is missing.

    `free` names what else was tried.
    """
    missing, size = motion.missing(q), motion.size(q)
    if np.abs(missing).max() <= EXACT * size:
        return
    parts = [
        f"{name} {value:.4g} {unit}"
        for name, value, unit in zip(DIRECTIONS, missing, ["N"] * 3 + ["N m"] * 3, strict=True)
        if abs(value) > EXACT * size
    ]
    remedy = f"let the search vary something with free=(…), out of {_choices(motion.vehicle)}"
    if free:
        remedy = f"varying {', '.join(free)} does not help nearby; let other quantities vary"
    raise UsageError(
        f"{motion.vehicle.name}: no trim: whatever the thrusts, they leave {', '.join(parts)} (in "
        f"the base's axes, about the base centre); {remedy}"
    )
