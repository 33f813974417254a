"""Control laws as array programs: the generalised force that a motion needs, then inputs.

Computed torque is the inverse dynamics of the desired acceleration, corrected by the errors: each
error e then obeys ë + d ė + k e = 0. The geometric law is for rotors that push along one axis (Lee,
Leok and McClamroch, 2010): it tracks the centre of mass, and turns the base so that its thrust axis
is where the force must be. `flight.control` says more on both.

The passive law (Slotine and Li, 1987) has reference velocities v_r = v_desired + λ e, which lead to
the motion, and with s = v_r - v the force

    M a_r + C(q, v) v_r + gravity + D M D s,    D² = d - λ,    λ = d/2 - √(d²/4 - k)

so that M ṡ + (C + D M D) s = 0, and ½ sᵀ M s only falls, since the rate of M less 2 C is
skew-symmetric. Where all d are one and k one, or nothing couples, ë + d ė + k e = 0; where d² is
less than 4 k the root is 0. With a quaternion that holds while the axis of its error stays.

The adaptive law has beside that Y(q, v, v_r, a_r) δ, where Y is the reference regressor, and learns
what the base parameters are more than those it knows, δ̇ = Γ Yᵀ s. With δ off by ε, what falls is
½ sᵀ M s + ½ εᵀ Γ⁻¹ ε.

At a contact a frame, such as the tip, moves as a body on springs and dampers along its path: at x,
off its path by e and pushed by its surroundings with w, it obeys

    inertia (ẍ_desired - ẍ) + damping ė + stiffness e + w = 0

Where force is controlled, it pushes along a direction n as hard as wanted, f plus what integral
action has learnt, in place of the spring there; across it the spring alone decides, whatever w is.
What w does to all else is made up for, so that the posture is held as in free flight.

Where the base leans, joints alone move the frame. A servo with the stiffness k and the damping d,
at q and v, is sent to q + (τ + d v) / k, where it exerts the torque τ that the law wants (Khatib,
Thaulad, Yoshikawa and Park, "Torque-position transformer for task control of position controlled
robots", 2008). Other laws send servos to the posture.

To add a law, add a row to `LAWS`: flights, scenario files and `generate --laws` read it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import named
from gibbs_codegen.arrays.nodes import (
    Node,
    arctan2,
    choose,
    clip,
    constant,
    cross,
    dot,
    external,
    join,
    mark,
    maximum,
    reshaped,
    solve,
    square_root,
    zeros,
)
from gibbs_codegen.machine import mechanism
from gibbs_codegen.machine.allocation import nearest_thrusts, smallest_thrusts
from gibbs_codegen.machine.base import Base, Motion, base_of, length, placed

# Greatest force that corrects errors, as a share of the desired one: the sum never turns round.
_AUTHORITY = 0.8
# Least sum of 1 and the cosine of an angle by which a direction is turned: none is turned round.
_LEAST = 1e-9
# Weight, m² s², times the stiffness of its error, of a joint's acceleration off its posture's
# beside that of the frame where the base leans: it counts where the arm is nearly straight.
_POSTURE = 4e-6
# The same of a joint that a servo holds: it goes where its posture is.
_HELD = 1e6
# Squares of sines below this one are those of angles that are their sines but for rounding.
_NO_ANGLE = 1e-16


@dataclass(frozen=True)
class Gains:
    """Stiffness k (nv), 1/s², and damping d (nv), 1/s, of the tracking errors.

    `integral`, 1/s, is the rate of integral action, None without.
    """

    stiffness: Node
    damping: Node
    integral: Node | None = None


class Limits(NamedTuple):
    """Least and greatest inputs (nu)."""

    least: Node
    most: Node


class Weight(NamedTuple):
    """Figures of a robot for the geometric law: mass, kg, weight (3), N, and thrust axis (3).

    The weight is the force that holds it, in world axes; the axis is a unit vector of the base's
    frame along which rotors push.
    """

    mass: Node
    weight: Node
    axis: Node


@dataclass(frozen=True)
class Rotors:
    """The rotors, and then the wheels, as a law knows them: what shares a wrench, their limits.

    `centre` (3), m, is the base centre from where x, y, z are, in the base's frame; `distribution`
    (N, 6) the least thrusts of a wrench about it, `wrenches` (N, 6) those of unit thrusts; `least`
    and `most` (N) are limits of the thrusts, if they are `limited`. `move`: joints move them.
    `refuse`: a wrench that they cannot produce is refused, but for a share `exact` of it.
    """

    centre: Node
    distribution: Node
    wrenches: Node
    least: Node
    most: Node
    limited: bool = True
    move: bool = False
    refuse: bool = False
    exact: Node | float = 1e-9


@dataclass(frozen=True)
class CentrePath:
    """Desired position, velocity and acceleration (3 each) of the centre of mass."""

    position: Node
    velocity: Node
    acceleration: Node


@dataclass(frozen=True)
class PushAim:
    """The push of a frame: along a unit vector (3), world axes, with a force, N.

    `share`, 0 to 1, is how far that is in force; `integral`, 1/s, the rate at which the error of
    the measured force is learned. `axes` (3, 3) is the rotation to the world's axes from those
    that turn with the direction, if it turns: what is remembered, N s along it and m s across it,
    has entries there, so that none becomes one of another unit.
    """

    direction: Node
    force: Node
    share: Node
    integral: Node
    axes: Node | None = None

    def to_world(self, remembered: Node) -> Node:
        """Entries (3) in world axes of what is remembered."""
        return remembered if self.axes is None else self.axes @ remembered

    def from_world(self, rates: Node) -> Node:
        """Entries (3) of rates in world axes where they are remembered."""
        return rates if self.axes is None else self.axes.transposed @ rates


def push_shares(time: Node, begin: Node, end: Node, rise: Node) -> tuple[Node, Node]:
    """The shares of a push, 0 to 1, that have come and that have gone again at times, s."""
    come, gone = (clip((time - instant) / rise, 0.0, 1.0) for instant in (begin, end))
    return come * come * (3.0 - 2.0 * come), gone * gone * (3.0 - 2.0 * gone)


@dataclass(frozen=True)
class FrameAim:
    """The frame that a law moves, by its number, and how.

    Stiffness, N/m, damping, N s/m, and inertia, kg, are those along the world's axes (3 each).
    `wrench` (6) is measured: the force, N, and the torque about the frame's origin, N m, that the
    surroundings do to it, world axes. Without `push` it does not control force. Its `velocity` (3)
    is that of the desired motion, or another.
    """

    number: int
    stiffness: Node
    damping: Node
    inertia: Node
    wrench: Node
    push: PushAim | None = None
    velocity: Node | None = None

    @property
    def force(self) -> Node:
        """The measured force (3)."""
        return self.wrench[:3]


@dataclass(frozen=True)
class Estimates:
    """How much more base parameters (np) are than the robot's, and gains of their adaptation.

    The gains, one for each or a matrix, are squares of how far they may be off, over an energy, J.
    """

    parameters: Node
    adaptation: Node


@dataclass(frozen=True)
class Aim:
    """The aim of a law, and its gains.

    `memory` (nv) are the integrals of the errors, if the law remembers them: where the base leans,
    of joints and of the centre of mass, in the places of the position. `path` and `weight` are
    there where the base leans, `frame` where the law moves a frame; what it remembers of that (3)
    is at the end of the memory. A law that learns parameters has `estimates`.
    """

    desired: Motion
    gains: Gains
    memory: Node | None = None
    path: CentrePath | None = None
    weight: Weight | None = None
    frame: FrameAim | None = None
    estimates: Estimates | None = None

    @property
    def remembered(self) -> Node:
        """The integrals (nv or more), 0 without."""
        beside = 0 if self.frame is None else 3
        return zeros(self.gains.damping.size + beside) if self.memory is None else self.memory

    @property
    def learnt(self) -> Node:
        """The part of integral action in the errors (nv or more)."""
        if self.memory is None or self.gains.integral is None:
            return self.remembered
        return self.gains.integral * self.memory


def computed_torque(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Generalised force (nv) of the desired acceleration, corrected by the errors."""
    base, gains, desired = base_of(robot, q), aim.gains, aim.desired
    error, rate = base.errors(v, desired)
    error = named(error, "error", "Errors of the base and of the joints, desired less actual.")
    rate = named(rate, "error_rate", "How fast the errors change.")
    error = error + aim.learnt
    pull = gains.stiffness * error + gains.damping * rate
    a = base.corrected(v, desired, named(pull, "pull", "What the gains make of the errors."))
    a = mechanism.closed(robot, q, v, a)
    return robot.inverse_dynamics(q, v, named(a, "a", "Accelerations by which errors decay."))


def passive(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Generalised force (nv) that damps what velocities are off those that lead to the motion."""
    motion, _, pull = _referred(robot, q, v, aim)
    return robot.passive_inverse_dynamics(q, v, motion.v, motion.a) + pull


def adaptive(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Generalised force (nv) of the passive law, with the base parameters that are learnt."""
    assert aim.estimates is not None  # noqa: S101 - the law learns
    motion, _, _ = _referred(robot, q, v, aim)
    regressor: Node = robot.reference_regressor(q, v, motion.v, motion.a)
    return passive(robot, q, v, aim) + regressor @ aim.estimates.parameters


def adaptation(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Rates (np) of the parameters that the adaptive law learns."""
    assert aim.estimates is not None  # noqa: S101 - the law learns
    motion, ahead, _ = _referred(robot, q, v, aim)
    regressor = robot.reference_regressor(q, v, motion.v, motion.a)
    gain, pull = aim.estimates.adaptation, regressor.transposed @ ahead
    return gain @ pull if len(gain.shape) == 2 else gain * pull


def _referred(robot: Functions, q: Node, v: Node, aim: Aim) -> tuple[Motion, Node, Node]:
    """The reference of a passive law, how far velocities are behind it, and the pull on these."""
    base, gains, desired, places = base_of(robot, q), aim.gains, aim.desired, robot.layout.v
    error, rate = base.errors(v, desired)
    none = zeros(places.size)
    half = 0.5 * gains.damping
    apart = square_root(maximum(half * half - gains.stiffness, 0.0))
    slow, root = half - apart, square_root(half + apart)
    # Rates of errors turn into velocities as accelerations of robots at rest do.
    still = Motion(desired.q, none, none)
    ahead = base.corrected(none, still, rate + slow * (error + aim.learnt))
    v_r = v + ahead
    # Velocities of the reference turn with the base's axes, which turn as they do.
    turning = placed(robot, v[places.attitude], base.travels(v_r), v[places.joints])
    a_r = base.corrected(turning, desired, slow * rate)
    pull = root * robot.momentum(q, root * ahead)
    return Motion(q, v_r, a_r), ahead, named(pull, "pull", "What damps velocities, N and N m.")


def geometric(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Generalised force (nv) by which centre of mass, thrust axis and joints follow a motion."""
    desired, gains, learnt = aim.desired, aim.gains, aim.learnt
    path, weight = aim.path, aim.weight
    assert path is not None and weight is not None  # noqa: S101, PT018 - the base leans
    axis = weight.axis
    base, places = base_of(robot, q), robot.layout.v
    along = named(base.to_world(axis), "along", "The thrust axis in world axes.")
    jacobian = robot.centre_of_mass_jacobian(q)
    moving = robot.centre_of_mass(q), jacobian @ v
    if aim.frame is not None:
        weight = weight._replace(weight=weight.weight - aim.frame.force)
    needed = _needed(moving, path, along, base, gains, weight, learnt)
    turning = _turning(robot, q, v, desired, axis, needed, gains)
    turning = named(turning, "turning", "Angular acceleration by which the base leans.")
    at, rates = robot.layout.q.joints, places.joints
    error = (_entries(desired.q) - _entries(q))[at] + learnt[rates]
    joints = desired.a[rates] + gains.stiffness[rates] * error
    joints = joints + gains.damping[rates] * (desired.v[rates] - v[rates])
    attitude, thrust = base.attitude_entries(v, turning), maximum(dot(needed[0], along), 0.0)
    if aim.frame is not None:
        pushed = (thrust * along - weight.weight) / weight.mass
        joints = _reaching(robot, q, v, aim, placed(robot, attitude, zeros(3), joints), pushed)
    a = mechanism.closed(robot, q, v, placed(robot, attitude, zeros(3), joints))
    generalised = robot.inverse_dynamics(q, v, a)
    if aim.frame is not None:
        generalised = generalised - _felt(robot, q, aim.frame)
    return with_thrust(robot, q, generalised, thrust * along)


def with_thrust(robot: Functions, q: Node, generalised: Node, thrust: Node) -> Node:
    """A generalised force (nv) with another force (3) of the rotors, world axes.

    Another acceleration of the machine as a whole makes up for what the one is not.
    """
    base = base_of(robot, q)
    exerted = base.to_world(base.wrench(zeros(3), generalised)[:3])
    return generalised + robot.centre_of_mass_jacobian(q).transposed @ (thrust - exerted)


def at_frame(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Generalised force (nv) by which a frame moves as a body on springs, and pushes.

    Of all accelerations that do so it takes those nearest to the posture's, weighed by the
    stiffness of each error: what is held loosely moves most. Joints that servos hold do not.
    """
    base, gains, desired, frame = base_of(robot, q), aim.gains, aim.desired, aim.frame
    assert frame is not None  # noqa: S101 - the law moves a frame
    error, rate = base.errors(v, desired)
    error = error + aim.learnt[: v.size]
    a = base.corrected(v, desired, gains.stiffness * error + gains.damping * rate)
    jacobian = robot.frame_jacobians(q)[frame.number][:3]
    looseness = choose(gains.stiffness, 0.0, 1.0 / maximum(gains.stiffness, _LEAST), 0.0)
    moved = reshaped(looseness, (looseness.size, 1)) * jacobian.transposed
    lacking = _wanted(robot, q, v, aim) - jacobian @ a
    square = jacobian @ moved
    # A machine that moves in a plane has nothing that moves the frame across it.
    square = square + constant(np.eye(3)) * choose(square, 0.0, 0.0, 1.0)
    a = a + moved @ solve(square, lacking)
    return robot.inverse_dynamics(q, v, a) - _felt(robot, q, frame)


def _frame_learning(robot: Functions, q: Node, frame: FrameAim, aim: Aim) -> Node:
    """Rates (3) of what a law remembers of a frame: its errors, of its force along the push, N s.

    Without force control nothing, since a frame that learned would not yield.
    """
    if frame.push is None:
        return zeros(3)
    push, off = frame.push, _off(robot, q, aim)
    felt = -dot(push.direction, frame.force)
    # Far from half of the force there is no contact yet: on the way there nothing is learned.
    touching = clip(2.0 * felt / maximum(push.force, _LEAST), 0.0, 1.0)
    along = push.share * touching * (push.force - felt)
    return push.from_world(off + (along - dot(push.direction, off)) * push.direction)


def _off(robot: Functions, q: Node, aim: Aim) -> Node:
    """The distance (3), m, of the moved frame from its path."""
    assert aim.frame is not None  # noqa: S101 - the law moves a frame
    here, there = (robot.frame_poses(x)[aim.frame.number] for x in (q, aim.desired.q))
    return join(*(there[i][3] - here[i][3] for i in range(3)))


def _felt(robot: Functions, q: Node, frame: FrameAim) -> Node:
    """Generalised force (nv) of what the surroundings do to a frame."""
    return robot.frame_jacobians(q)[frame.number].transposed @ frame.wrench


def _wanted(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Acceleration (3) of the frame that is moved, less that by accelerations of coordinates 0."""
    desired, frame = aim.desired, aim.frame
    assert frame is not None  # noqa: S101 - the law moves a frame
    number, push = frame.number, frame.push
    velocity, ahead = frame.velocity, zeros(3)
    if velocity is None:
        along_path = robot.frame_jacobians(desired.q)[number][:3]
        ahead = robot.frame_bias_accelerations(desired.q, desired.v)[number][:3]
        velocity, ahead = along_path @ desired.v, ahead + along_path @ desired.a
    pull = frame.stiffness * _off(robot, q, aim)
    if push is None:
        pull = pull + frame.force
    else:
        n, learnt = push.direction, push.to_world(aim.learnt[v.size :])
        felt = dot(n, frame.force)
        pull = pull + frame.stiffness * (learnt - dot(n, learnt) * n) + felt * n
        remembered = dot(n, push.to_world(aim.remembered[v.size :]))
        wish = push.force + push.integral * remembered + felt
        # What is pushed decides how the frame moves there, and not its path.
        pull, velocity, ahead = (
            x + push.share * (other - dot(n, x)) * n
            for x, other in ((pull, wish), (velocity, 0.0), (ahead, 0.0))
        )
    pull = pull + frame.damping * (velocity - robot.frame_jacobians(q)[number][:3] @ v)
    pull = named(pull, "pull", "Force that moves the frame, N.")
    return ahead + pull / frame.inertia - robot.frame_bias_accelerations(q, v)[number][:3]


def _reaching(robot: Functions, q: Node, v: Node, aim: Aim, a: Node, pushed: Node) -> Node:
    """Accelerations of the joints that move a frame, of a machine that leans.

    `a` (nv) are those of the attitude and the posture; `pushed` (3) is that of the centre of mass,
    which the arm cannot help: it moves the frame relative to that.
    """
    places, frame, weight = robot.layout.v, aim.frame, aim.weight
    joints = places.joints
    assert frame is not None and weight is not None  # noqa: S101, PT018 - it leans, moves a frame
    if joints.start == joints.stop:
        return a[joints]
    base, rest = base_of(robot, q), zeros(a.size)
    held = base.to_world(base.wrench(zeros(3), robot.inverse_dynamics(q, v, rest))[:3])
    drift = (held - weight.weight) / weight.mass
    relative = robot.frame_jacobians(q)[frame.number][:3] - robot.centre_of_mass_jacobian(q)
    lacking = _wanted(robot, q, v, aim) - (pushed - drift) - relative @ a
    levers = relative.transposed[joints]
    stiffness = aim.gains.stiffness[joints]
    holding = choose(stiffness, 0.0, _POSTURE * stiffness, _HELD)
    square = levers @ levers.transposed
    square = square + constant(np.eye(holding.size)) * reshaped(holding, (holding.size, 1))
    return a[joints] + solve(square, levers @ lacking)


def memory_size(robot: Functions, law: str) -> int:
    """How many numbers a law remembers, if any: of errors (nv), and of a frame it moves (3).

    A law that learns parameters remembers these (np) alone.
    """
    if law in LAWS and LAWS[law].learns:
        return robot.signatures["reference_regressor"].shapes[0][1]
    return robot.space.velocities + 3 * (law in LAWS and LAWS[law].moves_frame)


def learning(robot: Functions, q: Node, v: Node, aim: Aim) -> Node:
    """Rates of what a law remembers: errors, of coordinates or others, or parameters."""
    if aim.estimates is not None:
        return adaptation(robot, q, v, aim)
    path, frame, places = aim.path, aim.frame, robot.layout.v
    of_frame = zeros(0) if frame is None else _frame_learning(robot, q, frame, aim)
    if path is None:
        errors = base_of(robot, q).errors(v, aim.desired)[0]
        position = base_of(robot, q).travels(errors) if frame is None else zeros(3)
        parts = errors[places.attitude], position, errors[places.joints]
    else:
        joints = (_entries(aim.desired.q) - _entries(q))[robot.layout.q.joints]
        joints = joints if frame is None else zeros(joints.size)
        parts = zeros(3), path.position - robot.centre_of_mass(q), joints
    # What the frame needs decides where it is held loosely: the base or, of one that leans, joints.
    return join(placed(robot, *parts), of_frame)


@dataclass(frozen=True)
class Law:
    """A law: the generalised force (nv) at a state, its name in messages, and what it does.

    By its gains small errors e obey ë + d ė + k e = 0. A law under which the base leans is for
    rotors that push along one axis and command three moments, the others are for rotors that
    command all directions. Scenarios ask for it by its name, or by that of its `task`, for which
    each base has a law: "tracking", or at a contact "impedance" or "force". `calls` are functions
    on request that it calls. One that `learns` remembers base parameters in place of errors.
    """

    force: Callable[[Functions, Node, Node, Aim], Node]
    title: str
    words: str
    leans: bool = False
    task: str = "tracking"
    calls: tuple[str, ...] = ()
    learns: bool = False

    @property
    def moves_frame(self) -> bool:
        """True if it moves a frame, and measures the wrench on it."""
        return self.task != "tracking"

    @property
    def pushes(self) -> bool:
        """True if it controls the force of that frame."""
        return self.task == "force"

    def hindrance(self, joints: int, frame: str) -> str | None:
        """Why it cannot move a frame, in words; None where it can, or need not."""
        if joints or not (self.leans and self.moves_frame):
            return None
        return f"{self.title} moves {frame} by joints, and there are none"


_PASSIVE = ("momentum", "passive_inverse_dynamics")
LAWS = {
    "computed_torque": Law(
        computed_torque,
        "computed torque",
        "Computed torque: inputs by which every error e obeys e'' + d e' + k e = 0, within their "
        "limits.",
    ),
    "geometric": Law(
        geometric,
        "the geometric law",
        "The geometric law, for rotors that push along one axis: inputs by which the centre of "
        "mass, the thrust axis and the joints follow a motion, within their limits.",
        leans=True,
    ),
    "passive": Law(
        passive,
        "the passive law",
        "The law of Slotine and Li: inputs that compensate only gravity and the reference "
        "motion, and damp deviations from the reference velocity, within their limits.",
        calls=_PASSIVE,
    ),
    "adaptive": Law(
        adaptive,
        "the adaptive law",
        "The adaptive law of Slotine and Li: the passive law, with base parameters that it "
        "estimates by a step of h in each call, for a robot that differs from its constants.",
        calls=(*_PASSIVE, "reference_regressor"),
        learns=True,
    ),
    "impedance": Law(
        at_frame,
        "impedance control",
        "Impedance of a frame: inputs with which it moves as a body on springs and dampers and "
        "yields to contact forces, while the rest holds its posture, within their limits.",
        task="impedance",
    ),
    "force": Law(
        at_frame,
        "force control",
        "Force and position of a frame: inputs with which it pushes along a direction and "
        "follows its path across it, while the rest holds its posture, within their limits.",
        task="force",
    ),
    "geometric_impedance": Law(
        geometric,
        "geometric impedance control",
        "The geometric law with impedance of a frame, which the joints move: inputs with which "
        "the base leans against contact forces on the frame, within their limits.",
        leans=True,
        task="impedance",
    ),
    "geometric_force": Law(
        geometric,
        "geometric force control",
        "The geometric law with force and position of a frame, which the joints move: inputs "
        "with which the base leans against the force of the frame, within their limits.",
        leans=True,
        task="force",
    ),
}


def turns_servos(law: str) -> bool:
    """True if a law sends servos where they exert the torques that it wants, not to the posture."""
    return law in LAWS and LAWS[law].leans and LAWS[law].moves_frame


def _entries(q: Node) -> Node:
    """Entries of coordinates as a vector."""
    return join(q)


def _needed(
    moving: tuple[Node, Node],
    path: CentrePath,
    along: Node,
    base: Base,
    gains: Gains,
    robot: Weight,
    learnt: Node,
) -> tuple[Node, Node, Node]:
    """Force (3) that the centre of mass needs, the part that corrects errors, the rate of that."""
    stiffness, damping = base.travels(gains.stiffness), base.travels(gains.damping)
    mass, off = robot.mass, path.position - moving[0]
    desired = mass * path.acceleration + robot.weight
    drift = path.velocity - moving[1]
    wish = mass * (stiffness * (off + base.travels(learnt)) + damping * drift)
    most = _AUTHORITY**2 * dot(desired, desired)
    share = 1.0 / square_root(1.0 + dot(wish, wish) / most)
    correction = share * wish
    force = named(desired + correction, "force", "Force that the centre of mass needs, N.")
    thrust = maximum(dot(force, along), 0.0)
    learning = drift if gains.integral is None else drift + gains.integral * off
    growth = mass * (stiffness * learning) + damping * (desired - thrust * along)
    bend = dot(wish, growth) * (share * share * share) / most
    return force, correction, share * growth - bend * wish


def _turning(
    robot: Functions,
    q: Node,
    v: Node,
    desired: Motion,
    axis: Node,
    needed: tuple[Node, Node, Node],
    gains: Gains,
) -> Node:
    """Angular acceleration (3), base's frame, by which the base leans as the force needs it."""
    base, wanted = base_of(robot, q), base_of(robot, desired.q)
    spin, _ = base.angular(v, 0.0 * v)
    spin_desired, acceleration = wanted.angular(desired.v, desired.a)
    force, correction, rate = map(wanted.to_base, needed)
    size = length(force)
    unit = force / size
    # How fast the force turns, seen from the desired base, in which the desired one does not.
    moving = (rate - cross(spin_desired, correction)) / size
    about = cross(unit, moving)
    leaning = about - dot(about, axis) / maximum(1.0 + dot(axis, unit), _LEAST) * unit
    ahead = base.to_base(wanted.to_world(spin_desired + leaning))
    growth = base.to_base(wanted.to_world(acceleration + cross(spin_desired, leaning)))
    swing, scalar = cross(axis, unit), maximum(1.0 + dot(axis, unit), _LEAST)
    columns = [_turned(swing, scalar, constant(np.eye(3)[k])) for k in range(3)]
    there, *columns = (base.to_base(wanted.to_world(x)) for x in (unit, *columns))
    error = named(
        _attitude_error(axis, there, columns), "attitude_error", "How the base must turn, rad."
    )
    weighed = _weighed(base, gains.stiffness, error, axis)
    return growth - cross(spin, ahead) + weighed + _weighed(base, gains.damping, ahead - spin, axis)


def _turned(swing: Node, scalar: Node, x: Node) -> Node:
    """A vector (3), turned by the quaternion of any length with these parts."""
    once = cross(swing, x)
    return x + 2.0 / (scalar * scalar + dot(swing, swing)) * (scalar * once + cross(swing, once))


def _attitude_error(axis: Node, there: Node, columns: Sequence[Node]) -> Node:
    """The turn that the base needs: its thrust axis by the shortest way, then about that axis.

    The two rotation vectors added (3), in the base's frame. The more the axis is off, the less the
    heading counts, and where it is opposite, not at all. `there` (3) is where the axis must be, and
    `columns` (3 of 3) are the rotation that is left once the axis is there.
    """
    swing, cosine_of = cross(axis, there), dot(axis, there)
    square = dot(swing, swing)
    sine_of = square_root(maximum(square, _NO_ANGLE))
    # Near no angle it is its sine, so that there is a derivative where the axis is in its place.
    near = choose(cosine_of, 0.0, choose(_NO_ANGLE, square, 1.0, 0.0), 0.0)
    share = choose(near, 0.5, 1.0 + square / 6.0, arctan2(sine_of, cosine_of) / sine_of)
    kept = sum((axis[k] * dot(axis, columns[k]) for k in range(3)), constant(0.0))
    cosines = columns[0][0] + columns[1][1] + columns[2][2] - kept
    about = join(
        columns[1][2] - columns[2][1], columns[2][0] - columns[0][2], columns[0][1] - columns[1][0]
    )
    heading = arctan2(dot(axis, about), cosines)
    return share * swing + 0.5 * (1.0 + kept) * heading * axis


def _weighed(base: Base, gains: Node, error: Node, axis: Node) -> Node:
    """Attitude errors (3) times gains (nv): about the axis (3) those of the position."""
    heading = dot(axis, error) * axis
    return base.turns(gains) * (error - heading) + base.travels(gains) * heading


def inputs_of(robot: Functions, q: Node, force: Node, rotors: Rotors) -> tuple[Node, Node]:
    """Inputs (nu) of a generalised force (nv): least thrusts of its wrench, efforts of the joints.

    Where thrusts exceed their limits, those within them that come nearest to the wrench. The other
    result is more than 0, or no number, where rotors cannot produce the wrench at all.
    """
    base, count, wheels = base_of(robot, q), robot.rotors, robot.layout.q.wheels
    if not count and not robot.layout.v.base:  # Joints are all that moves.
        return force[robot.layout.v.joints], constant(0.0)
    wrench = base.wrench(rotors.centre, force)
    wrench = named(wrench, "wrench", "Force and torque that must act on the base.")
    columns, efforts, refused = rotors.wrenches, force[robot.layout.v.joints], constant(0.0)
    if rotors.move:
        columns = moved_wrenches(robot, q, rotors)
        thrusts = smallest_thrusts(columns, wrench)
    else:
        thrusts = rotors.distribution @ wrench
    if rotors.refuse:
        left = wrench - columns.transposed @ thrusts
        beyond = length(left) - rotors.exact * (1.0 + length(wrench))
        # What is no number already is not refused: it ends a flight by itself.
        refused = choose(beyond, 0.0, beyond, 0.0)
    if rotors.limited:
        thrusts = nearest_thrusts(thrusts, wrench, columns, rotors.least, rotors.most)
        # It returns no numbers where it finds none.
        refused = refused + choose(mark(wrench) + 1.0, 0.0, mark(thrusts), 0.0)
    if rotors.move:
        loads = robot.input_matrix(q)[robot.layout.v.joints].transposed[:count]
        efforts = efforts - loads.transposed @ (thrusts[:count] if wheels else thrusts)
    if wheels:
        return join(thrusts[:count], efforts, thrusts[count:]), refused
    return join(thrusts, efforts), refused


def moved_wrenches(robot: Functions, q: Node, rotors: Rotors) -> Node:
    """Wrenches (N, 6) of unit thrusts about the base centre, where joints move the rotors."""
    base, loads = base_of(robot, q), robot.input_matrix(q).transposed
    moved = (base.wrench(rotors.centre, loads[k]) for k in robot.base_inputs)
    return join(*(reshaped(column, (1, 6)) for column in moved))


def weight_of(robot: Functions, q: Node, argument: Callable[..., Node], rotors: Rotors) -> Weight:
    """Figures of a robot for a law under which the base leans; `argument` makes inputs by name."""
    axis = argument("axis", 3)
    if rotors.move:
        axis = external("force_axis", (3,), moved_wrenches(robot, q, rotors))
    return Weight(argument("mass"), argument("weight", 3), axis)


def within_limits(inputs: Node, limits: Limits) -> Node:
    """Inputs (nu) within their limits."""
    return clip(inputs, limits.least, limits.most)
