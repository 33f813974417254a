"""Steps of rollouts, FMUs, horizons and autopilots, at random states of a made-up robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from arrays.test_machine import CONTACTS, DRIVEN, HOLDING, Loop, air
from arrays.test_surroundings import ball, given_back, touched
from support.made_up import STEP, Array, MadeUp, close

from gibbs_codegen.arrays import Functions, Program, evaluate, jacobian
from gibbs_codegen.machine.autopilot import command_program, telling_program
from gibbs_codegen.machine.contact import Contact
from gibbs_codegen.machine.first_order import System
from gibbs_codegen.machine.machine import Surroundings
from gibbs_codegen.machine.predictive import Horizon, rotation_error
from gibbs_codegen.machine.rollout_steps import Parts, rollout_step
from gibbs_codegen.machine.sensors import SensorAt, measurement_program
from gibbs_codegen.machine.steps import emitted_step

WALLS = tuple(
    (contact, (0.1, 50.0, 3.0, 0.4, 0.6, 40.0, 2.0, 0.1, -0.2, 0.3, 1.6)) for contact in CONTACTS
)
Acceleration = Callable[[Array, Array, int], Array]


def stepped(
    module: MadeUp, method: str, accelerate: Acceleration, q: Array, v: Array, h: float
) -> tuple[Array, Array]:
    """A step by exponentials of velocities, as Celledoni, Marthinsen and Owren have it."""

    def move(q: Array, rates: Array) -> Array:
        found: Array = module.integrate(q, rates[:8])
        return found

    a1 = accelerate(q, v, 0)
    if method == "euler":
        return move(q, h * (v + h * a1)), v + h * a1
    v2 = v + h / 2 * a1
    q2 = move(q, h / 2 * v)
    a2 = accelerate(q2, v2, 1)
    v3, q3 = v + h / 2 * a2, move(q, h / 2 * v2)
    a3 = accelerate(q3, v3, 1)
    v4, q4 = v + h * a3, move(q2, h * v3 - h / 2 * v)
    a4 = accelerate(q4, v4, 2)
    half = move(q, h / 12 * (3 * v + 2 * v2 + 2 * v3 - v4))
    return move(half, h / 12 * (-v + 2 * v2 + 2 * v3 + 3 * v4)), v + h / 6 * (
        a1 + 2 * a2 + 2 * a3 + a4
    )


def random_inputs(module: MadeUp, program: Program, seed: int = 2) -> dict[str, Array]:
    random = np.random.default_rng(seed)
    found = {
        n: random.uniform(-0.7, 0.7, x.shape)
        for n, x in zip(program.names, program.inputs, strict=True)
    }
    for name in ("x", "x_next"):
        if name in found:
            q, v = module.state(random)
            found[name][: q.size + 8] = np.concatenate([q, v])
    for name, x in zip(program.names, program.inputs, strict=True):
        if x.space:
            found[name] = module.state(random)[0]
    return found


class Asked(NamedTuple):
    """What a rollout is asked for: `walls` with their figures, constraints that are `active`."""

    feedback: bool = False
    limits: bool = False
    lag: bool = False
    wrenches: bool = False
    bounds: bool = False
    walls: tuple[Any, ...] = ()
    active: tuple[float, ...] = ()

    @property
    def parts(self) -> Parts:
        """The same as its program takes it."""
        contacts = tuple(contact for contact, _ in self.walls)
        around = Surroundings(self.wrenches, contacts=contacts, holds=bool(self.active))
        figures = {f"wall_{contact.wall}": tuple(wall) for contact, wall in self.walls}
        figures |= {"active": self.active} if self.active else {}
        asked = self.feedback, self.limits, self.lag, self.bounds
        return Parts(*asked, around, tuple(figures.items()))


@pytest.mark.parametrize("method", ["euler", "rk4"])
@pytest.mark.parametrize(
    ("attitude", "lists", "parts"),
    [
        ("zyx", {}, Asked(True, True, True, True, True)),
        ("quaternion", {}, Asked(feedback=True, lag=True)),
        ("quaternion", DRIVEN, Asked(feedback=True, limits=True, bounds=True)),
        ("quaternion", HOLDING, Asked(wrenches=True, active=(1.0, 0.0))),
        ("zyx", HOLDING, Asked(active=(0.0, 1.0))),
        ("quaternion", {}, Asked(walls=WALLS)),
    ],
)
def test_steps_of_rollouts(method: str, attitude: str, lists: dict[str, Any], parts: Asked) -> None:
    module = MadeUp(attitude, **lists)
    program = rollout_step(Functions(module), method, parts.parts, has_thrusts=attitude == "zyx")
    g, h = random_inputs(module, program), 0.03
    g |= {"h": np.array(h)}
    n, driven = len(module.COORDINATES), 5 if "COMMANDS" in lists else 0
    thrusts = 0 if driven else 4 * (parts.lag or attitude == "zyx")
    x, found = g["x"], evaluate(program, g, {"robot": module})
    q, v, act, z = np.split(x, [n, n + 8, n + 8 + driven + thrusts])
    u = g["command" if driven else "u"]
    if parts.feedback:
        error = [module.difference(q, g["desired_q"]), g["desired_v"] - v]
        u = u + g["gain"] @ np.concatenate([*error, *([g["desired_x"] - act] if driven else [])])
    if parts.limits:
        u = np.maximum(np.minimum(u, g["most"]), g["least"])
    acting = [u] * 3
    if parts.lag:
        acting = [np.concatenate([u[:4] + share * (act - u[:4]), u[4:]]) for share in g["lag"]]

    def accelerate(q: Array, y: Array, halves: int) -> Array:
        v, states, bristles = y[:8], y[8 : 8 + driven], y[8 + driven : 8 + driven + z.size]
        inputs = module.inputs_of(q, v, states, u) if driven else acting[halves]
        wrenches, rates = g.get("wrenches", np.zeros((2, 6))), []
        if driven:
            wrenches = wrenches + air(module, q, v, module.rotor_speeds(states, u), np.zeros(3))
            rates.append(module.actuator_rates(states, u))
        touches = touching(q, v, bristles)
        for (contact, _), own in zip(parts.walls, touches, strict=True):
            wrenches = wrenches + np.eye(2)[contact.frame][:, None] * own["wrench"]
            rates += [own["rate"]] if contact.sticks else []
        free = module.forward_dynamics(q, v, inputs)
        acts = bool(parts.wrenches or driven or parts.walls)
        a = module.forward_dynamics_with_wrenches(q, v, inputs, wrenches) if acts else free
        if parts.active:
            active, pushed = np.array(parts.active), a - free
            a = module.constrained_forward_dynamics(q, v, inputs, active)[0]
            a = a + module.impact(q, pushed, active, 0.0 * active)[0] if acts else a
        if parts.walls:
            # By euler what acts at the begin acts through the step.
            mean = v + h / 2 * a if method == "euler" else v
            moving, pairs = module.frame_velocities(q, mean), zip(parts.walls, touches, strict=True)
            power = sum(x["wrench"] @ moving[c.frame] for (c, _), x in pairs)
            done = [power, *(sum(x[y] for x in touches) for y in ("eased", "normal"))]
            rates += [[mean @ module.inverse_dynamics(q, v, a) - power], done]
            rates += [x["wrench"] for x in touches]
        return np.concatenate([a, *rates])

    def touching(q: Array, v: Array, z: Array) -> list[dict[str, Any]]:
        poses, moving = module.frame_poses(q), module.frame_velocities(q, v)
        return [
            touched(np.array(wall), poses[c.frame], moving[c.frame], z * c.sticks, c.sticks)
            for c, wall in parts.walls
        ]

    spent = np.zeros(4 + 6 * len(parts.walls) if parts.walls else 0)
    begin = np.concatenate([v, act if driven else [], z, spent])
    q_next, y = stepped(module, method, accelerate, q, begin, h)
    if parts.active:
        q_next = module.integrate(
            q_next, module.constraint_projection(q_next, np.array(parts.active))
        )
        y[:8] = module.impact(q_next, y[:8], np.array(parts.active), np.zeros(len(parts.active)))[0]
    end = 8 + driven + z.size
    if parts.walls:
        states = (q, v, z), (q_next, y[:8], y[8:end])
        ends, done = (
            [(*at[:2], sum(x["stored"] for x in touching(*at))) for at in states],
            y[end + 1 :],
        )
        if method == "euler":  # What is met at the end was not felt.
            done[3:] += h * np.concatenate([x["wrench"] for x in touching(*states[1])])
        q_next, y[:8], _ = given_back(module, ends, y[end], done, None)
    wanted = [q_next, y[: 8 + driven], acting[2][:thrusts], y[8 + driven : end]]
    close(found["x_next"], np.concatenate(wanted), 1e-11)
    close(found["inputs"], u)
    beyond = 0.0
    if parts.bounds:
        moved = np.concatenate(wanted[:2])[: n + 8]
        beyond = np.sum(
            np.maximum(g["lowest"] - moved, 0.0) + np.maximum(moved - g["highest"], 0.0)
        )
    close(found["ended"], beyond)


@pytest.mark.parametrize("method", ["step_euler", "step_rk4"])
@pytest.mark.parametrize("attitude", ["zyx", "quaternion"])
def test_emitted_steps(attitude: str, method: str) -> None:
    """With their derivatives, by complex steps of the step itself."""
    module = MadeUp(attitude)
    program = emitted_step(Functions(module), f"{method}_derivatives")
    g = random_inputs(module, program) | {"h": np.array(0.05)}
    found = evaluate(program, g, {"robot": module})

    def step(q: Array, v: Array, u: Array) -> tuple[Array, Array]:
        return stepped(
            module, method[5:], lambda q, v, _: module.forward_dynamics(q, v, u), q, v, 0.05
        )

    at = tuple(g[name] for name in "qvu")
    ends = step(*at)
    close(found["q_next"], ends[0])
    close(found["v_next"], ends[1])
    columns = []
    for k, rows in enumerate((module._moves(g["q"]).T, np.eye(8), np.eye(6))):
        for row in rows:
            q, v = (
                np.imag(x) / STEP
                for x in step(
                    *(x + 1j * STEP * row * (i == k) if i == k else x for i, x in enumerate(at))
                )
            )
            columns.append(
                np.concatenate([np.linalg.lstsq(module._moves(ends[0]), q, rcond=None)[0], v])
            )
    close(np.concatenate([found["A"], found["B"]], 1), np.stack(columns, 1), 1e-11)


@pytest.mark.parametrize(
    ("attitude", "lists", "lags"),
    [("zyx", {}, {1: 0.1, 3: 0.2}), ("quaternion", {}, {}), ("quaternion", DRIVEN, {})],
)
def test_systems_of_first_order(
    attitude: str, lists: dict[str, Any], lags: dict[int, float]
) -> None:
    module = MadeUp(attitude, **lists)
    system = System(Functions(module), lags, acting=("drag",))
    rates, outputs, step, derivatives = system.programs().values()
    g, owners = random_inputs(module, derivatives), {"robot": module}
    g |= {"gravity": np.array(9.5), "h": np.array(0.02)}
    n, x, given = len(module.COORDINATES), g["x"], g["given"]
    is_driven = bool(lists)
    if attitude == "quaternion":
        x[3:7] *= 1.1

    def parts(x: Array) -> tuple[Array, ...]:
        q = x[:n].copy()
        if attitude == "quaternion":
            q[3:7] = q[3:7] / np.sqrt(np.sum(q[3:7] ** 2))
        commands, act = given[:6], x[n + 8 :]
        u = commands.astype(x.dtype)
        if is_driven:
            u = module.inputs_of(q, x[n : n + 8], act, commands)
        for place, rotor in enumerate(lags):
            u[rotor] = act[place]
        wrenches = np.concatenate([given[6:12].reshape(2, 3), given[12:18].reshape(2, 3)], 1)
        twists, (drag, rotational) = (
            module.frame_velocities(q, x[n : n + 8]),
            given[21:].reshape(2, 2, 1),
        )
        still = np.concatenate(
            [drag * (given[18:21] - twists[:, :3]), -rotational * twists[:, 3:]], 1
        )
        wrenches = wrenches + still
        if is_driven:
            speeds = module.rotor_speeds(act, commands)
            wrenches = wrenches + air(module, q, x[n : n + 8], speeds, given[18:21])
        return q, x[n : n + 8], act, u, wrenches

    def rate(x: Array) -> Array:
        q, v, act, u, wrenches = parts(x)
        entries = module.coordinate_rates(q, v)
        if attitude == "quaternion":
            entries[3:7] = entries[3:7] * np.sqrt(np.sum(x[3:7] ** 2))
        own = [module.actuator_rates(act, given[:6])] if is_driven else []
        own += [[(given[rotor] - act[k]) / time] for k, (rotor, time) in enumerate(lags.items())]
        a = module.forward_dynamics_with_wrenches(q, v, u, wrenches)
        return np.concatenate([entries, a, *own])

    def output(x: Array) -> Array:
        q, v, _, u, wrenches = parts(x)
        a = module.forward_dynamics_with_wrenches(q, v, u, wrenches)
        poses, velocities = module.frame_poses(q), module.frame_velocities(q, v)
        growth = module.frame_velocities(q, a) + module.frame_bias_accelerations(q, v)
        turns = np.swapaxes(poses[:, :3, :3], 1, 2)
        growth[:, 2] += 9.5
        felt = [turn @ row[:3] for turn, row in zip(turns, growth, strict=True)]
        spins = [turn @ row[3:] for turn, row in zip(turns, velocities, strict=True)]
        loads = module.joint_wrenches_with_wrenches(q, v, a, u, wrenches)
        found = [
            poses[:, :3, 3],
            poses[:, :3, :3],
            velocities[:, :3],
            velocities[:, 3:],
            felt,
            spins,
        ]
        return np.concatenate([np.ravel(y) for y in (*found, loads[:, :3], loads[:, 3:])])

    close(evaluate(rates, {name: g[name] for name in rates.names}, owners)["slope"], rate(x))
    found = evaluate(outputs, {name: g[name] for name in outputs.names}, owners)["y"]
    close(found, output(x))
    assert found.size == sum(int(np.prod(shape)) for shape in system.outputs.values())
    k1 = rate(x)
    k2 = rate(x + 0.01 * k1)
    k3 = rate(x + 0.01 * k2)
    after = x + 0.02 / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + 0.02 * k3))
    close(evaluate(step, {name: g[name] for name in step.names}, owners)["x_next"], after)
    moved = evaluate(derivatives, g | {"given_dot": 0.0 * given}, owners)
    way = x + 1j * STEP * g["x_dot"]
    close(moved["slope_dot"], np.imag(rate(way)) / STEP, 1e-11)
    close(moved["y_dot"], np.imag(output(way)) / STEP, 1e-11)


HORIZONS: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "lags": (
        "zyx",
        {},
        {"points": (1,), "orientations": (1,), "lags": True, "changes": True, "carries": True},
    ),
    "rk4": ("quaternion", {}, {"points": (0, 1), "method": "rk4", "carries": True}),
    "around": (
        "zyx",
        {},
        {
            "orientations": (0,),
            "served": ((4, 3), (5, 12)),
            "around": Surroundings(
                pushes=True,
                wind=True,
                drag=True,
                gusts=1,
                contacts=CONTACTS[:1],
                spins=((2, 1),),
                payloads=(1,),
            ),
            "figures": (
                *(("time", ()), ("push", (2, 6)), ("wind", (3,)), ("gusts", (1, 5))),
                *(("drag", (2, 6)), (f"wall_{CONTACTS[0].wall}", (11,)), ("spins", (1, 4))),
                *(("payloads", (1,)), ("gravity", (3,))),
            ),
        },
    ),
    "driven": ("quaternion", DRIVEN, {"changes": True, "served": ((4, 6),)}),
}


class Ahead:
    """A horizon, and what it is by NumPy."""

    def __init__(self, name: str) -> None:
        attitude, lists, options = HORIZONS[name]
        self.module, self.options, self.driven = MadeUp(attitude, **lists), options, bool(lists)
        self.spec, self.n = Horizon(Functions(self.module), **options), len(self.module.COORDINATES)
        self.motors = 5 if lists else 4 * options.get("lags", False)

    def split(self, x: Array) -> Sequence[Array]:
        """Coordinates, velocities, motors, and inputs before, of a state."""
        return np.split(x, [self.n, self.n + 8, self.n + 8 + self.motors])

    def reference(self, g: dict[str, Array]) -> Sequence[Array]:
        """Points, rotations, coordinates, velocities and inputs that are desired."""
        points, turns = (len(self.options.get(x, ())) for x in ("points", "orientations"))
        ends = np.cumsum([3 * points, 9 * turns, self.n, 8])
        return np.split(g["reference"], ends)

    def predicted(self, g: dict[str, Array], u: Array, x: Array) -> tuple[Array, ...]:
        """Coordinates, velocities, motors and inputs after a step."""
        module, h = self.module, float(g["h"])
        q, v, motors, _ = self.split(x)
        acting, mean, after = u, motors, motors
        if self.motors:
            times = g["lag_times"]
            way = motors - u[:4] if not self.driven else None
            if self.driven:
                rates = module.actuator_rates(motors, u)
                times = np.where(np.real(rates) > 0.0, times[:5], times[5:])
                way = -np.maximum(times, 1e-6) * rates
            pace = h / np.maximum(times, 1e-6)
            after = motors - way + np.exp(-pace) * way
            mean = motors - way + (1.0 - np.exp(-pace)) / pace * way
            acting = u if self.driven else np.concatenate([mean, u[4:]])

        def accelerate(q: Array, v: Array, _: int) -> Array:
            inputs = acting
            if self.driven:
                inputs = module.inputs_of(module.integrate(q, h * v), v, mean, u)
            wrenches = np.zeros((2, 6), np.result_type(q, v))
            if self.driven:
                speeds = module.rotor_speeds(mean, u)
                wrenches = wrenches + air(module, q, v, speeds, np.zeros(3))
            elif not self.spec.figures:
                return module.forward_dynamics(q, v, inputs)
            if self.spec.figures:
                parts = [math.prod(shape) for _, shape in self.spec.figures]
                time, push, wind, gust, drag, wall, spin, mass, gravity = np.split(
                    g["around"], np.cumsum(parts)[:-1]
                )
                *_, q_d, v_d, _ = self.reference(g)
                share = np.clip((time - gust[0]) / gust[1], 0.0, 1.0)
                blown = wind + (1.0 - np.cos(2.0 * np.pi * share)) * gust[2:]
                velocities, poses = module.frame_velocities(q, v), module.frame_poses(q)
                wrenches = wrenches + push.reshape(2, 6)
                blown = np.concatenate([blown, np.zeros(3)])
                wrenches = wrenches + drag.reshape(2, 6) * (blown - velocities)
                thrust = inputs[2]
                size = (
                    spin[3] * np.sign(np.real(thrust)) * np.sqrt(thrust * np.sign(np.real(thrust)))
                )
                wrenches[1, 3:] += np.cross(size * (poses[1, :3, :3] @ spin[:3]), velocities[1, 3:])
                f = CONTACTS[0].frame
                away = module.frame_poses(q)[f, :3, 3] - wall[7:10]
                size = np.sqrt(away @ away)
                normal, deep = away / size, wall[10] - size + wall[0]
                velocity = module.frame_velocities(q, v)[f]
                inwards = -normal @ velocity[:3]
                force = wall[1] * deep * (1.0 + wall[3] * inwards) + wall[2] * inwards
                force = force * float(np.real(deep) > 0.0 and np.real(force) > 0.0)
                way = module.frame_velocities(q_d, v_d)[f, :3]
                way = way - (normal @ way) * normal
                drag = -wall[4] * force * way / np.sqrt(way @ way + 0.02**2)
                wrenches[f, :3] += force * normal + drag
                wrenches[f, 3:] += np.cross(-wall[0] * normal, drag)
                free = module.forward_dynamics_with_wrenches(q, v, inputs, wrenches)
                jacobian = module.frame_jacobians(q)[1, :3]
                bias = module.frame_bias_accelerations(q, v)[1, :3]
                yielding = jacobian @ np.linalg.solve(module.mass_matrix(q), jacobian.T)
                pulled = mass * (gravity - bias - jacobian @ free)
                wrenches[1, :3] += np.linalg.solve(np.eye(3) + mass * yielding, pulled)
            return module.forward_dynamics_with_wrenches(q, v, inputs, wrenches)

        if self.spec.method == "rk4":
            return (*stepped(module, "rk4", accelerate, q, v, h), after, u)
        v_next = v + h * accelerate(q, v, 0)
        return module.integrate(q, 0.5 * h * (v + v_next)), v_next, after, u

    def errors(self, g: dict[str, Array], q: Array) -> Array:
        """Errors of points, orientations and coordinates."""
        poses, (points, turns, q_d, _, _) = self.module.frame_poses(q), self.reference(g)
        found = [
            poses[f, :3, 3] - points[3 * k : 3 * k + 3] for k, f in enumerate(self.spec.points)
        ]
        for k, f in enumerate(self.spec.orientations):
            between = poses[f, :3, :3] @ turns[9 * k : 9 * k + 9].reshape(3, 3).T
            about = np.array(
                [
                    between[2, 1] - between[1, 2],
                    between[0, 2] - between[2, 0],
                    between[1, 0] - between[0, 1],
                ]
            )
            found.append(about / np.sqrt(1.0 + np.trace(between)))
        return np.concatenate([*found, self.module.difference(q_d, q)])

    def cost(self, g: dict[str, Array], u: Array, x: Array) -> Array:
        """The cost of a node."""
        q, v, _, before = self.split(x)
        errors, (*_, v_d, u_d) = self.errors(g, q), self.reference(g)
        of_errors, of_rates, of_inputs, of_changes = self.weights(g, errors.size)
        off = u - u_d
        for row, entry in self.spec.served:
            away = np.concatenate([errors[-8:], v - v_d])
            off = off - np.eye(6)[row] * away[entry]
        cost = of_errors @ errors**2 + of_rates @ (v - v_d) ** 2 + of_inputs @ off**2
        return 0.5 * (cost + (of_changes @ (u - before) ** 2 if before.size else 0.0))

    def weights(self, g: dict[str, Array], errors: int) -> Sequence[Array]:
        """Weights of errors, velocities, inputs and changes."""
        return np.split(g["weights"], np.cumsum([errors, 8, 6]))

    def ways(self, x: Array) -> Array:
        """Displacements of a state: of coordinates, and of all else."""
        rest = x.size - self.n
        found = np.zeros((x.size, rest + 8))
        found[: self.n, :8], found[self.n :, 8:] = self.module._moves(x[: self.n]), np.eye(rest)
        return found


@pytest.mark.parametrize("name", HORIZONS)
def test_nodes_of_a_horizon(name: str) -> None:
    ahead = Ahead(name)
    module, program = ahead.module, ahead.spec.node()
    for seed in (3, 4):
        g = random_inputs(module, program, seed)
        g |= {"h": np.array(0.04), "weights": np.abs(g["weights"]) + 0.1}
        if "lag_times" in g:
            g["lag_times"] = np.abs(g["lag_times"]) * 0.2
        references = list(ahead.reference(g))
        references[2] = module.state(np.random.default_rng(seed))[0]
        count = len(ahead.spec.orientations)
        references[1] = (
            np.concatenate([module.turns(references[2])[-1].ravel()] * count)
            if count
            else references[1]
        )
        g["reference"] = np.concatenate(references)
        found = evaluate(program, g, {"robot": module})
        u, x = g["u"], g["x"]
        after, given = ahead.predicted(g, u, x), ahead.split(g["x_next"])
        gap = [
            module.difference(given[0], after[0]),
            *(a - b for a, b in zip(after[1:], given[1:], strict=True) if b.size),
        ]
        close(found["gap"], np.concatenate(gap), 1e-11)
        close(found["cost"], ahead.cost(g, u, x))
        values = ahead.spec.values()
        both = evaluate(values, {n: g[n] for n in values.names}, {"robot": module})
        close(both["gap"], found["gap"])
        close(both["cost"], found["cost"])
        columns, gradient = [], []
        ways = [(way, 0.0 * x) for way in np.eye(6)] + [(0.0 * u, way) for way in ahead.ways(x).T]
        moves = module._moves(after[0])
        for du, dx in ways:
            moved = ahead.predicted(g, u + 1j * STEP * du, x + 1j * STEP * dx)
            rates = [np.imag(y) / STEP for y in (moved if given[3].size else moved[:3])]
            columns.append(
                np.concatenate([np.linalg.lstsq(moves, rates[0], rcond=None)[0], *rates[1:]])
            )
            gradient.append(np.imag(ahead.cost(g, u + 1j * STEP * du, x + 1j * STEP * dx)) / STEP)
        close(found["slope"], np.stack(columns, 1), 1e-11)
        close(found["gradient"], np.array(gradient), 1e-11)
        q = x[: ahead.n]
        slope = np.stack(
            [np.imag(ahead.errors(g, q + 1j * STEP * way)) / STEP for way in module._moves(q).T], 1
        )
        of_errors, _, of_inputs, _ = ahead.weights(g, len(slope))
        hessian = slope.T @ (of_errors[:, None] * slope)
        for row, entry in ahead.spec.served:
            if entry < 8:
                hessian[entry, entry] += of_inputs[row]
        close(found["hessian"], hessian, 1e-11)
        end_of(ahead, g, slope, hessian)


def end_of(ahead: Ahead, g: dict[str, Array], slope: Array, hessian: Array) -> None:
    """Compare the end of a horizon, and displacements of states."""
    program, module, random = ahead.spec.end(), ahead.module, np.random.default_rng(6)
    known = random.normal(size=ahead.spec.ahead)
    matrix = known[:256].reshape(16, 16)
    matrix = matrix @ matrix.T
    g |= {"ahead": np.concatenate([matrix.ravel(), known[256:]])}
    found = evaluate(program, {n: g[n] for n in program.names}, {"robot": module})
    q, v, *_ = ahead.split(g["x"])
    errors, (*_, v_d, _) = ahead.errors(g, q), ahead.reference(g)
    of_errors, of_rates, *_ = ahead.weights(g, errors.size)
    away, by_q = errors[-8:].copy(), slope[-8:].copy()
    if ahead.spec.carries:
        turn, tip = known[256:265].reshape(3, 3), known[265:].reshape(3, 8)
        place = slice(0, 3) if module.ATTITUDE == "quaternion" else slice(5, 8)
        away[place] += turn @ (errors[:3] - tip @ errors[-8:])
        by_q[place] += turn @ (slope[:3] - tip @ slope[-8:])
    off = np.concatenate([away, v - v_d])
    whole = np.block([[by_q, np.zeros((8, 8))], [np.zeros((8, 8)), np.eye(8)]])
    squares = np.zeros((16, 16))
    squares[:8, :8] = slope.T @ (of_errors[:, None] * slope)
    squares[8:, 8:] = np.diag(of_rates)
    close(found["hessian"], whole.T @ matrix @ whole + squares, 1e-11)
    pull = np.concatenate([slope.T @ (of_errors * errors), of_rates * (v - v_d)])
    close(found["gradient"], whole.T @ matrix @ off + pull, 1e-11)
    close(
        found["cost"],
        0.5 * (off @ matrix @ off + of_errors @ errors**2 + of_rates @ (v - v_d) ** 2),
        1e-11,
    )
    way = random.uniform(-0.3, 0.3, ahead.spec.states)
    after = evaluate(ahead.spec.moved(), {"x": g["x"], "displacement": way}, {"robot": module})[
        "x_next"
    ]
    close(after, np.concatenate([module.integrate(q, way[:8]), g["x"][ahead.n :] + way[8:]]))
    back = evaluate(ahead.spec.away(), {"x": g["x"], "x_next": after}, {"robot": module})["away"]
    close(back, way)


@pytest.mark.parametrize(("attitude", "lists"), [("zyx", {}), ("quaternion", DRIVEN)])
@pytest.mark.parametrize("moves", [True, False])
def test_autopilots(attitude: str, lists: dict[str, Any], moves: bool) -> None:
    """Outputs that are no numbers command nothing."""
    loop = Loop(attitude, "held", lists, moves=moves)
    module, program = loop.module, command_program(loop.spec)
    own = [*"xa", "motors", "least", "most", "servos", "low", "high", "asked"]
    assert program.names == ["time", *own, "stiffness", "damping"]
    for lost in ("", "motors", "servos", "asked"):
        g = loop.values(program)
        g["low"] = g["low"] - 1.0
        g["motors"], g["servos"] = g["motors"] * 3.0 - 1.0, g["servos"] * 4.0 - 2.0
        g["damping"][loop.joints.start] = 0.0 if lost == "" else 1.3
        if lost:
            g[lost][0] = np.nan
        if lost == "asked":
            g["servos"][0] = np.nan
        found = loop.run(program, g)
        q, v, *_ = loop.parts(g["x"])
        share = np.clip(np.where(np.isnan(g["motors"]), 0.0, g["motors"]), 0.0, 1.0)
        thrusts = g["least"] + share * (g["most"] - g["least"])
        asked = g["low"] + 0.5 * (np.clip(g["servos"], -1.0, 1.0) + 1.0) * (g["high"] - g["low"])
        asked = np.where(np.isnan(asked), g["asked"], asked)
        close(found["next"], asked)
        q_d, v_d, a_d, *_ = loop.curves(float(g["time"]))
        joints = slice(7, 9) if loop.is_quaternion else loop.joints
        free = np.isnan(asked)
        wanted = np.where(free, q_d[joints], asked)
        rate, growth = (np.where(free, x[loop.joints], 0.0) for x in (v_d, a_d))
        k, d, off = g["stiffness"][loop.joints], g["damping"][loop.joints], wanted - q[joints]
        wished = growth + d * (rate - v[loop.joints]) + k * off
        # All else is moved as the joints' accelerations move it, since what acts on it stays.
        matrix, others = module.mass_matrix(q), np.delete(np.arange(8), np.r_[loop.joints])
        a = g["a"].copy()
        own = np.linalg.solve(
            matrix[np.ix_(others, others)],
            matrix[np.ix_(others, np.r_[loop.joints])] @ (wished - a[loop.joints]),
        )
        a[others], a[loop.joints] = a[others] - own, wished
        force = module.inverse_dynamics(q, v, a)[loop.joints]
        if not lists:
            if moves:
                force = force - module.input_matrix(q)[loop.joints, :4] @ thrusts
            close(found["u"], np.concatenate([thrusts, force]), 1e-11)
            continue
        at, speed = q.copy(), v.copy()
        at[joints] = wanted
        speed[loop.joints] = rate + np.where(d > 0.0, k / np.maximum(d, 1e-9), 0.0) * off
        sent = module.command_of(at, speed, np.concatenate([np.zeros(4), force]))
        close(found["u"], np.concatenate([thrusts, sent[4:]]), 1e-11)
    robot = Functions(module, "plant")
    measured = measurement_program(robot, [SensorAt("imu", 1, ()), SensorAt("encoders", 0, ())])
    telling = telling_program(loop.spec, measured)
    g = loop.values(telling)
    q, v, *_ = loop.parts(g["x"])
    right = {"q": q, "v": v, "a": g["a"], "wrenches": np.zeros((2, 6)), "gravity": g["gravity"]}
    pose = module.frame_poses(q)[0]
    attitude_of = q[3:7] if loop.is_quaternion else pose[:3, :3].ravel()
    wanted = [
        loop.run(measured, right)["measured"],
        pose[:3, 3],
        module.frame_velocities(q, v)[0, :3],
        attitude_of,
    ]
    close(loop.run(telling, g)["told"], np.concatenate(wanted))


def test_rotation_errors_have_a_derivative_at_none() -> None:
    rows = [[float(i == j) for j in range(3)] for i in range(3)]
    from gibbs_codegen.arrays import join, variable

    actual = [variable(f"r{k}", 3) for k in range(3)]
    program = Program(
        "p", tuple(actual), {"e": rotation_error(actual, [join(*row) for row in rows])}
    )
    found = evaluate(jacobian(program, "r0"), {f"r{k}": rows[k] for k in range(3)}, {})
    close(found["e"], np.zeros(3))
    close(found["e_by_r0"], [[0, 0, 0], [0, 0, 0.5], [0, -0.5, 0]])
    assert Contact(0, 0, ball, 4).sticks is False
