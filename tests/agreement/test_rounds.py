"""The round as one formula against the round one turn at a time. [T-SNAPSHOT] [T-COMMIT]

The sequential rules of ``rounds`` are the reference. The derived round works every turn out on the
snapshot and puts the writes into the store in the order of the running robots.
"""

from __future__ import annotations

from itertools import permutations

import pytest
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Turn
from koord.semantics.domain import EXACT, Constant
from koord.semantics.recordings import RecordedInputs
from koord.semantics.rounds import run_event, run_skip
from koord.semantics.turns import Turned, committed, program_turn, skip_turn
from koord.syntax.system import Status
from tests.agreement.triples import Triple, triple
from tests.sampling import blocks

SEEDS = pytest.mark.parametrize("seeds", blocks(30, of=250, count=1))


def at_once(t: Triple, order: tuple[int, ...]) -> Configuration[Constant]:
    """The end of the program turns, derived from one turn of each robot on the snapshot."""
    inputs = RecordedInputs(readings=t.round.readings, answers=t.round.answers)
    turns: dict[int, Turned[Constant]] = {}
    for robot in order:
        state, position = t.start.robots[robot], t.round.events[robot]
        if position is None:
            turns[robot] = skip_turn(EXACT, state)
        else:
            _, turns[robot] = program_turn(EXACT, t.system, robot, state, position, inputs)
    store = t.start.store
    for robot in order:
        store = committed(EXACT, store, turns[robot])
    robots = tuple(turns[i].robot for i in range(t.system.robots))
    if all(robot.status != Status.RUNNING for robot in robots):
        robots = tuple(replace(robot, status=int(Status.STOPPED)) for robot in robots)
    entered = frozenset(k for turned in turns.values() for k, on in turned.entered.items() if on)
    return Configuration(robots, store, t.start.round, Turn.ENV, entered)


def in_turn(t: Triple, order: tuple[int, ...]) -> Configuration[Constant]:
    """The same by the sequential rules."""
    inputs = RecordedInputs(readings=t.round.readings, answers=t.round.answers)
    configuration = t.start
    for robot in order:
        position = t.round.events[robot]
        if position is None:
            stepped = run_skip(EXACT, t.system, configuration, robot, inputs)
        else:
            stepped = run_event(EXACT, t.system, configuration, robot, position, inputs)
        configuration = stepped.configuration
    return configuration


@pytest.mark.parametrize("seeds", blocks(30, of=250, count=4))
def test_a_round_at_once_is_a_round_in_turn(seeds: range) -> None:
    whole = 0
    for seed in seeds:
        t = triple(seed)
        if t.round.cut:
            continue
        whole += 1
        assert in_turn(t, t.round.order) == at_once(t, t.round.order), seed
    assert whole > len(seeds) // 4


@SEEDS
def test_every_order_with_the_running_robots_first_is_legal(seeds: range) -> None:
    """[T-ONE-WINNER]: whoever runs, in whatever order, and then whoever skips."""
    races = 0
    for seed in seeds:
        t = triple(seed)
        if t.round.cut:
            continue
        running = [i for i in t.round.order if t.round.events[i] is not None]
        skipping = tuple(i for i in t.round.order if t.round.events[i] is None)
        ends = [in_turn(t, (*order, *skipping)) for order in permutations(running)]
        assert all(
            end.robots[i].locals == ends[0].robots[i].locals for end in ends for i in running
        )
        assert all(end.store.allread == ends[0].store.allread for end in ends), seed
        races += any(end.store != ends[0].store for end in ends)
    assert races >= len(seeds) // 125


@SEEDS
def test_a_prefix_is_a_round_in_which_the_others_skip(seeds: range) -> None:
    """[T-PREFIX]: in what properties read, for systems without urgent events or ``trystop``."""
    compared = 0
    for seed in seeds:
        t = triple(seed)
        urgent = any(e.urgent for a in t.system.program.agents for e in a.events)
        asked = any(robot.status != Status.RUNNING for robot in t.start.robots)
        if t.round.cut or urgent or asked or "TryStop" in repr(t.system.program.agents):
            continue
        for length in range(1, t.system.robots):
            prefix = in_turn(t, t.round.order[:length])
            events = tuple(
                t.round.events[i] if i in t.round.order[:length] else None
                for i in range(t.system.robots)
            )
            rest = replace(t, round=replace(t.round, events=events))
            whole = in_turn(rest, t.round.order)
            assert prefix.store == whole.store
            for early, late in zip(prefix.robots, whole.robots, strict=True):
                assert (early.locals, early.ports) == (late.locals, late.ports)
                assert (early.status, early.ran) == (late.status, late.ran)
            compared += 1
    assert compared > len(seeds) // 16


@SEEDS
def test_ran_is_cleared_when_a_round_opens(seeds: range) -> None:
    for seed in seeds:
        t = triple(seed)
        if not t.round.cut and t.system.robots > 1:
            first = in_turn(t, t.round.order[:1])
            others = t.round.order[1:]
            assert all(first.robots[i].ran == NO_EVENT for i in others)
