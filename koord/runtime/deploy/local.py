"""Local runs: all robots as processes on this machine, and their shared transport."""

from __future__ import annotations

import multiprocessing
import os
import secrets
import shutil
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import FrameType
from typing import assert_never

from msgspec import Struct, field
from msgspec.structs import replace

from koord.runtime.configuration.forms import Carrier
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy.job import CannotTakePartError, Job, Make, member_of
from koord.runtime.deploy.news import Kept, News
from koord.runtime.deploy.running import Runner, described
from koord.runtime.deploy.status import RobotReport
from koord.runtime.deploy.supervision import EndCause, ProcessEnd
from koord.runtime.deploy.together import Going, run_together
from koord.runtime.transports.routed import Routed
from koord.runtime.transports.shared import SharedUdp
from koord.runtime.transports.transport import Transport, TransportError
from koord.runtime.transports.udp import Delivery, Plan, Udp, on_this_machine
from koord.syntax.forking import FORKING

#: Where ports for robots on this machine are looked for.
_FIRST_PORT, _PORTS = 20_000, 30_000

#: Others may use some of them: so many are tried.
_TRIES = 20


def plan_of(configuration: RunConfiguration) -> Plan:
    """The UDP plan of a configuration: addresses and reach."""
    talk = configuration.talk
    addresses = tuple(robot.address for robot in configuration.robots)
    match talk.carrier:
        case Carrier.MULTICAST:
            assert talk.shared is not None
            # The group has a port of its own, below those of robots on one machine.
            local = all(ip.startswith("127.") for ip, _ in addresses)
            interface = "127.0.0.1" if local else talk.interface
            return Plan(addresses, Delivery.GROUP, (talk.shared, talk.port), interface)
        case Carrier.BROADCAST:
            assert talk.shared is not None
            return Plan(addresses, Delivery.SUBNET, (talk.shared, talk.port))
        case Carrier.UNICAST | Carrier.ZENOH:
            return Plan(addresses)
        case _:
            assert_never(talk.carrier)


def local_plan(configuration: RunConfiguration, robots: int) -> Plan:
    """A plan with all robots on this machine, each with a port of its own."""
    unicast = configuration.talk.carrier is Carrier.UNICAST
    with FORKING:  # else a robot of another thread keeps the sockets that are tried here
        ports = (_FIRST_PORT + secrets.randbelow(_PORTS) for _ in range(_TRIES))
        port = next((port for port in ports if _are_free(port, robots)), _FIRST_PORT)
        if unicast or robots == 1 or not hears_itself(port):
            return on_this_machine(robots, port, group=None)
        return on_this_machine(robots, port)


def _are_free(port: int, robots: int) -> bool:
    """Return whether the ports of a plan are free at present."""
    try:
        for address in on_this_machine(robots, port, group=None).addresses:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
                one.bind(address)
    except OSError:
        return False
    return True


def hears_itself(port: int) -> bool:
    """Return whether multicast works on this machine's loopback; in some containers it does not."""
    plan = on_this_machine(2, port)
    opened: list[Udp] = []
    try:
        opened += [Udp(plan, pid) for pid in range(2)]
        for _ in range(3):
            opened[0].tell(b"?")
            if opened[1].receive(0.1):
                return True
    except TransportError:
        pass  # whoever uses the port in earnest is told
    finally:
        for one in opened:
            one.close()
    return False


def transport_of(configuration: RunConfiguration, run: str, pid: int) -> Transport:
    """Open the transport of one robot. Raises TransportError."""
    talk = configuration.talk
    if talk.carrier is Carrier.ZENOH:
        return Routed(run, pid, len(configuration.robots), talk.connect, talk.listen)
    return Udp(plan_of(configuration), pid)


class Farewell(Struct, frozen=True):
    """The last word of a robot's process that ends before its time: the signal, or the error."""

    signal: int | None = None
    error: str | None = None


#: What a robot's process says: what is new of it, or why it ends.
Said = News | TransportError | CannotTakePartError | Farewell

_STOP, _GO = b"stop", b"go"

#: How long a process may take to end after its last word.
_REAP_S = 1.0


#: Opens the network of one robot. Raises TransportError.
Carry = Callable[[Plan, int], Transport]


class Launch(Struct, frozen=True):
    """The arguments of a robot's process."""

    job: Job
    plan: Plan
    make: Make = member_of
    carry: Carry = Udp
    keeps: Kept = Kept()
    scratch: str | None = None  #: a folder that is of no use without the first process
    wrap: Callable[[Transport, int], Transport] | None = None  #: of those who share processes
    processes: int | None = None  #: so many share the robots; None: each has its own


class LocalProcesses(Struct):
    """The processes of a run, and their last reports."""

    launch: Launch
    processes: list[BaseProcess] = field(default_factory=list)
    ends: list[Connection] = field(default_factory=list)
    statuses: dict[int, RobotReport] = field(default_factory=dict)
    failures: dict[int, TransportError | CannotTakePartError] = field(default_factory=dict)
    farewells: dict[int, Farewell] = field(default_factory=dict)
    _closed: list[int] = field(default_factory=list)  #: whose ends have not been asked for

    @property
    def alive(self) -> int:
        """The number of running processes."""
        return sum(process.is_alive() for process in self.processes)

    @property
    def died(self) -> tuple[int, ...]:
        """The robots whose processes ended abnormally."""
        codes = enumerate(process.exitcode for process in self.processes)
        died = {pid for pid, code in codes if code not in (None, 0)}
        return tuple(sorted(died | self.farewells.keys()))

    def check(self) -> None:
        """Raise the TransportError of a robot that could not begin, if there is one."""
        for error in self.failures.values():
            raise error

    def news(self, timeout_s: float) -> Iterator[News]:
        """Yield what is new of processes, waiting at most ``timeout_s`` for the first."""
        open_ends = [end for end in self.ends if not end.closed]
        if not open_ends:
            time.sleep(timeout_s)
            return
        for ready in wait(open_ends, timeout_s):
            assert isinstance(ready, Connection)
            pid = self.ends.index(ready)
            try:
                said: Said = ready.recv()
            except (EOFError, OSError):
                ready.close()
                self._closed.append(pid)
                continue
            match said:
                case TransportError() | CannotTakePartError():
                    self.failures[pid] = said
                case Farewell():
                    self.farewells[pid] = said
                case News(status=status):
                    self.statuses[pid] = status
                    yield said
                case _:
                    assert_never(said)

    def ended(self) -> Iterator[ProcessEnd]:
        """Yield how the processes ended that have since this was last asked."""
        closed, self._closed = self._closed, []
        for pid in closed:
            process, status = self.processes[pid], self.statuses.get(pid)
            is_done = status is not None and (status.is_over or status.all_stopped)
            said_why = is_done or pid in self.farewells or pid in self.failures
            if not (said_why and self._is_shared(pid)):
                with FORKING:
                    process.join(_REAP_S)
                    if process.exitcode is None and not self._is_shared(pid):
                        process.kill()
                        process.join()
            yield self._end_of(pid, process.exitcode or 0)

    def _is_shared(self, pid: int) -> bool:
        """Whether other robots go on in a robot's process."""
        process = self.processes[pid]
        ends = zip(self.processes, self.ends, strict=True)
        return any(other is process and not end.closed for other, end in ends)

    def _end_of(self, pid: int, code: int) -> ProcessEnd:
        status, farewell = self.statuses.get(pid), self.farewells.get(pid, Farewell())
        round_ = None if status is None else status.round
        if status is not None and (status.is_over or status.all_stopped):
            return ProcessEnd(pid, EndCause.DONE, round_)
        if code < 0:
            return ProcessEnd(pid, EndCause.KILLED, round_, signal=-code)
        failure, trouble = self.failures.get(pid), None if status is None else status.trouble
        error = trouble or farewell.error or (None if failure is None else failure.message)
        if error is None and code > 0:
            error = f"exit code {code}"
        if error is not None:
            return ProcessEnd(pid, EndCause.CRASHED, round_, detail=error)
        return ProcessEnd(pid, EndCause.STOPPED, round_, farewell.signal)

    @property
    def is_over(self) -> bool:
        """True if no process will report anything more."""
        return all(end.closed for end in self.ends)

    def stop(self) -> None:
        """Ask all processes to stop safely."""
        self._tell(_STOP)

    def go(self) -> None:
        """Let all robots take part in the run: people have looked at them. (P-PREFLIGHT)"""
        self.launch = replace(self.launch, job=replace(self.launch.job, waits=False))
        self._tell(_GO)

    def _tell(self, word: bytes) -> None:
        for end in self.ends:
            if not end.closed:
                with suppress(OSError):  # it has ended, which is heard next
                    end.send_bytes(word)

    def kill(self) -> None:
        """End all processes at once."""
        for process in self.processes:
            if process.is_alive():
                process.kill()

    def replace(self, pid: int) -> None:
        """Kill a robot's process, as a crash would, and start another."""
        self.ends[pid].close()
        if not self._is_shared(pid):
            self.processes[pid].kill()
            self.processes[pid].join()
        self.statuses.pop(pid, None)
        self.failures.pop(pid, None)
        self.farewells.pop(pid, None)
        # Who comes back belongs to the run that there is, also if that was to be a new one.
        launch = replace(self.launch, job=replace(self.launch.job, insists=False))
        self.processes[pid], (self.ends[pid],) = _started(launch, (pid,))

    def join(self) -> None:
        """Wait until all processes have ended."""
        for process in self.processes:
            process.join()


def launched(launch: Launch) -> LocalProcesses:
    """Start the processes of all robots: one for each, or as many as are to share them."""
    fleet = LocalProcesses(launch)
    robots = launch.job.robots
    count = robots if launch.processes is None else min(launch.processes, robots)
    bounds = [robots * k // count for k in range(count + 1)]
    for low, high in pairwise(bounds):
        process, ends = _started(launch, tuple(range(low, high)))
        fleet.processes += [process] * len(ends)
        fleet.ends += ends
    return fleet


def _started(launch: Launch, pids: tuple[int, ...]) -> tuple[BaseProcess, list[Connection]]:
    """Start a process for robots; return it with our ends of their pipes."""
    with FORKING:
        pipes = [multiprocessing.Pipe() for _ in pids]
        process = _process(launch, pids, [theirs for _, theirs in pipes])
        process.start()
        for _, theirs in pipes:
            theirs.close()
    return process, [ours for ours, _ in pipes]


def _process(launch: Launch, pids: tuple[int, ...], ends: list[Connection]) -> BaseProcess:
    """The process of robots; where the system supports it, forked with all modules loaded."""
    name = f"robot {pids[0]}" if len(pids) == 1 else f"robots {pids[0]} to {pids[-1]}"
    target, arguments = (
        (_robot, (launch, pids[0], ends[0])) if len(pids) == 1 else (_robots, (launch, pids, ends))
    )
    if "fork" in multiprocessing.get_all_start_methods():
        fork = multiprocessing.get_context("fork")
        return fork.Process(target=target, name=name, args=arguments, daemon=True)
    return multiprocessing.Process(target=target, name=name, args=arguments, daemon=True)


def _nothing() -> None:
    """There is no robot yet."""


class _Asked:
    """What asks a robot's process to end: a signal, or the first process by a word or by its end.

    The first signal asks for a safe stop; another one ends the process at once. Ctrl-C is left to
    the first process, and what it ignores (a hang-up under nohup) is ignored here as well.
    """

    def __init__(self, end: Connection, first: _Asked | None = None) -> None:
        """Listen to an end; ``first`` hears the signals for several of them in one process."""
        self.go: Callable[[], None] = _nothing
        self._by: int | None = None
        self._first = self if first is None else first
        self._end = end
        self._is_told = False
        if first is not None:
            return
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for name in ("SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._on_signal)

    @property
    def by(self) -> int | None:
        """The signal."""
        return self._first._by

    def __call__(self) -> bool:
        self._listen()
        return self.by is not None or self.is_orphan or self._is_told

    def _listen(self) -> None:
        """Hear what the first process says; its end is the word to stop."""
        try:
            while not self._is_told and self._end.poll():
                if self._end.recv_bytes() == _GO:
                    self.go()
                else:
                    self._is_told = True
        except (EOFError, OSError):
            self._is_told = True

    @property
    def is_orphan(self) -> bool:
        """True if the first process has ended."""
        parent = multiprocessing.parent_process()
        return parent is not None and os.getppid() != parent.pid

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._by is not None:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        self._by = number


def _robot(launch: Launch, pid: int, end: Connection) -> None:
    """Run a robot as the main function of its process."""
    asked = _Asked(end)
    try:
        transport = launch.carry(launch.plan, pid)
    except TransportError as error:
        end.send(error)
        return
    for _ in _going(launch, pid, end, transport, asked):
        pass
    if launch.scratch is not None and asked.is_orphan:
        shutil.rmtree(launch.scratch, ignore_errors=True)


def _robots(launch: Launch, pids: tuple[int, ...], ends: list[Connection]) -> None:
    """Run several robots as the main function of their process."""
    first = _Asked(ends[0])
    try:
        shared = SharedUdp(launch.plan, pids)
    except TransportError as error:
        for end in ends:
            end.send(error)
        return
    going = []
    for pid, end in zip(pids, ends, strict=True):
        transport: Transport = shared.ends[pid]
        if launch.wrap is not None:
            transport = launch.wrap(transport, pid)
        asked = first if pid == pids[0] else _Asked(end, first)
        going.append(Going(shared.ends[pid], _going(launch, pid, end, transport, asked)))
    run_together(shared, going, time.monotonic)
    if launch.scratch is not None and first.is_orphan:
        shutil.rmtree(launch.scratch, ignore_errors=True)


def _going(
    launch: Launch, pid: int, end: Connection, transport: Transport, asked: _Asked
) -> Iterator[float | None]:
    """Run a robot, step by step, and tell the first process of it.

    It leaves its ports and its journal to whoever comes back as this robot.
    """
    runner: Runner | None = None
    try:
        runner = Runner(
            launch.job,
            pid,
            transport,
            make=launch.make,
            keeps=launch.keeps,
        )
        asked.go = runner.go

        def report(news: News) -> None:
            with suppress(OSError):  # nobody hears it any more: it is told to stop
                end.send(news)

        yield from runner.going(asked, report)
        report(runner.news())
        farewell = None if asked.by is None else Farewell(signal=asked.by)
    except CannotTakePartError as error:
        end.send(error)
        farewell = None
    except Exception as error:  # whatever it is: it is told
        farewell = Farewell(error=described(error))
    if runner is not None:
        runner.entrance.close()
    transport.close()
    if farewell is not None:
        with suppress(OSError):
            end.send(farewell)
    end.close()
