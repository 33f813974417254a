"""Robot files: TOML text in, a checked `Robot` out, or every fault of the file at once.

The keys are those that `docs/robot-file.md` explains. Nothing is guessed: an unknown key, a wrong
type, a number that is not finite or an inertia that no body has is refused with its key path and
line.
"""

from __future__ import annotations

import difflib
import math
import sys
from importlib import resources
from pathlib import Path

from gibbs_codegen.errors import RobotFileError, printable
from gibbs_codegen.files.toml import checked, file_text
from gibbs_codegen.files.toml_table import Table, shown
from gibbs_codegen.robot.magnitude import size_fault
from gibbs_codegen.robot.model import (
    ATTITUDES,
    AXES,
    JOINT_KINDS,
    ORIGINS,
    Base,
    Body,
    Link,
    RigidBody,
    Robot,
    Rod,
    Vector3,
    alternating_thrust,
)
from gibbs_codegen.robot.names import name_fault
from gibbs_codegen.robot.rigid_body import inertia_fault

MAX_ROTORS = 256
MAX_LINKS = 64

_ROD_KEYS = ("mass_per_length", "section_inertia")
_RIGID_KEYS = ("mass", "com", "inertia")


def shipped_robots() -> tuple[str, ...]:
    """Names of the robots that ship with the package."""
    folder = resources.files("gibbs_codegen") / "robots"
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml")))


def read_robot(name_or_path: str) -> tuple[Robot, str]:
    """Read a robot by file path, or by the name of one that ships; return it with its text.

    Raises `RobotFileError` for a refused file and `UsageError` where there is none.
    """
    if name_or_path in shipped_robots():
        resource = resources.files("gibbs_codegen") / "robots" / f"{name_or_path}.toml"
        text = resource.read_text(encoding="utf-8")
        return parse_robot(text, f"{name_or_path}.toml"), text
    path = Path(name_or_path)
    text = file_text(path, RobotFileError, lambda: _not_found(path))
    return parse_robot(text, name_or_path), text


def _not_found(path: Path) -> str:
    if path.exists():
        return f"{printable(path)}: is not a file; give a robot file in TOML"
    shipped = shipped_robots()
    near = difflib.get_close_matches(str(path)[:80], shipped, n=1)
    hint = f"; did you mean {near[0]}?" if near else f" ({', '.join(shipped)})"
    return f"{printable(path)}: no such robot file, and no robot of that name ships{hint}"


def parse_robot(text: str, source: str = "robot file") -> Robot:
    """Check TOML text and return the robot.

    Raises `RobotFileError` with every fault found; `source` is the name used in its message.
    """
    return checked(text, source, _robot, RobotFileError)


def _robot(root: Table) -> Robot | None:
    root.refuse_unknown(("name", "gravity", "base", "link"))
    name = root.text("name")
    if name is not None and (fault := name_fault(name)):
        root.fault("name", fault)
    gravity = root.number("gravity", 9.81, least=0.0)
    _check_sizes(root, "gravity")
    base_table = root.table("base")
    base = _base(base_table) if base_table is not None else None
    links = tuple(_link(table) for table in root.tables("link", MAX_LINKS, "links"))
    if root.faults or name is None or base is None:
        return None
    robot = Robot(name, base, links, gravity)
    if robot.total_mass <= 0:
        root.fault("base.arm", "the machine has no mass; give its arms or links some")
    return robot


def _base(table: Table) -> Base | None:
    table.refuse_unknown(("rotors", "attitude", "origin", "thrust", "drag", "arm"))
    rotors = table.integer("rotors", least=2, most=MAX_ROTORS)
    attitude = table.choice("attitude", ATTITUDES, "xyz")
    origin = table.choice("origin", ORIGINS, "motor1")
    arms = _arms(table, rotors)
    if rotors is None:
        return None
    thrust = _thrust(table, rotors)
    drag = table.numbers("drag", rotors, (0.0,) * rotors)
    _check_sizes(table, "drag")
    return Base(rotors, arms, thrust, drag, attitude, origin)


def _arms(table: Table, rotors: int | None) -> tuple[Body, ...]:
    if isinstance(listed := table.values.get("arm"), list):
        tables = table.tables("arm", MAX_ROTORS, "arms")
        if rotors is not None and rotors != len(listed) <= MAX_ROTORS:
            table.fault(
                "arm",
                f"a list of {len(listed)} for {rotors} rotors; give one table for all, or one each",
            )
        return tuple(_body(arm, length_required=True) for arm in tables)
    arm = table.table("arm")
    return () if arm is None else (_body(arm, length_required=True),)


def _thrust(table: Table, rotors: int) -> tuple[Vector3, ...]:
    default = alternating_thrust(rotors)
    if "thrust" not in table.values:
        return default
    entries = table.values["thrust"]
    if not isinstance(entries, list) or len(entries) != rotors:
        table.fault("thrust", f"must be a list of {rotors} directions, one per motor")
        return default
    return tuple(_direction(table, f"thrust[{k}]", entry) for k, entry in enumerate(entries))


def _direction(table: Table, key: str, entry: object) -> Vector3:
    if isinstance(entry, str):
        if entry not in AXES:
            table.fault(key, f'must be "x", "y", "z" or a direction [x, y, z], not {shown(entry)}')
        return AXES.get(entry, AXES["z"])
    x, y, z = table.check_numbers(key, entry, 3, AXES["z"])
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0.0:
        table.fault(key, "a direction of length zero; give at least one entry that is not 0")
        return AXES["z"]
    if abs(math.hypot(x, y, z) - 1.0) < 1e-15:  # A unit vector stays what it is, bit for bit.
        return (x, y, z)
    # Scaled by the largest entry first, so that tiny and huge vectors neither vanish nor overflow.
    x, y, z = x / largest, y / largest, z / largest
    norm = math.hypot(x, y, z)
    return (x / norm, y / norm, z / norm)


def _link(table: Table) -> Link:
    joint_keys = ("alpha_deg", "a", "d", "theta_deg", "joint")
    body = _body(table, joint_keys)
    _check_sizes(table, "a", "d")
    return Link(
        body=body,
        alpha_deg=table.angle("alpha_deg"),
        a=table.number("a", 0.0) if "a" in table.values else None,
        d=table.number("d", 0.0),
        theta_deg=table.angle("theta_deg"),
        joint=table.choice("joint", JOINT_KINDS, "revolute"),
    )


def _body(table: Table, other_keys: tuple[str, ...] = (), length_required: bool = False) -> Body:
    table.refuse_unknown((*other_keys, "length", *_ROD_KEYS, *_RIGID_KEYS))
    before = len(table.faults)
    if length_required and "length" not in table.values:
        table.fault("length", "missing: the distance from the base centre to the motor, in m")
    length = table.number("length", 0.0, least=0.0)
    _check_sizes(table, "length", *_ROD_KEYS, *_RIGID_KEYS)
    rigid = [key for key in _RIGID_KEYS if key in table.values]
    rod = [key for key in _ROD_KEYS if key in table.values]
    if rigid and rod:
        table.fault(
            rod[0],
            f"belongs to a rod, but {rigid[0]} describes a rigid body: give mass_per_length and "
            "section_inertia, or mass, com and inertia",
        )
    if not rigid:
        rod_body = _rod(table, length)
        if len(table.faults) == before:
            _check_inertia(table, rod_body.total_mass, "section_inertia", rod_body.section_inertia)
        return rod_body
    mass = table.number("mass", 0.0, least=0.0)
    if "mass" not in table.values:
        table.fault("mass", "missing: a rigid body needs its mass in kg")
    com = table.numbers("com", 3, (0.0, 0.0, 0.0))
    inertia = table.numbers("inertia", 6, (0.0,) * 6)
    if len(table.faults) == before:
        _check_inertia(table, mass, "inertia", inertia)
    xx, yy, zz, xy, xz, yz = inertia
    return RigidBody(length, mass, (com[0], com[1], com[2]), (xx, yy, zz, xy, xz, yz))


def _rod(table: Table, length: float) -> Rod:
    mass_per_length = table.number("mass_per_length", 0.0, least=0.0)
    x, y, z = table.numbers("section_inertia", 3, (0.0, 0.0, 0.0))
    return Rod(length, mass_per_length, (x, y, z))


def _check_sizes(table: Table, *keys: str) -> None:
    """Note finite numbers of sizes that cannot be computed with."""
    for key in keys:
        value = table.values.get(key)
        entries = value if isinstance(value, list) else [value]
        for i, entry in enumerate(entries):
            is_number = isinstance(entry, int | float) and abs(entry) <= sys.float_info.max
            if is_number and (fault := size_fault(float(entry))):
                table.fault(f"{key}[{i}]" if isinstance(value, list) else key, fault)


def _check_inertia(table: Table, mass: float, key: str, inertia: tuple[float, ...]) -> None:
    """Note an inertia that no body of this mass has; three numbers are a diagonal."""
    entries = (*inertia, 0.0, 0.0, 0.0) if len(inertia) == 3 else inertia
    if fault := inertia_fault(mass, entries):
        table.fault(key, fault)
