"""What moves, at random states of a made-up robot: closed loops, rollouts, FMUs and horizons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from arrays.test_surroundings import ball, touched
from support.made_up import STEP, Array, MadeUp, close

from gibbs_codegen.arrays import Functions, Program, evaluate, variable
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.machine.base import Motion, base_of
from gibbs_codegen.machine.closed_loop import AHEAD, LoopStructure
from gibbs_codegen.machine.contact import Contact
from gibbs_codegen.machine.laws import (
    LAWS,
    Aim,
    CentrePath,
    FrameAim,
    Gains,
    PushAim,
    Rotors,
    Weight,
    inputs_of,
    learning,
)
from gibbs_codegen.machine.machine import Surroundings

DRIVEN = {
    "COMMANDS": ("c1", "c2", "c3", "c4", "s1", "s2"),
    "ACTUATOR_STATES": ("w1", "w2", "w3", "w4", "p1"),
    "ROTOR_AIR": {"F_2": ("tip", 0.0, 0.6, 0.8, 0.03, 0.02, 0.0, 0.2, 0.0)},
}
HOLDING = {
    "CONSTRAINTS": ("hook", "rail"),
    "CONSTRAINT_ROWS": ("hook_x", "rail_y", "rail_z"),
    "PARAMETERS": {"mass": 1.5, "constraint_hook_frequency": 0.7, "gravity": 9.81},
}
CONTACTS = (Contact(1, 0, ball, 4, True), Contact(0, 1, ball, 4))
AROUND = Surroundings(
    pushes=True,
    wind=True,
    drag=True,
    gusts=2,
    contacts=CONTACTS,
    spins=((2, 1), (0, 0)),
    payloads=(1,),
)


def air(module: MadeUp, q: Array, v: Array, speeds: Array, wind: Array) -> Array:
    """Wrenches of the air on the one hub of `DRIVEN`."""
    found, (_, *figures) = np.zeros((2, 6), np.result_type(q, v)), DRIVEN["ROTOR_AIR"]["F_2"]
    axis = module.frame_poses(q)[1, :3, :3] @ figures[:3]
    moved, speed = (
        module.frame_velocities(q, v)[1, :3] - wind,
        speeds[1] * np.sign(np.real(speeds[1])),
    )
    found[1, :3] = (figures[3] - figures[4]) * speed * (axis @ moved) * axis - figures[
        3
    ] * speed * moved
    return found


class At(NamedTuple):
    """Unit coordinates, velocities, actuators, memory and bristles of a state."""

    q: Array
    v: Array
    actuators: Array
    memory: Array
    bristles: Array


class Loop:
    """A closed loop, random values of what it is given, and what it does by NumPy."""

    def __init__(
        self, attitude: str, law: str, lists: dict[str, Any], seed: int = 1, **options: Any
    ) -> None:
        self.module = MadeUp(attitude, **lists)
        # The law knows another robot than the one that flies.
        self.known = MadeUp(attitude, **lists)
        self.known.parameters = self.known.parameters * 1.1
        self.owners = {"plant": self.module, "model": self.known}
        self.spec = LoopStructure(self.module, law, 2, **options)
        self.random, self.law = np.random.default_rng(seed), law
        self.laws: dict[bool, Evaluator] = {}
        self.is_quaternion = attitude == "quaternion"
        self.joints = slice(6, 8) if self.is_quaternion else slice(3, 5)

    def externals(self) -> dict[str, Callable[..., Array]]:
        """What is written by hand: the desired motion, and allocation of a kind."""
        n = len(self.module.COORDINATES)
        start, rate, bend = np.random.default_rng(5).uniform(-0.7, 0.7, (3, n))
        start[6] += self.is_quaternion

        def desired(t: Any) -> Array:
            t = np.asarray(t)[..., None]
            return np.concatenate(
                [start + rate * t + bend * t * t, rate + 2.0 * bend * t, 2.0 * bend + 0.0 * t], -1
            )

        def centre(t: Any) -> Array:
            return np.concatenate([[1.0, t, 0.5], [0.2, 0.1, 0.1], [0.3, 0.1, 0.2]])

        def nearest(
            thrusts: Array, wrench: Array, columns: Array, least: Array, most: Array
        ) -> Array:
            return np.clip(thrusts, least, most) + 1e-3 * wrench[:4]

        return {
            "desired": desired,
            "centre": centre,
            "nearest_thrusts": nearest,
            "smallest_thrusts": lambda c, w: np.linalg.pinv(c.T) @ w,
            "force_axis": lambda c: c.sum(0)[:3],
        }

    def values(self, program: Program) -> dict[str, Array]:
        """Random inputs of a program of the loop."""
        given: dict[str, Array] = {
            n: self.random.uniform(0.2, 0.9, x.shape)
            for n, x in zip(program.names, program.inputs, strict=True)
        }
        for name in given:
            if name.startswith("least"):
                given[name] = given[name] - 1.0
            elif name == "gusts":
                given[name][:, 0] = -0.3
            elif name.startswith("wall"):
                given[name] = np.concatenate(
                    [[0.1, 50.0, 3.0, 0.4, 0.6, 40.0, 2.0], self.random.normal(size=3) * 0.3, [1.6]]
                )
            elif name in ("idle", "idling", "active"):
                given[name] = np.round(given[name])
        if "x" in given:
            q, v = self.module.state(self.random)
            given["x"][: q.size + 8] = np.concatenate([q, v])
            if self.is_quaternion:
                given["x"][3:7] *= 1.2
            given["x"][q.size + 8 :] -= 0.5
        return given

    def run(self, program: Program, given: dict[str, Any]) -> dict[str, Array]:
        """Outputs of a program."""
        return evaluate(program, given, self.owners, externals=self.externals())

    @property
    def remembers(self) -> int:
        """Numbers that the law remembers: of errors, and behind them of a frame that it moves."""
        return (8 + 3 * (self.spec.moved is not None)) * self.spec.integral

    def parts(self, x: Array) -> At:
        """A state, without the work."""
        n, actuators = (
            len(self.module.COORDINATES),
            5 if self.spec.plant.driven else 4 * self.spec.lags,
        )
        q, v, _, *rest = np.split(x, np.cumsum([n, 8, 1, actuators, self.remembers]))
        return At(self.unit(q), v, *rest)

    def curves(self, time: Any) -> tuple[Array, ...]:
        """Desired coordinates, velocities, accelerations, and the path of the centre of mass."""
        c = np.split(self.externals()["desired"](time), 3, -1)
        path = (
            np.split(self.externals()["centre"](time), 3) if self.spec.leans else [np.zeros(3)] * 3
        )
        if not self.is_quaternion:
            return (*c, *path)

        def moving(c: Array, rates: Array) -> tuple[Array, Array]:
            size = np.sqrt(np.sum(c[3:7] ** 2))
            unit, own = c.copy(), rates.copy()
            unit[3:7] = c[3:7] / size
            own[3:7] = rates[3:7] / size - c[3:7] * (c[3:7] @ rates[3:7]) / size**3
            moves = self.module._moves(unit)
            return unit, np.linalg.solve(moves.T @ moves, moves.T @ own)

        a = np.imag(moving(c[0] + 1j * STEP * c[1], c[1] + 1j * STEP * c[2])[1]) / STEP
        return (*moving(c[0], c[1]), a, *path)

    def asked(
        self, g: dict[str, Array], time: float, at: At, felt: Array, *, free: bool = False
    ) -> dict[str, Array]:
        """What the law wants, and errors that it integrates: it is known by `test_laws`."""
        if self.law in ("off", "held"):
            return {"u": g["held"] if self.law == "held" else np.zeros(6), "refused": np.zeros(())}
        given = {"q": at.q, "v": at.v, "felt": felt}
        given |= zip(("q_d", "v_d", "a_d", "p", "pv", "pa"), self.curves(time), strict=True)
        given |= {"memory": at.memory} if self.spec.integral else {}
        names = "stiffness damping integral mass axis weight known_centre distribution"
        names += " known_wrenches least_shared most_shared exact"
        own = {x for x in g if x in names.split() or x.startswith(("frame_", "push_"))}
        given |= {x: np.asarray(g[x]) for x in own}
        if self.law in LAWS and LAWS[self.law].pushes:
            begin, end, rise = (g[f"push_{x}"] for x in ("begin", "end", "rise"))
            shares = np.clip([(time - begin) / rise, (time - end) / rise], 0.0, 1.0)
            come, gone = shares * shares * (3.0 - 2.0 * shares)
            turn = np.eye(3) if self.spec.axes is None else self.known.frame_poses(at.q)[0, :3, :3]
            given |= {"share": come - gone, "turn": turn, "n": turn @ g["push_direction"]}
            given = {"push_integral": np.zeros(()), **given}
        if free not in self.laws:
            shapes = {x: np.shape(value) for x, value in given.items()}
            self.laws[free] = Evaluator(self.law_program(shapes, free), {"model": self.known})
        return self.laws[free](given, externals=self.externals())

    def law_program(self, shapes: dict[str, tuple[int, ...]], free: bool) -> Program:
        """The law as a program of inputs of such shapes, with or without limits of thrusts."""
        robot = Functions(self.known, "model")
        spaces = dict.fromkeys(("q", "q_d"), robot.space)
        n = {x: variable(x, *shape, space=spaces.get(x)) for x, shape in shapes.items()}
        gains = Gains(*(n.get(x) for x in ("stiffness", "damping", "integral")))
        names = ("known_centre", "distribution", "known_wrenches", "least_shared", "most_shared")
        s, own = self.spec, (n.get(x, n["q"]) for x in names)
        exact = n.get("exact", 0.0)
        rotors = Rotors(*own, s.shared and not free, False, s.refuses and not free, exact)
        aim = Aim(Motion(n["q_d"], n["v_d"], n["a_d"]), gains, n.get("memory"))
        if s.leans:
            weight = Weight(n["mass"], n["weight"], n["axis"])
            aim = replace(aim, path=CentrePath(n["p"], n["pv"], n["pa"]), weight=weight)
        if s.moved is not None:
            figures = (n[f"frame_{x}"] for x in ("stiffness", "damping", "inertia"))
            push, axes = None, None if s.axes is None else n["turn"]
            if LAWS[self.law].pushes:
                push = PushAim(n["n"], n["push_force"], n["share"], n["push_integral"], axes)
            aim = replace(aim, frame=FrameAim(s.moved, *figures, n["felt"], push))
        at, v = (n["q_d"], n["v_d"]) if self.law == "open_loop" else (n["q"], n["v"])
        if self.law == "open_loop":
            force = robot.inverse_dynamics(at, v, n["a_d"])
        else:
            force = LAWS[self.law].force(robot, at, v, aim)
        u, refused = inputs_of(robot, at, force, rotors)
        wrench = base_of(robot, at).wrench(n["known_centre"], force)
        outputs = {"u": u, "refused": refused, "wrench": wrench}
        outputs |= {"errors": learning(robot, n["q"], n["v"], aim)} if s.integral else {}
        return Program("law", tuple(n.values()), outputs)

    def touching(self, g: dict[str, Array], at: At) -> tuple[list[Any], Array]:
        """What contacts do, and wrenches of what touches frames."""
        found, wrenches = [], np.zeros((2, 6))
        poses = self.module.frame_poses(at.q)
        velocities = self.module.frame_velocities(at.q, at.v)
        for contact in self.spec.around.contacts:
            own, frame = at.bristles if contact.sticks else np.zeros(3), contact.frame
            moving = g[f"wall_{contact.wall}"], poses[frame], velocities[frame]
            found.append(touched(*moving, own, contact.sticks))
            wrenches[frame] += found[-1]["wrench"]
        return found, wrenches + (g["push"] if self.spec.around.pushes else 0.0)

    def motion(
        self, g: dict[str, Array], time: float, at: At, u: Array, aimed: Array
    ) -> dict[str, Any]:
        """Accelerations, wrenches, forces of constraints and power."""
        plant, around, (q, v, actuators, *_) = self.module, self.spec.around, at
        found, touching = self.touching(g, at)
        wrenches, poses = touching.copy(), plant.frame_poses(q)
        velocities = plant.frame_velocities(q, v)
        wind = np.zeros(3)
        has_air = self.spec.plant.driven and self.law != "off"
        if around.drag:
            wind = g["wind"].copy()
            for begin, lasting, *half in g.get("gusts", ()):
                share = np.clip((time - begin) / lasting, 0.0, 1.0)
                wind += (1.0 - np.cos(2.0 * np.pi * share)) * np.array(half)
            wrenches += g["drag"] * (np.concatenate([wind, np.zeros(3)]) - velocities)
        for (rotor, frame), spin in zip(around.spins, g.get("spins", ()), strict=False):
            size = spin[3] * np.sign(u[rotor]) * np.sqrt(abs(u[rotor]))
            axis = poses[frame, :3, :3] @ spin[:3]
            wrenches[frame, 3:] += np.cross(size * axis, velocities[frame, 3:])
        if has_air:
            wrenches += air(plant, q, v, plant.rotor_speeds(actuators, aimed), wind)
        if around.payloads:
            free = plant.forward_dynamics_with_wrenches(q, v, u, wrenches)
            j, mass = plant.frame_jacobians(q)[1, :3], g["payloads"][0]
            matrix = np.eye(3) / mass + j @ np.linalg.solve(plant.mass_matrix(q), j.T)
            falls = g["gravity"] - plant.frame_bias_accelerations(q, v)[1, :3] - j @ free
            wrenches[1, :3] += np.linalg.solve(matrix, falls)
        acts = around.acts or has_air
        free = plant.forward_dynamics(q, v, u)
        a = plant.forward_dynamics_with_wrenches(q, v, u, wrenches) if acts else free
        forces, more = np.zeros(0), 0.0
        if around.holds:
            pushed = a - free
            a, forces = plant.constrained_forward_dynamics(q, v, u, g["active"])
            if acts:
                after, impulses = plant.impact(q, pushed, g["active"], 0.0 * g["active"])
                a, forces = a + after, forces + impulses
            more = forces @ plant.constraint_jacobian(q) @ v
        turn, linear = plant.turns(q)[-1], velocities[0, :3]
        spin = turn.T @ velocities[0, 3:]
        levers, centre = g.get("wrenches", np.zeros((4, 6))), g.get("centre", np.zeros(3))
        twist = np.concatenate([turn.T @ linear + np.cross(spin, centre), spin])
        power = u[:4] @ levers @ twist + u[4:] @ v[self.joints] - g["losses"] @ (v * v)
        power += more + (np.sum(wrenches * velocities) if acts else 0.0)
        pairs = zip(found, around.contacts, strict=True)
        done = {"touching": touching, "contacts": found, "holding": forces, "power": power}
        done["bristles"] = [x["rate"] for x, contact in pairs if contact.sticks]
        return done | {"a": a, "wrenches": wrenches if acts else np.zeros((2, 6))}

    def commands(self, g: dict[str, Array], time: float, at: At) -> dict[str, Array]:
        """Inputs that are commanded, aimed for, and act, and refusal."""
        s, plant, (q, v, actuators, memory, _) = self.spec, self.module, at
        felt = self.touching(g, at)[1][s.moved] if s.moved is not None else np.zeros(6)
        found = self.asked(g, time, at, felt)
        wanted, refused = found["u"], found["refused"]
        limit = (lambda x: np.clip(x, g["least"], g["most"])) if s.limited else (lambda x: x)

        def sent_for(wanted: Array, time: float, q: Array, v: Array) -> Array:
            if not s.plant.driven or self.law in ("off", "held"):
                return wanted
            if self.law not in ("geometric_impedance", "geometric_force"):
                q, v = self.curves(time)[:2]
            return self.known.command_of(q, v, limit(wanted))

        def within(sent: Array) -> Array:
            if s.plant.driven and self.law != "off":
                return np.clip(sent, g["least_command"], g["most_command"])
            return limit(sent)

        def acting(aimed: Array) -> Array:
            if s.plant.driven and self.law != "off":
                return plant.inputs_of(q, v, actuators, aimed)
            if not s.lags:
                return aimed
            return np.concatenate([np.where(g["lag"] > 0.0, actuators, aimed[:4]), aimed[4:]])

        sent = sent_for(wanted, time, q, v)
        if s.plant.driven and self.law == "held":
            wanted = plant.inputs_of(q, v, plant.actuator_state_of(sent), sent)
        if s.compensates:
            ahead = -AHEAD if time > g["end"] - AHEAD else AHEAD
            aimed = within(sent)
            a = self.motion(g, time, at, acting(aimed), aimed)["a"]
            moved, own = self.unit(q + ahead * plant.coordinate_rates(q, v)), memory
            if s.integral:  # The integrals go on by what is not remembered yet.
                errors = self.asked(g, time, at._replace(memory=np.zeros(self.remembers)), felt)[
                    "errors"
                ]
                own = memory + ahead * errors
            free = self.asked(g, time, at, felt, free=True)["u"]
            later = At(moved, v + ahead * a, actuators, own, at.bristles)
            then = g, time + ahead, later, felt
            refused = refused + max(self.asked(*then)["refused"], 0.0)
            rates = (self.asked(*then, free=True)["u"] - free) / ahead
            turning, lag = rates, np.concatenate([g.get("lag", np.zeros(4)), np.zeros(2)])
            if s.plant.driven:
                change = limit(wanted) + ahead * rates, time + ahead, later.q, later.v
                turning = (sent_for(*change) - sent) / ahead
                lag = np.where(turning > 0.0, g["time_up"], g["time_down"])
            kept = np.ones(6)
            if s.limited or s.shared:
                lead, beyond = abs(lag * rates), abs(free - limit(wanted))
                lead[:4], beyond[:4] = lead[:4].max(), beyond[:4].max()
                less = np.maximum(1.0 - beyond / np.maximum(lead, 1e-12), 0.0)
                kept = np.where(beyond > 0.0, less, 1.0)
            sent = sent + kept * lag * turning
            wanted = wanted if s.plant.driven else sent
        aimed = within(sent)
        if s.idles and g["idle"] > 0.5:
            aimed = np.concatenate([g["idling"], aimed[4:]])
        both = {"commanded": wanted, "aimed": aimed, "acting": acting(aimed)}
        return both | {"refused": refused, "felt": felt}

    def unit(self, q: Array) -> Array:
        """Coordinates with a quaternion of unit length."""
        size = np.linalg.norm(q[3:7]) if self.is_quaternion else 1.0
        return np.concatenate([q[:3], q[3:7] / size, q[7:]])

    def rate(self, g: dict[str, Array], time: float, x: Array) -> Array:
        """The time derivative of a state."""
        s, plant, at = self.spec, self.module, self.parts(x)
        q, v, actuators, memory, _ = at
        found = self.commands(g, time, at)
        moved = self.motion(g, time, at, found["acting"], found["aimed"])
        rates = plant.coordinate_rates(q, v)
        if self.is_quaternion:  # Entries of any length keep it.
            rates = np.concatenate([rates[:3], rates[3:7] * np.linalg.norm(x[3:7]), rates[7:]])
        parts = [rates, moved["a"], [moved["power"]]]
        if s.plant.driven:
            own = plant.actuator_rates(actuators, found["aimed"])
            parts.append(own if self.law != "off" else np.zeros(5))
        elif s.lags:
            parts.append(g["pace"] * (found["aimed"][:4] - actuators))
        if s.integral:
            at = at._replace(memory=np.zeros(self.remembers))
            errors = self.asked(g, time, at, found["felt"])["errors"]
            parts.append(self.remembered(g, found, errors, memory))
        return np.concatenate([*parts, *moved["bristles"]])

    def remembered(
        self, g: dict[str, Array], found: dict[str, Array], errors: Array, memory: Array
    ) -> Array:
        """Errors, but none away from zero while an input is at a limit, nor while motors idle."""
        if self.spec.idles and g["idle"] > 0.5:
            errors = 0.0 * errors
        if not self.spec.limited:
            return errors
        wanted, margin = found["commanded"], g["margin"]
        inside = np.all((wanted > g["least"] + margin) & (wanted < g["most"] - margin))
        return errors if inside else np.where(errors * memory < 0.0, errors, 0.0)


# Attitude, law, what else the module lists, what is on, and what else there is.
CASES: dict[str, tuple[str, str, dict[str, Any], str, dict[str, Any]]] = {
    "all": ("zyx", "computed_torque", {}, "integral limited shared lags compensates idles refuses",
            {"around": AROUND}),
    "wide": ("quaternion", "computed_torque", {}, "integral lags compensates",
             {"around": Surroundings(wind=True, drag=True)}),
    "held": ("quaternion", "held", HOLDING, "lags",
             {"around": replace(AROUND, holds=True, payloads=())}),
    "free": ("quaternion", "open_loop", HOLDING, "limited", {"around": Surroundings(holds=True)}),
    "driven": ("zyx", "computed_torque", DRIVEN, "limited compensates integral",
               {"around": Surroundings(wind=True, drag=True, gusts=1)}),
    "driven_held": ("quaternion", "held", DRIVEN, "idles", {}),
    "off": ("zyx", "off", DRIVEN, "", {"around": Surroundings(pushes=True)}),
    "impedance": ("quaternion", "impedance", {}, "integral", {"moved": 1, "around": AROUND}),
    "force": ("zyx", "force", {}, "integral limited idles",
              {"moved": 1, "axes": 0, "around": AROUND}),
    "leaning": ("quaternion", "geometric", {}, "lags integral", {}),
    "leaning_force": ("zyx", "geometric_force", DRIVEN, "limited",
                      {"moved": 1, "around": Surroundings(contacts=CONTACTS)}),
}  # fmt: skip


def loop_of(name: str, seed: int = 1) -> Loop:
    attitude, law, lists, on, options = CASES[name]
    return Loop(attitude, law, lists, seed, **dict.fromkeys(on.split(), True), **options)


@pytest.mark.parametrize("name", CASES)
def test_rates_of_a_closed_loop(name: str) -> None:
    """And inputs, motion and law by themselves, within limits and at them."""
    for seed in (1, 3):
        loop = loop_of(name, seed)
        given = loop.values(loop.spec.slope())
        if seed == 3:
            given |= {x: 40.0 * y for x, y in given.items() if x.startswith(("least", "most"))}

        def run(program: Program, loop: Loop = loop, given: dict[str, Any] = given) -> Any:
            return loop.run(program, {name: given[name] for name in program.names})

        found, time, at = run(loop.spec.slope()), float(given["time"]), loop.parts(given["x"])
        # Differences over a short time are no better than rounding lets them be.
        rough = 1e-5 if loop.spec.compensates else 1e-11
        close(found["rate"], loop.rate(given, time, given["x"]), rough)
        wanted = loop.commands(given, time, at)
        close(found["refused"], wanted["refused"], rough)
        given |= at._asdict()
        for output, value in run(loop.spec.commands()).items():
            close(value, wanted[output], rough, output)
        given |= {"u": loop.random.normal(size=6), "aimed": wanted["aimed"], "felt": wanted["felt"]}
        right = loop.motion(given, time, at, given["u"], wanted["aimed"])
        motion = run(loop.spec.motion())
        for output in ("a", "wrenches", "touching"):
            close(motion[output], right[output], 1e-12, output)
        holding = right["holding"] if loop.spec.around.holds else np.zeros(0)
        close(motion["holding"], holding)
        rows = [[x[y] for y in ("normal", "friction", "slip", "depth")] for x in right["contacts"]]
        close(motion["contacts"], np.reshape([np.hstack(row) for row in rows], (-1, 8)), 1e-11)
        push = given["push"] if loop.spec.around.pushes else 0.0
        close(run(loop.spec.contact_wrenches())["wrenches"], right["touching"] - push)
        law = loop.asked(given, time, at, given["felt"])
        law |= {"wanted": law["u"]}
        if loop.spec.integral:
            commanded = {"commanded": law["u"]}
            law["growth"] = loop.remembered(given, commanded, law["errors"], at.memory)
        for output, value in run(loop.spec.command()).items():
            close(value, law[output], 1e-12, output)


@pytest.mark.parametrize("name", ["leaning", "free", "driven_held"])
def test_steps_of_a_closed_loop_are_those_of_runge_and_kutta(name: str) -> None:
    loop = loop_of(name)
    program = loop.spec.step()
    given = loop.values(program) | {"h": np.array(0.02)}
    found, x, t, h = loop.run(program, given), given["x"], float(given["time"]), 0.02
    k1 = loop.rate(given, t, x)
    k2 = loop.rate(given, t + h / 2, x + h / 2 * k1)
    k3 = loop.rate(given, t + h / 2, x + h / 2 * k2)
    after = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + loop.rate(given, t + h, x + h * k3))
    q, v, *_ = loop.parts(after)
    if name == "free":  # Rigid constraints keep velocities; of an elastic one errors go back.
        v = loop.module.impact(q, v, given["active"] * [0.0, 1.0], np.zeros(2))[0]
        after[q.size : q.size + 8] = v
    close(found["x_next"], after, 1e-10)
    begin = loop.commands(given, t, loop.parts(x))
    close(found["inputs"], np.concatenate([begin["commanded"], begin["acting"]]))
    robot = Functions(loop.known, "model")
    at, there = (
        Motion(robot.coordinates(f"q{x}"), *map(robot.velocities, (f"v{x}", f"a{x}")))
        for x in ("", "_d")
    )
    errors = base_of(robot, at.q).errors(at.v, there)
    inputs = (at.q, at.v, there.q, there.v, there.a)
    own = dict(zip(("q", "v", "q_d", "v_d", "a_d"), (q, v, *loop.curves(t + h)), strict=False))
    off = evaluate(Program("off", inputs, dict(zip("er", errors, strict=True))), own, loop.owners)
    beyond = np.abs(np.concatenate([off["e"], off["r"]])) - given["bounds"]
    close(found["ended"], np.max(beyond))
    alone = loop.spec.after()
    for output, value in loop.run(alone, {n: given[n] for n in alone.names}).items():
        close(value, found[output], 1e-12, output)


def test_a_step_ends_a_flight_that_leans_too_far() -> None:
    loop = loop_of("off")
    program = loop.spec.step()
    given = loop.values(program)
    given |= {"h": np.array(1e-3), "bounds": np.full(16, 99.0), "largest_lean": np.array(0.1)}
    found = loop.run(program, given)
    close(found["ended"], abs(found["x_next"][1]) - 0.1)


def test_what_accelerations_need() -> None:
    loop = loop_of("wide")
    program = loop.spec.required()
    given = loop.values(program)
    given["q"], given["v"] = loop.module.state(loop.random)
    found = loop.run(program, given)
    force = loop.known.inverse_dynamics(given["q"], given["v"], given["a"])
    wrench = np.concatenate([force[:3], force[3:6] - np.cross(given["known_centre"], force[:3])])
    close(found["wrench"], wrench)
    close(found["wanted"], np.concatenate([given["distribution"] @ wrench, force[6:]]))
