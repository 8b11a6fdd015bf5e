"""Stories of traces: what is told is what the rules give, and parts of formulas add up. [TRACE]"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import pytest
from msgspec.structs import replace

import koord
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.oracle import NoInputs
from koord.semantics.properties import holds_in
from koord.semantics.recordings import execute
from koord.syntax.source import Source
from koord.traces import formula_values, story
from koord.traces.names import Names
from koord.traces.rendering import show_storage
from koord.traces.story_form import FormulaNode, Story
from koord.traces.trace import Trace

RACE = """\
allwrite:
    int total = 0
    int[3] log = [0, 0, 0]
local:
    bool done = false
Add:
    pre: not done
    eff:
        atomic:
            total = total + pid + 1
            log[pid] = total
        done = true
Rest:
    pre: done
    eff: stdout << "at " << total
invariant Small: forall i, j: i < j and done@i implies total < 4 or log[j] == 0
invariant Odd at round: total != 3 or not done@1
eventually All: total > 9
"""


def counterexample(name: str, text: str = RACE, robots: int = 3) -> Trace:
    """The run that breaks a property of a program."""
    report = koord.verify(Source("race.krd", text), robots=robots, jobs=1)
    found = report.verdict(name).counterexample
    assert found is not None
    return found.recorded


@pytest.fixture(scope="module")
def small() -> Trace:
    return counterexample("Small")


def nodes(formula: FormulaNode) -> Iterator[FormulaNode]:
    yield formula
    for part in formula.parts:
        yield from nodes(part)


def configurations(trace: Trace) -> list[Configuration[Constant]]:
    steps = execute(trace.numbers.domain, trace.system, trace.recording)
    return [step.configuration for step in steps]


def values_at(told: Story, position: int) -> list[str]:
    """The values of all rows after a turn, by what turns change."""
    values = [row.start for row in told.rows]
    for moment in told.moments[: position + 1]:
        for change in moment.changes:
            assert values[change.row] != change.value
            values[change.row] = change.value
    return values


@pytest.mark.slow
def test_values_are_those_of_the_configurations(small: Trace) -> None:
    told, names = story.story_of(small), Names(small.system)
    assert [row.name for row in told.rows[:4]] == ["total", "log[0]", "log[1]", "log[2]"]
    for position, configuration in enumerate(configurations(small)):
        values = dict(
            zip([(r.name, r.robot) for r in told.rows], values_at(told, position), strict=True)
        )
        total, log = (one.type for one in names.allwrite)
        assert values["total", None] == show_storage(configuration.store.allwrite[0], total)
        shown = show_storage(configuration.store.allwrite[1], log)
        assert shown == f"[{', '.join(values[f'log[{k}]', None] for k in range(3))}]"
        for robot, state in enumerate(configuration.robots):
            (own,) = names.of(robot).locals
            assert values["done", robot] == show_storage(state.locals[0], own.type)


def test_the_step_that_breaks_it_is_the_first_after_which_it_does_not_hold(small: Trace) -> None:
    told = story.story_of(small)
    (track,) = told.tracks
    stated = small.system.program.properties[0]
    expected = [
        holds_in(small.numbers.domain, small.system, c, stated.condition, stated.bound, NoInputs())[
            0
        ]
        for c in configurations(small)
    ]
    assert track.truth == expected
    breaking = told.moments[told.ending.moment]
    assert expected.index(False) == told.ending.moment
    assert told.ending.headline == (
        f"Small does not hold, in round {breaking.round}, as robot {breaking.robot} runs Add"
    )
    assert told.ending.place is not None
    assert RACE.splitlines()[told.ending.place.line - 1].startswith("invariant Small")


def test_formulas_have_the_value_of_the_statement_after_each_turn(small: Trace) -> None:
    (track,) = story.story_of(small).tracks
    assert [one.moment for one in track.formulas] == list(range(len(track.truth)))
    for one in track.formulas:
        assert one.formula.value == str(track.truth[one.moment]).lower()


def test_connectives_are_made_of_their_parts(small: Trace) -> None:
    seen = set()
    for one in story.story_of(small).tracks[0].formulas:
        for node in nodes(one.formula):
            if node.value is None:
                assert not node.parts
                continue
            deciding = {part.value for part in node.parts if part.decides}
            if node.text.startswith("forall"):
                seen.add(("forall", node.value))
                assert deciding == {node.value}
            elif " implies " in node.text:
                left, right = node.parts
                seen.add(("implies", node.value))
                if left.value == "false":
                    assert (node.value, right.value, right.note) == ("true", None, "not looked at")
                else:
                    assert right.decides
                    assert node.value == right.value
            elif " or " in node.text or " and " in node.text:
                seen.add((node.text.split()[3], node.value))
                assert deciding == {node.value}
    assert {
        ("forall", "true"),
        ("forall", "false"),
        ("implies", "true"),
        ("implies", "false"),
    } <= seen


def test_instances_of_quantifiers_right_below_each_other_are_told_together(small: Trace) -> None:
    told = story.story_of(small)
    formula = told.tracks[0].formulas[told.ending.moment].formula
    assert formula.text.startswith("forall i, j: ")
    (bad,) = [part for part in formula.parts if part.decides]
    names = [name for name, _ in (each.split(" = ") for each in bad.binding.split(", "))]
    assert names == ["i", "j"]
    assert bad.value == "false"
    leaves = {node.text: node.value for node in nodes(bad) if not node.parts}
    last = configurations(small)[told.ending.moment]
    total = Names(small.system).allwrite[0].type
    assert leaves["total"] == show_storage(last.store.allwrite[0], total)


def test_more_instances_than_are_told_are_counted(
    small: Trace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(formula_values, "_MOST_SPARE", 1)
    for one in story.story_of(small).tracks[0].formulas:
        told = len(one.formula.parts) + one.formula.left_out
        assert one.formula.value == str(one.formula.parts[-1].value)
        assert told >= 1
    held = story.story_of(small).tracks[0].formulas[0].formula
    assert held.left_out == 2  # of i = 0, 1, 2 one is told


def test_who_finds_a_lock_taken_is_told() -> None:
    trace = koord.run(Source("race.krd", RACE), robots=3, rounds=3).trace.recorded
    told = story.story_of(trace)
    first = [m for m in told.moments if m.round == 1 and m.robot is not None]
    assert sorted((m.event is not None, m.blocked) for m in first) == [
        (False, "Add"),
        (False, "Add"),
        (True, None),
    ]
    rested = [m for m in told.moments if m.output]
    assert rested
    assert all(m.output[0].startswith("stdout << at ") for m in rested)


def test_who_can_run_nothing_is_not_told_to_wait_for_a_lock() -> None:
    text = RACE.partition("Rest:")[0]
    late = 0
    for seed in range(4):
        run = koord.run(Source("race.krd", text), robots=3, rounds=3, policy="random", seed=seed)
        done: set[int] = set()
        taken = -1  # the round in which somebody had the lock last
        for moment in story.story_of(run.trace.recorded).moments:
            if moment.robot is None:
                continue
            if moment.event is not None:
                done.add(moment.robot)
                taken = moment.round
            elif moment.robot in done:
                late += taken == moment.round
                assert moment.blocked is None
            else:
                assert moment.blocked == ("Add" if taken == moment.round else None)
    assert late > 0


@pytest.mark.slow
def test_statements_about_ends_of_rounds_are_asked_there_only() -> None:
    told = story.story_of(counterexample("Odd"))
    (track,) = told.tracks
    for moment, truth in zip(told.moments, track.truth, strict=True):
        assert (truth is None) is (moment.rule not in ("INIT", "ENV-TRANS"))
    assert track.truth[told.ending.moment] is False
    assert "at the end of round" in told.ending.headline


@pytest.mark.slow
def test_loops_are_told_with_their_goal() -> None:
    trace = counterexample("All")
    told = story.story_of(trace)
    assert told.loop is not None
    assert told.loop.first == (trace.recording.loop or 0) + 1
    assert told.loop.last == len(trace.recording.rounds)
    (goal,) = told.tracks
    assert goal.name == "All: goal"
    assert {truth for truth in goal.truth if truth is not None} == {False}
    assert told.ending.kind == "loop"
    assert "for ever" in told.ending.headline


FAULTY = """\
local:
    int[2] a = [1, 2]
    int k = 0
Go:
    pre: k < 3
    eff:
        a[k] = 0
        k = k + 1
"""


def test_faults_are_told_with_their_place() -> None:
    told = story.story_of(koord.run(Source("f.krd", FAULTY), robots=1).trace.recorded)
    assert told.ending.kind == "fault"
    assert "index out of range, in round 3, as robot 0 runs Go" in told.ending.headline
    fault = told.moments[-1].fault
    assert fault is not None
    assert fault.place is not None
    assert FAULTY.splitlines()[fault.place.line - 1].strip() == "a[k] = 0"
    assert told.ending.moment == len(told.moments) - 1


ASIDE = """\
using Motion:
    sensors:
        pos position
    actuators:
        pos target
Go:
    pre: true
    eff: Motion.target = pos3d(1.0, 2.0, float(pid))
assume: Motion.position == pos3d(float(pid), 0.5, 0.0)
invariant Near: Motion.target.x < 0.5
"""


def test_places_of_robots_are_told_in_metres() -> None:
    text = ASIDE.replace(
        "    actuators:\n        pos target",
        "    actuators:\n        pos target = pos3d(0.0, 0.0, 0.0)",
    )
    told = story.story_of(counterexample("Near", text, robots=2))
    world = told.world
    assert world is not None
    start = {p.row: (p.x, p.y, p.z) for p in told.moments[0].positions}
    assert [start[row] for row in world.robots if row is not None] == [(0, 0.5, 0), (1, 0.5, 0)]
    breaking = told.moments[told.ending.moment]
    assert breaking.robot is not None
    (moved,) = breaking.positions
    assert moved.row == world.targets[breaking.robot]
    assert (moved.x, moved.y, moved.z) == (1.0, 2.0, float(breaking.robot))


def test_of_long_runs_the_last_rounds_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    text = RACE.partition("invariant")[0]
    trace = koord.run(Source("race.krd", text), robots=3, rounds=12).trace.recorded
    whole = story.story_of(trace)
    monkeypatch.setattr(story, "MOST_MOMENTS", 14)
    late = story.story_of(trace)
    assert late.left_out > 0
    assert late.moments[0].round == late.left_out + 1
    skipped = len(whole.moments) - len(late.moments)
    assert late.moments == whole.moments[skipped:]
    for position in range(len(late.moments)):
        assert values_at(late, position) == values_at(whole, skipped + position)


def test_a_trace_in_doubles_is_told_in_doubles() -> None:
    text = "local:\n    float x = 0.1\nGo:\n    pre: true\n    eff: x = x + 0.2\n"
    made = koord.run(Source("d.krd", text), robots=1, rounds=2, numbers="double")
    told = story.story_of(made.trace.recorded)
    assert (told.numbers, values_at(told, len(told.moments) - 1)[0]) == ("double", "0.5")
    exact = replace(made.trace.recorded.system, delta_s=Fraction(1, 3))
    assert exact.delta_s != told.delta_s
