"""Which modules are mutated, and which tests are to find the faults, the quickest first.

The comparison of the committed modules byte by byte, `test_generated.py`, is left out on purpose:
it finds every change, a fault or not, so it says nothing about whether the others would.
"""

from __future__ import annotations

from dataclasses import dataclass

DERIVATION = (
    *("gibbs", "kinematics", "serial", "root", "inertia", "machine", "equations", "forces"),
    *("articulated", "articulated_inertia", "forward", "ldlt", "geometry", "structural"),
    *("parameters", "vectors", "tape", "chains", "arrangement"),
)
COMBINE = ("combine",)
EMISSION = (
    *("program", "lower", "trigonometry", "pieces", "rolling", "runs", "slots", "printers"),
    *("numpy_target", "c_target", "c_function", "describe", "emit"),
)
# The other templates are declarations and text.
TEMPLATES = ("c_casadi.c.jinja", "c_source.c.jinja", "numpy_module.py.jinja")
GROUPS = {
    "derivation": DERIVATION,
    "combine": COMBINE,
    "emission": EMISSION,
    "templates": TEMPLATES,
}

_QUICK_DERIVATION = (
    "tests/test_gibbs.py",
    "tests/test_inertia.py",
    "tests/test_tape.py",
    "tests/test_chains.py",
    "tests/test_arrangement.py",
    "tests/test_structural.py",
    "tests/test_operation_counts.py::test_operations_are_as_few_as_they_were[3-centre-430-reached0]",
    "tests/test_closed_form.py::test_every_chain_of_the_papers_robot[6]",
    "tests/test_combine.py::test_chain_five_takes_the_rows_that_the_paper_names",
    "tests/test_combine.py::test_hybrid_system_gives_the_reduced_accelerations",
    "tests/test_pinocchio.py::test_shipped_robots",
)
_REST_OF_DERIVATION = (
    "tests/test_operation_counts.py",
    "tests/test_articulated.py",
    "tests/test_combine.py",
    "tests/test_closed_form.py",
    "tests/test_numpy_module.py",
    "tests/test_physics.py",
    "tests/test_pinocchio.py::test_random_robots[numbers0]",
    "tests/test_pinocchio.py::test_family",
    "tests/test_pinocchio.py::test_keeping_zero_parameters_changes_nothing",
)
_QUICK_EMISSION = (
    "tests/test_describe.py",
    "tests/test_printers.py",
    "tests/test_program.py",
    "tests/test_trigonometry.py",
    "tests/test_pieces.py",
    "tests/test_numpy_module.py",
    "tests/test_pinocchio.py::test_shipped_robots[quadrotor_2link]",
    "tests/test_c_source.py::test_functions_equal_numpy[quadrotor_2link-gcc--O3-march=native]",
    "tests/test_c_source.py::test_functions_equal_numpy[random_4_3-gcc--O0]",
    "tests/test_c_source.py::test_small_robot_compiles_silently[gcc-double--O0]",
)
_REST_OF_EMISSION = (
    "tests/test_emit.py",
    "tests/test_operation_counts.py",
    "tests/test_pinocchio.py::test_shipped_robots",
    "tests/test_c_source.py",
    "tests/test_c_backend.py",
)
_MORE = {
    "tape": ("tests/test_program.py",),
    "arrangement": ("tests/test_cli.py",),
    "rolling": ("tests/test_rolling.py",),
    "runs": ("tests/test_rolling.py",),
    "slots": ("tests/test_rolling.py",),
    "pieces": ("tests/test_rolling.py",),
    "c_source.c.jinja": ("tests/test_sine_cosine.py",),
    "c_function": ("tests/test_embedded.py",),
    "emit": ("tests/test_cli.py",),
}


@dataclass(frozen=True)
class Suite:
    """Tests by name, in two goes: most faults are found by the first."""

    quick: tuple[str, ...]
    rest: tuple[str, ...]


def suite_of(module: str) -> Suite:
    """The tests that concern a module or a template."""
    if module in DERIVATION + COMBINE:
        return Suite(_QUICK_DERIVATION, (*_MORE.get(module, ()), *_REST_OF_DERIVATION))
    return Suite(_QUICK_EMISSION, (*_MORE.get(module, ()), *_REST_OF_EMISSION))
