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
from koord.refinement.cases import Case, Tried, all_generated, tried
from koord.refinement.cases import Target as Way
from koord.refinement.cases import generated as generated_case
from koord.refinement.running import Compiled, engine_of, ready, size_of
from koord.refinement.sampling_hosts import SampledHost
from koord.refinement.translation import Translation
from koord.runtime.columns.counts import Counts
from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.proposals import INIT_ROUND
from koord.sampling.sampled_inputs import SampledInputs
from koord.sampling.values import Sampler
from koord.syntax.diagnostics import KoordError
from koord.traces.trace import Numbers
from tests.runtime.column_twins import told as alike
from tests.sampling import but_slow, first

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

FEW, MANY, ROUNDS = 40, 600, 6

#: Runs end where values have so many parts: lists of generated programs double in each round.
LARGEST = 120

#: Examples all of whose turns have machine code.
WHOLE = (
    *("allstop", "cars_and_drones", "fischer", "follow_path", "follow_points", "hvac"),
    *("leader_elect", "lineform", "lineform_1d", "sum_of_ids", "traffic", "waypoints"),
)


def generated(seed: int, count: int) -> Iterator[Tried]:
    cases = all_generated(Random(seed), ROUNDS, Way.KERNELS)
    return (tried(case) for case in islice(cases, count))


@pytest.mark.parametrize(
    ("seed", "count"), [(0, FEW), *(pytest.param(k, MANY, marks=pytest.mark.slow) for k in (1, 2))]
)
def test_generated_programs_do_by_machine_code_what_the_rules_allow(seed: int, count: int) -> None:
    by_code = in_doubt = sure = 0
    for found in generated(seed, count):
        assert not found.failed, (found.case.seed, found.refused, found.crash)
        if found.ran is not None and found.ran.counts is not None:
            by_code += found.ran.counts.by_code
            in_doubt += found.ran.counts.in_doubt
            sure += found.ran.counts.claims_by_code
    assert by_code > count
    assert in_doubt > 0
    assert sure > count // 2


def history(case: Case, made: Compiled, *, by_code: bool) -> tuple[list[str], Counts]:
    """All that is in each round of a run, with choices that hang on the case alone."""
    rng, system = Random(case.seed), case.system
    schedule = case.policy.schedule(rng)
    translation = Translation(system, made.names)
    host = SampledHost(translation, SampledInputs(Sampler(system, Numbers.DOUBLE, rng)))
    engine = engine_of(made, system, host, kernels=by_code)
    told: list[str] = []
    try:
        order = schedule.order(INIT_ROUND, system.robots)
        host.settle_start(order)
        engine.begin(order)
        while engine.ended is None and len(told) < case.rounds and not engine.all_stopped:
            host.inputs.forget_round()
            host.inputs.look_at(translation.configuration(engine))
            decision = engine.program_turns(schedule)
            if decision.fault is None:
                host.settle_readings(translation.configuration(engine))
                engine.environment_turn()
            told.append(alike(decision, engine))
            if max(map(size_of, engine.robots)) > LARGEST:
                break
    except KoordError as error:  # no values that the program allows are found
        told.append(repr(error))
    return told, engine.counts if isinstance(engine, ColumnEngine) else Counts()


@pytest.mark.parametrize(
    ("first", "count"), [(0, 40), *(pytest.param(k, 500, marks=pytest.mark.slow) for k in (1, 2))]
)
def test_generated_programs_run_the_same_with_and_without(first: int, count: int) -> None:
    by_code = 0
    for seed in range(10_000 * first, 10_000 * first + count):
        case = generated_case(seed, 20)
        made = ready(case.system.program)
        one, _ = history(case, made, by_code=False)
        other, counts = history(case, made, by_code=True)
        assert len(one) == len(other), seed
        for round_, (here, there) in enumerate(zip(one, other, strict=True)):
            if here != there:
                pytest.fail(f"case {seed}, round {round_}")  # to show both would take long
        by_code += counts.by_code
    assert by_code > 3 * count


@pytest.mark.parametrize("name", first(1, but_slow([n for n in WHOLE if n > "g"], WHOLE)))
def test_examples_are_run_by_machine_code(name: str) -> None:
    program = program_of(str(EXAMPLES / f"{name}.krd"))
    found = refine(program, target="kernels", runs=6, rounds=20)
    (totals,) = found.targets
    assert found.ok
    assert totals.turns_by_code > 20
    assert totals.turns_by_robots < totals.turns_by_code // 2


@pytest.mark.slow
def test_turns_that_ask_are_the_robots() -> None:
    found = refine(program_of(str(EXAMPLES / "task.krd")), target="kernels", runs=4, rounds=6)
    (totals,) = found.targets
    assert found.ok
    assert totals.turns_by_robots > 0
