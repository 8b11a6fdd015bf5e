"""Robots as processes of `koord deploy FILE CONFIG --pid I`, on a network that tests control."""

from __future__ import annotations

import json
import os
import re
import resource
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from tests.deployed.proxy import Proxy, Seat
from tests.deployed.recordings import LEDGER, Recording, Said, disagreements, read
from tests.deployed.starting import ForkedProcess, starter

_ROOT = Path(__file__).parents[2]
_HOOKS = Path(__file__).parent / "hooks"

KEY = "sixteen letters or more"

#: How long anything may take that is not itself what a test is about.
PATIENCE_S = 30.0

#: A δ for tests that count late rounds: on a machine with busy cores nobody is late by itself.
UNHURRIED_S = 0.2

#: Below the ports that systems hand out by themselves, so that nobody takes one meanwhile.
_PORTS = range(10_000, 30_000)


class Start(Struct, frozen=True):
    """What a robot's process is started with, but for the files that the fleet makes of it."""

    pid: int
    seat: str = ""  #: a name if it is a second process of this robot
    program: Path = LEDGER
    key: str = KEY
    encrypts: bool = False
    run: str | None = None
    delta_s: float = 0.05
    leader: int = 0
    rounds: int | None = None
    state: Path | None = None  #: None: a folder of its own, the same at each start
    settings: tuple[str, ...] = ()  #: as for ``--set``
    words: tuple[str, ...] = ()  #: further arguments
    before: tuple[str, ...] = ()  #: a command that starts the command
    clock_shift_s: float = 0.0
    records: bool = True

    @property
    def place(self) -> str:
        """The name of its seat."""
        return self.seat or str(self.pid)


class Line(Struct, frozen=True):
    """A line on standard error, and when it came."""

    at_s: float
    text: str


def _process(start: Start, words: list[str]) -> subprocess.Popen[str] | ForkedProcess:
    """A process that runs `koord WORDS`: forked from one that has loaded it, where that will do."""
    path = {"PYTHONPATH": os.pathsep.join((str(_HOOKS), str(_ROOT)))}
    if sys.platform == "linux" and not start.before and not start.clock_shift_s:
        return starter(**path).start(words)
    shift = {"KOORD_TEST_CLOCK_SHIFT_S": str(start.clock_shift_s)}
    return subprocess.Popen(
        [*start.before, sys.executable, "-m", "koord", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        env={**os.environ, **path, **shift},
        start_new_session=True,
    )


class RobotProcess:
    """A process of a robot, and what was heard from it."""

    def __init__(self, start: Start, words: list[str], record: Path | None) -> None:
        """``words`` are those behind ``koord``."""
        self.start = start
        self.pid = start.pid
        self.begun_s = time.monotonic()
        self.lines: list[Line] = []
        self._out: list[str] = []
        self._record, self._recording, self._read_at = record, Recording(), (0, 0)
        self.process = _process(start, words)
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        self._readers = [
            threading.Thread(target=self._hear, args=(self.process.stderr,), daemon=True),
            threading.Thread(target=self._take, args=(self.process.stdout,), daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    def _hear(self, stream: IO[str]) -> None:
        for text in stream:
            self.lines.append(Line(time.monotonic(), text.rstrip("\n")))

    def _take(self, stream: IO[str]) -> None:
        self._out += stream

    # --- what is done to it ---------------------------------------------------------------------

    def kill(self) -> None:
        """Kill it at once, if it has not ended, and wait until it is gone."""
        self.process.kill()
        self.end()

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    @contextmanager
    def standing_still(self) -> Iterator[None]:
        """Within the context it does not run, and its clocks go on."""
        self.signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.signal(signal.SIGCONT)

    def fill_disk(self) -> None:
        """Let nothing more be written to files by it."""
        _, most = resource.prlimit(self.process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(self.process.pid, resource.RLIMIT_FSIZE, (0, most))

    def free_disk(self) -> None:
        """Let it write again."""
        _, most = resource.prlimit(self.process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(self.process.pid, resource.RLIMIT_FSIZE, (most, most))

    def end(self, within_s: float = PATIENCE_S) -> int:
        """Wait for its end; return its exit code."""
        code = self.process.wait(within_s)
        for reader in self._readers:
            reader.join()
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()
        return code

    # --- what it says ---------------------------------------------------------------------------

    @property
    def is_alive(self) -> bool:
        return self.process.poll() is None

    @property
    def err(self) -> str:
        """All that it has said on standard error."""
        return "\n".join(line.text for line in self.lines)

    @property
    def out(self) -> str:
        """All that it has printed: its report, or the errors in its input, as JSON."""
        return "".join(self._out)

    @property
    def report(self) -> dict[str, Any]:
        """Its part of the report that it printed at its end; empty if it has printed none."""
        robots = json.loads(self.out).get("robots", []) if self.out.strip() else []
        return dict(robots[0]) if robots else {}

    @property
    def recording(self) -> Recording:
        """What it has recorded so far; robots write that down four times a second."""
        if self._record is not None and self._record.exists():
            stat = self._record.stat()
            is_new = (stat.st_size, stat.st_mtime_ns) != self._read_at
            found = read(self._record) if is_new else None
            if found is not None:
                self._recording, self._read_at = found, (stat.st_size, stat.st_mtime_ns)
        return self._recording

    @property
    def status(self) -> dict[str, Any]:
        """Its last status: its report if it has ended, else from its recording."""
        return (self.report if not self.is_alive else {}) or self.recording.status

    @property
    def round(self) -> int:
        """The first round that it has not acted on; -1 as long as nothing is known."""
        return int(self.status.get("round", -1))

    @property
    def rounds(self) -> list[Said]:
        """The rounds that it has acted on, as recorded."""
        return self.recording.rounds

    def drops(self) -> dict[str, int]:
        """How many datagrams it has dropped, by reason."""
        return dict(self.status.get("drops", {}))

    def has_said(self, pattern: str) -> bool:
        """Whether it has said this, in whatever case: as a remark, or as an error in its input."""
        return re.search(pattern, f"{self.err}\n{self.out}", re.IGNORECASE) is not None


class Fleet:
    """A fleet on this machine: within the context its processes run, behind it none is left."""

    def __init__(self, folder: Path, robots: int, **common: Any) -> None:
        """``common`` are fields of :class:`Start` for all robots."""
        self.folder, self.robots = folder, robots
        self.proxy = Proxy(robots)
        self.every: list[RobotProcess] = []  #: all processes, in the order of their starts
        self.at: dict[str, RobotProcess] = {}  #: the last process of each seat
        self._common = common
        self._seats: dict[str, Seat] = {}

    def __enter__(self) -> Fleet:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        for one in self.every:
            one.kill()
        self.proxy.close()

    def __getitem__(self, pid: int) -> RobotProcess:
        """The last process of a robot."""
        return self.at[str(pid)]

    def __iter__(self) -> Iterator[RobotProcess]:
        return iter(self.at.values())

    # --- starts ---------------------------------------------------------------------------------

    def start(self, pid: int, **changes: Any) -> RobotProcess:
        """Start a process of a robot, with these fields of :class:`Start`."""
        return self._started(Start(pid=pid, **{**self._common, **changes}))

    def start_all(self, **changes: Any) -> None:
        """Start all robots."""
        for pid in range(self.robots):
            self.start(pid, **changes)

    def again(self, pid: int, **changes: Any) -> RobotProcess:
        """Start a robot as it was started before, but for these fields of :class:`Start`."""
        return self._started(replace(self[pid].start, **changes))

    def _started(self, start: Start) -> RobotProcess:
        seat = self._seats.get(start.place)
        if seat is None:
            seat = self.proxy.seat(start.place, start.pid, ("127.0.0.1", free_port()))
            self._seats[start.place] = seat
        seat.heard_at_s = None
        number = len(self.every)
        home = self.folder / start.place
        home.mkdir(exist_ok=True)
        config = home / f"{number}.yaml"
        config.write_text(self._configuration(start, seat), encoding="utf-8")
        config.chmod(0o600)  # there is a key in it
        record = home / f"{number}.mcap" if start.records else None
        state = start.state or home / "state"
        words = ["deploy", str(start.program), str(config), "--pid", str(start.pid), "--json"]
        words += ["--state", str(state), *start.words]
        words += [] if start.rounds is None else ["--rounds", str(start.rounds)]
        words += [] if record is None else ["--record", str(record)]
        words += [word for setting in start.settings for word in ("--set", setting)]
        made = RobotProcess(start, words, record)
        self.every.append(made)
        self.at[start.place] = made
        return made

    def _configuration(self, start: Start, seat: Seat) -> str:
        """The configuration of a process: the proxy's addresses, but for its own."""
        devices = {}
        for pid in range(self.robots):
            port = seat.address[1] if pid == start.pid else seat.others[pid].getsockname()[1]
            devices[f"d{pid}"] = {"ip": "127.0.0.1", "port": port}
        network: dict[str, Any] = {"transport": "unicast", "key": start.key}
        if start.encrypts:
            network["encrypt"] = True
        if start.run is not None:
            network["run"] = start.run
        form = {
            "agents": [{"pid": pid, "on_device": f"d{pid}"} for pid in range(self.robots)],
            "devices": devices,
            "delta": start.delta_s,
            "leader_pid": start.leader,
            "network": network,
        }
        return msgspec.yaml.encode(form).decode()

    # --- conditions -----------------------------------------------------------------------------

    def until(
        self, condition: Callable[[], object], what: str, within_s: float = PATIENCE_S
    ) -> None:
        """Wait for a condition. Raises AssertionError if it does not come true in time."""
        end_s = time.monotonic() + within_s
        while not condition():
            assert time.monotonic() < end_s, f"not {what} within {within_s} s\n{self.story()}"
            time.sleep(0.02)

    def until_round(self, round_: int, *pids: int, within_s: float = PATIENCE_S) -> None:
        """Wait until robots (all that are there, if none is named) have acted on a round."""
        whose = [self[pid] for pid in pids] or list(self)
        what = f"past round {round_}"
        self.until(lambda: all(one.round > round_ for one in whose), what, within_s)

    def until_further(self, rounds: int, *pids: int, within_s: float = PATIENCE_S) -> None:
        """Wait until robots have done so many rounds more than the foremost has by now."""
        self.until_round(self.round + rounds - 1, *pids, within_s=within_s)

    @property
    def round(self) -> int:
        """The first round that no robot is known to have acted on."""
        return max((one.round for one in self.every), default=-1)

    def heard_at_s(self, *places: str) -> float:
        """When the last of these seats' processes first sent something. Waits for it."""
        self.until(lambda: all(map(self.is_heard, places)), "heard")
        return max(self._seats[place].heard_at_s or 0.0 for place in places)

    def is_heard(self, place: str) -> bool:
        """Whether the process of a seat has sent something."""
        return self._seats[place].heard_at_s is not None

    def until_said(self, one: RobotProcess, pattern: str, by_s: float) -> None:
        """Wait until a robot has said something, until some time (of the monotonic clock)."""
        left_s = max(0.0, by_s - time.monotonic())
        self.until(lambda: one.has_said(pattern), f"said by robot {one.pid}: {pattern}", left_s)

    def stop(self) -> None:
        """Interrupt all robots, and wait for their ends."""
        alive = [one for one in self if one.is_alive]
        for one in alive:
            one.signal(signal.SIGINT)
        for one in alive:
            one.end()

    def disagreements(self) -> list[str]:
        """What robots contradict each other in."""
        return disagreements((one.pid, one.recording) for one in self.every)

    def story(self) -> str:
        """What is known of all processes, for a test that fails."""
        told = []
        for one in self.every:
            how = "runs" if one.is_alive else f"ended with {one.process.returncode}"
            told.append(f"--- robot {one.pid} ({one.start.place}) {how}, status {one.status}")
            told += [f"{line.at_s - one.begun_s:7.2f} s  {line.text}" for line in one.lines]
            told += [one.out] if one.process.returncode == 2 else []
        return "\n".join(told)


def free_port() -> int:
    """A port of this machine that nobody listens on."""
    while True:
        port = _PORTS[secrets.randbelow(len(_PORTS))]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            try:
                one.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port
