"""What robots of one process would work out alike: once, and for the very objects that it is of."""

from __future__ import annotations

from koord.runtime.alike import keeps_last
from koord.runtime.chaos.network import CALM, Network
from koord.runtime.chaos.storm import Ledgers
from koord.runtime.protocol.committing import admitted_of
from koord.runtime.protocol.messages import LastRun, digest
from koord.runtime.protocol.setup import Setup, Timing


def test_the_last_result_is_that_of_the_same_objects_only() -> None:
    asked: list[tuple[object, ...]] = []

    @keeps_last
    def double(a: list[int]) -> list[int]:
        asked.append((a,))
        return a * 2

    @keeps_last
    def joined(a: list[int], b: list[int]) -> list[int]:
        asked.append((a, b))
        return a + b

    one, equal, other = [1], [1], [2]
    assert double(one) is double(one)
    assert double(equal) is not double(one)
    assert len(asked) == 3
    assert double(other) == [2, 2]
    asked.clear()
    assert joined(one, other) is joined(one, other)
    assert [joined(one, equal), joined(other, equal), joined(other, one)] == [
        [1, 1],
        [2, 1],
        [2, 1],
    ]
    assert len(asked) == 4


def test_robots_of_one_process_hold_one_history_as_one_object() -> None:
    robots = 9
    setup = Setup(robots, Timing.of(0.1, robots))
    ledgers = Ledgers(setup)
    network = Network(setup, CALM, 3, ledgers.switch_on)
    while min(state.round for state in network.running()) < 6:
        network.step()
    states = [state for state in network.running() if state.round == 6]
    assert len(states) == robots, "nobody is ahead between two rounds"
    assert len({id(state.last_ran) for state in states}) == 1
    assert len({id(ledger.store) for ledger in ledgers.ledgers}) == 1
    state = states[0]
    ran: list[LastRun | None] = [None] * robots
    store = {}
    for held in state.log:
        decision = held.entry.decision
        assert digest(held.entry) == held.digest
        for robot in range(robots):
            turns = [taken for taken in decision.ran if taken.robot == robot]
            taken_by = admitted_of(held.entry, robot)
            assert ([] if taken_by is None else [taken_by]) == turns
            for taken in turns:
                ran[robot] = LastRun(decision.round, taken.event)
        for write in decision.writes:
            store[(write.variable, *write.path)] = write.value
    assert state.last_ran == tuple(ran)
    assert ledgers.ledgers[4].store == store
