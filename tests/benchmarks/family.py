"""The family of machines that operation counts and times are quoted for.

Free base of six 0.5 m rods, position at its centre, attitude x-y-z; an arm of n revolute joints at
the centre: link 1 has no length and no mass and turns about the base normal, links 2 … n are rods
of 6/(n − 1) m and 1 kg/m with α = 90°, 0°, 90°, 0°, …
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.model import Link, Origin, Robot, Rod


def benchmark_robot(links: int, rotors: int = 6, origin: Origin = "centre") -> Robot:
    """Member of the family with n = `links` ≥ 2."""
    paper = paper_family(rotors, 2)
    section = paper.base.arm(1).section_inertia
    rod = Rod(6.0 / (links - 1), 1.0, section)
    arm = tuple(Link(rod, alpha_deg=Fraction(0 if i % 2 else 90)) for i in range(links - 1))
    name = f"benchmark_{rotors}_{links}"
    return Robot(name, replace(paper.base, origin=origin), (Link(Rod(0.0)), *arm))
