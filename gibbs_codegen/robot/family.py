"""The paper's family of robots, for any number of rotors and links (Table 1)."""

from __future__ import annotations

from fractions import Fraction

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base, alternating_thrust
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.parts.link import MAX_LINKS, Link
from gibbs_codegen.robot.parts.numbers import Vector3
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS

_SECTION_INERTIA: Vector3 = (212e-8, 21.2e-8, 190.8e-8)
_BASE_ARM = Rod(length=0.5, mass_per_length=1.0, section_inertia=_SECTION_INERTIA)
_ARM_LINK = Rod(length=3.0, mass_per_length=1.0, section_inertia=_SECTION_INERTIA)

_GREEK = {4: "quadrotor", 6: "hexarotor", 8: "octorotor", 10: "decarotor"}


def paper_family(rotors: int, links: int) -> Robot:
    """Member of the paper's family: Table 1 with other numbers of rotors and links.

    The arm's first link has no length or mass and turns about the base normal; n − 1 parallel
    links (α = 90°, then 0) of 3 m and 1 kg/m follow. A single link is one such 3 m link with
    α = 90°.

    Args:
        rotors: N, from 2 to 256.
        links: n, from 0 to 64.

    Returns:
        The robot.

    Raises:
        UsageError: If a number is out of its range.
    """
    if not 2 <= rotors <= MAX_ROTORS:
        raise UsageError(f"rotors must be from 2 to {MAX_ROTORS}, not {rotors}")
    if not 0 <= links <= MAX_LINKS:
        raise UsageError(f"links must be from 0 to {MAX_LINKS}, not {links}")
    base = Base(
        rotors=rotors, arms=(_BASE_ARM,), thrust=alternating_thrust(rotors), drag=(0.0,) * rotors
    )
    # A column without length; a lone link stands upright without it.
    further = (Link(_ARM_LINK),) * max(links - 2, 0)
    arm = (Link(Rod(length=0.0)), Link(_ARM_LINK, alpha_deg=Fraction(90)), *further)
    return Robot(
        f"{_GREEK.get(rotors, f'rotor{rotors}')}_{links}link",
        base,
        arm[:links] if links > 1 else arm[1 : 1 + links],
    )
