"""Decomposition into open chains (eq. 1) and the two "once" rules."""

from __future__ import annotations

from collections import Counter

import pytest

from gibbs_codegen.robot.chains import coupling_map, decompose
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.family import paper_family

ROBOTS = [(2, 0), (2, 1), (6, 3), (10, 7), (40, 2)]


@pytest.mark.parametrize(("rotors", "links"), ROBOTS)
def test_mass_once_and_thrust_once(rotors: int, links: int) -> None:
    chains = decompose(paper_family(rotors, links))
    assert len(chains) == rotors
    masses = Counter(link for chain in chains for link in chain.massive)
    thrusts = Counter(motor for chain in chains for motor in chain.motors)
    assert masses == Counter(range(1, rotors + links + 1))
    assert thrusts == Counter(range(1, rotors + 1))
    assert chains[0].massive[0] == chains[0].motors[0] == 1


@pytest.mark.parametrize(("rotors", "links"), ROBOTS)
def test_chains_start_at_the_virtual_links(rotors: int, links: int) -> None:
    chains = decompose(paper_family(rotors, links))
    assert all(chain.links[:3] == (-1, 0, 1) for chain in chains)
    assert [chain.links[3:] for chain in chains[:-1]] == [(k,) for k in range(2, rotors + 1)]
    assert chains[-1].links[3:] == tuple(range(rotors + 1, rotors + links + 1))


@pytest.mark.parametrize(("rotors", "links"), ROBOTS)
def test_equations_and_unknowns_are_as_many_as_the_paper_says(rotors: int, links: int) -> None:
    *constrained, free = decompose(paper_family(rotors, links))
    assert all(len(c.coordinates) == 7 and len(c.unknowns) == 8 for c in constrained)
    assert len(free.coordinates) == len(free.unknowns) == 6 + links


@pytest.mark.parametrize(("rotors", "links"), ROBOTS)
def test_coupling_map_reaches_every_hybrid_unknown(rotors: int, links: int) -> None:
    robot = paper_family(rotors, links)
    reached = {place for places in coupling_map(robot) for place in places}
    assert reached == set(range(len(Description(robot).hybrid_coordinates)))
    assert len(reached) == 6 + links + 2 * (rotors - 1)
