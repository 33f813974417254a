"""Motions that a base can fly whose rotors push along one axis.

Such a base leans where it is to accelerate. Its thrust axis is turned from where the scenario's
attitude has it, by the shortest way, to where the motion needs it: so the heading is kept, and tilt
is what physics asks for. Without an arm, and with the centre of mass at the base centre, the axis
is that of acceleration and gravity (differential flatness); in general `collocation` finds it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.attitude import SingularAttitudeError
from gibbs_codegen.scenario.orientation import Orientation
from gibbs_codegen.scenario.paths import Path
from gibbs_codegen.simulator.desired.collocation import STENCIL, nearest_motion
from gibbs_codegen.simulator.desired.demand import needed_inputs
from gibbs_codegen.simulator.desired.knots import (
    Deviation,
    bounded_path,
    refine,
    refined,
)
from gibbs_codegen.simulator.desired.leaning import Leaning
from gibbs_codegen.simulator.plant.thrust_axis import force_axis, thrust_axis
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Motion

# Knots that are solved for at once, and those beyond that are found again.
_SPAN, _OVERLAP = 4096, 1024
# Fewest pieces, so that there are differences of third order.
_FEWEST = 8
# Knots of rest before and after a motion between rests, before they are refined: the base swings
# there, ahead of its path and after it.
_ROOM = 300
# Greatest lateral force between knots, as a share of the weight, and greatest distance from the
# path, m.
_LATERAL, _FARTHEST = 1e-3, 0.1
# Greatest distance of a thrust between knots from the mean of those at the knots, as a share of the
# weight.
_UNEVEN = 5e-3
_TOO_FAST = ("the base turns too fast", "choose a gentler motion, or a shorter one")


def feasible_motion(
    vehicle: Vehicle,
    time: Array,
    joints_at: Callable[[Array], Motion],
    path: Path,
    orientation: Orientation,
    progress: Callable[[float], None] = lambda share: None,
) -> Motion:
    """The motion nearest to a path that a base can fly whose rotors push along one axis.

    Where pieces between the evenly spaced knots need lateral force, 2, 4 … times as many are taken.
    `joints_at` gives the motion of the joints for knots, the base's coordinates at zero;
    `orientation` is the attitude but for the base's tilt. Raises `UsageError`, with the time, where
    thrust would have to vanish or to point against the scenario's attitude, where the attitude is
    singular, where joints bring the rotors to where they do not command three moments, and where
    the base cannot stay near its path.
    """
    refinement = -(-_FEWEST // (len(time) - 1))
    while True:
        knots = refined(time, refinement)
        centre = bounded_path(knots, path, "path of the base")
        turning = orientation(path, knots, vehicle.arm_angles())
        joints = joints_at(knots)
        axis = _axes(vehicle, joints)
        leaning = Leaning(vehicle, joints, axis, centre, turning)
        longer, own = leaning.with_room(_ROOM * refinement)
        motion = _solved(longer, progress)
        motion = Motion(knots, motion.q[own], motion.v[own], motion.a[own])
        deviation = _deviation(vehicle, motion, leaning.weight)
        if deviation is None:
            return motion
        refinement = refine(refinement, time, deviation, *_TOO_FAST)


def _axes(vehicle: Vehicle, joints: Motion) -> Array:
    """Unit thrust axes (s, 3) in the base's frame.

    Raises `UsageError` with the first time without one.
    """
    if not vehicle.rotors_move:
        return np.broadcast_to(force_axis(vehicle.thrust_wrenches()), (len(joints.q), 3))
    axis = thrust_axis(vehicle, joints.q)
    if axis is not None:
        return axis
    fails = np.array([thrust_axis(vehicle, q[np.newaxis]) is None for q in joints.q])
    raise UsageError(
        f"at t = {joints.time[fails][0]:.6g} s the joints bring the rotors to where they do not "
        "command a force along one axis and three moments; choose another posture or other moves"
    )


def _solved(leaning: Leaning, progress: Callable[[float], None]) -> Motion:
    """The motion of a leaning base, in spans of knots that overlap.

    What lies ahead matters for a few seconds only, so that the end of each span is found again.
    """
    axes, time = leaning.point_mass(), leaning.joints.time
    shift, held = np.zeros_like(axes), leaning.at_rest()
    for begin in range(0, len(time), _SPAN):
        span = slice(max(begin - STENCIL, 0), begin + _SPAN + _OVERLAP)
        part = leaning.part(span)
        try:
            axes[span], shift[span] = nearest_motion(
                part.lateral, axes[span], shift[span], part.grid, leaning.gravity, held[span]
            )
        except SingularAttitudeError as error:
            instant = time[span][error.place]
            raise SingularAttitudeError(f"at t = {instant:.6g} s {error}", error.place) from None
        # The next span goes on from here.
        held[max(begin + _SPAN - STENCIL, 0) : begin + _SPAN] = True
        progress(min(1.0, span.stop / len(time)))
        if span.stop >= len(time):
            break
    off = np.linalg.norm(shift, axis=-1)
    if off.max() > _FARTHEST:
        raise UsageError(
            f"at t = {time[np.argmax(off)]:.6g} s the base cannot follow its path: the nearest "
            f"motion that its thrust allows is {off.max():.3g} m off; choose a gentler motion"
        )
    rate, growth = leaning.grid.rate, leaning.grid.growth
    return leaning.motion((axes, rate @ axes, growth @ axes), (shift, rate @ shift, growth @ shift))


def _deviation(vehicle: Vehicle, motion: Motion, weight: float) -> Deviation | None:
    """Where pieces between knots need lateral force, or other thrusts than at the knots beside.

    The farthest from what is allowed; None if both are next to nothing. `weight` in N.
    """
    time = refined(motion.time, 2)
    q, v, a = vehicle.kinematics.reference(motion)(time)
    force = vehicle.base_wrench(q, vehicle.inverse_dynamics(q, v, a))[:, :3]
    axis = _axes(vehicle, Motion(time, q, v, a))
    lateral = np.linalg.norm(np.cross(axis, force), axis=-1)[1::2]
    thrusts = needed_inputs(vehicle, q, v, a)[:, : vehicle.rotors]
    between = thrusts[1::2] - 0.5 * (thrusts[:-1:2] + thrusts[2::2])
    shares = np.stack(
        [lateral / (_LATERAL * weight), np.abs(between).max(axis=-1) / (_UNEVEN * weight)]
    )
    kind, place = np.unravel_index(np.argmax(shares), shares.shape)
    if shares[kind, place] <= 1.0:
        return None
    off = (_LATERAL, _UNEVEN)[kind] * weight * shares[kind, place]
    return Deviation(int(place), time[1::2][place], off, "N")
