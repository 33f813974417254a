"""Names inside a robot file: what they refer to, and which of them clash.

What they refer to is read in the tables as they stand in the file, before they are checked, so that
these faults are reported beside those of single values.

No two things of a robot may share a name in generated code. A name takes its identifier form among
the names of its kind, and the names of all parameters that such a thing may have.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from gibbs_codegen.files.table import Place, shown
from gibbs_codegen.robot.layout import BASE_ENTRIES, OTHER_BASE_ENTRIES
from gibbs_codegen.robot.names import (
    CONSTRAINT_TORQUES,
    default_prefix,
    identifier,
    joint_name,
    named_prefix,
)
from gibbs_codegen.robot.parts.base import FIXED, FREE
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.robot.parts.constraint import ROWS, Constraint
from gibbs_codegen.robot.parts.frame import MAX_FRAMES
from gibbs_codegen.robot.parts.gear import Rolling
from gibbs_codegen.robot.parts.link import MAX_LINKS, JointKeys, Passive
from gibbs_codegen.robot.parts.motor import Motor
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.parts.part import parameter_ends
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS, Rotor
from gibbs_codegen.robot.parts.servo import Servo
from gibbs_codegen.robot.parts.ties import TIES, Tie
from gibbs_codegen.robot.parts.wheel import MAX_WHEELS, Disc

# A link is a rigid one unless it is a rod; a joint stands for its coordinate, and a servo has the
# name of its link.
NamedKind = str
# What has the name of its kind before its own in names of parameters.
_PREFIXED = ("frame", *(kind.array for kind in TIES))

# What marks names of rows of constraints, which may be those of parameters.
_ROW = "row "
# How names of parameters end, after the prefix of what they belong to.
_JOINT = parameter_ends(Pose, JointKeys, Passive, Motor)
_ENDS: dict[NamedKind, tuple[str, ...]] = {
    "base": parameter_ends(Pose, RigidBody),
    "arm": parameter_ends(RigidBody, Rod),
    "link": (*_JOINT, *parameter_ends(RigidBody)),
    "wheel": parameter_ends(Pose, Passive, Disc, Rolling),
    "rod": (*_JOINT, *parameter_ends(Rod)),
    "servo": tuple(f"servo_{end}" for end in parameter_ends(Servo)),
    "rotor": parameter_ends(Rotor),
    "frame": parameter_ends(Pose),
    "joint": (),
    **{kind.array: parameter_ends(kind) for kind in TIES},
}


class NameRegistry:
    """Names of a robot, and whose they are; at first only those of its base."""

    def __init__(self, rods: int = 0, coordinates: Sequence[str] = BASE_ENTRIES) -> None:
        self._owners: dict[str, str] = {}
        self.add("base", "base", "the base")
        self.add("frame", "base", "the base's own frame")
        for k in ("", *range(1, rods + 1)) if rods else ():
            self.add("arm", f"base_arm{k}", "the base's arms")
        for entry in coordinates:
            self.add("joint", entry, "a coordinate of the base")
        for k in range(2, rods + 1):
            self.add("joint", joint_name("fixed", k), f"the angle of base arm {k}")

    def add(self, kind: NamedKind, name: str, whose: str) -> None:
        """Add a name of a kind, and whose it is, in words."""
        for entry in (_form(kind, name), *parameter_names(kind, name)):
            self._owners.setdefault(entry, whose)

    def owner(self, kind: NamedKind, name: str) -> str | None:
        """Whose a name is, in words, or None where it is free among the names of its kind."""
        return self._owners.get(_form(kind, name))

    def fault(self, kind: NamedKind, name: str) -> str | None:
        """Why a name cannot be given and what would be right, or None where it can."""
        form = identifier(name)
        if kind == "joint" and form.startswith(CONSTRAINT_TORQUES):
            return f"{shown(name)} begins like names of constraint torques; give it another name"
        if owner := self.owner(kind, name):
            called = shown(name) if form == name else f"{shown(name)}, in generated code {form},"
            return f"{called} is the name of {owner} already; give another"
        for parameter in parameter_names(kind, name):
            if owner := self._owners.get(parameter):
                clashing = "rows" if parameter.startswith(_ROW) else "parameters"
                return (
                    f"{shown(name)} gives {clashing} the names of those of {owner}, such as "
                    f"{parameter.removeprefix(_ROW)}: give it another name"
                )
        return None


def _form(kind: NamedKind, name: str) -> str:
    """The identifier form with the kind, of which the base, arms, links and rotors are one."""
    return f"{kind if kind in (*_PREFIXED, 'joint', 'servo') else 'body'} {identifier(name)}"


def parameter_names(kind: NamedKind, name: str) -> list[str]:
    """Identifiers of all parameters that something may have, and marked, of rows of constraints.

    Its name is the prefix, such as link2, of a link or rotor without one.
    """
    prefix = f"{kind}_{identifier(name)}" if kind in _PREFIXED else named_prefix(name)
    rows = sorted({*chain(*ROWS.values())}) if kind == Constraint.array else []
    row_names = [f"{_ROW}{identifier(name)}_{row}" for row in rows]
    return row_names + [f"{prefix}_{end}" for end in _ENDS[kind]]


Entry = Mapping[str, Any]
PlacedFault = tuple[Place, str]
_Named = tuple[Place, NamedKind, str, str]

# To look for what a name may have been meant to be takes time, and a flood of names is no slip.
_MOST_SUGGESTIONS = 20


def body_numbers(names: Sequence[str | None]) -> dict[str, int]:
    """Numbers of the bodies that names of links refer to: 0 of the base, and of each link.

    Link 2 without a name is link2.
    """
    numbers = {"base": BASE}
    for i, name in enumerate(names, start=1):
        numbers.setdefault(name or default_prefix("link", i), i)
    return numbers


def tie_faults(ties: Sequence[Tie], bodies: Mapping[str, int]) -> Iterator[PlacedFault]:
    """Faults of the frames that ties refer to.

    `bodies` has for each frame the number of its body, of welded ones the same.
    """
    frames = [*bodies]
    right, example = " or ".join(map(shown, frames[:2])), ""
    if len(frames) > 2:
        right, example = "the name of a frame", f"; {shown(frames[-1])} is one"
    places = {kind: iter(range(kind.most)) for kind in TIES}
    for tie in ties:
        at, frame, to = (tie.array, next(places[type(tie)])), tie.frame, tie.to
        for key, name in (("frame", frame), ("to", to)):
            world = name == "world" and isinstance(tie, Constraint)
            free = ", or be left out for the world" if world else ""
            yield from _unknown({(*at, key): name}, bodies, f"must be {right}{free}", example)
        if frame == to:
            yield (*at, "to"), f"{shown(frame)} is the frame {tie.other_end}"
        elif to and frame in bodies and bodies[frame] == bodies.get(to):
            yield (*at, "to"), "both frames are on the same body; choose frames on two bodies"


def reference_faults(document: Mapping[str, Any]) -> Iterator[PlacedFault]:
    """Place and words of faults of the names in a robot file, and of what refers to them."""
    links = _tables(document, "link", MAX_LINKS)
    rotors = _tables(document, "rotor", MAX_ROTORS)
    frames = _tables(document, "frame", MAX_FRAMES)
    wheels = _tables(document, "wheel", MAX_WHEELS)
    numbers = body_numbers([_text(link, "name") for link in links])
    yield from _parent_faults(links, numbers)
    yield from _gear_faults(links, numbers)
    numbers = body_numbers([_text(part, "name") for part in (*links, *wheels)])
    carried: dict[Place, str | None] = {
        (kind, place, "on"): _text(table, "on")
        for kind, tables in (("rotor", rotors), ("frame", frames))
        for place, table in enumerate(tables)
    }
    yield from _unknown(carried, numbers, 'must be "base" or the name of a link')
    base = document.get("base")
    arms: Entry = base if isinstance(base, dict) else {}
    rods = arms.get("rotors", 0)
    rods = rods if isinstance(rods, int) and rods <= MAX_ROTORS else 0
    entries = {FREE: BASE_ENTRIES, FIXED: ()}
    motion = str(arms.get("motion", FREE))
    registry = NameRegistry(rods, entries.get(motion, OTHER_BASE_ENTRIES))
    # What the file names, or has a default for.
    named: list[_Named] = []
    servos: list[_Named] = []
    arrays = {"link": links, "wheel": wheels, "rotor": rotors, "frame": frames}
    arrays |= {kind.array: _tables(document, kind.array, kind.most) for kind in TIES}
    for array, tables in arrays.items():
        for number, table in enumerate(tables, start=1):
            kind = "rod" if array == "link" and "mass" not in table else array
            whose = f"{array} {number}"
            if name := _text(table, "name"):
                named.append(((array, number - 1, "name"), kind, name, whose))
            elif array in ("link", "rotor"):  # Others need their names.
                registry.add(kind, default_prefix(array, number), whose)
                if array == "rotor":  # Its thrust is called by its number.
                    registry.add(kind, str(number), whose)
            if table.get("servo") is not None:
                owner = name or default_prefix(array, number)
                servos.append(
                    ((array, number - 1, "name"), "servo", owner, f"the servo of {whose}")
                )
    faults = list(_clashes(named, registry))
    yield from faults
    if not faults:
        yield from _clashes(servos, registry)
    if rods or "arm" not in arms:  # Otherwise it is not known from which number joints count.
        yield from _coordinate_clashes(links, wheels, rods + len(rotors), registry)


def _tables(document: Mapping[str, Any], key: str, most: int) -> list[Entry]:
    """The tables of an array, none where it is faulty as a whole or has more than `most`."""
    tables = document.get(key)
    if not isinstance(tables, list) or len(tables) > most:
        return []
    return [entry if isinstance(entry, dict) else {} for entry in tables]


def _text(entry: Entry, key: str) -> str | None:
    text = entry.get(key)
    return text if isinstance(text, str) else None


def _unknown(
    references: Mapping[Place, str | None],
    numbers: Mapping[str, int],
    right: str,
    example: str = "",
) -> Iterator[PlacedFault]:
    """Faults of references, by place, that refer to no body; `right` says what would be right.

    So does `example`, where no name is near.
    """
    unknown = {at: name for at, name in references.items() if name and name not in numbers}
    for place, name in unknown.items():
        few = len(unknown) <= _MOST_SUGGESTIONS
        near = difflib.get_close_matches(name, numbers, n=1) if few else []
        hint = f"; did you mean {shown(near[0])}?" if near else example
        yield place, f"{right}, not {shown(name)}{hint}"


def _parent_faults(links: Sequence[Entry], numbers: Mapping[str, int]) -> Iterator[PlacedFault]:
    right = 'must be "base" or the name of a link given earlier'
    names = [_text(link, "parent") for link in links]
    yield from _unknown({("link", i, "parent"): n for i, n in enumerate(names)}, numbers, right)
    parents = [numbers.get(name, BASE) if name else before for before, name in enumerate(names)]
    for i, (parent, name) in enumerate(zip(parents, names, strict=True), start=1):
        if parent < i:
            continue
        # What carries the parent, directly or over others; `parents` are in any order.
        carriers: list[int] = []
        carrier = parent
        while carrier != BASE and carrier not in carriers:
            carriers.append(carrier)
            carrier = parents[carrier - 1]
        if parent == i:
            why = "a link cannot carry itself"
        elif i in carriers:
            why = f"{shown(name)} is itself carried by this link, which makes a cycle"
        else:
            why = f"{shown(name)} comes later; move this link below it"
        yield ("link", i - 1, "parent"), f"{right}: {why}"


def _gear_faults(links: Sequence[Entry], numbers: Mapping[str, int]) -> Iterator[PlacedFault]:
    right = "must be the name of another link whose joint moves"
    names: dict[Place, str | None] = {}
    for i, link in enumerate(links):
        gear, at = link.get("gear"), ("link", i, "gear", "of")
        of = gear.get("of") if isinstance(gear, dict) else None
        several = [((*at, k), x) for k, x in enumerate(of)] if isinstance(of, list) else [(at, of)]
        names |= {place: name if isinstance(name, str) else None for place, name in several}
    bodies = {name: i for name, i in numbers.items() if i != BASE}
    yield from _unknown(names, bodies, right)
    movers: dict[int, list[int]] = {}
    for place, name in names.items():
        movers.setdefault(int(place[1]) + 1, []).append(bodies.get(name or "", BASE))
    for place, name in names.items():
        first = bodies.get(name or "", BASE)
        way = [first]
        for mover in way:  # It grows meanwhile.
            way += [before for before in movers.get(mover, ()) if before not in way]
        if int(place[1]) + 1 in way:
            why = "is itself moved by this joint; break the circle"
            yield place, f"{right}: {shown(name)} {why}"
        elif first != BASE and links[first - 1].get("joint") == "fixed":
            yield place, f"{right}: {shown(name)} is fixed"


def _coordinate_clashes(
    links: Sequence[Entry], wheels: Sequence[Entry], rotors: int, registry: NameRegistry
) -> Iterator[PlacedFault]:
    """Coordinates that clash with each other or with the base's own.

    Clashes of link names are reported elsewhere. `rotors` is N.
    """
    by_name: dict[str, _Named] = {}
    by_coordinate: list[_Named] = []
    for place, link in enumerate(links):
        kind, label = link.get("joint", "revolute"), f"the coordinate of link {place + 1}"
        if kind == "fixed" and link.get("constrained") is not True:
            continue
        if text := _text(link, "coordinate"):
            by_coordinate.append((("link", place, "coordinate"), "joint", text, label))
        elif text := _text(link, "name"):
            by_name[identifier(text)] = (("link", place, "name"), "joint", text, label)
        else:
            default = joint_name(
                "prismatic" if kind == "prismatic" else "fixed", rotors + place + 1
            )
            if owner := registry.owner("joint", default):
                yield ("link", place), f"{default} is {owner}: give the link a name"
            registry.add("joint", default, label)
    for place, wheel in enumerate(wheels):
        if text := _text(wheel, "joint"):
            label = f"the coordinate of wheel {place + 1}"
            by_coordinate.append((("wheel", place, "joint"), "joint", text, label))
    yield from _clashes([*by_name.values(), *by_coordinate], registry)


def _clashes(named: Iterable[_Named], registry: NameRegistry) -> Iterator[PlacedFault]:
    """Faults of names that are taken; those that are not yet are added."""
    for place, kind, name, whose in named:
        if words := registry.fault(kind, name):
            yield place, words
        else:
            registry.add(kind, name, whose)
