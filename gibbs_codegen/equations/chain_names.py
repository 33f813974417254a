"""Names of everything that occurs in one chain: coordinates, inputs, parameters, fixed angles.

Bodies have the numbers that the method gives them, whatever they are called in the robot file; what
a number stands for is in the meaning of each symbol.
"""

from __future__ import annotations

from collections.abc import Iterator

import sympy as sp

from gibbs_codegen.derivation.parameters import Parameters
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.equations.notation import Kind, Name, hybrid_name, name, parameter_name
from gibbs_codegen.robot.chains import Chain
from gibbs_codegen.robot.coordinates import (
    constraint_torque,
    free_unknowns,
    held_arms,
    held_coordinate,
    inputs,
    reduced_coordinates,
)
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot, Rod
from gibbs_codegen.robot.names import (
    JOINT_LETTERS,
    default_prefix,
    link_label,
    rotor_label,
)
from gibbs_codegen.robot.taken_names import NamedKind, parameter_names

_LINEAR = ("x", "y", "z")
_RATE, _ACCELERATION = ": its rate", ": its acceleration"


def hybrid_names(robot: Robot) -> dict[str, Name]:
    """Names of the hybrid unknowns, without their dots, and of the inputs.

    They are by the names that generated modules have, with bodies by their numbers.
    """
    free, acting = free_unknowns(robot), inputs(robot)
    own = layout_of(robot).v
    numbers = [f"{_letter(robot, i)}_{robot.rotors + i}" for i in robot.moving]
    base = [free[place].name for place in own.base]
    plain = dict(zip((c.name for c in free), own.joined(base, numbers), strict=True))
    found = {c.name: hybrid_name(plain[c.name], c.meaning) for c in free}
    for arm in held_arms(robot):
        angle, torque = held_coordinate(robot, arm), constraint_torque(robot, arm)
        found[angle.name] = hybrid_name(f"theta_{arm}", angle.meaning)
        found[torque.name] = hybrid_name(f"tau_prime_{arm}", torque.meaning)
    drives = [f"F_{k}" for k in range(1, robot.rotors + 1)]
    drives += [f"tau_{robot.rotors + i}" for i in robot.moving]
    for entry, drive in zip(acting, drives, strict=True):
        found[entry.name] = hybrid_name(drive, entry.meaning)
    return found


def _letter(robot: Robot, i: int) -> str:
    return JOINT_LETTERS[robot.links[i - 1].joint]


def chain_names(symbolic: SymbolicRobot, chain: Chain) -> dict[sp.Symbol, Name]:
    """Names of everything that occurs in a chain but for fixed angles, by symbol."""
    robot = symbolic.robot
    base = list(_base_names(symbolic, chain.number))
    # As among the velocities: joints before the position, but after the twist of a quaternion.
    first = len(base) if layout_of(robot).is_quaternion else len(base) // 2
    names = dict(base[:first])
    names |= _joint_names(symbolic, chain)
    names |= base[first:]
    names |= _input_names(symbolic, chain)
    names |= _parameter_names(robot, symbolic.parameters)
    for k in (k for k in chain.motors if k <= robot.base.rotors):
        for axis, component in zip("xyz", robot.base.thrust[k - 1], strict=True):
            meaning = f"{axis} component of the direction of motor {k}'s thrust ({component:.6g})"
            symbol = sp.Symbol(f"epsilon_{k}_{axis}")
            names[symbol] = name("epsilon", f"{k},{axis}", Kind.LENGTH, meaning)
    return names


def _base_names(symbolic: SymbolicRobot, number: int) -> Iterator[tuple[sp.Symbol, Name]]:
    """Symbols and names of the base's coordinates, velocities and accelerations in a chain."""
    layout, coordinates = layout_of(symbolic.robot), reduced_coordinates(symbolic.robot)
    if layout.is_quaternion:
        for place in layout.q.base:
            entry = coordinates[place]
            letter, axis = ("q", entry.name[1]) if entry.name.startswith("q") else (entry.name, "")
            yield symbolic.q[place], name(letter, axis, Kind.COORDINATE, _with_unit(entry.meaning))
        for place in layout.v.base:
            entry = free_unknowns(symbolic.robot)[place]
            letter = "omega" if entry.name[0] == "w" else "v"
            index, unit = f"{number},{entry.name[1]}", entry.unit
            yield symbolic.v[place], name(letter, index, Kind.RATE, f"{entry.meaning} ({unit})")
            meaning = f"{entry.meaning}{_RATE} ({unit.removesuffix('/s')}/s²)"
            yield symbolic.a[place], name(letter, index, Kind.ACCELERATION, meaning, "dot")
        return
    for item, place in enumerate(layout.q.base, start=1):
        entry = coordinates[place]
        letter, index = ("theta", f"{number},{item}")
        if entry.name in _LINEAR:
            letter, index = entry.name, f"o_{{{number},3}}"
        symbols = (symbolic.q[place], symbolic.v[place], symbolic.a[place])
        yield from _moving(symbols, letter, index, entry.meaning, entry.unit)


def _with_unit(meaning: str) -> str:
    return meaning if "quaternion" in meaning else f"{meaning} (m)"


def _moving(
    symbols: tuple[sp.Symbol, sp.Symbol, sp.Symbol],
    letter: str,
    index: str,
    meaning: str,
    unit: str,
) -> Iterator[tuple[sp.Symbol, Name]]:
    """Symbols and names of a coordinate, its rate and its acceleration."""
    kinds = (
        (Kind.COORDINATE, "", f" ({unit})"),
        (Kind.RATE, "dot", f"{_RATE} ({unit}/s)"),
        (Kind.ACCELERATION, "ddot", f"{_ACCELERATION} ({unit}/s²)"),
    )
    for symbol, (kind, mark, what) in zip(symbols, kinds, strict=True):
        yield symbol, name(letter, index, kind, f"{meaning}{what}", mark)


def jointed_links(robot: Robot, chain: Chain) -> list[int]:
    """Numbers of a chain's links whose joints move or are held; none for a base rod."""
    return [i for i in chain.path if i in robot.moving or i in robot.constrained]


def _joint_names(symbolic: SymbolicRobot, chain: Chain) -> Iterator[tuple[sp.Symbol, Name]]:
    """Names of the joints' coordinates, rates and accelerations, or the constraint torque."""
    robot, layout = symbolic.robot, layout_of(symbolic.robot)
    coordinates = {c.name: c for c in reduced_coordinates(robot)}
    jointed = [robot.rotors + i for i in jointed_links(robot, chain)]
    for item, arm in enumerate([chain.rod] if chain.rod else jointed, start=4):
        index = f"{chain.number},{item}"
        if arm in chain.held:
            held, torque = held_coordinate(robot, arm), constraint_torque(robot, arm)
            # A held link is at zero, where the robot file puts it.
            angle = float(robot.base.arm_angle_deg(arm)) if chain.rod else 0.0
            meaning = f"{held.meaning}, held at {angle:.6g}°".replace("-", "−")
            symbols = tuple(sp.Symbol(f"{mark}{held.name}") for mark in ("", "v_", "a_"))
            yield from _moving(symbols, "theta", index, meaning, held.unit)
            meaning = f"{torque.meaning} ({torque.unit})"
            yield sp.Symbol(torque.name), name("tau", index, Kind.INPUT, meaning, prime=True)
            continue
        joint = robot.moving.index(arm - robot.rotors)
        q = range(layout.q.size)[layout.q.joints][joint]
        v = range(layout.v.size)[layout.v.joints][joint]
        entry = coordinates[layout.q.names[q]]
        symbols = (symbolic.q[q], symbolic.v[v], symbolic.a[v])
        letter = _letter(robot, arm - robot.rotors)
        yield from _moving(symbols, letter, index, entry.meaning, entry.unit)


def _input_names(symbolic: SymbolicRobot, chain: Chain) -> Iterator[tuple[sp.Symbol, Name]]:
    """Names of what acts in a chain: thrusts of rods by the item, others by the rotor."""
    robot, acting = symbolic.robot, inputs(symbolic.robot)
    for k in chain.motors:
        index = str(k)
        if k <= robot.base.rotors:
            index = f"{chain.number},{3 if k == 1 else 5}"
        meaning = f"{acting[k - 1].meaning} (N)"
        yield symbolic.u[k - 1], name("F", index, Kind.INPUT, meaning)
    for item, i in enumerate(jointed_links(robot, chain), start=4):
        if i in robot.moving and i in chain.own:
            place = robot.rotors + robot.moving.index(i)
            meaning = f"{acting[place].meaning} ({acting[place].unit})"
            yield symbolic.u[place], name("tau", f"{chain.number},{item}", Kind.INPUT, meaning)


def _parameter_names(robot: Robot, parameters: Parameters) -> Iterator[tuple[sp.Symbol, Name]]:
    """Names of the parameters, but for those of frames, which no chain has."""
    bodies: list[tuple[NamedKind, str, str | None, str]] = [
        (
            "rod" if isinstance(link.body, Rod) else "link",
            default_prefix("link", i),
            link.name,
            link_label(robot, i),
        )
        for i, link in enumerate(robot.links, start=1)
    ]
    bodies += [
        ("rotor", default_prefix("rotor", k), rotor.name, f"rotor {rotor_label(robot, k)}")
        for k, rotor in enumerate(robot.thrusters, start=1)
    ]
    of_bodies: dict[str, tuple[str, str]] = {}
    for kind, number, given, words in bodies:
        pairs = zip(
            parameter_names(kind, given or number), parameter_names(kind, number), strict=True
        )
        of_bodies |= {own: (plain, words if given else "") for own, plain in pairs}
    of_frames = {name for frame in robot.frames for name in parameter_names("frame", frame.name)}
    for internal, default in parameters.defaults.items():
        if internal in of_frames:
            continue
        plain, whose = of_bodies.get(internal, (internal, ""))
        unit = parameters.units[internal]
        yield sp.Symbol(internal), parameter_name(plain, robot.rotors, default, unit, whose)
