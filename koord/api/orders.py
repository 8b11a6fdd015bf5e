"""Orders of people to robots that run: stop, go on, and heartbeats. (specs/orders/README.md)"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager

from msgspec import Struct, to_builtins

from koord.api.callees import Callees, FleetFiles, Where, callees
from koord.api.progress import Cancellation, Listener, Progress, asker, heard_by
from koord.api.results import ArgumentError, Result, html_table
from koord.runtime.orders.calling import Call, Called
from koord.runtime.orders.lines import Line, line_to
from koord.runtime.orders.messages import Outcome, Reply, Request
from koord.runtime.orders.messages import Wanted as Wanted
from koord.runtime.orders.places import found
from koord.runtime.transports.transport import TransportError
from koord.runtime.wire.codec import Channel, DatagramWriter, OrderReader
from koord.runtime.wire.frames import MOST_ROBOTS
from koord.syntax.diagnostics import Diagnostic, refusal

#: What people say besides the e-stop.
ORDERS = (Wanted.STOP, Wanted.START, Wanted.LAND, Wanted.RESET)

#: How long robots are called, in seconds, unless somebody says.
USUAL_S = 5.0

#: Answers are waited for so long at a time.
_WAIT_S = 0.05

#: How often runs of this machine are looked for that have begun since.
_LOOK_S = 0.5

#: A robot that has not answered for so long is told to be silent, in seconds.
SILENT_S = 1.0

#: The name of a caller on the wire: the number of no robot.
_CALLER = MOST_ROBOTS - 1


class RobotAnswer(Struct, frozen=True):
    """What a robot has answered. ``where`` is its configuration, if several are called."""

    pid: int
    is_done: bool  #: it has answered, and has done it
    state: str | None  #: how it is doing, in words; None: it has not answered
    why: str = ""  #: why it has refused
    where: str = ""

    def __str__(self) -> str:
        if self.state is None:
            return "did not answer"
        return f"refused: {self.why} ({self.state})" if self.why else self.state


class OrderReport(Result, frozen=True, kw_only=True):
    """The result of an order: the answer of each robot."""

    wanted: Wanted
    robots: tuple[RobotAnswer, ...]
    warnings: tuple[Diagnostic, ...] = ()  #: why others than those of this machine were not called

    @property
    def ok(self) -> bool:
        """True if all robots have answered, and have done it."""
        known = bool(self.robots) and not self.warnings
        return known and all(one.is_done for one in self.robots)

    def to_dict(self) -> dict[str, object]:
        robots = [{**to_builtins(one), "answer": str(one)} for one in self.robots]
        return {"version": 1, "order": self.wanted.value, "ok": self.ok, "robots": robots}

    def __str__(self) -> str:
        return "\n".join(f"robot {one.pid}: {one}" for one in self.robots)

    def _repr_html_(self) -> str:
        rows = ((one.pid, str(one)) for one in self.robots)
        return html_table(self.wanted.value, ("robot", "answer"), rows)


class HeartbeatHeard(Progress, frozen=True):
    """Progress of heartbeats: how each robot is doing."""

    robots: tuple[RobotAnswer, ...] = ()


def estop(
    config: Where = None,
    *,
    site: Where = None,
    robots: Collection[int] | None = None,
    test: bool = False,
    timeout_s: float = USUAL_S,
) -> OrderReport:
    """Stop robots at once, whatever they do: the e-stop.

    ``config`` is the configuration with which they were deployed, and ``site`` the file of what it
    does not say, if there is one: with its key they are reached wherever they are. Without one all
    robots are stopped that this user has deployed on this machine. ``robots`` are their pids, if
    not all are meant. A ``test`` stops nobody, and shows who would have been. They are called for
    ``timeout_s`` seconds at most.

    Raises :class:`koord.KoordError` if there is nobody to call.

    >>> koord.estop("task.yaml").ok
    True
    """
    files = FleetFiles.of(config, site)
    return _ordered(files, Wanted.ASK if test else Wanted.ESTOP, robots, timeout_s)


def order(
    config: Where,
    wanted: Wanted | str,
    *,
    site: Where = None,
    robots: Collection[int] | None = None,
    timeout_s: float = USUAL_S,
) -> OrderReport:
    """Tell robots to ``stop`` (hold), ``start`` (go on), ``land`` or ``reset`` (after an e-stop).

    The rest is as for :func:`koord.estop`.

    >>> koord.order("task.yaml", "stop").ok
    True
    """
    asked = next((one for one in ORDERS if wanted in (one, one.value)), None)
    if asked is None:
        known = ", ".join(one.value for one in ORDERS)
        raise ArgumentError("wanted", f"{wanted!r} is no order: there are {known}")
    return _ordered(FleetFiles.of(config, site), asked, robots, timeout_s)


def heartbeat(
    config: Where = None,
    *,
    site: Where = None,
    robots: Collection[int] | None = None,
    pressed: Callable[[], bool] | None = None,
    progress: Listener | None = None,
    cancellation: Cancellation | None = None,
) -> OrderReport | None:
    """Tell robots that people are there, until cancelled; those with `heartbeat:` hold then.

    When ``pressed`` answers True, it is an e-stop, whose result is returned. ``progress`` hears
    :class:`HeartbeatHeard`. The rest is as for :func:`koord.estop`.
    """
    is_cancelled, tell = asker(cancellation), heard_by(progress)
    files = FleetFiles.of(config, site)
    while not is_cancelled():
        fleets, _ = callees(files, robots, is_patient=True)
        if fleets and _beat(files.config, fleets, _Watch(is_cancelled, pressed or _never), tell):
            return _ordered(files, Wanted.ESTOP, robots, USUAL_S)
        if not fleets:
            tell(HeartbeatHeard("nobody to call"))
            time.sleep(_LOOK_S)
    return None


def _never() -> bool:
    return False


class _Watch(Struct, frozen=True):
    """What ends heartbeats."""

    is_cancelled: Callable[[], bool]
    pressed: Callable[[], bool]


def _beat(config: str | None, fleets: list[Callees], watch: _Watch, tell: Listener) -> bool:
    """Send heartbeats until something ends them, or for some time; return whether by e-stop."""
    with _called(fleets, Wanted.ALIVE) as calls:
        while not watch.is_cancelled():
            if watch.pressed():
                return True
            calls.turn(_WAIT_S)
            tell(HeartbeatHeard("heartbeats", robots=calls.silent_or_not()))
            if calls.have_moved(config):
                return False
    return False


def _ordered(
    files: FleetFiles, wanted: Wanted, robots: Collection[int] | None, timeout_s: float
) -> OrderReport:
    fleets, warnings = callees(files, robots)
    with _called(fleets, wanted) as calls:
        calls.until_over(timeout_s)
        return OrderReport(wanted=wanted, robots=calls.answers(), warnings=warnings)


# --- calling --------------------------------------------------------------------------------------


class _Line:
    """A call to one fleet, over its line."""

    def __init__(self, fleet: Callees, wanted: Wanted, line: Line) -> None:
        access = fleet.access
        channel = Channel(access.key, MOST_ROBOTS, _CALLER, 1, access.encrypts)
        self.fleet, self.line, self.call = fleet, line, Call(fleet.pids, wanted)
        self._writer = DatagramWriter(channel)
        self._reader = OrderReader(access.key, encrypts=access.encrypts)

    def say(self) -> None:
        for request in self.call.requests(time.monotonic(), time.time()):
            self._send(request)

    def _send(self, request: Request) -> None:
        for datagram in self._writer.datagrams(0, 0, request):
            self.line.send(request.robot, datagram)

    def hear(self, timeout_s: float) -> None:
        for datagram in self.line.receive(timeout_s):
            reply = self._reader.read(datagram)
            if isinstance(reply, Reply):
                again = self.call.hear(reply, time.monotonic(), time.time())
                if again is not None:
                    self._send(again)

    @property
    def is_over(self) -> bool:
        return self.fleet.is_gone or self.call.is_over


class _Calls:
    """Calls to several fleets at a time."""

    def __init__(self, lines: list[_Line]) -> None:
        self._lines = lines
        self._looked_at = time.monotonic()
        self._begun_at = self._looked_at

    def turn(self, most_s: float) -> None:
        """Say what is due, and hear for a while."""
        for one in self._lines:
            one.say()
        now = time.monotonic()
        wait_s = min([most_s, *(one.call.due_in_s(now) for one in self._lines)])
        for one in self._lines:
            one.hear(wait_s / len(self._lines))

    def until_over(self, timeout_s: float) -> None:
        """Call until all have answered, or the time is over. (O-ANSWER)"""
        ends_at = self._begun_at + timeout_s
        while time.monotonic() < ends_at:
            self.turn(_WAIT_S)
            if all(one.is_over for one in self._lines):
                break
        for one in self._lines:
            # Of a process that was killed: its robots have stopped, or have answered.
            if one.fleet.is_gone and one.fleet.file is not None and not one.call.is_over:
                one.fleet.file.unlink(missing_ok=True)

    def answers(self) -> tuple[RobotAnswer, ...]:
        """What each robot has answered; those that are gone count only if they have."""
        several = len({one.fleet.name for one in self._lines}) > 1
        answers = [
            _answer(pid, called, one.fleet.name if several else "")
            for one in self._lines
            for pid, called in one.call.robots.items()
            if not (one.fleet.is_gone and called.reply is None)
        ]
        return tuple(sorted(answers, key=lambda one: (one.where, one.pid)))

    def silent_or_not(self) -> tuple[RobotAnswer, ...]:
        """What each robot says now; nothing if it has been silent for a while."""
        now = time.monotonic()
        return tuple(
            _answer(pid, called if _is_heard(called, now) else Called(), "")
            for one in self._lines
            for pid, called in one.call.robots.items()
        )

    def have_moved(self, config: str | None) -> bool:
        """Return, now and then, whether robots of this machine have begun or ended since."""
        now = time.monotonic()
        if now - self._looked_at < _LOOK_S:
            return False
        self._looked_at = now
        known = {one.fleet.file for one in self._lines if one.fleet.file is not None}
        there = {path for path, run in found(config)}
        return known != there


def _is_heard(called: Called, now: float) -> bool:
    return called.heard_at_s is not None and now - called.heard_at_s <= SILENT_S


def _answer(pid: int, called: Called, where: str) -> RobotAnswer:
    reply = called.reply
    if reply is None or (reply.outcome is Outcome.STALE and not called.is_over):
        state = None if reply is None else reply.state
        return RobotAnswer(pid, is_done=False, state=state, where=where)
    return RobotAnswer(pid, called.has_done_it, reply.state, reply.why, where)


@contextmanager
def _called(fleets: Iterable[Callees], wanted: Wanted) -> Iterator[_Calls]:
    """Open lines to fleets. Raises KoordError for a network that cannot be used."""
    with ExitStack() as stack:
        lines: list[_Line] = []
        for fleet in fleets:
            try:
                line = line_to(fleet.access.reach)
            except TransportError as error:
                raise refusal("K933", fleet.name, error.message, error.hint or None) from None
            stack.callback(line.close)
            lines.append(_Line(fleet, wanted, line))
        yield _Calls(lines)
