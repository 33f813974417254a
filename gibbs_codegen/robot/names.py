"""Which robot names may become a Python package and a prefix in C.

Names in C are `<name>_<function>` and `<NAME>_<SIZE>`, so that words of C, macros of compilers and
functions of libraries are harmless as names of robots. So are those of headers and of other Python
modules: emitted sources include their own header by its place, and `load` imports a module by its
folder. What is left cannot work, and is refused on every platform alike.
"""

from __future__ import annotations

import itertools
import keyword
import re

from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.robot.model import Robot

NAME_PATTERN = "^[a-z][a-z0-9_]{0,63}$"

_WINDOWS_DEVICE = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9]")

# With these a C function of one robot could have the name of another robot's, since some functions
# have names that end in those of others.
_ENDINGS = {"_casadi", "_default", "_init"} | {
    f"_{longer[: -len(shorter) - 1]}"
    for longer, shorter in itertools.permutations(FUNCTIONS, 2)
    if longer.endswith(f"_{shorter}")
}


def name_fault(name: str) -> str | None:
    """Why a text is refused as a robot's name.

    Args:
        name: The text.

    Returns:
        What is wrong with it and what would be right, or None where it is accepted.
    """
    shown = ascii(name if len(name) <= 64 else name[:61] + "...")
    if not re.fullmatch(NAME_PATTERN, name, re.ASCII):
        return (
            f"{shown} is not a name for a module: use a lower-case letter, then lower-case "
            "letters, digits and _, at most 64 in all"
        )
    if keyword.iskeyword(name):
        why = "is a keyword of Python, which no module can be named"
    elif name == "numpy":
        why = "is the package that the generated module itself imports"
    elif _WINDOWS_DEVICE.fullmatch(name):
        why = "cannot be a folder's name on Windows"
    elif ending := next(filter(name.endswith, _ENDINGS), None):
        why = f"ends in {ending}, as the names of C functions go on"
    else:
        return None
    return f"{shown} {why}; add a word, e.g. {name}_arm"


def name_from(text: str) -> str:
    """A name that is accepted, as close to a text as can be.

    Args:
        text: The text, such as the name of a file.

    Returns:
        The name.
    """
    letters = re.sub(r"[^a-z0-9_]+", "_", text.lower(), flags=re.ASCII).strip("_")
    if not letters[:1].isalpha():
        letters = f"robot_{letters}".rstrip("_")
    name = letters[:64]
    return name if name_fault(name) is None else f"{name[:58]}_robot"


def identifier(text: str) -> str:
    """The form that a name has in code: what is not a letter, digit or _ becomes _.

    Args:
        text: Any text.

    Returns:
        The text in letters of ASCII, digits and _, which does not begin with a digit.
    """
    letters = re.sub(r"[^A-Za-z0-9_]", "_", text, flags=re.ASCII)
    return f"_{letters}" if letters[:1].isdigit() else letters


def coordinate_of(robot: Robot, i: int) -> str:
    """Name of the coordinate of a link's joint.

    Args:
        robot: The robot.
        i: Number of the link, from 1.

    Returns:
        The link's `coordinate`, else its name, else θ or d with the number of the joint.
    """
    link = robot.links[i - 1]
    if text := link.coordinate or link.name:
        return identifier(text)
    return f"{'d' if link.joint == 'prismatic' else 'theta'}_{robot.rotors + i}"


def link_label(robot: Robot, i: int) -> str:
    """What people call a body.

    Args:
        robot: The robot.
        i: Number of the link, or 0 for the base.

    Returns:
        The link's name, or "link 2".
    """
    if i == 0:
        return "the base"
    return robot.links[i - 1].name or f"link {i}"


def joint_label(robot: Robot, i: int) -> str:
    """What people call a joint.

    Args:
        robot: The robot.
        i: Number of its link, from 1.

    Returns:
        Words such as "joint 8" or "the joint of forearm".
    """
    link = robot.links[i - 1]
    return f"the joint of {link.name}" if link.name else f"joint {robot.rotors + i}"


def rotor_label(robot: Robot, k: int) -> str:
    """What people call a rotor.

    Args:
        robot: The robot.
        k: Number of the rotor, from 1.

    Returns:
        Its name, or its number.
    """
    named = robot.thrusters[k - 1].name if robot.thrusters else None
    return named or str(k)


def rotor_identifier(robot: Robot, k: int) -> str:
    """What the input of a rotor is called after F_.

    Args:
        robot: The robot.
        k: Number of the rotor, from 1.

    Returns:
        Its name as an identifier, or its number.
    """
    named = robot.thrusters[k - 1].name if robot.thrusters else None
    return identifier(named) if named else str(k)


def parameter_prefix(robot: Robot, i: int) -> str:
    """What the names of a link's parameters begin with.

    Args:
        robot: The robot.
        i: Number of the link, from 1.

    Returns:
        Its name as an identifier, or "link2".
    """
    name = robot.links[i - 1].name
    return identifier(name) if name else f"link{i}"
