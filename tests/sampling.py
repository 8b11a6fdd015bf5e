"""Long families of cases, of which a default run takes a few and `make slow` takes all."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

import pytest
from hypothesis import settings

#: Whole families in blocks of a minute or more. Small samples of them are tests by themselves.
_FAMILIES = re.compile(r"_many(_|$)|_at_length$|_further_on$")

#: Tests whose shortest case takes too much CPU for a default run and for a sample, and why.
TOO_LONG = {
    "test_a_campaign_goes_on_after_its_cluster_has_gone": "a cluster that is started and ended",
    "test_a_cluster_without_workers_is_told": "a cluster that is started and ended",
    "test_a_deeper_mistake_is_not_confirmed": "a proof and its check",
    "test_a_dropped_promise_is_kept_after_all": "a whole verdict",
    "test_a_dry_run_does_with_the_lab_what_a_simulation_does": "two minutes of real time",
    "test_a_killed_worker_of_a_cluster_is_not_missed": "a cluster that is started and ended",
    "test_a_lasso_comes_back_to_a_sensor_that_runs_out_of_readings": "many programs",
    "test_a_link_carries_the_program": "as that of commands",
    "test_a_lost_scheduler_is_told": "a cluster that is started and ended",
    "test_a_parcel_that_came_damaged_or_to_others_is_not_opened": "as those of commands",
    "test_a_part_that_was_asked_about_although_no_claim_reads_it_is_looked_at": "many verdicts",
    "test_a_premise_that_is_left_out_is_missed": "two solvers",
    "test_a_program_for_two_robots_faults_with_others": "a whole race",
    "test_a_program_that_moves_is_simulated_with_the_configurations_of_its_folder": "a folder",
    "test_a_program_uses_all_of_the_lab_in_a_simulation": "all of the lab, in a process of its own",
    "test_a_search_agrees": "all runs of a lock with three robots",
    "test_a_sweep_is_a_row_for_each_number_of_robots": "a long command",
    "test_a_text_is_there_again_after_the_page_was_loaded_anew": "as that of commands",
    "test_a_token_in_a_ring_is_shown_again": "each of many questions, by two solvers",
    "test_a_worker_with_another_version_is_told": "a cluster that is started and ended",
    "test_all_of_the_language_is_used": "many runs, twice",
    "test_all_places_are_visited_and_the_trace_is_legal": "a minute and a half of real time",
    "test_all_three_refuse_all_mutants_alike": "three readers of some hundred configurations",
    "test_an_element_that_robots_race_for_is_as_one_of_them_left_it": "as that of the ring",
    "test_as_the_road_of_python": "many runs, twice",
    "test_bodies_move_as_pymunk_moves_them": "a long run",
    "test_branches_that_exclude_each_other_promised_at_once_are_vacuous": "a long command",
    "test_cars_among_processes_make_the_same_run": "half a minute of a fleet, twice",
    "test_cars_and_drones_visit_all_places": "two minutes of real time",
    "test_certificates_and_verdicts_on_them_are_as_described": "a long command",
    "test_certificates_of_examples_are_not_refuted": "two solvers, for each example",
    "test_certificates_of_some_programs_are_not_refuted": "two solvers, for each program",
    "test_claims_about_maps_are_confirmed": "two solvers",
    "test_claims_for_every_number_need_their_own_invariant": "a proof and its check",
    "test_contexts_that_are_needed_stay": "many contexts of the solver",
    "test_contracts_hold_at_each_instant": "each instant of many runs",
    "test_cubes_of_helpers_give_the_same_outcomes": "all cubes, one by one and together",
    "test_each_worker_has_to_have_koord": "a cluster that is started and ended",
    "test_entries_that_are_damaged_are_found_out_anew": "a whole verdict",
    "test_events_that_never_run_are_told": "what never happens, looked for in all ways",
    "test_few_robots_show_nothing_where_a_proof_is_for_these_alone_after_all": "a whole verdict",
    "test_findings_on_protocol_and_guardian_are_as_described": "half a minute of explored runs",
    "test_fischers_exclusion_without_lemmas": "a proof without help",
    "test_fresh_processes_prepare_for_themselves": "as those of commands",
    "test_generated_programs": "many runs, twice",
    "test_generated_programs_as_without_symmetry": "all runs of many programs",
    "test_generated_programs_do_by_machine_code_what_the_rules_allow": "many runs, twice",
    "test_generated_programs_run_the_same_with_and_without": "many runs, twice",
    "test_generated_texts_are_read_alike": "many walks",
    "test_going_back_and_forth_between_texts_says_the_same_of_each": "a whole verdict",
    "test_how_many_ways_there_are_is_told": "a long command",
    "test_instants_are_told_like_any_claim": "a long command",
    "test_intervals_cover_a_known_probability": "as those of commands",
    "test_it_follows_corners_at_every_level": "a long run",
    "test_it_is_asked_before_rounds_are_unrolled_for_long": "Spacer, for its time",
    "test_its_program_is_laid_out_and_holds": "a package that is built, installed and checked",
    "test_lassos_that_are_told_early_are_as_short": "fair lassos of many programs",
    "test_loops_are_told_with_their_goal": "a whole verdict",
    "test_mistakes_are_shown_where_they_are_while_typing": "as that of commands",
    "test_no_question_outlives_who_asked_it": "a cluster that is started and ended",
    "test_nobody_is_asked_once_all_is_answered_and_the_work_is_done": "a whole race",
    "test_nothing_false_is_confirmed_of_a_thousand_edits": "a thousand certificates",
    "test_nothing_false_is_confirmed_of_some_edits": "two solvers",
    "test_numbers_of_robots_have_the_same_verdicts_there": "a long command",
    "test_of_another_program_it_is_refuted": "two solvers",
    "test_older_certificates_say_nothing_of_it": "two solvers",
    "test_other_questions_have_other_answers": "as those of commands",
    "test_over_two_rounds_the_first_counts": "two solvers",
    "test_programs_are_checked_verified_and_run": "the playground, in a browser",
    "test_rates_of_a_program_are_the_known_ones": "some hundred runs",
    "test_records_made_of_parts_are_told_apart_after_all": "a whole verdict",
    "test_robots_that_cross_are_kept_apart_by_certificates_alone": "a long run",
    "test_robots_whose_people_are_gone_are_reached_all_the_same": "a minute of real time",
    "test_rows_and_end_do_not_hang_on_the_number_of_jobs": "a campaign, several times",
    "test_several_processes_do_what_one_does": "a campaign, several times",
    "test_slices_and_junk_change_nothing_that_is_said_of_whole_runs": "all runs of some programs",
    "test_so_they_are_in_long_runs": "as those of commands",
    "test_some_work_is_done_for_all_rounds": "an engine that is given twenty seconds",
    "test_somebody_who_is_no_scheduler_is_told": "a long command",
    "test_splitting_tells_a_rate_with_its_interval": "a long command",
    "test_starts_that_are_hard_to_find_are_given_up_soon": "a search that is given up",
    "test_statements_about_ends_of_rounds_are_asked_there_only": "a whole verdict",
    "test_sums_are_compared_part_by_part": "two solvers, for each part",
    "test_sums_whose_parts_are_not_so": "two solvers, for each part",
    "test_sums_whose_parts_are_not_so_are_not_confirmed": "two solvers, for each part",
    "test_tasks_are_claimed_by_any_robot_alike": "many runs, twice",
    "test_that_each_robot_enters_is_not_said": "a proof that is given up",
    "test_the_assignment_of_tasks_is_confirmed_by_what_was_found": "two solvers",
    "test_the_driver_of_ardupilot_passes_every_check": "as that of px4, which is in the sample",
    "test_the_driver_of_crazyflies_passes_every_check": "as that of px4, which is in the sample",
    "test_the_fewest_rounds_are_the_fewest": "all runs of some programs",
    "test_the_fewest_rounds_are_the_fewest_of_many": "all runs of 60 programs",
    "test_the_invariants_hold_whatever_old_datagrams_arrive": "many walks",
    "test_the_largest_files": "texts of megabytes",
    "test_the_lock_comes_to_who_waits_for_it": "progress in a ring of any length",
    "test_the_protocol_can_be_checked_by_itself": "eight runs of it in chaos",
    "test_the_tests_pass_without_mistakes": "all tests that mutants name",
    "test_the_text_is_typed": "mypy, of all compiled examples",
    "test_the_tour_can_be_taken_in_an_environment_that_pip_made": "pip installs all extras",
    "test_there_are_few_contexts_at_a_time": "many contexts of the solver",
    "test_threads_verify_examples_under_load": "four examples, four times at once",
    "test_time_ends_runs_and_replays": "runs that last for their time",
    "test_turns_that_ask_are_the_robots": "many runs, twice",
    "test_values_are_those_of_the_configurations": "a whole verdict",
    "test_verdicts_that_rest_on_a_broken_contract_are_named": "verdicts of an example, and a drive",
    "test_votes_for_two_robots_are_no_more_than_robots": "as that of the ring",
    "test_what_abc_finds_is_confirmed": "two solvers",
    "test_what_another_program_does_to_maps_is_refuted": "two solvers",
    "test_what_belongs_to_others_is_not_looked_at": "a whole verdict",
    "test_what_breaks_in_any_mutated_program_is_reported": "many verdicts",
    "test_what_breaks_late_is_found_whatever_the_bound": "Spacer, for its time",
    "test_what_ctrl_c_leaves_are_whole_rows": "a campaign, several times",
    "test_what_does_not_hold_is_never_inferred": "many proofs that fail",
    "test_what_grows_for_ever_is_proved_all_the_same": "what all engines but one go on about",
    "test_what_holds_at_each_instant_is_proved": "instants of many rounds",
    "test_what_holds_for_some_numbers_is_refuted_for_every_number": "a proof and its check",
    "test_what_holds_for_the_robots_at_hand_is_told_apart": "a proof and its check",
    "test_what_holds_of_the_driver_by_rclpy_holds": "another run of tests, most of a minute",
    "test_what_is_claimed_of_a_turning_square_holds_in_every_round": "a whole verdict",
    "test_what_is_printed_does_not_hang_on_how_many_processes_there_are": "a long command",
    "test_what_is_proved_is_refuted_for_none": "two solvers",
    "test_what_is_shown_again_of_shared_arrays_is_refuted_for_none": "two solvers",
    "test_what_is_told_early_is_so": "fair lassos of many programs",
    "test_what_is_too_much_for_the_solver_is_asked_once_more_with_more_facts": "a whole verdict",
    "test_what_machine_code_tells_early_is_so": "fair lassos of many programs",
    "test_what_robots_have_of_each_other_is_spoken_of_first": "a whole verdict",
    "test_what_robots_write_at_one_place_is_one_of_their_values": "two solvers",
    "test_what_takes_long_can_be_cancelled_and_koord_begins_again": "the same",
    "test_what_task_claims_holds_with_slack": "a long run",
    "test_what_was_shown_of_another_program_is_not_confirmed": "two solvers",
    "test_whatever_is_ordered_both_drive_the_same": "a long run",
    "test_where_nobody_is_is_told": "it waits until nobody has answered",
    "test_who_may_keep_the_lock_is_not_said_to_send_it": "a ring of any length, for half a minute",
    "test_who_stops_together_has_seen_why": "a whole verdict",
    "test_with_loss_a_killed_robot_and_a_lost_localiser_everybody_is_safe": "two minutes, as well",
    "test_without_found_invariants_it_is_not_confirmed": "a proof and its check",
    "test_without_one_of_its_parts_it_is_refuted": "two solvers",
    "test_without_what_is_spare_all_is_still_proved_and_without_what_is_needed_it_is_not": "proofs",
}


#: Files of tests that wait for vehicles in processes of their own and in real time:
#: `make peers` runs more of them at once than there are cores.
WAITING = (
    "cli/test_conform.py",
    "cli/test_estop.py",
    "cli/test_mavlink.py",
    "cli/test_preflight.py",
    "cli/test_remote.py",
    "cli/test_safe_stop.py",
    "cli/test_small_robots.py",
    "deployed/test_floods.py",
    "deployed/test_rehearsal.py",
    "runtime/platform/ros/test_published.py",
    "runtime/platform/ros1/test_rospy.py",
    "runtime/platform/ros2/test_by_rclpy.py",
    "runtime/platform/ros2/test_killed.py",
    "runtime/platform/ros2/test_rclpy.py",
    "runtime/platform/test_crazyflie_process.py",
    "runtime/platform/test_lab.py",
    "runtime/platform/test_mavsdk.py",
    "runtime/platform/test_motioncapture.py",
    "runtime/platform/test_robotarium_process.py",
    "testing/test_peers.py",
)


#: What `pytest.param` makes.
_CASE = type(pytest.param())

#: What `make peers` asks for by `-m`.
PEERS = "slow and waits"


def waits(file: Path) -> bool:
    """Whether the tests of a file wait for vehicles."""
    return file.as_posix().endswith(tuple(f"tests/{one}" for one in WAITING))


def waits_for_robots(file: Path) -> bool:
    """Whether the tests of a file wait for robots of a fleet that is deployed."""
    return "/tests/deployed/" in file.as_posix()


def forks(file: Path) -> bool:
    """Whether the tests of a file fork their process, which is done beside no other thread."""
    return file.as_posix().endswith("tests/sim/test_planning_workers.py")


def is_too_long(test: str) -> bool:
    """Whether `make sample` leaves out a test, of this name."""
    return test in TOO_LONG or _FAMILIES.search(test) is not None


def one_of_each(items: Iterable[pytest.Item]) -> list[pytest.Item]:
    """What `make sample` runs: a slow case of each test of which no case runs by default.

    The others are seen to run by default. The case is the first one, or the one that has the mark
    ``sample``. This mark also takes in a case that is unlike those of its test that run by default.
    """
    tests: dict[str, list[pytest.Item]] = {}
    for item in items:
        tests.setdefault(item.nodeid.partition("[")[0], []).append(item)
    return [case for cases in tests.values() if (case := _sample(cases)) is not None]


def _sample(cases: Sequence[pytest.Item]) -> pytest.Item | None:
    """The case of a test that is in the sample, if one is."""
    slow = [case for case in cases if case.get_closest_marker("slow") is not None]
    marked = [case for case in slow if case.get_closest_marker("sample") is not None]
    if marked:
        return marked[0]
    is_run_by_default = len(slow) < len(cases)
    if is_run_by_default or is_too_long(cases[0].name.partition("[")[0]):
        return None
    return slow[0]


def first(count: int, cases: Iterable[object]) -> list[object]:
    """The cases of a test, each one argument, a tuple of them or a parameter set of pytest.

    Those after the first ``count`` that are not slow already are slow.
    """
    found: list[object] = []
    for case in cases:
        if isinstance(case, _CASE):
            values, marks, name = case.values, list(case.marks), case.id
        else:
            values, marks, name = case if isinstance(case, tuple) else (case,), [], None
        is_slow = any(mark.name == "slow" for mark in marks)
        if not is_slow and count == 0:
            marks.append(pytest.mark.slow)
        found.append(pytest.param(*values, marks=marks, id=name))
        count -= not is_slow and count > 0
    return found


def but_slow(slow: Collection[object], cases: Iterable[object]) -> list[object]:
    """The cases of a test, of which those are slow whose first argument is in ``slow``."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    assert {row[0] for row in rows} >= set(slow)
    return [pytest.param(*row, marks=[pytest.mark.slow] if row[0] in slow else []) for row in rows]


def sampled(sample: object, cases: Iterable[object]) -> list[object]:
    """A small case that stands for a family in a default run, and the family, which is slow."""
    return [*first(1, [sample]), *first(0, cases)]


def blocks(few: int, *, of: int, count: int, start: int = 0) -> list[object]:
    """Seeds of a family: so many blocks of a size, and for a default run the ``few`` first ones."""
    all_of_them = (range(start + of * n, start + of * (n + 1)) for n in range(count))
    return sampled(range(start, start + few), all_of_them)


def examples(count: int) -> settings:
    """So many examples of what hypothesis makes in `make slow`, and a fifth of them by default."""
    return settings(max_examples=max(3, count * settings().max_examples // 100))
