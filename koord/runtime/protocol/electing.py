"""Elections of a coordinator by a majority. (R-SILENCE) … (R-OVERRULED)"""

from __future__ import annotations

from msgspec.structs import replace

from koord.runtime.protocol.coordinating import check_majority, take_office
from koord.runtime.protocol.events import Timer
from koord.runtime.protocol.following import teach
from koord.runtime.protocol.messages import (
    Candidacy,
    Canvass,
    Hello,
    Overruled,
    Support,
    Vote,
)
from koord.runtime.protocol.state import (
    Candidate,
    Canvassing,
    Coordinator,
    Follower,
    Rejoining,
    StepContext,
)


def silence(turn: StepContext) -> None:
    """Handle silence: no coordinator was heard in time. (R-SILENCE)"""
    state = turn.state
    match state.office:
        case Follower(leader=None) | Canvassing() | Candidate():
            if state.is_voter:
                canvass(turn)
            else:
                turn.tell(Hello(empty=False))
                turn.arm(Timer.SILENCE, turn.setup.timing.silence_s)
        case Follower():
            turn.follow_nobody()
        case Coordinator():
            if not check_majority(turn):
                turn.follow_nobody()
        case _:
            pass


def canvass(turn: StepContext) -> None:
    """Canvass: ask who would support this robot as coordinator. (R-CANVASS)"""
    state, setup = turn.state, turn.setup
    standing = isinstance(state.office, Canvassing)
    epoch = setup.epoch_above(state.seen, state.pid)
    turn.take(Canvassing(epoch, frozenset({state.pid})))
    turn.tell(Canvass(epoch, state.position))
    if not standing:
        turn.await_answer()
    turn.arm(Timer.SILENCE, _budget(turn, epoch))
    _stand_if_supported(turn)


def _budget(turn: StepContext, epoch: int) -> float:
    """The waiting time, different for each robot, so that rivals do not collide repeatedly."""
    timing, setup = turn.setup.timing, turn.setup
    return timing.silence_s / 2 + timing.slot_s * ((turn.state.pid + epoch) % setup.robots)


def on_canvass(turn: StepContext, sender: int, message: Canvass) -> None:
    """Handle a Canvass. (R-CANVASS)"""
    state = turn.state
    if message.epoch <= state.promised:
        turn.send(sender, Overruled(state.promised))
        return
    if message.position < state.position:
        teach(turn, sender, message.position.open)
        return
    match state.office:
        case Follower(leader=leader) if leader is None or leader == sender:
            turn.take(Follower(None))
        case Canvassing(epoch=own):
            if message.position == state.position and own < message.epoch:
                return  # it will support this robot instead
            turn.take(Follower(None))
        case _:
            return
    if state.is_voter:
        turn.send(sender, Support(message.epoch))
        turn.watch_leader()


def on_support(turn: StepContext, sender: int, incarnation: int, message: Support) -> None:
    """Handle a Support. (R-STAND)"""
    state = turn.state
    office = state.office
    if not isinstance(office, Canvassing) or office.epoch != message.epoch:
        return
    if state.counts(sender, incarnation):
        turn.take(replace(office, supporters=office.supporters | {sender}))
        _stand_if_supported(turn)


def _stand_if_supported(turn: StepContext) -> None:
    state = turn.state
    office = state.office
    assert isinstance(office, Canvassing)
    if len(office.supporters) < turn.setup.majority:
        return
    turn.promise(office.epoch)
    turn.take(Candidate(frozenset()))
    turn.tell(Candidacy(office.epoch, state.position))
    turn.await_answer()
    turn.arm(Timer.SILENCE, _budget(turn, office.epoch))
    _count(turn, state.pid, state.incarnation)


def on_candidacy(turn: StepContext, sender: int, incarnation: int, message: Candidacy) -> None:
    """Handle a Candidacy. (R-VOTE)"""
    state, setup = turn.state, turn.setup
    epoch = message.epoch
    if setup.coordinator(epoch) != sender or epoch < state.promised:
        turn.send(sender, Overruled(state.promised))
        return
    turn.hear(epoch)
    if message.position < state.position:
        teach(turn, sender, message.position.open)
        return
    if not state.is_voter or isinstance(state.office, Rejoining):
        return
    if epoch > state.promised:
        turn.promise(epoch)
        turn.follow_nobody()
        turn.watch_leader()
    turn.send(sender, Vote(epoch, incarnation))


def on_vote(turn: StepContext, sender: int, incarnation: int, message: Vote) -> None:
    """Handle a Vote. (R-OFFICE)"""
    state = turn.state
    if not isinstance(state.office, Candidate) or message.epoch != state.promised:
        return
    if message.candidate == state.incarnation:
        _count(turn, sender, incarnation)


def _count(turn: StepContext, robot: int, incarnation: int) -> None:
    state = turn.state
    office = state.office
    assert isinstance(office, Candidate)
    if not state.counts(robot, incarnation):
        return
    voters = office.voters | {robot}
    turn.take(Candidate(voters))
    if len(voters) >= turn.setup.majority:
        take_office(turn)


def on_overruled(turn: StepContext, message: Overruled) -> None:
    """Handle an Overruled. (R-OVERRULED)"""
    state = turn.state
    turn.hear(message.epoch)
    if message.epoch > state.promised and isinstance(state.office, Coordinator | Candidate):
        turn.follow_nobody()
    elif isinstance(state.office, Canvassing) and message.epoch >= state.office.epoch:
        canvass(turn)


def resend(turn: StepContext) -> None:
    """Send again to robots that have not answered. (R-AGAIN)"""
    state = turn.state
    match state.office:
        case Canvassing(epoch=epoch):
            turn.tell(Canvass(epoch, state.position))
        case Candidate():
            turn.tell(Candidacy(state.promised, state.position))
        case _:
            return
    turn.await_longer()
