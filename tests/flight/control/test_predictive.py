"""Predictive control: its programs against differences, its plans against conditions of optima."""

from __future__ import annotations

import copy
import ctypes
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize
from support import blown
from support.actuated import TEXT, actuated
from support.compiled import build
from support.kept import kept_folder, made_once
from support.tools import run

from gibbs_codegen import Simulation, trim
from gibbs_codegen.arrays import Functions, Program, dot, join, square_root, variable
from gibbs_codegen.arrays.evaluation import evaluate
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.predictive import NoPlanError, Predictive, Tolerances
from gibbs_codegen.flight.many import simulate_many
from gibbs_codegen.flight.plant.actuators import module_actuators
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.walls import Plane
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.pipeline import generate, generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.parts.base import Attitude
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.predictive import DERIVATIVES, UNDER_WRENCHES, WITH_PAYLOADS
from gibbs_codegen.targets.registry import find_targets, render_module

NODES, STEP = 6, 0.02


@dataclass(frozen=True)
class Rest:
    """A state at rest and its inputs."""

    q: Any
    u: Any


def made(attitude: Attitude) -> ModuleType:
    """A small machine with a damped joint."""
    robot = paper_family(6, 1)
    damped = replace(robot.links[0], passive=replace(robot.links[0].passive, damping=0.3))
    base = replace(robot.base, attitude=attitude)
    robot = replace(robot, base=base, links=(damped,))
    folder = kept_folder(robot, "predictive") / robot.name

    def make() -> None:
        folder.mkdir(parents=True)
        model = derive(robot, derivatives=(*DERIVATIVES, *UNDER_WRENCHES, "step_rk4"))
        for name, text in render_module(model, "", find_targets(("numpy", "c"))).items():
            (folder / name).write_text(text, encoding="utf-8")

    return load(made_once(folder, make), "c")


@pytest.fixture(scope="module", params=["xyz", "quaternion"])
def either(request: pytest.FixtureRequest) -> ModuleType:
    """The machine with angles, and with a quaternion."""
    return made(request.param)


@pytest.fixture(scope="module")
def module() -> ModuleType:
    return made("quaternion")


def controller_of(module: ModuleType, **changes: Any) -> Predictive:
    """A controller that brings the tip half a metre to a side, with what may be asked of one."""
    vehicle = Vehicle(module)
    q = vehicle.neutral
    q[vehicle.arm] = 0.4
    still = np.zeros(vehicle.layout.v.size)
    force = vehicle.inverse_dynamics(q, still, still)
    u = np.linalg.lstsq(vehicle.input_matrix(q), force, rcond=None)[0]
    tip = vehicle.frame_poses(q)[module.FRAMES.index("tip")]
    target, turned = tip[:3, 3] + [0.5, 0.0, 0.0], tip[:3, :3]
    actuators = module_actuators(vehicle)
    thrusts = u[: vehicle.rotors]
    actuators.thrusts[:] = [[thrusts.min() - 2.0], [thrusts.max() + 2.0]]
    actuators.joints[:] = [[0.2], [0.45]]
    actuators.velocities[:] = 0.5
    given: dict[str, Any] = {
        "points": {"tip": lambda t: np.tile(target, (len(t), 1))},
        "orientations": {"tip": lambda t: np.tile(turned, (len(t), 1, 1))},
        "nodes": NODES,
        "actuators": actuators,
    }
    return Predictive(module, Rest(q, u), **(given | changes))


def every_kind(module: ModuleType, **changes: Any) -> Predictive:
    """A controller of lag, limits of rates, and costs of changes."""
    limits = controller_of(module).actuators
    assert limits is not None
    lag = np.full_like(limits.lag, 0.03)
    tolerances = Tolerances(change=0.5)
    changes |= {"actuators": replace(limits, lag=lag), "rates": 200.0, "tolerances": tolerances}
    return controller_of(module, **changes)


def stay(controller: Predictive) -> None:
    """Let the plan be to hover, from where the machine is."""
    told, hover = controller._compiled.arrays, controller.hover
    still = np.zeros(controller.horizon.robot.space.velocities)
    motors = told["settled"][: controller.horizon.motors]
    before = controller._inputs if controller.horizon.changes else np.zeros(0)
    told["x"][:] = np.concatenate([hover.q, still, motors, before])
    told["u"][:], told["failures"][()] = controller._inputs, 0.0


def inputs_of(controller: Predictive, k: int) -> dict[str, Any]:
    """What the program of a node is given by the plan."""
    told = controller._compiled.arrays
    given = {"u": told["u"][k], "x": told["x"][k], "x_next": told["x"][k + 1], "h": told["h"][k]}
    given |= {"reference": told["reference"][k], "weights": told["weights"]}
    given |= {"around": told["around"].copy()}
    return given | {"lag_times": told["lag_times"][: controller.horizon.lag_times]}


def value(controller: Predictive, program: Any, given: dict[str, Any]) -> dict[str, Any]:
    """Results of a program."""
    constants = controller._compiled.arrays["constants"].tobytes()
    own = {name: given[name] for name in program.names}
    return evaluate(program, own, {"robot": controller.module}, {"robot": constants})


@pytest.mark.slow
@pytest.mark.parametrize("kind", [controller_of, every_kind])
def test_a_plan_is_the_optimum_within_limits(kind: Any, either: ModuleType) -> None:
    """By the conditions of Karush, Kuhn and Tucker of the dense program, which NumPy assembles."""
    controller = kind(either)
    horizon, own = controller.horizon, controller._compiled
    robot, told = horizon.robot, own.arrays
    nu, nx, nv = robot.inputs, horizon.states, robot.space.velocities
    controller._refer(0.0, controller.hover.q)
    stay(controller)
    told["tolerance"][()], told["rounds"][()] = 1e-11, 1
    before = told["x"].copy(), told["u"].copy()
    nodes = [value(controller, horizon.node(), inputs_of(controller, k)) for k in range(NODES)]
    end = {"x": told["x"][-1], "reference": told["reference"][-1], "weights": told["weights"]}
    last = value(controller, horizon.end(), end | {"ahead": told["ahead"]})
    own.prepare()
    solved, _ = own.feedback(np.r_[controller.hover.q, np.zeros(nv)])
    assert solved
    assert told["share"] == 1.0
    away = horizon.away()
    dx = np.array(
        [
            value(controller, away, {"x": a, "x_next": b})["away"]
            for a, b in zip(before[0], told["x"], strict=True)
        ]
    )
    du = told["u"] - before[1]
    # All in one vector: u and x of each node, then x of the last one.
    width = nu + nx
    size = NODES * width + nx
    w = np.zeros(size)
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    equal, gaps = np.zeros((nx * (NODES + 1), size)), np.zeros(nx * (NODES + 1))
    equal[:nx, nu:width], gaps[:nx] = np.eye(nx), dx[0]
    for k, node in enumerate(nodes):
        at = slice(k * width, (k + 1) * width)
        w[at] = np.r_[du[k], dx[k]]
        hessian[at, at][range(width), range(width)] = told["diagonal"]
        first = k * width + nu
        hessian[first : first + nv, first : first + nv] += node["hessian"]
        for i in range(horizon.before):
            a, b = k * width + i, (k + 1) * width - horizon.before + i
            hessian[a, b] = hessian[b, a] = told["across"][i, nx - horizon.before + i]
        gradient[at] = node["gradient"]
        rows = slice((k + 1) * nx, (k + 2) * nx)
        equal[rows, at] = -node["slope"]
        begin = (k + 1) * width + (nu if k + 1 < NODES else 0)
        equal[rows, begin : begin + nx] = np.eye(nx)
        gaps[rows] = node["gap"]
    w[NODES * width :] = dx[-1]
    hessian[-nx : size - nx + 2 * nv, -nx : size - nx + 2 * nv] = last["hessian"]
    gradient[-nx : size - nx + 2 * nv] = last["gradient"]
    np.testing.assert_allclose(equal @ w, gaps, atol=1e-9)
    # Limits, of which those that are met push back.
    columns, active = [], 0
    rows, limits = controller._rows()
    for k in range(NODES + 1):
        values = np.r_[before[1][min(k, NODES - 1)], before[0][k]]
        for row, least, most, penalty in zip(
            rows, limits["least"], limits["most"], limits["penalty"], strict=True
        ):
            if (row.entry < nu and k == NODES) or (row.entry >= nu and k == 0):
                continue
            shift = nu if k == NODES else 0
            column = np.zeros(size)
            column[k * width + row.entry - shift] = 1.0
            now = values[row.place]
            if row.other >= 0:
                column[k * width + row.other - shift] = -1.0
                now = now - values[row.other_place]
                least, most = least * STEP, most * STEP
            reached = now + column @ w
            if penalty >= 1e30:
                assert least - 1e-7 < reached < most + 1e-7
            for sign, limit in ((1.0, most), (-1.0, least)):
                if sign * (reached - limit) > -1e-5:
                    columns.append(sign * column)
                    active += 1
    assert active > 3
    every = np.column_stack([equal.T, *columns])
    lower = np.r_[np.full(len(equal), -np.inf), np.zeros(active)]
    pull = -(hessian @ w + gradient)
    found = lsq_linear(every, pull, (lower, np.inf), tol=1e-14)
    assert np.abs(every @ found.x - pull).max() < 1e-5 * np.abs(gradient).max()


def flown(controller: Predictive) -> list[tuple[Any, Any, Any]]:
    """States, references and inputs of instants of a flight along a path, after a push."""
    module, q = controller.module, controller.hover.q.copy()
    v = np.random.default_rng(5).uniform(-0.5, 0.5, controller.horizon.robot.space.velocities)
    found = []
    for k in range(20):
        u = controller.inputs(k * STEP, q, v)
        told = controller._compiled.arrays
        found.append((np.r_[q, v], told["reference"].copy(), u))
        v = v + STEP * module.forward_dynamics(q, v, u)
        q = module.integrate(q, STEP * v)
    return found


def test_a_cost_of_ones_own_is_that_of_tolerances(either: ModuleType) -> None:
    """What looser tolerances leave of weights is asked for by a program."""
    robot = Functions(either)
    (q, v), u, target = robot.state(), variable("u", robot.inputs), variable("target", 3)
    place, turning = either.FRAMES.index("tip"), robot.layout.v.attitude
    tip = join(*(robot.frame_poses(q)[place][row][3] for row in range(3)))
    near = controller_of(either)._first_point + 0.02
    path = {"tip": lambda t: np.tile(near, (len(t), 1))}
    asked: dict[str, Any] = {"points": path, "orientations": {}, "farthest": 1.0}
    exact = controller_of(either, tolerances=Tolerances(thrust=2.0), **asked)
    most = exact.hover.u[: robot.rotors]
    left = np.sqrt(0.75) * np.array([1.0 / 0.002, 1.0, 1.0 / 2.0])
    wishes = left[0] * (tip - target), left[1] * v[turning], left[2] * (u[: robot.rotors] - most)
    loose = Tolerances(
        0.004, angular_velocity=2.0, thrust=4.0, effort=exact._weights()["inputs"][-1] ** -0.5
    )
    own = replace(
        exact,
        tolerances=loose,
        cost=Program("own", (v, target, u, q), {"missed": join(*wishes)}),
        signals={"target": path["tip"]},
    )
    own._compiled.arrays["ahead"][:] = exact._compiled.arrays["ahead"]
    x, still = exact.hover.q, np.zeros(len(either.VELOCITIES))
    for k in range(3):
        planned = [each.inputs(k * STEP, x, still) for each in (exact, own)]
        np.testing.assert_allclose(planned[1], planned[0], rtol=1e-9)
        assert own.log[-1].solved
        assert own.log[-1].cost == pytest.approx(exact.log[-1].cost, rel=1e-9)


@pytest.mark.slow
def test_a_cost_of_ones_own_is_as_small_as_scipy_makes_it(module: ModuleType) -> None:
    """The tip is to stay off a ball that moves: over all inputs of a horizon without limits."""
    robot, centre = Functions(module), variable("centre", 3)
    (q, _), time = robot.state(), variable("time")
    place, gain, far = module.FRAMES.index("tip"), 40.0, 0.3
    off = join(*(robot.frame_poses(q)[place][row][3] for row in range(3))) - centre
    asked = {"off": join(gain * (square_root(dot(off, off)) - far), 3.0 * time * q[:2])}
    wide = circling(module).actuators
    begin = circling(module)._first_point

    def ball(times: Any) -> Any:
        return begin + np.outer(times - 1.7, [0.0, 0.5, 0.0]) + np.array([0.25, 0.0, 0.0])

    own = controller_of(
        module,
        points={"tip": lambda t: np.tile(begin, (len(t), 1))},
        orientations={},
        tolerances=Tolerances(point=0.05),
        actuators=wide,
        nodes=3,
        iterations=100,
        cost=Program("off_a_ball", (q, centre, time), asked),
        signals={"centre": ball},
    )
    now, still = 2.0, np.zeros(len(module.VELOCITIES))
    own.inputs(now, own.hover.q, still)
    told, horizon = own._compiled.arrays, replace(own.horizon, cost=None)
    times = now + STEP * np.arange(4)
    references = told["reference"][:, 4:]

    def costs(u: Any) -> Any:
        """Of inputs (n, 3 nu)."""
        x, total = np.tile(np.r_[own.hover.q, still], (len(u), 1)), np.zeros(len(u))
        given = {"h": STEP, "weights": told["weights"], "ahead": told["ahead"]}
        for k, inputs in enumerate([*np.split(u, 3, axis=1), None]):
            way = module.frame_poses(x[:, : len(own.hover.q)])[:, place, :3, 3] - ball(
                times[k : k + 1]
            )
            missed = gain * (np.linalg.norm(way, axis=1) - far)
            total += 0.5 * (missed**2 + np.sum((3.0 * times[k] * x[:, :2]) ** 2, axis=1))
            given |= {"x": x, "x_next": x, "u": inputs, "reference": references[k]}
            found = value(own, horizon.end() if inputs is None else horizon.values(), given)
            total += found["cost"]
            if inputs is not None:
                x = value(own, horizon.moved(), {"x": x, "displacement": found["gap"]})["x_next"]
        return total

    def slope(u: Any) -> Any:
        steps = 1e-5 * np.eye(len(u))
        return (costs(u + steps) - costs(u - steps)) / 2e-5

    best = minimize(lambda u: costs(u[np.newaxis])[0], np.tile(own.hover.u, 3), jac=slope, tol=1e-6)
    assert own.log[-1].cost == pytest.approx(best.fun, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("compiler", "macros"), [("gcc", ["SINGLY"])])
def test_c_has_the_inputs_of_python(
    compiler: str, macros: list[str], module: ModuleType, tmp_path: Path
) -> None:
    """Without vectors, of a controller that makes up for delay, and whose settings are copied."""
    controller = every_kind(module, delay=0.015)
    start = controller._first_point

    def path(times: Any) -> Any:
        return start + np.outer(0.05 * np.sin(4.0 * times), [1.0, -0.5, 0.2])

    controller = replace(controller, points={"tip": path})
    header, source = controller.write_c(tmp_path)
    folder, name = Path(module.__path__[0]), module.NAME
    assert (header.name, source.name) == (f"{name}_predictive.h", f"{name}_predictive.c")
    options = ["-O2", "-march=native", f"-I{folder}", f"-I{tmp_path}", "-shared", "-fPIC"]
    options += [f"-D{name.upper()}_{macro}" for macro in macros]
    sources = [str(source), *(str(folder / f"{name}{part}.c") for part in ("", "_batch"))]
    path = build(compiler, options, sources, tmp_path / "predictive.so")
    seen = {line.split()[-1] for line in run(["nm", "-D", "--defined-only", path]).splitlines()}
    assert all(symbol.startswith((f"{name}_", "_")) for symbol in seen)
    library = ctypes.CDLL(str(path))
    library[f"{name}_predictive_size"].restype = ctypes.c_size_t
    # Not where vectors may be.
    memory = np.full(library[f"{name}_predictive_size"]() // 8 + 1, np.nan)[1:]
    own = ctypes.c_void_p(memory.ctypes.data)
    library[f"{name}_predictive_init"](own)
    u = np.full(controller.horizon.robot.inputs, np.nan)
    for state, reference, right in flown(controller):
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (state, reference, u)]
        assert library[f"{name}_predictive_step"](own, *pointers) == 1
        np.testing.assert_allclose(u, right, rtol=0, atol=1e-9 * np.abs(right).max())
    assert all(instant.solved for instant in controller.log)


def wrong_costs(module: ModuleType) -> list[tuple[Any, Any, str]]:
    """Inputs and outputs of programs that are no costs, and what is said of them."""
    robot, plain, time = Functions(module), variable("q", len(module.COORDINATES)), variable("time")
    (q, v), ball = robot.state(), variable("ball", 3)
    other = Functions(module, "plant")
    return [
        ((q, v), {"a": v, "b": v}, "one output, a vector"),
        ((v,), {"a": dot(v, v)}, "one output, a vector"),
        ((), {}, "one output, a vector"),
        ((time,), {"a": join(time, 1.0)}, "q, v or u among its inputs"),
        ((plain,), {"a": plain[:2]}, "`Functions` of .* makes them"),
        ((v, ball), {"a": join(v, ball)}, "it differs by ball"),
        ((q,), {"a": other.frame_poses(q)[1][0]}, "call functions of .* alone"),
    ]


@pytest.mark.slow
def test_what_is_wrong_is_told(module: ModuleType) -> None:
    u, w = variable("u", len(module.INPUTS)), variable("w")
    for changes, words in (
        ({"step": 0.0}, "step must be a finite time above 0"),
        ({"nodes": 0}, "nodes must be 1 to 500"),
        ({"points": {"hand": lambda t: t}}, "no frame hand; its frames: base, tip"),
        ({"nodes": 2.5}, "nodes must be 1 to 500"),
        ({"rates": 0.0}, "rates must be above 0"),
        ({"deadline": -1.0}, "deadline must be a time of 0 or more"),
        ({"growth": 1.1}, "growth must be 1 for a machine with dampers"),
        ({"method": "heun"}, 'method must be "trapezoidal" or "rk4"'),
        ({"points": [len]}, "points must be functions of times by names"),
        ({"tolerances": 0.1}, "tolerances must be `Tolerances`"),
        ({"step": "0.02"}, "step must be a number"),
        ({"walls": [1.0]}, "walls must be walls, as"),
        ({"walls": [Plane("hand", (0.0,) * 3, (0.0, 0.0, 1.0), 1e3)]}, "no frame hand"),
        ({"iterations": 1.5}, "iterations must be 1 to 100"),
        ({"points": {"tip": lambda t: t}}, r"points\['tip'\]: must be .* finite numbers \(n, 3\)"),
        (
            {"points": {"tip": lambda t: [[0.0], [1.0, 2.0]]}},
            r"points\['tip'\]: must be a function",
        ),
        ({"posture": lambda t: np.full((len(t), 8), np.nan)}, "posture: must be .* NaN"),
        ({"points": {"tip": 3.0}}, "points, orientations and signals must be functions of"),
        ({"points": {3: len}}, "points, orientations and signals must be functions of"),
        ({"parameters": 3.0}, "parameters must be numbers by names"),
        ({"rates": "fast"}, "rates: must be above 0, one or as many as inputs, not 'fast'"),
        ({"rates": [1.0, 2.0]}, r"rates: must be above 0, .* shape \(2,\)"),
        ({"tolerances": Tolerances(joints=[0.1, 0.1])}, "one for each of the 1 joints"),
        ({"cost": 3.0}, "cost must be a `Program`"),
        ({"signals": {"ball": len}}, "signals must have .* it differs by ball"),
        (
            {
                "cost": Program("a", (u, w), {"a": w * u}),
                "signals": {"w": lambda t: np.ones((2, 9))},
            },
            r"signals\['w'\]: must be .* finite numbers \(n\)",
        ),
        *(
            ({"cost": Program("own", inputs, outputs)}, words)
            for inputs, outputs, words in wrong_costs(module)
        ),
        *(
            ({"orientations": {"tip": lambda t, x=x: np.tile(x, (len(t), 1, 1))}}, "rotation matri")
            for x in (np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3))
        ),
    ):
        with pytest.raises(UsageError, match=words):
            controller_of(module, **changes)
    rest: Any
    for rest in (Rest(np.zeros(3), np.zeros(2)), None):
        with pytest.raises(
            UsageError, match=r"hover\.q: must be \d+ finite numbers; hover is a state"
        ):
            Predictive(module, rest)
    robot: Any
    for robot in (pytest, None):
        with pytest.raises(UsageError, match="module must be a module, as load"):
            Predictive(robot, Rest(np.zeros(3), np.zeros(2)))
    controller = controller_of(module)
    q, v = controller.hover.q, np.zeros(len(module.VELOCITIES))
    wrong: Any
    for name, wrong in (
        ("time", (np.nan, q, v)),
        ("time", (None, q, v)),
        ("q", (0.0, None, v)),
        ("q", (0.0, q[np.newaxis], v)),
        ("v", (0.0, q, v[:-1])),
        ("v", (0.0, q, "fast")),
    ):
        with pytest.raises(UsageError, match=rf"predictive\.inputs: {name}: must be "):
            controller.inputs(*wrong)
    nothing: Any = None
    with pytest.raises(UsageError, match="is called with an `Observation`, not NoneType"):
        controller(nothing)
    with pytest.raises(UsageError, match="folder must be a path, not None"):
        controller.write_c(nothing)
    tolerance: Any
    for tolerance in (0.0, [0.1, -1.0], [[1.0]], "tight", None):
        with pytest.raises(UsageError, match="tolerances: joints"):
            Tolerances(joints=tolerance)
    with pytest.warns(UserWarning, match="a step of 0.1 s is long"):
        controller_of(module, step=0.1)
    with pytest.raises(UsageError, match='backend="c"'):
        controller_of(load(module.__path__[0]))


def tip_of(module: ModuleType, q: Any) -> Any:
    """Place of the tip (3), m."""
    return module.frame_poses(q)[..., module.FRAMES.index("tip"), :3, 3]


def missed_by(controller: Predictive, seconds: float, delay: float = 0.0, lag: float = 0.0) -> Any:
    """Distances of the tip from where it is to be, m, after each instant of a flight.

    Inputs act `delay` later, a whole number of milliseconds, and thrusts follow them with a lag.
    """
    module, h = controller.module, 0.001
    q, v = controller.hover.q.copy(), np.zeros(len(module.VELOCITIES))
    rotors = controller.vehicle.rotors
    every = round(controller.step / h)
    waiting = [controller.hover.u] * (round(delay / h) + 1)
    thrusts, found = controller.hover.u[:rotors].copy(), []
    (path,) = controller.points.values()
    for k in range(round(seconds / h)):
        if k % every == 0:
            u = controller.inputs(k * h, q, v)
            found.append(np.linalg.norm(tip_of(module, q) - path(np.array([k * h]))[0]))
        waiting.append(u)
        u_acting = waiting.pop(0)
        thrusts = u_acting[:rotors] + (np.exp(-h / lag) if lag else 0.0) * (
            thrusts - u_acting[:rotors]
        )
        q, v = module.step_rk4(q, v, np.r_[thrusts, u_acting[rotors:]], h)
    return np.array(found)


def circling(module: ModuleType, **changes: Any) -> Predictive:
    """A controller that leads the tip from where it hovers around a circle, of 2 s a turn."""
    wide = controller_of(module).actuators
    assert wide is not None
    for limits in (wide.thrusts, wide.joints):
        limits[:] = [[-100.0], [100.0]]
    wide.velocities[:] = 100.0
    controller = controller_of(module)
    begin = tip_of(module, controller.hover.q)

    def path(times: Any) -> Any:
        angle = np.pi * np.clip(times, 0.0, None)
        return begin + 0.1 * np.stack([1.0 - np.cos(angle), 0.0 * angle, np.sin(angle)], -1)

    given: dict[str, Any] = {"points": {"tip": path}, "orientations": {}, "nodes": 20}
    return controller_of(module, **(given | {"actuators": wide} | changes))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("led", "jump"), [("point", [-3.0, 0.0, 4.0]), ("posture", [0.05, 0.0, 0.0])]
)
def test_a_path_may_jump_at_an_instant(led: str, jump: list[float], module: ModuleType) -> None:
    """Near it what is led arrives, and farther it comes nearer at the tolerance of velocity."""
    start = circling(module)
    q, shift = start.hover.q, np.zeros(len(module.VELOCITIES))
    shift[start.vehicle.layout.v.position] = jump

    def postures(times: Any) -> Any:
        return module.integrate(q, shift * (times >= 0.5)[:, np.newaxis])

    def path(times: Any) -> Any:
        return tip_of(module, postures(times))

    posture = postures if led == "posture" else None
    controller = circling(module, points={"tip": path}, posture=posture)
    off, size = missed_by(controller, 1.5), np.linalg.norm(jump)
    assert all(instant.solved for instant in controller.log)
    assert off.max() < 1.01 * size + 0.01
    assert off[-10:].max() < max(1e-4, size - 0.4)


@pytest.mark.slow
def test_what_is_far_off_is_led_at_a_speed(module: ModuleType) -> None:
    controller = circling(module)
    target, off = controller._first_point, np.array([0.0, -0.6, 0.8])
    controller = replace(controller, points={"tip": lambda t: np.tile(target, (len(t), 1))})
    place, robot = controller.vehicle.layout.q.position, controller.horizon.robot
    q = controller.hover.q.copy()
    q[place] += off
    speed, nearest = controller.tolerances.velocity, 5.0 * controller.tolerances.point
    controller._refer(7.0, q)
    nodes = controller._compiled.arrays["reference"]
    left = 1.0 - nearest - speed * controller._ahead[:-1]
    np.testing.assert_allclose(nodes[:, :3] - target, np.outer(left, off), atol=1e-12)
    v = nodes[:, 3 + robot.space.coordinates :][:, controller.vehicle.layout.v.position]
    np.testing.assert_allclose(v, np.tile(-speed * off, (len(v), 1)), atol=1e-9)


@pytest.mark.slow
def test_an_orientation_needs_no_posture(module: ModuleType) -> None:
    """The tip is turned by 0.6 rad about the vertical, where it stays."""
    start = circling(module)
    place = module.FRAMES.index("tip")
    pose = start.vehicle.frame_poses(start.hover.q)[place]

    def turned(times: Any) -> Any:
        angle = 0.6 * np.clip(times, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(times, 0.0, 1.0))
        zero, one = 0.0 * angle, 1.0 + 0.0 * angle
        rows = [
            np.stack([np.cos(angle), -np.sin(angle), zero], -1),
            np.stack([np.sin(angle), np.cos(angle), zero], -1),
            np.stack([zero, zero, one], -1),
        ]
        return np.stack(rows, 1) @ pose[:3, :3]

    def still(times: Any) -> Any:
        return np.tile(pose[:3, 3], (len(times), 1))

    given: dict[str, Any] = {"points": {"tip": still}, "orientations": {"tip": turned}}
    controller = circling(module, **given)
    assert missed_by(controller, 2.0)[-5:].max() < 1e-4
    last = controller._compiled.arrays["x"][0, : len(start.hover.q)]
    right = turned(np.array([2.0]))[0]
    cosine = 0.5 * np.trace(controller.vehicle.frame_poses(last)[place, :3, :3] @ right.T) - 0.5
    assert np.arccos(min(cosine, 1.0)) < 1e-3


@pytest.mark.slow
def test_delay_and_lag_are_made_up_for(module: ModuleType) -> None:
    delay, lag = 0.02, 0.03
    limits = circling(module).actuators
    assert limits is not None
    late = replace(limits, lag=np.full_like(limits.lag, lag))
    knows = missed_by(circling(module, delay=delay, actuators=late), 1.0, delay, lag)
    ignores = missed_by(circling(module), 2.0, 0.005, 0.01)
    assert knows[25:].max() < 1e-4
    assert ignores[25:].max() > 1e-2


@pytest.mark.parametrize("delay", [0.0, 0.005])
def test_what_is_planned_comes_next_where_nothing_disturbs(
    delay: float, module: ModuleType
) -> None:
    controller = circling(module, delay=delay)
    vehicle, step, h = controller.vehicle, controller.step, 5e-4

    def moved(q: Any, v: Any, u: Any, seconds: float) -> Any:
        for _ in range(round(seconds / h)):
            middle = vehicle.integrate(q, 0.5 * h * v), v + 0.5 * h * forward(q, v, u)
            q = vehicle.integrate(q, h * middle[1])
            v = v + h * forward(*middle, u)
        return q, v

    forward = vehicle.forward_dynamics
    seen = controller.hover.q, np.zeros(len(module.VELOCITIES))
    with pytest.raises(NoPlanError, match="has no plan"):
        _ = controller.plan
    u, calls = controller.hover.u, []
    for k in range(12):
        later = moved(*seen, u, delay)
        u = controller.inputs(k * step, *seen)
        calls.append((later[0], u, *controller.plan))
        seen = moved(*later, u, step - delay)
    (_, before, coordinates, inputs), (q, u, *_) = calls[-2:]
    np.testing.assert_allclose(q, coordinates[0], atol=1e-5)
    assert np.abs(coordinates[1] - q).max() > 1e-3
    assert np.abs(u - inputs[0]).max() < 0.03 * np.abs(u - before).max()
    controller.reset()
    with pytest.raises(NoPlanError, match="has no plan"):
        _ = controller.plan


def test_the_last_plan_is_followed_until_its_end(module: ModuleType) -> None:
    controller = circling(module)
    q, v = controller.hover.q, np.zeros(len(module.VELOCITIES))
    controller.inputs(0.0, q, v)
    coordinates, planned = controller.plan
    assert (len(coordinates), len(planned)) == (controller.nodes, controller.nodes - 1)
    unknown = np.full_like(v, np.nan)
    for k in range(1, controller.nodes):
        u = controller.inputs(k * controller.step, q, unknown)
        np.testing.assert_allclose(u, planned[k - 1], rtol=1e-9)
        assert not controller.log[-1].solved
        left = controller.plan
        np.testing.assert_allclose(left[0], coordinates[k:], atol=1e-9)
        np.testing.assert_allclose(left[1], planned[k:], rtol=1e-9)
    with pytest.raises(NoPlanError, match=r"no plan was found for 20 instants, 0.4 s"):
        controller.inputs(0.4, q, unknown)
    with pytest.raises(NoPlanError, match="has no plan"):
        _ = controller.plan
    controller.reset()
    controller.inputs(0.0, q, v)
    assert controller.log[-1].solved


@pytest.mark.slow
def test_a_plan_that_is_late_serves_an_instant_later(module: ModuleType) -> None:
    prompt, late = circling(module), circling(module, deadline=0.0)
    q, v = prompt.hover.q, np.zeros(len(module.VELOCITIES))
    first = prompt.inputs(0.0, q, v)
    np.testing.assert_array_equal(late.inputs(0.0, q, v), first)
    planned = prompt._compiled.arrays["u"][0].copy()
    away = v + 0.1
    second = prompt.inputs(prompt.step, q, away)
    assert np.abs(second - planned).max() > 1e-3
    np.testing.assert_allclose(late.inputs(late.step, q, away), planned, rtol=1e-9)


@pytest.mark.slow
def test_it_is_a_law_of_scenarios(module: ModuleType) -> None:
    changes = {"duration": 2.0, "control.law": "predictive", "motors.time_constant": 0.03}
    changes["control.integral"] = 0.5  # It is for other laws.
    integration = {"integration": {"method": "rk4", "step": 0.002}}
    flight = simulate(module, read_scenario("circle", changes | integration))
    assert (flight.law, flight.stopped) == ("predictive", "")
    off = flight.q - flight.q_desired
    assert np.abs(off[:, Vehicle(module).layout.q.position]).max() < 5e-3


@pytest.mark.slow
def test_it_pushes_on_walls_that_it_knows(module: ModuleType) -> None:
    """Sliding sideways along a wall that leans, with a force that the flight records."""
    vehicle = Vehicle(module)
    q = vehicle.neutral
    q[vehicle.arm] = np.radians(23)
    tip, direction = vehicle.frame_poses(q)[vehicle.frames.index("tip"), :3, 3], [0.1, 0.0, -1.0]
    wall = {"frame": "tip", "point": (tip - np.array([0, 0, 0.02])).tolist(), "normal": [0, 0, 1]}
    own = {"stiffness": 1000, "damping": 20, "friction": 0.5}
    changes = {
        "duration": 3,
        "base.path": {"kind": "line", "start": [0, 0, 0], "end": [0, 0.1, 0], "begin": 1.5}
        | {"duration": 1.5},
        "arm.posture_deg": dict.fromkeys(module.COORDINATES[vehicle.arm], 23),
        "control": {"law": "predictive", "force": {"value": 3, "direction": direction}},
        "wall": [wall | own],
        "integration": {"method": "rk4", "step": 0.001},
    }
    flight = simulate(module, read_scenario("hover", changes))
    slides = (flight.time > 1.7) & (flight.time < 2.8)
    pushed = flight.wall_forces[slides, 0] / np.hypot(1.0, 0.1)
    assert not flight.stopped
    assert np.abs(pushed - 3.0).max() < 0.3
    off = (flight.point("tip") - vehicle.frame_poses(flight.q_desired)[:, -1, :3, 3])[slides]
    assert np.abs(off[:, 1]).max() < 5e-3
    beside = {"frame": "tip", "point": [0, 0, 9], "normal": [1, 0.05, 0], "stiffness": 1000}
    changes["wall"] = [beside]
    with pytest.raises(UsageError, match=r"at 0\.\d+ s no \[\[wall\]\] faces the push; give"):
        simulate(module, read_scenario("hover", changes))
    changes["wall"] = []
    with pytest.raises(UsageError, match="needs a \\[\\[wall\\]\\] for the frame that pushes"):
        simulate(module, read_scenario("hover", changes))


@pytest.mark.slow
def test_flights_side_by_side_are_sampled_too(module: ModuleType) -> None:
    changes = {"duration": 0.2, "control.law": "predictive", "start": {"offset": [0.05, 0.0, 0.0]}}
    integration = {"integration": {"method": "rk4", "step": 0.002}}
    scenario = read_scenario("hover", changes | integration)
    alone = simulate(module, scenario)
    for flight in simulate_many(module, [scenario] * 2):
        np.testing.assert_array_equal(flight.q, alone.q)


def test_a_plan_is_found_after_a_measurement_that_is_no_number(module: ModuleType) -> None:
    controller = circling(module)
    q, v = controller.hover.q, np.zeros(len(module.VELOCITIES))
    controller.inputs(0.0, np.full_like(q, np.nan), v)
    controller.inputs(controller.step, q, v)
    assert [instant.solved for instant in controller.log] == [False, True]


def test_without_a_first_plan_inputs_are_those_of_hover(module: ModuleType) -> None:
    """From where no plan of two steps is found: joints turn faster than anything stops them."""
    controller = circling(module)
    v = np.full(len(module.VELOCITIES), 1e7)
    u = controller.inputs(0.0, controller.hover.q, v)
    assert not controller.log[-1].solved
    np.testing.assert_array_equal(u, controller.hover.u)


@pytest.mark.slow
def test_inputs_keep_their_rates_whatever_acts(module: ModuleType) -> None:
    controller = circling(module, rates=2.0, deadline=0.0)
    q, v, before = controller.hover.q, np.zeros(len(module.VELOCITIES)), controller.hover.u
    for k in range(5):
        u = controller.inputs(k * STEP, q, v + 0.3 * k)
        assert np.abs(u - before).max() <= 2.0 * STEP * (1.0 + 1e-12)
        before = u


@pytest.mark.slow
def test_a_copy_flies_as_the_controller_does(module: ModuleType) -> None:
    u = variable("u", len(module.INPUTS))
    cost = Program("effort", (u,), {"cost": 0.1 * u})
    controller = replace(circling(module), points={}, cost=cost)
    q, v = controller.hover.q, np.full(len(module.VELOCITIES), 0.1)
    copied = copy.deepcopy(controller)  # By the same words as pickle.
    np.testing.assert_array_equal(copied.inputs(0.0, q, v), controller.inputs(0.0, q, v))


@pytest.mark.slow
def test_limits_may_be_those_of_a_scenario(module: ModuleType) -> None:
    scenario = read_scenario("hover", {"motors": {"time_constant": 0.07, "limits": [0.5, 30.0]}})
    told = circling(module, actuators=scenario)._compiled.arrays
    np.testing.assert_array_equal(told["lag_times"], 0.07)
    assert set(told["most"][: controller_of(module).vehicle.rotors]) == {30.0}


@pytest.fixture(scope="module")
def driven() -> ModuleType:
    """A robot with every kind of actuator."""
    robot = actuated()
    derivatives = (*DERIVATIVES, *UNDER_WRENCHES)
    base = kept_folder(robot, derivatives)

    def make() -> None:
        generate_robot(robot, TEXT, base, derivatives=derivatives, verify=False)

    return load(made_once(base / robot.name, make), "c")


@pytest.mark.slow
def test_it_does_not_push_against_servos(driven: ModuleType) -> None:
    wall = {"frame": "base", "point": [0, 0, 5], "normal": [0, 0, -1], "stiffness": 1000}
    force = {"value": 3, "direction": [0, 0, 1]}
    changes = {
        "control": {"law": "predictive", "force": force, "impedance": {"frame": "base"}},
        "wall": [wall],
    }
    with pytest.raises(UsageError, match=r"control\.force: .* servos drive .*; remove these"):
        simulate(driven, read_scenario("hover", changes))


@pytest.mark.slow
def test_what_servos_are_sent_costs_by_the_torque_that_it_makes(driven: ModuleType) -> None:
    """Of one tolerance a joint: servos of 30 N m/rad and 400 N/m, and a joint without one."""
    hover = trim(driven, posture_deg={"upper": 20.0, "wrist": 30.0})
    tolerances = Tolerances(joints=[0.3, 0.01, 0.2], effort=[2.0, 20.0, 1.0])
    smooth = {x: 0.0 for x in driven.PARAMETERS if x.endswith("_backlash")}
    controller = Predictive(
        driven,
        hover,
        {"tip": lambda t: np.tile([0.1, 0.0, -0.4], (len(t), 1))},
        parameters=smooth,
        tolerances=tolerances,
    )
    weights = controller._weights()
    efforts = np.array([30.0 / 2.0, 400.0 / 20.0, 1.0]) ** 2
    np.testing.assert_allclose(weights["inputs"][-3:], efforts, rtol=1e-9)
    np.testing.assert_allclose(weights["posture"][-3:], np.array([0.3, 0.01, 0.2]) ** -2.0)
    told = controller._compiled.arrays
    nv, first = len(driven.VELOCITIES), controller.vehicle.layout.v.joints.start
    right = np.zeros((len(hover.u), nv))
    right[[4, 5], [first, first + 1]] = -efforts[:2]
    np.testing.assert_allclose(told["across"][:, :nv], right, rtol=1e-9)


@pytest.mark.slow
def test_motors_and_servos_are_commanded_within_their_limits(driven: ModuleType) -> None:
    """A circle of the tip near to which joints without play and friction keep it, in the air."""
    hover = trim(driven, posture_deg={"upper": 20.0, "wrist": 30.0})
    hover.q[2] = 1.0  # Out of the effect of the ground, which a trim leaves out.
    start = tip_of(driven, hover.q)

    def circle(time: Any) -> Any:
        angle, radius = 2.0 * time, 0.1 * np.minimum(1.0, time / 2.0)
        return start + np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * time], -1)

    rough = [x for x in driven.PARAMETERS if x.endswith(("_coulomb", "_static", "_backlash"))]
    smooth = dict.fromkeys(rough, 0.0)
    controller = Predictive(driven, hover, {"tip": circle}, parameters=smooth, step=0.01)
    changes = {"duration": 5, "integration.method": "rk4", "plant": smooth}
    simulation = Simulation(driven, read_scenario("hover", changes))
    seen, missed, sent = simulation.reset(hover.q, 0.0 * hover.v), [], []
    while simulation.time < 4.0:
        sent.append(controller(seen))
        seen = simulation.step(sent[-1], controller.step)
        missed.append(tip_of(driven, simulation.q) - circle(np.array([simulation.time]))[0])
    assert simulation.stopped == ""
    assert all(instant.solved for instant in controller.log)
    assert np.linalg.norm(missed[-100:], axis=1).max() < 3e-3
    low, high = np.transpose(
        [driven.COMMAND_LIMITS.get(name, (-np.inf, np.inf)) for name in driven.COMMANDS]
    )
    assert np.all((sent >= low - 1e-9) & (sent <= high + 1e-9))


@pytest.mark.slow
def test_what_acts_is_foreseen_as_it_is_flown(kept: Path) -> None:
    """A step of the prediction is one of `Simulation`: wind, push, payload, wall and spin."""
    text, folder = (
        blown.TEXT.replace("time_constant         = 0.05", ""),
        kept / "foreseen" / "blown",
    )
    source = kept / "foreseen.toml"
    source.write_text(text, encoding="utf-8")
    derivatives = (*DERIVATIVES, *WITH_PAYLOADS)
    made_once(
        folder, lambda: generate(source, folder.parent, derivatives=derivatives, verify=False)
    )
    module, h = load(folder, "c"), 0.002
    q, v = np.array([0, 0, 1, 0, 0, 0, 1, 0.3]), np.array([0.5, 0, -0.2, 1, -2, 3, 0.5])
    tip = module.frame_poses(q)[module.FRAMES.index("tip"), :3, 3]
    keys = {
        "wind": {"velocity": [3.0, -1.0, 0.5], "drag": {"base": 0.4, "tip": 0.1}},
        "push": {"frame": "tip", "force": [1.0, 0.5, 0.2], "begin": 0, "end": 1},
        "payload": [
            {"frame": "base", "mass": 0.0},
            {"frame": "tip", "mass": 0.3, "end": 1},
            {"frame": "base", "mass": 0.2, "begin": 1},
        ],
        "wall": [{"kind": "floor", "frame": "tip", "height": tip[2] + 0.01, "stiffness": 300}],
        "integration": {"method": "rk4", "step": h, "rate": 1 / h},
    }
    scene, u = read_scenario("hover", keys), np.array([3.0, 3.2, 3.4, 3.1, 0.1])
    simulation = Simulation(module, scene)
    simulation.reset(q, v)
    simulation.advance(u, h)
    with pytest.raises(UsageError, match="walls: `surroundings` has this wall already"):
        Predictive(module, Rest(q, u), step=h, nodes=2, surroundings=scene, walls=scene.walls)
    controller = Predictive(module, Rest(q, u), step=h, nodes=2, surroundings=scene)
    given = inputs_of(controller, 0) | {"u": u, "x": np.r_[q, v], "x_next": np.r_[q, v], "h": h}
    gap = value(controller, controller.horizon.values(), given)["gap"]
    np.testing.assert_allclose(module.integrate(q, gap[:7]), simulation.q, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(v + gap[7:], simulation.v, rtol=0.0, atol=1e-8)
    alone = v + h * module.forward_dynamics(q, v, u)
    assert np.abs(alone - simulation.v).max() > 1e-3
    controller.inputs(1.5, q, v)  # Now the push and a payload are gone, and another is there.
    given["around"] = inputs_of(controller, 0)["around"]
    later = value(controller, controller.horizon.values(), given)
    assert np.abs(later["gap"] - gap)[7:].max() > 1e-4
