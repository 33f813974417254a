"""Fixtures shared by the tests: generated modules, made once for each state of the generator."""

from __future__ import annotations

import functools
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, settings
from support.compiled import Emitted, emit_labelled
from support.kept import forget_unused, generator_digest, made_once

from gibbs_codegen.pipeline import generate, generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

settings.register_profile(
    "project",
    deadline=None,
    database=None,
    print_blob=True,
    derandomize=bool(os.environ.get("CI")),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("project")

ROOT = Path(__file__).parent.parent

# Tests that take long: how many of their cases the default run has, so that it stays within
# minutes, and how many more of them CI runs. The rest is for `pytest -m exhaustive`.
CASES = {
    "flight/analysis/test_linear_model.py": {
        "test_deviations_grow_as_the_model_says": (1, 1),
    },
    "flight/analysis/test_reach.py": {
        "test_thrusts_within_the_limits_stay_inside": (1, 1),
        "test_vertices_are_attained_by_thrusts_at_their_limits": (1, 0),
    },
    "cli/test_app.py": {
        "test_closed_streams_are_no_traceback": (0, 1),
        "test_every_command_takes_every_kind_of_robot": (4, 1),
        "test_info_of_a_tree_has_its_links_rotors_and_frames": (0, 1),
    },
    "cli/test_simulate.py": {
        "test_a_flight_leaves_series_and_figures": (0, 0),
        "test_a_terminal_sees_progress": (0, 1),
        "test_wrong_use_is_told_and_leaves_nothing": (3, 2),
    },
    "derivation/test_articulated.py": {
        "test_both_ways_give_what_pinocchio_gives": (1, 0),
        "test_operations_grow_with_the_number_of_links": (0, 1),
        "test_the_way_with_fewer_operations_is_emitted": (1, 1),
        "test_thirty_general_links": (0, 0),
    },
    "derivation/test_coriolis.py": {
        "test_the_coriolis_matrix": (1, 0),
    },
    "derivation/test_forward_dynamics_derivatives.py": {
        "test_derivatives_are_those_of_forward_dynamics": (3, 2),
    },
    "derivation/test_groups.py": {
        "test_every_statement_belongs_to_a_group": (1, 0),
        "test_every_statement_of_a_tree_belongs_to_a_group": (0, 1),
    },
    "derivation/test_hybrid.py": {
        "test_chains_added_by_the_coupling_map_give_the_emitted_hybrid_system": (0, 0),
        "test_chains_of_a_tree_add_up_to_the_emitted_hybrid_system": (1, 0),
    },
    "derivation/test_inverse_dynamics_derivatives.py": {
        "test_helmholtz": (1, 1),
        "test_random_arms": (1, 1),
        "test_random_trees": (2, 2),
        "test_robots_that_ship": (1, 1),
    },
    "derivation/test_link_frames.py": {
        "test_an_arm_by_poses_costs_no_more_than_by_parameters": (0, 1),
    },
    "derivation/test_parameter_derivatives.py": {
        "test_derivatives_by_the_parameters": (0, 1),
    },
    "derivation/test_parameters.py": {
        "test_a_length_that_changes_nothing_is_no_parameter": (0, 0),
    },
    "derivation/test_regressor.py": {
        "test_it_depends_on_lengths_alone_and_they_on_masses": (0, 1),
        "test_it_is_inverse_dynamics_and_no_parameter_is_superfluous": (1, 1),
    },
    "derivation/test_regularity.py": {
        "test_a_machine_singular_somewhere_is_right_elsewhere": (1, 0),
        "test_degenerate_robots": (0, 0),
        "test_degenerate_robots_drawn_anew": (0, 1),
        "test_very_unequal_masses_are_no_singularity": (1, 0),
        "test_what_nothing_resists_is_the_null_space_of_the_oracle": (1, 0),
    },
    "derivation/test_tree.py": {
        "test_both_forward_dynamics_and_trees_that_are_not_regrouped": (2, 1),
        "test_joints_on_different_branches_do_not_couple": (2, 2),
    },
    "emitted/test_sine_cosine.py": {
        "test_a_million_angles": (4, 2),
        "test_every_float": (0, 0),
    },
    "equations/test_show.py": {
        "test_chains_add_up_to_the_hybrid_system": (0, 1),
        "test_chains_of_a_tree_add_up_to_the_hybrid_system": (0, 1),
        "test_chains_of_any_robot_add_up_to_the_hybrid_system": (0, 0),
        "test_every_attitude_and_origin": (1, 1),
        "test_latex_is_well_formed_and_has_no_internal_names": (2, 1),
        "test_text_of_a_tree_is_readable": (0, 1),
        "test_text_read_back_gives_the_same_numbers": (3, 2),
    },
    "examples/test_nmpc.py": {
        "test_the_flight_of_the_page": (0, 0),
        "test_the_papers_machine": (0, 1),
    },
    "exchange/test_hostile_sources.py": {
        "test_thousands_of_mutants": (0, 0),
    },
    "exchange/test_oracles.py": {
        "test_emitted_functions_are_those_of_the_source": (1, 0),
    },
    "figures/test_coupling.py": {
        "test_texts_are_large_enough_inside_and_apart": (3, 1),
    },
    "flight/figures/test_flight_figures.py": {
        "test_axes_have_labels_with_units": (3, 0),
    },
    "figures/test_machine_and_chains.py": {
        "test_frames_are_where_the_emitted_functions_put_them": (0, 1),
        "test_frames_of_a_tree_are_where_the_emitted_functions_put_them": (0, 1),
        "test_machine_stands_where_its_frames_are": (1, 0),
        "test_other_machines_can_be_drawn": (3, 2),
    },
    "flight/figures/test_results.py": {
        "test_everything_is_written_and_named": (0, 0),
    },
    "files/test_module_writer.py": {
        "test_nothing_is_left_behind_when_ended": (3, 2),
    },
    "interface/test_on_request.py": {
        "test_what_a_module_lacks_is_told_with_the_option_that_adds_it": (1, 0),
    },
    "program/test_loops.py": {
        "test_a_robot": (1, 0),
    },
    "properties/test_derivatives.py": {
        "test_derivatives_by_velocities_satisfy_helmholtz": (0, 0),
        "test_first_derivatives_are_those_of_the_function": (0, 0),
        "test_hessian_of_forward_dynamics_is_the_derivative_of_the_gradient": (0, 0),
    },
    "properties/test_derivatives_pinocchio.py": {
        "test_derivatives_of_integrate": (0, 1),
        "test_random_trees": (1, 2),
        "test_robots_that_ship": (0, 1),
    },
    "properties/test_determinism.py": {
        "test_bytes_do_not_depend_on_seed_encoding_time_zone_place_or_flags": (0, 1),
        "test_bytes_of_every_robot_are_the_same_in_every_surroundings": (0, 0),
    },
    "properties/test_operation_counts.py": {
        "test_derivatives_take_as_few_as_they_did": (1, 1),
        "test_forty_rotors_cost_the_same_as_four": (0, 1),
        "test_operations_are_as_few_as_they_were": (1, 2),
        "test_sums_over_the_arms_vanish_for_every_rotor_count": (1, 1),
        "test_two_arms_of_seven_joints_cost_less_than_one_of_fourteen": (0, 1),
        "test_with_a_quaternion_it_takes_fewer": (1, 0),
        "test_wrenches_cost_what_it_takes_to_carry_them_in": (1, 0),
    },
    "properties/test_parameter_derivatives.py": {
        "test_accelerations_by_parameters": (0, 1),
        "test_forces_by_parameters": (0, 1),
    },
    "properties/test_physics.py": {
        "test_attitude_is_the_sequence_of_the_angles": (2, 1),
        "test_free_fall_conserves_energy_and_horizontal_momentum": (1, 0),
        "test_gradients_of_gibbs_function_and_energies": (0, 1),
    },
    "properties/test_pinocchio.py": {
        "test_family": (1, 1),
        "test_keeping_zero_parameters_changes_nothing": (0, 1),
        "test_random_robots": (0, 1),
        "test_random_trees": (1, 2),
        "test_robots_drawn_anew": (0, 1),
        "test_shipped_robots": (3, 2),
        "test_thirty_links_of_general_inertia": (0, 0),
    },
    "properties/test_quaternion.py": {
        "test_c_computes_the_same": (1, 0),
        "test_random_robots": (2, 1),
        "test_robots_that_ship": (1, 2),
    },
    "properties/test_singularity.py": {
        "test_all_back_ends_are_accurate_ever_nearer_to_the_singularity": (0, 1),
        "test_numpy_is_accurate_next_to_the_singularity": (1, 1),
    },
    "properties/test_slender_bodies.py": {
        "test_constants_that_c_computes_keep_their_digits": (0, 1),
        "test_mass_matrix_keeps_its_digits": (0, 1),
    },
    "properties/test_steps.py": {
        "test_euler_is_semi_implicit": (0, 1),
        "test_runge_kutta_is_of_fourth_order": (0, 1),
    },
    "properties/test_time_steps.py": {
        "test_both_targets_agree": (1, 1),
        "test_methods_have_their_order": (2, 0),
    },
    "properties/test_wrenches.py": {
        "test_a_joint_that_is_held_passes_on_its_constraint_torque": (0, 0),
        "test_compiled_functions_of_trees_are_those_of_pinocchio": (0, 1),
        "test_what_a_joint_passes_on_along_its_axis_is_what_drives_it": (0, 1),
    },
    "robustness/test_full_disk.py": {
        "test_no_results_rather_than_half_of_them": (0, 1),
    },
    "robustness/test_hostile_files.py": {
        "test_a_flood_is_refused_soon": (0, 2),
        "test_a_thousand_broken_files_of_trees": (0, 1),
        "test_ten_thousand_broken_robot_files": (0, 1),
        "test_what_is_accepted_makes_a_module": (0, 1),
    },
    "robustness/test_hostile_names.py": {
        "test_a_flight_bears_any_printable_name": (0, 0),
        "test_hostile_arguments_are_refused": (11, 0),
        "test_what_is_accepted_compiles_and_imports": (0, 1),
    },
    "robustness/test_instruments.py": {
        "test_eight_threads_give_the_bytes_that_one_gives": (0, 1),
        "test_nothing_depends_on_memory_that_nobody_wrote": (0, 0),
    },
    "robustness/test_kills.py": {
        "test_a_kill_at_any_moment_of_a_first_load": (0, 0),
        "test_a_kill_at_any_moment_of_generate": (0, 0),
        "test_sixteen_generate_the_same_at_once": (0, 0),
        "test_sixteen_load_the_same_at_once": (0, 0),
    },
    "robustness/test_no_eval.py": {
        "test_no_command_makes_code_of_text": (0, 1),
        "test_the_watch_sees": (0, 2),
    },
    "robustness/test_soak.py": {
        "test_robots_that_agree_are_counted": (0, 1),
    },
    "flight/rollouts/test_in_c.py": {
        "test_no_warning_and_no_byte_out_of_place": (2, 2),
    },
    "flight/rollouts/test_jax_rollout.py": {
        "test_a_controller_is_traced": (0, 1),
        "test_everything_is_as_in_numpy": (1, 1),
        "test_it_is_differentiated_and_transformed": (0, 1),
        "test_single_precision_is_jax_s_default": (1, 0),
        "test_without_lag_there_are_no_thrusts": (0, 1),
    },
    "runtime/test_arguments.py": {
        "test_ten_thousand_random_calls": (0, 0),
    },
    "runtime/test_c_backend.py": {
        "test_both_back_ends_agree_on_other_robots": (0, 1),
        "test_interface_is_what_is_emitted": (3, 1),
        "test_memory_does_not_grow": (0, 0),
    },
    "runtime/test_cache.py": {
        "test_many_processes_at_once": (0, 1),
    },
    "runtime/test_casadi_backend.py": {
        "test_every_function_is_that_of_the_numpy_module": (2, 1),
    },
    "runtime/test_casadi_external.py": {
        "test_generated_code_calls_the_library": (1, 0),
        "test_gradients_and_hessians_are_exact": (2, 0),
        "test_ipopt_takes_the_same_steps_as_with_derivatives_of_casadi": (1, 0),
        "test_jacobians_are_exact": (3, 0),
        "test_parameters_are_an_input": (2, 0),
        "test_patterns_have_no_more_entries_than_casadi_finds": (3, 0),
        "test_the_adapter_compiles_silently": (2, 0),
        "test_what_has_no_second_derivatives_says_so": (1, 0),
    },
    "runtime/test_jax_backend.py": {
        "test_derivatives_of_other_functions": (0, 2),
    },
    "runtime/test_not_finite.py": {
        "test_an_acceleration_that_nothing_resists_is_said": (1, 0),
    },
    "flight/plant/test_actuators.py": {
        "test_motors_that_are_off_have_no_least_thrust": (0, 0),
        "test_the_robot_file_tells_what_the_scenario_does_not": (0, 1),
    },
    "flight/test_any_robot.py": {
        "test_a_flight_of_any_robot_is_drawn_and_written": (0, 0),
        "test_a_quaternion_flies_as_angles_do": (0, 0),
        "test_an_offset_hover_is_reached": (0, 0),
        "test_energy_balances_without_inputs": (0, 1),
        "test_every_step_with_a_quaternion_is_that_of_python": (0, 1),
        "test_hydrus_hovers_in_open_loop": (0, 0),
        "test_series_of_a_held_link_have_its_name": (0, 1),
    },
    "flight/integration/test_block_loop.py": {
        "test_each_flight_is_that_of_the_loop_of_one_state": (2, 2),
        "test_plant_and_model_may_differ_from_flight_to_flight": (0, 1),
        "test_the_source_compiles_silently": (1, 1),
        "test_threads_make_no_difference": (1, 1),
    },
    "flight/integration/test_compiled_loop.py": {
        "test_every_step_is_that_of_python": (2, 1),
        "test_sanitizers_find_nothing_in_random_flights": (0, 1),
    },
    "flight/integration/test_integrate.py": {
        "test_a_flight_at_limits_gets_to_its_end": (1, 0),
        "test_a_lost_flight_ends_with_its_reason": (1, 1),
        "test_a_stiff_flight_ends_with_the_reason": (0, 0),
        "test_both_back_ends_fly_the_same": (1, 0),
        "test_energy_balances_to_1e_8": (0, 1),
        "test_energy_balances_with_everything_on": (0, 0),
        "test_fixed_steps_are_of_fourth_order_with_gravity_on": (0, 1),
        "test_flights_end_at_the_singularity_of_every_sequence": (2, 0),
        "test_samples_are_at_the_rate_asked_for": (4, 2),
        "test_steps_that_meet_a_limit_are_taken_in_python": (0, 1),
        "test_unstable_fixed_steps_are_refused_with_ones_that_serve": (0, 0),
        "test_without_gravity_and_inputs_energy_and_momentum_stay": (1, 0),
    },
    "flight/control/test_inverse_dynamics.py": {
        "test_constraint_torques_along_the_paper_flight_agree_with_pinocchio": (0, 1),
        "test_motion_inputs_and_constraint_torques_solve_the_hybrid_system": (1, 0),
    },
    "flight/desired/test_inverse_kinematics.py": {
        "test_a_full_turn_through_the_singularity_is_refused": (0, 1),
        "test_arms_point_where_they_should_on_and_on": (1, 1),
        "test_arms_with_prismatic_joints": (2, 1),
        "test_base_is_exact_and_goes_on_through_half_turns": (1, 1),
    },
    "flight/plant/test_push.py": {
        "test_momentum_changes_as_gravity_and_the_push_say": (0, 0),
    },
    "flight/test_simulation.py": {
        "test_more_rotors_fly_it_with_the_least_thrusts": (0, 0),
        "test_the_paper_flight_is_tracked": (1, 0),
    },
    "flight/desired/test_trajectory.py": {
        "test_slowed_down_it_is_flown": (0, 0),
    },
    "flight/sweeps/test_deaths.py": {
        "test_a_pool_that_breaks_does_not_end_the_sweep": (0, 0),
        "test_a_sweep_killed_at_any_moment_goes_on": (0, 1),
        "test_a_worker_that_dies_twice_loses_nothing": (0, 1),
        "test_an_executor_that_never_works_is_told": (0, 1),
        "test_dask_flies_the_same": (0, 1),
        "test_executorlib_flies_the_same": (0, 1),
        "test_workers_end_when_the_program_is_killed": (0, 1),
    },
    "flight/sweeps/test_sweep.py": {
        "test_robots_cross_and_what_is_no_module_is_generated_once": (0, 1),
    },
    "targets/test_c_source.py": {
        "test_cutting_changes_no_number": (0, 0),
        "test_functions_equal_numpy": (1, 0),
        "test_loops_are_among_what_is_compiled": (0, 1),
        "test_random_robots_compile_silently": (0, 1),
        "test_sanitizers_find_nothing_in_random_calls": (0, 1),
        "test_shipped_robots_compile_silently": (0, 1),
        "test_single_precision_is_near_double": (1, 1),
        "test_small_robot_compiles_silently": (2, 1),
        "test_stack_is_what_the_header_promises": (1, 1),
        "test_symbols": (1, 0),
        "test_text_is_portable_and_narrow": (1, 0),
        "test_two_robots_in_one_program": (0, 1),
        "test_zeros_for_absent_arguments_are_as_many_as_the_widest_has": (1, 0),
    },
    "targets/test_each.py": {
        "test_derivatives_and_time_steps": (1, 1),
        "test_functions_in_other_builds": (1, 1),
    },
    "targets/test_embedded.py": {
        "test_an_emulated_processor_computes_the_desktops_bits_and_numpys_numbers": (0, 1),
        "test_an_object_has_no_variables_calls_nothing_foreign_and_keeps_to_its_stack": (1, 0),
        "test_the_desktop_keeps_to_the_stated_stack_too": (0, 1),
    },
    "targets/test_matlab.py": {
        "test_numbers_are_those_of_numpy": (1, 1),
    },
    "targets/test_registry.py": {
        "test_no_line_is_longer_than_100_characters": (0, 0),
    },
    "targets/test_sparse.py": {
        "test_forms_without_zeros_have_the_entries_of_the_patterns": (1, 0),
        "test_they_are_described": (1, 0),
        "test_they_compile_silently": (1, 0),
    },
    "test_crocoddyl.py": {
        "test_the_flight_arrives_within_its_limits": (0, 1),
    },
    "test_distributions.py": {
        "test_whoever_builds_again_elsewhere_gets_the_same_bytes": (0, 0),
    },
    "test_interface.py": {
        "test_both_back_ends_load_a_function_that_was_added": (1, 0),
        "test_verify_compares_a_function_that_no_formulation_gives_with_itself": (0, 0),
        "test_verify_finds_what_is_wrong_with_it": (1, 0),
    },
    "test_layers.py": {
        "test_flying_imports_no_sympy": (0, 1),
    },
    "verification/test_derivatives.py": {
        "test_every_derivative_that_is_right_passes": (0, 1),
        "test_faults_planted_in_derivatives_are_found": (1, 0),
    },
    "verification/test_extremes.py": {
        "test_planted_faults_are_found": (0, 1),
        "test_what_is_right_passes_every_formulation": (1, 1),
    },
    "verification/test_parameters.py": {
        "test_names_and_values_are_those_of_the_derivation": (1, 1),
    },
    "verification/test_thoroughness.py": {
        "test_a_sign_of_any_parameter_that_is_zero_is_found": (0, 1),
        "test_single_precision_that_does_not_compile_fails": (0, 1),
        "test_what_only_a_c_program_uses": (0, 1),
    },
    "verification/test_trees.py": {
        "test_planted_faults_are_found": (1, 0),
        "test_random_trees_pass": (0, 1),
    },
    "flight/control/test_geometric.py": {
        "test_it_recovers_from_any_attitude": (3, 17),
    },
    "verification/test_verify.py": {
        "test_a_quaternion_passes_in_both_back_ends": (0, 1),
        "test_planted_faults_are_found": (1, 0),
        "test_planted_faults_in_c_are_found": (0, 1),
        "test_what_c_has_of_its_own_is_compared": (0, 0),
    },
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases that the default run and CI leave out, evenly spread over all of a test."""
    cases: dict[tuple[int, int, str], list[pytest.Item]] = {}
    for item in items:
        file, _, test = item.nodeid.partition("[")[0].removeprefix("tests/").partition("::")
        if counts := CASES.get(file, {}).get(test):
            cases.setdefault((*counts, item.nodeid.partition("[")[0]), []).append(item)
    for (by_default, in_ci, _), found in cases.items():
        kept = _spread([i for i in found if not i.get_closest_marker("slow")], by_default)
        slow = [item for item in found if item not in kept]
        for item in slow:
            item.add_marker(pytest.mark.slow)
        for item in {*slow} - {*_spread(slow, in_ci)}:
            item.add_marker(pytest.mark.exhaustive)


def _spread(cases: list[pytest.Item], count: int) -> list[pytest.Item]:
    places = {round(k * len(cases) / count) for k in range(count)}
    return [item for place, item in enumerate(cases) if place in places]


def pytest_sessionstart(session: pytest.Session) -> None:
    """Before any worker begins, remove what earlier runs have kept and nobody used for long."""
    cache = getattr(session.config, "cache", None)
    if cache is not None and not hasattr(session.config, "workerinput"):
        forget_unused(cache.mkdir("modules"))
        forget_unused(cache.mkdir("compiled") / "libraries")


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all processes of a test run share, for what takes long to make."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session")
def kept(pytestconfig: pytest.Config, shared: Path) -> Path:
    """A folder for modules that later runs use again, until the generator changes."""
    cache = getattr(pytestconfig, "cache", None)  # There is none where pytest is to keep nothing.
    folder = (cache.mkdir("modules") if cache else shared / "modules") / generator_digest()
    folder.mkdir(parents=True, exist_ok=True)
    folder.touch()
    return folder


@pytest.fixture(scope="session", autouse=True)
def _compiled_cache(pytestconfig: pytest.Config, shared: Path) -> None:
    """A cache of compiled libraries of the tests' own, which later runs use again."""
    cache = getattr(pytestconfig, "cache", None)
    folder = (cache.mkdir("compiled") if cache else shared) / "libraries"
    os.environ["GIBBS_CODEGEN_CACHE"] = str(folder)


def compiled_soon(folder: Path) -> ModuleType:
    """The C back end of a module, compiled in half the time; flights do not wait for speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", f"{os.environ.get('CC') or 'cc'} -O1")
        return load(folder, backend="c")


@pytest.fixture(scope="session")
def shipped(kept: Path) -> Callable[[str], ModuleType]:
    """Load the freshly generated module of a robot that ships."""
    modules = kept / "generated"

    @functools.cache
    def module(name: str) -> ModuleType:
        return load(made_once(modules / name, lambda: generate(name, modules)))

    return module


@pytest.fixture(scope="session")
def fast(shipped: Callable[[str], ModuleType]) -> Callable[[str], ModuleType]:
    """Load the C back end of a robot that ships; NumPy's where nothing compiles."""

    @functools.cache
    def module(name: str) -> ModuleType:
        return compiled_soon(Path(shipped(name).__file__ or "").parent)

    return module


@pytest.fixture(scope="session")
def family(kept: Path) -> Callable[[int, int], ModuleType]:
    """Load the C back end of a member of the paper's family, by rotors and links."""
    modules = kept / "family"

    @functools.cache
    def module(rotors: int, links: int) -> ModuleType:
        robot = paper_family(rotors, links)
        text = robot_text(robot)
        made = made_once(modules / robot.name, lambda: generate_robot(robot, text, modules))
        return compiled_soon(made)

    return module


@pytest.fixture(scope="session")
def emitted(kept: Path) -> Callable[[str], Emitted]:
    """Emit a robot that ships, or another of `support.compiled`, with what it was emitted from."""
    base = kept / "emitted"

    @functools.cache
    def made(label: str) -> Emitted:
        model = base / f"{label}.pickle"

        def make() -> None:
            model.write_bytes(pickle.dumps(emit_labelled(label, base / label).model))

        folder = made_once(base / label, make)
        return Emitted(pickle.loads(model.read_bytes()), folder, load(folder))  # noqa: S301

    return made
