"""The protocol machine: ``step``, one robot's reaction to one event."""

from __future__ import annotations

from typing import assert_never

from koord.runtime.proposals import INIT_ROUND
from koord.runtime.protocol import coordinating, electing, following, recovering
from koord.runtime.protocol.events import (
    Begin,
    Effect,
    Event,
    Expired,
    Proposed,
    Reason,
    Received,
    Save,
    Send,
    Started,
    StoreShown,
    Tell,
    Timer,
)
from koord.runtime.protocol.messages import (
    Acknowledge,
    Ask,
    Candidacy,
    Canvass,
    Committed,
    Decide,
    Hello,
    History,
    Message,
    Open,
    Overruled,
    Propose,
    Recovery,
    RecoveryAnswer,
    Snapshot,
    Support,
    Vote,
)
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import (
    Candidate,
    Canvassing,
    Coordinator,
    Follower,
    Rejoining,
    Retired,
    State,
    StepContext,
    must_save,
)


def step(setup: Setup, state: State, event: Event) -> tuple[State, tuple[Effect, ...]]:
    """Return the state after an event, and the effects in order. Pure."""
    if type(state.office) is Retired:
        return state, ()
    turn = StepContext(setup, state, event.now)
    if isinstance(event, Received):  # most are
        sender = event.sender
        if 0 <= sender < setup.robots and sender != state.pid:
            _receive(turn, sender, event.incarnation, event.message)
        return turn.state, _with_save(state, turn)
    match event:
        case Expired(timer=timer):
            _expire(turn, timer)
        case Proposed():
            _propose(turn, event)
        case Started():
            _start(turn)
        case StoreShown():
            _show(turn, event)
        case _:
            assert_never(event)
    return turn.state, _with_save(state, turn)


def _with_save(before: State, turn: StepContext) -> tuple[Effect, ...]:
    """The effects of a step; what has to be on the disk is, before a message leaves. (R-SAVE)"""
    effects, after = turn.effects, turn.state
    if after is not before and must_save(before, after):
        at = len(effects)
        for i, one in enumerate(effects):
            if type(one) is Send or type(one) is Tell:
                at = i
                break
        effects.insert(at, Save())
    return tuple(effects)


def _start(turn: StepContext) -> None:
    timing = turn.setup.timing
    if turn.state.recovery is not None:
        recovering.recover(turn)
        return
    match turn.state.office:
        case Rejoining():
            following.rejoin(turn)
            return
        case Coordinator():
            turn.arm(Timer.DEADLINE, timing.patience_s)
            turn.await_answer()
        case _:
            pass
    turn.want(Begin(INIT_ROUND, 0.0))
    turn.arm(Timer.HOLD, timing.hold_s)
    turn.watch_leader()


def _propose(turn: StepContext, event: Proposed) -> None:
    following.propose(turn, event.proposal)
    if isinstance(turn.state.office, Coordinator) and turn.state.mine is event.proposal:
        coordinating.gather(turn, event.proposal)


def _show(turn: StepContext, event: StoreShown) -> None:
    """Send the store that was shown as a snapshot, if it is still current. (R-SNAPSHOT)"""
    state = turn.state
    if event.round == state.round:
        snapshot = Snapshot(
            state.promised,
            state.round,
            state.chain,
            state.roster,
            state.last_ran,
            event.store,
            state.ended,
        )
        turn.send(event.to, snapshot)


# --- messages -------------------------------------------------------------------------------------


def _receive(turn: StepContext, sender: int, incarnation: int, message: Message) -> None:
    office = turn.state.office
    if isinstance(office, Coordinator):
        coordinating.note(turn, office, sender)
    elif isinstance(office, Rejoining):
        if isinstance(message, Snapshot):
            following.on_snapshot(turn, sender, message)
        return
    match message:
        case Propose():
            coordinating.on_propose(turn, sender, message)
        case Decide():
            following.on_decide(turn, sender, message)
        case Acknowledge():
            coordinating.on_acknowledge(turn, sender, incarnation, message)
        case Committed():
            following.on_committed(turn, sender, message)
        case Open():
            following.on_open(turn, sender, message)
        case Ask(round=round_):
            following.teach(turn, sender, round_)
        case History():
            following.on_history(turn, sender, message)
        case Snapshot():
            following.on_snapshot(turn, sender, message)
        case Hello():
            coordinating.on_hello(turn, sender, incarnation, message)
        case Canvass():
            electing.on_canvass(turn, sender, message)
        case Support():
            electing.on_support(turn, sender, incarnation, message)
        case Candidacy():
            electing.on_candidacy(turn, sender, incarnation, message)
        case Vote():
            electing.on_vote(turn, sender, incarnation, message)
        case Overruled():
            electing.on_overruled(turn, message)
        case Recovery():
            recovering.on_recovery(turn, sender, message)
        case RecoveryAnswer():
            recovering.on_answer(turn, sender, message)
        case _:
            assert_never(message)


# --- timers ---------------------------------------------------------------------------------------


def _expire(turn: StepContext, timer: Timer) -> None:
    match timer:
        case Timer.DEADLINE:
            coordinating.overdue(turn)
        case Timer.RESEND:
            _resend(turn)
        case Timer.SILENCE:
            electing.silence(turn)
        case Timer.HOLD:
            turn.hold(_why(turn.state))
        case Timer.RECOVERY:
            recovering.believe(turn)
        case _:
            assert_never(timer)


def _resend(turn: StepContext) -> None:
    if turn.state.recovery is not None:
        recovering.ask(turn)
        return
    match turn.state.office:
        case Follower():
            following.resend(turn)
        case Canvassing() | Candidate():
            electing.resend(turn)
        case Coordinator():
            coordinating.resend(turn)
        case Rejoining():
            following.rejoin(turn)
        case Retired():
            pass
        case office:
            assert_never(office)


def _why(state: State) -> Reason:
    """The reason why a commit is overdue, as far as this robot can know."""
    if state.recovery is not None:
        return Reason.RECOVERING
    match state.office:
        case Rejoining():
            return Reason.REJOINING
        case Retired():
            return Reason.TWICE
        case Canvassing() | Candidate():
            return Reason.NO_COORDINATOR
        case Follower(leader=None):
            return Reason.NO_COORDINATOR
        case Coordinator():
            return Reason.ROUND_OPEN if state.tentative is None else Reason.NO_MAJORITY
        case Follower():
            return Reason.BEHIND if state.is_behind else Reason.UNDECIDED
        case office:
            assert_never(office)
