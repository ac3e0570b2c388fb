"""Tests that repeat a law on more parts, robots or faults: minutes in all, so that the default run leaves them out.

`python -m pytest -n auto -m extended` runs them, and so does `.ci/run`.
"""

EXTENDED = {
    "benchmarks/test_alive.py": (
        "test_a_dimension_of_a_part",
        "test_a_whole_process_from_the_cad",
        "test_bounds_of_a_random_part",
        "test_campaigns_of_a_hexapod_and_of_a_template",
        "test_derivatives_of_a_part",
        "test_effects_of_a_linear_model",
        "test_four_interfaces_beside_two",
        "test_joints_of_an_assembly",
        "test_poses_modes_and_a_map",
        "test_two_levels_and_a_large_mesh",
    ),
    "cad/test_step.py": (
        "test_a_build123d_solid_is_a_part",
        "test_building_writes_nothing_to_standard_output",
        "test_rubbish_is_refused",
    ),
    "cad/test_washers.py": ("test_washers_that_do_not_fit_are_refused",),
    "cli/test_cli.py": (
        "test_a_robot_of_ones_own",
        "test_a_stopped_run_leaves_nothing[15]",
        "test_modules_of_the_working_folder_change_nothing[arguments0]",
        "test_modules_of_the_working_folder_change_nothing[arguments1]",
    ),
    "gap/test_diagnosis_command.py": (
        "test_backlash_of_a_rotary_drive_with_two_slopes_is_found_adopted_and_found_no_more",
        "test_pictures_of_a_diagnosis_are_kept",
    ),
    "lobes/test_stability.py": (
        "test_simulations_in_the_time_domain_agree[2-0.0005-True]",
        "test_simulations_in_the_time_domain_agree[3-0.007-True]",
        "test_simulations_in_the_time_domain_agree[4-0.01-True]",
    ),
    "parts/test_experiment_options.py": (
        "test_a_foundation_gives_way_and_the_superelement_holds_the_part",
        "test_a_tolerance_that_is_not_met_is_told_in_one_line",
        "test_pads_apart_are_shown_one_by_one",
        "test_tolerance_reaches_the_experiment_and_enters_its_key",
    ),
    "statics/test_map.py": (
        "test_a_volume_holds_what_maps_and_single_poses_hold",
        "test_numbers_carry_names_and_units",
    ),
    "files/test_store.py": ("test_eighty_columns_of_ascii",),
    "vibration/test_vibration.py": (
        "test_maps_have_frequencies",
        "test_shapes_are_drawn_and_move",
    ),
    "statics/test_comparison.py": (
        "test_a_picture_shows_the_first_robot_in_outlines_beside_the_second",
    ),
    "experiments/test_assembly.py": (
        "test_a_mass_that_only_cad_knows_is_tested_for",
        "test_a_step_file_s_solid_yields_and_weighs",
    ),
    "parts/test_interfaces.py": (
        "test_a_rod_on_a_foundation_sinks_in_by_force_over_area",
    ),
    "experiments/test_named_interfaces.py": (
        "test_every_interface_is_a_node_of_the_robot",
    ),
    "experiments/test_orders.py": (
        "test_the_mesh_of_a_former_part_is_moved_along_where_it_can_be",
        "test_what_scripts_read_of_a_rod_and_of_a_step_file_in_its_place",
    ),
    "fea/test_elasticity.py": (
        "test_multigrid_agrees_with_a_factorization[0.49-distributed]",
        "test_the_cubic_solution_is_softer_in_every_direction[rigid]",
    ),
    "fea/test_experiment.py": (
        "test_every_entry_is_within_its_tolerance_and_its_bound[link-0.0005]",
        "test_every_entry_is_within_its_tolerance_and_its_bound[plate-0.002]",
    ),
    "fea/test_interfaces.py": (
        "test_a_blocks_compliance_is_the_two_ended_experiments[distributed]",
        "test_any_interface_may_be_at_rest",
        "test_each_interface_has_a_coupling_of_its_own",
        "test_names_and_matrices_are_kept[distributed]",
        "test_the_stiffness_is_symmetric_semidefinite_and_free_of_rigid_motions[distributed]",
    ),
    "fea/test_laws.py": (
        "test_lengths_scale_stretch_by_one_and_rotations_by_three_powers",
        "test_moduli_scale_everything_inversely[2.5]",
    ),
    "fea/test_mass.py": (
        "test_a_large_part_is_worked_on_in_portions_with_the_same_result",
        "test_a_uniform_bar_rings_as_waves_say",
        "test_modes_are_lanczoss",
        "test_modes_between_held_ends_are_within_their_bounds",
        "test_the_number_of_modes_is_chosen_directly_or_by_a_frequency",
        "test_whatever_holds_the_part_its_mass_is_the_same",
    ),
    "fea/test_mesh.py": (
        "test_a_patch_imprinted_on_a_plane_ends_at_its_border",
        "test_a_traction_is_singular_where_it_ends_in_a_plane_only",
    ),
    "fea/test_sensitivity.py": (
        "test_a_mesh_moves_along_with_a_small_change_and_not_with_a_large_one",
        "test_rod_in_tension_torsion_and_bending_has_the_derivatives_of_the_closed_form",
        "test_the_mesh_of_a_filleted_slider_follows_its_cad_whatever_changes",
    ),
    "fea/test_tolerance.py": (
        "test_a_refined_mesh_that_cannot_be_solved_leaves_the_last_one",
        "test_a_soft_foundation_adds_the_springs_of_statics",
        "test_superelement_is_free_and_is_the_part_when_held",
        "test_what_cannot_be_met_is_said_and_saved",
    ),
    "gap/test_any_robot.py": (
        "test_a_mass_that_no_reading_shows_leaves_its_effect_named",
        "test_a_robot_of_another_size_and_stiffness_gets_the_same_answer[1-3]",
        "test_a_robot_of_another_size_and_stiffness_gets_the_same_answer[3-1]",
        "test_a_robot_of_another_size_and_stiffness_gets_the_same_answer[5-1]",
        "test_geometry_and_masses_have_no_favourite_size",
        "test_the_gap_lies_where_its_cause_is_named",
    ),
    "lab/test_blind.py": (
        "test_an_interrupted_check_goes_on_and_ends_the_same",
        "test_cases_of_any_robot_are_written_and_named",
        "test_effects_are_exchanged_in_sets_that_are_nearly_as_good",
        "test_play_in_a_passive_joint_is_no_backlash_of_a_drive",
        "test_play_that_reads_as_backlash_of_a_drive_is_said_to_be_either[stewart-fault0-strut5.drive]",
        "test_play_that_reads_as_backlash_of_a_drive_is_said_to_be_either[stewart-fault1-strut5.drive]",
    ),
    "gap/test_diagnose.py": (
        "test_a_bearing_that_yields_nearly_alike_along_its_axis_has_intervals_that_hold_it[joints]",
        "test_a_fault_without_a_word_is_not_named",
        "test_a_group_that_is_certain_is_identified_with_a_measurement_that_separates_it",
        "test_a_tool_that_turns_about_one_oblique_axis_blames_nothing_else",
        "test_an_effect_is_named_with_its_size[encoder-offset]",
        "test_an_effect_is_named_with_its_size[thermal]",
        "test_backlash_of_a_drive_with_two_slopes_is_found_adopted_and_predicted",
        "test_fea_against_beam_is_found_as_the_slider_entry_by_entry",
        "test_no_alternative_to_a_large_effect_leaves_more_than_no_effect",
        "test_no_gap_and_missing_gravity",
        "test_rotations_are_coupled_where_the_readings_ask_for_it",
        "test_the_same_answer_after_shuffling_rows_doubling_the_label_and_outliers",
        "test_what_would_widen_the_gap_is_not_named",
    ),
    "gap/test_doubted_instruments.py": (
        "test_a_unit_is_no_gain_that_differs_by_direction",
        "test_an_instrument_at_fault_is_named[alone-fault1-tool]",
        "test_an_instrument_at_fault_is_named[alone-fault2-gauges]",
        "test_an_instrument_at_fault_is_named[alone-fault3-tool]",
        "test_an_instrument_at_fault_is_named[alone-fault4-gauges]",
        "test_an_instrument_at_fault_is_named[beside a soft drive-fault0-gauges]",
        "test_an_instrument_at_fault_is_named[beside a soft drive-fault1-tool]",
        "test_an_instrument_at_fault_is_named[beside a soft drive-fault2-gauges]",
        "test_an_instrument_at_fault_is_named[beside a soft drive-fault3-tool]",
        "test_an_instrument_at_fault_is_named[beside a soft drive-fault4-gauges]",
        "test_few_readings_without_sigma_name_their_cause",
    ),
    "gap/test_extremes.py": ("test_a_place_too_far_for_a_robot_is_doubted_and_said",),
    "gap/test_geometry.py": (
        "test_an_adopted_geometry_leaves_the_gap_that_it_explains",
    ),
    "gap/test_hostile_tables.py": (
        "test_a_malformed_sheet_is_refused[many empty rows]",
    ),
    "gap/test_inference.py": (
        "test_readings_that_scatter_more_than_stated_have_wider_intervals",
        "test_verdicts_agree_with_their_numbers_and_copies_change_nothing[9]",
    ),
    "gap/test_instruments.py": ("test_a_diagnosis_by_an_unknown_tracker",),
    "gap/test_interfaces.py": ("test_a_soft_head_is_found_adopted_and_found_no_more",),
    "lab/test_lab.py": (
        "test_stiffness_and_sag_are_those_of_the_mechanism_engine[delta]",
        "test_stiffness_and_sag_are_those_of_the_mechanism_engine[orthoglide]",
    ),
    "gap/test_predictions.py": (
        "test_finds_what_was_put_in[options1-truth1-False]",
        "test_finds_what_was_put_in[options2-truth2-False]",
        "test_finds_what_was_put_in[options3-truth3-False]",
        "test_finds_what_was_put_in[options3-truth3-True]",
        "test_finds_what_was_put_in[options4-truth4-False]",
        "test_finds_what_was_put_in[options4-truth4-True]",
        "test_finds_what_was_put_in[options5-truth5-False]",
        "test_finds_what_was_put_in[options6-truth6-False]",
        "test_finds_what_was_put_in[options6-truth6-True]",
    ),
    "gap/test_robot_model.py": (
        "test_derivatives_are_those_of_full_reassembly[stewart]",
        "test_patterns_hold_for_readings_to_come[stewart]",
    ),
    "gap/test_sanity.py": (
        "test_faults_of_the_robot_raise_no_doubts_of_its_instruments",
    ),
    "live/test_live.py": (
        "test_a_page_follows_a_slider_five_times_a_second",
        "test_new_rows_of_a_campaign_appear",
    ),
    "notebook/test_notebook.py": (
        "test_every_object_shows_as_a_table",
        "test_the_robot_turns_inside_a_cell",
    ),
    "report/test_page.py": ("test_without_webgl_a_picture_stands_in_its_place",),
    "report/test_robot_scene.py": (
        "test_a_process_that_is_ready_ahead_draws_the_same_picture",
        "test_picture_of_a_deformed_robot_with_the_users_own_surface",
    ),
    "imports/test_assembly.py": (
        "test_a_headed_pin_in_holes_of_its_diameter_is_told_with_both_readings",
        "test_every_joint_is_found_and_none_invented[3-prs]",
        "test_every_joint_is_found_and_none_invented[delta]",
        "test_every_joint_is_found_and_none_invented[dovetail]",
        "test_every_joint_is_found_and_none_invented[finger]",
        "test_every_joint_is_found_and_none_invented[hexapod]",
        "test_every_joint_is_found_and_none_invented[slider]",
        "test_exponents_of_three_digits_are_read",
        "test_what_is_not_said_well_is_refused",
    ),
    "runtime/test_scheduler.py": (
        "test_jobs_survive_the_kills_of_their_workers_and_one_that_kills_them_is_named",
    ),
    "test_bad_day.py": (
        "test_a_command_that_is_stopped_leaves_no_child_and_says_one_line[blind-9]",
        "test_a_command_that_is_stopped_leaves_no_child_and_says_one_line[compliance-15]",
        "test_a_command_that_is_stopped_leaves_no_child_and_says_one_line[compliance-2]",
        "test_a_command_that_is_stopped_leaves_no_child_and_says_one_line[compliance-9]",
        "test_a_kill_loses_and_leaves_nothing",
    ),
    "test_docs.py": ("test_every_equation_is_set_by_the_pages_own_mathjax[theory]",),
    "test_hostile.py": ("test_mutants_of_every_family",),
    "test_tutorials.py": (
        "test_tutorials[gauges]",
        "test_tutorials[part]",
        "test_tutorials[robot]",
    ),
    "validation/test_parts.py": (
        "test_a_carbon_fibre_tube_twists_exactly_and_stretches_as_its_fibres",
        "test_a_flanged_bar_stretches_as_its_half_section",
        "test_a_part_from_a_step_file_is_the_part",
        "test_a_washer_presses_a_disc_as_its_half_section_says",
        "test_exact_solutions_are_within_the_bounds[solid bar, no Poisson effect]",
    ),
    "vjm/test_kinematics.py": ("test_out_of_reach_is_told_and_never_taken",),
    "vjm/test_laws.py": (
        "test_equilibrium_under_wrench_weight_and_springs_beside_hanging_drives",
    ),
    "vjm/test_rigid_directions.py": (
        "test_limbs_off_the_path_to_the_tool_change_nothing",
    ),
}
"""Names of tests, with or without one of their parameters, by file."""
