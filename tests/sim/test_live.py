"""The page of a run that goes on."""

from __future__ import annotations

import base64
import http.client
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Protocol

import numpy as np
import pytest

from koord.sim.run_log import RunLogger
from koord.sim.viewing import Live
from tests.sim.browser import browser, in_a_browser
from tests.sim.test_page import header
from tests.sim.unpacking import Unpacked, unpacked


@pytest.fixture
def recorder() -> RunLogger:
    return RunLogger(header(2))


@pytest.fixture
def live(recorder: RunLogger) -> Iterator[Live]:
    with Live(recorder.recording) as live:
        yield live


def more(recorder: RunLogger, first: int, count: int) -> None:
    """So many more rounds, with a sample each."""
    for k in range(first, first + count):
        recorder.sample(0.1 * k, np.array([[0.1 * k, 1, 0], [2, 2, 1]]), np.zeros(2))
        recorder.round(k, 0.1 * k, np.array([0, -1], np.int16))


class Ask(Protocol):
    """Asks a server for a path, as if it had a name."""

    def __call__(self, path: str, host: str | None = None) -> http.client.HTTPResponse: ...


@pytest.fixture
def ask(live: Live) -> Iterator[Ask]:
    port = int(live.address.rstrip("/").rpartition(":")[2])
    with ExitStack() as stack:

        def ask(path: str, host: str | None = None) -> http.client.HTTPResponse:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
            stack.callback(connection.close)
            connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{port}"})
            return stack.enter_context(connection.getresponse())

        yield ask


def next_pack(answer: http.client.HTTPResponse) -> bytes:
    assert answer.readline() == b"event: pack\n"
    data = answer.readline()
    assert data.startswith(b"data: ")
    assert answer.readline() == b"\n"
    return base64.b64decode(data[6:])


def test_the_page_is_served_to_this_machine_alone(live: Live, ask: Ask) -> None:
    assert live.address.startswith("http://127.0.0.1:")
    page = ask("/").read().decode()
    assert "EventSource" in page
    assert 'id="data"></script>' in page
    assert ask("/", host="evil.example:80").status == 403
    assert ask("/etc/passwd").status == 404


def test_browsers_that_break_off_are_nobodys_mistake(
    live: Live, ask: Ask, capsys: pytest.CaptureFixture[str]
) -> None:
    port = int(live.address.rstrip("/").rpartition(":")[2])
    reset = struct.pack("ii", 1, 0)  # no good-bye: the connection is reset
    for said in (b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: localhost:1\r\n\r\n", b"\xff" * 99):
        with socket.create_connection(("127.0.0.1", port)) as one:
            one.sendall(said)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset)
    try:
        raise ConnectionResetError
    except ConnectionResetError:
        live._server.handle_error(None, None)
    assert ask("/").status == 200
    assert capsys.readouterr().err == ""


def test_what_is_new_comes_in_packs(live: Live, recorder: RunLogger, ask: Ask) -> None:
    more(recorder, 0, 3)
    answer = ask("/packs")
    first = unpacked(next_pack(answer))
    assert first.document["header"]["program"] == "a.krd"
    found = [first]
    assert len(found[0].times_s) == 3
    more(recorder, 3, 2)
    recorder.end("time is up")
    while found[-1].document["ending"] is None:
        found.append(unpacked(next_pack(answer), first.document["header"]))
    assert answer.readline() == b""  # nothing comes after the end
    assert times(found) == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    live.wait_for_watchers(20)


def test_who_comes_late_gets_all_of_it(recorder: RunLogger, ask: Ask) -> None:
    more(recorder, 0, 4)
    recorder.end("time is up")
    for _ in range(2):
        pack = unpacked(next_pack(ask("/packs")))
        assert len(pack.times_s) == 4


def test_the_end_waits_for_who_watches(live: Live, recorder: RunLogger, ask: Ask) -> None:
    more(recorder, 0, 1)
    answer = ask("/packs")
    next_pack(answer)
    over = threading.Event()

    def wait() -> None:
        live.wait_for_watchers(20)
        over.set()

    threading.Thread(target=wait, daemon=True).start()
    assert not over.is_set()
    recorder.end("time is up")
    next_pack(answer)
    assert over.wait(20)


@in_a_browser
def test_the_page_grows_with_the_run(live: Live, recorder: RunLogger) -> None:
    more(recorder, 0, 2)
    with browser() as tab:
        tab.open(live.address)
        assert tab.ask("page.run.duration") == pytest.approx(0.1)
        assert tab.ask("byId('live').classList.contains('on')") is True
        more(recorder, 2, 8)
        tab.until("page.run.duration > 0.85")
        tab.until("page.time > 0.85")  # it follows
        recorder.end("time is up")
        tab.until("byId('live-word').textContent === 'over'")
        assert "time is up" in tab.ask("byId('facts').textContent")
        tab.press("Home")
        assert tab.ask("page.time") == 0
        strange = [one for one in tab.complaints if live.address not in one]
        assert strange == []


def times(packs: list[Unpacked]) -> list[float]:
    return [float(time_s) for pack in packs for time_s in pack.times_s]
