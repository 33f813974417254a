"""The base of a robot in programs, at random states: by rotations, powers and rates of both."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.made_up import STEP, Array, MadeUp

from gibbs_codegen.arrays import Functions, Node, Program, evaluate, join, variable
from gibbs_codegen.machine.base import (
    Motion,
    base_of,
    length,
    placed,
    pose_motion,
    unit_entries,
)

ROOTS = ("xyz", "zyx", "yxz", "quaternion")


class State:
    """A random state, and what its base is and does, by NumPy alone."""

    def __init__(self, attitude: str, seed: int = 1) -> None:
        self.module, random = MadeUp(attitude), np.random.default_rng(seed)
        self.is_quaternion = attitude == "quaternion"
        self.places = slice(3, 6) if self.is_quaternion else slice(0, 3)
        self.lines = slice(0, 3) if self.is_quaternion else slice(5, 8)
        self.joints = slice(6, 8) if self.is_quaternion else slice(3, 5)
        self.given: dict[str, Array] = {}
        for name in ("", "_d"):
            q, v = self.module.state(random)
            self.given |= {f"q{name}": q, f"v{name}": v, f"a{name}": random.normal(size=8)}
        self.given |= {name: random.normal(size=3) for name in ("x", "centre")}
        self.given["f"] = random.normal(size=8)

    def twist(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Velocity of the origin and angular velocity, world axes."""
        velocity = self.module.frame_velocities(q, v)[0]
        return velocity[:3], velocity[3:]

    def along(self, function: Callable[[Array, Array], Array], end: str = "") -> Array:
        """The rate of what depends on q and v, by the velocities and accelerations there."""
        q, v, a = (self.given[name + end] for name in "qva")
        moved = q + 1j * STEP * self.module.coordinate_rates(q, v), v + 1j * STEP * a
        found: Array = np.imag(function(*moved)) / STEP
        return found

    def turn(self, q: Array) -> Array:
        """The rotation of the base."""
        found: Array = self.module.turns(q)[-1]
        return found

    def evaluated(self, build: Callable[..., dict[str, Any]]) -> dict[str, Array]:
        """Results of a program that is built of the robot, its base and the inputs."""
        robot = Functions(self.module)
        q, v = robot.state()
        desired = Motion(robot.coordinates("q_d"), robot.velocities("v_d"), robot.velocities("a_d"))
        own = {name: variable(name, *self.given[name].shape) for name in ("a", "x", "centre", "f")}
        outputs = build(robot, base_of(robot, q), v, desired, **own)
        inputs = (q, v, desired.q, desired.v, desired.a, *own.values())
        found = evaluate(Program("p", inputs, outputs), self.given, {"robot": self.module})
        return {name: np.asarray(x) for name, x in found.items()}


@pytest.mark.parametrize("attitude", ROOTS)
def test_base(attitude: str) -> None:
    state = State(attitude)

    def build(
        robot: Functions,
        base: Any,
        v: Node,
        desired: Motion,
        a: Node,
        x: Node,
        centre: Node,
        f: Node,
    ) -> dict[str, Node]:
        spin, growth = base.angular(v, a)
        error, rate = base.errors(v, desired)
        return {
            "world": base.to_world(x),
            "base": base.to_base(x),
            "spin": spin,
            "growth": growth,
            "entries": placed(robot, base.attitude_entries(v, growth), x, f[:2]),
            "twist": base.twist(centre, v),
            "wrench": base.wrench(centre, f),
            "error": error,
            "rate": rate,
            "corrected": base.corrected(v, desired, f),
            "length": length(x),
        }

    found, given, module = state.evaluated(build), state.given, state.module
    q, v, a, x, centre, f = (given[name] for name in ("q", "v", "a", "x", "centre", "f"))
    turn, (linear, spin) = state.turn(q), state.twist(q, v)
    growth = state.along(lambda q, v: state.turn(q).T @ state.twist(q, v)[1])
    angular = growth if not state.is_quaternion else a[3:6]
    wanted = {
        "world": turn @ x,
        "base": turn.T @ x,
        "spin": turn.T @ spin,
        "growth": angular,
        "twist": np.concatenate([turn.T @ (linear + np.cross(spin, turn @ centre)), turn.T @ spin]),
        "length": np.linalg.norm(x),
    }
    wanted["entries"] = np.zeros(8)
    wanted["entries"][state.places], wanted["entries"][state.lines] = a[state.places], x
    wanted["entries"][state.joints] = f[:2]
    columns = [
        np.concatenate([turn.T @ (p + np.cross(w, turn @ centre)), turn.T @ w])
        for p, w in (state.twist(q, unit) for unit in np.eye(8))
    ]
    # Whatever the velocity, the wrench does the work of the force on the base.
    base = [*range(8)[state.lines], *range(8)[state.places]]
    wanted["wrench"] = np.linalg.solve(np.stack(columns)[base], f[base])
    q_d, v_d = given["q_d"], given["v_d"]
    if not state.is_quaternion:
        wanted |= {"error": q_d - q, "rate": v_d - v, "corrected": given["a_d"] + f}
    else:
        linear_d, spin_d = state.twist(q_d, v_d)
        turned = module.difference(q, q_d)[3:6]
        wanted["error"] = np.concatenate([q_d[:3] - q[:3], turned, q_d[7:] - q[7:]])
        drift = turn.T @ spin_d - v[3:6]
        wanted["rate"] = np.concatenate([linear_d - linear, drift, v_d[6:] - v[6:]])
        # The base speeds up in the world as what is desired does, and by the force besides.
        away = state.along(lambda q, v: state.twist(q, v)[0], "_d") + f[:3]
        own = turn.T @ away - np.cross(v[3:6], v[:3])
        about = turn.T @ state.along(lambda q, v: state.twist(q, v)[1], "_d") - np.cross(
            v[3:6], turn.T @ spin_d
        )
        wanted["corrected"] = np.concatenate([own, about + f[3:6], given["a_d"][6:] + f[6:]])
    for name, right in wanted.items():
        np.testing.assert_allclose(found[name], right, rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("attitude", ROOTS[2:])
def test_rates_and_unit_entries_bear_a_quaternion_of_any_length(attitude: str) -> None:
    state = State(attitude)
    q, v = state.given["q"], state.given["v"]
    entries = q.copy()
    if state.is_quaternion:
        entries[3:7] *= 1.3
    robot = Functions(state.module)
    c, rates, growth = (variable(name, q.size) for name in ("c", "rates", "growth"))
    outputs = {"rates": base_of(robot, robot.coordinates()).rates(robot.velocities(), c)}
    outputs["unit"] = unit_entries(robot, c)
    if state.is_quaternion:
        outputs["motion"] = join(*pose_motion(robot, c, rates, growth))
    program = Program("p", (robot.coordinates(), robot.velocities(), c, rates, growth), outputs)
    random = np.random.default_rng(4)
    given = {
        "q": q,
        "v": v,
        "c": entries,
        "rates": random.normal(size=q.size),
        "growth": random.normal(size=q.size),
    }
    found = evaluate(program, given, {"robot": state.module})
    wanted = state.module.coordinate_rates(q, v)
    wanted = (
        np.concatenate([wanted[:3], 1.3 * wanted[3:7], wanted[7:]]) if state.is_quaternion else v
    )
    np.testing.assert_allclose(found["rates"], wanted, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found["unit"], q, rtol=0, atol=1e-14)
    if not state.is_quaternion:
        return

    def moving(c: Array, rates: Array) -> tuple[Array, Array]:
        """Unit coordinates and velocities of entries of any length and their rates."""
        size = np.sqrt(np.sum(c[3:7] ** 2))
        unit = np.concatenate([c[:3], c[3:7] / size, c[7:]])
        own = rates.copy()
        own[3:7] = rates[3:7] / size - c[3:7] * (c[3:7] @ rates[3:7]) / size**3
        moves = state.module._moves(unit)
        return unit, np.linalg.solve(moves.T @ moves, moves.T @ own)

    unit, velocity = moving(given["c"], given["rates"])
    ahead = (given[x] + 1j * STEP * given[y] for x, y in (("c", "rates"), ("rates", "growth")))
    right = np.concatenate([unit, velocity, np.imag(moving(*ahead)[1]) / STEP])
    np.testing.assert_allclose(found["motion"], right, rtol=0, atol=1e-12)
