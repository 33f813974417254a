"""What acts on a robot and what sensors read, at random states, by formulas of NumPy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.made_up import Array, MadeUp, close

from gibbs_codegen.arrays import Functions, Node, Program, evaluate, join, nodes, variable
from gibbs_codegen.machine.contact import Contact, bristle_parts, bristles_of, touch
from gibbs_codegen.machine.impacts import effects, gains, passive
from gibbs_codegen.machine.sensors import Channel, SensorAt, measurement_program, reading_program
from gibbs_codegen.machine.state import State
from gibbs_codegen.machine.surroundings import (
    air_on_rotors,
    drag,
    on_frames,
    payload_forces,
    spin_torque,
    wind_velocity,
)

COUNT = 12
AIR = {
    "F_1": ("tip", 0.6, 0.0, 0.8, 0.03, 0.02, 0.4, 0.2, 1.0, -0.1, 1.3, 0.0, 1.0, 0.2, 0.4),
    "F_3": ("base", 0.0, 0.0, 1.0, 0.05, 0.01, 0.0, 0.3, 1.0),
    "F_4": ("base", 0.0, 1.0, 0.0, 0.02, 0.02, 0.1, 0.1, 0.0, -0.5, 2.0, 0.5, 0.5),
    "F_2": ("tip", 0.0, -1.0, 0.0, 0.02, 0.05, 0.0, 0.1, 0.0),
}


def given(**shapes: tuple[int, ...]) -> tuple[dict[str, Node], dict[str, Array]]:
    """Inputs, and random values of many states."""
    random = np.random.default_rng(3)
    values = {name: random.uniform(-1.0, 1.0, (COUNT, *shape)) for name, shape in shapes.items()}
    return {name: variable(name, *shape) for name, shape in shapes.items()}, values


def each(values: dict[str, Array]) -> list[dict[str, Array]]:
    return [{name: x[k] for name, x in values.items()} for k in range(COUNT)]


def moving(attitude: str, **lists: Any) -> tuple[MadeUp, Functions, dict[str, Array]]:
    """A robot in many random states."""
    module = MadeUp(attitude, **lists)
    q, v = module.state(np.random.default_rng(2), COUNT)
    return module, Functions(module), {"q": q, "v": v}


@pytest.mark.parametrize("attitude", ["zyx", "quaternion"])
def test_wind_drag_and_spin(attitude: str) -> None:
    module, robot, state = moving(attitude)
    own, values = given(
        time=(), steady=(3,), gusts=(2, 5), drags=(2, 6), axis=(3,), momentum=(), thrust=()
    )
    values["gusts"][..., 1] = 0.4
    q, v = robot.state()
    wind = wind_velocity(own["time"], own["steady"], own["gusts"])
    velocities = robot.frame_velocities(q, v)
    spun = spin_torque(
        own["axis"], own["momentum"], own["thrust"], robot.frame_poses(q)[1], velocities[1]
    )
    outputs = {"wind": wind, "drag": drag(own["drags"], wind, velocities), "spun": spun}
    found = evaluate(
        Program("p", (q, v, *own.values()), outputs), state | values, {"robot": module}
    )
    begun = set()
    for k, x in enumerate(each(state | values)):
        air = x["steady"].copy()
        for begin, lasting, *half in x["gusts"]:
            passed = (x["time"] - begin) / lasting
            begun.add(np.clip(np.floor(passed), -1.0, 1.0))
            if 0.0 < passed < 1.0:
                air += 2.0 * np.sin(np.pi * passed) ** 2 * np.array(half)
        velocity = module.frame_velocities(x["q"], x["v"])
        close(found["wind"][k], air)
        close(found["drag"][k], x["drags"] * (np.concatenate([air, np.zeros(3)]) - velocity))
        size = x["momentum"] * np.sign(x["thrust"]) * np.sqrt(abs(x["thrust"]))
        axis = module.frame_poses(x["q"])[1, :3, :3] @ x["axis"]
        close(found["spun"][k], np.cross(size * axis, velocity[1, 3:]))
    assert begun == {-1.0, 0.0, 1.0}


@pytest.mark.parametrize("attitude", ["zyx", "quaternion"])
def test_air_on_rotors(attitude: str) -> None:
    """Drag across the axis, inflow, lift, the table of advance ratios, and the ground."""
    module, robot, state = moving(attitude, ROTOR_AIR=AIR)
    own, values = given(speeds=(4,), u=(6,), wind=(3,))
    values["speeds"] *= 40.0
    values["speeds"][0] = 0.0
    q, v = robot.state()
    places = robot.frame_poses(q), robot.frame_velocities(q, v)
    parts = air_on_rotors(robot, places, own["speeds"], own["u"], own["wind"])
    assert [frame for frame, _ in parts] == [1, 0, 0, 1]
    outputs = {"all": on_frames(parts, 2)} | {f"of_{k}": x for k, (_, x) in enumerate(parts)}
    found = evaluate(
        Program("p", (q, v, *own.values()), outputs), state | values, {"robot": module}
    )
    for k, x in enumerate(each(state | values)):
        poses, velocities = module.frame_poses(x["q"]), module.frame_velocities(x["q"], x["v"])
        whole = np.zeros((2, 6))
        for rotor, (name, (hub, *air)) in enumerate(AIR.items()):
            frame, number = module.FRAMES.index(hub), module.INPUTS.index(name)
            dragged, inflow, lift, radius, ground, *pairs = air[3:]
            axis = poses[frame, :3, :3] @ air[:3]
            velocity = velocities[frame, :3] - x["wind"]
            speed, along = abs(x["speeds"][number]), axis @ velocity
            across = velocity - along * axis
            factor = 1.0
            if pairs:
                factor = np.interp(along / max(speed * radius, 1e-6), pairs[::2], pairs[1::2])
            if ground:
                height = max(poses[frame, 2, 3], radius / 2.0)
                factor /= 1.0 - (radius / (4.0 * height)) ** 2
            push = -dragged * speed * across - inflow * speed * along * axis
            push += (lift * across @ across + (factor - 1.0) * x["u"][number]) * axis
            close(found[f"of_{rotor}"][k], np.concatenate([push, np.zeros(3)]))
            whole[frame, :3] += push
        close(found["all"][k], whole)


@pytest.mark.parametrize("attitude", ["zyx", "quaternion"])
def test_payloads_are_masses_that_move_with_their_frames(attitude: str) -> None:
    module, robot, state = moving(attitude)
    own, values = given(u=(6,), W=(2, 6), masses=(2,), gravity=(3,))
    values["masses"] = np.abs(values["masses"])
    (q, v), frames = robot.state(), (1, 0)
    found = payload_forces(robot, (q, v, own["u"]), own["W"], frames, own["masses"], own["gravity"])
    program = Program("p", (q, v, *own.values()), {"forces": join(*found)})
    forces = evaluate(program, state | values, {"robot": module})["forces"]
    for k, x in enumerate(each(state | values)):
        free = module.forward_dynamics_with_wrenches(x["q"], x["v"], x["u"], x["W"])
        matrix, jacobians = module.mass_matrix(x["q"]), module.frame_jacobians(x["q"])
        bias = module.frame_bias_accelerations(x["q"], x["v"])
        whole, right = matrix.copy(), matrix @ free
        for frame, mass in zip(frames, x["masses"], strict=True):
            j, c = jacobians[frame, :3], bias[frame, :3]
            whole += mass * j.T @ j
            right += mass * j.T @ (x["gravity"] - c)
        a = np.linalg.solve(whole, right)
        wanted = [
            m * (x["gravity"] - bias[f, :3] - jacobians[f, :3] @ a)
            for f, m in zip(frames, x["masses"], strict=True)
        ]
        close(forces[k], np.concatenate(wanted), 1e-10)


def ball(figures: Any, place: Any) -> tuple[Any, Any]:
    """A wall about a point: how deep a place is in it, and its normal there."""
    away = place - figures[:3]
    size = nodes.square_root(nodes.dot(away, away))
    return figures[3] - size, away / size


WALL = {
    "radius": 0.1,
    "stiffness": 50.0,
    "damping": 3.0,
    "dissipation": 0.4,
    "friction": 0.6,
    "holds": 40.0,
    "eases": 2.0,
}


def touched(
    wall: Array, pose: Array, velocity: Array, bristle: Array, sticks: bool
) -> dict[str, Any]:
    """A contact as the head of `arrays/contact.py` says it."""
    radius, stiffness, damping, dissipation, friction, s, g = wall[:7]
    away = pose[:3, 3] - wall[7:10]
    normal = away / np.linalg.norm(away)
    deep = wall[10] - np.linalg.norm(away) + radius
    inwards = -normal @ velocity[:3]
    force = 0.0
    if deep > 0.0:
        force = max(stiffness * deep * (1.0 + dissipation * inwards) + damping * inwards, 0.0)
    point = velocity[:3] + np.cross(velocity[3:], -radius * normal)
    sliding = point - (normal @ point) * normal
    tangent = np.eye(3) - np.outer(normal, normal)
    held = tangent @ bristle
    found = {"normal": force, "direction": normal, "depth": deep}
    spring = 0.5 * stiffness * max(deep, 0.0) ** 2
    found["eased"] = max(force - stiffness * max(deep, 0.0), 0.0)
    none, kind = np.zeros(3), "free"
    if not sticks:
        own = {
            "friction": none,
            "rate": none,
            "slip": sliding if force > 0.0 else none,
            "stored": spring,
        }
        return found | own | {"wrench": np.concatenate([force * normal, none]), "kind": kind}
    pull, most = s * held + g * sliding, friction * force
    slip, pushed, kind = none, -pull, "sticks"
    if np.linalg.norm(pull) > most:
        slip, kind = (1.0 - most / np.linalg.norm(pull)) * pull / g, "slides" if force else "free"
        pushed = -most * pull / np.linalg.norm(pull)
    found |= {"friction": pushed, "rate": sliding - slip - s / g * (bristle - held)}
    found |= {"slip": slip if force > 0.0 else none, "stored": spring + 0.5 * s * bristle @ bristle}
    torque = np.cross(-radius * normal, pushed)
    return found | {"wrench": np.concatenate([force * normal + pushed, torque]), "kind": kind}


@pytest.mark.parametrize("sticks", [True, False])
def test_contact(sticks: bool) -> None:
    module, robot, state = moving("quaternion")
    contact = Contact(1, 0, ball, 4, sticks)
    own, values = given(bristle=(3,), centre=(3,))
    values["bristle"] *= 0.03
    random = np.random.default_rng(8)
    tips = module.frame_poses(state["q"])[:, 1, :3, 3]
    figures = np.tile([*WALL.values()], (COUNT, 1))
    figures[:, 5:7] *= random.choice([0.2, 3.0], (COUNT, 1))
    reach = random.uniform(0.3, 0.9, COUNT)
    walls = np.concatenate([figures, tips + 0.4 * values.pop("centre"), reach[:, None]], 1)
    walls[:2, 10] = -1.0  # In the air.
    walls[2, 1:4] = 1.0, 9.0, 9.0  # What moves out of it so fast is not held.
    q, v = robot.state()
    wall = variable("wall", 11)
    found = touch(
        contact, wall, (robot.frame_poses(q)[1], robot.frame_velocities(q, v)[1]), own["bristle"]
    )
    outputs = found._asdict() | {"series": found.series}
    program = Program("p", (q, v, wall, own["bristle"]), outputs)
    values |= {"wall": walls, **state}
    results, kinds = evaluate(program, values, {"robot": module}), set()
    for k, x in enumerate(each(values)):
        pose, velocity = (
            f(*a)[1]
            for f, a in (
                (module.frame_poses, [x["q"]]),
                (module.frame_velocities, [x["q"], x["v"]]),
            )
        )
        wanted = touched(x["wall"], pose, velocity, x["bristle"], sticks)
        kinds.add((wanted.pop("kind"), wanted["normal"] > 0.0, wanted["eased"] > 0.0))
        for name, right in wanted.items():
            close(results[name][k] if results[name].shape[:1] == (COUNT,) else results[name], right)
        rows = [wanted[name] for name in ("normal", "friction", "slip", "depth")]
        close(results["series"][k], np.concatenate([np.atleast_1d(row) for row in rows]))
    assert len(kinds) >= (5 if sticks else 3), kinds
    contacts = (contact, Contact(0, 0, ball, 4), Contact(1, 1, ball, 4, True))
    bristles = variable("z", bristles_of(contacts))
    assert bristles.size == (6 if sticks else 3)
    parts = bristle_parts(contacts, bristles)
    zero = nodes.zeros(3)
    assert parts == ([bristles[:3], zero, bristles[3:]] if sticks else [zero, zero, bristles])


End = tuple[Array, Array, Any]


def given_back(
    module: MadeUp, ends: tuple[End, End], work: Any, done: Array, active: Array | None
) -> tuple[Array, Array, tuple[bool, bool]]:
    """Coordinates and velocities after a step, without the energy that two contacts gained.

    `ends` are coordinates, velocities and what contacts have stored before and after it.
    """
    before, after = (
        module.kinetic_energy(q, v) + module.potential_energy(q) + stored for q, v, stored in ends
    )
    gained, (q, v, _), still, none = after - before - work, ends[1], np.zeros(8), np.zeros(6)
    impulses = np.stack([done[9:15], done[3:9]])
    if ends[0][2] + ends[1][2] + np.sum(impulses**2) <= 0.0:
        gained = 0.0  # Nothing touched.
    change = module.forward_dynamics_with_wrenches(q, still, none, impulses)
    change = change - module.forward_dynamics(q, still, none)
    if active is not None:
        change = module.impact(q, change, active, 0.0 * active)[0]
    speed, yielding = (np.sum(impulses * module.frame_velocities(q, x)) for x in (v, change))
    most, taken = 0.5 * speed**2 / max(yielding, 1e-30), 0.0
    if gained > 0.0:
        taken = min(gained + done[1] / max(done[2], 1e-30) * most, most)
    # Of both shares that take so much, the lesser: they solve a quadratic equation.
    root = np.sqrt(max(speed**2 - 2.0 * taken * yielding, 0.0))
    left = v - 2.0 * taken / max(abs(speed) + root, 1e-30) * np.sign(speed) * change
    moving = max(module.kinetic_energy(q, left), 1e-30)
    stays = gained - taken - moving > 0.0
    rest = min(max(gained - taken, 0.0) / moving, 1.0)
    return ends[0][0] if stays else q, np.sqrt(1.0 - rest) * left, (gained > 0.0, stays)


@pytest.mark.parametrize("holds", [True, False])
@pytest.mark.parametrize("scale", [1.0, -3.0, 40.0])
def test_steps_give_back_what_contacts_gained(scale: float, holds: bool) -> None:
    """By what they did, then by all velocities; where that is not enough, they do not happen."""
    module, robot, state = moving("quaternion", CONSTRAINTS=("hook",), CONSTRAINT_ROWS=("hook_x",))
    contacts = (Contact(1, 0, ball, 4, True), Contact(0, 1, ball, 4))
    own, values = given(work=(), done=(15,), active=(1,), z=(3,))
    values |= state | {"q_after": state["q"][::-1], "v_after": state["v"][::-1]}
    values["work"] *= scale
    q, v = robot.state()
    q_after, v_after = robot.coordinates("q_after"), robot.velocities("v_after")

    def touches(state: State[Node]) -> Any:
        energy = nodes.dot(state.v, state.v) * 0.1 + state.bristles[0]
        return [SimpleNamespace(stored=x * energy) for x in (1.0, 2.0)]

    none, around = (nodes.zeros(0),) * 3, SimpleNamespace(contacts=contacts)
    states = (State(q, v, *none, own["z"]), State(q_after, v_after, *none, 2.0 * own["z"]))
    active = own["active"] if holds else None
    machine: Any = SimpleNamespace(robot=robot, around=around, active=active, touches=touches)
    found = passive(machine, states, own["work"], own["done"])
    inputs, outputs = (q, v, q_after, v_after, *own.values()), dict(zip("qv", found, strict=True))
    results, kinds = evaluate(Program("p", inputs, outputs), values, {"robot": module}), set()
    for k, x in enumerate(each(values)):
        before = x["q"], x["v"], 3.0 * (0.1 * x["v"] @ x["v"] + x["z"][0])
        after = x["v_after"] @ x["v_after"]
        after = x["q_after"], x["v_after"], 3.0 * (0.1 * after + 2.0 * x["z"][0])
        ends, held = (before, after), x["active"] if holds else None
        place, left, kind = given_back(module, ends, x["work"], x["done"], held)
        kinds.add(kind)
        close(results["q"][k], place)
        close(results["v"][k], left, 1e-9)
    assert len(kinds) > (scale > 1.0)


def test_effects_are_power_and_forces_of_contacts() -> None:
    parts = {"twists": (2, 6), "wrenches": (2, 6), "eased": (2,), "normal": (2,)}
    own, values = given(**parts, mean=(4,), force=(4,))
    touches: list[Any] = [
        SimpleNamespace(wrench=own["wrenches"][k], eased=own["eased"][k], normal=own["normal"][k])
        for k in range(2)
    ]
    contacts = (Contact(1, 0, ball, 4, True), Contact(0, 1, ball, 4))
    robot = SimpleNamespace(
        frame_velocities=lambda q, v: own["twists"], inverse_dynamics=lambda q, v, a: own["force"]
    )
    machine: Any = SimpleNamespace(robot=robot, around=SimpleNamespace(contacts=contacts))
    state: Any = State(*[None] * 6)
    rates: Any = SimpleNamespace(a=None, touches=touches)
    outputs = {"e": effects(machine, state, touches)}
    outputs["g"] = gains(machine, state, rates, own["mean"])
    found = evaluate(Program("p", tuple(own.values()), outputs), values, {})
    for k, x in enumerate(each(values)):
        sums = [np.sum(x["wrenches"] * x["twists"][::-1]), x["eased"].sum(), x["normal"].sum()]
        done = np.concatenate([sums, x["wrenches"].ravel()])
        close(found["e"][k], done)
        close(found["g"][k], np.concatenate([[x["mean"] @ x["force"] - sums[0]], done]))


@pytest.mark.parametrize("attitude", ["zyx", "quaternion"])
def test_sensors(attitude: str) -> None:
    module, robot, state = moving(attitude)
    _, values = given(a=(8,), wrenches=(2, 6), gravity=(3,))
    kinds = {
        "imu": (),
        "barometer": (120.0,),
        "magnetometer": (0.3, -0.2, 0.9),
        "gps": (),
        "encoders": (),
        "wrench": (),
    }
    devices = [SensorAt(kind, 1, figures) for kind, figures in kinds.items()]
    program = measurement_program(robot, [*devices, SensorAt("imu", 0, ())])
    found = evaluate(program, state | values, {"robot": module})["measured"]
    for k, x in enumerate(each(state | values)):
        pose, velocity = module.frame_poses(x["q"])[1], module.frame_velocities(x["q"], x["v"])
        axes, joints = pose[:3, :3].T, slice(7, 9) if attitude == "quaternion" else slice(3, 5)

        def felt(
            frame: int, turn: Array, x: dict[str, Array] = x, velocity: Array = velocity
        ) -> Array:
            jacobian, bias = (
                module.frame_jacobians(x["q"])[frame],
                module.frame_bias_accelerations(x["q"], x["v"])[frame],
            )
            force = jacobian[:3] @ x["a"] + bias[:3] - x["gravity"]
            return np.concatenate([turn @ force, turn @ velocity[frame, 3:]])

        wanted = [
            felt(1, axes),
            [pose[2, 3] + 120.0],
            axes @ kinds["magnetometer"],
            pose[:3, 3],
            velocity[1, :3],
        ]
        wanted += [x["q"][joints], axes @ x["wrenches"][1, :3], axes @ x["wrenches"][1, 3:]]
        wanted.append(felt(0, module.turns(x["q"])[-1].T))
        close(found[k], np.concatenate(wanted))


def test_readings_err_as_their_channels_say() -> None:
    channels = [
        Channel(("a", "b"), ("m", "m"), (0.1, 0.3), 0.2, (0.5, -0.5), 0.7),
        Channel(("c",), ("m",), (2.0,)),
        Channel(("d", "e"), ("m", "m"), (0.4,), 1.5, (-0.1,)),
    ]
    _, values = given(measured=(5,), white=(5,), walk=(5,))
    found = evaluate(reading_program(channels), values, {})["reading"]
    bias, walk, noise = (
        [0.5, -0.5, 0.0, -0.1, -0.1],
        [0.2, 0.2, 0.0, 1.5, 1.5],
        [0.1, 0.3, 2.0, 0.4, 0.4],
    )
    wanted = values["measured"] + bias + walk * values["walk"] + noise * values["white"]
    wanted[:, :2] = np.clip(wanted[:, :2], -0.7, 0.7)
    assert np.abs(wanted[:, :2]).max() == 0.7
    close(found, wanted)
