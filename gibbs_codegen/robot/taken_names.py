"""Which names are taken in generated code, so that no two things of a robot share one there.

A name takes its identifier form among the names of its kind, and the names of all parameters that
such a thing may have.
"""

from __future__ import annotations

from typing import Literal

from gibbs_codegen.files.faults import shown
from gibbs_codegen.robot.layout import BASE_ENTRIES
from gibbs_codegen.robot.names import (
    CONSTRAINT_TORQUES,
    frame_prefix,
    identifier,
    joint_name,
    named_prefix,
)

# A link is a rigid one unless it is a rod; a joint stands for its coordinate.
NamedKind = Literal["base", "arm", "link", "rod", "rotor", "frame", "joint"]

_AXES = ("x", "y", "z")
_DIAGONAL = ("xx", "yy", "zz")
_ROD = ("length", "mass_per_length", *(f"section_inertia_{axes}" for axes in _DIAGONAL))
_RIGID = (
    *("length", "mass", *(f"com_{axis}" for axis in _AXES)),
    *(f"inertia_{axes}" for axes in (*_DIAGONAL, "xy", "xz", "yz")),
)
_JOINT = (*_AXES, "a", "d", "damping", "armature", "stiffness", "rest")
# How names of parameters end, after the prefix of what they belong to.
_ENDS: dict[NamedKind, tuple[str, ...]] = {
    "base": _RIGID,
    "arm": (*_RIGID, *_ROD),
    "link": (*_JOINT, *_RIGID),
    "rod": (*_JOINT, *_ROD),
    "rotor": (*_AXES, "drag"),
    "frame": _AXES,
    "joint": (),
}


class TakenNames:
    """Names that a robot has given, and whose they are; at first only those of its base."""

    def __init__(self, rods: int = 0) -> None:
        self._owners: dict[str, str] = {}
        self.take("base", "base", "the base")
        self.take("frame", "base", "the base's own frame")
        for k in ("", *range(1, rods + 1)) if rods else ():
            self.take("arm", f"base_arm{k}", "the base's arms")
        for entry in BASE_ENTRIES:
            self.take("joint", entry, "a coordinate of the base")
        for k in range(2, rods + 1):
            self.take("joint", joint_name("fixed", k), f"the angle of base arm {k}")

    def take(self, kind: NamedKind, name: str, whose: str) -> None:
        """Note that a name of a kind is given, and whose it is, in words."""
        for taken in (_form(kind, name), *parameter_names(kind, name)):
            self._owners.setdefault(taken, whose)

    def owner(self, kind: NamedKind, name: str) -> str | None:
        """Whose a name is, in words, or None where it is free among the names of its kind."""
        return self._owners.get(_form(kind, name))

    def fault(self, kind: NamedKind, name: str) -> str | None:
        """Why a name cannot be given and what would be right, or None where it can."""
        form = identifier(name)
        if kind == "joint" and form.startswith(CONSTRAINT_TORQUES):
            return f"{shown(name)} begins as constraint torques do: give it another name"
        if owner := self.owner(kind, name):
            called = shown(name) if form == name else f"{shown(name)}, in generated code {form},"
            return f"{called} is the name of {owner} already; give another"
        for parameter in parameter_names(kind, name):
            if owner := self._owners.get(parameter):
                return (
                    f"{shown(name)} gives parameters the names of those of {owner}, such as "
                    f"{parameter}: give it another name"
                )
        return None


def _form(kind: NamedKind, name: str) -> str:
    """The identifier form with the kind, of which the base, arms, links and rotors are one."""
    return f"{kind if kind in ('frame', 'joint') else 'body'} {identifier(name)}"


def parameter_names(kind: NamedKind, name: str) -> list[str]:
    """Identifiers of all parameters that something may have.

    Its name is the prefix, such as link2, of a link or rotor without one.
    """
    prefix = frame_prefix(name) if kind == "frame" else named_prefix(name)
    return [f"{prefix}_{end}" for end in _ENDS[kind]]
