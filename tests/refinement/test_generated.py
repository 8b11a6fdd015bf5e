"""Generated programs do, compiled, what the rules allow; together they use all of the language."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import islice
from random import Random

import pytest

from koord.cli.tables import RunTable, ShownStep
from koord.cli.terminal import PLAIN
from koord.refinement.cases import Case, Tried, all_generated, generated, tried
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.recordings import execute
from koord.semantics.storage import Cell, Storage
from koord.syntax import core
from koord.syntax.walk import nodes
from koord.traces.changes import changes
from koord.traces.names import Names

#: Runs of each seed, here and in the slow tests; seeds are those of `koord check-refinement`.
FEW, MANY = 40, 400
ROUNDS = 4
SEEDS, MANY_SEEDS = range(2), range(11)


def cases(seed: int, rounds: int, count: int) -> Iterator[Case]:
    return islice(all_generated(Random(seed), rounds), count)


@pytest.fixture(scope="module")
def outcomes() -> list[Tried]:
    return [tried(case) for seed in SEEDS for case in cases(seed, ROUNDS, FEW)]


def test_compiled_programs_refine_what_they_were_compiled_from(outcomes: list[Tried]) -> None:
    assert [(o.case.seed, o.refused, o.crash) for o in outcomes if o.failed] == []


def test_runs_come_far_enough_to_say_something(outcomes: list[Tried]) -> None:
    judged = [o.judged for o in outcomes if o.judged is not None]
    assert sum(j.steps for j in judged) > 6 * len(outcomes)
    faults = {o.ran.fault_place for o in outcomes if o.ran is not None}
    assert len(faults) > len(outcomes) // 10
    given_up = [o for o in outcomes if o.ran is not None and o.ran.gave_up is not None]
    assert len(given_up) < len(outcomes) // 5


def test_of_a_step_that_faults_nothing_is_seen_but_the_fault(outcomes: list[Tried]) -> None:
    """[FAULT]: what the table of a run and its trace show ends with the configuration before it."""
    rules: Counter[str] = Counter()
    for outcome in outcomes:
        judged = outcome.judged
        if judged is None or judged.trace.configurations[-1].fault is None:
            continue
        trace, names = judged.trace, Names(judged.trace.system)
        *earlier, last = execute(DOUBLES, trace.system, trace.recording)
        rules[last.rule] += 1
        table = RunTable(names, PLAIN)
        if earlier:
            before = earlier[-1].configuration
            assert list(changes(names, before, last.configuration)) == []
            shown = list(table.round(last.round, [ShownStep(last, before)]))
        else:
            shown = list(table.start(last))
            assert not any(" = " in line for line in shown)
            robots, store = last.configuration.robots, last.configuration.store
            own = [storage for robot in robots for storage in (*robot.locals, *robot.ports)]
            assert not any(map(_holds_something, (*own, *store.allread, *store.allwrite)))
        assert not any("→" in line for line in shown)
        assert sum("fault: " in line for line in shown) == 1
    assert set(rules) == {"INIT", "EVENT-TRANS", "ENV-TRANS"}


def _holds_something(storage: Storage[Constant]) -> bool:
    if isinstance(storage, Cell):
        return bool(storage.is_set)
    return any(map(_holds_something, storage.parts))


@pytest.mark.slow
def test_all_of_the_language_is_used() -> None:
    seen: Counter[object] = Counter()
    for case in (case for seed in range(5) for case in cases(seed, ROUNDS, 60)):
        program = case.system.program
        for node in nodes((program.agents, program.functions, program.allread, program.allwrite)):
            seen[type(node)] += 1
            if isinstance(node, core.Binary | core.Unary | core.Builtin):
                seen[node.op] += 1
        seen["several kinds"] += len(program.agents) > 1
        seen["urgent"] += any(e.urgent for agent in program.agents for e in agent.events)
        seen["model"] += any(m.environment for agent in program.agents for m in agent.modules)
    wanted: list[object] = [
        *(core.Assign, core.If, core.ForRange, core.ForEach, core.Break, core.Return, core.Atomic),
        *(core.Stop, core.TryStop, core.Output, core.Append, core.Remove, core.Pop),
        *(core.Const, core.Pid, core.NumAgents, core.Delta, core.Read, core.Select, core.MakeList),
        *(core.MakeMap, core.MakeRecord, core.Call, core.ExternalCall, core.Choose),
        *(core.IndexStep, core.KeyStep, core.FieldStep),
        *core.BinaryOp,
        *core.UnaryOp,
        *core.ListOp,
        "several kinds",
        "urgent",
        "model",
    ]
    assert [one for one in wanted if not seen[one]] == []


def test_a_case_gives_the_same_run_again(outcomes: list[Tried]) -> None:
    for outcome in outcomes[:5]:
        again = tried(generated(outcome.case.seed, ROUNDS))
        assert outcome.judged is not None
        assert again.judged is not None
        assert again.judged.trace.recording == outcome.judged.trace.recording


def test_a_run_whose_values_double_ends() -> None:
    """This one filled the memory within eight rounds."""
    outcome = tried(generated(1340279962, 8))
    assert not outcome.failed
    assert outcome.ran is not None
    assert 0 < len(outcome.ran.trace.recording.rounds) < 8


@pytest.mark.parametrize("seed", [1429152570, 1241425227])
def test_a_sensor_may_show_a_map_with_its_keys_in_another_order(seed: int) -> None:
    """[CONFIG]: maps that are equal to a program are not the same, for a loop can tell."""
    outcome = tried(generated(seed, 8))
    assert not outcome.failed
    assert outcome.ran is not None
    assert len(outcome.ran.trace.recording.rounds) > 6


@pytest.mark.slow
@pytest.mark.parametrize("seed", MANY_SEEDS)
def test_many_compiled_programs_refine_theirs(seed: int) -> None:
    found = [tried(case) for case in cases(seed, 8, MANY)]
    assert [(o.case.seed, o.refused, o.crash) for o in found if o.failed] == []
