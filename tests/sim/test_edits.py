"""Runs whose program is edited: what recordings, files and pages say of it. [RELOAD]"""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from koord.api.edits import ListedEdits
from koord.api.fitting import fit, fit_request
from koord.api.sim_run import SimulationRequest
from koord.api.simulation import simulate_fitted
from koord.sim.files.mcap import PartRecord, mcap_of
from koord.sim.packing import pack
from koord.sim.run_log import LogSizes, RunLog, reload_words
from koord.sim.viewing import page_of
from koord.syntax.source import Source
from tests.sim.browser import Tab, in_a_browser, one_tab
from tests.sim.test_page import shown_text
from tests.sim.unpacking import data_of, unpacked

FIRST = """\
local:
    int own = 0

allwrite:
    int total = 0

Count:
    pre: own < 1000
    eff:
        own = own + 1
        atomic:
            total = total + 1
"""

#: `Rest` stands before `Count`, `total` is of another type, `own` is gone, and there is `more`.
SECOND = """\
local:
    int more = 5

allwrite:
    float total = 0.5

Rest:
    pre: more > 7
    eff: more = 0

Count:
    pre: more < 8
    eff:
        more = more + 1
        atomic:
            total = total + 1.0
"""

WRONG = FIRST.replace("total + 1", "totla + 1")


@pytest.fixture(scope="module")
def recording() -> RunLog:
    """Twelve rounds of two robots, edited before the fourth, and wrongly before the eighth."""
    request = fit_request(Source("edited.krd", FIRST), None, None, 2, 1, None)
    edits = ListedEdits(request, [(4, SECOND), (8, WRONG)])
    return simulate_fitted(fit(request), SimulationRequest(12, edits=edits)).recording


def part_of(recording: RunLog, rounds: int, reloads: int) -> LogSizes:
    """A point of a recording; times are those of the rounds."""
    times = sum(time_s <= 0.1 * rounds for time_s in recording.times_s)
    return LogSizes(times, rounds, reloads=reloads)


def test_a_recording_has_the_edits_and_their_reasons(recording: RunLog) -> None:
    changed, refused = recording.reloads
    assert (changed.number, changed.text, refused.number, refused.text) == (4, SECOND, 8, None)
    assert changed.time_s == pytest.approx(4 * recording.header.delta_s)
    assert reload_words(changed) == (
        "the program has changed; total is of another type and starts anew; "
        "more is new and starts; own is gone"
    )
    assert reload_words(refused).startswith("the edited program is refused")
    assert "totla" in reload_words(refused)
    assert recording.header.text == FIRST
    (agent,) = recording.header.agents
    assert agent.events == ("Count", "Rest")
    assert [one.name for one in agent.variables] == ["own", "more"]
    assert (changed.had.agents, changed.has.agents) == (((0,),), ((1,),))
    assert (refused.had, refused.has) == (changed.has, changed.has)


def messages(raw: bytes, topic: str) -> list[dict[str, Any]]:
    found = make_reader(io.BytesIO(raw)).iter_messages(topics=[topic])
    return [json.loads(message.data) for _, _, message in found]


def test_files_for_other_tools_say_where_the_program_changed(recording: RunLog) -> None:
    whole = mcap_of(recording)
    programs = messages(whole, "/program")
    assert [(one["round"], one["accepted"], one.get("text")) for one in programs] == [
        (4, True, SECOND),
        (8, False, None),
    ]
    names = {change["variable"] for m in messages(whole, "/local") for change in m["changes"]}
    assert names == {"own", "more"}
    ran = {one["event"] for done in messages(whole, "/rounds") for one in done["ran"]}
    assert ran == {"Count", "Rest"}


def test_a_file_that_grows_has_the_same(recording: RunLog) -> None:
    before = fit_request(Source("edited.krd", FIRST), None, None, 2, 1, None)
    begun = simulate_fitted(fit(before), SimulationRequest(3)).recording
    raw = io.BytesIO()
    part = PartRecord(begun, raw)
    part.grow()
    # The run goes on: of the same recording, as it is later.
    begun.header, begun.reloads, begun.rounds = (
        recording.header,
        recording.reloads,
        recording.rounds,
    )
    part.grow()
    assert [one["accepted"] for one in messages(raw.getvalue(), "/program")] == [True, False]
    ran = {one["event"] for done in messages(raw.getvalue(), "/rounds") for one in done["ran"]}
    assert ran == {"Count", "Rest"}


def test_packs_say_what_there_is_from_then_on(recording: RunLog) -> None:
    changed, refused = unpacked(data_of(page_of(recording))).document["reloads"]
    assert (changed["round"], changed["text"], refused["text"]) == (4, SECOND, None)
    assert changed["has"] == [[1], [[1]]]
    assert [one["name"] for one in changed["shared"]] == ["total", "total"]


# --- in a browser ---------------------------------------------------------------------------------


tab = pytest.fixture(scope="module")(one_tab)


def check_page(tab: Tab) -> None:
    """The page shows each program in its time, and tells of edits."""
    tab.ask("page.choose(0), page.panels.show('Robot'), page.seek(0.25)")
    pane = shown_text(tab, "pane")
    assert "own" in pane
    assert "more" not in pane
    tab.ask("page.panels.show('Program')")
    assert "total = total + 1\n" in shown_text(tab, "pane") + "\n"
    assert tab.ask("byId('toast').hidden") is True
    tab.ask("page.seek(0.6), page.panels.show('Robot')")
    pane = shown_text(tab, "pane")
    assert "more" in pane
    assert "own" not in pane
    assert "program changed total is of another type" in shown_text(tab, "toast")
    tab.ask("page.panels.show('Shared')")
    assert shown_text(tab, "pane").count("total") == 1
    tab.ask("page.panels.show('Program')")
    assert "float total = 0.5" in shown_text(tab, "pane")
    tab.ask("page.seek(0.9), page.panels.show('Log')")
    log = shown_text(tab, "pane")
    assert "✎ edit refused" in log
    assert "✎ program changed" in log
    assert "edit refused" in shown_text(tab, "toast")
    assert "Rest" in tab.ask("byId('events').textContent")
    assert tab.complaints == []


@in_a_browser
def test_the_page_shows_each_program_in_its_time(
    tab: Tab, tmp_path: Path, recording: RunLog
) -> None:
    path = tmp_path / "run.html"
    path.write_bytes(page_of(recording))
    tab.open(path.as_uri())
    check_page(tab)


@in_a_browser
def test_so_does_a_page_to_which_the_edits_come(
    tab: Tab, tmp_path: Path, recording: RunLog
) -> None:
    request = fit_request(Source("edited.krd", FIRST), None, None, 2, 1, None)
    begun = simulate_fitted(fit(request), SimulationRequest(3)).recording
    path = tmp_path / "begun.html"
    begun.ending = None
    path.write_bytes(page_of(begun.since(LogSizes())))
    tab.open(path.as_uri())
    more = base64.b64encode(pack(recording, begun.sizes, recording.sizes)).decode()
    tab.ask(f"page.grow(unpacked(fromBase64('{more}')))")
    check_page(tab)
    tab.ask("page.panels.show('Plot')")
    assert "more" in tab.ask("page.panels.plot.select.textContent")
