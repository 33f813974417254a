"""Names of everything that occurs in one chain: coordinates, inputs, parameters, fixed angles.

Bodies have the numbers that the method gives them, whatever they are called in the robot file; what
a number stands for is in the meaning of each symbol.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.parameters import Parameters
from gibbs_codegen.derivation.segment_tree import JointedLink
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.typeset import Kind, Name, base_name, hybrid_name, name, parameter_name
from gibbs_codegen.robot.chains import Chain
from gibbs_codegen.robot.description import (
    Description,
    constrained_arms,
    constrained_coordinate,
    constraint_torque,
)
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import JOINT_LETTERS, default_prefix, link_label, rotor_label
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.parts.numbers import AXIS_PAIRS
from gibbs_codegen.robot.references import NamedKind, parameter_names
from gibbs_codegen.symbolic.tape import InlineTape, Scalars, Stage, signed
from gibbs_codegen.symbolic.vectors import Rotation, Wrench

_RATE, _ACCELERATION = ": its rate", ": its acceleration"


def hybrid_names(robot: Robot) -> dict[str, Name]:
    """Names of the hybrid unknowns, without their dots, and of the inputs.

    They are by the names that generated modules have, with bodies by their numbers.
    """
    description = Description(robot)
    free, acting = description.free_unknowns, description.inputs
    coordinates = description.layout.v
    numbers = [f"{_letter(robot, i)}_{robot.rotors + i}" for i in robot.moving]
    entries = [c.name for c in free]
    base, _ = coordinates.split(entries)
    numbered = dict(zip(entries, coordinates.joined(base, numbers), strict=True))
    names = {c.name: hybrid_name(numbered[c.name], c.meaning) for c in free}
    for arm in constrained_arms(robot):
        angle, torque = constrained_coordinate(robot, arm), constraint_torque(robot, arm)
        names[angle.name] = hybrid_name(f"theta_{arm}", angle.meaning)
        names[torque.name] = hybrid_name(f"tau_prime_{arm}", torque.meaning)
    drives = [f"F_{k}" for k in range(1, robot.rotors + 1)]
    drives += [f"tau_{robot.rotors + i}" for i in robot.driven]
    for entry, drive in zip(acting, drives, strict=True):
        names[entry.name] = hybrid_name(drive, entry.meaning)
    return names


def _letter(robot: Robot, i: int) -> str:
    return JOINT_LETTERS[robot.links[i - 1].joint]


def chain_names(symbolic: SymbolicRobot, chain: Chain) -> dict[sp.Symbol, Name]:
    """Names of everything that occurs in a chain but for fixed angles, by symbol."""
    robot = symbolic.robot
    base = list(_base_names(symbolic, chain.number))
    # As among the velocities: joints before the position, but after velocities of any other base.
    layout = symbolic.description.layout
    first = len(base) // 2 if layout.v.joints.stop < layout.v.size else len(base)
    names = dict(base[:first])
    names |= _joint_names(symbolic, chain)
    names |= base[first:]
    # Inputs: thrusts of rods by the item, others by the rotor.
    acting = symbolic.description.inputs
    for k in chain.motors:
        index = str(k)
        if k <= robot.base.rotors:
            index = f"{chain.number},{3 if k == 1 else 5}"
        meaning = f"{acting[k - 1].meaning} (N)"
        names[symbolic.u[k - 1]] = name("F", index, Kind.INPUT, meaning)
    for item, i in enumerate(jointed_links(robot, chain), start=layout.base_item + 1):
        if i in robot.moving and i in chain.own:
            place = robot.rotors + robot.moving.index(i)
            meaning = f"{acting[place].meaning} ({acting[place].unit})"
            names[symbolic.u[place]] = name("tau", f"{chain.number},{item}", Kind.INPUT, meaning)
    names |= _parameter_names(robot, symbolic.parameters)
    for k in (k for k in chain.motors if k <= robot.base.rotors):
        for axis, component in zip("xyz", robot.base.thrust[k - 1], strict=True):
            meaning = f"{axis} component of the direction of motor {k}'s thrust ({component:.6g})"
            symbol = sp.Symbol(f"epsilon_{k}_{axis}")
            names[symbol] = name("epsilon", f"{k},{axis}", Kind.LENGTH, meaning)
    return names


def _base_names(symbolic: SymbolicRobot, number: int) -> Iterator[tuple[sp.Symbol, Name]]:
    """Symbols and names of the base's coordinates, velocities and accelerations in a chain."""
    layout, coordinates = symbolic.description.layout, symbolic.description.coordinates
    if layout.turns_with_base:
        for place in layout.q.base:
            entry = coordinates[place]
            letter, axis = base_name(entry.name, number, 0)[0], ""
            if entry.unit == "1":
                letter, axis = "q", entry.name[1]
            meaning = entry.meaning if letter == "q" else f"{entry.meaning} ({entry.unit})"
            yield symbolic.q[place], name(letter, axis, Kind.COORDINATE, meaning)
        for place in layout.v.base:
            entry = symbolic.description.free_unknowns[place]
            letter = "omega" if entry.name[0] == "w" else "v"
            index, unit = f"{number},{entry.name[1]}", entry.unit
            yield (symbolic.v[place], name(letter, index, Kind.RATE, f"{entry.meaning} ({unit})"))
            meaning = f"{entry.meaning}{_RATE} ({unit.removesuffix('/s')}/s²)"
            yield symbolic.a[place], name(letter, index, Kind.ACCELERATION, meaning, "dot")
        return
    for item, place in enumerate(sorted(layout.q.base), start=1):
        entry = coordinates[place]
        letter, index = base_name(entry.name, number, item)
        if layout.moves_freely and entry.unit == "m":
            index = f"o_{{{number},3}}"
        symbols = (symbolic.q[place], symbolic.v[place], symbolic.a[place])
        yield from _moving(symbols, letter, index, entry.meaning, entry.unit)


def _moving(
    symbols: Sequence[sp.Symbol], letter: str, index: str, meaning: str, unit: str
) -> Iterator[tuple[sp.Symbol, Name]]:
    """Symbols and names of a coordinate, its rate and its acceleration."""
    kinds = (
        (Kind.COORDINATE, "", f" ({unit})"),
        (Kind.RATE, "dot", f"{_RATE} ({unit}/s)"),
        (Kind.ACCELERATION, "ddot", f"{_ACCELERATION} ({unit}/s²)"),
    )
    for symbol, (kind, mark, ending) in zip(symbols, kinds, strict=True):
        yield symbol, name(letter, index, kind, f"{meaning}{ending}", mark)


def jointed_links(robot: Robot, chain: Chain) -> list[int]:
    """Numbers of a chain's links whose joints move or are held; none for a base rod."""
    return [i for i in chain.path if i in robot.moving or i in robot.constrained]


def _joint_names(symbolic: SymbolicRobot, chain: Chain) -> Iterator[tuple[sp.Symbol, Name]]:
    """Names of the joints' coordinates, rates and accelerations, or the constraint torque."""
    robot, layout = symbolic.robot, symbolic.description.layout
    coordinates = {c.name: c for c in symbolic.description.coordinates}
    jointed = [robot.rotors + i for i in jointed_links(robot, chain)]
    first = layout.base_item + 1
    for item, arm in enumerate([chain.rod] if chain.rod else jointed, start=first):
        index = f"{chain.number},{item}"
        if arm in chain.constrained:
            coordinate, torque = constrained_coordinate(robot, arm), constraint_torque(robot, arm)
            # A held link is at zero, where the robot file puts it.
            angle = float(robot.base.arm_angle_deg(arm)) if chain.rod else 0.0
            meaning = f"{coordinate.meaning}, held at {angle:.6g}°".replace("-", "−")
            symbols = tuple(sp.Symbol(f"{mark}{coordinate.name}") for mark in ("", "v_", "a_"))
            yield from _moving(symbols, "theta", index, meaning, coordinate.unit)
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
    for kind, number, own_name, words in bodies:
        pairs = zip(
            parameter_names(kind, own_name or number), parameter_names(kind, number), strict=True
        )
        of_bodies |= {key: (numbered, words if own_name else "") for key, numbered in pairs}
    of_frames = {name for frame in robot.frames for name in parameter_names("frame", frame.name)}
    for internal, default in parameters.defaults.items():
        if internal in of_frames:
            continue
        numbered, whose = of_bodies.get(internal, (internal, ""))
        unit = parameters.units[internal]
        yield sp.Symbol(internal), parameter_name(numbered, robot.rotors, default, unit, whose)


def second_moments(
    xx: sp.Expr, yy: sp.Expr, zz: sp.Expr, xy: sp.Expr, xz: sp.Expr, yz: sp.Expr
) -> tuple[sp.Expr, ...]:
    """∫x², ∫y², ∫z², ∫xy, ∫xz, ∫yz over the mass, by the entries of the inertia matrix (kg m²)."""
    return ((yy + zz - xx) / 2, (xx + zz - yy) / 2, (xx + yy - zz) / 2, -xy, -xz, -yz)


def defined_inertias(symbolic: SymbolicRobot, chain: Chain) -> list[Inertia]:
    """Inertias of the root and of what follows it in a chain, each about its joint.

    They are in the parameters; zero for those that have their mass in another chain.
    """
    core = symbolic.chain_core(chain)
    if chain.rod is not None:
        return [core, symbolic.parameters.arms[chain.rod].inertia]
    bodies = symbolic.chain_bodies(chain)
    core = core.plus(InlineTape(), bodies.on_base)
    return [core, *(link.inertia for link in bodies.links)]


# The first letters of symbols of fixed angles in the derivation.
FIXED = "fixed_"
# Remainders by rounding of sines and cosines that cancel.
_ROUNDING = sp.Float("1e-25")


class Made:
    """Symbols of a chain on a tape; `definitions` says in order what they stand for."""

    def __init__(
        self, tape: Scalars, chain: int, names: dict[sp.Symbol, Name], plain: SymbolicRobot
    ) -> None:
        self.definitions: list[Definition] = []
        self._tape = tape
        self._chain = chain
        self._root_item = plain.root_item
        self._names = names
        units = plain.parameters.units.items()
        self._masses = {sp.Symbol(name) for name, unit in units if unit == "kg"}

    def inertia(self, item: int, inertia: Inertia) -> Inertia:
        """Inertia of an item, from 1, about its joint, with entries named that are not zero."""
        of_item = f"of item {item}"
        mass = self._inertial("B_0", item, "", inertia.mass, f"mass {of_item} (kg)")
        words = f"first moment of mass {of_item}, whose skew matrix is B_1 (kg m)"
        moment = [
            self._inertial("b", item, axis, value, words)
            for axis, value in zip("xyz", inertia.moment, strict=True)
        ]
        e_xx, e_yy, e_zz, e_xy, e_xz, e_yz = inertia.second
        entries = (e_yy + e_zz, e_xx + e_zz, e_xx + e_yy, -e_xy, -e_xz, -e_yz)
        words = f"inertia matrix B_2 + B_3 {of_item} about its joint (kg m²)"
        entries_so_far: dict[sp.Expr, sp.Symbol] = {}
        joint_inertia = [
            self._inertial("J", item, axes, value, words, entries_so_far)
            for axes, value in zip(AXIS_PAIRS, entries, strict=True)
        ]
        second = map(self._tape.let, second_moments(*joint_inertia))
        return Inertia.of([mass, *moment, *second])

    def _inertial(
        self,
        letter: str,
        item: int,
        axes: str,
        value: sp.Expr,
        meaning: str,
        symbols: dict[sp.Expr, sp.Symbol] | None = None,
    ) -> sp.Expr:
        """Name an entry of an inertia, unless it is zero, or of a point: a mass times places.

        A symbol in `symbols` that has the same value is read in place of this.
        """
        value = _settled(value)
        of_point = not (value.is_Add or value.has(sp.Float)) and self._masses & value.free_symbols
        if value == 0 or of_point:
            return self._tape.let(value)
        index = f"{self._chain},{item}" + (f",{axes}" if axes else "")
        symbol = self._symbol(f"{letter}_{item}{axes}", letter, index, Kind.INERTIA, meaning)
        same = symbol if symbols is None else symbols.setdefault(value, symbol)
        self.definitions.append((symbol, value if same is symbol else same))
        return same

    def placed(self, item: int, link: JointedLink) -> JointedLink:
        """A link with those places of its joint named that are more than a parameter."""
        words = f"place of the joint of item {item}, in the frame of item {item - 1}"
        if link.turn_deg % 360:
            words += f" turned by {_degrees(link.turn_deg)} about z"
        step = [
            self._constant("p", f"{item},{axis}", value, f"{words} (m)")
            for axis, value in zip("xyz", link.step, strict=True)
        ]
        meaning = f"offset of item {item} along its joint's axis (m)"
        d = self._constant("p", f"{item}", link.d, meaning)
        return replace(link, step=(step[0], step[1], step[2]), d=d)

    def wrench(self, k: int, segment: int, wrench: Wrench) -> Wrench:
        """Wrench of rotor k ≥ 1, on a segment, per unit of thrust, numbers of the file named."""
        item = self._root_item + segment
        parts = {
            "e": (wrench.force, f"direction of thrust {k} in the frame of item {item}"),
            "n": (
                wrench.moment,
                f"torque of a unit of thrust {k} about the joint of item {item}, in its frame (m)",
            ),
        }
        force, moment = (
            [
                self._constant(letter, f"{k},{axis}", value, words, numeric=True)
                for axis, value in zip("xyz", values, strict=True)
            ]
            for letter, (values, words) in parts.items()
        )
        return Wrench.of([*force, *moment])

    def _constant(
        self, letter: str, index: str, value: sp.Expr, meaning: str, numeric: bool = False
    ) -> sp.Expr:
        """Name a constant, unless it is a parameter or an exact number.

        `index` is without the chain. With `numeric` the value keeps its own form if there are no
        floating-point numbers in it.
        """
        value = _settled(value)
        if (signed(value)[1].is_Atom or numeric) and not value.has(sp.Float):
            return value
        index = f"{self._chain},{index}"
        symbol = self._symbol(f"{letter}({index})", letter, index, Kind.LENGTH, meaning)
        self.definitions.append((symbol, value))
        return symbol

    def _symbol(
        self, internal: str, letter: str, index: str, kind: Kind, meaning: str
    ) -> sp.Symbol:
        """A symbol on the tape, with a name as `typeset.name` composes it."""
        symbol: sp.Symbol = self._tape.symbol(internal, Stage.PARAMETER)
        self._names[symbol] = name(letter, index, kind, meaning)
        return symbol


def _settled(value: sp.Expr) -> sp.Expr:
    """A polynomial multiplied out, without terms that are rounding."""
    value = sp.expand(value)
    if not value.has(sp.Float):
        return value
    terms: Sequence[sp.Expr] = sp.Add.make_args(value)
    return sp.Add(*(term for term in terms if abs(term.as_coeff_Mul()[0]) > _ROUNDING))


def fixed_rotation(
    tape: Scalars, names: dict[sp.Symbol, Name], axis: int, degrees: Fraction
) -> Rotation:
    """Rotation by an angle that the robot file fixes: exact, or with the angle as a symbol.

    `names` takes the name of the symbol; the angle is in degrees, about x (0) or z (2).
    """
    degrees %= 360
    if degrees % 30 == 0 or degrees % 45 == 0:
        return Rotation.degrees(axis, degrees)
    symbol = tape.symbol(f"{FIXED}{float(degrees):.17g}", Stage.PARAMETER)
    text = _degrees(degrees)
    latex = text.replace("°", r"^{\circ}")
    names[symbol] = Name(latex, text, Kind.COORDINATE, "fixed angle", text)
    return Rotation.angle(tape, axis, symbol)


def _degrees(angle: Fraction) -> str:
    return f"{float(angle):.10g}°"
