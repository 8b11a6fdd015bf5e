"""The loop of a deployed robot, until its run is over or it is told to stop."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from koord.runtime.deploy.entering import Entrance
from koord.runtime.deploy.job import CannotTakePartError, Job, Make, member_of
from koord.runtime.deploy.looking import SETTLING_S, Lookout, fleet_checks
from koord.runtime.deploy.member import LANDING_S, DivergedError, Member, Platform, Untimed
from koord.runtime.deploy.news import REPORT_S, Kept, News, Untold
from koord.runtime.deploy.preflight import Check
from koord.runtime.deploy.status import RobotReport, added, gathering, status_of
from koord.runtime.guardian.events import Order
from koord.runtime.node import Clock, Peer
from koord.runtime.orders.hearing import Body, Hearer, Obeyed
from koord.runtime.protocol.events import Reason
from koord.runtime.shapes import ShapeError
from koord.runtime.transports.transport import Transport
from koord.runtime.transports.udp import Udp
from koord.runtime.wire.codec import Channel
from koord.runtime.wire.frames import Drop, order_key

#: How long a robot stays to answer others after its last round, in rounds.
LINGERING = 8

#: Nobody wants to be told of more than how a robot is doing.
_NOTHING = Kept()

#: A vehicle that could not be told to stop is told again after so long.
_RETRY_S = 0.05


def described(error: Exception) -> str:
    """An error that nobody expected, in a line, with its place."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"


def _is_timeless(host: Platform) -> bool:
    """Return whether a platform never has a step to take, nor anything to say of itself."""
    made: Any = type(host)
    return made.tick is Untimed.tick and made.beacon is Untimed.beacon


class Runner:
    """A robot of a run, from its start to its end."""

    def __init__(
        self,
        job: Job,
        pid: int,
        transport: Transport,
        clock: Clock = time.monotonic,
        make: Make = member_of,
        *,
        keeps: Kept = _NOTHING,
    ) -> None:
        """Make the robot, and read its journal. Raises CannotTakePartError.

        ``keeps``: what somebody wants to be told of it.
        """
        self.job = job
        self.trouble: str | None = None  #: why it had to stop
        self._pid = pid
        self._transport = transport
        self._clock = clock
        self._untold = Untold(clock, job.pace_s, keeps)
        self._waits = job.waits
        self._is_alone = isinstance(transport, Udp)  #: in its process
        self._begun_at = clock()
        self._due_at: float | None = None  #: when the platform's next tick was due
        self._late_s = 0.0
        self._timeless: Platform | None = None  #: what has no steps to take, and no beacons
        self.entrance = Entrance(job, pid, transport, clock, make, self._untold)
        channel = Channel(order_key(job.key), job.robots, pid, encrypts=job.encrypts)
        self.hearer = Hearer(channel, Body(self._obey, self._state), clock, time.time)

    @property
    def member(self) -> Member:
        """The robot, as it is now."""
        return self.entrance.member

    @property
    def peer(self) -> Peer | None:
        """Its part in the protocol; None: it is in no run yet."""
        return self.entrance.peer

    @property
    def run_id(self) -> bytes:
        """The identity of the run that it is in."""
        return self.entrance.run_id

    @property
    def status(self) -> RobotReport:
        if self.peer is None:
            status = gathering(self._pid, self.entrance.joining.missing())
        else:
            status = status_of(self.peer, self.member, self._untold.tally)
        joining = ((drop.value, n) for drop, n in self.entrance.joining.drops.items())
        crowded = self._transport.dropped
        orders = ((drop.value, n) for drop, n in self.hearer.drops.items())
        crowds = [(Drop.CROWDED.value, crowded)] if crowded else []
        drops = added(status.drops, joining, orders, crowds)
        notes = (*self.entrance.remarks, *self.entrance.joining.notes, *self.member.host.remarks)
        if self.member.unwritable is not None:
            status = replace(status, holding=Reason.UNWRITABLE)
            notes = (*notes, f"its journal cannot be written: {self.member.unwritable}")
        return replace(
            status,
            trouble=self.trouble,
            notes=notes,
            checks=self._checks(),
            run=self.run_id.hex()[:8],
            drops=tuple(drops.items()),
        )

    def news(self) -> News:
        """What is new since the last call."""
        return self._untold.news(self.status)

    def run(
        self, is_told_to_stop: Callable[[], bool], report: Callable[[News], None]
    ) -> RobotReport:
        """Run until the run is over, all robots have stopped, or the robot is told to stop.

        Raises CannotTakePartError.
        """
        for _ in self.going(is_told_to_stop, report):
            pass
        return self.status

    def going(
        self, is_told_to_stop: Callable[[], bool], report: Callable[[News], None]
    ) -> Iterator[float | None]:
        """The same, step by step: between two of them others of this process may have their turn.

        What comes out of each is :attr:`rests_s`; None, too, where there are no others.

        Raises CannotTakePartError.
        """
        next_report = self._clock()
        leave_at: float | None = None
        while True:
            try:
                self.step()
            except CannotTakePartError:
                yield from self._stop()
                raise
            except (DivergedError, ShapeError) as error:
                self.trouble = str(error)
                break
            except Exception as error:  # whatever it is: the robot stops safely, and tells
                self.trouble = described(error)
                break
            now = self._clock()
            if now >= next_report:
                next_report = now + REPORT_S
                report(self.news())
                if is_told_to_stop():
                    break
            if leave_at is None:
                if self._is_over or self.member.all_stopped:
                    leave_at = now + max(LINGERING * self.job.delta_s, 0.5)
            elif now >= leave_at:
                self.member.forget()
                break
            yield None if self._is_alone else self.rests_s
        if self.trouble is None:
            self.member.finish()
        yield from self._stop()

    def step(self) -> None:
        """Take a step: of the handshake, or of the run. Raises CannotTakePartError."""
        wait_s = self._tick()
        entrance = self.entrance
        if self._waits:
            entrance.look(wait_s)
            return
        entrance.turn(wait_s)
        peer = entrance.peer
        if peer is not None:
            entrance.member.host.wait_with(self._tick)
            peer.turn(wait_s)

    @property
    def rests_s(self) -> float | None:
        """How long the robot has nothing to do if it hears nothing; None: not known."""
        peer, next_at = self.entrance.peer, self._due_at
        if peer is None or next_at is None:
            return None
        due = peer.node.due
        return self._most_s(next_at if due is None or next_at < due else due)

    def go(self) -> None:
        """Take part in the run: people have looked at the robot. (P-PREFLIGHT)"""
        self._waits = False

    def _checks(self) -> tuple[Check, ...]:
        if not self._waits:
            return ()
        now = self._clock()
        since_s = now - self._begun_at
        looked = Lookout(since_s, self._late_s, self.entrance.joining, self.hearer, now)
        return (*fleet_checks(looked), *self.member.host.checks())

    def _heed(self) -> None:
        """Hear what people say, whatever state the robot is in. (O-BESIDE) (O-AT-ONCE)"""
        for visit in self._transport.visits():
            answer = self.hearer.hear(visit.datagram)
            if answer is not None:
                visit.answer(answer)
        if self.hearer.alive_at_s is not None:
            self.member.host.alive(self.hearer.alive_at_s)

    def _obey(self, order: Order) -> Obeyed:
        return self.member.host.order(order, self._clock())

    def _state(self) -> str:
        return self.member.host.state

    def _tick(self) -> float:
        """Let the platform take its step; return how long there is until the next, at most."""
        self._heed()
        untold, entrance = self._untold, self.entrance
        if entrance.member.host is self._timeless:
            if untold.keeps_poses:
                untold.is_at(self._pid, self._timeless, self._clock())
            return REPORT_S / 4
        now, at = self._clock(), untold.committed_at
        age_s = None if at is None else now - at
        member = entrance.member
        host = member.host
        was_due_at = self._due_at
        is_late = was_due_at is not None and now - was_due_at > self._late_s
        if was_due_at is not None and is_late and now - self._begun_at > SETTLING_S / 2:
            self._late_s = now - was_due_at
        due_at = self._due_at = host.tick(now, age_s, member.holding)
        self._timeless = host if _is_timeless(host) else None
        untold.is_at(self._pid, host, now)
        peer = entrance.peer
        if peer is not None:
            beacon = host.beacon(self._clock())
            if beacon is not None:
                peer.tell(beacon)
        return self._most_s(due_at)

    def _most_s(self, next_at: float) -> float:
        """How long the robot may wait for something that is due at a time."""
        if next_at == math.inf:
            return REPORT_S / 4
        return min(REPORT_S / 4, max(0.0, next_at - self._clock()))

    @property
    def _is_over(self) -> bool:
        peer = self.entrance.peer
        return peer is not None and peer.node.over

    def _stop(self) -> Iterator[float | None]:
        """Come to a safe stop: nobody will tell the robot to go on. (P-START) (P-LAST-STOP)"""
        host = self.member.host
        host.holding = True
        end_s = self._clock() + LANDING_S
        is_told = False
        while self._clock() < end_s:
            try:
                if not is_told:
                    host.stop(self._clock())
                    is_told = True
                if host.is_at_rest:
                    break
                wait_s = self._tick()
            except Exception as error:  # the next tick may get through
                self.trouble = self.trouble or described(error)
                wait_s = _RETRY_S
            self._transport.receive(wait_s)
            yield None
        with ExitStack() as stack:  # whatever one of them raises, the others are closed
            stack.callback(self.entrance.close)
            stack.callback(self._transport.close)
            stack.callback(self._let_go)

    def _let_go(self) -> None:
        try:
            self.member.host.close()
        except Exception as error:  # whatever a driver does at its end
            self.trouble = self.trouble or described(error)
