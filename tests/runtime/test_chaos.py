"""The protocol on simulated networks, by seeds: every invariant in all runs, and then progress."""

from __future__ import annotations

from random import Random

import pytest
from msgspec.structs import replace

from koord.runtime.chaos.network import CALM, CHAOS, LOSS, Faults, Network
from koord.runtime.chaos.storm import Ledgers, StormPlan, Weathered, weather
from koord.runtime.protocol.messages import Acknowledge
from koord.runtime.protocol.setup import Setup, Timing
from tests.sampling import first

KILLING = Faults(
    most_delay_s=0.005, coordinator_dies_every_s=1.0, least_outage_s=0.3, most_outage_s=0.6
)


def storm(
    robots: int, faults: Faults, seed: int, *, owing: int = 0, course: StormPlan | None = None
) -> Weathered:
    setup = Setup(robots, Timing.of(0.1, robots), owing=frozenset(range(owing)))
    return weather(setup, faults, seed, course if course is not None else StormPlan(storm_s=3.0))


@pytest.mark.parametrize("robots", [1, 2, 3, 8])
def test_on_a_calm_network_nobody_is_late(robots: int) -> None:
    weathered = storm(robots, CALM, seed=1)
    assert weathered.broken is None
    assert weathered.skips_late == 0
    assert weathered.epochs == 1
    assert weathered.rounds_in_storm >= 27
    if robots > 1:
        assert weathered.datagrams <= (2 * robots + 2) * (weathered.rounds + 2)


class Waiting:
    """Stands for a robot that has something to do at a time."""

    def __init__(self, due: float) -> None:
        self.due: float | None = due
        self.woken_s: list[float] = []

    def receive(self, *_message: object) -> None:
        """It waits on."""

    def wake(self, now: float) -> None:
        self.woken_s.append(now)
        self.due = None


def test_who_waits_is_woken_when_it_is_time_and_not_a_rounding_before_it() -> None:
    random = Random(1)
    now, due = next(
        (a, b)
        for a, b in ((random.uniform(0, 0.05), random.uniform(0.05, 0.09)) for _ in range(10_000))
        if a + (b - a) < b
    )
    setup = Setup(2, Timing.of(0.1, 2))
    network = Network(
        setup, replace(CALM, least_delay_s=0, most_delay_s=0), 1, Ledgers(setup).switch_on
    )
    waiting = Waiting(due)
    network.nodes[1] = waiting  # type: ignore[call-overload]
    network.now = now
    vars(network)["_due"].clear()  # nothing else happens
    network.post(0, 1, Acknowledge(0, 0, b""))
    while not waiting.woken_s and network.now < 0.09:
        network.step()
    assert waiting.woken_s == [due]


@pytest.mark.parametrize("seed", first(12, range(40)))
def test_in_chaos_every_invariant_holds_and_it_goes_on_afterwards(seed: int) -> None:
    """(I-AGREE) (I-VALID) (I-ONE-WINNER) (I-ACT) (I-LASTING) (I-ONE-ENTRY)"""
    assert storm(3 + seed % 3, CHAOS, seed).broken is None


@pytest.mark.parametrize("seed", first(4, range(8)))
def test_with_urgent_events_nobody_is_ever_late(seed: int) -> None:
    """(R-OWED)"""
    weathered = storm(4, CHAOS, 1_000 + seed, owing=4)
    assert weathered.broken is None
    assert weathered.skips_late == 0


@pytest.mark.parametrize("seed", first(2, range(4)))
def test_with_a_third_lost_most_rounds_still_happen(seed: int) -> None:
    weathered = storm(8, LOSS, seed)
    assert weathered.broken is None
    assert weathered.rounds_in_storm >= 15
    assert weathered.skips_late < weathered.rounds * 8 / 2


@pytest.mark.parametrize("seed", first(2, range(4)))
def test_killed_coordinators_are_succeeded(seed: int) -> None:
    weathered = storm(5, KILLING, seed, course=StormPlan(storm_s=5.0))
    assert weathered.broken is None
    assert weathered.epochs >= 3
    assert weathered.rounds_in_storm >= 25


def test_a_run_is_a_function_of_its_seed() -> None:
    assert storm(4, CHAOS, 7) == storm(4, CHAOS, 7)
    assert storm(4, CHAOS, 7) != storm(4, CHAOS, 8)


def test_without_a_majority_nothing_is_committed() -> None:
    dead = replace(CALM, loss=1.0)
    setup = Setup(3, Timing.of(0.1, 3))
    weathered = weather(setup, dead, 1, StormPlan(storm_s=2.0, calm_s=20.0))
    assert weathered.rounds_in_storm == -1
    assert weathered.broken is None


@pytest.mark.slow
@pytest.mark.parametrize("robots", [2, 3, 4, 5, 7])
@pytest.mark.parametrize("part", range(8))
def test_chaos_at_length(robots: int, part: int) -> None:
    for seed in range(part * 100, part * 100 + 100):
        owing = robots if seed % 4 == 0 else 0
        weathered = storm(robots, CHAOS, seed, owing=owing, course=StormPlan(storm_s=5.0))
        assert weathered.broken is None, weathered


def test_a_large_fleet_comes_through_a_storm() -> None:
    """Robots that need their time for each message, and forget what they cannot keep."""
    setup = Setup(200, Timing.of(0.1, 200))
    faults = replace(LOSS, reading_s=40e-6, inbox=400)
    weathered = weather(setup, faults, 1, StormPlan(storm_s=2.0))
    assert weathered.broken is None
    assert weathered.rounds_in_storm >= 8


def test_messages_wait_for_a_robot_that_is_busy() -> None:
    """A round takes at least as long as its coordinator needs for what it is sent."""
    setup = Setup(20, Timing.of(0.0, 20))
    quick, slow = (
        weather(setup, replace(CALM, reading_s=reading_s), 1, StormPlan(storm_s=1.0))
        for reading_s in (0.0, 0.0006)
    )
    assert slow.broken is None
    # At least half of the proposals and acknowledgements are read in each round.
    assert 0 < slow.rounds_in_storm <= 1.0 / (20 * 0.0006) < quick.rounds_in_storm


def test_messages_for_which_there_is_no_room_are_lost() -> None:
    setup = Setup(20, Timing.of(0.1, 20))
    network = Network(setup, replace(CALM, reading_s=0.001, inbox=4), 1, Ledgers(setup).switch_on)
    while network.now < 1.0:
        network.step()
    assert network.crowded > 0
