"""Turns by machine code are turns of the semantics, of generated programs and of the examples."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from random import Random

import pytest

pytest.importorskip("llvmlite")

from koord.api.programs import program_of
from koord.api.refinement import refine
from koord.refinement.cases import Target as Way
from koord.refinement.cases import Tried, all_generated, tried
from tests.sampling import but_slow

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

FEW, MANY, ROUNDS = 40, 600, 6

#: Examples all of whose turns have machine code.
WHOLE = (
    *("allstop", "cars_and_drones", "fischer", "follow_path", "hvac", "leader_elect"),
    *("lineform", "lineform_1d", "sum_of_ids", "traffic"),
)


def generated(seed: int, count: int) -> Iterator[Tried]:
    cases = all_generated(Random(seed), ROUNDS, Way.KERNELS)
    return (tried(case) for case in islice(cases, count))


@pytest.mark.parametrize(
    ("seed", "count"), [(0, FEW), *(pytest.param(k, MANY, marks=pytest.mark.slow) for k in (1, 2))]
)
def test_generated_programs_do_by_machine_code_what_the_rules_allow(seed: int, count: int) -> None:
    by_code = in_doubt = 0
    for found in generated(seed, count):
        assert not found.failed, (found.case.seed, found.refused, found.crash)
        if found.ran is not None and found.ran.counts is not None:
            by_code += found.ran.counts.by_code
            in_doubt += found.ran.counts.in_doubt
    assert by_code > count
    assert in_doubt > 0


@pytest.mark.parametrize("name", but_slow([n for n in WHOLE if n > "g"], WHOLE))
def test_examples_are_run_by_machine_code(name: str) -> None:
    program = program_of(str(EXAMPLES / f"{name}.krd"))
    found = refine(program, target="kernels", runs=6, rounds=20)
    (totals,) = found.targets
    assert found.ok
    assert totals.turns_by_code > 20
    assert totals.turns_by_robots < totals.turns_by_code // 2


def test_turns_that_ask_are_the_robots() -> None:
    found = refine(program_of(str(EXAMPLES / "task.krd")), target="kernels", runs=4, rounds=6)
    (totals,) = found.targets
    assert found.ok
    assert totals.turns_by_robots > 0
