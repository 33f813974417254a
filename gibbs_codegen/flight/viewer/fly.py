"""A page on which a robot flies by its own emitted C and law, and is dragged, pulled and loaded."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
from itertools import product
from types import ModuleType
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize

from gibbs_codegen.files.templating import render
from gibbs_codegen.flight.analysis.linear_model import lqr
from gibbs_codegen.flight.analysis.trim import trim
from gibbs_codegen.flight.desired.posture import authority_posture
from gibbs_codegen.flight.record.series import Array
from gibbs_codegen.flight.sweeps.sources import flown_module
from gibbs_codegen.flight.viewer.machine import DrawnMachine, joint_points, rotor_radius
from gibbs_codegen.flight.viewer.page import ViewPage
from gibbs_codegen.machine.base import RETURN
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.runtime.web import web_files

# What the page calls.
FUNCTIONS = (
    *("integrate", "difference", "forward_dynamics_with_wrenches", "positions", "frame_poses"),
    "joint_wrenches_with_wrenches",
)
_OF_LEANING = ("centre_of_mass", "centre_of_mass_jacobian")
# Stiffness, 1/s², and damping, 1/s, of attitude, position and joints: of a base that leans, of one
# that need not, and of one that is held.
_LEANING = ((100.0, 20.0), (4.0, 4.0), (64.0, 16.0))
_FULL = ((36.0, 12.0), (9.0, 6.0), (36.0, 12.0))
# How fast the reference follows what is dragged, 1/s; how far joints and attitudes go, rad, and
# under the regulator.
_RATE, _TURN, _LEAN, _NEAR = 3.0, 2.6, 0.5, 0.1
# What the regulator takes for the size of inputs that there are not; where joints end that nothing
# limits, rad or m.
_NONE, _FAR = 1e-2, 1e3
# Period of the law on the page, s.
_PERIOD = 1e-3
# Share of the mass below which a body has no slider; how many have one, and how far it goes; the
# share of the inputs' limits that balance may take.
_LIGHT, _SLIDERS, _HEAVIEST, _ROOM = 0.01, 6, 4.0, 0.5


def fly_html(robot: ModuleType | str | os.PathLike[str]) -> ViewPage:
    """Make a page on which visitors fly a robot, in any browser, without a request.

    The robot moves by its own emitted C, as WebAssembly, under the law of control that its rotors
    and joints serve, emitted too, or else under the regulator of `lqr` about hover. Motors lag as
    the robot file says; other actuators are without delay, and nothing is touched.

    Args:
        robot: A generated module, its folder, the name of a robot that ships, or a robot file.

    Returns:
        The page, of about 100 kB. In a notebook it shows itself; `save` writes it to a file.

    Raises:
        UsageError: There is no such robot, no compiler for WebAssembly, or nothing leads the robot.
    """
    word = robot.__path__[0] if isinstance(robot, ModuleType) else os.fspath(robot)
    with flown_module(word, (*FUNCTIONS, *_OF_LEANING)) as (module, law):
        machine = DrawnMachine(module)
        described = _described(machine, law)
        laws = [law] if law else []
        functions = [*FUNCTIONS, *(_OF_LEANING if law and LAWS[law].leans else ())]
        assembly, script = web_files(module, functions, laws)
        title, words = module.NAME, LAWS[law].title if law else "the regulator of lqr about hover"
        text = render(
            "fly.html.jinja",
            {
                "title": title,
                "law": f"{words[0].upper()}{words[1:]}, 1000 times a second.",
                "script": script.replace("export async", "async"),
                "robot": json.dumps(described, separators=(",", ":"), default=lambda x: x.tolist()),
                "wasm": base64.b64encode(gzip.compress(assembly, 9, mtime=0)).decode(),
            },
        )
    return ViewPage(title, text)


def _described(machine: DrawnMachine, law: str | None) -> dict[str, Any]:
    """What the script has to know of a robot: sizes, places, gains, limits, and what is drawn."""
    vehicle, module = machine.vehicle, machine.module
    layout, names, inputs = vehicle.layout, module.COORDINATES, vehicle.inputs
    held = _regulator(machine) if law is None else {"start": _start(machine)}
    q = held["start"]
    points, frames, hover = vehicle.positions(q), vehicle.frame_poses(q), machine.hover(q)
    centre, rotors = vehicle.points.index(vehicle.centre), vehicle.rotors
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = float(np.linalg.norm(points - middle, axis=1).max()) or 1.0
    weight = float(np.nan_to_num(vehicle.weight))
    floor = float(points[:, 2].min() - 0.7 * size * (rotors > 0))
    room = 60.0 * float(np.abs(hover).max()) or 1e3
    least, most = (np.nan_to_num(x, posinf=room, neginf=-room) for x in machine.input_limits)
    units = np.array(vehicle.input_units)
    usual = {unit: 2.0 * float(np.abs(hover[units == unit]).max()) or 1.0 for unit in units}
    first = centre + 1 + rotors
    moving = joint_points(vehicle, first)[: vehicle.joints]
    links = [(a, k) for k, a in enumerate(machine.parents) if a >= 0]
    return {
        "law": law,
        "u": inputs,
        "units": vehicle.input_units,
        "parameters": [*module.PARAMETERS.values()],
        "hover": hover,
        "least": least,
        "most": most,
        "full": [usual[unit] for unit in units],
        "lags": [vehicle.description("TIME_CONSTANTS").get(name, 0.0) for name in inputs],
        "rate": _RATE,
        # Places of ahead and turning in v, of heading, x and y in q.
        "drive": layout.has_drive
        and [
            *map(layout.v.names.index, ("vx", "wz")),
            *map(layout.q.names.index, ("yaw", "x", "y")),
        ],
        "position": [("xyz".index(names[i]), i) for i in range(len(names))[layout.q.position]],
        **_controls(machine, law, q),
        **_gains(machine, law),
        **held,
        "masses": _masses(machine, q),
        **_joints(machine, q, hover, 0.05 * weight * size),
        "frames": vehicle.frames,
        "centre": centre,
        "rods": [(a, k, moving.index(a) if a in moving else -1) for a, k in links],
        "moving": moving,
        "rotors": rotors,
        "discs": _discs(machine, q, points, frames, size, floor),
        "thrust": float(np.abs(hover[:rotors]).max(initial=1e-9)),
        "spring": 0.6 * weight / size,
        "size": size,
        "focus": middle,
        "offset": middle - points[centre],
        "floor": floor,
        "cell": 0.5 * 2.0 ** np.round(np.log2(size)),
        "thin": 0.022 * size,
        "thick": 0.045 * size,
    }


def _start(machine: DrawnMachine) -> Array:
    """Level, with bent joints; where these move rotors, as flights begin."""
    vehicle, q = machine.vehicle, machine.coordinates(machine.start())
    if vehicle.rotors_move:
        low, high = machine.joint_limits
        q[vehicle.arm] = authority_posture(vehicle, (low, high), q[vehicle.arm])
    return q


def _controls(machine: DrawnMachine, law: str | None, q: Array) -> dict[str, Any]:
    """Sliders, and handles that are dragged: −1 for the base, and numbers of frames."""
    vehicle, layout = machine.vehicle, machine.vehicle.layout
    names, leans = layout.q.names, bool(law and LAWS[law].leans)
    rates, places = layout.v.joint_places, layout.q.joint_places
    sliders, arm = [], []
    lean = 0.0 if leans else _lean(machine, q) if law else _NEAR
    driven = np.subtract(*machine.input_limits)[vehicle.rotors :] != 0.0
    ends_of = zip(*machine.joint_limits, driven, strict=False)
    for i, place, (low, high, moves) in zip(rates, places, ends_of, strict=True):
        if not moves:
            continue
        middle, room = 0.0, _TURN if layout.q.units[place] == "rad" else 1.0
        if law is None and room == _TURN:
            middle, room = q[place], _NEAR
        ends = max(low, middle - room), min(high, middle + room)
        arm.append((i, place, *ends))
        sliders.append((place, names[place], layout.q.units[place], *ends))
    attitude = range(len(names))[layout.q.attitude]
    if not leans and not layout.is_quaternion:
        sliders += [(i, names[i], "rad", -lean, lean) for i in attitude]
    levers = vehicle.frame_jacobians(q)[:, :3, layout.v.joints]
    moved = [k for k in range(1, len(levers)) if np.abs(levers[k]).max(initial=0.0) > 1e-6]
    tips = [k for k in moved if vehicle.frames[k] == "tip"] or moved
    return {
        "sliders": sliders,
        "turns": ([2] if leans else [0, 1, 2]) if layout.is_quaternion else [],
        "most_turn": (lean, lean, _TURN),
        "quaternion": attitude.start,
        "arm": arm,
        "handles": [*[-1] * bool(layout.own_axes[0]), *tips[: 2 * bool(arm)]],
    }


def _lean(machine: DrawnMachine, q: Array) -> float:
    """The greatest lean about all axes at once, rad, at which inputs within their limits hold."""
    layout = machine.vehicle.layout
    turns = 2 if layout.is_quaternion else len(layout.angle_axes)
    lean, controls = _LEAN, machine.start()
    for lean in np.arange(_LEAN, 0.0, -0.05):
        for signs in product((-1.0, 1.0), repeat=turns):
            controls[:turns] = lean * np.array(signs)
            turned = machine.coordinates(controls)
            turned[machine.vehicle.arm] = q[machine.vehicle.arm]
            if machine.beyond(machine.hover(turned)):
                break
        else:
            break
    return lean


def _gains(machine: DrawnMachine, law: str | None) -> dict[str, Any]:
    """Gains of a law, in the places of the velocities."""
    layout = machine.vehicle.layout.v
    stiffness, damping = np.zeros((2, layout.size))
    parts = _LEANING if law and LAWS[law].leans else _FULL
    for part, (k, d) in zip(("attitude", "position", "joints"), parts, strict=True):
        stiffness[getattr(layout, part)], damping[getattr(layout, part)] = k, d
    return {"stiffness": stiffness, "damping": damping, "back": RETURN}


def _regulator(machine: DrawnMachine) -> dict[str, Any]:
    """Gain (nu, 2 nv) about hover, and the coordinates there. Raises `UsageError` without one."""
    hover = trim(machine.module, q=_hanging(machine))
    usual, (least, most) = np.abs(hover.u), machine.input_limits
    sizes = np.where(np.isfinite(most), most, np.maximum(usual, 0.1 * usual.max()) + 1e-3)
    sizes[most <= least] = _NONE
    weights = np.repeat([10.0, 1.0], machine.vehicle.layout.v.size)
    gain = lqr(machine.module, hover, Q=weights, R=sizes**-2, dt=_PERIOD).gain
    return {"start": hover.q, "gain": gain}


def _hanging(machine: DrawnMachine) -> Array:
    """Level, joints at zero; those that nothing drives hang, or balance where zero is a balance."""
    vehicle, layout = machine.vehicle, machine.vehicle.layout
    efforts = machine.input_limits[:, vehicle.rotors : vehicle.rotors + vehicle.joints]
    idle = np.flatnonzero(~efforts.any(axis=0))
    places, rates = (np.array(x.joint_places, int)[idle] for x in (layout.q, layout.v))
    q = vehicle.neutral
    if not idle.size:
        return q

    def weighed(joints: Array) -> tuple[float, Array]:
        q[places] = joints
        return float(vehicle.potential_energy(q)), -vehicle.gravity_forces(q)[rates]

    limits = np.clip(machine.joint_limits[:, idle], -_FAR, _FAR)
    end = minimize(weighed, np.clip(q[places], *limits), jac=True, bounds=limits.T).x
    is_stopped = np.any(end == limits, axis=0)  # Then `trim` tells what it needs there.

    def unbalanced(joints: Array) -> Array:
        return np.where(is_stopped, joints - end, weighed(joints)[1])

    q[places] = least_squares(unbalanced, end, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return q


def _masses(machine: DrawnMachine, q: Array) -> list[tuple[str, list[int], float]]:
    """Bodies whose masses have a slider, the heaviest: with the places of masses and inertias, and
    the greatest factor with which inputs within their limits hold the robot.
    """
    values = machine.module.PARAMETERS
    matches = {name: re.fullmatch(r"(.+)_mass(_per_length)?", name) for name in values}
    found = {
        match[1]: values[name] * (values.get(f"{match[1]}_length", 1.0) if match[2] else 1.0)
        for name, match in matches.items()
        if match
    }
    heavy = sorted(found, key=lambda body: -found[body])[:_SLIDERS]
    sliders = []
    for body in (x for x in found if x in heavy and found[x] > _LIGHT * sum(found.values())):
        # The name of a body may begin that of another.
        longer = [f"{x}_" for x in found if x.startswith(f"{body}_")]
        scaled = [
            name
            for name in values
            if re.match(rf"{body}_(.+_)?(mass|inertia)", name) and not name.startswith((*longer,))
        ]
        for most in np.arange(_HEAVIEST, 1.0, -0.25):
            machine.set_parameters({name: most * values[name] for name in scaled})
            if not machine.beyond(machine.hover(q) / _ROOM):
                break
        sliders.append((body, [k for k, name in enumerate(values) if name in scaled], most))
    machine.set_parameters({})
    return sliders


def _joints(machine: DrawnMachine, q: Array, hover: Array, least: float) -> dict[str, Any]:
    """Joints with the body that each moves and the unit of its effort, and what is a large load."""
    vehicle, bodies = machine.vehicle, list(machine.module.BODIES)
    names, units = vehicle.joint_names, vehicle.layout.effort_units
    joints = [
        (name, bodies.index(name) if name in bodies else len(bodies) - len(names) + k, unit)
        for k, (name, unit) in enumerate(zip(names, units, strict=False))
    ]
    still, none = np.zeros(vehicle.layout.v.size), np.zeros((len(vehicle.frames), 6))
    loads = vehicle.joint_wrenches_with_wrenches(q, still, still, hover, none).reshape(-1, 2, 3)
    sizes = np.linalg.norm(loads, axis=2)
    effort = [max(3.0 * sizes[body, int(unit == "N m")], least) for _, body, unit in joints]
    return {"joints": joints, "effort": effort}


def _discs(
    machine: DrawnMachine, q: Array, points: Array, frames: Array, size: float, floor: float
) -> list[tuple[int, int, Array, float]]:
    """Discs of rotors, then of wheels: point, frame that they move with, axis in it, and radius."""
    vehicle, centre = machine.vehicle, machine.vehicle.points.index(machine.vehicle.centre)
    seats = np.arange(centre + 1, centre + 1 + vehicle.rotors)
    first = len(vehicle.points) - len(vehicle.frames)
    carriers = [centre, *(vehicle.carriers[first + k] for k in range(1, len(vehicle.frames)))]
    moved = [carriers.index(k) if k in carriers else 0 for k in vehicle.carriers[seats]]
    directions, wheels = machine.directions(q), map(vehicle.points.index, vehicle.wheel_points)
    radius = rotor_radius(points, seats, directions, machine.parents, size)
    rotors = zip(seats, moved, directions, strict=True)
    return [
        *((int(k), f, frames[f][:3, :3].T @ d, radius) for k, f, d in rotors),
        *((k, 0, np.eye(3)[1], points[k, 2] - floor) for k in wheels),
    ]
