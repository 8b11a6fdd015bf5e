"""Packets and bytes of a run's agreement: those that deployed robots send and receive."""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.api.campaign import campaign
from koord.api.sim_setup import simulation
from koord.runtime.engine import RoundEngine
from koord.sim.running import Simulation, run
from koord.sim.traffic import Traffic, TrafficMeter
from tests.runtime.test_deploy import Deployment, engine

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"


def deployed(name: str, robots: int, rounds: int) -> Traffic:
    """What robots of a deployed run count, in which nothing is lost and nobody is late."""
    run = Deployment(name, robots, rounds=rounds)
    run.run(until=rounds)
    while any(run.hub.inboxes):  # what was said last is on its way
        run.turn()
    counts = [peer.counts for peer in run.peers.values()]
    return Traffic(
        sum(one.datagrams for one in counts),
        sum(one.arrived for one in counts),
        sum(one.sent_bytes for one in counts),
        sum(one.arrived_bytes for one in counts),
    )


def metered(name: str, robots: int, rounds: int, monkeypatch: pytest.MonkeyPatch) -> Traffic:
    """The same of a run in one loop, without messages."""
    meter, act = TrafficMeter(robots), RoundEngine._act

    def listen(self: RoundEngine, decision: object) -> None:
        meter.note(decision, self.proposed)  # type: ignore[arg-type]
        act(self, decision)  # type: ignore[arg-type]

    monkeypatch.setattr(RoundEngine, "_act", listen)
    engine(name, robots, rounds)
    return meter.traffic


@pytest.mark.parametrize(
    ("name", "robots"),
    [("task", 1), ("task", 2), ("task", 4), ("leader_elect", 5), ("lineform", 3), ("lineform", 40)],
)
def test_counts_are_those_of_deployed_robots(
    name: str, robots: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the byte; of forty robots a decision is longer than a packet."""
    found = metered(name, robots, 20, monkeypatch)
    if robots == 1:  # who is alone tells nobody what the transport counts as told to all
        assert found == Traffic()
        return
    assert found == deployed(name, robots, 20)
    assert found.packets_sent >= 2 * robots * 21
    assert (found.packets_sent > 2 * robots * 21) == (robots == 40)


def test_counts_are_the_same_however_rounds_are_made() -> None:
    """By compiled robots, by machine code, and many at once where nobody acts."""
    pytest.importorskip("llvmlite")
    from tests.sim.test_strides import fleet, run_of

    fitted = fleet(3)
    plain = simulation(fitted, Simulation, keep_going=True, kernels=False)
    plain.begin()
    coded, none = run_of(fitted, strides=False)
    striding, counting = run_of(fitted, strides=True)
    found = []
    for made in (plain, coded, striding):
        meter = TrafficMeter(3)
        for decision in run(made, 10.0):
            meter.note(decision, made.engine.proposals_of(decision))
        found.append(meter.traffic)
    assert counting.made
    assert not none.made
    assert found[0] == found[1] == found[2]
    assert found[0].packets_received == 8 * 100


def test_a_line_of_a_campaign_says_what_was_sent() -> None:
    made = campaign(EXAMPLES / "sum_of_ids.krd", runs=1, robots=3, seed=0, rounds=7)
    (row,) = made.runs
    assert (row.packets_sent, row.packets_received) == (6 * 8, 8 * 8)
    assert row.bytes_received > row.bytes_sent > 100 * row.packets_sent / 2
