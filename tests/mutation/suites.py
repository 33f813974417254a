"""Which modules are mutated, and which tests are to find the faults, the quickest first.

Tests that derive and emit a module concern all of the generator that made it; for its rooms they
are named here. Elsewhere a fault's tests are those that execute its line, as `record.py` tells.
The comparison of the committed modules byte by byte, `properties/test_generated.py`, is left out on
purpose: it finds every change, a fault or not, so it says nothing about whether the others would.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mutation.record import PACKAGE, Record


def _in(folder: str, modules: str) -> tuple[str, ...]:
    return tuple(f"{folder}.{module}" for module in modules.split())


DERIVATION = (
    *_in("derivation", "functions gibbs motion inertia symbolic_robot segment_tree tree_dynamics"),
    *_in("derivation", "forces articulated forward_dynamics forward_kinematics parameters"),
    *_in("derivation", "jointed_bodies wrenches"),
    *_in("derivation.root", "quaternion tait_bryan"),
    *_in("symbolic", "ldlt structural vectors tape"),
    *_in("robot", "balance chains layout wrenches"),
)
COMBINE = ("derivation.hybrid",)
EMISSION = (
    *_in("program", "nodes lower inlining trigonometry steps loops scratch patterns"),
    *_in("targets", "printers documentation registry"),
    *_in("targets.c", "target function sparse statements laws"),
    *_in("targets.matlab", "target statements"),
    *_in("targets.numpy", "target statements"),
    *_in("runtime", "kernels casadi_backend jax_backend acados"),
    "emitted.evaluation",
    "emitted.preparation",
)
ARRAYS, MACHINE = (
    tuple(
        f"{folder}.{path.stem}"
        for path in sorted((PACKAGE / folder).glob("*.py"))
        if path.stem != "__init__"
    )
    for folder in ("arrays", "machine")
)
# The other templates are declarations and text, and so are the other files of `emitted`.
TEMPLATES = (
    *("c_source.c.jinja", "c_batch.c.jinja", "c_each.c.jinja", "numpy_module.py.jinja"),
    *("arctangent.c", "blocks.c", "exactness.c", "gather.c", "literals.c"),
    *("sine_cosine.c", "sine_cosine_kernel.c"),
)
# Functions that stand in every MATLAB package.
MATLAB = ("changed_parameters.m", "check_constants.m", "product.m", "states.m")


@dataclass(frozen=True)
class Suite:
    """Tests by name, in two goes: most faults are found by the first."""

    quick: tuple[str, ...]
    rest: tuple[str, ...]


_FLYING = Suite(
    (
        "tests/flight/integration/test_compiled_loop.py",
        "tests/flight/integration/test_compiled_limits.py",
        "tests/flight/integration/test_block_loop.py",
    ),
    ("tests/flight/test_any_robot.py", "tests/flight/test_many.py"),
)
_ROLLING = Suite(
    (
        "tests/flight/rollouts/test_c_rollout.py",
        "tests/flight/rollouts/test_rollout.py",
        "tests/flight/rollouts/test_c_program.py",
    ),
    ("tests/flight/rollouts", "tests/verification/test_verify.py"),
)
# C that runs in flights and rollouts, and the back ends' own, with the tests that run it.
NATIVE = {
    "adaptive.c": _FLYING,
    "allocation.c": _FLYING,
    "curves.c": _FLYING,
    "engine.c": _FLYING,
    "lanes.c": _FLYING,
    "numbers.c": _FLYING,
    "sine_cosine_numbers.c": _FLYING,
    "smallest_thrusts.c": _FLYING,
    "rollout.c": _ROLLING,
    "rows.c": _ROLLING,
    "runtime/native/rows.c": Suite(
        ("tests/runtime/test_c_backend.py", "tests/runtime/test_constants_per_state.py"),
        ("tests/runtime/test_not_finite.py", "tests/runtime/test_own_law.py"),
    ),
    "runtime/native/caller.c": Suite(
        ("tests/runtime/test_c_backend.py", "tests/runtime/test_not_finite.py"),
        ("tests/runtime/test_arguments.py", "tests/runtime/test_constants_per_state.py"),
    ),
    "runtime/native/jax_call.c": Suite(
        ("tests/runtime/test_jax_backend.py",), ("tests/flight/rollouts/test_jax_rollout.py",)
    ),
}
NAMED = {
    "derivation": DERIVATION,
    "combine": COMBINE,
    "emission": EMISSION,
    "arrays": ARRAYS,
    "machine": MACHINE,
    "templates": TEMPLATES,
    "matlab": MATLAB,
    "native": tuple(NATIVE),
}
_ALL_NAMED = {module for modules in NAMED.values() for module in modules}


def _rooms() -> dict[str, tuple[str, ...]]:
    """The modules of every folder of the package, without those that are named above."""
    rooms: dict[str, list[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        module = ".".join(parts)
        if parts[-1] not in ("__init__", "__main__", "version") and module not in _ALL_NAMED:
            rooms.setdefault(".".join(parts[:-1]) or "package", []).append(module)
    return {f"{room}.*": tuple(modules) for room, modules in rooms.items()}


GROUPS = NAMED | _rooms()

_QUICK_DERIVATION = (
    "tests/derivation/test_gibbs.py",
    "tests/derivation/test_motion.py",
    "tests/derivation/test_inertia.py",
    "tests/symbolic/test_tape.py",
    "tests/robot/test_chains.py",
    "tests/robot/test_thrusters.py",
    "tests/symbolic/test_exact_angles.py",
    "tests/derivation/test_tree.py::test_words_for_a_subtree",
    "tests/derivation/test_tree.py::test_a_tree_knows_its_paths_and_subtrees",
    "tests/derivation/test_articulated.py::test_operations",
    "tests/derivation/test_tree.py::test_both_forward_dynamics_and_trees_that_are_not_regrouped",
    "tests/equations/test_closed_form.py::test_every_chain_of_the_papers_robot",
    "tests/derivation/test_hybrid.py::test_chain_five_takes_the_rows_that_the_paper_names",
    "tests/derivation/test_hybrid.py::test_constrained_chain_has_the_form_of_eq_15",
    "tests/derivation/test_hybrid.py::test_hybrid_system_gives_the_reduced_accelerations",
    "tests/properties/test_operation_counts.py::test_operations_are_as_few_as_they_were",
    "tests/derivation/test_articulated.py::test_both_ways_give_what_pinocchio_gives[0]",
    "tests/properties/test_pinocchio.py::test_shipped_robots",
    "tests/properties/test_quaternion.py::test_random_robots",
)
_REST_OF_DERIVATION = (
    "tests/properties/test_operation_counts.py",
    "tests/derivation/test_articulated.py",
    "tests/derivation/test_tree.py",
    "tests/derivation/test_hybrid.py",
    "tests/equations/test_closed_form.py",
    "tests/targets/test_numpy.py",
    "tests/properties/test_physics.py",
    "tests/properties/test_pinocchio.py::test_random_robots[numbers0]",
    "tests/properties/test_pinocchio.py::test_family",
    "tests/properties/test_pinocchio.py::test_keeping_zero_parameters_changes_nothing",
)
_QUICK_EMISSION = (
    "tests/targets/test_documentation.py",
    "tests/targets/test_printers.py",
    "tests/targets/test_c_statements.py",
    "tests/targets/test_numpy_statements.py",
    "tests/targets/test_matlab.py",
    "tests/program/test_nodes.py",
    "tests/program/test_trigonometry.py",
    "tests/program/test_steps.py",
    "tests/program/test_worked_examples.py",
    "tests/targets/test_numpy.py",
    "tests/properties/test_pinocchio.py::test_shipped_robots[quadrotor_2link]",
    "tests/targets/test_c_source.py::test_lengths_in_the_header_are_those_of_the_lists",
    "tests/targets/test_c_source.py::test_parameters_that_are_no_numbers_are_refused",
    "tests/targets/test_c_source.py::test_functions_equal_numpy",
    "tests/targets/test_c_source.py::test_symbols_and_stack",
)
_QUICK_ARTICULATED = (
    "tests/derivation/test_articulated.py::test_rotation",
    "tests/derivation/test_articulated.py::test_shift",
    "tests/derivation/test_articulated.py::test_schur_complement",
    "tests/derivation/test_articulated.py::test_ldlt_solves_and_its_operations_are_known_before",
    *_QUICK_DERIVATION,
)
_QUICK_LOOPS = (
    "tests/program/test_steps.py",
    "tests/program/test_loops.py",
    "tests/program/test_worked_examples.py",
)
_REST_OF_ARRAYS = (
    *("tests/targets/test_laws.py", "tests/targets/test_fmu.py", "tests/emitted/test_engine.py"),
    *("tests/flight/integration", "tests/flight/rollouts", "tests/flight/plant"),
    *("tests/flight/control/test_predictive.py", "tests/runtime/test_own_law.py"),
)


def _of_arrays(modules: str, *tests: str) -> dict[str, tuple[str, ...]]:
    return dict.fromkeys(modules.split(), tuple(f"tests/arrays/test_{test}" for test in tests))


_VALUES = "nodes.py::test_numpy_has_the_numbers_of_plain_arrays"
_IN_LANGUAGES = {
    language: f"nodes.py::test_{language}_has_the_numbers_of_plain_arrays"
    for language in ("casadi", "jax", "c", "c_of_one_state", "c_for_firmware", "octave")
}
_DERIVED = ("nodes.py::test_derivatives_are_those_of_complex_steps", "calls.py")
_TEXT = "nodes.py::test_numpy_text_has_the_numbers_of_the_program"
_PAGES = "nodes.py::test_octave_takes_many_states_in_pages"
_OF_C = tuple(_IN_LANGUAGES[x] for x in ("c_for_firmware", "c", "c_of_one_state"))
_QUICK_ARRAYS = (
    _of_arrays("nodes labels text", _VALUES, *_DERIVED, "programs.py", _TEXT)
    | _of_arrays("contents", "programs.py", _IN_LANGUAGES["c"])
    | _of_arrays("functions", "programs.py", "calls.py", "laws.py", "machine.py")
    | _of_arrays("evaluation", _VALUES, _IN_LANGUAGES["casadi"], "programs.py", "calls.py")
    | _of_arrays("forward backward slopes rules", *_DERIVED, "programs.py")
    | _of_arrays("c_text c_file", *_OF_C, "programs.py", "laws.py")
    | _of_arrays("matlab_text", _IN_LANGUAGES["octave"], _PAGES)
    | _of_arrays("numpy_text", _TEXT)
    | _of_arrays("base", "base.py", "laws.py")
    | _of_arrays("laws law_functions allocation", "laws.py")
    | _of_arrays("contact impacts sensors surroundings", "surroundings.py", "machine.py")
    | _of_arrays("closed_loop machine state", "machine.py", "systems.py")
    | dict.fromkeys(
        ("battery", "drives", "friction", "motor", "servo"),
        ("tests/properties/test_actuators.py", "tests/verification/test_actuators.py"),
    )
    | _of_arrays("autopilot first_order predictive rollout_steps steps", "systems.py")
)
_QUICK_ACADOS = ("tests/runtime/test_acados.py",)
_QUICK_SYMBOLS = ("tests/runtime/test_casadi_backend.py",)
_QUICK_JAX = ("tests/runtime/test_jax_backend.py",)
_QUICK_BLOCKS = ("tests/emitted/test_blocks.py", *_QUICK_EMISSION)
_QUICK_SINE = (
    *(
        f"tests/emitted/test_sine_cosine.py::{test}[gcc-plain-float64-{form}]"
        for test in (
            "test_selected_angles",
            "test_a_zero_keeps_its_sign",
            "test_beyond_the_limit_the_library_answers",
            "test_infinities_and_nan_give_nan",
        )
        for form in ("few", "many")
    ),
    *_QUICK_EMISSION,
)
_QUICK = {
    "derivation.articulated": _QUICK_ARTICULATED,
    "derivation.articulated_inertia": _QUICK_ARTICULATED,
    "derivation.forward_dynamics": _QUICK_ARTICULATED,
    "symbolic.ldlt": _QUICK_ARTICULATED,
    "robot.layout": ("tests/robot/test_layout.py",),
    "robot.balance": tuple(
        f"tests/robot/test_{part}.py" for part in ("thrusters", "balance", "hover")
    ),
    "robot.wrenches": ("tests/flight/plant/test_allocation.py",),
    "program.inlining": (
        "tests/properties/test_operation_counts.py::test_operations_are_as_few_as_they_were",
        *_QUICK_EMISSION,
    ),
    "program.steps": _QUICK_LOOPS,
    "program.scratch": _QUICK_LOOPS,
    "program.loops": _QUICK_LOOPS,
    "program.patterns": ("tests/interface/test_on_request.py",),
    "targets.c.sparse": ("tests/targets/test_sparse.py",),
    "targets.c.laws": ("tests/targets/test_laws.py",),
    "runtime.kernels": _QUICK_SYMBOLS,
    "runtime.casadi_backend": _QUICK_SYMBOLS,
    "runtime.acados": _QUICK_ACADOS,
    "machine.transition": _QUICK_ACADOS,
    "runtime.jax_backend": _QUICK_JAX,
    "arctangent.c": _QUICK_BLOCKS,
    "blocks.c": _QUICK_BLOCKS,
    "gather.c": _QUICK_BLOCKS,
    "exactness.c": _QUICK_BLOCKS,
    "literals.c": _QUICK_BLOCKS,
    "sine_cosine.c": _QUICK_SINE,
    "sine_cosine_kernel.c": _QUICK_SINE,
    "emitted.evaluation": ("tests/emitted/test_evaluation.py", *_QUICK_EMISSION),
    "emitted.preparation": ("tests/emitted/test_preparation.py", *_QUICK_EMISSION),
}
_SHIPPED = "tests/properties/test_pinocchio.py::test_shipped_robots"
_EMITTED = "tests/targets/test_registry.py"
_COUNTS = ("tests/properties/test_operation_counts.py", "tests/derivation/test_articulated.py")
_LOOPS = ("tests/targets/test_c_source.py", "tests/runtime/test_c_backend.py")
_IN_C = (
    "tests/targets/test_c_source.py",
    "tests/runtime/test_c_backend.py",
    "tests/targets/test_embedded.py",
)
_IN_NUMPY = (_EMITTED, _SHIPPED, "tests/runtime/test_c_backend.py")
_REST = {
    "derivation.functions": (
        "tests/properties/test_derivatives.py",
        "tests/properties/test_parameter_derivatives.py",
        *_REST_OF_DERIVATION,
    ),
    "symbolic.tape": ("tests/program/test_nodes.py", *_REST_OF_DERIVATION),
    "robot.balance": ("tests/cli/test_app.py",),
    "robot.wrenches": ("tests/robot/test_thrusters.py",),
    "program.nodes": (*_COUNTS, _SHIPPED),
    "program.lower": (*_COUNTS, _SHIPPED, _EMITTED),
    "program.inlining": (*_COUNTS, _SHIPPED, _EMITTED),
    "program.trigonometry": ("tests/targets/test_c_source.py",),
    "program.steps": _LOOPS,
    "program.scratch": _LOOPS,
    "program.loops": _LOOPS,
    "program.patterns": ("tests/targets/test_sparse.py",),
    "targets.c.sparse": ("tests/targets/test_c_source.py",),
    "targets.printers": (_EMITTED, _SHIPPED, *_IN_C),
    "files.verbatim": (_EMITTED, "tests/targets/test_c_source.py"),
    "targets.numpy.target": _IN_NUMPY,
    "targets.numpy.statements": _IN_NUMPY,
    "emitted.evaluation": (*_IN_NUMPY, "tests/runtime"),
    "emitted.preparation": (*_IN_NUMPY, "tests/runtime"),
    "targets.c.target": (_EMITTED, *_IN_C),
    "targets.c.function": (_EMITTED, *_IN_C),
    "targets.c.statements": (_EMITTED, *_IN_C),
    "targets.documentation": (_EMITTED, "tests/targets/test_c_source.py"),
    "targets.registry": (_EMITTED, "tests/cli/test_app.py", "tests/targets/test_c_source.py"),
    "c_source.c.jinja": _IN_C,
    "c_batch.c.jinja": _IN_C,
    "c_each.c.jinja": ("tests/targets/test_each.py",),
    "arctangent.c": (*_IN_C, "tests/emitted/test_blocks.py"),
    "blocks.c": _IN_C,
    "gather.c": ("tests/targets/test_sparse.py",),
    "exactness.c": _IN_C,
    "literals.c": _IN_C,
    "sine_cosine.c": (*_IN_C, "tests/emitted/test_sine_cosine.py"),
    "sine_cosine_kernel.c": (*_IN_C, "tests/emitted/test_sine_cosine.py"),
    "numpy_module.py.jinja": (_EMITTED, "tests/runtime/test_c_backend.py"),
}


# Those that find faults of the generator: tests of modules that are kept execute nothing of it.
QUICK_TESTS = frozenset(
    test for tests in (_QUICK_DERIVATION, _QUICK_EMISSION, *_QUICK.values()) for test in tests
)
# What the quick tests of a line may take together, in seconds, and how many they may be.
_QUICK_SECONDS, _QUICK_TESTS = 60.0, 500


def suite_of(module: str, line: int, recorded: Mapping[str, Record]) -> Suite:
    """The tests that concern a line of a module or a template."""
    if module in NATIVE:
        return NATIVE[module]
    if module in MATLAB:
        return Suite(("tests/targets/test_matlab.py",), ("tests/runtime/test_matlab_programs.py",))
    if module in ARRAYS + MACHINE:
        quick = _QUICK_ARRAYS.get(module.partition(".")[2], ("tests/arrays",))
        return Suite(quick, ("tests/arrays", *_REST_OF_ARRAYS))
    if module in _ALL_NAMED:
        usual = _QUICK_DERIVATION if module in DERIVATION + COMBINE else _QUICK_EMISSION
        return Suite(_QUICK.get(module, usual), _REST.get(module, _REST_OF_DERIVATION))
    return _executing(f"gibbs_codegen/{module.replace('.', '/')}.py", line, recorded)


def _executing(file: str, line: int, recorded: Mapping[str, Record]) -> Suite:
    """Quick tests that execute a line; then all of the files that these and others are in.

    A line that is executed when it is imported is no test's: of it are all that execute the module.
    """
    of_module = {test: record for test, record in recorded.items() if file in record.lines}
    of_line = {test: r for test, r in of_module.items() if r.lines[file] >> line & 1}
    quick: list[str] = []
    seconds = 0.0
    for test, record in sorted((of_line or of_module).items(), key=lambda of: of[1].seconds):
        seconds += record.seconds
        if len(quick) == _QUICK_TESTS or (quick and seconds > _QUICK_SECONDS):
            break
        quick.append(test)
    files = dict.fromkeys(test.partition("::")[0] for test in of_line or of_module)
    mirrored = Path("tests", *Path(file).parts[1:-1]).as_posix()
    return Suite(tuple(quick) or (mirrored,), tuple(files) or (mirrored,))
