"""A forked process and the pipe that it sends through: two pages of what multiprocessing has.

Multiprocessing serves sockets, shared memory and processes that are not forked too, and loading it
takes a twentieth of a short verification.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
from collections.abc import Callable, Sequence
from typing import Final

#: The length of a message stands before it, in so many bytes.
_LENGTH: Final = 8

#: So much is read at once.
_AT_ONCE: Final = 2**20


class Sender:
    """The end of a pipe that a forked process sends through."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def fileno(self) -> int:
        return self._descriptor

    def send(self, message: object) -> None:
        """Send an object. Raises BrokenPipeError if nobody receives any more."""
        self.send_pickled(pickle.dumps(message))

    def send_pickled(self, data: bytes) -> None:
        """Send a pickled object."""
        left = memoryview(len(data).to_bytes(_LENGTH, "big") + data)
        while left:
            left = left[os.write(self._descriptor, left) :]

    def close(self) -> None:
        os.close(self._descriptor)


class Receiver:
    """The end of a pipe that the process that forked receives from."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._read = bytearray()

    def fileno(self) -> int:
        return self._descriptor

    def receive(self) -> object:
        """Wait for a message. Raises EOFError if there comes none, or a part of one.

        What interrupts it loses nothing: the next call goes on with what was read.
        """
        self._fill(_LENGTH)
        length = _LENGTH + int.from_bytes(self._read[:_LENGTH], "big")
        self._fill(length)
        message = bytes(self._read[_LENGTH:length])
        self._read.clear()
        return pickle.loads(message)

    def close(self) -> None:
        os.close(self._descriptor)

    def _fill(self, length: int) -> None:
        while len(self._read) < length:
            data = os.read(self._descriptor, min(_AT_ONCE, length - len(self._read)))
            if not data:
                raise EOFError
            self._read += data


class ForkedProcess:
    """A process that was forked from this one."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.exit_code: int | None = None  #: as subprocess has it: negative if a signal ended it

    def is_alive(self) -> bool:
        """Return whether it goes on."""
        self._wait(os.WNOHANG)
        return self.exit_code is None

    def send_signal(self, number: signal.Signals) -> None:
        """Send a signal, if it goes on."""
        if self.is_alive():
            os.kill(self.pid, number)

    def join(self) -> None:
        """Wait for its end."""
        self._wait(0)

    def _wait(self, options: int) -> None:
        if self.exit_code is not None:
            return
        try:
            pid, status = os.waitpid(self.pid, options)
        except ChildProcessError:  # somebody else has waited for all processes of this one
            self.exit_code = 0
            return
        if pid:
            self.exit_code = os.waitstatus_to_exitcode(status)


def fork(work: Callable[[Sender], object]) -> tuple[ForkedProcess, Receiver]:
    """Fork a process that works, and ends with its work; nothing that it raises leaves it.

    It ends at once, so that what this process had yet to write is not written twice.

    Raises OSError if there can be no more processes.
    """
    parted = part()
    if not isinstance(parted, Sender):
        return parted
    try:
        work(parted)
    finally:
        os.kill(os.getpid(), signal.SIGKILL)  # at once, and whatever it raised
    raise AssertionError("it has ended")


def part() -> tuple[ForkedProcess, Receiver] | Sender:
    """Fork a process that goes on where this one is; there, return what it sends through.

    Whoever goes on there has to end the process where its work ends, whatever that raises.

    Raises OSError if there can be no more processes.
    """
    receives, sends = os.pipe()
    try:
        pid = os.fork()
    except OSError:
        os.close(receives)
        os.close(sends)
        raise
    if pid == 0:
        os.close(receives)
        _without_input()
        return Sender(sends)
    os.close(sends)
    return ForkedProcess(pid), Receiver(receives)


def _without_input() -> None:
    """Read nothing, neither here nor in what is started from here: input is the first process's."""
    with contextlib.suppress(OSError):
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        os.close(nothing)


def ready(receivers: Sequence[Receiver], wait_s: float) -> list[Receiver]:
    """The receivers for which there is a message, or an end; wait for one for so many seconds."""
    poll = select.poll()
    by_descriptor = {receiver.fileno(): receiver for receiver in receivers}
    for descriptor in by_descriptor:
        poll.register(descriptor, select.POLLIN)
    return [by_descriptor[descriptor] for descriptor, _ in poll.poll(wait_s * 1000)]
