"""The built playground in a headless Chromium, with its worker and its solvers."""

from __future__ import annotations

import functools
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from playground import __main__ as building
from tests.sim.browser import BROWSER, Tab, browser

pytestmark = pytest.mark.slow

#: A program with one mistake, in its second line.
WRONG = "local:\n    int x = treu\n\nGo:\n    pre: x < 3\n    eff: x = x + 1\n"

#: How long a machine may take that does other things as well.
PATIENCE_S = 180.0


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a browser that goes on before it has heard everything."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a folder of files."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The playground, built and served."""
    folder = tmp_path_factory.mktemp("playground")
    try:
        building.build(folder)
    except building.NotHereError as error:
        pytest.skip(f"the playground cannot be built here: {error}")
    with served(folder) as found:
        yield found


@pytest.fixture(scope="module")
def opened(address: str) -> Iterator[Tab]:
    """A browser."""
    if BROWSER is None:
        pytest.skip("there is no Chromium")
    with browser(own=address) as found:
        found.open(address, "true")
        yield found


@pytest.fixture
def tab(opened: Tab, address: str) -> Iterator[Tab]:
    """The page as who comes to it first sees it, with koord ready in its worker."""
    opened.ask("localStorage.clear()")
    opened.complaints.clear()
    opened.open("about:blank", "true")
    opened.open(address, "Boolean(window.playground)")
    until(opened, "byId('state').textContent === 'ready'")
    yield opened
    assert opened.complaints == []


def until(tab: Tab, condition: str) -> None:
    """Wait for what may take the solvers long."""
    end = time.monotonic() + PATIENCE_S
    while not tab.ask(condition):
        state = tab.ask("byId('state').textContent")
        assert time.monotonic() < end, f"not in time: {condition}; {state}; {tab.complaints}"
        assert "failed" not in state, state


def choose(tab: Tab, example: str) -> None:
    tab.ask(
        f"byId('example').value = {example!r}; byId('example').dispatchEvent(new Event('change'))"
    )


def press(tab: Tab, button: str) -> None:
    """Press a button, and wait for the answer."""
    tab.ask(f"playground.last = null; byId({button!r}).click()")
    until(tab, "playground.last !== null")


def about(tab: Tab) -> str:
    return str(tab.ask("byId('about').textContent"))


def test_programs_are_checked_verified_and_run(tab: Tab) -> None:
    assert tab.ask("byId('text').value").startswith("# ")  # an example is there from the start
    press(tab, "check")
    assert about(tab).startswith("✓ no mistakes found")

    choose(tab, "task")
    press(tab, "verify")
    assert about(tab).startswith("✓ holds, every claim")
    assert tab.ask("document.querySelectorAll('#gutter .holds').length") >= 6
    tab.shown_frame("byId('content').textContent.includes('Exclusive')")

    choose(tab, "leader_elect_early")
    press(tab, "verify")
    assert about(tab).startswith("✗ violated: Agree")
    line = tab.ask("document.querySelector('#gutter .violated').parentElement.innerText")
    assert (
        tab.ask("byId('text').value")
        .splitlines()[int(line.split()[-1]) - 1]
        .startswith("invariant Agree")
    )
    shown = tab.shown_frame("Boolean(document.querySelector('a.look'))")
    tab.ask("document.querySelector('a.look').click()", session=shown)
    tab.until("Boolean(document.querySelector('.turns li'))", session=shown)
    assert "Decide" in tab.ask("document.querySelector('.turns').textContent", session=shown)
    assert "Agree" in tab.ask("document.querySelector('.banner').textContent", session=shown)

    choose(tab, "leader_elect")
    tab.ask("byId('rounds').value = '3'")
    press(tab, "run")
    assert about(tab).startswith("✓ ")
    tab.shown_frame("byId('clock').textContent.includes('start') && page.view !== null")


def test_mistakes_are_shown_where_they_are_while_typing(tab: Tab) -> None:
    tab.ask("byId('text').focus(); byId('text').select()")
    tab.call("Input.insertText", text=WRONG)
    until(tab, "byId('problems').children.length === 1")
    assert "K201" in tab.ask("byId('problems').textContent")
    assert tab.ask("document.querySelector('#layer .wrong').textContent") == "treu"
    assert tab.ask("document.querySelector('#gutter .error').parentElement.innerText").endswith("2")
    tab.ask("document.querySelector('#problems button').click()")
    assert tab.ask("byId('text').selectionStart") == len("local:\n    int x = ")
    tab.ask("byId('robots').value = 'lots'")
    press(tab, "verify")
    assert about(tab).startswith("✗ ")


def test_what_takes_long_can_be_cancelled_and_koord_begins_again(tab: Tab) -> None:
    choose(tab, "allstop")
    tab.ask("byId('robots').value = '12'")
    tab.ask("byId('verify').click()")
    until(tab, "byId('state').textContent.startsWith('verify: ')")
    assert tab.ask("byId('verify').disabled")
    tab.ask("byId('cancel').click()")
    assert "cancelled" in tab.ask("byId('state').textContent")
    until(tab, "byId('state').textContent === 'ready'")
    assert not tab.ask("byId('verify').disabled")
    choose(tab, "leader_elect_early")
    tab.ask("byId('robots').value = ''")
    press(tab, "verify")
    assert about(tab).startswith("✗ violated: Agree")


def test_a_link_carries_the_program(tab: Tab, address: str) -> None:
    text = "# Zwölf ≤ ∀ 🤖\nlocal:\n    int x = 0\n\nGo:\n    pre: x < 3\n    eff: x = x + 1\n"
    settings = {"robots": "4", "rounds": "7", "params": "most=[1, 2]", "policy": "random"}
    tab.ask(f"playground.put({json.dumps(text)}, {json.dumps({**settings, 'seed': '5'})})")
    tab.ask("playground.link()")
    found = tab.ask("location.href")
    assert found.startswith(address)
    assert len(found) < len(address) + 200
    tab.ask("localStorage.clear()")
    tab.open("about:blank", "true")
    tab.open(found, "Boolean(window.playground)")
    asked = tab.ask("playground.asked")
    assert asked == {"text": text, **settings, "rounds": 7, "seed": 5}
    assert tab.ask("byId('more').classList.contains('set')")

    tab.open("about:blank", "true")
    tab.open(f"{address}#program=nothing", "Boolean(window.playground)")
    assert "holds no program" in tab.ask("byId('state').textContent")


def test_a_text_is_there_again_after_the_page_was_loaded_anew(tab: Tab, address: str) -> None:
    tab.ask("byId('text').focus(); byId('text').select()")
    tab.call("Input.insertText", text="local:\n    int mine = 1\n")
    tab.open("about:blank", "true")
    tab.open(address, "Boolean(window.playground)")
    assert tab.ask("byId('text').value") == "local:\n    int mine = 1\n"
