"""The envelope of a flight, beyond which control is lost, and the modes of its closed loop.

Coordinates may be `divergence` (rad or m) off. The bound on rates follows from that: where a law
corrects errors, one that begins at a rate ė peaks at g ė, where g is the peak of the impulse
response of ë + d ė + k e = 0. Beyond a rate of `divergence` / g control is lost, even if it were
perfect from then on. Without the bound, a loop that feeds its own velocities back through lagging
motors escapes to infinity within a finite time, hardly off its path.

Linear modes tell the steps that an integrator can take. Errors decay by the roots of
`control.error_polynomials`, lagging thrusts by their time constants. To them come frames that lean
on walls, drag, and joints that servos and dry friction hold.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from decimal import ROUND_FLOOR, Context

import numpy as np

from gibbs_codegen.flight.attitude import LARGEST_THETA_0
from gibbs_codegen.flight.control.error_polynomials import error_polynomials
from gibbs_codegen.flight.control.laws import Gains
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.plant.actuators import has_battery, holds
from gibbs_codegen.flight.plant.environment import open_loops
from gibbs_codegen.flight.plant.vehicle import Array, Flags, Vehicle
from gibbs_codegen.flight.scenario.parts import PREDICTIVE
from gibbs_codegen.flight.scenario.walls import Wall, bristle, surface_at
from gibbs_codegen.machine.laws import LAWS

# A time, s, and the state then.
Instant = tuple[float, Array]
# A rate, rad/s or m/s, next to which dry friction is as it is about rest.
_AT_REST = 1e-9
# Levels over what any command makes them at rest.
_FAR = 10.0
# The least peak of errors that a servo corrects, s: their rates have no bound.
_LEAST_PEAK = 1e-12
# What to try instead of a law, where it is not lower gains.
_OTHER_CONTROL = {
    "open_loop": "a closed loop (control.law)",
    "own": "another controller",
    PREDICTIVE: "another control.law",
}

# Greater errors, in rad, m and their rates per s, than rounding leaves of a begin on the motion.
_OFF = 1e-6
_NEARER = "nearer to the desired motion (start.offset, start.turn_deg)"
# What the reason says of a state in which an entry is infinite, or no number.
NOT_FINITE = "the state is no longer finite"
# Steps that are proposed keep what was asked for once they are rounded.
_DOWN = Context(prec=2, rounding=ROUND_FLOOR)
# Rates that are differences are off by a smaller share.
_ROUNDED = 1.0 + 1e-6
# Instants of the desired motion at which masses that walls feel are looked at.
_INSTANTS = 33


class Envelope:
    """The tracking errors beyond which control counts as lost.

    `bounds` (2 nv) are those of errors (rad or m) and then of their rates (rad/s or m/s). All are
    infinite where nothing is controlled, and those of rates in open loop, whose inputs do not grow
    with the error. `divergence` is the bound of the coordinates. By `start`, the time, s, and the
    state (size) of the begin, advice tells what begins far off; None of many flights.
    """

    def __init__(
        self, loop: ClosedLoop, divergence: float, duration: float, start: Instant | None = None
    ) -> None:
        self.loop, self._start = loop, start
        controller = loop.controller
        count = loop.vehicle.layout.v.size
        self.bounds: Array = np.full(2 * count, np.inf)
        if controller.law != "off":
            self.bounds[:count] = divergence
        if controller.law in LAWS:
            peaks = np.clip(_peak_response(controller.gains), _LEAST_PEAK, duration)
            self.bounds[count:] = divergence / peaks
        # Joints that nothing drives, as of wheels and loads that hang, are not controlled.
        joints = loop.vehicle.layout.v.joints
        hanging = loop.actuators.efforts[: loop.vehicle.joints] == 0.0
        self.bounds.reshape(2, -1)[:, joints][:, hanging] = np.inf
        self._bounded = bool(np.any(np.isfinite(self.bounds)))

    def holds(self, time: Array, states: Array) -> Flags:
        """True (s) for states (s, size) at times (s) that are finite and within the bounds."""
        inside = self._finite(states)
        inside[inside] = np.all(self._errors(time[inside], states[inside]) <= self.bounds, axis=-1)
        return inside

    def _finite(self, states: Array) -> Flags:
        """True if states (…, size) are finite, with attitudes: 0 is left of what overflows."""
        finite: Flags = np.logical_and.reduce(np.isfinite(states), axis=-1)
        layout = self.loop.vehicle.layout
        if layout.is_quaternion:
            finite &= np.logical_or.reduce(states[..., layout.q.attitude], axis=-1)
        return finite

    def goes_on(self, time: Array, states: Array) -> Flags:
        """From which states (s, size) a flight can go on: there is no `reason` why not."""
        return self.holds(time, states) & ~self._singular(states)

    def _singular(self, states: Array) -> Flags:
        """True if states (…, size) have come to the singularity of attitude angles."""
        middle = self.loop.vehicle.layout.middle_angle
        if middle is None:
            return np.zeros(states.shape[:-1], dtype=bool)
        # The angle is not wrapped, so this also finds a step across the singularity.
        return np.abs(states[..., middle]) > LARGEST_THETA_0

    def reason(self, time: float, state: Array) -> str:
        """Why a flight cannot go on from a state, with the time and a remedy; "" if it can."""
        lost = f"at t = {time:.6g} s control is lost: "
        if not self._finite(state):
            return f"{lost}{NOT_FINITE}; {self._advice(time, [])}"
        if self._bounded:
            excess = self._errors(time, state) / self.bounds
            worst = int(np.argmax(excess))
            if excess[worst] > 1.0:
                advice = f"begin {_NEARER}, or with a greater integration.divergence"
                if self._start is None or time > self._start[0]:
                    advice = self._advice(time, self.loop.saturated(time, state))
                return f"{lost}{self._in_words(worst, excess[worst])}; {advice}"
        vehicle = self.loop.vehicle
        middle = vehicle.layout.middle_angle
        if middle is not None and self._singular(state):
            name, sequence = vehicle.coordinates[middle], vehicle.layout.angle_axes
            return (
                f"at t = {time:.6g} s the attitude reaches the singularity of the sequence "
                f"{sequence} ({name} = {np.degrees(state[middle]):.4g}°)"
            )
        return ""

    def _errors(self, time: float | Array, states: Array) -> Array:
        """Magnitudes of the tracking errors, then of their rates (…, 2 nv), 0 without bounds."""
        if not self._bounded:
            return np.zeros((*states.shape[:-1], len(self.bounds)))
        q, v = self.loop.parts(states)[:2]
        q_desired, v_desired, _ = self.loop.controller.reference(time)
        back = self.loop.controller.gains.back
        off = self.loop.vehicle.kinematics.errors(q, v, q_desired, v_desired, back)
        return np.abs(np.concatenate(off, axis=-1))

    def _in_words(self, place: int, excess: float) -> str:
        vehicle = self.loop.vehicle
        is_rate, coordinate = divmod(place, vehicle.layout.v.size)
        name = vehicle.kinematics.error_names[coordinate]
        unit = vehicle.layout.v.units[coordinate].removesuffix("/s")
        divergence = f"{self.bounds[coordinate]:.3g} {unit} (integration.divergence)"
        off = f"{excess * self.bounds[place]:.3g} {unit}"
        if is_rate:
            return (
                f"the rate of {name} is {off}/s off, which moves it more than {divergence} away "
                "even under perfect control"
            )
        return f"{name} is {off} off, more than {divergence}"

    def _advice(self, time: float, saturated: Sequence[str]) -> str:
        """Advice at a time, by the inputs that are at their limits."""
        loop = self.loop
        holds = loop.environment.hold if loop.environment else ()
        if words := open_loops(loop.vehicle.module, holds, time):
            return f"it moves with {words}"
        if weakness := too_weak(loop):
            return weakness
        law, sampled = loop.controller.law, loop.hold is not None
        lagging = loop.lags and not loop.compensates
        thrusts = loop.vehicle.inputs[: loop.vehicle.rotors]
        at_limits = {name in thrusts for name in saturated}
        gains = ["a lower control.attitude_frequency", "a lower control.frequency"]
        # With commands those of a scenario are within what these make.
        wider = "rotors' limits in the robot file" if loop.vehicle.is_driven else "motors.limits"
        far = (at := self._start) and self._errors(*at).max() > _OFF and loop.saturated(*at)
        remedies = [
            *([f"a start {_NEARER}"] if far else []),
            *([f"wider {wider}"] if True in at_limits else []),
            *(["a greater arm.effort"] if False in at_limits else []),
            *(gains if sampled and lagging and law in LAWS else []),
            *(["motors.compensation"] if lagging and not sampled and not loop.compensated else []),
            *(["a shorter motors.time_constant"] if lagging else []),
            *(loop.environment.remedies if loop.environment else []),
            *(["a higher rate of control"] if sampled else []),
            _OTHER_CONTROL.get(law, "a lower control.frequency"),
        ]
        limits = f"inputs at their limits: {', '.join(saturated)}; " if saturated else ""
        return f"{limits}try {', '.join(dict.fromkeys(remedies))} or a gentler motion"


def too_weak(loop: ClosedLoop) -> str:
    """That the thrusts cannot carry the weight, whatever their directions; "" if they may."""
    vehicle = loop.vehicle
    most = float(np.sum(np.max(np.abs(loop.actuators.thrusts), axis=0)))
    still = np.zeros(vehicle.layout.v.size)
    force = vehicle.inverse_dynamics(vehicle.neutral, still, still)
    weight = float(np.linalg.norm(vehicle.base_wrench(vehicle.neutral, force)[:3]))
    if not vehicle.rotors or most >= weight:
        return ""
    return (
        f"all thrusts together reach {most:.4g} N, less than the weight, {weight:.4g} N; widen "
        "the limits (motors.limits, or the rotors' limits in the robot file)"
    )


def _peak_response(gains: Gains) -> Array:
    """Peaks (nv), s, of errors that begin at 0 with a rate of 1: the peak impulse response.

    It is 0 where a law does not correct the error, but a servo.
    """
    frequency = np.where(gains.stiffness > 0.0, np.sqrt(gains.stiffness), np.inf)
    ratio = gains.damping / (2.0 * frequency) + 0j
    root = np.sqrt(ratio**2 - 1.0)
    critical = root == 0.0
    # The time of the peak, times the frequency; its limit at critical damping is 1.
    peak = np.where(critical, 1.0, np.arccosh(ratio) / np.where(critical, 1.0, root))
    return np.exp(-(ratio * peak).real) / frequency


@dataclass(frozen=True, order=True)
class Mode:
    """A mode that decays at a `rate`, 1/s: its cause, how to slow it, and its eigenvalue, 1/s.

    `beside` is the other eigenvalue of the same mass, the conjugate if None, 0 of a mode without.
    `explicit`: whether method "euler" takes velocities of before the step, as it does of bristles.
    """

    rate: float
    cause: str
    remedy: str
    eigenvalue: complex = field(compare=False)
    beside: complex | None = field(default=None, compare=False)
    explicit: bool = field(default=False, compare=False)

    @property
    def longest_step(self) -> float:
        """Steps of rk4, s, in which the mode decays."""
        return 2.0 / self.rate if self.rate else math.inf  # Nothing moves a frame at a centre.

    def fault(self, size: float, method: str = "rk4") -> str:
        """Why steps of a size, s, make the mode grow, and what would be right; "" if it decays."""
        z, longest = size * self.eigenvalue, self.longest_step
        if method == "euler":
            longest = self._longest_of_euler
            grows = size > longest * _ROUNDED
        else:
            grows = not abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0) <= 1.0 + 1e-9
        if not grows:
            return ""
        most = _DOWN.create_decimal(longest * _ROUNDED)
        return (
            f"in steps of {size:.3g} s {method} makes errors grow, because of {self.cause}; use "
            f"steps of at most {float(most):g} s, or {self.remedy}"
        )

    @property
    def _longest_of_euler(self) -> float:
        """Steps of "euler", s, in which the mode decays.

        Explicit steps h obey |1 + h λ| ≤ 1. Semi-implicit ones, of two modes of one mass with the
        sum -s and the product p of their eigenvalues, p h² + 2 s h ≤ 4.
        """
        root = self.eigenvalue
        if self.explicit and root:
            return -2.0 * root.real / abs(root) ** 2
        other = self.beside
        if other is None:
            other = root.conjugate() if root.imag else 0.0
        total, product = -(root + other).real, (root * other).real
        most = total + math.sqrt(total**2 + 4.0 * product)
        return 4.0 / most if most > 0.0 else math.inf


def stable_modes(loop: ClosedLoop) -> list[Mode]:
    """Modes that decay, fastest first.

    They are of lagging thrusts, of errors that a law corrects at all times, of walls, drag and
    joints.
    """
    modes = []
    # A lag that is nothing, next to any step, is not nothing to divide by.
    lags = [max(lag, 1e-30) for lag in np.unique(loop.actuators.lag).tolist() if lag]
    for lag in lags:
        remedy = f"a longer time constant of the motors than {lag:g} s, or none"
        modes.append(Mode(1.0 / lag, "the motors' lag", remedy, complex(-1.0 / lag)))
    # Held inputs do not follow the errors within a step.
    felt = [] if loop.compensates else lags
    polynomials = [] if loop.hold is not None else error_polynomials(loop.controller, felt)
    modes += [
        Mode(abs(root), "the gains of control", "lower gains", complex(root))
        for root in itertools.chain.from_iterable(map(np.roots, polynomials))
        if root.real < 0.0
    ]
    walls = loop.environment.wall if loop.environment else ()
    others = wall_modes(loop.vehicle, walls, _configurations(loop)) if walls else []
    if loop.environment is not None and loop.environment.wind is not None:
        drag = loop.environment.figures["drag"]
        others += drag_modes(loop.vehicle, drag, _configurations(loop))
    if loop.controller.law != "off":
        others += lag_modes(loop.vehicle) + joint_modes(loop.vehicle, _configurations(loop))
    return sorted([*modes, *others], reverse=True)


def wall_modes(
    vehicle: Vehicle, walls: Sequence[Wall], q: Array, speed: Array | float = 0.0
) -> list[Mode]:
    """Modes of frames that lean on walls, and stick to them, with the least mass that each feels.

    That is the least at coordinates (s, nq), of a robot that is free to move, all frames of a wall
    touching it; its parameters may be arrays (s). What moves by x along the normal obeys
    ẍ + (c/m) ẋ + (s/m) x = 0 with the stiffness s of the wall and its damping c, to which
    dissipation d adds as under the weight, or as where the wall stops what meets it at a `speed` v
    (s), m/s: d v √(s m) at most, by its spring, and √(2 m v s d), by dissipation. Along the wall s
    and c are those of bristles, which without a load are lost at the rate s/c. Next to these the
    modes of control are small where a wall decides about steps.
    """
    poses, jacobians = vehicle.frame_poses(q), vehicle.frame_jacobians(q)
    inverse = np.linalg.inv(vehicle.mass_matrix(q))
    weight = np.broadcast_to(np.nan_to_num(np.abs(vehicle.mass * vehicle.gravity)), len(q))

    def felt(rows: Array) -> Array:
        """The mass (s), kg, that moves along all directions of contacts (s, c, k, nv)."""
        rows = rows.reshape(len(q), -1, rows.shape[-1])
        yielding = rows @ inverse @ np.swapaxes(rows, -1, -2)
        most = np.linalg.eigvalsh(yielding)[:, -1]
        # On an axis or a centre nothing pushes.
        return np.divide(1.0, most, out=np.full(len(q), math.inf), where=most > 0.0)

    modes: list[Mode] = []
    for wall in walls:
        frames = [vehicle.frames.index(frame) for frame in wall.frames]
        places = poses[:, frames][..., :3, 3]
        normals = surface_at(wall.kind, np.array(wall.figures), places)[1][:, :, np.newaxis]
        linear, angular = jacobians[:, frames, :3], jacobians[:, frames, 3:]
        across = normals @ linear
        where = f"the wall at {', '.join(wall.frames)}"
        mass, hardness = felt(across), wall.stiffness * wall.dissipation
        bounded = np.where(np.isfinite(mass), mass, 0.0)
        stopping = np.minimum(
            wall.dissipation * speed * np.sqrt(wall.stiffness * bounded),
            np.sqrt(2.0 * hardness * speed * bounded),
        )
        damping = wall.damping + np.maximum(wall.dissipation * weight, stopping)
        modes += _oscillation(f"{where}, which feels", wall.stiffness, damping, mass)
        if wall.friction:
            # The lowest point of each ball, which turns about its centre.
            moved = linear + wall.ball_radius * np.cross(
                np.swapaxes(normals, 2, 3), angular, axis=2
            )
            along = moved - np.swapaxes(normals, 2, 3) * (normals @ moved)
            stiffness, eases = bristle(wall)
            where = f"the bristles of {where}"
            modes += _oscillation(f"{where}, which feel", stiffness, eases, felt(along), True)
            rate = stiffness / eases
            modes.append(Mode(rate, where, "more of their damping", complex(-rate), explicit=True))
    return modes


def hard_impacts(
    vehicle: Vehicle,
    walls: Sequence[Wall],
    motion: tuple[Array, Array],
    times: Array,
    step: float,
    method: str = "rk4",
) -> Iterator[str]:
    """Sentences on impacts that steps, s, are too long for: of each frame at each wall the fastest.

    Coordinates (s, n, nq) and velocities (s, n, nv) at times (s), s, are those of n machines. An
    impact is where a frame comes to a surface before the next sample, if it goes on as it does.
    """
    q, v = motion
    if len(times) < 2 or not any(wall.dissipation for wall in walls):
        return
    poses, velocities = vehicle.frame_poses(q), vehicle.frame_velocities(q, v)
    until = np.diff(times, append=times[-1])[:, np.newaxis]
    # Steps of "euler" reverse what they more than stop: the damping, as the root of this, is twice.
    share = 4.0 if method == "euler" else 1.0
    for number, wall in enumerate(walls, start=1):
        for frame in wall.frames:
            k = vehicle.frames.index(frame)
            depth, normals = surface_at(wall.kind, np.array(wall.figures), poses[..., k, :3, 3])
            outside = -wall.ball_radius - depth
            speeds = -np.sum(normals * velocities[..., k, :3], axis=-1)
            speeds[(outside < 0.0) | (outside >= until * speeds)] = 0.0
            fastest = np.argmax(speeds, axis=0)
            at = fastest, np.arange(len(fastest))
            modes = wall_modes(vehicle, [replace(wall, frame=frame)], q[at], share * speeds[at])
            faults = (mode.fault(step, method) for mode in sorted(modes, reverse=True))
            if words := next(filter(None, faults), ""):
                most = int(np.argmax(speeds[at]))
                yield (
                    f"At t = {times[fastest[most]]:.4g} s {frame} meets wall {number} at "
                    f"{speeds[at][most]:.3g} m/s, too fast for its steps: {words}."
                )


def _oscillation(
    where: str, stiffness: float, damping: float | Array, mass: Array, explicit: bool = False
) -> list[Mode]:
    """The fastest modes of masses (s), kg, on springs, N/m, and dampers, N s/m."""
    remedy, modes = "a softer wall, or less of its damping", []
    slowing = damping / mass
    for k in sorted({int(np.argmin(mass)), int(np.argmax(slowing))}):
        cause = f"{where} a mass of {mass[k]:.3g} kg"
        first, second = map(complex, np.roots([1.0, slowing[k], stiffness / mass[k]]))
        for root, other in ((first, second), (second, first)):
            modes.append(Mode(abs(root), cause, remedy, root, other, explicit))
    return modes


def drag_modes(vehicle: Vehicle, drag: Array, q: Array) -> list[Mode]:
    """The fastest mode by which drag slows the machine at coordinates (s, nq): M v̇ = −Jᵀ C J v.

    J is the Jacobian of the frames, C their coefficients, `drag` (f, 6).
    """
    jacobians, coefficients = vehicle.frame_jacobians(q), drag[..., np.newaxis]
    slowing = np.einsum("sfai,sfaj->sij", jacobians, coefficients * jacobians)
    values = np.linalg.eigvals(np.linalg.solve(vehicle.mass_matrix(q), slowing))
    rate = float(np.max(values.real))
    remedy = "less drag (wind.drag, wind.rotational_drag)"
    return [Mode(rate, "the drag", remedy, complex(-rate))] if rate > 0.0 else []


def joint_modes(vehicle: Vehicle, q: Array) -> list[Mode]:
    """The fastest mode of joints by servos and dry friction, about rest in coordinates (s, nq).

    M v̇ = −D v − K d, of a displacement d, with commands that are held.
    """
    if not getattr(vehicle.module, "DRIVE_PARAMETERS", {}):
        return []
    size, joints = vehicle.layout.v.size, vehicle.layout.v.joints
    places = vehicle.rotors + np.arange(vehicle.joints)
    places_of = np.arange(vehicle.joints), places
    still, none = np.zeros(size), np.zeros(len(vehicle.inputs))
    units, moved = np.eye(len(none))[places], np.eye(size)[joints]
    rest = vehicle.command_of(q[0], still, none)
    pushing = 1.0 / (vehicle.command_of(q[0], still, units) - rest)[places_of]
    viscous = pushing * (vehicle.command_of(q[0], moved, none) - rest)[places_of]
    stiffness = np.where([holds(vehicle, k) for k in range(vehicle.joints)], pushing, 0.0)
    x = vehicle.actuator_state_of(rest)
    damping = -vehicle.inputs_of(q[0], _AT_REST * moved, x, rest)[places_of] / _AT_REST
    inverse = np.linalg.inv(vehicle.mass_matrix(q))[..., joints]
    by_joints = np.zeros((2, len(q), size, size))
    by_joints[..., joints] = -inverse * np.stack([stiffness, damping])[:, np.newaxis, np.newaxis]
    kept = np.broadcast_to(np.eye(size), by_joints[0].shape)
    whole = np.block([[0.0 * kept, kept], [by_joints[0], by_joints[1]]])
    roots, vectors = np.linalg.eig(whole)
    at, place = np.unravel_index(int(np.abs(roots).argmax()), roots.shape)
    if not roots[at, place]:
        return []
    fastest = complex(roots[at, place])
    joint = int(np.abs(vectors[at, size:, place][joints]).argmax())
    cause, remedy = "servo", "a softer servo, or less of its damping"
    if damping[joint] > 2.0 * viscous[joint]:
        cause, remedy = "dry friction about rest", "a greater velocity of it"
    words = f"the {cause} of {vehicle.joint_names[joint]}", f"{remedy}, or the armature of a gear"
    return [Mode(abs(fastest), *words, fastest)]


def lag_modes(vehicle: Vehicle) -> list[Mode]:
    """Modes of states of motors and servos that follow their commands, up and down.

    Rates are linear on either side of where a state is to be, whatever the parameters.
    """
    if not vehicle.actuator_states:
        return []
    still, modes = np.zeros(vehicle.layout.v.size), []
    rest = vehicle.command_of(vehicle.neutral, still, np.zeros(len(vehicle.inputs)))
    x = vehicle.actuator_state_of(rest)
    for k, name in enumerate(vehicle.actuator_states[: len(x) - has_battery(vehicle)]):
        unit = np.eye(len(x))[k]
        # Far from rest both time constants of levels are met, and near it references, whose rates
        # have limits.
        for aside, step in ((0.0, _AT_REST), (0.0, -_AT_REST), (_FAR, 1.0), (-_FAR, -1.0)):
            ends = (x + move * unit for move in (aside, aside + step))
            near, further = (vehicle.actuator_rates(end, rest)[k] for end in ends)
            if (rate := float(near - further) / step) > 0.0:
                remedy = f"a longer time constant or delay of it than {1.0 / rate:.3g} s, or none"
                modes.append(Mode(rate, f"the lag of {name}", remedy, complex(-rate)))
    return modes


def _configurations(loop: ClosedLoop) -> Array:
    """Coordinates (s, nq) at instants of the desired motion."""
    reference = loop.controller.reference
    return reference(np.linspace(reference.begin, reference.end, _INSTANTS))[0]


def integration_burdens(loop: ClosedLoop, time: float, state: np.ndarray, lag: bool = True) -> str:
    """Burdens of integration besides the vehicle itself: saturated inputs, and lag if asked.

    Clauses that begin with "; ", "" if there are none.
    """
    burdens = ""
    if inputs := loop.saturated(time, state):
        burdens += f"; saturated inputs: {', '.join(inputs)} (rk4 does not shorten its steps there)"
    if lag and loop.lags:
        shortest = np.min(loop.actuators.lag[loop.actuators.lag > 0.0])
        burdens += f"; the motors' time constant is {shortest:g} s"
    return burdens
