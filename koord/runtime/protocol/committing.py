"""Commits of entries, and the step to the next round: the only place where a robot acts."""

from __future__ import annotations

from koord.runtime.proposals import Admitted
from koord.runtime.protocol.events import Begin, Commit, Reason, RunEnded, Timer
from koord.runtime.protocol.messages import Held, Hello, LastRun, LogEntry
from koord.runtime.protocol.state import Coordinator, Retired, StepContext


def commit(turn: StepContext, held: Held) -> None:
    """Commit the entry of the robot's round, which a majority is known to hold. (R-COMMIT)"""
    state = turn.state
    entry = held.entry
    assert (entry.round, entry.previous) == (state.round, state.chain)
    kept = _kept(entry, state.pid)
    log = (*state.log, held)
    turn.change(
        round=state.round + 1,
        chain=held.digest,
        tentative=None,
        mine=None,
        log=log[-turn.setup.kept :],
        roster=_roster(state.roster, entry),
        last_ran=_last_ran(state.last_ran, entry),
        target=max(state.target, state.round + 1),
    )
    turn.want(Commit(entry, kept))
    _end_if_over(turn, entry)


def _kept(entry: LogEntry, pid: int) -> Admitted | None:
    return next((taken for taken in entry.decision.ran if taken.robot == pid), None)


def _roster(roster: tuple[int, ...], entry: LogEntry) -> tuple[int, ...]:
    """The roster after an entry: admitted robots count from here on. (R-ADMIT)"""
    if not entry.admitted:
        return roster
    changed = list(roster)
    for admission in entry.admitted:
        changed[admission.robot] = admission.incarnation
    return tuple(changed)


def _last_ran(before: tuple[LastRun | None, ...], entry: LogEntry) -> tuple[LastRun | None, ...]:
    if not entry.decision.ran:
        return before
    changed = list(before)
    for taken in entry.decision.ran:
        changed[taken.robot] = LastRun(entry.round, taken.event)
    return tuple(changed)


def _end_if_over(turn: StepContext, entry: LogEntry) -> None:
    state = turn.state
    if state.roster[state.pid] > state.incarnation:
        retire(turn)
    elif entry.decision.fault is not None or state.round == turn.setup.rounds:
        end(turn)


def end(turn: StepContext) -> None:
    """End the run for this robot; it still answers robots that are behind."""
    turn.change(ended=True)
    for timer in (Timer.DEADLINE, Timer.HOLD, Timer.SILENCE):
        turn.disarm(timer)
    turn.want(RunEnded())


def retire(turn: StepContext) -> None:
    """Retire: another robot has this one's pid. (R-ADMIT)"""
    turn.take(Retired())
    turn.hold(Reason.TWICE)
    for timer in Timer:
        turn.disarm(timer)
    turn.want(RunEnded())


def go_on(turn: StepContext, pause_s: float) -> None:
    """Begin the open round, unless the robot has yet to catch up. (R-BEGIN)"""
    state = turn.state
    if isinstance(state.office, Retired):
        return
    if isinstance(state.office, Coordinator):
        _clear_desk(turn, state.office, pause_s)
    if state.ended:
        if not isinstance(state.office, Coordinator):
            turn.disarm(Timer.RESEND)
        return
    if state.is_behind:
        return
    turn.resume()
    turn.want(Begin(state.round, pause_s))
    turn.arm(Timer.HOLD, pause_s + turn.setup.timing.hold_s)
    if not state.is_voter and state.leader is not None:
        turn.send(state.leader, Hello(empty=False))
    if not isinstance(state.office, Coordinator):
        # Nothing is waited for until the proposal is made; what was is answered.
        turn.disarm(Timer.RESEND)


def _clear_desk(turn: StepContext, desk: Coordinator, pause_s: float) -> None:
    """Reset the coordinator's state for a new round. (R-OPEN)"""
    setup = turn.setup
    roster = turn.state.roster
    turn.take(
        Coordinator(
            (None,) * setup.robots,
            heard=desk.heard,
            guests=tuple(guest for guest in desk.guests if roster[guest[0]] < guest[1]),
            began=turn.now + pause_s,
        )
    )
    if turn.state.ended:
        turn.disarm(Timer.RESEND)
        return
    turn.arm(Timer.DEADLINE, pause_s + setup.timing.patience_s)
    turn.await_answer(pause_s)
