"""Long families of cases, of which a default run takes a few and `make slow` takes all."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

import pytest
from hypothesis import settings

#: Whole families in blocks of a minute or more. Small samples of them are tests by themselves.
_FAMILIES = re.compile(r"_many(_|$)|_at_length$|_further_on$")

#: What takes more than 15 seconds of CPU by itself: tests, or single cases of them, and why.
TOO_LONG = {
    "test_all_three_refuse_all_mutants_alike": "three readers of some hundred configurations",
    "test_cars_among_processes_make_the_same_run": "half a minute of a fleet, twice",
    "test_events_that_never_run_are_told": "what never happens, looked for in all ways",
    "test_the_fewest_rounds_are_the_fewest_of_many": "all runs of 60 programs",
    "test_floods_delay_nobody[100000]": "700,000 datagrams",
    "test_nothing_false_is_confirmed_of_a_thousand_edits": "a thousand certificates",
    "test_some_work_is_done_for_all_rounds": "an engine that is given twenty seconds",
    "test_the_protocol_can_be_checked_by_itself": "eight runs of it in chaos",
    "test_the_tests_pass_without_mistakes": "all tests that mutants name",
    "test_the_text_is_typed": "mypy, of all compiled examples",
    "test_the_tour_can_be_taken_in_an_environment_that_pip_made": "pip installs all extras",
    "test_threads_verify_examples_under_load": "four examples, four times at once",
    "test_users_see_what_was_frozen[refinement]": "runs of generated programs",
    "test_ways_of_generated_programs_differ": "every way to break 100 programs",
    "test_what_passes_a_limit_is_refused_and_nothing_else[values of a configuration]": "the limit",
}


def is_too_long(test: str) -> bool:
    """Whether `make sample` leaves out a test, which may be followed by its case."""
    name = test.partition("[")[0]
    return name in TOO_LONG or test in TOO_LONG or _FAMILIES.search(name) is not None


def first(count: int, cases: Iterable[object]) -> list[object]:
    """The cases of a test, each one argument or a tuple of them; those after ``count`` are slow."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [
        pytest.param(*row, marks=[pytest.mark.slow] if at >= count else [])
        for at, row in enumerate(rows)
    ]


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
