"""The status of a robot, as numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.deploy.member import Member
from koord.runtime.deploy.preflight import Check
from koord.runtime.deploy.watching import Breach
from koord.runtime.deploy.watching import continued as breaches_continued
from koord.runtime.node import Peer
from koord.runtime.proposals import INIT_ROUND
from koord.runtime.protocol.coordinating import waiting_for
from koord.runtime.protocol.events import Reason


class RobotReport(Struct, frozen=True):
    """The status of one robot at one moment. Rounds count from 0; -1 is INIT."""

    pid: int
    round: int
    behind: int  #: rounds that it knows to be decided and has not acted on
    coordinator: int | None
    epoch: int
    holding: Reason | None
    waiting_for: tuple[int, ...]  #: robots that the coordinator waits for
    ran: int  #: rounds in which it was let through
    skipped: int
    late: int  #: rounds that its proposal came too late for
    overdue: int  #: rounds that began more than half a δ late
    longest_s: float  #: the longest round
    took_s: float  #: from the first commit to the last
    sent: int  #: datagrams
    received: int
    drops: tuple[tuple[str, int], ...]
    is_over: bool
    all_stopped: bool  #: no robot will run an event any more
    is_mute: bool
    is_voter: bool  #: whether its voice counts; not at once after a crash
    fault: str | None = None
    trouble: str | None = None  #: why it had to stop, if that is not the program's doing
    notes: tuple[str, ...] = ()  #: what it has noticed of itself and of other robots
    breaches: tuple[Breach, ...] = ()  #: claims that did not hold
    unwatched: tuple[str, ...] = ()  #: claims that asked for what nobody here knows
    run: str = ""  #: the beginning of the run's identity; empty: it is in no run yet
    checks: tuple[Check, ...] = ()  #: while it waits for people, before anything is armed
    start: int = 0  #: how often its process was started in this run
    written: int = 0  #: bytes that its disk was given for its journal
    sent_bytes: int = 0  #: of datagrams, without the headers of the network
    arrived: int = 0  #: datagrams; a message may be in several
    arrived_bytes: int = 0


def unheard(pid: int) -> RobotReport:
    """The status of a robot that has never said anything."""
    return RobotReport(
        pid=pid,
        round=INIT_ROUND,
        behind=0,
        coordinator=None,
        epoch=0,
        holding=None,
        waiting_for=(),
        ran=0,
        skipped=0,
        late=0,
        overdue=0,
        longest_s=0.0,
        took_s=0.0,
        sent=0,
        received=0,
        drops=(),
        is_over=False,
        all_stopped=False,
        is_mute=False,
        is_voter=False,
    )


def added(*drops: Iterable[tuple[str, int]]) -> Counter[str]:
    """What several have dropped, by reason."""
    found: Counter[str] = Counter()
    for one in drops:
        found.update(dict(one))
    return found


def continued(before: RobotReport, now: RobotReport) -> RobotReport:
    """The status of a robot that is back, with what it had counted before."""
    return replace(
        now,
        ran=before.ran + now.ran,
        skipped=before.skipped + now.skipped,
        late=before.late + now.late,
        overdue=before.overdue + now.overdue,
        longest_s=max(before.longest_s, now.longest_s),
        took_s=before.took_s + now.took_s,
        sent=before.sent + now.sent,
        received=before.received + now.received,
        written=before.written + now.written,
        sent_bytes=before.sent_bytes + now.sent_bytes,
        arrived=before.arrived + now.arrived,
        arrived_bytes=before.arrived_bytes + now.arrived_bytes,
        drops=tuple(added(before.drops, now.drops).items()),
        breaches=breaches_continued(before.breaches, now.breaches),
        unwatched=tuple(sorted({*before.unwatched, *now.unwatched})),
    )


class Tally(Struct):
    """The counters of a robot in a run."""

    ran: int = 0
    skipped: int = 0
    late: int = 0
    overdue: int = 0
    longest_s: float = 0.0
    took_s: float = 0.0


def gathering(pid: int, missing: tuple[int, ...]) -> RobotReport:
    """The status of a robot that is in no run yet. (R-JOIN)"""
    return replace(unheard(pid), holding=Reason.GATHERING, waiting_for=missing)


def status_of(peer: Peer, member: Member, tally: Tally) -> RobotReport:
    """Make the status report of a robot."""
    state = peer.node.state
    fault, monitor = member.fault, member.monitor
    return RobotReport(
        pid=state.pid,
        round=state.round,
        behind=max(0, state.target - state.round),
        coordinator=state.leader,
        epoch=state.promised,
        holding=Reason.UNWRITABLE if peer.node.is_unwritable else state.holding,
        waiting_for=waiting_for(state) if state.holding is Reason.ROUND_OPEN else (),
        ran=tally.ran,
        skipped=tally.skipped,
        late=tally.late,
        overdue=tally.overdue,
        longest_s=tally.longest_s,
        took_s=tally.took_s,
        sent=peer.counts.datagrams,
        received=peer.counts.received,
        sent_bytes=peer.counts.sent_bytes,
        arrived=peer.counts.arrived,
        arrived_bytes=peer.counts.arrived_bytes,
        drops=tuple((drop.value, n) for drop, n in peer.drops.items()),
        is_over=state.ended,
        all_stopped=member.all_stopped,
        is_mute=member.mute,
        is_voter=state.is_voter,
        fault=None if fault is None else f"{fault.place}: {fault.kind.value}",
        start=peer.start_number,
        written=member.written,
        breaches=() if monitor is None else monitor.breaches.all,
        unwatched=() if monitor is None else tuple(sorted(monitor.unknown)),
    )
