"""The model that is proved for every number of robots is what the machine of few robots does.

Each state and each transition that is explored is held against the formulas of the proof. Mistakes
in the machine are no steps of the model.
"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest

from koord.refinement.protocol_proof.correspondence import ModelSearch
from koord.refinement.protocol_proof.model import ACTIONS
from koord.runtime.exploration import world
from koord.runtime.exploration.claims import BrokenInvariant
from koord.runtime.exploration.exploring import Explored
from koord.runtime.exploration.world import (
    Disk,
    ExplorationBounds,
    Explorer,
    ProtocolState,
    Transition,
)
from koord.runtime.protocol import coordinating, machine
from koord.runtime.protocol.messages import LogEntry, Position
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import Coordinator, State, StepContext, returning
from tests.runtime.walks import Walks

KEPT, LOST, OLD = (frozenset({disk}) for disk in (Disk.KEPT, Disk.LOST, Disk.OLD))
ANY = frozenset(Disk)


class ModelWalks(ModelSearch, Walks):
    """Random walks that are held against the model."""


class ModelAlone(ModelWalks):
    """What only the model has against a walk."""

    def broken(self, world: ProtocolState, transition: Transition) -> Iterator[BrokenInvariant]:
        return self.model.broken(world, transition.world)


def explorer(bounds: ExplorationBounds) -> Explorer:
    return Explorer(Setup(bounds.robots, Timing.zero()), bounds)


@pytest.mark.parametrize(
    ("bounds", "states"),
    [
        pytest.param(
            ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False), 15, id="one round, whole"
        ),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=1, crashes=0, states=8_000), 100, id="an election"
        ),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=1, crashes=0),
            10_000,
            id="an election, whole",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=2, crashes=1, restarts=1, states=300_000),
            1_000,
            id="a crash and a return",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ExplorationBounds(robots=4, rounds=1, epoch=1, crashes=0, states=300_000),
            300,
            id="four robots",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_whatever_happens_is_of_the_model(bounds: ExplorationBounds, states: int) -> None:
    search = ModelSearch(explorer(bounds))
    explored = search.run()
    assert explored.violation is None
    assert search.model.states >= states


WALKS = {
    "kept disks": ExplorationBounds(rounds=2, epoch=4, crashes=3, restarts=3, disks=KEPT),
    "lost disks": ExplorationBounds(rounds=3, epoch=4, crashes=3, restarts=3, disks=LOST),
    "an old disk": ExplorationBounds(rounds=2, epoch=4, crashes=2, restarts=2, disks=OLD),
    "a twin": ExplorationBounds(rounds=3, epoch=5, crashes=1, restarts=1, twins=1),
    "four robots": ExplorationBounds(robots=4, rounds=3, epoch=5, crashes=3, restarts=3, disks=ANY),
    "from switching on": ExplorationBounds(
        rounds=1, epoch=3, crashes=1, restarts=1, settled=False, resends=True
    ),
}


def walked(bounds: ExplorationBounds, seed: int, walks: int) -> tuple[Explored, ModelWalks]:
    search = ModelWalks(explorer(bounds))
    return search.walk(Random(seed), walks, 150), search


@pytest.mark.parametrize("name", WALKS)
def test_walks_are_of_the_model(name: str) -> None:
    explored, _ = walked(WALKS[name], 1, 8)
    assert explored.violation is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2, 6))
@pytest.mark.parametrize("name", WALKS)
def test_many_walks_are_of_the_model(name: str, seed: int) -> None:
    explored, search = walked(WALKS[name], seed, 200)
    assert explored.violation is None
    # Every action is something that the machine does.
    assert {*search.model.actions} == {one.name for one in ACTIONS}


# --- mistakes in the machine ----------------------------------------------------------------------


def _decides_again(turn: StepContext) -> None:
    """Decide when a proposal arrives, although there is an entry already."""
    setup, desk = turn.setup, turn.state.office
    if isinstance(desk, Coordinator) and not turn.state.ended:
        missing = coordinating.missing_in(desk)
        decision = setup.decide(turn.state.round, desk.proposals)
        entry = LogEntry(decision, turn.state.chain, (), missing)
        coordinating._put_forward(turn, entry)


def _keeps_no_promise(turn: StepContext, epoch: int) -> None:
    turn.hear(epoch)


def _forgets(setup: Setup, pid: int, incarnation: int) -> State:
    return returning(setup, pid, 0)


MISTAKES: dict[str, tuple[str, object, str, object]] = {
    "a coordinator decides twice": ("kept disks", coordinating, "decide_if_ready", _decides_again),
    "promises are not kept": ("kept disks", StepContext, "promise", _keeps_no_promise),
    "nothing is saved": ("kept disks", machine, "must_save", lambda before, after: False),
    "votes look at no position": (
        "kept disks",
        State,
        "position",
        property(lambda state: Position(9, 0)),
    ),
    "who lost its disk counts as before": ("lost disks", world, "returning", _forgets),
    "any incarnation counts": ("a twin", State, "counts", lambda state, robot, one: True),
    "one robot is a majority": ("kept disks", Setup, "majority", property(lambda setup: 1)),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_the_machine_is_not_of_the_model(
    mistake: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, owner, attribute, wrong = MISTAKES[mistake]
    monkeypatch.setattr(owner, attribute, wrong)
    search = ModelAlone(explorer(WALKS[name]))
    found = search.walk(Random(1), 60, 120)
    assert found.violation is not None
    assert found.violation.broken.claim == "model"
