"""Two processes of one pid, at once: the run by which they could both have led an epoch."""

from __future__ import annotations

from koord.refinement.protocol_proof.correspondence import ModelSearch
from koord.runtime.exploration.world import Act, Cause, ExplorationBounds, Explorer, Transition
from koord.runtime.protocol.events import Timer
from koord.runtime.protocol.messages import (
    Acknowledge,
    Candidacy,
    Canvass,
    Committed,
    Decide,
    Hello,
    Message,
    Snapshot,
    Support,
    Vote,
)
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import Candidate, Coordinator, State

#: The place of the second process of robot 0 among the robots of the explorer.
TWIN = 3


class Directed:
    """A run of three robots and a twin in which each step is asked for, and is of the model."""

    def __init__(self) -> None:
        bounds = ExplorationBounds(rounds=1, epoch=3, crashes=0, twins=1)
        self.explorer = Explorer(Setup(bounds.robots, Timing.zero()), bounds)
        self.search = ModelSearch(self.explorer)
        self.world = self.explorer.initial()

    def state(self, robot: int) -> State:
        state = self.explorer.locals[self.world.locals[robot]].state
        assert state is not None
        return state

    def take(self, robot: int, wanted: Cause | type[Message], newest: bool = False) -> None:
        """Take a transition: what a robot does, or gets. The invariants hold after it."""
        found = [one for one in self.explorer.transitions(self.world) if one.robot == robot]
        fitting = [one for one in found if self._is(one, wanted)]
        taken = fitting[-1 if newest else 0]
        assert list(self.search.broken(self.world, taken)) == []
        self.world = taken.world

    def can(self, robot: int, wanted: Cause | type[Message]) -> bool:
        """Return whether there is a transition that changes anything."""
        found = self.explorer.transitions(self.world)
        return any(one.robot == robot and self._is(one, wanted) for one in found)

    def _is(self, transition: Transition, wanted: Cause | type[Message]) -> bool:
        cause = transition.cause
        if isinstance(cause, int) and isinstance(wanted, type):
            return isinstance(self.explorer.parcels[cause].message, wanted)
        return cause is wanted


def test_a_candidate_does_not_count_the_votes_for_its_successor() -> None:
    """Robot 0 stands for epoch 3, is not heard, and is replaced; its successor stands for 3, too.

    In epoch 1 an entry is committed that admits the successor. Whoever votes for the successor has
    seen that it holds this entry. Robot 0 does not, and must not lead with these votes. (R-VOTE)
    (R-OFFICE)
    """
    run = Directed()
    run.take(TWIN, Act.TWIN)
    for robot in (0, 0, 1, 2):
        run.take(robot, Timer.SILENCE)
    run.take(2, Canvass)
    run.take(0, Support)
    assert isinstance(run.state(0).office, Candidate)
    # Epoch 1.
    run.take(1, Timer.SILENCE)
    run.take(2, Canvass, newest=True)
    run.take(1, Support)
    run.take(2, Candidacy, newest=True)
    run.take(1, Vote)
    run.take(1, Hello)
    run.take(1, Timer.DEADLINE)
    run.take(TWIN, Snapshot)
    run.take(TWIN, Decide)
    run.take(2, Decide)
    run.take(1, Acknowledge)
    run.take(TWIN, Committed)
    assert (run.state(1).round, run.state(TWIN).round) == (1, 1)
    assert run.state(TWIN).is_voter
    # Epoch 3: the successor.
    for robot in (TWIN, TWIN, 2):
        run.take(robot, Timer.SILENCE)
    run.take(TWIN, Support)
    run.take(2, Candidacy, newest=True)
    assert (run.state(0).promised, run.state(TWIN).promised) == (3, 3)
    assert not run.can(0, Vote)
    run.take(TWIN, Vote)
    assert isinstance(run.state(TWIN).office, Coordinator)
    assert isinstance(run.state(0).office, Candidate)
