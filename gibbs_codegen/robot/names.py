"""Names: which ones robots may have, and what their links, rotors and coordinates are called.

A robot's name becomes a Python package and a prefix in C. Names in C are `<name>_<function>` and
`<NAME>_<SIZE>`, so that words of C, macros of compilers and functions of libraries are harmless as
names of robots. So are those of headers and of other Python modules: emitted sources include their
own header by its place, and `load` imports a module by its folder. What is left cannot work, and is
refused on every platform alike.

Links, rotors, frames and coordinates may be named with any text. Generated code has the identifier
form of it.
"""

from __future__ import annotations

import itertools
import keyword
import re

from gibbs_codegen.errors import printable
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.link import LinkKind
from gibbs_codegen.robot.parts.ties import Tie

JOINT_LETTERS: dict[LinkKind, str] = {"revolute": "theta", "prismatic": "d", "fixed": "theta"}
# Parameters of a link that is named like an argument must not be called like its entries, v_x; nor
# in C like the places of frames and bodies.
_ARGUMENTS = {"q", "v", "a", "u", "w", "q0", "q1", "q_dot", "v_dot", "a_dot", "f", "b"}
# Entries of weights of matrices, w_B_x_F_1.
_ARGUMENTS |= {"w_b", "w_j"}
NAME_PATTERN = "^[a-z][a-z0-9_]{0,63}$"
# How names of constraint torques begin, and no coordinate's.
CONSTRAINT_TORQUES = "tau_prime_"

_WINDOWS_DEVICE = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9]")

# With these a C function of one robot could have the name of another robot's, since some functions
# have names that end in those of others.
_ENDINGS = {"_default", "_init"} | {
    f"_{longer[: -len(shorter) - 1]}"
    for longer, shorter in itertools.permutations(FUNCTIONS, 2)
    if longer.endswith(f"_{shorter}")
}


def name_fault(name: str) -> str | None:
    """Why a text is refused as a robot's name and what would be right; None if it is accepted."""
    shown = ascii(name if len(name) <= 64 else name[:61] + "...")
    if not re.fullmatch(NAME_PATTERN, name, re.ASCII):
        return (
            f"{shown} is not a name for a module: use a lower-case letter, then lower-case "
            "letters, digits and _, at most 64 in all"
        )
    if keyword.iskeyword(name):
        why = "is a keyword of Python and cannot name a module"
    elif name == "numpy":
        why = "is the package that the generated module itself imports"
    elif name == "gibbs_runtime":
        why = "is the name of a header in every module"
    elif _WINDOWS_DEVICE.fullmatch(name):
        why = "cannot be a folder's name on Windows"
    elif ending := next(filter(name.endswith, _ENDINGS), None):
        why = f"ends in {ending}, which may clash with names of C functions"
    else:
        return None
    return f"{shown} {why}; add a word, e.g. {name}_arm"


def name_from(text: str) -> str:
    """A name that is accepted, as close as can be to a text such as the name of a file."""
    letters = re.sub(r"[^a-z0-9_]+", "_", text.lower(), flags=re.ASCII).strip("_")
    if not letters[:1].isalpha():
        letters = f"robot_{letters}".rstrip("_")
    name = letters[:64]
    return name if name_fault(name) is None else f"{name[:58]}_robot"


def identifier(text: str) -> str:
    """The identifier form of a name: what is not an ASCII letter, a digit or _ becomes _.

    It begins with _ where it would begin with a digit.
    """
    form = re.sub(r"\W", "_", text, flags=re.ASCII)
    return f"_{form}" if form[:1].isdigit() else form


def joint_name(kind: LinkKind, number: int) -> str:
    """Name of a joint's coordinate that the file does not name, such as theta_7 or d_8.

    `number` is N + i for link i.
    """
    return f"{JOINT_LETTERS[kind]}_{number}"


def coordinate_of(robot: Robot, i: int) -> str:
    """Identifier of the coordinate of link i's joint, i from 1.

    That is of the link's coordinate or else of its name; without either theta_{N+i} or d_{N+i}.
    """
    link = robot.links[i - 1]
    name = link.coordinate or link.name
    return identifier(name) if name else joint_name(link.joint, robot.rotors + i)


def link_label(robot: Robot, i: int) -> str:
    """The name of link i, from 1, in messages: its own in a safe form, or such as "link 2"."""
    return printable(robot.links[i - 1].name or f"link {i}")


def rotor_label(robot: Robot, k: int) -> str:
    """The name of rotor k, from 1, in messages: its own in a safe form, or its number."""
    name = robot.thrusters[k - 1].name if robot.thrusters else None
    return printable(name or k)


def default_prefix(kind: str, number: int) -> str:
    """The name of a "link" or "rotor" that has none, in code and files, such as link2."""
    return f"{kind}{number}"


def parameter_prefix(robot: Robot, i: int) -> str:
    """The begin of parameters of link i, from 1: its name as identifier, or such as link2."""
    name = robot.links[i - 1].name
    return named_prefix(name) if name else default_prefix("link", i)


def named_prefix(name: str) -> str:
    """The begin of the parameters of a link or rotor with a name.

    That is its identifier form, which ends in _ where it would be the name of an argument.
    """
    form = identifier(name)
    return f"{form}_" if form.lower() in _ARGUMENTS else form


def rotor_prefix(robot: Robot, k: int) -> str:
    """The begin of parameters of placed rotor k, from 1: its name as identifier, or rotor2."""
    name = robot.thrusters[k - 1].name
    return named_prefix(name) if name else default_prefix("rotor", k)


def frame_prefix(name: str) -> str:
    """The begin of the parameters of a frame, such as frame_gripper."""
    return f"frame_{identifier(name)}"


def tie_prefix(tie: Tie) -> str:
    """The begin of the parameters of a tie, such as constraint_grip."""
    return f"{tie.array}_{identifier(tie.name)}"


def joint_label(robot: Robot, i: int) -> str:
    """The name of link i's joint in messages: "joint 8", or "the joint of forearm"."""
    name = robot.links[i - 1].name
    return f"the joint of {identifier(name)}" if name else f"joint {robot.rotors + i}"


def rotor_identifier(robot: Robot, k: int) -> str:
    """The name of the input of rotor k, from 1, after F_: the rotor's, or its number."""
    name = robot.thrusters[k - 1].name if robot.thrusters else None
    return identifier(name) if name else str(k)
