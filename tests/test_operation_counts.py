"""Operation counts are exact, so they are asserted: the goals that were set."""

from __future__ import annotations

import pytest
from benchmarks.family import benchmark_robot

from gibbs_codegen.model import derive
from gibbs_codegen.program import count_operations
from gibbs_codegen.robot import Origin

REDUCED = (
    "mass_matrix_and_residual",
    "mass_matrix",
    "residual",
    "inverse_dynamics",
    "gibbs",
    "kinetic_energy",
    "potential_energy",
    "tip_pose",
    "tip_jacobian",
    "tip_bias_acceleration",
)


def counts(links: int, rotors: int = 6, origin: Origin = "centre") -> dict[str, int]:
    program = derive(benchmark_robot(links, rotors, origin)).program
    return {f.name: count_operations(f.nodes()).total for f in program.functions}


@pytest.mark.parametrize(("links", "goal"), [(3, 430), (7, 1130), (30, 9800)])
def test_mass_matrix_and_residual(links: int, goal: int) -> None:
    function = derive(benchmark_robot(links)).program.function("mass_matrix_and_residual")
    found = count_operations(function.nodes())
    assert found.total <= goal
    assert found.sine_cosine_pairs <= links + 3


def test_forty_rotors_cost_the_same_as_four() -> None:
    four, forty = counts(3, rotors=4), counts(3, rotors=40)
    for name in REDUCED:
        assert four[name] == forty[name], name


@pytest.mark.parametrize("rotors", [3, 5, 7, 11])
def test_sums_over_the_arms_vanish_for_every_rotor_count(rotors: int) -> None:
    """Also where the constrained angles are no multiples of 30° or 45°."""
    expected, found = counts(2, rotors=6), counts(2, rotors=rotors)
    for name in REDUCED:
        assert found[name] == expected[name], name
