"""Commits of entries, and the step to the next round: the only place where a robot acts."""

from __future__ import annotations

from koord.runtime.alike import keeps_last
from koord.runtime.proposals import Admitted
from koord.runtime.protocol.events import Begin, Commit, Reason, RunEnded, Timer
from koord.runtime.protocol.messages import (
    Held,
    Hello,
    LastRun,
    LogEntry,
    incarnation_above,
)
from koord.runtime.protocol.state import Coordinator, Gathered, Retired, StepContext


def commit(turn: StepContext, held: Held) -> None:
    """Commit the entry of the robot's round, which a majority is known to hold. (R-COMMIT)"""
    state = turn.state
    was_on_roster = state.is_on_roster
    entry = held.entry
    assert (entry.decision.round, entry.previous) == (state.round, state.chain)
    kept = admitted_of(entry, state.pid)
    roster, last_ran = after_entry(state.roster, state.last_ran, entry)
    log = (*state.log, held)
    turn.change(
        round=state.round + 1,
        chain=held.digest,
        tentative=None,
        mine=None,
        log=log[-turn.setup.kept :],
        roster=roster,
        last_ran=last_ran,
        target=max(state.target, state.round + 1),
    )
    turn.want(Commit(entry, kept))
    if turn.state.roster[state.pid] > state.incarnation:
        if was_on_roster:
            retire(turn)
            return
        outrank(turn)
    if entry.decision.fault is not None or turn.state.round == turn.setup.rounds:
        end(turn)


def outrank(turn: StepContext) -> None:
    """Take an incarnation above one that was admitted in an earlier life. (R-ADMIT)"""
    state = turn.state
    turn.change(incarnation=incarnation_above(state.roster[state.pid], state.incarnation))


def admitted_of(entry: LogEntry, pid: int) -> Admitted | None:
    """A robot's turn in an entry; None if it was not let through."""
    if not entry.decision.ran:
        return None
    return _by_robot(entry.decision.ran).get(pid)


@keeps_last
def _by_robot(ran: tuple[Admitted, ...]) -> dict[int, Admitted]:
    return {taken.robot: taken for taken in ran}


def after_entry(
    roster: tuple[int, ...], last_ran: tuple[LastRun | None, ...], entry: LogEntry
) -> tuple[tuple[int, ...], tuple[LastRun | None, ...]]:
    """The roster, and what robots last ran, after an entry is committed."""
    if entry.decision.ran:
        last_ran = _last_ran(last_ran, entry)
    return _roster(roster, entry), last_ran


def _roster(roster: tuple[int, ...], entry: LogEntry) -> tuple[int, ...]:
    """The roster after an entry: admitted robots count from here on. (R-ADMIT)"""
    if not entry.admitted:
        return roster
    changed = list(roster)
    for admission in entry.admitted:
        changed[admission.robot] = admission.incarnation
    return tuple(changed)


@keeps_last
def _last_ran(before: tuple[LastRun | None, ...], entry: LogEntry) -> tuple[LastRun | None, ...]:
    changed, round_ = list(before), entry.round
    for taken in entry.decision.ran:
        changed[taken.robot] = LastRun(round_, taken.event)
    return tuple(changed)


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
    if state.is_behind or state.recovery is not None:
        return
    turn.resume()
    turn.want(Begin(state.round, pause_s))
    turn.arm(Timer.HOLD, pause_s + turn.setup.timing.hold_s)
    if not state.is_on_roster and state.leader is not None:
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
            Gathered.nothing(setup.robots),
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
