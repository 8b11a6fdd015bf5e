"""Forked processes: what they send comes whole, and nothing else leaves them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from textwrap import dedent

import pytest

from koord.verify.forked import Receiver, Sender, fork, ready
from koord.verify.processes import can_fork
from tests.children import forked_children

pytestmark = pytest.mark.skipif(not can_fork(), reason="one process only")


@pytest.fixture(autouse=True)
def nobody_is_left() -> Iterator[None]:
    yield
    assert forked_children() == set()


@pytest.mark.parametrize("length", [0, 1, 70_000, 3_000_000])
def test_messages_come_whole_and_in_order(length: int) -> None:
    def work(sends: Sender) -> None:
        sends.send(b"x" * length)
        sends.send("second")
        os._exit(0)

    process, receives = fork(work)
    assert receives.receive() == b"x" * length
    assert receives.receive() == "second"
    with pytest.raises(EOFError):
        receives.receive()
    process.join()
    assert process.exit_code == 0
    receives.close()


def test_what_interrupts_a_receiver_loses_nothing() -> None:
    read, write = os.pipe()
    receives, data = Receiver(read), b"\0" * 7 + b"\5" + b"\x80\x04K\x07."
    os.set_blocking(read, False)
    for part in (data[:3], data[3:10]):
        os.write(write, part)
        with pytest.raises(BlockingIOError):
            receives.receive()
    os.write(write, data[10:])
    assert receives.receive() == 7
    receives.close()
    os.close(write)


def test_a_part_of_a_message_is_none() -> None:
    def work(sends: Sender) -> None:
        os.write(sends.fileno(), b"\0\0\0\0\0\0\0\x09half")
        os._exit(0)

    process, receives = fork(work)
    with pytest.raises(EOFError):
        receives.receive()
    process.join()
    receives.close()


def test_ready_are_those_with_messages_or_ends() -> None:
    def speaks(sends: Sender) -> None:
        sends.send("here")
        signal.pause()

    def waits(sends: Sender) -> None:
        signal.pause()

    one, first = fork(speaks)
    other, second = fork(waits)
    assert ready([first, second], 60.0) == [first]
    assert first.receive() == "here"
    assert ready([first, second], 0) == []
    other.send_signal(signal.SIGKILL)
    assert ready([first, second], 60.0) == [second]
    one.send_signal(signal.SIGKILL)
    for process, receives in ((one, first), (other, second)):
        process.join()
        assert process.exit_code == -signal.SIGKILL
        assert not process.is_alive()
        process.send_signal(signal.SIGINT)  # nobody hears it, whoever has the number by now
        receives.close()


def test_who_was_waited_for_by_others_has_ended() -> None:
    process, receives = fork(lambda sends: os._exit(3))
    os.waitpid(process.pid, 0)
    assert not process.is_alive()
    process.join()
    receives.close()


def test_nothing_else_leaves_a_process() -> None:
    """Neither what was to be written, nor what it raises; and it reads nothing."""
    program = """
        import os, sys
        from koord.verify.forked import fork
        def work(sends):
            sends.send(sys.stdin.read())
            sys.stdout.write("of the other")
            raise SystemExit(5)
        sys.stdout.write("once")
        process, receives = fork(work)
        assert receives.receive() == ""
        process.join()
        assert process.exit_code == -9
        assert sys.stdin.read() == "for the first"
    """
    done = subprocess.run(
        [sys.executable, "-c", dedent(program)],
        input="for the first",
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONUNBUFFERED": ""},
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "once", "")
