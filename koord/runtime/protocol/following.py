"""Followers: accept entries, acknowledge, commit, and catch up."""

from __future__ import annotations

from koord.runtime.proposals import INIT_ROUND, Proposal
from koord.runtime.protocol.committing import commit, end, go_on, outrank, retire
from koord.runtime.protocol.events import Install, Reason, ShowStore, Timer
from koord.runtime.protocol.messages import (
    Acknowledge,
    Ask,
    Committed,
    Decide,
    Held,
    Hello,
    History,
    Open,
    Overruled,
    Propose,
    Snapshot,
    digest,
)
from koord.runtime.protocol.state import Follower, Rejoining, State, StepContext

#: So many entries are sent to one who asks; for more it asks again.
BATCH = 8


def follow(turn: StepContext, sender: int, epoch: int) -> bool:
    """Follow the sender as the coordinator of its epoch, unless a higher one is promised."""
    state, setup = turn.state, turn.setup
    if epoch < state.promised:
        turn.send(sender, Overruled(state.promised))
        return False
    if setup.coordinator(epoch) != sender or sender == state.pid:
        return False
    turn.promise(epoch)
    office = state.office
    if not isinstance(office, Follower) or office.leader != sender:
        turn.take(Follower(sender))
        turn.disarm(Timer.DEADLINE)
    if not state.ended:
        turn.watch_leader()
    return True


def propose(turn: StepContext, proposal: Proposal) -> None:
    """Send the robot's own proposal, which is ready. (R-BEGIN)"""
    state = turn.state
    if state.mine is not None or proposal.round != state.round or state.ended:
        return  # the round was decided meanwhile: the buffer is thrown away
    turn.change(mine=proposal)
    if state.tentative is None and state.leader not in (None, state.pid):
        turn.send(state.leader, Propose(proposal))
        # The answer is the Decide, which may take until the deadline.
        turn.await_answer(turn.setup.timing.patience_s)


def on_decide(turn: StepContext, sender: int, message: Decide) -> None:
    """Handle a Decide. (R-ACCEPT)"""
    if not follow(turn, sender, message.epoch):
        return
    entry = message.entry
    round_ = entry.decision.round
    _commit_if_chained(turn, round_, entry.previous, message.epoch)
    state = turn.state
    if round_ > state.round:
        fall_behind(turn, sender, round_)
        return
    mark = digest(entry)
    if round_ < state.round:
        if state.is_voter and any(held.digest == mark for held in state.log):
            turn.send(sender, Acknowledge(message.epoch, entry.round, mark))
        return
    held = state.tentative
    if entry.previous != state.chain or (
        held is not None and held.epoch == message.epoch and held.digest != mark
    ):
        return  # no coordinator sends this (I-ONE-ENTRY)
    turn.change(tentative=Held(message.epoch, entry, mark))
    if state.is_voter:
        turn.send(sender, Acknowledge(message.epoch, entry.round, mark))
    turn.await_answer()


def on_committed(turn: StepContext, sender: int, message: Committed) -> None:
    """Handle a Committed, true in any epoch; only a current one names the coordinator.
    (R-COMMIT)
    """
    if message.epoch >= turn.state.promised:
        follow(turn, sender, message.epoch)
    state = turn.state
    if message.round < state.round:
        return
    held = state.tentative
    if message.round == state.round and held is not None and held.digest == message.digest:
        commit(turn, Held(max(held.epoch, message.epoch), held.entry, held.digest))
        go_on(turn, message.pause_s)
    else:
        fall_behind(turn, sender, message.round + 1)


def on_open(turn: StepContext, sender: int, message: Open) -> None:
    """Handle an Open: the coordinator lacks this robot's proposal. (R-OWED)"""
    if not follow(turn, sender, message.epoch):
        return
    _commit_if_chained(turn, message.round, message.chain, message.epoch)
    state = turn.state
    if message.round > state.round:
        fall_behind(turn, sender, message.round)
    elif message.round == state.round and state.mine is not None:
        turn.send(sender, Propose(state.mine))


def _commit_if_chained(turn: StepContext, round_: int, previous: bytes, epoch: int) -> None:
    """Commit the tentative entry if the coordinator's history continues it. (R-COMMIT)"""
    held = turn.state.tentative
    if held is not None and held.digest == previous and round_ == held.round + 1:
        commit(turn, Held(max(epoch, held.epoch), held.entry, held.digest))
        go_on(turn, 0.0)


# --- catching up ----------------------------------------------------------------------------------


def fall_behind(turn: StepContext, teacher: int, target: int) -> None:
    """Ask for committed rounds up to ``target`` that this robot does not hold. (R-ASK)"""
    state = turn.state
    if target <= state.target and state.is_behind:
        return  # asked already
    turn.change(target=max(target, state.target))
    turn.send(teacher, Ask(state.round))
    turn.await_answer()


def teach(turn: StepContext, to: int, round_: int) -> None:
    """Send the committed entries from a round on. (R-ASK) (R-TEACH)"""
    state = turn.state
    if round_ >= state.round:
        return
    missing = [held for held in state.log if held.round >= round_]
    if not missing or missing[0].round != round_:
        turn.want(ShowStore(to))
        return
    batch = missing[:BATCH]
    for held in batch:
        turn.send(to, History(held.epoch, held.entry, held is batch[-1]))


def on_history(turn: StepContext, sender: int, message: History) -> None:
    """Handle a History. Raising the promise keeps an old coordinator from continuing it.
    (R-COMMIT)
    """
    state = turn.state
    entry = message.entry
    if entry.round != state.round or entry.previous != state.chain:
        return
    _learn_epoch(turn, message.epoch)
    commit(turn, Held(message.epoch, entry, digest(entry)))
    go_on(turn, 0.0)
    if turn.state.is_behind and message.last:
        turn.send(sender, Ask(turn.state.round))
        turn.await_answer()


def on_snapshot(turn: StepContext, sender: int, message: Snapshot) -> None:
    """Handle a Snapshot. (R-SNAPSHOT)"""
    state = turn.state
    rejoining = isinstance(state.office, Rejoining)
    if message.round <= state.round and not rejoining:
        return
    if message.round == INIT_ROUND:
        turn.hold(Reason.NEVER_BEGAN)
        return  # nothing has been agreed on, and it may have proposed
    _learn_epoch(turn, message.epoch)
    if rejoining:
        turn.take(Follower(sender))
    turn.change(
        round=message.round,
        chain=message.chain,
        tentative=None,
        mine=None,
        log=(),
        roster=message.roster,
        last_ran=message.last_ran,
        target=max(state.target, message.round),
    )
    turn.want(Install(message.round, message.store, message.last_ran[state.pid]))
    if message.roster[state.pid] > state.incarnation:
        if state.is_on_roster:
            retire(turn)
            return
        outrank(turn)
    if message.ended:
        end(turn)
    else:
        turn.watch_leader()
    go_on(turn, 0.0)


def _learn_epoch(turn: StepContext, epoch: int) -> None:
    """Step down from any lower office on learning of a higher epoch's majority."""
    state = turn.state
    if epoch > state.promised:
        turn.promise(epoch)
        if not isinstance(state.office, Rejoining | Follower):
            turn.follow_nobody()


# --- what is sent again ---------------------------------------------------------------------------


def resend(turn: StepContext) -> None:
    """Send a follower's question again. (R-AGAIN)"""
    state = turn.state
    question = _unanswered(state)
    if question is None:
        return
    if state.leader is not None:
        turn.send(state.leader, question)
    turn.await_longer()


def _unanswered(state: State) -> Ask | Acknowledge | Propose | None:
    if state.is_behind:
        return Ask(state.round)
    if state.tentative is not None:
        held = state.tentative
        return Acknowledge(held.epoch, held.round, held.digest, again=True)
    return None if state.mine is None else Propose(state.mine)


def rejoin(turn: StepContext) -> None:
    """Ask for a snapshot, again and again. (R-REJOIN)"""
    if turn.state.holding is not Reason.NEVER_BEGAN:
        turn.hold(Reason.REJOINING)
    turn.tell(Hello(empty=True))
    turn.await_longer()
