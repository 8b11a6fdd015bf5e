"""Pages of stories: complete in themselves, and what they do in a browser."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import koord
from koord.api.story_page import framed
from koord.syntax.source import Source
from tests.loading import EXAMPLES
from tests.sim.browser import Tab, in_a_browser, one_tab

BROKEN = EXAMPLES / "broken"

LIVE = """\
allwrite:
    int turn = 0
Pass:
    pre: turn == pid
    eff: atomic: turn = (turn + 1) % numAgents
invariant Here: turn >= 0
eventually Far: turn > 7
"""


def data_of(page: str) -> dict[str, Any]:
    """What a page shows."""
    (found,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    data: dict[str, Any] = json.loads(found)
    return data


@pytest.fixture(scope="module")
def early() -> koord.VerifyReport:
    return koord.verify(BROKEN / "leader_elect_early.krd", jobs=1)


def test_a_page_loads_nothing_and_holds_all(early: koord.VerifyReport) -> None:
    page = koord.html(early)
    assert not re.findall(r"(?:src|href)=[\"']?(?:https?:|//)|url\(|@import|fetch\(", page)
    assert "default-src 'none'" in page
    shown = data_of(page)
    assert [c["claim"]["name"] for c in shown["verifications"][0]["claims"]] == [
        "Agree",
        "no fault",
    ]
    assert [story["title"] for story in shown["stories"]] == ["Agree"]
    assert shown["verifications"][0]["claims"][0]["stories"] == [0]
    for story in shown["stories"]:
        jsonschema.validate(story, koord.schema("story"))


@pytest.mark.parametrize("evil", ["</script><script>x()</script>", "<!--<script>", "{{style}}"])
def test_texts_cannot_leave_their_place(evil: str) -> None:
    text = f"# {evil}\nlocal:\n    int x = 0\nGo:\n    pre: true\n    eff: x = x + 1\n"
    text += "invariant Low: x < 2\n"
    page = koord.html(koord.verify(Source(f"{evil}.krd", text), robots=1, jobs=1))
    assert page.count("<script") == 2
    assert data_of(page)["stories"][0]["texts"][0]["text"] == text


def test_a_verdict_a_trace_a_run_and_a_replay_have_stories(early: koord.VerifyReport) -> None:
    verdict = early.verdict("Agree")
    told = koord.story(verdict)
    assert "in round 3, as robot 1 runs Decide" in told.headline
    assert told.told.ending.detail == "Agree is false for i = 0, j = 1"
    assert told.told.ending.notes == ["the compiled program does the same, state for state"]
    trace = verdict.counterexample
    assert trace is not None
    assert koord.story(trace).told.moments == told.told.moments
    assert koord.story(koord.replay(trace)).told.moments == told.told.moments
    assert data_of(koord.html(verdict))["stories"] == [told.to_dict()]
    assert "<iframe" in told._repr_html_()
    run = koord.run(EXAMPLES / "leader_elect.krd", rounds=4)
    assert koord.story(run).told.ending.kind == "done"
    with pytest.raises(koord.ArgumentError, match="no counterexample"):
        koord.story(early.verdict("no fault"))


def test_loops_say_why_they_are_fair() -> None:
    report = koord.verify(Source("live.krd", LIVE), robots=2, jobs=1)
    loop = koord.story(report.verdict("Far")).told.loop
    assert loop is not None
    assert any("runs Pass" in line for line in loop.fair)


STALE = """\
local:
    int x = 0
    int y = 0
Go:
    pre: true
    eff:
        y = y + x
        x = x + 1
invariant Low: forall i: y@i < 7
"""


def test_a_step_that_no_proof_gets_over_is_told() -> None:
    report = koord.verify(
        Source("stale.krd", STALE), robots=2, rounds=2, engine="induction", jobs=1
    )
    shown = data_of(koord.html(report))
    low = next(c for c in shown["verifications"][0]["claims"] if c["claim"]["name"] == "Low")
    assert low["claim"]["outcome"] != "violated"
    (position,) = low["stories"]
    story = shown["stories"][position]
    jsonschema.validate(story, koord.schema("story"))
    assert story["ending"]["kind"] == "step"
    (track,) = story["tracks"]
    assert (track["truth"][0], track["truth"][-1]) == (True, False)
    assert set(track["truth"][1:-1]) == {None}
    values = {(row["name"], row["robot"]): row["start"] for row in story["rows"]}
    last = story["moments"][-1]
    changed = {
        (story["rows"][c["row"]]["name"], story["rows"][c["row"]]["robot"]) for c in last["changes"]
    }
    ran = [m["robot"] for m in story["moments"] if m["event"] is not None]
    for robot in ran:
        x, y = int(values["x", robot]), int(values["y", robot])
        new = {
            story["rows"][c["row"]]["name"]: int(c["value"])
            for c in last["changes"]
            if story["rows"][c["row"]]["robot"] == robot
        }
        assert new.get("x", x) == x + 1
        assert new.get("y", y) == y + x
    assert {robot for _, robot in changed} <= set(ran)


# --- in a browser ---------------------------------------------------------------------------------

tab = pytest.fixture(scope="module")(one_tab)


@pytest.fixture
def opened(tab: Tab, tmp_path: Path, early: koord.VerifyReport) -> Iterator[Tab]:
    """The page of a verification; nothing may complain of it."""
    path = tmp_path / "early.html"
    path.write_text(koord.html(early), encoding="utf-8")
    tab.complaints.clear()
    tab.call("Page.navigate", url="about:blank")
    tab.open(path.as_uri())
    yield tab
    assert tab.complaints == []


def text_of(tab: Tab, selector: str) -> str:
    found: str = tab.ask(f"document.querySelector({json.dumps(selector)})?.textContent ?? ''")
    return found


def position(tab: Tab) -> int:
    found: int = tab.ask("page.view.position")
    return found


@in_a_browser
def test_verdicts_lead_to_their_runs_and_back(opened: Tab) -> None:
    assert "1 of 2 claims" in text_of(opened, ".summary")
    assert "violated in round 3" in text_of(opened, ".claims")
    assert "holds for every N, in every round" in text_of(opened, ".claims")
    opened.ask("document.querySelector('.look').click()")
    opened.until("page.view !== null")
    assert "Agree does not hold, in round 3" in text_of(opened, ".banner")
    # To the content of what is shown, not back to the verdicts.
    jump = "addEventListener('hashchange', () => setTimeout(done)); document.querySelector('.jump')"
    opened.ask(f"new Promise((done) => {{ {jump}.click(); }})")
    assert "Agree does not hold, in round 3" in text_of(opened, ".banner")
    assert opened.ask("page.view !== null") is True
    opened.press("Escape")
    opened.until("page.view === null")
    assert text_of(opened, ".claims")


@in_a_browser
def test_verdicts_lead_to_their_runs_in_a_frame_too(
    opened: Tab, tmp_path: Path, early: koord.VerifyReport
) -> None:
    """As notebooks and the playground show it: links there lead to the page around the frame."""
    outer = tmp_path / "outer.html"
    outer.write_text(framed(koord.html(early), "a verification"), encoding="utf-8")
    opened.open(outer.as_uri(), "Boolean(document.querySelector('iframe'))")
    frame = opened.shown_frame()
    opened.ask("document.querySelector('.look').click()", session=frame)
    opened.until("page.view !== null", session=frame)
    assert opened.ask("location.hash", session=frame) == "#story=0"


@in_a_browser
def test_keys_step_through_turns_and_rounds(opened: Tab) -> None:
    opened.ask("page.open(0)")
    breaking = opened.ask("page.shown.stories[0].ending.moment")
    assert position(opened) == breaking
    opened.press("Home")
    assert (position(opened), text_of(opened, "#clock")) == (0, "the start")
    opened.press("ArrowRight")
    assert position(opened) == 1
    assert "round 1 of 3" in text_of(opened, "#clock")
    opened.press("ArrowRight", shift=True)
    assert opened.ask("page.view.telling.moments[page.view.position].rule") == "ENV-TRANS"
    opened.press("ArrowLeft")
    opened.press("ArrowLeft")
    assert position(opened) == 2
    opened.press("b")
    assert position(opened) == breaking
    opened.press("End")
    assert position(opened) == opened.ask("page.view.telling.moments.length - 1")
    opened.press("?")
    assert opened.ask("byId('keys').open") is True
    opened.ask("byId('keys').close()")
    light = opened.ask("theme('--panel')")
    opened.press("d")
    assert opened.ask("theme('--panel')") != light


@in_a_browser
def test_lanes_turns_values_and_formula_are_those_of_the_turn(opened: Tab) -> None:
    opened.ask("page.open(0), page.toBreak()")
    assert "Decide" in text_of(opened, ".turn.current.breaks")
    assert "leader -1 → 1" in text_of(opened, ".turns .current")
    assert text_of(opened, ".tree .value") == "✗ false"
    assert opened.ask("[...document.querySelectorAll('.turn.blocked')].length") == 3
    opened.ask("page.view.parts[4].show(1)")
    assert "leader1" in opened.ask(
        "[...document.querySelectorAll('.values tr.changed')].map((row) => row.textContent).join()"
    )
    opened.ask("page.go(0)")
    assert text_of(opened, ".tree .value") == "✓ true"
    opened.ask("page.view.parts[4].show(0), page.go(1)")
    assert text_of(opened, ".code .runs") == "Vote:"
    assert "invariant Agree" in text_of(opened, ".code .blamed")


@in_a_browser
def test_a_click_on_a_turn_goes_there_and_toggles_show_more(opened: Tab) -> None:
    opened.ask("page.open(0), document.querySelector('[data-turn=\"1\"]').click()")
    assert position(opened) == 1
    rows = "document.querySelectorAll('.grid th.name').length"
    before = opened.ask(rows)
    opened.ask("document.querySelectorAll('.lanes .toggle')[0].click()")
    assert opened.ask(rows) != before


@in_a_browser
def test_all_that_can_be_pressed_has_a_name(opened: Tab) -> None:
    opened.ask("page.open(0)")
    unnamed = opened.ask(
        "[...document.querySelectorAll('button, a, input')].filter((one) =>"
        "!(one.getAttribute('aria-label') || one.textContent.trim() || one.title)).length"
    )
    assert unnamed == 0
    assert opened.ask("document.querySelectorAll('.lanes .turn[tabindex=\"0\"]').length") == 1


@in_a_browser
@pytest.mark.parametrize("width", [390, 1400])
def test_nothing_is_wider_than_the_screen(opened: Tab, width: int) -> None:
    size = {"height": 844, "deviceScaleFactor": 1, "mobile": False}
    try:
        for story in ("page.overview()", "page.open(0)"):
            opened.call("Emulation.setDeviceMetricsOverride", width=width, **size)
            opened.ask(story)
            assert opened.ask("document.documentElement.scrollWidth") <= width
        place = opened.ask(
            "(({top, bottom}) => [top, bottom])(byId('transport').getBoundingClientRect())"
        )
        assert 0 < place[0] < place[1] <= 844
    finally:
        opened.call("Emulation.setDeviceMetricsOverride", width=1400, **{**size, "height": 900})


@in_a_browser
def test_a_loop_goes_on_at_its_beginning(tab: Tab, tmp_path: Path) -> None:
    path = tmp_path / "live.html"
    path.write_text(koord.html(koord.verify(Source("live.krd", LIVE), robots=2, jobs=1)), "utf-8")
    tab.complaints.clear()
    tab.open(f"{path.as_uri()}#story=0")
    tab.ask("page.go(Infinity)")
    tab.press("ArrowRight")
    first = tab.ask("page.view.telling.story.loop.first")
    assert tab.ask("page.view.telling.moments[page.view.position].round") == first
    assert "lap 2" in text_of(tab, "#clock")
    tab.press("ArrowLeft")
    assert tab.ask("page.view.position === page.view.telling.moments.length - 1") is True
    assert "fair" in text_of(tab, "[aria-label='What is claimed']")
    assert tab.complaints == []
