"""The mistakes that are tried in every run of the tests, each with one test that notices it.

The others are left to `make slow`: each takes a process of its own, and a second or two.
"""

from __future__ import annotations

_ROUNDS = "tests/verify/encoding/test_rounds.py::"
_BMC = "tests/verify/engines/bmc/test_engine.py::"
_RUN = "tests/semantics/test_run.py::"

#: By name of the mutant.
QUICK = {
    # the rules
    "reads are from the store and not from the snapshot": (
        f"{_ROUNDS}test_races_end_as_some_order_ends_them[lists]"
    ),
    "a lock is never taken": f"{_ROUNDS}test_races_end_as_some_order_ends_them[mixed]",
    "a stopped robot runs events": f"{_RUN}test_the_effect_goes_on_behind_stop",
    "stop only asks": f"{_RUN}test_who_stops_has_stopped_while_others_go_on",
    "short circuits evaluate everything": (
        "tests/agreement/test_symbols.py::test_turns_and_properties_agree"
    ),
    "faults in guards are ignored": (
        f"{_BMC}test_a_guard_that_faults_is_a_fault_and_does_not_oblige"
    ),
    "what is unset counts as set": f"{_BMC}test_every_kind_of_fault_is_found[FaultKind.UNSET]",
    "a break leaves two loops": f"{_RUN}test_output_labels_the_step",
    "a queue gives its last": f"{_RUN}test_lists_queues_and_maps",
    "a model reads the values after the turn": (
        f"{_BMC}test_sensors_without_a_model_keep_contracts_and_nothing_else"
    ),
    "writes of parts do not reach the store": (
        f"{_ROUNDS}test_races_end_as_some_order_ends_them[record]"
    ),
    "lost updates ignore the keys of a map": (
        f"{_BMC}test_writes_at_other_keys_and_indices_lose_nothing"
    ),
    # the verifier
    "two robots may enter one lock class": (
        f"{_ROUNDS}test_races_end_as_some_order_ends_them[mixed]"
    ),
    "stopped robots may run in the formula": f"{_BMC}test_who_has_stopped_runs_no_event",
    "the first writer wins": f"{_ROUNDS}test_a_race_after_a_round_is_decided_anew",
    "assumptions are dropped": f"{_BMC}test_assumptions_restrict_where_runs_begin",
    "a faulted configuration has successors": f"{_BMC}test_a_faulted_run_ends",
    "induction assumes what it is to prove": (
        "tests/verify/engines/induction/test_engine.py::test_what_is_true_need_not_be_inductive"
    ),
    "induction skips the middle of the round": (
        "tests/verify/engines/induction/test_engine.py::test_what_is_true_need_not_be_inductive"
    ),
    "the axiom of a summary is dropped": (
        "tests/verify/encoding/test_symbols.py::test_a_summary_about_other_questions_holds_of_all"
    ),
    "what is written in atomic blocks is never written": (
        "tests/syntax/test_footprint.py::test_writes_are_found_wherever_they_stand"
    ),
    "all opaque values are of one type": (
        "tests/verify/reduction/test_abstraction.py::test_what_only_external_functions_look_into_flows"
    ),
    "the witness drops the order": (
        "tests/verify/test_witness.py::test_what_the_order_decides_is_in_the_recording"
    ),
}
