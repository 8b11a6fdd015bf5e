"""Robots' processes that are forked from one that has loaded koord: they start at once.

To load what a robot needs takes most of a second of CPU. Where a hundred processes are started,
some of them while others keep to rounds of 50 ms, that is most of the time, and delays the others.
``python -m tests.deployed.starting DESCRIPTOR`` is the process that they are forked from. For each
of them it forks one more, which waits for its end and tells of it.
"""

from __future__ import annotations

import atexit
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import IO

import msgspec

from koord.cli.main import entry, main

#: A process' id, and then how it ended, as :attr:`subprocess.Popen.returncode` says it.
_NUMBER = struct.Struct("<i")

#: More than the words of a command take.
_MOST_WORDS = 1 << 16


class ForkedProcess:
    """A process as :class:`subprocess.Popen` gives it, as far as fleets need that."""

    def __init__(self, told: int, stdout: IO[str], stderr: IO[str]) -> None:
        self.stdout, self.stderr = stdout, stderr
        self.returncode: int | None = None
        self._told = told
        self.pid = self._next()

    def _next(self) -> int:
        return int(_NUMBER.unpack(os.read(self._told, _NUMBER.size))[0])

    def poll(self) -> int | None:
        """How it ended, if it has."""
        return self._ended(0.0)

    def wait(self, timeout: float) -> int:
        """How it ended. Raises TimeoutExpired."""
        code = self._ended(timeout)
        if code is None:
            raise subprocess.TimeoutExpired(f"robot {self.pid}", timeout)
        return code

    def _ended(self, within_s: float) -> int | None:
        if self.returncode is None and select.select([self._told], [], [], within_s)[0]:
            self.returncode = self._next()
            os.close(self._told)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class Starter:
    """The process that others are forked from."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._line, other = socket.socketpair()
        for one in (self._line, other):
            # rospy gives all new sockets of this process a timeout, and they would not block there.
            one.setblocking(True)
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, str(other.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=environment,
            pass_fds=[other.fileno()],
            start_new_session=True,
        )
        other.close()
        atexit.register(self.close)

    def start(self, words: Sequence[str]) -> ForkedProcess:
        """Start `koord WORDS` in a process of its own."""
        pipes = [os.pipe() for _ in range(3)]
        socket.send_fds(self._line, [msgspec.json.encode(words)], [write for _, write in pipes])
        for _, write in pipes:
            os.close(write)
        out, err, told = (read for read, _ in pipes)
        return ForkedProcess(told, open(out, encoding="utf-8"), open(err, encoding="utf-8"))

    def close(self) -> None:
        self._line.close()
        self._process.wait()


@cache
def starter(**environment: str) -> Starter:
    """The one of this process, with these variables in its environment."""
    return Starter({**os.environ, **environment})


# --- in the process itself ------------------------------------------------------------------------


def _load() -> None:
    """Load all that robots load: let one that is alone run a round."""
    with (
        tempfile.TemporaryDirectory() as name,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
    ):
        one.bind(("127.0.0.1", 0))
        folder, port = Path(name), one.getsockname()[1]
        one.close()
        network = {"transport": "unicast", "key": "known to nobody else"}
        form = {
            "agents": [{"pid": 0, "on_device": "d"}],
            "devices": {"d": {"ip": "127.0.0.1", "port": port}},
            "delta": 0.01,
            "network": network,
        }
        config = folder / "c.yaml"
        config.write_bytes(msgspec.yaml.encode(form))
        config.chmod(0o600)
        words = ["deploy", str(Path(__file__).parent / "ledger.krd"), str(config), "--pid", "0"]
        words += ["--json", "--rounds", "1", "--state", str(folder / "state")]
        words += ["--record", str(folder / "r.mcap"), "--trace", str(folder / "r.jsonl")]
        assert main(words) == 0
    assert threading.active_count() == 1, "no process is forked from one with threads"


def _forked(words: Sequence[str], out: int, err: int, told: int) -> None:
    """Become a process that runs `koord WORDS`, and one that tells how it ends."""
    robot = os.fork()
    if robot:
        os.close(out)
        os.close(err)
        os.write(told, _NUMBER.pack(robot))
        code = os.waitstatus_to_exitcode(os.waitpid(robot, 0)[1])
        os.write(told, _NUMBER.pack(code))
        os._exit(0)
    os.setsid()
    os.dup2(out, 1)
    os.dup2(err, 2)
    for one in (out, err, told):
        os.close(one)
    sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)
    sys.argv[1:] = words
    entry()


def _serve(line: socket.socket) -> None:
    """Fork what is asked for, until nobody can ask any more."""
    waiting: set[int] = set()
    while True:
        message, files, _, _ = socket.recv_fds(line, _MOST_WORDS, 3)
        waiting -= {one for one in waiting if os.waitpid(one, os.WNOHANG)[0]}
        if not message:
            break
        made = os.fork()
        if made == 0:
            line.close()
            _forked(msgspec.json.decode(message, type=list[str]), *files)
        waiting.add(made)
        for one in files:
            os.close(one)
    for one in waiting:
        os.waitpid(one, 0)


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as asked:
        _load()
        _serve(asked)
