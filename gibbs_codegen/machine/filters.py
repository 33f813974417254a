"""Error-state Kalman filters as array programs: a robot's motion, what acts on it, and biases.

Coordinates q and velocities v move by the module's own forward dynamics. Estimated with them are
loads, which are a wrench on a frame, efforts of joints besides the inputs and the mass of a
payload, and biases of sensors; these stay as they are but for noise. Errors are displacements of q
in the tangent space and differences of all else, with the covariance P. A step of h is

    q⁺ = q ⊞ h (v + h a/2),    v⁺ = v + h a,    P⁺ = A P Aᵀ + h N

with N the variances that noise adds in a second. Without the dynamics, an IMU leads the motion: it
gives the accelerations of its frame and the angular velocity at the end of the step, with noise of
its own, while joints go on as they do. A reading that is off by e from what is expected,
with the slope H by the errors and noise of the variances R, moves the state by K e:

    G = P Hᵀ,    S = H G + R,    K = G S⁻¹,    nis = eᵀ S⁻¹ e
    P⁺ = (1 − K H) P (1 − K H)ᵀ + K R Kᵀ = P − (T + Tᵀ),    T = K (G − K S/2)ᵀ

Joseph's form is right for every gain, so that outliers and what is no number have the gain 0.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.c_file import CFunction, Member, Structure
from gibbs_codegen.arrays.forward import from_derivatives, jacobian, moved
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program
from gibbs_codegen.errors import UsageError
from gibbs_codegen.machine import surroundings
from gibbs_codegen.machine.sensors import MEASUREMENTS, SensedMotion, SensorAt
from gibbs_codegen.machine.surroundings import rotation_of

# Derivatives that programs here call, which modules have on request only.
CALLED = tuple(
    f"{name}_derivatives"
    for name in (
        "forward_dynamics_with_wrenches",
        "frame_bias_accelerations",
        "frame_poses",
        "frame_velocities",
        "integrate",
    )
)

_STATE = {
    "q": "coordinates, rad and m; a quaternion has unit length",
    "v": "velocities, rad/s and m/s",
    "loads": "wrench on the base: N, N m, world axes; efforts of joints besides inputs; 0 at first",
    "biases": "biases of the specific force, m/s^2, and of the angular velocity, rad/s, of the IMU",
    "covariance": "covariance of all errors, row-major; initially variances on the diagonal",
}
_AHEAD, _LED = "Predict by h under inputs.", "Predict by h from one reading of the IMU to the next."
_ARGUMENTS = {
    "u": "inputs that act: thrusts, N, then efforts of joints, N m or N",
    "gravity": "acceleration of gravity, m/s^2, world axes",
    "h": "step, s",
    "noise": "variances that noise adds to each error in a second",
    "before": "reading of the IMU at the start of the step",
    "reading": "the reading, in the order of docs/howto/sensors.md",
    "variances": "variances of the noise of its entries",
    "gate": "bound of nis above which a reading counts as an outlier; INFINITY: none does",
    "nis": "normalised innovation squared, on average the number of entries; NaN if an entry is",
}


@dataclass(frozen=True)
class FilteredSensor:
    """A sensor, and the entries of its readings that have a bias of their own."""

    at: SensorAt
    biased: tuple[int, ...] = ()


@dataclass(frozen=True)
class StateFilter:
    """The programs of a filter on the readings of `sensors`, by their names.

    Loads are a wrench (6) on the frame `wrench`, N and N m, world axes, `efforts` of the joints
    besides their inputs, and the mass, kg, of a point at the frame `payload`, as far as asked for.
    If a sensor `leads`, an IMU on a base that moves freely, there are none of these, and motion
    goes on by its readings, not by dynamics; no other sensor may feel accelerations or contacts.
    """

    robot: Functions
    sensors: Mapping[str, FilteredSensor] = field(default_factory=dict)
    wrench: int | None = None
    efforts: bool = False
    payload: int | None = None
    leads: str = ""

    @cached_property
    def _sizes(self) -> dict[str, int]:
        """Numbers of errors of q, v, each load by its name, and biases by their sensors'."""
        robot = self.robot
        return {
            "q": robot.space.displacements,
            "v": robot.space.velocities,
            "wrench": 0 if self.wrench is None else 6,
            "efforts": self.efforts * len(robot.layout.v.joint_places),
            "payload": int(self.payload is not None),
            **{f"{name}_bias": len(sensor.biased) for name, sensor in self.sensors.items()},
        }

    @cached_property
    def places(self) -> dict[str, slice]:
        """Places of these in the errors, as far as there are any."""
        ends = itertools.accumulate(self._sizes.values())
        pairs = zip(self._sizes.items(), ends, strict=True)
        return {name: slice(end - size, end) for (name, size), end in pairs if size}

    @property
    def name(self) -> str:
        """What names of programs begin with."""
        return "imu_filter" if self.leads else "filter"

    @property
    def size(self) -> int:
        """The number of errors."""
        return sum(self._sizes.values())

    @property
    def loaded(self) -> int:
        """The number of errors of q, v and loads, after which those of biases come."""
        return sum([*self._sizes.values()][:5])

    @cached_property
    def state(self) -> dict[str, Node]:
        """The state: q, v, loads and biases, as far as there are any."""
        q, v = self.robot.state()
        sizes = {"loads": self.loaded - self.places["v"].stop, "biases": self.size - self.loaded}
        others = {name: nodes.variable(name, size) for name, size in sizes.items() if size}
        return {"q": q, "v": v} | others

    @property
    def _surroundings(self) -> tuple[Node, Node]:
        """Inputs (nu) that act, and the acceleration of gravity (3), m/s², world axes."""
        return nodes.variable("u", self.robot.inputs), nodes.variable("gravity", 3, uniform=True)

    @property
    def _of_readings(self) -> tuple[Node, ...]:
        """What of these readings follow from."""
        return () if self.leads else self._surroundings

    def _part(self, name: str) -> Node:
        """A load, or the biases of a sensor."""
        place, first = self.places[name], self.places["v"].stop
        others = nodes.join(*(x for part, x in self.state.items() if part not in ("q", "v")))
        return others[place.start - first : place.stop - first]

    @cached_property
    def _motion(self) -> SensedMotion:
        """The motion under inputs and loads, or without accelerations where an IMU leads it."""
        robot, (q, v), (u, gravity) = self.robot, self.robot.state(), self._surroundings
        if self.leads:
            return SensedMotion(robot, q, v, v, nodes.zeros(robot.frames, 6), gravity)
        if "efforts" in self.places:
            u = u + nodes.join(
                nodes.zeros(robot.rotors),
                self._part("efforts"),
                nodes.zeros(robot.layout.q.wheels),
            )
        pushed = [] if self.wrench is None else [(self.wrench, self._part("wrench"))]
        wrenches = acting = surroundings.on_frames(pushed, robot.frames)
        if self.payload is not None:
            others = wrenches, [self.payload], self._part("payload"), gravity
            (force,) = surroundings.payload_forces(robot, (q, v, u), *others)
            carried = [(self.payload, nodes.join(force, nodes.zeros(3)))]
            acting = wrenches + surroundings.on_frames(carried, robot.frames)
        a = robot.forward_dynamics_with_wrenches(q, v, u, acting)
        return SensedMotion(robot, q, v, a, wrenches, gravity)

    def programs(self) -> dict[str, Program]:
        """`filter_predict`, and of each sensor `filter_update_<name>`, by their names.

        If an IMU leads they are `imu_filter_predict` and so on, without one of the IMU.
        """
        made = [self._lead() if self.leads else self._predict()]
        made += [self._update(name) for name in self.sensors if name != self.leads]
        return {program.name: program for program in made}

    def _unbiased(self, name: str, reading: Node, sign: float = -1.0) -> Node:
        """What of a sensor's reading is without its bias; with `sign` 1 a reading of that."""
        biased = self.sensors[name].biased
        if not biased:
            return reading
        where = nodes.constant(sign * np.eye(reading.size)[:, list(biased)])
        return reading + where @ self._part(f"{name}_bias")

    def _turn(self, q: Node, frame: int) -> Node:
        """The rotation (3, 3) of a frame."""
        return rotation_of(self.robot.frame_poses(q)[frame])

    def _lead(self) -> Program:
        """A step of h between two readings of an IMU, `reading` (6) and the one `before` (6).

        `variances` (6) are of the noise of a reading, and `noise` (n) of what is added in a second.
        """
        robot, (q, v), gravity = self.robot, self.robot.state(), self._surroundings[1]
        frame, h = self.sensors[self.leads].at.frame, nodes.variable("h", uniform=True)
        last, now = (nodes.variable(name, 6) for name in ("before", "reading"))
        felt, then = (self._unbiased(self.leads, reading) for reading in (last, now))
        selection = nodes.constant(np.eye(v.size)[robot.layout.v.base])
        kept = nodes.constant(np.eye(v.size)) - selection.transposed @ selection
        errors = nodes.constant(np.eye(self.size + 6))
        of_q, of_v = errors[: v.size], errors[v.size : self.loaded]
        # What a reading errs by counts half in this step, and half in the next.
        along = {q: of_q, v: of_v} | dict.fromkeys((last, now), errors[self.size :])
        if "biases" in self.state:
            along[self.state["biases"]] = errors[self.loaded : self.size]
        start, velocity = self._turn(q, frame) @ felt[:3], robot.frame_velocities(q, v)[frame][:3]

        def displaced(by: Node, of_by: Node) -> tuple[Node, Node]:
            """Coordinates after a displacement (nv), and how errors displace them."""
            ends = robot.integrate(q, by)
            return ends, moved({"ends": ends}, {q: of_q, by: of_by})["ends"]

        v_next = v
        for _ in range(2):  # The second time the end is right to second order.
            ends, of_ends = displaced(0.5 * h * (v + v_next), h * of_v)
            turn, slope = self._turn(ends, frame), robot.frame_jacobians(ends)[frame]
            mean = 0.5 * (start + turn @ then[:3]) + gravity
            twist = nodes.join(velocity + h * mean, turn @ then[3:])
            base = selection @ slope.transposed
            # Squared, since C eliminates without exchanges.
            square = base @ base.transposed
            rest = base @ (twist - slope @ (kept @ v))
            v_next = kept @ v + selection.transposed @ nodes.solve(square, rest)
        missing = {"twist": twist - robot.frame_velocities(ends, v_next)[frame]}
        along |= {ends: of_ends, v_next: kept @ of_v}
        of_base = nodes.solve(square, base @ moved(missing, along)["twist"])
        of_next = kept @ of_v + selection.transposed @ of_base
        ends, of_ends = displaced(0.5 * h * (v + v_next), 0.5 * h * (of_v + of_next))
        outputs = {"q_next": ends, "v_next": v_next}
        slopes = nodes.join(of_ends, of_next).transposed
        covariance = nodes.variable("covariance", self.size, self.size)
        variances, noise = (
            nodes.variable(name, count, uniform=True)
            for name, count in (("variances", 6), ("noise", self.size))
        )
        by_errors, by_reading = slopes[: self.size], slopes[self.size :]
        rows = covariance @ by_errors
        corner = by_errors.transposed @ rows
        corner = corner + by_reading.transposed @ (_diagonal(variances) @ by_reading)
        grown = _joined(covariance, rows, corner) + _diagonal(h * noise)
        inputs = *self.state.values(), covariance, last, now, variances, gravity, h, noise
        outputs |= {"covariance_next": grown}
        return from_derivatives(Program(f"{self.name}_predict", inputs, outputs))

    def _predict(self) -> Program:
        """A step of h under inputs; `noise` (n) are variances that are added in a second."""
        robot, moving, surroundings, state = (
            self.robot,
            self._motion,
            self._surroundings,
            self.state,
        )
        by = [name for name in state if name != "biases"]
        inputs = *(state[name] for name in by), *surroundings
        motion = Program("filter_motion", inputs, {"a": moving.a})
        slopes = jacobian(motion, by).results(*inputs)
        slope = nodes.beside(*(slopes[f"a_by_{name}"] for name in by))
        q, v, a, h = moving.q, moving.v, slopes["a"], nodes.variable("h", uniform=True)
        after = {"q_next": robot.integrate(q, h * (v + 0.5 * h * a)), "v_next": v + h * a}

        def ahead(errors: Node) -> Node:
            """Errors of q and v (nd + nv, k) after a step, of those of q, v and loads before."""
            now = {x: errors[self.places[name]] for x, name in ((q, "q"), (v, "v"))}
            return nodes.join(*moved(after, now | {a: slope @ errors}).values())

        return self._stepped("predict", after, ahead, [state[name] for name in by], surroundings)

    def coast(self) -> Program:
        """A step of h by the velocity alone, for times at which an IMU that leads tells nothing."""
        (q, v), h = self.robot.state(), nodes.variable("h", uniform=True)
        after = {"q_next": self.robot.integrate(q, h * v), "v_next": 1.0 * v}

        def ahead(errors: Node) -> Node:
            now = {x: errors[self.places[name]] for x, name in ((q, "q"), (v, "v"))}
            return nodes.join(*moved(after, now).values())

        return self._stepped("coast", after, ahead, [q, v])

    def _stepped(
        self,
        name: str,
        after: Mapping[str, Node],
        ahead: Callable[[Node], Node],
        state: list[Node],
        surroundings: tuple[Node, ...] = (),
    ) -> Program:
        """A step of h, by what follows from errors of q, v and loads, after noise is added."""
        covariance = nodes.variable("covariance", self.size, self.size)
        noise = nodes.variable("noise", self.size, uniform=True)
        inputs = *state, covariance, *surroundings, nodes.variable("h", uniform=True), noise
        rows = ahead(covariance[: self.loaded]).transposed
        grown = _joined(covariance, rows, ahead(rows[: self.loaded]))
        outputs = dict(after) | {"covariance_next": grown + _diagonal(inputs[-2] * noise)}
        return from_derivatives(Program(f"{self.name}_{name}", inputs, outputs))

    def _update(self, name: str) -> Program:
        """A reading of a sensor, with `variances` of its noise.

        It counts where `nis`, whose mean is the number of its entries, is below `gate`.
        """
        sensor, moving, state = self.sensors[name], self._motion, self.state
        expected = self._unbiased(name, MEASUREMENTS[sensor.at.kind](moving, sensor.at), 1.0)
        count = expected.size
        reading, gate = nodes.variable("reading", count), nodes.variable("gate", uniform=True)
        covariance = nodes.variable("covariance", self.size, self.size)
        variances = nodes.variable("variances", count, uniform=True)
        inputs = *state.values(), *self._of_readings
        inner = Program(f"filter_expected_{name}", inputs, {"y": expected})
        slopes = jacobian(inner, [*state]).results(*inputs)
        slope = nodes.beside(*(slopes[f"y_by_{x}"] for x in state))
        spread, miss = covariance @ slope.transposed, reading - slopes["y"]
        spread_y = slope @ spread + _diagonal(variances)
        right = nodes.beside(spread.transposed, nodes.reshaped(miss, (count, 1)))
        solved = nodes.solve(spread_y, right).transposed
        nis = nodes.dot(miss, solved[self.size])
        gain = nodes.choose(gate, nis, 1.0, 0.0) * solved[: self.size]
        move = gain @ nodes.choose(gate, nis, miss, 0.0)
        taken = gain @ (spread - 0.5 * (gain @ spread_y)).transposed
        outputs = {"q_next": self.robot.displaced(moving.q, move[self.places["q"]])}
        rates = self.places["v"]
        for part, first in (("v", rates.start), ("loads", rates.stop), ("biases", self.loaded)):
            if part in state:
                outputs[f"{part}_next"] = state[part] + move[first : first + state[part].size]
        outputs |= {"covariance_next": covariance - (taken + taken.transposed), "nis": nis}
        inputs = *state.values(), covariance, *self._of_readings, reading, variances, gate
        return from_derivatives(Program(f"{self.name}_update_{name}", inputs, outputs))


def filter_functions(robot: Functions, leads: str = "") -> list[CFunction]:
    """A filter as functions of C: of joints, and of a base that moves by an IMU, a pose and GPS.

    These are at the frame of the base, on which the unknown wrench acts, if not the IMU leads.
    """
    if leads and not robot.layout.moves_freely:
        raise UsageError(
            f"--laws imu_filter: needs a base that moves freely, and that of {robot.name} does "
            "not; leave it out, or use state_filter"
        )
    places = robot.layout.v
    joints, moves = bool(places.joint_places), bool(places.base)
    kinds = [*(("imu", "pose", "gps") if moves else ()), *(("encoders",) if joints else ())]
    biased = {"imu": tuple(range(6))}
    sensors = {kind: FilteredSensor(SensorAt(kind, 0, ()), biased.get(kind, ())) for kind in kinds}
    pushed = 0 if moves and not leads else None
    made = StateFilter(robot, sensors, pushed, joints and not leads, leads=leads)
    members = tuple(
        Member(name, name, words, f"{name}_next")
        for name, words in _STATE.items()
        if name in (*made.state, "covariance")
    )
    names = [f"{x.stop - x.start} of {name}" for name, x in made.places.items()]
    words = f"State of a filter. Errors are {', '.join(names)}."
    state, functions = (Structure(made.name, words, members),), []
    ahead = _LED if leads else _AHEAD
    for name, program in made.programs().items():
        _, update, sensor = name.partition("_update_")
        does = f"Correct with a reading of {sensor}, unless it is an outlier." if update else ahead
        values = (*program.names, *program.outputs)
        explained = {x: words for x, words in _ARGUMENTS.items() if x in values}
        functions.append(CFunction(program, does, state, explained))
    return functions


def _joined(covariance: Node, rows: Node, corner: Node) -> Node:
    """A covariance of which a corner (k, k), and the columns (n, k) through it, are new."""
    count, grown = corner.shape[0], 0.5 * (corner + corner.transposed)
    if count == covariance.shape[0]:
        return grown
    side, still = rows[count:], covariance[count:].transposed[count:]
    above = nodes.join(grown, side).transposed
    return nodes.join(above, nodes.join(side.transposed, still).transposed)


def _diagonal(x: Node) -> Node:
    """A diagonal matrix of its entries (n)."""
    return nodes.constant(np.eye(x.size)) * nodes.reshaped(x, (x.size, 1))
