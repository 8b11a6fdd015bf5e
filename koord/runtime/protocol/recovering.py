"""Recovery of a robot that is back with its journal. (R-RESUME)

What it last wrote is believed in the end: it wrote down whatever it told the others (R-SAVE). But
the disk may be an old one, brought back. If all others answer what they have promised and hold,
that is harmless: nobody can have counted a vote or an acknowledgement that none of them knows of.
"""

from __future__ import annotations

from koord.runtime.proposals import INIT_ROUND
from koord.runtime.protocol.committing import end
from koord.runtime.protocol.events import Begin, Reason, Timer
from koord.runtime.protocol.following import fall_behind
from koord.runtime.protocol.messages import (
    Ask,
    Held,
    Propose,
    Recovery,
    RecoveryAnswer,
    Tentative,
    digest,
)
from koord.runtime.protocol.state import Recovering, StepContext


def recover(turn: StepContext) -> None:
    """Begin to recover: ask all others what this robot may have forgotten. (R-RESUME)"""
    if turn.state.ended:
        turn.change(recovery=None)
        end(turn)
        return
    turn.hold(Reason.RECOVERING)
    turn.arm(Timer.RECOVERY, turn.setup.timing.silence_s)
    ask(turn)
    _end_if_all_answered(turn)


def ask(turn: StepContext) -> None:
    """Ask all others, again and again, and for committed rounds that are missing. (R-ASK)"""
    state = turn.state
    assert state.recovery is not None
    turn.tell(Recovery(state.recovery.start))
    if state.is_behind and state.leader is not None:
        turn.send(state.leader, Ask(state.round))
    turn.await_longer()


def on_recovery(turn: StepContext, sender: int, message: Recovery) -> None:
    """Answer a robot that is back. (R-RESUME)"""
    state = turn.state
    if not state.is_on_roster:
        return  # it may have forgotten more
    held = state.tentative
    tentative = None if held is None else Tentative(held.epoch, held.entry)
    answer = RecoveryAnswer(message.start, state.promised, state.round, tentative)
    turn.send(sender, answer)


def on_answer(turn: StepContext, sender: int, message: RecoveryAnswer) -> None:
    """Learn what another robot has promised and holds. (R-RESUME)"""
    recovery = turn.state.recovery
    if recovery is None or recovery.start != message.start:
        return
    turn.promise(message.promised)
    if message.round > turn.state.round:
        fall_behind(turn, sender, message.round)
        return  # and it will be asked again
    if message.round == turn.state.round and message.tentative is not None:
        _take_over(turn, message.tentative)
    turn.change(recovery=Recovering(recovery.start, recovery.answered | {sender}))
    _end_if_all_answered(turn)


def _take_over(turn: StepContext, tentative: Tentative) -> None:
    """Hold an entry of a higher epoch than one's own. It is not acknowledged thereby."""
    state = turn.state
    mine = state.tentative
    if tentative.entry.previous != state.chain or (mine and mine.epoch >= tentative.epoch):
        return
    entry = tentative.entry
    turn.change(tentative=Held(tentative.epoch, entry, digest(entry)))


def _end_if_all_answered(turn: StepContext) -> None:
    state = turn.state
    assert state.recovery is not None
    others = turn.setup.everyone - {state.pid}
    if state.recovery.answered >= others and not state.is_behind:
        _end(turn)


def believe(turn: StepContext) -> None:
    """End the recovery although not all have answered: the journal is believed. (R-RESUME)"""
    if turn.state.recovery is not None:
        _end(turn)


def _end(turn: StepContext) -> None:
    turn.disarm(Timer.RECOVERY)
    turn.disarm(Timer.RESEND)
    turn.change(recovery=None)
    if turn.state.leader is None:
        turn.follow_nobody()
    turn.arm(Timer.HOLD, turn.setup.timing.hold_s)
    state = turn.state
    if state.ended:
        return
    if state.is_behind:
        turn.await_answer()  # what it asked for may be lost
        return
    turn.resume()
    if state.mine is not None:
        if state.tentative is None and state.leader is not None:
            turn.send(state.leader, Propose(state.mine))
            turn.await_answer()
    elif state.round == INIT_ROUND or state.pid in turn.setup.owing:
        turn.want(Begin(state.round, 0.0))
