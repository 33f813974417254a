"""Predictive control as array programs: a node of the horizon, what follows its end, and moves.

At each node k the state x is coordinates q, velocities v, states of motors, and the
inputs of the node before, where changes of inputs cost or are limited. A small change of a node is
w = (du, dx), with displacements (nd) of q in the tangent space. To first order

    dx_next = slope w + gap,    cost = value + gradient w + w hessian w / 2,

and the Hessian is that of Gauss and Newton: of the squares of the linearised errors. Errors are
those of points on their paths, of frames' orientations, of the posture (coordinates), of
velocities, inputs and changes of inputs. Programs give the part of the Hessian that is of
coordinates; the other is the diagonal of the weights.

What moves is the machine that flies, but that friction at walls is against the way that frames are
to go, drives that follow commands do so exactly through a step, and what acts stays as it is now.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.forward import jacobian
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    beside,
    choose,
    constant,
    coordinates_of,
    cross,
    dot,
    exponential,
    join,
    mark,
    maximum,
    reshaped,
    square_root,
    variable,
    zeros,
)
from gibbs_codegen.machine.contact import FIGURES, Touch
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Machine, Surroundings
from gibbs_codegen.machine.state import State
from gibbs_codegen.machine.steps import runge_kutta_4, trapezoidal

# Least time constant, s, of a motor that lags: faster ones follow at once.
_LEAST_LAG = 1e-6
# Least of 1 and the trace of a rotation: none is turned round.
_LEAST_TRACE = 1e-9
# Speed, m/s, below which friction fades.
_SLOW = 0.02


@dataclass(frozen=True)
class PredictedMachine(Machine):
    """A machine whose frames are to have the velocities `desired` (f, 6), m/s and rad/s.

    Friction is against the way that a frame is to go: a bristle, or friction against the way that
    it goes, would be too stiff for the steps.
    """

    desired: Node = field(kw_only=True)

    def touches(self, state: State[Node]) -> list[Touch]:
        """The effect of each contact."""
        contacts, touches = self.around.contacts, list[Touch]()
        for contact, its in zip(contacts, super().touches(state), strict=True):
            wall = self.figure(f"wall_{contact.wall}", FIGURES + contact.figures)
            way = self.desired[contact.frame][:3]
            way = way - dot(its.direction, way) * its.direction
            drag = -wall[4] * its.normal / square_root(dot(way, way) + _SLOW**2) * way
            lever = -wall[0] * its.direction
            touches.append(its._replace(wrench=its.wrench + join(drag, cross(lever, drag))))
        return touches


@dataclass(frozen=True)
class Horizon:
    """All that the programs of a predictive controller depend on.

    `points` and `orientations` are frames that are led. `method` takes the steps. `lags`: motors
    lag; `changes`: changes of inputs cost, or are limited. `carries`: the position of the base is
    free, and at the end of the horizon is where the first point would be on its path. `served`:
    inputs that servos are sent, each with the entry of (q, v), as displacements, off which it
    costs, since it pushes by these. `around` acts, without bristles, and has `figures` of names and
    shapes, of which "time" may be one. Half the square of what the program `cost` gives, of q, v, u
    and what references tell it, is added to the cost.
    """

    robot: Functions
    points: tuple[int, ...] = ()
    orientations: tuple[int, ...] = ()
    method: str = "trapezoidal"
    lags: bool = False
    changes: bool = False
    carries: bool = False
    served: tuple[tuple[int, int], ...] = ()
    around: Surroundings = NO_SURROUNDINGS
    figures: tuple[tuple[str, tuple[int, ...]], ...] = ()
    cost: Program | None = None

    @property
    def signals(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the inputs of the user's cost except the state and inputs of a node."""
        pairs = zip(self.cost.names, self.cost.inputs, strict=True) if self.cost else ()
        return {name: x.shape for name, x in pairs if name not in ("q", "v", "u")}

    @property
    def bent(self) -> slice:
        """Entries of w in the Hessian that programs give: q, with a cost of one's own u, q, v."""
        nu, nd = self.robot.inputs, self.robot.space.displacements
        return slice(0, nu + self.motion) if self.cost else slice(nu, nu + nd)

    @property
    def motors(self) -> int:
        """Number of thrusts of motors that lag in a state, or of states of all actuators."""
        return self.robot.actuator_states + (self.robot.lagging if self.lags else 0)

    @property
    def lag_times(self) -> int:
        """Number of time constants: of actuators those of greater and then of lesser commands."""
        return self.motors + self.robot.actuator_states

    @property
    def before(self) -> int:
        """Number of inputs of the node before that a state has."""
        return self.robot.inputs if self.changes else 0

    @property
    def states(self) -> int:
        """Length of a displacement of a state."""
        return self.motion + self.motors + self.before

    @property
    def motion(self) -> int:
        """Length of displacements and velocities."""
        return self.robot.space.displacements + self.robot.space.velocities

    @property
    def size(self) -> int:
        """Length of a state."""
        return self.robot.space.coordinates + self.states - self.robot.space.displacements

    @property
    def pushing(self) -> NDArray[np.float64]:
        """Change of each input (rows) that displacements of q and v (columns) call for."""
        pushing = np.zeros((self.robot.inputs, self.motion))
        for row, entry in self.served:
            pushing[row, entry] = 1.0
        return pushing

    @cached_property
    def reference_size(self) -> int:
        """Length of what says where a node is to be."""
        robot = self.robot
        led = 3 * len(self.points) + 9 * len(self.orientations)
        led += sum(map(math.prod, self.signals.values()))
        return led + robot.space.coordinates + robot.space.velocities + robot.inputs

    @cached_property
    def weight_sizes(self) -> dict[str, int]:
        """Number of weights of each kind of error."""
        nv, nu = self.robot.space.velocities, self.robot.inputs
        return {
            "points": 3 * len(self.points),
            "orientations": 3 * len(self.orientations),
            "posture": self.robot.space.displacements,
            "velocities": nv,
            "inputs": nu,
            "changes": self.before,
        }

    def node(self) -> Program:
        """A node and how it goes on: `gap`, `slope`, `hessian` of q, `gradient` and `cost`."""
        node = self._node_inputs()
        predicted = self._predicted
        names = ["q", "v", *(["motors"] if self.motors else []), "u"]
        step = jacobian(predicted, names).results(*self._arguments(node))
        rows = [self._slope(step, x) for x in ("q", *self._rest)]
        outputs = {"gap": self._gap(node, step), "slope": join(*rows)}
        outputs |= self._costs(node, step)
        return Program("horizon_node", tuple(node.inputs), outputs)

    def values(self) -> Program:
        """`gap` and `cost` of a node alone."""
        node = self._node_inputs()
        step = self._predicted.results(*self._arguments(node))
        cost = self._cost(node, step["errors"])[0]
        if self.cost:
            (missed,) = self.cost(*self._asked(node, node.inputs[0]))
            cost = cost + 0.5 * dot(missed, missed)
        outputs = {"gap": self._gap(node, step), "cost": cost}
        return Program("horizon_values", tuple(node.inputs), outputs)

    def end(self) -> Program:
        """The end of the horizon: `hessian` and `gradient` of (q, v), nd + nv, and `cost`.

        It has the errors of a node, and those that a regulator would still have to bring to zero
        cost `ahead`: its matrix, and if the base is carried a turn (3, 3) from world axes to those
        of the base's position, and the first point's slope (3, nv) in hover.
        """
        size, nd, node = self.motion, self.robot.space.displacements, self._node_inputs()
        errors = jacobian(self._errors, ("q",)).results(node.q, *self._led(node))
        away, slope = errors["away"], errors["away_by_q"]
        ahead = variable("ahead", self.ahead, uniform=True)
        matrix = reshaped(ahead[: size * size], (size, size))
        if self.carries:
            turn = reshaped(ahead[size * size : size * size + 9], (3, 3))
            tip = reshaped(ahead[size * size + 9 :], (3, nd))
            place = self.robot.layout.v.position
            missed, by_q = errors["errors"][:3], errors["errors_by_q"][:3]
            away, slope = (
                _added(x, place, turn @ (point - tip @ x))
                for x, point in ((away, missed), (slope, by_q))
            )
        rates = node.v - node.reference["v"]
        off = join(away, rates)
        pulled = matrix @ off
        # Velocities are their own displacements.
        weights = node.weights
        curvature, pull = self._pulled(node, errors["errors_by_q"], errors["errors"])
        upper = slope.transposed @ matrix[:nd]
        by_q, across = upper.transposed[:nd].transposed @ slope + curvature, upper.transposed[nd:]
        lower = matrix[nd:].transposed[nd:] + _identity(size - nd) * reshaped(
            weights["velocities"], (size - nd, 1)
        )
        hessian = join(beside(by_q, across.transposed), beside(across, lower))
        damped = weights["velocities"] * rates
        gradient = join(slope.transposed @ pulled[:nd] + pull, pulled[nd:] + damped)
        squares = self._squares(node, errors["errors"]) + dot(damped, rates)
        if self.cost:
            missed, by = self._missed(node, node.reference["u"])
            by_state = by.transposed[self.robot.inputs :]
            hessian = hessian + by_state @ by_state.transposed
            gradient, squares = gradient + by_state @ missed, squares + dot(missed, missed)
        outputs = {
            "hessian": _of_each(hessian, node.x),
            "gradient": gradient,
            "cost": 0.5 * (dot(off, pulled) + squares),
        }
        inputs = (node.x, node.references, node.all_weights, ahead)
        return Program("horizon_end", inputs, outputs)

    def end_cost(self) -> Program:
        """The `cost` of the end alone."""
        end = self.end()
        return Program("horizon_end_cost", end.inputs, {"cost": end.outputs["cost"]})

    @property
    def ahead(self) -> int:
        """Number of entries that describe what follows the end."""
        nd = self.robot.space.displacements
        return self.motion**2 + (9 + 3 * nd if self.carries else 0)

    def moved(self) -> Program:
        """The state `x_next` after a `displacement` of x."""
        n, nd = self.robot.space.coordinates, self.robot.space.displacements
        x, step = variable("x", self.size), variable("displacement", self.states)
        q = self.robot.displaced(coordinates_of(x[:n], self.robot.space), step[:nd])
        outputs = {"x_next": join(q, x[n:] + step[nd:])}
        return Program("horizon_moved", (x, step), outputs)

    def away(self) -> Program:
        """The displacement `away` from x to `x_next`."""
        n, space = self.robot.space.coordinates, self.robot.space
        x, other = variable("x", self.size), variable("x_next", self.size)
        ends = (coordinates_of(state[:n], space) for state in (x, other))
        base = self.robot.displacement(*ends)
        return Program("horizon_away", (x, other), {"away": join(base, other[n:] - x[n:])})

    # Parts of these.

    @property
    def _rest(self) -> list[str]:
        """Names of what a state has beside coordinates."""
        return ["v", *(["motors"] if self.motors else []), *(["before"] if self.changes else [])]

    def _node_inputs(self) -> NodeInputs:
        """Inputs of a node."""
        robot = self.robot
        u, x = variable("u", robot.inputs), variable("x", self.size)
        after, h = variable("x_next", self.size), variable("h")
        references = variable("reference", self.reference_size)
        weights = variable("weights", sum(self.weight_sizes.values()), uniform=True)
        n, nv = robot.space.coordinates, robot.space.velocities
        sizes = {"q": n, "v": nv, "motors": self.motors, "before": self.before}
        led = {f"cost {name}": math.prod(shape) for name, shape in self.signals.items()}
        led |= {"points": 3 * len(self.points), "rotations": 9 * len(self.orientations)}
        return NodeInputs(
            [u, x, after, h, references, weights, *self._shared],
            self._split(x, sizes),
            self._split(after, sizes),
            self._split(references, led | {"q": n, "v": nv, "u": robot.inputs}),
            self._split(weights, self.weight_sizes),
        )

    @property
    def _shared(self) -> list[Node]:
        """Inputs that all steps share, of those that there are."""
        acting = sum(math.prod(shape) for _, shape in self.figures)
        sizes = {"lag_times": self.lag_times, "around": acting}
        return [variable(name, size, uniform=True) for name, size in sizes.items() if size]

    def _figure(self, name: str, *_: int) -> Node:
        """A figure of the machine, or of what is around it."""
        if name == "time_constants":
            return maximum(self._shared[0], _LEAST_LAG)
        place = 0
        for figure, shape in self.figures:
            end = place + math.prod(shape)
            if figure == name:
                return reshaped(self._shared[-1][place:end], shape)
            place = end
        raise KeyError(name)

    def _split(self, x: Node, sizes: dict[str, int]) -> dict[str, Node]:
        """Parts of a vector by name; coordinates are such."""
        parts, first = {}, 0
        for name, size in sizes.items():
            if size:
                entries = x[first : first + size]
                parts[name] = coordinates_of(entries, self.robot.space) if name == "q" else entries
            first += size
        return parts

    def _arguments(self, node: NodeInputs) -> list[Node]:
        """Arguments of the step of a node."""
        motors = [node.state["motors"]] if self.motors else []
        u, _, _, h, _, _, *shared = node.inputs
        ways = [node.reference["v"]] if self.around.contacts else []
        return [node.q, node.v, *motors, u, h, *shared, *self._led(node), *ways]

    def _led(self, node: NodeInputs) -> list[Node]:
        """Points, rotations and coordinates that are desired, as far as there are such."""
        return [node.reference[x] for x in ("points", "rotations", "q") if x in node.reference]

    def _asked(self, node: NodeInputs, u: Node) -> list[Node]:
        """Arguments of the cost of one's own."""
        arguments = {"q": node.q, "v": node.v, "u": u}
        for name, shape in self.signals.items():
            arguments[name] = reshaped(node.reference[f"cost {name}"], shape)
        return [arguments[name] for name in self.cost.names] if self.cost else []

    def _missed(self, node: NodeInputs, u: Node) -> tuple[Node, Node]:
        """What the cost of one's own gives (m), and its slope by u, q and v (m, nu + nd + nv)."""
        cost, space = cast(Program, self.cost), self.robot.space
        by = {"u": self.robot.inputs, "q": space.displacements, "v": space.velocities}
        results = jacobian(cost, [x for x in by if x in cost.names]).results(*self._asked(node, u))
        (name, missed), *_ = results.items()
        slopes = (results.get(f"{name}_by_{x}") or zeros(missed.size, by[x]) for x in by)
        return missed, beside(*slopes)

    @cached_property
    def _predicted(self) -> Program:
        """The step of a node, and its errors."""
        robot, (q, v) = self.robot, self.robot.state()
        u, h, outputs = variable("u", robot.inputs), variable("h"), dict[str, Node]()
        time = self._figure("time") if "time" in dict(self.figures) else constant(0.0)
        errors, motors, contacts = self._errors, v[:0], self.around.contacts
        led = list(errors.inputs[1:])
        ways = [robot.velocities("v_desired")] if contacts else []
        desired = robot.frame_velocities(led[-1], ways[0]) if contacts else zeros(robot.frames, 6)
        lagging = tuple(range(robot.lagging)) if self.lags else ()
        around = replace(self.around, contacts=tuple(replace(x, sticks=False) for x in contacts))
        machine = PredictedMachine(robot, self._figure, around, lagging=lagging, desired=desired)
        mean = motors
        if self.motors:
            motors = variable("motors", self.motors)
            # What is left of the way to where commands lead, and the mean of the step.
            times, way = self._figure("time_constants"), motors - u[: self.motors]
            if robot.actuator_states:
                rates = robot.actuator_rates(motors, u)
                times = choose(rates, 0.0, times[: self.motors], times[self.motors :])
                way = -times * rates
            pace = h / times
            settled, left = motors - way, exponential(-pace)
            outputs["motors_next"] = settled + left * way
            mean = settled + (1.0 - left) / pace * way

        def accelerate(q: Node, v: Node, _: int) -> Node:
            # Servos push by where joints are at the end.
            ahead, none = q if self.method == "rk4" else robot.integrate(q, h * v), v[:0]
            state = State(q, v, none, mean, none, none)
            inputs = machine.inputs(state._replace(q=ahead), u)
            return machine.rates(time, state, inputs, u).a

        take = runge_kutta_4 if self.method == "rk4" else trapezoidal
        q_next, v_next = take(robot.integrate, accelerate, q, v, h)
        outputs |= {"q_next": q_next, "v_next": v_next}
        if self.changes:
            outputs["before_next"] = u
        outputs["errors"] = errors(q, *led)[0]
        inputs = (q, v, *([motors] if self.motors else []), u, h, *self._shared, *led, *ways)
        return Program("horizon_step", inputs, outputs)

    @cached_property
    def _errors(self) -> Program:
        """Errors of points, orientations and posture, which depend on coordinates alone."""
        robot, q = self.robot, self.robot.coordinates()
        q_desired = robot.coordinates("q_desired")
        errors: list[Node] = []
        led: list[Node] = []
        if self.points or self.orientations:
            poses = robot.frame_poses(q)
        if self.points:
            led.append(variable("points", 3 * len(self.points)))
            for place, frame in enumerate(self.points):
                position = join(*(poses[frame][row][3] for row in range(3)))
                errors.append(position - led[-1][3 * place : 3 * place + 3])
        if self.orientations:
            led.append(variable("rotations", 9 * len(self.orientations)))
            for place, frame in enumerate(self.orientations):
                actual = [poses[frame][row][:3] for row in range(3)]
                entries = led[-1][9 * place : 9 * place + 9]
                wanted = [entries[3 * row : 3 * row + 3] for row in range(3)]
                errors.append(rotation_error(actual, wanted))
        away = self.robot.displacement(q_desired, q)
        outputs = {"errors": join(*errors, away), "away": away}
        return Program("horizon_errors", (q, *led, q_desired), outputs)

    def _gap(self, node: NodeInputs, step: dict[str, Node]) -> Node:
        """Displacement (states) from the next node to where the step of a node ends."""
        base = self.robot.displacement(node.after["q"], step["q_next"])
        return join(base, *(step[f"{x}_next"] - node.after[x] for x in self._rest))

    def _slope(self, step: dict[str, Node], name: str) -> Node:
        """Rows of the slope: of the next coordinates, velocities, motors or inputs before."""
        by = ["u", "q", "v", *(["motors"] if self.motors else [])]
        blocks = [step[f"{name}_next_by_{x}"] for x in by]
        return beside(*blocks, *([zeros(blocks[0].shape[0], self.before)] if self.changes else []))

    def _costs(self, node: NodeInputs, step: dict[str, Node]) -> dict[str, Node]:
        """Hessian of q, gradient of (u, x) and cost."""
        errors = step["errors"]
        hessian, pull = self._pulled(node, step["errors_by_q"], errors)
        cost, efforts, rates, changed = self._cost(node, errors)
        if self.served:
            by_q, by_v = np.split(self.pushing, [self.robot.space.displacements], axis=1)
            stiff = reshaped(node.weights["inputs"], (len(by_q), 1)) * constant(by_q)
            hessian = hessian + constant(by_q.T) @ stiff
            pull, rates = pull - constant(by_q.T) @ efforts, rates - constant(by_v.T) @ efforts
        parts = [efforts if changed is None else efforts + changed, pull, rates]
        parts += [zeros(self.motors)] if self.motors else []
        parts += [] if changed is None else [-changed]
        gradient = join(*parts)
        if self.cost:
            missed, by = self._missed(node, node.inputs[0])
            nu, nv, width = self.robot.inputs, node.v.size, by.shape[1]
            nd = width - nu - nv
            of_q = beside(zeros(nd, nu), hessian, zeros(nd, nv))
            hessian = by.transposed @ by + join(zeros(nu, width), of_q, zeros(nv, width))
            pull = by.transposed @ missed
            gradient = join(gradient[: pull.size] + pull, gradient[pull.size :])
            cost = cost + 0.5 * dot(missed, missed)
        return {
            "hessian": _of_each(hessian, node.x),
            "gradient": gradient,
            "cost": cost,
        }

    def _pulled(self, node: NodeInputs, by_q: Node, errors: Node) -> tuple[Node, Node]:
        """Hessian and gradient (nd) of the squares of errors of coordinates."""
        weights = self._error_weights(node)
        weighted = reshaped(weights, (weights.size, 1)) * by_q
        return by_q.transposed @ weighted, weighted.transposed @ errors

    def _error_weights(self, node: NodeInputs) -> Node:
        """Weights of errors that depend on coordinates alone."""
        names = ("points", "orientations", "posture")
        return join(*(node.weights[x] for x in names if x in node.weights))

    def _squares(self, node: NodeInputs, errors: Node) -> Node:
        return dot(self._error_weights(node) * errors, errors)

    def _cost(self, node: NodeInputs, errors: Node) -> tuple[Node, Node, Node, Node | None]:
        """Cost of a node, its slopes by u and v, and by the change of u."""
        u, weights = node.inputs[0], node.weights
        off, drift = u - node.reference["u"], node.v - node.reference["v"]
        if self.served:
            away = errors[errors.size - self.robot.space.displacements :]
            off = off - constant(self.pushing) @ join(away, drift)
        efforts, rates = weights["inputs"] * off, weights["velocities"] * drift
        cost, changed = self._squares(node, errors) + dot(efforts, off) + dot(rates, drift), None
        if self.changes:
            change = u - node.state["before"]
            changed = weights["changes"] * change
            cost = cost + dot(changed, change)
        return 0.5 * cost, efforts, rates, changed


@dataclass(frozen=True)
class NodeInputs:
    """Inputs of a node's program, and by name state, next state, reference and weights."""

    inputs: list[Node]
    state: dict[str, Node]
    after: dict[str, Node]
    reference: dict[str, Node]
    weights: dict[str, Node]

    @property
    def q(self) -> Node:
        """Coordinates."""
        return self.state["q"]

    @property
    def v(self) -> Node:
        """Velocities."""
        return self.state["v"]

    @property
    def x(self) -> Node:
        """The state."""
        return self.inputs[1]

    @property
    def references(self) -> Node:
        """The reference."""
        return self.inputs[4]

    @property
    def all_weights(self) -> Node:
        """All weights."""
        return self.inputs[5]


def rotation_error(actual: Sequence[Node], wanted: Sequence[Node]) -> Node:
    """The rotation from one matrix to another, world axes: 2 sin(angle / 2) about its axis (3).

    Both are given by rows. It has a derivative up to half a turn.
    """
    columns = [
        (join(*(row[i] for row in actual)), join(*(row[i] for row in wanted))) for i in range(3)
    ]
    # Sum of the cross products of axes: 2 sin(angle) about the axis.
    about = sum((cross(b, a) for a, b in columns[1:]), cross(columns[0][1], columns[0][0]))
    trace = sum((dot(a, b) for a, b in columns[1:]), dot(*columns[0]))
    return about / square_root(maximum(1.0 + trace, _LEAST_TRACE))


def _of_each(matrix: Node, x: Node) -> Node:
    """A matrix of each state x, though it may be the same for all, which C lays out otherwise."""
    return matrix + reshaped(mark(x), (1, 1))


def _added(x: Node, place: slice, more: Node) -> Node:
    """A vector or matrix with something added to some of its rows."""
    rows = [x[: place.start], x[place] + more, x[place.stop :]]
    return join(*(part for part in rows if part.shape[0]))


def _identity(size: int) -> Node:
    return constant(np.eye(size))
