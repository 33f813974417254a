"""Desired motion of joints that no path of the tip leads: a posture, and moves from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.inverse_kinematics import JointBounds
from gibbs_codegen.flight.plant.actuators import joint_place
from gibbs_codegen.flight.plant.allocation import ranks
from gibbs_codegen.flight.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.parts import Move
from gibbs_codegen.flight.scenario.paths import Line
from gibbs_codegen.flight.vectors import halton

# Postures that the search starts from, besides the first.
_STARTS = 7
# Differences of energies that count as none, as a share of the largest energy.
_SAME_ENERGY = 1e-11
# Steps of the search at most, and shares of a step that are tried, each half the one before.
_STEPS = 60
_HALVINGS = 6
# Curvature of the energy, as a share of the largest, below which a motion counts as flat.
_FLATTEST = 1e-7
# Step of the differences that give the Hessian, rad.
_DIFFERENCE = 1e-5
# Parts of the range of a joint at whose ends commanding postures are looked for, how often all
# joints are gone through, and what counts as no better.
_PARTS, _ROUNDS, _BETTER = 6, 4, 1.0 + 1e-6
# Steps at most in which a loop closes, how far one goes, m and rad, and errors of what is closed:
# POSTURE is rounded, so that loops of more rows than joints close no better.
_CLOSINGS, _LONGEST, _MET = 50, 0.5, 1e-6
# Greatest parts, m and rad, in which driven joints leave POSTURE; what is beyond a limit, m and °.
_PART, _BEYOND = 0.1, 1e-4
# Keeps divisors from being 0.
_TINY = 1e-300


def joint_motion(
    vehicle: Vehicle, posture: Array, moves: Mapping[str, Sequence[Move]], time: Array
) -> Motion:
    """Motion of the joints by moves from `posture` (n), with the base's coordinates at zero."""
    joints = np.zeros((len(time), 3, vehicle.joints))
    joints[:, 0] = posture
    for name, legs in moves.items():
        place = joint_place(vehicle, name, "arm.moves")
        start = posture[place]
        for leg in legs:
            # How far it has come, as of a point on a line.
            way = Line((0.0, 0.0, 0.0), (leg.to - start, 0.0, 0.0), leg.duration, leg.begin)
            joints[:, :, place] += way(time)[:, :3, 0]
            start = leg.to
    q = np.tile(vehicle.neutral, (len(time), 1))
    v, a = np.zeros((2, len(time), vehicle.layout.v.size))
    q[:, vehicle.arm] = joints[:, 0]
    v[:, vehicle.arm_rates], a[:, vehicle.arm_rates] = joints[:, 1], joints[:, 2]
    return _closed(vehicle, Motion(time, q, v, a))


def _closed(vehicle: Vehicle, motion: Motion) -> Motion:
    """The motion with loops of mechanisms closed, from knot to knot, by joints that none drives.

    Raises `UsageError` with the time at which they cannot be.
    """
    robot, q, v, a = Functions(vehicle.module), motion.q, motion.v, motion.a
    if not robot.leads_loops:
        return motion
    rows, free, bias = robot.loop_rows, robot.free_joints, vehicle.function("constraint_bias")
    jacobian, places = vehicle.function("constraint_jacobian"), _undriven(vehicle)
    last = _first_closed(vehicle, q[0])
    for k in range(len(q)):
        if last is not None:
            q[k, places] = last[places]
            last = _near_closed(vehicle, q[k])
        if last is None:
            raise UsageError(
                f"{vehicle.name}: at t = {motion.time[k]:.6g} s its loops do not close at these "
                "driven joints; change arm.posture_deg or arm.moves_deg"
            )
        q[k] = last
    levers = rows @ jacobian(q)
    inverse = -free.T @ np.linalg.pinv(levers @ free.T)
    v = v + (inverse @ (levers @ v[..., np.newaxis]))[..., 0]
    pulls = (levers @ a[..., np.newaxis])[..., 0] + bias(q, v) @ rows.T
    return Motion(motion.time, q, v, a + (inverse @ pulls[..., np.newaxis])[..., 0])


def _undriven(vehicle: Vehicle) -> list[int]:
    """Places among coordinates of joints in loops that nothing drives."""
    return [vehicle.coordinates.index(name) for name in Functions(vehicle.module).undriven]


def _first_closed(vehicle: Vehicle, q: Array) -> Array | None:
    """Coordinates (nq) that close loops, as near to POSTURE or to a guess q as those are found.

    From POSTURE driven joints go to where they are to be in small parts.
    """
    start, places = q.copy(), _undriven(vehicle)
    start[vehicle.arm] = np.array(vehicle.module.POSTURE)[vehicle.arm]
    guess = np.concatenate([q[: vehicle.arm.start], start[vehicle.arm], q[vehicle.arm.stop :]])
    closed = None
    if np.any(q[places] != start[places]):
        guess, closed = q, _near_closed(vehicle, q)
    if closed is None:
        closed, way = start, q - start
        way[places] = 0.0
        parts = int(np.ceil(np.abs(way).max() / _PART)) + 1
        for _ in range(parts):
            closed = None if closed is None else _near_closed(vehicle, closed + way / parts)
    if closed is not None:
        turns = vehicle.is_angle[places]
        away = closed[places] - guess[places]
        closed[places] -= np.where(turns, 2.0 * np.pi * np.round(away / (2.0 * np.pi)), 0.0)
    return closed


def _near_closed(vehicle: Vehicle, q: Array) -> Array | None:
    """Coordinates (nq) that close loops near others, by undriven joints alone; None if none do.

    Steps of Gauss and Newton, halved until errors are less.
    """
    robot, places = Functions(vehicle.module), _undriven(vehicle)
    errors, jacobian = (vehicle.function(f"constraint_{x}") for x in ("errors", "jacobian"))
    rows, free = robot.loop_rows, robot.free_joints
    off, q = rows @ errors(q), q.copy()
    for _ in range(_CLOSINGS):
        step = np.linalg.pinv(rows @ jacobian(q) @ free.T) @ off
        step /= max(np.abs(step).max() / _LONGEST, 1.0)
        for share in 0.5 ** np.arange(_HALVINGS):
            trial = q.copy()
            trial[places] -= share * step
            left = rows @ errors(trial)
            if np.linalg.norm(left) < np.linalg.norm(off):
                break
        else:
            break
        q, off = trial, left
    return q if np.abs(off).max() < _MET else None


def check_mechanism(vehicle: Vehicle, motion: Motion, limits: JointBounds, leads: bool) -> None:
    """Raise `UsageError` where loops take joints beyond limits, or do not tell how some move.

    The last is where a law `leads` joints, and rows of undriven ones lose rank: their least
    singular value is 0, or changes by as much from a knot to the next.
    """
    robot, places = Functions(vehicle.module), _undriven(vehicle)
    for name, place in zip(robot.undriven, places, strict=True):
        ends = np.array([limit[place - vehicle.arm.start] for limit in limits])
        values, unit = motion.q[:, place], " m"
        if vehicle.is_angle[place]:
            values, ends, unit = np.degrees(values), np.degrees(ends), "°"
        over = np.maximum(ends[0] - values, values - ends[1])
        if over[k := int(np.argmax(over))] > _BEYOND:
            raise UsageError(
                f"{vehicle.name}: at t = {motion.time[k]:.6g} s its loops take {name} to "
                f"{values[k]:.4g}{unit}, beyond its limits, {ends[0]:.4g}{unit} and "
                f"{ends[1]:.4g}{unit}; move the driven joints elsewhere (arm.posture_deg, "
                "arm.moves_deg)"
            )
    levers = robot.loop_rows @ vehicle.function("constraint_jacobian")(motion.q)
    _, values, ways = np.linalg.svd(levers @ robot.free_joints.T)
    least = values[:, -1] if len(robot.loop_rows) >= len(places) else np.zeros(len(values))
    free, change = least <= _MET * values[:, 0], np.abs(np.diff(least))
    lost = free | (least <= np.maximum(np.append(change, 0.0), np.append(0.0, change)))
    if not leads or not lost.any():
        return
    moved = np.abs(ways[k := int(np.argmax(lost)), -1])
    names = [x for x, much in zip(robot.undriven, moved, strict=True) if much > 0.1 * moved.max()]
    loops = [x for x, joints in vehicle.module.LOOPS.items() if {*joints} & {*names}]
    words, remedy = "do not lead", "they pass a dead centre; move the driven joints elsewhere"
    if free.all():
        words, remedy = "do not determine", "give them a drive or another loop"
    raise UsageError(
        f"{vehicle.name}: at t = {motion.time[k]:.6g} s loops {', '.join(loops)} {words} "
        f"{', '.join(names)}; {remedy}"
    )


def with_joints(vehicle: Vehicle, base: Motion, joints: Motion) -> Motion:
    """Motion of the base with that of the joints at the same knots put in."""
    q, v, a = base.q.copy(), base.v.copy(), base.a.copy()
    q[:, vehicle.arm] = joints.q[:, vehicle.arm]
    v[:, vehicle.arm_rates] = joints.v[:, vehicle.arm_rates]
    a[:, vehicle.arm_rates] = joints.a[:, vehicle.arm_rates]
    return Motion(base.time, q, v, a)


def rest_posture(vehicle: Vehicle, limits: JointBounds) -> Array:
    """Joints (n) of least potential energy under a level base, or where they close loops.

    Prismatic joints are at 0, and so are revolute ones that make no difference, such as one about
    the vertical; or where limits leave out 0, as near to it as they allow.
    """
    if getattr(vehicle.module, "LOOPS", ()):
        return np.array(vehicle.module.POSTURE)[vehicle.arm]
    revolute = vehicle.is_angle[vehicle.arm]
    low, high = limits[0][revolute], limits[1][revolute]
    places, rates = (
        np.array(entries.joint_places)[revolute] for entries in (vehicle.layout.q, vehicle.layout.v)
    )
    rest = vehicle.neutral
    rest[vehicle.arm] = np.clip(0.0, *limits)
    if not np.any(revolute):
        return rest[vehicle.arm]

    def posture(angles: Array) -> Array:
        q = np.broadcast_to(rest, (*angles.shape[:-1], len(rest))).copy()
        q[..., places] = angles
        return q

    def energy(angles: Array) -> Array:
        return vehicle.potential_energy(posture(angles))

    def gradient(angles: Array) -> Array:
        # The torques that hold the arm still are the gradient of its potential energy.
        q = posture(angles)
        still = np.zeros((*q.shape[:-1], vehicle.layout.v.size))
        return vehicle.inverse_dynamics(q, still, still)[..., rates]

    # The first start is away from 0 and from symmetry, where the gradient may vanish at a maximum.
    shares = halton(_STARTS, len(places))
    ends = np.clip(-np.pi, low, high), np.clip(np.pi, low, high)
    starts = [-0.3 - 0.1 * np.arange(len(places)), *(ends[0] + shares * (ends[1] - ends[0]))]
    minima = _energy_minima(energy, gradient, np.clip(starts, low, high), low, high)
    energies = energy(minima)
    least = energies.min() + _SAME_ENERGY * np.abs(energies).max()
    best = minima[np.argmax(energies <= least)]
    for place, nearest in enumerate(rest[places]):
        trial = best.copy()
        trial[place] = nearest
        if energy(trial) <= least:
            best = trial
    return posture(_equilibrium(gradient, best, low, high))[vehicle.arm]


def authority_posture(vehicle: Vehicle, limits: JointBounds, posture: Array) -> Array:
    """Joints (n) near `posture` at which rotors that joints move command wrenches most evenly.

    One revolute joint after the other is put to where, of some places between its limits, the
    weakest direction is strongest, until none makes it stronger. `posture` itself if no other
    commands more directions.
    """
    shares = np.linspace(1.0, 0.0, _PARTS + 1)[1:-1]
    best, (directions, strength) = posture, _command(vehicle, posture)
    begin = directions
    for _ in range(_ROUNDS):
        before = best
        for joint in np.flatnonzero(vehicle.is_angle[vehicle.arm]):
            low, high = (np.clip(limit[joint], -np.pi, np.pi) for limit in limits)
            for angle in low + shares * (high - low):
                trial = best.copy()
                trial[joint] = angle
                count, value = _command(vehicle, trial)
                if (count, value) > (directions, strength * _BETTER):
                    best, directions, strength = trial, count, value
        if best is before:
            break
    return best if directions > begin else posture


def _command(vehicle: Vehicle, posture: Array) -> tuple[int, float]:
    """The number of directions that rotors command in a posture (n), and the least strength."""
    q = vehicle.neutral
    q[vehicle.arm] = posture
    wrenches = vehicle.thrust_wrenches(q)
    count = int(ranks(wrenches))
    force, torque = (float(np.linalg.norm(part)) for part in (wrenches[:3], wrenches[3:]))
    # Torque is divided by the mean lever arm, so that it compares with force.
    wrenches = np.concatenate([wrenches[:3], wrenches[3:] * (force / max(torque, _TINY))])
    return count, float(np.linalg.svd(wrenches, compute_uv=False)[count - 1])


def _energy_minima(
    energy: Callable[[Array], Array],
    gradient: Callable[[Array], Array],
    angles: Array,
    low: Array,
    high: Array,
) -> Array:
    """Angles (s, n), rad, of least energy near each of the starts `angles`, within limits (n).

    Newton's method for all starts at once, with curvatures taken as positive, so that it leaves
    saddles; of each step the best of some shares is taken.
    """
    shares = 0.5 ** np.arange(_HALVINGS)[:, np.newaxis, np.newaxis]
    for _ in range(_STEPS):
        slope, hessian, _ = _derivatives(gradient, angles, low, high)
        curvature, axes = np.linalg.eigh(hessian)
        curvature = np.abs(curvature)
        least = _FLATTEST * curvature.max(axis=-1, keepdims=True)
        along = np.einsum("sij,si->sj", axes, slope) / np.maximum(curvature, least + _TINY)
        along = np.clip(along, -np.pi / 2.0, np.pi / 2.0)
        step = np.einsum("sij,sj->si", axes, along)
        trials = np.clip(angles - shares * step, low, high)
        energies = energy(trials)
        best = np.argmin(energies, axis=0), np.arange(len(angles))
        gain = energy(angles) - energies[best]
        angles = np.where(gain[:, np.newaxis] > 0.0, trials[best], angles)
        if np.all(gain <= _SAME_ENERGY * np.abs(energies).max()):
            break
    return angles


def _derivatives(
    gradient: Callable[[Array], Array], angles: Array, low: Array, high: Array
) -> tuple[Array, Array, Flags]:
    """Gradient (…, n) and Hessian (…, n, n) of the energy, and which joints (…, n) are free.

    They are 0 for joints that gravity holds against a limit.
    """
    slope = gradient(angles)
    free = ~((angles <= low) & (slope > 0.0)) & ~((angles >= high) & (slope < 0.0))
    steps = _DIFFERENCE * np.eye(angles.shape[-1])
    centre = angles[..., np.newaxis, :]
    hessian = (gradient(centre + steps) - gradient(centre - steps)) / (2.0 * _DIFFERENCE)
    # It is symmetric, but for rounding.
    hessian = 0.5 * (hessian + np.swapaxes(hessian, -1, -2))
    both = free[..., np.newaxis] & free[..., np.newaxis, :]
    return np.where(free, slope, 0.0), np.where(both, hessian, 0.0), free


def _equilibrium(
    gradient: Callable[[Array], Array], angles: Array, low: Array, high: Array
) -> Array:
    """Angles (n), rad, near some others at which gravity moves no joint except against its limit.

    Newton's method for a root of the gradient (n), N m.
    """
    for _ in range(10):
        slope, hessian, free = _derivatives(gradient, angles, low, high)
        # Motions that gravity does not resist, but for rounding, are left alone.
        step = np.linalg.pinv(hessian, rcond=_FLATTEST, hermitian=True) @ slope
        trial = np.clip(angles - step, low, high)
        if not np.linalg.norm(gradient(trial)[free]) < np.linalg.norm(slope):
            break
        angles = trial
    return angles
