"""The coordinator: gathers proposals, decides, and counts acknowledgements."""

from __future__ import annotations

from msgspec.structs import replace

from koord.runtime.proposals import INIT_ROUND, Proposal
from koord.runtime.protocol.committing import commit, go_on
from koord.runtime.protocol.events import ShowStore, Timer
from koord.runtime.protocol.following import teach
from koord.runtime.protocol.messages import (
    Acknowledge,
    Admission,
    Committed,
    Decide,
    Held,
    Hello,
    LogEntry,
    Open,
    Propose,
    digest,
)
from koord.runtime.protocol.state import Coordinator, Gathered, State, StepContext


def take_office(turn: StepContext) -> None:
    """Take office after an election: resend the tentative entry, or open the round. (R-OFFICE)"""
    setup = turn.setup
    desk = Coordinator(Gathered.nothing(setup.robots), began=turn.now)
    turn.take(desk)
    turn.arm(Timer.DEADLINE, setup.timing.patience_s)
    turn.arm(Timer.SILENCE, setup.timing.silence_s)
    state = turn.state
    if state.tentative is not None:
        _put_forward(turn, state.tentative.entry)
        return
    turn.tell(Open(state.promised, state.round, state.chain))
    turn.await_answer()
    if state.mine is not None:
        gather(turn, state.mine)


def gather(turn: StepContext, proposal: Proposal) -> None:
    """Gather a proposal for the open round; the first of a robot counts. (R-OPEN)"""
    desk = turn.state.office
    assert isinstance(desk, Coordinator)
    if desk.proposals.of(proposal.robot) is None:
        proposals = desk.proposals.having(proposal)
        turn.take(replace(desk, proposals=proposals, gathered=desk.gathered + 1))
    decide_if_ready(turn)


def on_propose(turn: StepContext, sender: int, message: Propose) -> None:
    state = turn.state
    proposal = message.proposal
    if proposal.robot != sender:
        return
    if proposal.round < state.round:
        teach(turn, sender, proposal.round)
    elif isinstance(state.office, Coordinator) and proposal.round == state.round:
        if state.tentative is None:
            gather(turn, proposal)
        else:
            # Late: it missed the Decide, or will get it.
            turn.send(sender, Decide(state.promised, state.tentative.entry))


def decide_if_ready(turn: StepContext) -> None:
    """Decide the round if all needed proposals are there. (R-DECIDE)"""
    state, setup = turn.state, turn.setup
    desk = state.office
    if not isinstance(desk, Coordinator) or state.tentative is not None or state.ended:
        return
    if not desk.overdue and desk.gathered < setup.robots:
        return
    missing = missing_in(desk)
    if owed(turn) & frozenset(missing):
        return
    decision = setup.decide(state.round, desk.proposals.all)
    entry = LogEntry(decision, state.chain, _admissions(turn, desk), missing)
    _put_forward(turn, entry)


def overdue(turn: StepContext) -> None:
    """Decide after the deadline for proposals. (R-DECIDE)"""
    desk = turn.state.office
    if isinstance(desk, Coordinator):
        turn.take(replace(desk, overdue=True))
        decide_if_ready(turn)


def missing_in(desk: Coordinator) -> tuple[int, ...]:
    return tuple(i for i, proposal in enumerate(desk.proposals.all) if proposal is None)


def owed(turn: StepContext) -> frozenset[int]:
    """The robots without whose proposals the round is not decided. (R-OWED) [INIT] [SKIP]"""
    setup = turn.setup
    return setup.everyone if turn.state.round == INIT_ROUND else setup.owing


def _admissions(turn: StepContext, desk: Coordinator) -> tuple[Admission, ...]:
    """The robots to admit again; a majority of others has to remain. (R-ADMIT)"""
    most = turn.setup.robots - turn.setup.majority
    return tuple(Admission(robot, incarnation) for robot, incarnation in desk.guests[:most])


def _put_forward(turn: StepContext, entry: LogEntry) -> None:
    """Accept an entry in the own epoch, and send it to all others. (R-DECIDE) (R-OFFICE)"""
    state = turn.state
    turn.change(tentative=Held(state.promised, entry, digest(entry)))
    turn.disarm(Timer.DEADLINE)
    turn.tell(Decide(state.promised, entry))
    turn.await_answer()
    _count(turn, state.pid, state.incarnation)


def on_acknowledge(turn: StepContext, sender: int, incarnation: int, message: Acknowledge) -> None:
    """Handle an Acknowledge. (R-MAJORITY)"""
    state = turn.state
    if message.round < state.round:
        if message.again:
            _say_committed(turn, sender, message)
        return
    held = state.tentative
    if not isinstance(state.office, Coordinator) or held is None:
        return
    if message.epoch == state.promised and message.digest == held.digest:
        _count(turn, sender, incarnation)


def _say_committed(turn: StepContext, to: int, message: Acknowledge) -> None:
    """Send Committed again to a robot that has not heard it."""
    state = turn.state
    if isinstance(state.office, Coordinator) and any(
        held.digest == message.digest for held in state.log
    ):
        turn.send(to, Committed(state.promised, message.round, message.digest))
    else:
        teach(turn, to, message.round)


def _count(turn: StepContext, robot: int, incarnation: int) -> None:
    """Count one more robot that holds the tentative entry. (R-MAJORITY)"""
    state = turn.state
    desk, held = state.office, state.tentative
    assert isinstance(desk, Coordinator)
    assert held is not None
    if not state.counts(robot, incarnation):
        return
    holders = desk.holders | 1 << robot
    turn.take(replace(desk, holders=holders))
    if holders.bit_count() < turn.setup.majority:
        return
    pause_s = _pause(turn, desk)
    turn.tell(Committed(held.epoch, held.round, held.digest, pause_s))
    commit(turn, held)
    go_on(turn, pause_s)


def _pause(turn: StepContext, desk: Coordinator) -> float:
    """The rest of the round in seconds; overtime is not made up for. (R-BEGIN)"""
    return max(0.0, desk.began + turn.setup.timing.delta_s - turn.now)


def on_hello(turn: StepContext, sender: int, incarnation: int, message: Hello) -> None:
    """Handle a Hello: a robot is back. (R-REJOIN) (R-ADMIT)"""
    state = turn.state
    desk = state.office
    if (message.empty and isinstance(desk, Coordinator)) or state.ended:
        turn.want(ShowStore(sender))
    if not isinstance(desk, Coordinator):
        return
    if state.roster[sender] < incarnation and (sender, incarnation) not in desk.guests:
        others = tuple(guest for guest in desk.guests if guest[0] != sender)
        turn.take(replace(desk, guests=(*others, (sender, incarnation))))


def resend(turn: StepContext) -> None:
    """Send again to robots that have not answered. (R-AGAIN)"""
    state, setup = turn.state, turn.setup
    desk = state.office
    assert isinstance(desk, Coordinator)
    if state.tentative is not None:
        holders = desk.holders | 1 << state.pid
        silent = [i for i in range(setup.robots) if not holders >> i & 1]
        _ask_again(turn, silent, Decide(state.promised, state.tentative.entry))
    elif not state.ended:
        missing = [i for i in missing_in(desk) if i != state.pid]
        _ask_again(turn, missing, Open(state.promised, state.round, state.chain))
    else:
        return
    turn.await_longer()


def _ask_again(turn: StepContext, whom: list[int], message: Decide | Open) -> None:
    """Send one message to all if many are missing, or if the others heard nothing for a while."""
    if len(whom) > turn.setup.robots // 2 or turn.state.tries > 0:
        turn.tell(message)
        return
    for robot in whom:
        turn.send(robot, message)


def check_majority(turn: StepContext) -> bool:
    """Return whether a majority was heard since the last check. (R-SILENCE)"""
    state = turn.state
    desk = state.office
    assert isinstance(desk, Coordinator)
    if (desk.heard | 1 << state.pid).bit_count() < turn.setup.majority:
        return False
    turn.take(replace(desk, heard=0))
    turn.arm(Timer.SILENCE, turn.setup.timing.silence_s)
    return True


def note(turn: StepContext, desk: Coordinator, sender: int) -> None:
    """Note that a robot was heard."""
    if not desk.heard >> sender & 1:
        turn.take(replace(desk, heard=desk.heard | 1 << sender))


def waiting_for(state: State) -> tuple[int, ...]:
    """The robots that the open round waits for, as far as this robot can know. (R-OWED)"""
    match state.office:
        case Coordinator() as desk if state.tentative is None:
            return missing_in(desk)
        case _:
            return ()
