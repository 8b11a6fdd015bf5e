"""The sample of slow tests leaves out what is there, and nothing else."""

from __future__ import annotations

from pathlib import Path

from tests.sampling import TOO_LONG, is_too_long


def test_what_the_sample_leaves_out_are_tests() -> None:
    texts = [path.read_text("utf-8") for path in Path(__file__).parent.rglob("test_*.py")]
    tests = {test.partition("[")[0] for test in TOO_LONG}
    assert [test for test in tests if not any(f"def {test}(" in text for text in texts)] == []


def test_a_case_may_be_left_out_alone() -> None:
    assert is_too_long("test_users_see_what_was_frozen[refinement]")
    assert not is_too_long("test_users_see_what_was_frozen[help]")
    assert is_too_long("test_the_sequential_rules_agree_on_many[3]")
    assert not is_too_long("test_the_sequential_rules_agree[seeds1]")
