"""The model that is proved for every number of robots is what the machine of few robots does.

Each state and each transition that is explored is held against the formulas of the proof. Mistakes
in the machine are no steps of the model.
"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest

from koord.refinement.protocol_proof.abstraction import Abstraction, Life, Said
from koord.refinement.protocol_proof.correspondence import ActionSearch, ModelSearch
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
from koord.runtime.protocol.messages import COMMITTED, Decide, LogEntry, Position, digest
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import Coordinator, State, StepContext, returning
from tests.runtime.walks import Walks
from tests.sampling import first

KEPT, LOST = frozenset({Disk.KEPT}), frozenset({Disk.LOST})


class ModelWalks(ModelSearch, Walks):
    """Random walks that are held against the model."""


class ModelAlone(ModelWalks):
    """What only the model has against a walk."""

    def broken(self, world: ProtocolState, transition: Transition) -> Iterator[BrokenInvariant]:
        return self.model.broken(world, transition.world)


def explorer(bounds: ExplorationBounds) -> Explorer:
    return Explorer(Setup(bounds.robots, Timing.zero()), bounds)


@pytest.mark.parametrize(
    ("bounds", "least"),
    [
        pytest.param(
            ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False), 15, id="one round, whole"
        ),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=1, crashes=0, states=8_000), 100, id="an election"
        ),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=1, crashes=0),
            200,
            id="an election, whole",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=2, crashes=1, restarts=1, states=300_000),
            300,
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
def test_whatever_happens_is_of_the_model(bounds: ExplorationBounds, least: int) -> None:
    """``least`` states of the model, which are many states of the machine each."""
    search = ModelSearch(explorer(bounds))
    explored = search.run()
    assert explored.violation is None
    assert search.model.states >= least


WALKS = {
    "kept disks": ExplorationBounds(rounds=2, epoch=4, crashes=3, restarts=3, disks=KEPT),
    "lost disks": ExplorationBounds(rounds=3, epoch=4, crashes=3, restarts=3, disks=LOST),
    "a twin": ExplorationBounds(rounds=3, epoch=5, crashes=1, restarts=1, twins=1),
    "four robots": ExplorationBounds(
        robots=4, rounds=3, epoch=5, crashes=3, restarts=3, disks=KEPT | LOST
    ),
    "from switching on": ExplorationBounds(
        rounds=1, epoch=3, crashes=1, restarts=1, settled=False, resends=True
    ),
}


def walked(bounds: ExplorationBounds, seed: int, walks: int) -> tuple[Explored, ModelWalks]:
    search = ModelWalks(explorer(bounds))
    return search.walk(Random(seed), walks, 150), search


@pytest.mark.parametrize("name", first(2, WALKS))
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


def test_a_step_has_to_be_an_action() -> None:
    """Robot 1 acknowledges an entry of epoch 0: not after it stood for epoch 1, and never back."""
    search = ModelSearch(explorer(ExplorationBounds(rounds=1, epoch=0, crashes=0)))
    search.run()
    map_ = Abstraction(search.explorer)
    nothing = map_.said(search.explorer.initial())
    decided = next(
        (Life(one.sender, one.incarnation), 0, digest(one.message.entry))
        for one in search.explorer.parcels
        if isinstance(one.message, Decide) and one.message.entry.round == 0
    )
    life = Life(1, 0)
    open_ = nothing._replace(decides=frozenset({decided}))
    stood = open_._replace(stood=frozenset({(life, 1, Position(-1, COMMITTED))}))
    acknowledged = frozenset({(life, 0, decided[2])})

    def actions(before: Said, after: Said) -> list[str] | None:
        start, target = map_.structure(before, after), map_.structure(after, after)
        return ActionSearch(start, target, map_.constants).found()

    assert actions(open_, open_) == []
    assert actions(open_, stood) == ["stand"]
    assert actions(open_, open_._replace(acknowledged=acknowledged)) == ["accept", "choose"]
    assert actions(stood, stood._replace(acknowledged=acknowledged)) is None
    assert actions(stood, open_) is None


def test_what_no_action_explains_is_told() -> None:
    """What was said cannot be taken back."""
    search = ModelSearch(explorer(ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False)))
    before = search.explorer.initial()
    told: set[str] = set()
    for _ in range(12):
        after = next(search.explorer.transitions(before)).world
        assert list(search.model.broken(before, after)) == []
        told |= {one.story for one in search.model.broken(after, before)}
        before = after
    assert told == {"no actions of the model are this step"}


# --- mistakes in the machine ----------------------------------------------------------------------


def _decides_again(turn: StepContext) -> None:
    """Decide when a proposal arrives, although there is an entry already."""
    setup, desk = turn.setup, turn.state.office
    if isinstance(desk, Coordinator) and not turn.state.ended:
        missing = coordinating.missing_in(desk)
        decision = setup.decide(turn.state.round, desk.proposals.all)
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
