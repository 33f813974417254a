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
    "tests/test_closed_form.py::test_every_chain_of_the_papers_robot[6]",
    "tests/test_combine.py::test_chain_five_takes_the_rows_that_the_paper_names",
    "tests/test_combine.py::test_constrained_chain_has_the_form_of_eq_15",
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
    "tests/test_c_source.py::test_functions_equal_numpy[rolled-gcc--O0]",
    "tests/test_c_source.py::test_small_robot_compiles_silently[gcc-double--O0]",
)
_QUICK_ARTICULATED = (
    "tests/test_articulated.py::test_rotation",
    "tests/test_articulated.py::test_shift",
    "tests/test_articulated.py::test_schur_complement",
    "tests/test_articulated.py::test_ldlt_solves_and_its_operations_are_known_before",
    "tests/test_articulated.py::test_both_ways_give_what_pinocchio_gives[0]",
    *_QUICK_DERIVATION,
)
_QUICK_LOOPS = ("tests/test_pieces.py", "tests/test_rolling.py")
_QUICK = {
    "articulated": _QUICK_ARTICULATED,
    "articulated_inertia": _QUICK_ARTICULATED,
    "forward": _QUICK_ARTICULATED,
    "ldlt": _QUICK_ARTICULATED,
    "arrangement": ("tests/test_arrangement.py",),
    "pieces": _QUICK_LOOPS,
    "rolling": _QUICK_LOOPS,
    "runs": _QUICK_LOOPS,
    "slots": _QUICK_LOOPS,
    "c_casadi.c.jinja": ("tests/test_c_backend.py::test_casadi_takes_the_same_library",),
}
_SHIPPED = "tests/test_pinocchio.py::test_shipped_robots"
_EMITTED = "tests/test_emit.py"
_COUNTS = ("tests/test_operation_counts.py", "tests/test_articulated.py")
_LOOPS = ("tests/test_c_source.py", "tests/test_c_backend.py")
_IN_C = ("tests/test_c_source.py", "tests/test_c_backend.py", "tests/test_embedded.py")
_REST = {
    "tape": ("tests/test_program.py", *_REST_OF_DERIVATION),
    "arrangement": ("tests/test_cli.py",),
    "program": (*_COUNTS, _SHIPPED),
    "lower": (*_COUNTS, _SHIPPED, _EMITTED),
    "trigonometry": ("tests/test_c_source.py",),
    "pieces": _LOOPS,
    "rolling": _LOOPS,
    "runs": _LOOPS,
    "slots": _LOOPS,
    "printers": (_EMITTED, _SHIPPED, *_IN_C),
    "numpy_target": (_EMITTED, _SHIPPED, "tests/test_c_backend.py"),
    "c_target": (_EMITTED, *_IN_C),
    "c_function": (_EMITTED, *_IN_C),
    "describe": (_EMITTED, "tests/test_c_source.py"),
    "emit": (_EMITTED, "tests/test_cli.py", "tests/test_c_source.py"),
    "c_casadi.c.jinja": ("tests/test_c_backend.py", "tests/test_c_source.py"),
    "c_source.c.jinja": (*_IN_C, "tests/test_sine_cosine.py"),
    "numpy_module.py.jinja": (_EMITTED, "tests/test_c_backend.py"),
}


@dataclass(frozen=True)
class Suite:
    """Tests by name, in two goes: most faults are found by the first."""

    quick: tuple[str, ...]
    rest: tuple[str, ...]


def suite_of(module: str) -> Suite:
    """The tests that concern a module or a template."""
    usual = _QUICK_DERIVATION if module in DERIVATION + COMBINE else _QUICK_EMISSION
    return Suite(_QUICK.get(module, usual), _REST.get(module, _REST_OF_DERIVATION))
