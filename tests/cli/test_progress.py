from __future__ import annotations

import io
import os
import signal
import threading
import time

import pytest

from koord.cli import progress
from koord.cli.progress import Interruption, LiveLine


class Terminal(io.StringIO):
    """A terminal that lets a test wait for what is written."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def isatty(self) -> bool:
        return True

    def flush(self) -> None:
        if self.getvalue():
            self.written.set()


class Gone(Terminal):
    def write(self, text: str) -> int:
        self.written.set()
        raise BrokenPipeError


def clock() -> float:
    return 7.0


def test_the_line_is_written_and_wiped() -> None:
    stream = Terminal()
    with LiveLine(stream, clock=clock, tick_s=0.001) as line:
        line.show("bmc, round 3 of 20")
        assert stream.written.wait(10)
    assert "\r\x1b[Kbmc, round 3 of 20, 0.0 s" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[K")


def test_a_pipe_sees_nothing() -> None:
    stream = io.StringIO()
    with LiveLine(stream, tick_s=0.001) as line:
        line.show("working")
        time.sleep(0.02)
        line.clear()
    assert stream.getvalue() == ""
    with LiveLine(None) as line:
        line.show("working")


def test_a_short_run_shows_no_line() -> None:
    stream = Terminal()
    with LiveLine(stream, tick_s=60) as line:
        line.show("working")
    assert stream.getvalue() == ""


def test_the_line_never_wraps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    stream = Terminal()
    with LiveLine(stream, clock=clock, tick_s=0.001) as line:
        line.show("日" * 100)
        assert stream.written.wait(10)
    first = stream.getvalue().split("\r\x1b[K")[1]
    assert first.endswith("日, 0.0 s")
    assert 2 * first.count("日") + len(", 0.0 s") <= 39


def test_a_terminal_that_goes_away_does_not_stop_the_work() -> None:
    stream = Gone()
    with LiveLine(stream, tick_s=0.001) as line:
        line.show("working")
        assert stream.written.wait(10)
    assert stream.getvalue() == ""


def test_the_first_interrupt_asks_and_the_second_insists() -> None:
    before = signal.getsignal(signal.SIGINT)
    with Interruption() as interruption:
        asked = [interruption.requested]
        os.kill(os.getpid(), signal.SIGINT)
        asked.append(interruption.requested)
        assert asked == [False, True]
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def deaf_work() -> None:
    with Interruption():
        os.kill(os.getpid(), signal.SIGINT)
        while True:  # no signal.pause(): the alarm may come just before it
            pass


def test_an_interrupt_that_nobody_looks_at_insists_by_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(progress, "INSIST_S", 0.001)
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(KeyboardInterrupt):
        deaf_work()
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
