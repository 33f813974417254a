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


# The goals that were set for M and R together, and what M and R, M, R and forward dynamics take.
@pytest.mark.parametrize(
    ("links", "origin", "goal", "reached"),
    [
        (3, "centre", 430, (335, 134, 219, 366)),
        (3, "motor1", 450, (440, 192, 275, 397)),
        (7, "centre", 1130, (980, 501, 517, 1156)),
        (30, "centre", 9800, (8462, 6376, 2234, 5841)),
    ],
)
def test_operations_are_as_few_as_they_were(
    links: int, origin: Origin, goal: int, reached: tuple[int, ...]
) -> None:
    """Whoever finds a shorter way changes the numbers; whoever makes it longer is told."""
    program = derive(benchmark_robot(links, origin=origin)).program
    names = ("mass_matrix_and_residual", "mass_matrix", "residual", "forward_dynamics")
    found = [count_operations(program.function(name).nodes()) for name in names]
    assert tuple(counted.total for counted in found) == reached
    assert reached[0] <= goal
    assert found[0].sine_cosine_pairs == links + (2 if origin == "centre" else 3)


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
